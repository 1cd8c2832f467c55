//! The cost of an edit of the transfer function, beside a frame: a store's view is redrawn with the same function and with another
//! one, in turn.
//!
//! ```text
//! frame    resolve, step and draw with the function of the frame before, whose table is there
//! table    resolving with another function: its table is made, and what is opaque looked for. What `Session::prepare` has a thread do
//! edit     what step and draw take longer then: the table is turned into what the renderer looks up, and uploaded
//! ```
//!
//! An edit is measured on a picture of 16 x 16 pixels, cheap enough not to hide the difference. The two functions differ in colour,
//! and by 1/1000 in opacity: the edit skips no work, and both take the same samples. An uploaded brick is an error.
//!
//! Another edit reveals: a session that shows only values above the middle of the window gets the whole function. Invisible bricks
//! were not fetched; this edit uploads them, and the picture is first drawn without:
//!
//! ```text
//! bricks   uploaded for the first view, and by the edit
//! first    wall time from the edit to its first picture
//! settled  wall time from the edit to the picture that has all bricks
//! ```
//!
//! Prints two Markdown tables, then one line of JSON.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::offline::render_settled;
use brickyard::session::{Session, SessionOptions, VolumeSource};
use brickyard::stats::RenderStats;
use brickyard_benches::{Timing, markdown, median, time};
use brickyard_store::Store;
use brickyard_volume::{Scene, TransferChoice, TransferFunction};
use clap::Parser;
use serde::Serialize;
use serde_json::json;
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The cost of an edit of the transfer function, beside a frame's
#[derive(Parser)]
struct Arguments {
    /// A packed store
    store: PathBuf,
    /// Preset of the edited function
    #[arg(long, default_value = "viridis")]
    transfer: String,
    /// Pixels along each side
    #[arg(long, default_value_t = 512)]
    size: u32,
    /// Edits
    #[arg(long, default_value_t = 15)]
    edits: usize,
    /// Threads of the CPU backend
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

/// Pixels along each side of the picture for the cost of an edit.
const TINY: u32 = 16;

const WAYS: [(&str, BackendChoice, CompositorChoice); 3] = [
    ("cpu raycast", BackendChoice::Cpu, CompositorChoice::Raycast),
    ("gpu raycast", BackendChoice::Gpu, CompositorChoice::Raycast),
    ("gpu sorted", BackendChoice::Gpu, CompositorChoice::Sorted),
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let store = Arc::new(Store::open(&arguments.store)?);
    let scenes = scenes(&store, &arguments.transfer)?;
    let (mut rows, mut revealed, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    for (name, backend, compositor) in WAYS {
        let options = SessionOptions {
            backend,
            compositor,
            gpu_memory_bytes: 1 << 30,
            cpu_memory_bytes: 1 << 30,
            host_memory_bytes: 1 << 30,
            threads: arguments.threads,
            skips_empty: true,
            keeps_decoded: true,
            live: false,
        };
        let open = || Session::new(vec![VolumeSource::of_store(&store)], options);
        let mut session = open();
        if let Err(error) = session.step(&scenes[0], (arguments.size, arguments.size)) {
            eprintln!("{name} is left out: {error}");
            continue;
        }
        let whole = measure(&mut session, &scenes, arguments.size, arguments.edits)?;
        let tiny = measure(&mut session, &scenes, TINY, 4 * arguments.edits)?;
        let frame = median(whole.iter().map(|turn| turn.frame.cpu_s * 1e3));
        let table = median(whole.iter().map(|turn| turn.table.cpu_s * 1e3));
        let edit = median(tiny.iter().map(|turn| (turn.edit.cpu_s - turn.frame.cpu_s) * 1e3));
        let share = (table + edit) / frame;
        let ms = |v: f64| format!("{v:.2}");
        rows.push(vec![name.into(), ms(frame), ms(table), ms(edit), format!("{:.1} %", share * 100.0)]);
        let reveal = reveal(open(), &scenes[0], arguments.size)?;
        let Reveal { bricks_before, bricks, first_ms, settled_ms } = &reveal;
        revealed.push(vec![name.into(), bricks_before.to_string(), bricks.to_string(), ms(*first_ms), ms(*settled_ms)]);
        lines.push(json!({ "way": name, "frame_cpu_ms": frame, "table_cpu_ms": table, "edit_cpu_ms": edit,
            "edit_over_frame": share, "reveal": reveal }));
    }
    println!("{}", markdown(&["", "frame, CPU ms", "the table", "an edit adds", "both, of a frame"], &rows));
    let titles = ["an edit that reveals", "bricks before", "uploaded by the edit", "first picture, ms", "settled, ms"];
    println!("{}", markdown(&titles, &revealed));
    println!("{}", json!(lines));
    Ok(())
}

/// Bricks and times of an edit that reveals hidden values.
#[derive(Serialize)]
struct Reveal {
    bricks_before: u64,
    bricks: u64,
    first_ms: f64,
    settled_ms: f64,
}

fn reveal(mut session: Session, whole: &Scene, size: u32) -> Result<Reveal, Box<dyn Error>> {
    let (size_px, patience) = ((size, size), Duration::from_secs(600));
    let mut stats = RenderStats::default();
    let hidden = session.resolve(&upper_half(whole)?, size_px)?;
    render_settled(&mut session, &hidden, patience, Instant::now(), &mut stats, &mut Vec::new())?;
    let (bricks_before, edited) = (stats.bricks.uploaded, Instant::now());
    draw(&mut session, whole, size_px, &mut stats)?;
    let first_ms = edited.elapsed().as_secs_f64() * 1e3;
    let resolved = session.resolve(whole, size_px)?;
    render_settled(&mut session, &resolved, patience, edited, &mut stats, &mut Vec::new())?;
    let settled_ms = edited.elapsed().as_secs_f64() * 1e3;
    let bricks = stats.bricks.uploaded - bricks_before;
    if bricks == 0 {
        return Err("the edit revealed nothing: choose another store or function".into());
    }
    Ok(Reveal { bricks_before, bricks, first_ms, settled_ms })
}

/// A scene that shows only values above the middle of its function's range.
fn upper_half(scene: &Scene) -> Result<Scene, Box<dyn Error>> {
    let Some(TransferChoice::Function(mut function)) = scene.layers[0].transfer.clone() else {
        return Err("no function".into());
    };
    let points = &function.opacity;
    let (Some([low, _]), Some([high, _])) = (points.first(), points.last()) else { return Err("no opacity".into()) };
    let middle = 0.5 * (low + high);
    let above = points.iter().filter(|[value, _]| *value > middle);
    function.opacity = [[*low, 0.0], [middle, 0.0]].iter().chain(above).copied().collect();
    Ok(Scene::of(function))
}

/// The same view under two functions.
fn scenes(store: &Arc<Store>, preset: &str) -> Result<[Scene; 2], Box<dyn Error>> {
    let subject = VolumeSource::of_store(store).subject(0);
    let first = TransferFunction::preset(preset, subject.window, subject.unit_distance)?;
    let mut second = first.clone();
    second.color.iter_mut().for_each(|[_, r, _, b]| std::mem::swap(r, b));
    second.opacity.iter_mut().for_each(|[_, alpha]| *alpha *= 0.999);
    Ok([first, second].map(Scene::of))
}

/// Costs of a frame, and of the next one with another function.
struct Turn {
    frame: Timing,
    edit: Timing,
    table: Timing,
}

fn measure(session: &mut Session, scenes: &[Scene; 2], size: u32, turns: usize) -> Result<Vec<Turn>, Box<dyn Error>> {
    let size_px = (size, size);
    let resolved = session.resolve(&scenes[0], size_px)?;
    let mut stats = RenderStats::default();
    render_settled(session, &resolved, Duration::from_secs(600), Instant::now(), &mut stats, &mut Vec::new())?;
    let uploaded = stats.bricks.uploaded;
    let turn = |i: usize| {
        let (old, new) = (&scenes[i % 2], &scenes[(i + 1) % 2]);
        let (frame, drawn) = time(|| draw(session, old, size_px, &mut stats));
        drawn?;
        let (table, resolved) = time(|| session.resolve(new, size_px));
        resolved?;
        let (edit, drawn) = time(|| draw(session, new, size_px, &mut stats));
        drawn?;
        Ok(Turn { frame, edit, table })
    };
    let turns = (0..turns).map(turn).collect::<Result<Vec<Turn>, Box<dyn Error>>>()?;
    if stats.bricks.uploaded != uploaded {
        return Err(format!("edits uploaded {} bricks", stats.bricks.uploaded - uploaded).into());
    }
    Ok(turns)
}

fn draw(
    session: &mut Session,
    scene: &Scene,
    size_px: (u32, u32),
    stats: &mut RenderStats,
) -> Result<(), Box<dyn Error>> {
    let resolved = session.resolve(scene, size_px)?;
    let frame = session.step_resolved(&resolved)?;
    stats.record(&frame.status, session.backend_bytes());
    session.draw(&frame)?;
    Ok(())
}
