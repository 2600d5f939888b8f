//! Slips, estimated again together with causes. The first estimate of a slip was made before any cause was known,
//! with all small errors free. These absorbed part of the motion or added to it, and causes that cancel each other
//! would compensate that error.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::prepare::first_day::settle_slip;
use crate::diagnose::selection::search::{Search, SearchOptions};
use crate::error::Result;
use nalgebra::Vector6;

/// Number of causes in the model at which the slips are estimated again, round by round: first the largest, then
/// those that it hid.
const CAUSES: [usize; 2] = [1, 3];

/// Estimates the slips of a search's problem together with its largest causes. Of each slip that changed: its
/// number and the standard deviations of its motion.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn settle_slips(search: &mut Search<'_>, nominal: &Model) -> Result<Vec<(usize, Vector6<f64>)>> {
    let mut moved: Vec<(usize, Vector6<f64>)> = Vec::new();
    let slips = search.problem.slips.len();
    for most_causes in CAUSES {
        if slips == 0 || search.problem.budget.is_spent() {
            break;
        }
        let options = SearchOptions { most_causes, ..search.options.clone() };
        let found = Search { options, ..search.clone() }.run(nominal.clone())?;
        let causes = search.deformation(&found.fit.model);
        let mut still = true;
        for which in 0..slips {
            if let Some(std) = settle_slip(&mut search.problem, &causes, search.measured_noise, which)? {
                moved.retain(|(other, _)| *other != which);
                moved.push((which, std));
                still = false;
            }
        }
        if still {
            break;
        }
    }
    Ok(moved)
}
