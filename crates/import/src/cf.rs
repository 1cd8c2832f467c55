//! Meaning of a variable's numbers and places by the CF conventions of NetCDF, whatever holds it: fill values, packed numbers,
//! coordinates and units. Costs the coordinates.

pub(crate) mod axes;
pub(crate) mod place;

use crate::element::{Decode, Element, Endian, Scale};
use crate::note::Note;
use brickyard_volume::VoxelType;
use brickyard_volume::numbers::exact;

/// The fill value of NetCDF's floats, which says that nothing was written.
const NC_FILL_FLOAT: f64 = 9.969_209_968_386_869e36;

/// Attributes whose words are names of a variable's helpers: its bounds, coordinates and the like.
const HELPERS: [&str; 5] = ["bounds", "climatology", "coordinates", "ancillary_variables", "grid_mapping"];

/// Attributes of a variable.
pub(crate) trait Attributes {
    /// A text, without blanks around it; `None` if it is empty.
    fn text(&self, name: &str) -> Option<String>;

    /// Numbers, at least one.
    fn numbers(&self, name: &str) -> Option<Vec<f64>>;

    /// A single number.
    fn number(&self, name: &str) -> Option<f64> {
        self.numbers(name).filter(|numbers| numbers.len() == 1).map(|numbers| numbers[0])
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
        _ => return None,
    })
}

/// How stored numbers become values.
pub(crate) struct Values {
    pub(crate) decode: Decode,
    /// Value of voxels without data, and its name in the file.
    pub(crate) nodata: Option<(f64, &'static str)>,
    /// Unit of the values.
    pub(crate) unit: Option<String>,
    pub(crate) notes: Vec<Note>,
}

/// The values of a variable of such numbers. `default_fill` is the fill value of one that tells none.
pub(crate) fn values_of(
    attributes: &(impl Attributes + ?Sized),
    stored: Element,
    endian: Endian,
    default_fill: impl FnOnce(Element) -> Option<f64>,
) -> Values {
    let mut notes = Vec::new();
    let is_unsigned = attributes.text("_Unsigned").is_some_and(|said| said.eq_ignore_ascii_case("true"));
    let element = if is_unsigned { unsigned(stored) } else { stored };
    let slope = attributes.number("scale_factor").unwrap_or(1.0);
    let intercept = attributes.number("add_offset").unwrap_or(0.0);
    let is_scaled = slope.is_finite() && slope != 0.0 && intercept.is_finite();
    let scale = match is_scaled {
        true => Scale::exact(element, slope, intercept),
        false => {
            notes.push(Note::warning(format!(
                "scale_factor {slope} and add_offset {intercept} make no values: the stored numbers are kept."
            )));
            None
        }
    };
    let (slope, intercept) = scale.map_or((1.0, 0.0), |scale| (scale.slope, scale.intercept));
    let value = |stored: f64| {
        let [_, greatest] = element.limits();
        // A negative fill value of numbers read as unsigned stands for their upper half.
        let stored = if is_unsigned && stored < 0.0 { stored + greatest + 1.0 } else { stored };
        stored * slope + intercept
    };
    let fill = attributes.number("_FillValue").map(|fill| (fill, "_FillValue"));
    let missing = attributes.numbers("missing_value").unwrap_or_default();
    let nodata = fill
        .or_else(|| Some((*missing.first()?, "missing_value")))
        .or_else(|| Some((default_fill(element)?, "the fill value of NetCDF")));
    for other in missing.iter().filter(|other| nodata.is_some_and(|(value, _)| value != **other && !other.is_nan())) {
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
    // A scale that makes no values leaves stored numbers, which are in no unit. 1 is CF's word for none.
    let unit = attributes.text("units").filter(|units| units != "1" && is_scaled);
    let decode = Decode { element, endian, scale };
    Values { decode, nodata: nodata.map(|(stored, name)| (value(stored), name)), unit, notes }
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
