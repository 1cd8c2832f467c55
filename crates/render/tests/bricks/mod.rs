//! A volume cut into padded bricks in memory, with the same values as whole arrays for the oracle.

use brickyard_pager::{DrawCell, DrawList, Layer, Pixels, Slot, VolumeNeeds};
use brickyard_reference::{Array, ReferenceVolume, mean_levels};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use std::collections::BTreeMap;

#[path = "../../../../tests/support/missing.rs"]
#[expect(unreachable_pub, reason = "the whole-system tests have it in a library")]
pub(crate) mod missing;

/// Enough for every mode.
pub(crate) const NEEDS: Needs = Needs { apron: 2, ..Needs::PLAIN };
pub(crate) const MEMORY_BYTES: u64 = 64 << 20;

/// Which slots a volume's bricks go to.
#[derive(Clone, Copy)]
pub(crate) struct Into {
    /// The layer that they are uploaded for.
    pub(crate) layer: usize,
    /// The first slot, and how far apart they are.
    pub(crate) first: u32,
    pub(crate) step: u32,
}

/// Those of the only layer.
pub(crate) const ALONE: Into = Into { layer: 0, first: 0, step: 1 };

/// Pictures of one volume in its own world.
pub(crate) trait RenderOne {
    fn render_one(&mut self, frame: &FrameSettings, pyramid: &Pyramid, draw: &DrawList) -> Result<Picture, GpuError>;
}

impl RenderOne for GpuRenderer {
    fn render_one(&mut self, frame: &FrameSettings, pyramid: &Pyramid, draw: &DrawList) -> Result<Picture, GpuError> {
        let frame = VolumeFrame { settings: frame.clone(), blend: Blend::Mix, opacity: 1.0 };
        self.render(&[Layer { volume: 0, frame: &frame, pyramid, draw, cut: 0 }], None)
    }
}

/// A volume whose level arrays hold exactly what its slot codes stand for.
pub(crate) struct Bricks {
    pub(crate) pyramid: Pyramid,
    pub(crate) geometry: Geometry,
    pub(crate) encoding: SlotEncoding,
    pub(crate) levels: Vec<Array>,
    codes: Vec<Vec<u16>>,
    /// What they have.
    pub(crate) needs: Needs,
}

impl Bricks {
    /// Level 0 from a function of the voxel; coarser levels are means, rounded to codes.
    pub(crate) fn new(
        extent: [u32; 3],
        edge: u32,
        geometry: Geometry,
        encoding: SlotEncoding,
        f: impl Fn([u32; 3]) -> f64,
    ) -> Self {
        let pyramid = Pyramid::new(Extent::from_array(extent), geometry.spacing.to_array(), edge);
        let max = encoding.format.max_code() as f64;
        let mut levels = mean_levels(&pyramid, Array::from_fn(&pyramid.levels()[0], f));
        let mut codes = Vec::new();
        for level in &mut levels {
            let first = encoding.has_invalid as u32 as f64;
            let code = |v: &f64| match v.is_finite() {
                true => ((v - encoding.low) / encoding.code_width()).round().clamp(first, max) as u16,
                false => 0,
            };
            let level_codes: Vec<u16> = level.values.iter().map(code).collect();
            for (value, code) in level.values.iter_mut().zip(&level_codes) {
                let is_invalid = encoding.has_invalid && *code == 0;
                *value = if is_invalid { f64::NAN } else { encoding.value(*code as f64 / max) };
            }
            codes.push(level_codes);
        }
        Self { pyramid, geometry, encoding, levels, codes, needs: NEEDS }
    }

    /// A brick with its apron, and its gradients if there are to be some.
    pub(crate) fn padded(&self, id: BrickId) -> Vec<u8> {
        let (edge, apron, level) = (self.pyramid.edge(), self.needs.apron, id.level.index());
        let (n, index) = (self.levels[level].extent.to_array(), id.index.to_array());
        let at = |a: usize, i: u32| ((index[a] * edge + i) as i64 - apron as i64).clamp(0, n[a] as i64 - 1) as u32;
        let mut bytes = Vec::new();
        let padded = edge + 2 * apron;
        for z in 0..padded {
            for y in 0..padded {
                for x in 0..padded {
                    let voxel = self.levels[level].extent.linear([at(0, x), at(1, y), at(2, z)]);
                    let code = self.codes[level][voxel as usize].to_le_bytes();
                    bytes.extend_from_slice(&code[..self.encoding.format.bytes()]);
                }
            }
        }
        let gradients = self.needs.gradients(edge);
        if gradients.layers > 0 {
            let first = index.map(|i| (i * edge) as i64);
            let inside = std::array::from_fn(|a| -first[a]..n[a] as i64 - first[a]);
            let SlotEncoding { format, has_invalid, .. } = self.encoding;
            let mut nodes = vec![0; gradients.bytes()];
            gradients.fill(PaddedCodes { codes: &bytes, format, has_invalid, apron }, &inside, &mut nodes);
            bytes.extend(nodes);
        }
        bytes
    }

    /// What a renderer has to know of it.
    pub(crate) fn volume_needs(&self) -> VolumeNeeds {
        VolumeNeeds {
            encoding: self.encoding,
            edge: self.pyramid.edge(),
            levels: self.pyramid.levels().len() as u32,
            bricks: self.needs,
            least_slots: 2,
            most_slots: self.pyramid.brick_count() as u32,
        }
    }

    /// A renderer with each compositor; none (said loudly) where there is no adapter at all.
    pub(crate) fn renderers(&self) -> Vec<GpuRenderer> {
        [Compositor::Sorted, Compositor::Raycast].into_iter().filter_map(|c| self.renderer(c)).collect()
    }

    /// A renderer, or `None` (said loudly) where there is no adapter at all.
    fn renderer(&self, compositor: Compositor) -> Option<GpuRenderer> {
        let options = GpuOptions { compositor, ..Default::default() };
        let made = GpuRenderer::new(&options, &[self.volume_needs()], MEMORY_BYTES, (512, 512));
        match made {
            Ok(renderer) => Some(renderer),
            Err(GpuError::NoAdapter { .. }) => {
                missing::leave_out("gpu", "nothing of the GPU backend was tested here");
                None
            }
            Err(other) => panic!("{other}"),
        }
    }

    /// The cells where `stop` says so, back to front, drawn with the ancestor `coarser` levels up; their bricks uploaded.
    pub(crate) fn draw(
        &self,
        renderer: &mut GpuRenderer,
        rays: &ViewRays,
        stop: &dyn Fn(BrickId) -> bool,
        coarser: &dyn Fn(BrickId) -> u8,
    ) -> DrawList {
        self.draw_fading(renderer, ALONE, rays, stop, &|cell| [(coarser(cell), Pixels::ALL)].into())
    }

    /// The cells where `stop` says so, back to front, each drawn with the ancestors so many levels up that `entries` names, in
    /// those pixels; their bricks uploaded.
    pub(crate) fn draw_fading(
        &self,
        renderer: &mut GpuRenderer,
        into: Into,
        rays: &ViewRays,
        stop: &dyn Fn(BrickId) -> bool,
        entries: &dyn Fn(BrickId) -> Vec<(u8, Pixels)>,
    ) -> DrawList {
        let mut cells = Vec::new();
        let top = self.pyramid.coarsest();
        self.visit(BrickId { time: 0, channel: 0, level: top, index: BrickIndex::default() }, rays, stop, &mut cells);
        let mut slots = BTreeMap::new();
        let mut list = DrawList::default();
        for (rank, cell, (coarser, pixels)) in
            (0..).zip(cells).flat_map(|(rank, cell)| entries(cell).into_iter().map(move |e| (rank, cell, e)))
        {
            let level = Level((cell.level.0 + coarser).min(top.0));
            let brick = BrickId { level, index: self.pyramid.ancestor(cell.level, cell.index, level), ..cell };
            let next = Slot(into.first + into.step * slots.len() as u32);
            let slot = *slots.entry(brick).or_insert_with(|| {
                renderer.upload(into.layer, next, &self.padded(brick)).expect("upload");
                next
            });
            let region = self.pyramid.brick_box_voxel(cell.level, cell.index);
            list.cells.push(DrawCell { cell, region, pixels, brick, slot, rank });
        }
        list
    }

    /// Octree traversal: of the halves at each splitting plane the one on the eye's side comes last.
    fn visit(&self, id: BrickId, rays: &ViewRays, stop: &dyn Fn(BrickId) -> bool, out: &mut Vec<BrickId>) {
        if id.level.0 == 0 || stop(id) {
            return out.push(id);
        }
        let eye = self.geometry.voxel_from_world(rays.eye);
        let mut children: Vec<_> = self.pyramid.children(id.level, id.index).collect();
        let level = Level(id.level.0 - 1);
        let first = self.pyramid.brick_box_voxel(level, children[0]);
        let on_eyes_side = |index: &BrickIndex| {
            let region = self.pyramid.brick_box_voxel(level, *index);
            (0..3)
                .filter(|&a| {
                    let plane = first.max.to_array()[a] as f64;
                    let eye_is_low = if rays.orthographic { rays.forward[a] > 0.0 } else { eye[a] < plane };
                    eye_is_low == (region.min.to_array()[a] < first.max.to_array()[a])
                })
                .count()
        };
        children.sort_by_key(on_eyes_side);
        for index in children {
            self.visit(BrickId { level, index, ..id }, rays, stop, out);
        }
    }

    pub(crate) fn settings(
        &self,
        rays: ViewRays,
        mode: Mode,
        transfer: &TransferFunction,
        lattice: Lattice,
    ) -> FrameSettings {
        FrameSettings {
            rays,
            lattice,
            geometry: self.geometry.clone(),
            placement: Placement::default(),
            encoding: self.encoding,
            table: TransferTable::new(transfer, &self.encoding).into(),
            mode,
            surfaces: match mode {
                Mode::Isosurface => {
                    let surface = Isosurface::at(transfer.color[transfer.color.len() / 2][0]);
                    Surface::all(&[surface], transfer, &self.encoding)
                }
                _ => Vec::new(),
            },
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            background: [0.2, 0.1, 0.4],
            clip: None,
            meshes: Vec::new(),
        }
    }

    /// The oracle's picture of the same draw list.
    pub(crate) fn reference(&self, frame: &FrameSettings, list: &DrawList, transfer: &TransferFunction) -> Picture {
        let n = self.levels[0].extent.to_array();
        let level_at = |p: glam::DVec3| {
            let v: [u32; 3] = std::array::from_fn(|a| p[a].clamp(0.0, n[a] as f64 - 0.5) as u32);
            let holds = |c: &&DrawCell| {
                let (low, high) = (c.region.min.to_array(), c.region.max.to_array());
                (0..3).all(|a| low[a] <= v[a] && v[a] < high[a])
            };
            list.cells.iter().find(holds).expect("cells cover the volume").brick.level.index()
        };
        let volume = ReferenceVolume { levels: &self.levels, level_at: &level_at, transfer };
        brickyard_reference::render(&[VolumeFrame::alone(frame.clone())], &[volume], None)
    }
}
