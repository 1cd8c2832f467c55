//! MINC 1: images in classic NetCDF whose stored numbers are scaled slice by slice, placed in a patient by the steps, starts and
//! directions of their dimensions. Costs a copy of one slice of a box, where slices differ in scale.

use super::header::{Header, Told, Variable};
use super::{Opening, says};
use crate::axes::Axis;
use crate::cf::Attributes;
use crate::element::{Element, Scale};
use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::placement::set_matrix;
use crate::raw::RawSource;
use crate::source::{Source, SourceInfo};
use brickyard_volume::{VoxelBox, VoxelType};
use std::path::Path;

const ADVICE: &str = "convert it to NIfTI, as mnc2nii does";

/// Most scales of slices.
const MOST_SCALES: u64 = 1 << 20;

/// Places of a spatial dimension where its variable tells none: right, front and head.
const DIRECTIONS: [(&str, [f64; 3]); 3] =
    [("xspace", [1.0, 0.0, 0.0]), ("yspace", [0.0, 1.0, 0.0]), ("zspace", [0.0, 0.0, 1.0])];

/// An image and its limits.
pub(super) struct Image<'a> {
    low: &'a Variable,
    high: &'a Variable,
}

/// The letter of a MINC dimension.
pub(super) fn letter_of(name: &str) -> Option<String> {
    let letter = match name {
        "xspace" => "x",
        "yspace" => "y",
        "zspace" => "z",
        "time" => "t",
        "vector_dimension" => "c",
        _ => return None,
    };
    Some(letter.to_owned())
}

/// A variable as a MINC image; `None` if it is none, or has dimensions other than of space, time and vectors.
pub(super) fn image_of<'a>(header: &'a Header<'_>, variable: &Variable) -> Option<Image<'a>> {
    let are_known = header.dims_of(variable).all(|name| letter_of(name).is_some());
    if variable.name != "image" || !are_known {
        return None;
    }
    Some(Image { low: header.variable("image-min")?, high: header.variable("image-max")? })
}

/// The stored type: bytes have no sign, and other integers have one, unless the image says otherwise.
pub(super) fn element_of(attributes: &Told<'_>, element: Element) -> Element {
    let is_unsigned = says(attributes, "signtype", "unsigned")
        || element == Element::Voxel(VoxelType::I8) && !says(attributes, "signtype", "signed__");
    match element {
        Element::Voxel(VoxelType::I8) if is_unsigned => Element::Voxel(VoxelType::U8),
        Element::Voxel(VoxelType::I16) if is_unsigned => Element::Voxel(VoxelType::U16),
        Element::Voxel(VoxelType::I32) if is_unsigned => Element::Voxel(VoxelType::U32),
        other => other,
    }
}

/// Opens an image.
pub(super) fn open(
    path: &Path,
    image: Image<'_>,
    mut opening: Opening<'_>,
    notes: Vec<Note>,
) -> Result<Box<dyn Source>> {
    let header = opening.header;
    let element = opening.decode.element;
    opening.decode.scale = None;
    let is_float = matches!(element, Element::F64 | Element::Voxel(VoxelType::F32));
    let scales = if is_float { Scales::none() } else { Scales::of(path, &image, &opening)? };
    let one = scales.one_for(element);
    if let Some((slope, intercept)) = one {
        opening.decode.scale = Scale::exact(element, slope, intercept);
    }
    let mut info = opening.info(path)?;
    info.notes = notes;
    let places = place(header, opening.variable, &mut info);
    info.notes.extend(places);
    let source = opening.source(path, info.clone())?;
    if one.is_some() {
        return Ok(Box::new(source));
    }
    info = source.info().clone();
    info.voxel_type = VoxelType::F32;
    info.notes.push(Note::new("Stored numbers are scaled slice by slice, as MINC has it: voxels are f32."));
    Ok(Box::new(Scaled { source, info, scales }))
}

/// Scales of the parts of an image.
struct Scales {
    /// Limits of valid stored numbers; others count as the nearest.
    valid: [f64; 2],
    /// Slope and intercept of each part.
    parts: Vec<(f64, f64)>,
    /// Parts from one place to the next along t, z, y, x.
    strides: [usize; 4],
}

impl Scales {
    /// Values as they are stored.
    fn none() -> Self {
        Self { valid: [f64::NEG_INFINITY, f64::INFINITY], parts: vec![(1.0, 0.0)], strides: [0; 4] }
    }

    fn of(path: &Path, image: &Image<'_>, opening: &Opening<'_>) -> Result<Self> {
        let (header, variable) = (opening.header, opening.variable);
        let refuse = |what: &str| ImportError::unsupported_but(path, format!("MINC with {what}"), ADVICE);
        let names = |variable| header.dims_of(variable).map(str::to_owned).collect::<Vec<_>>();
        let (of_image, dims) = (names(variable), names(image.high));
        if names(image.low) != dims || !of_image.starts_with(&dims) || dims.len() > 2 {
            return Err(refuse("limits of slices along other dimensions than the image's slowest"));
        }
        let numbers = |variable| header.numbers_of(variable, MOST_SCALES).ok_or_else(|| refuse("unreadable limits"));
        let (low, high) = (numbers(image.low)?, numbers(image.high)?);
        let attributes = header.attributes_of(variable);
        let ends = || Some(vec![attributes.number("valid_min")?, attributes.number("valid_max")?]);
        let limits = opening.decode.element.limits();
        let valid = attributes.numbers("valid_range").or_else(ends).unwrap_or(limits.to_vec());
        let sound = |valid: &[f64; 2]| valid[0] < valid[1] && valid[0] >= limits[0] && valid[1] <= limits[1];
        let valid = <[f64; 2]>::try_from(valid).ok().filter(sound);
        let valid = valid.ok_or_else(|| refuse("a valid range beyond its type"))?;
        let part = |(low, high): (&f64, &f64)| {
            let slope = (high - low) / (valid[1] - valid[0]);
            (slope, low - valid[0] * slope)
        };
        let parts: Vec<(f64, f64)> = low.iter().zip(&high).map(part).collect();
        if parts.iter().any(|(slope, intercept)| !(slope.is_finite() && intercept.is_finite())) {
            return Err(refuse("limits of slices that are no numbers"));
        }
        let (mut strides, mut stride) = ([0; 4], 1);
        for (place, axis) in opening.axes.iter().enumerate().take(dims.len()).rev() {
            let at = [Axis::T, Axis::Z, Axis::Y, Axis::X].iter().position(|a| a == axis);
            strides[at.ok_or_else(|| refuse("limits along vectors"))?] = stride;
            stride *= variable.shape[place] as usize;
        }
        if parts.len() != stride {
            return Err(refuse("more or fewer limits than slices"));
        }
        Ok(Self { valid, parts, strides })
    }

    /// The only scale, if no stored number lies outside the valid ones.
    fn one_for(&self, element: Element) -> Option<(f64, f64)> {
        let first = *self.parts.first()?;
        let [low, high] = element.limits();
        let is_whole = self.valid[0] <= low && high <= self.valid[1];
        (is_whole && self.parts.iter().all(|part| *part == first)).then_some(first)
    }
}

/// Sets spacing, origin, unit and orientation from the dimensions' variables.
fn place(header: &Header<'_>, variable: &Variable, info: &mut SourceInfo) -> Vec<Note> {
    let mut notes = Vec::new();
    let mut matrix = [[0.0; 4]; 3];
    let mut units = Vec::new();
    for (axis, (name, default)) in DIRECTIONS.into_iter().enumerate() {
        let told = header.variable(name).map(|found| header.attributes_of(found));
        let number = |name: &str| told.as_ref().and_then(|told| told.number(name));
        let is_even = told.as_ref().is_none_or(|told| !says(told, "spacing", "irregular"));
        let step = number("step").unwrap_or(1.0);
        let is_of_image = header.dims_of(variable).any(|dim| dim == name);
        if is_of_image && !(is_even && step.is_finite() && step != 0.0) {
            notes.push(
                Note::warning(format!("Steps along {name} are uneven: the volume is not calibrated."))
                    .settled_by(Setting::Spacing),
            );
            return notes;
        }
        let cosines = told.as_ref().and_then(|told| told.numbers("direction_cosines"));
        let direction = cosines.and_then(|cosines| <[f64; 3]>::try_from(cosines).ok()).unwrap_or(default);
        let start = number("start").unwrap_or(0.0);
        for row in 0..3 {
            matrix[row][axis] = direction[row] * step;
            matrix[row][3] += direction[row] * start;
        }
        info.geometry.spacing[axis] = step.abs();
        info.calibrated |= is_of_image && number("step").is_some();
        units.extend(told.and_then(|told| told.text("units")).filter(|_| is_of_image));
    }
    match units.iter().all(|unit| unit == "mm") {
        true if units.is_empty() => {}
        true => info.geometry.unit = Some("millimeter".into()),
        false => notes.push(
            Note::warning(format!("Units of the axes, {}, are left out.", units.join(", "))).settled_by(Setting::Unit),
        ),
    }
    set_matrix(matrix, info, &mut notes);
    notes
}

/// An image of several scales, as f32.
struct Scaled {
    source: RawSource,
    info: SourceInfo,
    scales: Scales,
}

impl Source for Scaled {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&self.source)
    }

    fn reader_bytes(&self) -> u64 {
        let extent = self.info.extent;
        u64::from(extent.x) * u64::from(extent.y) * self.source.info().voxel_type.bytes() as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let voxel_type = self.source.info().voxel_type;
        let (low, high) = (region.min.to_array(), region.max.to_array());
        let slice = region.extent().x as usize * region.extent().y as usize;
        let mut stored = vec![0; slice * voxel_type.bytes()];
        let [by_t, by_z, by_y, by_x] = self.scales.strides;
        let (values, _) = out.as_chunks_mut::<4>();
        for (z, values) in (low[2]..high[2]).zip(values.chunks_exact_mut(slice)) {
            let of_slice = VoxelBox::new([low[0], low[1], z], [high[0], high[1], z + 1]);
            self.source.read_box(time, channel, of_slice, &mut stored)?;
            let places = (low[1]..high[1]).flat_map(|y| (low[0]..high[0]).map(move |x| (y, x)));
            for (n, ((y, x), value)) in places.zip(values).enumerate() {
                let part = time as usize * by_t + z as usize * by_z + y as usize * by_y + x as usize * by_x;
                let (slope, intercept) = self.scales.parts[part];
                let number = voxel_type.read(&stored, n).clamp(self.scales.valid[0], self.scales.valid[1]);
                *value = ((number * slope + intercept) as f32).to_le_bytes();
            }
        }
        Ok(())
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.source.announce(time, channel, region);
    }
}
