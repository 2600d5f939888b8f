//! A session with a mistake undone: the positions, labels and mounts on which the alternatives are tried.

use super::table::Table;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::body::{Body, NodeId, Site};
use crate::diagnose::model::problem::Problem;
use nalgebra::Vector3;

/// Positions row by row, which joints have the other sign, the marker of each name, and where markers are mounted.
#[derive(Debug, Clone)]
pub(super) struct Variant {
    /// `positions[frame][joint]`, rad or m.
    pub positions: Table<f64>,
    /// −1 for a node whose joint turns the other way, else 1.
    pub signs: Vec<f64>,
    /// `labels[frame][name]`: the marker that a name denotes.
    pub labels: Table<usize>,
    /// The markers' places.
    pub sites: Vec<Site>,
    /// Factor between the size of the board's squares and the session's.
    pub squares: f64,
    /// The coordinate of measured points that has the wrong sign, if one has.
    pub mirrored: Option<usize>,
}

impl Variant {
    /// As it was recorded.
    pub fn of(recording: &Recording, problem: &Problem) -> Self {
        Self::at(Table::of(recording.frames.iter().map(|f| &f.commanded)), problem)
    }

    /// As a problem has it, at positions row by row.
    pub fn at(positions: Table<f64>, problem: &Problem) -> Self {
        let markers = problem.marker_sites.len();
        Self {
            signs: vec![1.0; problem.scene.nodes()],
            labels: Table::of(vec![(0..markers).collect::<Vec<_>>(); positions.len()]),
            positions,
            sites: problem.marker_sites.clone(),
            squares: 1.0,
            mirrored: None,
        }
    }

    /// The nodes' positions in a frame.
    pub fn nodes(&self, body: &Body, frame: usize, out: &mut [f64]) {
        for (n, out) in out.iter_mut().enumerate() {
            *out = self.node(body, frame, n);
        }
    }

    /// A node's position in a frame.
    pub fn node(&self, body: &Body, frame: usize, n: NodeId) -> f64 {
        let (index, multiplier, offset) = body.nodes[n].command;
        self.signs[n] * (multiplier * self.positions[frame][index] + offset)
    }

    /// Exchanges the markers of two names in a frame, after the earlier exchanges: a cycle of three names is two
    /// exchanges, and their order counts.
    pub fn exchange_labels(&mut self, frame: usize, markers: (usize, usize)) {
        self.labels[frame].iter_mut().for_each(|marker| *marker = other_of(markers, *marker));
    }

    /// A measured point in a right-handed frame.
    pub fn measured(&self, mut position: Vector3<f64>) -> Vector3<f64> {
        if let Some(axis) = self.mirrored {
            position[axis] = -position[axis];
        }
        position
    }

    /// A joint's column.
    pub fn column(&self, joint: usize) -> Vec<f64> {
        self.positions.iter().map(|row| row[joint]).collect()
    }

    /// Replaces a joint's column.
    pub fn set_column(&mut self, joint: usize, values: &[f64]) {
        for (row, value) in self.positions.iter_mut().zip(values) {
            row[joint] = *value;
        }
    }
}

/// A marker after two were exchanged.
pub(super) fn other_of((a, b): (usize, usize), marker: usize) -> usize {
    match marker {
        m if m == a => b,
        m if m == b => a,
        m => m,
    }
}

/// The independent joints that move the observed sites relative to the observer, each with its node.
pub(super) fn seen_joints(body: &Body, relevant: &[bool]) -> Vec<(usize, NodeId)> {
    let mut out: Vec<(usize, NodeId)> = Vec::new();
    for (n, node) in body.nodes.iter().enumerate() {
        let (index, multiplier, _) = node.command;
        if relevant[n] && multiplier != 0.0 && !out.iter().any(|(i, _)| *i == index) {
            out.push((index, n));
        }
    }
    out
}
