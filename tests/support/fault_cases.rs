//! Cases of a command under faults: which faults there are, at which calls of a run, and at which moments the power may go.
//!
//! Each case is one run of the command under one rule. A run takes a sample of them ([`sample`](crate::sample)); `BRICKYARD_FAULT_CASES` sets how many
//! each test takes, or `all`.

use crate::faults::{Call, Outcome};
use crate::power_loss::{Disk, Lost, Tree};
use crate::sample::{places, seed, takes_all};
use crate::tree;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// The result of a case: an error says what went wrong.
pub type Result<T> = std::result::Result<T, String>;

/// At that call alone.
pub const ONCE: &str = "";
/// At that call and at all that follow.
pub const FROM_THEN_ON: &str = "+";
/// At that call and at all that follow on the same file.
pub const ON_THAT_FILE: &str = "~";

/// A kind of fault: the calls, how often, and what happens to them.
pub type Fault = (&'static str, &'static str, &'static str);

/// Faults of a disk or a file system on which something is written.
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

/// Faults of a file system from which something is read.
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

/// Chooses the cases that are run: of each group as many as the group has or as its share is, from all of its length.
fn chosen<C>(groups: Vec<Vec<C>>, at_most: usize) -> Vec<C> {
    let count = match std::env::var("BRICKYARD_FAULT_CASES") {
        Ok(text) if text == "all" => usize::MAX,
        Ok(text) => text.parse().expect("BRICKYARD_FAULT_CASES is `all` or a number of cases"),
        Err(_) if takes_all() => at_most.saturating_mul(5),
        Err(_) => at_most,
    };
    let mut left = count;
    let mut groups: Vec<Vec<C>> = groups.into_iter().filter(|group| !group.is_empty()).collect();
    // The part of its share that a small group does not take goes to the other groups.
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

/// The rules of each of these faults at every call of a run, on files whose path contains `part`.
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

/// Two sandboxes side by side: runs a part of the cases in each. `prepare` makes what a worker needs, `cases` lists them.
///
/// # Panics
/// With all that went wrong.
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

/// An error with these words, unless something holds.
///
/// # Errors
/// If it does not hold.
pub fn ensure(holds: bool, otherwise: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(otherwise()) }
}

/// How a run ended, in words.
pub fn ended(outcome: &Outcome) -> String {
    let how = match (outcome.hung, outcome.code) {
        (true, _) => "it hung".into(),
        (_, Some(code)) => format!("exit {code}"),
        (_, None) => "a signal ended it".into(),
    };
    format!("{how}: {}", outcome.stderr.trim())
}

/// Whatever happens, a command ends, with a documented exit code, and a message that names a file.
///
/// # Errors
/// If this one did not.
pub fn ended_well(outcome: &Outcome, rule: &str) -> Result<()> {
    if outcome.code == Some(0)
        || (outcome.code.is_none() && !outcome.hung && (rule.contains("kill") || rule.contains("tear")))
    {
        return Ok(());
    }
    // 2 is for command lines, and these are right.
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
    // The folder that the store is in, which is synced too.
    let names_the_folder = error.starts_with("error: .: ");
    ensure(names_a_file || names_the_folder, || format!("the message names no file: {}", ended(outcome)))
}

/// A store's files but for the lock, which a pack leaves that was stopped, and the next one takes.
pub fn store_tree(store: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = tree(store);
    files.remove(Path::new(".brickyard-lock"));
    files
}

/// A moment in a run, and what the power failure takes.
pub struct Moment {
    /// Calls made before.
    calls: usize,
    lost: Lost,
    /// The last of them.
    last: String,
}

impl std::fmt::Display for Moment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "power lost after call {} ({}), with it {:?}", self.calls, self.last, self.lost)
    }
}

/// Every moment of a run that began with `before` at which the disk has changed, for every way to lose power then.
pub fn moments(run: &Outcome, before: &Tree) -> Vec<Vec<Moment>> {
    let mut disk = Disk::new(before);
    let changes: Vec<usize> = (0..run.calls.len()).filter(|&i| disk.follow(&run.calls[i])).collect();
    let ways = |seed| [Lost::Nothing, Lost::Everything, Lost::Bytes, Lost::Names, Lost::Some(seed), Lost::Some(!seed)];
    let moment = |way: usize, i: usize| {
        let last = format!("{} {}", run.calls[i].name, run.calls[i].path.display());
        Moment { calls: i + 1, lost: ways(i as u64)[way], last }
    };
    // The last one, of which a code of 0 was said, always.
    let last = vec![(0..6).filter_map(|way| Some(moment(way, *changes.last()?))).collect()];
    let by_way = (0..6).map(|way| changes.iter().map(|&i| moment(way, i)).collect());
    by_way.chain(last).collect()
}

impl Moment {
    /// Returns the files that are left if the power goes at this moment, of a disk that had the files `before` when the run began.
    pub fn remains(&self, run: &Outcome, before: &Tree) -> Tree {
        let mut disk = Disk::new(before);
        for call in &run.calls[..self.calls] {
            disk.follow(call);
        }
        disk.after_power_loss(self.lost)
    }

    /// Whether the run changed nothing after this moment, so that it has said that all is done.
    pub fn is_end_of(&self, run: &Outcome) -> bool {
        let changes = ["write", "truncate", "mkdir", "unlink", "sync", "rename"];
        !run.calls[self.calls..].iter().any(|call| call.result >= 0 && changes.contains(&&*call.name))
    }
}

/// Writes inputs below a folder, each time with the same times of change: a pack is resumed from the same input only.
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
