//! The table of formulas in the crate's README names files that are there and hold what it says.

use std::path::Path;

#[test]
fn every_formula_stands_where_the_readme_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let mut named = 0;
    for line in readme.lines().filter(|line| line.starts_with('|')) {
        let quoted: Vec<&str> = line.split('`').skip(1).step_by(2).collect();
        let files = quoted.iter().enumerate().filter(|(_, word)| word.ends_with(".rs"));
        for (i, file) in files {
            let text = std::fs::read_to_string(root.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
            let what = quoted[i + 1];
            assert!(text.contains(what), "{file} has no {what}");
            named += 1;
        }
    }
    assert!(named >= 9, "{named} formulas");
}
