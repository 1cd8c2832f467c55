//! Cut faces: where a ray enters a volume through a clip plane or a side of a clip box. The gradient there is the exposed field's, noise
//! included, and not a surface's: lit by it, a cut through a scan is salt and pepper. So the cut's own normal lights the first half of
//! a voxel behind it, and gives way to the gradient over the next whole one. A volume's own faces are no cuts, and isosurfaces keep their gradients. Costs a few products
//! per ray and plane. On a GPU `shaders/wgsl/shared/cut_face.wgsl` does the same.
//!
//! A cut opens isosurfaces; *caps* close them where rays enter. Where the first place behind the cut is past surfaces, the innermost of them
//! stands on the cut, lit by the cut's normal. So caps are as sharp as the field on the cut, and cost one sample per ray. Renderers do not skip
//! the insides of surfaces next to a cut.

use crate::lighting::SIDEWAYS;
use crate::picture::FrameSettings;
use crate::space::Extent;
use glam::DVec3;

/// Depths below a cut, in voxels, between which the cut's normal gives way to the gradient.
const DEPTHS: [f64; 2] = [0.5, 1.5];

/// A ray's entry through a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutFace {
    /// Distance along the ray of the entry.
    pub entry: f64,
    /// Gradient, in voxel space, of the height above the cut: positive on the shown side.
    pub slope: DVec3,
    /// The cut's unit normal in the scene's world, turned to the eye.
    pub normal: DVec3,
}

impl CutFace {
    /// Depth below the cut, in voxels of `factor` level-0 voxels, gained per unit of distance from the entry on. The ray moves by `direction`
    /// level-0 voxels.
    pub fn voxels_per_distance(&self, direction: DVec3, factor: DVec3) -> f64 {
        self.slope.dot(direction) / (self.slope * factor).length()
    }

    /// The cut's share in the normal at this depth below it: 1 next to the cut, 0 deep below.
    pub fn share(depth_voxels: f64) -> f64 {
        let [alone, gone] = DEPTHS;
        ((gone - depth_voxels) / (gone - alone)).clamp(0.0, 1.0)
    }

    /// Mixes the cut's normal, by a share, into a place's own unit normal of either sign. A place without one counts as turned to the eye. `view`
    /// is the ray's unit direction.
    pub fn mixed(&self, own: Option<DVec3>, view: DVec3, share: f64) -> Option<DVec3> {
        if share <= 0.0 {
            return own;
        }
        let own = own.map_or(-view, |own| if own.dot(view) > SIDEWAYS { -own } else { own });
        Some(own.lerp(self.normal, share).normalize_or(self.normal))
    }
}

impl FrameSettings {
    /// Returns the cut with a cap if the place at distance `start`, where a segment of the ray begins, is past surfaces; `None` without caps, or
    /// if the ray does not enter by a cut there.
    pub fn cap(&self, extent: Extent, origin: DVec3, direction: DVec3, eye: f64, start: f64) -> Option<CutFace> {
        if !self.caps {
            return None;
        }
        // Equal up to rounding; behind the cut, the segments begin at layers of meshes.
        let is_here = |cut: &CutFace| (start - cut.entry).abs() <= 1e-6 * self.lattice.step;
        self.cut_face(extent, origin, direction, eye).filter(is_here)
    }

    /// Returns the cut by which a ray enters the shown part of a volume of this extent; `None` if it enters by the volume's own face, or its eye
    /// is inside. The ray is an origin and a direction in voxel space, with the eye at a distance: 0, unless the origin was moved behind the eye.
    pub fn cut_face(&self, extent: Extent, origin: DVec3, direction: DVec3, eye: f64) -> Option<CutFace> {
        let clip = self.clip.as_ref()?;
        let (low, high) = self.shown_box(extent);
        let extent = DVec3::from_array(extent.to_array().map(f64::from));
        let sides = (0..3).filter(|a| direction[*a] != 0.0).map(|a| {
            let (side, is_cut) =
                if direction[a] > 0.0 { (low[a], low[a] > 0.0) } else { (high[a], high[a] < extent[a]) };
            let slope = DVec3::AXES[a] * direction[a].signum();
            ((side - origin[a]) / direction[a], if is_cut { slope } else { DVec3::ZERO })
        });
        let planes = clip.planes().iter().filter_map(|plane| {
            let slope = plane.normal * self.geometry.spacing;
            let (height, rise) = (plane.height(self.geometry.world_from_voxel(origin)), slope.dot(direction));
            (rise > 0.0).then(|| (-height / rise, slope))
        });
        let begin = (eye, DVec3::ZERO);
        let (entry, slope) = sides.chain(planes).fold(begin, |last, next| if next.0 > last.0 { next } else { last });
        let normal = -self.placement.world_gradient(slope / self.geometry.spacing).try_normalize()?;
        Some(CutFace { entry, slope, normal })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_s_normal_lights_the_first_voxel_and_no_more() {
        let cut = CutFace { entry: 3.0, slope: DVec3::new(0.0, 0.0, 2.0), normal: DVec3::NEG_Z };
        let view = DVec3::new(0.6, 0.0, 0.8);
        // Voxels are two units thick, and four at level 1.
        let rate = |factor: f64| cut.voxels_per_distance(view / 2.0, DVec3::splat(factor));
        assert!((rate(1.0) - 0.4).abs() < 1e-12 && (rate(2.0) - 0.2).abs() < 1e-12);
        assert_eq!([0.0, 0.5, 1.0, 1.5, 9.0].map(CutFace::share), [1.0, 1.0, 0.5, 0.0, 0.0]);
        assert_eq!(cut.mixed(Some(DVec3::X), view, 1.0), Some(DVec3::NEG_Z));
        assert_eq!(cut.mixed(Some(DVec3::X), view, 0.0), Some(DVec3::X));
        assert_eq!(cut.mixed(None, view, 0.0), None);
        // Turned to the eye first: x and -x are one normal.
        let half = [DVec3::X, DVec3::NEG_X].map(|own| cut.mixed(Some(own), view, 0.5).unwrap());
        assert!(half[0] == half[1] && (half[0] - DVec3::new(-1.0, 0.0, -1.0).normalize()).length() < 1e-12);
        let flat = cut.mixed(None, view, 0.5).unwrap();
        assert!((flat - DVec3::new(-0.6, 0.0, -1.8).normalize()).length() < 1e-12);
    }
}
