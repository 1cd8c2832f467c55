//! What commands make of a scene. A scene that comes of it can be shown: what a mode needs is added, what it cannot have is left out.

use crate::command::{Command, Look};
use brickyard::session::VolumeSource;
use brickyard::volume::{Isosurface, LightingModel, Mode, Scene, SceneLayer, TransferChoice};

/// A scene of these volumes after a command that edits it; `None` if there is no such layer.
pub(crate) fn edited(scene: &Scene, volumes: &[VolumeSource], command: &Command) -> Option<Scene> {
    let mut scene = scene.clone();
    match command {
        Command::Mode(mode) => set_mode(&mut scene, volumes, *mode),
        Command::Lit(is_lit) => {
            scene.lighting.model = if *is_lit { LightingModel::BlinnPhong } else { LightingModel::None };
        }
        Command::Time(time) => scene.time = *time,
        Command::Layer { layer, look } => set_look(scene.layers.get_mut(*layer)?, look),
        _ => {}
    }
    Some(scene)
}

/// Projections are not lit. Surfaces begin in the middle of the window.
fn set_mode(scene: &mut Scene, volumes: &[VolumeSource], mode: Mode) {
    scene.mode = mode;
    if mode.is_projection() {
        scene.lighting.model = LightingModel::None;
    }
    let has_surface = scene.layers.iter().any(|layer| !layer.isosurfaces.is_empty());
    if mode != Mode::Isosurface || has_surface {
        return;
    }
    for i in 0..scene.layers.len() {
        let Some(volume) = volumes.get(scene.store(i)) else { continue };
        let layer = &mut scene.layers[i];
        let [low, high] = layer.window.unwrap_or_else(|| volume.subject(layer.channel).window.into());
        layer.isosurfaces = vec![Isosurface::at(0.5 * (low + high))];
    }
}

fn set_look(layer: &mut SceneLayer, look: &Look) {
    match look {
        Look::Visible(is_visible) => layer.visible = *is_visible,
        Look::Window(window) => layer.window = *window,
        Look::Colors(preset) => layer.transfer = preset.as_deref().map(TransferChoice::preset),
        Look::Gamma(gamma) => layer.gamma = *gamma,
        Look::Opacity(opacity) => layer.opacity = *opacity,
        Look::Isovalue(value) => match layer.isosurfaces.first_mut() {
            Some(surface) => surface.value = *value,
            None => layer.isosurfaces.push(Isosurface::at(*value)),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_projection_is_not_lit() {
        let lit = edited(&Scene::default(), &[], &Command::Lit(true)).unwrap();
        assert_eq!(lit.lighting.model, LightingModel::BlinnPhong);
        let projected = edited(&lit, &[], &Command::Mode(Mode::Mip)).unwrap();
        assert_eq!((projected.mode, projected.lighting.model), (Mode::Mip, LightingModel::None));
    }

    #[test]
    fn looks_are_of_their_layer() {
        let scene = Scene { layers: vec![SceneLayer::default(); 2], ..Scene::default() };
        let of = |layer, look| edited(&scene, &[], &Command::Layer { layer, look });
        let hidden = of(1, Look::Visible(false)).unwrap();
        assert!(hidden.layers[0].visible && !hidden.layers[1].visible);
        assert_eq!(of(0, Look::Isovalue(7.0)).unwrap().layers[0].isosurfaces, [Isosurface::at(7.0)]);
        assert_eq!(of(2, Look::Gamma(2.0)), None);
    }
}
