//! Opening whatever a user names, for a window that must not wait: a store as it is, and anew whenever time steps were appended to it; a file as a preview within
//! seconds, then as the store that is packed of it meanwhile. An [`Opening`] is asked once a frame what is new.
//!
//! ```text
//! store ────────────────────────────────────────────────────► store ──► store with more time steps
//! files ──► found packed in the cache ──────────────────────► store
//!       └─► preview (shown) ──► packing, beside what is shown ──► store
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

/// How files are opened that are no store.
#[derive(Clone, Debug)]
pub struct OpeningOptions {
    /// What is known of the files.
    pub files: OpenOptions,
    /// What their values mean.
    pub kind: Kind,
    /// Where the store is packed to; `None` is a place of its own in the user's cache.
    pub store: Option<PathBuf>,
    /// The memory that a preview takes at most, in bytes, which is in no session's budget.
    pub preview_bytes: u64,
}

impl Default for OpeningOptions {
    fn default() -> Self {
        Self { files: OpenOptions::default(), kind: Kind::Image, store: None, preview_bytes: 256 << 20 }
    }
}

/// Why an opening stopped.
#[derive(Debug, thiserror::Error)]
pub enum OpeningError {
    /// It is nothing that can be shown.
    #[error(transparent)]
    Openable(#[from] OpenableError),
    /// The files cannot be read.
    #[error(transparent)]
    Preview(#[from] PreviewError),
    /// Nobody named a place for the store, and the user has no folder for caches.
    #[error("there is no folder for the store: name a place for it, or set HOME")]
    NoPlace,
    /// The store could not be made. What was shown before stays as it is.
    #[error(transparent)]
    Packing(#[from] PackingError),
    /// This program has a fault, or got no thread.
    #[error("{0}")]
    Fault(String),
}

impl OpeningError {
    /// Whether the files do not say all that it takes to read them, so that somebody must.
    pub fn wants_options(&self) -> bool {
        let options = |error: &ImportError| matches!(error, ImportError::Options { .. });
        match self {
            Self::Openable(OpenableError::Source(error)) | Self::Preview(PreviewError::Source(error)) => options(error),
            _ => false,
        }
    }

    /// Whether somebody cancelled the opening.
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

/// What is new since an opening was last asked.
pub enum News {
    /// The files are shown like this until their store is packed.
    Preview(VolumeSource),
    /// The store is open, or has more time steps than before: show it in place of what was shown before.
    Store(VolumeSource),
    /// The opening has stopped. A preview that is shown can stay.
    Stopped(OpeningError),
}

/// What an opening is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// It reads the files for the preview, or opens the store.
    Reading,
    /// It packs the files into a store.
    Packing,
    /// It waits for the store that another program packs from the same files.
    Waiting,
    /// Nothing: the store is open, and may be followed, or the opening has stopped.
    Nothing,
}

/// The opening of one store, file or folder. Dropping it tells what it does to stop, and does not wait for that.
pub struct Opening {
    /// What its volume is called: a store in the cache has a hash in its name.
    name: String,
    work: Work,
    files: Option<Files>,
    /// What tells whether the open store has grown.
    follower: Option<Follower>,
}

enum Work {
    Reading(Background<Found, OpeningError>),
    Packing(Background<VolumeSource, PackingError>),
    Nothing,
}

/// What a path turned out to be.
enum Found {
    Store(Box<VolumeSource>),
    Files(Files),
}

/// Files that are no store yet.
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

    /// What is new, without waiting. Volumes are called as the path is.
    pub fn poll(&mut self) -> Option<News> {
        Some(match self.news()? {
            News::Preview(volume) => News::Preview(volume.named(&self.name)),
            News::Store(volume) => {
                if self.follower.is_none() {
                    self.follow(&volume);
                }
                News::Store(volume.named(&self.name))
            }
            News::Stopped(error) => News::Stopped(error),
        })
    }

    fn news(&mut self) -> Option<News> {
        match &mut self.work {
            Work::Nothing => self.follower.as_ref()?.poll().map(News::Store),
            Work::Reading(reading) => {
                let found = reading.poll()?;
                self.work = Work::Nothing;
                Some(match found {
                    Ok(Found::Store(volume)) => News::Store(*volume),
                    Ok(Found::Files(files)) => self.begin_packing(files),
                    Err(error) => News::Stopped(error.into()),
                })
            }
            Work::Packing(packing) => {
                let packed = packing.poll()?;
                self.work = Work::Nothing;
                Some(match packed {
                    Ok(volume) => {
                        self.close_preview();
                        News::Store(volume)
                    }
                    Err(error) => News::Stopped(error.into()),
                })
            }
        }
    }

    fn follow(&mut self, volume: &VolumeSource) {
        let Some(store) = volume.store() else { return };
        match Follower::start(store) {
            Ok(follower) => self.follower = follower,
            Err(error) => tracing::warn!("the store is not followed: {error}"),
        }
    }

    /// Whether the open store is one to which time steps can be appended: ask now and then what is new.
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

    /// Packs the files, or goes on with that after it has stopped. Does nothing where there is nothing to pack, or that is under way.
    pub fn pack(&mut self) {
        if let (Work::Nothing, Some(files)) = (&self.work, &self.files) {
            let Files { source, place, options, .. } = files;
            self.work = Work::Packing(background::pack(source.clone(), place.clone(), options.clone()));
        }
    }

    /// Tells the opening to stop, which it says when it has.
    pub fn cancel(&self) {
        if let Some(meter) = self.meter() {
            meter.cancel();
        }
    }

    /// What the opening is doing.
    pub fn activity(&self) -> Activity {
        match &self.work {
            Work::Reading(_) => Activity::Reading,
            Work::Packing(packing) if packing.meter().is_waiting() => Activity::Waiting,
            Work::Packing(_) => Activity::Packing,
            Work::Nothing => Activity::Nothing,
        }
    }

    /// Bytes that are done of what it is doing, and bytes in all; the latter are 0 as long as they are not known.
    pub fn progress(&self) -> (u64, u64) {
        self.meter().map_or((0, 0), Meter::progress)
    }

    /// What the user should know of the files, as far as it was said since the last call.
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

/// Opens the path, and reads the preview of what is not packed yet.
fn found(path: PathBuf, options: OpeningOptions, meter: &Meter) -> Result<Found, OpeningError> {
    let files = OpenOptions { are_labels: options.kind == Kind::Labels, ..options.files };
    let source = match openable::open(std::slice::from_ref(&path), &files)? {
        Openable::Store(volume) => return Ok(Found::Store(volume)),
        Openable::Source(source) => source,
    };
    let pack_options = openable::pack_options(source.info().voxel_type, options.kind);
    let place = match options.store {
        Some(place) => place,
        None => place_in(&user_folder().ok_or(OpeningError::NoPlace)?, &path, &*source, &pack_options),
    };
    if let Some(volume) = finished(&place, &*source, &pack_options) {
        return Ok(Found::Store(Box::new(volume)));
    }
    let preview = Preview::read(source.clone(), options.kind, options.preview_bytes, meter)?;
    Ok(Found::Files(Files { source, preview: Arc::new(preview), place, options: pack_options }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Extent, VoxelType};
    use std::path::Path;

    /// A raw file of 300 x 40 x 30 voxels, and how to open it.
    fn raw_file(folder: &Path) -> (PathBuf, OpeningOptions) {
        let path = folder.join("scan.raw");
        std::fs::write(&path, (0..300 * 40 * 30u32).map(|i| (i % 251) as u8).collect::<Vec<u8>>()).unwrap();
        let files = OpenOptions {
            shape: Some(Extent::new(300, 40, 30)),
            voxel_type: Some(VoxelType::U8),
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
        // The store itself opens, whatever is said of files.
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
            // So fast that there was nothing left to cancel.
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
        // A file is in the way of the store's folder: the preview comes all the same.
        let (path, options) = raw_file(folder.path());
        let options = OpeningOptions { store: Some(path.join("scan.zarr")), ..options };
        let mut opening = Opening::start(path, options);
        assert!(matches!(next(&mut opening), News::Preview(_)));
        let News::Stopped(error) = next(&mut opening) else { panic!("it was packed") };
        assert!(error.to_string().contains("scan.raw: "), "{error}");
    }
}
