//! Every packed store opens; inputs beyond any store are refused before anything is written.

use super::*;

/// Numbers that a header may hold.
fn odd_number() -> impl Strategy<Value = f64> {
    let odd =
        [0.0, -1.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, f64::MAX, f64::MIN_POSITIVE, 5e-324, 1e300, 1e-300];
    prop_oneof![6 => 0.01f64..100.0, 2 => Just(1.0), 1 => prop::sample::select(odd.to_vec()), 1 => any::<f64>()]
}

fn codec() -> impl Strategy<Value = Codec> {
    prop_oneof![Just(Codec::None), (-3i32..8).prop_map(Codec::Zstd), (-3i32..8).prop_map(Codec::ShuffleZstd)]
}

fn reductions() -> impl Strategy<Value = Reductions> {
    let names = || prop::sample::select(Downsample::ALL.map(Downsample::name).to_vec());
    (names(), prop::option::of(names())).prop_map(|(main, second)| match second {
        Some(second) if second != main => format!("{main},{second}").parse().unwrap(),
        _ => main.parse().unwrap(),
    })
}

fn pack_options() -> impl Strategy<Value = PackOptions> {
    let edge = prop::sample::select(vec![8u32, 8, 16, 16, 32, 4, 12, 0, 512]);
    let shards = prop::sample::select(vec![1u32, 2, 3, 7, 64, 1024, 2048, 0]);
    let rest = (codec(), reductions(), any::<bool>(), 0u32..4, 0u32..4);
    (edge, shards, prop::bool::weighted(0.1), rest).prop_map(
        |(edge, shards, is_off, (codec, downsample, is_labels, aprons, shard_times))| {
            let kind = if is_labels { Kind::Labels } else { Kind::Image };
            let shard_edge = edge * shards + is_off as u32;
            PackOptions { edge, shard_edge, shard_times, codec, downsample, kind, aprons, ..options(VoxelType::U8) }
        },
    )
}

fn source_info() -> impl Strategy<Value = SourceInfo> {
    let shape = (prop::array::uniform3(1u32..40), 1u32..3, 1u32..4);
    let placed = prop::array::uniform3(odd_number());
    let orientation = prop::option::weighted(0.2, prop::array::uniform3(prop::array::uniform4(odd_number())))
        .prop_map(|rows| rows.and_then(|rows| Orientation::new(rows).ok()));
    let words = prop::option::of("[ -~µ\"\\\\]{0,12}");
    let nodata =
        prop::option::weighted(0.4, prop_oneof![4 => Just(0.0), 4 => (0u8..40).prop_map(f64::from), 1 => odd_number()]);
    let voxel_type = prop::sample::select(VoxelType::ALL.to_vec());
    let time = prop::option::of((odd_number(), odd_number(), any::<bool>()));
    (shape, voxel_type, placed, prop::bool::weighted(0.3), orientation, words, nodata, time).prop_map(
        |((extent, times, channels), voxel_type, numbers, is_origin, orientation, unit, nodata, time)| {
            let time = time.map(|(start, step, is_irregular)| {
                let stamps = (0..times).map(|i| start + step * f64::from(i * i)).collect();
                let stamps = if is_irregular { stamps } else { Vec::new() };
                TimeAxis { start, step, stamps, unit: unit.clone(), since: None }
            });
            let mut geometry = Geometry { unit: unit.clone(), ..Geometry::default() };
            *(if is_origin { &mut geometry.origin } else { &mut geometry.spacing }) = numbers.into();
            let (extent, identity) = (Extent::from_array(extent), unit.unwrap_or_default());
            SourceInfo {
                channels,
                times,
                geometry,
                calibrated: is_origin,
                says_origin: is_origin,
                orientation,
                time,
                nodata,
                identity,
                ..SourceInfo::of_volume(extent, voxel_type)
            }
        },
    )
}

fn check_opens<T: Voxel>(info: &SourceInfo, options: &PackOptions, seed: u32) {
    let value = |volume: u32, p: [u32; 3]| {
        let bits = (p[0] + 40 * p[1] + 1600 * p[2] + volume).wrapping_mul(seed | 1);
        match seed % 4 {
            0 => T::from_f64_rounded(f64::from(seed >> 3)),
            // Arbitrary bits: NaN, infinite, subnormal.
            1 => bytemuck::pod_read_unaligned(&bits.to_le_bytes()[..size_of::<T>()]),
            2 => T::from_f64_rounded(f64::NAN),
            _ => T::from_f64_rounded(value(p)),
        }
    };
    let mut source = Array::series(info.extent.to_array(), info.times, info.channels, value);
    source.info = SourceInfo { voxel_type: T::TYPE, ..info.clone() };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    match pack(&source, &path, options, &()) {
        Ok(_) => {}
        Err(PackError::Options(_) | PackError::Unfit { .. }) => return assert!(!path.exists(), "refused in time"),
        Err(error) => panic!("{error}"),
    }
    for method in std::iter::once(options.downsample.main()).chain(options.downsample.second()) {
        let store = Store::open_reduced(&path, method, IoMode::default()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(store.geometry(), &info.geometry);
        assert_eq!(store.time_axis(), info.time.as_ref());
        assert_eq!(
            (store.pyramid().level(Level(0)).extent, store.times(), store.channels()),
            (info.extent, info.times, info.channels)
        );
        let found = store.info();
        assert_eq!(found.shard_times, options.shard_times.min(info.times));
        assert_eq!((found.kind, found.aprons, found.orientation), (options.kind, options.aprons, info.orientation));
        let is_integer = |_: &f64| !T::TYPE.is_float();
        assert_eq!(found.nodata.map(|nodata| nodata as f64), info.nodata.filter(is_integer));
        assert_eq!((&found.source, found.downsample), (&info.identity, options.downsample));
    }
    assert_eq!(crate::verify::verify(&path, |_, _| {}).unwrap().problems, []);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn whatever_pack_writes_open_reads(info in source_info(), options in pack_options(), seed in any::<u32>()) {
        brickyard_volume::with_voxel_type!(info.voxel_type, T => check_opens::<T>(&info, &options, seed));
    }
}

#[test]
fn what_cannot_be_opened_is_refused_before_anything_is_written() {
    let array = || Array::new([20, 20, 20], |p| value(p) as u8);
    let refused = |source: Array<u8>, options: &PackOptions, words: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        let error = pack(&source, &dir.path().join("s.zarr"), options, &()).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{words:?} in {error}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    };
    let sound = options(VoxelType::U8);
    refused(array(), &PackOptions { shard_edge: 16384, ..sound.clone() }, &["`shard_edge` 16384", "8192"]);
    refused(array(), &PackOptions { shard_edge: 0, ..sound.clone() }, &["`shard_edge` 0"]);
    for bad in [f64::INFINITY, f64::NAN, 0.0, -1.0, f64::MAX, 5e-324] {
        let mut source = array();
        source.info.geometry.spacing.y = bad;
        refused(source, &sound, &["spacing", "`spacing` X,Y,Z", &format!("{bad:?}")]);
    }
    let mut source = array();
    source.info.geometry.origin.z = f64::NEG_INFINITY;
    refused(source, &sound, &["origin", "-inf"]);
    let mut source = array();
    source.info.geometry.spacing.x = 1e-7;
    source.info.orientation = Orientation::new([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).ok();
    refused(source, &sound, &["orientation", "`spacing` X,Y,Z"]);
    let mut source = array();
    source.info.channels = 5000;
    refused(source, &sound, &["channels", "5000", "4096"]);
    let mut source = array();
    source.info.extent = Extent::from_array([u32::MAX; 3]);
    refused(source, &sound, &["2^63"]);
}

/// Advice is sufficient and complete.
#[test]
fn too_little_memory_is_told_with_what_would_do() {
    let source = Array::new([200, 200, 200], |p| value(p) as u8);
    let mut seen = [0; 3];
    for edge in [8, 16, 32, 64, 128, 256] {
        for threads in [1, 2, 8, 64] {
            for memory_bytes in [20, 26, 30, 40, 60, 100, 200, 400].map(|mib| mib << 20) {
                let options =
                    PackOptions { edge, shard_edge: 512, threads, memory_bytes, ..PackOptions::new(VoxelType::U8) };
                let Err(PackError::Memory { needed_bytes, advice, .. }) = plan(&source, &options) else { continue };
                assert!(needed_bytes > memory_bytes);
                let number = |option: &str| {
                    let (_, rest) = advice.split_once(option)?;
                    rest.split(|c: char| !c.is_ascii_digit()).next()?.parse::<u32>().ok()
                };
                let (j, brick) = (number("`threads` "), number("`edge` "));
                let with = |threads: Option<u32>, edge: Option<u32>| PackOptions {
                    threads: threads.map_or(options.threads, |n| n as usize),
                    edge: edge.unwrap_or(options.edge),
                    ..options.clone()
                };
                let together = advice.contains("one thread and");
                let advised = if together { vec![with(j, brick)] } else { vec![with(j, None), with(None, brick)] };
                for advised in advised.into_iter().filter(|advised| *advised != options) {
                    assert!(plan(&source, &advised).is_ok(), "{options:?}: {advice}");
                }
                seen[if together {
                    1
                } else if advice.is_empty() {
                    2
                } else {
                    0
                }] += 1;
                // Everything helpful is advised.
                let helps = |options: &PackOptions| plan(&source, options).is_ok();
                assert!(j.is_some() || !helps(&with(Some(1), None)), "{options:?}: {advice}");
                assert!(
                    brick.is_some() || ![8, 16, 32, 64, 128, 256].iter().any(|&e| helps(&with(None, Some(e)))),
                    "{options:?}"
                );
            }
        }
    }
    assert!(seen.iter().all(|&n| n > 0), "{seen:?}");
}
