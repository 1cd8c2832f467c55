//! One layer's media in a chunk of a ray's segments, for [`compositing`](crate::compositing): compiled for every code
//! width and vector unit.

use crate::choice::Choice;
use crate::frame::{Cell, Frame};
use crate::macrocells::{Coverage, Reach};
use crate::march::look;
use crate::media::{Media, Met};
use crate::medium::Medium;
use crate::modes::{Accumulate, Dvr};
use crate::packet::{CHUNK, LANES, PACKETS};
use crate::path::Path;
use crate::pieces::Pieces;
use crate::ray::Ray;
use crate::reading::Reading;
use crate::sample::{ALL_PACKETS, Code};
use crate::stretch::{March, Stretch};
use crate::transfer_table::Entries;
use crate::unit::Unit;
use brickyard_volume::Mode;
use brickyard_volume::surface::Meeting;
use glam::{DVec3, Vec4};
use std::ops::Range;

/// A ray's way through one layer's cells.
pub(crate) struct Way {
    pub(crate) layer: usize,
    pub(crate) ray: Ray,
    /// The ray's unfinished runs in this layer, by their indices among all runs.
    pub(crate) runs: Range<usize>,
    /// The current stretch, its untaken visible blocks, and the segments to take next.
    stretch: Stretch,
    seen: u64,
    pending: Range<i32>,
    /// How much of the current cell is visible, and one past the last tick there.
    coverage: Coverage,
    last: u32,
}

impl Way {
    pub(crate) fn new(layer: usize, ray: Ray) -> Self {
        let (stretch, coverage) = (Stretch::EMPTY, Coverage::None);
        Self { layer, ray, runs: 0..0, stretch, seen: 0, pending: 0..0, coverage, last: 0 }
    }

    /// Enters a cell; the ray's segments there end at the tick `last`. Returns whether the cell may show anything.
    #[inline(always)]
    pub(crate) fn enter(&mut self, frame: &Frame<'_>, cell: &Cell<'_>, last: u32) -> bool {
        (self.stretch.end, self.last) = (0, last);
        self.coverage = match frame.settings.surfaces.is_empty() {
            true => cell.mask.coverage(),
            false => <Medium<true> as Accumulate>::coverage(cell, &self.ray),
        };
        self.coverage != Coverage::None
    }

    /// Starts the stretch at tick `start`; with `ends`, segments are examined from end to end.
    #[inline(always)]
    fn begin(&mut self, frame: &Frame<'_>, cell: &Cell<'_>, start: u32, ends: bool) {
        let reach = if ends { Reach::Ends } else { Reach::Middles };
        self.stretch = Stretch::new(frame, cell, &self.ray, 0, start, self.last, reach);
        if self.coverage == Coverage::Some {
            match ends {
                true => look::<Medium<true>>(&mut self.stretch, frame, cell, Vec4::ZERO, &mut [0; LANES]),
                false => look::<Dvr>(&mut self.stretch, frame, cell, Vec4::ZERO, &mut [0; LANES]),
            }
        }
        (self.seen, self.pending) = (self.stretch.seen, 0..0);
    }

    /// The next tick of the cell with possible content; `None` if there is none left.
    #[inline(always)]
    pub(crate) fn next(&self) -> Option<u32> {
        let Stretch { start, end, zone, count, block, .. } = self.stretch;
        let segment = match self.pending.is_empty() {
            true if self.seen == 0 => count,
            true => (self.seen.trailing_zeros() as i32).saturating_mul(block),
            false => self.pending.start,
        };
        let tick = if segment < count { start + ((segment as u32) << zone) } else { end };
        (tick < self.last).then_some(tick)
    }

    #[inline(always)]
    fn next_seen(&mut self, end: i32) -> Option<Range<i32>> {
        if self.pending.is_empty() {
            self.pending = self.stretch.next_seen(&mut self.seen)?;
        }
        let Range { start, end: last } = self.pending;
        let until = if last < end { last } else { end };
        if start >= until {
            return None;
        }
        self.pending.start = until;
        Some(start..until)
    }
}

/// Adds a layer's media of a cell in a run of segments. The number is the place in the chunk of the run's first
/// segment.
pub(crate) type Gather = fn(&Frame<'_>, &Cell<'_>, &mut Way, Range<u32>, usize, &mut Media);

/// The use made of samples.
trait Look {
    /// Whether segments are examined from end to end.
    const ENDS: bool;

    /// Takes some segments of a way's stretch; `at` is the place in the chunk of the stretch's first.
    fn take<C: Code, U: Unit>(march: &March<'_>, way: &mut Way, segments: Range<i32>, at: i32, media: &mut Media);
}

/// The function for gathering a layer.
pub(crate) struct Gathering<'a> {
    pub(crate) frame: &'a Frame<'a>,
    /// Whether any layer of the picture has surfaces.
    pub(crate) has_surfaces: bool,
    /// Whether an expression reads the layer's values.
    pub(crate) is_read: bool,
}

impl Choice for Gathering<'_> {
    type Chosen = Gather;

    fn of<C: Code, U: Unit>(self) -> Gather {
        if self.is_read {
            return gather::<C, U, Read>;
        }
        if self.frame.is_unlit_plain_fog() && !self.has_surfaces {
            return gather::<C, U, Plain>;
        }
        match self.frame.needs_ends() {
            true => gather::<C, U, Any<true>>,
            false => gather::<C, U, Any<false>>,
        }
    }
}

fn gather<C: Code, U: Unit, L: Look>(
    frame: &Frame<'_>,
    cell: &Cell<'_>,
    way: &mut Way,
    run: Range<u32>,
    at: usize,
    media: &mut Media,
) {
    U::call(
        (way, media),
        #[inline(always)]
        move |(way, media)| {
            let brick = frame.brick::<C>(cell);
            let mut tick = run.start;
            while tick < run.end {
                if way.stretch.end <= tick {
                    way.begin(frame, cell, tick, L::ENDS);
                }
                let stretch = way.stretch;
                let march = March { frame, cell, brick, stretch: &stretch };
                let Stretch { start, end, zone, .. } = stretch;
                let until = if end < run.end { end } else { run.end };
                let first = at as i32 + ((tick - run.start) >> zone) as i32 - ((tick - start) >> zone) as i32;
                while let Some(segments) = way.next_seen(((until - start) >> zone) as i32) {
                    let seen = media.end;
                    L::take::<C, U>(&march, way, segments, first, media);
                    if media.end < seen {
                        return;
                    }
                }
                tick = until;
            }
        },
    );
}

/// One sample in the middle of each segment, classified by its value alone, without surfaces.
struct Plain;

impl Look for Plain {
    const ENDS: bool = false;

    #[inline(always)]
    fn take<C: Code, U: Unit>(march: &March<'_>, way: &mut Way, segments: Range<i32>, at: i32, media: &mut Media) {
        let first = (at + segments.start) as usize;
        march.sample::<C, U>(&way.ray, &mut media.chunk, segments);
        add_fog::<U>(march.frame, 1.0, ALL_PACKETS, first, media);
    }
}

/// Adds a layer's medium at the samples of some packets of a sampled chunk, to the segments from `first` on. Weights of
/// samples times `share` are unit distances.
#[inline(always)]
pub(crate) fn add_fog<U: Unit>(frame: &Frame<'_>, share: f32, packets: u32, first: usize, media: &mut Media) {
    let Media { chunk, mixed, is_any, .. } = media;
    let depths = frame.depths.as_ref().expect("layers of fog that are drawn together have it");
    let mut shows = 0;
    for p in 0..chunk.packets.min(PACKETS) {
        shows |= (depths.find(&chunk.code[p], &mut chunk.places[p]) as u32) << p;
    }
    shows &= packets;
    *is_any |= shows != 0;
    for (p, mixed) in mixed[first..].as_chunks_mut().0.iter_mut().enumerate().take(PACKETS) {
        if shows & 1 << p == 0 {
            continue;
        }
        if depths.bends(&chunk.places[p]) {
            let entries = Entries::of(frame);
            for (i, mixed) in mixed.iter_mut().enumerate() {
                let code = chunk.code[p][i] * frame.positions_per_code;
                mixed.add(depths.computed(entries.lookup(code)) * (chunk.weight[p][i] * share));
            }
        } else {
            // SAFETY: the places have been found.
            unsafe { depths.add::<U>(&chunk.places[p], &chunk.weight[p], share, mixed) };
        }
    }
}

/// Every method, lit or not, by value and gradient or by value alone; with `ENDS`, surfaces too.
struct Any<const ENDS: bool>;

impl<const ENDS: bool> Look for Any<ENDS> {
    const ENDS: bool = ENDS;

    #[inline(always)]
    fn take<C: Code, U: Unit>(march: &March<'_>, way: &mut Way, segments: Range<i32>, at: i32, media: &mut Media) {
        let ray = &mut way.ray;
        let has_fog = march.frame.settings.mode == Mode::Dvr;
        let path = Path::new(march, ray);
        (media.alone.blend, media.alone.first) = (march.frame.blend, at);
        march.stretch.reach(ray, &segments, C::INVALID && march.frame.settings.encoding.has_invalid);
        let mut pieces = Pieces::new(march, path, segments);
        while let Some(piece) = pieces.next::<C, U>(ray) {
            if has_fog {
                let mut next = piece.segments.start;
                while next < piece.segments.end {
                    next = piece.path.row::<C, U>(next..piece.segments.end, &mut media.chunk.media);
                    media.chunk.media.drain(..).for_each(|passed| media.alone.pass(passed));
                }
                for segment in piece.segments.clone() {
                    media.take_alone(segment, piece.path.ends(segment).map(|along| path.distance(along)));
                }
            }
            if let (Some(crossing), Some(found)) = (piece.surface, &mut media.found) {
                let segment = media.alone.place(piece.segments.start);
                let shown = path.surface::<C, U>(crossing);
                let at = Meeting::new(path.distance(crossing.along), crossing.is_cap, march.frame.ticks.step);
                found.surfaces.push(Met { segment, at, shown });
                if shown.w >= 1.0 {
                    media.end = media.end.min(segment + 1);
                    return;
                }
            }
        }
    }
}

/// The values in the middle of segments, for an expression.
struct Read;

impl Look for Read {
    const ENDS: bool = false;

    #[inline(always)]
    fn take<C: Code, U: Unit>(march: &March<'_>, way: &mut Way, segments: Range<i32>, at: i32, media: &mut Media) {
        march.sample::<C, U>(&way.ray, &mut media.chunk, segments.clone());
        let (read, is_lit) = (media.values.len() / CHUNK, march.frame.is_lit);
        let path = is_lit.then(|| Path::new(march, &way.ray));
        for (i, segment) in segments.enumerate().take(CHUNK) {
            let (code, weight) = (media.chunk.code[i / LANES][i % LANES], media.chunk.weight[i / LANES][i % LANES]);
            if weight > 0.0 {
                let place = (at + segment) as usize;
                let value = march.frame.settings.encoding.value_of_code(code as f64);
                // Expressions compare whole numbers.
                let value = if march.frame.settings.has_whole_values() { value.round() } else { value };
                media.values[place * read + way.layer] = value;
                media.longest[place] = media.longest[place].max(weight);
                if let Some(path) = &path {
                    let gradient = match march.frame.reading {
                        // Labels are flat between their borders.
                        Reading::Label => DVec3::ZERO,
                        Reading::Filtered(_) => path.gradient::<C, U>(segment, code),
                    };
                    media.gradients[place * read + way.layer] = gradient;
                }
            }
        }
    }
}
