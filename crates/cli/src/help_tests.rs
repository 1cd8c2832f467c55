//! The help of the flags of every command.

use super::Arguments;
use brickyard::volume::Scene;
use clap::{Arg, Command, CommandFactory};

/// Flags without a default: without them nothing more is done, or they belong to one kind of input or output.
const WITHOUT_DEFAULT: [&str; 20] = [
    "--clip",
    "--clip-plane",
    "--dtype",
    "--expr",
    "--gradient-opacity",
    "--isovalue",
    "--label",
    "--mesh",
    "--movie",
    "--orbit",
    "--output",
    "--path",
    "--plot",
    "--scene",
    "--screenshot",
    "--script",
    "--shape",
    "--stats",
    "--stereo",
    "--volume",
];

/// Returns every shown flag of every command, except help and version, with the command's name.
fn flags(command: &Command) -> Vec<(String, &Arg)> {
    let own = command.get_arguments().filter(|flag| !flag.is_positional());
    let own = own.filter(|flag| !flag.is_hide_set() && !["help", "version"].contains(&flag.get_id().as_str()));
    let own = own.map(|flag| (command.get_name().to_owned(), flag));
    own.chain(command.get_subcommands().flat_map(flags)).collect()
}

fn built() -> Command {
    let mut command = Arguments::command();
    command.build();
    command
}

fn name(flag: &Arg) -> String {
    format!("--{}", flag.get_long().expect("every flag has a long name"))
}

#[test]
fn every_flag_stands_under_a_heading() {
    let command = built();
    let bare = flags(&command).into_iter().filter(|(_, flag)| flag.get_help_heading().is_none());
    let bare: Vec<_> = bare.map(|(command, flag)| format!("{command} {}", name(flag))).collect();
    assert!(bare.is_empty(), "{bare:?}");
}

/// The effect of a missing flag is in the parser's default, or in words.
#[test]
fn every_flag_says_what_happens_without_it() {
    let command = built();
    let says_it = |flag: &Arg| {
        let help = flag.get_long_help().or(flag.get_help()).map_or(String::new(), |help| help.to_string());
        !flag.get_default_values().is_empty() || help.contains("[default: ")
    };
    let with_value = flags(&command).into_iter().filter(|(_, flag)| flag.get_action().takes_values());
    let silent = with_value.filter(|(_, flag)| !flag.is_required_set() && !says_it(flag));
    let silent: Vec<_> = silent.map(|(command, flag)| (command, name(flag))).collect();
    let unlisted: Vec<_> = silent.iter().filter(|(_, flag)| !WITHOUT_DEFAULT.contains(&flag.as_str())).collect();
    assert!(unlisted.is_empty(), "{unlisted:?}");
}

/// The page about the command shows a scene file with all of its fields.
#[test]
fn the_scene_on_the_page_is_the_default() {
    let page = include_str!("../../../docs/guide/command.md");
    let (_, after) = page.split_once("```json\n").expect("a scene");
    let (text, _) = after.split_once("```").expect("its end");
    let shown: serde_json::Value = serde_json::from_str(text).unwrap();
    let default = serde_json::to_value(Scene::default()).unwrap();
    let mut fields: Vec<_> = default.as_object().unwrap().keys().filter(|field| shown.get(field).is_none()).collect();
    assert!(fields.is_empty(), "{fields:?}");
    assert_eq!(serde_json::from_value::<Scene>(shown).unwrap(), Scene::default());
    // Each has a row, too.
    fields = default.as_object().unwrap().keys().filter(|field| !page.contains(&format!("\n| `{field}"))).collect();
    assert!(fields.is_empty(), "{fields:?}");
}
