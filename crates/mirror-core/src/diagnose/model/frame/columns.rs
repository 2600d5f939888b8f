//! The columns of a frame: the derivatives of its rows by an elementary change of the model.

use super::products::PROJECTED;
use super::rows::Rows;
use super::target::Target;
use super::work::FrameWork;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Twist, body_twist, followers};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::slips::Slipped;
use nalgebra::{Vector3, Vector6};

/// The motion of a target against its observer that an atom with this twist causes: its own, and those of the mimic joints
/// that follow it; none where it moves neither or both.
fn relative_twist(
    work: &FrameWork,
    (problem, deformation): (&Problem, &Deformation),
    atom: Atom,
    twist: &Twist,
    target: &Target,
) -> Option<Twist> {
    let own = target.sign(problem, atom).map(|sign| twist.times(sign));
    followers(atom, &problem.scene).iter().fold(own, |sum, &(follower, factor)| {
        let atom = Atom::Joint(follower);
        let Some(sign) = target.sign(problem, atom) else { return sum };
        let twist =
            body_twist(atom, &problem.scene, &work.poses, deformation, work.frame)?.times(sign * factor);
        Some(sum.map_or(twist, |sum| sum.plus(&twist)))
    })
}

impl FrameWork {
    /// The velocity field of the board's mount, or of its slip on it: of `before ∘ (Exp ω, t)` by ω or t.
    pub(super) fn board_twist(
        &self,
        problem: &Problem,
        deformation: &Deformation,
        atom: Atom,
    ) -> Option<Twist> {
        let board = problem.board_in(self.frame)?;
        let (actual, tangent, k) = match atom {
            Atom::BoardMount(k) => {
                (self.world_from_mounted_board(&problem.board?), deformation.board_mount, k)
            }
            Atom::BoardSlip(k) => {
                let slip = self.board_slip.unwrap_or_else(Vector6::zeros);
                (self.world_from_board(&board), slip, k)
            }
            _ => return None,
        };
        let turn = tangent.fixed_rows::<3>(0).into_owned();
        if k < 3 {
            // Exp(ω + dω) = Exp(ω) Exp(J_r dω).
            let by_turn = crate::geometry::rotation::right_jacobian(&turn);
            return Some(Twist::about(&actual.t, actual.r * by_turn.column(k)));
        }
        // The shift is expressed in the nominal frame: R = R_actual Exp(ω)ᵀ.
        let nominal = actual.r * crate::diagnose::model::pose::exp(&turn).transpose();
        Some(Twist::along(nominal.column(k - 3).into_owned()))
    }

    /// The twist of an atom that moves something; none of the others.
    pub(super) fn twist_of(&self, problem: &Problem, deformation: &Deformation, atom: Atom) -> Option<Twist> {
        match atom {
            Atom::BoardMount(_) | Atom::BoardSlip(_) => self.board_twist(problem, deformation, atom),
            Atom::MarkerShift(m, k) => {
                let mount = self.poses.site(&problem.marker_mounts[m]).r;
                Some(Twist::along(mount.column(k).into_owned()))
            }
            _ => body_twist(atom, &problem.scene, &self.poses, deformation, self.frame),
        }
    }

    /// Writes a column's rows and its projection (`row_count + 3` numbers); false where the atom moves nothing here.
    pub fn column(&self, problem: &Problem, deformation: &Deformation, atom: Atom, out: &mut [f64]) -> bool {
        out[..self.row_count + PROJECTED].fill(0.0);
        let mut any = false;
        let mut gradient = Vector3::zeros();
        let twist = self.twist_of(problem, deformation, atom);
        let condensed = &self.condensed;
        let mut at = 0;
        if condensed.used {
            if self.condensed_column((problem, deformation), atom, twist.as_ref(), out) {
                any = true;
                gradient = condensed.plane_of(out);
            }
            at = condensed.rank;
        }
        // How the elementary change moves a target is computed once for all of its rows.
        for rows in self.rows[condensed.corners..].chunk_by(|_, next| next.continues) {
            let target = Target::of(&rows[0]);
            let moved = |twist: &Twist| relative_twist(self, (problem, deformation), atom, twist, &target);
            let of_target = twist.as_ref().and_then(moved);
            if twist.is_some() && of_target.is_none() {
                at += rows.iter().map(|row| row.count).sum::<usize>();
                continue;
            }
            for row in rows {
                let value = match &of_target {
                    Some(t) => Some(row.by_world * (t.omega.cross(&row.point) + t.shift)),
                    None => self.rows_of(row, atom),
                };
                if let Some(value) = value {
                    any = true;
                    out[at..at + row.count].copy_from_slice(&value.as_slice()[..row.count]);
                    gradient += row.plane.tr_mul(&value);
                }
                at += row.count;
            }
        }
        if any && self.has_plane {
            out[at..at + PROJECTED].copy_from_slice((self.plane_inverse_factor * gradient).as_slice());
        }
        any
    }

    /// The column of a slip by the k-th parameter of its motion (a turn and a shift in its own frame; of a marker a
    /// shift alone); false where it moves nothing here. The corners must be separate rows.
    pub fn column_of_slip(
        &self,
        problem: &Problem,
        deformation: &Deformation,
        what: Slipped,
        k: usize,
        out: &mut [f64],
    ) -> bool {
        let own = match what {
            Slipped::Board => Some(Atom::BoardSlip(k)),
            Slipped::Marker(m) => k.checked_sub(3).map(|axis| Atom::MarkerShift(m, axis)),
            Slipped::Camera => None,
        };
        if let Some(atom) = own {
            return self.column(problem, deformation, atom, out);
        }
        out[..self.row_count + PROJECTED].fill(0.0);
        let pose = self.world_from_mount(problem).filter(|_| what == Slipped::Camera);
        let Some(pose) = pose.filter(|_| !self.condensed.used) else { return false };
        let axis = pose.r.column(k % 3).into_owned();
        let twist = if k < 3 { Twist::about(&pose.t, axis) } else { Twist::along(axis) };
        let (mut at, mut gradient, mut any) = (0, Vector3::zeros(), false);
        for row in &self.rows {
            if !row.measured {
                let value = -(row.by_world * (twist.omega.cross(&row.point) + twist.shift));
                out[at..at + row.count].copy_from_slice(&value.as_slice()[..row.count]);
                gradient += row.plane.tr_mul(&value);
                any = true;
            }
            at += row.count;
        }
        if any && self.has_plane {
            out[at..at + PROJECTED].copy_from_slice((self.plane_inverse_factor * gradient).as_slice());
        }
        any
    }

    /// Writes a column's rows of the condensed corners; false where the atom does not move them.
    fn condensed_column(
        &self,
        (problem, deformation): (&Problem, &Deformation),
        atom: Atom,
        twist: Option<&Twist>,
        out: &mut [f64],
    ) -> bool {
        let condensed = &self.condensed;
        if let Some(twist) = twist {
            let target = Target::board(problem, self.frame);
            let moved = target.and_then(|t| relative_twist(self, (problem, deformation), atom, twist, &t));
            return moved.map(|twist| condensed.by_twist(&twist, out)).is_some();
        }
        let column = optics_column(atom).filter(|_| condensed.has_optics);
        column.map(|k| condensed.by_optics(k, out)).is_some()
    }

    #[inline]
    fn rows_of(&self, row: &Rows, atom: Atom) -> Option<Vector3<f64>> {
        match atom {
            Atom::MarkerImage(k, by) if row.marker.is_some() && !row.measured => {
                Some(Vector3::ith(k, row.scale * row.in_picture[by]))
            }
            Atom::FramePose(k) if row.measured => {
                // Near its start, to first order in its turn.
                let in_link = self.measured_from.inverse_point(&row.point);
                let axis = Vector3::ith(k % 3, 1.0);
                let velocity = if k < 3 { axis.cross(&in_link) } else { axis };
                Some(self.points_from_link.map_or(velocity, |pose| pose.r * velocity) * row.scale)
            }
            Atom::FreeOptics(k) => {
                let column = self.free.get(row.free?)?.column(k);
                Some(Vector3::new(column[0], column[1], 0.0))
            }
            _ if !row.measured => {
                let column = self.optics.get(row.optics?)?.column(optics_column(atom)?);
                Some(Vector3::new(column[0], column[1], 0.0))
            }
            _ => None,
        }
    }
}

/// The index of an elementary change among the columns of the optics; none where it is not of the optics. Every
/// elementary change is listed: a new one must be added here.
pub(super) fn optics_column(atom: Atom) -> Option<usize> {
    match atom {
        Atom::CameraMount(k) => Some(k),
        Atom::Focal => Some(6),
        Atom::Center(k) => Some(7 + k),
        Atom::Dk1 => Some(9),
        Atom::BoardScale => Some(10),
        Atom::Glass => Some(11),
        Atom::Curvature => Some(12),
        Atom::Joint(_)
        | Atom::Tilt(..)
        | Atom::Bend(_)
        | Atom::Beam(_)
        | Atom::Turn(..)
        | Atom::Across(..)
        | Atom::Rock(..)
        | Atom::Sag(..)
        | Atom::LinkShift(..)
        | Atom::OriginShift(..)
        | Atom::MarkerShift(..)
        | Atom::MarkerImage(..)
        | Atom::BoardMount(_)
        | Atom::BoardSlip(_)
        | Atom::FreeOptics(_)
        | Atom::FramePose(_) => None,
    }
}
