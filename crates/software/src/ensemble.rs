//! Several volumes in one picture, as [`brickyard_volume::look`] says: each with its slots, its draw list and its place in the world,
//! all of them under one budget.
//!
//! A tile goes to a thread, which takes its rays one by one. Of each volume it finds the runs of the ray's segments that belong to
//! the cells over the tile, as for one volume; then it goes along the lattice in chunks of 32 segments, in which one volume after the other
//! leaves what it has there (its samples taken eight at a time, and only where its macro-cells may show something), and then one segment
//! after the other is seen through. So no volume is sampled much behind where light ends, and costs add up.
//! Where volumes have surfaces, those of a chunk are kept, and all media of it one by one: a segment with surfaces in it is
//! seen through piece by piece.

use crate::blend::{self, Dvr, Entries, FAINTEST};
use crate::frame::{Cell, Frame};
use crate::layers::Pieces;
use crate::macrocells::{Coverage, Reach};
use crate::medium::{Medium, Path};
use crate::packet::{CHUNK, LANES};
use crate::ray::Ray;
use crate::renderer::{Slots, SoftwareError, SoftwareOptions, bytes_per_slot, fixed_bytes, pool};
#[cfg(target_arch = "x86_64")]
use crate::sample::Avx2;
use crate::sample::{Brick, Chunk, Code, Code8, Code16, Portable, Unit};
use crate::tile::{self, March, Stretch, TILE_PX, Tile, TilePixels, place};
use brickyard_pager::{Layer, Slot, VolumeNeeds, Wish, share};
use brickyard_volume::integrals::MAX_DEPTH;
use brickyard_volume::{Blend, Combination, Jitter, Method, Mode, Picture, SlotFormat};
use glam::{Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// What an ensemble may use; fixed for its life.
#[derive(Clone, Copy, Debug)]
pub struct EnsembleOptions {
    /// The most that slots and everything else of the renderer may take.
    pub memory_bytes: u64,
    /// Width and height of the largest picture.
    pub max_picture_px: [u32; 2],
    /// Threads that draw; at least 1.
    pub threads: usize,
}

/// Slots in RAM of several volumes, and threads that draw from them.
#[derive(Debug)]
pub struct SoftwareEnsemble {
    volumes: Vec<Volume>,
    max_picture_px: [u32; 2],
    fixed_bytes: u64,
    pool: rayon::ThreadPool,
}

#[derive(Debug)]
struct Volume {
    options: SoftwareOptions,
    slots: Slots,
}

/// What a thread keeps for a cell of the draw list: that it is over the tile, and which segments of a ray are its.
const BYTES_PER_CELL_AND_THREAD: usize = size_of::<u32>() + size_of::<Run>();

impl SoftwareEnsemble {
    /// Shares the budget out among the volumes.
    ///
    /// # Errors
    /// If it does not hold the least that each needs, bricks are too large, or the threads do not start.
    ///
    /// # Panics
    /// If a volume's bricks have no apron, or there is no volume.
    pub fn new(volumes: &[VolumeNeeds], ensemble: &EnsembleOptions) -> Result<Self, SoftwareError> {
        let EnsembleOptions { memory_bytes, max_picture_px, threads } = *ensemble;
        let options = |needs: &VolumeNeeds| SoftwareOptions {
            encoding: needs.encoding,
            edge: needs.edge,
            needs: needs.bricks,
            memory_bytes,
            max_picture_px,
            threads,
            leaps: true,
        };
        if let Some(VolumeNeeds { edge, .. }) =
            volumes.iter().find(|v| !(1..=crate::SoftwareRenderer::MAX_EDGE).contains(&v.edge))
        {
            return Err(SoftwareError::Edge { edge: *edge });
        }
        // Tiles, the picture and threads are there once for each volume here: an account that is a little too high.
        let fixed_bytes = volumes.iter().map(|needs| fixed_bytes(&options(needs))).sum::<u64>();
        let beside = (threads.max(1) * BYTES_PER_CELL_AND_THREAD) as u64;
        let wish = |needs: &VolumeNeeds| Wish {
            bytes: bytes_per_slot(&options(needs)) + beside,
            least: needs.least_slots as u64,
            most: needs.most_slots as u64,
        };
        let wishes: Vec<Wish> = volumes.iter().map(wish).collect();
        let shares = share(memory_bytes.saturating_sub(fixed_bytes), &wishes)
            .map_err(|least| SoftwareError::Budget { given_bytes: memory_bytes, least_bytes: fixed_bytes + least })?;
        let used: u64 = shares.iter().zip(&wishes).map(|(count, wish)| count * wish.bytes).sum();
        if fixed_bytes + used > memory_bytes {
            return Err(SoftwareError::Budget { given_bytes: memory_bytes, least_bytes: fixed_bytes + used });
        }
        let volume = |(needs, count): (&VolumeNeeds, u64)| {
            assert!(needs.bricks.apron >= needs.bricks.filter.taps(), "samples need an apron");
            Volume { options: options(needs), slots: Slots::new(count.min(u32::MAX as u64) as u32) }
        };
        let volumes = volumes.iter().zip(shares).map(volume).collect();
        Ok(Self { volumes, max_picture_px, fixed_bytes: fixed_bytes + used, pool: pool(threads)? })
    }

    /// How many bricks of a volume it holds at once.
    pub fn slots(&self, volume: usize) -> u32 {
        self.volumes[volume].slots.len()
    }

    /// What it takes when every slot is full, drawing included; at most the budget.
    pub fn bytes(&self) -> u64 {
        self.fixed_bytes
    }

    /// Puts a volume's padded brick into one of its slots, as [`crate::SoftwareRenderer::upload`].
    ///
    /// # Panics
    /// As there.
    pub fn upload(&mut self, volume: usize, slot: Slot, codes: Arc<[u8]>) {
        let Volume { options, slots } = &mut self.volumes[volume];
        slots.upload(options, slot, codes);
    }

    /// Draws the layers together, one for each volume; or an expression over them.
    ///
    /// # Panics
    /// If there are others, a list names a slot that was never uploaded, or frames, pyramids and options do not belong together or
    /// ask for what several volumes do not have: another mode, another method, an expression that is lit or has surfaces.
    pub fn render(&self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Picture {
        assert_eq!(layers.len(), self.volumes.len(), "a layer for each volume");
        let rays = &layers[0].frame.settings.rays;
        let size = (rays.width, rays.height);
        assert!(
            size.0 <= self.max_picture_px[0] && size.1 <= self.max_picture_px[1],
            "a larger picture than was agreed"
        );
        let tiles: Vec<Tile> = tile::tiles(size.0, size.1).collect();
        let drawn: Vec<TilePixels> = self.pool.install(|| {
            let parts = layers.iter().zip(&self.volumes).enumerate();
            let part = |(i, (layer, volume))| Part::new(layer, volume, combination.map(|_| i));
            let parts: Vec<Part<'_>> = parts.map(part).collect();
            tiles.par_iter().map(|tile| draw(&parts, combination, tile)).collect()
        });
        tile::picture(size, &tiles, &drawn)
    }
}

/// A volume in a frame.
struct Part<'a> {
    frame: Frame<'a>,
    blend: Blend,
    /// Its place, if what is wanted of it are its values.
    read_as: Option<usize>,
    gather: Gather,
}

impl<'a> Part<'a> {
    fn new(layer: &Layer<'a>, Volume { options, slots }: &'a Volume, read_as: Option<usize>) -> Self {
        let settings = &layer.frame.settings;
        assert_eq!(options.edge, layer.pyramid.edge(), "other bricks");
        assert_eq!(options.encoding, settings.encoding, "other codes");
        assert!(options.needs.satisfy(&settings.needs()), "{:?} of bricks", settings.needs());
        let is_udvr = settings.sampling.method == Method::Udvr && settings.sampling.jitter == Jitter::None;
        let is_bare = settings.meshes.is_empty() && settings.grid().is_none();
        let is_plain = settings.mode == Mode::Dvr && is_bare && is_udvr;
        assert!(is_plain, "several volumes are sampled plainly, and classified by value alone");
        let is_lit = layer.frame.is_lit();
        let has_surfaces = !settings.surfaces.is_empty();
        assert!(!(is_lit || has_surfaces) || read_as.is_none(), "what an expression makes has no gradient");
        let brick = |slot: Slot| slots.brick(slot);
        let frame = Frame::new(settings, layer.pyramid, layer.draw, &options.needs, brick);
        let gather = match (options.encoding.format, options.encoding.has_invalid) {
            (SlotFormat::U8, false) => of_look::<Code8, false>(is_lit, has_surfaces),
            (SlotFormat::U8, true) => of_look::<Code8, true>(is_lit, has_surfaces),
            (SlotFormat::U16, false) => of_look::<Code16, false>(is_lit, has_surfaces),
            (SlotFormat::U16, true) => of_look::<Code16, true>(is_lit, has_surfaces),
        };
        Self { frame, blend: layer.frame.blend, read_as, gather }
    }
}

/// What a chunk of segments has.
struct Media {
    /// Of each segment all of it.
    mixtures: [Mixture; CHUNK],
    /// Of volumes that an expression reads: their values, all of a segment's together, and the longest of their parts.
    values: Vec<f64>,
    longest: [f32; CHUNK],
    /// Where there are surfaces: all media one by one, and all surfaces.
    found: Option<Found>,
}

/// What segments with surfaces in them are made of.
#[derive(Default)]
struct Found {
    media: Vec<Share>,
    surfaces: Vec<Met>,
}

/// A volume's medium in a segment, from where to where; `entry` is straight colour and opacity.
struct Share {
    segment: usize,
    blend: Blend,
    entry: Vec4,
    length: f32,
    ends: (f64, f64),
}

/// A surface that a ray meets: straight colour and opacity.
struct Met {
    segment: usize,
    t: f64,
    shown: Vec4,
}

/// What some media are together: of those that mix colour times depth, and depth; what others add.
#[derive(Clone, Copy, Default)]
struct Mixture {
    mixed: Vec4,
    glow: Vec3,
}

impl Mixture {
    /// Twin of [`brickyard_volume::look::Together::put`]; `entry` is straight colour and opacity.
    #[inline(always)]
    fn put(&mut self, blend: Blend, entry: Vec4, length: f32) {
        match blend {
            Blend::Mix => {
                let depth = (-(-entry.w).ln_1p() * std::f32::consts::LOG2_E).min(MAX_DEPTH as f32) * length;
                self.mixed += entry.with_w(1.0) * depth;
            }
            Blend::Add => self.glow += entry.xyz() * (entry.w * length),
        }
    }

    /// Sees a ray's light through it. Twin of [`brickyard_volume::look::Together::seen`].
    #[inline(always)]
    fn see(&self, (color, light): (Vec3, f32)) -> (Vec3, f32) {
        let Self { mixed, glow } = *self;
        let depth = mixed.w;
        let (mut seen, mut left) = (glow, 1.0);
        if depth > 0.0 {
            let nats = depth * std::f32::consts::LN_2;
            let hidden = -(-nats).exp_m1();
            seen = mixed.xyz() * (hidden / depth) + glow * (hidden / nats);
            left = 1.0 - hidden;
        }
        (color + seen * light, light * left)
    }
}

impl Found {
    /// Sees a ray's light through a segment, between the surfaces that were met there.
    fn see(&self, segment: usize, surfaces: &[Met], mut light: (Vec3, f32)) -> (Vec3, f32) {
        let mut start = f64::NEG_INFINITY;
        let between = |start: f64, end: f64| {
            let mut mixture = Mixture::default();
            for Share { blend, entry, length, ends, .. } in self.media.iter().filter(|share| share.segment == segment) {
                let share = (ends.1.min(end) - ends.0.max(start)).max(0.0) / (ends.1 - ends.0);
                mixture.put(*blend, *entry, length * share as f32);
            }
            mixture
        };
        for Met { t, shown, .. } in surfaces {
            light = between(start, *t).see(light);
            light = (light.0 + shown.xyz() * (shown.w * light.1), light.1 * (1.0 - shown.w));
            start = *t;
        }
        between(start, f64::INFINITY).see(light)
    }
}

impl Media {
    /// Of so many volumes that are read, with surfaces among them or not.
    fn new(read: usize, has_surfaces: bool) -> Self {
        let values = vec![f64::NAN; read * CHUNK];
        let found = has_surfaces.then(Found::default);
        Self { mixtures: [Mixture::default(); CHUNK], values, longest: [0.0; CHUNK], found }
    }

    /// Puts in the media of an expression's values, and forgets what it is made of.
    fn combine(&mut self, combination: &Combination, count: usize) {
        let read = self.values.len() / CHUNK;
        for segment in 0..count.min(CHUNK) {
            let length = std::mem::take(&mut self.longest[segment]);
            if length == 0.0 {
                continue;
            }
            let values = segment * read..(segment + 1) * read;
            let look = combination.look(&self.values[values.clone()]);
            self.values[values].fill(f64::NAN);
            if let Some(look) = look {
                self.mixtures[segment].put(Blend::Mix, Vec4::from_array(look), length);
            }
        }
    }

    /// Sees a ray's light through so many segments, and empties them.
    #[inline(always)]
    fn see(&mut self, count: usize, mut light: (Vec3, f32)) -> (Vec3, f32) {
        if let Some(found) = self.found.as_mut().filter(|found| !found.surfaces.is_empty()) {
            light = Self::see_surfaces(&self.mixtures[..count], found, light);
        } else {
            for mixture in &self.mixtures[..count.min(CHUNK)] {
                light = mixture.see(light);
            }
        }
        if let Some(found) = &mut self.found {
            found.media.clear();
        }
        self.mixtures[..count].fill(Mixture::default());
        light
    }

    /// The same where there are surfaces in some of them.
    fn see_surfaces(mixtures: &[Mixture], found: &mut Found, mut light: (Vec3, f32)) -> (Vec3, f32) {
        let mut surfaces = std::mem::take(&mut found.surfaces);
        surfaces.sort_by(|a, b| a.segment.cmp(&b.segment).then(a.t.total_cmp(&b.t)));
        let mut rest = &surfaces[..];
        for (segment, mixture) in mixtures.iter().enumerate() {
            let (here, after) = rest.split_at(rest.iter().take_while(|met| met.segment == segment).count());
            rest = after;
            light = if here.is_empty() { mixture.see(light) } else { found.see(segment, here, light) };
        }
        // Keeps the room.
        surfaces.clear();
        found.surfaces = surfaces;
        light
    }
}

/// Some neighbouring segments of a ray that belong to one cell.
#[derive(Clone, Copy)]
struct Run {
    cell: u32,
    /// The first tick, and one past the last.
    first: u32,
    end: u32,
}

/// A ray's way through one volume.
struct Way {
    part: usize,
    ray: Ray,
    /// Of its runs, those that are not done.
    runs: Range<usize>,
}

/// What a thread works with.
struct Scratch {
    runs: Vec<Run>,
    ways: Vec<Way>,
    chunk: Chunk,
    media: Media,
}

fn draw(parts: &[Part<'_>], combination: Option<&Combination>, tile: &Tile) -> TilePixels {
    let meets = |cell: &Cell<'_>| {
        let rect = &cell.rect;
        rect.x0 < tile.x1 && tile.x0 < rect.x1 && rect.y0 < tile.y1 && tile.y0 < rect.y1
    };
    let over = |part: &Part<'_>| {
        let cells = part.frame.cells.iter().zip(0..).filter(|(cell, _)| meets(cell));
        // What shows nothing anyhow is not even met; but where two bricks meet may be a surface.
        let has_surfaces = !part.frame.settings.surfaces.is_empty();
        cells.filter(|(cell, _)| has_surfaces || cell.mask.coverage() != Coverage::None).map(|(_, i)| i).collect()
    };
    let cells: Vec<Vec<u32>> = parts.iter().map(over).collect();
    let has_surfaces = parts.iter().any(|part| !part.frame.settings.surfaces.is_empty());
    let media = Media::new(combination.map_or(0, |_| parts.len()), has_surfaces);
    let mut scratch = Scratch { runs: Vec::new(), ways: Vec::new(), chunk: Chunk::EMPTY, media };
    let mut pixels = [[0; 3]; (TILE_PX * TILE_PX) as usize];
    for y in tile.y0..tile.y1 {
        for x in tile.x0..tile.x1 {
            scratch.follow(parts, &cells, x, y);
            let (color, light) = scratch.march(parts, combination);
            let background = Vec3::from_array(parts[0].frame.settings.background);
            pixels[place(tile, x, y)] = Picture::quantise((color + background * light).to_array());
        }
    }
    pixels
}

impl Scratch {
    /// Finds a pixel's runs in all volumes.
    fn follow(&mut self, parts: &[Part<'_>], cells: &[Vec<u32>], x: u32, y: u32) {
        self.runs.clear();
        self.ways.clear();
        for (part, (Part { frame, .. }, over)) in parts.iter().zip(cells).enumerate() {
            if over.is_empty() {
                continue;
            }
            let mut ray = Ray::new(frame, x, y, Vec4::ZERO, [0.0, f64::INFINITY]);
            let from = self.runs.len();
            for &index in over {
                if ray.cursor >= ray.end {
                    break;
                }
                let cell = &frame.cells[index as usize];
                if cell.pixels.is_some_and(|pixels| !pixels.hold(x, y)) {
                    continue;
                }
                if let Some((first, end)) = ray.run(&frame.ticks, cell, Reach::Middles) {
                    ray.cursor = end;
                    self.runs.push(Run { cell: index, first, end });
                }
            }
            if self.runs.len() > from {
                self.ways.push(Way { part, ray, runs: from..self.runs.len() });
            }
        }
    }

    /// Goes along them, front to back. Returns colour and the light that is left.
    fn march(&mut self, parts: &[Part<'_>], combination: Option<&Combination>) -> (Vec3, f32) {
        let mut light = (Vec3::ZERO, 1.0);
        // The same for all.
        let ticks = &parts[0].frame.ticks;
        let first = |way: &Way| self.runs[way.runs.start].first;
        let mut next = self.ways.iter().map(first).min();
        while let Some(tick) = next.filter(|_| light.1 >= FAINTEST) {
            let zone = ticks.zone(tick);
            let end = (tick + ((CHUNK as u32) << zone)).min(ticks.zone_end(zone));
            next = None;
            for Way { part, ray, runs } in &mut self.ways {
                let part = &parts[*part];
                while let Some(&run) = self.runs[runs.clone()].first() {
                    if run.first < end {
                        let (from, to) = (run.first.max(tick), run.end.min(end));
                        let cell = &part.frame.cells[run.cell as usize];
                        let at = ((from - tick) >> zone) as usize;
                        (part.gather)(part, cell, ray, from..to, at, &mut self.chunk, &mut self.media);
                    }
                    if run.end > end {
                        let after = run.first.max(end);
                        next = Some(next.map_or(after, |next| next.min(after)));
                        break;
                    }
                    runs.start += 1;
                }
            }
            let count = ((end - tick) >> zone) as usize;
            if let Some(combination) = combination {
                self.media.combine(combination, count);
            }
            light = self.media.see(count, light);
        }
        light
    }
}

/// Leaves what a cell has in a run of segments, from one of a chunk's on.
type Gather = fn(&Part<'_>, &Cell<'_>, &mut Ray, Range<u32>, usize, &mut Chunk, &mut Media);

fn of_look<C: Code, const INVALID: bool>(is_lit: bool, has_surfaces: bool) -> Gather {
    match (is_lit, has_surfaces) {
        (false, false) => for_machine::<C, INVALID, PLAIN>(),
        (true, false) => for_machine::<C, INVALID, LIT>(),
        (false, true) => for_machine::<C, INVALID, LAYERED>(),
        (true, true) => for_machine::<C, INVALID, { LIT | LAYERED }>(),
    }
}

/// What a gathering does besides sampling: lights what it finds, or finds surfaces.
const PLAIN: u8 = 0;
const LIT: u8 = 1;
const LAYERED: u8 = 2;

fn for_machine<C: Code, const INVALID: bool, const LOOK: u8>() -> Gather {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the machine has AVX2.
        return |part, cell, ray, run, at, chunk, media| unsafe {
            gather_avx2::<C, INVALID, LOOK>(part, cell, ray, run, at, chunk, media);
        };
    }
    gather::<C, Portable, INVALID, LOOK>
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn gather_avx2<C: Code, const INVALID: bool, const LOOK: u8>(
    part: &Part<'_>,
    cell: &Cell<'_>,
    ray: &mut Ray,
    run: Range<u32>,
    at: usize,
    chunk: &mut Chunk,
    media: &mut Media,
) {
    gather::<C, Avx2, INVALID, LOOK>(part, cell, ray, run, at, chunk, media);
}

#[inline(always)]
fn gather<C: Code, U: Unit, const INVALID: bool, const LOOK: u8>(
    Part { frame, blend, read_as, .. }: &Part<'_>,
    cell: &Cell<'_>,
    ray: &mut Ray,
    run: Range<u32>,
    at: usize,
    chunk: &mut Chunk,
    media: &mut Media,
) {
    let (is_lit, has_surfaces) = (LOOK & LIT != 0, LOOK & LAYERED != 0);
    let reach = if has_surfaces { Reach::Ends } else { Reach::Middles };
    let coverage =
        if has_surfaces { <Medium<true> as blend::Blend>::coverage(cell, ray) } else { cell.mask.coverage() };
    if coverage == Coverage::None {
        return;
    }
    let mut stretch = Stretch::new(frame, cell, ray, 0, run.start, run.end, reach);
    if coverage == Coverage::Some {
        match has_surfaces {
            true => stretch.look::<Medium<true>>(cell, Vec4::ZERO, &mut [0; LANES]),
            false => stretch.look::<Dvr>(cell, Vec4::ZERO, &mut [0; LANES]),
        }
    }
    let brick = Brick::new::<C>(cell.brick.voxels(), frame.edge + 2 * frame.apron);
    let march = March { frame, cell, brick };
    let (entries, filter) = (Entries::of(frame), frame.settings.sampling.filter);
    let path = if LOOK != PLAIN { Some(Path::new(&march, &stretch, ray)) } else { None };
    let mut seen = stretch.seen;
    while let Some(segments) = stretch.next_seen(&mut seen) {
        // Blocks are asked for eight at a time, those past the last among them.
        if segments.is_empty() {
            break;
        }
        stretch.place_samples::<INVALID>(frame, ray, chunk, segments.clone());
        march.brick.filtered::<C, U, INVALID>(filter, stretch.origin, stretch.step, chunk);
        for (i, segment) in segments.clone().enumerate().take(CHUNK) {
            let (code, weight) = (chunk.code[i / LANES][i % LANES], chunk.weight[i / LANES][i % LANES]);
            let place = at + segment as usize;
            if let Some(volume) = *read_as {
                if weight > 0.0 {
                    let read = media.values.len() / CHUNK;
                    media.values[place * read + volume] = frame.settings.encoding.value(code as f64 / C::MAX as f64);
                    media.longest[place] = media.longest[place].max(weight);
                }
                continue;
            }
            let mut entry = entries.lookup(code * frame.positions_per_code);
            if weight > 0.0 && entry.w > 0.0 {
                if let Some(path) = path.as_ref().filter(|_| is_lit) {
                    let along = chunk.along[i / LANES][i % LANES];
                    entry = path.lit_sample::<C, U, INVALID>(along, code, entry.xyz()).extend(entry.w);
                }
                media.mixtures[place].put(*blend, entry, weight);
                if let Some(found) = &mut media.found {
                    let ends = ray.ends(&frame.ticks, stretch.start + ((segment as u32) << stretch.zone));
                    found.media.push(Share { segment: place, blend: *blend, entry, length: weight, ends });
                }
            }
        }
        if let (Some(path), Some(found)) = (path.filter(|_| has_surfaces), &mut media.found) {
            stretch.reach::<INVALID>(ray, &segments);
            let mut pieces = Pieces::new(&march, &stretch, path, segments);
            while let Some(piece) = pieces.next::<C, U, INVALID>(ray) {
                let Some((surface, along)) = piece.surface else { continue };
                let (segment, t) = (at + piece.segments.start as usize, path.distance(along));
                found.surfaces.push(Met { segment, t, shown: path.surface::<C, U, INVALID>(surface, along) });
            }
        }
    }
}
