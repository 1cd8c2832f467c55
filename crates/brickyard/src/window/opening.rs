//! Opening any path of a user, for a window that must not wait: a store opens at once, and again whenever time steps
//! are appended to it; a file is a preview within seconds, then the store packed from it meanwhile. An [`Opening`] is
//! polled for news once a frame.
//!
//! ```text
//! store ────────────────────────────────────────────────────► store ──► store with more time steps
//! files ──► found packed in the cache ──────────────────────► store
//!       └─► preview (shown) ──► packing, beside the preview ──► store
//!                                 └─► stopped: the preview stays
//! ```

use crate::files::openable::{self, Openable, OpenableError};
use crate::files::store_place::{finished, place_in, user_folder};
use crate::session::volume_source::VolumeSource;
use crate::window::background::{self, Background, BackgroundError, Meter, PackingError};
use crate::window::following::Follower;
use crate::window::preview::{Preview, PreviewError};
use brickyard_import::{ImportError, OpenOptions, Source};
use brickyard_store::{Kind, PackOptions};
use std::path::PathBuf;
use std::sync::Arc;

/// Options for opening files other than stores.
#[derive(Clone, Debug)]
pub struct OpeningOptions {
    /// Known properties of the files.
    pub files: OpenOptions,
    /// The kind of their values; `None` is labels where the file says so, else an image.
    pub kind: Option<Kind>,
    /// Place for the packed store; `None` is one in the user's cache.
    pub store: Option<PathBuf>,
    /// The most memory for a preview in bytes, outside all sessions' budgets.
    pub preview_bytes: u64,
}

impl Default for OpeningOptions {
    fn default() -> Self {
        Self { files: OpenOptions::default(), kind: None, store: None, preview_bytes: 256 << 20 }
    }
}

/// Reasons for an opening to stop.
#[derive(Debug, thiserror::Error)]
pub enum OpeningError {
    /// Nothing there can be shown.
    #[error(transparent)]
    Openable(#[from] OpenableError),
    /// The files cannot be read.
    #[error(transparent)]
    Preview(#[from] PreviewError),
    /// The store has no given place, and the user has no folder for caches.
    #[error("no folder for the store: name a place for it, or set HOME")]
    NoPlace,
    /// The store could not be created. The picture stays as it is.
    #[error(transparent)]
    Packing(#[from] PackingError),
    /// A fault of this program, or a missing thread.
    #[error("{0}")]
    Fault(String),
}

impl OpeningError {
    /// Whether the files cannot be read without options from the user.
    pub fn wants_options(&self) -> bool {
        let options = |error: &ImportError| matches!(error, ImportError::Options { .. });
        match self {
            Self::Openable(OpenableError::Source(error)) | Self::Preview(PreviewError::Source(error)) => options(error),
            _ => false,
        }
    }

    /// Whether the opening was cancelled.
    pub fn is_cancelled(&self) -> bool {
        match self {
            Self::Preview(error) => matches!(error, PreviewError::Cancelled),
            Self::Packing(error) => error.is_cancelled(),
            _ => false,
        }
    }
}

impl<E: std::error::Error + Into<Self> + 'static> From<BackgroundError<E>> for OpeningError {
    fn from(error: BackgroundError<E>) -> Self {
        match error {
            BackgroundError::Failed(error) => error.into(),
            fault => Self::Fault(fault.to_string()),
        }
    }
}

/// News of an opening since the last poll.
pub enum News {
    /// The preview of the files, to be shown until their store is packed.
    Preview(VolumeSource),
    /// The store, just opened or with more time steps: show it in place of the previous volume.
    Store(VolumeSource),
    /// The opening has stopped. A shown preview can stay.
    Stopped(OpeningError),
}

/// The activity of an opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// It reads the files for the preview, or opens the store.
    Reading,
    /// It packs the files into a store.
    Packing,
    /// It waits for another program's store of the same files.
    Waiting,
    /// Nothing: the store is open, and may be followed, or the opening has stopped.
    Nothing,
}

/// The opening of one store, file or folder. Dropping it requests its work to stop, without waiting.
pub struct Opening {
    /// The volume's name: a store in the cache has a hash in its own.
    name: String,
    work: Work,
    files: Option<Files>,
    /// Reports growth of the open store.
    follower: Option<Follower>,
}

enum Work {
    Reading(Background<Found, OpeningError>),
    Packing(Background<VolumeSource, PackingError>),
    Nothing,
}

/// The kind of thing at a path.
enum Found {
    Store(Box<VolumeSource>),
    Files(Files),
}

/// Files without a store yet.
struct Files {
    source: Arc<dyn Source>,
    preview: Arc<Preview>,
    place: PathBuf,
    options: PackOptions,
}

impl Opening {
    /// Begins to open a store, a file or a folder.
    pub fn start(path: PathBuf, options: OpeningOptions) -> Self {
        let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let work = Background::start(move |meter| found(path, options, meter));
        Self { name, work: Work::Reading(work), files: None, follower: None }
    }

    /// Returns news, without waiting. Volumes take the name of the path.
    pub fn poll(&mut self) -> Option<News> {
        let news = match &mut self.work {
            Work::Nothing => News::Store(self.follower.as_ref()?.poll()?),
            Work::Reading(reading) => {
                let found = reading.poll()?;
                self.work = Work::Nothing;
                match found {
                    Ok(Found::Store(volume)) => News::Store(*volume),
                    Ok(Found::Files(files)) => self.begin_packing(files),
                    Err(error) => News::Stopped(error.into()),
                }
            }
            Work::Packing(packing) => {
                let packed = packing.poll()?;
                self.work = Work::Nothing;
                match packed {
                    Ok(volume) => {
                        self.close_preview();
                        News::Store(volume)
                    }
                    Err(error) => News::Stopped(error.into()),
                }
            }
        };
        Some(match news {
            News::Preview(volume) => News::Preview(volume.named(&self.name)),
            News::Store(volume) => {
                self.follow(&volume);
                News::Store(volume.named(&self.name))
            }
            News::Stopped(error) => News::Stopped(error),
        })
    }

    /// Follows a store, unless it is followed already.
    fn follow(&mut self, volume: &VolumeSource) {
        let Some(store) = volume.store().filter(|_| self.follower.is_none()) else { return };
        match Follower::start(store) {
            Ok(follower) => self.follower = follower,
            Err(error) => tracing::warn!("the store is not followed: {error}"),
        }
    }

    /// Follows the store with its edited metadata, opened as `volume`, instead of the one before. Returns it with the volume's name.
    pub fn reopened(&mut self, volume: VolumeSource) -> VolumeSource {
        self.follower = None;
        self.follow(&volume);
        volume.named(&self.name)
    }

    /// Whether the open store can grow, and needs polling now and then.
    pub fn is_following(&self) -> bool {
        self.follower.is_some()
    }

    fn begin_packing(&mut self, files: Files) -> News {
        let shown = files.preview.volume();
        self.files = Some(files);
        self.pack();
        match shown {
            Ok(volume) => News::Preview(volume),
            Err(error) => News::Stopped(PreviewError::from(error).into()),
        }
    }

    /// Packs the files, or continues after a stop. Does nothing without files to pack, or during a pack.
    pub fn pack(&mut self) {
        if let (Work::Nothing, Some(files)) = (&self.work, &self.files) {
            let Files { source, place, options, .. } = files;
            self.work = Work::Packing(background::pack(source.clone(), place.clone(), options.clone()));
        }
    }

    /// Requests the opening to stop; [`News::Stopped`] follows once it has.
    pub fn cancel(&self) {
        if let Some(meter) = self.meter() {
            meter.cancel();
        }
    }

    /// The present activity.
    pub fn activity(&self) -> Activity {
        match &self.work {
            Work::Reading(_) => Activity::Reading,
            Work::Packing(packing) if packing.meter().is_waiting() => Activity::Waiting,
            Work::Packing(_) => Activity::Packing,
            Work::Nothing => Activity::Nothing,
        }
    }

    /// Bytes done of the present activity, and bytes in all; the latter are 0 until known.
    pub fn progress(&self) -> (u64, u64) {
        self.meter().map_or((0, 0), Meter::progress)
    }

    /// Takes the messages for the user about the files since the last call.
    pub fn take_said(&self) -> Vec<String> {
        self.meter().map_or_else(Vec::new, Meter::take_said)
    }

    fn meter(&self) -> Option<&Meter> {
        match &self.work {
            Work::Reading(reading) => Some(reading.meter()),
            Work::Packing(packing) => Some(packing.meter()),
            Work::Nothing => None,
        }
    }

    fn close_preview(&self) {
        if let Some(files) = &self.files {
            files.preview.close();
        }
    }
}

impl Drop for Opening {
    fn drop(&mut self) {
        self.close_preview();
    }
}

/// Opens the path, and reads the preview of files not packed yet.
fn found(path: PathBuf, options: OpeningOptions, meter: &Meter) -> Result<Found, OpeningError> {
    let inputs = std::slice::from_ref(&path);
    let are_labels = options.kind.map(|kind| kind == Kind::Labels);
    let files = OpenOptions { are_labels, ..options.files };
    let source = match openable::open(inputs, &files)? {
        Openable::Store(volume) => return Ok(Found::Store(volume)),
        Openable::Source(source) => source,
    };
    let kind = options.kind.unwrap_or(Kind::said_by(source.info()));
    let pack_options = openable::pack_options(source.info().voxel_type, kind);
    let place = match options.store {
        Some(place) => place,
        None => place_in(&user_folder().ok_or(OpeningError::NoPlace)?, &path, &*source, &pack_options),
    };
    if let Some(volume) = finished(&place, &*source, &pack_options) {
        return Ok(Found::Store(Box::new(volume)));
    }
    let preview = Preview::read(source.clone(), kind, options.preview_bytes, meter)?;
    Ok(Found::Files(Files { source, preview: Arc::new(preview), place, options: pack_options }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Extent, VoxelType};
    use std::path::Path;

    /// Writes a raw file of 300 x 40 x 30 voxels, and returns options to open it.
    fn raw_file(folder: &Path) -> (PathBuf, OpeningOptions) {
        let path = folder.join("scan.raw");
        std::fs::write(&path, (0..300 * 40 * 30u32).map(|i| (i % 251) as u8).collect::<Vec<u8>>()).unwrap();
        let files = OpenOptions {
            shape: Some(Extent::new(300, 40, 30)),
            voxel_type: Some(VoxelType::U8.into()),
            ..OpenOptions::default()
        };
        (path, OpeningOptions { files, store: Some(folder.join("stores/scan-1f2e.zarr")), ..OpeningOptions::default() })
    }

    fn next(opening: &mut Opening) -> News {
        loop {
            if let Some(news) = opening.poll() {
                return news;
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn a_file_is_a_preview_and_then_a_store_and_then_found_packed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, options) = raw_file(folder.path());
        let mut opening = Opening::start(path.clone(), options.clone());
        let News::Preview(preview) = next(&mut opening) else { panic!("no preview") };
        assert_eq!(preview.source.pyramid().levels()[0].extent, Extent::new(150, 40, 30));
        let News::Store(volume) = next(&mut opening) else { panic!("no store") };
        assert_eq!(volume.source.pyramid().levels()[0].extent, Extent::new(300, 40, 30));
        assert_eq!([preview.name(), volume.name()], [Some("scan".to_owned()), Some("scan".to_owned())]);
        assert!(opening.poll().is_none() && opening.activity() == Activity::Nothing);
        let News::Store(again) = next(&mut Opening::start(path, options)) else { panic!("packed again") };
        let store = again.store().expect("a store").path().to_owned();
        // The store itself opens, whatever the options for files.
        assert!(matches!(next(&mut Opening::start(store, OpeningOptions::default())), News::Store(_)));
    }

    #[test]
    fn a_cancelled_pack_leaves_the_preview_and_goes_on_later() {
        let folder = tempfile::tempdir().unwrap();
        let (path, options) = raw_file(folder.path());
        let mut opening = Opening::start(path, options);
        let News::Preview(preview) = next(&mut opening) else { panic!("no preview") };
        opening.cancel();
        match next(&mut opening) {
            News::Stopped(error) => assert!(error.is_cancelled(), "{error}"),
            // Too fast: there was nothing left to cancel.
            News::Store(_) => return,
            News::Preview(_) => panic!("a second preview"),
        }
        let mut core = vec![0; 64 * 64 * 64];
        let id = brickyard_volume::BrickId {
            time: 0,
            channel: 0,
            level: brickyard_volume::Level(0),
            index: Default::default(),
        };
        preview.source.read_core(id, &mut core).unwrap();
        opening.pack();
        assert!(matches!(next(&mut opening), News::Store(_)));
    }

    #[test]
    fn what_cannot_be_opened_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = raw_file(folder.path());
        let News::Stopped(error) = next(&mut Opening::start(path.clone(), OpeningOptions::default())) else {
            panic!("it opened")
        };
        assert!(error.wants_options(), "{error}");
        assert!(error.to_string().contains("pass `shape`"), "{error}");
        // A file is in the way of the store's folder; the preview comes all the same.
        let (path, options) = raw_file(folder.path());
        let options = OpeningOptions { store: Some(path.join("scan.zarr")), ..options };
        let mut opening = Opening::start(path, options);
        assert!(matches!(next(&mut opening), News::Preview(_)));
        let News::Stopped(error) = next(&mut opening) else { panic!("it was packed") };
        assert!(error.to_string().contains("scan.raw: "), "{error}");
    }
}
