//! Every sampling method, filter and lighting against the oracle, through bricks of several sizes: what they all have in common
//! with a plain picture is in `pictures.rs`.

mod bricks;

use bricks::Volume;
use brickyard_volume::*;
use glam::DVec3;

/// In 1/255: rounding of sums.
const TOLERANCE: u8 = 1;

fn transfer((low, high): (f64, f64)) -> TransferFunction {
    let at = |code: u32| low + code as f64 / 255.0 * (high - low);
    TransferFunction {
        color: vec![[at(25), 0.9, 0.1, 0.2], [at(127), 0.1, 1.0, 0.3], [at(230), 0.2, 0.3, 1.0]],
        opacity: vec![[at(76), 0.0], [at(127), 0.08], [at(178), 0.02], [at(190), 0.3], [at(255), 0.9]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

/// The same where the field is steep, and a region besides. All of it is smooth: the oracle has no table.
fn by_gradient((low, high): (f64, f64)) -> TransferFunction {
    let code = (high - low) / 255.0;
    let region = Region {
        shape: Shape::Gaussian,
        value: [low + 40.0 * code, low + 200.0 * code],
        gradient: [0.0, 14.0 * code],
        color: [1.0, 0.9, 0.1],
        opacity: 0.15,
    };
    let gradient_opacity = vec![[code, 0.0], [9.0 * code, 1.0], [16.0 * code, 0.4]];
    TransferFunction { gradient_opacity, regions: vec![region], ..transfer((low, high)) }
}

fn blobs(p: DVec3) -> f64 {
    let wave = (p.x * 0.31).sin() + (p.y * 0.23 + 1.0).sin() + (p.z * 0.37 + p.x * 0.1).cos();
    (wave / 6.0 + 0.5).clamp(0.0, 1.0)
}

fn frame(volume: &Volume, sampling: Sampling, lighting: Lighting, step: f64) -> FrameSettings {
    let range = (volume.encoding.low, volume.encoding.high);
    frame_of(volume, &transfer(range), sampling, lighting, step)
}

fn frame_of(
    volume: &Volume,
    transfer: &TransferFunction,
    sampling: Sampling,
    lighting: Lighting,
    step: f64,
) -> FrameSettings {
    let projection = Projection::Perspective { fov_y_deg: 45.0 };
    let eye = DVec3::new(-40.0, -25.0, 60.0);
    let camera = Camera { eye, target: DVec3::new(20.0, 18.0, 22.0), up: DVec3::Z, projection };
    FrameSettings {
        rays: camera.rays(24, 20).unwrap(),
        lattice: Lattice::uniform(step, 0),
        geometry: Geometry { spacing: DVec3::new(1.0, 0.9, 1.1), ..Geometry::default() },
        placement: Placement::default(),
        encoding: volume.encoding,
        table: TransferTable::new(transfer, &volume.encoding).into(),
        mode: Mode::Dvr,
        surfaces: Vec::new(),
        sampling,
        lighting,
        background: [0.1, 0.2, 0.35],
        clip: None,
        meshes: Vec::new(),
    }
}

fn lightings() -> Vec<Lighting> {
    let mut all = vec![Lighting::default()];
    for gradient in Gradient::ALL {
        all.push(Lighting { model: LightingModel::BlinnPhong, gradient, lights: Vec::new() });
        all.push(Lighting { model: LightingModel::Phong, gradient, lights: vec![DVec3::new(-30.0, 10.0, 40.0)] });
    }
    let lights = vec![DVec3::new(90.0, 10.0, 40.0), DVec3::new(0.0, -50.0, -20.0)];
    all.push(Lighting { model: LightingModel::Tone, gradient: Gradient::Central, lights });
    all
}

/// Draws with the oracle and through bricks, and compares.
fn agree(volume: &Volume, frame: &FrameSettings, expected: &mut Option<Picture>, what: &str) {
    let cut = volume.cut(&frame.rays, &frame.geometry, &|_, _| true);
    let range = (volume.encoding.low, volume.encoding.high);
    let transfer = if frame.table.grid.is_some() { by_gradient(range) } else { transfer(range) };
    let expected = expected.get_or_insert_with(|| volume.reference(frame, &cut, &transfer));
    let found = volume.render(frame, &cut, 2);
    let difference = found.difference(expected);
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
    let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
    let allowed = match frame.mode {
        // The gradient of a surface in a segment that is longer than a voxel may reach out of the apron.
        Mode::Isosurface if frame.lattice.step > 1.0 => found.rgb.len() / 100,
        // A place has a value if half of the weight is valid: where it is just half, rounding decides, and with it a gradient.
        _ if frame.encoding.has_invalid && frame.table.grid.is_some() => 1,
        _ => 0,
    };
    assert!(off <= allowed, "{what}: {off} pixels, {difference:?}");
    let colors: std::collections::BTreeSet<_> = found.rgb.iter().collect();
    assert!(colors.len() > 60, "{what}: a flat picture proves nothing");
}

/// In bricks of several sizes, the last of which holds all of it.
fn volumes(encoding: SlotEncoding, value: impl Fn(DVec3) -> f64) -> [Volume; 4] {
    [16, 32, 64, 128].map(|edge| Volume::new(Extent::new(70, 37, 45), DVec3::ONE, edge, encoding, &value))
}

#[test]
fn every_method_filter_and_lighting_matches_the_oracle_in_bricks_of_any_size() {
    let volumes = volumes(SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false), |p| 255.0 * blobs(p));
    for (method, transfer) in methods((0.0, 255.0)) {
        for filter in Filter::ALL {
            for lighting in lightings() {
                let sampling = Sampling { method, filter, ..Sampling::default() };
                let frame = frame_of(&volumes[0], &transfer, sampling, lighting, 0.8);
                let mut expected = None;
                for volume in &volumes {
                    let what = format!("{sampling:?} {:?} in {}", frame.lighting, volume.pyramid.edge());
                    agree(volume, &frame, &mut expected, &what);
                }
            }
        }
    }
}

/// Each method with a function of values, and those that can with one of values and gradients.
fn methods(range: (f64, f64)) -> Vec<(Method, TransferFunction)> {
    let mut all: Vec<_> = Method::ALL.into_iter().map(|method| (method, transfer(range))).collect();
    let sampled = Method::ALL.into_iter().filter(|method| !method.is_pre_integrated());
    all.extend(sampled.map(|method| (method, by_gradient(range))));
    all
}

#[test]
fn invalid_voxels_and_wide_codes_match_the_oracle() {
    let mut encoding = SlotEncoding::new(VoxelType::F32, (-1.0, 3.0), true);
    encoding.has_invalid = true;
    let hole = |p: DVec3| (p - DVec3::new(20.0, 15.0, 22.0)).length() < 7.0;
    let volumes = volumes(encoding, |p| if hole(p) { f64::NAN } else { -1.0 + 4.0 * blobs(p) });
    let lit = Lighting { model: LightingModel::BlinnPhong, ..Lighting::default() };
    let stored = Lighting { gradient: Gradient::Stored, ..lit.clone() };
    let (linear, cubic) = (Filter::Trilinear, Filter::Tricubic);
    for (method, transfer) in methods((-1.0, 3.0)) {
        for (filter, lighting) in [(linear, Lighting::default()), (cubic, lit.clone()), (linear, stored.clone())] {
            let sampling = Sampling { method, filter, ..Sampling::default() };
            let frame = frame_of(&volumes[0], &transfer, sampling, lighting, 0.8);
            let mut expected = None;
            for volume in &volumes[..2] {
                let (edge, is_by_gradient) = (volume.pyramid.edge(), frame.table.grid.is_some());
                let what = format!("{sampling:?} {:?} in {edge}, by gradient: {is_by_gradient}", frame.lighting);
                agree(volume, &frame, &mut expected, &what);
            }
        }
    }
}

#[test]
fn other_modes_are_filtered_alike() {
    let volumes = volumes(SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false), |p| 255.0 * blobs(p));
    for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
        let sampling = Sampling { filter: Filter::Tricubic, ..Sampling::default() };
        let frame = FrameSettings { mode, ..frame(&volumes[0], sampling, Lighting::default(), 0.8) };
        let mut expected = None;
        for volume in &volumes {
            agree(volume, &frame, &mut expected, &format!("{mode:?} in {}", volume.pyramid.edge()));
        }
    }
}

/// A faint surface, a clear one of the same kind as nothing, and one that hides what is behind it.
fn surfaces(encoding: &SlotEncoding) -> Vec<Surface> {
    let at = |code: f64| encoding.low + code / 255.0 * (encoding.high - encoding.low);
    let faint = Isosurface { value: at(105.0), color: Some([0.2, 1.0, 0.4]), opacity: 0.3 };
    let half = Isosurface { value: at(150.5), color: None, opacity: 0.5 };
    let solid = Isosurface { value: at(215.0), color: Some([1.0, 0.9, 0.2]), opacity: 1.0 };
    Surface::all(&[solid, faint, half], &transfer((encoding.low, encoding.high)), encoding)
}

#[test]
fn surfaces_in_fog_and_alone_match_the_oracle_in_bricks_of_any_size() {
    let lit = lightings();
    let hole = |p: DVec3| (p - DVec3::new(20.0, 15.0, 22.0)).length() < 7.0;
    let mut with_hole = SlotEncoding::new(VoxelType::F32, (-1.0, 3.0), true);
    with_hole.has_invalid = true;
    let whole = volumes(SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false), |p| 255.0 * blobs(p));
    let holed = volumes(with_hole, |p| if hole(p) { f64::NAN } else { -1.0 + 4.0 * blobs(p) });
    let mut pictures = std::collections::BTreeSet::new();
    for volumes in [whole, holed] {
        let range = (volumes[0].encoding.low, volumes[0].encoding.high);
        let [plain, steep] = [transfer(range), by_gradient(range)];
        for (mode, transfer, method, filter, lighting, step) in [
            (Mode::Isosurface, &plain, Method::Udvr, Filter::Trilinear, 0, 0.8),
            (Mode::Isosurface, &steep, Method::Udvr, Filter::Tricubic, 4, 0.8),
            (Mode::Dvr, &plain, Method::Udvr, Filter::Trilinear, 0, 0.8),
            (Mode::Dvr, &plain, Method::Udvr, Filter::Tricubic, 2, 0.5),
            (Mode::Dvr, &plain, Method::Plvs, Filter::Trilinear, 3, 0.8),
            (Mode::Dvr, &plain, Method::Pcvs, Filter::Trilinear, 1, 0.8),
            (Mode::Dvr, &plain, Method::Asm, Filter::Trilinear, 5, 0.8),
            (Mode::Dvr, &steep, Method::Udvr, Filter::Trilinear, 0, 0.8),
            (Mode::Dvr, &steep, Method::Cvs, Filter::Trilinear, 3, 0.8),
        ] {
            let sampling = Sampling { method, filter, ..Sampling::default() };
            let plain = frame_of(&volumes[0], transfer, sampling, lit[lighting].clone(), step);
            let frame = FrameSettings { mode, surfaces: surfaces(&volumes[0].encoding), ..plain };
            let mut expected = None;
            for volume in &volumes {
                let cut = volume.cut(&frame.rays, &frame.geometry, &|_, _| true);
                let expected = expected.get_or_insert_with(|| volume.reference(&frame, &cut, transfer));
                let found = volume.render(&frame, &cut, 2);
                let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
                let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
                // Where a ray grazes a surface, or a place has just half of its weight, rounding decides.
                assert!(off <= 2, "{mode:?} {method:?} {filter:?} in {}: {off}", volume.pyramid.edge());
                pictures.insert(found.rgb);
            }
        }
    }
    assert!(pictures.len() >= 18, "all show the same");
}

/// The surface that a mode has.
fn surface_of(mode: Mode) -> Vec<Surface> {
    let surface = Surface { threshold: 131.0, color: [0.3, 1.0, 0.2], opacity: 1.0 };
    if mode == Mode::Isosurface { vec![surface] } else { Vec::new() }
}

#[test]
fn jittered_pictures_match_the_oracle_in_bricks_of_any_size() {
    let volumes = volumes(SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false), |p| 255.0 * blobs(p));
    let lit =
        Lighting { model: LightingModel::Phong, lights: vec![DVec3::new(-30.0, 10.0, 40.0)], ..Lighting::default() };
    for jitter in [Jitter::White(3), Jitter::Blue] {
        for (mode, method, lighting) in [
            (Mode::Dvr, Method::Udvr, Lighting::default()),
            (Mode::Dvr, Method::Pcvs, lit.clone()),
            (Mode::Dvr, Method::Asm, Lighting::default()),
            (Mode::Mip, Method::Udvr, Lighting::default()),
            (Mode::Average, Method::Udvr, Lighting::default()),
            (Mode::Isosurface, Method::Udvr, Lighting::default()),
        ] {
            let sampling = Sampling { method, jitter, ..Sampling::default() };
            let plain = frame(&volumes[0], sampling, lighting, 1.7);
            // In one zone, and with zones that start amid the volume; a surface, in short segments instead.
            let zones = match mode {
                Mode::Isosurface => Lattice::uniform(0.6, 0),
                _ => Lattice::for_view(0.9, 1.0, &plain.rays, 0.25, 3),
            };
            for lattice in [plain.lattice, zones] {
                let frame = FrameSettings { mode, surfaces: surface_of(mode), lattice, ..plain.clone() };
                let mut expected = None;
                for volume in &volumes {
                    let what = format!("{mode:?} {sampling:?} in {}", volume.pyramid.edge());
                    agree(volume, &frame, &mut expected, &what);
                }
                let still = Sampling { jitter: Jitter::None, ..sampling };
                let cut = volumes[0].cut(&frame.rays, &frame.geometry, &|_, _| true);
                let other = volumes[0].render(&FrameSettings { sampling: still, ..frame }, &cut, 2);
                // A surface is found where it is, wherever the ends of segments are.
                if mode != Mode::Isosurface {
                    assert_ne!(Some(other), expected, "{mode:?} {jitter:?} moves the lattice");
                }
            }
        }
    }
}

#[test]
fn jittered_pictures_scatter_about_the_truth() {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let volume = Volume::new(Extent::new(41, 37, 45), DVec3::ONE, 64, encoding, |p| 255.0 * blobs(p));
    let draw = |method, jitter, step| {
        let sampling = Sampling { method, jitter, ..Sampling::default() };
        let frame = frame(&volume, sampling, Lighting::default(), step);
        let cut = volume.cut(&frame.rays, &frame.geometry, &|_, _| true);
        volume.render(&frame, &cut, 2).rgb.into_flattened().into_iter().map(f64::from).collect::<Vec<f64>>()
    };
    let truth = draw(Method::Pdvr, Jitter::None, 0.05);
    let rms = |picture: &[f64]| {
        let squares: f64 = picture.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum();
        (squares / truth.len() as f64).sqrt()
    };
    let errors = [4.0, 2.0, 1.0].map(|step| {
        let pictures: Vec<Vec<f64>> = (0..16).map(|seed| draw(Method::Udvr, Jitter::White(seed), step)).collect();
        let mean = |i: usize| pictures.iter().map(|picture| picture[i]).sum::<f64>() / pictures.len() as f64;
        let mean: Vec<f64> = (0..truth.len()).map(mean).collect();
        (rms(&pictures[0]), rms(&mean))
    });
    // What a mean has wrong is what opacity makes of scatter: it goes with the square of the step, down to the rounding of the truth.
    assert!(errors.iter().all(|(one, mean)| mean < one), "{errors:?}");
    assert!(errors[0].0 > 2.0 && errors[1].1 < 0.7 * errors[0].1 && errors[2].1 < 0.5, "{errors:?}");
}
