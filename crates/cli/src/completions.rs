//! `brickyard completions`: a script for a shell to complete the command line.

use super::{Arguments, Failure, print_line};
use clap::{Args, CommandFactory};
use clap_complete::Shell;

/// `brickyard completions SHELL`
#[derive(Args)]
pub(crate) struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Runs `completions`.
///
/// # Errors
/// If standard output cannot be written.
pub(crate) fn run(arguments: &CompletionsArguments) -> Result<(), Failure> {
    print_line(script(arguments.shell).trim_end())
}

fn script(shell: Shell) -> String {
    // Written to memory first: the generator panics on a closed pipe.
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "brickyard", &mut script);
    String::from_utf8_lossy(&script).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;
    use std::io::Write;
    use std::process::{Command, Stdio};

    #[test]
    fn every_shell_completes_every_command() {
        let command = Arguments::command();
        for shell in Shell::value_variants() {
            let script = script(*shell);
            let missing: Vec<_> =
                command.get_subcommands().map(clap::Command::get_name).filter(|name| !script.contains(name)).collect();
            assert!(missing.is_empty(), "{shell}: {missing:?}");
        }
    }

    #[test]
    fn bash_accepts_its_script() {
        let Ok(mut bash) = Command::new("bash").args(["-n", "/dev/stdin"]).stdin(Stdio::piped()).spawn() else {
            return;
        };
        let text = script(Shell::Bash);
        bash.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        assert!(bash.wait().unwrap().success());
    }
}
