//! Test data by tracing light: the way of least time from the camera's centre over the mirror to a point.
//!
//! Shares no formula with the crate: no reflection matrix, no foot point, no projection of a reflected point.
//! The mirror is a point with two edges; the place where light bounces is where the path is shortest (Fermat),
//! sought by Newton's method on the path's length; the pixel is where the sight line to that place cuts the picture.

use nalgebra::{Matrix2, Vector2, Vector3};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// A flat mirror: a point of it and two orthonormal edges.
#[derive(Clone, Copy)]
pub struct Glass {
    pub at: Vector3<f64>,
    pub edges: [Vector3<f64>; 2],
}

impl Glass {
    /// A mirror through a point, turned from "squarely before the camera" by yaw (about y), then pitch (about x), rad.
    pub fn turned(at: Vector3<f64>, yaw: f64, pitch: f64) -> Self {
        let right = Vector3::new(yaw.cos(), 0.0, -yaw.sin());
        let down = Vector3::new(yaw.sin() * pitch.sin(), pitch.cos(), yaw.cos() * pitch.sin());
        Self { at, edges: [right, down] }
    }

    /// Where light from `to` bounces on its way to `from`.
    pub fn bounce(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Vector3<f64> {
        let mut s = Vector2::<f64>::zeros();
        for _ in 0..200 {
            let m: Vector3<f64> = self.at + self.edges[0] * s.x + self.edges[1] * s.y;
            let (a, b): (Vector3<f64>, Vector3<f64>) = (m - from, m - to);
            let (la, lb) = (a.norm(), b.norm());
            let unit = a / la + b / lb;
            let gradient = Vector2::new(self.edges[0].dot(&unit), self.edges[1].dot(&unit));
            let curve = |i: usize, j: usize| {
                let (e, f) = (self.edges[i], self.edges[j]);
                let d = if i == j { 1.0 } else { 0.0 };
                (d - e.dot(&a) * f.dot(&a) / (la * la)) / la + (d - e.dot(&b) * f.dot(&b) / (lb * lb)) / lb
            };
            let hessian = Matrix2::new(curve(0, 0), curve(0, 1), curve(1, 0), curve(1, 1));
            let mut step = -(hessian.try_inverse().unwrap() * gradient);
            // The path's length is convex, so a shortened Newton step always gets there.
            let length = |s: &Vector2<f64>| {
                let m: Vector3<f64> = self.at + self.edges[0] * s.x + self.edges[1] * s.y;
                (m - from).norm() + (m - to).norm()
            };
            while length(&(s + step)) > length(&s) + 1e-15 && step.norm() > 1e-14 {
                step *= 0.5;
            }
            s += step;
            if step.norm() < 1e-15 {
                break;
            }
        }
        self.at + self.edges[0] * s.x + self.edges[1] * s.y
    }
}

/// The picture side of a camera at the origin, looking along z.
#[derive(Clone, Copy)]
pub struct Eye {
    pub focal: f64,
    pub centre: Vector2<f64>,
    /// k1, k2, p1, p2, k3.
    pub lens: [f64; 5],
}

impl Eye {
    /// The paper's: 800×600, f = 693 px, no distortion.
    pub fn of_the_paper() -> Self {
        Self { focal: 693.0, centre: Vector2::new(399.5, 299.5), lens: [0.0; 5] }
    }

    /// The pixel of a sight line.
    pub fn pixel(&self, sight: &Vector3<f64>) -> Vector2<f64> {
        let (x, y) = (sight.x / sight.z, sight.y / sight.z);
        let [k1, k2, p1, p2, k3] = self.lens;
        let r2 = x * x + y * y;
        let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
        let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        Vector2::new(self.focal * xd, self.focal * yd) + self.centre
    }

    /// The pixel of a real point seen in the mirror.
    pub fn pixel_in(&self, glass: &Glass, point: &Vector3<f64>) -> Vector2<f64> {
        self.pixel(&glass.bounce(&Vector3::zeros(), point))
    }
}

/// A pixel with independent normal noise on both axes.
pub fn noisy(pixel: &Vector2<f64>, std_px: f64, rng: &mut impl Rng) -> Vector2<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    pixel + Vector2::new(normal(), normal()) * std_px
}
