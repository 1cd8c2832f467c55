//! Units of a series' values after rescaling: from the rescale type, PET's units, those of a dose, or the standard's rule for CT.

use super::header::Header;
use dicom_dictionary_std::tags;

/// The unit of a frame's values; `None` if the file gives none.
pub(super) fn value_unit(header: &Header, frame: usize) -> Option<String> {
    let text = |tag| header.written(frame, tag);
    let modality = header.text(tags::MODALITY).unwrap_or_default();
    if let Some(units) = text(tags::UNITS).filter(|_| modality == "PT") {
        return of_pet(&units);
    }
    if modality == "RTDOSE" {
        return text(tags::DOSE_UNITS).filter(|unit| unit == "GY").map(|_| "Gy".into());
    }
    if let Some(kind) = text(tags::RESCALE_TYPE) {
        return of_rescale_type(&kind);
    }
    // Values are in Hounsfield units where the type is absent (PS3.3 C.8.2.1), but for localizers and derived images.
    let image_type = header.text(tags::IMAGE_TYPE).unwrap_or_default();
    let kinds: Vec<&str> = image_type.split('\\').map(str::trim).collect();
    let is_rescaled = text(tags::RESCALE_SLOPE).is_some() && text(tags::RESCALE_INTERCEPT).is_some();
    let is_original = kinds.first() == Some(&"ORIGINAL") && !kinds.contains(&"LOCALIZER");
    (modality == "CT" && is_original && is_rescaled).then(|| "HU".into())
}

/// Symbol of a rescale type (PS3.3 C.11.1.1.2); unknown ones are kept as they are.
fn of_rescale_type(kind: &str) -> Option<String> {
    let symbol = match kind {
        "US" | "UNSPECIFIED" => return None,
        "OD" => "10\u{207b}\u{b3} OD",
        "MGML" => "mg/mL",
        "Z_EFF" => "effective Z",
        "ED" => "10\u{b2}\u{b3} electrons/mL",
        "PCT" => "%",
        other => other,
    };
    Some(symbol.into())
}

/// Symbol of PET's units (PS3.3 C.8.9.1.1.3); unknown ones are kept as they are.
fn of_pet(units: &str) -> Option<String> {
    let symbol = match units {
        "NONE" => return None,
        "CNTS" => "counts",
        "CPS" => "counts/s",
        "BQML" => "Bq/mL",
        "PCNT" => "%",
        "CM2" => "cm\u{b2}",
        "CM2ML" => "cm\u{b2}/mL",
        "MGMINML" => "mg/min/mL",
        "UMOLMINML" => "\u{b5}mol/min/mL",
        "UMOLML" => "\u{b5}mol/mL",
        "MLMING" => "mL/min/g",
        "MLMINML" => "mL/min/mL",
        "MLG" => "mL/g",
        "MLML" => "mL/mL",
        "1CM" => "1/cm",
        "GML" => "g/mL",
        other => other,
    };
    Some(symbol.into())
}
