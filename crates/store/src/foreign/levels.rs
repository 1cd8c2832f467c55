//! The pyramid over a foreign image: its own levels where each halves axes of the one before, and levels to be made between and above them.
//!
//! An image's level is used if its factor to level 0 is a power of two along each axis, by its number of voxels rounded down or up;
//! others are passed over, with a note. Where the next one used is more than twice as coarse, and above the last one up to a single brick, levels are made.
//! Arithmetic only.

use brickyard_import::{ImageLevel, Note, Source};
use brickyard_volume::{BrickId, Extent, Level, Pyramid};
use glam::DVec3;
use std::sync::Arc;

/// Voxels decoded for each voxel of a brick that are worth a note.
const DEAR_TIMES: f64 = 10.0;

/// The levels of the pyramid over an image.
pub(crate) struct Levels {
    pyramid: Pyramid,
    /// The image's own array of each level; `None` of levels to be made.
    sources: Vec<Option<Arc<dyn Source>>>,
    passed_over: Vec<Extent>,
}

/// A level of the pyramid: voxels, level-0 voxels for each, and the image's array.
struct Step {
    extent: Extent,
    factor: [u32; 3],
    source: Option<Arc<dyn Source>>,
}

impl Levels {
    /// Arranges an image's levels, finest first, for bricks of `edge`^3 voxels.
    pub(crate) fn of(levels: &[ImageLevel], edge: u32) -> Self {
        let finest = &levels[0].source;
        let whole = finest.info().extent;
        let mut steps = vec![Step { extent: whole, factor: [1; 3], source: Some(finest.clone()) }];
        let mut passed_over = Vec::new();
        for ImageLevel { source, factor, .. } in &levels[1..] {
            let last = steps[steps.len() - 1].factor;
            let same_type = source.info().voxel_type == finest.info().voxel_type;
            match factor_of(whole, source.info().extent, *factor)
                .filter(|factor| same_type && is_coarser(last, *factor))
            {
                Some(factor) => lead_to(&mut steps, whole, factor, source),
                None => passed_over.push(source.info().extent),
            }
        }
        let spacing = finest.info().geometry.spacing.to_array();
        lead_to_one_brick(&mut steps, whole, spacing, edge);
        let shapes: Vec<_> = steps.iter().map(|step| (step.extent, step.factor)).collect();
        let sources = steps.into_iter().map(|step| step.source).collect();
        Self { pyramid: Pyramid::from_levels(&shapes, edge), sources, passed_over }
    }

    pub(crate) fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    /// The image's own array of a level; `None` if the level is made.
    pub(crate) fn source(&self, level: Level) -> Option<&Arc<dyn Source>> {
        self.sources[level.index()].as_ref()
    }

    /// Bricks of the levels to be made, of one time step and channel.
    pub(crate) fn made_bricks(&self) -> u64 {
        let levels = self.pyramid.levels().iter().zip(&self.sources);
        levels.filter(|(_, source)| source.is_none()).map(|(level, _)| level.bricks.volume()).sum()
    }

    /// Bricks of the image's own level beneath a made brick, from which it follows.
    pub(crate) fn bricks_beneath(&self, id: BrickId) -> u64 {
        let own = self.sources[..id.level.index()].iter().rposition(Option::is_some).unwrap_or(0);
        let (coarse, fine) = (self.pyramid.level(id.level), self.pyramid.level(Level(own as u8)));
        let region = self.pyramid.brick_box(id.level, id.index);
        let along = |axis: usize| {
            let ratio = coarse.factor[axis] / fine.factor[axis];
            let (min, max) = (region.min.to_array()[axis] * ratio, region.max.to_array()[axis] * ratio);
            let last = max.min(fine.extent.to_array()[axis]);
            u64::from(last.div_ceil(self.pyramid.edge()) - min / self.pyramid.edge())
        };
        (0..3).map(along).product()
    }

    /// Whether an array of the image is a level of the pyramid.
    pub(crate) fn uses(&self, source: &Arc<dyn Source>) -> bool {
        self.sources.iter().flatten().any(|own| Arc::ptr_eq(own, source))
    }

    /// Remarks on levels passed over, and on chunks that make bricks dear.
    pub(crate) fn notes(&self, image: &[ImageLevel]) -> Vec<Note> {
        let shape = |extent: &Extent| format!("{} x {} x {}", extent.x, extent.y, extent.z);
        let passed = (!self.passed_over.is_empty()).then(|| {
            let shapes: Vec<String> = self.passed_over.iter().map(shape).collect();
            Note::new(format!(
                "Levels of {} voxels are not used: their voxels are not 2, 4, 8 ... times as large as those of the level before, or of another type.",
                shapes.join(", ")
            ))
        });
        let cost = |level: &ImageLevel| level.source.piece().map(|chunk| (chunk, self.cost(level, chunk)));
        let dear = image.iter().filter_map(cost).max_by(|a, b| a.1.total_cmp(&b.1));
        let dear = dear.filter(|(_, times)| *times > DEAR_TIMES).map(|(chunk, times)| {
            let (chunk, edge) = (shape(&chunk), self.pyramid.edge());
            Note::new(format!(
                "Chunks of {chunk} voxels cut badly into bricks of {edge} x {edge} x {edge}: one decodes {times:.0} times its voxels, but for chunks \
                 still in memory; a packed store decodes each once (`brickyard pack`)."
            ))
        });
        passed.into_iter().chain(dear).collect()
    }

    /// Voxels decoded for each voxel of a level's bricks, if no chunk is kept from one brick to the next.
    fn cost(&self, level: &ImageLevel, chunk: Extent) -> f64 {
        let (n, chunk, edge) = (level.source.info().extent.to_array(), chunk.to_array(), self.pyramid.edge());
        let along = |axis: usize| {
            let (n, chunk) = (n[axis], chunk[axis].clamp(1, n[axis]));
            let chunks_of = |first: u32| first.saturating_add(edge).min(n).div_ceil(chunk) - first / chunk;
            let decoded: u64 = (0..n).step_by(edge as usize).map(|first| u64::from(chunks_of(first))).sum();
            (decoded * u64::from(chunk)) as f64 / f64::from(n)
        };
        (0..3).map(along).product()
    }
}

/// Level-0 voxels for each voxel of a coarser level: a power of two along each axis; `None` if it is none. `told` is the document's word.
fn factor_of(whole: Extent, coarse: Extent, told: DVec3) -> Option<[u32; 3]> {
    let (whole, found) = (whole.to_array(), coarse.to_array());
    let mut factor = [1; 3];
    for axis in 0..3 {
        let (n, found) = (whole[axis], found[axis]);
        let fits = |f: &u32| found == n.div_ceil(*f) || found == (n / f).max(1);
        // Where several fit a short axis, the documents tell; else the least.
        let told = told[axis].log2().round();
        let told = (0.0..32.0).contains(&told).then(|| 1 << told as u32).filter(fits);
        factor[axis] = told.or_else(|| (0..32).map(|shift| 1 << shift).find(fits))?;
    }
    Some(factor)
}

/// Whether a factor is as great as another along each axis, and greater along one.
fn is_coarser(than: [u32; 3], factor: [u32; 3]) -> bool {
    (0..3).all(|axis| factor[axis] >= than[axis]) && factor != than
}

/// Adds an image's level, after those to be made on the way to it.
fn lead_to(steps: &mut Vec<Step>, whole: Extent, factor: [u32; 3], source: &Arc<dyn Source>) {
    loop {
        let last = steps[steps.len() - 1].factor;
        // Axes that must be halved most often begin.
        let left: [u32; 3] = std::array::from_fn(|axis| (factor[axis] / last[axis]).trailing_zeros());
        let most = left.into_iter().fold(0, u32::max);
        let next = std::array::from_fn(|axis| if left[axis] == most { 2 * last[axis] } else { last[axis] });
        let is_there = next == factor;
        steps.push(Step { extent: reduced(whole, next), factor: next, source: is_there.then(|| source.clone()) });
        if is_there {
            return;
        }
    }
}

/// Adds levels to be made, until one is a single brick: as the pyramid of a packed store goes on.
fn lead_to_one_brick(steps: &mut Vec<Step>, whole: Extent, spacing: [f64; 3], edge: u32) {
    let (extent, factor) = (steps[steps.len() - 1].extent, steps[steps.len() - 1].factor);
    let spacing = std::array::from_fn(|axis| spacing[axis] * f64::from(factor[axis]));
    for level in &Pyramid::new(extent, spacing, edge).levels()[1..] {
        let factor = std::array::from_fn(|axis| factor[axis] * level.factor[axis]);
        steps.push(Step { extent: reduced(whole, factor), factor, source: None });
    }
}

fn reduced(whole: Extent, factor: [u32; 3]) -> Extent {
    let whole = whole.to_array();
    Extent::from_array(std::array::from_fn(|axis| whole[axis].div_ceil(factor[axis])))
}
