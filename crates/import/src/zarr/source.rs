//! Voxels of one array, under the description of its image or of its own attributes. A box of the array's own order and type is read in place; others
//! a piece at a time, of about a chunk, which is put in order and decoded.

use super::array::Array;
use super::documents::Documents;
use super::kept_chunks::KeptChunks;
use crate::axes::{Axis, Sizes};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::losses::Losses;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::{Access, Source, SourceInfo};
use crate::step_time::StepTime;
use brickyard_volume::{Extent, VoxelBox};
use std::path::Path;

/// Least bytes of a piece: smaller chunks are read together.
const PIECE_BYTES: u64 = 1 << 20;

/// Most bytes of chunks across a plane for a source read by planes, and their least edge: smaller ones suit boxes.
const MOST_LAYER_BYTES: u64 = 1 << 30;
const PLANE_EDGE: u64 = 128;

/// One array as a source.
pub(super) struct ZarrSource {
    info: SourceInfo,
    array: Array,
    layout: Layout,
    access: Access,
    step_time: StepTime,
    documents: Documents,
    /// Whether 64-bit floats beyond f32 are refused as they are read.
    check_doubles: bool,
    /// How to check 64-bit integers that were not looked through; `None` if there are none.
    check: Option<OpenOptions>,
}

/// The order and type of an array's elements.
#[derive(Clone)]
pub(super) struct Layout {
    /// Letters of the array's axes, slowest first; `None` for one of one element.
    letters: Vec<Option<Axis>>,
    sizes: Sizes,
    decode: Decode,
}

impl Layout {
    /// The layout of an array with these letters. The error tells of too long axes.
    pub(super) fn of(array: &Array, letters: Vec<Option<Axis>>) -> Result<Self, String> {
        let (shape, element) = (array.shape(), array.element());
        let mut lengths = Vec::new();
        for size in shape {
            lengths.push(u32::try_from(*size).map_err(|_| format!("{shape:?} has an axis longer than 2^32 - 1"))?);
        }
        let ordered = letters.iter().zip(&lengths).filter_map(|(letter, size)| Some(((*letter)?, *size)));
        let (axes, lengths): (Vec<Axis>, Vec<u32>) = ordered.unzip();
        let sizes = Sizes::from_ordered(&axes, &lengths);
        sizes.checked_bytes(element.bytes())?;
        Ok(Self { letters, sizes, decode: Decode { element, endian: Endian::Little, scale: None } })
    }

    /// Layout of the same order, with another decoding of the elements.
    pub(super) fn with_decode(self, decode: Decode) -> Self {
        // Elements come in this order, whatever the array's.
        Self { decode: Decode { endian: Endian::Little, ..decode }, ..self }
    }

    pub(super) fn decode(&self) -> Decode {
        self.decode
    }

    pub(super) fn element(&self) -> Element {
        self.decode.element
    }

    /// Keeps the first steps alone.
    pub(super) fn with_times(mut self, times: u32) -> Self {
        self.sizes.times = self.sizes.times.min(times);
        self
    }

    pub(super) fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// Whether voxels of a volume lie x first, then y, then z.
    fn is_in_order(&self) -> bool {
        let spatial = self.letters.iter().flatten().filter(|axis| matches!(axis, Axis::X | Axis::Y | Axis::Z));
        let spatial: Vec<Axis> = spatial.copied().collect();
        [&[Axis::Z, Axis::Y, Axis::X][..], &[Axis::Y, Axis::X]].contains(&&spatial[..])
    }

    /// The box of the array along its own axes: first elements, and sizes.
    fn in_array(&self, time: u32, channel: u32, region: VoxelBox) -> (Vec<u64>, Vec<u64>) {
        let (low, extent) = (region.min.to_array(), region.extent().to_array());
        let along = |letter: &Option<Axis>| match letter {
            Some(Axis::X) => (low[0], extent[0]),
            Some(Axis::Y) => (low[1], extent[1]),
            Some(Axis::Z) => (low[2], extent[2]),
            Some(Axis::C) => (channel, 1),
            Some(Axis::T) => (time, 1),
            None => (0, 1),
        };
        self.letters.iter().map(along).map(|(start, size)| (u64::from(start), u64::from(size))).unzip()
    }

    /// Bytes between neighbours along x, y, z in the elements of a box; 0 along axes that the array lacks.
    fn strides(&self, region: VoxelBox) -> [usize; 3] {
        let extent = region.extent().to_array();
        let (mut strides, mut step) = ([0; 3], self.decode.element.bytes());
        for letter in self.letters.iter().rev() {
            let Some(at) = [Axis::X, Axis::Y, Axis::Z].iter().position(|axis| Some(*axis) == *letter) else { continue };
            strides[at] = step;
            step *= extent[at] as usize;
        }
        strides
    }

    /// Decodes the elements of a piece into its place in the voxels of a box.
    fn decode_piece(&self, elements: &[u8], piece: VoxelBox, region: VoxelBox, out: &mut [u8]) {
        let voxel = self.decode.voxel_type().bytes();
        let [x, y, z] = self.strides(piece);
        let (extent, whole) = (piece.extent(), region.extent());
        let first = |axis: usize| (piece.min.to_array()[axis] - region.min.to_array()[axis]) as usize;
        for slice in 0..extent.z as usize {
            for row in 0..extent.y as usize {
                let source = &elements[slice * z + row * y..];
                let place = ((first(2) + slice) * whole.y as usize + first(1) + row) * whole.x as usize + first(0);
                let stride = if x == 0 { self.decode.element.bytes() } else { x };
                self.decode.line(source, stride, &mut out[place * voxel..], voxel, extent.x as usize);
            }
        }
    }

    /// Voxels of a chunk along x, y, z, at most the array's.
    fn chunk(&self, array: &Array) -> [u32; 3] {
        let extent = self.sizes.extent.to_array();
        [0, 1, 2].map(|at: usize| {
            let axis = [Axis::X, Axis::Y, Axis::Z][at];
            let place = self.letters.iter().position(|letter| *letter == Some(axis));
            let edge = place.and_then(|place| array.chunk_shape().get(place).copied()).unwrap_or(1);
            edge.clamp(1, extent[at].into()) as u32
        })
    }

    /// Steps of pieces along x, y, z: whole chunks, of some size together.
    fn steps(&self, array: &Array) -> [u32; 3] {
        let extent = self.sizes.extent.to_array();
        let mut steps = self.chunk(array);
        let bytes = |steps: [u32; 3]| {
            steps.iter().fold(self.decode.element.bytes() as u64, |bytes, step| bytes.saturating_mul((*step).into()))
        };
        for at in 0..3 {
            let times = (PIECE_BYTES / bytes(steps).max(1)).clamp(1, u64::from(extent[at].div_ceil(steps[at])));
            steps[at] = (u64::from(steps[at]) * times).min(extent[at].into()) as u32;
        }
        steps
    }

    /// Bytes of the chunks across a plane, where they are wide: boxes beside one another would decode them again, but planes in their order
    /// decode each once. `None` where they suit boxes.
    fn layer_bytes(&self, array: &Array) -> Option<u64> {
        let sizes = |axis: Axis| {
            let place = self.letters.iter().position(|letter| *letter == Some(axis));
            place.map_or((1, 1), |place| (array.chunk_shape()[place], array.shape()[place]))
        };
        let plane = [sizes(Axis::X), sizes(Axis::Y)];
        let is_wide = plane.iter().all(|(chunk, size)| *chunk >= PLANE_EDGE.min(*size));
        let count = plane.iter().map(|(chunk, size)| size.div_ceil(*chunk)).fold(1, u64::saturating_mul);
        let chunk =
            array.chunk_shape().iter().fold(self.decode.element.bytes() as u64, |bytes, n| bytes.saturating_mul(*n));
        let layer = count.saturating_mul(chunk);
        (is_wide && layer <= MOST_LAYER_BYTES).then_some(layer)
    }

    /// Most bytes of a piece.
    fn piece_bytes(&self, array: &Array) -> u64 {
        let elements = self.steps(array).iter().map(|step| u64::from(*step)).fold(1, u64::saturating_mul);
        elements.saturating_mul(self.decode.element.bytes() as u64)
    }
}

/// The pieces of a box: parts of it between multiples of `steps`.
fn pieces(region: VoxelBox, steps: [u32; 3]) -> impl Iterator<Item = VoxelBox> {
    let (low, high) = (region.min.to_array(), region.max.to_array());
    let along = move |axis: usize| {
        let step = steps[axis].max(1);
        let mut at = low[axis];
        std::iter::from_fn(move || {
            let start = at;
            at = (start / step).saturating_add(1).saturating_mul(step).min(high[axis]);
            (start < high[axis]).then_some((start, at))
        })
    };
    along(2)
        .flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| (x, y, z))))
        .map(|(x, y, z)| VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1]))
}

/// How an array is to be read.
#[derive(Clone, Copy)]
pub(super) enum Reading<'a> {
    /// Once and whole, in the order that suits its chunks.
    Whole,
    /// By bricks in any order, with these chunks kept beside those of other arrays.
    Bricks(&'a KeptChunks),
}

impl Reading<'_> {
    /// Whether bricks are read.
    pub(super) fn is_by_bricks(self) -> bool {
        matches!(self, Self::Bricks(_))
    }
}

/// An array about to be opened.
pub(super) struct Opening<'a> {
    pub(super) reading: Reading<'a>,
    pub(super) array: Array,
    pub(super) layout: Layout,
    pub(super) info: SourceInfo,
    pub(super) step_time: StepTime,
    pub(super) documents: Documents,
}

impl Opening<'_> {
    /// Opens the array. 64-bit numbers are looked through for those that no voxel holds.
    ///
    /// # Errors
    /// If there are such, and the options do not allow losses; or if the array cannot be read.
    pub(super) fn open(self, options: &OpenOptions) -> Result<ZarrSource> {
        let Self { reading, array, mut layout, mut info, step_time, documents } = self;
        info.voxel_type = layout.decode.voxel_type();
        let path = array.path().to_owned();
        if let Some(mut losses) = Losses::may_occur(&path, layout.decode, info.nodata, options) {
            let steps = layout.steps(&array);
            for (time, channel) in (0..info.times).flat_map(|time| (0..info.channels).map(move |c| (time, c))) {
                for piece in pieces(info.extent.full_box(), steps) {
                    losses.see(&elements_of(&array, &layout, time, channel, piece)?)?;
                }
            }
            info.notes.push(losses.note());
            layout.decode = losses.decode();
            info.voxel_type = layout.decode.voxel_type();
        }
        if reading.is_by_bricks() && layout.decode.element == Element::F64 {
            let note = "Voxels are float64 and are read as float32, the nearest each; `brickyard pack` tells if any is changed by that.";
            info.notes.push(Note::new(note));
        }
        if !array.has_any_chunk()? {
            let fill = array.element().numbers(Endian::Little, array.fill());
            let fill = fill.first().map_or(String::new(), |fill| format!(", {fill}"));
            info.notes.push(Note::warning(format!(
                "No chunk was found in {}: all voxels are the fill value{fill}.",
                path.display()
            )));
        }
        let (access, array) = match (reading, layout.layer_bytes(&array)) {
            (Reading::Bricks(kept), _) => (Access::Box, array.keeping_in(kept)),
            (Reading::Whole, Some(layer)) => {
                array.keep_at_most(layer);
                (Access::Planes, array)
            }
            (Reading::Whole, None) => (Access::Box, array),
        };
        let is_whole = matches!(layout.decode.element, Element::I64 | Element::U64);
        let check = (is_whole && options.is_looked_at && !options.allow_lossy)
            .then(|| OpenOptions { is_looked_at: false, ..options.clone() });
        let source = ZarrSource {
            info,
            array,
            layout,
            access,
            step_time,
            documents,
            check,
            check_doubles: reading.is_by_bricks(),
        };
        source.documents.check()?;
        Ok(source)
    }
}

/// Refuses floats that no f32 is near.
fn check_doubles(elements: &[u8], path: &Path) -> Result<()> {
    let numbers = elements.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes));
    match numbers.into_iter().find(|number| number.is_finite() && !(*number as f32).is_finite()) {
        Some(number) => {
            let problem = format!(
                "voxels are float64, and the value {number:e} is beyond the numbers that f32 holds; `brickyard pack` makes a store with such values \
                 infinite, if losses are allowed"
            );
            Err(ImportError::invalid(path, problem))
        }
        None => Ok(()),
    }
}

/// The elements of a piece in the array's order.
fn elements_of(array: &Array, layout: &Layout, time: u32, channel: u32, piece: VoxelBox) -> Result<Vec<u8>> {
    let (start, shape) = layout.in_array(time, channel, piece);
    let bytes = piece.extent().volume() as usize * layout.decode.element.bytes();
    let mut elements = vec![0; bytes];
    array.read(&start, &shape, &mut elements)?;
    Ok(elements)
}

impl Source for ZarrSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        self.access
    }

    fn piece(&self) -> Option<Extent> {
        Some(Extent::from_array(self.layout.chunk(&self.array)))
    }

    fn held_bytes(&self) -> u64 {
        self.array.held_bytes()
    }

    fn keep_at_most(&self, bytes: u64) {
        self.array.keep_at_most(bytes);
    }

    fn reader_bytes(&self) -> u64 {
        let is_direct = self.layout.decode.is_copy() && self.layout.is_in_order();
        let piece = if is_direct { 0 } else { self.layout.piece_bytes(&self.array) };
        self.array.reader_bytes().saturating_add(piece)
    }

    fn step_time(&self) -> StepTime {
        self.step_time.clone()
    }

    fn fetch_box(&self, time: u32, channel: u32, region: VoxelBox) -> Result<(), ImportError> {
        let (start, shape) = self.layout.in_array(time, channel, region);
        self.array.fetch(&start, &shape)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        if self.layout.decode.is_copy() && self.layout.is_in_order() {
            let (start, shape) = self.layout.in_array(time, channel, region);
            self.array.read(&start, &shape, out)?;
        } else {
            for piece in pieces(region, self.layout.steps(&self.array)) {
                let elements = elements_of(&self.array, &self.layout, time, channel, piece)?;
                if self.layout.decode.element == Element::F64 && self.check_doubles {
                    check_doubles(&elements, self.array.path())?;
                }
                if let Some(options) = &self.check {
                    let decode = self.layout.decode;
                    let losses = Losses::may_occur(self.array.path(), decode, self.info.nodata, options);
                    losses.map(Losses::in_place).iter_mut().try_for_each(|losses| losses.see(&elements))?;
                }
                self.layout.decode_piece(&elements, piece, region, out);
            }
        }
        self.documents.check()
    }
}
