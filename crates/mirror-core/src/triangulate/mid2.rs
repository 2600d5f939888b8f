//! Lee and Civera's mid2, and mid2 with its second-order bias removed.

use super::options::{Triangulated, TriangulationOptions};
use super::parallax::{enough, widest_angle_rad};
use super::rays::{beyond_mirror, finished};
use crate::error::{Error, Result};
use crate::geometry::Ray;
use crate::mirror::VirtualRay;
use nalgebra::{Matrix3, Matrix3x2, Matrix6, Point3, Unit, Vector6};

/// A pivot below this share of the largest one is rounding: the covariance has no noise along it.
const PIVOT_RATIO: f64 = 1e-14;

/// mid2's point and the distances along its rays.
struct Mid2 {
    point: Point3<f64>,
    along: [f64; 2],
}

/// `λ₀ = |d₁ × t|/|d₀ × d₁|`, `λ₁ = |d₀ × t|/|d₀ × d₁|`, and the mean of the two points weighted with `1/λ`.
fn mid2(a: &Ray, b: &Ray) -> Mid2 {
    let (da, db) = (a.direction.into_inner(), b.direction.into_inner());
    let t = a.origin - b.origin;
    let p = da.cross(&db);
    let (q, r) = (da.cross(&t), db.cross(&t));
    // The distances' signs are those of the closest points'.
    let sign = |x: f64| if x > 0.0 { 1.0 } else { -1.0 };
    let along = [sign(p.dot(&r)) * r.norm() / p.norm(), sign(p.dot(&q)) * q.norm() / p.norm()];
    let weight = along[1] / (along[0] + along[1]);
    let point = Point3::from(a.at(along[0]).coords * weight + b.at(along[1]).coords * (1.0 - weight));
    Mid2 { point, along }
}

/// Both estimators: the check of the input, the point, the first-order covariance.
fn solved(
    rays: &[VirtualRay],
    options: &TriangulationOptions,
    bias: impl Fn(&VirtualRay, &VirtualRay) -> nalgebra::Vector3<f64>,
) -> Result<Triangulated> {
    let options = options.validated()?;
    let [a, b] = rays else {
        return Err(Error::LengthMismatch { what: "rays for mid2".into(), got: rays.len(), needed: 2 });
    };
    let parallax_rad = enough(widest_angle_rad(rays.iter().map(|r| &r.ray))?, options.least_parallax_rad)?;
    let found = mid2(&a.ray, &b.ray);
    for (view, (ray, along)) in rays.iter().zip(found.along).enumerate() {
        beyond_mirror(view, &found.point, along, ray.mirror_at_m)?;
    }
    let point = found.point - bias(a, b);
    // Where rays (nearly) meet, the distances move as those of the closest points: δλ = −(DᵀD)⁻¹ Dᵀ (u_a − u_b).
    let (da, db) = (a.ray.direction.into_inner(), b.ray.direction.into_inner());
    let weight = found.along[1] / (found.along[0] + found.along[1]);
    let d = Matrix3x2::from_columns(&[da, -db]);
    let gram = (d.transpose() * d).try_inverse().ok_or(Error::Undetermined { what: "marker position" })?;
    let along = Matrix3x2::from_columns(&[da * weight, db * (1.0 - weight)]) * gram * d.transpose();
    let by_ray_point = |k: usize| match k {
        0 => Matrix3::from_diagonal_element(weight) - along,
        _ => Matrix3::from_diagonal_element(1.0 - weight) + along,
    };
    finished(point, rays, parallax_rad, by_ray_point, &options)
}

/// Lee and Civera's mid2: along each of two rays the distance by the law of sines, `λ₀ = |d₁ × t|/|d₀ × d₁|`,
/// `λ₁ = |d₀ × t|/|d₀ × d₁|` (t between the origins), and the mean of the two points, weighted with `1/λ`.
///
/// The "cameras" are the virtual ones. With small parallax the midpoint's MEDIAN is drawn towards the cameras, by the
/// square of noise over parallax; this one's half as far. In the MEAN the midpoint is nearly right (two biases
/// cancel) and this one lies too far out: where the mean matters, use [`unbiased`].
///
/// # Errors
/// As [`super::midpoint`], and [`Error::LengthMismatch`] for other than two rays.
///
/// # Source
/// Lee and Civera 2019, "Triangulation: Why Optimize?", the inverse-depth weighted midpoint with mid2's depths.
pub fn lee_civera_mid2(rays: &[VirtualRay], options: &TriangulationOptions) -> Result<Triangulated> {
    solved(rays, options, |_, _| nalgebra::Vector3::zeros())
}

/// [`lee_civera_mid2`] with its bias removed to second order: `x − ½ Σ_j D²x[l_j, l_j]`, with the columns `l_j` of the
/// square roots of the rays' covariances (pixels and mirrors), as second differences. A closed form of two rays.
///
/// # Errors
/// As [`lee_civera_mid2`].
pub fn unbiased(rays: &[VirtualRay], options: &TriangulationOptions) -> Result<Triangulated> {
    solved(rays, options, |a, b| {
        let centre = mid2(&a.ray, &b.ray).point.coords;
        let mut sum = nalgebra::Vector3::zeros();
        for column in semidefinite_root(&a.measurement_covariance).column_iter() {
            let l = column.into_owned();
            sum += mid2(&moved(&a.ray, &l), &b.ray).point.coords - centre * 2.0;
            sum += mid2(&moved(&a.ray, &-l), &b.ray).point.coords;
        }
        for column in semidefinite_root(&b.measurement_covariance).column_iter() {
            let l = column.into_owned();
            sum += mid2(&a.ray, &moved(&b.ray, &l)).point.coords - centre * 2.0;
            sum += mid2(&a.ray, &moved(&b.ray, &-l)).point.coords;
        }
        sum * 0.5
    })
}

/// A ray moved by an error of its (origin, direction).
fn moved(ray: &Ray, error: &Vector6<f64>) -> Ray {
    let direction = ray.direction.into_inner() + error.fixed_rows::<3>(3);
    Ray { origin: ray.origin + error.fixed_rows::<3>(0), direction: Unit::new_normalize(direction) }
}

/// Cholesky's factor of a covariance that may be singular (a direction has two degrees of freedom in three numbers).
fn semidefinite_root(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let mut root = Matrix6::zeros();
    let mut rest = *covariance;
    let smallest = PIVOT_RATIO * covariance.diagonal().max();
    for column in 0..6 {
        // The largest remaining pivot first: the small ones are then differences of rounding.
        let pivot = rest.diagonal().imax();
        let size = rest[(pivot, pivot)];
        if size <= smallest {
            break;
        }
        let l = rest.column(pivot) / size.sqrt();
        rest -= l * l.transpose();
        root.set_column(column, &l);
    }
    root
}
