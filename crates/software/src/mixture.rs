//! What layers show together in one interval of a ray, in single precision: twins of [`brickyard_volume::look`]'s `Alone` and `Together`.

use crate::packet::{CHUNK, exp2};
use crate::row::Passed;
use brickyard_volume::Blend;
use glam::{Vec3, Vec4, Vec4Swizzles};

/// The depth of what lets no light through: finite, so that sums and shares of it are numbers.
pub(crate) const OPAQUE: f32 = 1e30;

/// What one layer shows of a piece of a segment by itself.
#[derive(Clone, Copy, Default)]
pub(crate) struct Alone {
    /// Of a layer that mixes: premultiplied colour, and how much light is hidden.
    color: Vec3,
    hidden: f32,
    /// Halvings of the light on the way through.
    depth: f32,
    /// What a layer that adds gives.
    glow: Vec3,
}

/// The segments of a chunk as one layer shows them.
pub(crate) struct AloneChunk {
    pub(crate) blend: Blend,
    /// The chunk's place for the stretch's first segment.
    pub(crate) first: i32,
    pub(crate) segments: [Alone; CHUNK],
}

impl AloneChunk {
    pub(crate) const EMPTY: Self = {
        let nothing = Alone { color: Vec3::ZERO, hidden: 0.0, depth: 0.0, glow: Vec3::ZERO };
        Self { blend: Blend::Mix, first: 0, segments: [nothing; CHUNK] }
    };

    /// The chunk's place for a segment of the stretch.
    pub(crate) fn place(&self, segment: i32) -> usize {
        (self.first + segment) as usize
    }

    /// Adds a medium of one of the segments, behind those that it has.
    #[inline(always)]
    pub(crate) fn pass(&mut self, Passed { segment, color, depth, length }: Passed) {
        let place = self.place(segment);
        let alone = &mut self.segments[place];
        match self.blend {
            Blend::Mix => {
                let depth = depth.min(OPAQUE as f64) * length;
                let hidden = (1.0 - alone.hidden) * (1.0 - (-depth).exp2()) as f32;
                alone.color += color * hidden;
                alone.hidden += hidden;
                alone.depth += depth as f32;
            }
            Blend::Add => alone.glow += color * ((1.0 - (-depth).exp2()) * length) as f32,
        }
    }
}

/// What some media are together: of those that mix colour times depth, and depth; what others add.
#[derive(Clone, Copy, Default)]
pub(crate) struct Mixture {
    pub(crate) mixed: Vec4,
    pub(crate) glow: Vec4,
}

impl Mixture {
    /// Adds a uniform medium: its straight colour, and halvings of the light over all of it.
    #[inline(always)]
    pub(crate) fn mix(&mut self, color: Vec4, depth: f32) {
        self.mixed += color.with_w(1.0) * depth;
    }

    /// Adds a share of what a layer shows of a piece.
    pub(crate) fn put_share(&mut self, alone: &Alone, share: f32) {
        if alone.hidden > 0.0 {
            self.mixed += (alone.color / alone.hidden).extend(1.0) * (alone.depth * share);
        }
        self.glow += alone.glow.extend(0.0) * share;
    }

    /// The colour that it shows where no light is lost on the way.
    #[inline(always)]
    pub(crate) fn seen(&self) -> Vec4 {
        self.mixed * std::f32::consts::LN_2 + self.glow
    }

    /// What projections show together, premultiplied, and the light that passes them: what adds is not dimmed.
    pub(crate) fn flat(&self) -> Vec4 {
        let left = (-self.mixed.w).exp2();
        let mixed = if self.mixed.w > 0.0 { self.mixed.xyz() * ((1.0 - left) / self.mixed.w) } else { Vec3::ZERO };
        (mixed + self.glow.xyz()).extend(left)
    }
}

/// How light passes media: the mean, from front to back, of the light that passes from there, and what passes all of it.
#[derive(Clone, Copy)]
pub(crate) struct Passage<T> {
    pub(crate) dimmed: T,
    pub(crate) left: T,
}

/// How light passes media of these depths.
#[inline(always)]
pub(crate) fn passages<const N: usize>(depth: &[f32; N]) -> Passage<[f32; N]> {
    let mut halvings = [0.0; N];
    for i in 0..N {
        halvings[i] = -depth[i];
    }
    let (powers, mut dimmed, mut left) = (exp2(&halvings), [0.0; N], [0.0; N]);
    for i in 0..N {
        let nats = depth[i] * std::f32::consts::LN_2;
        // Of thin media the difference would be what rounding leaves.
        let (thin, thick) = (1.0 - 0.5 * nats, (1.0 - powers[i]) / nats);
        dimmed[i] = if nats < 1e-3 { thin } else { thick };
        left[i] = if nats < 1e-3 { 1.0 - nats * thin } else { powers[i] };
    }
    Passage { dimmed, left }
}
