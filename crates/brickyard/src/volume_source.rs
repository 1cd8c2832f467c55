//! A volume as sessions take it, and what transfer functions are to know of it.

use brickyard_pager::BrickSource;
use brickyard_store::Store;
use brickyard_volume::{Extent, Geometry, SlotEncoding, Subject, TransferFunction};
use glam::DVec3;
use std::sync::Arc;

/// A volume, and the value range of its default transfer function.
#[derive(Clone)]
pub struct VolumeSource {
    /// Where its bricks come from.
    pub source: Arc<dyn BrickSource>,
    /// The range.
    pub default_window: (f64, f64),
}

impl VolumeSource {
    /// A store's, with the default window of a channel.
    pub fn of_store(store: &Arc<Store>, channel: u32) -> Self {
        Self { source: store.clone(), default_window: store.default_window(channel) }
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

    pub(crate) fn default_transfer(&self) -> TransferFunction {
        default_transfer(self.default_window, self.source.geometry(), self.extent())
    }
}

/// The window that is shown: the one given, or where that is a single value, one about it. So a volume of one value has the
/// middle of the colours and of the opacity, instead of being black.
pub fn shown_window((low, high): (f64, f64)) -> (f64, f64) {
    if low < high {
        return (low, high);
    }
    let reach = low.abs().max(1.0) / 2.0;
    (low - reach, low + reach)
}

/// What a volume is to a transfer function. The presets' distance is a hundredth of its longest side.
pub fn subject(geometry: &Geometry, extent: Extent, window: (f64, f64)) -> Subject {
    let (low, high) = geometry.world_box(extent);
    let size = high - low;
    Subject {
        window: shown_window(window),
        unit_distance: size.max_element() / 100.0,
        cell_length: size.length() / (extent.volume() as f64).cbrt(),
        mean_spacing: geometry.spacing.element_sum() / 3.0,
    }
}

pub(crate) fn default_transfer(window: (f64, f64), geometry: &Geometry, extent: Extent) -> TransferFunction {
    let subject = subject(geometry, extent, window);
    TransferFunction::preset("gray", subject.window, subject.unit_distance).expect("'gray' is a preset")
}
