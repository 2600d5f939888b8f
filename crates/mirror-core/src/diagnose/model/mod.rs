//! The forward model: from a posture and a deformation to pixels, with derivatives.

pub(super) mod body;
pub(super) mod camera_and_mirror;
pub(super) mod deformation;
pub(super) mod elementary;
pub(super) mod false_corners;
pub(super) mod frame;
pub(super) mod free_optics;
pub(super) mod free_values;
pub(super) mod kinematics;
pub(super) mod link_bends;
pub(super) mod mistake_parameters;
pub(super) mod pose;
pub(super) mod possible_loads;
pub(super) mod problem;
pub(super) mod robust;
pub(super) mod scene;
pub(super) mod sites;
pub(super) mod slips;
pub(super) mod solver;
pub(super) mod start;
pub(super) mod telescope;
pub(super) mod work_budget;
