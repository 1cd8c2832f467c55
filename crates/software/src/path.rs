//! A ray's path along a stretch of a brick, for every method: segments become media by the rules of
//! [`brickyard_volume::sampling`], lit by those of [`brickyard_volume::lighting`].
//!
//! A stretch is processed in rows of as many segments as one packet of places allows: all points on a row's curves are
//! sampled together, and then one segment after the other is classified. A gradient takes a packet of its own (four for
//! the Sobel operator), and only where there is opacity or, if opacity depends on gradients, may be some.

use crate::differences::{CENTRAL, SOBEL, Tap};
use crate::gradients::Gradients;
use crate::packet::{LANES, Packet, points};
use crate::ray::Ray;
use crate::reading::Reading;
use crate::row::{Passed, Row};
use crate::sample::Code;
use crate::shade::{Shade, Shaded};
use crate::stretch::{March, Stretch};
use crate::surface::Crossing;
use crate::transfer_table::Entries;
use crate::unit::Unit;
use brickyard_volume::sampling::{Curve, catmull_rom, cubic};
use brickyard_volume::surface::FLAT_SHARE;
use brickyard_volume::{CutFace, Filter, Gradient, Lighting, Medium as Mean, TransferGrid};
use glam::{DVec3, Vec3, Vec4};
use std::ops::Range;

/// A ray's path along a stretch of a brick. Places along it are counted in segments from the middle of the stretch's
/// first.
#[derive(Clone, Copy)]
pub(crate) struct Path<'a> {
    march: &'a March<'a>,
    stretch: &'a Stretch,
    /// The first place where the brick can be sampled; `high` is the last one.
    pub(crate) low: f32,
    pub(crate) high: f32,
    /// The ends of the ray's first and last segments, if they are the stretch's; else beyond all places.
    first_start: f32,
    last_end: f32,
    /// Unit distances of a whole segment.
    length: f64,
    /// Units of the volume's own world per voxel of the brick's level.
    voxel: DVec3,
    /// Half of one code in data units: differences are across two voxels.
    half_code: f64,
    /// The ray in the scene's world.
    eye: DVec3,
    direction: DVec3,
    /// The cut through which it enters the shown part, if any, and the voxels below it per distance.
    cut: Option<(CutFace, f64)>,
    is_lit: bool,
    /// Whether anything depends on gradients: light, or opacity.
    has_gradients: bool,
}

/// A packet of samples along a path.
#[derive(Clone, Copy)]
pub(crate) struct Samples {
    along: Packet,
    pub(crate) code: Packet,
    pub(crate) weight: Packet,
}

impl<'a> Path<'a> {
    #[inline(always)]
    pub(crate) fn new(march: &'a March<'a>, ray: &Ray) -> Self {
        let March { frame, cell, stretch, .. } = march;
        let (eye, direction) = ray.in_world(frame);
        let [low, high] = stretch.sampleable(frame.edge + 2 * frame.apron);
        let ticks = &frame.ticks;
        let (mut first_start, mut last_end) = (f32::NEG_INFINITY, f32::INFINITY);
        if stretch.start == ray.first {
            first_start = stretch.along(ray.ends(ticks, stretch.start).0);
        }
        if stretch.end == ray.end {
            last_end = stretch.along(ray.ends(ticks, stretch.tick(stretch.count - 1)).1);
        }
        Self {
            march,
            stretch,
            low,
            high,
            first_start,
            last_end,
            length: stretch.length * frame.per_unit,
            voxel: frame.settings.geometry.spacing / DVec3::from_array(cell.scale),
            half_code: 0.5 * frame.settings.encoding.code_width(),
            eye,
            direction,
            cut: march.cut(ray),
            is_lit: frame.is_lit,
            has_gradients: frame.is_lit || frame.grid.is_some(),
        }
    }

    /// This path, cut down to a piece of one segment, from `first_start` to `last_end`.
    pub(crate) fn piece(&self, first_start: f32, last_end: f32) -> Self {
        Self { first_start, last_end, ..*self }
    }

    /// The places where a segment begins and ends.
    #[inline(always)]
    pub(crate) fn ends(&self, segment: i32) -> [f32; 2] {
        [(segment as f32 - 0.5).max(self.first_start), (segment as f32 + 0.5).min(self.last_end)]
    }

    /// The number of whole segments at the front of these, at most `most`; 1 if the first one is not whole.
    #[inline(always)]
    pub(crate) fn whole(&self, segments: &Range<i32>, most: i32) -> i32 {
        let is_cut = |segment: i32| {
            let [a, b] = self.ends(segment);
            a > segment as f32 - 0.5 || b < segment as f32 + 0.5
        };
        let mut count = (segments.end - segments.start).min(most);
        if is_cut(segments.start) {
            return 1;
        }
        if is_cut(segments.start + count - 1) {
            count -= 1;
        }
        count
    }

    #[inline(always)]
    pub(crate) fn sample<C: Code, U: Unit>(&self, along: Packet) -> Samples {
        let (points, mut weight) = (self.points(&along), [1.0; LANES]);
        let March { frame, brick, .. } = self.march;
        let code = brick.read_points::<C, U>(frame.reading, &points, &mut weight);
        Samples { along, code, weight }
    }

    /// Appends the media of a row of segments, from the first of `segments` on. Returns the first segment not taken.
    /// Not inlined: it is large, and several callers share it.
    #[inline(always)]
    pub(crate) fn row<C: Code, U: Unit>(&self, segments: Range<i32>, media: &mut Row) -> i32 {
        U::call(
            segments,
            #[inline(always)]
            move |segments| match self.march.frame.settings.method().curve() {
                Curve::Middle => self.middles::<C, U>(segments, media),
                Curve::Line => self.curves::<C, U>(segments, 0, media),
                Curve::Cubic => self.curves::<C, U>(segments, 1, media),
                Curve::Field => self.field::<C, U>(segments, media),
            },
        )
    }

    /// One sample in the middle of each segment. Returns the first segment not taken.
    #[inline(always)]
    fn middles<C: Code, U: Unit>(&self, segments: Range<i32>, media: &mut Row) -> i32 {
        let count = (segments.end - segments.start).min(LANES as i32);
        let mut along = [0.0; LANES];
        for i in 0..LANES {
            let [a, b] = self.ends(segments.start + i as i32);
            along[i] = 0.5 * (a + b);
        }
        let row = self.sample::<C, U>(along);
        let (mut shown, mut is_any) = ([const { None }; LANES], false);
        for i in 0..count as usize {
            if row.weight[i] > 0.0 {
                shown[i] = self.at::<C>(row.code[i]);
                is_any |= shown[i].is_some();
            }
        }
        if !is_any {
            return segments.start + count;
        }
        let (mut differences, mut shaded) = ([[0.0; LANES]; 3], Shaded::EMPTY);
        let (slopes, flat_codes) = self.march.slopes();
        let shade = Shade::new(self.lighting(), slopes, flat_codes, self.eye, self.direction, self.cut);
        if self.has_gradients {
            differences = self.row_differences::<C, U>(&along, &row.code, &shown);
        }
        if self.is_lit {
            let mut distance = [0.0; LANES];
            for i in 0..LANES {
                distance[i] = self.distance(along[i]) as f32;
            }
            // These differences are already free of rounding; those of labels have none.
            shade.packet(&differences, &distance, &[0.0; LANES], &mut shaded);
        }
        for i in 0..count as usize {
            let Some(mut medium) = shown[i].take() else { continue };
            if self.has_gradients {
                let differences = Vec3::new(differences[0][i], differences[1][i], differences[2][i]);
                let Some(by_gradient) = self.by_gradient(medium, row.code[i], differences) else { continue };
                medium = by_gradient;
            }
            if self.is_lit {
                medium.color = shade.lit(&shaded, i, medium.color.extend(0.0), 1.0).truncate();
            }
            let [a, b] = self.ends(segments.start + i as i32);
            self.push(media, segments.start + i as i32, medium, b - a);
        }
        segments.start + count
    }

    #[inline(always)]
    fn lighting(&self) -> &'a Lighting {
        &self.march.frame.settings.lighting
    }

    /// Computes [`Path::differences`] at a packet of places with these codes; only those of visible places need be
    /// right.
    #[inline(always)]
    fn row_differences<C: Code, U: Unit>(
        &self,
        along: &Packet,
        code: &Packet,
        shown: &[Option<Shown>; LANES],
    ) -> [Packet; 3] {
        if self.march.frame.reading.of_gradients() == Reading::Filtered(Filter::Trilinear) {
            let (differences, rounded) = self.march.differences::<C, U>(&self.points(along), code);
            return without_rounding(&rounded, differences);
        }
        let mut differences = [[0.0; LANES]; 3];
        for i in 0..LANES {
            if shown[i].is_some() {
                let found = self.differences::<C, U>(along[i], code[i]);
                for a in 0..3 {
                    differences[a][i] = found[a];
                }
            }
        }
        differences
    }

    /// Real samples, more of them where a segment's ends differ more.
    #[inline(always)]
    fn field<C: Code, U: Unit>(&self, segments: Range<i32>, media: &mut Row) -> i32 {
        let count = self.whole(&segments, LANES as i32 - 1);
        let row = self.sample::<C, U>(self.places(segments.start, count, 0));
        for i in 0..count as usize {
            let [Some(from), Some(to)] = known([i, i + 1].map(|i| (row.weight[i] > 0.0).then_some(row.code[i]))) else {
                continue;
            };
            let difference = (to - from).abs() as f64;
            let parts = self.march.frame.settings.sampling.parts(difference / self.march.frame.adaptive_step);
            let [a, b] = self.ends(segments.start + i as i32);
            let part = (b - a) / parts as f32;
            let mut along = [a; LANES];
            for k in 0..parts.min(LANES) {
                along[k] = a + (k as f32 + 0.5) * part;
            }
            let samples = self.sample::<C, U>(along);
            for k in 0..parts.min(LANES) {
                if samples.weight[k] > 0.0
                    && let Some(shown) = self.at::<C>(samples.code[k])
                {
                    let mut differences = Vec3::ZERO;
                    if self.has_gradients {
                        differences = self.differences::<C, U>(along[k], samples.code[k]);
                    }
                    if let Some(shown) = self.by_gradient(shown, samples.code[k], differences) {
                        self.add_shown(media, segments.start + i as i32, along[k], shown, differences, part);
                    }
                }
            }
        }
        segments.start + count
    }

    /// The places of the ends of `count` segments from `first` on, with `beyond` more on each side.
    #[inline(always)]
    pub(crate) fn places(&self, first: i32, count: i32, beyond: i32) -> Packet {
        let mut along = [0.0; LANES];
        let [a, b] = self.ends(first);
        for i in 0..LANES {
            along[i] = match count {
                // A segment of its own length.
                1 => a + (i as i32 - beyond) as f32 * (b - a),
                _ => (first + i as i32 - beyond) as f32 - 0.5,
            };
        }
        along
    }

    /// Virtual samples, or the mean medium, along curves through the ends, and `beyond` of them on each side.
    #[inline(always)]
    fn curves<C: Code, U: Unit>(&self, segments: Range<i32>, beyond: usize, media: &mut Row) -> i32 {
        let sampling = &self.march.frame.settings.sampling;
        let count = self.whole(&segments, (LANES - 1 - 2 * beyond) as i32);
        let row = self.sample::<C, U>(self.places(segments.start, count, beyond as i32));
        let mut gradients = [None; LANES];
        let parts = sampling.parts(0.0);
        for i in 0..count as usize {
            let at = |i: usize| (row.weight[i] > 0.0).then_some(row.code[i] as f64);
            let near = i + beyond;
            let [Some(from), Some(to)] = known([at(near), at(near + 1)]) else { continue };
            let values = match beyond {
                0 => [from, from, to, to],
                _ => [at(near - 1).unwrap_or(from), from, to, at(near + 2).unwrap_or(to)],
            };
            let value = |s: f64| if beyond > 0 { cubic(values, s) } else { from + s * (to - from) };
            let [a, b] = self.ends(segments.start + i as i32);
            for k in 0..parts {
                let [start, end] = [k, k + 1].map(|k| k as f64 / parts as f64);
                let middle = 0.5 * (start + end);
                let medium = match &self.march.frame.integrals {
                    Some(integrals) => {
                        let per_code = self.march.frame.positions_per_code as f64;
                        Shown::mean(integrals.between(value(start) * per_code, value(end) * per_code))
                    }
                    None => self.at::<C>(value(middle) as f32),
                };
                let Some(medium) = medium else { continue };
                let along = a + (b - a) * middle as f32;
                let mut differences = Vec3::ZERO;
                if self.has_gradients {
                    for i in near - beyond..=near + 1 + beyond {
                        // Not a closure, which would not be compiled for this vector unit.
                        if gradients[i].is_none() {
                            let known = at(i).unwrap_or(values[i + 1 - near]) as f32;
                            gradients[i] = Some(self.differences::<C, U>(row.along[i], known));
                        }
                    }
                    let gradient = |i: usize| gradients[i].unwrap_or(Vec3::ZERO);
                    differences = match beyond {
                        0 => gradient(near).lerp(gradient(near + 1), middle as f32),
                        _ => {
                            let [a, b] = [gradient(near - 1), gradient(near)];
                            let [c, d] = [gradient(near + 1), gradient(near + 2)];
                            let along = |k: usize| {
                                catmull_rom([a[k] as f64, b[k] as f64, c[k] as f64, d[k] as f64], middle) as f32
                            };
                            Vec3::new(along(0), along(1), along(2))
                        }
                    };
                }
                if let Some(medium) = self.by_gradient(medium, value(middle) as f32, differences) {
                    self.add_shown(
                        media,
                        segments.start + i as i32,
                        along,
                        medium,
                        differences,
                        (b - a) / parts as f32,
                    );
                }
            }
        }
        segments.start + count
    }

    /// Classifies a possibly visible medium by code and gradient.
    #[inline(always)]
    fn by_gradient(&self, shown: Shown, code: f32, differences: Vec3) -> Option<Shown> {
        match self.march.frame.grid {
            Some(grid) => self.in_grid(grid, code, differences),
            None => Some(shown),
        }
    }

    /// Out of line: with this in it, lit virtual samples without a grid took 1.13 times as long as before there were
    /// grids, now 1.05 (medians of three, 256^3).
    #[inline(never)]
    fn in_grid(&self, grid: &TransferGrid, code: f32, differences: Vec3) -> Option<Shown> {
        let gradient = (differences.as_dvec3() / self.voxel).length() * self.half_code;
        Shown::of(grid.lookup(code, gradient as f32).into())
    }

    #[inline(always)]
    fn add_shown(&self, media: &mut Row, segment: i32, along: f32, shown: Shown, differences: Vec3, share: f32) {
        let color = if self.is_lit { self.lit(along, shown.color, differences) } else { shown.color };
        self.push(media, segment, Shown { color, ..shown }, share);
    }

    #[inline(always)]
    fn push(&self, media: &mut Row, segment: i32, Shown { color, depth }: Shown, share: f32) {
        media.push(Passed { segment, color, depth, length: share.max(0.0) as f64 * self.length });
    }

    /// The medium at a code, if visible.
    #[inline(always)]
    fn at<C: Code>(&self, code: f32) -> Option<Shown> {
        let frame = self.march.frame;
        Shown::of(Entries::of(frame).lookup(code * frame.positions_per_code))
    }

    /// The lit straight colour of a crossed surface, and its opacity. Not inlined: see [`Path::row`].
    #[inline(always)]
    pub(crate) fn surface<C: Code, U: Unit>(&self, crossing: Crossing) -> Vec4 {
        U::call(
            crossing,
            #[inline(always)]
            move |crossing| {
                let (frame, Crossing { surface, along, is_cap }) = (self.march.frame, crossing);
                let look = &frame.settings.surfaces[surface];
                // A cap is lit by the normal of its cut.
                let (differences, cut) = match is_cap {
                    true => (Vec3::ZERO, self.cut),
                    false => (self.differences::<C, U>(along, frame.thresholds[surface]), None),
                };
                self.lit_by(&frame.surface_lighting, cut, along, Vec3::from(look.color), differences)
                    .extend(look.opacity)
            },
        )
    }

    #[inline(always)]
    pub(crate) fn distance(&self, along: f32) -> f64 {
        self.stretch.middle + along as f64 * self.stretch.length
    }

    fn lit(&self, along: f32, color: Vec3, differences: Vec3) -> Vec3 {
        self.lit_by(self.lighting(), self.cut, along, color, differences)
    }

    /// A colour lit at a place; behind a cut, the cut's normal lights its surroundings.
    fn lit_by(
        &self,
        lighting: &Lighting,
        cut: Option<(CutFace, f64)>,
        along: f32,
        color: Vec3,
        differences: Vec3,
    ) -> Vec3 {
        let mut normal = self.in_world(differences).map(DVec3::normalize);
        if let Some((cut, rate)) = cut {
            let share = CutFace::share((self.distance(along) - cut.entry) * rate);
            normal = cut.mixed(normal, self.direction, share);
        }
        let place = self.eye + self.direction * self.distance(along);
        lighting.shade(color.as_dvec3(), normal, self.direction, place).as_vec3()
    }

    /// The gradient in the scene's world, in half codes per unit; `None` where the field is flat.
    fn in_world(&self, differences: Vec3) -> Option<DVec3> {
        let March { frame, .. } = self.march;
        let is_flat = differences.length() < frame.flat_codes;
        let placement = &frame.settings.placement;
        (!is_flat).then(|| placement.world_gradient(differences.as_dvec3() / self.voxel))
    }

    /// The gradient in the middle of a segment with this code: in the scene's world, in data units per world unit; zero
    /// where the field is flat.
    #[inline(never)]
    pub(crate) fn gradient<C: Code, U: Unit>(&self, segment: i32, code: f32) -> DVec3 {
        let [start, end] = self.ends(segment);
        let differences = self.differences::<C, U>(0.5 * (start + end), code);
        self.in_world(differences).map_or(DVec3::ZERO, |gradient| gradient * self.half_code)
    }

    /// Differences of codes across two voxels along each axis; the middle's code replaces missing values. For labels,
    /// differences of the label's indicator.
    #[inline(always)]
    fn differences<C: Code, U: Unit>(&self, along: f32, middle: f32) -> Vec3 {
        if self.march.frame.reading == Reading::Label {
            return self.label_differences::<C>(along, middle);
        }
        let taps: &[Tap] = match self.march.frame.settings.lighting.gradient {
            Gradient::Central => &CENTRAL,
            Gradient::Sobel => &SOBEL,
            Gradient::Stored => {
                return self.stored_differences(along) * self.march.frame.gradient_scale;
            }
        };
        let centre = self.slot_place(along);
        let mut differences = Vec3::ZERO;
        for taps in taps.chunks(LANES) {
            let codes = self.around::<C, U>(centre, taps, middle);
            for (tap, code) in taps.iter().zip(codes) {
                differences += Vec3::from(tap.share) * code;
            }
        }
        let is_flat = differences.length() < FLAT_SHARE as f32 * middle.abs();
        if is_flat { Vec3::ZERO } else { differences }
    }

    /// Differences across two voxels along each axis of a label's indicator: as large as one code between the label and
    /// others.
    #[inline(never)]
    fn label_differences<C: Code>(&self, along: f32, label: f32) -> Vec3 {
        let centre = self.slot_place(along);
        let at = |axis: usize, side: f32| {
            let mut place = centre;
            place[axis] += side;
            self.march.brick.indicator::<C>(place, label)
        };
        Vec3::from_array([0, 1, 2].map(|axis| at(axis, 1.0) - at(axis, -1.0)))
    }

    /// The stored differences, as shares of the greatest code, or of the unit of f32 slots. Out of line for the same
    /// reason.
    #[inline(never)]
    fn stored_differences(&self, along: f32) -> Vec3 {
        let March { frame, cell, .. } = self.march;
        Gradients::new(cell.brick.gradients(), frame.gradients, frame.apron).at(self.slot_place(along))
    }

    /// The slot coordinates of places, or of the nearest ones that can be sampled.
    #[inline(always)]
    fn points(&self, along: &Packet) -> [Packet; 3] {
        let mut inside = *along;
        for i in 0..LANES {
            inside[i] = along[i].max(self.low).min(self.high);
        }
        points(self.stretch.origin, self.stretch.step, &inside)
    }

    /// The slot coordinate of a place, or of the nearest one that can be sampled.
    #[inline(always)]
    fn slot_place(&self, along: f32) -> [f32; 3] {
        let along = along.max(self.low).min(self.high);
        std::array::from_fn(|a| self.stretch.origin[a] + along * self.stretch.step[a])
    }

    /// The codes at the taps about a centre, at most a packet; the middle's code replaces missing values.
    #[inline(always)]
    fn around<C: Code, U: Unit>(&self, centre: [f32; 3], taps: &[Tap], middle: f32) -> Packet {
        let [x, y, z] = centre;
        let (mut points, mut weight) = ([[x; LANES], [y; LANES], [z; LANES]], [1.0; LANES]);
        for (i, tap) in taps.iter().enumerate().take(LANES) {
            for a in 0..3 {
                points[a][i] += tap.offset[a];
            }
        }
        let March { frame, brick, .. } = self.march;
        let mut code = brick.read_points::<C, U>(frame.reading.of_gradients(), &points, &mut weight);
        for i in 0..LANES {
            code[i] = if weight[i] > 0.0 { code[i] } else { middle };
        }
        code
    }
}

/// A single value stands for both.
#[inline(always)]
fn known<T: Copy>([a, b]: [Option<T>; 2]) -> [Option<T>; 2] {
    [a.or(b), b.or(a)]
}

/// A visible medium.
struct Shown {
    color: Vec3,
    depth: f64,
}

impl Shown {
    /// The medium of an entry, straight colour and opacity, if visible.
    #[inline(always)]
    fn of(entry: Vec4) -> Option<Self> {
        (entry.w > 0.0).then(|| Self { color: entry.truncate(), depth: -(1.0 - entry.w as f64).log2() })
    }

    fn mean(Mean { rgb, depth }: Mean) -> Option<Self> {
        (depth > 0.0).then(|| Self { color: DVec3::from_array(rgb).as_vec3(), depth })
    }
}

/// Zeroes differences at places of these codes if they are no more than rounding ([`FLAT_SHARE`]).
#[inline(always)]
fn without_rounding(code: &Packet, mut differences: [Packet; 3]) -> [Packet; 3] {
    for i in 0..LANES {
        let [x, y, z] = [differences[0][i], differences[1][i], differences[2][i]];
        let least = FLAT_SHARE as f32 * code[i];
        let kept = if x * x + y * y + z * z < least * least { 0.0 } else { 1.0 };
        differences.iter_mut().for_each(|axis| axis[i] *= kept);
    }
    differences
}
