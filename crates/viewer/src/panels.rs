//! The panels beside the picture. Each edits a part of the window's state in place; the window turns the differences into commands. A panel without
//! input changes nothing, and incompatible choices are barred, with the reason at the pointer, or mended.

mod color_map;
pub(crate) mod description;
pub(crate) mod diagnostics;
pub(crate) mod dialogs;
pub(crate) mod edit_form;
pub(crate) mod export_form;
#[cfg(test)]
pub(crate) mod fixture;
pub(crate) mod help;
pub(crate) mod histogram;
pub(crate) mod layers;
pub(crate) mod mending;
pub(crate) mod menu;
pub(crate) mod mesh_form;
pub(crate) mod playing;
pub(crate) mod slices;
pub(crate) mod status;
pub(crate) mod transfer_editor;
pub(crate) mod view;
pub(crate) mod widgets;

use brickyard::session::VolumeSource;
use brickyard::volume::Scene;

/// The reason an edited scene could not be shown, if any. Costs a copy of the scene and its check.
fn reason(scene: &Scene, volumes: &[VolumeSource], edit: impl FnOnce(&mut Scene)) -> Option<String> {
    let mut edited = scene.clone();
    edit(&mut edited);
    let counts: Vec<_> = volumes.iter().map(VolumeSource::counts).collect();
    edited.check(&counts).err().map(|error| error.to_string())
}

#[cfg(test)]
mod tests;
