//! Pictures of nearest-voxel reads, where rounding decides which of two voxels a place is in.

use brickyard::volume::{Camera, Picture, Scene};
use glam::DVec3;
use std::cell::OnceCell;

/// The pixels in which a picture is more than 1/255 off.
pub fn off(found: &Picture, expected: &Picture) -> Vec<usize> {
    let is_off = |i: &usize| (0..3).any(|k| found.rgb[*i][k].abs_diff(expected.rgb[*i][k]) > 1);
    (0..found.rgb.len()).filter(is_off).collect()
}

/// The oracle's pictures of a scene: from its camera, and lazily from a thousandth of a voxel beside it.
pub struct Expected<'a> {
    draw: &'a dyn Fn(&Scene) -> Picture,
    scene: &'a Scene,
    /// The picture from the scene's own camera.
    pub exact: Picture,
    near: OnceCell<Vec<Picture>>,
}

impl<'a> Expected<'a> {
    /// Draws a scene with a camera; `draw` is the oracle.
    ///
    /// # Panics
    /// If its picture is a single colour: then the test would be empty.
    pub fn new(scene: &'a Scene, draw: &'a dyn Fn(&Scene) -> Picture) -> Self {
        let exact = draw(scene);
        assert!(exact.rgb.iter().any(|p| *p != exact.rgb[0]), "the expected picture is one flat colour");
        Self { draw, scene, exact, near: OnceCell::new() }
    }

    fn near(&self) -> &[Picture] {
        self.near.get_or_init(|| {
            let camera = self.scene.camera.expect("a scene of these tests has one");
            let by = [-1e-3, 1e-3].into_iter().flat_map(|by| DVec3::AXES.map(|axis| axis * by));
            let moved = by.map(|by| Camera { eye: camera.eye + by, target: camera.target + by, ..camera });
            moved.map(|camera| (self.draw)(&Scene { camera: Some(camera), ..self.scene.clone() })).collect()
        })
    }

    /// Asserts that a picture equals the oracle's in all but a thousandth of the pixels, and in those the oracle's from a thousandth of a voxel
    /// away: there rounding decides which of two voxels a place is in.
    ///
    /// # Panics
    /// If it does not, or the scene has no camera. `what` names the case in messages.
    pub fn assert_shown(&self, found: &Picture, what: &str) {
        let mut left = off(found, &self.exact);
        assert!(left.len() * 1000 <= found.rgb.len(), "{what}: {} pixels of {} are off", left.len(), found.rgb.len());
        if left.is_empty() {
            return;
        }
        for near in self.near() {
            let off = off(found, near);
            left.retain(|i| off.contains(i));
        }
        let seen: Vec<_> = left.iter().map(|&i| (found.rgb[i], self.exact.rgb[i])).collect();
        assert!(left.is_empty(), "{what}: nowhere near the oracle's at {left:?}: {seen:?}");
    }
}
