//! Residency: which bricks are staged, resident or failed, and one frame's decisions over them, as a state machine without
//! threads, so that it can be tested against any order of arrivals.
//!
//! absent → (queued, decoding: the workers') → staged → resident → absent; or failed, for good.
//!
//! Why a wanted brick always finds a slot, so that every frame makes progress: a frame protects the resident cells and at
//! most one stand-in for each missing cell, and pins the roots, which the cut counts; together no more than the cut's count,
//! which is below the number of slots (or is the roots alone, which need no stand-ins).

use crate::cut::Cut;
use crate::draw_list::{DrawList, Slot};
use crate::plan::{self, State};
use crate::slots::SlotTable;
use crate::source::BrickError;
use brickyard_volume::{BrickId, Pyramid};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

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
    pub(crate) result: Result<Arc<[u8]>, BrickError>,
}

/// What one frame does.
#[derive(Debug)]
pub(crate) struct Step {
    pub(crate) uploads: Vec<Upload>,
    pub(crate) draw: DrawList,
    /// What to read next.
    pub(crate) requests: Vec<BrickId>,
    /// Arrivals that this view does not want.
    pub(crate) stale: Vec<Arc<[u8]>>,
    /// Whether all that is wanted is resident, or failed with its stand-in resident.
    pub(crate) settled: bool,
}

pub(crate) struct Residency {
    slots: SlotTable,
    staged: BTreeMap<BrickId, Arc<[u8]>>,
    failed: HashMap<BrickId, BrickError>,
    pub(crate) uploaded: u64,
    pub(crate) reuploaded: u64,
    pub(crate) bytes_uploaded: u64,
}

impl Residency {
    pub(crate) fn new(slots: u32) -> Self {
        Self {
            slots: SlotTable::new(slots),
            staged: BTreeMap::new(),
            failed: HashMap::new(),
            uploaded: 0,
            reuploaded: 0,
            bytes_uploaded: 0,
        }
    }

    pub(crate) fn arrive(&mut self, arrival: Arrival) {
        match arrival.result {
            Ok(codes) => drop(self.staged.insert(arrival.id, codes)),
            Err(err) => drop(self.failed.insert(arrival.id, err)),
        }
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

    /// One frame of `cut`: places staged bricks, in the plan's order, into slots that this frame does not draw, at most
    /// `upload_bytes` but at least one; then draws and plans from what is resident.
    pub(crate) fn step(&mut self, pyramid: &Pyramid, cut: &Cut, roots: &[BrickId], upload_bytes: Option<u64>) -> Step {
        self.slots.begin_frame();
        self.slots.set_pins(roots.to_vec());
        let mut draw = self.draw(pyramid, cut);
        let mut requests = self.plan(pyramid, cut, roots);
        let (mut uploads, mut stale) = (Vec::new(), Vec::new());
        if self.has_staged() {
            uploads = self.place(&requests, upload_bytes, &mut stale);
        }
        if !uploads.is_empty() {
            draw = self.draw(pyramid, cut);
            requests = self.plan(pyramid, cut, roots);
        }
        let settled = requests.is_empty();
        requests.retain(|id| !self.staged.contains_key(id));
        Step { uploads, draw, requests, stale, settled }
    }

    /// The draw list, all of whose slots are protected from here on.
    fn draw(&mut self, pyramid: &Pyramid, cut: &Cut) -> DrawList {
        let draw = DrawList::new(pyramid, cut, |id| self.slots.get(id));
        draw.cells.iter().for_each(|cell| self.slots.protect(cell.brick));
        draw
    }

    fn plan(&self, pyramid: &Pyramid, cut: &Cut, roots: &[BrickId]) -> Vec<BrickId> {
        plan::requests(pyramid, cut, roots, |id| {
            if self.is_resident(id) {
                State::Resident
            } else if self.failed.contains_key(&id) {
                State::Failed
            } else {
                State::Absent
            }
        })
    }

    fn place(&mut self, requests: &[BrickId], limit: Option<u64>, stale: &mut Vec<Arc<[u8]>>) -> Vec<Upload> {
        let mut uploads: Vec<Upload> = Vec::new();
        let (mut kept, mut bytes) = (BTreeMap::new(), 0);
        for &brick in requests {
            let Some(codes) = self.staged.remove(&brick) else { continue };
            let size = codes.len() as u64;
            let allowed = uploads.is_empty() || limit.is_none_or(|limit| bytes + size <= limit);
            let acquired = if allowed { self.slots.acquire(brick) } else { None };
            match acquired {
                Some(acquired) => {
                    bytes += size;
                    self.reuploaded += acquired.again as u64;
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
