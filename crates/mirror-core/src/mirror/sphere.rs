//! The image of a ball: an ellipse whose centre is not the image of the ball's centre.

use crate::camera::{Camera, Distortion};
use crate::error::{Error, Result, positive};
use nalgebra::{Matrix2x3, Matrix3, Point3, Vector2, Vector3};

/// The inverse stops at steps below this, px; it gains a factor of some 1e4 a step.
const INVERSE_TOLERANCE_PX: f64 = 1e-12;
/// Steps of the inverse through a lens.
const INVERSE_STEPS: usize = 20;

/// A ball of known diameter, seen directly or in a mirror (the reflection of a ball is a ball).
///
/// # The equation
/// A pinhole sees the ball of radius R round X = (x, y, z) as an ellipse whose centre, in normalised coordinates, is
/// `(x z, y z) / (z² − R²)`: exactly the picture of the point `(x, y, z − R²/z)`. The centroid of the outline's area is that point's pixel. The offset
/// from the picture of the centre grows with the angle off axis: 0.29 px for an 11.6 mm ball at 300 mm, 36°, f = 693 px.
///
/// A lens bends the ellipse. The centroid of the bent area is the mean of the distorted position over the ellipse, weighted with the lens's
/// area factor; it is taken with four points that are exact for functions of third degree on the ellipse.
///
/// Source: the conic of the tangent cone, e.g. Hartley & Zisserman, "Multiple View Geometry", 8.3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    radius_m: f64,
}

/// The centroid of a ball's picture and how it depends on the ball's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereProjection {
    /// The centroid of the outline's area (u, v), px.
    pub centroid_px: Vector2<f64>,
    /// `∂(u, v)/∂(X, Y, Z)` of the ball's centre, px/m. Exact without lens distortion; with it the variation of the
    /// lens across the ball is held, which is below 1e-3 of it.
    pub by_center: Matrix2x3<f64>,
}

impl Sphere {
    /// A ball of the given diameter, m; 0 is an ideal point.
    ///
    /// # Errors
    /// [`Error::NotFinite`], or [`Error::OutOfRange`] for a negative one.
    pub fn of_diameter_m(diameter_m: f64) -> Result<Self> {
        if diameter_m != 0.0 {
            positive("ball diameter (m)", diameter_m)?;
        }
        Ok(Self { radius_m: diameter_m / 2.0 })
    }

    /// The radius, m.
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// The point whose picture is the ellipse's centre, before the lens: `(x, y, z − R²/z)`.
    fn ellipse_center(&self, center: &Point3<f64>) -> Result<Point3<f64>> {
        let r2 = self.radius_m * self.radius_m;
        if !(center.z > self.radius_m) {
            return Err(Error::NotProjectable {
                x: center.x,
                y: center.y,
                z: center.z,
                reason: "needed a ball wholly before the camera",
            });
        }
        Ok(Point3::new(center.x, center.y, center.z - r2 / center.z))
    }

    /// How far the lens moves the area's centroid from the picture of the ellipse's centre, px; 0 without lens distortion.
    fn bending_px(
        &self,
        camera: &Camera,
        center: &Point3<f64>,
        middle: &Vector2<f64>,
    ) -> Result<Vector2<f64>> {
        if matches!(camera.distortion(), Distortion::None) || self.radius_m == 0.0 {
            return Ok(Vector2::zeros());
        }
        // Semi-axes of the ellipse in normalised coordinates: radial R √(|X|² − R²) / (z² − R²), tangential R / √(z² − R²).
        let r2 = self.radius_m * self.radius_m;
        let depth2 = center.z * center.z - r2;
        let radial_length = self.radius_m * (center.coords.norm_squared() - r2).sqrt() / depth2;
        let tangential_length = self.radius_m / depth2.sqrt();
        let off_axis = Vector2::new(center.x, center.y);
        let outward = off_axis.try_normalize(1e-12 * center.z).unwrap_or_else(Vector2::x);
        let radial = outward * radial_length;
        let tangential = Vector2::new(-outward.y, outward.x) * tangential_length;
        let ellipse = self.ellipse_center(center)?;
        let at = Vector2::new(ellipse.x, ellipse.y) / ellipse.z;
        // The second moment of a uniform disc is 1/4: four points at 1/√2 of the semi-axes have the same.
        let reach = std::f64::consts::FRAC_1_SQRT_2;
        let (mut sum, mut weights) = (Vector2::zeros(), 0.0);
        for offset in [radial, -radial, tangential, -tangential] {
            let y = at + offset * reach;
            let (pixel, by) = camera.project_with_point_jacobian(&Point3::new(y.x, y.y, 1.0))?;
            let area = by[(0, 0)] * by[(1, 1)] - by[(0, 1)] * by[(1, 0)];
            sum += (pixel - middle) * area;
            weights += area;
        }
        Ok(sum / weights)
    }

    /// The centroid of the ball's picture, px; the ball's centre is in the camera frame (behind the mirror, for a ball seen in one).
    ///
    /// # Errors
    /// [`Error::NotProjectable`].
    pub fn project(&self, camera: &Camera, center: &Point3<f64>) -> Result<Vector2<f64>> {
        let middle = camera.project(&self.ellipse_center(center)?)?;
        Ok(middle + self.bending_px(camera, center, &middle)?)
    }

    /// The centroid of the ball's picture with its Jacobian.
    ///
    /// # Errors
    /// As [`Sphere::project`].
    pub fn project_with_jacobian(&self, camera: &Camera, center: &Point3<f64>) -> Result<SphereProjection> {
        let (middle, by) = camera.project_with_point_jacobian(&self.ellipse_center(center)?)?;
        let r2 = self.radius_m * self.radius_m;
        let stretch = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 1.0 + r2 / (center.z * center.z)));
        Ok(SphereProjection {
            centroid_px: middle + self.bending_px(camera, center, &middle)?,
            by_center: by * stretch,
        })
    }

    /// From the centroid of a ball's picture to the picture of its centre, px: the correction that lets a ball be
    /// triangulated as a point. `distance_m` is the length of the light's path from the camera to the ball's centre; its error
    /// matters little (10 % of it is 20 % of a correction of tenths of a pixel).
    ///
    /// With the normalised centroid c, `k = R²/L²` and μ the normalised centre's distance off axis, `k c μ² + μ − c (1 − k) = 0`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a path shorter than the diameter, [`Error::NotUnprojectable`].
    pub fn center_pixel(
        &self,
        camera: &Camera,
        centroid_px: &Vector2<f64>,
        distance_m: f64,
    ) -> Result<Vector2<f64>> {
        if !(distance_m.is_finite() && distance_m > 2.0 * self.radius_m && distance_m > 0.0) {
            return Err(Error::OutOfRange {
                what: "length of the path to a ball (m)".into(),
                got: distance_m,
                needed: format!("above its diameter, {} m", 2.0 * self.radius_m),
            });
        }
        let k = (self.radius_m / distance_m).powi(2);
        let mut ellipse_pixel = *centroid_px;
        for _ in 0..INVERSE_STEPS {
            let ray = camera.unproject(&ellipse_pixel)?;
            let c = Vector2::new(ray.x, ray.y) / ray.z;
            let b = c.norm();
            // The root that is c (1 − k) for small k, without division by k c.
            let shrink = 2.0 * (1.0 - k) / (1.0 + (1.0 + 4.0 * k * b * b * (1.0 - k)).sqrt());
            let m = c * shrink;
            let z = distance_m / (1.0 + m.norm_squared()).sqrt();
            let center = Point3::new(m.x * z, m.y * z, z);
            let predicted = ellipse_pixel + self.bending_px(camera, &center, &ellipse_pixel)?;
            let step = centroid_px - predicted;
            if step.amax() <= INVERSE_TOLERANCE_PX * (1.0 + centroid_px.amax()) {
                return camera.project(&center);
            }
            ellipse_pixel += step;
        }
        Err(Error::NotUnprojectable {
            u: centroid_px.x,
            v: centroid_px.y,
            reason: "needed a ball small enough for the lens's variation across it to be slight",
        })
    }
}
