//! Mirrored light on coloured balls: white, and so told from the ball's own.
//!
//! A colour in light is `c = a B + w (1, 1, 1)`, B the ball's own, by least squares (`unmixing`). A lamp that a glossy ball mirrors
//! (Shafer, "Using color to separate reflection components", 1985) is brighter than the ball's light by its normal and has a large w; a lamp that lights a matt ball
//! has none. Left in, it is taken for the ball's light at the rim, and draws the edge.

use super::curve::light_of;
use super::sight::Sight;
use super::unmixing::Unmixing;
use crate::statistics::median;

/// White light from this share of the ball's mean channel on is mirrored, where it is brighter than the ball's light by the second.
const LEAST_WHITE: f64 = 0.05;
const LEAST_EXCESS: f64 = 1.06;
/// Balls that are nearly white themselves tell none: least squared sine of the angle between their colour and white.
const LEAST_COLOUR: f64 = 0.1;
/// Inward of this distance from the outline the brightness is the ball's alone, px. Nearer than the window its colour is mixed by the codec: there a glint goes on from
/// farther in, and ends before.
const CLEAR_PX: f64 = 1.75;
/// Fewer samples show no usual colour.
const LEAST_SAMPLES: usize = 8;

/// Whether a colour of a ball, in light, holds mirrored light; by the ball's own colour, None where that is nearly white.
fn mirrors_in(own: &[f64; 3]) -> Option<impl Fn(&[f64; 3]) -> bool + use<>> {
    let mixture = Unmixing::new(*own, [1.0; 3])?;
    let least = LEAST_WHITE * own.iter().sum::<f64>() / 3.0;
    (mixture.squared_sine() > LEAST_COLOUR)
        .then_some(move |colour: &[f64; 3]| mixture.parts(colour).1 > least)
}

/// The inner parts of rays in a coded picture without glints: there colour and brightness (levels) become the ball's usual ones in the light of its shading;
/// `shade`: that light by sample, ray by ray, 1 where it is typical.
pub(super) fn take_off_glints(sight: &Sight, shade: &[f64], colours: &mut [[f64; 3]], luma: &mut [f64]) {
    let samples = sight.offsets.len();
    let certain = |ray: usize| sight.between(f64::NEG_INFINITY, -sight.window_px[ray]);
    let clear = sight.between(f64::NEG_INFINITY, -CLEAR_PX);
    let places = || (0..sight.direction.len()).flat_map(|ray| certain(ray).map(move |i| ray * samples + i));
    let usual = |value: &dyn Fn(usize) -> f64| median(places().map(|at| value(at) / shade[at]).collect());
    if places().nth(LEAST_SAMPLES).is_none() {
        return;
    }
    let own: [f64; 3] = core::array::from_fn(|channel| usual(&|at| colours[at][channel]));
    let Some(mirrored) = mirrors_in(&own.map(light_of)) else { return };
    let usual_luma = usual(&|at| luma[at]);
    for ray in 0..sight.direction.len() {
        let own_alone = certain(ray).end;
        // Where the bright part reaches the outline it may be another thing before the ball.
        let mut begun = None;
        for i in clear.clone() {
            let at = ray * samples + i;
            let bright = luma[at] > usual_luma * shade[at] * LEAST_EXCESS;
            let glint =
                bright && if i < own_alone { mirrored(&colours[at].map(light_of)) } else { begun.is_some() };
            if glint {
                begun.get_or_insert(at);
            } else if let Some(first) = begun.take() {
                for glint in first..at {
                    luma[glint] = usual_luma * shade[glint];
                    colours[glint] = own.map(|level| level * shade[glint]);
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::mirrors_in;

    #[test]
    fn white_light_is_told_from_more_light_on_a_coloured_ball() {
        let own = [0.02, 0.05, 0.4];
        let mirrored = mirrors_in(&own).unwrap();
        assert!(!mirrored(&own.map(|c| 3.0 * c)));
        assert!(!mirrored(&own.map(|c| 0.2 * c)));
        assert!(mirrored(&own.map(|c| c + 0.02)));
        assert!(!mirrored(&own.map(|c| c + 0.004)));
        assert!(mirrors_in(&[0.4, 0.42, 0.41]).is_none());
        assert!(mirrors_in(&[0.0; 3]).is_none());
    }
}
