//! `brickyard doctor`: this machine's capabilities, and a small volume packed and rendered by every backend as a proof.

use super::session_args::processors;
use super::{Failure, heading, print_json, print_line, store_errors, values};
use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::import::{SynthKind, SynthSource};
use brickyard::memory::available_bytes;
use brickyard::offline::{OfflineError, render_settled};
use brickyard::oracle::render_reference;
use brickyard::render::adapters;
use brickyard::session::{Session, SessionOptions, VolumeSource, resolve};
use brickyard::stats::RenderStats;
use brickyard::store::{PackOptions, Store, pack};
use brickyard::volume::{Extent, Picture, Scene, VoxelType};
use clap::Args;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// `brickyard doctor`
#[derive(Args)]
pub(crate) struct DoctorArguments {
    /// Print JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    version: &'static str,
    processors: usize,
    avx2: bool,
    memory_bytes: Option<u64>,
    adapters: Vec<Adapter>,
    trials: Vec<Trial>,
}

#[derive(Serialize)]
struct Adapter {
    name: String,
    kind: &'static str,
    api: String,
    driver: String,
    max_texture_3d: u32,
    max_buffer_bytes: u64,
    atlas_u8: String,
    atlas_u16: String,
    /// Whether windows on it compare compositors.
    is_compared: bool,
}

/// One backend's attempt at the test picture.
#[derive(Serialize)]
struct Trial {
    backend: &'static str,
    compositor: &'static str,
    ok: bool,
    /// The adapter, or the reason for the failure.
    detail: String,
    frame_ms: f64,
}

/// Runs `doctor`.
///
/// # Errors
/// If no backend renders the test picture correctly, or the test volume cannot be packed.
pub(crate) fn run(arguments: &DoctorArguments) -> Result<(), Failure> {
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        processors: processors(),
        avx2: has_avx2(),
        memory_bytes: available_bytes(),
        adapters: adapters().into_iter().map(adapter).collect(),
        trials: trials()?,
    };
    if arguments.json {
        print_json(&report)?;
    } else {
        print_line(&text(&report))?;
    }
    match report.trials.iter().any(|t| t.ok) {
        true => Ok(()),
        false => Err(Failure::failed("no backend rendered the test picture")),
    }
}

fn adapter(report: brickyard::render::AdapterReport) -> Adapter {
    Adapter {
        is_compared: report.timestamps && !report.is_software(),
        atlas_u8: format!("{:?}", report.formats.atlas_u8),
        atlas_u16: format!("{:?}", report.formats.atlas_u16),
        name: report.name,
        kind: report.kind,
        api: report.backend,
        driver: report.driver,
        max_texture_3d: report.max_texture_3d,
        max_buffer_bytes: report.max_buffer_bytes,
    }
}

const SIZE: (u32, u32) = (128, 128);

/// Packs a small volume and renders it by each backend, compared with the reference.
fn trials() -> Result<Vec<Trial>, Failure> {
    let folder = std::env::temp_dir().join(format!("brickyard-doctor-{}", std::process::id()));
    let result = trials_in(&folder.join("test.zarr"));
    let _ = std::fs::remove_dir_all(&folder);
    result
}

fn trials_in(path: &std::path::Path) -> Result<Vec<Trial>, Failure> {
    let extent = Extent::new(96, 96, 96);
    let source = SynthSource::new(SynthKind::Spheres, extent, VoxelType::U8, 1, 1).map_err(Failure::failed)?;
    let options = PackOptions { edge: 32, ..PackOptions::new(VoxelType::U8) };
    pack(&source, path, &options, &()).map_err(store_errors::pack_failure)?;
    let store = Arc::new(store_errors::open(path)?);
    let scene = Scene::default();
    let resolved = resolve(&[VolumeSource::of_store(&store)], &scene, SIZE).map_err(Failure::failed)?;
    let expected = render_reference(&[&store], &resolved, 1 << 30).map_err(Failure::failed)?;
    let ways = [
        ("gpu", BackendChoice::Gpu, "raycast", CompositorChoice::Raycast),
        ("gpu", BackendChoice::Gpu, "sorted", CompositorChoice::Sorted),
        ("cpu", BackendChoice::Cpu, "raycast", CompositorChoice::Raycast),
    ];
    let all = ways.into_iter().map(|(backend, choice, compositor, by)| {
        let (ok, detail, frame_ms) = trial(choice, by, &store, &scene, &expected);
        Trial { backend, compositor, ok, detail, frame_ms }
    });
    Ok(all.collect())
}

/// Renders the test picture. Returns whether it matches, the adapter or the reason for a failure, and milliseconds.
fn trial(
    backend: BackendChoice,
    compositor: CompositorChoice,
    store: &Arc<Store>,
    scene: &Scene,
    expected: &Picture,
) -> (bool, String, f64) {
    let options = SessionOptions {
        backend,
        compositor,
        gpu_memory_bytes: 64 << 20,
        cpu_memory_bytes: 64 << 20,
        host_memory_bytes: 64 << 20,
        threads: processors(),
        ..SessionOptions::default()
    };
    let mut session = Session::new(vec![VolumeSource::of_store(store)], options);
    let (mut stats, mut frame_ms) = (RenderStats::default(), Vec::new());
    let wait = Duration::from_secs(20);
    let drawn = session
        .resolve(scene, SIZE)
        .map_err(OfflineError::Session)
        .and_then(|resolved| render_settled(&mut session, &resolved, wait, Instant::now(), &mut stats, &mut frame_ms));
    match drawn {
        Err(error) => (false, error.to_string(), 0.0),
        Ok(picture) => {
            let difference = picture.difference(expected);
            let same = difference.max <= 1 || difference.psnr_db >= 50.0;
            let verdict = if same { "matches the reference" } else { "does NOT match the reference" };
            let detail = format!("{}: {verdict} (greatest difference {}/255)", session.backend_line(), difference.max);
            (same, detail, frame_ms[0])
        }
    }
}

fn text(report: &Report) -> String {
    let memory = report.memory_bytes.map_or("unknown".into(), values::human_bytes);
    let avx2 = if report.avx2 { ", AVX2" } else { "" };
    let mut lines = vec![
        format!("brickyard {}", report.version),
        format!("machine: {} processors{avx2}, {memory} of memory", report.processors),
    ];
    if report.adapters.is_empty() {
        lines.push("adapters: none; for a software one install a Vulkan driver (Debian: mesa-vulkan-drivers)".into());
    }
    for adapter in &report.adapters {
        let Adapter { name, kind, api, driver, max_texture_3d, atlas_u8, atlas_u16, .. } = adapter;
        let buffers = values::human_bytes(adapter.max_buffer_bytes);
        lines.push(format!(
            "adapter: {name} ({kind}, {api}, {driver}): 3D textures to {max_texture_3d}, buffers to {buffers}, \
             8-bit bricks as {atlas_u8}, 16-bit as {atlas_u16}"
        ));
    }
    for t in &report.trials {
        let mark = if t.ok { "ok" } else { "FAILED" };
        let time = if t.ok { format!(", {:.1} ms", t.frame_ms) } else { String::new() };
        lines.push(format!("{} test picture ({}): {mark}: {}{time}", t.backend, t.compositor, t.detail));
    }
    lines.push(match report.adapters.iter().find(|adapter| adapter.is_compared) {
        Some(adapter) => format!(
            "compositor: windows on {} draw their first frames by sorted and by raycast, and keep the faster; pictures \
             and movies take raycast",
            adapter.name
        ),
        None => "compositor: raycast (windows on a hardware GPU with timestamps compare sorted with it)".into(),
    });
    lines.join("\n")
}

fn has_avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}
