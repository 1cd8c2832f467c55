//! Direct volume rendering by every method but the plain one, with isosurfaces in fog or alone.

use crate::frame::Cell;
use crate::macrocells::{Coverage, Mask, Reach};
use crate::modes::Accumulate;
use crate::path::Path;
use crate::pieces::Pieces;
use crate::ray::{FAINTEST, NO_RANK, Ray};
use crate::row::{Passed, Row};
use crate::sample::{Code, SampleChunk};
use crate::stretch::March;
use crate::unit::Unit;
use brickyard_volume::Mode;
use std::ops::Range;

/// The mode of emission and absorption. With `ENDS`, segments are examined from end to end, and searched for surfaces.
pub(crate) struct Medium<const ENDS: bool>;

impl<const ENDS: bool> Accumulate for Medium<ENDS> {
    const REACH: Reach = if ENDS { Reach::Ends } else { Reach::Middles };

    #[inline(always)]
    fn coverage(cell: &Cell<'_>, ray: &Ray) -> Coverage {
        match cell.mask {
            // Past other surfaces than the previous brick: they lie on the common face.
            Mask::None if ray.past.rank != NO_RANK && cell.rank != NO_RANK && ray.past.rank != cell.rank => {
                Coverage::All
            }
            _ => cell.mask.coverage(),
        }
    }

    #[inline(always)]
    fn take<C: Code, U: Unit>(march: &March<'_>, ray: &mut Ray, chunk: &mut SampleChunk, segments: Range<i32>) {
        let path = Path::new(march, ray);
        if !ENDS {
            return take::<C, U>(&path, ray, segments, &mut chunk.media);
        }
        march.stretch.reach(ray, &segments, C::INVALID && march.frame.settings.encoding.has_invalid);
        let has_fog = march.frame.settings.mode == Mode::Dvr;
        let mut pieces = Pieces::new(march, path, segments);
        while !Self::is_final(march.frame, ray.sum)
            && let Some(piece) = pieces.next::<C, U>(ray)
        {
            if has_fog {
                take::<C, U>(&piece.path, ray, piece.segments, &mut chunk.media);
            }
            if let Some(crossing) = piece.surface {
                let shown = path.surface::<C, U>(crossing);
                let light = ray.sum.w;
                let color = ray.sum.truncate() + shown.truncate() * (light * shown.w);
                ray.sum = color.extend(light * (1.0 - shown.w));
            }
        }
    }
}

/// Takes segments until nothing behind them is visible.
#[inline(always)]
fn take<C: Code, U: Unit>(path: &Path<'_>, ray: &mut Ray, segments: Range<i32>, media: &mut Row) {
    let mut next = segments.start;
    while next < segments.end && ray.sum.w >= FAINTEST {
        next = path.row::<C, U>(next..segments.end, media);
        for Passed { color, depth, length, .. } in media.drain(..) {
            let left = (-depth * length).exp2() as f32;
            let light = ray.sum.w;
            ray.sum = (ray.sum.truncate() + color * (light * (1.0 - left))).extend(light * left);
        }
    }
}
