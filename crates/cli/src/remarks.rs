//! Remarks on pictures that show less than expected: before drawing, on a slice, an isovalue or a preset without effect
//! on the data; and afterwards, on the cause of an empty picture. Each with numbers that would work.

use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::session::{ResolvedLayer, ResolvedScene, VolumeSource};
use brickyard::unlike_sizes::unlike_sizes;
use brickyard::volume::numbers::{significant, within_span};
use brickyard::volume::units::with_unit;
use brickyard::volume::{Extreme, Mode, Picture, Scene, Slice, TransferChoice, box_corners};

/// Returns the remarks on a scene before it is drawn.
pub(super) fn of_scene(scene: &Scene, volumes: &[VolumeSource]) -> Vec<String> {
    let shown = || (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible);
    let mut remarks = Vec::new();
    remarks.extend(scene.slice.and_then(|slice| slice_outside(slice, scene, volumes)));
    remarks.extend(shown().flat_map(|layer| isovalues_outside(scene, layer, volumes)));
    remarks.extend(shown().filter_map(|layer| preset_of_other_data(scene, layer, volumes)));
    remarks.extend(unlike_sizes(scene, volumes).map(|unlike| {
        let matrix = unlike.numbers().map(|row| row.join(" ")).join("  ");
        format!("{unlike}; alike with --volume \"{}:matrix={matrix}\"", unlike.layer)
    }));
    remarks
}

/// Reports a missing isovalue in an isosurface scene.
pub(super) fn of_missing_isovalue(scene: &Scene, volumes: &[VolumeSource]) -> Option<String> {
    let is_missing = scene.mode == Mode::Isosurface && scene.layers.iter().all(|layer| layer.isosurfaces.is_empty());
    let first = scene.layers.first().filter(|_| is_missing)?;
    let volume = volumes.get(scene.store(0))?;
    let reach = reach(first.channel, volume);
    Some(format!("--mode isosurface shows the surface of one value: give it with --isovalue; the values of {reach}"))
}

/// Returns the cause of an empty picture, all of it `background`; `None` if it is not empty.
pub(super) fn of_empty(
    picture: &Picture,
    background: [f64; 3],
    resolved: &ResolvedScene,
    volumes: &[VolumeSource],
) -> Option<String> {
    // Renderers may round it to either side.
    let is_background = |pixel: &[u8; 3]| (0..3).all(|k| (255.0 * background[k] - f64::from(pixel[k])).abs() <= 1.0);
    if !picture.rgb.iter().all(is_background) {
        return None;
    }
    let is_clear = |layer: &ResolvedLayer| {
        let (low, high) = volumes[layer.volume].likely_range(layer.style.channel);
        let mut values = (0..=1000).map(|i| low + (high - low) * f64::from(i) / 1000.0);
        layer.style.isosurfaces.is_empty() && values.all(|value| layer.transfer.alpha(value) == 0.0)
    };
    let why = match () {
        () if resolved.slice.is_some() || resolved.mode == Mode::Isosurface => "it shows no part of the volume",
        () if resolved.mode == Mode::Dvr && resolved.layers.iter().all(is_clear) => {
            "the transfer function is transparent at all values of the volume; --transfer auto shows everything but \
             the background"
        }
        () => "it shows no part of the volume; without --eye and --target the camera looks at all of it",
    };
    Some(format!("the picture is empty: {why}"))
}

/// Returns the warning about rays that may end too soon on this adapter, if any.
pub(super) fn of_unfinished(adapter: &str, resolved: &ResolvedScene, volumes: &[VolumeSource]) -> Option<&'static str> {
    let may_be = adapter.contains("llvmpipe") && resolved.may_be_unfinished(volumes);
    may_be.then_some(
        "llvmpipe ends rays after 65,535 rounds of a shader's loops, and some rays here may be longer: the volume \
         behind is missing then; draw with --backend cpu, or with a longer --step",
    )
}

/// Returns remarks on projections at coarse levels without their extremes, and on cut-away values in them.
pub(super) fn of_extremes(scene: &ResolvedScene, found: &DoubtfulExtremes, volumes: &[VolumeSource]) -> Vec<String> {
    let names = |layers: &[usize]| {
        let of_layers = scene.layers.iter().filter(|layer| layers.contains(&layer.place));
        let mut names: Vec<String> =
            of_layers.map(|layer| volumes[layer.volume].name().unwrap_or_else(|| "the volume".into())).collect();
        names.dedup();
        names
    };
    let lost = of_lost(scene.mode, &names(&found.lost));
    let cut = names(&found.past_cuts);
    let past_cuts = (!cut.is_empty()).then(|| {
        let are = if cut.len() == 1 { "is" } else { "are" };
        format!(
            "{} {are} drawn at a coarse level, whose voxels at a cut hold the extremes of both sides: values up to one \
             voxel behind the cut may show; --level 0 cuts exactly",
            cut.join(" and ")
        )
    });
    lost.into_iter().chain(past_cuts).collect()
}

fn of_lost(mode: Mode, names: &[String]) -> Option<String> {
    let (specks, pyramids) = match mode.extreme() {
        Some(Extreme::Least) => ("dark specks may be brighter than they are", "mean,min"),
        _ => ("bright specks may be darker than they are", "mean,max"),
    };
    (!names.is_empty()).then(|| {
        format!(
            "{} {} drawn at a coarse level, whose voxels lack the extremes of the finer ones: {specks}, or missing; \
             --level 0 draws all voxels, and a store packed with --downsample {pyramids} loses none at any level",
            names.join(" and "),
            if names.len() == 1 { "is" } else { "are" },
        )
    })
}

/// Describes a channel's range of values, in words after "the values of".
fn reach(channel: u32, volume: &VolumeSource) -> String {
    let (low, high) = volume.likely_range(channel);
    let [from, to] = [low, high].map(|value| within_span(value, high - low));
    let to = with_unit(&to, volume.value_unit(channel));
    format!("{} are from {from} to {to}", volume.name().as_deref().unwrap_or("the volume"))
}

fn slice_outside(slice: Slice, scene: &Scene, volumes: &[VolumeSource]) -> Option<String> {
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let corners = box_corners(scene.world_box(&places).ok()?);
    let normal = slice.normal.normalize_or_zero();
    let along = corners.into_iter().map(|corner| normal.dot(corner));
    let (from, to) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), at| (from.min(at), to.max(at)));
    let (at, half) = (normal.dot(slice.point), slice.thickness / 2.0);
    let axis = (0..3).find(|&a| normal[a].abs() > 1.0 - 1e-9);
    let told = |along: f64| significant(along, 7);
    (at + half < from || at - half > to).then(|| match axis {
        Some(a) => {
            let turned = |along: f64| along * normal[a].signum();
            let (from, to) = (turned(from).min(turned(to)), turned(from).max(turned(to)));
            let axis = ["x", "y", "z"][a];
            let [at, from, to] = [turned(at), from, to].map(told);
            format!(
                "the slice lies outside of the scene: it is at {axis} = {at}, and the scene reaches from {from} to {to}"
            )
        }
        None => {
            let [at, from, to] = [at, from, to].map(told);
            format!(
                "the slice lies outside of the scene: it is at {at} along its normal, and the scene reaches from \
                 {from} to {to}"
            )
        }
    })
}

fn isovalues_outside(scene: &Scene, layer: usize, volumes: &[VolumeSource]) -> Vec<String> {
    let Some(volume) = volumes.get(scene.store(layer)).filter(|_| !scene.mode.is_projection()) else {
        return Vec::new();
    };
    let channel = scene.layers[layer].channel;
    // Beyond a sample there may be more.
    let (low, high) = volume.source.channel_range(channel);
    let surfaces = scene.layers[layer].isosurfaces.iter();
    let outside = surfaces.map(|surface| surface.value).filter(|value| !(low..=high).contains(value));
    outside.map(|value| format!("there is no surface of {value}: the values of {}", reach(channel, volume))).collect()
}

/// Upper bound of the least value of scans in Hounsfield units: each contains air, at -1000.
const AIR: f64 = -500.0;

fn preset_of_other_data(scene: &Scene, layer: usize, volumes: &[VolumeSource]) -> Option<String> {
    let volume = volumes.get(scene.store(layer))?;
    let layer = &scene.layers[layer];
    // A preset with its own range of values: those for CT.
    let transfer = layer.transfer.as_ref().filter(|choice| !choice.spans_window() && layer.window.is_none())?;
    let TransferChoice::Preset(choice) = transfer else { return None };
    (volume.likely_range(layer.channel).0 > AIR).then(|| {
        let (preset, reach) = (&choice.preset, reach(layer.channel, volume));
        format!(
            "{preset} is for Hounsfield units, in which air is -1000: the values of {reach}; --transfer auto fits any \
             data"
        )
    })
}
