//! The window on its own display (Xvfb), with input through the window system (xdotool): it shows the picture of its saved scene by `render`, and
//! input has the intended effects.

use brickyard::volume::{Camera, Extent, Geometry, LightingModel, Mode, Picture, Scene};
use brickyard_tests::{Display, FunctionSource, Sandbox, TestStore, command, read_png, run};
use glam::DVec3;
use serde_json::Value;
use std::collections::HashSet;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

fn store() -> TestStore {
    let waves = |[x, y, z]: [u32; 3]| {
        let [u, v, w] = [x, y, z].map(f64::from);
        (127.0 + 60.0 * (0.21 * u + 0.17 * v).sin() + 60.0 * (0.19 * v - 0.18 * w).cos()) as u8
    };
    let extent = Extent::new(40, 33, 36);
    TestStore::pack(&FunctionSource::series(extent, Geometry::default(), 3, 1, move |_, _, v| waves(v)), 16)
}

fn most(found: &Picture, expected: &Picture) -> u8 {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let values = found.rgb.as_flattened().iter().zip(expected.rgb.as_flattened());
    values.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

/// Whether a picture is shown in the window's right part, pixel by pixel.
fn is_in(screen: &Picture, picture: &Picture) -> bool {
    let (left, rows) = (screen.width - picture.width, screen.height - picture.height);
    let row = |of: &Picture, x: u32, y: u32| {
        let first = (y * of.width + x) as usize;
        of.rgb[first..first + picture.width as usize].to_vec()
    };
    let is_alike = |a: Vec<[u8; 3]>, b: Vec<[u8; 3]>| {
        a.as_flattened().iter().zip(b.as_flattened()).all(|(a, b)| a.abs_diff(*b) <= 1)
    };
    (0..=rows).any(|top| (0..picture.height).all(|y| is_alike(row(screen, left, top + y), row(picture, 0, y))))
}

/// Settings without overlays.
const BARE: &str =
    r#"{"outline": false, "axes": false, "scale_bar": false, "color_bar": false, "clip_handles": false}"#;

#[test]
fn the_window_shows_what_render_writes_of_its_scene() {
    let (Some(display), test) = (Display::start(), store()) else { return };
    let path = test.path().display().to_string();
    let tour = format!(
        "0 set window.overlays {BARE}\n0 orbit 30 12\n0 zoom 1.2\n0 pan 0.05 -0.03\nsettled screenshot first.png\n\
        settled set mode mip\nsettled set mode isosurface\nsettled set layers.0.isosurfaces.0.value 99\nsettled set mode dvr\n\
        settled set layers.0.transfer {{\"preset\": \"viridis\"}}\nsettled set layers.0.window [40, 210]\n\
        settled set lighting.model blinn-phong\nsettled undo\nsettled save-scene scene.json\n\
        settled save-picture picture.png\nsettled screenshot last.png\nsettled quit\n"
    );
    for backend in ["cpu", "gpu"] {
        let sandbox = Sandbox::in_memory();
        sandbox.write("tour.txt", &tour);
        let arguments = [&path, "--backend", backend, "--script", "tour.txt", "--size", "720x480"];
        let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
        assert!(ended.status.success(), "{backend}: {}", String::from_utf8_lossy(&ended.stderr));
        let scene: Scene = serde_json::from_slice(&sandbox.read("scene.json")).expect("a scene");
        assert_eq!((scene.mode, scene.lighting.model), (Mode::Dvr, LightingModel::None), "what was undone");
        assert_eq!(scene.layers[0].window, Some([40.0, 210.0]));
        let picture = read_png(&sandbox.path("picture.png"));
        let size = format!("{}x{}", picture.width, picture.height);
        let line = format!("render {path} --scene scene.json --backend {backend} --size {size} -o rendered.png");
        sandbox.run_ok(&line);
        let rendered = read_png(&sandbox.path("rendered.png"));
        assert!(most(&picture, &rendered) <= 1, "{backend}: {}", most(&picture, &rendered));
        let [first, last] = ["first.png", "last.png"].map(|name| read_png(&sandbox.path(name)));
        assert!(is_in(&last, &rendered), "{backend}: the window shows another picture");
        assert!(!is_in(&first, &rendered), "{backend}: the tour changed the picture");
    }
}

#[test]
fn a_mode_that_is_chosen_in_the_window_is_that_of_render() {
    let Some(display) = Display::start() else { return };
    let extent = Extent::new(40, 33, 36);
    let wave = |channel: u32, v: [u32; 3]| {
        let [x, y, z] = v.map(|n| f64::from(n) * (0.2 + 0.05 * f64::from(channel)));
        (127.0 + 60.0 * x.sin() + 60.0 * (y + z).cos()) as u8
    };
    let test =
        TestStore::pack(&FunctionSource::series(extent, Geometry::default(), 1, 3, move |_, c, v| wave(c, v)), 16);
    let (path, sandbox) = (test.path().display().to_string(), Sandbox::in_memory());
    let modes = ["mip", "dvr", "average", "minip", "dvr"];
    let chosen = |(i, mode): (usize, &&str)| {
        format!("settled set mode {mode}\nsettled view +z\nsettled save-picture 120x120 over=none {i}.png\n")
    };
    let tour: String = modes.iter().enumerate().map(chosen).collect();
    sandbox.write("tour.txt", &(tour + "settled quit\n"));
    let arguments = [&path, "--backend", "cpu", "--script", "tour.txt", "--size", "900x600"];
    let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    for (i, mode) in modes.iter().enumerate() {
        let line = format!("render {path} --mode {mode} --view +z --size 120x120 --backend cpu -o rendered{i}.png");
        sandbox.run_ok(&line);
        let [found, expected] =
            [format!("{i}.png"), format!("rendered{i}.png")].map(|name| read_png(&sandbox.path(&name)));
        assert!(most(&found, &expected) <= 1, "{mode}: {}", most(&found, &expected));
    }
}

/// An open window, and its working folder.
struct Opened<'a> {
    display: &'a Display,
    sandbox: &'a Sandbox,
    window: Child,
}

impl<'a> Opened<'a> {
    fn new(display: &'a Display, sandbox: &'a Sandbox, arguments: &[&str]) -> Self {
        Self::telling(display, sandbox, arguments, Stdio::inherit())
    }

    /// A window with a log.
    fn telling(display: &'a Display, sandbox: &'a Sandbox, arguments: &[&str], log: impl Into<Stdio>) -> Self {
        let unless_said = |flag, value| if arguments.contains(&flag) { Vec::new() } else { vec![flag, value] };
        let arguments = [arguments, &unless_said("--backend", "cpu"), &unless_said("--size", "900x600")].concat();
        let window = display.view(sandbox.path(".").as_path(), &arguments).stderr(log).spawn().expect("it runs");
        display.focus();
        Self { display, sandbox, window }
    }

    /// The window's document, which it saves on request. Waits for the file.
    fn document(&self) -> Value {
        let (begun, path) = (Instant::now(), self.sandbox.path("brickyard.json"));
        self.display.input("key ctrl+s");
        loop {
            // A file still being written is no document yet.
            if let Some(document) = std::fs::read(&path).ok().and_then(|text| serde_json::from_slice(&text).ok()) {
                std::fs::remove_file(&path).expect("removed");
                return document;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{} was not saved", path.display());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn scene(&self) -> Scene {
        serde_json::from_value(self.document()).expect("a scene")
    }

    /// Repeats input until the document is as expected: on a slow machine a whole drag may fall into one frame, and the wheel is smoothed over
    /// several.
    fn until(&self, input: &str, is_it: &dyn Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            self.display.input(input);
            let document = self.document();
            if is_it(&document) {
                return document;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{input} changes nothing: {document}");
        }
    }

    fn quit(mut self) {
        self.display.input("key ctrl+q");
        assert!(self.window.wait().expect("it ends").success());
    }
}

#[test]
fn pointer_and_keys_change_the_scene() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    for backend in ["cpu", "gpu"] {
        let opened = Opened::new(&display, &sandbox, &[&path, "--backend", backend, "--fresh"]);
        let first = opened.scene();
        let scene = |document: &Value| serde_json::from_value::<Scene>(document.clone()).expect("a scene");
        let distance = |scene: &Scene| {
            let Camera { eye, target, .. } = scene.camera.expect("a camera");
            (eye - target).length()
        };
        let drag = "mousemove 600 300 sleep 0.2 mousedown 1 sleep 0.2 mousemove 640 300 sleep 0.2 mousemove 700 310 sleep 0.2 mouseup 1";
        let turned = scene(&opened.until(drag, &|document| scene(document).camera != first.camera));
        assert!((distance(&turned) / distance(&first) - 1.0).abs() < 1e-9);
        opened.until("mousemove 600 300 click 4", &|document| distance(&scene(document)) < 0.99 * distance(&first));
        display.input("key alt+2");
        assert_eq!(opened.scene().mode, Mode::Mip);
        display.input("key ctrl+z");
        assert_eq!(opened.scene().mode, Mode::Dvr, "undone");
        display.input("key c");
        let document = opened.document();
        assert!(document["clip"].is_array(), "{backend}: {document}");
        display.input("key bracketright key bracketright");
        assert_eq!(opened.scene().time, 2);
        opened.quit();
    }
}

#[test]
fn time_steps_are_played_and_the_picture_is_of_the_step_that_is_said() {
    let (Some(display), sandbox) = (Display::start(), Sandbox::in_memory()) else { return };
    let value = |time: u32, _: u32, [x, _, z]: [u32; 3]| (20 * time + 3 * x + z) as u8;
    let source = FunctionSource::series(Extent::new(24, 20, 16), Geometry::default(), 9, 1, value);
    let test = TestStore::pack(&source, 16);
    let path = test.path().display().to_string();
    // "settled" comes once the last step is shown.
    let tour = format!(
        "0 set window.overlays {BARE}\nsettled set time 2\nsettled set window.play.steps_per_second 50\n\
        settled set window.play.ending stop\nsettled set window.play.on true\nsettled save-scene scene.json\n\
        settled save-picture picture.png\nsettled screenshot last.png\nsettled quit\n"
    );
    sandbox.write("tour.txt", &tour);
    for backend in ["cpu", "gpu"] {
        let arguments = [&path, "--backend", backend, "--script", "tour.txt", "--size", "900x600", "--fresh"];
        let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
        assert!(ended.status.success(), "{backend}: {}", String::from_utf8_lossy(&ended.stderr));
        let document: Value = serde_json::from_slice(&sandbox.read("scene.json")).expect("a scene");
        assert_eq!((&document["time"], &document["window"]["play"]["on"]), (&8.into(), &false.into()), "{backend}");
        let picture = read_png(&sandbox.path("picture.png"));
        let size = format!("{}x{}", picture.width, picture.height);
        let line =
            format!("render {path} --scene scene.json --backend {backend} --size {size} -o rendered.png --overwrite");
        sandbox.run_ok(&line);
        let rendered = read_png(&sandbox.path("rendered.png"));
        assert!(most(&picture, &rendered) <= 1, "{backend}: {}", most(&picture, &rendered));
        assert!(is_in(&read_png(&sandbox.path("last.png")), &rendered), "{backend}: the window shows another picture");
    }
    // In a loop, until stopped by the key.
    let opened = Opened::new(&display, &sandbox, &[&path, "--backend", "cpu", "--fresh"]);
    let is_on = |document: &Value| document["window"]["play"]["on"] == true;
    display.input("key space");
    let mut seen = HashSet::new();
    let begun = Instant::now();
    while seen.len() < 4 {
        let document = opened.document();
        assert!(begun.elapsed() < Duration::from_secs(60), "{document}");
        seen.insert(document["time"].as_u64());
    }
    display.input("key space");
    let stopped = opened.document();
    assert!(!is_on(&stopped), "{stopped}");
    assert_eq!(opened.document()["time"], stopped["time"]);
    opened.quit();
}

/// The middle of the mark in the row of time steps: a run of white, near the window's lower end.
fn mark(screen: &Picture) -> f64 {
    let rows = (screen.height - 90..screen.height).map(|y| (0..screen.width).map(move |x| (x, y)));
    let runs = rows.filter_map(|row| {
        let white: Vec<u32> = row.filter(|&(x, y)| screen.pixel(x, y) == [255; 3]).map(|(x, _)| x).collect();
        let longest = white.chunk_by(|a, b| a + 1 == *b).max_by_key(|run| run.len())?;
        Some((longest.len(), f64::from(longest[0] + longest[longest.len() - 1]) / 2.0))
    });
    runs.max_by_key(|(length, _)| *length).filter(|(length, _)| *length > 9).expect("a mark").1
}

/// At any rate of steps, each frame of the window marks the step of its own picture.
#[test]
fn the_row_of_steps_is_about_the_picture_in_the_same_frame() {
    const LAST: u32 = 15;
    let (Some(display), sandbox) = (Display::start(), Sandbox::in_memory()) else { return };
    let source = FunctionSource::series(Extent::new(24, 20, 16), Geometry::default(), LAST + 1, 1, |step, _, _| {
        (12 * step + 20) as u8
    });
    let test = TestStore::pack(&source, 16);
    let path = test.path().display().to_string();
    let played: String = (0..12).map(|i| format!("0 screenshot {i}.png\n")).collect();
    let tour = format!(
        "0 set window.overlays {BARE}\nsettled set mode mip\nsettled set layers.0.window [0, 255]\nsettled screenshot first.png\n\
        settled set time {LAST}\nsettled screenshot last.png\nsettled set window.play.steps_per_second 300\n\
        settled set window.play.on true\n{played}0 set window.play.on false\nsettled quit\n"
    );
    sandbox.write("tour.txt", &tour);
    for backend in ["cpu", "gpu"] {
        let arguments = [&path, "--backend", backend, "--script", "tour.txt", "--size", "900x600", "--fresh"];
        let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
        assert!(ended.status.success(), "{backend}: {}", String::from_utf8_lossy(&ended.stderr));
        let screen = |name: &str| read_png(&sandbox.path(format!("{name}.png")));
        let ends = ["first", "last"].map(|name| mark(&screen(name)));
        let mut seen = HashSet::new();
        for i in 0..12 {
            let screen = screen(&i.to_string());
            let marked = ((mark(&screen) - ends[0]) / (ends[1] - ends[0]) * f64::from(LAST)).round();
            let shown = ((f64::from(screen.pixel(590, 280)[0]) - 20.0) / 12.0).round();
            assert_eq!(marked, shown, "{backend}, frame {i}");
            seen.insert(shown as i64);
        }
        assert!(seen.len() > 3, "{backend}: it plays: {seen:?}");
    }
}

#[test]
fn a_store_that_grows_is_followed() {
    let (Some(display), sandbox) = (Display::start(), Sandbox::in_memory()) else { return };
    let append = |step: u8| {
        sandbox.write("step.raw", vec![40 * step + 9; 24 * 20 * 16]);
        sandbox.run_ok("append s.zarr step.raw --shape 24,20,16 --dtype u8");
    };
    for backend in ["cpu", "gpu"] {
        (0..2).for_each(append);
        let path = sandbox.path("s.zarr").display().to_string();
        let log = sandbox.path("log.txt");
        let said = std::fs::File::create(&log).expect("a log");
        let opened = Opened::telling(&display, &sandbox, &[&path, "--backend", backend, "--fresh"], said);
        opened.until("key bracketright", &|document| document["time"] == 1);
        for step in 2..4 {
            append(step);
            opened.until("key bracketright", &|document| document["time"] == step);
        }
        opened.quit();
        let said = std::fs::read_to_string(&log).expect("a log");
        assert!(!said.contains("hole"), "{backend}: {said}");
        std::fs::remove_dir_all(&path).expect("removed");
    }
}

/// A drag of the first button from one place to another, in the words of xdotool.
fn drag([x, y]: [f64; 2], [right, down]: [f64; 2]) -> String {
    let at = |share: f64| format!("mousemove {:.0} {:.0} sleep 0.2", x + share * right, y + share * down);
    format!("{} mousedown 1 sleep 0.2 {} {} mouseup 1", at(0.0), at(0.5), at(1.0))
}

#[test]
fn a_handle_moves_its_face_of_the_clip_box() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let opened = Opened::new(&display, &sandbox, &[&path]);
    // Without panels the picture fills the window.
    let document = opened.until("key F10 sleep 0.5 key c", &|document| document["clip"].is_array());
    let scene: Scene = serde_json::from_value(document.clone()).expect("a scene");
    let rays = scene.camera.expect("a camera").rays(900, 600).expect("rays");
    let [low, high] = scene.clip.expect("a box");
    let pixel = |share: f64| {
        let at = DVec3::new(low.x + share * (high.x - low.x), 0.5 * (low.y + high.y), 0.5 * (low.z + high.z));
        rays.pixel(at).expect("in front of the eye")
    };
    // A quarter of the box is cut off.
    let (from, to) = (pixel(1.0), pixel(0.75));
    let cut = opened.until(&drag(from, [to[0] - from[0], to[1] - from[1]]), &|now| now["clip"] != document["clip"]);
    let clip: [[f64; 3]; 2] = serde_json::from_value(cut["clip"].clone()).expect("a box");
    let share = (clip[1][0] - low.x) / (high.x - low.x);
    // If the press and the first half of the way fall into one frame, a drag begins after them.
    assert!((0.7..0.9).contains(&share), "{share}");
    assert_eq!((clip[0], &clip[1][1..]), (low.to_array(), &high.to_array()[1..]), "the other faces stay");
    assert_eq!(cut["camera"], document["camera"], "the view stays");
    opened.quit();
}

#[test]
fn a_hand_makes_points_of_a_transfer_function_and_moves_them() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let flags = ["--size", "900x850", "--transfer", "gray", "--lighting", "none"];
    let opened = Opened::new(&display, &sandbox, &[&[&path[..]], &flags[..]].concat());
    let points =
        |document: &Value| document["layers"][0]["transfer"]["opacity"].as_array().cloned().unwrap_or_default();
    // The editor unfolds from its heading, in the panel on the left, once there is one.
    opened.document();
    display.input("mousemove 74 379 sleep 0.3 click 1 sleep 0.7");
    let made = opened.until("mousemove 140 450 sleep 0.3 click --repeat 2 --delay 60 1", &|now| points(now).len() == 3);
    let moved = opened.until(&drag([140.0, 450.0], [30.0, -25.0]), &|now| points(now) != points(&made));
    let [before, after] = [&made, &moved].map(|document| points(document)[1].clone());
    let number = |point: &Value, i: usize| point[i].as_f64().expect("a number");
    assert!(number(&after, 0) > number(&before, 0) && number(&after, 1) > number(&before, 1), "{before} {after}");
    display.input("key ctrl+z");
    assert_eq!(points(&opened.document()), points(&made), "undone");
    opened.quit();
}

#[test]
fn slices_meet_where_the_pointer_is() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let opened = Opened::new(&display, &sandbox, &[&path]);
    display.input("key p");
    assert_eq!(opened.document()["window"]["layout"], "planes");
    // The slice across z is the upper left quarter of the area beside the panel.
    let crosshair = |document: &Value| document["window"]["planes"]["crosshair"].as_array().cloned();
    let there = opened.until("mousemove 400 150 sleep 0.2 mousedown 1 sleep 0.2 mouseup 1", &|document| {
        crosshair(document).is_some()
    });
    let z = |document: &Value| crosshair(document).expect("a point")[2].as_f64().expect("a number");
    let before = z(&there);
    let rolled = opened.until("mousemove 400 150 click 4", &|document| z(document) != before);
    assert!((z(&rolled) - before - 1.0).abs() < 1e-9 || z(&rolled) > before, "slice by slice: {before} {}", z(&rolled));
    opened.quit();
}

#[test]
fn a_window_begins_as_it_was_left() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let opened = Opened::new(&display, &sandbox, &[&path]);
    display.input("key alt+2 key o key t");
    let left = opened.document();
    opened.quit();
    let again = Opened::new(&display, &sandbox, &[&path]);
    assert_eq!(again.document(), left);
    again.quit();
    let fresh = Opened::new(&display, &sandbox, &[&path, "--fresh"]);
    assert_eq!(fresh.document()["mode"], "dvr");
    fresh.quit();
}

#[test]
fn a_window_outlives_its_store_and_what_it_cannot_write() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    // A folder in the picture's place.
    std::fs::create_dir(sandbox.path("brickyard.png")).expect("a folder");
    let opened = Opened::new(&display, &sandbox, &[&path]);
    std::fs::remove_dir_all(test.path()).expect("removed");
    display.input("key ctrl+p key alt+2 key Left key Left key p");
    let document = opened.document();
    assert_eq!((&document["mode"], &document["window"]["layout"]), (&"mip".into(), &"planes".into()));
    opened.quit();
}

#[test]
fn a_window_goes_on_after_its_gpu_was_lost() {
    let (Some(display), test) = (Display::start(), store()) else { return };
    let path = test.path().display().to_string();
    // The device is lost in the middle of a turn, and during the saving of a picture.
    let tour = format!(
        "0 set window.overlays {BARE}\n0 set mode mip\n0.2 orbit 9 4\n0.3 orbit 9 4\n0.3 lose-gpu\n0.4 orbit 9 4\n\
        settled set layers.0.window [40, 210]\nsettled set step 0.4\n0 save-picture picture.png\n0 lose-gpu\nsettled undo\n0 undo\n0 undo\n\
        settled save-scene scene.json\nsettled save-picture last.png\nsettled screenshot screen.png\nsettled quit\n"
    );
    for backend in ["cpu", "gpu"] {
        let sandbox = Sandbox::in_memory();
        sandbox.write("tour.txt", &tour);
        let arguments = ["-v", &path, "--backend", backend, "--script", "tour.txt", "--size", "900x600"];
        let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(ended.status.success() && !said.contains("panicked"), "{backend}: {said}");
        assert!(said.contains("the GPU was lost and has been opened again"), "{backend}: {said}");
        assert_eq!(said.matches("the GPU was lost: ").count(), 2, "{backend}: {said}");
        let scene: Scene = serde_json::from_slice(&sandbox.read("scene.json")).expect("a scene");
        assert_eq!((scene.mode, scene.layers[0].window), (Mode::Dvr, None), "{backend}: all edits are undone");
        let picture = read_png(&sandbox.path("last.png"));
        let size = format!("{}x{}", picture.width, picture.height);
        let line = format!("render {path} --scene scene.json --backend {backend} --size {size} -o rendered.png");
        sandbox.run_ok(&line);
        let rendered = read_png(&sandbox.path("rendered.png"));
        assert!(most(&picture, &rendered) <= 1, "{backend}: {}", most(&picture, &rendered));
        let screen = read_png(&sandbox.path("screen.png"));
        assert_eq!((screen.width, screen.height), (900, 600), "{backend}: the window's size");
        assert!(is_in(&screen, &rendered), "{backend}: the window shows another picture");
        assert!(most(&read_png(&sandbox.path("picture.png")), &rendered) > 1, "{backend}: what was asked for before");
    }
}

#[test]
fn a_gpu_that_is_lost_again_and_again_leaves_the_volumes_to_the_cpu_and_then_ends() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let losses = "settled lose-gpu\n".repeat(3);
    // Small pictures of one sample settle sooner: losses have to follow each other within seconds.
    let losses = format!("0 set pixel_samples 1\n{losses}");
    sandbox.write("tour.txt", format!("{losses}settled save-picture picture.png\nsettled lose-gpu\nsettled quit\n"));
    let arguments = ["-v", &path, "--backend", "gpu", "--script", "tour.txt", "--size", "640x400"];
    let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(said.contains("the CPU draws the volumes now") && sandbox.path("picture.png").exists(), "{said}");
    let is_told = said.contains("error: the GPU was lost 4 times within seconds") && !said.contains("panicked");
    assert!(ended.status.code() == Some(1) && is_told, "{:?}: {said}", ended.status);
}

#[test]
fn displays_that_cannot_show_a_window_are_said() {
    let (test, sandbox) = (store(), Sandbox::in_memory());
    let path = test.path().display().to_string();
    let usual = ["-screen", "0", "1400x900x24"];
    let displays: [(&[&str], &str); 3] = [
        (&["-screen", "0", "1400x900x16"], "does not draw on this display"),
        (&[&usual[..], &["-extension", "RANDR"]].concat(), "this display or its driver cannot show the window"),
        (&[&usual[..], &["-extension", "XFIXES"]].concat(), "this display or its driver cannot show the window"),
    ];
    for (like, expected) in displays {
        let Some(display) = Display::start_with(like) else { return };
        let ended = display.view(sandbox.path(".").as_path(), &[&path]).output().expect("it runs");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        let is_told = said.contains(expected) && !said.contains("panicked") && !said.contains(".rs");
        assert!(ended.status.code() == Some(1) && is_told, "{like:?}: {:?}: {said}", ended.status);
    }
    let Some(mut display) = Display::start() else { return };
    let mut view = display.view(sandbox.path(".").as_path(), &[&path]);
    let mut window = view.stderr(std::process::Stdio::piped()).spawn().expect("it runs");
    display.focus();
    display.end();
    let status = window.wait().expect("it ends");
    let said = std::io::read_to_string(window.stderr.take().expect("piped")).expect("text");
    assert!(status.code() == Some(1) && !said.contains("panicked"), "{status:?}: {said}");
}

#[test]
fn a_script_that_fails_says_where_and_why() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    sandbox.write("no.txt", "no volume");
    for (command, why) in [
        ("export crop.xyz", "crop.xyz"),
        ("save-picture no-such-folder/a.png", "no-such-folder/a.png"),
        ("set nonsense 3", "nonsense"),
        ("set step 1e-30", "expected 0.005 to 16 voxels"),
        ("zoom 1e-9", "voxels away from the volume"),
        ("open no.txt", "no.txt"),
        ("screenshot no-such-folder/b.png", "no-such-folder/b.png"),
        ("save-scene no-such-folder/c.json", "no-such-folder/c.json"),
    ] {
        sandbox.write("tour.txt", format!("# a tour\n0 set mode mip\n0 {command}\nsettled save-scene after.json\n"));
        let arguments = [&path, "--backend", "cpu", "--script", "tour.txt", "--screenshot", "shot.png"];
        let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        let times = if command == "set nonsense 3" { 2 } else { 1 };
        let is_said = said.contains("line 3") && said.matches(why).count() == times;
        assert!(ended.status.code() == Some(1) && is_said, "{command}: {:?}: {said}", ended.status);
        assert!(!sandbox.path("after.json").exists(), "{command}: the script goes on");
    }
    sandbox.write("tour.txt", "0 export crop.npy\n0 set mode mip\nsettled set window.panels false\n");
    let arguments = [&path, "--backend", "cpu", "--script", "tour.txt", "--screenshot", "shot.png"];
    let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    assert!(sandbox.path("crop.npy").exists() && sandbox.path("shot.png").exists());
}

#[test]
fn the_dialog_of_an_empty_window_goes_once_something_is_opened() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    sandbox.write("open.txt", format!("0 open {path}\n0 set window.panels false\n"));
    sandbox.write("there.txt", "0 set window.panels false\n");
    let shot = |arguments: &[&str]| {
        let arguments = [arguments, &["--backend", "cpu", "--screenshot", "shot.png"]].concat();
        let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
        assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
        read_png(&sandbox.path("shot.png"))
    };
    let opened = shot(&["--script", "open.txt"]);
    let there = shot(&[&path, "--script", "there.txt"]);
    assert!(most(&opened, &there) <= 1, "something lies over the picture");
}

#[test]
fn what_keeps_a_window_from_opening_is_said() {
    let (test, sandbox) = (store(), Sandbox::in_memory());
    let path = test.path().display().to_string();
    if let Some(display) = Display::start() {
        let mut view = display.view(sandbox.path(".").as_path(), &[&path]);
        let ended =
            view.env("VK_ICD_FILENAMES", "/dev/null").env("VK_DRIVER_FILES", "/dev/null").output().expect("it runs");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(
            ended.status.code() == Some(1) && said.contains("mesa's software Vulkan"),
            "{:?}: {said}",
            ended.status
        );
        let mut view = display.view(sandbox.path(".").as_path(), &[&path]);
        let ended = view.env("WGPU_ADAPTER_NAME", "nothing").output().expect("it runs");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(ended.status.code() == Some(1) && said.contains("WGPU_ADAPTER_NAME is nothing"), "{said}");
    }
    let mut view = command();
    view.args(["view", &path]).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let ended = view.output().expect("it runs");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(
        ended.status.code() == Some(1) && said.contains("is there a display?") && !said.contains(".rs"),
        "{:?}: {said}",
        ended.status
    );
    sandbox.write("tour.txt", "0 orbit 1 2\n1 orbt 3 4\n");
    let script = sandbox.path("tour.txt").display().to_string();
    let (code, _, said) = run(&["view", &path, "--script", &script]);
    assert!(code == 3 && said.contains("line 2") && said.contains("did you mean 'orbit'?"), "{code}: {said}");
}

/// The ends of the only distance in a window's document.
fn measured(document: &Value) -> [DVec3; 2] {
    let found: Vec<[DVec3; 2]> = serde_json::from_value(document["window"]["distances"].clone()).expect("distances");
    let [ends] = found[..] else { panic!("{found:?}") };
    ends
}

#[test]
fn a_distance_in_a_slice_lies_in_it() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    // The slice across z is the upper left quarter of the area beside the panel.
    let tour = "0 set window.layout planes\n0 set window.tool distance\nsettled click 400 150\nsettled click 460 200\n\
        settled save-scene scene.json\nsettled quit\n";
    sandbox.write("tour.txt", tour);
    let arguments = [&path, "--backend", "cpu", "--script", "tour.txt", "--size", "900x600"];
    let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let document: Value = serde_json::from_slice(&sandbox.read("scene.json")).expect("a document");
    let [from, to] = measured(&document);
    let across = to - from;
    assert!(across.z.abs() < 1e-9 && across.x > 0.0 && across.y > 0.0, "y goes down: {from} {to}");
    assert!((across.x / across.y - 60.0 / 50.0).abs() < 1e-3, "shown alike in all directions: {from} {to}");
    assert!(document["window"]["planes"]["crosshair"].is_null(), "a click that measures moves nothing");
}

#[test]
fn a_distance_in_a_projection_is_what_the_picture_shows() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let opened = Opened::new(&display, &sandbox, &[&path, "--mode", "mip"]);
    display.input("key m");
    let clicks = "mousemove 540 280 sleep 1 click 1 sleep 0.5 mousemove 640 330 sleep 1 click 1 sleep 0.5";
    let document = opened.until(clicks, &|document| document["window"]["distances"] != Value::Array(Vec::new()));
    let [from, to] = measured(&document);
    let camera: Camera = serde_json::from_value(document["camera"].clone()).expect("a camera");
    let forward = (camera.target - camera.eye).normalize();
    assert!(from != to && (to - from).dot(forward).abs() < 1e-9, "{from} {to}");
    opened.quit();
}

#[test]
fn a_saved_picture_has_what_the_window_shows_over_it() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let tour = "0 set window.overlays.axes false\nsettled save-picture 600x400 over=none bare.png\n\
        settled save-picture 600x400 over=scale_bar bar.png\nsettled save-picture 600x400 shown.png\nsettled save-scene scene.json\nsettled quit\n";
    sandbox.write("tour.txt", tour);
    let arguments = [&path, "--backend", "cpu", "--script", "tour.txt", "--size", "900x600"];
    let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let [bare, bar, shown] = ["bare.png", "bar.png", "shown.png"].map(|name| read_png(&sandbox.path(name)));
    let differing = |picture: &Picture| -> Vec<(usize, usize)> {
        let pixels = picture.rgb.iter().zip(&bare.rgb).enumerate().filter(|(_, (a, b))| a[0].abs_diff(b[0]) > 40);
        pixels.map(|(i, _)| (i % 600, i / 600)).collect()
    };
    let of_bar = differing(&bar);
    assert!(of_bar.len() > 50 && of_bar.iter().all(|(x, y)| *x > 400 && *y > 340), "the bar is in the lower right");
    let of_all = differing(&shown);
    assert!(of_all.len() > of_bar.len() && of_all.iter().any(|(x, _)| *x < 300), "the box is drawn, too");
    sandbox.run_ok(&format!("render {path} --scene scene.json --backend cpu --size 600x400 -o rendered.png"));
    assert!(most(&bare, &read_png(&sandbox.path("rendered.png"))) <= 1);
}

/// A view turns during the saving of a picture, without effect on it.
#[test]
fn a_view_turns_while_a_picture_is_saved() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    // Each screenshot takes a few frames of the window: the picture is under way before the turn, and the view is at rest after it.
    let looks = |name: &str| (0..8).map(|i| format!("0 screenshot {name}{i}.png\n")).collect::<String>();
    let tour = format!(
        "0 set window.overlays {BARE}\n0 set pixel_samples 8\n0 set step 0.4\nsettled save-scene scene.json\n\
        0 save-picture 1200x900 over=none saved.png\n{}0 view +z\n{}settled screenshot last.png\nsettled quit\n",
        looks("before"),
        looks("after")
    );
    sandbox.write("tour.txt", &tour);
    let arguments = [&path, "--backend", "cpu", "--script", "tour.txt", "--size", "700x500"];
    let mut child = display.view(sandbox.path(".").as_path(), &arguments).spawn().expect("it runs");
    let saved = sandbox.path("saved.png");
    let mut is_ahead = false;
    while child.try_wait().expect("a status").is_none() {
        is_ahead |= sandbox.path("after7.png").exists() && !saved.exists();
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(is_ahead, "the view waits for the picture");
    let screens = ["before7.png", "after7.png", "last.png"].map(|name| read_png(&sandbox.path(name)));
    // The panel at the left and the row with the picture's progress differ.
    let part = |screen: &Picture| -> Vec<[u8; 3]> {
        (120..350).flat_map(|y| (400..690).map(move |x| (x, y))).map(|(x, y)| screen.rgb[y * 700 + x]).collect()
    };
    let [before, after, last] = screens.each_ref().map(part);
    let off = |a: &[[u8; 3]], b: &[[u8; 3]]| a.iter().zip(b).filter(|(a, b)| a[0].abs_diff(b[0]) > 24).count();
    assert!(off(&before, &last) > 1000, "the view is turned");
    assert!(off(&after, &last) < 100, "{} pixels differ from the view at rest", off(&after, &last));
    sandbox.run_ok(&format!("render {path} --scene scene.json --backend cpu --size 1200x900 -o rendered.png"));
    assert!(most(&read_png(&saved), &read_png(&sandbox.path("rendered.png"))) <= 1);
}
