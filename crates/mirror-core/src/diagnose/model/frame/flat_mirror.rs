//! Points in a flat front-surface mirror, through a polynomial lens, many at a time: the case of nearly every board.
//!
//! The equations are those of [`super::sight`]: `q = p + 2 (1 − f·p/f²) f`, then the lens. They are written for one
//! point without a branch, in loops over [`LANES`] points, so that they run in vector registers; a test compares
//! them with the general optics.

use super::pictures::{COLUMNS, OF_OPTICS, OF_PLANE, Pictures};
use super::products::LANES;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::principles::Guard;
use multiversion::multiversion;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Points nearer than this to the camera's plane (m) are not projected, nor any that are farther than numbers go.
const NEAREST_DEPTH_M: Guard = 1e-6;
const FARTHEST_DEPTH_M: Guard = 1e150;

/// Points and their pixels, each a list whose length is a multiple of [`LANES`]; entries after the last point are
/// ignored.
#[derive(Debug, Default)]
pub(super) struct Points {
    /// In the camera's frame, m.
    xyz: [Vec<f64>; 3],
    /// Seen at, px.
    uv: [Vec<f64>; 2],
    /// 1, or 0 behind the last.
    real: Vec<f64>,
    count: usize,
}

impl Points {
    pub fn clear(&mut self) {
        let Self { xyz, uv, real, count } = self;
        xyz.iter_mut().chain(uv).chain([real]).for_each(Vec::clear);
        *count = 0;
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn push(&mut self, point: &Vector3<f64>, pixel: &Vector2<f64>) {
        self.count += 1;
        self.append(point, pixel, 1.0);
    }

    fn append(&mut self, point: &Vector3<f64>, pixel: &Vector2<f64>, real: f64) {
        self.xyz.iter_mut().zip(point.iter()).for_each(|(list, x)| list.push(*x));
        self.uv.iter_mut().zip(pixel.iter()).for_each(|(list, x)| list.push(*x));
        self.real.push(real);
    }

    /// Fills the last lanes with the last point, which counts nothing there.
    pub fn fill_up(&mut self) {
        let Some(last) = self.count.checked_sub(1) else { return };
        let point = Vector3::new(self.xyz[0][last], self.xyz[1][last], self.xyz[2][last]);
        let pixel = Vector2::new(self.uv[0][last], self.uv[1][last]);
        while !self.real.len().is_multiple_of(LANES) {
            self.append(&point, &pixel, 0.0);
        }
    }
}

/// A flat front-surface mirror and the camera before it.
pub(super) struct FlatMirror {
    foot: [f64; 3],
    square: f64,
    distance: f64,
    k: [f64; 8],
    focal: [f64; 2],
    center: [f64; 2],
    nominal_focal: [f64; 2],
    /// The square of the largest distance from the axis at which the lens is one-to-one.
    limit: f64,
    index_squared: f64,
}

/// A point's picture and its derivatives.
struct Seen {
    ok: bool,
    pixel: [f64; 2],
    /// A row each.
    by_point: [[f64; 3]; 2],
    by_foot: [[f64; 3]; 2],
    /// The distorted point, and how it moves with k1.
    distorted: [f64; 2],
    by_k1: [f64; 2],
    /// The picture as the reflected point moves along f, by one f.
    along: [f64; 2],
    /// `f·p / f²`.
    share: f64,
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `scale a − share b`.
#[inline(always)]
fn less(a: &[f64; 3], scale: f64, share: f64, b: &[f64; 3]) -> [f64; 3] {
    [scale * a[0] - share * b[0], scale * a[1] - share * b[1], scale * a[2] - share * b[2]]
}

impl FlatMirror {
    /// None for mirrors of glass, curved mirrors, fisheyes, or with free-form errors of the optics.
    pub fn of(eye: &Eye, foot: &Vector3<f64>) -> Option<Self> {
        let (k, limit) = eye.camera.polynomial_lens()?;
        if !eye.mirror.is_ideal() || eye.free.is_some() {
            return None;
        }
        let pair = |v: Vector2<f64>| [v.x, v.y];
        Some(Self {
            foot: [foot.x, foot.y, foot.z],
            square: foot.norm_squared(),
            distance: foot.norm(),
            k,
            focal: pair(eye.camera.focal_px()),
            center: pair(eye.camera.center_px()),
            nominal_focal: pair(eye.nominal_focal),
            limit,
            index_squared: eye.mirror.pane.refractive_index().powi(2),
        })
    }

    #[inline(always)]
    fn seen(&self, p: [f64; 3]) -> Seen {
        let (f, k) = (&self.foot, &self.k);
        let share = (f[0] * p[0] + f[1] * p[1] + f[2] * p[2]) / self.square;
        let twice = 2.0 * (1.0 - share);
        let q = [p[0] + twice * f[0], p[1] + twice * f[1], p[2] + twice * f[2]];
        let (x, y) = (q[0] / q[2], q[1] / q[2]);
        let s = x * x + y * y;
        let ok = (share < 1.0) & (q[2] > NEAREST_DEPTH_M) & (q[2] < FARTHEST_DEPTH_M) & (s <= self.limit);
        let up = 1.0 / (1.0 + s * (k[5] + s * (k[6] + s * k[7])));
        let c = (1.0 + s * (k[0] + s * (k[1] + s * k[4]))) * up;
        let dc = ((k[0] + s * (2.0 * k[1] + s * 3.0 * k[4]))
            - c * (k[5] + s * (2.0 * k[6] + s * 3.0 * k[7])))
            * up;
        let (p1, p2) = (k[2], k[3]);
        let xy = 2.0 * x * y;
        let distorted = [x * c + p1 * xy + p2 * (s + 2.0 * x * x), y * c + p1 * (s + 2.0 * y * y) + p2 * xy];
        let cross = xy * dc + 2.0 * p1 * x + 2.0 * p2 * y;
        let own = [
            c + 2.0 * x * x * dc + 2.0 * p1 * y + 6.0 * p2 * x,
            c + 2.0 * y * y * dc + 6.0 * p1 * y + 2.0 * p2 * x,
        ];
        let (fx, fy) = (self.focal[0] / q[2], self.focal[1] / q[2]);
        let (a, b) = ([fx * own[0], fx * cross], [fy * cross, fy * own[1]]);
        let by_seen = [[a[0], a[1], -(a[0] * x + a[1] * y)], [b[0], b[1], -(b[0] * x + b[1] * y)]];
        let along = [dot(&by_seen[0], f), dot(&by_seen[1], f)];
        let inverse = 2.0 / self.square;
        let behind = 2.0 * share;
        let shift = [
            (p[0] - behind * f[0]) * inverse,
            (p[1] - behind * f[1]) * inverse,
            (p[2] - behind * f[2]) * inverse,
        ];
        let turned = [f[0] * inverse, f[1] * inverse, f[2] * inverse];
        Seen {
            ok,
            pixel: [
                self.focal[0] * distorted[0] + self.center[0],
                self.focal[1] * distorted[1] + self.center[1],
            ],
            by_point: [less(&by_seen[0], 1.0, along[0], &turned), less(&by_seen[1], 1.0, along[1], &turned)],
            by_foot: [less(&by_seen[0], twice, along[0], &shift), less(&by_seen[1], twice, along[1], &shift)],
            distorted,
            by_k1: [x * s * up, y * s * up],
            along,
            share,
        }
    }

    /// How far along f the reflected point is moved by a pane's thickness and by the mirror's curvature, both where they are 0.
    ///
    /// With d the mirror's distance, h the point's height, P the square of its distance from the axis, E = 2 d − h: by thickness
    /// `2 (n² + (n² − 1) P/E²)^(−½)`, by curvature `−P σ (2 − σ) − 2 d (d − h)` with σ = d/E.
    #[inline(always)]
    fn by_glass_and_curvature(&self, p: [f64; 3], share: f64) -> [f64; 2] {
        let height = share * self.distance;
        let lateral = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] - height * height;
        let depth = 2.0 * self.distance - height;
        let n2 = self.index_squared;
        let by_thickness = 2.0 / (n2 + (n2 - 1.0) * lateral / (depth * depth)).sqrt();
        let sigma = self.distance / depth;
        let by_curvature = -lateral * sigma * (2.0 - sigma) - 2.0 * self.distance * (self.distance - height);
        [by_thickness / self.distance, by_curvature / self.distance]
    }

    /// A row, of u or of v: of the motion, the mirror and the residual.
    #[inline(always)]
    fn row<const R: usize>(&self, at: &Seen, arm: &[f64; 3], seen_at: f64) -> [f64; 10] {
        let (a, f) = (&at.by_point[R], &at.by_foot[R]);
        [
            arm[1] * a[2] - arm[2] * a[1],
            arm[2] * a[0] - arm[0] * a[2],
            arm[0] * a[1] - arm[1] * a[0],
            a[0],
            a[1],
            a[2],
            f[0],
            f[1],
            f[2],
            seen_at - at.pixel[R],
        ]
    }

    /// A row of the optics.
    #[inline(always)]
    fn row_of_optics<const R: usize>(&self, at: &Seen, arm: &[f64; 3], by: &[f64; 2]) -> [f64; 7] {
        [
            self.nominal_focal[R] * at.distorted[R],
            if R == 0 { 1.0 } else { 0.0 },
            if R == 0 { 0.0 } else { 1.0 },
            self.focal[R] * at.by_k1[R],
            dot(&at.by_point[R], arm),
            at.along[R] * by[0],
            at.along[R] * by[1],
        ]
    }

    /// Sum of squares of the residuals (px²), the foot point's information and its gradient; none where a point
    /// cannot be seen.
    pub fn plane_sums(
        &self,
        points: &Points,
        out: &mut Pictures,
    ) -> Option<(f64, Matrix3<f64>, Vector3<f64>)> {
        let rows = points.real.len();
        out.rows = rows;
        out.values.resize(COLUMNS * 2 * rows, 0.0);
        out.unseen.resize(rows, 0.0);
        columns_of_plane(self, points, &mut out.values, &mut out.unseen);
        if out.unseen.iter().any(|unseen| *unseen != 0.0) {
            return None;
        }
        let mut sums = [0.0; 16];
        out.products(&[0, 1, 2, 3], &[0, 1, 2, 3], 4, &mut sums);
        let at = |i: usize, j: usize| sums[4 * i.max(j) + i.min(j)];
        Some((at(3, 3), Matrix3::from_fn(at), Vector3::from_fn(|i, _| at(i, 3))))
    }

    /// The columns of all points, not yet weighted, with those of the optics if requested. Turns are about
    /// `origin`; the board is scaled by `scale`.
    pub fn columns(
        &self,
        points: &Points,
        origin: &Vector3<f64>,
        scale: f64,
        optics: bool,
        out: &mut Pictures,
    ) {
        let rows = points.real.len();
        let origin = [origin.x, origin.y, origin.z];
        out.rows = rows;
        out.optics = optics;
        out.values.resize(COLUMNS * 2 * rows, 0.0);
        out.unseen.resize(rows, 0.0);
        columns(self, points, origin, &mut out.values, &mut out.unseen);
        if optics {
            columns_of_optics(self, points, origin, 1.0 / scale, &mut out.values);
        }
    }
}

/// Writes the values of both rows of a point into their lists. Unrolled: an inner loop would keep the loop over the
/// points out of vector registers.
macro_rules! put {
    ($block:ident, $lane:ident, $u:ident, $v:ident, $($k:literal)*) => {
        $( $block[2 * $k][$lane] = $u[$k]; $block[2 * $k + 1][$lane] = $v[$k]; )*
    };
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn columns(mirror: &FlatMirror, points: &Points, origin: [f64; 3], out: &mut [f64], unseen: &mut [f64]) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| points.xyz[i].as_chunks::<LANES>().0);
    let [u, v] = [0, 1].map(|i: usize| points.uv[i].as_chunks::<LANES>().0);
    let rows = points.real.len();
    let unseen = unseen.as_chunks_mut::<LANES>().0;
    for i in 0..rows / LANES {
        let mut block = [[0.0; LANES]; 21];
        for l in 0..LANES {
            let p = [x[i][l], y[i][l], z[i][l]];
            let at = mirror.seen(p);
            let arm = [p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]];
            let a = mirror.row::<0>(&at, &arm, u[i][l]);
            let b = mirror.row::<1>(&at, &arm, v[i][l]);
            put!(block, l, a, b, 0 1 2 3 4 5 6 7 8 9);
            block[20][l] = if at.ok { 0.0 } else { 1.0 };
        }
        unseen[i] = block[20];
        copy(&block[..2 * OF_OPTICS], rows, i, out);
        copy(&block[2 * OF_OPTICS..20], rows, i, &mut out[2 * OF_PLANE * rows..]);
    }
}

/// By the foot point, and the residual: the first four lists.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn columns_of_plane(mirror: &FlatMirror, points: &Points, out: &mut [f64], unseen: &mut [f64]) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| points.xyz[i].as_chunks::<LANES>().0);
    let [u, v] = [0, 1].map(|i: usize| points.uv[i].as_chunks::<LANES>().0);
    let real = points.real.as_chunks::<LANES>().0;
    let rows = points.real.len();
    let unseen = unseen.as_chunks_mut::<LANES>().0;
    for i in 0..rows / LANES {
        let mut block = [[0.0; LANES]; 9];
        for l in 0..LANES {
            let at = mirror.seen([x[i][l], y[i][l], z[i][l]]);
            let (w, [a, b]) = (real[i][l], at.by_foot);
            let a = [w * a[0], w * a[1], w * a[2], w * (u[i][l] - at.pixel[0])];
            let b = [w * b[0], w * b[1], w * b[2], w * (v[i][l] - at.pixel[1])];
            put!(block, l, a, b, 0 1 2 3);
            block[8][l] = if at.ok { 0.0 } else { 1.0 };
        }
        unseen[i] = block[8];
        copy(&block[..8], rows, i, out);
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn columns_of_optics(
    mirror: &FlatMirror,
    points: &Points,
    origin: [f64; 3],
    inverse_scale: f64,
    out: &mut [f64],
) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| points.xyz[i].as_chunks::<LANES>().0);
    let rows = points.real.len();
    let s = inverse_scale;
    for i in 0..rows / LANES {
        let mut block = [[0.0; LANES]; 14];
        for l in 0..LANES {
            let p = [x[i][l], y[i][l], z[i][l]];
            let at = mirror.seen(p);
            let arm = [s * (p[0] - origin[0]), s * (p[1] - origin[1]), s * (p[2] - origin[2])];
            let by = mirror.by_glass_and_curvature(p, at.share);
            let a = mirror.row_of_optics::<0>(&at, &arm, &by);
            let b = mirror.row_of_optics::<1>(&at, &arm, &by);
            put!(block, l, a, b, 0 1 2 3 4 5 6);
        }
        copy(&block, rows, i, &mut out[2 * OF_OPTICS * rows..]);
    }
}

/// Copies lanes into their lists, of `rows` numbers each.
#[inline(always)]
fn copy(block: &[[f64; LANES]], rows: usize, i: usize, out: &mut [f64]) {
    for (lanes, list) in block.iter().zip(out.chunks_exact_mut(rows)) {
        list[i * LANES..(i + 1) * LANES].copy_from_slice(lanes);
    }
}
