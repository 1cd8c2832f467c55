//! Fog of layers with a common cut, such as an image's channels: all of a cell's bricks are sampled at the same places.
//!
//! Some rays go through a cell side by side. For each, the next segments possibly visible in any layer are located
//! once; then each layer takes its samples there, for all these rays before the next layer, to find its voxels in the
//! first-level cache; finally light passes through the media of all layers.

use crate::choice::Choice;
use crate::frame::{Cell, Frame};
use crate::gather::add_fog;
use crate::macrocells::{Coverage, Reach};
use crate::march::look;
use crate::media::Media;
use crate::modes::Dvr;
use crate::packet::{CHUNK, LANES, PACKETS};
use crate::ray::{FAINTEST, Ray};
use crate::reading::Reading;
use crate::sample::{Code, Grid};
use crate::stretch::Stretch;
use crate::tiles::PIXELS;
use crate::unit::{Unit, call};
use brickyard_volume::Filter;
use glam::Vec4;
use std::ops::Range;

/// Rays that go side by side: enough for all but one to find their voxels in the cache, and few enough for their own
/// state to stay there.
const SIDE_BY_SIDE: usize = 4;

pub(crate) const BYTES_PER_THREAD: usize = SIDE_BY_SIDE * size_of::<Walk>();
pub(crate) const BYTES_PER_LAYER_AND_THREAD: usize = SIDE_BY_SIDE * size_of::<u64>() + size_of::<Part<'_, '_>>();

/// Drawing of several layers of plain fog with a common cut.
pub(crate) struct Channels {
    takes: Vec<Take>,
}

/// Adds a layer's samples of some packets of a chunk.
type Take = fn(&Part<'_, '_>, u32, &mut Media);

/// A layer's part of a cell of the shared cut.
#[derive(Clone, Copy)]
pub(crate) struct Part<'a, 'f> {
    frame: &'a Frame<'f>,
    cell: &'a Cell<'f>,
    take: Take,
    /// This layer's unit distances per unit distance of the first part.
    share: f32,
}

/// Rays side by side through a cell, collected so far.
pub(crate) struct Walks {
    walks: Vec<Walk>,
    count: usize,
}

/// One ray's walk through a cell.
struct Walk {
    /// The ray's place in its tile, its pixel, and one past the last tick.
    place: usize,
    pixel: [u32; 2],
    last: u32,
    /// The current stretch, its blocks visible in each layer and in any, and the segments located next.
    stretch: Stretch,
    shown: Vec<u64>,
    seen: u64,
    pending: Range<i32>,
    /// Whether there are such segments, and each packet's blocks.
    is_on: bool,
    blocks: [u64; PACKETS],
    media: Media,
}

impl Channels {
    /// Prepares side-by-side drawing of layers with a common cut and no surfaces. `None` for a single layer, or if one
    /// is more than fog sampled trilinearly in the middle of each segment and classified by its value alone.
    pub(crate) fn new(frames: &[Frame<'_>]) -> Option<Self> {
        let is_fog =
            |frame: &Frame<'_>| frame.is_unlit_plain_fog() && frame.reading == Reading::Filtered(Filter::Trilinear);
        let take = |frame: &Frame<'_>| Taking.for_machine(&frame.settings.encoding);
        (frames.len() > 1 && frames.iter().all(is_fog)).then(|| Self { takes: frames.iter().map(take).collect() })
    }

    /// The layers' parts of a cell. `None` if the layers' bricks lie differently under the cell, unlike bricks of one
    /// level.
    pub(crate) fn parts<'a, 'f>(
        &self,
        frames: &'a [Frame<'f>],
        cells: impl Iterator<Item = (usize, &'a Cell<'f>)>,
    ) -> Option<Vec<Part<'a, 'f>>> {
        let part = |(layer, cell)| Part { frame: &frames[layer], cell, take: self.takes[layer], share: 1.0 };
        let mut parts: Vec<_> = cells.map(part).collect();
        let Part { frame: first, cell, .. } = *parts.first()?;
        for part in &mut parts {
            if (part.cell.offset, part.cell.scale) != (cell.offset, cell.scale)
                || (part.frame.edge, part.frame.apron) != (first.edge, first.apron)
            {
                return None;
            }
            part.share = (part.frame.per_unit / first.per_unit) as f32;
        }
        Some(parts)
    }

    /// Takes the collected rays to the ends of their runs through the cell, and empties `walks`. Returns how many rays
    /// have ended.
    pub(crate) fn march(&self, parts: &[Part<'_, '_>], walks: &mut Walks, rays: &mut [Ray; PIXELS]) -> usize {
        let walks = &mut walks.walks[..std::mem::take(&mut walks.count)];
        call(
            &mut *rays,
            #[inline(always)]
            |rays| march(parts, walks, rays),
        );
        let mut ended = 0;
        for walk in walks {
            let ray = &mut rays[walk.place];
            if ray.sum.w < FAINTEST {
                ray.cursor = ray.end;
            }
            ended += (ray.cursor >= ray.end) as usize;
        }
        ended
    }
}

impl Walks {
    /// Makes room for the rays, if there are `channels`.
    pub(crate) fn new(channels: Option<&Channels>) -> Self {
        let walk = |_| Walk {
            place: 0,
            pixel: [0; 2],
            last: 0,
            stretch: Stretch::EMPTY,
            shown: Vec::new(),
            seen: 0,
            pending: 0..0,
            is_on: false,
            blocks: [0; PACKETS],
            media: Media::new(0, false, false),
        };
        Self { walks: (0..if channels.is_some() { SIDE_BY_SIDE } else { 0 }).map(walk).collect(), count: 0 }
    }

    /// Adds a pixel's ray with the segments from tick `first` up to tick `last` in the cell. `place` is the ray's place
    /// in its tile. Returns whether the room is now full.
    pub(crate) fn enter(
        &mut self,
        parts: &[Part<'_, '_>],
        ray: &Ray,
        place: usize,
        [x, y]: [u32; 2],
        (first, last): (u32, u32),
    ) -> bool {
        let walk = &mut self.walks[self.count];
        (walk.place, walk.pixel, walk.last) = (place, [x, y], last);
        for part in parts.iter().filter(|part| part.cell.draws(x, y) && ray.sum.w > part.frame.visibility(part.cell)) {
            part.frame.enter(part.cell, ray.sum.w);
        }
        walk.begin(parts, ray, first);
        self.count += 1;
        self.count == SIDE_BY_SIDE
    }
}

impl Walk {
    /// Starts the stretch at tick `start`.
    #[inline(always)]
    fn begin(&mut self, parts: &[Part<'_, '_>], ray: &Ray, start: u32) {
        let Part { frame, cell, .. } = parts[0];
        self.stretch = Stretch::new(frame, cell, ray, 0, start, self.last, Reach::Middles);
        let [x, y] = self.pixel;
        (self.seen, self.pending) = (0, 0..0);
        self.shown.clear();
        for Part { frame, cell, .. } in parts {
            self.stretch.seen = match cell.mask.coverage() {
                _ if !cell.draws(x, y) => 0,
                Coverage::None => 0,
                Coverage::All => u64::MAX,
                Coverage::Some => {
                    look::<Dvr>(&mut self.stretch, frame, cell, Vec4::ZERO, &mut [0; LANES]);
                    self.stretch.seen
                }
            };
            self.shown.push(self.stretch.seen);
            self.seen |= self.stretch.seen;
        }
    }

    /// Locates the samples of the next possibly visible segments, up to a chunk. Returns whether there are any.
    #[inline(always)]
    fn locate(&mut self, parts: &[Part<'_, '_>], ray: &Ray, grid: &Grid) -> bool {
        while self.pending.is_empty() {
            match self.stretch.next_seen(&mut self.seen) {
                Some(segments) => self.pending = segments,
                None if self.stretch.end < self.last => self.begin(parts, ray, self.stretch.end),
                None => return false,
            }
        }
        let Range { start, end } = self.pending;
        let end = end.min(start + CHUNK as i32);
        self.pending.start = end;
        self.stretch.place_samples(parts[0].frame, ray, &mut self.media.chunk, start..end, true);
        grid.locate(self.stretch.origin, self.stretch.step, &mut self.media.chunk);
        for (p, blocks) in (0..).zip(&mut self.blocks).take(self.media.chunk.packets) {
            let first = start + p * LANES as i32;
            let last = (first + LANES as i32).min(end) - 1;
            let (from, to) = (first / self.stretch.block, last / self.stretch.block);
            *blocks = (u64::MAX >> (63 - (to - from))) << from;
        }
        true
    }

    #[inline(always)]
    fn packets(&self, layer: usize) -> u32 {
        let mut packets = 0;
        for p in 0..self.media.chunk.packets.min(PACKETS) {
            packets |= ((self.shown[layer] & self.blocks[p] != 0) as u32) << p;
        }
        packets
    }
}

#[inline(always)]
fn march(parts: &[Part<'_, '_>], walks: &mut [Walk], rays: &mut [Ray; PIXELS]) {
    let Some(Part { frame, .. }) = parts.first() else { return };
    let grid = Grid::new(frame.edge + 2 * frame.apron);
    loop {
        let mut is_on = false;
        for walk in &mut *walks {
            let ray = &rays[walk.place];
            walk.is_on = ray.sum.w >= FAINTEST && walk.locate(parts, ray, &grid);
            is_on |= walk.is_on;
        }
        if !is_on {
            return;
        }
        for (layer, part) in parts.iter().enumerate() {
            for walk in walks.iter_mut().filter(|walk| walk.is_on) {
                let packets = walk.packets(layer);
                if packets != 0 {
                    (part.take)(part, packets, &mut walk.media);
                }
            }
        }
        for walk in walks.iter_mut().filter(|walk| walk.is_on) {
            let ray = &mut rays[walk.place];
            ray.sum = walk.media.see(walk.media.chunk.packets * LANES, ray.sum);
        }
    }
}

/// The function for taking a layer's samples.
struct Taking;

impl Choice for Taking {
    type Chosen = Take;

    fn of<C: Code, U: Unit>(self) -> Take {
        take::<C, U>
    }
}

fn take<C: Code, U: Unit>(part: &Part<'_, '_>, packets: u32, media: &mut Media) {
    U::call(
        (part, media),
        #[inline(always)]
        move |(part, media)| {
            let Part { frame, cell, share, .. } = *part;
            let weight = media.chunk.weight;
            // SAFETY: the samples have been located in a brick of the same size.
            unsafe { frame.brick::<C>(cell).sample_located::<C, U>(packets, &mut media.chunk) };
            add_fog::<U>(frame, share, packets, 0, media);
            if C::INVALID {
                media.chunk.weight = weight;
            }
        },
    );
}
