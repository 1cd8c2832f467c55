//! A picture to be drawn: frames and draw lists of some volumes. The oracle draws it once, and then it is compared with what each renderer
//! makes of it.

use crate::stage::{Stage, Way, placed};
use crate::volume::Volume;
use brickyard::pager::{DrawList, Layer};
use brickyard::reference::{ReferenceVolume, pixel};
use brickyard::volume::*;
use brickyard_tests::sample::{draws, seed};
use glam::DVec3;
use std::collections::BTreeSet;

/// In 1/255. Slots hold exactly the oracle's values. Renderer and oracle take the same samples: interpolation, opacity and sums in f32 leave
/// less than a tenth of a step, and rounding to 8 bits turns that into at most one.
const TOLERANCE: u8 = 1;

/// What is to be drawn, layer by layer.
pub(crate) struct Shot<'a> {
    pub(crate) frames: Vec<VolumeFrame>,
    pub(crate) lists: Vec<DrawList>,
    pub(crate) transfers: Vec<&'a TransferFunction>,
    pub(crate) combination: Option<&'a Combination>,
    /// Whether each layer has a cut of its own, though some could share one.
    pub(crate) is_apart: bool,
}

impl<'a> Shot<'a> {
    /// One volume by itself.
    pub(crate) fn new(frame: &FrameSettings, list: DrawList, transfer: &'a TransferFunction) -> Self {
        let frames = vec![VolumeFrame::alone(frame.clone())];
        Self { frames, lists: vec![list], transfers: vec![transfer], combination: None, is_apart: false }
    }

    /// What it needs of bricks.
    pub(crate) fn needs(&self) -> Needs {
        self.frames.iter().map(|frame| frame.settings.needs()).reduce(Needs::union).expect("a layer")
    }

    /// Which cut a layer is of: that of the first with its grid and place.
    fn cut(&self, layer: usize) -> u32 {
        let grid = |frame: &VolumeFrame| (frame.settings.geometry.clone(), frame.settings.placement);
        let is_of = |frame: &VolumeFrame| !self.is_apart && grid(frame) == grid(&self.frames[layer]);
        self.frames.iter().position(is_of).unwrap_or(layer) as u32
    }

    /// A renderer's picture; `None` where there is no adapter at all.
    pub(crate) fn render(&self, stage: &mut Stage<'_>, way: Way) -> Option<Picture> {
        let lists: Vec<DrawList> =
            self.lists.iter().enumerate().map(|(i, list)| placed(list, i, self.lists.len())).collect();
        let all = (0..).zip(&self.frames).zip(&lists).zip(stage.volumes.clone());
        let layers: Vec<Layer<'_>> = all
            .map(|(((volume, frame), draw), of)| Layer {
                volume,
                frame,
                pyramid: &of.pyramid,
                draw,
                cut: self.cut(volume),
            })
            .collect();
        let picture = stage.renderer(way, &self.needs())?.render(&layers, self.combination);
        Some(picture.unwrap_or_else(|error| panic!("{way:?}: {error}")))
    }

    /// The oracle's picture.
    pub(crate) fn oracle(&self, volumes: &[&Volume]) -> Picture {
        let levels: Vec<Levels<'_>> = volumes.iter().zip(&self.lists).map(|(v, list)| Levels::new(v, list)).collect();
        let color = |x: u32, y: u32| {
            let level_at: Vec<_> = levels.iter().map(|levels| move |point| levels.at(point, x, y)).collect();
            let mut seen = Vec::new();
            for ((volume, level_at), transfer) in volumes.iter().zip(&level_at).zip(&self.transfers) {
                seen.push(ReferenceVolume { levels: &volume.levels, level_at, transfer });
            }
            Picture::quantise(pixel(&self.frames, &seen, self.combination, x, y).map(|c| c as f32))
        };
        let ViewRays { width, height, .. } = self.frames[0].settings.rays;
        Picture {
            width,
            height,
            rgb: (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| color(x, y)).collect(),
        }
    }

    /// Draws it by the oracle and these ways, and compares; all pixels but so many must be the same.
    pub(crate) fn agree(&self, stage: &mut Stage<'_>, ways: &[Way], allowed: usize, what: &str) {
        let expected = self.oracle(&stage.volumes);
        assert_telling(&expected, what);
        self.agree_with(&expected, stage, ways, allowed, what);
    }

    /// Draws it by these ways and compares with the oracle's picture `expected`. Of the cases on a GPU it draws the seed's third.
    pub(crate) fn agree_with(
        &self,
        expected: &Picture,
        stage: &mut Stage<'_>,
        ways: &[Way],
        allowed: usize,
        what: &str,
    ) {
        for &way in ways {
            let what = format!("{what}, {way:?}");
            if !draws(&what, way) {
                continue;
            }
            let Some(found) = self.render(stage, way) else { continue };
            assert_close(&found, expected, allowed, &format!("{what}, seed {:x}", seed()));
        }
    }
}

/// Which level places have in a list.
struct Levels<'a> {
    list: &'a DrawList,
    extent: Extent,
    /// For each voxel the first entry of its cell.
    first: Vec<u32>,
}

impl<'a> Levels<'a> {
    fn new(volume: &Volume, list: &'a DrawList) -> Self {
        let extent = volume.levels[0].extent;
        let mut first = vec![u32::MAX; extent.volume() as usize];
        for (i, cell) in list.cells.iter().enumerate().rev() {
            let (low, high) = (cell.region.min, cell.region.max);
            for z in low.z..high.z {
                for y in low.y..high.y {
                    let row = extent.linear([low.x, y, z]) as usize;
                    first[row..row + (high.x - low.x) as usize].fill(i as u32);
                }
            }
        }
        Self { list, extent, first }
    }

    /// The level of a place in a pixel; where a list has nothing there is nothing to see.
    fn at(&self, point: DVec3, x: u32, y: u32) -> usize {
        // Rounding may put the last sample of a ray a hair outside.
        let n = self.extent.to_array();
        let voxel = std::array::from_fn(|a| (point[a].max(0.0) as u32).min(n[a] - 1));
        let first = self.first[self.extent.linear(voxel) as usize] as usize;
        let mut entries = self.list.cells.iter().skip(first);
        entries.find(|entry| entry.pixels.hold(x, y)).map_or(0, |entry| entry.brick.level.index())
    }
}

/// How many pixels are past the tolerance.
pub(crate) fn pixels_off(found: &Picture, expected: &Picture) -> usize {
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
    found.rgb.iter().zip(&expected.rgb).filter(is_off).count()
}

/// All pixels but so many are within the tolerance.
pub(crate) fn assert_close(found: &Picture, expected: &Picture, allowed: usize, what: &str) {
    let off = pixels_off(found, expected);
    assert!(off <= allowed, "{what}: {off} pixels of {}, {:?}", found.rgb.len(), found.difference(expected));
}

/// There is something to be seen.
pub(crate) fn assert_telling(picture: &Picture, what: &str) {
    let colors: BTreeSet<_> = picture.rgb.iter().collect();
    assert!(colors.len() > 20, "{what}: a flat picture proves nothing");
}
