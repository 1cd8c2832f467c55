//! Isosurfaces: where a ray first passes the isovalue, and how it is lit there, as [`brickyard_volume::surface`] says.

use crate::{Array, Path, ReferenceVolume};
use brickyard_volume::surface::{FLAT_CODES, PARTS, ROUNDS, headlight};
use brickyard_volume::{FrameSettings, Ray};
use glam::DVec3;

/// The colour of the surface that the ray meets, if it does.
pub(crate) fn color(frame: &FrameSettings, volume: &ReferenceVolume<'_>, ray: &Ray) -> Option<[f64; 3]> {
    let path = Path::new(frame, ray);
    let (t, level) = hit(frame, volume, &path)?;
    let gradient = gradient(level, path.at(t), frame);
    let (own, white) = headlight(gradient.map(|g| g.normalize().dot(ray.direction)));
    Some(volume.transfer.rgb(frame.isovalue).map(|c| own * c + white))
}

/// The distance of the first crossing, and the level that it is drawn at.
pub(crate) fn hit<'a>(frame: &FrameSettings, volume: &ReferenceVolume<'a>, path: &Path) -> Option<(f64, &'a Array)> {
    let is_inside = |value: f64| value >= frame.isovalue;
    let mut before = None;
    for (i, segment) in path.segments(frame, volume).enumerate() {
        let level = &volume.levels[(volume.level_at)(path.at(segment.middle()))];
        let field = |t: f64| level.sample(path.at(t), frame.sampling.filter);
        if i == 0 {
            before = field(segment.start).map(is_inside);
        }
        let after = field(segment.end).map(is_inside);
        if let (Some(before), Some(after)) = (before, after)
            && before != after
        {
            let t = locate(segment.start, segment.end, after, frame.isovalue, field);
            return Some((t, level));
        }
        before = after;
    }
    None
}

/// Where the field passes the isovalue between `a` and `b`, at the latest of which it is inside or not.
fn locate(mut a: f64, mut b: f64, is_inside: bool, isovalue: f64, field: impl Fn(f64) -> Option<f64>) -> f64 {
    for _ in 0..ROUNDS {
        let part = (b - a) / PARTS as f64;
        let start = a;
        let is_past = |k: &usize| field(start + part * *k as f64).is_some_and(|v| (v >= isovalue) == is_inside);
        let first = (0..PARTS).find(is_past).unwrap_or(PARTS);
        if first == 0 {
            // The brick before saw it on the other side here.
            return a;
        }
        (a, b) = (start + part * (first - 1) as f64, start + part * first as f64);
    }
    match (field(a), field(b)) {
        (Some(from), Some(to)) if from != to => a + (b - a) * ((isovalue - from) / (to - from)).clamp(0.0, 1.0),
        _ => b,
    }
}

/// The direction of a level's gradient in the world, by differences of a voxel to each side; `None` where it is flat. A place
/// without a value is as good as the surface.
fn gradient(level: &Array, point: DVec3, frame: &FrameSettings) -> Option<DVec3> {
    let voxel = DVec3::from_array(level.factor.map(f64::from));
    let value = |point| level.sample(point, frame.sampling.filter).unwrap_or(frame.isovalue);
    let along = |a: usize| value(point + DVec3::AXES[a] * voxel) - value(point - DVec3::AXES[a] * voxel);
    let differences = DVec3::new(along(0), along(1), along(2));
    let is_flat = differences.length() < FLAT_CODES * frame.encoding.code_width();
    (!is_flat).then(|| differences / (voxel * frame.geometry.spacing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{camera, cube, settings};
    use crate::{one_level, pixel};
    use brickyard_volume::lighting::{AMBIENT, DIFFUSE, SPECULAR};
    use brickyard_volume::{Clip, ClipPlane, Geometry, Mode, TransferFunction};

    fn transfer() -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, 0.0, 0.5, 1.0], [200.0, 1.0, 0.5, 0.0]],
            opacity: vec![[0.0, 0.0]],
            unit_distance: 1.0,
        }
    }

    fn at(isovalue: f64, geometry: Geometry, view: brickyard_volume::Camera, step: f64) -> FrameSettings {
        FrameSettings { isovalue, ..settings(Mode::Isosurface, geometry, view, &transfer(), step) }
    }

    #[test]
    fn a_sphere_is_met_where_it_is() {
        let (n, radius) = (128, 52.3);
        let spacing = DVec3::new(1.0, 0.5, 1.5);
        let centre = DVec3::new(63.0, 31.0, 95.0);
        let geometry = Geometry { spacing, ..Geometry::default() };
        // The distance from the centre in the world. Between voxels trilinear values are off by h^2 / 8 times the second
        // derivatives, together 2 / radius and less where voxels are smaller.
        let levels = [cube(n, |v| (DVec3::from_array(v.map(f64::from)) * spacing - centre).length())];
        let (transfer, level_at) = (transfer(), one_level(0));
        let volume = ReferenceVolume { levels: &levels, level_at: &level_at, transfer: &transfer };
        let eye = centre + DVec3::new(-150.0, 40.0, 90.0);
        for (radius, step) in [(radius * 0.5, 0.4), (radius * 0.5, 1.0), (radius * 0.25, 0.8)] {
            let frame = at(radius, geometry.clone(), camera(eye, centre), step);
            let mut met = 0;
            for (x, y) in (0..33).flat_map(|y| (0..33).map(move |x| (x, y))) {
                let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
                let nearest = (centre - ray.origin).dot(ray.direction);
                let half = radius.powi(2) - (ray.origin + ray.direction * nearest - centre).length_squared();
                let found = hit(&frame, &volume, &Path::new(&frame, &ray)).map(|(t, _)| t);
                if half < 0.0 {
                    assert!(half > -2.0 || found.is_none(), "{x} {y}");
                } else if half > 4.0 {
                    met += 1;
                    let point = ray.origin + ray.direction * found.expect("a ray through the sphere meets it");
                    // A hundredth of the finest voxel, and what the trilinear field is off.
                    let off = ((point - centre).length() - radius).abs();
                    let slack = 0.01 * 0.5 + 1.5f64.powi(2) / 8.0 * 2.0 / radius;
                    assert!(off < slack, "{x} {y}: {off} of {slack}");
                    assert!((point - ray.origin).length() < nearest, "it is the near side");
                }
            }
            assert!(met > 30, "{met}");
        }
    }

    #[test]
    fn a_plane_is_met_exactly_and_shaded_by_its_slope() {
        // In the world the gradient is along (1, 0, 1), in voxels along (2, 0, 1).
        let geometry = Geometry { spacing: DVec3::new(2.0, 1.0, 1.0), ..Geometry::default() };
        let levels = [cube(32, |[x, _, z]| 3.0 * (2 * x + z) as f64)];
        let (transfer, level_at) = (transfer(), one_level(0));
        let volume = ReferenceVolume { levels: &levels, level_at: &level_at, transfer: &transfer };
        let target = DVec3::new(30.0, 15.5, 15.5);
        for away in [DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 0.3, 2.0), DVec3::new(0.0, 0.0, 1.0)] {
            let view = brickyard_volume::Camera { up: DVec3::Y, ..camera(target + away * 50.0, target) };
            let frame = at(100.0, geometry.clone(), view, 0.7);
            let ray = frame.rays.ray(16.5, 16.5);
            let (t, _) = hit(&frame, &volume, &Path::new(&frame, &ray)).expect("the plane is in the way");
            let point = ray.origin + ray.direction * t;
            assert!((3.0 * (point.x + point.z) - 100.0).abs() < 1e-9, "{point}");
            let cosine = (ray.direction.x + ray.direction.z).abs() / 2f64.sqrt();
            let (own, white) = (AMBIENT + DIFFUSE * cosine, SPECULAR * cosine.powi(10));
            let found = pixel(&frame, &volume, &ray);
            for (k, c) in [0.5, 0.5, 0.5].into_iter().enumerate() {
                assert!((found[k] - (own * c + white)).abs() < 1e-9, "{away}: {found:?}");
            }
        }
    }

    #[test]
    fn what_is_shown_has_no_caps_and_its_inside_is_seen_from_inside() {
        let levels = [cube(32, |[x, ..]| 8.0 * x as f64)];
        let (transfer, level_at) = (transfer(), one_level(0));
        let volume = ReferenceVolume { levels: &levels, level_at: &level_at, transfer: &transfer };
        let middle = DVec3::splat(15.5);
        let view = camera(middle + DVec3::new(60.0, 0.0, 0.0), middle);
        let mut frame = at(100.0, Geometry::default(), view, 0.7);
        let central = |frame: &FrameSettings| {
            let ray = frame.rays.ray(16.5, 16.5);
            hit(frame, &volume, &Path::new(frame, &ray)).map(|(t, _)| (ray.origin + ray.direction * t).x)
        };
        // The ray starts inside, at 248, and comes out at x = 12.5.
        assert!((central(&frame).expect("the way out") - 12.5).abs() < 1e-9);
        let half = ClipPlane { point: DVec3::splat(14.0), normal: DVec3::X };
        for clip in [Clip::new(Some([DVec3::splat(14.0), DVec3::splat(31.0)]), &[]), Clip::new(None, &[half])] {
            frame.clip = Some(clip.expect("a clip"));
            assert_eq!(central(&frame), None);
        }
        assert_eq!(pixel(&frame, &volume, &frame.rays.ray(16.5, 16.5)), [0.25, 0.0, 1.0], "the background");
    }

    #[test]
    fn nothing_is_crossed_where_there_is_no_value() {
        // A gap of voxels without a value, wider than a segment, between the two sides.
        let wall = |gap: u32| move |[x, ..]: [u32; 3]| if x.abs_diff(16) < gap { f64::NAN } else { 10.0 * x as f64 };
        let (transfer, level_at) = (transfer(), one_level(0));
        let middle = DVec3::splat(15.5);
        for (gap, is_met) in [(0, true), (3, false)] {
            let levels = [cube(32, wall(gap))];
            let volume = ReferenceVolume { levels: &levels, level_at: &level_at, transfer: &transfer };
            let frame = at(155.0, Geometry::default(), camera(middle - DVec3::X * 60.0, middle), 0.7);
            let ray = frame.rays.ray(16.5, 16.5);
            assert_eq!(hit(&frame, &volume, &Path::new(&frame, &ray)).is_some(), is_met);
        }
    }
}
