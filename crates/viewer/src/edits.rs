//! Edits of a window's state. An edit sets fields of its document and makes the scene valid: it adds everything the mode needs, drops everything it
//! cannot have, and reads newly named files.

use crate::fields::{differences, set};
use crate::panels::mending::{add_surfaces, set_mode, take_surfaces};
use crate::state::State;
use brickyard::channels::default_layers;
use brickyard::first_look::choose_foregrounds;
use brickyard::scene_file::read_named_files;
use brickyard::session::{VolumeSource, check};
use brickyard::volume::{Isosurface, Mode, Scene, TransferChoice};
use serde_json::Value;

/// The state after setting fields of its document.
///
/// # Errors
/// If a field does not exist or cannot have the value, or a file of the scene cannot be read.
pub(crate) fn edited(state: &State, volumes: &[VolumeSource], fields: &[(String, Value)]) -> Result<State, String> {
    let mut document = state.to_document().map_err(|error| error.to_string())?;
    for (field, value) in fields {
        set(&mut document, field, value.clone())?;
    }
    let mut edited = State::from_document(document).map_err(|error| error.to_string())?;
    keep_files(&mut edited.scene, &state.scene);
    read_named_files(&mut edited.scene, volumes).map_err(|error| error.to_string())?;
    edited.lent_surfaces.clone_from(&state.lent_surfaces);
    if edited.scene.mode != state.scene.mode {
        let mode = std::mem::replace(&mut edited.scene.mode, state.scene.mode);
        set_mode(&mut edited.scene, volumes, mode);
        if state.scene.mode == Mode::Isosurface {
            take_surfaces(&mut edited.scene, &edited.lent_surfaces);
        }
        edited.lent_surfaces = if mode == Mode::Isosurface { given(&state.scene, &edited.scene) } else { Vec::new() };
    }
    Ok(edited)
}

/// The surfaces of layers that had none before.
fn given(before: &Scene, after: &Scene) -> Vec<Isosurface> {
    let layers = before.layers.iter().zip(&after.layers).filter(|(before, _)| before.isosurfaces.is_empty());
    layers.flat_map(|(_, after)| after.isosurfaces.clone()).collect()
}

/// The scene with default layers for the volumes after the first `before`. Other layers stay.
///
/// # Errors
/// If the result cannot be shown.
pub(crate) fn with_more(scene: &Scene, volumes: &[VolumeSource], before: usize) -> Result<Scene, String> {
    let mut scene = scene.clone();
    let first = scene.layers.len();
    let shown = default_layers(volumes).into_iter();
    let added = shown.filter(|layer| layer.source.is_some_and(|source| source >= before));
    scene.layers.extend(added);
    if scene.expression.is_some() {
        // A layer behind an expression has no look of its own.
        for layer in &mut scene.layers[first..] {
            layer.color = None;
        }
    } else {
        choose_foregrounds(&mut scene, first, volumes);
    }
    if scene.expression.is_none() && scene.mode == Mode::Isosurface {
        add_surfaces(&mut scene, volumes, first);
    }
    check(volumes, &scene).map_err(|error| error.to_string())?;
    Ok(scene)
}

/// The fields changed by a panel.
///
/// # Errors
/// If a path in it is not text.
pub(crate) fn changes(before: &State, after: &State) -> Result<Vec<(String, Value)>, String> {
    let document = |state: &State| state.to_document().map_err(|error| error.to_string());
    Ok(differences(&document(before)?, &document(after)?))
}

/// Carries over file contents, which bypass the document.
fn keep_files(scene: &mut Scene, before: &Scene) {
    for look in scene.meshes.iter_mut().filter(|look| look.mesh.is_none()) {
        let known = before.meshes.iter().find(|known| known.path == look.path);
        look.mesh = known.and_then(|known| known.mesh.clone());
    }
    let of_expression = before.expression.iter().filter_map(|expression| expression.transfer.as_ref());
    let known = before.layers.iter().filter_map(|layer| layer.transfer.as_ref()).chain(of_expression);
    let of_expression = scene.expression.iter_mut().filter_map(|expression| expression.transfer.as_mut());
    for choice in scene.layers.iter_mut().filter_map(|layer| layer.transfer.as_mut()).chain(of_expression) {
        let TransferChoice::File(file) = choice else { continue };
        let same = known.clone().find_map(|known| match known {
            TransferChoice::File(known) if (&known.path, &known.name) == (&file.path, &file.name) => Some(known),
            _ => None,
        });
        file.function = same.and_then(|known| known.function.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use crate::state::Layout;
    use brickyard::volume::{LightingModel, MAX_VOLUMES, SceneExpression, SceneLayer};
    use serde_json::json;

    fn after(state: &State, field: &str, value: Value) -> Result<State, String> {
        edited(state, &[], &[(field.to_string(), value)])
    }

    #[test]
    fn a_projection_is_not_lit() {
        let lit = after(&State::default(), "lighting.model", json!("blinn-phong")).unwrap();
        assert_eq!(lit.scene.lighting.model, LightingModel::BlinnPhong);
        let projected = after(&lit, "mode", json!("mip")).unwrap().scene;
        assert_eq!((projected.mode, projected.lighting.model), (Mode::Mip, LightingModel::None));
    }

    #[test]
    fn a_visit_to_isosurfaces_leaves_none_behind_but_those_that_somebody_set() {
        let volumes = fixture::volumes();
        let set = |state: &State, field: &str, value: Value| {
            edited(state, &volumes, &[(field.to_string(), value)]).expect("an edit")
        };
        let fog = State { scene: fixture::scene(), ..State::default() };
        let surfaces =
            |state: &State| state.scene.layers.iter().map(|layer| layer.isosurfaces.len()).collect::<Vec<_>>();
        let visit = set(&fog, "mode", json!("isosurface"));
        assert_eq!(surfaces(&visit), [1, 1, 0]);
        assert_eq!(set(&visit, "mode", json!("dvr")).scene, fog.scene);
        // As in a panel: the mode, and its effects on the rest.
        let changes = changes(&fog, &State { lent_surfaces: Vec::new(), ..visit.clone() }).expect("changes");
        let by_panel = edited(&fog, &volumes, &changes).expect("an edit");
        assert_eq!(by_panel, visit);
        // A surface changed meanwhile is the user's.
        let changed = set(&visit, "layers.1.isosurfaces.0.value", json!(99));
        assert_eq!(surfaces(&set(&changed, "mode", json!("dvr"))), [0, 1, 0]);
        // And so is one that was there before, whatever its value.
        let middle = visit.scene.layers[0].isosurfaces.clone();
        let own = set(&fog, "layers.0.isosurfaces", json!(middle));
        let back = set(&set(&own, "mode", json!("isosurface")), "mode", json!("dvr"));
        assert_eq!(surfaces(&back), [1, 0, 0]);
    }

    #[test]
    fn fields_of_layers_and_of_the_window_are_set() {
        let scene = Scene { layers: vec![SceneLayer::default(); 2], ..Scene::default() };
        let state = State { scene, ..State::default() };
        let hidden = after(&state, "layers.1.visible", json!(false)).unwrap().scene;
        assert!(hidden.layers[0].visible && !hidden.layers[1].visible);
        let planes = after(&state, "window.layout", json!("planes")).unwrap();
        assert_eq!(planes.window.layout, Layout::Planes);
        assert!(after(&state, "layers.2.gamma", json!(2)).unwrap_err().contains("2 entries"));
        assert!(after(&state, "layers.1.gama", json!(2)).unwrap_err().contains("gama"));
        assert!(after(&state, "mode", json!("fog")).unwrap_err().contains("fog"));
    }

    #[test]
    fn more_volumes_have_layers_and_the_others_stay() {
        // One of two channels, and one of labels.
        let volumes = fixture::volumes();
        let layer = SceneLayer { window: Some([3.0, 7.0]), ..SceneLayer::default() };
        let scene = Scene { layers: vec![layer.clone(), SceneLayer::default()], ..Scene::default() };
        // The second layer shows the second volume by its index: that stays.
        let more = with_more(&scene, &[&volumes[..], &volumes[..]].concat(), 2).unwrap();
        assert_eq!(more.layers[..2], scene.layers);
        let added: Vec<_> = more.layers[2..].iter().map(|layer| (layer.source, layer.channel)).collect();
        assert_eq!(added, [(Some(2), 0), (Some(2), 1), (Some(3), 0)]);
        let measured = [volumes[0].clone(), volumes[0].clone()];
        let surfaces = Scene { mode: Mode::Isosurface, layers: vec![layer.clone()], ..Scene::default() };
        let more = with_more(&surfaces, &measured, 1).unwrap().layers;
        assert!(more[0].isosurfaces.is_empty() && more[1..].iter().all(|layer| layer.isosurfaces.len() == 1));
        let of_expression = Scene { expression: Some(SceneExpression::from("a * 2".to_string())), ..Scene::default() };
        assert_eq!(with_more(&of_expression, &measured, 1).unwrap().layers.len(), 3);
        let full = Scene { layers: vec![layer; MAX_VOLUMES], ..Scene::default() };
        let full =
            Scene { layers: full.layers.into_iter().map(|l| SceneLayer { source: Some(0), ..l }).collect(), ..full };
        assert!(with_more(&full, &measured, 1).is_err());
    }

    #[test]
    fn what_a_panel_edits_is_named_and_made_again() {
        let before = State::default();
        let mut panel = before.clone();
        panel.scene.layers[0].window = Some([2.0, 5.5]);
        panel.scene.background = [1.0, 0.5, 0.0];
        panel.window.overlays.bricks = true;
        let changes = changes(&before, &panel).unwrap();
        let names: Vec<_> = changes.iter().map(|(field, _)| field.as_str()).collect();
        assert_eq!(names, ["background", "layers.0.window", "window.overlays.bricks"]);
        assert_eq!(edited(&before, &[], &changes), Ok(panel));
    }
}
