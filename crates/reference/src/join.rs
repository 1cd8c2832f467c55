//! The joint result of all layers in a slab of a ray, by the rules of [`brickyard_volume::compositing`].

use crate::layer::{Piece, Way, segments};
use crate::surface::Crossings;
use brickyard_volume::compositing::JointMedium;
use brickyard_volume::surface::sort_met;
use brickyard_volume::{Blend, Combination, MAX_VOLUMES, Segment};
use glam::DVec3;

/// The colour of a ray between two distances: the layers there, over the colour `behind`.
pub(crate) fn slab(ways: &[Way<'_>], combination: Option<&Combination>, limits: [f64; 2], behind: DVec3) -> DVec3 {
    let Some(way) = ways.first() else { return behind };
    let (seen, left) = match combination {
        _ if way.frame.settings.mode.is_projection() => projections(ways, limits),
        None => media(ways, limits),
        Some(combination) => combined(combination, ways, limits),
    };
    seen + behind * left
}

/// Projects every layer separately, and joins the colours.
fn projections(ways: &[Way<'_>], limits: [f64; 2]) -> (DVec3, f64) {
    let mut together = JointMedium::default();
    for way in ways {
        if let Some(value) = way.projection(limits) {
            let rgb = way.volume.transfer.rgb(value);
            match way.frame.blend {
                Blend::Over => together.put_over(rgb, way.frame.opacity),
                blend => together.put(blend, rgb, way.frame.opacity, 1.0),
            }
        }
    }
    together.flat()
}

/// A ray's light on its way from the eye: premultiplied colour, and the remaining light.
struct Light {
    color: DVec3,
    left: f64,
}

impl Light {
    const WHOLE: Self = Self { color: DVec3::ZERO, left: 1.0 };

    /// Passes an interval or a surface with a premultiplied colour and a transmittance.
    fn see(&mut self, seen: DVec3, left: f64) {
        self.color += seen * self.left;
        self.left *= left;
    }

    fn see_joint(&mut self, together: &JointMedium) {
        let (seen, left) = together.seen();
        self.see(seen, left);
    }
}

/// The media and surfaces of all layers, segment by segment.
fn media(ways: &[Way<'_>], limits: [f64; 2]) -> (DVec3, f64) {
    let mut crossings: Vec<_> = ways.iter().map(|way| Crossings::new(&way.frame.settings)).collect();
    let mut light = Light::WHOLE;
    for segment in segments(ways, limits) {
        let (mut pieces, mut surfaces) = (Vec::new(), Vec::new());
        for (way, crossings) in ways.iter().zip(&mut crossings) {
            way.take(segment, crossings, &mut pieces, &mut surfaces);
        }
        sort_met(&mut surfaces, |surface| surface.at);
        let mut start = segment.start;
        for surface in surfaces {
            light.see_joint(&between(&pieces, start, surface.at.t));
            light.see(surface.color * surface.opacity, 1.0 - surface.opacity);
            start = start.max(surface.at.t);
        }
        light.see_joint(&between(&pieces, start, segment.end));
    }
    (light.color, light.left)
}

/// The joint medium of pieces between two distances.
fn between(pieces: &[Piece], start: f64, end: f64) -> JointMedium {
    let mut together = JointMedium::default();
    for Piece { ends, alone } in pieces {
        let length = ends.end.min(end) - ends.start.max(start);
        if length > 0.0 {
            together.put_share(alone, length / ends.length());
        }
    }
    together
}

/// The media of an expression's values, segment by segment.
fn combined(combination: &Combination, ways: &[Way<'_>], limits: [f64; 2]) -> (DVec3, f64) {
    let (transfer, first) = (&combination.transfer, &ways[0]);
    let mut light = Light::WHOLE;
    for segment in segments(ways, limits) {
        let (mut together, mut longest) = (JointMedium::default(), 0.0f64);
        let (mut values, mut gradients) = ([f64::NAN; MAX_VOLUMES], [DVec3::ZERO; MAX_VOLUMES]);
        for way in ways {
            let Some((Segment { start, end }, value)) = way.middle(segment) else { continue };
            (values[way.index], gradients[way.index]) = (value, way.gradient(segment, value));
            longest = longest.max(end - start);
        }
        let (value, gradient) = combination.expression.value_and_gradient(&values, &gradients);
        if !value.is_nan() {
            let length = longest / transfer.unit_distance;
            let color = first.lit(DVec3::from_array(transfer.rgb(value)), gradient, segment.middle());
            together.put(Blend::Mix, color.to_array(), transfer.alpha(value), length);
        }
        light.see_joint(&together);
    }
    (light.color, light.left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{camera, cube, settings};
    use crate::{ReferenceVolume, one_level, pixel};
    use brickyard_volume::{
        Camera, Clip, FrameSettings, Geometry, Jitter, Lighting, LightingModel, Method, Mode, Placement, Projection,
        Ray, Sampling, Surface, TransferFunction, VolumeFrame, surface,
    };

    fn fog(rgb: [f64; 3], alpha: f64, unit_distance: f64) -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, rgb[0], rgb[1], rgb[2]]],
            opacity: vec![[0.0, alpha]],
            unit_distance,
            ..TransferFunction::default()
        }
    }

    /// The distances at which a ray enters and leaves a box `low..high`.
    fn chord(ray: &Ray, low: DVec3, high: DVec3) -> Option<(f64, f64)> {
        let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
        let (from, to) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
        (from < to).then_some((from, to))
    }

    #[test]
    fn overlapping_media_are_what_formulas_say_at_any_step() {
        // Cubes of 8 voxels, the second one 5 to the right of the first, both crossed along x.
        let level = [cube(8, |_| 1.0)];
        let level_at = one_level(0);
        let view = camera(DVec3::new(-30.0, 3.5, 3.5), DVec3::new(8.0, 3.5, 3.5));
        let transfers = [fog([1.0, 0.5, 0.0], 0.1, 1.0), fog([0.0, 0.25, 1.0], 0.3, 2.0)];
        for (step, blend) in
            [(0.13, Blend::Mix), (1.0, Blend::Mix), (3.7, Blend::Mix), (1.0, Blend::Add), (3.7, Blend::Add)]
        {
            let frame = |i: usize| {
                let settings = settings(Mode::Dvr, Geometry::default(), view, &transfers[i], step);
                let placement = Placement::from_text(["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 5 0 1 0 0 0 0 1 0"][i]);
                let settings = FrameSettings { placement: placement.unwrap(), ..settings };
                VolumeFrame { settings, blend: if i == 1 { blend } else { Blend::Mix }, opacity: 1.0 }
            };
            let volume = |i: usize| ReferenceVolume { levels: &level, level_at: &level_at, transfer: &transfers[i] };
            let frames = [frame(0), frame(1)];
            let found = pixel(&frames, &[volume(0), volume(1)], None, 16, 16);
            // Halvings of the light per world unit.
            let depths = [-0.9f64.log2(), -0.7f64.log2() / 2.0];
            let colors = transfers.each_ref().map(|t| DVec3::from_array(t.rgb(0.0)));
            let background = DVec3::new(0.25, 0.0, 1.0);
            let segment = |inside: [bool; 2], length: f64| {
                let mixes = [inside[0], inside[1] && blend == Blend::Mix];
                let depth: f64 = (0..2).filter(|&i| mixes[i]).map(|i| depths[i]).sum();
                let left = (-depth * length).exp2();
                let color: DVec3 = (0..2).filter(|&i| mixes[i]).map(|i| colors[i] * depths[i]).sum();
                let mixed = if depth > 0.0 { color / depth * (1.0 - left) } else { DVec3::ZERO };
                let emission = if inside[1] && blend == Blend::Add { colors[1] * 0.15 } else { DVec3::ZERO };
                let dimmed = if depth > 0.0 { (1.0 - left) / (depth * 2f64.ln()) } else { length };
                (mixed + emission * dimmed, left)
            };
            let parts = [segment([true, false], 5.0), segment([true, true], 3.0), segment([false, true], 5.0)];
            let expected = parts.iter().rev().fold(background, |behind, (seen, left)| *seen + behind * *left);
            // The error of the end segments, which hold a part of each stretch: with long steps their contents are
            // taken to be spread evenly. Those of a seventh of a unit have a hundredth of each of them.
            let allowed = if step > 0.5 { 0.05 } else { 2e-4 };
            let off = (DVec3::from_array(found) - expected).abs().max_element();
            assert!(off < allowed, "step {step} {blend:?}: {found:?} {expected}");
        }
    }

    #[test]
    fn a_turned_and_stretched_cube_is_as_long_as_its_chords() {
        let level = [cube(10, |_| 1.0)];
        let (level_at, transfer) = (one_level(0), fog([1.0, 0.5, 0.25], 0.2, 3.0));
        let volume = ReferenceVolume { levels: &level, level_at: &level_at, transfer: &transfer };
        let map = "0.8 -1.2 0.3 4  0.6 0.9 -0.5 -7  0.1 0.7 2.5 11";
        let placement = Placement::from_text(map).unwrap();
        let geometry =
            Geometry { spacing: DVec3::new(1.0, 0.5, 2.0), origin: DVec3::new(3.0, 1.0, -2.0), ..Geometry::default() };
        let (low, high) = geometry.world_box(level[0].extent);
        let target = placement.world_from_volume((low + high) * 0.5);
        let crop = [low + (high - low) * 0.25, high];
        let mut met = 0;
        for (step, clip) in [(0.3, None), (2.9, None), (0.3, Some(crop))] {
            let plain = settings(
                Mode::Dvr,
                geometry.clone(),
                camera(target + DVec3::new(-60.0, 31.0, 22.0), target),
                &transfer,
                step,
            );
            let clip = Clip::in_volume(None, &placement, clip).unwrap();
            let (low, high) = clip.as_ref().map_or((low, high), |clip| (clip.corners()[0], clip.corners()[1]));
            let frame =
                [VolumeFrame { settings: FrameSettings { placement, clip, ..plain }, blend: Blend::Mix, opacity: 1.0 }];
            for i in 0..33 * 33 {
                let ray = frame[0].settings.rays.ray((i % 33) as f64 + 0.5, (i / 33) as f64 + 0.5);
                let length = chord(&placement.volume_ray(&ray), low, high).map_or(0.0, |(from, to)| to - from);
                let alpha = 1.0 - 0.8f64.powf(length / 3.0);
                let found = pixel(&frame, std::slice::from_ref(&volume), None, i % 33, i / 33);
                let expected = [alpha + (1.0 - alpha) * 0.25, alpha * 0.5, alpha * 0.25 + (1.0 - alpha)];
                for k in 0..3 {
                    assert!((found[k] - expected[k]).abs() < 1e-9, "{i}: {found:?} {expected:?}");
                }
                met += (length > 0.0) as u32;
            }
        }
        assert!(met > 600, "{met}");
    }

    /// Two ramps of value that look the same everywhere, one of them turned, leaning and stretched, in parallel view:
    /// each is lit in one colour, given by its exact gradient in the scene's world, independently of the other.
    #[test]
    fn each_volume_is_lit_by_its_own_gradient_where_it_stands() {
        let slope = DVec3::new(3.0, 1.0, 2.0);
        let levels =
            [[cube(24, |v| slope.dot(DVec3::from_array(v.map(f64::from))))], [cube(24, |[x, ..]| 5.0 * x as f64)]];
        let level_at = one_level(0);
        let transfers = [fog([1.0, 0.5, 0.0], 0.1, 1.0), fog([0.0, 0.25, 1.0], 0.3, 2.0)];
        let placements = ["1 0 0 0 0 1 0 0 0 0 1 0", "0.8 -1.2 0.3 12.7  0.6 0.9 -0.5 -0.5  0.1 0.7 2.5 -28.1"];
        let placements = placements.map(|text| Placement::from_text(text).unwrap());
        let volumes =
            [0, 1].map(|i| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfers[i] });
        let target = DVec3::splat(11.5);
        // Within the clip box: a ray entering through a side of it is first lit by that side's normal.
        let eye = target + 2.0 * (DVec3::new(-40.0, 3.0, 25.0) - target).normalize();
        let view = Camera { projection: Projection::Orthographic { height: 2.0 }, ..camera(eye, target) };
        let light = DVec3::new(1e9, -2e9, 3e9);
        // Gradients by definition: a value's changes from a place to its neighbours.
        let gradient = |i: usize| {
            let value = |place: DVec3| [slope, DVec3::X][i].dot(placements[i].volume_from_world(place));
            DVec3::from_array(DVec3::AXES.map(|axis| value(target + axis) - value(target))).normalize()
        };
        for (model, lights) in [
            (LightingModel::BlinnPhong, vec![]),
            (LightingModel::Phong, vec![light, -light]),
            (LightingModel::Tone, vec![light]),
        ] {
            let lighting = Lighting { model, lights, ..Lighting::default() };
            for (step, blend) in [(0.3, Blend::Mix), (1.9, Blend::Mix), (0.3, Blend::Add)] {
                let frame = |i: usize| {
                    let (placement, lighting) = (placements[i], lighting.clone());
                    let plain = settings(Mode::Dvr, Geometry::default(), view, &transfers[i], step);
                    // A box around all of the ramps' middles.
                    let clip = Clip::new(Some([target - 3.0, target + 3.0]), &[]).unwrap();
                    let clip = Clip::in_volume(Some(&clip), &placement, None).unwrap();
                    let settings = FrameSettings { placement, lighting, clip, ..plain };
                    VolumeFrame { settings, blend: if i == 1 { blend } else { Blend::Mix }, opacity: 1.0 }
                };
                let frames = [frame(0), frame(1)];
                let found = pixel(&frames, &volumes, None, 16, 16);
                let ray = frames[0].settings.rays.ray(16.5, 16.5);
                let (from, to) = chord(&ray, target - 3.0, target + 3.0).unwrap();
                let mut together = JointMedium::default();
                for (i, frame) in frames.iter().enumerate() {
                    let color = DVec3::from_array(transfers[i].rgb(0.0));
                    let lit = lighting.shade(color, Some(gradient(i)), ray.direction, ray.origin);
                    assert!((lit - color).length() > 0.02, "light that does not show proves nothing");
                    let shown = if frame.blend == Blend::Add { color } else { lit };
                    let length = (to - from) / transfers[i].unit_distance;
                    together.put(frame.blend, shown.to_array(), transfers[i].alpha(0.0), length);
                }
                let (seen, left) = together.seen();
                let expected = seen + DVec3::new(0.25, 0.0, 1.0) * left;
                let off = (DVec3::from_array(found) - expected).abs().max_element();
                // Lights a billion away are not quite in one direction.
                assert!(off < 1e-6, "{model:?} {step} {blend:?}: {found:?} {expected}");
            }
        }
    }

    /// Planes of two ramps on unlike grids, one of them turned, leaning and stretched, both in fog: they lie at their
    /// values, in the order of their distances, several of them in one segment with long steps, and each stretch
    /// between them is two fogs.
    #[test]
    fn surfaces_of_all_volumes_stand_in_the_fog_of_all() {
        let slope = DVec3::new(3.0, 1.0, 2.0);
        let levels =
            [[cube(24, |v| slope.dot(DVec3::from_array(v.map(f64::from))))], [cube(24, |[x, ..]| 5.0 * x as f64)]];
        let level_at = one_level(0);
        let transfers = [fog([1.0, 0.5, 0.0], 0.1, 4.0), fog([0.0, 0.25, 1.0], 0.15, 2.0)];
        let placements = ["1 0 0 0 0 1 0 0 0 0 1 0", "0.8 -1.2 0.3 12.7  0.6 0.9 -0.5 -0.5  0.1 0.7 2.5 -28.1"];
        let placements = placements.map(|text| Placement::from_text(text).unwrap());
        let volumes =
            [0, 1].map(|i| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfers[i] });
        let target = DVec3::splat(11.5);
        let view = Camera {
            projection: Projection::Orthographic { height: 2.0 },
            ..camera(DVec3::new(-40.0, 3.0, 25.0), target)
        };
        let surface = |threshold: f64, color: [f32; 3], opacity: f32| Surface { threshold, color, opacity };
        let surfaces = [
            vec![surface(66.0, [1.0, 0.0, 0.0], 0.5), surface(69.5, [0.0, 1.0, 0.0], 0.25)],
            vec![surface(54.0, [0.0, 0.0, 1.0], 0.5), surface(60.0, [1.0, 1.0, 0.0], 0.75)],
        ];
        for (step, blend) in [(0.31, Blend::Mix), (1.0, Blend::Mix), (2.7, Blend::Mix), (1.0, Blend::Add)] {
            let clip = Clip::new(Some([target - 3.0, target + 3.0]), &[]).unwrap();
            let frame = |i: usize| {
                let placement = placements[i];
                let plain = settings(Mode::Dvr, Geometry::default(), view, &transfers[i], step);
                let clip = Clip::in_volume(Some(&clip), &placement, None).unwrap();
                let settings = FrameSettings { placement, clip, surfaces: surfaces[i].clone(), ..plain };
                VolumeFrame { settings, blend: if i == 1 { blend } else { Blend::Mix }, opacity: 1.0 }
            };
            let frames = [frame(0), frame(1)];
            let found = pixel(&frames, &volumes, None, 16, 16);
            let ray = frames[0].settings.rays.ray(16.5, 16.5);
            let (from, to) = chord(&ray, target - 3.0, target + 3.0).unwrap();
            // Voxel centres of the default geometry are at whole numbers of the world.
            let gradient = |i: usize| {
                let value = |place: DVec3| [slope, DVec3::X * 5.0][i].dot(placements[i].volume_from_world(place));
                let at = value(ray.origin);
                let along = DVec3::from_array(DVec3::AXES.map(|axis| value(ray.origin + axis) - at));
                (at, along)
            };
            let mut met = Vec::new();
            for (i, surfaces) in surfaces.iter().enumerate() {
                let (at, along) = gradient(i);
                for surface in surfaces {
                    let t = (surface.threshold - at) / along.dot(ray.direction);
                    assert!(from < t && t < to, "{t} of {from} to {to}");
                    let lighting = surface::lighting(&frames[i].settings.lighting);
                    let color = DVec3::from_array(surface.color.map(f64::from));
                    let color = lighting.shade(color, Some(along.normalize()), ray.direction, ray.origin);
                    met.push((t, color, surface.opacity as f64));
                }
            }
            met.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (mut color, mut light) = (DVec3::ZERO, 1.0);
            let mut see = |(seen, left): (DVec3, f64)| {
                color += seen * light;
                light *= left;
            };
            let fogs = |length: f64| {
                let mut together = JointMedium::default();
                for (transfer, frame) in transfers.iter().zip(&frames) {
                    together.put(frame.blend, transfer.rgb(0.0), transfer.alpha(0.0), length / transfer.unit_distance);
                }
                together.seen()
            };
            let mut start = from;
            for (t, surface, opacity) in met {
                see(fogs(t - start));
                see((surface * opacity, 1.0 - opacity));
                start = t;
            }
            see(fogs(to - start));
            let expected = color + DVec3::new(0.25, 0.0, 1.0) * light;
            let off = (DVec3::from_array(found) - expected).abs().max_element();
            assert!(off < 1e-6, "step {step} {blend:?}: {found:?} {expected}");
        }
    }

    /// A wave, by every method, jittered, with surfaces in it or alone, projected, with a mesh before and behind: an
    /// empty layer beside it changes nothing. Segments lengthened by the other layer's stretch would change, so both
    /// have one size.
    #[test]
    fn a_layer_that_shows_nothing_changes_nothing() {
        let wave =
            |[x, y, z]: [u32; 3]| 127.0 + 80.0 * ((x + 2 * y) as f64 * 0.4).sin() + 40.0 * (z as f64 * 0.7).cos();
        let levels = [[cube(12, wave)], [cube(12, |_| f64::NAN)]];
        let level_at = one_level(0);
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 0.0, 0.2], [255.0, 0.1, 1.0, 0.6]],
            opacity: vec![[60.0, 0.0], [120.0, 0.4], [230.0, 1.0]],
            unit_distance: 2.0,
            ..TransferFunction::default()
        };
        let volumes = [0, 1].map(|i| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfer });
        let eye = camera(DVec3::new(-30.0, 20.0, 9.0), DVec3::splat(5.5));
        let surfaces = vec![Surface { threshold: 140.0, color: [1.0, 0.5, 0.0], opacity: 0.4 }];
        let lit = Lighting { model: LightingModel::Phong, lights: vec![DVec3::ZERO], ..Lighting::default() };
        let mut pictures = Vec::new();
        let sampled = |method, jitter| Sampling { method, jitter, ..Sampling::default() };
        let methods = Method::ALL.map(|method| (Mode::Dvr, sampled(method, Jitter::White(3)), vec![]));
        let layered = Method::ALL.map(|method| (Mode::Dvr, sampled(method, Jitter::None), surfaces.clone()));
        let modes = [Mode::Mip, Mode::MinIp, Mode::Average, Mode::Isosurface];
        let modes = modes.map(|mode| (mode, sampled(Method::Udvr, Jitter::Blue), surfaces.clone()));
        for (mode, sampling, surfaces) in methods.into_iter().chain(layered).chain(modes) {
            let plain = settings(mode, Geometry::default(), eye, &transfer, 0.7);
            let lighting = if surfaces.is_empty() { lit.clone() } else { Lighting::default() };
            let frame = VolumeFrame::alone(FrameSettings { sampling, surfaces, lighting, ..plain });
            let pixels: Vec<_> = (0..33 * 33).step_by(4).map(|i| [i % 33, i / 33]).collect();
            let drawn = |count: usize| -> Vec<[f64; 3]> {
                let frames = vec![frame.clone(); count];
                pixels.iter().map(|&[x, y]| pixel(&frames, &volumes[..count], None, x, y)).collect()
            };
            let alone = drawn(1);
            assert_eq!(drawn(2), alone, "{mode:?} {sampling:?}");
            pictures.push(alone);
        }
        let differs = |i: usize| pictures[..i].iter().all(|other| *other != pictures[i]);
        assert!((0..pictures.len()).all(differs), "pictures that are alike prove nothing");
    }

    /// Two constant media of one box by every method, at steps longer and shorter than a voxel: one medium of both
    /// depths.
    #[test]
    fn media_of_one_place_are_one_medium_by_every_method() {
        let levels = [[cube(16, |_| 100.0)], [cube(16, |_| 50.0)]];
        let level_at = one_level(0);
        let transfers = [fog([1.0, 0.5, 0.0], 0.1, 1.0), fog([0.0, 0.25, 1.0], 0.3, 2.0)];
        let volumes =
            [0, 1].map(|i| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfers[i] });
        let view = camera(DVec3::new(-40.0, 7.5, 7.5), DVec3::splat(7.5));
        let depths = [-0.9f64.log2(), -0.7f64.log2() / 2.0];
        for (method, step) in Method::ALL.into_iter().flat_map(|method| [(method, 0.3), (method, 3.0)]) {
            for blend in Blend::ALL {
                let frame = |i: usize| {
                    let plain = settings(Mode::Dvr, Geometry::default(), view, &transfers[i], step);
                    let sampling = Sampling { method, ..Sampling::default() };
                    let blend = if i == 1 { blend } else { Blend::Mix };
                    let settings = FrameSettings { sampling, background: [0.0; 3], ..plain };
                    VolumeFrame { settings, blend, opacity: 1.0 }
                };
                let found = DVec3::from_array(pixel(&[frame(0), frame(1)], &volumes, None, 16, 16));
                let colors = transfers.each_ref().map(|t| DVec3::from_array(t.rgb(0.0)));
                let expected = match blend {
                    Blend::Mix | Blend::Over => {
                        let depth = depths[0] + depths[1];
                        (colors[0] * depths[0] + colors[1] * depths[1]) / depth * (1.0 - (-depth * 16.0).exp2())
                    }
                    Blend::Add => {
                        let hidden = 1.0 - 0.9f64.powi(16);
                        colors[0] * hidden + colors[1] * (0.15 * hidden / (depths[0] * 2f64.ln()))
                    }
                };
                // Running integrals are of the table, with opacities in f32.
                assert!(
                    (found - expected).abs().max_element() < 1e-6,
                    "{method:?} {step} {blend:?}: {found} {expected}"
                );
            }
        }
    }

    /// Boxes beside and behind one another, each of one value, projected: where both are, the mean of their colours, or
    /// their sum.
    #[test]
    fn projections_are_joined_by_their_opacities() {
        let level = [cube(8, |_| 1.0)];
        let level_at = one_level(0);
        let transfers = [fog([1.0, 0.5, 0.0], 0.1, 1.0), fog([0.0, 0.25, 0.5], 0.3, 2.0)];
        let volumes = [0, 1].map(|i| ReferenceVolume { levels: &level, level_at: &level_at, transfer: &transfers[i] });
        let view = camera(DVec3::new(-30.0, 3.5, 3.5), DVec3::new(8.0, 3.5, 3.5));
        let [a, b] = transfers.each_ref().map(|t| DVec3::from_array(t.rgb(0.0)));
        let background = DVec3::new(0.25, 0.0, 1.0);
        let half = |both: DVec3, left: f64| both * (1.0 - left) + background * left;
        let (mix, add) = (Blend::Mix, Blend::Add);
        for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
            for (looks, expected) in [
                ([(mix, 1.0), (mix, 1.0)], (a + b) * 0.5),
                ([(mix, 1.0), (add, 0.5)], a + b * 0.5),
                ([(add, 1.0), (add, 0.25)], a + b * 0.25 + background),
                ([(mix, 0.5), (mix, 0.5)], half((a + b) * 0.5, 0.25)),
                ([(mix, 0.75), (mix, 0.5)], half((a * 2.0 + b) / 3.0, 0.125)),
                ([(mix, 0.5), (mix, 0.0)], half(a, 0.5)),
            ] {
                let frame = |i: usize| {
                    let settings = settings(mode, Geometry::default(), view, &transfers[i], 1.0);
                    VolumeFrame { settings, blend: looks[i].0, opacity: looks[i].1 }
                };
                let found = DVec3::from_array(pixel(&[frame(0), frame(1)], &volumes, None, 16, 16));
                assert!((found - expected).abs().max_element() < 1e-12, "{mode:?} {looks:?}: {found} {expected}");
            }
        }
    }

    /// Two ramps, one of them turned, leaning and stretched: their sum is a ramp again, lit on one side by its own
    /// gradient.
    #[test]
    fn an_expression_is_lit_by_its_own_gradient() {
        let slope = DVec3::new(3.0, 1.0, 2.0);
        let levels =
            [[cube(24, |v| slope.dot(DVec3::from_array(v.map(f64::from))))], [cube(24, |[x, ..]| 5.0 * x as f64)]];
        let level_at = one_level(0);
        let transfer = fog([1.0, 0.5, 0.0], 0.1, 1.0);
        let placements = ["1 0 0 0 0 1 0 0 0 0 1 0", "0.8 -1.2 0.3 12.7  0.6 0.9 -0.5 -0.5  0.1 0.7 2.5 -28.1"];
        let placements = placements.map(|text| Placement::from_text(text).unwrap());
        let volumes = [0, 1].map(|i| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfer });
        let target = DVec3::splat(11.5);
        // Within the clip box: a ray entering through a side of it is first lit by that side's normal.
        let eye = target + 2.0 * (DVec3::new(-40.0, 3.0, 25.0) - target).normalize();
        let view = Camera { projection: Projection::Orthographic { height: 2.0 }, ..camera(eye, target) };
        let lighting = Lighting { model: LightingModel::BlinnPhong, lights: vec![], ..Lighting::default() };
        let clip = Clip::new(Some([target - 3.0, target + 3.0]), &[]).unwrap();
        let frame = |i: usize| {
            let placement = placements[i];
            let plain = settings(Mode::Dvr, Geometry::default(), view, &transfer, 0.3);
            let clip = Clip::in_volume(Some(&clip), &placement, None).unwrap();
            VolumeFrame::alone(FrameSettings { placement, lighting: lighting.clone(), clip, ..plain })
        };
        let mut seen = Vec::new();
        for text in ["a + b", "a - 3 * b", "max(a, b - 1000)", "b - b"] {
            let expression = brickyard_volume::Expression::parse(text, 2).unwrap();
            let value = |place: DVec3| {
                let value = |i: usize| [slope, DVec3::X * 5.0][i].dot(placements[i].volume_from_world(place));
                expression.value(&[value(0), value(1)])
            };
            let gradient = DVec3::from_array(DVec3::AXES.map(|axis| value(target + axis) - value(target)));
            let combination = Combination::new(expression.clone(), transfer.clone());
            let found = pixel(&[frame(0), frame(1)], &volumes, Some(&combination), 16, 16);
            let ray = view.rays(33, 33).unwrap().ray(16.5, 16.5);
            let (from, to) = chord(&ray, target - 3.0, target + 3.0).unwrap();
            let normal = (gradient.length() > 1e-9).then(|| gradient.normalize());
            let lit = lighting.shade(DVec3::new(1.0, 0.5, 0.0), normal, ray.direction, ray.origin);
            let left = 0.9f64.powf(to - from);
            let expected = lit * (1.0 - left) + DVec3::new(0.25, 0.0, 1.0) * left;
            let off = (DVec3::from_array(found) - expected).abs().max_element();
            assert!(off < 1e-9, "{text}: {found:?} {expected}");
            seen.push(lit);
        }
        assert!((0..4).all(|i| (0..i).all(|j| (seen[i] - seen[j]).length() > 0.01)), "{seen:?}");
    }

    /// Two cubes that overlap by 3 of their 8 voxels, under an expression of their values, where it has one.
    #[test]
    fn an_expression_is_a_medium_where_it_has_a_value() {
        let levels = [[cube(8, |_| 1.0)], [cube(8, |_| 3.0)]];
        let level_at = one_level(0);
        let view = camera(DVec3::new(-30.0, 3.5, 3.5), DVec3::new(8.0, 3.5, 3.5));
        let transfer = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [10.0, 1.0, 1.0, 1.0]],
            opacity: vec![[0.0, 0.0], [10.0, 0.5]],
            unit_distance: 1.5,
            ..TransferFunction::default()
        };
        for (text, values) in [
            ("a + b", [f64::NAN, 4.0, f64::NAN]),
            ("default(a, 0) + default(b, 0)", [1.0, 4.0, 3.0]),
            ("max(a, b * 0.5)", [f64::NAN, 1.5, f64::NAN]),
            ("valid(a) && valid(b) ? 9 : default(a, b)", [1.0, 9.0, 3.0]),
        ] {
            let expression = brickyard_volume::Expression::parse(text, 2).unwrap();
            let combination = Combination::new(expression, transfer.clone());
            let (mut color, mut light) = (DVec3::ZERO, 1.0);
            for (value, length) in values.into_iter().zip([5.0, 3.0, 5.0]).filter(|(value, _)| !value.is_nan()) {
                let left = (1.0 - transfer.alpha(value)).powf(length / 1.5);
                color += DVec3::from_array(transfer.rgb(value)) * light * (1.0 - left);
                light *= left;
            }
            let expected = color + DVec3::new(0.25, 0.0, 1.0) * light;
            // Steps that divide the crossed lengths evenly, so that no segment is in two cubes with parts of two
            // lengths.
            for step in [0.5, 0.25] {
                let frame = |i: usize| {
                    let settings = settings(Mode::Dvr, Geometry::default(), view, &transfer, step);
                    let placement = Placement::from_text(["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 5 0 1 0 0 0 0 1 0"][i]);
                    let settings = FrameSettings { placement: placement.unwrap(), ..settings };
                    VolumeFrame { settings, blend: Blend::Mix, opacity: 1.0 }
                };
                let volume =
                    |i: usize| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfer };
                let found = pixel(&[frame(0), frame(1)], &[volume(0), volume(1)], Some(&combination), 16, 16);
                let off = (DVec3::from_array(found) - expected).abs().max_element();
                assert!(off < 1e-9, "{text} {step}: {found:?} {expected}");
            }
        }
    }
}
