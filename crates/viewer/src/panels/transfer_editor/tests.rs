use super::*;
use crate::keeping::write_json;
use crate::panels::fixture;
use brickyard::volume::{Region, Scene, Shape};
use eframe::egui::{Event, PointerButton, Pos2, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

type Edited = (SceneLayer, Vec<SavedFunction>);

fn harness<'a>(layer: SceneLayer) -> Harness<'a, Edited> {
    let (volume, histogram) = (fixture::volumes().swap_remove(0), fixture::histogram());
    let show = move |ui: &mut Ui, (layer, saved): &mut Edited| {
        let counts = Counts { histogram: Some(&histogram), unit: None };
        edit(ui, layer, &volume, counts, saved);
    };
    // Fine time steps, so that two clicks can follow each other at once.
    let builder = Harness::builder().with_size(vec2(276.0, 360.0)).with_step_dt(0.02).with_max_steps(200);
    builder.build_ui_state(show, (layer, Vec::new()))
}

/// A ramp of three points over all values of the fixture.
fn ramp() -> SceneLayer {
    let function = TransferFunction {
        color: vec![[0.0, 0.0, 0.0, 1.0], [255.0, 1.0, 0.0, 0.0]],
        opacity: vec![[0.0, 0.0], [100.0, 0.5], [255.0, 1.0]],
        ..TransferFunction::default()
    };
    function.into()
}

fn function(harness: &Harness<'_, Edited>) -> TransferFunction {
    let volumes = fixture::volumes();
    let layer = harness.state().0.clone();
    fixture::check(&Scene::of(layer.clone()), &volumes);
    volumes[0].function(&layer).expect("a valid function")
}

fn place(harness: &Harness<'_, Edited>, value: f64, alpha: f64) -> Pos2 {
    let inner = harness.get_by_label("opacity curve").rect().shrink(6.0);
    pos2(inner.left() + inner.width() * (value / 255.0) as f32, inner.bottom() - inner.height() * alpha as f32)
}

fn drag(harness: &mut Harness<'_, Edited>, from: Pos2, to: Pos2) {
    harness.drag_at(from);
    harness.run();
    harness.hover_at(from.lerp(to, 0.5));
    harness.run();
    harness.hover_at(to);
    harness.run();
    harness.drop_at(to);
    harness.run();
}

fn click(harness: &mut Harness<'_, Edited>, at: Pos2, button: PointerButton) {
    harness.hover_at(at);
    for pressed in [true, false] {
        harness.event(Event::PointerButton { pos: at, button, pressed, modifiers: Modifiers::NONE });
    }
    harness.run();
}

fn double_click(harness: &mut Harness<'_, Edited>, at: Pos2) {
    // Earlier clicks are long past.
    harness.run_steps(50);
    harness.hover_at(at);
    for pressed in [true, false, true, false] {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        harness.event(Event::PointerButton { pos: at, button, pressed, modifiers });
        harness.run_steps(1);
    }
    harness.run();
}

#[test]
fn looking_at_a_function_leaves_it_alone() {
    for layer in [ramp(), SceneLayer::default(), TransferFunction::preset("turbo", (0.0, 9.0), 1.0).unwrap().into()] {
        let mut harness = harness(layer.clone());
        harness.run();
        assert_eq!(harness.state().0, layer);
    }
}

#[test]
fn a_point_goes_where_it_is_dragged_and_no_farther_than_its_neighbours() {
    let mut harness = harness(ramp());
    let (from, to) = (place(&harness, 100.0, 0.5), place(&harness, 180.0, 0.2));
    drag(&mut harness, from, to);
    let [value, alpha] = function(&harness).opacity[1];
    assert!((value - 180.0).abs() < 2.0 && (alpha - 0.2).abs() < 0.02, "{value} {alpha}");
    let (from, to) = (place(&harness, value, alpha), place(&harness, 400.0, 3.0));
    drag(&mut harness, from, to);
    let [value, alpha] = function(&harness).opacity[1];
    assert!((value - (255.0 - 255.0 / 400.0)).abs() < 1e-9 && alpha == 1.0, "{value} {alpha}");
}

#[test]
fn points_are_added_and_removed() {
    let mut harness = harness(ramp());
    // On the curve a single click will do.
    let on_curve = place(&harness, 50.0, 0.25);
    click(&mut harness, on_curve, PointerButton::Primary);
    let added = function(&harness).opacity;
    assert!(added.len() == 4 && (added[1][0] - 50.0).abs() < 2.0 && (added[1][1] - 0.25).abs() < 0.01, "{added:?}");
    // Elsewhere it takes two.
    let aside = place(&harness, 200.0, 0.1);
    harness.run_steps(50);
    click(&mut harness, aside, PointerButton::Primary);
    assert_eq!(function(&harness).opacity.len(), 4);
    double_click(&mut harness, aside);
    let added = function(&harness).opacity;
    assert!(added.len() == 5 && (added[3][1] - 0.1).abs() < 0.02, "{added:?}");
    click(&mut harness, aside, PointerButton::Secondary);
    assert_eq!(function(&harness).opacity.len(), 4);
    click(&mut harness, on_curve, PointerButton::Primary);
    harness.key_press(Key::Delete);
    harness.run();
    assert_eq!(function(&harness).opacity, [[0.0, 0.0], [100.0, 0.5], [255.0, 1.0]]);
}

#[test]
fn arrow_keys_move_what_is_selected() {
    let mut harness = harness(ramp());
    let point = place(&harness, 100.0, 0.5);
    click(&mut harness, point, PointerButton::Primary);
    for key in [Key::ArrowRight, Key::ArrowUp, Key::ArrowUp] {
        harness.key_press(key);
        harness.run();
    }
    let [value, alpha] = function(&harness).opacity[1];
    assert!((value - 100.0 - 255.0 / 400.0).abs() < 1e-9 && (alpha - 0.52).abs() < 1e-9, "{value} {alpha}");
}

#[test]
fn the_first_edit_of_a_preset_writes_it_out_as_it_looks() {
    let layer = SceneLayer {
        transfer: Some(TransferChoice::preset("viridis")),
        window: Some([50.0, 200.0]),
        gamma: 0.5,
        ..SceneLayer::default()
    };
    let before = fixture::volumes()[0].function(&layer).expect("a function");
    let mut harness = harness(layer);
    let last = place(&harness, 200.0, 0.5);
    drag(&mut harness, last, last - vec2(0.0, 20.0));
    let after = function(&harness);
    let layer = &harness.state().0;
    assert!(matches!(layer.transfer, Some(TransferChoice::Function(_))));
    assert_eq!((layer.window, layer.gamma, layer.color), (None, 1.0, None));
    for value in 0..=255 {
        assert_eq!(after.rgb(f64::from(value)), before.rgb(f64::from(value)), "{value}");
    }
    let first = before.opacity.len() - 2;
    assert_eq!(after.opacity[..=first], before.opacity[..=first]);
    assert!(after.opacity[first + 1][1] > 0.6, "{:?}", after.opacity[first + 1]);
}

#[test]
fn a_colour_point_is_added_where_the_strip_has_that_colour() {
    let mut harness = harness(ramp());
    let strip = harness.get_by_label("colour points").rect();
    let middle = pos2(strip.center().x, strip.top() + 8.0);
    double_click(&mut harness, middle);
    let color = function(&harness).color;
    assert_eq!(color.len(), 3);
    assert!((color[1][1] - 0.5).abs() < 0.01 && (color[1][3] - 0.5).abs() < 0.01, "{color:?}");
    drag(&mut harness, middle, middle + vec2(40.0, 0.0));
    let moved = function(&harness).color;
    assert!(moved[1][0] > color[1][0] + 30.0 && moved[1][1..] == color[1][1..], "{moved:?}");
}

/// After any input the scene can be shown.
#[test]
fn a_wild_hand_leaves_a_valid_function() {
    // Numbers of a fixed sequence, in 0..1.
    let mut seed = 12345u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 24) as f32
    };
    for preset in ["gray", "viridis", "ct-angio"] {
        let mut harness =
            harness(SceneLayer { transfer: Some(TransferChoice::preset(preset)), ..SceneLayer::default() });
        let rect = harness.get_by_label("opacity curve").rect().union(harness.get_by_label("colour points").rect());
        for _ in 0..60 {
            let mut place = || rect.min + vec2(rect.width() * random(), rect.height() * random());
            let (from, to) = (place(), place() + vec2(40.0, 40.0));
            let deed = random();
            if deed < 0.5 {
                drag(&mut harness, from, to);
            } else if deed < 0.6 {
                click(&mut harness, from, PointerButton::Secondary);
            } else if deed < 0.7 {
                harness.key_press(Key::Delete);
                harness.run();
            } else {
                double_click(&mut harness, from);
            }
            function(&harness).validate().expect("a valid function");
        }
    }
}

#[test]
fn what_is_saved_is_loaded_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("ramp.json");
    let mut harness = harness(ramp());
    harness.get_by_label("save").click();
    harness.run();
    let (name, saved) = harness.state().1[0].clone();
    assert_eq!(name, Path::new("transfer.json"));
    write_json(&path, &saved).expect("written");
    let volume = fixture::volumes().swap_remove(0);
    let mut layer = SceneLayer::default();
    assert_eq!(load(&mut layer, &volume, &path), Ok(String::new()));
    assert_eq!(volume.function(&layer).expect("read"), function(&harness));
    let problem = load(&mut layer, &volume, &folder.path().join("none.json")).expect_err("no file");
    assert!(problem.contains("none.json"), "{problem}");
}

#[test]
fn what_depends_on_the_gradient_stays_until_it_is_left_out() {
    let region = Region {
        shape: Shape::Gaussian,
        value: [20.0, 60.0],
        gradient: [0.5, 2.0],
        color: [1.0, 0.0, 0.0],
        opacity: 0.5,
    };
    let own = TransferFunction { regions: vec![region], ..function(&harness(ramp())) };
    let mut harness = harness(own.into());
    let from = place(&harness, 100.0, 0.5);
    drag(&mut harness, from, from - vec2(0.0, 9.0));
    assert_eq!(function(&harness).regions, [region]);
    harness.get_by_label("leave out").click();
    harness.run();
    assert!(!function(&harness).is_by_gradient());
}
