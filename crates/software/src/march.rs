//! A tile's rays through one layer, cell by cell: the hot loop. Traversal is compiled once per mode and vector unit;
//! sampling per code width as well.

use crate::choice::Choice;
use crate::frame::{Cell, Frame};
use crate::macrocells::{Coverage, Reach};
use crate::medium::Medium;
use crate::meshes::MeshLayers;
use crate::modes::{Accumulate, Average, Dvr, MinIp, Mip};
use crate::packet::LANES;
use crate::ray::Ray;
use crate::sample::{Brick, Code, SampleChunk};
use crate::stretch::{March, Stretch};
use crate::surface::Isosurface;
use crate::tiles::{PIXELS, Tile, place, places};
use crate::unit::Unit;
use brickyard_volume::Mode;
use glam::Vec4;
use std::ops::Range;

/// The result of a tile's rays: premultiplied colour and transmitted light.
pub(crate) type Seen = [Vec4; PIXELS];

/// The loop and the sampler for one volume's layer.
#[derive(Clone, Copy)]
pub(crate) struct MarchTile {
    /// Takes a tile's rays through the layer, between layers of meshes if any.
    march: fn(Self, &Frame<'_>, &Tile, Option<&MeshLayers>, &mut Work, &mut Seen),
    /// A cell's brick, checked against the width of its codes.
    brick: for<'a> fn(&Frame<'_>, &Cell<'a>) -> Brick<'a>,
    /// Adds some segments of a stretch through such a brick to the ray's sum.
    take: fn(&March<'_>, &mut Ray, &mut SampleChunk, Range<i32>),
}

impl MarchTile {
    fn new<C: Code, U: Unit, B: Accumulate>() -> Self {
        Self { march: march::<U, B>, brick: |frame, cell| frame.brick::<C>(cell), take: take::<C, U, B> }
    }

    pub(crate) fn march(
        &self,
        frame: &Frame<'_>,
        tile: &Tile,
        layers: Option<&MeshLayers>,
        work: &mut Work,
        seen: &mut Seen,
    ) {
        (self.march)(*self, frame, tile, layers, work, seen);
    }
}

/// The march for this frame's layer, drawn alone.
impl Choice for &Frame<'_> {
    type Chosen = MarchTile;

    fn of<C: Code, U: Unit>(self) -> MarchTile {
        match self.settings.mode {
            Mode::Isosurface if self.is_one_opaque_surface => MarchTile::new::<C, U, Isosurface>(),
            Mode::Dvr if self.is_sampled_in_packets() => MarchTile::new::<C, U, Dvr>(),
            Mode::Dvr if !self.needs_ends() => MarchTile::new::<C, U, Medium<false>>(),
            Mode::Dvr | Mode::Isosurface => MarchTile::new::<C, U, Medium<true>>(),
            Mode::Mip => MarchTile::new::<C, U, Mip>(),
            Mode::MinIp => MarchTile::new::<C, U, MinIp>(),
            Mode::Average => MarchTile::new::<C, U, Average>(),
        }
    }
}

fn take<C: Code, U: Unit, B: Accumulate>(
    march: &March<'_>,
    ray: &mut Ray,
    chunk: &mut SampleChunk,
    segments: Range<i32>,
) {
    U::call(
        (ray, chunk),
        #[inline(always)]
        move |(ray, chunk)| B::take::<C, U>(march, ray, chunk, segments),
    );
}

fn march<U: Unit, B: Accumulate>(
    sampler: MarchTile,
    frame: &Frame<'_>,
    tile: &Tile,
    layers: Option<&MeshLayers>,
    work: &mut Work,
    seen: &mut Seen,
) {
    U::call(
        &mut *work,
        #[inline(always)]
        |work| work.march::<B>(sampler, frame, tile, layers),
    );
    for i in places(tile) {
        seen[i] = B::seen(frame, work.rays[i].sum);
    }
}

/// A thread's working memory for a tile.
pub(crate) struct Work {
    pub(crate) rays: [Ray; PIXELS],
    chunk: SampleChunk,
    queue: Queue,
}

impl Work {
    /// On the heap, and created by a call of its own: Rayon's splits of a picture pile up on a thread's stack, dozens
    /// with many threads, and each has room for everything created in it.
    #[inline(never)]
    pub(crate) fn new() -> Box<Self> {
        let queue = Queue { stretches: [Stretch::EMPTY; QUEUE], len: 0, boxes: [0; LANES] };
        Box::new(Self { rays: [Ray::EMPTY; PIXELS], chunk: SampleChunk::EMPTY, queue })
    }

    #[inline(always)]
    fn march<B: Accumulate>(
        &mut self,
        sampler: MarchTile,
        frame: &Frame<'_>,
        tile: &Tile,
        layers: Option<&MeshLayers>,
    ) {
        let Self { rays, chunk, queue } = self;
        let mut waiting = 0;
        for y in tile.y0..tile.y1 {
            for x in tile.x0..tile.x1 {
                let i = place(tile, x, y);
                let limits = layers.map_or([0.0, f64::INFINITY], |layers| layers.limits(i));
                let ray = Ray::new(frame, x, y, B::START, limits);
                waiting += (ray.cursor < ray.end) as u32;
                rays[i] = ray;
            }
        }
        for cell in &frame.cells {
            if waiting == 0 || frame.is_given_up() {
                break;
            }
            let (x0, x1) = (cell.rect.x0.max(tile.x0), cell.rect.x1.min(tile.x1));
            let (y0, y1) = (cell.rect.y0.max(tile.y0), cell.rect.y1.min(tile.y1));
            let known = if B::OCCLUDES { frame.visibility(cell) } else { 0.0 };
            let mut brightest = known;
            for y in y0..y1 {
                for x in x0..x1 {
                    let i = place(tile, x, y);
                    let ray = &mut rays[i];
                    if ray.cursor >= ray.end || !cell.draws(x, y) {
                        continue;
                    }
                    if B::coverage(cell, ray) == Coverage::None {
                        if B::OCCLUDES && ray.sum.w > brightest && ray.run(&frame.ticks, cell, B::REACH).is_some() {
                            brightest = ray.sum.w;
                        }
                        continue;
                    }
                    let Some((first, last)) = ray.run(&frame.ticks, cell, B::REACH) else { continue };
                    if B::OCCLUDES && ray.sum.w > brightest {
                        brightest = ray.sum.w;
                    }
                    if B::FRONT_TO_BACK {
                        ray.cursor = last;
                        waiting -= (last >= ray.end) as u32;
                    }
                    let mut start = first;
                    while start < last {
                        if queue.len == QUEUE {
                            waiting -= queue.march::<B>(sampler, frame, cell, rays, chunk);
                            if frame.is_given_up() {
                                return;
                            }
                        }
                        start = queue.push(Stretch::new(frame, cell, &rays[i], i, start, last, B::REACH));
                    }
                }
            }
            waiting -= queue.march::<B>(sampler, frame, cell, rays, chunk);
            if brightest > known {
                frame.enter(cell, brightest);
            }
        }
    }
}

/// Stretches marched together.
const QUEUE: usize = 64;

/// More segments than in a stretch with steps not far shorter than voxels: the deadline is checked before longer ones.
const LONG: i32 = 1 << 10;

/// Stretches of one cell, marched step by step: the visible blocks of all are found first, then sampled. With one
/// stretch at a time, the processor would wait for the end of each long computation to know where to go on.
struct Queue {
    stretches: [Stretch; QUEUE],
    len: usize,
    boxes: [i32; LANES],
}

impl Queue {
    /// Returns the segment behind the stretch.
    #[inline(always)]
    fn push(&mut self, stretch: Stretch) -> u32 {
        let end = stretch.end;
        self.stretches[self.len] = stretch;
        self.len += 1;
        end
    }

    /// Adds all visible samples and clears the queue. Returns how many rays ended meanwhile.
    #[inline(always)]
    fn march<B: Accumulate>(
        &mut self,
        sampler: MarchTile,
        frame: &Frame<'_>,
        cell: &Cell<'_>,
        rays: &mut [Ray; PIXELS],
        chunk: &mut SampleChunk,
    ) -> u32 {
        if self.len == 0 {
            return 0;
        }
        let stretches = &mut self.stretches[..self.len];
        self.len = 0;
        for stretch in &mut *stretches {
            let ray = &rays[stretch.ray];
            if B::coverage(cell, ray) != Coverage::All {
                look::<B>(stretch, frame, cell, ray.sum, &mut self.boxes);
            }
        }
        let brick = (sampler.brick)(frame, cell);
        let mut ended = 0;
        for stretch in &*stretches {
            if stretch.count > LONG && frame.is_given_up() {
                break;
            }
            let ray = &mut rays[stretch.ray];
            let mut seen = stretch.seen;
            let march = March { frame, cell, brick, stretch };
            // A ray may have several stretches. Neighbouring blocks are sampled together.
            while !B::is_final(frame, ray.sum)
                && let Some(segments) = stretch.next_seen(&mut seen)
            {
                (sampler.take)(&march, ray, chunk, segments);
                if B::is_final(frame, ray.sum) {
                    ended += (ray.cursor < ray.end) as u32;
                    ray.cursor = ray.end;
                }
            }
        }
        ended
    }
}

/// Finds the possibly visible blocks of a stretch, and stores them in it.
#[inline(always)]
pub(crate) fn look<B: Accumulate>(
    stretch: &mut Stretch,
    frame: &Frame<'_>,
    cell: &Cell<'_>,
    sum: Vec4,
    boxes: &mut [i32; LANES],
) {
    let (blocks, mut seen, mut first) = (stretch.blocks(frame, B::REACH), 0, 0);
    while first * stretch.block < stretch.count {
        blocks.boxes(first, boxes);
        // SAFETY: these are boxes of the brick.
        seen |= unsafe { B::sees(cell, boxes, sum) } << first;
        first += LANES as i32;
    }
    if B::REACH != Reach::Middles {
        seen |= stretch.uncovered();
    }
    stretch.seen = seen;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Resident;
    use crate::medium::Medium;
    use crate::modes::Accumulate;
    use crate::sample::{Code8, Code16, Float32};
    use crate::surface::Isosurface;
    use crate::tiles::TILE_PX;
    use crate::unit::Portable;
    use brickyard_pager::{DrawCell, DrawList, PixelShare, Slot};
    use brickyard_volume::macrocells::MacroCells;
    use brickyard_volume::slot_encoding::INVALID_SLOT;
    use brickyard_volume::*;
    use glam::DVec3;

    /// Checks that all vector units draw the same picture.
    fn same_on_all_units<C: Code, B: Accumulate>(mode: Mode, surfaces: &[f64]) {
        same_when_lit::<C, B>(mode, surfaces, Lighting::default());
    }

    fn same_when_lit<C: Code, B: Accumulate>(mode: Mode, surfaces: &[f64], lighting: Lighting) {
        let voxel_type = [VoxelType::U8, VoxelType::U16, VoxelType::F32][C::BYTES / 2];
        // Less than half of the codes, around the visible values, so that codes are not counted from 0.
        let share = if mode == Mode::MinIp { [0.05, 0.5] } else { [0.4, 0.88] };
        let most = [255.0, 65535.0, 250.0][C::BYTES / 2];
        let window = Some(Window::of(share.map(|share| share * most)));
        let mut encoding = SlotEncoding::new(voxel_type, (0.0, 1e9), false).for_window(window, KeptSlots::default());
        encoding.has_invalid = C::INVALID;
        let transfer = TransferFunction::preset("viridis", encoding.table_values().into(), 3.0).unwrap();
        let projection = Projection::Perspective { fov_y_deg: 40.0 };
        let camera = Camera { eye: DVec3::new(-20.0, 3.0, 9.0), target: DVec3::splat(7.0), up: DVec3::Z, projection };
        let surfaces: Vec<_> =
            surfaces.iter().map(|share| brickyard_volume::Isosurface::at(share * encoding.high)).collect();
        let surfaces = Surface::all(&surfaces, &transfer, &encoding);
        let settings = FrameSettings {
            rays: camera.rays(TILE_PX, TILE_PX).unwrap(),
            lattice: Lattice::uniform(0.37, 0),
            geometry: Geometry::default(),
            placement: Placement::default(),
            encoding,
            table: TransferTable::new(&transfer, &encoding).into(),
            mode,
            surfaces,
            sampling: Sampling::default(),
            lighting,
            background: [0.1, 0.2, 0.3],
            clip: None,
            meshes: Vec::new(),
            caps: false,
            keeps_extremes: false,
        };
        let pyramid = Pyramid::new(Extent::new(16, 16, 16), [1.0; 3], 16);
        // A linear congruential generator's high bytes; a fifth of them 0.
        let mut state = 1u32;
        let noise = |_| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            if state >> 8 & 0xff < 51 { 0 } else { (state >> 24) as u8 }
        };
        let needs = settings.needs();
        let padded = 16 + 2 * needs.apron as usize;
        let number = |byte: u8| if byte == 0 { INVALID_SLOT } else { 1.1 * byte as f32 };
        let codes: std::sync::Arc<[u8]> = match C::IS_FLOAT {
            true => (0..padded.pow(3)).map(noise).flat_map(|byte| number(byte).to_le_bytes()).collect(),
            false => (0..padded.pow(3) * C::BYTES).map(noise).collect(),
        };
        let cells = MacroCells::new(&codes, encoding.format, C::INVALID, 16, needs);
        let resident = Resident::new(codes.clone(), codes.len(), cells);
        let brick = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::default() };
        let region = pyramid.brick_box_voxel(brick.level, brick.index);
        let cell = DrawCell { cell: brick, region, pixels: PixelShare::ALL, brick, slot: Slot(0), rank: 0 };
        let layer = VolumeFrame::alone(settings);
        let list = DrawList { cells: vec![cell] };
        let frame = Frame::new(&layer, &pyramid, &list, &needs, true, |_| &resident);
        let tile = Tile { x0: 0, x1: TILE_PX, y0: 0, y1: TILE_PX };
        let drawn = |march: MarchTile| {
            let mut seen = [Vec4::W; PIXELS];
            march.march(&frame, &tile, None, &mut Work::new(), &mut seen);
            seen.map(|color| color.to_array().map(f32::to_bits))
        };
        let portable = drawn(MarchTile::new::<C, Portable, B>());
        assert!(portable.iter().collect::<std::collections::BTreeSet<_>>().len() > 50, "a flat picture proves nothing");
        assert_eq!(portable, drawn(frame.for_machine(&encoding)), "{mode:?}");
    }

    #[test]
    fn all_vector_units_draw_the_same() {
        same_on_all_units::<Code8<false>, Dvr>(Mode::Dvr, &[]);
        same_on_all_units::<Code16<true>, Dvr>(Mode::Dvr, &[]);
        same_on_all_units::<Code8<true>, Mip>(Mode::Mip, &[]);
        same_on_all_units::<Code16<true>, MinIp>(Mode::MinIp, &[]);
        same_on_all_units::<Code16<false>, Average>(Mode::Average, &[]);
        same_on_all_units::<Code8<false>, Medium<true>>(Mode::Dvr, &[0.4]);
        same_on_all_units::<Code16<true>, Medium<true>>(Mode::Isosurface, &[0.3, 0.5]);
        same_on_all_units::<Code8<false>, Isosurface>(Mode::Isosurface, &[0.4]);
        same_on_all_units::<Code16<true>, Isosurface>(Mode::Isosurface, &[0.4]);
        same_on_all_units::<Float32, Dvr>(Mode::Dvr, &[]);
        same_on_all_units::<Float32, Mip>(Mode::Mip, &[]);
        same_on_all_units::<Float32, Average>(Mode::Average, &[]);
        same_on_all_units::<Float32, Medium<true>>(Mode::Isosurface, &[0.3, 0.5]);
        for model in [LightingModel::Phong, LightingModel::BlinnPhong, LightingModel::Tone] {
            for lights in [vec![], vec![DVec3::new(-9.0, 30.0, 4.0), DVec3::splat(40.0)]] {
                let lighting = Lighting { model, lights, ..Lighting::default() };
                same_when_lit::<Code8<false>, Dvr>(Mode::Dvr, &[], lighting.clone());
                same_when_lit::<Code16<true>, Dvr>(Mode::Dvr, &[], lighting.clone());
                same_when_lit::<Float32, Dvr>(Mode::Dvr, &[], lighting);
            }
        }
    }
}
