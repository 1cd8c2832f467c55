//! Projections with doubtful extremes. Some may lose extremes: those of coarse bricks with voxels other than the
//! extremes of the finer ones in them, and those of volumes with only some of the voxels, such as previews. A mean of
//! eight voxels hides the greatest of them, and one of 512 nearly all of it. Others may show cut-away values: a coarse
//! voxel across a cut holds the extreme of both sides.

use crate::session::Session;
use crate::session::resolve::{ResolvedLayer, ResolvedScene};
use crate::session::volume_source::VolumeSource;
use brickyard_pager::{Cut, DrawList};
use brickyard_volume::Level;

/// Layers with doubtful projections, by their indices in the scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DoubtfulExtremes {
    /// Layers that may lose extremes.
    pub lost: Vec<usize>,
    /// Layers that may show extremes up to a coarse voxel behind a clip plane, or behind a side of the clip box or of a
    /// crop.
    pub past_cuts: Vec<usize>,
}

impl ResolvedScene {
    /// Returns layers of doubtful extremes at the levels wanted by the view. `volumes` are those of the resolved scene.
    /// Costs a cut of each projected layer: milliseconds.
    pub fn doubtful_extremes(&self, volumes: &[VolumeSource]) -> DoubtfulExtremes {
        self.doubtful(volumes, |layer| {
            let cut = Cut::new(&*volumes[layer.volume].source, &layer.view, usize::MAX);
            cut.cells().any(|cell| cell.level > Level(0))
        })
    }

    /// [`ResolvedScene::doubtful_extremes`], given whether a layer is drawn coarser than at level 0.
    fn doubtful(&self, volumes: &[VolumeSource], is_coarse: impl Fn(&ResolvedLayer) -> bool) -> DoubtfulExtremes {
        let mut found = DoubtfulExtremes::default();
        for layer in &self.layers {
            let settings = &layer.frames[0].settings;
            if settings.mode.extreme().is_none() || settings.encoding.is_labels {
                continue;
            }
            let has_all = volumes[layer.volume].stride() == [1; 3];
            match settings.keeps_extremes {
                false if !has_all || is_coarse(layer) => found.lost.push(layer.place),
                true if settings.clip.is_some() && is_coarse(layer) => found.past_cuts.push(layer.place),
                _ => {}
            }
        }
        found
    }
}

impl Session {
    /// Returns layers of doubtful extremes at the present levels. `scene` is the last [frame](crate::Frame)'s.
    pub fn doubtful_extremes(&self, scene: &ResolvedScene) -> DoubtfulExtremes {
        let is_coarse = |list: &DrawList| list.cells.iter().any(|cell| cell.brick.level > Level(0));
        scene.doubtful(self.volumes(), |layer| self.lists_of(layer.place).iter().any(is_coarse))
    }
}
