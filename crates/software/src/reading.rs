//! The reading of a padded brick at a place: through a filter or, for labels, as the label of the surrounding voxel,
//! whatever the filter.

use crate::packet::{LANES, PACKETS, Packet, points};
use crate::sample::{Brick, Code, SampleChunk};
use crate::unit::Unit;
use brickyard_volume::{Filter, FrameSettings};

/// The kind of sample taken of a padded brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reading {
    /// The code of the voxel around the place: a label.
    Label,
    /// The filtered codes around the place.
    Filtered(Filter),
}

impl Reading {
    pub(crate) fn of(settings: &FrameSettings) -> Self {
        match settings.encoding.is_labels {
            true => Self::Label,
            false => Self::Filtered(settings.sampling.filter),
        }
    }

    /// How bricks are read for gradients; those of labels are computed differently.
    pub(crate) fn of_gradients(self) -> Self {
        match self {
            Self::Label => Self::Label,
            Self::Filtered(filter) => Self::Filtered(filter.of_gradients()),
        }
    }
}

impl Brick<'_> {
    /// Samples like [`Brick::sample`], with a given reading.
    #[inline(always)]
    pub(crate) fn read<C: Code, U: Unit>(
        &self,
        reading: Reading,
        origin: [f32; 3],
        step: [f32; 3],
        chunk: &mut SampleChunk,
    ) {
        if reading == Reading::Filtered(Filter::Trilinear) {
            return self.sample::<C, U>(origin, step, chunk);
        }
        for p in 0..chunk.packets.min(PACKETS) {
            let points = points(origin, step, &chunk.along[p]);
            chunk.code[p] = self.read_points::<C, U>(reading, &points, &mut chunk.weight[p]);
        }
    }

    /// Samples like [`Brick::sample_points`], with a given reading.
    #[inline(always)]
    pub(crate) fn read_points<C: Code, U: Unit>(
        &self,
        reading: Reading,
        points: &[Packet; 3],
        weight: &mut Packet,
    ) -> Packet {
        match reading {
            Reading::Filtered(Filter::Trilinear) => self.sample_points::<C, U>(points, weight),
            Reading::Filtered(Filter::Tricubic) => self.cubic_points::<C>(points, weight),
            Reading::Label | Reading::Filtered(Filter::Nearest) => self.nearest_points::<C>(points, weight),
        }
    }

    /// Returns the codes of the voxels around eight slot coordinates. The weights of those without a value become 0.
    #[inline(never)]
    fn nearest_points<C: Code>(&self, points: &[Packet; 3], weight: &mut Packet) -> Packet {
        let mut code = [0.0; LANES];
        for i in 0..LANES {
            let [x, y, z] = [0, 1, 2].map(|a| self.nearest(points[a][i]));
            let (number, has_value) = C::part(self.number::<C>([x, y, z]), &self.map);
            code[i] = if C::IS_FLOAT { self.map.code(number) } else { number };
            if C::INVALID && !has_value {
                weight[i] = 0.0;
            }
        }
        code
    }

    /// The indicator of a code at a slot coordinate: the field that is 1 in voxels of that code and 0 in others,
    /// filtered linearly.
    #[inline(never)]
    pub(crate) fn indicator<C: Code>(&self, point: [f32; 3], code: f32) -> f32 {
        let low = point.map(|v| v.clamp(0.0, (self.padded() - 1) as f32).floor());
        let t: [f32; 3] = std::array::from_fn(|a| (point[a] - low[a]).clamp(0.0, 1.0));
        let mut sum = 0.0;
        for corner in (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2]) {
            let voxel = std::array::from_fn(|a| (low[a] as usize + corner[a]).min(self.padded() - 1));
            if self.number::<C>(voxel) == code {
                sum += (0..3).map(|a| if corner[a] == 1 { t[a] } else { 1.0 - t[a] }).product::<f32>();
            }
        }
        sum
    }

    #[inline(always)]
    fn nearest(&self, v: f32) -> usize {
        // For NaN the cast gives 0.
        (v + 0.5).clamp(0.0, (self.padded() - 1) as f32) as usize
    }

    /// The code of a voxel, or the number in its f32 slot.
    #[inline(always)]
    fn number<C: Code>(&self, [x, y, z]: [usize; 3]) -> f32 {
        let at = ((z * self.padded() + y) * self.padded() + x) * C::BYTES;
        let codes = &self.codes[at..][..C::BYTES];
        match *codes {
            [code] => code as f32,
            [a, b] => u16::from_le_bytes([a, b]) as f32,
            [a, b, c, d] => f32::from_le_bytes([a, b, c, d]),
            _ => unreachable!("voxels of slots have 1, 2 or 4 bytes"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Code8, Code16, CodeMap, Float32};
    use brickyard_volume::slot_encoding::INVALID_SLOT;
    use brickyard_volume::{KeptSlots, SlotEncoding, VoxelType, Window};

    /// The identity map of slots of codes.
    fn codes_alone() -> CodeMap {
        CodeMap::of(&SlotEncoding::new(VoxelType::U8, (0.0, 1.0), false))
    }

    /// Labels 1 and 3 side by side along x, in a brick of four voxels along an edge.
    fn two_labels() -> Vec<u8> {
        (0..64).map(|i| if i % 4 < 2 { 1 } else { 3 }).collect()
    }

    #[test]
    fn the_nearest_voxel_is_the_one_that_a_place_is_in() {
        let codes = two_labels();
        let brick = Brick::new::<Code8<false>>(&codes, 4, codes_alone());
        // A face is the upper voxel's.
        let x = [-0.4, 0.0, 1.0, 1.49, 1.5, 2.0, 3.4, f32::NAN];
        let found = brick.nearest_points::<Code8<false>>(&[x, [1.2; LANES], [2.8; LANES]], &mut [1.0; LANES]);
        assert_eq!(found, [1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 1.0]);
        let wide: Vec<u8> = codes.iter().flat_map(|&c| (if c == 1 { 0u16 } else { 60_000 }).to_le_bytes()).collect();
        let (brick, mut weight) = (Brick::new::<Code16<true>>(&wide, 4, codes_alone()), [2.0; LANES]);
        let found = brick.nearest_points::<Code16<true>>(&[x, [1.2; LANES], [2.8; LANES]], &mut weight);
        assert_eq!((found[3], found[4], weight[3], weight[4]), (0.0, 60_000.0, 0.0, 2.0));
        let numbers: Vec<u8> =
            codes.iter().flat_map(|&c| (if c == 1 { INVALID_SLOT } else { 1e6 + 0.5 }).to_le_bytes()).collect();
        let floats = SlotEncoding::new(VoxelType::F32, (-1e9, 1e9), true);
        let floats = floats.for_window(Some(Window::of([1e6, 1e6 + 1.0])), KeptSlots::default());
        let (brick, mut weight) = (Brick::new::<Float32>(&numbers, 4, CodeMap::of(&floats)), [2.0; LANES]);
        let found = brick.nearest_points::<Float32>(&[x, [1.2; LANES], [2.8; LANES]], &mut weight);
        assert_eq!((weight[3], weight[4]), (0.0, 2.0));
        assert!((f64::from(found[4]) / 65535.0 - floats.unorm(1e6 + 0.5)).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn an_indicator_falls_from_one_to_zero_between_voxels() {
        let codes = two_labels();
        let brick = Brick::new::<Code8<false>>(&codes, 4, codes_alone());
        let at = |x: f32, label: f32| brick.indicator::<Code8<false>>([x, 1.3, 0.6], label);
        for (x, share) in [(0.0, 1.0), (1.0, 1.0), (1.25, 0.75), (1.5, 0.5), (2.0, 0.0), (3.0, 0.0)] {
            assert!((at(x, 1.0) - share).abs() < 1e-6 && (at(x, 3.0) - (1.0 - share)).abs() < 1e-6, "{x}");
            assert_eq!(at(x, 2.0), 0.0, "nothing in between");
        }
    }
}
