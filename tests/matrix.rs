//! Every look by every way to draw, against the oracle. The lists of modes, methods, filters, lighting models, gradients and layouts are
//! complete by construction (`every!` of the volume crate), so a new one mistaken for another by a backend or the oracle fails here until all
//! support it.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::oracle::render_reference;
use brickyard::session::{SessionError, VolumeSource, resolve};
use brickyard::store::Store;
use brickyard::volume::{
    Blend, Camera, Extent, Filter, Geometry, Gradient, Isosurface, Jitter, LevelPolicy, Lighting, LightingModel,
    MAX_VOLUMES, Method, Mode, Picture, Placement, Projection, Region, Sampling, Scene, SceneLayer, Shape, Stereo,
    StereoLayout, TransferChoice, TransferFunction,
};
use brickyard_tests::sample::{sampled, seed};
use brickyard_tests::{
    FunctionSource, TestStore, WAYS, Way, assert_same, assert_same_surface, in_mode, open_session_of, options, oracle,
    session, settled,
};
use glam::DVec3;

const SIZE: (u32, u32) = (56, 44);
const EXTENT: Extent = Extent::new(44, 37, 50);

fn geometry() -> Geometry {
    Geometry { spacing: DVec3::new(1.0, 0.9, 1.2), ..Geometry::default() }
}

/// Waves and a hollow, for empty bricks, thin layers and curved fields.
fn store() -> TestStore {
    let value = |_, _, [x, y, z]: [u32; 3]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        let value = 0.5 + 0.25 * (0.41 * x + 0.13 * y).sin() + 0.24 * (0.33 * y - 0.29 * z).cos();
        if x + y + z < 45.0 { 0 } else { (value * 255.0) as u8 }
    };
    TestStore::pack(&FunctionSource::new(EXTENT, geometry(), value), 16)
}

fn transfer() -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [128.0, 0.2, 0.9, 0.3], [255.0, 1.0, 0.6, 0.1]],
        opacity: vec![[90.0, 0.0], [120.0, 0.3], [140.0, 0.05], [255.0, 0.4]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    }
}

fn base() -> Scene {
    let (low, high) = geometry().world_box(EXTENT);
    let at = |x: f64, y: f64, z: f64| low + (high - low) * DVec3::new(x, y, z);
    let projection = Projection::Perspective { fov_y_deg: 36.0 };
    let camera = Camera { eye: at(2.1, -1.3, 1.6), target: at(0.5, 0.5, 0.5), up: DVec3::Z, projection };
    Scene { camera: Some(camera), background: [0.1, 0.0, 0.2], ..Scene::of(transfer()) }
}

/// A scene of a mode.
fn of_mode(mode: Mode) -> Scene {
    in_mode(base(), mode, 131.0)
}

fn lit(model: LightingModel, gradient: Gradient) -> Lighting {
    let lights = if model == LightingModel::None { Vec::new() } else { vec![DVec3::new(90.0, -40.0, 20.0)] };
    Lighting { model, gradient, lights }
}

/// Scenes with pairwise different pictures, in groups with a common feature each.
fn groups() -> Vec<(&'static str, Vec<Scene>)> {
    let sampled = |sampling| Scene { sampling, ..base() };
    let shaded = |lighting| Scene { lighting, ..base() };
    let plain = Sampling::default();
    let filtered =
        |filter| Mode::ALL.map(|mode| Scene { sampling: Sampling { filter, ..plain }, ..of_mode(mode) }).to_vec();
    let counts = [1, 2, 16].map(|virtual_samples| sampled(Sampling { method: Method::Pcvs, virtual_samples, ..plain }));
    let filters = Filter::ALL.map(|filter| sampled(Sampling { filter, ..plain }));
    let models = LightingModel::ALL.map(|model| shaded(lit(model, Gradient::Central)));
    let gradients = Gradient::ALL.map(|gradient| shaded(lit(LightingModel::BlinnPhong, gradient)));
    let of_surface = |gradient| Scene { lighting: lit(LightingModel::Phong, gradient), ..of_mode(Mode::Isosurface) };
    // Steep parts, and a smoothly ending region: rounding would decide at an abrupt end.
    let by_gradient = |lighting| {
        let region = Region {
            shape: Shape::Gaussian,
            value: [60.0, 200.0],
            gradient: [0.0, 40.0],
            color: [1.0, 1.0, 0.2],
            opacity: 0.2,
        };
        let steep =
            TransferFunction { gradient_opacity: vec![[2.0, 0.0], [25.0, 1.0]], regions: vec![region], ..transfer() };
        Scene { lighting, layers: vec![steep.into()], ..base() }
    };
    let lightings = |model| Gradient::ALL.map(|gradient| by_gradient(lit(model, gradient)));
    let classified = [LightingModel::None, LightingModel::Tone].map(lightings).concat();
    let jitters = [Jitter::None, Jitter::White(3), Jitter::Blue].map(|jitter| sampled(Sampling { jitter, ..plain }));
    let layouts = StereoLayout::ALL.map(|layout| Scene { stereo: Some(Stereo::new(layout)), ..base() });
    let surfaces = [(100.0, 1.0), (131.0, 0.4)].map(|(value, opacity)| Isosurface { opacity, ..Isosurface::at(value) });
    let foggy = [Mode::Dvr, Mode::Isosurface].map(|mode| {
        let layer = SceneLayer { isosurfaces: surfaces.to_vec(), ..transfer().into() };
        Scene { mode, layers: vec![layer], ..base() }
    });
    vec![
        ("modes", Mode::ALL.map(of_mode).to_vec()),
        ("modes with splines", filtered(Filter::Tricubic)),
        ("modes with steps", filtered(Filter::Nearest)),
        ("methods", Method::ALL.map(|method| sampled(Sampling { method, ..plain })).to_vec()),
        ("virtual samples", counts.to_vec()),
        ("filters", filters.to_vec()),
        ("lighting models", models.to_vec()),
        ("gradients", gradients.to_vec()),
        ("gradients of a surface", Gradient::ALL.map(of_surface).to_vec()),
        ("gradients that opacity depends on, unlit and lit", classified),
        ("jitter", jitters.to_vec()),
        ("layouts", layouts.to_vec()),
        ("surfaces in fog and alone", foggy.to_vec()),
    ]
}

/// All scenes with their names.
fn named() -> (Vec<String>, Vec<Scene>) {
    let all = groups().into_iter().flat_map(|(group, scenes)| {
        scenes.into_iter().enumerate().map(move |(i, scene)| (format!("{group}, the {i}th"), scene))
    });
    all.unzip()
}

/// The oracle draws all scenes of some groups, and the CPU and each compositor some of all.
#[test]
fn every_way_to_look_is_the_oracle_s_by_every_way_to_draw() {
    let (test, groups) = (store(), groups());
    for i in sampled("groups", groups.len(), 3) {
        let (name, scenes) = &groups[i];
        let mut drawn: Vec<Picture> = Vec::new();
        for (i, scene) in scenes.iter().enumerate() {
            let picture = oracle(&test.store, scene, SIZE);
            assert!(!drawn.contains(&picture), "{name}: the oracle draws the {i}th as another");
            drawn.push(picture);
        }
    }
    let (names, scenes) = named();
    let mut expected: Vec<Option<Picture>> = vec![None; scenes.len()];
    for way in WAYS {
        let one_in = if way.0 == BackendChoice::Cpu { 2 } else { 4 };
        let Some(mut session) = session(&test.store, way) else { continue };
        for i in sampled(&format!("one layer, {way:?}"), names.len(), one_in) {
            let expected = expected[i].get_or_insert_with(|| oracle(&test.store, &scenes[i], SIZE));
            let (picture, _) = settled(&mut session, &scenes[i], SIZE);
            let same = if has_surfaces(&scenes[i]) { assert_same_surface } else { assert_same };
            same(&picture, expected, &format!("{}, {way:?}, seed {:x}", names[i], seed()));
        }
    }
}

fn has_surfaces(scene: &Scene) -> bool {
    scene.layers.iter().any(|layer| !layer.isosurfaces.is_empty())
}

/// The scene of one layer as `count` layers of two stores, in turn: unchanged, beside it, sheared and in other colours, and adding light,
/// repeatedly. Or of the first store alone, all in one place.
fn of_layers(scene: &Scene, (count, grids): (usize, Grids)) -> Scene {
    let Some(TransferChoice::Function(function)) = &scene.layers[0].transfer else { panic!("a function is given") };
    let color = vec![[0.0, 0.9, 0.1, 0.1], [255.0, 0.2, 0.3, 1.0]];
    let turned = TransferFunction { color, ..function.clone() };
    let layer = |i: usize| match i % 3 {
        0 => scene.layers[0].clone(),
        1 => {
            let aside = format!("0.9 -0.3 0 {}  0.3 1 0.1 {}  0 0 1.1 -3", 9 + i % 7, i % 5);
            let world_from_volume = Placement::from_text(&aside).expect("a map");
            SceneLayer { world_from_volume, ..turned.clone().into() }
        }
        _ => SceneLayer { blend: Some(Blend::Add), opacity: 0.4, ..function.clone().into() },
    };
    let placed = |i: usize| match grids {
        Grids::Unlike => SceneLayer { source: Some(i % 2), ..layer(i) },
        Grids::One => SceneLayer { source: Some(0), world_from_volume: Placement::default(), ..layer(i) },
    };
    // Where levels meet, cells of `sorted` do not always have a ray's side of a surface, even of one layer.
    let level = if grids == Grids::One && has_surfaces(scene) { LevelPolicy::Locked(0) } else { scene.level };
    Scene { layers: (0..count).map(placed).collect(), level, ..scene.clone() }
}

/// The layers' grids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Grids {
    Unlike,
    One,
}

/// Samples one in this many scenes with this number of layers by a way to draw, if any. (A software rasteriser takes seconds to compile a
/// shader of several layers.)
fn one_in((count, grids): (usize, Grids), (backend, compositor): Way) -> Option<usize> {
    match (count, grids, backend, compositor) {
        (_, Grids::One, BackendChoice::Cpu, _) => Some(3),
        (_, Grids::One, _, CompositorChoice::Sorted) => Some(8),
        (3, Grids::Unlike, BackendChoice::Cpu, _) => Some(2),
        (3, Grids::Unlike, _, CompositorChoice::Sorted) => Some(2),
        (3, Grids::Unlike, _, CompositorChoice::Compute) => Some(15),
        (3, Grids::Unlike, ..) => Some(10),
        (2, Grids::Unlike, BackendChoice::Cpu, _) => Some(4),
        (2, Grids::Unlike, _, CompositorChoice::Raycast) => Some(15),
        (_, Grids::Unlike, BackendChoice::Cpu, _) => Some(10),
        _ => None,
    }
}

/// Scenes of several layers: two stores of different grids, in turn, or one.
#[test]
fn layers_are_the_oracle_s_by_every_way_to_draw() {
    let other = |_, _, [x, y, z]: [u32; 3]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        ((0.5 + 0.3 * (0.21 * x - 0.35 * z).cos() + 0.19 * (0.4 * y).sin()) * 255.0) as u16
    };
    let wide = Geometry { spacing: DVec3::new(1.5, 1.1, 0.8), ..Geometry::default() };
    let stores = [store(), TestStore::pack(&FunctionSource::new(Extent::new(29, 34, 41), wide, other), 16)];
    let volumes: Vec<VolumeSource> = stores.iter().map(|test| VolumeSource::of_store(&test.store)).collect();
    let shown: Vec<&Store> = stores.iter().map(|test| &*test.store).collect();
    let (names, scenes) = named();
    let counts = [(3, Grids::Unlike), (3, Grids::One), (2, Grids::Unlike), (MAX_VOLUMES, Grids::Unlike)];
    for count in counts {
        let size = if count.0 == MAX_VOLUMES { (20, 16) } else { (40, 32) };
        let scenes: Vec<Scene> = scenes.iter().map(|scene| of_layers(scene, count)).collect();
        let mut expected: Vec<Option<Picture>> = vec![None; scenes.len()];
        for way in WAYS {
            let Some(one_in) = one_in(count, way) else { continue };
            let Some(mut session) = open_session_of(volumes.clone(), options(way, 256 << 20, 256 << 20)) else {
                continue;
            };
            for i in sampled(&format!("{count:?}, {way:?}"), names.len(), one_in) {
                let what = format!("{} of {count:?} layers, {way:?}, seed {:x}", names[i], seed());
                let scene = &scenes[i];
                let resolved = resolve(&volumes, scene, size).unwrap_or_else(|error| panic!("{what}: {error}"));
                if let Err(error) = session.resolve(scene, size) {
                    let takes_order = way.1 == CompositorChoice::Sorted && !scene.mode.is_projection();
                    let has_no_order = takes_order && count.1 == Grids::Unlike;
                    assert!(has_no_order && matches!(error, SessionError::NoOrder), "{what}: {error}");
                    continue;
                }
                let (picture, _) = settled(&mut session, scene, size);
                let expected = expected[i]
                    .get_or_insert_with(|| render_reference(&shown, &resolved, 1 << 30).expect("the levels"));
                let same = if has_surfaces(scene) { assert_same_surface } else { assert_same };
                same(&picture, expected, &what);
            }
        }
    }
}

/// Stores of few codes: a mask, counts in 16 bits with one outlier, or waves over 40 of the codes of 16 bits.
fn narrow_stores() -> [(&'static str, TestStore, [f64; 2]); 3] {
    let wave = |[x, y, z]: [u32; 3]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        0.5 + 0.25 * (0.41 * x + 0.13 * y).sin() + 0.24 * (0.33 * y - 0.29 * z).cos()
    };
    let mask = move |_, _, at| u8::from(wave(at) > 0.5);
    let counts = move |_, _, at| if at == [20, 18, 25] { 60_000u16 } else { (5.0 * wave(at)) as u16 };
    let stroke = move |_, _, at| (20.0 + 40.0 * (wave(at) - 0.5)) as i16;
    [
        ("a mask", TestStore::pack(&FunctionSource::new(EXTENT, geometry(), mask), 16), [0.2, 0.8]),
        ("counts and an outlier", TestStore::pack(&FunctionSource::new(EXTENT, geometry(), counts), 16), [0.5, 3.5]),
        ("a stroke's window", TestStore::pack(&FunctionSource::new(EXTENT, geometry(), stroke), 16), [5.0, 35.0]),
    ]
}

/// Windows of few codes: the values shown between two codes are stored nowhere.
#[test]
fn narrow_windows_are_the_oracle_s_by_every_way_to_draw() {
    for (name, test, [low, high]) in narrow_stores() {
        let at = |share: f64| low + (high - low) * share;
        let transfer = TransferFunction {
            color: vec![[at(0.0), 0.1, 0.2, 0.9], [at(0.5), 0.2, 0.9, 0.3], [at(1.0), 1.0, 0.6, 0.1]],
            opacity: vec![[at(0.0), 0.0], [at(0.3), 0.4], [at(0.6), 0.05], [at(1.0), 0.3]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        let scene = Scene { layers: vec![transfer.into()], ..base() };
        let of_method = |method| Scene { sampling: Sampling { method, ..Sampling::default() }, ..scene.clone() };
        let shaded = LightingModel::ALL.map(|model| Scene { lighting: lit(model, Gradient::Central), ..scene.clone() });
        let scenes: Vec<Scene> = Mode::ALL
            .map(|mode| in_mode(scene.clone(), mode, at(0.55)))
            .into_iter()
            .chain(Method::ALL.map(of_method))
            .chain(shaded)
            .collect();
        for way in WAYS {
            let one_in = if way.0 == BackendChoice::Cpu { 2 } else { 6 };
            let Some(mut session) = session(&test.store, way) else { continue };
            for i in sampled(&format!("{name}, {way:?}"), scenes.len(), one_in) {
                let (picture, _) = settled(&mut session, &scenes[i], SIZE);
                let same = if has_surfaces(&scenes[i]) { assert_same_surface } else { assert_same };
                let what = format!("{name}, the {i}th, {way:?}, seed {:x}", seed());
                same(&picture, &oracle(&test.store, &scenes[i], SIZE), &what);
            }
        }
    }
}
