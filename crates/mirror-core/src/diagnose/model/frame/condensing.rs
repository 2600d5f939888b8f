//! Condenses the corners of an evaluated frame.

use super::condensed::{MOTION, OPTICS};
use super::products::{PROJECTED, add_products, stride};
use super::rows::Rows;
use super::work::FrameWork;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::elementary::Twist;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::Problem;
use nalgebra::{Matrix3, Vector3};

impl FrameWork {
    /// Condenses the first `corners` observations, which are the board's corners, and the residual with them.
    pub(super) fn condense(&mut self, problem: &Problem, eye: &Eye, corners: usize) {
        let world_from_camera = self.camera_from_world(problem, eye).inverse();
        let by_mount = Self::by_mount(eye, &world_from_camera);
        let rows: &[Rows] = &self.rows[..corners];
        let condensed = &mut self.condensed;
        condensed.used = true;
        condensed.corners = corners;
        condensed.turned = Matrix3::identity();
        let optics = rows.iter().all(|r| r.optics.is_some());
        condensed.has_optics = optics;
        condensed.by_mount = optics.then_some(by_mount);
        let plane_from = MOTION + if optics { OPTICS } else { 0 };
        let m = plane_from + PROJECTED + 1;
        condensed.columns = m;
        condensed.about = rows[0].point;
        condensed.table.clear_rows(m, 2 * corners);
        for (i, row) in rows.iter().enumerate() {
            let arm = row.point - condensed.about;
            for c in 0..2 {
                let out = condensed.table.row_mut(2 * i + c);
                let by = Vector3::new(row.by_world[(c, 0)], row.by_world[(c, 1)], row.by_world[(c, 2)]);
                let turn = arm.cross(&by);
                for k in 0..3 {
                    out[k] = turn[k];
                    out[3 + k] = by[k];
                    out[plane_from + k] = row.plane[(c, k)];
                }
                if let Some(by_optics) = row.optics.filter(|_| optics).and_then(|o| self.optics.get(o)) {
                    for k in 0..OPTICS {
                        out[MOTION + k] = by_optics[(c, MOTION + k)];
                    }
                }
                out[m - 1] = row.residual[c];
            }
        }
        condensed.gram.clear();
        condensed.gram.resize(m * stride(m), 0.0);
        let table = condensed.table.filled();
        add_products(table, table, true, &mut condensed.gram);
        self.factorise_corners();
    }

    /// The condensed corners' rows by their products, and the residual with them.
    pub(super) fn factorise_corners(&mut self) {
        let condensed = &mut self.condensed;
        condensed.factorise();
        let (m, rank, rows) = (condensed.columns, condensed.rank, 2 * condensed.corners);
        let own = (0..rank).map(|row| condensed.factor[row * m + m - 1]);
        self.residual.splice(..rows, own);
        self.row_count = self.row_count - rows + rank;
    }

    /// How the board moves against the camera with each parameter of the camera's mount: `p ↦ Exp(ω)ᵀ(p − v)`, by ω `p × J_r e`, by v
    /// `−Exp(ω)ᵀ e`.
    pub(super) fn by_mount(eye: &Eye, world_from_camera: &Pose) -> [Twist; MOTION] {
        core::array::from_fn(|k| match k.checked_sub(3) {
            None => {
                let turn = -(world_from_camera.r * eye.mount_jacobian.column(k));
                Twist::about(&world_from_camera.t, turn)
            }
            Some(k) => Twist::along(-(world_from_camera.r * eye.camera_from_mount.r.column(k))),
        })
    }
}
