//! Brick layout in host memory: cores and their shells in the RAM cache, as voxels; padded bricks in staging, as slot codes, followed by
//! gradients if needed.
//!
//! Where the source stores aprons at least as wide as requested, there are no shells: each cached core is followed by its stored apron.
//!
//! A *shell* is all that neighbours can need of a core: its outer voxels, as deep as the apron, as six slabs, one per face. Edges and
//! corners lie in several slabs. At 64^3 and an apron of 1 a shell is 9 % of its core, so many more shells than cores fit. It is also
//! read front to back, whereas in the core every voxel of an x face lies on its own cache line.

use crate::budget::PagerError;
use crate::slot_contents::{SlotContents, encoding_of};
use crate::source::BrickSource;
use brickyard_volume::sampling::MAX_REACH;
use brickyard_volume::{Apron, GradientNodes};

/// Shells per core in the RAM cache.
///
/// At the front of a sweep, between finished and untouched bricks, lie bricks with cores still needed, and about twice as many with only
/// shells needed: hence at least 2. Where the front does not fit, more is better: a missing core costs one more decode, a missing shell
/// up to 26. In sweeps of 16^3 bricks along Morton and Hilbert curves with an apron of 1, through caches of 1 % to 18 % of the cores'
/// bytes, 2 instead of 4 decodes up to 48 % more where the front does not fit and at best 4 % less; 6 decodes up to 12 % less in caches
/// up to 3 % and up to 6 % more in larger ones.
const SHELLS_PER_CORE: usize = 4;

/// Sizes of one source's bricks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Layout {
    pub(crate) edge: usize,
    pub(crate) apron: usize,
    /// Width of the source's stored aprons in voxels; 0 where aprons are assembled from shells.
    pub(crate) stored: usize,
    /// Bytes per voxel in the source and the RAM cache.
    pub(crate) voxel_bytes: usize,
    pub(crate) code_bytes: usize,
    pub(crate) gradients: GradientNodes,
}

impl Layout {
    /// Layout of a source's padded bricks in slots with these contents.
    ///
    /// # Errors
    /// If the apron or the gradients do not fit the bricks.
    pub(crate) fn new(
        source: &dyn BrickSource,
        apron: u32,
        gradient_layers: u32,
        contents: &SlotContents,
    ) -> Result<Self, PagerError> {
        let edge = source.pyramid().edge();
        if !(1..=MAX_REACH).contains(&apron) || apron > edge {
            return Err(PagerError::Apron { apron, edge });
        }
        let gradients = GradientNodes { edge, layers: gradient_layers };
        if gradients.apron() > apron || (gradient_layers > 0 && !edge.is_multiple_of(2)) {
            return Err(PagerError::Gradients { apron, least: gradients.apron(), edge });
        }
        let stored = source.stored_apron();
        Ok(Self {
            edge: edge as usize,
            apron: apron as usize,
            stored: if stored >= apron { stored as usize } else { 0 },
            voxel_bytes: source.voxel_type().bytes(),
            code_bytes: contents.encoding(source, 0).format.bytes(),
            gradients,
        })
    }

    pub(crate) fn has_stored(&self) -> bool {
        self.stored > 0
    }

    /// Shape of the stored aprons; empty if there are none.
    pub(crate) fn stored_apron(&self) -> Apron {
        Apron { edge: self.edge as u32, width: self.stored as u32 }
    }

    pub(crate) fn padded(&self) -> usize {
        self.edge + 2 * self.apron
    }

    pub(crate) fn padded_voxels(&self) -> usize {
        self.padded().pow(3)
    }

    pub(crate) fn padded_code_bytes(&self) -> usize {
        self.padded_voxels() * self.code_bytes
    }

    /// Bytes of a padded brick: voxel codes, then gradients.
    pub(crate) fn padded_bytes(&self) -> usize {
        self.padded_code_bytes() + self.gradients.bytes()
    }

    pub(crate) fn core_bytes(&self) -> usize {
        self.edge.pow(3) * self.voxel_bytes
    }

    pub(crate) fn shell_bytes(&self) -> usize {
        6 * self.slab_bytes()
    }

    /// Bytes of a cached core and its stored apron, if any.
    pub(crate) fn entry_bytes(&self) -> usize {
        self.core_bytes() + self.stored_apron_bytes()
    }

    /// Bytes of a stored apron; 0 if there are none.
    pub(crate) fn stored_apron_bytes(&self) -> usize {
        self.stored_apron().voxels() * self.voxel_bytes
    }

    /// Bytes of a cached core and its share of the shells: the unit of the RAM cache's budget.
    pub(crate) fn cached_bytes(&self) -> usize {
        self.entry_bytes() + self.shells(1) * self.shell_bytes()
    }

    /// Bytes of a thread's voxel buffer for encoding; 0 where the source's voxels are codes already.
    pub(crate) fn scratch_bytes(&self, source: &dyn BrickSource) -> u64 {
        if encoding_of(source, 0).is_identity() { 0 } else { self.padded_voxels() as u64 * self.voxel_bytes as u64 }
    }

    /// Shells in a RAM cache of `cores` cores; 0 where aprons are stored.
    pub(crate) fn shells(&self, cores: usize) -> usize {
        if self.has_stored() { 0 } else { SHELLS_PER_CORE * cores }
    }

    pub(crate) fn slab_bytes(&self) -> usize {
        self.edge.pow(2) * self.apron * self.voxel_bytes
    }
}
