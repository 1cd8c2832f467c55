//! Contents of slots, made from a source's voxels. The RAM cache keeps source voxels, so slots can be refilled in another way without
//! decoding; an [`Encoder`] turns a padded brick's voxels into slot codes as it is assembled. Costs a pass over the padded brick, except
//! for unsigned voxels of 8 and 16 bits, which are codes already.

use crate::retry::Failure;
use crate::source::BrickSource;
use brickyard_volume::{FloatSlots, LabelCodes, SlotEncoding};
use std::sync::Arc;

/// Representation of a volume's voxels in its slots.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SlotContents {
    /// Codes for the values of each channel, or for its labels.
    #[default]
    Codes,
    /// 32-bit floats.
    Floats(FloatSlots),
    /// Codes for labels by the look of a layer: for labels spread wider than 16 bits.
    Labels(Arc<LabelCodes>),
}

impl SlotContents {
    /// Slot encoding of a channel's values; the same format for all channels.
    pub(crate) fn encoding(&self, source: &dyn BrickSource, channel: u32) -> SlotEncoding {
        let floats = match self {
            Self::Floats(floats) => Some(*floats),
            Self::Codes | Self::Labels(_) => None,
        };
        encoding_of(source, channel).in_slots(floats)
    }
}

/// Encoding of a channel's values as slot codes, outside of f32 slots; the same format for all channels.
pub fn encoding_of(source: &dyn BrickSource, channel: u32) -> SlotEncoding {
    let (voxel_type, range) = (source.voxel_type(), source.channel_range(channel));
    if source.is_labels() {
        return SlotEncoding::of_labels(voxel_type, range, source.has_non_finite(), source.nodata());
    }
    if let Some(nodata) = source.nodata() {
        // Whether 8 bits are enough is decided for all channels together, since slots hold bricks of any.
        let range = if voxel_type.bytes() == 1 { source.value_range() } else { range };
        return SlotEncoding::without(voxel_type, range, nodata);
    }
    SlotEncoding::new(voxel_type, range, source.has_non_finite())
}

/// Encoder of a source's voxels as slot codes.
pub(crate) struct Encoder {
    /// One per channel, differing only in the values of their codes.
    encodings: Vec<SlotEncoding>,
    labels: Arc<LabelCodes>,
    /// Voxels of a padded brick; empty where voxels are codes already.
    voxels: Vec<u8>,
}

impl Encoder {
    /// Creates an encoder with a buffer of the layout's `scratch_bytes`.
    pub(crate) fn new(source: &dyn BrickSource, contents: &SlotContents, scratch_bytes: u64) -> Self {
        let encodings = (0..source.channels().max(1)).map(|channel| contents.encoding(source, channel)).collect();
        let labels = match contents {
            SlotContents::Labels(labels) => labels.clone(),
            SlotContents::Codes | SlotContents::Floats(_) => Arc::default(),
        };
        let voxels = vec![0; scratch_bytes as usize];
        Self { encodings, labels, voxels }
    }

    pub(crate) fn encoding(&self, channel: u32) -> SlotEncoding {
        self.encodings[channel as usize]
    }

    /// Writes the codes of the padded brick that `fill` writes as voxels.
    ///
    /// # Errors
    /// The error of `fill`, if it fails.
    pub(crate) fn encode(
        &mut self,
        channel: u32,
        codes: &mut [u8],
        fill: impl FnOnce(&mut [u8]) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let encoding = self.encodings[channel as usize];
        if self.voxels.is_empty() {
            return fill(codes);
        }
        fill(&mut self.voxels)?;
        if encoding.is_hashed {
            self.labels.encode(&encoding, &self.voxels, codes);
        } else {
            encoding.encode(&self.voxels, codes);
        }
        Ok(())
    }
}
