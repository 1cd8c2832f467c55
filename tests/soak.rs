//! A window under random input, reproducible and through the window system, on three channels of a time series. It keeps running, its memory stays
//! within its budgets, no picture has a hole, and it still obeys. 30 s; `BRICKYARD_SOAK_EVENTS=100000` sets the number of events (`tools/soak`).

use brickyard::volume::{Extent, Geometry, Scene};
use brickyard_tests::{Display, FunctionSource, Random, Sandbox, TestStore, leave_out};
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

/// The window's size in pixels.
const SIZE: [u64; 2] = [1000, 700];

/// Budgets of slots and of bricks, MiB.
const BUDGET_MIB: u64 = 96;

/// A window's memory besides its budgets, MiB: the toolkit, fonts, a software GPU's window, bricks for picking.
const BESIDES_MIB: u64 = 150;

/// A field moving through all of space and time, different in each channel.
fn store() -> TestStore {
    let value = |time: u32, channel: u32, [x, y, z]: [u32; 3]| {
        let [u, v, w] = [x, y, z].map(f64::from);
        let phase = f64::from(time) + 2.0 * f64::from(channel);
        (127.0 + 60.0 * (0.21 * u + phase).sin() + 60.0 * (0.19 * v - 0.18 * w + phase).cos()) as u8
    };
    TestStore::pack(&FunctionSource::series(Extent::new(150, 130, 110), Geometry::default(), 5, 3, value), 32)
}

/// Random input in the words of xdotool, without the key for quitting and without typing into the fields of files.
fn input(random: &mut Random) -> String {
    let mut pick = |count: u64| random.bits() % count;
    let place = format!("{} {}", pick(SIZE[0]), pick(SIZE[1]));
    let keys = [
        "Left",
        "Right",
        "Up",
        "Down",
        "Prior",
        "Next",
        "Home",
        "comma",
        "period",
        "bracketleft",
        "bracketright",
        "1",
        "2",
        "3",
        "alt+1",
        "alt+2",
        "alt+3",
        "alt+4",
        "alt+5",
        "p",
        "o",
        "c",
        "b",
        "a",
        "t",
        "f",
        "h",
        "m",
        "Tab",
        "Escape",
        "ctrl+z",
        "ctrl+shift+z",
        "backslash",
        "w",
        "s",
        "d",
    ];
    match pick(10) {
        0..=3 => format!("mousemove {place}"),
        4 => format!("mousemove {place} mousedown 1 mousemove {} {} mouseup 1", pick(SIZE[0]), pick(SIZE[1])),
        5 => format!(
            "mousemove {place} mousedown {} mousemove {} {} mouseup 2 mouseup 3",
            2 + pick(2),
            pick(SIZE[0]),
            pick(SIZE[1])
        ),
        6 => format!("mousemove {place} click --delay 0 {}", 4 + pick(2)),
        7 => format!("mousemove {place} click --delay 0 1"),
        _ => format!("key --delay 0 {}", keys[pick(keys.len() as u64) as usize]),
    }
}

/// Anonymous memory of a process, as counted by the kernel, MiB; `None` once it has ended.
fn anonymous_mib(window: &Child) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{}/status", window.id())).ok()?;
    let line = status.lines().find(|line| line.starts_with("RssAnon:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? >> 10)
}

fn open(display: &Display, folder: &Path, store: &str, log: &Path) -> Child {
    let budget = format!("{BUDGET_MIB}MiB");
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    let arguments = [store, "--backend", "cpu", "--gpu-memory", &budget, "--host-memory", &budget, "--size", &size];
    let log = std::fs::File::options().create(true).append(true).open(log).expect("a log");
    let window = display.view(folder, &arguments).stderr(log).spawn().expect("it runs");
    display.focus();
    window
}

#[test]
fn a_wild_hand_does_no_harm() {
    if cfg!(not(target_os = "linux")) {
        return leave_out("display", "memory is counted by Linux alone");
    }
    let (Some(display), test, sandbox) = (Display::start(), store(), Sandbox::in_memory()) else { return };
    let (path, folder, log) = (test.path().display().to_string(), sandbox.path("."), sandbox.path("log.txt"));
    let wanted: Option<u64> = std::env::var("BRICKYARD_SOAK_EVENTS").ok().and_then(|count| count.parse().ok());
    let (begun, mut events, mut most_mib, mut random) = (Instant::now(), 0, 0, Random(7));
    let mut window = open(&display, &folder, &path, &log);
    let is_over = |events: u64| match wanted {
        Some(wanted) => events >= wanted,
        None => begun.elapsed() > Duration::from_secs(30),
    };
    while !is_over(events) {
        // One call for many: it costs as much as the inputs.
        let words: Vec<String> = (0..25).map(|_| input(&mut random)).collect();
        events += words.len() as u64;
        display.input(&(words.join(" ") + " sleep 0.05"));
        match anonymous_mib(&window) {
            Some(mib) => most_mib = most_mib.max(mib),
            // The input has hit the menu's last entry.
            None => {
                let ended = window.wait().expect("it has ended");
                let said = std::fs::read_to_string(&log).unwrap_or_default();
                assert!(ended.success(), "after {events} events, {ended}: {said}");
                window = open(&display, &folder, &path, &log);
            }
        }
    }
    println!("{events} events in {:.0} s: at most {most_mib} MiB of anonymous memory", begun.elapsed().as_secs_f64());
    assert!(most_mib <= 2 * BUDGET_MIB + BESIDES_MIB, "{most_mib} MiB after {events} events");
    // It still obeys; a text field or a menu may have the keyboard at first.
    let asked = Instant::now();
    let scene = loop {
        display.input("key Escape key Escape key ctrl+s");
        std::thread::sleep(Duration::from_millis(300));
        let text = std::fs::read(sandbox.path("brickyard.json")).ok();
        if let Some(scene) = text.and_then(|text| serde_json::from_slice::<Scene>(&text).ok()) {
            break scene;
        }
        assert!(asked.elapsed() < Duration::from_secs(60), "{}", std::fs::read_to_string(&log).unwrap_or_default());
    };
    assert!(scene.layers.iter().any(|layer| layer.visible));
    window.kill().expect("it runs");
    window.wait().expect("it has ended");
    let said = std::fs::read_to_string(&log).expect("a log");
    for bad in ["panicked", "a picture has a hole"] {
        assert!(!said.contains(bad), "{said}");
    }
}
