//! Placement of a volume in a scene: an affine map from its own world, given by its store's spacing and origin, to the world of the
//! scene.
//!
//! Renderers and the pager work in the volume's own world, and transform rays into it. A ray keeps its parameter: `t` stays the distance
//! from the eye in the scene's world, and the direction loses its unit length. So all volumes of a scene share one sampling lattice,
//! whatever their maps, and boxes of voxels stay boxes.

use crate::ensure::ensure;
use crate::geometry::{Geometry, box_corners};
use crate::ray::Ray;
use crate::space::Extent;
use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// The greatest ratio of a map's stretches in two directions. Beyond it a volume is practically flat.
pub const MAX_CONDITION: f64 = 1e6;

/// An invertible affine map from a volume's own world to the scene's; in JSON its rows, three or four of four numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Vec<f64>>", into = "Vec<Vec<f64>>")]
pub struct Placement {
    world_from_volume: DAffine3,
    volume_from_world: DAffine3,
    least_stretch: f64,
    greatest_stretch: f64,
}

/// Why a matrix cannot place a volume.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlacementError {
    /// The matrix does not have three or four rows of four numbers; the text is the found shape, in words.
    #[error("a matrix of {0}: expected three or four rows of four numbers")]
    Shape(String),
    /// The matrix has a number that is NaN or infinite.
    #[error("the matrix holds {0}: expected finite numbers")]
    NotFinite(f64),
    /// The matrix's last row makes the map a projective one.
    #[error("the matrix's last row is {0:?}: expected 0, 0, 0, 1")]
    LastRow([f64; 4]),
    /// The matrix is singular: volumes would become planes, lines or points. The number is its determinant.
    #[error(
        "the matrix is singular (its determinant is {0}): it would make a volume flat, expected an \
         invertible one"
    )]
    Singular(f64),
    /// The matrix is nearly singular: volumes would become almost flat. The number is the ratio of its greatest to its least stretch.
    #[error("the matrix stretches directions unevenly, by a factor of {0:.1e}: expected at most {MAX_CONDITION:.0e}")]
    Condition(f64),
    /// The text has a word that is not a number.
    #[error("'{0}' is not a number: expected the 12 or 16 numbers of a matrix, row by row")]
    Word(String),
}

impl Default for Placement {
    /// The identity: the volume stays where its store puts it.
    fn default() -> Self {
        let map = DAffine3::IDENTITY;
        Self { world_from_volume: map, volume_from_world: map, least_stretch: 1.0, greatest_stretch: 1.0 }
    }
}

impl Placement {
    /// Places a volume by this affine map from its own world to the scene's.
    ///
    /// # Errors
    /// If the map is not finite, singular, or nearly singular.
    pub fn new(world_from_volume: DAffine3) -> Result<Self, PlacementError> {
        if let Some(bad) = world_from_volume.to_cols_array().into_iter().find(|v| !v.is_finite()) {
            return Err(PlacementError::NotFinite(bad));
        }
        let determinant = world_from_volume.matrix3.determinant();
        let singular = || PlacementError::Singular(determinant);
        let volume_from_world = world_from_volume.inverse();
        ensure(determinant != 0.0 && volume_from_world.is_finite(), singular)?;
        let greatest = greatest_stretch(world_from_volume.matrix3);
        let least = 1.0 / greatest_stretch(volume_from_world.matrix3);
        let condition = greatest / least;
        ensure(greatest.is_finite() && condition.is_finite() && least > 0.0, singular)?;
        ensure(condition <= MAX_CONDITION, || PlacementError::Condition(condition))?;
        Ok(Self { world_from_volume, volume_from_world, least_stretch: least, greatest_stretch: greatest })
    }

    /// Places a volume by a matrix with these rows: three, or four with a last one of 0, 0, 0, 1.
    ///
    /// # Errors
    /// If the rows have another shape, or the map is not finite, singular, or nearly singular.
    pub fn from_rows(rows: &[[f64; 4]]) -> Result<Self, PlacementError> {
        let ([x, y, z], last) = match *rows {
            [x, y, z] => ([x, y, z], None),
            [x, y, z, last] => ([x, y, z], Some(last)),
            _ => return Err(PlacementError::Shape(format!("{} rows", rows.len()))),
        };
        if let Some(last) = last.filter(|last| *last != [0.0, 0.0, 0.0, 1.0]) {
            return Err(PlacementError::LastRow(last));
        }
        let column = |i: usize| DVec3::new(x[i], y[i], z[i]);
        Self::new(DAffine3::from_cols(column(0), column(1), column(2), column(3)))
    }

    /// Parses a placement from the text of a matrix, as written by registration programs: 12 or 16 numbers, row by row, separated by
    /// blanks, line ends or commas.
    ///
    /// # Errors
    /// If a word is not a number, there are not 12 or 16 numbers, or the map is not usable.
    pub fn from_text(text: &str) -> Result<Self, PlacementError> {
        let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
        let number = |word: &str| word.parse::<f64>().map_err(|_| PlacementError::Word(word.to_string()));
        let numbers = words.map(number).collect::<Result<Vec<f64>, _>>()?;
        let (rows, rest) = numbers.as_chunks::<4>();
        ensure(rest.is_empty(), || PlacementError::Shape(format!("{} numbers", numbers.len())))?;
        Self::from_rows(rows)
    }

    /// The three rows of the matrix from the volume's own world to the scene's.
    pub fn rows(&self) -> [[f64; 4]; 3] {
        let DAffine3 { matrix3, translation } = self.world_from_volume;
        std::array::from_fn(|a| matrix3.row(a).extend(translation[a]).to_array())
    }

    /// The plain affine map.
    pub(crate) fn map(&self) -> DAffine3 {
        self.world_from_volume
    }

    /// Composes this map with an earlier one: from the other's volume to this one's world.
    ///
    /// # Errors
    /// If the composed map is not usable.
    pub fn after(&self, first: &Self) -> Result<Self, PlacementError> {
        if first.is_identity() { Ok(*self) } else { Self::new(self.world_from_volume * first.world_from_volume) }
    }

    /// Whether the volume stays where its store puts it.
    pub fn is_identity(&self) -> bool {
        self.world_from_volume == DAffine3::IDENTITY
    }

    /// Maps a point of the volume's own world to the scene's.
    pub fn world_from_volume(&self, point: DVec3) -> DVec3 {
        self.world_from_volume.transform_point3(point)
    }

    /// Maps a point of the scene's world to the volume's own.
    pub fn volume_from_world(&self, point: DVec3) -> DVec3 {
        self.volume_from_world.transform_point3(point)
    }

    /// Maps a vector of the scene's world to the volume's own; the map may change its length.
    pub fn volume_vector(&self, vector: DVec3) -> DVec3 {
        self.volume_from_world.transform_vector3(vector)
    }

    /// Maps a vector of the volume's own world to the scene's; the map may change its length.
    pub fn world_vector(&self, vector: DVec3) -> DVec3 {
        self.world_from_volume.transform_vector3(vector)
    }

    /// Maps a ray of the scene's world to the volume's own: points keep their `t`, so its direction may lose its unit length.
    pub fn volume_ray(&self, ray: &Ray) -> Ray {
        Ray { origin: self.volume_from_world(ray.origin), direction: self.volume_vector(ray.direction) }
    }

    /// Maps a plane's normal of the scene's world to the volume's own: points keep their [height](crate::ClipPlane::height) above the
    /// plane.
    pub fn volume_normal(&self, normal: DVec3) -> DVec3 {
        self.world_from_volume.matrix3.transpose() * normal
    }

    /// Maps a gradient in the volume's own world to the scene's.
    pub fn world_gradient(&self, gradient: DVec3) -> DVec3 {
        self.volume_from_world.matrix3.transpose() * gradient
    }

    /// The greatest and the least factor by which the map changes a length.
    pub fn stretches(&self) -> (f64, f64) {
        (self.greatest_stretch, self.least_stretch)
    }

    /// The bounding box, in the scene's world, of a box of the volume's own world.
    pub fn world_box(&self, own_box: (DVec3, DVec3)) -> (DVec3, DVec3) {
        let corners = box_corners(own_box).into_iter().map(|corner| self.world_from_volume(corner));
        let outside = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        corners.fold(outside, |(low, high), corner| (low.min(corner), high.max(corner)))
    }

    /// The [`Geometry::voxel_size`] of the placed volume, in the scene's world.
    pub fn voxel_size(&self, geometry: &Geometry, extent: Extent) -> f64 {
        self.placed(geometry).voxel_size(extent)
    }

    /// Returns a volume's geometry with its voxels' spacing in the scene's world, along the volume's own axes.
    pub fn placed(&self, geometry: &Geometry) -> Geometry {
        let DMat3 { x_axis, y_axis, z_axis } = self.world_from_volume.matrix3;
        let stretches = DVec3::new(x_axis.length(), y_axis.length(), z_axis.length());
        Geometry { spacing: geometry.spacing * stretches, ..geometry.clone() }
    }
}

/// The greatest singular value.
fn greatest_stretch(map: DMat3) -> f64 {
    // The greatest eigenvalue of a symmetric matrix (Smith, Eigenvalues of a Symmetric 3 x 3 Matrix, 1961).
    let square = map.transpose() * map;
    let entry = |i: usize, j: usize| square.col(j)[i];
    let mean = (entry(0, 0) + entry(1, 1) + entry(2, 2)) / 3.0;
    let off = square - DMat3::from_diagonal(DVec3::splat(mean));
    let spread = (off.to_cols_array().iter().map(|v| v * v).sum::<f64>() / 6.0).sqrt();
    if spread == 0.0 {
        return mean.sqrt();
    }
    let turn = ((off * (1.0 / spread)).determinant() * 0.5).clamp(-1.0, 1.0).acos() / 3.0;
    (mean + 2.0 * spread * turn.cos()).sqrt()
}

impl TryFrom<Vec<Vec<f64>>> for Placement {
    type Error = PlacementError;

    fn try_from(rows: Vec<Vec<f64>>) -> Result<Self, PlacementError> {
        let row = |row: &Vec<f64>| {
            let found = || PlacementError::Shape(format!("a row of {} numbers", row.len()));
            <[f64; 4]>::try_from(&row[..]).map_err(|_| found())
        };
        Self::from_rows(&rows.iter().map(row).collect::<Result<Vec<_>, _>>()?)
    }
}

impl From<Placement> for Vec<Vec<f64>> {
    fn from(placement: Placement) -> Self {
        placement.rows().map(Vec::from).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    #[test]
    fn matrices_come_as_rows_and_as_text() {
        let rows = [[2.0, 0.0, 0.0, 5.0], [0.0, 0.0, -1.0, 6.0], [0.0, 3.0, 0.0, 7.0]];
        let placement = Placement::from_rows(&rows).unwrap();
        assert_eq!(placement.world_from_volume(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(7.0, 3.0, 13.0));
        assert_eq!(placement.rows(), rows);
        assert_eq!(Placement::from_text("2 0 0 5\n0,0,-1,6\r\n0 3 0 7\n0 0 0 1\n"), Ok(placement));
        let json = serde_json::to_string(&placement).unwrap();
        assert_eq!(serde_json::from_str::<Placement>(&json).unwrap(), placement);
        assert!(Placement::default().is_identity() && !placement.is_identity());
    }

    #[test]
    fn impossible_matrices_say_why() {
        let flat = [[1.0, 2.0, 0.0, 0.0], [2.0, 4.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert!(matches!(Placement::from_rows(&flat), Err(PlacementError::Singular { .. })));
        let thin = [[1.0, 0.0, 0.0, 0.0], [0.0, 1e-7, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert!(matches!(Placement::from_rows(&thin), Err(PlacementError::Condition(c)) if (c - 1e7).abs() < 1.0));
        let projective = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.1, 1.0]];
        assert!(matches!(Placement::from_rows(&projective), Err(PlacementError::LastRow(_))));
        assert!(matches!(Placement::from_text("1 0 0 nan 0 1 0 0 0 0 1 0"), Err(PlacementError::NotFinite(_))));
        assert!(matches!(Placement::from_text("1 0 0 inf 0 1 0 0 0 0 1 0"), Err(PlacementError::NotFinite(_))));
        assert!(matches!(Placement::from_text("1 0 0 1e400"), Err(PlacementError::Shape { .. })));
        assert_eq!(Placement::from_text("#Insight"), Err(PlacementError::Word("#Insight".into())));
        for text in ["", "1 2 3", "1 0 0 0 0 1 0 0"] {
            assert!(matches!(Placement::from_text(text), Err(PlacementError::Shape { .. })), "{text}");
        }
        let error = serde_json::from_str::<Placement>("[[1,0,0],[0,1,0],[0,0,1]]").unwrap_err().to_string();
        assert!(error.contains("a row of 3 numbers"), "{error}");
    }

    proptest! {
        /// Turned, sheared, scaled and mirrored maps: points come back, lengths are within the stretches, scalings reach them, and
        /// heights above a plane are unchanged.
        #[test]
        fn maps_keep_what_they_promise(
            axis in prop::array::uniform3(-1.0..1.0f64),
            angle in 0.0..6.3f64,
            scale in prop::array::uniform3(0.1..5.0f64),
            shear in -1.0..1.0f64,
            mirrors in any::<bool>(),
            point in prop::array::uniform3(-9.0..9.0f64),
        ) {
            let axis = DVec3::from_array(axis) + 2.0;
            let turn = DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle));
            let mut scale = DVec3::from_array(scale);
            let plain = Placement::new(DAffine3::from_mat3(turn * DMat3::from_diagonal(scale))).unwrap();
            let (greatest, least) = plain.stretches();
            prop_assert!((greatest - scale.max_element()).abs() < 1e-9 && (least - scale.min_element()).abs() < 1e-9);
            scale.x *= if mirrors { -1.0 } else { 1.0 };
            let lean = DMat3::from_cols(DVec3::X, DVec3::new(shear, 1.0, 0.0), DVec3::Z);
            let map = DAffine3 { matrix3: turn * lean * DMat3::from_diagonal(scale), translation: axis * 7.0 };
            let placement = Placement::new(map).unwrap();
            let point = DVec3::from_array(point);
            let there = placement.world_from_volume(point);
            prop_assert!((placement.volume_from_world(there) - point).length() < 1e-9);
            let (greatest, least) = placement.stretches();
            let length = (there - placement.world_from_volume(DVec3::ZERO)).length();
            prop_assert!(length <= point.length() * greatest * (1.0 + 1e-9));
            prop_assert!(length >= point.length() * least * (1.0 - 1e-9));
            let normal = DVec3::new(0.3, -0.8, 0.5);
            let height = normal.dot(there - placement.world_from_volume(DVec3::ONE));
            prop_assert!((placement.volume_normal(normal).dot(point - 1.0) - height).abs() < 1e-9);
        }
    }
}
