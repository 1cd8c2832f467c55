//! Documents of Zarr version 2: `.zarray`, with attributes in `.zattrs`.

use super::codecs::{Codec, Codecs, WRITE_ANEW};
use super::document::{Document, Fields};
use super::fill::fill_of;
use super::keys::Keys;
use super::layout::Layout;
use crate::element::{Element, Endian};
use crate::error::Result;
use serde_json::{Number, Value};

/// The layout that a `.zarray` tells.
pub(super) fn layout(document: &Document) -> Result<Layout> {
    let root = document.root();
    let version = root.needed("zarr_format")?;
    if version.as_u64() != Some(2) {
        return Err(root.damaged("zarr_format", "2", version));
    }
    let shape = root.lengths("shape")?;
    let chunks = root.lengths("chunks")?;
    let (element, endian) = element(&root)?;
    let is_c = root.one_of("order", &[("C", true), ("F", false)])?;
    let is_c = is_c.ok_or_else(|| root.damaged("order", "C or F", &Value::Null))?;
    let order: Vec<usize> = if is_c { (0..shape.len()).collect() } else { (0..shape.len()).rev().collect() };
    // Without a value, chunks never written hold anything; programs make them zeros.
    let zero = vec![0; element.bytes()];
    let fill = root.get("fill_value").map_or(Some(zero), |value| fill(element, value));
    let fill = fill.ok_or_else(|| {
        let expected = format!("a number of the type {element}");
        root.damaged("fill_value", &expected, root.get("fill_value").unwrap_or(&Value::Null))
    })?;
    let separator = root.one_of("dimension_separator", &[(".", '.'), ("/", '/')])?.unwrap_or('.');
    Ok(Layout {
        file_shape: chunks.clone(),
        chunk_shape: chunks,
        element,
        endian,
        fill,
        order,
        codecs: codecs(&root, element, endian)?,
        shard: None,
        keys: Keys { has_prefix: false, separator },
        dimension_names: vec![None; shape.len()],
        shape,
    })
}

/// The element of chunks never written. Writers in Java have numbers as texts: "0".
fn fill(element: Element, value: &Value) -> Option<Vec<u8>> {
    let number = value.as_str().and_then(|text| serde_json::from_str::<Number>(text).ok());
    number.map_or_else(|| fill_of(element, value), |number| fill_of(element, &Value::Number(number)))
}

/// Filters in their order, then the compressor.
fn codecs(root: &Fields<'_>, element: Element, endian: Endian) -> Result<Codecs> {
    let mut codecs = Vec::new();
    for (i, filter) in root.list("filters")?.iter().enumerate() {
        let named = root.identified(&format!("filters[{i}]"), filter)?;
        codecs.push(match named.name {
            "delta" => {
                let types = ["dtype", "astype"].map(|key| named.settings.get(key).and_then(Value::as_str));
                let is_known = types[0].and_then(number_type) == Some((element, endian));
                if !is_known || types[1].is_some_and(|coded| number_type(coded) != Some((element, endian))) {
                    let feature = "the filter \"delta\" into another type than the array's".to_owned();
                    return Err(root.unsupported(feature, WRITE_ANEW));
                }
                Codec::Delta(element, endian)
            }
            _ => Codec::of(&named)?,
        });
    }
    if let Some(compressor) = root.get("compressor") {
        codecs.push(Codec::of(&root.identified("compressor", compressor)?)?);
    }
    let count = codecs.len();
    Codecs::new(codecs).ok_or_else(|| root.unsupported(format!("an array of {count} filters"), WRITE_ANEW))
}

fn element(root: &Fields<'_>) -> Result<(Element, Endian)> {
    let dtype = root.needed("dtype")?;
    let advice = "booleans, integers of 8 to 64 bits and floats of 16 to 64 bits are read";
    match dtype {
        Value::String(text) => {
            number_type(text).ok_or_else(|| root.unsupported(format!("the type {text:?}{}", described(text)), advice))
        }
        Value::Array(_) => Err(root.unsupported("a type of several members".into(), advice)),
        other => Err(root.damaged("dtype", "a text", other)),
    }
}

/// A number's type and byte order, as NumPy writes them.
fn number_type(text: &str) -> Option<(Element, Endian)> {
    let (order, name) = text.split_at_checked(1)?;
    let element = match name {
        "b1" | "u1" => "u8",
        "i1" => "i8",
        "u2" => "u16",
        "i2" => "i16",
        "u4" => "u32",
        "i4" => "i32",
        "u8" => "u64",
        "i8" => "i64",
        "f2" => "f16",
        "f4" => "f32",
        "f8" => "f64",
        _ => return None,
    };
    let element: Element = element.parse().ok()?;
    match order {
        "<" => Some((element, Endian::Little)),
        ">" => Some((element, Endian::Big)),
        "|" if element.bytes() == 1 => Some((element, Endian::Little)),
        _ => None,
    }
}

/// Words for types that are no numbers.
fn described(text: &str) -> &'static str {
    match text.as_bytes().get(1) {
        Some(b'c') => " (complex numbers)",
        Some(b'm' | b'M') => " (times)",
        Some(b'S' | b'U') => " (texts)",
        Some(b'O') => " (objects)",
        Some(b'V') => " (raw bytes)",
        _ => "",
    }
}
