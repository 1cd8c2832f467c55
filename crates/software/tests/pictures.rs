//! Pictures against the oracle and against formulas.
//!
//! `brickyard_reference` renders in f64 from whole arrays. Renderer and oracle take the same samples; f32 interpolation,
//! opacity and sums leave less than a tenth of a picture's step, and rounding to 8 bits turns that into at most one step:
//! hence the tolerance of 1 throughout.

mod bricks;

use bricks::{CutCell, Volume};
use brickyard_pager::{DrawCell, DrawList, Pixels};
use brickyard_volume::*;
use glam::DVec3;
use proptest::prelude::*;

const TOLERANCE: u8 = 1;

fn u8_codes() -> SlotEncoding {
    SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false)
}

/// Colours and opacity that change quickly, with a clear stretch and a jump. Points lie on whole 8-bit codes of the range,
/// where the table is exact (the oracle has no table).
fn vivid((low, high): (f64, f64)) -> TransferFunction {
    let at = |code: u32| low + code as f64 / 255.0 * (high - low);
    TransferFunction {
        color: vec![[at(25), 0.9, 0.1, 0.2], [at(127), 0.1, 1.0, 0.3], [at(230), 0.2, 0.3, 1.0]],
        opacity: vec![[at(76), 0.0], [at(127), 0.08], [at(178), 0.02], [at(179), 0.3], [at(255), 0.9]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

/// Blobs between 0 and 1 in voxel space.
fn blobs(p: DVec3) -> f64 {
    let wave = (p.x * 0.31).sin() + (p.y * 0.23 + 1.0).sin() + (p.z * 0.37 + p.x * 0.1).cos();
    (wave / 6.0 + 0.5).clamp(0.0, 1.0)
}

struct View {
    camera: Camera,
    geometry: Geometry,
    mode: Mode,
    step: f64,
    size: [u32; 2],
    pixel_error: f64,
}

impl View {
    fn new(eye: [f64; 3], target: [f64; 3]) -> Self {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let camera = Camera { eye: eye.into(), target: target.into(), up: DVec3::new(0.1, 0.2, 1.0), projection };
        // An error of a hundredth of a pixel keeps all of the lattice in zone 0.
        Self { camera, geometry: Geometry::default(), mode: Mode::Dvr, step: 0.7, size: [40, 33], pixel_error: 0.01 }
    }

    fn frame(&self, volume: &Volume, transfer: &TransferFunction) -> FrameSettings {
        let rays = self.camera.rays(self.size[0], self.size[1]).unwrap();
        let voxel_size = self.geometry.voxel_size(volume.pyramid.levels()[0].extent);
        let step = self.step * voxel_size;
        let levels = volume.pyramid.levels().len();
        FrameSettings {
            rays,
            lattice: Lattice::for_view(step, voxel_size, &rays, self.pixel_error, levels),
            geometry: self.geometry.clone(),
            placement: Placement::default(),
            encoding: volume.encoding,
            table: TransferTable::new(transfer, &volume.encoding).into(),
            mode: self.mode,
            surfaces: match self.mode {
                Mode::Isosurface => surface_at(transfer.color[transfer.color.len() / 2][0], transfer, volume),
                _ => Vec::new(),
            },
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            background: [0.1, 0.2, 0.35],
            clip: None,
            meshes: Vec::new(),
        }
    }
}

fn surface_at(isovalue: f64, transfer: &TransferFunction, volume: &Volume) -> Vec<Surface> {
    Surface::all(&[Isosurface::at(isovalue)], transfer, &volume.encoding)
}

/// How many pixels are past the tolerance.
fn pixels_off(found: &Picture, expected: &Picture) -> usize {
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
    found.rgb.iter().zip(&expected.rgb).filter(is_off).count()
}

/// Renders all modes and compares with the oracle.
fn agree(volume: &Volume, view: &mut View, transfer: &TransferFunction, cut: &dyn Fn(&FrameSettings) -> Vec<CutCell>) {
    for mode in Mode::ALL {
        view.mode = mode;
        let frame = view.frame(volume, transfer);
        let cut = cut(&frame);
        let found = volume.render(&frame, &cut, 2);
        let expected = volume.reference(&frame, &cut, transfer);
        let d = found.difference(&expected);
        let off = pixels_off(&found, &expected);
        match mode {
            // Whether a ray that grazes a surface meets it is a matter of rounding. Where segments are longer than voxels,
            // bricks take those of neighbours, which may be of another level.
            Mode::Isosurface => {
                let per_mille = if view.pixel_error > 1.0 { 40 } else { 2 };
                assert!(off * 1000 <= per_mille * found.rgb.len(), "{off} pixels {:?}: {d:?}", view.camera);
            }
            _ => assert_eq!(off, 0, "{mode:?} {:?}: {d:?}", view.camera),
        }
        let background = Picture::quantise(frame.background);
        assert!(found.rgb.iter().any(|&p| p != background), "nothing in view proves nothing");
    }
}

fn finest(volume: &Volume) -> impl Fn(&FrameSettings) -> Vec<CutCell> {
    |frame| volume.cut(&frame.rays, &frame.geometry, &|_, _| true)
}

#[test]
fn all_modes_match_the_oracle_from_everywhere() {
    let volume = Volume::new(Extent::new(41, 37, 45), DVec3::ONE, 16, u8_codes(), |p| 255.0 * blobs(p));
    let transfer = vivid((0.0, 255.0));
    let views = [
        ([-40.0, -25.0, 60.0], [20.0, 18.0, 22.0]), // outside
        ([19.3, 21.1, 24.7], [40.0, 3.0, 11.0]),    // inside a brick
        ([15.5, 15.5, 31.5], [30.0, 31.5, 15.5]),   // at a corner of eight bricks
        ([-20.0, 15.5, 15.5], [20.0, 15.5, 15.5]),  // along the edges of bricks
        ([10.0, -0.5, -30.0], [10.0, -0.5, 40.0]),  // grazing a face of the volume
        ([60.0, 20.0, 20.0], [20.0, 20.1, 20.0]),
    ];
    for (eye, target) in views {
        agree(&volume, &mut View::new(eye, target), &transfer, &finest(&volume));
    }
}

/// Pixel by pixel, a brick that fades in is drawn as if it were there, or as if it were not.
#[test]
fn a_fade_has_each_pixel_of_one_picture_or_the_other() {
    let volume = Volume::new(Extent::new(41, 37, 45), DVec3::ONE, 16, u8_codes(), |p| 255.0 * blobs(p));
    let transfer = vivid((0.0, 255.0));
    // Outside, and inside a brick.
    for (share, (eye, target)) in
        [20, 32].into_iter().zip([([-40.0, -25.0, 60.0], [20.0, 18.0, 22.0]), ([19.3, 21.1, 24.7], [40.0, 3.0, 11.0])])
    {
        for mode in Mode::ALL {
            let frame = View { mode, ..View::new(eye, target) }.frame(&volume, &transfer);
            let coarser = |own: CutCell| CutCell { drawn: Level(1), ..own };
            let fades = |own: &CutCell| (own.index.x + 2 * own.index.y + own.index.z) % 3 == 1;
            let with_ancestors = |own: CutCell| if fades(&own) { vec![coarser(own), own] } else { vec![own] };
            let cells: Vec<CutCell> = finest(&volume)(&frame).into_iter().flat_map(with_ancestors).collect();
            let (mut renderer, whole) = volume.load(&cells, &frame, 2);
            // Where a cell has two entries: none in these pixels, or the rest of them.
            let fading = |own: Pixels| {
                let is_alone = |entry: &DrawCell| whole.cells.iter().filter(|e| e.cell == entry.cell).count() == 1;
                let before = Pixels { from: own.to, ..Pixels::ALL };
                let cells = whole.cells.iter().filter_map(|entry| {
                    let pixels = match entry.cell == entry.brick {
                        _ if is_alone(entry) => Pixels::ALL,
                        true => own,
                        false => before,
                    };
                    (pixels.from < pixels.to).then_some(DrawCell { pixels, ..*entry })
                });
                DrawList { cells: cells.collect() }
            };
            let after = Pixels { to: share, ..Pixels::ALL };
            let [fine, coarse, found] = [Pixels::ALL, Pixels { to: 0, ..Pixels::ALL }, after]
                .map(|own| volume.draw(&mut renderer, &frame, &fading(own)));
            assert!(fine != coarse, "{mode:?}: this proves nothing");
            let occludes = matches!(mode, Mode::Dvr | Mode::Isosurface);
            assert_eq!(renderer.visibility(0).map(<[f32]>::len), occludes.then_some(cells.len()));
            for (i, found) in found.rgb.iter().enumerate() {
                let (x, y) = (i as u32 % fine.width, i as u32 / fine.width);
                // The same sums in the same order.
                assert_eq!(found, if after.hold(x, y) { &fine.rgb[i] } else { &coarse.rgb[i] }, "{mode:?} {x} {y}");
            }
        }
    }
}

#[test]
fn orthographic_rays_along_an_axis_have_zero_components() {
    let volume = Volume::new(Extent::new(40, 33, 35), DVec3::ONE, 16, u8_codes(), |p| 255.0 * blobs(p));
    // Pixels are one voxel wide and an even number of them is centred on a brick boundary, then half a pixel off it: rays
    // between bricks, along voxel centres, and along voxel faces.
    for shift in [0.0, 0.25, 0.5] {
        for (axis, up) in [(DVec3::X, DVec3::Z), (DVec3::Y, DVec3::X), (DVec3::Z, DVec3::Y), (-DVec3::X, DVec3::Y)] {
            let target = DVec3::splat(15.5 + shift);
            let mut view = View::new([0.0; 3], [1.0; 3]);
            let projection = Projection::Orthographic { height: 40.0 };
            view.camera = Camera { eye: target - axis * 60.0, target, up, projection };
            view.size = [40, 40];
            agree(&volume, &mut view, &vivid((0.0, 255.0)), &finest(&volume));
        }
    }
    // An orthographic camera inside sees what is ahead of its plane.
    let mut view = View::new([20.0, 15.0, 12.0], [30.0, 31.0, 14.0]);
    view.camera.projection = Projection::Orthographic { height: 25.0 };
    agree(&volume, &mut view, &vivid((0.0, 255.0)), &finest(&volume));
}

#[test]
fn anisotropic_odd_volumes_match_the_oracle() {
    let geometry = Geometry { spacing: DVec3::new(0.5, 0.7, 2.1), origin: DVec3::new(-3.0, 100.0, 7.0), unit: None };
    let volume = Volume::new(Extent::new(51, 37, 13), geometry.spacing, 8, u8_codes(), |p| 255.0 * blobs(p));
    let (low, high) = geometry.world_box(volume.pyramid.levels()[0].extent);
    let mut view = View::new([0.0; 3], [1.0; 3]);
    view.geometry = geometry;
    view.camera = Camera { projection: view.camera.projection, ..Camera::looking_at_box((low, high)) };
    agree(&volume, &mut view, &vivid((0.0, 255.0)), &finest(&volume));
    let slice = Volume::new(Extent::new(51, 37, 1), view.geometry.spacing, 8, u8_codes(), |p| 255.0 * blobs(p));
    agree(&slice, &mut view, &vivid((0.0, 255.0)), &finest(&slice));
}

#[test]
fn sixteen_bits_match_the_oracle() {
    let encoding = SlotEncoding::new(VoxelType::I16, (0.0, 1.0), false);
    let value = |p: DVec3| -1000.0 + 3000.0 * blobs(p);
    let volume = Volume::new(Extent::new(33, 40, 29), DVec3::ONE, 16, encoding, value);
    // The volume uses 3,000 of 65,536 codes: the table must be looked up to a fraction of one.
    agree(&volume, &mut View::new([-30.0, 50.0, 40.0], [15.0; 3]), &vivid((-1000.0, 2000.0)), &finest(&volume));
}

#[test]
fn invalid_voxels_match_the_oracle() {
    let encoding = SlotEncoding::new(VoxelType::F32, (0.0, 1.0), true);
    let hole = |p: DVec3| (p - DVec3::new(14.0, 17.0, 12.0)).length() < 7.3 || p.x > 26.0 && p.y > 20.0;
    let value = |p: DVec3| if hole(p) { f64::NAN } else { blobs(p) };
    let volume = Volume::new(Extent::new(33, 30, 29), DVec3::ONE, 16, encoding, value);
    agree(&volume, &mut View::new([-30.3, 50.1, 40.7], [15.0; 3]), &vivid((0.0, 1.0)), &finest(&volume));
    let nothing = Volume::new(Extent::new(9, 9, 9), DVec3::ONE, 16, encoding, |_| f64::NAN);
    for mode in Mode::ALL {
        let view = View { mode, ..View::new([-30.0, 5.0, 4.0], [4.0; 3]) };
        let frame = view.frame(&nothing, &vivid((0.0, 1.0)));
        let picture = nothing.render(&frame, &finest(&nothing)(&frame), 1);
        let background = Picture::quantise(frame.background);
        assert!(picture.rgb.iter().all(|&p| p == background), "{mode:?}");
    }
}

#[test]
fn mixed_levels_and_stand_ins_match_the_oracle() {
    let volume = Volume::new(Extent::new(75, 61, 70), DVec3::ONE, 16, u8_codes(), |p| 255.0 * blobs(p * 0.5));
    // Finer towards the origin's corner, and of the finest cells every third is drawn with an ancestor.
    let cut = |frame: &FrameSettings| {
        let near_corner = |level: Level, i: BrickIndex| (i.x + i.y + i.z) << level.0 < 4;
        let mut cells = volume.cut(&frame.rays, &frame.geometry, &near_corner);
        for (i, cell) in cells.iter_mut().enumerate() {
            if cell.level.0 == 0 && i % 3 == 0 {
                cell.drawn = Level(1 + (i % 2) as u8);
            }
        }
        let levels: std::collections::BTreeSet<_> = cells.iter().map(|c| c.drawn).collect();
        assert!(levels.len() >= 3, "{levels:?}");
        cells
    };
    // With an error of 3 pixels the lattice has several zones in view; with 0.01 one.
    for pixel_error in [0.01, 3.0, 0.3] {
        for (eye, target) in [([-20.0, -35.0, 60.0], [37.0, 30.0, 35.0]), ([20.0, 20.0, 20.0], [40.0, 45.0, 30.0])] {
            let mut view = View { pixel_error, ..View::new(eye, target) };
            agree(&volume, &mut view, &vivid((0.0, 255.0)), &cut);
        }
    }
}

#[test]
fn a_constant_medium_is_beer_lambert_whatever_steps_and_bricks() {
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 0.5, 0.0]],
        opacity: vec![[0.0, 0.06]],
        unit_distance: 2.0,
        ..TransferFunction::default()
    };
    let n = 48;
    for edge in [8, 16, 48] {
        let volume = Volume::new(Extent::new(n, n, n), DVec3::ONE, edge, u8_codes(), |_| 77.0);
        for step in [0.23, 1.0, 3.7, 40.0, 1000.0] {
            let view = View { step, ..View::new([-50.0, -30.0, 70.0], [24.0; 3]) };
            let frame = view.frame(&volume, &transfer);
            let found = volume.render(&frame, &finest(&volume)(&frame), 2);
            for (x, y) in (0..view.size[1]).flat_map(|y| (0..view.size[0]).map(move |x| (x, y))) {
                let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
                let (low, high) = frame.geometry.world_box(Extent::new(n, n, n));
                let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
                let length = (a.max(b).min_element() - a.min(b).max_element()).max(0.0);
                let passed = 0.94f64.powf(length / 2.0);
                let color = [1.0, 0.5, 0.0].map(|c| (1.0 - passed) * c);
                let color = std::array::from_fn(|k| color[k] as f32 + passed as f32 * frame.background[k]);
                let expected = Picture::quantise(color);
                let found = found.pixel(x, y);
                let off = (0..3).map(|k| found[k].abs_diff(expected[k])).max().unwrap();
                assert!(off <= TOLERANCE, "edge {edge} step {step} ({x}, {y}): {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn the_picture_does_not_depend_on_how_space_is_cut() {
    let transfer = vivid((0.0, 255.0));
    for mode in Mode::ALL {
        let picture = |edge: u32| {
            let volume = Volume::new(Extent::new(61, 64, 57), DVec3::ONE, edge, u8_codes(), |p| 255.0 * blobs(p));
            let mut view = View { mode, ..View::new([-40.0, -25.0, 60.0], [30.0; 3]) };
            view.size = [96, 80];
            let frame = view.frame(&volume, &transfer);
            volume.render(&frame, &finest(&volume)(&frame), 2)
        };
        let whole = picture(64);
        for edge in [16, 32] {
            // Positions are rounded relative to other bricks: to 2^-18 of a voxel, so to one step of the picture.
            let found = picture(edge);
            let d = found.difference(&whole);
            match mode {
                Mode::Isosurface => assert!(pixels_off(&found, &whole) <= 5, "{edge}: {d:?}"),
                _ => assert!(d.max <= 1 && d.psnr_db > 60.0, "{mode:?} {edge}: {d:?}"),
            }
        }
    }
}

/// A ball, of which only the bricks are there that its surface is in. Whatever the step, every ray that is longer inside than
/// two steps meets it. (Between voxels the ball is up to 0.02 thinner; half a chord of 1 is that deep.)
#[test]
fn surfaces_have_no_pinholes() {
    let (n, radius) = (64, 23.4);
    let centre = DVec3::splat(0.5 * n as f64 + 0.3);
    let encoding = SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false);
    let value = |p: DVec3| 30000.0 - 500.0 * (p - centre).length();
    let volume = Volume::new(Extent::new(n, n, n), DVec3::ONE, 16, encoding, value);
    let isovalue = 30000.0 - 500.0 * radius;
    let transfer = vivid((0.0, 65535.0));
    for (step, tilt) in [(0.3, 0.1), (1.0, 0.0), (1.0, 0.3), (1.9, 0.2), (3.0, 0.1)] {
        // Voxel (i, j, k) has its centre there in the world, and half a voxel higher in voxel space.
        let target = centre - 0.5;
        let eye = target + DVec3::new(-90.0, 40.0 * tilt, 60.0 * tilt);
        let mut view = View { mode: Mode::Isosurface, step, ..View::new(eye.into(), target.into()) };
        view.camera.projection = Projection::Orthographic { height: 60.0 };
        view.size = [160, 160];
        let surfaces = vec![Surface { threshold: isovalue, color: [1.0; 3], opacity: 1.0 }];
        let frame = FrameSettings { surfaces, ..view.frame(&volume, &transfer) };
        let all = finest(&volume)(&frame);
        let mut cells = all.clone();
        cells.retain(|c| {
            let low = DVec3::from_array(c.index.to_array().map(|i| 16.0 * i as f64)) - centre - 0.5;
            let high = low + 17.0;
            let nearest = low.max(-high).max(DVec3::ZERO).length();
            nearest < radius && low.abs().max(high.abs()).length() > radius
        });
        assert!(cells.len() < all.len());
        let found = volume.render(&frame, &cells, 2);
        let mut met = 0;
        for (x, y) in (0..160).flat_map(|y| (0..160).map(move |x| (x, y))) {
            let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
            let to = target - ray.origin;
            let distance = (to - ray.direction * to.dot(ray.direction)).length();
            if radius.powi(2) - distance.powi(2) > step.powi(2) + 1.0 {
                met += 1;
                assert_ne!(found.pixel(x, y), Picture::quantise(frame.background), "step {step}: a hole at {x}, {y}");
            }
        }
        assert!(met > 8000, "{met}");
        let off = pixels_off(&found, &volume.reference(&frame, &all, &transfer));
        // Longer steps than voxels reach so far out of a brick that gradients there are one-sided.
        assert!(off <= if step > 1.0 { 200 } else { 0 }, "step {step}, tilt {tilt}: {off} pixels");
    }
}

/// Where all voxels have just the isovalue, rounding makes no speckles.
#[test]
fn a_plateau_at_the_isovalue_is_inside() {
    let value = |p: DVec3| if p.x < 17.0 { 60.0 } else { 90.0 };
    let volume = Volume::new(Extent::new(40, 40, 40), DVec3::ONE, 16, u8_codes(), value);
    // From inside of the plateau nothing is met but its end.
    for (target, is_met) in [([39.0, 21.0, 19.0], false), ([0.0, 21.0, 19.0], true)] {
        let view = View { mode: Mode::Isosurface, ..View::new([30.0, 20.0, 20.0], target) };
        let transfer = vivid((0.0, 255.0));
        let surfaces = surface_at(90.0, &transfer, &volume);
        let frame = FrameSettings { surfaces, ..view.frame(&volume, &transfer) };
        let picture = volume.render(&frame, &finest(&volume)(&frame), 2);
        let met = picture.rgb.iter().filter(|&&p| p != Picture::quantise(frame.background)).count();
        assert_eq!(met, if is_met { picture.rgb.len() } else { 0 });
    }
}

#[test]
fn the_picture_does_not_depend_on_threads() {
    let volume = Volume::new(Extent::new(61, 64, 57), DVec3::ONE, 16, u8_codes(), |p| 255.0 * blobs(p));
    let transfer = vivid((0.0, 255.0));
    for mode in Mode::ALL {
        let view = View { mode, ..View::new([-40.0, -25.0, 60.0], [30.0; 3]) };
        let frame = view.frame(&volume, &transfer);
        let picture = |threads| volume.render(&frame, &finest(&volume)(&frame), threads);
        assert_eq!(picture(1), picture(3), "{mode:?}");
    }
}

#[test]
fn turning_the_camera_about_a_symmetric_volume_turns_the_picture() {
    let n = 40;
    let centre = DVec3::splat(n as f64 * 0.5);
    // Unchanged by a quarter turn about z, and different along x and the diagonals.
    let value = |p: DVec3| {
        let q = p - centre;
        let wave = (q.x * 0.5).cos() + (q.y * 0.5).cos() + 0.2 * (q.x * q.x * q.y * q.y * 0.001).sin();
        60.0 * (wave + 2.1 + 0.02 * q.z)
    };
    let volume = Volume::new(Extent::new(n, n, n), DVec3::ONE, 16, u8_codes(), value);
    let transfer = vivid((0.0, 255.0));
    let target = centre - 0.5;
    let render = |eye: DVec3, up: DVec3| {
        let mut view = View::new([0.0; 3], [1.0; 3]);
        view.camera = Camera { eye: target + eye, target, up, ..view.camera };
        view.size = [48, 48];
        let frame = view.frame(&volume, &transfer);
        volume.render(&frame, &finest(&volume)(&frame), 2)
    };
    let front = render(DVec3::new(61.0, 13.0, 22.0), DVec3::Z);
    let orbited = render(DVec3::new(-13.0, 61.0, 22.0), DVec3::Z);
    let d = front.difference(&orbited);
    assert!(d.max <= TOLERANCE, "orbit: {d:?}");
    assert!(front.difference(&render(DVec3::new(13.0, 61.0, 22.0), DVec3::Z)).max > 20, "the view must matter");
    // From above, rolling the camera by a quarter turn leaves the picture, which turns with the volume; tilted, it turns.
    let upright = render(DVec3::new(5.0, 3.0, 70.0), DVec3::Y);
    let rolled = render(DVec3::new(5.0, 3.0, 70.0), DVec3::X);
    let rays = |up| Camera {
        eye: DVec3::new(5.0, 3.0, 70.0),
        target: DVec3::ZERO,
        up,
        ..View::new([0.0; 3], [1.0; 3]).camera
    };
    let (a, b) = (rays(DVec3::Y).rays(48, 48).unwrap(), rays(DVec3::X).rays(48, 48).unwrap());
    assert!(a.right.dot(b.up) > 0.99 * a.right.length_squared(), "up is where right was");
    let turned = Picture {
        rgb: (0..48).flat_map(|y| (0..48).map(move |x| (x, y))).map(|(x, y)| rolled.pixel(y, 47 - x)).collect(),
        ..rolled.clone()
    };
    // The two cameras' up axes are not quite a quarter turn apart (0.2 degrees): compare on average.
    assert!(upright.difference(&turned).psnr_db > 35.0, "{:?}", upright.difference(&turned));
    assert!(upright.difference(&rolled).psnr_db < 25.0, "the roll must matter: {:?}", upright.difference(&rolled));
}

/// Whether a pixel's ray runs along an edge of the volume, so that rounding alone decides whether they meet.
fn grazes(frame: &FrameSettings, volume: &Volume, x: u32, y: u32) -> bool {
    let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
    let (low, high) = frame.geometry.world_box(volume.pyramid.levels()[0].extent);
    let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
    (a.max(b).min_element() - a.min(b).max_element().max(0.0)).abs() < 1e-9
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// A medium where every sample weighs the same: a gap or a double anywhere changes the colour.
    #[test]
    fn cells_partition_every_ray(
        eye in prop::array::uniform3(-40i32..80), toward in prop::array::uniform3(0i32..40), step in 0.1f64..9.0,
        orthographic: bool, pixel_error in prop::sample::select(vec![0.01, 1.0, 4.0]), seed in 0u32..1000,
    ) {
        // Whole and half coordinates put rays along faces, edges and corners.
        let at = |v: [i32; 3]| v.map(|c| c as f64 * 0.5);
        prop_assume!(eye != toward);
        let volume = Volume::new(Extent::new(24, 17, 31), DVec3::ONE, 8, u8_codes(), |_| 128.0);
        let transfer = TransferFunction { color: vec![[0.0; 4], [255.0, 1.0, 1.0, 1.0]], opacity: vec![[0.0, 0.02]], unit_distance: 1.0, ..TransferFunction::default() };
        let mut view = View { step, pixel_error, ..View::new(at(eye), at(toward)) };
        view.size = [16, 16];
        if orthographic {
            view.camera.projection = Projection::Orthographic { height: 16.0 };
            view.camera.up = DVec3::new(1.0, 0.0, 0.0);
        }
        prop_assume!(view.camera.rays(16, 16).is_ok());
        let split = |level: Level, i: BrickIndex| !(i.x * 7 + i.y * 13 + i.z * 29 + level.0 as u32 * 31 + seed).is_multiple_of(5);
        let cut = |frame: &FrameSettings| volume.cut(&frame.rays, &frame.geometry, &split);
        for mode in [Mode::Dvr, Mode::Average] {
            view.mode = mode;
            let frame = view.frame(&volume, &transfer);
            let mut found = volume.render(&frame, &cut(&frame), 1);
            let expected = volume.reference(&frame, &cut(&frame), &transfer);
            for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))).filter(|&(x, y)| grazes(&frame, &volume, x, y)) {
                found.rgb[(y * 16 + x) as usize] = expected.pixel(x, y);
            }
            prop_assert!(found.difference(&expected).max <= TOLERANCE, "{:?}", found.difference(&expected));
        }
    }
}
