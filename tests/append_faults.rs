//! Faults under `append`: file operations that fail, are cut short, delayed or lost, at every n-th call. An append with exit code 0 has made
//! the same store as an unharmed one; otherwise the store opens with whole steps, their number is clear from the messages, and the next append
//! continues to the same bytes.
#![cfg(target_os = "linux")]

use brickyard::store::{OpenError, Store, verify};
use brickyard::volume::Level;
use brickyard_tests::Random;
use brickyard_tests::fault_cases::{
    Moment, OF_FILES, OF_READING, OF_WRITING, Result, ended, ended_well, ensure, in_two, moments, rules, store_tree,
    write_inputs,
};
use brickyard_tests::faults::{Outcome, Trial};
use brickyard_tests::power_loss::{Tree, read_tree, write_tree};
use brickyard_tests::tree_difference;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Two pyramids and aprons, shards of several bricks, and some of none.
const FLAGS: &str =
    "--shape 20,17,12 --dtype u16 --brick 8 --shard 16 --downsample mean,max --aprons 1 --progress none -j 2";
const EXTENT: [usize; 3] = [20, 17, 12];

const NAMES: [&str; 5] = ["s0.raw", "s1.raw", "s2.raw", "s3.raw", "s4.raw"];

/// Steps appended under faults.
const APPENDED: usize = 2;

/// Steps of noise, each zero in another eighth.
fn voxels(step: usize) -> Vec<u8> {
    let [x, y, z] = EXTENT;
    let mut random = Random(step as u64);
    let voxel = |n: usize| {
        let [i, j, k] = [n % x < x / 2, n / x % y < y / 2, n / (x * y) < z / 2];
        let part = usize::from(i) + 2 * usize::from(j) + 4 * usize::from(k);
        if part == step { 0u16 } else { random.bits() as u16 }
    };
    (0..x * y * z).map(voxel).flat_map(u16::to_le_bytes).collect()
}

/// The command line to append these steps.
fn append(steps: std::ops::Range<usize>) -> String {
    format!("append out.zarr {} {FLAGS}", NAMES[steps].join(" "))
}

/// A sandbox with the files of all steps, and a growing store.
struct Growing {
    trial: Trial,
    files: Vec<Vec<u8>>,
    /// The store with 0, 1, 2... steps.
    stores: Vec<BTreeMap<PathBuf, Vec<u8>>>,
    /// Steps of the store before the append.
    steps: usize,
    /// The sandbox before the append.
    before: Tree,
    /// The append without harm.
    run: Outcome,
}

impl Growing {
    /// A store with this many steps; the last of them, if any, was appended.
    fn new(steps: usize) -> Self {
        let trial = Trial::default();
        let files = (0..NAMES.len()).map(voxels).collect();
        let run = trial.run("info nothing", "");
        let mut growing = Self { trial, files, stores: vec![BTreeMap::new()], steps, before: Tree::new(), run };
        growing.restore_inputs();
        for step in 0..=steps + APPENDED {
            if step == steps {
                growing.before = read_tree(&growing.trial.sandbox.path(""));
            }
            growing.append_unharmed(step..step + 1).expect("an append without harm");
            growing.stores.push(store_tree(&growing.store()));
        }
        growing.run_from_the_start();
        growing
    }

    /// A store of `steps` steps, and an append of the next one killed at the rename at `part` of its way.
    fn cut_off(steps: usize, part: f64) -> Self {
        let mut growing = Self::new(steps);
        let renames = growing.run.calls.iter().filter(|call| call.name == "rename").count() / APPENDED;
        growing.start_over();
        let killed = growing
            .trial
            .run(&append(steps + 1..steps + 2), &format!("rename {} kill", (part * renames as f64) as usize));
        assert_eq!(killed.code, None, "{}", ended(&killed));
        growing.before = read_tree(&growing.trial.sandbox.path(""));
        growing.run_from_the_start();
        growing
    }

    fn run_from_the_start(&mut self) {
        self.start_over();
        self.run = self.trial.run(&append(self.steps..self.steps + APPENDED), "");
        assert_eq!(self.run.code, Some(0), "{}", self.run.stderr);
        self.is(self.steps + APPENDED)
            .expect("steps that are appended together are those that are appended one by one");
    }

    fn start_over(&self) {
        write_tree(&self.trial.sandbox.path(""), &self.before);
        self.restore_inputs();
    }

    fn restore_inputs(&self) {
        let inputs = NAMES.into_iter().zip(self.files.iter().map(|file| &file[..]));
        write_inputs(&self.trial.sandbox.path(""), inputs);
    }

    fn store(&self) -> PathBuf {
        self.trial.sandbox.path("out.zarr")
    }

    /// Checks that the store equals the untouched one with this many steps.
    fn is(&self, steps: usize) -> Result<()> {
        let difference = tree_difference(&store_tree(&self.store()), &self.stores[steps]);
        ensure(difference.is_empty(), || format!("the store is not that of {steps} steps: {difference:?}"))
    }

    fn append_unharmed(&self, steps: std::ops::Range<usize>) -> Result<()> {
        let outcome = self.trial.run(&append(steps), "");
        ensure(outcome.code == Some(0), || format!("afterwards: {}", ended(&outcome)))
    }

    /// Appends under a rule.
    fn is_right_or_goes_on(&self, rule: &str) -> Result<()> {
        self.start_over();
        let outcome = self.trial.run(&append(self.steps..self.steps + APPENDED), rule);
        ended_well(&outcome, rule)?;
        if outcome.code == Some(0) {
            return self.is(self.steps + APPENDED);
        }
        self.restore_inputs();
        let found = self.whole_steps().map_err(|problem| format!("{problem}; {}", ended(&outcome)))?;
        let said = self.steps + steps_said(&outcome);
        let is_told = if outcome.code.is_none() { (said..=said + 1).contains(&found) } else { said == found };
        ensure(is_told, || format!("{said} steps are said to be there, but there are {found}; {}", ended(&outcome)))?;
        self.goes_on(found).map_err(|problem| format!("{problem}; {}", ended(&outcome)))
    }

    /// Loses power at a moment of the append.
    fn is_right_or_goes_on_after(&self, moment: &Moment) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &moment.remains(&self.run, &self.before));
        self.restore_inputs();
        if moment.is_end_of(&self.run) {
            self.is(self.steps + APPENDED)?;
        }
        let found = self.whole_steps()?;
        ensure(found >= self.steps, || format!("{found} steps"))?;
        self.goes_on(found)
    }

    /// Checks that the next append makes the same store as without faults.
    fn goes_on(&self, found: usize) -> Result<()> {
        let end = (found + 1).max(self.steps + APPENDED);
        self.append_unharmed(found..end)?;
        self.is(end)
    }

    /// Checks that the store has whole steps only, and returns their number; 0 without a store, or with a first step not packed to the end.
    fn whole_steps(&self) -> Result<usize> {
        let path = self.store();
        // Readers may see the first step already, but the end of its pack is missing; the same file completes it.
        if self.steps == 0 && path.join(".brickyard-journal").exists() {
            return Ok(0);
        }
        let store = match Store::open(&path) {
            Ok(store) => store,
            Err(OpenError::NotAStore { .. } | OpenError::Incomplete { .. }) if self.steps == 0 => return Ok(0),
            Err(OpenError::Io { .. }) if self.steps == 0 && !path.exists() => return Ok(0),
            Err(error) => return Err(format!("it does not open: {error}")),
        };
        (0..store.times()).try_for_each(|step| is_step(&store, step, &self.files[step as usize]))?;
        let report = verify(&path, |_, _| {}).map_err(|error| format!("it cannot be verified: {error}"))?;
        ensure(report.problems.is_empty(), || format!("verify: {:?}", report.problems))?;
        Ok(store.times() as usize)
    }
}

/// Whether a step has these voxels and a readable coarsest level.
fn is_step(store: &Store, step: u32, voxels: &[u8]) -> Result<()> {
    let read = |level: Level| {
        let whole = store.pyramid().level(level).extent.full_box();
        let mut found = vec![1; whole.extent().volume() as usize * 2];
        let read = store.read_box(step, 0, level, whole, &mut found);
        read.map(|()| found).map_err(|error| format!("step {step} cannot be read: {error}"))
    };
    read(store.pyramid().coarsest())?;
    ensure(read(Level(0))? == voxels, || format!("step {step} has other voxels"))
}

/// The number of appended steps according to the messages.
fn steps_said(outcome: &Outcome) -> usize {
    let is_appended = |line: &&str| NAMES.iter().any(|name| line.starts_with(&format!("{name}: step ")));
    outcome.stderr.lines().filter(is_appended).count() + usize::from(outcome.stderr.contains("do not append it again"))
}

/// Rules for an append: for its writes, for its reads of the store, and for the file of a step's voxels.
fn rules_of(growing: &Growing) -> Vec<Vec<String>> {
    let inputs = NAMES[growing.steps + 1];
    let of = [("", &OF_WRITING[..]), ("out.zarr", &OF_READING), (inputs, &OF_FILES)];
    of.into_iter().flat_map(|(part, faults)| rules(faults, &growing.run, part)).collect()
}

/// An append to a store made by a single `append`: its values are not yet counted.
#[test]
fn an_append_that_meets_a_fault_is_right_or_goes_on() {
    in_two(40, || Growing::new(1), rules_of, |growing, rule| growing.is_right_or_goes_on(rule));
}

/// The append creates the store.
#[test]
fn an_append_that_makes_a_store_and_meets_a_fault_is_right_or_goes_on() {
    in_two(20, || Growing::new(0), rules_of, |growing, rule| growing.is_right_or_goes_on(rule));
}

/// The append reverts a cut-off one: files of an uncommitted step, or all documents but the root.
#[test]
fn an_append_after_one_that_was_cut_off_is_right_or_goes_on() {
    for part in [0.4, 0.97] {
        let rules = |growing: &Growing| rules(&OF_WRITING, &growing.run, "");
        in_two(14, || Growing::cut_off(2, part), rules, |growing, rule| growing.is_right_or_goes_on(rule));
    }
}

/// With any loss of unsynced writes and names.
#[test]
fn an_append_that_loses_power_is_right_or_goes_on() {
    for (steps, cases) in [(0, 14), (2, 20)] {
        let moments = |growing: &Growing| moments(&growing.run, &growing.before);
        in_two(cases, || Growing::new(steps), moments, |growing, moment| growing.is_right_or_goes_on_after(moment));
    }
    let moments = |growing: &Growing| moments(&growing.run, &growing.before);
    let run = |growing: &Growing, moment: &Moment| growing.is_right_or_goes_on_after(moment);
    in_two(14, || Growing::cut_off(2, 0.97), moments, run);
}

/// A step counts once its root document has its name; whether this lasts is separate, and both are reported.
#[test]
fn a_step_that_may_not_last_is_not_taken_for_one_that_is_missing() {
    for steps in [0, 1] {
        let growing = Growing::new(steps);
        let commit = |call: &&brickyard_tests::faults::Call| match steps {
            0 => call.name == "unlink" && call.path.ends_with(".brickyard-journal"),
            _ => call.name == "rename" && call.to.as_deref() == Some(Path::new("out.zarr/zarr.json")),
        };
        growing.start_over();
        let run = growing.trial.run(&append(steps..steps + 1), "");
        let committed = run.calls.iter().rposition(|call| commit(&call)).expect("a commit");
        let syncs = run.calls[..committed].iter().filter(|call| call.name == "sync").count();
        for often in ["", "+"] {
            let rule = format!("sync {}{often} EIO", syncs + 1);
            growing.start_over();
            let outcome = growing.trial.run(&append(steps..steps + 2), &rule);
            let said = format!("s{steps}.raw: step {steps} is in out.zarr: do not append it again");
            assert!(outcome.code == Some(1) && outcome.stderr.contains(&said), "{rule}: {}", ended(&outcome));
            assert_eq!(growing.whole_steps(), Ok(steps + 1), "{rule}");
            growing.append_unharmed(steps + 1..steps + 2).expect("the next step");
            growing.is(steps + 2).expect("the store to which nothing happened");
        }
    }
}

/// The last sync before the journal is removed: readers see the step, and an append of the same file completes it, as its message explains.
#[test]
fn a_first_step_without_the_end_of_its_pack_is_ended_by_the_same_file() {
    let growing = Growing::new(0);
    let is_end =
        |call: &brickyard_tests::faults::Call| call.name == "unlink" && call.path.ends_with(".brickyard-journal");
    let end = growing.run.calls.iter().position(is_end).expect("the end of the pack");
    let syncs = growing.run.calls[..end].iter().filter(|call| call.name == "sync").count();
    growing.is_right_or_goes_on(&format!("sync {syncs} EIO")).expect("the step is ended");
}

/// Environment variable that makes [`a_reader_follows`] the process under faults.
const FOLLOWS: &str = "BRICKYARD_TESTS_FOLLOW";

/// The number of tries of a follower.
const TRIES: usize = 4;

/// The first successful result, or the last try's.
fn tried<T>(mut attempt: impl FnMut() -> Result<T>) -> Result<T> {
    (1..TRIES).find_map(|_| attempt().ok()).map_or_else(attempt, Ok)
}

/// Opens the store, reads its step, and another appended meanwhile by the command.
fn follow() -> Result<()> {
    let is_right = |store: &Store, step: u32| tried(|| is_step(store, step, &voxels(step as usize)));
    let store = tried(|| Store::open(Path::new("out.zarr")).map_err(|error| error.to_string()))?;
    is_right(&store, 0)?;
    // The appending process meets no faults.
    let mut append = brickyard_tests::command();
    append.args(self::append(1..2).split_whitespace()).env_remove("LD_PRELOAD");
    let appended = append.output().map_err(|error| format!("out.zarr: {error}"))?;
    ensure(appended.status.success(), || format!("out.zarr: {}", String::from_utf8_lossy(&appended.stderr)))?;
    let newer = tried(|| store.newer().map_err(|error| error.to_string()))?.expect("one step more");
    assert_eq!(newer.times(), 2);
    for (store, step) in [(&newer, 1), (&newer, 0), (&store, 0)] {
        is_right(store, step)?;
    }
    Ok(())
}

/// The process of [`a_reader_that_follows_and_meets_a_fault_is_right_or_says_so`]; does nothing by itself.
#[test]
fn a_reader_follows() {
    if std::env::var_os(FOLLOWS).is_some() {
        let problem = follow().inspect_err(|problem| eprintln!("error: {problem}"));
        std::process::exit(if problem.is_ok() { 0 } else { 5 });
    }
}

/// Followers of a store read whole steps or get errors naming their file; never another step's voxels or a panic.
#[test]
fn a_reader_that_follows_and_meets_a_fault_is_right_or_says_so() {
    let follow = |growing: &Growing, rule: &str| {
        growing.start_over();
        let mut command = std::process::Command::new(std::env::current_exe().expect("this program has a path"));
        command.args(["append_faults::a_reader_follows", "--exact", "--nocapture"]);
        command.env(FOLLOWS, "1").current_dir(growing.trial.sandbox.path(""));
        growing.trial.run_command(command, rule)
    };
    let rules = |growing: &Growing| {
        let run = follow(growing, "");
        assert_eq!(run.code, Some(0), "{}", ended(&run));
        let of = [("", &OF_READING[..]), ("out.zarr/", &OF_FILES)];
        of.into_iter().flat_map(|(part, faults)| rules(faults, &run, part)).collect()
    };
    let is_right = |growing: &Growing, rule: &String| {
        let outcome = follow(growing, rule);
        ended_well(&outcome, rule)?;
        // A second try succeeds once the fault has passed.
        let stays = ["+", "~", "halve", "empty"].iter().any(|word| rule.contains(word));
        ensure(outcome.code == Some(0) || stays, || format!("it gave up: {}", ended(&outcome)))
    };
    in_two(60, || Growing::new(1), rules, is_right);
}

/// Failed writes change nothing.
#[test]
fn what_cannot_be_written_is_said_and_stays_as_it_is() {
    let growing = Growing::new(2);
    for (rule, code, words) in [
        ("open 1+ EROFS .brickyard-lock", 1, "error: out.zarr: cannot be written: Read-only file system"),
        ("open 1+ EACCES .brickyard-lock", 1, "error: out.zarr: cannot be written: Permission denied"),
        // A folder of another user inside.
        (
            "mkdir,open 1+ EACCES out.zarr/0/c/2",
            4,
            "Permission denied (os error 13); out.zarr has 2 time steps: see to that",
        ),
    ] {
        growing.start_over();
        let outcome = growing.trial.run(&append(2..3), rule);
        assert!(outcome.code == Some(code) && outcome.stderr.contains(words), "{rule}: {}", ended(&outcome));
        assert_eq!(read_tree(&growing.trial.sandbox.path("")), growing.before, "{rule}");
    }
}
