//! Scripted flights: motions of the camera (or the transfer function), frame by frame and reproducible, so runs can be
//! compared.

use brickyard::volume::{Camera, Scene, TransferChoice, TransferFunction};
use glam::DVec3;
use serde::Serialize;
use std::f64::consts::TAU;

/// Course of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scenario {
    /// Nothing moves: the same frame again and again.
    Still,
    /// The camera orbits the target once.
    Orbit,
    /// The camera flies straight through the volume and out on the other side, looking ahead.
    Fly,
    /// The camera comes nearer, from the whole volume to a few voxels.
    Zoom,
    /// The transfer functions' points move up and down the values; the camera stands still.
    Sweep,
    /// The camera flies between random places in and around the volume.
    Random,
}

impl Scenario {
    /// All scenarios.
    pub const ALL: [Self; 6] = [Self::Still, Self::Orbit, Self::Fly, Self::Zoom, Self::Sweep, Self::Random];

    /// The scenario's name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Still => "still",
            Self::Orbit => "orbit",
            Self::Fly => "fly",
            Self::Zoom => "zoom",
            Self::Sweep => "sweep",
            Self::Random => "random",
        }
    }
}

/// Starting point of a scenario.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Scene of the first frame, with transfer functions written out.
    pub scene: Scene,
    /// Camera of the first frame.
    pub camera: Camera,
    /// The box around all layers in the world: its least and greatest corner.
    pub world_box: (DVec3, DVec3),
    /// World size of the finest voxels.
    pub voxel_size: f64,
    /// Seed of [`Scenario::Random`].
    pub seed: u64,
}

/// Frames from one random place to the next.
const FRAMES_PER_LEG: u32 = 60;

impl Setting {
    /// Scene of a frame in a flight of `frames` frames.
    pub fn at(&self, scenario: Scenario, frame: u32, frames: u32) -> Scene {
        let t = frame as f64 / frames.max(1) as f64;
        let camera = match scenario {
            Scenario::Orbit => self.camera.orbited(360.0 * t),
            Scenario::Fly => self.fly(t),
            Scenario::Zoom => self.zoom(t),
            Scenario::Still | Scenario::Sweep => self.camera,
            Scenario::Random => self.random(frame),
        };
        let mut scene = Scene { camera: Some(camera), ..self.scene.clone() };
        if scenario == Scenario::Sweep {
            let of_layers = scene.layers.iter_mut().filter_map(|layer| layer.transfer.as_mut());
            let of_value = scene.expression.iter_mut().filter_map(|expression| expression.transfer.as_mut());
            of_layers.chain(of_value).for_each(|choice| sweep(choice, t));
        }
        scene
    }

    /// From the eye to its mirror image behind the target, on a slight arc that keeps rays off the axes.
    fn fly(&self, t: f64) -> Camera {
        let Camera { eye, target, up, .. } = self.camera;
        let ahead = target - eye;
        let aside = ahead.cross(up).normalize_or_zero() * ahead.length() * 0.05;
        let at = |t: f64| eye + ahead * (2.0 * t) + aside * (TAU * t).sin();
        Camera { eye: at(t), target: at(t + 0.05), ..self.camera }
    }

    /// Each frame is nearer by the same ratio, down to four voxels.
    fn zoom(&self, t: f64) -> Camera {
        let Camera { eye, target, .. } = self.camera;
        let nearest = (4.0 * self.voxel_size / eye.distance(target)).min(1.0);
        Camera { eye: target + (eye - target) * nearest.powf(t), ..self.camera }
    }

    fn random(&self, frame: u32) -> Camera {
        let (leg, t) = (frame / FRAMES_PER_LEG, (frame % FRAMES_PER_LEG) as f64 / FRAMES_PER_LEG as f64);
        let (low, high) = self.world_box;
        let place = |point: u32, what: u64, reach: f64| {
            let unit =
                DVec3::from_array(std::array::from_fn(|a| random_unit(self.seed, point as u64 * 8 + what + a as u64)));
            (low + high) * 0.5 + (unit - 0.5) * (high - low) * reach
        };
        let along = |what: u64, reach: f64| catmull_rom([0, 1, 2, 3].map(|i| place(leg + i, what, reach)), t);
        // Eyes are at most the box's half size outside; their targets are inside.
        let (eye, target) = (along(0, 2.0), along(3, 0.8));
        Camera { eye, target, ..self.camera }
    }
}

fn sweep(choice: &mut TransferChoice, t: f64) {
    let TransferChoice::Function(TransferFunction { color, opacity, regions, .. }) = choice else { return };
    let span = opacity[opacity.len() - 1][0] - opacity[0][0];
    let shift = 0.25 * span * (TAU * t).sin();
    opacity.iter_mut().for_each(|point| point[0] += shift);
    color.iter_mut().for_each(|point| point[0] += shift);
    regions.iter_mut().flat_map(|region| &mut region.value).for_each(|value| *value += shift);
}

/// A curve from the second point to the third, smooth where curves meet.
fn catmull_rom([a, b, c, d]: [DVec3; 4], t: f64) -> DVec3 {
    0.5 * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * (t * t) + (3.0 * (b - c) + d - a) * (t * t * t))
}

/// Number `index` of a sequence of random numbers in 0..1 (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", 2014).
fn random_unit(seed: u64, index: u64) -> f64 {
    let mut z = seed.wrapping_add((index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setting() -> Setting {
        let world_box = (DVec3::ZERO, DVec3::new(100.0, 80.0, 60.0));
        Setting {
            scene: Scene::of(TransferFunction::preset("gray", (0.0, 255.0), 1.0).unwrap()),
            camera: Camera::looking_at_box(world_box),
            world_box,
            voxel_size: 0.5,
            seed: 7,
        }
    }

    fn transfer(scene: &Scene) -> &TransferFunction {
        match &scene.layers[0].transfer {
            Some(TransferChoice::Function(function)) => function,
            other => panic!("{other:?} is not written out"),
        }
    }

    #[test]
    fn every_frame_of_every_scenario_makes_a_picture() {
        let setting = setting();
        for scenario in Scenario::ALL {
            let mut last = None;
            for frame in 0..=300 {
                let scene = setting.at(scenario, frame, 300);
                let camera = scene.camera.unwrap();
                camera.rays(64, 48).unwrap_or_else(|e| panic!("{} {frame}: {e}", scenario.name()));
                transfer(&scene).validate().unwrap();
                // Legs of a random flight meet: no jump is longer than a few frames' way.
                let jump = last.map_or(0.0, |eye: DVec3| eye.distance(camera.eye));
                assert!(jump < 25.0, "{} {frame}: {jump}", scenario.name());
                last = Some(camera.eye);
            }
        }
    }

    #[test]
    fn scenarios_end_where_they_say() {
        let setting = setting();
        let eye = |scenario, frame| setting.at(scenario, frame, 100).camera.unwrap().eye;
        let (start, target) = (setting.camera.eye, setting.camera.target);
        assert!(eye(Scenario::Orbit, 100).distance(start) < 1e-9 && eye(Scenario::Orbit, 50).distance(start) > 100.0);
        assert!(eye(Scenario::Fly, 100).distance(2.0 * target - start) < 1e-9);
        assert!((eye(Scenario::Zoom, 100).distance(target) - 2.0).abs() < 1e-9);
        let swept = |frame| transfer(&setting.at(Scenario::Sweep, frame, 100)).clone();
        assert_eq!(swept(0), *transfer(&setting.scene));
        assert_ne!(swept(25), swept(0));
    }
}
