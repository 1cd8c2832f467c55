//! Property tests of the whole pager without threads or a GPU: invariants under random volumes, cameras, occupancies, budgets, failures and
//! orders of arrival.

use crate::budget::{PagerConfig, Planning, TABLE_BYTES_PER_SLOT};
use crate::cut::{Cut, View, cut_capacity, roots, world_box};
use crate::dither::PixelShare;
use crate::draw_list::DrawList;
use crate::goal::{Goal, VolumeBrick};
use crate::pager::Pager;
use crate::residency::{Ahead, Arrival, Arrived, Residency, Step, Upload, UploadLimit, VolumeStep, Wants};
use crate::retry::Failure;
use crate::source::{BrickError, BrickSource};
use crate::split::{KEEP, Subject, cuts};
use crate::test_source::TestSource;
use crate::tier::Tier;
use crate::visible_cells::{Ranked, VisibleCells};
use brickyard_volume::{
    BrickId, BrickIndex, Camera, Clip, ClipPlane, Extent, Filter, Level, LevelPolicy, Occupancy, Placement, Projection,
    Pyramid, Ray, VoxelBox, VoxelType,
};
use glam::{DAffine3, DMat3, DVec3, EulerRot};
use proptest::prelude::*;
use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// A cheap generator for choices without shrinking of their own.
#[derive(Clone, Debug)]
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        // SplitMix64.
        self.0 = self.0.wrapping_add(0x9e3779b97f4a7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58476d1ce4e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d049bb133111eb);
        z ^ z >> 31
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }
}

#[derive(Clone, Debug)]
struct Volume {
    extent: [u32; 3],
    spacing: [f64; 3],
    edge: u32,
    /// Coarse levels left out, as in foreign pyramids: then there are several roots.
    missing_levels: usize,
    empty_share: f64,
    failing_share: f64,
    seed: u64,
}

impl Volume {
    fn source(&self) -> TestSource {
        let whole = Pyramid::new(Extent::from_array(self.extent), self.spacing, self.edge);
        let levels: Vec<_> = whole.levels().iter().map(|level| (level.extent, level.factor)).collect();
        let kept = levels.len().saturating_sub(self.missing_levels).max(1);
        let pyramid = Pyramid::from_levels(&levels[..kept], self.edge);
        let mut source = TestSource::new(pyramid.clone(), self.spacing, VoxelType::U8);
        let mut dice = Dice(self.seed);
        for (l, grid) in pyramid.levels().iter().enumerate() {
            for index in indices(grid.bricks) {
                let id = BrickId { time: 0, channel: 0, level: Level(l as u8), index };
                // The shown time step, and the coming ones.
                let of_times = (0..3).map(|time| BrickId { time, ..id });
                source.failing.extend(of_times.filter(|_| dice.chance(self.failing_share)));
                let child = |index| BrickId { level: Level(id.level.0 - 1), index, ..id };
                let empty = match l {
                    0 => dice.chance(self.empty_share),
                    _ => pyramid.children(id.level, index).all(|index| source.empty.contains(&child(index))),
                };
                if empty {
                    source.empty.insert(id);
                }
            }
        }
        source
    }
}

fn indices(grid: Extent) -> impl Iterator<Item = BrickIndex> {
    let [x, y, z] = grid.to_array();
    (0..z).flat_map(move |z| (0..y).flat_map(move |y| (0..x).map(move |x| BrickIndex::new(x, y, z))))
}

fn volumes() -> impl Strategy<Value = Volume> {
    (
        prop::array::uniform3(1u32..70),
        prop::array::uniform3(0.3f64..3.0),
        prop::sample::select(vec![4u32, 8]),
        prop::sample::select(vec![0, 0, 1, 2]),
        prop::sample::select(vec![0.0, 0.3, 0.9]),
        prop::sample::select(vec![0.0, 0.0, 0.05, 0.5]),
        any::<u64>(),
    )
        .prop_map(|(extent, spacing, edge, missing_levels, empty_share, failing_share, seed)| Volume {
            extent,
            spacing,
            edge,
            missing_levels,
            empty_share,
            failing_share,
            seed,
        })
}

/// A camera in units of the volume's box, so that shrinking keeps its meaning.
#[derive(Clone, Debug)]
struct Shot {
    eye: [f64; 3],
    target: [f64; 3],
    orthographic: bool,
    opening: f64,
    level: LevelPolicy,
    pixel_error: f64,
    cull_empty: bool,
    /// Distance of another eye to the right, if there is one.
    aside: Option<f64>,
    /// Points and normals of clip planes.
    planes: Vec<([f64; 3], [f64; 3])>,
    /// Placement of the volume.
    placement: Placement,
}

impl Shot {
    fn clip(&self, place: impl Fn([f64; 3]) -> DVec3) -> Clip {
        let plane = |&(point, normal): &_| ClipPlane { point: place(point), normal: DVec3::from_array(normal) };
        Clip::new(None, &self.planes.iter().map(plane).collect::<Vec<_>>()).unwrap()
    }

    fn view(&self, source: &TestSource) -> View {
        let (low, high) = source.geometry().world_box(source.pyramid().levels()[0].extent);
        let place = |p: [f64; 3]| low + (high - low) * DVec3::from_array(p);
        let projection = if self.orthographic {
            Projection::Orthographic { height: (high - low).length() * self.opening }
        } else {
            Projection::Perspective { fov_y_deg: 10.0 + 110.0 * self.opening }
        };
        let [eye, target] = [self.eye, self.target].map(|at| self.placement.world_from_volume(place(at)));
        let up = if (target - eye).cross(DVec3::Z).length() > 1e-3 { DVec3::Z } else { DVec3::Y };
        let camera = Camera { eye, target, up, projection };
        let fallback = Camera { eye, target: eye + DVec3::X, up: DVec3::Z, projection };
        let rays = camera.rays(96, 64).or_else(|_| fallback.rays(96, 64)).unwrap();
        let opaque = self.cull_empty.then_some(Occupancy::ALL);
        let diagonal = (high - low).length();
        View {
            rays,
            other_eye: self.aside.map(|aside| rays.from_aside(aside * diagonal, diagonal)),
            opaque,
            caps: None,
            filter: Filter::Trilinear,
            level: self.level,
            pixel_error: self.pixel_error,
            time: 0,
            channel: 0,
            clip: Some(self.clip(place)),
            placement: self.placement,
            appearance: 0,
            window: None,
        }
    }
}

/// Half of the volumes as their stores place them, the others turned, leaning, mirrored and stretched by up to a hundred.
fn placements() -> impl Strategy<Value = Placement> {
    let placed =
        (prop::array::uniform3(-3.1f64..3.1), prop::array::uniform3(-1.0f64..1.0), -1.0f64..1.0, any::<bool>());
    let placed = placed.prop_map(|(turn, stretch, lean, mirrors)| {
        let turn = DMat3::from_euler(EulerRot::XYZ, turn[0], turn[1], turn[2]);
        let lean = DMat3::from_cols(DVec3::X, DVec3::new(lean, 1.0, 0.0), DVec3::Z);
        let mirror = DVec3::new(if mirrors { -1.0 } else { 1.0 }, 1.0, 1.0);
        let stretch = DMat3::from_diagonal(DVec3::from_array(stretch.map(|s| 10f64.powf(s))) * mirror);
        let map = DAffine3 { matrix3: turn * lean * stretch, translation: DVec3::new(30.0, -7.0, 2.0) };
        Placement::new(map).unwrap()
    });
    prop_oneof![Just(Placement::default()), placed]
}

fn shots() -> impl Strategy<Value = Shot> {
    // Half the eyes outside or anywhere, half on round places: inside, on brick borders, straight along an axis.
    let coordinate = || prop_oneof![-1.0f64..2.0, prop::sample::select(vec![-1.0, 0.0, 0.25, 0.5, 1.0, 2.0])];
    (
        [coordinate(), coordinate(), coordinate()],
        prop::array::uniform3(prop_oneof![0.0f64..1.0, Just(0.5)]),
        any::<bool>(),
        0.05f64..1.0,
        prop_oneof![3 => Just(LevelPolicy::Auto), 1 => (0u8..5).prop_map(LevelPolicy::Locked)],
        0.05f64..4.0,
        any::<bool>(),
        prop::option::of(prop_oneof![-0.5f64..0.5, Just(0.0)]),
        prop_oneof![2 => Just(Vec::new()), 1 => prop::collection::vec(plane(), 1..4), 1 => plane().prop_map(slab)],
        placements(),
    )
        .prop_map(
            |(eye, target, orthographic, opening, level, pixel_error, cull_empty, aside, planes, placement)| Shot {
                eye,
                target,
                orthographic,
                opening,
                level,
                pixel_error,
                cull_empty,
                aside,
                planes,
                placement,
            },
        )
}

/// A point of a clip plane, in units of the volume's box, and the plane's normal.
fn plane() -> impl Strategy<Value = ([f64; 3], [f64; 3])> {
    let at = || prop_oneof![0.0f64..1.0, prop::sample::select(vec![0.0, 0.25, 0.5])];
    let across = prop_oneof![
        prop::array::uniform3(-1.0f64..1.0).prop_filter("a length", |n| n.map(f64::abs).iter().sum::<f64>() > 0.1),
        prop::sample::select(vec![[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 2.0]]),
    ];
    ([at(), at(), at()], across)
}

/// Planes of a slice, which leaves nearly nothing.
fn slab((point, normal): ([f64; 3], [f64; 3])) -> Vec<([f64; 3], [f64; 3])> {
    let beside = |sign: f64| (std::array::from_fn(|a| point[a] - sign * 1e-6 * normal[a]), normal.map(|n| sign * n));
    vec![beside(1.0), beside(-1.0)]
}

/// The stretch of a ray inside a box of level-0 voxels, in world distance.
fn stretch(source: &TestSource, ray: &Ray, region: VoxelBox) -> Option<(f64, f64)> {
    let corner = |v: [u32; 3]| source.geometry().world_from_voxel(DVec3::from_array(v.map(f64::from)));
    let (low, high) = (corner(region.min.to_array()), corner(region.max.to_array()));
    let (mut near, mut far) = (0.0f64, f64::INFINITY);
    for a in 0..3 {
        if ray.direction[a] == 0.0 {
            if ray.origin[a] < low[a] || ray.origin[a] > high[a] {
                return None;
            }
            continue;
        }
        let (t0, t1) = ((low[a] - ray.origin[a]) / ray.direction[a], (high[a] - ray.origin[a]) / ray.direction[a]);
        near = near.max(t0.min(t1));
        far = far.min(t0.max(t1));
    }
    (near < far).then_some((near, far))
}

fn region(source: &TestSource, id: BrickId) -> VoxelBox {
    source.pyramid().brick_box_voxel(id.level, id.index)
}

fn holds(region: VoxelBox, voxel: [u32; 3]) -> bool {
    let (low, high) = (region.min.to_array(), region.max.to_array());
    (0..3).all(|a| (low[a]..high[a]).contains(&voxel[a]))
}

/// The brick and its ancestors.
fn lineage(pyramid: &Pyramid, id: BrickId) -> impl Iterator<Item = BrickId> {
    std::iter::successors(Some(id), |id| {
        pyramid.parent(id.level, id.index).map(|index| BrickId { level: Level(id.level.0 + 1), index, ..*id })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// For any cut, made after any other: its cells cover the volume once; its visible cells in any view hold every visible non-empty
    /// voxel, and come back to front along every ray; the cells wanted by its own view fit.
    #[test]
    fn a_cut_covers_the_volume_and_what_is_seen_comes_in_a_valid_order(
        volume in volumes(), shots in prop::collection::vec(shots(), 1..4), max_cells in 1usize..400, seed in any::<u64>(),
    ) {
        let source = volume.source();
        let views: Vec<View> = shots.iter().map(|shot| shot.view(&source)).collect();
        let (first, later) = views.split_first().unwrap();
        let own = shots.len() - 1;
        let cut = later.iter().fold(Cut::new(&source, first, max_cells), |cut, view| cut.next(&source, view, max_cells));
        prop_assert!(cut.wanted() <= max_cells.max(cut.roots));
        prop_assert_eq!(VisibleCells::new(&source, &cut, &views[own]).cells.len(), cut.wanted());
        for (position, node) in cut.nodes.iter().enumerate() {
            prop_assert!(position < cut.roots || node.parent.index() < position);
        }
        let cells: Vec<BrickId> = cut.ids().filter(|&node| cut[node].is_cell()).map(|node| cut.id(node)).collect();
        let voxels: u64 = cells.iter().map(|&cell| region(&source, cell).extent().volume()).sum();
        prop_assert_eq!(voxels, source.pyramid().levels()[0].extent.volume());
        let mut dice = Dice(seed);
        for (shot, view) in shots.iter().zip(&views) {
            let sight = VisibleCells::new(&source, &cut, view);
            let seen = |order: &[Ranked]| order.iter().map(|ranked| cut.id(ranked.cell)).collect::<Vec<_>>();
            check_rays(&volume, &source, view, shot.cull_empty, &cells, &seen(&sight.cells), &mut dice)?;
            if let Some(order) = &sight.for_other_eye {
                let other = view.from_other_eye();
                check_rays(&volume, &source, &other, shot.cull_empty, &cells, &seen(order), &mut dice)?;
            }
        }
    }

    /// A cut made after others is as good as a cold one: see [`crate::split`] for why.
    #[test]
    fn a_cut_after_others_is_as_good_as_a_cold_one(
        volume in volumes(), shots in prop::collection::vec(shots(), 2..5), max_cells in 1usize..400,
    ) {
        let source = volume.source();
        let views: Vec<View> = shots.iter().map(|shot| shot.view(&source)).collect();
        let mut cut = Cut::new(&source, &views[0], max_cells);
        for view in &views {
            let cold = Cut::new(&source, view, max_cells);
            let next = cut.next(&source, view, max_cells);
            let split = |cut: &Cut| -> HashSet<BrickId> {
                cut.ids().filter(|&node| !cut[node].is_cell()).map(|node| cut.id(node)).collect()
            };
            prop_assert_eq!(next.memory_bound(), cold.memory_bound());
            if cold.memory_bound() {
                // The compared products and quotients are rounded to one part in 2^52.
                let worst = cold.effective_error_px() / KEEP * (1.0 + 1e-12);
                prop_assert!(next.effective_error_px() <= worst, "{} {}", next.effective_error_px(), worst);
            } else {
                prop_assert!(split(&next).is_superset(&split(&cold)), "coarser than cold");
                if view.level == LevelPolicy::Auto {
                    prop_assert!(next.effective_error_px() <= view.pixel_error);
                }
            }
            let again = next.next(&source, view, max_cells);
            prop_assert!(split(&again).is_superset(&split(&next)), "coarser at rest");
            cut = next;
        }
    }
}

/// Along rays of a view, every voxel is in one of the cut's cells, and unless empty in a visible one; visible cells come back to front.
fn check_rays(
    volume: &Volume,
    source: &TestSource,
    view: &View,
    cull_empty: bool,
    cells: &[BrickId],
    seen: &[BrickId],
    dice: &mut Dice,
) -> Result<(), TestCaseError> {
    let volume_box = source.pyramid().levels()[0].extent.full_box();
    let count = |cells: &[BrickId], voxel| cells.iter().filter(|&&cell| holds(region(source, cell), voxel)).count();
    for _ in 0..12 {
        let (x, y) = ((dice.unit() * 0.98 + 0.01) * 96.0, (dice.unit() * 0.98 + 0.01) * 64.0);
        let ray = view.placement.volume_ray(&view.rays.ray(x, y));
        let Some((near, far)) = stretch(source, &ray, volume_box) else { continue };
        // Half of the places anywhere, half in the shown part.
        let (from, to) = view.clip.as_ref().map_or((near, far), |clip| clip.shorten(&ray, (near, far)));
        for i in 0..8 {
            let is_shown = i % 2 == 1;
            if is_shown && to <= from {
                continue;
            }
            let (near, far) = if is_shown { (from, to) } else { (near, far) };
            let point = ray.origin + ray.direction * (near + (far - near) * (0.001 + 0.998 * dice.unit()));
            let voxel = source.geometry().voxel_from_world(point).to_array();
            let voxel: [u32; 3] = std::array::from_fn(|a| (voxel[a].max(0.0) as u32).min(volume.extent[a] - 1));
            let index = BrickIndex::from_array(voxel.map(|v| v / volume.edge));
            let finest = BrickId { time: 0, channel: 0, level: Level(0), index };
            prop_assert_eq!(count(cells, voxel), 1);
            let (count, empty) = (count(seen, voxel), cull_empty && source.empty.contains(&finest));
            prop_assert!(count == 1 || (count == 0 && (empty || !is_shown)), "voxel {:?} is in {} cells", voxel, count);
        }
        let mut before = f64::INFINITY;
        for &cell in seen {
            // Stretches shorter than rounding at these distances (about 1e-13 of 1e3) are touches, not hits.
            let Some((near, far)) = stretch(source, &ray, region(source, cell)) else { continue };
            if far - near > 1e-9 {
                prop_assert!(far <= before + 1e-9, "{} is drawn after what is in front of it", cell);
                before = near;
            }
        }
    }
    Ok(())
}

/// Volumes sharing slots, each in the view of a shot. Some stand on the grid of the first, with the same view.
fn shared(volumes: Vec<(Volume, bool)>) -> Vec<Volume> {
    let first = volumes[0].0.clone();
    let on_grid = |(volume, shares): (Volume, bool)| match shares {
        true => Volume {
            empty_share: volume.empty_share,
            failing_share: volume.failing_share,
            seed: volume.seed,
            ..first.clone()
        },
        false => volume,
    };
    volumes.into_iter().map(on_grid).collect()
}

fn views(shot: &Shot, sources: &[TestSource]) -> Vec<View> {
    sources.iter().map(|source| shot.view(source)).collect()
}

/// Cuts of volumes sharing a number of cells, after others.
fn joint(sources: &[TestSource], views: &[View], max_cells: usize, last: &[Cut]) -> Vec<Cut> {
    let subjects = sources.iter().zip(views).map(|(source, view)| Subject { source, view, visibility: None });
    let subjects: Vec<Subject<'_>> = subjects.collect();
    cuts(&subjects, max_cells, &last.iter().collect::<Vec<_>>())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// Cuts sharing a number of cells fit; those on one grid have one tree; the worst cells of all are split first; and with enough room,
    /// each equals the volume's cut alone.
    #[test]
    fn cuts_that_share_their_cells_split_the_worst_of_any_volume(
        volumes in prop::collection::vec((volumes(), any::<bool>()), 1..5), shots in prop::collection::vec(shots(), 1..3),
        max_cells in 1usize..400,
    ) {
        let sources: Vec<TestSource> = shared(volumes).iter().map(Volume::source).collect();
        let mut cuts = Vec::new();
        for shot in &shots {
            cuts = joint(&sources, &views(shot, &sources), max_cells, &cuts);
        }
        let views = views(shots.last().unwrap(), &sources);
        let cold = joint(&sources, &views, max_cells, &[]);
        let roots: usize = cuts.iter().map(|cut| cut.roots).sum();
        for cuts in [&cuts, &cold] {
            prop_assert!(cuts.iter().map(Cut::wanted).sum::<usize>() <= max_cells.max(roots));
        }
        let memory_bound = cold[0].memory_bound();
        prop_assert!(cuts.iter().chain(&cold).all(|cut| cut.memory_bound() == memory_bound));
        for (i, cut) in cuts.iter().enumerate() {
            let on_one_grid = sources[i].pyramid() == sources[0].pyramid()
                && sources[i].geometry() == sources[0].geometry() && views[i] == views[0];
            prop_assert!(!on_one_grid || cut.shares_tree_with(&cuts[0]));
        }
        let wanted = |cut: &Cut| cut.cells().collect::<BTreeSet<_>>();
        let alone = sources.iter().zip(&views).map(|(source, view)| Cut::new(source, view, usize::MAX));
        prop_assert!(memory_bound || alone.zip(&cold).all(|(alone, cut)| wanted(&alone) == wanted(cut)));
        let improvable = |cut: &Cut| match cut.view.level {
            LevelPolicy::Auto => cut.effective_error_px().max(cut.view.pixel_error),
            LevelPolicy::Locked(_) => 0.0,
        };
        let worst = cold.iter().map(improvable).fold(0.0, f64::max);
        let splits = cold.iter().flat_map(|cut| cut.ids().filter(|&node| !cut[node].is_cell()).map(|node| cut[node].error_px));
        let least = splits.fold(f64::INFINITY, f64::min);
        prop_assert!(least >= worst, "{least} px is split, {worst} px is not");
    }
}

/// A pager of several volumes without threads, a twin with the same input, and a model of the atlas.
struct Bench<'a> {
    sources: &'a [TestSource],
    twins: [Residency; 2],
    atlas: HashMap<u32, VolumeBrick>,
    in_flight: BTreeSet<VolumeBrick>,
    dice: Dice,
    slots: u32,
    seed: u64,
    upload_bytes: Option<u64>,
    /// Whether a brick could be uploaded in the last frame.
    has_room: bool,
    fade: Option<Duration>,
    now: Duration,
    /// Times at which bricks got their slots.
    came: HashMap<VolumeBrick, Duration>,
    /// Cuts of each coming view.
    coming: Vec<Vec<Cut>>,
}

/// Bytes of the pretended padded bricks.
const PADDED: u64 = 10;

/// A view of a volume's cut.
struct Wanted<'a> {
    cut: &'a Cut,
    sight: VisibleCells,
    roots: Vec<BrickId>,
}

fn goals<'a>(sources: &'a [TestSource], cuts: &'a [Cut]) -> Vec<Goal<'a>> {
    sources.iter().zip(cuts).map(|(source, cut)| Goal { pyramid: source.pyramid(), cut }).collect()
}

impl Bench<'_> {
    fn wanted<'a>(&self, cuts: &'a [Cut], views: &[View]) -> Vec<Wanted<'a>> {
        let all = cuts.iter().zip(self.sources).zip(views);
        let of = |((cut, source), view): ((&'a Cut, &TestSource), &View)| Wanted {
            cut,
            sight: VisibleCells::new(source, cut, view),
            roots: roots(source, 0, 0),
        };
        all.map(of).collect()
    }

    fn frame(&mut self, wanted: &[Wanted<'_>]) -> Step {
        self.deliver();
        let ahead = self.ahead(wanted);
        let all: Vec<Wants<'_>> = wanted
            .iter()
            .zip(self.sources)
            .map(|(Wanted { cut, sight, .. }, source)| Wants { goal: Goal { pyramid: source.pyramid(), cut }, sight })
            .collect();
        let before: HashSet<VolumeBrick> = self.atlas.values().copied().collect();
        self.now += Duration::from_millis(self.dice.next() % 60);
        // Now and then the renderer has little room, or none.
        let room = self.dice.next() % 100;
        let room_bytes = self.dice.next().is_multiple_of(4).then_some(room);
        self.has_room = room_bytes.is_none_or(|room| room >= PADDED);
        let (limit, now) = (UploadLimit { goal_bytes: self.upload_bytes, room_bytes }, self.now);
        let coming: Vec<Vec<Goal<'_>>> = self.coming.iter().map(|cuts| goals(self.sources, cuts)).collect();
        let ahead_of_all = Ahead { coming: &coming, listed: &ahead };
        // This twin searches the coming steps' bricks anew; the other one has kept the result.
        self.twins[1].steps_ahead.clear();
        let [step, twin] = self.twins.each_mut().map(|r| r.step(&all, ahead_of_all, limit, now));
        assert_eq!(step.coming, twin.coming);
        self.check_coming(&coming, &step);
        let names = |step: &Step| step.uploads.iter().map(|u| (u.slot, u.volume, u.brick)).collect::<Vec<_>>();
        let plans = |step: &Step| step.volumes.iter().map(|v| (v.draw.clone(), v.requests.clone())).collect::<Vec<_>>();
        assert_eq!((names(&step), plans(&step)), (names(&twin), plans(&twin)));
        let bytes = step.uploads.len() as u64 * PADDED;
        assert!(step.uploads.len() <= 1 || self.upload_bytes.is_none_or(|limit| bytes <= limit));
        assert!(room_bytes.is_none_or(|room| bytes <= room), "there was room for {room_bytes:?}");
        for &Upload { slot, volume, brick: id, .. } in &step.uploads {
            assert!(slot.0 < self.slots);
            self.atlas.insert(slot.0, VolumeBrick { volume, id });
            self.came.insert(VolumeBrick { volume, id }, self.now);
        }
        let after: HashSet<VolumeBrick> = self.atlas.values().copied().collect();
        assert_eq!(after.len(), self.atlas.len(), "a brick has two slots");
        let stays = |brick: VolumeBrick| !before.contains(&brick) || after.contains(&brick);
        for (volume, Wanted { cut, roots, .. }) in wanted.iter().enumerate() {
            let mut kept = roots.iter().copied().chain(cut.cells());
            assert!(kept.all(|id| stays(VolumeBrick { volume, id })), "pinned or wanted, and evicted");
        }
        // Only a brick wanted for an earlier tier takes another's place.
        let tier_of = |brick: VolumeBrick| {
            ahead.iter().find(|(_, other)| *other == brick).map_or(Tier::Visible, |(tier, _)| *tier)
        };
        // Coming steps leave less room for the others than assumed in listing these.
        let tiers: &[Tier] = if self.coming.is_empty() { &[Tier::Predicted, Tier::Ring] } else { &[] };
        for &tier in tiers {
            let gone = ahead.iter().filter(|(of, brick)| *of == tier && !stays(*brick)).count();
            let uploads = step.uploads.iter().map(|upload| VolumeBrick { volume: upload.volume, id: upload.brick });
            let earlier = uploads.filter(|&brick| tier_of(brick) < tier).count();
            assert!(gone <= earlier, "{gone} of {tier:?} are gone for {earlier}");
        }
        for (volume, (wanted, step)) in wanted.iter().zip(&step.volumes).enumerate() {
            let is_there = |&id: &BrickId| {
                after.contains(&VolumeBrick { volume, id }) || self.twins[0].failure(volume, id).is_some()
            };
            match wanted.roots.iter().all(is_there) {
                true => self.check_draw(volume, wanted, step),
                false => assert!(step.draw.cells.is_empty(), "a picture that may have holes"),
            }
        }
        step
    }

    fn roots(&self, cuts: &[Cut]) -> Vec<Vec<BrickId>> {
        self.sources.iter().zip(cuts).map(|(source, cut)| roots(source, cut.view.time, 0)).collect()
    }

    /// A step is reported whole exactly if it has all wanted bricks.
    fn check_coming(&self, coming: &[Vec<Goal<'_>>], step: &Step) {
        assert_eq!(step.coming.len(), coming.len());
        for (ready, goals) in step.coming.iter().zip(coming) {
            let is_there = |brick: VolumeBrick| {
                let failing = self.twins[0].failure(brick.volume, brick.id).is_some();
                failing || self.twins[0].is_resident(brick)
            };
            let of_volume = |(volume, goal): (usize, &Goal<'_>)| {
                let sought = &self.sources[volume];
                let all = roots(sought, goal.cut.view.time, 0).into_iter().chain(goal.cut.cells());
                all.map(|id| VolumeBrick { volume, id }).collect::<Vec<_>>()
            };
            let all: Vec<VolumeBrick> = goals.iter().enumerate().flat_map(of_volume).collect();
            assert!(!ready.is_whole || ready.is_covered && all.iter().all(|&brick| is_there(brick)));
            assert!(ready.is_whole == (ready.missing == 0 && ready.is_planned));
            let is_drawn = |(volume, goal): (usize, &Goal<'_>)| {
                let is_resident = |id| self.twins[0].is_resident(VolumeBrick { volume, id });
                goal.cut.cells().all(|cell| lineage(goal.pyramid, cell).any(is_resident))
            };
            assert!(!ready.is_covered || ready.is_whole || goals.iter().enumerate().all(is_drawn));
        }
    }

    /// Whether the first coming step has room beside the present one, whatever it lacks at first.
    fn has_room_for_coming(&self, wanted: &[Wanted<'_>]) -> bool {
        let Some(cuts) = self.coming.first() else { return false };
        let cells: usize = wanted.iter().map(|wanted| wanted.cut.wanted() + wanted.roots.len()).sum();
        let roots: usize = self.roots(cuts).iter().map(Vec::len).sum();
        // An unreadable cell needs an ancestor, too.
        let coming: usize = cuts.iter().map(|cut| 2 * cut.wanted()).sum();
        cells + coming + roots <= self.slots as usize
    }

    /// Some bricks to prefetch, no more than fit, the same as long as the cuts are the same.
    fn ahead(&self, wanted: &[Wanted<'_>]) -> Vec<(Tier, VolumeBrick)> {
        let sum = |of: fn(&Wanted<'_>) -> usize| wanted.iter().map(of).sum::<usize>();
        let (cells, roots) = (sum(|wanted| wanted.cut.wanted()), sum(|wanted| wanted.roots.len()));
        let mut dice = Dice(cells as u64 + self.seed);
        let mut ahead = Vec::new();
        for (volume, (wanted, source)) in wanted.iter().zip(self.sources).enumerate() {
            let cells: HashSet<BrickId> = wanted.cut.cells().collect();
            let pyramid = source.pyramid();
            let levels = pyramid.levels().iter().enumerate();
            for (level, index) in levels.flat_map(|(l, grid)| indices(grid.bricks).map(move |i| (Level(l as u8), i))) {
                let id = BrickId { time: 0, channel: 0, level, index };
                if !cells.contains(&id) && level < pyramid.coarsest() && dice.chance(0.1) {
                    let tier = if dice.chance(0.5) { Tier::Predicted } else { Tier::Ring };
                    ahead.push((tier, VolumeBrick { volume, id }));
                }
            }
        }
        ahead.sort();
        let slots = self.slots as usize;
        let mut left = [Tier::Predicted, Tier::Ring].map(|tier| tier.slots(slots));
        ahead.retain(|(tier, _)| {
            let left = &mut left[(*tier == Tier::Ring) as usize];
            *left = left.wrapping_sub(1);
            *left < slots
        });
        ahead.truncate(slots.saturating_sub(cells + roots));
        ahead
    }

    /// Delivers some of the bricks in flight, in any order.
    fn deliver(&mut self) {
        let mut waiting: Vec<VolumeBrick> = self.in_flight.iter().copied().collect();
        for _ in 0..self.dice.next() % 12 {
            if waiting.is_empty() {
                return;
            }
            let brick = waiting.swap_remove(self.dice.next() as usize % waiting.len());
            self.in_flight.remove(&brick);
            let VolumeBrick { volume, id } = brick;
            let error = BrickError { id, reason: "told to fail".into(), is_passing: false };
            let failed = Failure { error, again: None };
            let failing = self.sources[volume].failing.contains(&id);
            let read = Arrived::Read { codes: Arc::from([0; PADDED as usize]), content: None };
            let result = if failing { Err(failed) } else { Ok(read) };
            self.twins.iter_mut().for_each(|r| r.arrive(volume, Arrival { id, result: result.clone() }));
        }
    }

    /// Every cell is drawn, in the cut's order, from the slot of its nearest resident brick, and left out only if there is none. A newly
    /// arrived brick may leave some of the pixels to a resident ancestor.
    fn check_draw(&self, volume: usize, Wanted { cut, sight, .. }: &Wanted<'_>, VolumeStep { draw, .. }: &VolumeStep) {
        let of_volume = self.atlas.iter().filter(|(_, brick)| brick.volume == volume);
        let slot_of: HashMap<BrickId, u32> = of_volume.map(|(&slot, brick)| (brick.id, slot)).collect();
        let source = &self.sources[volume];
        let mut drawn = draw.cells.iter();
        for cell in sight.cells.iter().map(|ranked| cut.id(ranked.cell)) {
            let nearest = lineage(source.pyramid(), cell).find(|id| slot_of.contains_key(id));
            let Some(nearest) = nearest else { continue };
            let mut entry = drawn.next().expect("a cell with a resident brick is not drawn");
            let mut rest = PixelShare::THRESHOLDS;
            if entry.brick != nearest {
                let mut ancestors = lineage(source.pyramid(), nearest).skip(1);
                assert!(ancestors.any(|id| id == entry.brick) && slot_of.get(&entry.brick) == Some(&entry.slot.0));
                assert_eq!((entry.cell, entry.region), (cell, region(source, cell)));
                let came = self.came[&VolumeBrick { volume, id: nearest }];
                assert!(self.fade.is_some_and(|time| self.now - came < time), "it was there long ago");
                rest = entry.pixels.from;
                assert!(rest > 0 && entry.pixels == PixelShare { from: rest, ..PixelShare::ALL });
                entry = drawn.next().expect("only what gives way is drawn");
            }
            assert_eq!(entry.pixels, PixelShare { to: rest, ..PixelShare::ALL });
            assert_eq!((entry.cell, entry.brick, entry.slot.0), (cell, nearest, slot_of[&nearest]));
            assert_eq!(entry.region, region(source, cell));
        }
        assert_eq!(drawn.next(), None);
        assert!(draw.cells.len() <= sight.cells.len().max(self.slots as usize));
        if let Some(order) = &sight.for_other_eye {
            // The other eye has the same entries, a cell's together.
            let other = draw.reordered(cut, order);
            let by_cell = |draw: &DrawList| {
                let mut entries = draw.cells.clone();
                entries.iter_mut().for_each(|entry| entry.rank = 0);
                entries.sort_by_key(|entry| entry.cell);
                entries
            };
            assert_eq!(by_cell(&other), by_cell(draw));
            let mut order = order.iter().map(|ranked| cut.id(ranked.cell));
            assert!(other.cells.chunk_by(|a, b| a.cell == b.cell).all(|of| order.any(|cell| cell == of[0].cell)));
        }
    }

    /// Some frames of views with the cuts of others, as while the camera moves ahead of the planner.
    fn fly(&mut self, cuts: &[Cut], views: &[View]) {
        let wanted = self.wanted(cuts, views);
        for _ in 0..4 {
            let step = self.frame(&wanted);
            self.ask(&step);
        }
    }

    /// Takes a limited number of requests of each volume from a plan.
    fn ask(&mut self, step: &Step) {
        for (volume, VolumeStep { requests, .. }) in step.volumes.iter().enumerate() {
            let room = 8usize.saturating_sub(self.in_flight.iter().filter(|brick| brick.volume == volume).count());
            let requests = requests.iter().map(|&(_, id)| VolumeBrick { volume, id });
            let new: Vec<_> = requests.filter(|brick| !self.in_flight.contains(brick)).take(room).collect();
            self.in_flight.extend(new);
        }
    }

    /// Runs views until they settle, and checks that they only refine on the way.
    fn settle(&mut self, cuts: &[Cut], views: &[View]) {
        let wanted = self.wanted(cuts, views);
        let mut levels: HashMap<(usize, BrickId, u8), Level> = HashMap::new();
        // Each round answers a request or makes an upload; the bound allows every brick ten empty rounds.
        let bricks: u64 = self.sources.iter().map(|source| source.pyramid().brick_count()).sum();
        let rounds = 100 + 10 * bricks * (1 + self.coming.len() as u64);
        for _ in 0..rounds {
            let staged = self.twins[0].has_staged();
            let step = self.frame(&wanted);
            let may_upload = self.twins[0].has_staged() && staged && self.has_room;
            assert!(!may_upload || !step.uploads.is_empty(), "no progress");
            let mut drawn = 0;
            let volumes = step.volumes.iter().enumerate();
            for (volume, entry) in volumes.flat_map(|(i, v)| v.draw.cells.iter().map(move |entry| (i, entry))) {
                // Some pixels of each cell.
                for threshold in [0, 7, 31, 63].into_iter().filter(|t| (entry.pixels.from..entry.pixels.to).contains(t))
                {
                    let before = levels.insert((volume, entry.cell, threshold), entry.brick.level);
                    assert!(before.is_none_or(|level| level >= entry.brick.level), "{} got coarser", entry.cell);
                    drawn += 1;
                }
            }
            assert!(levels.len() == drawn, "a cell vanished");
            if step.settled && (!self.has_room_for_coming(&wanted) || step.coming[0].is_whole) {
                return self.check_settled(&wanted, &step);
            }
            self.ask(&step);
        }
        panic!("not settled after {rounds} frames");
    }

    /// Each cell is drawn with its own brick or, if unreadable, its nearest readable ancestor.
    fn check_settled(&self, wanted: &[Wanted<'_>], step: &Step) {
        for ((Wanted { cut, sight, .. }, step), source) in wanted.iter().zip(&step.volumes).zip(self.sources) {
            let mut drawn = step.draw.cells.iter();
            for cell in sight.cells.iter().map(|ranked| cut.id(ranked.cell)) {
                let best = lineage(source.pyramid(), cell).find(|id| !source.failing.contains(id));
                if let Some(best) = best {
                    assert_eq!(drawn.next().map(|entry| entry.brick), Some(best));
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    /// For all arrivals in any order, under any shared budget: the draw lists are right in every frame, pins hold, views only refine, make
    /// progress and settle; a twin with the same input does the same.
    #[test]
    fn paging_is_safe_live_and_deterministic(
        volumes in prop::collection::vec((volumes(), any::<bool>()), 1..4), shots in prop::collection::vec(shots(), 1..4),
        slots in 1u32..120, upload_bytes in prop::option::of(0u64..80), fade_ms in prop::option::of(50u64..300),
        coming in 0u32..3, seed in any::<u64>(),
    ) {
        let sources: Vec<TestSource> = shared(volumes).iter().map(Volume::source).collect();
        let all_roots: usize = sources.iter().map(|source| roots(source, 0, 0).len()).sum();
        let slots = slots.max(all_roots as u32);
        let fade = fade_ms.map(Duration::from_millis);
        let twins = [(); 2].map(|()| Residency::new(sources.iter().map(|_| Arc::default()).collect(), slots, fade));
        let (atlas, in_flight, now, came) = Default::default();
        let (sources, dice) = (&sources[..], Dice(seed));
        let mut bench = Bench { sources, twins, atlas, in_flight, dice, slots, seed, upload_bytes, has_room: true, fade, now, came, coming: Vec::new() };
        let max_cells = cut_capacity(if coming > 0 { slots / 2 } else { slots }, all_roots);
        let mut cuts = joint(sources, &views(&shots[0], sources), max_cells, &[]);
        for views in shots.iter().map(|shot| views(shot, sources)) {
            bench.fly(&cuts, &views);
            cuts = joint(sources, &views, max_cells, &cuts);
            let at_step = |time| views.iter().map(|view| View { time, ..view.clone() }).collect::<Vec<_>>();
            bench.coming = (1..=coming).map(|time| joint(sources, &at_step(time), max_cells, &[])).collect();
            bench.settle(&cuts, &views);
        }
    }
}

/// A renderer's feedback on a draw list: rays through a grid of pixels lose light in each brick they cross. A brick's absorption is
/// independent of its parent's, so everything may come out differently at each level.
fn told(source: &TestSource, view: &View, draw: &DrawList, seed: u64) -> Vec<f32> {
    let mut told = vec![0f32; draw.cells.len()];
    for i in 0..96 {
        let ray = view.placement.volume_ray(&view.rays.ray((i % 12) as f64 * 8.0 + 4.0, (i / 12) as f64 * 8.0 + 4.0));
        let mut transmittance = 1f32;
        for (cell, told) in draw.cells.iter().zip(&mut told).rev() {
            if transmittance > 0.0 && stretch(source, &ray, cell.region).is_some() {
                *told = told.max(transmittance);
                let [x, y, z] = cell.brick.index.to_array().map(u64::from);
                let brick = (cell.brick.level.0 as u64) << 48 | x << 32 | y << 16 | z;
                transmittance *= [1.0, 0.5, 0.1, 0.0][Dice(seed ^ brick).next() as usize % 4];
            }
        }
    }
    told
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// With feedback on every drawn cell, whatever bricks hide, and some frames late: views come to rest, and then all cells reached by
    /// rays are at the view's level.
    #[test]
    fn feedback_comes_to_rest_and_leaves_nothing_out_that_is_seen(
        volume in volumes(), views in prop::collection::vec(shots(), 1..4), slots in 1u32..200, seed in any::<u64>(),
        late in 0usize..4,
    ) {
        let source = Arc::new(volume.source());
        let slots = slots.max(roots(&*source, 0, 0).len() as u32);
        let host_bytes = (1 << 20) + slots as u64 * TABLE_BYTES_PER_SLOT;
        let mut under_way = VecDeque::new();
        let (planning, prefetch, uploads) = (Planning::Inline, false, None);
        let config = PagerConfig { slots, apron: 1, gradient_layers: 0, host_bytes, contents: Vec::new(), keeps_decoded: prefetch, workers: 1, planning, prefetch, uploads, fade: None };
        let shared: Arc<dyn BrickSource> = source.clone();
        let mut pager = Pager::new(std::slice::from_ref(&shared), config).unwrap();
        let voxel_size = source.geometry().voxel_size(source.pyramid().levels()[0].extent);
        for view in views.iter().map(|shot| shot.view(&source)) {
            // Each brick may get eight weights, one after the other; in truth it is a few dozen frames.
            let mut frames_left = (100 + 8 * source.pyramid().brick_count()) * (1 + late as u64);
            let (frame, visibility) = loop {
                let frame = pager.frame(std::slice::from_ref(&view), Duration::ZERO);
                let mut visibility = told(&source, &view, &frame.volumes[0].draw, seed);
                if let Some(draw) = &frame.volumes[0].draw_other_eye {
                    visibility.extend(told(&source, &view.from_other_eye(), draw, seed));
                }
                if frame.status.settled {
                    break (frame, visibility);
                }
                under_way.push_back((pager.drawn(0).unwrap(), visibility.clone()));
                if under_way.len() > late && let Some((drawn, seen)) = under_way.pop_front() {
                    pager.feedback(0, &drawn, &seen);
                }
                if !frame.status.awaits_feedback {
                    pager.wait(Duration::from_secs(9));
                }
                frames_left -= 1;
                prop_assert!(frames_left > 0, "{:?}", frame.status);
            };
            let other = frame.volumes[0].draw_other_eye.iter().flat_map(|draw| draw.cells.iter().map(|cell| (cell, view.from_other_eye())));
            let entries = frame.volumes[0].draw.cells.iter().map(|cell| (cell, view.clone())).chain(other);
            for ((entry, view), _) in entries.zip(&visibility).filter(|(_, told)| **told > 0.0) {
                let best = lineage(source.pyramid(), entry.cell).find(|id| !source.failing.contains(id));
                prop_assert_eq!(Some(entry.brick), best);
                if view.level == LevelPolicy::Auto && !frame.status.memory_bound && entry.cell.level.0 > 0 {
                    let (low, high) = world_box(&*source, entry.cell.level, entry.cell.index);
                    // No longer than the way to any point of the box, and voxels are at least as long as on the way there.
                    let own_eye = view.placement.volume_from_world(view.rays.eye);
                    let nearest = view.placement.world_from_volume(own_eye.clamp(low, high));
                    let voxel_size = voxel_size * view.placement.stretches().1;
                    let size = voxel_size * (1u64 << entry.cell.level.0) as f64;
                    let error_px = size / view.rays.pixel_size(nearest.distance(view.rays.eye));
                    prop_assert!(error_px <= view.pixel_error, "{} px", error_px);
                }
            }
        }
    }
}
