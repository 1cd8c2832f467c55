//! A volume given by a function, cut into padded bricks on every level, and draw lists over it: what store and pager do,
//! in memory.

use brickyard_pager::{DrawCell, DrawList, Layer, Pixels, Slot, VolumeNeeds};
use brickyard_reference::{Array, ReferenceVolume};
use brickyard_software::{SoftwareOptions, SoftwareRenderer};
use brickyard_volume::*;
use glam::DVec3;
use std::sync::Arc;

/// A volume on all levels: as arrays of values for the oracle, and the same values as codes.
pub(crate) struct Volume {
    pub(crate) pyramid: Pyramid,
    pub(crate) encoding: SlotEncoding,
    pub(crate) levels: Vec<Array>,
    codes: Vec<Vec<u32>>,
}

/// A cell of a cut, and the level whose brick stands for it.
#[derive(Clone, Copy)]
pub(crate) struct CutCell {
    pub(crate) level: Level,
    pub(crate) index: BrickIndex,
    pub(crate) drawn: Level,
}

impl Volume {
    /// Samples `value`, given in voxel space, at the voxel centres of every level; NaN is invalid.
    pub(crate) fn new(
        extent: Extent,
        spacing: DVec3,
        edge: u32,
        encoding: SlotEncoding,
        value: impl Fn(DVec3) -> f64,
    ) -> Self {
        let pyramid = Pyramid::new(extent, spacing.to_array(), edge);
        let max = encoding.format.max_code() as f64;
        let code = |v: f64| {
            let first = encoding.has_invalid as u32 as f64;
            let scaled = (v - encoding.low) / (encoding.high - encoding.low) * max;
            if v.is_nan() { 0 } else { scaled.round().clamp(first, max) as u32 }
        };
        let decode = |c: u32| if encoding.has_invalid && c == 0 { f64::NAN } else { encoding.value(c as f64 / max) };
        let mut codes = Vec::new();
        let mut levels = Vec::new();
        for grid in pyramid.levels() {
            let factor = DVec3::from_array(grid.factor.map(f64::from));
            let centre = |i: [u32; 3]| (DVec3::from_array(i.map(f64::from)) + 0.5) * factor;
            let level = Array::from_fn(grid, |i| code(value(centre(i))) as f64);
            let level_codes: Vec<u32> = level.values.iter().map(|&c| c as u32).collect();
            levels.push(Array { values: level_codes.iter().map(|&c| decode(c)).collect(), ..level });
            codes.push(level_codes);
        }
        Self { pyramid, encoding, levels, codes }
    }

    /// A brick with its apron, the volume's faces replicated, and its gradients if there are to be some.
    fn padded(&self, level: Level, index: BrickIndex, needs: &Needs) -> Arc<[u8]> {
        let apron = needs.apron;
        let (edge, extent) = (self.pyramid.edge() as i64, self.pyramid.level(level).extent);
        let n = extent.to_array();
        let index = index.to_array();
        let along = |a: usize| {
            let start = index[a] as i64 * edge - apron as i64;
            (start..start + edge + 2 * apron as i64).map(move |i| i.clamp(0, n[a] as i64 - 1) as u32)
        };
        let mut bytes = Vec::new();
        for z in along(2) {
            for y in along(1) {
                for x in along(0) {
                    let code = self.codes[level.index()][extent.linear([x, y, z]) as usize];
                    bytes.extend_from_slice(&code.to_le_bytes()[..self.encoding.format.bytes()]);
                }
            }
        }
        let gradients = needs.gradients(edge as u32);
        if gradients.layers > 0 {
            let inside = std::array::from_fn(|a| -(index[a] as i64 * edge)..n[a] as i64 - index[a] as i64 * edge);
            let SlotEncoding { format, has_invalid, .. } = self.encoding;
            let mut nodes = vec![0; gradients.bytes()];
            gradients.fill(PaddedCodes { codes: &bytes, format, has_invalid, apron }, &inside, &mut nodes);
            bytes.extend(nodes);
        }
        bytes.into()
    }

    /// The cells left when `split` has been asked from the coarsest brick on, back to front as `rays` see them; each is
    /// drawn with its own brick.
    pub(crate) fn cut(
        &self,
        rays: &ViewRays,
        geometry: &Geometry,
        split: &dyn Fn(Level, BrickIndex) -> bool,
    ) -> Vec<CutCell> {
        let mut cells = Vec::new();
        let view = View { eye: geometry.voxel_from_world(rays.eye), rays, geometry };
        self.descend(&view, self.pyramid.coarsest(), BrickIndex::default(), split, &mut cells);
        cells
    }

    fn descend(
        &self,
        view: &View<'_>,
        level: Level,
        index: BrickIndex,
        split: &dyn Fn(Level, BrickIndex) -> bool,
        cells: &mut Vec<CutCell>,
    ) {
        if level.0 == 0 || !split(level, index) {
            return cells.push(CutCell { level, index, drawn: level });
        }
        let finer = Level(level.0 - 1);
        let mut children: Vec<BrickIndex> = self.pyramid.children(level, index).collect();
        let near = self.pyramid.brick_box_voxel(finer, children[0]).max.to_array();
        // A child comes after those that lie on the far side of more of the planes that part the children.
        children.sort_by_key(|child| {
            let low = self.pyramid.brick_box_voxel(finer, *child).min.to_array();
            let far = |a: usize| view.sees_high_side_first(a, near[a] as f64) != (low[a] >= near[a]);
            std::cmp::Reverse((0..3).filter(|&a| far(a)).count())
        });
        for child in children {
            self.descend(view, finer, child, split, cells);
        }
    }

    /// A renderer that holds the bricks of the cut for a frame, and its draw list.
    pub(crate) fn load(&self, cut: &[CutCell], frame: &FrameSettings, threads: usize) -> (SoftwareRenderer, DrawList) {
        let mut renderer = renderer(&[self.needs(&frame.needs())], &frame.rays, threads);
        let (bricks, list) = self.bricks(cut, &frame.needs());
        for (slot, codes) in bricks.into_iter().enumerate() {
            renderer.upload(0, Slot(slot as u32), codes);
        }
        (renderer, list)
    }

    /// The padded bricks of the cut, slot by slot, and its draw list.
    pub(crate) fn bricks(&self, cut: &[CutCell], needs: &Needs) -> (Vec<Arc<[u8]>>, DrawList) {
        let mut bricks: Vec<BrickId> = cut.iter().map(|c| self.brick(c)).collect();
        bricks.sort();
        bricks.dedup();
        let (mut last, mut rank) = (None, 0);
        let draw = |c: &CutCell| {
            let brick = self.brick(c);
            let cell = BrickId { level: c.level, index: c.index, ..brick };
            rank += last.replace(cell).is_some_and(|last| last != cell) as u32;
            DrawCell {
                cell,
                region: self.pyramid.brick_box_voxel(c.level, c.index),
                pixels: Pixels::ALL,
                brick,
                slot: Slot(bricks.binary_search(&brick).unwrap() as u32),
                rank,
            }
        };
        let padded = bricks.iter().map(|id| self.padded(id.level, id.index, needs)).collect();
        (padded, DrawList { cells: cut.iter().map(draw).collect() })
    }

    fn brick(&self, c: &CutCell) -> BrickId {
        let index = self.pyramid.ancestor(c.level, c.index, c.drawn);
        BrickId { time: 0, channel: 0, level: c.drawn, index }
    }

    /// The picture of the cut.
    pub(crate) fn render(&self, frame: &FrameSettings, cut: &[CutCell], threads: usize) -> Picture {
        let (mut renderer, list) = self.load(cut, frame, threads);
        self.draw(&mut renderer, frame, &list)
    }

    /// The picture of a list over the bricks that a renderer holds.
    pub(crate) fn draw(&self, renderer: &mut SoftwareRenderer, frame: &FrameSettings, draw: &DrawList) -> Picture {
        let frame = &VolumeFrame::alone(frame.clone());
        renderer.render(&[Layer { volume: 0, frame, pyramid: &self.pyramid, draw, cut: 0 }], None)
    }

    /// What the volume needs of a renderer, whose bricks need so much.
    pub(crate) fn needs(&self, bricks: &Needs) -> VolumeNeeds {
        VolumeNeeds {
            encoding: self.encoding,
            edge: self.pyramid.edge(),
            levels: self.pyramid.levels().len() as u32,
            bricks: *bricks,
            least_slots: 1,
            most_slots: self.pyramid.brick_count() as u32,
        }
    }

    /// The level that is drawn at a place, in voxels.
    pub(crate) fn level_at(&self, cut: &[CutCell]) -> impl Fn(DVec3) -> usize + use<> {
        let boxes: Vec<(VoxelBox, usize)> =
            cut.iter().map(|c| (self.pyramid.brick_box_voxel(c.level, c.index), c.drawn.index())).collect();
        let extent = self.pyramid.levels()[0].extent.to_array();
        move |p: DVec3| {
            // Rounding may put the last sample of a ray a hair outside.
            let voxel: [u32; 3] = std::array::from_fn(|a| (p[a].max(0.0) as u32).min(extent[a] - 1));
            let holds = |b: &VoxelBox| {
                let (min, max) = (b.min.to_array(), b.max.to_array());
                (0..3).all(|a| min[a] <= voxel[a] && voxel[a] < max[a])
            };
            boxes.iter().find(|(b, _)| holds(b)).expect("a cut covers the volume").1
        }
    }

    /// The oracle's picture of the cut.
    pub(crate) fn reference(&self, frame: &FrameSettings, cut: &[CutCell], transfer: &TransferFunction) -> Picture {
        let level_at = self.level_at(cut);
        let volume = ReferenceVolume { levels: &self.levels, level_at: &level_at, transfer };
        brickyard_reference::render(&[VolumeFrame::alone(frame.clone())], &[volume], None)
    }
}

/// A renderer of layers with room for all that they have.
pub(crate) fn renderer(layers: &[VolumeNeeds], rays: &ViewRays, threads: usize) -> SoftwareRenderer {
    let max_picture_px = [rays.width, rays.height];
    let options = SoftwareOptions { memory_bytes: 1 << 30, max_picture_px, threads, leaps: true };
    SoftwareRenderer::new(layers, &options).expect("a gibibyte is enough")
}

struct View<'a> {
    eye: DVec3,
    rays: &'a ViewRays,
    geometry: &'a Geometry,
}

impl View<'_> {
    /// Whether rays that cross the plane at `at` come from its high side.
    fn sees_high_side_first(&self, axis: usize, at: f64) -> bool {
        if self.rays.orthographic {
            (self.rays.forward / self.geometry.spacing)[axis] < 0.0
        } else {
            self.eye[axis] >= at
        }
    }
}
