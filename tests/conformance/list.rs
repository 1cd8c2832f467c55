//! Draw lists, as from a pager: the cells of a cut in back-to-front order for rays, with their bricks.

use crate::volume::Volume;
use brickyard_pager::{DrawCell, DrawList, PixelShare};
use brickyard_volume::*;
use glam::DVec3;

/// A cell's entry: levels up to the drawn ancestor, and pixels.
pub(crate) type Entry = (u8, PixelShare);

/// The cell's own brick.
pub(crate) const OWN: Entry = (0, PixelShare::ALL);

/// All finest bricks of a volume.
pub(crate) fn finest(volume: &Volume, frame: &FrameSettings) -> DrawList {
    list(volume, frame, &|_| false, &|_| vec![OWN])
}

/// The cells selected by `stop`, in order, with their entries.
pub(crate) fn list(
    volume: &Volume,
    frame: &FrameSettings,
    stop: &dyn Fn(BrickId) -> bool,
    entries: &dyn Fn(BrickId) -> Vec<Entry>,
) -> DrawList {
    let (pyramid, placement) = (&volume.pyramid, &frame.placement);
    let mut cells = Vec::new();
    let view = View {
        pyramid,
        eye: frame.geometry.voxel_from_world(placement.volume_from_world(frame.rays.eye)),
        parallel: frame.rays.orthographic.then(|| placement.volume_vector(frame.rays.middle())),
        stop,
    };
    let top = pyramid.coarsest();
    view.descend(BrickId { time: 0, channel: 0, level: top, index: BrickIndex::default() }, &mut cells);
    let draw = |(rank, cell): (u32, BrickId)| {
        let region = pyramid.brick_box_voxel(cell.level, cell.index);
        entries(cell).into_iter().map(move |(coarser, pixels)| {
            let level = Level((cell.level.0 + coarser).min(top.0));
            let brick = BrickId { level, index: pyramid.ancestor(cell.level, cell.index, level), ..cell };
            DrawCell { cell, region, pixels, brick, slot: volume.slot(brick), rank }
        })
    };
    DrawList { cells: (0..).zip(cells).flat_map(draw).collect() }
}

/// Origin of the view, in voxel space.
struct View<'a> {
    pyramid: &'a Pyramid,
    eye: DVec3,
    /// The common direction of all rays, in parallel views.
    parallel: Option<DVec3>,
    stop: &'a dyn Fn(BrickId) -> bool,
}

impl View<'_> {
    /// At each splitting plane, the half nearer to the rays' origin comes last.
    fn descend(&self, id: BrickId, cells: &mut Vec<BrickId>) {
        if id.level.0 == 0 || (self.stop)(id) {
            return cells.push(id);
        }
        let level = Level(id.level.0 - 1);
        let mut children: Vec<BrickIndex> = self.pyramid.children(id.level, id.index).collect();
        let planes = self.pyramid.brick_box_voxel(level, children[0]).max.to_array();
        children.sort_by_key(|child| {
            let low = self.pyramid.brick_box_voxel(level, *child).min.to_array();
            (0..3).filter(|&a| self.sees_high_side_first(a, planes[a] as f64) == (low[a] >= planes[a])).count()
        });
        for index in children {
            self.descend(BrickId { level, index, ..id }, cells);
        }
    }

    fn sees_high_side_first(&self, axis: usize, at: f64) -> bool {
        match self.parallel {
            Some(way) => way[axis] < 0.0,
            None => self.eye[axis] >= at,
        }
    }
}
