//! A reading: one interpretation of a session, what was done to its pictures, labels, board and camera.

use crate::camera::Camera;
use crate::error::Result;
use crate::mirror::Board;
use nalgebra::Isometry3;

/// What a driver did to its pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pictures {
    /// Nothing.
    AsTheyAre,
    /// Mirrored: what was left is right.
    MirroredLeftRight,
    /// Flipped: what was above is below.
    MirroredUpDown,
    /// Turned by half a turn.
    TurnedBy180,
    /// Turned by a quarter clockwise: what was at the top left is at the top right.
    TurnedToTheRight,
    /// Turned by a quarter counter-clockwise.
    TurnedToTheLeft,
}

impl Pictures {
    /// As people say it.
    pub fn name(self) -> &'static str {
        match self {
            Self::AsTheyAre => "as they are",
            Self::MirroredLeftRight => "mirrored left-right",
            Self::MirroredUpDown => "mirrored up-down",
            Self::TurnedBy180 => "turned by 180°",
            Self::TurnedToTheRight => "turned by 90° to the right",
            Self::TurnedToTheLeft => "turned by 90° to the left",
        }
    }

    /// The same done back: from a pixel as given, in a picture of this size, to the pixel meant. NaN stays NaN.
    #[inline]
    pub fn meant_px(self, [u, v]: [f64; 2], (width, height): (u32, u32)) -> [f64; 2] {
        let (last_u, last_v) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        match self {
            Self::AsTheyAre => [u, v],
            Self::MirroredLeftRight => [last_u - u, v],
            Self::MirroredUpDown => [u, last_v - v],
            Self::TurnedBy180 => [last_u - u, last_v - v],
            Self::TurnedToTheRight => [v, last_v - u],
            Self::TurnedToTheLeft => [last_u - v, u],
        }
    }
}

/// How the board's corners were counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Labels {
    /// Along the board's axes.
    AsTheyAre,
    /// Against its x axis.
    ReversedInX,
    /// Against its y axis.
    ReversedInY,
}

impl Labels {
    /// The label under which the corner `index = iy nx + ix` was given.
    #[inline]
    pub fn given_as(self, index: usize, (nx, ny): (usize, usize)) -> usize {
        let (ix, iy) = (index % nx, index / nx);
        match self {
            Self::AsTheyAre => index,
            Self::ReversedInX => iy * nx + (nx - 1 - ix),
            Self::ReversedInY => (ny - 1 - iy) * nx + ix,
        }
    }
}

/// By how much board or camera are larger than stated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// They are as stated.
    AsStated,
    /// The squares' side.
    Squares(f64),
    /// The camera's resolution: focal lengths and principal point together.
    Resolution(f64),
    /// The camera's focal lengths alone: another lens, a zoom, a crop.
    FocalLength(f64),
}

impl Scale {
    /// The factor; 1 where all is as stated.
    pub fn factor(self) -> f64 {
        match self {
            Self::AsStated => 1.0,
            Self::Squares(factor) | Self::Resolution(factor) | Self::FocalLength(factor) => factor,
        }
    }

    /// The board of this scale.
    ///
    /// # Errors
    /// As [`Board::new`].
    pub fn board(self, stated: &Board) -> Result<Board> {
        match self {
            Self::Squares(factor) => Board::new(stated.corners(), stated.square_m() * factor),
            _ => Ok(*stated),
        }
    }

    /// The camera of this scale. Of another resolution: pixel centres are whole numbers, so the picture's corner at −0.5 px
    /// stays where it is, `c' = (c + 0.5) k − 0.5`. (Its picture's size is not used, and stays.)
    ///
    /// # Errors
    /// As [`Camera::with_intrinsics`].
    pub fn camera(self, stated: &Camera) -> Result<Camera> {
        let (focal, center) = (stated.focal_px(), stated.center_px());
        match self {
            Self::Resolution(factor) => {
                let center = center.map(|c| (c + 0.5) * factor - 0.5);
                stated.clone().with_intrinsics(focal * factor, center)
            }
            Self::FocalLength(factor) => stated.clone().with_intrinsics(focal * factor, center),
            Self::AsStated | Self::Squares(_) => Ok(stated.clone()),
        }
    }
}

/// One interpretation of a session: what was done to pictures, labels, board and camera, and how to correct it.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// A short name.
    pub name: String,
    /// What is wrong, as a part of a sentence; empty of the session as it stands.
    pub said: String,
    /// How to correct it.
    pub fix: String,
    /// How many mistakes it takes.
    pub mistakes: u8,
    /// The effect by which a diagnosis names it; none where its vocabulary has no word.
    pub effect: Option<&'static str>,
    /// What was done to the pictures.
    pub pictures: Pictures,
    /// How the corners were counted.
    pub labels: Labels,
    /// From the board as meant to the board as modelled: its mount.
    pub board_from_meant: Isometry3<f64>,
    /// `C_r`: from the frame that the model took for the camera's optical frame to the optical frame.
    pub optical_from_modelled: Isometry3<f64>,
    /// By how much board or camera are larger than stated.
    pub scale: Scale,
}

impl Reading {
    /// The session as it stands.
    pub fn as_it_stands() -> Self {
        Self {
            name: "as it stands".into(),
            said: String::new(),
            fix: String::new(),
            mistakes: 0,
            effect: None,
            pictures: Pictures::AsTheyAre,
            labels: Labels::AsTheyAre,
            board_from_meant: Isometry3::identity(),
            optical_from_modelled: Isometry3::identity(),
            scale: Scale::AsStated,
        }
    }

    /// One mistake, in words; what it is about is as it stands.
    pub(super) fn mistake(
        name: impl Into<String>,
        said: impl Into<String>,
        fix: impl Into<String>,
        effect: Option<&'static str>,
    ) -> Self {
        let (name, said, fix) = (name.into(), said.into(), fix.into());
        Self { name, said, fix, mistakes: 1, effect, ..Self::as_it_stands() }
    }
}
