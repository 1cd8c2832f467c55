//! The media of a chunk of segments, of all layers, and how a ray's light goes through them.

use crate::mixture::{Alone, AloneChunk, Mixture, Passage, passages};
use crate::packet::{CHUNK, LANES};
use crate::ray::FAINTEST;
use brickyard_volume::Combination;
use glam::{Vec4, Vec4Swizzles};

/// Places of a chunk, and of a packet that begins with its last one.
const PLACES: usize = CHUNK + LANES;

/// What a chunk of segments has.
pub(crate) struct Media {
    /// Of each segment all of it.
    pub(crate) mixtures: [Mixture; PLACES],
    /// Whether that is anything.
    pub(crate) is_any: bool,
    /// The light with which each segment was entered that was seen through last.
    pub(crate) light: [f32; CHUNK],
    /// Of layers that an expression reads: their values, all of a segment's together, and the longest of their parts.
    pub(crate) values: Vec<f64>,
    pub(crate) longest: [f32; PLACES],
    /// What one layer shows by itself.
    pub(crate) alone: AloneChunk,
    /// Where there are surfaces: all pieces one by one, and all surfaces.
    pub(crate) found: Option<Found>,
}

/// What segments with surfaces in them are made of.
#[derive(Default)]
pub(crate) struct Found {
    pub(crate) pieces: Vec<Piece>,
    pub(crate) surfaces: Vec<Met>,
}

/// What a layer shows by itself of a piece of a segment, from where to where.
pub(crate) struct Piece {
    pub(crate) segment: usize,
    pub(crate) alone: Alone,
    pub(crate) ends: [f64; 2],
}

/// A surface that a ray meets: straight colour and opacity.
pub(crate) struct Met {
    pub(crate) segment: usize,
    pub(crate) t: f64,
    pub(crate) shown: Vec4,
}

impl Media {
    /// The media of layers of which so many are read by an expression, with surfaces among them or not.
    pub(crate) fn new(read: usize, has_surfaces: bool) -> Self {
        Self {
            mixtures: [Mixture::default(); PLACES],
            is_any: false,
            light: [0.0; CHUNK],
            values: vec![f64::NAN; read * CHUNK],
            longest: [0.0; PLACES],
            alone: AloneChunk::EMPTY,
            found: has_surfaces.then(Found::default),
        }
    }

    /// Takes what the layer shows by itself of a segment of the stretch, from where to where, to that of all layers.
    #[inline(always)]
    pub(crate) fn take_alone(&mut self, segment: i32, ends: [f64; 2]) {
        let place = self.alone.place(segment);
        let alone = std::mem::take(&mut self.alone.segments[place]);
        self.mixtures[place].put_share(&alone, 1.0);
        self.is_any = true;
        if let Some(found) = self.found.as_mut().filter(|_| ends[0] < ends[1]) {
            found.pieces.push(Piece { segment: place, alone, ends });
        }
    }

    /// Puts in the media of an expression's values, and forgets what it is made of.
    pub(crate) fn combine(&mut self, combination: &Combination, count: usize) {
        let read = self.values.len() / CHUNK;
        for segment in 0..count.min(CHUNK) {
            let length = std::mem::take(&mut self.longest[segment]);
            if length == 0.0 {
                continue;
            }
            let values = segment * read..(segment + 1) * read;
            let look = combination.look(&self.values[values.clone()]);
            self.values[values].fill(f64::NAN);
            if let Some([r, g, b, alpha]) = look {
                let depth = -(-alpha).ln_1p() * std::f32::consts::LOG2_E;
                self.mixtures[segment].mix(Vec4::new(r, g, b, 1.0), depth.min(crate::mixture::OPAQUE) * length);
                self.is_any = true;
            }
        }
    }

    /// Passes light through so many segments, and empties them.
    #[inline(always)]
    fn see(&mut self, count: usize, mut light: Vec4) -> Vec4 {
        let count = count.min(CHUNK);
        if !self.is_any && self.found.as_ref().is_none_or(|found| found.surfaces.is_empty()) {
            self.light[..count].fill(light.w);
            return light;
        }
        let (mut dimmed, mut left) = ([0.0; CHUNK], [0.0; CHUNK]);
        for first in (0..count).step_by(LANES) {
            let mut depth = [0.0; LANES];
            for i in 0..LANES {
                depth[i] = self.mixtures[first + i].mixed.w;
            }
            let passage = passages(&depth);
            dimmed[first..first + LANES].copy_from_slice(&passage.dimmed);
            left[first..first + LANES].copy_from_slice(&passage.left);
        }
        let surfaces = self.found.as_mut().map(Found::sorted).unwrap_or_default();
        let mut rest = &surfaces[..];
        for i in 0..count {
            self.light[i] = light.w;
            let (here, after) = rest.split_at(rest.iter().take_while(|met| met.segment == i).count());
            rest = after;
            light = match &self.found {
                Some(found) if !here.is_empty() => found.see(i, here, light),
                _ => self.mixtures[i].see(Passage { dimmed: dimmed[i], left: left[i] }, light),
            };
            if light.w < FAINTEST {
                self.light[i + 1..count].fill(0.0);
                break;
            }
        }
        if let Some(found) = &mut self.found {
            found.empty(surfaces);
        }
        self.mixtures = [Mixture::default(); PLACES];
        self.is_any = false;
        light
    }
}

impl Found {
    /// The surfaces, segment by segment in the order of their distances.
    fn sorted(&mut self) -> Vec<Met> {
        let mut surfaces = std::mem::take(&mut self.surfaces);
        surfaces.sort_by(|a, b| a.segment.cmp(&b.segment).then(a.t.total_cmp(&b.t)));
        surfaces
    }

    /// Forgets all, but for the room that was made for it.
    fn empty(&mut self, mut surfaces: Vec<Met>) {
        surfaces.clear();
        self.surfaces = surfaces;
        self.pieces.clear();
    }

    /// Passes light through a segment, between the surfaces that were met there.
    fn see(&self, segment: usize, surfaces: &[Met], mut light: Vec4) -> Vec4 {
        let mut start = f64::NEG_INFINITY;
        for Met { t, shown, .. } in surfaces {
            light = self.between(segment, [start, *t], light);
            light = (light.xyz() + shown.xyz() * (shown.w * light.w)).extend(light.w * (1.0 - shown.w));
            start = *t;
        }
        self.between(segment, [start, f64::INFINITY], light)
    }

    /// Passes light through what lies between two distances.
    fn between(&self, segment: usize, [start, end]: [f64; 2], light: Vec4) -> Vec4 {
        let mut mixture = Mixture::default();
        for Piece { alone, ends, .. } in self.pieces.iter().filter(|piece| piece.segment == segment) {
            let share = (ends[1].min(end) - ends[0].max(start)).max(0.0) / (ends[1] - ends[0]);
            mixture.put_share(alone, share as f32);
        }
        let Passage { dimmed: [dimmed], left: [left] } = passages(&[mixture.mixed.w]);
        mixture.see(Passage { dimmed, left }, light)
    }
}

/// Passes light through so many segments of media, and empties them, by the vector unit of this machine.
pub(crate) struct See(pub(crate) fn(&mut Media, usize, Vec4) -> Vec4);

impl See {
    pub(crate) fn for_machine() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the machine has AVX2.
            return Self(|media, count, light| unsafe { see_avx2(media, count, light) });
        }
        Self(Media::see)
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn see_avx2(media: &mut Media, count: usize, light: Vec4) -> Vec4 {
    media.see(count, light)
}
