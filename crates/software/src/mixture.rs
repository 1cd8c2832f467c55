//! The joint media of layers in one interval of a ray, in single precision: twins of
//! [`brickyard_volume::compositing`]'s `LayerMedium` and `JointMedium`.

use crate::packet::{CHUNK, exp2};
use crate::row::Passed;
use crate::unit::Unit;
use brickyard_volume::Blend;
use glam::{Vec3, Vec4, Vec4Swizzles};

/// The depth of an opaque medium: finite, so that sums and shares of it are numbers.
pub(crate) const OPAQUE: f32 = 1e30;

/// The joint media of a segment: their colour without absorption, and their depth. Kept as two vectors to be summed, so
/// that two neighbouring entries of a table can be added at once.
#[derive(Clone, Copy)]
#[repr(C)]
pub(crate) struct Mixed {
    near: Vec4,
    far: Vec4,
}

impl Mixed {
    pub(crate) const NONE: Self = Self { near: Vec4::ZERO, far: Vec4::ZERO };

    #[inline(always)]
    pub(crate) fn add(&mut self, media: Vec4) {
        self.near += media;
    }

    /// Adds two neighbouring entries of a table of media: the share `near` of the first, and `far` of the second.
    #[inline(always)]
    pub(crate) fn add_shares<U: Unit>(&mut self, entries: &[Vec4; 2], near: f32, far: f32) {
        #[cfg(target_arch = "x86_64")]
        if U::AVX2 {
            // SAFETY: the machine has AVX2.
            return unsafe { self.add_shares_avx2(entries, near, far) };
        }
        self.near += entries[0] * near;
        self.far += entries[1] * far;
    }

    /// [`Mixed::add_shares`], inlined into a function with AVX2.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    unsafe fn add_shares_avx2(&mut self, entries: &[Vec4; 2], near: f32, far: f32) {
        use std::arch::x86_64::{
            _mm_set1_ps, _mm256_add_ps, _mm256_loadu_ps, _mm256_mul_ps, _mm256_set_m128, _mm256_storeu_ps,
        };
        let sums: *mut f32 = std::ptr::from_mut(self).cast();
        // SAFETY: the caller's promise; two vectors of four lie one behind the other, as one of eight.
        unsafe {
            let shares = _mm256_set_m128(_mm_set1_ps(far), _mm_set1_ps(near));
            let added = _mm256_mul_ps(_mm256_loadu_ps(entries.as_ptr().cast()), shares);
            _mm256_storeu_ps(sums, _mm256_add_ps(_mm256_loadu_ps(sums), added));
        }
    }

    /// The media's colour, and their depth as the last component.
    #[inline(always)]
    pub(crate) fn sum(&self) -> Vec4 {
        self.near + self.far
    }
}

/// One layer's own medium in a piece of a segment.
#[derive(Clone, Copy, Default)]
pub(crate) struct LayerMedium {
    /// Premultiplied colour of a mixing layer, and its opacity.
    color: Vec3,
    hidden: f32,
    /// Halvings of the light on the way through.
    depth: f32,
    /// Light emitted by an additive layer.
    emission: Vec3,
}

impl LayerMedium {
    /// The media of a share of the piece: their colour without absorption, and their depth.
    #[inline(always)]
    pub(crate) fn media(&self, share: f32) -> Vec4 {
        let emission = self.emission * share;
        if self.hidden > 0.0 {
            let depth = self.depth * std::f32::consts::LN_2 * share;
            (self.color * (depth / self.hidden) + emission).extend(depth)
        } else {
            emission.extend(0.0)
        }
    }
}

/// A chunk's segments as one layer shows them alone.
pub(crate) struct LayerMediumChunk {
    pub(crate) blend: Blend,
    /// The place in the chunk of the stretch's first segment.
    pub(crate) first: i32,
    pub(crate) segments: [LayerMedium; CHUNK],
}

impl LayerMediumChunk {
    pub(crate) const EMPTY: Self = {
        let nothing = LayerMedium { color: Vec3::ZERO, hidden: 0.0, depth: 0.0, emission: Vec3::ZERO };
        Self { blend: Blend::Mix, first: 0, segments: [nothing; CHUNK] }
    };

    pub(crate) fn place(&self, segment: i32) -> usize {
        (self.first + segment) as usize
    }

    /// Adds a medium to its segment, behind those already there.
    #[inline(always)]
    pub(crate) fn pass(&mut self, Passed { segment, color, depth, length }: Passed) {
        let place = self.place(segment);
        let alone = &mut self.segments[place];
        match self.blend {
            Blend::Mix | Blend::Over => {
                let depth = depth.min(OPAQUE as f64) * length;
                let hidden = (1.0 - alone.hidden) * (1.0 - (-depth).exp2()) as f32;
                alone.color += color * hidden;
                alone.hidden += hidden;
                alone.depth += depth as f32;
            }
            Blend::Add => alone.emission += color * ((1.0 - (-depth).exp2()) * length) as f32,
        }
    }
}

/// The joint result of several projections.
#[derive(Clone, Copy, Default)]
pub(crate) struct Projections {
    /// Colour times depth, and depth, of mixing layers.
    mixed: Vec4,
    /// The colour of additive layers.
    pub(crate) emission: Vec4,
    /// Premultiplied colour and opacity of the layers on top.
    over: Vec4,
}

impl Projections {
    /// Mixes in a projection's colour as a medium of this depth, in halvings of the light.
    pub(crate) fn mix(&mut self, color: Vec4, depth: f32) {
        self.mixed += color.with_w(1.0) * depth;
    }

    /// Puts a projection's colour, with this opacity, on top of all others.
    pub(crate) fn put_over(&mut self, color: Vec4, opacity: f32) {
        self.over = self.over * (1.0 - opacity) + color.with_w(1.0) * opacity;
    }

    /// Returns the premultiplied joint colour and the transmitted light. Additive colours are dimmed only by layers on
    /// top of them.
    pub(crate) fn seen(&self) -> Vec4 {
        let left = (-self.mixed.w).exp2();
        let mixed = if self.mixed.w > 0.0 { self.mixed.xyz() * ((1.0 - left) / self.mixed.w) } else { Vec3::ZERO };
        self.over.with_w(0.0) + (mixed + self.emission.xyz()).extend(left) * (1.0 - self.over.w)
    }
}

/// Shallower media transmit light by the first four terms of the series: the next one is 1e-7.
const THIN: f32 = 1.0 / 16.0;

/// Working memory for light passing the media of a chunk, front to back.
pub(crate) struct Passage {
    media: [Vec4; CHUNK],
    depth: [f32; CHUNK],
    /// Each medium's mean, from front to back, of the light dimmed so far, and the light left behind it.
    dimmed: [f32; CHUNK],
    left: [f32; CHUNK],
}

impl Passage {
    pub(crate) const EMPTY: Self = {
        let none = [0.0; CHUNK];
        Self { media: [Vec4::ZERO; CHUNK], depth: none, dimmed: none, left: none }
    };

    /// Passes light through the media of a chunk's segments or of a part of them. Returns premultiplied colour and the
    /// remaining light, and writes the light entering each segment to `visibility`.
    #[inline(always)]
    pub(crate) fn pass(&mut self, mixed: &[Mixed], mut light: Vec4, visibility: &mut [f32]) -> Vec4 {
        for ((media, depth), mixed) in self.media.iter_mut().zip(&mut self.depth).zip(mixed) {
            *media = mixed.sum();
            *depth = media.w;
        }
        // Four by four, so that none waits for those before it; nothing is behind the last one.
        let count = mixed.len().min(CHUNK);
        let full = count.next_multiple_of(4);
        self.media[count..full].fill(Vec4::ZERO);
        self.depth[count..full].fill(0.0);
        passages(&self.depth[..full], &mut self.dimmed[..full], &mut self.left[..full]);
        let (media, _) = self.media[..full].as_chunks::<4>();
        let (dimmed, _) = self.dimmed[..full].as_chunks::<4>();
        let (left, _) = self.left[..full].as_chunks_mut::<4>();
        let mut seen = [light, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO];
        for ((media, dimmed), left) in media.iter().zip(dimmed).zip(&mut *left) {
            let passing = light.w;
            let pair = left[0] * left[1];
            light.w *= pair * (left[2] * left[3]);
            *left = [passing, passing * left[0], passing * pair, passing * (pair * left[2])];
            for i in 0..4 {
                seen[i] += media[i] * (left[i] * dimmed[i]);
            }
        }
        for (visibility, left) in visibility.iter_mut().zip(left.as_flattened()) {
            *visibility = *left;
        }
        ((seen[0] + seen[1]) + (seen[2] + seen[3])).with_w(light.w)
    }
}

/// Computes the passage of light through media of these depths: the mean, from front to back, of the light dimmed so
/// far, and the light left behind each.
#[inline(always)]
fn passages(depth: &[f32], dimmed: &mut [f32], left: &mut [f32]) {
    let mut is_thick = 0;
    for ((&depth, dimmed), left) in depth.iter().zip(&mut *dimmed).zip(&mut *left) {
        *dimmed = 1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth * (1.0 / 24.0)));
        *left = 1.0 - depth * *dimmed;
        is_thick |= (depth > THIN) as i32;
    }
    if is_thick != 0 {
        for ((&depth, dimmed), left) in depth.iter().zip(dimmed).zip(left) {
            let [power] = exp2(&[depth * -std::f32::consts::LOG2_E]);
            let is_thin = depth <= THIN;
            *dimmed = if is_thin { *dimmed } else { (1.0 - power) / depth };
            *left = if is_thin { *left } else { power };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_passes_as_its_integral_says() {
        let depth: Vec<f32> = (0..4000).map(|i| 1e-7 * 1.006f32.powi(i)).chain([0.0, OPAQUE]).collect();
        for depth in depth.chunks(32) {
            let (mut dimmed, mut left) = ([0.0; 32], [0.0; 32]);
            passages(depth, &mut dimmed, &mut left);
            for (i, &depth) in depth.iter().enumerate() {
                let (depth, power) = (depth as f64, (-depth as f64).exp());
                let mean = if depth > 0.0 { -(-depth).exp_m1() / depth } else { 1.0 };
                // Single precision, and at most 2^-20 of 1 - power at THIN.
                assert!((left[i] as f64 - power).abs() < 4e-7, "{depth}: {} {power}", left[i]);
                assert!((dimmed[i] as f64 - mean).abs() < 2e-6 * mean + 1e-30, "{depth}: {} {mean}", dimmed[i]);
            }
        }
    }
}
