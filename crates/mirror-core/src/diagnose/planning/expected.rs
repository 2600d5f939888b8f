//! The linear model of a planned session: all effects of the vocabulary at the nominal model, beside a free set-up.

use crate::cancel::Cancel;
use crate::diagnose::assessment::limits::{Postures, free_setup};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term, nuisances};
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::Problem;
use crate::error::Result;
use crate::robot::Robot;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Postures with what the nominal model predicts to be seen in them (pixels, or measured points), arranged.
///
/// ```
/// use mirror_core::Cancel;
/// use mirror_core::diagnose::{
///     Frame, MarkerSpec, MeasuredPoint, PlannedSession, PointsFrame, Pool, Recording, Tolerances,
/// };
/// use mirror_core::robot::Robot;
/// use nalgebra::{Point3, Vector3};
///
/// let robot = Robot::from_urdf_str(
///     r#"<robot name="arm"><link name="base"/><link name="upper"/><link name="hand"/>
///     <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
///       <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
///     <joint name="wrist" type="fixed"><parent link="upper"/><child link="hand"/><origin xyz="0.4 0 0"/></joint></robot>"#,
/// )?;
/// let hand = robot.link_index("hand")?;
/// let frames = (0..9_i32).map(|number| {
///     let commanded = vec![0.4 * f64::from(number - 4)];
///     let position_m = robot.poses(&commanded)?.point_in_a(0, hand, &Point3::origin());
///     let points = vec![MeasuredPoint { marker: 0, position_m }];
///     let (number, time_s) = (i64::from(number), f64::from(number));
///     Ok(Frame { number, posture: number, time_s, commanded, sightings: Vec::new(), points })
/// });
/// let recording = Recording {
///     root_link: "base".into(),
///     gravity: Vector3::new(0.0, 0.0, -9.81),
///     sight: None,
///     markers: vec![MarkerSpec { name: "hand".into(), link: "hand".into(), diameter_m: 0.0, mount_known: true }],
///     tolerances: Tolerances::default(),
///     points_frame: Some(PointsFrame::Link("base".into())),
///     columns: Vec::new(),
///     ordered: true,
///     timed: false,
///     pixel_std_px: None,
///     point_std_m: Some(2e-4),
///     frames: frames.collect::<Result<_, mirror_core::Error>>()?,
/// };
/// let session = PlannedSession::new(&robot, &recording, Cancel::default())?;
/// // Of nine postures the three that show most together.
/// let each: Vec<Vec<usize>> = (0..9).map(|frame| vec![frame]).collect();
/// let posture: Vec<usize> = (0..9).collect();
/// let pool = Pool { frames: &each, block: &[0; 9], posture: &posture, most: &[3] };
/// assert_eq!(session.choose(&pool)?.len(), 3);
/// // The smallest error of the gear that all nine will show: some parts in a thousand.
/// let foreseen = session.foresee()?;
/// let gear = foreseen.iter().find(|one| one.effect == "gear_ratio").ok_or("no gear")?;
/// let (_, size) = &gear.parameters[0];
/// assert!(size.is_some_and(|size| (1e-4..1e-2).contains(&size)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct PlannedSession {
    pub(crate) problem: Problem,
    pub(crate) catalogue: Catalogue,
    pub(crate) group: Group,
    pub(crate) model: Model,
    /// All columns: nuisances, the free set-up, then each effect's.
    pub(crate) columns: Vec<Column>,
    /// Their priors' standard deviations.
    pub(crate) prior_std: Vec<f64>,
    /// The sizes that they commonly have: of a mount that of its effect, not the tolerance that a session states.
    pub(crate) usual: Vec<f64>,
    /// Where those of the effects begin: before them are the nuisances and the free set-up.
    pub(crate) first_effect: usize,
    /// Which columns are an effect's, by hypothesis.
    pub(crate) of: BTreeMap<usize, Vec<usize>>,
}

impl PlannedSession {
    /// Arranges postures. The recording holds what is predicted to be seen, and states the noise expected; a frame in
    /// which nothing is seen only tells from where a joint arrives in the next one.
    ///
    /// # Errors
    /// Unknown links; a camera or mirror with invalid parameters.
    pub fn new(robot: &Robot, recording: &Recording, cancel: Cancel) -> Result<Self> {
        let mut problem = Problem::new(robot, recording)?;
        problem.cancel = cancel;
        let effects = vocabulary().into_iter().map(Arc::from).collect();
        let catalogue = Catalogue::new(&problem.scene, effects, &[]);
        let group = free_setup(&problem);
        let mut model = Model::nominal(&problem);
        model.group = vec![0.0; group.columns.len()];
        let mut out = Self {
            columns: Vec::new(),
            prior_std: Vec::new(),
            usual: Vec::new(),
            first_effect: 0,
            of: BTreeMap::new(),
            problem,
            catalogue,
            group,
            model,
        };
        out.collect_columns();
        Ok(out)
    }

    fn collect_columns(&mut self) {
        for (column, std) in nuisances(&self.problem) {
            self.columns.push(column);
            self.prior_std.push(std);
        }
        let first = self.columns.len();
        self.columns.extend(self.group.columns.iter().cloned());
        self.prior_std.extend(&self.group.prior_std);
        self.first_effect = self.columns.len();
        self.usual.clone_from(&self.prior_std);
        let moved = |columns: &Vec<usize>| columns.iter().map(|k| first + k).collect();
        self.of = self.postures().in_group().iter().map(|(h, columns)| (*h, moved(columns))).collect();
        for (h, columns) in &self.of {
            let usual = &self.catalogue.hypotheses[*h].prior_std;
            columns.iter().zip(usual).for_each(|(&column, usual)| self.usual[column] = *usual);
        }
        for h in 0..self.catalogue.hypotheses.len() {
            if self.of.contains_key(&h) || !is_planned_for(&self.catalogue, h) {
                continue;
            }
            let entry = &self.catalogue.hypotheses[h];
            let parameters = vec![0.0; entry.prior_std.len()];
            // Values of a discrete unknown differ little in what they show.
            let variant = entry.variants.first().copied().unwrap_or(0.0);
            let term = Term { hypothesis: h, variant, parameters, prior_scale: 1.0 };
            let own = self.columns.len()..self.columns.len() + entry.prior_std.len();
            self.prior_std.extend(&entry.prior_std);
            self.usual.extend(&entry.prior_std);
            self.columns.extend(self.catalogue.columns(&self.problem.scene, &term));
            self.of.insert(h, own.collect());
        }
    }

    pub(crate) fn postures(&self) -> Postures<'_> {
        Postures {
            problem: &self.problem,
            catalogue: &self.catalogue,
            group: &self.group,
            model: &self.model,
            noise: self.problem.noise,
            mask: None,
        }
    }
}

/// Whether postures are chosen for an effect at a place. Not for a coupling of each joint with each other one: they
/// would outnumber all else.
fn is_planned_for(catalogue: &Catalogue, hypothesis: usize) -> bool {
    !matches!(catalogue.hypotheses[hypothesis].place, Place::JointPair(..))
}
