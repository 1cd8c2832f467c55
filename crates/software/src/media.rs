//! The media of all layers in a chunk of segments, and the passage of a ray's light through them.

use crate::mixture::{LayerMedium, LayerMediumChunk, Mixed, OPAQUE, Passage};
use crate::packet::{CHUNK, LANES};
use crate::sample::SampleChunk;
use brickyard_volume::Combination;
use brickyard_volume::surface::{Meeting, sort_met};
use glam::{DVec3, Vec4, Vec4Swizzles};
use std::ops::Range;

/// Places of a chunk, and of a packet that begins with its last one.
const PLACES: usize = CHUNK + LANES;

/// Media of a chunk of segments, of all layers, with working memory.
pub(crate) struct Media {
    /// The samples of the layer being gathered.
    pub(crate) chunk: SampleChunk,
    /// The joint media of each segment. They transmit `exp(-depth)` of the light.
    pub(crate) mixed: [Mixed; PLACES],
    /// Whether any segment of the chunk may have a medium.
    pub(crate) is_any: bool,
    /// One past the last visible segment, if an opaque surface was met in it; else [`CHUNK`].
    pub(crate) end: usize,
    /// The light entering each segment when light last passed through the chunk.
    pub(crate) light: [f32; PLACES],
    passage: Passage,
    /// The values for an expression, segment by segment and layer by layer; NaN where a layer has none.
    pub(crate) values: Vec<f64>,
    /// The gradients, in the scene's world, of these values; empty if the expression is not lit.
    pub(crate) gradients: Vec<DVec3>,
    /// The greatest length, in unit distances, of a segment in any layer read by an expression.
    pub(crate) longest: [f32; PLACES],
    /// The medium of the layer being gathered.
    pub(crate) alone: LayerMediumChunk,
    /// The pieces of media, one by one, and the surfaces met in the chunk; `None` if no layer has surfaces.
    pub(crate) found: Option<Found>,
}

/// Pieces and surfaces of a chunk's segments.
#[derive(Default)]
pub(crate) struct Found {
    pub(crate) pieces: Vec<Piece>,
    pub(crate) surfaces: Vec<Met>,
}

/// One layer's medium in a piece of a segment, between two distances.
pub(crate) struct Piece {
    pub(crate) segment: usize,
    pub(crate) alone: LayerMedium,
    pub(crate) ends: [f64; 2],
}

/// A surface met by a ray: where, and its straight colour and opacity.
pub(crate) struct Met {
    pub(crate) segment: usize,
    pub(crate) at: Meeting,
    pub(crate) shown: Vec4,
}

impl Media {
    /// Creates empty media, for an expression that reads `read` layers and may be lit, or for layers with possible
    /// surfaces.
    pub(crate) fn new(read: usize, is_lit: bool, has_surfaces: bool) -> Self {
        Self {
            chunk: SampleChunk::EMPTY,
            mixed: [Mixed::NONE; PLACES],
            is_any: false,
            end: CHUNK,
            light: [0.0; PLACES],
            passage: Passage::EMPTY,
            values: vec![f64::NAN; read * CHUNK],
            gradients: vec![DVec3::ZERO; if is_lit { read * CHUNK } else { 0 }],
            longest: [0.0; PLACES],
            alone: LayerMediumChunk::EMPTY,
            found: has_surfaces.then(Found::default),
        }
    }

    /// Adds the layer's own medium in a segment of the stretch, between these distances, to the joint media.
    #[inline(always)]
    pub(crate) fn take_alone(&mut self, segment: i32, ends: [f64; 2]) {
        let place = self.alone.place(segment);
        let alone = std::mem::take(&mut self.alone.segments[place]);
        self.mixed[place].add(alone.media(1.0));
        self.is_any = true;
        if let Some(found) = self.found.as_mut().filter(|_| ends[0] < ends[1]) {
            found.pieces.push(Piece { segment: place, alone, ends });
        }
    }

    /// Adds the media of an expression over the first `count` segments' values, and clears the values. `shade` lights a
    /// segment's colour under a normal, if the expression is lit.
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
                let depth = (-(-alpha).ln_1p()).min(OPAQUE) * length;
                self.mixed[segment].add(Vec4::new(r, g, b, 1.0) * depth);
                self.is_any = true;
            }
        }
    }

    /// Passes light through the first `count` segments, and empties them. Returns premultiplied colour and the
    /// remaining light.
    #[inline(always)]
    pub(crate) fn see(&mut self, count: usize, mut light: Vec4) -> Vec4 {
        let count = count.min(CHUNK);
        let mut from = 0;
        if let Some(mut found) = self.found.take_if(|found| !found.surfaces.is_empty()) {
            found.surfaces.sort_by_key(|surface| surface.segment);
            let in_segments = found.surfaces.chunk_by_mut(|a, b| a.segment == b.segment);
            in_segments.for_each(|here| sort_met(here, |surface| surface.at));
            for here in found.surfaces.chunk_by(|a, b| a.segment == b.segment) {
                let segment = here[0].segment;
                light = self.pass(from..segment, light);
                self.light[segment] = light.w;
                light = found.see(segment, here, light, &mut self.passage);
                from = segment + 1;
            }
            found.surfaces.clear();
            self.found = Some(found);
        }
        light = self.pass(from..count, light);
        if self.is_any {
            self.mixed[..count].fill(Mixed::NONE);
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
        self.passage.pass(&self.mixed[segments.clone()], light, &mut self.light[segments])
    }
}

impl Found {
    /// Passes light through a segment, between the surfaces met there.
    fn see(&self, segment: usize, surfaces: &[Met], mut light: Vec4, passage: &mut Passage) -> Vec4 {
        let mut start = f64::NEG_INFINITY;
        for Met { at, shown, .. } in surfaces {
            light = self.between(segment, [start, at.t], light, passage);
            light = (light.xyz() + shown.xyz() * (shown.w * light.w)).extend(light.w * (1.0 - shown.w));
            start = start.max(at.t);
        }
        self.between(segment, [start, f64::INFINITY], light, passage)
    }

    /// Passes light through the media between two distances.
    fn between(&self, segment: usize, [start, end]: [f64; 2], light: Vec4, passage: &mut Passage) -> Vec4 {
        let mut mixed = Mixed::NONE;
        for Piece { alone, ends, .. } in self.pieces.iter().filter(|piece| piece.segment == segment) {
            let share = (ends[1].min(end) - ends[0].max(start)).max(0.0) / (ends[1] - ends[0]);
            mixed.add(alone.media(share as f32));
        }
        passage.pass(&[mixed], light, &mut [0.0])
    }
}
