//! `brickyard mesh`: an isosurface, or the borders of labels, to a file of triangles.

use super::channel_args::{channel_of, check_labels};
use super::interrupt::Interrupt;
use super::output::may_write_mesh;
use super::progress::{Progress, ProgressStyleArgument};
use super::say::say;
use super::{Failure, heading, print_json, store_errors, values};
use brickyard::extract::{self, MeshRequest, MeshSurface};
use brickyard::session::VolumeSource;
use brickyard::volume::{Level, VoxelBox};
use clap::{ArgGroup, Args};
use serde::Serialize;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// `brickyard mesh STORE OUT --isovalue V | --label N`
#[derive(Args)]
#[command(group(ArgGroup::new("surface").required(true)))]
pub(crate) struct MeshArguments {
    /// The store
    store: PathBuf,
    /// The output: .stl, .ply, .obj or .glb
    output: PathBuf,
    /// The border of all values of at least this
    #[arg(help_heading = heading::READ, long, value_name = "VALUE", allow_hyphen_values = true, group = "surface")]
    isovalue: Option<f64>,
    /// The border of one label; or of all but the background, an object for each (.obj, .glb)
    #[arg(help_heading = heading::READ, long, value_name = "N|all", allow_hyphen_values = true, group = "surface")]
    label: Option<LabelChoice>,
    /// Iterations of smoothing, up to 20. Isosurfaces keep their volume; borders of labels stay within half a voxel, and
    /// those of neighbours stay the same
    #[arg(help_heading = heading::READ, long, value_name = "N", default_value_t = 0)]
    smooth: u32,
    /// Fewer triangles: vertices go as long as each stays within so many voxels of the mesh, up to 4. At 0.1, some 12% of
    /// a smooth surface's triangles stay; neighbouring labels still share their border [default: all triangles stay]
    #[arg(help_heading = heading::READ, long, value_name = "VOXELS", allow_hyphen_values = true)]
    decimate: Option<f64>,
    /// Level; 0 is the finest
    #[arg(help_heading = heading::READ, long, default_value_t = 0)]
    level: u8,
    /// Box in voxels of that level, ends excluded; the surface is closed at its sides [default: the whole level]
    #[arg(help_heading = heading::READ, long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = values::voxel_box)]
    roi: Option<VoxelBox>,
    /// Time step
    #[arg(help_heading = heading::READ, long, default_value_t = 0)]
    time: u32,
    /// Channel by number or name [default: 0]
    #[arg(help_heading = heading::READ, long)]
    channel: Option<String>,
    /// Limit of the process's own memory
    #[arg(help_heading = heading::WORK, long, value_name = "BYTES", default_value = "1GiB", value_parser = values::bytes)]
    memory: u64,
    /// Replace an existing file
    #[arg(help_heading = heading::OUTPUT, long)]
    overwrite: bool,
    /// Print counts, areas and volumes as JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
    /// How to show progress
    #[arg(help_heading = heading::WORK, long, value_enum, default_value_t)]
    progress: ProgressStyleArgument,
}

/// The labels to extract.
#[derive(Clone, Copy, Debug, PartialEq)]
enum LabelChoice {
    One(i64),
    All,
}

impl FromStr for LabelChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let one = |_| format!("'{text}': expected a label, a whole number, or all");
        if text == "all" { Ok(Self::All) } else { text.parse().map(Self::One).map_err(one) }
    }
}

/// The output of `mesh --json`.
#[derive(Serialize)]
struct Written<'a> {
    /// Unit of lengths; areas and volumes are in its powers.
    unit: Option<&'a str>,
    objects: Vec<Object>,
}

#[derive(Serialize)]
struct Object {
    #[serde(skip_serializing_if = "Option::is_none")]
    label: Option<i64>,
    vertices: u64,
    triangles: u64,
    area: f64,
    volume: f64,
}

/// Runs `mesh`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &MeshArguments) -> Result<(), Failure> {
    may_write_mesh(&arguments.output, arguments.overwrite)?;
    let store = Arc::new(store_errors::open(&arguments.store)?);
    let surface = match (arguments.isovalue, arguments.label) {
        (_, Some(LabelChoice::All)) => MeshSurface::Labels,
        (_, Some(LabelChoice::One(label))) => MeshSurface::Label(label),
        (Some(value), None) => MeshSurface::Isosurface(value),
        (None, None) => return Err(Failure::usage("no surface: give --isovalue or --label")),
    };
    let channel = arguments.channel.as_deref().map_or(Ok(0), |text| channel_of(text, &store))?;
    if let MeshSurface::Label(label) = surface {
        check_labels("--label", &[label], &VolumeSource::of_store(&store), channel)?;
    }
    let request = MeshRequest {
        surface,
        level: Level(arguments.level),
        time: arguments.time,
        channel,
        region: arguments.roi,
        smoothing: arguments.smooth,
        decimation_voxels: arguments.decimate,
        overwrite: arguments.overwrite,
        memory_bytes: arguments.memory,
    };
    let interrupt = Interrupt::watch()?;
    let progress = Progress::new(arguments.progress, "mesh");
    let written = extract::mesh(&store, &arguments.output, &request, |done, total| {
        progress.set(done, total);
        interrupt.flow()
    });
    progress.finish();
    let report = written.map_err(store_errors::mesh_failure)?;
    if arguments.json {
        let object = |object: &extract::MeshObject| {
            let extract::MeshObject { label, vertices, triangles, area, volume } = *object;
            Object { label, vertices, triangles, area, volume }
        };
        return print_json(&Written {
            unit: extract::length_unit(&store),
            objects: report.objects.iter().map(object).collect(),
        });
    }
    say!("{}: {}", arguments.output.display(), report.in_words(&store));
    Ok(())
}
