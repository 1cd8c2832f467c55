//! Which projections may lose extremes: those of coarse bricks whose voxels are not the extremes of the finer ones in them, and those of volumes that have only some of the
//! voxels, as previews do. A mean of eight voxels hides the greatest of them, and one of 512 nearly all of it.

use crate::resolve::{ResolvedLayer, ResolvedScene};
use crate::session::Session;
use crate::volume_source::VolumeSource;
use brickyard_pager::{Cut, DrawList};
use brickyard_volume::{Level, Mode};

impl ResolvedScene {
    /// The indices in the scene of layers whose projections lose extremes at the levels that the view wants. `volumes` are those that the scene was resolved
    /// for. Costs a cut of each such layer: milliseconds.
    pub fn lost_extremes(&self, volumes: &[VolumeSource]) -> Vec<usize> {
        self.losing(volumes, |layer| {
            let cut = Cut::new(&*volumes[layer.volume].source, &layer.view, usize::MAX);
            cut.cells().any(|cell| cell.level > Level(0))
        })
    }

    /// The indices in the scene of layers whose projections lose extremes, where `is_coarse` says which are drawn coarser than at level 0.
    fn losing(&self, volumes: &[VolumeSource], is_coarse: impl Fn(&ResolvedLayer) -> bool) -> Vec<usize> {
        let loses = |layer: &&ResolvedLayer| {
            let settings = &layer.frames[0].settings;
            let is_extreme = matches!(settings.mode, Mode::Mip | Mode::MinIp) && !settings.encoding.is_labels;
            let has_all = volumes[layer.volume].stride() == [1; 3];
            is_extreme && !settings.keeps_extremes && (!has_all || is_coarse(layer))
        };
        self.layers.iter().filter(loses).map(|layer| layer.place).collect()
    }
}

impl Session {
    /// The indices in the scene of layers whose projections lose extremes at the levels that are drawn now. `scene` is that of the last
    /// [frame](crate::Frame).
    pub fn lost_extremes(&self, scene: &ResolvedScene) -> Vec<usize> {
        let is_coarse = |list: &DrawList| list.cells.iter().any(|cell| cell.brick.level > Level(0));
        scene.losing(self.volumes(), |layer| self.lists_of(layer.place).iter().any(is_coarse))
    }
}
