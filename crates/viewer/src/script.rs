//! Scripts: commands with the times at which they are played, for tests, documentation and tutorials. A line is `SECONDS COMMAND`, counted from the
//! window's first frame, or `settled COMMAND`, which waits until the picture is final. Lines are played in order; `#` begins a remark.

use crate::command::Command;
use std::collections::VecDeque;
use std::str::FromStr;
use std::time::Duration;

/// Commands that are to be played.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    lines: VecDeque<(When, Command)>,
}

/// When a command is played.
#[derive(Clone, Copy, Debug, PartialEq)]
enum When {
    /// So long after the window's first frame, and after the lines before.
    At(Duration),
    /// Once the picture is final.
    Settled,
}

impl Script {
    /// The next command that is due, which is removed. `since_start` is the time since the window's first frame.
    pub(crate) fn next(&mut self, since_start: Duration, is_settled: bool) -> Option<Command> {
        let is_due = |when: &When| match when {
            When::At(time) => *time <= since_start,
            When::Settled => is_settled,
        };
        let line = self.lines.pop_front_if(|(when, _)| is_due(when))?;
        Some(line.1)
    }

    /// Whether everything has been played.
    pub(crate) fn is_over(&self) -> bool {
        self.lines.is_empty()
    }

    /// Adds a command that is played once the picture is final.
    pub(crate) fn then(&mut self, command: Command) {
        self.lines.push_back((When::Settled, command));
    }

    /// Plays a command before all others, once the picture is final.
    pub(crate) fn first(&mut self, command: Command) {
        self.lines.push_front((When::Settled, command));
    }
}

impl FromStr for Script {
    type Err = String;

    /// Reads a script. The error names the line.
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
            Ok((when, command.parse().map_err(named)?))
        });
        Ok(Self { lines: parsed.collect::<Result<_, String>>()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_come_at_their_times_and_in_order() {
        let mut script: Script = "# a tour\n0.5 set mode mip\nsettled undo\n\n0.2 quit\n".parse().unwrap();
        let at = Duration::from_secs_f64;
        assert_eq!(script.next(at(0.4), true), None);
        assert_eq!(script.next(at(0.5), false).map(|command| command.to_string()), Some(r#"set mode "mip""#.into()));
        assert_eq!(script.next(at(9.0), false), None, "nothing overtakes a line that waits");
        assert_eq!(script.next(at(9.0), true), Some(Command::Undo));
        assert!(!script.is_over());
        assert_eq!((script.next(at(9.0), false), script.is_over()), (Some(Command::Quit), true));
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
