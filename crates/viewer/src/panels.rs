//! The panels beside the picture. Each shows a part of the window's state and edits it in place; the window makes commands of what it finds changed. A panel that is only
//! looked at changes nothing, and what cannot be shown together is barred, with the reason where the pointer is, or mended.

mod color_map;
pub(crate) mod description;
pub(crate) mod diagnostics;
pub(crate) mod dialogs;
#[cfg(test)]
pub(crate) mod fixture;
pub(crate) mod help;
pub(crate) mod histogram;
pub(crate) mod layers;
pub(crate) mod mending;
pub(crate) mod menu;
pub(crate) mod playing;
pub(crate) mod slices;
pub(crate) mod status;
pub(crate) mod transfer_editor;
pub(crate) mod view;
pub(crate) mod widgets;

use brickyard::session::VolumeSource;
use brickyard::volume::Scene;

/// Why a scene of these volumes could not be shown any more after an edit; `None` if it could. Costs a copy of the scene and its check.
fn reason(scene: &Scene, volumes: &[VolumeSource], edit: impl FnOnce(&mut Scene)) -> Option<String> {
    let mut edited = scene.clone();
    edit(&mut edited);
    let counts: Vec<_> = volumes.iter().map(VolumeSource::counts).collect();
    edited.check(&counts).err().map(|error| error.to_string())
}

#[cfg(test)]
mod tests;
