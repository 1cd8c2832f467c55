//! A ray's way through one layer: its stretch inside the visible part, its level, and reading along it.

use super::cores::Cores;
use crate::session::resolve::ResolvedLayer;
use crate::session::volume_source::VolumeSource;
use brickyard_pager::BrickError;
use brickyard_volume::extremes::half_box;
use brickyard_volume::{BrickId, BrickIndex, Filter, FrameSettings, Level, LevelPolicy, Ray};
use glam::DVec3;
use std::sync::Arc;

/// Approximate limit of bricks on a ray's whole way through one layer: beyond it, a coarser level is taken.
const MOST_BRICKS: f64 = 16.0;

/// A ray's way through one layer.
pub(super) struct Way<'a> {
    pub(super) layer: &'a ResolvedLayer,
    pub(super) settings: &'a FrameSettings,
    pub(super) volume: &'a VolumeSource,
    /// The ray in level-0 voxels, with distances of the scene's world along it.
    origin: DVec3,
    direction: DVec3,
    /// Start and end of the ray's stretch inside the visible part.
    pub(super) stretch: [f64; 2],
    /// The level for the whole ray.
    pub(super) level: Level,
}

impl<'a> Way<'a> {
    /// Creates the way of a ray of the scene's world; `None` if it misses the visible part of the layer.
    pub(super) fn new(layer: &'a ResolvedLayer, volume: &'a VolumeSource, ray: &Ray) -> Option<Self> {
        let settings = &layer.frames[0].settings;
        let own = settings.placement.volume_ray(ray);
        let origin = settings.geometry.voxel_from_world(own.origin);
        let direction = own.direction / settings.geometry.spacing;
        let inside = box_stretch(origin, direction, settings.shown_box(volume.extent()));
        let (from, to) = match &settings.clip {
            Some(clip) => clip.shorten(&own, inside),
            None => inside,
        };
        // A missing ray's ends may both be infinite.
        let stretch = (from < to).then_some([from, to])?;
        let mut way = Self { layer, settings, volume, origin, direction, stretch, level: Level(0) };
        way.level = way.first_level();
        Some(way)
    }

    /// Returns the wanted level at the ray's entry, or the finest coarser one with few enough bricks.
    fn first_level(&self) -> Level {
        let (view, coarsest) = (&self.layer.view, self.volume.source.pyramid().coarsest());
        let wanted = match view.level {
            LevelPolicy::Locked(level) => level,
            LevelPolicy::Auto => {
                let pixel = view.rays.pixel_size(self.stretch[0]) * view.pixel_error;
                let extent = self.volume.extent();
                let voxel = self.settings.placement.voxel_size(&self.settings.geometry, extent);
                (pixel / voxel).log2().floor().clamp(0.0, f64::from(coarsest.0)) as u8
            }
        };
        let few = |level: &Level| self.bricks_met(*level) <= MOST_BRICKS;
        (wanted.min(coarsest.0)..coarsest.0).map(Level).find(few).unwrap_or(coarsest)
    }

    /// Estimates the bricks of a level met by the ray: those on its way, doubled for each axis along which it stays so
    /// near to their faces that samples need voxels from both sides.
    fn bricks_met(&self, level: Level) -> f64 {
        let edge = f64::from(self.volume.source.pyramid().edge());
        let [from, to] = self.stretch.map(|t| self.place(level, t));
        let brick = |place: f64| (place / edge).floor();
        let passed: f64 = (0..3).map(|a| (brick(from[a]) - brick(to[a])).abs()).sum();
        let is_between = |a: &usize| {
            let [from, to] = [from[*a], to[*a]].map(|place| (brick(place - 0.5), brick(place + 0.5)));
            from == to && from.0 < from.1
        };
        (passed + 1.0) * f64::from(1u8 << (0..3).filter(is_between).count())
    }

    fn place(&self, level: Level, t: f64) -> DVec3 {
        let factor = DVec3::from_array(self.volume.source.pyramid().level(level).factor.map(f64::from));
        (self.origin + self.direction * t) / factor
    }

    /// Returns the voxel of level 0 at a distance; one of the outermost where rounding leads outside.
    pub(super) fn voxel(&self, t: f64) -> [u32; 3] {
        let (place, extent) = (self.place(Level(0), t), self.volume.extent().to_array());
        std::array::from_fn(|a| (place[a].floor().max(0.0) as u32).min(extent[a] - 1))
    }

    /// Returns the distance in which the ray moves by a voxel of a level along its fastest axis.
    pub(super) fn voxel_length(&self, level: Level) -> f64 {
        let factor = DVec3::from_array(self.volume.source.pyramid().level(level).factor.map(f64::from));
        1.0 / (self.direction.abs() / factor).max_element()
    }

    /// Whether a segment begins on a cut that caps surfaces.
    pub(super) fn is_capped(&self, start: f64) -> bool {
        let extent = self.volume.extent();
        start == self.stretch[0] && self.settings.cap(extent, self.origin, self.direction, 0.0, start).is_some()
    }

    pub(super) fn clamped(&self, t: f64) -> f64 {
        t.clamp(self.stretch[0], self.stretch[1])
    }
}

/// Returns the distances at which a ray enters and leaves a box, not ascending if it misses.
fn box_stretch(origin: DVec3, direction: DVec3, (low, high): (DVec3, DVec3)) -> (f64, f64) {
    let (mut from, mut to) = (0.0f64, f64::INFINITY);
    for a in 0..3 {
        if direction[a] == 0.0 {
            if origin[a] < low[a] || origin[a] >= high[a] {
                return (0.0, 0.0);
            }
            continue;
        }
        let [one, other] = [low[a], high[a]].map(|side| (side - origin[a]) / direction[a]);
        (from, to) = (from.max(one.min(other)), to.min(one.max(other)));
    }
    (from, to)
}

/// One level of a way's volume, read along the ray.
pub(super) struct Reader<'w, 'a> {
    way: &'w Way<'a>,
    level: Level,
    /// Whether to skip bricks that show nothing.
    skips_empty: bool,
    /// The last brick; without a core if it shows nothing.
    last: Option<(BrickIndex, Option<Arc<[u8]>>)>,
}

impl<'w, 'a> Reader<'w, 'a> {
    pub(super) fn new(way: &'w Way<'a>, level: Level, skips_empty: bool) -> Self {
        Self { way, level, skips_empty, last: None }
    }

    /// Returns the field's value at a distance; `None` where there is none, or it is invisible.
    pub(super) fn value(&mut self, cores: &mut Cores, t: f64) -> Result<Option<f64>, BrickError> {
        self.value_at(cores, self.way.place(self.level, t))
    }

    /// Returns the value of a segment between two distances in a projection of extremes: its middle's, or its box's
    /// extreme, depending on the level. `None` where there is none, or it is invisible.
    pub(super) fn projected(
        &mut self,
        cores: &mut Cores,
        [from, to]: [f64; 2],
        is_least: bool,
    ) -> Result<Option<f64>, BrickError> {
        let factor = self.way.volume.source.pyramid().level(self.level).factor;
        let Some(reach) = self.way.settings.box_reach(factor) else { return self.value(cores, 0.5 * (from + to)) };
        let [from, to] = [from, to].map(|t| self.way.place(self.level, t));
        let (middle, half) = (0.5 * (from + to), DVec3::from_array(half_box((to - from).to_array(), reach)));
        let [low, high] = [middle - half, middle + half].map(|corner| self.bounded(corner.floor()));
        let mut best: Option<f64> = None;
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let Some(value) = self.voxel(cores, [x, y, z])? else { continue };
                    best = Some(best.map_or(value, |best| if is_least { best.min(value) } else { best.max(value) }));
                }
            }
        }
        Ok(best)
    }

    /// Returns the opacity per unit distance of the field's value at a distance.
    pub(super) fn alpha(&mut self, cores: &mut Cores, t: f64, value: f64) -> Result<f64, BrickError> {
        let transfer = &self.way.layer.transfer;
        if !transfer.is_by_gradient() {
            return Ok(transfer.alpha(value));
        }
        let (place, factor) =
            (self.way.place(self.level, t), self.way.volume.source.pyramid().level(self.level).factor);
        let mut gradient = DVec3::ZERO;
        for (a, axis) in DVec3::AXES.into_iter().enumerate() {
            let after = self.value_at(cores, place + axis)?.unwrap_or(value);
            let before = self.value_at(cores, place - axis)?.unwrap_or(value);
            gradient[a] = (after - before) / (2.0 * f64::from(factor[a]) * self.way.settings.geometry.spacing[a]);
        }
        Ok(transfer.at(value, gradient.length())[3])
    }

    /// Returns the value at a place in voxels of the level: the nearest voxel's, or linear between eight. Missing
    /// values are left out, as in renderers.
    fn value_at(&mut self, cores: &mut Cores, place: DVec3) -> Result<Option<f64>, BrickError> {
        let settings = self.way.settings;
        if settings.encoding.is_labels || settings.sampling.filter == Filter::Nearest {
            return self.voxel(cores, self.bounded(place.floor()));
        }
        let (base, t) = ((place - 0.5).floor(), (place - 0.5) - (place - 0.5).floor());
        let (mut sum, mut weight) = (0.0, 0.0);
        for corner in (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from)) {
            let share: f64 = (0..3).map(|a| if corner[a] > 0.0 { t[a] } else { 1.0 - t[a] }).product();
            if share == 0.0 {
                continue;
            }
            let voxel = self.bounded(base + DVec3::from_array(corner));
            if let Some(value) = self.voxel(cores, voxel)? {
                (sum, weight) = (sum + share * value, weight + share);
            }
        }
        Ok((weight >= 0.5).then(|| sum / weight))
    }

    /// Returns the voxel at these indices, or the nearest one in the level.
    fn bounded(&self, index: DVec3) -> [u32; 3] {
        let extent = self.way.volume.source.pyramid().level(self.level).extent.to_array();
        std::array::from_fn(|a| (index[a].max(0.0) as u32).min(extent[a] - 1))
    }

    fn voxel(&mut self, cores: &mut Cores, voxel: [u32; 3]) -> Result<Option<f64>, BrickError> {
        let (source, view) = (&*self.way.volume.source, &self.way.layer.view);
        let edge = source.pyramid().edge();
        let index = BrickIndex::from_array(voxel.map(|v| v / edge));
        if self.last.as_ref().is_none_or(|(last, _)| *last != index) {
            let id = BrickId { time: view.time, channel: view.channel, level: self.level, index };
            let shows = || view.opaque.is_none_or(|opaque| source.occupancy(id).meets(opaque));
            let is_read = !self.skips_empty || shows();
            let core = is_read.then(|| cores.read(self.way.layer.volume, source, id)).transpose()?;
            self.last = Some((index, core));
        }
        let Some((_, Some(core))) = &self.last else { return Ok(None) };
        let [x, y, z] = voxel.map(|v| (v % edge) as usize);
        let value = source.voxel_type().read(core, x + edge as usize * (y + edge as usize * z));
        Ok(Some(value).filter(|value| value.is_finite() && source.nodata() != Some(*value)))
    }
}
