//! Joint direct volume rendering of several layers, fog and surfaces, by the rules of
//! [`brickyard_volume::compositing`]; or of an expression over them.
//!
//! Every ray meets layers with a common cut alike: a tile's rays are taken cell by cell, and find their segments in a
//! cell once for all layers; through plain fog they go side by side (`channels`). Otherwise rays are taken one by one:
//! in each layer, a ray finds the runs of its segments in the cells over the tile. Either way a ray then follows the
//! lattice in chunks of 32 segments. Layer by layer, media are added to the chunk (`gather`: sampled only in possibly
//! visible macro-cells), and then light passes through segment by segment. So no layer is sampled much behind the end
//! of the light, and costs add up. If layers have surfaces, those of a chunk are kept, with all pieces of media between
//! them: light passes a segment with surfaces piece by piece.

use crate::channels::{self, Channels, Walks};
use crate::choice::Choice;
use crate::frame::{Cell, Frame};
use crate::gather::{Gather, Gathering, Way};
use crate::macrocells::{Coverage, Reach};
use crate::march::Seen;
use crate::media::Media;
use crate::meshes::MeshLayers;
use crate::packet::CHUNK;
use crate::ray::{FAINTEST, Past, Ray};
use crate::tiles::{PIXELS, Tile, place, places};
use crate::unit::call;
use brickyard_volume::{Combination, CutFace};
use glam::{DVec3, Vec4};

/// Drawing of a frame's layers together, ray by ray or cell by cell.
pub(crate) struct JointMarch<'a> {
    gathers: Vec<Gather>,
    has_surfaces: bool,
    combination: Option<&'a Combination>,
    /// The cells of all layers, front to back, if they are of one cut.
    cells: Option<Vec<Shared>>,
    /// The side-by-side drawing of layers with a common cut, if all are plain fog.
    channels: Option<Channels>,
}

/// A layer's entry of a cell of the shared cut.
struct Shared {
    rank: u32,
    layer: u32,
    cell: u32,
}

impl Shared {
    fn cell<'a, 'f>(&self, frames: &'a [Frame<'f>]) -> &'a Cell<'f> {
        &frames[self.layer as usize].cells[self.cell as usize]
    }

    fn is_done(&self, frames: &[Frame<'_>], light: f32) -> bool {
        is_done(&frames[self.layer as usize], self.cell(frames), light)
    }
}

/// Consecutive segments of a ray in one cell.
#[derive(Clone, Copy)]
pub(crate) struct Run {
    cell: u32,
    /// The first tick, and one past the last.
    first: u32,
    end: u32,
}

/// Bytes per thread and draw list cell: its index among the cells over the tile, and a ray's run in it. Layers with a
/// common cut take at most that once for all threads.
pub(crate) const BYTES_PER_CELL_AND_THREAD: usize = size_of::<u32>() + size_of::<Run>();

const _: () = assert!(size_of::<Shared>() <= BYTES_PER_CELL_AND_THREAD);

pub(crate) const BYTES_PER_LAYER_AND_THREAD: usize =
    size_of::<Way>() + size_of::<[Past; PIXELS]>() + channels::BYTES_PER_LAYER_AND_THREAD;

/// A cell entered within a chunk: its layer, its place, and the segment.
struct Entry {
    layer: usize,
    cell: u32,
    segment: usize,
}

/// A thread's working memory.
struct Work {
    /// Where any layer is shown along the ray, from and to.
    stretch: [f64; 2],
    runs: Vec<Run>,
    ways: Vec<Way>,
    entries: Vec<Entry>,
    media: Media,
    walks: Walks,
    /// Each layer's surface state of rays that go cell by cell.
    pasts: Vec<[Past; PIXELS]>,
}

impl<'a> JointMarch<'a> {
    pub(crate) fn new(frames: &[Frame<'_>], combination: Option<&'a Combination>, is_one_cut: bool) -> Self {
        let has_surfaces = frames.iter().any(|frame| !frame.settings.surfaces.is_empty());
        let is_read = combination.is_some();
        let gather = |frame| Gathering { frame, has_surfaces, is_read }.for_machine(&frame.settings.encoding);
        let cells = is_one_cut.then(|| {
            let mut cells = Vec::new();
            for (layer, frame) in (0..).zip(frames) {
                cells.extend((0..).zip(&frame.cells).map(|(i, cell)| Shared { rank: cell.order, layer, cell: i }));
            }
            cells.sort_by_key(|shared| std::cmp::Reverse(shared.rank));
            cells
        });
        let channels = (is_one_cut && combination.is_none() && !has_surfaces).then(|| Channels::new(frames)).flatten();
        Self { gathers: frames.iter().map(gather).collect(), has_surfaces, combination, cells, channels }
    }

    fn work(&self, frames: &[Frame<'_>]) -> Work {
        let read = if self.combination.is_some() { frames.len() } else { 0 };
        Work {
            stretch: [0.0; 2],
            runs: Vec::new(),
            ways: Vec::new(),
            entries: Vec::new(),
            media: Media::new(read, frames[0].is_lit, self.has_surfaces),
            walks: Walks::new(self.channels.as_ref()),
            pasts: Vec::new(),
        }
    }

    /// Takes a tile's rays through all layers, between the layers of meshes if any; `rays` is scratch space.
    pub(crate) fn march(
        &self,
        frames: &[Frame<'_>],
        tile: &Tile,
        layers: Option<&MeshLayers>,
        rays: &mut [Ray; PIXELS],
        seen: &mut Seen,
    ) {
        let limits = |i: usize| layers.map_or([0.0, f64::INFINITY], |layers| layers.limits(i));
        let mut work = self.work(frames);
        if let Some(cells) = &self.cells {
            for (i, [x, y]) in pixels(tile) {
                rays[i] = Ray::new(&frames[0], x, y, Vec4::W, limits(i));
            }
            work.march_cells(self, frames, cells, tile, rays);
            return places(tile).for_each(|i| seen[i] = rays[i].sum);
        }
        let over = |frame: &Frame<'_>| -> Vec<u32> {
            let cells = frame.cells.iter().zip(0..);
            cells.filter(|(cell, _)| cell.rect.meets(tile)).map(|(_, i)| i).collect()
        };
        let cells: Vec<Vec<u32>> = frames.iter().map(over).collect();
        for (i, pixel) in pixels(tile) {
            if frames[0].is_given_up() {
                return;
            }
            work.follow(frames, &cells, pixel, limits(i));
            seen[i] = work.march(self, frames, Vec4::W);
        }
    }
}

/// The places of a tile's pixels, with their picture coordinates.
fn pixels(tile: &Tile) -> impl Iterator<Item = (usize, [u32; 2])> {
    let Tile { x0, x1, y0, y1 } = *tile;
    places(tile).zip((y0..y1).flat_map(move |y| (x0..x1).map(move |x| [x, y])))
}

impl Work {
    /// Takes a tile's started rays cell by cell through layers with a common cut; their sums become premultiplied
    /// colour and remaining light.
    fn march_cells(
        &mut self,
        together: &JointMarch<'_>,
        frames: &[Frame<'_>],
        cells: &[Shared],
        tile: &Tile,
        rays: &mut [Ray; PIXELS],
    ) {
        self.ways = (0..frames.len()).map(|layer| Way::new(layer, Ray::EMPTY)).collect();
        self.pasts = vec![[Past::NONE; PIXELS]; if together.has_surfaces { frames.len() } else { 0 }];
        let mut waiting = places(tile).filter(|&i| rays[i].cursor < rays[i].end).count();
        for entries in cells.chunk_by(|a, b| a.rank == b.rank) {
            if waiting == 0 || frames[0].is_given_up() {
                break;
            }
            let cell = entries[0].cell(frames);
            let channels = together.channels.as_ref().and_then(|channels| {
                let cells = entries.iter().map(|entry| (entry.layer as usize, entry.cell(frames)));
                Some((channels, channels.parts(frames, cells)?))
            });
            let (x0, x1) = (cell.rect.x0.max(tile.x0), cell.rect.x1.min(tile.x1));
            for y in cell.rect.y0.max(tile.y0)..cell.rect.y1.min(tile.y1) {
                if frames[0].is_given_up() {
                    return;
                }
                for x in x0..x1 {
                    let i = place(tile, x, y);
                    let ray = &mut rays[i];
                    if ray.cursor >= ray.end || entries.iter().all(|entry| entry.is_done(frames, ray.sum.w)) {
                        continue;
                    }
                    let Some(run) = ray.run(&frames[0].ticks, cell, Reach::Middles) else { continue };
                    ray.cursor = run.1;
                    if let Some((channels, parts)) = &channels {
                        if self.walks.enter(parts, ray, i, [x, y], run) {
                            waiting -= channels.march(parts, &mut self.walks, rays);
                        }
                        continue;
                    }
                    self.enter(frames, entries, ray, i, [x, y], run);
                    ray.sum = self.march(together, frames, ray.sum);
                    for (pasts, way) in self.pasts.iter_mut().zip(&self.ways) {
                        pasts[i] = way.ray.past;
                    }
                    if ray.sum.w < FAINTEST {
                        ray.cursor = ray.end;
                    }
                    waiting -= (ray.cursor >= ray.end) as usize;
                }
            }
            if let Some((channels, parts)) = &channels {
                waiting -= channels.march(parts, &mut self.walks, rays);
            }
        }
    }

    /// Starts a pixel's ray through a cell, with these segments, in all layers that draw the cell there.
    fn enter(
        &mut self,
        frames: &[Frame<'_>],
        entries: &[Shared],
        ray: &Ray,
        place: usize,
        [x, y]: [u32; 2],
        (first, end): (u32, u32),
    ) {
        self.runs.clear();
        self.stretch = ray.stretch();
        for way in &mut self.ways {
            way.runs = 0..0;
            way.ray = *ray;
            if let Some(pasts) = self.pasts.get(way.layer) {
                way.ray.past = pasts[place];
            }
        }
        for entry in entries {
            if !entry.cell(frames).draws(x, y) {
                continue;
            }
            self.ways[entry.layer as usize].runs = self.runs.len()..self.runs.len() + 1;
            self.runs.push(Run { cell: entry.cell, first, end });
        }
    }

    /// Finds the runs of a pixel's ray in all layers.
    fn follow(&mut self, frames: &[Frame<'_>], cells: &[Vec<u32>], [x, y]: [u32; 2], limits: [f64; 2]) {
        self.runs.clear();
        self.ways.clear();
        let mut entry = f64::INFINITY;
        for (layer, frame) in frames.iter().enumerate() {
            let ray = Ray::aim(frame, x, y);
            if let Some(t_in) = ray.entry() {
                entry = entry.min(t_in);
                self.ways.push(Way::new(layer, ray));
            }
        }
        // One lattice for all, shifted by the entry into the nearest layer.
        let shift = frames[0].shift(x, y, entry);
        self.stretch = [f64::INFINITY, 0.0];
        for way in &mut self.ways {
            let frame = &frames[way.layer];
            way.ray.set_out(&frame.ticks, shift, limits);
            if way.ray.first < way.ray.end {
                let ([enter, leave], [first, last]) = (way.ray.stretch(), self.stretch);
                self.stretch = [enter.min(first), leave.max(last)];
            }
            let from = self.runs.len();
            for &index in &cells[way.layer] {
                if way.ray.cursor >= way.ray.end {
                    break;
                }
                let cell = &frame.cells[index as usize];
                let rect = &cell.rect;
                let is_over = rect.x0 <= x && x < rect.x1 && rect.y0 <= y && y < rect.y1;
                if !is_over || !cell.draws(x, y) || is_done(frame, cell, 1.0) {
                    continue;
                }
                if let Some((first, end)) = way.ray.run(&frame.ticks, cell, Reach::Middles) {
                    way.ray.cursor = end;
                    self.runs.push(Run { cell: index, first, end });
                }
            }
            way.runs = from..self.runs.len();
        }
        self.ways.retain(|way| !way.runs.is_empty());
    }

    /// Follows the runs front to back. Returns premultiplied colour and the remaining light.
    fn march(&mut self, together: &JointMarch<'_>, frames: &[Frame<'_>], mut light: Vec4) -> Vec4 {
        // All layers share one lattice.
        let ticks = &frames[0].ticks;
        let mut next = self.ways.iter().filter_map(|way| Some(self.runs.get(way.runs.clone())?.first()?.first)).min();
        while let Some(tick) = next.filter(|_| light.w >= FAINTEST) {
            let zone = ticks.zone(tick);
            let end = (tick + ((CHUNK as u32) << zone)).min(ticks.zone_end(zone));
            next = self.gather(together, frames, tick..end, zone);
            let count = ((end - tick) >> zone) as usize;
            if let Some(combination) = together.combination {
                let shade = self.ways.first().map(|way| shade(&frames[way.layer], &way.ray, self.stretch, tick, zone));
                self.media.combine(combination, count, |segment, color, normal| match &shade {
                    Some(shade) => shade(segment, color, normal),
                    None => color,
                });
            }
            light = call(
                light,
                #[inline(always)]
                |light| self.media.see(count, light),
            );
            for Entry { layer, cell, segment } in self.entries.drain(..) {
                let (frame, visibility) = (&frames[layer], self.media.light[segment]);
                let cell = &frame.cells[cell as usize];
                if visibility >= FAINTEST && visibility > frame.visibility(cell) {
                    frame.enter(cell, visibility);
                }
            }
        }
        light
    }

    /// Adds the media of all layers in a chunk of segments. Returns the tick of the next possible content.
    fn gather(
        &mut self,
        together: &JointMarch<'_>,
        frames: &[Frame<'_>],
        ticks: std::ops::Range<u32>,
        zone: usize,
    ) -> Option<u32> {
        let mut next: Option<u32> = None;
        for way in &mut self.ways {
            let frame = &frames[way.layer];
            // Nothing is visible behind an opaque surface met by an earlier layer.
            let ticks = ticks.start..ticks.end.min(ticks.start + ((self.media.end as u32) << zone));
            while let Some(&run) = self.runs[way.runs.clone()].first() {
                let cell = &frame.cells[run.cell as usize];
                let mut shows = true;
                if run.first < ticks.end {
                    let from = run.first.max(ticks.start);
                    let at = ((from - ticks.start) >> zone) as usize;
                    if run.first == from {
                        self.entries.push(Entry { layer: way.layer, cell: run.cell, segment: at });
                        shows = way.enter(frame, cell, run.end);
                    }
                    if shows {
                        let run = from..run.end.min(ticks.end);
                        (together.gathers[way.layer])(frame, cell, way, run, at, &mut self.media);
                    }
                }
                let after = if run.first >= ticks.end { Some(run.first) } else { way.next().filter(|_| shows) };
                if let Some(after) = after {
                    next = Some(next.map_or(after, |next| next.min(after)));
                    break;
                }
                way.runs.start += 1;
            }
        }
        next
    }
}

/// Returns a function that lights the colours of a chunk's segments from a tick on, along a layer's ray, at the middle
/// of each segment's part shown of any layer.
fn shade<'a>(
    frame: &'a Frame<'_>,
    ray: &Ray,
    [enter, leave]: [f64; 2],
    tick: u32,
    zone: usize,
) -> impl Fn(usize, DVec3, Option<DVec3>) -> DVec3 + use<'a> {
    let (settings, ticks) = (frame.settings, &frame.ticks);
    let (eye, direction) = ray.in_world(frame);
    let length = ticks.step * (1u64 << zone) as f64;
    let cut = ray.cut(frame, [1.0; 3]);
    move |segment, color, normal| {
        let start = tick as f64 * ticks.step + segment as f64 * length;
        let middle = 0.5 * (start.max(enter) + (start + length).min(leave));
        let normal = match cut {
            Some((cut, rate)) => cut.mixed(normal, direction, CutFace::share((middle - cut.entry) * rate)),
            None => normal,
        };
        settings.lighting.shade(color, normal, direction, eye + direction * middle)
    }
}

/// Whether a cell is invisible and has already been entered with this much light.
fn is_done(frame: &Frame<'_>, cell: &Cell<'_>, light: f32) -> bool {
    let is_clear = frame.settings.surfaces.is_empty() && cell.mask.coverage() == Coverage::None;
    is_clear && frame.visibility(cell) >= light
}
