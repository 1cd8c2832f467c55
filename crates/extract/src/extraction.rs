//! Extraction: checks, the sweep over blocks, and the output.

use crate::block_grid::{Block, BlockGrid};
use crate::bricks::{self, Bricks};
use crate::budget::Budget;
use crate::decimation::{Decimation, Region};
use crate::error::MeshError;
use crate::format::{Format, Head, Place, Triangle};
use crate::isosurface::Isosurface;
use crate::label_boxes::label_boxes;
use crate::nets::Nets;
use crate::numbering::Numbers;
use crate::output;
use crate::patch::Patch;
use crate::piece::Piece;
use crate::pieces::Pieces;
use crate::points::Points;
use crate::report::{MeshObject, MeshReport};
use crate::request::{MOST_DECIMATION_VOXELS, MOST_SMOOTHING, MeshRequest, MeshSurface};
use crate::world::World;
use brickyard_store::{Kind, ReadError, Store, check_outside};
use brickyard_volume::{VoxelBox, with_voxel_type};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Checks whether a surface of a store may be written to `output`, reading no voxel.
///
/// # Errors
/// If the output exists and may not be replaced, its extension is unknown, or the request does not fit the store.
pub fn check_mesh(store: &Store, output: &Path, request: &MeshRequest) -> Result<(), MeshError> {
    checked_region(store, request)?;
    check_surface(store, request)?;
    output::check_name(output, request.surface == MeshSurface::Labels)?;
    check_output(output, request.overwrite)
}

/// Writes a surface of a store to `output`, whose extension (`.stl`, `.ply`, `.obj` or `.glb`) selects the format. Calls `progress` with the bytes of
/// voxels so far and in total; it may cancel.
///
/// # Errors
/// If the output exists and may not be replaced, its extension is unknown, the request does not fit the store, there is no such surface, a brick cannot be
/// read, the memory is too little for one thread, the file cannot be written or holds no more, or `progress` cancels. Then nothing new is left behind.
pub fn mesh(
    store: &Store,
    output: &Path,
    request: &MeshRequest,
    progress: impl Fn(u64, u64) -> ControlFlow<()> + Sync,
) -> Result<MeshReport, MeshError> {
    check_mesh(store, output, request)?;
    let region = checked_region(store, request)?;
    let world = World::of(store, request.level);
    let head = head(store, &world, region);
    let format = output::begin(output, &head, request.surface == MeshSurface::Labels)?;
    let budget = Budget::of(store, request)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(budget.threads).build();
    let pool = pool.map_err(|error| MeshError::Threads(error.to_string()))?;
    let MeshRequest { level, time, channel, .. } = *request;
    let bricks = Bricks::new(store, bricks::Part { level, time, channel, region }, budget.bricks);
    let decimation = request.decimation_voxels.map(|voxels| Decimation::new(world, region, voxels));
    let begin = |decimation| Pieces::begin(Place { output: output.into() }, decimation, budget.list_bytes);
    let pieces = decimation.map(begin).transpose()?;
    let origin = world.place(DVec3::from_array(region.min.to_array().map(f64::from)));
    let written = Written { format, pieces, objects: Vec::new(), numbers: Numbers::default(), origin };
    let sweep =
        Sweep { bricks, world, decimation, waiting_bytes: budget.waiting_bytes, request, output, progress: &progress };
    let (format, report) = pool.install(|| sweep.run(written))?;
    let file = format.finish()?;
    let io = |error| MeshError::Io { path: output.into(), error };
    file.as_file().sync_all().map_err(io)?;
    let persisted = if request.overwrite { file.persist(output) } else { file.persist_noclobber(output) };
    persisted.map_err(|e| match e.error.kind() {
        std::io::ErrorKind::AlreadyExists => MeshError::Exists { path: output.into() },
        _ => io(e.error),
    })?;
    Ok(report)
}

fn checked_region(store: &Store, request: &MeshRequest) -> Result<VoxelBox, MeshError> {
    let below = |what, found: u32, count: u32| match found < count {
        true => Ok(()),
        false => Err(MeshError::Outside { what, found: found.to_string(), expected: format!("0 to {}", count - 1) }),
    };
    below("level", request.level.0.into(), store.pyramid().levels().len() as u32)?;
    below("time step", request.time, store.times())?;
    below("channel", request.channel, store.channels())?;
    let whole = store.pyramid().level(request.level).extent.full_box();
    let region = request.region.unwrap_or(whole);
    if region.is_empty() || region.intersect(whole) != region {
        let show = |b: VoxelBox| {
            let (min, max) = (b.min, b.max);
            format!("{}:{},{}:{},{}:{}", min.x, max.x, min.y, max.y, min.z, max.z)
        };
        let expected = format!("a box inside {} of level {}", show(whole), request.level);
        return Err(MeshError::Outside { what: "box", found: show(region), expected });
    }
    Ok(region)
}

fn check_surface(store: &Store, request: &MeshRequest) -> Result<(), MeshError> {
    let path = store.path().display();
    let is_labels = store.info().kind == Kind::Labels;
    let problem = match request.surface {
        MeshSurface::Isosurface(value) if !value.is_finite() => {
            format!("an isovalue of {value}: expected a finite number")
        }
        MeshSurface::Isosurface(_) if is_labels => {
            format!("{path}: holds labels, and nothing lies between two of them: choose a label")
        }
        MeshSurface::Label(_) | MeshSurface::Labels if !is_labels => {
            format!("{path}: holds no labels: choose an isovalue, or pack it with `kind` labels")
        }
        _ if request.smoothing > MOST_SMOOTHING => {
            format!("{} iterations of smoothing: expected at most {MOST_SMOOTHING}", request.smoothing)
        }
        _ => match request.decimation_voxels {
            Some(voxels) if !(voxels > 0.0 && voxels <= MOST_DECIMATION_VOXELS) => {
                format!("decimation within {voxels} voxels: expected more than 0 and at most {MOST_DECIMATION_VOXELS}")
            }
            _ => return Ok(()),
        },
    };
    Err(MeshError::Unfit(problem))
}

fn check_output(output: &Path, overwrite: bool) -> Result<(), MeshError> {
    check_outside(output)?;
    if !overwrite && output.symlink_metadata().is_ok() {
        return Err(MeshError::Exists { path: output.into() });
    }
    if std::fs::metadata(output).is_ok_and(|found| !found.is_file()) {
        let error = std::io::Error::other("is not a regular file, and is never replaced");
        return Err(MeshError::Io { path: output.into(), error });
    }
    Ok(())
}

fn head(store: &Store, world: &World, region: VoxelBox) -> Head {
    // 3D Slicer reads this; it takes coordinates for left and back otherwise.
    let space = store.info().orientation.map(|_| "SPACE=RAS".to_owned());
    let unit = match space {
        Some(_) => Some("millimeter".to_owned()),
        None => store.geometry().units_in_words(),
    };
    let unit = unit.map(|unit| format!("unit: {}", unit.replace(|c: char| c.is_control() || !c.is_ascii(), " ")));
    Head { remarks: space.into_iter().chain(unit).collect(), is_single: world.fits_single(region) }
}

/// An object to extract.
#[derive(Clone, Copy, Debug)]
struct Target {
    label: Option<i64>,
    /// The box of its voxels.
    region: VoxelBox,
}

impl Target {
    fn name(&self, request: &MeshRequest) -> String {
        match (self.label, request.surface) {
            (Some(label), _) => format!("label_{label}"),
            (None, MeshSurface::Isosurface(value)) => format!("isosurface_{value}"),
            (None, _) => "surface".into(),
        }
    }
}

/// A block of a target.
#[derive(Clone, Copy, Debug)]
struct Job {
    target: usize,
    block: Block,
}

/// Blocks looked at between two reports of progress, for each thread: most have no surface.
const JOBS_AT_ONCE: usize = 64;

/// Blocks extracted before they are written, for each thread: the last ones keep some threads waiting.
const PARTS_AT_ONCE: usize = 8;

struct Sweep<'a, P> {
    bricks: Bricks<'a>,
    world: World,
    decimation: Option<Decimation>,
    /// Bytes of parts waiting to be written, at most, when another is begun.
    waiting_bytes: u64,
    request: &'a MeshRequest,
    output: &'a Path,
    progress: &'a P,
}

impl<P: Fn(u64, u64) -> ControlFlow<()> + Sync> Sweep<'_, P> {
    fn run(&self, mut written: Written) -> Result<(Box<dyn Format>, MeshReport), MeshError> {
        let voxel_bytes = self.bricks.store().voxel_type().bytes() as u64;
        let whole = Target { label: None, region: self.bricks.region() };
        let mut done = 0;
        let targets = match self.request.surface {
            MeshSurface::Isosurface(_) => vec![whole],
            MeshSurface::Label(label) => vec![Target { label: Some(label), ..whole }],
            MeshSurface::Labels => {
                let total = 2 * whole.region.extent().volume() * voxel_bytes;
                let boxes = label_boxes(&self.bricks, self.nodata(), |voxels| {
                    done += voxels * voxel_bytes;
                    self.report(done, total)
                })?;
                boxes.0.into_iter().map(|(label, region)| Target { label: Some(label), region }).collect()
            }
        };
        let cells =
            |target: &Target| target.region.extent().to_array().map(|n| u128::from(n) + 1).iter().product::<u128>();
        let total = targets.iter().map(cells).sum::<u128>().saturating_mul(voxel_bytes.into());
        let total = u64::try_from(total).unwrap_or(u64::MAX).saturating_add(done);
        let grids = targets.iter().enumerate();
        let mut jobs = grids.flat_map(|(target, Target { region, .. })| {
            BlockGrid::of(*region, whole.region).blocks().map(move |block| Job { target, block })
        });
        let threads = rayon::current_num_threads();
        loop {
            let some: Vec<Job> = jobs.by_ref().take(JOBS_AT_ONCE * threads).collect();
            if some.is_empty() {
                break;
            }
            let is_active =
                |job: &Job| self.may_cross(&targets[job.target], &job.block).map(|is_active| (*job, is_active));
            let active = some.par_iter().map(is_active).collect::<Result<Vec<_>, ReadError>>()?;
            let active: Vec<Job> = active.into_iter().filter_map(|(job, is_active)| is_active.then_some(job)).collect();
            let mut rest = &active[..];
            while !rest.is_empty() {
                let jobs = &rest[..rest.len().min(PARTS_AT_ONCE * threads)];
                let parts = self.parts(&targets, jobs)?;
                rest = &rest[parts.len()..];
                for (job, part) in jobs.iter().zip(parts) {
                    let target = &targets[job.target];
                    if !written.is_in(target) && !part.patch.vertices.is_empty() {
                        written.end(|| self.report(done, total))?;
                        written.begin(target, &target.name(self.request))?;
                    }
                    written.add(&job.block, part)?;
                }
                self.report(done, total)?;
            }
            let cells = |job: &Job| (0..3).map(|a| (job.block.end[a] - job.block.first[a]) as u64).product::<u64>();
            done += some.iter().map(cells).sum::<u64>() * voxel_bytes;
            self.report(done.min(total), total)?;
        }
        written.end(|| self.report(total, total))?;
        if written.objects.is_empty() {
            return Err(MeshError::Empty(self.nothing()));
        }
        Ok((written.format, MeshReport { objects: written.objects }))
    }

    fn report(&self, done: u64, total: u64) -> Result<(), MeshError> {
        match (self.progress)(done, total) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(MeshError::Cancelled { path: self.output.into() }),
        }
    }

    fn nodata(&self) -> Option<f64> {
        self.bricks.store().nodata()
    }

    /// There is no surface, in words.
    fn nothing(&self) -> String {
        let (low, high) = self.bricks.store().channel_range(self.request.channel);
        let part = if self.request.region.is_some() { "in this box " } else { "" };
        match self.request.surface {
            MeshSurface::Isosurface(value) => format!(
                "no surface at {value}: {part}no value is as high; values of channel {} lie from {low} to {high}",
                self.request.channel
            ),
            MeshSurface::Label(label) => {
                format!("no voxel {part}of level {} has the label {label}", self.request.level)
            }
            MeshSurface::Labels => {
                format!("no voxel {part}of level {} has a label but the background, 0", self.request.level)
            }
        }
    }

    /// Whether a block may have a part of the surface, judging by the ranges of its bricks.
    fn may_cross(&self, target: &Target, block: &Block) -> Result<bool, ReadError> {
        let store = self.bricks.store();
        let first = if target.label.is_some() { block.first.map(|v| v - 1) } else { block.first };
        // Of bytes, whatever the voxels: no values are read.
        let points = Points::<()>::new(first, block.end, self.bricks.region());
        let Some(covered) = points.covered_box() else { return Ok(false) };
        let is_gapless = points.is_covered() && store.nodata().is_none() && !store.has_non_finite();
        let (mut may_be_outside, mut may_be_inside) = (!is_gapless, false);
        for id in self.bricks.of_box(covered) {
            let (outside, inside) = match (self.bricks.range(id)?, target.label, self.request.surface) {
                (None, ..) => (true, false),
                (Some((low, high)), Some(label), _) => {
                    let label = label as f64;
                    (low < label || high > label, (low..=high).contains(&label))
                }
                (Some((low, high)), None, MeshSurface::Isosurface(value)) => (low < value, high >= value),
                (Some(_), None, _) => (true, true),
            };
            may_be_outside |= outside;
            may_be_inside |= inside;
            if may_be_outside && may_be_inside {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The parts of some blocks, on all threads: of the first one, and of those after it as long as all together fit the memory.
    fn parts(&self, targets: &[Target], jobs: &[Job]) -> Result<Vec<Part>, ReadError> {
        let held_bytes = AtomicU64::new(0);
        let part = |(i, job): (usize, &Job)| {
            if i > 0 && held_bytes.load(Ordering::Relaxed) > self.waiting_bytes {
                return Ok(None);
            }
            let part = self.part(&targets[job.target], &job.block)?;
            held_bytes.fetch_add(part.bytes(), Ordering::Relaxed);
            Ok(Some(part))
        };
        let parts = jobs.par_iter().enumerate().with_max_len(1).map(part).collect::<Result<Vec<_>, ReadError>>()?;
        Ok(parts.into_iter().map_while(|part| part).collect())
    }

    fn part(&self, target: &Target, block: &Block) -> Result<Part, ReadError> {
        let patch = self.patch(target, block)?;
        let pieces = self.decimation.map(|decimation| decimation.of_patch(&patch));
        Ok(Part { patch, pieces })
    }

    fn patch(&self, target: &Target, block: &Block) -> Result<Patch, ReadError> {
        let (nodata, smoothing) = (self.nodata(), self.request.smoothing);
        with_voxel_type!(self.bricks.store().voxel_type(), T => {
            let read = |[first, last]: [[i64; 3]; 2]| {
                let mut points = Points::<T>::new(first, last, self.bricks.region());
                self.bricks.fill(&mut points).map(|()| points)
            };
            match (target.label, self.request.surface) {
                (Some(label), _) => {
                    let nets = Nets { label, nodata, smoothing };
                    Ok(nets.patch(block, &read(nets.span(block))?, &self.world))
                }
                (None, MeshSurface::Isosurface(value)) => {
                    let surface = Isosurface { value, nodata, smoothing };
                    Ok(surface.patch(block, &read(surface.span(block))?, &self.world))
                }
                (None, _) => Ok(Patch::default()),
            }
        })
    }
}

/// A block's part of the mesh.
struct Part {
    patch: Patch,
    /// The decimated patch; ids are places in it.
    pieces: Option<Vec<(Region, Piece)>>,
}

impl Part {
    fn bytes(&self) -> u64 {
        let pieces = self.pieces.iter().flatten().map(|(_, piece)| piece.held_bytes());
        self.patch.held_bytes() + pieces.sum::<u64>()
    }
}

/// The output so far.
struct Written {
    format: Box<dyn Format>,
    /// Pieces of the last object, if it is decimated.
    pieces: Option<Pieces>,
    objects: Vec<MeshObject>,
    /// Numbers of the last object's vertices, before decimation.
    numbers: Numbers,
    /// A place near the mesh, from which volumes are summed up.
    origin: DVec3,
}

impl Written {
    /// Whether the last object is of this target.
    fn is_in(&self, target: &Target) -> bool {
        self.objects.last().is_some_and(|object| object.label == target.label)
    }

    fn begin(&mut self, target: &Target, name: &str) -> Result<(), MeshError> {
        self.format.begin(name)?;
        self.numbers = Numbers::default();
        self.objects.push(MeshObject { label: target.label, vertices: 0, triangles: 0, area: 0.0, volume: 0.0 });
        Ok(())
    }

    /// Adds a block's part to the last object.
    fn add(&mut self, block: &Block, Part { patch, pieces }: Part) -> Result<(), MeshError> {
        if patch.vertices.is_empty() {
            return Ok(());
        }
        let before = self.numbers.count();
        let starts = self.numbers.add(block.index, &patch.ranks);
        let numbers: Vec<Option<u64>> =
            patch.vertices.iter().map(|vertex| starts[vertex.class.index()].checked_add(vertex.rank.into())).collect();
        if let (Some(kept), Some(pieces)) = (&mut self.pieces, pieces) {
            for (region, mut piece) in pieces {
                for id in &mut piece.ids {
                    *id = numbers[*id as usize].ok_or(MeshError::Contradiction)?;
                }
                kept.add(region, &piece)?;
            }
            return Ok(());
        }
        let mut own = vec![DVec3::ZERO; (self.numbers.count() - before) as usize];
        for (vertex, number) in patch.vertices.iter().zip(&numbers).filter(|(vertex, _)| vertex.class.is_own()) {
            if let Some(number) = number {
                own[(number - before) as usize] = vertex.place;
            }
        }
        own.iter().try_for_each(|place| self.format.vertex(*place))?;
        let Some(object) = self.objects.last_mut() else { return Ok(()) };
        object.vertices += own.len() as u64;
        for triangle in &patch.triangles {
            let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| numbers[vertex as usize]) else {
                return Err(MeshError::Contradiction);
            };
            let places = triangle.map(|vertex| patch.vertices[vertex as usize].place);
            let triangle = Triangle { vertices: [a, b, c], places };
            self.format.triangle(&triangle)?;
            object.count(&triangle, self.origin);
        }
        Ok(())
    }

    /// Ends the last object, if there is one. Calls `go_on` between its pieces, if it is decimated.
    fn end(&mut self, go_on: impl Fn() -> Result<(), MeshError>) -> Result<(), MeshError> {
        let Some(object) = self.objects.last_mut() else { return Ok(()) };
        if let Some(pieces) = &mut self.pieces {
            let format = &mut self.format;
            pieces.drain(|piece, numbered| {
                go_on()?;
                for (place, _) in piece.places.iter().zip(numbered).filter(|(_, numbered)| numbered.is_new) {
                    format.vertex(*place)?;
                    object.vertices += 1;
                }
                for corners in &piece.triangles {
                    let vertices = corners.map(|vertex| numbered[vertex as usize].number);
                    let triangle = Triangle { vertices, places: corners.map(|vertex| piece.places[vertex as usize]) };
                    format.triangle(&triangle)?;
                    object.count(&triangle, self.origin);
                }
                Ok(())
            })?;
        }
        self.format.end()
    }
}

impl MeshObject {
    /// Adds a triangle to the sums; volumes are from `origin`.
    fn count(&mut self, triangle: &Triangle, origin: DVec3) {
        let [p, q, r] = triangle.places.map(|place| place - origin);
        self.triangles += 1;
        self.area += 0.5 * (q - p).cross(r - p).length();
        self.volume += p.dot(q.cross(r)) / 6.0;
    }
}
