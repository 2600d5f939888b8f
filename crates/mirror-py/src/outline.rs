//! Bindings of `mirror_core::outline`: balls in pictures.

use crate::arrays::{Array2Like, pairs, reshaped, shape_error};
use crate::camera::PyCamera;
use crate::errors::{MirrorPostureError, to_py};
use crate::work::Work;
use mirror_core::Cancel;
use mirror_core::outline::{
    BallOutline, Circle, Codec, ColorBox, CommonBlur, ExpectedRadius, PatternGhost, PatternLevels,
    PatternView, Picture, RadiusRange, chroma_step as step_of, codec_covariance, color_regions as regions_of,
    fit_circle, measure_ball, measure_blurred_ball, pattern_curve as curve_of, pattern_ghost as ghost_of,
};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

/// One measured ball; see `mirror_posture.detect.ball`.
#[pyclass(name = "BallOutline", module = "mirror_posture._core", frozen)]
pub struct PyBallOutline {
    inner: BallOutline,
}

#[pymethods]
impl PyBallOutline {
    #[getter]
    fn centroid_px(&self) -> (f64, f64) {
        let p = self.inner.cone.centroid_px;
        (p.x, p.y)
    }

    #[getter]
    fn centroid_covariance_px2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let c = self.inner.cone.centroid_covariance_px2;
        reshaped(py, vec![c[(0, 0)], c[(0, 1)], c[(1, 0)], c[(1, 1)]], [2, 2])
    }

    #[getter]
    fn sphere_center_px(&self) -> (f64, f64) {
        let p = self.inner.cone.sphere_center_px;
        (p.x, p.y)
    }

    /// Centre (u, v), half axes, px, and the major one's angle, rad.
    #[getter]
    fn ellipse(&self) -> (f64, f64, f64, f64, f64) {
        let b = &self.inner;
        let (c, a) = (b.ellipse_center_px, b.semi_axes_px);
        (c.x, c.y, a.x, a.y, b.angle_rad)
    }

    #[getter]
    fn boundary_px<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let boundary = &self.inner.cone.boundary_px;
        reshaped(py, boundary.iter().flat_map(|p| [p.x, p.y]).collect(), [boundary.len(), 2])
    }

    #[getter]
    fn mean_radius_px(&self) -> f64 {
        self.inner.cone.mean_radius_px
    }

    #[getter]
    fn arc_fraction(&self) -> f64 {
        self.inner.arc_fraction
    }

    #[getter]
    fn residual_rms_px(&self) -> f64 {
        self.inner.cone.residual_rms_px
    }

    #[getter]
    fn blur_px(&self) -> f64 {
        self.inner.blur_px
    }

    #[getter]
    fn narrow_blur_px(&self) -> f64 {
        self.inner.narrow_blur_px
    }

    #[getter]
    fn lens_blur_px(&self) -> f64 {
        self.inner.lens_blur_px
    }

    #[getter]
    fn curve_deviations(&self) -> Option<f64> {
        self.inner.curve_deviations
    }

    #[getter]
    fn curve_moved_px(&self) -> (f64, f64) {
        let moved = self.inner.cone.common_moved_px;
        (moved.x, moved.y)
    }
}

/// The balls near circles `(N, 3)`: u, v, radius, with radii in `(N, 2)`, px; None where there is none. `curve`: by how many deviations the camera's tone curve differs
/// from sRGB's.
#[pyfunction]
pub fn measure_balls(
    py: Python<'_>,
    bgr: PyReadonlyArray3<'_, u8>,
    circles_px: Array2Like<'_>,
    radii_px: Array2Like<'_>,
    camera: &PyCamera,
    chroma_step_px: (usize, usize),
    curve: f64,
) -> PyResult<Vec<Option<PyBallOutline>>> {
    let picture = picture_of(&bgr, chroma_step_px)?.with_curve(curve);
    let starts = starts_of(&circles_px, &radii_px)?;
    let camera = camera.inner.as_ref();
    let found = at_each(py, &starts, |(circle, range)| measure_ball(&picture, circle, range, camera))?;
    Ok(found.into_iter().map(|ball| ball.map(|inner| PyBallOutline { inner })).collect())
}

/// What a JPEG's rounding adds to the covariances of balls that were found near circles `(N, 3)`, px²: rows of uu, uv, vv; None where it is not known. `steps`: of
/// the coefficients of brightness and colour, 64 each, row by row; `sampling`: pixels across and down that share a colour in the file; `blurs_px`: the blur of each
/// ball, standard deviation, where it is known and alike in all directions.
#[pyfunction]
pub fn codec_covariances(
    py: Python<'_>,
    bgr: PyReadonlyArray3<'_, u8>,
    circles_px: Array2Like<'_>,
    radii_px: Array2Like<'_>,
    camera: &PyCamera,
    chroma_step_px: (usize, usize),
    steps: [[u16; 64]; 2],
    sampling: (usize, usize),
    blurs_px: Vec<Option<f64>>,
) -> PyResult<Vec<Option<[f64; 3]>>> {
    let picture = picture_of(&bgr, chroma_step_px)?;
    let starts = starts_of(&circles_px, &radii_px)?;
    if blurs_px.len() != starts.len() {
        return Err(MirrorPostureError::new_err(format!(
            "blurs_px: has length {}; needed {}, one for each circle",
            blurs_px.len(),
            starts.len()
        )));
    }
    let balls: Vec<_> = starts.into_iter().zip(blurs_px).collect();
    let codec = Codec::new(&steps[0], &steps[1], sampling).ok_or_else(|| {
        MirrorPostureError::new_err(
            "a codec: needed steps of at least 1, and one colour for 1 or 2 pixels each way",
        )
    })?;
    let camera = camera.inner.as_ref();
    at_each(py, &balls, |((circle, range), blur_px)| {
        codec_covariance(&picture, circle, range, camera, &codec, *blur_px)
            .map(|more| [more[(0, 0)], more[(0, 1)], more[(1, 1)]])
    })
}

/// What is found at each start, on all threads; None from where on Ctrl-C cancels it.
fn at_each<S: Sync, T: Send>(
    py: Python<'_>,
    starts: &[S],
    find: impl Fn(&S) -> Option<T> + Sync + Send,
) -> PyResult<Vec<Option<T>>> {
    let cancel = Cancel::new();
    py.work_until(&cancel, || {
        let one = |start: &S| if cancel.is_cancelled() { None } else { find(start) };
        starts.par_iter().map(one).collect()
    })
}

fn starts_of(circles_px: &Array2Like<'_>, radii_px: &Array2Like<'_>) -> PyResult<Vec<(Circle, RadiusRange)>> {
    let ranges = pairs("radii_px", radii_px)?;
    if circles_px.shape() != [ranges.len(), 3] {
        return Err(shape_error(
            "circles_px",
            circles_px.shape(),
            &format!("({}, 3): u, v, radius", ranges.len()),
        ));
    }
    let range = |r: &nalgebra::Vector2<f64>| RadiusRange { min_px: r.x, max_px: r.y };
    Ok(circles_px.as_array().rows().into_iter().map(circle_of).zip(ranges.iter().map(range)).collect())
}

/// The blurred balls near places in rows of u, v, expected radius and its standard deviation, px, with the blur that they share; None where there is none.
#[pyfunction]
pub fn measure_blurred_balls(
    py: Python<'_>,
    bgr: PyReadonlyArray3<'_, u8>,
    expected_px: Vec<[f64; 4]>,
    camera: &PyCamera,
    curve: f64,
) -> PyResult<Vec<Option<PyBallOutline>>> {
    let picture = picture_of(&bgr, (1, 1))?.with_curve(curve);
    let camera = camera.inner.as_ref();
    let cancel = Cancel::new();
    let found: Vec<_> = py.work_until(&cancel, || {
        let measure = |row: &[f64; 4], at: nalgebra::Vector2<f64>, common: Option<&CommonBlur>| {
            let start = Circle { center_px: at, radius_px: row[2] };
            let expected = ExpectedRadius { radius_px: row[2], std_px: row[3] };
            if cancel.is_cancelled() {
                None
            } else {
                measure_blurred_ball(&picture, &start, &expected, common, camera)
            }
        };
        let apart: Vec<_> = expected_px
            .par_iter()
            .map(|row| measure(row, nalgebra::Vector2::new(row[0], row[1]), None))
            .collect();
        let blurs: Vec<_> = apart.iter().flatten().map(|ball| ball.blur_px2).collect();
        let Some(common) = CommonBlur::of(&blurs) else { return apart };
        expected_px
            .par_iter()
            .zip(&apart)
            .map(|(row, ball)| measure(row, ball.as_ref()?.outline.cone.centroid_px, Some(&common)))
            .collect()
    })?;
    Ok(found.into_iter().map(|ball| ball.map(|ball| PyBallOutline { inner: ball.outline })).collect())
}

fn picture_of<'a>(
    bgr: &'a PyReadonlyArray3<'_, u8>,
    chroma_step_px: (usize, usize),
) -> PyResult<Picture<'a>> {
    let shape = bgr.shape();
    if shape[2] != 3 {
        return Err(shape_error("bgr", shape, "(H, W, 3)"));
    }
    let bytes = bgr.as_slice().map_err(|_| {
        MirrorPostureError::new_err("bgr: needed an array in C order (numpy.ascontiguousarray)")
    })?;
    Picture::new(bytes, shape[1], shape[0], chroma_step_px).map_err(to_py)
}

/// Pixels across and down that share a colour, estimated from the picture: 1 or 2 each.
#[pyfunction]
pub fn chroma_step(py: Python<'_>, bgr: PyReadonlyArray3<'_, u8>) -> PyResult<(usize, usize)> {
    let picture = picture_of(&bgr, (1, 1))?;
    Ok(py.work(|| step_of(&picture)))
}

/// Area, centroid (u, v), box (left, top, width, height), px, and the box's mask (height, width).
type Region<'py> = (usize, (f64, f64), [usize; 4], Bound<'py, PyArray2<bool>>);

/// Regions of colours in rows of hue and its tolerance, degrees, least saturation and value, 0..1; the largest first.
#[pyfunction]
pub fn color_regions<'py>(
    py: Python<'py>,
    bgr: PyReadonlyArray3<'_, u8>,
    colors: Vec<[f32; 4]>,
    least_area_px: usize,
    most: usize,
) -> PyResult<Vec<Vec<Region<'py>>>> {
    let picture = picture_of(&bgr, (1, 1))?;
    let boxes: Vec<ColorBox> = colors
        .iter()
        .map(|[hue_deg, hue_tolerance_deg, min_saturation, min_value]| ColorBox {
            hue_deg: *hue_deg,
            hue_tolerance_deg: *hue_tolerance_deg,
            min_saturation: *min_saturation,
            min_value: *min_value,
        })
        .collect();
    let found = py.work(|| regions_of(&picture, &boxes, least_area_px, most));
    let region = |one: mirror_core::outline::ColorRegion| -> PyResult<Region<'py>> {
        let [_, _, width, height] = one.box_px;
        let mask = Array2::from_shape_vec((height, width), one.mask)
            .map_err(|error| MirrorPostureError::new_err(error.to_string()))?;
        Ok((one.area_px, (one.centroid_px.x, one.centroid_px.y), one.box_px, mask.into_pyarray(py)))
    };
    found.into_iter().map(|of_colour| of_colour.into_iter().map(region).collect()).collect()
}

fn circle_of(row: numpy::ndarray::ArrayView1<'_, f64>) -> Circle {
    Circle { center_px: nalgebra::Vector2::new(row[0], row[1]), radius_px: row[2] }
}

/// A circle through points `(N, 2)` by consensus: (u, v, radius), px, or None.
#[pyfunction]
pub fn fit_circle_by_consensus(
    py: Python<'_>,
    points_px: Array2Like<'_>,
    min_radius_px: f64,
    max_radius_px: f64,
    tolerance_px: f64,
) -> PyResult<Option<(f64, f64, f64)>> {
    let points = pairs("points_px", &points_px)?;
    Ok(py
        .detach(|| fit_circle(&points, min_radius_px, max_radius_px, tolerance_px))
        .map(|c| (c.center_px.x, c.center_px.y, c.radius_px)))
}

/// What a view of the board's pattern shows of a ghost; see `mirror_posture.detect.ghost`.
#[pyclass(name = "PatternGhost", module = "mirror_posture._core", frozen)]
pub struct PyPatternGhost {
    inner: PatternGhost,
}

#[pymethods]
impl PyPatternGhost {
    #[getter]
    fn strength(&self) -> f64 {
        self.inner.strength
    }

    #[getter]
    fn shift_px(&self) -> (f64, f64) {
        (self.inner.shift_px.x, self.inner.shift_px.y)
    }

    #[getter]
    fn weakest(&self) -> f64 {
        self.inner.weakest
    }

    /// What a ghost explains that lies so far (4, 2), px, from the view's corners.
    fn explained_by(&self, ends_px: Array2Like<'_>) -> PyResult<f64> {
        let ends = pairs("ends_px", &ends_px)?;
        let four = ends.try_into().map_err(|_| shape_error("ends_px", ends_px.shape(), "(4, 2)"))?;
        Ok(self.inner.explained_by(&four))
    }
}

/// The ghost in a view of the pattern: light and the pattern with several blurs `(H, W)`, and how far from it a ghost is looked for, px; None where there is no pattern.
#[pyfunction]
pub fn pattern_ghost(
    py: Python<'_>,
    light: PyReadonlyArray2<'_, f32>,
    models: Vec<PyReadonlyArray2<'_, f32>>,
    reach_px: usize,
) -> PyResult<Option<PyPatternGhost>> {
    let contiguous = |_| MirrorPostureError::new_err("light, models: needed arrays in C order");
    let shape = light.shape();
    let view = PatternView {
        width: shape[1],
        height: shape[0],
        light: light.as_slice().map_err(contiguous)?,
        reach: reach_px,
    };
    let models: Vec<&[f32]> =
        models.iter().map(|model| model.as_slice().map_err(contiguous)).collect::<PyResult<_>>()?;
    let found = py.work(|| ghost_of(&view, &models)).map_err(to_py)?;
    Ok(found.map(|inner| PyPatternGhost { inner }))
}

/// The camera's tone curve by a view of the pattern: grey levels and the drawn pattern `(H, W)`, how many pixels share their errors, and how far ink may spread, px; where a
/// sharpening was undone, how much each level falls for each px² of more `(H, W)`, and its strength's deviation, px². By how many deviations the curve differs from sRGB's, and
/// the standard deviation of that; None where the view does not tell it.
#[pyfunction]
pub fn pattern_curve(
    py: Python<'_>,
    levels: PyReadonlyArray2<'_, u8>,
    pattern: PyReadonlyArray2<'_, f32>,
    shared_pixels: f64,
    ink_px: f64,
    sharpening: Option<(PyReadonlyArray2<'_, f32>, f64)>,
) -> PyResult<Option<(f64, f64)>> {
    let contiguous = |_| MirrorPostureError::new_err("levels, pattern, sharpening: needed arrays in C order");
    let shape = levels.shape();
    let view = PatternLevels {
        width: shape[1],
        height: shape[0],
        levels: levels.as_slice().map_err(contiguous)?,
        pattern: pattern.as_slice().map_err(contiguous)?,
        shared_pixels,
        ink_px,
        sharpening: match &sharpening {
            Some((falls, std)) => Some((falls.as_slice().map_err(contiguous)?, *std)),
            None => None,
        },
    };
    let found = py.work(|| curve_of(&view)).map_err(to_py)?;
    Ok(found.map(|curve| (curve.deviations, curve.std)))
}
