//! Images and arrays in a group that is none itself: fields of a plate's wells, series, labels, or whatever its folders hold. Costs a document
//! for each.

use super::field::{Field, Ome};
use super::gathered;
use super::image_label;
use super::node::{Group, Node, open_node};
use super::paths::{in_words, inside};
use crate::array_choice::is_shape_of_volume;
use crate::cf::helpers_of;
use crate::error::{ImportError, Result};
use crate::file_order::in_natural_order;
use crate::files::{listed, name_of};
use brickyard_objects::at;
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};

/// Most images, wells and nodes looked at.
const MOST_NODES: usize = 20_000;
/// Most folders within one another.
const DEEPEST: usize = 5;

/// Images and arrays, and the first node among them that cannot be read.
#[derive(Default)]
pub(super) struct Collection {
    /// Paths from the group on.
    pub(super) paths: Vec<PathBuf>,
    pub(super) damage: Option<ImportError>,
}

impl Collection {
    /// Each path once: documents may list one twice.
    fn once(mut paths: Vec<PathBuf>) -> Self {
        let mut seen = HashSet::new();
        paths.retain(|path| seen.insert(path.clone()));
        Self { paths, damage: None }
    }
}

/// Finds the images and arrays of a group.
///
/// # Errors
/// If a document is damaged.
pub(super) fn collect(group: &Group) -> Result<Collection> {
    let ome = Ome::of(group);
    // Groups of others may have attributes of these names.
    let has = |name: &str| ome.get(name).is_some_and(|field| field.as_object().is_some());
    if has("plate") {
        return fields(group, &ome);
    }
    if has("well") {
        return Ok(Collection::once(images_of(&ome)?));
    }
    if let Some(series) = series(group, &ome)? {
        return Ok(Collection::once(series));
    }
    let labels = labels_in(&ome).unwrap_or_default();
    if !labels.is_empty() {
        return Ok(Collection::once(labels));
    }
    let gathered = gathered::nodes(group.path());
    let mut walk = Walk { root: group.path(), gathered, found: Collection::default(), helpers: Vec::new(), seen: 0 };
    walk.helpers.extend(helpers_of(group.attributes()));
    walk.visit(Path::new(""), 0)?;
    let Walk { mut found, helpers, .. } = walk;
    found.paths.retain(|path| !helpers.contains(&name_of(path)));
    Ok(found)
}

/// Paths of the labels that a group of labels lists.
///
/// # Errors
/// If the list is damaged.
pub(super) fn labels_in(ome: &Ome<'_>) -> Result<Vec<PathBuf>> {
    let Some(list) = ome.get("labels") else { return Ok(Vec::new()) };
    let path = |item: &Field<'_>| {
        let text = item.text("the path of an image of labels")?;
        inside(text).map_err(|expected| item.invalid(expected))
    };
    list.items("a list of labels")?.iter().map(path).collect()
}

/// Fields of all wells of a plate.
fn fields(group: &Group, ome: &Ome<'_>) -> Result<Collection> {
    let mut found = Vec::new();
    let Some(plate) = ome.get("plate") else { return Ok(Collection::default()) };
    let wells = plate.need("wells", "a list of wells")?;
    let items = wells.items("a list of wells")?;
    if items.len() > MOST_NODES {
        return Err(wells.invalid(&format!("at most {MOST_NODES} wells")));
    }
    for item in items {
        let path = item.need("path", "the path of a well")?;
        let well = inside(path.text("the path of a well")?).map_err(|expected| path.invalid(expected))?;
        // Wells may not have been written yet.
        let Some(Node::Group(node)) = open_node(&group.path().join(&well))? else { continue };
        found.extend(images_of(&Ome::of(&node))?.into_iter().map(|image| well.join(image)));
        if found.len() > MOST_NODES {
            return Err(wells.invalid(&format!("at most {MOST_NODES} images")));
        }
    }
    Ok(Collection::once(found))
}

/// Fields of a well.
fn images_of(ome: &Ome<'_>) -> Result<Vec<PathBuf>> {
    let Some(well) = ome.get("well") else { return Ok(Vec::new()) };
    let mut paths = Vec::new();
    for item in well.need("images", "a list of images")?.items("a list of images")? {
        let path = item.need("path", "the path of an image")?;
        paths.push(inside(path.text("the path of an image")?).map_err(|expected| path.invalid(expected))?);
    }
    Ok(paths)
}

/// Images in the layout of bioformats2raw: those that the group `OME` lists, or counted from 0. `None` in another layout.
fn series(group: &Group, ome: &Ome<'_>) -> Result<Option<Vec<PathBuf>>> {
    let told = open_node(&group.path().join("OME"))?;
    if let Some(Node::Group(told)) = &told
        && let Some(list) = Ome::of(told).get("series")
    {
        let path =
            |item: &Field<'_>| inside(item.text("the path of an image")?).map_err(|expected| item.invalid(expected));
        return list.items("a list of images")?.iter().map(path).collect::<Result<_>>().map(Some);
    }
    if ome.get("bioformats2raw.layout").is_none() {
        return Ok(None);
    }
    let mut paths = Vec::new();
    while paths.len() < MOST_NODES && open_node(&group.path().join(paths.len().to_string()))?.is_some() {
        paths.push(paths.len().to_string().into());
    }
    Ok(Some(paths))
}

/// A walk through the folders of a group.
struct Walk<'a> {
    root: &'a Path,
    /// Paths of all nodes from the root on, if a document tells them.
    gathered: Option<BTreeSet<PathBuf>>,
    found: Collection,
    /// Names of coordinates and bounds.
    helpers: Vec<String>,
    seen: usize,
}

impl Walk<'_> {
    fn visit(&mut self, at: &Path, depth: usize) -> Result<()> {
        let folders = match &self.gathered {
            Some(nodes) => {
                // A folder's nodes follow it in the order of paths.
                let below = nodes.range(at.to_owned()..).map_while(|node| node.strip_prefix(at).ok());
                let inside = below.filter_map(|node| node.components().next());
                let names: BTreeSet<_> = inside.collect();
                names.into_iter().map(|name| self.root.join(at).join(name)).collect()
            }
            None => folders_in(&self.root.join(at))?,
        };
        for folder in in_natural_order(&folders) {
            self.seen += 1;
            if self.seen > MOST_NODES {
                return Ok(());
            }
            let path = at.join(name_of(&folder));
            match open_node(&folder) {
                Ok(Some(Node::Array(array))) => {
                    self.helpers.extend(helpers_of(array.attributes()));
                    if is_shape_of_volume(array.shape()) {
                        self.found.paths.push(path);
                    }
                }
                Ok(Some(Node::Group(group))) => {
                    let is_image = Ome::of(&group).get("multiscales").is_some();
                    match is_image {
                        true => self.found.paths.push(path),
                        false if depth < DEEPEST => self.visit(&path, depth + 1)?,
                        false => {}
                    }
                }
                Ok(None) => {}
                Err(damage) => {
                    self.found.damage.get_or_insert(damage);
                }
            }
        }
        Ok(())
    }
}

/// The folders in a folder.
fn folders_in(folder: &Path) -> Result<Vec<PathBuf>> {
    match at(folder).map_err(ImportError::io(folder))? {
        None => Ok(listed(folder)?.into_iter().filter(|path| path.is_dir()).collect()),
        Some(place) => {
            let names = place.objects.folders(&place.name).map_err(ImportError::io(folder))?;
            Ok(names.into_iter().filter(|name| !name.starts_with('.')).map(|name| folder.join(name)).collect())
        }
    }
}

/// Label images beside an image, from its group on.
pub(super) fn labels_of(group: &Group) -> Result<Vec<PathBuf>> {
    let Some(Node::Group(labels)) = open_node(&group.path().join(image_label::FOLDER))? else { return Ok(Vec::new()) };
    Ok(labels_in(&Ome::of(&labels))?.iter().map(|path| Path::new(image_label::FOLDER).join(path)).collect())
}

/// Paths for a message.
pub(super) fn paths_in_words(paths: &[PathBuf]) -> String {
    paths.iter().map(|path| in_words(path)).collect::<Vec<_>>().join(", ")
}
