//! The pager through its frames, with test sources: loading, drawing, eviction and failures.

use super::*;
use crate::budget::Planning;
use crate::dither::PixelShare;
use crate::draw_list::DrawCell;
use crate::slot_contents::encoding_of;
use crate::test_source::{TestSource, box_view, config};
use crate::upload_budget::UploadLimits;
use brickyard_volume::{
    BrickId, BrickIndex, Extent, Level, LevelPolicy, Occupancy, Placement, Projection, Pyramid, ViewRays, VoxelType,
};
use std::collections::HashMap;
use std::slice::from_ref;

mod coming;
mod same;

fn brick(level: u8, index: [u32; 3]) -> BrickId {
    BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::from_array(index) }
}

/// A pager of one volume.
fn pager_of(source: &Arc<TestSource>, config: PagerConfig) -> Pager {
    let shared: Arc<dyn BrickSource> = source.clone();
    Pager::new(from_ref(&shared), config).unwrap()
}

/// Frames until settled, uploads applied to `atlas`.
fn settle(pager: &mut Pager, views: &[View], atlas: &mut HashMap<u32, Vec<u8>>) -> Frame {
    let deadline = std::time::Instant::now() + Duration::from_secs(20);
    loop {
        let frame = pager.frame(views, Duration::ZERO);
        for upload in &frame.uploads {
            atlas.insert(upload.slot.0, upload.codes.to_vec());
        }
        assert!(frame.status.host_bytes_peak <= pager.config().host_bytes);
        if frame.status.settled {
            return frame;
        }
        assert!(std::time::Instant::now() < deadline, "not settled: {:?}", frame.status);
        drop(frame);
        pager.wait(Duration::from_secs(1));
    }
}

/// The first own voxel of the brick drawn for each cell is the source's.
fn check_atlas(source: &TestSource, draw: &DrawList, atlas: &HashMap<u32, Vec<u8>>) {
    let encoding = encoding_of(source, 0);
    let (edge, bytes) = (source.pyramid().edge() as usize, encoding.format.bytes());
    let side = edge + 2;
    for cell in &draw.cells {
        let mut core = vec![0; edge.pow(3) * source.voxel_type().bytes()];
        source.read_core(cell.brick, &mut core).unwrap();
        let mut codes = vec![0; edge.pow(3) * bytes];
        encoding.encode(&core, &mut codes);
        let first = (side * side + side + 1) * bytes;
        assert_eq!(atlas[&cell.slot.0][first..first + bytes], codes[..bytes], "{}", cell.brick);
    }
}

#[test]
fn a_threaded_pager_settles_around_failures_within_its_budget() {
    let pyramid = Pyramid::new(Extent::new(64, 50, 33), [1.0; 3], 8);
    let mut source = TestSource::new(pyramid, [1.0; 3], VoxelType::F32);
    // A cell, a cell with its parent, a panicking cell, and a brick that only matters as a neighbour.
    source.failing = [brick(0, [1, 1, 1]), brick(0, [4, 4, 2]), brick(1, [2, 2, 1])].into();
    source.panicking = [brick(0, [7, 0, 0])].into();
    let source = Arc::new(source);
    // About 40 of the 280 cores fit.
    let mut pager = pager_of(&source, config(400, 400 * TABLE_BYTES_PER_SLOT + 64 * 1024));
    let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    view.level = LevelPolicy::Locked(0);
    let mut atlas = HashMap::new();
    let frame = settle(&mut pager, from_ref(&view), &mut atlas);
    let status = &frame.status;
    assert_eq!((status.wanted, status.resident, status.failed), (280, 277, 3));
    assert!(status.covered && status.error.is_none() && !status.memory_bound);
    assert!(status.completeness > 0.9 && status.completeness < 1.0);
    // The damaged parent is met as a stand-in.
    assert_eq!(status.counters.failed, 4);
    let drawn = |cell| frame.volumes[0].draw.cells.iter().find(|c| c.cell == cell).map(|c| c.brick);
    assert_eq!(drawn(brick(0, [1, 1, 1])), Some(brick(1, [0, 0, 0])));
    assert_eq!(drawn(brick(0, [4, 4, 2])), Some(brick(2, [1, 1, 0])));
    // The same view again uploads and reads nothing.
    let again = pager.frame(from_ref(&view), Duration::ZERO);
    assert!(again.uploads.is_empty() && again.status.settled && again.status.counters == status.counters);
    assert!(!pager.wait(Duration::from_secs(9)), "nothing is on its way");
    check_atlas(&source, &frame.volumes[0].draw, &atlas);
}

#[test]
fn a_panic_beside_the_decoder_gives_a_brick_up_and_no_more() {
    let mut source = TestSource::cube(64);
    source.advice = |ids| assert!(!ids.contains(&brick(0, [7, 7, 7])), "told to");
    let source = Arc::new(source);
    let mut pager = pager_of(&source, config(600, 1 << 20));
    let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    view.level = LevelPolicy::Locked(0);
    let status = settle(&mut pager, from_ref(&view), &mut HashMap::new()).status;
    // The batch with the panicking brick is advised anew by each new plan, and no brick of a replaced plan counts as failed.
    assert!(status.failed < 9 && status.resident + status.failed == 512, "{status:?}");
    // Bricks of a replaced plan may arrive later; none stays under way for ever.
    let mut left = 512;
    while pager.wait(Duration::from_secs(9)) {
        pager.frame(from_ref(&view), Duration::ZERO);
        left -= 1;
        assert!(left > 0, "something is always on its way");
    }
}

#[test]
fn one_slot_shows_the_root_of_each_channel() {
    let source = Arc::new(TestSource::cube(40));
    let mut pager = pager_of(&source, config(1, 8192));
    let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    let mut atlas = HashMap::new();
    for channel in [0, 1, 0] {
        let frame = settle(&mut pager, &[View { channel, ..view.clone() }], &mut atlas);
        assert_eq!(frame.volumes[0].draw.cells.len(), 1);
        assert_eq!(frame.volumes[0].draw.cells[0].brick.channel, channel);
        check_atlas(&source, &frame.volumes[0].draw, &atlas);
    }
    assert_eq!(pager.frame(from_ref(&view), Duration::ZERO).status.counters.reuploaded, 1);
}

/// Once its slots are full, a renderer that keeps uploads has a former brick's buffer for each; the exchanged buffers are reused, and count
/// as the pager's.
#[test]
fn buffers_that_a_renderer_no_longer_keeps_serve_again() {
    let source = Arc::new(TestSource::cube(40));
    let view = View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Perspective { fov_y_deg: 30.0 }) };
    let host_bytes_after = |gives_back: bool| {
        let mut pager = pager_of(&source, config(40, 1 << 16));
        let mut atlas: HashMap<u32, Arc<[u8]>> = HashMap::new();
        for i in 0..6 {
            let views = [View { channel: i % 2, ..view.clone() }];
            loop {
                let frame = pager.frame(&views, Duration::ZERO);
                for upload in &frame.uploads {
                    let before = atlas.insert(upload.slot.0, upload.codes.clone());
                    before.into_iter().filter(|_| gives_back).for_each(|before| pager.take_for(upload, before));
                }
                assert!(frame.status.host_bytes_peak <= pager.config().host_bytes);
                if frame.status.settled {
                    let kept = atlas.iter().map(|(&slot, codes)| (slot, codes.to_vec())).collect();
                    check_atlas(&source, &frame.volumes[0].draw, &kept);
                    break;
                }
                drop(frame);
                pager.wait(Duration::from_secs(1));
            }
        }
        // By then the last frame's buffers have been given back, too.
        pager.frame(&[View { channel: 1, ..view.clone() }], Duration::ZERO).status.host_bytes
    };
    let padded = 10 * 10 * 10;
    let (with, without) = (host_bytes_after(true), host_bytes_after(false));
    assert!(with >= without + padded, "{with} bytes, and without {without}");
}

#[test]
fn bricks_that_fail_for_a_passing_reason_come_in_the_same_view() {
    for apron in [0, 1] {
        let make = || TestSource::cube(40).with_aprons(apron);
        let view =
            View { level: LevelPolicy::Locked(0), ..box_view(&make(), Projection::Perspective { fov_y_deg: 30.0 }) };
        let drawn = |source: TestSource| {
            let mut pager = pager_of(&Arc::new(source), config(200, 1 << 20));
            let mut atlas = HashMap::new();
            let frame = settle(&mut pager, from_ref(&view), &mut atlas);
            let status = frame.status;
            assert_eq!((status.resident, status.failed, status.counters.failed), (status.wanted, 0, 0), "{status:?}");
            let bricks = frame.volumes[0].draw.cells.iter().map(|cell| (cell.brick, atlas[&cell.slot.0].clone()));
            bricks.collect::<Vec<_>>()
        };
        // One wanted by all the others around it, and one at a corner, after several tries.
        let source = make();
        *source.passing.lock().unwrap() = [(brick(0, [2, 2, 2]), 3), (brick(0, [0, 0, 0]), 1)].into();
        // Aprons too are whole: nothing stands in for a neighbour that comes later.
        assert!(drawn(source) == drawn(make()), "stored aprons of {apron}");
    }
}

#[test]
fn what_does_not_pass_is_given_up_and_tried_once_more_by_a_new_view() {
    let (passing, lasting) = (brick(0, [1, 1, 1]), brick(0, [3, 3, 3]));
    let mut source = TestSource::cube(40);
    source.failing.insert(lasting);
    source.passing.lock().unwrap().insert(passing, u32::MAX);
    let source = Arc::new(source);
    let mut pager = pager_of(&source, config(200, 1 << 20));
    let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    view.level = LevelPolicy::Locked(0);
    let reads = || [passing, lasting].map(|id| source.reads.lock().unwrap()[&id]);
    let tries = crate::retry::TRIES as u32;
    for (pixel_error, still, expected) in [(1.0, u32::MAX, tries), (1.1, u32::MAX, tries + 1), (1.2, 0, tries + 1)] {
        source.passing.lock().unwrap().insert(passing, still);
        view.pixel_error = pixel_error;
        let status = settle(&mut pager, from_ref(&view), &mut HashMap::new()).status;
        assert_eq!(reads(), [expected, 1], "at {pixel_error}");
        assert_eq!(status.failed, if still > 0 { 2 } else { 1 });
        assert_eq!(status.counters.failed, 2, "each is counted once");
    }
}

#[test]
fn slots_that_lost_their_bricks_are_filled_again() {
    let source = Arc::new(TestSource::cube(40));
    let mut pager = pager_of(&source, config(200, 1 << 20));
    let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    let before = settle(&mut pager, from_ref(&view), &mut HashMap::new());
    let decoded = before.status.counters.decoded;
    // Fewer slots make a coarser cut; more than at the start were not accounted for.
    for (slots, used) in [(200, 200), (20, 20), (500, 20)] {
        pager.forget_slots(slots).unwrap();
        assert_eq!(pager.config().slots, used);
        let mut atlas = HashMap::new();
        let frame = settle(&mut pager, from_ref(&view), &mut atlas);
        check_atlas(&source, &frame.volumes[0].draw, &atlas);
        assert_eq!(frame.volumes[0].draw.cells.len() == before.volumes[0].draw.cells.len(), used == 200);
        let counters = frame.status.counters;
        assert_eq!(counters.reuploaded, 0, "this is no thrash");
        assert!(used != 200 || counters.decoded == decoded, "decoded bricks are kept");
    }
    assert!(matches!(pager.forget_slots(0), Err(PagerError::Slots { given: 0, least: 1, .. })));
}

#[test]
fn frames_upload_no_more_than_asked_but_always_something() {
    // 1,000 bytes a brick.
    for (bytes, most) in [(2500, 2), (500, 1)] {
        let source = Arc::new(TestSource::cube(64));
        source.read_core(brick(0, [0, 0, 0]), &mut [0; 512]).unwrap();
        let uploads = Some(UploadLimits { bytes, time: Duration::from_secs(9) });
        let mut pager = pager_of(&source, PagerConfig { uploads, ..config(300, 1 << 20) });
        let view = View { pixel_error: 8.0, ..box_view(&source, Projection::Perspective { fov_y_deg: 30.0 }) };
        let mut frame = pager.frame(from_ref(&view), Duration::ZERO);
        while !frame.status.settled {
            assert!(pager.wait(Duration::from_secs(9)));
            frame = pager.frame(from_ref(&view), Duration::ZERO);
            assert!(frame.uploads.len() <= most, "{}", frame.uploads.len());
            assert!(!frame.uploads.is_empty() || !pager.residency.has_staged(), "what has come waits");
        }
        let counters = frame.status.counters;
        assert_eq!(counters.bytes_uploaded, counters.uploaded * 1000);
        assert_eq!(counters.bytes_read, counters.decoded * 512, "of this pager alone");
    }
}

#[test]
fn a_renderer_may_keep_the_codes() {
    let source = Arc::new(TestSource::cube(64));
    let mut pager = pager_of(&source, config(600, 600 * TABLE_BYTES_PER_SLOT + 16 * 1024));
    let view = View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Orthographic { height: 200.0 }) };
    let mut kept = Vec::new();
    loop {
        let frame = pager.frame(from_ref(&view), Duration::ZERO);
        kept.extend(frame.uploads.into_iter().map(|upload| (upload.brick, upload.codes.to_vec(), upload.codes)));
        if frame.status.settled {
            break;
        }
        assert!(pager.wait(Duration::from_secs(9)));
    }
    assert!(kept.len() >= 512);
    for (brick, then, now) in &kept {
        assert!(then[..] == now[..], "{brick} was written over");
    }
}

#[test]
fn a_volume_without_a_readable_brick_is_an_error() {
    let mut source = TestSource::cube(8);
    source.failing = [brick(0, [0, 0, 0])].into();
    let source = Arc::new(source);
    let mut pager = pager_of(&source, config(4, 1 << 16));
    let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    let status = settle(&mut pager, from_ref(&view), &mut HashMap::new()).status;
    assert!(!status.covered);
    assert_eq!(status.error.map(|err| err.id), Some(brick(0, [0, 0, 0])));
}

#[test]
fn a_planner_thread_that_looks_ahead_settles_on_what_a_cold_cut_wants() {
    let source = Arc::new(TestSource::cube(64));
    let live = PagerConfig { planning: Planning::Thread, prefetch: true, ..config(900, 5 << 18) };
    let mut pager = pager_of(&source, live);
    let projection = Projection::Perspective { fov_y_deg: 60.0 };
    let mut view = View { pixel_error: 5.0, ..box_view(&source, projection) };
    let (mut atlas, eye) = (HashMap::new(), view.rays.eye);
    for i in 0..30u32 {
        // In, and about the volume.
        view.rays.eye = eye * (1.0 - 0.02 * i as f64);
        let frame = pager.frame(from_ref(&view), Duration::from_millis(20) * i);
        for upload in &frame.uploads {
            atlas.insert(upload.slot.0, upload.codes.to_vec());
        }
        check_atlas(&source, &frame.volumes[0].draw, &atlas);
        drop(frame);
        pager.wait(Duration::from_millis(20));
    }
    let frame = settle(&mut pager, from_ref(&view), &mut atlas);
    check_atlas(&source, &frame.volumes[0].draw, &atlas);
    let cold = Cut::new(&*source, &view, crate::cut::cut_capacity(900, 1));
    let wanted: HashMap<BrickId, BrickId> = frame.volumes[0].draw.cells.iter().map(|c| (c.cell, c.brick)).collect();
    assert!(wanted.iter().all(|(cell, brick)| cell == brick) && !frame.status.memory_bound);
    assert!(frame.status.effective_error_px <= 5.0 && wanted.len() >= cold.wanted());
}

#[test]
fn what_is_foreseen_is_there_when_it_is_wanted() {
    let source = Arc::new(TestSource::cube(64));
    let ahead = PagerConfig { prefetch: true, ..config(1200, 2 << 20) };
    let mut pager = pager_of(&source, ahead);
    let whole = box_view(&source, Projection::Orthographic { height: 30.0 });
    let view = |aside: f64| {
        let eye = whole.rays.eye + whole.rays.right.normalize() * aside;
        View { rays: ViewRays { eye, ..whole.rays }, level: LevelPolicy::Locked(0), ..whole.clone() }
    };
    pager.frame(&[view(0.0)], Duration::ZERO);
    let (view_now, now) = (view(1.0), Duration::from_millis(50));
    let mut frame = pager.frame(from_ref(&view_now), now);
    while pager.wait(Duration::from_secs(9)) {
        frame = pager.frame(from_ref(&view_now), now);
    }
    assert!(frame.status.settled && frame.status.counters.uploaded_ahead > 0);
    // The predicted camera is after 300 ms and a frame of 50: 7 farther.
    let then = pager.frame(&[view(7.5)], Duration::from_millis(375)).status;
    assert!(then.settled && then.wanted > 0 && then.completeness == 1.0, "{then:?}");
    let behind = pager.frame(&[view(-12.0)], Duration::from_millis(400)).status;
    assert!(behind.completeness < 1.0, "nothing was to be foreseen there");
}

#[test]
fn what_is_fetched_ahead_does_not_displace_its_like() {
    let source = Arc::new(TestSource::cube(64));
    let mut pager = pager_of(&source, PagerConfig { prefetch: true, ..config(400, 2 << 20) });
    let whole = box_view(&source, Projection::Orthographic { height: 24.0 });
    let view = View { level: LevelPolicy::Locked(0), ..whole };
    let (mut frame, mut frames) = (pager.frame(from_ref(&view), Duration::ZERO), 0);
    while pager.wait(Duration::from_secs(9)) {
        frames += 1;
        assert!(frames < 5000, "bricks come and go for ever: {:?}", frame.status.counters);
        frame = pager.frame(from_ref(&view), Duration::ZERO);
    }
    let counters = frame.status.counters;
    // The neighbours just outside are more than their share, a sixteenth of the slots.
    assert!(frame.status.settled && counters.uploaded_ahead == 25 && counters.reuploaded == 0, "{counters:?}");
}

#[test]
fn what_is_hidden_is_not_read() {
    let source = Arc::new(TestSource::cube(64));
    let view = View { pixel_error: 0.5, ..box_view(&source, Projection::Orthographic { height: 100.0 }) };
    let mut uploaded = Vec::new();
    for shows in [1.0, 0.0] {
        let mut pager = pager_of(&source, config(600, 1 << 20));
        // The farther half of the volume.
        let hides = |cell: &DrawCell| cell.region.min.y >= 32;
        loop {
            let frame = pager.frame(from_ref(&view), Duration::ZERO);
            let told = |cell| if hides(cell) { shows } else { 1.0 };
            let told: Vec<f32> = frame.volumes[0].draw.cells.iter().map(told).collect();
            if frame.status.settled {
                uploaded.push(frame.status.counters.uploaded);
                assert!(frame.status.covered && frame.volumes[0].draw.cells.iter().any(hides));
                break;
            }
            pager.feedback(0, &pager.drawn(0).unwrap(), &told);
            if !frame.status.awaits_feedback {
                pager.wait(Duration::from_secs(9));
            }
        }
    }
    // Before any feedback, some were on their way.
    assert!(uploaded[1] < uploaded[0] * 3 / 4, "{uploaded:?}");
}

/// Feedback on an earlier frame arrives late: of another view it hides nothing there, and of another appearance it has no effect.
#[test]
fn late_feedback_is_of_the_frame_that_it_was_asked_of() {
    let source = Arc::new(TestSource::cube(64));
    let here = View { pixel_error: 0.5, ..box_view(&source, Projection::Orthographic { height: 100.0 }) };
    let mut there = here.clone();
    let middle = source.geometry().world_box(source.pyramid().levels()[0].extent);
    there.rays.eye = (middle.0 + middle.1) - there.rays.eye;
    there.rays.forward = -there.rays.forward;
    there.rays.right = -there.rays.right;
    let other = View { appearance: here.appearance + 1, ..there.clone() };
    let mut pager = pager_of(&source, config(600, 1 << 20));
    let wanted = |pager: &mut Pager, view: &View| loop {
        let Status { wanted, settled, awaits_feedback, .. } = pager.frame(from_ref(view), Duration::ZERO).status;
        if settled || awaits_feedback {
            return wanted;
        }
        pager.wait(Duration::from_secs(9));
    };
    let all = wanted(&mut pager, &here);
    let asked = pager.drawn(0).unwrap();
    assert_eq!(wanted(&mut pager, &there), all);
    // Nothing was visible from here, but that hides nothing from the other side.
    pager.feedback(0, &asked, &vec![0.0; asked.entries()]);
    assert_eq!(wanted(&mut pager, &there), all);
    // From there nothing is visible either; late feedback of another appearance does not change this.
    let asked_there = pager.drawn(0).unwrap();
    assert_eq!(wanted(&mut pager, &other), all);
    let asked_other = pager.drawn(0).unwrap();
    wanted(&mut pager, &there);
    pager.feedback(0, &asked_there, &vec![0.0; asked_there.entries()]);
    let hidden = wanted(&mut pager, &there);
    assert!(hidden < all / 2, "{hidden} of {all}");
    pager.feedback(0, &asked_other, &vec![1.0; asked_other.entries()]);
    assert_eq!(wanted(&mut pager, &there), hidden);
}

#[test]
fn a_view_settles_when_all_has_faded_in() {
    let source = Arc::new(TestSource::cube(16));
    let view = View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Orthographic { height: 40.0 }) };
    for fade in [None, Some(Duration::from_millis(200))] {
        // Whatever else is staged, one brick arrives per frame, the root first.
        let uploads = Some(UploadLimits { bytes: 0, time: Duration::from_secs(9) });
        let config = PagerConfig { fade, uploads, workers: 1, ..config(40, 1 << 20) };
        let mut pager = pager_of(&source, config);
        let (mut at, mut shares) = (Duration::ZERO, HashMap::<BrickId, Vec<u8>>::new());
        let last = loop {
            let frame = pager.frame(from_ref(&view), at);
            let fading = frame.volumes[0].draw.cells.iter().filter(|entry| entry.pixels.to < PixelShare::THRESHOLDS);
            fading.for_each(|entry| shares.entry(entry.brick).or_default().push(entry.pixels.to));
            if frame.status.settled {
                break frame;
            }
            assert!(frame.status.error.is_none(), "a cell with two entries is drawn");
            pager.feedback(0, &pager.drawn(0).unwrap(), &vec![1.0; frame.volumes[0].draw.cells.len()]);
            assert!(frame.status.awaits_feedback || pager.wait(Duration::from_secs(9)), "nothing goes on");
            at += Duration::from_millis(50);
        };
        assert!(last.volumes[0].draw.cells.len() == 8 && !last.volumes[0].draw.is_fading() && last.status.covered);
        assert!(!pager.wait(Duration::from_secs(9)), "nothing is on its way");
        assert_eq!(shares.len(), if fade.is_some() { 8 } else { 0 });
        assert!(shares.values().all(|shares| *shares == [1, 16, 32, 48]), "{shares:?}");
    }
}

#[test]
fn budgets_that_hold_no_brick_are_refused_with_the_least_that_works() {
    let source = Arc::new(TestSource::cube(64));
    let shared: Arc<dyn BrickSource> = source.clone();
    let new = |config| Pager::new(from_ref(&shared), config).map(drop);
    assert!(matches!(new(config(0, 1 << 20)), Err(PagerError::Slots { least: 1, least_bytes: 1000, .. })));
    let Err(PagerError::HostMemory { least, .. }) = new(config(4, 100)) else { panic!("100 bytes are too few") };
    assert!(new(config(4, least)).is_ok());
    assert!(matches!(new(PagerConfig { apron: 5, ..config(4, 1 << 20) }), Err(PagerError::Apron { .. })));
}

#[test]
fn volumes_share_slots_and_what_is_hidden_keeps_its_roots() {
    // The first two on one grid, the third elsewhere and twice as large.
    let sources = [TestSource::cube(64), TestSource::cube(64), TestSource::cube(128)].map(Arc::new);
    let shared: Vec<Arc<dyn BrickSource>> = sources.iter().map(|source| source.clone() as _).collect();
    let mut pager = Pager::new(&shared, config(300, 4 << 20)).unwrap();
    let aside = Placement::from_text("1 0 0 70  0 1 0 0  0 0 1 0").unwrap();
    let view = View { pixel_error: 0.5, ..box_view(&sources[0], Projection::Orthographic { height: 200.0 }) };
    let placed = View { placement: aside, ..view.clone() };
    let hidden = |view: &View| View { opaque: Some(Occupancy::NONE), ..view.clone() };
    let mut atlas = HashMap::new();
    let mut wanted = |views: &[View]| {
        let frame = settle(&mut pager, views, &mut atlas);
        for (source, volume) in sources.iter().zip(&frame.volumes) {
            check_atlas(source, &volume.draw, &atlas);
        }
        let cuts = frame.volumes.iter().map(|volume| volume.cut).collect::<Vec<_>>();
        assert!(cuts == [0, 0, 2] && frame.status.wanted == frame.status.resident);
        let ranks = |i: usize| frame.volumes[i].draw.cells.iter().map(|c| (c.cell, c.rank)).collect::<Vec<_>>();
        let both_shown = !ranks(0).is_empty() && !ranks(1).is_empty();
        assert!(!both_shown || ranks(0) == ranks(1), "cells of one cut in one order");
        (frame.status.memory_bound, frame.volumes.iter().map(|volume| volume.draw.cells.len()).collect::<Vec<_>>())
    };
    let all = [view.clone(), view.clone(), placed.clone()];
    let (is_bound, together) = wanted(&all);
    assert!(
        is_bound && together.iter().all(|&cells| cells > 1) && together.iter().sum::<usize>() <= 270,
        "{together:?}"
    );
    // One volume can have everything unused by the others.
    let (_, alone) = wanted(&[hidden(&view), hidden(&view), placed.clone()]);
    assert!(alone[..2] == [0, 0] && alone[2] > together[2] + 50 && alone[2] <= 268, "{alone:?}");
    let (_, first) = wanted(&[view.clone(), hidden(&view), hidden(&placed)]);
    assert!(first[0] > together[0] + 50 && first[1..] == [0, 0], "{first:?}");
    assert_eq!(wanted(&all), (true, together), "the same as before");
    let least = Pager::new(&shared, config(2, 4 << 20)).map(drop);
    assert!(matches!(least, Err(PagerError::Slots { given: 2, least: 3, .. })));
    let Err(PagerError::HostMemory { given: 9, least }) = Pager::new(&shared, config(3, 9)).map(drop) else { panic!() };
    assert!(Pager::new(&shared, config(3, least)).is_ok() && Pager::new(&shared, config(3, least - 1)).is_err());
}

/// A renderer in need of one order has it from the first frame in which volumes stand in one place.
#[test]
fn volumes_that_come_to_share_a_grid_share_its_cut_at_once() {
    // So many cells that a plan takes longer than a frame waits for it.
    let source = Arc::new(TestSource::cube(256));
    let live = PagerConfig { planning: Planning::Thread, ..config(40_000, 1 << 30) };
    let mut pager = Pager::new(&[source.clone() as _, source.clone() as _], live).unwrap();
    let here = View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Orthographic { height: 600.0 }) };
    let aside = Placement::from_text("1 0 0 70  0 1 0 0  0 0 1 0").unwrap();
    let apart = [here.clone(), View { placement: aside, ..here.clone() }];
    for turn in 0..3 {
        for (views, expected) in [(&apart, [0, 1]), (&[here.clone(), here.clone()], [0, 0])] {
            let frame = pager.frame(views, Duration::ZERO);
            assert_eq!([0, 1].map(|i: usize| frame.volumes[i].cut), expected, "turn {turn}");
        }
    }
}

#[test]
fn another_pager_goes_on_with_the_cores_of_one_before() {
    for stored_apron in [0, 2] {
        let source = Arc::new(TestSource::cube(64).with_aprons(stored_apron));
        let view =
            View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Orthographic { height: 200.0 }) };
        let view = [view];
        let bytes = 8 << 20;
        let mut first = pager_of(&source, config(600, bytes));
        settle(&mut first, &view, &mut HashMap::new());
        let decoded = first.frame(&view, Duration::ZERO).status.counters.decoded;
        let mut kept = first.into_cores();
        // Wider aprons, and other slots.
        let config = PagerConfig { apron: 2, slots: 700, ..config(600, bytes) };
        let shared: Arc<dyn BrickSource> = source.clone();
        let mut second = Pager::with_cores(from_ref(&shared), config.clone(), &mut kept).unwrap();
        // Their slots depend on the order of arrival.
        let bricks = |pager: &mut Pager| {
            let mut atlas = HashMap::new();
            let frame = settle(pager, &view, &mut atlas);
            let codes = frame.volumes[0].draw.cells.iter().map(|cell| (cell.brick, atlas[&cell.slot.0].clone()));
            (frame.status.counters.decoded, codes.collect::<HashMap<_, _>>())
        };
        let (again, codes) = bricks(&mut second);
        assert!(decoded > 500 && again == 0, "{decoded}, then {again} of a source with aprons of {stored_apron}");
        assert!(codes.len() == 512 && codes == bricks(&mut pager_of(&source, config)).1, "bricks differ");
        // Cores of another source are not taken, and no more than fit.
        let other: Arc<dyn BrickSource> = Arc::new(TestSource::cube(64));
        let mut kept = second.into_cores();
        let mut third = Pager::with_cores(from_ref(&other), self::config(600, bytes), &mut kept).unwrap();
        assert!(kept.len() == 1 && settle(&mut third, &view, &mut HashMap::new()).status.counters.decoded > 500);
        let small = Pager::with_cores(from_ref(&shared), self::config(600, 800 << 10), &mut kept).unwrap();
        assert!(small.meter.used() <= 800 << 10 && kept.is_empty());
    }
}
