use super::*;
use crate::panels::fixture;
use brickyard::volume::{Camera, LightingModel, Side, Slice, Stereo, StereoLayout};
use eframe::egui::accesskit::Role;
use eframe::egui::{Key, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

type Edited = (Scene, Vec<Command>);

fn seen() -> Scene {
    Scene { camera: Some(Camera::looking_at_box((DVec3::ZERO, DVec3::splat(20.0)))), ..fixture::scene() }
}

fn harness<'a>(scene: Scene) -> Harness<'a, Edited> {
    let volumes = fixture::volumes();
    let mut before = scene.clone();
    let show = move |ui: &mut Ui, (scene, commands): &mut Edited| {
        show(ui, scene, &volumes, false, commands);
        groups(ui, scene, &volumes);
        if *scene != before {
            fixture::check(scene, &volumes);
            before = scene.clone();
        }
    };
    Harness::builder().with_size(vec2(276.0, 1600.0)).build_ui_state(show, (scene, Vec::new()))
}

fn clicked<'a>(scene: Scene, names: &[&str]) -> Harness<'a, Edited> {
    let mut harness = harness(scene);
    for name in names {
        harness.get_by_label(name).click();
        harness.run();
    }
    harness
}

fn scene_after(scene: Scene, names: &[&str]) -> Scene {
    clicked(scene, names).state().0.clone()
}

/// Opens a group and chooses from one of its menus.
fn chosen<'a>(scene: Scene, group: &str, menu: &str, choice: &str) -> Harness<'a, Edited> {
    let mut harness = clicked(scene, &[group]);
    choose(&mut harness, menu, choice);
    harness
}

fn choose(harness: &mut Harness<'_, Edited>, menu: &str, choice: &str) {
    harness.get_by_role_and_label(Role::ComboBox, menu).click();
    harness.run();
    harness.get_by_role_and_label(Role::Button, choice).click();
    harness.run();
}

/// Types into the only field of this role and name.
fn typed(harness: &mut Harness<'_, Edited>, (role, name): (Role, &str), text: &str) {
    harness.get_by_role_and_label(role, name).focus();
    harness.run();
    harness.get_by_role_and_label(role, name).type_text(text);
    harness.run();
    harness.key_press(Key::Enter);
    harness.run();
}

#[test]
fn what_moves_the_camera_is_a_command() {
    let commands = |name: &str| clicked(seen(), &[name]).state().1.clone();
    assert_eq!(commands("-x"), [Command::View(Viewpoint::World(DVec3::NEG_X))]);
    assert_eq!(commands("fit"), [Command::Fit]);
    assert_eq!(commands("parallel rays"), [Command::Parallel(true)]);
    assert!(Side::ALL.iter().all(|side| harness(seen()).query_by_label(side.name()).is_none()), "of patients alone");
}

#[test]
fn modes_are_chosen_with_all_that_they_need() {
    assert_eq!(scene_after(seen(), &["mip"]).mode, Mode::Mip);
    let lit = Scene { mode: Mode::Dvr, ..seen() };
    let mut lit =
        Scene { lighting: brickyard::volume::Lighting { model: LightingModel::Phong, ..lit.lighting.clone() }, ..lit };
    lit.lighting.lights = vec![DVec3::ONE];
    let projected = scene_after(lit, &["average"]);
    assert_eq!((projected.mode, projected.lighting.model), (Mode::Average, LightingModel::None));
    let surfaces = scene_after(seen(), &["isosurface"]);
    assert_eq!(surfaces.layers.iter().map(|layer| layer.isosurfaces.len()).collect::<Vec<_>>(), [1, 1, 0]);
    let expression = Some("a + b".to_string().into());
    assert_eq!(scene_after(Scene { expression, ..seen() }, &["mip"]).mode, Mode::Dvr, "an expression is in mode dvr");
}

#[test]
fn a_series_has_a_slider() {
    let mut harness = harness(seen());
    typed(&mut harness, (Role::SpinButton, "time step"), "2");
    assert_eq!(harness.state().0.time, 2);
}

#[test]
fn sampling_is_chosen_by_words() {
    use brickyard::volume::{Filter, Jitter, LevelPolicy, Method};
    let of = |menu, choice| chosen(seen(), "sampling", menu, choice).state().0.clone();
    assert_eq!(of("method", "pre-integrated, cubic").sampling.method, Method::Pcvs);
    assert_eq!(of("filter", "tricubic").sampling.filter, Filter::Tricubic);
    assert_eq!(of("jitter", "white noise").sampling.jitter, Jitter::White(0));
    assert_eq!(of("level", "0, the finest").level, LevelPolicy::Locked(0));
    let barred = chosen(Scene { mode: Mode::Mip, ..seen() }, "sampling", "method", "adaptive");
    assert_eq!(barred.state().0.sampling.method, Method::Udvr, "a projection has no methods");
    let mut harness = chosen(seen(), "sampling", "method", "virtual, linear");
    typed(&mut harness, (Role::SpinButton, "virtual"), "9");
    typed(&mut harness, (Role::SpinButton, "step"), "0.5");
    let scene = &harness.state().0;
    assert_eq!((scene.sampling.virtual_samples, scene.step), (9, 0.5));
}

#[test]
fn lights_are_added_once_there_is_something_to_light() {
    let dark = scene_after(seen(), &["light", "add a light"]);
    assert!(dark.lighting.lights.is_empty());
    let mut harness = chosen(seen(), "light", "model", "Phong");
    harness.get_by_label("add a light").click();
    harness.run();
    let eye = seen().camera.expect("a camera").eye;
    assert_eq!(harness.state().0.lighting.lights, [eye]);
    choose(&mut harness, "model", "unlit");
    assert!(harness.state().0.lighting.lights.is_empty());
}

#[test]
fn stereo_has_distances_of_its_own() {
    let mut harness = chosen(seen(), "stereo", "layout", "anaglyph");
    assert_eq!(harness.state().0.stereo, Some(Stereo::new(StereoLayout::Anaglyph)));
    harness.get_all_by_label("auto").next().expect("a switch").click();
    harness.run();
    typed(&mut harness, (Role::SpinButton, "eyes apart"), "0.5");
    assert_eq!(harness.state().0.stereo.and_then(|stereo| stereo.eye_separation), Some(0.5));
    choose(&mut harness, "layout", "off");
    assert_eq!(harness.state().0.stereo, None);
}

#[test]
fn an_expression_is_applied_once_it_can_be_read() {
    let mut scene = seen();
    scene.layers[1].gamma = 2.0;
    scene.layers[0].visible = false;
    let mut harness = clicked(scene, &["expression"]);
    let field = |harness: &Harness<'_, Edited>| harness.get_by_label("expression text").focus();
    field(&harness);
    harness.run();
    harness.get_by_label("expression text").type_text("max(a, ");
    harness.run();
    assert_eq!(harness.state().0.expression, None);
    assert!(harness.query_by_label_contains("^").is_some(), "a caret stands under what is wrong");
    harness.get_by_label("expression text").type_text("b)");
    harness.run();
    let scene = harness.state().0.clone();
    assert_eq!(scene.expression.map(|expression| expression.text), Some("max(a, b)".into()));
    assert!(scene.layers[0].visible && scene.layers[1].gamma == 1.0);
    harness.get_by_label("clear").click();
    harness.run();
    assert_eq!(harness.state().0.expression, None);
}

#[test]
fn a_clip_box_begins_around_everything() {
    let mut harness = clicked(seen(), &["clip box"]);
    harness.get_by_role_and_label(Role::CheckBox, "clip").click();
    harness.run();
    let whole = DVec3::from_array(fixture::EXTENT.map(f64::from)) - 0.5;
    assert_eq!(harness.state().0.clip, Some([DVec3::splat(-0.5), whole]));
    let high = |harness: &Harness<'_, Edited>| {
        harness.get_all_by_role_and_label(Role::SpinButton, "x (mm)").nth(1).expect("the greater end").focus();
    };
    high(&harness);
    harness.run();
    harness.get_all_by_role_and_label(Role::SpinButton, "x (mm)").nth(1).expect("the greater end").type_text("7");
    harness.run();
    harness.key_press(Key::Enter);
    harness.run();
    assert_eq!(harness.state().0.clip.expect("a box")[1].x, 7.0);
    harness.get_by_label("reset").click();
    harness.run();
    assert_eq!(harness.state().0.clip, Some([DVec3::splat(-0.5), whole]));
}

#[test]
fn planes_are_added_moved_turned_and_removed() {
    let mut scene = seen();
    // Then only the group's own buttons have such names.
    scene.camera = None;
    let mut harness = clicked(scene, &["clip planes"]);
    harness.get_all_by_label("-y").last().expect("a button of the group").click();
    harness.run();
    let middle = 0.5 * (DVec3::from_array(fixture::EXTENT.map(f64::from)) - 1.0);
    let plane = |harness: &Harness<'_, Edited>| harness.state().0.clip_planes.first().copied();
    assert_eq!(plane(&harness).map(|plane| (plane.point, plane.normal)), Some((middle, DVec3::NEG_Y)));
    typed(&mut harness, (Role::SpinButton, "position"), "-3");
    assert_eq!(plane(&harness).map(|plane| plane.point.y), Some(3.0), "along its normal, which is -y");
    harness.get_by_label("flip").click();
    harness.run();
    assert_eq!(plane(&harness).map(|plane| plane.normal), Some(DVec3::Y));
    harness.get_by_label("remove").click();
    harness.run();
    assert_eq!(plane(&harness), None);
}

#[test]
fn planes_are_added_by_buttons_that_stay() {
    let mut harness = clicked(Scene { camera: None, ..seen() }, &["clip planes"]);
    for count in 1..=2 {
        let button = harness.get_all_by_label("+z").last().expect("a button of the group");
        let place = button.rect();
        button.click();
        harness.run();
        assert_eq!(harness.state().0.clip_planes.len(), count);
        assert_eq!(harness.get_all_by_label("+z").last().map(|button| button.rect()), Some(place));
    }
}

#[test]
fn planes_of_a_patient_are_named_by_its_sides() {
    let world =
        World { low: DVec3::ZERO, high: DVec3::splat(2.0), is_anatomical: true, unit: "mm", axis_units: ["mm"; 3] };
    let show = move |ui: &mut Ui, scene: &mut Scene| clipping::show(ui, scene, &world);
    let mut harness = Harness::new_ui_state(show, Scene::default());
    for name in ["clip planes", "left", "superior"] {
        harness.get_by_label(name).click();
        harness.run();
    }
    let normals: Vec<_> = harness.state().clip_planes.iter().map(|plane| plane.normal).collect();
    assert_eq!(normals, [Side::Left.direction(), Side::Superior.direction()]);
    assert!(harness.query_by_label("+x").is_none());
}

#[test]
fn a_slice_is_looked_at_straight_and_moved_by_voxels() {
    let mut harness = chosen(seen(), "slice", "cut", "z");
    let scene = harness.state().0.clone();
    let slice = scene.slice.expect("a slice");
    assert_eq!((scene.mode, slice.normal, slice.point.z), (Mode::Average, Slice::across(2, 0.0).normal, 15.5));
    let camera = scene.camera.expect("a camera");
    assert!((camera.eye - camera.target).normalize().dot(slice.normal) > 1.0 - 1e-12);
    typed(&mut harness, (Role::SpinButton, "voxel"), "7");
    assert_eq!(harness.state().0.slice.expect("a slice").point.z, 7.0, "centres of voxels are at whole numbers");
    typed(&mut harness, (Role::SpinButton, "position"), "9.25");
    assert_eq!(harness.state().0.slice.expect("a slice").point.z, 9.25);
    choose(&mut harness, "shows", "greatest");
    assert_eq!(harness.state().0.mode, Mode::Mip);
    choose(&mut harness, "cut", "oblique");
    assert!(harness.query_all_by_label("normal").next().is_some());
    choose(&mut harness, "cut", "off");
    assert_eq!((harness.state().0.slice, harness.state().0.mode), (None, Mode::Mip));
}

#[test]
fn meshes_are_hidden_and_removed() {
    let scene = || Scene { meshes: vec![fixture::mesh()], ..seen() };
    let hidden = scene_after(scene(), &["meshes", "organ.stl"]);
    assert_eq!(hidden.meshes[0].opacity, 0.0);
    assert_eq!(scene_after(hidden, &["meshes", "organ.stl"]).meshes[0].opacity, 1.0);
    assert!(!scene_after(scene(), &["meshes", "lit"]).meshes[0].lit);
    assert!(scene_after(scene(), &["meshes", "remove"]).meshes.is_empty());
}

#[test]
fn the_camera_is_typed() {
    let mut harness = clicked(seen(), &["camera"]);
    typed(&mut harness, (Role::SpinButton, "angle"), "45");
    let camera = harness.state().0.camera.expect("a camera");
    assert_eq!(camera.projection, Projection::Perspective { fov_y_deg: 45.0 });
}

#[test]
fn the_background_is_a_click_away() {
    assert_eq!(scene_after(seen(), &["background", "white"]).background, [1.0; 3]);
}
