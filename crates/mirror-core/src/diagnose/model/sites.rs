//! Poses of camera, board and markers in a frame; a part that slipped has another pose from a row on.

use crate::diagnose::model::body::Site;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::slips::{Slip, Slipped, pose_of};
use nalgebra::Vector3;

impl Problem {
    /// The camera's site in a frame.
    #[inline]
    pub fn camera_in(&self, frame: usize) -> Option<Site> {
        self.camera_site.map(|site| self.slipped(site, Slipped::Camera, frame))
    }

    /// The board's site in a frame.
    #[inline]
    pub fn board_in(&self, frame: usize) -> Option<Site> {
        self.board.map(|site| self.slipped(site, Slipped::Board, frame))
    }

    /// By how much a marker has slipped in a frame, in the frame of its mount's link, m.
    #[inline]
    pub fn marker_slip_in(&self, frame: usize, marker: usize) -> Vector3<f64> {
        let of = |s: &&Slip| s.what == Slipped::Marker(marker) && frame >= s.first;
        self.slips.iter().filter(of).map(|s| s.motion.fixed_rows::<3>(3).into_owned()).sum()
    }

    fn slipped(&self, mut site: Site, what: Slipped, frame: usize) -> Site {
        for slip in self.slips.iter().filter(|s| s.what == what && frame >= s.first) {
            site.node_from_site = site.node_from_site.then(&pose_of(&slip.motion));
        }
        site
    }
}
