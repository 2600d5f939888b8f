//! The inverse of a lens of polynomials without a branch: loops over it become vector instructions.

use super::distorted::COEFFICIENTS;
use super::pinhole::{Camera, UNPROJECT_TOLERANCE};

/// A pinhole camera with a lens of polynomials, in the form of the batch kernels.
pub(crate) struct FixedSteps {
    by_focal: [f64; 2],
    center_px: [f64; 2],
    k: [f64; COEFFICIENTS],
    one_to_one_limit: f64,
}

/// Image coordinates, and where the lens puts them with the derivatives: `∂x_d/∂x`, `∂x_d/∂y = ∂y_d/∂x`, `∂y_d/∂y`.
struct Bent {
    of: [f64; 2],
    at: [f64; 2],
    by: [f64; 3],
}

/// `a + b s + c s²`.
#[inline(always)]
fn polynomial(s: f64, [a, b, c]: [f64; 3]) -> f64 {
    a + s * (b + s * c)
}

impl FixedSteps {
    /// None of a fisheye.
    pub fn new(camera: &Camera) -> Option<Self> {
        let (k, one_to_one_limit) = camera.polynomial_lens()?;
        let by_focal = camera.focal_px().map(|f| 1.0 / f).into();
        Some(Self { by_focal, center_px: camera.center_px().into(), k, one_to_one_limit })
    }

    /// The radial factor's numerator and denominator at `ρ²`.
    #[inline(always)]
    fn radial(&self, s: f64) -> (f64, f64) {
        let k = &self.k;
        (1.0 + s * polynomial(s, [k[0], k[1], k[4]]), 1.0 + s * polynomial(s, [k[5], k[6], k[7]]))
    }

    /// As `distort_with_point_jacobian`.
    #[inline(always)]
    fn bent(&self, x: f64, y: f64) -> Bent {
        let k = &self.k;
        let (xx, yy, xy) = (x * x, y * y, 2.0 * x * y);
        let s = xx + yy;
        let (numerator, denominator) = self.radial(s);
        let up = 1.0 / denominator;
        let c = numerator * up;
        let rising = polynomial(s, [k[0], 2.0 * k[1], 3.0 * k[4]]);
        let falling = polynomial(s, [k[5], 2.0 * k[6], 3.0 * k[7]]);
        let dc = (rising - c * falling) * up;
        let (p1, p2) = (k[2], k[3]);
        Bent {
            of: [x, y],
            at: [x * c + p1 * xy + p2 * (s + 2.0 * xx), y * c + p1 * (s + 2.0 * yy) + p2 * xy],
            by: [
                c + 2.0 * xx * dc + 2.0 * p1 * y + 6.0 * p2 * x,
                xy * dc + 2.0 * p1 * x + 2.0 * p2 * y,
                c + 2.0 * yy * dc + 6.0 * p1 * y + 2.0 * p2 * x,
            ],
        }
    }

    /// A Newton step towards `(u, v)`.
    #[inline(always)]
    fn newton(&self, from: Bent, u: f64, v: f64) -> Bent {
        let (du, dv) = (from.at[0] - u, from.at[1] - v);
        let [a, b, d] = from.by;
        let up = 1.0 / (a * d - b * b);
        self.bent(from.of[0] - (d * du - b * dv) * up, from.of[1] - (a * dv - b * du) * up)
    }

    /// Undistorted image coordinates of a pixel, and whether they are exact: where not, [`Camera::unproject`] has an answer or a
    /// reason.
    #[inline(always)]
    pub fn undistorted(&self, pixel: [f64; 2]) -> ([f64; 2], bool) {
        let u = (pixel[0] - self.center_px[0]) * self.by_focal[0];
        let v = (pixel[1] - self.center_px[1]) * self.by_focal[1];
        let squared = u * u + v * v;
        let (numerator, denominator) = self.radial(squared);
        let factor = denominator / numerator;
        let inside = (factor > 0.0) & (squared * factor * factor <= self.one_to_one_limit);
        let factor = if inside { factor } else { 1.0 };
        let start = self.bent(u * factor, v * factor);
        // Three are enough for all of a common lens's picture. A loop here would keep the loop over markers from being vectorised.
        let bent = self.newton(self.newton(self.newton(start, u, v), u, v), u, v);
        let [x, y] = bent.of;
        let [a, b, d] = bent.by;
        let off = (bent.at[0] - u).abs().max((bent.at[1] - v).abs());
        // Comparisons that NaN fails.
        let exact = (off <= UNPROJECT_TOLERANCE * (1.0 + u.abs().max(v.abs())))
            & (a * d - b * b > 0.0)
            & (x * x + y * y <= self.one_to_one_limit);
        ([x, y], exact)
    }
}
