//! Scripts: timed commands for tests, documentation and tutorials. A line is `SECONDS COMMAND`, counted from the window's first frame, or
//! `settled COMMAND`, which waits for the final picture. Lines are played in order; `#` starts a comment. The first failing command ends the script:
//! lines have numbers, and stay linked to the background work they started until it is over.

use crate::command::Command;
use std::collections::VecDeque;
use std::str::FromStr;
use std::time::Duration;

/// Commands to play.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    lines: VecDeque<(When, Line)>,
    /// Lines with unfinished work.
    begun: Vec<Line>,
}

/// A command of a script.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Line {
    /// The line's number, from 1; 0 for commands from elsewhere.
    pub(crate) number: usize,
    pub(crate) command: Command,
}

impl Line {
    /// The message for the line's failure.
    pub(crate) fn failure(&self, problem: &str) -> String {
        match self.number {
            0 => problem.into(),
            number => format!("the script's line {number}: {}", self.command.failure(problem)),
        }
    }
}

/// When a command is played.
#[derive(Clone, Copy, Debug, PartialEq)]
enum When {
    /// This long after the window's first frame, and after the lines before.
    At(Duration),
    /// Once the picture is final.
    Settled,
}

impl Script {
    /// Removes the next due command, `since_start` after the window's first frame.
    pub(crate) fn next(&mut self, since_start: Duration, is_settled: bool) -> Option<Line> {
        let is_due = |when: &When| match when {
            When::At(time) => *time <= since_start,
            When::Settled => is_settled,
        };
        let (_, line) = self.lines.pop_front_if(|(when, _)| is_due(when))?;
        if line.command.takes_time() {
            self.begun.push(line.clone());
        }
        Some(line)
    }

    /// Removes the first line whose work is over now, if any: it is over only once.
    pub(crate) fn ended(&mut self, is_it: impl Fn(&Command) -> bool) -> Option<Line> {
        let at = self.begun.iter().position(|line| is_it(&line.command))?;
        Some(self.begun.remove(at))
    }

    /// Drops all commands not yet played.
    pub(crate) fn stop(&mut self) {
        self.lines.clear();
    }

    pub(crate) fn is_over(&self) -> bool {
        self.lines.is_empty()
    }

    /// The next line, if it waits for the final picture.
    pub(crate) fn waiting(&self) -> Option<&Line> {
        self.lines.front().filter(|(when, _)| *when == When::Settled).map(|(_, line)| line)
    }

    /// Appends a command to play once the picture is final.
    pub(crate) fn then(&mut self, command: Command) {
        self.lines.push_back((When::Settled, Line { number: 0, command }));
    }

    /// Repeats a command in progress, before all others, once the picture is final.
    pub(crate) fn again(&mut self, command: Command) {
        let line = self.ended(|begun| *begun == command).unwrap_or(Line { number: 0, command });
        self.lines.push_front((When::Settled, line));
    }
}

impl FromStr for Script {
    type Err = String;

    /// Parses a script. The error names the line.
    fn from_str(text: &str) -> Result<Self, String> {
        let lines =
            text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.trim().starts_with('#'));
        let parsed = lines.map(|(number, line)| {
            let named = |problem: String| format!("line {}: {problem}", number + 1);
            let (when, command) = line.trim().split_once(' ').unwrap_or((line.trim(), ""));
            let seconds = || when.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
            let when = match when {
                "settled" => When::Settled,
                _ => When::At(
                    seconds()
                        .ok_or_else(|| named(format!("'{when}': expected seconds or 'settled', then a command")))?,
                ),
            };
            Ok((when, Line { number: number + 1, command: command.parse().map_err(named)? }))
        });
        Ok(Self { lines: parsed.collect::<Result<_, String>>()?, begun: Vec::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_come_at_their_times_and_in_order() {
        let mut script: Script = "# a tour\n0.5 set mode mip\nsettled undo\n\n0.2 quit\n".parse().unwrap();
        let at = Duration::from_secs_f64;
        let line = |number, command| Some(Line { number, command });
        assert_eq!(script.next(at(0.4), true), None);
        assert_eq!(script.next(at(0.5), false), line(2, Command::set("mode", "mip")));
        assert_eq!(script.next(at(9.0), false), None, "nothing overtakes a line that waits");
        assert_eq!(script.next(at(9.0), true), line(3, Command::Undo));
        assert!(!script.is_over());
        assert_eq!((script.next(at(9.0), false), script.is_over()), (line(5, Command::Quit), true));
    }

    #[test]
    fn what_takes_time_is_known_until_it_is_over() {
        let mut script: Script = "0 export a.npy\n0 set mode mip\n0 export b.npy\n0 quit".parse().unwrap();
        while script.next(Duration::ZERO, true).is_some() {}
        let mut exported = || script.ended(|command| matches!(command, Command::Export(..)));
        let first = exported().expect("the first export");
        assert_eq!(first.failure("there is no room"), "the script's line 1: export a.npy: there is no room");
        assert_eq!(first.failure("a.npy: no room"), "the script's line 1: a.npy: no room", "a file is named once");
        assert_eq!((exported().map(|line| line.number), exported()), (Some(3), None));
    }

    #[test]
    fn a_line_that_is_wrong_is_named() {
        for (text, expected) in [
            ("0 quit\nsoon quit", "line 2: 'soon'"),
            ("-1 quit", "line 1"),
            ("0 quitt", "did you mean 'quit'"),
            ("0", "line 1"),
        ] {
            let error = text.parse::<Script>().unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
