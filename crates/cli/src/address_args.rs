//! Flags for stores at addresses, by the names of AWS's tools, and addresses of files on disk.

use crate::{Command, heading, values};
use brickyard::addresses;
use brickyard::volume::counted;
use std::ffi::OsString;
use std::path::Path;

/// How buckets are reached.
#[derive(clap::Args)]
pub(crate) struct AddressArguments {
    /// Server of `s3://` addresses, as https://HOST [default: AWS's]
    #[arg(help_heading = heading::ADDRESSES, long, global = true, value_name = "URL")]
    endpoint: Option<String>,
    /// Region of `s3://` buckets [default: the environment's, or us-east-1]
    #[arg(help_heading = heading::ADDRESSES, long, global = true, value_name = "NAME")]
    region: Option<String>,
    /// Read buckets without credentials even if the environment has some
    #[arg(help_heading = heading::ADDRESSES, long, global = true)]
    no_sign_request: bool,
    /// Most disk space for what was fetched, of all addresses; 0 for none [default: 10GiB; none for 'pack' and 'append',
    /// which read all once; 'verify' always asks the server]
    #[arg(help_heading = heading::ADDRESSES, long, global = true, value_name = "SIZE", value_parser = cache_bytes)]
    cache: Option<u64>,
}

/// Reads a byte count, or 0.
fn cache_bytes(text: &str) -> Result<u64, String> {
    if text == "0" { Ok(0) } else { values::bytes(text) }
}

impl AddressArguments {
    /// Applies the flags to all addresses of this process.
    pub(crate) fn configure(self, command: &Command) {
        let Self { endpoint, region, no_sign_request, cache } = self;
        let cache_bytes = match command {
            Command::Verify(_) => 0,
            Command::Pack(_) | Command::Append(_) => cache.unwrap_or(0),
            _ => cache.unwrap_or(addresses::DEFAULT_CACHE_BYTES),
        };
        addresses::configure(addresses::Settings {
            endpoint,
            region,
            no_sign_request,
            cache_bytes,
            ..Default::default()
        });
    }
}

/// Says so if something shown was not confirmed by its server.
pub(crate) fn tell_unconfirmed() {
    let traffic = addresses::traffic();
    if traffic.unconfirmed > 0 {
        tracing::warn!(
            "a server could not be reached: {} are as they were when they were fetched last; check the network",
            counted(traffic.unconfirmed, "object")
        );
    }
}

/// A word of the command line, with a path in place of a `file://` address.
pub(crate) fn local(word: OsString) -> OsString {
    addresses::local_path(Path::new(&word)).into_owned().into_os_string()
}
