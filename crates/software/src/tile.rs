//! One tile of the picture, from its rays to its pixels: the hot loop, compiled for every code width, mode and vector unit.

use crate::blend::{Average, Blend, Dvr, MinIp, Mip, Sum, over_background};
use crate::frame::{Cell, Frame};
use crate::layers::NO_RANK;
use crate::macrocells::{Blocks, Coverage, Reach, block_length};
use crate::medium::Medium;
use crate::meshes::Layers;
use crate::packet::{CHUNK, LANES, PACKETS};
use crate::ray::Ray;
#[cfg(target_arch = "x86_64")]
use crate::sample::Avx2;
use crate::sample::{Brick, Chunk, Code, Code8, Code16, Portable, Unit};
use crate::surface::Isosurface;
use brickyard_volume::macrocells::CELL_EDGE;
use brickyard_volume::sampling::Curve;
use brickyard_volume::{Filter, FrameSettings, LightingModel, Method, Mode, Picture, Sampling, SlotFormat};
use glam::Vec4;
use std::ops::Range;

/// Pixels along a tile's edge: its rays' state stays in the first-level cache, and there are enough tiles for all threads.
pub(crate) const TILE_PX: u32 = 16;

pub(crate) const PIXELS: usize = (TILE_PX * TILE_PX) as usize;

/// What a thread needs besides the frame.
pub(crate) const BYTES_PER_THREAD: u64 =
    (size_of::<[Ray; PIXELS]>() + size_of::<TilePixels>() + size_of::<Chunk>() + size_of::<Queue>()) as u64;

/// A tile's place on the picture.
pub(crate) type Tile = brickyard_volume::PixelRect;

/// A tile's pixels in rows of [`TILE_PX`], also where the picture ends earlier.
pub(crate) type TilePixels = [[u8; 3]; PIXELS];

/// Draws a tile.
pub(crate) type DrawTile = fn(&Frame<'_>, &Tile) -> TilePixels;

/// The picture's tiles, row by row.
pub(crate) fn tiles(width: u32, height: u32) -> impl Iterator<Item = Tile> {
    let starts = |n: u32| (0..n).step_by(TILE_PX as usize);
    starts(height).flat_map(move |y0| {
        let y1 = height.min(y0 + TILE_PX);
        starts(width).map(move |x0| Tile { x0, x1: width.min(x0 + TILE_PX), y0, y1 })
    })
}

/// The picture of drawn tiles.
pub(crate) fn picture((width, height): (u32, u32), tiles: &[Tile], drawn: &[TilePixels]) -> Picture {
    let mut rgb = vec![[0; 3]; width as usize * height as usize];
    for (tile, pixels) in tiles.iter().zip(drawn) {
        for (y, row) in (tile.y0..tile.y1).zip(pixels.chunks_exact(TILE_PX as usize)) {
            let start = y as usize * width as usize + tile.x0 as usize;
            let n = (tile.x1 - tile.x0) as usize;
            rgb[start..start + n].copy_from_slice(&row[..n]);
        }
    }
    Picture { width, height, rgb }
}

/// The function for this frame on this machine.
pub(crate) fn for_frame(frame: &Frame<'_>) -> DrawTile {
    fn with_code<C: Code, const INVALID: bool>(settings: &FrameSettings) -> DrawTile {
        let Sampling { method, filter, .. } = settings.sampling;
        let is_lit = settings.lighting.model != LightingModel::None;
        let is_plain = method == Method::Udvr && filter == Filter::Trilinear && !is_lit && settings.grid().is_none();
        match settings.mode {
            Mode::Isosurface if settings.is_one_opaque_surface() => for_machine::<C, Isosurface, INVALID>(),
            Mode::Isosurface => for_machine::<C, Medium<true>, INVALID>(),
            Mode::Dvr if !settings.surfaces.is_empty() => for_machine::<C, Medium<true>, INVALID>(),
            Mode::Dvr if is_plain => for_machine::<C, Dvr, INVALID>(),
            Mode::Dvr if method.curve() == Curve::Middle => for_machine::<C, Medium<false>, INVALID>(),
            Mode::Dvr => for_machine::<C, Medium<true>, INVALID>(),
            Mode::Mip => for_machine::<C, Mip, INVALID>(),
            Mode::MinIp => for_machine::<C, MinIp, INVALID>(),
            Mode::Average => for_machine::<C, Average, INVALID>(),
        }
    }
    let settings = frame.settings;
    match (settings.encoding.format, settings.encoding.has_invalid) {
        (SlotFormat::U8, false) => with_code::<Code8, false>(settings),
        (SlotFormat::U8, true) => with_code::<Code8, true>(settings),
        (SlotFormat::U16, false) => with_code::<Code16, false>(settings),
        (SlotFormat::U16, true) => with_code::<Code16, true>(settings),
    }
}

fn for_machine<C: Code, B: Blend, const INVALID: bool>() -> DrawTile {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the machine has AVX2.
        return |frame, tile| unsafe { draw_avx2::<C, B, INVALID>(frame, tile) };
    }
    draw::<C, B, Portable, INVALID>
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn draw_avx2<C: Code, B: Blend, const INVALID: bool>(frame: &Frame<'_>, tile: &Tile) -> TilePixels {
    draw::<C, B, Avx2, INVALID>(frame, tile)
}

#[inline(always)]
fn draw<C: Code, B: Blend, U: Unit, const INVALID: bool>(frame: &Frame<'_>, tile: &Tile) -> TilePixels {
    let mut work = Work {
        rays: [Ray::EMPTY; PIXELS],
        chunk: Chunk::EMPTY,
        queue: Queue { stretches: [Stretch::EMPTY; QUEUE], len: 0, boxes: [0; LANES] },
    };
    let mut slabs = frame.meshes.map(|tree| (tree, Layers::new(&frame.settings.rays, tile)));
    loop {
        if let Some((tree, layers)) = &mut slabs {
            tree.peel(frame.settings, tile, layers);
        }
        let layers = slabs.as_ref().map(|(_, layers)| &**layers);
        work.march::<C, B, U, INVALID>(frame, tile, layers);
        let Some((_, layers)) = &mut slabs else { break };
        let mut is_more = false;
        for i in places(tile) {
            is_more |= layers.compose(i, B::seen::<C>(frame, work.rays[i].sum));
        }
        if !is_more {
            break;
        }
    }
    let mut pixels = [[0; 3]; PIXELS];
    for i in places(tile) {
        let seen = match &slabs {
            None => B::seen::<C>(frame, work.rays[i].sum),
            Some((_, layers)) => layers.color(i),
        };
        pixels[i] = Picture::quantise(over_background(frame, seen));
    }
    pixels
}

/// What a tile is worked on with.
struct Work {
    rays: [Ray; PIXELS],
    chunk: Chunk,
    queue: Queue,
}

impl Work {
    /// Takes the tile's rays through all cells, between the layers where there are meshes.
    #[inline(always)]
    fn march<C: Code, B: Blend, U: Unit, const INVALID: bool>(
        &mut self,
        frame: &Frame<'_>,
        tile: &Tile,
        layers: Option<&Layers>,
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
            if waiting == 0 {
                break;
            }
            let (x0, x1) = (cell.rect.x0.max(tile.x0), cell.rect.x1.min(tile.x1));
            let (y0, y1) = (cell.rect.y0.max(tile.y0), cell.rect.y1.min(tile.y1));
            let known = if B::OCCLUDES { frame.entered(cell) } else { 0.0 };
            let mut brightest = known;
            for y in y0..y1 {
                for x in x0..x1 {
                    let i = place(tile, x, y);
                    let ray = &mut rays[i];
                    if ray.cursor >= ray.end || cell.pixels.is_some_and(|pixels| !pixels.hold(x, y)) {
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
                            waiting -= queue.march::<C, B, U, INVALID>(frame, cell, rays, chunk);
                        }
                        start = queue.push(Stretch::new(frame, cell, &rays[i], i, start, last, B::REACH));
                    }
                }
            }
            waiting -= queue.march::<C, B, U, INVALID>(frame, cell, rays, chunk);
            if brightest > known {
                frame.enter(cell, brightest);
            }
        }
    }
}

/// The places of a tile's pixels.
fn places(tile: &Tile) -> impl Iterator<Item = usize> {
    let Tile { x0, x1, y0, y1 } = *tile;
    (0..y1 - y0).flat_map(move |y| (0..x1 - x0).map(move |x| (y * TILE_PX + x) as usize))
}

#[inline(always)]
pub(crate) fn place(tile: &Tile, x: u32, y: u32) -> usize {
    ((y - tile.y0) * TILE_PX + x - tile.x0) as usize
}

/// Stretches that are marched together.
const QUEUE: usize = 64;

/// Stretches of one cell, to be marched step by step: first it is found out what can be seen of all of them, then that is
/// sampled. Taken one by one, the processor would wait for the end of each long computation to know where to go on.
struct Queue {
    stretches: [Stretch; QUEUE],
    len: usize,
    /// Room to work on eight blocks.
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

    /// Adds all samples that can be seen and clears the queue. Returns how many rays have come to their end by that.
    #[inline(always)]
    fn march<C: Code, B: Blend, U: Unit, const INVALID: bool>(
        &mut self,
        frame: &Frame<'_>,
        cell: &Cell<'_>,
        rays: &mut [Ray; PIXELS],
        chunk: &mut Chunk,
    ) -> u32 {
        let stretches = &mut self.stretches[..self.len];
        self.len = 0;
        for stretch in &mut *stretches {
            let ray = &rays[stretch.ray];
            if B::coverage(cell, ray) != Coverage::All {
                stretch.look::<B>(cell, ray.sum, &mut self.boxes);
            }
        }
        let brick = Brick::new::<C>(cell.brick.voxels(), frame.edge + 2 * frame.apron);
        let march = March { frame, cell, brick };
        let mut ended = 0;
        for stretch in stretches {
            let ray = &mut rays[stretch.ray];
            let mut seen = stretch.seen;
            // A ray may have several stretches. Neighbouring blocks are sampled together.
            while !B::is_final::<C>(ray.sum)
                && let Some(segments) = stretch.next_seen(&mut seen)
            {
                B::take::<C, U, INVALID>(&march, stretch, ray, chunk, segments);
                if B::is_final::<C>(ray.sum) {
                    ended += (ray.cursor < ray.end) as u32;
                    ray.cursor = ray.end;
                }
            }
        }
        ended
    }
}

/// What stretches are marched through.
pub(crate) struct March<'a> {
    pub(crate) frame: &'a Frame<'a>,
    pub(crate) cell: &'a Cell<'a>,
    pub(crate) brick: Brick<'a>,
}

/// A part of a run inside one zone: its samples are equally spaced and, but for the ray's first and last, equally long.
#[derive(Clone, Copy)]
pub(crate) struct Stretch {
    /// The ray's place in the tile.
    ray: usize,
    /// The first segment and one past the last.
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) zone: usize,
    pub(crate) count: i32,
    /// Samples in a block, and a bit for each block: whether it may be seen.
    block: i32,
    pub(crate) seen: u64,
    /// World length of a segment, and distance of the middle of the first, were it not cut.
    pub(crate) length: f64,
    pub(crate) middle: f64,
    /// Slot coordinates of the first sample and from one to the next: counted from here, f32 is fine to a ten-thousandth
    /// of a voxel.
    pub(crate) origin: [f32; 3],
    pub(crate) step: [f32; 3],
    blocks: Blocks,
}

impl Stretch {
    const EMPTY: Self = Self {
        ray: 0,
        start: 0,
        end: 0,
        zone: 0,
        count: 0,
        block: 0,
        seen: 0,
        length: 0.0,
        middle: 0.0,
        origin: [0.0; 3],
        step: [0.0; 3],
        blocks: Blocks::EMPTY,
    };

    /// The segments from `start` on, up to `last` or the end of the zone, or until there are as many blocks as bits. All
    /// count as seen.
    #[inline(always)]
    pub(crate) fn new(
        frame: &Frame<'_>,
        cell: &Cell<'_>,
        ray: &Ray,
        place: usize,
        start: u32,
        last: u32,
        reach: Reach,
    ) -> Self {
        let ticks = &frame.ticks;
        let zone = ticks.zone(start);
        let zone_end = ticks.zone_end(zone);
        let length = ticks.step * (1i32 << zone) as f64;
        let middle = start as i32 as f64 * ticks.step + 0.5 * length;
        let (mut origin, mut step) = ([0.0f32; 3], [0.0f32; 3]);
        for a in 0..3 {
            let voxel = ray.origin[a] + ray.direction[a] * middle;
            origin[a] = (cell.offset[a] + cell.scale[a] * voxel) as f32;
            step[a] = (cell.scale[a] * ray.direction[a] * length) as f32;
        }
        let block = block_length(step, reach);
        let end = if last < zone_end { last } else { zone_end };
        let count = ((end - start) >> zone) as i32;
        let most = block.saturating_mul(u64::BITS as i32);
        let (end, count) = if count <= most { (end, count) } else { (start + ((most as u32) << zone), most) };
        let blocks = Blocks::new(origin, step, block, reach, frame.edge, frame.apron);
        Self { ray: place, start, end, zone, count, block, seen: u64::MAX, length, middle, origin, step, blocks }
    }

    /// Goes on to look for several surfaces in segments. Where voxels may have no value, what was leapt over may have had none.
    #[inline(always)]
    pub(crate) fn reach<const INVALID: bool>(&self, ray: &mut Ray, segments: &Range<i32>) {
        if INVALID && ray.reached != self.start + ((segments.start as u32) << self.zone) {
            ray.rank = NO_RANK;
        }
        ray.reached = self.start + ((segments.end as u32) << self.zone);
    }

    /// A distance, in segments from the middle of the first.
    #[inline(always)]
    pub(crate) fn along(&self, t: f64) -> f32 {
        ((t - self.middle) / self.length) as f32
    }

    /// Finds the blocks that may be seen.
    #[inline(always)]
    pub(crate) fn look<B: Blend>(&mut self, cell: &Cell<'_>, sum: Vec4, boxes: &mut [i32; LANES]) {
        let (mut seen, mut first) = (0, 0);
        while first * self.block < self.count {
            self.blocks.boxes(first, boxes);
            // SAFETY: these are boxes of the brick.
            seen |= unsafe { B::sees(cell, boxes, sum) } << first;
            first += LANES as i32;
        }
        if B::REACH != Reach::Middles {
            seen |= self.uncovered();
        }
        self.seen = seen;
    }

    /// The first neighbouring segments of blocks that may be seen, which are no longer among those afterwards.
    #[inline(always)]
    pub(crate) fn next_seen(&self, seen: &mut u64) -> Option<Range<i32>> {
        if *seen == 0 {
            return None;
        }
        let from = seen.trailing_zeros();
        let to = from + (*seen >> from).trailing_ones();
        *seen = seen.checked_shr(to).unwrap_or(0).checked_shl(to).unwrap_or(0);
        let last = (to as i32).saturating_mul(self.block);
        Some(from as i32 * self.block..if last < self.count { last } else { self.count })
    }

    /// The blocks of which macro-cells' ranges do not tell everything when whole segments count: those that may reach out of the
    /// brick by more than half a voxel, and all if a segment may pass through a cell.
    #[inline(always)]
    fn uncovered(&self) -> u64 {
        let longest = longest(self.step);
        if longest <= 1.0 {
            return 0;
        }
        if longest > CELL_EDGE as f32 {
            return u64::MAX;
        }
        1 | 1 << ((self.count - 1) / self.block)
    }

    /// Between which places, in segments from the middle of the first, the brick can be sampled. Segments no longer than a voxel
    /// never reach out of it.
    #[inline(always)]
    pub(crate) fn sampleable(&self, padded: u32) -> [f32; 2] {
        let (mut low, mut high) = (f32::NEG_INFINITY, f32::INFINITY);
        if longest(self.step) > 1.0 {
            for a in 0..3 {
                if self.step[a] != 0.0 {
                    let enter = -self.origin[a] / self.step[a];
                    let leave = ((padded - 1) as f32 - self.origin[a]) / self.step[a];
                    (low, high) = (low.max(enter.min(leave)), high.min(enter.max(leave)));
                }
            }
        }
        [low, high]
    }

    /// Places the samples of the segments `done..to`, or of as many as a chunk holds.
    #[inline(always)]
    pub(crate) fn place_samples<const INVALID: bool>(
        &self,
        frame: &Frame<'_>,
        ray: &Ray,
        chunk: &mut Chunk,
        Range { start: done, end: to }: Range<i32>,
    ) {
        let full = (self.length * frame.per_unit) as f32;
        let left = to - done;
        chunk.packets = (left.min(CHUNK as i32) as usize).div_ceil(LANES);
        for p in 0..chunk.packets.min(PACKETS) {
            for i in 0..LANES {
                let lane = (p * LANES + i) as i32;
                chunk.along[p][i] = (done + lane) as f32;
                chunk.weight[p][i] = if lane < left { full } else { 0.0 };
            }
        }
        let cut_first = self.start == ray.first && done == 0;
        let cut_last = self.end == ray.end && to == self.count && left <= CHUNK as i32;
        let all_whole = !INVALID && !cut_first && !cut_last;
        chunk.whole_steps = if all_whole { left.min(CHUNK as i32) as usize } else { 0 };
        chunk.zone = self.zone;
        for (is_cut, lane) in [(cut_first, 0), (cut_last, left - 1)] {
            if is_cut {
                let tick = self.start + (((done + lane) as u32) << self.zone);
                let (middle, length) = ray.segment(&frame.ticks, tick);
                let (p, i) = (lane as usize / LANES, lane as usize % LANES);
                chunk.along[p][i] = self.along(middle);
                chunk.weight[p][i] = (length.max(0.0) * frame.per_unit) as f32;
            }
        }
    }

    /// Adds the samples of the segments `from..to`, or fewer if nothing behind those can be seen.
    #[inline(always)]
    pub(crate) fn add<C: Code, B: Sum, U: Unit, const INVALID: bool>(
        &self,
        March { frame, brick, .. }: &March<'_>,
        ray: &mut Ray,
        chunk: &mut Chunk,
        Range { start: from, end: to }: Range<i32>,
    ) {
        let mut sum = ray.sum;
        let mut done = from;
        while done < to {
            self.place_samples::<INVALID>(frame, ray, chunk, done..to);
            let filter = frame.settings.sampling.filter;
            brick.filtered::<C, U, INVALID>(filter, self.origin, self.step, chunk);
            sum = B::add::<C>(frame, sum, chunk);
            if B::is_final::<C>(sum) {
                break;
            }
            done += CHUNK as i32;
        }
        ray.sum = sum;
    }
}

/// Voxels of a step along the axis with the most.
#[inline(always)]
fn longest(step: [f32; 3]) -> f32 {
    step[0].abs().max(step[1].abs()).max(step[2].abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blend::Blend;
    use crate::frame::Resident;
    use crate::medium::Medium;
    use crate::surface::Isosurface;
    use brickyard_pager::{DrawCell, DrawList, Pixels, Slot};
    use brickyard_volume::macrocells::MacroCells;
    use brickyard_volume::*;
    use glam::DVec3;

    #[test]
    fn tiles_cover_the_picture_once() {
        let mut seen = vec![0; 50 * 17];
        for tile in tiles(50, 17) {
            for (x, y) in (tile.y0..tile.y1).flat_map(|y| (tile.x0..tile.x1).map(move |x| (x, y))) {
                seen[(y * 50 + x) as usize] += 1;
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
    }

    /// The vector unit must not show in the picture.
    fn same_on_all_units<C: Code, B: Blend, const INVALID: bool>(mode: Mode, surfaces: &[f64]) {
        let voxel_type = if C::BYTES == 1 { VoxelType::U8 } else { VoxelType::U16 };
        let mut encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
        encoding.has_invalid = INVALID;
        let transfer = TransferFunction::preset("viridis", (encoding.low, encoding.high), 3.0).unwrap();
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
            lighting: Lighting::default(),
            background: [0.1, 0.2, 0.3],
            clip: None,
            meshes: Vec::new(),
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
        let codes: std::sync::Arc<[u8]> = (0..padded.pow(3) * C::BYTES).map(noise).collect();
        let cells = MacroCells::new(&codes, encoding.format, INVALID, 16, needs);
        let resident = Resident::new(codes.clone(), codes.len(), cells);
        let brick = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::default() };
        let region = pyramid.brick_box_voxel(brick.level, brick.index);
        let cell = DrawCell { cell: brick, region, pixels: Pixels::ALL, brick, slot: Slot(0) };
        let frame = Frame::new(&settings, &pyramid, &DrawList { cells: vec![cell] }, &needs, |_| &resident);
        let tile = Tile { x0: 0, x1: TILE_PX, y0: 0, y1: TILE_PX };
        let picture = draw::<C, B, Portable, INVALID>(&frame, &tile);
        assert!(picture.iter().collect::<std::collections::BTreeSet<_>>().len() > 50, "a flat picture proves nothing");
        assert_eq!(picture, for_frame(&frame)(&frame, &tile), "{mode:?}");
    }

    #[test]
    fn all_vector_units_draw_the_same() {
        same_on_all_units::<Code8, Dvr, false>(Mode::Dvr, &[]);
        same_on_all_units::<Code16, Dvr, true>(Mode::Dvr, &[]);
        same_on_all_units::<Code8, Mip, true>(Mode::Mip, &[]);
        same_on_all_units::<Code16, MinIp, true>(Mode::MinIp, &[]);
        same_on_all_units::<Code16, Average, false>(Mode::Average, &[]);
        same_on_all_units::<Code8, Medium<true>, false>(Mode::Dvr, &[0.4]);
        same_on_all_units::<Code16, Medium<true>, true>(Mode::Isosurface, &[0.3, 0.5]);
        same_on_all_units::<Code8, Isosurface, false>(Mode::Isosurface, &[0.4]);
        same_on_all_units::<Code16, Isosurface, true>(Mode::Isosurface, &[0.4]);
    }
}
