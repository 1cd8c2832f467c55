//! Exports to every format on a disk without room, and of killed commands: what is there stays, and nothing is left under an output's name.

use brickyard_tests::Sandbox;
use std::path::{Path, PathBuf};

/// A name of each format.
const NAMES: [&str; 13] = [
    "level.raw",
    "level.npy",
    "level.nii",
    "level.nii.gz",
    "level.nrrd",
    "level.mha",
    "level.mhd",
    "level.vti",
    "level.pvd",
    "level.tif",
    "level.ome.tif",
    "level/",
    "level.ome.zarr",
];

fn names(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut names: Vec<PathBuf> = entries.collect();
    names.sort();
    names
}

fn remove(path: &Path) {
    let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    removed.expect("it is there");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_no_export_and_is_told() {
    let trial = brickyard_tests::faults::Trial::default();
    let sandbox = &trial.sandbox;
    sandbox.write("in.raw", (0..36 * 33 * 20u32).flat_map(|value| (value as u16).to_le_bytes()).collect::<Vec<u8>>());
    let pack = "pack in.raw out.zarr --shape 36,33,20 --dtype u16 --brick 8 --shard 32 --spacing 1,1,2 --progress none";
    assert_eq!(trial.run(pack, "").code, Some(0));
    let before = names(&sandbox.path(""));
    for name in NAMES {
        let line = format!("export out.zarr {name} --progress none");
        for rule in
            ["write 1+ ENOSPC .brickyard-export", "rename 1 EIO .brickyard-export", "open 1 EACCES .brickyard-export"]
        {
            let outcome = trial.run(&line, rule);
            let is_told = outcome.stderr.contains("level") && !outcome.stderr.contains("panicked");
            let is_met = outcome.code == Some(1) && !outcome.hung && is_told;
            // A folder of pictures is made and named by other calls; the first one opened is but locked, or looked at.
            let is_other = name == "level/" && !rule.starts_with("write")
                || [".zarr", ".pvd"].iter().any(|end| name.ends_with(end)) && rule.starts_with("open");
            assert!(is_met || is_other && outcome.code == Some(0), "{name}, {rule}: {}", outcome.stderr);
            let left: Vec<PathBuf> =
                names(&sandbox.path("")).into_iter().filter(|path| !before.contains(path)).collect();
            assert!(left.is_empty() || outcome.code == Some(0), "{name}, {rule}: {left:?}");
            left.iter().for_each(|path| remove(path));
        }
        let outcome = trial.run(&line, "");
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        names(&sandbox.path("")).iter().filter(|path| !before.contains(path)).for_each(|path| remove(path));
    }
}

/// A killed command leaves only a temporary file or folder, which the next one of the name takes away.
#[test]
fn a_killed_export_leaves_no_output() {
    let sandbox = Sandbox::in_memory();
    sandbox.run_ok("synth turbulence in.raw --shape 192,192,192 --dtype u16 --progress none");
    sandbox.run_ok("pack in.raw in.zarr --shape 192,192,192 --dtype u16 --brick 16 --shard 64 --progress none");
    for name in NAMES {
        let before = names(&sandbox.path(""));
        let mut command = sandbox.command();
        command.args(["export", "in.zarr", name, "--progress", "none", "-q"]);
        let mut child = command.spawn().expect("the command starts");
        let temporary = |path: &PathBuf| path.to_string_lossy().contains(".brickyard-export") && !before.contains(path);
        let begins = || names(&sandbox.path("")).iter().any(temporary);
        while !begins() && child.try_wait().expect("a child").is_none() {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        child.kill().expect("it is ours");
        // It may have ended before.
        let is_killed = !child.wait().expect("it is ours").success();
        let output = sandbox.path(name.trim_end_matches('/'));
        assert!(!is_killed || !output.exists(), "{name}");
        if is_killed {
            sandbox.run_ok(&format!("export in.zarr {name} --progress none"));
            let left: Vec<PathBuf> = names(&sandbox.path("")).into_iter().filter(temporary).collect();
            assert!(left.is_empty(), "{name}: {left:?}");
        }
        names(&sandbox.path("")).iter().filter(|path| !before.contains(path)).for_each(|path| remove(path));
    }
}
