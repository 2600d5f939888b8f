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

use super::columns::{Columns, TERMS, weighted_sums};
use super::curve::light_of;
use super::patch::Patch;
use crate::statistics::median;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

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
/// Least brightness of a place on the ball.
const LEAST_BRIGHTNESS: f64 = 0.02;
/// What the model leaves of a ball's light, as a share of it (RMS): paint and noise leave the first of these under soft
/// light; where a lamp's light ends on the ball, the second is added (square by square), or more.
const USUAL_MISFIT: f64 = 0.02;
const LAMP_MISFIT: f64 = 0.04;
/// Least spread of pixels around the fit, as a share of the ball's light.
const LEAST_SPREAD: f64 = 0.02;

/// The brightness of a ball by the place on its disc; 1 is its typical one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shading {
    terms: SVector<f64, TERMS>,
    /// Towards the lamp; zeros without a separate term.
    lamp: Vector3<f64>,
    /// RMS of what the model leaves of the light, as a share of the light's; 0 where it was not fitted.
    misfit: f64,
}

/// The basis at a place on the disc (unit radius), the normal towards the camera where it lies within.
#[inline]
fn basis(x: f64, y: f64, lamp: &Vector3<f64>) -> [f64; TERMS] {
    let r2 = x * x + y * y;
    // Beyond the rim: as at the rim.
    let scale = if r2 > 1.0 { r2.sqrt().recip() } else { 1.0 };
    let (x, y) = (x * scale, y * scale);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let facing = (x * lamp.x + y * lamp.y + z * lamp.z).max(0.0);
    [1.0, x, y, z, x * y, x * z, y * z, x * x - y * y, 3.0 * z * z - 1.0, facing]
}

/// The arc tangent of 0..1 by odd powers, within 2e-8 (Abramowitz and Stegun, 4.4.49).
const ARC_TANGENT: [f64; 9] = [
    1.0,
    -0.333_331_452_8,
    0.199_935_508_5,
    -0.142_088_994_4,
    0.106_562_639_3,
    -0.075_289_640_0,
    0.042_909_613_8,
    -0.016_165_736_7,
    0.002_866_225_7,
];

/// The direction of a vector in turns, 0..1: which ray a pixel is nearest to needs no more digits.
#[inline]
fn turns(away: &Vector2<f64>) -> f64 {
    let (x, y) = (away.x.abs(), away.y.abs());
    let ratio = x.min(y) / x.max(y).max(f64::MIN_POSITIVE);
    let square = ratio * ratio;
    let series = ARC_TANGENT.iter().rev().fold(0.0, |sum, factor| sum * square + factor);
    let eighth = ratio * series / core::f64::consts::TAU;
    let quarter = if y > x { 0.25 - eighth } else { eighth };
    let half = if away.x < 0.0 { 0.5 - quarter } else { quarter };
    if away.y < 0.0 { 1.0 - half } else { half }
}

/// The pixels of a ball's inside, whatever their light: what a fit needs of its outline.
pub(super) struct Disc {
    pixels: Vec<DiscPixel>,
    /// Their basis; no light.
    columns: Columns,
}

#[derive(Clone, Copy)]
struct DiscPixel {
    index: usize,
    /// Whether its colour is the ball's alone.
    clear: bool,
}

impl Disc {
    /// Pixels of a patch so far from an outline, px; `radius_px` are the outline's distances from the centre in evenly spaced directions. Where the codec blurs the
    /// colours, the brightness is the ball's alone up to `luma_clear_px` from it.
    pub fn within(
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
        let reach = widest - least_clear;
        let (mut pixels, mut rows) = (Vec::new(), Vec::new());
        let [first_u, first_v] = patch.place(0, 0);
        let near = |first: f64, size: usize, middle: f64| {
            (0..size)
                .step_by(stride)
                .map(move |at| (at, first + at as f64 - middle))
                .filter(move |(_, away)| away.abs() <= reach)
        };
        for (row, down) in near(first_v, patch.height, center_px.y) {
            for (column, across) in near(first_u, patch.width, center_px.x) {
                let away = Vector2::new(across, down);
                let distance = away.norm();
                if distance > reach {
                    continue;
                }
                let ray = (turns(&away) * radius_px.len() as f64) as u32 as usize;
                let outline = radius_px[ray.min(radius_px.len() - 1)];
                if distance <= outline - least_clear {
                    let place = away / outline;
                    rows.push(basis(place.x, place.y, &Vector3::zeros()));
                    pixels.push(DiscPixel {
                        index: row * patch.width + column,
                        clear: distance <= outline - clear_px,
                    });
                }
            }
        }
        Self { columns: Columns::of(&rows), pixels }
    }
}

impl Shading {
    /// Even light.
    pub fn even() -> Self {
        let mut terms = SVector::zeros();
        terms[0] = 1.0;
        Self { terms, lamp: Vector3::zeros(), misfit: 0.0 }
    }

    /// Direction on the disc from which the ball is lit, times how much of a lamp's light the model does not hold, 0..1:
    /// that of the brightness' slope in the disc's middle, times `√((m² − m₀²) / m₁²)`, m the share of the light that is left.
    pub fn toward_lamp(&self) -> Vector2<f64> {
        let slope = Vector2::new(self.terms[1] + self.terms[5], self.terms[2] + self.terms[6]);
        let lamp = (self.misfit.powi(2) - USUAL_MISFIT.powi(2)) / LAMP_MISFIT.powi(2);
        slope.try_normalize(1e-9).unwrap_or_else(Vector2::zeros) * lamp.clamp(0.0, 1.0).sqrt()
    }

    /// Linear brightness along a line from the disc's middle, by the distance in radii: the basis is there a polynomial in the distance and in the normal's
    /// component along the view, and a ball is read at some hundred places on each of its rays.
    #[inline]
    pub fn along(&self, direction: Vector2<f64>) -> impl Fn(f64) -> f64 + use<> {
        let (x, y) = (direction.x, direction.y);
        let [even, by_x, by_y, by_z, by_xy, by_xz, by_yz, by_squares, by_height, by_lamp] = self.terms.into();
        let first = by_x * x + by_y * y;
        let leaning = by_xz * x + by_yz * y;
        let second = by_xy * x * y + by_squares * (x * x - y * y);
        let (toward, facing) = (self.lamp.x * x + self.lamp.y * y, self.lamp.z);
        move |distance| {
            // Beyond the rim: as at the rim.
            let way = distance.clamp(-1.0, 1.0);
            let z2 = 1.0 - way * way;
            let z = z2.sqrt();
            let lit = (way * toward + z * facing).max(0.0);
            let sum = even
                + way * (first + way * second)
                + z * (by_z + way * leaning)
                + by_height * (3.0 * z2 - 1.0)
                + by_lamp * lit;
            sum.max(LEAST_BRIGHTNESS)
        }
    }

    /// Fits the light on a ball's inside; constant light where too little is visible.
    ///
    /// Where the codec blurs the colours, the brightness of a uniformly painted ball gives its light.
    pub fn fit(patch: &Patch, disc: &Disc) -> Self {
        let colour_of = |pixel: &DiscPixel| {
            let light = |v: f32| if patch.coded { light_of(f64::from(v)) } else { f64::from(v) };
            let [blue, green, red, _] = patch.pixels[pixel.index];
            [blue, green, red].map(light)
        };
        let clear = || disc.pixels.iter().enumerate().filter(|(_, pixel)| pixel.clear);
        // Of the others only the brightness counts.
        let inner: Vec<(usize, [f64; 3])> = clear().map(|(at, pixel)| (at, colour_of(pixel))).collect();
        if inner.len() < TERMS - 1 {
            return Self::even();
        }
        let typical: [f64; 3] =
            core::array::from_fn(|channel| median(inner.iter().map(|(_, colour)| colour[channel]).collect()));
        let power: f64 = typical.iter().map(|c| c * c).sum();
        if !(power > 1e-8) {
            return Self::even();
        }
        let own_colour = |colour: &[f64; 3]| {
            let along: f64 = colour.iter().zip(&typical).map(|(a, b)| a * b).sum();
            let own: f64 = colour.iter().map(|c| c * c).sum();
            1.0 - along * along / (own * power).max(1e-18) <= OTHER_COLOUR_SINE * OTHER_COLOUR_SINE
        };
        let brightness: Vec<f64> = if patch.coded {
            disc.pixels.iter().map(|pixel| light_of(f64::from(patch.pixels[pixel.index][3]))).collect()
        } else {
            Vec::new()
        };
        let typical_light =
            if patch.coded { median(inner.iter().map(|(at, _)| brightness[*at]).collect()) } else { 0.0 };
        // Colours near the outline are mixed by the codec: there only the brightness is used, and outliers have
        // less weight.
        let mut kept: Vec<bool> = disc.pixels.iter().map(|pixel| !pixel.clear).collect();
        for (at, colour) in &inner {
            kept[*at] = own_colour(colour);
        }
        let kept: Vec<usize> = (0..kept.len()).filter(|at| kept[*at]).collect();
        let light = kept.iter().map(|at| {
            if typical_light > 1e-6 {
                brightness[*at] / typical_light
            } else {
                let colour = colour_of(&disc.pixels[*at]);
                colour.iter().zip(&typical).map(|(a, b)| a * b).sum::<f64>() / power
            }
        });
        let mut columns = disc.columns.lit(&kept, light);
        if columns.count < TERMS - 1 {
            return Self::even();
        }
        Self::solved(&mut columns, patch.coded).unwrap_or_else(Self::even)
    }

    /// From the basis and the light by pixel; in `levels`, with the lamp's own term.
    fn solved(pixels: &mut Columns, levels: bool) -> Option<Self> {
        let share = |light: &f64| if levels { light.max(LEAST_LIGHT).recip() } else { 1.0 };
        let shares: Vec<f64> = pixels.light().iter().map(share).collect();
        let mut weights = shares.clone();
        let mut sizes = Vec::with_capacity(pixels.count);
        let mut found = Self { terms: SVector::zeros(), lamp: Vector3::zeros(), misfit: 0.0 };
        for round in 0..REWEIGHTINGS {
            if levels && round + WITH_LAMP == REWEIGHTINGS {
                let slope = Vector3::new(found.terms[1], found.terms[2], found.terms[3]);
                if slope.norm() > LEAST_SLOPE {
                    found.lamp = slope.normalize();
                    for pixel in 0..pixels.count {
                        let [x, y, z] = [1, 2, 3].map(|term| pixels.columns[term][pixel]);
                        pixels.columns[LAMP][pixel] = found.lamp.dot(&Vector3::new(x, y, z)).max(0.0);
                    }
                }
            }
            let total: f64 = weights.iter().sum();
            let sums = weighted_sums(&pixels.columns, &weights);
            let mut normal = SMatrix::<f64, TERMS, TERMS>::from_fn(|i, j| sums[i.min(j)][i.max(j)]);
            let right = SVector::<f64, TERMS>::from_fn(|i, _| sums[i][TERMS]);
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
            if round + 1 == REWEIGHTINGS {
                break;
            }
            // Squares of the residuals in their deviations: the root of their median is the median of their roots.
            let rest = pixels.rest(&found.terms);
            let squares: Vec<f64> =
                rest.iter().zip(&shares).map(|(left, share)| left * left * share).collect();
            sizes.clone_from(&squares);
            let middle = sizes.len() / 2;
            let spread = sizes.select_nth_unstable_by(middle, f64::total_cmp).1.sqrt();
            let variance = (3.0 * spread).max(LEAST_SPREAD).powi(2);
            for ((weight, square), share) in weights.iter_mut().zip(&squares).zip(&shares) {
                *weight = share / (1.0 + square / variance).powi(2);
            }
        }
        let rest = pixels.rest(&found.terms);
        let power: f64 = pixels.light().iter().map(|light| light * light).sum();
        found.misfit = (rest.iter().map(|left| left * left).sum::<f64>() / power.max(1e-9)).sqrt();
        found.terms.iter().all(|t| t.is_finite()).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::turns;
    use nalgebra::Vector2;

    #[test]
    fn turns_are_the_arc_tangent_all_round() {
        for i in 0..720 {
            let wanted = (f64::from(i) + 0.37) / 720.0;
            let (sine, cosine) = (core::f64::consts::TAU * wanted).sin_cos();
            assert!((turns(&(Vector2::new(cosine, sine) * 7.0)) - wanted).abs() < 1e-8, "{wanted}");
        }
        assert!(turns(&Vector2::zeros()) == 0.0);
    }
}
