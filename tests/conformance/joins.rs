//! Joined layers with a result known without an oracle: one layer through the shaders of several, halves of one, sums of
//! projections, in any order.

use crate::list::finest;
use crate::scenery::{look, scaled, u8_codes, waves};
use crate::shot::{Shot, assert_close, assert_telling};
use crate::stage::{ALL, COMPUTE, CPU, RAYCAST, SORTED, Stage, Way};
use crate::volume::Volume;
use brickyard::volume::*;
use brickyard_tests::sample::{draws, seed};
use glam::DVec3;
use std::sync::Arc;

const EXTENT: [u32; 3] = [35, 29, 37];

/// Two volumes on one grid.
fn pair() -> [Volume; 2] {
    let of = |field: &dyn Fn(DVec3) -> f64| {
        Volume::new(EXTENT, 16, Geometry::default(), u8_codes(), scaled(u8_codes(), field))
    };
    [of(&waves), of(&|p| waves(DVec3::new(p.z, p.x, p.y)))]
}

fn slanted_wall() -> ShownMesh {
    let corners = [[-9.0, 3.0, -9.0], [50.0, 10.0, -9.0], [50.0, 24.0, 60.0], [-9.0, 18.0, 60.0]];
    let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]], vec![], vec![]).expect("a mesh");
    ShownMesh { mesh: Arc::new(mesh), color: Some([0.1, 0.9, 0.4]), opacity: 0.6, lit: true }
}

fn transfer(hue: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, hue, 0.2, 1.0 - hue], [127.0, 1.0 - hue, 0.3, 0.1], [255.0, 0.4, 0.6, hue]],
        opacity: vec![[90.0, 0.0], [150.0, 0.05], [200.0, 0.4]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

fn frame(volume: &Volume, transfer: &TransferFunction) -> FrameSettings {
    let centre = DVec3::from_array(EXTENT.map(f64::from)) * 0.5;
    let rays = look(centre + DVec3::new(-50.0, -40.0, 45.0), centre, 42.0).rays(22, 18).expect("a camera");
    volume.frame(rays, transfer, Lattice::uniform(0.7, 0))
}

/// Practically in place, but outside its own world: the case for the shaders of several layers.
fn a_hair_away() -> Placement {
    Placement::from_text("1 0 0 1e-9  0 1 0 0  0 0 1 0").expect("a map")
}

fn mixed(settings: &FrameSettings) -> VolumeFrame {
    VolumeFrame { settings: settings.clone(), blend: Blend::Mix, opacity: 1.0 }
}

/// A stage with room for all these cases.
fn stage<'a>(volumes: &[&'a Volume]) -> Stage<'a> {
    let has_all = Needs { apron: 4, gradient_layers: 2, is_pre_integrated: true, has_grid: true, ..Needs::PLAIN };
    Stage::with_room(volumes, [Needs { meshes: MeshCapacity::of([&*slanted_wall().mesh]), ..has_all }])
}

/// A picture of all bricks; `None` without an adapter.
fn render(stage: &mut Stage<'_>, way: Way, frames: &[VolumeFrame]) -> Option<Picture> {
    let lists = stage.volumes.iter().zip(frames).map(|(volume, frame)| finest(volume, &frame.settings)).collect();
    Shot { frames: frames.to_vec(), lists, transfers: Vec::new(), combination: None, is_apart: false }
        .render(stage, way)
}

/// The light left in the cells of the last picture of such frames.
fn marks(stage: &mut Stage<'_>, way: Way, frame: &FrameSettings) -> Vec<f32> {
    let renderer = stage.renderer(way, &frame.needs());
    renderer.and_then(|renderer| renderer.visibility(0).map(<[f32]>::to_vec)).unwrap_or_default()
}

/// Frames of fog and surfaces in all their variety, a few differences at a time.
fn variety(volume: &Volume) -> Vec<FrameSettings> {
    let plain = frame(volume, &transfer(0.1));
    let lit = Lighting {
        model: LightingModel::Phong,
        gradient: Gradient::Sobel,
        lights: vec![DVec3::new(-30.0, 10.0, 40.0)],
    };
    let stored = Lighting { model: LightingModel::Tone, gradient: Gradient::Stored, lights: Vec::new() };
    let by_gradient = TransferFunction { gradient_opacity: vec![[1.0, 0.0], [9.0, 1.0], [18.0, 0.4]], ..transfer(0.1) };
    let surfaces = |opacity: f64| {
        let at = |value| Isosurface { value, color: Some([0.9, 0.8, 0.3]), opacity };
        Surface::all(&[at(110.0), at(160.0)], &transfer(0.1), &volume.encoding)
    };
    let lightings = [Lighting::default(), lit.clone(), stored.clone()].into_iter().cycle();
    let of_method = |(&method, lighting)| {
        let sampling = Sampling { method, ..Sampling::default() };
        FrameSettings { sampling, lighting, ..plain.clone() }
    };
    let mut all: Vec<FrameSettings> = Method::ALL.iter().zip(lightings).map(of_method).collect();
    let jitter = |jitter| FrameSettings { sampling: Sampling { jitter, ..Sampling::default() }, ..plain.clone() };
    all.extend([jitter(Jitter::Blue), jitter(Jitter::White(7))]);
    all.push(FrameSettings { meshes: vec![slanted_wall()], ..all[1].clone() });
    all.push(FrameSettings { surfaces: surfaces(0.5), meshes: vec![slanted_wall()], ..all[2].clone() });
    all.push(FrameSettings { mode: Mode::Isosurface, surfaces: surfaces(0.6), lighting: lit, ..plain.clone() });
    let table = Arc::new(TransferTable::new(&by_gradient, &volume.encoding));
    all.push(FrameSettings { table, lighting: stored, ..all[3].clone() });
    all
}

#[test]
fn one_layer_is_the_same_through_the_shaders_of_several() {
    let [volume, _] = pair();
    let mut stage = stage(&[&volume]);
    let frames = variety(&volume);
    for (way, few) in [(RAYCAST, frames.len()), (COMPUTE, 2), (SORTED, 4), (CPU, frames.len())] {
        for settings in frames.iter().rev().take(few) {
            let FrameSettings { mode, sampling, lighting, .. } = settings;
            let (surfaces, meshes) = (settings.surfaces.len(), settings.meshes.len());
            let what = format!("{way:?} {mode:?} {sampling:?} {lighting:?}, {surfaces} surfaces, {meshes} meshes");
            if !draws(&what, way) {
                continue;
            }
            let what = format!("{what}, seed {:x}", seed());
            let Some(alone) = render(&mut stage, way, &[mixed(settings)]) else { continue };
            let seen = marks(&mut stage, way, settings);
            let away = FrameSettings { placement: a_hair_away(), ..settings.clone() };
            let away = render(&mut stage, way, &[mixed(&away)]).expect("an adapter");
            assert_telling(&alone, &what);
            assert_close(&away, &alone, 0, &what);
            let away = marks(&mut stage, way, settings);
            assert!(seen.len() == away.len() && seen.is_empty() == (way == SORTED), "{what}: {} marks", seen.len());
            // Rays that graze a brick may find it empty by one way and miss it by the other.
            let off = seen.iter().zip(&away).filter(|(a, b)| (*a - *b).abs() > 0.05).count();
            assert!(off <= 2, "{what}: {off} marks");
        }
    }
}

#[test]
fn two_halves_are_a_whole() {
    let [volume, _] = pair();
    let (mut one, mut two) = (stage(&[&volume]), stage(&[&volume, &volume]));
    let thin = TransferFunction { unit_distance: 3.0, ..transfer(0.1) };
    let table = Arc::new(TransferTable::new(&thin, &volume.encoding));
    for settings in variety(&volume).iter().filter(|s| s.surfaces.is_empty() && s.grid().is_none()).take(3) {
        let half = mixed(&FrameSettings { table: table.clone(), ..settings.clone() });
        for way in [RAYCAST, SORTED, CPU] {
            let Some(whole) = render(&mut one, way, &[mixed(settings)]) else { continue };
            assert_telling(&whole, "a whole");
            let halves = render(&mut two, way, &[half.clone(), half.clone()]).expect("an adapter");
            assert_close(&halves, &whole, 0, &format!("halves, {way:?} {:?}", settings.sampling));
        }
    }
}

/// With surfaces in one of two layers, and the other turned.
#[test]
fn the_order_of_layers_does_not_show() {
    let [first, second] = pair();
    let (mut there, mut back) = (stage(&[&first, &second]), stage(&[&second, &first]));
    let surfaces = variety(&first).into_iter().find(|s| s.surfaces.len() == 2 && s.mode == Mode::Dvr).expect("one");
    let sampling = Sampling { method: Method::ALL[2], jitter: Jitter::White(3), ..Sampling::default() };
    let a = mixed(&FrameSettings { sampling, ..surfaces });
    let placement = Placement::from_text("0.8 -0.6 0 12  0.6 0.8 0 -9  0 0 1.1 1").expect("a map");
    let table = Arc::new(TransferTable::new(&transfer(0.8), &second.encoding));
    let settings = FrameSettings { surfaces: Vec::new(), placement, table, ..a.settings.clone() };
    for blend in [Blend::Mix, Blend::Add] {
        let b = VolumeFrame { settings: settings.clone(), blend, opacity: 1.0 };
        let mut pictures = Vec::new();
        for way in [RAYCAST, COMPUTE, CPU] {
            pictures.extend(render(&mut there, way, &[a.clone(), b.clone()]));
            pictures.extend(render(&mut back, way, &[b.clone(), a.clone()]));
        }
        for picture in &pictures[1..] {
            assert_telling(picture, "two layers");
            assert_close(picture, &pictures[0], 0, &format!("{blend:?}, in another order or by another renderer"));
        }
    }
}

#[test]
fn projections_are_joined_by_all() {
    let [first, second] = pair();
    let mut both = stage(&[&first, &second]);
    let mut singles = [stage(&[&first]), stage(&[&second])];
    // Turned and mirrored.
    let placement = Placement::from_text("-0.8 0.6 0 38  0.6 0.8 0 -9  0 0 1.1 1").expect("a map");
    for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
        let dark = |volume: &Volume, hue| FrameSettings { mode, background: [0.0; 3], ..frame(volume, &transfer(hue)) };
        let settings = [dark(&first, 0.1), FrameSettings { placement, ..dark(&second, 0.8) }];
        let mut joined = Vec::new();
        for way in ALL {
            let mut single = |i: usize| render(&mut singles[i], way, &[mixed(&settings[i])]);
            let (Some(a), Some(b)) = (single(0), single(1)) else { continue };
            let of =
                |opacity, blend| [0, 1].map(|i: usize| VolumeFrame { settings: settings[i].clone(), blend, opacity });
            let [sum, mean] = [of(0.6, Blend::Add), of(1.0, Blend::Mix)]
                .map(|frames| render(&mut both, way, &frames).expect("an adapter"));
            for (((a, b), sum), mean) in a.rgb.iter().zip(&b.rgb).zip(&sum.rgb).zip(&mean.rgb) {
                let is_both = a.iter().any(|&c| c > 0) && b.iter().any(|&c| c > 0);
                for k in 0..3 {
                    let all = a[k] as f64 + b[k] as f64;
                    // Three pictures were rounded.
                    let is_sum = ((0.6 * all).min(255.0) - sum[k] as f64).abs() <= 1.7;
                    let is_mean = (all * if is_both { 0.5 } else { 1.0 } - mean[k] as f64).abs() <= 1.1;
                    assert!(is_sum && is_mean, "{mode:?} {way:?}: {a:?} {b:?} {sum:?} {mean:?}");
                }
            }
            assert!(marks(&mut both, way, &settings[0]).is_empty());
            joined.push(mean);
        }
        for picture in &joined[1..] {
            assert_telling(picture, "two projections");
            assert_close(picture, &joined[0], 0, &format!("{mode:?}"));
        }
    }
}

/// One projection at half opacity, and one in front of a wall.
#[test]
fn a_projection_may_be_half_there() {
    let [volume, _] = pair();
    let (mut one, mut two) = (stage(&[&volume]), stage(&[&volume, &volume]));
    let settings = FrameSettings { mode: Mode::Mip, ..frame(&volume, &transfer(0.1)) };
    let behind = Picture::quantise(settings.background);
    let walled = FrameSettings { meshes: vec![slanted_wall()], ..settings.clone() };
    for way in [RAYCAST, CPU] {
        let Some(whole) = render(&mut one, way, &[mixed(&settings)]) else { continue };
        for (blend, share) in [(Blend::Mix, 0.5), (Blend::Add, 1.0), (Blend::Over, 0.5)] {
            let half = VolumeFrame { settings: settings.clone(), blend, opacity: 0.5 };
            let half = render(&mut one, way, &[half]).expect("an adapter");
            for (found, all) in half.rgb.iter().zip(&whole.rgb).filter(|(_, all)| **all != behind) {
                let expected = [0, 1, 2].map(|k: usize| (0.5 * all[k] as f64 + share * behind[k] as f64).min(255.0));
                let is_close = (0..3).all(|k| (expected[k] - found[k] as f64).abs() <= 1.1);
                assert!(is_close, "{way:?} {blend:?}: {found:?} {expected:?}");
            }
        }
        let alone = render(&mut one, way, &[mixed(&walled)]).expect("an adapter");
        let twice = render(&mut two, way, &[mixed(&walled), mixed(&walled)]).expect("an adapter");
        assert_telling(&alone, "slabs of a projection");
        assert_close(&twice, &alone, 0, &format!("slabs of projections, {way:?}"));
    }
}
