//! Arithmetic test volume: any pyramid, any type, any occupancy, bricks that fail on demand.

use crate::budget::{PagerConfig, Planning};
use crate::cut::View;
use crate::source::{BrickError, BrickSource};
use brickyard_volume::{
    Apron, BrickId, Camera, Extent, Filter, Geometry, LevelPolicy, Occupancy, OccupancyBins, PageId, Placement,
    Projection, Pyramid, VoxelType,
};
use glam::DVec3;
use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Barrier, Mutex};

pub(crate) struct TestSource {
    pyramid: Pyramid,
    geometry: Geometry,
    voxel_type: VoxelType,
    /// Writes the voxel `[x, y, z]` of a brick's level.
    pub(crate) voxel_at: fn(BrickId, [u32; 3], &mut [u8]),
    /// Invisible bricks; all descendants of such a brick are to be listed, too.
    pub(crate) empty: HashSet<BrickId>,
    pub(crate) failing: HashSet<BrickId>,
    /// Unreadable pages of occupancy.
    pub(crate) failing_pages: HashSet<PageId>,
    /// Whether the failures of `failing_pages` pass.
    pub(crate) failing_pages_pass: AtomicBool,
    pub(crate) panicking: HashSet<BrickId>,
    /// Remaining passing failures of a brick's core, or of its stored apron.
    pub(crate) passing: Mutex<HashMap<BrickId, u32>>,
    /// Reads of each failing brick.
    pub(crate) reads: Mutex<HashMap<BrickId, u32>>,
    times: u32,
    stored_apron: u32,
    pub(crate) failing_aprons: HashSet<BrickId>,
    /// Whether hashes of cores are kept, and their unreadable pages.
    keeps_hashes: bool,
    pub(crate) failing_hashes: HashSet<PageId>,
    /// Meeting point of threads that read a page of hashes.
    pub(crate) hash_readers_meet: Option<Barrier>,
    bytes_read: AtomicU64,
    /// Called with advised bricks.
    pub(crate) advice: fn(&[BrickId]),
}

/// Bytes that differ between neighbouring voxels, levels, channels and times. Floats stay finite: the top byte is small.
fn hashed_voxel(id: BrickId, v: [u32; 3], out: &mut [u8]) {
    let seed = id.time.wrapping_mul(31) ^ id.channel.wrapping_mul(37) ^ (id.level.0 as u32) << 9;
    let hash = (v[0] ^ v[1].wrapping_mul(1009) ^ v[2].wrapping_mul(9176141) ^ seed).wrapping_mul(2654435761);
    let mut bytes = (hash ^ hash >> 15).to_le_bytes();
    if out.len() == 4 {
        bytes[3] &= 0x3f;
    }
    out.copy_from_slice(&bytes[..out.len()]);
}

impl TestSource {
    pub(crate) fn new(pyramid: Pyramid, spacing: [f64; 3], voxel_type: VoxelType) -> Self {
        let geometry = Geometry { spacing: DVec3::from_array(spacing), ..Geometry::default() };
        let (empty, failing, failing_pages, panicking, failing_aprons, bytes_read, passing, reads) = Default::default();
        Self {
            pyramid,
            geometry,
            voxel_type,
            voxel_at: hashed_voxel,
            empty,
            failing,
            failing_pages,
            failing_pages_pass: AtomicBool::new(false),
            panicking,
            passing,
            reads,
            times: 2,
            stored_apron: 0,
            failing_aprons,
            keeps_hashes: false,
            failing_hashes: HashSet::new(),
            hash_readers_meet: None,
            bytes_read,
            advice: |_| {},
        }
    }

    /// A cube of `n`^3 voxels of 8 bits, in bricks of 8^3.
    pub(crate) fn cube(n: u32) -> Self {
        Self::new(Pyramid::new(Extent::new(n, n, n), [1.0; 3], 8), [1.0; 3], VoxelType::U8)
    }

    /// A row of `n` bricks of 8^3 along x, filled by one line of 8-bit voxels.
    pub(crate) fn row(n: u32) -> Self {
        Self::new(Pyramid::new(Extent::new(8 * n, 1, 1), [1.0; 3], 8), [1.0; 3], VoxelType::U8)
    }

    fn core(&self, id: BrickId) -> Vec<u8> {
        let core = self.pyramid.brick_box(id.level, id.index);
        let (low, high) = (core.min.to_array(), core.max.to_array());
        let (edge, bytes) = (self.pyramid.edge(), self.voxel_type.bytes());
        // Past the level's extent the bytes are unspecified: make them wrong.
        let mut out = vec![0xAA; edge.pow(3) as usize * bytes];
        for (i, voxel) in out.chunks_exact_mut(bytes).enumerate() {
            let i = i as u32;
            let v = [low[0] + i % edge, low[1] + i / edge % edge, low[2] + i / edge / edge];
            if (0..3).all(|a| v[a] < high[a]) {
                (self.voxel_at)(id, v, voxel);
            }
        }
        out
    }

    /// Fails if so configured.
    fn fail(&self, id: BrickId, failing: &HashSet<BrickId>) -> Result<(), BrickError> {
        let mut passing = self.passing.lock().unwrap();
        let left = passing.get_mut(&id).filter(|left| **left > 0);
        let is_passing = left.map(|left| *left -= 1).is_some();
        if !is_passing && !failing.contains(&id) {
            return Ok(());
        }
        *self.reads.lock().unwrap().entry(id).or_default() += 1;
        Err(BrickError { id, reason: "told to fail".into(), is_passing })
    }

    pub(crate) fn with_times(self, times: u32) -> Self {
        Self { times, ..self }
    }

    pub(crate) fn with_hashes(self) -> Self {
        Self { keeps_hashes: true, ..self }
    }

    pub(crate) fn with_aprons(self, width: u32) -> Self {
        Self { stored_apron: width, ..self }
    }
}

/// A view of the whole volume in a picture of 512 x 512 pixels, at a pixel error of 1.
pub(crate) fn box_view(source: &TestSource, projection: Projection) -> View {
    let world = source.geometry.world_box(source.pyramid.levels()[0].extent);
    let rays = Camera { projection, ..Camera::looking_at_box(world) }.rays(512, 512).unwrap();
    View {
        rays,
        other_eye: None,
        opaque: None,
        caps: None,
        filter: Filter::Trilinear,
        level: LevelPolicy::Auto,
        pixel_error: 1.0,
        time: 0,
        channel: 0,
        clip: None,
        placement: Placement::default(),
        appearance: 0,
        window: None,
    }
}

impl BrickSource for TestSource {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }
    fn voxel_type(&self) -> VoxelType {
        self.voxel_type
    }
    fn value_range(&self) -> (f64, f64) {
        (0.0, 1e6)
    }
    fn has_non_finite(&self) -> bool {
        false
    }
    fn times(&self) -> u32 {
        self.times
    }
    fn channels(&self) -> u32 {
        2
    }
    fn occupancy_bins(&self, _: u32) -> OccupancyBins {
        OccupancyBins::over(0.0, 1e6)
    }
    fn occupancy(&self, id: BrickId) -> Occupancy {
        if self.empty.contains(&id) { Occupancy::NONE } else { Occupancy::ALL }
    }
    fn read_occupancy(&self, page: PageId) -> Result<Vec<Occupancy>, BrickError> {
        let bricks: Vec<_> = self.pyramid.bricks_of_page(page).collect();
        if self.failing_pages.contains(&page) {
            let is_passing = self.failing_pages_pass.load(Ordering::Relaxed);
            return Err(BrickError { id: bricks[0].0, reason: "told to fail".into(), is_passing });
        }
        let mut occupancy = vec![Occupancy::NONE; self.pyramid.paging(page.level).page_cells()];
        bricks.into_iter().for_each(|(id, place)| occupancy[place] = self.occupancy(id));
        Ok(occupancy)
    }
    fn keeps_hashes(&self) -> bool {
        self.keeps_hashes
    }
    fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, BrickError> {
        self.hash_readers_meet.as_ref().map(Barrier::wait);
        let bricks: Vec<_> = self.pyramid.bricks_of_page(page).collect();
        if self.failing_hashes.contains(&page) {
            return Err(BrickError { id: bricks[0].0, reason: "told to fail".into(), is_passing: false });
        }
        let mut hashes = vec![0; self.pyramid.paging(page.level).page_cells()];
        for (id, place) in bricks {
            hashes[place] = xxhash_rust::xxh3::xxh3_128(&self.core(id));
        }
        Ok(hashes)
    }
    fn advise(&self, ids: &[BrickId]) {
        (self.advice)(ids);
    }

    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        assert!(!self.panicking.contains(&id), "told to");
        // Where aprons are stored, it is their failures that pass.
        match self.stored_apron {
            0 => self.fail(id, &self.failing)?,
            _ if self.failing.contains(&id) => {
                return Err(BrickError { id, reason: "told to fail".into(), is_passing: false });
            }
            _ => {}
        }
        self.bytes_read.fetch_add(out.len() as u64, Ordering::Relaxed);
        out.copy_from_slice(&self.core(id));
        Ok(())
    }
    fn stored_apron(&self) -> u32 {
        self.stored_apron
    }
    fn read_apron(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.fail(id, &self.failing_aprons)?;
        self.bytes_read.fetch_add(out.len() as u64, Ordering::Relaxed);
        let apron = Apron { edge: self.pyramid.edge(), width: self.stored_apron };
        let (index, extent) = (id.index.to_array(), self.pyramid.level(id.level).extent.to_array());
        let mut voxels = out.chunks_exact_mut(self.voxel_type.bytes());
        for slab in apron.slabs() {
            let (low, n) = (slab.min.to_array(), slab.extent().to_array());
            for i in 0..slab.extent().volume() as u32 {
                let at = [low[0] + i % n[0], low[1] + i / n[0] % n[1], low[2] + i / n[0] / n[1]];
                let place = |a: usize| (index[a] * apron.edge + at[a]).saturating_sub(apron.width).min(extent[a] - 1);
                if let Some(voxel) = voxels.next() {
                    (self.voxel_at)(id, [0, 1, 2].map(place), voxel);
                }
            }
        }
        Ok(())
    }
    fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }
}

/// Configuration of a pager with three workers that plans inline, fetches nothing ahead and has no limits on uploads.
pub(crate) fn config(slots: u32, host_bytes: u64) -> PagerConfig {
    PagerConfig {
        slots,
        apron: 1,
        gradient_layers: 0,
        host_bytes,
        contents: Vec::new(),
        workers: 3,
        planning: Planning::Inline,
        prefetch: false,
        uploads: None,
        keeps_decoded: true,
        fade: None,
    }
}
