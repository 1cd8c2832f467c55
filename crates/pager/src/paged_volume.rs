//! A paged volume: its RAM cache with the workers that fill it, its visibility feedback, and its last draw list.

use crate::budget::{BufferSizes, HostSplit, Meter, PagerConfig, PagerError, Planning, fit, split_host};
use crate::cut::{Cut, NodeId, View};
use crate::draw_list::DrawList;
use crate::goal::Goal;
use crate::layout::Layout;
use crate::paged_occupancy::{PageReader, PagedOccupancy, kept_bytes};
use crate::ram_cache::{KeptCores, RamCache};
use crate::residency::{Residency, Wants};
use crate::sameness::{SlotsByContent, kept_hash_bytes};
use crate::slot_contents::SlotContents;
use crate::source::{BrickError, BrickSource};
use crate::status::Counters;
use crate::tier::Tier;
use crate::visibility::Visibility;
use crate::visible_cells::VisibleCells;
use crate::workers::Workers;
use brickyard_volume::BrickId;
use crossbeam_channel::Select;
use std::sync::Arc;

/// A paged volume: source, RAM cache, workers, and the bricks of its last frame.
pub(crate) struct PagedVolume {
    pub(crate) source: Arc<dyn BrickSource>,
    cache: Arc<RamCache>,
    workers: Workers,
    /// Occupancy for a planner that must not wait; `None` for inline planning.
    occupancy: Option<PageReader>,
    /// View of the last frame.
    view: Option<View>,
    /// Reported visibility of the volume's cells, and its version; `None` without reports.
    pub(crate) visibility: Option<(u64, Arc<Visibility>)>,
    /// Version of the visibility confirmed by a complete frame of this view.
    confirmed: u64,
    /// Cells of the last draw list's entries, then of the other eye's.
    drawn: Arc<Vec<BrickId>>,
    /// Version of the visibility used by the last frame.
    gone_by: u64,
    /// Uploads of the last frame: host memory until the next call.
    handed_out: Vec<Arc<[u8]>>,
}

/// Drawn cells of a frame, for feedback on it. To be kept from a visibility query to its result, however many frames later.
#[derive(Clone, Debug)]
pub struct DrawnCells {
    view: View,
    cells: Arc<Vec<BrickId>>,
    /// Whether nothing was left in flight for the frame, and the version of its visibility.
    is_complete: bool,
    gone_by: u64,
}

impl DrawnCells {
    /// Entries of the frame's draw list, plus those of any list for the other eye.
    pub fn entries(&self) -> usize {
        self.cells.len()
    }
}

/// Visible cells of a volume: counts, and screen areas.
pub(crate) struct Seen {
    pub(crate) wanted: usize,
    pub(crate) resident: usize,
    pub(crate) failed: usize,
    pub(crate) area: f64,
    pub(crate) resident_area: f64,
    pub(crate) is_covered: bool,
    /// Error behind a cell drawn with nothing, now and later, if any.
    pub(crate) error: Option<BrickError>,
}

impl PagedVolume {
    /// Starts the workers of a volume within its share of the host budget, charged to `meter`. `held` has the contents of its slots; `kept`
    /// has cores from earlier reads.
    ///
    /// # Errors
    /// If the share cannot feed one worker, the apron or the gradients do not fit the bricks, or no thread can be started.
    pub(crate) fn start(
        source: &Arc<dyn BrickSource>,
        contents: &SlotContents,
        host_bytes: u64,
        config: &PagerConfig,
        meter: &Arc<Meter>,
        held: &Arc<SlotsByContent>,
        kept: Option<KeptCores>,
    ) -> Result<Self, PagerError> {
        let layout = Layout::new(&**source, config.apron, config.gradient_layers, contents)?;
        let sizes = fit(&**source, host_bytes, || buffer_sizes(&**source, &layout, config.planning, host_bytes));
        let HostSplit { workers, staged, cores } = split_host(host_bytes, config.workers, sizes)?;
        meter.charge(sizes.fixed + workers as u64 * sizes.scratch);
        let cache =
            RamCache::with_meter(source.clone(), layout, contents.clone(), cores, config.keeps_decoded, meter.clone());
        let cache = Arc::new(cache.comparing(kept_hash_bytes(&**source, host_bytes)));
        kept.into_iter().for_each(|kept| cache.adopt(kept));
        let workers = Workers::start(&cache, workers, staged, meter.clone(), held.clone())?;
        let occupancy = match config.planning {
            Planning::Inline => None,
            Planning::Thread => Some(PageReader::start(source.clone(), kept_bytes(&**source, host_bytes))?),
        };
        Ok(Self {
            source: source.clone(),
            cache,
            workers,
            occupancy,
            view: None,
            visibility: None,
            confirmed: 0,
            drawn: Arc::default(),
            gone_by: 0,
            handed_out: Vec::new(),
        })
    }

    pub(crate) fn into_cores(self) -> KeptCores {
        let Self { cache, workers, .. } = self;
        drop(workers);
        cache.kept_cores()
    }

    /// Source for making cuts: the volume's own, or one with known occupancy that never waits.
    pub(crate) fn planned_source(&self) -> Arc<dyn BrickSource> {
        self.occupancy.as_ref().map_or_else(|| self.source.clone(), |reader| reader.occupancy.clone())
    }

    /// Checks that the source has a view's time step and channel.
    ///
    /// # Panics
    /// If it does not.
    pub(crate) fn expect(&self, view: &View) {
        assert!(view.time < self.source.times(), "time step {} of {}", view.time, self.source.times());
        assert!(view.channel < self.source.channels(), "channel {} of {}", view.channel, self.source.channels());
    }

    /// Begins a frame: receives arrived bricks, and the view. `number` is the volume's index in the residency. During playback, failures
    /// are not retried for each step.
    ///
    /// # Panics
    /// If the source has no such time step or channel.
    pub(crate) fn begin_frame(&mut self, number: usize, view: &View, is_playing: bool, residency: &mut Residency) {
        self.expect(view);
        self.take_back();
        self.gone_by = self.visibility.as_ref().map_or(0, |(number, _)| *number);
        while let Some(arrival) = self.workers.try_receive() {
            residency.arrive(number, arrival);
        }
        if self.view.as_ref() != Some(view) {
            if !is_playing {
                residency.forget_failures(number, &self.cache.renew_failures());
            }
            self.confirmed = 0;
            self.occupancy.iter().for_each(|reader| reader.occupancy.begin_view());
            self.view = Some(view.clone());
        }
    }

    /// Version of the known occupancy of the volume's bricks.
    pub(crate) fn occupancy_version(&self) -> u64 {
        self.occupancy.as_ref().map_or(0, |reader| reader.occupancy.version())
    }

    /// Whether this occupancy version is the newest, with no page in flight.
    pub(crate) fn knows_since(&self, version: u64) -> bool {
        let knows = |occupancy: &PagedOccupancy| !occupancy.is_waiting() && occupancy.version() == version;
        self.occupancy.as_ref().is_none_or(|reader| knows(&reader.occupancy))
    }

    pub(crate) fn wants<'a>(&'a self, cut: &'a Cut, sight: &'a VisibleCells) -> Wants<'a> {
        Wants { goal: Goal { pyramid: self.source.pyramid(), cut }, sight }
    }

    /// Records the cells of the frame's draw lists, for feedback.
    pub(crate) fn note_drawn<'a>(&mut self, lists: impl Iterator<Item = &'a DrawList>) {
        self.drawn = Arc::new(lists.flat_map(|draw| &draw.cells).map(|cell| cell.cell).collect());
    }

    /// Drawn cells of the last frame, for feedback; `None` before the first frame.
    pub(crate) fn drawn(&self, is_complete: bool) -> Option<DrawnCells> {
        let view = self.view.clone()?;
        Some(DrawnCells { view, cells: self.drawn.clone(), is_complete, gone_by: self.gone_by })
    }

    /// Visible part of a cut, given the resident cells in view and the failed bricks.
    pub(crate) fn seen<'a>(
        &self,
        cut: &Cut,
        sight: &VisibleCells,
        is_resident: &[bool],
        failure: impl Fn(BrickId) -> Option<&'a BrickError>,
    ) -> Seen {
        let (mut wanted, mut resident, mut failed, mut area, mut resident_area) = (0, 0, 0, 0.0, 0.0);
        let is_seen = |cell: &NodeId| !cut.is_hidden(*cell);
        let cells = || sight.cells.iter().map(|ranked| ranked.cell);
        for ((cell, &cell_area), &is_resident) in cells().zip(&sight.areas).zip(is_resident) {
            if !is_seen(&cell) {
                continue;
            }
            wanted += 1;
            area += cell_area;
            // Cells not wanted by the cut are coarser than the view will need.
            if is_resident && cut.is_visible(cell) {
                resident += 1;
                resident_area += cell_area;
            } else {
                failed += failure(cut.id(cell)).is_some() as usize;
            }
        }
        let mut drawn = self.drawn.iter().peekable();
        // One entry, or two.
        let mut entries = |cell| std::iter::from_fn(|| drawn.next_if_eq(&&cell)).count();
        let mut left_out = cells().filter(|&cell| entries(cut.id(cell)) == 0).filter(is_seen).peekable();
        let is_covered = left_out.peek().is_none();
        // It stays left out if no stand-in can be read.
        let is_lost = |cell: &NodeId| cut.path_to_root(*cell).all(|node| failure(cut.id(node)).is_some());
        let error = left_out.find(is_lost).and_then(|cell| failure(cut.id(cell)).cloned());
        Seen { wanted, resident, failed, area, resident_area, is_covered, error }
    }

    /// Replaces the workers' plan. Takes back the stale buffers at once, and the handed-out ones with the next frame or wait.
    pub(crate) fn request(
        &mut self,
        requests: Vec<(Tier, BrickId)>,
        stale: Vec<Arc<[u8]>>,
        handed_out: impl Iterator<Item = Arc<[u8]>>,
    ) {
        self.workers.give_back(stale);
        self.workers.replace(requests, self.source.is_backed_up());
        self.handed_out.extend(handed_out);
    }

    /// Takes another buffer in place of one handed out by the last frame.
    pub(crate) fn take_for(&mut self, codes: &Arc<[u8]>, other: Arc<[u8]>) {
        if let Some(handed_out) = self.handed_out.iter_mut().find(|handed_out| Arc::ptr_eq(handed_out, codes)) {
            *handed_out = other;
        }
    }

    /// Takes back the buffers handed out by the last frame, or their replacements.
    pub(crate) fn take_back(&mut self) {
        self.workers.give_back(self.handed_out.drain(..));
    }

    /// Takes the renderer's feedback on the volume: see [`Pager::feedback`](crate::Pager::feedback).
    pub(crate) fn feedback(&mut self, drawn: &DrawnCells, visibility: &[f32]) {
        assert_eq!(visibility.len(), drawn.cells.len(), "visibility of another draw list");
        let told = drawn.cells.iter().copied().zip(visibility.iter().copied());
        let told = Visibility::new(self.source.pyramid(), &drawn.view, told);
        let Some(view) = self.view.as_ref().filter(|view| told.is_of_content(view)) else { return };
        let is_present = *view == drawn.view;
        let (number, has_changed) = match &mut self.visibility {
            // Copied if the planner holds it.
            Some((number, known)) if known.is_of(&drawn.view) => (*number, Arc::make_mut(known).add(told)),
            known => {
                let number = known.as_ref().map_or(0, |(number, _)| *number);
                *known = Some((number, Arc::new(told)));
                (number, true)
            }
        };
        if has_changed {
            self.visibility.iter_mut().for_each(|(number, _)| *number += 1);
        } else if is_present && drawn.is_complete && drawn.gone_by == number {
            self.confirmed = number;
        }
    }

    /// Whether a complete frame has confirmed the visibility in this view. Also true without feedback on its content, as for projections.
    pub(crate) fn is_confirmed(&self) -> bool {
        let is_told = |visibility: &Visibility| self.view.as_ref().is_some_and(|view| visibility.is_of_content(view));
        self.visibility.as_ref().is_none_or(|(number, told)| *number == self.confirmed || !is_told(told))
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.workers.is_busy() || self.occupancy.as_ref().is_some_and(|reader| reader.occupancy.is_waiting())
    }

    /// Whether a brick or a page of occupancy waits for a frame.
    pub(crate) fn has_arrivals(&self) -> bool {
        self.take_sign() || !self.workers.arrivals.is_empty()
    }

    /// Adds the channels of bricks and pages to `select`.
    pub(crate) fn select<'a>(&'a self, select: &mut Select<'a>) {
        if let Some(reader) = &self.occupancy {
            select.recv(&reader.arrivals);
        }
        select.recv(&self.workers.arrivals);
    }

    /// Takes the signal of arrived occupancy pages. Returns whether there was one.
    pub(crate) fn take_sign(&self) -> bool {
        self.occupancy.as_ref().is_some_and(|reader| reader.arrivals.try_recv().is_ok())
    }

    /// Decoding totals since the start. Bytes read are 0 unless `counts_reads`.
    pub(crate) fn counters(&self, counts_reads: bool) -> Counters {
        let totals = self.cache.totals();
        Counters { bytes_read: if counts_reads { totals.bytes_read } else { 0 }, ..totals }
    }
}

pub(crate) fn buffer_sizes(
    source: &dyn BrickSource,
    layout: &Layout,
    planning: Planning,
    host_bytes: u64,
) -> BufferSizes {
    let pages = match planning {
        Planning::Inline => 0,
        Planning::Thread => kept_bytes(source, host_bytes),
    };
    BufferSizes {
        fixed: source.cache_bytes() + pages + kept_hash_bytes(source, host_bytes),
        scratch: layout.scratch_bytes(source),
        core: layout.cached_bytes() as u64,
        padded: layout.padded_bytes() as u64,
    }
}
