//! Where the estimation of a frame's mirror starts: the plane half-way between the board and its reflection, Eq. 2 of the
//! paper, `n ∝ b′ − b`, `d = n·(b + b′)/2`, with b the middle of the corners and b′ its reflection.

use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::Guard;
use crate::geometry::Plane;
use crate::mirror::{SeenCorner, closed_form_poses};
use nalgebra::{Point2, Point3, Vector3};

/// A mirror nearer to the camera than this is none, m.
const NEAREST_M: Guard = 1e-3;

/// The foot point of the plane half-way between two points of the camera's frame; none where the camera is behind it.
fn half_way(board: &Vector3<f64>, reflected: &Vector3<f64>) -> Option<Vector3<f64>> {
    let plane = Plane::between(&Point3::from(*board), &Point3::from(*reflected)).ok()?;
    (plane.offset_m() > NEAREST_M).then(|| plane.foot_point())
}

/// By the closed form of a plane's pose, in which the middle of the corners has its depth whatever the board's tilt.
///
/// The size of the picture alone is no depth: a board that is seen at 45° is a third smaller, and looks a decimetre farther away.
/// A fit that starts there needs a dozen damped steps, and does not always come back.
pub(super) fn by_closed_form(
    problem: &Problem,
    eye: &Eye,
    camera_from_board: &Pose,
    frame: usize,
) -> Option<Vector3<f64>> {
    let of = |(index, pixel): &(usize, _)| {
        let at = problem.corners[*index];
        SeenCorner { index: *index, point_in_board: Point2::new(at.x, at.y), pixel: *pixel }
    };
    let corners: Vec<SeenCorner> = problem.frames[frame].corners.iter().map(of).collect();
    let middle = corners.iter().map(|c| c.point_in_board.coords).sum::<nalgebra::Vector2<f64>>()
        / corners.len().max(1) as f64;
    // Both poses have the middle at the same place.
    let [pose, _] = closed_form_poses(&eye.camera, &corners).ok()?;
    let middle = Vector3::new(middle.x, middle.y, 0.0);
    half_way(&camera_from_board.point(&middle), &(pose * Point3::from(middle)).coords)
}

/// By the size of the picture: the reflection is in the direction of the corners' mean, at the depth that corresponds to its
/// size if the board faces the camera. For corners that show no homography.
pub(super) fn by_size(
    problem: &Problem,
    eye: &Eye,
    camera_from_board: &Pose,
    frame: usize,
) -> Option<Vector3<f64>> {
    let corners = &problem.frames[frame].corners;
    let count = corners.len() as f64;
    let mut directions = Vec::with_capacity(corners.len());
    for (index, pixel) in corners {
        directions.push((problem.corners[*index], eye.camera.unproject(pixel).ok()?.into_inner()));
    }
    let mean = directions.iter().map(|d| d.1).sum::<Vector3<f64>>() / count;
    let center = directions.iter().map(|d| d.0).sum::<Vector3<f64>>() / count;
    let spread_angle = (directions.iter().map(|d| (d.1 - mean).norm_squared()).sum::<f64>() / count).sqrt();
    let spread = (directions.iter().map(|d| (d.0 - center).norm_squared()).sum::<f64>() / count).sqrt();
    let reflected = mean.normalize() * (spread / spread_angle.max(1e-9));
    half_way(&camera_from_board.point(&center), &reflected)
}
