//! The target of a correction: the markers of a posture, and the joints that may move for it.

use super::limits::position_limits;
use crate::error::{Error, Result};
use crate::robot::Robot;
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

/// The posture to be reached, as positions of markers in the board's frame, and what may move.
#[derive(Debug, Clone)]
pub struct Target {
    pub(super) robot: Arc<Robot>,
    pub(super) frame_link: usize,
    pub(super) marker_links: Vec<usize>,
    pub(super) marker_names: Vec<String>,
    pub(super) posture: Vec<f64>,
    pub(super) point_in_frame_m: Vec<Vector3<f64>>,
    pub(super) free: Vec<bool>,
    pub(super) limits: Vec<(f64, f64)>,
}

impl Target {
    /// The target `p_ref`: the markers' positions by the model at `posture`, in the frame of `board_link`.
    ///
    /// `markers` are names and links; `posture` has an entry for each position of the robot, rad (m). The joints
    /// between the board and a marker may move, except those between the camera and the board (the measurement
    /// depends on them) and `held` (indices into the positions). Limits are the model's, those of joints that
    /// follow (mimic) included.
    ///
    /// # Errors
    /// No marker, a posture of the wrong length or outside the limits (by the joint's name), an invalid link index,
    /// no joint left that may move.
    pub fn new(
        robot: Arc<Robot>,
        camera_link: usize,
        board_link: usize,
        markers: &[(String, usize)],
        posture: &[f64],
        held: &[usize],
    ) -> Result<Self> {
        if markers.is_empty() {
            return Err(Error::TooFew { what: "markers of a correction".to_owned(), got: 0, needed: 1 });
        }
        let poses = robot.poses(posture)?;
        let mut free = vec![false; robot.position_count()];
        let mut point_in_frame_m = Vec::with_capacity(markers.len());
        for (_, link) in markers {
            for step in robot.chain(board_link, *link)?.steps {
                if let Some(drive) = robot.joints()[step.joint].drive {
                    free[drive.position] = true;
                }
            }
            point_in_frame_m.push(poses.point_in_a(board_link, *link, &Point3::origin()).coords);
        }
        for step in robot.chain(camera_link, board_link)?.steps {
            if let Some(drive) = robot.joints()[step.joint].drive {
                free[drive.position] = false;
            }
        }
        for &position in held {
            let Some(one) = free.get_mut(position) else {
                return Err(Error::OutOfRange {
                    what: "held joint".to_owned(),
                    got: position as f64,
                    needed: format!("an index below {}", robot.position_count()),
                });
            };
            *one = false;
        }
        if !free.contains(&true) {
            return Err(Error::TooFew {
                what: "joints that may move for this target (between board and markers, not held)".to_owned(),
                got: 0,
                needed: 1,
            });
        }
        let limits = position_limits(&robot);
        for (index, name) in robot.position_names().enumerate() {
            let (lower, upper) = limits[index];
            if free[index] && !(posture[index] >= lower && posture[index] <= upper) {
                return Err(Error::OutOfRange {
                    what: format!("target posture, joint {name:?}"),
                    got: posture[index],
                    needed: format!("{lower:.4} to {upper:.4}, its limits; choose a target within them"),
                });
            }
        }
        let (marker_names, marker_links) = markers.iter().cloned().unzip();
        Ok(Self {
            robot,
            frame_link: board_link,
            marker_links,
            marker_names,
            posture: posture.to_vec(),
            point_in_frame_m,
            free,
            limits,
        })
    }

    /// Where each marker is to be, in the board's frame, m.
    pub fn point_in_frame_m(&self) -> &[Vector3<f64>] {
        &self.point_in_frame_m
    }

    /// Which positions may move.
    pub fn free(&self) -> &[bool] {
        &self.free
    }
}
