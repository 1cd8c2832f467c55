//! Distances between the steps and channels of a raw file, which may lie apart: behind headers, or between record markers.

use super::{ArrayLayout, RawLayout};
use crate::axes::Axis;
use brickyard_volume::counted;

/// Distances of steps and channels, from the first voxel of one to that of the next, and their sum.
pub(super) struct Spread {
    pub(super) step_bytes: u64,
    pub(super) channel_bytes: u64,
    /// Bytes from the first voxel of all to the last one's end.
    pub(super) bytes: u64,
    /// Bytes that would follow the last voxel if one more step or channel did.
    pub(super) gap_bytes: u64,
}

impl Spread {
    /// Bytes between neighbours along each axis of the array.
    pub(super) fn strides(&self, array: &ArrayLayout) -> [u64; 5] {
        let mut strides = array.strides();
        (strides[Axis::T as usize], strides[Axis::C as usize]) = (self.step_bytes, self.channel_bytes);
        strides
    }

    /// The distances in a layout: as told, otherwise without gaps.
    ///
    /// # Errors
    /// If an axis has no elements or the sum cannot be counted, or a told distance is too short, without effect, or of an axis within the volume.
    pub(super) fn of(layout: &RawLayout, array: &ArrayLayout) -> Result<Self, String> {
        array.body_bytes()?;
        let mut bytes = array.decode.element.bytes() as u64;
        // The distance of neighbours along the next axis, without a gap of its own.
        let mut period = bytes;
        let [mut step_bytes, mut channel_bytes] = [None; 2];
        let axes = array.axes.axes();
        for (place, axis) in axes.iter().enumerate().rev() {
            let (told, option) = match axis {
                Axis::T => (layout.step_bytes, "step_bytes"),
                Axis::C => (layout.channel_bytes, "channel_bytes"),
                _ => (None, ""),
            };
            let (count, stride) = (u64::from(array.sizes.of(*axis)), told.unwrap_or(period));
            if told.is_some() {
                if axes[..place].iter().any(|slower| matches!(slower, Axis::X | Axis::Y | Axis::Z)) {
                    let letter = axis.letter();
                    return Err(format!(
                        "`{option}`: in axes '{}', {letter} lies within the volume; it must stand before x, y and z",
                        array.axes
                    ));
                }
                if stride < bytes {
                    return Err(format!(
                        "`{option}` {stride}: the voxels in between have {}; give at least these",
                        counted(bytes, "byte")
                    ));
                }
            }
            let too_many = || format!("`{option}` {stride}: {count} of these are more than 2^63 bytes; check it");
            let within = |bytes: Option<u64>| bytes.filter(|bytes| *bytes <= i64::MAX as u64).ok_or_else(too_many);
            bytes = within(stride.checked_mul(count - 1).and_then(|start| start.checked_add(bytes)))?;
            period = within(stride.checked_mul(count))?;
            match axis {
                Axis::T => step_bytes = Some(stride),
                Axis::C => channel_bytes = Some(stride),
                _ => {}
            }
        }
        let idle = [
            (layout.step_bytes, array.sizes.times, "step_bytes", "times"),
            (layout.channel_bytes, array.sizes.channels, "channel_bytes", "channels"),
        ];
        if let Some((_, _, option, count)) = idle.iter().find(|(told, count, ..)| told.is_some() && *count < 2) {
            return Err(format!("`{option}` has no effect on one of them: give `{count}`, too, or leave it out"));
        }
        let whole = period;
        Ok(Self {
            step_bytes: step_bytes.unwrap_or(whole),
            channel_bytes: channel_bytes.unwrap_or(whole),
            bytes,
            gap_bytes: whole - bytes,
        })
    }
}
