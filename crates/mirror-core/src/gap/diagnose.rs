//! From a recording to a diagnosis.

use super::effects::vocabulary;
use super::fit::Group;
use super::hypothesis::{Catalogue, Model};
use super::observations::Recording;
use super::problem::Problem;
use super::search::{Search, SearchOptions};
use crate::error::Result;
use crate::robot::Robot;

/// Trace (development).
pub fn trace(robot: &Robot, recording: Recording, without: &[String]) -> Result<Vec<String>> {
    let recording = recording.validated(robot.position_count())?;
    let t0 = std::time::Instant::now();
    let mut problem = Problem::new(robot, &recording)?;
    let noise = super::noise::estimate(&problem, problem.noise)?;
    problem.noise = noise;
    let catalogue = Catalogue::new(&problem.scene, vocabulary(), without);
    let mut out = vec![format!("noise {noise:?} hyps {} t {:?}", catalogue.hypotheses.len(), t0.elapsed())];
    let group = Group::default();
    for outlines in [false, true] {
        let mut p2 = problem.clone();
        p2.outlines = outlines;
        let f = super::fit::fit(&p2, &catalogue, &group, &Model::nominal(&p2), super::fit::FitOptions { noise, steps: 1 }, None)?;
        out.push(format!("outlines {outlines}: cost {:.1}", f.cost));
    }
    problem.outlines = true;
    let mut search = Search { problem: problem.clone(), catalogue: &catalogue, group: &group, measured_noise: noise, options: SearchOptions::default(), mask: None };
    let nominal = Model::nominal(&problem);
    let deformation = problem.nominal();
    let eff = super::noise::effective(&problem, &deformation, noise, None)?;
    let t1 = std::time::Instant::now();
    let scores = super::screen::screen(&problem, &catalogue, &group, &nominal, eff, None)?;
    out.push(format!("effective {eff:?} screen {:?}", t1.elapsed()));
    for s in scores.iter().take(5) {
        out.push(format!("  {} v={:.4} logB {:.1} {:?}", catalogue.name(&problem.scene, s.hypothesis), s.variant, s.log_bayes, s.parameters));
    }
    let t2 = std::time::Instant::now();
    let found = search.run(nominal)?;
    out.extend(found.trace);
    for (i, t) in found.fit.model.terms.iter().enumerate() {
        out.push(format!("=> {} v={:.4} {:?} ± {:?}", catalogue.name(&problem.scene, t.hypothesis), t.variant, t.parameters, found.fit.stds(i)));
    }
    out.push(format!("final noise {:?} search {:?}", found.noise, t2.elapsed()));
    Ok(out)
}

/// Signature (development): posture rows of frame, q, torque, direction, value, std, moment.
pub fn signature(robot: &Robot, recording: Recording, joint: &str) -> Result<Vec<[f64; 8]>> {
    let mut problem = Problem::new(robot, &recording)?;
    problem.noise = super::noise::estimate(&problem, problem.noise)?;
    problem.outlines = true;
    let n = problem.scene.body.nodes.iter().position(|n| n.joint == joint).unwrap_or(0);
    let e = super::signature::free_errors(&problem, &problem.nominal(), problem.noise, super::atoms::Atom::Joint(n))?;
    Ok(e.iter()
        .map(|e| {
            let s = &problem.scene;
            [e.frame as f64, s.q(e.frame, n), s.torque(e.frame, n), s.direction(e.frame, n), e.value, e.std, s.moment(e.frame, n).norm(), 0.0]
        })
        .collect())
}
