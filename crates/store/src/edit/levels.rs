//! Coarser levels of an image made again for labels, from the voxels of level 0, whose files stay as they are, with side data and statistics
//! ([`Remake`]). The root document is the former one with the edit.

use super::{Edit, EditError, EditReport, Edited};
use crate::downsample::Downsample;
use crate::kind::Kind;
use crate::level_source::LevelSource;
use crate::metadata::parse_info;
use crate::pack::disk::Disk;
use crate::remake::{Documents, Kept, Remake, Work};
use crate::store::Store;
use brickyard_import::SourceInfo;
use brickyard_volume::Level;
use std::path::Path;
use std::sync::Arc;

/// Whether a store's coarser levels mix labels.
pub(super) fn are_mixed(store: &Store) -> bool {
    let methods = store.info().downsample;
    [Some(methods.main()), methods.second()].contains(&Some(Downsample::Mean))
}

/// An edit with its levels, before anything is made.
struct Planned {
    source: LevelSource,
    edited: Edited,
}

impl Planned {
    fn new(dir: &Path, edit: &Edit) -> Result<Self, EditError> {
        let store = Store::open_own(dir)?;
        let edited = Edited::of(store.folder(), edit)?;
        let nodata = store.info().nodata.map(|nodata| nodata as f64);
        let info = SourceInfo { nodata, ..edited.info.clone() };
        Ok(Self { source: LevelSource::new(Arc::new(store), Level(0), info), edited })
    }

    fn remake(&self, work: Work) -> Result<Remake<'_>, EditError> {
        let store = self.source.store();
        Ok(Remake::new(store, &self.source, "levels", Downsample::Mode.into(), Kind::Labels, work)?)
    }
}

/// Makes all checks of [`remake`], and changes nothing.
pub(super) fn rehearse(dir: &Path, edit: &Edit, work: Work) -> Result<EditReport, EditError> {
    let planned = Planned::new(dir, edit)?;
    planned.remake(work)?.rehearse()?;
    Ok(planned.edited.report(dir))
}

/// Edits a store to one of labels with new coarser levels.
pub(super) fn remake(disk: &Disk, dir: &Path, edit: &Edit, work: Work) -> Result<EditReport, EditError> {
    let planned = Planned::new(dir, edit)?;
    let edited = &planned.edited;
    planned.remake(work)?.run(disk, work.progress, &Kept::All, |_, _| {
        let info = parse_info(&dir.join("zarr.json"), &edited.root.document)?;
        Ok(Documents { info, root: edited.text.clone() })
    })?;
    Ok(planned.edited.report(dir))
}
