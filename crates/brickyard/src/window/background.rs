//! Work on a thread of its own, for a window that must not wait: how far it is, whether it is to stop, and what came of it, all of which are asked without
//! waiting. A panic inside of the work is an error of the work.

use crate::session::volume_source::VolumeSource;
use brickyard_import::{self as import, ImportError, Source};
use brickyard_store::{self as store, Exists, ExportError, ExportRequest, OpenError, PackError, PackOptions, Store};
use brickyard_volume::Extent;
use std::any::Any;
use std::io;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How far some work is, and whether it is to stop: shared by the thread that works and those that watch it.
#[derive(Debug, Default)]
pub struct Meter {
    done_bytes: AtomicU64,
    total_bytes: AtomicU64,
    is_cancelled: AtomicBool,
    is_waiting: AtomicBool,
    said: Mutex<Vec<String>>,
}

impl Meter {
    /// Bytes that are done, and bytes in all; the latter are 0 as long as they are not known.
    pub fn progress(&self) -> (u64, u64) {
        (self.done_bytes.load(Ordering::Relaxed), self.total_bytes.load(Ordering::Relaxed))
    }

    /// Sets the bytes that are done, and the bytes in all. The work waits no more.
    pub fn set(&self, done_bytes: u64, total_bytes: u64) {
        self.is_waiting.store(false, Ordering::Relaxed);
        self.total_bytes.store(total_bytes, Ordering::Relaxed);
        self.done_bytes.store(done_bytes, Ordering::Relaxed);
    }

    /// Counts bytes that were done just now.
    pub fn advance(&self, bytes: u64) {
        self.done_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Notes that the work waits for another program, which does the same.
    pub fn wait(&self) {
        self.is_waiting.store(true, Ordering::Relaxed);
    }

    /// Whether the work waits for another program.
    pub fn is_waiting(&self) -> bool {
        self.is_waiting.load(Ordering::Relaxed)
    }

    /// Tells the work to stop.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether the work is to stop.
    pub fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }

    /// Keeps something that the user should know, in one sentence.
    pub fn say(&self, message: &str) {
        self.said.lock().unwrap_or_else(PoisonError::into_inner).push(message.to_owned());
    }

    /// What the user should know, as far as it was said since the last call.
    pub fn take_said(&self) -> Vec<String> {
        std::mem::take(&mut self.said.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Why work in the background came to nothing.
#[derive(Debug, thiserror::Error)]
pub enum BackgroundError<E: std::error::Error + 'static> {
    /// The work failed, or was cancelled.
    #[error(transparent)]
    Failed(E),
    /// The work panicked, with this message: a fault of this program.
    #[error("this program has a fault: {0:?}; please report this")]
    Panic(String),
    /// The operating system gave no thread for the work.
    #[error("cannot start a thread: {0}")]
    NoThread(#[source] io::Error),
}

/// Work on a thread of its own. Dropping it cancels the work and does not wait: what it does at that moment may take long, as reading a large compressed
/// file does. [`wait_for_all`] gives it time to clean up before the program ends.
pub struct Background<T, E> {
    meter: Arc<Meter>,
    /// The thread, or why there is none; `None` once the result was taken.
    thread: Option<io::Result<JoinHandle<Result<T, E>>>>,
}

impl<T: Send + 'static, E: std::error::Error + Send + 'static> Background<T, E> {
    /// Starts work, which tells the meter how far it is and stops soon once that is cancelled.
    pub fn start(work: impl FnOnce(&Meter) -> Result<T, E> + Send + 'static) -> Self {
        let meter = Arc::new(Meter::default());
        let of_work = meter.clone();
        let running = Running::begin();
        let work = move || {
            let _running = running;
            work(&of_work)
        };
        let thread = std::thread::Builder::new().name("background".into()).spawn(work);
        Self { meter, thread: Some(thread) }
    }

    /// How far the work is.
    pub fn meter(&self) -> &Meter {
        &self.meter
    }

    /// The result of the work, if it is over, without waiting; `None` as long as it is not, and after it was taken.
    pub fn poll(&mut self) -> Option<Result<T, BackgroundError<E>>> {
        let is_over = match self.thread.as_ref()? {
            Ok(thread) => thread.is_finished(),
            Err(_) => true,
        };
        is_over.then(|| self.wait()).flatten()
    }

    /// Waits for the result of the work; `None` if it was taken before.
    pub fn wait(&mut self) -> Option<Result<T, BackgroundError<E>>> {
        Some(match self.thread.take()? {
            Err(error) => Err(BackgroundError::NoThread(error)),
            Ok(thread) => match thread.join() {
                Ok(result) => result.map_err(BackgroundError::Failed),
                Err(panic) => Err(BackgroundError::Panic(words(&*panic))),
            },
        })
    }
}

impl<T, E> Drop for Background<T, E> {
    fn drop(&mut self) {
        self.meter.cancel();
    }
}

/// How much work is under way in this process, and what tells of less.
static RUNNING: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

/// Work that is under way.
struct Running;

impl Running {
    fn begin() -> Self {
        *RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        Self
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        *RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        RUNNING.1.notify_all();
    }
}

/// Waits until no work is under way in this process, for so long at most: work that was cancelled deletes what it has half made. Returns whether all
/// of it has ended.
pub fn wait_for_all(most: Duration) -> bool {
    let running = RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner);
    let waited = RUNNING.1.wait_timeout_while(running, most, |running| *running > 0);
    !waited.unwrap_or_else(PoisonError::into_inner).1.timed_out()
}

/// What a panic said.
fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}

/// Why a file did not become an open store.
#[derive(Debug, thiserror::Error)]
pub enum PackingError {
    /// The folder of the store cannot be made.
    #[error("{path}: {error}", path = path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: io::Error,
    },
    /// The pack failed, or was cancelled.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The store that was packed does not open.
    #[error(transparent)]
    Open(#[from] OpenError),
}

impl PackingError {
    /// Whether somebody cancelled the pack.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Pack(PackError::Cancelled { .. }))
    }
}

/// Packs a source in the background into a store, whose folder is made if need be, and opens it. An unfinished pack of the same source and options is
/// gone on with; a finished one is opened at once. Where another program packs the same, its store is waited for.
pub fn pack(source: Arc<dyn Source>, place: PathBuf, options: PackOptions) -> Background<VolumeSource, PackingError> {
    Background::start(move |meter| {
        if let Some(folder) = place.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(|error| PackingError::Folder { path: folder.into(), error })?;
        }
        let voxel_bytes = source.info().voxel_type.bytes() as u64;
        let options = PackOptions { exists: Exists::Resume, ..options };
        while let Err(error) = store::pack(&*source, &place, &options, &PackMeter { meter, voxel_bytes }) {
            if !matches!(error, PackError::Busy { .. }) || meter.is_cancelled() {
                return Err(error.into());
            }
            meter.wait();
            std::thread::sleep(BUSY_STEP);
        }
        Ok(VolumeSource::open(&place)?)
    })
}

/// Looks in the background whether a folder can be opened as it is: see [`import::check_folder`].
pub fn check_folder(folder: PathBuf) -> Background<(), ImportError> {
    Background::start(move |_| import::check_folder(&folder))
}

/// How long to wait until it is asked again whether another pack into the same store is over.
const BUSY_STEP: Duration = Duration::from_millis(300);

/// A meter as a pack takes it.
struct PackMeter<'a> {
    meter: &'a Meter,
    voxel_bytes: u64,
}

impl store::Progress for PackMeter<'_> {
    fn note(&self, message: &str) {
        self.meter.say(message);
    }

    fn warn(&self, message: &str) {
        self.meter.say(message);
    }

    fn advanced(&self, done: u64, total: u64) {
        self.meter.set(done * self.voxel_bytes, total * self.voxel_bytes);
    }

    fn aprons(&self, done: u64, total: u64) {
        self.meter.set(done, total);
    }

    fn is_cancelled(&self) -> bool {
        self.meter.is_cancelled()
    }
}

/// Exports a level of a store, or a box of it, in the background, as [`store::export()`] does.
pub fn export(store: Arc<Store>, output: PathBuf, request: ExportRequest) -> Background<Extent, ExportError> {
    Background::start(move |meter| {
        store::export(&store, &output, &request, |done, total| {
            meter.set(done, total);
            if meter.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_import::{OpenOptions, SynthKind, SynthSource, open};
    use brickyard_volume::VoxelType;
    use std::sync::mpsc::channel;

    #[test]
    fn a_result_is_polled_and_taken_once() {
        let (go, gone) = channel::<()>();
        let mut work = Background::<u32, io::Error>::start(move |meter| {
            meter.set(3, 7);
            meter.say("look out");
            gone.recv().expect("told to go on");
            Ok(5)
        });
        assert!(work.poll().is_none());
        go.send(()).unwrap();
        assert_eq!(work.wait().expect("a result").unwrap(), 5);
        assert!(work.poll().is_none() && work.wait().is_none());
        assert_eq!((work.meter().progress(), work.meter().take_said()), ((3, 7), vec!["look out".to_owned()]));
        assert!(work.meter().take_said().is_empty());
    }

    #[test]
    fn dropping_cancels_and_does_not_wait() {
        let ((go, gone), (say, said)) = (channel::<()>(), channel());
        drop(Background::<(), io::Error>::start(move |meter| {
            gone.recv().expect("told to go on");
            say.send(meter.is_cancelled()).expect("the test listens");
            Ok(())
        }));
        assert!(!wait_for_all(Duration::ZERO), "it is under way");
        go.send(()).expect("the work listens");
        assert!(said.recv().expect("an answer"));
        assert!(wait_for_all(Duration::from_secs(60)));
    }

    #[test]
    fn a_panic_is_an_error() {
        let mut work = Background::<(), io::Error>::start(|_| std::panic::resume_unwind(Box::new("out of bounds")));
        let error = work.wait().expect("a result").unwrap_err().to_string();
        assert!(error.contains("\"out of bounds\""), "{error}");
    }

    #[test]
    fn a_source_becomes_an_open_store_that_is_exported() {
        let folder = tempfile::tempdir().unwrap();
        let raw: Vec<u8> = (0..40 * 30 * 20u32).map(|i| (i % 251) as u8).collect();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, &raw).unwrap();
        let shape = Some(Extent::new(40, 30, 20));
        let options = OpenOptions { shape, voxel_type: Some(VoxelType::U8), ..OpenOptions::default() };
        let source: Arc<dyn Source> = Arc::from(open(&[path], &options).unwrap());
        let place = folder.path().join("not yet/there/a.zarr");
        let mut work = pack(source.clone(), place.clone(), PackOptions::new(VoxelType::U8));
        let volume = work.wait().expect("a result").unwrap();
        assert_eq!(work.meter().progress(), (24_000, 24_000));
        let store = volume.store().expect("a store").clone();
        let output = folder.path().join("b.raw");
        let mut work = export(store, output.clone(), ExportRequest::default());
        assert_eq!(work.wait().expect("a result").unwrap(), Extent::new(40, 30, 20));
        assert_eq!((std::fs::read(&output).unwrap(), work.meter().progress()), (raw, (24_000, 24_000)));
        // The second time it is there.
        let mut work = pack(source, place, PackOptions::new(VoxelType::U8));
        work.wait().expect("a result").unwrap();
        assert_eq!(work.meter().progress(), (0, 0));
    }

    /// A pack that says that it has begun, and goes on only when it may.
    #[derive(Default)]
    struct Held {
        has_begun: AtomicBool,
        goes_on: AtomicBool,
    }

    impl store::Progress for Held {
        fn planned(&self, _: &store::PackPlan) {
            self.has_begun.store(true, Ordering::Relaxed);
            while !self.goes_on.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
        }
    }

    #[test]
    fn the_store_that_another_packs_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let source = SynthSource::new(SynthKind::Turbulence, Extent::new(40, 30, 20), VoxelType::U8, 1, 1).unwrap();
        let (source, place, options) =
            (Arc::new(source), folder.path().join("a.zarr"), PackOptions::new(VoxelType::U8));
        let other = Held::default();
        let volume = std::thread::scope(|scope| {
            let first = scope.spawn(|| store::pack(&*source, &place, &options, &other));
            while !other.has_begun.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            let mut work = pack(source.clone(), place.clone(), options.clone());
            while !work.meter().is_waiting() {
                assert!(work.poll().is_none(), "it is over before the other is");
                std::thread::yield_now();
            }
            other.goes_on.store(true, Ordering::Relaxed);
            assert!(!first.join().unwrap().unwrap().was_complete);
            work.wait().expect("a result").unwrap()
        });
        assert_eq!(volume.source.pyramid().levels()[0].extent, Extent::new(40, 30, 20));
    }

    #[test]
    fn a_cancelled_pack_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let source = SynthSource::new(SynthKind::Turbulence, Extent::new(512, 512, 512), VoxelType::U16, 1, 1).unwrap();
        let mut work = pack(Arc::new(source), folder.path().join("a.zarr"), PackOptions::new(VoxelType::U16));
        work.meter().cancel();
        let Err(BackgroundError::Failed(error)) = work.wait().expect("a result").map(|_| ()) else {
            panic!("it ended")
        };
        assert!(error.is_cancelled(), "{error}");
    }
}
