//! Layers that are drawn together in direct volume rendering, fog and surfaces, as [`brickyard_volume::look`] says; or an expression over
//! them.
//!
//! A tile's rays are taken one by one. Of each layer a ray finds the runs of its segments that belong to the cells over the tile, as it does
//! for one layer; then it goes along the lattice in chunks of 32 segments, in which one layer after the other leaves what it shows by itself
//! (`gather`: sampled only where macro-cells may show something), and then one segment after the other is seen through. So no layer is
//! sampled much behind where light ends, and costs add up. Where layers have surfaces, those of a chunk are kept, and all pieces
//! of media between them: a segment with surfaces in it is seen through piece by piece.

use crate::frame::{Cell, Frame};
use crate::gather::{Gather, Way, gather_of};
use crate::macrocells::{Coverage, Reach};
use crate::march::Seen;
use crate::media::{Media, See};
use crate::meshes::Layers;
use crate::packet::CHUNK;
use crate::ray::{FAINTEST, Ray};
use crate::sample::Chunk;
use crate::tiles::{Tile, place};
use brickyard_volume::Combination;
use glam::Vec4;

/// The layers of a frame, and what is done with them.
pub(crate) struct Together<'a> {
    gathers: Vec<Gather>,
    see: See,
    has_surfaces: bool,
    combination: Option<&'a Combination>,
}

/// Some neighbouring segments of a ray that belong to one cell.
#[derive(Clone, Copy)]
pub(crate) struct Run {
    cell: u32,
    /// The first tick, and one past the last.
    first: u32,
    end: u32,
}

/// What a thread keeps for a cell of the draw list: that it is over the tile, and which segments of a ray are its.
pub(crate) const BYTES_PER_CELL_AND_THREAD: usize = size_of::<u32>() + size_of::<Run>();

/// A cell that rays enter in a chunk: its layer, its place, and the chunk's segment.
struct Entry {
    layer: usize,
    cell: u32,
    segment: usize,
}

/// What a thread works with.
struct Work {
    runs: Vec<Run>,
    ways: Vec<Way>,
    entries: Vec<Entry>,
    chunk: Chunk,
    media: Media,
}

impl<'a> Together<'a> {
    pub(crate) fn new(frames: &[Frame<'_>], combination: Option<&'a Combination>) -> Self {
        let has_surfaces = frames.iter().any(|frame| !frame.settings.surfaces.is_empty());
        let gather = |frame| gather_of(frame, has_surfaces, combination.is_some());
        Self { gathers: frames.iter().map(gather).collect(), see: See::for_machine(), has_surfaces, combination }
    }

    /// Takes a tile's rays through all layers, between the layers of meshes where there are some.
    pub(crate) fn march(&self, frames: &[Frame<'_>], tile: &Tile, layers: Option<&Layers>, seen: &mut Seen) {
        let over = |frame: &Frame<'_>| -> Vec<u32> {
            let cells = frame.cells.iter().zip(0..);
            cells.filter(|(cell, _)| meets(cell, tile)).map(|(_, i)| i).collect()
        };
        let cells: Vec<Vec<u32>> = frames.iter().map(over).collect();
        let read = if self.combination.is_some() { frames.len() } else { 0 };
        let mut work = Work {
            runs: Vec::new(),
            ways: Vec::new(),
            entries: Vec::new(),
            chunk: Chunk::EMPTY,
            media: Media::new(read, self.has_surfaces),
        };
        for y in tile.y0..tile.y1 {
            for x in tile.x0..tile.x1 {
                let i = place(tile, x, y);
                let limits = layers.map_or([0.0, f64::INFINITY], |layers| layers.limits(i));
                work.follow(frames, &cells, [x, y], limits);
                seen[i] = work.march(self, frames);
            }
        }
    }
}

fn meets(cell: &Cell<'_>, tile: &Tile) -> bool {
    let rect = &cell.rect;
    rect.x0 < tile.x1 && tile.x0 < rect.x1 && rect.y0 < tile.y1 && tile.y0 < rect.y1
}

impl Work {
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
        // One lattice for all, moved by where the first of them is entered.
        let shift = frames[0].shift(x, y, entry);
        for way in &mut self.ways {
            let frame = &frames[way.layer];
            way.ray.set_out(&frame.ticks, shift, limits);
            let from = self.runs.len();
            for &index in &cells[way.layer] {
                if way.ray.cursor >= way.ray.end {
                    break;
                }
                let cell = &frame.cells[index as usize];
                let (rect, pixels) = (&cell.rect, &cell.pixels);
                let is_over = rect.x0 <= x && x < rect.x1 && rect.y0 <= y && y < rect.y1;
                if !is_over || pixels.is_some_and(|pixels| !pixels.hold(x, y)) || is_done(frame, cell) {
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

    /// Goes along them, front to back. Returns premultiplied colour and the light that is left.
    fn march(&mut self, together: &Together<'_>, frames: &[Frame<'_>]) -> Vec4 {
        let mut light = Vec4::W;
        // The same for all.
        let ticks = &frames[0].ticks;
        let mut next = self.ways.iter().map(|way| self.runs[way.runs.start].first).min();
        while let Some(tick) = next.filter(|_| light.w >= FAINTEST) {
            let zone = ticks.zone(tick);
            let end = (tick + ((CHUNK as u32) << zone)).min(ticks.zone_end(zone));
            next = self.gather(together, frames, tick..end, zone);
            let count = ((end - tick) >> zone) as usize;
            if let Some(combination) = together.combination {
                self.media.combine(combination, count);
            }
            light = (together.see.0)(&mut self.media, count, light);
            for Entry { layer, cell, segment } in self.entries.drain(..) {
                let (frame, entered) = (&frames[layer], self.media.light[segment]);
                let cell = &frame.cells[cell as usize];
                if entered >= FAINTEST && entered > frame.entered(cell) {
                    frame.enter(cell, entered);
                }
            }
        }
        light
    }

    /// Leaves in the media what all layers have in a chunk of segments. Returns where something may follow.
    fn gather(
        &mut self,
        together: &Together<'_>,
        frames: &[Frame<'_>],
        ticks: std::ops::Range<u32>,
        zone: usize,
    ) -> Option<u32> {
        let mut next: Option<u32> = None;
        for way in &mut self.ways {
            let frame = &frames[way.layer];
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
                        (together.gathers[way.layer])(frame, cell, way, run, at, &mut self.chunk, &mut self.media);
                    }
                }
                if shows && run.end > ticks.end {
                    let after = run.first.max(ticks.end);
                    next = Some(next.map_or(after, |next| next.min(after)));
                    break;
                }
                way.runs.start += 1;
            }
        }
        next
    }
}

/// Whether a cell shows nothing, and has been entered with all light.
fn is_done(frame: &Frame<'_>, cell: &Cell<'_>) -> bool {
    let is_clear = frame.settings.surfaces.is_empty() && cell.mask.coverage() == Coverage::None;
    is_clear && frame.entered(cell) >= 1.0
}
