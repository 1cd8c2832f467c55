//! Exact pictures by tiles: every brick of a view at its own level, however few slots there are, for any layers and any
//! renderer. The whole picture is tried first; a part without room for its cut is quartered, down to single pixels. A
//! tile's pixels are those of the whole picture: its rays are the same, and its cut is finer nowhere.
//!
//! Only a tile's pixels are drawn; a GPU clears and reads back its rows besides. Two tiles' common
//! bricks stay in their slots from one to the next, as room permits: tiles are neighbours in the order of a Z-curve.

use crate::pictures::offline::{OfflineError, POLL, give_up_after, within};
use crate::session::{Frame, ResolvedScene, Session};
use crate::stats::{RenderStats, ms};
use brickyard_volume::{Picture, PixelRect};
use std::time::{Duration, Instant};

/// Streams and draws an exact picture of a scene tile by tile, and adds to `stats`. `started` is the start of the whole
/// run. The eyes of a stereo pair are drawn in turn.
///
/// # Errors
/// If the session fails, `max_wait` passes first, or the bricks of a single pixel do not fit.
pub fn render_exact(
    session: &mut Session,
    scene: &ResolvedScene,
    max_wait: Duration,
    started: Instant,
    stats: &mut RenderStats,
) -> Result<Picture, OfflineError> {
    let (mut tiles, mut completeness, mut failed) = (0, 1.0, 0);
    let picture = within(session, max_wait, |session, begun| {
        let mut exact = Exact { session, max_wait, begun, stats, tiles, completeness, failed };
        let picture = scene.supersampled(|scene| {
            // Each sample has its own tiles.
            exact.tiles = 0;
            scene.picture(|eye| exact.eye(scene.of_eye(eye)))
        });
        (tiles, completeness, failed) = (exact.tiles, exact.completeness, exact.failed);
        picture
    })?;
    if stats.frames == 0 {
        (stats.first_image_ms, stats.settled_ms) = (ms(started), ms(started));
    }
    stats.frames += 1;
    stats.device_losses = session.device_losses();
    (stats.tiles, stats.completeness, stats.bricks.failed) = (Some(tiles), completeness, failed);
    Ok(picture)
}

/// An exact picture in the making.
struct Exact<'a> {
    session: &'a mut Session,
    max_wait: Duration,
    begun: Instant,
    stats: &'a mut RenderStats,
    /// Tiles drawn; the least completeness and the most failed cells of any.
    tiles: usize,
    completeness: f64,
    failed: u64,
}

impl Exact<'_> {
    fn eye(&mut self, mut scene: ResolvedScene) -> Result<Picture, OfflineError> {
        let whole = scene.layers[0].view.rays.whole();
        let (width, height) = (whole.x1, whole.y1);
        let mut picture = Picture { width, height, rgb: vec![[0; 3]; width as usize * height as usize] };
        let mut tiles = vec![whole];
        while let Some(tile) = tiles.pop() {
            scene.layers.iter_mut().for_each(|layer| layer.view.window = Some(tile));
            let frame = self.settle(&scene)?;
            let status = &frame.status;
            if !status.memory_bound {
                copy(tile, &self.session.draw(&frame)?, &mut picture);
                self.tiles += 1;
                self.completeness = self.completeness.min(status.completeness);
                self.failed = self.failed.max(status.failed as u64);
                continue;
            }
            let quarters = quarters(tile);
            if quarters.len() < 2 {
                return Err(OfflineError::Pixel { x: tile.x0, y: tile.y0, slots: self.session.slots() });
            }
            tiles.extend(quarters.into_iter().rev());
        }
        Ok(picture)
    }

    /// Streams until all of the scene's bricks are resident, or clearly do not fit.
    fn settle(&mut self, scene: &ResolvedScene) -> Result<Frame, OfflineError> {
        loop {
            let frame = self.session.step_resolved(scene)?;
            self.stats.record(&frame.status, self.session.backend_bytes());
            if frame.status.settled || frame.status.memory_bound {
                return Ok(frame);
            }
            give_up_after(self.begun, self.max_wait, &frame.status)?;
            self.session.wait(POLL);
        }
    }
}

fn quarters(PixelRect { x0, x1, y0, y1 }: PixelRect) -> Vec<PixelRect> {
    let (x, y) = (x0.midpoint(x1), y0.midpoint(y1));
    let quarter = |(x0, x1, y0, y1)| PixelRect { x0, x1, y0, y1 };
    let all = [(x0, x, y0, y), (x, x1, y0, y), (x0, x, y, y1), (x, x1, y, y1)].map(quarter);
    all.into_iter().filter(|tile| tile.x0 < tile.x1 && tile.y0 < tile.y1).collect()
}

fn copy(PixelRect { x0, x1, y0, y1 }: PixelRect, from: &Picture, to: &mut Picture) {
    for y in y0..y1 {
        let row = [x0, x1].map(|x| y as usize * to.width as usize + x as usize);
        to.rgb[row[0]..row[1]].copy_from_slice(&from.rgb[row[0]..row[1]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_cover_a_tile_once_down_to_its_pixels() {
        let mut tiles = vec![PixelRect { x0: 3, x1: 10, y0: 5, y1: 18 }];
        let mut pixels = Vec::new();
        while let Some(tile) = tiles.pop() {
            match &quarters(tile)[..] {
                [_] => pixels.push((tile.x0, tile.y0)),
                several => tiles.extend_from_slice(several),
            }
        }
        pixels.sort_unstable();
        let expected: Vec<_> = (3..10).flat_map(|x| (5..18).map(move |y| (x, y))).collect();
        assert_eq!(pixels, expected);
    }
}
