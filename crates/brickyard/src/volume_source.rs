//! A store as sessions take it, and what transfer functions are to know of it.

use brickyard_pager::BrickSource;
use brickyard_store::Store;
use brickyard_volume::{Extent, SlotEncoding, StoreCounts, Subject};
use glam::DVec3;
use std::sync::Arc;

/// Where the bricks of a scene's layers come from, and the values that their default transfer functions span.
#[derive(Clone)]
pub struct VolumeSource {
    /// Where the bricks come from.
    pub source: Arc<dyn BrickSource>,
    /// The window of each channel; the source's whole range for channels past these.
    pub default_windows: Vec<(f64, f64)>,
}

impl VolumeSource {
    /// A store, with the default windows of its channels.
    pub fn of_store(store: &Arc<Store>) -> Self {
        let default_windows = (0..store.channels()).map(|channel| store.default_window(channel)).collect();
        Self { source: store.clone(), default_windows }
    }

    /// The subject of a channel's transfer function: the place, extent and window that the function is fitted to.
    pub fn subject(&self, channel: u32) -> Subject {
        Subject::new(self.source.geometry(), self.extent(), self.default_window(channel))
    }

    pub(crate) fn default_window(&self, channel: u32) -> (f64, f64) {
        self.default_windows.get(channel as usize).copied().unwrap_or_else(|| self.source.value_range())
    }

    pub(crate) fn counts(&self) -> StoreCounts {
        let levels = self.source.pyramid().levels().len();
        StoreCounts { levels, times: self.source.times(), channels: self.source.channels() }
    }

    pub(crate) fn extent(&self) -> Extent {
        self.source.pyramid().levels()[0].extent
    }

    /// The box of its own world that it fills.
    pub(crate) fn world_box(&self) -> (DVec3, DVec3) {
        self.source.geometry().world_box(self.extent())
    }

    pub(crate) fn encoding(&self) -> SlotEncoding {
        let source = &*self.source;
        SlotEncoding::new(source.voxel_type(), source.value_range(), source.has_non_finite())
    }
}
