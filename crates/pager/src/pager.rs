//! The pager itself: joins the pure steps to the workers, frame by frame.
//!
//! Per frame: what has arrived is taken in; the newest cut is taken, and what the view sees of it; arrived bricks get slots;
//! the draw list and the next plan follow from what is resident. The calling thread never reads or decodes.

use crate::budget::{
    BufferSizes, HostSplit, Meter, PagerConfig, PagerError, TABLE_BYTES_PER_SLOT, least_host, split_host,
};
use crate::cut::{Cut, View, roots};
use crate::draw_list::DrawList;
use crate::ensemble::Wish;
use crate::governor::Governor;
use crate::layout::Layout;
use crate::motion::Motion;
use crate::paged_occupancy::{self, PageReader, PagedOccupancy};
use crate::planner::{Job, Outlook, Planner, Planning};
use crate::ram_cache::{RamCache, encoding_of, layout_of, scratch_bytes};
use crate::residency::{Residency, Step, Upload, Wants};
use crate::sight::Sight;
use crate::source::{BrickError, BrickSource};
use crate::visibility::Visibility;
use crate::workers::Workers;
use brickyard_volume::{BrickId, SlotEncoding};
use crossbeam_channel::{Receiver, Select};
use std::sync::Arc;
use std::time::Duration;

/// One frame's work for the renderer.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Bricks to write into their slots, in order, before drawing. They replace only what this frame does not draw. A
    /// renderer may keep the codes instead of copying them (they are then its own memory, not the pager's).
    pub uploads: Vec<Upload>,
    /// What to draw: after the uploads, every slot it names holds its brick.
    pub draw: DrawList,
    /// The same entries back to front for the view's other eye, if it has one.
    pub draw_other_eye: Option<DrawList>,
    /// How far the view is.
    pub status: Status,
}

/// How far a view is, and what it has cost.
#[derive(Clone, Debug)]
pub struct Status {
    /// Cells that the view sees, those aside that are known to be hidden.
    pub wanted: usize,
    /// Cells drawn with their own brick, at the level that the view wants.
    pub resident: usize,
    /// Cells whose own brick cannot be read, nor at the last try: an ancestor stands in.
    pub failed: usize,
    /// Whether nothing more will come: every cell of the view's own cut is resident, or failed with its stand-in resident;
    /// none fades in any more; and, where feedback is given, that of such a frame has changed nothing.
    pub settled: bool,
    /// Whether nothing more will come before it is known what is seen of this frame: see [`Pager::feedback`].
    pub awaits_feedback: bool,
    /// Whether every cell is drawn with something. False only before a volume's coarsest bricks have arrived, when nothing is
    /// drawn, or with `error`.
    pub covered: bool,
    /// Share of the screen area of all cells that is drawn with the cells' own bricks, 0 to 1.
    pub completeness: f64,
    /// Largest error, in pixels, among cells that a finer level could improve; 0 if there are none, infinite where the eye
    /// is inside one.
    pub effective_error_px: f64,
    /// The error asked for.
    pub pixel_error: f64,
    /// Whether the cut would be finer with more slots.
    pub memory_bound: bool,
    /// A settled view has cells for which neither their brick nor any ancestor can be read: one of the reasons.
    pub error: Option<BrickError>,
    /// Bytes of all slots.
    pub gpu_bytes: u64,
    /// Bytes of host memory in use.
    pub host_bytes: u64,
    /// The most so far.
    pub host_bytes_peak: u64,
    /// Totals since the pager was made.
    pub counters: Counters,
}

impl Status {
    /// That of two volumes in one picture.
    pub fn and(&self, other: &Self) -> Self {
        let (a, b) = (self.wanted as f64, other.wanted as f64);
        let completeness = (self.completeness * a + other.completeness * b) / (a + b);
        Self {
            wanted: self.wanted + other.wanted,
            resident: self.resident + other.resident,
            failed: self.failed + other.failed,
            settled: self.settled && other.settled,
            awaits_feedback: self.awaits_feedback || other.awaits_feedback,
            covered: self.covered && other.covered,
            completeness: if a + b > 0.0 { completeness } else { 1.0 },
            effective_error_px: self.effective_error_px.max(other.effective_error_px),
            pixel_error: self.pixel_error,
            memory_bound: self.memory_bound || other.memory_bound,
            error: self.error.clone().or_else(|| other.error.clone()),
            gpu_bytes: self.gpu_bytes + other.gpu_bytes,
            host_bytes: self.host_bytes + other.host_bytes,
            // At most: they need not have come at the same time.
            host_bytes_peak: self.host_bytes_peak + other.host_bytes_peak,
            counters: self.counters.and(&other.counters),
        }
    }
}

/// Totals since the pager was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Cores decoded, with repeats.
    pub decoded: u64,
    /// Encoded bytes that the source has read for them and for stored aprons, and for whoever else uses it.
    pub bytes_read: u64,
    /// Bytes of voxels that came out, those of stored aprons included.
    pub bytes_decoded: u64,
    /// Bricks that could not be read, each counted once, whether wanted for themselves or for a neighbour's apron; and stored
    /// aprons.
    pub failed: u64,
    /// Bricks uploaded, with repeats.
    pub uploaded: u64,
    /// Uploads of bricks among the last evicted ones (as many as there are slots are remembered): a measure of thrash.
    pub reuploaded: u64,
    /// Uploads of bricks that no view wanted yet.
    pub uploaded_ahead: u64,
    /// Bytes uploaded.
    pub bytes_uploaded: u64,
}

impl Counters {
    fn and(&self, other: &Self) -> Self {
        Self {
            decoded: self.decoded + other.decoded,
            bytes_read: self.bytes_read + other.bytes_read,
            bytes_decoded: self.bytes_decoded + other.bytes_decoded,
            failed: self.failed + other.failed,
            uploaded: self.uploaded + other.uploaded,
            reuploaded: self.reuploaded + other.reuploaded,
            uploaded_ahead: self.uploaded_ahead + other.uploaded_ahead,
            bytes_uploaded: self.bytes_uploaded + other.bytes_uploaded,
        }
    }
}

/// How far ahead bricks are fetched: about as long as a few hundred take to come from a disk.
const FETCH_TIME: Duration = Duration::from_millis(300);

/// After how long a frame is worth its while because of what fades in: a sixtieth of a second.
const FADE_STEP: Duration = Duration::from_millis(16);

/// What feedback is about.
#[derive(Debug, Default)]
struct Drawn {
    /// Of each entry of the list, and of the other eye's, its cell.
    cells: Vec<BrickId>,
    /// Whether nothing more was on its way.
    is_complete: bool,
    /// Whether a brick was fading in.
    is_fading: bool,
}

/// Pages the bricks of one source for one view at a time.
pub struct Pager {
    source: Arc<dyn BrickSource>,
    /// What the source had read before.
    bytes_read_before: u64,
    config: PagerConfig,
    cache: Arc<RamCache>,
    meter: Arc<Meter>,
    workers: Workers,
    residency: Residency,
    /// What bricks can show, where planning must not wait for it.
    occupancy: Option<(Arc<PagedOccupancy>, PageReader)>,
    planner: Planner,
    /// The last frame's view and cut, and what the one saw of the other.
    sight: Option<(View, Arc<Cut>, Sight)>,
    motion: Motion,
    /// What has been told of the visibility of cells, and how often that has changed.
    visibility: Option<(u64, Arc<Visibility>)>,
    /// The number of the visibility that a complete frame of this view has confirmed.
    confirmed: u64,
    /// The last frame's draw list.
    drawn: Drawn,
    governor: Governor,
    /// The last frame's time.
    last_at: Duration,
    /// The coarsest bricks of the last view's time and channel: pinned.
    roots: Vec<BrickId>,
    /// The last frame's uploads: host memory until the next call.
    handed_out: Vec<Arc<[u8]>>,
}

impl Pager {
    /// Starts the workers; nothing is read until the first frame.
    ///
    /// # Errors
    /// If a budget cannot hold what must be there at the same time (the error says the least that works), the apron does
    /// not fit, or no thread can be started.
    pub fn new(source: Arc<dyn BrickSource>, config: PagerConfig) -> Result<Self, PagerError> {
        let layout = layout_of(&*source, config.apron, config.gradient_layers)?;
        check_slots(&*source, config.slots, layout.padded_bytes() as u64)?;
        let sizes = buffer_sizes(&*source, &layout, &config);
        let HostSplit { workers, staged, cores } = split_host(config.host_bytes, config.workers, sizes)?;
        let meter = Arc::new(Meter::new(config.host_bytes));
        meter.charge(sizes.fixed + workers as u64 * sizes.scratch);
        let cache = Arc::new(RamCache::with_meter(source.clone(), layout, cores, meter.clone()));
        let workers = Workers::start(&cache, workers, staged, meter.clone())?;
        let residency = Residency::new(config.slots, config.fade);
        let governor = Governor::new(config.uploads);
        let occupancy = match config.planning {
            Planning::Inline => None,
            Planning::Thread => {
                Some(PagedOccupancy::start(source.clone(), paged_occupancy::kept_bytes(&*source, config.host_bytes))?)
            }
        };
        let planner = Planner::new(&planned_source(&source, &occupancy), config.slots, config.planning)?;
        let bytes_read_before = source.bytes_read();
        Ok(Self {
            source,
            bytes_read_before,
            config,
            cache,
            meter,
            workers,
            residency,
            occupancy,
            planner,
            sight: None,
            motion: Motion::default(),
            visibility: None,
            confirmed: 0,
            drawn: Drawn::default(),
            governor,
            last_at: Duration::ZERO,
            roots: Vec::new(),
            handed_out: Vec::new(),
        })
    }

    /// What of a host budget a pager of this configuration needs at least, and more than what is of no use to it.
    ///
    /// # Errors
    /// If the apron does not fit.
    pub fn host_wish(source: &dyn BrickSource, config: &PagerConfig) -> Result<Wish, PagerError> {
        let layout = layout_of(source, config.apron, config.gradient_layers)?;
        let sizes = buffer_sizes(source, &layout, config);
        let BufferSizes { fixed, scratch, core, padded } = sizes;
        let workers = config.workers.max(1) as u64;
        // A cache of every brick, and an eighth of it all for those on their way.
        let cores = source.pyramid().brick_count().saturating_mul(core);
        let most = cores.saturating_add(fixed + workers * (scratch + core + padded)).saturating_mul(8) / 7;
        Ok(Wish { bytes: 1, least: least_host(sizes), most })
    }

    /// What to upload and draw for `view` now, where `at` is the time since some moment that stays the same: motion and fades
    /// are measured by it. Calling it says that the last frame's uploads are done with.
    ///
    /// # Panics
    /// If the source has no such time step or channel.
    pub fn frame(&mut self, view: &View, at: Duration) -> Frame {
        assert!(view.time < self.source.times(), "time step {} of {}", view.time, self.source.times());
        assert!(view.channel < self.source.channels(), "channel {} of {}", view.channel, self.source.channels());
        self.workers.give_back(self.handed_out.drain(..));
        while let Some(arrival) = self.workers.try_receive() {
            self.residency.arrive(arrival);
        }
        let last = self.sight.as_ref().map(|(last, ..)| last);
        if last.is_none_or(|last| (last.time, last.channel) != (view.time, view.channel)) {
            self.roots = roots(&*self.source, view.time, view.channel);
        }
        let is_new = last != Some(view);
        if is_new {
            self.residency.forget_failures(&self.cache.renew_failures());
            self.confirmed = 0;
        }
        let mut occupancy_version = 0;
        if let Some((occupancy, _)) = &self.occupancy {
            if is_new {
                occupancy.begin_view();
            }
            occupancy_version = occupancy.version();
        }
        self.motion.see(at, &view.rays);
        let visibility = self.visibility.clone();
        let ahead = self.config.prefetch.then(|| self.motion.foresee(FETCH_TIME));
        let Outlook { cut, ahead } =
            self.planner.outlook(Job { view: view.clone(), visibility, ahead, occupancy: occupancy_version });
        let sight = match self.sight.take() {
            Some((last, of, sight)) if last == *view && Arc::ptr_eq(&of, &cut) => sight,
            _ => Sight::new(&*planned_source(&self.source, &self.occupancy), &cut, view),
        };
        let (pyramid, roots) = (self.source.pyramid(), &self.roots);
        let wants = Wants { pyramid, cut: &cut, sight: &sight, roots, ahead: &ahead };
        let step = self.residency.step(&wants, self.governor.bytes(at.saturating_sub(self.last_at)), at);
        self.last_at = at;
        self.governor.spent(step.uploads.iter().map(|upload| upload.codes.len() as u64).sum());
        let is_known = self
            .occupancy
            .as_ref()
            .is_none_or(|(occupancy, _)| !occupancy.is_waiting() && occupancy.version() == occupancy_version);
        let is_complete = step.settled && self.planner.is_done() && is_known;
        let draw_other_eye = sight.for_other_eye.as_ref().map(|order| step.draw.reordered(&cut, order));
        let lists = std::iter::once(&step.draw).chain(&draw_other_eye);
        let cells = lists.flat_map(|draw| &draw.cells).map(|cell| cell.cell).collect();
        self.drawn = Drawn { cells, is_complete, is_fading: step.draw.is_fading() };
        let status = self.status(&cut, &sight, &step);
        let Step { uploads, draw, requests, stale, .. } = step;
        self.workers.give_back(stale);
        self.workers.replace(requests);
        self.handed_out.extend(uploads.iter().map(|upload| upload.codes.clone()));
        self.sight = Some((view.clone(), cut, sight));
        Frame { uploads, draw, draw_other_eye, status }
    }

    /// What the renderer saw of the last frame: for each entry of its draw list, in its order, the greatest transmittance with
    /// which any ray of its pixels entered the cell; 0 if none did, 1 if it is seen in the open; then the same for the list of
    /// the other eye, if there is one. Cells that are hidden from all eyes are not wanted from the next plan on, and the others
    /// in the order of what is seen of them.
    ///
    /// # Panics
    /// If there are not as many numbers as entries.
    pub fn feedback(&mut self, visibility: &[f32]) {
        let Drawn { cells, is_complete, .. } = &self.drawn;
        assert_eq!(visibility.len(), cells.len(), "visibility of another draw list");
        let Some((view, ..)) = &self.sight else { return };
        let told = cells.iter().copied().zip(visibility.iter().copied());
        let told = Visibility::new(self.source.pyramid(), view, told);
        let (number, has_changed) = match &mut self.visibility {
            // The planner may hold it: then this copies it.
            Some((number, known)) if known.is_of(view) => (*number, Arc::make_mut(known).add(told)),
            known => {
                let number = known.as_ref().map_or(0, |(number, _)| *number);
                *known = Some((number, Arc::new(told)));
                (number, true)
            }
        };
        if has_changed {
            self.visibility.iter_mut().for_each(|(number, _)| *number += 1);
        } else if *is_complete {
            self.confirmed = number;
        }
    }

    /// How long carrying out the last frame's uploads took: so that the next frames' can be fitted to the time there is.
    pub fn uploads_took(&mut self, time: Duration) {
        self.governor.took(time);
    }

    /// Waits until the next frame has something to take in, or shows more of what fades in; false if `timeout` has passed or
    /// nothing is on its way. Calling it says that the last frame's uploads are done with.
    pub fn wait(&mut self, timeout: Duration) -> bool {
        self.workers.give_back(self.handed_out.drain(..));
        if self.residency.has_staged() {
            return true;
        }
        let is_fading = self.drawn.is_fading;
        let timeout = if is_fading { timeout.min(FADE_STEP) } else { timeout };
        let (arrivals, outlook) = (self.workers.arrivals(), self.planner.awaited());
        let pages = self.occupancy.as_ref().map(|(_, reader)| reader.arrivals());
        let is_waiting = self.occupancy.as_ref().is_some_and(|(occupancy, _)| occupancy.is_waiting());
        if outlook.is_none() && !self.workers.is_busy() && !is_fading && !is_waiting {
            let has_pages = pages.is_some_and(|pages| pages.try_recv().is_ok());
            return has_pages || arrivals.is_some_and(|arrivals| !arrivals.is_empty());
        }
        let mut select = Select::new();
        pages.map(|pages| select.recv(pages));
        arrivals.map(|arrivals| select.recv(arrivals));
        outlook.map(|outlook| select.recv(outlook));
        let is_ready = select.ready_timeout(timeout).is_ok();
        // A sign is for one frame, which looks at all that has come.
        let _ = pages.map(Receiver::try_recv);
        is_ready || is_fading
    }

    /// Says that the slots have lost what was in them, as happens with a GPU's device, and how many there are now; more
    /// than before are not used. The next frames bring back what the view wants.
    ///
    /// # Errors
    /// If these are too few, or the planner's thread cannot be started again.
    pub fn forget_slots(&mut self, slots: u32) -> Result<(), PagerError> {
        let slots = slots.min(self.config.slots);
        check_slots(&*self.source, slots, self.slot_bytes())?;
        self.config.slots = slots;
        self.residency.forget_slots(slots);
        // Cuts are made for a number of slots.
        self.planner = Planner::new(&planned_source(&self.source, &self.occupancy), slots, self.config.planning)?;
        self.sight = None;
        Ok(())
    }

    /// The paged volume.
    pub fn source(&self) -> &Arc<dyn BrickSource> {
        &self.source
    }

    /// How voxels become the slots' codes.
    pub fn encoding(&self) -> SlotEncoding {
        self.cache.encoding()
    }

    /// The configuration given.
    pub fn config(&self) -> &PagerConfig {
        &self.config
    }

    /// Voxels along a slot's edge: a brick's core and its apron on both sides.
    pub fn slot_edge(&self) -> u32 {
        self.cache.layout().padded() as u32
    }

    /// Bytes of one slot, gradients included.
    pub fn slot_bytes(&self) -> u64 {
        self.cache.layout().padded_bytes() as u64
    }

    fn status(&self, cut: &Cut, sight: &Sight, step: &Step) -> Status {
        let (mut wanted, mut resident, mut failed, mut area, mut resident_area) = (0, 0, 0, 0.0, 0.0);
        let seen = |position: u32| !cut.nodes[position as usize].is_hidden();
        for ((&position, &cell_area), &is_resident) in sight.cells.iter().zip(&sight.areas).zip(&step.resident) {
            if !seen(position) {
                continue;
            }
            wanted += 1;
            area += cell_area;
            // What the cut does not want is coarser than what the view will want.
            if is_resident && cut.nodes[position as usize].is_visible {
                resident += 1;
                resident_area += cell_area;
            } else {
                failed += self.residency.failure(cut.id(position)).is_some() as usize;
            }
        }
        let mut drawn = self.drawn.cells.iter().peekable();
        // One entry, or two.
        let mut entries = |cell| std::iter::from_fn(|| drawn.next_if_eq(&&cell)).count();
        let mut left_out = sight.cells.iter().filter(|&&position| entries(cut.id(position)) == 0);
        let left_out = left_out.find(|&&position| seen(position)).map(|&position| cut.id(position));
        let is_complete = self.drawn.is_complete;
        // What has been told is to be confirmed by what is seen of a complete frame.
        let is_confirmed = self.visibility.as_ref().is_none_or(|(number, _)| *number == self.confirmed);
        // Once all is there that can be, a cell that is left out has failed, and so have all its ancestors.
        let error = left_out.filter(|_| is_complete).and_then(|cell| self.residency.failure(cell).cloned());
        let decoded = self.cache.counters();
        Status {
            wanted,
            resident,
            failed,
            settled: is_complete && is_confirmed,
            awaits_feedback: is_complete && !is_confirmed,
            covered: left_out.is_none(),
            completeness: if resident == wanted { 1.0 } else { resident_area / area },
            effective_error_px: cut.effective_error_px(),
            pixel_error: cut.view.pixel_error,
            memory_bound: cut.memory_bound(),
            error,
            gpu_bytes: self.config.slots as u64 * self.slot_bytes(),
            host_bytes: self.meter.used(),
            host_bytes_peak: self.meter.peak(),
            counters: Counters {
                decoded: decoded.decoded,
                bytes_read: self.source.bytes_read() - self.bytes_read_before,
                bytes_decoded: decoded.bytes_decoded,
                failed: decoded.failed,
                uploaded: self.residency.uploaded,
                reuploaded: self.residency.reuploaded,
                uploaded_ahead: self.residency.uploaded_ahead,
                bytes_uploaded: self.residency.bytes_uploaded,
            },
        }
    }
}

/// What cuts are made from: the source, or what is known of it without waiting.
fn planned_source(
    source: &Arc<dyn BrickSource>,
    occupancy: &Option<(Arc<PagedOccupancy>, PageReader)>,
) -> Arc<dyn BrickSource> {
    occupancy.as_ref().map_or_else(|| source.clone(), |(occupancy, _)| occupancy.clone())
}

fn buffer_sizes(source: &dyn BrickSource, layout: &Layout, config: &PagerConfig) -> BufferSizes {
    let pages = match config.planning {
        Planning::Inline => 0,
        Planning::Thread => paged_occupancy::kept_bytes(source, config.host_bytes),
    };
    BufferSizes {
        fixed: config.slots as u64 * TABLE_BYTES_PER_SLOT + source.cache_bytes() + pages,
        scratch: scratch_bytes(source, layout, &encoding_of(source)),
        core: layout.cached_bytes() as u64,
        padded: layout.padded_bytes() as u64,
    }
}

/// Whether the coarsest bricks, which are always resident, have room.
fn check_slots(source: &dyn BrickSource, given: u32, slot_bytes: u64) -> Result<(), PagerError> {
    let least = source.pyramid().level(source.pyramid().coarsest()).bricks.volume();
    let least_bytes = least.saturating_mul(slot_bytes);
    if (given as u64) < least { Err(PagerError::Slots { given, least, least_bytes }) } else { Ok(()) }
}

#[cfg(test)]
mod tests;
