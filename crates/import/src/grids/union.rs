//! The union of grids' boxes, in voxels of the finest spacing along each axis. Each grid is a row of cells along each axis; all lie in one unit and along
//! one set of directions. Costs a few numbers a grid.

use super::Grid;
use crate::error::{ImportError, Result};
use crate::source::SourceInfo;
use brickyard_volume::numbers::exact;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{Extent, Orientation, VoxelBox};
use glam::{DMat3, DVec3};
use std::path::Path;

/// Largest distance between two places that count as one, in voxels.
const SAME_PLACE_VOXELS: f64 = 1e-3;

/// Largest distance of a grid's far corner from where other directions would put it, in voxels.
const SAME_DIRECTION_VOXELS: f64 = 1e-2;

/// How far below a face a centre counts as on it, in cells: rounding errors are smaller.
const ON_FACE_CELLS: f64 = 1e-9;

/// Largest difference of cells of one volume, relative.
const SAME_VOLUME: f64 = 1e-9;

/// Greatest distance in voxels: whole numbers and halves are exact in f64.
const FARTHEST_VOXELS: f64 = 1e15;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Grids in their common box.
pub(super) struct Union {
    /// The description of the finest grid, in the place of the union.
    pub(super) info: SourceInfo,
    /// The grids, as listed.
    pub(super) placed: Vec<Placed>,
    /// The grids' numbers, the finest first; of equally fine ones the first listed.
    pub(super) order: Vec<usize>,
}

/// A grid's cells in the union.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Placed {
    pub(super) cells: [Cells; 3],
    /// The voxels with their centres in the grid.
    pub(super) region: VoxelBox,
}

/// Cells of a grid along one axis. Voxel `k` of the union reaches from `k` to `k + 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cells {
    /// The first cell's lower face.
    low: f64,
    /// Voxels per cell, at least 1.
    ratio: f64,
    count: u32,
}

impl Cells {
    /// The cell which contains the centre of a voxel; of two that meet there the upper one.
    pub(super) fn cell(self, voxel: u32) -> u32 {
        let cell = ((f64::from(voxel) + 0.5 - self.low) / self.ratio + ON_FACE_CELLS).floor();
        // Saturates.
        (cell as u32).min(self.count - 1)
    }

    /// The first voxel with its centre in the cells, and the first one behind.
    fn voxels(self) -> [f64; 2] {
        let below = 0.5 + ON_FACE_CELLS * self.ratio;
        [self.low, self.low + f64::from(self.count) * self.ratio].map(|face| (face - below).ceil())
    }

    fn moved(self, by: f64) -> Self {
        Self { low: self.low - by, ..self }
    }
}

/// First centre and steps from a cell to the next, in the space of the first grid's cells.
struct Steps {
    first: DVec3,
    length: DVec3,
}

/// The voxels of the union.
struct Lattice {
    /// Their length, as in [`Steps`].
    length: DVec3,
    spacing: DVec3,
    /// The grid along each axis whose first voxel is one of them.
    base: [usize; 3],
    /// Voxels per cell of each grid.
    ratios: Vec<DVec3>,
    /// As in [`Union`].
    order: Vec<usize>,
}

impl Union {
    /// Finds the union of grids.
    ///
    /// # Errors
    /// If a place is not known, units or directions differ, equally fine grids lie between each other, or the box is too large.
    pub(super) fn of(grids: &[Grid], list: &Path) -> Result<Self> {
        let infos = in_one_unit(grids)?;
        let steps = along_one_frame(grids, &infos)?;
        let lattice = Lattice::of(&infos, &steps);
        let cells = (0..grids.len()).map(|i| lattice.cells(i, grids, &steps)).collect::<Result<Vec<_>>>()?;
        let spans: Vec<[[f64; 2]; 3]> = cells.iter().map(|cells| cells.map(Cells::voxels)).collect();
        let [low, high] = [0, 1].map(|end| {
            std::array::from_fn::<f64, 3, _>(|axis| {
                let ends = spans.iter().map(|span| span[axis][end]);
                if end == 0 { ends.fold(f64::INFINITY, f64::min) } else { ends.fold(f64::NEG_INFINITY, f64::max) }
            })
        });
        let extent = extent_of(list, &infos[0], lattice.spacing, std::array::from_fn(|axis| high[axis] - low[axis]))?;
        let placed: Vec<Placed> = cells
            .iter()
            .zip(&spans)
            .map(|(cells, span)| Placed {
                cells: std::array::from_fn(|axis| cells[axis].moved(low[axis])),
                region: VoxelBox::new(
                    std::array::from_fn(|axis| (span[axis][0] - low[axis]) as u32),
                    std::array::from_fn(|axis| (span[axis][1] - low[axis]) as u32),
                ),
            })
            .collect();
        let base = lattice.order[0];
        let mut info = infos[base].clone();
        place(&mut info, placed[base].cells, lattice.spacing).map_err(|problem| {
            ImportError::invalid(&grids[base].path, format!("its place cannot be continued to other grids: {problem}"))
        })?;
        info.extent = extent;
        (info.calibrated, info.says_origin) = (true, true);
        Ok(Self { info, placed, order: lattice.order })
    }
}

/// Moves a grid's place to the first voxel of the union, and gives it the union's spacing.
fn place(info: &mut SourceInfo, cells: [Cells; 3], spacing: DVec3) -> Result<(), String> {
    let first = cells.map(|cells| (0.5 - cells.low) / cells.ratio - 0.5);
    info.reorient(DVec3::ONE, DVec3::from_array(first)).map_err(|error| error.to_string())?;
    let finer = DVec3::from_array(cells.map(|cells| 1.0 / cells.ratio));
    let stretched = info.orientation.map(|orientation| orientation.stretched(finer)).transpose();
    info.orientation = stretched.map_err(|error| error.to_string())?;
    info.geometry.spacing = spacing;
    let origin = info.geometry.origin;
    if origin.is_finite() { Ok(()) } else { Err(format!("the first centre would be {origin}")) }
}

/// The grids' descriptions in the unit of the first one.
fn in_one_unit(grids: &[Grid]) -> Result<Vec<SourceInfo>> {
    let mut infos = Vec::with_capacity(grids.len());
    for grid in grids {
        let info = grid.source.info();
        if !info.calibrated {
            let problem = "its voxel size is not known: write \"spacing\" and \"origin\" into its entry of the list";
            return Err(ImportError::options(&grid.path, problem));
        }
        if info.orientation.is_none() && !info.says_origin && info.geometry.origin == DVec3::ZERO {
            let problem = "nothing says where it lies: write \"origin\" into its entry of the list, also of [0, 0, 0]";
            return Err(ImportError::options(&grid.path, problem));
        }
        infos.push(converted(grid, &grids[0])?);
    }
    Ok(infos)
}

/// A grid's description with lengths in the unit of the first one.
fn converted(grid: &Grid, first: &Grid) -> Result<SourceInfo> {
    let mut info = grid.source.info().clone();
    let to = &first.source.info().geometry;
    let mut rows = info.orientation.map(|orientation| orientation.rows());
    for axis in 0..3 {
        let [own, other] = [&info.geometry, to].map(|geometry| geometry.axis_unit(axis));
        if own == other {
            continue;
        }
        let lengths = own.and_then(LengthUnit::named).zip(other.and_then(LengthUnit::named));
        let Some((own, other)) = lengths else {
            let [own, other] = [own, other].map(|unit| unit.unwrap_or("no unit"));
            let problem = format!(
                "positions along {} are in {own}, but those of {} in {other}: write \"unit\" into the entries of the list",
                AXES[axis], first.name
            );
            return Err(ImportError::options(&grid.path, problem));
        };
        info.geometry.spacing[axis] = own.convert(info.geometry.spacing[axis], other);
        info.geometry.origin[axis] = own.convert(info.geometry.origin[axis], other);
        // An orientation has one unit of length for its rows, the world's axes.
        rows = rows.map(|mut rows| {
            rows[axis] = rows[axis].map(|length| own.convert(length, other));
            rows
        });
    }
    let unfit = |error| ImportError::invalid(&grid.path, format!("its orientation cannot be converted: {error}"));
    info.orientation = rows.map(Orientation::new).transpose().map_err(unfit)?;
    (info.geometry.unit, info.geometry.axis_units) = (to.unit.clone(), to.axis_units.clone());
    Ok(info)
}

/// Centres and steps of grids in cells of the first one.
fn along_one_frame(grids: &[Grid], infos: &[SourceInfo]) -> Result<Vec<Steps>> {
    let (inverse, first) = (inverse(&infos[0]), first_centre(&infos[0]));
    let mut all = Vec::with_capacity(grids.len());
    for (grid, info) in grids.iter().zip(infos) {
        if info.orientation.is_some() != infos[0].orientation.is_some() {
            let has = |info: &SourceInfo| if info.orientation.is_some() { "has an orientation" } else { "has none" };
            let problem = format!(
                "{}, but {} {}: write both with one, or both without",
                has(info),
                grids[0].name,
                has(&infos[0])
            );
            return Err(ImportError::invalid(&grid.path, problem));
        }
        let steps = inverse * matrix(info);
        let steps =
            Steps { first: inverse * (first_centre(info) - first), length: steps_along(grid, &grids[0], steps)? };
        all.push(steps);
    }
    Ok(all)
}

/// The lengths of steps which lie along the first grid's.
fn steps_along(grid: &Grid, first: &Grid, steps: DMat3) -> Result<DVec3> {
    let refuse = |problem: String| Err(ImportError::invalid(&grid.path, problem));
    let length = DVec3::new(steps.x_axis.x, steps.y_axis.y, steps.z_axis.z);
    if !steps.is_finite() {
        return refuse(format!("its voxels cannot be measured by those of {}: correct the spacing of one", first.name));
    }
    let last = grid.source.info().extent.to_array().map(|n| f64::from(n.saturating_sub(1)).max(1.0));
    let across = steps - DMat3::from_diagonal(length);
    let astray = |axis: usize| (across.col(axis) * last[axis] / length).abs().max_element();
    if length.min_element() > 0.0 && (0..3).all(|axis| astray(axis) <= SAME_DIRECTION_VOXELS) {
        return Ok(length);
    }
    refuse(format!(
        "its axes do not run along those of {}: grids share their directions; resample one of them, or pack each by itself",
        first.name
    ))
}

/// The steps from a centre to the next along each axis, as columns.
fn matrix(info: &SourceInfo) -> DMat3 {
    match &info.orientation {
        Some(orientation) => DMat3::from_cols(orientation.step(0), orientation.step(1), orientation.step(2)),
        None => DMat3::from_diagonal(info.geometry.spacing),
    }
}

/// The inverse of [`matrix`]; of tiny steps without their product, which would be 0.
fn inverse(info: &SourceInfo) -> DMat3 {
    match &info.orientation {
        Some(_) => matrix(info).inverse(),
        None => DMat3::from_diagonal(info.geometry.spacing.recip()),
    }
}

fn first_centre(info: &SourceInfo) -> DVec3 {
    info.orientation.map_or(info.geometry.origin, |orientation| orientation.first_centre())
}

impl Lattice {
    /// The lattice of the shortest steps along each axis, there in the place of the finest grid that has them.
    fn of(infos: &[SourceInfo], steps: &[Steps]) -> Self {
        let shortest: [usize; 3] = std::array::from_fn(|axis| {
            let by_length = |a: &usize, b: &usize| steps[*a].length[axis].total_cmp(&steps[*b].length[axis]);
            (0..steps.len()).min_by(by_length).unwrap_or(0)
        });
        let of_shortest =
            |of: &dyn Fn(usize, usize) -> f64| DVec3::from_array(std::array::from_fn(|axis| of(shortest[axis], axis)));
        let length = of_shortest(&|i, axis| steps[i].length[axis]);
        let ratios: Vec<DVec3> = steps
            .iter()
            .zip(infos)
            .map(|(steps, info)| {
                let counts = info.extent.to_array();
                let ratio = |axis: usize| snapped(steps.length[axis] / length[axis], counts[axis]);
                DVec3::from_array(std::array::from_fn(ratio))
            })
            .collect();
        let mut order: Vec<usize> = (0..steps.len()).collect();
        let volume = |i: usize| ratios[i].element_product();
        order.sort_by(|a, b| volume(*a).total_cmp(&volume(*b)));
        // Equal cells may differ in the last digits, as products of unlike factors.
        let are_equal = |a: &usize, b: &usize| volume(*b) - volume(*a) <= SAME_VOLUME * volume(*a);
        order.chunk_by_mut(are_equal).for_each(<[usize]>::sort_unstable);
        let base = std::array::from_fn(|axis| {
            order.iter().copied().find(|i| ratios[*i][axis] == 1.0).unwrap_or(shortest[axis])
        });
        let spacing = of_shortest(&|i, axis| infos[i].geometry.spacing[axis]);
        Self { length, spacing, base, ratios, order }
    }

    /// A grid's cells, counted from the first voxels of the bases.
    fn cells(&self, number: usize, grids: &[Grid], steps: &[Steps]) -> Result<[Cells; 3]> {
        let (grid, own) = (&grids[number], &steps[number]);
        let counts = grid.source.info().extent.to_array();
        let mut cells = [Cells { low: 0.0, ratio: 1.0, count: 1 }; 3];
        for axis in 0..3 {
            let (ratio, count, base) = (self.ratios[number][axis], counts[axis], self.base[axis]);
            let away = (own.first[axis] - steps[base].first[axis]) / self.length[axis];
            let reach = away.abs() + ratio * f64::from(count);
            let (along, other) = (AXES[axis], &grids[base].name);
            if count == 0 || reach.is_nan() || reach > FARTHEST_VOXELS {
                let problem = format!(
                    "reaches {reach:.3e} voxels of the finest grid from {other} along {along}: correct the spacing, origin or \
                     unit of one of them"
                );
                return Err(ImportError::options(&grid.path, problem));
            }
            let low =
                if self.ratios[number] == DVec3::ONE { away.round() } else { half_snapped(away - ratio / 2.0 + 0.5) };
            if self.ratios[number] == DVec3::ONE && (away - low).abs() > SAME_PLACE_VOXELS {
                let problem = format!(
                    "its first voxel is {away:.4} voxels from that of {other} along {along}, no whole number: equally fine \
                     grids share one lattice; correct the origin, or resample one of them"
                );
                return Err(ImportError::options(&grid.path, problem));
            }
            cells[axis] = Cells { low, ratio, count };
        }
        Ok(cells)
    }
}

/// A whole number of voxels per cell, if that takes the last of all cells to the same place.
fn snapped(ratio: f64, count: u32) -> f64 {
    let whole = ratio.round().max(1.0);
    if (ratio - whole).abs() * f64::from(count) <= SAME_PLACE_VOXELS { whole } else { ratio }
}

/// A place on a voxel's face or centre, if it is close to one.
fn half_snapped(place: f64) -> f64 {
    let half = (2.0 * place).round() / 2.0;
    if (place - half).abs() <= SAME_PLACE_VOXELS { half } else { place }
}

/// The union's extent, of these sizes in voxels.
fn extent_of(list: &Path, info: &SourceInfo, spacing: DVec3, sizes: [f64; 3]) -> Result<Extent> {
    let extent = Extent::from_array(sizes.map(|size| size as u32));
    let voxels = extent.checked_volume().filter(|_| sizes.iter().all(|size| *size <= f64::from(u32::MAX)));
    let series = u64::from(info.channels).saturating_mul(info.times.into());
    let bytes = voxels.and_then(|n| n.checked_mul(series)?.checked_mul(size_of::<f32>() as u64));
    if bytes.is_some_and(|bytes| bytes <= i64::MAX as u64) {
        return Ok(extent);
    }
    let problem = format!(
        "its grids reach over {} voxels of {}, too many for a volume: correct the spacing, origin or unit of one of them, or \
         pack each by itself",
        sizes.map(|size| exact(size, false)).join(","),
        spacing.to_array().map(|length| exact(length, false)).join(",")
    );
    Err(ImportError::options(list, problem))
}
