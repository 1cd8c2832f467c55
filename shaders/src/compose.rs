//! Composition: a shader is some files and all their imports.
//!
//! A line `//!import a b` of a file, behind its head comment, lists its needs: files, in any folder, or *parts* chosen by the variant (a
//! file of the part's folder, or text made for the variant). Each is taken once; anything not imported is absent.

use crate::{bindings, layout};
use std::collections::{HashMap, HashSet};

macro_rules! files {
    ($($folder:literal: $($name:literal)*;)*) => {
        &[$($((concat!($folder, "/", $name), include_str!(concat!("../wgsl/", $folder, "/", $name, ".wgsl")))),*),*]
    };
}

/// All WGSL files: path without `.wgsl`, and text.
pub(crate) const FILES: &[(&str, &str)] = files! {
    "passes":
        "blit" "march_joint" "march_medium" "march_samples" "march_surface" "peel" "raycast_compute" "raycast_fragment" "resolve_join" "resolve_over"
        "resolve_picture" "resolve_slab";
    "shared":
        "anything" "bricks" "caps" "classify" "colors" "counted" "cut_face" "differences" "dither" "extreme" "field" "frame" "fullscreen" "gathered" "grid"
        "hidden" "jitter" "joint_medium" "kept" "lattice" "light" "lighting" "macrocells" "medium" "neighbour" "no_value" "opaque" "pictures" "projected"
        "ranks" "ray" "runs" "sampler" "search" "shade" "sight" "sorted" "spline" "sums" "table" "traverse" "tree" "voxel" "way";
    "parts/atlas": "sample" "sample_cubic" "sample_cubic_voxels" "sample_label" "sample_nearest" "sample_nearest_voxel" "sample_voxels";
    "parts/boxes": "box_extremes" "box_none";
    "parts/cast": "cast_joint" "raycast_medium" "raycast_samples" "raycast_surface";
    "parts/eyes": "eyes_anaglyph" "eyes_interlaced" "eyes_one" "eyes_side_by_side" "eyes_top_bottom";
    "parts/feedback": "mark" "mark_none";
    "parts/find": "find_cell" "find_leaf";
    "parts/gradient": "gradient_central" "gradient_sobel" "gradient_stored";
    "parts/limits": "limits_none" "limits_slab";
    "parts/part": "part_media" "part_value";
    "parts/pixel": "average" "composite" "layer_medium" "project" "project_labels" "surface" "through";
    "parts/see": "combine" "see_media";
    "parts/seen": "resolve_average" "resolve_composite" "resolve_joined" "resolve_project";
    "parts/sees": "sees_average" "sees_composite" "sees_project" "sees_surface" "sees_surfaces";
    "parts/take": "surfaces" "surfaces_none";
    "parts/value": "value_lit" "value_unlit";
    "parts/world": "axes" "axes_own";
    "parts/written": "written_codes" "written_light";
};

const IMPORT: &str = "//!import";

/// The parts chosen by a variant: WGSL text by the part's import name.
#[derive(Debug, Default)]
pub(crate) struct Parts(HashMap<&'static str, String>);

impl Parts {
    /// Creates parts with only those chosen that all variants share: `bindings`, the numbers of all bindings as constants, and the structs of
    /// `layout` by their names.
    pub(crate) fn new() -> Self {
        let bindings = Self::default().text("bindings", bindings::wgsl());
        layout::IN_WGSL.iter().fold(bindings, |parts, (name, text)| parts.text(name, text.to_string()))
    }

    /// Chooses a file of the part's folder for it. No file may have the part's name.
    ///
    /// # Panics
    /// If the folder has no such file.
    pub(crate) fn file(self, part: &'static str, file: &str) -> Self {
        assert!(FILES.iter().any(|(path, _)| *path == format!("parts/{part}/{file}")), "{part} has no {file}");
        self.text(part, format!("{IMPORT} {file}\n"))
    }

    /// Chooses a text for a part. The text may have imports.
    pub(crate) fn text(mut self, part: &'static str, text: String) -> Self {
        self.0.insert(part, text);
        self
    }

    /// Returns the source of a shader: these files, and all imported files and parts, each once.
    ///
    /// # Panics
    /// If an import names no file or part; a test composes every variant.
    pub(crate) fn compose(&self, roots: &[&str]) -> String {
        self.gather(roots).unwrap_or_else(|name| panic!("no shader file or part `{name}`"))
    }

    /// Returns the source of a shader: these files, and all imported files and parts, each once.
    ///
    /// # Errors
    /// The name of an import without a file or part.
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
        let file = || FILES.iter().find(|(path, _)| name_of(path) == name).map(|(_, text)| *text);
        self.0.get(name).map(String::as_str).or_else(file)
    }
}

/// The import name of a file.
pub(crate) fn name_of(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// The imported names of a text.
fn imports(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| line.strip_prefix(IMPORT)).flat_map(str::split_whitespace)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_taken_once_and_parts_stand_for_files() {
        let parts = Parts::default()
            .text("context", "// C".into())
            .text("a", "//!import limits dither dither\nA".into())
            .file("limits", "limits_none");
        let source = parts.compose(&["a", "limits", "context"]);
        assert_eq!((source.matches("fn dither").count(), source.matches("fn limited").count()), (1, 1), "{source}");
        assert!(source.contains("// C") && source.contains("\nA"), "{source}");
    }

    #[test]
    fn the_table_names_all_files_and_each_name_is_one_file() {
        let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/wgsl"));
        let (mut found, mut folders) = (Vec::new(), vec![root.to_path_buf()]);
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false => found.push(path.strip_prefix(root).unwrap().to_str().unwrap().to_owned()),
                }
            }
        }
        found.sort();
        let mut named: Vec<String> = FILES.iter().map(|(path, _)| format!("{path}.wgsl")).collect();
        named.sort();
        assert_eq!(found, named);
        let names: HashSet<&str> = FILES.iter().map(|(path, _)| name_of(path)).collect();
        assert_eq!(names.len(), FILES.len());
    }
}
