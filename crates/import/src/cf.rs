//! Meaning of a variable's numbers and places by the CF conventions of NetCDF, whatever holds it: fill values, packed numbers,
//! coordinates and units. Costs the coordinates.

pub(crate) mod axes;
pub(crate) mod place;

use crate::direct::direct;
use crate::element::{Decode, Element, Endian, Scale};
use crate::note::Note;
use crate::options::{NoData, OpenOptions};
use crate::source::SourceInfo;
use brickyard_volume::VoxelType;
use brickyard_volume::numbers::exact;

/// The fill value of NetCDF's floats, which says that nothing was written.
const NC_FILL_FLOAT: f64 = 9.969_209_968_386_869e36;

/// Greatest whole number up to which f64 tells all apart.
const MOST_EXACT: f64 = 9_007_199_254_740_992.0;

/// Attributes whose words are names of a variable's helpers: its bounds, coordinates and the like.
const HELPERS: [&str; 5] = ["bounds", "climatology", "coordinates", "ancillary_variables", "grid_mapping"];

/// Attributes of a variable.
pub(crate) trait Attributes {
    /// Whether there is an attribute of this name, of whatever type.
    fn has(&self, name: &str) -> bool;

    /// A text, without blanks around it; `None` if it is empty.
    fn text(&self, name: &str) -> Option<String>;

    /// Numbers, at least one.
    fn numbers(&self, name: &str) -> Option<Vec<f64>>;

    /// A single number.
    fn number(&self, name: &str) -> Option<f64> {
        match &self.numbers(name)?[..] {
            [number] => Some(*number),
            _ => None,
        }
    }

    /// A single number, also one in words; the error if the attribute is something else. Writers of texts leave numbers in quotes.
    fn number_in_words(&self, name: &str) -> Result<Option<f64>, String> {
        let number = self.number(name).or_else(|| self.text(name)?.parse().ok());
        match number {
            None if self.has(name) => Err(format!("{name} is no single number")),
            number => Ok(number),
        }
    }
}

/// Names of the variables that serve as another's bounds, coordinates and the like.
pub(crate) fn helpers_of(attributes: &(impl Attributes + ?Sized)) -> Vec<String> {
    let said = HELPERS.iter().filter_map(|name| attributes.text(name));
    said.flat_map(|names| names.split_whitespace().map(str::to_owned).collect::<Vec<_>>()).collect()
}

/// The number that NetCDF's library writes where nothing was written; `None` for bytes, all of which are data.
pub(crate) fn default_fill(element: Element) -> Option<f64> {
    Some(match element {
        Element::Voxel(VoxelType::I16) => -32767.0,
        Element::Voxel(VoxelType::U16) => 65535.0,
        Element::Voxel(VoxelType::I32) => -2147483647.0,
        Element::Voxel(VoxelType::U32) => 4294967295.0,
        Element::Voxel(VoxelType::F32) => f64::from(NC_FILL_FLOAT as f32),
        Element::F64 => NC_FILL_FLOAT,
        Element::I64 => -9223372036854775806.0,
        Element::U64 => 18446744073709551614.0,
        _ => return None,
    })
}

/// How stored numbers become values.
pub(crate) struct Values {
    pub(crate) decode: Decode,
    /// Voxels without data.
    absent: Option<Absent>,
    /// Unit of the values.
    unit: Option<String>,
    notes: Vec<Note>,
}

/// Voxels without data.
struct Absent {
    /// Their number in the file.
    stored: f64,
    /// Their value.
    value: f64,
    /// Name of the number in the file.
    name: &'static str,
}

impl Values {
    /// Decodes 64-bit numbers to the voxel type asked for. In an integer type, no data keeps its value, or gets that of the steps before if
    /// the type does not hold it.
    pub(crate) fn direct(mut self, options: &OpenOptions) -> Self {
        self.decode = direct(self.decode, self.absent.as_ref().map(|absent| absent.value), options);
        let held = options.held_as.and_then(|held| held.nodata).filter(|_| options.nodata == NoData::OfFile);
        let is_wide = matches!(self.decode.element, Element::I64 | Element::U64 | Element::F64);
        if let (Some(scale), Some(absent), Some(held)) = (&mut self.decode.scale, &mut self.absent, held)
            && is_wide
            && !scale.to.is_float()
            && !scale.to.holds(absent.value)
            && scale.to.holds(held)
            && absent.stored.abs() <= MOST_EXACT
        {
            (scale.absent, scale.nodata, absent.value) = (Some(absent.stored), Some(held), held);
        }
        self
    }

    /// Adds unit, remarks and the value of no data to a description.
    pub(crate) fn describe(&self, info: &mut SourceInfo) {
        info.notes.extend(self.notes.iter().cloned());
        if let Some(unit) = &self.unit {
            info.set_value_unit(unit, "units");
        }
        match &self.absent {
            // Their value is NaN already. Files of one variable are packed by scales of their own, so its value would differ in each.
            Some(Absent { stored, name, .. }) if self.decode.scale.is_some_and(|scale| scale.makes_nan()) => {
                info.knows_nodata = true;
                info.notes.push(Note::new(format!(
                    "Voxels stored as {} hold no data, according to the file ({name}): they become NaN.",
                    exact(*stored, false)
                )));
            }
            Some(Absent { value, name, .. }) => info.set_nodata(*value, name),
            None => {}
        }
    }
}

/// The values of a variable of such numbers. `default_fill` is the fill value of one that tells none.
pub(crate) fn values_of(
    attributes: &(impl Attributes + ?Sized),
    stored: Element,
    endian: Endian,
    nodata: NoData,
    default_fill: impl FnOnce(Element) -> Option<f64>,
) -> Values {
    let mut notes = Vec::new();
    let sign = attributes.text("_Unsigned").map(|said| said.to_ascii_lowercase());
    let element = match sign.as_deref() {
        Some("true") => unsigned(stored),
        Some("false") => signed(stored),
        _ => stored,
    };
    let mut scale = match scale_in(attributes) {
        Ok((slope, intercept)) => Scale::exact(element, slope, intercept),
        Err(problem) => {
            notes.push(Note::warning(format!("{problem}: the stored numbers are kept, without a unit.")));
            None
        }
    };
    // Stored numbers that should be values are in no unit. 1 is CF's word for none.
    let unit = attributes.text("units").filter(|units| units != "1" && notes.is_empty());
    let [least, greatest] = element.limits();
    let numbers = |name: &str| match attributes.number_in_words(name) {
        Ok(number) => number.into_iter().collect(),
        Err(_) => attributes.numbers(name).unwrap_or_default(),
    };
    // A fill value has the stored type: under another sign, and in f32, it stands for the same bits.
    let sensed = |fill: f64| match element {
        Element::Voxel(VoxelType::F32) => f64::from(fill as f32),
        other if other == stored || !holds(stored, fill) || holds(element, fill) => fill,
        _ if fill < least => fill + greatest + 1.0,
        _ => fill - greatest + least - 1.0,
    };
    let fill = attributes.number_in_words("_FillValue").unwrap_or_else(|problem| {
        notes.push(Note::warning(format!("{problem}: it is passed over.")));
        None
    });
    let missing: Vec<f64> = numbers("missing_value");
    if missing.is_empty() && attributes.has("missing_value") {
        notes.push(Note::warning("missing_value is no number: it is passed over."));
    }
    // Unless they are packed, no voxel holds those of 64-bit integers.
    let is_held = scale.is_some() || !matches!(stored, Element::I64 | Element::U64);
    let absent = fill.map(|fill| (fill, "_FillValue"));
    let absent = absent
        .or_else(|| Some((*missing.first()?, "missing_value")))
        .or_else(|| Some((default_fill(stored).filter(|_| is_held)?, "the fill value of NetCDF")));
    for other in missing.iter().filter(|other| absent.is_some_and(|(value, _)| value != **other && !other.is_nan())) {
        let other = exact(*other, false);
        notes.push(Note::warning(format!(
            "Voxels of {other} hold no data either (missing_value): they are kept as data."
        )));
    }
    for name in ["valid_range", "valid_min", "valid_max"] {
        if let Some(limits) = attributes.numbers(name) {
            notes.push(Note::new(format!(
                "Values beyond {name} {limits:?} hold no data, according to the file: they are kept."
            )));
        }
    }
    let absent = absent.map(|(fill, name)| {
        let stored = sensed(fill);
        Absent { stored, value: scale.map_or(stored, |scale| scale.value(stored)), name }
    });
    if let (Some(scale), Some(absent)) = (&mut scale, &absent)
        && scale.to == VoxelType::F32
        && absent.stored.is_finite()
        && nodata != NoData::None
    {
        scale.absent = Some(absent.stored);
    }
    // A mark which f32 would round, such as 1e20, is told from its neighbours by the stored number alone.
    let is_rounded = |mark: f64| mark.is_finite() && f64::from(mark as f32) != mark;
    if let Some(mark) = absent.as_ref().map(|absent| absent.stored).filter(|mark| is_rounded(*mark))
        && (element, scale, nodata) == (Element::F64, None, NoData::OfFile)
    {
        scale = Some(Scale { absent: Some(mark), ..Scale::new(1.0, 0.0, VoxelType::F32) });
    }
    let is_long = matches!(element, Element::Voxel(VoxelType::I32 | VoxelType::U32));
    if let Some(Scale { slope, intercept, to, .. }) = scale.filter(|scale| is_long && scale.to == VoxelType::F32) {
        notes.push(Note::warning(format!(
            "Values are scaled by {slope} and shifted by {intercept}, as the file says, and held as {to}, rounded to 24 bits."
        )));
    }
    Values { decode: Decode { element, endian, scale }, absent, unit, notes }
}

fn holds(element: Element, number: f64) -> bool {
    let [least, greatest] = element.limits();
    (least..=greatest).contains(&number)
}

/// Slope and intercept of packed numbers; the error says why they make no values.
fn scale_in(attributes: &(impl Attributes + ?Sized)) -> Result<(f64, f64), String> {
    let number = |name, default| Ok::<f64, String>(attributes.number_in_words(name)?.unwrap_or(default));
    let (slope, intercept) = (number("scale_factor", 1.0)?, number("add_offset", 0.0)?);
    match slope.is_finite() && slope != 0.0 && intercept.is_finite() {
        true => Ok((slope, intercept)),
        false => Err(format!("scale_factor {slope} and add_offset {intercept} make no values")),
    }
}

fn signed(element: Element) -> Element {
    match element {
        Element::Voxel(VoxelType::U8) => Element::Voxel(VoxelType::I8),
        Element::Voxel(VoxelType::U16) => Element::Voxel(VoxelType::I16),
        Element::Voxel(VoxelType::U32) => Element::Voxel(VoxelType::I32),
        Element::U64 => Element::I64,
        other => other,
    }
}

fn unsigned(element: Element) -> Element {
    match element {
        Element::Voxel(VoxelType::I8) => Element::Voxel(VoxelType::U8),
        Element::Voxel(VoxelType::I16) => Element::Voxel(VoxelType::U16),
        Element::Voxel(VoxelType::I32) => Element::Voxel(VoxelType::U32),
        Element::I64 => Element::U64,
        other => other,
    }
}
