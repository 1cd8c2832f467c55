//! The fog of a piece of a segment, by every method of [`brickyard_volume::sampling`], lit or not.

use crate::Array;
use crate::path::Path;
use brickyard_volume::compositing::LayerMedium;
use brickyard_volume::lighting::SMOOTH;
use brickyard_volume::sampling::{Curve, catmull_rom, cubic};
use brickyard_volume::surface::FLAT_SHARE;
use brickyard_volume::{
    Blend, CutFace, FrameSettings, Gradient, Lighting, LightingModel, Medium, Ray, Segment, TransferFunction,
};
use glam::DVec3;

/// A part of a segment.
struct Part {
    middle: f64,
    length: f64,
    /// The value in its middle.
    value: f64,
    /// The values at its ends, if the method uses them.
    ends: Option<[f64; 2]>,
    /// See [`Field::differences`].
    differences: DVec3,
}

/// The field of values of one level along a ray.
#[derive(Clone, Copy)]
pub(crate) struct Field<'a> {
    pub(crate) frame: &'a FrameSettings,
    pub(crate) level: &'a Array,
    pub(crate) path: &'a Path,
    pub(crate) lighting: &'a Lighting,
    /// The cut whose normal lights the places just behind it.
    pub(crate) cut: Option<CutFace>,
}

impl Field<'_> {
    pub(crate) fn value(&self, t: f64) -> Option<f64> {
        if self.frame.encoding.is_labels {
            return self.level.nearest(self.path.at(t));
        }
        self.level.sample(self.path.at(t), self.frame.sampling.filter)
    }

    /// The layer's own medium in a piece of a segment.
    pub(crate) fn alone(&self, piece: Segment, blend: Blend, transfer: &TransferFunction) -> LayerMedium {
        let integrals = self.frame.method().is_pre_integrated().then(|| self.frame.table.integrals());
        let mut alone = LayerMedium::default();
        for part in self.parts(piece) {
            let medium = match (integrals, part.ends) {
                (Some(integrals), Some([from, to])) => integrals.between(self.entry(from), self.entry(to)),
                _ => {
                    let [r, g, b, alpha] = transfer.at(part.value, self.own_gradient(part.differences).length());
                    Medium { rgb: [r, g, b], depth: -(1.0 - alpha).log2() }
                }
            };
            let color = self.shade(DVec3::from_array(medium.rgb), part.differences, part.middle);
            alone.add(blend, color, medium.depth, part.length / transfer.unit_distance);
        }
        alone
    }

    /// The lit colour at distance `t`, where the field has these differences.
    pub(crate) fn shade(&self, color: DVec3, differences: DVec3, t: f64) -> DVec3 {
        let Ray { origin, direction } = self.path.world;
        let factor = DVec3::from_array(self.level.factor.map(f64::from));
        let normal = self.gradient(differences).map(DVec3::normalize);
        let normal = turned(self.path, self.cut, factor, normal, t);
        self.lighting.shade(color, normal, direction, origin + direction * t)
    }

    /// A value's position in the transfer table, in entries.
    fn entry(&self, value: f64) -> f64 {
        self.frame.encoding.place(value) * self.frame.table.last_entry() as f64
    }

    /// The parts of a segment; none without values.
    fn parts(&self, segment: Segment) -> Vec<Part> {
        let method = self.frame.method();
        let (a, length) = (segment.start, segment.length());
        if method.curve() == Curve::Middle {
            return self.value(segment.middle()).map(|value| self.sampled(segment, value)).into_iter().collect();
        }
        // A value at one end only stands for both.
        let ends = [self.value(a), self.value(segment.end)];
        let [Some(from), Some(to)] = [ends[0].or(ends[1]), ends[1].or(ends[0])] else { return Vec::new() };
        let difference = (self.frame.encoding.place(to) - self.frame.encoding.place(from)).abs();
        let count = self.frame.sampling.parts(difference / self.frame.table.adaptive_step());
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

    /// Differences of the field across two voxels along each axis, at distance `t`, where it has this value, which also
    /// replaces missing values. Zero where nothing depends on differences. Labels have central differences of the
    /// label's [indicator](crate::Array::indicator); a field of steps has those of the linear field.
    pub(crate) fn differences(&self, t: f64, value: f64) -> DVec3 {
        if self.lighting.model == LightingModel::None && self.frame.grid().is_none() {
            return DVec3::ZERO;
        }
        let (first, differences) = (self.frame.encoding.table_values()[0], self.all_differences(t, value));
        // Indicators of labels are not rounded like this, and neither are stored gradients.
        let is_exact = self.frame.encoding.is_labels || self.lighting.gradient == Gradient::Stored;
        let is_flat = !is_exact && differences.length() < FLAT_SHARE * (value - first).abs();
        if is_flat { DVec3::ZERO } else { differences }
    }

    /// The same, without zeroing mere rounding.
    fn all_differences(&self, t: f64, value: f64) -> DVec3 {
        let voxel = DVec3::from_array(self.level.factor.map(f64::from));
        let is_labels = self.frame.encoding.is_labels;
        let around = |offset: DVec3| {
            if is_labels {
                return self.level.indicator(self.path.at(t) + offset * voxel, value);
            }
            let filter = self.frame.sampling.filter.of_gradients();
            self.level.sample(self.path.at(t) + offset * voxel, filter).unwrap_or(value)
        };
        let difference = |a: usize, side: DVec3| around(side + DVec3::AXES[a]) - around(side - DVec3::AXES[a]);
        let smoothed = |a: usize| {
            let (u, v) = (DVec3::AXES[(a + 1) % 3], DVec3::AXES[(a + 2) % 3]);
            let across = (0..9).map(|i| (i % 3, i / 3));
            let side = |i: usize, j: usize| u * (i as f64 - 1.0) + v * (j as f64 - 1.0);
            across.map(|(i, j)| SMOOTH[i] * SMOOTH[j] * difference(a, side(i, j))).sum()
        };
        match self.lighting.gradient {
            _ if is_labels => DVec3::from_array([0, 1, 2].map(|a| difference(a, DVec3::ZERO))),
            Gradient::Central => DVec3::from_array([0, 1, 2].map(|a| difference(a, DVec3::ZERO))),
            Gradient::Sobel => DVec3::from_array([0, 1, 2].map(smoothed)),
            Gradient::Stored => self.level.stored_differences(self.path.at(t)),
        }
    }

    /// The gradient in the scene's world from differences across two voxels; `None` where the field is flat.
    pub(crate) fn gradient(&self, differences: DVec3) -> Option<DVec3> {
        let is_flat = differences.length() < self.frame.encoding.flat_codes() * self.frame.encoding.code_width();
        (!is_flat).then(|| self.frame.placement.world_gradient(self.own_gradient(differences)))
    }

    /// The gradient in the volume's own world, data units per world unit: transfer functions are independent of a
    /// volume's placement.
    fn own_gradient(&self, differences: DVec3) -> DVec3 {
        let across =
            DVec3::from_array(self.level.factor.map(|factor| 2.0 * factor as f64)) * self.frame.geometry.spacing;
        differences / across
    }
}

/// The normal of a place at distance `t` with the normal `own`, in voxels of `factor` level-0 voxels: behind a cut,
/// mixed with the cut's.
pub(crate) fn turned(path: &Path, cut: Option<CutFace>, factor: DVec3, own: Option<DVec3>, t: f64) -> Option<DVec3> {
    let Some(cut) = cut else { return own };
    let depth = (t - cut.entry) * cut.voxels_per_distance(path.direction, factor);
    cut.mixed(own, path.world.direction, CutFace::share(depth))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::Way;
    use crate::tests::{alone, camera, cube, settings};
    use crate::{ReferenceVolume, join, one_level};
    use brickyard_volume::{
        Clip, Extent, Filter, Geometry, LevelGrid, Method, Mode, Pyramid, Region, Sampling, Shape, TransferFunction,
        VolumeFrame,
    };

    fn transfer(opacity: Vec<[f64; 2]>) -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, 1.0, 0.5, 0.25]],
            opacity,
            unit_distance: 1.0,
            ..TransferFunction::default()
        }
    }

    /// The colour of the ray through the middle of a volume of 16 voxels, from -x.
    fn middle(levels: &[Array], transfer: &TransferFunction, sampling: Sampling, step: f64) -> [f64; 3] {
        let volume = ReferenceVolume { levels, level_at: &one_level(0), transfer };
        let view = camera(DVec3::new(-40.0, 7.5, 7.5), DVec3::splat(7.5));
        let frame = settings(Mode::Dvr, Geometry::default(), view, transfer, step);
        let frame = FrameSettings { sampling, background: [0.0; 3], ..frame };
        alone(&frame, &volume, 16, 16)
    }

    #[test]
    fn a_constant_medium_is_beer_lambert_by_every_method_at_any_step() {
        let levels = [cube(16, |_| 100.0)];
        let transfer = transfer(vec![[0.0, 0.1]]);
        let alpha = 1.0 - 0.9f64.powi(16);
        for method in Method::ALL {
            for filter in Filter::ALL {
                for step in [0.13, 1.0, 3.0] {
                    let found = middle(&levels, &transfer, Sampling { method, filter, ..Sampling::default() }, step);
                    for (found, color) in found.into_iter().zip([1.0, 0.5, 0.25]) {
                        // Running integrals are of the table, with opacities in f32.
                        assert!((found - alpha * color).abs() < 1e-7, "{method:?} {filter:?} {step}: {found}");
                    }
                }
            }
        }
    }

    /// All methods are of second order: half the step leaves a quarter of the difference, of colour and opacity, lit or
    /// not, for a smooth field and transfer function. (Steps are long enough for rounding not to matter.)
    #[test]
    fn halving_the_step_leaves_a_quarter_of_the_error_of_every_method() {
        let wave = |[x, y, z]: [u32; 3]| {
            let [x, y, z] = [x, y, z].map(f64::from);
            128.0 + 50.0 * (0.5 * x + 0.3 * y).sin() + 40.0 * (0.45 * x - 0.35 * z).cos()
        };
        let levels = [cube(16, wave)];
        let ramp = TransferFunction {
            color: vec![[0.0, 1.0, 0.0, 0.25], [255.0, 0.0, 1.0, 0.5]],
            opacity: vec![[0.0, 0.02], [255.0, 0.3]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer: &ramp };
        let picture = |method, lighting: &Lighting, step: f64| {
            let view = camera(DVec3::new(-40.0, 9.3, 5.1), DVec3::splat(7.5));
            let frame = settings(Mode::Dvr, Geometry::default(), view, &ramp, step);
            let sampling = Sampling { method, filter: Filter::Tricubic, ..Sampling::default() };
            let frame = FrameSettings { sampling, lighting: lighting.clone(), background: [0.0; 3], ..frame };
            [(13, 14), (15, 17), (16, 16), (17, 13), (18, 18)]
                .map(|(x, y)| DVec3::from_array(alone(&frame, &volume, x, y)))
        };
        let lit = Lighting { model: LightingModel::BlinnPhong, ..Lighting::default() };
        for (lighting, least) in [(Lighting::default(), 3.0), (lit, 2.5)] {
            for method in Method::ALL {
                let limit = picture(method, &lighting, 0.01);
                let plain = picture(Method::Udvr, &lighting, 0.01);
                let off = limit.iter().zip(&plain).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
                // Pre-integrated methods use the table's entries, in f32.
                assert!(off < 1e-5, "{method:?} {:?}: another limit, by {off}", lighting.model);
                let error = |step| {
                    let found = picture(method, &lighting, step);
                    let squares = found.iter().zip(&limit).map(|(found, limit)| (*found - *limit).length_squared());
                    squares.sum::<f64>().sqrt()
                };
                let errors = [1.6, 0.8, 0.4].map(error);
                println!("{method:?} {:?}: {errors:?}", lighting.model);
                assert!(errors[0] / errors[2] > least * least, "{method:?} {:?}: {errors:?}", lighting.model);
            }
        }
    }

    /// A field that rises evenly has one gradient everywhere, so a function of that makes a homogeneous medium.
    #[test]
    fn an_even_slope_is_beer_lambert_by_its_gradient_at_any_step_spacing_and_level() {
        let spacing = DVec3::new(1.0, 0.5, 2.0);
        // Per world unit.
        let slope = DVec3::new(2.0, -1.0, 0.75);
        let pyramid = Pyramid::new(Extent::new(64, 64, 64), spacing.to_array(), 8);
        let level = |grid: &LevelGrid| {
            let world = |i: [u32; 3]| {
                (DVec3::from_array(i.map(f64::from)) + 0.5) * DVec3::from_array(grid.factor.map(f64::from)) * spacing
            };
            Array::from_fn(grid, |i| 100.0 + slope.dot(world(i)))
        };
        let levels: Vec<Array> = pyramid.levels()[..3].iter().map(level).collect();
        let by_gradient = TransferFunction {
            gradient_opacity: vec![[0.0, 0.0], [0.5 * slope.length(), 0.2], [1.5 * slope.length(), 0.8]],
            ..transfer(vec![[0.0, 0.2]])
        };
        let band = [0.9 * slope.length(), 1.1 * slope.length()];
        let region = Region {
            shape: Shape::Rectangle,
            value: [0.0, 255.0],
            gradient: band,
            color: [1.0, 0.5, 0.25],
            opacity: 0.1,
        };
        let by_region = TransferFunction { regions: vec![region], ..transfer(vec![[0.0, 0.0]]) };
        // Far enough inside for voxels past the faces not to be read.
        let [low, high] = [28.0, 36.0].map(|at| DVec3::splat(at) * spacing);
        let alpha = 1.0 - 0.9f64.powf((high - low).length());
        for transfer in [by_gradient, by_region] {
            for (method, step, number) in [Method::Udvr, Method::Lvs, Method::Cvs, Method::Asm]
                .into_iter()
                .flat_map(|method| [0.13, 1.0, 2.3].map(|step| (method, step)))
                .flat_map(|(method, step)| (0..levels.len()).map(move |number| (method, step, number)))
            {
                for (filter, gradient) in [
                    (Filter::Trilinear, Gradient::Central),
                    (Filter::Tricubic, Gradient::Sobel),
                    (Filter::Trilinear, Gradient::Stored),
                ] {
                    let volume = ReferenceVolume { levels: &levels, level_at: &one_level(number), transfer: &transfer };
                    let geometry = Geometry { spacing, ..Geometry::default() };
                    let frame = settings(Mode::Dvr, geometry, camera(2.0 * low - high, high), &transfer, step);
                    let frame = FrameSettings {
                        sampling: Sampling { method, filter, ..Sampling::default() },
                        lighting: Lighting { gradient, ..Lighting::default() },
                        clip: Some(Clip::new(Some([low, high]), &[]).unwrap()),
                        background: [0.0; 3],
                        ..frame
                    };
                    let found = alone(&frame, &volume, 16, 16);
                    for (found, color) in found.into_iter().zip([1.0, 0.5, 0.25]) {
                        let what = format!("{method:?} {filter:?} {step} level {number}");
                        assert!((found - alpha * color).abs() < 1e-9, "{what}: {found} {}", alpha * color);
                    }
                }
            }
        }
    }

    /// A region shows only the rim of a ball with a thin rim; its inside and surroundings are flat, though they have
    /// colours of their own.
    #[test]
    fn a_steep_shell_is_shown_and_flat_insides_are_not() {
        let centre = DVec3::splat(15.5);
        // From 200 inside to 40 outside, by 32 a voxel about 10 voxels from the centre.
        let levels = [cube(32, |v| {
            let distance = (DVec3::from_array(v.map(f64::from)) - centre).length();
            (120.0 - 32.0 * (distance - 10.0)).clamp(40.0, 200.0)
        })];
        let region = Region {
            shape: Shape::Gaussian,
            value: [40.0, 200.0],
            gradient: [16.0, 48.0],
            color: [0.0, 1.0, 0.0],
            opacity: 0.9,
        };
        let by_region = TransferFunction { regions: vec![region], ..transfer(vec![[0.0, 0.0]]) };
        let edges = TransferFunction { gradient_opacity: vec![[8.0, 0.0], [30.0, 1.0]], ..transfer(vec![[0.0, 0.6]]) };
        for transfer in [&by_region, &edges] {
            let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer };
            let eye = DVec3::new(-60.0, 15.5, 15.5);
            let frame = settings(Mode::Dvr, Geometry::default(), camera(eye, centre), transfer, 0.25);
            let frame = FrameSettings { background: [0.0; 3], ..frame };
            let light = |limits: [f64; 2]| {
                let frame = VolumeFrame::alone(frame.clone());
                let ways: Vec<Way> = Way::new(0, &frame, &volume, 16, 16).into_iter().collect();
                join::slab(&ways, None, limits, DVec3::ZERO).max_element()
            };
            // Places along the ray through the centre, whose voxels begin at 0.
            let at = |from_centre: f64| 76.0 + from_centre;
            let [before, rim, inside] = [[0.0, at(-14.0)], [at(-13.0), at(-7.0)], [at(-6.0), at(6.0)]].map(light);
            assert!(rim > 0.8, "{rim}");
            assert_eq!([before, inside], [0.0; 2]);
        }
    }

    /// A ramp of 16 codes a voxel with one opaque code: between two plain samples there are 15 unseen codes.
    #[test]
    fn pre_integration_is_the_limit_of_fine_sampling_where_plain_sampling_sees_nothing() {
        let levels = [cube(16, |[x, ..]| 16.0 * x as f64)];
        let spike = transfer(vec![[124.0, 0.0], [125.0, 0.9], [126.0, 0.0]]);
        let at = |method, step| middle(&levels, &spike, Sampling { method, ..Sampling::default() }, step)[0];
        // Over two codes, an eighth of a voxel, opacity goes from 0 to 0.9 and back: with u = 1 - opacity the mean
        // extinction is the integral of -log2(u) from 0.1 to 1, over 0.9.
        let depth = (0.9 + 0.1 * 0.1f64.ln()) / 0.9 / std::f64::consts::LN_2 * 2.0 / 16.0;
        let exact = 1.0 - (-depth).exp2();
        for method in [Method::Pdvr, Method::Plvs, Method::Pcvs] {
            for step in [0.25, 1.0, 2.0] {
                assert!((at(method, step) - exact).abs() < 1e-6, "{method:?} {step}: {} {exact}", at(method, step));
            }
        }
        assert_eq!(at(Method::Udvr, 1.0), 0.0, "the spike falls between samples");
        let fine = at(Method::Udvr, 0.001);
        // A thousandth of a voxel is a hundredth of the spike.
        assert!((fine - exact).abs() < 1e-3 * exact, "{fine} {exact}");
    }

    /// Lines are right for a field linear between samples, and cubic curves for a parabolic one.
    #[test]
    fn virtual_samples_follow_the_field() {
        let peak = transfer(vec![[100.0, 0.0], [115.0, 0.5], [130.0, 0.0]]);
        let line = [cube(16, |[x, ..]| 15.0 * x as f64)];
        let parabola = [cube(16, |[x, ..]| x as f64 * x as f64)];
        // The mean of several steps, as the positions of samples matter much.
        let error = |levels: &[Array], method: Method| {
            let at = |method, step| {
                middle(levels, &peak, Sampling { method, filter: Filter::Tricubic, ..Sampling::default() }, step)[0]
            };
            let exact = at(Method::Udvr, 0.002);
            [1.7, 2.1, 2.6, 3.1].map(|step| (at(method, step) - exact).abs()).into_iter().sum::<f64>() / 4.0
        };
        assert!(error(&line, Method::Lvs) < 0.2 * error(&line, Method::Udvr));
        // The rest is due to the table's opacities, in f32.
        assert!(error(&line, Method::Pdvr) < 1e-6);
        // Pre-integrated, as only then the curves decide, and not the positions of virtual samples.
        assert!(error(&parabola, Method::Pcvs) < 0.5 * error(&parabola, Method::Plvs));
    }

    /// A field by its values at places.
    type Values = dyn Fn(DVec3) -> f64;

    /// Voxels along an edge of the fields for testing gradients.
    const EDGE: u32 = 64;

    /// Mean angle in degrees between a field's normals, zero where there is none, and its exact gradients, at many
    /// places inside.
    fn mean_error_deg(field: &impl Fn(DVec3) -> f64, normal: impl Fn(DVec3) -> DVec3) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for i in 0..4000u32 {
            // A low-discrepancy sequence (Roberts, 2018) of places at least three voxels inside.
            let unit = DVec3::new(0.8191725134, 0.6710436067, 0.5497004779) * i as f64;
            let place = (unit - unit.floor()) * (f64::from(EDGE) - 7.0) + 3.0;
            let normal = normal(place);
            let along = |axis: DVec3| field(place + axis * 1e-4) - field(place - axis * 1e-4);
            let exact = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
            if normal != DVec3::ZERO && exact.length() > 1e-6 {
                sum += normal.dot(exact.normalize()).clamp(-1.0, 1.0).acos().to_degrees();
                count += 1;
            }
        }
        assert!(count > 3000);
        sum / count as f64
    }

    /// Calls `look` with the differences of a field's voxels at places, by the engine's operators.
    fn with_differences<R>(
        field: &impl Fn(DVec3) -> f64,
        (gradient, filter): (Gradient, Filter),
        look: impl FnOnce(&dyn Fn(DVec3) -> DVec3) -> R,
    ) -> R {
        let level = cube(EDGE, |v| field(DVec3::from_array(v.map(f64::from))));
        let transfer = transfer(vec![[0.0, 1.0]]);
        let frame = settings(Mode::Dvr, Geometry::default(), camera(DVec3::ZERO, DVec3::ONE), &transfer, 1.0);
        let lighting = Lighting { model: LightingModel::Phong, gradient, ..Lighting::default() };
        let frame = FrameSettings { lighting, sampling: Sampling { filter, ..Sampling::default() }, ..frame };
        look(&|place| {
            let world = Ray { origin: DVec3::ZERO, direction: DVec3::X };
            let path = Path { origin: place + 0.5, direction: DVec3::X, world, own: world, cut: None };
            let found = Field { frame: &frame, level: &level, path: &path, lighting: &frame.lighting, cut: None };
            let differences = found.differences(0.0, field(place));
            // Voxels are cubes: differences point along the gradients.
            found.gradient(differences).map_or(DVec3::ZERO, |_| differences)
        })
    }

    /// Gradients kept at nodes `apart` voxels apart, the first at `first` from the first voxel's middle, interpolated
    /// between the eight around a place; optionally normalised before that, like the third paper's contemporaries did.
    fn between_nodes(
        at: &dyn Fn(DVec3) -> DVec3,
        (apart, first): (f64, f64),
        is_normalised: bool,
    ) -> impl Fn(DVec3) -> DVec3 {
        move |place| {
            let node = ((place - first) / apart).floor();
            let t = (place - first) / apart - node;
            let corner = |i: usize| {
                let side = DVec3::from_array([i & 1, i >> 1 & 1, i >> 2].map(|side| side as f64));
                let kept = at((node + side) * apart + first);
                let kept = if is_normalised { kept.normalize_or_zero() } else { kept };
                let near = DVec3::ONE - t;
                kept * (side * t + (DVec3::ONE - side) * near).element_product()
            };
            (0..8).map(corner).sum::<DVec3>().normalize_or_zero()
        }
    }

    /// Marschner and Lobb's signal (1994) on `n` voxels of [-1, 1], scaled to 0..255.
    fn marschner_lobb(n: f64) -> impl Fn(DVec3) -> f64 {
        use std::f64::consts::PI;
        move |p| {
            let p = p / (n - 1.0) * 2.0 - 1.0;
            let wave = (2.0 * PI * 6.0 * (PI * p.truncate().length() / 2.0).cos()).cos();
            255.0 * (1.0 - (PI * p.z / 2.0).sin() + 0.25 * (1.0 + wave)) / (2.0 * 1.25)
        }
    }

    /// The figures quoted in the documentation. Upper bounds are measurements, rounded up.
    #[test]
    fn gradients_point_where_they_should() {
        let centre = DVec3::new(30.2, 31.7, 29.9);
        let sphere = move |p: DVec3| (p - centre).length() * 4.0;
        let signal = marschner_lobb(f64::from(EDGE));
        let errors = |look: &dyn Fn(&Values) -> f64| (look(&sphere), look(&signal));
        for (gradient, filter, of_sphere, of_signal) in [
            (Gradient::Central, Filter::Trilinear, 0.2, 15.0),
            (Gradient::Sobel, Filter::Trilinear, 0.3, 20.0),
            (Gradient::Central, Filter::Tricubic, 0.2, 20.0),
            (Gradient::Sobel, Filter::Tricubic, 0.3, 25.0),
            (Gradient::Stored, Filter::Trilinear, 0.2, 36.0),
        ] {
            let (sphere, signal) = errors(&|field| {
                with_differences(&field, (gradient, filter), |at| mean_error_deg(&field, |p| at(p).normalize_or_zero()))
            });
            println!("{gradient:?} {filter:?}: sphere {sphere:.3}, Marschner-Lobb {signal:.2} degrees");
            assert!(sphere < of_sphere && signal < of_signal, "{gradient:?} {filter:?}: {sphere} {signal}");
        }
        // Kept at each voxel, by central differences, and in the middle of each eight, as in bricks.
        let mut normalised = Vec::new();
        for (name, gradient, nodes) in
            [("each voxel", Gradient::Central, (1.0, 0.0)), ("each eighth", Gradient::Stored, (2.0, 0.5))]
        {
            let of = |is_normalised| {
                errors(&|field| {
                    with_differences(&field, (gradient, Filter::Trilinear), |at| {
                        mean_error_deg(&field, between_nodes(at, nodes, is_normalised))
                    })
                })
            };
            let (as_is, unit) = (of(false), of(true));
            println!("kept at {name}: {:.3}, {:.2}; normalised {:.3}, {:.2} degrees", as_is.0, as_is.1, unit.0, unit.1);
            assert!(unit.1 > 1.1 * as_is.1, "{name}: normalising costs nothing: {as_is:?} {unit:?}");
            normalised.push((as_is.1, unit.1));
        }
        assert!(normalised[0].1 > 1.8 * normalised[0].0, "it doubles the error of those of full resolution");
    }
}
