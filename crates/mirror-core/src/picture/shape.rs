//! Solids that a beam can meet, each in its own frame.

use nalgebra::Vector3;

/// A touch nearer than this (m) is the surface that the beam starts on.
pub(super) const NEAREST_TOUCH_M: f64 = 1e-7;

/// A solid in its own frame, centred at its origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball of this radius, m.
    Ball {
        /// Radius, m.
        radius_m: f64,
    },
    /// A block with these half edge lengths, m.
    Block {
        /// Half of each edge, m.
        half_m: Vector3<f64>,
    },
    /// A cylinder about z, closed at both ends.
    Cylinder {
        /// Radius, m.
        radius_m: f64,
        /// Half of its length, m.
        half_length_m: f64,
    },
    /// A printed sheet in the plane z = 0, seen from +z only.
    Sheet {
        /// Half of its extent along x, m.
        half_x_m: f64,
        /// Half of its extent along y, m.
        half_y_m: f64,
    },
}

/// Where a beam meets a solid's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Distance along the beam, m.
    pub distance_m: f64,
    /// Outward unit normal.
    pub normal: Vector3<f64>,
}

impl Shape {
    /// Radius of the ball about the origin that holds the solid, m.
    pub fn bounding_radius_m(&self) -> f64 {
        match *self {
            Self::Ball { radius_m } => radius_m,
            Self::Block { half_m } => half_m.norm(),
            Self::Cylinder { radius_m, half_length_m } => radius_m.hypot(half_length_m),
            Self::Sheet { half_x_m, half_y_m } => half_x_m.hypot(half_y_m),
        }
    }

    /// First touch of a beam that comes from outside; beams that start inside pass.
    #[inline]
    pub fn touch(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Touch> {
        match *self {
            Self::Ball { radius_m } => touch_ball(radius_m, from, along),
            Self::Block { half_m } => touch_block(&half_m, from, along),
            Self::Cylinder { radius_m, half_length_m } => {
                touch_cylinder(radius_m, half_length_m, from, along)
            }
            Self::Sheet { half_x_m, half_y_m } => touch_sheet(half_x_m, half_y_m, from, along),
        }
    }
}

/// `|from + t along|² = r²`, the nearer root.
#[inline]
fn touch_ball(radius_m: f64, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Touch> {
    let half_b = from.dot(along);
    let closest = from - along * half_b;
    let inside = radius_m * radius_m - closest.norm_squared();
    if inside <= 0.0 {
        return None;
    }
    let distance_m = -half_b - inside.sqrt();
    (distance_m > NEAREST_TOUCH_M)
        .then(|| Touch { distance_m, normal: (from + along * distance_m) / radius_m })
}

/// The slab method: the beam is inside the block between the last entry into and the first exit from a slab.
#[inline]
fn touch_block(half: &Vector3<f64>, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Touch> {
    let mut enter = f64::NEG_INFINITY;
    let mut leave = f64::INFINITY;
    let mut axis = 0;
    for i in 0..3 {
        let inverse = 1.0 / along[i];
        let a = (-half[i] - from[i]) * inverse;
        let b = (half[i] - from[i]) * inverse;
        let (near, far) = if a < b { (a, b) } else { (b, a) };
        if near > enter {
            enter = near;
            axis = i;
        }
        leave = leave.min(far);
    }
    if !(enter < leave && enter > NEAREST_TOUCH_M) {
        return None;
    }
    let mut normal = Vector3::zeros();
    normal[axis] = -along[axis].signum();
    Some(Touch { distance_m: enter, normal })
}

#[inline]
fn touch_cylinder(
    radius_m: f64,
    half_length_m: f64,
    from: &Vector3<f64>,
    along: &Vector3<f64>,
) -> Option<Touch> {
    // The caps: only the one that faces the beam can be met first.
    if along.z != 0.0 {
        let cap = -along.z.signum() * half_length_m;
        let t = (cap - from.z) / along.z;
        let (x, y) = (from.x + t * along.x, from.y + t * along.y);
        if t > NEAREST_TOUCH_M && x * x + y * y <= radius_m * radius_m {
            return Some(Touch { distance_m: t, normal: Vector3::new(0.0, 0.0, -along.z.signum()) });
        }
    }
    // The mantle: a t² + 2 b t + c = 0, the nearer root.
    let a = along.x * along.x + along.y * along.y;
    let b = from.x * along.x + from.y * along.y;
    let c = from.x * from.x + from.y * from.y - radius_m * radius_m;
    let discriminant = b * b - a * c;
    if !(discriminant > 0.0 && a > 0.0) {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    let at = from + along * t;
    (t > NEAREST_TOUCH_M && at.z.abs() <= half_length_m)
        .then(|| Touch { distance_m: t, normal: Vector3::new(at.x / radius_m, at.y / radius_m, 0.0) })
}

#[inline]
fn touch_sheet(half_x_m: f64, half_y_m: f64, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Touch> {
    if along.z >= 0.0 {
        return None;
    }
    let t = -from.z / along.z;
    let at = from + along * t;
    (t > NEAREST_TOUCH_M && at.x.abs() <= half_x_m && at.y.abs() <= half_y_m)
        .then(|| Touch { distance_m: t, normal: Vector3::z() })
}
