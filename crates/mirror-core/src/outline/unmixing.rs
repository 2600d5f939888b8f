//! A colour as a mixture of two: the ball's and the background's.

/// A ray's unmixing requires that the two colours differ by this: sine of the angle between them.
const MIN_COLOUR_SINE: f64 = 0.12;
/// What lies behind counts as black below this share of the ball's light: it has no colour to unmix by.
const BLACK_SHARE: f64 = 0.03;

/// Parts of ball and background in a colour, or of the ball alone in front of black.
pub(super) struct Unmixing {
    ball: [f64; 3],
    behind: [f64; 3],
    bb: f64,
    bg: f64,
    gg: f64,
    pub black: bool,
    /// A colour's part of the ball is its product with the first, less a part; that of what lies behind its product with the second.
    rows: [[f64; 3]; 2],
    less: f64,
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Unmixing {
    pub fn new(ball: [f64; 3], behind: [f64; 3]) -> Option<Self> {
        let (bb, bg, gg) = (dot(&ball, &ball), dot(&ball, &behind), dot(&behind, &behind));
        let black = gg < BLACK_SHARE * BLACK_SHARE * bb;
        let telling = if black {
            bb > 1e-6
        } else {
            bb * gg - bg * bg > MIN_COLOUR_SINE * MIN_COLOUR_SINE * bb * gg + 1e-12
        };
        let (rows, less) = if black {
            let share = (bb - bg).recip();
            ([ball.map(|b| b * share), [0.0; 3]], bg * share)
        } else {
            let share = (bb * gg - bg * bg).recip();
            let row = |own: f64, one: &[f64; 3], other: &[f64; 3]| {
                core::array::from_fn(|c| (own * one[c] - bg * other[c]) * share)
            };
            ([row(gg, &ball, &behind), row(bb, &behind, &ball)], 0.0)
        };
        telling.then_some(Self { ball, behind, bb, bg, gg, black, rows, less })
    }

    /// Squared sine of the angle between the two colours.
    pub fn squared_sine(&self) -> f64 {
        1.0 - self.bg * self.bg / (self.bb * self.gg)
    }

    /// Noise of a colour as noise of the coverage `trust s + (1 − trust)(1 − w)`.
    pub fn contrast(&self, trust: f64) -> f64 {
        if self.black {
            return (self.bb - self.bg) / self.bb.sqrt();
        }
        let other = 1.0 - trust;
        let power = trust * trust * self.gg + other * other * self.bb + 2.0 * trust * other * self.bg;
        ((self.bb * self.gg - self.bg * self.bg) / power).sqrt()
    }

    /// The share of each channel in the coverage `trust s + (1 − trust)(1 − w)` between the two colours, together
    /// 1.
    pub fn channels(&self, trust: f64) -> [f64; 3] {
        let other = 1.0 - trust;
        let determinant = self.bb * self.gg - self.bg * self.bg;
        core::array::from_fn(|c| {
            let (b, g) = (self.ball[c], self.behind[c]);
            let by_level = if self.black {
                b / (self.bb - self.bg)
            } else {
                (trust * (self.gg * b - self.bg * g) - other * (self.bb * g - self.bg * b)) / determinant
            };
            by_level * (b - g)
        })
    }

    /// Parts of the ball and of what lies behind.
    #[inline]
    pub fn parts(&self, colour: &[f64; 3]) -> (f64, f64) {
        let own = dot(colour, &self.rows[0]) - self.less;
        (own, if self.black { 1.0 - own } else { dot(colour, &self.rows[1]) })
    }
}
