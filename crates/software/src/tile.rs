//! One tile of the picture, from its rays to its pixels: slab by slab if there are meshes, by a single layer, several
//! projected one by one, or several together.

use crate::choice::Choice;
use crate::compositing::JointMarch;
use crate::frame::Frame;
use crate::march::{MarchTile, Seen, Work};
use crate::meshes::{MeshLayers, MeshTree};
use crate::mixture::{OPAQUE, Projections};
use crate::sample::SampleChunk;
use crate::tiles::{PIXELS, Tile, TilePixels, places};
use brickyard_volume::{Blend, Combination, Picture};
use glam::Vec4;

/// Bytes of a drawing thread besides the frames.
pub(crate) const BYTES_PER_THREAD: u64 = (size_of::<Work>()
    + size_of::<Seen>()
    + size_of::<[Projections; PIXELS]>()
    + size_of::<TilePixels>()
    + size_of::<SampleChunk>()) as u64;

/// The scene as shared by all tiles of a picture.
pub(crate) struct Scene<'a> {
    frames: Vec<Frame<'a>>,
    meshes: Option<&'a MeshTree>,
    drawn: Drawn<'a>,
}

/// How the layers are drawn: alone, projected one by one, or together.
enum Drawn<'a> {
    Single(MarchTile),
    Projected(Vec<MarchTile>),
    Joint(JointMarch<'a>),
}

impl<'a> Scene<'a> {
    /// The scene of these layers' frames, or of an expression over the layers. Unless the scene is mixed, it draws the
    /// first frame alone.
    pub(crate) fn new(
        frames: Vec<Frame<'a>>,
        meshes: Option<&'a MeshTree>,
        is_mixed: bool,
        is_one_cut: bool,
        combination: Option<&'a Combination>,
    ) -> Self {
        let alone = |frame: &Frame<'_>| frame.for_machine(&frame.settings.encoding);
        let drawn = if !is_mixed {
            Drawn::Single(alone(&frames[0]))
        } else if frames[0].settings.mode.is_projection() {
            Drawn::Projected(frames.iter().map(alone).collect())
        } else {
            Drawn::Joint(JointMarch::new(&frames, combination, is_one_cut))
        };
        Self { frames, meshes, drawn }
    }

    pub(crate) fn frames(&self) -> &[Frame<'a>] {
        &self.frames
    }

    /// Draws a tile: its pixels over the background. A call of its own, like [`Work::new`].
    #[inline(never)]
    pub(crate) fn draw(&self, tile: &Tile, work: &mut Work) -> TilePixels {
        let settings = self.frames[0].settings;
        let mut seen = [Vec4::W; PIXELS];
        let mut slabs = self.meshes.map(|tree| (tree, MeshLayers::new(&settings.rays, tile)));
        loop {
            if let Some((tree, layers)) = &mut slabs {
                tree.peel(settings, tile, layers);
            }
            self.march(tile, slabs.as_ref().map(|(_, layers)| &**layers), work, &mut seen);
            let Some((_, layers)) = &mut slabs else { break };
            let mut is_more = false;
            for i in places(tile) {
                is_more |= layers.compose(i, seen[i]);
            }
            if !is_more {
                break;
            }
        }
        let mut pixels = [[0; 3]; PIXELS];
        for i in places(tile) {
            let seen = slabs.as_ref().map_or(seen[i], |(_, layers)| layers.color(i));
            let [r, g, b] = settings.background;
            pixels[i] = Picture::quantise([seen.x + seen.w * r, seen.y + seen.w * g, seen.z + seen.w * b]);
        }
        pixels
    }

    /// Takes the tile's rays through the layers, in a slab between two layers of meshes if any.
    fn march(&self, tile: &Tile, layers: Option<&MeshLayers>, work: &mut Work, seen: &mut Seen) {
        match &self.drawn {
            Drawn::Single(march) => march.march(&self.frames[0], tile, layers, work, seen),
            Drawn::Joint(together) => together.march(&self.frames, tile, layers, &mut work.rays, seen),
            Drawn::Projected(marches) => {
                let mut shown = [Projections::default(); PIXELS];
                for (frame, march) in self.frames.iter().zip(marches) {
                    march.march(frame, tile, layers, work, seen);
                    let depth = if frame.opacity < 1.0 { -(1.0 - frame.opacity).log2() } else { OPAQUE };
                    // A projection's pixel is opaque, or nothing.
                    for i in places(tile).filter(|&i| seen[i].w < 1.0) {
                        match frame.blend {
                            Blend::Mix => shown[i].mix(seen[i], depth),
                            Blend::Add => shown[i].emission += seen[i] * frame.opacity,
                            Blend::Over => shown[i].put_over(seen[i], frame.opacity),
                        }
                    }
                }
                places(tile).for_each(|i| seen[i] = shown[i].seen());
            }
        }
    }
}
