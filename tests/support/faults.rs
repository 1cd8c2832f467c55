//! The command under faults: the preloaded library of `tests/faults` fails, delays, truncates and records its file operations
//! by rules.

use crate::{Sandbox, command};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

/// Time until a command under faults counts as hanging. None takes a tenth of it.
const PATIENCE: Duration = Duration::from_secs(30);

/// A place to run `brickyard` under faults: a sandbox whose files are subject to rules, and another for the command's output
/// and the record of its calls.
pub struct Trial {
    /// The sandbox of the command and of the rules.
    pub sandbox: Sandbox,
    aside: Sandbox,
    under: PathBuf,
}

/// The end of a run of `brickyard` under faults, and its calls.
pub struct Outcome {
    /// The exit code; `None` if a signal ended the command.
    pub code: Option<i32>,
    /// Whether the command hung, and was killed.
    pub hung: bool,
    /// Standard output of the command.
    pub stdout: Vec<u8>,
    /// Standard error of the command.
    pub stderr: String,
    /// The command's calls on files of the sandbox, in order.
    pub calls: Vec<Call>,
    /// A shell line that repeats the run.
    pub how: String,
}

/// A recorded call on a file of the sandbox.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// The kind of the call: `open`, `write`, ... (`tests/faults/src/rules.rs` has them all).
    pub name: String,
    /// The result of the call; below zero if it failed, or falsely reported success.
    pub result: i64,
    /// The call's number: flags of an open, rename or unlink, offset of a write, new length of a truncated file, 1 for a sync
    /// of the whole file system.
    pub number: i64,
    /// The call's file or folder, as a path in the sandbox.
    pub path: PathBuf,
    /// The file's new name, as a path in the sandbox, if the call gave one.
    pub to: Option<PathBuf>,
    /// The bytes of a write; empty for other calls.
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
    /// Runs `brickyard` on a line of arguments (split at blanks) under rules (see `tests/faults/src/rules.rs`); an empty text
    /// has no rules.
    ///
    /// # Panics
    /// If the command cannot be started, or the library to preload is not built.
    pub fn run(&self, line: &str, rule: &str) -> Outcome {
        let mut command = self.sandbox.command();
        command.args(line.split_whitespace());
        self.run_command(command, rule)
    }

    /// Runs another program from the sandbox's folder, like [`run`](Self::run).
    ///
    /// # Panics
    /// If it cannot be started, or the library to preload is not built.
    pub fn run_command(&self, mut command: Command, rule: &str) -> Outcome {
        let log = self.aside.path("log");
        let _ = std::fs::remove_file(&log);
        let create = |name| File::create(self.aside.path(name)).expect("the sandbox is writable");
        command.stdout(create("stdout")).stderr(create("stderr"));
        harm(&mut command, &self.under, rule);
        command.env("RAYON_NUM_THREADS", "2").env("BRICKYARD_FAULTS_LOG", &log);
        let (status, hung) = wait(&mut command);
        let words = [command.get_program()].into_iter().chain(command.get_args());
        let line = words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
        let how = format!(
            "cd {under}; LD_PRELOAD={} BRICKYARD_FAULTS_UNDER={under} BRICKYARD_FAULTS='{rule}' {line}",
            library().display(),
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

/// Subjects a command's operations on files below a folder to rules (see `tests/faults/src/rules.rs`). The folder's path has
/// no links.
pub fn harm(command: &mut Command, under: &Path, rule: &str) {
    command.env("LD_PRELOAD", library()).env("BRICKYARD_FAULTS_UNDER", under).env("BRICKYARD_FAULTS", rule);
}

/// The path of the preloaded library. Cargo builds it beside the tests, which depend on it.
fn library() -> PathBuf {
    let test = std::env::current_exe().expect("this program has a path");
    let path = test.with_file_name("libbrickyard_faults.so");
    assert!(path.is_file(), "{} is not built; `cargo test -p brickyard-tests` builds it", path.display());
    path
}

/// Starts a command and waits for its end. Kills it if it hangs; the second value is `true` then.
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

/// Parses the record of a run (see `tests/faults/src/record.rs`), with paths relative to `under`.
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

/// Asserts, from a pack without faults, that the library reaches the command, which is the same file for all tests: each kind
/// of call of a pack is recorded.
///
/// # Panics
/// If the record lacks a kind of call.
pub fn assert_reached(outcome: &Outcome) {
    let program = command().get_program().to_owned();
    for name in ["open", "read", "write", "map", "sync", "rename", "lock", "stat", "mkdir", "unlink", "list"] {
        assert!(outcome.calls.iter().any(|call| call.name == name), "{program:?}: no {name} was seen: {}", outcome.how);
    }
}
