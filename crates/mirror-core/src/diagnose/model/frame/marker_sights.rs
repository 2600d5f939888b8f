//! The image points of a frame's markers in the mirror, computed together: the equations of [`super::sight`] and of a ball's
//! outline.
//!
//! The centroid of a ball's outline is not the image of its centre ([`crate::mirror::Sphere`]). The ellipse's centre is the image
//! of `(x, y, z − R²/z)`. The lens moves the mean over the ellipse; it is computed from four points at `1/√2` of the semi-axes,
//! weighted with the lens's area factor.

use super::mirror_and_lens::{Bent, MirrorAndLens, copy};
use super::products::LANES;
use super::sight::{Sight, Wanted};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Size;
use core::f64::consts::FRAC_1_SQRT_2;
use multiversion::multiversion;
use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

/// Numbers of a marker: pixel, its derivatives by point and by foot point, the outline's offset, its derivatives by focal
/// length, k1, glass and curvature, and whether the marker is not seen.
const NUMBERS: Size = 25;
const BY_POINT: Size = 2;
const BY_FOOT: Size = 8;
const OFFSET: Size = 14;
const BY_FOCAL: Size = 16;
const BY_K1: Size = 18;
const BY_MIRROR: Size = 20;
const UNSEEN: Size = 24;

/// The markers that a frame shows in the mirror, in the order of its observations.
#[derive(Debug, Default)]
pub(super) struct Markers {
    /// Whether they are those of the frame as it was posed last.
    pub posed: bool,
    /// In the world, and in the camera's frame, m.
    pub world: Vec<Vector3<f64>>,
    pub camera: Vec<Vector3<f64>>,
    /// The latter once more, and radii, each a list as long as a multiple of [`LANES`]; 0 for a point.
    xyz: [Vec<f64>; 3],
    radius: Vec<f64>,
    /// [`NUMBERS`] lists as long, and the foot point of the plane that they are told of.
    seen: Vec<f64>,
    seen_at: Option<Vector3<f64>>,
    /// The foot point of the plane with which the outlines' offsets were computed.
    outlines_at: Option<Vector3<f64>>,
}

impl Markers {
    fn at(&self, number: usize, i: usize) -> f64 {
        self.seen[number * self.radius.len() + i]
    }

    fn pair(&self, number: usize, i: usize) -> Vector2<f64> {
        Vector2::new(self.at(number, i), self.at(number + 1, i))
    }

    /// Where the i-th is seen, with the columns that are wanted; none where it cannot be.
    pub fn sight(&self, i: usize, nominal_focal: &Vector2<f64>, wanted: Wanted) -> Option<Sight> {
        if self.at(UNSEEN, i) != 0.0 {
            return None;
        }
        let rows = |first: usize| Matrix2x3::from_fn(|r, c| self.at(first + 3 * r + c, i));
        let mut by_lens = SMatrix::<f64, 2, 4>::zeros();
        if wanted.lens {
            by_lens.set_column(0, &self.pair(BY_FOCAL, i).component_mul(nominal_focal));
            (by_lens[(0, 1)], by_lens[(1, 2)]) = (1.0, 1.0);
            by_lens.set_column(3, &self.pair(BY_K1, i));
        }
        let mirror = |first: usize| if wanted.mirror { self.pair(first, i) } else { Vector2::zeros() };
        Some(Sight {
            pixel: self.pair(0, i),
            by_point: rows(BY_POINT),
            by_foot: rows(BY_FOOT),
            by_glass: mirror(BY_MIRROR),
            by_curvature: mirror(BY_MIRROR + 2),
            by_lens,
            free: None,
        })
    }

    /// Forgets all, for a frame that is posed.
    pub fn clear(&mut self) {
        self.posed = true;
        self.seen_at = None;
        self.outlines_at = None;
        self.world.clear();
        self.camera.clear();
        self.radius.clear();
        self.xyz.iter_mut().for_each(Vec::clear);
    }

    /// One more, of a radius; 0 for a point.
    pub fn push(&mut self, world: Vector3<f64>, camera: Vector3<f64>, radius: f64) {
        self.world.push(world);
        self.camera.push(camera);
        self.radius.push(radius);
        self.xyz.iter_mut().zip(camera.iter()).for_each(|(list, x)| list.push(*x));
    }

    /// Fills the last lanes with the last one once more.
    pub fn fill_up(&mut self) {
        while let Some(radius) =
            self.radius.last().copied().filter(|_| !self.radius.len().is_multiple_of(LANES))
        {
            self.radius.push(radius);
            for list in &mut self.xyz {
                list.extend(list.last().copied());
            }
        }
    }

    /// Finds where all are seen in a mirror of this foot point, unless it was that already.
    pub fn see(&mut self, mirror: &MirrorAndLens, foot: Vector3<f64>) {
        if self.seen_at == Some(foot) {
            return;
        }
        self.seen_at = Some(foot);
        let near = |at: Vector3<f64>| (foot - at).norm() < SOLVER.plane_moved * foot.norm();
        let outlines = !self.outlines_at.is_some_and(near);
        if outlines {
            self.outlines_at = Some(foot);
        }
        let Self { xyz, radius, seen, .. } = self;
        seen.resize(NUMBERS * radius.len(), 0.0);
        if outlines {
            outline_offsets(mirror, xyz, radius, seen);
        }
        if mirror.flat {
            sights(mirror, xyz, radius, seen);
        } else {
            sights_behind_glass(mirror, xyz, radius, seen);
        }
    }

    /// The picture of the i-th's centre with its rows by the foot point; none where it cannot be seen.
    pub fn by_foot(&self, i: usize) -> Option<(Vector2<f64>, [Vector3<f64>; 2])> {
        let row = |k: usize| Vector3::from_fn(|c, _| self.at(BY_FOOT + 3 * k + c, i));
        (self.at(UNSEEN, i) == 0.0).then(|| (self.pair(0, i), [row(0), row(1)]))
    }

    /// From the picture of the i-th's centre to the centroid of its outline, px.
    pub fn offset(&self, i: usize) -> Vector2<f64> {
        self.pair(OFFSET, i)
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn sights(mirror: &MirrorAndLens, xyz: &[Vec<f64>; 3], radius: &[f64], out: &mut [f64]) {
    write_sights::<true>(mirror, xyz, radius, out);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn sights_behind_glass(mirror: &MirrorAndLens, xyz: &[Vec<f64>; 3], radius: &[f64], out: &mut [f64]) {
    write_sights::<false>(mirror, xyz, radius, out);
}

/// From the images of the balls' centres to the centroids of their outlines.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn outline_offsets(mirror: &MirrorAndLens, xyz: &[Vec<f64>; 3], radius: &[f64], out: &mut [f64]) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| xyz[i].as_chunks::<LANES>().0);
    let all = radius.len();
    for i in 0..all / LANES {
        let mut block = [[0.0; LANES]; 2];
        for l in 0..LANES {
            let seen = mirror.reflected([x[i][l], y[i][l], z[i][l]]);
            let offset = outline(mirror, seen, radius[i * LANES + l]);
            (block[0][l], block[1][l]) = (offset[0], offset[1]);
        }
        copy(&block, all, i, &mut out[OFFSET * all..]);
    }
}

#[inline(always)]
fn write_sights<const FLAT: bool>(
    mirror: &MirrorAndLens,
    xyz: &[Vec<f64>; 3],
    radius: &[f64],
    out: &mut [f64],
) {
    let [x, y, z] = [0, 1, 2].map(|i: usize| xyz[i].as_chunks::<LANES>().0);
    for i in 0..radius.len() / LANES {
        let mut block = [[0.0; LANES]; NUMBERS];
        let depths = mirror.depths::<FLAT>(&x[i], &y[i], &z[i]);
        for l in 0..LANES {
            let p = [x[i][l], y[i][l], z[i][l]];
            let at = mirror.seen::<FLAT>(p, &depths, l);
            let ([a, b], [f, g]) = (&at.by_point, &at.by_foot);
            (block[0][l], block[1][l]) = (at.pixel[0], at.pixel[1]);
            (block[2][l], block[3][l], block[4][l]) = (a[0], a[1], a[2]);
            (block[5][l], block[6][l], block[7][l]) = (b[0], b[1], b[2]);
            (block[8][l], block[9][l], block[10][l]) = (f[0], f[1], f[2]);
            (block[11][l], block[12][l], block[13][l]) = (g[0], g[1], g[2]);
            (block[16][l], block[17][l]) = (at.distorted[0], at.distorted[1]);
            (block[18][l], block[19][l]) = (mirror.focal[0] * at.by_k1[0], mirror.focal[1] * at.by_k1[1]);
            (block[20][l], block[21][l]) = (at.along[0] * at.by_mirror[0], at.along[1] * at.by_mirror[0]);
            (block[22][l], block[23][l]) = (at.along[0] * at.by_mirror[1], at.along[1] * at.by_mirror[1]);
            block[24][l] = if at.ok { 0.0 } else { 1.0 };
        }
        copy(&block[..OFFSET], radius.len(), i, out);
        copy(&block[BY_FOCAL..], radius.len(), i, &mut out[BY_FOCAL * radius.len()..]);
    }
}

/// From the image of a ball's centre to the centroid of its outline, px; 0 for a point, and where a part of the ball is outside
/// the lens model's range.
#[inline(always)]
fn outline(mirror: &MirrorAndLens, [x, y, z]: [f64; 3], radius: f64) -> [f64; 2] {
    let r2 = radius * radius;
    let lateral2 = x * x + y * y;
    let depth2 = z * z - r2;
    // Semi-axes of the ellipse, radial and tangential.
    let radial = FRAC_1_SQRT_2 * radius * (lateral2 + depth2).sqrt() / depth2;
    let tangential = FRAC_1_SQRT_2 * radius / depth2.sqrt();
    let lateral = lateral2.sqrt();
    let off_axis = lateral > 1e-12 * z;
    let (out_x, out_y) = if off_axis { (x / lateral, y / lateral) } else { (1.0, 0.0) };
    let depth = z - r2 / z;
    let (cx, cy) = (x / depth, y / depth);
    let center = mirror.bent(x / z, y / z);
    let middle = mirror.bent(cx, cy);
    let (rx, ry, tx, ty) = (radial * out_x, radial * out_y, -tangential * out_y, tangential * out_x);
    let a = mirror.bent(cx + rx, cy + ry);
    let b = mirror.bent(cx - rx, cy - ry);
    let c = mirror.bent(cx + tx, cy + ty);
    let d = mirror.bent(cx - tx, cy - ty);
    let area = |at: &Bent| at.own[0] * at.own[1] - at.cross * at.cross;
    let (wa, wb, wc, wd) = (area(&a), area(&b), area(&c), area(&d));
    let total = wa + wb + wc + wd;
    let moved = |k: usize| {
        let from = middle.distorted[k];
        let sum = (a.distorted[k] - from) * wa
            + (b.distorted[k] - from) * wb
            + (c.distorted[k] - from) * wc
            + (d.distorted[k] - from) * wd;
        mirror.focal[k] * (from - center.distorted[k] + sum / total)
    };
    let limit = mirror.limit;
    let within = (a.square <= limit)
        & (b.square <= limit)
        & (c.square <= limit)
        & (d.square <= limit)
        & (middle.square <= limit)
        & (center.square <= limit);
    let is_ball = (radius > 0.0) & (z > radius) & within;
    if is_ball { [moved(0), moved(1)] } else { [0.0, 0.0] }
}
