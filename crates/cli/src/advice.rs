//! Advice for the command line, appended to the library's messages: the flag against an error of a session or a
//! picture, and flags in place of the library's option names.

use brickyard::backend::BackendError;
use brickyard::exact::ExactPictureError;
use brickyard::offline::OfflineError;
use brickyard::oracle::OracleError;
use brickyard::pager::{ExactError, PagerError};
use brickyard::render::GpuError;
use brickyard::session::SessionError;
use brickyard::software::SoftwareError;
use brickyard_measure::survey::SurveyError;
use std::error::Error;

/// Returns the error's message, with advice where a flag helps.
pub(super) fn advised<E: Advice>(error: &E) -> String {
    match error.advice() {
        Some(advice) => format!("{error}; {advice}"),
        None => error.to_string(),
    }
}

/// The library's options whose flags have the same names.
const ALIKE: &str = "allow_lossy aprons axes channel channel_bytes channels codec component downsample flip gaps kind level memory name \
    ngff nodata offset order origin overwrite resume roi shape spacing step_bytes take_channel take_time time time_stamps \
    time_step time_unit times unit value_unit variable";

/// The library's other options, with the command's flags for them.
const RENAMED: [(&str, &str); 8] = [
    ("edge", "--brick"),
    ("scratch_dir", "--scratch"),
    ("shard_edge", "--shard"),
    ("shard_times", "--shard-time"),
    ("stamp", "--time"),
    ("threads", "-j"),
    ("to_voxel_type", "--to-dtype"),
    ("voxel_type", "--dtype"),
];

/// The library's options as named in its messages, with the command's flags for them.
fn flags() -> impl Iterator<Item = (String, String)> {
    let alike = ALIKE.split(' ').map(|option| (option, format!("--{}", option.replace('_', "-"))));
    let renamed = RENAMED.iter().map(|(option, flag)| (*option, flag.to_string()));
    alike.chain(renamed).map(|(option, flag)| (format!("`{option}`"), flag))
}

/// Replaces the options named in a message by flags.
pub(super) fn with_flags(message: &str) -> String {
    flags().fold(message.to_string(), |message, (option, flag)| message.replace(&option, &flag))
}

const MORE_GPU_MEMORY: &str = "raise --gpu-memory, or make the picture smaller";
const MORE_SLOTS: &str = "raise --gpu-memory (--cpu-memory if the CPU draws), or make the picture smaller";
const MORE_HOST_MEMORY: &str = "raise --host-memory";
const MORE_TIME: &str = "give it more time with --max-wait";

/// An error with possible advice.
pub(super) trait Advice: Error {
    /// The remedy, in terms of the command.
    fn advice(&self) -> Option<&'static str>;
}

impl Advice for GpuError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::NoAdapter { .. } => Some("or use --backend cpu"),
            Self::Budget { .. } => Some(MORE_GPU_MEMORY),
            Self::Meshes { .. } | Self::Textures { .. } => Some("--backend cpu does that"),
            Self::OutOfMemory { .. } => Some("lower --gpu-memory"),
            _ => None,
        }
    }
}

impl Advice for BackendError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Gpu(error) => error.advice(),
            Self::Cpu(SoftwareError::Budget { .. }) => Some("raise --cpu-memory"),
            Self::Cpu(_) => None,
            Self::CpuCompositor(_) => Some("use --compositor raycast, or --backend gpu"),
        }
    }
}

impl Advice for PagerError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::HostMemory { .. } => Some(MORE_HOST_MEMORY),
            Self::Slots { .. } => Some(MORE_SLOTS),
            _ => None,
        }
    }
}

impl Advice for SessionError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Backend(error) => error.advice(),
            Self::Pager(error) => error.advice(),
            Self::LostAgain { .. } => Some("try --backend cpu"),
            Self::NoOrder => Some("use --compositor raycast or compute"),
            Self::Precision { backend: "a GPU", .. } => Some("use --backend cpu"),
            Self::Precision { .. } => Some("pack labels with --kind labels"),
            _ => None,
        }
    }
}

impl Advice for OfflineError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Session(error) => error.advice(),
            Self::Pixel { .. } => Some(
                "raise --gpu-memory (--cpu-memory if the CPU draws), or draw one volume in passes: --backend gpu --compositor sorted",
            ),
            Self::NotSettled { .. } | Self::NotDrawn { .. } => Some(MORE_TIME),
        }
    }
}

impl Advice for ExactPictureError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Way => Some("use --backend gpu or auto, --compositor sorted or auto"),
            Self::Mixed => Some("leave --exact out, or give one store"),
            Self::Backend(error) => error.advice(),
            Self::Passes(ExactError::Budget(error)) => error.advice(),
            Self::Passes(ExactError::TooManyCells { .. }) => Some("raise --host-memory, or --pixel-error"),
            Self::Passes(ExactError::Unreadable(_)) => None,
            Self::TooLong { .. } => Some(MORE_TIME),
        }
    }
}

impl Advice for OracleError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::TooLarge { .. } => Some("lock a coarser --level, or raise --host-memory"),
            Self::TooLong { .. } => Some(MORE_TIME),
            Self::Read(_) => None,
        }
    }
}

impl Advice for SurveyError {
    fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Picture(error) => error.advice(),
            Self::Coarse { .. } => Some("raise --gpu-memory (--cpu-memory if the CPU draws), or show less with --clip"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    /// Options named in messages must be flags of the commands where they are given.
    #[test]
    fn the_flags_that_messages_name_are_there() {
        let command = crate::Arguments::command();
        let commands = ["pack", "append", "export"].map(|name| command.find_subcommand(name).expect("a subcommand"));
        for (option, flag) in flags() {
            let is_it = |argument: &clap::Arg| match flag.strip_prefix("--") {
                Some(long) => argument.get_long() == Some(long),
                None => argument.get_short() == flag.chars().nth(1),
            };
            let is_there = commands.iter().any(|command| command.get_arguments().any(is_it));
            assert!(is_there, "{option}: neither pack nor export has {flag}");
            assert_eq!(with_flags(&format!("pass {option} 3")), format!("pass {flag} 3"));
        }
    }
}
