//! The corners of a frame's board as products alone, without their rows: where the rows themselves are not used.

use super::condensed::{BoardSums, MOTION, OPTICS};
use super::mirror_and_lens::MirrorAndLens;
use super::observe::pixel_mixture;
use super::pictures::{COLUMNS, OF_OPTICS, OF_PLANE, RESIDUAL};
use super::products::{PROJECTED, stride};
use super::work::{FrameWork, Task};
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::problem::{FrameData, Problem};
use crate::diagnose::model::robust::Robust;
use crate::diagnose::principles::Size;
use nalgebra::{Matrix3, Vector3};

/// Costs of so many corners are taken to one logarithm.
const AT_ONCE: Size = 8;

impl FrameWork {
    /// Poses the corners before the camera, each `each`-th of them, once a pose.
    pub(super) fn pose_corners(
        &mut self,
        problem: &Problem,
        eye: &Eye,
        data: &FrameData,
        scale: f64,
        each: usize,
    ) {
        let Some(board) = problem.board_in(self.frame) else { return };
        if self.points_each == each {
            return;
        }
        self.points_each = each;
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.world_from_board(&board));
        self.points.clear();
        for (index, pixel) in data.corners.iter().step_by(each) {
            self.points.push(&camera_from_board.point(&(problem.corners[*index] * scale)), pixel);
        }
        self.points.fill_up();
    }

    /// The corners at the present plane as products with each other, in [`FrameWork::condensed`]; none where they are to be rows or the
    /// optics are others.
    pub(super) fn observe_many(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
    ) -> Option<BoardSums> {
        let (eye, board) = (task.eye.filter(|_| task.condenses())?, problem.board_in(self.frame)?);
        let mirror = MirrorAndLens::of(eye, &self.foot)?;
        let scale = 1.0 + task.deformation.board_scale_error;
        self.pose_corners(problem, eye, data, scale, 1);
        let camera_from_world = self.camera_from_world(problem, eye);
        let about = self.world_from_board(&board).t;
        let origin = camera_from_world.point(&about);
        mirror.columns(&self.points, &origin, scale, task.wanted.optics, &mut self.pictures);
        let std = task.noise.corner_px;
        let mixture = pixel_mixture(eye, std);
        let (mut cost, mut product, mut factors) = (0.0, 1.0, 0);
        let (mut corners, mut counted) = (0, 0.0);
        self.pictures.weigh(self.points.len(), |squared| {
            let Some(squared) = squared else {
                // A corner that cannot be predicted (for example behind the mirror) costs as much as a false
                // observation.
                cost += mixture.of(f64::INFINITY).cost;
                return 0.0;
            };
            let squared = squared / (std * std);
            let weight = if task.gaussian {
                let robust = Robust::gaussian(squared);
                cost += robust.cost;
                robust.weight
            } else {
                let (likelihood, weight) = mixture.likelihood(squared);
                product *= likelihood;
                factors += 1;
                if factors % AT_ONCE == 0 {
                    cost -= 2.0 * core::mem::replace(&mut product, 1.0).ln();
                }
                weight
            };
            corners += 1;
            counted += weight;
            weight.sqrt() / std
        });
        self.cost += cost - 2.0 * product.ln();
        if corners == 0 {
            return None;
        }
        self.products_of_corners(task, &camera_from_world.r, about);
        self.condensed.by_mount =
            task.wanted.optics.then(|| Self::by_mount(eye, &camera_from_world.inverse()));
        let condensed = &self.condensed;
        let (m, wide) = (condensed.columns, stride(condensed.columns));
        let plane = m - 1 - PROJECTED;
        let at = |i: usize, j: usize| condensed.gram[i.max(j) * wide + i.min(j)];
        Some(BoardSums {
            information: Matrix3::from_fn(|i, j| at(plane + i, plane + j)),
            gradient: Vector3::from_fn(|i, _| at(plane + i, m - 1)),
            square: at(m - 1, m - 1),
            corners,
            counted,
        })
    }

    fn products_of_corners(
        &mut self,
        task: &Task<'_>,
        camera_from_world: &Matrix3<f64>,
        about: Vector3<f64>,
    ) {
        let wanted = task.wanted;
        let optics = if wanted.optics { OPTICS } else { 0 };
        let plane = MOTION + optics;
        let condensed = &mut self.condensed;
        condensed.used = true;
        condensed.corners = 0;
        condensed.has_optics = wanted.optics;
        condensed.about = about;
        condensed.turned = *camera_from_world;
        condensed.columns = plane + PROJECTED + 1;
        let (mut which, mut places, mut count) = ([0; COLUMNS], [0; COLUMNS], 0);
        let mut take = |column: usize, place: usize| {
            (which[count], places[count]) = (column, place);
            count += 1;
        };
        (0..MOTION).for_each(|k| take(k, k));
        for k in 0..optics {
            // Focal length, centre and k1 are the lens's, the last two the mirror's.
            if if k < 4 { wanted.lens } else { k == 4 || wanted.mirror } {
                take(OF_OPTICS + k, MOTION + k);
            }
        }
        (0..PROJECTED).for_each(|k| take(OF_PLANE + k, plane + k));
        take(RESIDUAL, plane + PROJECTED);
        let wide = stride(condensed.columns);
        condensed.gram.clear();
        condensed.gram.resize(condensed.columns * wide, 0.0);
        self.pictures.products(&which[..count], &places[..count], wide, &mut condensed.gram);
    }
}
