//! The pick under the pointer: the visible world point, and the exact values of its voxel. A thread computes it, so that a slow disk does not hold up
//! the window; it answers only for the newest place. Costs up to 64 MiB of decoded bricks per picture.

use crate::canvas::Canvas;
use crate::newest::answering;
use crate::overlay::Lens;
use crate::read_out::ReadOut;
use brickyard::overlay::{axis_units, place_in_words, short_name};
use brickyard::pick::{Pick, Picker};
use brickyard::session::{ResolvedScene, VolumeSource};
use brickyard::volume::numbers::exact;
use brickyard::volume::units::with_unit;
use eframe::egui::{self, Response};
use glam::DVec3;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// The pick under the pointer, in words.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picked {
    /// The visible world point, and its values.
    pub(crate) pick: Pick,
    /// The label there, if the visible layer has labels.
    pub(crate) label: Option<i64>,
    pub(crate) words: ReadOut,
}

/// Most characters of a name.
const LONGEST: usize = 16;

/// A place on a scene's picture, in pixels.
type Place = (Arc<ResolvedScene>, [f64; 2]);

/// A request to the thread: a place, and the scene's volumes.
type Question = (Place, Vec<VolumeSource>, egui::Context);

/// Looks up picks on a thread; keeps the latest.
#[derive(Default)]
pub(crate) struct Picking {
    /// Channels to the thread and back; `None` before the first request.
    thread: Option<(Sender<Question>, Receiver<Option<Picked>>)>,
    asked: Option<Place>,
    /// The latest pick; `None` while the pointer is elsewhere.
    pub(crate) picked: Option<Picked>,
}

impl Picking {
    /// Looks up the place under the pointer over a picture. The pick may be outdated for a while; the window is repainted for a newer one.
    pub(crate) fn look(&mut self, canvas: &Canvas, lens: &Lens, response: &Response) {
        let ((Some(scene), volumes), Some(pointer)) = (canvas.resolved(), response.hover_pos()) else {
            (self.asked, self.picked) = (None, None);
            return;
        };
        let place_px = lens.pixel(pointer);
        let is_asked = self.asked.as_ref().is_some_and(|(of, at)| Arc::ptr_eq(of, scene) && *at == place_px);
        let (ask, answers) = self.thread.get_or_insert_with(start);
        let place = (scene.clone(), place_px);
        if !is_asked && ask.send((place.clone(), volumes.to_vec(), response.ctx.clone())).is_ok() {
            self.asked = Some(place);
        }
        if let Some(picked) = answers.try_iter().last() {
            self.picked = picked;
        }
    }
}

/// Starts the thread.
fn start() -> (Sender<Question>, Receiver<Option<Picked>>) {
    let (answer, answers) = channel();
    let mut picker = Picker::default();
    let ask = answering(move |((scene, place_px), volumes, egui): Question| {
        if answer.send(look(&mut picker, &scene, place_px, &volumes)).is_ok() {
            egui.request_repaint();
        }
    });
    (ask, answers)
}

/// The pick at a place. The picture reports unreadable bricks; here they yield nothing.
fn look(picker: &mut Picker, scene: &ResolvedScene, place_px: [f64; 2], volumes: &[VolumeSource]) -> Option<Picked> {
    let pick = picker.pick(scene, volumes, place_px);
    let pick = pick.inspect_err(|error| tracing::debug!("nothing can be picked: {error}")).ok()??;
    let first = pick.values.first();
    let label = first.and_then(|values| {
        let channel = scene.layers.iter().find(|layer| layer.place == values.layer)?.view.channel as usize;
        let value = *values.probe.values.get(channel)?;
        let is_label = volumes.get(values.volume)?.source.is_labels();
        (is_label && !value.is_nan()).then_some(value as i64)
    });
    let words = words(&pick, volumes, scene.world_box, scene.is_anatomical);
    Some(Picked { pick, label, words })
}

/// A pick in words: the place in the world, and each volume's voxel and values, in order. A voxel equal to the previous one is not repeated.
fn words(pick: &Pick, volumes: &[VolumeSource], world_box: (DVec3, DVec3), is_anatomical: bool) -> ReadOut {
    let place = format!("at {}", place_in_words(pick.point, world_box, axis_units(volumes, is_anatomical)));
    let mut in_order: Vec<_> = pick.values.iter().collect();
    in_order.sort_by_key(|values| values.volume);
    let (mut said, mut words) = (String::new(), Vec::new());
    for values in in_order {
        let Some(volume) = volumes.get(values.volume) else { continue };
        let stride = volume.stride();
        let [i, j, k] = std::array::from_fn(|axis| values.probe.voxel[axis] * stride[axis] + stride[axis] / 2);
        let near = if stride == [1; 3] { "voxel" } else { "about voxel" };
        let voxel = format!("{near} {i}, {j}, {k}:");
        let mut lead = if voxel == said { " ".into() } else { format!("  {voxel}") };
        said = voxel;
        let is_float = volume.source.voxel_type().is_float();
        for (channel, value) in values.probe.values.iter().enumerate() {
            let unit = volume.value_unit(channel as u32);
            let text = if value.is_nan() { "no data".to_string() } else { with_unit(&exact(*value, is_float), unit) };
            let name = volume.displays().get(channel).and_then(|display| display.name.clone());
            // The volume's own name stands for its unnamed first channel.
            let name = name.or_else(|| volume.name().filter(|_| channel == 0)).unwrap_or_default();
            let name = if name.is_empty() { name } else { format!("{} ", short_name(&name, LONGEST)) };
            words.push(format!("{} {name}{text}", std::mem::take(&mut lead)));
        }
    }
    ReadOut { place, values: words }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use brickyard::pick::PickedValues;
    use brickyard::probe::Probe;

    #[test]
    fn values_are_named_and_a_voxel_is_said_once() {
        let volumes: Vec<_> = fixture::volumes()
            .into_iter()
            .zip(["scan", "a_very_long_name_of_nuclei"])
            .map(|(v, n)| v.named(n))
            .collect();
        let values = |volume: usize, values: &[f64]| {
            let probe = Probe { voxel: [3, 4, 5], world: DVec3::ZERO, values: values.into() };
            PickedValues { layer: volume, volume, probe }
        };
        let point = DVec3::new(3.123_456, 4.0, -5.5);
        let pick =
            Pick { point, distance: 1.0, layer: 1, values: vec![values(1, &[7.0]), values(0, &[21.0, f64::NAN])] };
        let words = words(&pick, &volumes, (DVec3::ZERO, DVec3::splat(30.0)), false);
        assert_eq!(words.all(), "at 3.12, 4, -5.5 mm  voxel 3, 4, 5: scan 21 no data  a_very_l\u{2026}_nuclei 7");
    }
}
