//! An edit of a store's metadata beside the window, which goes on with the new values. Places of the former world mean others in the new one, so they go.

use crate::panels::edit_form::MetadataEdit;
use crate::state::State;
use crate::work_row;
use brickyard::background::{self, Background, EditingError};
use brickyard::channels::channel_layers;
use brickyard::session::VolumeSource;
use brickyard::store::{EditReport, Store};
use eframe::egui::Ui;
use std::path::PathBuf;

/// An edit under way.
pub(crate) struct Editing {
    path: PathBuf,
    work: Background<(EditReport, VolumeSource), EditingError>,
}

impl Editing {
    /// Starts an edit of a store.
    ///
    /// # Errors
    /// If a value is malformed.
    pub(crate) fn start(store: &Store, changes: &MetadataEdit) -> Result<Self, String> {
        let path = store.path().to_owned();
        Ok(Self { work: background::edit(path.clone(), changes.edit()?), path })
    }

    /// The resulting message and the store's volume, once it is over.
    pub(crate) fn poll(&mut self) -> Option<Result<(String, VolumeSource), String>> {
        let edited = self.work.poll()?;
        Some(edited.map_err(|error| plain(&error.to_string())).map(|(report, volume)| {
            let changes: Vec<String> = report.changes.iter().map(ToString::to_string).collect();
            let stale = report.stale_groups.iter().map(|group| {
                let what = "holds a copy of the former values: consolidate it anew (zarr.consolidate_metadata)";
                format!(". {} {what}", group.display())
            });
            let stale: String = stale.collect();
            (format!("edited {}: {}{stale}", self.path.display(), changes.join(", ")), volume)
        }))
    }

    pub(crate) fn show(&self, ui: &mut Ui) {
        work_row::show_writing(ui, &self.path);
    }
}

/// A message without the marks around names of options, which are the form's fields here.
fn plain(message: &str) -> String {
    message.replace('`', "")
}

/// Takes volumes with edited metadata into a window's state: layers in the former colours of their channels take the new ones, and if a volume has
/// another place, places of the former world go. Returns whether one has.
pub(crate) fn take_up(state: &mut State, before: &[VolumeSource], after: &[VolumeSource]) -> bool {
    for i in 0..state.scene.layers.len() {
        let volume = state.scene.store(i);
        let layer = &mut state.scene.layers[i];
        let color =
            |volumes: &[VolumeSource]| channel_layers(volume, volumes.get(volume)?, &[layer.channel])[0].color.into();
        if let (Some(old), Some(new)) = (color(before), color(after))
            && layer.color == old
        {
            layer.color = new;
        }
    }
    let is_elsewhere = before.iter().map(VolumeSource::place).ne(after.iter().map(VolumeSource::place));
    if is_elsewhere {
        let scene = &mut state.scene;
        (scene.clip, scene.slice) = (None, None);
        scene.clip_planes.clear();
        state.window.distances.clear();
        state.window.planes.crosshair = None;
        state.window.planes.cameras = [None; 3];
        state.window.planes.thickness = 0.0;
    }
    is_elsewhere
}
