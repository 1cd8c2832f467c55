//! Isosurfaces, translucent or not, in fog or alone: where a ray's way through a brick is cut by them. The rule is
//! [`brickyard_volume::surface`]'s.
//!
//! The ends of a row of segments are sampled together. As long as all are past as many surfaces as the ray is, they are one piece for
//! [`Path`]; a segment that passes surfaces is cut at each, found as one alone is.

use crate::frame::rank_of;
use crate::packet::LANES;
use crate::path::Path;
use crate::ray::{NO_RANK, Ray};
#[cfg(target_arch = "x86_64")]
use crate::sample::Avx2;
use crate::sample::{Code, Portable, Unit};
use crate::stretch::{March, Stretch};
use crate::surface::Line;
use std::ops::Range;

/// A ray's way along a stretch of a brick, piece by piece.
pub(crate) struct Pieces<'a> {
    march: &'a March<'a>,
    stretch: &'a Stretch,
    path: Path<'a>,
    /// Segments not taken.
    rest: Range<i32>,
    /// Where in the first of them the last piece ended, if it was cut.
    cut: Option<f32>,
}

/// Some segments, or a part of one, without a surface in between.
pub(crate) struct Piece<'a> {
    pub(crate) path: Path<'a>,
    pub(crate) segments: Range<i32>,
    /// The surface at its end, and where that is.
    pub(crate) surface: Option<(usize, f32)>,
}

impl<'a> Pieces<'a> {
    #[inline(always)]
    pub(crate) fn new(march: &'a March<'a>, stretch: &'a Stretch, path: Path<'a>, segments: Range<i32>) -> Self {
        Self { march, stretch, path, rest: segments, cut: None }
    }

    /// The next piece, if there is one; the ray's rank becomes that behind it. Not inlined, as a [row](Path::row).
    #[inline(always)]
    pub(crate) fn next<C: Code, U: Unit, const INVALID: bool>(&mut self, ray: &mut Ray) -> Option<Piece<'a>> {
        #[cfg(target_arch = "x86_64")]
        if U::AVX2 {
            // SAFETY: the machine has AVX2.
            return unsafe { self.next_avx2::<C, INVALID>(ray) };
        }
        self.next_portable::<C, INVALID>(ray)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[inline(never)]
    fn next_avx2<C: Code, const INVALID: bool>(&mut self, ray: &mut Ray) -> Option<Piece<'a>> {
        self.next_on::<C, Avx2, INVALID>(ray)
    }

    #[inline(never)]
    fn next_portable<C: Code, const INVALID: bool>(&mut self, ray: &mut Ray) -> Option<Piece<'a>> {
        self.next_on::<C, Portable, INVALID>(ray)
    }

    #[inline(always)]
    fn next_on<C: Code, U: Unit, const INVALID: bool>(&mut self, ray: &mut Ray) -> Option<Piece<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let (path, first) = (self.path, self.rest.start);
        if self.march.frame.settings.surfaces.is_empty() {
            let segments = std::mem::replace(&mut self.rest, 0..0);
            return Some(Piece { path, segments, surface: None });
        }
        let most = if self.cut.is_some() { 1 } else { LANES as i32 - 1 };
        let count = path.whole(&self.rest, most);
        let row = path.sample::<C, U, INVALID>(path.places(first, count, 0));
        let rank = |i: usize| match row.weight[i] > 0.0 {
            true => rank_of(&self.march.frame.thresholds, row.code[i]),
            false => NO_RANK,
        };
        if ray.rank == NO_RANK {
            ray.rank = rank(0);
        }
        let mut quiet = 0;
        while self.cut.is_none() && quiet < count && rank(quiet as usize + 1) == ray.rank {
            quiet += 1;
        }
        if quiet > 0 {
            self.rest.start += quiet;
            return Some(Piece { path, segments: first..first + quiet, surface: None });
        }
        let [start, end] = path.ends(first);
        let (start, last) = (self.cut.unwrap_or(start), rank(1));
        if ray.rank == NO_RANK || last == NO_RANK || ray.rank == last {
            ray.rank = last;
            self.rest.start += 1;
            self.cut = None;
            return Some(Piece { path: path.piece(start, end), segments: first..first + 1, surface: None });
        }
        let is_up = last > ray.rank;
        let surface = if is_up { ray.rank } else { ray.rank - 1 } as usize;
        let inside = |along: f32| along.max(path.low).min(path.high);
        let threshold = self.march.frame.thresholds[surface];
        let line = Line { march: self.march, stretch: self.stretch, threshold };
        let hit = line.locate::<C, U, INVALID>(inside(start), [inside(end), row.code[1]]);
        ray.rank += if is_up { 1 } else { -1 };
        self.cut = Some(hit);
        Some(Piece { path: path.piece(start, hit), segments: first..first + 1, surface: Some((surface, hit)) })
    }
}
