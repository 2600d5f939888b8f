//! Sessions spoilt in a known way: what is named, and with which number.
//!
//! Pixels are made by plain arithmetic: `x' = x + 2 (d − n·x) n`, `u = f x'/z' + c`, on points written out here. No estimator,
//! no plane, no camera and no pose of the crate takes part. The mistakes are made by arithmetic on pixels and grids too.

use super::*;
use crate::camera::{Camera, Distortion};
use crate::error::Error;
use crate::mirror::{Board, MirrorOptics};
use crate::random::Random;
use crate::{Cancel, Result};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

const NOISE_PX: f64 = 0.15;
const SQUARE_M: f64 = 0.014;
const FOCAL_PX: f64 = 693.0;
const TILT_RAD: f64 = 0.1;
/// Beside the picture's middle: there a flipped picture and a board counted from its other end look nearly alike.
const ORIGIN_M: [f64; 3] = [0.1, 0.075, 0.01];

type Pixel = [f64; 2];

/// What a session states, and what its pictures show.
#[derive(Clone)]
struct World {
    corners: (usize, usize),
    square_m: f64,
    size: (u32, u32),
    focal_px: f64,
    center: Pixel,
    camera_from_board: Isometry3<f64>,
    /// By view: the corners' pixels, in the order of their index.
    board_px: Vec<Vec<Pixel>>,
    /// By view: a marker's pixel and its place.
    markers: Vec<Vec<(Pixel, [f64; 3])>>,
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The pixel of a point in a mirror.
fn seen(x: [f64; 3], n: [f64; 3], d: f64, center: Pixel) -> Pixel {
    let away = 2.0 * (d - dot(n, x));
    let [x, y, z] = [x[0] + away * n[0], x[1] + away * n[1], x[2] + away * n[2]];
    [FOCAL_PX * x / z + center[0], FOCAL_PX * y / z + center[1]]
}

fn world(corners: (usize, usize), size: (u32, u32), views: usize, seed: u64) -> World {
    let mut random = Random::new(seed);
    let (nx, ny) = corners;
    let center = [f64::from(size.0) / 2.0 - 0.5, f64::from(size.1) / 2.0 - 0.5];
    // The board's axes in the camera frame: turned about y by half a turn, then tilted about x.
    let (s, c) = TILT_RAD.sin_cos();
    let (along_x, along_y) = ([-1.0, 0.0, 0.0], [0.0, c, s]);
    let mut out = World {
        corners,
        square_m: SQUARE_M,
        size,
        focal_px: FOCAL_PX,
        center,
        camera_from_board: pose([along_x, along_y, [0.0, s, -c]]),
        board_px: Vec::new(),
        markers: Vec::new(),
    };
    for _ in 0..views {
        let (yaw, pitch) = (0.5 * random.unit() - 0.25, 0.5 * random.unit() - 0.25);
        let n = [yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos()];
        let d = 0.16 + 0.1 * random.unit();
        let mut noisy = |x: [f64; 3]| {
            let [u, v] = seen(x, n, d, center);
            [u + NOISE_PX * random.normal(), v + NOISE_PX * random.normal()]
        };
        let corner = |index: usize| {
            let (ix, iy) = ((index % nx) as f64, (index / nx) as f64);
            let x = (ix - (nx as f64 - 1.0) / 2.0) * SQUARE_M;
            let y = (iy - (ny as f64 - 1.0) / 2.0) * SQUARE_M;
            core::array::from_fn(|k| ORIGIN_M[k] + x * along_x[k] + y * along_y[k])
        };
        out.board_px.push((0..nx * ny).map(|index| noisy(corner(index))).collect());
        let places = [[0.11, -0.01, 0.05], [0.05, 0.02, 0.03]];
        out.markers.push(places.into_iter().map(|at| (noisy(at), at)).collect());
    }
    out
}

/// Where the model has the board, by its axes.
fn pose(axes: [[f64; 3]; 3]) -> Isometry3<f64> {
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&axes.map(Vector3::from)));
    Isometry3::from_parts(Translation3::from(ORIGIN_M), UnitQuaternion::from_rotation_matrix(&rotation))
}

impl World {
    fn usual() -> Self {
        world((7, 5), (1400, 1200), 6, 1)
    }

    /// The pictures changed, and each board's grid in a detector's other order.
    fn changed(
        mut self,
        change: impl Fn(Pixel) -> Pixel,
        order: impl Fn(usize, usize) -> (usize, usize),
    ) -> Self {
        let (nx, ny) = self.corners;
        for (board, markers) in self.board_px.iter_mut().zip(&mut self.markers) {
            let before = board.clone();
            for (index, pixel) in board.iter_mut().enumerate() {
                let (ix, iy) = order(index % nx, index / nx);
                *pixel = change(before[(iy % ny) * nx + ix % nx]);
            }
            markers.iter_mut().for_each(|(pixel, _)| *pixel = change(*pixel));
        }
        self
    }

    fn views(&self) -> Result<Views> {
        let (focal, center) = (Vector2::repeat(self.focal_px), Vector2::from(self.center));
        let camera = Camera::new(self.size, focal, center, Distortion::None)?;
        let views = self.board_px.iter().zip(&self.markers).map(|(board, markers)| View {
            camera_from_board: self.camera_from_board,
            corners_px: board.iter().flatten().copied().collect(),
            markers: markers
                .iter()
                .map(|(pixel, at)| SeenMarker {
                    pixel: Vector2::from(*pixel),
                    point_in_camera: Point3::from(*at),
                })
                .collect(),
        });
        Views::new(camera, Board::new(self.corners, self.square_m)?, MirrorOptics::IDEAL, views.collect())
    }

    fn checked(&self) -> Result<ViewCheck> {
        check_views(&self.views()?, &ViewCheckOptions { noise_px: NOISE_PX, ..ViewCheckOptions::default() })
    }
}

/// The reading of a name among those that a check tells.
fn reading<'a>(checked: &'a ViewCheck, name: &str) -> Option<&'a Reading> {
    checked.readings.iter().find(|reading| reading.name == name)
}

fn same(ix: usize, iy: usize) -> (usize, usize) {
    (ix, iy)
}

#[test]
fn a_right_session_is_named_nothing_and_fits_to_its_noise() -> Result<()> {
    for (seed, corners) in [(1, (7, 5)), (2, (6, 5)), (3, (4, 4)), (4, (3, 2))] {
        let checked = world(corners, (1400, 1200), 7, seed).checked()?;
        assert_eq!((checked.mistake.as_deref(), checked.readings.len()), (None, 0), "{corners:?}");
        let fit = checked.as_it_stands;
        // Both axes, less the plane's three numbers.
        let count = (corners.0 * corners.1) as f64;
        let expected = NOISE_PX * (2.0 * (1.0 - 1.5 / count)).sqrt();
        assert!((fit.board_rms_px / expected - 1.0).abs() < 0.35, "{corners:?}: {fit:?}");
        assert!(fit.marker_px.is_some_and(|away| away < 3.0), "{corners:?}: {fit:?}");
        assert_eq!(checked.noise_px, NOISE_PX * std::f64::consts::SQRT_2);
    }
    Ok(())
}

#[test]
fn pictures_that_a_driver_changed_are_named_whatever_the_detector_made_of_their_labels() -> Result<()> {
    let (last_u, last_v) = (1399.0, 1199.0);
    for (corners, seed) in [((7, 5), 1), ((6, 5), 2), ((5, 6), 3)] {
        let right = || world(corners, (1400, 1200), 6, seed);
        let (nx, ny) = corners;
        let orders: [&dyn Fn(usize, usize) -> (usize, usize); 3] =
            [&same, &|ix, iy| (nx - 1 - ix, iy), &|ix, iy| (ix, ny - 1 - iy)];
        for order in orders {
            let flipped = right().changed(|[u, v]| [last_u - u, v], order).checked()?;
            assert!(reading(&flipped, "mirrored left-right").is_some(), "{corners:?}: {flipped:?}");
            let flipped = right().changed(|[u, v]| [u, last_v - v], order).checked()?;
            assert!(reading(&flipped, "mirrored up-down").is_some(), "{corners:?}: {flipped:?}");
        }
        let turned = right().changed(|[u, v]| [last_u - u, last_v - v], same).checked()?;
        let named = reading(&turned, "turned by 180°");
        assert_eq!(named.map(|reading| reading.effect), Some(Some("picture_flipped")), "{turned:?}");
    }
    Ok(())
}

#[test]
fn quarters_of_a_square_picture_are_named_by_their_side() -> Result<()> {
    let right = || world((7, 5), (1200, 1200), 6, 5);
    let last = 1199.0;
    // Clockwise: what was at the top left is at the top right.
    let checked = right().changed(|[u, v]| [last - v, u], same).checked()?;
    assert!(reading(&checked, "turned by 90° to the right").is_some(), "{checked:?}");
    let checked = right().changed(|[u, v]| [v, last - u], same).checked()?;
    assert!(reading(&checked, "turned by 90° to the left").is_some(), "{checked:?}");
    assert_eq!(usual_mistakes((7, 5), true).len(), usual_mistakes((7, 5), false).len() + 2);
    Ok(())
}

#[test]
fn boards_mounted_or_counted_otherwise_are_named() -> Result<()> {
    let half = World::usual().changed(|pixel| pixel, |ix, iy| (6 - ix, 4 - iy)).checked()?;
    assert!(reading(&half, "board turned by 180°").is_some(), "{half:?}");
    let counted = World::usual().changed(|pixel| pixel, |ix, iy| (6 - ix, iy)).checked()?;
    assert!(reading(&counted, "labels reversed in x").is_some(), "{counted:?}");
    let counted = World::usual().changed(|pixel| pixel, |ix, iy| (ix, 4 - iy)).checked()?;
    assert!(reading(&counted, "labels reversed in y").is_some(), "{counted:?}");
    // The model's axes are those of a board a quarter further: its x is the meant −y or y.
    let (s, c) = TILT_RAD.sin_cos();
    for (name, sign) in [("board turned by 90°", 1.0), ("board turned by 270°", -1.0)] {
        let mut world = World::usual();
        world.camera_from_board = pose([[0.0, -sign * c, -sign * s], [-sign, 0.0, 0.0], [0.0, s, -c]]);
        let checked = world.checked()?;
        assert!(reading(&checked, name).is_some(), "{name}: {checked:?}");
        assert!(checked.mistake.is_some_and(|said| said.contains("against the URDF")));
    }
    Ok(())
}

#[test]
fn a_cameras_body_taken_for_its_optical_frame_is_named_and_has_no_effect() -> Result<()> {
    let mut world = World::usual();
    // Body: x forward, y left, z up. A point (x, y, z) of the optical frame is (z, −x, −y).
    let body = |[x, y, z]: [f64; 3]| [z, -x, -y];
    let (s, c) = TILT_RAD.sin_cos();
    let mut pose = pose([[-1.0, 0.0, 0.0], [0.0, c, s], [0.0, s, -c]].map(body));
    pose.translation = Translation3::from(body(ORIGIN_M));
    world.camera_from_board = pose;
    world.markers.iter_mut().flatten().for_each(|(_, at)| *at = body(*at));
    let checked = world.checked()?;
    assert_eq!(reading(&checked, "camera body").map(|reading| reading.effect), Some(None), "{checked:?}");
    assert!(checked.mistake.is_some_and(|said| said.contains("not its optical frame")));
    Ok(())
}

#[test]
fn factors_of_board_resolution_and_lens_are_found() -> Result<()> {
    for factor in [0.5, 0.8, 1.3, 2.0] {
        let mut board = World::usual();
        board.square_m /= factor;
        let checked = board.checked()?;
        let named = reading(&checked, "another board");
        assert!(
            named.is_some_and(|r| (r.scale.factor() / factor - 1.0).abs() < 3e-3),
            "{factor}: {checked:?}"
        );
        assert!(named.is_some_and(|r| r.said.contains(&format!("not {:.2} mm", 14.0 / factor))));
        // A camera file of other pixels: the picture's corner at −0.5 px stays.
        let mut camera = World::usual();
        camera.focal_px /= factor;
        camera.center = camera.center.map(|at| (at + 0.5) / factor - 0.5);
        let checked = camera.checked()?;
        let named = reading(&checked, "camera of another resolution");
        assert!(
            named.is_some_and(|r| (r.scale.factor() / factor - 1.0).abs() < 3e-3),
            "{factor}: {checked:?}"
        );
        let mut lens = World::usual();
        lens.focal_px /= factor;
        let checked = lens.checked()?;
        let named = reading(&checked, "camera of another focal length");
        assert!(
            named.is_some_and(|r| (r.scale.factor() / factor - 1.0).abs() < 3e-3),
            "{factor}: {checked:?}"
        );
    }
    Ok(())
}

#[test]
fn what_a_mount_by_hand_leaves_is_no_mistake_and_not_gross() -> Result<()> {
    let mut world = World::usual();
    // Turned in its plane by 1.1°.
    let ((s, c), (sine, cosine)) = (TILT_RAD.sin_cos(), 0.02_f64.sin_cos());
    let (along_x, along_y) = ([-cosine, sine * c, sine * s], [sine, cosine * c, cosine * s]);
    world.camera_from_board = pose([along_x, along_y, [0.0, s, -c]]);
    let checked = world.checked()?;
    assert_eq!(checked.mistake, None);
    assert!(checked.as_it_stands.board_rms_px > 2.0 * checked.noise_px, "it was doubted: {checked:?}");
    // A factor that leaves less than twenty deviations is named, but not where only gross mistakes are asked for.
    let mut board = World::usual();
    board.square_m *= 1.25;
    let views = board.views()?;
    let options = |gross| ViewCheckOptions { noise_px: NOISE_PX, gross, ..ViewCheckOptions::default() };
    let (all, gross) = (check_views(&views, &options(false))?, check_views(&views, &options(true))?);
    assert!(reading(&all, "another board").is_some(), "{all:?}");
    assert_eq!((gross.as_it_stands, gross.mistake), (all.as_it_stands, None));
    let half = World::usual().changed(|pixel| pixel, |ix, iy| (6 - ix, 4 - iy));
    assert!(check_views(&half.views()?, &options(true))?.mistake.is_some(), "it is gross");
    Ok(())
}

#[test]
fn views_that_nothing_explains_are_told_by_an_infinite_residual() -> Result<()> {
    let mut world = World::usual();
    for board in &mut world.board_px {
        board.iter_mut().skip(3).for_each(|pixel| *pixel = [f64::NAN; 2]);
    }
    let checked = world.checked()?;
    assert_eq!(checked.as_it_stands, Fit { board_rms_px: f64::INFINITY, marker_px: None });
    assert_eq!((checked.mistake, checked.readings.len()), (None, 0));
    // Half a pair spoils its view alone; one that is hidden spoils nothing.
    let mut world = World::usual();
    world.board_px[0][3] = [f64::NAN, 4.0];
    world.board_px[1][7] = [f64::NAN; 2];
    world.markers[2][0].0 = [f64::NAN, 7.0];
    world.markers[3][1].1 = [f64::INFINITY, 0.0, 0.0];
    let checked = world.checked()?;
    assert!(checked.mistake.is_none() && checked.as_it_stands.board_rms_px < 0.3, "{checked:?}");
    assert!(checked.as_it_stands.marker_px.is_some_and(|away| away < 3.0), "{checked:?}");
    Ok(())
}

#[test]
fn one_view_is_enough_and_a_hidden_corner_is_found_under_its_label() -> Result<()> {
    let mut world = world((7, 5), (1400, 1200), 1, 9);
    assert!(world.checked()?.as_it_stands.board_rms_px < 0.3);
    world.board_px[0][2] = [f64::NAN; 2];
    let checked = world.changed(|[u, v]| [1399.0 - u, v], |ix, iy| (6 - ix, iy)).checked()?;
    assert!(reading(&checked, "mirrored left-right").is_some(), "{checked:?}");
    Ok(())
}

#[test]
fn what_makes_no_check_is_refused() -> Result<()> {
    let mut none = World::usual();
    none.board_px.clear();
    assert!(matches!(none.checked(), Err(Error::TooFew { got: 0, .. })));
    let mut short = World::usual();
    short.board_px[2].pop();
    assert!(matches!(short.checked(), Err(Error::LengthMismatch { got: 68, needed: 70, .. })));
    for noise_px in [0.0, -1.0, f64::NAN] {
        let options = ViewCheckOptions { noise_px, ..ViewCheckOptions::default() };
        assert!(check_views(&World::usual().views()?, &options).is_err(), "{noise_px}");
    }
    // A factor of four makes no square of it.
    let mut huge = World::usual();
    huge.square_m = 1e308;
    assert!(matches!(huge.checked(), Err(Error::NotFinite { .. })), "{:?}", huge.checked());
    let cancel = Cancel::new();
    cancel.cancel();
    let options = ViewCheckOptions { cancel, ..ViewCheckOptions::default() };
    assert_eq!(check_views(&World::usual().views()?, &options), Err(Error::Cancelled));
    Ok(())
}
