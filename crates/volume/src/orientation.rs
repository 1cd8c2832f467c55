//! Orientation of a volume in a patient: the affine map from voxel indices to a world of x to the patient's right, y to the front and z to the head
//! (RAS), in the unit of the volume's spacing. Readers of NIfTI and DICOM fill it, stores keep it, and scenes use this world, so volumes of one
//! patient meet, and left is left. Made once for a volume; costs nothing per picture.

use crate::geometry::{Geometry, box_corners};
use crate::placement::{Placement, PlacementError};
use crate::space::Extent;
use crate::units::LengthUnit;
use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// Terms of a map up to this part of a voxel, for each voxel crossed, are single-precision noise.
const NOISE: f64 = 1e-4;

/// The affine map from voxel indices (whole at centres) to the patient's right, front and head, in the unit of the spacing; in JSON its three rows of
/// four numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Orientation(Placement);

impl Orientation {
    /// Creates the map with these rows; the last column is the centre of voxel (0, 0, 0).
    ///
    /// # Errors
    /// If the map is not finite, or practically singular: voxels would have no volume.
    pub fn new(rows: [[f64; 4]; 3]) -> Result<Self, PlacementError> {
        Placement::from_rows(&rows).map(Self)
    }

    /// The map's three rows.
    pub fn rows(&self) -> [[f64; 4]; 3] {
        self.0.rows()
    }

    /// The step in the world from one voxel to the next along an axis (0 is x).
    pub fn step(&self, axis: usize) -> DVec3 {
        self.0.world_vector(DVec3::AXES[axis])
    }

    /// The centre of voxel (0, 0, 0).
    pub fn first_centre(&self) -> DVec3 {
        self.0.world_from_volume(DVec3::ZERO)
    }

    /// Returns this orientation for voxels larger by these factors, one per axis, with the same first centre.
    ///
    /// # Errors
    /// If the result is not usable.
    pub fn stretched(&self, by: DVec3) -> Result<Self, PlacementError> {
        self.strided(by, DVec3::ZERO)
    }

    /// Returns the orientation of every n-th voxel of this volume, from the voxel at `first` on; `by` is n along each axis.
    ///
    /// # Errors
    /// If the result is not usable.
    pub fn strided(&self, by: DVec3, first: DVec3) -> Result<Self, PlacementError> {
        let whole_from_strided = DAffine3 { matrix3: DMat3::from_diagonal(by), translation: first };
        Placement::new(self.0.map() * whole_from_strided).map(Self)
    }

    /// Returns this orientation with another centre of voxel (0, 0, 0).
    ///
    /// # Panics
    /// If the place is not finite.
    pub fn moved_to(&self, first_centre: DVec3) -> Self {
        let map = DAffine3 { translation: first_centre, ..self.0.map() };
        Self(Placement::new(map).expect("a finite place does not change how a map stretches"))
    }

    /// Whether another orientation gives every voxel of a volume of this extent the same place, to a hundredth of a voxel.
    pub fn agrees(&self, other: &Self, extent: Extent) -> bool {
        let last = DVec3::from_array(extent.to_array().map(|n| f64::from(n) - 1.0));
        let least_step = (0..3).map(|axis| self.step(axis).length()).fold(f64::INFINITY, f64::min);
        // Maps are affine, so they differ most at a corner.
        box_corners((DVec3::ZERO, last)).into_iter().all(|at| {
            let off = self.0.world_from_volume(at) - other.0.world_from_volume(at);
            off.length() <= 0.01 * least_step
        })
    }

    /// Whether the volume's axes are the world's: x to the right, y to the front, z to the head.
    pub fn is_upright(&self) -> bool {
        (0..3).all(|axis| {
            let step = self.step(axis).to_array();
            step[axis] > 0.0 && (0..3).all(|other| other == axis || step[other].abs() <= NOISE * step[axis])
        })
    }

    /// Places the volume, from its own world of spacing and origin, in a world of millimetres, also assumed for unknown units. A volume already in
    /// this world, but for noise, is not moved.
    ///
    /// # Errors
    /// If the map combined with the spacing is not usable.
    pub fn placement(&self, geometry: &Geometry) -> Result<Placement, PlacementError> {
        let own_from_index = DAffine3 { matrix3: DMat3::from_diagonal(geometry.spacing), translation: geometry.origin };
        let unit = DAffine3::from_scale(DVec3::splat(millimetres(geometry.unit.as_deref())));
        let world_from_own = unit * self.0.map() * own_from_index.inverse();
        let off = world_from_own.matrix3 - DMat3::IDENTITY;
        let is_noise = off.to_cols_array().iter().all(|term| term.abs() <= NOISE)
            && world_from_own.translation.abs().max_element() <= NOISE * geometry.origin.abs().max_element();
        if is_noise { Ok(Placement::default()) } else { Placement::new(world_from_own) }
    }

    /// Letters of the patient's sides at the ends of the volume's axes, as in `LPS`: the best-fitting assignment.
    pub fn code(&self) -> String {
        let steps: [DVec3; 3] = std::array::from_fn(|axis| self.step(axis).normalize_or_zero());
        const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let fit = |order: &[usize; 3]| (0..3).map(|axis| steps[axis][order[axis]].abs()).sum::<f64>();
        let best = ORDERS.iter().max_by(|a, b| fit(a).total_cmp(&fit(b))).expect("there are six orders");
        (0..3).map(|axis| Side::of(DVec3::AXES[best[axis]] * steps[axis][best[axis]]).letter()).collect()
    }
}

/// Millimetres per unit of this UDUNITS name; 1 for an unknown one.
fn millimetres(unit: Option<&str>) -> f64 {
    let millimetre = LengthUnit::named("millimeter").expect("it is one of them");
    unit.and_then(LengthUnit::named).map_or(1.0, |unit| unit.convert(1.0, millimetre))
}

/// A side of a patient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The patient's right hand: +x.
    Right,
    /// The patient's left hand: -x.
    Left,
    /// The front: +y.
    Anterior,
    /// The back: -y.
    Posterior,
    /// Towards the head: +z.
    Superior,
    /// Towards the feet: -z.
    Inferior,
}

impl Side {
    /// All sides.
    pub const ALL: [Self; 6] =
        [Self::Right, Self::Left, Self::Anterior, Self::Posterior, Self::Superior, Self::Inferior];

    /// The side closest to a direction of the world.
    pub fn of(direction: DVec3) -> Self {
        let along = |side: &Self| side.direction().dot(direction);
        Self::ALL.into_iter().max_by(|a, b| along(a).total_cmp(&along(b))).expect("there are six sides")
    }

    /// The side's unit vector, letter and name.
    const fn facts(self) -> (DVec3, char, &'static str) {
        match self {
            Self::Right => (DVec3::X, 'R', "right"),
            Self::Left => (DVec3::NEG_X, 'L', "left"),
            Self::Anterior => (DVec3::Y, 'A', "anterior"),
            Self::Posterior => (DVec3::NEG_Y, 'P', "posterior"),
            Self::Superior => (DVec3::Z, 'S', "superior"),
            Self::Inferior => (DVec3::NEG_Z, 'I', "inferior"),
        }
    }

    /// The unit vector to the side.
    pub fn direction(self) -> DVec3 {
        self.facts().0
    }

    /// Up direction in a picture of a patient from this side: the head, or the front where the head points to the viewer or away.
    pub fn up(self) -> DVec3 {
        match self {
            Self::Superior | Self::Inferior => DVec3::Y,
            _ => DVec3::Z,
        }
    }

    /// The side's letter at a picture's edge.
    pub fn letter(self) -> char {
        self.facts().1
    }

    /// The side's name.
    pub fn name(self) -> &'static str {
        self.facts().2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LPS: [[f64; 4]; 3] = [[-0.5, 0.0, 0.0, 90.0], [0.0, -0.5, 0.0, 120.0], [0.0, 0.0, 2.0, -30.0]];

    #[test]
    fn codes_are_those_that_nibabel_gives() {
        let code = |rows| Orientation::new(rows).unwrap().code();
        assert_eq!(code(LPS), "LPS");
        assert_eq!(code([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]), "PIR");
        // Turned by 40 degrees about x, and sheared.
        assert_eq!(code([[1.0, 0.1, 0.0, 0.0], [0.0, 0.77, -0.64, 0.0], [0.0, 0.64, 0.77, 0.0]]), "RAS");
        // Two axes, both closest to the right: nibabel.aff2axcodes gives them different sides, too.
        assert_eq!(code([[1.0, 0.8, 0.0, 0.0], [0.1, 0.6, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]), "RAI");
    }

    #[test]
    fn a_volume_stands_in_the_patient_in_millimetres() {
        let orientation = Orientation::new(LPS).unwrap();
        let geometry = Geometry { spacing: DVec3::new(0.5, 0.5, 2.0), ..Geometry::default() };
        let placement = orientation.placement(&geometry).unwrap();
        let third = geometry.world_from_voxel(DVec3::new(3.5, 0.5, 1.5));
        assert!((placement.world_from_volume(third) - DVec3::new(88.5, 120.0, -28.0)).length() < 1e-12);
        let micrometres = Geometry { unit: Some("micrometer".into()), ..geometry };
        let placement = orientation.placement(&micrometres).unwrap();
        assert!((placement.world_from_volume(third) - DVec3::new(0.0885, 0.12, -0.028)).length() < 1e-12);
    }

    #[test]
    fn an_upright_volume_is_where_its_spacing_and_origin_say() {
        let noise = 1e-6f32 as f64;
        let rows = [[0.7f32 as f64, noise, 0.0, -90.0], [0.0, 0.7, 0.0, 20.0], [0.0, -noise, 3.0, 5.0]];
        let orientation = Orientation::new(rows).unwrap();
        let geometry = Geometry {
            spacing: DVec3::new(0.7, 0.7, 3.0),
            origin: DVec3::new(-90.0, 20.0, 5.0),
            unit: Some("millimeter".into()),
            axis_units: None,
        };
        assert!(orientation.is_upright() && orientation.placement(&geometry).unwrap().is_identity());
        let elsewhere = Geometry { origin: DVec3::ZERO, ..geometry };
        assert!(!orientation.placement(&elsewhere).unwrap().is_identity());
        assert!(!Orientation::new(LPS).unwrap().is_upright());
    }

    #[test]
    fn orientations_agree_to_a_hundredth_of_a_voxel_at_every_corner() {
        let (lps, extent) = (Orientation::new(LPS).unwrap(), Extent::new(101, 20, 30));
        let turned = |by: f64| {
            let mut rows = LPS;
            rows[1][0] += by;
            Orientation::new(rows).unwrap()
        };
        // The last voxel along x is a hundred steps away; the shortest step is half a millimetre.
        assert!(lps.agrees(&turned(4.9e-5), extent) && !lps.agrees(&turned(5.1e-5), extent));
        assert!(!lps.agrees(&lps.moved_to(DVec3::new(90.0, 120.0, -29.0)), extent));
    }

    #[test]
    fn a_flat_map_is_refused_and_json_is_the_rows() {
        let flat = [[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert!(matches!(Orientation::new(flat), Err(PlacementError::Singular { .. })));
        assert!(serde_json::from_value::<Orientation>(serde_json::json!(flat)).is_err());
        let json = serde_json::to_value(Orientation::new(LPS).unwrap()).unwrap();
        assert_eq!(json, serde_json::json!(LPS));
        assert_eq!(serde_json::from_value::<Orientation>(json).unwrap(), Orientation::new(LPS).unwrap());
    }

    #[test]
    fn sides_are_where_their_letters_say() {
        for side in Side::ALL {
            assert_eq!(Side::of(side.direction() * 0.3 + DVec3::splat(0.01)), side);
            assert_eq!(side.up().dot(side.direction()), 0.0);
            assert!(side.name().to_uppercase().starts_with(side.letter()));
        }
    }
}
