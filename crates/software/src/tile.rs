//! One tile of the picture, from its rays to its pixels: the hot loop, compiled for every code width, mode and vector unit.

use crate::blend::{Average, Blend, Coverage, Dvr, MinIp, Mip};
use crate::frame::{Cell, Frame, PixelRect};
use crate::macrocells::Blocks;
use crate::ray::Ray;
#[cfg(target_arch = "x86_64")]
use crate::sample::Avx2;
use crate::sample::{Brick, CHUNK, Chunk, Code, Code8, Code16, LANES, PACKETS, Portable, Unit};
use brickyard_volume::{Mode, Picture, SlotFormat};

/// Pixels along a tile's edge: its rays' state stays in the first-level cache, and there are enough tiles for all threads.
pub(crate) const TILE_PX: u32 = 16;

const PIXELS: usize = (TILE_PX * TILE_PX) as usize;

/// What a thread needs besides the frame.
pub(crate) const BYTES_PER_THREAD: u64 =
    (size_of::<[Ray; PIXELS]>() + size_of::<TilePixels>() + size_of::<Chunk>()) as u64;

/// A tile's place on the picture.
pub(crate) type Tile = PixelRect;

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

/// The function for this frame on this machine.
pub(crate) fn for_frame(frame: &Frame<'_>) -> DrawTile {
    fn with_code<C: Code, const INVALID: bool>(mode: Mode) -> DrawTile {
        match mode {
            Mode::Dvr => for_machine::<C, Dvr, INVALID>(),
            Mode::Mip => for_machine::<C, Mip, INVALID>(),
            Mode::MinIp => for_machine::<C, MinIp, INVALID>(),
            Mode::Average => for_machine::<C, Average, INVALID>(),
        }
    }
    let settings = frame.settings;
    match (settings.encoding.format, settings.encoding.has_invalid) {
        (SlotFormat::U8, false) => with_code::<Code8, false>(settings.mode),
        (SlotFormat::U8, true) => with_code::<Code8, true>(settings.mode),
        (SlotFormat::U16, false) => with_code::<Code16, false>(settings.mode),
        (SlotFormat::U16, true) => with_code::<Code16, true>(settings.mode),
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
    let mut rays = [Ray::EMPTY; PIXELS];
    let mut chunk = Chunk::EMPTY;
    let mut waiting = 0;
    for y in tile.y0..tile.y1 {
        for x in tile.x0..tile.x1 {
            let ray = Ray::new(frame, x, y, B::START);
            waiting += (ray.cursor < ray.end) as u32;
            rays[place(tile, x, y)] = ray;
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
                let ray = &mut rays[place(tile, x, y)];
                if ray.cursor >= ray.end {
                    continue;
                }
                if B::coverage(cell, ray.sum) == Coverage::None {
                    if B::OCCLUDES && ray.sum.w > brightest && ray.run(&frame.ticks, cell).is_some() {
                        brightest = ray.sum.w;
                    }
                    continue;
                }
                if let Some((first, last)) = ray.run(&frame.ticks, cell) {
                    ray.cursor = last;
                    if B::OCCLUDES && ray.sum.w > brightest {
                        brightest = ray.sum.w;
                    }
                    if !march::<C, B, U, INVALID>(frame, cell, ray, &mut chunk, first, last) && !B::FRONT_TO_BACK {
                        ray.cursor = ray.first;
                    }
                    waiting -= (ray.cursor >= ray.end) as u32;
                }
            }
        }
        if brightest > known {
            frame.enter(cell, brightest);
        }
    }
    let mut pixels = [[0; 3]; PIXELS];
    for y in tile.y0..tile.y1 {
        for x in tile.x0..tile.x1 {
            let i = place(tile, x, y);
            pixels[i] = Picture::quantise(B::color::<C>(frame, rays[i].sum));
        }
    }
    pixels
}

#[inline(always)]
fn place(tile: &Tile, x: u32, y: u32) -> usize {
    ((y - tile.y0) * TILE_PX + x - tile.x0) as usize
}

/// Adds the samples of a run of segments, zone by zone, leaping over the macro-cells that cannot be seen. True if nothing
/// further can be seen.
#[inline(always)]
fn march<C: Code, B: Blend, U: Unit, const INVALID: bool>(
    frame: &Frame<'_>,
    cell: &Cell<'_>,
    ray: &mut Ray,
    chunk: &mut Chunk,
    first: u32,
    last: u32,
) -> bool {
    let leaps = B::coverage(cell, ray.sum) == Coverage::Some;
    let brick = Brick::new::<C>(&cell.brick.codes, frame.edge + 2 * frame.apron);
    let mut start = first;
    while start < last {
        let stretch = Stretch::new(frame, cell, ray, start, last);
        if !leaps {
            if stretch.add::<C, B, U, INVALID>(frame, &brick, ray, chunk, 0, stretch.count) {
                return true;
            }
        } else {
            // Neighbouring blocks that are seen are sampled together.
            let mut blocks = Blocks::new(stretch.origin, stretch.step, stretch.count, frame.edge, frame.apron);
            let (mut from, mut to) = (0, 0);
            while let Some((corner, next, end)) = blocks.next() {
                let sees = B::sees(cell, corner, ray.sum);
                if !sees && from < to && stretch.add::<C, B, U, INVALID>(frame, &brick, ray, chunk, from, to) {
                    return true;
                }
                from = if sees && from < to { from } else { next };
                to = if sees { end } else { from };
            }
            if from < to && stretch.add::<C, B, U, INVALID>(frame, &brick, ray, chunk, from, to) {
                return true;
            }
        }
        start = stretch.end;
    }
    false
}

/// The part of a run inside one zone: its samples are equally spaced and, but for the ray's first and last, equally long.
struct Stretch {
    /// The first segment and one past the last.
    start: u32,
    end: u32,
    zone: usize,
    count: i32,
    /// World length of a segment, and distance of the middle of the first, were it not cut.
    length: f64,
    middle: f64,
    /// Slot coordinates of the first sample and from one to the next: counted from here, f32 is fine to a ten-thousandth
    /// of a voxel.
    origin: [f32; 3],
    step: [f32; 3],
}

impl Stretch {
    #[inline(always)]
    fn new(frame: &Frame<'_>, cell: &Cell<'_>, ray: &Ray, start: u32, last: u32) -> Self {
        let ticks = &frame.ticks;
        let zone = ticks.zone(start);
        let end = last.min(ticks.zone_end(zone));
        let count = ((end - start) >> zone) as i32;
        let length = ticks.step * (1i32 << zone) as f64;
        let middle = start as i32 as f64 * ticks.step + 0.5 * length;
        let (mut origin, mut step) = ([0.0f32; 3], [0.0f32; 3]);
        for a in 0..3 {
            let voxel = ray.origin[a] + ray.direction[a] * middle;
            origin[a] = (cell.offset[a] + cell.scale[a] * voxel) as f32;
            step[a] = (cell.scale[a] * ray.direction[a] * length) as f32;
        }
        Self { start, end, zone, count, length, middle, origin, step }
    }

    /// Adds the samples `from..to`. True if nothing behind them can be seen.
    #[inline(always)]
    fn add<C: Code, B: Blend, U: Unit, const INVALID: bool>(
        &self,
        frame: &Frame<'_>,
        brick: &Brick<'_>,
        ray: &mut Ray,
        chunk: &mut Chunk,
        from: i32,
        to: i32,
    ) -> bool {
        let per_unit = 1.0 / frame.settings.table.unit_distance as f64;
        let full = (self.length * per_unit) as f32;
        let mut sum = ray.sum;
        let mut done = from;
        while done < to {
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
                    chunk.along[p][i] = ((middle - self.middle) / self.length) as f32;
                    chunk.weight[p][i] = (length.max(0.0) * per_unit) as f32;
                }
            }
            brick.sample::<C, U, INVALID>(self.origin, self.step, chunk);
            sum = B::add::<C>(frame, sum, chunk);
            if B::is_final::<C>(sum) {
                ray.cursor = ray.end;
                ray.sum = sum;
                return true;
            }
            done += CHUNK as i32;
        }
        ray.sum = sum;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Resident;
    use brickyard_pager::{DrawCell, DrawList, Slot};
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
    fn same_on_all_units<C: Code, B: Blend, const INVALID: bool>(mode: Mode) {
        let voxel_type = if C::BYTES == 1 { VoxelType::U8 } else { VoxelType::U16 };
        let mut encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
        encoding.has_invalid = INVALID;
        let transfer = TransferFunction::preset("viridis", (encoding.low, encoding.high), 3.0).unwrap();
        let projection = Projection::Perspective { fov_y_deg: 40.0 };
        let camera = Camera { eye: DVec3::new(-20.0, 3.0, 9.0), target: DVec3::splat(7.0), up: DVec3::Z, projection };
        let settings = FrameSettings {
            rays: camera.rays(TILE_PX, TILE_PX).unwrap(),
            lattice: Lattice::uniform(0.37, 0),
            geometry: Geometry::default(),
            encoding,
            table: TransferTable::new(&transfer, &encoding),
            mode,
            background: [0.1, 0.2, 0.3],
            clip: None,
        };
        let pyramid = Pyramid::new(Extent::new(16, 16, 16), [1.0; 3], 16);
        // A linear congruential generator's high bytes; a fifth of them 0.
        let mut state = 1u32;
        let noise = |_| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            if state >> 8 & 0xff < 51 { 0 } else { (state >> 24) as u8 }
        };
        let codes: std::sync::Arc<[u8]> = (0..18 * 18 * 18 * C::BYTES).map(noise).collect();
        let resident = Resident::new(codes, &encoding, 16, 1);
        let brick = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::default() };
        let cell =
            DrawCell { cell: brick, region: pyramid.brick_box_voxel(brick.level, brick.index), brick, slot: Slot(0) };
        let frame = Frame::new(&settings, &pyramid, &DrawList { cells: vec![cell] }, 1, |_| &resident);
        let tile = Tile { x0: 0, x1: TILE_PX, y0: 0, y1: TILE_PX };
        let picture = draw::<C, B, Portable, INVALID>(&frame, &tile);
        assert!(picture.iter().collect::<std::collections::BTreeSet<_>>().len() > 50, "a flat picture proves nothing");
        assert_eq!(picture, for_frame(&frame)(&frame, &tile), "{mode:?}");
    }

    #[test]
    fn all_vector_units_draw_the_same() {
        same_on_all_units::<Code8, Dvr, false>(Mode::Dvr);
        same_on_all_units::<Code16, Dvr, true>(Mode::Dvr);
        same_on_all_units::<Code8, Mip, true>(Mode::Mip);
        same_on_all_units::<Code16, MinIp, true>(Mode::MinIp);
        same_on_all_units::<Code16, Average, false>(Mode::Average);
    }
}
