//! Default places of stores: in the user's cache, under a name derived from the source and the options. An unchanged
//! file is thus found packed when opened again. Nothing is ever removed there: this is left to the owner of the disk.

use crate::session::volume_source::VolumeSource;
use brickyard_import::Source;
use brickyard_store::{PackOptions, settings_fingerprint};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The folder of the user's stores: `brickyard/stores` in the system's place for caches (`$XDG_CACHE_HOME`, or
/// `.cache`, `Library/Caches` or `%LOCALAPPDATA%` of the user); `None` if the user has no folder.
pub fn user_folder() -> Option<PathBuf> {
    folder_from(|name| std::env::var_os(name))
}

fn folder_from(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    // A relative path would differ by working directory; XDG requires ignoring it.
    let folder = |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let caches = if cfg!(windows) {
        folder("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        folder("HOME").map(|home| home.join("Library/Caches"))
    } else {
        folder("XDG_CACHE_HOME").or_else(|| folder("HOME").map(|home| home.join(".cache")))
    };
    caches.map(|caches| caches.join("brickyard").join("stores"))
}

/// The place in a folder for the store of a source: the name of the `input`, and a hash of the source's identity and
/// the options.
pub fn place_in(folder: &Path, input: &Path, source: &dyn Source, options: &PackOptions) -> PathBuf {
    let name = input.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').find(|part| !part.is_empty()).unwrap_or("volume");
    // The hash, the extension and the packer's own additions must fit in 255 bytes, too.
    let end = (0..=stem.len().min(128)).rev().find(|&end| stem.is_char_boundary(end)).unwrap_or(0);
    folder.join(format!("{}-{}.zarr", &stem[..end], settings_fingerprint(source, options)))
}

/// Opens the store at a place, if it is finished and was packed from this source with these options.
pub fn finished(place: &Path, source: &dyn Source, options: &PackOptions) -> Option<VolumeSource> {
    let volume = VolumeSource::open(place).ok()?;
    let is_same = volume.store()?.info().settings_fingerprint == settings_fingerprint(source, options);
    is_same.then_some(volume)
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_import::{OpenOptions, open};
    use brickyard_store::{Kind, pack};
    use brickyard_volume::{Extent, VoxelType};

    #[test]
    #[cfg(all(unix, not(target_os = "macos")))]
    fn the_folder_is_where_the_system_keeps_caches() {
        let folder = |xdg: Option<&str>, home: Option<&str>| {
            folder_from(|name| match name {
                "XDG_CACHE_HOME" => xdg.map(Into::into),
                "HOME" => home.map(Into::into),
                _ => None,
            })
        };
        assert_eq!(folder(Some("/big"), Some("/home/me")), Some("/big/brickyard/stores".into()));
        assert_eq!(folder(Some("relative"), Some("/home/me")), Some("/home/me/.cache/brickyard/stores".into()));
        assert_eq!(folder(None, None), None);
    }

    #[test]
    fn a_file_has_one_place_as_long_as_it_and_the_options_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("my scan.v2.raw");
        std::fs::write(&path, [7; 24]).unwrap();
        let shape = Some(Extent::new(2, 3, 4));
        let options = OpenOptions { shape, voxel_type: Some(VoxelType::U8.into()), ..OpenOptions::default() };
        let source = || open(std::slice::from_ref(&path), &options).unwrap();
        let image = crate::files::openable::pack_options(VoxelType::U8, Kind::Image);
        let labels = crate::files::openable::pack_options(VoxelType::U8, Kind::Labels);
        let place = place_in(folder.path(), &path, &*source(), &image);
        let name = place.file_name().unwrap().to_string_lossy();
        assert!(name.starts_with("my scan-") && name.ends_with(".zarr"), "{name}");
        assert_eq!(place, place_in(folder.path(), &path, &*source(), &PackOptions { threads: 9, ..image.clone() }));
        assert_ne!(place, place_in(folder.path(), &path, &*source(), &labels));
        assert!(finished(&place, &*source(), &image).is_none());
        pack(&*source(), &place, &image, &()).unwrap();
        assert!(finished(&place, &*source(), &image).is_some());
        assert!(finished(&place, &*source(), &labels).is_none());
        std::fs::write(&path, [7; 48]).unwrap();
        let longer = OpenOptions { shape: Some(Extent::new(4, 3, 4)), ..options.clone() };
        let changed = open(std::slice::from_ref(&path), &longer).unwrap();
        assert_ne!(place, place_in(folder.path(), &path, &*changed, &image));
        assert!(finished(&place, &*changed, &image).is_none());
    }

    #[test]
    fn odd_names_have_a_place_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, [7; 24]).unwrap();
        let shape = Some(Extent::new(2, 3, 4));
        let options = OpenOptions { shape, voxel_type: Some(VoxelType::U8.into()), ..OpenOptions::default() };
        let source = open(&[path], &options).unwrap();
        let options = PackOptions::new(VoxelType::U8);
        for (input, start) in [("/", "volume-"), (".hidden.raw", "hidden-"), (&*"é".repeat(100), "éé")] {
            let place = place_in(folder.path(), Path::new(input), &*source, &options);
            let name = place.file_name().unwrap().to_string_lossy().into_owned();
            assert!(name.starts_with(start) && name.len() < 160, "{name}");
        }
    }
}
