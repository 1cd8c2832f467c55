//! Rules for faults: the affected calls, and the action.
//!
//! A rule is `CALLS WHEN ACTION [PATH]`, separated by blanks:
//!
//! - `CALLS`: names of [`Call`]s, separated by commas, or `any`.
//! - `WHEN`, among those calls: `7` is the seventh alone; `7+` the seventh and all later ones; `7~` the seventh and all later ones on
//!   the same file; `%7` every seventh.
//! - `ACTION`: see [`Action`].
//! - `PATH`: a text; restricts the rule to files with this text in their path.

use std::collections::HashSet;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::{Mutex, OnceLock, PoisonError};

/// A kind of call, by its purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Call {
    Open,
    Close,
    Read,
    Write,
    Map,
    Sync,
    Rename,
    Truncate,
    Allocate,
    Unlink,
    Mkdir,
    Stat,
    Lock,
    List,
    Mode,
}

impl Call {
    const ALL: [(Self, &'static str); 15] = [
        (Self::Open, "open"),
        (Self::Close, "close"),
        (Self::Read, "read"),
        (Self::Write, "write"),
        (Self::Map, "map"),
        (Self::Sync, "sync"),
        (Self::Rename, "rename"),
        (Self::Truncate, "truncate"),
        (Self::Allocate, "allocate"),
        (Self::Unlink, "unlink"),
        (Self::Mkdir, "mkdir"),
        (Self::Stat, "stat"),
        (Self::Lock, "lock"),
        (Self::List, "list"),
        (Self::Mode, "mode"),
    ];

    pub(crate) fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// A rule's action on a call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Action {
    /// `EIO`, `ENOSPC`...: the call fails with this error.
    Fail(i32),
    /// `short`: half of the call's bytes are read or written.
    Short,
    /// `delay:MS`: the call is made after this many milliseconds.
    Delay(u64),
    /// `kill`: the process ends before the call, as by SIGKILL.
    Kill,
    /// `tear`: half of the call's bytes are written, then the process ends, as by SIGKILL.
    Tear,
    /// `lie`: the call does nothing and reports success.
    Lie,
    /// `halve`, `empty`: after the call, the file is cut to half its length, or to nothing.
    Cut { halves: u64 },
    /// `flip`: one byte of the read or mapped data is changed.
    Flip,
    /// `lose`: a page of the map cannot be read.
    Lose,
}

const ERRORS: [(&str, i32); 10] = [
    ("EIO", libc::EIO),
    ("ENOSPC", libc::ENOSPC),
    ("EINTR", libc::EINTR),
    ("EMFILE", libc::EMFILE),
    ("ENOMEM", libc::ENOMEM),
    ("ESTALE", libc::ESTALE),
    ("EACCES", libc::EACCES),
    ("ENOENT", libc::ENOENT),
    ("EROFS", libc::EROFS),
    ("EOPNOTSUPP", libc::EOPNOTSUPP),
];

impl FromStr for Action {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        if let Some(millis) = text.strip_prefix("delay:") {
            return millis.parse().map(Self::Delay).map_err(drop);
        }
        let error = ERRORS.iter().find(|(name, _)| *name == text);
        Ok(match (text, error) {
            (_, Some((_, number))) => Self::Fail(*number),
            ("short", _) => Self::Short,
            ("kill", _) => Self::Kill,
            ("tear", _) => Self::Tear,
            ("lie", _) => Self::Lie,
            ("halve", _) => Self::Cut { halves: 1 },
            ("empty", _) => Self::Cut { halves: 0 },
            ("flip", _) => Self::Flip,
            ("lose", _) => Self::Lose,
            _ => return Err(()),
        })
    }
}

#[derive(Clone, Copy)]
enum When {
    Once(u64),
    From(u64),
    SameFile(u64),
    Every(u64),
}

impl FromStr for When {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let number = |text: &str| text.parse().map_err(drop);
        if let Some(n) = text.strip_prefix('%') {
            return number(n).map(Self::Every);
        }
        match text.split_at_checked(text.len().saturating_sub(1)) {
            Some((n, "+")) => number(n).map(Self::From),
            Some((n, "~")) => number(n).map(Self::SameFile),
            _ => number(text).map(Self::Once),
        }
    }
}

struct Rule {
    /// The affected kinds of calls; empty for any.
    calls: Vec<Call>,
    when: When,
    action: Action,
    part: String,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    seen: u64,
    /// The files seen by [`When::SameFile`].
    files: HashSet<String>,
}

impl FromStr for Rule {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let mut words = text.split_whitespace();
        let mut next = || words.next().ok_or(());
        let (calls, when, action) = (next()?, next()?.parse()?, next()?.parse()?);
        let call = |name: &str| Call::ALL.iter().find(|(_, n)| *n == name).map(|(call, _)| *call).ok_or(());
        let calls = if calls == "any" { Vec::new() } else { calls.split(',').map(call).collect::<Result<_, ()>>()? };
        Ok(Self { calls, when, action, part: words.next().unwrap_or("").into(), state: Mutex::default() })
    }
}

impl Rule {
    /// Counts the call, if the rule affects it. Returns the rule's action on it, if any.
    fn meet(&self, call: Call, path: &str) -> Option<Action> {
        if !(self.calls.is_empty() || self.calls.contains(&call)) || !path.contains(&self.part) {
            return None;
        }
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.seen += 1;
        let is_met = match self.when {
            When::Once(n) => state.seen == n,
            When::From(n) => state.seen >= n,
            When::Every(n) => state.seen.is_multiple_of(n),
            When::SameFile(n) => {
                if state.seen == n {
                    state.files.insert(path.into());
                }
                state.files.contains(path)
            }
        };
        is_met.then_some(self.action)
    }
}

/// The environment's settings: the folder, the rules and the log.
pub(crate) struct Settings {
    pub(crate) under: String,
    rules: Vec<Rule>,
    pub(crate) log: Option<PathBuf>,
}

/// The settings, read once; `None` if `BRICKYARD_FAULTS_UNDER` is no absolute path. Ends the process on an invalid rule.
pub(crate) fn settings() -> Option<&'static Settings> {
    static SETTINGS: OnceLock<Option<Settings>> = OnceLock::new();
    let read = || {
        let under = std::env::var("BRICKYARD_FAULTS_UNDER").ok().filter(|under| under.starts_with('/'))?;
        let rules = std::env::var("BRICKYARD_FAULTS").unwrap_or_default();
        let rules = rules.split(';').filter(|rule| !rule.trim().is_empty()).map(str::parse);
        // An invalid rule would make an empty test.
        let rules = rules.collect::<Result<_, ()>>().unwrap_or_else(|()| std::process::abort());
        Some(Settings { under, rules, log: std::env::var_os("BRICKYARD_FAULTS_LOG").map(PathBuf::from) })
    };
    SETTINGS.get_or_init(read).as_ref()
}

impl Settings {
    /// Whether a path is the folder or below it.
    pub(crate) fn concerns(&self, path: &str) -> bool {
        path.strip_prefix(&self.under).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    }

    /// Counts the call for all rules that affect it. Returns the action of the first matching rule, if any.
    pub(crate) fn meet(&self, call: Call, path: &str) -> Option<Action> {
        // All rules count, whatever an earlier one does.
        self.rules.iter().fold(None, |first, rule| {
            let met = rule.meet(call, path);
            first.or(met)
        })
    }
}
