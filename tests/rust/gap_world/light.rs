//! The way of the light from a point over the mirror into the real camera.

use super::{CENTER_PX, FOCAL_PX, GLASS_INDEX, Plan, Wrong};
use nalgebra::{Isometry3, Matrix2, Vector2, Vector3};

/// The way of the light and the real camera.
pub(super) struct Light {
    pub(super) mount: Isometry3<f64>,
    focal_px: f64,
    pub(super) center_px: Vector2<f64>,
    /// How far beside their images markers are detected.
    pub(super) detected_px: Vector2<f64>,
    pub(super) color_focal: f64,
    k1: f64,
    pub(super) board_scale: f64,
    pub(super) board: Isometry3<f64>,
    glass_m: f64,
    curvature: f64,
}

impl Light {
    pub(super) fn of(plan: &Plan) -> Self {
        let mut out = Self {
            mount: Isometry3::identity(),
            focal_px: FOCAL_PX,
            center_px: Vector2::from(CENTER_PX),
            detected_px: Vector2::zeros(),
            color_focal: 0.0,
            k1: 0.0,
            board_scale: 1.0,
            board: Isometry3::identity(),
            glass_m: 0.0,
            curvature: 0.0,
        };
        for w in &plan.wrong {
            match *w {
                Wrong::CameraMount([a, b, c, x, y, z]) => {
                    out.mount = Isometry3::new(Vector3::new(x, y, z), Vector3::new(a, b, c));
                }
                Wrong::BoardMount([a, b, c, x, y, z]) => {
                    out.board = Isometry3::new(Vector3::new(x, y, z), Vector3::new(a, b, c));
                }
                Wrong::Focal(e) => out.focal_px *= 1.0 + e,
                Wrong::Center(u, v) => out.center_px += Vector2::new(u, v),
                Wrong::MarkersDetected(u, v) => out.detected_px = Vector2::new(u, v),
                Wrong::MarkersFocal(e) => out.color_focal = e,
                Wrong::Radial(k) => out.k1 = k,
                Wrong::BoardScale(e) => out.board_scale = 1.0 + e,
                Wrong::Glass(t) => out.glass_m = t,
                Wrong::Curvature(k) => out.curvature = k,
                _ => {}
            }
        }
        out
    }

    /// The pixel at which a point in the camera's frame is seen in a mirror of normal and distance.
    pub(super) fn pixel(
        &self,
        point: &Vector3<f64>,
        (normal, distance): &(Vector3<f64>, f64),
    ) -> Vector2<f64> {
        let sight = if self.curvature == 0.0 {
            self.by_angle(point, normal, *distance)
        } else {
            self.by_least_way(point, normal, *distance)
        };
        let (x, y) = (sight.x / sight.z, sight.y / sight.z);
        let radial = 1.0 + self.k1 * (x * x + y * y);
        Vector2::new(x, y) * (radial * self.focal_px) + self.center_px
    }

    /// Flat mirror, silvered behind a pane: the angle of incidence whose way meets the point, by bisection.
    fn by_angle(&self, point: &Vector3<f64>, normal: &Vector3<f64>, distance: f64) -> Vector3<f64> {
        let height = distance - normal.dot(point);
        let across = point - normal * normal.dot(point);
        let needed = across.norm();
        if needed < 1e-12 {
            return *normal;
        }
        let reached = |angle: f64| {
            let inside = (angle.sin() / GLASS_INDEX).asin();
            (distance + height) * angle.tan() + 2.0 * self.glass_m * inside.tan()
        };
        let (mut low, mut high) = (0.0, 1.5);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if reached(middle) < needed { low = middle } else { high = middle }
        }
        normal * low.cos() + across / needed * low.sin()
    }

    /// Hollow mirror: the place on the sphere over which the way is stationary, by Newton's method.
    fn by_least_way(&self, point: &Vector3<f64>, normal: &Vector3<f64>, distance: f64) -> Vector3<f64> {
        let e = normal.cross(&Vector3::y()).normalize();
        let g = normal.cross(&e);
        let radius = 1.0 / self.curvature;
        // Towards its edge a hollow mirror comes nearer to the camera.
        let surface = |s: &Vector2<f64>| -> (Vector3<f64>, [Vector3<f64>; 2]) {
            let root = (radius * radius - s.norm_squared()).sqrt();
            let sag = radius - radius.signum() * root;
            let slope = s / (radius.signum() * root);
            let at = normal * (distance - sag) + e * s.x + g * s.y;
            (at, [e - normal * slope.x, g - normal * slope.y])
        };
        let gradient = |s: &Vector2<f64>| {
            let (m, [a, b]) = surface(s);
            let unit = m.normalize() + (m - point).normalize();
            Vector2::new(a.dot(&unit), b.dot(&unit))
        };
        let mut s = Vector2::zeros();
        for _ in 0..12 {
            let h = 1e-6;
            let column = |d: Vector2<f64>| (gradient(&(s + d)) - gradient(&(s - d))) / (2.0 * h);
            let hessian =
                Matrix2::from_columns(&[column(Vector2::new(h, 0.0)), column(Vector2::new(0.0, h))]);
            s -= hessian.try_inverse().unwrap() * gradient(&s);
        }
        surface(&s).0
    }
}
