//! Place of a volume in the world: spacing, origin, units, and the transforms between voxel and world space.

use crate::space::Extent;
use crate::units::{LengthUnit, degree_of_text};
use glam::{BVec3, DVec3};
use serde::{Deserialize, Serialize};

/// Spacing, origin and units of a volume's level 0. Coarser levels follow from their factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geometry {
    /// World distance between neighbouring voxel centres; positive.
    pub spacing: DVec3,
    /// World position of the **centre** of voxel (0, 0, 0), as in VTK, ITK, NIfTI and DICOM.
    pub origin: DVec3,
    /// UDUNITS name of the world's unit of length (`micrometer`, `millimeter`); `None` where the source gave none, and where `axis_units` are.
    pub unit: Option<String>,
    /// Units of x, y and z where these are not one unit of length (`degree`, `degree`, `hPa`); one of an axis without a unit is empty.
    /// Lengths among them are in one unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis_units: Option<[String; 3]>,
}

impl Default for Geometry {
    fn default() -> Self {
        Self { spacing: DVec3::ONE, origin: DVec3::ZERO, unit: None, axis_units: None }
    }
}

impl Geometry {
    /// Takes the units of x, y and z, by name or symbol, in which spacing and origin are so far. Lengths are converted to the first one's unit;
    /// other units are kept as they are, degrees by one name.
    pub fn take_units(&mut self, units: [&str; 3]) {
        let lengths = units.map(LengthUnit::of_text);
        let common = lengths.into_iter().flatten().next();
        for axis in 0..3 {
            if let (Some(length), Some(common)) = (lengths[axis], common) {
                self.spacing[axis] = length.convert(self.spacing[axis], common);
                self.origin[axis] = length.convert(self.origin[axis], common);
            }
        }
        (self.unit, self.axis_units) = match common {
            Some(common) if lengths.iter().all(Option::is_some) => (Some(common.name.to_owned()), None),
            None if units.iter().all(|unit| unit.trim().is_empty()) => (None, None),
            _ => {
                let name = |axis: usize| match lengths[axis].and(common) {
                    Some(common) => common.name,
                    None => degree_of_text(units[axis]).unwrap_or(units[axis].trim()),
                };
                (None, Some([0, 1, 2].map(|axis| name(axis).to_owned())))
            }
        };
    }

    /// The unit of an axis; `None` if it has none.
    pub fn axis_unit(&self, axis: usize) -> Option<&str> {
        match &self.axis_units {
            Some(units) => Some(units[axis].as_str()).filter(|unit| !unit.is_empty()),
            None => self.unit.as_deref(),
        }
    }

    /// Whether the axes have different units, so no distance across them has a meaning.
    pub fn has_unlike_axes(&self) -> bool {
        self.axis_units.as_ref().is_some_and(|units| units.iter().any(|unit| *unit != units[0]))
    }

    /// The units in words: one, or one for each axis; `None` if there is none.
    pub fn units_in_words(&self) -> Option<String> {
        match &self.axis_units {
            Some(units) if self.has_unlike_axes() => {
                let in_words = |axis: usize| self.axis_unit(axis).unwrap_or("no unit");
                Some([0, 1, 2].map(in_words).join(", "))
            }
            Some([unit, ..]) => Some(unit.clone()),
            None => self.unit.clone(),
        }
    }

    /// World position of a continuous voxel coordinate (voxel `i` is centred at `i + 0.5`).
    pub fn world_from_voxel(&self, voxel: DVec3) -> DVec3 {
        self.origin + (voxel - 0.5) * self.spacing
    }

    /// Continuous voxel coordinate of a world position.
    pub fn voxel_from_world(&self, world: DVec3) -> DVec3 {
        (world - self.origin) / self.spacing + 0.5
    }

    /// The volume's box in the world: half a voxel past the outermost centres.
    pub fn world_box(&self, extent: Extent) -> (DVec3, DVec3) {
        let far = DVec3::new(extent.x as f64, extent.y as f64, extent.z as f64);
        (self.world_from_voxel(DVec3::ZERO), self.world_from_voxel(far))
    }

    /// Greatest rounding error in single precision of a point on a ray from `eye` inside a volume, in voxels. A point is a sum of
    /// two products, so the error is a few units in the last place (2^-24) of its largest term.
    pub fn rounding_voxels(&self, eye: DVec3, extent: Extent) -> f64 {
        let far = extent.to_array().into_iter().max().unwrap_or(0) as f64;
        8e-7 * (self.voxel_from_world(eye).abs().max_element() + far)
    }

    /// The finest effective voxel size: the smallest spacing among axes with more than one voxel. It is the unit of `--step`, and
    /// level `k`'s voxel size is this times `2^k`.
    pub fn voxel_size(&self, extent: Extent) -> f64 {
        let n = extent.to_array();
        let s = self.spacing.to_array();
        let finest = (0..3).filter(|&a| n[a] > 1).map(|a| s[a]).fold(f64::INFINITY, f64::min);
        if finest.is_finite() { finest } else { self.spacing.min_element() }
    }

    /// Spacing and first voxel centre of a level with this factor: OME-Zarr's scale and translation.
    pub fn level_placement(&self, factor: [u32; 3]) -> (DVec3, DVec3) {
        let f = DVec3::from_array(factor.map(f64::from));
        (self.spacing * f, self.origin + (f - 1.0) * 0.5 * self.spacing)
    }
}

/// The corners of a box, given its least and its greatest one: corner `i` has the greatest x, y and z where bits 0, 1 and 2 are set.
pub fn box_corners((low, high): (DVec3, DVec3)) -> [DVec3; 8] {
    std::array::from_fn(|i| DVec3::select(BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_share_one_world() {
        let g =
            Geometry { spacing: DVec3::new(0.5, 1.0, 2.0), origin: DVec3::new(10.0, -3.0, 0.0), ..Geometry::default() };
        let (scale, centre) = g.level_placement([4, 2, 1]);
        assert_eq!(scale, DVec3::new(2.0, 2.0, 2.0));
        // The first voxel of the coarse level covers fine voxels 0..4, 0..2, 0..1: its centre is their mean.
        assert_eq!(centre, DVec3::new(10.0 + 1.5 * 0.5, -3.0 + 0.5, 0.0));
        let p = DVec3::new(7.25, 0.0, 3.5);
        assert!((g.voxel_from_world(g.world_from_voxel(p)) - p).length() < 1e-12);
        assert_eq!(g.world_box(Extent::new(2, 1, 1)).0, DVec3::new(9.75, -3.5, -1.0));
    }

    #[test]
    fn lengths_of_all_axes_are_in_the_first_ones_unit_and_other_units_stay() {
        let taken = |units: [&str; 3]| {
            let mut geometry =
                Geometry { spacing: DVec3::splat(0.3), origin: DVec3::splat(-2.0), ..Geometry::default() };
            geometry.take_units(units);
            geometry
        };
        let both = taken(["um", "micrometer", "mm"]);
        assert_eq!((both.unit.as_deref(), &both.axis_units), (Some("micrometer"), &None));
        assert_eq!((both.spacing, both.origin), (DVec3::new(0.3, 0.3, 300.0), DVec3::new(-2.0, -2.0, -2000.0)));
        let map = taken(["degree", " degree", "hPa"]);
        assert_eq!((map.spacing, map.origin), (DVec3::splat(0.3), DVec3::splat(-2.0)));
        assert_eq!((map.unit.as_deref(), map.axis_unit(1), map.axis_unit(2)), (None, Some("degree"), Some("hPa")));
        assert!(map.has_unlike_axes() && map.units_in_words().as_deref() == Some("degree, degree, hPa"));
        let map = taken(["degrees", "deg", "degrees_north"]);
        assert!(!map.has_unlike_axes() && map.axis_unit(2) == Some("degree"));
        let mixed = taken(["degree", "mm", "m"]);
        assert_eq!((mixed.spacing, mixed.axis_unit(2)), (DVec3::new(0.3, 0.3, 300.0), Some("millimeter")));
        let one = taken(["degree"; 3]);
        assert!(!one.has_unlike_axes() && one.units_in_words().as_deref() == Some("degree"));
        let part = taken(["", "s", ""]);
        assert_eq!((part.axis_unit(0), part.units_in_words().as_deref()), (None, Some("no unit, s, no unit")));
        assert_eq!((taken([""; 3]).axis_units, taken(["m"; 3]).unit.as_deref()), (None, Some("meter")));
    }

    #[test]
    fn a_single_slice_does_not_set_the_step() {
        let g = Geometry { spacing: DVec3::new(1.0, 2.0, 0.1), ..Geometry::default() };
        assert_eq!(g.voxel_size(Extent::new(64, 64, 1)), 1.0);
    }
}
