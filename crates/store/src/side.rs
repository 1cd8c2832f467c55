//! Side data: what is known of every brick and shard without reading one, as Zarr arrays inside each level's folder.
//!
//! | array | type | shape | holds |
//! | --- | --- | --- | --- |
//! | `minmax` | the voxels' | t, c, z, y, x, 2 | least and greatest valid value of the brick, its descendants included; NaN where there is none |
//! | `occupancy` | uint64 | t, c, z, y, x | bins the brick can show, apron and descendants included |
//! | `shards` | uint64 | t, c, z, y, x, 2 | [`Fingerprint`]: length and index checksum; zeros where there is no file |
//!
//! Where aprons are stored, the array `aprons` of each level has a `shards` of its own, likewise.
//!
//! All axes are always there. Each array is one chunk: bytes, zstd, crc32c. They are read whole when a store is opened:
//! 8 bytes and two voxels per brick.

use crate::error::OpenError;
use crate::layout::Layout;
use crate::metadata::{array_document, bytes_codec, check_array, document_bytes};
use crate::shard::Fingerprint;
use brickyard_volume::{Extent, Level, Occupancy, VoxelType};
use serde_json::{Value, json};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The side data of one level, row-major in (t, c, z, y, x): see [`Layout::brick_place`] and [`Layout::shard_place`].
#[derive(Clone, Debug, PartialEq)]
pub struct SideData {
    voxel_type: VoxelType,
    /// Two little-endian voxels per brick.
    minmax: Vec<u8>,
    /// Per brick.
    pub occupancy: Vec<Occupancy>,
    /// Per shard.
    pub shards: Vec<Fingerprint>,
}

impl SideData {
    /// All zero: no brick shows anything, no shard has a file.
    pub fn new(layout: &Layout, level: Level, voxel_type: VoxelType) -> Self {
        let volumes = layout.times as usize * layout.channels as usize;
        let bricks = volumes * layout.pyramid.level(level).bricks.volume() as usize;
        let shards = volumes * layout.shard_grid(level).volume() as usize;
        Self {
            voxel_type,
            minmax: vec![0; bricks * 2 * voxel_type.bytes()],
            occupancy: vec![Occupancy::NONE; bricks],
            shards: vec![Fingerprint::default(); shards],
        }
    }

    /// Least and greatest value of a brick, as two little-endian voxels.
    pub fn minmax_bytes(&self, place: usize) -> &[u8] {
        let pair = 2 * self.voxel_type.bytes();
        &self.minmax[place * pair..(place + 1) * pair]
    }

    /// The same, to be written.
    pub fn minmax_bytes_mut(&mut self, place: usize) -> &mut [u8] {
        let pair = 2 * self.voxel_type.bytes();
        &mut self.minmax[place * pair..(place + 1) * pair]
    }

    /// Least and greatest value of a brick.
    pub fn minmax(&self, place: usize) -> (f64, f64) {
        let pair = self.minmax_bytes(place);
        (self.voxel_type.read(pair, 0), self.voxel_type.read(pair, 1))
    }

    /// The level's side files: path below the store, content.
    pub fn files(&self, layout: &Layout, level: Level) -> Vec<(PathBuf, Vec<u8>)> {
        let contents: [&[u8]; 3] =
            [&self.minmax, bytemuck::cast_slice(&self.occupancy), bytemuck::cast_slice(&self.shards)];
        let dir = layout.side_dir(Path::new(""), level);
        let arrays = SideArray::of_level(layout, level, self.voxel_type);
        arrays.iter().zip(contents).flat_map(|(array, bytes)| array.files(&dir, bytes)).collect()
    }

    /// Reads and checks a level's side data.
    pub(crate) fn read(store: &Path, layout: &Layout, level: Level, voxel_type: VoxelType) -> Result<Self, OpenError> {
        let [minmax, occupancy, shards] = SideArray::of_level(layout, level, voxel_type);
        let dir = layout.side_dir(store, level);
        Ok(Self {
            voxel_type,
            minmax: minmax.read(&dir)?,
            occupancy: elements(&occupancy.read(&dir)?),
            shards: elements(&shards.read(&dir)?),
        })
    }
}

/// The files of the fingerprints of a level's aprons, whose layout this is: path below the store, content.
pub(crate) fn fingerprint_files(layout: &Layout, level: Level, shards: &[Fingerprint]) -> Vec<(PathBuf, Vec<u8>)> {
    SideArray::fingerprints(layout, level).files(&layout.side_dir(Path::new(""), level), bytemuck::cast_slice(shards))
}

/// Reads and checks them.
pub(crate) fn read_fingerprints(store: &Path, layout: &Layout, level: Level) -> Result<Vec<Fingerprint>, OpenError> {
    let bytes = SideArray::fingerprints(layout, level).read(&layout.side_dir(store, level))?;
    Ok(elements(&bytes))
}

struct SideArray {
    name: &'static str,
    data_type: &'static str,
    element_bytes: usize,
    shape: Vec<u32>,
}

impl SideArray {
    fn of_level(layout: &Layout, level: Level, voxel_type: VoxelType) -> [Self; 3] {
        let bricks = layout.pyramid.level(level).bricks;
        [
            Self::new("minmax", voxel_type.zarr_name(), voxel_type.bytes(), layout, bricks, &[2]),
            Self::new("occupancy", "uint64", 8, layout, bricks, &[]),
            Self::fingerprints(layout, level),
        ]
    }

    fn fingerprints(layout: &Layout, level: Level) -> Self {
        Self::new("shards", "uint64", 8, layout, layout.shard_grid(level), &[2])
    }

    fn new(
        name: &'static str,
        data_type: &'static str,
        element_bytes: usize,
        layout: &Layout,
        grid: Extent,
        last: &[u32],
    ) -> Self {
        let shape = [&[layout.times, layout.channels, grid.z, grid.y, grid.x], last].concat();
        Self { name, data_type, element_bytes, shape }
    }

    /// Its files below `dir`, and their content.
    fn files(&self, dir: &Path, bytes: &[u8]) -> Vec<(PathBuf, Vec<u8>)> {
        let dir = dir.join(self.name);
        let document = (dir.join("zarr.json"), document_bytes(&self.document()));
        vec![document, (dir.join(self.chunk_path()), encode(bytes))]
    }

    fn document(&self) -> Value {
        let codecs = json!([
            bytes_codec(self.element_bytes),
            { "name": "zstd", "configuration": { "level": 1, "checksum": false } },
            { "name": "crc32c" },
        ]);
        array_document(&self.shape, &self.shape, self.data_type, codecs)
    }

    fn chunk_path(&self) -> String {
        format!("c{}", "/0".repeat(self.shape.len()))
    }

    fn read(&self, dir: &Path) -> Result<Vec<u8>, OpenError> {
        let dir = dir.join(self.name);
        let document_path = dir.join("zarr.json");
        check_array(&document_path, &self.document(), &read_json(&document_path)?)?;
        let path = dir.join(self.chunk_path());
        let encoded = std::fs::read(&path).map_err(|error| OpenError::Io { path: path.clone(), error })?;
        let expected_bytes = self.shape.iter().map(|&n| n as u64).product::<u64>() * self.element_bytes as u64;
        decode(&path, &encoded, expected_bytes)
    }
}

fn elements<T: bytemuck::Pod>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

fn encode(bytes: &[u8]) -> Vec<u8> {
    let mut encoded = Vec::new();
    crate::scratch::Scratch::default().compress(1, bytes, &mut encoded);
    let crc = crc32c::crc32c(&encoded);
    encoded.extend_from_slice(&crc.to_le_bytes());
    encoded
}

fn decode(path: &Path, encoded: &[u8], expected_bytes: u64) -> Result<Vec<u8>, OpenError> {
    let (frame, crc) = encoded.split_last_chunk::<4>().unwrap_or((encoded, &[0; 4]));
    let (stored, computed) = (u32::from_le_bytes(*crc), crc32c::crc32c(frame));
    if stored != computed || encoded.len() < 4 {
        return Err(OpenError::invalid(path, "checksum", format!("{stored:08x}"), format!("{computed:08x}")));
    }
    // Grows with what really comes out, so that a false shape cannot ask for more memory than there are data.
    let mut bytes = Vec::new();
    zstd::stream::read::Decoder::with_buffer(frame)
        .and_then(|d| d.take(expected_bytes + 1).read_to_end(&mut bytes))
        .map_err(|error| OpenError::Io { path: path.into(), error })?;
    if bytes.len() as u64 != expected_bytes {
        return Err(OpenError::invalid(path, "decoded length", format!("{expected_bytes} bytes"), bytes.len()));
    }
    Ok(bytes)
}

/// Reads a metadata document of at most 64 MiB.
pub(crate) fn read_json(path: &Path) -> Result<Value, OpenError> {
    const CAP: u64 = 64 << 20;
    let io = |error| OpenError::Io { path: path.into(), error };
    let mut text = Vec::new();
    std::fs::File::open(path).and_then(|f| f.take(CAP).read_to_end(&mut text)).map_err(io)?;
    serde_json::from_slice(&text).map_err(|e| OpenError::invalid(path, "document", "JSON", e))
}
