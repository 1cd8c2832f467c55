//! Occupancy of bricks for a planner that never waits: a separate thread reads pages on demand, and a budget limits the kept ones.
//!
//! Until its page arrives, a brick has the occupancy of its nearest ancestor with a page. An ancestor's entry covers its descendants', so
//! a plan may want an empty brick, but leaves none out. Once the page has arrived, the plan is remade ([`PagedOccupancy::version`]). For
//! an unreadable page ancestors stand in as long as it is kept; if the reason may pass, the next view tries again.
//!
//! A page requested since the view changed is not evicted for another one; where no more fit, ancestors stand in for the rest. Thus even a
//! view with too many pages settles.
//!
//! Costs about 60 ns per look-up, and 8 bytes per brick of the kept pages.

use crate::leave::Threads;
use crate::source::{BrickError, BrickSource};
use brickyard_store::FetchRoom;
use brickyard_volume::{
    BrickId, Geometry, Level, Occupancy, OccupancyBins, PAGE_EDGE_BRICKS, PageId, Pyramid, VoxelType,
};
use crossbeam_channel::{Receiver, Sender, bounded, unbounded};
use lru::LruCache;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Source with occupancy read page by page, on demand.
pub(crate) struct PagedOccupancy {
    source: Arc<dyn BrickSource>,
    pages: Mutex<Pages>,
}

struct Pages {
    kept: LruCache<PageId, Page>,
    /// `None` once the reader is to stop.
    asked: Option<Sender<PageId>>,
    /// Requested pages that have not arrived.
    waiting: usize,
    /// Counts views.
    view: u64,
    version: u64,
}

struct Page {
    content: Content,
    /// Last view that requested the page.
    view: u64,
}

#[derive(Clone)]
enum Content {
    Asked,
    Known(Arc<[Occupancy]>),
    /// For good, or for a reason that may pass.
    Unreadable {
        is_passing: bool,
    },
}

/// Most bytes of a page of bricks.
const PAGE_BYTES: u64 = (PAGE_EDGE_BRICKS as u64).pow(3) * size_of::<Occupancy>() as u64 + 128;

/// Bytes of a host budget for pages of occupancy: a 64th of it, but at least 8 pages and at most all pages.
pub(crate) fn kept_bytes(source: &dyn BrickSource, host_bytes: u64) -> u64 {
    const LEAST_PAGES: u64 = 8;
    let volumes = source.times() as u64 * source.channels() as u64;
    let all = source.pyramid().page_count().saturating_mul(volumes);
    // Small levels have small pages.
    let of_bricks = source.pyramid().brick_count().saturating_mul(volumes * size_of::<Occupancy>() as u64);
    let all_bytes = of_bricks.saturating_add(all.saturating_mul(256)).min(all.saturating_mul(PAGE_BYTES));
    (host_bytes / 64).max(LEAST_PAGES * PAGE_BYTES).min(all_bytes)
}

impl PagedOccupancy {
    /// Changes whenever more occupancy becomes known.
    pub(crate) fn version(&self) -> u64 {
        self.lock().version
    }

    /// Whether a requested page has not been read yet.
    pub(crate) fn is_waiting(&self) -> bool {
        self.lock().waiting > 0
    }

    /// Announces planning for another view: pages requested by earlier views may be evicted.
    pub(crate) fn begin_view(&self) {
        self.lock().view += 1;
    }

    fn lock(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn read(&self, page: PageId) {
        if !self.lock().is_asked(page) {
            return;
        }
        let content = match self.source.read_occupancy(page) {
            Ok(occupancy) => Content::Known(occupancy.into()),
            Err(error) => {
                tracing::warn!(%error, "the occupancy of coarser bricks stands in");
                Content::Unreadable { is_passing: error.is_passing }
            }
        };
        self.lock().arrive(page, content);
    }
}

impl Pages {
    fn is_asked(&self, page: PageId) -> bool {
        self.kept.peek(&page).is_some_and(|page| matches!(page.content, Content::Asked))
    }

    fn arrive(&mut self, page: PageId, content: Content) {
        // It may have been evicted for another view's meanwhile.
        if let Some(page) = self.kept.peek_mut(&page).filter(|page| matches!(page.content, Content::Asked)) {
            page.content = content;
            self.waiting -= 1;
            self.version += 1;
        }
    }

    /// Known content of a page; requests the page if there is room.
    fn content(&mut self, id: PageId) -> Content {
        let view = self.view;
        if let Some(page) = self.kept.get_mut(&id) {
            let is_to_try = matches!(page.content, Content::Unreadable { is_passing: true }) && page.view != view;
            page.view = view;
            if is_to_try && self.asked.as_ref().is_some_and(|asked| asked.send(id).is_ok()) {
                page.content = Content::Asked;
                self.waiting += 1;
            }
            return page.content.clone();
        }
        let is_full = self.kept.len() == self.kept.cap().get();
        if is_full && self.kept.peek_lru().is_some_and(|(_, oldest)| oldest.view == view) {
            return Content::Unreadable { is_passing: false };
        }
        let is_sent = self.asked.as_ref().is_some_and(|asked| asked.send(id).is_ok());
        let content = if is_sent { Content::Asked } else { Content::Unreadable { is_passing: false } };
        self.waiting += is_sent as usize;
        let gone = self.kept.push(id, Page { content: content.clone(), view });
        self.waiting -= gone.is_some_and(|(_, page)| matches!(page.content, Content::Asked)) as usize;
        content
    }
}

impl BrickSource for PagedOccupancy {
    fn pyramid(&self) -> &Pyramid {
        self.source.pyramid()
    }
    fn geometry(&self) -> &Geometry {
        self.source.geometry()
    }
    fn voxel_type(&self) -> VoxelType {
        self.source.voxel_type()
    }
    fn value_range(&self) -> (f64, f64) {
        self.source.value_range()
    }
    fn is_labels(&self) -> bool {
        self.source.is_labels()
    }
    fn has_non_finite(&self) -> bool {
        self.source.has_non_finite()
    }

    fn nodata(&self) -> Option<f64> {
        self.source.nodata()
    }
    fn times(&self) -> u32 {
        self.source.times()
    }
    fn channels(&self) -> u32 {
        self.source.channels()
    }
    fn occupancy_bins(&self, channel: u32) -> OccupancyBins {
        self.source.occupancy_bins(channel)
    }

    /// Occupancy of a brick, or of its nearest ancestor with a page. Never waits.
    fn occupancy(&self, id: BrickId) -> Occupancy {
        let (pyramid, mut brick) = (self.source.pyramid(), id);
        let mut pages = self.lock();
        loop {
            let (page, place) = pyramid.page_of(brick);
            if let Content::Known(occupancy) = pages.content(page) {
                return occupancy[place];
            }
            let Some(index) = pyramid.parent(brick.level, brick.index) else { return Occupancy::ALL };
            brick = BrickId { level: Level(brick.level.0 + 1), index, ..brick };
        }
    }

    fn read_occupancy(&self, page: PageId) -> Result<Vec<Occupancy>, BrickError> {
        self.source.read_occupancy(page)
    }
    fn keeps_hashes(&self) -> bool {
        self.source.keeps_hashes()
    }
    fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, BrickError> {
        self.source.read_hashes(page)
    }
    fn fetchers(&self) -> u32 {
        self.source.fetchers()
    }

    fn latency(&self) -> Duration {
        self.source.latency()
    }

    fn fetch(&self, take: &mut dyn FnMut(FetchRoom) -> Vec<BrickId>) {
        self.source.fetch(take);
    }

    fn advise(&self, ids: &[BrickId]) {
        self.source.advise(ids);
    }
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.source.read_core(id, out)
    }
    fn stored_apron(&self) -> u32 {
        self.source.stored_apron()
    }
    fn read_apron(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.source.read_apron(id, out)
    }
    fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }
    fn keep_at_most(&self, bytes: u64) {
        self.source.keep_at_most(bytes);
    }

    fn cache_bytes(&self) -> u64 {
        self.source.cache_bytes()
    }
}

/// Reader thread of occupancy pages; dropping it ends the thread.
pub(crate) struct PageReader {
    pub(crate) occupancy: Arc<PagedOccupancy>,
    /// Signals of arrived pages.
    pub(crate) arrivals: Receiver<()>,
    /// Dropped after the channels, whose end stops the thread.
    _thread: Threads,
}

impl PageReader {
    /// Starts the reading thread for a source, with nothing read yet. At most `kept_bytes` of pages are kept, or one page if that is more.
    pub(crate) fn start(source: Arc<dyn BrickSource>, kept_bytes: u64) -> std::io::Result<Self> {
        let (asked, to_read) = unbounded();
        let capacity = NonZeroUsize::new((kept_bytes / PAGE_BYTES) as usize).unwrap_or(NonZeroUsize::MIN);
        let kept = LruCache::new(capacity);
        let pages = Mutex::new(Pages { kept, asked: Some(asked), waiting: 0, view: 0, version: 0 });
        let occupancy = Arc::new(PagedOccupancy { source, pages });
        let (arrived, arrivals) = bounded(1);
        let reading = occupancy.clone();
        let work = move || {
            for page in to_read {
                reading.read(page);
                // One signal is enough for any number of pages.
                let _ = arrived.try_send(());
            }
        };
        let mut thread = Threads::default();
        thread.start("page-reader".into(), work)?;
        Ok(Self { occupancy, arrivals, _thread: thread })
    }
}

impl Drop for PageReader {
    fn drop(&mut self) {
        let mut pages = self.occupancy.lock();
        pages.asked = None;
        // Keeps the thread from reading the pages left in the channel.
        pages.kept.clear();
        pages.waiting = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::TestSource;
    use brickyard_volume::BrickIndex;
    use std::time::Duration;

    fn brick(level: u8, x: u32) -> BrickId {
        BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::new(x, 0, 0) }
    }

    /// Repeats the look-up until no page is in flight; returns the last result.
    fn settled(paged: &PagedOccupancy, reader: &PageReader, id: BrickId) -> Occupancy {
        loop {
            let answer = paged.occupancy(id);
            if !paged.is_waiting() {
                return answer;
            }
            let _ = reader.arrivals.recv_timeout(Duration::from_millis(50));
        }
    }

    /// 512 bricks in a row: pages of 16, and some coarser levels'.
    fn row() -> TestSource {
        let mut source = TestSource::row(512);
        source.empty = (0..256).map(|x| brick(0, x)).chain([brick(1, 3)]).collect();
        source
    }

    #[test]
    fn ancestors_answer_until_the_page_has_come() {
        let reader = PageReader::start(Arc::new(row()), 1 << 20).unwrap();
        let paged = &reader.occupancy;
        assert_eq!(paged.occupancy(brick(0, 7)), Occupancy::ALL, "nothing is known yet");
        let version = paged.version();
        assert_eq!(settled(paged, &reader, brick(0, 7)), Occupancy::NONE);
        assert!(paged.version() > version);
        // Another page of level 0; its parent's page has arrived.
        assert_eq!(paged.occupancy(brick(0, 300)), Occupancy::ALL);
        assert_eq!(settled(paged, &reader, brick(0, 300)), Occupancy::ALL);
    }

    #[test]
    fn a_page_that_cannot_be_read_is_answered_for_by_coarser_ones() {
        let mut source = row();
        source.failing_pages = [source.pyramid().page_of(brick(0, 6)).0].into();
        let reader = PageReader::start(Arc::new(source), 1 << 20).unwrap();
        let paged = &reader.occupancy;
        assert_eq!(settled(paged, &reader, brick(0, 6)), Occupancy::NONE, "by brick 3 of level 1");
        assert_eq!(settled(paged, &reader, brick(0, 8)), Occupancy::ALL, "by brick 4 of level 1");
    }

    #[test]
    fn a_page_that_could_not_be_read_for_once_is_read_for_the_next_view() {
        let mut source = row();
        source.failing_pages = [source.pyramid().page_of(brick(0, 8)).0].into();
        source.failing_pages_pass = true.into();
        let source = Arc::new(source);
        let reader = PageReader::start(source.clone(), 1 << 20).unwrap();
        let paged = &reader.occupancy;
        assert_eq!(settled(paged, &reader, brick(0, 8)), Occupancy::ALL);
        let version = paged.version();
        assert_eq!(settled(paged, &reader, brick(0, 8)), Occupancy::ALL);
        assert_eq!(paged.version(), version, "not again for the same view");
        paged.begin_view();
        settled(paged, &reader, brick(0, 8));
        assert!(paged.version() > version);
    }

    #[test]
    fn a_view_that_wants_more_pages_than_fit_comes_to_rest() {
        let source = Arc::new(row());
        let reader = PageReader::start(source.clone(), 8 * PAGE_BYTES).unwrap();
        let paged = &reader.occupancy;
        for view in 0..3 {
            paged.begin_view();
            let answers = || (0..512).map(|x| paged.occupancy(brick(0, x))).collect::<Vec<_>>();
            let deadline = std::time::Instant::now() + Duration::from_secs(20);
            while {
                answers();
                paged.is_waiting()
            } {
                let _ = reader.arrivals.recv_timeout(Duration::from_millis(50));
                assert!(std::time::Instant::now() < deadline, "view {view} does not come to rest");
            }
            let version = paged.version();
            let last = answers();
            assert!(!paged.is_waiting() && paged.version() == version);
            let known = last.iter().filter(|answer| **answer == Occupancy::NONE).count();
            assert!((16..256).contains(&known), "{known}");
            // Every brick reported empty is empty.
            assert!(
                last.iter()
                    .zip(0..)
                    .all(|(answer, x)| *answer == Occupancy::ALL || source.empty.contains(&brick(0, x)))
            );
            assert!(paged.lock().kept.len() <= 8);
        }
    }
}
