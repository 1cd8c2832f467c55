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
use crate::planner::{Job, Outlook, Planner};
use crate::ram_cache::{RamCache, encoding_of, layout_of, scratch_bytes};
use crate::residency::{Residency, Step, Upload, Wants};
use crate::sight::Sight;
use crate::source::{BrickError, BrickSource};
use crate::visibility::Visibility;
use crate::workers::Workers;
use brickyard_volume::{BrickId, SlotEncoding};
use crossbeam_channel::Select;
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
    /// Cells whose own brick cannot be read: an ancestor stands in for good.
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
        let planner = Planner::new(&source, config.slots, config.planning)?;
        let bytes_read_before = source.bytes_read();
        Ok(Self {
            source,
            bytes_read_before,
            config,
            cache,
            meter,
            workers,
            residency,
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
        if last != Some(view) {
            self.confirmed = 0;
        }
        self.motion.see(at, &view.rays);
        let visibility = self.visibility.clone();
        let ahead = self.config.prefetch.then(|| self.motion.foresee(FETCH_TIME));
        let Outlook { cut, ahead } = self.planner.outlook(Job { view: view.clone(), visibility, ahead });
        let sight = match self.sight.take() {
            Some((last, of, sight)) if last == *view && Arc::ptr_eq(&of, &cut) => sight,
            _ => Sight::new(&*self.source, &cut, view),
        };
        let (pyramid, roots) = (self.source.pyramid(), &self.roots);
        let wants = Wants { pyramid, cut: &cut, sight: &sight, roots, ahead: &ahead };
        let step = self.residency.step(&wants, self.governor.bytes(at.saturating_sub(self.last_at)), at);
        self.last_at = at;
        self.governor.spent(step.uploads.iter().map(|upload| upload.codes.len() as u64).sum());
        let is_complete = step.settled && self.planner.is_done();
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
        if outlook.is_none() && !self.workers.is_busy() && !is_fading {
            return arrivals.is_some_and(|arrivals| !arrivals.is_empty());
        }
        let mut select = Select::new();
        arrivals.map(|arrivals| select.recv(arrivals));
        outlook.map(|outlook| select.recv(outlook));
        select.ready_timeout(timeout).is_ok() || is_fading
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
        self.planner = Planner::new(&self.source, slots, self.config.planning)?;
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

fn buffer_sizes(source: &dyn BrickSource, layout: &Layout, config: &PagerConfig) -> BufferSizes {
    BufferSizes {
        fixed: config.slots as u64 * TABLE_BYTES_PER_SLOT,
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
mod tests {
    use super::*;
    use crate::draw_list::{DrawCell, Pixels};
    use crate::governor::UploadLimits;
    use crate::planner::Planning;
    use crate::test_source::{TestSource, box_view};
    use brickyard_volume::{BrickIndex, Extent, Level, LevelPolicy, Projection, Pyramid, ViewRays, VoxelType};
    use std::collections::HashMap;

    fn config(slots: u32, host_bytes: u64) -> PagerConfig {
        PagerConfig {
            slots,
            apron: 1,
            gradient_layers: 0,
            host_bytes,
            workers: 3,
            planning: Planning::Inline,
            prefetch: false,
            uploads: None,
            fade: None,
        }
    }

    fn brick(level: u8, index: [u32; 3]) -> BrickId {
        BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::from_array(index) }
    }

    /// Frames until settled, uploads applied to `atlas`.
    fn settle(pager: &mut Pager, view: &View, atlas: &mut HashMap<u32, Vec<u8>>) -> Frame {
        let deadline = std::time::Instant::now() + Duration::from_secs(20);
        loop {
            let frame = pager.frame(view, Duration::ZERO);
            for upload in &frame.uploads {
                atlas.insert(upload.slot.0, upload.codes.to_vec());
            }
            assert!(frame.status.host_bytes_peak <= pager.config().host_bytes);
            if frame.status.settled {
                return frame;
            }
            assert!(std::time::Instant::now() < deadline, "not settled: {:?}", frame.status);
            drop(frame);
            pager.wait(Duration::from_secs(1));
        }
    }

    /// The first own voxel of the brick drawn for each cell is the source's.
    fn check_atlas(pager: &Pager, frame: &Frame, atlas: &HashMap<u32, Vec<u8>>) {
        let (edge, side) = (pager.source().pyramid().edge(), pager.slot_edge() as usize);
        for cell in &frame.draw.cells {
            let mut core = vec![0; (edge as usize).pow(3) * pager.source().voxel_type().bytes()];
            pager.source().read_core(cell.brick, &mut core).unwrap();
            let bytes = pager.encoding().format.bytes();
            let mut codes = vec![0; (edge as usize).pow(3) * bytes];
            pager.encoding().encode(&core, &mut codes);
            let first = (side * side + side + 1) * bytes;
            assert_eq!(atlas[&cell.slot.0][first..first + bytes], codes[..bytes], "{}", cell.brick);
        }
    }

    #[test]
    fn a_threaded_pager_settles_around_failures_within_its_budget() {
        let pyramid = Pyramid::new(Extent::new(64, 50, 33), [1.0; 3], 8);
        let mut source = TestSource::new(pyramid, [1.0; 3], VoxelType::F32);
        // A cell, a cell with its parent, a panicking cell, and a brick that only matters as a neighbour.
        source.failing = [brick(0, [1, 1, 1]), brick(0, [4, 4, 2]), brick(1, [2, 2, 1])].into();
        source.panicking = [brick(0, [7, 0, 0])].into();
        let source = Arc::new(source);
        // About 40 of the 280 cores fit.
        let mut pager = Pager::new(source.clone(), config(400, 400 * TABLE_BYTES_PER_SLOT + 64 * 1024)).unwrap();
        let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        view.level = LevelPolicy::Locked(0);
        let mut atlas = HashMap::new();
        let frame = settle(&mut pager, &view, &mut atlas);
        let status = &frame.status;
        assert_eq!((status.wanted, status.resident, status.failed), (280, 277, 3));
        assert!(status.covered && status.error.is_none() && !status.memory_bound);
        assert!(status.completeness > 0.9 && status.completeness < 1.0);
        // The damaged parent is met when it is asked to stand in.
        assert_eq!(status.counters.failed, 4);
        let drawn = |cell| frame.draw.cells.iter().find(|c| c.cell == cell).map(|c| c.brick);
        assert_eq!(drawn(brick(0, [1, 1, 1])), Some(brick(1, [0, 0, 0])));
        assert_eq!(drawn(brick(0, [4, 4, 2])), Some(brick(2, [1, 1, 0])));
        // The same view again uploads and reads nothing.
        let again = pager.frame(&view, Duration::ZERO);
        assert!(again.uploads.is_empty() && again.status.settled && again.status.counters == status.counters);
        assert!(!pager.wait(Duration::from_secs(9)), "nothing is on its way");
        check_atlas(&pager, &frame, &atlas);
    }

    #[test]
    fn one_slot_shows_the_root_of_each_channel() {
        let source = Arc::new(TestSource::cube(40));
        let mut pager = Pager::new(source.clone(), config(1, 8192)).unwrap();
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let mut atlas = HashMap::new();
        for channel in [0, 1, 0] {
            let frame = settle(&mut pager, &View { channel, ..view.clone() }, &mut atlas);
            assert_eq!(frame.draw.cells.len(), 1);
            assert_eq!(frame.draw.cells[0].brick.channel, channel);
            check_atlas(&pager, &frame, &atlas);
        }
        assert_eq!(pager.frame(&view, Duration::ZERO).status.counters.reuploaded, 1);
    }

    #[test]
    fn slots_that_lost_their_bricks_are_filled_again() {
        let source = Arc::new(TestSource::cube(40));
        let mut pager = Pager::new(source.clone(), config(200, 1 << 20)).unwrap();
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let before = settle(&mut pager, &view, &mut HashMap::new());
        let decoded = before.status.counters.decoded;
        // Fewer slots make a coarser cut; more than at the start were not accounted for.
        for (slots, used) in [(200, 200), (20, 20), (500, 20)] {
            pager.forget_slots(slots).unwrap();
            assert_eq!(pager.config().slots, used);
            let mut atlas = HashMap::new();
            let frame = settle(&mut pager, &view, &mut atlas);
            check_atlas(&pager, &frame, &atlas);
            assert_eq!(frame.draw.cells.len() == before.draw.cells.len(), used == 200);
            let counters = frame.status.counters;
            assert_eq!(counters.reuploaded, 0, "this is no thrash");
            assert!(used != 200 || counters.decoded == decoded, "decoded bricks are kept");
        }
        assert!(matches!(pager.forget_slots(0), Err(PagerError::Slots { given: 0, least: 1, .. })));
    }

    #[test]
    fn frames_upload_no_more_than_asked_but_always_something() {
        let source = Arc::new(TestSource::cube(64));
        source.read_core(brick(0, [0, 0, 0]), &mut [0; 512]).unwrap();
        let limited = PagerConfig {
            uploads: Some(UploadLimits { bytes: 2500, time: Duration::from_secs(9) }),
            ..config(300, 1 << 20)
        };
        let mut pager = Pager::new(source.clone(), limited).unwrap();
        let view = View { pixel_error: 8.0, ..box_view(&source, Projection::Perspective { fov_y_deg: 30.0 }) };
        let mut frame = pager.frame(&view, Duration::ZERO);
        let (mut frames, mut without) = (0, 0);
        while !frame.status.settled {
            assert!(pager.wait(Duration::from_secs(9)));
            frame = pager.frame(&view, Duration::ZERO);
            // 1,000 bytes a brick.
            assert!(frame.uploads.len() <= 2, "{}", frame.uploads.len());
            (frames, without) = (frames + 1, without + frame.uploads.is_empty() as u32);
        }
        // Once in a while all that comes is a stand-in for what came before it.
        assert!(without * 10 <= frames, "{without} of {frames} frames without an upload");
        let counters = frame.status.counters;
        assert_eq!(counters.bytes_uploaded, counters.uploaded * 1000);
        assert_eq!(counters.bytes_read, counters.decoded * 512, "of this pager alone");
    }

    #[test]
    fn a_renderer_may_keep_the_codes() {
        let source = Arc::new(TestSource::cube(64));
        let mut pager = Pager::new(source.clone(), config(600, 600 * TABLE_BYTES_PER_SLOT + 16 * 1024)).unwrap();
        let view =
            View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Orthographic { height: 200.0 }) };
        let mut kept = Vec::new();
        loop {
            let frame = pager.frame(&view, Duration::ZERO);
            kept.extend(frame.uploads.into_iter().map(|upload| (upload.brick, upload.codes.to_vec(), upload.codes)));
            if frame.status.settled {
                break;
            }
            assert!(pager.wait(Duration::from_secs(9)));
        }
        assert!(kept.len() >= 512);
        for (brick, then, now) in &kept {
            assert!(then[..] == now[..], "{brick} was written over");
        }
    }

    #[test]
    fn a_volume_without_a_readable_brick_is_an_error() {
        let mut source = TestSource::cube(8);
        source.failing = [brick(0, [0, 0, 0])].into();
        let source = Arc::new(source);
        let mut pager = Pager::new(source.clone(), config(4, 1 << 16)).unwrap();
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let status = settle(&mut pager, &view, &mut HashMap::new()).status;
        assert!(!status.covered);
        assert_eq!(status.error.map(|err| err.id), Some(brick(0, [0, 0, 0])));
    }

    #[test]
    fn a_planner_thread_that_looks_ahead_settles_on_what_a_cold_cut_wants() {
        let source = Arc::new(TestSource::cube(64));
        let live = PagerConfig { planning: Planning::Thread, prefetch: true, ..config(900, 1 << 20) };
        let mut pager = Pager::new(source.clone(), live).unwrap();
        let projection = Projection::Perspective { fov_y_deg: 60.0 };
        let mut view = View { pixel_error: 5.0, ..box_view(&source, projection) };
        let (mut atlas, eye) = (HashMap::new(), view.rays.eye);
        for i in 0..30u32 {
            // In, and about the volume.
            view.rays.eye = eye * (1.0 - 0.02 * i as f64);
            let frame = pager.frame(&view, Duration::from_millis(20) * i);
            for upload in &frame.uploads {
                atlas.insert(upload.slot.0, upload.codes.to_vec());
            }
            check_atlas(&pager, &frame, &atlas);
            drop(frame);
            pager.wait(Duration::from_millis(20));
        }
        let frame = settle(&mut pager, &view, &mut atlas);
        check_atlas(&pager, &frame, &atlas);
        let cold = Cut::new(&*source, &view, crate::cut::cut_capacity(900, 1));
        let wanted: HashMap<BrickId, BrickId> = frame.draw.cells.iter().map(|c| (c.cell, c.brick)).collect();
        assert!(wanted.iter().all(|(cell, brick)| cell == brick) && !frame.status.memory_bound);
        assert!(frame.status.effective_error_px <= 5.0 && wanted.len() >= cold.wanted());
    }

    #[test]
    fn what_is_foreseen_is_there_when_it_is_wanted() {
        let source = Arc::new(TestSource::cube(64));
        let ahead = PagerConfig { prefetch: true, ..config(1200, 2 << 20) };
        let mut pager = Pager::new(source.clone(), ahead).unwrap();
        let whole = box_view(&source, Projection::Orthographic { height: 30.0 });
        let view = |aside: f64| {
            let eye = whole.rays.eye + whole.rays.right.normalize() * aside;
            View { rays: ViewRays { eye, ..whole.rays }, level: LevelPolicy::Locked(0), ..whole.clone() }
        };
        pager.frame(&view(0.0), Duration::ZERO);
        let (view_now, now) = (view(1.0), Duration::from_millis(50));
        let mut frame = pager.frame(&view_now, now);
        while pager.wait(Duration::from_secs(9)) {
            frame = pager.frame(&view_now, now);
        }
        assert!(frame.status.settled && frame.status.counters.uploaded_ahead > 0);
        // Foreseen is the camera after 300 ms and a frame of 50: 7 farther.
        let then = pager.frame(&view(7.5), Duration::from_millis(375)).status;
        assert!(then.settled && then.wanted > 0 && then.completeness == 1.0, "{then:?}");
        let behind = pager.frame(&view(-12.0), Duration::from_millis(400)).status;
        assert!(behind.completeness < 1.0, "nothing was to be foreseen there");
    }

    #[test]
    fn what_is_hidden_is_not_read() {
        let source = Arc::new(TestSource::cube(64));
        let view = View { pixel_error: 0.5, ..box_view(&source, Projection::Orthographic { height: 100.0 }) };
        let mut uploaded = Vec::new();
        for shows in [1.0, 0.0] {
            let mut pager = Pager::new(source.clone(), config(600, 1 << 20)).unwrap();
            // The half of the volume that is farther away.
            let hides = |cell: &DrawCell| cell.region.min.y >= 32;
            loop {
                let frame = pager.frame(&view, Duration::ZERO);
                let told = |cell| if hides(cell) { shows } else { 1.0 };
                let told: Vec<f32> = frame.draw.cells.iter().map(told).collect();
                if frame.status.settled {
                    uploaded.push(frame.status.counters.uploaded);
                    assert!(frame.status.covered && frame.draw.cells.iter().any(hides));
                    break;
                }
                pager.feedback(&told);
                if !frame.status.awaits_feedback {
                    pager.wait(Duration::from_secs(9));
                }
            }
        }
        // Before anything was told, some were on their way.
        assert!(uploaded[1] < uploaded[0] * 3 / 4, "{uploaded:?}");
    }

    #[test]
    fn a_view_settles_when_all_has_faded_in() {
        let source = Arc::new(TestSource::cube(16));
        let view =
            View { level: LevelPolicy::Locked(0), ..box_view(&source, Projection::Orthographic { height: 40.0 }) };
        for fade in [None, Some(Duration::from_millis(200))] {
            // Whatever else is staged, one brick comes a frame, the root first.
            let uploads = Some(UploadLimits { bytes: 0, time: Duration::from_secs(9) });
            let config = PagerConfig { fade, uploads, workers: 1, ..config(40, 1 << 20) };
            let mut pager = Pager::new(source.clone(), config).unwrap();
            let (mut at, mut shares) = (Duration::ZERO, HashMap::<BrickId, Vec<u8>>::new());
            let last = loop {
                let frame = pager.frame(&view, at);
                let fading = frame.draw.cells.iter().filter(|entry| entry.pixels.to < Pixels::THRESHOLDS);
                fading.for_each(|entry| shares.entry(entry.brick).or_default().push(entry.pixels.to));
                if frame.status.settled {
                    break frame;
                }
                assert!(frame.status.error.is_none(), "a cell with two entries is drawn");
                pager.feedback(&vec![1.0; frame.draw.cells.len()]);
                assert!(frame.status.awaits_feedback || pager.wait(Duration::from_secs(9)), "nothing goes on");
                at += Duration::from_millis(50);
            };
            assert!(last.draw.cells.len() == 8 && !last.draw.is_fading() && last.status.covered);
            assert!(!pager.wait(Duration::from_secs(9)), "nothing is on its way");
            assert_eq!(shares.len(), if fade.is_some() { 8 } else { 0 });
            assert!(shares.values().all(|shares| *shares == [1, 16, 32, 48]), "{shares:?}");
        }
    }

    #[test]
    fn budgets_that_hold_no_brick_are_refused_with_the_least_that_works() {
        let source = Arc::new(TestSource::cube(64));
        let new = |config| Pager::new(source.clone(), config).map(drop);
        assert!(matches!(new(config(0, 1 << 20)), Err(PagerError::Slots { least: 1, least_bytes: 1000, .. })));
        let Err(PagerError::HostMemory { least, .. }) = new(config(4, 100)) else { panic!("100 bytes are too few") };
        assert!(new(config(4, least)).is_ok());
        assert!(matches!(new(PagerConfig { apron: 5, ..config(4, 1 << 20) }), Err(PagerError::Apron { .. })));
    }
}
