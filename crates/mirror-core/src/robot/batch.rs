//! Batches of postures: several a vector, blocks of them on all cores.
//!
//! Postures are the rows of `q`, (N, nq), and results are arrays in C order, their first axis the posture. Each row's
//! result depends on that row alone.

use super::joint::JointKind;
use super::lanes::{LANES, Lane, Lane3, LanePoses, cross, lane_of, minus, scaled, sum};
use super::model::Robot;
use crate::error::{Error, Result, finite};
use multiversion::multiversion;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Blocks of [`LANES`] postures that one task takes: enough to hide the cost of handing it over.
const BLOCKS_A_TASK: usize = 16;

/// Forward kinematics of one block, compiled once for each width of the processor's vectors and chosen at run time.
///
/// All versions round alike (no fused multiply-add), so results are the same bits on every machine. A separate
/// function: inlined into each of its callers it would be a seventh of the library.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn advance_block(robot: &Robot, q: &[f64], poses: &mut LanePoses) {
    robot.advance_lanes(q, poses);
}

/// Postures in blocks of [`LANES`], compiled like [`advance_block`].
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn run_rows<W, F: Fn(&LanePoses, &mut W, &mut [f64])>(
    robot: &Robot,
    q: &[f64],
    each: usize,
    out: &mut [f64],
    workspace: &mut (LanePoses, W),
    write: &F,
) {
    let width = robot.position_count();
    let (poses, extra) = workspace;
    for (k, block) in out.chunks_mut(LANES * each).enumerate() {
        let (start, rows) = (k * LANES, block.len() / each);
        advance_block(robot, &q[start * width..(start + rows) * width], poses);
        write(poses, extra, block);
    }
}

impl Robot {
    /// Forward kinematics of N postures: `root_from_link` of all links as 4×4 matrices by rows, (N, links, 4, 4).
    ///
    /// For a large batch most time is spent on writing 128 bytes a link to memory: request only the links that are
    /// needed with [`Robot::link_poses_batch`].
    ///
    /// # Errors
    /// Positions that are not finite (by row and joint), lengths that do not fit.
    pub fn forward_kinematics_batch(&self, q: &[f64], out: &mut [f64]) -> Result<()> {
        let each = self.links.len() * 16;
        self.run_batch(
            q,
            out,
            each,
            "poses (N, links, 4, 4)",
            #[inline(always)]
            |poses, block| {
                // Link by link: its frame is then read from the cache once, not once a posture.
                let matrices = block.as_chunks_mut::<16>().0;
                let links = poses.frames.len();
                for (k, frame) in poses.frames.iter().enumerate() {
                    for (lane, matrix) in matrices[k..].iter_mut().step_by(links).enumerate() {
                        frame.write_matrix(lane, matrix);
                    }
                }
            },
        )
    }

    /// Poses of some links in N postures: `root_from_link` as 4×4 matrices by rows, (N, requested links, 4, 4), in
    /// the order of `links`.
    ///
    /// # Errors
    /// As [`Robot::forward_kinematics_batch`], and an invalid link index.
    pub fn link_poses_batch(&self, q: &[f64], links: &[usize], out: &mut [f64]) -> Result<()> {
        for &link in links {
            self.check_link("link", link)?;
        }
        let each = links.len() * 16;
        self.run_batch(
            q,
            out,
            each,
            "poses (N, links asked for, 4, 4)",
            #[inline(always)]
            |poses, block| {
                let matrices = block.as_chunks_mut::<16>().0;
                for (k, &link) in links.iter().enumerate() {
                    let frame = &poses.frames[link];
                    for (lane, matrix) in matrices[k..].iter_mut().step_by(links.len()).enumerate() {
                        frame.write_matrix(lane, matrix);
                    }
                }
            },
        )
    }

    /// Twists of all joints in N postures, (N, joints, 6), rows (ω, v at the root's origin), as [`Robot::joint_twists`].
    ///
    /// # Errors
    /// As [`Robot::forward_kinematics_batch`].
    pub fn joint_twists_batch(&self, q: &[f64], out: &mut [f64]) -> Result<()> {
        let joints = self.joints.len();
        self.run_batch(
            q,
            out,
            joints * 6,
            "twists (N, joints, 6)",
            #[inline(always)]
            |poses, block| {
                for j in 0..joints {
                    let (angular, linear) = self.joint_twist_lanes(poses, j);
                    for (lane, row) in block.chunks_exact_mut(joints * 6).enumerate() {
                        let twist = &mut row[6 * j..6 * j + 6];
                        for i in 0..3 {
                            twist[i] = angular[i].0[lane];
                            twist[3 + i] = linear[i].0[lane];
                        }
                    }
                }
            },
        )
    }

    /// Where a point of link b is in link a's frame, m, in N postures, (N, 3).
    ///
    /// # Errors
    /// As [`Robot::forward_kinematics_batch`], and an index that is no link.
    pub fn points_batch(
        &self,
        q: &[f64],
        link_a: usize,
        link_b: usize,
        point_in_b: &Point3<f64>,
        out: &mut [f64],
    ) -> Result<()> {
        self.check_pair(link_a, link_b, point_in_b)?;
        self.run_batch(
            q,
            out,
            3,
            "points (N, 3)",
            #[inline(always)]
            |poses, block| {
                let a = &poses.frames[link_a];
                let x = poses.frames[link_b].mapped(point_in_b.coords.as_slice());
                let x_in_a = a.turned_back(&minus(&x, &a.origin));
                for (lane, row) in block.chunks_exact_mut(3).enumerate() {
                    row.copy_from_slice(&lane_of(&x_in_a, lane));
                }
            },
        )
    }

    /// Jacobians of a point of link b as link a sees it, in N postures, (N, 3, nq), as [`Robot::point_jacobian`].
    ///
    /// # Errors
    /// As [`Robot::points_batch`].
    pub fn point_jacobians_batch(
        &self,
        q: &[f64],
        link_a: usize,
        link_b: usize,
        point_in_b: &Point3<f64>,
        out: &mut [f64],
    ) -> Result<()> {
        self.check_pair(link_a, link_b, point_in_b)?;
        let width = self.position_count();
        self.run_batch(
            q,
            out,
            3 * width,
            "Jacobians (N, 3, nq)",
            #[inline(always)]
            |poses, block| {
                block.fill(0.0);
                let a = &poses.frames[link_a];
                let x = poses.frames[link_b].mapped(point_in_b.coords.as_slice());
                self.for_each_between(link_a, link_b, |joint, sign| {
                    let Some(drive) = self.joints[joint].drive else { return };
                    let (angular, linear) = self.joint_twist_lanes(poses, joint);
                    let velocity = sum(&cross(&angular, &x), &linear);
                    let column = scaled(&a.turned_back(&velocity), sign * drive.multiplier);
                    for (lane, row) in block.chunks_exact_mut(3 * width).enumerate() {
                        for i in 0..3 {
                            row[i * width + drive.position] += column[i].0[lane];
                        }
                    }
                });
            },
        )
    }

    /// Generalised gravity forces on q in N postures, (N, nq), N m (N for prismatic joints), as
    /// [`Robot::gravity_loads`]: `−∂V/∂q` while the held link stands still.
    ///
    /// # Errors
    /// As [`Robot::forward_kinematics_batch`], an index that is no link, gravity that is not finite.
    pub fn gravity_torques_batch(
        &self,
        q: &[f64],
        gravity_in_held_link: &Vector3<f64>,
        held_link: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.gravity_batch(q, gravity_in_held_link, held_link, out, false)
    }

    /// Gravity moments about the child link's origin of each joint, in the child link's frame, N m, in N postures: (N, joints, 3),
    /// as [`super::GravityLoad::moment_in_link_nm`].
    ///
    /// # Errors
    /// As [`Robot::gravity_torques_batch`].
    pub fn gravity_moments_batch(
        &self,
        q: &[f64],
        gravity_in_held_link: &Vector3<f64>,
        held_link: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.gravity_batch(q, gravity_in_held_link, held_link, out, true)
    }

    fn gravity_batch(
        &self,
        q: &[f64],
        gravity_in_held_link: &Vector3<f64>,
        held_link: usize,
        out: &mut [f64],
        moments: bool,
    ) -> Result<()> {
        self.check_link("held link", held_link)?;
        for x in gravity_in_held_link.iter() {
            finite("gravity, m/s²", *x)?;
        }
        let width = self.position_count();
        let (each, what) = if moments {
            (3 * self.joints.len(), "moments (N, joints, 3)")
        } else {
            (width, "torques (N, nq)")
        };
        let masses = self.masses_below();
        self.run_batch_with(
            q,
            out,
            each,
            what,
            || vec![[Lane::ZERO; 3]; self.links.len()],
            #[inline(always)]
            |poses, below, block| {
                block.fill(0.0);
                let gravity = poses.frames[held_link].turned(gravity_in_held_link.as_slice());
                self.first_moments_below(poses, below);
                for (j, joint) in self.joints.iter().enumerate() {
                    if !moments && joint.drive.is_none() {
                        continue;
                    }
                    let (mut mass, mut moment, mut sign) = (masses[j + 1], below[j + 1], 1.0);
                    if self.is_below(held_link, j + 1) {
                        (mass, moment, sign) = (masses[0] - mass, minus(&below[0], &moment), -1.0);
                    }
                    let frame = &poses.frames[j + 1];
                    let arm = minus(&moment, &scaled(&frame.origin, mass));
                    let about_origin = scaled(&frame.turned_back(&cross(&arm, &gravity)), sign);
                    if moments {
                        for (lane, row) in block.chunks_exact_mut(each).enumerate() {
                            row[3 * j..3 * j + 3].copy_from_slice(&lane_of(&about_origin, lane));
                        }
                        continue;
                    }
                    let Some(drive) = joint.drive else { continue };
                    let conjugate = if joint.kind == JointKind::Prismatic {
                        scaled(&frame.turned_back(&gravity), sign * mass)
                    } else {
                        about_origin
                    };
                    let a = &joint.axis;
                    let torque =
                        (conjugate[0] * a.x + conjugate[1] * a.y + conjugate[2] * a.z) * drive.multiplier;
                    for (lane, row) in block.chunks_exact_mut(each).enumerate() {
                        row[drive.position] += torque.0[lane];
                    }
                }
            },
        )
    }

    /// Mass of each link and all below it, kg.
    fn masses_below(&self) -> Vec<f64> {
        let mut masses: Vec<f64> = self.links.iter().map(|l| l.mass_kg).collect();
        for joint in self.joints.iter().rev() {
            masses[joint.parent_link] += masses[joint.child_link];
        }
        masses
    }

    /// First mass moment of each link and all below it in the root's frame, kg m.
    #[inline(always)]
    fn first_moments_below(&self, poses: &LanePoses, below: &mut [Lane3]) {
        for ((link, frame), below) in self.links.iter().zip(&poses.frames).zip(below.iter_mut()) {
            *below = scaled(&frame.mapped(link.com_in_link_m.coords.as_slice()), link.mass_kg);
        }
        for joint in self.joints.iter().rev() {
            below[joint.parent_link] = sum(&below[joint.parent_link], &below[joint.child_link]);
        }
    }

    fn check_pair(&self, link_a: usize, link_b: usize, point_in_b: &Point3<f64>) -> Result<()> {
        self.check_link("link a", link_a)?;
        self.check_link("link b", link_b)?;
        for x in point_in_b.iter() {
            finite("coordinate of the point, m", *x)?;
        }
        Ok(())
    }

    fn run_batch(
        &self,
        q: &[f64],
        out: &mut [f64],
        each: usize,
        what: &str,
        write: impl Fn(&LanePoses, &mut [f64]) + Sync,
    ) -> Result<()> {
        self.run_batch_with(
            q,
            out,
            each,
            what,
            || (),
            #[inline(always)]
            |poses, (), block| write(poses, block),
        )
    }

    /// Runs forward kinematics block by block, and `write` on each block's results.
    fn run_batch_with<W>(
        &self,
        q: &[f64],
        out: &mut [f64],
        each: usize,
        what: &str,
        workspace: impl Fn() -> W + Sync,
        write: impl Fn(&LanePoses, &mut W, &mut [f64]) + Sync,
    ) -> Result<()> {
        let width = self.position_count();
        let count = self.check_batch(q, out.len(), each, what)?;
        if count == 0 || each == 0 {
            return Ok(());
        }
        let task = LANES * BLOCKS_A_TASK;
        let new = || (self.new_lane_poses(), workspace());
        if count <= task {
            run_rows(self, q, each, out, &mut new(), &write);
        } else {
            out.par_chunks_mut(task * each).enumerate().for_each_init(new, |workspace, (k, out)| {
                let (start, rows) = (k * task, out.len() / each);
                run_rows(self, &q[start * width..(start + rows) * width], each, out, workspace, &write);
            });
        }
        Ok(())
    }

    /// Number of postures, where positions and output fit.
    fn check_batch(&self, q: &[f64], out: usize, each: usize, what: &str) -> Result<usize> {
        let width = self.position_count();
        // A robot without movable joints has no positions: the length of the output gives the number of postures.
        let count = q.len().checked_div(width).or_else(|| out.checked_div(each)).unwrap_or(0);
        if q.len() != count * width {
            return Err(Error::LengthMismatch {
                what: format!("positions (N, {width}) of robot {:?}", self.name),
                got: q.len(),
                needed: count * width,
            });
        }
        if out != count * each {
            return Err(Error::LengthMismatch { what: what.to_owned(), got: out, needed: count * each });
        }
        if q.iter().map(|x| x * 0.0).sum::<f64>() != 0.0
            && let Some(bad) = q.iter().position(|x| !x.is_finite())
        {
            let joint = &self.joints[self.position_joints[bad % width]].name;
            let what = format!("position of joint {joint:?} in posture (row) {}", bad / width);
            return Err(Error::NotFinite { what, got: q[bad] });
        }
        Ok(count)
    }
}
