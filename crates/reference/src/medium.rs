//! Direct volume rendering by every method of [`brickyard_volume::sampling`], lit or not.

use crate::{Array, Path, ReferenceVolume};
use brickyard_volume::lighting::SMOOTH;
use brickyard_volume::sampling::{Curve, catmull_rom, cubic};
use brickyard_volume::surface::FLAT_CODES;
use brickyard_volume::{FrameSettings, Gradient, Integrals, LightingModel, Medium, Ray, Segment};
use glam::DVec3;

/// The colour of a ray, over the background.
pub(crate) fn color(frame: &FrameSettings, volume: &ReferenceVolume<'_>, ray: &Ray, background: DVec3) -> DVec3 {
    let integrals = frame.sampling.method.is_pre_integrated().then(|| Integrals::new(&frame.table));
    let path = Path::new(frame, ray);
    let (mut color, mut transmittance) = (DVec3::ZERO, 1.0);
    for segment in path.segments(frame, volume) {
        let level = &volume.levels[(volume.level_at)(path.at(segment.middle()))];
        let field = Field { frame, level, path: &path };
        for part in field.parts(segment) {
            let medium = match (&integrals, part.ends) {
                (Some(integrals), Some([from, to])) => integrals.between(field.code(from), field.code(to)),
                _ => Medium {
                    rgb: volume.transfer.rgb(part.value),
                    depth: -(1.0 - volume.transfer.alpha(part.value)).log2(),
                },
            };
            let rgb = frame.lighting.shade(
                DVec3::from_array(medium.rgb),
                field.normal(part.differences),
                ray.direction,
                ray.origin + ray.direction * part.middle,
            );
            let left = (-medium.depth * part.length / volume.transfer.unit_distance).exp2();
            color += transmittance * (1.0 - left) * rgb;
            transmittance *= left;
        }
    }
    color + transmittance * background
}

/// A part of a segment.
struct Part {
    middle: f64,
    length: f64,
    /// The value in its middle.
    value: f64,
    /// The values at its ends, where they count.
    ends: Option<[f64; 2]>,
    /// See [`Field::differences`].
    differences: DVec3,
}

/// A level along a ray.
struct Field<'a> {
    frame: &'a FrameSettings,
    level: &'a Array,
    path: &'a Path,
}

impl Field<'_> {
    fn value(&self, t: f64) -> Option<f64> {
        self.level.sample(self.path.at(t), self.frame.sampling.filter)
    }

    fn code(&self, value: f64) -> f64 {
        self.frame.encoding.unorm(value) * self.frame.encoding.format.max_code() as f64
    }

    /// The parts of a segment; none where there is no value.
    fn parts(&self, segment: Segment) -> Vec<Part> {
        let method = self.frame.sampling.method;
        let (a, length) = (segment.start, segment.length());
        if method.curve() == Curve::Middle {
            return self.value(segment.middle()).map(|value| self.sampled(segment, value)).into_iter().collect();
        }
        // Where only one end has a value, it stands for the other.
        let ends = [self.value(a), self.value(segment.end)];
        let [Some(from), Some(to)] = [ends[0].or(ends[1]), ends[1].or(ends[0])] else { return Vec::new() };
        let difference = (self.code(to) - self.code(from)).abs() / self.frame.encoding.format.max_code() as f64;
        let count = method.parts(difference);
        let part = |i: usize| Segment {
            start: a + length * i as f64 / count as f64,
            end: a + length * (i + 1) as f64 / count as f64,
        };
        if method.curve() == Curve::Field {
            let parts = (0..count).map(part);
            return parts.filter_map(|part| Some(self.sampled(part, self.value(part.middle())?))).collect();
        }
        let outer = [a - length, segment.end + length];
        let differences = |t: f64, value: f64| self.differences(t, value);
        let gradients = [differences(a, from), differences(segment.end, to)];
        let is_cubic = method.curve() == Curve::Cubic;
        let values = [self.value(outer[0]).unwrap_or(from), from, to, self.value(outer[1]).unwrap_or(to)];
        let around = match is_cubic {
            true => [differences(outer[0], values[0]), gradients[0], gradients[1], differences(outer[1], values[3])],
            false => [DVec3::ZERO; 4],
        };
        let value_at = |s: f64| if is_cubic { cubic(values, s) } else { from + s * (to - from) };
        let gradient_at = |s: f64| match is_cubic {
            true => DVec3::from_array(std::array::from_fn(|k| catmull_rom(around.map(|g| g[k]), s))),
            false => gradients[0].lerp(gradients[1], s),
        };
        let virtual_part = |i: usize| {
            let [s0, s1] = [i, i + 1].map(|i| i as f64 / count as f64);
            let middle = 0.5 * (s0 + s1);
            Part {
                middle: a + length * middle,
                length: length / count as f64,
                value: value_at(middle),
                ends: Some([value_at(s0), value_at(s1)]),
                differences: gradient_at(middle),
            }
        };
        (0..count).map(virtual_part).collect()
    }

    /// A part with this value in its middle.
    fn sampled(&self, part: Segment, value: f64) -> Part {
        let (middle, length) = (part.middle(), part.length());
        Part { middle, length, value, ends: None, differences: self.differences(middle, value) }
    }

    /// Differences of the field across two voxels along each axis, about a place with a value; those without one are as good as
    /// it. Zero where nothing is lit.
    fn differences(&self, t: f64, value: f64) -> DVec3 {
        if self.frame.lighting.model == LightingModel::None {
            return DVec3::ZERO;
        }
        let voxel = DVec3::from_array(self.level.factor.map(f64::from));
        let around = |offset: DVec3| {
            self.level.sample(self.path.at(t) + offset * voxel, self.frame.sampling.filter).unwrap_or(value)
        };
        let along = |a: usize| match self.frame.lighting.gradient {
            Gradient::Central => around(DVec3::AXES[a]) - around(-DVec3::AXES[a]),
            Gradient::Sobel => {
                let (u, v) = (DVec3::AXES[(a + 1) % 3], DVec3::AXES[(a + 2) % 3]);
                let across = (0..9).map(|i| (i % 3, i / 3));
                let side = |i: usize, j: usize| u * (i as f64 - 1.0) + v * (j as f64 - 1.0);
                let difference = |side: DVec3| around(side + DVec3::AXES[a]) - around(side - DVec3::AXES[a]);
                across.map(|(i, j)| SMOOTH[i] * SMOOTH[j] * difference(side(i, j))).sum()
            }
        };
        DVec3::new(along(0), along(1), along(2))
    }

    /// The unit vector along the gradient in the world; `None` where the field is flat.
    fn normal(&self, differences: DVec3) -> Option<DVec3> {
        let is_flat = differences.length() < FLAT_CODES * self.frame.encoding.code_width();
        let voxel = DVec3::from_array(self.level.factor.map(f64::from)) * self.frame.geometry.spacing;
        (!is_flat).then(|| (differences / voxel).normalize())
    }
}
