use super::*;
use crate::session::resolve;
use brickyard_pager::{BrickError, BrickSource};
use brickyard_volume::{
    BrickId, Camera, Extent, Geometry, Isosurface, Mode, Projection, Pyramid, SceneExpression, SceneLayer, Stereo,
    StereoLayout, TransferChoice, VoxelType,
};
use std::sync::Arc;

/// Volumes of zeros, 16 x 24 x 32 millimetres, with this range of values.
struct Nothing {
    pyramid: Pyramid,
    geometry: Geometry,
    values: (f64, f64),
    are_labels: bool,
}

impl BrickSource for Nothing {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }
    fn voxel_type(&self) -> VoxelType {
        if self.are_labels { VoxelType::U8 } else { VoxelType::F32 }
    }
    fn value_range(&self) -> (f64, f64) {
        self.values
    }
    fn is_labels(&self) -> bool {
        self.are_labels
    }
    fn times(&self) -> u32 {
        1
    }
    fn channels(&self) -> u32 {
        1
    }
    fn read_core(&self, _: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        out.fill(0);
        Ok(())
    }
}

fn volume(values: (f64, f64), are_labels: bool) -> VolumeSource {
    let pyramid = Pyramid::new(Extent::from_array([16, 24, 32]), [1.0; 3], 8);
    let geometry = Geometry { unit: Some("millimeter".into()), ..Geometry::default() };
    VolumeSource::new(Arc::new(Nothing { pyramid, geometry, values, are_labels }))
}

/// Creates a scene of one volume, seen along z: a pixel is 0.125 units in a picture 320 pixels high.
fn scene() -> Scene {
    let target = DVec3::new(8.0, 12.0, 16.0);
    let projection = Projection::Orthographic { height: 40.0 };
    let camera = Camera { eye: target - 100.0 * DVec3::Z, target, up: DVec3::NEG_Y, projection };
    Scene { camera: Some(camera), ..Scene::of(SceneLayer::default()) }
}

const SIZE_PX: (u32, u32) = (480, 320);

/// Creates a picture with gray in these pixels, and black elsewhere.
fn picture(shows: impl Fn(u32, u32) -> bool) -> Picture {
    let (width, height) = SIZE_PX;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    Picture { width, height, rgb: pixels.map(|(x, y)| if shows(x, y) { [90; 3] } else { [0; 3] }).collect() }
}

fn changed(overlays: &Overlays, scene: &Scene, shows: impl Fn(u32, u32) -> bool) -> Vec<(u32, u32)> {
    let before = picture(shows);
    let mut drawn = before.clone();
    overlays.draw(&mut drawn, scene, &[volume((0.0, 1.0), false)]).unwrap();
    let pixels = (0..SIZE_PX.1).flat_map(|y| (0..SIZE_PX.0).map(move |x| (x, y)));
    pixels.filter(|&(x, y)| drawn.pixel(x, y) != before.pixel(x, y)).collect()
}

#[test]
fn each_part_is_drawn_where_it_hides_least() {
    for part in [
        Overlays { scale_bar: true, ..Overlays::default() },
        Overlays { color_bar: true, ..Overlays::default() },
        Overlays { label: Some("cell 12".into()), ..Overlays::default() },
    ] {
        let free = changed(&part, &scene(), |_, _| false);
        assert!(free.len() > 60, "{part:?}: {}", free.len());
        // Its default place is occupied, and all but one of the other corners.
        for (left, top) in [(false, false), (false, true), (true, false), (true, true)] {
            let is_free = |x: u32, y: u32| (x < 230) == left && if top { y < 190 } else { y >= 130 };
            let found = changed(&part, &scene(), |x, y| !is_free(x, y));
            assert!(found.iter().all(|&(x, y)| is_free(x, y)), "{part:?} {left} {top}: {found:?}");
        }
    }
}

#[test]
fn parts_do_not_lie_over_one_another() {
    let all = Overlays { scale_bar: true, color_bar: true, axes: false, label: Some("one, two".into()) };
    let parts = [
        Overlays { scale_bar: true, ..Overlays::default() },
        Overlays { color_bar: true, ..Overlays::default() },
        Overlays { label: all.label.clone(), ..Overlays::default() },
    ];
    // Nothing, the left or the right half is free.
    for (from, to) in [(0, 0), (0, 240), (240, 480)] {
        let shows = |x: u32, _| !(from..to).contains(&x);
        let apart: usize = parts.iter().map(|part| changed(part, &scene(), shows).len()).sum();
        let together = changed(&all, &scene(), shows).len();
        assert!((together as f64 / apart as f64 - 1.0).abs() < 0.05, "{from}: {together} {apart}");
    }
}

#[test]
fn a_scale_bar_is_as_long_as_it_says() {
    let canvas_px = picture(|_, _| false);
    let mut drawn = canvas_px.clone();
    let overlays = Overlays { scale_bar: true, ..Overlays::default() };
    overlays.draw(&mut drawn, &scene(), &[volume((0.0, 1.0), false)]).unwrap();
    // A quarter of 480 pixels is 15 units: 10 of them are 80 pixels, white in the row of the bar.
    let is_white = |x: &u32, y: u32| drawn.pixel(*x, y)[0] > 200;
    let longest = (0..320).map(|y| (0..480).filter(|x| is_white(x, y)).count()).max();
    assert!(matches!(longest, Some(79..=81)), "{longest:?}");
}

#[test]
fn edges_of_the_box_hide_nothing() {
    let axes = Overlays { axes: true, ..Overlays::default() };
    // Seen from a corner: three edges are behind the contents of the box and three in front of them.
    let target = DVec3::new(8.0, 12.0, 16.0);
    let camera = Camera { eye: target + 100.0 * DVec3::new(1.0, 1.2, 0.9), target, ..scene().camera.unwrap() };
    let scene = Scene { camera: Some(Camera { up: DVec3::Z, ..camera }), ..scene() };
    let [x, y] = scene.camera.unwrap().rays(SIZE_PX.0, SIZE_PX.1).unwrap().pixel(target).unwrap();
    let near_middle = |&&(px, py): &&(u32, u32)| (f64::from(px) - x).hypot(f64::from(py) - y) < 24.0;
    let over_nothing = changed(&axes, &scene, |_, _| false);
    assert!(over_nothing.iter().filter(near_middle).count() > 12, "edges behind are seen through nothing");
    let over_all = changed(&axes, &scene, |_, _| true);
    assert_eq!(over_all.iter().filter(near_middle).count(), 0, "edges before are not drawn");
    let brightest_over = |haze: u8| {
        let mut drawn = picture(|_, _| false);
        drawn.rgb.fill([haze; 3]);
        axes.draw(&mut drawn, &scene, &[volume((0.0, 1.0), false)]).unwrap();
        over_nothing.iter().filter(near_middle).map(|&(x, y)| drawn.pixel(x, y)[0]).max().unwrap()
    };
    let [clear, thin, thick] = [0, 4, 12].map(brightest_over);
    assert!(clear > thin && thin > thick && thick > 12, "through haze: {clear} {thin} {thick}");
    assert!(over_all.len() > 300, "edges at the border, and ticks");
}

#[test]
fn bars_have_the_colours_of_their_values() {
    let mut drawn = picture(|_, _| false);
    let transfer = Some(TransferChoice::preset("viridis"));
    let layer = SceneLayer { transfer, window: Some([10.0, 20.0]), ..SceneLayer::default() };
    let scene = Scene { layers: vec![layer], ..scene() };
    let volumes = [volume((0.0, 50.0), false)];
    let overlays = Overlays { color_bar: true, ..Overlays::default() };
    overlays.draw(&mut drawn, &scene, &volumes).unwrap();
    let function = volumes[0].function(&scene.layers[0]).unwrap();
    // The bar's middle column: the one with most colours.
    let column = |x: u32| (0..320).map(move |y| (x, y));
    let is_colored = |[r, g, b]: &[u8; 3]| r.abs_diff(*g).max(g.abs_diff(*b)) > 20;
    let colors = |x: u32| column(x).map(|(x, y)| drawn.pixel(x, y)).filter(is_colored).count();
    let x = (0..480).max_by_key(|x| colors(*x)).unwrap();
    let bar: Vec<_> = column(x).map(|(x, y)| drawn.pixel(x, y)).skip_while(|pixel| !is_colored(pixel)).collect();
    for (value, part) in [(19.5, 0.05), (15.0, 0.5), (12.0, 0.8)] {
        let found = bar[(part * colors(x) as f64) as usize];
        let expected = function.rgb(value).map(|c| (c * 255.0).round());
        // A band is a sixty-fourth of the bar.
        let differs = (0..3).map(|i| (f64::from(found[i]) - expected[i]).abs()).fold(0.0, f64::max);
        assert!(differs < 24.0, "{value}: {found:?} for {expected:?}");
    }
}

#[test]
fn each_layer_of_values_has_a_bar_whose_ticks_differ() {
    for (offset, scale) in [(0.0, 255.0), (1e9, 2000.0), (-1e12, 8.0), (0.0, 1e-6), (3e-5, 1e-9)] {
        let window = Some([offset - scale, offset + scale]);
        let layer = SceneLayer { source: Some(0), window, ..SceneLayer::default() };
        let hidden = SceneLayer { visible: false, ..layer.clone() };
        let of_labels = SceneLayer { source: Some(1), ..SceneLayer::default() };
        let brighter = SceneLayer { window: Some([offset - scale, offset]), ..layer.clone() };
        let layers = vec![layer.clone(), hidden, layer, brighter, of_labels];
        let scene = Scene { layers, ..Scene::default() };
        let bars = color_bar::bars(&scene, &[volume((0.0, 255.0), false), volume((0.0, 255.0), true)]);
        assert_eq!(bars.iter().map(|bar| bar.title()).collect::<Vec<_>>(), ["layer 0 +1", "layer 3"]);
        let mut texts: Vec<&str> = bars[0].ticks.iter().map(|(_, text)| text.as_str()).collect();
        assert!(texts.len() > 2, "{texts:?}");
        texts.dedup();
        assert_eq!(texts.len(), bars[0].ticks.len(), "{texts:?}");
    }
}

#[test]
fn an_expression_has_one_bar_and_surfaces_with_colours_none() {
    let volumes = [volume((0.0, 1.0), false)];
    let function = volumes[0].function(&SceneLayer::default()).unwrap();
    let expression = SceneExpression { text: "a * 2".into(), transfer: Some(function.into()) };
    let scene = Scene { expression: Some(expression), ..scene() };
    assert_eq!(color_bar::bars(&scene, &volumes).len(), 1);
    let surface = |color| Isosurface { value: 0.5, color, opacity: 1.0 };
    for (surfaces, count) in [(vec![surface(None)], 1), (vec![surface(Some([1.0, 0.0, 0.0]))], 0)] {
        let layers = vec![SceneLayer { isosurfaces: surfaces, ..SceneLayer::default() }];
        let scene = Scene { mode: Mode::Isosurface, layers, ..Scene::default() };
        assert_eq!(color_bar::bars(&scene, &volumes).len(), count);
    }
}

#[test]
fn long_names_lack_their_middle() {
    assert_eq!(short_name("sub-01_ses-02_T1w", 17), "sub-01_ses-02_T1w");
    assert_eq!(short_name("sub-01_ses-02_T1w", 16), "sub-01_s\u{2026}-02_T1w");
    assert_eq!(short_name("\u{e9}\u{e8}\u{ea}\u{eb}", 3), "\u{e9}\u{2026}\u{eb}");
}

/// The window of the bar's function is the drawn one, whether set in the scene or left open as in a window.
#[test]
fn an_expression_s_bar_has_the_window_that_is_drawn() {
    let volumes = [volume((0.0, 2.0), false), volume((0.0, 4.0), false)];
    for (text, window) in [("a - b", (-4.0, 2.0)), ("b * 2", (0.0, 8.0)), ("0 - b", (-4.0, 0.0))] {
        for transfer in [None, Some(TransferChoice::preset("viridis"))] {
            let expression = SceneExpression { text: text.into(), transfer };
            let layers = vec![SceneLayer::default(); 2];
            let scene = Scene { expression: Some(expression), layers, ..scene() };
            let resolved = resolve(&volumes, &scene, SIZE_PX).unwrap();
            let drawn = &resolved.combination.as_ref().unwrap().transfer;
            for scene in [&scene, &resolved.shown(&scene)] {
                let bars = color_bar::bars(scene, &volumes);
                assert_eq!(&bars[0].function, drawn, "{text}");
            }
            assert_eq!(drawn.span(), window, "{text}");
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_before_anything_is_drawn() {
    let label = |text: &str| Overlays { label: Some(text.into()), ..Overlays::default() };
    let stereo = Scene { stereo: Some(Stereo::new(StereoLayout::SideBySide)), ..scene() };
    for (overlays, scene, size_px, expected) in [
        (label("a"), scene(), (95, 200), OverlayError::TooSmall { width: 95, height: 200 }),
        (label("\u{6f22}"), scene(), SIZE_PX, OverlayError::Letter('\u{6f22}')),
        (label("a"), stereo.clone(), SIZE_PX, OverlayError::Stereo),
    ] {
        assert_eq!(overlays.check(&scene, size_px), Err(expected));
    }
    assert_eq!(label("Gr\u{f6}\u{df}e 4 \u{b5}m, \u{3b1} \u{2264} 1").check(&scene(), SIZE_PX), Ok(()));
    assert_eq!(Overlays::default().check(&stereo, (1, 1)), Ok(()));
    assert!(changed(&Overlays::default(), &scene(), |_, _| true).is_empty());
}
