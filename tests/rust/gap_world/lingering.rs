//! Blobs whose errors linger: each frame keeps a part of the error before.

use mirror_core::diagnose::{Recording, Target};
use nalgebra::Vector2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Moves a recording's blobs by errors of `std_px` of which successive ones correlate by `correlation`: `e ← r e + √(1 − r²) n`, from the first frame on in
/// that distribution.
pub fn blobs_linger(recording: &mut Recording, std_px: f64, correlation: f64, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut errors = vec![Vector2::zeros(); recording.markers.len()];
    for (f, frame) in recording.frames.iter_mut().enumerate() {
        let kept = if f == 0 { 0.0 } else { correlation };
        for error in &mut errors {
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            *error = *error * kept + Vector2::new(normal(), normal()) * (1.0 - kept * kept).sqrt();
        }
        for sighting in &mut frame.sightings {
            if let Target::Marker(m) = sighting.target {
                sighting.pixel += errors[m] * std_px;
            }
        }
    }
}
