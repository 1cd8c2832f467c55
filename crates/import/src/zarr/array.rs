//! Arrays, read box by box. A chunk equal to the box is decoded in place; others are decoded once, kept in a cache for the boxes beside them,
//! and copied run by run.

#[cfg(test)]
mod tests;

use super::chunk_file::{self, ChunkFile, ChunkFiles, Opened};
use super::document::Document;
use super::kept_chunks::{KeptChunks, Kind, Needs};
use super::layout::{Layout, ZarrVersion, product};
use crate::chunk_grid::{step, strides};
use crate::element::{Element, Endian};
use crate::error::{ImportError, Result};
use crate::stamp::Stamp;
use crate::strided_copy::{CopyAxis, copy, swap_bytes};
use brickyard_objects::is_address;
use serde_json::{Map, Value};
use std::collections::HashSet;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

/// An array of numbers.
pub(crate) struct Array {
    path: PathBuf,
    version: ZarrVersion,
    attributes: Map<String, Value>,
    layout: Layout,
    /// The document, and its state when the array was opened.
    document: PathBuf,
    stamp: Stamp,
    files: ChunkFiles,
    kept: KeptChunks,
    /// Places of chunks that are fetched ahead now.
    under_way: Mutex<HashSet<Vec<u64>>>,
    /// Bytes of a decoded chunk, and of a shard's index.
    chunk_bytes: usize,
    index_bytes: u64,
    /// Bytes between neighbours of a decoded chunk.
    strides: Vec<usize>,
}

/// An array about to be opened.
pub(super) struct Opening {
    pub(super) folder: PathBuf,
    pub(super) version: ZarrVersion,
    pub(super) attributes: Map<String, Value>,
    pub(super) layout: Layout,
    pub(super) document: Document,
}

/// A box of an array, and the buffer for it.
struct Target<'a> {
    start: &'a [u64],
    shape: &'a [u64],
    strides: Vec<usize>,
}

impl std::fmt::Debug for Array {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Array").field("path", &self.path).field("layout", &self.layout).finish()
    }
}

impl Array {
    /// Opens an array by its layout, and looks at no chunk.
    pub(super) fn new(opening: Opening) -> Result<Self> {
        let Opening { folder: path, version, attributes, mut layout, document } = opening;
        let damaged = |problem: String| {
            ImportError::invalid(&document.path, format!("damaged: {problem}; fetch or write the document again"))
        };
        layout.check().map_err(damaged)?;
        name_dimensions(&mut layout, &attributes);
        let chunk_bytes = usize::try_from(layout.chunk_bytes()).map_err(|error| damaged(error.to_string()))?;
        let inner: Vec<u64> = layout.file_shape.iter().zip(&layout.chunk_shape).map(|(file, n)| file / n).collect();
        let index_bytes = match &layout.shard {
            None => 0,
            Some(shard) => {
                let bytes = product(&inner).and_then(|chunks| shard.index_bytes(chunks));
                bytes.ok_or_else(|| {
                    let feature = format!("a shard of {inner:?} inner chunks");
                    ImportError::unsupported_but(&document.path, feature, "write the array anew with smaller shards")
                })?
            }
        };
        let strides = layout.chunk_strides();
        let array = Self {
            path,
            version,
            attributes,
            layout,
            document: document.path,
            stamp: document.stamp,
            files: ChunkFiles::from_now_on(),
            kept: KeptChunks::default(),
            under_way: Mutex::default(),
            chunk_bytes,
            index_bytes,
            strides,
        };
        Ok(array.keeping_in(&KeptChunks::default()))
    }

    /// Keeps its chunks beside those of an image's other arrays.
    pub(crate) fn keeping_in(mut self, kept: &KeptChunks) -> Self {
        self.kept = kept.with_array(self.needs());
        self
    }

    /// Bytes of two chunks with their indexes, and of all.
    fn needs(&self) -> Needs {
        let bytes = self.chunk_bytes as u64 + self.index_bytes;
        let chunks = self.layout.shape.iter().zip(&self.layout.chunk_shape).map(|(size, n)| size.div_ceil(*n));
        let all = chunks.fold(1u64, u64::saturating_mul).saturating_mul(bytes);
        Needs { least: all.min(2 * bytes), most: all }
    }

    /// Changes the bytes of decoded chunks kept for boxes beside them, of all arrays that share them: two chunks with their indexes at least, and all
    /// at most.
    pub(crate) fn keep_at_most(&self, bytes: u64) {
        self.kept.keep_at_most(bytes);
    }

    /// The array's folder.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn version(&self) -> ZarrVersion {
        self.version
    }

    /// Attributes as found.
    pub(crate) fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    /// Elements along each axis, slowest first; an axis may have none.
    pub(crate) fn shape(&self) -> &[u64] {
        &self.layout.shape
    }

    /// Elements of the smallest piece decoded alone, along each of the array's own axes: of an inner chunk of a shard, else of a chunk.
    pub(crate) fn chunk_shape(&self) -> &[u64] {
        &self.layout.chunk_shape
    }

    /// Type of an element; booleans are bytes.
    pub(crate) fn element(&self) -> Element {
        self.layout.element
    }

    /// The little-endian element of chunks never written.
    pub(crate) fn fill(&self) -> &[u8] {
        &self.layout.fill
    }

    /// Names of the axes, from the document or as xarray writes them.
    pub(crate) fn dimension_names(&self) -> Vec<Option<String>> {
        self.layout.dimension_names.clone()
    }

    /// Most memory in bytes of one thread in [`read`](Self::read), beside its output.
    pub(crate) fn reader_bytes(&self) -> u64 {
        let chunk = self.chunk_bytes as u64;
        chunk.saturating_add(self.layout.codecs.memory_bytes(chunk)).saturating_add(self.index_bytes)
    }

    /// Most memory in bytes of decoded chunks and indexes kept.
    pub(crate) fn held_bytes(&self) -> u64 {
        self.kept.bytes()
    }

    /// Whether any chunk was ever written. Lists folders up to the first chunk, and reads none.
    ///
    /// # Errors
    /// If a folder cannot be listed.
    pub(crate) fn has_any_chunk(&self) -> Result<bool> {
        self.layout.keys.any_in(&self.path, &self.layout.grid())
    }

    /// Fills `out` with the elements of a box in C order of the array's own axes, little-endian.
    ///
    /// # Errors
    /// If a chunk is damaged, or the array changed after it was opened. The error names the file.
    ///
    /// # Panics
    /// If the box leaves the array, or `out` is not exactly its size.
    pub(crate) fn read(&self, start: &[u64], shape: &[u64], out: &mut [u8]) -> Result<()> {
        let axes = self.layout.shape.len();
        assert!(start.len() == axes && shape.len() == axes, "a box of other axes than the array's");
        let is_inside = |a: usize| start[a].checked_add(shape[a]).is_some_and(|end| end <= self.layout.shape[a]);
        assert!((0..axes).all(is_inside), "a box at {start:?} of {shape:?} leaves {:?}", self.layout.shape);
        let element_bytes = self.layout.element.bytes();
        let elements = product(shape).and_then(|n| n.checked_mul(element_bytes as u64));
        assert_eq!(elements, Some(out.len() as u64), "the buffer is not the box's size");
        if out.is_empty() {
            return Ok(());
        }
        let chunk = &self.layout.chunk_shape;
        let [first, last] = self.chunks_of(start, shape);
        let is_one_chunk = shape == chunk && (0..axes).all(|a| start[a].is_multiple_of(chunk[a]));
        if is_one_chunk && self.layout.is_plain() && !self.is_remote() {
            self.decode_in_place(&first, out)?;
        } else {
            let target = Target { start, shape, strides: strides(shape, element_bytes) };
            self.each_loaded(
                &first,
                &last,
                |_| true,
                |place, decoded| {
                    self.copy(decoded.as_ref().map(|bytes| &bytes[..]), place, &target, out);
                },
            )?;
        }
        self.stamp.check(&self.document)
    }

    /// Loads the chunks of a box at an address that are not kept, for reads that follow.
    ///
    /// # Errors
    /// As for [`Array::read`].
    pub(crate) fn fetch(&self, start: &[u64], shape: &[u64]) -> Result<()> {
        if !self.is_remote() || shape.contains(&0) {
            return Ok(());
        }
        let [first, last] = self.chunks_of(start, shape);
        let under_way = || self.under_way.lock().unwrap_or_else(PoisonError::into_inner);
        // Boxes of several threads have chunks in common: none waits for another's.
        let mut own = Vec::new();
        let is_wanted =
            |place: &[u64]| self.kept.get(Kind::Chunk, place).is_none() && under_way().insert(place.to_vec());
        let is_wanted = |place: &[u64]| is_wanted(place).then(|| own.push(place.to_vec())).is_some();
        let loaded = self.each_loaded(&first, &last, is_wanted, |_, _| {});
        for place in &own {
            under_way().remove(place);
        }
        loaded
    }

    /// The first and the last chunk of a box, by their places in the grid of chunks.
    fn chunks_of(&self, start: &[u64], shape: &[u64]) -> [Vec<u64>; 2] {
        let chunk = &self.layout.chunk_shape;
        let axes = 0..chunk.len();
        let first = axes.clone().map(|a| start[a] / chunk[a]).collect();
        [first, axes.map(|a| (start[a] + shape[a] - 1) / chunk[a]).collect()]
    }

    /// Loads the wanted ones of the chunks from the first to the last, some at once, and shows them in order.
    fn each_loaded(
        &self,
        first: &[u64],
        last: &[u64],
        mut is_wanted: impl FnMut(&[u64]) -> bool,
        mut show: impl FnMut(&[u64], Option<Arc<Vec<u8>>>),
    ) -> Result<()> {
        let (mut next, mut places) = (Some(first.to_vec()), Vec::new());
        while let Some(mut place) = next {
            if is_wanted(&place) {
                places.push(place.clone());
            }
            next = step(&mut place, first, last).then_some(place);
            if next.is_none() || places.len() == self.at_once() {
                for (place, decoded) in places.iter().zip(self.load_each(&places)) {
                    show(place, decoded?);
                }
                places.clear();
            }
        }
        Ok(())
    }

    fn is_remote(&self) -> bool {
        is_address(&self.path)
    }

    /// Chunks loaded at once: one from disk, at an address several, which share round trips, within a quarter of the memory of those kept.
    fn at_once(&self) -> usize {
        const MOST: u64 = 16;
        if self.is_remote() {
            (self.kept.bytes() / 4 / self.chunk_bytes.max(1) as u64).clamp(1, MOST) as usize
        } else {
            1
        }
    }

    /// Loads chunks, each on a thread of its own unless there is but one.
    fn load_each(&self, places: &[Vec<u64>]) -> Vec<Result<Option<Arc<Vec<u8>>>>> {
        let [one, others @ ..] = places else { return Vec::new() };
        thread::scope(|scope| {
            let others: Vec<_> = others.iter().map(|place| scope.spawn(|| self.load(place))).collect();
            let joined = others.into_iter().map(|other| other.join().unwrap_or_else(|panic| resume_unwind(panic)));
            std::iter::once(self.load(one)).chain(joined).collect()
        })
    }

    /// Decodes a chunk which is all of the wanted box.
    fn decode_in_place(&self, place: &[u64], out: &mut [u8]) -> Result<()> {
        if let Some(decoded) = self.kept.get(Kind::Chunk, place) {
            out.copy_from_slice(&decoded);
            return Ok(());
        }
        if let Some(coded) = self.locate(place)? {
            return self.decode(coded, out);
        }
        let element = self.layout.fill.len();
        let line = CopyAxis { count: out.len() / element, from: 0, to: element };
        copy(&self.layout.fill, out, &[line], element);
        Ok(())
    }

    /// The decoded chunk at a place of the grid of chunks; `None` if it was never written.
    fn load(&self, place: &[u64]) -> Result<Option<Arc<Vec<u8>>>> {
        if let Some(decoded) = self.kept.get(Kind::Chunk, place) {
            return Ok((!decoded.is_empty()).then_some(decoded));
        }
        if self.is_remote() {
            let decoded = self.kept.get_or_load(&self.path, Kind::Chunk, place, || self.fetch_chunk(place))?;
            return Ok((!decoded.is_empty()).then_some(decoded));
        }
        let Some(coded) = self.locate(place)? else { return Ok(None) };
        self.kept
            .get_or_load(&self.path, Kind::Chunk, place, || {
                let mut decoded = room(self.chunk_bytes).map_err(ImportError::io(&coded.file.path))?;
                self.decode(coded, &mut decoded).map(|()| decoded)
            })
            .map(Some)
    }

    /// Decodes a chunk at an address; nothing stands for one never written, so that it is asked for once. One that was damaged on the way is fetched
    /// once more.
    fn fetch_chunk(&self, place: &[u64]) -> Result<Vec<u8>> {
        let once = || {
            let Some(coded) = self.locate(place)? else { return Ok(Vec::new()) };
            let mut decoded = room(self.chunk_bytes).map_err(ImportError::io(&coded.file.path))?;
            self.decode(coded, &mut decoded).map(|()| decoded)
        };
        match once() {
            Err(ImportError::Invalid { path, .. }) => {
                chunk_file::forget(&path);
                once()
            }
            done => done,
        }
    }

    /// Opens the file of a chunk, and finds its bytes there; `None` if it was never written.
    fn locate(&self, place: &[u64]) -> Result<Option<Coded>> {
        let per_file = |a: usize| self.layout.file_shape[a] / self.layout.chunk_shape[a];
        let file_place: Vec<u64> = place.iter().enumerate().map(|(a, at)| at / per_file(a)).collect();
        let path = self.layout.keys.path(&self.path, &file_place);
        let opened = match &self.layout.shard {
            None => Opened::Whole(self.layout.codecs.coded_bytes(self.chunk_bytes as u64)[1]),
            Some(shard) if shard.is_at_start => Opened::Start(self.index_bytes),
            Some(_) => Opened::End(self.index_bytes),
        };
        let Some(mut file) = self.files.open(&self.path, path, opened)? else { return Ok(None) };
        let [start, bytes] = match &self.layout.shard {
            None => [0, file.bytes()],
            Some(shard) => {
                // Under the file's state, so that a new file's index is read anew.
                let place_then: Vec<u64> = file_place.into_iter().chain(file.state()).collect();
                let load = || shard.read_index(&mut file, self.index_bytes);
                let index = self.kept.get_or_load(&self.path, Kind::Index, &place_then, load)?;
                let counts: Vec<u64> = (0..place.len()).map(per_file).collect();
                let inside: Vec<u64> = place.iter().zip(&counts).map(|(at, count)| at % count).collect();
                match shard.entry(&index, shard.number_of(&inside, &counts)) {
                    Some(entry) => entry,
                    None => return Ok(None),
                }
            }
        };
        let coded = Coded { file, start, bytes };
        self.check_bytes(&coded)?;
        Ok(Some(coded))
    }

    /// Refuses coded bytes outside of the file, or of a length that no chunk has.
    fn check_bytes(&self, coded: &Coded) -> Result<()> {
        let Coded { file, start, bytes } = coded;
        if start.checked_add(*bytes).is_none_or(|end| end > file.bytes()) {
            let problem =
                format!("cut short: a chunk lies at {start}, of {bytes} bytes, found {} in all", file.bytes());
            return Err(file.damaged(&problem));
        }
        let [least, most] = self.layout.codecs.coded_bytes(self.chunk_bytes as u64);
        if (least..=most).contains(bytes) {
            return Ok(());
        }
        let expected = if least == most { most.to_string() } else { format!("{least} to {most}") };
        Err(file.damaged(&format!("damaged: expected {expected} bytes of a chunk at {start}, found {bytes}")))
    }

    /// Decodes a chunk into exactly its room.
    fn decode(&self, mut coded: Coded, out: &mut [u8]) -> Result<()> {
        if self.layout.codecs.is_empty() {
            coded.file.read(coded.start, out)?;
        } else {
            let mut bytes = room(coded.bytes as usize).map_err(ImportError::io(&coded.file.path))?;
            coded.file.read(coded.start, &mut bytes)?;
            let undone = self.layout.codecs.undo(bytes, out);
            undone.map_err(|problem| coded.file.damaged(&format!("the chunk at byte {}: {problem}", coded.start)))?;
        }
        if self.layout.endian == Endian::Big {
            swap_bytes(out, self.layout.element.bytes());
        }
        Ok(())
    }

    /// Copies the part of a chunk inside the box; without a chunk, the fill value.
    fn copy(&self, chunk: Option<&[u8]>, place: &[u64], target: &Target<'_>, out: &mut [u8]) {
        let (mut axes, mut from, mut to) = (Vec::with_capacity(place.len()), 0, 0);
        for a in 0..place.len() {
            let begin = place[a] * self.layout.chunk_shape[a];
            let end = (begin + self.layout.chunk_shape[a]).min(target.start[a] + target.shape[a]);
            let low = target.start[a].max(begin);
            let stride = if chunk.is_some() { self.strides[a] } else { 0 };
            from += (low - begin) as usize * stride;
            to += (low - target.start[a]) as usize * target.strides[a];
            axes.push(CopyAxis { count: (end - low) as usize, from: stride, to: target.strides[a] });
        }
        let chunk = chunk.unwrap_or(&self.layout.fill);
        copy(&chunk[from..], &mut out[to..], &axes, self.layout.element.bytes());
    }
}

/// Where a chunk's coded bytes are.
struct Coded {
    file: ChunkFile,
    start: u64,
    bytes: u64,
}

/// Zeroed memory. Much is asked for first, since a refusal would end the process otherwise.
fn room(bytes: usize) -> std::io::Result<Vec<u8>> {
    const MUCH_BYTES: usize = 64 << 20;
    if bytes < MUCH_BYTES {
        return Ok(vec![0; bytes]);
    }
    let mut room = Vec::new();
    room.try_reserve_exact(bytes).map_err(|_| rustix::io::Errno::NOMEM)?;
    room.resize(bytes, 0);
    Ok(room)
}

/// Takes the names of xarray's attribute where the document has none.
fn name_dimensions(layout: &mut Layout, attributes: &Map<String, Value>) {
    let Some(Value::Array(names)) = attributes.get("_ARRAY_DIMENSIONS") else { return };
    if names.len() == layout.dimension_names.len() && layout.dimension_names.iter().all(Option::is_none) {
        layout.dimension_names = names.iter().map(|name| name.as_str().map(str::to_owned)).collect();
    }
}
