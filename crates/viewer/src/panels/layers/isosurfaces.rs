//! The isosurfaces of a layer: their values, colours and opacities, as a list.

use crate::panels::mending::drop_idle_lights;
use crate::panels::widgets::{Scale, group, list, opacity, own_color, row, slider, suffix};
use brickyard::session::VolumeSource;
use brickyard::volume::surface::MAX_SURFACES;
use brickyard::volume::{Isosurface, Mode, Scene};
use eframe::egui::{Button, Ui};

const HINT: &str = "surfaces of one value: alone in mode isosurface, and within the fog in mode dvr";

pub(crate) fn show(ui: &mut Ui, scene: &mut Scene, layer: usize, volume: &VolumeSource) {
    group(ui, "isosurfaces", HINT, |ui| {
        let barred =
            scene.mode.is_projection().then_some("a projection shows no surfaces: choose mode dvr or isosurface");
        let keep_last = scene.mode == Mode::Isosurface && others(scene, layer) == 0;
        let (least, greatest) = volume.source.channel_range(scene.layers[layer].channel);
        let unit = suffix(volume.value_unit(scene.layers[layer].channel));
        let seen = volume.function(&scene.layers[layer]).ok();
        let surfaces = &mut scene.layers[layer].isosurfaces;
        let is_only = surfaces.len() == 1;
        let mut values: Vec<f64> = surfaces.iter().map(|surface| surface.value).collect();
        let is_one_removed = list(ui, surfaces, |ui, i, surface| {
            let hint = "the value on the surface, in stored units";
            slider(ui, "value", hint, &mut surface.value, Scale::Linear, least..=greatest, unit);
            if values.iter().enumerate().any(|(other, value)| other != i && *value == surface.value) {
                // Two surfaces in one place would be indistinguishable.
                surface.value = values[i];
            }
            opacity(ui, "the share of light it absorbs", &mut surface.opacity);
            let hint = "its own colour, or the transfer function's at the value";
            let is_removed = row(ui, "colour", hint, |ui, label| {
                let color = seen.as_ref().map_or([1.0; 3], |function| function.rgb(values[i]));
                own_color(ui, &mut surface.color, color, label);
                let remove = ui.add_enabled(!(is_only && keep_last), Button::new("remove").small());
                let reason = "mode isosurface shows nothing else: choose another mode first";
                remove.on_disabled_hover_text(reason).clicked()
            });
            values[i] = surface.value;
            ui.add_space(4.0);
            is_removed
        });
        if is_one_removed {
            if scene.layers.iter().all(|layer| layer.isosurfaces.is_empty()) {
                drop_idle_lights(scene);
            }
            return;
        }
        let full = (surfaces.len() >= MAX_SURFACES).then_some("a layer has at most 8 isosurfaces");
        let reason = barred.or(full);
        let add = ui.add_enabled(reason.is_none(), Button::new("add a surface"));
        if add.on_disabled_hover_text(reason.unwrap_or_default()).clicked() {
            surfaces.push(another(surfaces, (least, greatest)));
        }
    });
}

/// Number of surfaces of the other visible layers.
fn others(scene: &Scene, layer: usize) -> usize {
    let shown = scene.layers.iter().enumerate().filter(|(i, other)| *i != layer && other.visible);
    shown.map(|(_, other)| other.isosurfaces.len()).sum()
}

/// A surface in the widest gap between the present ones.
fn another(surfaces: &[Isosurface], (least, greatest): (f64, f64)) -> Isosurface {
    let inside = surfaces.iter().map(|surface| surface.value).filter(|value| least < *value && *value < greatest);
    let mut values: Vec<f64> = inside.chain([least, greatest]).collect();
    values.sort_by(f64::total_cmp);
    let gaps = values.windows(2).map(|pair| (pair[1] - pair[0], 0.5 * (pair[0] + pair[1])));
    let widest = gaps.fold((f64::NEG_INFINITY, least), |best, gap| if gap.0 > best.0 { gap } else { best });
    let mut value = widest.1;
    // A volume of one value has no gap.
    while surfaces.iter().any(|surface| surface.value == value) {
        value += value.abs().max(1.0) * 0.01;
    }
    Isosurface::at(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_are_added_where_there_is_room() {
        let mut surfaces = Vec::new();
        for expected in [50.0, 25.0, 75.0, 12.5] {
            surfaces.push(another(&surfaces, (0.0, 100.0)));
            assert_eq!(surfaces.last().map(|surface| surface.value), Some(expected));
        }
        let mut constant = Vec::new();
        for _ in 0..MAX_SURFACES {
            constant.push(another(&constant, (7.0, 7.0)));
        }
        constant.dedup_by(|a, b| a.value == b.value);
        assert_eq!(constant.len(), MAX_SURFACES);
    }
}
