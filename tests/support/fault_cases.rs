//! Cases of a command under faults: kinds of faults, calls of a run, and moments of power loss.
//!
//! Each case is one run of the command under one rule. A test runs a sample of them ([`sample`](crate::sample)); `BRICKYARD_FAULT_CASES` sets the
//! number per test, or `all`.

use crate::faults::{Call, Outcome};
use crate::power_loss::{Disk, Lost, Tree};
use crate::sample::{places, seed, takes_all};
use crate::tree;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// The result of a case; an error describes the failure.
pub type Result<T> = std::result::Result<T, String>;

/// At this call alone.
pub const ONCE: &str = "";
/// At this call and all later ones.
pub const FROM_THEN_ON: &str = "+";
/// At this call and all later ones on the same file.
pub const ON_THAT_FILE: &str = "~";

/// A kind of fault: calls, frequency, and action.
pub type Fault = (&'static str, &'static str, &'static str);

/// Faults of a disk or file system during writing.
pub const OF_WRITING: [Fault; 26] = [
    ("open,write,sync,rename,unlink,mkdir", ONCE, "kill"),
    ("write", ONCE, "tear"),
    ("write", ONCE, "ENOSPC"),
    ("write,open,mkdir,allocate", FROM_THEN_ON, "ENOSPC"),
    ("write", ONCE, "EIO"),
    ("write", ONCE, "EINTR"),
    ("write", ONCE, "short"),
    ("sync", ONCE, "EIO"),
    ("sync", FROM_THEN_ON, "EIO"),
    ("rename", ONCE, "EIO"),
    ("open", ONCE, "EMFILE"),
    ("open", FROM_THEN_ON, "EACCES"),
    ("open", ONCE, "EINTR"),
    ("mkdir", ONCE, "EIO"),
    ("unlink", ONCE, "EIO"),
    ("close", ONCE, "EIO"),
    ("truncate,allocate,mode", ONCE, "EIO"),
    ("lock", ONCE, "EIO"),
    ("list", ONCE, "EIO"),
    ("stat", ONCE, "EIO"),
    ("stat", ON_THAT_FILE, "EACCES"),
    ("read", ONCE, "EIO"),
    ("read", ONCE, "short"),
    ("read", ON_THAT_FILE, "ESTALE"),
    ("map", ONCE, "ENOMEM"),
    ("any", "%", "delay:3"),
];

/// Faults of a file system during reading.
pub const OF_READING: [Fault; 15] = [
    ("open", ONCE, "EMFILE"),
    ("open", ON_THAT_FILE, "EACCES"),
    ("open", FROM_THEN_ON, "ENOENT"),
    ("read", ONCE, "EINTR"),
    ("read", ONCE, "short"),
    ("read", ONCE, "EIO"),
    ("read", ON_THAT_FILE, "ESTALE"),
    ("map", ONCE, "ENOMEM"),
    ("map", ON_THAT_FILE, "EIO"),
    ("map", ON_THAT_FILE, "lose"),
    ("map", ON_THAT_FILE, "flip"),
    ("stat", ON_THAT_FILE, "EIO"),
    ("list", ON_THAT_FILE, "EIO"),
    ("close", ONCE, "EIO"),
    ("any", "%", "delay:3"),
];

/// Faults that change the files themselves.
pub const OF_FILES: [Fault; 5] = [
    ("open", ONCE, "halve"),
    ("map", ONCE, "halve"),
    ("close", ONCE, "halve"),
    ("close", ONCE, "empty"),
    ("stat", ONCE, "empty"),
];

/// Chooses the cases to run: an equal share of each group, or the whole group if it is smaller, spread over its length.
fn chosen<C>(groups: Vec<Vec<C>>, at_most: usize) -> Vec<C> {
    let count = match std::env::var("BRICKYARD_FAULT_CASES") {
        Ok(text) if text == "all" => usize::MAX,
        Ok(text) => text.parse().expect("BRICKYARD_FAULT_CASES is `all` or a number of cases"),
        Err(_) if takes_all() => at_most.saturating_mul(5),
        Err(_) => at_most,
    };
    let mut left = count;
    let mut groups: Vec<Vec<C>> = groups.into_iter().filter(|group| !group.is_empty()).collect();
    // The unused share of a small group goes to larger ones.
    groups.sort_by_key(Vec::len);
    let mut chosen = Vec::new();
    let many = groups.len();
    for (i, group) in groups.into_iter().enumerate() {
        let share = left.div_ceil(many - i).min(group.len());
        left -= share;
        let mut wanted = places(&format!("faults {i}"), group.len(), share).into_iter().peekable();
        let taken = group.into_iter().enumerate().filter(|(j, _)| wanted.next_if_eq(j).is_some());
        chosen.extend(taken.map(|(_, case)| case));
    }
    chosen
}

/// The rules of these faults at every call of a run on files with `part` in their paths.
pub fn rules(of: &[Fault], run: &Outcome, part: &str) -> Vec<Vec<String>> {
    let rules = |(calls, often, action): &Fault| {
        let concerns = |name: &str| *calls == "any" || calls.split(',').any(|call| call == name);
        let contains = |path: &Path| path.to_string_lossy().contains(part);
        let is_met =
            |call: &&Call| concerns(&call.name) && (contains(&call.path) || call.to.as_deref().is_some_and(contains));
        let count = run.calls.iter().filter(is_met).count();
        let rule = |n| match *often {
            "%" => format!("{calls} %{n} {action} {part}"),
            often => format!("{calls} {n}{often} {action} {part}"),
        };
        (1..=count).map(rule).collect()
    };
    of.iter().map(rules).collect()
}

/// Runs the cases in two sandboxes side by side. `prepare` makes a worker's fixture, `cases` lists its cases.
///
/// # Panics
/// If cases fail, with all their errors.
pub fn in_two<W, C: std::fmt::Display>(
    at_most: usize,
    prepare: impl Fn() -> W + Sync,
    cases: impl Fn(&W) -> Vec<Vec<C>> + Sync,
    run: impl Fn(&W, &C) -> Result<()> + Sync,
) {
    let work = |half: usize| {
        let worker = prepare();
        let cases = chosen(cases(&worker), at_most);
        assert!(!cases.is_empty(), "nothing to try");
        let mine = cases.iter().enumerate().filter(|(i, _)| i % 2 == half);
        let failure = |case: &C| run(&worker, case).err().map(|problem| format!("{case}\n    {problem}"));
        mine.filter_map(|(_, case)| failure(case)).collect::<Vec<_>>()
    };
    let failures: Vec<String> = std::thread::scope(|scope| {
        let other = scope.spawn(|| work(1));
        let mut failures = work(0);
        failures.extend(other.join().expect("the other half"));
        failures
    });
    assert!(failures.is_empty(), "{} cases failed (seed {:x}):\n{}", failures.len(), seed(), failures.join("\n"));
}

/// Returns an error with this message unless a condition holds.
///
/// # Errors
/// If it does not hold.
pub fn ensure(holds: bool, otherwise: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(otherwise()) }
}

/// Describes the end of a run.
pub fn ended(outcome: &Outcome) -> String {
    let how = match (outcome.hung, outcome.code) {
        (true, _) => "it hung".into(),
        (_, Some(code)) => format!("exit {code}"),
        (_, None) => "a signal ended it".into(),
    };
    format!("{how}: {}", outcome.stderr.trim())
}

/// Checks that a command ended with a documented exit code and a message that names a file, whatever happened.
///
/// # Errors
/// If it did not.
pub fn ended_well(outcome: &Outcome, rule: &str) -> Result<()> {
    if outcome.code == Some(0)
        || (outcome.code.is_none() && !outcome.hung && (rule.contains("kill") || rule.contains("tear")))
    {
        return Ok(());
    }
    // 2 is for wrong command lines, and these are right.
    ensure(matches!(outcome.code, Some(1 | 3 | 4 | 5)), || ended(outcome))?;
    let error = outcome.stderr.lines().find(|line| line.starts_with("error: ")).unwrap_or_default();
    let names_a_file = [
        "out.zarr",
        "s0.raw",
        "s1.raw",
        "s2.raw",
        "s3.raw",
        "in.raw",
        "in.nii.gz",
        "in.tif",
        "planes",
        "scratch",
        "picture.png",
        "level.raw",
        "stats.json",
        "plot.svg",
    ]
    .iter()
    .any(|name| error.contains(name));
    // The store's folder, which is synced too.
    let names_the_folder = error.starts_with("error: .: ");
    ensure(names_a_file || names_the_folder, || format!("the message names no file: {}", ended(outcome)))
}

/// A store's files except for the lock: a stopped pack leaves it, and the next one takes it.
pub fn store_tree(store: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = tree(store);
    files.remove(Path::new(".brickyard-lock"));
    files
}

/// A moment of power loss in a run, and the losses.
pub struct Moment {
    /// Calls made before it.
    calls: usize,
    lost: Lost,
    /// The last of these calls.
    last: String,
}

impl std::fmt::Display for Moment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "power lost after call {} ({}), with it {:?}", self.calls, self.last, self.lost)
    }
}

/// Every moment of a run that changes the disk, with every kind of loss; `before` is the disk at the start.
pub fn moments(run: &Outcome, before: &Tree) -> Vec<Vec<Moment>> {
    let mut disk = Disk::new(before);
    let changes: Vec<usize> = (0..run.calls.len()).filter(|&i| disk.follow(&run.calls[i])).collect();
    let ways = |seed| [Lost::Nothing, Lost::Everything, Lost::Bytes, Lost::Names, Lost::Some(seed), Lost::Some(!seed)];
    let moment = |way: usize, i: usize| {
        let last = format!("{} {}", run.calls[i].name, run.calls[i].path.display());
        Moment { calls: i + 1, lost: ways(i as u64)[way], last }
    };
    // The last moment always: after it the run reports code 0.
    let last = vec![(0..6).filter_map(|way| Some(moment(way, *changes.last()?))).collect()];
    let by_way = (0..6).map(|way| changes.iter().map(|&i| moment(way, i)).collect());
    by_way.chain(last).collect()
}

impl Moment {
    /// Returns the files left after a power loss at this moment; `before` is the disk at the start.
    pub fn remains(&self, run: &Outcome, before: &Tree) -> Tree {
        let mut disk = Disk::new(before);
        for call in &run.calls[..self.calls] {
            disk.follow(call);
        }
        disk.after_power_loss(self.lost)
    }

    /// Whether the run changed nothing after this moment, so that it may have reported success.
    pub fn is_end_of(&self, run: &Outcome) -> bool {
        let changes = ["write", "truncate", "mkdir", "unlink", "sync", "rename"];
        !run.calls[self.calls..].iter().any(|call| call.result >= 0 && changes.contains(&&*call.name))
    }
}

/// Writes inputs below a folder, always with the same modification times: a pack resumes only from the same input.
///
/// # Panics
/// If a file cannot be written.
pub fn write_inputs<'a>(folder: &Path, inputs: impl IntoIterator<Item = (&'a str, &'a [u8])>) {
    for (name, bytes) in inputs {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("below the folder")).expect("the sandbox is writable");
        std::fs::write(&path, bytes).expect("the sandbox is writable");
        let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        let file = std::fs::File::options().write(true).open(path);
        file.and_then(|file| file.set_modified(time)).expect("the sandbox is writable");
    }
}
