use super::*;
use crate::layer::label_codes;
use crate::lighting::LightingModel;
use crate::scene::VolumePlace;
use crate::transfer::TransferFunction;
use crate::{LabelLook, Placement, SlotEncoding, VoxelType};
use glam::DVec3;
use std::collections::BTreeSet;

/// Two channels and four levels; one channel, two levels, and a time step more; labels.
const STORES: [StoreCounts; 3] = [
    StoreCounts { levels: 4, times: 1, channels: 2, is_labels: false },
    StoreCounts { levels: 2, times: 2, channels: 1, is_labels: false },
    StoreCounts { levels: 1, times: 1, channels: 1, is_labels: true },
];

fn read(text: &str) -> Scene {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// Invalid scenes, each with the name of its error (for a layer, of the layer's error), and a word of the message.
fn impossible() -> Vec<(&'static str, &'static str, Scene)> {
    let layer = |text: &str| read(&format!(r#"{{"layers": [{{}}, {text}]}}"#));
    let surfaces = |text: &str| layer(&format!(r#"{{"isosurfaces": {text}}}"#));
    let expression = |text: &str| {
        let mut scene = read(&format!(r#"{{{text}}}"#));
        scene.layers.resize(2, SceneLayer::default());
        Scene { expression: scene.expression.or(Some("a * b".to_string().into())), ..scene }
    };
    let steep = r#"{"color": [[0, 1, 1, 1]], "opacity": [[0, 1]], "gradient_opacity": [[1, 0], [2, 1]]}"#;
    let default = Scene::default;
    let lit = |lights: usize, light: DVec3| {
        let lighting = Lighting { model: LightingModel::Phong, lights: vec![light; lights], ..Lighting::default() };
        Scene { lighting, ..default() }
    };
    vec![
        ("Layers", "0 layers: expected 1 to 32", read(r#"{"layers": []}"#)),
        ("Layers", "33 layers", Scene { layers: vec![SceneLayer::default(); 33], ..default() }),
        ("NothingVisible", "nothing to show", read(r#"{"layers": [{"visible": false}, {"visible": false}]}"#)),
        ("Level", "level 4 does not exist: the stores have levels 0 to 3", read(r#"{"level": {"locked": 4}}"#)),
        ("Step", "the step is 0: expected 0.005 to 16 voxels", read(r#"{"step": 0}"#)),
        ("Step", "the step is 0.004", read(r#"{"step": 4e-3}"#)),
        ("Step", "the step is 16.1", read(r#"{"step": 16.1}"#)),
        ("Step", "NaN", Scene { step: f64::NAN, ..default() }),
        ("PixelError", "pixel error is -1", read(r#"{"pixel_error": -1}"#)),
        ("Background", "[0.0, 2.0, 0.0]", read(r#"{"background": [0, 2, 0]}"#)),
        ("Clip", "box from", read(r#"{"clip": [[0, 0, 0], [1, 0, 1]]}"#)),
        ("Clip", "normal [0, 0, 0]", read(r#"{"clip_planes": [{"point": [0, 0, 0], "normal": [0, 0, 0]}]}"#)),
        ("Clip", "mode dvr", read(r#"{"slice": {"point": [0, 0, 0], "normal": [0, 0, 1]}}"#)),
        ("Mesh", "a.stl has not been read", read(r#"{"meshes": [{"path": "a.stl"}]}"#)),
        ("Method", "Lvs", read(r#"{"mode": "mip", "sampling": {"method": "lvs"}}"#)),
        ("Lighting", "Tone", read(r#"{"mode": "average", "lighting": {"model": "tone"}}"#)),
        ("VirtualSamples", "0 virtual samples", read(r#"{"sampling": {"virtual_samples": 0}}"#)),
        ("Lights", "5 lights", lit(5, DVec3::ONE)),
        ("Light", "finite", lit(1, DVec3::splat(f64::NAN))),
        ("Unlit", "without lighting", read(r#"{"lighting": {"lights": [[0, 0, 1]]}}"#)),
        ("NoSurface", "isovalue", read(r#"{"mode": "isosurface"}"#)),
        (
            "NoSurface",
            "a visible layer",
            read(r#"{"mode": "isosurface", "layers": [{}, {"isosurfaces": [{"value": 7}], "visible": false}]}"#),
        ),
        ("Expression", "\n  max(a, *b)\n         ^", expression(r#""expression": "max(a, *b)""#)),
        ("Expression", "no volume c", expression(r#""expression": "a + c""#)),
        ("ExpressionOfNothing", "'1 + 2' reads no layer", expression(r#""expression": "1 + 2""#)),
        ("ExpressionOfHidden", "reads layer 1, which is hidden", expression(r#""layers": [{}, {"visible": false}]"#)),
        ("ExpressionStyle", "layer 0 has a style", expression(r#""layers": [{"opacity": 0.5}, {}]"#)),
        ("ExpressionMode", "Mip", expression(r#""mode": "mip""#)),
        ("ExpressionMethod", "Asm", expression(r#""sampling": {"method": "asm"}"#)),
        (
            "ExpressionByGradient",
            "gradient_opacity",
            expression(&format!(r#""expression": {{"text": "a", "transfer": {steep}}}"#)),
        ),
        (
            "ExpressionTransfer",
            "did you mean 'fire'",
            expression(r#""expression": {"text": "a", "transfer": {"preset": "fir"}}"#),
        ),
        ("Store", "layer 1: store 3 does not exist: there are 3", layer(r#"{"source": 3}"#)),
        ("NoLabels", "the store has none", layer(r#"{"show_labels": [3]}"#)),
        ("OfLabels", "labels have no window", layer(r#"{"source": 2, "window": [0, 9]}"#)),
        ("Store", "layer 3: store 3", Scene { layers: vec![SceneLayer::default(); 4], ..default() }),
        ("Channel", "channel 1 does not exist: the store has 1", layer(r#"{"channel": 1}"#)),
        ("Time", "layer 0: time step 1 does not exist: the store has 1", Scene { time: 1, ..default() }),
        ("Time", "layer 0: time step 2 does not exist: the store has 2", Scene { time: 2, ..layer("{}") }),
        ("Opacity", "1.5", layer(r#"{"opacity": 1.5}"#)),
        ("Gamma", "the gamma is 0: expected 0.05 to 20", layer(r#"{"gamma": 0}"#)),
        ("Window", "[3.0, 3.0]", layer(r#"{"window": [3, 3]}"#)),
        ("Color", "[0.0, 0.0, -1.0]", layer(r#"{"color": [0, 0, -1]}"#)),
        ("Crop", "crop: the clip box", layer(r#"{"crop": [[0, 0, 0], [1, 1, -1]]}"#)),
        ("Transfer", "'color' has no points", layer(r#"{"transfer": {"color": [], "opacity": []}}"#)),
        ("Transfer", "unknown transfer function 'grey'", layer(r#"{"transfer": {"preset": "grey"}}"#)),
        ("Transfer", "a.json has not been read", layer(r#"{"transfer": {"file": "a.json"}}"#)),
        (
            "Flat",
            "the value 5",
            layer(r#"{"transfer": {"color": [[5, 1, 1, 1]], "opacity": [[5, 1]]}, "window": [0, 1]}"#),
        ),
        (
            "Integrated",
            "Plvs",
            Scene {
                sampling: crate::Sampling { method: Method::Plvs, ..Default::default() },
                ..layer(&format!(r#"{{"transfer": {steep}}}"#))
            },
        ),
        ("SurfaceMode", "isovalue 7", Scene { mode: Mode::Mip, ..surfaces(r#"[{"value": 7}]"#) }),
        ("Surfaces", "9 isosurfaces", surfaces(&format!("[{}]", [r#"{"value": 7}"#; 9].join(",")))),
        (
            "SurfaceValue",
            "NaN",
            Scene::of(SceneLayer { isosurfaces: vec![Isosurface::at(f64::NAN)], ..SceneLayer::default() }),
        ),
        ("SurfaceOpacity", "at 7 has an opacity of 2", surfaces(r#"[{"value": 7, "opacity": 2}]"#)),
        ("SurfaceColor", "[0.0, 0.0, 9.0]", surfaces(r#"[{"value": 7, "color": [0, 0, 9]}]"#)),
        ("SurfaceTwice", "7", surfaces(r#"[{"value": 7}, {"value": 8}, {"value": 7, "opacity": 0.5}]"#)),
    ]
}

/// The names of all variants in a source text.
fn variants() -> BTreeSet<&'static str> {
    let lines = include_str!("../scene_error.rs").lines().filter_map(|line| line.strip_prefix("    "));
    let items = lines.filter(|line| line.starts_with(|c: char| c.is_ascii_uppercase()));
    items.filter_map(|line| line.split([',', '(', ' ']).next()).collect()
}

#[test]
fn every_reason_to_refuse_a_scene_is_found_and_told() {
    let mut found = BTreeSet::from(["Layer"]);
    for (name, word, scene) in impossible() {
        let error = scene.check(&STORES).expect_err(name);
        let text = match &error {
            SceneError::Layer { error, .. } => format!("{error:?}"),
            error => format!("{error:?}"),
        };
        assert_eq!(text.split(['(', ' ']).next(), Some(name), "{error}");
        assert!(error.to_string().contains(word), "{name}: {error}");
        found.insert(name);
    }
    // Errors of the stores' own places are found with the scene's world.
    let stretched = || Placement::from_text("1e5 0 0 0  0 1 0 0  0 0 1 0").expect("a map");
    let scene = Scene::of(SceneLayer { world_from_volume: stretched(), ..SceneLayer::default() });
    let own_box = (DVec3::ZERO, DVec3::ONE);
    let place = VolumePlace { own_box, placement: stretched(), is_anatomical: false };
    let error = scene.world_box(&[place]).expect_err("a map that cannot be used");
    assert!(error.to_string().contains("layer 0: the matrix stretches"), "{error}");
    found.insert("Placement");
    // Errors of the camera and the number of voxels are found with these: see the module `bounds`.
    found.insert("Reach");
    // Errors of the labels' codes are found with these.
    let encoding = SlotEncoding::of_labels(VoxelType::U32, (0.0, 4e9), false, None);
    let look = LabelLook { shown: Some((0..40_000).collect()), colors: None };
    for (name, labels, word) in [("HashedLabels", None, "too far apart"), ("ManyLabels", Some(look), "32767 labels")] {
        let function = TransferFunction { labels, ..TransferFunction::default() };
        let error = label_codes(&function, &encoding).expect_err(name);
        assert!(format!("{error:?}") == name && error.to_string().contains(word), "{error}");
        found.insert(name);
    }
    assert_eq!(found, variants(), "each has its scene");
}

#[test]
fn scenes_that_can_be_shown_are_not_refused() {
    for text in [
        "{}",
        r#"{"layers": [{"channel": 1}, {"source": 0}, {"source": 0, "channel": 1, "visible": false}]}"#,
        r#"{"layers": [{}, {"source": 1}], "level": {"locked": 3}}"#,
        r#"{"layers": [{"source": 1}], "time": 1}"#,
        r#"{"layers": [{}, {"source": 1}], "time": 1}"#,
        r#"{"mode": "isosurface", "layers": [{}, {"isosurfaces": [{"value": 7}]}], "lighting": {"lights": [[0, 0, 1]]}}"#,
        r#"{"layers": [{}, {}], "expression": {"text": "max(a, b)", "transfer": {"preset": "fire"}}}"#,
        r#"{"layers": [{"transfer": {"preset": "ct-bone"}, "window": [0, 9], "gamma": 0.5, "color": [1, 0, 0]}]}"#,
    ] {
        read(text).check(&STORES).unwrap_or_else(|error| panic!("{text}: {error}"));
    }
    let by_gradient = TransferFunction { gradient_opacity: vec![[0.0, 1.0]], ..TransferFunction::default() };
    let sampling = crate::Sampling { method: Method::Asm, ..Default::default() };
    Scene { sampling, ..Scene::of(by_gradient) }.check(&STORES).expect("what is sampled can be of gradients");
}

#[test]
fn unknown_fields_are_named_at_every_depth() {
    let function = r#"{"color": [], "opacity": [], "regions": [HERE]}"#;
    let region =
        r#"{"shape": "gaussian", "value": [0, 1], "gradient": [0, 1], "color": [1, 1, 1], "opacity": 1, "?": 0}"#;
    let camera = |projection: &str| {
        format!(r#"{{"camera": {{"eye": [0,0,0], "target": [1,1,1], "up": [0,0,1], "projection": {projection}}}}}"#)
    };
    for text in [
        r#"{"?": 0}"#.to_string(),
        r#"{"layers": [{"?": 0}]}"#.into(),
        r#"{"layers": [{"isosurfaces": [{"value": 7, "?": 0}]}]}"#.into(),
        r#"{"layers": [{"transfer": {"preset": "fire", "?": 0}}]}"#.into(),
        r#"{"layers": [{"transfer": {"file": "fire", "?": 0}}]}"#.into(),
        r#"{"layers": [{"transfer": {"color": [], "opacity": [], "?": 0}}]}"#.into(),
        format!(r#"{{"layers": [{{"transfer": {}}}]}}"#, function.replace("HERE", region)),
        r#"{"expression": {"text": "a", "?": 0}}"#.into(),
        r#"{"expression": {"text": "a", "transfer": {"preset": "fire", "?": 0}}}"#.into(),
        r#"{"camera": {"eye": [0,0,0], "?": 0}}"#.into(),
        camera(r#"{"perspective": {"fov_y_deg": 30, "?": 0}}"#),
        r#"{"stereo": {"layout": "anaglyph", "?": 0}}"#.into(),
        r#"{"sampling": {"?": 0}}"#.into(),
        r#"{"lighting": {"?": 0}}"#.into(),
        r#"{"slice": {"point": [0,0,0], "?": 0}}"#.into(),
        r#"{"clip_planes": [{"point": [0,0,0], "?": 0}]}"#.into(),
        r#"{"meshes": [{"path": "a.stl", "?": 0}]}"#.into(),
    ] {
        let error = serde_json::from_str::<Scene>(&text).expect_err(&text).to_string();
        assert!(error.contains("unknown field `?`"), "{text}: {error}");
    }
    let flat = r#"{"layers": [{"world_from_volume": [[1,0,0,0], [1,0,0,0], [0,0,1,0]]}]}"#;
    assert!(serde_json::from_str::<Scene>(flat).unwrap_err().to_string().contains("singular"));
}
