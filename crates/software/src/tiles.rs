//! Tiles of the picture: squares of pixels, drawn one by one by the threads.

use brickyard_volume::Picture;

/// Pixels along a tile's edge: few enough for the state of a tile's rays to stay in the first-level cache, and for all
/// threads to find tiles.
pub(crate) const TILE_PX: u32 = 16;

pub(crate) const PIXELS: usize = (TILE_PX * TILE_PX) as usize;

/// A tile's place on the picture.
pub(crate) type Tile = brickyard_volume::PixelRect;

/// A tile's pixels in rows of [`TILE_PX`], even where the picture ends within the tile.
pub(crate) type TilePixels = [[u8; 3]; PIXELS];

pub(crate) fn tiles(width: u32, height: u32) -> impl Iterator<Item = Tile> {
    let starts = |n: u32| (0..n).step_by(TILE_PX as usize);
    starts(height).flat_map(move |y0| {
        let y1 = height.min(y0 + TILE_PX);
        starts(width).map(move |x0| Tile { x0, x1: width.min(x0 + TILE_PX), y0, y1 })
    })
}

pub(crate) fn picture((width, height): (u32, u32), tiles: &[Tile], drawn: &[TilePixels]) -> Picture {
    let mut picture = Picture { width, height, rgb: vec![[0; 3]; width as usize * height as usize] };
    tiles.iter().zip(drawn).for_each(|(tile, pixels)| put(&mut picture, tile, pixels));
    picture
}

pub(crate) fn put(picture: &mut Picture, tile: &Tile, pixels: &TilePixels) {
    for (y, row) in (tile.y0..tile.y1).zip(pixels.chunks_exact(TILE_PX as usize)) {
        let start = y as usize * picture.width as usize + tile.x0 as usize;
        let n = (tile.x1 - tile.x0) as usize;
        picture.rgb[start..start + n].copy_from_slice(&row[..n]);
    }
}

/// The indices of a tile's pixels in [`TilePixels`], row by row.
pub(crate) fn places(tile: &Tile) -> impl Iterator<Item = usize> {
    let Tile { x0, x1, y0, y1 } = *tile;
    (0..y1 - y0).flat_map(move |y| (0..x1 - x0).map(move |x| (y * TILE_PX + x) as usize))
}

#[inline(always)]
pub(crate) fn place(tile: &Tile, x: u32, y: u32) -> usize {
    ((y - tile.y0) * TILE_PX + x - tile.x0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_picture_once() {
        let mut seen = vec![0; 50 * 17];
        for tile in tiles(50, 17) {
            for (x, y) in (tile.y0..tile.y1).flat_map(|y| (tile.x0..tile.x1).map(move |x| (x, y))) {
                seen[(y * 50 + x) as usize] += 1;
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
    }
}
