//! A slightly spherical mirror: what a flat one becomes when its frame bends it.

use super::axial::{AxialDepth, AxialDepths, IncidentRay};
use crate::error::{Error, Result, finite};
use crate::geometry::{Plane, Ray};
use nalgebra::{Point3, Unit, Vector3};

/// A mirror curved more than this (1/m; a radius of 50 mm) is no slightly spherical one.
const STRONGEST_CURVATURE_PER_M: f64 = 20.0;
/// How near a concave mirror may come to focusing the camera on the point (1: in focus, no single reflection).
/// Below it the reflection is single and Newton from the flat mirror's converges.
const LARGEST_FOCUS: f64 = 0.7;
/// Largest sine of the slope of the mirror at a reflection.
const LARGEST_SLOPE: f64 = 0.5;
/// Newton needs 2 to 5 steps.
const REFLECTION_STEPS: usize = 50;
/// Steps of several points at once.
const REFLECTION_STEPS_OF_MANY: usize = 7;
/// After a relative step below this Newton's next would be below rounding: it converges quadratically.
const LAST_STEP: f64 = 1e-8;

/// The curvature κ = 1/R (1/m) of a spherical mirror; positive is concave as the camera sees it, 0 is flat.
///
/// **The plane of a spherical mirror is its tangent plane at its vertex, the foot of the camera's perpendicular.** A
/// sphere has four parameters, and the foot point f = d n with κ are four: each spherical mirror whose centre is not the
/// camera's has exactly one such description, so nothing is lost by putting the vertex there. Its centre lies at f − n/κ.
///
/// # The equation
/// With y = x − f the surface is `κ |y|² + 2 n·y = 0`, and `m = κ y + n` is its unit normal: no division by κ. Camera, point
/// and centre span the plane of incidence, which contains n, so the path lies in it. Let the reflection happen at lateral
/// distance σ ρ, ρ being the point's. With `P = ρ²`, `c = √(1 − κ² σ² P)`, `w = −κ σ² P / (1 + c)`, `a = κ σ (1 − σ) P + c (h − d − w)`
/// (the point's signed distance from the tangent plane at the reflection), camera, reflection and reflected point are in line where
///
/// `g(σ) = σ (h − 2 a c) − (d + w) (1 − 2 a κ σ) = 0`,
///
/// a smooth function of κ and of ρ², so that both are exact at 0, where `σ = d / (2 d − h)`. The camera sees the point in the
/// direction of its lateral offset at depth `E = (d + w) / σ`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Curvature {
    per_m: f64,
}

/// Small changes of what the reflection depends on, or values of the intermediate quantities.
#[derive(Clone, Copy, Default)]
struct Change {
    sigma: f64,
    lateral_squared: f64,
    height: f64,
    distance: f64,
    curvature: f64,
}

/// The intermediate quantities at a trial σ.
struct Trial {
    sigma: f64,
    lateral_squared: f64,
    height: f64,
    distance: f64,
    curvature: f64,
    c: f64,
    w: f64,
    a: f64,
    g: f64,
}

impl Trial {
    #[inline]
    fn at(sigma: f64, lateral_squared: f64, height: f64, distance: f64, curvature: f64) -> Option<Self> {
        let trial = Self::of(sigma, lateral_squared, height, distance, curvature);
        trial.is_slight().then_some(trial)
    }

    /// Whether the mirror is no steeper there than a slightly spherical one. Written so that NaN fails.
    #[inline(always)]
    fn is_slight(&self) -> bool {
        let slope = self.curvature * self.sigma;
        slope * slope * self.lateral_squared <= LARGEST_SLOPE * LARGEST_SLOPE
    }

    /// The depth `(d + w)/σ` at a solution of g(σ) = 0, by implicit differentiation.
    #[inline(always)]
    fn depth_with_derivatives(&self) -> AxialDepth {
        let depth = (self.distance + self.w) / self.sigma;
        let (w_by_sigma, g_by_sigma) = self.differential(&Change { sigma: 1.0, ..Change::default() });
        let depth_by = |change: Change| {
            let (dw, dg) = self.differential(&change);
            let dsigma = -dg / g_by_sigma;
            (change.distance + dw + w_by_sigma * dsigma - depth * dsigma) / self.sigma
        };
        AxialDepth {
            depth,
            by_lateral_squared: depth_by(Change { lateral_squared: 1.0, ..Change::default() }),
            by_height: depth_by(Change { height: 1.0, ..Change::default() }),
            by_distance: depth_by(Change { distance: 1.0, ..Change::default() }),
            by_parameter: depth_by(Change { curvature: 1.0, ..Change::default() }),
        }
    }

    #[inline(always)]
    fn of(sigma: f64, lateral_squared: f64, height: f64, distance: f64, curvature: f64) -> Self {
        let s2 = sigma * sigma * lateral_squared;
        let c = (1.0 - curvature * curvature * s2).sqrt();
        let w = -curvature * s2 / (1.0 + c);
        let a = curvature * sigma * (1.0 - sigma) * lateral_squared + c * (height - distance - w);
        let g = sigma * (height - 2.0 * a * c) - (distance + w) * (1.0 - 2.0 * a * curvature * sigma);
        Self { sigma, lateral_squared, height, distance, curvature, c, w, a, g }
    }

    /// `∂g/∂σ`: [`Trial::differential`] of a change of σ alone, which Newton asks for many times.
    #[inline(always)]
    fn slope(&self) -> f64 {
        let Self { sigma, lateral_squared: p, height, distance, curvature: k, c, w, a, .. } = *self;
        let k_ds2 = 2.0 * k * sigma * p;
        let dc = -0.5 * k * k_ds2 / c;
        let dw = -0.5 * k_ds2 / c;
        let da = k * (1.0 - 2.0 * sigma) * p + dc * (height - distance - w) - c * dw;
        height - 2.0 * a * c - 2.0 * sigma * (da * c + a * dc) - dw * (1.0 - 2.0 * a * k * sigma)
            + 2.0 * (distance + w) * k * (da * sigma + a)
    }

    /// The differentials `(dw, dg)` of a change.
    #[inline(always)]
    fn differential(&self, by: &Change) -> (f64, f64) {
        let Self { sigma, lateral_squared: p, height, distance, curvature: k, c, w, a, .. } = *self;
        let s2 = sigma * sigma * p;
        let ds2 = 2.0 * sigma * p * by.sigma + sigma * sigma * by.lateral_squared;
        let dc = -(0.5 * k * k * ds2 + k * s2 * by.curvature) / c;
        let dw = -(k * ds2 + (s2 + w * w) * by.curvature) / (2.0 * c);
        let da = by.curvature * sigma * (1.0 - sigma) * p
            + k * (1.0 - 2.0 * sigma) * p * by.sigma
            + k * sigma * (1.0 - sigma) * by.lateral_squared
            + dc * (height - distance - w)
            + c * (by.height - by.distance - dw);
        let dg = by.sigma * (height - 2.0 * a * c) + sigma * (by.height - 2.0 * (da * c + a * dc))
            - (by.distance + dw) * (1.0 - 2.0 * a * k * sigma)
            + 2.0 * (distance + w) * (da * k * sigma + a * by.curvature * sigma + a * k * by.sigma);
        (dw, dg)
    }
}

impl Curvature {
    /// A flat mirror.
    pub const FLAT: Self = Self { per_m: 0.0 };

    /// A curvature in 1/m: 1/R, positive for a mirror that is concave as the camera sees it.
    ///
    /// # Errors
    /// [`Error::NotFinite`] and [`Error::OutOfRange`] (beyond ±20 1/m).
    pub fn new(per_m: f64) -> Result<Self> {
        if finite("mirror curvature (1/m)", per_m)?.abs() > STRONGEST_CURVATURE_PER_M {
            return Err(Error::OutOfRange {
                what: "mirror curvature (1/m)".into(),
                got: per_m,
                needed: format!(
                    "at most {STRONGEST_CURVATURE_PER_M} either way: a slightly spherical mirror"
                ),
            });
        }
        Ok(Self { per_m })
    }

    /// κ, 1/m.
    pub fn per_m(&self) -> f64 {
        self.per_m
    }

    fn refuse<T>(&self) -> Result<T> {
        Err(Error::OutOfRange {
            what: "mirror curvature (1/m)".into(),
            got: self.per_m,
            needed: "one so slight that the camera sees each point once (the point is near the mirror's focus, or the mirror's slope beyond 30 degrees)".into(),
        })
    }

    fn reflection(&self, lateral_squared: f64, height: f64, distance: f64) -> Result<Trial> {
        let k = self.per_m;
        // On the axis the mirror focuses the camera on the point where 2 κ a b / (a + b) = 1.
        let before = distance - height;
        if k * 2.0 * distance * before > LARGEST_FOCUS * (distance + before) {
            return self.refuse();
        }
        // The paraxial mirror equation starts it.
        let mut sigma = distance / (distance + before - 2.0 * k * distance * before);
        if k == 0.0 {
            return Trial::at(sigma, lateral_squared, height, distance, k).map_or_else(|| self.refuse(), Ok);
        }
        for _ in 0..REFLECTION_STEPS {
            let Some(trial) = Trial::at(sigma, lateral_squared, height, distance, k) else {
                return self.refuse();
            };
            let step = trial.g / trial.slope();
            let last = step.abs() <= LAST_STEP * sigma.abs();
            // σ stays positive: the reflection lies on the point's side of the axis.
            sigma = (sigma - step).clamp(0.5 * sigma, 2.0 * sigma);
            if last {
                break;
            }
        }
        match Trial::at(sigma, lateral_squared, height, distance, k) {
            Some(trial) if trial.g.abs() <= 1e-12 * distance => Ok(trial),
            _ => self.refuse(),
        }
    }

    /// The depth at which the camera sees a point, without derivatives.
    #[inline]
    pub(super) fn depth(&self, lateral_squared: f64, height: f64, distance: f64) -> Result<f64> {
        if self.per_m == 0.0 {
            return Ok(2.0 * distance - height);
        }
        let at = self.reflection(lateral_squared, height, distance)?;
        Ok((distance + at.w) / at.sigma)
    }

    /// The depth at which the camera sees a point, and its derivatives.
    pub(super) fn depth_with_derivatives(
        &self,
        lateral_squared: f64,
        height: f64,
        distance: f64,
    ) -> Result<AxialDepth> {
        Ok(self.reflection(lateral_squared, height, distance)?.depth_with_derivatives())
    }

    /// As [`Curvature::depth_with_derivatives`], of several points at once.
    #[inline(always)]
    pub(super) fn depths_with_derivatives<const N: usize>(
        &self,
        lateral_squared: &[f64; N],
        height: &[f64; N],
        distance: f64,
    ) -> AxialDepths<N> {
        let k = self.per_m;
        let mut sigma = [0.0; N];
        for l in 0..N {
            let before = distance - height[l];
            sigma[l] = distance / (distance + before - 2.0 * k * distance * before);
        }
        for _ in 0..if k == 0.0 { 0 } else { REFLECTION_STEPS_OF_MANY } {
            for l in 0..N {
                let trial = Trial::of(sigma[l], lateral_squared[l], height[l], distance, k);
                let next = sigma[l] - trial.g / trial.slope();
                sigma[l] = next.max(0.5 * sigma[l]).min(2.0 * sigma[l]);
            }
        }
        let mut out = AxialDepths::ZERO;
        for l in 0..N {
            let before = distance - height[l];
            let at = Trial::of(sigma[l], lateral_squared[l], height[l], distance, k);
            let depth = at.depth_with_derivatives();
            out.depth[l] = depth.depth;
            out.by_lateral_squared[l] = depth.by_lateral_squared;
            out.by_height[l] = depth.by_height;
            out.by_distance[l] = depth.by_distance;
            out.by_parameter[l] = depth.by_parameter;
            out.seen[l] = (k * 2.0 * distance * before <= LARGEST_FOCUS * (distance + before))
                & at.is_slight()
                & (at.g.abs() <= 1e-12 * distance);
        }
        out
    }

    /// The virtual ray of a camera ray: the line of the reflected light, started as far behind the mirror as the camera
    /// stands before it along the ray. At κ = 0 it is the paper's virtual ray (Eq. 3), from the virtual camera's centre.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where the ray leaves or misses the mirror.
    pub fn virtual_ray(&self, tangent_plane: &Plane, direction: &Unit<Vector3<f64>>) -> Result<Ray> {
        let incident = IncidentRay::new(tangent_plane, direction)?;
        let k = self.per_m;
        let d = tangent_plane.offset_m();
        // κ λ² + 2 b λ − d (2 − κ d) = 0, solved without division by κ.
        let b = incident.cosine * (1.0 - k * d);
        let discriminant = b * b + k * d * (2.0 - k * d);
        if !(discriminant > 0.0 && b > 0.0) {
            return self.refuse();
        }
        let distance = d * (2.0 - k * d) / (b + discriminant.sqrt());
        let r = direction.into_inner();
        let hit = r * distance;
        let normal = (hit - tangent_plane.foot_point()) * k + tangent_plane.normal().into_inner();
        let out = Unit::new_normalize(r - normal * (2.0 * normal.dot(&r)));
        Ok(Ray { origin: Point3::from(hit - out.into_inner() * distance), direction: out })
    }
}
