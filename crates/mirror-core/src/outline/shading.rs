//! Light on a sphere as a function of its normal, up to the ball's rim.
//!
//! Under any distant light a matt sphere's brightness is a quadratic in its normal, to a few hundredths: nine
//! spherical harmonics (Ramamoorthi and Hanrahan, "On the relationship between radiance and irradiance", 2001).
//! Towards the rim the normal's component along the view falls as the root of the distance from the rim, so a
//! straight line cannot extrapolate it.
//!
//! Where a lamp's light ends on the ball, brightness has a bend that the quadratic smooths: it falls below the true
//! value, and a codec's levels, which stretch dark values, show that. There the lamp has a separate term, `max(0, n
//! · l)`, in the direction in which the quadratic is steepest.

use super::curve::light_of;
use super::patch::Patch;
use crate::statistics::median;
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

const TERMS: usize = 10;
const LANES: usize = 16;
/// The lamp's own term.
const LAMP: usize = TERMS - 1;
/// Regularisation of each order of harmonics and of the lamp's term, as a share of the weight of the pixels: small
/// balls show few orders. Hardly any on the first order: the decrease of a lamp's light towards the rim must be
/// extrapolated fully.
const RIDGE: [f64; 4] = [1e-9, 2e-4, 2e-2, 1e-4];
/// Pixels of another colour than the ball's (sine of the angle between them) are not used for its light.
const OTHER_COLOUR_SINE: f64 = 0.3;
/// The most pixels that are read.
const MOST_PIXELS: usize = 900;
const REWEIGHTINGS: usize = 4;
/// Those of them that are with the lamp's own term, and the least slope towards it.
const WITH_LAMP: usize = 2;
const LEAST_SLOPE: f64 = 0.05;
/// In levels an error of light counts relatively: pixels have the inverse of their light as weight, of no less than
/// this.
const LEAST_LIGHT: f64 = 0.15;
/// Least spread of pixels around the fit, as a share of the ball's light.
const LEAST_SPREAD: f64 = 0.02;

/// The brightness of a ball by the place on its disc; 1 is its typical one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shading {
    terms: SVector<f64, TERMS>,
    /// Towards the lamp; zeros without a separate term.
    lamp: Vector3<f64>,
}

/// The basis at a place on the disc (unit radius), the normal towards the camera where it lies within.
fn basis(x: f64, y: f64, lamp: &Vector3<f64>) -> SVector<f64, TERMS> {
    let r2 = x * x + y * y;
    // Beyond the rim: as at the rim.
    let scale = if r2 > 1.0 { r2.sqrt().recip() } else { 1.0 };
    let (x, y) = (x * scale, y * scale);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let facing = (x * lamp.x + y * lamp.y + z * lamp.z).max(0.0);
    SVector::from([1.0, x, y, z, x * y, x * z, y * z, x * x - y * y, 3.0 * z * z - 1.0, facing])
}

/// `Σ w r rᵀ` by rows, and `Σ w v r` as the last one; filled up to whole vectors of the processor.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn weighted_sums(rows: &[(SVector<f64, TERMS>, f64)], weights: &[f64]) -> [[f64; LANES]; TERMS + 1] {
    let mut sums = [[0.0; LANES]; TERMS + 1];
    for ((row, value), weight) in rows.iter().zip(weights) {
        let mut weighted = [0.0; LANES];
        for (to, term) in weighted.iter_mut().zip(row.iter()) {
            *to = weight * term;
        }
        for (sum, share) in sums.iter_mut().zip(row.iter().chain([value])) {
            for (to, term) in sum.iter_mut().zip(&weighted) {
                *to += share * term;
            }
        }
    }
    sums
}

impl Shading {
    /// Even light.
    pub fn even() -> Self {
        let mut terms = SVector::zeros();
        terms[0] = 1.0;
        Self { terms, lamp: Vector3::zeros() }
    }

    /// Linear brightness at a place on the disc of unit radius.
    #[inline]
    pub fn at(&self, place: Vector2<f64>) -> f64 {
        self.terms.dot(&basis(place.x, place.y, &self.lamp)).max(0.02)
    }

    /// Fits the light on a ball's inside, `clear_px` from its outline; constant light where too little is visible.
    ///
    /// `radius_px` are the outline's distances from the centre in evenly spaced directions. Where the codec blurs
    /// the colours, the brightness of a uniformly painted ball gives its light up to `luma_clear_px` from the
    /// outline.
    pub fn fit(
        patch: &Patch,
        center_px: Vector2<f64>,
        radius_px: &[f64],
        clear_px: f64,
        luma_clear_px: f64,
    ) -> Self {
        let widest = radius_px.iter().copied().fold(0.0, f64::max);
        let area = core::f64::consts::PI * widest * widest;
        let stride = ((area / MOST_PIXELS as f64).sqrt().floor() as usize).max(1);
        let least_clear = if patch.coded { luma_clear_px.min(clear_px) } else { clear_px };
        let mut pixels = Vec::new();
        for row in (0..patch.height).step_by(stride) {
            for column in (0..patch.width).step_by(stride) {
                let [u, v] = patch.place(column, row);
                let away = Vector2::new(u, v) - center_px;
                let distance = away.norm();
                if distance > widest - least_clear {
                    continue;
                }
                let turn = away.y.atan2(away.x).rem_euclid(core::f64::consts::TAU) / core::f64::consts::TAU;
                let outline = radius_px[(turn * radius_px.len() as f64) as usize % radius_px.len()];
                if distance <= outline - least_clear {
                    let index = row * patch.width + column;
                    let colour = patch.light[index].map(|v| {
                        let v = f64::from(v);
                        if patch.coded { light_of(v) } else { v }
                    });
                    pixels.push((away / outline, colour, index, distance <= outline - clear_px));
                }
            }
        }
        let inner = || pixels.iter().filter(|p| p.3);
        if inner().count() < TERMS - 1 {
            return Self::even();
        }
        let typical: [f64; 3] =
            core::array::from_fn(|channel| median(inner().map(|p| p.1[channel]).collect()));
        let power: f64 = typical.iter().map(|c| c * c).sum();
        if !(power > 1e-8) {
            return Self::even();
        }
        let own_colour = |colour: &[f64; 3]| {
            let along: f64 = colour.iter().zip(&typical).map(|(a, b)| a * b).sum();
            let own: f64 = colour.iter().map(|c| c * c).sum();
            1.0 - along * along / (own * power).max(1e-18) <= OTHER_COLOUR_SINE * OTHER_COLOUR_SINE
        };
        let brightness = |index: usize| light_of(f64::from(patch.luma[index]));
        let typical_light =
            if patch.coded { median(inner().map(|p| brightness(p.2)).collect()) } else { 0.0 };
        // Colours near the outline are mixed by the codec: there only the brightness is used, and outliers have
        // less weight.
        let mut rows: Vec<_> = pixels
            .iter()
            .filter(|(_, colour, _, clear)| !clear || own_colour(colour))
            .map(|(place, colour, index, _)| {
                let value = if typical_light > 1e-6 {
                    brightness(*index) / typical_light
                } else {
                    colour.iter().zip(&typical).map(|(a, b)| a * b).sum::<f64>() / power
                };
                (basis(place.x, place.y, &Vector3::zeros()), value)
            })
            .collect();
        if rows.len() < TERMS - 1 {
            return Self::even();
        }
        Self::solved(&mut rows, patch.coded).unwrap_or_else(Self::even)
    }

    /// From rows of the basis and the light there; in `levels`, with the lamp's own term.
    fn solved(rows: &mut [(SVector<f64, TERMS>, f64)], levels: bool) -> Option<Self> {
        let share = |value: f64| if levels { value.max(LEAST_LIGHT).recip() } else { 1.0 };
        let mut weights: Vec<f64> = rows.iter().map(|(_, value)| share(*value)).collect();
        let mut found = Self { terms: SVector::zeros(), lamp: Vector3::zeros() };
        for round in 0..REWEIGHTINGS {
            if levels && round + WITH_LAMP == REWEIGHTINGS {
                let slope = Vector3::new(found.terms[1], found.terms[2], found.terms[3]);
                if slope.norm() > LEAST_SLOPE {
                    found.lamp = slope.normalize();
                    for (row, _) in rows.iter_mut() {
                        row[LAMP] = found.lamp.dot(&row.fixed_rows::<3>(1)).max(0.0);
                    }
                }
            }
            let total: f64 = weights.iter().sum();
            let sums = weighted_sums(rows, &weights);
            let mut normal = SMatrix::<f64, TERMS, TERMS>::from_fn(|i, j| sums[i][j]);
            let right = SVector::<f64, TERMS>::from_fn(|i, _| sums[TERMS][i]);
            for term in 0..TERMS {
                let order = match term {
                    0 => 0,
                    1..=3 => 1,
                    LAMP => 3,
                    _ => 2,
                };
                normal[(term, term)] += RIDGE[order] * total;
            }
            found.terms = normal.cholesky()?.solve(&right);
            let away: Vec<f64> = rows
                .iter()
                .map(|(row, value)| (value - found.terms.dot(row)) * share(*value).sqrt())
                .collect();
            let mut sizes: Vec<f64> = away.iter().map(|a| a.abs()).collect();
            let middle = sizes.len() / 2;
            let spread = (3.0 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1).max(LEAST_SPREAD);
            for ((weight, away), (_, value)) in weights.iter_mut().zip(&away).zip(rows.iter()) {
                *weight = share(*value) / (1.0 + (away / spread).powi(2)).powi(2);
            }
        }
        found.terms.iter().all(|t| t.is_finite()).then_some(found)
    }
}
