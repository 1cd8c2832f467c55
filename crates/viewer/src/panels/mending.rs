//! Adapts the rest of a scene to a choice, dropping everything the new mode cannot have and adding everything it needs, so that every mode is one
//! click away.

use brickyard::session::VolumeSource;
use brickyard::volume::{
    Expression, Isosurface, LightingModel, Method, Mode, PixelSamples, Scene, SceneExpression, SceneLayer,
};

/// Switches a scene to another mode. Projections have neither light nor surfaces nor translucent meshes; slices are projections; sampling methods are
/// for fog; and surfaces start in the middle of the window.
pub(crate) fn set_mode(scene: &mut Scene, volumes: &[VolumeSource], mode: Mode) {
    let had_light = !scene.mode.is_projection() || scene.lighting.model != LightingModel::None;
    // Projections show plain values; leaving them restores the initial look.
    if mode.is_projection() {
        scene.pixel_samples = PixelSamples::ONE;
    } else if scene.mode.is_projection() {
        scene.pixel_samples = PixelSamples::FOUR;
    }
    scene.mode = mode;
    if mode == Mode::Dvr && !had_light {
        // The initial look of fog.
        set_light(scene, LightingModel::Phong);
    }
    if mode != Mode::Dvr {
        scene.sampling.method = Method::Udvr;
    }
    if mode.is_projection() {
        scene.layers.iter_mut().for_each(|layer| layer.isosurfaces.clear());
        scene.meshes.iter_mut().filter(|mesh| mesh.opacity > 0.0).for_each(|mesh| mesh.opacity = 1.0);
        set_light(scene, LightingModel::None);
    } else {
        scene.slice = None;
    }
    let has_surface = scene.layers.iter().any(|layer| layer.visible && !layer.isosurfaces.is_empty());
    if mode == Mode::Isosurface && !has_surface {
        add_surfaces(scene, volumes, 0);
    }
}

/// Adds a surface in the middle of the window to each eligible layer from `first` on.
pub(crate) fn add_surfaces(scene: &mut Scene, volumes: &[VolumeSource], first: usize) {
    for i in first..scene.layers.len() {
        let volume = volumes.get(scene.store(i)).filter(|volume| !volume.source.is_labels());
        let layer = &mut scene.layers[i];
        let Some(volume) = volume.filter(|_| layer.isosurfaces.is_empty()) else { continue };
        layer.isosurfaces = vec![Isosurface::at(middle(layer, volume))];
    }
}

/// The middle of a layer's window.
pub(crate) fn middle(layer: &SceneLayer, volume: &VolumeSource) -> f64 {
    let [low, high] = layer.window.unwrap_or_else(|| volume.subject(layer.channel).window.into());
    0.5 * (low + high)
}

/// Removes lent surfaces. A layer with other or more surfaces keeps them all.
pub(crate) fn take_surfaces(scene: &mut Scene, lent: &[Isosurface]) {
    for layer in &mut scene.layers {
        let is_lent = matches!(&layer.isosurfaces[..], [only] if lent.contains(only));
        layer.isosurfaces.retain(|_| !is_lent);
    }
    drop_idle_lights(scene);
}

/// Shows an expression in the place of the layers, or the layers again. An expression has its own look, so the layers lose theirs; the layers it
/// reads become visible.
pub(crate) fn set_expression(scene: &mut Scene, volumes: &[VolumeSource], text: Option<String>) {
    let Some(text) = text else {
        scene.expression = None;
        return;
    };
    if scene.mode != Mode::Dvr {
        set_mode(scene, volumes, Mode::Dvr);
    }
    scene.sampling.method = Method::Udvr;
    let read =
        Expression::parse(&text, scene.layers.len()).map_or_else(|_| Vec::new(), |expression| expression.volumes());
    for (i, layer) in scene.layers.iter_mut().enumerate() {
        let SceneLayer { source, channel, world_from_volume, crop, visible, .. } = layer.clone();
        let visible = visible || read.contains(&i);
        *layer = SceneLayer { source, channel, world_from_volume, crop, visible, ..SceneLayer::default() };
    }
    drop_idle_lights(scene);
    let transfer = scene.expression.take().and_then(|before| before.transfer);
    scene.expression = Some(SceneExpression { text, transfer });
}

pub(crate) fn set_light(scene: &mut Scene, model: LightingModel) {
    scene.lighting.model = model;
    drop_idle_lights(scene);
}

/// Removes lights without anything to light.
pub(crate) fn drop_idle_lights(scene: &mut Scene) {
    let has_surfaces = scene.layers.iter().any(|layer| !layer.isosurfaces.is_empty());
    if scene.lighting.model == LightingModel::None && !has_surfaces {
        scene.lighting.lights.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use brickyard::volume::{MeshLook, Slice};
    use glam::DVec3;

    #[test]
    fn every_mode_is_one_choice_away_from_every_other() {
        let volumes = fixture::volumes();
        for from in Mode::ALL {
            for to in Mode::ALL {
                let mut scene = fixture::scene();
                set_mode(&mut scene, &volumes, from);
                if from == Mode::Dvr {
                    scene.sampling.method = Method::Pcvs;
                }
                if from.is_projection() {
                    scene.slice = Some(Slice::across(2, 3.0));
                } else {
                    set_light(&mut scene, LightingModel::Phong);
                    scene.lighting.lights = vec![DVec3::ONE];
                    scene.meshes = vec![MeshLook { opacity: 0.5, ..fixture::mesh() }];
                }
                fixture::check(&scene, &volumes);
                set_mode(&mut scene, &volumes, to);
                assert_eq!(scene.mode, to);
                fixture::check(&scene, &volumes);
            }
        }
    }

    #[test]
    fn a_light_goes_with_what_it_lights() {
        let mut scene = fixture::scene();
        set_light(&mut scene, LightingModel::Tone);
        scene.lighting.lights = vec![DVec3::ONE];
        set_light(&mut scene, LightingModel::None);
        assert!(scene.lighting.lights.is_empty());
    }
}
