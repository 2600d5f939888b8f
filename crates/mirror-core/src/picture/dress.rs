//! From a URDF's visual geometry to painted solids.

use super::{Body, Colour, Material, Paint, Shape};
use crate::error::{Error, Result, finite, positive};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::HashMap;

/// Gloss of the body's plastic.
const PLASTIC_GLOSS: f64 = 0.10;
/// Inner corners of a printed board along one side at most.
const MOST_CORNERS: u32 = 1000;
/// Colour of visuals without a material.
const DEFAULT_COLOUR: [f64; 3] = [0.6, 0.6, 0.62];

/// One visual of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct DressedVisual {
    /// Name of the link.
    pub link: String,
    /// The solid.
    pub shape: Shape,
    /// Its place on the link.
    pub link_from_body: Isometry3<f64>,
    /// Its surface.
    pub material: Material,
}

/// All visuals of a robot, by link, independent of its posture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Dress {
    /// The visuals, in the order of the file.
    pub visuals: Vec<DressedVisual>,
    /// Visuals that are meshes, which this tracer does not draw: `link: file`.
    pub skipped_meshes: Vec<String>,
}

impl Dress {
    /// Reads boxes, cylinders and spheres with their colours from a URDF's text.
    ///
    /// Colours are taken as the values of a picture (gamma 2.2), as viewers show them.
    ///
    /// # Errors
    /// [`Error::Picture`] where the text is no URDF; [`Error::OutOfRange`] for a solid without extent;
    /// [`Error::NotFinite`] for a place or a colour that is no number.
    pub fn from_urdf(text: &str) -> Result<Self> {
        let robot = urdf_rs::read_from_string(text)
            .map_err(|e| Error::Picture { what: "reading the URDF's visuals".into(), why: e.to_string() })?;
        let named: HashMap<&str, [f64; 4]> = robot
            .materials
            .iter()
            .filter_map(|m| m.color.as_ref().map(|c| (m.name.as_str(), c.rgba.0)))
            .collect();
        let mut dress = Self::default();
        for link in &robot.links {
            for visual in &link.visual {
                let size = |what: &str, x: f64| positive(&format!("link {}: {what} (m)", link.name), x);
                let shape = match &visual.geometry {
                    urdf_rs::Geometry::Box { size: edges } => Shape::Block {
                        half_m: Vector3::new(
                            size("box edge", edges[0])? / 2.0,
                            size("box edge", edges[1])? / 2.0,
                            size("box edge", edges[2])? / 2.0,
                        ),
                    },
                    urdf_rs::Geometry::Cylinder { radius, length }
                    | urdf_rs::Geometry::Capsule { radius, length } => Shape::Cylinder {
                        radius_m: size("cylinder radius", *radius)?,
                        half_length_m: size("cylinder length", *length)? / 2.0,
                    },
                    urdf_rs::Geometry::Sphere { radius } => {
                        Shape::Ball { radius_m: size("sphere radius", *radius)? }
                    }
                    urdf_rs::Geometry::Mesh { filename, .. } => {
                        dress.skipped_meshes.push(format!("{}: {filename}", link.name));
                        continue;
                    }
                };
                let rgba = visual.material.as_ref().and_then(|m| {
                    m.color.as_ref().map(|c| c.rgba.0).or_else(|| named.get(m.name.as_str()).copied())
                });
                let colour = rgba.map_or(DEFAULT_COLOUR, |c| [c[0], c[1], c[2]]);
                for x in rgba.iter().flatten() {
                    finite(&format!("link {}: colour of a visual", link.name), *x)?;
                }
                let o = &visual.origin;
                for x in o.xyz.iter().chain(o.rpy.iter()) {
                    finite(&format!("link {}: origin of a visual", link.name), *x)?;
                }
                dress.visuals.push(DressedVisual {
                    link: link.name.clone(),
                    shape,
                    link_from_body: Isometry3::from_parts(
                        Translation3::new(o.xyz[0], o.xyz[1], o.xyz[2]),
                        UnitQuaternion::from_euler_angles(o.rpy[0], o.rpy[1], o.rpy[2]),
                    ),
                    material: plastic(colour),
                });
            }
        }
        Ok(dress)
    }

    /// The bodies at the given poses of the links; links without a pose are not drawn.
    pub fn pose<'a>(&self, root_from_link: impl Fn(&str) -> Option<&'a Isometry3<f64>>) -> Vec<Body> {
        let place = |v: &DressedVisual| {
            root_from_link(&v.link).map(|pose| Body {
                shape: v.shape,
                scene_from_body: pose * v.link_from_body,
                material: v.material,
            })
        };
        self.visuals.iter().filter_map(place).collect()
    }
}

/// Satin plastic of a colour given as values of a picture.
pub(super) fn plastic(rgb: [f64; 3]) -> Material {
    let linear = Colour::from(rgb).map(|x| x.clamp(0.0, 1.0).powf(2.2));
    Material { paint: Paint::Plain(linear), gloss: PLASTIC_GLOSS }
}

impl Body {
    /// A ball of satin plastic; the colour is given as values of a picture, 0 to 1.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a diameter that is not above zero.
    pub fn ball(center: Vector3<f64>, diameter_m: f64, rgb: [f64; 3]) -> Result<Self> {
        let radius_m = positive("ball diameter (m)", diameter_m)? / 2.0;
        Ok(Self {
            shape: Shape::Ball { radius_m },
            scene_from_body: Isometry3::from_parts(Translation3::from(center), UnitQuaternion::identity()),
            material: plastic(rgb),
        })
    }

    /// A chessboard of `corners` inner corners printed on a sheet with a white border; origin at the board's
    /// centre, z out of the printed face, the square at the smallest x and y dark.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a square or border without extent, for no corner or more than a thousand a side.
    pub fn chessboard(
        scene_from_board: Isometry3<f64>,
        corners: [u32; 2],
        square_m: f64,
        border_m: f64,
    ) -> Result<Self> {
        positive("board square (m)", square_m)?;
        positive("board border (m)", border_m)?;
        for n in corners {
            if !(1..=MOST_CORNERS).contains(&n) {
                return Err(Error::OutOfRange {
                    what: "inner corners of the board along a side".into(),
                    got: f64::from(n),
                    needed: format!("1 to {MOST_CORNERS}"),
                });
            }
        }
        let squares = corners.map(|n| n + 1);
        let half = |n: u32| f64::from(n) * square_m / 2.0 + border_m;
        Ok(Self {
            shape: Shape::Sheet { half_x_m: half(squares[0]), half_y_m: half(squares[1]) },
            scene_from_body: scene_from_board,
            material: Material { paint: Paint::Chessboard { squares, square_m }, gloss: 0.0 },
        })
    }
}
