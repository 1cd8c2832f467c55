//! Background work, for a window that must not wait: progress, cancellation and results without blocking. A panic in
//! the work becomes its error.

use crate::session::volume_source::VolumeSource;
use brickyard_export::{self as export_files, ExportError, ExportRequest, Exported};
use brickyard_extract::{self as extract, MeshError, MeshReport, MeshRequest};
use brickyard_import::zarr::Choice;
use brickyard_import::{self as import, ImportError, Source};
use brickyard_store::{self as store, Edit, EditError, EditReport, Exists, OpenError, PackError, PackOptions, Store};
use std::any::Any;
use std::io;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Progress and cancellation of some work, shared by its thread and its observers.
#[derive(Debug, Default)]
pub struct Meter {
    done_bytes: AtomicU64,
    total_bytes: AtomicU64,
    is_cancelled: AtomicBool,
    is_waiting: AtomicBool,
    said: Mutex<Vec<String>>,
}

impl Meter {
    /// Bytes done, and bytes in all; the latter are 0 until known.
    pub fn progress(&self) -> (u64, u64) {
        (self.done_bytes.load(Ordering::Relaxed), self.total_bytes.load(Ordering::Relaxed))
    }

    /// Sets the bytes done and in all, and ends waiting.
    pub fn set(&self, done_bytes: u64, total_bytes: u64) {
        self.is_waiting.store(false, Ordering::Relaxed);
        self.total_bytes.store(total_bytes, Ordering::Relaxed);
        self.done_bytes.store(done_bytes, Ordering::Relaxed);
    }

    /// Adds bytes just done.
    pub fn advance(&self, bytes: u64) {
        self.done_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Marks the work as waiting for another program's identical work.
    pub fn wait(&self) {
        self.is_waiting.store(true, Ordering::Relaxed);
    }

    /// Whether the work waits for another program.
    pub fn is_waiting(&self) -> bool {
        self.is_waiting.load(Ordering::Relaxed)
    }

    /// Requests the work to stop.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether the work is to stop.
    pub fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }

    /// Sets the bytes done and in all. Returns whether to continue.
    pub fn flow(&self, done_bytes: u64, total_bytes: u64) -> ControlFlow<()> {
        self.set(done_bytes, total_bytes);
        if self.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Keeps a message for the user, of one sentence.
    pub fn say(&self, message: &str) {
        self.said.lock().unwrap_or_else(PoisonError::into_inner).push(message.to_owned());
    }

    /// Takes the messages since the last call.
    pub fn take_said(&self) -> Vec<String> {
        std::mem::take(&mut self.said.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Errors of background work.
#[derive(Debug, thiserror::Error)]
pub enum BackgroundError<E: std::error::Error + 'static> {
    /// The work failed, or was cancelled.
    #[error(transparent)]
    Failed(E),
    /// The work panicked, with this message: a fault of this program.
    #[error("this program has a fault: {0:?}; please report this")]
    Panic(String),
    /// The operating system provided no thread for the work.
    #[error("cannot start a thread: {0}")]
    NoThread(#[source] io::Error),
}

/// Work on its own thread. Dropping it cancels the work without waiting: its present step, such as reading a large
/// compressed file, may take long. [`wait_for_all`] gives it time to clean up before the program ends.
pub struct Background<T, E> {
    meter: Arc<Meter>,
    /// The thread, or the error of starting it; `None` once the result is taken.
    thread: Option<io::Result<JoinHandle<Result<T, E>>>>,
}

impl<T: Send + 'static, E: std::error::Error + Send + 'static> Background<T, E> {
    /// Starts work, which reports its progress to the meter and stops soon after its cancellation.
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

    /// The work's progress.
    pub fn meter(&self) -> &Meter {
        &self.meter
    }

    /// Takes the work's result without waiting; `None` before its end, and if taken already.
    pub fn poll(&mut self) -> Option<Result<T, BackgroundError<E>>> {
        let is_running = self.thread.as_ref()?.as_ref().is_ok_and(|thread| !thread.is_finished());
        if is_running { None } else { self.wait() }
    }

    /// Waits for the work's result; `None` if taken already.
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

/// Number of running jobs in this process, and the signal of its decrease.
static RUNNING: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

/// Work under way on its thread.
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

/// Waits at most for `most` until all work of this process has ended: cancelled work deletes its unfinished files.
/// Returns whether it has.
pub fn wait_for_all(most: Duration) -> bool {
    let running = RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner);
    let waited = RUNNING.1.wait_timeout_while(running, most, |running| *running > 0);
    !waited.unwrap_or_else(PoisonError::into_inner).1.timed_out()
}

fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}

/// Errors in packing a file and opening its store.
#[derive(Debug, thiserror::Error)]
pub enum PackingError {
    /// The folder of the store cannot be created.
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
    /// The packed store does not open.
    #[error(transparent)]
    Open(#[from] OpenError),
}

impl PackingError {
    /// Whether the pack was cancelled.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Pack(PackError::Cancelled { .. }))
    }
}

/// Packs a source in the background into a store, creating its folder if needed, and opens it. An unfinished pack of
/// the same source and options is continued; a finished one opens at once. While another program packs the same, this
/// waits for its store.
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

/// Checks in the background whether a folder can be opened as is: see [`import::check_folder`].
pub fn check_folder(folder: PathBuf) -> Background<(), ImportError> {
    Background::start(move |_| import::check_folder(&folder))
}

/// Lists in the background the images of another program's Zarr to choose from: see [`import::zarr::choices`].
pub fn list_choices(folder: PathBuf) -> Background<Vec<Choice>, ImportError> {
    Background::start(move |_| import::zarr::choices(&folder))
}

/// Interval of checking whether another pack into the same store has ended.
const BUSY_STEP: Duration = Duration::from_millis(300);

/// A meter in the form a pack reports to.
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

/// Exports a level of a store, or a box of it, in the background, like [`export()`](brickyard_export::export()).
pub fn export(store: Arc<Store>, output: PathBuf, request: ExportRequest) -> Background<Exported, ExportError> {
    Background::start(move |meter| {
        export_files::export(&store, &output, &request, |done, total| meter.flow(done, total))
    })
}

/// Writes a surface of a store as a mesh in the background, like [`mesh()`](brickyard_extract::mesh()).
pub fn mesh(store: Arc<Store>, output: PathBuf, request: MeshRequest) -> Background<MeshReport, MeshError> {
    Background::start(move |meter| extract::mesh(&store, &output, &request, |done, total| meter.flow(done, total)))
}

/// Errors in editing a store and opening it again.
#[derive(Debug, thiserror::Error)]
pub enum EditingError {
    /// The edit is refused, or failed.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The edited store does not open.
    #[error("{store} is edited, but does not open again: {error}", store = store.display())]
    Open {
        /// The store.
        store: PathBuf,
        /// The reason.
        #[source]
        error: OpenError,
    },
}

/// Edits a store's metadata in the background, and opens it with the new values. An edit is over at once, and is not
/// cancelled.
pub fn edit(store: PathBuf, edit: Edit) -> Background<(EditReport, VolumeSource), EditingError> {
    Background::start(move |_| {
        let report = store::edit(&store, &edit)?;
        let volume = VolumeSource::open(&store).map_err(|error| EditingError::Open { store, error })?;
        Ok((report, volume))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_import::{OpenOptions, SynthKind, SynthSource, open};
    use brickyard_volume::{Extent, VoxelType};
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
        let options = OpenOptions { shape, voxel_type: Some(VoxelType::U8.into()), ..OpenOptions::default() };
        let source: Arc<dyn Source> = Arc::from(open(&[path], &options).unwrap());
        let place = folder.path().join("not yet/there/a.zarr");
        let mut work = pack(source.clone(), place.clone(), PackOptions::new(VoxelType::U8));
        let volume = work.wait().expect("a result").unwrap();
        assert_eq!(work.meter().progress(), (24_000, 24_000));
        let store = volume.store().expect("a store").clone();
        let output = folder.path().join("b.raw");
        let mut work = export(store, output.clone(), ExportRequest::default());
        assert_eq!(work.wait().expect("a result").unwrap().extent, Extent::new(40, 30, 20));
        assert_eq!((std::fs::read(&output).unwrap(), work.meter().progress()), (raw, (24_000, 24_000)));
        // The second time it is there.
        let mut work = pack(source, place, PackOptions::new(VoxelType::U8));
        work.wait().expect("a result").unwrap();
        assert_eq!(work.meter().progress(), (0, 0));
    }

    /// A pack that signals its start, and then waits for permission.
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
