//! The `brickyard` command: one subcommand a file, each turning flags into a call of the library and errors into an exit
//! code. 0 ok, 1 failed, 2 usage, 3 bad input, 4 incomplete but resumable, 5 verification failed.

mod cli;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Without that folder Mesa's device-select layer, which this program does not need, prints an error per adapter.
        // SAFETY: no other thread exists yet that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
    let arguments = cli::Arguments::parse();
    cli::set_up_log(arguments.verbose, arguments.quiet);
    match cli::run(arguments.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {}", failure.message);
            ExitCode::from(failure.kind as u8)
        }
    }
}
