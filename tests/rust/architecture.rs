//! The shape of the crate: which file uses which. No circle of files, and in the diagnosis no arrow to a later stage.
//!
//! Read from the sources: `use` lines and paths that start with `crate` or `super`, comments aside. A name that a `mod.rs` hands
//! on (`pub use`) counts as the file that it comes from.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The stages of the diagnosis: each uses itself and those before it.
const STAGES: [&str; 11] = [
    "principles",
    "data",
    "model",
    "effects",
    "likelihood",
    "prepare",
    "criteria",
    "random_effects",
    "selection",
    "assessment",
    "report",
];

type Module = Vec<String>;

/// A file: the module that it is, and the paths that it uses, with whether it hands them on.
struct Source {
    hands_on: bool,
    paths: Vec<(bool, Vec<String>)>,
}

fn split(path: &str) -> Vec<String> {
    path.split("::").map(str::trim).filter(|s| !s.is_empty()).map(str::to_owned).collect()
}

/// `a::{b, c::{d}}` as `a::b`, `a::c::d`.
fn spread(tree: &str, before: &[String], out: &mut Vec<Vec<String>>) {
    let Some(open) = tree.find('{') else {
        let name = tree.split(" as ").next().unwrap_or_default();
        out.push(before.iter().cloned().chain(split(name)).collect());
        return;
    };
    let head: Vec<String> = before.iter().cloned().chain(split(&tree[..open])).collect();
    let inside = &tree[open + 1..tree.rfind('}').unwrap()];
    let (mut depth, mut from) = (0, 0);
    for (i, c) in inside.char_indices().chain([(inside.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if !inside[from..i].trim().is_empty() {
                    spread(inside[from..i].trim(), &head, out);
                }
                from = i + 1;
            }
            _ => {}
        }
    }
}

fn paths_of(text: &str) -> Vec<(bool, Vec<String>)> {
    let (mut out, mut rest, mut open) = (Vec::new(), String::new(), None::<(bool, String)>);
    for line in text.lines() {
        let line = line.split("//").next().unwrap_or_default().trim();
        let hands_on = line.starts_with("pub");
        let starts = ["use ", "pub use ", "pub(crate) use ", "pub(super) use "];
        match (&mut open, starts.iter().find_map(|s| line.strip_prefix(s))) {
            (Some((_, tree)), _) => tree.push_str(line),
            (None, Some(tree)) => open = Some((hands_on, tree.to_owned())),
            (None, None) => rest.push_str(&format!("{line}\n")),
        }
        if let Some((hands_on, tree)) = open.take_if(|(_, tree)| tree.ends_with(';')) {
            let mut paths = Vec::new();
            spread(tree.trim_end_matches(';'), &[], &mut paths);
            out.extend(paths.into_iter().map(|path| (hands_on, path)));
        }
    }
    for word in rest.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')) {
        if word.starts_with("crate::") || word.starts_with("super::") {
            out.push((false, split(word)));
        }
    }
    out
}

fn read(dir: &Path, at: &Module, out: &mut BTreeMap<Module, Source>) {
    let mut entries: Vec<_> = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            if stem != "tests" {
                read(&path, &[at.clone(), vec![stem]].concat(), out);
            }
        } else if stem != "tests" && path.extension().is_some_and(|e| e == "rs") {
            let hands_on = stem == "mod" || stem == "lib";
            let module = if hands_on { at.clone() } else { [at.clone(), vec![stem]].concat() };
            let paths = paths_of(&std::fs::read_to_string(&path).unwrap());
            out.insert(module, Source { hands_on, paths });
        }
    }
}

/// The file that a path in a module names; none where it names another crate.
fn file_of(
    files: &BTreeMap<Module, Source>,
    module: &Module,
    path: &[String],
    depth: usize,
) -> Option<Module> {
    let mut path = path;
    let mut at = match path.first()?.as_str() {
        "crate" => {
            path = &path[1..];
            Vec::new()
        }
        "self" => {
            path = &path[1..];
            module.clone()
        }
        "super" => {
            let mut at = module.clone();
            while path.first().is_some_and(|p| p == "super") {
                at.pop();
                path = &path[1..];
            }
            at
        }
        first if files.contains_key(&[module.clone(), vec![first.to_owned()]].concat()) => module.clone(),
        _ => return None,
    };
    while let Some(next) = path.first() {
        let below = [at.clone(), vec![next.clone()]].concat();
        if !files.contains_key(&below) {
            break;
        }
        at = below;
        path = &path[1..];
    }
    if let (Some(name), true) = (path.first(), depth < 8) {
        let handed = files[&at].paths.iter().find(|(on, p)| *on && p.last() == Some(name));
        if let Some(file) = handed.and_then(|(_, p)| file_of(files, &at, p, depth + 1)) {
            return Some(file);
        }
    }
    Some(at)
}

fn arrows() -> BTreeMap<Module, BTreeSet<Module>> {
    let mut files = BTreeMap::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &Vec::new(), &mut files);
    assert!(files.len() > 150, "only {} sources were found", files.len());
    let of = |(module, source): (&Module, &Source)| {
        let used = source
            .paths
            .iter()
            .filter(|(on, _)| !(*on && source.hands_on))
            .filter_map(|(_, path)| file_of(&files, module, path, 0))
            .filter(|target| target != module)
            .collect();
        (module.clone(), used)
    };
    files.iter().map(of).collect()
}

/// A way back to where it starts, if there is one.
fn circle(arrows: &BTreeMap<Module, BTreeSet<Module>>) -> Option<Vec<String>> {
    fn visit(
        at: &Module,
        arrows: &BTreeMap<Module, BTreeSet<Module>>,
        way: &mut Vec<Module>,
        done: &mut BTreeSet<Module>,
    ) -> Option<Vec<String>> {
        if let Some(i) = way.iter().position(|m| m == at) {
            return Some(way[i..].iter().chain([at]).map(|m| m.join("::")).collect());
        }
        if done.contains(at) {
            return None;
        }
        way.push(at.clone());
        for next in arrows.get(at).into_iter().flatten() {
            if let Some(found) = visit(next, arrows, way, done) {
                return Some(found);
            }
        }
        way.pop();
        done.insert(at.clone());
        None
    }
    let mut done = BTreeSet::new();
    arrows.keys().find_map(|start| visit(start, arrows, &mut Vec::new(), &mut done))
}

#[test]
fn no_circle_of_files() {
    assert_eq!(circle(&arrows()), None, "these files use each other in a circle");
}

#[test]
fn the_stages_of_the_diagnosis_use_only_earlier_ones() {
    let arrows = arrows();
    let stage = |m: &Module| {
        (m.first().is_some_and(|m| m == "diagnose")).then(|| {
            m.get(1).and_then(|s| STAGES.iter().position(|known| known == s)).unwrap_or(STAGES.len())
        })
    };
    let upward: Vec<_> = arrows
        .iter()
        .flat_map(|(from, to)| to.iter().map(move |to| (from, to)))
        .filter(|(from, to)| matches!((stage(from), stage(to)), (Some(a), Some(b)) if b > a))
        .map(|(from, to)| format!("{} uses {}", from.join("::"), to.join("::")))
        .collect();
    assert!(upward.is_empty(), "arrows to a later stage: {upward:#?}");
    let between =
        arrows.iter().filter(|(m, to)| stage(m).is_some() && to.iter().any(|t| stage(t) != stage(m)));
    assert!(between.count() > 40, "hardly any arrow was read: the reader of the sources is broken");
}

#[test]
fn the_reader_sees_circles_and_every_form_of_a_path() {
    let text = "use super::b::{C, d::{E, f as g}};\npub use self::h::I;\nfn x() { crate::j::K::new(); } // crate::comment::L\n";
    let paths: Vec<String> =
        paths_of(text).into_iter().map(|(on, p)| format!("{on} {}", p.join("::"))).collect();
    assert_eq!(
        paths,
        [
            "false super::b::C",
            "false super::b::d::E",
            "false super::b::d::f",
            "true self::h::I",
            "false crate::j::K::new"
        ]
    );
    let module = |name: &str| vec![name.to_owned()];
    let mut arrows = BTreeMap::from([
        (module("a"), BTreeSet::from([module("b")])),
        (module("b"), BTreeSet::from([module("c")])),
        (module("c"), BTreeSet::new()),
    ]);
    assert_eq!(circle(&arrows), None);
    arrows.insert(module("c"), BTreeSet::from([module("a")]));
    assert_eq!(circle(&arrows).unwrap(), ["a", "b", "c", "a"]);
}

/// Numbers on which a decision of the diagnosis turns, at most; those that follow from others are not counted.
const MOST_THRESHOLDS: usize = 35;

fn rust_files(folder: &Path, out: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Name, type and value of a constant that a line declares at a file's top level.
fn constant(line: &str) -> Option<(&str, &str, &str)> {
    let rest = match line.strip_prefix("pub") {
        Some(rest) => rest.split_once("const ").filter(|(a, _)| !a.contains(['=', '{']))?.1,
        None => line.strip_prefix("const ")?,
    };
    let (name, rest) = rest.split_once(": ")?;
    let (kind, value) = rest.split_once(" =")?;
    Some((name, kind, value.trim()))
}

#[test]
fn constants_of_the_diagnosis_say_what_kind_they_are_and_few_are_thresholds() {
    let diagnose = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/diagnose");
    let mut files = Vec::new();
    rust_files(&diagnose, &mut files);
    let (mut bare, mut thresholds) = (Vec::new(), Vec::new());
    for file in files {
        let here = file.strip_prefix(&diagnose).unwrap().to_string_lossy().replace('\\', "/");
        // Files of one kind: tests, solvers' options, limits of work.
        if here.starts_with("tests") || ["model/solver.rs", "model/work_budget.rs"].contains(&&*here) {
            continue;
        }
        let text = std::fs::read_to_string(&file).unwrap();
        for (name, kind, value) in text.lines().filter_map(constant) {
            match kind {
                "f64" | "usize" | "u64" => bare.push(format!("{here}: {name}")),
                "Threshold" | "Count" if value.trim_end_matches(';').parse::<f64>().is_ok() => {
                    thresholds.push(format!("{here}: {name}"));
                }
                _ => {}
            }
        }
    }
    assert!(bare.is_empty(), "give them a kind of `principles.rs`: {bare:#?}");
    assert!((20..=MOST_THRESHOLDS).contains(&thresholds.len()), "{}: {thresholds:#?}", thresholds.len());
}
