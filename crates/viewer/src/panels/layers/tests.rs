use super::*;
use crate::panels::fixture;
use brickyard::volume::{Isosurface, Mode, SceneExpression, TransferChoice};
use eframe::egui::accesskit::Role as Kind;
use eframe::egui::{Key, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

fn harness<'a>(scene: Scene) -> Harness<'a, Scene> {
    let volumes = fixture::volumes();
    let mut before = scene.clone();
    let show = move |ui: &mut Ui, scene: &mut Scene| {
        show(ui, scene, &volumes, Some(5), &mut Vec::new());
        if *scene != before {
            fixture::check(scene, &volumes);
            before = scene.clone();
        }
    };
    Harness::builder().with_size(vec2(276.0, 2400.0)).build_ui_state(show, scene)
}

/// The fixture's scene after opening its second layer and some clicks.
fn clicked(scene: Scene, names: &[&str]) -> Scene {
    let mut harness = harness(scene);
    harness.get_by_label("open layer 1").click();
    harness.run();
    for name in names {
        harness.get_by_label(name).click();
        harness.run();
    }
    harness.state().clone()
}

fn typed(harness: &mut Harness<'_, Scene>, (label, place): (&str, usize), text: &str) {
    let field = |harness: &Harness<'_, Scene>| {
        harness.get_all_by_role_and_label(Kind::SpinButton, label).nth(place).expect("a number").focus();
    };
    field(harness);
    harness.run();
    harness.get_all_by_role_and_label(Kind::SpinButton, label).nth(place).expect("a number").type_text(text);
    harness.run();
    harness.key_press(Key::Enter);
    harness.run();
}

#[test]
fn a_layer_is_hidden_but_not_the_last_one() {
    let mut harness = harness(fixture::scene());
    for (layer, expected) in [(0, [false, true, true]), (2, [false, true, false]), (1, [false, true, false])] {
        harness.get_by_role_and_label(Kind::CheckBox, &format!("layer {layer}")).click();
        harness.run();
        let shown: Vec<_> = harness.state().layers.iter().map(|layer| layer.visible).collect();
        assert_eq!(shown, expected);
    }
}

#[test]
fn a_layer_is_shown_alone_and_with_all_others_again() {
    let mut harness = harness(fixture::scene());
    for expected in [[false, true, false], [true; 3]] {
        harness.get_by_label("layer 1 alone").click();
        harness.run();
        let shown: Vec<_> = harness.state().layers.iter().map(|layer| layer.visible).collect();
        assert_eq!(shown, expected);
    }
}

#[test]
fn layers_keep_their_volumes_wherever_they_go() {
    let scene = || Scene {
        layers: [0.1, 0.2].map(|opacity| SceneLayer { opacity, ..SceneLayer::default() }).to_vec(),
        ..Scene::default()
    };
    let after = |layer, change| {
        let (mut scene, mut open) = (scene(), vec![true, false]);
        rearrange(&mut scene, layer, change, &mut open);
        let shown: Vec<_> =
            (0..scene.layers.len()).map(|i| (scene.layers[i].opacity, scene.store(i), open[i])).collect();
        (shown, scene.layers.iter().map(|layer| layer.source).collect::<Vec<_>>())
    };
    let (up, sources) = after(1, Change::Up);
    assert_eq!((up, sources), (vec![(0.2, 1, false), (0.1, 0, true)], vec![Some(1), Some(0)]));
    assert_eq!(after(0, Change::Down), after(1, Change::Up));
    let (copied, sources) = after(0, Change::Duplicate);
    assert_eq!(copied, [(0.1, 0, true), (0.1, 0, true), (0.2, 1, false)]);
    assert_eq!(sources, [None, Some(0), Some(1)]);
    assert_eq!(after(0, Change::Remove), (vec![(0.2, 1, false)], vec![Some(1)]));
}

#[test]
fn what_is_left_is_shown() {
    let mut scene = fixture::scene();
    scene.layers[0].visible = false;
    scene.layers[2].visible = false;
    rearrange(&mut scene, 1, Change::Remove, &mut vec![false; 3]);
    assert!(scene.layers.iter().all(|layer| layer.visible));
}

#[test]
fn a_menu_moves_a_layer() {
    let mut harness = harness(fixture::scene());
    harness.state_mut().layers[1].opacity = 0.5;
    harness.get_by_label("more of layer 1").click();
    harness.run();
    harness.get_by_label("move up").click();
    harness.run();
    assert_eq!(harness.state().layers[0].opacity, 0.5);
}

#[test]
fn windows_are_chosen_and_typed() {
    let scene = clicked(fixture::scene(), &["full"]);
    assert_eq!(scene.layers.iter().map(|layer| layer.window).collect::<Vec<_>>(), [None, Some([0.0, 255.0]), None]);
    assert_eq!(clicked(scene, &["auto"]).layers[1].window, None);
    let mut harness = harness(fixture::scene());
    harness.get_by_label("open layer 1").click();
    harness.run();
    typed(&mut harness, ("window", 0), "40");
    typed(&mut harness, ("window", 1), "120.5");
    assert_eq!(harness.state().layers[1].window, Some([40.0, 120.5]));
    typed(&mut harness, ("window", 1), "7");
    let [low, high] = harness.state().layers[1].window.expect("a window");
    assert!(low < high, "a window that is the wrong way round is not taken: {low} {high}");
}

#[test]
fn a_function_with_values_of_its_own_has_them_as_its_window() {
    let volume = fixture::volumes().swap_remove(0);
    let layer = SceneLayer { transfer: Some(TransferChoice::preset("ct-bone")), ..SceneLayer::default() };
    assert_eq!(style::shown(&layer, &volume), [150.0, 1600.0]);
    assert_eq!(style::shown(&SceneLayer { window: Some([0.0, 9.0]), ..layer }, &volume), [0.0, 9.0]);
    assert_eq!(style::shown(&SceneLayer::default(), &volume), [0.0, 255.0]);
}

#[test]
fn colours_are_chosen_from_their_pictures() {
    let mut harness = harness(fixture::scene());
    harness.state_mut().layers[1].color = Some([1.0, 0.0, 0.0]);
    harness.get_by_label("open layer 1").click();
    harness.run();
    harness.get_by_role_and_label(Kind::ComboBox, "colours").click();
    harness.run();
    harness.get_by_label("viridis").click();
    harness.run();
    let layer = &harness.state().layers[1];
    assert_eq!((&layer.transfer, layer.color), (&Some(TransferChoice::preset("viridis")), None));
}

#[test]
fn numbers_are_typed() {
    let mut harness = harness(fixture::scene());
    harness.get_by_label("open layer 1").click();
    harness.run();
    typed(&mut harness, ("gamma", 0), "2.5");
    typed(&mut harness, ("opacity", 0), "0.25");
    let layer = &harness.state().layers[1];
    assert_eq!((layer.gamma, layer.opacity), (2.5, 0.25));
}

#[test]
fn surfaces_are_added_up_to_eight_and_not_in_projections() {
    let mut names = vec!["isosurfaces"];
    names.extend(["add a surface"; 9]);
    let scene = clicked(fixture::scene(), &names);
    assert_eq!(scene.layers[1].isosurfaces.len(), 8);
    let projection = Scene { mode: Mode::Mip, ..fixture::scene() };
    assert!(clicked(projection, &names[..2]).layers[1].isosurfaces.is_empty());
    let mut last = Scene { mode: Mode::Isosurface, ..fixture::scene() };
    last.layers[1].isosurfaces = vec![Isosurface::at(9.0)];
    let kept = clicked(last, &["isosurfaces", "remove"]);
    assert_eq!(kept.layers[1].isosurfaces.len(), 1, "mode isosurface needs it");
}

#[test]
fn a_crop_is_switched_on_over_everything() {
    let mut harness = harness(fixture::scene());
    harness.get_by_label("open layer 1").click();
    harness.run();
    harness.get_by_label("data").click();
    harness.run();
    harness.get_by_role_and_label(Kind::CheckBox, "crop").click();
    harness.run();
    let [low, high] = harness.state().layers[1].crop.expect("a crop");
    assert_eq!((low.to_array(), high.to_array()), ([0.0; 3], fixture::EXTENT.map(f64::from)));
    typed(&mut harness, ("   z", 0), "10");
    assert_eq!(harness.state().layers[1].crop.expect("a crop")[0].z, 10.0);
}

#[test]
fn another_volume_has_another_kind_of_look() {
    let mut scene = fixture::scene();
    scene.layers[1].gamma = 2.0;
    scene.layers[1].opacity = 0.5;
    let mut harness = harness(scene);
    harness.get_by_label("open layer 1").click();
    harness.run();
    harness.get_by_label("data").click();
    harness.run();
    harness.get_by_role_and_label(Kind::ComboBox, "volume").click();
    harness.run();
    harness.get_by_label("volume 1").click();
    harness.run();
    let layer = &harness.state().layers[1];
    assert_eq!((layer.source, layer.gamma, layer.opacity), (Some(1), 1.0, 0.5));
}

#[test]
fn an_expression_has_the_layers_as_they_are() {
    let expression = Some(SceneExpression::from("a + b".to_string()));
    let scene = Scene { expression, ..fixture::scene() };
    let mut harness = harness(scene.clone());
    harness.get_by_role_and_label(Kind::CheckBox, "layer 1").click();
    harness.get_by_label("open layer 1").click();
    harness.run();
    assert_eq!(*harness.state(), scene, "it reads the layer, which stays visible");
    assert!(harness.query_by_label("gamma").is_none());
}

/// A scene has at most thirty-two layers, each a short line.
#[test]
fn many_layers_stay_short() {
    let scene = Scene { layers: vec![SceneLayer { source: Some(0), ..SceneLayer::default() }; 32], ..Scene::default() };
    let mut harness = harness(scene);
    let last = harness.get_by_label("open layer 31").rect();
    assert!(last.bottom() < 32.0 * 26.0, "{last:?}");
    harness.get_by_label("more of layer 31").click();
    harness.run();
    harness.get_by_label("duplicate").click();
    harness.run();
    assert_eq!(harness.state().layers.len(), 32);
}
