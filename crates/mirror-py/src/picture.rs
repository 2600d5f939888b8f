//! Bindings of the picture maker.

use crate::arrays::{Array2Like, isometry};
use crate::errors::to_py;
use crate::work::Work;
use mirror_core::Cancel;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::picture::{
    BallTruth, Body, Dress, Eye, Lights, Pane, PaneOptions, Sampling, Scene, Sensor, ViaTruth, ball_truth,
    corner_truth, furnish, render,
};
use mirror_core::robot::Robot;
use nalgebra::{Isometry3, Vector2, Vector3};
use numpy::{PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// White border around the printed squares, m: as wide as the embedded robot's placard allows.
const BOARD_BORDER_M: f64 = 0.006;

struct BoardPrint {
    link: String,
    corners: [u32; 2],
    square_m: f64,
}

struct Ball {
    name: String,
    link: String,
    diameter_m: f64,
    rgb: [f64; 3],
}

/// Renders a robot in front of a mirror by ray tracing, with the truth of what it rendered.
#[pyclass(frozen, module = "mirror_posture._core")]
pub struct PictureMaker {
    robot: Robot,
    dress: Dress,
    eye: Eye,
    camera_link: String,
    board: Option<BoardPrint>,
    balls: Vec<Ball>,
}

fn lens(coefficients: &[f64]) -> PyResult<Distortion> {
    match *coefficients {
        [] => Ok(Distortion::None),
        [k1, k2, p1, p2, k3] => Ok(Distortion::PlumbBob([k1, k2, p1, p2, k3])),
        [k1, k2, p1, p2, k3, k4, k5, k6] => {
            Ok(Distortion::RationalPolynomial([k1, k2, p1, p2, k3, k4, k5, k6]))
        }
        _ => Err(crate::arrays::shape_error(
            "distortion",
            &[coefficients.len()],
            "(0,) for none, (5,) for plumb_bob or (8,) for rational_polynomial",
        )),
    }
}

#[pymethods]
impl PictureMaker {
    #[new]
    #[pyo3(signature = (urdf, *, size_px, focal_px, center_px, distortion, camera_link, board, balls))]
    fn new(
        py: Python<'_>,
        urdf: &str,
        size_px: (u32, u32),
        focal_px: (f64, f64),
        center_px: (f64, f64),
        distortion: Vec<f64>,
        camera_link: String,
        board: Option<(String, u32, u32, f64)>,
        balls: Vec<(String, String, f64, [f64; 3])>,
    ) -> PyResult<Self> {
        let distortion = lens(&distortion)?;
        let robot = Robot::from_urdf_str(urdf).map_err(to_py)?;
        let board = board.map(|(link, nx, ny, square_m)| BoardPrint { link, corners: [nx, ny], square_m });
        let balls: Vec<Ball> = balls
            .into_iter()
            .map(|(name, link, diameter_m, rgb)| Ball { name, link, diameter_m, rgb })
            .collect();
        let named = board.iter().map(|b| &b.link).chain(balls.iter().map(|b| &b.link));
        for link in named.chain([&camera_link]) {
            robot.link_index(link).map_err(to_py)?;
        }
        let mut dress = Dress::from_urdf(urdf).map_err(to_py)?;
        // The given balls take the place of what the file draws there.
        dress.visuals.retain(|v| balls.iter().all(|b| b.link != v.link));
        let eye = py
            .work(|| {
                let camera = Camera::new(
                    size_px,
                    Vector2::from(<[f64; 2]>::from(focal_px)),
                    Vector2::from(<[f64; 2]>::from(center_px)),
                    distortion,
                )?;
                Eye::new(&camera)
            })
            .map_err(to_py)?;
        Ok(Self { robot, dress, eye, camera_link, board, balls })
    }

    /// Meshes of the URDF, as `link: file`, which are not drawn.
    #[getter]
    fn skipped_meshes(&self) -> Vec<String> {
        self.dress.skipped_meshes.clone()
    }

    /// Pose of every link, `root_from_link` (4, 4), at the given joint positions (rad, m); others are 0.
    fn link_poses<'py>(
        &self,
        py: Python<'py>,
        positions: BTreeMap<String, f64>,
    ) -> PyResult<HashMap<String, Bound<'py, PyArray2<f64>>>> {
        let mut q = vec![0.0; self.robot.position_count()];
        for (name, value) in &positions {
            q[self.robot.position_index(name).map_err(to_py)?] = *value;
        }
        let poses = self.robot.poses(&q).map_err(to_py)?;
        let links = self.robot.links().iter().enumerate();
        links
            .map(|(i, link)| {
                let m = poses.root_from_link(i).to_homogeneous();
                let rows: Vec<Vec<f64>> = m.row_iter().map(|r| r.iter().copied().collect()).collect();
                Ok((link.name.clone(), PyArray2::from_vec2(py, &rows)?))
            })
            .collect()
    }

    /// Draws one picture: (picture (H, W, 3) uint8 RGB, truth as a tree of plain Python values).
    #[pyo3(signature = (link_poses, *, mirror_center_m, mirror_normal, glass_thickness_m, refractive_index, curvature_per_m,
        mirror_size_m, ghosts, floor_m, grid, edge_grid, motion_px, blur_px, exposure, full_well_electrons,
        read_noise_electrons, gamma, jpeg_quality, seed))]
    fn draw<'py>(
        &self,
        py: Python<'py>,
        link_poses: HashMap<String, Array2Like<'py>>,
        mirror_center_m: [f64; 3],
        mirror_normal: [f64; 3],
        glass_thickness_m: f64,
        refractive_index: f64,
        curvature_per_m: f64,
        mirror_size_m: (f64, f64),
        ghosts: bool,
        floor_m: f64,
        grid: usize,
        edge_grid: usize,
        motion_px: [f64; 2],
        blur_px: f64,
        exposure: f64,
        full_well_electrons: Option<f64>,
        read_noise_electrons: f64,
        gamma: f64,
        jpeg_quality: Option<u8>,
        seed: u64,
    ) -> PyResult<(Bound<'py, PyArray3<u8>>, Bound<'py, PyDict>)> {
        let mut poses = HashMap::with_capacity(link_poses.len());
        for (name, pose) in &link_poses {
            self.robot.link_index(name).map_err(to_py)?;
            poses.insert(name.clone(), isometry(&format!("link_poses[{name:?}]"), pose)?);
        }
        let options = PaneOptions {
            glass_thickness_m,
            refractive_index,
            curvature_per_m,
            ghosts,
            width_m: mirror_size_m.0,
            height_m: mirror_size_m.1,
            ..PaneOptions::default()
        };
        let cancel = Cancel::new();
        let sampling = Sampling {
            grid,
            edge_grid,
            motion_px: Vector2::from(motion_px),
            seed,
            cancel: cancel.clone(),
            ..Sampling::default()
        };
        let sensor = Sensor {
            blur_px,
            exposure,
            full_well_electrons: full_well_electrons.unwrap_or(f64::INFINITY),
            read_noise_electrons,
            gamma,
            jpeg_quality,
            seed,
        };
        let drawn = py
            .work_until(&cancel, || {
                let pane = Pane::new(
                    Vector3::from(mirror_center_m),
                    Vector3::from(mirror_normal),
                    Vector3::z(),
                    options,
                )?;
                self.drawn(&poses, pane, floor_m, &sampling, &sensor)
            })?
            .map_err(to_py)?;
        let (height, width) = (drawn.picture.height() as usize, drawn.picture.width() as usize);
        let flat = numpy::PyArray1::from_vec(py, drawn.picture.into_raw());
        Ok((flat.reshape([height, width, 3])?, drawn.truth.to_dict(py)?))
    }
}

struct Drawn {
    picture: image::RgbImage,
    truth: Truth,
}

struct Truth {
    normal_in_camera: Vector3<f64>,
    front_offset_m: f64,
    thickness_m: f64,
    refractive_index: f64,
    camera_from_board: Option<Isometry3<f64>>,
    corners: Vec<mirror_core::picture::CornerTruth>,
    balls: Vec<(String, Vector3<f64>, Vector3<f64>, BallTruth)>,
}

impl PictureMaker {
    fn drawn(
        &self,
        poses: &HashMap<String, Isometry3<f64>>,
        pane: Pane,
        floor_m: f64,
        sampling: &Sampling,
        sensor: &Sensor,
    ) -> mirror_core::Result<Drawn> {
        let pose = |link: &str| {
            poses.get(link).copied().ok_or_else(|| mirror_core::Error::UnknownName {
                what: "link without a pose",
                got: link.to_owned(),
                valid: poses
                    .keys()
                    .cloned()
                    .collect::<BTreeSet<_>>()
                    .into_iter()
                    .collect::<Vec<_>>()
                    .join(", "),
            })
        };
        let root_from_camera = pose(&self.camera_link)?;
        // The balls come first: their numbers are then their numbers as bodies.
        let mut bodies = Vec::new();
        for ball in &self.balls {
            let center = pose(&ball.link)?.translation.vector;
            bodies.push(Body::ball(center, ball.diameter_m, ball.rgb)?);
        }
        if let Some(board) = &self.board {
            let print = Body::chessboard(pose(&board.link)?, board.corners, board.square_m, BOARD_BORDER_M)?;
            bodies.push(print);
        }
        bodies.extend(self.dress.pose(|link| poses.get(link)));
        bodies.extend(furnish(floor_m, Some(&pane)));
        let camera_from_root = root_from_camera.inverse();
        let normal_in_camera = camera_from_root.rotation * pane.normal();
        let center_in_camera = camera_from_root * nalgebra::Point3::from(pane.center());
        let thickness_m = pane.options().glass_thickness_m;
        let refractive_index = pane.options().refractive_index;
        let scene = Scene::new(&bodies, Lights::default(), root_from_camera, Some(pane));
        let light = render(&scene, &self.eye, sampling)?;
        let picture = sensor.expose(&light)?;
        let mut corners = Vec::new();
        if let Some(board) = &self.board {
            let root_from_board = pose(&board.link)?;
            let place = |i: u32, n: u32| (f64::from(i) - f64::from(n - 1) / 2.0) * board.square_m;
            for j in 0..board.corners[1] {
                for i in 0..board.corners[0] {
                    let corner =
                        nalgebra::Point3::new(place(i, board.corners[0]), place(j, board.corners[1]), 0.0);
                    corners.push(corner_truth(&scene, &self.eye, &(root_from_board * corner).coords));
                }
            }
        }
        let mut balls = Vec::new();
        for (i, ball) in self.balls.iter().enumerate() {
            let in_root = pose(&ball.link)?.translation.vector;
            let in_camera = (camera_from_root * nalgebra::Point3::from(in_root)).coords;
            balls.push((ball.name.clone(), in_root, in_camera, ball_truth(&scene, &self.eye, i)));
        }
        let camera_from_board = match &self.board {
            Some(board) => Some(camera_from_root * pose(&board.link)?),
            None => None,
        };
        let truth = Truth {
            normal_in_camera,
            front_offset_m: normal_in_camera.dot(&center_in_camera.coords),
            thickness_m,
            refractive_index,
            camera_from_board,
            corners,
            balls,
        };
        Ok(Drawn { picture, truth })
    }
}

fn list(v: &[f64]) -> Vec<f64> {
    v.to_vec()
}

fn via_dict<'py>(py: Python<'py>, via: Option<&ViaTruth>) -> PyResult<Option<Bound<'py, PyDict>>> {
    let Some(via) = via else { return Ok(None) };
    let dict = PyDict::new(py);
    dict.set_item("px", list(via.center_px.as_slice()))?;
    dict.set_item("in_image", via.in_image)?;
    dict.set_item("outline_centroid_px", list(via.outline_px.as_slice()))?;
    dict.set_item("outline_area_px2", via.outline_area_px2)?;
    dict.set_item("visible_fraction", via.visible_fraction)?;
    dict.set_item("visible_centroid_px", via.visible_px.map(|p| list(p.as_slice())))?;
    Ok(Some(dict))
}

impl Truth {
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mirror = PyDict::new(py);
        mirror.set_item("n", list(self.normal_in_camera.as_slice()))?;
        mirror.set_item("d_front_m", self.front_offset_m)?;
        mirror.set_item("d_silver_m", self.front_offset_m + self.thickness_m)?;
        // Looked at straight on, the silver seems to lie at t / n behind the front face.
        mirror.set_item(
            "d_virtual_paraxial_m",
            self.front_offset_m + self.thickness_m / self.refractive_index,
        )?;
        let markers = PyDict::new(py);
        for (name, in_root, in_camera, truth) in &self.balls {
            let dict = PyDict::new(py);
            dict.set_item("root_m", list(in_root.as_slice()))?;
            dict.set_item("camera_m", list(in_camera.as_slice()))?;
            dict.set_item("mirror", via_dict(py, truth.mirror.as_ref())?)?;
            dict.set_item("direct", via_dict(py, truth.direct.as_ref())?)?;
            markers.set_item(name, dict)?;
        }
        let truth = PyDict::new(py);
        truth.set_item("mirror", mirror)?;
        if let Some(pose) = &self.camera_from_board {
            let m = pose.to_homogeneous();
            let rows: Vec<Vec<f64>> = m.row_iter().map(|r| r.iter().copied().collect()).collect();
            truth.set_item("camera_from_board", rows)?;
            let corners: Vec<Option<Vec<f64>>> =
                self.corners.iter().map(|c| c.pixel.map(|p| list(p.as_slice()))).collect();
            truth.set_item("corners_px", corners)?;
            truth
                .set_item("corners_visible", self.corners.iter().map(|c| c.is_visible).collect::<Vec<_>>())?;
        }
        truth.set_item("markers", markers)?;
        Ok(truth)
    }
}
