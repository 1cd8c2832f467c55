//! A shot: frames and draw lists of some volumes. The oracle draws it once, for comparison with each renderer's picture.

use crate::stage::{Stage, Way, placed};
use crate::volume::Volume;
use brickyard::pager::{DrawList, Layer};
use brickyard::reference::{ReferenceVolume, pixel};
use brickyard::volume::*;
use brickyard_tests::sample::{draws, seed};
use glam::DVec3;
use std::collections::BTreeSet;

/// In 1/255. Slots hold exactly the oracle's values. Renderer and oracle take the same samples: f32 interpolation, opacity and sums leave
/// less than a tenth of a step, which rounding to 8 bits turns into at most one.
const TOLERANCE: u8 = 1;

/// The frames, lists and transfer functions of a picture, layer by layer.
pub(crate) struct Shot<'a> {
    pub(crate) frames: Vec<VolumeFrame>,
    pub(crate) lists: Vec<DrawList>,
    pub(crate) transfers: Vec<&'a TransferFunction>,
    pub(crate) combination: Option<&'a Combination>,
    /// Whether each layer has its own cut, although some could share one.
    pub(crate) is_apart: bool,
}

impl<'a> Shot<'a> {
    /// A single volume.
    pub(crate) fn new(frame: &FrameSettings, list: DrawList, transfer: &'a TransferFunction) -> Self {
        let frames = vec![VolumeFrame::alone(frame.clone())];
        Self { frames, lists: vec![list], transfers: vec![transfer], combination: None, is_apart: false }
    }

    /// Its requirements of bricks.
    pub(crate) fn needs(&self) -> Needs {
        self.frames.iter().map(|frame| frame.settings.needs()).reduce(Needs::union).expect("a layer")
    }

    /// A layer's cut: that of the first layer with the same grid and place.
    fn cut(&self, layer: usize) -> u32 {
        let grid = |frame: &VolumeFrame| (frame.settings.geometry.clone(), frame.settings.placement);
        let is_of = |frame: &VolumeFrame| !self.is_apart && grid(frame) == grid(&self.frames[layer]);
        self.frames.iter().position(is_of).unwrap_or(layer) as u32
    }

    /// A renderer's picture; `None` without an adapter.
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

    /// Compares these ways' pictures with the oracle's; at most `allowed` pixels may differ.
    pub(crate) fn agree(&self, stage: &mut Stage<'_>, ways: &[Way], allowed: usize, what: &str) {
        let expected = self.oracle(&stage.volumes);
        assert_telling(&expected, what);
        self.agree_with(&expected, stage, ways, allowed, what);
    }

    /// Compares these ways' pictures with the oracle's picture `expected`. Draws a third of the cases on a GPU, by the seed.
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

/// Levels of places in a list.
struct Levels<'a> {
    list: &'a DrawList,
    extent: Extent,
    /// For each voxel, the first entry of its cell.
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

    /// The level of a place in a pixel; nothing is visible outside the list.
    fn at(&self, point: DVec3, x: u32, y: u32) -> usize {
        // Rounding may put a ray's last sample a hair outside.
        let n = self.extent.to_array();
        let voxel = std::array::from_fn(|a| (point[a].max(0.0) as u32).min(n[a] - 1));
        let first = self.first[self.extent.linear(voxel) as usize] as usize;
        let mut entries = self.list.cells.iter().skip(first);
        entries.find(|entry| entry.pixels.hold(x, y)).map_or(0, |entry| entry.brick.level.index())
    }
}

/// The number of pixels past the tolerance.
pub(crate) fn pixels_off(found: &Picture, expected: &Picture) -> usize {
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
    found.rgb.iter().zip(&expected.rgb).filter(is_off).count()
}

/// Asserts that at most `allowed` pixels exceed the tolerance.
pub(crate) fn assert_close(found: &Picture, expected: &Picture, allowed: usize, what: &str) {
    let off = pixels_off(found, expected);
    assert!(off <= allowed, "{what}: {off} pixels of {}, {:?}", found.rgb.len(), found.difference(expected));
}

/// Asserts that the picture is not flat.
pub(crate) fn assert_telling(picture: &Picture, what: &str) {
    let colors: BTreeSet<_> = picture.rgb.iter().collect();
    assert!(colors.len() > 20, "{what}: a flat picture proves nothing");
}
