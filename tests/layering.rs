//! Dependencies between crates in one direction only: source, store, pager, renderers, facade, window, command.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Each crate's permitted dependencies; "" is the facade. The facade, the tests and the benchmarks may depend on all.
const ALLOWED: [(&str, &[&str]); 15] = [
    ("volume", &[]),
    ("filemap", &[]),
    ("objects", &[]),
    ("import", &["volume", "filemap", "objects"]),
    ("store", &["volume", "filemap", "objects", "import"]),
    ("export", &["volume", "import", "store"]),
    ("extract", &["volume", "import", "store"]),
    ("pager", &["volume", "store"]),
    ("shaders", &["volume"]),
    ("render", &["volume", "pager", "shaders"]),
    ("software", &["volume", "pager"]),
    ("reference", &["volume"]),
    ("measure", &[""]),
    ("viewer", &[""]),
    ("cli", &["", "measure", "viewer"]),
];

/// Packages, and their permitted direct dependents.
const ONLY: [(&str, &[&str]); 6] = [
    ("tokio", &["objects"]),
    ("object_store", &["objects"]),
    ("wgpu", &["render"]),
    ("zstd", &["store", "import"]),
    ("clap", &["cli"]),
    ("eframe", &["viewer"]),
];

fn direct_dependencies() -> BTreeMap<String, Vec<String>> {
    let cargo = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .expect("cargo runs");
    let metadata: serde_json::Value = serde_json::from_slice(&cargo.stdout).expect("cargo metadata is JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let normal = |p: &serde_json::Value| {
        let dependencies = p["dependencies"].as_array().expect("dependencies");
        let named = dependencies.iter().filter(|d| d["kind"].is_null());
        named.filter_map(|d| Some(d["name"].as_str()?.to_string())).collect()
    };
    packages.iter().map(|p| (p["name"].as_str().expect("name").to_string(), normal(p))).collect()
}

#[test]
fn arrows_point_one_way() {
    let all = direct_dependencies();
    for (name, allowed) in ALLOWED {
        let found = &all[&format!("brickyard-{name}")];
        for dependency in found.iter().filter_map(|d| d.strip_prefix("brickyard")) {
            let dependency = dependency.trim_start_matches('-');
            assert!(allowed.contains(&dependency), "crate {name} must not know crate {dependency:?}");
        }
    }
    for (package, owners) in ONLY {
        for (name, found) in &all {
            let own = owners.contains(&name.trim_start_matches("brickyard-")) || name == "brickyard-benches";
            assert!(own || !found.iter().any(|d| d == package), "only {owners:?} may use {package}, not {name}");
        }
    }
}

/// The README counts the third-party crates in a build: those listed by `cargo tree` on Linux, including build scripts' and macros'.
#[test]
fn crates_of_others_are_counted() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let count = |flags: &str| {
        let tree =
            "tree --offline --locked --prefix none --edges normal,build --target x86_64-unknown-linux-gnu --format {p}";
        let cargo =
            Command::new(env!("CARGO")).args(tree.split(' ').chain(flags.split(' '))).current_dir(root).output();
        let cargo = cargo.expect("cargo runs");
        let listed = String::from_utf8(cargo.stdout).expect("text");
        let names = listed.lines().map(|line| line.trim_end_matches(" (*)"));
        let others: BTreeSet<&str> = names.filter(|name| !name.is_empty() && !name.starts_with("brickyard")).collect();
        assert!(others.len() > 10, "{}", String::from_utf8_lossy(&cargo.stderr));
        others.len()
    };
    let [cpu, gpu, command] = [
        "--package brickyard --no-default-features",
        "--package brickyard --no-default-features --features gpu",
        "--package brickyard-cli",
    ]
    .map(count);
    let said = format!("builds {cpu} third-party crates, with the feature `gpu` {gpu}; the command builds {command}");
    let readme = std::fs::read_to_string(format!("{root}/README.md")).expect("it is there");
    assert!(readme.contains(&said), "the README should say: {said}");
}

/// The crates' messages, including the facade's, name no flags of the command, because other programs embed them. The command puts flags in place
/// of named options, and adds the helpful one.
#[test]
fn the_library_knows_of_no_command_line() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut folders: Vec<_> = [
        "volume",
        "filemap",
        "import",
        "store",
        "export",
        "extract",
        "pager",
        "render",
        "software",
        "reference",
        "brickyard",
    ]
    .map(|name| root.join("crates").join(name).join("src"))
    .into();
    let mut seen = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("source");
            // Other programs have flags too: the test harness, and a DICOM converter.
            let is_ours = |line: &&str| !line.trim_start().starts_with("//") && !line.contains("\"--exact\"");
            let code = text.lines().filter(is_ours).filter(|line| !line.contains("gdcmconv --raw"));
            let is_flag =
                |word: &str| word.strip_prefix("--").is_some_and(|name| name.starts_with(char::is_alphabetic));
            for line in code {
                let words = line.split(|c: char| c.is_whitespace() || "\"'`(".contains(c));
                assert!(!words.into_iter().any(is_flag), "{}: {line}", path.display());
            }
            seen += 1;
        }
    }
    assert!(seen > 150, "{seen} files");
}

/// A file by its module path in the crate.
type Module = Vec<String>;

/// The files of a crate, each with the other files it names, except its own folder and the files inside its own module. Tests are left out.
fn modules(source: &Path) -> BTreeMap<Module, BTreeSet<Module>> {
    let (mut texts, mut folders) = (BTreeMap::<Module, String>::new(), vec![source.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder of the crate") {
            let path = entry.expect("an entry").path();
            let inside = path.strip_prefix(source).expect("inside").with_extension("");
            let module: Module = inside.iter().map(|name| name.to_string_lossy().into_owned()).collect();
            if module.iter().any(|name| name.ends_with("tests")) || ["lib", "main"].contains(&&*module[0]) {
                continue;
            }
            match path.is_dir() {
                true => folders.push(path),
                false => drop(texts.insert(module, std::fs::read_to_string(&path).expect("text"))),
            }
        }
    }
    let named = |module: &Module, text: &str| -> BTreeSet<Module> {
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        let code = code.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n");
        let starts = [("crate::", &[][..]), ("super::", &module[..module.len() - 1])];
        let found = starts.into_iter().flat_map(|(word, start)| {
            let named = code.split(word).skip(1).flat_map(paths);
            named.map(|path| [start, &path].concat()).collect::<Vec<_>>()
        });
        let file = |mut path: Module| {
            while !path.is_empty() && !texts.contains_key(&path) {
                path.pop();
            }
            path
        };
        let is_other = |file: &Module| !file.is_empty() && !module.starts_with(file) && !file.starts_with(module);
        found.map(file).filter(is_other).collect()
    };
    texts.iter().map(|(module, text)| (module.clone(), named(module, text))).collect()
}

/// The paths at the start of a text: one, or those of a group such as `a::{b, c::d}`.
fn paths(text: &str) -> Vec<Module> {
    let (name, rest) = text.split_at(text.find(|c: char| c != '_' && !c.is_alphanumeric()).unwrap_or(text.len()));
    match (name.is_empty(), text.strip_prefix('{'), rest.strip_prefix("::")) {
        (true, Some(group), _) => members(group).into_iter().flat_map(|member| paths(member.trim_start())).collect(),
        (true, None, _) => vec![Module::new()],
        (false, _, None) => vec![vec![name.to_owned()]],
        (false, _, Some(rest)) => paths(rest).into_iter().map(|path| [vec![name.to_owned()], path].concat()).collect(),
    }
}

/// The members of a group, up to its closing brace.
fn members(group: &str) -> Vec<&str> {
    let (mut members, mut start, mut depth) = (Vec::new(), 0, 0);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            '}' | ',' if depth == 0 => {
                members.push(&group[start..at]);
                start = at + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    members
}

/// Removes modules without references to others until none is left: the rest form circles, or lead to one.
fn in_circles(mut modules: BTreeMap<Module, BTreeSet<Module>>) -> Vec<String> {
    loop {
        let names: BTreeSet<Module> = modules.keys().cloned().collect();
        modules.retain(|_, named| named.iter().any(|other| names.contains(other)));
        if modules.len() == names.len() {
            return names.iter().map(|name| name.join("::")).collect();
        }
    }
}

#[test]
fn no_files_name_each_other_in_circles() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let crates = std::fs::read_dir(root.join("crates")).expect("the crates");
    let crates: Vec<PathBuf> = crates.map(|entry| entry.expect("an entry").path().join("src")).collect();
    assert!(crates.len() > 10);
    for source in crates {
        let found = modules(&source);
        assert!(!found.is_empty(), "{}", source.display());
        assert_eq!(in_circles(found), Vec::<String>::new(), "{}", source.display());
    }
    assert_eq!(
        paths("{a, b::{c, d::E}} and {f}").iter().map(|path| path.join("::")).collect::<Vec<_>>(),
        ["a", "b::c", "b::d::E"]
    );
    let pair = |a: &str, b: &str| (vec![a.to_owned()], BTreeSet::from([vec![b.to_owned()]]));
    let found = in_circles(BTreeMap::from([pair("a", "b"), pair("b", "a"), pair("c", "d"), pair("d", "e")]));
    assert_eq!(found, ["a", "b"]);
}

/// Tests that take turns, by a list for `tools/test`: a name that has changed would run each time, and one that is listed twice never.
#[test]
fn tests_that_take_turns_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let list = std::fs::read_to_string(root.join("in-turns")).expect("it is there");
    let names: Vec<&str> = list.lines().filter(|line| !line.starts_with('#')).collect();
    assert!(names.len() > 20 && names.iter().collect::<BTreeSet<_>>().len() == names.len());
    for name in names {
        let (modules, function) = name.rsplit_once("::").expect("a module");
        let file = |folder: &str| root.join(folder).join(modules.replace("::", "/")).with_extension("rs");
        let texts = ["", "conformance"].map(|folder| std::fs::read_to_string(file(folder)).unwrap_or_default());
        assert!(texts.iter().any(|text| text.contains(&format!("fn {function}()"))), "{name}");
    }
}
