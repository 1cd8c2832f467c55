//! Lines on standard error while coarse levels of other programs' images are made: the first picture waits for them.

use super::say::{is_quiet, say};
use brickyard::store::Store;
use std::sync::{Arc, Weak};
use std::time::Duration;

/// Time between two looks, and between two lines.
const LOOK: Duration = Duration::from_millis(250);
const LINE: Duration = Duration::from_secs(4);

/// Shorter waits are not told.
const SHORT: Duration = Duration::from_secs(2);

/// Tells of levels under way in these stores, as long as one is open.
pub(crate) fn tell(stores: &[Arc<Store>]) {
    let stores: Vec<Weak<Store>> = stores.iter().filter(|store| store.is_foreign()).map(Arc::downgrade).collect();
    if stores.is_empty() || is_quiet() {
        return;
    }
    // It ends with the stores, or the process.
    std::thread::spawn(move || {
        let mut since_line = LINE;
        loop {
            std::thread::sleep(LOOK);
            since_line += LOOK;
            let open: Vec<Arc<Store>> = stores.iter().filter_map(Weak::upgrade).collect();
            if open.is_empty() {
                return;
            }
            let making = |store: &Arc<Store>| Some((store.path().display().to_string(), store.making()?));
            let long = open.iter().filter_map(making).find(|(_, making)| making.elapsed >= SHORT);
            if let Some((path, making)) = long.filter(|_| since_line >= LINE) {
                since_line = Duration::ZERO;
                say!("{path}: {making}");
            }
        }
    });
}
