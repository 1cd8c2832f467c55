//! Composition: a shader is some files and all that those import.
//!
//! A line `//!import a b` of a file, behind its head comment, names what it needs: a file beside it, or a *part* that the variant
//! chooses (a file too, or text made for the variant). Each is taken once; what is not imported is not there.

use crate::bindings;
use std::collections::{HashMap, HashSet};

macro_rules! files {
    ($($name:literal)*) => { &[$(($name, include_str!(concat!("../wgsl/", $name, ".wgsl")))),*] };
}

/// All WGSL files: the name, without `.wgsl`, and the text of each.
pub(crate) const FILES: &[(&str, &str)] = files! {
    "anything" "average" "axes" "axes_own" "blit" "box_extremes" "box_none" "bricks" "caps" "cast_joint" "classify" "colors" "combine" "composite" "counted" "cut_face" "differences" "dither" "extreme" "eyes_anaglyph"
    "eyes_interlaced" "eyes_one" "eyes_side_by_side" "eyes_top_bottom" "field" "find_cell" "find_leaf" "frame" "fullscreen" "gathered"
    "gradient_central" "gradient_sobel" "gradient_stored" "grid" "hidden" "jitter" "kept" "lattice" "layer_medium" "light" "lighting" "limits_none"
    "limits_slab" "macrocells" "march_joint" "march_medium" "march_samples" "march_surface" "mark" "mark_none" "medium" "neighbour" "no_value"
    "opaque" "part_media" "part_value" "peel" "pictures" "project" "project_labels" "projected" "ranks" "ray" "raycast_compute" "raycast_fragment"
    "raycast_medium" "raycast_samples" "raycast_surface" "resolve_average" "resolve_composite" "resolve_join" "resolve_joined" "resolve_over"
    "resolve_picture" "resolve_project" "resolve_slab" "runs" "sample" "sample_cubic" "sample_cubic_voxels"
    "sample_label" "sample_nearest" "sample_nearest_voxel" "sample_voxels" "sampler" "search" "see_media" "sees_average" "sees_composite" "sees_project" "sees_surface" "sees_surfaces" "shade" "sight"
    "sorted" "spline" "surface" "surfaces" "surfaces_none" "table" "through" "joint_medium" "tree" "value_lit" "value_unlit" "voxel" "way" "written_codes" "written_light"
};

const IMPORT: &str = "//!import";

/// The parts that a variant chooses, each by the name that files import: the WGSL text that stands for it.
#[derive(Debug, Default)]
pub(crate) struct Parts(HashMap<&'static str, String>);

impl Parts {
    /// Makes parts of which only `bindings` is chosen yet: the numbers of all bindings, as constants.
    pub(crate) fn new() -> Self {
        Self::default().text("bindings", bindings::wgsl())
    }

    /// Lets a file stand for a part. No file may have the part's name.
    pub(crate) fn file(self, part: &'static str, file: &str) -> Self {
        self.text(part, format!("{IMPORT} {file}\n"))
    }

    /// Lets a text stand for a part. The text may import what it needs.
    pub(crate) fn text(mut self, part: &'static str, text: String) -> Self {
        self.0.insert(part, text);
        self
    }

    /// Returns the source of a shader: these files, and all files and parts that they import, each once.
    ///
    /// # Panics
    /// If there is no file or part of a name that is imported; a test composes every variant.
    pub(crate) fn compose(&self, roots: &[&str]) -> String {
        self.gather(roots).unwrap_or_else(|name| panic!("no shader file or part `{name}`"))
    }

    /// Returns the source of a shader: these files, and all files and parts that they import, each once.
    ///
    /// # Errors
    /// The name that is imported, if there is no file or part of it.
    pub(crate) fn gather(&self, roots: &[&str]) -> Result<String, String> {
        let (mut taken, mut source) = (HashSet::new(), String::new());
        let mut wanted: Vec<&str> = roots.to_vec();
        while let Some(name) = wanted.pop() {
            if taken.insert(name) {
                let text = self.find(name).ok_or_else(|| name.to_string())?;
                wanted.extend(imports(text));
                source.push_str(text);
                source.push('\n');
            }
        }
        Ok(source)
    }

    fn find(&self, name: &str) -> Option<&str> {
        let file = || FILES.iter().find(|(file, _)| *file == name).map(|(_, text)| *text);
        self.0.get(name).map(String::as_str).or_else(file)
    }
}

/// The names of the files and parts that a text imports.
fn imports(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| line.strip_prefix(IMPORT)).flat_map(str::split_whitespace)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_taken_once_and_parts_stand_for_files() {
        let parts =
            Parts::default().text("context", "// C".into()).text("a", "//!import b b\nA".into()).file("b", "dither");
        let source = parts.compose(&["a", "b", "context"]);
        assert_eq!(source.matches("fn dither").count(), 1);
        assert!(source.contains("// C") && source.contains("\nA"), "{source}");
    }

    #[test]
    fn the_table_names_all_files() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/wgsl");
        let mut found: Vec<String> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        found.sort();
        let mut named: Vec<String> = FILES.iter().map(|(name, _)| format!("{name}.wgsl")).collect();
        named.sort();
        assert_eq!(found, named);
    }
}
