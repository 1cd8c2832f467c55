//! Windows of few codes: masks, counts, one outlier beside them, and waves over few codes of 16 bits. A transfer function may show anything
//! between two codes, and a filter's precision must lose none of it.

use crate::list::finest;
use crate::scenery::{SMALL, lightings, noise, overview, steep, tinted, uneven, waves};
use crate::shot::Shot;
use crate::stage::{ALL, MOST, Stage, Way};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;
use std::collections::BTreeSet;

/// A volume with a window over few codes of its table, and its transfer function.
struct Narrow {
    volume: Volume,
    transfer: TransferFunction,
}

impl Narrow {
    fn new(voxel_type: VoxelType, range: (f64, f64), transfer: TransferFunction, value: impl Fn(DVec3) -> f64) -> Self {
        let narrow = Self::in_slots(voxel_type, range, transfer, value);
        assert!(!narrow.volume.encoding.has_whole_table(), "{voxel_type} {range:?}: not narrow");
        narrow
    }

    /// The same in any kind of slots, as the window requires.
    fn in_slots(
        voxel_type: VoxelType,
        range: (f64, f64),
        transfer: TransferFunction,
        value: impl Fn(DVec3) -> f64,
    ) -> Self {
        let window = Window::new(&transfer, &[], Mode::Mip);
        let encoding = SlotEncoding::new(voxel_type, range, false).for_window(window, KeptSlots::default());
        Self { volume: Volume::new(SMALL, 16, uneven(), encoding, value), transfer }
    }

    /// Draws these modes, each with its own sampling and lighting.
    fn agree(&self, ways: &[Way], looks: &[(Mode, Sampling, usize)], what: &str) {
        let Self { volume, transfer } = self;
        let frame = |&(mode, sampling, lighting): &(Mode, Sampling, usize)| {
            let rays = overview(volume, sampling.filter);
            let lighting = lightings()[lighting].clone();
            FrameSettings { sampling, lighting, ..volume.frame_in(mode, rays, transfer, Lattice::uniform(0.7, 0)) }
        };
        let frames: Vec<FrameSettings> = looks.iter().map(frame).collect();
        let mut stage = Stage::with_room(&[volume], frames.iter().map(FrameSettings::needs));
        for (frame, look) in frames.iter().zip(looks) {
            let shot = Shot::new(frame, finest(volume, frame), transfer);
            let expected = shot.oracle(&[volume]);
            shot.agree_with(&expected, &mut stage, ways, 0, &format!("{what}, {look:?}"));
        }
    }
}

/// Whether a place is inside a ball with a bite, as a number.
fn ball(p: DVec3) -> f64 {
    let from = p - DVec3::new(19.3, 14.1, 18.2);
    f64::from(u8::from(from.length() < 11.0 && !(from.x.abs() < 3.0 && from.y < 0.0)))
}

/// Opaque about the value `0.3` past `first`, and clear at all whole numbers.
fn shell(first: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[first, 0.0, 0.0, 1.0], [first + 0.5, 0.0, 1.0, 0.0], [first + 1.0, 1.0, 0.0, 0.0]],
        opacity: vec![[first + 0.2, 0.0], [first + 0.3, 0.9], [first + 0.4, 0.0]],
        ..TransferFunction::default()
    }
}

fn plain(mode: Mode) -> (Mode, Sampling, usize) {
    (mode, Sampling::default(), 0)
}

fn by(method: Method, filter: Filter, lighting: usize) -> (Mode, Sampling, usize) {
    (Mode::Dvr, Sampling { method, filter, ..Sampling::default() }, lighting)
}

const MODES: [Mode; 5] = Mode::ALL;

#[test]
fn masks_match_the_oracle_between_their_two_codes() {
    for (i, (voxel_type, first)) in
        [(VoxelType::U8, 0.0), (VoxelType::I16, 0.0), (VoxelType::U16, 50_000.0), (VoxelType::I8, -1.0)]
            .into_iter()
            .enumerate()
    {
        let mask = |p: DVec3| first + ball(p);
        let range = (first, first + 1.0);
        let shell = Narrow::new(voxel_type, range, shell(first), mask);
        let methods = [Method::Plvs, Method::Pcvs, Method::Asm, Method::Lvs];
        shell.agree(
            if i < 2 { &ALL } else { &MOST },
            &[plain(Mode::Dvr), by(Method::Udvr, Filter::Trilinear, 1)],
            "a shell",
        );
        shell.agree(&MOST[..1], &methods.map(|method| by(method, Filter::Trilinear, 4)), "a shell");
        shell.agree(
            &MOST,
            &[by(methods[i], Filter::Trilinear, i % 2), by(Method::Udvr, Filter::Tricubic, i % 2)],
            "a shell",
        );
        let ramp = Narrow::new(voxel_type, range, tinted((first + 0.4, first + 0.6)), mask);
        ramp.agree(&MOST, &MODES.map(plain), "a fifth of a code");
    }
}

/// Of 0 to 3 counts nearly all of the greatest, or a voxel with the type's maximum.
#[test]
fn counts_and_one_outlier_match_the_oracle() {
    let counts = |p: DVec3| (noise(p) * if ball(p) > 0.0 { 3.9 } else { 1.2 }).floor();
    for (i, (voxel_type, most)) in
        [(VoxelType::U8, 255.0), (VoxelType::U16, 65_535.0), (VoxelType::I16, 32_767.0)].into_iter().enumerate()
    {
        let outlier = move |p: DVec3| if p.as_uvec3().to_array() == [21, 15, 17] { most } else { counts(p) };
        let window = tinted((0.0, 3.0));
        let ways = if i == 0 { &ALL[..] } else { &MOST[..] };
        Narrow::new(voxel_type, (0.0, 3.0), window.clone(), counts).agree(ways, &MODES.map(plain), "counts");
        let wild = Narrow::new(voxel_type, (0.0, most), window, outlier);
        wild.agree(&MOST, &MODES.map(plain), "an outlier");
        wild.agree(
            &MOST,
            &[by(Method::Plvs, Filter::Trilinear, 1), by(Method::Udvr, Filter::Nearest, 1)],
            "an outlier",
        );
    }
}

/// With 8 fractional bits in f32s, and with more.
#[test]
fn waves_over_few_codes_match_the_oracle() {
    for (i, width) in [1.0, 2.0, 5.0, 16.0, 70.0, 300.0, 511.0].into_iter().enumerate() {
        let low = [40_000.0, 12.0, 65_000.0][i % 3];
        let window = (low, low + width);
        let wave = |p: DVec3| (low + width * (1.4 * waves(p) - 0.2)).round();
        let range = (low - width, low + 2.0 * width);
        let narrow = Narrow::new(VoxelType::U16, range, tinted(window), wave);
        narrow.agree(&MOST, &MODES.map(plain), &format!("{width} codes"));
        let steep = Narrow { transfer: steep(window), ..Narrow::new(VoxelType::U16, range, tinted(window), wave) };
        steep.agree(&MOST[..1], &[by(Method::Udvr, Filter::Trilinear, 4)], &format!("{width} codes, steep"));
    }
    // A sixth of all 8-bit codes.
    let wave = |p: DVec3| (100.0 + 42.0 * waves(p)).round();
    let narrow = Narrow::new(VoxelType::U8, (0.0, 255.0), tinted((100.0, 142.0)), wave);
    narrow.agree(&MOST, &MODES.map(plain), "42 codes of 8 bits");
}

/// Inside and outside a mask there is no gradient: rounding residues of an even field far from the table's first value light nothing.
#[test]
fn even_masks_are_flat_however_narrow_the_window() {
    for (voxel_type, most, window) in
        [(VoxelType::F32, 1.0, (0.5, 0.51)), (VoxelType::F32, 1.0, (0.0, 1.0)), (VoxelType::U16, 6e4, (0.0, 6e4))]
    {
        let (low, high) = window;
        let transfer = TransferFunction {
            color: vec![[low, 0.5, 0.2, 0.6], [high, 0.1, 0.9, 0.4]],
            opacity: vec![[low, 0.1], [high, 0.3]],
            unit_distance: 2.5,
            ..TransferFunction::default()
        };
        // Beside values too far off for the first window in 16-bit codes.
        let range = (0.0, if voxel_type == VoxelType::F32 { 100.0 } else { most });
        let mask = Narrow::in_slots(voxel_type, range, transfer, |p| most * ball(p));
        let looks = [Filter::Trilinear, Filter::Tricubic].map(|filter| by(Method::Udvr, filter, 1));
        mask.agree(&MOST, &looks, &format!("a mask of {voxel_type}, {window:?}"));
    }
}

/// A place among equal voxels has exactly their value, so that an expression may compare it, and be lit by the greater result.
#[test]
fn expressions_compare_even_values_exactly() {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false).for_values([0.0, 1.0], KeptSlots::default());
        let volume = Volume::new(SMALL, 16, uneven(), encoding, ball);
        for (text, lighting) in [("a >= 1 ? 1 : 0", 0), ("max(a, 1 - a)", 1), ("min(1, a * 3)", 1)] {
            let shown = TransferFunction {
                color: vec![[0.0, 0.2, 0.3, 0.9], [1.0, 1.0, 0.8, 0.1]],
                opacity: vec![[0.3, 0.0], [1.0, 0.05]],
                ..TransferFunction::default()
            };
            let combination = Combination::new(Expression::parse(text, 1).expect("an expression"), shown);
            let transfer = combination.of_volume(0, &[[0.0, 1.0]]);
            // Well inside a mask, a spline is less than 1 by less than f32 precision.
            let filters = [Filter::Trilinear, Filter::Tricubic];
            for filter in filters.into_iter().take(if text.contains(">=") { 1 } else { 2 }) {
                let sampling = Sampling { filter, ..Sampling::default() };
                let lighting = lightings()[lighting].clone();
                let rays = overview(&volume, filter);
                let frame =
                    FrameSettings { sampling, lighting, ..volume.frame(rays, &transfer, Lattice::uniform(0.7, 0)) };
                let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
                let shot = Shot { combination: Some(&combination), ..shot };
                let mut stage = Stage::exact(&[&volume]);
                let expected = shot.oracle(&[&volume]);
                let colors: BTreeSet<_> = expected.rgb.iter().collect();
                assert!(colors.len() > 8, "{text}: {}", colors.len());
                shot.agree_with(&expected, &mut stage, &MOST, 0, &format!("{text} of {voxel_type}, {filter:?}"));
            }
        }
    }
}

/// Two neighbouring voxels may span the whole range of values, with a window on a hundred-thousandth of it.
#[test]
fn stored_gradients_of_narrow_windows_match_the_oracle() {
    for (voxel_type, most) in [(VoxelType::U32, 3e5), (VoxelType::F32, 2e4)] {
        for width in [4.0, 60.0] {
            let wave = |p: DVec3| (most * (0.5 + 0.45 * (p.x * 0.7 + (p.y * 0.4).sin() + p.z * 0.5).sin())).round();
            let low = 0.45 * most;
            let narrow = Narrow::in_slots(voxel_type, (0.0, most), tinted((low, low + width)), wave);
            let looks = [5, 6].map(|lighting| by(Method::Lvs, Filter::Trilinear, lighting));
            narrow.agree(&MOST, &looks, &format!("{width} of {most}, {voxel_type}"));
        }
    }
}
