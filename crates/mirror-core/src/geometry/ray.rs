//! Half-lines in space.

use super::Plane;
use crate::error::Result;
use nalgebra::{Point3, Unit, Vector3};

/// A ray closer to parallel with a plane than this (cosine with its normal) has no reliable intersection with it.
const PARALLEL_COSINE: f64 = 1e-12;

/// A half-line `x(t) = o + t r`, `t ≥ 0`, with `|r| = 1`; t in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts, m.
    pub origin: Point3<f64>,
    /// Its unit direction.
    pub direction: Unit<Vector3<f64>>,
}

/// Where a ray meets a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance along the ray, m, ≥ 0.
    pub distance_m: f64,
    /// The point, m.
    pub point: Point3<f64>,
}

impl Ray {
    /// A ray from a point along a vector of any length.
    ///
    /// # Errors
    /// [`crate::Error::NotFinite`], or [`crate::Error::NoDirection`] for a zero vector.
    pub fn new(origin: Point3<f64>, direction: Vector3<f64>) -> Result<Self> {
        let along = Plane::new(direction, 0.0)?.normal();
        for value in origin.iter() {
            crate::error::finite("ray origin (m)", *value)?;
        }
        Ok(Self { origin, direction: along })
    }

    /// The point at distance t (m) along the ray.
    pub fn at(&self, t: f64) -> Point3<f64> {
        self.origin + self.direction.into_inner() * t
    }

    /// Shortest distance of a point from the half-line, m.
    pub fn distance_m(&self, point: &Point3<f64>) -> f64 {
        let t = self.direction.dot(&(point - self.origin)).max(0.0);
        (point - self.at(t)).norm()
    }

    /// Where the ray meets a plane; nothing where it leaves the plane or runs along it.
    pub fn hit(&self, plane: &Plane) -> Option<RayHit> {
        let cosine = plane.normal().dot(&self.direction);
        if cosine.abs() < PARALLEL_COSINE {
            return None;
        }
        let distance_m = -plane.signed_distance_m(&self.origin) / cosine;
        (distance_m >= 0.0).then(|| RayHit { distance_m, point: self.at(distance_m) })
    }
}
