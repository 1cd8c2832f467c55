//! Named viewpoints of a scene: the sides of a patient, and the world's axes.

use crate::near_name;
use crate::orientation::Side;
use glam::DVec3;

/// A direction of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewpoint {
    /// From a side of the patient.
    Patient(Side),
    /// From the far end of a world axis: a unit vector.
    World(DVec3),
}

/// The directions of the world's axes by their names.
const DIRECTIONS: [(&str, DVec3); 6] = [
    ("+x", DVec3::X),
    ("-x", DVec3::NEG_X),
    ("+y", DVec3::Y),
    ("-y", DVec3::NEG_Y),
    ("+z", DVec3::Z),
    ("-z", DVec3::NEG_Z),
];

impl Viewpoint {
    /// All viewpoints with their names: the patient's sides, then the world's axes.
    pub fn all() -> impl Iterator<Item = (&'static str, Self)> {
        let sides = Side::ALL.into_iter().map(|side| (side.name(), Self::Patient(side)));
        sides.chain(DIRECTIONS.into_iter().map(|(name, direction)| (name, Self::World(direction))))
    }

    /// Finds a viewpoint by name.
    ///
    /// # Errors
    /// If there is none, with a list of the names.
    pub fn from_name(name: &str) -> Result<Self, String> {
        Self::all().find(|(known, _)| *known == name).map(|(_, viewpoint)| viewpoint).ok_or_else(|| {
            let names: Vec<_> = Self::all().map(|(known, _)| known).collect();
            let near = near_name::hint(name, names.iter().copied());
            format!("no view '{name}'{near}: expected one of {}", names.join(", "))
        })
    }

    /// The direction to the viewer and the picture's up direction, both of length 1. `None` for a side of a patient unless the world is
    /// [a patient's](crate::Scene::is_anatomical).
    pub fn direction(self, is_anatomical: bool) -> Option<(DVec3, DVec3)> {
        match self {
            Self::Patient(side) => is_anatomical.then(|| (side.direction(), side.up())),
            Self::World(from) => Some((from, Side::of(from).up())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_from_sides_of_a_patient_or_along_the_world_s_axes() {
        assert_eq!(Viewpoint::from_name("left"), Ok(Viewpoint::Patient(Side::Left)));
        assert_eq!(Viewpoint::from_name("-y"), Ok(Viewpoint::World(DVec3::NEG_Y)));
        assert!(Viewpoint::from_name("postreior").unwrap_err().contains("did you mean 'posterior'?"));
        assert_eq!(Viewpoint::Patient(Side::Left).direction(false), None);
        assert_eq!(Viewpoint::Patient(Side::Superior).direction(true), Some((DVec3::Z, DVec3::Y)));
        for (name, viewpoint) in Viewpoint::all() {
            let (from, up) = viewpoint.direction(true).unwrap();
            assert_eq!((Viewpoint::from_name(name), from.dot(up)), (Ok(viewpoint), 0.0));
        }
    }
}
