//! Volumes that are shown over one another and have the same shape, but voxels of other sizes: so they are drawn at unlike sizes. It may be meant; mostly one of
//! them has lost its spacing on its way through some file. So it is said, with the map that draws both alike.

use crate::volume_source::VolumeSource;
use brickyard_volume::numbers::significant;
use brickyard_volume::{Extent, Geometry, Placement, Scene};
use glam::DVec3;

/// By how much voxels may differ in size: as files round it.
const ROUNDING: f64 = 1e-3;

/// Two volumes of one shape that are drawn at unlike sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct UnlikeSizes {
    /// The volumes' names.
    pub names: [String; 2],
    /// The sizes of their voxels in the scene's world, along the volumes' axes.
    pub spacings: [DVec3; 2],
    /// The number of voxels along each axis, of both.
    pub extent: Extent,
    /// The layer of the second volume.
    pub layer: usize,
    /// The rows of the map that draws the second volume where the first one is.
    pub rows: [[f64; 4]; 3],
}

/// The first two volumes of a scene that are drawn at unlike sizes, though they have the same shape; `None` if there are none. Volumes that the scene itself places
/// are where they should be.
pub fn unlike_sizes(scene: &Scene, volumes: &[VolumeSource]) -> Option<UnlikeSizes> {
    let is_placed = |layer: usize| !scene.layers[layer].world_from_volume.is_identity();
    let shown = (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible && !is_placed(layer));
    let shown: Vec<(usize, &VolumeSource)> =
        shown.filter_map(|layer| Some((layer, volumes.get(scene.store(layer))?))).collect();
    let pairs = shown.iter().enumerate().flat_map(|(i, one)| shown[i + 1..].iter().map(move |other| (one, other)));
    pairs.into_iter().find_map(|(&(first, one), &(layer, other))| {
        let spacing = |volume: &VolumeSource| volume.place().placement.placed(volume.source.geometry()).spacing;
        let spacings = [one, other].map(spacing);
        let ratio = spacings[1] / spacings[0];
        if one.extent() != other.extent() || (ratio - 1.0).abs().max_element() <= ROUNDING {
            return None;
        }
        let name = |layer: usize, volume: &VolumeSource| volume.name().unwrap_or_else(|| format!("layer {layer}"));
        let names = [name(first, one), name(layer, other)];
        Some(UnlikeSizes { names, spacings, extent: one.extent(), layer, rows: onto(one, other) })
    })
}

/// The rows of the map from the world of `other` to that of `one` that brings voxels to voxels.
fn onto(one: &VolumeSource, other: &VolumeSource) -> [[f64; 4]; 3] {
    let (to, from): ((&Geometry, Placement), (&Geometry, Placement)) =
        ((one.source.geometry(), one.place().placement), (other.source.geometry(), other.place().placement));
    let map = |point: DVec3| {
        let voxel = from.0.voxel_from_world(from.1.volume_from_world(point));
        to.1.world_from_volume(to.0.world_from_voxel(voxel))
    };
    let origin = map(DVec3::ZERO);
    let columns = DVec3::AXES.map(|axis| map(axis) - origin);
    std::array::from_fn(|row| [columns[0][row], columns[1][row], columns[2][row], origin[row]])
}

impl UnlikeSizes {
    /// The numbers of the rows in words, without noise in their last digits.
    pub fn numbers(&self) -> [[String; 4]; 3] {
        self.rows.map(|row| row.map(|number| significant(number, 12)))
    }
}

impl std::fmt::Display for UnlikeSizes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [one, other] = &self.names;
        let [x, y, z] = self.extent.to_array();
        let [a, b] = self.spacings.map(|spacing| spacing.to_array().map(|size| significant(size, 5)).join(" x "));
        write!(
            f,
            "{one} and {other} both have {x} x {y} x {z} voxels, but those of {one} are {a} large and those of {other} {b}, so they are drawn at \
             unlike sizes"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_pager::{BrickError, BrickSource};
    use brickyard_volume::{BrickId, Pyramid, SceneLayer, VoxelType};
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
        let geometry = Geometry { spacing, origin: DVec3::new(1.0, 2.0, 3.0), unit: None };
        VolumeSource::new(Arc::new(Nothing(Pyramid::new(Extent::from_array(extent), [1.0; 3], 8), geometry)))
            .named(name)
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
            "ct and mask both have 16 x 24 x 32 voxels, but those of ct are 0.5 x 0.5 x 2 large and those of mask 1 x 1 x 1, so they are \
             drawn at unlike sizes"
        );
        assert_eq!(found.layer, 1);
        assert_eq!(found.numbers().map(|row| row.join(" ")), ["0.5 0 0 0.5", "0 0.5 0 1", "0 0 2 -3"]);
        // With it both are of one size and in one place, and nothing more is said.
        let mut mended = scene.clone();
        mended.layers[1].world_from_volume = Placement::from_rows(&found.rows).expect("a map");
        let world_box = |layer| {
            let placed = mended.placement(layer, &volumes[layer].place()).expect("a map");
            placed.world_box(volumes[layer].place().own_box)
        };
        assert_eq!(world_box(0), world_box(1));
        assert_eq!(unlike_sizes(&mended, &volumes), None);
        // What is hidden lies over nothing.
        let mut hidden = scene;
        hidden.layers[0].visible = false;
        assert_eq!(unlike_sizes(&hidden, &volumes), None);
    }
}
