//! Scene files, and the mesh and transfer function files named in scenes. [`open`] reads a scene with all of its files;
//! the command reads a scene first, then applies its flags, then reads the files still named. Everything is read once,
//! before anything is shown.

use crate::files::text_file::{TextError, read_text};
use crate::session::VolumeSource;
use crate::session::channels::default_layers;
use brickyard_import::ImportError;
use brickyard_volume::transfer::file;
use brickyard_volume::transfer::{TransferError, shown_window};
use brickyard_volume::{Expression, Scene, Subject, TransferChoice, TransferFile};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::path::{Path, PathBuf};
#[cfg(feature = "mesh")]
use std::sync::Arc;

/// Errors in reading a scene's file, or a file named in it. Each message begins with the file's path.
#[derive(Debug, thiserror::Error)]
pub enum SceneFileError {
    /// A scene or a transfer function cannot be read as text.
    #[error(transparent)]
    Text(#[from] TextError),
    /// The text is not a scene in JSON.
    #[error("{path}: not a scene: {source}", path = path.display())]
    NotAScene {
        /// The scene's file.
        path: PathBuf,
        /// The place of the fault in the text.
        source: serde_json::Error,
    },
    /// A mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] ImportError),
    /// A file is no transfer function, or has none of the requested name.
    #[error("{path}: {source}", path = path.display())]
    Transfer {
        /// The transfer function's file.
        path: PathBuf,
        /// The fault of the file.
        source: TransferError,
    },
}

/// A scene file as read.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The scene; without `layers` in the file it has one layer, of the first volume's first channel.
    pub scene: Scene,
    /// Whether the file lists layers.
    pub lists_layers: bool,
}

/// Detects layers in a scene file.
#[derive(Deserialize)]
struct Listed {
    layers: Option<IgnoredAny>,
}

/// Reads a scene of these volumes, with its named files; a file without layers shows all visible channels of all
/// volumes. Also returns remarks about its transfer functions: parts left out for lack of a counterpart here, and
/// defaults for missing values.
///
/// # Errors
/// If one of the files cannot be read or is malformed.
pub fn open(path: impl AsRef<Path>, volumes: &[VolumeSource]) -> Result<(Scene, Vec<String>), SceneFileError> {
    let SceneFile { mut scene, lists_layers } = read(path.as_ref())?;
    if !lists_layers {
        scene.layers = default_layers(volumes);
    }
    let remarks = read_named_files(&mut scene, volumes)?;
    Ok((scene, remarks))
}

/// Reads a scene alone. Its file names are resolved against the folder of the scene's file.
///
/// # Errors
/// If the file cannot be read or is not a scene.
pub fn read(path: &Path) -> Result<SceneFile, SceneFileError> {
    let not_a_scene = |source| SceneFileError::NotAScene { path: path.into(), source };
    let text = read_text(path)?;
    let mut scene: Scene = serde_json::from_str(&text).map_err(not_a_scene)?;
    let Listed { layers } = serde_json::from_str(&text).map_err(not_a_scene)?;
    for look in &mut scene.meshes {
        look.path = path.with_file_name(&look.path);
    }
    transfer_files(&mut scene).for_each(|(_, file)| file.path = path.with_file_name(&file.path));
    Ok(SceneFile { scene, lists_layers: layers.is_some() })
}

/// Reads the meshes and transfer functions named in a scene of these volumes, unless read already. Returns remarks like
/// [`open`]. The transfer function of a layer with a missing volume or channel is left unread. Without the feature
/// `mesh`, meshes are left unread; a scene with an unread file is refused when shown.
///
/// # Errors
/// If one of the files cannot be read or is malformed.
pub fn read_named_files(scene: &mut Scene, volumes: &[VolumeSource]) -> Result<Vec<String>, SceneFileError> {
    #[cfg(feature = "mesh")]
    for look in scene.meshes.iter_mut().filter(|look| look.mesh.is_none()) {
        look.mesh = Some(Arc::new(brickyard_import::read_mesh(&look.path)?));
    }
    let subjects: Vec<_> = (0..scene.layers.len()).map(|layer| subject(scene, layer, volumes)).collect();
    let of_expression = expression_subject(scene, &subjects);
    let mut remarks = Vec::new();
    for (layer, TransferFile { path, name, function }) in transfer_files(scene) {
        let subject = layer.map_or(of_expression, |layer| subjects[layer]);
        let Some(subject) = subject.filter(|_| function.is_none()) else { continue };
        let imported = file::read(&read_text(path)?, name.as_deref(), &subject)
            .map_err(|source| SceneFileError::Transfer { path: path.clone(), source })?;
        remarks.extend(imported.remarks.iter().map(|remark| format!("{}: {remark}", path.display())));
        *function = Some(imported.transfer.into());
    }
    Ok(remarks)
}

/// The subject for a layer's transfer function; `None` if the layer's volume or channel does not exist.
pub fn subject(scene: &Scene, layer: usize, volumes: &[VolumeSource]) -> Option<Subject> {
    let (volume, channel) = (volumes.get(scene.store(layer))?, scene.layers[layer].channel);
    (channel < volume.source.channels()).then(|| volume.subject(channel))
}

/// The subject for the expression's transfer function: the expression's first volume, with the window of its value.
fn expression_subject(scene: &Scene, layers: &[Option<Subject>]) -> Option<Subject> {
    let expression = Expression::parse(&scene.expression.as_ref()?.text, layers.len()).ok()?;
    let windows: Vec<_> = layers.iter().map(|subject| Some(subject.as_ref()?.window)).collect::<Option<_>>()?;
    let first = layers[*expression.volumes().first()?]?;
    let window = shown_window(expression.window(windows.into_iter()));
    Some(Subject { is_labels: false, ..first.in_window(window) })
}

/// The transfer functions' files, each with its layer; `None` is the expression's.
fn transfer_files(scene: &mut Scene) -> impl Iterator<Item = (Option<usize>, &mut TransferFile)> {
    let layers = scene.layers.iter_mut().enumerate().map(|(i, layer)| (Some(i), layer.transfer.as_mut()));
    let expression = scene.expression.iter_mut().map(|expression| (None, expression.transfer.as_mut()));
    layers.chain(expression).filter_map(|(layer, choice)| match choice {
        Some(TransferChoice::File(file)) => Some((layer, file)),
        _ => None,
    })
}
