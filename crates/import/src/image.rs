//! An image of several levels, to be drawn where it lies: a source for each level, and the words of its documents on the picture.

use crate::source::Source;
use brickyard_volume::LabelColor;
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;

/// An image with all its levels, or an array as an image of one level.
pub struct Image {
    /// The levels, the finest first; at least one.
    pub levels: Vec<ImageLevel>,
    /// Words of the documents beside the voxels.
    pub presentation: Presentation,
}

/// A level of an image.
pub struct ImageLevel {
    /// Its voxels, under a description of their own place.
    pub source: Arc<dyn Source>,
    /// Voxels of the finest level along x, y, z in one of this level, by the image's document; without a word of it, by the sizes of both.
    pub factor: DVec3,
    /// The array's folder.
    pub folder: PathBuf,
}

/// How an image is to be shown, by its documents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Presentation {
    /// The image's name.
    pub name: Option<String>,
    /// Numbers of the channels hidden at first.
    pub hidden_channels: Vec<u32>,
    /// Colours of labels, in the order of the labels.
    pub label_colors: Vec<LabelColor>,
    /// Names of label images in the image's folder `labels`.
    pub label_names: Vec<String>,
}
