//! Random scenes against the oracle: voxels of every type, smooth, few-valued, masks or masks with one outlier; windows of one code to all of them;
//! every mode, method, filter, light, with surfaces, cuts and caps; by every way to draw. Most of a thousand are left to `--all`.

use brickyard::backend::CompositorChoice;
use brickyard::session::Session;
use brickyard::volume::{
    Camera, ClipPlane, Extent, Filter, Geometry, Gradient, Isosurface, Jitter, LevelPolicy, Lighting, LightingModel,
    Method, Mode, Picture, Projection, Sampling, Scene, SceneLayer, TransferChoice, TransferFunction, Voxel, VoxelType,
};
use brickyard_tests::sample::{sampled, seed};
use brickyard_tests::{FunctionSource, Random, TestStore, WAYS, Way, oracle, session, settled};
use glam::DVec3;

const SCENES: usize = 1000;
const SIZE: (u32, u32) = (24, 20);
const EXTENT: Extent = Extent::new(36, 29, 40);

const TYPES: [VoxelType; 7] =
    [VoxelType::U8, VoxelType::I8, VoxelType::U16, VoxelType::I16, VoxelType::U32, VoxelType::I32, VoxelType::F32];

/// The content of a volume's voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Content {
    /// Waves over all values of the type, or over a range of float and 32-bit integer values.
    Smooth,
    /// Waves over a few whole numbers.
    Counts,
    /// 0 and 1.
    Mask,
    /// 0 and 1, and the greatest of the smooth values once.
    Outlier,
}

const CONTENTS: [Content; 4] = [Content::Smooth, Content::Counts, Content::Mask, Content::Outlier];

/// Least and greatest value of smooth voxels of a type.
fn smooth_range(voxel_type: VoxelType) -> (f64, f64) {
    match voxel_type {
        VoxelType::U32 => (3e9, 3.001e9),
        VoxelType::I32 => (-5e6, 5e6),
        VoxelType::F32 => (-3.5, 7.25),
        narrow => narrow.limits(),
    }
}

fn outlier(voxel_type: VoxelType) -> f64 {
    if voxel_type == VoxelType::F32 { 1e5 } else { smooth_range(voxel_type).1 }
}

fn value(voxel_type: VoxelType, content: Content, at: [u32; 3]) -> f64 {
    let [x, y, z] = at.map(f64::from);
    let wave = 0.5 + 0.25 * (0.31 * x + 0.17 * y).sin() + 0.24 * (0.23 * y - 0.27 * z).cos();
    let (low, high) = smooth_range(voxel_type);
    match content {
        Content::Smooth => low + (high - low) * wave,
        Content::Counts => (7.0 * wave).floor(),
        Content::Outlier if at == [19, 14, 20] => outlier(voxel_type),
        Content::Mask | Content::Outlier => f64::from(u8::from(wave > 0.5)),
    }
}

fn pack(voxel_type: VoxelType, content: Content) -> TestStore {
    fn of<T: Voxel>(voxel_type: VoxelType, content: Content) -> TestStore {
        let geometry = geometry();
        let voxel = move |_, _, at| T::from_f64_rounded(value(voxel_type, content, at));
        TestStore::pack(&FunctionSource::new(EXTENT, geometry, voxel), 16)
    }
    match voxel_type {
        VoxelType::U8 => of::<u8>(voxel_type, content),
        VoxelType::I8 => of::<i8>(voxel_type, content),
        VoxelType::U16 => of::<u16>(voxel_type, content),
        VoxelType::I16 => of::<i16>(voxel_type, content),
        VoxelType::U32 => of::<u32>(voxel_type, content),
        VoxelType::I32 => of::<i32>(voxel_type, content),
        VoxelType::F32 => of::<f32>(voxel_type, content),
    }
}

/// Random choices for a scene.
struct Choice(Random);

impl Choice {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.unit()
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.0.bits() % all.len() as u64) as usize]
    }

    fn is(&mut self, share: f64) -> bool {
        self.0.unit() < share
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| self.between(-1.0, 1.0)))
    }

    /// A window of 1 to 65,536 codes, somewhere among the values.
    fn window(&mut self, voxel_type: VoxelType, content: Content, (mode, filter): (Mode, Filter)) -> [f64; 2] {
        let (low, high) = match content {
            Content::Smooth => smooth_range(voxel_type),
            Content::Counts => (0.0, 6.0),
            Content::Mask | Content::Outlier => (0.0, 1.0),
        };
        let code = if voxel_type.bytes() <= 2 { 1.0 } else { (high - low) / 65535.0 };
        let most = (high - low).max(1.0);
        // Where neighbouring voxels differ by 4,096 windows, the rounding of a sample's place is a hundredth of a window.
        let least = match content {
            Content::Smooth => 0.0,
            // Slots hold values up to some hundred million windows away: means are correct for these, and splines where they hardly reach.
            Content::Outlier if mode == Mode::Average || filter == Filter::Tricubic => {
                (outlier(voxel_type) / 1e8).max(most / 4096.0)
            }
            Content::Counts | Content::Mask | Content::Outlier => most / 4096.0,
        };
        let width = (code * self.between(0.0, 16.0).exp2()).clamp(least, most.max(least));
        let from = low + (high - low - width) * self.0.unit();
        [from, from + width]
    }

    fn function(&mut self, [low, high]: [f64; 2]) -> TransferFunction {
        let at = |share: f64| low + (high - low) * share;
        let color = |choice: &mut Self, share: f64| {
            let [r, g, b] = [0; 3].map(|_| choice.0.unit());
            [at(share), r, g, b]
        };
        let peak = self.between(0.3, 0.7);
        let opacity = match self.of(&[0, 1, 2]) {
            0 => vec![[at(0.0), 0.0], [at(1.0), self.between(0.2, 1.0)]],
            1 => vec![[at(0.0), 0.0], [at(peak), self.between(0.2, 0.9)], [at(1.0), 0.0]],
            _ => vec![[at(0.0), self.between(0.1, 0.5)], [at(peak), 0.0], [at(1.0), self.between(0.1, 0.5)]],
        };
        TransferFunction {
            color: vec![color(self, 0.0), color(self, peak), color(self, 1.0)],
            opacity,
            unit_distance: self.between(0.7, 3.0),
            ..TransferFunction::default()
        }
    }

    fn scene(&mut self, voxel_type: VoxelType, content: Content) -> Scene {
        let mode = self.of(&[Mode::Dvr, Mode::Dvr, Mode::Dvr, Mode::Mip, Mode::MinIp, Mode::Average, Mode::Isosurface]);
        let filter = self.of(&[Filter::Trilinear, Filter::Trilinear, Filter::Nearest, Filter::Tricubic]);
        let window = self.window(voxel_type, content, (mode, filter));
        let isovalue = |choice: &mut Self| {
            let value = choice.between(window[0], window[1]);
            let opacity = if choice.is(0.5) { 1.0 } else { choice.between(0.2, 0.9) };
            Isosurface { opacity, ..Isosurface::at(value) }
        };
        let surfaces = match mode {
            Mode::Isosurface => 1 + usize::from(self.is(0.4)),
            Mode::Dvr => usize::from(self.is(0.3)),
            Mode::Mip | Mode::MinIp | Mode::Average => 0,
        };
        let isosurfaces = (0..surfaces).map(|_| isovalue(self)).collect();
        let (low, high) = geometry().world_box(EXTENT);
        let (middle, size) = (0.5 * (low + high), high - low);
        let plane = |choice: &mut Self| ClipPlane {
            point: middle + 0.2 * size * choice.vector(),
            normal: choice.vector() + DVec3::new(0.01, 0.02, 0.03),
        };
        let planes = if self.is(0.3) { 1 } else { 0 };
        let is_lit = matches!(mode, Mode::Dvr | Mode::Isosurface) && (surfaces > 0 || self.is(0.4));
        let model = self.of(&[LightingModel::Phong, LightingModel::BlinnPhong, LightingModel::Tone]);
        let method = if mode == Mode::Dvr { self.of(&Method::ALL) } else { Method::Udvr };
        let eye = middle + (self.vector() + DVec3::new(0.1, -1.3, 0.2)).normalize() * size.length() * 1.3;
        Scene {
            camera: Some(Camera {
                eye,
                target: middle,
                up: DVec3::new(0.1, 0.2, 1.0),
                projection: Projection::Perspective { fov_y_deg: 32.0 },
            }),
            mode,
            sampling: Sampling {
                method,
                virtual_samples: self.of(&[1, 3]),
                filter,
                jitter: self.of(&[Jitter::None, Jitter::None, Jitter::Blue]),
            },
            lighting: match is_lit && self.is(0.7) {
                true => {
                    Lighting { model, gradient: self.of(&[Gradient::Central, Gradient::Sobel]), lights: Vec::new() }
                }
                false => Lighting::default(),
            },
            // Segments sampled at their ends reach out of bricks' aprons if they are longer.
            step: if method == Method::Udvr && surfaces == 0 { self.of(&[0.5, 0.8, 1.0]) } else { 0.4 },
            background: [0.1, 0.0, 0.2],
            clip_planes: (0..planes).map(|_| plane(self)).collect(),
            caps: self.of(&[None, Some(true), Some(false)]),
            layers: vec![SceneLayer { isosurfaces, ..self.function(window).into() }],
            ..Scene::default()
        }
    }
}

/// A store, its content, and its sessions.
struct Stage {
    voxel_type: VoxelType,
    content: Content,
    test: TestStore,
    sessions: Vec<(Way, Option<Session>)>,
}

/// The number of pixels more than 1/255 outside the range of the expected ones.
fn pixels_off(found: &Picture, expected: &[Picture]) -> usize {
    let is_off = |&at: &usize| {
        (0..3).any(|k| {
            let all = || expected.iter().map(|picture| picture.rgb[at][k]);
            let (least, most) = (all().min().expect("a picture"), all().max().expect("a picture"));
            found.rgb[at][k] < least.saturating_sub(1) || found.rgb[at][k] > most.saturating_add(1)
        })
    };
    (0..found.rgb.len()).filter(is_off).count()
}

/// The scene from eyes as far apart as 32-bit rounding may move a sample, and with surfaces as far apart as codes may round a value: rounding decides
/// for rays that graze a surface, and for voxels with its value.
fn within_rounding(scene: &Scene) -> Vec<Scene> {
    let camera = scene.camera.expect("a camera");
    let geometry = geometry();
    let slack = geometry.rounding_voxels(camera.eye, EXTENT);
    let seen_from = |offset: DVec3| {
        let offset = offset * geometry.spacing;
        let camera = Camera { eye: camera.eye + offset, target: camera.target + offset, ..camera };
        Scene { camera: Some(camera), ..scene.clone() }
    };
    // Half a code, at most a 510th of the window. A session may keep finer slots of an earlier window.
    let Some(TransferChoice::Function(function)) = &scene.layers[0].transfer else { panic!("a function") };
    let half_code = (function.color[function.color.len() - 1][0] - function.color[0][0]) / 1020.0;
    let with_surfaces = |offset: f64| {
        let mut scene = scene.clone();
        scene.layers[0].isosurfaces.iter_mut().for_each(|surface| surface.value += offset);
        scene
    };
    let sides = DVec3::AXES.into_iter().flat_map(|axis| [-slack * axis, slack * axis]);
    sides.map(seen_from).chain([-half_code, 0.0, half_code].map(with_surfaces)).collect()
}

fn geometry() -> Geometry {
    Geometry { spacing: DVec3::new(1.0, 1.2, 0.9), ..Geometry::default() }
}

#[test]
fn scenes_at_random_are_the_oracle_s() {
    let mut chosen: Vec<(usize, usize)> =
        sampled("random scenes", SCENES, 40).into_iter().map(|i| (i % (TYPES.len() * CONTENTS.len()), i)).collect();
    chosen.sort_unstable();
    let (mut wrong, mut flat) = (Vec::new(), 0);
    for group in chosen.chunk_by(|a, b| a.0 == b.0) {
        let (voxel_type, content) = (TYPES[group[0].0 % TYPES.len()], CONTENTS[group[0].0 / TYPES.len()]);
        let test = pack(voxel_type, content);
        let mut stage = Stage { voxel_type, content, test, sessions: WAYS.map(|way| (way, None)).into() };
        for &(_, i) in group {
            let (is_flat, problem) = stage.check(i);
            flat += usize::from(is_flat);
            wrong.extend(problem);
        }
    }
    assert!(3 * flat < chosen.len(), "{flat} of {} pictures show nothing", chosen.len());
    assert!(wrong.is_empty(), "{} of {} scenes:\n{}", wrong.len(), chosen.len(), wrong.join("\n"));
}

impl Stage {
    /// Draws the `i`th scene in one way. Returns whether it is blank, and its error, if any.
    fn check(&mut self, i: usize) -> (bool, Option<String>) {
        let mut choice = Choice(Random(seed() ^ (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)));
        let mut scene = choice.scene(self.voxel_type, self.content);
        let (way, drawn) = &mut self.sessions[(choice.0.bits() % WAYS.len() as u64) as usize];
        // Where levels meet, cells of `sorted` do not always have a ray's side of a surface.
        if way.1 == CompositorChoice::Sorted && !scene.layers[0].isosurfaces.is_empty() {
            scene.level = LevelPolicy::Locked(0);
        }
        if drawn.is_none() {
            *drawn = session(&self.test.store, *way);
        }
        let what = format!("scene {i}, seed {:x}, {} {:?} by {way:?}", seed(), self.voxel_type, self.content);
        let Some(session) = drawn else { return (false, None) };
        let (found, _) = settled(session, &scene, SIZE);
        let expected = oracle(&self.test.store, &scene, SIZE);
        let is_flat = expected.rgb.iter().all(|pixel| *pixel == expected.rgb[0]);
        // The contract of renderers.
        let difference = found.difference(&expected);
        if pixels_off(&found, std::slice::from_ref(&expected)) == 0 || difference.psnr_db >= 50.0 {
            return (is_flat, None);
        }
        let alike =
            within_rounding(&scene).iter().map(|scene| oracle(&self.test.store, scene, SIZE)).collect::<Vec<_>>();
        let off = pixels_off(&found, &alike);
        let scene = || serde_json::to_string(&scene).expect("a scene");
        (is_flat, (off > 0).then(|| format!("{what}: {off} pixels, {difference:?}\n  {}", scene())))
    }
}
