//! Which pixels share a colour, estimated from the picture: a decoded video frame or JPEG that was stored without
//! loss no longer says so.
//!
//! Where a decoder has interpolated colour between samples two pixels apart, four neighbours across one sample's
//! place lie on two lines that meet there: their third difference vanishes, and that of the four neighbours one
//! pixel on does not. Where it has repeated the sample, neighbours of a pair are alike. In a picture whose colour
//! has full resolution both phases look the same.

use super::patch::Picture;

/// Every so many lines are read.
const STRIDE: usize = 3;
/// Four neighbours count where their colour changes by this, levels.
const LEAST_CHANGE: f32 = 14.0;
/// Least number of places that count, in each phase.
const LEAST_PLACES: f64 = 60.0;
/// A phase is distinguished from the other if its mean square is below this share of it.
const TELLING_SHARE: f64 = 0.3;

/// Mean squares by phase.
#[derive(Default)]
struct Phases {
    sum: [f64; 2],
    count: [f64; 2],
}

impl Phases {
    fn add(&mut self, phase: usize, value: f32) {
        self.sum[phase] += f64::from(value * value);
        self.count[phase] += 1.0;
    }

    /// Whether a phase's mean square is far below the other's.
    fn told(&self, low: usize) -> bool {
        let mean = |phase: usize| self.sum[phase] / self.count[phase].max(1.0);
        self.count[0] >= LEAST_PLACES
            && self.count[1] >= LEAST_PLACES
            && mean(low) < TELLING_SHARE * mean(1 - low)
    }
}

/// Pixels across and down that share a colour: 1 or 2 each; 1 where the picture does not determine it.
pub fn chroma_step(picture: &Picture<'_>) -> (usize, usize) {
    let (width, height) = (picture.width, picture.height);
    let across = lines_share(height, width, |line, place| colour_at(picture.row(line), place));
    let down = lines_share(width, height, |line, place| colour_at(picture.row(place), line));
    (if across { 2 } else { 1 }, if down { 2 } else { 1 })
}

/// Red and blue against the brightness, levels (ITU-R BT.601).
#[inline]
fn colour_at(row: &[u8], column: usize) -> [f32; 2] {
    let pixel = &row[3 * column..3 * column + 3];
    let [b, g, r] = [0, 1, 2].map(|c| f32::from(pixel[c]));
    [0.5 * r - 0.4187 * g - 0.0813 * b, 0.5 * b - 0.3313 * g - 0.1687 * r]
}

fn lines_share(lines: usize, places: usize, colour: impl Fn(usize, usize) -> [f32; 2]) -> bool {
    let (mut first, mut third) = (Phases::default(), Phases::default());
    // A line's colours first: most places change too little to count, which is decided for a whole line at once.
    let mut along = [vec![0.0f32; places], vec![0.0f32; places]];
    for line in (0..lines).step_by(STRIDE) {
        for place in 0..places {
            let [red, blue] = colour(line, place);
            (along[0][place], along[1][place]) = (red, blue);
        }
        for values in &along {
            for (begin, four) in values.windows(4).enumerate() {
                let (x0, x1, x2, x3) = (four[0], four[1], four[2], four[3]);
                let change = x0.max(x1).max(x2.max(x3)) - x0.min(x1).min(x2.min(x3));
                if change >= LEAST_CHANGE {
                    // By the parity of the first of the four; of the pair in the middle, which is the other.
                    let phase = begin % 2;
                    third.add(phase, x0 - 3.0 * x1 + 3.0 * x2 - x3);
                    first.add(phase, x2 - x1);
                }
            }
        }
    }
    // The samples' places lie between pixels 0 and 1, 2 and 3, ...: four neighbours around one begin at an odd pixel, and the pair in their middle is one sample's.
    third.told(1) || first.told(1)
}
