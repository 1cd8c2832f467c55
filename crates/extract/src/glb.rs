//! Binary glTF 2.0: a node and mesh for each object, with 32-bit coordinates and indices. Vertices, and an object's indices after them, wait in files of
//! their own, since the JSON in front of them has their number and bounds. Costs 12 bytes a vertex and a triangle, and some 400 an object in memory.

use crate::error::MeshError;
use crate::format::{Format, Head, Place, Scratch, Triangle};
use crate::stl::single;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use tempfile::NamedTempFile;

/// Bytes of a file, whose length has 32 bits; the JSON is counted at the end.
const MOST_BYTES: u64 = u32::MAX as u64;

/// Codes of the format: little-endian f32 and u32, and the buffers' uses.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

pub(crate) struct Glb {
    place: Place,
    head: Head,
    data: Scratch,
    indices: Scratch,
    objects: Vec<Object>,
    /// The bytes of all objects.
    bytes: u64,
}

struct Object {
    name: String,
    vertices: u64,
    triangles: u64,
    low: Vec3,
    high: Vec3,
}

impl Glb {
    pub(crate) fn begin(output: &Path, head: &Head) -> Result<Self, MeshError> {
        let place = Place { output: output.into() };
        let (data, indices) = (place.scratch()?, place.scratch()?);
        Ok(Self { place, head: head.clone(), data, indices, objects: Vec::new(), bytes: 0 })
    }

    fn too_large(&self) -> MeshError {
        MeshError::TooLarge {
            path: self.place.output.clone(),
            limit: ".glb has at most 4 GiB",
            advice: "Write .ply or .obj, or take a coarser level or a box",
        }
    }

    /// Counts the bytes of a vertex or triangle.
    fn count(&mut self) -> Result<(), MeshError> {
        self.bytes += 12;
        if self.bytes > MOST_BYTES { Err(self.too_large()) } else { Ok(()) }
    }

    fn document(&self) -> Value {
        let mut views = Vec::new();
        let mut at = 0;
        for object in &self.objects {
            for (count, target) in [(object.vertices, ARRAY_BUFFER), (object.triangles, ELEMENT_ARRAY_BUFFER)] {
                let length = 12 * count;
                views.push(json!({ "buffer": 0, "byteOffset": at, "byteLength": length, "target": target }));
                at += length;
            }
        }
        let accessors = self.objects.iter().enumerate().flat_map(|(i, object)| {
            let (low, high) = (object.low.to_array(), object.high.to_array());
            let places = json!({
                "bufferView": 2 * i, "componentType": FLOAT, "count": object.vertices, "type": "VEC3", "min": low, "max": high,
            });
            let indices = json!({
                "bufferView": 2 * i + 1, "componentType": UNSIGNED_INT, "count": 3 * object.triangles, "type": "SCALAR",
            });
            [places, indices]
        });
        let mesh = |(i, object): (usize, &Object)| json!({ "name": object.name, "primitives": [{ "attributes": { "POSITION": 2 * i }, "indices": 2 * i + 1 }] });
        let node = |(i, object): (usize, &Object)| json!({ "name": object.name, "mesh": i });
        json!({
            // The format has metres and no other unit: ours is told where programs keep what they do not know.
            "asset": { "version": "2.0", "generator": "brickyard", "extras": { "comments": self.head.remarks } },
            "scene": 0,
            "scenes": [{ "nodes": (0..self.objects.len()).collect::<Vec<_>>() }],
            "nodes": self.objects.iter().enumerate().map(node).collect::<Vec<_>>(),
            "meshes": self.objects.iter().enumerate().map(mesh).collect::<Vec<_>>(),
            "accessors": accessors.collect::<Vec<_>>(),
            "bufferViews": views,
            "buffers": [{ "byteLength": self.bytes }],
        })
    }
}

impl Format for Glb {
    fn begin(&mut self, name: &str) -> Result<(), MeshError> {
        let (low, high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.objects.push(Object { name: name.into(), vertices: 0, triangles: 0, low, high });
        Ok(())
    }

    fn vertex(&mut self, place: DVec3) -> Result<(), MeshError> {
        self.count()?;
        let place = place.as_vec3();
        if let Some(object) = self.objects.last_mut() {
            object.vertices += 1;
            (object.low, object.high) = (object.low.min(place), object.high.max(place));
        }
        self.data.file.write_all(&single(place)).map_err(|error| self.place.io(error))
    }

    fn triangle(&mut self, triangle: &Triangle) -> Result<(), MeshError> {
        self.count()?;
        if let Some(object) = self.objects.last_mut() {
            object.triangles += 1;
        }
        let mut bytes = [0; 12];
        for (bytes, vertex) in bytes.chunks_exact_mut(4).zip(triangle.vertices) {
            // The file's length bounds the number of vertices.
            bytes.copy_from_slice(&(vertex as u32).to_le_bytes());
        }
        self.indices.file.write_all(&bytes).map_err(|error| self.place.io(error))
    }

    fn end(&mut self) -> Result<(), MeshError> {
        self.indices.drain(&mut self.data.file).map_err(|error| self.place.io(error))
    }

    fn finish(mut self: Box<Self>) -> Result<NamedTempFile, MeshError> {
        let mut json = self.document().to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        // A head of three words, and two before each chunk; the data are whole words.
        let total = 12 + 8 + json.len() as u64 + 8 + self.bytes;
        let total = u32::try_from(total).map_err(|_| self.too_large())?;
        let mut file = self.place.file()?;
        let words = [u32::from_le_bytes(*b"glTF"), 2, total, json.len() as u32, u32::from_le_bytes(*b"JSON")];
        let data_words = [self.bytes as u32, u32::from_le_bytes(*b"BIN\0")];
        let mut write_words = |words: &[u32], rest: &[u8]| {
            words.iter().try_for_each(|word| file.write_all(&word.to_le_bytes())).and_then(|()| file.write_all(rest))
        };
        let headed = write_words(&words, &json).and_then(|()| write_words(&data_words, &[]));
        headed.and_then(|()| self.data.drain(&mut file)).map_err(|error| self.place.io(error))?;
        self.place.finish(file)
    }
}
