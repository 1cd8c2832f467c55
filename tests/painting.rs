//! A picture drawn by the CPU for an onlooker: shown in progress, and abandoned from another thread.

use brickyard::backend::BackendChoice;
use brickyard::frame_governor::Quality;
use brickyard::pager::Status;
use brickyard::session::{Frame, Painting, Session, SessionOptions, VolumeSource};
use brickyard::volume::{Extent, Geometry, Picture, Scene, TransferFunction};
use brickyard_tests::{FunctionSource, TestStore};
use std::sync::Arc;
use std::time::Duration;

const SIZE: (u32, u32) = (1600, 1200);
const UNDER: [u8; 3] = [9, 8, 7];

fn under() -> Painting {
    let painting = Painting::new(SIZE, 1);
    painting.lay_under(Picture { width: 3, height: 2, rgb: vec![UNDER; 6] });
    painting
}

fn settled(session: &mut Session, step: f64) -> Frame {
    let transfer = TransferFunction { opacity: vec![[0.0, 0.0], [255.0, 0.02]], ..TransferFunction::default() };
    let scene = Scene { step, background: [0.5, 0.2, 0.1], ..Scene::of(transfer) };
    loop {
        let frame = session.step(&scene, SIZE).expect("a frame");
        if frame.status.settled {
            return frame;
        }
        session.wait(Duration::from_millis(5));
    }
}

#[test]
fn a_picture_is_seen_while_it_is_drawn_and_abandoned() {
    let voxel = |_, _, [x, y, z]: [u32; 3]| (5 * x + 2 * y + z) as u8;
    let test = TestStore::pack(&FunctionSource::new(Extent::new(40, 30, 36), Geometry::default(), voxel), 16);
    let options = SessionOptions { backend: BackendChoice::Cpu, threads: 2, ..SessionOptions::default() };
    let mut session = Session::new(vec![VolumeSource::of_store(&test.store)], options);
    // So fine a step is slow.
    let frame = settled(&mut session, 0.01);
    let painting = Arc::new(under());
    let so_far = std::thread::scope(|scope| {
        let drawing = scope.spawn(|| session.paint(&frame, &painting).map(drop));
        while painting.progress() == 0.0 && !drawing.is_finished() {
            std::thread::yield_now();
        }
        let so_far = painting.so_far();
        painting.abandon();
        let error = drawing.join().expect("no panic").expect_err("abandoned").to_string();
        assert!(error.contains("abandoned"), "{error}");
        so_far
    });
    let drawn = so_far.rgb.iter().filter(|pixel| **pixel != UNDER).count();
    assert!(drawn > 0 && drawn < so_far.rgb.len(), "{drawn} pixels are drawn");
    assert!(painting.progress() < 1.0 && painting.is_abandoned());
    // A completed one is the picture, pixel by pixel, and the session continues.
    let frame = settled(&mut session, 0.5);
    let painting = Arc::new(under());
    let picture = session.paint(&frame, &painting).expect("a picture");
    assert_eq!(painting.progress(), 1.0);
    assert!(painting.so_far().rgb == picture.rgb && picture.rgb == session.draw(&frame).expect("a picture").rgb);
}

/// A frame of few pixels has the look of one of fine bricks at the same coarseness, reads few of these, and never counts as settled; resident bricks
/// remain for the exact frame after it.
#[test]
fn coarse_frames_have_bricks_as_coarse_as_their_pixels() {
    let wave = |n: u32| (f64::from(n) * 0.06).sin();
    let voxel = |_, _, [x, y, z]: [u32; 3]| (128.0 + 40.0 * (wave(x) + wave(y) + wave(z))) as u8;
    let test = TestStore::pack(&FunctionSource::new(Extent::new(128, 128, 128), Geometry::default(), voxel), 16);
    let options = SessionOptions { backend: BackendChoice::Cpu, threads: 2, live: true, ..SessionOptions::default() };
    let mut session = Session::new(vec![VolumeSource::of_store(&test.store)], options);
    let scene = Scene::of(TransferFunction { opacity: vec![[0.0, 0.0], [255.0, 0.02]], ..TransferFunction::default() });
    let size = (256, 256);
    let whole = |session: &mut Session, level_bias: f64| loop {
        let frame = session.step_coarse(&scene, size, level_bias).expect("a frame");
        let Status { settled, awaits_feedback, resident, wanted, pixel_error, .. } = frame.status;
        match level_bias > 0.0 {
            // A moving camera is ahead of the cuts.
            true if resident == wanted && pixel_error == 4.0 => {
                assert!(!settled && !awaits_feedback);
                return frame;
            }
            false if settled => return frame,
            false if awaits_feedback => drop(session.draw(&frame).expect("a picture")),
            _ => session.wait(Duration::from_millis(5)),
        }
    };
    let exact = whole(&mut session, 0.0);
    let picture = |session: &mut Session, frame: &Frame, quality: Quality| {
        session.draw(&quality.frame(frame)).expect("a picture")
    };
    let fine = Quality { scale: 0.25, step: 1.0 };
    let of_fine_bricks = picture(&mut session, &exact, fine);
    let uploaded = exact.status.counters.uploaded;
    let coarse = whole(&mut session, 2.0);
    assert!(8 * coarse.status.wanted <= exact.status.wanted, "{} of {}", coarse.status.wanted, exact.status.wanted);
    let quality = fine.with_coarse_bricks(coarse.level_bias);
    assert_eq!(quality.step, 4.0);
    let of_coarse_bricks = picture(&mut session, &coarse, quality);
    let difference = of_fine_bricks.difference(&of_coarse_bricks);
    assert!(difference.psnr_db > 40.0, "{difference:?}");
    let again = whole(&mut session, 0.0);
    assert!(
        again.status.counters.uploaded - uploaded <= coarse.status.wanted as u64,
        "fine bricks were uploaded again"
    );
    assert_eq!(picture(&mut session, &again, fine).rgb, of_fine_bricks.rgb);
}
