//! What must hold at the core's borders, on the corpus of the fuzz targets and on some mutations of it; `make fuzz` runs many.

#[path = "../../fuzz/src/lib.rs"]
mod borders;

use rand::prelude::*;
use rand_chacha::ChaCha8Rng;
use std::path::Path;

const MUTATIONS: usize = 300;

fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let files = |place: &str| {
        let mut files: Vec<_> = std::fs::read_dir(folder.join(place))
            .map(|entries| entries.flatten().map(|e| e.path()).collect())
            .unwrap_or_default();
        files.sort();
        files
    };
    let mut found = files(&format!("corpus/{target}"));
    if matches!(target, "urdf" | "dress") {
        found.extend(files("seeds"));
    }
    found.iter().map(|file| std::fs::read(file).expect("a file of the corpus")).collect()
}

/// One to four places cut out, doubled, exchanged or overwritten.
fn mutated(data: &[u8], chance: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = data.to_vec();
    for _ in 0..chance.random_range(1..5) {
        let start = chance.random_range(0..=out.len());
        let end = (start + chance.random_range(0..24)).min(out.len());
        match chance.random_range(0..4) {
            0 => drop(out.drain(start..end)),
            1 => {
                let part = out[start..end].to_vec();
                let at = chance.random_range(0..=out.len());
                out.splice(at..at, part);
            }
            2 => out[start..end].iter_mut().for_each(|byte| *byte = chance.random()),
            _ => out.truncate(out.len().max(8) - chance.random_range(0..8)),
        }
    }
    out
}

fn run(target: &str, mutations: usize, check: impl Fn(&[u8])) {
    let corpus = corpus(target);
    assert!(!corpus.is_empty(), "the corpus of {target} is missing");
    corpus.iter().for_each(|data| check(data));
    let mut chance = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..mutations {
        let data = mutated(corpus.choose(&mut chance).expect("an input"), &mut chance);
        check(&data);
    }
}

fn text(check: impl Fn(&str)) -> impl Fn(&[u8]) {
    move |data| check(&String::from_utf8_lossy(data))
}

#[test]
fn urdf() {
    run("urdf", MUTATIONS, text(borders::urdf));
}

#[test]
fn dress() {
    run("dress", MUTATIONS, text(borders::dress));
}

#[test]
fn camera() {
    run("camera", MUTATIONS, borders::camera);
}

#[test]
fn recording() {
    run("recording", MUTATIONS, borders::recording);
}

#[test]
fn diagnosis() {
    run("diagnosis", 10, borders::diagnosis);
}
