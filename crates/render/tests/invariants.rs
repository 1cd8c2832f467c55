//! Layers in one picture, where what has to come out is known without an oracle: one layer through the shaders of several, halves of
//! one, sums of projections, in any order and by every compositor.

#[allow(dead_code, reason = "other tests draw single volumes with it")]
mod bricks;

use bricks::{Bricks, Into, MEMORY_BYTES, RenderOne, missing::leave_out};
use brickyard_pager::{DrawList, Layer, Pixels, VolumeNeeds};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use glam::DVec3;
use std::sync::Arc;

const CONTRACT: u8 = 1;
const EXTENT: [u32; 3] = [35, 29, 37];

fn waves([x, y, z]: [u32; 3]) -> f64 {
    let (x, y, z) = (x as f64, y as f64, z as f64);
    0.5 + 0.5 * (0.21 * x + 0.05 * y).sin() * (0.17 * y - 0.1 * z).cos() * (0.13 * z + 0.4).sin()
}

fn slanted_wall() -> ShownMesh {
    let corners = [[-9.0, 3.0, -9.0], [50.0, 10.0, -9.0], [50.0, 24.0, 60.0], [-9.0, 18.0, 60.0]];
    let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]], vec![], vec![]).expect("a mesh");
    ShownMesh { mesh: Arc::new(mesh), color: Some([0.1, 0.9, 0.4]), opacity: 0.6, lit: true }
}

fn needs() -> Needs {
    let meshes = MeshRoom::of([&*slanted_wall().mesh]);
    let (is_pre_integrated, has_grid) = (true, true);
    Needs { apron: 4, gradient_layers: 2, is_pre_integrated, has_grid, meshes, ..Needs::PLAIN }
}

fn volume(value: impl Fn([u32; 3]) -> f64) -> Bricks {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let mut bricks = Bricks::new(EXTENT, 16, Geometry::default(), encoding, |voxel| 255.0 * value(voxel));
    bricks.needs = needs();
    bricks
}

fn transfer(hue: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, hue, 0.2, 1.0 - hue], [127.0, 1.0 - hue, 0.3, 0.1], [255.0, 0.4, 0.6, hue]],
        opacity: vec![[90.0, 0.0], [150.0, 0.05], [200.0, 0.4]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

fn frame(bricks: &Bricks, mode: Mode, transfer: &TransferFunction) -> FrameSettings {
    let centre = DVec3::from_array(EXTENT.map(f64::from)) * 0.5;
    let eye = centre + DVec3::new(-50.0, -40.0, 45.0);
    let projection = Projection::Perspective { fov_y_deg: 42.0 };
    let rays = Camera { eye, target: centre, up: DVec3::Z, projection }.rays(22, 18).expect("a camera");
    bricks.settings(rays, mode, transfer, Lattice::uniform(0.7, 0))
}

/// As good as where it was, but no longer in its own world: what the shaders of several layers are for.
fn a_hair_away() -> Placement {
    Placement::from_text("1 0 0 1e-9  0 1 0 0  0 0 1 0").expect("a map")
}

fn mixed(settings: &FrameSettings) -> VolumeFrame {
    VolumeFrame { settings: settings.clone(), blend: Blend::Mix, opacity: 1.0 }
}

/// Layers with all their bricks, and a compositor; `None`, said loudly, where there is no adapter at all.
struct Stage<'a> {
    renderer: GpuRenderer,
    volumes: Vec<&'a Bricks>,
    lists: Vec<DrawList>,
}

impl<'a> Stage<'a> {
    fn new(compositor: Compositor, volumes: &[&'a Bricks]) -> Option<Self> {
        let needs: Vec<VolumeNeeds> = volumes.iter().map(|volume| volume.volume_needs()).collect();
        let options = GpuOptions { compositor, ..Default::default() };
        let mut renderer = match GpuRenderer::new(&options, &needs, MEMORY_BYTES, (64, 64)) {
            Ok(renderer) => renderer,
            Err(GpuError::NoAdapter { .. }) => {
                leave_out("gpu", "nothing of the GPU backend was tested here");
                return None;
            }
            Err(other) => panic!("{other}"),
        };
        let mut lists = Vec::new();
        for (layer, volume) in volumes.iter().enumerate() {
            let rays = frame(volume, Mode::Dvr, &transfer(0.1)).rays;
            // All layers share one pool: the bricks of one lie between those of the others.
            let into = Into { layer: 0, first: layer as u32, step: volumes.len() as u32 };
            lists.push(volume.draw_fading(&mut renderer, into, &rays, &|_| false, &|_| vec![(0, Pixels::ALL)]));
        }
        Some(Self { renderer, volumes: volumes.to_vec(), lists })
    }

    fn try_render(&mut self, frames: &[VolumeFrame]) -> Result<Picture, GpuError> {
        let all = (0..).zip(frames).zip(&self.volumes).zip(&self.lists);
        let layers: Vec<_> = all
            .map(|(((number, frame), volume), draw)| Layer {
                volume: number,
                frame,
                pyramid: &volume.pyramid,
                draw,
                cut: 0,
            })
            .collect();
        self.renderer.render(&layers, None)
    }

    fn render(&mut self, frames: &[VolumeFrame]) -> Picture {
        self.try_render(frames).expect("a picture")
    }
}

fn assert_close(what: &str, found: &Picture, expected: &Picture) {
    let colors: std::collections::BTreeSet<_> = expected.rgb.iter().collect();
    assert!(colors.len() > 20, "{what}: a flat picture proves nothing");
    let difference = found.difference(expected);
    assert!(difference.max <= CONTRACT, "{what}: {difference:?}");
}

/// All ways in which a frame of fog and surfaces can differ, a few at a time.
fn variety(volume: &Bricks) -> Vec<FrameSettings> {
    let plain = frame(volume, Mode::Dvr, &transfer(0.1));
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
    let mut all: Vec<FrameSettings> = Method::ALL
        .iter()
        .zip([Lighting::default(), lit.clone(), stored.clone()].into_iter().cycle())
        .map(|(&method, lighting)| {
            let sampling = Sampling { method, ..Sampling::default() };
            FrameSettings { sampling, lighting, ..plain.clone() }
        })
        .collect();
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
    let volume = volume(waves);
    for compositor in [Compositor::Raycast, Compositor::Compute, Compositor::Sorted] {
        let Some(mut stage) = Stage::new(compositor, &[&volume]) else { return };
        let frames = variety(&volume);
        let few = match compositor {
            Compositor::Raycast => frames.len(),
            Compositor::Compute => 2,
            Compositor::Sorted => 4,
        };
        for settings in frames.iter().rev().take(few) {
            let alone = stage.render(&[mixed(settings)]);
            let seen = stage.renderer.visibility(0).map(<[f32]>::to_vec);
            let away = stage.render(&[mixed(&FrameSettings { placement: a_hair_away(), ..settings.clone() })]);
            let what = format!(
                "{compositor:?} {:?} {:?} {:?}, {} surfaces, {} meshes",
                settings.mode,
                settings.sampling,
                settings.lighting,
                settings.surfaces.len(),
                settings.meshes.len()
            );
            assert_close(&what, &away, &alone);
            let away = stage.renderer.visibility(0).map(<[f32]>::to_vec);
            let pairs = seen.iter().flatten().zip(away.iter().flatten());
            let is_marked = compositor != Compositor::Sorted && stage.renderer.adapter().feedback;
            assert!(pairs.clone().count() > 4 || !is_marked, "{what}: nothing was marked");
            // Rays that graze a brick may find it empty by the one way and pass it by the other.
            let off = pairs.filter(|(a, b)| (*a - *b).abs() > 0.05).count();
            assert!(off <= 2, "{what}: {off} marks");
        }
    }
}

#[test]
fn two_halves_are_a_whole_in_any_order_and_unlike_layers_too() {
    let (first, second) = (volume(waves), volume(|[x, y, z]| waves([z, x, y])));
    let Some(mut one) = Stage::new(Compositor::Raycast, &[&first]) else { return };
    let ways = [Compositor::Raycast, Compositor::Sorted];
    let Some(mut halves) = ways.into_iter().map(|way| Stage::new(way, &[&first, &first])).collect::<Option<Vec<_>>>()
    else {
        return;
    };
    let method = Method::ALL[2];
    for settings in variety(&first).iter().filter(|s| s.surfaces.is_empty() && s.grid().is_none()).take(3) {
        let whole = one.render(&[mixed(settings)]);
        let thin = TransferFunction { unit_distance: 3.0, ..transfer(0.1) };
        let table = Arc::new(TransferTable::new(&thin, &first.encoding));
        let half = mixed(&FrameSettings { table, ..settings.clone() });
        for halves in &mut halves {
            let what = format!("halves, {:?}", halves.renderer.compositor());
            assert_close(&what, &halves.render(&[half.clone(), half.clone()]), &whole);
        }
    }
    let surfaces = variety(&first).into_iter().find(|s| s.surfaces.len() == 2 && s.mode == Mode::Dvr).expect("one");
    let sampling = Sampling { method, jitter: Jitter::White(3), ..Sampling::default() };
    let a = mixed(&FrameSettings { sampling, ..surfaces.clone() });
    let placement = Placement::from_text("0.8 -0.6 0 12  0.6 0.8 0 -9  0 0 1.1 1").expect("a map");
    let base = FrameSettings { surfaces: Vec::new(), placement, ..a.settings.clone() };
    let table = Arc::new(TransferTable::new(&transfer(0.8), &second.encoding));
    for blend in [Blend::Mix, Blend::Add] {
        let b = VolumeFrame { settings: FrameSettings { table: table.clone(), ..base.clone() }, blend, opacity: 1.0 };
        let mut pictures = Vec::new();
        for compositor in [Compositor::Raycast, Compositor::Compute] {
            let Some(mut there) = Stage::new(compositor, &[&first, &second]) else { return };
            let Some(mut back) = Stage::new(compositor, &[&second, &first]) else { return };
            pictures.push(there.render(&[a.clone(), b.clone()]));
            pictures.push(back.render(&[b.clone(), a.clone()]));
        }
        for picture in &pictures[1..] {
            assert_close(&format!("{blend:?}, in another order or by another shader"), picture, &pictures[0]);
        }
    }
    let Some(mut sorted) = Stage::new(Compositor::Sorted, &[&first, &second]) else { return };
    assert!(
        matches!(sorted.try_render(&[a, mixed(&base)]), Err(GpuError::Mismatch(problem)) if problem.contains("sorted"))
    );
}

#[test]
fn projections_are_joined_by_every_compositor() {
    let (first, second) = (volume(waves), volume(|[x, y, z]| waves([z, x, y])));
    // Turned and mirrored.
    let placement = Placement::from_text("-0.8 0.6 0 38  0.6 0.8 0 -9  0 0 1.1 1").expect("a map");
    for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
        let dark = |volume: &Bricks, hue: f64| {
            let mut dark = frame(volume, mode, &transfer(hue));
            dark.background = [0.0; 3];
            dark
        };
        let settings = [dark(&first, 0.1), FrameSettings { placement, ..dark(&second, 0.8) }];
        let mut joined = Vec::new();
        for compositor in [Compositor::Sorted, Compositor::Raycast, Compositor::Compute] {
            let Some(mut both) = Stage::new(compositor, &[&first, &second]) else { return };
            let singles = [&first, &second].into_iter().zip(&settings).map(|(volume, settings)| {
                Stage::new(compositor, &[volume]).expect("an adapter").render(&[mixed(settings)])
            });
            let singles: Vec<Picture> = singles.collect();
            let of =
                |opacity, blend| [0, 1].map(|i: usize| VolumeFrame { settings: settings[i].clone(), blend, opacity });
            let sum = both.render(&of(0.6, Blend::Add));
            let mean = both.render(&of(1.0, Blend::Mix));
            for (i, (&[a, b], (sum, mean))) in singles[0]
                .rgb
                .iter()
                .zip(&singles[1].rgb)
                .map(|(a, b)| [a, b])
                .collect::<Vec<_>>()
                .iter()
                .zip(sum.rgb.iter().zip(&mean.rgb))
                .enumerate()
            {
                for k in 0..3 {
                    let added = 0.6 * (a[k] as f64 + b[k] as f64);
                    assert!(
                        (added.min(255.0) - sum[k] as f64).abs() <= 1.7,
                        "{mode:?} {compositor:?} {i}: {a:?} {b:?} {sum:?}"
                    );
                }
                let is_both = a.iter().any(|&c| c > 0) && b.iter().any(|&c| c > 0);
                let half = [0, 1, 2].map(|k: usize| (a[k] as f64 + b[k] as f64) * if is_both { 0.5 } else { 1.0 });
                assert!((0..3).all(|k| (half[k] - mean[k] as f64).abs() <= 1.1), "{mode:?} {i}: {a:?} {b:?} {mean:?}");
            }
            assert!(both.renderer.visibility(0).is_none());
            joined.push(mean);
        }
        for picture in &joined[1..] {
            assert_close(&format!("{mode:?}"), picture, &joined[0]);
        }
    }
}

/// One projection that is half there, in front of a wall.
#[test]
fn a_projection_may_be_half_there() {
    let volume = volume(waves);
    let Some(mut one) = Stage::new(Compositor::Raycast, &[&volume]) else { return };
    let settings = frame(&volume, Mode::Mip, &transfer(0.1));
    let whole = one.render(&[mixed(&settings)]);
    let behind = Picture::quantise(settings.background);
    for (blend, share) in [(Blend::Mix, 0.5), (Blend::Add, 1.0)] {
        let half = one.render(&[VolumeFrame { settings: settings.clone(), blend, opacity: 0.5 }]);
        for (found, all) in half.rgb.iter().zip(&whole.rgb).filter(|(_, all)| **all != behind) {
            let expected = [0, 1, 2].map(|k: usize| (0.5 * all[k] as f64 + share * behind[k] as f64).min(255.0));
            assert!((0..3).all(|k| (expected[k] - found[k] as f64).abs() <= 1.1), "{blend:?}: {found:?} {expected:?}");
        }
    }
    let walled = FrameSettings { meshes: vec![slanted_wall()], ..settings };
    let alone = one.renderer.render_one(&walled, &volume.pyramid, &one.lists[0]).expect("a picture");
    let Some(mut twice) = Stage::new(Compositor::Raycast, &[&volume, &volume]) else { return };
    assert_close("slabs of projections", &twice.render(&[mixed(&walled), mixed(&walled)]), &alone);
}
