//! Residency: the staged, resident and failed bricks, and one frame's decisions over them, as a state machine without threads, testable
//! against any order of arrivals.
//!
//! absent → (queued, decoding: the workers') → staged → resident → absent; or failed, until the reason has passed. Bricks to retry stay
//! absent: they are requested, and the workers time the retries. Equal bricks of several time steps share a slot.
//!
//! A wanted brick always finds a slot, so every frame makes progress: a frame protects the resident bricks of the cuts' wanted cells, at
//! most one stand-in per missing one, and the roots, which the cuts count. Together these are no more than the cuts' count, which is below
//! the number of slots (or is the roots alone, which need no stand-ins). Other cells, visible only in a newer view, are drawn with whatever
//! is left: the list is made after the slots are given.
//!
//! The cuts of coming time steps get the remaining slots, the nearest step first: a step's resident bricks are kept and its missing ones
//! requested, so the step is whole in time.

use crate::budget::MAX_STAGED;
use crate::cut::NodeId;
use crate::draw_list::{DrawList, Slot, StandIns};
use crate::fade::{Fades, Fading};
use crate::goal::{Goal, VolumeBrick};
use crate::plan::{self, Key, State};
use crate::retry::Failure;
use crate::sameness::{Content, SlotsByContent};
use crate::slots::SlotTable;
use crate::source::BrickError;
use crate::status::{Counters, Readiness};
use crate::step_ahead::StepAhead;
use crate::tier::Tier;
use crate::visible_cells::{Ranked, VisibleCells};
use brickyard_volume::BrickId;
use rustc_hash::{FxHashMap, FxHashSet};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// A padded brick to write into a slot of the atlas.
#[derive(Clone, Debug)]
pub struct Upload {
    /// Index of the brick's volume in the pager.
    pub volume: usize,
    /// Target slot.
    pub slot: Slot,
    /// The brick.
    pub brick: BrickId,
    /// The padded brick: `(edge + 2 * apron)^3` codes, x fastest, then any gradients.
    pub codes: Arc<[u8]>,
}

/// A worker's result: a brick read, found in a slot, or failed.
#[derive(Clone, Debug)]
pub(crate) struct Arrival {
    pub(crate) id: BrickId,
    pub(crate) result: Result<Arrived, Failure>,
}

/// The way in which a brick arrived.
#[derive(Clone, Debug)]
pub(crate) enum Arrived {
    /// The content is `None` if unknown.
    Read { codes: Arc<[u8]>, content: Option<Content> },
    /// Already in a slot, for another time step.
    Held(Content),
}

/// One frame's work for all volumes.
#[derive(Debug)]
pub(crate) struct Step {
    pub(crate) uploads: Vec<Upload>,
    pub(crate) volumes: Vec<VolumeStep>,
    /// Whether every wanted brick is resident, or has failed with its stand-in resident, and no brick fades in any more.
    pub(crate) settled: bool,
    pub(crate) coming: Vec<Readiness>,
}

/// One frame's work for a volume.
#[derive(Debug)]
pub(crate) struct VolumeStep {
    pub(crate) draw: DrawList,
    /// Whether each visible cell has its own brick resident.
    pub(crate) resident: Vec<bool>,
    /// Bricks to read next, the most urgent first.
    pub(crate) requests: Vec<(Tier, BrickId)>,
    /// Codes of arrived bricks not wanted in this view.
    pub(crate) stale: Vec<Arc<[u8]>>,
}

/// A frame's wants of a volume.
#[derive(Clone, Copy)]
pub(crate) struct Wants<'a> {
    /// Bricks of the frame's view, with pinned roots.
    pub(crate) goal: Goal<'a>,
    pub(crate) sight: &'a VisibleCells,
}

/// Bricks to prefetch, tier by tier, the most urgent first.
#[derive(Default)]
struct Fetched {
    /// Resident ones.
    kept: Vec<(Tier, VolumeBrick)>,
    /// Missing ones.
    lacking: Vec<(Tier, VolumeBrick)>,
}

/// Sufficient requests for coming steps: twice the most bricks in flight, to keep workers busy until the next plan. Sorting those of all
/// steps takes longer than the rest of a frame with many bricks.
const ENOUGH_REQUESTS: usize = 2 * MAX_STAGED as usize;

/// All bricks to read: the views' needs, then prefetched ones.
fn all_requests(needed: Vec<(Tier, VolumeBrick)>, fetched: &Fetched) -> Vec<(Tier, VolumeBrick)> {
    let mut requests = needed;
    // A step may come twice, or again.
    let mut listed: FxHashSet<VolumeBrick> = requests.iter().map(|(_, brick)| *brick).collect();
    requests.extend(fetched.lacking.iter().filter(|(_, brick)| listed.insert(*brick)));
    requests
}

/// Bricks to prefetch.
#[derive(Clone, Copy, Default)]
pub(crate) struct Ahead<'a> {
    /// Goals of the coming views, the nearest first; empty for views still without cuts.
    pub(crate) coming: &'a [Vec<Goal<'a>>],
    /// Other bricks, tier by tier.
    pub(crate) listed: &'a [(Tier, VolumeBrick)],
}

fn bricks_of(volume: usize, ids: impl IntoIterator<Item = BrickId>) -> impl Iterator<Item = VolumeBrick> {
    ids.into_iter().map(move |id| VolumeBrick { volume, id })
}

/// Staged, resident and failed bricks of the volumes sharing slots.
pub(crate) struct Residency {
    slots: SlotTable,
    volumes: Vec<Bricks>,
    /// Coming steps with their present and missing bricks, until one of these changes.
    pub(crate) steps_ahead: Vec<StepAhead>,
    /// Counts of uploads and of shared slots.
    pub(crate) counters: Counters,
}

/// A read brick waiting for a slot.
struct Staged {
    codes: Arc<[u8]>,
    content: Option<Content>,
}

/// A volume's staged, failed and fading bricks.
struct Bricks {
    staged: BTreeMap<BrickId, Staged>,
    failed: FxHashMap<BrickId, BrickError>,
    fades: Fades,
}

/// Limits of a frame's uploads.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct UploadLimit {
    /// Sufficient bytes for a frame, though one brick of any size is allowed; `None` for no such limit.
    pub(crate) goal_bytes: Option<u64>,
    /// Available bytes, possibly none; `None` for no such limit.
    pub(crate) room_bytes: Option<u64>,
}

impl UploadLimit {
    /// Whether `size` more bytes fit after `bytes` are taken.
    fn allows(&self, bytes: u64, size: u64) -> bool {
        let fits = |limit: Option<u64>| limit.is_none_or(|limit| bytes + size <= limit);
        fits(self.room_bytes) && (bytes == 0 || fits(self.goal_bytes))
    }
}

impl Residency {
    /// Initial state without resident bricks, for volumes with slot contents kept in `held`. Arriving bricks fade in over the time `fade`;
    /// with `None` they are drawn at once.
    pub(crate) fn new(held: Vec<Arc<SlotsByContent>>, slots: u32, fade: Option<Duration>) -> Self {
        let bricks = || Bricks { staged: BTreeMap::new(), failed: FxHashMap::default(), fades: Fades::new(fade) };
        Self {
            volumes: held.iter().map(|_| bricks()).collect(),
            slots: SlotTable::new(slots, held),
            steps_ahead: Vec::new(),
            counters: Counters::default(),
        }
    }

    pub(crate) fn arrive(&mut self, volume: usize, arrival: Arrival) {
        let Bricks { staged, failed, .. } = &mut self.volumes[volume];
        let brick = VolumeBrick { volume, id: arrival.id };
        match arrival.result {
            Ok(Arrived::Read { codes, content }) => drop(staged.insert(arrival.id, Staged { codes, content })),
            // If the slot has been given away meanwhile, the brick is requested again.
            Ok(Arrived::Held(content)) => {
                self.counters.shared += self.slots.share(brick, content, Tier::Ring) as u64;
            }
            Err(Failure { again: Some(_), .. }) => {}
            Err(Failure { error, again: None }) => {
                failed.insert(arrival.id, error);
                self.slots.changes.note(brick);
            }
        }
    }

    /// Forgets failures: these bricks may be readable after all.
    pub(crate) fn forget_failures(&mut self, volume: usize, bricks: &[BrickId]) {
        for &id in bricks {
            self.volumes[volume].failed.remove(&id);
            self.slots.changes.note(VolumeBrick { volume, id });
        }
    }

    /// Forgets all slot contents and sets the number of slots.
    pub(crate) fn forget_slots(&mut self, slots: u32) {
        self.slots.forget(slots);
        self.steps_ahead.clear();
    }

    pub(crate) fn has_staged(&self) -> bool {
        self.volumes.iter().any(|bricks| !bricks.staged.is_empty())
    }

    pub(crate) fn failure(&self, volume: usize, id: BrickId) -> Option<&BrickError> {
        self.volumes[volume].failed.get(&id)
    }

    fn slot(&self, volume: usize, id: BrickId) -> Option<Slot> {
        self.slots.get(VolumeBrick { volume, id })
    }

    #[cfg(test)]
    pub(crate) fn is_resident(&self, brick: VolumeBrick) -> bool {
        self.slots.get(brick).is_some()
    }

    fn state(&self, volume: usize, id: BrickId) -> State {
        match self.slot(volume, id) {
            Some(_) => State::Resident,
            None if self.failure(volume, id).is_some() => State::Failed,
            None => State::Absent,
        }
    }

    /// Runs one frame of all volumes. Places staged bricks, in the plan's order and within a limit, into slots without wanted bricks; then
    /// makes the draw lists and plans from the resident bricks. `at` is the frame's time.
    pub(crate) fn step(&mut self, wants: &[Wants<'_>], ahead: Ahead<'_>, limit: UploadLimit, at: Duration) -> Step {
        self.slots.begin_frame();
        let pins = wants.iter().enumerate().flat_map(|(volume, wants)| bricks_of(volume, wants.goal.roots()));
        self.slots.set_pins(pins.collect());
        self.volumes.iter_mut().for_each(|bricks| bricks.fades.advance(at));
        let goals: Vec<Goal<'_>> = wants.iter().map(|wants| wants.goal).collect();
        let is_of_frame =
            |time| goals.iter().chain(ahead.coming.iter().flatten()).any(|goal| goal.cut.view.time == time);
        self.slots.changes.keep(is_of_frame);
        let mut stand_ins = self.stand_ins(wants);
        let (mut fetched, mut coming) = self.ahead(&goals, ahead);
        self.claim(wants, &fetched.kept, &stand_ins);
        let mut needed = self.needed(&goals, &stand_ins);
        let (mut uploads, mut stale) = (Vec::new(), vec![Vec::new(); wants.len()]);
        let (shared, last_change) = (self.counters.shared, self.slots.changes.last_of(&goals));
        if self.has_staged() {
            uploads = self.place(&all_requests(needed.clone(), &fetched), limit, &mut stale);
        }
        if !uploads.is_empty() || self.counters.shared > shared {
            (fetched, coming) = self.ahead(&goals, ahead);
        }
        if self.slots.changes.last_of(&goals) != last_change {
            let before = std::mem::replace(&mut stand_ins, self.stand_ins(wants));
            // During playback, the next step comes before a fade would end.
            if ahead.coming.is_empty() {
                self.begin_fades(wants, &before, &stand_ins);
            }
            needed = self.needed(&goals, &stand_ins);
        }
        let requests = all_requests(needed, &fetched);
        let draw = |(volume, (wants, stand_ins)): (usize, (&Wants<'_>, &StandIns))| VolumeStep {
            draw: self.draw(volume, wants, stand_ins),
            resident: wants.sight.cells.iter().map(|ranked| stand_ins.is_resident(ranked.cell)).collect(),
            requests: Vec::new(),
            stale: std::mem::take(&mut stale[volume]),
        };
        let mut volumes: Vec<VolumeStep> = wants.iter().zip(&stand_ins).enumerate().map(draw).collect();
        let is_fading = volumes.iter().any(|volume| volume.draw.is_fading());
        let settled = requests.first().is_none_or(|(tier, _)| tier.is_ahead()) && !is_fading;
        for (tier, VolumeBrick { volume, id }) in requests {
            if !self.volumes[volume].staged.contains_key(&id) {
                volumes[volume].requests.push((tier, id));
            }
        }
        Step { uploads, volumes, settled, coming }
    }

    fn draw(&mut self, volume: usize, wants: &Wants<'_>, stand_ins: &StandIns) -> DrawList {
        let &Wants { goal, sight } = wants;
        // A finer brick may come before a root, from another worker, but a picture with holes is none.
        if goal.roots().any(|root| self.state(volume, root) == State::Absent) {
            return DrawList::default();
        }
        // Renderers have room for as many entries as there are slots.
        let room = self.slots.count().saturating_sub(sight.cells.len());
        DrawList::new(goal.pyramid, goal.cut, sight, stand_ins, |brick, pairs| self.fading(volume, brick, pairs < room))
    }

    fn stand_ins(&self, wants: &[Wants<'_>]) -> Vec<StandIns> {
        let of_volume = |(volume, &Wants { goal: Goal { cut, .. }, sight }): (usize, &Wants<'_>)| {
            let concerns = |node: NodeId| cut.is_visible(node) || !sight.is_planned;
            StandIns::new(cut, concerns, |id| self.slot(volume, id))
        };
        wants.iter().enumerate().map(of_volume).collect()
    }

    /// Starts fades of bricks that arrived where an ancestor was drawn.
    fn begin_fades(&mut self, wants: &[Wants<'_>], before: &[StandIns], now: &[StandIns]) {
        for (((bricks, wants), before), now) in self.volumes.iter_mut().zip(wants).zip(before).zip(now) {
            if !bricks.fades.are_wanted() {
                return;
            }
            for &Ranked { cell, .. } in &wants.sight.cells {
                // Parents come before children in a cut. A coarser stand-in than before replaces an evicted brick.
                if let (Some(before), Some(now)) = (before.of(cell), now.of(cell))
                    && now > before
                {
                    bricks.fades.begin(wants.goal.cut.id(now), wants.goal.cut.id(before));
                }
            }
        }
    }

    /// The brick replaced by a fading one, with its slot.
    fn fading(&mut self, volume: usize, brick: BrickId, has_room: bool) -> Option<(Fading, Slot)> {
        let fading = self.volumes[volume].fades.of(brick)?;
        let slot = self.slot(volume, fading.before).filter(|_| has_room);
        if slot.is_none() {
            self.volumes[volume].fades.end(brick);
        }
        slot.map(|slot| (fading, slot))
    }

    /// Claims the stand-ins of the wanted cells, and prefetched bricks. Other drawn bricks are the next to be kept.
    fn claim(&mut self, wants: &[Wants<'_>], ahead: &[(Tier, VolumeBrick)], stand_ins: &[StandIns]) {
        for (volume, (bricks, wants)) in self.volumes.iter().zip(wants).enumerate() {
            let (cut, stand_ins) = (wants.goal.cut, &stand_ins[volume]);
            bricks.fades.before().for_each(|id| self.slots.touch(VolumeBrick { volume, id }));
            let others = wants.sight.cells.iter().filter(|ranked| !cut.is_wanted(ranked.cell));
            let drawn = others.filter_map(|ranked| stand_ins.of(ranked.cell));
            drawn.for_each(|stand_in| self.slots.touch(VolumeBrick { volume, id: cut.id(stand_in) }));
        }
        ahead.iter().rev().for_each(|&(tier, brick)| self.slots.claim(brick, tier));
        for (volume, Wants { goal, .. }) in wants.iter().enumerate() {
            let wanted = goal.cut.wanted_cells().filter_map(|cell| stand_ins[volume].of(cell));
            for stand_in in wanted {
                self.slots.claim(VolumeBrick { volume, id: goal.cut.id(stand_in) }, Tier::Visible);
            }
        }
    }

    /// Selects bricks to keep and prefetch, as far as there is room beside the view's own, so each gets a slot. Also returns the readiness
    /// of each coming step. The nearest steps come first. A step that does not fit waits, with all after it: half a step is useless, and
    /// its bricks would come and go. Of the first step as much is kept as fits. A step's missing bricks are left out while the steps before
    /// it lack enough.
    fn ahead(&mut self, goals: &[Goal<'_>], ahead: Ahead<'_>) -> (Fetched, Vec<Readiness>) {
        let needed: usize = goals.iter().map(|goal| goal.cut.wanted() + goal.cut.roots).sum();
        let mut room = self.slots.count().saturating_sub(needed);
        let (mut fetched, mut coming) = (Fetched::default(), Vec::new());
        let mut known = std::mem::take(&mut self.steps_ahead);
        for (i, goals) in ahead.coming.iter().enumerate() {
            if goals.is_empty() || room == 0 {
                coming.push(Readiness::default());
                continue;
            }
            let step = match known.iter().position(|step| step.is_of(goals, &self.slots.changes)) {
                Some(same) => known.swap_remove(same),
                None => self.step_ahead(goals),
            };
            coming.push(step.readiness);
            let needed = step.there.len() + step.lacking.len();
            if i > 0 && needed > room {
                room = 0;
            }
            let has_enough = fetched.lacking.len() >= ENOUGH_REQUESTS;
            let room_for_lacking = if has_enough { 0 } else { room.saturating_sub(step.there.len()) };
            let of_step = |brick: &VolumeBrick| (Tier::Coming, *brick);
            fetched.kept.extend(step.there.iter().take(room).map(of_step));
            fetched.lacking.extend(step.lacking.iter().take(room_for_lacking).map(of_step));
            room = room.saturating_sub(needed);
            self.steps_ahead.push(step);
        }
        self.fetch_listed(ahead.listed, room, &mut fetched);
        (fetched, coming)
    }

    /// Adds listed bricks to the fetched ones, as far as there is room; in each tier the resident before the missing, so that bricks of a
    /// tier do not displace each other.
    fn fetch_listed(&self, listed: &[(Tier, VolumeBrick)], mut room: usize, fetched: &mut Fetched) {
        for of_tier in listed.chunk_by(|a, b| a.0 == b.0) {
            let state = |brick: &VolumeBrick| self.state(brick.volume, brick.id);
            let readable = of_tier.iter().copied().filter(|(_, brick)| state(brick) != State::Failed);
            let (there, missing): (Vec<_>, Vec<_>) = readable.partition(|(_, brick)| state(brick) == State::Resident);
            let share = of_tier[0].0.slots(self.slots.count()).min(room);
            room -= share.min(there.len() + missing.len());
            fetched.kept.extend(there.iter().take(share));
            fetched.lacking.extend(missing.iter().take(share.saturating_sub(there.len())));
        }
    }

    /// Finds the present and missing bricks of a coming step.
    fn step_ahead(&self, goals: &[Goal<'_>]) -> StepAhead {
        let (mut there, mut missing, mut is_drawn_everywhere) = (Vec::new(), Vec::new(), true);
        for (volume, goal) in goals.iter().enumerate() {
            let cut = goal.cut;
            let stand_ins = StandIns::new(cut, |node| cut.is_visible(node), |id| self.slot(volume, id));
            let resident_roots = goal.roots().filter(|&root| self.state(volume, root) == State::Resident);
            let mut of_volume: Vec<BrickId> = resident_roots.collect();
            is_drawn_everywhere &= goal.roots().all(|root| self.state(volume, root) != State::Absent);
            is_drawn_everywhere &= cut.wanted_cells().all(|cell| stand_ins.of(cell).is_some());
            of_volume.extend(cut.wanted_cells().filter_map(|cell| stand_ins.of(cell)).map(|node| cut.id(node)));
            of_volume.sort_unstable();
            of_volume.dedup();
            there.extend(bricks_of(volume, of_volume));
            missing.extend(self.missing(volume, goal, &stand_ins));
        }
        let lacking = plan::in_order(missing).into_iter().map(|(_, brick)| brick).collect();
        StepAhead::new(goals, &self.slots.changes, there, lacking, is_drawn_everywhere)
    }

    /// Missing bricks of a volume's goal, in no order, with their keys.
    fn missing(&self, volume: usize, goal: &Goal<'_>, stand_ins: &StandIns) -> Vec<(Key, VolumeBrick)> {
        let cut = goal.cut;
        let state_of = |node| match stand_ins.is_resident(node) {
            true => State::Resident,
            false if self.failure(volume, cut.id(node)).is_some() => State::Failed,
            false => State::Absent,
        };
        let requests = plan::requests(goal, state_of, |id| self.state(volume, id));
        requests.into_iter().map(|(key, id)| (key, VolumeBrick { volume, id })).collect()
    }

    /// Missing bricks of the views themselves over all volumes, the most urgent first.
    fn needed(&self, goals: &[Goal<'_>], stand_ins: &[StandIns]) -> Vec<(Tier, VolumeBrick)> {
        let of_volume = |(volume, goal): (usize, &Goal<'_>)| self.missing(volume, goal, &stand_ins[volume]);
        plan::in_order(goals.iter().enumerate().flat_map(of_volume).collect())
    }

    fn place(
        &mut self,
        requests: &[(Tier, VolumeBrick)],
        limit: UploadLimit,
        stale: &mut [Vec<Arc<[u8]>>],
    ) -> Vec<Upload> {
        let mut uploads: Vec<Upload> = Vec::new();
        let (mut kept, mut bytes): (Vec<BTreeMap<BrickId, Staged>>, u64) =
            (self.volumes.iter().map(|_| BTreeMap::new()).collect(), 0);
        for &(tier, brick) in requests {
            let VolumeBrick { volume, id } = brick;
            let Some(Staged { codes, content }) = self.volumes[volume].staged.remove(&id) else { continue };
            // An equal brick of another step may have come first.
            if content.is_some_and(|content| self.slots.share(brick, content, tier)) {
                self.counters.shared += 1;
                stale[volume].push(codes);
                continue;
            }
            let size = codes.len() as u64;
            let acquired = if limit.allows(bytes, size) { self.slots.acquire(brick, content, tier) } else { None };
            match acquired {
                Some(acquired) => {
                    bytes += size;
                    self.counters.reuploaded += acquired.again as u64;
                    self.counters.uploaded_ahead += tier.is_ahead() as u64;
                    uploads.push(Upload { volume, slot: acquired.slot, brick: id, codes });
                }
                None => drop(kept[volume].insert(id, Staged { codes, content })),
            }
        }
        for ((bricks, kept), stale) in self.volumes.iter_mut().zip(kept).zip(stale) {
            let left = std::mem::replace(&mut bricks.staged, kept).into_values();
            stale.extend(left.map(|staged| staged.codes));
        }
        self.counters.uploaded += uploads.len() as u64;
        self.counters.bytes_uploaded += bytes;
        uploads
    }
}
