//! Several volumes in one picture, as [`brickyard_volume::look`] says.

use crate::medium::Field;
use crate::surface::Crossings;
use crate::{Path, ReferenceVolume};
use brickyard_volume::look::Together;
use brickyard_volume::{Blend, Combination, MAX_VOLUMES, Picture, Segment, Surface, VolumeFrame, surface};
use glam::DVec3;

/// Renders the whole picture of volumes, each with its frame; plainly sampled, with surfaces or without; or that of an
/// expression over them.
///
/// # Panics
/// If there is no frame, or not one for each volume.
pub fn render_together(
    frames: &[VolumeFrame],
    volumes: &[ReferenceVolume<'_>],
    combination: Option<&Combination>,
) -> Picture {
    let rays = &frames[0].settings.rays;
    let mut rgb = Vec::with_capacity(rays.width as usize * rays.height as usize);
    for y in 0..rays.height {
        for x in 0..rays.width {
            let color = pixel_together(frames, volumes, combination, x, y);
            rgb.push(Picture::quantise(color.map(|c| c as f32)));
        }
    }
    Picture { width: rays.width, height: rays.height, rgb }
}

/// The display-referred colour of one pixel.
///
/// # Panics
/// As [`render_together`].
pub fn pixel_together(
    frames: &[VolumeFrame],
    volumes: &[ReferenceVolume<'_>],
    combination: Option<&Combination>,
    x: u32,
    y: u32,
) -> [f64; 3] {
    assert_eq!(frames.len(), volumes.len(), "a frame for each volume");
    let ways = frames.iter().zip(volumes).enumerate();
    let ways: Vec<_> = ways.filter_map(|(i, (frame, volume))| Way::new(i, frame, volume, x, y)).collect();
    let t_in = ways.iter().map(|way| way.stretch.0).fold(f64::INFINITY, f64::min);
    let t_out = ways.iter().map(|way| way.stretch.1).fold(0.0, f64::max);
    let mut crossings: Vec<_> = ways.iter().map(|way| Crossings::new(&way.frame.settings)).collect();
    let (mut color, mut light) = (DVec3::ZERO, 1.0);
    let mut see = |(seen, left): (DVec3, f64)| {
        color += seen * light;
        light *= left;
    };
    for segment in frames[0].settings.lattice.segments(t_in, t_out) {
        let read: Vec<_> = ways.iter().filter_map(|way| Some((way, way.read(segment)?))).collect();
        if let Some(combination) = combination {
            see(combined(combination, &read).seen());
            continue;
        }
        let between = |start: f64, end: f64| {
            let mut together = Together::default();
            read.iter().for_each(|(way, read)| way.put(read, [start, end], &mut together));
            together.seen()
        };
        let of_way = |(way, crossings)| Way::surfaces(way, segment, crossings);
        let mut surfaces: Vec<Met> = ways.iter().zip(&mut crossings).flat_map(of_way).collect();
        surfaces.sort_by(|a, b| a.t.total_cmp(&b.t));
        let mut start = segment.start;
        for Met { t, color, opacity } in surfaces {
            see(between(start, t));
            see((color * opacity, 1.0 - opacity));
            start = t;
        }
        see(between(start, segment.end));
    }
    let background = DVec3::from_array(frames[0].settings.background.map(f64::from));
    (color + background * light).to_array()
}

/// The medium of an expression's value, given what is read of volumes.
fn combined(combination: &Combination, read: &[(&Way<'_>, Read<'_>)]) -> Together {
    let (mut together, mut longest) = (Together::default(), 0.0f64);
    let mut values = [f64::NAN; MAX_VOLUMES];
    for (way, Read { value, part, .. }) in read {
        values[way.index] = *value;
        longest = longest.max(part.length());
    }
    let (value, transfer) = (combination.expression.value(&values), &combination.transfer);
    if !value.is_nan() {
        let length = longest / transfer.unit_distance;
        together.put(Blend::Mix, transfer.rgb(value), transfer.alpha(value), length);
    }
    together
}

/// A ray's way through one volume.
struct Way<'a> {
    index: usize,
    frame: &'a VolumeFrame,
    volume: &'a ReferenceVolume<'a>,
    path: Path,
    stretch: (f64, f64),
}

/// A surface that a ray meets: where, and what it shows.
struct Met {
    t: f64,
    color: DVec3,
    opacity: f64,
}

/// A volume's part of a segment, and the value in the middle of it.
struct Read<'a> {
    field: Field<'a>,
    part: Segment,
    value: f64,
}

impl<'a> Way<'a> {
    /// `None` if it misses what is shown.
    fn new(index: usize, frame: &'a VolumeFrame, volume: &'a ReferenceVolume<'a>, x: u32, y: u32) -> Option<Self> {
        let path = Path::new(&frame.settings, x, y);
        let stretch = path.stretch(&frame.settings, volume)?;
        Some(Self { index, frame, volume, path, stretch })
    }

    /// Its part of a segment, and the field there.
    fn part(&self, segment: Segment) -> Option<(Segment, Field<'_>)> {
        let part = Segment { start: segment.start.max(self.stretch.0), end: segment.end.min(self.stretch.1) };
        let frame = &self.frame.settings;
        (part.length() > 0.0).then(|| {
            let level = &self.volume.levels[(self.volume.level_at)(self.path.at(part.middle()))];
            (part, Field { frame, level, path: &self.path, lighting: &frame.lighting })
        })
    }

    /// What is read of a segment.
    fn read(&self, segment: Segment) -> Option<Read<'_>> {
        let (part, field) = self.part(segment)?;
        Some(Read { field, part, value: field.value(part.middle())? })
    }

    /// The surfaces in a segment, lit.
    fn surfaces(&self, segment: Segment, crossings: &mut Crossings<'_>) -> Vec<Met> {
        let Some((part, field)) = self.part(segment) else { return Vec::new() };
        let lighting = surface::lighting(field.lighting);
        let field = Field { lighting: &lighting, ..field };
        let met = |(t, surface): (f64, &Surface)| {
            let color = DVec3::from_array(surface.color.map(f64::from));
            let color = field.shade(color, field.differences(t, surface.threshold), t);
            Met { t, color, opacity: surface.opacity as f64 }
        };
        crossings.within(part, |t| field.value(t)).into_iter().map(met).collect()
    }

    /// Puts in the medium of what was read, as much of it as is in a piece of the segment.
    fn put(&self, &Read { field, part, value }: &Read<'_>, [start, end]: [f64; 2], together: &mut Together) {
        let length = part.end.min(end) - part.start.max(start);
        if length <= 0.0 {
            return;
        }
        let (transfer, middle) = (self.volume.transfer, part.middle());
        let mut rgb = transfer.rgb(value);
        if self.frame.is_lit() {
            rgb = field.shade(DVec3::from_array(rgb), field.differences(middle, value), middle).to_array();
        }
        together.put(self.frame.blend, rgb, transfer.alpha(value), length / transfer.unit_distance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{camera, cube, settings};
    use crate::{Array, one_level, pixel};
    use brickyard_volume::{
        Blend, Camera, Clip, FrameSettings, Geometry, Lighting, LightingModel, Mode, Placement, Projection, Ray,
        TransferFunction,
    };

    fn fog(rgb: [f64; 3], alpha: f64, unit_distance: f64) -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, rgb[0], rgb[1], rgb[2]]],
            opacity: vec![[0.0, alpha]],
            unit_distance,
            ..TransferFunction::default()
        }
    }

    /// Length of a ray inside a box `low..high`.
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
            let found = pixel_together(&frames, &[volume(0), volume(1)], None, 16, 16);
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
                let glow = if inside[1] && blend == Blend::Add { colors[1] * 0.15 } else { DVec3::ZERO };
                let dimmed = if depth > 0.0 { (1.0 - left) / (depth * 2f64.ln()) } else { length };
                (mixed + glow * dimmed, left)
            };
            let parts = [segment([true, false], 5.0), segment([true, true], 3.0), segment([false, true], 5.0)];
            let expected = parts.iter().rev().fold(background, |behind, (seen, left)| *seen + behind * *left);
            // What the ends' segments, which hold a part of each stretch, get wrong where steps are long: what is there is taken
            // to be spread evenly. Those of a seventh of a unit have a hundredth of each of them.
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
        let geometry = Geometry { spacing: DVec3::new(1.0, 0.5, 2.0), origin: DVec3::new(3.0, 1.0, -2.0), unit: None };
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
                let found = pixel_together(&frame, std::slice::from_ref(&volume), None, i % 33, i / 33);
                let expected = [alpha + (1.0 - alpha) * 0.25, alpha * 0.5, alpha * 0.25 + (1.0 - alpha)];
                for k in 0..3 {
                    assert!((found[k] - expected[k]).abs() < 1e-9, "{i}: {found:?} {expected:?}");
                }
                met += (length > 0.0) as u32;
            }
        }
        assert!(met > 600, "{met}");
    }

    /// Two ramps of value that look the same everywhere, one of them turned, leaning and stretched, seen in parallel: the light on each is
    /// one colour, which its exact gradient in the scene's world gives, whatever the other does.
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
        let eye = DVec3::new(-40.0, 3.0, 25.0);
        let view = Camera { projection: Projection::Orthographic { height: 2.0 }, ..camera(eye, target) };
        let light = DVec3::new(1e9, -2e9, 3e9);
        // Gradients by the definition of one: how much a value changes from a place to others beside it.
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
                    // What all of the ramps' middles are in.
                    let clip = Clip::new(Some([target - 3.0, target + 3.0]), &[]).unwrap();
                    let clip = Clip::in_volume(Some(&clip), &placement, None).unwrap();
                    let settings = FrameSettings { placement, lighting, clip, ..plain };
                    VolumeFrame { settings, blend: if i == 1 { blend } else { Blend::Mix }, opacity: 1.0 }
                };
                let frames = [frame(0), frame(1)];
                let found = pixel_together(&frames, &volumes, None, 16, 16);
                let ray = frames[0].settings.rays.ray(16.5, 16.5);
                let (from, to) = chord(&ray, target - 3.0, target + 3.0).unwrap();
                let mut together = Together::default();
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

    /// Planes of two ramps on unlike grids, one of them turned, leaning and stretched, both in fog: they are where their values say, in the
    /// order of their distances, several of them in one segment where steps are long, and each stretch between them is two fogs.
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
            let found = pixel_together(&frames, &volumes, None, 16, 16);
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
                let mut together = Together::default();
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

    #[test]
    fn one_volume_is_the_picture_of_one_volume() {
        let wave =
            |[x, y, z]: [u32; 3]| 127.0 + 80.0 * ((x + 2 * y) as f64 * 0.4).sin() + 40.0 * (z as f64 * 0.7).cos();
        let level: [Array; 1] = [cube(12, wave)];
        let level_at = one_level(0);
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 0.0, 0.2], [255.0, 0.1, 1.0, 0.6]],
            opacity: vec![[60.0, 0.0], [120.0, 0.4], [230.0, 1.0]],
            unit_distance: 2.0,
            ..TransferFunction::default()
        };
        let volume = ReferenceVolume { levels: &level, level_at: &level_at, transfer: &transfer };
        let settings = settings(
            Mode::Dvr,
            Geometry::default(),
            camera(DVec3::new(-30.0, 20.0, 9.0), DVec3::splat(5.5)),
            &transfer,
            0.7,
        );
        let frame = [VolumeFrame { settings, blend: Blend::Mix, opacity: 1.0 }];
        let mut lit = frame.clone();
        lit[0].settings.lighting =
            Lighting { model: LightingModel::Phong, lights: vec![DVec3::ZERO], ..Lighting::default() };
        for i in 0..33 * 33 {
            for frame in [&frame, &lit] {
                let together = pixel_together(frame, std::slice::from_ref(&volume), None, i % 33, i / 33);
                let alone = pixel(&frame[0].settings, &volume, i % 33, i / 33);
                // Rounding.
                (0..3).for_each(|k| assert!((together[k] - alone[k]).abs() < 1e-12, "{i}: {together:?} {alone:?}"));
            }
        }
    }

    /// Two cubes that overlap by 3 of their 8 voxels, and what an expression makes of their values where it has one.
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
            // A step that divides what is met evenly, so that no segment is in two cubes with parts of two lengths.
            for step in [0.5, 0.25] {
                let frame = |i: usize| {
                    let settings = settings(Mode::Dvr, Geometry::default(), view, &transfer, step);
                    let placement = Placement::from_text(["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 5 0 1 0 0 0 0 1 0"][i]);
                    let settings = FrameSettings { placement: placement.unwrap(), ..settings };
                    VolumeFrame { settings, blend: Blend::Mix, opacity: 1.0 }
                };
                let volume =
                    |i: usize| ReferenceVolume { levels: &levels[i], level_at: &level_at, transfer: &transfer };
                let found = pixel_together(&[frame(0), frame(1)], &[volume(0), volume(1)], Some(&combination), 16, 16);
                let off = (DVec3::from_array(found) - expected).abs().max_element();
                assert!(off < 1e-9, "{text} {step}: {found:?} {expected}");
            }
        }
    }
}
