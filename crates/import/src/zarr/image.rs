//! An image of OME-Zarr: its levels as sources, the finest first, each with its place in the finest. Costs the documents, and what each level's array
//! holds open.

use super::array::Array;
use super::choice::{ImageTarget, Target, choose};
use super::document::Document;
use super::documents::Documents;
use super::field::{Ome, attributes_file};
use super::image_axes::arrange;
use super::image_label;
use super::kept_chunks::KeptChunks;
use super::multiscales::{Level, Multiscale};
use super::node::{Node, ZarrVersion, open_node};
use super::omero;
use super::own::Own;
use super::paths::inside;
use super::place::{Placed, place};
use super::plain;
use super::presentation::presentation;
use super::source::{Layout, Opening, Reading, ZarrSource};
use crate::axes::Axis;
use crate::direct::direct;
use crate::element::Element;
use crate::error::{ImportError, Result};
use crate::image::{Image, ImageLevel, Presentation};
use crate::labels::SaidKind;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::SourceInfo;
use crate::variable::split_choice;
use brickyard_objects::is_address;
use brickyard_volume::{Extent, VoxelType};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Opens an image of OME-Zarr, or an array, in a folder of Zarr 2 or 3, to read bricks of it: `FOLDER::PATH` names one of several. 64-bit integers are
/// checked as they are read, against the 32 bits that hold them.
///
/// # Errors
/// If there is no image, or several and none is named; or if a document is damaged.
pub fn open_image(path: &Path) -> Result<Image, ImportError> {
    let (folder, variable) = split_choice(path);
    let mut options = OpenOptions { variable, is_looked_at: true, ..OpenOptions::default() };
    let (target, notes) = choose(&folder, options.variable.as_deref())?;
    let kept = KeptChunks::default();
    let reading = Reading::Bricks(&kept);
    let image = match target {
        Target::Array(array) => {
            let folder = array.path().to_owned();
            let source = plain::open(*array, notes, &options, reading)?.into();
            let levels = vec![ImageLevel { source, factor: DVec3::ONE, folder }];
            return Ok(Image { levels, presentation: Presentation::default() });
        }
        Target::Image(image) => image,
    };
    look_ahead(&image);
    let finest = LevelArray::open(&image, image.level, &options)?;
    let kind = image_label::kind_of(&Ome::of(&image.group), image.is_listed, VoxelType::U32);
    // No label is below 0 as a rule, and one that is will be refused.
    options.to_voxel_type = (kind.are_labels() && finest.array.element() == Element::I64).then_some(VoxelType::U32);
    let sizes = finest.layout.sizes();
    let mut notes: Vec<Note> = notes.into_iter().chain(finer_than(&image, &finest, &options)).collect();
    let mut coarser = Vec::new();
    for number in image.level + 1..image.multiscale.levels.len() {
        match coarser_level(&image, number, &finest, reading, &options) {
            Ok(level) => coarser.push(level),
            Err(error) => notes.push(Note::warning(format!("Level {number} is left out: {error}."))),
        }
    }
    let folder = finest.array.path().to_owned();
    let source = Arc::new(finest.source(&image, notes, &options, reading)?);
    let levels = [ImageLevel { source, factor: DVec3::ONE, folder }].into_iter().chain(coarser).collect();
    Ok(Image { levels, presentation: presentation(&image.group, sizes.channels) })
}

/// Reads the documents of all levels at an address at once, in the version of their group. One found in Zarr 2 has none in Zarr 3.
fn look_ahead(image: &ImageTarget) {
    let (group, levels) = (image.group.path(), &image.multiscale.levels);
    let names: &[&str] = match image.group.version() {
        ZarrVersion::V3 => &["zarr.json"],
        ZarrVersion::V2 => &[".zarray", ".zattrs"],
    };
    let of_level = |level: &Level| names.iter().map(|name| format!("{}/{name}", level.path)).collect::<Vec<_>>();
    Document::look_ahead(group, &levels.iter().flat_map(of_level).collect::<Vec<_>>());
    if image.group.version() == ZarrVersion::V2 && is_address(group) {
        for folder in levels.iter().filter_map(|level| Some(group.join(inside(&level.path).ok()?))) {
            if let Some(array) = Document::object(&folder.join(".zarray")) {
                Document::know(&folder.join("zarr.json"), None, &array.version);
            }
        }
    }
}

/// Opens a coarser level of an image, as bricks are read from it.
///
/// # Errors
/// If it cannot be read, has other channels or steps, or no chunk where the finest has some.
fn coarser_level(
    image: &ImageTarget,
    number: usize,
    finest: &LevelArray,
    reading: Reading<'_>,
    options: &OpenOptions,
) -> Result<ImageLevel> {
    let opened = LevelArray::open(image, number, options)?;
    let (found, sizes) = (opened.layout.sizes(), finest.layout.sizes());
    if (found.channels, found.times) != (sizes.channels, sizes.times) {
        return Err(opened.invalid(image, "a level of as many channels and time steps as the finest"));
    }
    if finest.array.has_any_chunk()? && !opened.array.has_any_chunk()? {
        return Err(opened.invalid(image, "a level with chunks, as the finest has"));
    }
    let Relation { factor, .. } = relation(image, finest, &opened);
    let folder = opened.array.path().to_owned();
    let source = Arc::new(opened.source(image, Vec::new(), options, reading)?);
    Ok(ImageLevel { source, factor, folder })
}

/// Opens one level of an image.
pub(super) fn open_level(image: &ImageTarget, notes: Vec<Note>, options: &OpenOptions) -> Result<ZarrSource> {
    let opened = LevelArray::open(image, image.level, options)?;
    let notes = notes.into_iter().chain(finer_than(image, &opened, options)).collect();
    opened.source(image, notes, options, Reading::Whole)
}

/// A warning of a later level with more voxels: the document should have the finest first.
fn finer_than(image: &ImageTarget, opened: &LevelArray, options: &OpenOptions) -> Option<Note> {
    let extent = |level: &LevelArray| level.layout.sizes().extent.to_array();
    let own = extent(opened);
    let finer = (image.level + 1..image.multiscale.levels.len()).find(|level| {
        // Levels that are not read may be missing.
        let other = LevelArray::open(image, *level, options);
        other.is_ok_and(|other| extent(&other).iter().zip(own).any(|(size, own)| *size > own))
    })?;
    let Level { path, at, .. } = &image.multiscale.levels[finer];
    Some(Note::warning(format!("{at}: the level {path} has more voxels than the one read: name it to read it.")))
}

/// The place of a level in a finer one.
struct Relation {
    factor: DVec3,
    first_centre: DVec3,
}

impl Relation {
    /// The place by both levels' maps; `None` where these do not tell it.
    fn of_maps(finer: &Level, coarser: &Level, letters: &[Option<Axis>]) -> Option<Self> {
        let (finer, coarser) = (finer.map.as_ref()?, coarser.map.as_ref()?);
        let mut relation = Self { factor: DVec3::ONE, first_centre: DVec3::ZERO };
        for (at, axis) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
            let Some(place) = letters.iter().position(|letter| *letter == Some(axis)) else { continue };
            let spacing = finer.factor(place, place);
            relation.factor[at] = coarser.factor(place, place) / spacing;
            relation.first_centre[at] = (coarser.offset(place) - finer.offset(place)) / spacing;
        }
        let is_sound = relation.factor.is_finite() && relation.factor.min_element() > 0.0;
        (is_sound && relation.first_centre.is_finite()).then_some(relation)
    }

    /// The place by both levels' sizes: coarse voxels are means of whole finer ones, where the sizes allow it.
    fn of_sizes(finer: Extent, coarser: Extent) -> Self {
        let factor = |at: usize| {
            let [fine, coarse] = [finer, coarser].map(|extent| extent.to_array()[at]);
            let ratio = f64::from(fine) / f64::from(coarse);
            let whole = ratio.round().max(1.0);
            let is_whole =
                [(f64::from(fine) / whole).floor(), (f64::from(fine) / whole).ceil()].contains(&coarse.into());
            if is_whole { whole } else { ratio }
        };
        let factor = DVec3::from_array([0, 1, 2].map(factor));
        Self { factor, first_centre: (factor - 1.0) / 2.0 }
    }
}

fn relation(image: &ImageTarget, finer: &LevelArray, coarser: &LevelArray) -> Relation {
    let levels = &image.multiscale.levels;
    let of_maps = Relation::of_maps(&levels[finer.level], &levels[coarser.level], &finer.letters);
    of_maps.unwrap_or_else(|| Relation::of_sizes(finer.layout.sizes().extent, coarser.layout.sizes().extent))
}

/// The array of a level.
struct LevelArray {
    level: usize,
    array: Array,
    letters: Vec<Option<Axis>>,
    layout: Layout,
}

impl LevelArray {
    fn open(image: &ImageTarget, level: usize, options: &OpenOptions) -> Result<Self> {
        let Level { path, at, .. } = &image.multiscale.levels[level];
        let document = attributes_file(image.group.path(), image.group.version());
        let refuse =
            |expected: &str| ImportError::invalid(&document, format!("{at}: expected {expected}, found {path:?}"));
        let folder = image.group.path().join(inside(path).map_err(refuse)?);
        let Some(Node::Array(array)) = open_node(&folder)? else {
            return Err(refuse("the path of an array in the image's folder"));
        };
        let axes = &image.multiscale.axes;
        if axes.len() != array.shape().len() {
            let shape = array.shape();
            return Err(refuse(&format!("an array of as many axes as the image, {}, not of {shape:?}", axes.len())));
        }
        let letters = arrange(axes, array.shape(), options.axes.as_ref());
        let letters = letters.map_err(|problem| ImportError::options(&document, problem))?;
        let layout = Layout::of(&array, letters.clone()).map_err(|problem| ImportError::invalid(&folder, problem))?;
        let times = Own::of(&image.group).and_then(|own| own.times());
        let layout = times.into_iter().fold(layout, Layout::with_times);
        Ok(Self { level, array, letters, layout })
    }

    fn invalid(&self, image: &ImageTarget, expected: &str) -> ImportError {
        let document = attributes_file(image.group.path(), image.group.version());
        let Level { path, at, .. } = &image.multiscale.levels[self.level];
        ImportError::invalid(
            &document,
            format!("{at}: expected {expected}, found {path:?} of {:?}", self.array.shape()),
        )
    }

    /// Describes the level, and opens it.
    fn source(
        self,
        image: &ImageTarget,
        notes: Vec<Note>,
        options: &OpenOptions,
        reading: Reading<'_>,
    ) -> Result<ZarrSource> {
        let Self { level, array, letters, layout } = self;
        let ImageTarget { group, multiscale, is_listed, .. } = image;
        let ome = Ome::of(group);
        let own = Own::of(group);
        let mut info = SourceInfo::plain(layout.sizes(), layout.element().voxel_type());
        info.kind = image_label::kind_of(&ome, *is_listed, info.voxel_type);
        if let (SaidKind::Unsaid, Some(kind)) = (info.kind, own.as_ref().and_then(Own::kind)) {
            info.kind = kind;
        }
        let options = options.heeding(info.kind);
        let layout = layout.clone().with_decode(direct(layout.decode(), None, &options));
        info.voxel_type = layout.decode().voxel_type();
        info.notes = notes;
        info.notes.extend(multiscale.notes.iter().cloned());
        info.notes.extend(dropped(multiscale, &letters));
        let maps = [level, 0].map(|level| multiscale.levels[level].map.as_ref());
        let placed = Placed {
            axes: &multiscale.axes,
            letters: &letters,
            map: maps[0],
            finest: maps[1],
            systems: &multiscale.systems,
        };
        let step_time = place(&placed, &mut info);
        if info.kind.are_labels() {
            info.notes.extend(image_label::left_out(&ome, reading.is_by_bricks()));
        } else {
            info.channel_looks = omero::looks(&ome, info.channels, &mut info.notes);
        }
        if let Some(own) = own {
            own.describe(&mut info);
            if let Some(value) = array.attributes().get("_FillValue").and_then(serde_json::Value::as_f64) {
                info.set_nodata(value, "_FillValue");
            }
            let levels = &multiscale.levels;
            let relation = (level > 0).then(|| Relation::of_maps(&levels[0], &levels[level], &letters)).flatten();
            if let (Some(orientation), Some(Relation { factor, first_centre })) = (info.orientation, relation) {
                info.orientation = orientation.strided(factor, first_centre).ok();
            }
        }
        let documents = Documents::of(Some(group), &array)?;
        info.identity = documents.identity(&letters)?;
        Opening { array, layout, info, step_time, documents, reading }.open(&options)
    }
}

/// A note on axes of one element that are none of a volume's.
fn dropped(multiscale: &Multiscale, letters: &[Option<Axis>]) -> Option<Note> {
    let unknown = multiscale.axes.iter().zip(letters).filter(|(_, letter)| letter.is_none());
    let names: Vec<&str> = unknown.map(|(axis, _)| axis.name.as_str()).collect();
    (!names.is_empty()).then(|| Note::new(format!("Axes of one element are left out: {}.", names.join(", "))))
}
