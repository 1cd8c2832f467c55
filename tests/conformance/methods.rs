//! Every sampling method, filter and lighting, through bricks of several sizes; `modes` covers the features they share with plain
//! pictures.

use crate::list::finest;
use crate::scenery::{
    SMALL, float_slots, is_hole, lightings, overview, range, scaled, steep, tinted, u8_codes, uneven, waves, wavy,
    wide_codes, wild,
};
use crate::shot::{Shot, assert_telling};
use crate::stage::{ALL, CPU, MOST, RAYCAST, SORTED, Stage, Way};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

/// One look, and its renderers.
struct Take {
    sampling: Sampling,
    /// Index of its lighting.
    lighting: usize,
    /// Whether opacities depend on gradients, too.
    is_steep: bool,
    ways: &'static [Way],
}

impl Take {
    fn frame(&self, volume: &Volume, [plain, steep]: &[TransferFunction; 2]) -> FrameSettings {
        let transfer = if self.is_steep { steep } else { plain };
        let (sampling, lighting) = (self.sampling, lightings()[self.lighting].clone());
        FrameSettings {
            sampling,
            lighting,
            ..volume.frame(overview(volume, self.sampling.filter), transfer, Lattice::uniform(0.7, 0))
        }
    }
}

/// Each method with a function of values, and capable ones with one of values and gradients, in these lightings. On a GPU those with
/// functions of values, in `few` lightings.
fn takes(filter: Filter, lightings: &[usize], few: &[usize]) -> Vec<Take> {
    let mut takes = Vec::new();
    for method in Method::ALL {
        for (is_steep, &lighting) in [false, true].into_iter().flat_map(|s| lightings.iter().map(move |l| (s, l))) {
            if !(is_steep && method.is_pre_integrated()) {
                let ways = match !is_steep && few.contains(&lighting) {
                    true => &MOST[..],
                    false => &MOST[..1],
                };
                let sampling = Sampling { method, filter, ..Sampling::default() };
                takes.push(Take { sampling, lighting, is_steep, ways });
            }
        }
    }
    takes
}

/// Draws the takes in a volume's bricks, and on the CPU in turn in those of its variants.
fn agree(volume: &Volume, others: &[Volume], takes: &[Take], allowed: impl Fn(Way, &Take) -> usize) {
    let transfers = [tinted(range(&volume.encoding)), steep(range(&volume.encoding))];
    let frames: Vec<FrameSettings> = takes.iter().map(|take| take.frame(volume, &transfers)).collect();
    let on_gpu = takes.iter().zip(&frames).filter(|(take, _)| take.ways.len() > 1);
    let mut stage = Stage::with_room(&[volume], on_gpu.map(|(_, frame)| frame.needs()));
    let mut others: Vec<Stage<'_>> = others.iter().map(|other| Stage::exact(&[other])).collect();
    for (i, (take, frame)) in takes.iter().zip(&frames).enumerate() {
        let transfer = &transfers[take.is_steep as usize];
        let what = format!("{:?} {:?}, steep: {}", frame.sampling, frame.lighting, take.is_steep);
        let shot = Shot::new(frame, finest(volume, frame), transfer);
        let expected = shot.oracle(&[volume]);
        assert_telling(&expected, &what);
        for way in take.ways {
            shot.agree_with(&expected, &mut stage, &[*way], allowed(*way, take), &what);
        }
        let turn = i % others.len().max(1);
        if let Some(other) = others.get_mut(turn) {
            let volume = other.volumes[0];
            let what = format!("{what}, in bricks of {}", volume.pyramid.edge());
            let shot = Shot::new(frame, finest(volume, frame), transfer);
            shot.agree_with(&expected, other, &[CPU], allowed(CPU, take), &what);
        }
    }
}

/// The number of pixels left to rounding: stored gradients are half floats, and where they nearly cancel, rounding decides their
/// direction.
fn rounded(take: &Take) -> usize {
    (lightings()[take.lighting].gradient == Gradient::Stored) as usize
}

/// In bricks of 16, and of other sizes in turn, up to a single brick.
fn agree_in_bricks_of_any_size(filter: Filter, few: &[usize]) {
    let others = [8, 32, 64].map(|edge| wavy(SMALL, edge));
    let all: Vec<usize> = (0..lightings().len()).collect();
    agree(&wavy(SMALL, 16), &others, &takes(filter, &all, few), |_, take| rounded(take));
}

#[test]
fn every_method_and_lighting_matches_the_oracle() {
    agree_in_bricks_of_any_size(Filter::Trilinear, &[0, 1, 4, 5, 7]);
}

#[test]
fn every_method_and_lighting_matches_the_oracle_with_splines() {
    agree_in_bricks_of_any_size(Filter::Tricubic, &[0, 1, 5]);
}

#[test]
fn every_method_and_lighting_matches_the_oracle_with_steps() {
    agree_in_bricks_of_any_size(Filter::Nearest, &[0, 1, 7]);
}

#[test]
fn invalid_voxels_in_wide_codes_match_the_oracle() {
    agree_with_holes(wide_codes(), &|p| -1.0 + 4.0 * waves(p));
}

#[test]
fn f32_slots_match_the_oracle() {
    agree_with_holes(float_slots(), &wild(float_slots()));
}

fn agree_with_holes(encoding: SlotEncoding, field: &dyn Fn(DVec3) -> f64) {
    let value = |p: DVec3| if is_hole(p) { f64::NAN } else { field(p) };
    let of = |edge| Volume::new(SMALL, edge, uneven(), encoding, value);
    for (f, filter) in Filter::ALL.into_iter().enumerate() {
        // A place has a value if half of the weight is valid: at exactly half, rounding decides it, and its gradient.
        let allowed = |way, take: &Take| {
            // In a stepped field it also decides a place's voxel, and so whether there is a value.
            let stepped = if filter == Filter::Nearest { 3 } else { 0 };
            (way != CPU || take.is_steep) as usize + rounded(take) + stepped
        };
        let mut takes = takes(filter, &[0, 1, 5], &[0, 1, 5]);
        // The compositors take turns, because they share samples; with the other filter the order swaps.
        for (i, take) in takes.iter_mut().filter(|take| take.ways.len() > 1).enumerate() {
            take.ways = [&[CPU, RAYCAST], &[CPU, SORTED]][(i + f) % 2];
        }
        agree(&of(16), &[of(32)], &takes, allowed);
    }
}

#[test]
fn projections_are_filtered_alike() {
    let volumes = [16, 8, 32, 64].map(|edge| wavy(SMALL, edge));
    let transfer = tinted((0.0, 255.0));
    let filters = [Filter::Nearest, Filter::Tricubic];
    for (mode, filter) in
        [Mode::Mip, Mode::MinIp, Mode::Average].into_iter().flat_map(|mode| filters.map(|f| (mode, f)))
    {
        let plain = volumes[0].frame_in(mode, overview(&volumes[0], filter), &transfer, Lattice::uniform(0.7, 0));
        let frame = FrameSettings { sampling: Sampling { filter, ..plain.sampling }, ..plain };
        let expected = Shot::new(&frame, finest(&volumes[0], &frame), &transfer).oracle(&[&volumes[0]]);
        assert_telling(&expected, "a projection");
        for (volume, ways) in volumes.iter().zip([&MOST[..], &[CPU], &[CPU], &[CPU]]) {
            let what = format!("{mode:?}, {filter:?} in {}", volume.pyramid.edge());
            let shot = Shot::new(&frame, finest(volume, &frame), &transfer);
            shot.agree_with(&expected, &mut Stage::exact(&[volume]), ways, 0, &what);
        }
    }
}

/// The same rays through bricks of exactly their own needs, of each size in turn.
#[test]
fn bricks_with_just_what_is_needed_show_the_same() {
    let volumes = [8, 32, 64].map(|edge| Volume::new(SMALL, edge, uneven(), u8_codes(), scaled(u8_codes(), waves)));
    let transfers = [tinted((0.0, 255.0)), steep((0.0, 255.0))];
    for (i, (method, filter, is_steep)) in [
        (Method::Pcvs, Filter::Trilinear, false),
        (Method::Cvs, Filter::Tricubic, false),
        (Method::Asm, Filter::Trilinear, false),
        (Method::Plvs, Filter::Tricubic, false),
        (Method::Udvr, Filter::Trilinear, true),
        (Method::Cvs, Filter::Tricubic, true),
    ]
    .into_iter()
    .enumerate()
    {
        for (j, lighting) in [0, 4, 5].into_iter().enumerate() {
            let sampling = Sampling { method, filter, ..Sampling::default() };
            let volume = &volumes[(i + j) % 3];
            let take = Take { sampling, lighting, is_steep, ways: &MOST };
            let frame = take.frame(volume, &transfers);
            let shot = Shot::new(&frame, finest(volume, &frame), &transfers[is_steep as usize]);
            let what = format!("{sampling:?}, {lighting}, in {}", volume.pyramid.edge());
            let ways = if lighting == 5 { &ALL[..] } else { &MOST };
            shot.agree(&mut Stage::exact(&[volume]), ways, rounded(&take), &what);
        }
    }
}
