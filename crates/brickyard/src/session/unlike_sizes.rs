//! Overlaid volumes of doubtful sizes: lengths in unlike units, where only the numbers count; or one shape, but voxels
//! of unlike sizes. It may be intended, but mostly a file has lost its spacing on its way. The user is warned, with the
//! map that draws both alike.

use crate::session::volume_source::VolumeSource;
use brickyard_volume::numbers::significant;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{Extent, Scene};
use glam::DVec3;

/// Tolerated relative difference of voxel sizes, as files round them.
const ROUNDING: f64 = 1e-3;

/// Two volumes drawn at unlike sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct UnlikeSizes {
    /// The volumes' names.
    pub names: [String; 2],
    /// The cause of the difference.
    pub cause: Cause,
    /// The layer of the second volume.
    pub layer: usize,
    /// The rows of the map that draws the second volume at the place of the first.
    pub rows: [[f64; 4]; 3],
}

/// The cause of unlike sizes of two volumes.
#[derive(Clone, Debug, PartialEq)]
pub enum Cause {
    /// Their lengths are in unlike units.
    Units {
        /// The units.
        units: [String; 2],
        /// Length of the second unit over the first.
        ratio: f64,
    },
    /// They have one shape, and voxels of unlike sizes.
    Voxels {
        /// The sizes of the voxels in the scene's world, along the volumes' axes.
        spacings: [DVec3; 2],
        /// The number of voxels along each axis, of both.
        extent: Extent,
    },
}

/// Returns the first two volumes of a scene drawn at unlike sizes, because of their units or despite equal shapes;
/// `None` if there are none. Volumes placed by the scene itself count as right.
pub fn unlike_sizes(scene: &Scene, volumes: &[VolumeSource]) -> Option<UnlikeSizes> {
    let is_placed = |layer: usize| !scene.layers[layer].world_from_volume.is_identity();
    let shown = (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible && !is_placed(layer));
    let shown: Vec<(usize, &VolumeSource)> =
        shown.filter_map(|layer| Some((layer, volumes.get(scene.store(layer))?))).collect();
    let pairs = shown.iter().enumerate().flat_map(|(i, one)| shown[i + 1..].iter().map(move |other| (one, other)));
    pairs.into_iter().find_map(|(&(first, one), &(layer, other))| {
        let name = |layer: usize, volume: &VolumeSource| volume.name().unwrap_or_else(|| format!("layer {layer}"));
        let names = [name(first, one), name(layer, other)];
        if let Some((units, ratio)) = unlike_units(one, other) {
            let rows = std::array::from_fn(|row| std::array::from_fn(|column| if row == column { ratio } else { 0.0 }));
            return Some(UnlikeSizes { names, cause: Cause::Units { units, ratio }, layer, rows });
        }
        let spacing = |volume: &VolumeSource| volume.place().placement.placed(volume.source.geometry()).spacing;
        let spacings = [one, other].map(spacing);
        let ratio = spacings[1] / spacings[0];
        if one.extent() != other.extent() || (ratio - 1.0).abs().max_element() <= ROUNDING {
            return None;
        }
        let cause = Cause::Voxels { spacings, extent: one.extent() };
        Some(UnlikeSizes { names, cause, layer, rows: onto(one, other) })
    })
}

/// Returns the units of two volumes, and the length of the second over the first; `None` if they are equal, or not both
/// known.
fn unlike_units(one: &VolumeSource, other: &VolumeSource) -> Option<([String; 2], f64)> {
    let unit = |volume: &VolumeSource| volume.source.geometry().unit.clone();
    let units = [unit(one)?, unit(other)?];
    let [one, other] = [&units[0], &units[1]].map(|unit| LengthUnit::named(unit));
    let ratio = other?.metres() / one?.metres();
    ((ratio - 1.0).abs() > 1e-9).then_some((units, ratio))
}

/// Returns the rows of the map from the world of `other` to the world of `one` that brings voxels to voxels.
fn onto(one: &VolumeSource, other: &VolumeSource) -> [[f64; 4]; 3] {
    let map = |point: DVec3| {
        let voxel = other.source.geometry().voxel_from_world(other.place().placement.volume_from_world(point));
        one.place().placement.world_from_volume(one.source.geometry().world_from_voxel(voxel))
    };
    let origin = map(DVec3::ZERO);
    let columns = DVec3::AXES.map(|axis| map(axis) - origin);
    std::array::from_fn(|row| [columns[0][row], columns[1][row], columns[2][row], origin[row]])
}

impl UnlikeSizes {
    /// The rows' numbers as text, without noise in the last digits.
    pub fn numbers(&self) -> [[String; 4]; 3] {
        self.rows.map(|row| row.map(|number| significant(number, 12)))
    }
}

impl std::fmt::Display for UnlikeSizes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [one, other] = &self.names;
        let (spacings, extent) = match &self.cause {
            Cause::Units { units: [a, b], ratio } => {
                let (times, size) = if *ratio > 1.0 { (*ratio, "small") } else { (1.0 / ratio, "large") };
                let times = significant(times, 5);
                return write!(
                    f,
                    "lengths of {one} are in {a} and those of {other} in {b}, but units are not converted, so {other} \
                     is drawn {times} times too {size}"
                );
            }
            Cause::Voxels { spacings, extent } => (spacings, extent),
        };
        let [x, y, z] = extent.to_array();
        let [a, b] = spacings.map(|spacing| spacing.to_array().map(|size| significant(size, 5)).join(" x "));
        write!(
            f,
            "{one} and {other} both have {x} x {y} x {z} voxels, but those of {one} are {a} large and those of {other} \
             {b}, so they are drawn at different sizes"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_pager::{BrickError, BrickSource};
    use brickyard_volume::{BrickId, Geometry, Placement, Pyramid, SceneLayer, VoxelType};
    use std::sync::Arc;

    struct Nothing(Pyramid, Geometry);

    impl BrickSource for Nothing {
        fn pyramid(&self) -> &Pyramid {
            &self.0
        }
        fn geometry(&self) -> &Geometry {
            &self.1
        }
        fn voxel_type(&self) -> VoxelType {
            VoxelType::U8
        }
        fn value_range(&self) -> (f64, f64) {
            (0.0, 1.0)
        }
        fn read_core(&self, _: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
            out.fill(0);
            Ok(())
        }
    }

    fn volume(name: &str, extent: [u32; 3], spacing: [f64; 3]) -> VolumeSource {
        let spacing = DVec3::from_array(spacing);
        let geometry = Geometry { spacing, origin: DVec3::new(1.0, 2.0, 3.0), ..Geometry::default() };
        VolumeSource::new(Arc::new(Nothing(Pyramid::new(Extent::from_array(extent), [1.0; 3], 8), geometry)))
            .named(name)
    }

    #[test]
    fn units_of_length_that_differ_are_named_with_what_mends_them() {
        let of_unit = |name: &str, unit: Option<&str>, spacing: f64| {
            let geometry =
                Geometry { spacing: DVec3::splat(spacing), unit: unit.map(str::to_owned), ..Geometry::default() };
            VolumeSource::new(Arc::new(Nothing(Pyramid::new(Extent::new(16, 16, 16), [1.0; 3], 8), geometry)))
                .named(name)
        };
        let scene = Scene { layers: vec![SceneLayer::default(); 2], ..Scene::default() };
        let said = |one, other| unlike_sizes(&scene, &[one, other]).map(|found| (found.to_string(), found.rows[2][2]));
        let (millimetres, micrometres) =
            (of_unit("a", Some("millimeter"), 1.0), of_unit("b", Some("micrometer"), 1000.0));
        let (words, scale) = said(millimetres.clone(), micrometres.clone()).expect("unlike units");
        assert!(words.contains("b is drawn 1000 times too large") && (scale - 1e-3).abs() < 1e-15, "{words}");
        let (words, scale) = said(micrometres, millimetres.clone()).expect("unlike units");
        assert!(words.contains("a is drawn 1000 times too small") && (scale - 1e3).abs() < 1e-9, "{words}");
        assert_eq!(said(millimetres.clone(), of_unit("b", Some("millimeter"), 1.0)), None);
        assert_eq!(said(millimetres, of_unit("b", None, 1.0)), None);
    }

    #[test]
    fn stores_of_one_shape_and_unlike_voxels_are_named_with_what_mends_it() {
        let volumes = [
            volume("ct", [16, 24, 32], [0.5, 0.5, 2.0]),
            volume("mask", [16, 24, 32], [1.0, 1.0, 1.0]),
            volume("pet", [8, 12, 16], [1.0, 1.0, 4.0]),
        ];
        let scene = Scene { layers: vec![SceneLayer::default(); 3], ..Scene::default() };
        let found = unlike_sizes(&scene, &volumes).expect("ct and mask");
        assert_eq!(
            found.to_string(),
            "ct and mask both have 16 x 24 x 32 voxels, but those of ct are 0.5 x 0.5 x 2 large and those of mask 1 x \
             1 x 1, so they are drawn at different sizes"
        );
        assert_eq!(found.layer, 1);
        assert_eq!(found.numbers().map(|row| row.join(" ")), ["0.5 0 0 0.5", "0 0.5 0 1", "0 0 2 -3"]);
        // With it both have one size and place, and no warning is left.
        let mut mended = scene.clone();
        mended.layers[1].world_from_volume = Placement::from_rows(&found.rows).expect("a map");
        let world_box = |layer| {
            let placed = mended.placement(layer, &volumes[layer].place()).expect("a map");
            placed.world_box(volumes[layer].place().own_box)
        };
        assert_eq!(world_box(0), world_box(1));
        assert_eq!(unlike_sizes(&mended, &volumes), None);
        // A hidden layer covers nothing.
        let mut hidden = scene;
        hidden.layers[0].visible = false;
        assert_eq!(unlike_sizes(&hidden, &volumes), None);
    }
}
