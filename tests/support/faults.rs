//! The command under faults: run with the library of `tests/faults` preloaded, which fails, delays, cuts short and records its
//! file operations as a rule says.

use crate::{Sandbox, command};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

/// After so long a command counts as hanging. None takes a tenth of it.
const PATIENCE: Duration = Duration::from_secs(30);

/// A sandbox whose files are at the mercy of rules, and one beside it for what is said and recorded.
pub struct Trial {
    /// Where the command runs.
    pub sandbox: Sandbox,
    aside: Sandbox,
    under: PathBuf,
}

/// How a command ended.
pub struct Outcome {
    /// The exit code; `None` if a signal ended it.
    pub code: Option<i32>,
    /// Whether it had to be ended because it did not end.
    pub hung: bool,
    /// Standard output.
    pub stdout: Vec<u8>,
    /// Standard error.
    pub stderr: String,
    /// What it asked of the file system, as far as that concerns the sandbox.
    pub calls: Vec<Call>,
    /// What a shell needs to see the same.
    pub how: String,
}

/// A recorded call on a file of the sandbox.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// `open`, `write`, ...
    pub name: String,
    /// What it returned; below zero if it failed.
    pub result: i64,
    /// The flags of an open, rename or unlink, the offset of a write, the new length of a file.
    pub number: i64,
    /// The file.
    pub path: PathBuf,
    /// The new name, where there is one.
    pub to: Option<PathBuf>,
    /// What was written.
    pub bytes: Vec<u8>,
}

impl Default for Trial {
    fn default() -> Self {
        let (sandbox, aside) = (Sandbox::in_memory(), Sandbox::in_memory());
        let under = sandbox.path("").canonicalize().expect("the sandbox is there");
        Self { sandbox, aside, under }
    }
}

impl Trial {
    /// Runs the command on a line of arguments (split at blanks) under a rule (see `tests/faults/src/rules.rs`); an empty one
    /// does no harm.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn run(&self, line: &str, rule: &str) -> Outcome {
        let log = self.aside.path("log");
        let _ = std::fs::remove_file(&log);
        let library = library();
        let create = |name| File::create(self.aside.path(name)).expect("the sandbox is writable");
        let mut command = self.sandbox.command();
        command.args(line.split_whitespace()).stdout(create("stdout")).stderr(create("stderr"));
        command.env("LD_PRELOAD", &library).env("RAYON_NUM_THREADS", "2");
        command.env("BRICKYARD_FAULTS_UNDER", &self.under).env("BRICKYARD_FAULTS", rule);
        command.env("BRICKYARD_FAULTS_LOG", &log);
        let (status, hung) = wait(&mut command);
        let how = format!(
            "cd {under}; LD_PRELOAD={} BRICKYARD_FAULTS_UNDER={under} BRICKYARD_FAULTS='{rule}' brickyard {line}",
            library.display(),
            under = self.under.display()
        );
        Outcome {
            code: status.code(),
            hung,
            stdout: self.aside.read("stdout"),
            stderr: String::from_utf8_lossy(&self.aside.read("stderr")).into_owned(),
            calls: parse(&std::fs::read(&log).unwrap_or_default(), &self.under),
            how,
        }
    }
}

/// The library to preload: Cargo builds it beside the tests, which depend on it.
fn library() -> PathBuf {
    let test = std::env::current_exe().expect("this program has a path");
    let path = test.with_file_name("libbrickyard_faults.so");
    assert!(path.is_file(), "{} is not built; `cargo test -p brickyard-tests` builds it", path.display());
    path
}

/// Waits for a command, and ends it if it hangs.
fn wait(command: &mut Command) -> (ExitStatus, bool) {
    let mut child = command.spawn().expect("the command starts");
    let started = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("a child") {
            return (status, false);
        }
        if started.elapsed() > PATIENCE {
            child.kill().expect("a child");
            return (child.wait().expect("a child"), true);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A record (see `tests/faults/src/record.rs`), its paths below the sandbox.
fn parse(mut log: &[u8], under: &Path) -> Vec<Call> {
    let mut calls = Vec::new();
    while let Some(end) = log.iter().position(|&byte| byte == b'\n') {
        let head = String::from_utf8_lossy(&log[..end]).into_owned();
        let mut words = head.splitn(5, '\t');
        let mut next = || words.next().expect("five columns");
        let name = next().to_owned();
        let [result, number, length] = std::array::from_fn(|_| next().parse().expect("a number"));
        let below = |path: &str| Path::new(path).strip_prefix(under).unwrap_or(Path::new(path)).to_path_buf();
        let (path, to) = match next().split_once('\t') {
            Some((path, to)) => (below(path), Some(below(to))),
            None => (below(head.rsplit('\t').next().unwrap_or_default()), None),
        };
        let rest = &log[end + 1..];
        let (bytes, rest) = rest.split_at((length as usize).min(rest.len()));
        calls.push(Call { name, result, number, path, to, bytes: bytes.to_vec() });
        log = rest;
    }
    calls
}

/// Whether the command was built to be reached by the library: it is the same file for all tests.
///
/// # Panics
/// If a pack without harm makes no call that the library sees.
pub fn assert_reached(outcome: &Outcome) {
    let program = command().get_program().to_owned();
    for name in ["open", "read", "write", "map", "sync", "rename", "lock", "stat", "mkdir", "unlink", "list"] {
        assert!(outcome.calls.iter().any(|call| call.name == name), "{program:?}: no {name} was seen: {}", outcome.how);
    }
}
