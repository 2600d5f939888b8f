//! The forward optics of a mirror: where the camera sees a point in it, with all Jacobians.

use super::axial::{AxialDepth, AxialDepths, IncidentRay};
use super::curved::Curvature;
use super::glass::GlassPane;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::{Plane, Ray};
use nalgebra::{Matrix2x3, Matrix3, Point3, Unit, Vector2, Vector3};

/// What a mirror is made of, beyond its plane: a pane of glass before the silver, a slight curvature.
///
/// The default is an ideal mirror: flat, silvered in front.
///
/// # The equation
/// Each of these mirrors has an axis of symmetry through the camera, its normal n. So the camera sees a point p in the
/// direction of an *apparent point* `p* = p + (E − n·p) n`: the point's lateral offset is kept, and its depth along n becomes
/// E. The ideal mirror has `E = 2 d − n·p`, and p* is the reflected point; glass ([`GlassPane`]) and curvature
/// ([`Curvature`]) change E. With both, their changes of E add, which is exact but for a term of the order of
/// thickness × curvature (3 mm of glass and a radius of 10 m: 3e-4 of the depth's change).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MirrorOptics {
    /// The glass before the silver.
    pub pane: GlassPane,
    /// The curvature of the silver.
    pub curvature: Curvature,
}

/// Where the camera sees a point in a mirror, with the derivatives by all quantities.
///
/// Only its direction matters for the pixel. For an ideal mirror it is the reflected point itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApparentPoint {
    /// The apparent point p* in the camera frame, m.
    pub point: Point3<f64>,
    /// `∂p*/∂p`, unitless.
    pub by_point: Matrix3<f64>,
    /// `∂p*/∂f`, unitless, by the foot point f = d n of the mirror's plane.
    pub by_foot_point: Matrix3<f64>,
    /// `∂p*/∂t`, unitless, by the thickness of the glass (also where it is 0).
    pub by_thickness: Vector3<f64>,
    /// `∂p*/∂κ`, m², by the curvature (also where it is 0).
    pub by_curvature: Vector3<f64>,
}

/// A pixel of a point seen in a mirror, with its Jacobians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPixel {
    /// (u, v), px.
    pub pixel: Vector2<f64>,
    /// `∂(u, v)/∂p`, px/m.
    pub by_point: Matrix2x3<f64>,
    /// `∂(u, v)/∂f`, px/m, by the foot point of the mirror's plane.
    pub by_foot_point: Matrix2x3<f64>,
    /// `∂(u, v)/∂t`, px/m, by the thickness of the glass.
    pub by_thickness: Vector2<f64>,
    /// `∂(u, v)/∂κ`, px·m, by the curvature.
    pub by_curvature: Vector2<f64>,
}

/// A point in the mirror's axial coordinates.
struct Axial {
    normal: Vector3<f64>,
    distance: f64,
    height: f64,
    lateral: Vector3<f64>,
}

impl Axial {
    #[inline]
    fn new(plane: &Plane, point: &Point3<f64>) -> Result<Self> {
        let normal = plane.normal().into_inner();
        let distance = plane.offset_m();
        let height = normal.dot(&point.coords);
        // Written so that NaN fails the test.
        if !(distance > 0.0 && distance - height > 0.0 && height.is_finite()) {
            return Err(Error::OutOfRange {
                what: "distance of a point before the mirror (m)".into(),
                got: if distance > 0.0 { distance - height } else { distance },
                needed: "above 0: camera and point on the same side of the mirror, its normal pointing away from the camera".into(),
            });
        }
        Ok(Self { normal, distance, height, lateral: point.coords - normal * height })
    }
}

impl Axial {
    /// The apparent point at a depth, with the chain rule to the point and the plane.
    #[inline]
    fn seen_at(&self, depth: &AxialDepth) -> ApparentPoint {
        let Self { normal: n, distance, height, lateral } = *self;
        let identity = Matrix3::identity();
        // dE = E_P dP + E_h dh + E_d dd, with dP = 2 l·dp − 2 h p·dn (l is the lateral offset).
        let depth_by_point = lateral * (2.0 * depth.by_lateral_squared) + n * depth.by_height;
        // (I − n nᵀ)/d applied to p, by symmetry ∂h/∂f.
        let height_by_foot = lateral / distance;
        let depth_by_foot = height_by_foot * (depth.by_height - 2.0 * height * depth.by_lateral_squared)
            + n * depth.by_distance;
        let normal_by_foot = (identity - n * n.transpose()) / distance;
        ApparentPoint {
            point: Point3::from(lateral + n * depth.depth),
            by_point: identity + n * (depth_by_point - n).transpose(),
            by_foot_point: n * (depth_by_foot - height_by_foot).transpose()
                + normal_by_foot * (depth.depth - height),
            by_thickness: Vector3::zeros(),
            by_curvature: Vector3::zeros(),
        }
    }
}

impl MirrorOptics {
    /// The ideal mirror: flat, silvered in front.
    pub const IDEAL: Self = Self { pane: GlassPane::NONE, curvature: Curvature::FLAT };

    /// A flat mirror with a pane of glass.
    pub fn of_glass(pane: GlassPane) -> Self {
        Self { pane, curvature: Curvature::FLAT }
    }

    /// Whether it is an ideal mirror.
    pub fn is_ideal(&self) -> bool {
        self.pane.thickness_m() == 0.0 && self.curvature.per_m() == 0.0
    }

    /// The apparent point p* of a point, both in the camera frame, m.
    ///
    /// `plane` is the front face of the glass, or the tangent plane of a curved mirror at the foot of the camera's
    /// perpendicular; its normal points away from the camera.
    ///
    /// # Errors
    /// [`Error::OutOfRange`]: a point that is not before the mirror, or in the focus of a curved one.
    #[inline]
    pub fn apparent_point(&self, plane: &Plane, point: &Point3<f64>) -> Result<Point3<f64>> {
        let at = Axial::new(plane, point)?;
        let lateral_squared = at.lateral.norm_squared();
        let ideal = 2.0 * at.distance - at.height;
        let mut depth = self.pane.depth(lateral_squared, at.height, at.distance);
        if self.curvature.per_m() != 0.0 {
            depth += self.curvature.depth(lateral_squared, at.height, at.distance)? - ideal;
        }
        Ok(Point3::from(at.lateral + at.normal * depth))
    }

    /// The apparent point with all its Jacobians.
    ///
    /// `dp* = dp + (dE − dh) n + (E − h) dn`, `dh = n·dp + p·dn`, `dn = (I − n nᵀ)/d df`.
    ///
    /// # Errors
    /// As [`MirrorOptics::apparent_point`].
    pub fn apparent_point_with_jacobians(&self, plane: &Plane, point: &Point3<f64>) -> Result<ApparentPoint> {
        let at = Axial::new(plane, point)?;
        let lateral_squared = at.lateral.norm_squared();
        let glass = self.pane.depth_with_derivatives(lateral_squared, at.height, at.distance);
        let curved = self.curvature.depth_with_derivatives(lateral_squared, at.height, at.distance)?;
        // Both share the ideal mirror's depth 2 d − h: count it once.
        let depth = AxialDepth {
            depth: glass.depth + curved.depth - (2.0 * at.distance - at.height),
            by_lateral_squared: glass.by_lateral_squared + curved.by_lateral_squared,
            by_height: glass.by_height + curved.by_height + 1.0,
            by_distance: glass.by_distance + curved.by_distance - 2.0,
            by_parameter: 0.0,
        };
        Ok(ApparentPoint {
            by_thickness: at.normal * glass.by_parameter,
            by_curvature: at.normal * curved.by_parameter,
            ..at.seen_at(&depth)
        })
    }

    /// The depths at which the camera sees several points, by the squares of their distances from the axis and their heights: by the
    /// thickness first, and by the curvature the derivatives of what it changes.
    #[inline(always)]
    pub(crate) fn depths<const N: usize>(
        &self,
        lateral_squared: &[f64; N],
        height: &[f64; N],
        distance: f64,
    ) -> (AxialDepths<N>, [f64; N]) {
        let mut out = self.pane.depths_with_derivatives(lateral_squared, height, distance);
        let curved = self.curvature.depths_with_derivatives(lateral_squared, height, distance);
        // Both share the ideal mirror's depth 2 d − h: count it once.
        for l in 0..N {
            out.depth[l] += curved.depth[l] - (2.0 * distance - height[l]);
            out.by_lateral_squared[l] += curved.by_lateral_squared[l];
            out.by_height[l] += curved.by_height[l] + 1.0;
            out.by_distance[l] += curved.by_distance[l] - 2.0;
            out.seen[l] &= curved.seen[l];
        }
        (out, curved.by_parameter)
    }

    /// The apparent point with its Jacobians by the point and by the plane alone (the others are 0): the inner loop of
    /// estimators that hold the mirror's glass and curvature. An ideal mirror costs no more than its reflection.
    #[inline]
    pub(crate) fn apparent_point_in_loop(&self, plane: &Plane, point: &Point3<f64>) -> Result<ApparentPoint> {
        let at = Axial::new(plane, point)?;
        if self.curvature.per_m() != 0.0 {
            return self.apparent_point_with_jacobians(plane, point);
        }
        let depth = if self.pane.thickness_m() == 0.0 {
            AxialDepth {
                depth: 2.0 * at.distance - at.height,
                by_height: -1.0,
                by_distance: 2.0,
                ..AxialDepth::default()
            }
        } else {
            self.pane.depth_with_derivatives(at.lateral.norm_squared(), at.height, at.distance)
        };
        Ok(at.seen_at(&depth))
    }

    /// The pixel of a point (camera frame, m) seen in the mirror, px.
    ///
    /// # Errors
    /// As [`MirrorOptics::apparent_point`] and [`Camera::project`].
    pub fn project(&self, camera: &Camera, plane: &Plane, point: &Point3<f64>) -> Result<Vector2<f64>> {
        camera.project(&self.apparent_point(plane, point)?)
    }

    /// The pixel of a point seen in the mirror, with its Jacobians.
    ///
    /// # Errors
    /// As [`MirrorOptics::project`].
    pub fn project_with_jacobians(
        &self,
        camera: &Camera,
        plane: &Plane,
        point: &Point3<f64>,
    ) -> Result<SeenPixel> {
        let seen = self.apparent_point_with_jacobians(plane, point)?;
        let (pixel, by) = camera.project_with_point_jacobian(&seen.point)?;
        Ok(SeenPixel {
            pixel,
            by_point: by * seen.by_point,
            by_foot_point: by * seen.by_foot_point,
            by_thickness: by * seen.by_thickness,
            by_curvature: by * seen.by_curvature,
        })
    }

    /// The virtual ray of a camera ray: the line in the air before the mirror along which the light came.
    ///
    /// Of an ideal mirror it is the paper's (Eq. 3): from the virtual camera's centre along H r.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where the ray leaves or misses the mirror.
    pub fn virtual_ray(&self, plane: &Plane, direction: &Unit<Vector3<f64>>) -> Result<Ray> {
        let mut ray = self.curvature.virtual_ray(plane, direction)?;
        if self.pane.thickness_m() > 0.0 {
            ray.origin += self.pane.lateral_shift(&IncidentRay::new(plane, direction)?);
        }
        Ok(ray)
    }
}
