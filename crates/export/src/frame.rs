//! The place of a volume as a first centre and three steps from voxel to voxel, in the world of a patient's right, front and head. A volume without an
//! orientation takes its own x, y, z for these, as scenes do, so that exported volumes meet where stored ones do. Costs nothing.

use brickyard_import::SourceInfo;
use brickyard_volume::units::LengthUnit;
use glam::{DMat3, DQuat, DVec3};

/// Largest relative difference of a spacing and the length of its step, by rounding alone.
const ROUNDED: f64 = 1e-6;
/// Largest relative difference that goes unmentioned, as in readers' warnings.
const NOTABLE: f64 = 1e-3;
/// Largest cosine between axes at right angles.
const UPRIGHT: f64 = 1e-5;

/// Where voxels lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    /// Steps from one voxel to the next along x, y, z.
    pub(crate) steps: [DVec3; 3],
    /// Lengths of the steps.
    pub(crate) spacing: DVec3,
    /// Centre of the first voxel.
    pub(crate) first: DVec3,
}

impl Frame {
    /// The frame of a volume, in the unit of its spacing.
    pub(crate) fn of(info: &SourceInfo) -> Self {
        let own = info.geometry.spacing;
        let Some(orientation) = info.orientation else {
            let steps = [0, 1, 2].map(|axis| DVec3::AXES[axis] * own[axis]);
            return Self { steps, spacing: own, first: info.geometry.origin };
        };
        let steps = [0, 1, 2].map(|axis| orientation.step(axis));
        // The spacing has fewer digits than a sum of squares.
        let length = |axis: usize| {
            let length = steps[axis].length();
            if (length - own[axis]).abs() <= ROUNDED * length { own[axis] } else { length }
        };
        Self { steps, spacing: DVec3::new(length(0), length(1), length(2)), first: orientation.first_centre() }
    }

    /// A sentence on a spacing against the orientation, which is kept.
    pub(crate) fn contradiction(&self, info: &SourceInfo) -> Option<String> {
        let (own, found) = (info.geometry.spacing, self.spacing);
        let differs = (0..3).any(|axis| (own[axis] - found[axis]).abs() > NOTABLE * found[axis]);
        differs.then(|| {
            let [own, found] = [own, found].map(|s| s.to_array().map(|n| n.to_string()).join(","));
            format!(
                "The spacing {own} contradicts the orientation, whose steps are {found} long: the latter are written."
            )
        })
    }

    /// The frame with its lengths converted to another unit.
    pub(crate) fn scaled(self, convert: impl Fn(f64) -> f64) -> Self {
        let each = |v: DVec3| DVec3::new(convert(v.x), convert(v.y), convert(v.z));
        Self { steps: self.steps.map(each), spacing: each(self.spacing), first: each(self.first) }
    }

    /// The frame in the world of a patient's left, back and head.
    pub(crate) fn to_left_back_head(self) -> Self {
        // No negative zeros, which only look like a difference.
        let turned = |v: DVec3| DVec3::new(0.0 - v.x, 0.0 - v.y, v.z);
        Self { steps: self.steps.map(turned), first: turned(self.first), ..self }
    }

    /// Unit vectors along the axes.
    pub(crate) fn directions(&self) -> [DVec3; 3] {
        [0, 1, 2].map(|axis| self.steps[axis] / self.spacing[axis])
    }

    /// Rows of the map from indices of voxels to the world.
    pub(crate) fn rows(&self) -> [[f64; 4]; 3] {
        let [x, y, z] = self.steps;
        [0, 1, 2].map(|row| [x[row], y[row], z[row], self.first[row]])
    }

    /// The rotation of the axes, and whether the third one is mirrored; `None` if they are not at right angles.
    pub(crate) fn rotation(&self) -> Option<(DQuat, bool)> {
        let [x, y, z] = self.directions();
        let are_right = [x.dot(y), y.dot(z), z.dot(x)].iter().all(|cosine| cosine.abs() <= UPRIGHT);
        let is_mirrored = x.cross(y).dot(z) < 0.0;
        let third = if is_mirrored { -z } else { z };
        are_right.then(|| (DQuat::from_mat3(&DMat3::from_cols(x, y, third)).normalize(), is_mirrored))
    }
}

/// The volume's unit of length; `None` if it is unknown, or its axes have others.
pub(crate) fn length_unit(info: &SourceInfo) -> Option<LengthUnit> {
    info.geometry.unit.as_deref().and_then(LengthUnit::named)
}

/// Numbers with blanks between, each with the fewest digits to read back as the same.
pub(crate) fn words(numbers: impl IntoIterator<Item = f64>) -> String {
    let words: Vec<String> = numbers.into_iter().map(|number| number.to_string()).collect();
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::info;
    use brickyard_volume::Orientation;

    #[test]
    fn rotations_give_back_the_steps_and_mirrored_axes_are_told() {
        for sign in [1.0, -1.0] {
            let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 2.0));
            let steps = [turn.x_axis * 0.5, turn.y_axis * 2.0, turn.z_axis * (3.0 * sign)];
            let rows = [0, 1, 2].map(|row| [steps[0][row], steps[1][row], steps[2][row], 7.0]);
            let mut info = info();
            info.geometry.spacing = DVec3::new(0.5, 2.0, 3.0);
            info.orientation = Some(Orientation::new(rows).unwrap());
            let frame = Frame::of(&info);
            assert_eq!((frame.spacing, frame.rows()), (info.geometry.spacing, rows));
            let (rotation, is_mirrored) = frame.rotation().unwrap();
            assert_eq!(is_mirrored, sign < 0.0);
            assert!((rotation * DVec3::X - steps[0] / 0.5).length() < 1e-9);
            assert!((rotation * DVec3::Z * sign - steps[2].normalize()).length() < 1e-9);
            assert_eq!(frame.contradiction(&info), None);
            info.geometry.spacing.y = 2.1;
            assert_eq!(Frame::of(&info).spacing, DVec3::new(0.5, 2.0, 3.0));
            assert!(Frame::of(&info).contradiction(&info).unwrap().contains("0.5,2.1,3 contradicts"));
        }
        let mut info = info();
        info.orientation =
            Some(Orientation::new([[1.0, 0.1, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).unwrap());
        assert_eq!(Frame::of(&info).rotation(), None);
    }
}
