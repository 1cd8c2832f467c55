//! What the whole-system tests share: volumes from functions, packing, sessions, the command, Python.

#[cfg(target_os = "linux")]
pub mod faults;
#[cfg(target_os = "linux")]
pub mod power_loss;

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::import::{ImportError, Source, SourceInfo};
use brickyard::offline::render_settled;
use brickyard::oracle::render_reference;
use brickyard::render::adapters;
use brickyard::session::{ResolvedScene, Session, SessionOptions, VolumeSource, resolve};
use brickyard::stats::RenderStats;
use brickyard::store::{PackOptions, Store, pack};
use brickyard::volume::{Extent, Geometry, Isosurface, Mode, Orientation, Picture, Scene, Voxel, VoxelBox, VoxelType};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

pub mod missing;

pub use missing::leave_out;

/// A command that takes longer hangs. The slowest takes about a minute, on two cores that do other work too.
const LONGEST_RUN: Duration = Duration::from_mins(10);

/// A source whose voxels are a function of (time, channel, `[x, y, z]`).
pub struct FunctionSource<T, F> {
    info: SourceInfo,
    function: F,
    voxel: std::marker::PhantomData<T>,
}

impl<T: Voxel, F: Fn(u32, u32, [u32; 3]) -> T + Send + Sync> FunctionSource<T, F> {
    /// One volume (see [`FunctionSource::series`] for more).
    pub fn new(extent: Extent, geometry: Geometry, function: F) -> Self {
        Self::series(extent, geometry, 1, 1, function)
    }

    /// Several steps and channels.
    pub fn series(extent: Extent, geometry: Geometry, times: u32, channels: u32, function: F) -> Self {
        let info = SourceInfo {
            extent,
            channels,
            times,
            voxel_type: T::TYPE,
            geometry,
            calibrated: true,
            orientation: None,
            identity: "a function".into(),
            notes: Vec::new(),
        };
        Self { info, function, voxel: std::marker::PhantomData }
    }

    /// This source, lying so in a patient.
    pub fn oriented(mut self, orientation: Orientation) -> Self {
        self.info.orientation = Some(orientation);
        self
    }
}

impl<T: Voxel, F: Fn(u32, u32, [u32; 3]) -> T + Send + Sync> Source for FunctionSource<T, F> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let mut chunks = out.chunks_exact_mut(size_of::<T>());
        for z in region.min.z..region.max.z {
            for y in region.min.y..region.max.y {
                for x in region.min.x..region.max.x {
                    let voxel = (self.function)(time, channel, [x, y, z]);
                    chunks.next().expect("out holds the box").copy_from_slice(bytemuck::bytes_of(&voxel));
                }
            }
        }
        Ok(())
    }
}

/// A store in a folder of its own, removed when dropped.
pub struct TestStore {
    folder: tempfile::TempDir,
    /// The open store.
    pub store: Arc<Store>,
}

impl TestStore {
    /// Packs a source with bricks of `edge`.
    ///
    /// # Panics
    /// If packing or opening fails.
    pub fn pack(source: &dyn Source, edge: u32) -> Self {
        let voxel_type = source.info().voxel_type;
        Self::pack_with(source, PackOptions { edge, shard_edge: 4 * edge, threads: 2, ..PackOptions::new(voxel_type) })
    }

    /// Packs a source as told.
    ///
    /// # Panics
    /// If packing or opening fails.
    pub fn pack_with(source: &dyn Source, options: PackOptions) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("store.zarr");
        pack(source, &path, &options, &()).expect("packing works");
        let store = Arc::new(Store::open(&path).expect("the packed store opens"));
        Self { folder, store }
    }

    /// Where the store is.
    pub fn path(&self) -> PathBuf {
        self.folder.path().join("store.zarr")
    }
}

/// A backend and its compositor.
pub type Way = (BackendChoice, CompositorChoice);

/// Every way there is to draw.
pub const WAYS: [Way; 4] = [
    (BackendChoice::Gpu, CompositorChoice::Sorted),
    (BackendChoice::Gpu, CompositorChoice::Raycast),
    (BackendChoice::Gpu, CompositorChoice::Compute),
    (BackendChoice::Cpu, CompositorChoice::Raycast),
];

/// Opens a session with ample memory; `None` (said on standard error) where there is no GPU adapter at all.
pub fn session(store: &Arc<Store>, way: Way) -> Option<Session> {
    session_within(store, way, 256 << 20, 256 << 20)
}

/// The same, skipping nothing.
pub fn session_without_skipping(store: &Arc<Store>, way: Way) -> Option<Session> {
    open_session(store, SessionOptions { skips_empty: false, ..options(way, 256 << 20, 256 << 20) })
}

/// Opens a session under budgets.
pub fn session_within(store: &Arc<Store>, way: Way, gpu_memory_bytes: u64, host_memory_bytes: u64) -> Option<Session> {
    open_session(store, options(way, gpu_memory_bytes, host_memory_bytes))
}

/// What those sessions are made with.
pub fn options((backend, compositor): Way, gpu_memory_bytes: u64, host_memory_bytes: u64) -> SessionOptions {
    SessionOptions { backend, compositor, gpu_memory_bytes, host_memory_bytes, threads: 2, ..SessionOptions::default() }
}

/// Opens a session as told; `None` (said on standard error) where there is no GPU adapter at all.
pub fn open_session(store: &Arc<Store>, options: SessionOptions) -> Option<Session> {
    open_session_of(vec![VolumeSource::of_store(store)], options)
}

/// The same of several volumes.
pub fn open_session_of(volumes: Vec<VolumeSource>, options: SessionOptions) -> Option<Session> {
    static HAS_ADAPTER: OnceLock<bool> = OnceLock::new();
    if options.backend == BackendChoice::Gpu && !HAS_ADAPTER.get_or_init(|| !adapters().is_empty()) {
        leave_out("gpu", "there is no graphics adapter");
        return None;
    }
    Some(Session::new(volumes, options))
}

/// The scene in a mode: of isosurfaces, with that of one value in each layer.
pub fn in_mode(mut scene: Scene, mode: Mode, isovalue: f64) -> Scene {
    let surfaces = if mode == Mode::Isosurface { vec![Isosurface::at(isovalue)] } else { Vec::new() };
    scene.layers.iter_mut().for_each(|layer| layer.isosurfaces.clone_from(&surfaces));
    Scene { mode, ..scene }
}

/// A settled picture of a scene, and the statistics of getting there.
///
/// # Panics
/// If it does not settle within a minute.
pub fn settled(session: &mut Session, scene: &Scene, size_px: (u32, u32)) -> (Picture, RenderStats) {
    let resolved = session.resolve(scene, size_px).expect("the scene is possible");
    let mut stats = RenderStats::default();
    let wait = Duration::from_secs(60);
    let picture = render_settled(session, &resolved, wait, Instant::now(), &mut stats, &mut Vec::new());
    (picture.expect("the picture settles"), stats)
}

/// A scene resolved for a store's volume.
///
/// # Panics
/// If the scene is impossible.
pub fn resolved(store: &Arc<Store>, scene: &Scene, size_px: (u32, u32)) -> ResolvedScene {
    resolve(&[VolumeSource::of_store(store)], scene, size_px).expect("the scene is possible")
}

/// The oracle's picture of the same scene.
///
/// # Panics
/// If the store cannot be read.
pub fn oracle(store: &Arc<Store>, scene: &Scene, size_px: (u32, u32)) -> Picture {
    render_reference(&[store], &resolved(store, scene, size_px), 1 << 30).expect("the levels can be read")
}

/// The contract between renderers: every channel within 1/255, or a PSNR of at least 50 dB where rounding accumulates over
/// many samples.
///
/// # Panics
/// If the pictures differ by more, or the expected one is a single colour (then nothing would have been tested).
pub fn assert_same(found: &Picture, expected: &Picture, what: &str) {
    let flat = expected.rgb.iter().all(|p| *p == expected.rgb[0]);
    assert!(!flat, "{what}: the expected picture is one flat colour");
    let difference = found.difference(expected);
    assert!(difference.max <= 1 || difference.psnr_db >= 50.0, "{what}: {difference:?}");
}

/// The same contract for isosurfaces, where rounding decides whether a ray that grazes the surface meets it: for all but three
/// pixels in a thousand, or a PSNR of at least 50 dB.
///
/// # Panics
/// If more pixels are off, or the expected picture is a single colour.
pub fn assert_same_surface(found: &Picture, expected: &Picture, what: &str) {
    let flat = expected.rgb.iter().all(|p| *p == expected.rgb[0]);
    assert!(!flat, "{what}: the expected picture is one flat colour");
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
    let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
    let difference = found.difference(expected);
    let alike = off * 1000 <= 3 * expected.rgb.len() || difference.psnr_db >= 50.0;
    assert!(alike, "{what}: {off} pixels, {difference:?}");
}

/// The `brickyard` command of this build, which `tools/test` builds before the tests.
///
/// # Panics
/// If it is not there.
pub fn command() -> Command {
    program("brickyard")
}

/// A program of this build, `examples/NAME` for an example.
///
/// # Panics
/// If it is not there.
pub fn program(name: &str) -> Command {
    let test = std::env::current_exe().expect("this program has a path");
    let path = test.ancestors().nth(2).expect("target/PROFILE/deps/test").join(name);
    assert!(path.is_file(), "{} is not built: run `cargo build --all-targets` (tools/test does)", path.display());
    Command::new(path)
}

/// Runs the command with arguments and returns (exit code, standard output, standard error).
///
/// # Panics
/// If it cannot be started or is killed by a signal.
pub fn run(arguments: &[&str]) -> (i32, String, String) {
    outcome(command().args(arguments))
}

/// Runs the command and expects success.
///
/// # Panics
/// If it fails.
pub fn run_ok(arguments: &[&str]) -> (String, String) {
    let (code, stdout, stderr) = run(arguments);
    assert_eq!(code, 0, "brickyard {arguments:?}: {stderr}");
    (stdout, stderr)
}

/// The Python with the independent readers, set up by `tools/setup python`; `None` (said loudly) without it.
pub fn python() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."));
    let path =
        std::env::var_os("BRICKYARD_PYTHON").map_or_else(|| root.join("target/python/bin/python"), PathBuf::from);
    if !path.is_file() {
        leave_out("python", format!("{} is not there", path.display()));
        return None;
    }
    Some(path)
}

/// All the bytes of a voxel type's array from a function.
pub fn bytes_of(voxel_type: VoxelType, extent: Extent, value: impl Fn([u32; 3]) -> f64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(extent.volume() as usize * voxel_type.bytes());
    for z in 0..extent.z {
        for y in 0..extent.y {
            for x in 0..extent.x {
                let v = value([x, y, z]);
                brickyard::volume::with_voxel_type!(voxel_type, T => {
                    bytes.extend_from_slice(bytemuck::bytes_of(&T::from_f64_rounded(v)));
                });
            }
        }
    }
    bytes
}

/// A folder of its own in which the command runs, removed when dropped. All paths are relative to it.
pub struct Sandbox(tempfile::TempDir);

impl Default for Sandbox {
    fn default() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }
}

impl Sandbox {
    /// One in a file system without a disk where there is one (Linux's `/dev/shm`), else as by default.
    pub fn in_memory() -> Self {
        tempfile::tempdir_in("/dev/shm").map_or_else(|_| Self::default(), Self)
    }

    /// One in a folder that is there.
    pub fn within(folder: &str) -> Self {
        Self(tempfile::tempdir_in(folder).expect("a temporary folder"))
    }

    /// A path inside.
    pub fn path(&self, path: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(path)
    }

    /// Writes a file.
    ///
    /// # Panics
    /// If that is not possible.
    pub fn write(&self, path: impl AsRef<Path>, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(path), bytes).expect("the sandbox is writable");
    }

    /// Reads a file.
    ///
    /// # Panics
    /// If that is not possible.
    pub fn read(&self, path: impl AsRef<Path>) -> Vec<u8> {
        let path = self.path(path);
        std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// Copies a folder.
    ///
    /// # Panics
    /// If that is not possible.
    pub fn copy(&self, from: &str, to: &str) {
        for (path, bytes) in tree(&self.path(from)) {
            let path = self.path(to).join(path);
            std::fs::create_dir_all(path.parent().expect("below the sandbox")).expect("the sandbox is writable");
            std::fs::write(path, bytes).expect("the sandbox is writable");
        }
    }

    /// The command, to be run in this folder.
    pub fn command(&self) -> Command {
        let mut command = command();
        command.current_dir(self.0.path());
        command
    }

    /// Runs the command on a line of arguments (split at blanks) and returns (exit code, standard output, standard error).
    ///
    /// # Panics
    /// If it cannot be started or is killed by a signal.
    pub fn run(&self, line: &str) -> (i32, String, String) {
        outcome(self.command().args(line.split_whitespace()))
    }

    /// Runs the command and returns its standard output.
    ///
    /// # Panics
    /// If it fails.
    pub fn run_ok(&self, line: &str) -> String {
        let (code, stdout, stderr) = self.run(line);
        assert_eq!(code, 0, "brickyard {line}: {stderr}");
        stdout
    }

    /// Runs the command and parses the JSON on its standard output.
    ///
    /// # Panics
    /// If it fails or prints something else.
    pub fn json(&self, line: &str) -> serde_json::Value {
        let text = self.run_ok(line);
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("brickyard {line}: {error}: {text}"))
    }

    /// Runs a script of `tests/python` with the command and this folder as its first arguments; false where there is no
    /// Python.
    ///
    /// # Panics
    /// If the script fails; its output is shown.
    pub fn python(&self, script: &str) -> bool {
        let Some(python) = python() else { return false };
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("python").join(script);
        let (code, stdout, stderr) =
            outcome(Command::new(python).arg("-B").arg(&script).arg(command().get_program()).arg(self.0.path()));
        assert_eq!(code, 0, "{}:\n{stdout}{stderr}", script.display());
        println!("{stdout}");
        true
    }
}

/// What a command does that has no input: its exit code and what it wrote.
fn outcome(command: &mut Command) -> (i32, String, String) {
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it can be started");
    let stdout = read_on_a_thread(child.stdout.take().expect("it is piped"));
    let stderr = read_on_a_thread(child.stderr.take().expect("it is piped"));
    let mut text = |output: Receiver<String>| {
        output.recv_timeout(LONGEST_RUN).unwrap_or_else(|_| {
            child.kill().expect("it is ours");
            panic!("{command:?} has not ended after {LONGEST_RUN:?}")
        })
    };
    let (stdout, stderr) = (text(stdout), text(stderr));
    (child.wait().expect("it is ours").code().expect("no signal"), stdout, stderr)
}

/// All that comes out of a pipe, once its other end is closed.
fn read_on_a_thread(mut pipe: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).expect("the pipe can be read");
        // Nobody waits for it once the test has failed.
        let _ = sender.send(String::from_utf8_lossy(&bytes).into_owned());
    });
    receiver
}

/// Every file below a folder, by its path there.
///
/// # Panics
/// If one cannot be read.
pub fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(&next).unwrap_or_else(|error| panic!("{}: {error}", next.display())) {
            let path = entry.expect("the folder can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
                files.insert(path.strip_prefix(folder).expect("below the folder").to_path_buf(), bytes);
            }
        }
    }
    files
}

/// The names in which two trees differ: missing, extra, or of other content.
pub fn tree_difference(found: &BTreeMap<PathBuf, Vec<u8>>, expected: &BTreeMap<PathBuf, Vec<u8>>) -> Vec<String> {
    let names: BTreeSet<&PathBuf> = found.keys().chain(expected.keys()).collect();
    let differs = |name: &&PathBuf| found.get(*name) != expected.get(*name);
    let size = |bytes: Option<&Vec<u8>>| bytes.map_or("none".into(), |b| format!("{} bytes", b.len()));
    let describe = |n: &PathBuf| format!("{}: {}, expected {}", n.display(), size(found.get(n)), size(expected.get(n)));
    names.into_iter().filter(differs).map(describe).collect()
}

/// Reads an 8-bit RGB PNG.
///
/// # Panics
/// If it is not one.
pub fn read_png(path: &Path) -> Picture {
    let file = std::fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("a whole PNG");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    Picture { width: info.width, height: info.height, rgb: bytes.as_chunks::<3>().0.to_vec() }
}

/// Numbers that look random and are the same in every run (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// The next number in 0..1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}
