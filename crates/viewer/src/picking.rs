//! What is under the pointer: the point of the world that is seen there, and the exact values of the voxel that it is in, of all volumes that the scene
//! shows. Costs the reading of a brick for each channel, only when the pointer comes to another place.

use brickyard::probe::{Probe, probe};
use brickyard::session::VolumeSource;
use brickyard::volume::{Scene, Slice, ViewRays};
use glam::DVec3;
use std::fmt::Write;

/// What is under the pointer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picked {
    /// The point of the world that is seen there.
    pub(crate) point: DVec3,
    /// Its voxel and values, in words.
    pub(crate) words: String,
}

/// The values under the pointer, as of the last time it moved.
#[derive(Default)]
pub(crate) struct Picking {
    last: Option<(DVec3, u32, String)>,
}

impl Picking {
    /// What is at a place of the picture, in pixels; `None` if there is nothing to be seen.
    pub(crate) fn at(
        &mut self,
        scene: &Scene,
        volumes: &[VolumeSource],
        rays: &ViewRays,
        place_px: [f64; 2],
    ) -> Option<Picked> {
        let point = on_slice(rays, scene.slice.as_ref()?, place_px)?;
        let is_known = |last: &(DVec3, u32, String)| (last.0, last.1) == (point, scene.time);
        if !self.last.as_ref().is_some_and(is_known) {
            self.last = Some((point, scene.time, words(scene, volumes, point)));
        }
        let (_, _, words) = self.last.as_ref()?;
        (!words.is_empty()).then(|| Picked { point, words: words.clone() })
    }
}

/// Where the ray through a place of the picture meets a slice; `None` if it goes along it.
fn on_slice(rays: &ViewRays, slice: &Slice, [x_px, y_px]: [f64; 2]) -> Option<DVec3> {
    let ray = rays.ray(x_px, y_px);
    let along = (slice.point - ray.origin).dot(slice.normal) / ray.direction.dot(slice.normal);
    Some(ray.origin + ray.direction * along).filter(|point| point.is_finite())
}

/// The values of the volumes that are shown at a point of the scene's world, each volume once.
fn words(scene: &Scene, volumes: &[VolumeSource], point: DVec3) -> String {
    let mut words = String::new();
    let mut seen = Vec::new();
    for layer in (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible) {
        let store = scene.store(layer);
        let Some(volume) = volumes.get(store).filter(|_| !seen.contains(&store)) else { continue };
        seen.push(store);
        // The layer may be moved from where its store says that it is.
        let own = scene.layers[layer].world_from_volume.volume_from_world(point);
        let time = scene.time.min(volume.source.times() - 1);
        match probe(volume, time, own) {
            Ok(Some(found)) => describe(&mut words, volume, &found, point),
            Ok(None) => {}
            Err(error) => words += &format!("{error}  "),
        }
    }
    words
}

fn describe(words: &mut String, volume: &VolumeSource, found: &Probe, point: DVec3) {
    let [x, y, z] = found.voxel;
    let displays = volume.store().map_or(&[][..], |store| store.channel_displays());
    // Writing to a string cannot fail.
    let _ = write!(words, "voxel {x}, {y}, {z} at {:.4}, {:.4}, {:.4}:", point.x, point.y, point.z);
    for (channel, value) in found.values.iter().enumerate() {
        let name = displays.get(channel).and_then(|display| display.name.as_deref());
        let _ = match (name, value.is_nan()) {
            (Some(name), false) => write!(words, " {name} {value}"),
            (None, false) => write!(words, " {value}"),
            (_, true) => write!(words, " no data"),
        };
    }
    words.push_str("  ");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_point_of_a_slice_is_under_the_pointer() {
        let slice = Slice::across(2, 3.0);
        let size = (300, 200);
        let camera = slice.camera((DVec3::ZERO, DVec3::new(9.0, 6.0, 5.0)), slice.image_up(), size);
        let point = on_slice(&camera.rays(300, 200).unwrap(), &slice, [70.0, 50.0]).unwrap();
        assert!((point.z - 3.0).abs() < 1e-9, "{point}");
        let [x, y] = camera.rays(300, 200).unwrap().pixel(point).unwrap();
        assert!((x - 70.0).abs() < 1e-6 && (y - 50.0).abs() < 1e-6);
    }
}
