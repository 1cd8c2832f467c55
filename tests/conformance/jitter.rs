//! Jittered and shifted lattices, and rays beside pixels' centres: the oracle's samples, close to the truth.

use crate::list::finest;
use crate::scenery::{SMALL, lightings, overview, tinted, wavy};
use crate::shot::{Shot, assert_telling};
use crate::stage::{CPU, MOST, Stage};
use brickyard::volume::*;

const U8: (f64, f64) = (0.0, 255.0);

#[test]
fn jittered_pictures_match_the_oracle_in_bricks_of_any_size() {
    let volumes = [16, 8, 32, 64].map(|edge| wavy(SMALL, edge));
    let (rays, transfer) = (overview(&volumes[0], Filter::Trilinear), tinted(U8));
    let mut frames = Vec::new();
    for (mode, method, lighting) in [
        (Mode::Dvr, Method::Udvr, 0),
        (Mode::Dvr, Method::Plvs, 4),
        (Mode::Dvr, Method::Pcvs, 2),
        (Mode::Dvr, Method::Asm, 0),
        (Mode::Dvr, Method::Asm, 4),
        (Mode::Mip, Method::Udvr, 0),
        (Mode::MinIp, Method::Udvr, 0),
        (Mode::Average, Method::Udvr, 0),
        (Mode::Isosurface, Method::Udvr, 0),
    ] {
        // In one zone, and with zones that start inside the volume. Segments longer than a voxel reach out of bricks' aprons if their ends
        // are sampled.
        let is_in_the_middle = mode != Mode::Isosurface && method == Method::Udvr;
        let (step, finest, levels) = if is_in_the_middle { (1.7, 0.9, 3) } else { (0.6, 0.3, 2) };
        for lattice in [Lattice::uniform(step, 0), Lattice::for_view(finest, 1.0, &rays, 0.25, levels)] {
            for (jitter, phase, moved_px) in [
                (Jitter::White(3), 0, [0.0; 2]),
                (Jitter::White(99), 64, [-0.375, 0.125]),
                (Jitter::Blue, 192, [0.0; 2]),
                (Jitter::None, 128, [0.375, -0.4375]),
            ] {
                let lattice = Lattice { phase, ..lattice };
                let plain = volumes[0].frame_in(mode, rays.moved_by_px(moved_px), &transfer, lattice);
                let sampling = Sampling { method, jitter, ..Sampling::default() };
                frames.push(FrameSettings { sampling, lighting: lightings()[lighting].clone(), ..plain });
            }
        }
    }
    let needs: Vec<Needs> = frames.iter().map(FrameSettings::needs).collect();
    let mut stages = volumes.each_ref().map(|volume| Stage::with_room(&[volume], needs.iter().copied()));
    for (i, frame) in frames.iter().enumerate() {
        let shot = |volume| Shot::new(frame, finest(volume, frame), &transfer);
        let expected = shot(&volumes[0]).oracle(&[&volumes[0]]);
        let what = format!("{:?} {:?}", frame.mode, frame.sampling);
        assert_telling(&expected, &what);
        shot(&volumes[0]).agree_with(&expected, &mut stages[0], &MOST, 0, &what);
        let other = 1 + i % 3;
        shot(&volumes[other]).agree_with(&expected, &mut stages[other], &[CPU], 0, &what);
        let lattice = Lattice { phase: 0, ..frame.lattice };
        let still =
            FrameSettings { sampling: Sampling { jitter: Jitter::None, ..frame.sampling }, lattice, ..frame.clone() };
        let still = Shot::new(&still, finest(&volumes[0], &still), &transfer).render(&mut stages[0], CPU);
        // Surfaces are found in place, wherever segments end.
        assert!(frame.mode == Mode::Isosurface || still != Some(expected), "{what} moves the lattice");
    }
}

#[test]
fn jittered_pictures_scatter_about_the_truth() {
    let volume = wavy([41, 37, 45], 64);
    let mut stage = Stage::exact(&[&volume]);
    let transfer = tinted(U8);
    let mut draw = |method, jitter, step| {
        let plain = volume.frame(overview(&volume, Filter::Trilinear), &transfer, Lattice::uniform(step, 0));
        let frame = FrameSettings { sampling: Sampling { method, jitter, ..Sampling::default() }, ..plain };
        let picture = Shot::new(&frame, finest(&volume, &frame), &transfer).render(&mut stage, CPU);
        picture.expect("a processor").rgb.into_flattened().into_iter().map(f64::from).collect::<Vec<f64>>()
    };
    let truth = draw(Method::Pdvr, Jitter::None, 0.05);
    let rms = |picture: &[f64]| {
        let squares: f64 = picture.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum();
        (squares / truth.len() as f64).sqrt()
    };
    let errors = [4.0, 2.0, 1.0].map(|step| {
        let pictures: Vec<Vec<f64>> = (0..16).map(|seed| draw(Method::Udvr, Jitter::White(seed), step)).collect();
        let mean = |i: usize| pictures.iter().map(|picture| picture[i]).sum::<f64>() / pictures.len() as f64;
        let mean: Vec<f64> = (0..truth.len()).map(mean).collect();
        (rms(&pictures[0]), rms(&mean))
    });
    // A mean's error comes from opacity's effect on scatter: it falls with the square of the step, down to the rounding of the truth.
    assert!(errors.iter().all(|(one, mean)| mean < one), "{errors:?}");
    assert!(errors[0].0 > 2.0 && errors[1].1 < 0.7 * errors[0].1 && errors[2].1 < 0.5, "{errors:?}");
}
