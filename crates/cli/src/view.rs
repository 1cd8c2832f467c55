//! `brickyard view`: a window on stores, and on files, which are packed while it shows them.

use super::input_args::InputArguments;
use super::output::may_write_file;
use super::pack_settings::KINDS;
use super::progress::{Progress, ProgressStyleArgument};
use super::sampling_args::SamplingArguments;
use super::scene_args::SceneArguments;
use super::session_args::{BACKENDS, SessionLimits};
use super::session_errors::session_failure;
use super::{Failure, heading, store_errors, values};
use brickyard::backend::BackendChoice;
use brickyard::background;
use brickyard::import::stream_among;
use brickyard::openable::OpenableError;
use brickyard::opening::{OpeningError, OpeningOptions};
use brickyard::preview::PreviewError;
use brickyard::session::{SessionOptions, check};
use brickyard::store::Kind;
use brickyard::text_file::read_text;
use brickyard_viewer::{Openings, Script, WindowOptions};
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// `brickyard view PATH...`
#[derive(Args)]
pub(crate) struct ViewArguments {
    /// A store, a file, or a folder of TIFF planes or DICOM slices; or several, up to 32, each in its own world or
    /// placed by --volume N:matrix=... Files are shown as a preview, and packed meanwhile [default: the volumes of the
    /// scene file's window; without one an empty window]
    #[arg(value_name = "PATH")]
    stores: Vec<PathBuf>,
    #[command(flatten)]
    input: InputArguments,
    /// Meaning of the files' voxels; labels are never averaged [default: labels where the file says so, else image]
    #[arg(help_heading = heading::INPUT, long, value_parser = KINDS)]
    kind: Option<Kind>,
    /// The store to pack a file into [default: one in the user's cache, reused the next time]
    #[arg(help_heading = heading::WORK, long, value_name = "STORE")]
    store: Option<PathBuf>,
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// Size of the window in points
    #[arg(help_heading = heading::WINDOW, long, value_name = "WxH", default_value = "1280x800", value_parser = values::size_px)]
    size: (u32, u32),
    /// Where to render; auto is a hardware GPU if the window is on one, else the CPU
    #[arg(help_heading = heading::DRAWING, long, value_parser = BACKENDS, default_value = "auto")]
    backend: BackendChoice,
    #[command(flatten)]
    limits: SessionLimits,
    /// Do not restore the last window on these stores
    #[arg(help_heading = heading::WINDOW, long)]
    fresh: bool,
    /// Play commands: lines of `SECONDS COMMAND` or `settled COMMAND`
    #[arg(help_heading = heading::WINDOW, long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Write the window's contents once the script has ended and the picture is final, and close it
    #[arg(help_heading = heading::OUTPUT, long, value_name = "out.png")]
    screenshot: Option<PathBuf>,
    /// Write frame times of the window, as JSON, when it is closed
    #[arg(help_heading = heading::OUTPUT, long, value_name = "stats.json")]
    stats: Option<PathBuf>,
}

/// Whether any flag of the scene is given. Such a window does not restore the last one.
fn has_scene(matches: &ArgMatches) -> bool {
    let flags = SamplingArguments::augment_args(SceneArguments::augment_args(Command::new("scene")));
    let mut ids = flags.get_arguments().map(|flag| flag.get_id().as_str());
    ids.any(|id| matches.value_source(id) == Some(ValueSource::CommandLine))
}

/// Runs `view`; `matches` are those of its arguments.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: ViewArguments, matches: Option<&ArgMatches>) -> Result<(), Failure> {
    let begun = Instant::now();
    let has_scene = matches.is_some_and(has_scene);
    let script = match &arguments.script {
        None => Script::default(),
        Some(path) => {
            let text = read_text(path).map_err(Failure::bad_input)?;
            text.parse().map_err(|problem| Failure::bad_input(format!("{}: {problem}", path.display())))?
        }
    };
    let mut paths = arguments.stores;
    let files = arguments.input.options(&mut paths)?;
    let paths = match arguments.scene.file() {
        Some(file) if paths.is_empty() => named_volumes(file)?,
        _ => paths,
    };
    if let Some(stream) = stream_among(&paths, &files.channel_arrays) {
        let (path, problem) =
            (stream.display(), "a stream is read once, a window reads again: pack it first, then view its store");
        return Err(Failure::usage(format!("{path}: {problem}")));
    }
    if paths.is_empty() && has_scene {
        return Err(Failure::usage("these flags describe how volumes are shown: name the volumes, too"));
    }
    // Previews are within the limit, and leave most of it.
    let preview_bytes =
        OpeningOptions::default().preview_bytes.min(arguments.limits.host_memory / 4 / paths.len().max(1) as u64);
    let options = OpeningOptions { files, kind: arguments.kind, store: arguments.store, preview_bytes };
    let openings = opened(paths, options)?;
    let volumes = openings.volumes();
    let mut scene = arguments.scene.scene_of_one_step(&volumes, arguments.size)?;
    arguments.scene.set_first_look(&mut scene, &volumes);
    let scene = arguments.sampling.of(scene);
    let session = SessionOptions { backend: arguments.backend, live: true, ..arguments.limits.options() };
    if !volumes.is_empty() {
        check(&volumes, &scene).map_err(|error| session_failure(error.into()))?;
    }
    if let Some(path) = &arguments.stats {
        may_write_file(path, true)?;
    }
    let size = [arguments.size.0 as f32, arguments.size.1 as f32];
    let options = WindowOptions {
        scene,
        scene_file: arguments.scene.file().map(Path::to_path_buf),
        restores: !(arguments.fresh || has_scene),
        session,
        size,
        script,
        screenshot: arguments.screenshot,
        opened: begun,
        stats: arguments.stats,
    };
    let ended = brickyard_viewer::run(openings, options).map_err(Failure::failed);
    // A file still being read is left where it is; an export deletes its unfinished file.
    background::wait_for_all(Duration::from_secs(2));
    ended
}

fn named_volumes(file: &Path) -> Result<Vec<PathBuf>, Failure> {
    let volumes = brickyard_viewer::volumes_of(file).map_err(Failure::bad_input)?;
    if volumes.is_empty() {
        return Err(Failure::usage(format!("{} names no volumes: name them on the command line", file.display())));
    }
    Ok(volumes)
}

/// Opens stores, and the previews of files.
fn opened(paths: Vec<PathBuf>, options: OpeningOptions) -> Result<Openings, Failure> {
    if options.store.is_some() && paths.len() != 1 {
        return Err(Failure::usage("--store is the store of one file: open each file by itself"));
    }
    let mut openings = Openings::start(paths, options);
    let progress = Progress::new(ProgressStyleArgument::Auto, "preview");
    let shown = Cell::new(0);
    let waited = openings.wait(|done, total| {
        if shown.replace(done) != done {
            progress.set(done, total);
        }
    });
    progress.finish();
    waited.map_err(|error| opening_failure(&error))?;
    Ok(openings)
}

fn opening_failure(error: &OpeningError) -> Failure {
    match error {
        OpeningError::Openable(OpenableError::Store(error)) => store_errors::open_failure(error),
        OpeningError::Openable(OpenableError::Source(error)) | OpeningError::Preview(PreviewError::Source(error)) => {
            store_errors::import_failure(error)
        }
        OpeningError::NoPlace => Failure::usage(error),
        _ => Failure::failed(error),
    }
}
