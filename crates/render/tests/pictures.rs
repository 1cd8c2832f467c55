//! Pictures of both compositors against the oracle and against closed forms.

mod bricks;

use bricks::{ALONE, Bricks, MEMORY_BYTES, NEEDS, RenderOne};
use brickyard_pager::{DrawCell, DrawList, Pixels, VolumeNeeds};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use glam::DVec3;

/// The project's contract. Slots hold exactly the oracle's values; what is left is f32 against f64.
const CONTRACT: u8 = 1;

fn uneven() -> Geometry {
    Geometry { spacing: DVec3::new(1.0, 0.8, 1.3), origin: DVec3::new(5.0, -20.0, 3.0), unit: None }
}

fn u8_codes() -> SlotEncoding {
    SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false)
}

/// Smooth, without symmetry, between 0 and `top`.
fn waves(top: f64) -> impl Fn([u32; 3]) -> f64 {
    move |[x, y, z]| {
        let (x, y, z) = (x as f64, y as f64, z as f64);
        top * (0.5 + 0.5 * (0.21 * x + 0.05 * y).sin() * (0.17 * y - 0.1 * z).cos() * (0.13 * z + 0.4).sin())
    }
}

/// Coloured, with empty and dense stretches.
fn tinted(low: f64, high: f64) -> TransferFunction {
    let at = |t: f64| low + t * (high - low);
    TransferFunction {
        color: vec![[at(0.0), 0.0, 0.2, 1.0], [at(0.5), 1.0, 0.3, 0.1], [at(1.0), 0.9, 1.0, 0.5]],
        opacity: vec![[at(0.35), 0.0], [at(0.6), 0.05], [at(0.8), 0.4]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

fn look(eye: DVec3, target: DVec3, fov_y_deg: f64) -> Camera {
    Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg } }
}

/// Views that catch a renderer's usual mistakes. Odd sizes put a ray exactly along the view direction.
fn views(bricks: &Bricks) -> Vec<(&'static str, ViewRays)> {
    let world = |x: f64, y: f64, z: f64| bricks.geometry.world_from_voxel(DVec3::new(x, y, z));
    let parallel =
        |eye, target| Camera { projection: Projection::Orthographic { height: 54.7 }, ..look(eye, target, 1.0) };
    let whole = bricks.geometry.world_box(bricks.pyramid.levels()[0].extent);
    let size = |c: Camera, w, h| c.rays(w, h).unwrap();
    vec![
        ("outside", size(Camera::looking_at_box(whole), 64, 48)),
        ("far away", size(look(world(900.0, -1400.0, 700.0), world(22.0, 18.0, 26.0), 1.6), 48, 48)),
        ("inside", size(look(world(20.3, 11.7, 25.1), world(40.0, 30.0, 20.0), 100.0), 64, 64)),
        ("on a brick's corner", size(look(world(16.0, 16.0, 16.0), world(30.0, 17.0, 15.0), 70.0), 49, 49)),
        ("grazing a brick's face", size(look(world(16.0, -30.0, 16.0), world(16.0, 30.0, 16.0), 40.0), 65, 65)),
        ("grazing the volume's face", size(look(world(0.0, -30.0, 0.0), world(0.0, 30.0, 0.0), 40.0), 65, 65)),
        ("parallel, along an axis", size(parallel(world(16.0, -30.0, 20.0), world(16.0, 0.0, 20.0)), 55, 55)),
        ("parallel, oblique", size(parallel(world(-30.0, -40.0, 60.0), world(22.0, 18.0, 26.0)), 60, 44)),
        ("parallel, from inside", size(parallel(world(20.0, 20.0, 20.0), world(30.0, 45.0, 26.0)), 60, 60)),
    ]
}

fn all_fine(_: BrickId) -> bool {
    false
}

fn own(_: BrickId) -> u8 {
    0
}

fn assert_close(what: &str, found: &Picture, expected: &Picture, tolerance: u8) {
    let d = found.difference(expected);
    if d.max > tolerance {
        let n = found.rgb.iter().zip(&expected.rgb).filter(|(a, b)| a != b).count();
        let far = |i: &usize| (0..3).any(|k| found.rgb[*i][k].abs_diff(expected.rgb[*i][k]) > tolerance);
        let i = (0..found.rgb.len()).find(far).unwrap_or(0);
        let (x, y) = (i as u32 % found.width, i as u32 / found.width);
        panic!(
            "{what}: {d:?}, {n} pixels differ, first past {tolerance} at {x},{y}: {:?} {:?}",
            found.rgb[i], expected.rgb[i]
        );
    }
}

/// In every mode by the contract; whether a ray that grazes a surface meets it is a matter of rounding, so there for all but
/// two pixels in a thousand.
fn assert_agree(mode: Mode, what: &str, found: &Picture, expected: &Picture) {
    match mode {
        Mode::Isosurface => assert_most_agree(what, found, expected, 2),
        _ => assert_close(what, found, expected, CONTRACT),
    }
}

fn assert_most_agree(what: &str, found: &Picture, expected: &Picture, off_per_mille: usize) {
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > CONTRACT);
    let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
    assert!(off * 1000 <= off_per_mille * found.rgb.len(), "{what}: {off} pixels, {:?}", found.difference(expected));
}

/// These views by both compositors, in these modes, against the oracle.
fn compare_views(
    bricks: &Bricks,
    views: &[(&'static str, ViewRays)],
    modes: &[Mode],
    transfer: &TransferFunction,
    lattice: &dyn Fn(&ViewRays) -> Lattice,
) {
    let mut renderers = bricks.renderers();
    for (name, rays) in views {
        for &mode in modes {
            let frame = bricks.settings(*rays, mode, transfer, lattice(rays));
            let mut expected = None;
            for renderer in &mut renderers {
                let list = bricks.draw(renderer, rays, &all_fine, &own);
                let found = renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
                let expected = expected.get_or_insert_with(|| bricks.reference(&frame, &list, transfer));
                let what = format!("{name}, {mode:?}, {:?}", renderer.compositor());
                assert_agree(mode, &what, &found, expected);
            }
        }
    }
}

/// Every view in these modes against the oracle.
fn compare(bricks: &Bricks, modes: &[Mode], transfer: &TransferFunction, lattice: &dyn Fn(&ViewRays) -> Lattice) {
    compare_views(bricks, &views(bricks), modes, transfer, lattice);
}

#[test]
fn every_mode_and_view_matches_the_oracle() {
    let bricks = Bricks::new([45, 37, 52], 16, uneven(), u8_codes(), waves(255.0));
    compare(&bricks, &Mode::ALL, &tinted(0.0, 255.0), &|_| Lattice::uniform(0.7, 0));
}

#[test]
fn steps_that_grow_with_distance_match_the_oracle() {
    let bricks = Bricks::new([45, 37, 52], 16, uneven(), u8_codes(), waves(255.0));
    compare(&bricks, &[Mode::Dvr, Mode::Isosurface], &tinted(0.0, 255.0), &|rays| {
        Lattice::for_view(0.4, 0.8, rays, 0.5, 5)
    });
}

#[test]
fn sixteen_bits_and_floats_match_the_oracle() {
    let wide = SlotEncoding::new(VoxelType::I16, (0.0, 0.0), false);
    let bricks = Bricks::new([40, 40, 40], 32, uneven(), wide, |v| waves(3000.0)(v) - 1000.0);
    compare(&bricks, &[Mode::Dvr, Mode::Mip, Mode::Isosurface], &tinted(-1000.0, 2000.0), &|_| {
        Lattice::uniform(1.0, 0)
    });
    let float = SlotEncoding::new(VoxelType::F32, (0.0, 1e-3), false);
    let bricks = Bricks::new([40, 40, 40], 32, uneven(), float, waves(1e-3));
    compare(&bricks, &[Mode::Dvr, Mode::Average, Mode::Isosurface], &tinted(0.0, 1e-3), &|_| Lattice::uniform(1.0, 0));
}

#[test]
fn invalid_voxels_match_the_oracle() {
    let encoding = SlotEncoding::new(VoxelType::F32, (0.0, 10.0), true);
    let holes = |[x, y, z]: [u32; 3]| {
        let distance = (x as f64 - 20.0).hypot(y as f64 - 15.0).hypot(z as f64 - 25.0);
        if distance < 11.0 || (x * 7 + y * 13 + z * 5).is_multiple_of(31) { f64::NAN } else { waves(10.0)([x, y, z]) }
    };
    let bricks = Bricks::new([45, 37, 52], 16, uneven(), encoding, holes);
    // A sample whose valid corners weigh exactly half falls to either side by rounding: rays along an axis through voxel
    // faces meet whole lines of such samples. Those views are left out.
    let mut views = views(&bricks);
    views.retain(|(name, _)| !name.contains("axis") && !name.contains("grazing"));
    compare_views(&bricks, &views, &Mode::ALL, &tinted(0.0, 10.0), &|_| Lattice::uniform(0.7, 0));
}

#[test]
fn mixed_levels_and_ancestors_match_the_oracle() {
    let bricks = Bricks::new([61, 70, 52], 16, uneven(), u8_codes(), waves(255.0));
    let transfer = tinted(0.0, 255.0);
    // Some subtrees stay coarse, and every third cell is drawn from an ancestor.
    let stop = |id: BrickId| (id.level.0 as u32 + id.index.x + 2 * id.index.y + id.index.z) % 3 == 2;
    let coarser =
        |id: BrickId| (id.index.x + id.index.y + id.index.z).is_multiple_of(3) as u8 * (1 + id.index.z as u8 % 2);
    let mut renderers = bricks.renderers();
    for (name, rays) in views(&bricks) {
        for mode in [Mode::Dvr, Mode::MinIp, Mode::Isosurface] {
            let frame = bricks.settings(rays, mode, &transfer, Lattice::uniform(0.7, 0));
            let mut expected = None;
            for renderer in &mut renderers {
                let list = bricks.draw(renderer, &rays, &stop, &coarser);
                let levels: std::collections::BTreeSet<_> = list.cells.iter().map(|c| c.brick.level).collect();
                assert!(levels.len() >= 3 && list.cells.iter().any(|c| c.brick.level > c.cell.level), "{levels:?}");
                let found = renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
                let expected = expected.get_or_insert_with(|| bricks.reference(&frame, &list, &transfer));
                let what = format!("{name}, {mode:?}, {:?}", renderer.compositor());
                match (mode, renderer.compositor()) {
                    // Where levels meet, cells of `sorted` do not know what the one before has seen.
                    (Mode::Isosurface, Compositor::Sorted) => {
                        assert_most_agree(&what, &found, expected, 40);
                        let background = Picture::quantise(frame.background);
                        let is_hole = |(a, b): &(&[u8; 3], &[u8; 3])| **a == background && **b != background;
                        let holes = found.rgb.iter().zip(&expected.rgb).filter(is_hole).count();
                        assert!(holes * 1000 <= found.rgb.len(), "{what}: {holes} holes");
                    }
                    _ => assert_agree(mode, &what, &found, expected),
                }
            }
        }
    }
}

/// Cells that the cut leaves out are leapt over, and are as good as cells that show nothing.
#[test]
fn cells_that_are_not_there_show_nothing() {
    let bricks = Bricks::new([61, 70, 52], 16, uneven(), u8_codes(), |[x, y, z]| {
        let r = (x as f64 - 30.0).hypot(y as f64 - 41.0).hypot(z as f64 - 22.0);
        if r < 9.0 { 250.0 - r } else { (x + y + z) as f64 % 7.0 }
    });
    let transfer = tinted(0.0, 255.0);
    let mut renderers = bricks.renderers();
    for (name, rays) in views(&bricks) {
        let frame = bricks.settings(rays, Mode::Dvr, &transfer, Lattice::for_view(0.4, 0.8, &rays, 0.5, 5));
        for renderer in &mut renderers {
            let mut list = bricks.draw(renderer, &rays, &all_fine, &own);
            let expected = bricks.reference(&frame, &list, &transfer);
            let all = list.cells.len();
            list.cells.retain(|c| {
                let (low, high) = (c.region.min.to_array(), c.region.max.to_array());
                (0..3).all(|a| low[a] < [41, 52, 33][a] && high[a] > [19, 30, 11][a])
            });
            assert!(list.cells.len() < all / 2);
            let found = renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
            assert_close(&format!("{name}, {:?}", renderer.compositor()), &found, &expected, CONTRACT);
        }
    }
}

/// The list in which cells with two entries have the one or the other alone.
fn one_of_two(list: &DrawList, is_taken: impl Fn(&DrawCell) -> bool) -> DrawList {
    let taken = list.cells.iter().filter(|entry| entry.pixels == Pixels::ALL || is_taken(entry));
    DrawList { cells: taken.map(|entry| DrawCell { pixels: Pixels::ALL, ..*entry }).collect() }
}

/// Pixel by pixel, a brick that fades in is drawn as if it were there, or as if it were not.
#[test]
fn a_fade_has_each_pixel_of_one_picture_or_the_other() {
    let bricks = Bricks::new([45, 37, 52], 16, uneven(), u8_codes(), waves(255.0));
    let transfer = tinted(0.0, 255.0);
    for mut renderer in bricks.renderers() {
        let mut telling = 0;
        for (share, (name, rays)) in [1, 20, 32, 63].into_iter().cycle().zip(views(&bricks)) {
            let (before, after) = (Pixels { from: share, ..Pixels::ALL }, Pixels { to: share, ..Pixels::ALL });
            // Not all at once: there are no more entries than slots.
            let fades = |id: BrickId| (id.index.x + 2 * id.index.y + id.index.z) % 4 == 1;
            let entries = |id| if fades(id) { vec![(1, before), (0, after)] } else { vec![(0, Pixels::ALL)] };
            let list = bricks.draw_fading(&mut renderer, ALONE, &rays, &all_fine, &entries);
            let lists = [one_of_two(&list, |e| e.cell == e.brick), one_of_two(&list, |e| e.cell != e.brick), list];
            for mode in Mode::ALL {
                let frame = bricks.settings(rays, mode, &transfer, Lattice::uniform(0.7, 0));
                let [fine, coarse, found] =
                    lists.each_ref().map(|list| renderer.render_one(&frame, &bricks.pyramid, list).unwrap());
                telling += (fine != coarse) as u32;
                let size = fine.width;
                let of =
                    |i: usize| if after.hold(i as u32 % size, i as u32 / size) { fine.rgb[i] } else { coarse.rgb[i] };
                let expected = Picture { rgb: (0..fine.rgb.len()).map(of).collect(), ..fine };
                // The same sums in the same order.
                assert_close(&format!("{name}, {mode:?}, {:?}", renderer.compositor()), &found, &expected, 0);
            }
        }
        assert!(telling > 30, "{telling} of 45 pictures show what fades: the others prove nothing");
    }
}

#[test]
fn the_brick_size_does_not_show() {
    let transfer = tinted(0.0, 255.0);
    // Each compositor's pictures with bricks of this size.
    let render = |edge| {
        let bricks = Bricks::new([45, 37, 52], edge, uneven(), u8_codes(), waves(255.0));
        let mut renderers = bricks.renderers();
        let mut pictures = Vec::new();
        for renderer in &mut renderers {
            for (_, rays) in views(&bricks) {
                let list = bricks.draw(renderer, &rays, &all_fine, &own);
                let frames = Mode::ALL.map(|mode| bricks.settings(rays, mode, &transfer, Lattice::uniform(0.5, 0)));
                let draw =
                    |frame: FrameSettings| (frame.mode, renderer.render_one(&frame, &bricks.pyramid, &list).unwrap());
                pictures.extend(frames.map(draw));
            }
        }
        pictures
    };
    let [small, middle, single] = [8, 32, 64].map(render);
    for (i, (mode, one)) in single.iter().enumerate() {
        assert_agree(*mode, &format!("bricks of 32, picture {i}"), &middle[i].1, one);
        assert_agree(*mode, &format!("bricks of 8, picture {i}"), &small[i].1, one);
    }
}

/// World length of a ray's stretch in the volume.
fn chord(bricks: &Bricks, ray: &Ray) -> f64 {
    let (low, high) = bricks.geometry.world_box(bricks.pyramid.levels()[0].extent);
    let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
    let (t_in, t_out) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
    (t_out - t_in).max(0.0)
}

#[test]
fn a_constant_medium_is_beer_lambert_whatever_the_step_and_the_bricks() {
    // Thin enough that alpha per step is far below 1/255, and thick; 2,197 cells are more than one submission.
    for (alpha, edge) in [(0.0025, 32), (0.05, 8), (0.9, 32)] {
        let bricks = Bricks::new([104, 104, 104], edge, Geometry::default(), u8_codes(), |_| 100.0);
        let mut renderers = bricks.renderers();
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 0.5, 0.0]],
            opacity: vec![[0.0, alpha]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        let eyes = [DVec3::new(-150.0, -90.0, 130.0), DVec3::new(31.0, 64.0, 40.0), DVec3::new(52.0, 51.5, 500.0)];
        for eye in eyes {
            let up = if eye.z > 400.0 { DVec3::Y } else { DVec3::Z };
            let rays = Camera { up, ..look(eye, DVec3::new(52.0, 51.5, 53.0), 45.0) }.rays(61, 61).unwrap();
            for renderer in &mut renderers {
                let list = bricks.draw(renderer, &rays, &all_fine, &own);
                for step in [0.31, 1.0, 2.7] {
                    let frame = bricks.settings(rays, Mode::Dvr, &transfer, Lattice::uniform(step, 0));
                    let found = renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
                    let pixel = |i: u32| {
                        let ray = rays.ray((i % 61) as f64 + 0.5, (i / 61) as f64 + 0.5);
                        let left = (1.0 - alpha).powf(chord(&bricks, &ray));
                        let color = [1.0, 0.5, 0.0].map(|c| c * (1.0 - left));
                        Picture::quantise(std::array::from_fn(|k| color[k] as f32 + left as f32 * frame.background[k]))
                    };
                    let expected = Picture { width: 61, height: 61, rgb: (0..61 * 61).map(pixel).collect() };
                    assert_close(
                        &format!("{:?}, alpha {alpha}, step {step}, eye {eye}", renderer.compositor()),
                        &found,
                        &expected,
                        CONTRACT,
                    );
                }
            }
        }
    }
}

#[test]
fn an_empty_list_is_the_background() {
    let bricks = Bricks::new([8, 8, 8], 8, uneven(), u8_codes(), |_| 100.0);
    for renderer in &mut bricks.renderers() {
        for mode in Mode::ALL {
            let rays = views(&bricks)[0].1;
            let frame = bricks.settings(rays, mode, &tinted(0.0, 255.0), Lattice::uniform(1.0, 0));
            let found = renderer.render_one(&frame, &bricks.pyramid, &Default::default()).unwrap();
            let is_empty = found.rgb.iter().all(|&p| p == Picture::quantise(frame.background));
            assert!(is_empty, "{mode:?} {:?}", renderer.compositor());
        }
    }
}

#[test]
fn a_new_transfer_function_uploads_no_brick() {
    let bricks = Bricks::new([45, 37, 52], 16, uneven(), u8_codes(), waves(255.0));
    let rays = views(&bricks)[0].1;
    for renderer in &mut bricks.renderers() {
        let list = bricks.draw(renderer, &rays, &all_fine, &own);
        let before = renderer.uploaded_bytes();
        // The second one shows only what the first leaves empty: no leap may outlive its table.
        let steep = TransferFunction { opacity: vec![[40.0, 0.4], [60.0, 0.2], [80.0, 0.0]], ..tinted(0.0, 255.0) };
        for transfer in [tinted(0.0, 255.0), steep, tinted(100.0, 200.0), tinted(0.0, 255.0)] {
            let frame = bricks.settings(rays, Mode::Dvr, &transfer, Lattice::uniform(0.7, 0));
            let found = renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
            let expected = bricks.reference(&frame, &list, &transfer);
            assert_close(&format!("edited, {:?}", renderer.compositor()), &found, &expected, CONTRACT);
        }
        assert_eq!(renderer.uploaded_bytes(), before);
        assert!(renderer.last_frame_ms() > 0.0);
    }
}

/// A brick that takes another's slot brings its own macro-cells.
#[test]
fn a_slot_forgets_the_brick_before() {
    let fill = |value: f64| Bricks::new([30, 30, 30], 32, uneven(), u8_codes(), move |_| value);
    let (clear, full) = (fill(10.0), fill(200.0));
    let transfer = tinted(0.0, 255.0);
    let rays = views(&clear)[0].1;
    let frame = clear.settings(rays, Mode::Dvr, &transfer, Lattice::uniform(0.7, 0));
    for renderer in &mut clear.renderers() {
        for bricks in [&clear, &full, &clear, &full] {
            let list = bricks.draw(renderer, &rays, &all_fine, &own);
            let found = renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
            assert_close(
                &format!("{:?}", renderer.compositor()),
                &found,
                &bricks.reference(&frame, &list, &transfer),
                CONTRACT,
            );
        }
    }
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let bricks = Bricks::new([8, 8, 8], 8, uneven(), u8_codes(), |_| 100.0);
    bricks.renderers().into_iter().for_each(|renderer| check_limits(&bricks, renderer));
}

fn check_limits(bricks: &Bricks, mut renderer: GpuRenderer) {
    assert!(renderer.gpu_bytes() <= MEMORY_BYTES);
    assert!(matches!(renderer.upload(0, brickyard_pager::Slot(0), &[0; 7]), Err(GpuError::Mismatch(_))));
    let camera = look(DVec3::ZERO, DVec3::ONE, 40.0);
    let frame =
        |w, h| bricks.settings(camera.rays(w, h).unwrap(), Mode::Dvr, &tinted(0.0, 255.0), Lattice::uniform(1.0, 0));
    let render = |renderer: &mut GpuRenderer, frame: &FrameSettings| {
        renderer.render_one(frame, &bricks.pyramid, &Default::default()).map(|_| ())
    };
    assert!(matches!(render(&mut renderer, &frame(513, 8)), Err(GpuError::PictureTooLarge { .. })));
    let mut wrong = frame(8, 8);
    wrong.table = TransferTable::from_entries(wrong.table.entries[..9].to_vec(), 1.0).into();
    assert!(matches!(render(&mut renderer, &wrong), Err(GpuError::Mismatch(_))));
    assert_eq!(render(&mut renderer, &frame(8, 8)), Ok(()), "the renderer still works");

    let options = GpuOptions { compositor: renderer.compositor(), ..Default::default() };
    let needs = VolumeNeeds { edge: 64, levels: 16, bricks: NEEDS, most_slots: u32::MAX, ..bricks.volume_needs() };
    let new = |bytes| GpuRenderer::new(&options, &[needs], bytes, (512, 512)).map(|_| ());
    let Err(GpuError::Budget { least_bytes, .. }) = new(1 << 20) else { panic!("1 MiB is not enough") };
    assert_eq!(new(least_bytes), Ok(()));
}

/// A camera that turns faster than cuts are made sees what the last one left coarse: many cells, of few bricks.
#[test]
fn a_list_may_have_more_entries_than_there_are_slots() {
    let bricks = Bricks::new([30, 30, 30], 8, Geometry::default(), u8_codes(), waves(255.0));
    let rays = views(&bricks)[0].1;
    let transfer = tinted(0.0, 255.0);
    let frame = bricks.settings(rays, Mode::Dvr, &transfer, Lattice::uniform(0.7, 0));
    for renderer in bricks.renderers() {
        let needs = VolumeNeeds { most_slots: 8, ..bricks.volume_needs() };
        let options = GpuOptions { compositor: renderer.compositor(), ..Default::default() };
        let mut few = GpuRenderer::new(&options, &[needs], MEMORY_BYTES, (64, 64)).expect("a renderer");
        let list = bricks.draw(&mut few, &rays, &all_fine, &|_| 1);
        assert!(few.slots(0) == 8 && list.cells.len() == 64);
        let found = few.render_one(&frame, &bricks.pyramid, &list).expect("a picture");
        let expected = bricks.reference(&frame, &list, &transfer);
        assert_close(&format!("{:?}", few.compositor()), &found, &expected, 1);
        assert!(few.visibility(0).is_none_or(|seen| seen.len() == 64));
    }
}

/// Until it fits there are half as many slots, again and again; what is left makes the same picture.
#[test]
fn refused_memory_ends_in_fewer_slots() {
    let bricks = Bricks::new([30, 30, 30], 8, uneven(), u8_codes(), waves(255.0));
    let rays = views(&bricks)[0].1;
    let frame = bricks.settings(rays, Mode::Dvr, &tinted(0.0, 255.0), Lattice::uniform(0.7, 0));
    for mut ample in bricks.renderers() {
        let compositor = ample.compositor();
        let new = |refuse_above_bytes| {
            let needs = VolumeNeeds { most_slots: 2000, ..bricks.volume_needs() };
            let options = GpuOptions { compositor, refuse_above_bytes, ..Default::default() };
            GpuRenderer::new(&options, &[needs], MEMORY_BYTES, (64, 64))
        };
        // 2000 slots of 12^3 texels of 1 or 2 bytes; of 500 or 250 one texture takes less than a megabyte.
        let whole = new(u64::MAX).unwrap();
        assert_eq!((whole.slots(0), whole.asked_bytes()), (2000, whole.gpu_bytes()));
        let mut less = new(1 << 20).unwrap();
        assert!((240..1050).contains(&less.slots(0)), "{compositor:?}: {} slots", less.slots(0));
        assert!(less.gpu_bytes() < whole.gpu_bytes() && less.asked_bytes() == whole.gpu_bytes());
        let pictures = [&mut ample, &mut less].map(|renderer| {
            let list = bricks.draw(renderer, &rays, &all_fine, &own);
            renderer.render_one(&frame, &bricks.pyramid, &list).unwrap()
        });
        assert_eq!(pictures[0], pictures[1], "{compositor:?}");
        // Even the least atlas is too much here.
        assert!(matches!(new(1000), Err(GpuError::OutOfMemory { .. })), "{compositor:?}");
    }
}

/// What each cell of an orthographic view along x was entered with, in layers of bricks from the eye on.
fn layers(
    bricks: &Bricks,
    renderer: &mut GpuRenderer,
    transfer: &TransferFunction,
    mode: Mode,
) -> Option<Vec<Vec<f32>>> {
    let world = |x: f64, y: f64, z: f64| bricks.geometry.world_from_voxel(DVec3::new(x, y, z));
    let camera = look(world(-9.0, 8.0, 8.0), world(40.0, 8.0, 8.0), 1.0);
    let rays = Camera { projection: Projection::Orthographic { height: 40.0 }, ..camera }.rays(77, 61).unwrap();
    let frame = bricks.settings(rays, mode, transfer, Lattice::uniform(0.5, 0));
    let list = bricks.draw(renderer, &rays, &all_fine, &own);
    renderer.render_one(&frame, &bricks.pyramid, &list).unwrap();
    let visibility = renderer.visibility(0)?;
    assert_eq!(visibility.len(), list.cells.len());
    let mut layers = vec![Vec::new(); 5];
    for (cell, entered) in list.cells.iter().zip(visibility) {
        layers[cell.cell.index.x as usize].push(*entered);
    }
    Some(layers)
}

#[test]
fn rays_say_with_what_they_entered_cells() {
    // Along x, bricks of: nothing, thin, nothing, opaque, opaque. Thin leaves half of the light in 8 voxels.
    let codes = [0.0, 100.0, 0.0, 200.0, 200.0];
    let bricks = Bricks::new([40, 16, 16], 8, Geometry::default(), u8_codes(), |[x, ..]| codes[x as usize / 8]);
    let half = 1.0 - 0.5f64.powf(1.0 / 8.0);
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[99.0, 0.0], [99.5, half], [100.5, half], [101.0, 0.0], [199.0, 0.0], [199.5, 1.0]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let nothing = TransferFunction { opacity: vec![[0.0, 0.0]], ..transfer.clone() };
    for mut renderer in bricks.renderers() {
        let marks = renderer.adapter().feedback && renderer.compositor() == Compositor::Raycast;
        let found = layers(&bricks, &mut renderer, &transfer, Mode::Dvr);
        let Some(found) = found else {
            assert!(!marks, "{:?}", renderer.compositor());
            continue;
        };
        // The thin medium reaches from its first voxel's centre to its last one's, for the values between are not seen.
        let left = 0.5f32.powf(7.0 / 8.0);
        for (x, expected) in [1.0, 1.0, left, left, 0.0].into_iter().enumerate() {
            assert_eq!(found[x].len(), 4);
            // Rounded up to a step of the scale; a power in f32 is good to a ten-thousandth.
            let close = |&entered: &f32| (-1e-4..1.0 / 255.0 + 1e-4).contains(&(entered - expected));
            assert!(found[x].iter().all(close), "layer {x}: {found:?}");
        }
        // Where nothing shows, rays come by everywhere; and nothing is left of the picture before.
        assert_eq!(layers(&bricks, &mut renderer, &nothing, Mode::Dvr), Some(vec![vec![1.0; 4]; 5]));
        assert_eq!(layers(&bricks, &mut renderer, &transfer, Mode::Dvr), Some(found));
        assert_eq!(layers(&bricks, &mut renderer, &transfer, Mode::Mip), None);
    }
}
