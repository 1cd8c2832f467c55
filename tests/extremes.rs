//! Maximum and minimum projections at coarse levels: of every voxel type, through every filter, by every way to draw, nothing of level 0 is lost and
//! nothing is added; possible losses are reported.

use brickyard::oracle::render_reference;
use brickyard::session::{Session, VolumeSource, resolve};
use brickyard::store::PackOptions;
use brickyard::volume::{
    Camera, Extent, Filter, Geometry, Level, LevelPolicy, Mode, Picture, Projection, Pyramid, Ray, Sampling, Scene,
    Slice, TransferFunction, ViewRays, Voxel, VoxelType,
};
use brickyard_tests::sample::{draws, sampled, seed};
use brickyard_tests::{
    Expected, FunctionSource, Random, Sandbox, TestStore, WAYS, Way, bytes_of, open_session_of, options, read_png,
    settled,
};
use glam::DVec3;

const SIZE: (u32, u32) = (40, 33);

/// Noise with bright and dark specks of single voxels, and its values, x fastest; NaN for missing ones. A picture shows values from 0 to `scale` on a
/// gray ramp.
struct Speckled {
    extent: Extent,
    geometry: Geometry,
    scale: f64,
    values: Vec<f64>,
}

impl Speckled {
    fn new(extent: Extent, geometry: Geometry, scale: f64, has_holes: bool) -> Self {
        let mut random = Random(u64::from(extent.x) + seed());
        let count = extent.volume() as usize;
        let mut values: Vec<f64> = (0..count).map(|_| scale * (0.3 + 0.2 * random.unit())).collect();
        for share in [0.0, 0.02, 0.9, 0.99] {
            for _ in 0..12 {
                values[random.bits() as usize % count] = share * scale;
            }
        }
        if has_holes {
            (0..count / 9).for_each(|_| values[random.bits() as usize % count] = f64::NAN);
        }
        Self { extent, geometry, scale, values }
    }

    /// Packs it with means and the extreme for a mode.
    fn pack<T: Voxel>(&self, mode: Mode) -> TestStore {
        let extreme = if mode == Mode::MinIp { "mean,min" } else { "mean,max" };
        let value = |_, _, voxel| T::from_f64_rounded(self.values[self.extent.linear(voxel) as usize]);
        let options = PackOptions {
            edge: 16,
            shard_edge: 64,
            downsample: extreme.parse().expect("two pyramids"),
            threads: 2,
            ..PackOptions::new(T::TYPE)
        };
        TestStore::pack_with(&FunctionSource::new(self.extent, self.geometry.clone(), value), options)
    }

    fn transfer(&self) -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [self.scale, 1.0, 1.0, 1.0]],
            opacity: vec![[0.0, 1.0]],
            ..TransferFunction::default()
        }
    }

    /// A view along an axis, an oblique one, one from near, and a slab.
    fn scenes(&self, mode: Mode) -> Vec<(&'static str, Scene)> {
        let (low, high) = self.geometry.world_box(self.extent);
        let (centre, size) = ((low + high) * 0.5, (high - low).length());
        let up = DVec3::Z;
        let parallel = |toward: DVec3, share: f64| Camera {
            eye: centre - toward * size,
            target: centre,
            up,
            projection: Projection::Orthographic { height: share * size },
        };
        let near = Camera {
            eye: centre + DVec3::new(0.61, -0.47, 0.38) * size,
            projection: Projection::Perspective { fov_y_deg: 41.0 },
            ..parallel(up, 1.0)
        };
        // The surroundings of the volume are beyond all extremes.
        let background = if mode == Mode::MinIp { [1.0; 3] } else { [0.0; 3] };
        let scene =
            |camera, slice| Scene { mode, camera: Some(camera), background, slice, ..Scene::of(self.transfer()) };
        let slab = Slice { point: centre, normal: DVec3::new(0.3, 1.0, 0.2), thickness: 0.13 * size };
        vec![
            ("along an axis", scene(parallel(DVec3::Y, 0.613), None)),
            ("oblique", scene(parallel(DVec3::new(0.52, -0.61, 0.27).normalize(), 0.87), None)),
            ("near", scene(near, None)),
            ("a slab", scene(parallel(DVec3::new(-0.3, 1.0, 0.4).normalize(), 0.71), Some(slab))),
        ]
    }

    /// The extremes of level-0 voxels in each voxel of a level and in `neighbours` voxels to each side.
    fn around(&self, factor: [u32; 3], neighbours: u32, is_least: bool) -> Around<'_> {
        let n = self.extent.to_array();
        let extent = Extent::from_array(std::array::from_fn(|a| n[a].div_ceil(factor[a])));
        let last = extent.to_array().map(|n| n - 1);
        let mut extremes = vec![f64::NAN; extent.volume() as usize];
        for (i, &value) in (0u32..).zip(&self.values) {
            let at = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
            let range = |a: usize| {
                let own = at[a] / factor[a];
                own.saturating_sub(neighbours)..=(own + neighbours).min(last[a])
            };
            for (z, y) in range(2).flat_map(|z| range(1).map(move |y| (z, y))) {
                for x in range(0) {
                    let extreme = &mut extremes[extent.linear([x, y, z]) as usize];
                    *extreme = if is_least { extreme.min(value) } else { extreme.max(value) };
                }
            }
        }
        Around { of: self, factor, extent, extremes, is_least }
    }
}

/// The extremes of level-0 voxels about each voxel of a level.
struct Around<'a> {
    of: &'a Speckled,
    factor: [u32; 3],
    extent: Extent,
    extremes: Vec<f64>,
    is_least: bool,
}

impl Around<'_> {
    /// The extreme about the voxels along a ray; `None` without a value about them.
    fn along(&self, ray: &Ray) -> Option<f64> {
        let geometry = &self.of.geometry;
        let (origin, direction) = (geometry.voxel_from_world(ray.origin), ray.direction / geometry.spacing);
        let n = self.of.extent.to_array().map(f64::from);
        let step = 0.2 / direction.abs().max_element();
        let far = origin.length() + DVec3::from_array(n).length();
        let mut best: Option<f64> = None;
        for i in 0..(far / direction.length() / step) as u32 {
            let point = origin + direction * (f64::from(i) * step);
            if (0..3).all(|a| (0.0..n[a]).contains(&point[a])) {
                let place = std::array::from_fn(|a| point[a] as u32 / self.factor[a]);
                let value = self.extremes[self.extent.linear(place) as usize];
                let better = |best: f64| if self.is_least { best.min(value) } else { best.max(value) };
                best = if value.is_nan() { best } else { Some(best.map_or(value, better)) };
            }
        }
        best
    }
}

/// The greatest distance between a ray's voxels and one shown in its pixel, in voxels of the drawn level.
fn neighbours(filter: Filter) -> u32 {
    match filter {
        Filter::Nearest | Filter::Trilinear => 1,
        Filter::Tricubic => 2,
    }
}

/// A store with a pyramid for a mode.
struct Subject<'a> {
    speckled: &'a Speckled,
    _test: TestStore,
    mode: Mode,
    volume: VolumeSource,
}

/// Bounds of the pixels of a view.
struct Truth {
    /// Level 0's picture: the least extreme permitted.
    exact: Picture,
    /// The most extreme code permitted; `None` without a bound.
    most: Vec<Option<f64>>,
    is_least: bool,
    /// Number of pixels permitted to differ: where rays graze the face of an unmixed voxel, rounding decides on a hit.
    allowed: usize,
}

impl Truth {
    fn assert_shown(&self, found: &Picture, what: &str) {
        let sign = if self.is_least { -1.0 } else { 1.0 };
        let mut off = Vec::new();
        for (i, (found, exact)) in found.rgb.iter().zip(&self.exact.rgb).enumerate() {
            let [found, exact] = [found[0], exact[0]].map(f64::from);
            let most = self.most[i].unwrap_or(sign * f64::INFINITY);
            if sign * found < sign * exact - 1.0 || sign * found > sign * most + 1.0 {
                off.push(format!("{found} in pixel {i}, where level 0 shows {exact} and there is at most {most}"));
            }
        }
        assert!(off.len() <= self.allowed, "{what}: {off:?}");
    }
}

impl<'a> Subject<'a> {
    fn new<T: Voxel>(speckled: &'a Speckled, mode: Mode) -> Self {
        let test = speckled.pack::<T>(mode);
        let volume = VolumeSource::of_store(&test.store).suited(mode).expect("the other pyramid");
        assert!(volume.keeps_extremes(mode));
        Self { speckled, _test: test, mode, volume }
    }

    fn sessions(&self) -> Vec<(Way, Session)> {
        let session =
            |way| Some((way, open_session_of(vec![self.volume.clone()], options(way, 256 << 20, 256 << 20))?));
        WAYS.into_iter().filter_map(session).collect()
    }

    fn oracle(&self, scene: &Scene) -> Picture {
        let resolved = resolve(std::slice::from_ref(&self.volume), scene, SIZE).expect("the scene is possible");
        let store = self.volume.store().expect("a store");
        render_reference(&[store], &resolved, 1 << 30).expect("the levels can be read")
    }

    /// The truth about a scene at a level; `exact` is level 0's picture.
    fn truth(&self, scene: &Scene, level: Level, exact: &Picture) -> Truth {
        let Speckled { extent, geometry, scale, .. } = self.speckled;
        let factor = Pyramid::new(*extent, geometry.spacing.to_array(), 16).level(level).factor;
        let is_least = self.mode == Mode::MinIp;
        let rays: ViewRays = scene.camera.expect("a camera").rays(SIZE.0, SIZE.1).expect("a view");
        let around = self.speckled.around(factor, neighbours(scene.sampling.filter), is_least);
        let most = |x: u32, y: u32| {
            // A slab shows only a part of the ray.
            let ray = scene.slice.is_none().then(|| rays.ray(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
            Some((255.0 * around.along(&ray)? / scale).clamp(0.0, 255.0))
        };
        let most = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))).map(|(x, y)| most(x, y)).collect();
        let allowed = if scene.sampling.filter == Filter::Nearest { 3 } else { 0 };
        Truth { exact: exact.clone(), most, is_least, allowed }
    }

    /// Draws a scene at every level, and across levels, in every way.
    fn check(&self, sessions: &mut [(Way, Session)], name: &str, scene: &Scene) {
        let levels = self.volume.counts().levels as u8;
        assert!(levels >= 3, "too few levels to prove anything");
        let exact = self.oracle(&Scene { level: LevelPolicy::Locked(0), ..scene.clone() });
        let policies = (0..levels).map(|level| (LevelPolicy::Locked(level), Level(level)));
        for (policy, level) in policies.chain([(LevelPolicy::Auto, Level(levels - 1))]) {
            // A pixel error at which levels meet in near views.
            let scene = Scene { level: policy, pixel_error: 0.8, ..scene.clone() };
            let truth = self.truth(&scene, level, &exact);
            let what = format!("{:?}, {:?}, {name}, {policy:?}", self.mode, scene.sampling.filter);
            let draw = |scene: &Scene| self.oracle(scene);
            let expected = Expected::new(&scene, &draw);
            truth.assert_shown(&expected.exact, &format!("{what}, the oracle"));
            for (way, session) in &mut *sessions {
                if !draws(&format!("{what}, {}", self.speckled.scale), *way) {
                    continue;
                }
                let what = format!("{what}, {way:?}");
                let found = settled(session, &scene, SIZE).0;
                truth.assert_shown(&found, &what);
                expected.assert_shown(&found, &what);
            }
        }
    }

    /// Half of all views through filters.
    fn check_all(&self) {
        let scenes = self.speckled.scenes(self.mode);
        let mut sessions = self.sessions();
        let list = format!("extremes {:?} {}", self.mode, self.speckled.scale);
        for case in sampled(&list, scenes.len() * Filter::ALL.len(), 4) {
            let (name, scene) = &scenes[case % scenes.len()];
            let sampling = Sampling { filter: Filter::ALL[case / scenes.len()], ..Sampling::default() };
            self.check(&mut sessions, name, &Scene { sampling, ..scene.clone() });
        }
    }
}

#[test]
fn bytes_keep_their_extremes_at_every_level() {
    let speckled = Speckled::new(Extent::new(61, 53, 45), Geometry::default(), 255.0, false);
    Subject::new::<u8>(&speckled, Mode::Mip).check_all();
    Subject::new::<u8>(&speckled, Mode::MinIp).check_all();
}

#[test]
fn words_of_uneven_voxels_keep_their_extremes_at_every_level() {
    let geometry = Geometry { spacing: DVec3::new(0.5, 0.71, 2.1), ..Geometry::default() };
    let speckled = Speckled::new(Extent::new(70, 41, 21), geometry, 40_000.0, false);
    Subject::new::<u16>(&speckled, Mode::Mip).check_all();
    Subject::new::<u16>(&speckled, Mode::MinIp).check_all();
}

#[test]
fn floats_with_holes_keep_their_extremes_at_every_level() {
    let mut speckled = Speckled::new(Extent::new(47, 52, 40), Geometry::default(), 1e-3, true);
    // Far outside the window: slots hold floats.
    speckled.values[4711] = 1e9;
    Subject::new::<f32>(&speckled, Mode::Mip).check_all();
    Subject::new::<f32>(&speckled, Mode::MinIp).check_all();
}

/// The brightest and the darkest pixel of a picture without its background, and whether a warning about lost extremes was printed.
fn drawn(sandbox: &Sandbox, flags: &str) -> (Option<u8>, Option<u8>, bool) {
    let drawn = format!("render {flags} -o o.png --overwrite --transfer gray.json --size 64x48 --backend cpu");
    let (code, _, said) = sandbox.run(&drawn);
    assert_eq!(code, 0, "{drawn}: {said}");
    let picture = read_png(&sandbox.path("o.png"));
    let codes = || picture.rgb.iter().map(|p| p[0]).filter(|code| *code > 0);
    (codes().max(), codes().min(), said.contains("note: ") && said.contains("coarse level"))
}

/// By default a speck of 250 stays 250 at any level; a store that loses it causes a warning, and only then.
#[test]
fn specks_stay_or_it_is_said_that_they_may_not() {
    let sandbox = Sandbox::default();
    let extent = Extent::new(96, 80, 88);
    let specks = |[x, y, z]: [u32; 3]| match [x % 24, y % 20, z % 22] {
        [11, 7, 5] => 250.0,
        [3, 13, 17] => 2.0,
        _ => 60.0,
    };
    sandbox.write("gray.json", r#"{"color": [[0, 0, 0, 0], [255, 1, 1, 1]], "opacity": [[0, 1]], "unit_distance": 1}"#);
    sandbox.write("specks.raw", bytes_of(VoxelType::U8, extent, specks));
    let pack = |store: &str, flags: &str| {
        sandbox.run_ok(&format!(
            "pack specks.raw {store} --shape 96,80,88 --dtype u8 --brick 16 --shard 64 {flags} --progress none"
        ));
    };
    pack("default.zarr", "");
    pack("means.zarr", "--downsample mean");
    pack("minima.zarr", "--downsample mean,min");
    for level in 0..=3 {
        let drawn = |store: &str, mode: &str| drawn(&sandbox, &format!("{store}.zarr --mode {mode} --level {level}"));
        let is_coarse = level > 0;
        let (brightest, _, warns) = drawn("default", "mip");
        assert!(
            !warns && brightest.is_some_and(|code| if is_coarse { code == 250 } else { code > 60 }),
            "{brightest:?}"
        );
        let (brightest, _, warns) = drawn("means", "mip");
        assert_eq!(warns, is_coarse);
        assert!(!is_coarse || brightest.is_some_and(|code| code < 90), "level {level}: {brightest:?}");
        let (_, darkest, warns) = drawn("minima", "minip");
        assert!(!warns && (!is_coarse || darkest == Some(2)), "level {level}: {darkest:?}");
        assert_eq!(drawn("default", "minip").2, is_coarse);
        assert_eq!(drawn("minima", "mip").2, is_coarse);
        for mode in ["dvr", "average"] {
            assert!(!drawn("means", mode).2, "{mode} loses nothing that is promised");
        }
    }
    // Whatever the renderer.
    for way in ["--exact", "--compositor reference"] {
        for level in [0, 2] {
            let (_, _, warns) = drawn(&sandbox, &format!("means.zarr --mode mip --level {level} {way}"));
            assert_eq!(warns, level > 0, "{way}");
        }
    }
}

/// A bright layer just behind a cut, and a dark one, is hidden; for a locked coarse level a warning notes that it may show.
#[test]
fn what_is_cut_away_does_not_show() {
    let sandbox = Sandbox::default();
    let extent = Extent::new(64, 64, 128);
    sandbox.write("gray.json", r#"{"color": [[0, 0, 0, 0], [255, 1, 1, 1]], "opacity": [[0, 1]], "unit_distance": 1}"#);
    for (mode, kept, hidden, pyramids) in [("mip", 50.0, 255.0, "mean,max"), ("minip", 200.0, 1.0, "mean,min")] {
        let value = |[_, _, z]: [u32; 3]| if z == 102 { hidden } else { kept };
        sandbox.write("v.raw", bytes_of(VoxelType::U8, extent, value));
        sandbox.run_ok(&format!(
            "pack v.raw {mode}.zarr --shape 64,64,128 --dtype u8 --brick 16 --shard 64 --downsample {pyramids} --progress none"
        ));
        // Up to voxel 100, whose far side is 100.5.
        for cut in [
            "--volume 0:crop=0:64,0:64,0:101 --view +z",
            "--clip -1:65,-1:65,-1:100.5 --view +z",
            "--clip-plane 32,32,100.5:0,0,-1 --view +z",
            "--slice z=90 --thickness 21",
        ] {
            let line = format!("{mode}.zarr --mode {mode} {cut}");
            let exact = (Some(kept as u8), Some(kept as u8), false);
            assert_eq!(drawn(&sandbox, &line), exact, "{line}");
            assert!(drawn(&sandbox, &format!("{line} --level 2")).2, "{line}: it is said");
        }
    }
}

/// Every kind of pack gives images means and maxima, and labels the most frequent.
#[test]
fn all_that_pack_keep_maxima_of_images() {
    let sandbox = Sandbox::default();
    sandbox.write("a.raw", bytes_of(VoxelType::U8, Extent::new(20, 20, 20), |[x, y, z]| f64::from(x + y + z)));
    let raw = "a.raw --shape 20,20,20 --dtype u8 --progress none";
    let of_raw = |command: &str| raw.replace("a.raw", command);
    for (store, command, expected) in [
        ("packed.zarr", of_raw("pack a.raw packed.zarr"), "mean,max"),
        ("labels.zarr", of_raw("pack a.raw labels.zarr --kind labels"), "mode"),
        ("grown.zarr", of_raw("append grown.zarr a.raw"), "mean,max"),
        ("made.zarr", "synth ct made.zarr --shape 20,20,20 --progress none".into(), "mean,max"),
        ("plain.zarr", of_raw("append plain.zarr a.raw --downsample mean"), "mean"),
    ] {
        sandbox.run_ok(&command);
        assert_eq!(sandbox.json(&format!("info {store} --json"))["store"]["downsample"], expected, "{store}");
        sandbox.run_ok(&format!("verify {store}"));
    }
    // A further step follows the store, whatever the default.
    sandbox.run_ok(&of_raw("append plain.zarr a.raw"));
    assert_eq!(sandbox.json("info plain.zarr --json")["store"]["downsample"], "mean");
}
