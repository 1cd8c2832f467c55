//! Appended time steps under concurrent readers: kills at any moment, a following reader, two appends at once, unsuitable input, and zarr-python.

use brickyard::store::{OpenError, Store};
use brickyard::volume::Level;
use brickyard_tests::{Random, Sandbox, tree, tree_difference};
use std::path::Path;
use std::process::Stdio;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const EXTENT: [usize; 3] = [24, 20, 18];
const STEPS: u32 = 12;

/// Small steps of many files: two pyramids, with aprons.
const FLAGS: &str = "--shape 24,20,18 --dtype u8 --brick 8 --shard 16 --downsample mean,max --aprons 1 -j 2 --time-step 0.5 \
                     --time-unit s --progress none";

/// The voxels of a step; each step is empty in other parts.
fn step(number: u32) -> Vec<u8> {
    let [nx, ny, nz] = EXTENT;
    let voxel = |x: usize, y: usize, z: usize| {
        let is_empty = (x / 8 + y / 8 + z / 8 + number as usize).is_multiple_of(3);
        if is_empty { 0 } else { (x * 7 + y * 3 + z * 11 + number as usize * 17) as u8 }
    };
    (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| voxel(x, y, z)))).collect()
}

/// A sandbox with the files of all steps, `s0.raw` and so on.
fn with_steps() -> Sandbox {
    let sandbox = Sandbox::in_memory();
    (0..STEPS).for_each(|number| sandbox.write(format!("s{number}.raw"), step(number)));
    sandbox
}

/// The command line to append these steps to a store.
fn append(store: &str, steps: std::ops::Range<u32>) -> String {
    let files: String = steps.map(|number| format!("s{number}.raw ")).collect();
    format!("append {store} {files}{FLAGS}")
}

/// Checks that a store has whole steps only, and returns their number; 0 without a store.
fn whole_steps(path: &Path) -> u32 {
    let store = match Store::open(path) {
        Ok(store) => store,
        Err(OpenError::NotAStore { .. } | OpenError::Incomplete { .. }) => return 0,
        Err(OpenError::Io { .. }) if !path.exists() => return 0,
        Err(error) => panic!("{error}"),
    };
    assert_whole(&store);
    store.times()
}

fn assert_whole(store: &Store) {
    for time in 0..store.times() {
        let mut found = vec![1; EXTENT.iter().product()];
        let whole = store.pyramid().level(Level(0)).extent.full_box();
        store.read_box(time, 0, Level(0), whole, &mut found).unwrap_or_else(|error| panic!("step {time}: {error}"));
        assert!(found == step(time), "step {time} of {}", store.times());
        let coarsest = store.pyramid().coarsest();
        let region = store.pyramid().level(coarsest).extent.full_box();
        let mut found = vec![0; region.extent().volume() as usize];
        store.read_box(time, 0, coarsest, region, &mut found).unwrap_or_else(|error| panic!("step {time}: {error}"));
    }
}

/// Follows a store like a viewer, until `is_done`; returns the number of times it grew. `reading` is held during reads.
fn follow(path: &Path, is_done: &AtomicBool, reading: &Mutex<()>) -> u32 {
    let (mut open, mut grown): (Option<Store>, u32) = (None, 0);
    while !is_done.load(Ordering::Relaxed) {
        let held = reading.lock().expect("no panic");
        open = match open.take() {
            None => Store::open(path).ok(),
            // The store is gone, and begun anew.
            Some(_) if !path.join("zarr.json").exists() => None,
            Some(store) => match store.newer() {
                Ok(Some(newer)) => {
                    assert!(newer.times() > store.times());
                    assert_whole(&newer);
                    grown += 1;
                    Some(newer)
                }
                Ok(None) => Some(store),
                Err(OpenError::Replaced { .. }) => None,
                Err(error) => {
                    assert!(!path.join("zarr.json").exists(), "{error}");
                    None
                }
            },
        };
        drop(held);
        std::thread::sleep(Duration::from_millis(1));
    }
    grown
}

#[test]
fn killed_at_any_moment_every_step_is_whole_and_the_next_append_goes_on() {
    let sandbox = with_steps();
    sandbox.run_ok(&append("whole.zarr", 0..STEPS));
    let expected = tree(&sandbox.path("whole.zarr"));
    let path = sandbox.path("out.zarr");
    let (is_done, reading) = (AtomicBool::new(false), Mutex::new(()));
    let mut random = Random(3);
    let (mut within, mut rounds, mut furthest) = (0, 0, 0);
    let grown = std::thread::scope(|scope| {
        let reader = scope.spawn(|| follow(&path, &is_done, &reading));
        let mut times = 0;
        for kill in 0..50 {
            let mut child = sandbox
                .command()
                .args(append("out.zarr", times..STEPS).split(' '))
                .stderr(Stdio::null())
                .spawn()
                .expect("the command starts");
            // A few steps on, or fewer: by steps on disk, because a clock would vary with the machine's load.
            let until = times + (random.bits() % 6) as u32;
            let is_there = |step: u32| path.join(format!("0/c/{step}")).exists();
            while !is_there(until) && child.try_wait().expect("a child").is_none() {
                std::thread::sleep(Duration::from_micros(100));
            }
            std::thread::sleep(Duration::from_micros(random.bits() % 2000));
            child.kill().expect("a child");
            let was_killed = !child.wait().expect("a child").success();
            let now = whole_steps(&path);
            assert!(now >= times, "kill {kill}: {now} steps after {times}");
            if now > 0 && kill % 5 == 0 {
                sandbox.run_ok("verify out.zarr --progress none");
            }
            within += u32::from(was_killed && path.join(".brickyard-lock").exists());
            (times, furthest) = (now, furthest.max(now));
            if times == STEPS || kill == 49 {
                if times < STEPS {
                    sandbox.run_ok(&append("out.zarr", times..STEPS));
                } else {
                    // The next append removes the leftovers of a killed one, and is refused: the file has another shape.
                    sandbox.write("other.raw", [1; 8]);
                    let (code, _, stderr) =
                        sandbox.run("append out.zarr other.raw --shape 2,2,2 --dtype u8 --progress none");
                    assert_eq!(code, 3, "{stderr}");
                }
                assert_eq!(tree_difference(&tree(&path), &expected), [""; 0], "after kill {kill}");
                // Not while its files are read.
                let _held = reading.lock().expect("a reader that sees whole steps");
                std::fs::remove_dir_all(&path).expect("the sandbox is writable");
                (times, rounds) = (0, rounds + 1);
            }
        }
        is_done.store(true, Ordering::Relaxed);
        reader.join().expect("a reader that sees whole steps")
    });
    // If all kills come too early, nothing was tested.
    assert!(within >= 15 && rounds >= 1 && furthest == STEPS || rounds > 1, "{within} of 50 at work, {rounds} rounds");
    assert!(grown > 0, "the reader has seen no step come");
}

#[test]
fn two_at_once_exclude_each_other() {
    let sandbox = with_steps();
    sandbox.run_ok(&append("out.zarr", 0..1));
    let files: String = (0..400).map(|i| format!("s{}.raw ", i % STEPS)).collect();
    let mut child = sandbox
        .command()
        .args(format!("append out.zarr {files}{FLAGS} --order given").split(' '))
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts");
    let started = Instant::now();
    while !sandbox.path("out.zarr/.brickyard-lock").exists() {
        assert!(started.elapsed() < Duration::from_secs(60), "it does not begin");
        std::thread::sleep(Duration::from_millis(1));
    }
    let process = format!("process {}", child.id());
    let pack = format!("pack s1.raw out.zarr --overwrite {FLAGS}");
    for line in [append("out.zarr", 1..2), pack] {
        let (code, _, stderr) = sandbox.run(&line);
        assert!(
            code == 1 && stderr.contains("another process packs into it") && stderr.contains(&process),
            "{line}: {stderr}"
        );
    }
    assert!(child.try_wait().expect("a child").is_none(), "it was done before the others came");
    child.kill().expect("a child");
    child.wait().expect("a child");
    let times = Store::open(sandbox.path("out.zarr")).expect("a store").times();
    sandbox.run_ok(&append("out.zarr", 1..2));
    assert_eq!(Store::open(sandbox.path("out.zarr")).expect("a store").times(), times + 1);
    sandbox.run_ok("verify out.zarr --progress none");
}

#[test]
fn what_does_not_fit_is_refused_with_both_values_and_changes_nothing() {
    let sandbox = with_steps();
    sandbox.run_ok(&format!("{} --spacing 1,1,2 --time 1.5,2", append("out.zarr", 0..2)));
    sandbox.run_ok("pack s0.raw still.zarr --shape 24,20,18 --dtype u8 --progress none");
    sandbox.run_ok("append moved.zarr s0.raw --shape 24,20,18 --dtype u8 --origin 4,0,0 --progress none");
    std::fs::create_dir_all(sandbox.path("other.zarr")).expect("the sandbox is writable");
    sandbox.write("other.zarr/zarr.json", r#"{"zarr_format":3,"node_type":"group","attributes":{"ome":{}}}"#);
    std::fs::create_dir_all(sandbox.path("folder")).expect("the sandbox is writable");
    sandbox.write("folder/notes.txt", "mine");
    let before = tree(&sandbox.path(""));
    let raw = "--shape 24,20,18 --dtype u8 --progress none";
    for (line, code, words) in [
        (
            "append out.zarr s2.raw --shape 24,18,20 --dtype u8",
            3,
            &["s2.raw", "step 2", "24,18,20", "out.zarr", "24,20,18"][..],
        ),
        ("append out.zarr s2.raw --shape 12,20,18 --dtype u16", 3, &["s2.raw", "shape"]),
        ("append out.zarr s2.raw --shape 24,20,18 --dtype i8", 3, &["s2.raw", "i8", "steps 0 to 1", "u8"]),
        (
            &format!("append out.zarr s2.raw {raw} --spacing 1,1,3"),
            3,
            &["spacing", "[1.0, 1.0, 3.0]", "[1.0, 1.0, 2.0]"],
        ),
        (
            &format!("append moved.zarr s2.raw {raw} --origin 0,0,0"),
            3,
            &["origin", "[0.0, 0.0, 0.0]", "[4.0, 0.0, 0.0]"],
        ),
        (&format!("append out.zarr s2.raw {raw} --time 2"), 2, &["s2.raw", "after 2 of step 1", "found 2"]),
        (&format!("append out.zarr s2.raw s3.raw {raw} --time 9"), 2, &["--time", "1 time for 2 files"]),
        (&format!("append out.zarr s2.raw s3.raw s4.raw {raw} --time 9,11,10"), 2, &["10 of s4.raw", "11 of s3.raw"]),
        (&format!("append new.zarr s3.raw s2.raw s4.raw {raw} --time 3,5,4"), 2, &["4 of s4.raw", "5 of s2.raw"]),
        (&format!("append out.zarr s2.raw s3.raw {raw} --time 9,inf"), 2, &["--time inf"]),
        (&format!("append out.zarr/new.zarr s2.raw {raw}"), 3, &["is no part of out.zarr"]),
        (&format!("pack s2.raw out.zarr/0/new.zarr {raw}"), 2, &["inside the store"]),
        ("export out.zarr out.zarr/a.npy", 2, &["inside the store"]),
        ("render out.zarr -o out.zarr/0/a.png", 2, &["inside the store"]),
        (&format!("append out.zarr s2.raw {raw} --time-stamps t.txt"), 2, &["--time-stamps", "--time TIME"]),
        (&format!("append out.zarr s2.raw {raw} --time 9 --time-step 2"), 2, &["--time-step", "--time"]),
        (&format!("append out.zarr s2.raw {raw} --time-unit ms"), 2, &["second", "millisecond"]),
        (&format!("append out.zarr s2.raw {raw} --brick 16"), 2, &["--brick 16", "out.zarr", "8"]),
        (&format!("append out.zarr s2.raw {raw} --downsample max"), 2, &["--downsample max", "mean,max"]),
        (&format!("append out.zarr nothing.raw {raw}"), 3, &["nothing.raw"]),
        (&format!("append out.zarr s2.raw {raw} --memory 1MiB"), 2, &["--memory"]),
        (&format!("append still.zarr s2.raw {raw}"), 3, &["still.zarr", "no time axis", "--time-step"]),
        (
            &format!("append other.zarr s2.raw {raw}"),
            3,
            &["a Zarr without brickyard's side data is not supported", "brickyard pack"],
        ),
        (&format!("append folder s2.raw {raw}"), 2, &["folder", "left alone"]),
        ("append out.zarr", 2, &["FILE"]),
    ] {
        let (found, _, stderr) = sandbox.run(line);
        assert_eq!(found, code, "brickyard {line}: {stderr}");
        // A fault of the store is not the file's.
        let is_of_store =
            ["other.zarr", "still.zarr", "folder"].iter().any(|name| line.contains(&format!("append {name}")));
        assert!(!is_of_store || !stderr.contains("s2.raw:"), "brickyard {line}: {stderr}");
        assert!(words.iter().all(|word| stderr.contains(word)), "brickyard {line}: {words:?}: {stderr}");
        assert_eq!(tree_difference(&tree(&sandbox.path("")), &before), [""; 0], "brickyard {line}");
    }
}

#[test]
fn files_are_taken_in_the_order_in_which_pack_takes_them() {
    let sandbox = with_steps();
    // In the shell's expansion of `s*.raw`: 0, 1, 10, 11, 2.
    let mut names: Vec<String> = (0..STEPS).map(|number| format!("s{number}.raw")).collect();
    names.sort();
    let shells = names.join(" ");
    let times = |name: &str| name[1..name.len() - 4].parse::<f64>().expect("a number") * 0.5;
    let of_names = names.iter().map(|name| times(name).to_string()).collect::<Vec<_>>().join(",");
    let (_, _, said) = sandbox.run(&format!("append one.zarr {shells} {FLAGS}"));
    assert!(
        said.contains("note: 12 files in natural order, from s0.raw to s11.raw") && said.contains("--order given"),
        "{said}"
    );
    // Each time goes with its file.
    sandbox.run_ok(&format!("append two.zarr {shells} {FLAGS} --time {of_names}"));
    for store in ["one.zarr", "two.zarr"] {
        assert_eq!(whole_steps(&sandbox.path(store)), STEPS);
    }
    sandbox.run_ok(&format!("append given.zarr s0.raw s1.raw s10.raw s2.raw {FLAGS} --order given"));
    let given = Store::open(sandbox.path("given.zarr")).expect("a store");
    let mut found = vec![0; EXTENT.iter().product()];
    given.read_box(2, 0, Level(0), given.pyramid().level(Level(0)).extent.full_box(), &mut found).expect("sound");
    assert!(found == step(10));
    sandbox.run_ok(&format!("append again.zarr s1.raw s1.raw {FLAGS} --order given --time 0.5,0.7"));
    assert_eq!(Store::open(sandbox.path("again.zarr")).expect("a store").times(), 2);
    for (files, words) in [
        ("s0.raw s1.raw s3.raw", &["without 2", "--order natural"][..]),
        ("s0.raw s1.raw s1.raw", &["s1.raw", "named twice", "--order given"]),
        (
            "s0.raw s1.raw s10.raw s2.raw --time 0,1,2,3 --order natural",
            &["--time", "2 of s10.raw is not after 3 of s2.raw"],
        ),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("append none.zarr {files} {FLAGS}"));
        assert!(code == 2 && words.iter().all(|word| stderr.contains(word)), "{files}: {code}: {stderr}");
        assert!(!sandbox.path("none.zarr").exists(), "{files}");
    }
}

/// A foreign store may have links out of its folder. Their targets are untouched.
#[test]
fn nothing_is_written_or_deleted_through_a_link_in_a_store() {
    let sandbox = with_steps();
    sandbox.run_ok(&append("other.zarr", 0..3));
    std::fs::create_dir(sandbox.path("victim")).expect("the sandbox is writable");
    sandbox.write("victim/0", "precious");
    for (link, target) in [
        ("0/c/1", "victim"),
        ("0/c", "other.zarr/0/c"),
        ("0", "other.zarr/0"),
        ("1/.brickyard/hashes/c", "victim"),
        ("0/.brickyard/counts", "other.zarr/0/.brickyard/counts"),
        ("0/zarr.json.tmp", "victim/0"),
        ("zarr.json.tmp", "victim/0"),
        (".brickyard-lock", "victim/0"),
    ] {
        sandbox.run_ok(&append("evil.zarr", 0..1));
        let link_path = sandbox.path("evil.zarr").join(link);
        if link_path.is_dir() {
            std::fs::remove_dir_all(&link_path).expect("the sandbox is writable");
        }
        std::os::unix::fs::symlink(sandbox.path(target), &link_path).expect("the sandbox is writable");
        let elsewhere = || [tree(&sandbox.path("victim")), tree(&sandbox.path("other.zarr"))];
        let before = elsewhere();
        let (code, _, stderr) = sandbox.run(&append("evil.zarr", 1..2));
        // A level linked from another store has other steps, which is detected before any write.
        let words = if link == "0" { "expected [3," } else { "symbolic link" };
        assert!(code != 0 && stderr.contains(words), "{link}: {code}: {stderr}");
        let (code, _, stderr) = sandbox.run(&format!("pack s0.raw evil.zarr --overwrite {FLAGS}"));
        assert!(code != 0, "{link}: {stderr}");
        for (before, after) in before.iter().zip(&elsewhere()) {
            assert_eq!(tree_difference(after, before), [""; 0], "{link}");
        }
        std::fs::remove_dir_all(sandbox.path("evil.zarr")).expect("the sandbox is writable");
    }
}

/// A foreign file in the place of a step's files stays, and blocks nothing.
#[test]
fn a_foreign_file_does_not_stop_appends() {
    let sandbox = with_steps();
    sandbox.run_ok(&append("out.zarr", 0..2));
    let foreign =
        ["0/c/2/notes", "0/.brickyard/counts/notes", "0/.brickyard/counts/7/notes", "0/.brickyard/ranges/c/2/0/notes"];
    for name in foreign {
        let path = sandbox.path("out.zarr").join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("the sandbox is writable");
        std::fs::write(path, "mine").expect("the sandbox is writable");
    }
    sandbox.run_ok(&append("out.zarr", 2..4));
    assert_eq!(whole_steps(&sandbox.path("out.zarr")), 4);
    sandbox.run_ok("verify out.zarr --progress none");
    for name in foreign {
        assert_eq!(std::fs::read_to_string(sandbox.path("out.zarr").join(name)).expect("it stays"), "mine");
    }
}

#[test]
fn floats_without_data_are_so_in_steps_that_are_appended() {
    let sandbox = Sandbox::in_memory();
    let step = |value: f32| {
        let voxel = move |i: usize| if i.is_multiple_of(5) { -9999.0 } else { value };
        (0..64).flat_map(|i| voxel(i).to_le_bytes()).collect::<Vec<u8>>()
    };
    (0..4).for_each(|i| sandbox.write(format!("f{i}.raw"), step(i as f32)));
    let flags = "--shape 4,4,4 --dtype f32 --brick 8 --progress none";
    sandbox.run_ok(&format!("append out.zarr f0.raw {flags} --nodata -9999"));
    sandbox.run_ok(&format!("append out.zarr f1.raw {flags}"));
    sandbox.run_ok(&format!("append out.zarr f2.raw {flags} --nodata -9999"));
    let (code, _, stderr) = sandbox.run(&format!("append out.zarr f3.raw {flags} --nodata 3"));
    assert!(code == 3 && stderr.contains("value for no data") && stderr.contains("-9999"), "{stderr}");
    let store = Store::open(sandbox.path("out.zarr")).expect("a store");
    assert_eq!((store.times(), store.channel_range(0)), (3, (0.0, 2.0)));
    let found = sandbox.run_ok("probe out.zarr 0,0,0 --voxel --time all --csv");
    assert_eq!(found, "step,time,channel 0\n0,0,\n1,1,\n2,2,\n");
    let (code, _, stderr) = sandbox.run(&format!("append out.zarr f3.raw {flags} --nodata none"));
    assert!(code == 2 && stderr.contains("--nodata none") && stderr.contains("-9999"), "{stderr}");
    // In a store without such a setting, the value is an ordinary number.
    sandbox.run_ok(&format!("append late.zarr f0.raw {flags}"));
    let (code, _, stderr) = sandbox.run(&format!("append late.zarr f1.raw {flags} --nodata -9999"));
    assert!(code == 3 && stderr.contains("value for no data") && stderr.contains("pass --nodata none"), "{stderr}");
    sandbox.run_ok(&format!("append late.zarr f1.raw {flags} --nodata none"));
    let found = sandbox.run_ok("probe late.zarr 0,0,0 --voxel --time all --csv");
    assert_eq!(found, "step,time,channel 0\n0,0,-9999\n1,1,-9999\n");
}

#[test]
fn zarr_python_reads_and_edits_what_is_appended() {
    Sandbox::default().python("append_steps.py");
}
