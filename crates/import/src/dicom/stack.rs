//! From slices with a place each to one volume: sorted along their normal, and refused where they are not an upright,
//! evenly spaced stack.
//!
//! Positions and directions are the patient's (mm; x to the left, y to the back, z to the head: "LPS"), as files have them.
//! The matrix that comes out is of the world that NIfTI has, x to the right and y to the front, so that volumes of one
//! patient meet whatever their format.

use crate::error::ImportError;
use crate::note::Note;
use brickyard_volume::counted;
use glam::{DMat3, DVec3};
use std::path::PathBuf;

/// Slices' spacings may differ by this part.
const SPACING_TOLERANCE: f64 = 1e-2;
/// What rounding of positions may explain of a spacing: far from a missing slice.
const ROUNDING_TOLERANCE: f64 = 0.1;
/// The part of a step by which a distance between slices may differ from a whole number of steps, at most.
const WHOLE_TOLERANCE: f64 = 0.25;
/// Directions may differ by this much (a sine): over a stack's width of 1000 pixels, a tenth of a pixel.
const DIRECTION_TOLERANCE: f64 = 1e-4;
/// A stack may lean by this part of a pixel from its first slice to its last.
const LEAN_TOLERANCE_PX: f64 = 0.5;

/// One slice and where it lies.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    /// Index of the slice's file, in the order in which files were given.
    pub(super) file: usize,
    /// Index of the slice's frame in its file, from 0.
    pub(super) frame: usize,
    /// Centre of the first pixel in the patient's coordinates, mm.
    pub(super) position: DVec3,
    /// Largest error of the position along x, y and z that comes from rounding to the decimals that are written, mm.
    pub(super) rounding: DVec3,
    /// Direction along a row of pixels, in which the column index grows.
    pub(super) along_row: DVec3,
    /// Direction along a column of pixels, in which the row index grows.
    pub(super) along_column: DVec3,
    /// Distance between pixel centres along a row and along a column, mm.
    pub(super) pixel_mm: [f64; 2],
    /// Distance or thickness of slices that the file gives, mm, with the element's name. It is the spacing along z if
    /// there is only one slice.
    pub(super) step_mm: Option<(f64, &'static str)>,
}

/// Where a stack of slices lies in the world.
#[derive(Debug)]
pub(super) struct Placement {
    pub(super) spacing: DVec3,
    /// World-from-voxel-centre matrix, by rows.
    pub(super) matrix: [[f64; 4]; 3],
    /// For each slice its index along z: ascending from 0, without gaps but for missing slices.
    pub(super) levels: Vec<u32>,
    /// A sentence for the user if the spacing along z was assumed, averaged or is not that of the positions.
    pub(super) note: Option<Note>,
}

/// Rule for the distances between slices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Spacing {
    /// They are even.
    Even,
    /// They are this, in mm, whatever the positions say.
    Told(f64),
    /// They are even but for missing slices, whose places are left.
    WithGaps,
}

/// Sorted slices along z.
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
    fn of(&self, slice: &Slice) -> String {
        let path = self.paths[slice.file].display();
        if self.by_frame { format!("{path} (frame {})", slice.frame + 1) } else { path.to_string() }
    }

    fn refuse(&self, slice: &Slice, problem: String) -> ImportError {
        let frame = if self.by_frame { format!("frame {}: ", slice.frame + 1) } else { String::new() };
        ImportError::invalid(&self.paths[slice.file], frame + &problem)
    }
}

/// Sorts the slices by their position along the normal and places the stack.
///
/// # Errors
/// If the slices are not one upright stack: they differ in direction or pixel size, two lie in one place, the spacing
/// is uneven, or the stack leans.
pub(super) fn arrange(slices: &mut [Slice], names: &Names, asked: Spacing) -> Result<Placement, ImportError> {
    let first = slices[0].clone();
    check_directions(slices, names)?;
    let normal = first.along_row.cross(first.along_column).normalize();
    let depth = |s: &Slice| (s.position - first.position).dot(normal);
    slices.sort_by(|a, b| depth(a).total_cmp(&depth(b)).then((a.file, a.frame).cmp(&(b.file, b.frame))));
    let along = match slices {
        [one] => alone(one),
        _ => {
            let gaps: Vec<f64> = slices.windows(2).map(|pair| depth(&pair[1]) - depth(&pair[0])).collect();
            let along = along(&gaps, slices, normal, names, asked)?;
            check_lean(slices, normal, names)?;
            along
        }
    };
    let spacing = DVec3::new(first.pixel_mm[0], first.pixel_mm[1], along.spacing);
    let axes = DMat3::from_cols(first.along_row * spacing.x, first.along_column * spacing.y, normal * spacing.z);
    // From the patient's left and back to the world's right and front.
    let flip = DVec3::new(-1.0, -1.0, 1.0);
    let origin = slices[0].position * flip;
    let matrix = std::array::from_fn(|r| {
        let row = axes.row(r) * flip[r];
        [row.x, row.y, row.z, origin[r]]
    });
    Ok(Placement { spacing, matrix, levels: along.levels, note: along.note })
}

/// A stack of one slice.
fn alone(slice: &Slice) -> Along {
    let (spacing, note) = match slice.step_mm {
        Some((mm, name)) => {
            let note = format!("A single slice: its {name} of {mm} mm is taken as the spacing along z.");
            (mm, Note::new(note))
        }
        None => {
            let note =
                "A single slice without SpacingBetweenSlices or SliceThickness: 1 mm is taken as the spacing along z.";
            (1.0, Note::warning(note))
        }
    };
    Along { spacing, levels: vec![0], note: Some(note) }
}

/// All slices must look the same way and have pixels of one size.
fn check_directions(slices: &[Slice], names: &Names) -> Result<(), ImportError> {
    let first = &slices[0];
    let (row, column) = (first.along_row, first.along_column);
    let upright = [row.length() - 1.0, column.length() - 1.0, row.dot(column)];
    if upright.iter().any(|e| e.abs() >= 1e-3) {
        let problem = format!(
            "ImageOrientationPatient {} {} is not two perpendicular directions of length 1; write the file again",
            show(row),
            show(column)
        );
        return Err(names.refuse(first, problem));
    }
    let parallel = |a: &Slice, b: &Slice| {
        let apart = [a.along_row - b.along_row, a.along_column - b.along_column];
        apart.iter().all(|d| d.length() <= DIRECTION_TOLERANCE)
    };
    if let [most, other, ..] = kinds(slices, parallel)[..] {
        let show = |s: &Slice| format!("{} {}", show(s.along_row), show(s.along_column));
        let problem = format!(
            "looks along {} (ImageOrientationPatient), as {} slices do; {} look along {}, such as {}. Slices of one volume are \
             parallel: give the files of one direction (localizers often lie among a series)",
            show(&slices[other.0]),
            other.1,
            most.1,
            show(&slices[most.0]),
            names.of(&slices[most.0])
        );
        return Err(names.refuse(&slices[other.0], problem));
    }
    let same_pixels =
        |a: &Slice, b: &Slice| (0..2).all(|i| (a.pixel_mm[i] - b.pixel_mm[i]).abs() <= 1e-4 * b.pixel_mm[i]);
    if let [most, other, ..] = kinds(slices, same_pixels)[..] {
        let show = |s: &Slice| format!("{} x {} mm", s.pixel_mm[0], s.pixel_mm[1]);
        let problem = format!(
            "has pixels of {}, as {} slices do; {} have pixels of {}, such as {}. Give the files of one size",
            show(&slices[other.0]),
            other.1,
            most.1,
            show(&slices[most.0]),
            names.of(&slices[most.0])
        );
        return Err(names.refuse(&slices[other.0], problem));
    }
    Ok(())
}

/// Groups equal items. Returns for each group the index of its first item and the number of its items, the largest
/// group first.
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

/// Where sorted slices lie along z. They must have places of their own, and be as far apart as is asked.
fn along(gaps: &[f64], slices: &[Slice], normal: DVec3, names: &Names, asked: Spacing) -> Result<Along, ImportError> {
    let mut positive: Vec<f64> = gaps.iter().copied().filter(|g| *g > 1e-6).collect();
    positive.sort_by(f64::total_cmp);
    let [nearest, typical] = [0, positive.len() / 2].map(|i| positive.get(i).copied().unwrap_or(0.0));
    check_doubles(gaps, typical, slices, names)?;
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    let even = |note| Along { spacing: mean, levels: (0..slices.len() as u32).collect(), note };
    if gaps.iter().all(|gap| !is_uneven(*gap, typical)) {
        return Ok(even(None));
    }
    let rounding = rounding_along(slices, normal);
    // Where gaps are many, it is the least distance that the others are whole numbers of.
    let tried = [typical, nearest].map(|mm| Steps { mm, rounding });
    let steps = tried.into_iter().find(|steps| with_gaps(gaps, *steps).is_some()).unwrap_or(tried[0]);
    let [least, most] = [gaps.iter().copied().fold(f64::MAX, f64::min), gaps.iter().copied().fold(0.0, f64::max)];
    let apart = format!("Slices are {least:.4} to {most:.4} mm apart");
    match asked {
        Spacing::Told(mm) => {
            let place = |i: usize| gaps[..i].iter().sum::<f64>();
            let moved = |i: usize| (mm * i as f64 - place(i)).abs();
            let worst = (0..slices.len()).max_by(|&a, &b| moved(a).total_cmp(&moved(b))).unwrap_or(0);
            Ok(even(Some(Note::warning(format!(
                "{apart} by their positions, and taken as {mm} mm apart, as `spacing` says: {} is {:.4} mm from where its position says. \
                 Where slices are missing, `gaps` blank leaves their places.",
                names.of(&slices[worst]),
                moved(worst)
            )))))
        }
        _ if is_rounding(gaps, rounding, mean) => Ok(even(Some(Note::new(format!(
            "{apart}, which the few decimals of their positions explain: {mean:.4} mm is taken for all."
        ))))),
        Spacing::WithGaps => with_gaps(gaps, steps).ok_or_else(|| uneven(gaps, steps, slices, names)),
        Spacing::Even => Err(uneven(gaps, steps, slices, names)),
    }
}

/// Whether a distance between slices is not what is expected.
fn is_uneven(gap: f64, expected: f64) -> bool {
    (gap - expected).abs() > SPACING_TOLERANCE * expected
}

/// No two slices may lie in one place.
fn check_doubles(gaps: &[f64], typical: f64, slices: &[Slice], names: &Names) -> Result<(), ImportError> {
    let is_double = |gap: &f64| *gap <= SPACING_TOLERANCE * typical;
    let Some(at) = gaps.iter().position(is_double) else { return Ok(()) };
    let (a, b) = (&slices[at], &slices[at + 1]);
    let problem = format!(
        "lies where {} lies, at {}: {} slices at {} positions; give the files of one time step, echo or phase only, each once",
        names.of(a),
        show(b.position),
        slices.len(),
        slices.len() - gaps.iter().filter(|gap| is_double(gap)).count()
    );
    Err(names.refuse(b, problem))
}

/// The distance from a slice to the next one if none is missing, and how far rounding puts a position off, mm.
#[derive(Clone, Copy)]
struct Steps {
    mm: f64,
    rounding: f64,
}

impl Steps {
    /// How many steps a distance between slices is, where that is a whole number.
    fn in_gap(self, gap: f64) -> Option<u32> {
        let steps = (gap / self.mm).round();
        // Both ends of the distance, and of each step that it is measured by.
        let off = steps * SPACING_TOLERANCE * self.mm + 2.0 * self.rounding * (steps + 1.0);
        let is_whole = (gap - steps * self.mm).abs() <= off.min(WHOLE_TOLERANCE * self.mm);
        (is_whole && (1.0..=f64::from(u32::MAX)).contains(&steps)).then_some(steps as u32)
    }
}

/// Where slices lie along z if some are missing between them; `None` unless all distances are whole numbers of steps, and no more slices are
/// missing than are there.
fn with_gaps(gaps: &[f64], steps: Steps) -> Option<Along> {
    let mut levels = vec![0u32];
    for gap in gaps {
        let last = levels.last().copied().unwrap_or(0);
        levels.push(last.checked_add(steps.in_gap(*gap)?)?);
    }
    let last = levels.last().copied().unwrap_or(0);
    let spacing = gaps.iter().sum::<f64>() / f64::from(last);
    (u64::from(last) < 2 * levels.len() as u64).then_some(Along { spacing, levels, note: None })
}

/// The refusal of slices that are not evenly spaced.
fn uneven(gaps: &[f64], steps: Steps, slices: &[Slice], names: &Names) -> ImportError {
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
        Some(_) if with_gaps(gaps, steps).is_some() => {
            "add the missing files, or pass `gaps` blank to leave their places without data".into()
        }
        Some(_) => "add the missing files, or give those of an even part".into(),
        None => {
            let ([x, y], mean) = (slices[0].pixel_mm, gaps.iter().sum::<f64>() / gaps.len() as f64);
            format!("pass `spacing` {x},{y},{} to take the slices as even, which moves some of them", round(mean))
        }
    };
    let problem = format!(
        "slices are not evenly spaced: expected {expected:.4} mm from one to the next, found {:.4} mm from {} (at {}) to {} \
         (at {}){found}; {count} of {} steps differ; {advice}",
        gaps[at],
        names.of(&slices[at]),
        show(slices[at].position),
        names.of(&slices[at + 1]),
        show(slices[at + 1].position),
        gaps.len(),
    );
    names.refuse(&slices[at + 1], problem)
}

/// How far from its place along the normal a slice may be, mm, by the decimals that positions are written with.
fn rounding_along(slices: &[Slice], normal: DVec3) -> f64 {
    // Zeros at a number's end may not be written: the finest slice tells of all.
    let places = |a: usize| slices.iter().map(|s| s.rounding[a]).filter(|r| *r > 0.0).fold(f64::MAX, f64::min);
    (0..3).map(|a| normal[a].abs() * if places(a) < f64::MAX { places(a) } else { 0.0 }).sum()
}

/// Whether positions that may be off by `rounding` explain all steps between slices.
fn is_rounding(gaps: &[f64], rounding: f64, mean: f64) -> bool {
    // Either end of a step, and both ends of the whole stack, of which the mean is made.
    let most = 2.0 * rounding * (1.0 + 1.0 / gaps.len() as f64) * (1.0 + 1e-9);
    gaps.iter().all(|gap| (gap - mean).abs() <= most.min(ROUNDING_TOLERANCE * mean))
}

/// Sorted slices must lie straight above one another.
fn check_lean(slices: &[Slice], normal: DVec3, names: &Names) -> Result<(), ImportError> {
    let first = &slices[0];
    let lean = |s: &Slice| {
        let offset = s.position - first.position;
        (offset - normal * offset.dot(normal)).length()
    };
    let Some(worst) = slices.iter().max_by(|a, b| lean(a).total_cmp(&lean(b))) else { return Ok(()) };
    let pixel = first.pixel_mm[0].min(first.pixel_mm[1]);
    if lean(worst) <= LEAN_TOLERANCE_PX * pixel {
        return Ok(());
    }
    let along = (worst.position - first.position).dot(normal);
    let problem = format!(
        "the stack leans: slices are shifted sideways by {:.3} mm over {along:.3} mm ({:.2} degrees, a tilted gantry), from {} to here; \
         a store holds upright volumes only: resample it first (dcm2niix does)",
        lean(worst),
        (lean(worst) / along).atan().to_degrees(),
        names.of(first)
    );
    Err(names.refuse(worst, problem))
}

fn show(v: DVec3) -> String {
    format!("({}, {}, {})", round(v.x), round(v.y), round(v.z))
}

/// Four decimals are more than files mean.
fn round(value: f64) -> f64 {
    (value * 1e4).round() / 1e4 + 0.0
}
