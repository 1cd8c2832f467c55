//! Agreement of the words page and the code: the given names exist, and retired words are gone.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// All Rust and WGSL of the crates, shaders and whole-system tests.
fn sources() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut folders: Vec<PathBuf> = ["crates", "shaders", "tests", "benches"].map(|name| root.join(name)).into();
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.extend((!path.ends_with("target")).then_some(path));
            } else if path.extension().is_some_and(|kind| kind == "rs" || kind == "wgsl") {
                let text = std::fs::read_to_string(&path).expect("source");
                sources.push((path, text));
            }
        }
    }
    sources
}

/// The words of a text: letters and digits, with underscores.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// The rows of the page's tables, by cells.
fn rows(page: &str) -> impl Iterator<Item = Vec<&str>> {
    let rows = page.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| word |"));
    let rows = rows.filter(|line| !line.starts_with("| ---"));
    rows.map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
}

#[test]
fn the_words_page_and_the_code_agree() {
    let page = include_str!("../docs/words.md");
    let sources = sources();
    assert!(sources.len() > 300, "{} files", sources.len());
    let used: BTreeSet<&str> = sources.iter().flat_map(|(_, text)| words(text)).collect();
    let mut problems = Vec::new();
    let mut count = 0;
    for row in rows(page) {
        let [word, meaning, name, retired] = row[..] else { panic!("not four cells: {row:?}") };
        count += 1;
        let name = name.trim_matches('`');
        if meaning.is_empty() || !used.contains(name) {
            problems.push(format!("{word}: nothing in the code is called {name:?}"));
        }
        for given_up in retired.split(", ").filter(|given_up| !given_up.is_empty()) {
            let is_said = |(path, text): &&(PathBuf, String)| {
                let is_here = path.ends_with("tests/words.rs");
                !is_here && text.lines().any(|line| says(line, given_up))
            };
            let told: Vec<_> = sources.iter().filter(is_said).map(|(path, _)| path.display()).collect();
            if !told.is_empty() {
                problems.push(format!("{given_up:?} is said instead of {word:?} in {told:?}"));
            }
        }
    }
    assert!(count > 30, "{count} rows");
    assert!(problems.is_empty(), "{problems:#?}");
}

/// Whether a line has a word, or several in a row; a part of a longer name is a word too, as `leap` in `no_leap`.
fn says(line: &str, given_up: &str) -> bool {
    let lower = line.to_lowercase();
    let said: Vec<&str> = lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let given_up: Vec<&str> = given_up.split(' ').collect();
    said.windows(given_up.len()).any(|window| window == given_up)
}
