//! Coming views: their bricks are there when the views are shown.

use super::*;
use crate::status::Readiness;

/// A step's bricks: level 0, which it wants, and the root; and stand-ins for missing ones, two levels above.
const LEAST: u64 = 125 + 1;
const BRICKS: u64 = LEAST + 8;

fn at_step(view: &View, time: u32) -> View {
    View { time, ..view.clone() }
}

/// Frames of a view until all coming views are whole, or there is no more to do.
fn fetch(pager: &mut Pager, view: &View, atlas: &mut HashMap<u32, Vec<u8>>) -> Frame {
    loop {
        let frame = pager.frame(from_ref(view), Duration::ZERO);
        frame.uploads.iter().for_each(|upload| drop(atlas.insert(upload.slot.0, upload.codes.to_vec())));
        let is_whole = frame.coming.iter().all(|ready| ready.is_whole);
        if is_whole && frame.status.settled {
            return frame;
        }
        drop(frame);
        if !pager.wait(Duration::from_secs(9)) {
            return pager.frame(from_ref(view), Duration::ZERO);
        }
    }
}

fn played(slots: u32, planning: Planning) -> (Arc<TestSource>, Pager, View) {
    let source = Arc::new(TestSource::cube(40).with_times(9));
    let pager = pager_of(&source, PagerConfig { planning, ..config(slots, 4 << 20) });
    let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    (source, pager, view)
}

#[test]
fn a_step_that_is_whole_is_shown_at_once_and_alone() {
    for planning in [Planning::Inline, Planning::Thread] {
        let (source, mut pager, view) = played(900, planning);
        let mut atlas = HashMap::new();
        for time in 0..8 {
            let now = at_step(&view, time);
            pager.expect((time + 1..9.min(time + 3)).map(|time| vec![at_step(&view, time)]).collect());
            let first = pager.frame(from_ref(&now), Duration::ZERO);
            first.uploads.iter().for_each(|upload| drop(atlas.insert(upload.slot.0, upload.codes.to_vec())));
            if time > 0 {
                let status = &first.status;
                assert!(status.covered && status.resident == status.wanted, "{planning:?} {time}: {status:?}");
                assert!(first.uploads.iter().all(|upload| upload.brick.time > time));
            }
            assert!(first.volumes[0].draw.cells.iter().all(|cell| cell.brick.time == time && cell.cell.time == time));
            let frame = fetch(&mut pager, &now, &mut atlas);
            assert!(frame.coming.iter().all(|ready| ready.is_whole && ready.wanted > 0), "{:?}", frame.coming);
            check_atlas(&source, &frame.volumes[0].draw, &atlas);
            let counters = frame.status.counters;
            let steps = u64::from(9.min(time + 3));
            let once = LEAST * steps..=BRICKS * steps;
            assert!(counters.reuploaded == 0 && once.contains(&counters.uploaded), "{time}: {counters:?}");
        }
    }
}

#[test]
fn a_cut_leaves_room_for_the_next_step_of_any_budget() {
    for slots in [20, 60, 150, 260, 400] {
        let (source, mut pager, view) = played(slots, Planning::Inline);
        let mut atlas = HashMap::new();
        let alone = settle(&mut pager, from_ref(&view), &mut atlas).status.wanted;
        pager.expect((1..5).map(|time| vec![at_step(&view, time)]).collect());
        let frame = fetch(&mut pager, &view, &mut atlas);
        check_atlas(&source, &frame.volumes[0].draw, &atlas);
        let half = (slots as usize / 2 * 9 / 10).min(125);
        assert!(frame.status.wanted <= half && frame.coming[0].wanted <= half, "{slots}: {:?}", frame.coming);
        assert!(frame.coming[0].is_whole && frame.status.settled, "{slots}: {:?}", frame.coming);
        let room = slots as usize - frame.status.wanted - 1;
        let whole = frame.coming.iter().filter(|ready| ready.is_whole).count();
        assert!(whole == 4 || (whole + 1) * (half + 1) > room, "{slots}: {:?}", frame.coming);
        // Nothing goes and comes back.
        assert_eq!(pager.frame(from_ref(&view), Duration::ZERO).status.counters.reuploaded, 0);
        assert!(!pager.wait(Duration::from_millis(50)), "at rest");
        // With nothing to come, the view has all slots again.
        pager.expect(Vec::new());
        assert_eq!(settle(&mut pager, from_ref(&view), &mut atlas).status.wanted, alone);
    }
}

#[test]
fn a_step_with_damage_is_whole_without_it() {
    let mut source = TestSource::cube(40).with_times(3);
    let at = |time, level, index| BrickId { time, ..brick(level, index) };
    source.failing = [at(1, 0, [1, 1, 1]), at(2, 3, [0, 0, 0])].into();
    let source = Arc::new(source);
    let mut pager = pager_of(&source, config(900, 4 << 20));
    let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
    pager.expect(vec![vec![at_step(&view, 1)], vec![at_step(&view, 2)]]);
    let frame = fetch(&mut pager, &view, &mut HashMap::new());
    // An unreadable root stands in for nothing, and nothing needs it.
    assert!(frame.coming.iter().all(|ready| ready.is_whole && ready.is_covered), "{:?}", frame.coming);
    pager.expect(vec![vec![at_step(&view, 2)]]);
    let status = settle(&mut pager, &[at_step(&view, 1)], &mut HashMap::new()).status;
    assert_eq!((status.failed, status.covered), (1, true));
    let status = settle(&mut pager, &[at_step(&view, 2)], &mut HashMap::new()).status;
    assert_eq!((status.failed, status.covered), (0, true));
    // Each was read once: playing on does not try again.
    assert_eq!(*source.reads.lock().unwrap(), [(at(1, 0, [1, 1, 1]), 1), (at(2, 3, [0, 0, 0]), 1)].into());
}

/// With slots for only a part of the finest cells, the next step is refined where the present one was visible, and covered elsewhere.
#[test]
fn what_was_seen_of_a_step_says_where_the_next_one_is_refined() {
    for planning in [Planning::Inline, Planning::Thread] {
        // Cells of the next step drawn at the finest level, and how many of them lie where x is low; and all cells' volume.
        let shown = |tells: bool| {
            let (_, mut pager, view) = played(120, planning);
            let mut atlas = HashMap::new();
            settle(&mut pager, from_ref(&view), &mut atlas);
            if tells {
                let drawn = pager.frame(from_ref(&view), Duration::ZERO).volumes.remove(0).draw.cells;
                let seen: Vec<f32> = drawn.iter().map(|cell| (cell.region.min.x < 16) as u8 as f32).collect();
                pager.feedback(0, &pager.drawn(0).unwrap(), &seen);
            }
            pager.expect(vec![vec![at_step(&view, 1)]]);
            fetch(&mut pager, &view, &mut atlas);
            let frame = pager.frame(&[at_step(&view, 1)], Duration::ZERO);
            assert!(frame.status.covered && frame.uploads.is_empty(), "{planning:?}: {:?}", frame.status);
            let cells = &frame.volumes[0].draw.cells;
            let finest = cells.iter().filter(|cell| cell.cell.level == Level(0));
            let volume: u64 = cells.iter().map(|cell| cell.region.extent().volume()).sum();
            (finest.clone().count(), finest.filter(|cell| cell.region.min.x < 16).count(), volume)
        };
        let (all, aside) = (40u64.pow(3), |(finest, seen, _): (usize, usize, u64)| finest - seen);
        let (told, untold) = (shown(true), shown(false));
        assert!(told.0 > 8 && told.2 == all && untold.2 == all, "{planning:?}: {told:?}, {untold:?}");
        assert!(aside(told) < aside(untold), "{planning:?}: {told:?}, {untold:?}");
    }
}

#[test]
fn a_step_that_comes_twice_or_is_shown_already_is_read_once() {
    let (_, mut pager, view) = played(900, Planning::Inline);
    pager.expect([1, 0, 1, 1].map(|time| vec![at_step(&view, time)]).into());
    let frame = fetch(&mut pager, &view, &mut HashMap::new());
    assert_eq!(
        frame.coming,
        [Readiness { wanted: 125, is_planned: true, missing: 0, is_covered: true, is_whole: true }; 4]
    );
    let counters = frame.status.counters;
    assert!(counters.uploaded <= 2 * BRICKS && (LEAST..=BRICKS).contains(&counters.uploaded_ahead), "{counters:?}");
}

#[test]
fn a_level_that_changes_is_told_once_it_is_planned() {
    let (_, mut pager, view) = played(900, Planning::Thread);
    let coarse = View { pixel_error: 64.0, ..at_step(&view, 1) };
    let mut atlas = HashMap::new();
    pager.expect(vec![vec![at_step(&view, 1)]]);
    assert_eq!(fetch(&mut pager, &view, &mut atlas).coming[0].wanted, 125);
    pager.expect(vec![vec![coarse.clone()]]);
    let deadline = std::time::Instant::now() + Duration::from_secs(9);
    loop {
        let ready = pager.frame(from_ref(&view), Duration::ZERO).coming[0];
        assert_eq!(ready.is_planned, ready.wanted < 125, "{ready:?}");
        if ready.is_planned && ready.is_whole {
            break;
        }
        assert!(std::time::Instant::now() < deadline);
        pager.wait(Duration::from_millis(50));
    }
    let frame = pager.frame(from_ref(&coarse), Duration::ZERO);
    assert!(frame.status.resident == frame.status.wanted && frame.status.wanted < 125);
}
