//! Exact pictures of any working set: the cells of a cut without a limit of slots, back to front, in passes that fit the slots, each cell
//! with its own brick.
//!
//! Threads read the bricks in the order of the cells, as far ahead as the host budget's buffers allow; a pass is complete once its bricks
//! are there. Passes do not depend on timing. An unreadable brick is replaced by its nearest readable ancestor. Every brick is read and
//! uploaded once per picture. At most a quarter of the host budget goes to the cut, the only part that grows with the working set.

use crate::assemble::PaddedReader;
use crate::budget::{BufferSizes, HostSplit, Meter, PagerConfig, PagerError, TABLE_BYTES_PER_SLOT, fit, split_host};
use crate::buffer_lru::zeroed;
use crate::cut::{Cut, View};
use crate::dither::PixelShare;
use crate::draw_list::{DrawCell, DrawList, Slot};
use crate::layout::Layout;
use crate::leave::Threads;
use crate::ram_cache::RamCache;
use crate::residency::Upload;
use crate::source::{BrickError, BrickSource, caught};
use crate::status::Counters;
use crate::visible_cells::VisibleCells;
use crate::workers::ADVISE_BATCH;
use brickyard_volume::{BrickId, Level};
use crossbeam_channel::{Receiver, Sender, bounded};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Bytes per cell of the cut, including its share of split cells and of growing lists.
const BYTES_PER_CELL: u64 = 384;

/// Error from drawing an exact picture.
#[derive(Debug, thiserror::Error)]
pub enum ExactError {
    /// The passes cannot start: a budget is too small for one brick, the apron or gradients do not fit, or a thread does not start.
    #[error(transparent)]
    Budget(#[from] PagerError),
    /// The host budget cannot hold the list of cells to draw.
    #[error(
        "an exact picture of this view takes more than {cells} bricks, the most in {host_bytes} bytes of host memory"
    )]
    TooManyCells {
        /// The number of cells that would fit.
        cells: usize,
        /// The host budget in bytes.
        host_bytes: u64,
    },
    /// Neither a cell's brick nor any ancestor can be read.
    #[error("a part of the picture cannot be read at any level: {0}")]
    Unreadable(BrickError),
}

/// Reader of one exact picture's bricks, pass by pass as uploads and draw lists.
pub struct ExactPasses {
    cells: Arc<[BrickId]>,
    cache: Arc<RamCache>,
    meter: Arc<Meter>,
    slots: usize,
    /// First cell of the pass, and the pass's draw list so far, by cell.
    start: usize,
    draw: Vec<Option<DrawCell>>,
    placed: usize,
    /// Bricks of later passes.
    early: BTreeMap<usize, StandIn>,
    /// Codes of the last upload, on loan to the caller until the next call.
    handed_out: Option<Arc<[u8]>>,
    readers: Readers,
    /// Counts of uploads.
    counters: Counters,
    effective_error_px: f64,
}

/// The next step of an exact picture.
#[derive(Clone, Debug)]
pub enum Next {
    /// Write a brick into its slot. Earlier draw lists still refer to the slot's former brick.
    Upload(Upload),
    /// Draw the cells of a pass, in front of those of all earlier passes.
    Draw(DrawList),
    /// Nothing has arrived within the timeout: call again.
    Wait,
    /// The picture is complete.
    Done,
}

/// The brick drawn for a cell: its own, or the nearest readable ancestor.
#[derive(Debug)]
struct StandIn {
    brick: BrickId,
    codes: Arc<[u8]>,
}

impl ExactPasses {
    /// Lists the cells and starts reading. Of `config`, only the slots, the apron, the gradient layers, the slot contents, the host budget
    /// and the workers count.
    ///
    /// # Errors
    /// If the host budget cannot hold the cells or a brick in flight, the apron or the gradients do not fit, or no thread can be started.
    pub fn new(source: Arc<dyn BrickSource>, view: &View, config: &PagerConfig) -> Result<Self, ExactError> {
        let contents = config.contents.first().cloned().unwrap_or_default();
        let host_bytes = config.host_bytes;
        let layout = Layout::new(&*source, config.apron, config.gradient_layers, &contents)?;
        let max_cells = (host_bytes / 4 / BYTES_PER_CELL) as usize;
        let cut = Cut::new(&*source, view, max_cells);
        if cut.memory_bound() || cut.wanted() > max_cells {
            return Err(ExactError::TooManyCells { cells: max_cells, host_bytes });
        }
        let back_to_front = VisibleCells::new(&*source, &cut, view).cells;
        let cells: Arc<[BrickId]> = back_to_front.into_iter().map(|ranked| cut.id(ranked.cell)).collect();
        let effective_error_px = cut.effective_error_px();
        drop(cut);
        let padded = layout.padded_bytes() as u64;
        let slots = config.slots.max(1) as usize;
        let tables = cells.len() as u64 * BYTES_PER_CELL + slots.min(cells.len()) as u64 * TABLE_BYTES_PER_SLOT;
        let sizes = fit(&*source, host_bytes, || BufferSizes {
            fixed: tables + source.cache_bytes(),
            scratch: layout.scratch_bytes(&*source),
            core: layout.cached_bytes() as u64,
            padded,
        });
        let HostSplit { workers, staged, cores } = split_host(host_bytes, config.workers, sizes)?;
        let meter = Arc::new(Meter::new(host_bytes));
        meter.charge(sizes.fixed + workers as u64 * sizes.scratch + staged as u64 * padded);
        let cache = RamCache::with_meter(source, layout, contents, cores, config.keeps_decoded, meter.clone());
        let cache = Arc::new(cache);
        let readers = Readers::start(&cache, &cells, workers, staged).map_err(PagerError::Thread)?;
        Ok(Self {
            cells,
            cache,
            meter,
            slots,
            start: 0,
            draw: Vec::new(),
            placed: 0,
            early: BTreeMap::new(),
            handed_out: None,
            readers,
            counters: Counters::default(),
            effective_error_px,
        })
    }

    /// Cells of the picture.
    pub fn cells(&self) -> usize {
        self.cells.len()
    }

    /// Cells of the draw lists returned so far.
    pub fn drawn(&self) -> usize {
        self.start
    }

    /// Passes of the picture.
    pub fn passes(&self) -> usize {
        self.cells.len().div_ceil(self.slots)
    }

    /// Largest screen-space error in pixels among cells coarser than level 0; 0 without any, infinite if the eye is inside one.
    pub fn effective_error_px(&self) -> f64 {
        self.effective_error_px
    }

    /// Peak host memory so far, in bytes.
    pub fn host_bytes_peak(&self) -> u64 {
        self.meter.peak()
    }

    /// Totals so far. `failed` counts unreadable bricks, including those needed only for a neighbour's apron, and stored aprons.
    pub fn counters(&self) -> Counters {
        self.cache.totals().and(&self.counters)
    }

    /// Returns the next step, waiting at most `timeout`. A call ends the use of the last upload.
    ///
    /// # Errors
    /// If neither a cell's brick nor any ancestor can be read.
    pub fn next(&mut self, timeout: Duration) -> Result<Next, ExactError> {
        self.readers.give_back(self.handed_out.take());
        let end = (self.start + self.slots).min(self.cells.len());
        if self.start == end {
            return Ok(Next::Done);
        }
        if self.draw.is_empty() {
            self.draw.resize(end - self.start, None);
        }
        if self.placed == self.draw.len() {
            (self.start, self.placed) = (end, 0);
            return Ok(Next::Draw(DrawList { cells: std::mem::take(&mut self.draw).into_iter().flatten().collect() }));
        }
        loop {
            if let Some(entry) = self.early.first_entry().filter(|entry| *entry.key() < end) {
                let (at, stand_in) = entry.remove_entry();
                return Ok(Next::Upload(self.place(at, stand_in)));
            }
            let Ok((at, result)) = self.readers.arrivals.recv_timeout(timeout) else { return Ok(Next::Wait) };
            self.early.insert(at, result.map_err(ExactError::Unreadable)?);
        }
    }

    /// Gives a cell's brick its slot in the pass.
    fn place(&mut self, at: usize, StandIn { brick, codes }: StandIn) -> Upload {
        let (cell, place) = (self.cells[at], at - self.start);
        let slot = Slot(place as u32);
        let region = self.cache.source().pyramid().brick_box_voxel(cell.level, cell.index);
        self.draw[place] = Some(DrawCell { cell, region, pixels: PixelShare::ALL, brick, slot, rank: at as u32 });
        self.placed += 1;
        self.counters.uploaded += 1;
        self.counters.bytes_uploaded += codes.len() as u64;
        self.handed_out = Some(codes.clone());
        Upload { volume: 0, slot, brick, codes }
    }
}

/// The threads. Counted buffers, one per taken cell, limit reading ahead; and the first missing cell always has a buffer, so it arrives.
struct Readers {
    free: Sender<Arc<[u8]>>,
    arrivals: Receiver<(usize, Result<StandIn, BrickError>)>,
    /// Dropped after the channels, whose end stops the threads.
    threads: Threads,
}

impl Readers {
    fn start(cache: &Arc<RamCache>, cells: &Arc<[BrickId]>, threads: u32, staged: usize) -> std::io::Result<Self> {
        let (free, taken) = bounded::<Arc<[u8]>>(staged);
        let (sender, arrivals) = bounded(staged);
        for _ in 0..staged {
            // There is room, and a receiver: both ends are here.
            let _ = free.send(zeroed(cache.layout.padded_bytes()));
        }
        let next = Arc::new(AtomicUsize::new(0));
        let mut readers = Self { free, arrivals, threads: Threads::default() };
        for i in 0..threads {
            let (cells, next, taken, sender) = (cells.clone(), next.clone(), taken.clone(), sender.clone());
            let mut reader = PaddedReader::new(cache.clone());
            let work = move || {
                for mut codes in taken {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(&cell) = cells.get(at) else { return };
                    let read = caught(cell, "the reader", || {
                        if at % ADVISE_BATCH == 0 {
                            reader.cache.source().advise(&cells[at..cells.len().min(at + ADVISE_BATCH)]);
                        }
                        // A buffer from the channel has one holder, so the copy never happens.
                        read_nearest(&mut reader, cell, Arc::make_mut(&mut codes))
                    });
                    if sender.send((at, read.map(|brick| StandIn { brick, codes }))).is_err() {
                        return;
                    }
                }
            };
            readers.threads.start(format!("exact-reader-{i}"), work)?;
        }
        Ok(readers)
    }

    /// Takes a buffer back; one with another holder is left to that holder and replaced.
    fn give_back(&self, codes: Option<Arc<[u8]>>) {
        let Some(mut codes) = codes else { return };
        if Arc::get_mut(&mut codes).is_none() {
            codes = zeroed(codes.len());
        }
        // Fails once all cells have been taken: the buffer is no longer needed.
        let _ = self.free.try_send(codes);
    }
}

/// Reads a brick or its nearest readable ancestor, and returns which.
fn read_nearest(reader: &mut PaddedReader, cell: BrickId, codes: &mut [u8]) -> Result<BrickId, BrickError> {
    let mut brick = cell;
    let mut first_error = None;
    loop {
        match reader.read(brick, codes) {
            Ok(()) => return Ok(brick),
            Err(error) => {
                let error = first_error.get_or_insert(error);
                let parent = reader.cache.source().pyramid().parent(brick.level, brick.index);
                let Some(index) = parent else { return Err(error.clone()) };
                brick = BrickId { level: Level(brick.level.0 + 1), index, ..brick };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::{TestSource, box_view, config};
    use brickyard_volume::{BrickIndex, LevelPolicy, Projection};
    use std::collections::HashMap;

    const DEADLINE: Duration = Duration::from_secs(20);

    fn finest(source: &TestSource) -> View {
        let view = box_view(source, Projection::Perspective { fov_y_deg: 30.0 });
        View { level: LevelPolicy::Locked(0), ..view }
    }

    /// All drawn cells, with the codes in their slots at that time.
    fn run(passes: &mut ExactPasses) -> Vec<(DrawCell, Vec<u8>)> {
        let (mut atlas, mut drawn, mut lists) = (HashMap::new(), Vec::new(), 0);
        loop {
            match passes.next(DEADLINE).unwrap() {
                Next::Upload(upload) => drop(atlas.insert(upload.slot, (upload.brick, upload.codes.to_vec()))),
                Next::Draw(list) => {
                    lists += 1;
                    for cell in list.cells {
                        let (brick, codes) = &atlas[&cell.slot];
                        assert_eq!(*brick, cell.brick);
                        drawn.push((cell, codes.clone()));
                    }
                }
                Next::Wait => panic!("nothing comes"),
                Next::Done => {
                    assert_eq!((lists, drawn.len()), (passes.passes(), passes.cells()));
                    return drawn;
                }
            }
        }
    }

    #[test]
    fn passes_draw_every_cell_of_the_cut_in_its_order_within_the_budgets() {
        let source = Arc::new(TestSource::cube(64));
        let view = finest(&source);
        let cut = Cut::new(&*source, &view, usize::MAX);
        let back_to_front = VisibleCells::new(&*source, &cut, &view).cells;
        let expected: Vec<BrickId> = back_to_front.into_iter().map(|ranked| cut.id(ranked.cell)).collect();
        assert_eq!(expected.len(), 512);
        let mut codes = None;
        for (slots, passes) in [(1, 512), (7, 74), (512, 1), (9000, 1)] {
            // Cells, a few slots and some 20 of 512 cores.
            let config = config(slots, 4 * 600 * BYTES_PER_CELL);
            let mut exact = ExactPasses::new(source.clone(), &view, &config).unwrap();
            assert_eq!((exact.passes(), exact.cells()), (passes, 512));
            let drawn = run(&mut exact);
            assert!(drawn.iter().map(|(cell, _)| cell.cell).eq(expected.iter().copied()));
            assert!(drawn.iter().all(|(cell, _)| cell.cell == cell.brick && cell.slot.0 < slots));
            let counters = exact.counters();
            assert_eq!((counters.uploaded, counters.bytes_uploaded, counters.failed), (512, 512_000, 0));
            assert!(exact.host_bytes_peak() <= config.host_bytes);
            let found: Vec<_> = drawn.into_iter().map(|(_, codes)| codes).collect();
            assert!(*codes.get_or_insert_with(|| found.clone()) == found, "{slots} slots: other codes");
        }
    }

    #[test]
    fn the_nearest_readable_ancestor_stands_in() {
        let brick = |level, x| BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::new(x, 0, 0) };
        let mut source = TestSource::cube(64);
        source.failing = [brick(0, 2), brick(0, 5), brick(1, 2)].into();
        let source = Arc::new(source);
        let drawn = run(&mut ExactPasses::new(source.clone(), &finest(&source), &config(50, 1 << 20)).unwrap());
        let other: Vec<_> = drawn.iter().filter(|(cell, _)| cell.cell != cell.brick).collect();
        let mut found: Vec<_> = other.iter().map(|(cell, _)| (cell.cell, cell.brick)).collect();
        found.sort();
        assert_eq!(found, [(brick(0, 2), brick(1, 1)), (brick(0, 5), brick(2, 1))]);

        let mut source = TestSource::cube(8);
        source.failing = [brick(0, 0)].into();
        let source = Arc::new(source);
        let mut exact = ExactPasses::new(source.clone(), &finest(&source), &config(50, 1 << 20)).unwrap();
        assert!(matches!(exact.next(DEADLINE), Err(ExactError::Unreadable(error)) if error.id == brick(0, 0)));
    }

    #[test]
    fn a_panic_beside_the_decoder_ends_the_passes() {
        let mut source = TestSource::cube(32);
        source.advice = |_| panic!("told to");
        let source = Arc::new(source);
        let mut exact = ExactPasses::new(source.clone(), &finest(&source), &config(50, 1 << 20)).unwrap();
        let ended = (0..100).find_map(|_| exact.next(DEADLINE).err()).expect("a brick is missing");
        assert!(matches!(&ended, ExactError::Unreadable(error) if error.reason.contains("panicked")), "{ended}");
    }

    #[test]
    fn bricks_that_fail_for_a_passing_reason_are_waited_for() {
        let make = || Arc::new(TestSource::cube(32));
        let source = make();
        let brick = |x| BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 1, 1) };
        *source.passing.lock().unwrap() = [(brick(1), 3), (brick(2), 1)].into();
        let drawn = |source: &Arc<TestSource>| {
            let mut exact = ExactPasses::new(source.clone(), &finest(source), &config(50, 1 << 20)).unwrap();
            let drawn = run(&mut exact);
            assert_eq!(exact.counters().failed, 0);
            drawn
        };
        assert!(drawn(&source) == drawn(&make()));
        assert_eq!(*source.reads.lock().unwrap(), [(brick(1), 3), (brick(2), 1)].into());
    }

    #[test]
    fn what_does_not_fit_is_refused_and_what_is_left_ends() {
        let source = Arc::new(TestSource::cube(64));
        let new = |host_bytes| ExactPasses::new(source.clone(), &finest(&source), &config(9, host_bytes));
        let little = 4 * 511 * BYTES_PER_CELL;
        assert!(matches!(new(little), Err(ExactError::TooManyCells { cells: 511, .. })));
        // Dropped in the middle, with everything under way.
        let mut exact = new(1 << 20).ok().unwrap();
        assert!(matches!(exact.next(DEADLINE), Ok(Next::Upload(_))));
    }
}
