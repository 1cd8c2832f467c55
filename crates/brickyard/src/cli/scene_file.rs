//! Scene files, and the files that scenes name: meshes and transfer functions, which are read once, before anything is shown.

use super::failure::Failure;
use super::text_file::read_text;
use brickyard::import::read_mesh;
use brickyard::store::Store;
use brickyard::volume::transfer::file;
use brickyard::volume::{Expression, Extent, Scene, Subject, TransferChoice, TransferFile};
use std::path::Path;
use std::sync::Arc;

/// The scene in a file; others are named as seen from its folder.
pub(super) fn read(path: &Path) -> Result<Scene, Failure> {
    let mut scene: Scene = serde_json::from_str(&read_text(path)?)
        .map_err(|error| Failure::bad_input(format!("{}: not a scene: {error}", path.display())))?;
    for look in &mut scene.meshes {
        look.path = path.with_file_name(&look.path);
    }
    transfer_files(&mut scene).for_each(|(_, file)| file.path = path.with_file_name(&file.path));
    Ok(scene)
}

/// Reads the meshes.
pub(super) fn read_meshes(scene: &mut Scene) -> Result<(), Failure> {
    for look in &mut scene.meshes {
        look.mesh = Some(Arc::new(read_mesh(&look.path).map_err(Failure::bad_input)?));
    }
    Ok(())
}

/// Reads the transfer functions, for the stores that they are to show, and says what was left out or chosen. What is for a store that does
/// not exist is left alone.
pub(super) fn read_transfers(scene: &mut Scene, stores: &[Store]) -> Result<(), Failure> {
    let subjects: Vec<_> = (0..scene.layers.len()).map(|layer| subject(scene, layer, stores)).collect();
    let of_expression = expression_subject(scene, stores, &subjects);
    for (layer, TransferFile { path, name, function }) in transfer_files(scene) {
        let Some(subject) = layer.map_or(of_expression, |layer| subjects[layer]) else { continue };
        let imported = file::read(&read_text(path)?, name.as_deref(), &subject)
            .map_err(|error| Failure::bad_input(format!("{}: {error}", path.display())))?;
        for remark in imported.remarks {
            eprintln!("note: {}: {remark}", path.display());
        }
        *function = Some(imported.transfer.into());
    }
    Ok(())
}

/// The subject that a layer's transfer function is fitted to; `None` if there is no such store or channel.
pub(super) fn subject(scene: &Scene, layer: usize, stores: &[Store]) -> Option<Subject> {
    let (store, channel) = (stores.get(scene.store(layer))?, scene.layers[layer].channel);
    let of = |channel| Subject::new(store.geometry(), extent(store), store.default_window(channel));
    (channel < store.channels()).then(|| of(channel))
}

/// What the expression's value is to its transfer function, if it can be shown.
fn expression_subject(scene: &Scene, stores: &[Store], layers: &[Option<Subject>]) -> Option<Subject> {
    let expression = Expression::parse(&scene.expression.as_ref()?.text, layers.len()).ok()?;
    let windows: Vec<_> = layers.iter().map(|subject| Some(subject.as_ref()?.window)).collect::<Option<_>>()?;
    let first = &stores[scene.store(*expression.volumes().first()?)];
    Some(Subject::new(first.geometry(), extent(first), expression.window(windows.into_iter())))
}

/// The files with transfer functions, of layers by their places and of the expression.
fn transfer_files(scene: &mut Scene) -> impl Iterator<Item = (Option<usize>, &mut TransferFile)> {
    let layers = scene.layers.iter_mut().enumerate().map(|(i, layer)| (Some(i), layer.transfer.as_mut()));
    let expression = scene.expression.iter_mut().map(|expression| (None, expression.transfer.as_mut()));
    layers.chain(expression).filter_map(|(layer, choice)| match choice {
        Some(TransferChoice::File(file)) => Some((layer, file)),
        _ => None,
    })
}

pub(super) fn extent(store: &Store) -> Extent {
    store.pyramid().levels()[0].extent
}
