//! The choice of an image or array: the one that the caller names, or the only one. Costs the documents on the way, and those of all images where one
//! is missing.

use super::array::Array;
use super::collection::{Collection, collect, labels_in, labels_of, paths_in_words};
use super::field::{Field, Ome};
use super::gathered;
use super::image_label::FOLDER;
use super::multiscales::Multiscale;
use super::node::{Group, Node, open_node};
use super::paths::{in_words, inside};
use crate::array_choice::{Listed, ambiguous, no_such, none, several};
use crate::error::{ImportError, Result};
use crate::files::name_of;
use crate::note::{Note, Setting};
use crate::variable::MARK;
use brickyard_objects::is_address;
use std::path::{Path, PathBuf};

/// Images whose shapes are told in a message; more are counted.
const MOST_OPENED: usize = 40;

/// The image or array to be read.
pub(super) enum Target {
    /// A level of an image.
    Image(ImageTarget),
    /// An array of no image.
    Array(Box<Array>),
}

/// A level of an image.
pub(super) struct ImageTarget {
    pub(super) group: Group,
    pub(super) multiscale: Multiscale,
    /// Number of the level, 0 the finest.
    pub(super) level: usize,
    /// Whether the group around lists it as labels.
    pub(super) is_listed: bool,
}

/// Chooses in a store.
///
/// # Errors
/// If there is nothing of the name, or without one several images; or if a document is damaged.
pub(super) fn choose(root: &Path, name: Option<&str>) -> Result<(Target, Vec<Note>)> {
    let missing =
        || ImportError::invalid(root, "a folder without a readable Zarr document (zarr.json, .zgroup or .zarray)");
    gathered::know(root);
    let node = open_node(root)?.ok_or_else(missing)?;
    let Some(name) = name else { return only(root, node) };
    let path = inside(name.trim_start_matches('/')).map_err(|expected| {
        ImportError::options(root, format!("`variable` {name}: expected {expected}, from the store's folder on"))
    })?;
    let named = root.join(&path);
    if (is_address(&named) || named.is_dir())
        && let Some(node) = open_node(&named)?
    {
        return only(&named, node);
    }
    let Node::Group(group) = node else { return Err(no_such(root, name, Vec::new(), "")) };
    let found = all_in(&group)?;
    let is_named = |other: &&PathBuf| path.file_name().is_some() && other.ends_with(&path);
    match &found.iter().filter(is_named).cloned().collect::<Vec<_>>()[..] {
        [] => Err(no_such(root, name, described(root, &found), "")),
        [one] => match open_node(&root.join(one))? {
            Some(node) => only(&root.join(one), node),
            None => Err(no_such(root, name, described(root, &found), "")),
        },
        more => Err(ambiguous(root, name, &described(root, more))),
    }
}

/// An image or array to be chosen among several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The path that names it as an input: `FOLDER::PATH`, or the folder.
    pub path: PathBuf,
    /// Its place in the store, shape and type.
    pub words: String,
}

/// The images and arrays of a folder of Zarr to choose from: an image and the labels beside it, or all in a group without an image of its own. None where
/// there is no choice. Costs their documents.
///
/// # Errors
/// If a document is damaged.
pub fn choices(folder: &Path) -> Result<Vec<Choice>, ImportError> {
    gathered::know(folder);
    let Some(Node::Group(group)) = open_node(folder)? else { return Ok(Vec::new()) };
    let is_image = Multiscale::of(&Ome::of(&group))?.is_some();
    let paths = if is_image { labels_of(&group)? } else { collect(&group)?.paths };
    let inner = described(folder, &paths).into_iter().map(|listed| {
        let mut path = folder.as_os_str().to_owned();
        path.push(MARK);
        path.push(&listed.path);
        Choice { path: path.into(), words: listed.describe() }
    });
    let own = is_image.then(|| Choice { path: folder.to_owned(), words: "the image".into() });
    let all: Vec<Choice> = own.into_iter().chain(inner).collect();
    Ok(if all.len() > 1 { all } else { Vec::new() })
}

/// Images and arrays in a group, and labels beside an image.
fn all_in(group: &Group) -> Result<Vec<PathBuf>> {
    let ome = Ome::of(group);
    match Multiscale::of(&ome)? {
        Some(multiscale) => {
            let levels = multiscale.levels.iter().filter_map(|level| inside(&level.path).ok());
            Ok(levels.chain(labels_of(group)?).collect())
        }
        None => Ok(collect(group)?.paths),
    }
}

/// The node itself, or the only image or array in it.
fn only(path: &Path, node: Node) -> Result<(Target, Vec<Note>)> {
    let group = match node {
        Node::Array(array) => {
            let target = match image_around(&array)? {
                Some(image) => Target::Image(image),
                None => Target::Array(Box::new(array)),
            };
            return Ok((target, Vec::new()));
        }
        Node::Group(group) => group,
    };
    if let Some(multiscale) = Multiscale::of(&Ome::of(&group))? {
        let mut notes = Vec::new();
        let labels = labels_of(&group).unwrap_or_else(|damage| {
            notes.push(Note::warning(format!("The image's labels are not read: {damage}.")));
            Vec::new()
        });
        if let Some(first) = labels.first() {
            notes.push(Note::new(format!(
                "The image's labels are volumes of their own: {} (as {}::{}).",
                paths_in_words(&labels),
                name_of(path),
                in_words(first)
            )));
        }
        notes.extend(in_scene(group.path())?);
        let is_listed = is_listed(group.path())?;
        return Ok((Target::Image(ImageTarget { group, multiscale, level: 0, is_listed }), notes));
    }
    let Collection { paths, damage } = collect(&group)?;
    match (&paths[..], damage) {
        ([one], _) => {
            let inner = path.join(one);
            let node = open_node(&inner)?;
            let missing = || ImportError::invalid(&inner, "is listed as an image, but there is no Zarr document");
            let (target, mut notes) = only(&inner, node.ok_or_else(missing)?)?;
            notes.insert(0, Note::new(format!("{} is read, the only volume in {}.", in_words(one), name_of(path))));
            Ok((target, notes))
        }
        ([], Some(damage)) => Err(damage),
        ([], None) => Err(none(path, &[], "")),
        (more, _) => Err(several(path, &described(path, more), "")),
    }
}

/// Whether a group of labels around lists this one.
fn is_listed(folder: &Path) -> Result<bool> {
    let folder = absolute(folder)?;
    for around in around(&folder).take(2) {
        let Ok(Some(Node::Group(group))) = open_node(around) else { continue };
        let labels = labels_in(&Ome::of(&group)).unwrap_or_default();
        if labels.iter().any(|path| around.join(path) == folder) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// A path from the root on; an address as it is.
fn absolute(path: &Path) -> Result<PathBuf> {
    if is_address(path) { Ok(path.to_owned()) } else { std::path::absolute(path).map_err(ImportError::io(path)) }
}

/// The folders around one; at an address none, but for those around labels: each look costs a round trip.
fn around(folder: &Path) -> impl Iterator<Item = &Path> {
    let is_near = !is_address(folder) || folder.ancestors().skip(1).take(2).any(|around| around.ends_with(FOLDER));
    folder.ancestors().skip(1).filter(move |_| is_near)
}

/// A warning of an image that a scene around it places.
fn in_scene(folder: &Path) -> Result<Option<Note>> {
    let folder = absolute(folder)?;
    for around in around(&folder).take(2) {
        let Ok(Some(Node::Group(group))) = open_node(around) else { continue };
        let ome = Ome::of(&group);
        let Some(list) = ome.get("scene").and_then(|scene| scene.get("coordinateTransformations")) else { continue };
        let is_it = |path: &str| inside(path).is_ok_and(|path| around.join(path) == folder);
        let is_end = |item: &Field<'_>, end: &str| {
            let path = item.get(end).and_then(|end| end.get("path"));
            path.and_then(|path| path.as_text()).is_some_and(is_it)
        };
        let items = list.items("").unwrap_or_default();
        if items.iter().any(|item| is_end(item, "input") || is_end(item, "output")) {
            let note = format!("The image's place in the scene around it ({}) is not read.", list.at());
            return Ok(Some(Note::warning(note).settled_by(Setting::Place)));
        }
    }
    Ok(None)
}

/// The image of which an array is a level; `None` if it is of none.
fn image_around(array: &Array) -> Result<Option<ImageTarget>> {
    /// Most folders from an image to its levels.
    const MOST_FOLDERS: usize = 3;
    let folder = absolute(array.path())?;
    for around in folder.ancestors().skip(1).take(MOST_FOLDERS) {
        let Ok(Some(Node::Group(group))) = open_node(around) else { continue };
        let is_it = |path: &str| inside(path).is_ok_and(|path| around.join(path) == folder);
        if let Some((multiscale, level)) = Multiscale::with_level(&Ome::of(&group), &is_it)? {
            let is_listed = is_listed(group.path())?;
            return Ok(Some(ImageTarget { group, multiscale, level, is_listed }));
        }
    }
    Ok(None)
}

/// Images and arrays with their shapes and types.
fn described(root: &Path, paths: &[PathBuf]) -> Vec<Listed> {
    let describe = |(number, path): (usize, &PathBuf)| {
        let opened = if number < MOST_OPENED { first_array(&root.join(path)) } else { None };
        let (shape, element) = match &opened {
            Some(array) => (array.shape().to_vec(), array.element().name().to_owned()),
            None if number < MOST_OPENED => (Vec::new(), "not readable".into()),
            None => (Vec::new(), "not looked at".into()),
        };
        Listed { path: in_words(path), shape, element }
    };
    paths.iter().enumerate().map(describe).collect()
}

/// The array at a path, or the finest level of the image there.
fn first_array(path: &Path) -> Option<Array> {
    match open_node(path).ok()?? {
        Node::Array(array) => Some(array),
        Node::Group(group) => {
            let multiscale = Multiscale::of(&Ome::of(&group)).ok()??;
            match open_node(&path.join(inside(&multiscale.levels.first()?.path).ok()?)).ok()?? {
                Node::Array(array) => Some(array),
                Node::Group(_) => None,
            }
        }
    }
}
