//! A slice: a plane through everything, or a slab about it, across an axis or oblique.

use super::{World, moved};
use crate::panels::mending::set_mode;
use crate::panels::widgets::{count, group, menu, number, row, vector};
use crate::planes::Grid;
use brickyard::session::VolumeSource;
use brickyard::volume::scene::VolumePlace;
use brickyard::volume::{Mode, Scene, Slice};
use eframe::egui::Ui;
use glam::DVec3;

/// The orientation of a slice.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cut {
    Off,
    /// Across an axis: 0 is x.
    Across(usize),
    Oblique,
}

const WORLD_CUTS: [(Cut, &str, &str); 5] = [
    (Cut::Off, "off", "the whole volumes"),
    (Cut::Across(0), "x", "across the x axis"),
    (Cut::Across(1), "y", "across the y axis"),
    (Cut::Across(2), "z", "across the z axis: as images are stored"),
    (Cut::Oblique, "oblique", "along any normal; at first across the view"),
];

const PATIENT_CUTS: [(Cut, &str, &str); 5] = [
    (Cut::Off, "off", "the whole volumes"),
    (Cut::Across(2), "axial", "across the body, seen from the feet"),
    (Cut::Across(1), "coronal", "front and back apart, seen from the front"),
    (Cut::Across(0), "sagittal", "left and right apart, seen from the left"),
    (Cut::Oblique, "oblique", "along any normal; at first across the view"),
];

const PROJECTIONS: [(Mode, &str, &str); 3] = [
    (Mode::Average, "mean", "the mean of the values across the slab"),
    (Mode::Mip, "greatest", "the greatest value across the slab (MIP)"),
    (Mode::MinIp, "least", "the least value across the slab (MinIP)"),
];

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], world: &World<'_>) {
    group(ui, "slice", "a plane through everything, or a slab around it", |ui| {
        let cuts = if world.is_anatomical { &PATIENT_CUTS } else { &WORLD_CUTS };
        let no_expression =
            scene.expression.is_some().then(|| "an expression is shown in mode dvr alone: clear it first".to_string());
        let shown = cut(scene.slice.as_ref());
        if let Some(cut) = menu(ui, "cut", "orientation of the slice", shown, cuts, |_| no_expression.clone()) {
            choose(scene, volumes, world, cut);
        }
        let Some(mut slice) = scene.slice else { return };
        position(ui, &mut slice, scene, volumes, world);
        if cut(Some(&slice)) == Cut::Oblique {
            vector(ui, "normal", "towards the viewer; of any length", &mut slice.normal, 2.0);
        }
        row(ui, "thickness", "thickness of the slab; 0 is the thinnest slice", |ui, label| {
            let range = 0.0..=world.size();
            number(ui, &mut slice.thickness, range, world.size(), 64.0, world.unit).labelled_by(label);
            if ui.small_button("look at it").on_hover_text("looks straight at the slice").clicked() {
                look_at(scene, volumes, slice);
            }
        });
        if slice.check().is_ok() && scene.slice.is_some() {
            scene.slice = Some(slice);
        }
        let hint = "the value shown of those across the slab";
        if let Some(mode) = menu(ui, "shows", hint, scene.mode, &PROJECTIONS, |_| None) {
            set_mode(scene, volumes, mode);
        }
    });
}

fn cut(slice: Option<&Slice>) -> Cut {
    let Some(slice) = slice else { return Cut::Off };
    let normal = slice.normal.normalize_or_zero().abs();
    (0..3).find(|&axis| normal[axis] > 1.0 - 1e-12).map_or(Cut::Oblique, Cut::Across)
}

/// Sets the orientation of a scene's slice, through its present place or the middle. A slice is a projection, and is looked at straight.
fn choose(scene: &mut Scene, volumes: &[VolumeSource], world: &World<'_>, cut: Cut) {
    let (point, thickness) = scene.slice.map_or((world.middle(), 0.0), |slice| (slice.point, slice.thickness));
    let slice = match cut {
        Cut::Off => {
            scene.slice = None;
            // Nobody wants the mean of whole volumes.
            if scene.mode == Mode::Average {
                set_mode(scene, volumes, Mode::Dvr);
            }
            return;
        }
        Cut::Across(axis) if world.is_anatomical => Slice { thickness, ..Slice::of_patient(axis, point[axis]) },
        Cut::Across(axis) => Slice { thickness, ..Slice::across(axis, point[axis]) },
        Cut::Oblique => {
            let seen = scene.camera.map(|camera| (camera.eye - camera.target).normalize_or_zero());
            let is_askew = |normal: &DVec3| normal.abs().max_element() < 0.999 && *normal != DVec3::ZERO;
            Slice { point, normal: seen.filter(is_askew).unwrap_or(DVec3::ONE), thickness }
        }
    };
    if !scene.mode.is_projection() {
        set_mode(scene, volumes, Mode::Average);
    }
    scene.slice = Some(slice);
    look_at(scene, volumes, slice);
}

fn look_at(scene: &mut Scene, volumes: &[VolumeSource], slice: Slice) {
    let places: Vec<VolumePlace> = volumes.iter().map(VolumeSource::place).collect();
    let straight = Scene { camera: None, slice: Some(slice), ..scene.clone() };
    // A camera for a square picture sees everything in any wider one, too.
    if let Ok(camera) = straight.camera_for(&places, (1, 1)) {
        scene.camera = Some(camera);
    }
}

/// Shows the slice's position in the world and, along voxels of the first visible layer, their index.
fn position(ui: &mut Ui, slice: &mut Slice, scene: &Scene, volumes: &[VolumeSource], world: &World<'_>) {
    let along = match cut(Some(slice)) {
        Cut::Across(axis) => DVec3::AXES[axis],
        _ => slice.normal.normalize_or_zero(),
    };
    slice.point += moved(ui, "where the slice is, along its normal", along, slice.point, world);
    let Some(voxels) = Voxels::new(scene, volumes, slice.point, along) else { return };
    let mut index = voxels.place.floor().clamp(0.0, f64::from(voxels.count - 1)) as u32;
    let hint = format!("the voxel along the axis, of {}, from 0", voxels.count);
    if count(ui, "voxel", &hint, &mut index, 0..=voxels.count - 1).changed() {
        slice.point += along * ((f64::from(index) + 0.5 - voxels.place) / voxels.per_length);
    }
}

/// A line of voxels across a slice.
struct Voxels {
    count: u32,
    /// Its crossing with the slice, in voxels.
    place: f64,
    /// Voxels per world distance; negative for opposite directions.
    per_length: f64,
}

impl Voxels {
    /// The voxels of the first visible layer; `None` if the slice is askew to them.
    fn new(scene: &Scene, volumes: &[VolumeSource], point: DVec3, along: DVec3) -> Option<Self> {
        let grid = Grid::of(scene, volumes)?;
        let first = grid.voxel_from_world(point);
        let step = grid.voxel_from_world(point + along) - first;
        let axis = (0..3).max_by(|a, b| step[*a].abs().total_cmp(&step[*b].abs()))?;
        let is_askew = (0..3).any(|other| other != axis && step[other].abs() > 1e-6 * step[axis].abs());
        (!is_askew).then_some(Self { count: grid.extent[axis], place: first[axis], per_length: step[axis] })
    }
}
