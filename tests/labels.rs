//! Labels: read at the nearest voxel and never mixed, in every mode, by every way to draw, at every level, zoom and angle; their colours,
//! looks and flags.

use crate::bad_input::nifti_header;
use brickyard::oracle::render_reference;
use brickyard::session::{SessionOptions, VolumeSource, resolve};
use brickyard::store::{Downsample, Kind, PackOptions, Store};
use brickyard::volume::labels::{color_index, hashed_color};
use brickyard::volume::{
    Blend, Camera, Extent, Filter, Geometry, Gradient, Jitter, LevelPolicy, Lighting, LightingModel, Method, Mode,
    Picture, Placement, Projection, Sampling, Scene, SceneExpression, SceneLayer, Slice, TransferFunction, Voxel,
};
use brickyard_tests::sample::{draws, seed};
use brickyard_tests::{
    Expected, FunctionSource, Sandbox, TestStore, WAYS, off, open_session, open_session_of, options, oracle, read_png,
    run, run_ok, settled,
};
use glam::DVec3;
use std::collections::BTreeSet;

const SIZE: (u32, u32) = (72, 60);
const EXTENT: Extent = Extent { x: 45, y: 38, z: 41 };

/// Blobs of four labels in a background of 0, as indices of a list.
fn blob([x, y, z]: [u32; 3]) -> usize {
    let p = DVec3::new(x.into(), y.into(), z.into());
    let centres =
        [(14.0, 14.0, 15.0, 11.5), (25.0, 17.0, 20.0, 10.0), (30.0, 25.0, 29.0, 9.5), (12.0, 28.0, 30.0, 8.0)];
    let inside = |(x, y, z, radius): (f64, f64, f64, f64)| (p - DVec3::new(x, y, z)).length() < radius;
    centres.into_iter().position(inside).map_or(0, |i| i + 1)
}

/// A store of blobs of these labels.
fn store<T: Voxel>(labels: [f64; 5]) -> TestStore {
    let geometry = Geometry { spacing: DVec3::new(1.0, 1.25, 0.8), ..Geometry::default() };
    let source = FunctionSource::new(EXTENT, geometry, move |_, _, v| T::from_f64_rounded(labels[blob(v)]));
    pack(&source)
}

fn pack(source: &dyn brickyard::import::Source) -> TestStore {
    let voxel_type = source.info().voxel_type;
    let plain = PackOptions { edge: 16, shard_edge: 64, threads: 2, ..PackOptions::new(voxel_type) };
    TestStore::pack_with(source, PackOptions { kind: Kind::Labels, downsample: Downsample::Mode.into(), ..plain })
}

fn lit(gradient: Gradient) -> Lighting {
    Lighting { model: LightingModel::BlinnPhong, gradient, ..Lighting::default() }
}

fn sampled(method: Method, filter: Filter) -> Sampling {
    Sampling { method, filter, ..Sampling::default() }
}

/// A picture from near the volume, at an angle with no axis.
fn at_an_angle() -> Scene {
    let camera = Camera {
        eye: DVec3::new(-25.0, -38.0, 61.0),
        target: DVec3::new(21.0, 22.0, 17.0),
        up: DVec3::Z,
        projection: Projection::Perspective { fov_y_deg: 35.0 },
    };
    Scene {
        camera: Some(camera),
        background: [0.1, 0.1, 0.15],
        layers: vec![SceneLayer::default()],
        ..Scene::default()
    }
}

fn through(normal: DVec3, thickness: f64) -> Option<Slice> {
    Some(Slice { point: DVec3::new(20.3, 21.1, 17.7), normal, thickness })
}

fn looking_at(slice: Option<Slice>, mode: Mode) -> Scene {
    Scene { slice, mode, ..at_an_angle() }
}

/// Labels named by a look have their own codes where 16 bits are too few, made from the voxels in memory.
#[test]
fn naming_a_label_decodes_nothing_again() {
    let test = store::<u32>([0.0, 3.0, 70_000.0, 70_001.0, 4e9]);
    let naming = |labels: Vec<i64>| Scene {
        layers: vec![SceneLayer { show_labels: Some(labels), ..SceneLayer::default() }],
        level: LevelPolicy::Locked(0),
        ..at_an_angle()
    };
    for way in [WAYS[1], WAYS[3]] {
        // Every brick is resident from the start, so that only codes change.
        let options = SessionOptions { skips_empty: false, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open_session(&test.store, options) else { continue };
        let (_, first) = settled(&mut session, &naming(vec![3]), SIZE);
        let (found, second) = settled(&mut session, &naming(vec![70_000, 4_000_000_000]), SIZE);
        assert!(second.bricks.uploaded > first.bricks.uploaded, "{way:?}: other codes");
        assert_eq!(second.bytes.decoded, first.bytes.decoded, "{way:?}");
        let expected = oracle(&test.store, &naming(vec![70_000, 4_000_000_000]), SIZE);
        assert!(off(&found, &expected).len() <= found.rgb.len() / 1000, "{way:?}");
    }
}

/// Scenes of one layer of labels.
fn scenes(shown: &[i64]) -> Vec<(&'static str, Scene)> {
    let plain = at_an_angle();
    let layer = |layer: SceneLayer| Scene { layers: vec![layer], ..plain.clone() };
    let by = |sampling: Sampling| Scene { sampling, lighting: lit(Gradient::Central), ..plain.clone() };
    vec![
        ("opaque", plain.clone()),
        ("lit", Scene { lighting: lit(Gradient::Central), ..plain.clone() }),
        ("lit, stored gradients", Scene { lighting: lit(Gradient::Stored), ..plain.clone() }),
        ("half transparent", layer(SceneLayer { opacity: 0.3, ..SceneLayer::default() })),
        ("some", layer(SceneLayer { show_labels: Some(shown.to_vec()), ..SceneLayer::default() })),
        ("red", layer(SceneLayer { color: Some([1.0, 0.1, 0.0]), opacity: 0.2, ..SceneLayer::default() })),
        ("splines of splines", by(sampled(Method::Pcvs, Filter::Tricubic))),
        ("adaptive", by(sampled(Method::Asm, Filter::Trilinear))),
        ("jittered", by(Sampling { jitter: Jitter::Blue, ..Sampling::default() })),
        ("level 1", Scene { level: LevelPolicy::Locked(1), ..plain.clone() }),
        ("slice", looking_at(through(DVec3::new(0.3, -0.5, 0.8), 0.0), Mode::Average)),
        ("thick slice", looking_at(through(DVec3::new(0.3, -0.5, 0.8), 6.0), Mode::Mip)),
        ("projection", looking_at(None, Mode::MinIp)),
        (
            "some in a slice",
            Scene {
                layers: vec![SceneLayer { show_labels: Some(shown.to_vec()), ..SceneLayer::default() }],
                ..looking_at(through(DVec3::Z, 0.0), Mode::Average)
            },
        ),
    ]
}

fn agree(test: &TestStore, shown: &[i64]) {
    let expected = |scene: &Scene| oracle(&test.store, scene, SIZE);
    // Codes by looks are not in label order, which projections depend on.
    let has_order = !VolumeSource::of_store(&test.store).source.channel_range(0).1.gt(&1e9);
    let open = |way| Some((way, open_session(&test.store, options(way, 64 << 20, 64 << 20))?));
    let mut sessions: Vec<_> = WAYS.into_iter().filter_map(open).collect();
    for (name, scene) in scenes(shown) {
        let is_thick = scene.mode.is_projection() && scene.slice.is_none_or(|slice| slice.thickness > 0.0);
        if is_thick && !has_order {
            continue;
        }
        let expected = Expected::new(&scene, &expected);
        for (way, session) in &mut sessions {
            expected.assert_shown(&settled(session, &scene, SIZE).0, &format!("{way:?}, {name}"));
        }
    }
}

#[test]
fn labels_of_8_bits_equal_the_oracle() {
    agree(&store::<u8>([0.0, 1.0, 3.0, 200.0, 255.0]), &[3, 255]);
}

#[test]
fn labels_of_16_bits_equal_the_oracle() {
    agree(&store::<i16>([0.0, 1.0, 3.0, -30_000.0, 32_767.0]), &[3, -30_000]);
}

/// Further apart than 16 bits reach: exact if named.
#[test]
fn labels_of_32_bits_equal_the_oracle() {
    agree(&store::<u32>([0.0, 70_000.0, 70_001.0, 4e9, 5.0]), &[70_001, 4_000_000_000]);
}

#[test]
fn labels_of_32_bits_that_lie_close_equal_the_oracle() {
    agree(&store::<i32>([0.0, -1.0, 3.0, 60_000.0, 7.0]), &[-1, 60_000]);
}

/// A picture's colours other than these, give or take 1/255, because shader tables have colours of 10 or 11 bits.
fn others(picture: &Picture, known: &[[f32; 3]]) -> BTreeSet<[u8; 3]> {
    let is_known = |found: &[u8; 3]| {
        let near = |color: &[f32; 3]| (0..3).all(|k| Picture::quantise(*color)[k].abs_diff(found[k]) <= 1);
        known.iter().any(near)
    };
    picture.rgb.iter().copied().filter(|found| !is_known(found)).collect()
}

/// Between labels 1 and 3 there is no 2, nor any third colour.
#[test]
fn between_two_labels_there_is_no_third() {
    let value = |_, _, [x, y, z]: [u32; 3]| -> u8 { if (x * 3 + y + 2 * z) % 29 < 13 { 1 } else { 3 } };
    let test = pack(&FunctionSource::new(EXTENT, Geometry::default(), value));
    let background = [0.25, 0.5, 0.0];
    let [one, three] = [color_index(1), color_index(3)].map(hashed_color);
    let known = [one, three, background].map(|color| color.map(|c: f64| c as f32));
    let middle = DVec3::new(22.5, 19.0, 20.5);
    for way in WAYS {
        let Some(mut session) = open_session(&test.store, options(way, 64 << 20, 64 << 20)) else { continue };
        for (i, height) in [400.0, 60.0, 9.0, 0.7].into_iter().enumerate() {
            for (direction, mode) in [
                (DVec3::new(1.0, 0.2, -0.4), Mode::Dvr),
                (DVec3::new(0.0, 0.0, 1.0), Mode::Average),
                (DVec3::new(-0.5, 0.7, 0.1), Mode::Mip),
            ] {
                let projection = Projection::Orthographic { height };
                let camera =
                    Camera { eye: middle - 80.0 * direction.normalize(), target: middle, up: DVec3::Y, projection };
                let slice = Some(Slice { point: middle, normal: direction, thickness: 0.0 });
                for filter in Filter::ALL {
                    let scene = Scene {
                        camera: Some(camera),
                        background,
                        mode,
                        slice: slice.filter(|_| mode != Mode::Dvr),
                        sampling: sampled(Method::Udvr, filter),
                        level: [LevelPolicy::Auto, LevelPolicy::Locked(i as u8 % 2)][i / 2],
                        layers: vec![SceneLayer::default()],
                        ..Scene::default()
                    };
                    let (picture, _) = settled(&mut session, &scene, SIZE);
                    let others = others(&picture, &known);
                    assert!(others.is_empty(), "{way:?} {height} {mode:?} {filter:?}: {others:?}");
                    assert!(
                        height < 1.0 || picture.rgb.iter().any(|p| *p != picture.rgb[0]),
                        "{way:?} {height} {mode:?}"
                    );
                }
            }
        }
    }
}

/// Labels over their image: each layer is sampled in its own way.
#[test]
fn labels_over_an_image_equal_the_oracle() {
    let geometry = Geometry { spacing: DVec3::new(1.0, 1.25, 0.8), ..Geometry::default() };
    let wave = |_, _, [x, y, z]: [u32; 3]| {
        (127.0 + 60.0 * (f64::from(x) * 0.4).sin() + 60.0 * (f64::from(y + z) * 0.3).cos()) as u8
    };
    let image = TestStore::pack(&FunctionSource::new(EXTENT, geometry, wave), 16);
    let fog: SceneLayer = TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [255.0, 1.0, 0.9, 0.6]],
        opacity: vec![[100.0, 0.0], [255.0, 0.2]],
        unit_distance: 3.0,
        ..TransferFunction::default()
    }
    .into();
    for labels in [store::<u8>([0.0, 1.0, 3.0, 200.0, 255.0]), store::<u32>([0.0, 70_000.0, 70_001.0, 4e9, 5.0])] {
        let stores: [&Store; 2] = [&image.store, &labels.store];
        let over = |opacity: f64| SceneLayer { opacity, blend: Some(Blend::Mix), ..SceneLayer::default() };
        let both = |scene: Scene, opacity: f64| Scene { layers: vec![fog.clone(), over(opacity)], ..scene };
        let slice = looking_at(through(DVec3::new(0.3, -0.5, 0.8), 0.0), Mode::Average);
        let over_it = |mut scene: Scene| {
            scene.layers[1].blend = Some(Blend::Over);
            scene
        };
        // The last layer is on top wherever it stands in the list.
        let over = SceneLayer { source: Some(1), blend: Some(Blend::Over), ..over(0.4) };
        let bright = SceneLayer { source: Some(0), blend: Some(Blend::Add), ..fog.clone() };
        let turned = Placement::from_text("0.8 -0.6 0 12  0.6 0.8 0.1 -5  0 0 1.1 3").expect("a map");
        let mut apart = both(at_an_angle(), 0.5);
        apart.layers[1].world_from_volume = turned;
        let mut scenes = vec![
            ("fog", both(at_an_angle(), 0.3)),
            ("lit", Scene { lighting: lit(Gradient::Central), ..both(at_an_angle(), 1.0) }),
            ("lines of fog", Scene { sampling: sampled(Method::Lvs, Filter::Trilinear), ..both(at_an_angle(), 0.3) }),
            (
                "pre-integrated",
                Scene {
                    sampling: sampled(Method::Pdvr, Filter::Trilinear),
                    lighting: lit(Gradient::Stored),
                    ..both(at_an_angle(), 0.3)
                },
            ),
            ("splines", Scene { sampling: sampled(Method::Udvr, Filter::Tricubic), ..both(at_an_angle(), 0.4) }),
            ("turned", apart),
            ("slice", both(slice.clone(), 0.5)),
            ("over a slice", over_it(both(slice.clone(), 0.5))),
            ("over light", Scene { layers: vec![over.clone(), bright.clone(), bright], ..slice }),
        ];
        if labels.store.voxel_type().bytes() == 1 {
            // Codes by looks are not in label order, which projections depend on.
            scenes.push(("over a mean", over_it(both(looking_at(None, Mode::Average), 0.7))));
        }
        let sources = stores.map(|store| VolumeSource::open(store.path()).expect("a store"));
        let open = |way| {
            let options = SessionOptions { threads: 2, ..options(way, 64 << 20, 64 << 20) };
            Some((way, open_session_of(sources.to_vec(), options)?))
        };
        let mut sessions: Vec<_> = WAYS.into_iter().filter_map(open).collect();
        for (name, scene) in &scenes {
            let draw = |scene: &Scene| {
                let resolved = resolve(&sources, scene, SIZE).expect("a possible scene");
                render_reference(&stores, &resolved, 1 << 30).expect("the oracle's picture")
            };
            let expected = Expected::new(scene, &draw);
            // Different cells have no common order.
            for (way, session) in sessions.iter_mut().filter(|(way, _)| *way != WAYS[0] || scene.mode != Mode::Dvr) {
                let what = format!("{way:?}, {name}");
                if draws(&what, *way) {
                    expected.assert_shown(&settled(session, scene, SIZE).0, &format!("{what}, seed {:x}", seed()));
                }
            }
        }
    }
}

/// Labels can mask an image in an expression.
#[test]
fn expressions_read_labels() {
    let labels = store::<u8>([0.0, 1.0, 3.0, 200.0, 255.0]);
    let expression = SceneExpression { text: "a == 3 ? 200 : a".into(), transfer: None };
    let scene = Scene { expression: Some(expression), lighting: lit(Gradient::Central), ..at_an_angle() };
    let draw = |scene: &Scene| oracle(&labels.store, scene, SIZE);
    let expected = Expected::new(&scene, &draw);
    for way in WAYS.into_iter().filter(|way| *way != WAYS[0]) {
        let Some(mut session) = open_session(&labels.store, options(way, 64 << 20, 64 << 20)) else { continue };
        expected.assert_shown(&settled(&mut session, &scene, SIZE).0, &format!("{way:?}"));
    }
    let far = store::<u32>([0.0, 70_000.0, 70_001.0, 4e9, 5.0]);
    let error = resolve(&[VolumeSource::of_store(&far.store)], &scene, SIZE).unwrap_err();
    assert!(error.to_string().contains("too far apart"), "{error}");
}

/// The command's flags for labels, and its messages where they do not apply.
#[test]
fn the_command_shows_labels_and_says_what_is_wrong() {
    let sandbox = Sandbox::default();
    let labels = store::<u8>([0.0, 1.0, 3.0, 200.0, 255.0]);
    let far = store::<u32>([0.0, 70_000.0, 70_001.0, 4e9, 5.0]);
    let wave = |_, _, [x, y, _]: [u32; 3]| (x * 3 + y) as u8;
    let image = TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), wave), 16);
    let [labels, far, image] = [&labels, &far, &image].map(|test| test.path().display().to_string());
    let picture = sandbox.path("out.png");
    let out = picture.to_str().expect("a path in UTF-8");
    let size = ["--size", "72x60", "--overwrite", "-o", out];
    let seen = |arguments: &[&str]| {
        run_ok(&[&["render"], arguments, &size[..]].concat());
        read_png(&picture)
    };
    let color = |label: i64| Picture::quantise(hashed_color(color_index(label)).map(|c| c as f32));
    let has = |picture: &Picture, color: [u8; 3]| {
        picture.rgb.iter().any(|found| (0..3).all(|k| found[k].abs_diff(color[k]) <= 1))
    };
    let slice = ["--slice", "k=20"];
    let all = seen(&[&[&*labels], &slice[..]].concat());
    assert!([1, 3, 200].into_iter().all(|label| has(&all, color(label))), "colours of labels");
    let some = seen(&[&[&*labels, "--show-labels", "3,200"], &slice[..]].concat());
    assert!(has(&some, color(3)) && has(&some, color(200)) && !has(&some, color(1)));
    let one = seen(&[&[&*far, "--show-labels", "4000000000"], &slice[..]].concat());
    assert!(has(&one, color(4_000_000_000)) && !has(&one, color(70_000)) && !has(&one, color(70_001)));
    // A window applies to the image, and its labels keep their own.
    let both =
        [&*image, &*labels, "--window", "0,200", "--transfer", "viridis", "--show-labels", "3", "--slice", "z=20"];
    assert!(has(&seen(&both), color(3)));
    let by_layer = [&*image, &*labels, "--volume", "1:show-labels=1", "--slice", "z=20"];
    assert!(has(&seen(&by_layer), color(1)));
    let red = seen(&[&[&*labels, "--color", "red", "--show-labels", "3"], &slice[..]].concat());
    assert!(has(&red, [255, 0, 0]) && !has(&red, color(3)));
    let (info, _) = run_ok(&["info", &labels]);
    assert!(info.contains("labels from 0 to 255"), "{info}");
    for (line, word) in [
        (vec![&*labels, "--show-labels", "2"], "no label 2, did you mean 1 or 3?: the store has labels from 0 to 255"),
        (vec![&*far, "--show-labels", "5000000000"], "no label 5000000000"),
        (vec![&*labels, "--show-labels", "3;4"], "whole numbers"),
        (vec![&*image, "--show-labels", "3"], "has none: pack it as labels"),
        (vec![&*labels, "--window", "0,9"], "labels have no window"),
        (vec![&*labels, "--gamma", "0.5"], "labels have no gamma"),
        (vec![&*labels, "--mode", "isosurface", "--isovalue", "3"], "labels have no isosurfaces"),
        (vec![&*far, "--transfer", "viridis"], "too far apart"),
    ] {
        let (code, _, stderr) = run(&[&["render"], &line[..], &size[..]].concat());
        assert_eq!(code, 2, "{line:?}: {stderr}");
        assert!(stderr.contains(word), "{line:?}: {word:?} is not in: {stderr}");
    }
}

/// Colours of the store's OME metadata, written by other programs, are the labels' colours.
#[test]
fn labels_have_the_colours_of_the_metadata() {
    let sandbox = Sandbox::default();
    let test = store::<u8>([0.0, 1.0, 3.0, 200.0, 255.0]);
    let path = test.path().join("zarr.json");
    let text = std::fs::read_to_string(&path).expect("the root's metadata");
    let mut root: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    root["attributes"]["ome"]["image-label"] = serde_json::json!({ "colors": [
        { "label-value": 200, "rgba": [10, 20, 230, 255] },
        { "label-value": 3, "rgba": [255, 128, 0, 255] },
        { "label-value": 1, "rgba": [999, 0, 0, 255] },
        { "label-value": 1 },
    ]});
    std::fs::write(&path, root.to_string()).expect("written");
    let picture = sandbox.path("out.png");
    let out = picture.to_str().expect("a path in UTF-8");
    let store = test.path().display().to_string();
    run_ok(&["render", &store, "--slice", "k=20", "--size", "72x60", "-o", out]);
    let found: BTreeSet<[u8; 3]> = read_png(&picture).rgb.into_iter().collect();
    let hashed = Picture::quantise(hashed_color(color_index(1)).map(|c| c as f32));
    for color in [[10, 20, 230], [255, 128, 0], hashed] {
        let near = |other: &[u8; 3]| (0..3).all(|k| other[k].abs_diff(color[k]) <= 1);
        assert!(found.iter().any(near), "{color:?} is not in {found:?}");
    }
    let (info, _) = run_ok(&["info", &store]);
    assert!(info.contains("2 labels with colors of their own"), "{info}");
}

/// A file's word makes its kind, and a flag another one.
#[test]
fn files_that_say_so_are_labels() {
    let sandbox = Sandbox::default();
    let mut header = nifti_header(&[4, 2, 2], 4, 16);
    let voxels: Vec<u8> = (0..16i16).flat_map(i16::to_le_bytes).collect();
    sandbox.write("image.nii", [&header[..], &voxels].concat());
    header[68..70].copy_from_slice(&1002i16.to_le_bytes());
    sandbox.write("labels.nii", [&header[..], &voxels].concat());
    let kind_of = |store: &str| {
        let store = Store::open(sandbox.path(store)).expect("a store");
        (store.info().kind, store.info().downsample.main())
    };
    for (line, store, kind, is_said) in [
        ("pack labels.nii a.zarr", "a.zarr", (Kind::Labels, Downsample::Mode), true),
        ("pack labels.nii b.zarr --kind image", "b.zarr", (Kind::Image, Downsample::Mean), false),
        ("pack image.nii c.zarr", "c.zarr", (Kind::Image, Downsample::Mean), false),
        ("append d.zarr labels.nii --time-step 1", "d.zarr", (Kind::Labels, Downsample::Mode), true),
        ("append d.zarr image.nii", "d.zarr", (Kind::Labels, Downsample::Mode), false),
        ("append h.zarr image.nii --time-step 1", "h.zarr", (Kind::Image, Downsample::Mean), false),
        ("append e.zarr labels.nii image.nii --time-step 1", "e.zarr", (Kind::Labels, Downsample::Mode), true),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("{line} --progress none"));
        assert_eq!(code, 0, "{line}: {stderr}");
        assert_eq!(kind_of(store), kind, "{line}");
        assert_eq!(
            stderr.contains("NIFTI_INTENT_LABEL") && stderr.contains("--kind image"),
            is_said,
            "{line}: {stderr}"
        );
    }
    let plan = sandbox.run_ok("pack labels.nii f.zarr --dry-run --json");
    assert!(plan.contains("NIFTI_INTENT_LABEL"), "{plan}");
    let (code, _, stderr) = sandbox.run("pack labels.nii f.zarr --downsample mean");
    assert!(code == 2 && stderr.contains("--kind image"), "{code}: {stderr}");
    // A step of the other kind is told, unless a flag repeats the store's.
    for (line, words) in [
        ("append h.zarr labels.nii", "warning: voxels are labels, by the header's intent"),
        ("append h.zarr labels.nii --kind image", ""),
        ("append d.zarr image.nii", "note: the file does not say that its voxels are labels"),
        ("append d.zarr image.nii --kind labels", ""),
        ("append d.zarr labels.nii", ""),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("{line} --progress none"));
        assert_eq!(code, 0, "{line}: {stderr}");
        assert!(stderr.contains(words), "{line}: {stderr}");
        assert_eq!(stderr.contains("voxels are labels"), !words.is_empty(), "{line}: {stderr}");
    }
    // In one store there is one kind.
    for line in ["pack labels.nii image.nii g.zarr", "pack --variable a=image.nii --variable b=labels.nii g.zarr"] {
        let (code, _, stderr) = sandbox.run(line);
        assert!(code == 2 && stderr.contains("labels.nii: says that its voxels are labels"), "{code}: {stderr}");
        assert!(stderr.contains("--kind labels or image"), "{stderr}");
    }
    sandbox.run_ok("pack --variable a=image.nii --variable b=labels.nii g.zarr --kind labels --progress none");
    let info = sandbox.run_ok("info g.zarr");
    assert!(info.contains("channel 1 'b': labels from 0 to 15"), "{info}");
}

/// Labels beyond 32 bits are refused, even with flags that permit losses in images, and never with advice to merge them.
#[test]
fn labels_beyond_32_bits_are_never_merged() {
    let sandbox = Sandbox::default();
    let npy = |descr: &str, numbers: &[u8]| {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1, 2, 3), }}\n");
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), numbers].concat()
    };
    let ids: [u64; 6] = [0, 1, 1 << 40, (1 << 40) + 1, 7, 7];
    sandbox.write("wide.npy", npy("<u8", ids.map(u64::to_le_bytes).as_flattened()));
    let fractions = [0.0, 16_777_216.0, 16_777_217.0, 1.0, 2.0, 3.0f64];
    sandbox.write("floats.npy", npy("<f8", fractions.map(f64::to_le_bytes).as_flattened()));
    let small: [i64; 6] = [-1, 0, 1, 70_000, 70_001, -70_000];
    sandbox.write("small.npy", npy("<i8", small.map(i64::to_le_bytes).as_flattened()));
    for (file, label) in [("wide.npy", "1099511627776"), ("floats.npy", "16777217")] {
        for flag in ["", " --allow-lossy"] {
            for command in ["pack FILE no.zarr", "append no.zarr FILE"] {
                let line = format!("{}{flag} --kind labels --progress none", command.replace("FILE", file));
                let (code, _, stderr) = sandbox.run(&line);
                assert!(code == 2 && stderr.contains(file) && stderr.contains(label), "{line}: {code}: {stderr}");
                assert!(stderr.contains("fastremap.renumber") && !stderr.contains("--allow-lossy"), "{stderr}");
            }
        }
        assert!(!sandbox.path("no.zarr").exists());
    }
    // Fitting ones are exact, also negative ones; a store of labels takes only these, whatever the next file is declared as.
    sandbox.run_ok("append labels.zarr small.npy --kind labels --time-step 1 --progress none");
    sandbox.run_ok("export labels.zarr labels.raw --time 0 --progress none");
    let expected = small.map(|label| i32::try_from(label).expect("32 bits").to_le_bytes());
    assert_eq!(sandbox.read("labels.raw"), expected.as_flattened());
    let (code, _, stderr) = sandbox.run("append labels.zarr wide.npy --allow-lossy --progress none");
    assert!(code == 2 && stderr.contains("fastremap.renumber"), "{code}: {stderr}");
    // As an image they may be clamped, as always.
    sandbox.run_ok("pack wide.npy image.zarr --allow-lossy --progress none");
}
