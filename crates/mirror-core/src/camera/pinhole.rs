//! The camera: intrinsics and lens, projection and its exact inverse.

use super::distorted::COEFFICIENTS;
use super::distortion::{Distortion, Lens};
use crate::error::{Error, Result, finite, positive};
use nalgebra::{Matrix2, Matrix2x3, Matrix3x2, Point3, SMatrix, Unit, Vector2, Vector3};

/// Points nearer than this to the camera's plane (m) are not projected.
const NEAREST_DEPTH_M: f64 = 1e-6;
/// The inverse stops when its reprojection is this near (normalised image coordinates: 1e-13 is 1e-10 px at f = 1000 px).
pub(super) const UNPROJECT_TOLERANCE: f64 = 1e-13;
/// Squared distance from the principal point, in focal lengths, from which on a ray is parallel to the picture's plane to
/// the last digits.
const FARTHEST_SQUARED: f64 = 1e16;
/// Newton converges in 4 to 6 steps inside the lens's one-to-one region.
const UNPROJECT_STEPS: usize = 50;

/// A camera with lens distortion, pinhole or fisheye: `u = fx x_d + cx`, `v = fy y_d + cy` with `(x_d, y_d)` from [`Distortion`].
///
/// Optical frame: z forward, x right, y down. Pixel (0, 0) is the centre of the top-left pixel.
///
/// ```
/// use mirror_core::camera::{Camera, Distortion};
/// use nalgebra::{Point3, Vector2};
///
/// let lens = Distortion::PlumbBob([-0.2, 0.07, 0.0, 0.0, 0.0]);
/// let camera = Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), lens)?;
/// let point = Point3::new(0.1, -0.05, 0.6);
/// let direction = camera.unproject(&camera.project(&point)?)?;
/// assert!((direction.into_inner() - point.coords.normalize()).norm() < 1e-9);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    width_px: u32,
    height_px: u32,
    focal_px: Vector2<f64>,
    center_px: Vector2<f64>,
    distortion: Distortion,
    lens: Lens,
}

/// A pixel and how it depends on the point and on the camera.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// (u, v), px.
    pub pixel: Vector2<f64>,
    /// `∂(u, v)/∂(X, Y, Z)`, px/m.
    pub by_point: Matrix2x3<f64>,
    /// `∂(u, v)/∂(fx, fy, cx, cy)`, unitless.
    pub by_intrinsics: SMatrix<f64, 2, 4>,
    /// `∂(u, v)/∂` the coefficients in their model's order (see [`Distortion::coefficients`]), px.
    pub by_distortion: SMatrix<f64, 2, COEFFICIENTS>,
}

/// A ray's direction and how it depends on the pixel.
#[derive(Debug, Clone, Copy)]
pub struct Unprojection {
    /// Unit direction in the camera frame.
    pub direction: Unit<Vector3<f64>>,
    /// `∂direction/∂(u, v)`, 1/px.
    pub by_pixel: Matrix3x2<f64>,
}

impl Camera {
    /// A camera of the given picture size (px), focal lengths (px), principal point (px) and lens.
    ///
    /// # Errors
    /// [`Error::NotFinite`] and [`Error::OutOfRange`]: a size or focal length that is not above zero.
    pub fn new(
        (width_px, height_px): (u32, u32),
        focal_px: Vector2<f64>,
        center_px: Vector2<f64>,
        distortion: Distortion,
    ) -> Result<Self> {
        positive("picture width (px)", f64::from(width_px))?;
        positive("picture height (px)", f64::from(height_px))?;
        let distortion = distortion.validated()?;
        let lens = Lens::new(&distortion);
        Self { width_px, height_px, focal_px, center_px, distortion, lens }
            .with_intrinsics(focal_px, center_px)
    }

    /// The same lens with other focal lengths and another principal point (px).
    ///
    /// # Errors
    /// [`Error::NotFinite`] and [`Error::OutOfRange`]: a focal length that is not above zero.
    pub fn with_intrinsics(mut self, focal_px: Vector2<f64>, center_px: Vector2<f64>) -> Result<Self> {
        positive("focal length fx (px)", focal_px.x)?;
        positive("focal length fy (px)", focal_px.y)?;
        finite("principal point cx (px)", center_px.x)?;
        finite("principal point cy (px)", center_px.y)?;
        (self.focal_px, self.center_px) = (focal_px, center_px);
        Ok(self)
    }

    /// Width and height of the picture, px.
    pub fn size_px(&self) -> (u32, u32) {
        (self.width_px, self.height_px)
    }

    /// `(fx, fy)`, px.
    pub fn focal_px(&self) -> Vector2<f64> {
        self.focal_px
    }

    /// `(cx, cy)`, px.
    pub fn center_px(&self) -> Vector2<f64> {
        self.center_px
    }

    /// The lens.
    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// The coefficients of a lens of polynomials, and the square of the largest distance from the axis (normalised) at which it is
    /// one-to-one; none of a fisheye.
    pub(crate) fn polynomial_lens(&self) -> Option<([f64; COEFFICIENTS], f64)> {
        let fisheye = matches!(self.distortion, Distortion::Equidistant(_));
        (!fisheye).then(|| (self.distortion.coefficients(), self.lens.one_to_one_limit))
    }

    /// Whether a pixel lies in the picture, edges of the outermost pixels included.
    pub fn contains(&self, pixel: &Vector2<f64>) -> bool {
        pixel.x >= -0.5
            && pixel.y >= -0.5
            && pixel.x <= f64::from(self.width_px) - 0.5
            && pixel.y <= f64::from(self.height_px) - 0.5
    }

    /// Normalised image coordinates `(X/Z, Y/Z)` of a point that this camera can see.
    #[inline]
    fn normalised(&self, point: &Point3<f64>) -> Result<Vector2<f64>> {
        let refuse = |reason| Err(Error::NotProjectable { x: point.x, y: point.y, z: point.z, reason });
        if !(point.z > NEAREST_DEPTH_M && point.z.is_finite()) {
            return refuse("needed a point before the camera (z above 0)");
        }
        let normalised = Vector2::new(point.x / point.z, point.y / point.z);
        // Written so that NaN fails the test.
        let squared = normalised.norm_squared();
        if !(squared.is_finite() && squared <= self.lens.one_to_one_limit) {
            return refuse("needed a point inside the angle within which the lens model is one-to-one");
        }
        Ok(normalised)
    }

    #[inline]
    fn to_pixel(&self, distorted: &Vector2<f64>) -> Vector2<f64> {
        self.focal_px.component_mul(distorted) + self.center_px
    }

    /// The pixel of a point given in the camera frame, px. It may lie outside the picture: see [`Camera::contains`].
    ///
    /// # Errors
    /// [`Error::NotProjectable`]: behind the camera, or beyond where the lens model is one-to-one.
    #[inline]
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Result<Vector2<f64>> {
        let normalised = self.normalised(point_in_camera)?;
        Ok(self.to_pixel(&self.lens.distort(&normalised)))
    }

    /// The pixel and `∂(u, v)/∂(X, Y, Z)`: what estimators need in their inner loop.
    ///
    /// # Errors
    /// As [`Camera::project`].
    #[inline]
    pub fn project_with_point_jacobian(&self, point: &Point3<f64>) -> Result<(Vector2<f64>, Matrix2x3<f64>)> {
        let normalised = self.normalised(point)?;
        let (distorted, by_normalised) = self.lens.distort_with_point_jacobian(&normalised);
        Ok((self.to_pixel(&distorted), self.by_point(point, &normalised, &by_normalised)))
    }

    /// The pixel with all its Jacobians.
    ///
    /// # Errors
    /// As [`Camera::project`].
    pub fn project_with_jacobians(&self, point: &Point3<f64>) -> Result<Projection> {
        let normalised = self.normalised(point)?;
        let d = self.lens.distort_with_jacobians(&normalised);
        let mut by_intrinsics = SMatrix::<f64, 2, 4>::zeros();
        by_intrinsics[(0, 0)] = d.point.x;
        by_intrinsics[(1, 1)] = d.point.y;
        by_intrinsics[(0, 2)] = 1.0;
        by_intrinsics[(1, 3)] = 1.0;
        let mut by_distortion = d.by_coefficients;
        by_distortion.row_mut(0).scale_mut(self.focal_px.x);
        by_distortion.row_mut(1).scale_mut(self.focal_px.y);
        Ok(Projection {
            pixel: self.to_pixel(&d.point),
            by_point: self.by_point(point, &normalised, &d.by_point),
            by_intrinsics,
            by_distortion,
        })
    }

    /// Chain rule from normalised coordinates to the point: `∂(x, y)/∂(X, Y, Z) = [I | −(x, y)ᵀ] / Z`.
    #[inline]
    fn by_point(
        &self,
        point: &Point3<f64>,
        n: &Vector2<f64>,
        by_normalised: &Matrix2<f64>,
    ) -> Matrix2x3<f64> {
        let j = Matrix2::from_diagonal(&self.focal_px) * by_normalised / point.z;
        let last = -(j * n);
        Matrix2x3::new(j[(0, 0)], j[(0, 1)], last.x, j[(1, 0)], j[(1, 1)], last.y)
    }

    /// Undistorted normalised coordinates of a pixel, and `∂(x, y)/∂(x_d, y_d)`, by Newton's method.
    fn undistorted(&self, pixel: &Vector2<f64>) -> Result<(Vector2<f64>, Matrix2<f64>)> {
        let refuse = |reason| Err(Error::NotUnprojectable { u: pixel.x, v: pixel.y, reason });
        if !(pixel.x.is_finite() && pixel.y.is_finite()) {
            return refuse("needed finite numbers");
        }
        let target = (pixel - self.center_px).component_div(&self.focal_px);
        // Written so that NaN fails the test.
        if !(target.norm_squared() < FARTHEST_SQUARED) {
            return refuse("needed a pixel whose ray has a direction before the camera");
        }
        if matches!(self.distortion, Distortion::None) {
            return Ok((target, Matrix2::identity()));
        }
        let mut x = self.lens.near_undistorted(&target);
        let (mut at, mut jacobian) = self.lens.distort_with_point_jacobian(&x);
        for _ in 0..UNPROJECT_STEPS {
            let residual = at - target;
            let Some(inverse) = jacobian.try_inverse() else {
                return refuse("needed a pixel inside the region in which the lens model can be inverted");
            };
            if residual.amax() <= UNPROJECT_TOLERANCE * (1.0 + target.amax()) {
                if !(jacobian.determinant() > 0.0 && x.norm_squared() <= self.lens.one_to_one_limit) {
                    break;
                }
                return Ok((x, inverse));
            }
            // Back off where a full step would leave the one-to-one region: the polynomial grows wildly there.
            let mut step = inverse * residual;
            let mut next = x - step;
            (at, jacobian) = self.lens.distort_with_point_jacobian(&next);
            for _ in 0..30 {
                if next.norm_squared() <= self.lens.one_to_one_limit
                    && (at - target).norm_squared() < residual.norm_squared()
                {
                    break;
                }
                step *= 0.5;
                next = x - step;
                (at, jacobian) = self.lens.distort_with_point_jacobian(&next);
            }
            x = next;
        }
        refuse("needed a pixel inside the region in which the lens model can be inverted")
    }

    /// The direction of the ray of a pixel: the exact inverse of [`Camera::project`].
    ///
    /// # Errors
    /// [`Error::NotUnprojectable`] where no ray of the one-to-one region reaches the pixel.
    pub fn unproject(&self, pixel: &Vector2<f64>) -> Result<Unit<Vector3<f64>>> {
        let (x, _) = self.undistorted(pixel)?;
        Ok(Unit::new_normalize(Vector3::new(x.x, x.y, 1.0)))
    }

    /// The direction of the ray of a pixel and `∂direction/∂(u, v)`.
    ///
    /// With `m = (x, y, 1)`: `∂(m/|m|) = (I − m mᵀ/|m|²)/|m| · ∂m`.
    ///
    /// # Errors
    /// As [`Camera::unproject`].
    pub fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Result<Unprojection> {
        let (x, inverse) = self.undistorted(pixel)?;
        let m = Vector3::new(x.x, x.y, 1.0);
        let length = m.norm();
        let direction = Unit::new_unchecked(m / length);
        let by_pixel = inverse * Matrix2::from_diagonal(&self.focal_px.map(|f| 1.0 / f));
        let along =
            Matrix3x2::new(by_pixel[(0, 0)], by_pixel[(0, 1)], by_pixel[(1, 0)], by_pixel[(1, 1)], 0.0, 0.0)
                / length;
        let d = direction.into_inner();
        Ok(Unprojection { direction, by_pixel: along - d * (d.transpose() * along) })
    }
}
