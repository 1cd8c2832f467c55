//! `brickyard man`: manual pages, one for the command and one for each of its subcommands.

use super::output::{make_folder, may_write};
use super::say::say;
use super::{Arguments, Failure, heading};
use brickyard::text_file::write_text;
use brickyard::volume::counted;
use clap::{Args, Command, CommandFactory};
use clap_mangen::Man;
use std::path::PathBuf;

/// `brickyard man FOLDER`
#[derive(Args)]
pub(crate) struct ManArguments {
    /// The folder for the pages brickyard.1, brickyard-pack.1 and so on; created if missing
    folder: PathBuf,
    /// Replace existing pages
    #[arg(help_heading = heading::OUTPUT, long)]
    overwrite: bool,
}

/// Runs `man`.
///
/// # Errors
/// Exit code 2, before any page is written, if a page exists and may not be replaced. Exit code 1 if a page cannot be
/// written.
pub(crate) fn run(arguments: &ManArguments) -> Result<(), Failure> {
    let folder = &arguments.folder;
    let pages = pages(Arguments::command())?;
    pages.iter().try_for_each(|(name, _)| may_write(&folder.join(name), arguments.overwrite))?;
    make_folder(folder)?;
    for (name, roff) in &pages {
        write_text(&folder.join(name), roff).map_err(Failure::failed)?;
    }
    say!("{}: {}", folder.display(), counted(pages.len() as u64, "page"));
    Ok(())
}

/// The names of the pages, each with its text as roff.
fn pages(command: Command) -> Result<Vec<(String, String)>, Failure> {
    let mut command = command.disable_help_subcommand(true);
    // Gives the subcommands the common flags, and the names of their pages.
    command.build();
    let subcommands: Vec<Command> = command.get_subcommands().cloned().collect();
    let page = |command: Command| {
        let (page, mut roff) = (Man::new(command), Vec::new());
        page.render(&mut roff).map_err(Failure::failed)?;
        Ok((page.get_filename(), String::from_utf8(roff).map_err(Failure::failed)?))
    };
    std::iter::once(command).chain(subcommands).map(page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a page's text without the backslashes against breaks at hyphens.
    fn text((_, roff): &(String, String)) -> String {
        roff.replace('\\', "")
    }

    #[test]
    fn a_page_names_every_flag_of_its_command() {
        let mut command = Arguments::command();
        command.build();
        let pages = pages(Arguments::command()).unwrap();
        assert_eq!(pages[0].0, "brickyard.1");
        for command in command.get_subcommands().filter(|command| command.get_name() != "help") {
            let page = pages.iter().find(|(name, _)| *name == format!("brickyard-{}.1", command.get_name())).unwrap();
            let text = text(page);
            let shown = command.get_arguments().filter(|flag| !flag.is_hide_set());
            for flag in shown.filter_map(clap::Arg::get_long) {
                assert!(text.contains(&format!("--{flag}")), "{}: --{flag}", page.0);
            }
            assert!(self::text(&pages[0]).contains(page.0.trim_end_matches(".1")), "{}", page.0);
        }
    }

    #[test]
    fn pages_that_are_there_are_replaced_only_if_told() {
        let folder = tempfile::tempdir().unwrap();
        let pages = folder.path().join("share/man1");
        let write = |overwrite| run(&ManArguments { folder: pages.clone(), overwrite });
        write(false).unwrap();
        std::fs::write(pages.join("brickyard-pack.1"), "mine").unwrap();
        std::fs::remove_file(pages.join("brickyard.1")).unwrap();
        assert_eq!(write(false).unwrap_err().kind as u8, 2);
        assert!(!pages.join("brickyard.1").exists());
        write(true).unwrap();
        assert!(std::fs::read_to_string(pages.join("brickyard-pack.1")).unwrap().contains("codec"));
        let file = pages.join("brickyard.1");
        assert_eq!(run(&ManArguments { folder: file, overwrite: false }).unwrap_err().kind as u8, 2);
    }
}
