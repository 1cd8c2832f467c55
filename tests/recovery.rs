//! Failures in mid-flight: of the GPU's device, and of the files of an open store.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::session::{Session, SessionError};
use brickyard::volume::{BrickId, BrickIndex, Extent, Geometry, Level, LevelPolicy, Scene, TransferFunction};
use brickyard_tests::{FunctionSource, TestStore, WAYS, assert_same, session, session_within, settled};
use std::fs::{OpenOptions, remove_file};
use std::ops::RangeInclusive;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

const SIZE: (u32, u32) = (64, 48);

/// One test at a time: lavapipe (Mesa 22.3) was seen to take minutes for a device during the destruction of another.
static TURN: Mutex<()> = Mutex::new(());

fn turn() -> MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

const COMPOSITORS: [CompositorChoice; 3] =
    [CompositorChoice::Sorted, CompositorChoice::Raycast, CompositorChoice::Compute];

/// 64^3 voxels in bricks of 16^3; 3 MiB hold a part of them.
fn waves() -> TestStore {
    let extent = Extent::new(64, 64, 64);
    TestStore::pack(&FunctionSource::new(extent, Geometry::default(), |_, _, [x, y, z]| (x ^ y ^ z) as u8 * 4), 16)
}

fn destroy_device(session: &Session) {
    session.backend().expect("it has drawn").destroy_device();
}

#[test]
fn a_lost_device_is_started_anew_with_the_same_picture() {
    let _turn = turn();
    let store = waves();
    for compositor in COMPOSITORS {
        for mebibytes in [3, 64] {
            let way = (BackendChoice::Gpu, compositor);
            let Some(mut session) = session_within(&store.store, way, mebibytes << 20, 16 << 20) else { return };
            let scene = Scene::default();
            let (before, _) = settled(&mut session, &scene, SIZE);
            assert!(before.rgb.iter().any(|p| *p != before.rgb[0]), "a flat picture proves nothing");
            let frame = session.step(&scene, SIZE).expect("it was drawn before");

            // Detected by drawing, by uploading for a new view, and by drawing in a new size.
            destroy_device(&session);
            let anew = session.draw(&frame).expect("drawn anew");
            // Not byte for byte: threads may bring bricks to other slots, where texture coordinates are rounded
            // differently.
            assert_same(&anew, &before, &format!("{way:?} within {mebibytes} MiB"));
            destroy_device(&session);
            let aside = Scene { pixel_error: 0.5, ..scene.clone() };
            let (_, stats) = settled(&mut session, &aside, SIZE);
            assert_eq!(stats.device_losses, 2, "{way:?}: {stats:?}");
            destroy_device(&session);
            settled(&mut session, &aside, (32, 32));
            assert_eq!(session.device_losses(), 3);

            let (after, stats) = settled(&mut session, &scene, SIZE);
            assert_same(&after, &before, &format!("{way:?} within {mebibytes} MiB, after other views"));
            assert!(stats.gpu_bytes_peak <= mebibytes << 20 && stats.bricks.failed == 0, "{stats:?}");
        }
    }
}

#[test]
fn a_device_that_is_always_lost_is_an_error() {
    let _turn = turn();
    let store = waves();
    for compositor in COMPOSITORS {
        let Some(mut session) = session_within(&store.store, (BackendChoice::Gpu, compositor), 64 << 20, 16 << 20)
        else {
            return;
        };
        let scene = session.resolve(&Scene::default(), SIZE).expect("the scene is possible");
        // Uploads go out in batches, so not every step finds the device lost.
        session.fit(&scene).expect("there is memory");
        let error = (0..1000).find_map(|_| {
            destroy_device(&session);
            session.wait(Duration::from_millis(5));
            session.step_resolved(&scene).err()
        });
        let error = error.expect("four losses without a picture");
        assert!(matches!(error, SessionError::LostAgain { times: 4, .. }), "{error}");
        assert!(error.to_string().contains("lost"), "{error}");
    }
}

/// Name, whether the shard is open, the number of its 64 bricks lost, and the operation.
type Harm<'a> = (&'a str, bool, RangeInclusive<u64>, &'a dyn Fn(&Path));

/// One shard of eight is harmed in an open store, before or after the shard itself was opened: the picture has no hole,
/// and the unreadable bricks are counted.
#[test]
fn files_that_change_under_an_open_store_are_drawn_around() {
    let _turn = turn();
    let truncate = |path: &Path, bytes| OpenOptions::new().write(true).open(path).and_then(|file| file.set_len(bytes));
    let harms: [Harm<'_>; 5] = [
        ("halved", true, 2..=64, &|path| {
            truncate(path, path.metadata().expect("it is there").len() / 2).expect("it is ours");
        }),
        ("emptied", true, 64..=64, &|path| truncate(path, 0).expect("it is ours")),
        ("one byte changed", true, 1..=1, &|path| {
            let file = OpenOptions::new().read(true).write(true).open(path).expect("it is there");
            let mut byte = [0];
            file.read_exact_at(&mut byte, 20).expect("the first brick has more");
            file.write_all_at(&[!byte[0]], 20).expect("it is ours");
        }),
        // Mapped files stay.
        ("removed", true, 0..=0, &|path| remove_file(path).expect("it is there")),
        ("removed before it was opened", false, 64..=64, &|path| remove_file(path).expect("it is there")),
    ];
    let extent = Extent::new(64, 64, 64);
    let noise = |_, _, [x, y, z]: [u32; 3]| (x ^ y.wrapping_mul(31) ^ z.wrapping_mul(57)) as u8 | 1;
    // One opaque colour for all values: a hole would show the background, and all levels are alike.
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 0.5, 0.0]],
        opacity: vec![[0.0, 1.0]],
        unit_distance: 0.1,
        ..TransferFunction::default()
    };
    let scene =
        |level| Scene { background: [0.0, 0.0, 1.0], level: LevelPolicy::Locked(level), ..Scene::of(transfer.clone()) };
    for (what, is_open, failed, harm) in harms {
        // Reading does not depend on the way to draw: all ways once, then the fastest.
        let ways = if what == "halved" { &WAYS[..] } else { &[(BackendChoice::Cpu, CompositorChoice::Raycast)] };
        for &way in ways {
            let test = TestStore::pack(&FunctionSource::new(extent, Geometry::default(), noise), 8);
            let Some(mut session) = session(&test.store, way) else { continue };
            let (before, _) = settled(&mut session, &scene(1), SIZE);
            let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(0, 0, 0) };
            if is_open {
                assert!(test.store.is_stored(id).expect("the shard is whole"));
            }
            harm(&test.store.layout().shard_path(&test.path(), test.store.layout().shard_of(id).0));
            let (after, stats) = settled(&mut session, &scene(0), SIZE);
            assert_same(&after, &before, &format!("{what}, {way:?}"));
            assert!(failed.contains(&stats.bricks.failed), "{what}, {way:?}: {stats:?}");
            assert_eq!(stats.bricks.resident + stats.bricks.failed, stats.bricks.wanted, "{what}, {way:?}: {stats:?}");
            assert_eq!(stats.completeness < 1.0, stats.bricks.failed > 0, "{what}, {way:?}: {stats:?}");
        }
    }
}
