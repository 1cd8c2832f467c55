//! How volumes look of which nobody has said how: fog of what is worth showing, in the light. From metadata alone.

use crate::volume_source::VolumeSource;
use brickyard_volume::{LightingModel, Mode, Scene, SceneLayer, TransferChoice};

/// Sets how a scene looks, as far as it leaves that open, for somebody who sees the volumes for the first time: in [`Mode::Dvr`] its fog is lit, and its
/// layers have the transfer function that [shows what is not background](brickyard_volume::Foreground). In other modes, which show values as they are, nothing is set.
pub fn set_first_look(scene: &mut Scene, volumes: &[VolumeSource]) {
    if scene.mode != Mode::Dvr {
        return;
    }
    if scene.lighting.model == LightingModel::None {
        scene.lighting.model = LightingModel::Phong;
    }
    if scene.expression.is_none() {
        choose_foregrounds(scene, 0, volumes);
    }
}

/// Chooses the transfer function that shows what is not background for the layers from the number `first` on, where they have no function, window or gamma. Labels have
/// colours of their own.
pub fn choose_foregrounds(scene: &mut Scene, first: usize, volumes: &[VolumeSource]) {
    for i in first..scene.layers.len() {
        let is_measured = volumes.get(scene.store(i)).is_some_and(|volume| !volume.source.is_labels());
        let layer = &mut scene.layers[i];
        let SceneLayer { transfer, window, gamma, .. } = layer;
        if is_measured && transfer.is_none() && window.is_none() && *gamma == 1.0 {
            *transfer = Some(TransferChoice::automatic());
        }
    }
}
