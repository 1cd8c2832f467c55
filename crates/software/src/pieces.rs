//! Isosurfaces, translucent or not, in fog or alone: the pieces of a ray's way through a brick between them. The rule
//! is [`brickyard_volume::surface`]'s.
//!
//! The ends of many segments are sampled together. While all are past the same number of surfaces as the ray, they form
//! one piece for [`Path`], or are skipped without fog; a segment that passes surfaces is cut at each, located like a
//! single one.

use crate::frame::rank_of;
use crate::packet::LANES;
use crate::path::Path;
use crate::ray::{NO_RANK, Ray};
use crate::sample::Code;
use crate::stretch::March;
use crate::surface::{Crossing, Line};
use crate::unit::Unit;
use brickyard_volume::Mode;
use std::ops::Range;

/// Packets of ends sampled together.
const TOGETHER: usize = 2;

/// A ray's way along a stretch of a brick, piece by piece.
pub(crate) struct Pieces<'a> {
    march: &'a March<'a>,
    path: Path<'a>,
    /// Segments not taken.
    rest: Range<i32>,
    /// The last piece's end in the first of them, if it was cut.
    cut: Option<f32>,
}

/// Some segments of a path, or a part of one segment, without a surface in between.
pub(crate) struct Piece<'a> {
    pub(crate) path: Path<'a>,
    pub(crate) segments: Range<i32>,
    /// The surface at the piece's end, if any.
    pub(crate) surface: Option<Crossing>,
}

impl<'a> Pieces<'a> {
    #[inline(always)]
    pub(crate) fn new(march: &'a March<'a>, path: Path<'a>, segments: Range<i32>) -> Self {
        Self { march, path, rest: segments, cut: None }
    }

    /// Returns the next piece, if any. The ray's rank becomes the one behind it. Not inlined: see [`Path::row`].
    #[inline(always)]
    pub(crate) fn next<C: Code, U: Unit>(&mut self, ray: &mut Ray) -> Option<Piece<'a>> {
        U::call(
            ray,
            #[inline(always)]
            move |ray| self.next_on::<C, U>(ray),
        )
    }

    #[inline(always)]
    fn next_on<C: Code, U: Unit>(&mut self, ray: &mut Ray) -> Option<Piece<'a>> {
        let (path, from) = (self.path, self.rest.start);
        let settings = &self.march.frame.settings;
        if settings.surfaces.is_empty() {
            let segments = std::mem::replace(&mut self.rest, 0..0);
            return (!segments.is_empty()).then_some(Piece { path, segments, surface: None });
        }
        if let Some(cap) = self.cap::<C, U>(ray) {
            return Some(Piece { path: path.piece(cap.along, cap.along), segments: from..from, surface: Some(cap) });
        }
        self.skip::<C, U>(ray, settings.mode == Mode::Dvr);
        let first = self.rest.start;
        if first > from && settings.mode == Mode::Dvr {
            return Some(Piece { path, segments: from..first, surface: None });
        }
        if self.rest.is_empty() {
            return None;
        }
        let [start, end] = path.ends(first);
        let start = self.cut.unwrap_or(start);
        let (last, code) = self.rank::<C, U>(end);
        if ray.past.rank == NO_RANK || last == NO_RANK || ray.past.rank == last {
            ray.past.rank = last;
            self.rest.start += 1;
            self.cut = None;
            return Some(Piece { path: path.piece(start, end), segments: first..first + 1, surface: None });
        }
        let is_up = last > ray.past.rank;
        let surface = if is_up { ray.past.rank } else { ray.past.rank - 1 } as usize;
        let inside = |along: f32| along.max(path.low).min(path.high);
        let threshold = self.march.frame.thresholds[surface];
        let line = Line { march: self.march, threshold };
        let hit = line.locate::<C, U>(inside(start), [inside(end), code]);
        ray.past.rank += if is_up { 1 } else { -1 };
        self.cut = Some(hit);
        Some(Piece {
            path: path.piece(start, hit),
            segments: first..first + 1,
            surface: Some(Crossing { surface, along: hit, is_cap: false }),
        })
    }

    /// The cap where the ray enters, if any. The ray's rank becomes the one behind it.
    #[inline(always)]
    fn cap<C: Code, U: Unit>(&self, ray: &mut Ray) -> Option<Crossing> {
        let is_new = ray.past.rank == NO_RANK && self.cut.is_none() && self.rest.start == 0;
        if !is_new || self.rest.is_empty() || !self.march.is_capped(ray, self.march.stretch.start) {
            return None;
        }
        let along = self.path.ends(0)[0];
        ray.past.rank = self.rank::<C, U>(along).0;
        (ray.past.rank > 0).then(|| Crossing { surface: ray.past.rank as usize - 1, along, is_cap: true })
    }

    /// Skips segments whose ends are past the same number of surfaces as the ray: all of them, or one batch if
    /// `is_short`.
    #[inline(always)]
    fn skip<C: Code, U: Unit>(&mut self, ray: &mut Ray, is_short: bool) {
        while self.cut.is_none() && !self.rest.is_empty() {
            let (path, first) = (self.path, self.rest.start);
            if ray.past.rank == NO_RANK {
                ray.past.rank = self.rank::<C, U>(path.ends(first)[0]).0;
            }
            let count = path.whole(&self.rest, (TOGETHER * LANES) as i32);
            let mut ends = [path.sample::<C, U>(path.places(first, count, -1)); TOGETHER];
            if count > LANES as i32 {
                ends[1] = path.sample::<C, U>(path.places(first + LANES as i32, count, -1));
            }
            let (low, high) = self.march.frame.band(ray.past.rank);
            let mut quiet = 0u32;
            for p in 0..TOGETHER {
                for i in 0..LANES {
                    let (code, is_known) = (ends[p].code[i], ends[p].weight[i] > 0.0);
                    let is_same = is_known & (low <= code) & (code < high);
                    let is_quiet = if ray.past.rank == NO_RANK { !is_known } else { is_same };
                    quiet |= (is_quiet as u32) << (p * LANES + i);
                }
            }
            let quiet = (quiet.trailing_ones() as i32).min(count);
            self.rest.start += quiet;
            if quiet < count || is_short {
                return;
            }
        }
    }

    /// The number of surfaces a place is past, and its code.
    #[inline(always)]
    fn rank<C: Code, U: Unit>(&self, along: f32) -> (i32, f32) {
        let place = self.path.sample::<C, U>([along; LANES]);
        let code = place.code[0];
        (if place.weight[0] > 0.0 { rank_of(&self.march.frame.thresholds, code) } else { NO_RANK }, code)
    }
}
