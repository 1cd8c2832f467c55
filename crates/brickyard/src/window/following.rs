//! Following a growing store: a thread checks once a second for time steps appended by another program, and then
//! reopens the store. Each check reads the store's root document; the shown one is unaffected.

use crate::session::volume_source::VolumeSource;
use brickyard_store::Store;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use std::sync::Arc;
use std::time::Duration;

/// Interval between checks of a store.
const INTERVAL: Duration = Duration::from_secs(1);

/// Follows a store until dropped, which does not wait for a check in progress.
pub struct Follower {
    grown: Receiver<VolumeSource>,
    /// Dropping it ends the thread, possibly a moment later.
    _stop: Sender<()>,
}

impl Follower {
    /// Starts following a store; `None` for a store without a time axis, to which nothing can be appended.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn start(store: &Arc<Store>) -> std::io::Result<Option<Self>> {
        Self::every(INTERVAL, store)
    }

    fn every(interval: Duration, store: &Arc<Store>) -> std::io::Result<Option<Self>> {
        if !store.can_grow() {
            return Ok(None);
        }
        let (send, grown) = bounded(0);
        let (stop, is_over) = bounded(0);
        let store = store.clone();
        let follow = move || look(store, interval, &send, &is_over);
        std::thread::Builder::new().name("brickyard-follow".into()).spawn(follow)?;
        Ok(Some(Self { grown, _stop: stop }))
    }

    /// Returns the store with newly appended time steps, without waiting; `None` if there are none.
    pub fn poll(&self) -> Option<VolumeSource> {
        self.grown.try_recv().ok()
    }
}

/// Checks a store until stopped or without a receiver.
fn look(mut store: Arc<Store>, interval: Duration, grown: &Sender<VolumeSource>, is_over: &Receiver<()>) {
    let mut problem = String::new();
    while is_over.recv_timeout(interval) == Err(RecvTimeoutError::Timeout) {
        match store.newer() {
            Ok(Some(newer)) => {
                store = Arc::new(newer);
                if grown.send(VolumeSource::of_store(&store)).is_err() {
                    return;
                }
            }
            Ok(None) => {}
            // The open store stays; a failing disk may be back at the next check.
            Err(error) => {
                let said = error.to_string();
                if said != problem {
                    tracing::warn!("the store is not followed: {said}");
                    problem = said;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_import::{OpenOptions, Source};
    use brickyard_store::{Appender, PackOptions, pack};
    use brickyard_volume::{Extent, VoxelType};
    use std::path::Path;
    use std::time::Instant;

    fn volume(folder: &Path, value: u8) -> Box<dyn Source> {
        let path = folder.join(format!("{value}.raw"));
        std::fs::write(&path, vec![value; 20 * 10 * 5]).unwrap();
        let (shape, voxel_type) = (Some(Extent::new(20, 10, 5)), Some(VoxelType::U8.into()));
        brickyard_import::open(&[path], &OpenOptions { shape, voxel_type, ..OpenOptions::default() }).unwrap()
    }

    fn next(follower: &Follower) -> VolumeSource {
        let begun = Instant::now();
        loop {
            if let Some(volume) = follower.poll() {
                return volume;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "nothing came");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn steps_that_are_appended_come() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.zarr");
        let first = volume(folder.path(), 1);
        let mut appender = Appender::create(&path, &*first, None, &PackOptions::new(VoxelType::U8), &()).unwrap();
        let store = Arc::new(Store::open(&path).unwrap());
        let follower = Follower::every(Duration::from_millis(5), &store).unwrap().expect("it can grow");
        assert!(follower.poll().is_none());
        for steps in 2..5 {
            appender.append(&*volume(folder.path(), steps), None, &()).unwrap();
            let grown = next(&follower);
            assert_eq!(grown.source.times(), u32::from(steps));
            assert_eq!(grown.source.channel_range(0), (1.0, f64::from(steps)));
        }
        // A thread blocked on its send ends as well.
        appender.append(&*volume(folder.path(), 9), None, &()).unwrap();
        std::thread::sleep(Duration::from_millis(50));
        drop(follower);
    }

    #[test]
    fn what_cannot_grow_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.zarr");
        pack(&*volume(folder.path(), 1), &path, &PackOptions::new(VoxelType::U8), &()).unwrap();
        let store = Arc::new(Store::open(&path).unwrap());
        assert!(Follower::start(&store).unwrap().is_none());
    }
}
