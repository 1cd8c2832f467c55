//! The media of a chunk of segments, of all layers, and how a ray's light goes through them.

use crate::mixture::{Alone, AloneChunk, Mixture, Passage, passages};
use crate::packet::{CHUNK, LANES};
use brickyard_volume::Combination;
use glam::{DVec3, Vec3, Vec4, Vec4Swizzles};
use std::ops::Range;

/// Places of a chunk, and of a packet that begins with its last one.
const PLACES: usize = CHUNK + LANES;

/// What a chunk of segments has.
pub(crate) struct Media {
    /// Of each segment all of it.
    pub(crate) mixtures: [Mixture; PLACES],
    /// Whether that is anything.
    pub(crate) is_any: bool,
    /// One past the last segment that can be seen: in that an opaque surface was met.
    pub(crate) end: usize,
    /// The light with which each segment was entered that was seen through last.
    pub(crate) light: [f32; PLACES],
    /// Of layers that an expression reads: their values, all of a segment's together, and the longest of their parts.
    pub(crate) values: Vec<f64>,
    /// Where the expression is lit: the gradients of those values in the scene's world.
    pub(crate) gradients: Vec<DVec3>,
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
    pub(crate) fn new(read: usize, is_lit: bool, has_surfaces: bool) -> Self {
        Self {
            mixtures: [Mixture::default(); PLACES],
            is_any: false,
            end: CHUNK,
            light: [0.0; PLACES],
            values: vec![f64::NAN; read * CHUNK],
            gradients: vec![DVec3::ZERO; if is_lit { read * CHUNK } else { 0 }],
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

    /// Puts in the media of an expression's values, and forgets what it is made of. `shade` lights a segment's colour under this
    /// normal.
    pub(crate) fn combine(
        &mut self,
        combination: &Combination,
        count: usize,
        shade: impl Fn(usize, DVec3, Option<DVec3>) -> DVec3,
    ) {
        let read = self.values.len() / CHUNK;
        for segment in 0..count.min(CHUNK) {
            let length = std::mem::take(&mut self.longest[segment]);
            if length == 0.0 {
                continue;
            }
            let values = segment * read..(segment + 1) * read;
            let look = match self.gradients.get(values.clone()) {
                None => combination.look(&self.values[values.clone()]),
                Some(gradients) => combination
                    .look_lit(&self.values[values.clone()], gradients, |color, normal| shade(segment, color, normal)),
            };
            self.values[values].fill(f64::NAN);
            if let Some([r, g, b, alpha]) = look {
                let depth = -(-alpha).ln_1p() * std::f32::consts::LOG2_E;
                let color = Vec3::new(r, g, b);
                self.mixtures[segment].mix(color.extend(1.0), depth.min(crate::mixture::OPAQUE) * length);
                self.is_any = true;
            }
        }
    }

    /// Passes light through so many segments, and empties them.
    #[inline(always)]
    fn see(&mut self, count: usize, mut light: Vec4) -> Vec4 {
        let count = count.min(CHUNK);
        let mut from = 0;
        if let Some(mut found) = self.found.take_if(|found| !found.surfaces.is_empty()) {
            found.surfaces.sort_by(|a, b| a.segment.cmp(&b.segment).then(a.t.total_cmp(&b.t)));
            for here in found.surfaces.chunk_by(|a, b| a.segment == b.segment) {
                let segment = here[0].segment;
                light = self.pass(from..segment, light);
                self.light[segment] = light.w;
                light = found.see(segment, here, light);
                from = segment + 1;
            }
            found.surfaces.clear();
            self.found = Some(found);
        }
        light = self.pass(from..count, light);
        if self.is_any {
            self.mixtures[..count].fill(Mixture::default());
            self.found.iter_mut().for_each(|found| found.pieces.clear());
            self.is_any = false;
        }
        self.end = CHUNK;
        light
    }

    /// Passes light through segments without surfaces.
    #[inline(always)]
    fn pass(&mut self, segments: Range<usize>, light: Vec4) -> Vec4 {
        if !self.is_any {
            self.light[segments].fill(light.w);
            return light;
        }
        // Two by two, so that a segment need not wait for the one before it.
        let (mut color, mut left) = ([light, Vec4::ZERO], light.w);
        for first in segments.clone().step_by(LANES) {
            let (count, mixtures) = (segments.end - first, &self.mixtures[first..first + LANES]);
            let mut depth = [0.0; LANES];
            for i in 0..LANES {
                depth[i] = if i < count { mixtures[i].mixed.w } else { 0.0 };
            }
            let passage = passages(&depth);
            let (mut entered, mut dimmed) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                entered[i] = left;
                left *= passage.left[i];
            }
            for i in 0..LANES {
                dimmed[i] = if i < count { entered[i] * passage.dimmed[i] } else { 0.0 };
            }
            for i in (0..LANES).step_by(2) {
                color[0] += mixtures[i].seen() * dimmed[i];
                color[1] += mixtures[i + 1].seen() * dimmed[i + 1];
            }
            self.light[first..first + LANES].copy_from_slice(&entered);
        }
        (color[0] + color[1]).with_w(left)
    }
}

impl Found {
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
        (light + mixture.seen() * (dimmed * light.w)).with_w(light.w * left)
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
