//! Files made of a store's voxels beside the window, an export or a mesh: their progress, and their outcome in words. Costs a thread, and up to 1 GiB
//! outside the window's budgets.

use crate::work_row;
use brickyard::background::{self, Background, BackgroundError};
use brickyard::export::{ExportError, ExportRequest, Exported};
use brickyard::extract::{MeshError, MeshReport, MeshRequest};
use brickyard::store::Store;
use brickyard::volume::Extent;
use eframe::egui::Ui;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file being made. Dropping it stops the work, without waiting.
pub(crate) struct Exporting {
    path: PathBuf,
    store: Arc<Store>,
    work: Work,
}

enum Work {
    Voxels(Background<Exported, ExportError>),
    Mesh(Background<MeshReport, MeshError>),
}

impl Exporting {
    /// Starts writing voxels to a file, whose name tells the format.
    pub(crate) fn voxels(store: Arc<Store>, path: &Path, request: ExportRequest) -> Self {
        let work = Work::Voxels(background::export(store.clone(), path.into(), request));
        Self { path: path.into(), store, work }
    }

    /// Starts writing a surface to a file, whose name tells the format.
    pub(crate) fn mesh(store: Arc<Store>, path: &Path, request: MeshRequest) -> Self {
        let work = Work::Mesh(background::mesh(store.clone(), path.into(), request));
        Self { path: path.into(), store, work }
    }

    /// The resulting message, once it is over.
    pub(crate) fn poll(&mut self) -> Option<Result<String, String>> {
        let path = self.path.display();
        let exists = || Err(format!("{path}: exists already; choose another name"));
        Some(match &mut self.work {
            Work::Voxels(work) => match work.poll()? {
                Ok(exported) => Ok(voxels_in_words(&self.path, &self.store, &exported)),
                Err(BackgroundError::Failed(ExportError::Exists { .. })) => exists(),
                Err(error) => Err(error.to_string()),
            },
            Work::Mesh(work) => match work.poll()? {
                Ok(report) => Ok(format!("wrote {path}: {}", report.in_words(&self.store))),
                Err(BackgroundError::Failed(MeshError::Exists { .. })) => exists(),
                Err(error) => Err(error.to_string()),
            },
        })
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.meter().is_cancelled()
    }

    fn meter(&self) -> &background::Meter {
        match &self.work {
            Work::Voxels(work) => work.meter(),
            Work::Mesh(work) => work.meter(),
        }
    }

    /// Shows the progress, and a button to stop it.
    pub(crate) fn show(&self, ui: &mut Ui) {
        if work_row::show(ui, "exporting", &self.path, self.meter().progress(), true) {
            self.meter().cancel();
        }
    }
}

fn voxels_in_words(path: &Path, store: &Store, exported: &Exported) -> String {
    let Exported { extent: Extent { x, y, z }, times, channels, notes, .. } = exported;
    let count = |count: u32, noun: &str| if count > 1 { format!("{count} {noun}s of ") } else { String::new() };
    let (steps, channels) = (count(*times, "step"), count(*channels, "channel"));
    let wrote = format!("wrote {}: {steps}{channels}{x} x {y} x {z} {}", path.display(), store.voxel_type());
    [&[wrote][..], &notes[..]].concat().join(". ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::tests::store;
    use brickyard::export::{ExportChannels, ExportTime};
    use brickyard::extract::MeshSurface;

    fn ended(mut exporting: Exporting) -> Result<String, String> {
        loop {
            if let Some(ended) = exporting.poll() {
                return ended;
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn what_was_written_is_said_and_why_it_was_not() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path()).store().unwrap().clone();
        let path = folder.path().join("a.raw");
        let export = |request| ended(Exporting::voxels(store.clone(), &path, request));
        assert_eq!(export(ExportRequest::default()), Ok(format!("wrote {}: 30 x 20 x 10 u16", path.display())));
        assert!(export(ExportRequest::default()).unwrap_err().ends_with("exists already; choose another name"));
        let time = ExportTime::Steps { first: 0, end: 3, stride: 1 };
        let all = ExportRequest { time, channels: ExportChannels::All, overwrite: true, ..ExportRequest::default() };
        assert!(export(all).unwrap().contains(": 3 steps of 30 x 20 x 10 u16"));
        let path = folder.path().join("a.stl");
        let mesh = |value| {
            let request = MeshRequest::new(MeshSurface::Isosurface(value));
            ended(Exporting::mesh(store.clone(), &path, request))
        };
        assert!(mesh(1e9).unwrap_err().contains("no surface at 1000000000"));
        let said = mesh(30000.0).unwrap();
        assert!(said.contains(" triangles, ") && said.contains("area "), "{said}");
        assert!(mesh(30000.0).unwrap_err().ends_with("exists already; choose another name"));
    }

    #[test]
    fn what_is_stopped_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path()).store().unwrap().clone();
        let path = folder.path().join("a.stl");
        let exporting = Exporting::mesh(store, &path, MeshRequest::new(MeshSurface::Isosurface(30000.0)));
        exporting.meter().cancel();
        assert!(exporting.is_stopped());
        match ended(exporting) {
            Err(said) => assert!(said.contains("cancelled; nothing was written there") && !path.exists(), "{said}"),
            // Too fast: there was nothing left to stop.
            Ok(_) => assert!(path.exists()),
        }
    }
}
