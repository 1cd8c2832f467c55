//! Keeps a window's state from one day to the next: in a user's file, written a while after each change and read when the same volumes are opened
//! again. Costs a small file per set of volumes.

use crate::state::State;
use brickyard::text_file::{read_text, write_text};
use serde::Serialize;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Delay from the last change to writing.
const AFTER: Duration = Duration::from_secs(2);

/// Keeps a state in a file.
pub(crate) struct Keeper {
    /// The file; `None` keeps nothing.
    path: Option<PathBuf>,
    kept: State,
    /// The state still to be written, and when it changed.
    changed: Option<(State, Instant)>,
}

impl Keeper {
    /// Keeps a window's state, `state` at first; without a file it is not kept.
    pub(crate) fn new(path: Option<PathBuf>, state: &State) -> Self {
        Self { path, kept: state.clone(), changed: None }
    }

    /// Records the state, and writes it if unchanged for a while. Returns the delay until the next attempt, if any.
    ///
    /// # Errors
    /// If the file cannot be written; that state is given up then.
    pub(crate) fn keep(&mut self, state: &State) -> Result<Option<Duration>, String> {
        if self.path.is_none() || self.changed.is_none() && *state == self.kept {
            return Ok(None);
        }
        match &self.changed {
            Some((changed, since)) if changed == state => {
                let left = AFTER.saturating_sub(since.elapsed());
                if left.is_zero() { self.write().map(|()| None) } else { Ok(Some(left)) }
            }
            _ => {
                self.changed = Some((state.clone(), Instant::now()));
                Ok(Some(AFTER))
            }
        }
    }

    /// Writes the pending state, if any.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn write(&mut self) -> Result<(), String> {
        let (Some(path), Some((state, _))) = (&self.path, self.changed.take()) else { return Ok(()) };
        let result = make_folder_of(path).and_then(|()| write(path, &state));
        self.kept = state;
        result
    }
}

/// Writes a state as a scene file, atomically.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write(path: &Path, state: &State) -> Result<(), String> {
    let mut state = state.clone();
    // A file in another folder names the same files.
    let absolute = |path: &mut PathBuf| *path = std::path::absolute(&*path).unwrap_or_else(|_| path.clone());
    state.scene.meshes.iter_mut().for_each(|look| absolute(&mut look.path));
    state.window.volumes.iter_mut().for_each(absolute);
    for layer in &mut state.scene.layers {
        if let Some(brickyard::volume::TransferChoice::File(file)) = &mut layer.transfer {
            absolute(&mut file.path);
        }
    }
    let document = state.to_document().map_err(|error| error.to_string())?;
    write_json(path, &document)
}

/// Writes a value as a file in JSON, atomically.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), String> {
    let text = serde_json::to_string_pretty(value).map_err(|error| error.to_string())?;
    write_text(path, &(text + "\n")).map_err(|error| error.to_string())
}

/// Creates the folder for a file, if missing.
///
/// # Errors
/// If it cannot be created.
pub(crate) fn make_folder_of(path: &Path) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Reads the state in a scene file, but none of the files it names; `None` if it does not exist.
///
/// # Errors
/// If the file cannot be read, or is no scene. The message begins with its path.
pub(crate) fn read(path: &Path) -> Result<Option<State>, String> {
    if !path.exists() {
        return Ok(None);
    }
    let text = read_text(path).map_err(|error| error.to_string())?;
    let document = serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    State::from_document(document).map(Some).map_err(|error| format!("{}: {error}", path.display()))
}

/// The volumes of a scene file's window; relative paths are in the file's folder.
///
/// # Errors
/// If the file cannot be read, or is no scene. The message begins with its path.
pub fn volumes_of(path: &Path) -> Result<Vec<PathBuf>, String> {
    let volumes = read(path)?.map(|state| state.window.volumes).unwrap_or_default();
    Ok(volumes.into_iter().map(|volume| path.with_file_name(volume)).collect())
}

/// The user's file for a window on these volumes; `None` without volumes or a folder for such files.
pub(crate) fn file_of(volumes: &[PathBuf]) -> Option<PathBuf> {
    if volumes.is_empty() {
        return None;
    }
    let mut hasher = DefaultHasher::new();
    for volume in volumes {
        volume.canonicalize().unwrap_or_else(|_| volume.clone()).hash(&mut hasher);
    }
    let name = volumes.first().and_then(|volume| volume.file_stem()).unwrap_or_default().to_string_lossy();
    Some(state_folder()?.join("windows").join(format!("{name}-{:016x}.json", hasher.finish())))
}

/// The folder for programs' state, by the XDG base directory specification.
pub(crate) fn state_folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || absolute("HOME").map(|home| home.join(".local/state"));
    Some(absolute("XDG_STATE_HOME").or_else(home)?.join("brickyard"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::{MeshLook, Scene};

    #[test]
    fn a_state_is_kept_and_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("windows/ct.json");
        let mut keeper = Keeper::new(Some(path.clone()), &State::default());
        assert_eq!(keeper.keep(&State::default()), Ok(None), "nothing has changed");
        let mut state = State { scene: Scene { step: 0.5, ..Scene::default() }, ..State::default() };
        state.window.volumes = vec![PathBuf::from("/data/ct.zarr")];
        state.scene.meshes = vec![MeshLook::new("skull.stl")];
        assert!(keeper.keep(&state).unwrap().is_some(), "it is written a while later");
        assert!(!path.exists());
        keeper.write().unwrap();
        let found = read(&path).unwrap().unwrap();
        assert!(found.scene.meshes[0].path.is_absolute());
        state.scene.meshes = found.scene.meshes.clone();
        assert_eq!(found, state);
        assert_eq!(keeper.keep(&keeper.kept.clone()), Ok(None));
    }

    #[test]
    fn a_scene_file_names_its_volumes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::write(&path, r#"{"mode": "mip", "window": {"volumes": ["/data/ct.zarr", "pet.zarr"]}}"#).unwrap();
        assert_eq!(volumes_of(&path), Ok(vec!["/data/ct.zarr".into(), folder.path().join("pet.zarr")]));
        std::fs::write(&path, r#"{"mode": "mip"}"#).unwrap();
        assert_eq!(volumes_of(&path), Ok(Vec::new()));
    }

    #[test]
    fn what_cannot_be_kept_is_said_once() {
        let folder = tempfile::tempdir().unwrap();
        let in_the_way = folder.path().join("windows");
        std::fs::write(&in_the_way, "").unwrap();
        let mut keeper = Keeper::new(Some(in_the_way.join("ct.json")), &State::default());
        let state = State { scene: Scene { step: 0.5, ..Scene::default() }, ..State::default() };
        keeper.keep(&state).unwrap();
        assert!(keeper.write().unwrap_err().contains("windows"));
        assert_eq!(keeper.write(), Ok(()));
        assert_eq!(keeper.keep(&state), Ok(None));
    }

    #[test]
    fn files_that_are_no_states_are_said() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        assert_eq!(read(&path), Ok(None));
        for text in ["", "{\"window\": 3}", "[]", "{\"nonsense\": 1}"] {
            std::fs::write(&path, text).unwrap();
            assert!(read(&path).unwrap_err().contains("a.json"), "{text}");
        }
    }

    #[test]
    fn each_set_of_volumes_has_a_file() {
        let file = |paths: &[&str]| file_of(&paths.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_ne!(file(&["/a/ct.zarr"]), file(&["/b/ct.zarr"]));
        assert_ne!(file(&["/a/ct.zarr"]), file(&["/a/ct.zarr", "/a/pet.zarr"]));
    }
}
