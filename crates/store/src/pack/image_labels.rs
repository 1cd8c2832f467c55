//! Labels of an OME-Zarr image: stores in its folder `labels`, and the document there with their names, by which other
//! programs find them.
//!
//! A store's name joins the document once the store is whole, by one replacement under the folder's lock; all else in
//! it stays. Costs the reading of a few small documents.

use super::disk::{Disk, DiskError};
use super::lock::DirLock;
use super::{PackError, document_bytes};
use crate::error::OpenError;
use crate::folder::Folder;
use crate::inside::{check_outside, located, named};
use crate::json::read_json;
use crate::kind::Kind;
use crate::layout::{JOURNAL_NAME, LABELS_NAME};
use crate::ngff::{Ngff, in_version};
use brickyard_import::SourceInfo;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{Geometry, Orientation};
use glam::DVec3;
use serde_json::{Value, json};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// From a store of labels to its image, as `image-label` has it.
pub(crate) const TO_IMAGE: &str = "../../";

/// The place of a store, present or future, among an image's labels.
pub(crate) struct ImageLabels {
    image: PathBuf,
    /// The version of the image, and so of its labels: a hierarchy has one.
    ngff: Ngff,
    /// The image's folder `labels`, by the store's own path.
    folder: PathBuf,
    store: PathBuf,
}

impl ImageLabels {
    /// A store's place; `None` unless directly in the folder `labels` of an OME-Zarr image of a version of stores.
    pub(crate) fn around(store: &Path) -> Result<Option<Self>, DiskError> {
        let Some(image) = image_around(store) else { return Ok(None) };
        let Some(ngff) = root_of(&image)?.filter(is_image).as_ref().and_then(Ngff::of) else { return Ok(None) };
        let folder = named(store.parent().unwrap_or(Path::new(""))).to_path_buf();
        Ok(Some(Self { image, ngff, folder, store: store.into() }))
    }

    /// The version of a store here.
    ///
    /// # Errors
    /// If another one is asked for.
    pub(crate) fn ngff(&self, asked: Option<Ngff>) -> Result<Ngff, PackError> {
        match asked {
            Some(asked) if asked != self.ngff => {
                let (image, ngff) = (self.image.display(), self.ngff);
                let problem = format!(
                    "lies among the labels of {image}, of OME-Zarr {ngff}, and an image and its labels have one version: \
                     choose `ngff` {ngff}, or change that of the image first"
                );
                Err(PackError::Labels { path: self.store.clone(), problem })
            }
            _ => Ok(self.ngff),
        }
    }

    pub(crate) fn image(&self) -> &Path {
        &self.image
    }

    /// Refuses a store of another kind, and what stands in the way of a list with the store's name.
    pub(crate) fn check(&self, kind: Kind) -> Result<(), PackError> {
        check_outside(&self.image)?;
        if kind != Kind::Labels {
            let image = self.image.display();
            let problem = format!("lies among the labels of {image}: choose `kind` labels, or another output");
            return Err(PackError::Labels { path: self.store.clone(), problem });
        }
        self.name()?;
        self.document().map(drop)
    }

    /// Whether the list has the store's name.
    pub(crate) fn is_listed(&self) -> Result<bool, PackError> {
        let name = self.name()?;
        Ok(self.document()?.is_some_and(|document| names_in(&document).any(|listed| listed == name)))
    }

    /// Adds the store's name to the list, made if missing, unless it is there. The names there stay.
    pub(crate) fn list(&self, disk: &Disk) -> Result<(), PackError> {
        let name = self.name()?;
        let _lock = DirLock::take(disk, &self.folder)?;
        let document = self.document()?;
        let group = || json!({ "zarr_format": 3, "node_type": "group", "attributes": {} });
        let mut document = document.unwrap_or_else(group);
        if !names_in(&document).any(|listed| listed == name) {
            let names: Vec<&str> = names_in(&document).chain([name]).collect();
            let names = json!(names);
            let ome = &mut document["attributes"]["ome"];
            ome["labels"] = names;
            if ome["version"].is_null() {
                ome["version"] = json!(self.ngff.name());
            }
            disk.write(&list_path(&self.folder), &document_bytes(&document))?;
        }
        // Also of a name listed before, which the failure of an earlier run may have left to chance.
        Ok(disk.sync_dir(&self.folder)?)
    }

    fn name(&self) -> Result<&str, PackError> {
        let name = self.store.file_name().and_then(|name| name.to_str());
        name.ok_or_else(|| PackError::Labels {
            path: self.store.clone(),
            problem: "labels are listed by a name of UTF-8: choose another one".into(),
        })
    }

    /// The list; `None` if there is none.
    fn document(&self) -> Result<Option<Value>, PackError> {
        let folder = match Folder::open(&self.folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            folder => folder.map_err(|error| PackError::Io { path: self.folder.clone(), error })?,
        };
        list_in(&folder).map_err(|error| match error {
            OpenError::Io { path, error } => PackError::Io { path, error },
            error => PackError::Labels { path: self.store.clone(), problem: format!("cannot be listed: {error}") },
        })
    }

    /// Differences of a source from the image in shape and place, and copies of the image's documents without it.
    pub(crate) fn remarks(&self, source: &SourceInfo) -> Vec<String> {
        let image = self.image.display();
        let Ok(Some(root)) = root_of(&self.image) else { return Vec::new() };
        let mut remarks = Vec::new();
        match Frame::of(&self.image, &root) {
            Some(frame) => {
                let differences = frame.differences(source);
                if !differences.is_empty() {
                    let differences = differences.join("; ");
                    remarks.push(format!("The labels are not on the grid of the image {image}: {differences}."));
                }
            }
            None => remarks.push(format!("Shape and place of the image {image} are not readable, so not compared.")),
        }
        let has_copy = |root: &Value| !root["consolidated_metadata"].is_null();
        let list = self.document().ok().flatten();
        if has_copy(&root) || list.as_ref().is_some_and(has_copy) {
            remarks.push(format!(
                "{image} holds a copy of its metadata without these labels: consolidate it anew \
                 (zarr.consolidate_metadata)."
            ));
        }
        remarks
    }
}

/// The reason why a store in a folder `labels` of an image is not listed there, if it is not.
pub(crate) fn unlisted_reason(store: &Path) -> Option<String> {
    let image = image_around(store)?;
    let others = |version: &str| {
        let image = image.display();
        format!("{image} is an OME-Zarr image of version {version}, which takes no labels of 0.5 or 0.6")
    };
    let reason = match root_of(&image) {
        Ok(Some(root)) if is_image(&root) => match Ngff::of(&root) {
            Some(_) => return None,
            None => others(root["attributes"]["ome"]["version"].as_str().unwrap_or("unknown")),
        },
        _ if image.join(JOURNAL_NAME).exists() => format!("{} is not packed to its end", image.display()),
        _ => {
            let folder = Folder::open(&image).ok()?;
            let attributes = read_json(&folder, &image.join(".zattrs")).ok()?;
            others(attributes["multiscales"][0].as_object()?.get("version").and_then(Value::as_str).unwrap_or("0.4"))
        }
    };
    Some(format!("{}: is not listed among its image's labels: {reason}", store.display()))
}

/// The names of an image's labels.
pub(crate) fn names(image: &Path) -> Result<Vec<String>, OpenError> {
    let path = image.join(LABELS_NAME);
    let document = match Folder::open(&path) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => None,
        folder => list_in(&folder.map_err(|error| OpenError::Io { path, error })?)?,
    };
    Ok(document.iter().flat_map(names_in).map(str::to_owned).collect())
}

fn names_in(list: &Value) -> impl Iterator<Item = &str> {
    list["attributes"]["ome"]["labels"].as_array().into_iter().flatten().filter_map(Value::as_str)
}

fn list_path(folder: &Path) -> PathBuf {
    folder.join("zarr.json")
}

/// Reads the list in a folder of labels, if there is one, and checks its form.
fn list_in(folder: &Folder) -> Result<Option<Value>, OpenError> {
    let path = list_path(folder.path());
    let list = match read_json(folder, &path) {
        Err(OpenError::Io { error, .. }) if error.kind() == ErrorKind::NotFound => return Ok(None),
        list => list?,
    };
    let ome = &list["attributes"]["ome"];
    let is_group = list["zarr_format"] == 3 && list["node_type"] == "group";
    let are_names = |names: &Value| names.as_array().is_some_and(|names| names.iter().all(Value::is_string));
    for (field, value, is_right, expected) in [
        ("node_type", &list["node_type"], is_group, "a group of Zarr v3"),
        ("attributes", &list["attributes"], list["attributes"].is_object(), "an object"),
        ("attributes.ome", ome, ome.is_null() || ome.is_object(), "an object"),
        (
            "attributes.ome.labels",
            &ome["labels"],
            ome["labels"].is_null() || are_names(&ome["labels"]),
            "a list of names",
        ),
    ] {
        if !is_right {
            return Err(OpenError::invalid(&path, field, expected, value));
        }
    }
    Ok(Some(list))
}

/// The folder in whose folder `labels` a store is, or would be.
fn image_around(store: &Path) -> Option<PathBuf> {
    let place = located(store);
    let labels = place.parent().filter(|folder| folder.file_name() == Some(LABELS_NAME.as_ref()))?;
    Some(named(labels.parent()?).to_path_buf())
}

/// The root document of an image; `None` if there is none.
fn root_of(image: &Path) -> Result<Option<Value>, DiskError> {
    let is_absent = |error: &std::io::Error| matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory);
    let folder = match Folder::open(image) {
        Err(error) if is_absent(&error) => return Ok(None),
        folder => folder.map_err(|error| DiskError { path: image.into(), error })?,
    };
    match read_json(&folder, &image.join("zarr.json")) {
        Ok(root) => Ok(Some(root)),
        Err(OpenError::Io { path, error }) if !is_absent(&error) => Err(DiskError { path, error }),
        Err(_) => Ok(None),
    }
}

/// Whether a root document is an image's. Labels have none of their own.
fn is_image(root: &Value) -> bool {
    let ome = &root["attributes"]["ome"];
    let are_labels = !ome["image-label"].is_null() || root["attributes"]["brickyard"]["kind"] == json!(Kind::Labels);
    ome["multiscales"][0].is_object() && !are_labels
}

/// Shape and place of an image's level 0, along x, y, z.
struct Frame {
    extent: [u64; 3],
    times: u64,
    spacing: DVec3,
    origin: DVec3,
    units: [Option<String>; 3],
    /// In a patient; `None` where the image's program has no such thing.
    orientation: Option<Option<Orientation>>,
}

impl Frame {
    fn of(image: &Path, root: &Value) -> Option<Self> {
        let root = &in_version(&image.join("zarr.json"), root, Ngff::V05).ok()?;
        let multiscale = &root["attributes"]["ome"]["multiscales"][0];
        let axes = multiscale["axes"].as_array()?;
        let place = |name: &str| axes.iter().position(|axis| axis["name"] == name);
        let [x, y, z] = ["x", "y", "z"].map(place);
        let spatial = [x?, y?, z?];
        let dataset = &multiscale["datasets"][0];
        let folder = Folder::open(image).ok()?;
        let array = read_json(&folder, &image.join(dataset["path"].as_str()?).join("zarr.json")).ok()?;
        let size = |axis: usize| array["shape"][axis].as_u64();
        let [nx, ny, nz] = spatial.map(size);
        let (mut spacing, mut origin) = (DVec3::ONE, DVec3::ZERO);
        // The array's own transformations come first, those of all levels then.
        for transforms in [dataset, multiscale].map(|of| &of["coordinateTransformations"]) {
            for transform in transforms.as_array().into_iter().flatten() {
                let kind = transform["type"].as_str()?;
                let [x, y, z] = spatial.map(|axis| transform[kind][axis].as_f64());
                match kind {
                    "scale" => {
                        let scale = DVec3::new(x?, y?, z?);
                        (spacing, origin) = (spacing * scale, origin * scale);
                    }
                    "translation" => origin += DVec3::new(x?, y?, z?),
                    "identity" => {}
                    _ => return None,
                }
            }
        }
        let ours = &root["attributes"]["brickyard"];
        let orientation = || serde_json::from_value(ours["orientation"].clone()).ok();
        Some(Self {
            extent: [nx?, ny?, nz?],
            times: place("t").map_or(Some(1), size)?,
            spacing,
            origin,
            units: spatial.map(|axis| axes[axis]["unit"].as_str().map(str::to_owned)),
            orientation: if ours.is_null() { None } else { Some(orientation()?) },
        })
    }

    /// Descriptions of the differences of a source, each with the source's value first.
    fn differences(&self, source: &SourceInfo) -> Vec<String> {
        let Geometry { spacing, origin, .. } = source.geometry;
        let mut found = Vec::new();
        let mut note = |is_same: bool, what: &str, own: String, other: String| {
            if !is_same {
                found.push(format!("{what} {own}, and the image {other}"));
            }
        };
        let triple = |[x, y, z]: [String; 3]| format!("{x} x {y} x {z}");
        let extent = source.extent.to_array().map(u64::from);
        let shown = |extent: [u64; 3]| triple(extent.map(|n| n.to_string()));
        note(extent == self.extent, "voxels", shown(extent), shown(self.extent));
        let times = u64::from(source.times);
        note(times == self.times, "time steps", times.to_string(), self.times.to_string());
        let numbers = |v: DVec3| triple(v.to_array().map(|number| number.to_string()));
        // A thousandth of a voxel over all of the volume.
        let size = DVec3::from_array(extent.map(|n| n as f64));
        let is_near = |a: DVec3, b: DVec3, tolerance: DVec3| (a - b).abs().cmple(tolerance).all();
        let is_same = is_near(spacing, self.spacing, self.spacing.abs() * 1e-3 / size);
        note(is_same, "spacing", numbers(spacing), numbers(self.spacing));
        let is_same = is_near(origin, self.origin, self.spacing.abs() * 1e-3);
        note(is_same, "first voxel centre", numbers(origin), numbers(self.origin));
        let is_written = |unit: &&str| source.geometry.axis_units.is_none() || LengthUnit::named(unit).is_some();
        let units = [0, 1, 2].map(|axis| source.geometry.axis_unit(axis).filter(is_written).map(str::to_owned));
        let words =
            |units: &[Option<String>; 3]| triple(units.clone().map(|unit| unit.unwrap_or_else(|| "none".into())));
        note(units == self.units, "units", words(&units), words(&self.units));
        if let Some(other) = self.orientation {
            let is_same = match (&source.orientation, &other) {
                (Some(own), Some(other)) => own.agrees(other, source.extent),
                (own, other) => own.is_none() == other.is_none(),
            };
            let words = |orientation: &Option<Orientation>| {
                orientation.as_ref().map_or_else(|| "none".into(), |known| format!("{:?}", known.rows()))
            };
            note(is_same, "orientation in a patient", words(&source.orientation), words(&other));
        }
        found
    }
}
