//! A library for `LD_PRELOAD` between a program and the file system: calls on files below one folder fail, are cut short,
//! delayed or recorded, as environment variables specify. Everything else passes untouched.
//!
//! | variable | holds |
//! | --- | --- |
//! | `BRICKYARD_FAULTS_UNDER` | the folder, absolute, without links in its path |
//! | `BRICKYARD_FAULTS` | rules, separated by `;`: see `rules.rs` |
//! | `BRICKYARD_FAULTS_LOG` | a file outside the folder for the record of calls: see `record.rs` |
//!
//! It reaches only programs that call libc through its symbols, like Rust's standard library, and rustix with its feature
//! `use-libc`. Linux, 64 bits; on other systems this library is empty.

#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod calls;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod kernel;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod record;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod rules;
