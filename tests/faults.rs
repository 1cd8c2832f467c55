//! File operations that fail, are cut short, delayed or lost, at every n-th call of every command: exit code 0 never comes with a
//! wrong result, refusals name the place, and the next pack finishes an interrupted one.
#![cfg(target_os = "linux")]

use brickyard_tests::fault_cases::{
    Fault, Moment, OF_FILES, OF_READING, OF_WRITING, ON_THAT_FILE, ONCE, Result, ended, ended_well, ensure, in_two,
    moments, rules, store_tree, write_inputs,
};
use brickyard_tests::faults::{Outcome, Trial, assert_reached};
use brickyard_tests::power_loss::{Tree, read_tree, write_tree};
use brickyard_tests::{Random, read_png, tree_difference};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Two pyramids and aprons, shards of several bricks, and some of none: a part of the volume is empty.
const PACK: &str = "pack in.raw out.zarr --shape 20,17,12 --dtype u16 --brick 8 --shard 16 --downsample mean,max --aprons 1 \
                    --progress none -j 2";

/// A first pack of the same volume, to be replaced.
const OLD_PACK: &str = "pack in.raw out.zarr --shape 20,17,12 --dtype u16 --brick 8 --shard 8 --progress none -j 2";

/// The extent of both.
const SMALL: [usize; 3] = [20, 17, 12];

/// Three equal steps, two of them in a shard: its file is read back while it is written.
const SERIES_PACK: &str = "pack in.raw out.zarr --shape 20,17,12 --times 3 --shard-time 2 --dtype u16 --brick 8 --shard 16 \
                           --aprons 1 --progress none -j 2";

/// A store to read: shards of several pages.
const READ_PACK: &str =
    "pack in.raw out.zarr --shape 36,33,20 --dtype u16 --brick 8 --shard 32 --aprons 1 --progress none -j 2";

/// A sandbox with inputs, and the store made of them.
struct Packed {
    trial: Trial,
    /// Paths in the sandbox, and contents.
    inputs: Vec<(&'static str, Vec<u8>)>,
    pack: &'static str,
    expected: BTreeMap<PathBuf, Vec<u8>>,
    /// The run without harm.
    run: Outcome,
}

impl Packed {
    fn new(pack: &'static str, inputs: Vec<(&'static str, Vec<u8>)>) -> Self {
        let trial = Trial::default();
        let mut packed = Self { run: trial.run("info nothing", ""), trial, inputs, pack, expected: BTreeMap::new() };
        packed.clear();
        packed.pack_anew(pack);
        packed
    }

    /// Noise in a raw file.
    fn raw(pack: &'static str, extent: [usize; 3]) -> Self {
        Self::new(pack, vec![("in.raw", voxels(extent))])
    }

    /// Packs without harm, as the expected result.
    fn pack_anew(&mut self, line: &str) {
        self.run = self.trial.run(line, "");
        assert_eq!(self.run.code, Some(0), "{}", self.run.stderr);
        self.expected = store_tree(&self.store());
    }

    fn store(&self) -> PathBuf {
        self.trial.sandbox.path("out.zarr")
    }

    /// Restores the inputs.
    fn restore_inputs(&self) {
        write_inputs(&self.trial.sandbox.path(""), self.inputs.iter().map(|(name, bytes)| (*name, &bytes[..])));
    }

    /// Replaces the sandbox with the disk's content after a moment of the recorded run.
    fn lose_power(&self, before: &Tree, moment: &Moment) {
        write_tree(&self.trial.sandbox.path(""), &moment.remains(&self.run, before));
        self.restore_inputs();
    }

    /// Removes everything but the inputs.
    fn clear(&self) {
        write_tree(&self.trial.sandbox.path(""), &Tree::new());
        self.restore_inputs();
    }

    /// Checks that the store is the uninterrupted one, without leftovers.
    fn is_whole(&self) -> Result<()> {
        let first = |path: &Path| path.components().next().map(|name| name.as_os_str().to_owned());
        let found = read_tree(&self.trial.sandbox.path(""));
        let names: BTreeSet<_> = found.keys().filter_map(|path| first(path)).collect();
        let expected = self.inputs.iter().map(|(path, _)| *path).chain(["out.zarr"]);
        let is_all = names == expected.filter_map(|path| first(Path::new(path))).collect();
        ensure(is_all, || format!("in the folder there is {names:?}"))?;
        let difference = tree_difference(&store_tree(&self.store()), &self.expected);
        ensure(difference.is_empty(), || format!("the store is another: {difference:?}"))
    }

    /// Runs the command without harm.
    fn run_ok(&self, line: &str) -> Result<()> {
        let outcome = self.trial.run(line, "");
        ensure(outcome.code == Some(0), || format!("afterwards: brickyard {line}: {}", ended(&outcome)))
    }

    /// Packs under a rule: the store is whole, or the failure is reported and the next pack finishes it.
    fn is_whole_or_resumed(&self, line: &str, rule: &str) -> Result<()> {
        let outcome = self.trial.run(line, rule);
        ended_well(&outcome, rule)?;
        let is_another_input = rule.contains("halve") || rule.contains("empty");
        if outcome.code == Some(0) {
            self.is_whole()
                .or_else(|problem| if is_another_input { self.is_whole_but_for_its_source() } else { Err(problem) })?;
        }
        self.restore_inputs();
        let resumed = self.trial.run(&format!("{} --resume", self.pack), "");
        if is_another_input && resumed.code == Some(2) {
            // An input truncated meanwhile is a different one, as the message states: start over.
            self.run_ok(&format!("{} --overwrite", self.pack))?;
        } else {
            ensure(resumed.code == Some(0), || format!("afterwards, --resume: {}", ended(&resumed)))?;
        }
        self.is_whole()
    }

    /// Checks that the store has the whole input, despite another length or time in its source's description.
    fn is_whole_but_for_its_source(&self) -> Result<()> {
        let voxels = |files: &BTreeMap<PathBuf, Vec<u8>>| {
            let mut files = files.clone();
            files.remove(Path::new("zarr.json"));
            files
        };
        let difference = tree_difference(&voxels(&store_tree(&self.store())), &voxels(&self.expected));
        ensure(difference.is_empty(), || format!("the store is another: {difference:?}"))
    }
}

/// Noise, but zero in one eighth.
fn voxels([x, y, z]: [usize; 3]) -> Vec<u8> {
    let mut random = Random(3);
    let voxel = |n: usize| {
        let [i, j, k] = [n % x, n / x % y, n / (x * y)];
        let is_empty = i < x / 2 && j < y / 2 && k < z / 2;
        if is_empty { 0u16 } else { random.bits() as u16 }
    };
    (0..x * y * z).map(voxel).flat_map(u16::to_le_bytes).collect()
}

#[test]
fn the_library_is_reached() {
    let packed = Packed::raw(PACK, SMALL);
    assert_reached(&packed.trial.run(&format!("{PACK} --overwrite"), ""));
    let refused = packed.trial.run("info out.zarr", "read 1 EIO zarr.json");
    assert!(refused.code == Some(3) && refused.stderr.contains("Input/output error"), "{}", ended(&refused));
}

/// A pack under a fault either makes the same store as without, or reports failure and is finished by the next.
#[test]
fn a_pack_that_meets_a_fault_is_right_or_resumed() {
    in_two(
        60,
        || Packed::raw(PACK, SMALL),
        |packed| [rules(&OF_WRITING, &packed.run, ""), rules(&OF_FILES, &packed.run, "in.raw")].concat(),
        |packed, rule| {
            packed.clear();
            packed.is_whole_or_resumed(packed.pack, rule)
        },
    );
}

/// The same for a pack with several time steps per shard, and for its reads of them.
#[test]
fn a_pack_of_a_series_that_meets_a_fault_is_right_or_resumed() {
    const OF_READING_BACK: [Fault; 4] =
        [("read", ONCE, "EIO"), ("read", ONCE, "EINTR"), ("read", ONCE, "short"), ("read", ON_THAT_FILE, "ESTALE")];
    let input = voxels(SMALL).repeat(3);
    in_two(
        24,
        || Packed::new(SERIES_PACK, vec![("in.raw", input.clone())]),
        |packed| {
            let read_back = rules(&OF_READING_BACK, &packed.run, ".tmp");
            assert!(read_back.iter().all(|rules| !rules.is_empty()), "nothing is read back");
            [rules(&OF_WRITING, &packed.run, ""), read_back].concat()
        },
        |packed, rule| {
            packed.clear();
            packed.is_whole_or_resumed(packed.pack, rule)
        },
    );
}

/// The same for a pack resuming a killed one.
#[test]
fn a_pack_that_is_resumed_and_meets_a_fault_is_resumed_again() {
    let prepare = || {
        let mut packed = Packed::raw(PACK, SMALL);
        let renames = packed.run.calls.iter().filter(|call| call.name == "rename").count();
        packed.clear();
        packed.trial.run(PACK, &format!("rename {} kill", renames / 3));
        let half = read_tree(&packed.store());
        packed.pack_anew(&format!("{PACK} --resume"));
        (packed, half)
    };
    in_two(
        30,
        prepare,
        |(packed, _)| rules(&OF_WRITING, &packed.run, ""),
        |(packed, half), rule| {
            packed.clear();
            write_tree(&packed.store(), half);
            packed.is_whole_or_resumed(&format!("{PACK} --resume"), rule)
        },
    );
}

/// A NIfTI file of 16-bit voxels, compressed.
fn nifti(extent: [usize; 3]) -> Vec<u8> {
    let mut file = vec![0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    put(344, b"n+1\0");
    put(40, &3i16.to_le_bytes());
    extent.iter().enumerate().for_each(|(i, &n)| put(42 + 2 * i, &(n as i16).to_le_bytes()));
    put(70, &512i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    (0..4).for_each(|i| put(76 + 4 * i, &1f32.to_le_bytes()));
    put(108, &352f32.to_le_bytes());
    file.extend(voxels(extent));
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(&file).and_then(|()| encoder.finish()).expect("writing to memory")
}

/// A TIFF file of one plane of 16-bit voxels, uncompressed, with values calibrated by its description. This stands too far behind
/// everything else to be read with it.
fn tiff(width: usize, plane: &[u8]) -> Vec<u8> {
    const DESCRIPTION: &[u8] = b"ImageJ=1.53t\ncf=0\nc0=-100.0\nc1=2.0\nunit=mm\n\0";
    const AFTER_DIRECTORY: usize = 8 + 2 + 10 * 12 + 4;
    let (long, ascii) = (4, 2);
    let (height, padding) = (plane.len() / 2 / width, 100_000);
    let fields = [
        (256, long, 1, width),
        (257, long, 1, height),
        (258, long, 1, 16),
        (259, long, 1, 1),
        (262, long, 1, 1),
        (270, ascii, DESCRIPTION.len(), AFTER_DIRECTORY + plane.len() + padding),
        (273, long, 1, AFTER_DIRECTORY),
        (277, long, 1, 1),
        (278, long, 1, height),
        (279, long, 1, plane.len()),
    ];
    let mut file = b"II*\0\x08\0\0\0\x0a\0".to_vec();
    for (tag, kind, count, value) in fields {
        file.extend((tag as u16).to_le_bytes());
        file.extend([kind, 0]);
        file.extend([count, value].map(|n| (n as u32).to_le_bytes()).as_flattened());
    }
    file.extend([0; 4]);
    file.extend(plane);
    file.resize(file.len() + padding, 0);
    file.extend(DESCRIPTION);
    file
}

/// The same for inputs that are inflated into a scratch file, or opened file by file, and change or fail meanwhile.
#[test]
fn a_pack_whose_input_fails_or_changes_is_right_or_resumed() {
    const NIFTI: &str = "pack in.nii.gz out.zarr --scratch scratch --brick 8 --shard 16 --progress none -j 2";
    const PLANES: &str = "pack planes out.zarr --brick 8 --shard 16 --progress none -j 2";
    const IMAGE: &str = "pack in.tif out.zarr --brick 8 --shard 16 --progress none -j 2";
    const NAMES: [&str; 4] = ["planes/p_1.tif", "planes/p_2.tif", "planes/p_3.tif", "planes/p_4.tif"];
    // Changes to compressed files are noticed; uncompressed ones become another input.
    const OF_INFLATING: [Fault; 1] = [("read", ONCE, "flip")];
    let planes = || {
        let voxels = voxels([SMALL[0], SMALL[1], NAMES.len()]);
        let planes = voxels.chunks(voxels.len() / NAMES.len()).map(|plane| tiff(SMALL[0], plane));
        NAMES.into_iter().zip(planes).collect()
    };
    let prepare = || {
        let nifti = Packed::new(NIFTI, vec![("in.nii.gz", nifti(SMALL)), ("scratch/keep", Vec::new())]);
        let image = Packed::new(IMAGE, vec![("in.tif", tiff(SMALL[0], &voxels([SMALL[0], SMALL[1], 1])))]);
        [nifti, Packed::new(PLANES, planes()), image]
    };
    let rules = |inputs: &[Packed; 3]| {
        let of = |packed: usize, part, faults| {
            let run = &inputs[packed].run;
            let rules = rules(faults, run, part).into_iter();
            rules
                .map(|rules| rules.into_iter().map(|rule| Input { packed, rule }).collect())
                .collect::<Vec<Vec<Input>>>()
        };
        [
            of(0, "in.nii.gz", &OF_READING[..]),
            of(0, "in.nii.gz", &OF_FILES),
            of(0, "in.nii.gz", &OF_INFLATING),
            of(0, "scratch", &OF_WRITING),
            of(1, "planes", &OF_READING),
            of(1, "planes", &OF_FILES),
            of(2, "in.tif", &OF_READING),
        ]
        .concat()
    };
    in_two(36, prepare, rules, |packed, input| {
        let packed = &packed[input.packed];
        packed.clear();
        packed.is_whole_or_resumed(packed.pack, &input.rule)
    });
}

/// The input, and the rule.
#[derive(Clone)]
struct Input {
    packed: usize,
    rule: String,
}

impl std::fmt::Display for Input {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.rule)
    }
}

/// A store being replaced remains, whole, until its successor exists.
#[test]
fn a_store_that_is_replaced_is_whole_whatever_happens() {
    let prepare = || {
        let packed = Packed::raw(OLD_PACK, SMALL);
        let old = read_tree(&packed.store());
        let mut packed = Packed { pack: PACK, ..packed };
        packed.pack_anew(&format!("{PACK} --overwrite"));
        (packed, old)
    };
    in_two(
        42,
        prepare,
        |(packed, _)| rules(&OF_WRITING, &packed.run, ""),
        |(packed, old), rule| {
            packed.clear();
            write_tree(&packed.store(), old);
            let outcome = packed.trial.run(&format!("{PACK} --overwrite"), rule);
            ended_well(&outcome, rule)?;
            if outcome.code == Some(0) {
                packed.is_whole()?;
            }
            replaced_or_not(packed, old)
        },
    );
}

/// After a stop or power loss in a pack with `--overwrite`: the old store or the new one is there, whole, and the pack can be
/// resumed or started over.
fn replaced_or_not(packed: &Packed, old: &Tree) -> Result<()> {
    const JOURNAL: &str = ".brickyard-journal";
    ensure(packed.store().is_dir(), || "there is no store any more".into())?;
    let mut found = store_tree(&packed.store());
    found.remove(Path::new(JOURNAL));
    let old: BTreeMap<PathBuf, Vec<u8>> = old.iter().filter_map(|(p, b)| Some((p.clone(), b.clone()?))).collect();
    let is_old = found == old;
    let difference = || format!("the store is neither: {:?}", tree_difference(&found, &packed.expected));
    ensure(is_old || found == packed.expected, difference)?;
    let resumed = packed.trial.run(&format!("{} --resume", packed.pack), "");
    match resumed.code {
        Some(0) => packed.is_whole(),
        // Nothing was begun, and the message reports another store.
        Some(2) if is_old => {
            ensure(store_tree(&packed.store()) == old, || "a refused --resume changed the store".into())?;
            packed.run_ok(&format!("{} --overwrite", packed.pack))?;
            packed.is_whole()
        }
        _ => Err(format!("afterwards, --resume: {}", ended(&resumed))),
    }
}

/// The sandbox's files except for a new store.
fn only_input(packed: &Packed) -> Tree {
    packed.inputs.iter().map(|(path, bytes)| (path.into(), Some(bytes.clone()))).collect()
}

/// With any loss of unsynced writes and names: a store that opens is whole, and the next pack finishes the rest.
#[test]
fn a_pack_that_loses_power_is_right_or_resumed() {
    in_two(
        51,
        || Packed::raw(PACK, SMALL),
        |packed| moments(&packed.run, &only_input(packed)),
        |packed, moment| {
            packed.lose_power(&only_input(packed), moment);
            if moment.is_end_of(&packed.run) {
                packed.is_whole()?;
            }
            let info = packed.trial.run("info out.zarr", "");
            match info.code {
                Some(0) => {
                    let mut found = store_tree(&packed.store());
                    found.remove(Path::new(".brickyard-journal"));
                    let difference = tree_difference(&found, &packed.expected);
                    ensure(difference.is_empty(), || format!("it opens, but is another: {difference:?}"))?;
                }
                Some(3 | 4) => {}
                _ => return Err(format!("info: {}", ended(&info))),
            }
            packed.run_ok(&format!("{} --resume", packed.pack))?;
            packed.is_whole()
        },
    );
}

/// The same for a store being replaced: one store always exists.
#[test]
fn a_store_that_is_replaced_when_power_is_lost_is_whole() {
    let prepare = || {
        let old = Packed::raw(OLD_PACK, SMALL);
        let (old_store, before) = (read_tree(&old.store()), read_tree(&old.trial.sandbox.path("")));
        let mut packed = Packed { pack: PACK, ..old };
        packed.pack_anew(&format!("{PACK} --overwrite"));
        (packed, old_store, before)
    };
    in_two(
        42,
        prepare,
        |(packed, _, before)| moments(&packed.run, before),
        |(packed, old_store, before), moment| {
            packed.lose_power(before, moment);
            if moment.is_end_of(&packed.run) {
                packed.is_whole()?;
            }
            replaced_or_not(packed, old_store)
        },
    );
}

/// The reading commands.
const READERS: [&str; 5] = [
    "verify out.zarr --progress none",
    "info out.zarr --json",
    "export out.zarr level.raw --level 0 --progress none",
    "render out.zarr -o picture.png --backend cpu --size 24x20 -j 2 --level 0 --stats stats.json",
    "probe out.zarr 13,30,7 --voxel --csv --plot plot.svg",
];

/// A reading command, and the rule.
struct Reading {
    command: &'static str,
    rule: String,
}

impl std::fmt::Display for Reading {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.rule, self.command)
    }
}

/// A store, and its readers' output without harm.
struct Readable {
    packed: Packed,
    store: Tree,
    runs: [Outcome; 5],
    level: Vec<u8>,
    picture: brickyard::volume::Picture,
    plot: Vec<u8>,
}

impl Readable {
    fn new() -> Self {
        let packed = Packed::raw(READ_PACK, [36, 33, 20]);
        let store = read_tree(&packed.store());
        let runs = READERS.map(|command| packed.trial.run(command, ""));
        for run in &runs {
            assert_eq!(run.code, Some(0), "{}", ended(run));
        }
        let level = packed.trial.sandbox.read("level.raw");
        assert!(level == packed.inputs[0].1, "level 0 is the input");
        let picture = read_png(&packed.trial.sandbox.path("picture.png"));
        let plot = packed.trial.sandbox.read("plot.svg");
        Self { packed, store, runs, level, picture, plot }
    }

    fn cases(&self) -> Vec<Vec<Reading>> {
        let of = |(command, run): (&&'static str, &Outcome)| {
            let written = ["level.raw", "picture", "plot.svg", ".brickyard-export"].map(|part| (part, &OF_WRITING[..]));
            let read = [("", &OF_READING[..]), ("out.zarr/", &OF_FILES)];
            let rules = read.into_iter().chain(written).flat_map(|(part, faults)| rules(faults, run, part));
            let readings = |rules: Vec<String>| rules.into_iter().map(|rule| Reading { command, rule }).collect();
            rules.map(readings).collect::<Vec<Vec<Reading>>>()
        };
        READERS.iter().zip(&self.runs).flat_map(of).collect()
    }

    fn run(&self, case: &Reading) -> Result<()> {
        let sandbox = &self.packed.trial.sandbox;
        for name in ["level.raw", "level.raw.json", "picture.png", "stats.json", "plot.svg"] {
            let _ = std::fs::remove_file(sandbox.path(name));
        }
        let outcome = self.packed.trial.run(case.command, &case.rule);
        let is_changed = case.rule.contains("halve") || case.rule.contains("empty");
        let checked = ended_well(&outcome, &case.rule).and_then(|()| self.check(case, &outcome));
        if is_changed {
            write_tree(&self.packed.store(), &self.store);
        }
        checked
    }

    fn check(&self, case: &Reading, outcome: &Outcome) -> Result<()> {
        let sandbox = &self.packed.trial.sandbox;
        let Some(which) = READERS.iter().position(|command| *command == case.command) else { return Ok(()) };
        let is_same_picture = || read_png(&sandbox.path("picture.png")) == self.picture;
        if outcome.code != Some(0) {
            // Figures are written once the picture is there, and whole.
            let is_of_figures = outcome.stderr.contains("stats.json");
            let left = ["level.raw", "level.raw.json", "picture.png", "plot.svg"]
                .into_iter()
                .find(|name| sandbox.path(name).exists());
            let is_picture = left == Some("picture.png") && is_of_figures && is_same_picture();
            // Voxels and their text get their names one after the other; the text lacks alone if a kill falls between.
            let is_killed = case.rule.contains("kill") && !sandbox.path("level.raw.json").exists();
            let is_level = left == Some("level.raw") && is_killed && sandbox.read("level.raw") == self.level;
            return ensure(left.is_none() || is_picture || is_level, || format!("it failed but left {left:?}"));
        }
        let same_words = || ensure(outcome.stdout == self.runs[which].stdout, || "it says something else".into());
        match which {
            0 => {
                same_words()?;
                ensure(!is_sure_to_be_met(case, outcome), || "it does not say what it could not read".into())
            }
            1 => same_words(),
            2 => ensure(sandbox.read("level.raw") == self.level, || "level 0 is not the input".into()),
            4 => {
                same_words()?;
                ensure(sandbox.read("plot.svg") == self.plot, || "the plot is another".into())
            }
            _ => {
                let is_said = outcome.stderr.contains("could not be read");
                ensure(is_same_picture() || is_said, || "the picture is another, without a word".into())
            }
        }
    }
}

/// Everything beside the bricks that `verify` fails to read once is reported, even if it was read before or will be again.
#[test]
fn nothing_beside_the_bricks_is_checked_unread() {
    const VERIFY: &str = READERS[0];
    let cases = |readable: &Readable| {
        let rules = rules(&[("read", ONCE, "EIO")], &readable.runs[0], ".brickyard/").into_iter().flatten();
        vec![rules.map(|rule| Reading { command: VERIFY, rule }).collect()]
    };
    in_two(usize::MAX, Readable::new, cases, |readable, case| {
        let outcome = readable.packed.trial.run(VERIFY, &case.rule);
        ended_well(&outcome, &case.rule)?;
        let is_met = outcome.calls.iter().any(|call| call.name == "read" && call.result < 0);
        ensure(is_met == (outcome.code != Some(0)), || format!("met: {is_met}; {}", ended(&outcome)))
    });
}

/// Whether every reader of a whole store must meet the fault: a file failed every attempt to open, read or map it, or was cut
/// before the first read through its map. A shard's index is read before the file is closed: cutting off only the index later
/// removes nothing needed.
fn is_sure_to_be_met(case: &Reading, outcome: &Outcome) -> bool {
    let mut words = case.rule.split_whitespace();
    let (calls, when, action) = (words.next().unwrap_or(""), words.next().unwrap_or(""), words.next().unwrap_or(""));
    let cut = outcome.calls.iter().find(|call| call.name == "truncate");
    // Of 4^3 bricks.
    const INDEX_BYTES: i64 = 64 * 16 + 4;
    match action {
        "halve" | "empty" => cut.is_some_and(|cut| {
            let takes_bricks = calls != "close" || cut.number == 0 || cut.number > INDEX_BYTES;
            takes_bricks && outcome.calls.iter().any(|call| call.name == "map" && call.path == cut.path)
        }),
        _ => matches!(calls, "open" | "read" | "map") && when.ends_with(['+', '~']),
    }
}

/// Failed reads are reported or repeated: reports, exports and pictures are never wrong without a message.
#[test]
fn readers_that_meet_a_fault_say_so() {
    in_two(78, Readable::new, Readable::cases, |readable, case| readable.run(case));
}
