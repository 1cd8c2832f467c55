//! The sampling of rays, and the fineness of their bricks.

use crate::panels::reason;
use crate::panels::widgets::{Scale, choice, count, group, menu, slider};
use brickyard::session::VolumeSource;
use brickyard::volume::sampling::MOST_VIRTUAL_SAMPLES;
use brickyard::volume::{Filter, Jitter, LevelPolicy, Method, PixelSamples, Scene};
use eframe::egui::Ui;

const METHODS: [(Method, &str, &str); 7] = [
    (Method::Udvr, "one sample", "one sample in the middle of each step: the fastest (UDVR)"),
    (
        Method::Pdvr,
        "pre-integrated",
        "the mean of the transfer function between the ends of each step: no rings (PDVR)",
    ),
    (Method::Lvs, "virtual, linear", "virtual samples on a straight line between the ends of a step (LVS)"),
    (Method::Cvs, "virtual, cubic", "virtual samples on a cubic curve through neighbouring steps (CVS)"),
    (Method::Asm, "adaptive", "more samples for a greater difference of values (ASM)"),
    (Method::Plvs, "pre-integrated, linear", "pre-integrated parts on a straight line (PLVS)"),
    (Method::Pcvs, "pre-integrated, cubic", "pre-integrated parts on a cubic curve: the best, and the slowest (PCVS)"),
];

const FILTERS: [(Filter, &str, &str); 2] = [
    (Filter::Trilinear, "trilinear", "linear between the eight voxels around a place"),
    (Filter::Tricubic, "tricubic", "a cubic B-spline over 64 voxels: smooth, but it blurs, and is slower"),
];

const SAMPLES: [(usize, &str, &str); 5] = [
    (1, "1", "through the centre of the pixel: edges have steps"),
    (2, "2", "edges of three shades"),
    (4, "4", "edges of five shades"),
    (8, "8", "edges of nine shades"),
    (16, "16", "as smooth as the eye can see"),
];

/// Kinds of jitter without their seeds.
const JITTERS: [(u8, &str, &str); 3] = [
    (0, "none", "all rays are sampled at the same distances: coarse steps show as rings"),
    (1, "white noise", "each ray begins at a random distance: rings become noise"),
    (2, "blue noise", "neighbouring rays begin far apart: fine noise, averaged by the eye"),
];

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    group(ui, "sampling", "samples along rays, and level of the data: quality against speed", |ui| {
        let barred = |method| reason(scene, volumes, |scene| scene.sampling.method = method);
        let hint = "evaluation of the fog in each step along a ray";
        if let Some(method) = menu(ui, "method", hint, scene.sampling.method, &METHODS, barred) {
            scene.sampling.method = method;
        }
        if scene.sampling.method.has_virtual_samples() {
            let mut samples = u32::from(scene.sampling.virtual_samples);
            let hint = "virtual samples of each step: they read no voxels";
            count(ui, "virtual", hint, &mut samples, 1..=u32::from(MOST_VIRTUAL_SAMPLES));
            scene.sampling.virtual_samples = samples as u8;
        }
        choice(ui, "filter", "interpolation between voxels", &mut scene.sampling.filter, &FILTERS);
        jitter(ui, &mut scene.sampling.jitter);
        let hint = "rays of each pixel of a picture at rest: more make edges smoother, and take longer";
        if let Some(samples) = menu(ui, "samples", hint, scene.pixel_samples.count(), &SAMPLES, |_| None) {
            scene.pixel_samples = PixelSamples::try_from(samples as u32).unwrap_or_default();
        }
        let hint = "distance of samples along a ray, in voxels of the finest layer: shorter is better and slower";
        slider(ui, "step", hint, &mut scene.step, Scale::Log, 0.1..=10.0, "vx");
        let hint = "how many pixels a voxel may cover before a finer level is fetched: more is faster and coarser";
        slider(ui, "pixel error", hint, &mut scene.pixel_error, Scale::Log, 0.25..=32.0, "px");
        level(ui, scene, volumes);
    });
}

fn jitter(ui: &mut Ui, jitter: &mut Jitter) {
    let (kind, seed) = match *jitter {
        Jitter::None => (0, 0),
        Jitter::White(seed) => (1, seed),
        Jitter::Blue => (2, 0),
    };
    let hint = "shifts the samples of each ray by a share of a step";
    match menu(ui, "jitter", hint, kind, &JITTERS, |_| None) {
        Some(0) => *jitter = Jitter::None,
        Some(1) => *jitter = Jitter::White(seed),
        Some(_) => *jitter = Jitter::Blue,
        None => {}
    }
    if let Jitter::White(seed) = jitter {
        count(ui, "seed", "each number gives different noise", seed, 0..=999);
    }
}

fn level(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    let levels = volumes.iter().map(|volume| volume.source.pyramid().levels().len()).max().unwrap_or(1);
    let locked = (0..levels).map(|level| match level {
        0 => "0, the finest".to_string(),
        level => level.to_string(),
    });
    let names: Vec<String> = locked.collect();
    let auto = (LevelPolicy::Auto, "auto", "as fine as the pixel error requires, brick by brick");
    let locked = (0u8..)
        .zip(&names)
        .map(|(level, name)| (LevelPolicy::Locked(level), &**name, "this level everywhere, as far as memory allows"));
    let choices: Vec<_> = [auto].into_iter().chain(locked).collect();
    let hint = "the level of the data's pyramid; each is half as fine as the one before";
    choice(ui, "level", hint, &mut scene.level, &choices);
}
