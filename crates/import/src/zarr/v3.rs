//! Documents of Zarr version 3: `zarr.json`.

use super::codecs::{Codec, Codecs, WRITE_ANEW};
use super::document::{Document, Fields, Named};
use super::fill::fill_of;
use super::keys::Keys;
use super::layout::{Layout, MOST_AXES};
use super::shard::Shard;
use crate::element::{Element, Endian};
use crate::error::Result;
use serde_json::Value;

/// Fields of nodes; others must be understood unless they say otherwise.
const KNOWN: [&str; 12] = [
    "zarr_format",
    "node_type",
    "attributes",
    "shape",
    "data_type",
    "chunk_grid",
    "chunk_key_encoding",
    "fill_value",
    "codecs",
    "storage_transformers",
    "dimension_names",
    "extensions",
];

const TYPES: [(&str, &str); 12] = [
    ("bool", "u8"),
    ("uint8", "u8"),
    ("int8", "i8"),
    ("uint16", "u16"),
    ("int16", "i16"),
    ("uint32", "u32"),
    ("int32", "i32"),
    ("uint64", "u64"),
    ("int64", "i64"),
    ("float16", "f16"),
    ("float32", "f32"),
    ("float64", "f64"),
];

/// Whether a document is an array's, not a group's.
pub(super) fn is_array(document: &Document) -> Result<bool> {
    let root = document.root();
    let version = root.needed("zarr_format")?;
    if version.as_u64() != Some(3) {
        return Err(root.damaged("zarr_format", "3", version));
    }
    let may_be_ignored = |value: &Value| value.get("must_understand") == Some(&Value::Bool(false));
    if let Some((key, _)) = root.keys().find(|(key, value)| !KNOWN.contains(&key.as_str()) && !may_be_ignored(value)) {
        return Err(root.unsupported(format!("the extension {key:?} of Zarr"), WRITE_ANEW));
    }
    root.needed("node_type")?;
    Ok(root.one_of("node_type", &[("array", true), ("group", false)])?.unwrap_or(false))
}

/// The layout that a `zarr.json` tells.
pub(super) fn layout(document: &Document) -> Result<Layout> {
    let root = document.root();
    let shape = root.lengths("shape")?;
    if shape.len() > MOST_AXES {
        return Err(root.unsupported(format!("an array of {} axes", shape.len()), WRITE_ANEW));
    }
    let element = element(&root)?;
    let fill = root.needed("fill_value")?;
    let expected = || format!("a number of the type {element}");
    let fill = fill_of(element, fill).ok_or_else(|| root.damaged("fill_value", &expected(), fill))?;
    if let Some(transformer) = root.list("storage_transformers")?.first() {
        let named = root.named("storage_transformers[0]", transformer)?;
        return Err(root.unsupported(format!("the storage transformer {:?}", named.name), WRITE_ANEW));
    }
    let chunks = chunks(&root, shape.len())?;
    let axes = (0..shape.len()).collect();
    let coded = Coded { element, shape: chunks.clone(), axes, shard: None };
    let Pieces { coded, endian, codecs } = coded.undo(&root)?;
    Ok(Layout {
        file_shape: chunks,
        chunk_shape: coded.shape,
        element,
        endian,
        fill,
        order: coded.axes,
        codecs,
        shard: coded.shard,
        keys: keys(&root)?,
        dimension_names: dimension_names(&root, shape.len())?,
        shape,
    })
}

fn element(root: &Fields<'_>) -> Result<Element> {
    let named = root.named("data_type", root.needed("data_type")?)?;
    let known = TYPES.iter().find(|(name, _)| *name == named.name).and_then(|(_, element)| element.parse().ok());
    let advice = "booleans, integers of 8 to 64 bits and floats of 16 to 64 bits are read";
    known.ok_or_else(|| root.unsupported(format!("the type {:?}", named.name), advice))
}

fn chunks(root: &Fields<'_>, axes: usize) -> Result<Vec<u64>> {
    let grid = root.named("chunk_grid", root.needed("chunk_grid")?)?;
    match grid.name {
        "regular" => lengths(&grid.settings, axes),
        other => Err(root.unsupported(format!("the chunk grid {other:?}"), "write the array anew with equal chunks")),
    }
}

/// The field `chunk_shape`, of so many axes.
fn lengths(settings: &Fields<'_>, axes: usize) -> Result<Vec<u64>> {
    let lengths = settings.lengths("chunk_shape")?;
    match lengths.len() == axes {
        true => Ok(lengths),
        false => {
            let expected = format!("{axes} lengths, as the array has axes");
            Err(settings.damaged("chunk_shape", &expected, settings.needed("chunk_shape")?))
        }
    }
}

fn keys(root: &Fields<'_>) -> Result<Keys> {
    let encoding = root.named("chunk_key_encoding", root.needed("chunk_key_encoding")?)?;
    let (has_prefix, usual) = match encoding.name {
        "default" => (true, '/'),
        "v2" => (false, '.'),
        other => return Err(root.unsupported(format!("the chunk key encoding {other:?}"), WRITE_ANEW)),
    };
    let separator = encoding.settings.one_of("separator", &[(".", '.'), ("/", '/')])?.unwrap_or(usual);
    Ok(Keys { has_prefix, separator })
}

fn dimension_names(root: &Fields<'_>, axes: usize) -> Result<Vec<Option<String>>> {
    let Some(value) = root.get("dimension_names") else { return Ok(vec![None; axes]) };
    let name = |value: &Value| match value {
        Value::Null => Some(None),
        Value::String(name) => Some(Some(name.clone())),
        _ => None,
    };
    let names: Option<Vec<_>> = value.as_array().and_then(|list| list.iter().map(name).collect());
    let names = names.filter(|names| names.len() == axes);
    names.ok_or_else(|| root.damaged("dimension_names", &format!("{axes} names"), value))
}

/// A piece of an array, as far as its codecs are known.
struct Coded {
    element: Element,
    /// Elements along the array's own axes.
    shape: Vec<u64>,
    /// The array's axes in the present order, slowest first.
    axes: Vec<usize>,
    shard: Option<Shard>,
}

/// The smallest pieces decoded alone.
struct Pieces {
    coded: Coded,
    endian: Endian,
    codecs: Codecs,
}

impl Coded {
    /// Follows a list of codecs: from arrays to arrays, one to bytes, from bytes to bytes.
    fn undo(mut self, fields: &Fields<'_>) -> Result<Pieces> {
        let list = fields.list("codecs")?;
        let named: Vec<Named<'_>> = list
            .iter()
            .enumerate()
            .map(|(i, value)| fields.named(&format!("codecs[{i}]"), value))
            .collect::<Result<_>>()?;
        let first = named.iter().position(|codec| codec.name != "transpose").unwrap_or(named.len());
        let (before, rest) = named.split_at(first);
        for transpose in before {
            self.transpose(transpose)?;
        }
        let Some((to_bytes, after)) = rest.split_first() else {
            return Err(fields.damaged("codecs", "a codec from elements to bytes", &Value::Array(list.to_vec())));
        };
        match to_bytes.name {
            "bytes" => {
                let endian = endian(to_bytes, self.element.bytes())?;
                let codecs = after.iter().map(Codec::of).collect::<Result<Vec<_>>>()?;
                let codecs = Codecs::new(codecs);
                let codecs = codecs.ok_or_else(|| fields.unsupported("so long a list of codecs".into(), WRITE_ANEW))?;
                Ok(Pieces { coded: self, endian, codecs })
            }
            "sharding_indexed" => match after.first() {
                None => self.inner(to_bytes),
                Some(codec) => {
                    let feature = format!("the codec {:?} of whole shards", codec.name);
                    Err(fields.unsupported(feature, "write the array anew with codecs inside the shards"))
                }
            },
            other => Err(fields.unsupported(format!("the codec {other:?}"), WRITE_ANEW)),
        }
    }

    fn transpose(&mut self, codec: &Named<'_>) -> Result<()> {
        let value = codec.settings.needed("order")?;
        let axes = self.axes.len();
        let order: Option<Vec<usize>> = match value {
            // Texts of drafts.
            Value::String(order) if order == "C" => Some((0..axes).collect()),
            Value::String(order) if order == "F" => Some((0..axes).rev().collect()),
            Value::Array(list) => list.iter().map(|n| n.as_u64().map(|n| n as usize)).collect(),
            _ => None,
        };
        let is_permutation = |order: &Vec<usize>| order.len() == axes && (0..axes).all(|axis| order.contains(&axis));
        let order = order.filter(is_permutation);
        let order = order.ok_or_else(|| codec.settings.damaged("order", "a permutation of the axes", value))?;
        self.axes = order.into_iter().map(|axis| self.axes[axis]).collect();
        Ok(())
    }

    /// Follows the codecs of inner chunks.
    fn inner(mut self, codec: &Named<'_>) -> Result<Pieces> {
        let settings = &codec.settings;
        if self.shard.is_some() {
            let advice = "write the array anew with one level of shards";
            return Err(settings.unsupported("a shard inside a shard".into(), advice));
        }
        let inner = lengths(settings, self.axes.len())?;
        for (axis, length) in self.axes.iter().zip(inner) {
            self.shape[*axis] = length;
        }
        let locations = [("start", true), ("end", false)];
        let is_at_start = settings.one_of("index_location", &locations)?.unwrap_or(false);
        let (endian, has_checksum) = index_codecs(settings)?;
        self.shard = Some(Shard { order: self.axes.clone(), is_at_start, endian, has_checksum });
        self.undo(settings)
    }
}

/// Byte order of an index, and whether it has a checksum.
fn index_codecs(settings: &Fields<'_>) -> Result<(Endian, bool)> {
    let list = settings.list("index_codecs")?;
    let mut named = Vec::new();
    for (i, value) in list.iter().enumerate() {
        named.push(settings.named(&format!("index_codecs[{i}]"), value)?);
    }
    let names: Vec<&str> = named.iter().map(|codec| codec.name).collect();
    match names[..] {
        ["bytes"] => Ok((endian(&named[0], 8)?, false)),
        ["bytes", "crc32c"] => Ok((endian(&named[0], 8)?, true)),
        _ => {
            let feature = format!("an index of shards by the codecs {names:?}");
            Err(settings.unsupported(feature, "write the array anew with \"bytes\" and \"crc32c\""))
        }
    }
}

/// Byte order by the codec `bytes`, which single bytes may leave out.
fn endian(codec: &Named<'_>, element_bytes: usize) -> Result<Endian> {
    let orders = [("little", Endian::Little), ("big", Endian::Big)];
    match codec.settings.one_of("endian", &orders)? {
        Some(endian) => Ok(endian),
        None if element_bytes == 1 => Ok(Endian::Little),
        None => codec.settings.needed("endian").map(|_| Endian::Little),
    }
}
