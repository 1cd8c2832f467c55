//! One layer's frame, shared by all tiles: the cells, front to back, in picture and slot coordinates, the lattice, and
//! the visible part of the transfer table.

use crate::depths::DepthTable;
use crate::macrocells::{Mask, over_boxes};
use crate::outline::pixels;
use crate::packet::{LANES, Packet};
use crate::painting::Painting;
use crate::reading::Reading;
use crate::sample::{Brick, Code, CodeMap};
use crate::steps::StepTables;
use crate::ticks::Ticks;
use brickyard_pager::{DrawCell, DrawList, PixelShare, Slot};
use brickyard_volume::macrocells::{MacroCells, OpaqueCodes};
use brickyard_volume::sampling::Curve;
use brickyard_volume::slot_encoding::ANYTHING;
use brickyard_volume::surface::MAX_SURFACES;
use brickyard_volume::{
    Blend, Clip, Extent, Extreme, Filter, FrameSettings, Geometry, GradientNodes, Integrals, Lighting, Method, Mode,
    Needs, PixelRect, Placement, Pyramid, TransferGrid, ViewRays, VolumeFrame, VoxelBox, surface,
};
use glam::{DVec3, Mat3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

/// The side of a surface with codes of at least the threshold. A side of 0 is unknown.
pub(crate) const INSIDE: f32 = 1.0;
/// The side of a surface with codes below the threshold.
pub(crate) const OUTSIDE: f32 = -1.0;

/// A layer's frame while it is drawn, shared by all tiles.
pub(crate) struct Frame<'a> {
    pub(crate) settings: &'a FrameSettings,
    pub(crate) ticks: Ticks,
    /// The low corner of the shown box, in level-0 voxels; `shown_high` is the opposite one.
    pub(crate) shown_low: DVec3,
    pub(crate) shown_high: DVec3,
    /// For each entry of the draw list, the most light of any ray that entered its cell so far, as the bits of an
    /// `f32`, which sort like the numbers. Empty in modes without occlusion.
    pub(crate) light: Box<[AtomicU32]>,
    /// The cells, front to back. In a maximum or minimum projection, the likely decisive cells come first.
    pub(crate) cells: Vec<Cell<'a>>,
    pub(crate) reading: Reading,
    pub(crate) extent: Extent,
    /// Voxels along the edge of a brick's core; `apron` is the number of voxels on each side of it.
    pub(crate) edge: u32,
    pub(crate) apron: u32,
    pub(crate) gradients: GradientNodes,
    /// Maps slot numbers to codes counted from the transfer table's first.
    pub(crate) map: CodeMap,
    /// The factor from stored gradients to differences of codes.
    pub(crate) gradient_scale: f32,
    /// The difference of codes below which the field is flat.
    pub(crate) flat_codes: f32,
    /// The transfer table's last code; samples may have greater ones.
    pub(crate) last_code: f32,
    /// Positions in the transfer table, in entries, per code.
    pub(crate) positions_per_code: f32,
    /// Unit distances of the transfer function per world unit.
    pub(crate) per_unit: f64,
    /// Adaptive sampling: the largest difference between the codes at a part's two ends before the part is split.
    pub(crate) adaptive_step: f64,
    /// The transfer function's running integrals; `None` if the method does not use them.
    pub(crate) integrals: Option<&'a Integrals>,
    /// The table by value and gradient for classifying fog; `None` if fog is classified by value alone.
    pub(crate) grid: Option<&'a TransferGrid>,
    /// The effects of whole steps through the layer's fog. No tables for a layer drawn together with others, without
    /// fog, or with codes wider than 8 bits.
    pub(crate) steps: StepTables,
    /// The layer's medium, as part of a joint medium; `None` if the layer is drawn alone or has no fog.
    pub(crate) depths: Option<DepthTable>,
    /// The two positions in the transfer table outside of which opacity is zero.
    pub(crate) visible: [f32; 2],
    /// For each surface, the first code past it, ascending; infinite without a surface.
    pub(crate) thresholds: [f32; MAX_SURFACES],
    /// The lighting of surfaces: that of fog, or from the eye if fog is not lit.
    pub(crate) surface_lighting: Lighting,
    /// How the layer joins others in the same place; `opacity` is that of its projection.
    pub(crate) blend: Blend,
    pub(crate) opacity: f32,
    pub(crate) is_lit: bool,
    /// Whether the layer is drawn alone as one opaque surface, lit from the eye, with the identity as its placement:
    /// such pictures have loops of their own.
    pub(crate) is_one_opaque_surface: bool,
    /// The deadline, if any.
    pub(crate) until: Option<Instant>,
    /// The painting, whose viewer may abandon the picture.
    pub(crate) painting: Option<&'a Painting>,
}

/// One entry of a layer's draw list, as rays meet it.
pub(crate) struct Cell<'a> {
    /// The entry's index in the draw list; `order` is the cell's rank in the order of the cut.
    index: usize,
    pub(crate) order: u32,
    /// The low corner of the cell's half-open box in voxel space; `high` is the opposite one. The box is unbounded at
    /// the volume's faces: rays are already clipped there, and a sample rounded a hair outside still belongs to a cell.
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
    /// Slot coordinates per level-0 voxel: a slot coordinate (voxel centres at whole numbers) is `offset + voxel *
    /// scale`.
    pub(crate) scale: [f64; 3],
    pub(crate) offset: [f64; 3],
    /// Maps differences of codes across two of the brick's voxels to the scene's gradient, of any length.
    pub(crate) world_from_differences: Mat3,
    pub(crate) brick: &'a Resident,
    /// The macro-cells in which the brick may have opacity or a surface; all of them in projections.
    pub(crate) mask: Mask,
    /// The brick's side of the one opaque surface; 0 if on both, or without such a surface.
    pub(crate) side: f32,
    /// The number of surfaces the whole brick is past; negative if it varies, or is not needed.
    pub(crate) rank: i32,
    /// The least and the greatest code of the brick.
    pub(crate) whole: [f32; 2],
    /// How far the boxes of segments extend beyond them, in the brick's voxels, if the brick is read by
    /// [boxes](brickyard_volume::extremes).
    pub(crate) box_reach: Option<[f32; 3]>,
    /// The greatest code in each box of macro-cells in a maximum projection, the least code in a minimum projection;
    /// else empty.
    pub(crate) extremes: Box<[f32]>,
    /// The pixels that may see the cell; `pixels` is the share of them drawing this entry, `None` for all.
    pub(crate) rect: PixelRect,
    pub(crate) pixels: Option<PixelShare>,
}

impl Cell<'_> {
    #[inline(always)]
    pub(crate) fn draws(&self, x: u32, y: u32) -> bool {
        self.pixels.is_none_or(|pixels| pixels.hold(x, y))
    }
}

/// A padded brick in a slot, with its macro-cells.
#[derive(Debug)]
pub(crate) struct Resident {
    /// The padded brick: voxels, and gradients behind them.
    codes: Arc<[u8]>,
    voxel_bytes: usize,
    pub(crate) cells: MacroCells,
}

impl Resident {
    /// The first `voxel_bytes` bytes of `codes` are voxels, the others gradients.
    pub(crate) fn new(codes: Arc<[u8]>, voxel_bytes: usize, cells: MacroCells) -> Self {
        assert!(voxel_bytes <= codes.len(), "not a padded brick");
        Self { codes, voxel_bytes, cells }
    }

    pub(crate) fn into_codes(self) -> Arc<[u8]> {
        self.codes
    }

    pub(crate) fn voxels(&self) -> &[u8] {
        &self.codes[..self.voxel_bytes]
    }

    /// The nodes of the stored gradients; empty if there are none.
    pub(crate) fn gradients(&self) -> &[u8] {
        &self.codes[self.voxel_bytes..]
    }
}

impl<'a> Frame<'a> {
    /// Prepares the frame of a layer drawn alone (`by_itself`) or together with others. `brick` returns the brick in a
    /// slot.
    pub(crate) fn new(
        layer: &'a VolumeFrame,
        pyramid: &Pyramid,
        list: &DrawList,
        needs: &Needs,
        by_itself: bool,
        brick: impl Fn(Slot) -> &'a Resident + Sync,
    ) -> Self {
        let settings = &layer.settings;
        let (edge, apron) = (pyramid.edge(), needs.apron);
        let entries = &settings.table.entries;
        assert!(entries.len() >= 2, "a transfer table has at least two entries");
        let (shown_low, shown_high) = settings.shown_box(pyramid.levels()[0].extent);
        let is_one_opaque_surface = by_itself && settings.is_one_opaque_surface() && settings.placement.is_identity();
        let shows = Shows::new(settings, is_one_opaque_surface);
        let near_first = list.cells.par_iter().enumerate().rev();
        let cell = |(i, c): (usize, &DrawCell)| Cell::new(settings, pyramid, i, c, apron, &shows, brick(c.slot));
        let mut cells: Vec<Cell<'_>> = near_first.filter_map(cell).collect();
        match settings.mode.extreme() {
            Some(Extreme::Greatest) => cells.sort_by_key(|cell| Reverse(cell.brick.cells.whole()[1])),
            Some(Extreme::Least) => cells.sort_by_key(|cell| cell.brick.cells.whole()[0]),
            None => {}
        }
        let first = entries.iter().position(|e| e[3] > 0.0);
        let last = entries.iter().rposition(|e| e[3] > 0.0);
        let visible = match (first, last) {
            (Some(first), Some(last)) => [
                // Beyond its ends the table continues with its end values.
                if first == 0 { f32::MIN } else { first as f32 - 1.0 },
                if last + 1 == entries.len() { f32::MAX } else { last as f32 + 1.0 },
            ],
            _ => [f32::MAX, f32::MIN],
        };
        let ticks = Ticks::new(&settings.lattice);
        let (is_fog, format) = (settings.mode == Mode::Dvr, settings.encoding.format);
        let zones = if is_fog && by_itself { ticks.zones } else { 0 };
        let depths = (is_fog && !by_itself).then(|| DepthTable::new(&settings.table, layer.blend));
        let lit = if settings.mode.is_projection() { 0 } else { list.cells.len() };
        Self {
            settings,
            light: (0..lit).map(|_| AtomicU32::new(0)).collect(),
            adaptive_step: settings.table.adaptive_step() * settings.encoding.span_codes(),
            grid: settings.grid(),
            integrals: settings.method().is_pre_integrated().then(|| settings.table.integrals()),
            steps: StepTables::new(&settings.table, &settings.lattice, format, zones),
            depths,
            ticks,
            shown_low,
            shown_high,
            cells,
            reading: Reading::of(settings),
            extent: pyramid.levels()[0].extent,
            edge,
            apron,
            gradients: needs.gradients(edge),
            map: CodeMap::of(&settings.encoding),
            gradient_scale: settings.encoding.gradient_scale() as f32,
            flat_codes: settings.encoding.flat_codes() as f32,
            last_code: settings.encoding.span_codes() as f32,
            positions_per_code: settings.table.entries_per_code as f32,
            per_unit: 1.0 / settings.table.unit_distance as f64,
            visible,
            thresholds: thresholds(settings, 0.0),
            surface_lighting: surface::lighting(&settings.lighting),
            blend: layer.blend,
            opacity: layer.opacity as f32,
            is_lit: layer.is_lit(),
            is_one_opaque_surface,
            until: None,
            painting: None,
        }
    }
}

/// The first codes past each surface; the table's first code counts as `first`.
fn thresholds(settings: &FrameSettings, first: f64) -> [f32; MAX_SURFACES] {
    let mut thresholds = [f32::INFINITY; MAX_SURFACES];
    for (threshold, surface) in thresholds.iter_mut().zip(&settings.surfaces) {
        *threshold = (settings.encoding.code(surface.threshold) + first) as f32;
    }
    thresholds
}

/// The number of surfaces a code is past, given their thresholds.
#[inline(always)]
pub(crate) fn rank_of(thresholds: &[f32; MAX_SURFACES], code: f32) -> i32 {
    let mut rank = 0;
    for threshold in thresholds {
        rank += (*threshold <= code) as i32;
    }
    rank
}

/// Whether all shown is fog, classified by the value in the middle of each segment alone.
pub(crate) fn is_plain_fog(settings: &FrameSettings) -> bool {
    let is_bare = settings.surfaces.is_empty() && settings.grid().is_none();
    is_bare && settings.mode == Mode::Dvr && settings.method() == Method::Udvr
}

impl Frame<'_> {
    pub(crate) fn is_unlit_plain_fog(&self) -> bool {
        !self.is_lit && is_plain_fog(self.settings)
    }

    /// Whether [plain fog](is_plain_fog) is sampled, and its gradients found, in packets.
    pub(crate) fn is_sampled_in_packets(&self) -> bool {
        is_plain_fog(self.settings)
            && match self.is_lit {
                true => self.reading.of_gradients() == Reading::Filtered(Filter::Trilinear),
                false => self.reading != Reading::Filtered(Filter::Tricubic),
            }
    }

    /// Whether segments of fog or surfaces are examined from end to end.
    pub(crate) fn needs_ends(&self) -> bool {
        !self.settings.surfaces.is_empty() || self.settings.method().curve() != Curve::Middle
    }

    /// Whether drawing is given up. Checked once per cell or ray: reading a clock costs some 50 ns.
    pub(crate) fn is_given_up(&self) -> bool {
        self.painting.is_some_and(Painting::is_abandoned) || self.until.is_some_and(|until| Instant::now() >= until)
    }

    /// How far to shift the lattice of a pixel's ray towards the eye; `t_in` is the distance of the ray's entry.
    pub(crate) fn shift(&self, x: u32, y: u32, t_in: f64) -> f64 {
        self.settings.lattice.shift(self.settings.sampling.jitter.share(x, y), t_in)
    }

    /// A cell's brick, checked against the layout of its codes.
    #[inline(always)]
    pub(crate) fn brick<'b, C: Code>(&self, cell: &Cell<'b>) -> Brick<'b> {
        Brick::new::<C>(cell.brick.voxels(), self.edge + 2 * self.apron, self.map)
    }

    /// The most light of any ray that entered a cell so far, 0 to 1.
    #[inline(always)]
    pub(crate) fn visibility(&self, cell: &Cell<'_>) -> f32 {
        f32::from_bits(self.light[cell.index].load(Ordering::Relaxed))
    }

    /// Records that a ray enters a cell with this much light, which is at least 0.
    pub(crate) fn enter(&self, cell: &Cell<'_>, light: f32) {
        self.light[cell.index].fetch_max(light.to_bits(), Ordering::Relaxed);
    }

    /// The codes from which on, and before which, a place is past exactly `rank` surfaces; infinite without such a
    /// bound.
    #[inline(always)]
    pub(crate) fn band(&self, rank: i32) -> (f32, f32) {
        let threshold = |i: i32| self.thresholds.get(i as usize).copied();
        (threshold(rank - 1).unwrap_or(f32::NEG_INFINITY), threshold(rank).unwrap_or(f32::INFINITY))
    }

    /// Whether any of a packet's table positions may have opacity.
    #[inline(always)]
    pub(crate) fn shows(&self, position: &Packet) -> bool {
        let [low, high] = self.visible;
        let mut inside = *position;
        for i in 0..LANES {
            let (a, b) = (position[i] - low, high - position[i]);
            inside[i] = if a < b { a } else { b };
        }
        let mut half = LANES / 2;
        while half > 0 {
            for i in 0..half {
                inside[i] = if inside[i + half] > inside[i] { inside[i + half] } else { inside[i] };
            }
            half /= 2;
        }
        inside[0] > 0.0
    }
}

/// The visible ranges of slot codes, where independent of the ray.
enum Shows {
    All,
    Opaque(OpaqueCodes),
    /// Boxes with codes on both sides of a threshold.
    Surface(f32),
    /// Boxes with codes on both sides of one of several thresholds; and those with opacity, if there is fog.
    Layers([f32; MAX_SURFACES], Option<OpaqueCodes>),
}

impl Shows {
    fn new(settings: &FrameSettings, is_one_opaque_surface: bool) -> Self {
        let thresholds = thresholds(settings, settings.encoding.first_code());
        match settings.mode {
            Mode::Dvr if settings.surfaces.is_empty() => Self::Opaque(OpaqueCodes::new(&settings.table)),
            Mode::Dvr => Self::Layers(thresholds, Some(OpaqueCodes::new(&settings.table))),
            Mode::Isosurface if is_one_opaque_surface => Self::Surface(thresholds[0]),
            Mode::Isosurface => Self::Layers(thresholds, None),
            _ => Self::All,
        }
    }

    fn any(&self, range: [u16; 2]) -> bool {
        match self {
            Self::All => true,
            Self::Opaque(opaque) => opaque.any(range),
            Self::Surface(threshold) => surface::straddles(range, *threshold),
            Self::Layers(thresholds, fog) => {
                let [low, high] = range.map(|code| rank_of(thresholds, code as f32));
                let is_passed = range == ANYTHING || range[0] <= range[1] && low != high;
                is_passed || fog.as_ref().is_some_and(|opaque| opaque.any(range))
            }
        }
    }

    /// Whether some codes of a range are past a surface.
    fn is_inside(&self, [low, high]: [u16; 2]) -> bool {
        match self {
            Self::Surface(first) | Self::Layers([first, ..], _) => low <= high && *first <= high as f32,
            Self::All | Self::Opaque(_) => false,
        }
    }

    /// The visible parts of a brick. With caps this includes places past a surface: rays may enter there.
    fn mask(&self, cells: &MacroCells, edge: usize, has_caps: bool) -> Mask {
        let any = |range| self.any(range) || has_caps && self.is_inside(range);
        match self {
            Self::All => Mask::All,
            _ if !any(cells.whole()) => Mask::None,
            _ => Mask::new(cells, edge, any),
        }
    }

    /// The number of surfaces all of a range is past; negative if it varies.
    fn rank(&self, range: [u16; 2]) -> i32 {
        let [low, high] = range;
        match self {
            _ if range == ANYTHING => -1,
            Self::Layers(thresholds, _) if low <= high => {
                let [low, high] = [low, high].map(|code| rank_of(thresholds, code as f32));
                if low == high { low } else { -1 }
            }
            _ => -1,
        }
    }

    /// The range's side of the surface; 0 if on both, or if there is none.
    fn side(&self, range: [u16; 2]) -> f32 {
        let [low, high] = range;
        match self {
            _ if range == ANYTHING => 0.0,
            Self::Surface(threshold) if low <= high && low as f32 >= *threshold => INSIDE,
            Self::Surface(threshold) if low <= high && (high as f32) < *threshold => OUTSIDE,
            _ => 0.0,
        }
    }
}

fn extremes(settings: &FrameSettings, cells: &MacroCells, edge: usize) -> Box<[f32]> {
    let ranges = cells.ranges().iter().map(|range| counted(settings, *range));
    match settings.mode.extreme() {
        Some(Extreme::Greatest) => over_boxes(ranges.map(|range| range[1]), edge, f32::max),
        Some(Extreme::Least) => over_boxes(ranges.map(|range| range[0]), edge, f32::min),
        None => Box::default(),
    }
}

/// A range of slot codes, counted from the transfer table's first and clamped to the table.
fn counted(settings: &FrameSettings, range: [u16; 2]) -> [f32; 2] {
    let [first, last] = settings.encoding.table_codes;
    match range[0] <= range[1] {
        true => range.map(|code| (code.clamp(first, last) - first).into()),
        false => [f32::MAX, f32::MIN],
    }
}

impl<'a> Cell<'a> {
    /// `None` if no pixel can see it.
    fn new(
        settings: &FrameSettings,
        pyramid: &Pyramid,
        index_in_list: usize,
        cell: &DrawCell,
        apron: u32,
        shows: &Shows,
        brick: &'a Resident,
    ) -> Option<Self> {
        let rect = pixel_rect(&settings.rays, &settings.geometry, &settings.placement, cell.region)?;
        let edge = pyramid.edge() as usize;
        let [low, high] = [cell.region.min, cell.region.max]
            .map(|corner| settings.geometry.world_from_voxel(DVec3::from_array(corner.to_array().map(f64::from))));
        let FrameSettings { lattice, placement, rays, .. } = settings;
        let cuts = |clip: &Clip| clip.cuts_segments((low, high), lattice, placement, rays.eye);
        let is_cut = settings.caps && settings.clip.as_ref().is_some_and(cuts);
        let (mask, whole) = (shows.mask(&brick.cells, edge, is_cut), brick.cells.whole());
        let extremes = extremes(settings, &brick.cells, edge);
        let factor = pyramid.level(cell.brick.level).factor;
        let index = cell.brick.index.to_array();
        let (min, max) = (cell.region.min.to_array(), cell.region.max.to_array());
        let extent = pyramid.levels()[0].extent.to_array();
        let core = |a: usize| index[a] as f64 * pyramid.edge() as f64;
        Some(Self {
            index: index_in_list,
            order: cell.rank,
            low: std::array::from_fn(|a| if min[a] == 0 { f64::NEG_INFINITY } else { min[a] as f64 }),
            high: std::array::from_fn(|a| if max[a] == extent[a] { f64::INFINITY } else { max[a] as f64 }),
            scale: factor.map(|f| 1.0 / f as f64),
            offset: std::array::from_fn(|a| apron as f64 - 0.5 - core(a)),
            world_from_differences: world_from_differences(
                &settings.placement,
                settings.geometry.spacing * DVec3::from(factor.map(f64::from)),
            ),
            brick,
            mask,
            side: shows.side(whole),
            rank: shows.rank(whole),
            whole: counted(settings, whole),
            box_reach: settings.box_reach(factor).map(|reach| reach.map(|reach| reach as f32)),
            extremes,
            rect,
            pixels: (cell.pixels != PixelShare::ALL).then_some(cell.pixels),
        })
    }
}

/// The scene's gradient from differences across two voxels of this size.
fn world_from_differences(placement: &Placement, voxel: DVec3) -> Mat3 {
    let axis = |axis: DVec3| placement.world_gradient(axis / voxel).as_vec3();
    Mat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z))
}

/// The pixels whose rays may meet the box, with a pixel to spare on each side; `None` if there are none.
fn pixel_rect(rays: &ViewRays, geometry: &Geometry, placement: &Placement, region: VoxelBox) -> Option<PixelRect> {
    if region.is_empty() {
        return None;
    }
    let (min, max) = (region.min.to_array(), region.max.to_array());
    let corners: [DVec3; 8] = std::array::from_fn(|i| {
        let corner = std::array::from_fn(|a| if i >> a & 1 == 0 { min[a] } else { max[a] } as f64);
        placement.world_from_volume(geometry.world_from_voxel(DVec3::from_array(corner)))
    });
    if corners.iter().all(|corner| (corner - rays.eye).dot(rays.forward) < 0.0) {
        return None;
    }
    pixels(rays, rays.whole(), corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Camera, Projection};

    #[test]
    fn rects_hold_every_pixel_that_sees_the_box() {
        let region = VoxelBox::new([10, 20, 5], [18, 28, 13]);
        let (low, high) = (DVec3::new(10.0, 20.0, 5.0), DVec3::new(18.0, 28.0, 13.0));
        let geometry = Geometry { spacing: DVec3::new(1.0, 0.5, 2.0), ..Geometry::default() };
        let mut narrow = 0;
        let projections = [Projection::Perspective { fov_y_deg: 60.0 }, Projection::Orthographic { height: 30.0 }];
        let askew = Placement::from_text("0.6 -0.8 0.1 2  0.8 0.6 0 -3  0 0.2 -1.5 1").unwrap();
        for (i, (projection, aside)) in
            projections.into_iter().flat_map(|p| [(p, 0.0), (p, -4.0), (p, 4.0), (p, 0.5)]).enumerate()
        {
            let placement = if aside == 0.5 { askew } else { Placement::default() };
            for eye in [DVec3::new(-30.0, 3.0, 8.0), DVec3::new(12.0, 11.0, 18.0), DVec3::new(13.0, 9.0, 60.0)] {
                let target = geometry.world_from_voxel((low + high) * 0.5) + DVec3::new(3.0, 1.0, 0.0) * (i / 4) as f64;
                let [eye, target] = [eye, target].map(|at| placement.world_from_volume(at));
                let rays = Camera { eye, target, up: DVec3::Y, projection }.rays(40, 30).unwrap();
                let rays = rays.from_aside(aside, 25.0);
                let rect = pixel_rect(&rays, &geometry, &placement, region).expect("in view");
                narrow += (rect.x1 - rect.x0 < 40) as u32;
                for (x, y) in (0..30).flat_map(|y| (0..40).map(move |x| (x, y))) {
                    let ray = placement.volume_ray(&rays.ray(x as f64 + 0.5, y as f64 + 0.5));
                    let (o, d) = (geometry.voxel_from_world(ray.origin), ray.direction / geometry.spacing);
                    let (a, b) = ((low - o) / d, (high - o) / d);
                    let meets = a.max(b).min_element() > a.min(b).max_element().max(0.0);
                    let holds = (rect.x0..rect.x1).contains(&x) && (rect.y0..rect.y1).contains(&y);
                    assert!(holds || !meets, "{projection:?} {eye} {x} {y} {rect:?}");
                }
            }
        }
        assert!(narrow >= 9, "rects that are always the whole picture prove nothing");
    }
}
