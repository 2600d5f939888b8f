//! The diagnosis: a session's arrays in, the diagnosis as JSON out.

use crate::arrays::shape_error;
use crate::camera::lens;
use crate::errors::{MirrorPostureError, to_py};
use crate::gap_own::{OwnEffectArrays, quantities_to_py};
use crate::work::Work;
use mirror_core::Cancel;
use mirror_core::camera::Camera;
use mirror_core::diagnose::{
    BoardSpec, DiagnoseOptions, Frame, MarkerSpec, MeasuredPoint, OtherSession, PointsFrame, Progress,
    Recording, SightSpec, Sighting, Target, Tolerance, Tolerances, Via,
};
use mirror_core::robot::Robot;
use nalgebra::{Point3, Vector2, Vector3};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use std::sync::{Mutex, PoisonError};

/// What is not an array: names, links, camera, mirror, stated noise.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    root_link: String,
    gravity_m_per_s2: [f64; 3],
    camera: Option<CameraHeader>,
    camera_link: Option<String>,
    board: Option<BoardHeader>,
    glass_thickness_m: f64,
    refractive_index: f64,
    markers: Vec<MarkerHeader>,
    points_frame: Option<String>,
    ordered: bool,
    timed: bool,
    pixel_std_px: Option<f64>,
    point_std_m: Option<f64>,
    joint_names: Vec<String>,
    /// m and rad, each none where it is learned.
    board_tolerance: Option<(Option<f64>, Option<f64>)>,
    camera_tolerance: Option<(Option<f64>, Option<f64>)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraHeader {
    size_px: (u32, u32),
    focal_px: [f64; 2],
    center_px: [f64; 2],
    model: String,
    distortion: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoardHeader {
    link: String,
    corners: (usize, usize),
    square_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MarkerHeader {
    name: String,
    link: String,
    diameter_m: f64,
    mount_known: bool,
    tolerance_m: Option<f64>,
}

/// One way of seeing: pixels and masks of corners and markers, each with the frames first.
#[derive(FromPyObject)]
struct ViewArrays<'py> {
    board_px: PyReadonlyArray3<'py, f64>,
    board_seen: PyReadonlyArray2<'py, bool>,
    marker_px: PyReadonlyArray3<'py, f64>,
    marker_seen: PyReadonlyArray2<'py, bool>,
}

impl ViewArrays<'_> {
    /// Refuses arrays that are not of these numbers of frames, corners and markers.
    fn check(&self, name: &str, frames: usize, corners: usize, markers: usize) -> PyResult<()> {
        let shapes = [
            ("board_px", self.board_px.shape(), vec![frames, corners, 2]),
            ("board_seen", self.board_seen.shape(), vec![frames, corners]),
            ("marker_px", self.marker_px.shape(), vec![frames, markers, 2]),
            ("marker_seen", self.marker_seen.shape(), vec![frames, markers]),
        ];
        shapes
            .into_iter()
            .try_for_each(|(array, got, needed)| of_shape(&format!("{name} {array}"), got, &needed))
    }

    fn append(&self, via: Via, frames: &mut [Frame]) {
        let (board, board_seen) = (self.board_px.as_array(), self.board_seen.as_array());
        let (marker, marker_seen) = (self.marker_px.as_array(), self.marker_seen.as_array());
        for (f, frame) in frames.iter_mut().enumerate() {
            for i in (0..board_seen.ncols()).filter(|&i| board_seen[[f, i]]) {
                let pixel = Vector2::new(board[[f, i, 0]], board[[f, i, 1]]);
                frame.sightings.push(Sighting { target: Target::Corner(i), via, pixel });
            }
            for m in (0..marker_seen.ncols()).filter(|&m| marker_seen[[f, m]]) {
                let pixel = Vector2::new(marker[[f, m, 0]], marker[[f, m, 1]]);
                frame.sightings.push(Sighting { target: Target::Marker(m), via, pixel });
            }
        }
    }
}

/// Inner corners of a board along one side at most: larger ones would ask for all memory.
const MOST_CORNERS: usize = 1000;

fn of_shape(argument: &str, got: &[usize], needed: &[usize]) -> PyResult<()> {
    if got == needed { Ok(()) } else { Err(shape_error(argument, got, &format!("{needed:?}"))) }
}

/// How many corners the header's board has.
fn corners_of(header: &Header) -> PyResult<usize> {
    let Some(board) =
        header.board.as_ref().filter(|_| header.camera.is_some() && header.camera_link.is_some())
    else {
        return Ok(0);
    };
    let (nx, ny) = board.corners;
    if nx.max(ny) > MOST_CORNERS {
        return Err(MirrorPostureError::new_err(format!(
            "header: got a board of {nx} × {ny} corners, needed at most {MOST_CORNERS} a side"
        )));
    }
    Ok(nx * ny)
}

/// Looks at a running diagnosis from another thread, and has what was found so far where it is stopped.
#[pyclass(frozen, module = "mirror_posture._core")]
#[derive(Default)]
pub struct DiagnosisProgress {
    progress: Mutex<Progress>,
}

impl DiagnosisProgress {
    fn now(&self) -> Progress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

#[pymethods]
impl DiagnosisProgress {
    #[new]
    fn new() -> Self {
        Self { progress: Mutex::new(Progress::new()) }
    }

    /// What is being done, in a few words, and how many causes were found so far.
    #[getter]
    fn stage(&self) -> (&'static str, usize) {
        let now = self.now();
        (now.stage(), now.found())
    }

    /// What was found so far as JSON: a diagnosis that says that it was interrupted.
    fn so_far(&self, recording: &GapRecording) -> PyResult<String> {
        serde_json::to_string(&self.now().so_far(&recording.recording)).map_err(json_error("diagnosis"))
    }
}

/// A link, its middle (m) and its axes.
type LinkBendNumbers = (String, [f64; 3], Vec<[f64; 3]>);

/// A session's recording, arranged for the core.
#[pyclass(frozen, module = "mirror_posture._core")]
pub struct GapRecording {
    robot: Robot,
    recording: Recording,
}

impl GapRecording {
    pub(crate) fn robot(&self) -> &Robot {
        &self.robot
    }

    pub(crate) fn recording(&self) -> &Recording {
        &self.recording
    }
}

fn json_error(what: &str) -> impl Fn(serde_json::Error) -> PyErr + '_ {
    move |e| MirrorPostureError::new_err(format!("{what}: {e}"))
}

fn camera_of(header: &CameraHeader) -> PyResult<Camera> {
    let lens = lens(&header.model, &header.distortion).map_err(to_py)?;
    let size = header.size_px;
    Camera::new(size, Vector2::from(header.focal_px), Vector2::from(header.center_px), lens).map_err(to_py)
}

#[pymethods]
impl GapRecording {
    #[new]
    #[pyo3(signature = (urdf, header, frame, posture, time_s, commanded, mirror, direct, points=None, points_seen=None))]
    fn new(
        urdf: &str,
        header: &str,
        frame: PyReadonlyArray1<'_, i64>,
        posture: PyReadonlyArray1<'_, i64>,
        time_s: PyReadonlyArray1<'_, f64>,
        commanded: PyReadonlyArray2<'_, f64>,
        mirror: ViewArrays<'_>,
        direct: ViewArrays<'_>,
        points: Option<PyReadonlyArray3<'_, f64>>,
        points_seen: Option<PyReadonlyArray2<'_, bool>>,
    ) -> PyResult<Self> {
        let header: Header = serde_json::from_str(header).map_err(json_error("header"))?;
        let robot = Robot::from_urdf_str(urdf).map_err(to_py)?;
        let columns = header
            .joint_names
            .iter()
            .map(|n| robot.position_index(n))
            .collect::<Result<Vec<_>, _>>()
            .map_err(to_py)?;
        let (count, corners, markers) = (frame.len(), corners_of(&header)?, header.markers.len());
        of_shape("posture", posture.shape(), &[count])?;
        of_shape("time_s", time_s.shape(), &[count])?;
        of_shape("commanded", commanded.shape(), &[count, columns.len()])?;
        // Without a board there may be room for its corners all the same; what is seen there is refused below.
        let room =
            if header.board.is_some() && corners == 0 { mirror.board_seen.shape()[1] } else { corners };
        mirror.check("mirror", count, room, markers)?;
        direct.check("direct", count, room, markers)?;
        if points.is_some() != points_seen.is_some() {
            return Err(MirrorPostureError::new_err(
                "points and points_seen: got one of both, needed both or none",
            ));
        }
        if let (Some(points), Some(seen)) = (&points, &points_seen) {
            of_shape("points", points.shape(), &[count, markers, 3])?;
            of_shape("points_seen", seen.shape(), &[count, markers])?;
        }
        let (frame, posture) = (frame.as_array(), posture.as_array());
        let (time_s, commanded) = (time_s.as_array(), commanded.as_array());
        let mut frames: Vec<Frame> = (0..frame.len())
            .map(|f| {
                let mut positions = vec![0.0; robot.position_count()];
                for (column, &position) in columns.iter().enumerate() {
                    positions[position] = commanded[[f, column]];
                }
                Frame {
                    number: frame[f],
                    posture: posture[f],
                    time_s: time_s[f],
                    commanded: positions,
                    sightings: Vec::new(),
                    points: Vec::new(),
                }
            })
            .collect();
        mirror.append(Via::Mirror, &mut frames);
        direct.append(Via::Direct, &mut frames);
        if let (Some(points), Some(seen)) = (points, points_seen) {
            let (points, seen) = (points.as_array(), seen.as_array());
            for (f, frame) in frames.iter_mut().enumerate() {
                for m in (0..seen.ncols()).filter(|&m| seen[[f, m]]) {
                    let position_m = Point3::new(points[[f, m, 0]], points[[f, m, 1]], points[[f, m, 2]]);
                    frame.points.push(MeasuredPoint { marker: m, position_m });
                }
            }
        }
        let sight = match (&header.camera, header.camera_link) {
            (Some(camera), Some(camera_link)) => Some(SightSpec {
                camera: camera_of(camera)?,
                camera_link,
                board: header.board.map(|b| BoardSpec {
                    link: b.link,
                    corners: b.corners,
                    square_m: b.square_m,
                }),
                glass_thickness_m: header.glass_thickness_m,
                refractive_index: header.refractive_index,
            }),
            _ => None,
        };
        let tolerance = |t: Option<(Option<f64>, Option<f64>)>| {
            t.map_or_else(Tolerance::default, |(m, rad)| Tolerance { shift_m: m, turn_rad: rad })
        };
        let tolerances = Tolerances {
            board: tolerance(header.board_tolerance),
            camera: tolerance(header.camera_tolerance),
            markers: header
                .markers
                .iter()
                .map(|m| Tolerance { shift_m: m.tolerance_m, turn_rad: None })
                .collect(),
        };
        let recording = Recording {
            root_link: header.root_link,
            gravity: Vector3::from(header.gravity_m_per_s2),
            sight,
            markers: header
                .markers
                .into_iter()
                .map(|m| MarkerSpec {
                    name: m.name,
                    link: m.link,
                    diameter_m: m.diameter_m,
                    mount_known: m.mount_known,
                })
                .collect(),
            tolerances,
            points_frame: header
                .points_frame
                .map(|f| if f == "unknown" { PointsFrame::Unknown } else { PointsFrame::Link(f) }),
            columns,
            ordered: header.ordered,
            timed: header.timed,
            pixel_std_px: header.pixel_std_px,
            point_std_m: header.point_std_m,
            frames,
        };
        let recording = recording.validated(robot.position_count()).map_err(to_py)?;
        Ok(Self { robot, recording })
    }

    /// The quantities on which own effects may depend, as arrays with the frames first.
    fn quantities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let told =
            py.work(|| mirror_core::diagnose::quantities(&self.robot, &self.recording)).map_err(to_py)?;
        quantities_to_py(py, told)
    }

    /// Where links bend: the link, the place in its frame (m), and the unit axes about which it does.
    fn link_bends(&self, py: Python<'_>) -> PyResult<Vec<LinkBendNumbers>> {
        let bends =
            py.work(|| mirror_core::diagnose::link_bends(&self.robot, &self.recording)).map_err(to_py)?;
        let numbers = bends.into_iter().map(|bend| {
            let axes = bend.axes.into_iter().map(Into::into).collect();
            (bend.link, bend.middle_m.into(), axes)
        });
        Ok(numbers.collect())
    }

    /// Diagnoses the recording; `others` are further sessions on which the result is checked. The result is JSON.
    #[pyo3(signature = (without=Vec::new(), most_causes=0, others=Vec::new(), own=Vec::new(), markers=false, progress=None))]
    fn diagnose(
        &self,
        py: Python<'_>,
        without: Vec<String>,
        most_causes: usize,
        others: Vec<(String, Py<Self>, Vec<OwnEffectArrays<'_>>)>,
        own: Vec<OwnEffectArrays<'_>>,
        markers: bool,
        progress: Option<Py<DiagnosisProgress>>,
    ) -> PyResult<String> {
        let tables = |own: &[OwnEffectArrays<'_>]| {
            own.iter().map(OwnEffectArrays::to_core).collect::<PyResult<Vec<_>>>()
        };
        let others = others
            .iter()
            .map(|(name, other, own)| {
                let other = other.get();
                Ok(OtherSession {
                    name: name.clone(),
                    robot: other.robot.clone(),
                    recording: other.recording.clone(),
                    own: tables(own)?,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let cancel = Cancel::new();
        let progress = progress.map(|p| p.get().now()).unwrap_or_default();
        let options = DiagnoseOptions {
            without,
            most_causes,
            own: tables(&own)?,
            markers,
            cancel: cancel.clone(),
            progress,
        };
        let diagnosis = py
            .work_until(&cancel, || {
                mirror_core::diagnose::diagnose(&self.robot, &self.recording, &options, &others)
            })?
            .map_err(to_py)?;
        serde_json::to_string(&diagnosis).map_err(json_error("diagnosis"))
    }
}

/// The vocabulary of effects in words, a dict each; see `mirror_core::diagnose::effects`.
#[pyfunction]
pub fn effects(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let told = |effect: mirror_core::diagnose::EffectInfo| {
        let dict = PyDict::new(py);
        dict.set_item("name", effect.name)?;
        dict.set_item("at", effect.at.name())?;
        dict.set_item("parameters", effect.parameters)?;
        dict.set_item("law", effect.law)?;
        dict.set_item("words", effect.words)?;
        dict.set_item("remedy", effect.remedy)?;
        dict.set_item("written_to", effect.written_to.name())?;
        dict.set_item("fed_forward", effect.fed_forward)?;
        let terms: Vec<&str> = effect.joint_law.iter().map(|term| term.name()).collect();
        dict.set_item("joint_law", terms)?;
        dict.set_item("signature", effect.signature)?;
        dict.set_item("shown_by", effect.shown_by)?;
        dict.set_item("confused_with", effect.confused_with)?;
        Ok(dict)
    };
    mirror_core::diagnose::effects().into_iter().map(told).collect()
}

/// The hypotheses without a single place, a dict each; see `mirror_core::diagnose::mistakes`.
#[pyfunction]
pub fn mistakes(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let told = |mistake: &mirror_core::diagnose::MistakeInfo| {
        let dict = PyDict::new(py);
        dict.set_item("name", mistake.name)?;
        dict.set_item("signature", mistake.signature)?;
        dict.set_item("remedy", mistake.remedy)?;
        dict.set_item("written_to", mistake.written_to.name())?;
        dict.set_item("is_mistake", mistake.is_mistake)?;
        Ok(dict)
    };
    mirror_core::diagnose::mistakes().iter().map(told).collect()
}
