//! Marker positions, posture by posture: measured, by the nominal model, and with the causes. For plots.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::SeenMarker;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::kinematics::NodePoses;
use crate::error::Result;
use std::collections::HashMap;

/// The markers of every posture, in the root's frame.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn seen_markers(findings: &Findings<'_>) -> Result<Vec<SeenMarker>> {
    let search = &findings.search;
    let (problem, noise) = (&search.problem, search.detector_noise());
    let mut causes = findings.found.fit.model.clone();
    // What has no name is no part of the better model.
    causes.terms.retain(|t| !search.catalogue.is_free(t.hypothesis));
    let (nominal, better) = (search.deformation(&Model::nominal(problem)), search.deformation(&causes));
    let (before, after) = (
        free_markers(problem, &nominal, noise, true, None)?,
        free_markers(problem, &better, noise, true, None)?,
    );
    let mut measured: HashMap<(usize, usize), [f64; 3]> = HashMap::new();
    let mut out = Vec::new();
    for posture in &after {
        let Some(&frame) = posture.frames.first() else { continue };
        let at = Places::new(findings, &better, frame);
        for marker in &posture.markers {
            measured.insert(
                (frame, marker.marker),
                at.point(findings, &better, marker.marker, marker.displacement),
            );
        }
    }
    for posture in &before {
        let Some(&frame) = posture.frames.first() else { continue };
        let (at, with) = (Places::new(findings, &nominal, frame), Places::new(findings, &better, frame));
        for marker in &posture.markers {
            // The measurement is computed once, with the model that is nearer to it, because the linearisation is
            // then better.
            let Some(&measured_m) = measured.get(&(frame, marker.marker)) else { continue };
            let zero = nalgebra::Vector3::zeros();
            out.push(SeenMarker {
                frame: problem.frame_numbers[frame],
                marker: problem.scene.marker_names[marker.marker].clone(),
                measured_m,
                before_m: at.point(findings, &nominal, marker.marker, zero),
                after_m: with.point(findings, &better, marker.marker, zero),
            });
        }
    }
    Ok(out)
}

/// The body at one frame of a deformation.
struct Places {
    poses: NodePoses,
    frame: usize,
}

impl Places {
    fn new(findings: &Findings<'_>, deformation: &Deformation, frame: usize) -> Self {
        let scene = &findings.search.problem.scene;
        let nodes = scene.nodes();
        let mut poses = NodePoses::new(nodes);
        poses.update(&scene.body, &scene.commanded[frame * nodes..(frame + 1) * nodes], deformation, frame);
        Self { poses, frame }
    }

    /// A marker in the root's frame, moved in the frame of its mount.
    fn point(
        &self,
        findings: &Findings<'_>,
        deformation: &Deformation,
        marker: usize,
        moved: nalgebra::Vector3<f64>,
    ) -> [f64; 3] {
        let problem = &findings.search.problem;
        let root = self.poses.site(&problem.scene.body.root);
        let mount = self.poses.site(&problem.marker_mounts[marker]);
        let shift = mount.r * (deformation.marker_shift_in(self.frame, marker) + moved);
        root.inverse_point(&(self.poses.site(&problem.marker_sites[marker]).t + shift)).into()
    }
}
