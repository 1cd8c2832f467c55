//! Help by topics: commands with more flags than fit a screen show the first of them, and the others by the headings they stand under.

use super::{Arguments, Failure, printed};
use clap::{Arg, Command, CommandFactory};

/// The most flags of a command shown without a topic.
const MOST: usize = 26;

/// The flags shown without a topic where a command has more.
const FIRST: &str = "backend channel clip color dry_run dtype exact isovalue kind lighting memory mode movie orbit \
    output overwrite repair resume roi scene scenario shape size slice spacing time transfer view \
    window";

/// The topic with all flags.
const ALL: &str = "all";

/// Prints the help of a command if that is asked for: `COMMAND --help [TOPIC]`, or `help COMMAND [TOPIC]`. Returns whether it did.
///
/// # Errors
/// Exit code 2 for an unknown topic, 1 if standard output cannot be written.
pub(crate) fn print(arguments: &[String]) -> Result<bool, Failure> {
    // Building all commands takes longer than this look.
    if !arguments.iter().any(|word| ["-h", "--help", "help"].contains(&word.as_str())) {
        return Ok(false);
    }
    let mut root = Arguments::command();
    root.build();
    let Some((name, topic)) = asked(&root, arguments) else { return Ok(false) };
    let Some(command) = root.find_subcommand(name) else { return Ok(false) };
    let mut help = Help::of(command, topic)?;
    let written = if help.is_long { help.command.print_long_help() } else { help.command.print_help() };
    printed(written).map(|()| true)
}

/// A command with the flags to show.
struct Help {
    command: Command,
    is_long: bool,
}

/// The command and the topic that the arguments ask for help about.
fn asked<'a>(root: &Command, arguments: &'a [String]) -> Option<(&'a str, Option<&'a str>)> {
    let is_command = |word: &&String| root.find_subcommand(word.as_str()).is_some() && *word != "help";
    let word = |at: usize| arguments.get(at).map(String::as_str).filter(|word| !word.starts_with('-'));
    let first = arguments.iter().position(|word| !word.starts_with('-'))?;
    if arguments[first] == "help" {
        let name = arguments.get(first + 1).filter(is_command)?;
        return Some((name, word(first + 2)));
    }
    let name = arguments.get(first).filter(is_command)?;
    let flags = arguments[first..].iter().take_while(|word| *word != "--");
    let asked = flags.into_iter().position(|word| word == "-h" || word == "--help")?;
    Some((name, word(first + asked + 1)))
}

impl Help {
    /// The help of a command: its first flags, or in full those of a topic.
    ///
    /// # Errors
    /// Exit code 2 for an unknown topic.
    fn of(command: &Command, topic: Option<&str>) -> Result<Self, Failure> {
        let (name, command, topics) = (command.get_name(), command.clone(), topics(command));
        let Some(topic) = topic else {
            let flags = command.get_arguments().filter(|flag| !flag.is_positional()).count();
            let command = if flags > MOST { first(command, &topics) } else { command };
            return Ok(Self { command, is_long: false });
        };
        if topic == ALL {
            return Ok(Self { command, is_long: true });
        }
        if !topics.iter().any(|known| known == topic) {
            let topics = topics.join(", ");
            return Err(Failure::usage(format!("{name} --help {topic}: expected one of {topics} or {ALL}")));
        }
        let command = command.after_help("").mut_args(|flag| {
            let is_shown = topic_of(&flag).as_deref() == Some(topic);
            flag.hide(!is_shown)
        });
        Ok(Self { command, is_long: true })
    }
}

/// A command with its first flags alone, each in a clause, and where the others are.
fn first(command: Command, topics: &[String]) -> Command {
    let more = format!("More flags: brickyard {} --help TOPIC, of {} or {ALL}", command.get_name(), topics.join(", "));
    let examples = command.get_after_help().map(|text| format!("\n\n{text}")).unwrap_or_default();
    let command = command.mut_args(|flag| match flag.is_positional() || is_first(flag.get_id().as_str()) {
        true => briefly(flag),
        false => flag.hide(true),
    });
    command.after_help(more + &examples)
}

fn is_first(id: &str) -> bool {
    FIRST.split(' ').any(|first| first == id)
}

/// The topic of a flag: its heading.
fn topic_of(flag: &Arg) -> Option<String> {
    flag.get_help_heading().map(str::to_lowercase)
}

/// The headings of a command's flags, in order.
fn topics(command: &Command) -> Vec<String> {
    let mut topics = Vec::new();
    for topic in command.get_arguments().filter_map(topic_of) {
        if !topics.contains(&topic) {
            topics.push(topic);
        }
    }
    topics
}

/// A flag with the first clause of its help.
fn briefly(flag: Arg) -> Arg {
    let Some(help) = flag.get_help().map(ToString::to_string) else { return flag };
    let ends = [" [default", ": ", ". ", "; ", " ("].into_iter().filter_map(|end| help.find(end)).min();
    let clause = help[..ends.unwrap_or(help.len())].to_owned();
    flag.help(clause).hide_possible_values(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built() -> Command {
        let mut root = Arguments::command();
        root.build();
        root
    }

    fn words(line: &str) -> Vec<String> {
        line.split(' ').map(str::to_owned).collect()
    }

    fn text(command: &Command, topic: Option<&str>) -> String {
        let mut help = Help::of(command, topic).unwrap_or_else(|failure| panic!("{}", failure.message));
        let text = if help.is_long { help.command.render_long_help() } else { help.command.render_help() };
        text.to_string()
    }

    #[test]
    fn the_help_of_every_command_fits_a_screen() {
        for command in built().get_subcommands().filter(|command| command.get_name() != "help") {
            let lines = text(command, None).lines().count();
            assert!(lines <= 60, "{}: {lines} lines", command.get_name());
        }
    }

    #[test]
    fn every_flag_is_told_under_its_topic() {
        let root = built();
        for command in root.get_subcommands() {
            for flag in command.get_arguments().filter(|flag| !flag.is_hide_set()) {
                let (Some(topic), Some(name)) = (topic_of(flag), flag.get_long()) else { continue };
                let told = text(command, Some(&topic));
                assert!(told.contains(&format!("--{name}")), "{} --help {topic}: --{name}", command.get_name());
            }
        }
        assert!(Help::of(root.find_subcommand("render").expect("render"), Some("nothing")).is_err());
    }

    #[test]
    fn flags_shown_first_are_there() {
        let root = built();
        let of_any = |id: &str| root.get_subcommands().any(|c| c.get_arguments().any(|flag| flag.get_id() == id));
        assert!(FIRST.split(' ').all(of_any));
    }

    #[test]
    fn help_is_asked_for_with_a_topic_or_without() {
        let root = built();
        let of = |line: &str| {
            let words = words(line);
            asked(&root, &words).map(|(name, topic)| (name.to_owned(), topic.map(str::to_owned)))
        };
        let some = |name: &str, topic: Option<&str>| Some((name.to_owned(), topic.map(str::to_owned)));
        assert_eq!(of("render --help"), some("render", None));
        assert_eq!(of("-v render a.zarr -h camera"), some("render", Some("camera")));
        assert_eq!(of("help pack store"), some("pack", Some("store")));
        assert_eq!(of("render a.zarr --label x -- --help"), None);
        assert_eq!(of("--help"), None);
        assert_eq!(of("help"), None);
    }
}
