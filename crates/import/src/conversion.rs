//! Conversion of a voxel's value to another voxel type: the same number, or else the nearest one, if losses are allowed. The rules for
//! voxels without data hold before and after it. Costs a few operations a voxel.

use crate::options::{NoData, OpenOptions};
use crate::source::SourceInfo;
use brickyard_volume::{VoxelType, with_voxel_type};

/// The effect of a conversion on a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fate {
    Kept,
    /// The voxel holds no data, before and after.
    NoData,
    Rounded,
    Clamped,
    /// The voxel holds no data, and the new type has no value for that.
    Unmarked,
    /// The value would become the one for no data.
    Beside,
}

impl Fate {
    /// Whether the value may be converted under the rules for losses.
    pub(crate) fn is_allowed(self, lossy: bool) -> bool {
        match self {
            Self::Kept | Self::NoData => true,
            Self::Rounded | Self::Clamped => lossy,
            Self::Unmarked | Self::Beside => false,
        }
    }
}

/// The rules of a conversion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Conversion {
    pub(crate) from: VoxelType,
    pub(crate) to: VoxelType,
    /// Value of voxels without data after the conversion to integers; floats become NaN.
    pub(crate) marker: Option<f64>,
    /// Value of voxels without data before the conversion, besides NaN and the infinities.
    sought: Option<f64>,
    /// Value for no data, which no lossy value may become.
    reserved: Option<f64>,
    /// Whether a value equal to the reserved one is data, and so may not stay.
    guards_equal: bool,
}

impl Conversion {
    /// Finds the rules for a source's voxels. `Err` is its value for no data, which the new type cannot hold; in a step, it becomes that of
    /// the steps before.
    pub(crate) fn new(info: &SourceInfo, to: VoxelType, options: &OpenOptions) -> Result<Self, f64> {
        let (from, own) = (info.voxel_type, info.nodata);
        // The value of the steps before holds here, too.
        let held = options
            .held_as
            .and_then(|held| held.nodata)
            .filter(|held| options.nodata == NoData::OfFile && to.holds(*held));
        let is_held = |own: &f64| to.is_float() || to.holds(*own);
        let marker = own.filter(is_held).or(held);
        if let (Some(own), None) = (own, marker) {
            return Err(own);
        }
        let is_replaced = own.is_some() && own != marker;
        let sought = match (own, info.knows_nodata) {
            (Some(own), knows) => Some(own).filter(|_| !(knows && from.is_float())),
            (None, true) => None,
            (None, false) => held,
        };
        Ok(Self {
            from,
            to,
            marker,
            sought,
            // Floats mark voxels by NaN, so their numbers may equal the input's own value.
            reserved: if to.is_float() && own.is_some() { None } else { marker },
            guards_equal: from.is_float() && info.knows_nodata || is_replaced,
        })
    }

    /// Whether any value of the type before it may be lost or refused.
    pub(crate) fn may_lose(&self) -> bool {
        may_lose(self.from, self.to)
    }

    /// The value after the conversion, and its fate. Ties are rounded to even.
    pub(crate) fn of(&self, value: f64) -> (f64, Fate) {
        if !value.is_finite() || Some(value) == self.sought {
            return match (self.to.is_float(), self.marker) {
                (true, _) => (f64::NAN, Fate::NoData),
                (false, Some(marker)) => (marker, Fate::NoData),
                (false, None) => (0.0, Fate::Unmarked),
            };
        }
        let (least, most) = self.to.limits();
        let rounded = if self.to.is_float() { f64::from(value as f32) } else { value.round_ties_even() };
        let held = rounded.clamp(least, most);
        let fate = match () {
            () if held == value => Fate::Kept,
            () if held == rounded => Fate::Rounded,
            () => Fate::Clamped,
        };
        let is_reserved = Some(held) == self.reserved && (fate != Fate::Kept || self.guards_equal);
        (held, if is_reserved { Fate::Beside } else { fate })
    }

    /// Converts contiguous voxels, little-endian; `see` gets each voxel's number, value and fate unless the value is kept.
    ///
    /// # Errors
    /// The first error of `see`.
    pub(crate) fn convert<E>(
        &self,
        voxels: &[u8],
        out: &mut [u8],
        mut see: impl FnMut(usize, f64, Fate) -> Result<(), E>,
    ) -> Result<(), E> {
        use brickyard_volume::Voxel;
        with_voxel_type!(self.from, From => with_voxel_type!(self.to, To => {
            let (voxels, _) = voxels.as_chunks::<{ size_of::<From>() }>();
            let (out, _) = out.as_chunks_mut::<{ size_of::<To>() }>();
            for (i, (voxel, out)) in voxels.iter().zip(out).enumerate() {
                let value = From::from_le_bytes(*voxel) as f64;
                let (held, fate) = self.of(value);
                if fate != Fate::Kept {
                    see(i, value, fate)?;
                }
                *out = <To as Voxel>::from_f64_rounded(held).to_le_bytes();
            }
        }));
        Ok(())
    }
}

/// Whether some value of a type is none of another one.
pub(crate) fn may_lose(from: VoxelType, to: VoxelType) -> bool {
    match (from, to) {
        (VoxelType::F32, to) => to != VoxelType::F32,
        (VoxelType::U32 | VoxelType::I32, VoxelType::F32) => true,
        (from, to) => {
            let ((low, high), (least, most)) = (from.limits(), to.limits());
            low < least || high > most
        }
    }
}
