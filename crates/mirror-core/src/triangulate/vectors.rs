//! The paper's measurement of many markers by the processor's vectors.

use crate::camera::FixedSteps;
use crate::geometry::SHORTEST_DIRECTION;
use multiversion::multiversion;

/// Markers of one pass: their numbers stay in the nearest cache.
const BLOCK: usize = 128;

/// One number of each marker of a pass.
type Lane = [f64; BLOCK];

/// Markers by Eq. 2 and the midpoint, compiled once for each width of the processor's vectors and chosen at run time; not numbers
/// where the result is not sure.
///
/// Numbers are sorted into lists first, so that the loop over markers, which has no branch, becomes vector instructions.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
pub(super) fn point_pairs(
    lens: &FixedSteps,
    board: &[f64; 3],
    boards: &[[f64; 6]],
    pixels: &[[f64; 4]],
    least_parallax_rad: f64,
    out: &mut [[f64; 3]],
) {
    let least_sine_squared = least_parallax_rad.sin().powi(2);
    let mut numbers: [Lane; 10] = [[0.0; BLOCK]; 10];
    let mut points: [Lane; 3] = [[0.0; BLOCK]; 3];
    let blocks = boards.chunks(BLOCK).zip(pixels.chunks(BLOCK)).zip(out.chunks_mut(BLOCK));
    for ((boards, pixels), out) in blocks {
        for (lane, (board, pixel)) in boards.iter().zip(pixels).enumerate() {
            for i in 0..6 {
                numbers[i][lane] = board[i];
            }
            for i in 0..4 {
                numbers[6 + i][lane] = pixel[i];
            }
        }
        let [ax, ay, az, bx, by, bz, au, av, bu, bv] = &numbers;
        let [x, y, z] = &mut points;
        for i in 0..BLOCK {
            let first = ray(lens, board, [ax[i], ay[i], az[i]], [au[i], av[i]]);
            let second = ray(lens, board, [bx[i], by[i], bz[i]], [bu[i], bv[i]]);
            [x[i], y[i], z[i]] = midpoint(&first, &second, least_sine_squared);
        }
        for (lane, out) in out.iter_mut().enumerate() {
            *out = [points[0][lane], points[1][lane], points[2][lane]];
        }
    }
}

/// A virtual ray, and whether it is sure.
struct Ray {
    origin: [f64; 3],
    direction: [f64; 3],
    sure: bool,
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a s + b`.
#[inline(always)]
fn along(a: [f64; 3], s: f64, b: [f64; 3]) -> [f64; 3] {
    [a[0] * s + b[0], a[1] * s + b[1], a[2] * s + b[2]]
}

/// The virtual ray by Eq. 2: origin `2 d n`, direction `(I − 2 n nᵀ) r`.
#[inline(always)]
fn ray(lens: &FixedSteps, board: &[f64; 3], reflected: [f64; 3], pixel: [f64; 2]) -> Ray {
    let across = along(*board, -1.0, reflected);
    let squared = dot(across, across);
    let length = squared.sqrt();
    let normal = along(across, 1.0 / length, [0.0; 3]);
    let ([x, y], exact) = lens.undistorted(pixel);
    let seen = along([x, y, 1.0], 1.0 / (x * x + y * y + 1.0).sqrt(), [0.0; 3]);
    Ray {
        origin: along(normal, dot(normal, along(*board, 1.0, reflected)), [0.0; 3]),
        direction: along(normal, -2.0 * dot(normal, seen), seen),
        sure: exact & (length > SHORTEST_DIRECTION) & (squared < f64::INFINITY),
    }
}

/// Whether a place along a virtual ray lies beyond its mirror, which it crosses at `t = |o|² / (−2 o·r)`.
#[inline(always)]
fn beyond_mirror(ray: &Ray, t: f64) -> bool {
    t * -2.0 * dot(ray.origin, ray.direction) > dot(ray.origin, ray.origin)
}

/// As `midpoint_of_two_virtual`.
#[inline(always)]
fn midpoint(a: &Ray, b: &Ray, least_sine_squared: f64) -> [f64; 3] {
    let between = along(a.origin, -1.0, b.origin);
    let normal = cross(a.direction, b.direction);
    let squared = dot(normal, normal);
    let up = 1.0 / squared;
    let t = dot(cross(between, b.direction), normal) * up;
    let s = dot(cross(between, a.direction), normal) * up;
    let [p, q] = [along(a.direction, t, a.origin), along(b.direction, s, b.origin)];
    let beyond = (t > 0.0) & (s > 0.0) & beyond_mirror(a, t) & beyond_mirror(b, s);
    let sure = a.sure & b.sure & (squared >= least_sine_squared) & (squared > 0.0) & beyond;
    let half = if sure { 0.5 } else { f64::NAN };
    [half * (p[0] + q[0]), half * (p[1] + q[1]), half * (p[2] + q[2])]
}
