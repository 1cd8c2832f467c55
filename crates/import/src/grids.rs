//! Grids of unlike fineness as one volume: nested grids of a model, patches of adaptive meshes, a coarse scan with a fine part, listed in a text.
//!
//! The volume is the union of their boxes at the finest spacing. Each voxel has the value of the finest grid with data in the cell around the voxel's
//! centre; values are repeated, never interpolated, so they stay exact and labels whole. A box is read in pieces of half a million voxels, or of a
//! plane: of each grid, from the finest on, the cells that meet a piece, once, until no voxel is left. All grids stay open.

mod agreement;
mod coverage;
mod list;
mod marks;
#[cfg(test)]
mod tests;
mod union;

use crate::boxes::{inside, pieces};
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::options::OpenOptions;
use crate::raw::identity;
use crate::series::Remarks;
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::numbers::exact;
use brickyard_volume::{Extent, Voxel, VoxelBox, with_voxel_type};
use coverage::Coverage;
pub(crate) use list::{Entry, GridList, is_list};
use marks::Marks;
use std::path::{Path, PathBuf};
use union::{Placed, Union};

/// Most voxels of a piece, except of planes that are decoded as a whole.
const PIECE_VOXELS: u64 = 1 << 19;

/// A grid to be joined.
pub(crate) struct Grid {
    /// Its file as listed, for messages.
    name: String,
    path: PathBuf,
    source: Box<dyn Source>,
}

impl Grid {
    /// The open grid of a list's entry.
    ///
    /// # Errors
    /// If the list names other channels than it has.
    pub(crate) fn new(list: &GridList, entry: &Entry, source: Box<dyn Source>) -> Result<Self> {
        let source = entry.named(&list.path, source)?;
        Ok(Self { name: entry.name.clone(), path: entry.input.clone(), source })
    }
}

/// Refuses a list of grids where one array is expected.
pub(crate) fn nested(path: &Path) -> ImportError {
    let problem = "is a list of grids, which is one input by itself: name it alone (`variable` chooses its arrays), append such \
                   lists one by one, and list the grids of all files in one";
    ImportError::options(path, problem)
}

/// Grids as one source.
pub(crate) struct Grids {
    info: SourceInfo,
    /// The grids, the finest first.
    layers: Vec<Layer>,
    /// Value of voxels in no grid; `None` if there are none.
    blank: Option<f64>,
}

/// A grid in its place.
struct Layer {
    grid: Grid,
    placed: Placed,
    /// Value of its voxels without data.
    sought: Option<f64>,
    /// The result's value for no data, which this grid's data must not have.
    reserved: Option<f64>,
}

impl Grids {
    /// Joins the grids of a list.
    ///
    /// # Errors
    /// If they do not fit together, or no value for voxels without data is known.
    pub(crate) fn new(list: &GridList, grids: Vec<Grid>, options: &OpenOptions) -> Result<Self> {
        let kinds = grids.iter().map(|grid| (grid.path.as_path(), grid.source.info().kind));
        let kind = SaidKind::of_all(kinds, options.are_labels.is_some())?;
        let grids = agreement::of_one_type(grids, options)?;
        let (looks, time) = agreement::common(&grids, options)?;
        let union = Union::of(&grids, &list.path)?;
        let coverage = Coverage::of(&union);
        coverage.check(&union, &list.path)?;
        let Marks { nodata, are_known, sought } = Marks::of(list, &grids, options)?;
        let blank = if union.info.voxel_type.is_float() { Some(f64::NAN) } else { nodata };
        if blank.is_none() && coverage.may_leave_voxels() {
            let problem = format!(
                "some voxels of the result lie in no grid, and {} has no NaN: write its value for no data, \"nodata\", into the list",
                union.info.voxel_type
            );
            return Err(ImportError::options(&list.path, problem));
        }
        let mut remarks = Remarks::default();
        grids.iter().for_each(|grid| remarks.add(&grid.source.info().notes, grid.path.display()));
        let mut notes = remarks.of_all(grids.len(), "files");
        notes.extend(coverage.notes(&grids, &union));
        let Union { info, placed, order } = union;
        let mut identity = identity("grids", &[&list.path])?;
        for ((grid, placed), sought) in grids.iter().zip(&placed).zip(&sought) {
            identity += &format!("\n{placed:?}, no data {sought:?}, of {}", grid.source.info().identity);
        }
        let mut layers: Vec<Option<Layer>> = Vec::with_capacity(grids.len());
        for ((grid, placed), sought) in grids.into_iter().zip(placed).zip(sought) {
            let reserved = blank.filter(|blank| blank.is_finite() && sought != Some(*blank));
            layers.push(Some(Layer { grid, placed, sought, reserved }));
        }
        let layers = order.into_iter().filter_map(|i| layers[i].take()).collect();
        let info =
            SourceInfo { kind, channel_looks: looks, time, nodata, knows_nodata: are_known, identity, notes, ..info };
        Ok(Self { info, layers, blank })
    }

    /// The sum of an amount over the grids' sources.
    fn sum(&self, of: impl Fn(&dyn Source) -> u64) -> u64 {
        self.layers.iter().fold(0, |sum, layer| sum.saturating_add(of(&*layer.grid.source)))
    }

    /// Fills a piece.
    fn fill(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8], buffers: &mut Buffers) -> Result<()> {
        let voxel_type = self.info.voxel_type;
        with_voxel_type!(voxel_type, T => {
            let blank = <T as Voxel>::from_f64_rounded(self.blank.unwrap_or(0.0)).to_le_bytes();
            out.as_chunks_mut::<{ size_of::<T>() }>().0.fill(blank);
        });
        buffers.is_set.clear();
        buffers.is_set.resize(region.extent().volume() as usize, false);
        let mut left = buffers.is_set.len();
        for layer in &self.layers {
            if left == 0 {
                return Ok(());
            }
            let shared = layer.placed.region.intersect(region);
            if !shared.is_empty() && buffers.misses(region, shared) {
                let cells = layer.cells(shared);
                buffers.cells.resize(cells.extent().volume() as usize * voxel_type.bytes(), 0);
                layer.grid.source.read_box(time, channel, cells, &mut buffers.cells)?;
                left -= layer.paint(Painted { time, channel, shared, cells, region }, out, buffers)?;
            }
        }
        match (self.blank, self.layers.first()) {
            (None, Some(layer)) if left > 0 => {
                let problem =
                    format!("no grid has data for a voxel from {} on: write \"nodata\" into the list", region.min);
                Err(ImportError::options(&layer.grid.path, problem))
            }
            _ => Ok(()),
        }
    }
}

/// Memory of one box being read.
#[derive(Default)]
struct Buffers {
    /// A grid's cells.
    cells: Vec<u8>,
    /// Whether a voxel of the piece has its value.
    is_set: Vec<bool>,
}

/// A part of a piece to be painted by one grid.
struct Painted {
    time: u32,
    channel: u32,
    /// The voxels, within the piece.
    shared: VoxelBox,
    /// The grid's cells around them.
    cells: VoxelBox,
    /// The piece.
    region: VoxelBox,
}

impl Buffers {
    /// Whether some voxel of a part of the piece has no value yet.
    fn misses(&self, region: VoxelBox, part: VoxelBox) -> bool {
        let row = part.extent().x as usize;
        rows(region, part).any(|start| self.is_set[start..start + row].contains(&false))
    }
}

/// The places in a piece of a part's rows.
fn rows(region: VoxelBox, part: VoxelBox) -> impl Iterator<Item = usize> {
    let (whole, part) = (region.extent(), inside(region, part));
    let starts = (part.min.z..part.max.z).flat_map(move |z| (part.min.y..part.max.y).map(move |y| [y, z]));
    starts.map(move |[y, z]| whole.linear([part.min.x, y, z]) as usize)
}

impl Layer {
    /// The cells around the centres of a box of voxels within the grid.
    fn cells(&self, voxels: VoxelBox) -> VoxelBox {
        let (low, high) = (voxels.min.to_array(), voxels.max.to_array());
        let cell = |axis: usize, voxel: u32| self.placed.cells[axis].cell(voxel);
        VoxelBox::new(
            std::array::from_fn(|axis| cell(axis, low[axis])),
            std::array::from_fn(|axis| cell(axis, high[axis] - 1) + 1),
        )
    }

    /// Gives voxels without a value that of the cell around their centre, if that has data. Returns how many.
    fn paint(&self, part: Painted, out: &mut [u8], buffers: &mut Buffers) -> Result<usize> {
        let Painted { shared, cells, region, .. } = part;
        let (low, high) = (shared.min.to_array(), shared.max.to_array());
        let first = cells.min.to_array();
        let along = |axis: usize| {
            let cell = move |voxel| self.placed.cells[axis].cell(voxel) - first[axis];
            (low[axis]..high[axis]).map(cell).collect::<Vec<u32>>()
        };
        let [x, y, z] = [along(0), along(1), along(2)];
        let places = z.iter().flat_map(|z| y.iter().map(move |y| cells.extent().linear([0, *y, *z]) as usize));
        let mut painted = 0;
        with_voxel_type!(self.grid.source.info().voxel_type, T => {
            let (values, _) = buffers.cells.as_chunks::<{ size_of::<T>() }>();
            let (out, _) = out.as_chunks_mut::<{ size_of::<T>() }>();
            for (start, row) in rows(region, shared).zip(places) {
                let voxels = out[start..].iter_mut().zip(&mut buffers.is_set[start..]).zip(&x);
                for ((voxel, is_set), x) in voxels.filter(|((_, is_set), _)| !**is_set) {
                    let at = row + *x as usize;
                    let bytes = values[at];
                    let value = T::from_le_bytes(bytes);
                    let number = value as f64;
                    if !value.is_valid() || self.sought == Some(number) {
                        continue;
                    }
                    if self.reserved == Some(number) {
                        return Err(self.beside(&part, at, number));
                    }
                    (*voxel, *is_set) = (bytes, true);
                    painted += 1;
                }
            }
        });
        Ok(painted)
    }

    /// Refuses data, in the cell of this number in a part, that would be taken for none.
    fn beside(&self, part: &Painted, at: usize, number: f64) -> ImportError {
        let [x, y, _] = part.cells.extent().to_array().map(|n| n as usize);
        let first = part.cells.min.to_array().map(|n| n as usize);
        let problem = format!(
            "voxel {},{},{} (channel {}, time step {}) is {}, which means no data outside of the grids or in others: write another \
             \"nodata\" into the list, or this one into the grid's entry if it means no data here, too",
            first[0] + at % x,
            first[1] + at / x % y,
            first[2] + at / (x * y),
            part.channel,
            part.time,
            exact(number, false)
        );
        ImportError::options(&self.grid.path, problem)
    }
}

impl Source for Grids {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// Whole planes if one source decodes them.
    fn access(&self) -> Access {
        let has_planes = self.layers.iter().any(|layer| layer.grid.source.access() == Access::Planes);
        if has_planes { Access::Planes } else { Access::Box }
    }

    fn reader_bytes(&self) -> u64 {
        let Extent { x, y, .. } = self.info.extent;
        let plane = if self.access() == Access::Planes { u64::from(x) * u64::from(y) } else { 0 };
        let piece = self.info.extent.volume().min(PIECE_VOXELS).max(plane);
        let largest = self.layers.iter().map(|layer| layer.grid.source.info().extent.volume()).max().unwrap_or(0);
        let cells = piece.min(largest).saturating_mul(self.info.voxel_type.bytes() as u64);
        let sources = self.layers.iter().map(|layer| layer.grid.source.reader_bytes()).max().unwrap_or(0);
        // The cells' numbers along the axes.
        let along = self.info.extent.to_array().map(|n| u64::from(n).min(piece));
        let numbers = along.iter().sum::<u64>() * size_of::<u32>() as u64;
        [sources, piece, cells, numbers].into_iter().fold(0, u64::saturating_add)
    }

    fn held_bytes(&self) -> u64 {
        let own = size_of_val(&self.layers[..]) + self.info.identity.len();
        self.sum(|source| source.held_bytes()).saturating_add(own as u64)
    }

    fn scratch_bytes(&self) -> u64 {
        self.sum(|source| source.scratch_bytes())
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let (mut rest, mut buffers) = (out, Buffers::default());
        for piece in pieces(region, self.access(), PIECE_VOXELS) {
            let bytes = piece.extent().volume() as usize * self.info.voxel_type.bytes();
            let (own, others) = rest.split_at_mut(bytes);
            self.fill(time, channel, piece, own, &mut buffers)?;
            rest = others;
        }
        Ok(())
    }

    /// Grids below one that has the whole box are read only where that has no data.
    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        for layer in &self.layers {
            let shared = layer.placed.region.intersect(region);
            if !shared.is_empty() {
                layer.grid.source.announce(time, channel, layer.cells(shared));
            }
            if shared == region {
                return;
            }
        }
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        let meets = |layer: &&Layer| !layer.placed.region.intersect(region).is_empty();
        let Some(layer) = self.layers.iter().find(meets) else {
            return self.blank.filter(|blank| blank.is_finite());
        };
        let is_whole = layer.placed.region.intersect(region) == region;
        let value = if is_whole { layer.grid.source.constant_in(time, channel, layer.cells(region)) } else { None };
        value.filter(|value| value.is_finite() && layer.sought != Some(*value) && layer.reserved != Some(*value))
    }
}
