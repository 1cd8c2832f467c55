//! Agreement of the words page and the code: the given names exist, and retired words are gone. Sentences are counted: clauses with *that* and
//! *what* mark stilted English.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// All Rust and WGSL of the crates, shaders and whole-system tests.
fn sources() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace");
    let mut folders: Vec<PathBuf> = ["crates", "shaders", "tests", "benches"].map(|name| root.join(name)).into();
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.extend((!path.ends_with("target")).then_some(path));
            } else if path.extension().is_some_and(|kind| kind == "rs" || kind == "wgsl") {
                let text = std::fs::read_to_string(&path).expect("source");
                sources.push((path.strip_prefix(root).expect("within").to_owned(), text));
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

/// *that* and *what* allowed per 1,000 words. Well-written crates have 5 and 0.1.
const MOST_THAT: f64 = 9.0;
const MOST_WHAT: f64 = 1.5;

/// Words of a text outside of code marks, and how many of them are *that* and *what*.
fn count(text: &str) -> [usize; 3] {
    let prose: String = text.split('`').step_by(2).collect();
    let mut counts = [0; 3];
    for word in words(&prose) {
        counts[0] += 1;
        counts[1] += usize::from(word.eq_ignore_ascii_case("that"));
        counts[2] += usize::from(word.eq_ignore_ascii_case("what"));
    }
    counts
}

/// A remark on a text with these counts; `None` if its counts are within the limits.
fn stilted(name: &str, [all, that, what]: [usize; 3]) -> Option<String> {
    let per_1000 = |count: usize| 1e3 * count as f64 / all.max(1) as f64;
    let (that, what) = (per_1000(that), per_1000(what));
    (that > MOST_THAT || what > MOST_WHAT).then(|| format!("{name}: {that:.1} that, {what:.1} what per 1,000 words"))
}

/// Blocks of doc comments, without their code.
fn doc_blocks(text: &str) -> Vec<String> {
    let (mut blocks, mut is_code, mut is_open) = (Vec::<String>::new(), false, false);
    for line in text.lines().map(str::trim_start) {
        let doc = line.strip_prefix("///").or(line.strip_prefix("//!")).map(str::trim_start);
        let Some(doc) = doc else {
            (is_code, is_open) = (false, false);
            continue;
        };
        is_code ^= doc.starts_with("```");
        if !is_code && !doc.starts_with("```") {
            match blocks.last_mut().filter(|_| is_open) {
                Some(block) => block.extend([" ", doc]),
                None => blocks.push(doc.to_owned()),
            }
            is_open = true;
        }
    }
    blocks
}

#[test]
fn doc_comments_open_with_a_noun_and_say_little_of_that_and_what() {
    let (mut problems, mut by_crate) = (Vec::new(), BTreeMap::<PathBuf, [usize; 3]>::new());
    for (path, text) in sources() {
        let name: PathBuf = path.iter().take(if path.starts_with("crates") { 2 } else { 1 }).collect();
        for block in doc_blocks(&text) {
            let opens = block.split(' ').next().unwrap_or_default();
            if ["What", "That"].contains(&opens) {
                problems.push(format!("{}: {block}", path.display()));
            }
            let counts = by_crate.entry(name.clone()).or_default();
            count(&block).iter().zip(counts).for_each(|(new, sum)| *sum += new);
        }
    }
    assert!(by_crate.len() > 10, "{by_crate:?}");
    problems.extend(by_crate.iter().filter_map(|(name, counts)| stilted(&name.to_string_lossy(), *counts)));
    assert!(problems.is_empty(), "{problems:#?}");
}

/// The pages in a folder and below.
fn pages_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("pages").map(|entry| entry.expect("an entry").path());
    let each = entries.map(|path| match path.is_dir() {
        true => pages_in(&path),
        false => (path.extension().is_some_and(|kind| kind == "md")).then_some(path).into_iter().collect(),
    });
    each.flatten().collect()
}

/// Sentences of a page that open with *What* or *That of*. Questions are none.
fn openings(prose: &str) -> Vec<&str> {
    let sentences = prose.split_inclusive(". ").flat_map(|part| part.split("\n\n")).flat_map(|part| part.split("\n- "));
    let open =
        sentences.map(str::trim).filter(|sentence| ["What ", "That of "].iter().any(|word| sentence.starts_with(word)));
    open.collect()
}

#[test]
fn the_pages_say_little_of_that_and_what() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut problems = Vec::new();
    let mut pages = pages_in(&root.join("docs"));
    assert!(pages.len() > 40, "{pages:?}");
    pages.push(root.join("README.md"));
    for path in pages {
        let text = std::fs::read_to_string(&path).expect("text");
        let prose: String = text.split("```").step_by(2).collect();
        let name = path.strip_prefix(&root).expect("within").to_string_lossy().into_owned();
        problems.extend(stilted(&name, count(&prose)));
        problems.extend(openings(&prose).iter().map(|sentence| format!("{name}: {sentence}")));
    }
    assert!(problems.is_empty(), "{problems:#?}");
}
