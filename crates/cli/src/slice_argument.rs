//! `--slice`: planes by name in the world, in a patient, or along a volume's own axes; and the refusal of a patient's
//! sides without one. The meaning of a name depends on the volumes, so it is resolved once they are open.

use super::{Failure, values};
use brickyard::session::VolumeSource;
use brickyard::volume::{ClipPlane, Placement, Scene, Slice, Viewpoint, near_name};
use glam::DVec3;

/// A slice as written by the user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SliceArgument {
    /// A plane in the world.
    Plane(ClipPlane),
    /// Across an axis of the world (0 is x), at a coordinate.
    World(usize, At),
    /// Across an axis of the patient (0 is from left to right), at a coordinate of the world.
    Patient(usize, At),
    /// Across an axis of the first layer's volume (0 is x), through the centres of the voxels with this index.
    Voxels(usize, At),
}

/// A slice's place along its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum At {
    /// At a coordinate, or an index of voxels.
    Value(f64),
    /// After a share of the whole extent along the axis, 0 to 1.
    Share(f64),
}

impl At {
    fn read(text: &str) -> Option<Self> {
        let number = |text: &str| text.trim().parse().ok().filter(|at: &f64| at.is_finite());
        match text.trim().strip_suffix('%') {
            Some(percent) => {
                number(percent).filter(|percent| (0.0..=100.0).contains(percent)).map(|p| Self::Share(p / 100.0))
            }
            None if text.trim() == "middle" => Some(Self::Share(0.5)),
            None => number(text).map(Self::Value),
        }
    }

    /// Returns the value, on an axis between these ends.
    fn between(self, from: f64, to: f64) -> f64 {
        match self {
            Self::Value(value) => value,
            Self::Share(share) => from + (to - from) * share,
        }
    }
}

/// The names of planes across the axes x, y, z of the world; of a volume; of a patient.
const WORLD: [&str; 3] = ["x", "y", "z"];
const VOXELS: [&str; 3] = ["i", "j", "k"];
const PATIENT: [&str; 3] = ["sagittal", "coronal", "axial"];

/// Reads `AXIS=VALUE`, or a plane `X,Y,Z:NX,NY,NZ`.
pub(crate) fn slice(text: &str) -> Result<SliceArgument, String> {
    let form = "z=VALUE, k=INDEX, axial=VALUE and the like, in per cent as in z=50%, in the middle as in z=middle, or X,Y,Z:NX,NY,NZ, in world units";
    let Some((name, at)) = text.split_once('=') else {
        return match text.contains(':') {
            true => values::plane(text).map(SliceArgument::Plane),
            false => Err(format!("'{text}': expected {form}")),
        };
    };
    let name = name.trim();
    let axis = |names: [&str; 3]| names.iter().position(|known| *known == name);
    let plane = |at| {
        let world = axis(WORLD).map(|axis| SliceArgument::World(axis, at));
        let voxels = axis(VOXELS).map(|axis| SliceArgument::Voxels(axis, at));
        world.or(voxels).or(axis(PATIENT).map(|axis| SliceArgument::Patient(axis, at)))
    };
    if plane(At::Value(0.0)).is_none() {
        let names = [WORLD, VOXELS, PATIENT].concat();
        let near = near_name::hint(name, names.iter().copied());
        return Err(format!("'{text}': no axis or plane '{name}'{near}: expected one of {}", names.join(", ")));
    }
    let expected =
        || format!("'{text}': expected a finite number, a per cent from 0% to 100%, or middle after '{name}='");
    At::read(at).and_then(plane).ok_or_else(expected)
}

impl SliceArgument {
    /// Returns the slice in the scene's world.
    ///
    /// # Errors
    /// If the plane is a patient's and no volume has an orientation, or no voxel has the index.
    pub(crate) fn resolve(self, scene: &Scene, volumes: &[VolumeSource]) -> Result<Slice, Failure> {
        let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
        let is_anatomical = scene.is_anatomical(&places);
        let (low, high) = scene.world_box(&places).map_err(Failure::usage)?;
        let in_world = |axis: usize, at: At| at.between(low[axis], high[axis]);
        match self {
            Self::Plane(ClipPlane { point, normal }) => Ok(Slice { point, normal, thickness: 0.0 }),
            Self::World(axis, at) | Self::Patient(axis, at) if is_anatomical => {
                Ok(Slice::of_patient(axis, in_world(axis, at)))
            }
            Self::World(axis, at) => Ok(Slice::across(axis, in_world(axis, at))),
            Self::Patient(axis, _) => {
                let name = PATIENT[axis];
                let others = ["x=50% or i=INDEX", "y=50% or j=INDEX", "z=50% or k=INDEX"][axis];
                Err(unoriented(&format!("--slice {name}"), others))
            }
            Self::Voxels(axis, at) => across_voxels(scene, volumes, is_anatomical, axis, at),
        }
    }
}

/// Returns the slice through the centres of the voxels with this index along an axis of the first layer's volume.
fn across_voxels(
    scene: &Scene,
    volumes: &[VolumeSource],
    is_anatomical: bool,
    axis: usize,
    at: At,
) -> Result<Slice, Failure> {
    let first = (!scene.layers.is_empty()).then(|| scene.store(0));
    let Some(volume) = first.and_then(|store| volumes.get(store)) else {
        return Err(Failure::usage(
            "--slice: indices count the voxels of the first layer's store, and the scene has none",
        ));
    };
    let voxels = volume.source.pyramid().levels()[0].extent.to_array()[axis];
    let index = match at {
        At::Value(index) => index,
        At::Share(_) => at.between(0.0, f64::from(voxels - 1)).round(),
    };
    if !(-0.5..=f64::from(voxels) - 0.5).contains(&index) {
        let name = VOXELS[axis];
        let last = voxels - 1;
        return Err(Failure::usage(format!("--slice {name}={index}: outside of the volume: expected 0 to {last}")));
    }
    let placement = scene.placement(0, &volume.place()).map_err(Failure::usage)?;
    let own_point = volume.source.geometry().world_from_voxel(DVec3::AXES[axis] * (index + 0.5));
    Ok(Slice {
        point: placement.world_from_volume(own_point),
        normal: viewer_side(&placement, is_anatomical, axis),
        thickness: 0.0,
    })
}

/// Returns the world normal of the planes across an axis of a volume, on the viewer's side.
fn viewer_side(placement: &Placement, is_anatomical: bool, axis: usize) -> DVec3 {
    let across = |slice: fn(usize, f64) -> Slice, axis: usize| slice(axis, 0.0).normal;
    let normal = placement.world_gradient(across(Slice::across, axis)).normalize_or_zero();
    if !is_anatomical {
        return normal;
    }
    // As for the nearest planes of the patient.
    let nearest = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(2);
    normal * across(Slice::of_patient, nearest).dot(normal).signum()
}

/// Returns the direction to the viewer, and the up direction.
///
/// # Errors
/// If the viewpoint is a side of a patient and no volume has an orientation.
pub(crate) fn direction(view: Viewpoint, is_anatomical: bool) -> Result<(DVec3, DVec3), Failure> {
    let name = Viewpoint::all().find(|(_, known)| *known == view).map_or("", |(name, _)| name);
    view.direction(is_anatomical).ok_or_else(|| unoriented(&format!("--view {name}"), "+x, -y and the like"))
}

fn unoriented(what: &str, instead: &str) -> Failure {
    Failure::usage(format!(
        "{what}: no store says how its volume lies in a patient (`brickyard info STORE` shows it): use {instead}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::Side;

    #[test]
    fn slices_are_across_an_axis_or_a_plane() {
        assert_eq!(slice("y=-2.5"), Ok(SliceArgument::World(1, At::Value(-2.5))));
        assert_eq!(slice("k=7"), Ok(SliceArgument::Voxels(2, At::Value(7.0))));
        assert_eq!(slice("sagittal=3"), Ok(SliceArgument::Patient(0, At::Value(3.0))));
        assert_eq!(slice("axial=25%"), Ok(SliceArgument::Patient(2, At::Share(0.25))));
        assert_eq!(slice("k=middle"), Ok(SliceArgument::Voxels(2, At::Share(0.5))));
        let oblique = ClipPlane { point: DVec3::new(1.0, 2.0, 3.0), normal: DVec3::new(0.0, 1.0, 1.0) };
        assert_eq!(slice("1,2,3:0,1,1"), Ok(SliceArgument::Plane(oblique)));
        for bad in ["w=3", "z=", "z=inf", "z=101%", "z=%", "z=half", "z", "12", "x=1:0,0,1", "1,2,3:0,0,0"] {
            assert!(slice(bad).unwrap_err().contains(bad), "{bad}");
        }
        assert!(slice("axail=3").unwrap_err().contains("did you mean 'axial'?"));
    }

    #[test]
    fn a_side_of_nobody_is_refused() {
        let failure = direction(Viewpoint::Patient(Side::Left), false).unwrap_err();
        assert!(failure.message.contains("--view left") && failure.message.contains("+x, -y"), "{}", failure.message);
    }
}
