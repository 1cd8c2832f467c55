//! Generators: the same voxels for any division into boxes, formulas where there are any, and the looks relied on
//! elsewhere.

use super::*;
use proptest::prelude::*;

fn read(source: &SynthSource, time: u32, region: VoxelBox) -> Vec<u8> {
    let mut out = vec![0xa5; region.extent().volume() as usize * source.info.voxel_type.bytes()];
    source.read_box(time, 0, region, &mut out).unwrap();
    out
}

fn values(source: &SynthSource, time: u32, region: VoxelBox) -> Vec<f64> {
    let bytes = read(source, time, region);
    (0..region.extent().volume() as usize).map(|i| source.info.voxel_type.read(&bytes, i)).collect()
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
    (mean, variance.sqrt())
}

const EXTENT: Extent = Extent { x: 45, y: 38, z: 51 };

fn boxes(extent: Extent) -> impl Strategy<Value = VoxelBox> {
    let axis = |n: u32| (0..n).prop_flat_map(move |lo| (Just(lo), lo + 1..=n));
    (axis(extent.x), axis(extent.y), axis(extent.z))
        .prop_map(|(x, y, z)| VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1]))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_box_is_a_piece_of_the_whole(
        region in boxes(EXTENT),
        kind in prop::sample::select(SynthKind::ALL.to_vec()),
        voxel_type in prop::sample::select(vec![VoxelType::U8, VoxelType::U16, VoxelType::F32]),
        time in 0u32..3,
    ) {
        let source = SynthSource::new(kind, EXTENT, voxel_type, 3, 9).unwrap();
        let whole = read(&source, time, EXTENT.full_box());
        let size = voxel_type.bytes();
        let width = region.extent().x as usize * size;
        let mut rows = read(&source, time, region);
        for (z, y) in (region.min.z..region.max.z).flat_map(|z| (region.min.y..region.max.y).map(move |y| (z, y))) {
            let start = EXTENT.linear([region.min.x, y, z]) as usize * size;
            let rest = rows.split_off(width);
            prop_assert!(rows == whole[start..start + width], "{} row {y} of plane {z}", kind.name());
            rows = rest;
        }
    }

    #[test]
    fn boxes_called_constant_are(region in boxes(EXTENT), seed in 0u64..50) {
        for kind in [SynthKind::Sparse, SynthKind::Spheres, SynthKind::Constant] {
            let source = SynthSource::new(kind, EXTENT, VoxelType::U16, 1, seed).unwrap();
            if let Some(constant) = source.constant_in(0, 0, region) {
                prop_assert!(values(&source, 0, region).iter().all(|&v| v == constant));
            }
        }
    }
}

#[test]
fn formulas_agree_with_voxels() {
    let kinds = [SynthKind::MarschnerLobb, SynthKind::Spheres, SynthKind::Sparse, SynthKind::Ramp, SynthKind::Constant];
    // Rounding to an integer; f32 arithmetic on values up to 255.
    for (voxel_type, tolerance) in [(VoxelType::U8, 0.501), (VoxelType::U16, 0.51), (VoxelType::F32, 1e-4)] {
        for kind in kinds {
            let source = SynthSource::new(kind, EXTENT, voxel_type, 1, 3).unwrap();
            for (i, v) in (0u32..).zip(values(&source, 0, EXTENT.full_box())) {
                let (x, y, z) = (i % EXTENT.x, i / EXTENT.x % EXTENT.y, i / EXTENT.x / EXTENT.y);
                let position = DVec3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5);
                let expected = source.value_at(position).unwrap();
                assert!((v - expected).abs() <= tolerance, "{} {x},{y},{z}: {v} {expected}", kind.name());
            }
        }
    }
    assert_eq!(SynthSource::new(SynthKind::Ct, EXTENT, VoxelType::U8, 1, 0).unwrap().value_at(DVec3::ONE), None);
}

#[test]
fn seeds_and_steps_matter_where_they_should() {
    let make = |kind, seed| SynthSource::new(kind, EXTENT, VoxelType::U8, 4, seed).unwrap();
    for kind in [SynthKind::Turbulence, SynthKind::Ct, SynthKind::Flow, SynthKind::Spheres, SynthKind::Sparse] {
        let (a, b) = (make(kind, 1), make(kind, 2));
        assert!(read(&a, 0, EXTENT.full_box()) != read(&b, 0, EXTENT.full_box()), "{}", kind.name());
        assert_ne!(a.info().identity, b.info().identity);
        let moves = read(&a, 0, EXTENT.full_box()) != read(&a, 3, EXTENT.full_box());
        assert_eq!(moves, kind == SynthKind::Flow, "{}", kind.name());
    }
}

#[test]
fn ct_shows_its_materials_under_noise() {
    let n = 64;
    let source = SynthSource::new(SynthKind::Ct, Extent::new(n, n, n), VoxelType::U16, 1, 1).unwrap();
    let around = |x: u32, y: u32, z: u32, r: u32| {
        let region = VoxelBox::new([x - r, y - r, z - r], [x + r, y + r, z + r]);
        mean_and_deviation(&values(&source, 0, region).iter().map(|v| v / 200.0).collect::<Vec<_>>())
    };
    // Air in a corner: 12 and noise of 3. 512 samples give a mean to 0.13 and a deviation to 0.1; five of those.
    let (air, noise) = around(4, 4, 32, 4);
    assert!((air - 12.0).abs() < 0.7 && (noise - 3.0).abs() < 0.5, "{air} {noise}");
    // The core is 205, with turbulence of up to 26 units a deviation.
    let (core, _) = around(32, 32, 32, 3);
    assert!((core - 205.0).abs() < 60.0, "{core}");
    // The wall, at 0.895 of the radius: a slab within its thickness.
    let x = ((1.0 + 0.895) * 0.5 * n as f64) as u32;
    let wall = values(&source, 0, VoxelBox::new([x, 32, 16], [x + 1, 33, 48]));
    let (wall, _) = mean_and_deviation(&wall.iter().map(|v| v / 200.0).collect::<Vec<_>>());
    assert!((wall - 82.0).abs() < 3.0, "{wall}");
}

#[test]
fn turbulence_is_centred_and_uses_the_range() {
    let extent = Extent::new(96, 96, 96);
    let source = SynthSource::new(SynthKind::Turbulence, extent, VoxelType::U8, 1, 7).unwrap();
    let (mean, deviation) = mean_and_deviation(&values(&source, 0, extent.full_box()));
    // A coarsest octave of 27 cells dominates: the mean of one seed wanders by a fraction of the deviation.
    assert!((mean - 128.0).abs() < 25.0 && (20.0..60.0).contains(&deviation), "{mean} {deviation}");
}

#[test]
fn sparse_reaches_past_every_32_bit_product() {
    let extent = Extent::new(1 << 20, 1 << 19, 1 << 18);
    let source = SynthSource::new(SynthKind::Sparse, extent, VoxelType::U8, 1, 0).unwrap();
    let last = VoxelBox::new([extent.x - 2, extent.y - 1, extent.z - 1], extent.to_array());
    assert_eq!(source.constant_in(0, 0, last), None);
    assert_eq!(read(&source, 0, last), [0, SPARSE_LAST_UNITS as u8]);
    let middle = VoxelBox::new([5, 5, 5], [extent.x / 16, extent.y / 16, extent.z / 16]);
    assert_eq!(source.constant_in(0, 0, middle), Some(0.0));
}

#[test]
fn names_round_trip_and_impossible_sets_are_refused() {
    for kind in SynthKind::ALL {
        assert_eq!(kind.name().parse::<SynthKind>(), Ok(kind));
    }
    assert!("ctt".parse::<SynthKind>().unwrap_err().contains("marschner-lobb"));
    let make = |extent, voxel_type, steps| {
        SynthSource::new(SynthKind::Ct, extent, voxel_type, steps, 0).err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert!(make(EXTENT, VoxelType::I16, 1).contains("u8, u16 or f32"));
    assert!(make(EXTENT, VoxelType::U8, 0).contains("size 0"));
    assert!(make(Extent::new(9, 0, 9), VoxelType::U8, 1).contains("size 0"));
    assert!(make(Extent::new(u32::MAX, u32::MAX, 9), VoxelType::U8, 1).contains("2^63"));
    // One voxel along an axis is a volume too.
    assert_eq!(make(Extent::new(1, 1, 1), VoxelType::F32, 1), "");
    let one = SynthSource::new(SynthKind::Ct, Extent::new(1, 1, 1), VoxelType::U8, 1, 0).unwrap();
    assert_eq!(read(&one, 0, one.info.extent.full_box()).len(), 1);
}
