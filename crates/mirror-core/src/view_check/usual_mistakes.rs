//! The usual mistakes: other readings of a session, in words, and how to correct each.

use super::reading::{Labels, Pictures, Reading};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;

const FLIPS: [Pictures; 2] = [Pictures::MirroredLeftRight, Pictures::MirroredUpDown];
const QUARTERS: [Pictures; 2] = [Pictures::TurnedToTheRight, Pictures::TurnedToTheLeft];

/// How a picture is corrected.
fn pictures_fix(pictures: Pictures) -> &'static str {
    match pictures {
        Pictures::AsTheyAre => "",
        Pictures::MirroredLeftRight => {
            "switch the driver's mirroring off, or mirror the pictures back (u becomes W - 1 - u), and detect again"
        }
        Pictures::MirroredUpDown => {
            "switch the driver's flip off, or mirror the pictures back (v becomes H - 1 - v), and detect again"
        }
        Pictures::TurnedBy180 => {
            "switch the driver's rotation off, or turn the pictures back by 180°, and detect again"
        }
        Pictures::TurnedToTheRight => "turn the pictures back by 90° to the left, and detect again",
        Pictures::TurnedToTheLeft => "turn the pictures back by 90° to the right, and detect again",
    }
}

/// The labels that a detector makes of a flipped view. If it is flipped back, its labels change handedness, because the
/// detector took the board for a mirrored one. The dark square diagonally outside corner 0 shows which axis it reversed, if
/// the counts differ in parity.
fn natural_swaps((nx, ny): (usize, usize)) -> &'static [Labels] {
    match (nx % 2, ny % 2) {
        (x, y) if x == y => &[Labels::ReversedInX, Labels::ReversedInY],
        (1, _) => &[Labels::ReversedInY],
        _ => &[Labels::ReversedInX],
    }
}

/// Pictures that a driver mirrored or turned, a board counted from its other end beside them.
fn of_pictures(corners: (usize, usize), square_picture: bool, out: &mut Vec<Reading>) {
    let quarters: &[Pictures] = if square_picture { &QUARTERS } else { &[] };
    for &pictures in FLIPS.iter().chain(&[Pictures::TurnedBy180]).chain(quarters) {
        let flips = FLIPS.contains(&pictures);
        let effect = (!QUARTERS.contains(&pictures)).then_some("picture_flipped");
        let said = format!("the pictures are {}", pictures.name());
        let one = Reading {
            pictures,
            ..Reading::mistake(pictures.name(), said.clone(), pictures_fix(pictures), effect)
        };
        let swaps = if flips { natural_swaps(corners) } else { &[] };
        out.push(one.clone());
        out.extend(swaps.iter().map(|&labels| Reading { labels, ..one.clone() }));
        if flips {
            let others = [Labels::ReversedInX, Labels::ReversedInY];
            out.extend(others.into_iter().filter(|labels| !swaps.contains(labels)).map(|labels| Reading {
                labels,
                mistakes: 2,
                said: format!("{said}, and the board is mounted turned by 180°"),
                ..one.clone()
            }));
        }
    }
}

/// A board mounted or counted from another corner.
fn of_the_mount((nx, ny): (usize, usize), out: &mut Vec<Reading>) {
    for quarters in if nx == ny { [1, 2, 3] } else { [2, 1, 3] } {
        let degrees = 90 * quarters;
        // A board of other counts along x and y cannot be counted turned by 90°.
        let counted = if quarters == 2 || nx == ny { ", or its corners are counted," } else { "" };
        let turn = Vector3::z() * (f64::from(quarters) * FRAC_PI_2);
        out.push(Reading {
            board_from_meant: Isometry3::new(Vector3::zeros(), turn),
            ..Reading::mistake(
                format!("board turned by {degrees}°"),
                format!("the board is mounted{counted} turned by {degrees}° against the URDF"),
                format!("turn the board, or its link [board] link, by {degrees}° about its z axis"),
                Some("board_turned"),
            )
        });
    }
}

/// From a camera body's frame (x forward, z up) to its optical frame (z forward, x right): REP 103.
fn optical_from_body() -> Isometry3<f64> {
    let rotation = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts(Translation3::identity(), rotation)
}

/// All readings that one usual mistake makes on a board of `(nx, ny)` inner corners, and those that two make which come
/// together. Factors of board and camera, which have a number, are sought beside them.
pub fn usual_mistakes(corners: (usize, usize), square_picture: bool) -> Vec<Reading> {
    let mut out = Vec::new();
    of_pictures(corners, square_picture, &mut out);
    of_the_mount(corners, &mut out);
    for (axis, labels) in [("x", Labels::ReversedInX), ("y", Labels::ReversedInY)] {
        out.push(Reading {
            labels,
            ..Reading::mistake(
                format!("labels reversed in {axis}"),
                format!("the corners are counted against the board's {axis} axis (as OpenCV counts a board seen directly)"),
                format!("count them along it: index = iy * {} + ix from the corner at -x, -y, z out of the printed face", corners.0),
                None,
            )
        });
    }
    out.push(Reading {
        optical_from_modelled: optical_from_body(),
        ..Reading::mistake(
            "camera body",
            "[camera_mount] link is the camera's body (x forward), not its optical frame (z forward, x right, y down)",
            "name the optical frame's link, or add one to the URDF, turned by rpy = -pi/2, 0, -pi/2 against the body",
            None,
        )
    });
    out
}
