//! Arrays written byte by byte as the specifications say, and read again in random boxes; damaged ones.

use super::*;
use crate::testing::{Damage, alone_with, cases, memory_taken, some_damage, spoil};
use crate::zarr::node::{Node, open_node};
use proptest::prelude::*;
use serde_json::json;
use std::io::Write;
use tempfile::TempDir;

/// An array to be written.
#[derive(Clone, Debug)]
struct Made {
    is_v3: bool,
    shape: Vec<u64>,
    /// Elements of an inner chunk, and inner chunks along each axis of a shard; all ones without shards.
    chunk: Vec<u64>,
    per_shard: Vec<u64>,
    is_sharded: bool,
    index_at_start: bool,
    index_is_checked: bool,
    /// The array's axes as a chunk has them, slowest first.
    order: Vec<usize>,
    element: &'static str,
    is_big: bool,
    separator: char,
    codecs: Vec<&'static str>,
}

const TYPES: [(&str, &str, &str); 11] = [
    ("uint8", "u1", "u8"),
    ("int8", "i1", "i8"),
    ("uint16", "u2", "u16"),
    ("int16", "i2", "i16"),
    ("uint32", "u4", "u32"),
    ("int32", "i4", "i32"),
    ("uint64", "u8", "u64"),
    ("int64", "i8", "i64"),
    ("float16", "f2", "f16"),
    ("float32", "f4", "f32"),
    ("float64", "f8", "f64"),
];

impl Made {
    fn usual(is_v3: bool) -> Self {
        Self {
            is_v3,
            shape: vec![5, 4, 7],
            chunk: vec![2, 3, 4],
            per_shard: vec![1; 3],
            is_sharded: false,
            index_at_start: false,
            index_is_checked: true,
            order: vec![0, 1, 2],
            element: "uint16",
            is_big: false,
            separator: '/',
            codecs: vec![],
        }
    }

    fn sharded() -> Self {
        Self { per_shard: vec![2, 1, 2], is_sharded: true, codecs: vec!["zstd", "crc32c"], ..Self::usual(true) }
    }

    fn element_bytes(&self) -> usize {
        self.names().2.parse::<Element>().unwrap().bytes()
    }

    fn names(&self) -> (&str, &str, &str) {
        *TYPES.iter().find(|(name, ..)| *name == self.element).unwrap()
    }

    /// The little-endian element at a place: a hash of it.
    fn at(&self, place: &[u64]) -> Vec<u8> {
        let hash = place.iter().fold(7u64, |hash, n| (hash ^ n).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
        hash.to_le_bytes()[..self.element_bytes()].to_vec()
    }

    /// Chunks never written.
    fn is_gap(&self, chunk: &[u64]) -> bool {
        chunk.iter().fold(1, |sum, n| sum * 3 + n) % 5 == 3
    }

    fn places(shape: &[u64]) -> Vec<Vec<u64>> {
        shape.iter().fold(vec![vec![]], |places, n| {
            places.iter().flat_map(|place| (0..*n).map(|i| [&place[..], &[i]].concat())).collect()
        })
    }

    /// A chunk's bytes, coded; `None` if it is a gap.
    fn coded(&self, chunk: &[u64]) -> Option<Vec<u8>> {
        if self.is_gap(chunk) {
            return None;
        }
        let ordered: Vec<u64> = self.order.iter().map(|axis| self.chunk[*axis]).collect();
        let mut bytes = Vec::new();
        for place in Self::places(&ordered) {
            let mut at: Vec<u64> = chunk.iter().zip(&self.chunk).map(|(at, n)| at * n).collect();
            for (n, axis) in place.iter().zip(&self.order) {
                at[*axis] += n;
            }
            let mut element = self.at(&at);
            if self.is_big {
                element.reverse();
            }
            bytes.extend(element);
        }
        Some(self.codecs.iter().fold(bytes, |bytes, codec| coded(codec, &bytes, self.element_bytes())))
    }

    fn files(&self) -> Vec<(Vec<u64>, Vec<u8>)> {
        let grid: Vec<u64> =
            (0..self.shape.len()).map(|a| self.shape[a].div_ceil(self.chunk[a] * self.per_shard[a])).collect();
        let mut files = Vec::new();
        for file in Self::places(&grid) {
            if !self.is_sharded {
                files.extend(self.coded(&file).map(|bytes| (file, bytes)));
                continue;
            }
            let ordered: Vec<u64> = self.order.iter().map(|axis| self.per_shard[*axis]).collect();
            let inner = Self::places(&ordered);
            let index_bytes = inner.len() * 16 + if self.index_is_checked { 4 } else { 0 };
            let (mut body, mut index) = (Vec::new(), Vec::new());
            for place in inner {
                let mut chunk: Vec<u64> = file.iter().zip(&self.per_shard).map(|(at, n)| at * n).collect();
                for (n, axis) in place.iter().zip(&self.order) {
                    chunk[*axis] += n;
                }
                match self.coded(&chunk) {
                    None => index.extend([255; 16]),
                    Some(bytes) => {
                        let start = body.len() + if self.index_at_start { index_bytes } else { 0 };
                        index.extend([start, bytes.len()].map(|n| (n as u64).to_le_bytes()).concat());
                        body.extend(bytes);
                    }
                }
            }
            if self.index_is_checked {
                let crc = crc32c::crc32c(&index);
                index.extend(crc.to_le_bytes());
            }
            files.push((file, if self.index_at_start { [index, body] } else { [body, index] }.concat()));
        }
        files
    }

    fn document(&self) -> Value {
        let (name, numpy, _) = self.names();
        let file: Vec<u64> = self.chunk.iter().zip(&self.per_shard).map(|(chunk, n)| chunk * n).collect();
        if !self.is_v3 {
            let (compressor, filters) = match self.codecs[..] {
                [] => (Value::Null, Value::Null),
                [.., last] => {
                    let of = |codec: &str| json!({ "id": codec, "elementsize": self.element_bytes() });
                    (of(last), self.codecs.iter().rev().skip(1).rev().map(|codec| of(codec)).collect())
                }
            };
            return json!({
                "zarr_format": 2, "shape": self.shape, "chunks": file, "fill_value": 0, "filters": filters,
                "dtype": format!("{}{numpy}", match self.element_bytes() { 1 => '|', _ if self.is_big => '>', _ => '<' }),
                "order": if self.order.is_sorted() { "C" } else { "F" },
                "compressor": compressor, "dimension_separator": self.separator,
            });
        }
        let endian =
            json!({ "name": "bytes", "configuration": { "endian": if self.is_big { "big" } else { "little" } } });
        let mut codecs = vec![endian];
        codecs.extend(self.codecs.iter().map(|codec| match *codec {
            "shuffle" => {
                json!({ "name": "numcodecs.shuffle", "configuration": { "elementsize": self.element_bytes() } })
            }
            "lz4" | "zlib" => json!({ "name": format!("numcodecs.{codec}"), "configuration": {} }),
            codec => json!({ "name": codec }),
        }));
        if self.is_sharded {
            // The transposition is outside, so that the inner shape is turned too.
            let chunk_shape: Vec<u64> = self.order.iter().map(|axis| self.chunk[*axis]).collect();
            let mut index_codecs = vec![json!({ "name": "bytes", "configuration": { "endian": "little" } })];
            index_codecs.extend(self.index_is_checked.then(|| json!("crc32c")));
            let location = if self.index_at_start { "start" } else { "end" };
            codecs = vec![json!({ "name": "sharding_indexed", "configuration": {
                "chunk_shape": chunk_shape, "codecs": codecs, "index_codecs": index_codecs, "index_location": location,
            } })];
        }
        codecs.insert(0, json!({ "name": "transpose", "configuration": { "order": self.order } }));
        json!({
            "zarr_format": 3, "node_type": "array", "shape": self.shape, "data_type": name, "fill_value": 0,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": file } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": self.separator } },
            "codecs": codecs, "attributes": { "a": 1 }, "dimension_names": vec![Value::Null; self.shape.len()],
        })
    }

    fn write(&self) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let name = if self.is_v3 { "zarr.json" } else { ".zarray" };
        std::fs::write(folder.path().join(name), self.document().to_string()).unwrap();
        for (place, bytes) in self.files() {
            let path = self.path(folder.path(), &place);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
        folder
    }

    fn path(&self, folder: &Path, place: &[u64]) -> PathBuf {
        let mut parts: Vec<String> = place.iter().map(u64::to_string).collect();
        if self.is_v3 {
            parts.insert(0, "c".into());
        } else if parts.is_empty() {
            parts.push("0".into());
        }
        folder.join(parts.join(&self.separator.to_string()))
    }

    fn expected(&self, start: &[u64], shape: &[u64]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for place in Self::places(shape) {
            let at: Vec<u64> = place.iter().zip(start).map(|(n, start)| n + start).collect();
            let chunk: Vec<u64> = at.iter().zip(&self.chunk).map(|(at, n)| at / n).collect();
            bytes.extend(if self.is_gap(&chunk) { vec![0; self.element_bytes()] } else { self.at(&at) });
        }
        bytes
    }
}

/// Codes bytes as version 2 and 3 name it.
fn coded(codec: &str, plain: &[u8], element_bytes: usize) -> Vec<u8> {
    match codec {
        "gzip" => {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(plain).unwrap();
            encoder.finish().unwrap()
        }
        "zlib" => {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(plain).unwrap();
            encoder.finish().unwrap()
        }
        "zstd" => zstd::bulk::compress(plain, 1).unwrap(),
        "lz4" => [&(plain.len() as u32).to_le_bytes()[..], &lz4_flex::block::compress(plain)].concat(),
        "crc32c" => [plain, &crc32c::crc32c(plain).to_le_bytes()].concat(),
        "shuffle" => {
            let mut out = vec![0; plain.len()];
            crate::blosc::shuffle(element_bytes, plain, &mut out);
            out
        }
        other => panic!("{other}"),
    }
}

fn open(folder: &Path) -> Result<Array> {
    match open_node(folder)? {
        Some(Node::Array(array)) => Ok(array),
        other => panic!("{other:?}"),
    }
}

fn read(array: &Array, start: &[u64], shape: &[u64]) -> Result<Vec<u8>> {
    let mut out = vec![0xa5; shape.iter().product::<u64>() as usize * array.element().bytes()];
    array.read(start, shape, &mut out).map(|()| out)
}

fn some_array() -> impl Strategy<Value = Made> {
    let axis = (1u64..7, 1u64..4, 1u64..3);
    let codecs = prop::sample::subsequence(vec!["shuffle", "gzip", "zlib", "zstd", "lz4", "crc32c"], 0..3);
    let axes = prop::collection::vec(axis, 0..5).prop_flat_map(|axes| {
        let order = Just((0..axes.len()).collect::<Vec<_>>()).prop_shuffle();
        (Just(axes), order)
    });
    let element = prop::sample::select(TYPES.map(|(name, ..)| name).to_vec());
    let separator = prop::sample::select(vec!['.', '/']);
    (axes, any::<[bool; 5]>(), element, separator, codecs).prop_map(
        |((axes, order), flags, element, separator, codecs)| {
            let [is_v3, is_sharded, index_at_start, index_is_checked, is_big] = flags;
            let is_sharded = is_v3 && is_sharded;
            let order = match is_v3 {
                true => order,
                false if index_at_start => (0..axes.len()).collect(),
                false => (0..axes.len()).rev().collect(),
            };
            Made {
                is_v3,
                shape: axes.iter().map(|axis| axis.0).collect(),
                chunk: axes.iter().map(|axis| axis.1).collect(),
                per_shard: axes.iter().map(|axis| if is_sharded { axis.2 } else { 1 }).collect(),
                is_sharded,
                index_at_start,
                index_is_checked,
                order,
                element,
                is_big: is_big && !element.ends_with("t8"),
                separator,
                codecs,
            }
        },
    )
}

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn boxes_of_any_array_are_its_elements(
        made in some_array(),
        corners in prop::collection::vec(any::<[prop::sample::Index; 2]>(), 5),
    ) {
        let folder = made.write();
        let array = open(folder.path()).unwrap();
        prop_assert_eq!((array.shape(), array.chunk_shape()), (&made.shape[..], &made.chunk[..]));
        prop_assert_eq!(array.element(), made.names().2.parse().unwrap());
        let has_chunks = Made::places(&array.layout.grid()).iter().any(|file| made.path(folder.path(), file).exists());
        prop_assert_eq!(array.has_any_chunk().unwrap(), has_chunks);
        let zeros = vec![0; made.shape.len()];
        prop_assert_eq!(read(&array, &zeros, &made.shape).unwrap(), made.expected(&zeros, &made.shape));
        let (mut start, mut shape) = (vec![], vec![]);
        for (corner, size) in corners.iter().zip(&made.shape) {
            let mut ends = [corner[0].index(*size as usize + 1), corner[1].index(*size as usize + 1)];
            ends.sort();
            start.push(ends[0] as u64);
            shape.push((ends[1] - ends[0]) as u64);
        }
        prop_assert_eq!(read(&array, &start, &shape).unwrap(), made.expected(&start, &shape));
        // A single chunk, in place.
        let array = open(folder.path()).unwrap();
        if made.chunk.iter().zip(&made.shape).all(|(chunk, size)| chunk <= size) {
            prop_assert_eq!(read(&array, &zeros, &made.chunk).unwrap(), made.expected(&zeros, &made.chunk));
        }
    }

    /// Damage leads to an error or other elements, never to a panic, nor to memory beyond the array's word.
    #[test]
    fn damaged_arrays_do_not_panic(
        made in some_array(),
        damage in some_damage(),
        text in prop_oneof![
            Just(None),
            (any::<prop::sample::Index>(), damage_of_text()).prop_map(Some),
        ],
        of_document in any::<bool>(),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let folder = made.write();
        let document = folder.path().join(if made.is_v3 { "zarr.json" } else { ".zarray" });
        let chunks: Vec<_> = made.files().into_iter().map(|(place, _)| made.path(folder.path(), &place)).collect();
        let path = if of_document || chunks.is_empty() { document } else { chunks[0].clone() };
        let mut bytes = std::fs::read(&path).unwrap();
        match text.filter(|_| of_document) {
            Some((_, damage)) => spoil(&mut bytes, &damage),
            None => spoil(&mut bytes, &damage),
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        std::fs::write(&path, bytes).unwrap();
        try_to_read(folder.path());
    }

    /// A value of a document becomes another.
    #[test]
    fn changed_documents_do_not_panic(made in some_array(), place in any::<prop::sample::Index>(), value in some_value()) {
        let folder = made.write();
        let mut document = made.document();
        let mut places = pointers(&document);
        let pointer = places.swap_remove(place.index(places.len()));
        *document.pointer_mut(&pointer).unwrap() = value;
        let name = if made.is_v3 { "zarr.json" } else { ".zarray" };
        std::fs::write(folder.path().join(name), document.to_string()).unwrap();
        try_to_read(folder.path());
    }
}

/// Reads all of a small array.
fn try_to_read(folder: &Path) {
    let Ok(Some(Node::Array(array))) = open_node(folder) else { return };
    let _ = array.has_any_chunk();
    let elements = product(array.shape()).filter(|n| *n < 1 << 20);
    if elements.is_some() && array.reader_bytes() + array.held_bytes() < 1 << 28 {
        let _ = read(&array, &vec![0; array.shape().len()], array.shape());
    }
}

fn some_value() -> impl Strategy<Value = Value> {
    let numbers = [0, 1, 2, 3, 1 << 20, 1 << 40, u64::MAX];
    prop_oneof![
        prop::sample::select(numbers.map(|n| json!(n)).to_vec()),
        prop::sample::select(numbers.map(|n| json!([n, n])).to_vec()),
        prop::sample::select(vec![
            json!(-1),
            json!(1e300),
            json!(null),
            json!({}),
            json!([]),
            json!(true),
            json!("zstd")
        ]),
        prop::sample::select(vec![json!("F"), json!("NaN"), json!("|u1"), json!("uint8"), json!({ "id": "delta" })]),
    ]
}

/// Places of all values in a document.
fn pointers(value: &Value) -> Vec<String> {
    let below = |key: String, value: &Value| pointers(value).into_iter().map(move |place| format!("/{key}{place}"));
    let inner: Vec<String> = match value {
        Value::Object(map) => map.iter().flat_map(|(key, value)| below(key.clone(), value)).collect(),
        Value::Array(list) => list.iter().enumerate().flat_map(|(i, value)| below(i.to_string(), value)).collect(),
        _ => vec![],
    };
    [vec![String::new()], inner].concat()
}

/// Changes of text, mostly to letters that have a meaning in it.
fn damage_of_text() -> impl Strategy<Value = Damage> {
    let letter = prop_oneof![any::<u8>(), prop::sample::select(&b"0123456789-.,eE[]{}\":"[..])];
    prop::collection::vec((any::<prop::sample::Index>(), letter), 1..6)
}

/// Writes an array with other documents, and gives the error of opening it.
fn refusal(made: &Made, change: impl FnOnce(&mut Value)) -> String {
    let folder = made.write();
    let mut document = made.document();
    change(&mut document);
    let name = if made.is_v3 { "zarr.json" } else { ".zarray" };
    std::fs::write(folder.path().join(name), document.to_string()).unwrap();
    let message = open(folder.path()).unwrap_err().to_string();
    assert!(message.contains(&format!("{name}: ")), "{message}");
    message
}

#[test]
fn unsupported_features_are_named() {
    let v2 = |key: &'static str, value: Value| refusal(&Made::usual(false), |document| document[key] = value);
    let v3 = |key: &'static str, value: Value| refusal(&Made::usual(true), |document| document[key] = value);
    let cases = [
        (v2("dtype", json!("<c8")), "the type \"<c8\" (complex numbers) is not supported; booleans"),
        (v2("dtype", json!("<M8[ns]")), "the type \"<M8[ns]\" (times)"),
        (v2("dtype", json!([["a", "<u2"]])), "a type of several members"),
        (v2("dtype", json!(2)), "dtype: expected a text, found 2"),
        (v2("compressor", json!({ "id": "zfpy" })), "the codec \"zfpy\" is not supported"),
        (v2("compressor", json!({ "id": "blosc", "cname": "snappy" })), "Blosc with Snappy"),
        (v2("compressor", json!({ "id": "blosc", "cname": "z" })), "compressor.cname: expected \"blosclz\" or"),
        (v2("compressor", json!("zlib")), "compressor: expected an object"),
        (v2("filters", json!([{ "id": "fixedscaleoffset" }])), "the codec \"fixedscaleoffset\""),
        (v2("filters", json!([{ "id": "delta", "dtype": "<i4" }])), "the filter \"delta\" into another type"),
        (v2("fill_value", json!(-1)), "fill_value: expected a number of the type u16, found -1"),
        (v2("fill_value", json!("seven")), "fill_value: expected a number of the type u16, found \"seven\""),
        (v2("order", json!("A")), "order: expected \"C\" or \"F\""),
        (v2("shape", json!([1, -1])), "shape: expected a list of lengths"),
        (v2("chunks", json!([1, 1])), "expected chunks of 3 axes as the array has, found 2"),
        (v2("chunks", json!([1, 0, 1])), "found the shape [1, 0, 1]"),
        (v2("chunks", json!([1 << 30, 1 << 30, 1])), "larger than any memory"),
        (v2("shape", json!([1u64 << 40, 1u64 << 40, 1])), "larger than any disk"),
        (v2("zarr_format", json!(1)), "zarr_format: expected 2, found 1"),
        (v3("data_type", json!("complex64")), "the type \"complex64\""),
        (v3("data_type", json!({ "name": "numpy.datetime64", "configuration": {} })), "\"numpy.datetime64\""),
        (v3("chunk_grid", json!({ "name": "rectilinear" })), "the chunk grid \"rectilinear\""),
        (v3("chunk_grid", json!("regular")), "chunk_grid.chunk_shape is missing"),
        (v3("chunk_key_encoding", json!({ "name": "x" })), "the chunk key encoding \"x\""),
        (v3("fill_value", Value::Null), "fill_value is missing"),
        (v3("codecs", json!([{ "name": "bytes", "configuration": { "endian": "little" } }, "zfp"])), "codec \"zfp\""),
        (v3("codecs", json!(["bytes"])), "codecs[0].endian is missing"),
        (v3("codecs", json!([])), "codecs: expected a codec from elements to bytes"),
        (v3("codecs", json!(["zstd", "bytes"])), "the codec \"zstd\""),
        (v3("codecs", json!([{ "name": "transpose", "configuration": { "order": [0, 0, 1] } }])), "a permutation"),
        (v3("storage_transformers", json!([{ "name": "x" }])), "the storage transformer \"x\""),
        (v3("new", json!({ "must_understand": true })), "the extension \"new\""),
        (v3("new", json!(1)), "the extension \"new\""),
        (v3("dimension_names", json!(["a"])), "dimension_names: expected 3 names"),
        (v3("node_type", json!("x")), "node_type: expected \"array\" or \"group\""),
        (v3("attributes", json!([])), "attributes: expected an object"),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message}\nlacks {expected}");
    }
    let sharded = |change: fn(&mut Value)| refusal(&Made::sharded(), |document| change(&mut document["codecs"][1]));
    let cases = [
        (sharded(|codec| codec["configuration"]["chunk_shape"] = json!([2, 2, 4])), "expected shards of whole chunks"),
        (sharded(|codec| codec["configuration"]["index_codecs"] = json!(["gzip"])), "an index of shards by"),
        (sharded(|codec| codec["configuration"]["codecs"] = json!([codec])), "a shard inside a shard"),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message}\nlacks {expected}");
    }
    let grid = refusal(&Made::sharded(), |document| {
        document["chunk_grid"]["configuration"]["chunk_shape"] = json!([]);
    });
    assert!(grid.contains("chunk_grid.configuration.chunk_shape: expected 3 lengths"), "{grid}");
    let whole = refusal(&Made::sharded(), |document| document["codecs"].as_array_mut().unwrap().push(json!("gzip")));
    assert!(whole.contains("the codec \"gzip\" of whole shards"), "{whole}");
}

#[test]
fn extensions_that_may_be_ignored_are() {
    let folder = Made::usual(true).write();
    let mut document = Made::usual(true).document();
    document["new"] = json!({ "must_understand": false });
    document["consolidated_metadata"] = json!({ "kind": "inline" });
    std::fs::write(folder.path().join("zarr.json"), document.to_string()).unwrap();
    assert!(open(folder.path()).is_ok());
}

#[test]
fn texts_and_short_forms_of_drafts_are_read() {
    let made = Made { order: vec![2, 1, 0], element: "uint8", separator: '.', ..Made::usual(true) };
    let folder = made.write();
    let mut document = made.document();
    document["codecs"] = json!([{ "name": "transpose", "configuration": { "order": "F" } }, "bytes"]);
    document["data_type"] = json!({ "name": "uint8" });
    std::fs::write(folder.path().join("zarr.json"), document.to_string()).unwrap();
    let array = open(folder.path()).unwrap();
    assert_eq!(read(&array, &[0; 3], &made.shape).unwrap(), made.expected(&[0; 3], &made.shape));
}

#[test]
fn fill_values_stand_for_missing_chunks() {
    for (is_v3, fill, expected) in
        [(false, json!(513), 513u16), (false, json!("7"), 7), (false, Value::Null, 0), (true, json!(65535), 65535)]
    {
        let made = Made::usual(is_v3);
        let folder = tempfile::tempdir().unwrap();
        let mut document = made.document();
        document["fill_value"] = fill;
        let name = if is_v3 { "zarr.json" } else { ".zarray" };
        std::fs::write(folder.path().join(name), document.to_string()).unwrap();
        let array = open(folder.path()).unwrap();
        assert!(!array.has_any_chunk().unwrap());
        assert_eq!(read(&array, &[1, 0, 0], &[4, 4, 7]).unwrap(), expected.to_le_bytes().repeat(112));
        assert_eq!(read(&array, &[2, 0, 0], &[2, 3, 4]).unwrap(), expected.to_le_bytes().repeat(24), "one chunk");
    }
}

#[test]
fn version_3_wins_and_groups_have_attributes() {
    let folder = Made::usual(true).write();
    std::fs::write(folder.path().join(".zarray"), b"{}").unwrap();
    let array = open(folder.path()).unwrap();
    assert_eq!((array.version(), array.attributes()["a"].as_u64()), (ZarrVersion::V3, Some(1)));
    let folder = tempfile::tempdir().unwrap();
    assert!(open_node(folder.path()).unwrap().is_none());
    assert!(open_node(&folder.path().join("none")).unwrap().is_none());
    std::fs::write(folder.path().join(".zgroup"), br#"{"zarr_format": 2}"#).unwrap();
    std::fs::write(folder.path().join(".zattrs"), br#"{"missing_value": NaN}"#).unwrap();
    let Some(Node::Group(group)) = open_node(folder.path()).unwrap() else { panic!() };
    assert_eq!((group.version(), group.path()), (ZarrVersion::V2, folder.path()));
    assert_eq!(group.attributes()["missing_value"], "NaN");
    std::fs::write(folder.path().join("zarr.json"), br#"{"zarr_format": 3, "node_type": "group"}"#).unwrap();
    let Some(Node::Group(group)) = open_node(folder.path()).unwrap() else { panic!() };
    assert_eq!((group.version(), group.attributes().len()), (ZarrVersion::V3, 0));
    std::fs::write(folder.path().join("zarr.json"), b"").unwrap();
    assert!(open_node(folder.path()).unwrap_err().to_string().contains("is no JSON object"));
}

#[test]
fn axes_have_the_names_of_xarray() {
    let made = Made::usual(false);
    let folder = made.write();
    std::fs::write(folder.path().join(".zattrs"), br#"{"_ARRAY_DIMENSIONS": ["z", "y", "x"]}"#).unwrap();
    let names = ["z", "y", "x"].map(|name| Some(name.to_owned()));
    assert_eq!(open(folder.path()).unwrap().dimension_names(), names);
}

/// The error of reading an array of which one chunk was changed.
fn damaged(made: &Made, change: impl FnOnce(&mut Vec<u8>)) -> String {
    let folder = made.write();
    let path = made.path(folder.path(), &[0, 0, 0]);
    let mut bytes = std::fs::read(&path).unwrap();
    change(&mut bytes);
    std::fs::write(&path, bytes).unwrap();
    let message = read(&open(folder.path()).unwrap(), &[0; 3], &made.shape).unwrap_err().to_string();
    assert!(message.contains(&format!("{}: ", path.display())) && message.contains("fetch or write"), "{message}");
    message
}

#[test]
fn damaged_chunks_are_named() {
    let plain = Made::usual(true);
    let said = damaged(&plain, |bytes| bytes.truncate(47));
    assert!(said.contains("expected 48 bytes of a chunk at 0, found 47"), "{said}");
    assert!(damaged(&plain, |bytes| bytes.push(0)).contains("found 49"));
    assert!(damaged(&plain, Vec::clear).contains("found 0"));
    let gzip = Made { codecs: vec!["gzip"], ..plain.clone() };
    assert!(damaged(&gzip, |bytes| bytes.truncate(20)).contains("damaged gzip data"));
    assert!(damaged(&gzip, |bytes| bytes.resize(1 << 20, 0)).contains("found 1048576"), "too long for its chunk");
    let longer = Made { codecs: vec!["zstd"], ..plain.clone() };
    let of_more = zstd::bulk::compress(&[0; 49], 1).unwrap();
    assert!(damaged(&longer, |bytes| *bytes = of_more).contains("more than expected"));
    let of_fewer = zstd::bulk::compress(&[0; 47], 1).unwrap();
    assert!(damaged(&longer, |bytes| *bytes = of_fewer).contains("expected 48 bytes decoded, found 47"));
    let shard = Made::sharded();
    assert!(damaged(&shard, |bytes| bytes.truncate(10)).contains("cut short: expected an index of 68 bytes, found 10"));
    assert!(
        damaged(&shard, |bytes| *bytes.last_mut().unwrap() ^= 1).contains("the shard's index: damaged: its crc32c")
    );
    assert!(damaged(&shard, |bytes| bytes[9] ^= 1).contains("crc32c"));
    let unchecked = Made { index_is_checked: false, ..shard };
    let beyond = damaged(&unchecked, |bytes| {
        let entry = bytes.len() - 64;
        bytes[entry + 2] = 1;
    });
    assert!(beyond.contains("cut short: a chunk lies at 65536"), "{beyond}");
}

#[test]
fn a_changed_array_is_an_error() {
    let made = Made::usual(false);
    let folder = made.write();
    let array = open(folder.path()).unwrap();
    std::fs::write(folder.path().join(".zarray"), b"{}").unwrap();
    assert!(read(&array, &[0; 3], &made.shape).unwrap_err().to_string().contains(".zarray: changed"));
    let array = {
        std::fs::write(folder.path().join(".zarray"), made.document().to_string()).unwrap();
        open(folder.path()).unwrap()
    };
    std::fs::remove_dir_all(folder.path()).unwrap();
    assert!(read(&array, &[0; 3], &made.shape).is_err());
}

#[test]
fn a_folder_in_place_of_a_chunk_is_an_error() {
    let made = Made { separator: '.', ..Made::usual(false) };
    let folder = made.write();
    let path = made.path(folder.path(), &[0; 3]);
    std::fs::remove_file(&path).unwrap();
    std::fs::create_dir(&path).unwrap();
    let message = read(&open(folder.path()).unwrap(), &[0; 3], &[1; 3]).unwrap_err().to_string();
    assert!(message.contains("expected a chunk's file"), "{message}");
}

/// A thread takes no more than the array says, whatever the codecs.
#[test]
fn memory_is_as_told() {
    let write = |folder: &Path| {
        let made = Made {
            shape: vec![4, 1024, 1024],
            chunk: vec![4, 1024, 1024],
            codecs: vec!["shuffle", "zstd", "gzip"],
            ..Made::usual(false)
        };
        std::fs::create_dir(folder).unwrap();
        std::fs::write(folder.join(".zarray"), made.document().to_string()).unwrap();
        let plain: Vec<u8> = (0..8u64 << 20).map(|i| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8).collect();
        let bytes = made.codecs.iter().fold(plain, |bytes, codec| coded(codec, &bytes, 2));
        std::fs::create_dir_all(folder.join("0/0")).unwrap();
        std::fs::write(folder.join("0/0/0"), bytes).unwrap();
    };
    let Some(folder) = alone_with("zarr::array::tests::memory_is_as_told", write) else { return };
    let mut out = vec![1; 2 << 20];
    let (taken, array) = memory_taken(|| {
        let array = open(&folder).unwrap();
        array.read(&[1, 0, 0], &[1, 1024, 1024], &mut out).unwrap();
        array
    });
    let said = array.reader_bytes();
    // The allocator's own, and small buffers; decoded and coded chunks are 8 MiB each.
    assert!(taken <= said + (3 << 20) && said <= 5 * (8 << 20), "took {taken}, said {said}");
    // Some pages were taken before.
    assert!(taken >= 15 << 20, "took {taken}");
}
