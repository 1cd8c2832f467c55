//! The window on a display of its own (Xvfb), with input through the window system (xdotool): what it shows is what `render` writes of the scene that
//! it saves, and a hand changes what it should.

use brickyard::volume::{Camera, Extent, Geometry, LightingModel, Mode, Picture, Scene};
use brickyard_tests::{FunctionSource, Sandbox, TestStore, command, leave_out, read_png, run};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A display without a screen that anybody sees.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// `None`, and said so, where there is no such server.
    fn start() -> Option<Self> {
        let asked = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1400x900x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut server) = asked else {
            leave_out("display", "there is no Xvfb, so no window was opened");
            return None;
        };
        let mut number = String::new();
        let output = server.stdout.take().expect("piped");
        BufReader::new(output).read_line(&mut number).expect("the display's number");
        Some(Self { server, name: format!(":{}", number.trim()) })
    }

    /// `brickyard view` on this display, in a folder.
    fn view(&self, folder: &Path, arguments: &[&str]) -> Command {
        let mut view = command();
        view.arg("view").args(arguments).current_dir(folder).env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        view
    }

    /// Sends input, as xdotool has it in words.
    fn input(&self, words: &str) {
        let sent = Command::new("xdotool").args(words.split(' ')).env("DISPLAY", &self.name).output();
        let sent = sent.expect("xdotool is there");
        assert!(sent.status.success(), "xdotool {words}: {}", String::from_utf8_lossy(&sent.stderr));
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may be gone.
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn store() -> TestStore {
    let waves = |[x, y, z]: [u32; 3]| {
        let [u, v, w] = [x, y, z].map(f64::from);
        (127.0 + 60.0 * (0.21 * u + 0.17 * v).sin() + 60.0 * (0.19 * v - 0.18 * w).cos()) as u8
    };
    TestStore::pack(&FunctionSource::new(Extent::new(40, 33, 36), Geometry::default(), move |_, _, v| waves(v)), 16)
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

/// Nothing is drawn over the picture.
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
        let arguments = [&path, "--backend", backend, "--script", "tour.txt", "--size", "900x600"];
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

/// Waits until a file has been written anew, and reads the scene in it.
fn saved(sandbox: &Sandbox, name: &str) -> Scene {
    let begun = Instant::now();
    let path = sandbox.path(name);
    loop {
        // A file that is being written is no scene yet.
        if let Some(scene) = std::fs::read(&path).ok().and_then(|text| serde_json::from_slice(&text).ok()) {
            std::fs::remove_file(&path).expect("removed");
            return scene;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{} was not saved", path.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn pointer_and_keys_change_the_scene() {
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let arguments = [&path, "--backend", "cpu", "--size", "900x600"];
    let mut window = display.view(sandbox.path(".").as_path(), &arguments).spawn().expect("it runs");
    display.input("search --sync --onlyvisible --name brickyard windowfocus --sync");
    let save = || {
        display.input("key ctrl+s");
        saved(&sandbox, "brickyard.json")
    };
    let first = save();
    let distance = |scene: &Scene| {
        let Camera { eye, target, .. } = scene.camera.expect("a camera");
        (eye - target).length()
    };
    // On a slow machine a whole drag may fall into one frame, and the wheel's way is smoothed over several.
    let until = |input: &str, is_it: &dyn Fn(&Scene) -> bool| {
        let begun = Instant::now();
        loop {
            display.input(input);
            let scene = save();
            if is_it(&scene) {
                return scene;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{input} changes nothing");
        }
    };
    let drag = "mousemove 600 300 sleep 0.2 mousedown 1 sleep 0.2 mousemove 640 300 sleep 0.2 mousemove 700 310 sleep 0.2 mouseup 1";
    let turned = until(drag, &|scene| scene.camera != first.camera);
    assert!((distance(&turned) / distance(&first) - 1.0).abs() < 1e-9);
    until("mousemove 600 300 click 4", &|scene| distance(scene) < 0.99 * distance(&first));
    display.input("key alt+2");
    assert_eq!(save().mode, Mode::Mip);
    display.input("key ctrl+z");
    assert_eq!(save().mode, Mode::Dvr, "undone");
    display.input("key ctrl+q");
    assert!(window.wait().expect("it ends").success());
}

#[test]
fn what_keeps_a_window_from_opening_is_said() {
    let (test, sandbox) = (store(), Sandbox::in_memory());
    let path = test.path().display().to_string();
    let mut view = command();
    view.args(["view", &path]).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let ended = view.output().expect("it runs");
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(ended.status.code() == Some(1) && said.contains("is there a display?"), "{:?}: {said}", ended.status);
    sandbox.write("tour.txt", "0 orbit 1 2\n1 orbt 3 4\n");
    let script = sandbox.path("tour.txt").display().to_string();
    let (code, _, said) = run(&["view", &path, "--script", &script]);
    assert!(code == 3 && said.contains("line 2") && said.contains("did you mean 'orbit'?"), "{code}: {said}");
}
