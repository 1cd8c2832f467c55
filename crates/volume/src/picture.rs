//! A finished picture, a renderer's settings for it, and the difference of two pictures.

use crate::camera::ViewRays;
use crate::clip::Clip;
use crate::extremes;
use crate::geometry::Geometry;
use crate::lattice::Lattice;
use crate::lighting::Lighting;
use crate::mesh::{MeshCapacity, ShownMesh};
use crate::mode::Mode;
use crate::placement::Placement;
use crate::sampling::{Filter, Method, Needs, Sampling};
use crate::slot_encoding::SlotEncoding;
use crate::space::Extent;
use crate::surface::Surface;
use crate::transfer::{TransferGrid, TransferTable};
use glam::DVec3;
use std::sync::Arc;

/// All settings of a frame besides its bricks, resolved for one picture size. Every renderer takes exactly these.
#[derive(Clone, Debug)]
pub struct FrameSettings {
    /// The rays of the picture's pixels.
    pub rays: ViewRays,
    /// The sampling lattice of rays.
    pub lattice: Lattice,
    /// Spacing, origin and unit of the volume in its own world.
    pub geometry: Geometry,
    /// Map from the volume's own world to the world of the rays.
    pub placement: Placement,
    /// Mapping between slot codes and values.
    pub encoding: SlotEncoding,
    /// Colour and opacity per code.
    pub table: Arc<TransferTable>,
    /// The rendering mode.
    pub mode: Mode,
    /// The volume's isosurfaces, for [`Mode::Isosurface`] and [`Mode::Dvr`]: at most [`MAX_SURFACES`](crate::surface::MAX_SURFACES), in the order of
    /// their values.
    pub surfaces: Vec<Surface>,
    /// The field's filter, and the sampling of [`Mode::Dvr`]'s segments.
    pub sampling: Sampling,
    /// Lighting of surfaces and of [`Mode::Dvr`]'s fog.
    pub lighting: Lighting,
    /// Colour behind the volume, display-referred.
    pub background: [f32; 3],
    /// The shown part of the volume, in its own world; `None` is everything.
    pub clip: Option<Clip>,
    /// Whether isosurfaces are capped where the clip opens them: see [`CutFace`](crate::CutFace).
    pub caps: bool,
    /// Meshes of the picture, in the world of the rays; none of them has opacity 0.
    pub meshes: Vec<ShownMesh>,
    /// Whether the mode is a projection of extremes, and voxels of coarse levels are the extremes of finer ones: see [`extremes`].
    pub keeps_extremes: bool,
}

impl FrameSettings {
    /// Reach of segments' [boxes](extremes) in a level's bricks, in voxels of the level, with `factor` level-0 voxels along each axis; `None` if the
    /// scene's filter reads it.
    pub fn box_reach(&self, factor: [u32; 3]) -> Option<[f64; 3]> {
        (self.keeps_extremes && factor != [1; 3]).then(|| extremes::reach(self.sampling.filter, factor))
    }

    /// The picture's requirements on bricks and the tables beside them.
    pub fn needs(&self) -> Needs {
        let meshes = MeshCapacity::of(self.meshes.iter().map(|shown| &*shown.mesh));
        let (has_surfaces, has_grid) = (!self.surfaces.is_empty(), self.grid().is_some());
        Needs { meshes, ..Needs::new(self.mode, self.sampling, &self.lighting, has_surfaces, has_grid) }
    }

    /// Sampling method of fog's segments: labels are read in the middle of a segment, whatever the scene's method.
    pub fn method(&self) -> Method {
        if self.encoding.is_labels { Method::Udvr } else { self.sampling.method }
    }

    /// Whether all samples are whole numbers: labels, and unmixed integers.
    pub fn has_whole_values(&self) -> bool {
        let is_nearest = self.sampling.filter == Filter::Nearest;
        self.encoding.is_labels || is_nearest && !self.encoding.voxel_type.is_float()
    }

    /// The table of value and gradient magnitude for classifying fog; `None` for classification by value alone, or outside [`Mode::Dvr`].
    pub fn grid(&self) -> Option<&TransferGrid> {
        self.table.grid.as_deref().filter(|_| self.mode == Mode::Dvr)
    }

    /// Whether the volume shows only one opaque surface, with the default lighting from the eye. Such frames have shaders of their own.
    pub fn is_one_opaque_surface(&self) -> bool {
        let is_lit_from_the_eye = self.lighting == Lighting::default();
        let is_opaque = matches!(&self.surfaces[..], [surface] if surface.opacity >= 1.0);
        self.mode == Mode::Isosurface && is_opaque && is_lit_from_the_eye
    }

    /// The shown box of a volume of this extent: its lower and upper corner in level-0 voxels; if nothing is shown, low is not below high. Clip
    /// planes may cut away more.
    pub fn shown_box(&self, extent: Extent) -> (DVec3, DVec3) {
        let (low, high) = (DVec3::ZERO, DVec3::from_array(extent.to_array().map(f64::from)));
        let Some(clip) = &self.clip else { return (low, high) };
        let clip = clip.corners().map(|corner| self.geometry.voxel_from_world(corner));
        (low.max(clip[0]), high.min(clip[1]))
    }
}

/// A picture: 8-bit RGB, row 0 on top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// `width * height` pixels, row-major.
    pub rgb: Vec<[u8; 3]>,
}

impl Picture {
    /// Rounds a display-referred colour to 8-bit codes, clamped to 0..=1.
    pub fn quantise(color: [f32; 3]) -> [u8; 3] {
        color.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
    }

    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        self.rgb[y as usize * self.width as usize + x as usize]
    }

    /// Returns the pixels as opaque RGBA for textures.
    pub fn rgba(&self) -> Vec<u8> {
        self.rgb.iter().flat_map(|[r, g, b]| [*r, *g, *b, u8::MAX]).collect()
    }

    /// Compares two pictures of the same size.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn difference(&self, other: &Self) -> Difference {
        assert_eq!((self.width, self.height), (other.width, other.height), "sizes differ");
        let mut max = 0;
        let mut squares = 0u64;
        for (a, b) in self.rgb.iter().flatten().zip(other.rgb.iter().flatten()) {
            let d = a.abs_diff(*b);
            max = max.max(d);
            squares += (d as u64).pow(2);
        }
        let mean = squares as f64 / (self.rgb.len() * 3) as f64;
        Difference { max, psnr_db: 10.0 * (255.0f64 * 255.0 / mean).log10() }
    }
}

/// The difference of two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Greatest difference of any channel of any pixel, in 1/255.
    pub max: u8,
    /// Peak signal-to-noise ratio over all channels, in decibels; infinite for equal pictures.
    pub psnr_db: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_measured_per_channel() {
        let a = Picture { width: 2, height: 1, rgb: vec![[0; 3], [10, 20, 30]] };
        let mut b = a.clone();
        assert_eq!(a.difference(&b).psnr_db, f64::INFINITY);
        b.rgb[1][2] = 33;
        let d = a.difference(&b);
        assert_eq!(d.max, 3);
        assert!((d.psnr_db - 10.0 * (255.0f64.powi(2) * 6.0 / 9.0).log10()).abs() < 1e-9);
    }

    #[test]
    fn colours_round_to_nearest() {
        assert_eq!(Picture::quantise([0.5 / 255.0 + 1e-6, 2.0, -1.0]), [1, 255, 0]);
    }
}
