//! Tests of all panels: every field of a scene has a control, and looking changes nothing.

use super::*;
use brickyard::volume::{
    Camera, ClipPlane, Isosurface, Jitter, Lighting, LightingModel, Method, Mode, Sampling, SceneExpression,
    SceneLayer, Slice, Stereo, StereoLayout, TransferChoice,
};
use eframe::egui::{Ui, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT, Queryable};
use glam::DVec3;
use std::collections::BTreeSet;

/// Every field of a scene in JSON, with its control. A missing field or control fails the test below.
const FIELDS: [(&str, &str); 48] = [
    ("background", "colour"),
    ("camera.eye", "eye"),
    ("camera.projection.perspective.fov_y_deg", "angle"),
    ("camera.target", "target"),
    ("camera.up", "up"),
    ("clip", "clip"),
    ("clip_planes.normal", "normal"),
    ("clip_planes.point", "through"),
    ("expression.text", "expression text"),
    ("expression.transfer.preset", "colours"),
    ("layers.blend", "blend"),
    ("layers.channel", "channel"),
    ("layers.color", "tint"),
    ("layers.crop", "crop"),
    ("layers.gamma", "gamma"),
    ("layers.isosurfaces.color", "colour"),
    ("layers.isosurfaces.opacity", "opacity"),
    ("layers.isosurfaces.value", "value"),
    ("layers.opacity", "opacity"),
    ("layers.show_labels", "shown labels"),
    ("layers.source", "volume"),
    ("layers.transfer.preset", "colours"),
    ("layers.visible", "layer 0"),
    ("layers.window", "window"),
    ("layers.world_from_volume", "placement"),
    ("level", "level"),
    ("lighting.gradient", "gradient"),
    ("lighting.lights", "light 1"),
    ("lighting.model", "model"),
    ("meshes.color", "colour"),
    ("meshes.lit", "lit"),
    ("meshes.opacity", "opacity"),
    ("meshes.path", "organ.stl"),
    ("mode", "dvr"),
    ("pixel_error", "pixel error"),
    ("pixel_samples", "samples"),
    ("sampling.filter", "filter"),
    ("sampling.jitter.white", "seed"),
    ("sampling.method", "method"),
    ("sampling.virtual_samples", "virtual"),
    ("slice.normal", "normal"),
    ("slice.point", "position"),
    ("slice.thickness", "thickness"),
    ("step", "step"),
    ("stereo.convergence", "screen at"),
    ("stereo.eye_separation", "eyes apart"),
    ("stereo.layout", "layout"),
    ("time", "time step"),
];

/// Width of the panel in points.
const WIDTH: f32 = 260.0;

const GROUPS: [&str; 13] = [
    "slice",
    "clip box",
    "clip planes",
    "light",
    "sampling",
    "expression",
    "meshes",
    "stereo",
    "camera",
    "background",
    "transfer function",
    "isosurfaces",
    "data",
];

/// Scenes with a value in every field.
fn scenes() -> Vec<Scene> {
    let camera = Some(Camera::looking_at_box((DVec3::ZERO, DVec3::splat(20.0))));
    let image = SceneLayer {
        source: Some(0),
        channel: 1,
        transfer: Some(TransferChoice::preset("viridis")),
        window: Some([3.25, 200.0]),
        color: Some([0.251, 1.0, 1.0 / 3.0]),
        gamma: 12.0,
        opacity: 0.333_333,
        isosurfaces: vec![Isosurface { value: 400.123, color: Some([0.3; 3]), opacity: 0.111_11 }],
        crop: Some([DVec3::splat(-3.0), DVec3::splat(99.5)]),
        ..SceneLayer::default()
    };
    let fog = Scene {
        camera,
        stereo: Some(Stereo {
            layout: StereoLayout::Anaglyph,
            eye_separation: Some(0.12345),
            convergence: Some(7.7777),
        }),
        sampling: Sampling {
            method: Method::Cvs,
            virtual_samples: 5,
            jitter: Jitter::White(123_456),
            ..Sampling::default()
        },
        lighting: Lighting {
            model: LightingModel::Phong,
            lights: vec![DVec3::new(1.0 / 3.0, 1e6, -2.0)],
            ..Lighting::default()
        },
        step: 0.012_345,
        background: [0.1234; 3],
        pixel_error: 77.7,
        time: 2,
        clip: Some([DVec3::splat(-99.0), DVec3::splat(5.000_001)]),
        clip_planes: vec![ClipPlane { point: DVec3::splat(1.0 / 3.0), normal: DVec3::new(0.1, 0.2, 1.0 / 7.0) }],
        meshes: vec![brickyard::volume::MeshLook { opacity: 0.123_456, ..fixture::mesh() }],
        layers: vec![image],
        ..Scene::default()
    };
    let slice = Scene {
        camera,
        mode: Mode::Average,
        slice: Some(Slice { point: DVec3::splat(3.333_33), normal: DVec3::new(0.2, 0.1, 3.0), thickness: 0.123_456 }),
        ..Scene::of(SceneLayer { source: Some(1), show_labels: Some(vec![9, 3]), ..SceneLayer::default() })
    };
    let expression = SceneExpression { text: "a*2".into(), transfer: Some(TransferChoice::preset("fire")) };
    let expression = Scene { expression: Some(expression), ..Scene::default() };
    vec![fog, slice, expression]
}

fn harness<'a>(scene: &Scene, theme: eframe::egui::Theme) -> Harness<'a, Scene> {
    let volumes = fixture::volumes();
    let show = move |ui: &mut Ui, scene: &mut Scene| {
        view::show(ui, scene, &volumes, false, &mut Vec::new());
        view::groups(ui, scene, &volumes);
        ui.separator();
        layers::show(ui, scene, &volumes, Some(5), &mut Vec::new());
    };
    let builder = Harness::builder().with_size(vec2(WIDTH, 2600.0)).with_theme(theme);
    let mut harness = builder.build_ui_state(show, scene.clone());
    open_groups(&mut harness);
    harness
}

fn open_groups<S>(harness: &mut Harness<'_, S>) {
    for group in GROUPS {
        if let Some(heading) = harness.query_by_role_and_label(eframe::egui::accesskit::Role::DisclosureTriangle, group)
        {
            heading.click();
            harness.run();
        }
    }
}

/// The paths of all fields of a JSON document; lists of objects count as one object.
fn fields(value: &serde_json::Value, path: &str, found: &mut BTreeSet<String>) {
    use serde_json::Value;
    let inner = |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    match value {
        Value::Object(entries) => entries.iter().for_each(|(name, value)| fields(value, &inner(name), found)),
        Value::Array(items) if items.iter().any(Value::is_object) => {
            items.iter().for_each(|item| fields(item, path, found))
        }
        _ => drop(found.insert(path.to_string())),
    }
}

#[test]
fn every_field_of_a_scene_has_a_control() {
    let mut all = BTreeSet::new();
    let mut controls = BTreeSet::new();
    for scene in scenes() {
        fixture::check(&scene, &fixture::volumes());
        let mut own = BTreeSet::new();
        fields(&serde_json::to_value(&scene).expect("JSON"), "", &mut own);
        let harness = harness(&scene, eframe::egui::Theme::Dark);
        let shown = FIELDS.iter().filter(|(_, control)| harness.query_all_by_label(control).next().is_some());
        controls.extend(shown.map(|(field, _)| field.to_string()));
        all.extend(own);
    }
    // A field that is null here has its parts there.
    let is_whole = |field: &&String| !all.iter().any(|other| other.starts_with(&format!("{field}.")));
    let all: BTreeSet<String> = all.iter().filter(is_whole).cloned().collect();
    let known: BTreeSet<String> = FIELDS.iter().map(|(field, _)| field.to_string()).collect();
    assert_eq!(all, known, "a field without a control, or a control without a field");
    assert_eq!(controls, known, "a control is gone");
}

#[test]
fn looking_changes_nothing() {
    for scene in scenes() {
        let mut harness = harness(&scene, eframe::egui::Theme::Light);
        // Through all fields and back to the first.
        for _ in 0..150 {
            harness.key_press(eframe::egui::Key::Tab);
            harness.run_steps(2);
        }
        assert_eq!(*harness.state(), scene);
    }
}

/// Scenes whose clip boxes have ends of many digits.
fn clipped() -> impl Iterator<Item = Scene> {
    let clip = Some([DVec3::new(-99.25, -0.5, -1234.56), DVec3::new(161.25, 244.5, 161.2)]);
    scenes().into_iter().map(move |scene| Scene { clip, ..scene })
}

#[test]
fn a_panel_stays_as_wide_as_it_is() {
    for mut scene in clipped() {
        let volumes = fixture::volumes();
        let show = move |ui: &mut Ui, width: &mut f32| {
            let panel = eframe::egui::Panel::left("scene").default_size(WIDTH).show(ui, |ui| {
                widgets::within(ui, |ui| {
                    view::show(ui, &mut scene, &volumes, false, &mut Vec::new());
                    view::groups(ui, &mut scene, &volumes);
                    layers::show(ui, &mut scene, &volumes, Some(5), &mut Vec::new());
                    ui.allocate_space(vec2(ui.available_width() + 20.0, 10.0));
                });
            });
            *width = panel.response.rect.width();
        };
        let mut harness = Harness::builder().with_size(vec2(1200.0, 2600.0)).build_ui_state(show, 0.0);
        harness.run();
        let first = *harness.state();
        open_groups(&mut harness);
        harness.run_steps(200);
        assert_eq!(*harness.state(), first);
    }
}

/// Of the narrowest panel.
#[test]
fn nothing_is_wider_than_the_panel() {
    for scene in scenes().into_iter().chain(clipped()) {
        let harness = harness(&scene, eframe::egui::Theme::Dark);
        let nodes = harness.query_all(By::new());
        let right = |node: &egui_kittest::Node<'_>| node.accesskit_node().raw_bounds().map_or(0.0, |bounds| bounds.x1);
        // Rounding to pixels may take half a point.
        let is_wide = |right: f64| right > f64::from(WIDTH) + 0.5;
        let wide = nodes.filter(|node| is_wide(right(node))).map(|node| format!("{} {node:?}", right(&node)));
        let wide: Vec<_> = wide.collect();
        assert!(wide.is_empty(), "{}", wide.join("\n"));
    }
}
