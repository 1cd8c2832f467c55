//! `brickyard cache`: the user's cache folder, listed and emptied.

use super::{Failure, heading, print_json, print_line, values};
use brickyard::addresses::{self, cache_folder};
use brickyard::store::{MOST_KEPT_BYTES, clear_images, kept_images};
use brickyard::volume::counted;
use clap::{Args, Subcommand};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// `brickyard cache`
#[derive(Args)]
pub(crate) struct CacheArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Print the cache folder, and the bytes there
    Info {
        /// Print JSON
        #[arg(help_heading = heading::OUTPUT, long)]
        json: bool,
    },
    /// Delete everything there that can be fetched or made again
    Clear,
}

#[derive(Serialize)]
struct Report {
    folder: Option<PathBuf>,
    objects: u64,
    objects_bytes: u64,
    objects_most_bytes: u64,
    images: u64,
    images_bytes: u64,
    images_most_bytes: u64,
}

/// Runs `cache`.
///
/// # Errors
/// Exit code 1 if a file cannot be deleted.
pub(crate) fn run(arguments: &CacheArguments) -> Result<(), Failure> {
    let folder = cache_folder();
    match &arguments.action {
        Action::Info { json } => info(folder, *json),
        Action::Clear => folder.map_or_else(no_folder, |folder| clear(&folder)),
    }
}

fn no_folder() -> Result<(), Failure> {
    print_line("no cache folder: BRICKYARD_CACHE is empty, or HOME is not set")
}

fn info(folder: Option<PathBuf>, json: bool) -> Result<(), Failure> {
    let (objects, images) = folder.as_deref().map_or_else(Default::default, |f| (addresses::kept(f), kept_images(f)));
    let report = Report {
        objects: objects.files,
        objects_bytes: objects.bytes,
        objects_most_bytes: addresses::cache_bytes(),
        images: images.images,
        images_bytes: images.bytes,
        images_most_bytes: MOST_KEPT_BYTES,
        folder,
    };
    if json {
        return print_json(&report);
    }
    let Some(folder) = &report.folder else { return no_folder() };
    let [objects, most_objects, images, most_images] =
        [report.objects_bytes, report.objects_most_bytes, report.images_bytes, MOST_KEPT_BYTES]
            .map(values::human_bytes);
    print_line(&format!("folder   {}", folder.display()))?;
    print_line(&format!(
        "fetched  {objects} of at most {most_objects}: {} of objects at addresses",
        counted(report.objects, "part")
    ))?;
    print_line(&format!(
        "made     {images} of at most {most_images}: statistics and levels of {}",
        counted(report.images, "image")
    ))
}

fn clear(folder: &Path) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::failed(format!("{}: {error}", folder.display()));
    let bytes = addresses::clear(folder).map_err(failed)?.bytes + clear_images(folder).map_err(failed)?.bytes;
    print_line(&format!("{}: {} deleted", folder.display(), values::human_bytes(bytes)))
}
