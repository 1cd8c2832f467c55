//! Common code of the whole-system tests: volumes from functions, packing, sessions, the command, Python.

#[cfg(target_os = "linux")]
pub mod fault_cases;
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
use brickyard::store::{Downsample, PackOptions, Store, pack};
use brickyard::volume::{Extent, Geometry, Isosurface, Mode, Orientation, Picture, Scene, Voxel, VoxelBox, VoxelType};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

pub mod display;
mod missing;
mod nearest;
pub mod sample;

pub use display::Display;
pub use missing::leave_out;
pub use nearest::{Expected, off};

/// Time until a command counts as hanging. The slowest takes about a minute, on two busy cores.
const LONGEST_RUN: Duration = Duration::from_mins(10);

/// A source of voxels from a function of (time, channel, `[x, y, z]`).
pub struct FunctionSource<T, F> {
    info: SourceInfo,
    function: F,
    voxel: std::marker::PhantomData<T>,
}

impl<T: Voxel, F: Fn(u32, u32, [u32; 3]) -> T + Send + Sync> FunctionSource<T, F> {
    /// Creates a source of one time step and one channel.
    pub fn new(extent: Extent, geometry: Geometry, function: F) -> Self {
        Self::series(extent, geometry, 1, 1, function)
    }

    /// Creates a source of several time steps and channels.
    pub fn series(extent: Extent, geometry: Geometry, times: u32, channels: u32, function: F) -> Self {
        let info = SourceInfo {
            channels,
            times,
            geometry,
            calibrated: true,
            identity: "a function".into(),
            ..SourceInfo::of_volume(extent, T::TYPE)
        };
        Self { info, function, voxel: std::marker::PhantomData }
    }

    /// Marks voxels of this value as no data.
    pub fn without(mut self, nodata: f64) -> Self {
        self.info.nodata = Some(nodata);
        self
    }

    /// Places the source in a patient.
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

/// A store in a temporary folder, removed on drop.
pub struct TestStore {
    folder: tempfile::TempDir,
    /// The open store.
    pub store: Arc<Store>,
}

impl TestStore {
    /// Packs a source into a store with bricks of `edge`^3 voxels, shards of four bricks along each edge, and the pyramid of means alone, which
    /// [`TestStore::store`] is in all modes.
    ///
    /// # Panics
    /// If packing or opening fails.
    pub fn pack(source: &dyn Source, edge: u32) -> Self {
        let voxel_type = source.info().voxel_type;
        let (shard_edge, downsample) = (4 * edge, Downsample::Mean.into());
        Self::pack_with(
            source,
            PackOptions { edge, shard_edge, downsample, threads: 2, ..PackOptions::new(voxel_type) },
        )
    }

    /// Packs a source into a store with these options.
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

    /// The path of the store's folder.
    pub fn path(&self) -> PathBuf {
        self.folder.path().join("store.zarr")
    }
}

/// A way to draw: backend and compositor.
pub type Way = (BackendChoice, CompositorChoice);

/// All ways to draw: the GPU with each compositor, and the CPU.
pub const WAYS: [Way; 4] = [
    (BackendChoice::Gpu, CompositorChoice::Sorted),
    (BackendChoice::Gpu, CompositorChoice::Raycast),
    (BackendChoice::Gpu, CompositorChoice::Compute),
    (BackendChoice::Cpu, CompositorChoice::Raycast),
];

/// Opens a session for a store, with budgets of 256 MiB each on the GPU and on the host. `None`, by [`leave_out`], if the way needs a GPU and
/// there is no adapter.
pub fn session(store: &Arc<Store>, way: Way) -> Option<Session> {
    session_within(store, way, 256 << 20, 256 << 20)
}

/// Opens a [`session`] for each way to draw on this machine.
pub fn sessions(store: &Arc<Store>) -> Vec<(Way, Session)> {
    WAYS.into_iter().filter_map(|way| Some((way, session(store, way)?))).collect()
}

/// Opens a session for a store without skipping: invisible bricks are read, and empty space is sampled. `None`, by [`leave_out`], if the way
/// needs a GPU and there is no adapter.
pub fn session_without_skipping(store: &Arc<Store>, way: Way) -> Option<Session> {
    open_session(store, SessionOptions { skips_empty: false, ..options(way, 256 << 20, 256 << 20) })
}

/// Opens a session for a store under budgets. `None`, by [`leave_out`], if the way needs a GPU and there is no adapter.
pub fn session_within(store: &Arc<Store>, way: Way, gpu_memory_bytes: u64, host_memory_bytes: u64) -> Option<Session> {
    open_session(store, options(way, gpu_memory_bytes, host_memory_bytes))
}

/// Options of a session for this way to draw under budgets, with two threads.
pub fn options((backend, compositor): Way, backend_bytes: u64, host_memory_bytes: u64) -> SessionOptions {
    SessionOptions {
        backend,
        compositor,
        gpu_memory_bytes: backend_bytes,
        cpu_memory_bytes: backend_bytes,
        host_memory_bytes,
        threads: 2,
        ..SessionOptions::default()
    }
}

/// Opens a session for a store with these options. `None`, by [`leave_out`], if they need a GPU and there is no adapter.
pub fn open_session(store: &Arc<Store>, options: SessionOptions) -> Option<Session> {
    open_session_of(vec![VolumeSource::of_store(store)], options)
}

/// Opens a session for volumes with these options. `None`, by [`leave_out`], if they need a GPU and there is no adapter.
///
/// # Panics
/// If there is no adapter but `BRICKYARD_REQUIRE` requires one.
pub fn open_session_of(volumes: Vec<VolumeSource>, options: SessionOptions) -> Option<Session> {
    static HAS_ADAPTER: OnceLock<bool> = OnceLock::new();
    if options.backend == BackendChoice::Gpu && !HAS_ADAPTER.get_or_init(|| !adapters().is_empty()) {
        leave_out("gpu", "there is no graphics adapter");
        return None;
    }
    Some(Session::new(volumes, options))
}

/// The scene in another mode. In [`Mode::Isosurface`] each layer gets one isosurface, at `isovalue`; in other modes none.
pub fn in_mode(mut scene: Scene, mode: Mode, isovalue: f64) -> Scene {
    let surfaces = if mode == Mode::Isosurface { vec![Isosurface::at(isovalue)] } else { Vec::new() };
    scene.layers.iter_mut().for_each(|layer| layer.isosurfaces.clone_from(&surfaces));
    Scene { mode, ..scene }
}

/// Draws the settled picture of a scene, with the statistics of the whole run.
///
/// # Panics
/// If the scene is impossible, the session fails, or the view does not settle within a minute.
pub fn settled(session: &mut Session, scene: &Scene, size_px: (u32, u32)) -> (Picture, RenderStats) {
    let resolved = session.resolve(scene, size_px).expect("the scene is possible");
    let mut stats = RenderStats::default();
    let wait = Duration::from_secs(60);
    let picture = render_settled(session, &resolved, wait, Instant::now(), &mut stats, &mut Vec::new());
    (picture.expect("the picture settles"), stats)
}

/// Resolves a scene for a store's volume.
///
/// # Panics
/// If the scene is impossible.
pub fn resolved(store: &Arc<Store>, scene: &Scene, size_px: (u32, u32)) -> ResolvedScene {
    resolve(&[VolumeSource::of_store(store)], scene, size_px).expect("the scene is possible")
}

/// Draws a scene of a store's volume with the oracle.
///
/// # Panics
/// If the scene is impossible, or its levels cannot be read or do not fit 1 GiB.
pub fn oracle(store: &Arc<Store>, scene: &Scene, size_px: (u32, u32)) -> Picture {
    render_reference(&[store], &resolved(store, scene, size_px), 1 << 30).expect("the levels can be read")
}

/// Asserts the contract between renderers: every channel of two pictures is within 1/255, or their PSNR is at least 50 dB, where rounding
/// accumulates over many samples. `what` names the case in messages.
///
/// # Panics
/// If the pictures differ by more or in size, or the expected one is a single colour (then the test would be empty).
pub fn assert_same(found: &Picture, expected: &Picture, what: &str) {
    let flat = expected.rgb.iter().all(|p| *p == expected.rgb[0]);
    assert!(!flat, "{what}: the expected picture is one flat colour");
    let difference = found.difference(expected);
    assert!(difference.max <= 1 || difference.psnr_db >= 50.0, "{what}: {difference:?}");
}

/// Asserts the contract between renderers for isosurfaces: every channel is within 1/255 for all but three pixels in a thousand, or the
/// pictures' PSNR is at least 50 dB. Rounding decides whether a ray that grazes a surface hits it. `what` names the case in messages.
///
/// # Panics
/// If more pixels are off, the pictures differ in size, or the expected one is a single colour.
pub fn assert_same_surface(found: &Picture, expected: &Picture, what: &str) {
    let flat = expected.rgb.iter().all(|p| *p == expected.rgb[0]);
    assert!(!flat, "{what}: the expected picture is one flat colour");
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
    let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
    let difference = found.difference(expected);
    let alike = off * 1000 <= 3 * expected.rgb.len() || difference.psnr_db >= 50.0;
    assert!(alike, "{what}: {off} pixels, {difference:?}");
}

/// The `brickyard` program of this build, as a command; `tools/test` builds it before the tests.
///
/// # Panics
/// If it is not built.
pub fn command() -> Command {
    program("brickyard")
}

/// A program of this build by name, as a command: `examples/NAME` for an example.
///
/// # Panics
/// If it is not built.
pub fn program(name: &str) -> Command {
    let test = std::env::current_exe().expect("this program has a path");
    let path = test.ancestors().nth(2).expect("target/PROFILE/deps/test").join(name);
    assert!(path.is_file(), "{} is not built: run `cargo build --all-targets` (tools/test does)", path.display());
    let mut program = Command::new(path);
    // Nothing goes into the cache of whoever runs the tests.
    program.env("BRICKYARD_CACHE", "");
    program
}

/// Runs `brickyard` with arguments and returns (exit code, standard output, standard error).
///
/// # Panics
/// If it cannot be started, hangs, or is killed by a signal.
pub fn run(arguments: &[&str]) -> (i32, String, String) {
    outcome(command().args(arguments))
}

/// Runs `brickyard` with arguments and returns (standard output, standard error).
///
/// # Panics
/// If it does not end with exit code 0.
pub fn run_ok(arguments: &[&str]) -> (String, String) {
    let (code, stdout, stderr) = run(arguments);
    assert_eq!(code, 0, "brickyard {arguments:?}: {stderr}");
    (stdout, stderr)
}

/// Path of the Python with the independent readers: `BRICKYARD_PYTHON`, or the one from `tools/setup python`. `None`, by [`leave_out`], if
/// there is none.
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

/// Bytes of an array of voxels, x fastest, from a function of `[x, y, z]`, rounded to the voxel type.
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

/// A temporary working folder for `brickyard`, removed on drop. All paths given to the command are relative to it.
pub struct Sandbox(tempfile::TempDir);

impl Default for Sandbox {
    fn default() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }
}

impl Sandbox {
    /// Creates a sandbox in a file system in memory if there is one (Linux's `/dev/shm`), else in the default folder for temporary files.
    pub fn in_memory() -> Self {
        tempfile::tempdir_in("/dev/shm").map_or_else(|_| Self::default(), Self)
    }

    /// Creates a sandbox inside an existing folder.
    ///
    /// # Panics
    /// If no folder can be created there.
    pub fn within(folder: &str) -> Self {
        Self(tempfile::tempdir_in(folder).expect("a temporary folder"))
    }

    /// The full path of a path in the sandbox.
    pub fn path(&self, path: impl AsRef<Path>) -> PathBuf {
        self.0.path().join(path)
    }

    /// Writes or replaces a file of the sandbox.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn write(&self, path: impl AsRef<Path>, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(path), bytes).expect("the sandbox is writable");
    }

    /// Reads a file of the sandbox.
    ///
    /// # Panics
    /// If it cannot be read.
    pub fn read(&self, path: impl AsRef<Path>) -> Vec<u8> {
        let path = self.path(path);
        std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// Copies all files of a folder of the sandbox to another of its folders.
    ///
    /// # Panics
    /// If a file cannot be read or written.
    pub fn copy(&self, from: &str, to: &str) {
        for (path, bytes) in tree(&self.path(from)) {
            let path = self.path(to).join(path);
            std::fs::create_dir_all(path.parent().expect("below the sandbox")).expect("the sandbox is writable");
            std::fs::write(path, bytes).expect("the sandbox is writable");
        }
    }

    /// The `brickyard` command with the sandbox as working folder.
    pub fn command(&self) -> Command {
        let mut command = command();
        command.current_dir(self.0.path());
        command
    }

    /// Runs `brickyard` in the sandbox on a line of arguments (split at blanks); returns (exit code, standard output, standard error).
    ///
    /// # Panics
    /// If it cannot be started, hangs, or is killed by a signal.
    pub fn run(&self, line: &str) -> (i32, String, String) {
        outcome(self.command().args(line.split_whitespace()))
    }

    /// Runs `brickyard` in the sandbox on a line of arguments (split at blanks); returns its standard output.
    ///
    /// # Panics
    /// If it does not end with exit code 0.
    pub fn run_ok(&self, line: &str) -> String {
        let (code, stdout, stderr) = self.run(line);
        assert_eq!(code, 0, "brickyard {line}: {stderr}");
        stdout
    }

    /// Runs `brickyard` in the sandbox on a line of arguments (split at blanks); parses its standard output as JSON.
    ///
    /// # Panics
    /// If it does not end with exit code 0, or prints anything but JSON.
    pub fn json(&self, line: &str) -> serde_json::Value {
        let text = self.run_ok(line);
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("brickyard {line}: {error}: {text}"))
    }

    /// Runs a script of `tests/python` with the paths of `brickyard` and of the sandbox. Returns `false` if there is no Python with the
    /// independent readers.
    ///
    /// # Panics
    /// If the script fails, with its output.
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

/// Runs a command without input; returns (exit code, standard output, standard error).
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

/// Reads a pipe on its own thread. The receiver gets the whole output after the pipe closes.
fn read_on_a_thread(mut pipe: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).expect("the pipe can be read");
        // After a failed test there is no receiver.
        let _ = sender.send(String::from_utf8_lossy(&bytes).into_owned());
    });
    receiver
}

/// Reads every file below a folder, keyed by relative path.
///
/// # Panics
/// If a file or folder cannot be read.
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

/// Describes the differences between two trees of files, one a line: missing, extra, or different content. Empty for equal trees.
pub fn tree_difference(found: &BTreeMap<PathBuf, Vec<u8>>, expected: &BTreeMap<PathBuf, Vec<u8>>) -> Vec<String> {
    let names: BTreeSet<&PathBuf> = found.keys().chain(expected.keys()).collect();
    let differs = |name: &&PathBuf| found.get(*name) != expected.get(*name);
    let size = |bytes: Option<&Vec<u8>>| bytes.map_or("none".into(), |b| format!("{} bytes", b.len()));
    let describe = |n: &PathBuf| format!("{}: {}, expected {}", n.display(), size(found.get(n)), size(expected.get(n)));
    names.into_iter().filter(differs).map(describe).collect()
}

/// Reads an 8-bit RGB PNG file.
///
/// # Panics
/// If the file cannot be read or is no such PNG.
pub fn read_png(path: &Path) -> Picture {
    let file = std::fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("a whole PNG");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    Picture { width: info.width, height: info.height, rgb: bytes.as_chunks::<3>().0.to_vec() }
}

/// Pseudo-random numbers, reproducible (SplitMix64). The number is the state, at first the seed.
pub struct Random(pub u64);

impl Random {
    /// The next 64 pseudo-random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// The next pseudo-random number, at least 0 and less than 1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}
