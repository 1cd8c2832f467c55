//! Every sampling method, filter and lighting against the oracle, by both compositors: what they all have in common with a plain
//! picture is in `pictures.rs`.

mod bricks;

use bricks::{Bricks, RenderOne};
use brickyard_volume::*;
use glam::DVec3;

/// The project's contract. Slots hold exactly the oracle's values; what is left is f32 against f64.
const CONTRACT: u8 = 1;

/// Smooth, without symmetry, between 0 and 1.
fn waves([x, y, z]: [u32; 3]) -> f64 {
    let (x, y, z) = (x as f64, y as f64, z as f64);
    0.5 + 0.5 * (0.21 * x + 0.05 * y).sin() * (0.17 * y - 0.1 * z).cos() * (0.13 * z + 0.4).sin()
}

/// Points lie on codes: the oracle has no table.
fn tinted(encoding: &SlotEncoding) -> TransferFunction {
    let at = |code: u32| encoding.low + code as f64 / 255.0 * (encoding.high - encoding.low);
    TransferFunction {
        color: vec![[at(0), 0.0, 0.2, 1.0], [at(127), 1.0, 0.3, 0.1], [at(255), 0.9, 1.0, 0.5]],
        opacity: vec![[at(90), 0.0], [at(150), 0.05], [at(200), 0.4]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

/// The same where the field is steep, and a region besides. All of it is smooth: the oracle has no table.
fn by_gradient(encoding: &SlotEncoding) -> TransferFunction {
    let code = (encoding.high - encoding.low) / 255.0;
    let region = Region {
        shape: Shape::Gaussian,
        value: [encoding.low + 40.0 * code, encoding.low + 200.0 * code],
        gradient: [0.0, 16.0 * code],
        color: [1.0, 0.9, 0.1],
        opacity: 0.15,
    };
    let gradient_opacity = vec![[code, 0.0], [9.0 * code, 1.0], [18.0 * code, 0.4]];
    TransferFunction { gradient_opacity, regions: vec![region], ..tinted(encoding) }
}

fn bricks(
    extent: [u32; 3],
    edge: u32,
    encoding: SlotEncoding,
    needs: Needs,
    value: impl Fn([u32; 3]) -> f64,
) -> Bricks {
    let geometry = Geometry { spacing: DVec3::new(1.0, 0.8, 1.3), origin: DVec3::new(5.0, -20.0, 3.0), unit: None };
    let scaled = |voxel| encoding.low + (encoding.high - encoding.low) * value(voxel);
    let mut bricks = Bricks::new(extent, edge, geometry, encoding, scaled);
    bricks.needs = needs;
    bricks
}

fn frame(bricks: &Bricks, sampling: Sampling, lighting: Lighting) -> FrameSettings {
    frame_of(bricks, &tinted(&bricks.encoding), sampling, lighting)
}

fn frame_of(bricks: &Bricks, transfer: &TransferFunction, sampling: Sampling, lighting: Lighting) -> FrameSettings {
    let (low, high) = bricks.geometry.world_box(bricks.pyramid.levels()[0].extent);
    let centre = (low + high) * 0.5;
    let eye = centre + DVec3::new(-50.0, -40.0, 45.0);
    let projection = Projection::Perspective { fov_y_deg: 40.0 };
    let rays = Camera { eye, target: centre, up: DVec3::Z, projection }.rays(22, 18).unwrap();
    let plain = bricks.settings(rays, Mode::Dvr, transfer, Lattice::uniform(0.7, 0));
    FrameSettings { sampling, lighting, ..plain }
}

fn lightings() -> [Lighting; 5] {
    let light = DVec3::new(-30.0, 10.0, 40.0);
    let lit = |model, gradient, lights: &[DVec3]| Lighting { model, gradient, lights: lights.to_vec() };
    [
        Lighting::default(),
        lit(LightingModel::BlinnPhong, Gradient::Central, &[]),
        lit(LightingModel::Phong, Gradient::Sobel, &[light]),
        lit(LightingModel::Tone, Gradient::Central, &[light, DVec3::new(90.0, 10.0, 40.0)]),
        lit(LightingModel::BlinnPhong, Gradient::Stored, &[light]),
    ]
}

/// None, and one of values and one of stored gradients.
fn few_lightings() -> [Lighting; 3] {
    let [unlit, central, _, _, stored] = lightings();
    [unlit, central, stored]
}

/// One picture of all bricks by both compositors, against the oracle: all pixels but so many.
fn agree(bricks: &Bricks, frames: &[FrameSettings], off: usize) {
    let [plain, steep] = [tinted(&bricks.encoding), by_gradient(&bricks.encoding)];
    let mut expected = vec![None; frames.len()];
    for mut renderer in bricks.renderers() {
        for (frame, expected) in frames.iter().zip(&mut expected) {
            let list = bricks.draw(&mut renderer, &frame.rays, &|_| false, &|_| 0);
            let found = renderer.render_one(frame, &bricks.pyramid, &list).unwrap();
            let transfer = if frame.table.grid.is_some() { &steep } else { &plain };
            let expected = expected.get_or_insert_with(|| bricks.reference(frame, &list, transfer));
            let difference = found.difference(expected);
            let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > CONTRACT);
            let count = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
            let what = format!("{:?} {:?} {:?}", renderer.compositor(), frame.sampling, frame.lighting);
            assert!(count <= off, "{what}: {count} pixels, {difference:?}");
            let colors: std::collections::BTreeSet<_> = found.rgb.iter().collect();
            assert!(colors.len() > 60, "{what}: a flat picture proves nothing");
        }
    }
}

/// The bricks that these frames need at most, with the frames.
fn all_frames(filter: Filter, make: impl Fn(Needs) -> Bricks, lightings: &[Lighting]) -> (Bricks, Vec<FrameSettings>) {
    let bricks =
        make(Needs { apron: 4, gradient_layers: 2, filter, is_pre_integrated: true, has_grid: true, ..Needs::PLAIN });
    let methods = Method::ALL.iter().map(|&method| Sampling { method, filter, ..Sampling::default() });
    let looks = methods.flat_map(|sampling| lightings.iter().map(move |lighting| (sampling, lighting.clone())));
    let frames = looks.map(|(sampling, lighting)| frame(&bricks, sampling, lighting)).collect();
    (bricks, frames)
}

#[test]
fn every_method_and_lighting_matches_the_oracle() {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let make = |needs| bricks([35, 29, 37], 16, encoding, needs, waves);
    let (bricks, frames) = all_frames(Filter::Trilinear, make, &lightings());
    agree(&bricks, &frames, 0);
}

#[test]
fn every_method_matches_the_oracle_with_splines() {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let make = |needs| bricks([35, 29, 37], 16, encoding, needs, waves);
    let (bricks, mut frames) = all_frames(Filter::Tricubic, make, &few_lightings());
    for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
        frames.push(FrameSettings { mode, ..frames[0].clone() });
    }
    agree(&bricks, &frames, 0);
}

#[test]
fn every_method_matches_the_oracle_with_invalid_voxels_in_wide_codes() {
    let encoding = SlotEncoding::new(VoxelType::F32, (-1.0, 3.0), true);
    let value = |voxel: [u32; 3]| {
        let [x, y, z] = voxel.map(|v| v as f64 - 17.0);
        if x * x + y * y + z * z < 40.0 { f64::NAN } else { waves(voxel) }
    };
    for filter in Filter::ALL {
        let make = |needs| bricks([35, 29, 37], 16, encoding, needs, value);
        let (bricks, frames) = all_frames(filter, make, &few_lightings());
        // A place has a value if half of the weight is valid: where it is just half, rounding decides.
        agree(&bricks, &frames, 1);
    }
}

/// The same rays through bricks of other sizes, with what their own needs ask for and no more.
#[test]
fn bricks_of_other_sizes_show_the_same() {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    for (method, filter, has_grid) in [
        (Method::Pcvs, Filter::Trilinear, false),
        (Method::Cvs, Filter::Tricubic, false),
        (Method::Asm, Filter::Trilinear, false),
        (Method::Plvs, Filter::Tricubic, false),
        (Method::Udvr, Filter::Trilinear, true),
        (Method::Cvs, Filter::Tricubic, true),
    ] {
        let sampling = Sampling { method, filter, ..Sampling::default() };
        let [unlit, _, sobel, _, stored] = lightings();
        for lighting in [unlit, sobel, stored] {
            for edge in [8, 32, 64] {
                let needs = Needs::new(Mode::Dvr, sampling, &lighting, false, has_grid);
                let bricks = bricks([35, 29, 37], edge, encoding, needs, waves);
                let transfer = if has_grid { by_gradient(&encoding) } else { tinted(&encoding) };
                agree(&bricks, &[frame_of(&bricks, &transfer, sampling, lighting.clone())], 0);
            }
        }
    }
}

/// Surfaces, translucent and not, in fog of several kinds and alone, by both compositors.
#[test]
fn surfaces_in_fog_and_alone_match_the_oracle() {
    let whole = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let wide = SlotEncoding::new(VoxelType::F32, (-1.0, 3.0), true);
    let hole = |voxel: [u32; 3]| {
        let [x, y, z] = voxel.map(|v| v as f64 - 17.0);
        if x * x + y * y + z * z < 40.0 { f64::NAN } else { waves(voxel) }
    };
    for (encoding, filter, edges) in
        [(whole, Filter::Trilinear, &[16, 64][..]), (wide, Filter::Trilinear, &[16]), (whole, Filter::Tricubic, &[16])]
    {
        for &edge in edges {
            let needs =
                Needs { apron: 4, gradient_layers: 1, filter, is_pre_integrated: true, has_grid: true, ..Needs::PLAIN };
            let value = |voxel: [u32; 3]| if encoding.has_invalid { hole(voxel) } else { waves(voxel) };
            let bricks = bricks([35, 29, 37], edge, encoding, needs, value);
            let at = |code: f64| encoding.low + code / 255.0 * (encoding.high - encoding.low);
            let faint = Isosurface { value: at(105.0), color: Some([0.2, 1.0, 0.4]), opacity: 0.3 };
            let half = Isosurface { value: at(150.5), color: None, opacity: 0.5 };
            let solid = Isosurface { value: at(190.0), color: Some([1.0, 0.9, 0.2]), opacity: 1.0 };
            let surfaces = Surface::all(&[solid, faint, half], &tinted(&encoding), &encoding);
            let (lit, [plain, steep]) = (lightings(), [tinted(&encoding), by_gradient(&encoding)]);
            let frames: Vec<_> = [
                (Mode::Isosurface, &plain, Method::Udvr, &lit[0]),
                (Mode::Isosurface, &steep, Method::Udvr, &lit[2]),
                (Mode::Dvr, &plain, Method::Udvr, &lit[0]),
                (Mode::Dvr, &plain, Method::Plvs, &lit[1]),
                (Mode::Dvr, &plain, Method::Pcvs, &lit[0]),
                (Mode::Dvr, &plain, Method::Asm, &lit[3]),
                (Mode::Dvr, &steep, Method::Udvr, &lit[0]),
                (Mode::Dvr, &steep, Method::Lvs, &lit[1]),
                (Mode::Isosurface, &plain, Method::Udvr, &lit[4]),
                (Mode::Dvr, &plain, Method::Udvr, &lit[4]),
                (Mode::Dvr, &steep, Method::Udvr, &lit[4]),
            ]
            .into_iter()
            .map(|(mode, transfer, method, lighting)| {
                let sampling = Sampling { method, filter, ..Sampling::default() };
                let plain = frame_of(&bricks, transfer, sampling, lighting.clone());
                FrameSettings { mode, surfaces: surfaces.clone(), ..plain }
            })
            .collect();
            // Where a ray grazes a surface, or a place has just half of its weight, rounding decides.
            agree(&bricks, &frames, 2);
        }
    }
}

/// The surface that a mode has.
fn surface_of(mode: Mode) -> Vec<Surface> {
    let surface = Surface { threshold: 131.0, color: [0.3, 1.0, 0.2], opacity: 1.0 };
    if mode == Mode::Isosurface { vec![surface] } else { Vec::new() }
}

#[test]
fn jittered_pictures_match_the_oracle() {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let needs = Needs { apron: 4, is_pre_integrated: true, has_grid: true, ..Needs::PLAIN };
    for needs in [needs, Needs { is_pre_integrated: false, ..needs }] {
        let bricks = bricks([35, 29, 37], 16, encoding, needs, waves);
        let mut frames = Vec::new();
        for jitter in [Jitter::White(0), Jitter::White(99), Jitter::Blue] {
            let method = if needs.is_pre_integrated { Method::Plvs } else { Method::Asm };
            let sampling = |method| Sampling { method, jitter, ..Sampling::default() };
            frames.push(frame(&bricks, sampling(method), lightings()[2].clone()));
            for mode in Mode::ALL {
                let frame = frame(&bricks, sampling(Method::Udvr), Lighting::default());
                frames.push(FrameSettings { mode, surfaces: surface_of(mode), ..frame.clone() });
                // Zones that start amid the volume.
                let lattice = Lattice::for_view(0.9, 1.0, &frame.rays, 0.25, 3);
                frames.push(FrameSettings { mode, surfaces: surface_of(mode), lattice, ..frame });
            }
        }
        agree(&bricks, &frames, 0);
    }
}
