//! Any text dresses a robot in solids of positive, finite size, or is an error that says why not.

#![no_main]

use libfuzzer_sys::fuzz_target;
use mirror_core::picture::{Dress, Shape};

fuzz_target!(|text: &str| {
    match Dress::from_urdf(text) {
        Ok(dress) => {
            for visual in &dress.visuals {
                let sizes = match visual.shape {
                    Shape::Ball { radius_m } => vec![radius_m],
                    Shape::Cylinder { radius_m, half_length_m } => vec![radius_m, half_length_m],
                    Shape::Block { half_m } => half_m.iter().copied().collect(),
                    _ => Vec::new(),
                };
                assert!(sizes.iter().all(|x| x.is_finite() && *x > 0.0), "{sizes:?}");
                assert!(visual.link_from_body.to_homogeneous().iter().all(|x| x.is_finite()));
            }
        }
        Err(refusal) => assert!(!refusal.to_string().is_empty()),
    }
});
