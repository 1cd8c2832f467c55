//! Form of a mesh: the surface of the visible voxels, level and smoothing, as controls and as words of a command.

use crate::panels::export_form::{is_yes, level, words};
use crate::panels::mending::middle;
use crate::panels::widgets::{ANY, count, number, row, suffix};
use crate::part::{Part, first_store};
use brickyard::extract::{MOST_SMOOTHING, MeshRequest, MeshSurface};
use brickyard::session::VolumeSource;
use brickyard::volume::{Level, Mode, Scene};
use eframe::egui::{DragValue, Ui};
use std::fmt;

/// Width of the number of an isovalue, in points.
const VALUE_WIDTH: f32 = 90.0;

/// The form of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MeshForm {
    /// `None` is what the window shows: see [`shown_surface`].
    surface: Option<MeshSurface>,
    pub(crate) level: u8,
    /// Iterations of smoothing.
    smoothing: u32,
    /// Whether an existing file is replaced.
    pub(crate) replaces: bool,
}

/// The surface that a window shows of its first visible layer: of labels the only visible one, or all; else its first isosurface in a mode with
/// surfaces, or the middle of its window.
///
/// # Errors
/// If there is no such layer, or it is of no store yet.
pub(crate) fn shown_surface(scene: &Scene, volumes: &[VolumeSource]) -> Result<MeshSurface, String> {
    let (layer, volume, _) = first_store(scene, volumes)?;
    let layer = &scene.layers[layer];
    if volume.source.is_labels() {
        return Ok(match layer.show_labels.as_deref() {
            Some([one]) => MeshSurface::Label(*one),
            _ => MeshSurface::Labels,
        });
    }
    let surface = layer.isosurfaces.first().filter(|_| matches!(scene.mode, Mode::Isosurface | Mode::Dvr));
    Ok(MeshSurface::Isosurface(surface.map_or_else(|| middle(layer, volume), |surface| surface.value)))
}

impl MeshForm {
    /// The request for a part, of this surface unless the form has one.
    pub(crate) fn request(&self, part: &Part, shown: MeshSurface) -> MeshRequest {
        MeshRequest {
            level: Level(self.level),
            time: part.step,
            channel: part.channel,
            region: Some(part.region),
            smoothing: self.smoothing,
            overwrite: self.replaces,
            ..MeshRequest::new(self.surface.unwrap_or(shown))
        }
    }

    /// Shows the form, for a part of a volume, and the surface that is shown. A surface of another kind is dropped: the first visible layer may become
    /// another.
    pub(crate) fn show(&mut self, ui: &mut Ui, part: &Part, volume: &VolumeSource, shown: MeshSurface) {
        let is_of_labels = |surface: &MeshSurface| !matches!(surface, MeshSurface::Isosurface(_));
        self.surface.take_if(|own| is_of_labels(own) != is_of_labels(&shown));
        let surface = self.surface.get_or_insert(shown);
        match surface {
            MeshSurface::Isosurface(value) => isovalue(ui, value, part, volume),
            MeshSurface::Label(_) | MeshSurface::Labels => labels(ui, surface, part),
        }
        level(ui, &mut self.level, part.coarsest());
        let hint = "iterations: an isosurface keeps its volume, borders of labels stay within half a voxel";
        count(ui, "smoothing", hint, &mut self.smoothing, 0..=MOST_SMOOTHING);
    }

    /// The reason for no mesh in a part, if any: the ranges of values and labels rule one out.
    pub(crate) fn problem(&self, part: &Part, shown: MeshSurface) -> Option<String> {
        let (low, high) = part.store.channel_range(part.channel);
        match self.surface.unwrap_or(shown) {
            MeshSurface::Isosurface(value) if value > high => {
                Some(format!("no value is as high: values lie from {low} to {high}"))
            }
            MeshSurface::Label(label) if !part.store.may_have_label(part.channel, label) => {
                Some(format!("there is no label {label}: labels lie from {low} to {high}"))
            }
            _ => None,
        }
    }
}

fn isovalue(ui: &mut Ui, value: &mut f64, part: &Part, volume: &VolumeSource) {
    let (low, high) = volume.likely_range(part.channel);
    row(ui, "isovalue", "the border of all values of at least this", |ui, label| {
        let unit = suffix(volume.value_unit(part.channel));
        number(ui, value, ANY, high - low, VALUE_WIDTH, unit).labelled_by(label);
        ui.weak(format!("of {low} to {high}"));
    });
}

fn labels(ui: &mut Ui, surface: &mut MeshSurface, part: &Part) {
    let [low, high] = part.store.info().channels[part.channel as usize].range;
    row(ui, "labels", "the border of one label, or of each but the background, 0", |ui, label| {
        let mut are_all = *surface == MeshSurface::Labels;
        if ui.checkbox(&mut are_all, "all, an object for each").changed() {
            // The least label that is no background.
            let first = if low > 0.0 { low as i64 } else { 1 };
            *surface = if are_all { MeshSurface::Labels } else { MeshSurface::Label(first) };
        }
        if let MeshSurface::Label(one) = surface {
            ui.add(DragValue::new(one)).labelled_by(label);
            ui.weak(format!("of {low} to {high}"));
        }
    });
}

impl fmt::Display for MeshForm {
    /// Writes the form's words, each with a space behind it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.surface {
            None => {}
            Some(MeshSurface::Isosurface(value)) => write!(f, "isovalue={value} ")?,
            Some(MeshSurface::Label(label)) => write!(f, "label={label} ")?,
            Some(MeshSurface::Labels) => f.write_str("label=all ")?,
        }
        if self.level > 0 {
            write!(f, "level={} ", self.level)?;
        }
        if self.smoothing > 0 {
            write!(f, "smooth={} ", self.smoothing)?;
        }
        if self.replaces { f.write_str("replace=yes ") } else { Ok(()) }
    }
}

impl MeshForm {
    /// Reads the words before a file's name, and returns the name; `None` for a wrong value.
    pub(crate) fn read(text: &str) -> Option<(Self, &str)> {
        let mut form = Self::default();
        let file = words(text, |name, value| {
            match (name, value) {
                ("isovalue", value) => {
                    let value = value.parse().ok().filter(|value: &f64| value.is_finite())?;
                    form.surface = Some(MeshSurface::Isosurface(value));
                }
                ("label", "all") => form.surface = Some(MeshSurface::Labels),
                ("label", value) => form.surface = Some(MeshSurface::Label(value.parse().ok()?)),
                ("level", value) => form.level = value.parse().ok()?,
                ("smooth", value) => form.smoothing = value.parse().ok()?,
                ("replace", value) => form.replaces = is_yes(value)?,
                _ => return Some(false),
            }
            Some(true)
        })?;
        Some((form, file))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::tests::store;
    use brickyard::volume::Isosurface;

    #[test]
    fn the_shown_surface_is_the_one_of_the_mode_or_the_middle_of_the_window() {
        let folder = tempfile::tempdir().unwrap();
        let volumes = [store(folder.path())];
        let mut scene = Scene::default();
        scene.layers[0].window = Some([100.0, 300.0]);
        assert_eq!(shown_surface(&scene, &volumes), Ok(MeshSurface::Isosurface(200.0)));
        scene.layers[0].isosurfaces = vec![Isosurface::at(77.0), Isosurface::at(99.0)];
        scene.mode = Mode::Isosurface;
        assert_eq!(shown_surface(&scene, &volumes), Ok(MeshSurface::Isosurface(77.0)));
        assert!(shown_surface(&scene, &[crate::nothing::volume()]).unwrap_err().contains("is packed"));
    }

    #[test]
    fn the_request_is_what_the_form_says() {
        let folder = tempfile::tempdir().unwrap();
        let volumes = [store(folder.path())];
        let part = Part::of(&Scene { time: 2, ..Scene::default() }, &volumes, 1).unwrap();
        let shown = MeshSurface::Isosurface(5.0);
        let (form, file) = MeshForm::read("label=7 level=1 smooth=3 a b.glb").unwrap();
        assert_eq!(file, "a b.glb");
        let request = form.request(&part, shown);
        assert_eq!((request.surface, request.level, request.smoothing), (MeshSurface::Label(7), Level(1), 3));
        assert_eq!((request.time, request.region, request.overwrite), (2, Some(part.region), false));
        assert_eq!(MeshForm::default().request(&part, shown).surface, shown);
        let high = MeshForm { surface: Some(MeshSurface::Isosurface(1e9)), ..MeshForm::default() };
        assert!(high.problem(&part, shown).unwrap().contains("no value is as high"));
        for bad in ["isovalue=inf a.stl", "label=x a.stl", "smooth=-1 a.stl", "replace=1 a.stl", ""] {
            assert_eq!(MeshForm::read(bad), None, "{bad}");
        }
    }
}
