//! Residency: which bricks are staged, resident or failed, and one frame's decisions over them, as a state machine without
//! threads, so that it can be tested against any order of arrivals.
//!
//! absent → (queued, decoding: the workers') → staged → resident → absent; or failed, until the reason has passed. What is to be
//! tried again stays absent: it is requested, and the workers see to when.
//!
//! Why a wanted brick always finds a slot, so that every frame makes progress: a frame protects the resident ones of the cut's
//! wanted cells and at most one stand-in for each missing one, and pins the roots, which the cut counts; together no more
//! than the cut's count, which is below the number of slots (or is the roots alone, which need no stand-ins). Cells that the cut
//! does not want, but that a newer view sees, are drawn with whatever is left: the list is made after the slots are given.

use crate::cut::Cut;
use crate::draw_list::{DrawList, Slot, StandIns};
use crate::fade::{Fades, Fading};
use crate::plan::{self, State, Tier};
use crate::retry::Failure;
use crate::sight::Sight;
use crate::slots::SlotTable;
use crate::source::BrickError;
use brickyard_volume::{BrickId, Pyramid};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::time::Duration;

/// A padded brick to write into a slot of the atlas.
#[derive(Clone, Debug)]
pub struct Upload {
    /// Where to.
    pub slot: Slot,
    /// Which brick.
    pub brick: BrickId,
    /// Its codes, `(edge + 2 * apron)^3`, x fastest.
    pub codes: Arc<[u8]>,
}

/// A brick back from the workers.
#[derive(Clone, Debug)]
pub(crate) struct Arrival {
    pub(crate) id: BrickId,
    pub(crate) result: Result<Arc<[u8]>, Failure>,
}

/// What one frame does.
#[derive(Debug)]
pub(crate) struct Step {
    pub(crate) uploads: Vec<Upload>,
    pub(crate) draw: DrawList,
    /// Of each cell in sight, whether its own brick is resident.
    pub(crate) resident: Vec<bool>,
    /// What to read next.
    pub(crate) requests: Vec<(Tier, BrickId)>,
    /// Arrivals that this view does not want.
    pub(crate) stale: Vec<Arc<[u8]>>,
    /// Whether all that is wanted is resident, or failed with its stand-in resident, and nothing fades in any more.
    pub(crate) settled: bool,
}

/// What a frame wants.
#[derive(Clone, Copy)]
pub(crate) struct Wants<'a> {
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) cut: &'a Cut,
    pub(crate) sight: &'a Sight,
    /// The coarsest bricks: pinned.
    pub(crate) roots: &'a [BrickId],
    /// Bricks to fetch ahead, tier by tier.
    pub(crate) ahead: &'a [(Tier, BrickId)],
}

pub(crate) struct Residency {
    slots: SlotTable,
    staged: BTreeMap<BrickId, Arc<[u8]>>,
    failed: HashMap<BrickId, BrickError>,
    fades: Fades,
    pub(crate) uploaded: u64,
    pub(crate) reuploaded: u64,
    pub(crate) uploaded_ahead: u64,
    pub(crate) bytes_uploaded: u64,
}

impl Residency {
    /// With so many slots; bricks that come take this long to fade in.
    pub(crate) fn new(slots: u32, fade: Option<Duration>) -> Self {
        Self {
            slots: SlotTable::new(slots),
            staged: BTreeMap::new(),
            failed: HashMap::new(),
            fades: Fades::new(fade),
            uploaded: 0,
            reuploaded: 0,
            uploaded_ahead: 0,
            bytes_uploaded: 0,
        }
    }

    pub(crate) fn arrive(&mut self, arrival: Arrival) {
        match arrival.result {
            Ok(codes) => drop(self.staged.insert(arrival.id, codes)),
            Err(Failure { again: Some(_), .. }) => {}
            Err(Failure { error, again: None }) => drop(self.failed.insert(arrival.id, error)),
        }
    }

    /// Bricks that may be read after all.
    pub(crate) fn forget_failures(&mut self, bricks: &[BrickId]) {
        bricks.iter().for_each(|id| drop(self.failed.remove(id)));
    }

    /// Forgets what is in the slots, of which there are so many from here on.
    pub(crate) fn forget_slots(&mut self, slots: u32) {
        self.slots = SlotTable::new(slots);
    }

    pub(crate) fn has_staged(&self) -> bool {
        !self.staged.is_empty()
    }

    pub(crate) fn is_resident(&self, id: BrickId) -> bool {
        self.slots.get(id).is_some()
    }

    pub(crate) fn failure(&self, id: BrickId) -> Option<&BrickError> {
        self.failed.get(&id)
    }

    /// One frame: places staged bricks, in the plan's order, into slots that nothing wanted is drawn from, at most
    /// `upload_bytes` but at least one; then draws and plans from what is resident. `at` is the frame's time.
    pub(crate) fn step(&mut self, wants: &Wants<'_>, upload_bytes: Option<u64>, at: Duration) -> Step {
        let &Wants { pyramid, cut, sight, roots, .. } = wants;
        self.slots.begin_frame();
        self.slots.set_pins(roots.to_vec());
        self.fades.advance(at);
        let mut stand_ins = self.stand_ins(cut, sight);
        self.claim(wants, &stand_ins);
        let mut requests = self.plan(wants, &stand_ins);
        let (mut uploads, mut stale) = (Vec::new(), Vec::new());
        if self.has_staged() {
            uploads = self.place(&requests, upload_bytes, &mut stale);
        }
        if !uploads.is_empty() {
            let before = std::mem::replace(&mut stand_ins, self.stand_ins(cut, sight));
            self.begin_fades(cut, sight, &before, &stand_ins);
            requests = self.plan(wants, &stand_ins);
        }
        // Renderers have room for as many entries as there are slots.
        let room = self.slots.count().saturating_sub(sight.cells.len());
        let draw = match self.has_roots(roots) {
            true => DrawList::new(pyramid, cut, sight, &stand_ins, |brick, pairs| self.fading(brick, pairs < room)),
            false => DrawList::default(),
        };
        let resident = sight.cells.iter().map(|&cell| stand_ins.is_resident(cell)).collect();
        let settled = requests.first().is_none_or(|(tier, _)| tier.is_ahead()) && !draw.is_fading();
        requests.retain(|(_, id)| !self.staged.contains_key(id));
        Step { uploads, draw, resident, requests, stale, settled }
    }

    /// Whether everything can be drawn with something. A finer brick may come before a root, from another worker, but a picture
    /// with holes is none.
    fn has_roots(&self, roots: &[BrickId]) -> bool {
        roots.iter().all(|&root| self.is_resident(root) || self.failed.contains_key(&root))
    }

    fn stand_ins(&self, cut: &Cut, sight: &Sight) -> StandIns {
        StandIns::new(cut, |node| node.is_visible || !sight.is_planned, |id| self.slots.get(id))
    }

    /// What comes where something was drawn, an ancestor, fades in.
    fn begin_fades(&mut self, cut: &Cut, sight: &Sight, before: &StandIns, now: &StandIns) {
        if !self.fades.are_wanted() {
            return;
        }
        for &cell in &sight.cells {
            // Parents come before children in a cut. What is coarser than before is there for something that had to go.
            if let (Some((before, _)), Some((now, _))) = (before.of(cell), now.of(cell))
                && now > before
            {
                self.fades.begin(cut.id(now), cut.id(before));
            }
        }
    }

    /// What a brick that fades in takes the place of, and that one's slot.
    fn fading(&mut self, brick: BrickId, has_room: bool) -> Option<(Fading, Slot)> {
        let fading = self.fades.of(brick)?;
        let slot = self.slots.get(fading.before).filter(|_| has_room);
        if slot.is_none() {
            self.fades.end(brick);
        }
        slot.map(|slot| (fading, slot))
    }

    /// Claims what stands for the wanted cells, and what is fetched ahead. What else is drawn comes next to be kept.
    fn claim(&mut self, wants: &Wants<'_>, stand_ins: &StandIns) {
        let &Wants { cut, sight, .. } = wants;
        self.fades.before().for_each(|brick| self.slots.touch(brick));
        let others = sight.cells.iter().filter(|&&cell| !cut.nodes[cell as usize].is_wanted());
        others.filter_map(|&cell| stand_ins.of(cell)).for_each(|(stand_in, _)| self.slots.touch(cut.id(stand_in)));
        self.ahead(wants).into_iter().rev().for_each(|(tier, id)| self.slots.claim(id, tier));
        let wanted = cut.wanted_cells().filter_map(|cell| stand_ins.of(cell));
        wanted.for_each(|(stand_in, _)| self.slots.claim(cut.id(stand_in), Tier::Visible));
    }

    /// What is kept and fetched ahead of the view, as far as there is room beside the view's own bricks: so that each gets a
    /// slot when it comes. What is there already comes before what is not: bricks of a tier do not displace each other.
    fn ahead(&self, wants: &Wants<'_>) -> Vec<(Tier, BrickId)> {
        let mut room = self.slots.count().saturating_sub(wants.cut.wanted() + wants.roots.len());
        let mut ahead = Vec::new();
        for of_tier in wants.ahead.chunk_by(|a, b| a.0 == b.0) {
            let readable = of_tier.iter().copied().filter(|(_, id)| !self.failed.contains_key(id));
            let (there, missing): (Vec<_>, Vec<_>) = readable.partition(|(_, id)| self.is_resident(*id));
            let share = of_tier[0].0.slots(self.slots.count()).min(room);
            let before = ahead.len();
            ahead.extend(there.into_iter().chain(missing).take(share));
            room -= ahead.len() - before;
        }
        ahead
    }

    fn plan(&self, wants: &Wants<'_>, stand_ins: &StandIns) -> Vec<(Tier, BrickId)> {
        let &Wants { pyramid, cut, roots, .. } = wants;
        let absent = |id| if self.failed.contains_key(&id) { State::Failed } else { State::Absent };
        let state_of = |position| match stand_ins.is_resident(position) {
            true => State::Resident,
            false => absent(cut.id(position)),
        };
        let state_of_brick = |id| if self.is_resident(id) { State::Resident } else { absent(id) };
        let mut requests = plan::requests(pyramid, cut, roots, state_of, state_of_brick);
        requests.extend(self.ahead(wants).into_iter().filter(|(_, id)| state_of_brick(*id) == State::Absent));
        requests
    }

    fn place(&mut self, requests: &[(Tier, BrickId)], limit: Option<u64>, stale: &mut Vec<Arc<[u8]>>) -> Vec<Upload> {
        let mut uploads: Vec<Upload> = Vec::new();
        let (mut kept, mut bytes) = (BTreeMap::new(), 0);
        for &(tier, brick) in requests {
            let Some(codes) = self.staged.remove(&brick) else { continue };
            let size = codes.len() as u64;
            let allowed = uploads.is_empty() || limit.is_none_or(|limit| bytes + size <= limit);
            let acquired = if allowed { self.slots.acquire(brick, tier) } else { None };
            match acquired {
                Some(acquired) => {
                    bytes += size;
                    self.reuploaded += acquired.again as u64;
                    self.uploaded_ahead += tier.is_ahead() as u64;
                    uploads.push(Upload { slot: acquired.slot, brick, codes });
                }
                None => drop(kept.insert(brick, codes)),
            }
        }
        stale.extend(std::mem::replace(&mut self.staged, kept).into_values());
        self.uploaded += uploads.len() as u64;
        self.bytes_uploaded += bytes;
        uploads
    }
}
