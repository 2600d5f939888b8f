//! The scene in front of the mirror: painted solids, the room, the lamps.

use super::{Beam, Colour, Lights, Pane, Shape, Touch};
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use std::ops::Range;

/// Bodies whose bounding ball is smaller than this (m) are tested ball by ball, and throw shadows.
const SMALL_BODY_M: f64 = 0.25;
/// Bodies in a ball that is not divided further: testing a ball costs a third of testing a body.
const LEAF_BODIES: usize = 3;

/// What colours a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Paint {
    /// One colour.
    Plain(Colour),
    /// A chessboard printed on a [`Shape::Sheet`], squares and a white border around them.
    ///
    /// The square with the smallest x and y is dark.
    Chessboard {
        /// Number of squares along x and y.
        squares: [u32; 2],
        /// Edge of a square, m.
        square_m: f64,
    },
    /// Planks along x with a faint grain.
    Wood(Colour),
}

/// The appearance of a body's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Its colour.
    pub paint: Paint,
    /// Strength of its highlight; 0 is matt.
    pub gloss: f64,
}

/// A painted solid at its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// The solid.
    pub shape: Shape,
    /// Its place.
    pub scene_from_body: Isometry3<f64>,
    /// Its surface.
    pub material: Material,
}

/// Reflectance of the board's ink and paper.
const INK: f64 = 0.03;
const PAPER: f64 = 0.88;

impl Paint {
    /// The colour at a point of the body, in the body's frame.
    #[inline]
    pub(super) fn colour(&self, at: &Vector3<f64>) -> Colour {
        match *self {
            Self::Plain(colour) => colour,
            Self::Chessboard { squares, square_m } => {
                let column = (at.x / square_m + f64::from(squares[0]) / 2.0).floor();
                let row = (at.y / square_m + f64::from(squares[1]) / 2.0).floor();
                let inside = column >= 0.0
                    && row >= 0.0
                    && column < f64::from(squares[0])
                    && row < f64::from(squares[1]);
                let dark = inside && (column + row) as i64 % 2 == 0;
                Colour::repeat(if dark { INK } else { PAPER })
            }
            Self::Wood(colour) => {
                let plank = (at.y / 0.09).floor();
                let grain = (at.y * 260.0 + (at.x * 9.0 + plank * 1.7).sin() * 2.2).sin() * 0.035
                    + (at.y * 90.0 + (at.x * 4.0 + plank * 4.1).sin() * 1.5).sin() * 0.04;
                let seam = if (at.y / 0.09 - plank) < 0.015 { 0.6 } else { 1.0 };
                colour * ((1.0 + grain + (plank * 12.9898).sin() * 0.07) * seam)
            }
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Placed {
    shape: Shape,
    pub(super) material: Material,
    scene_from_body: Matrix3<f64>,
    body_from_scene: Matrix3<f64>,
    pub(super) center: Vector3<f64>,
    radius2: f64,
}

/// A ball around neighbouring bodies: a node of the bounding volume hierarchy, which is stored in depth-first order.
#[derive(Debug, Clone)]
struct Ball {
    center: Vector3<f64>,
    radius2: f64,
    /// The bodies themselves in a leaf; none in a ball that is divided into the two after it.
    bodies: Range<usize>,
    /// Where a beam that misses the ball continues: after all balls within.
    after: usize,
}

/// Sorts bodies so that neighbours are adjacent, and encloses them in balls: halves along the widest axis until few
/// are left.
///
/// `indices` are the bodies from place `first` of the sorted order on.
fn gather(bodies: &[Body], indices: &mut [usize], first: usize, balls: &mut Vec<Ball>) {
    if indices.is_empty() {
        return;
    }
    let center = |i: usize| bodies[i].scene_from_body.translation.vector;
    let middle = indices.iter().map(|&i| center(i)).sum::<Vector3<f64>>() / indices.len() as f64;
    let reach = |i: usize| (center(i) - middle).norm() + bodies[i].shape.bounding_radius_m();
    let radius = indices.iter().map(|&i| reach(i)).fold(0.0, f64::max);
    let here = balls.len();
    balls.push(Ball { center: middle, radius2: radius * radius, bodies: first..first, after: 0 });
    if indices.len() <= LEAF_BODIES {
        balls[here].bodies.end += indices.len();
    } else {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for &i in indices.iter() {
            low = low.inf(&center(i));
            high = high.sup(&center(i));
        }
        let axis = (high - low).imax();
        indices.sort_by(|&a, &b| center(a)[axis].total_cmp(&center(b)[axis]));
        let (left, right) = indices.split_at_mut(indices.len() / 2);
        gather(bodies, left, first, balls);
        gather(bodies, right, first + left.len(), balls);
    }
    balls[here].after = balls.len();
}

/// What a beam meets first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Meeting {
    pub distance_m: f64,
    /// Outward unit normal, scene frame.
    pub normal: Vector3<f64>,
    /// Index of the body.
    pub body: usize,
}

/// Everything that a picture shows: bodies, lights, the eye's place, and the mirror, in one frame (z up).
#[derive(Debug, Clone)]
pub struct Scene {
    pub(super) bodies: Vec<Placed>,
    /// Bodies `0..small` are in balls, neighbours adjacent; then come large ones in front of the mirror's front
    /// face; then, from `behind` on, large ones at or behind it, which no light from the mirror reaches.
    small: usize,
    behind: usize,
    balls: Vec<Ball>,
    /// For each given body, its index here.
    order: Vec<usize>,
    /// The lamps and the light of the room.
    pub(super) lights: Lights,
    /// The camera's pose: optical frame, z forward, x right, y down.
    pub(super) scene_from_camera: Isometry3<f64>,
    pub(super) eye_rotation: Matrix3<f64>,
    /// The mirror, where there is one.
    pub(super) pane: Option<Pane>,
}

impl Scene {
    /// A scene of these bodies.
    pub fn new(
        bodies: &[Body],
        lights: Lights,
        scene_from_camera: Isometry3<f64>,
        pane: Option<Pane>,
    ) -> Self {
        let is_small = |i: &usize| bodies[*i].shape.bounding_radius_m() < SMALL_BODY_M;
        let (mut sorted, mut large): (Vec<usize>, Vec<usize>) = (0..bodies.len()).partition(is_small);
        let small = sorted.len();
        let center = |i: usize| bodies[i].scene_from_body.translation.vector;
        let mut balls = Vec::new();
        gather(bodies, &mut sorted, 0, &mut balls);
        let is_behind = |i: &usize| {
            pane.as_ref().is_some_and(|pane: &Pane| (center(*i) - pane.center()).dot(&pane.normal()) >= 0.0)
        };
        large.sort_by_key(is_behind);
        let behind = small + large.iter().filter(|i| !is_behind(i)).count();
        sorted.extend(large);
        let placed: Vec<Placed> = sorted.iter().map(|&i| Placed::new(&bodies[i])).collect();
        let mut order = vec![0; bodies.len()];
        for (here, &given) in sorted.iter().enumerate() {
            order[given] = here;
        }
        let eye_rotation = scene_from_camera.rotation.to_rotation_matrix().into_inner();
        Self { bodies: placed, small, behind, balls, order, lights, scene_from_camera, eye_rotation, pane }
    }

    /// Index, in the numbering of hits, of the body that was given as number `given`.
    pub(super) fn index_of(&self, given: usize) -> usize {
        self.order[given]
    }

    /// The body that a beam that leaves the mirror meets first.
    #[inline]
    pub(super) fn first_meeting(&self, beam: &Beam) -> Option<Meeting> {
        self.first_of(beam, f64::INFINITY, self.behind)
    }

    /// The body that a beam from the eye meets first: before the mirror, where it meets that at this distance (m).
    #[inline]
    pub(super) fn first_before(&self, beam: &Beam, mirror_m: Option<f64>) -> Option<Meeting> {
        match mirror_m {
            Some(mirror_m) => self.first_of(beam, mirror_m, self.small),
            None => self.first_of(beam, f64::INFINITY, self.bodies.len()),
        }
    }

    /// The first of the small bodies and of the large ones up to a number, nearer than a limit.
    #[inline]
    fn first_of(&self, beam: &Beam, limit_m: f64, end: usize) -> Option<Meeting> {
        let mut best: Option<(Touch, usize)> = None;
        let mut nearest = limit_m;
        let mut test = |range: Range<usize>, nearest: &mut f64| {
            for i in range {
                if let Some(touch) = self.bodies[i].touch(beam, *nearest) {
                    *nearest = touch.distance_m;
                    best = Some((touch, i));
                }
            }
        };
        let mut next = 0;
        while let Some(ball) = self.balls.get(next) {
            next = if reaches(beam, &ball.center, ball.radius2, nearest) {
                test(ball.bodies.clone(), &mut nearest);
                next + 1
            } else {
                ball.after
            };
        }
        test(self.small..end, &mut nearest);
        let (touch, body) = best?;
        let normal = self.bodies[body].scene_from_body * touch.normal;
        Some(Meeting { distance_m: touch.distance_m, normal, body })
    }

    /// Whether a small body is within this distance (m) along the beam.
    #[inline]
    pub(super) fn is_blocked(&self, beam: &Beam, within_m: f64) -> bool {
        let mut next = 0;
        while let Some(ball) = self.balls.get(next) {
            next = if reaches(beam, &ball.center, ball.radius2, within_m) {
                if self.bodies[ball.bodies.clone()].iter().any(|body| body.touch(beam, within_m).is_some()) {
                    return true;
                }
                next + 1
            } else {
                ball.after
            };
        }
        false
    }

    /// Whether a beam meets one body alone, and where.
    pub(super) fn meets_alone(&self, body: usize, beam: &Beam) -> Option<f64> {
        self.bodies[body].touch(beam, f64::INFINITY).map(|t| t.distance_m)
    }

    /// Colour of a body at a point of the scene.
    #[inline]
    pub(super) fn colour_at(&self, body: usize, at: &Vector3<f64>) -> Colour {
        let body = &self.bodies[body];
        match body.material.paint {
            Paint::Plain(colour) => colour,
            paint => paint.colour(&(body.body_from_scene * (at - body.center))),
        }
    }
}

impl Placed {
    fn new(body: &Body) -> Self {
        let rotation = body.scene_from_body.rotation.to_rotation_matrix().into_inner();
        let radius = body.shape.bounding_radius_m();
        Self {
            shape: body.shape,
            material: body.material,
            scene_from_body: rotation,
            body_from_scene: rotation.transpose(),
            center: body.scene_from_body.translation.vector,
            radius2: radius * radius,
        }
    }

    /// Radius of the bounding ball, m.
    pub(super) fn radius_m(&self) -> f64 {
        self.radius2.sqrt()
    }

    /// The first touch nearer than a limit, normal in the body's frame.
    #[inline]
    fn touch(&self, beam: &Beam, limit_m: f64) -> Option<Touch> {
        if !reaches(beam, &self.center, self.radius2, limit_m) {
            return None;
        }
        let from = self.body_from_scene * (beam.from - self.center);
        let along = self.body_from_scene * beam.along;
        self.shape.touch(&from, &along).filter(|t| t.distance_m < limit_m)
    }
}

/// Whether a beam, up to a length, touches a ball.
#[inline]
fn reaches(beam: &Beam, center: &Vector3<f64>, radius2: f64, within_m: f64) -> bool {
    let to = center - beam.from;
    let ahead = to.dot(&beam.along);
    let aside2 = to.norm_squared() - ahead * ahead;
    if aside2 > radius2 {
        return false;
    }
    // Its nearest place to the centre lies on the beam.
    if ahead > 0.0 && ahead < within_m {
        return true;
    }
    let half_chord = (radius2 - aside2).sqrt();
    ahead + half_chord > 0.0 && ahead - half_chord < within_m
}

fn block(half: [f64; 3], at: Vector3<f64>, rotation: UnitQuaternion<f64>, material: Material) -> Body {
    Body {
        shape: Shape::Block { half_m: Vector3::from(half) },
        scene_from_body: Isometry3::from_parts(Translation3::from(at), rotation),
        material,
    }
}

fn plain(r: f64, g: f64, b: f64, gloss: f64) -> Material {
    Material { paint: Paint::Plain(Colour::new(r, g, b)), gloss }
}

/// The room: table, walls before and behind, the stand that holds the torso, the mirror's frame and feet.
///
/// `floor_m` is the table's height (z, m) in the scene's frame. Greys and pale wood only: nothing in the room
/// may be taken for a coloured marker.
pub fn furnish(floor_m: f64, pane: Option<&Pane>) -> Vec<Body> {
    let upright = UnitQuaternion::identity();
    let wall = plain(0.50, 0.51, 0.53, 0.0);
    let dark = plain(0.05, 0.05, 0.06, 0.3);
    let wood = Material { paint: Paint::Wood(Colour::new(0.40, 0.355, 0.31)), gloss: 0.05 };
    let mut bodies = vec![
        block([2.0, 2.0, 0.02], Vector3::new(0.0, 0.0, floor_m - 0.02), upright, wood),
        block([0.02, 3.0, 2.0], Vector3::new(-0.75, 0.0, 0.9), upright, wall),
        block([0.02, 3.0, 2.0], Vector3::new(1.6, 0.0, 0.9), upright, wall),
        // The stand: a post behind the back, a clamp, a foot plate.
        block([0.006, 0.012, 0.09], Vector3::new(-0.062, 0.0, floor_m + 0.09), upright, dark),
        block([0.014, 0.010, 0.012], Vector3::new(-0.05, 0.0, 0.045), upright, dark),
        block([0.05, 0.06, 0.003], Vector3::new(-0.062, 0.0, floor_m + 0.003), upright, dark),
    ];
    if let Some(pane) = pane {
        bodies.extend(frame_of(pane));
    }
    bodies
}

/// A dark frame around the mirror and a board behind it.
fn frame_of(pane: &Pane) -> Vec<Body> {
    const RIM_M: f64 = 0.008;
    let (across, up) = pane.edges();
    let normal = pane.normal();
    let o = pane.options();
    let rotation = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(
        Matrix3::from_columns(&[across, up, across.cross(&up)]),
    ));
    let dark = plain(0.035, 0.035, 0.04, 0.3);
    let (w, h) = (o.width_m / 2.0, o.height_m / 2.0);
    let at = |x: f64, y: f64, z: f64| pane.center() + across * x + up * y + normal * z;
    let middle = o.glass_thickness_m / 2.0;
    let mut bodies = vec![block([w + RIM_M, h + RIM_M, 0.003], at(0.0, 0.0, 0.02), rotation, dark)];
    for side in [-1.0, 1.0] {
        bodies.push(block(
            [RIM_M, h + 2.0 * RIM_M, 0.006],
            at(side * (w + RIM_M), 0.0, middle),
            rotation,
            dark,
        ));
        bodies.push(block([w, RIM_M, 0.006], at(0.0, side * (h + RIM_M), middle), rotation, dark));
    }
    bodies
}
