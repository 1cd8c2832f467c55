//! Stack builder: sorts slices along their normal, and refuses them unless they form one evenly spaced stack, upright or leaning. Several slices
//! may lie at each place of it.
//!
//! A leaning stack (a CT with a tilted gantry) keeps its voxels, and its lean as a shear of the matrix.
//!
//! Positions and directions are the patient's (mm; x to the left, y to the back, z to the head: "LPS"), as in files. The resulting matrix
//! uses NIfTI's world, x to the right and y to the front, so that volumes of one patient align in any format.

use super::pixels::Meaning;
use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::options::{Gaps, OpenOptions};
use brickyard_volume::counted;
use glam::{DMat3, DVec3};
use std::path::PathBuf;

/// Largest relative difference of slice spacings.
const SPACING_TOLERANCE: f64 = 1e-2;
/// Largest part of a spacing explained by rounding of positions: far from a missing slice.
const ROUNDING_TOLERANCE: f64 = 0.1;
/// Most by which a distance between slices may differ from a whole number of steps, in steps.
const WHOLE_TOLERANCE: f64 = 0.25;
/// Largest difference of directions (a sine): over a stack's width of 1000 pixels, a tenth of a pixel.
const DIRECTION_TOLERANCE: f64 = 1e-4;
/// Largest distance of a slice, sideways, from its place in the stack, in pixels. A stack leaning no more is upright.
const LEAN_TOLERANCE_PX: f64 = 0.5;
/// Most sideways for each millimetre along the normal, 60 degrees: gantries tilt by 30. Beyond, slices lie side by side.
const MOST_LEAN: f64 = 1.7321;
/// Most slices of a sparse stack, present or not; far more than scanners write.
const MOST_SPARSE: u32 = 1 << 16;

/// One slice and its place.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    /// Index of the slice's file, in the given order.
    pub(super) file: usize,
    /// Index of the slice's frame in its file, from 0.
    pub(super) frame: usize,
    /// Centre of the first pixel in the patient's coordinates, mm.
    pub(super) position: DVec3,
    /// Largest rounding error of the position along x, y and z, from its written decimals, mm.
    pub(super) rounding: DVec3,
    /// Direction along a row of pixels, of growing column index.
    pub(super) along_row: DVec3,
    /// Direction along a column of pixels, of growing row index.
    pub(super) along_column: DVec3,
    /// Distance between pixel centres along a row and along a column, mm.
    pub(super) pixel_mm: [f64; 2],
    /// The file's distance or thickness of slices, mm, with the element's name: the spacing along z of a single slice.
    pub(super) step_mm: Option<(f64, &'static str)>,
    /// Meaning of the slice's pixels.
    pub(super) meaning: Meaning,
}

/// A stack's place in the world.
#[derive(Debug)]
pub(super) struct Placement {
    pub(super) spacing: DVec3,
    /// World-from-voxel-centre matrix, by rows.
    pub(super) matrix: [[f64; 4]; 3],
    /// Index of each slice along z: from 0, not descending, without gaps except for missing slices.
    pub(super) levels: Vec<u32>,
    /// Sentences for the user: the spacing along z was assumed, averaged or differs from the positions; the stack leans.
    pub(super) notes: Vec<Note>,
}

/// Rules for the distances of slices.
#[derive(Clone, Copy)]
pub(super) struct Rules {
    pub(super) gaps: Gaps,
    /// Spacing told by the user, which overrules the positions.
    pub(super) spacing: Option<DVec3>,
    /// Distance of a sparse stack's slices: any number of them may be missing.
    pub(super) sparse_mm: Option<f64>,
}

impl Rules {
    pub(super) fn of(options: &OpenOptions) -> Self {
        Self { gaps: options.gaps, spacing: options.spacing, sparse_mm: None }
    }
}

/// Slices sorted along z.
struct Along {
    spacing: f64,
    levels: Vec<u32>,
    note: Option<Note>,
}

/// Names slices in messages, by file and frame.
pub(super) struct Names<'a> {
    pub(super) paths: &'a [PathBuf],
    /// Whether messages give a frame's number beside the file's name.
    pub(super) by_frame: bool,
}

impl Names<'_> {
    pub(super) fn of(&self, slice: &Slice) -> String {
        let path = self.paths[slice.file].display();
        if self.by_frame { format!("{path} (frame {})", slice.frame + 1) } else { path.to_string() }
    }

    pub(super) fn refuse(&self, slice: &Slice, problem: String) -> ImportError {
        let frame = if self.by_frame { format!("frame {}: ", slice.frame + 1) } else { String::new() };
        ImportError::invalid(&self.paths[slice.file], frame + &problem)
    }
}

/// Sorts the slices by their position along the normal and places the stack. By the rules, the distance between them is even but for missing
/// slices (`gaps`), or else fixed, whatever the positions say (`spacing`).
///
/// # Errors
/// If the slices are not one stack: they differ in direction or pixel size, the spacing is uneven, or they are not in line.
pub(super) fn arrange(slices: &mut [Slice], names: &Names, rules: Rules) -> Result<Placement> {
    let first = slices[0].clone();
    check_directions(slices, names)?;
    let normal = first.along_row.cross(first.along_column).normalize();
    let depth = |s: &Slice| (s.position - first.position).dot(normal);
    slices.sort_by(|a, b| depth(a).total_cmp(&depth(b)).then((a.file, a.frame).cmp(&(b.file, b.frame))));
    let (ones, place_of) = places(slices, depth);
    let lean = lean_of(&ones, normal, names)?;
    check_beside(slices, &ones, &place_of, names)?;
    let along = match &ones[..] {
        [one] => alone(one),
        _ => {
            let gaps: Vec<f64> =
                ones.windows(2).map(|pair| (depth(&pair[1]) - depth(&pair[0])) * lean.stretch()).collect();
            along(&gaps, &Stack { slices: &ones, normal, names }, rules)?
        }
    };
    let spacing = DVec3::new(first.pixel_mm[0], first.pixel_mm[1], along.spacing);
    let step = (normal + lean.shear) * (spacing.z / lean.stretch());
    let axes = DMat3::from_cols(first.along_row * spacing.x, first.along_column * spacing.y, step);
    // From the patient's left and back to the world's right and front.
    let flip = DVec3::new(-1.0, -1.0, 1.0);
    let origin = slices[0].position * flip;
    let matrix = std::array::from_fn(|r| {
        let row = axes.row(r) * flip[r];
        [row.x, row.y, row.z, origin[r]]
    });
    let levels = place_of.iter().map(|place| along.levels[*place]).collect();
    Ok(Placement { spacing, matrix, levels, notes: along.note.into_iter().chain(lean.note()).collect() })
}

/// Finds the places of slices sorted by depth: the first slice of each, and the index of each slice's place.
fn places(slices: &[Slice], depth: impl Fn(&Slice) -> f64) -> (Vec<Slice>, Vec<usize>) {
    let gaps = slices.windows(2).map(|pair| depth(&pair[1]) - depth(&pair[0]));
    let mut positive: Vec<f64> = gaps.filter(|gap| *gap > 1e-6).collect();
    positive.sort_by(f64::total_cmp);
    let typical = positive.get(positive.len() / 2).copied().unwrap_or(0.0);
    let mut ones: Vec<Slice> = Vec::new();
    let mut place_of = Vec::with_capacity(slices.len());
    for slice in slices {
        // From the place's first slice, so small distances do not add up.
        let is_new = ones.last().is_none_or(|one| depth(slice) - depth(one) > (SPACING_TOLERANCE * typical).max(1e-6));
        if is_new {
            ones.push(slice.clone());
        }
        place_of.push(ones.len() - 1);
    }
    (ones, place_of)
}

/// A stack of one slice.
fn alone(slice: &Slice) -> Along {
    let (spacing, note) = match slice.step_mm {
        Some((mm, name)) => {
            let note = format!("A single slice: its {name} of {mm} mm is taken as the spacing along z.");
            (mm, Note::new(note).settled_by(Setting::Spacing))
        }
        None => {
            let note =
                "A single slice without SpacingBetweenSlices or SliceThickness: 1 mm is taken as the spacing along z.";
            (1.0, Note::warning(note).settled_by(Setting::Spacing))
        }
    };
    Along { spacing, levels: vec![0], note: Some(note) }
}

/// Checks that all slices have one direction and pixel size.
fn check_directions(slices: &[Slice], names: &Names) -> Result<()> {
    let first = &slices[0];
    let (row, column) = (first.along_row, first.along_column);
    let upright = [row.length() - 1.0, column.length() - 1.0, row.dot(column)];
    if upright.iter().any(|e| e.abs() >= 1e-3) {
        let (row, column) = (show(row), show(column));
        let problem = format!(
            "ImageOrientationPatient {row} {column} is not two perpendicular directions of length 1; write the file again"
        );
        return Err(names.refuse(first, problem));
    }
    let parallel = |a: &Slice, b: &Slice| {
        let apart = [a.along_row - b.along_row, a.along_column - b.along_column];
        apart.iter().all(|d| d.length() <= DIRECTION_TOLERANCE)
    };
    if let [(most, many), (other, few), ..] = kinds(slices, parallel)[..] {
        let (most, other) = (&slices[most], &slices[other]);
        let [direction, of_most] = [other, most].map(|s| format!("{} {}", show(s.along_row), show(s.along_column)));
        let such_as = names.of(most);
        let problem = format!(
            "looks along {direction} (ImageOrientationPatient), as {few} slices do; {many} look along {of_most}, such \
             as {such_as}. Slices of one volume are parallel: name the files of one direction (a series often \
             includes localizers)"
        );
        return Err(names.refuse(other, problem));
    }
    let same_pixels =
        |a: &Slice, b: &Slice| (0..2).all(|i| (a.pixel_mm[i] - b.pixel_mm[i]).abs() <= 1e-4 * b.pixel_mm[i]);
    if let [(most, many), (other, few), ..] = kinds(slices, same_pixels)[..] {
        let (most, other) = (&slices[most], &slices[other]);
        let [[x, y], [most_x, most_y]] = [other.pixel_mm, most.pixel_mm];
        let such_as = names.of(most);
        let problem = format!(
            "has pixels of {x} x {y} mm, as {few} slices do; {many} have pixels of {most_x} x {most_y} mm, such as \
             {such_as}. Name the files of one size"
        );
        return Err(names.refuse(other, problem));
    }
    Ok(())
}

/// Groups equal items. Returns for each group the index of its first item and the number of its items, the largest group first.
pub(super) fn kinds<T>(items: &[T], same: impl Fn(&T, &T) -> bool) -> Vec<(usize, usize)> {
    let mut kinds: Vec<(usize, usize)> = Vec::new();
    for (i, item) in items.iter().enumerate() {
        match kinds.iter_mut().find(|(first, _)| same(&items[*first], item)) {
            Some((_, count)) => *count += 1,
            None => kinds.push((i, 1)),
        }
    }
    kinds.sort_by_key(|(first, count)| (std::cmp::Reverse(*count), *first));
    kinds
}

/// Places of a stack, each by its first slice.
#[derive(Clone, Copy)]
struct Stack<'a> {
    slices: &'a [Slice],
    normal: DVec3,
    names: &'a Names<'a>,
}

/// Places sorted slices along z, at distances by the rules.
fn along(gaps: &[f64], stack: &Stack<'_>, rules: Rules) -> Result<Along> {
    let Stack { slices, normal, names } = *stack;
    let mut sorted = gaps.to_vec();
    sorted.sort_by(f64::total_cmp);
    let [nearest, typical] = [0, sorted.len() / 2].map(|i| sorted.get(i).copied().unwrap_or(0.0));
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    let even = |note| Along { spacing: mean, levels: (0..slices.len() as u32).collect(), note };
    let rounding = rounding_along(slices, normal);
    if let Some(mm) = rules.sparse_mm {
        let steps = Steps { mm, rounding };
        return with_gaps(gaps, steps, MOST_SPARSE).ok_or_else(|| uneven(gaps, steps, stack, rules));
    }
    if gaps.iter().all(|gap| !is_uneven(*gap, typical)) {
        return Ok(even(None));
    }
    // Among many gaps, the step is the least distance.
    let tried = [typical, nearest].map(|mm| Steps { mm, rounding });
    let most = 2 * slices.len() as u32;
    let steps = tried.into_iter().find(|steps| with_gaps(gaps, *steps, most).is_some()).unwrap_or(tried[0]);
    let [least, greatest] = [gaps.iter().copied().fold(f64::MAX, f64::min), gaps.iter().copied().fold(0.0, f64::max)];
    let apart = format!("Slices are {least:.4} to {greatest:.4} mm apart");
    match (rules.gaps, rules.spacing) {
        (Gaps::Refuse, Some(DVec3 { z: mm, .. })) => {
            let place = |i: usize| gaps[..i].iter().sum::<f64>();
            let moved = |i: usize| (mm * i as f64 - place(i)).abs();
            let worst = (0..slices.len()).max_by(|&a, &b| moved(a).total_cmp(&moved(b))).unwrap_or(0);
            Ok(even(Some(Note::warning(format!(
                "{apart} by their positions, and taken as {mm} mm apart, by `spacing`: {} is {:.4} mm from its \
                 position. If slices are missing, `gaps` blank leaves their places blank.",
                names.of(&slices[worst]),
                moved(worst)
            )))))
        }
        _ if is_rounding(gaps, rounding, mean) => Ok(even(Some(Note::new(format!(
            "{apart}, which the rounding of their positions explains: {mean:.4} mm is taken for all."
        ))))),
        (Gaps::Blank, _) => with_gaps(gaps, steps, most).ok_or_else(|| uneven(gaps, steps, stack, rules)),
        (Gaps::Refuse, None) => Err(uneven(gaps, steps, stack, rules)),
    }
}

fn is_uneven(gap: f64, expected: f64) -> bool {
    (gap - expected).abs() > SPACING_TOLERANCE * expected
}

/// Distance between adjacent slices, and the rounding error of a position, mm.
#[derive(Clone, Copy)]
struct Steps {
    mm: f64,
    rounding: f64,
}

impl Steps {
    /// Number of steps in a distance between slices; `None` unless it is whole.
    fn in_gap(self, gap: f64) -> Option<u32> {
        let steps = (gap / self.mm).round();
        // Both ends of the distance, and of each measuring step.
        let off = steps * SPACING_TOLERANCE * self.mm + 2.0 * self.rounding * (steps + 1.0);
        let is_whole = (gap - steps * self.mm).abs() <= off.min(WHOLE_TOLERANCE * self.mm);
        (is_whole && (1.0..=f64::from(u32::MAX)).contains(&steps)).then_some(steps as u32)
    }
}

/// Places slices along z with gaps between them; `None` unless all distances are whole numbers of steps, and there are at most so many slices,
/// missing ones included.
fn with_gaps(gaps: &[f64], steps: Steps, most: u32) -> Option<Along> {
    let mut levels = vec![0u32];
    for gap in gaps {
        let last = levels.last().copied().unwrap_or(0);
        levels.push(last.checked_add(steps.in_gap(*gap)?)?);
    }
    let last = levels.last().copied().unwrap_or(0);
    let spacing = gaps.iter().sum::<f64>() / f64::from(last);
    (last < most).then_some(Along { spacing, levels, note: None })
}

fn uneven(gaps: &[f64], steps: Steps, stack: &Stack<'_>, rules: Rules) -> ImportError {
    let Stack { slices, names, .. } = *stack;
    let expected = steps.mm;
    let count = gaps.iter().filter(|gap| is_uneven(**gap, expected)).count();
    let off = |i: usize| (gaps[i] - expected).abs();
    let at = (0..gaps.len()).max_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(0);
    let missing = steps.in_gap(gaps[at]).filter(|steps| *steps > 1).map(|steps| u64::from(steps) - 1);
    let found = missing.map_or(String::new(), |missing| {
        let are = if missing == 1 { "is" } else { "are" };
        format!(" ({} {are} missing between them)", counted(missing, "slice"))
    });
    let advice = match missing {
        _ if rules.sparse_mm.is_some() => format!("frames lie at whole steps, and within {MOST_SPARSE} of them"),
        Some(_) if with_gaps(gaps, steps, 2 * slices.len() as u32).is_some() => {
            "add the missing files, or pass `gaps` blank to leave their places without data".into()
        }
        Some(_) => "add the missing files, or name those of an evenly spaced part".into(),
        None => {
            let ([x, y], mean) = (slices[0].pixel_mm, gaps.iter().sum::<f64>() / gaps.len() as f64);
            let z = round(mean);
            format!("pass `spacing` {x},{y},{z} to take the slices as evenly spaced, which moves some of them")
        }
    };
    let [from, to] = [at, at + 1].map(|i| format!("{} (at {})", names.of(&slices[i]), show(slices[i].position)));
    let (gap, all) = (gaps[at], gaps.len());
    let problem = format!(
        "slices are not evenly spaced: expected {expected:.4} mm from one to the next, found {gap:.4} mm from {from} to \
         {to}{found}; {count} of {all} steps differ; {advice}"
    );
    names.refuse(&slices[at + 1], problem)
}

/// Largest error of a slice's place along the normal, mm, from the written decimals of positions.
fn rounding_along(slices: &[Slice], normal: DVec3) -> f64 {
    // Writers may drop trailing zeros: the finest slice decides for all.
    let places = |a: usize| slices.iter().map(|s| s.rounding[a]).filter(|r| *r > 0.0).fold(f64::MAX, f64::min);
    (0..3).map(|a| normal[a].abs() * if places(a) < f64::MAX { places(a) } else { 0.0 }).sum()
}

/// Whether positions off by up to `rounding` explain all steps between slices.
fn is_rounding(gaps: &[f64], rounding: f64, mean: f64) -> bool {
    // Either end of a step, and both ends of the whole stack, which give the mean.
    let most = 2.0 * rounding * (1.0 + 1.0 / gaps.len() as f64) * (1.0 + 1e-9);
    gaps.iter().all(|gap| (gap - mean).abs() <= most.min(ROUNDING_TOLERANCE * mean))
}

/// The lean of a stack: the way sideways for each millimetre along the normal; zero of an upright one.
#[derive(Clone, Copy)]
struct Lean {
    shear: DVec3,
}

impl Lean {
    /// Distance from slice to slice for each millimetre along the normal.
    fn stretch(self) -> f64 {
        (1.0 + self.shear.length_squared()).sqrt()
    }

    fn note(self) -> Option<Note> {
        let degrees = self.shear.length().atan().to_degrees();
        (degrees > 0.0).then(|| {
            Note::new(format!(
                "The stack leans by {degrees:.2} degrees (a tilted gantry): its voxels are kept, and the volume is drawn \
                 leaning, by its orientation."
            ))
        })
    }
}

/// Finds the lean of sorted places, which must lie in line.
fn lean_of(ones: &[Slice], normal: DVec3, names: &Names) -> Result<Lean> {
    let upright = Lean { shear: DVec3::ZERO };
    let [first, .., last] = ones else { return Ok(upright) };
    let depth = |s: &Slice| (s.position - first.position).dot(normal);
    let aside = |s: &Slice| s.position - first.position - normal * depth(s);
    let pixel = first.pixel_mm[0].min(first.pixel_mm[1]);
    let off = |shear: DVec3, s: &Slice| (aside(s) - shear * depth(s)).length();
    let worst_by = |shear: DVec3| ones.iter().max_by(|a, b| off(shear, a).total_cmp(&off(shear, b))).unwrap_or(last);
    let is_in_line = |shear: DVec3| off(shear, worst_by(shear)) <= LEAN_TOLERANCE_PX * pixel;
    if is_in_line(DVec3::ZERO) {
        return Ok(upright);
    }
    let shear = aside(last) / depth(last);
    let is_steep = shear.length() > MOST_LEAN;
    if !is_steep && is_in_line(shear) {
        return Ok(Lean { shear });
    }
    let worst = worst_by(shear);
    let (off, degrees) = (off(shear, worst), shear.length().atan().to_degrees());
    let (first, last) = (names.of(first), names.of(last));
    if is_steep {
        let problem = format!(
            "slices from {first} to {last} are shifted sideways by {degrees:.2} degrees: pictures side by side are no \
             stack; name the files of one"
        );
        return Err(names.refuse(worst, problem));
    }
    let problem = format!(
        "the stack is not straight: this slice lies {off:.3} mm beside the line from {first} to {last} (which leans by \
         {degrees:.2} degrees); a volume's slices are shifted evenly: resample the series first (dcm2niix does)"
    );
    Err(names.refuse(worst, problem))
}

/// Checks that slices of one place lie on one another.
fn check_beside(slices: &[Slice], ones: &[Slice], place_of: &[usize], names: &Names) -> Result<()> {
    for (slice, place) in slices.iter().zip(place_of) {
        let one = &ones[*place];
        let off = (slice.position - one.position).length();
        // False for NaN.
        let is_on_it = off <= LEAN_TOLERANCE_PX * one.pixel_mm[0].min(one.pixel_mm[1]);
        if !is_on_it {
            let (other, position) = (names.of(one), show(slice.position));
            let problem = format!(
                "lies beside {other}, {off:.3} mm away in the same plane, at {position}: pictures side by side are no \
                 stack; name the files of one"
            );
            return Err(names.refuse(slice, problem));
        }
    }
    Ok(())
}

pub(super) fn show(v: DVec3) -> String {
    format!("({}, {}, {})", round(v.x), round(v.y), round(v.z))
}

/// Rounds to four decimals, more than files mean.
fn round(value: f64) -> f64 {
    (value * 1e4).round() / 1e4 + 0.0
}
