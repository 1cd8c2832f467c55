//! What slots hold of a source's voxels. The RAM cache keeps voxels as the source has them, so that slots can be filled anew in another
//! way without decoding a brick again; an [`Encoder`] makes slot codes of a padded brick's voxels as it is put together. Costs a pass over
//! the padded brick, but for unsigned voxels of 8 and 16 bits, which are codes already.

use crate::layout::Layout;
use crate::source::BrickSource;
use brickyard_volume::{FloatSlots, LabelCodes, SlotEncoding};
use std::sync::Arc;

/// What the slots of a volume hold of its voxels.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SlotContents {
    /// Codes for the values of each channel, or for its labels.
    #[default]
    Codes,
    /// 32-bit floats.
    Floats(FloatSlots),
    /// Codes for labels by the look of a layer: labels that are further apart than 16 bits reach.
    Labels(Arc<LabelCodes>),
}

impl SlotContents {
    /// How a source's values are held in slots, in the same format for all channels.
    pub(crate) fn encoding(&self, source: &dyn BrickSource, channel: u32) -> SlotEncoding {
        let floats = match self {
            Self::Floats(floats) => Some(*floats),
            Self::Codes | Self::Labels(_) => None,
        };
        encoding_of(source, channel).in_slots(floats)
    }
}

/// How a source's values are encoded as slot codes, in the same format for all channels, where they are not put into f32 slots.
pub fn encoding_of(source: &dyn BrickSource, channel: u32) -> SlotEncoding {
    let (voxel_type, range) = (source.voxel_type(), source.channel_range(channel));
    if source.is_labels() {
        return SlotEncoding::of_labels(voxel_type, range, source.has_non_finite(), source.nodata());
    }
    if let Some(nodata) = source.nodata() {
        // Whether 8 bits are enough is for all channels together, since slots hold bricks of any.
        let range = if voxel_type.bytes() == 1 { source.value_range() } else { range };
        return SlotEncoding::without(voxel_type, range, nodata);
    }
    SlotEncoding::new(voxel_type, range, source.has_non_finite())
}

/// Makes slot codes of a source's voxels.
pub(crate) struct Encoder {
    /// One for each channel, alike but for the values that their codes stand for.
    encodings: Vec<SlotEncoding>,
    labels: Arc<LabelCodes>,
    /// The voxels of a padded brick; empty where voxels are codes already.
    voxels: Vec<u8>,
}

impl Encoder {
    pub(crate) fn new(source: &dyn BrickSource, contents: &SlotContents, layout: &Layout) -> Self {
        let encodings = (0..source.channels().max(1)).map(|channel| contents.encoding(source, channel)).collect();
        let labels = match contents {
            SlotContents::Labels(labels) => labels.clone(),
            SlotContents::Codes | SlotContents::Floats(_) => Arc::default(),
        };
        let voxels = vec![0; scratch_bytes(source, layout) as usize];
        Self { encodings, labels, voxels }
    }

    /// How the values of a channel are held in slots.
    pub(crate) fn encoding(&self, channel: u32) -> SlotEncoding {
        self.encodings[channel as usize]
    }

    /// Has `fill` write the voxels of a padded brick, and writes their codes to `codes`.
    ///
    /// # Errors
    /// The error of `fill`, if it fails.
    pub(crate) fn encode<E>(
        &mut self,
        channel: u32,
        codes: &mut [u8],
        fill: impl FnOnce(&mut [u8]) -> Result<(), E>,
    ) -> Result<(), E> {
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

/// Bytes of the voxels that a thread needs a buffer for while it makes codes of them; 0 where they are codes already.
pub(crate) fn scratch_bytes(source: &dyn BrickSource, layout: &Layout) -> u64 {
    if encoding_of(source, 0).is_identity() { 0 } else { layout.padded_voxels() as u64 * layout.voxel_bytes as u64 }
}
