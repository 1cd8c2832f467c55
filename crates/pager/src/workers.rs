//! Worker threads, which take bricks from the newest plan, decode and assemble them, and send them to the frame loop. For a source far away others fetch
//! the coming bricks' bytes ahead of them.
//!
//! A plan replaces the last one at once: unlisted bricks are dropped, and bricks in progress are not started twice. Padded buffers are
//! counted: a worker takes a brick only together with a buffer, and buffers return through the frame loop, so the channel is bounded in
//! bytes. Before decoding, a worker announces the next batch of bricks to the source, so the disk works ahead of the decoder. A brick
//! whose read failed for a passing reason is postponed until its next try; the others go on.

use crate::assemble::PaddedReader;
use crate::budget::Meter;
use crate::buffer_lru::zeroed;
use crate::leave::Threads;
use crate::ram_cache::RamCache;
use crate::residency::{Arrival, Arrived};
use crate::retry::Failure;
use crate::sameness::{Content, SlotsByContent};
use crate::source::caught;
use crate::tier::Tier;
use brickyard_store::{Cancellation, FetchRoom};
use brickyard_volume::{BrickId, BrickIndex, Pyramid, VoxelBox};
use crossbeam_channel::{Receiver, Sender, bounded};
use rustc_hash::{FxHashMap, FxHashSet};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Bricks advised at a time. Cold reads with batches of 16 are several times faster than plain page faults.
pub(crate) const ADVISE_BATCH: usize = 16;

pub(crate) struct Workers {
    shared: Arc<Shared>,
    /// A worker waiting for room in the channel gets an error once this is dropped.
    pub(crate) arrivals: Receiver<Arrival>,
    threads: Threads,
}

struct Shared {
    queue: Mutex<Queue>,
    /// Notified of possible work and on stop: workers, and the threads that fetch ahead of them.
    wake: Condvar,
    wake_ahead: Condvar,
    padded_bytes: usize,
    meter: Arc<Meter>,
    held: Arc<SlotsByContent>,
}

#[derive(Default)]
struct Queue {
    requests: Vec<(Tier, BrickId)>,
    /// Requests before this one are taken or postponed.
    next: usize,
    /// Earliest time of the next try, by brick.
    not_before: FxHashMap<BrickId, Instant>,
    put_off: Vec<(Tier, BrickId)>,
    /// Requests before this one have been advised.
    advised: usize,
    /// Requests before this one are fetched, or being fetched.
    fetched: usize,
    /// Bricks that may be fetched before they are read.
    ahead: usize,
    /// Bricks being fetched ahead.
    under_way: Vec<UnderWay>,
    /// Bricks taken, but not yet received by the frame loop.
    busy: FxHashSet<BrickId>,
    /// Padded bricks that may still be started.
    permits: usize,
    /// Most padded bricks in flight.
    staged: usize,
    /// Buffers for reuse; never more than permits.
    free: Vec<Arc<[u8]>>,
    stop: bool,
}

/// Bricks of a plan that a thread fetches ahead, with those around them.
struct UnderWay {
    ids: Vec<BrickId>,
    cancellation: Cancellation,
}

struct Job {
    id: BrickId,
    buffer: Arc<[u8]>,
    advise: Vec<BrickId>,
}

/// A brick read by a worker, or its failure.
enum Found {
    /// A slot holds the same content.
    Held(Content),
    /// The buffer holds the brick, with its content if known.
    Read(Option<Content>),
}

impl Queue {
    /// Takes the next brick to read, if one is due and a buffer is permitted.
    fn take(&mut self, now: Instant) -> Option<BrickId> {
        let put_off = self.put_off.iter().position(|&(tier, id)| self.is_due(id, now) && self.has_permit(tier));
        if let Some((_, id)) = put_off.map(|i| self.put_off.remove(i)) {
            self.not_before.remove(&id);
            return Some(id);
        }
        while let Some(&(tier, id)) = self.requests.get(self.next) {
            if self.busy.contains(&id) {
                self.next += 1;
            } else if !self.is_due(id, now) {
                self.put_off.push((tier, id));
                self.next += 1;
            } else if self.has_permit(tier) {
                self.not_before.remove(&id);
                self.next += 1;
                return Some(id);
            } else {
                return None;
            }
        }
        None
    }

    /// Takes the next bricks to fetch, of one level: the coarsest ones come alone, thus soon.
    fn take_to_fetch(&mut self, room: FetchRoom) -> Vec<BrickId> {
        self.ahead = room.ahead;
        let first = self.fetched.max(self.next);
        let last = (first + room.bricks).min(self.requests.len()).min(self.next + room.ahead);
        let Some(batch) = self.requests.get(first..last) else { return Vec::new() };
        let Some(&(_, coarsest)) = batch.first() else { return Vec::new() };
        let batch = batch.iter().map(|(_, id)| *id).take_while(|id| id.level == coarsest.level);
        let batch: Vec<BrickId> = batch.collect();
        self.fetched = first + batch.len();
        batch
    }

    /// Cancels the fetching of bricks of which the plan wants none.
    fn cancel_unwanted(&mut self) {
        if self.under_way.is_empty() {
            return;
        }
        let wanted: FxHashSet<BrickId> =
            self.requests.iter().map(|(_, id)| *id).chain(self.busy.iter().copied()).collect();
        let is_unwanted = |under_way: &&UnderWay| !under_way.ids.iter().any(|id| wanted.contains(id));
        self.under_way.iter().filter(is_unwanted).for_each(|under_way| under_way.cancellation.cancel());
    }

    /// Whether no brick of the plan may be fetched now.
    fn is_fetched(&self) -> bool {
        let first = self.fetched.max(self.next);
        first >= self.requests.len() || first >= self.next + self.ahead
    }

    fn has_permit(&self, tier: Tier) -> bool {
        self.permits > self.staged - tier.staged(self.staged)
    }

    fn is_due(&self, id: BrickId, now: Instant) -> bool {
        self.not_before.get(&id).is_none_or(|&time| time <= now)
    }

    fn next_due(&self) -> Option<Instant> {
        let has_permit = |(tier, _): &&(Tier, BrickId)| self.has_permit(*tier);
        self.put_off.iter().filter(has_permit).filter_map(|(_, id)| self.not_before.get(id)).min().copied()
    }
}

impl Workers {
    /// Starts `threads` workers with at most `staged` padded bricks in flight in total. Contents in `held` are not read.
    pub(crate) fn start(
        cache: &Arc<RamCache>,
        threads: u32,
        staged: usize,
        meter: Arc<Meter>,
        held: Arc<SlotsByContent>,
    ) -> std::io::Result<Self> {
        let padded_bytes = cache.layout.padded_bytes();
        let queue = Mutex::new(Queue { permits: staged, staged, ahead: 1, ..Queue::default() });
        let (wake, wake_ahead) = (Condvar::new(), Condvar::new());
        let shared = Arc::new(Shared { queue, wake, wake_ahead, padded_bytes, meter, held });
        let (sender, arrivals) = bounded(staged);
        let mut workers = Self { shared, arrivals, threads: Threads::default() };
        for i in 0..threads {
            let (shared, sender) = (workers.shared.clone(), sender.clone());
            let reader = PaddedReader::new(cache.clone());
            let work = move || shared.work(reader, &sender);
            workers.threads.start(format!("brick-worker-{i}"), work)?;
        }
        for i in 0..cache.source().fetchers() {
            let (shared, cache) = (workers.shared.clone(), cache.clone());
            workers.threads.start(format!("brick-fetcher-{i}"), move || shared.fetch(&cache))?;
        }
        Ok(workers)
    }

    /// Replaces the plan: the bricks to read, the most urgent first. Ends the fetching of others, if the source is backed up.
    pub(crate) fn replace(&self, requests: Vec<(Tier, BrickId)>, is_backed_up: bool) {
        let mut queue = self.shared.lock();
        queue.requests = requests;
        queue.put_off.clear();
        (queue.next, queue.advised, queue.fetched) = (0, 0, 0);
        if is_backed_up {
            queue.cancel_unwanted();
        }
        self.shared.wake.notify_all();
        self.shared.wake_ahead.notify_all();
    }

    /// Next brick that was read or failed; `None` if there is none now.
    pub(crate) fn try_receive(&self) -> Option<Arrival> {
        let arrival = self.arrivals.try_recv().ok()?;
        self.shared.lock().busy.remove(&arrival.id);
        Some(arrival)
    }

    /// Takes padded buffers back. A buffer with another holder is left to that holder and no longer counts.
    pub(crate) fn give_back(&self, buffers: impl IntoIterator<Item = Arc<[u8]>>) {
        buffers.into_iter().for_each(|buffer| self.shared.give_back(buffer));
    }

    /// Whether any brick of the plan is unread, being read, or not yet received.
    pub(crate) fn is_busy(&self) -> bool {
        let queue = self.shared.lock();
        !queue.busy.is_empty() || queue.next < queue.requests.len() || !queue.put_off.is_empty()
    }
}

/// A brick and the up to 26 around it on its level.
fn with_neighbours(pyramid: &Pyramid, id: BrickId) -> Vec<BrickId> {
    let grid = pyramid.level(id.level).bricks.full_box();
    let index = id.index.to_array();
    let min = index.map(|i| i.saturating_sub(1));
    let around = VoxelBox::new(min, index.map(|i| i + 2)).intersect(grid);
    around.voxels().map(|[x, y, z]| BrickId { index: BrickIndex::new(x, y, z), ..id }).collect()
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.wake.notify_all();
        self.shared.wake_ahead.notify_all();
    }
}

impl Shared {
    fn work(&self, mut reader: PaddedReader, sender: &Sender<Arrival>) {
        while let Some(Job { id, mut buffer, advise: batch }) = self.take() {
            let read = caught(id, "the reader", || self.read(&mut reader, id, &mut buffer, batch));
            let result = match read {
                Ok(Found::Held(content)) => {
                    self.give_back(buffer);
                    Ok(Arrived::Held(content))
                }
                Ok(Found::Read(content)) => Ok(Arrived::Read { codes: buffer, content }),
                Err(failure) => {
                    failure.again.map(|again| self.lock().not_before.insert(id, again));
                    self.give_back(buffer);
                    Err(failure)
                }
            };
            if sender.send(Arrival { id, result }).is_err() {
                return;
            }
        }
    }

    /// Fetches the bytes of coming bricks, and of those around them, ahead of the workers.
    fn fetch(&self, cache: &RamCache) {
        let source = cache.source();
        let needed =
            |id: BrickId| if source.stored_apron() > 0 { vec![id] } else { with_neighbours(source.pyramid(), id) };
        while self.awaits_fetch() {
            let cancellation = Cancellation::default();
            let mut take = |room| {
                let mut queue = self.lock();
                let taken = queue.take_to_fetch(room);
                queue.under_way.push(UnderWay { ids: taken.clone(), cancellation: cancellation.clone() });
                drop(queue);
                let mut ids: Vec<BrickId> = taken.into_iter().flat_map(needed).filter(|id| !cache.holds(*id)).collect();
                ids.sort_unstable();
                ids.dedup();
                ids
            };
            cancellation.during(|| source.fetch(&mut take));
            self.lock().under_way.retain(|under_way| under_way.cancellation != cancellation);
        }
    }

    /// Waits until a brick of the plan may be fetched; false to stop.
    fn awaits_fetch(&self) -> bool {
        let is_idle = |queue: &mut Queue| !queue.stop && queue.is_fetched();
        let queue = self.wake_ahead.wait_while(self.lock(), is_idle).unwrap_or_else(PoisonError::into_inner);
        !queue.stop
    }

    /// Advises the batch, and reads a brick into the buffer unless a slot holds its content.
    fn read(
        &self,
        reader: &mut PaddedReader,
        id: BrickId,
        buffer: &mut Arc<[u8]>,
        batch: Vec<BrickId>,
    ) -> Result<Found, Failure> {
        let is_held = |content: &Content| self.held.lock().contains_key(content);
        let to_read = |id: &BrickId| !reader.cache.content(*id).as_ref().is_some_and(is_held);
        let batch: Vec<BrickId> = batch.into_iter().filter(to_read).collect();
        if !batch.is_empty() {
            reader.cache.source().advise(&batch);
        }
        let content = reader.cache.content(id);
        if let Some(content) = content.filter(is_held) {
            return Ok(Found::Held(content));
        }
        // A buffer from `take` has one holder, so the copy never happens.
        let is_whole = reader.try_read(id, Arc::make_mut(buffer))?;
        // Voxels missing from a neighbour may be present in another step.
        Ok(Found::Read(content.filter(|_| is_whole)))
    }

    /// Waits for the next brick of the plan and a buffer for it; `None` to stop.
    fn take(&self) -> Option<Job> {
        let mut queue = self.lock();
        loop {
            if queue.stop {
                return None;
            }
            let now = Instant::now();
            if let Some(id) = queue.take(now) {
                return Some(self.start(queue, id));
            }
            queue = match queue.next_due() {
                Some(due) => {
                    let wait = self.wake.wait_timeout(queue, due.saturating_duration_since(now));
                    wait.unwrap_or_else(PoisonError::into_inner).0
                }
                None => self.wake.wait(queue).unwrap_or_else(PoisonError::into_inner),
            };
        }
    }

    fn start(&self, mut queue: MutexGuard<'_, Queue>, id: BrickId) -> Job {
        let mut advise = Vec::new();
        if queue.next > queue.advised {
            let taken = queue.next - 1;
            queue.advised = (taken + ADVISE_BATCH).min(queue.requests.len());
            advise.extend(queue.requests[taken..queue.advised].iter().map(|(_, id)| *id));
        }
        queue.permits -= 1;
        queue.busy.insert(id);
        let buffer = queue.free.pop();
        drop(queue);
        self.wake_ahead.notify_one();
        let buffer = buffer.unwrap_or_else(|| {
            self.meter.charge(self.padded_bytes as u64);
            zeroed(self.padded_bytes)
        });
        Job { id, buffer, advise }
    }

    fn give_back(&self, mut buffer: Arc<[u8]>) {
        let mut queue = self.lock();
        queue.permits += 1;
        if Arc::get_mut(&mut buffer).is_some() {
            queue.free.push(buffer);
        } else {
            self.meter.release(self.padded_bytes as u64);
        }
        drop(queue);
        self.wake.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        // Only allocation can panic under the lock, and the state is consistent at every step.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::Level;

    #[test]
    fn a_new_plan_ends_the_fetching_of_bricks_that_it_does_not_want() {
        let id = |x| BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
        let under_way = |bricks: &[u32]| UnderWay {
            ids: bricks.iter().map(|x| id(*x)).collect(),
            cancellation: Cancellation::default(),
        };
        let mut queue = Queue { under_way: [&[0, 1][..], &[2, 3], &[4]].map(under_way).into(), ..Queue::default() };
        queue.requests = vec![(Tier::Visible, id(1)), (Tier::Visible, id(9))];
        // One that a worker waits for.
        queue.busy.insert(id(4));
        queue.cancel_unwanted();
        let cancelled: Vec<bool> = queue.under_way.iter().map(|one| one.cancellation.is_cancelled()).collect();
        assert_eq!(cancelled, [false, true, false]);
    }
}
