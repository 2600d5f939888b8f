//! The diagnosis on recordings made without its formulas: each effect at its place, nothing where there is nothing.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{Cause, DiagnoseOptions, Diagnosis, diagnose};
use mirror_core::robot::Robot;

fn diagnosed(world: &World, plan: &Plan) -> Diagnosis {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, &world.record(plan), &DiagnoseOptions::default(), &[]).unwrap()
}

fn told(diagnosis: &Diagnosis) -> String {
    let causes: Vec<String> = diagnosis
        .causes
        .iter()
        .map(|c| format!("{}@{} p={:.2} {:?}", c.effect, c.at, c.probability, c.parameters))
        .collect();
    format!("{}: {} | {}", diagnosis.verdict, causes.join("; "), diagnosis.trace.join(" | "))
}

/// Asserts one cause at its place, its parameters within four of their standard deviations, and the gap closed.
fn finds(wrong: Wrong, effect: &str, at: &str, truth: &[(&str, f64)]) {
    let plan = Plan { wrong: vec![wrong], ..Plan::default() };
    let diagnosis = diagnosed(&World::new(4, false), &plan);
    let said = told(&diagnosis);
    assert_eq!(diagnosis.verdict.as_str(), "explained", "{said}");
    assert_eq!(diagnosis.causes.len(), 1, "{said}");
    let cause: &Cause = &diagnosis.causes[0];
    assert_eq!((cause.effect.as_str(), cause.at.as_str()), (effect, at), "{said}");
    for (name, value) in truth {
        let found = cause.parameters[*name];
        let deviations = (found.value - value) / found.std;
        assert!(deviations.abs() < 4.0, "{name}: {deviations:.1} deviations from {value}: {said}");
    }
    let gap = &diagnosis.gap;
    assert!(gap.after_m < gap.noise_floor_m.map(|floor| 1.1 * floor), "{said}: {gap:?}");
    // A step a cause, from the nominal model to the one that is told.
    assert_eq!(gap.steps.len(), 1 + diagnosis.causes.len(), "{said}: {gap:?}");
    let ends = (gap.steps.first().and_then(|s| s.rms_m), gap.steps.last().and_then(|s| s.rms_m));
    assert_eq!(ends, (gap.before_m, gap.after_m), "{said}");
    let added: Vec<_> = gap.steps.iter().filter_map(|s| s.added.clone()).collect();
    assert_eq!(added, diagnosis.causes.iter().map(|c| format!("{}@{}", c.effect, c.at)).collect::<Vec<_>>());
    assert!(gap.before_px > gap.after_px, "{said}: {gap:?}");
}

fn elbow() -> usize {
    World::new(4, false).bone("r_elbow")
}

#[test]
fn nothing_is_none() {
    for seed in 1..4 {
        let diagnosis = diagnosed(&World::new(4, false), &Plan { seed, ..Plan::default() });
        assert_eq!((diagnosis.verdict.as_str(), diagnosis.causes.len()), ("none", 0), "{}", told(&diagnosis));
        println!("{:?}", diagnosis.noise);
    }
}

#[test]
fn joint_offset() {
    // The upper arm's: the last joint's zero and its markers' mounts are told apart by two markers on it.
    let j = World::new(4, false).bone("r_shoulder_roll");
    finds(Wrong::Offset(j, 0.03), "joint_offset", "joint:r_shoulder_roll", &[("offset_rad", 0.03)]);
}

#[test]
fn gear_ratio() {
    finds(Wrong::Ratio(elbow(), 0.06), "gear_ratio", "joint:r_elbow", &[("scale_error", 0.06)]);
}

#[test]
fn gear_eccentricity() {
    finds(
        Wrong::Eccentric(elbow(), 0.02, 0.15),
        "gear_eccentricity",
        "joint:r_elbow",
        &[("sin_rad", 0.02), ("cos_rad", 0.15)],
    );
}

#[test]
fn backlash() {
    let j = World::new(4, false).bone("r_shoulder_pitch");
    finds(Wrong::Backlash(j, 0.05, 0.4), "backlash", "joint:r_shoulder_pitch", &[("width_rad", 0.05)]);
}

/// A dead band without droop is a play of twice its width that motion alone drives: each must name the other as its rival.
#[test]
fn stiction() {
    let plan = Plan { wrong: vec![Wrong::Stiction(elbow(), 0.02)], ..Plan::default() };
    let diagnosis = diagnosed(&World::new(4, false), &plan);
    let said = told(&diagnosis);
    assert_eq!((diagnosis.verdict.as_str(), diagnosis.causes.len()), ("explained", 1), "{said}");
    let cause = &diagnosis.causes[0];
    assert_eq!(cause.at, "joint:r_elbow", "{said}");
    let (size, truth) = match cause.effect.as_str() {
        "stiction" => (cause.parameters["deadband_rad"], 0.02),
        "backlash" => {
            assert!(cause.probability < 0.9, "{said}");
            assert!(cause.alternatives.iter().any(|a| a.effect == "stiction" && a.at == cause.at), "{said}");
            (cause.parameters["width_rad"], 0.04)
        }
        _ => panic!("{said}"),
    };
    assert!((size.value - truth).abs() < 4.0 * size.std, "{said}");
}

#[test]
fn joint_compliance() {
    let j = World::new(4, false).bone("r_shoulder_pitch");
    finds(
        Wrong::Compliance(j, 0.03),
        "joint_compliance",
        "joint:r_shoulder_pitch",
        &[("compliance_rad_per_nm", 0.03)],
    );
}

#[test]
fn link_bending() {
    let b = World::new(4, false).bone("r_shoulder_yaw");
    finds(
        Wrong::Bending(b, 0.04),
        "link_bending",
        "link:r_shoulder_yaw_link",
        &[("compliance_rad_per_nm", 0.04)],
    );
}

#[test]
fn link_length() {
    let b = World::new(4, false).bone("r_shoulder_yaw");
    finds(
        Wrong::Length(Some(b), [0.004, -0.006, 0.005]),
        "link_length",
        "link:r_shoulder_yaw_link",
        &[("dx_m", 0.004), ("dy_m", -0.006), ("dz_m", 0.005)],
    );
}

#[test]
fn axis_tilt() {
    let j = World::new(4, false).bone("r_shoulder_roll");
    finds(
        Wrong::Tilt(j, 0.05, -0.04),
        "axis_tilt",
        "joint:r_shoulder_roll",
        &[("tilt_1_rad", 0.05), ("tilt_2_rad", -0.04)],
    );
}

#[test]
fn joint_coupling() {
    let k = World::new(4, false).bone("r_shoulder_yaw");
    finds(
        Wrong::Coupling(elbow(), k, 0.06),
        "joint_coupling",
        "joint:r_elbow<-joint:r_shoulder_yaw",
        &[("coupling", 0.06)],
    );
}

#[test]
fn drift() {
    finds(Wrong::Drift(elbow(), 3e-4), "drift", "joint:r_elbow", &[("rate_rad_per_s", 3e-4)]);
}

#[test]
fn marker_mount() {
    finds(
        Wrong::Mount(5, [0.004, -0.005, 0.003]),
        "marker_mount",
        "marker:r_hand",
        &[("dx_m", 0.004), ("dy_m", -0.005), ("dz_m", 0.003)],
    );
}

#[test]
fn camera_mount() {
    let truth = [0.012, -0.01, 0.008, 0.004, -0.003, 0.005];
    let names = ["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"];
    let truths: Vec<(&str, f64)> = names.into_iter().zip(truth).collect();
    finds(Wrong::CameraMount(truth), "camera_mount", "camera", &truths);
}

#[test]
fn camera_focal() {
    finds(Wrong::Focal(0.012), "camera_focal", "camera", &[("scale_error", 0.012)]);
}

#[test]
fn camera_center() {
    finds(Wrong::Center(6.0, -5.0), "camera_center", "camera", &[("du_px", 6.0), ("dv_px", -5.0)]);
}

#[test]
fn marker_image() {
    finds(Wrong::MarkersDetected(0.4, -0.5), "marker_image", "camera", &[("du_px", 0.4), ("dv_px", -0.5)]);
    let grows =
        [("du_px", 0.0), ("dv_px", 0.0), ("du_by_u", -0.0015), ("dv_by_v", -0.0015), ("du_by_v", 0.0)];
    finds(Wrong::MarkersFocal(-0.0015), "marker_image", "camera", &grows);
}

#[test]
fn lens_distortion() {
    finds(Wrong::Radial(-0.05), "lens_distortion", "camera", &[("dk1", -0.05)]);
}

#[test]
fn board_scale() {
    finds(Wrong::BoardScale(0.015), "board_scale", "board", &[("scale_error", 0.015)]);
}

#[test]
fn mirror_glass() {
    // At half a metre a common pane of 6 mm hides behind the freely fitted plane: it takes a thick one to be seen.
    finds(Wrong::Glass(0.02), "mirror_glass", "mirror", &[("thickness_m", 0.02)]);
}

#[test]
fn mirror_curvature() {
    finds(Wrong::Curvature(0.05), "mirror_curvature", "mirror", &[("curvature_per_m", 0.05)]);
}
