//! Points in a mirror, through a polynomial lens, many at a time: the case of nearly every board and marker.
//!
//! The equations are those of [`super::sight`]: `q = p + 2 (1 − f·p/f²) f` in a flat front-surface mirror,
//! `q = p + (E − h) n` in one with a pane of glass or a slight curvature ([`MirrorOptics`]), then the lens. They are written
//! for one point without a branch, in loops over [`LANES`] points, so that they run in vector registers; a test compares
//! them with the general optics.

use super::pictures::{COLUMNS, OF_OPTICS, OF_PLANE, Pictures};
use super::products::LANES;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::principles::Guard;
use crate::mirror::{AxialDepths, MirrorOptics};
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

/// A mirror and the camera before it.
pub(super) struct MirrorAndLens {
    /// Whether the mirror is flat and silvered in front.
    pub flat: bool,
    optics: MirrorOptics,
    foot: [f64; 3],
    square: f64,
    distance: f64,
    k: [f64; 8],
    pub focal: [f64; 2],
    center: [f64; 2],
    pub nominal_focal: [f64; 2],
    /// The square of the largest distance from the axis at which the lens is one-to-one.
    pub limit: f64,
    index_squared: f64,
}

/// A point's picture and its derivatives.
pub(super) struct Seen {
    pub ok: bool,
    pub pixel: [f64; 2],
    /// A row each.
    pub by_point: [[f64; 3]; 2],
    pub by_foot: [[f64; 3]; 2],
    /// The distorted point, and how it moves with k1.
    pub distorted: [f64; 2],
    pub by_k1: [f64; 2],
    /// The picture as the reflected point moves along f, by one f.
    pub along: [f64; 2],
    /// How far along f the thickness of a pane and the curvature move the reflected point.
    pub by_mirror: [f64; 2],
}

/// A point of the picture plane through the lens.
pub(super) struct Bent {
    pub distorted: [f64; 2],
    /// `∂x′/∂x`, `∂y′/∂y`, and `∂x′/∂y = ∂y′/∂x`.
    pub own: [f64; 2],
    pub cross: f64,
    /// The square of the distance from the axis, and 1 over the denominator.
    pub square: f64,
    up: f64,
}

/// What a mirror with a pane or a curvature does to some points, and where these are against its axis.
pub(super) struct Depths {
    at: AxialDepths<LANES>,
    by_curvature: [f64; LANES],
    height: [f64; LANES],
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

impl MirrorAndLens {
    /// None for fisheyes, or with free-form errors of the optics.
    pub fn of(eye: &Eye, foot: &Vector3<f64>) -> Option<Self> {
        let (k, limit) = eye.camera.polynomial_lens()?;
        if eye.free.is_some() {
            return None;
        }
        let pair = |v: Vector2<f64>| [v.x, v.y];
        Some(Self {
            flat: eye.mirror.is_ideal(),
            optics: eye.mirror,
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

    /// A point of the plane at depth 1 through the lens.
    #[inline(always)]
    pub fn bent(&self, x: f64, y: f64) -> Bent {
        let k = &self.k;
        let s = x * x + y * y;
        let up = 1.0 / (1.0 + s * (k[5] + s * (k[6] + s * k[7])));
        let c = (1.0 + s * (k[0] + s * (k[1] + s * k[4]))) * up;
        let dc = ((k[0] + s * (2.0 * k[1] + s * 3.0 * k[4]))
            - c * (k[5] + s * (2.0 * k[6] + s * 3.0 * k[7])))
            * up;
        let (p1, p2) = (k[2], k[3]);
        let xy = 2.0 * x * y;
        Bent {
            distorted: [x * c + p1 * xy + p2 * (s + 2.0 * x * x), y * c + p1 * (s + 2.0 * y * y) + p2 * xy],
            own: [
                c + 2.0 * x * x * dc + 2.0 * p1 * y + 6.0 * p2 * x,
                c + 2.0 * y * y * dc + 6.0 * p1 * y + 2.0 * p2 * x,
            ],
            cross: xy * dc + 2.0 * p1 * x + 2.0 * p2 * y,
            square: s,
            up,
        }
    }

    /// The point reflected in the plane: where a flat front-surface mirror shows it.
    #[inline(always)]
    pub fn reflected(&self, p: [f64; 3]) -> [f64; 3] {
        let f = &self.foot;
        let twice = 2.0 * (1.0 - dot(f, &p) / self.square);
        [p[0] + twice * f[0], p[1] + twice * f[1], p[2] + twice * f[2]]
    }

    /// What [`MirrorAndLens::seen`] needs of some points in a mirror that is not flat.
    #[inline(always)]
    pub fn depths<const FLAT: bool>(&self, x: &[f64; LANES], y: &[f64; LANES], z: &[f64; LANES]) -> Depths {
        let mut out = Depths { at: AxialDepths::ZERO, by_curvature: [0.0; LANES], height: [0.0; LANES] };
        if FLAT {
            return out;
        }
        let mut lateral_squared = [0.0; LANES];
        for l in 0..LANES {
            let p = [x[l], y[l], z[l]];
            out.height[l] = dot(&self.foot, &p) / self.distance;
            let n =
                [self.foot[0] / self.distance, self.foot[1] / self.distance, self.foot[2] / self.distance];
            let lateral = less(&p, 1.0, out.height[l], &n);
            lateral_squared[l] = dot(&lateral, &lateral);
        }
        (out.at, out.by_curvature) = self.optics.depths(&lateral_squared, &out.height, self.distance);
        out
    }

    /// The picture of a point, the `l`-th of those of the depths.
    #[inline(always)]
    pub fn seen<const FLAT: bool>(&self, p: [f64; 3], depths: &Depths, l: usize) -> Seen {
        let f = &self.foot;
        let share = dot(f, &p) / self.square;
        // By one f.
        let moved =
            if FLAT { 2.0 * (1.0 - share) } else { (depths.at.depth[l] - depths.height[l]) / self.distance };
        let q = [p[0] + moved * f[0], p[1] + moved * f[1], p[2] + moved * f[2]];
        let (x, y) = (q[0] / q[2], q[1] / q[2]);
        let Bent { distorted, own, cross, square: s, up } = self.bent(x, y);
        let ok = (share < 1.0) & (q[2] > NEAREST_DEPTH_M) & (q[2] < FARTHEST_DEPTH_M) & (s <= self.limit);
        let (fx, fy) = (self.focal[0] / q[2], self.focal[1] / q[2]);
        let (a, b) = ([fx * own[0], fx * cross], [fy * cross, fy * own[1]]);
        let by_seen = [[a[0], a[1], -(a[0] * x + a[1] * y)], [b[0], b[1], -(b[0] * x + b[1] * y)]];
        let along = [dot(&by_seen[0], f), dot(&by_seen[1], f)];
        let inverse = 1.0 / self.square;
        // ∂q/∂p = I − f turnedᵀ, ∂q/∂f = moved I − f shiftᵀ.
        let (turned, shift, by_mirror) = if FLAT {
            let twice = 2.0 * inverse;
            let turned = [twice * f[0], twice * f[1], twice * f[2]];
            let shift = less(&p, twice, 2.0 * share * twice, f);
            (turned, shift, self.by_glass_and_curvature(p, share))
        } else {
            let (d, at, lateral) = (self.distance, &depths.at, less(&p, 1.0, share, f));
            let (by_p, by_h) = (at.by_lateral_squared[l], at.by_height[l]);
            // E by the point along the axis and across it, and by the foot point.
            let turned = less(&lateral, -2.0 * by_p / d, (by_h - 1.0) * inverse, f);
            let across = (1.0 + 2.0 * depths.height[l] * by_p - by_h) * inverse;
            let shift = less(&lateral, across, (at.by_distance[l] - moved) * inverse, f);
            (turned, shift, [at.by_parameter[l] / d, depths.by_curvature[l] / d])
        };
        Seen {
            ok: ok & depths.at.seen[l],
            pixel: [
                self.focal[0] * distorted[0] + self.center[0],
                self.focal[1] * distorted[1] + self.center[1],
            ],
            by_point: [less(&by_seen[0], 1.0, along[0], &turned), less(&by_seen[1], 1.0, along[1], &turned)],
            by_foot: [less(&by_seen[0], moved, along[0], &shift), less(&by_seen[1], moved, along[1], &shift)],
            distorted,
            by_k1: [x * s * up, y * s * up],
            along,
            by_mirror,
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
    fn row_of_optics<const R: usize>(&self, at: &Seen, arm: &[f64; 3]) -> [f64; 7] {
        [
            self.nominal_focal[R] * at.distorted[R],
            if R == 0 { 1.0 } else { 0.0 },
            if R == 0 { 0.0 } else { 1.0 },
            self.focal[R] * at.by_k1[R],
            dot(&at.by_point[R], arm),
            at.along[R] * at.by_mirror[0],
            at.along[R] * at.by_mirror[1],
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
        if self.flat {
            columns_of_plane(self, points, &mut out.values, &mut out.unseen);
        } else {
            columns_of_plane_behind_glass(self, points, &mut out.values, &mut out.unseen);
        }
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
        match (self.flat, optics) {
            (true, false) => columns(self, points, origin, &mut out.values, &mut out.unseen),
            (true, true) => all_columns(self, points, origin, 1.0 / scale, &mut out.values, &mut out.unseen),
            (false, _) => {
                all_columns_behind_glass(self, points, origin, 1.0 / scale, &mut out.values, &mut out.unseen)
            }
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
fn columns(mirror: &MirrorAndLens, points: &Points, origin: [f64; 3], out: &mut [f64], unseen: &mut [f64]) {
    write_columns::<true, false>(mirror, points, origin, 1.0, out, unseen);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn all_columns(
    mirror: &MirrorAndLens,
    points: &Points,
    origin: [f64; 3],
    inverse_scale: f64,
    out: &mut [f64],
    unseen: &mut [f64],
) {
    write_columns::<true, true>(mirror, points, origin, inverse_scale, out, unseen);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn all_columns_behind_glass(
    mirror: &MirrorAndLens,
    points: &Points,
    origin: [f64; 3],
    inverse_scale: f64,
    out: &mut [f64],
    unseen: &mut [f64],
) {
    write_columns::<false, true>(mirror, points, origin, inverse_scale, out, unseen);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn columns_of_plane(mirror: &MirrorAndLens, points: &Points, out: &mut [f64], unseen: &mut [f64]) {
    write_columns_of_plane::<true>(mirror, points, out, unseen);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn columns_of_plane_behind_glass(
    mirror: &MirrorAndLens,
    points: &Points,
    out: &mut [f64],
    unseen: &mut [f64],
) {
    write_columns_of_plane::<false>(mirror, points, out, unseen);
}

#[inline(always)]
fn write_columns<const FLAT: bool, const OPTICS: bool>(
    mirror: &MirrorAndLens,
    points: &Points,
    origin: [f64; 3],
    inverse_scale: f64,
    out: &mut [f64],
    unseen: &mut [f64],
) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| points.xyz[i].as_chunks::<LANES>().0);
    let [u, v] = [0, 1].map(|i: usize| points.uv[i].as_chunks::<LANES>().0);
    let rows = points.real.len();
    let unseen = unseen.as_chunks_mut::<LANES>().0;
    let s = inverse_scale;
    for i in 0..rows / LANES {
        let mut block = [[0.0; LANES]; 21];
        let mut of_optics = [[0.0; LANES]; 14];
        let depths = mirror.depths::<FLAT>(&x[i], &y[i], &z[i]);
        for l in 0..LANES {
            let p = [x[i][l], y[i][l], z[i][l]];
            let at = mirror.seen::<FLAT>(p, &depths, l);
            let arm = [p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]];
            let a = mirror.row::<0>(&at, &arm, u[i][l]);
            let b = mirror.row::<1>(&at, &arm, v[i][l]);
            put!(block, l, a, b, 0 1 2 3 4 5 6 7 8 9);
            block[20][l] = if at.ok { 0.0 } else { 1.0 };
            if OPTICS {
                let arm = [s * arm[0], s * arm[1], s * arm[2]];
                let a = mirror.row_of_optics::<0>(&at, &arm);
                let b = mirror.row_of_optics::<1>(&at, &arm);
                put!(of_optics, l, a, b, 0 1 2 3 4 5 6);
            }
        }
        unseen[i] = block[20];
        copy(&block[..2 * OF_OPTICS], rows, i, out);
        copy(&block[2 * OF_OPTICS..20], rows, i, &mut out[2 * OF_PLANE * rows..]);
        if OPTICS {
            copy(&of_optics, rows, i, &mut out[2 * OF_OPTICS * rows..]);
        }
    }
}

/// By the foot point, and the residual: the first four lists.
#[inline(always)]
fn write_columns_of_plane<const FLAT: bool>(
    mirror: &MirrorAndLens,
    points: &Points,
    out: &mut [f64],
    unseen: &mut [f64],
) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| points.xyz[i].as_chunks::<LANES>().0);
    let [u, v] = [0, 1].map(|i: usize| points.uv[i].as_chunks::<LANES>().0);
    let real = points.real.as_chunks::<LANES>().0;
    let rows = points.real.len();
    let unseen = unseen.as_chunks_mut::<LANES>().0;
    for i in 0..rows / LANES {
        let mut block = [[0.0; LANES]; 9];
        let depths = mirror.depths::<FLAT>(&x[i], &y[i], &z[i]);
        for l in 0..LANES {
            let at = mirror.seen::<FLAT>([x[i][l], y[i][l], z[i][l]], &depths, l);
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

/// Copies lanes into their lists, of `rows` numbers each.
#[inline(always)]
pub(super) fn copy(block: &[[f64; LANES]], rows: usize, i: usize, out: &mut [f64]) {
    for (lanes, list) in block.iter().zip(out.chunks_exact_mut(rows)) {
        list[i * LANES..(i + 1) * LANES].copy_from_slice(lanes);
    }
}
