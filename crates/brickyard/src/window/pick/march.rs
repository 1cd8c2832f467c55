//! Visible points along a ray: halfway through its total opacity, at its first surface, or at its extreme value. Each
//! is found on the whole ray at a coarse level first, then refined locally, level by level.

use super::cores::Cores;
use super::way::{Reader, Way};
use brickyard_pager::BrickError;
use brickyard_volume::{Combination, Extreme, Level, MAX_VOLUMES, Mode, Surface, surface};

/// Samples per voxel of a level, along the ray's fastest axis.
const SAMPLES: f64 = 2.0;

/// Samples per voxel at level 0, in the last search.
const FINEST_SAMPLES: f64 = 8.0;

/// Search radius in the next finer level, in voxels of the coarser one.
const AROUND: f64 = 2.0;

/// The least opacity of a ray with a visible point.
const LEAST_OPACITY: f64 = 0.02;

/// Halvings of light that count as all of it.
const OPAQUE_DEPTH: f64 = 64.0;

/// Halvings of light after which a ray ends.
const FAINT_DEPTH: f64 = 12.0;

/// A place along the ray, and its layer as a number among the ways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    pub(super) t: f64,
    pub(super) way: usize,
}

/// A search along a ray: the ways, and the number of levels each is finer than at first.
struct Search<'w, 'a> {
    ways: &'w [Way<'a>],
    combination: Option<&'w Combination>,
    finer: u8,
    /// Start and end.
    range: [f64; 2],
}

impl<'w, 'a> Search<'w, 'a> {
    fn whole(ways: &'w [Way<'a>], combination: Option<&'w Combination>) -> Self {
        let from = ways.iter().map(|way| way.stretch[0]).fold(f64::INFINITY, f64::min);
        let to = ways.iter().map(|way| way.stretch[1]).fold(0.0, f64::max);
        Self { ways, combination, finer: 0, range: [from, to] }
    }

    fn level(&self, way: &Way<'_>) -> Level {
        Level(way.level.0.saturating_sub(self.finer))
    }

    /// The length of a voxel of the finest level in use.
    fn voxel_length(&self) -> f64 {
        self.ways.iter().map(|way| way.voxel_length(self.level(way))).fold(f64::INFINITY, f64::min)
    }

    /// Whether this is the last search: at level 0, and not of the whole ray.
    fn is_finest(&self) -> bool {
        self.finer > 0 && self.ways.iter().all(|way| self.level(way) == Level(0))
    }

    /// Returns the next finer search around a place; `None` if this one was the finest.
    fn about(&self, t: f64) -> Option<Self> {
        let around = AROUND * self.ways.iter().map(|way| way.voxel_length(self.level(way))).fold(0.0, f64::max);
        let whole = Self::whole(self.ways, self.combination).range;
        let range = [(t - around).max(whole[0]), (t + around).min(whole[1])];
        (!self.is_finest()).then_some(Self { finer: self.finer + 1, range, ..*self })
    }

    fn readers(&self) -> Vec<Reader<'w, 'a>> {
        self.ways.iter().map(|way| Reader::new(way, self.level(way), self.finer == 0)).collect()
    }

    fn segments(&self) -> impl Iterator<Item = [f64; 2]> + use<> {
        let samples = if self.is_finest() { FINEST_SAMPLES } else { SAMPLES };
        let [from, to] = self.range;
        let count = ((to - from) / self.voxel_length() * samples).ceil().max(1.0);
        let at = move |i: f64| from + (to - from) * i / count;
        (0..count as u64).map(move |i| [at(i as f64), at(i as f64 + 1.0)])
    }
}

/// End of a segment of a ray, the halvings of light up to there, and the segment's most opaque way.
#[derive(Clone, Copy)]
struct End {
    t: f64,
    depth: f64,
    way: usize,
}

/// Halvings of light along a ray: the start of the first segment, and the end of each.
struct Collected(Vec<End>);

impl Collected {
    fn depth(&self) -> f64 {
        self.0.last().map_or(0.0, |end| end.depth)
    }

    fn depth_at(&self, t: f64) -> f64 {
        let next = self.0.partition_point(|end| end.t < t).clamp(1, self.0.len() - 1);
        let (start, end) = (self.0[next - 1], self.0[next]);
        start.depth + (end.depth - start.depth) * ((t - start.t) / (end.t - start.t)).clamp(0.0, 1.0)
    }

    /// Returns the place with this number of halvings; `None` if it is outside these segments.
    fn place(&self, depth: f64) -> Option<Hit> {
        let [start, end] = self.0.array_windows().find(|[_, end]| end.depth >= depth)?;
        let share = if end.depth > start.depth { (depth - start.depth) / (end.depth - start.depth) } else { 0.0 };
        (depth >= start.depth).then_some(Hit { t: start.t + (end.t - start.t) * share, way: end.way })
    }
}

/// Returns where a ray has collected half of its total opacity, of fog and surfaces; or, in [`Mode::Isosurface`], its
/// first surface. `None` if it collects next to nothing.
pub(super) fn seen_through(
    ways: &[Way<'_>],
    combination: Option<&Combination>,
    cores: &mut Cores,
) -> Result<Option<Hit>, BrickError> {
    let mut search = Search::whole(ways, combination);
    let mut collected = collect(&search, cores, 0.0, FAINT_DEPTH)?;
    let opacity = 1.0 - (-collected.depth()).exp2();
    if opacity < LEAST_OPACITY {
        return Ok(None);
    }
    let depth = -(1.0 - 0.5 * opacity).log2();
    let mut found = collected.place(depth);
    while let Some(hit) = found
        && let Some(next) = search.about(hit.t)
    {
        let before = collected.depth_at(next.range[0]);
        let finer = collect(&next, cores, before, depth)?;
        // If a finer level is clear just there, the coarser one's place is the best.
        let Some(better) = finer.place(depth) else { break };
        (found, collected, search) = (Some(better), finer, next);
    }
    Ok(found)
}

/// Follows a ray from `depth` halvings of its light on, until they reach `enough`.
fn collect(search: &Search<'_, '_>, cores: &mut Cores, mut depth: f64, enough: f64) -> Result<Collected, BrickError> {
    let mut readers = search.readers();
    let mut last = vec![None; search.ways.len()];
    let mut collected = vec![End { t: search.range[0], depth, way: 0 }];
    for [start, end] in search.segments() {
        let mut most = (0.0, 0);
        let (mut values, mut longest) = ([f64::NAN; MAX_VOLUMES], 0.0f64);
        for (i, (way, reader)) in search.ways.iter().zip(&mut readers).enumerate() {
            let part = [way.clamped(start), way.clamped(end)];
            if part[0] >= part[1] {
                last[i] = None;
                continue;
            }
            let t = 0.5 * (part[0] + part[1]);
            let value = reader.value(cores, t)?;
            let mut own = 0.0;
            if let Some(value) = value {
                (values[i], longest) = (value, longest.max(part[1] - part[0]));
                if way.settings.mode == Mode::Dvr && search.combination.is_none() {
                    own += halvings(
                        reader.alpha(cores, t, value)?,
                        (part[1] - part[0]) / way.layer.transfer.unit_distance,
                    );
                }
                own += match last[i] {
                    Some(before) => passed(way, before, value),
                    None if way.is_capped(part[0]) => capped(way, value),
                    None => 0.0,
                };
            }
            last[i] = value;
            depth += own;
            most = if own > most.0 { (own, i) } else { most };
        }
        if let Some(combination) = search.combination {
            // The first layer is as visible as any.
            most.1 = values.iter().position(|value| !value.is_nan()).unwrap_or(0);
            let alpha = combination.look(&values).map_or(0.0, |[.., alpha]| f64::from(alpha));
            depth += halvings(alpha, longest / combination.transfer.unit_distance);
        }
        collected.push(End { t: end, depth, way: most.1 });
        if depth >= enough {
            break;
        }
    }
    Ok(Collected(collected))
}

fn halvings(alpha: f64, length: f64) -> f64 {
    (-(1.0 - alpha).log2() * length).clamp(0.0, OPAQUE_DEPTH)
}

/// Returns the halvings of light by the surfaces between two values of a layer. In surface mode the first one is the
/// hit, however faint it is.
fn passed(way: &Way<'_>, before: f64, value: f64) -> f64 {
    let surfaces = &way.settings.surfaces;
    let [one, other] = [before, value].map(|value| surface::rank(surfaces, value));
    surfaces[one.min(other)..one.max(other)].iter().map(|surface| taken_by(way, surface)).sum()
}

/// Returns the halvings of light by the cap of a cut with this value of a layer behind it.
fn capped(way: &Way<'_>, value: f64) -> f64 {
    let surfaces = &way.settings.surfaces;
    surfaces[..surface::rank(surfaces, value)].last().map_or(0.0, |surface| taken_by(way, surface))
}

fn taken_by(way: &Way<'_>, surface: &Surface) -> f64 {
    match way.settings.mode {
        _ if surface.opacity <= 0.0 => 0.0,
        Mode::Isosurface => OPAQUE_DEPTH,
        _ => halvings(f64::from(surface.opacity), 1.0),
    }
}

/// Returns the nearest place of each way's greatest value, or least in [`Mode::MinIp`], with the value.
pub(super) fn extremes(ways: &[Way<'_>], cores: &mut Cores) -> Result<Vec<(Hit, f64)>, BrickError> {
    let mut found = Vec::new();
    for (i, way) in ways.iter().enumerate() {
        let mut search = Search::whole(std::slice::from_ref(way), None);
        let mut best = extreme(&search, cores)?;
        while let Some((t, _)) = best
            && let Some(next) = search.about(t)
        {
            best = extreme(&next, cores)?.or(best);
            search = next;
        }
        found.extend(best.map(|(t, value)| (Hit { t, way: i }, value)));
    }
    Ok(found)
}

/// Returns the extreme of a search's only way.
fn extreme(search: &Search<'_, '_>, cores: &mut Cores) -> Result<Option<(f64, f64)>, BrickError> {
    let (way, mut reader) = (&search.ways[0], search.readers().remove(0));
    let is_least = way.settings.mode.extreme() == Some(Extreme::Least);
    let mut best: Option<(f64, f64)> = None;
    for [start, end] in search.segments() {
        let t = 0.5 * (start + end);
        let Some(value) = reader.projected(cores, [start, end], is_least)? else { continue };
        // Hidden labels hide nothing.
        let is_shown = !way.settings.encoding.is_labels || way.layer.transfer.alpha(value) > 0.0;
        let is_better = |(_, best): (f64, f64)| if is_least { value < best } else { value > best };
        if is_shown && best.is_none_or(is_better) {
            best = Some((t, value));
        }
    }
    Ok(best)
}
