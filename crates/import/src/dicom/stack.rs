//! From slices with a place each to one volume: sorted along their normal, and refused where they are not an upright,
//! evenly spaced stack.
//!
//! Positions and directions are the patient's (mm; x to the left, y to the back, z to the head: "LPS"), as files have them.
//! The matrix that comes out is of the world that NIfTI has, x to the right and y to the front, so that volumes of one
//! patient meet whatever their format.

use crate::error::ImportError;
use brickyard_volume::counted;
use glam::{DMat3, DVec3};
use std::path::PathBuf;

/// Slices' spacings may differ by this part.
const SPACING_TOLERANCE: f64 = 1e-2;
/// What rounding of positions may explain of a spacing: far from a missing slice.
const ROUNDING_TOLERANCE: f64 = 0.1;
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
    /// A sentence for the user if the spacing along z was assumed or averaged.
    pub(super) note: Option<String>,
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

/// Sorts the slices by their position along the normal and places the stack. With `even` the slices are taken as evenly
/// spaced whatever their positions say.
///
/// # Errors
/// If the slices are not one upright stack: they differ in direction or pixel size, two lie in one place, the spacing
/// is uneven, or the stack leans.
pub(super) fn arrange(slices: &mut [Slice], names: &Names, even: bool) -> Result<Placement, ImportError> {
    let first = slices[0].clone();
    check_directions(slices, names)?;
    let normal = first.along_row.cross(first.along_column).normalize();
    let depth = |s: &Slice| (s.position - first.position).dot(normal);
    slices.sort_by(|a, b| depth(a).total_cmp(&depth(b)).then((a.file, a.frame).cmp(&(b.file, b.frame))));
    let (spacing_z, note) = match slices {
        [one] => alone(one),
        _ => {
            let gaps: Vec<f64> = slices.windows(2).map(|pair| depth(&pair[1]) - depth(&pair[0])).collect();
            let note = check_gaps(&gaps, slices, normal, names, even)?;
            check_lean(slices, normal, names)?;
            (gaps.iter().sum::<f64>() / gaps.len() as f64, note)
        }
    };
    let spacing = DVec3::new(first.pixel_mm[0], first.pixel_mm[1], spacing_z);
    let axes = DMat3::from_cols(first.along_row * spacing.x, first.along_column * spacing.y, normal * spacing.z);
    // From the patient's left and back to the world's right and front.
    let flip = DVec3::new(-1.0, -1.0, 1.0);
    let origin = slices[0].position * flip;
    let matrix = std::array::from_fn(|r| {
        let row = axes.row(r) * flip[r];
        [row.x, row.y, row.z, origin[r]]
    });
    Ok(Placement { spacing, matrix, note })
}

/// The third spacing of a stack of one slice.
fn alone(slice: &Slice) -> (f64, Option<String>) {
    match slice.step_mm {
        Some((mm, name)) => {
            (mm, Some(format!("A single slice: its {name} of {mm} mm is taken as the spacing along z.")))
        }
        None => {
            let note =
                "A single slice without SpacingBetweenSlices or SliceThickness: 1 mm is taken as the spacing along z.";
            (1.0, Some(note.into()))
        }
    }
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

/// Sorted slices must lie at places of their own, evenly; a note where they do as far as their positions' digits tell.
fn check_gaps(
    gaps: &[f64],
    slices: &[Slice],
    normal: DVec3,
    names: &Names,
    even: bool,
) -> Result<Option<String>, ImportError> {
    let mut positive: Vec<f64> = gaps.iter().copied().filter(|g| *g > 1e-6).collect();
    positive.sort_by(f64::total_cmp);
    let typical = positive.get(positive.len() / 2).copied().unwrap_or(0.0);
    let doubles = gaps.iter().filter(|g| **g <= SPACING_TOLERANCE * typical).count();
    if doubles > 0 {
        let at = gaps.iter().position(|g| *g <= SPACING_TOLERANCE * typical).unwrap_or(0);
        let (a, b) = (&slices[at], &slices[at + 1]);
        let problem = format!(
            "lies where {} lies, at {}: {} slices at {} positions; give the files of one time step, echo or phase only, each once",
            names.of(a),
            show(b.position),
            slices.len(),
            slices.len() - doubles
        );
        return Err(names.refuse(b, problem));
    }
    let uneven = |gap: f64| (gap - typical).abs() > SPACING_TOLERANCE * typical;
    let count = gaps.iter().filter(|g| uneven(**g)).count();
    let worst = (0..gaps.len()).max_by(|&a, &b| (gaps[a] - typical).abs().total_cmp(&(gaps[b] - typical).abs()));
    let Some(at) = worst.filter(|_| count > 0 && !even) else { return Ok(None) };
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    if is_rounding(gaps, slices, normal, mean) {
        let [least, most] = [gaps.iter().copied().fold(f64::MAX, f64::min), gaps.iter().copied().fold(0.0, f64::max)];
        return Ok(Some(format!(
            "Slices are {least:.4} to {most:.4} mm apart, which the few decimals of their positions explain: {mean:.4} mm is taken \
             for all."
        )));
    }
    let steps = gaps[at] / typical;
    let is_gap = (steps - steps.round()).abs() < 0.05 && steps > 1.5;
    let (missing, add) = match is_gap {
        true => {
            let missing = steps.round() as u64 - 1;
            let are = if missing == 1 { "is" } else { "are" };
            (format!(" ({} {are} missing between them)", counted(missing, "slice")), "add the missing files, or ")
        }
        false => (String::new(), ""),
    };
    let [x, y] = slices[0].pixel_mm;
    let problem = format!(
        "slices are not evenly spaced: expected {typical:.4} mm from one to the next (as most are), found {:.4} mm from {} (at {}) to {} \
         (at {}){missing}; {count} of {} steps differ; {add}pass `spacing` {x},{y},{} to take the slices as even",
        gaps[at],
        names.of(&slices[at]),
        show(slices[at].position),
        names.of(&slices[at + 1]),
        show(slices[at + 1].position),
        gaps.len(),
        round(if is_gap { typical } else { mean }),
    );
    Err(names.refuse(&slices[at + 1], problem))
}

/// Whether positions that were rounded to the decimals they are written with explain all steps between slices.
fn is_rounding(gaps: &[f64], slices: &[Slice], normal: DVec3, mean: f64) -> bool {
    // Zeros at a number's end may not be written: the finest slice tells of all.
    let places = |a: usize| slices.iter().map(|s| s.rounding[a]).filter(|r| *r > 0.0).fold(f64::MAX, f64::min);
    let along: f64 = (0..3).map(|a| normal[a].abs() * if places(a) < f64::MAX { places(a) } else { 0.0 }).sum();
    // Either end of a step, and both ends of the whole stack, of which the mean is made.
    let most = 2.0 * along * (1.0 + 1.0 / gaps.len() as f64) * (1.0 + 1e-9);
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
