//! The order of an array's axes, as letters slowest first (`tczyx`, like the shape in NumPy).

use brickyard_volume::{Extent, counted};
use std::fmt::Write;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    T,
    C,
    Z,
    Y,
    X,
}

impl Axis {
    pub(crate) fn letter(self) -> char {
        match self {
            Self::T => 't',
            Self::C => 'c',
            Self::Z => 'z',
            Self::Y => 'y',
            Self::X => 'x',
        }
    }

    /// Place among a plane's step, channel and slice.
    fn place(self) -> usize {
        match self {
            Self::T => 0,
            Self::C => 1,
            _ => 2,
        }
    }
}

/// Order of an array's axes, slowest first. Each axis occurs at most once, x and y always. A missing axis has size 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AxisOrder(Vec<Axis>);

impl AxisOrder {
    /// Returns the usual order for an array of `dimensions` dimensions: `yx` for 2 and `zyx` for 3. `None` for other
    /// numbers, whose order is ambiguous.
    pub(crate) fn usual(dimensions: usize) -> Option<Self> {
        match dimensions {
            2 => Some(Self(vec![Axis::Y, Axis::X])),
            3 => Some(Self(vec![Axis::Z, Axis::Y, Axis::X])),
            _ => None,
        }
    }

    /// Creates an order from valid axes, slowest first: no duplicates, x and y among them.
    pub(crate) fn of(axes: &[Axis]) -> Self {
        Self(axes.to_vec())
    }

    /// Returns the axes in reverse order, for arrays in Fortran order.
    pub(crate) fn reversed(mut self) -> Self {
        self.0.reverse();
        self
    }

    pub(crate) fn axes(&self) -> &[Axis] {
        &self.0
    }
}

impl Default for AxisOrder {
    fn default() -> Self {
        Self(vec![Axis::T, Axis::C, Axis::Z, Axis::Y, Axis::X])
    }
}

impl std::str::FromStr for AxisOrder {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let refuse = |why: String| {
            format!("axes '{s}': {why}; expected letters of t, c, z, y, x, slowest first, such as zyx or tczyx")
        };
        let mut axes = Vec::new();
        for letter in s.chars() {
            let Some(axis) = Self::default().0.into_iter().find(|axis| axis.letter() == letter.to_ascii_lowercase())
            else {
                return Err(refuse(format!("'{letter}' is not an axis")));
            };
            if axes.contains(&axis) {
                return Err(refuse(format!("'{letter}' stands twice")));
            }
            axes.push(axis);
        }
        if !axes.contains(&Axis::X) || !axes.contains(&Axis::Y) {
            return Err(refuse("x or y is missing".into()));
        }
        Ok(Self(axes))
    }
}

impl std::fmt::Display for AxisOrder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|axis| f.write_char(axis.letter()))
    }
}

/// Sizes of an array along its five axes, in voxels, channels and time steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub(crate) extent: Extent,
    pub(crate) channels: u32,
    pub(crate) times: u32,
}

impl Sizes {
    pub(crate) fn of(self, axis: Axis) -> u32 {
        match axis {
            Axis::T => self.times,
            Axis::C => self.channels,
            Axis::Z => self.extent.z,
            Axis::Y => self.extent.y,
            Axis::X => self.extent.x,
        }
    }

    /// Creates sizes in the order of `axes`. Other axes have size 1.
    pub(crate) fn from_ordered(axes: &[Axis], sizes: &[u32]) -> Self {
        let size = |axis| axes.iter().position(|&a| a == axis).map_or(1, |i| sizes[i]);
        Self {
            extent: Extent::new(size(Axis::X), size(Axis::Y), size(Axis::Z)),
            channels: size(Axis::C),
            times: size(Axis::T),
        }
    }

    /// Number of planes along z, c and t.
    pub(crate) fn planes(self) -> u64 {
        (self.extent.z as u64).saturating_mul(self.channels as u64).saturating_mul(self.times as u64)
    }

    /// Returns a plane's number along `axes` (of t, c, z), slowest first. A plane is given by its step, channel and slice.
    pub(crate) fn number_of(self, plane: [u32; 3], axes: &[Axis]) -> u64 {
        axes.iter().fold(0, |number, axis| number * self.of(*axis) as u64 + plane[axis.place()] as u64)
    }

    /// Returns the plane of a number along `axes` (of t, c, z), slowest first.
    pub(crate) fn plane_of(self, mut number: u64, axes: &[Axis]) -> [u32; 3] {
        let mut plane = [0; 3];
        for &axis in axes.iter().rev() {
            let size = self.of(axis) as u64;
            plane[axis.place()] = (number % size) as u32;
            number /= size;
        }
        plane
    }

    /// Returns the array's bytes. The error names a size of 0, or reports an array beyond 2^63 bytes.
    pub(crate) fn checked_bytes(self, element_bytes: usize) -> Result<u64, String> {
        let Sizes { extent, channels, times } = self;
        let all = [extent.x, extent.y, extent.z, channels, times];
        if all.contains(&0) {
            let [channels, times] =
                [(channels, "channel"), (times, "time step")].map(|(count, name)| counted(count.into(), name));
            return Err(format!(
                "shape {extent} with {channels} and {times} has an axis of size 0; every axis needs at least 1"
            ));
        }
        let too_many = || {
            let [channels, times] =
                [(channels, "channel"), (times, "time step")].map(|(count, name)| counted(count.into(), name));
            format!(
                "shape {extent} with {channels} and {times} of {element_bytes}-byte voxels is more than 2^63 bytes; check \
                 the shape"
            )
        };
        let volume = extent.checked_volume().ok_or_else(too_many)?;
        [channels as u64, times as u64, element_bytes as u64]
            .into_iter()
            .try_fold(volume, u64::checked_mul)
            .filter(|&bytes| bytes <= i64::MAX as u64)
            .ok_or_else(too_many)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_round_trip_and_nonsense_is_refused() {
        for good in ["zyx", "tczyx", "xyz", "yx", "ctxyz"] {
            assert_eq!(good.parse::<AxisOrder>().unwrap().to_string(), good);
        }
        for (bad, why) in [("zyw", "'w'"), ("zzyx", "twice"), ("tz", "missing"), ("", "missing")] {
            assert!(bad.parse::<AxisOrder>().unwrap_err().contains(why), "{bad}");
        }
    }

    #[test]
    fn zero_axes_and_overflow_are_refused() {
        let sizes = |x, y, z, channels, times| Sizes { extent: Extent::new(x, y, z), channels, times };
        assert_eq!(sizes(2, 3, 5, 7, 11).checked_bytes(4), Ok(2 * 3 * 5 * 7 * 11 * 4));
        assert!(sizes(2, 0, 5, 1, 1).checked_bytes(1).unwrap_err().contains("2,0,5"));
        assert!(sizes(u32::MAX, u32::MAX, 4, 1, 1).checked_bytes(1).unwrap_err().contains("2^63"));
        assert!(sizes(1 << 21, 1 << 21, 1 << 20, 1, 1).checked_bytes(4).unwrap_err().contains("2^63"));
    }
}
