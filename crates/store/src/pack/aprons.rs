//! The second pass, if aprons are stored: makes them from the first pass's cores, shard by shard.
//!
//! For each layer of bricks of each time step of a shard, it fetches the shells (`shells.rs`) of its bricks and their
//! neighbours, from memory or by decoding the core, then makes, encodes and appends the aprons in index order. A shell
//! is 11 times smaller than its core, and the last ones used are cached up to `--memory`. With room for a layer of
//! shards and its neighbours (1 GB at 4096^3 of 8 bits), every core is decoded once; for only a row of shards, 1.25
//! times; in the least memory, about twice. Shards of several time steps are still made one by one, so few are open at
//! a time; the same decoding then takes as many times the memory.
//!
//! Finished shards are journalled like those of cores, so an interrupted pass continues after the last one.

use crate::chunks::Chunks;
use crate::codec::BrickCodec;
use crate::error::ReadError;
use crate::folder::Folder;
use crate::layout::{Layout, ShardId};
use crate::pack::cascade::{Pass, Reached, Stop, Stopped};
use crate::pack::disk::DiskError;
use crate::pack::journal::Journal;
use crate::pack::plan::Stage;
use crate::pack::pool;
use crate::pack::shards::{Encoded, ShardWriter};
use crate::pack::shells::ApronMaker;
use crate::pack::side_pages::ShardPages;
use crate::scratch::Scratch;
use crate::shard::Fingerprint;
use crate::shard_file::IoMode;
use crate::side::core_hash;
use crate::store::{bricks_of, grown};
use brickyard_volume::{Apron, BrickId, Extent, Level, VoxelBox};
use lru::LruCache;
use rayon::prelude::*;
use std::num::NonZeroUsize;
use std::sync::Arc;

/// Progress of the pass.
#[derive(Default)]
struct Made {
    shards: u64,
    bricks: u64,
    written_bytes: u64,
}

impl Pass<'_> {
    /// Makes the aprons of all stages, and returns the bytes written to their shards. On failure, finished shards stay
    /// and are in the journal.
    pub(crate) fn run_aprons(&self, apron: Apron, journal: &mut Journal) -> Result<u64, Stopped> {
        let mut made = Made::default();
        let maker = ApronMaker { apron, voxel_bytes: self.source.info().voxel_type.bytes() };
        let reached = |made: &Made| {
            let bytes = maker.apron_bytes() as u64;
            let left = self.plan.brick_count() - made.bricks;
            let shards = self.plan.core_shard_count() + made.shards;
            Reached::new(shards, made.written_bytes, made.bricks * bytes, left * bytes)
        };
        let pool = pool(self.options.threads).map_err(|error| (Stop::Threads(error), reached(&made)))?;
        let folder = Folder::open(self.store).map_err(|error| DiskError { path: self.store.into(), error });
        let folder = Arc::new(folder.map_err(|error| (Stop::Disk(error), reached(&made)))?);
        for stage in &self.plan.stages {
            let of_stage = pool.install(|| StagePass::new(self, &folder, stage, maker).run(journal, &mut made));
            let synced = journal.sync().map_err(Stop::Disk);
            of_stage.and(synced).map_err(|stop| (stop, reached(&made)))?;
        }
        Ok(made.written_bytes)
    }
}

/// The pass over one stage.
struct StagePass<'a> {
    pass: &'a Pass<'a>,
    /// The output of the first pass.
    cores: Chunks,
    /// The layout of the aprons.
    layout: Layout,
    level: Level,
    grid: Extent,
    maker: ApronMaker,
    codec: BrickCodec,
    /// Shells of stored bricks, the last ones used.
    shells: LruCache<BrickId, Box<[u8]>>,
}

impl<'a> StagePass<'a> {
    fn new(pass: &'a Pass<'a>, folder: &Arc<Folder>, stage: &Stage, maker: ApronMaker) -> Self {
        let (options, voxel_type) = (pass.options, pass.source.info().voxel_type);
        let codec = BrickCodec::new(options.codec, voxel_type, options.edge);
        Self {
            pass,
            cores: Chunks::new(folder, stage.layout.clone(), codec, IoMode::Mmap),
            layout: stage.layout.of_aprons(),
            level: stage.level,
            grid: stage.grid().bricks,
            maker,
            codec: BrickCodec::of_aprons(options.codec, voxel_type, maker.apron),
            shells: LruCache::new(NonZeroUsize::new(pass.plan.shells).unwrap_or(NonZeroUsize::MIN)),
        }
    }

    /// Makes the stage's missing shards of aprons.
    fn run(mut self, journal: &mut Journal, made: &mut Made) -> Result<(), Stop> {
        let Pass { store, disk, plan, progress, .. } = *self.pass;
        let (mut shard_pages, mut pages) = (ShardPages::new(store, &self.layout, self.level), Vec::new());
        let layout = self.layout.clone();
        for id in plan.shards(&layout, self.level) {
            let earlier = journal.finished(&self.layout, id);
            let fingerprint = earlier.map_or_else(|| self.shard(id, journal, made), Ok)?;
            shard_pages.add(id, fingerprint, &mut pages);
            for (path, bytes) in pages.drain(..) {
                disk.write_early(&path, &bytes).map_err(Stop::Disk)?;
            }
            made.shards += 1;
            made.bricks += self.layout.steps_of(id.group).len() as u64 * self.bricks(id).extent().volume();
            progress.aprons(made.bricks * self.maker.apron_bytes() as u64, plan.apron_bytes);
        }
        Ok(())
    }

    /// The bricks of each time step of a shard, as a box of the level's grid.
    fn bricks(&self, id: ShardId) -> VoxelBox {
        let size = self.layout.shard_bricks(self.level).to_array();
        let first = [id.x * size[0], id.y * size[1], id.z * size[2]];
        VoxelBox::new(first, std::array::from_fn(|a| first[a] + size[a])).intersect(self.grid.full_box())
    }

    fn shard(&mut self, id: ShardId, journal: &mut Journal, made: &mut Made) -> Result<Fingerprint, Stop> {
        let Pass { store, disk, progress, .. } = *self.pass;
        let layout = self.layout.clone();
        let mut writer = ShardWriter::new(disk, store, &layout);
        let bricks = self.bricks(id);
        let mut fingerprint = Fingerprint::default();
        let layers = layout.steps_of(id.group).flat_map(|time| (bricks.min.z..bricks.max.z).map(move |z| (time, z)));
        for (time, z) in layers {
            let brick = |index| BrickId { time, channel: id.channel, level: id.level, index };
            if progress.is_cancelled() {
                return Err(Stop::Cancelled);
            }
            let mut layer = bricks;
            (layer.min.z, layer.max.z) = (z, z + 1);
            let ids: Vec<BrickId> = bricks_of(layer, 1).map(brick).collect();
            self.fetch_shells(&bricks_of(grown(layer, 1, self.grid.full_box()), 1).map(brick).collect::<Vec<_>>())
                .map_err(Stop::ReadBack)?;
            for (id, apron) in ids.iter().zip(self.encode(&ids)) {
                let encoded = apron.as_ref().map(|(bytes, hash)| Encoded { bytes, hash: *hash });
                if let Some(finished) = writer.add(*id, encoded, |_| None).map_err(Stop::Disk)? {
                    journal.settle(&layout, &finished).map_err(Stop::Disk)?;
                    fingerprint = finished.fingerprint;
                }
            }
        }
        made.written_bytes += writer.written_bytes;
        Ok(fingerprint)
    }

    /// Fetches the shells of these bricks, if stored. There is room for all of them.
    fn fetch_shells(&mut self, ids: &[BrickId]) -> Result<(), ReadError> {
        let mut missing = Vec::new();
        for &id in ids {
            if self.shells.get(&id).is_none() && self.cores.is_stored(id)? {
                missing.push(id);
            }
        }
        self.cores.advise(&missing);
        let (cores, maker) = (&self.cores, self.maker);
        let shell = |core: &mut Vec<u8>, id: BrickId| {
            cores.read(id, core)?;
            let mut shell = vec![0; maker.shell_bytes()].into_boxed_slice();
            maker.cut(core, &mut shell);
            Ok(shell)
        };
        let core = || vec![0; cores.chunk_bytes()];
        let shells: Vec<_> =
            missing.par_iter().map_init(core, |core, &id| shell(core, id)).collect::<Result<_, ReadError>>()?;
        for (id, shell) in missing.into_iter().zip(shells) {
            self.shells.push(id, shell);
        }
        Ok(())
    }

    /// Encodes aprons, each with its hash; `None` if all fill. The shells of the bricks and their neighbours must be
    /// cached.
    fn encode(&self, ids: &[BrickId]) -> Vec<Option<(Vec<u8>, u128)>> {
        let encode = |apron: &mut Vec<u8>, &id: &BrickId| {
            let shell_of = |index| self.shells.peek(&BrickId { index, ..id }).map(|shell| &shell[..]);
            self.maker.make(id.index, self.grid, shell_of, apron).then(|| {
                let mut encoded = Vec::new();
                Scratch::with(|scratch| self.codec.encode(scratch, apron, &mut encoded));
                (encoded, core_hash(apron))
            })
        };
        ids.par_iter().map_init(|| vec![0; self.maker.apron_bytes()], encode).collect()
    }
}
