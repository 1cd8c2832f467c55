//! Equal bricks of several time steps: they are read and uploaded once, and every slot holds its brick's voxels.

use super::*;
use crate::assemble::PaddedReader;
use crate::ram_cache::RamCache;
use crate::sameness::CoreHashes;
use crate::status::Counters;
use brickyard_volume::PageId;
use std::collections::HashSet;
use std::sync::{Barrier, mpsc};

/// Time steps after which the object is back.
const PERIOD: u32 = 5;

/// Time steps fetched ahead.
const AHEAD: u32 = 2;

/// A box as large as a brick of level 0, moving along x in a static volume.
fn moving_box(id: BrickId, v: [u32; 3], out: &mut [u8]) {
    let low = [8 * (id.time % PERIOD), 16, 16].map(|at| at >> id.level.0);
    let is_inside = (0..3).all(|axis| (low[axis]..low[axis] + (8 >> id.level.0).max(1)).contains(&v[axis]));
    let still = (v[0] ^ v[1].wrapping_mul(77) ^ v[2].wrapping_mul(1013)).wrapping_mul(2_654_435_761) >> 25;
    out.fill(still as u8 + if is_inside { 128 } else { 0 });
}

fn moving() -> TestSource {
    let mut source = TestSource::cube(8 * PERIOD).with_times(4 * PERIOD);
    source.voxel_at = moving_box;
    source
}

fn at_step(view: &View, time: u32) -> View {
    View { time, ..view.clone() }
}

/// Every drawn slot holds its brick with its apron, voxel by voxel.
fn check_slots(source: &Arc<TestSource>, frame: &Frame, atlas: &HashMap<u32, Vec<u8>>) {
    // It compares nothing.
    let mut oracle = PaddedReader::new(Arc::new(RamCache::new(source.clone(), 1, 64 << 20).unwrap()));
    let mut expected = vec![0; oracle.padded_bytes()];
    assert!(!frame.volumes[0].draw.cells.is_empty());
    for cell in &frame.volumes[0].draw.cells {
        oracle.read(cell.brick, &mut expected).unwrap();
        assert!(atlas[&cell.slot.0] == expected, "{}", cell.brick);
    }
}

#[test]
fn what_stays_the_same_is_neither_read_nor_uploaded_again() {
    for (planning, apron) in [(Planning::Inline, 0), (Planning::Thread, 0), (Planning::Inline, 1)] {
        let source = Arc::new(moving().with_hashes().with_aprons(apron));
        let hashes = CoreHashes::new(&(source.clone() as Arc<dyn BrickSource>), 1 << 20).unwrap();
        let mut pager = pager_of(&source, PagerConfig { planning, ..config(2000, 16 << 20) });
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let (mut atlas, mut held, mut before) = (HashMap::new(), HashSet::new(), Counters::default());
        for time in 0..4 * PERIOD {
            pager.expect(
                (time + 1..=(4 * PERIOD - 1).min(time + AHEAD)).map(|time| vec![at_step(&view, time)]).collect(),
            );
            let frame = loop {
                let frame = pager.frame(&[at_step(&view, time)], Duration::ZERO);
                for upload in &frame.uploads {
                    atlas.insert(upload.slot.0, upload.codes.to_vec());
                    assert!(held.insert(hashes.of_padded(upload.brick)), "{} is in a slot", upload.brick);
                    // Coarser bricks stand in where finer ones are late, sooner or later.
                    let is_seen = time > PERIOD + AHEAD && upload.brick.level == Level(0);
                    assert!(!is_seen, "{planning:?} {time}: {} was there before", upload.brick);
                }
                if frame.status.settled && frame.coming.iter().all(|ready| ready.is_whole) {
                    break frame;
                }
                drop(frame);
                assert!(pager.wait(Duration::from_secs(9)), "{planning:?} {time}");
            };
            check_slots(&source, &frame, &atlas);
            let counters = frame.status.counters;
            let grown = |count: fn(&Counters) -> u64| count(&counters) - count(&before);
            if time > PERIOD + AHEAD && time + AHEAD < 4 * PERIOD {
                assert!(grown(|counters| counters.shared) > 0);
            } else if time > 0 && apron == 0 {
                // The object's former and present places, and everything coarser.
                let coarser: u64 = source.pyramid().levels()[1..].iter().map(|grid| grid.bricks.volume()).sum();
                let decoded = grown(|counters| counters.decoded);
                assert!(decoded <= 2 + coarser, "{planning:?} {time}: {decoded}");
            }
            before = counters;
        }
    }
}

/// Two pages are read at once by their users: no thread waits for another's page.
#[test]
fn pages_of_hashes_are_read_beside_each_other() {
    let readers = 2;
    let mut source = TestSource::cube(8).with_times(readers).with_hashes();
    source.hash_readers_meet = Some(Barrier::new(readers as usize));
    let source: Arc<dyn BrickSource> = Arc::new(source);
    let hashes = Arc::new(CoreHashes::new(&source, 1 << 20).unwrap());
    let (say, said) = mpsc::channel();
    for time in 0..readers {
        let (hashes, say) = (hashes.clone(), say.clone());
        let id = BrickId { time, channel: 0, level: Level(0), index: BrickIndex { x: 0, y: 0, z: 0 } };
        std::thread::spawn(move || say.send(hashes.of_core(id)));
    }
    for _ in 0..readers {
        assert!(said.recv_timeout(Duration::from_secs(60)).expect("both read").is_some());
    }
}

#[test]
fn every_slot_holds_its_brick_whatever_is_evicted_and_wherever_time_jumps() {
    for (slots, apron) in [(20, 0), (60, 0), (150, 1), (300, 0)] {
        let mut source = moving().with_hashes().with_aprons(apron);
        let last = PageId { time: 3, channel: 0, level: Level(0), z: 0, y: 0, x: 0 };
        source.failing_hashes = [last].into();
        let source = Arc::new(source);
        let mut pager = pager_of(&source, config(slots, 4 << 20));
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let (mut atlas, mut time) = (HashMap::new(), 0);
        for i in 0..60 {
            time = (time + if i % 7 == 0 { 13 } else { 1 }) % (4 * PERIOD);
            pager.expect((1..4).map(|n| vec![at_step(&view, (time + n) % (4 * PERIOD))]).collect());
            // Some steps are left before they are whole.
            for _ in 0..i % 4 {
                let frame = pager.frame(&[at_step(&view, time)], Duration::ZERO);
                frame.uploads.iter().for_each(|upload| drop(atlas.insert(upload.slot.0, upload.codes.to_vec())));
            }
            let frame = settle(&mut pager, &[at_step(&view, time)], &mut atlas);
            check_slots(&source, &frame, &atlas);
        }
        assert!(pager.frame(&[at_step(&view, time)], Duration::ZERO).status.counters.shared > 0);
    }
}

#[test]
fn a_brick_that_was_made_without_a_neighbour_is_no_other_steps() {
    let still: fn(BrickId, [u32; 3], &mut [u8]) = |id, v, out| moving_box(BrickId { time: 0, ..id }, v, out);
    for apron in [0, 1] {
        let mut source = moving().with_hashes().with_aprons(apron);
        source.voxel_at = still;
        let damaged = BrickId { time: 1, ..brick(0, [1, 1, 1]) };
        source.failing = [damaged].into();
        source.failing_aprons = [0, 1, 2].map(|x| BrickId { time: 1, ..brick(0, [x, 1, 2]) }).into();
        let source = Arc::new(source);
        let mut pager = pager_of(&source, config(900, 4 << 20));
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let mut atlas = HashMap::new();
        assert_eq!(settle(&mut pager, &[at_step(&view, 1)], &mut atlas).status.failed, 1);
        let frame = settle(&mut pager, &[at_step(&view, 2)], &mut atlas);
        assert_eq!(frame.status.failed, 0);
        check_slots(&source, &frame, &atlas);
        assert!(frame.status.counters.shared > 0);
    }
}

#[test]
fn slots_that_were_lost_hold_nothing() {
    let source = Arc::new(moving().with_hashes());
    let mut pager = pager_of(&source, config(900, 4 << 20));
    let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    settle(&mut pager, from_ref(&view), &mut HashMap::new());
    pager.forget_slots(800).unwrap();
    let mut atlas = HashMap::new();
    let frame = settle(&mut pager, &[at_step(&view, PERIOD)], &mut atlas);
    check_slots(&source, &frame, &atlas);
}
