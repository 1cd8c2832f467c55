//! Meshes of known shapes, and of noise, end to end.

use crate::error::MeshError;
use crate::extraction::mesh;
use crate::request::{MOST_SMOOTHING, MeshRequest, MeshSurface};
use crate::testing::{Made, Packed, Ply, by_bits, go_on};
use brickyard_volume::{Level, VoxelBox};
use glam::DVec3;
use proptest::prelude::*;
use std::collections::{HashMap, HashSet};
use std::f64::consts::PI;
use std::ops::ControlFlow;

fn at(voxel: [u32; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(f64::from))
}

/// Distance inwards from a sphere.
fn within_sphere(centre: DVec3, radius: f64) -> impl Fn([u32; 3]) -> f32 + Copy {
    move |voxel| (radius - (at(voxel) - centre).length()) as f32
}

fn isosurface(value: f64) -> MeshRequest {
    MeshRequest::new(MeshSurface::Isosurface(value))
}

/// Mixes the bits of a place.
fn hashed([x, y, z]: [u32; 3], seed: u64) -> u64 {
    let mut hash = seed ^ u64::from(x) << 42 ^ u64::from(y) << 21 ^ u64::from(z);
    for _ in 0..2 {
        hash = (hash ^ hash >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    hash >> 40
}

#[test]
fn a_sphere_has_its_volume_area_and_place_in_every_world() {
    let (centre, radius) = (DVec3::new(35.2, 30.7, 33.1), 26.3);
    let sphere = || Made::new([72, 64, 68], within_sphere(centre, radius));
    let turned = [[0.0, -2.0, 0.0, 5.0], [1.0, 0.0, 0.0, -7.0], [0.0, 0.0, 3.0, 11.0]];
    let mirrored = [[-2.0, 0.0, 0.0, 5.0], [0.0, 1.0, 0.0, -7.0], [0.0, 0.0, 3.0, 11.0]];
    let spacing = DVec3::new(2.0, 1.0, 3.0);
    let worlds = [
        (sphere(), DVec3::ONE, centre),
        (
            sphere().spaced(spacing, DVec3::new(5.0, -7.0, 11.0)),
            spacing,
            DVec3::new(5.0, -7.0, 11.0) + centre * spacing,
        ),
        (
            sphere().spaced(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO).oriented(turned),
            DVec3::new(2.0, 1.0, 3.0),
            DVec3::new(5.0 - 2.0 * centre.y, centre.x - 7.0, 3.0 * centre.z + 11.0),
        ),
        (
            sphere().spaced(spacing, DVec3::ZERO).oriented(mirrored),
            spacing,
            DVec3::new(5.0 - 2.0 * centre.x, centre.y - 7.0, 3.0 * centre.z + 11.0),
        ),
    ];
    for (i, (source, stretch, middle)) in worlds.iter().enumerate() {
        let (found, report) = Packed::image(source, 32).ply(&isosurface(0.0));
        assert_eq!(found.checked(), 2, "{i}");
        for place in &found.places {
            let off = ((*place - *middle) / *stretch).length() - radius;
            assert!(off.abs() < 0.02, "{i}: {off}");
        }
        let expected = 4.0 / 3.0 * PI * radius.powi(3) * stretch.x * stretch.y * stretch.z;
        assert!((found.volume() / expected - 1.0).abs() < 2e-3, "{i}: {} and {expected}", found.volume());
        let [object] = report.objects.as_slice() else { panic!("one object") };
        assert!((object.volume / found.volume() - 1.0).abs() < 1e-4 && (object.area / found.area() - 1.0).abs() < 1e-4);
        assert_eq!((object.vertices, object.triangles), (found.places.len() as u64, found.triangles.len() as u64));
        if i == 0 {
            assert!((found.area() / (4.0 * PI * radius * radius) - 1.0).abs() < 2e-3);
        }
    }
}

#[test]
fn shapes_have_their_genus() {
    let (centre, around, across) = (DVec3::splat(30.0), 18.0, 7.0);
    let torus = move |voxel| {
        let p = at(voxel) - centre;
        (across - (p.truncate().length() - around).hypot(p.z)) as f32
    };
    let (found, _) = Packed::image(&Made::new([61, 61, 61], torus), 16).ply(&isosurface(0.0));
    assert_eq!(found.checked(), 0);
    assert!((found.volume() / (2.0 * PI * PI * around * across * across) - 1.0).abs() < 5e-3);
    let [one, other] = [10.0, 29.5].map(|at| within_sphere(DVec3::splat(at), 8.0));
    let two = move |voxel| one(voxel).max(other(voxel));
    let (found, _) = Packed::image(&Made::new([40, 40, 40], two), 8).ply(&isosurface(0.0));
    assert_eq!(found.checked(), 4);
    assert!((found.volume() / (8.0 / 3.0 * PI * 512.0) - 1.0).abs() < 0.02);
}

#[test]
fn a_surface_is_closed_at_the_border_of_the_last_voxels() {
    let full = Packed::image(&Made::new([40, 5, 33], |_| 7u8), 8);
    let (found, _) = full.ply(&isosurface(7.0));
    assert_eq!(found.checked(), 2);
    let (low, high) =
        found.places.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    assert_eq!((low, high), (DVec3::splat(-0.5), DVec3::new(39.5, 4.5, 32.5)));
    // A box's edges are cut off by less than half a voxel.
    assert!(found.volume() > 0.9 * 40.0 * 5.0 * 33.0 && found.volume() < 40.0 * 5.0 * 33.0);
    let region = Some(VoxelBox::new([3, 1, 2], [20, 3, 4]));
    let (found, _) = full.ply(&MeshRequest { region, ..isosurface(0.0) });
    assert_eq!(found.checked(), 2);
    assert!(
        found
            .places
            .iter()
            .all(|p| p.cmpge(DVec3::new(2.5, 0.5, 1.5)).all() && p.cmple(DVec3::new(19.5, 2.5, 3.5)).all())
    );
    // A single voxel.
    let region = Some(VoxelBox::new([3, 1, 2], [4, 2, 3]));
    let (found, _) = full.ply(&MeshRequest { region, ..isosurface(0.0) });
    assert_eq!((found.checked(), found.triangles.len()), (2, 8));
}

#[test]
fn coarser_levels_are_at_the_same_place() {
    let (centre, radius) = (DVec3::splat(40.0), 30.0);
    let sphere = Packed::image(&Made::new([80, 80, 80], within_sphere(centre, radius)), 8);
    for level in 1..3 {
        let (found, _) = sphere.ply(&MeshRequest { level: Level(level), ..isosurface(0.0) });
        assert_eq!(found.checked(), 2);
        for place in &found.places {
            assert!(((*place - centre).length() - radius).abs() < 0.3, "{level}: {place}");
        }
    }
}

/// The bytes of a mesh.
fn bytes(packed: &Packed, name: &str, request: &MeshRequest) -> Vec<u8> {
    let path = packed.folder.path().join(name);
    mesh(&packed.store, &path, &MeshRequest { overwrite: true, ..*request }, go_on).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn bricks_threads_and_memory_do_not_change_the_file() {
    let noise = |voxel| (hashed(voxel, 1) % 200) as u8;
    let blobs = |voxel: [u32; 3]| (hashed(voxel.map(|v| v / 6), 1) % 5) as u8;
    for (smoothing, decimation_voxels, surface) in [
        (0, None, MeshSurface::Isosurface(100.0)),
        (2, None, MeshSurface::Isosurface(100.0)),
        (3, None, MeshSurface::Label(2)),
        (0, None, MeshSurface::Labels),
        (0, Some(0.5), MeshSurface::Isosurface(100.0)),
        (2, Some(0.25), MeshSurface::Labels),
    ] {
        let is_image = matches!(surface, MeshSurface::Isosurface(_));
        let packed = |edge| match is_image {
            true => Packed::image(&Made::new([70, 23, 17], noise), edge),
            false => Packed::labels(&Made::new([70, 23, 17], blobs), edge),
        };
        let request = MeshRequest { smoothing, decimation_voxels, ..MeshRequest::new(surface) };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let expected = one.install(|| bytes(&packed(16), "a.obj", &request));
        for edge in [8, 64] {
            let packed = packed(edge);
            assert!(bytes(&packed, "a.obj", &request) == expected, "{surface:?}, bricks of {edge}");
            let tried = mesh(
                &packed.store,
                &packed.folder.path().join("b.obj"),
                &MeshRequest { memory_bytes: 1, ..request },
                go_on,
            );
            let Err(MeshError::Memory { needed_bytes, .. }) = tried else { panic!("{tried:?}") };
            let within = MeshRequest { memory_bytes: needed_bytes, ..request };
            assert!(bytes(&packed, "a.obj", &within) == expected, "{surface:?}, bricks of {edge}");
        }
    }
}

#[test]
fn smoothing_keeps_the_volume_and_does_not_depend_on_blocks() {
    let centre = DVec3::new(40.3, 35.0, 38.0);
    let rough =
        move |voxel: [u32; 3]| (25.0 - (at(voxel) - centre).length() + 0.2 * (hashed(voxel, 5) % 10) as f64) as f32;
    let packed = Packed::image(&Made::new([80, 70, 75], rough), 16);
    let (plain, _) = packed.ply(&isosurface(1.0));
    let mut area = plain.area();
    for smoothing in [1, 5, MOST_SMOOTHING] {
        let request = MeshRequest { smoothing, ..isosurface(1.0) };
        let (whole, _) = packed.ply(&request);
        assert_eq!(whole.checked(), plain.checked());
        assert!((whole.volume() / plain.volume() - 1.0).abs() < 0.02, "{} and {}", whole.volume(), plain.volume());
        // Steps have more area than the ball beneath them.
        assert!(whole.area() < area, "{smoothing}: {} after {area}", whole.area());
        area = whole.area();
        // Other blocks, as the box begins elsewhere; the surface is the same.
        let region = Some(VoxelBox::new([5, 3, 9], [80, 69, 75]));
        let (part, _) = packed.ply(&MeshRequest { region, ..request });
        assert!(part.sorted() == whole.sorted(), "{smoothing}");
    }
}

/// Checks a decimated surface against the whole one and the distance of places from the true surface.
fn check_decimated(packed: &Packed, request: &MeshRequest, voxels: f64, off: impl Fn(DVec3) -> f64) -> [Ply; 2] {
    let (whole, _) = packed.ply(request);
    let (found, report) = packed.ply(&MeshRequest { decimation_voxels: Some(voxels), ..*request });
    assert_eq!(found.checked(), whole.checked());
    assert_eq!(report.objects[0].vertices, found.places.len() as u64);
    assert!((report.objects[0].volume / found.volume() - 1.0).abs() < 1e-4);
    // Hausdorff's distance both ways: from the vertices that have gone, and from triangles.
    for place in whole.places.iter().step_by(17) {
        assert!(found.distance(*place) < voxels + 1e-4, "{place}: {}", found.distance(*place));
    }
    for [a, b, c] in found.corners() {
        for place in [a, (a + b) / 2.0, (a + b + c) / 3.0] {
            assert!(off(place).abs() < 1.5 * voxels + 0.05, "{place}: {}", off(place));
        }
    }
    assert!(found.sharpest_fold() >= -0.3, "{}", found.sharpest_fold());
    [whole, found]
}

#[test]
fn decimated_spheres_and_tori_stay_within_the_tolerance() {
    let (centre, radius) = (DVec3::new(55.2, 50.7, 53.1), 46.3);
    let sphere = Packed::image(&Made::new([112, 104, 108], within_sphere(centre, radius)), 32);
    // Shares of triangles and of the volume: a chord within a tolerance of the sphere cuts off about half of it.
    for (voxels, most_share, volume_share) in [(0.05, 0.12, 2e-3), (0.3, 0.025, 0.012), (1.0, 0.01, 0.035)] {
        let off = |place: DVec3| (place - centre).length() - radius;
        let [whole, found] = check_decimated(&sphere, &isosurface(0.0), voxels, off);
        let share = found.triangles.len() as f64 / whole.triangles.len() as f64;
        assert!(share < most_share, "{voxels}: {share} of the triangles");
        let expected = 4.0 / 3.0 * PI * radius.powi(3);
        assert!((found.volume() / expected - 1.0).abs() < volume_share, "{voxels}: {}", found.volume() / expected);
    }
    let (centre, around, across) = (DVec3::splat(40.0), 26.0, 9.0);
    let off = move |p: DVec3| ((p - centre).truncate().length() - around).hypot(p.z - centre.z) - across;
    let torus = Packed::image(&Made::new([81, 81, 81], move |voxel| -off(at(voxel)) as f32), 16);
    let [whole, found] = check_decimated(&torus, &isosurface(0.0), 0.2, off);
    assert_eq!(found.checked(), 0);
    assert!(
        found.triangles.len() * 12 < whole.triangles.len(),
        "{} of {}",
        found.triangles.len(),
        whole.triangles.len()
    );
    assert!((found.volume() / (2.0 * PI * PI * around * across * across) - 1.0).abs() < 0.03);
}

#[test]
fn tolerances_are_of_the_smallest_edge_of_voxels() {
    let (centre, radius) = (DVec3::new(35.2, 30.7, 33.1), 26.3);
    let (spacing, origin) = (DVec3::new(2.0, 0.5, 3.0), DVec3::new(5.0, -7.0, 11.0));
    let sphere = Made::new([72, 64, 68], within_sphere(centre, radius)).spaced(spacing, origin);
    let off = |place: DVec3| (((place - origin) / spacing - centre).length() - radius) * 0.5;
    let packed = Packed::image(&sphere, 32);
    let (whole, _) = packed.ply(&isosurface(0.0));
    let (found, _) = packed.ply(&MeshRequest { decimation_voxels: Some(0.5), ..isosurface(0.0) });
    assert_eq!(found.checked(), 2);
    let farthest = whole.places.iter().step_by(3).map(|place| found.distance(*place)).fold(0.0, f64::max);
    assert!(farthest > 0.2 && farthest < 0.25 + 1e-4, "{farthest}");
    assert!(found.places.iter().all(|place| off(*place).abs() < 0.05));
    assert!(found.triangles.len() * 8 < whole.triangles.len());
}

#[test]
fn even_faces_of_labels_become_few_triangles() {
    // Two boxes beside each other, across several blocks.
    let label = |[x, y, z]: [u32; 3]| match (5..75).contains(&y) && (5..70).contains(&z) {
        true if (5..50).contains(&x) => 1u8,
        true if (50..90).contains(&x) => 2,
        _ => 0,
    };
    let packed = Packed::labels(&Made::new([95, 80, 75], label), 32);
    for label in [1, 2] {
        let request = MeshRequest { decimation_voxels: Some(0.1), ..MeshRequest::new(MeshSurface::Label(label)) };
        let (found, _) = packed.ply(&request);
        assert_eq!(found.checked(), 2);
        // Their common border's rim stays: 2 times 70 and 65 edges.
        assert!(found.triangles.len() > 270 && found.triangles.len() < 900, "{label}: {}", found.triangles.len());
        let expected = [45.0, 40.0][label as usize - 1] * 70.0 * 65.0;
        assert!((found.volume() / expected - 1.0).abs() < 1e-3, "{}", found.volume() / expected);
    }
}

#[test]
fn labels_are_closed_and_share_their_borders() {
    // Blobs, thin parts and single voxels, over several blocks.
    let label = |voxel: [u32; 3]| match hashed(voxel.map(|v| v / 5), 3) % 4 {
        0 => (hashed(voxel, 9) % 4) as u16,
        label => label as u16,
    };
    let extent = [45, 38, 36];
    let packed = Packed::labels(&Made::new(extent, label), 16);
    for (smoothing, decimation_voxels) in [(0, None), (1, None), (4, None), (0, Some(1.0)), (4, Some(0.3))] {
        let mut sides = HashMap::<[[u64; 3]; 3], i32>::new();
        let mut volume = 0.0;
        for label in 0..4 {
            let (found, report) = packed.ply(&MeshRequest {
                smoothing,
                decimation_voxels,
                ..MeshRequest::new(MeshSurface::Label(label))
            });
            found.checked();
            assert!(found.volume() > 0.0);
            volume += report.objects[0].volume;
            for corners in found.corners() {
                *sides.entry(by_bits(corners)).or_default() += 1;
                let [a, b, c] = corners;
                *sides.entry(by_bits([a, c, b])).or_default() -= 1;
            }
        }
        // All but the outermost triangles have another label's on their other side.
        let outside: Vec<_> = sides.iter().filter(|(_, sides)| **sides != 0).collect();
        assert!(!outside.is_empty());
        for (corners, _) in outside {
            let places = corners.map(|bits| DVec3::from_array(bits.map(f64::from_bits)));
            let on_border = |a: usize| {
                [0.0, f64::from(extent[a]) - 1.0].iter().any(|end| places.iter().all(|p| (p[a] - end).abs() < 1.0))
            };
            assert!((0..3).any(on_border), "{places:?}");
        }
        if smoothing == 0 && decimation_voxels.is_none() {
            assert!((volume - (45 * 38 * 36) as f64).abs() < 1e-6, "{volume}");
        }
    }
}

#[test]
fn all_labels_are_the_single_ones_as_objects() {
    let label = |voxel: [u32; 3]| (hashed(voxel.map(|v| v / 9), 4) % 6) as u8;
    let packed = Packed::labels(&Made::new([50, 40, 37], label), 8);
    let whole = MeshRequest { smoothing: 2, ..MeshRequest::new(MeshSurface::Labels) };
    let decimated = MeshRequest { decimation_voxels: Some(0.4), ..whole };
    for (name, request) in
        [("all.glb", whole), ("all.obj", whole), ("decimated.obj", decimated), ("decimated.glb", decimated)]
    {
        let path = packed.folder.path().join(name);
        let report = mesh(&packed.store, &path, &request, go_on).unwrap();
        assert_eq!(report.objects.iter().map(|object| object.label).collect::<Vec<_>>(), [1, 2, 3, 4, 5].map(Some));
        let read = brickyard_import::read_mesh(&path).unwrap();
        let mut all: Vec<_> = triangles(&read).collect();
        all.sort_unstable();
        let mut expected = Vec::new();
        for object in &report.objects {
            let single = MeshRequest { surface: MeshSurface::Label(object.label.unwrap()), ..request };
            let (found, single) = packed.ply(&single);
            expected.extend(found.sorted());
            assert_eq!((single.objects[0].vertices, single.objects[0].triangles), (object.vertices, object.triangles));
        }
        expected.sort_unstable();
        assert!(all == expected, "{name}");
    }
}

/// Labels in floats: 1.5 is no voxel of label 1, nor is NaN background.
#[test]
fn fractions_and_nan_are_no_labels() {
    let value = |[x, ..]: [u32; 3]| [0.0f32, 1.0, 1.5, 3.0, f32::NAN, f32::NAN][x as usize % 6];
    for edge in [8, 32] {
        let packed = Packed::image_called_labels(&Made::new([6, 5, 4], value), edge);
        for label in [0, 1, 3] {
            let (ply, report) = packed.ply(&MeshRequest::new(MeshSurface::Label(label)));
            ply.checked();
            let volume = report.objects[0].volume;
            assert!((volume - 20.0).abs() < 1e-9, "{label}: {volume}");
        }
        let path = packed.folder.path().join("all.obj");
        let report = mesh(&packed.store, &path, &MeshRequest::new(MeshSurface::Labels), go_on).unwrap();
        assert_eq!(report.objects.iter().map(|object| object.label).collect::<Vec<_>>(), [Some(1), Some(3)]);
    }
}

fn triangles(read: &brickyard_volume::Mesh) -> impl Iterator<Item = [[u64; 3]; 3]> {
    let place = |vertex: u32| DVec3::from_array(read.positions()[vertex as usize].map(f64::from));
    read.triangles().iter().map(move |triangle| by_bits(triangle.map(place)))
}

#[test]
fn every_format_is_read_back_with_the_same_triangles() {
    let packed = Packed::image(&Made::new([40, 36, 35], |voxel| (hashed(voxel, 2) % 9) as i16 - 4), 16);
    let (ply, report) = packed.ply(&isosurface(2.0));
    ply.checked();
    for name in ["a.stl", "a.ply", "a.obj", "a.GLB"] {
        let path = packed.folder.path().join(name);
        assert_eq!(mesh(&packed.store, &path, &isosurface(2.0), go_on).unwrap(), report);
        let read = brickyard_import::read_mesh(&path).unwrap();
        let mut found: Vec<_> = triangles(&read).collect();
        found.sort_unstable();
        assert!(found == ply.sorted(), "{name}");
    }
}

/// Of formats without a unit, too.
#[test]
fn every_file_tells_the_unit_and_whose_sides_its_axes_are() {
    let sphere = Made::new([20, 20, 20], within_sphere(DVec3::splat(9.5), 7.0));
    let rows = [[-1.0, 0.0, 0.0, 3.0], [0.0, -1.0, 0.0, 4.0], [0.0, 0.0, 1.0, 5.0]];
    let packed = Packed::image(&sphere.oriented(rows), 8);
    for name in ["a.stl", "a.ply", "a.obj", "a.glb"] {
        let bytes = bytes(&packed, name, &isosurface(0.0));
        for words in ["SPACE=RAS", "unit: millimeter"] {
            assert!(bytes.windows(words.len()).any(|found| found == words.as_bytes()), "{name}: {words}");
        }
    }
}

#[test]
fn far_from_the_origin_coordinates_have_64_bits_or_are_refused() {
    let sphere = Made::new([20, 20, 20], within_sphere(DVec3::splat(9.5), 7.0));
    let packed = Packed::image(&sphere.spaced(DVec3::ONE, DVec3::splat(5e6)), 8);
    let (found, _) = packed.ply(&isosurface(0.0));
    assert_eq!(found.checked(), 2);
    assert!(bytes(&packed, "a.obj", &isosurface(0.0)).windows(8).any(|w| w.starts_with(b"v 500000")));
    for name in ["a.stl", "a.glb"] {
        let error = mesh(&packed.store, &packed.folder.path().join(name), &isosurface(0.0), go_on).unwrap_err();
        assert!(error.to_string().contains("write .ply or .obj"), "{error}");
    }
}

#[test]
fn refusals_say_what_to_do_and_leave_nothing() {
    let packed = Packed::image(&Made::new([20, 20, 20], |[x, ..]| x as u8), 8);
    let labels = Packed::labels(&Made::new([20, 20, 20], |[x, ..]| (x / 7) as u8), 8);
    let out = tempfile::tempdir().unwrap();
    let attempt = |packed: &Packed, name: &str, request: MeshRequest| {
        mesh(&packed.store, &out.path().join(name), &request, go_on).unwrap_err().to_string()
    };
    let request = isosurface(5.0);
    assert!(attempt(&packed, "a.off", request).contains(".stl, .ply, .obj or .glb"));
    assert!(attempt(&packed, "a.ply", isosurface(f64::NAN)).contains("finite"));
    assert!(attempt(&packed, "a.ply", isosurface(20.0)).contains("from 0 to 19"));
    assert!(attempt(&packed, "a.ply", MeshRequest { level: Level(9), ..request }).contains("expected 0 to"));
    assert!(attempt(&packed, "a.ply", MeshRequest { time: 1, ..request }).contains("time step 1"));
    assert!(attempt(&packed, "a.ply", MeshRequest { channel: 1, ..request }).contains("channel 1"));
    let region = Some(VoxelBox::new([0, 0, 0], [21, 1, 1]));
    assert!(attempt(&packed, "a.ply", MeshRequest { region, ..request }).contains("inside 0:20,0:20,0:20"));
    let region = Some(VoxelBox::new([0, 0, 0], [5, 5, 5]));
    assert!(attempt(&packed, "a.ply", MeshRequest { region, ..request }).contains("in this box"));
    assert!(attempt(&packed, "a.ply", MeshRequest::new(MeshSurface::Label(1))).contains("choose an isovalue"));
    assert!(attempt(&labels, "a.ply", request).contains("choose a label"));
    assert!(attempt(&labels, "a.ply", MeshRequest::new(MeshSurface::Label(7))).contains("label 7"));
    assert!(attempt(&labels, "a.stl", MeshRequest::new(MeshSurface::Labels)).contains(".obj or .glb"));
    assert!(attempt(&packed, "a.ply", MeshRequest { smoothing: 21, ..request }).contains("at most 20"));
    for voxels in [0.0, -1.0, 4.5, f64::NAN] {
        let request = MeshRequest { decimation_voxels: Some(voxels), ..request };
        assert!(attempt(&packed, "a.ply", request).contains("more than 0 and at most 4"), "{voxels}");
    }
    assert!(attempt(&packed, "no/a.ply", request).contains("No such file"));
    let cancelled = mesh(&packed.store, &out.path().join("a.ply"), &request, |_, _| ControlFlow::Break(()));
    assert!(matches!(cancelled, Err(MeshError::Cancelled { .. })));
    assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0);
    std::fs::write(out.path().join("a.ply"), "mine").unwrap();
    assert!(attempt(&packed, "a.ply", request).contains("`overwrite`"));
    assert_eq!(std::fs::read(out.path().join("a.ply")).unwrap(), b"mine");
}

#[test]
fn voxels_without_data_are_outside() {
    // A ball of NaN in a block of ones: a hole.
    let centre = DVec3::splat(12.0);
    let value = move |voxel| if (at(voxel) - centre).length() < 5.5 { f32::NAN } else { 1.0 };
    let (found, _) = Packed::image(&Made::new([25, 25, 25], value), 8).ply(&isosurface(0.5));
    assert_eq!(found.checked(), 4);
    let mut source =
        Made::new([25, 25, 25], move |voxel| if (at(voxel) - centre).length() < 5.5 { 200u8 } else { 100 });
    source.info.nodata = Some(200.0);
    let (same, _) = Packed::image(&source, 8).ply(&isosurface(0.5));
    assert!(same.sorted() == found.sorted());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Ambiguous faces, values equal to the isovalue, and no data: closed all the same, with as many sides as there are inner and outer voxels beside
    /// each other.
    #[test]
    fn isosurfaces_of_noise_are_closed(
        extent in prop::array::uniform3(1u32..9), seed in any::<u64>(), values in 2u64..6, isovalue in 0.0f64..5.0, whole in any::<bool>(),
        smoothing in 0u32..3, decimation in prop::option::of(0.05f64..4.0),
    ) {
        let isovalue = if whole { isovalue.floor() } else { isovalue };
        let value = move |voxel| match hashed(voxel, seed) % (values + 1) {
            v if v == values => f32::NAN,
            v => v as f32,
        };
        let packed = Packed::image(&Made::new(extent, value), 8);
        let path = packed.folder.path().join("mesh.ply");
        let request = MeshRequest { smoothing, decimation_voxels: decimation, ..isosurface(isovalue) };
        let is_inside = |voxel: [i64; 3]| {
            let covered = (0..3).all(|a| (0..i64::from(extent[a])).contains(&voxel[a]));
            covered && f64::from(value(voxel.map(|v| v as u32))) >= isovalue
        };
        let mut crossed = 0;
        let ends = extent.map(i64::from);
        for z in -1..=ends[2] {
            for y in -1..=ends[1] {
                for x in -1..=ends[0] {
                    let here = is_inside([x, y, z]);
                    crossed += [[x + 1, y, z], [x, y + 1, z], [x, y, z + 1]].iter().filter(|v| is_inside(**v) != here).count();
                }
            }
        }
        match mesh(&packed.store, &path, &request, go_on) {
            Ok(_) => {
                let found = Ply::read(&std::fs::read(path).unwrap());
                let euler = found.checked();
                if let Some(voxels) = decimation {
                    let whole = MeshRequest { decimation_voxels: None, ..request };
                    let (whole, _) = packed.ply(&whole);
                    prop_assert_eq!(euler, whole.checked());
                    let places: HashSet<_> = whole.places.iter().map(|place| place.to_array().map(f64::to_bits)).collect();
                    prop_assert!(found.places.iter().all(|place| places.contains(&place.to_array().map(f64::to_bits))));
                    for place in &whole.places {
                        prop_assert!(found.distance(*place) < voxels + 1e-5);
                    }
                } else {
                    prop_assert_eq!(found.places.len(), crossed);
                    if smoothing == 0 {
                        prop_assert!(found.volume() > 0.0);
                    }
                }
            }
            Err(MeshError::Empty(_)) => prop_assert_eq!(crossed, 0),
            Err(error) => prop_assert!(false, "{}", error),
        }
    }

    #[test]
    fn labels_of_noise_are_closed(
        extent in prop::array::uniform3(1u32..7), seed in any::<u64>(), labels in 2u64..5, smoothing in 0u32..3,
        decimation_voxels in prop::option::of(0.05f64..4.0),
    ) {
        let value = move |voxel| (hashed(voxel, seed) % labels) as i32 - 1;
        let packed = Packed::labels(&Made::new(extent, value), 8);
        for label in -1..labels as i64 - 1 {
            let path = packed.folder.path().join("mesh.ply");
            let request =
                MeshRequest { smoothing, decimation_voxels, overwrite: true, ..MeshRequest::new(MeshSurface::Label(label)) };
            match mesh(&packed.store, &path, &request, go_on) {
                Ok(report) => {
                    let found = Ply::read(&std::fs::read(path).unwrap());
                    found.checked();
                    prop_assert!(report.objects[0].volume > 0.0);
                }
                Err(MeshError::Empty(_)) => {}
                Err(error) => prop_assert!(false, "{}", error),
            }
        }
    }
}
