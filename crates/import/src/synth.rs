//! Generated volumes as sources: for demonstrations, benchmarks and tests.
//!
//! A voxel's value depends on its position, the kind, the extent, the time step and the seed, never on boxes or
//! threads. Fields are functions of the unit cube (voxel `i` of `n` is at `(i + 0.5) / n`), so every extent shows the
//! same object, finer with more voxels. Values are in *units* of 0 to 255: stored unchanged in u8 and f32, times 200
//! in u16 (so that the low byte carries the noise, as in a scan).
//!
//! A box is made row by row: a kind fills a row of f32, which is then rounded to the voxel type.

mod ct;
mod flow;
mod shapes;
#[cfg(test)]
mod tests;
mod turbulence;

use crate::axes::Sizes;
use crate::error::ImportError;
use crate::source::{Source, SourceInfo};
use brickyard_volume::{Extent, VoxelBox, VoxelType};
use glam::DVec3;
use shapes::{Sparse, Spheres};
use turbulence::Turbulence;

/// A kind of generated volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SynthKind {
    /// Noise of all scales everywhere: nothing to skip, little to compress.
    Turbulence,
    /// The Marschner-Lobb test signal, for judging reconstruction.
    MarschnerLobb,
    /// A dozen solid spheres in empty space.
    Spheres,
    /// A scan of an imagined specimen: a tube around a ball of shells in a turbulent matrix, noise over all.
    Ct,
    /// A turbulent plume, rising with time.
    Flow,
    /// Zero but for a few small spheres and the very last voxel ([`SPARSE_LAST_UNITS`]); boxes of zeros are known
    /// without making them, so extents may be huge.
    Sparse,
    /// A linear ramp along the main diagonal, from 0 to 255 units.
    Ramp,
    /// The same value, [`CONSTANT_UNITS`], in every voxel.
    Constant,
}

/// Value of every voxel of [`SynthKind::Constant`], in units of 0 to 255. A u16 voxel stores 200 times as much.
pub const CONSTANT_UNITS: f64 = 100.0;

/// Value of the last voxel of [`SynthKind::Sparse`], in units of 0 to 255. A u16 voxel stores 200 times as much.
pub const SPARSE_LAST_UNITS: f64 = 199.0;

/// Value of one unit in u16 voxels.
const U16_FACTOR: f32 = 200.0;

impl SynthKind {
    /// All kinds of generated volumes.
    pub const ALL: [SynthKind; 8] = [
        Self::Turbulence,
        Self::MarschnerLobb,
        Self::Spheres,
        Self::Ct,
        Self::Flow,
        Self::Sparse,
        Self::Ramp,
        Self::Constant,
    ];

    /// The kind's name on the command line, such as `marschner-lobb`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Turbulence => "turbulence",
            Self::MarschnerLobb => "marschner-lobb",
            Self::Spheres => "spheres",
            Self::Ct => "ct",
            Self::Flow => "flow",
            Self::Sparse => "sparse",
            Self::Ramp => "ramp",
            Self::Constant => "constant",
        }
    }
}

impl std::str::FromStr for SynthKind {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let names = || Self::ALL.map(Self::name).join(", ");
        Self::ALL
            .into_iter()
            .find(|k| k.name() == s)
            .ok_or_else(|| format!("unknown kind '{s}': expected one of {}", names()))
    }
}

/// A generated volume or series.
pub struct SynthSource {
    info: SourceInfo,
    seed: u64,
    field: Field,
}

/// A kind with its precomputed data.
enum Field {
    Turbulence(Turbulence),
    MarschnerLobb,
    Spheres(Spheres),
    Ct(Turbulence),
    Flow(Turbulence),
    Sparse(Sparse),
    Ramp,
    Constant,
}

/// Makes the row at `y` and `z` of one box, in units. Rows are requested in memory order.
type Rows<'a> = Box<dyn FnMut(u32, u32, &mut [f32]) + 'a>;

impl SynthSource {
    /// Creates a source of `steps` time steps. Only [`SynthKind::Flow`] changes with time.
    ///
    /// # Errors
    /// If an axis or the number of steps is 0, the volume exceeds 2^63 bytes, or the voxel type is not u8, u16 or f32.
    pub fn new(
        kind: SynthKind,
        extent: Extent,
        voxel_type: VoxelType,
        steps: u32,
        seed: u64,
    ) -> Result<Self, ImportError> {
        let name = std::path::Path::new(kind.name());
        if !matches!(voxel_type, VoxelType::U8 | VoxelType::U16 | VoxelType::F32) {
            let problem = format!("cannot be generated as {voxel_type}; use u8, u16 or f32");
            return Err(ImportError::options(name, problem));
        }
        let sizes = Sizes { extent, channels: 1, times: steps };
        sizes.checked_bytes(voxel_type.bytes()).map_err(|problem| ImportError::options(name, problem))?;
        let field = match kind {
            SynthKind::Turbulence => Field::Turbulence(Turbulence::new(seed, extent)),
            SynthKind::MarschnerLobb => Field::MarschnerLobb,
            SynthKind::Spheres => Field::Spheres(Spheres::new(seed)),
            SynthKind::Ct => Field::Ct(Turbulence::new(seed, extent)),
            SynthKind::Flow => Field::Flow(Turbulence::new(seed, extent)),
            SynthKind::Sparse => Field::Sparse(Sparse::new(seed, extent)),
            SynthKind::Ramp => Field::Ramp,
            SynthKind::Constant => Field::Constant,
        };
        let info = SourceInfo {
            calibrated: true,
            identity: format!("synth {} {extent} {voxel_type} steps {steps} seed {seed}", kind.name()),
            ..SourceInfo::plain(sizes, voxel_type)
        };
        Ok(Self { info, seed, field })
    }

    /// Returns the value at a continuous voxel position, as stored but not rounded. Voxel `i` is centred at `i + 0.5`.
    /// `None` for kinds without a formula: turbulence, ct, flow.
    pub fn value_at(&self, position: DVec3) -> Option<f64> {
        let extent = self.info.extent;
        let n = DVec3::new(extent.x as f64, extent.y as f64, extent.z as f64);
        let units = match &self.field {
            Field::MarschnerLobb => shapes::marschner_lobb_at(position / n),
            Field::Spheres(spheres) => spheres.at(position / n),
            Field::Sparse(sparse) => sparse.at(position),
            Field::Ramp => shapes::ramp_at(position / n),
            Field::Constant => CONSTANT_UNITS,
            Field::Turbulence(_) | Field::Ct(_) | Field::Flow(_) => return None,
        };
        Some(units * self.factor())
    }

    /// Value of one unit, as stored.
    fn factor(&self) -> f64 {
        if self.info.voxel_type == VoxelType::U16 { U16_FACTOR.into() } else { 1.0 }
    }

    fn rows(&self, time: u32, region: VoxelBox) -> Rows<'_> {
        let extent = self.info.extent;
        match &self.field {
            Field::Turbulence(noise) => Box::new(turbulence::haze(noise, extent, region)),
            Field::MarschnerLobb => Box::new(shapes::marschner_lobb_rows(extent, region)),
            Field::Spheres(spheres) => Box::new(spheres.rows(extent, region)),
            Field::Ct(noise) => {
                let mut ct = ct::Ct::new(noise, self.seed, extent, region);
                Box::new(move |y, z, units| ct.row(y, z, units))
            }
            Field::Flow(noise) => Box::new(flow::rows(noise, time, extent, region)),
            Field::Sparse(sparse) => Box::new(sparse.rows(region)),
            Field::Ramp => Box::new(shapes::ramp_rows(extent, region)),
            Field::Constant => Box::new(|_, _, units| units.fill(CONSTANT_UNITS as f32)),
        }
    }
}

impl Source for SynthSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let width = region.extent().x as usize;
        let mut rows = self.rows(time, region);
        let mut units = vec![0f32; width];
        let mut lines = out.chunks_exact_mut(width * self.info.voxel_type.bytes());
        for z in region.min.z..region.max.z {
            for y in region.min.y..region.max.y {
                rows(y, z, &mut units);
                if let Some(line) = lines.next() {
                    store(self.info.voxel_type, &units, line);
                }
            }
        }
        Ok(())
    }

    fn constant_in(&self, _time: u32, _channel: u32, region: VoxelBox) -> Option<f64> {
        let units = match &self.field {
            Field::Constant => Some(CONSTANT_UNITS),
            Field::Sparse(sparse) => sparse.is_zero_in(region).then_some(0.0),
            Field::Spheres(spheres) => spheres.is_zero_in(self.info.extent, region).then_some(0.0),
            _ => None,
        };
        units.map(|u| u * self.factor())
    }
}

/// Stores units as voxels: u8, u16 or f32.
fn store(voxel_type: VoxelType, units: &[f32], out: &mut [u8]) {
    match voxel_type {
        VoxelType::U8 => {
            for (o, u) in out.iter_mut().zip(units) {
                *o = round_bits(u.clamp(0.0, 255.0)) as u8;
            }
        }
        VoxelType::U16 => {
            for (o, u) in out.as_chunks_mut::<2>().0.iter_mut().zip(units) {
                *o = (round_bits((u * U16_FACTOR).clamp(0.0, 65535.0)) as u16).to_le_bytes();
            }
        }
        _ => {
            for (o, u) in out.as_chunks_mut::<4>().0.iter_mut().zip(units) {
                *o = u.to_le_bytes();
            }
        }
    }
}

/// Low 22 bits: a value of `0..2^22` rounded to the nearest integer, ties to even. Adding 2^23 leaves it in the low
/// mantissa bits, in one vector instruction, unlike a conversion.
#[inline]
fn round_bits(value: f32) -> u32 {
    (value + (1 << 23) as f32).to_bits()
}

/// A well-mixed 64-bit hash (SplitMix64's output function).
#[inline]
fn mix(key: u64) -> u64 {
    let mut z = key.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The `index`-th number in `0..1` of a seeded sequence, the same on every machine.
pub fn uniform(seed: u64, index: u64) -> f64 {
    (mix(mix(seed) ^ index) >> 11) as f64 / (1u64 << 53) as f64
}

/// Centre of voxel `i` of `n` in the unit interval.
fn centre(i: u32, n: u32) -> f64 {
    (i as f64 + 0.5) / n as f64
}

fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
