//! A pane of glass silvered at its back: refracted in, reflected, refracted out.

use super::axial::{AxialDepth, AxialDepths, IncidentRay};
use crate::error::{Error, Result, finite};
use crate::geometry::{Plane, Ray, Reflection};
use nalgebra::{Unit, Vector3};

/// Glass thicker than this (m) is no mirror pane: the value was given in millimetres.
const THICKEST_PANE_M: f64 = 0.1;
/// No glass refracts more (diamond has 2.42).
const LARGEST_INDEX: f64 = 3.0;
/// Newton runs monotonically to the root and needs 2 to 4 steps; the rest is for grazing rays.
const SNELL_STEPS: usize = 60;
/// Steps of several points at once: rays that need more graze the pane, beyond any lens.
const SNELL_STEPS_OF_MANY: usize = 6;
/// After a step below this, relative to 1 + tan α, the next would be below rounding: Newton converges quadratically.
const SNELL_TOLERANCE: f64 = 1e-8;

/// A pane of glass of thickness t (m) and refractive index n, silvered at its back.
///
/// **The plane of a mirror with a pane is its front face**: the face that a hand touches and a tape measures,
/// and the one at which rays bend. The silver is the parallel plane t behind it. At t = 0 both are the ideal mirror.
///
/// # The equation
/// Unfolded at the silver, the path from the camera (distance d before the front face) to a point (height
/// `d − h` before it, lateral distance ρ from the camera's perpendicular) crosses `D = 2 d − h` of air and 2 t of glass:
///
/// `ρ = D tan α + 2 t tan β`, `sin α = n sin β`.
///
/// In `τ = tan α`: `F(τ) = D τ + 2 t τ g(τ²) − ρ` with `g(s) = (n² + (n² − 1) s)^(−1/2)`. F rises and is concave, and at
/// `τ₀ = ρ / (D + 2 t / n)` it is at or below 0, so Newton from τ₀ runs monotonically to the only root, grazing rays
/// included. The camera sees the point in the direction of its lateral offset at depth `E = D + 2 t g(τ²)`: a
/// smooth function of ρ², exact at t = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlassPane {
    thickness_m: f64,
    refractive_index: f64,
}

impl Default for GlassPane {
    /// No glass (a front-surface mirror), of the refractive index of float glass.
    fn default() -> Self {
        Self::NONE
    }
}

impl GlassPane {
    /// Refractive index of the soda-lime float glass that mirrors are made of.
    pub const FLOAT_GLASS_INDEX: f64 = 1.52;

    /// No glass: a front-surface mirror.
    pub const NONE: Self = Self { thickness_m: 0.0, refractive_index: Self::FLOAT_GLASS_INDEX };

    /// A pane of the given thickness (m, 0 for a front-surface mirror) and refractive index.
    ///
    /// # Errors
    /// [`Error::OutOfRange`]: a thickness outside 0 to 0.1 m, an index outside 1 to 3.
    pub fn new(thickness_m: f64, refractive_index: f64) -> Result<Self> {
        if !(0.0..=THICKEST_PANE_M).contains(&finite("glass thickness (m)", thickness_m)?) {
            return Err(Error::OutOfRange {
                what: "glass thickness (m)".into(),
                got: thickness_m,
                needed: format!("0 to {THICKEST_PANE_M} (metres, not millimetres)"),
            });
        }
        if !(1.0..=LARGEST_INDEX).contains(&finite("refractive index", refractive_index)?) {
            return Err(Error::OutOfRange {
                what: "refractive index".into(),
                got: refractive_index,
                needed: format!("1 to {LARGEST_INDEX} (float glass has {})", Self::FLOAT_GLASS_INDEX),
            });
        }
        Ok(Self { thickness_m, refractive_index })
    }

    /// Thickness t, m.
    pub fn thickness_m(&self) -> f64 {
        self.thickness_m
    }

    /// Refractive index n.
    pub fn refractive_index(&self) -> f64 {
        self.refractive_index
    }

    /// How far behind the front face a paraxial ray sees the mirror, `t / n`, m (1.97 mm for 3 mm of float glass).
    pub fn paraxial_depth_m(&self) -> f64 {
        self.thickness_m / self.refractive_index
    }

    /// `g(s) = (n² + (n² − 1) s)^(−1/2)`: tan β = τ g(τ²).
    #[inline]
    fn refraction(&self, tangent_squared: f64) -> f64 {
        let n2 = self.refractive_index * self.refractive_index;
        1.0 / (n2 + (n2 - 1.0) * tangent_squared).sqrt()
    }

    /// The tangent of the angle of incidence.
    #[inline]
    fn incidence_tangent(&self, lateral: f64, air: f64) -> f64 {
        let n2 = self.refractive_index * self.refractive_index;
        let twice = 2.0 * self.thickness_m;
        let mut tangent = lateral / (air + twice / self.refractive_index);
        for _ in 0..SNELL_STEPS {
            let g = self.refraction(tangent * tangent);
            let value = tangent * (air + twice * g) - lateral;
            let slope = air + twice * n2 * g * g * g;
            let step = value / slope;
            tangent -= step;
            if step.abs() <= SNELL_TOLERANCE * (1.0 + tangent) {
                break;
            }
        }
        tangent
    }

    /// The depth at which the camera sees a point, without derivatives.
    #[inline]
    pub(super) fn depth(&self, lateral_squared: f64, height: f64, distance: f64) -> f64 {
        let air = 2.0 * distance - height;
        if self.thickness_m == 0.0 {
            return air;
        }
        let tangent = self.incidence_tangent(lateral_squared.sqrt(), air);
        air + 2.0 * self.thickness_m * self.refraction(tangent * tangent)
    }

    /// The depth at which the camera sees a point, by implicit differentiation of `E = D + 2 t g(ρ²/E²)`.
    pub(super) fn depth_with_derivatives(
        &self,
        lateral_squared: f64,
        height: f64,
        distance: f64,
    ) -> AxialDepth {
        let n = self.refractive_index;
        let t = self.thickness_m;
        let depth = self.depth(lateral_squared, height, distance);
        let s = lateral_squared / (depth * depth);
        let g = self.refraction(s);
        let slope = -0.5 * (n * n - 1.0) * g * g * g;
        let implicit = 1.0 / (1.0 + 4.0 * t * slope * s / depth);
        AxialDepth {
            depth,
            by_lateral_squared: 2.0 * t * slope / (depth * depth) * implicit,
            by_height: -implicit,
            by_distance: 2.0 * implicit,
            by_parameter: 2.0 * g * implicit,
        }
    }

    /// As [`GlassPane::depth_with_derivatives`], of several points at once.
    #[inline(always)]
    pub(super) fn depths_with_derivatives<const N: usize>(
        &self,
        lateral_squared: &[f64; N],
        height: &[f64; N],
        distance: f64,
    ) -> AxialDepths<N> {
        let (n, t) = (self.refractive_index, self.thickness_m);
        let (n2, twice) = (n * n, 2.0 * t);
        let refraction = |s: f64| 1.0 / (n2 + (n2 - 1.0) * s).sqrt();
        let (mut air, mut lateral, mut tangent, mut last) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
        for l in 0..N {
            air[l] = 2.0 * distance - height[l];
            lateral[l] = lateral_squared[l].sqrt();
            tangent[l] = lateral[l] / (air[l] + twice / n);
        }
        for _ in 0..if t == 0.0 { 0 } else { SNELL_STEPS_OF_MANY } {
            for l in 0..N {
                let g = refraction(tangent[l] * tangent[l]);
                let value = tangent[l] * (air[l] + twice * g) - lateral[l];
                last[l] = value / (air[l] + twice * n2 * g * g * g);
                tangent[l] -= last[l];
            }
        }
        let mut out = AxialDepths::ZERO;
        for l in 0..N {
            let depth = air[l] + twice * refraction(tangent[l] * tangent[l]);
            let s = lateral_squared[l] / (depth * depth);
            let g = refraction(s);
            let slope = -0.5 * (n2 - 1.0) * g * g * g;
            let implicit = 1.0 / (1.0 + 4.0 * t * slope * s / depth);
            out.depth[l] = depth;
            out.by_lateral_squared[l] = 2.0 * t * slope / (depth * depth) * implicit;
            out.by_height[l] = -implicit;
            out.by_distance[l] = 2.0 * implicit;
            out.by_parameter[l] = 2.0 * g * implicit;
            out.seen[l] = last[l].abs() <= SNELL_TOLERANCE * (1.0 + tangent[l]);
        }
        out
    }

    /// How far the pane shifts the outgoing ray sideways, `2 t tan β` along the ray's lateral direction, m.
    #[inline]
    pub(super) fn lateral_shift(&self, ray: &IncidentRay) -> Vector3<f64> {
        let tangent_squared = ray.lateral.norm_squared() / (ray.cosine * ray.cosine);
        ray.lateral * (2.0 * self.thickness_m * self.refraction(tangent_squared) / ray.cosine)
    }

    /// The virtual ray of a camera ray: where the light that came in along it was in the air before the mirror.
    ///
    /// The reflected ray, shifted sideways by `2 t tan β`; at t = 0 the paper's virtual ray (Eq. 3), from the virtual
    /// camera's centre. `front_face` is in the camera frame, the direction in the camera frame too.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where the ray leaves the mirror.
    pub fn virtual_ray(&self, front_face: &Plane, direction: &Unit<Vector3<f64>>) -> Result<Ray> {
        let incident = IncidentRay::new(front_face, direction)?;
        let mirror = Reflection::across(*front_face);
        Ok(Ray {
            origin: (mirror.translation() + self.lateral_shift(&incident)).into(),
            direction: Unit::new_unchecked(mirror.vector(direction)),
        })
    }
}
