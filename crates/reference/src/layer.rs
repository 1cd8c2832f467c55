//! One layer along a ray: its part of each segment, its own medium there, and its projection.

use crate::ReferenceVolume;
use crate::medium::{Field, turned};
use crate::path::Path;
use crate::surface::{Crossing, Crossings};
use brickyard_volume::compositing::LayerMedium;
use brickyard_volume::surface::Meeting;
use brickyard_volume::{Blend, Extreme, Lighting, LightingModel, Mode, Ray, Segment, VolumeFrame, extremes, surface};
use glam::DVec3;

/// A ray's way through one layer.
pub(crate) struct Way<'a> {
    /// The layer's index among all layers.
    pub(crate) index: usize,
    pub(crate) frame: &'a VolumeFrame,
    pub(crate) volume: &'a ReferenceVolume<'a>,
    path: Path,
    /// The distances between which the ray is in the shown part.
    stretch: (f64, f64),
    /// The shift of this pixel's lattice, in segments.
    jitter: f64,
    /// The lighting of its fog, and of its surfaces.
    fog_lighting: Lighting,
    surface_lighting: Lighting,
}

/// A piece of a segment between two surfaces of one layer, and the layer's own medium there.
pub(crate) struct Piece {
    pub(crate) ends: Segment,
    pub(crate) alone: LayerMedium,
}

/// A surface met by a ray: where, and its lit colour and opacity.
pub(crate) struct Met {
    pub(crate) at: Meeting,
    pub(crate) color: DVec3,
    pub(crate) opacity: f64,
}

/// The segments of a ray between two distances, near to far, from its entry into the first of these layers to its exit
/// from the last.
pub(crate) fn segments(ways: &[Way<'_>], [near, far]: [f64; 2]) -> impl Iterator<Item = Segment> {
    let t_in = ways.iter().map(|way| way.stretch.0).fold(f64::INFINITY, f64::min);
    let t_out = ways.iter().map(|way| way.stretch.1).fold(0.0, f64::max);
    ways.first().into_iter().flat_map(move |way| {
        let lattice = &way.frame.settings.lattice;
        let shift = lattice.shift(way.jitter, t_in);
        let segments = lattice.segments(t_in.max(near) + shift, t_out.min(far) + shift);
        segments.map(move |s| Segment { start: s.start - shift, end: s.end - shift })
    })
}

impl<'a> Way<'a> {
    /// The way of a pixel's ray through a layer; `None` if the ray misses its shown part.
    pub(crate) fn new(
        index: usize,
        frame: &'a VolumeFrame,
        volume: &'a ReferenceVolume<'a>,
        x: u32,
        y: u32,
    ) -> Option<Self> {
        let settings = &frame.settings;
        let path = Path::new(settings, &volume.levels[0], x, y);
        let stretch = path.stretch(settings, &volume.levels[0])?;
        let jitter = settings.sampling.jitter.share(x, y);
        let mut fog_lighting = settings.lighting.clone();
        if frame.blend == Blend::Add {
            fog_lighting.model = LightingModel::None;
        }
        let surface_lighting = surface::lighting(&settings.lighting);
        Some(Self { index, frame, volume, path, stretch, jitter, fog_lighting, surface_lighting })
    }

    /// The layer's part of a segment, and the field there, if any.
    fn part(&self, segment: Segment) -> Option<(Segment, Field<'_>)> {
        let part = Segment { start: segment.start.max(self.stretch.0), end: segment.end.min(self.stretch.1) };
        (part.length() > 0.0).then(|| {
            let level = &self.volume.levels[(self.volume.level_at)(self.path.at(part.middle()))];
            let frame = &self.frame.settings;
            (part, Field { frame, level, path: &self.path, lighting: &self.fog_lighting, cut: self.path.cut })
        })
    }

    /// The layer's part of a segment, and the value in the middle of that part; `None` if there is no part or no value.
    pub(crate) fn middle(&self, segment: Segment) -> Option<(Segment, f64)> {
        let (part, field) = self.part(segment)?;
        Some((part, field.value(part.middle())?))
    }

    /// The lit colour of fog at distance `t`; `gradient` is in the scene's world, and `None` where the field is flat.
    pub(crate) fn lit(&self, color: DVec3, gradient: Option<DVec3>, t: f64) -> DVec3 {
        let Ray { origin, direction } = self.path.world;
        let normal = turned(&self.path, self.path.cut, DVec3::ONE, gradient.map(DVec3::normalize), t);
        self.fog_lighting.shade(color, normal, direction, origin + direction * t)
    }

    /// The gradient in the scene's world in the middle of the layer's part of a segment, where the field has this
    /// value. Zero where the field is flat, or where nothing depends on gradients.
    pub(crate) fn gradient(&self, segment: Segment, value: f64) -> DVec3 {
        // Labels are flat between their borders.
        if self.frame.settings.encoding.is_labels {
            return DVec3::ZERO;
        }
        let gradient = |(part, field): (Segment, Field<'_>)| field.gradient(field.differences(part.middle(), value));
        self.part(segment).and_then(gradient).unwrap_or(DVec3::ZERO)
    }

    /// Adds the layer's contents of a segment: the pieces of its fog to `pieces`, and the surfaces between them, lit,
    /// to `surfaces`.
    pub(crate) fn take(
        &self,
        segment: Segment,
        crossings: &mut Crossings<'_>,
        pieces: &mut Vec<Piece>,
        surfaces: &mut Vec<Met>,
    ) {
        let Some((part, field)) = self.part(segment) else { return };
        let mut start = part.start;
        let extent = self.volume.levels[0].extent;
        let cap = self.frame.settings.cap(extent, self.path.origin, self.path.direction, 0.0, start);
        for Crossing { t, surface, is_cap } in crossings.within(part, cap.is_some(), |t| field.value(t)) {
            pieces.extend(self.piece(field, Segment { start, end: t }));
            let cut = if is_cap { cap } else { None };
            let of_surfaces = Field { lighting: &self.surface_lighting, cut, ..field };
            let color = DVec3::from_array(surface.color.map(f64::from));
            let color = of_surfaces.shade(color, of_surfaces.differences(t, surface.threshold), t);
            let at = Meeting::new(t, is_cap, self.frame.settings.lattice.step);
            surfaces.push(Met { at, color, opacity: surface.opacity as f64 });
            start = t;
        }
        pieces.extend(self.piece(field, Segment { start, ..part }));
    }

    /// The fog of a piece, if the mode shows fog and the piece has a length.
    fn piece(&self, field: Field<'_>, ends: Segment) -> Option<Piece> {
        let has_fog = self.frame.settings.mode == Mode::Dvr && ends.length() > 0.0;
        has_fog.then(|| Piece { ends, alone: field.alone(ends, self.frame.blend, self.volume.transfer) })
    }

    /// The layer's part of a segment, and its value for a projection: the one in the middle of the part or, depending
    /// on the level, the extreme of the part's box. `None` if there is no part or no value.
    fn projected(&self, segment: Segment) -> Option<(Segment, f64)> {
        let (part, field) = self.part(segment)?;
        let Some(reach) = field.frame.box_reach(field.level.factor) else { return self.middle(segment) };
        let way = self.path.direction * part.length() / DVec3::from_array(field.level.factor.map(f64::from));
        let touched = field.level.touched(self.path.at(part.middle()), extremes::half_box(way.to_array(), reach));
        let is_least = field.frame.mode.extreme() == Some(Extreme::Least);
        Some((part, touched.reduce(if is_least { f64::min } else { f64::max })?))
    }

    /// The greatest, the least or the mean value between two distances, depending on the mode; `None` without values.
    pub(crate) fn projection(&self, limits: [f64; 2]) -> Option<f64> {
        let samples = segments(std::slice::from_ref(self), limits).filter_map(|segment| self.projected(segment));
        // Hidden labels hide nothing.
        let is_shown = |value: f64| !self.frame.settings.encoding.is_labels || self.volume.transfer.alpha(value) > 0.0;
        let samples: Vec<(Segment, f64)> = samples.filter(|(_, value)| is_shown(*value)).collect();
        let values = || samples.iter().map(|(_, value)| *value);
        match self.frame.settings.mode {
            Mode::Mip => values().reduce(f64::max),
            Mode::MinIp => values().reduce(f64::min),
            Mode::Average => {
                let length: f64 = samples.iter().map(|(part, _)| part.length()).sum();
                let sum: f64 = samples.iter().map(|(part, value)| value * part.length()).sum();
                (length > 0.0).then(|| sum / length)
            }
            Mode::Dvr | Mode::Isosurface => None,
        }
    }
}
