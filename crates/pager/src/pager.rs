//! The pager itself, which joins the pure steps to the workers, frame by frame.
//!
//! Each frame receives arrived bricks, takes the newest cuts and finds their visible cells; arrived bricks get slots; the draw lists and
//! the next plans follow from the resident bricks. The calling thread never reads or decodes. Volumes with equal brick formats share slots:
//! the worst cell of any volume is split first, and the most urgent brick of any is read first.

use crate::budget::{BufferSizes, Meter, PagerConfig, PagerError, Planning, TABLE_BYTES_PER_SLOT, least_host};
use crate::clock::MOST_COMING;
use crate::cut::{Cut, View};
use crate::draw_list::DrawList;
use crate::goal::Goal;
use crate::layers::{BudgetRequest, share};
use crate::layout::Layout;
use crate::motion::Motion;
use crate::paged_volume::{DrawnCells, PagedVolume, Seen, buffer_sizes};
use crate::planner::{Job, Outlook, Planner};
use crate::ram_cache::KeptCores;
use crate::residency::{Ahead, Residency, Step, Upload, UploadLimit, VolumeStep};
use crate::sameness::SlotsByContent;
use crate::slot_contents::SlotContents;
use crate::source::BrickSource;
use crate::status::{Readiness, Status};
use crate::upload_budget::Governor;
use crate::visible_cells::VisibleCells;
use crossbeam_channel::Select;
use std::sync::Arc;
use std::time::Duration;

/// One frame's work for the renderer.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Bricks to write into their slots, in order, before drawing. They replace only bricks not drawn in this frame. If a renderer keeps
    /// the codes instead of copying them, they count as its own memory, not the pager's.
    pub uploads: Vec<Upload>,
    /// Draw lists of each volume, in order.
    pub volumes: Vec<VolumeDraw>,
    /// Progress and costs of the views.
    pub status: Status,
    /// Readiness of each of the [coming views](Pager::expect), in their order.
    pub coming: Vec<Readiness>,
}

/// Draw lists of one volume in a frame.
#[derive(Clone, Debug)]
pub struct VolumeDraw {
    /// Draw list of the volume. After the frame's uploads, every listed slot holds its listed brick.
    pub draw: DrawList,
    /// Entries of `draw`, back to front for the other eye; `None` for a single eye.
    pub draw_other_eye: Option<DrawList>,
    /// Index of the first volume drawn from the same cut, possibly this volume's own.
    pub cut: usize,
}

/// Look-ahead of prefetching, besides the sources' own latency: about the time in which a few hundred bricks come from a disk.
const FETCH_TIME: Duration = Duration::from_millis(300);

/// Least time between frames drawn only for fades: a sixtieth of a second.
const FADE_STEP: Duration = Duration::from_millis(16);

/// Views and cuts of the last frame, and their visible cells.
struct LastFrame {
    views: Vec<View>,
    cuts: Vec<Arc<Cut>>,
    sights: Vec<VisibleCells>,
}

impl LastFrame {
    fn is_of(&self, views: &[View], cuts: &[Arc<Cut>]) -> bool {
        self.views == views && self.cuts.iter().zip(cuts).all(|(a, b)| Arc::ptr_eq(a, b))
    }
}

/// Pager of volumes sharing slots, for one view of each volume at a time.
pub struct Pager {
    config: PagerConfig,
    meter: Arc<Meter>,
    volumes: Vec<PagedVolume>,
    residency: Residency,
    planner: Planner,
    last: Option<LastFrame>,
    coming: Arc<[Vec<View>]>,
    motion: Motion,
    governor: Governor,
    /// Bytes that the next frame's uploads must not exceed.
    upload_room: Option<u64>,
    last_at: Duration,
    slot_bytes: u64,
    /// Whether nothing was left in flight for the last frame, and whether a brick was fading in.
    is_complete: bool,
    is_fading: bool,
}

impl Pager {
    /// Starts the workers; nothing is read until the first frame. The padded bricks of all sources must have the same size. The host budget
    /// is divided among the volumes once, by their possible use of it.
    ///
    /// # Errors
    /// If a budget cannot hold everything needed at once (the error has the least sufficient budget), the apron or the gradients do not fit
    /// the bricks, or no thread can be started.
    ///
    /// # Panics
    /// If there is no source.
    pub fn new(sources: &[Arc<dyn BrickSource>], config: PagerConfig) -> Result<Self, PagerError> {
        Self::with_cores(sources, config, &mut Vec::new())
    }

    /// Starts the workers with cores decoded by [another pager](Self::into_cores). Each source's entry, if any, is taken out of `kept` and
    /// used as far as the host budget has room.
    ///
    /// # Errors
    /// The same as those of [`Pager::new`].
    ///
    /// # Panics
    /// If there is no source.
    pub fn with_cores(
        sources: &[Arc<dyn BrickSource>],
        config: PagerConfig,
        kept: &mut Vec<KeptCores>,
    ) -> Result<Self, PagerError> {
        let layout = |(source, contents): (&Arc<dyn BrickSource>, _)| {
            Layout::new(&**source, config.apron, config.gradient_layers, contents)
        };
        let layouts = sources.iter().zip(config.contents_of_all()).map(layout);
        let layouts = layouts.collect::<Result<Vec<Layout>, _>>()?;
        let slot_bytes = layouts[0].padded_bytes() as u64;
        debug_assert!(layouts.iter().all(|layout| layout.padded_bytes() as u64 == slot_bytes), "unlike slots");
        check_slots(sources, config.slots, slot_bytes)?;
        let meter = Arc::new(Meter::new(config.host_bytes));
        let tables = config.slots as u64 * TABLE_BYTES_PER_SLOT;
        let given = config.host_bytes;
        let shares = match sources {
            [_] => vec![given.saturating_sub(tables)],
            _ => {
                let requests = sources.iter().zip(config.contents_of_all());
                let requests = requests.map(|(source, contents)| volume_request(&**source, contents, &config));
                share(given.saturating_sub(tables), &requests.collect::<Result<Vec<_>, _>>()?)
                    .map_err(|least| PagerError::HostMemory { given, least: least + tables })?
            }
        };
        meter.charge(tables.min(given));
        let held: Vec<Arc<SlotsByContent>> = sources.iter().map(|_| Arc::default()).collect();
        let shares = shares.into_iter().zip(&held);
        let volumes = sources.iter().zip(config.contents_of_all()).zip(shares);
        let volumes = volumes.map(|((source, contents), (host_bytes, held))| {
            let own = kept.iter().position(|cores: &KeptCores| cores.is_of(source)).map(|i| kept.remove(i));
            let started = PagedVolume::start(source, contents, host_bytes, &config, &meter, held, own);
            started.map_err(|error| match error {
                PagerError::HostMemory { least, .. } => PagerError::HostMemory { given, least: least + tables },
                other => other,
            })
        });
        let volumes = volumes.collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            planner: planner(&volumes, &config)?,
            residency: Residency::new(held, config.slots, config.fade),
            governor: Governor::new(config.uploads),
            upload_room: None,
            config,
            meter,
            volumes,
            last: None,
            coming: [].into(),
            motion: Motion::default(),
            last_at: Duration::ZERO,
            slot_bytes,
            is_complete: false,
            is_fading: false,
        })
    }

    /// Host memory request of a pager for these sources and this configuration, in items of one byte: the least sufficient number, and the
    /// largest useful one.
    ///
    /// # Errors
    /// If the apron or the gradients do not fit the bricks.
    pub fn host_request(sources: &[Arc<dyn BrickSource>], config: &PagerConfig) -> Result<BudgetRequest, PagerError> {
        let tables = config.slots as u64 * TABLE_BYTES_PER_SLOT;
        let mut sources = sources.iter().zip(config.contents_of_all());
        sources.try_fold(BudgetRequest { bytes: 1, least: tables, most: tables }, |all, (source, contents)| {
            let BudgetRequest { least, most, .. } = volume_request(&**source, contents, config)?;
            Ok(BudgetRequest { least: all.least + least, most: all.most.saturating_add(most), ..all })
        })
    }

    /// Returns uploads and draw lists for one view of each volume. `at` is the time since a fixed moment, for motion and fades. A call ends
    /// the use of the last frame's uploads.
    ///
    /// # Panics
    /// If there are not as many views as volumes, or a source lacks its view's time step or channel.
    pub fn frame(&mut self, views: &[View], at: Duration) -> Frame {
        assert_eq!(views.len(), self.volumes.len(), "views of other volumes");
        for (i, (volume, view)) in self.volumes.iter_mut().zip(views).enumerate() {
            volume.begin_frame(i, view, !self.coming.is_empty(), &mut self.residency);
        }
        self.motion.see(at, &views[0].rays);
        let occupancy: Vec<u64> = self.volumes.iter().map(PagedVolume::occupancy_version).collect();
        let latency = self.volumes.iter().map(|volume| volume.source.latency()).max().unwrap_or_default();
        let outlook = self.planner.outlook(Job {
            views: views.to_vec(),
            coming: self.coming.clone(),
            visibility: self.volumes.iter().map(|volume| volume.visibility.clone()).collect(),
            ahead: self.config.prefetch.then(|| self.motion.foresee(FETCH_TIME + latency)),
            occupancy: occupancy.clone(),
        });
        let coming: Vec<_> = self.coming.iter().map(|views| goals(&self.volumes, &outlook, views)).collect();
        let cuts = outlook.cuts.clone();
        let sights = match self.last.take() {
            Some(last) if last.is_of(views, &cuts) => last.sights,
            _ => VisibleCells::all(&planned_sources(&self.volumes), &cuts, views),
        };
        let wants = self.volumes.iter().zip(&cuts).zip(&sights).map(|((volume, cut), sight)| volume.wants(cut, sight));
        let limit = UploadLimit {
            goal_bytes: self.governor.bytes(at.saturating_sub(self.last_at), !self.coming.is_empty()),
            room_bytes: self.upload_room.take(),
        };
        let ahead = Ahead { coming: &coming, listed: &outlook.ahead };
        let Step { uploads, volumes, settled, coming: mut readiness } =
            self.residency.step(&wants.collect::<Vec<_>>(), ahead, limit, at);
        for ((ready, goals), views) in readiness.iter_mut().zip(&coming).zip(self.coming.iter()) {
            // A moving camera is ahead of the cuts; a changing level is waited for.
            ready.is_planned &=
                goals.iter().zip(views).all(|(goal, view)| goal.cut.view.pixel_error == view.pixel_error);
        }
        self.last_at = at;
        self.governor.spent(uploads.iter().map(|upload| upload.codes.len() as u64).sum());
        let is_known = self.volumes.iter().zip(&occupancy).all(|(volume, &version)| volume.knows_since(version));
        self.is_complete = settled && self.planner.is_done() && is_known;
        self.is_fading = volumes.iter().any(|step| step.draw.is_fading());
        let (mut drawn, mut seen) = (Vec::new(), Vec::new());
        for (i, VolumeStep { draw, resident, requests, stale }) in volumes.into_iter().enumerate() {
            let (volume, cut, sight) = (&mut self.volumes[i], &cuts[i], &sights[i]);
            let draw_other_eye = sight.for_other_eye.as_ref().map(|order| draw.reordered(cut, order));
            volume.note_drawn(std::iter::once(&draw).chain(&draw_other_eye));
            seen.push(volume.seen(cut, sight, &resident, |cell| self.residency.failure(i, cell)));
            let handed_out = uploads.iter().filter(|upload| upload.volume == i);
            volume.request(requests, stale, handed_out.map(|upload| upload.codes.clone()));
            drawn.push(VolumeDraw { draw, draw_other_eye, cut: sight.first });
        }
        let status = self.status(&cuts, seen);
        self.last = Some(LastFrame { views: views.to_vec(), cuts, sights });
        Frame { uploads, volumes: drawn, status, coming: readiness }
    }

    /// Sets the coming views, the nearest first, each one view per volume: the same views at later time steps. Their bricks are fetched
    /// next after the present views' own, into the remaining slots; and no cut takes more than half of the slots, so both steps fit. Holds
    /// for all later frames, until replaced.
    ///
    /// # Panics
    /// If there are not as many views as volumes in each, or a source lacks a view's time step or channel.
    pub fn expect(&mut self, coming: Vec<Vec<View>>) {
        for views in &coming {
            assert_eq!(views.len(), self.volumes.len(), "views of other volumes");
            self.volumes.iter().zip(views).for_each(|(volume, view)| volume.expect(view));
        }
        self.coming = coming.into();
    }

    /// Drawn cells of a volume in the last frame, for a later [`Pager::feedback`]; `None` before the first frame.
    ///
    /// # Panics
    /// If there is no such volume.
    pub fn drawn(&self, volume: usize) -> Option<DrawnCells> {
        self.volumes[volume].drawn(self.is_complete)
    }

    /// Reports the visibility of a volume's cells in the last frame or an earlier one. `visibility` has one number per entry of the frame's
    /// draw list, in order, then one per entry of any list for the other eye: the greatest transmittance with which a ray of the entry's
    /// pixels entered the cell, 0 without rays, 1 with nothing in front of the cell. From the next plan on, cells hidden from all eyes are
    /// not wanted, and the others are ordered by visibility. Feedback is ignored if its frame's view had another appearance, time step,
    /// channel, clip, placement or set of opaque bins than the last frame's.
    ///
    /// # Panics
    /// If there is no such volume, or there are not as many numbers as entries.
    pub fn feedback(&mut self, volume: usize, drawn: &DrawnCells, visibility: &[f32]) {
        self.volumes[volume].feedback(drawn, visibility);
    }

    /// Takes a buffer in exchange for an upload's. Thus a renderer that keeps the last frame's uploads instead of copying them has no
    /// buffers to free, and the workers none to allocate. `before` is as long as the upload.
    pub fn take_for(&mut self, upload: &Upload, before: Arc<[u8]>) {
        debug_assert_eq!(before.len(), upload.codes.len(), "a buffer of another pool");
        self.volumes[upload.volume].take_for(&upload.codes, before);
    }

    /// Limits the next frame's uploads alone to this many bytes, possibly 0: as much as the renderer can take without waiting.
    pub fn limit_uploads(&mut self, bytes: u64) {
        self.upload_room = Some(bytes);
    }

    /// Reports the duration of the last frame's uploads, to fit the next ones to the available time.
    pub fn uploads_took(&mut self, time: Duration) {
        self.governor.took(time);
    }

    /// Waits until the next frame has something to receive, or shows more of a fading brick (after 16 ms, or `timeout` if that is less).
    /// Returns false if nothing is in flight, or if `timeout` has passed without fades. A call ends the use of the last frame's uploads.
    pub fn wait(&mut self, timeout: Duration) -> bool {
        self.volumes.iter_mut().for_each(PagedVolume::take_back);
        if self.residency.has_staged() {
            return true;
        }
        let timeout = if self.is_fading { timeout.min(FADE_STEP) } else { timeout };
        let outlook = self.planner.awaited();
        if outlook.is_none() && !self.is_fading && !self.volumes.iter().any(PagedVolume::is_busy) {
            return self.volumes.iter().any(PagedVolume::has_arrivals);
        }
        let mut select = Select::new();
        self.volumes.iter().for_each(|volume| volume.select(&mut select));
        outlook.map(|outlook| select.recv(outlook));
        let is_ready = select.ready_timeout(timeout).is_ok();
        // A signal is for one frame, which receives all arrivals.
        for volume in &self.volumes {
            volume.take_sign();
        }
        is_ready || self.is_fading
    }

    /// Reports that the slots have lost their bricks, as after the loss of a GPU device, and their number now. Slots beyond the former
    /// number are not used. The next frames bring back the wanted bricks.
    ///
    /// # Errors
    /// If the slots are too few, or the planner's thread cannot be restarted.
    pub fn forget_slots(&mut self, slots: u32) -> Result<(), PagerError> {
        let slots = slots.min(self.config.slots);
        check_slots(self.volumes.iter().map(|volume| &volume.source), slots, self.slot_bytes)?;
        self.config.slots = slots;
        self.residency.forget_slots(slots);
        // Cuts are made for a number of slots.
        self.planner = planner(&self.volumes, &self.config)?;
        self.last = None;
        Ok(())
    }

    /// Ends the workers and returns their decoded cores, for [another pager](Self::with_cores) with other slots or wider aprons.
    pub fn into_cores(self) -> Vec<KeptCores> {
        self.volumes.into_iter().map(PagedVolume::into_cores).collect()
    }

    /// The configuration, with the current number of slots: [`Pager::forget_slots`] may have lowered it.
    pub fn config(&self) -> &PagerConfig {
        &self.config
    }

    fn status(&self, cuts: &[Arc<Cut>], seen: Vec<Seen>) -> Status {
        let sum = |of: fn(&Seen) -> usize| seen.iter().map(of).sum::<usize>();
        let (wanted, resident) = (sum(|seen| seen.wanted), sum(|seen| seen.resident));
        let area = |of: fn(&Seen) -> f64| seen.iter().map(of).sum::<f64>();
        // A complete frame's feedback must confirm the reported visibility.
        let is_confirmed = self.volumes.iter().all(PagedVolume::is_confirmed);
        let covered = seen.iter().all(|seen| seen.is_covered);
        let mut counters = self.residency.counters;
        for (i, volume) in self.volumes.iter().enumerate() {
            // Layers of one store read from one source, which counts for all of them.
            let is_first = !self.volumes[..i].iter().any(|before| Arc::ptr_eq(&before.source, &volume.source));
            counters = counters.and(&volume.counters(is_first));
        }
        Status {
            wanted,
            resident,
            failed: sum(|seen| seen.failed),
            settled: self.is_complete && is_confirmed,
            awaits_feedback: self.is_complete && !is_confirmed,
            covered,
            completeness: if resident == wanted {
                1.0
            } else {
                area(|seen| seen.resident_area) / area(|seen| seen.area)
            },
            effective_error_px: cuts.iter().map(|cut| cut.effective_error_px()).fold(0.0, f64::max),
            pixel_error: cuts[0].view.pixel_error,
            memory_bound: cuts.iter().any(|cut| cut.memory_bound()),
            error: seen.into_iter().find_map(|seen| seen.error),
            gpu_bytes: self.config.slots as u64 * self.slot_bytes,
            host_bytes: self.meter.used(),
            host_bytes_peak: self.meter.peak(),
            counters,
        }
    }
}

fn planner(volumes: &[PagedVolume], config: &PagerConfig) -> std::io::Result<Planner> {
    Planner::new(&planned_sources(volumes), config.slots, config.planning)
}

/// Goals of coming views for each volume; empty while their cuts are not made.
fn goals<'a>(volumes: &'a [PagedVolume], outlook: &'a Outlook, views: &[View]) -> Vec<Goal<'a>> {
    let cuts = outlook.coming(views).unwrap_or_default();
    volumes.iter().zip(cuts).map(|(volume, cut)| Goal { pyramid: volume.source.pyramid(), cut }).collect()
}

fn planned_sources(volumes: &[PagedVolume]) -> Vec<Arc<dyn BrickSource>> {
    volumes.iter().map(PagedVolume::planned_source).collect()
}

/// A volume's request to a host budget, besides the tables of the slots.
fn volume_request(
    source: &dyn BrickSource,
    contents: &SlotContents,
    config: &PagerConfig,
) -> Result<BudgetRequest, PagerError> {
    let layout = Layout::new(source, config.apron, config.gradient_layers, contents)?;
    source.keep_at_most(0);
    let sizes = buffer_sizes(source, &layout, config.planning, config.host_bytes);
    let BufferSizes { fixed, scratch, core, padded } = sizes;
    let workers = config.workers.max(1) as u64;
    // A cache of every brick of the steps that may be played, and an eighth of the total for bricks in flight.
    let steps = match config.planning {
        Planning::Inline => 1,
        Planning::Thread => u64::from(source.times()).min(1 + MOST_COMING as u64),
    };
    let cores = source.pyramid().brick_count().saturating_mul(steps).saturating_mul(core);
    let most = cores.saturating_add(fixed + workers * (scratch + core + padded)).saturating_mul(8) / 7;
    Ok(BudgetRequest { bytes: 1, least: least_host(sizes), most })
}

/// Checks that the coarsest bricks, which are always resident, have room.
fn check_slots<'a>(
    sources: impl IntoIterator<Item = &'a Arc<dyn BrickSource>>,
    given: u32,
    slot_bytes: u64,
) -> Result<(), PagerError> {
    let roots = |source: &Arc<dyn BrickSource>| source.pyramid().level(source.pyramid().coarsest()).bricks.volume();
    let least: u64 = sources.into_iter().map(roots).sum();
    let least_bytes = least.saturating_mul(slot_bytes);
    if (given as u64) < least { Err(PagerError::Slots { given, least, least_bytes }) } else { Ok(()) }
}

#[cfg(test)]
mod tests;
