//! Outcome of an extraction, and a sentence about it.

use brickyard_store::Store;
use brickyard_volume::counted;
use brickyard_volume::numbers::significant;

/// A closed surface of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshObject {
    /// The label, of labels.
    pub label: Option<i64>,
    /// Number of vertices.
    pub vertices: u64,
    /// Number of triangles.
    pub triangles: u64,
    /// Area, in the world's units.
    pub area: f64,
    /// Enclosed volume, in the world's units.
    pub volume: f64,
}

/// A written mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshReport {
    /// Its objects, labels ascending.
    pub objects: Vec<MeshObject>,
}

impl MeshReport {
    /// The mesh of a store in words: counts, and of one object its area and volume.
    pub fn in_words(&self, store: &Store) -> String {
        let sum = |of: fn(&MeshObject) -> u64| self.objects.iter().map(of).sum::<u64>();
        let (vertices, triangles) =
            (sum(|object| object.vertices), counted(sum(|object| object.triangles), "triangle"));
        let unit = length_unit(store);
        let unit = |power: &str| unit.map_or_else(String::new, |unit| format!(" {unit}{power}"));
        let area = |area: f64| format!("area {}{}", significant(area, 6), unit("²"));
        let rest = match &self.objects[..] {
            [one] => format!("{}, volume {}{}", area(one.area), significant(one.volume, 6), unit("³")),
            several => {
                let total = area(several.iter().map(|object| object.area).sum());
                format!("{}, {total} in all", counted(several.len() as u64, "object"))
            }
        };
        format!("{triangles}, {vertices} vertices, {rest}")
    }
}

/// Unit of a mesh's coordinates; areas and volumes are in its powers.
pub fn length_unit(store: &Store) -> Option<&str> {
    match store.info().orientation {
        Some(_) => Some("millimeter"),
        None => store.geometry().unit.as_deref(),
    }
}
