//! The joint estimator against simulated sessions (by formulas of its own) and against the single-view estimators.

use crate::traced::{Eye, Glass, noisy};
use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::Ray;
use mirror_core::geometry::rotation::difference;
use mirror_core::joint::{
    BoardPrior, JointEstimate, JointFrame, JointOptions, MarkerSighting, PointStatus, Via, joint_estimate,
};
use mirror_core::mirror::{
    Board, BoardView, EstimatorOptions, GlassPane, Loss, MirrorEstimator, MirrorOptics, Rig, virtual_ray,
};
use mirror_core::{Cancel, Error};
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, UnitQuaternion, Vector2, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const NOISE_PX: f64 = 0.2;

fn camera() -> Camera {
    Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), Distortion::None).unwrap()
}

fn board() -> Board {
    Board::new((7, 5), 0.014).unwrap()
}

/// Board 75 mm below the camera, facing as it does.
fn true_camera_from_board() -> Isometry3<f64> {
    Isometry3::from_parts(Vector3::new(0.0, 0.075, 0.0).into(), UnitQuaternion::identity())
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A mirror d metres before the camera, turned by yaw and pitch (degrees).
fn mirror(yaw_deg: f64, pitch_deg: f64, d: f64) -> Glass {
    Glass::turned(Vector3::new(0.0, 0.0, d), yaw_deg.to_radians(), pitch_deg.to_radians())
}

/// Five mirrors in a cross of yaw and pitch.
fn cross(d: f64) -> Vec<Glass> {
    [(0.0, 0.0), (-15.0, 0.0), (15.0, 0.0), (0.0, 10.0), (0.0, -10.0)].map(|(y, p)| mirror(y, p, d)).to_vec()
}

fn corner_places() -> Vec<Vector3<f64>> {
    (0..35)
        .map(|i| Vector3::new((f64::from(i % 7) - 3.0) * 0.014, (f64::from(i / 7) - 2.0) * 0.014, 0.0))
        .collect()
}

/// Noise-free pictures of postures, each in the same mirrors: corners and markers by frame.
struct Scene {
    mirrors: usize,
    corners: Vec<Vec<Vector2<f64>>>,
    markers: Vec<Vec<Vector2<f64>>>,
    /// By posture, then marker.
    truth: Vec<Vec<Vector3<f64>>>,
}

fn scene(mirrors: &[Glass], truth: &[Vec<Vector3<f64>>]) -> Scene {
    let eye = Eye::of_the_paper();
    let board = true_camera_from_board();
    let (mut corners, mut markers) = (Vec::new(), Vec::new());
    for places in truth {
        for mirror in mirrors {
            corners.push(
                corner_places()
                    .iter()
                    .map(|c| eye.pixel_in(mirror, &(board * Point3::from(*c)).coords))
                    .collect(),
            );
            markers.push(places.iter().map(|p| eye.pixel_in(mirror, p)).collect());
        }
    }
    Scene { mirrors: mirrors.len(), corners, markers, truth: truth.to_vec() }
}

impl Scene {
    /// The pictures with noise, given to an estimator that believes a nominal transform.
    fn frames(&self, nominal: Isometry3<f64>, rng: &mut ChaCha8Rng) -> Vec<JointFrame> {
        self.corners
            .iter()
            .zip(&self.markers)
            .enumerate()
            .map(|(frame, (corners, markers))| {
                let pixels: Vec<_> = corners.iter().map(|p| noisy(p, NOISE_PX, rng)).collect();
                JointFrame {
                    posture: (frame / self.mirrors) as i64,
                    nominal_camera_from_board: nominal,
                    corners: BoardView::complete(&board(), &pixels).unwrap(),
                    markers: markers
                        .iter()
                        .enumerate()
                        .map(|(marker, p)| MarkerSighting {
                            marker,
                            pixel: noisy(p, NOISE_PX, rng),
                            via: Via::Mirror,
                        })
                        .collect(),
                }
            })
            .collect()
    }

    fn true_points(&self) -> impl Iterator<Item = &Vector3<f64>> {
        self.truth.iter().flatten()
    }
}

fn options() -> JointOptions {
    JointOptions {
        corner_std_px: NOISE_PX,
        marker_std_px: NOISE_PX,
        loss: Loss::Squared,
        ..JointOptions::default()
    }
}

fn estimate(frames: &[JointFrame], markers: usize, options: &JointOptions) -> JointEstimate {
    joint_estimate(&camera(), &board(), &vec![0.0; markers], frames, options).unwrap()
}

const ROTATION_STD_RAD: f64 = 0.3 * std::f64::consts::PI / 180.0;

/// The nominal transform off by a normal error of 0.3° and 0.5 mm about each axis.
fn disturbed(rng: &mut ChaCha8Rng) -> (Isometry3<f64>, BoardPrior) {
    let (rotation, translation) = (ROTATION_STD_RAD, 0.0005);
    let error = Vector6::from_fn(|i, _| normal(rng) * if i < 3 { rotation } else { translation });
    // The estimator's prior stands at the nominal transform: the truth is the nominal one moved.
    let away = Isometry3::from_parts(
        Vector3::new(error[3], error[4], error[5]).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(error[0], error[1], error[2])),
    );
    (true_camera_from_board() * away.inverse(), BoardPrior::isotropic(rotation, translation))
}

fn single_view(frame: &JointFrame, estimator: MirrorEstimator) -> Ray {
    let rig = Rig::new(camera(), board(), frame.nominal_camera_from_board);
    let estimate = estimator.estimate(&rig, &frame.corners, &EstimatorOptions::default()).unwrap();
    estimate.virtual_camera().ray(&camera(), &frame.markers[0].pixel, NOISE_PX).unwrap().ray
}

/// The least-squares point of the single-view planes' virtual rays.
fn single_view_point(frames: &[JointFrame], estimator: MirrorEstimator) -> Vector3<f64> {
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for frame in frames {
        let ray = single_view(frame, estimator);
        let r = ray.direction.into_inner();
        let across = Matrix3::identity() - r * r.transpose();
        matrix += across;
        right += across * ray.origin.coords;
    }
    matrix.try_inverse().unwrap() * right
}

fn hand() -> Vector3<f64> {
    Vector3::new(0.06, 0.05, 0.03)
}

/// Mean of normalised squared errors of k dimensions against 1 ± 4 standard errors, and coverage of the 95 % region.
fn assert_chi_squared(what: &str, squares: &[f64], dimensions: f64, quantile95: f64) {
    let n = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / n;
    let slack = 4.0 * (2.0 * dimensions / n).sqrt();
    assert!(
        (mean - dimensions).abs() < slack,
        "{what}: mean {mean:.3}, needed {dimensions} within {slack:.3}"
    );
    let covered = squares.iter().filter(|s| **s < quantile95).count() as f64 / n;
    assert!((0.93..=0.97).contains(&covered), "{what}: the 95 % region covers {covered:.3}");
}

#[test]
fn it_beats_the_single_view_estimators_where_the_board_transform_is_uncertain() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    // Ceilings on joint/ML: 0.70/0.85 from two views, 0.51/0.72 from five; and on the error itself, mm.
    for (mirrors, ratio, ceiling_mm) in
        [(vec![mirror(-7.5, 0.0, 0.15), mirror(7.5, 0.0, 0.15)], 0.83, 0.70), (cross(0.15), 0.71, 0.51)]
    {
        let scene = scene(&mirrors, &[vec![hand()]]);
        let trials = 400;
        let mut sums = [0.0; 3];
        for _ in 0..trials {
            let (nominal, prior) = disturbed(&mut rng);
            let frames = scene.frames(nominal, &mut rng);
            let joint = estimate(&frames, 1, &JointOptions { prior, ..options() });
            sums[0] += (joint.points[0].point_in_camera.unwrap().coords - hand()).norm();
            sums[1] += (single_view_point(&frames, MirrorEstimator::PointPair) - hand()).norm();
            sums[2] += (single_view_point(&frames, MirrorEstimator::MaximumLikelihood) - hand()).norm();
        }
        let [joint, pair, ml] = sums.map(|s| s / f64::from(trials) * 1e3);
        println!("{} views: joint {joint:.3}, Eq. 2 {pair:.3}, ML {ml:.3} mm", mirrors.len());
        assert!(joint < ratio * ml && joint < ratio * pair && joint < ceiling_mm, "{joint} {pair} {ml}");
    }
}

#[test]
fn with_the_transform_known_it_is_at_or_below_the_others_at_every_distance() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    for distance in [0.15, 0.20, 0.25, 0.30] {
        let scene = scene(&[mirror(0.0, 0.0, distance), mirror(15.0, 0.0, distance)], &[vec![hand()]]);
        let trials = 200;
        let (mut joint_ray, mut joint_point) = (0.0, 0.0);
        let (mut rays, mut points) = ([0.0; 4], [0.0; 4]);
        for _ in 0..trials {
            let frames = scene.frames(true_camera_from_board(), &mut rng);
            let joint = estimate(&frames, 1, &JointOptions { prior: BoardPrior::Exact, ..options() });
            let ray = virtual_ray(&camera(), &joint.planes[0], &frames[0].markers[0].pixel).unwrap();
            joint_ray += ray.distance_m(&hand().into());
            joint_point += (joint.points[0].point_in_camera.unwrap().coords - hand()).norm();
            for (i, estimator) in MirrorEstimator::ALL.into_iter().enumerate() {
                rays[i] += single_view(&frames[0], estimator).distance_m(&hand().into());
                points[i] += (single_view_point(&frames, estimator) - hand()).norm();
            }
        }
        let scale = 1e3 / f64::from(trials);
        println!(
            "{distance} m, mm: ray {:.3} (joint), {:?}; point {:.3} (joint), {:?}",
            joint_ray * scale,
            rays.map(|r| r * scale),
            joint_point * scale,
            points.map(|r| r * scale)
        );
        assert!(rays.iter().all(|r| joint_ray <= *r));
        // Of the point, two views and an exact transform leave one degree of freedom to weigh: the single-view maximum
        // likelihood is then all but the same estimate, and Monte-Carlo noise decides the third digit.
        assert!(points.iter().all(|p| joint_point <= p * 1.01));
    }
}

#[test]
fn its_covariances_are_those_of_its_errors() {
    let mut rng = ChaCha8Rng::seed_from_u64(23);
    let truth =
        [vec![hand(), Vector3::new(-0.05, 0.06, 0.02)], vec![Vector3::new(0.03, 0.02, 0.05), hand() * 0.8]];
    let mirrors = [mirror(-8.0, 3.0, 0.15), mirror(9.0, -4.0, 0.17), mirror(0.0, 8.0, 0.14)];
    let scene = scene(&mirrors, &truth);
    let (mut planes, mut points, mut transforms, mut costs) = (vec![], vec![], vec![], vec![]);
    let mut degrees_of_freedom = 0;
    for _ in 0..1000 {
        let (nominal, prior) = disturbed(&mut rng);
        let frames = scene.frames(nominal, &mut rng);
        let joint = estimate(&frames, 2, &JointOptions { prior, ..options() });
        // The plane's foot from the mirror's point and edges.
        let glass = mirrors[1];
        let n = glass.edges[0].cross(&glass.edges[1]);
        let error = joint.planes[1].foot_point() - n * n.dot(&glass.at);
        planes.push(error.dot(&(joint.plane_covariances_m2[1].try_inverse().unwrap() * error)));
        for (point, at) in joint.points.iter().zip(scene.true_points()).skip(1).take(1) {
            let error = point.point_in_camera.unwrap().coords - at;
            points.push(error.dot(&(point.covariance_m2.unwrap().try_inverse().unwrap() * error)));
        }
        let error = difference(&true_camera_from_board(), &joint.camera_from_board[0]);
        transforms.push(error.dot(&(joint.camera_from_board_covariance.try_inverse().unwrap() * error)));
        costs.push(joint.chi_squared);
        degrees_of_freedom = joint.degrees_of_freedom;
    }
    assert_chi_squared("planes", &planes, 3.0, 7.815);
    assert_chi_squared("points", &points, 3.0, 7.815);
    assert_chi_squared("camera_from_board", &transforms, 6.0, 12.592);
    assert_eq!(degrees_of_freedom, 2 * (6 * 35 + 12) - 3 * 6 - 3 * 4);
    let mean = costs.iter().sum::<f64>() / 1000.0;
    let expected = degrees_of_freedom as f64;
    assert!((mean - expected).abs() < 4.0 * (2.0 * expected / 1000.0).sqrt(), "{mean} {expected}");
}

#[test]
fn a_transform_of_which_nothing_is_known_costs_six_degrees_of_freedom() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let scene = scene(&cross(0.15), &[vec![hand()]]);
    let unknown = JointOptions { prior: BoardPrior::Unknown, ..options() };
    const TRIALS: f64 = 250.0;
    let (mut sum, mut freedom) = (0.0, 0);
    for _ in 0..TRIALS as usize {
        let joint = estimate(&scene.frames(true_camera_from_board(), &mut rng), 1, &unknown);
        (sum, freedom) = (sum + joint.chi_squared, joint.degrees_of_freedom);
    }
    assert_eq!(freedom, 2 * (5 * 35 + 5) - 3 * 5 - 3 - 6);
    let expected = freedom as f64;
    let off = (sum / TRIALS - expected).abs();
    assert!(off < 3.0 * (2.0 * expected / TRIALS).sqrt(), "{} {expected}", sum / TRIALS);
}

#[test]
fn a_head_that_turns_between_postures_is_followed() {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    let scene = scene(&cross(0.15), &[vec![hand()], vec![hand() * 0.8]]);
    // The simulated board stays where it is in the camera frame; the model believes in another place in the second
    // posture, and says by how much. Both nominal transforms are off by the same error on the camera's side.
    let off = Isometry3::new(Vector3::new(0.001, -0.0008, 0.0006), Vector3::new(0.004, -0.003, 0.005));
    let mut frames = scene.frames(off * true_camera_from_board(), &mut rng);
    let turned = Isometry3::rotation(Vector3::new(0.0, 0.0, std::f64::consts::PI));
    for frame in &mut frames[5..] {
        // The board turned by half a turn in its plane: its labels run backwards.
        frame.nominal_camera_from_board *= turned;
        let pixels: Vec<_> = frame.corners.corners().iter().rev().map(|c| c.pixel).collect();
        frame.corners = BoardView::complete(&board(), &pixels).unwrap();
    }
    let joint = estimate(&frames, 1, &options());
    for (transform, expected) in [(0, true_camera_from_board()), (7, true_camera_from_board() * turned)] {
        let error = difference(&joint.camera_from_board[transform], &expected);
        assert!(
            error.fixed_rows::<3>(0).norm() < 0.01 && error.fixed_rows::<3>(3).norm() < 0.0015,
            "{error}"
        );
    }
    assert!(joint.corner_rms_px.iter().all(|rms| *rms < 1.6 * NOISE_PX));
}

/// Markers stand still in the camera frame of one posture, so its head must too.
#[test]
fn a_head_that_turns_within_a_posture_is_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(26);
    let mut frames =
        scene(&cross(0.15), &[vec![hand()], vec![hand()]]).frames(true_camera_from_board(), &mut rng);
    let turned = Isometry3::rotation(Vector3::new(0.0, 0.01, 0.0));
    frames[7].nominal_camera_from_board = turned * frames[7].nominal_camera_from_board;
    let found = joint_estimate(&camera(), &board(), &[0.0], &frames, &options());
    assert!(matches!(found, Err(Error::HeadMoved { posture: 1, by }) if by > 0.009), "{found:?}");
    frames[7].posture = 2;
    assert!(joint_estimate(&camera(), &board(), &[0.0], &frames, &options()).is_ok());
}

#[test]
fn outliers_lose_their_pull() {
    let mut rng = ChaCha8Rng::seed_from_u64(25);
    let scene = scene(&cross(0.15), &[vec![hand()]]);
    let mut errors = [0.0; 2];
    for _ in 0..20 {
        let (nominal, prior) = disturbed(&mut rng);
        let mut frames = scene.frames(nominal, &mut rng);
        // One marker sighting 12 px off, a tenth of the corners of a frame 5 px off.
        frames[2].markers[0].pixel += Vector2::new(12.0, -3.0);
        let mut pixels: Vec<_> = frames[1].corners.corners().iter().map(|c| c.pixel).collect();
        for pixel in pixels.iter_mut().step_by(10) {
            pixel.x += 5.0;
        }
        frames[1].corners = BoardView::complete(&board(), &pixels).unwrap();
        for (error, loss) in errors.iter_mut().zip([Loss::Squared, Loss::Cauchy { threshold: 3.0 }]) {
            let joint = estimate(&frames, 1, &JointOptions { prior, loss, ..options() });
            *error += (joint.points[0].point_in_camera.unwrap().coords - hand()).norm() / 20.0;
        }
    }
    assert!(errors[1] < 0.0007 && errors[1] < 0.5 * errors[0], "squared, Cauchy (m): {errors:?}");
}

#[test]
fn a_marker_that_cannot_be_had_is_masked_with_its_reason() {
    let mut rng = ChaCha8Rng::seed_from_u64(26);
    let mut scene =
        scene(&[mirror(0.0, 0.0, 0.15), mirror(0.0, 0.0, 0.15)], &[vec![hand(), hand() * 0.7, hand()]]);
    scene.markers[1].truncate(2);
    // Seen at two places of the same mirror: the rays part before it.
    let mut frames = scene.frames(true_camera_from_board(), &mut rng);
    frames[1].markers[1].pixel.x -= 60.0;
    frames[0].markers[1].pixel.x += 60.0;
    let joint = estimate(&frames, 3, &options());
    assert!(
        matches!(joint.points[0].status, PointStatus::TooLittleParallax { got_rad, .. } if got_rad < 0.008)
    );
    assert!(matches!(joint.points[1].status, PointStatus::WrongSide | PointStatus::Measured));
    assert_eq!(joint.points[2].status, PointStatus::TooFewViews { views: 1 });
    for point in joint.points.iter().filter(|p| p.status != PointStatus::Measured) {
        assert!(point.point_in_camera.is_none() && point.covariance_m2.is_none());
    }
}

#[test]
fn a_direct_view_and_a_reflection_are_two_views() {
    let mut rng = ChaCha8Rng::seed_from_u64(27);
    let at = Vector3::new(0.03, 0.02, 0.08);
    let scene = scene(&[mirror(5.0, 0.0, 0.15)], &[vec![at]]);
    let mut frames = scene.frames(true_camera_from_board(), &mut rng);
    let direct = noisy(&Eye::of_the_paper().pixel(&at), NOISE_PX, &mut rng);
    frames[0].markers.push(MarkerSighting { marker: 0, pixel: direct, via: Via::Direct });
    let joint = estimate(&frames, 1, &JointOptions { prior: BoardPrior::Exact, ..options() });
    let error = joint.points[0].point_in_camera.unwrap().coords - at;
    let squared = error.dot(&(joint.points[0].covariance_m2.unwrap().try_inverse().unwrap() * error));
    assert!(error.norm() < 0.0005 && squared < 16.3, "{error} {squared}");
}

#[test]
fn what_cannot_be_determined_is_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(28);
    let scene = scene(&[mirror(0.0, 0.0, 0.15)], &[vec![hand()]]);
    let frames = scene.frames(true_camera_from_board(), &mut rng);
    let refuse = |frames: &[JointFrame], markers: usize, options: &JointOptions| {
        joint_estimate(&camera(), &board(), &vec![0.0; markers], frames, options).unwrap_err().to_string()
    };
    // One view cannot show the transform.
    let unknown = JointOptions { prior: BoardPrior::Unknown, ..options() };
    assert!(refuse(&frames, 1, &unknown).contains("determine"));
    assert!(refuse(&[], 1, &options()).contains("frames"));
    assert!(refuse(&frames, 0, &options()).contains("marker of frame 0"));
    assert!(refuse(&frames, 1, &JointOptions { corner_std_px: 0.0, ..options() }).contains("corner"));
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(refuse(&frames, 1, &JointOptions { cancel, ..options() }).contains("as was asked"));
    let indefinite = BoardPrior::Covariance(-Matrix6::identity());
    assert!(refuse(&frames, 1, &JointOptions { prior: indefinite, ..options() }).contains("prior"));
    let mut broken = frames.clone();
    broken[0].markers[0].pixel.x = f64::NAN;
    assert!(refuse(&broken, 1, &options()).contains("marker 0 in frame 0"));
    // A nominal transform that puts the board behind its own reflection.
    broken[0] =
        JointFrame { nominal_camera_from_board: Isometry3::translation(0.0, 0.0, 1.0), ..frames[0].clone() };
    assert!(refuse(&broken, 1, &options()).starts_with("view 0: "));
}

/// Corners and markers traced through a pane, or balls cast ray by ray: what is known of both belongs into the model.
#[test]
fn glass_and_balls_are_modelled() {
    let truth = hand();
    let ball_m = 0.0116;
    let (thickness, index) = (0.003, 1.52);
    let mirrors = [mirror(-8.0, 3.0, 0.15), mirror(9.0, -4.0, 0.17), mirror(0.0, 8.0, 0.14)];
    let eye = Eye::of_the_paper();
    let frames_with = |pane: f64, ball: f64| -> Vec<JointFrame> {
        mirrors
            .iter()
            .map(|glass| {
                let n = glass.edges[0].cross(&glass.edges[1]);
                let trace = |r| crate::glass::trace_pane(r, n, n.dot(&glass.at), pane, index);
                let pixel = |p: Vector3<f64>| {
                    let start = glass.bounce(&Vector3::zeros(), &p);
                    eye.pixel(&crate::glass::shoot(p, start, trace))
                };
                let corners: Vec<_> = corner_places()
                    .iter()
                    .map(|c| pixel((true_camera_from_board() * Point3::from(*c)).coords))
                    .collect();
                let seen = if ball > 0.0 {
                    let behind = truth + n * (2.0 * n.dot(&(glass.at - truth)));
                    crate::sphere::cast_centroid(&camera(), behind.into(), ball / 2.0)
                } else {
                    pixel(truth)
                };
                JointFrame {
                    posture: 7,
                    nominal_camera_from_board: true_camera_from_board(),
                    corners: BoardView::complete(&board(), &corners).unwrap(),
                    markers: vec![MarkerSighting { marker: 0, pixel: seen, via: Via::Mirror }],
                }
            })
            .collect()
    };
    let error = |frames: &[JointFrame], diameter: f64, pane: f64| {
        let optics = MirrorOptics::of_glass(GlassPane::new(pane, index).unwrap());
        let options = JointOptions { prior: BoardPrior::Exact, optics, ..options() };
        let joint = joint_estimate(&camera(), &board(), &[diameter], frames, &options).unwrap();
        assert_eq!(joint.points[0].posture, 7);
        (joint.points[0].point_in_camera.unwrap().coords - truth).norm()
    };
    let behind_glass = frames_with(thickness, 0.0);
    let (known, ignored) = (error(&behind_glass, 0.0, thickness), error(&behind_glass, 0.0, 0.0));
    assert!(known < 1e-8 && ignored > 1e-5, "glass known {known:e} m, ignored {ignored:e} m");
    let balls = frames_with(0.0, ball_m);
    let (known, ignored) = (error(&balls, ball_m, 0.0), error(&balls, 0.0, 0.0));
    assert!(known < 2e-6 && ignored > 2e-5, "ball known {known:e} m, ignored {ignored:e} m");
}
