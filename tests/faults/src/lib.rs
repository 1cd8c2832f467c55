//! A library for `LD_PRELOAD` that stands between a program and the file system: calls on files below one folder fail, are
//! cut short, delayed or recorded, as the environment says. Everything else passes untouched.
//!
//! | variable | holds |
//! | --- | --- |
//! | `BRICKYARD_FAULTS_UNDER` | the folder, absolute, without links in its path |
//! | `BRICKYARD_FAULTS` | rules, separated by `;`: see `rules.rs` |
//! | `BRICKYARD_FAULTS_LOG` | a file outside of the folder, to which each call is recorded: see `record.rs` |
//!
//! Only programs that call libc through its symbols are reached, as Rust's standard library does; rustix does so with its
//! feature `use-libc`. Linux, 64 bits; on other systems this library is empty.

#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod calls;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod kernel;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod record;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod rules;
