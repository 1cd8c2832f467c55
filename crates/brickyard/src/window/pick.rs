//! Picking: the visible point at a place of a picture, its layer, and its exact values.
//!
//! A ray is followed through the layers, independently of any renderer. It reads cores of bricks at a level coarse
//! enough to meet few of them (about 16 of a layer), skips empty bricks, ends where light does, and refines its finding
//! alone, down to level 0. A pick thus costs milliseconds with everything to decode, and a fraction of one beside the
//! last pick, whose cores a [`Picker`] keeps. Meshes neither hide nor are found.

mod cores;
mod march;
#[cfg(test)]
mod tests;
mod way;

use crate::session::resolve::ResolvedScene;
use crate::session::volume_source::VolumeSource;
use crate::window::probe::{Probe, probe_voxel_by};
use brickyard_pager::BrickError;
use brickyard_volume::{Blend, Mode, Ray};
use cores::Cores;
use glam::DVec3;
use march::Hit;
use way::Way;

/// The result of picking at a place of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Pick {
    /// The visible point, in the scene's world.
    pub point: DVec3,
    /// The point's distance along the ray, in units of the scene's world.
    pub distance: f64,
    /// Index in the scene of the visible layer.
    pub layer: usize,
    /// The exact values at the point: of the visible layer first, then of the others there, each volume once.
    pub values: Vec<PickedValues>,
}

/// The values of one volume at the picked point.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedValues {
    /// Index in the scene of the layer.
    pub layer: usize,
    /// Index of the volume among those of the resolved scene.
    pub volume: usize,
    /// The values of all channels.
    pub probe: Probe,
}

/// Picks points in pictures, and keeps the last read bricks.
pub struct Picker {
    cores: Cores,
}

impl Default for Picker {
    fn default() -> Self {
        Self::new(64 << 20)
    }
}

impl Picker {
    /// Creates a picker that keeps at most `bytes` of decoded bricks, or one larger brick. They are dropped on a pick
    /// in other volumes or another time step.
    pub fn new(bytes: u64) -> Self {
        Self { cores: Cores::new(bytes) }
    }

    /// Bytes of the kept decoded bricks.
    pub fn bytes(&self) -> u64 {
        self.cores.bytes
    }

    /// Bricks decoded so far.
    pub fn decoded(&self) -> u64 {
        self.cores.decoded
    }

    /// Picks at a place of a scene's picture (pixel `(i, j)` has its centre at `(i + 0.5, j + 0.5)`), for the left eye
    /// in stereo. `volumes` are those of the resolved scene. `None` if nothing is visible there.
    ///
    /// - In a slice: the point of its plane.
    /// - In [`Mode::Dvr`]: where the ray has collected half of its total opacity; nothing if the total is below a
    ///   fiftieth. Among several layers the one with the most opacity there is visible.
    /// - In [`Mode::Isosurface`]: the first surface.
    /// - In [`Mode::Mip`] and [`Mode::MinIp`]: the nearest place with the extreme value, of overlaid labels, or else of
    ///   the layer with the brightest extreme in the picture.
    /// - In [`Mode::Average`]: the ray's point inside the volume nearest to the camera's target.
    ///
    /// # Errors
    /// If a brick cannot be read.
    pub fn pick(
        &mut self,
        scene: &ResolvedScene,
        volumes: &[VolumeSource],
        place_px: [f64; 2],
    ) -> Result<Option<Pick>, BrickError> {
        let Some(first) = scene.layers.first() else { return Ok(None) };
        self.cores.turn_to(volumes, first.view.time);
        let ray = first.frames[0].settings.rays.ray(place_px[0], place_px[1]);
        let way = |layer| Way::new(layer, &volumes[layer.volume], &ray);
        let ways: Vec<Way<'_>> = scene.layers.iter().filter_map(way).collect();
        if ways.is_empty() {
            return Ok(None);
        }
        let hit = match first.frames[0].settings.mode {
            _ if scene.slice.is_some() => self.flat(scene, &ways, &ray)?,
            Mode::Dvr | Mode::Isosurface => march::seen_through(&ways, scene.combination.as_ref(), &mut self.cores)?,
            _ if scene.mode.extreme().is_none() => self.flat(scene, &ways, &ray)?,
            _ => brightest(&ways, march::extremes(&ways, &mut self.cores)?),
        };
        hit.map(|hit| self.picked(&ways, &ray, hit)).transpose()
    }

    /// Returns the point of a slice, or the one nearest to the camera's target.
    fn flat(&mut self, scene: &ResolvedScene, ways: &[Way<'_>], ray: &Ray) -> Result<Option<Hit>, BrickError> {
        let t = match &scene.slice {
            Some(slice) => (slice.point - ray.origin).dot(slice.normal) / ray.direction.dot(slice.normal),
            None => (scene.camera.target - ray.origin).dot(ray.direction),
        };
        let mut best: Option<(u8, Hit)> = None;
        for (i, way) in ways.iter().enumerate() {
            let hit = Hit { t: if t.is_finite() { way.clamped(t) } else { way.stretch[0] }, way: i };
            let channel = way.layer.view.channel as usize;
            let value = self.probe(way, hit.t)?.values[channel];
            let (is_over, is_labels) = (way.layer.frames[0].blend == Blend::Over, way.settings.encoding.is_labels);
            let is_shown = !value.is_nan() && (!is_labels || way.layer.transfer.alpha(value) > 0.0);
            let rank = if is_shown { 1 + u8::from(is_over) } else { 0 };
            if best.as_ref().is_none_or(|(most, _)| rank > *most) {
                best = Some((rank, hit));
            }
        }
        Ok(best.map(|(_, hit)| hit))
    }

    fn picked(&mut self, ways: &[Way<'_>], ray: &Ray, Hit { t, way }: Hit) -> Result<Pick, BrickError> {
        let others = (0..ways.len()).filter(|&other| other != way);
        let mut values: Vec<PickedValues> = Vec::new();
        for way in std::iter::once(way).chain(others).map(|i| &ways[i]) {
            let is_there = (way.stretch[0]..=way.stretch[1]).contains(&t);
            if is_there && values.iter().all(|known| known.volume != way.layer.volume) {
                let (layer, volume) = (way.layer.place, way.layer.volume);
                values.push(PickedValues { layer, volume, probe: self.probe(way, t)? });
            }
        }
        let layer = ways[way].layer.place;
        Ok(Pick { point: ray.origin + ray.direction * t, distance: t, layer, values })
    }

    fn probe(&mut self, way: &Way<'_>, t: f64) -> Result<Probe, BrickError> {
        let read = |id| self.cores.read(way.layer.volume, &*way.volume.source, id);
        probe_voxel_by(way.volume, way.layer.view.time, way.voxel(t), read)
    }
}

/// Returns the most visible extreme: of overlays, else the brightest.
fn brightest(ways: &[Way<'_>], extremes: Vec<(Hit, f64)>) -> Option<Hit> {
    let seen = |(hit, value): &(Hit, f64)| {
        let layer = ways[hit.way].layer;
        let frame = &layer.frames[0];
        let [r, g, b] = layer.transfer.rgb(*value);
        let light = frame.opacity * (0.2126 * r + 0.7152 * g + 0.0722 * b);
        (frame.blend == Blend::Over, light)
    };
    let order = |a: &(Hit, f64), b: &(Hit, f64)| {
        let [(a_over, a_light), (b_over, b_light)] = [seen(a), seen(b)];
        a_over.cmp(&b_over).then(a_light.total_cmp(&b_light))
    };
    extremes.into_iter().max_by(order).map(|(hit, _)| hit)
}
