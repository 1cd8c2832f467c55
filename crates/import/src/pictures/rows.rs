//! Rows of a picture's pixels as a decoder delivers them, and the rectangle of one channel which they fill.

use brickyard_volume::VoxelBox;

/// Colours of a palette, in order.
pub(super) struct Palette {
    colours: Vec<[u8; 3]>,
    /// Whether red, green and blue are equal in all colours: the pixels are gray then.
    pub(super) is_gray: bool,
}

impl Palette {
    pub(super) fn new(colours: Vec<[u8; 3]>) -> Self {
        let is_gray = colours.iter().all(|[r, g, b]| r == g && g == b);
        Self { colours, is_gray }
    }
}

/// Layout of pixels in a row.
pub(super) struct Pixels {
    /// Bits of a sample: 1, 2 and 4, the highest bits of a byte first; 8; or 16, the high byte first.
    pub(super) bits: u32,
    /// Samples from one pixel to the next.
    pub(super) samples: usize,
    /// The sample of each channel within a pixel.
    pub(super) order: Vec<usize>,
    /// Colours behind the samples.
    pub(super) palette: Option<Palette>,
}

/// A row's pixels: all, or those of a pass of an interlaced picture.
pub(super) struct Row<'a> {
    pub(super) y: u32,
    /// Column of the first pixel, and from one to the next.
    pub(super) first: u32,
    pub(super) step: u32,
    pub(super) bytes: &'a [u8],
}

/// A rectangle of one channel of a plane, filled row by row.
pub(super) struct Rectangle<'a> {
    region: VoxelBox,
    channel: usize,
    out: &'a mut [u8],
}

impl<'a> Rectangle<'a> {
    /// Creates the rectangle of a box along x and y. `out` has its size, in one plane.
    pub(super) fn new(region: VoxelBox, channel: usize, out: &'a mut [u8]) -> Self {
        Self { region, channel, out }
    }

    /// The rows of the rectangle.
    pub(super) fn rows(&self) -> std::ops::Range<u32> {
        self.region.min.y..self.region.max.y
    }

    /// Takes the pixels of a row that lie in the rectangle.
    ///
    /// # Errors
    /// A message if the row is too short, or a pixel has no colour in the palette.
    pub(super) fn take(&mut self, pixels: &Pixels, row: Row<'_>) -> Result<(), String> {
        let (min, max) = (self.region.min, self.region.max);
        if !self.rows().contains(&row.y) || row.first >= max.x {
            return Ok(());
        }
        let from = min.x.saturating_sub(row.first).div_ceil(row.step);
        let to = (max.x - row.first).div_ceil(row.step);
        let bits = u64::from(to) * pixels.samples as u64 * u64::from(pixels.bits);
        if bits.div_ceil(8) > row.bytes.len() as u64 {
            return Err(format!("row {} is too short", row.y));
        }
        let sample = match pixels.palette {
            Some(_) => 0,
            None => pixels.order[self.channel],
        };
        let voxel = if pixels.bits > 8 { 2 } else { 1 };
        let line_bytes = (max.x - min.x) as usize * voxel;
        let line = &mut self.out[(row.y - min.y) as usize * line_bytes..][..line_bytes];
        for i in from..to {
            let at = i as usize * pixels.samples + sample;
            let x = (row.first + i * row.step - min.x) as usize;
            if pixels.bits == 16 {
                let [high, low] = [row.bytes[2 * at], row.bytes[2 * at + 1]];
                line[2 * x..2 * x + 2].copy_from_slice(&[low, high]);
                continue;
            }
            let number = match pixels.bits as usize {
                8 => row.bytes[at],
                bits => {
                    let (byte, shift) = (row.bytes[at * bits / 8], 8 - bits - at * bits % 8);
                    byte >> shift & ((1 << bits) - 1)
                }
            };
            line[x] = match &pixels.palette {
                None => number,
                Some(palette) => {
                    let colour = palette.colours.get(usize::from(number)).ok_or_else(|| {
                        let (x, count) = (row.first + i * row.step, palette.colours.len());
                        format!("the pixel at {x},{} has colour {number} of a palette of {count}", row.y)
                    })?;
                    colour[self.channel]
                }
            };
        }
        Ok(())
    }
}
