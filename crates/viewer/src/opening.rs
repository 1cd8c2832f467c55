//! The volumes of a window, each perhaps still shown as a preview while it is packed. The window polls them once a frame.

use crate::nothing;
use crate::work_row;
use brickyard::opening::{Activity, News, Opening, OpeningError, OpeningOptions};
use brickyard::session::VolumeSource;
use eframe::egui::Ui;
use std::path::PathBuf;
use std::time::Duration;

/// Interval between polls while waiting for a preview.
const WAIT: Duration = Duration::from_millis(20);

/// The volumes of a window, and their progress.
pub struct Openings {
    options: OpeningOptions,
    items: Vec<Item>,
}

struct Item {
    path: PathBuf,
    opening: Opening,
    /// The shown state, if any.
    volume: Option<VolumeSource>,
}

/// Changes of the volumes since the last look.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    /// Whether a volume was replaced: a preview by a store, or nothing by a first picture.
    pub(crate) has_volumes: bool,
    pub(crate) has_steps: bool,
    pub(crate) messages: Vec<String>,
    /// Path and error of the first stopped volume, if any. One without a picture is removed.
    pub(crate) stopped: Option<(PathBuf, OpeningError)>,
}

impl Openings {
    /// Starts opening stores, files and folders, each as a volume of its own.
    pub fn start(paths: Vec<PathBuf>, options: OpeningOptions) -> Self {
        let item = |path: PathBuf| {
            let opening = Opening::start(path.clone(), options.clone());
            Item { path, opening, volume: None }
        };
        Self { items: paths.into_iter().map(item).collect(), options }
    }

    /// Adds other openings, whose volumes come last.
    pub(crate) fn add(&mut self, others: Self) {
        self.items.extend(others.items);
    }

    /// Waits for a picture of each. Calls `progress` now and then, with the bytes read and the total.
    ///
    /// # Errors
    /// If one of them cannot be opened.
    pub fn wait(&mut self, progress: impl Fn(u64, u64)) -> Result<(), OpeningError> {
        loop {
            let changes = self.poll();
            if let Some((_, error)) = changes.stopped {
                return Err(error);
            }
            if self.are_shown() {
                return Ok(());
            }
            let each = self.items.iter().map(|item| item.opening.progress());
            let (done, total) = each.fold((0, 0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
            progress(done, total);
            std::thread::sleep(WAIT);
        }
    }

    /// Whether the window is empty.
    pub(crate) fn are_none(&self) -> bool {
        self.items.is_empty()
    }

    /// The opened paths.
    pub fn paths(&self) -> Vec<PathBuf> {
        self.items.iter().map(|item| item.path.clone()).collect()
    }

    /// The volumes to show. An empty window has one of a single voxel, which it does not show.
    pub fn volumes(&self) -> Vec<VolumeSource> {
        if self.are_none() {
            return vec![nothing::volume()];
        }
        self.items.iter().filter_map(|item| item.volume.clone()).collect()
    }

    pub(crate) fn options(&self) -> &OpeningOptions {
        &self.options
    }

    /// Whether there is a picture of each.
    pub(crate) fn are_shown(&self) -> bool {
        self.items.iter().all(|item| item.volume.is_some())
    }

    /// Whether something is still being read or packed.
    pub(crate) fn are_busy(&self) -> bool {
        self.items.iter().any(|item| item.opening.activity() != Activity::Nothing)
    }

    /// Whether another program may append time steps to one of them.
    pub(crate) fn are_followed(&self) -> bool {
        self.items.iter().any(|item| item.opening.is_following())
    }

    /// Takes in changes, without waiting.
    pub(crate) fn poll(&mut self) -> Changes {
        let mut changes = Changes::default();
        for item in &mut self.items {
            changes.messages.extend(item.opening.take_said());
            match item.opening.poll() {
                None => {}
                Some(News::Store(volume))
                    if item.volume.as_ref().is_some_and(|before| is_same_store(before, &volume)) =>
                {
                    item.volume = Some(volume);
                    changes.has_steps = true;
                }
                Some(News::Preview(volume) | News::Store(volume)) => {
                    item.volume = Some(volume);
                    changes.has_volumes = true;
                }
                Some(News::Stopped(error)) => {
                    changes.stopped.get_or_insert((item.path.clone(), error));
                }
            }
        }
        self.items.retain(|item| item.volume.is_some() || item.opening.activity() != Activity::Nothing);
        changes
    }

    /// Takes a store's volume, opened anew after an edit of its metadata.
    pub(crate) fn take_edited(&mut self, volume: &VolumeSource) {
        for item in &mut self.items {
            if item.volume.as_ref().is_some_and(|before| is_same_store(before, volume)) {
                item.volume = Some(item.opening.reopened(volume.clone()));
            }
        }
    }

    /// Shows the progress, with a button to stop each.
    pub(crate) fn show(&self, ui: &mut Ui) {
        for item in &self.items {
            let (path, progress) = (item.path.as_path(), item.opening.progress());
            let is_stopped = match item.opening.activity() {
                Activity::Reading => work_row::show(ui, "reading", path, progress, item.volume.is_none()),
                Activity::Packing => work_row::show(ui, "packing", path, progress, true),
                Activity::Waiting => work_row::show_waiting(ui, path),
                Activity::Nothing => false,
            };
            if is_stopped {
                item.opening.cancel();
            }
        }
    }
}

/// Whether two volumes are states of one store.
fn is_same_store(one: &VolumeSource, other: &VolumeSource) -> bool {
    one.store().zip(other.store()).is_some_and(|(one, other)| one.path() == other.path())
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::import::OpenOptions;
    use brickyard::volume::{Extent, VoxelType};

    #[test]
    fn files_are_shown_before_they_are_packed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, vec![3; 300 * 20 * 10]).unwrap();
        let files = OpenOptions {
            shape: Some(Extent::new(300, 20, 10)),
            voxel_type: Some(VoxelType::U8.into()),
            ..OpenOptions::default()
        };
        let store = Some(folder.path().join("a.zarr"));
        let mut openings =
            Openings::start(vec![path.clone()], OpeningOptions { files, store, ..OpeningOptions::default() });
        openings.wait(|_, _| ()).unwrap();
        let width = |openings: &Openings| openings.volumes()[0].source.pyramid().levels()[0].extent.x;
        assert_eq!(width(&openings), 150);
        while openings.are_busy() {
            assert!(openings.poll().stopped.is_none());
        }
        assert_eq!((width(&openings), openings.paths()), (300, vec![path]));
    }

    #[test]
    fn one_that_stops_leaves_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, vec![3; 30 * 20 * 10]).unwrap();
        let files = OpenOptions {
            shape: Some(Extent::new(30, 20, 10)),
            voxel_type: Some(VoxelType::U8.into()),
            ..OpenOptions::default()
        };
        let store = Some(folder.path().join("a.zarr"));
        let options = OpeningOptions { files, store, ..OpeningOptions::default() };
        let mut openings = Openings::start(vec!["/no/such.tif".into(), path.clone()], options);
        let mut stopped = None;
        while !openings.are_shown() {
            stopped = stopped.or(openings.poll().stopped);
        }
        assert_eq!(stopped.map(|(path, _)| path), Some("/no/such.tif".into()));
        assert_eq!((openings.paths(), openings.volumes().len()), (vec![path], 1));
    }

    #[test]
    fn what_cannot_be_opened_is_named() {
        let mut openings = Openings::start(vec!["/no/such.tif".into()], OpeningOptions::default());
        let error = openings.wait(|_, _| ()).unwrap_err().to_string();
        assert!(error.contains("/no/such.tif: No such file"), "{error}");
    }
}
