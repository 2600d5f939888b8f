//! Recordings made of a fuzzer's bytes: frames, pixels, points and indices of any kind.

use super::bytes::Bytes;
use mirror_core::Cancel;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::diagnose::{
    BoardSpec, DiagnoseOptions, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec,
    Sighting, Target, Tolerance, Tolerances, Verdict, Via, diagnose, quantities,
};
use mirror_core::robot::Robot;
use nalgebra::{Point3, Vector2, Vector3};
use std::sync::LazyLock;
use std::time::Duration;

static ROBOT: LazyLock<Robot> =
    LazyLock::new(|| Robot::from_urdf_str(include_str!("../seeds/arm.urdf")).expect("the arm"));

fn tolerance(bytes: &mut Bytes<'_>) -> Tolerance {
    let mut one = || (bytes.byte() > 128).then(|| bytes.number());
    Tolerance { shift_m: one(), turn_rad: one() }
}

fn link(bytes: &mut Bytes<'_>) -> String {
    let links = ROBOT.links();
    if bytes.rarely() { "nowhere".into() } else { links[bytes.below(links.len())].name.clone() }
}

fn made(bytes: &mut Bytes<'_>) -> Recording {
    let sight = (bytes.byte() > 60).then(|| SightSpec {
        camera: Camera::new(
            (640, 480),
            Vector2::new(500.0, 500.0),
            Vector2::new(319.5, 239.5),
            Distortion::None,
        )
        .expect("a camera"),
        camera_link: link(bytes),
        board: (bytes.byte() > 30).then(|| BoardSpec {
            link: link(bytes),
            corners: (bytes.below(6), bytes.below(6)),
            square_m: bytes.number(),
        }),
        glass_thickness_m: bytes.number(),
        refractive_index: 1.0 + bytes.number().abs(),
    });
    let markers: Vec<MarkerSpec> = (0..bytes.below(4))
        .map(|i| MarkerSpec {
            name: format!("m{i}"),
            link: link(bytes),
            diameter_m: bytes.number(),
            mount_known: bytes.byte() > 100,
        })
        .collect();
    let corners = sight.as_ref().and_then(|s| s.board.as_ref()).map_or(0, |b| b.corners.0 * b.corners.1);
    let tolerances = Tolerances {
        board: tolerance(bytes),
        camera: tolerance(bytes),
        markers: (0..markers.len()).map(|_| tolerance(bytes)).collect(),
    };
    // Now and then an index beyond the last.
    let place = |bytes: &mut Bytes<'_>, count: usize| {
        let beyond = usize::from(bytes.rarely());
        bytes.below(count + beyond)
    };
    let mut frames = Vec::new();
    while !bytes.is_empty() && frames.len() < 24 {
        let number = frames.len() as i64;
        let mut frame = Frame {
            number,
            posture: number / 2,
            time_s: if bytes.rarely() { bytes.number() } else { number as f64 },
            commanded: (0..ROBOT.position_count()).map(|_| bytes.number()).collect(),
            sightings: Vec::new(),
            points: Vec::new(),
        };
        for _ in 0..bytes.below(12) {
            let board = corners > 0 && bytes.byte() > 100;
            let target = if board {
                Target::Corner(place(bytes, corners))
            } else {
                Target::Marker(place(bytes, markers.len()))
            };
            let via = if bytes.byte() > 80 { Via::Mirror } else { Via::Direct };
            let pixel = Vector2::new(320.0 + bytes.number(), 240.0 + bytes.number());
            frame.sightings.push(Sighting { target, via, pixel });
        }
        for _ in 0..bytes.below(3) {
            let position_m = Point3::from(bytes.numbers::<3>());
            frame.points.push(MeasuredPoint { marker: place(bytes, markers.len()), position_m });
        }
        frames.push(frame);
    }
    Recording {
        root_link: link(bytes),
        gravity: if bytes.rarely() {
            Vector3::from(bytes.numbers::<3>())
        } else {
            Vector3::new(0.0, 0.0, -9.81)
        },
        sight,
        markers,
        tolerances,
        points_frame: match bytes.below(3) {
            0 => None,
            1 => Some(PointsFrame::Unknown),
            _ => Some(PointsFrame::Link(link(bytes))),
        },
        columns: (0..bytes.below(4)).map(|_| bytes.below(9)).collect(),
        ordered: bytes.byte() > 60,
        timed: bytes.byte() > 60,
        pixel_std_px: (bytes.byte() > 60).then(|| bytes.number()),
        point_std_m: (bytes.byte() > 60).then(|| bytes.number()),
        frames,
    }
}

/// Any recording is checked without a panic, and its quantities are finite.
pub fn recording(data: &[u8]) {
    let recording = made(&mut Bytes::new(data));
    match recording.validated(ROBOT.position_count()) {
        Ok(recording) => match quantities(&ROBOT, &recording) {
            Ok(_) => {}
            Err(refusal) => assert!(!refusal.to_string().is_empty()),
        },
        Err(refusal) => assert!(!refusal.to_string().is_empty()),
    }
}

/// By the clock, of a machine that may be busy with much else: a diagnosis of garbage takes some tenths of a second of computing.
const LONGEST: Duration = Duration::from_secs(60);

/// Garbage is diagnosed without a panic, in time, without a number that is none, and is never called sound.
pub fn diagnosis(data: &[u8]) {
    let Ok(recording) = made(&mut Bytes::new(data)).validated(ROBOT.position_count()) else { return };
    let options =
        DiagnoseOptions { most_causes: 1, cancel: Cancel::after(LONGEST), ..DiagnoseOptions::default() };
    match diagnose(&ROBOT, &recording, &options, &[]) {
        Ok(found) => {
            assert!(
                found.verdict != Verdict::None,
                "nothing is wrong with garbage, it says: {:?} {:?} {:?}",
                found.gap,
                found.noise,
                found.data
            );
        }
        Err(refusal) => {
            assert!(!options.cancel.is_cancelled(), "took more than {LONGEST:?}");
            assert!(!refusal.to_string().is_empty());
        }
    }
}
