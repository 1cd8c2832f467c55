//! The first look of volumes without a chosen one: lit fog without the background, from metadata alone.

use crate::session::volume_source::VolumeSource;
use brickyard_volume::{LightingModel, Mode, PixelSamples, Scene, SceneLayer, TransferChoice};

/// Sets a scene's look for first-time viewers, as far as the scene leaves it open. Edges are smooth: pixels have four
/// samples. In [`Mode::Dvr`] fog is lit, and layers have the [foreground's](brickyard_volume::Foreground) transfer
/// function. A single surface is light. Projections and slices show values as they are, so nothing is set.
pub fn set_first_look(scene: &mut Scene, volumes: &[VolumeSource]) {
    if scene.mode.is_projection() || scene.slice.is_some() {
        return;
    }
    if scene.pixel_samples == PixelSamples::ONE {
        scene.pixel_samples = PixelSamples::FOUR;
    }
    if scene.mode != Mode::Dvr {
        scene.layers.iter_mut().for_each(lighten_surface);
        return;
    }
    if scene.lighting.model == LightingModel::None {
        scene.lighting.model = LightingModel::Phong;
    }
    if scene.expression.is_none() {
        choose_foregrounds(scene, 0, volumes);
    }
}

/// Gives a layer's only surface a light colour, unless its colour is chosen. Several surfaces differ by the transfer
/// function's colours.
fn lighten_surface(layer: &mut SceneLayer) {
    let is_plain = layer.transfer.is_none() && layer.color.is_none();
    if let ([surface], true) = (&mut layer.isosurfaces[..], is_plain) {
        surface.color.get_or_insert(LIGHT);
    }
}

/// The default colour of surfaces: a warm white, on which shades are visible.
const LIGHT: [f64; 3] = [0.93, 0.89, 0.82];

/// Chooses the foreground's transfer function for the layers from the number `first` on, where they have no function,
/// window or gamma. Labels have their own colours.
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
