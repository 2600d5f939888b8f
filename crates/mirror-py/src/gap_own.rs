//! A user's own effects, and the quantities on which they may depend.

use crate::arrays::{reshaped, shape_error};
use crate::errors::MirrorPostureError;
use mirror_core::diagnose::{OwnAxis, OwnEffect, OwnParameter, OwnPlace, Quantities};
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The axes of parameters by name; a joint's parameters have none.
const AXES: [(&str, OwnAxis); 6] = [
    ("x", OwnAxis::Along(0)),
    ("y", OwnAxis::Along(1)),
    ("z", OwnAxis::Along(2)),
    ("rx", OwnAxis::About(0)),
    ("ry", OwnAxis::About(1)),
    ("rz", OwnAxis::About(2)),
];

/// An own effect: names and priors, and at each place the weights (frames, parameters).
#[derive(FromPyObject)]
pub struct OwnEffectArrays<'py> {
    name: String,
    words: String,
    parameters: Vec<(String, f64, Option<String>)>,
    places: Vec<(String, PyReadonlyArray2<'py, f64>)>,
}

impl OwnEffectArrays<'_> {
    /// As the core takes it.
    pub fn to_core(&self) -> PyResult<OwnEffect> {
        let parameters = self
            .parameters
            .iter()
            .map(|(name, prior_std, axis)| {
                let axis = axis.as_deref().map(|got| axis_named(&self.name, got)).transpose()?;
                Ok(OwnParameter { name: name.clone(), prior_std: *prior_std, axis })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let places = self
            .places
            .iter()
            .map(|(at, weights)| {
                let weights = weights.as_array();
                if weights.ncols() != parameters.len() {
                    let argument = format!("weights of own effect {} at {at}", self.name);
                    return Err(shape_error(
                        &argument,
                        weights.shape(),
                        &format!("(frames, {})", parameters.len()),
                    ));
                }
                let weights = weights.columns().into_iter().map(|c| c.to_vec()).collect();
                Ok(OwnPlace { at: at.clone(), weights })
            })
            .collect::<PyResult<Vec<_>>>()?;
        Ok(OwnEffect { name: self.name.clone(), words: self.words.clone(), parameters, places })
    }
}

fn axis_named(effect: &str, got: &str) -> PyResult<OwnAxis> {
    AXES.iter().find(|(name, _)| *name == got).map(|(_, axis)| *axis).ok_or_else(|| {
        let valid: Vec<&str> = AXES.iter().map(|(name, _)| *name).collect();
        MirrorPostureError::new_err(format!(
            "own effect {effect}: got the axis {got:?}, needed one of {}, or none at a joint",
            valid.join(", ")
        ))
    })
}

/// The quantities as a mapping of names and arrays, frames first.
pub fn quantities_to_py<'py>(py: Python<'py>, told: Quantities) -> PyResult<Bound<'py, PyDict>> {
    let (frames, joints) = (told.position.len(), told.joint_names.len());
    let flat = |rows: Vec<Vec<f64>>| reshaped(py, rows.concat(), [frames, joints]);
    let vectors =
        |rows: Vec<Vec<[f64; 3]>>, count: usize| reshaped(py, rows.concat().concat(), [frames, count, 3]);
    let out = PyDict::new(py);
    let markers = told.marker_names.len();
    out.set_item("joint_names", told.joint_names)?;
    out.set_item("link_names", told.link_names)?;
    out.set_item("seen", told.seen)?;
    out.set_item("marker_names", told.marker_names)?;
    out.set_item("position", flat(told.position)?)?;
    out.set_item("direction", flat(told.direction)?)?;
    out.set_item("torque_nm", flat(told.torque_nm)?)?;
    out.set_item("moment_nm", vectors(told.moment_nm, joints)?)?;
    out.set_item("down", vectors(told.down, markers)?)?;
    out.set_item("time_s", PyArray1::from_vec(py, told.time_s))?;
    Ok(out)
}
