//! Which of a store's pyramids a mode is to be drawn from.
//!
//! The mean of eight voxels hides the greatest of them, so a maximum projection of a coarse level shows too little. A store
//! packed with `mean,max` has a second pyramid of maxima, in which the projection is right at every level; likewise with
//! `min`. Costs opening the store once more: milliseconds.

use crate::store::{Downsample, IoMode, OpenError, Store};
use brickyard_volume::Mode;

/// The same store, opened at the pyramid that suits the mode best.
///
/// # Errors
/// If the other pyramid does not open.
pub fn for_mode(store: Store, mode: Mode) -> Result<Store, OpenError> {
    let wanted = match mode {
        Mode::Mip => Downsample::Max,
        Mode::MinIp => Downsample::Min,
        Mode::Dvr | Mode::Average | Mode::Isosurface => return Ok(store),
    };
    if store.downsample() == wanted || store.info().downsample.second() != Some(wanted) {
        return Ok(store);
    }
    Store::open_reduced(store.path(), wanted, IoMode::default())
}
