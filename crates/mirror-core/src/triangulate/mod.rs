//! Virtual rays to points, with covariance.
