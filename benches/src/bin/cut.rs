//! The octree cut of a volume of 4096³ voxels, on one thread: from scratch, and from the last cut while the camera moves.
//!
//! ```text
//! cold    Cut::new for each view
//! orbit   Cut::next for each view of a camera that goes around the volume in 360 views
//! fly     the same, from outside to the volume's centre in 360 views
//! ```
//!
//! Each at a number of slots. The target is half a pixel of 1920x1080, too fine for the slots: the cuts are memory bound, so that
//! views exchange cells. No brick is read. Prints a Markdown table, then one line of JSON.

use brickyard_benches::{markdown, median, time};
use brickyard_pager::{BrickError, BrickSource, Cut, View, cut_capacity};
use brickyard_volume::{
    BrickId, Camera, Extent, Filter, Geometry, LevelPolicy, Occupancy, Placement, Pyramid, VoxelType,
};
use clap::Parser;
use serde_json::json;

/// The octree cut of a large volume, cold and while the camera moves
#[derive(Parser)]
struct Arguments {
    /// Voxels along each axis
    #[arg(long, default_value_t = 4096)]
    extent: u32,
    /// Numbers of slots
    #[arg(long, value_delimiter = ',', default_value = "4096,32768")]
    slots: Vec<u32>,
    /// Views of a flight
    #[arg(long, default_value_t = 360)]
    views: u32,
    /// Largest error in pixels
    #[arg(long, default_value_t = 0.5)]
    pixel_error: f64,
}

/// A volume's shape alone.
struct Shape {
    pyramid: Pyramid,
    geometry: Geometry,
}

impl BrickSource for Shape {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }
    fn voxel_type(&self) -> VoxelType {
        VoxelType::U8
    }
    fn value_range(&self) -> (f64, f64) {
        (0.0, 255.0)
    }
    fn read_core(&self, id: BrickId, _: &mut [u8]) -> Result<(), BrickError> {
        Err(BrickError { id, reason: "there are no voxels".into(), is_passing: false })
    }
}

/// Name, whether each cut is made from the last, and the views.
type Flight<'a> = (&'a str, bool, &'a dyn Fn(u32) -> View);

fn main() {
    let Arguments { extent, slots, views, pixel_error } = Arguments::parse();
    let pyramid = Pyramid::new(Extent::new(extent, extent, extent), [1.0; 3], 64);
    let shape = Shape { pyramid, geometry: Geometry::default() };
    let world = shape.geometry.world_box(shape.pyramid.levels()[0].extent);
    let first = Camera::looking_at_box(world);
    let view = |camera: Camera| {
        let rays = camera.rays(1920, 1080).expect("the camera makes a picture");
        View {
            rays,
            other_eye: None,
            opaque: Some(Occupancy::ALL),
            caps: None,
            filter: Filter::Trilinear,
            level: LevelPolicy::Auto,
            pixel_error,
            time: 0,
            channel: 0,
            clip: None,
            placement: Placement::default(),
            appearance: 0,
            window: None,
        }
    };
    let orbit = |i: u32| view(first.orbited(360.0 * i as f64 / views as f64));
    let fly = |i: u32| {
        let way = (first.target - first.eye) * (i as f64 / views as f64);
        view(Camera { eye: first.eye + way, target: first.target + way, ..first })
    };
    let flights: [Flight<'_>; 3] = [("cold", false, &orbit), ("orbit", true, &orbit), ("fly", true, &fly)];
    let (mut rows, mut cases) = (Vec::new(), Vec::new());
    for &slots in &slots {
        let max_cells = cut_capacity(slots, 1);
        for (name, incremental, at) in flights {
            let mut cut = Cut::new(&shape, &at(0), max_cells);
            let (mut ms, mut cells) = (Vec::new(), Vec::new());
            for i in 1..=views {
                let view = at(i);
                let make = || {
                    if incremental { cut.next(&shape, &view, max_cells) } else { Cut::new(&shape, &view, max_cells) }
                };
                let (timing, next) = time(make);
                ms.push(timing.cpu_s * 1e3);
                cells.push(next.wanted() as f64);
                cut = next;
            }
            let (middle, worst) = (median(ms.iter().copied()), ms.iter().copied().fold(0.0, f64::max));
            let cells = median(cells);
            rows.push(vec![
                name.into(),
                slots.to_string(),
                format!("{cells:.0}"),
                format!("{middle:.3}"),
                format!("{worst:.3}"),
            ]);
            cases.push(json!({ "case": name, "slots": slots, "cells": cells, "median_ms": middle, "worst_ms": worst }));
        }
    }
    print!("{}", markdown(&["case", "slots", "cells", "median CPU ms", "worst"], &rows));
    println!("{}", json!({ "extent": extent, "views": views, "cases": cases }));
}
