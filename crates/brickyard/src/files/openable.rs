//! Paths to open for viewing: brick stores, which open at once, or files to pack, shown as a preview meanwhile.

use crate::session::volume_source::VolumeSource;
use brickyard_import::{self as import, ImportError, OpenOptions, Source};
use brickyard_objects::is_address;
use brickyard_store::layout::JOURNAL_NAME;
use brickyard_store::{Kind, OpenError, PackOptions, Reductions, is_foreign};
use brickyard_volume::VoxelType;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A source of something to show.
pub enum Openable {
    /// A finished store, open.
    Store(Box<VolumeSource>),
    /// Files of a supported format: see [`Preview`](crate::window::preview::Preview) and
    /// [`background::pack`](crate::window::background::pack).
    Source(Arc<dyn Source>),
}

/// Errors in opening a path.
#[derive(Debug, thiserror::Error)]
pub enum OpenableError {
    /// A finished or unfinished store that does not open.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// Not a store, and not readable as anything else. The error lists the supported formats, or the missing option.
    #[error(transparent)]
    Source(#[from] ImportError),
}

/// Whether a path is a store, an unfinished pack of one, or another program's Zarr, by the files in it; all addresses are.
pub fn is_store(path: &Path) -> bool {
    is_address(path) || path.join("zarr.json").is_file() || path.join(JOURNAL_NAME).exists() || is_foreign(path)
}

/// Whether a path is a mesh, shown beside volumes, by its name.
pub fn is_mesh(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    ["stl", "ply", "obj", "gltf", "glb"].contains(&extension.as_str())
}

/// Whether a file has the name of a supported kind: a volume, a mesh or a scene.
pub fn has_known_name(path: &Path) -> bool {
    let is_scene = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    import::has_known_name(path) || is_mesh(path) || is_scene
}

/// Opens a store, or else files: one, a folder of planes or slices, or several time steps or planes. `options` apply to
/// files alone. A compressed file without random access is inflated first, in as much time; all others take
/// milliseconds.
///
/// # Errors
/// If the store does not open, or the files have no supported format.
pub fn open(paths: &[PathBuf], options: &OpenOptions) -> Result<Openable, OpenableError> {
    match paths {
        [path] if is_store(path) => Ok(Openable::Store(Box::new(VolumeSource::open(path)?))),
        files => match (import::open(files, options), files) {
            (Ok(source), _) => Ok(Openable::Source(Arc::from(source))),
            // A part of a store is no supported file: the store was meant.
            (Err(error), [path]) => match VolumeSource::open(path) {
                Err(inside @ OpenError::Inside { .. }) => Err(inside.into()),
                _ => Err(error.into()),
            },
            (Err(error), _) => Err(error.into()),
        },
    }
}

/// Returns options for packing a volume while it is shown: one processor is left for that. Labels are never averaged.
pub fn pack_options(voxel_type: VoxelType, kind: Kind) -> PackOptions {
    let defaults = PackOptions::new(voxel_type);
    let threads = defaults.threads.saturating_sub(1).max(1);
    PackOptions { kind, downsample: Reductions::default_for(kind), threads, ..defaults }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_store::pack;
    use brickyard_volume::Extent;

    fn problem(path: &Path) -> String {
        open(&[path.to_owned()], &OpenOptions::default()).err().expect("nothing to show").to_string()
    }

    #[test]
    fn names_tell_what_may_be_opened() {
        let known = [
            "a.nii.gz",
            "A.TIF",
            "set.companion.ome",
            "IM0001",
            "slice.12",
            "bone.stl",
            "look.json",
            "a.b.raw",
            "a.npz",
            "emd.map",
            "emd.mrc.gz",
            "scan.H5",
            "model.nc",
            "cell.ims",
            "a.img.gz",
            "run.pvd",
            "a.bov",
        ];
        for name in known {
            assert!(has_known_name(Path::new(name)), "{name}");
        }
        for name in ["notes.txt", "a.tar.gz", "report.pdf", "a.zarr.packing"] {
            assert!(!has_known_name(Path::new(name)), "{name}");
        }
    }

    #[test]
    fn stores_and_files_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join("a.raw");
        std::fs::write(&raw, [7; 24]).unwrap();
        let options = OpenOptions {
            shape: Some(Extent::new(2, 3, 4)),
            voxel_type: Some(VoxelType::U8.into()),
            ..OpenOptions::default()
        };
        let Openable::Source(source) = open(std::slice::from_ref(&raw), &options).unwrap() else { panic!("a store") };
        let store = folder.path().join("a.zarr");
        pack(&*source, &store, &pack_options(VoxelType::U8, Kind::Image), &()).unwrap();
        let Openable::Store(volume) = open(std::slice::from_ref(&store), &options).unwrap() else { panic!("a file") };
        assert_eq!(volume.source.value_range(), (7.0, 7.0));
        for (part, words) in [("0", "level 0"), ("zarr.json", "a part")] {
            let expected = format!("is {words} of {}: pass", store.display());
            assert!(problem(&store.join(part)).contains(&expected), "{}", problem(&store.join(part)));
        }
        assert!(problem(&raw).contains("pass `shape`"), "{}", problem(&raw));
        let text = folder.path().join("notes.txt");
        std::fs::write(&text, "not a volume").unwrap();
        assert!(problem(&text).contains("not a supported format"), "{}", problem(&text));
        // A folder's raw files are its time steps.
        assert!(problem(folder.path()).contains("pass `shape`"), "{}", problem(folder.path()));
        std::fs::remove_file(&raw).unwrap();
        assert!(problem(folder.path()).contains("a.zarr: pass that"), "{}", problem(folder.path()));
        let empty = tempfile::tempdir().unwrap();
        assert!(problem(empty.path()).contains("without readable files"), "{}", problem(empty.path()));
        assert!(problem(&folder.path().join("gone")).contains("No such file"));
        // A killed pack has a journal and no root document.
        std::fs::rename(store.join("zarr.json"), store.join(JOURNAL_NAME)).unwrap();
        assert!(matches!(open(&[store], &options), Err(OpenableError::Store(_))));
    }
}
