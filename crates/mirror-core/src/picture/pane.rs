//! The mirror as a pane of glass: the paths that light takes through it.

use super::Beam;
use crate::error::{Error, Result, finite, positive};
use nalgebra::Vector3;

/// What a mirror is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct PaneOptions {
    /// Thickness of the glass before the silver, m; 0 is a front-surface mirror.
    pub glass_thickness_m: f64,
    /// Refractive index of the glass.
    pub refractive_index: f64,
    /// Curvature of the front face at the mirror's centre, 1/m; positive is concave as the camera sees it.
    pub curvature_per_m: f64,
    /// Share of the light that the silver returns.
    pub silver_reflectance: f64,
    /// Whether the weak second images (front face, double reflection) are drawn.
    pub ghosts: bool,
    /// Width of the mirror, m.
    pub width_m: f64,
    /// Height of the mirror, m.
    pub height_m: f64,
}

impl Default for PaneOptions {
    /// A household mirror: 3 mm of float glass (n = 1.52), silvered at its back, 420 by 360 mm.
    fn default() -> Self {
        Self {
            glass_thickness_m: 0.003,
            refractive_index: 1.52,
            curvature_per_m: 0.0,
            silver_reflectance: 0.92,
            ghosts: true,
            width_m: 0.42,
            height_m: 0.36,
        }
    }
}

/// A pane of glass, silvered at its back.
///
/// Front face and silver are concentric: planes, or spheres about one centre. A face is
/// `n·w + κ/2 |w|² = 0` with `w = x − apex`: a plane at κ = 0, without a special case.
#[derive(Debug, Clone)]
pub struct Pane {
    front: Face,
    silver: Face,
    across: Vector3<f64>,
    up: Vector3<f64>,
    options: PaneOptions,
}

#[derive(Debug, Clone, Copy)]
struct Face {
    apex: Vector3<f64>,
    normal: Vector3<f64>,
    curvature: f64,
}

/// One path through the pane: where the light continues, and how much of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanePath {
    /// The beam that leaves the mirror.
    pub beam: Beam,
    /// Share of the light, 0 to 1.
    pub share: f64,
}

impl Face {
    /// First meeting of a beam with the face: `a t² + b t + c = 0`, in the form that is stable for small a.
    #[inline]
    fn meet(&self, beam: &Beam) -> Option<(f64, Vector3<f64>)> {
        let w = beam.from - self.apex;
        let a = self.curvature / 2.0;
        let b = self.normal.dot(&beam.along) + self.curvature * w.dot(&beam.along);
        let c = self.normal.dot(&w) + self.curvature / 2.0 * w.norm_squared();
        let root = (b * b - 4.0 * a * c).sqrt();
        let t = -2.0 * c / (b + root.copysign(b));
        // NaN (the beam misses a curved face) and a face behind are both no meeting.
        (t > 1e-9).then(|| (t, beam.from + beam.along * t))
    }

    #[inline]
    fn normal_at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        (self.normal + (point - self.apex) * self.curvature).normalize()
    }
}

#[inline]
fn bounce(along: &Vector3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
    along - normal * (2.0 * along.dot(normal))
}

/// Snell's law in vectors, and Fresnel's reflectance of unpolarised light. `ratio` is the index that the light comes
/// from over the index that it enters. Nothing at total reflection.
#[inline]
fn refract(along: &Vector3<f64>, normal: &Vector3<f64>, ratio: f64) -> Option<(Vector3<f64>, f64)> {
    let facing = if along.dot(normal) < 0.0 { -normal } else { *normal };
    let cos_in = along.dot(&facing);
    let sin2_out = ratio * ratio * (1.0 - cos_in * cos_in);
    if sin2_out >= 1.0 {
        return None;
    }
    let cos_out = (1.0 - sin2_out).sqrt();
    let onward = along * ratio + facing * (cos_out - ratio * cos_in);
    let s = (ratio * cos_in - cos_out) / (ratio * cos_in + cos_out);
    let p = (cos_in - ratio * cos_out) / (cos_in + ratio * cos_out);
    Some((onward.normalize(), (s * s + p * p) / 2.0))
}

impl Pane {
    /// A mirror whose front face has this centre (m) and normal (from the viewer to the mirror), with the upper edge
    /// towards `up`; all in the scene's frame.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfRange`] for invalid sizes and shares, [`Error::NoDirection`] for a
    /// zero normal or one along `up`.
    pub fn new(
        center: Vector3<f64>,
        normal: Vector3<f64>,
        up: Vector3<f64>,
        options: PaneOptions,
    ) -> Result<Self> {
        for value in center.iter().chain(normal.iter()).chain(up.iter()) {
            finite("mirror centre, normal and up", *value)?;
        }
        positive("mirror width (m)", options.width_m)?;
        positive("mirror height (m)", options.height_m)?;
        finite("mirror curvature (1/m)", options.curvature_per_m)?;
        let in_range = |what: &str, got: f64, low: f64, high: f64| {
            if got >= low && got <= high {
                return Ok(());
            }
            Err(Error::OutOfRange { what: what.into(), got, needed: format!("{low} to {high}") })
        };
        in_range("glass thickness (m)", options.glass_thickness_m, 0.0, 0.05)?;
        in_range("refractive index of the glass", options.refractive_index, 1.0, 3.0)?;
        in_range("reflectance of the silver", options.silver_reflectance, 0.0, 1.0)?;
        let direction = |what: &str, v: Vector3<f64>| {
            v.try_normalize(1e-9).ok_or(Error::NoDirection { what: what.into(), length: v.norm() })
        };
        let normal = direction("mirror normal", normal)?;
        let up = direction("mirror's upward direction across its normal", up - normal * up.dot(&normal))?;
        let thickness = options.glass_thickness_m;
        let curvature = options.curvature_per_m;
        let front = Face { apex: center, normal, curvature };
        let silver = Face {
            apex: center + normal * thickness,
            normal,
            curvature: curvature / (1.0 + curvature * thickness),
        };
        Ok(Self { front, silver, across: up.cross(&normal), up, options })
    }

    /// What it is made of.
    pub fn options(&self) -> &PaneOptions {
        &self.options
    }

    /// Centre of the front face, m.
    pub fn center(&self) -> Vector3<f64> {
        self.front.apex
    }

    /// Unit normal at the centre, from the viewer to the mirror.
    pub fn normal(&self) -> Vector3<f64> {
        self.front.normal
    }

    /// Unit directions of the mirror's width and height.
    pub fn edges(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.across, self.up)
    }

    /// Distance along the beam to the mirror's front face; nothing where it misses the mirror or comes from behind.
    #[inline]
    pub fn distance_m(&self, beam: &Beam) -> Option<f64> {
        let (t, at) = self.front.meet(beam)?;
        if beam.along.dot(&self.front.normal_at(&at)) <= 0.0 {
            return None;
        }
        let w = at - self.front.apex;
        let inside = w.dot(&self.across).abs() <= self.options.width_m / 2.0
            && w.dot(&self.up).abs() <= self.options.height_m / 2.0;
        inside.then_some(t)
    }

    /// The strongest way through the mirror: by the silver. It does not stop at the mirror's edges.
    #[inline]
    pub fn main_path(&self, beam: &Beam) -> Option<PanePath> {
        let (_, entry) = self.front.meet(beam)?;
        let normal = self.front.normal_at(&entry);
        if self.options.glass_thickness_m == 0.0 {
            let out = Beam { from: entry, along: bounce(&beam.along, &normal) };
            return Some(PanePath { beam: out, share: self.options.silver_reflectance });
        }
        let (inward, lost) = refract(&beam.along, &normal, 1.0 / self.options.refractive_index)?;
        let inside = self.off_silver(&Beam { from: entry, along: inward })?;
        let (out, lost_again) = self.leave(&inside)?;
        let share = (1.0 - lost) * self.options.silver_reflectance * (1.0 - lost_again);
        Some(PanePath { beam: out, share })
    }

    /// The two strongest ghosts: off the front face, and twice off the silver.
    pub fn ghosts(&self, beam: &Beam) -> [Option<PanePath>; 2] {
        if !self.options.ghosts || self.options.glass_thickness_m == 0.0 {
            return [None, None];
        }
        let Some((_, entry)) = self.front.meet(beam) else { return [None, None] };
        let normal = self.front.normal_at(&entry);
        let Some((inward, lost)) = refract(&beam.along, &normal, 1.0 / self.options.refractive_index) else {
            return [None, None];
        };
        let first = PanePath { beam: Beam { from: entry, along: bounce(&beam.along, &normal) }, share: lost };
        let rho = self.options.silver_reflectance;
        let second = self.off_silver(&Beam { from: entry, along: inward }).and_then(|inside| {
            let (_, at) = self.front.meet(&inside)?;
            let (_, kept) = self.leave(&inside)?;
            let back = Beam { from: at, along: bounce(&inside.along, &self.front.normal_at(&at)) };
            let (out, lost_again) = self.leave(&self.off_silver(&back)?)?;
            Some(PanePath { beam: out, share: (1.0 - lost) * rho * kept * rho * (1.0 - lost_again) })
        });
        [Some(first), second]
    }

    /// The beam inside the glass after the silver.
    #[inline]
    fn off_silver(&self, inside: &Beam) -> Option<Beam> {
        let (_, at) = self.silver.meet(inside)?;
        Some(Beam { from: at, along: bounce(&inside.along, &self.silver.normal_at(&at)) })
    }

    /// The beam outside after the front face, and the share that the face throws back.
    #[inline]
    fn leave(&self, inside: &Beam) -> Option<(Beam, f64)> {
        let (_, at) = self.front.meet(inside)?;
        let (along, lost) =
            refract(&inside.along, &self.front.normal_at(&at), self.options.refractive_index)?;
        Some((Beam { from: at, along }, lost))
    }
}
