//! Movies and camera paths with time steps, by the command: a series of six small steps as GIF, YUV4MPEG2 and MP4, beside `render`'s pictures of the
//! same views. Without ffmpeg, scripts of the same name replace it.

use brickyard::volume::Picture;
use brickyard_tests::{Sandbox, leave_out, read_png};
use std::path::Path;
use std::process::Command;

const STEPS: u32 = 6;

/// Each picture's look: a colour map over all values, on one thread, in an odd size.
const SCENE: &str = "--mode mip --window 0:6500 --transfer viridis --backend cpu --size 25x23";

/// A series `flow.zarr`, with step and place encoded in its values.
fn packed() -> Sandbox {
    let sandbox = Sandbox::in_memory();
    let voxels = (0..STEPS as u16).flat_map(|step| (0..9 * 8 * 7).map(move |voxel| step * 1000 + voxel));
    sandbox.write("flow.raw", voxels.flat_map(u16::to_le_bytes).collect::<Vec<u8>>());
    sandbox
        .run_ok("pack flow.raw flow.zarr --shape 9,8,7 --dtype u16 --axes tzyx --times 6 --brick 16 --progress none");
    sandbox
}

/// The single pictures of `render`.
fn pictures(sandbox: &Sandbox, flags: &str, count: usize) -> Vec<Picture> {
    sandbox.run_ok(&format!("render flow.zarr -o p.png --overwrite {SCENE} {flags}"));
    (0..count).map(|i| read_png(&sandbox.path(format!("p_{i:03}.png")))).collect()
}

/// The pictures of a GIF.
fn read_gif(path: &Path) -> Vec<Picture> {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(std::fs::File::open(path).expect("a file")).expect("a GIF");
    let mut pictures = Vec::new();
    while let Some(frame) = decoder.read_next_frame().expect("a whole GIF") {
        let rgb = frame.buffer.as_chunks::<4>().0.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        pictures.push(Picture { width: frame.width.into(), height: frame.height.into(), rgb });
    }
    pictures
}

/// The header of a YUV4MPEG2 file and its pictures, by the equations of BT.709.
fn read_y4m(bytes: &[u8]) -> (String, Vec<Picture>) {
    let end = bytes.iter().position(|byte| *byte == b'\n').expect("a header");
    let header = String::from_utf8(bytes[..end].to_vec()).expect("text");
    let parameter =
        |key| header.split(' ').find_map(|word| word.strip_prefix(key)).expect("a size").parse().expect("a number");
    let (width, height): (u32, u32) = (parameter("W"), parameter("H"));
    let plane = (width * height) as usize;
    let frames = bytes[end + 1..].chunks(6 + 3 * plane);
    let picture = |frame: &[u8]| {
        assert_eq!((&frame[..6], frame.len()), (&b"FRAME\n"[..], 6 + 3 * plane));
        let code = |i: usize, p: usize| f64::from(frame[6 + i * plane + p]);
        let rgb = (0..plane).map(|p| {
            let y = (code(0, p) - 16.0) / 219.0;
            let [blue, red] = [1, 2].map(|i| (code(i, p) - 128.0) / 224.0);
            let (r, b) = (y + 1.5748 * red, y + 1.8556 * blue);
            [r, (y - 0.2126 * r - 0.0722 * b) / 0.7152, b].map(|value| (value * 255.0).round() as u8)
        });
        Picture { width, height, rgb: rgb.collect() }
    };
    (header.clone(), frames.map(picture).collect())
}

/// The greatest difference in a channel, of 255.
fn farthest(a: &Picture, b: &Picture) -> u8 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.rgb.as_flattened().iter().zip(b.rgb.as_flattened()).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

/// The names in the sandbox beginning with `film` or a dot.
fn left(sandbox: &Sandbox) -> Vec<String> {
    let names = std::fs::read_dir(sandbox.path("")).expect("a folder");
    let names = names.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with("film") || name.starts_with('.')).collect()
}

/// Runs `render --movie` with this PATH.
fn render_with(sandbox: &Sandbox, path: &str, line: &str) -> (Option<i32>, String) {
    let output = sandbox.command().args(line.split_whitespace()).env("PATH", path).output().expect("it runs");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_gif_has_the_pictures_of_all_steps() {
    let sandbox = packed();
    let (code, _, said) = sandbox.run(&format!("render flow.zarr --movie film.gif --rate 10 --time all {SCENE}"));
    assert!(code == 0 && said.contains("wrote film.gif, a movie of 6 pictures"), "{code}: {said}");
    let (expected, found) = (pictures(&sandbox, "--time all", 6), read_gif(&sandbox.path("film.gif")));
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        let mut colours = expected.rgb.clone();
        colours.sort_unstable();
        colours.dedup();
        // A palette has room for all of them.
        assert!((10..=256).contains(&colours.len()), "{}", colours.len());
        assert_eq!(found, expected);
    }
    assert_eq!(left(&sandbox), ["film.gif"]);
}

#[test]
fn a_y4m_has_every_pixel_within_two() {
    let sandbox = packed();
    let line = format!("render flow.zarr --movie film.y4m --time all --orbit 3 {SCENE}");
    sandbox.run_ok(&line);
    let bytes = sandbox.read("film.y4m");
    let (header, found) = read_y4m(&bytes);
    assert_eq!(header, "YUV4MPEG2 W25 H23 F24:1 Ip A1:1 C444 XYSCSS=444 XCOLORRANGE=LIMITED XMATRIX=BT709");
    let expected = pictures(&sandbox, "--time all --orbit 3", 6);
    assert_eq!(found.len(), expected.len());
    // Half a code of 219 in luma and of 224 in chroma is at most 1.6 of 255, rounded.
    found.iter().zip(&expected).for_each(|(found, expected)| assert!(farthest(found, expected) <= 2));
    let (code, _, stderr) = sandbox.run(&line);
    assert!(code == 2 && stderr.contains("film.y4m") && stderr.contains("--overwrite"), "{code}: {stderr}");
    sandbox.run_ok(&format!("{line} --overwrite"));
    assert!(sandbox.read("film.y4m") == bytes, "the same movie each time");
}

/// Two cameras, a quarter of a turn apart, with time steps or without.
fn cameras(sandbox: &Sandbox, name: &str, times: [&str; 2]) {
    let camera = |eye: &str, time: &str| {
        format!(
            r#"{{"eye": {eye}, "target": [4, 3.5, 3], "up": [0, 0, 1], "projection": {{"perspective": {{"fov_y_deg": 30}}}}{time}}}"#
        )
    };
    let [first, last] = times;
    sandbox.write(name, format!("[{}, {}]", camera("[4, -26.5, 3]", first), camera("[34, 3.5, 3]", last)));
}

#[test]
fn a_path_drives_camera_and_time_steps() {
    let sandbox = packed();
    cameras(&sandbox, "timed.json", [r#", "time": 0"#, r#", "time": 5"#]);
    cameras(&sandbox, "path.json", ["", ""]);
    // Along the path, all steps; the camera moves as without steps.
    let found = pictures(&sandbox, "--path timed.json --frames 6", 6);
    assert_eq!(found, pictures(&sandbox, "--path timed.json --frames 6", 6), "the same pictures each time");
    assert_eq!(found, pictures(&sandbox, "--path path.json --frames 6 --time all", 6));
    assert_ne!(found[0], found[1]);
    // Eleven pictures show each step twice, and the last one once, from other places.
    let slow = pictures(&sandbox, "--path timed.json --frames 11", 11);
    let step = |i: usize| format!("--path path.json --frames 11 --time {i}");
    for i in [0, 3, 4, 10] {
        assert_eq!(slow[i], pictures(&sandbox, &step(i / 2), 11)[i], "picture {i}");
    }
    // Without a number of frames, a picture for each camera; a scene's own step is overridden.
    sandbox.write("scene.json", r#"{"time": 3}"#);
    let listed = pictures(&sandbox, "--path timed.json --scene scene.json", 2);
    assert_eq!(listed, [found[0].clone(), found[5].clone()]);
    // In a movie they are the same.
    for name in ["film.y4m", "film2.y4m"] {
        sandbox.run_ok(&format!("render flow.zarr --movie {name} --path timed.json --frames 6 {SCENE}"));
    }
    assert!(sandbox.read("film.y4m") == sandbox.read("film2.y4m"));
    let (_, movie) = read_y4m(&sandbox.read("film.y4m"));
    assert!(movie.iter().zip(&found).all(|(found, expected)| farthest(found, expected) <= 2));
}

#[test]
fn without_ffmpeg_an_mp4_is_refused_at_once() {
    let sandbox = packed();
    let (code, said) = render_with(&sandbox, "", &format!("render flow.zarr --movie film.mp4 --time all {SCENE}"));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("film.mp4") && said.contains("ffmpeg") && said.contains(".gif or .y4m"), "{said}");
    assert!(!said.contains("backend:"), "nothing is drawn: {said}");
    assert!(left(&sandbox).is_empty());
}

/// Puts a script named ffmpeg into the sandbox, and returns a PATH with it in front.
#[cfg(unix)]
fn ffmpeg(sandbox: &Sandbox, script: &str) -> String {
    use std::os::unix::fs::PermissionsExt;
    let folder = sandbox.path("bin");
    std::fs::create_dir_all(&folder).expect("the sandbox is writable");
    let program = folder.join("ffmpeg");
    std::fs::write(&program, format!("#!/bin/sh\n{script}")).expect("the sandbox is writable");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("it is ours");
    format!("{}:{}", folder.display(), std::env::var("PATH").unwrap_or_default())
}

#[cfg(unix)]
#[test]
fn ffmpeg_is_given_every_picture_in_an_even_size() {
    let sandbox = packed();
    // Its last argument is the file.
    let path = ffmpeg(&sandbox, "for last; do :; done\nexec cat > \"${last#file:}\"\n");
    let (code, said) = render_with(&sandbox, &path, &format!("render flow.zarr --movie film.mp4 --time all {SCENE}"));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("film.mp4: its pictures are 26x24"), "{said}");
    let (header, found) = read_y4m(&sandbox.read("film.mp4"));
    assert!(header.starts_with("YUV4MPEG2 W26 H24 F24:1 "), "{header}");
    let expected = pictures(&sandbox, "--time all", 6);
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        let rows = found.rgb.chunks(26).take(23).flat_map(|row| row[..25].to_vec()).collect();
        assert!(farthest(&Picture { width: 25, height: 23, rgb: rows }, expected) <= 2);
        assert!(
            found.rgb.chunks(26).all(|row| row[25] == row[24]) && found.rgb[26 * 22..26 * 23] == found.rgb[26 * 23..]
        );
    }
    assert_eq!(left(&sandbox), ["film.mp4"]);
}

#[cfg(unix)]
#[test]
fn what_ffmpeg_says_is_told_and_nothing_is_left() {
    let sandbox = packed();
    sandbox.write("film.mp4", "before");
    let line = format!("render flow.zarr --movie film.mp4 --overwrite --time all {SCENE}");
    // A missing encoder is detected before any drawing.
    let path = ffmpeg(&sandbox, "echo 'Unknown encoder libx264' >&2\nexit 8\n");
    let (code, said) = render_with(&sandbox, &path, &line);
    assert!(code == Some(1) && said.contains("film.mp4") && said.contains("Unknown encoder libx264"), "{said}");
    assert!(said.contains("exit status: 8") && !said.contains("backend:"), "{said}");
    // It encodes the trial and then fails: in the middle, at the end, and by a signal.
    for (failing, words) in [
        ("head -c 300 > /dev/null; echo 'no room' >&2; exit 3", "exit status: 3): no room"),
        ("cat > /dev/null; echo 'no end' >&2; exit 4", "exit status: 4): no end"),
        ("cat > /dev/null; kill -9 $$", "signal: 9"),
    ] {
        let script = format!("if [ -e tried ]; then {failing}; fi\ntouch tried\nexec cat > /dev/null\n");
        let (code, said) = render_with(&sandbox, &ffmpeg(&sandbox, &script), &line);
        assert!(code == Some(1) && said.contains("film.mp4") && said.contains(words), "{failing}: {said}");
        assert!(said.contains("backend:"), "{said}");
        assert_eq!(left(&sandbox), ["film.mp4"], "{failing}");
        assert_eq!(sandbox.read("film.mp4"), b"before", "{failing}");
        std::fs::remove_file(sandbox.path("tried")).expect("it was tried");
    }
}

#[test]
fn an_mp4_has_the_pictures_of_all_steps() {
    let mut version = Command::new("ffmpeg");
    if !version.arg("-version").output().is_ok_and(|output| output.status.success()) {
        leave_out("ffmpeg", "ffmpeg is not installed");
        return;
    }
    let sandbox = packed();
    sandbox.run_ok(&format!("render flow.zarr --movie film.mp4 --time all {SCENE}"));
    let mut decode = Command::new("ffmpeg");
    decode.args(["-v", "error", "-i"]).arg(sandbox.path("film.mp4"));
    let decoded = decode.args(["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]).output().expect("it runs");
    let expected = pictures(&sandbox, "--time all", 6);
    let (frames, rest) = decoded.stdout.as_chunks::<{ 26 * 24 * 3 }>();
    assert_eq!((frames.len(), rest.len()), (expected.len(), 0));
    for (frame, expected) in frames.iter().zip(&expected) {
        let rows = frame.chunks(26 * 3).take(23).flat_map(|row| &row[..25 * 3]);
        let squared = rows.zip(expected.rgb.as_flattened()).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
        // H.264, and colours at half the resolution: such small pictures are mostly edges. A wrong range, matrix or order is off by more.
        let off = (squared.sum::<f64>() / (25.0 * 23.0 * 3.0)).sqrt();
        assert!(off < 12.0, "{off} of 255");
    }
}

/// No partial file has the movie's name after an interrupt.
#[cfg(unix)]
#[test]
fn an_interrupted_movie_is_not_there() {
    let sandbox = packed();
    let line = format!("render flow.zarr --movie film.y4m --orbit 1000000 {SCENE}");
    let mut command = sandbox.command();
    let mut child = command.args(line.split_whitespace()).stderr(std::process::Stdio::null()).spawn().expect("it runs");
    let begun = || {
        let files = std::fs::read_dir(sandbox.path("")).expect("a folder").map(|entry| entry.expect("an entry"));
        let mut temporary = files.filter(|entry| entry.file_name().to_string_lossy().starts_with(".film.y4m"));
        temporary.any(|entry| entry.metadata().is_ok_and(|metadata| metadata.len() > 10_000))
    };
    let mut waited = 0;
    while !begun() {
        waited += 1;
        assert!(waited < 6000, "it has written nothing for a minute");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    // Not INT: shells ignore it for tests in the background.
    let killed = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success() && !child.wait().expect("it is ours").success());
    assert!(!sandbox.path("film.y4m").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_no_movie_and_is_told() {
    let trial = brickyard_tests::faults::Trial::default();
    let voxels = (0..STEPS * 1000).map(|value| (value % 251) as u8).collect::<Vec<u8>>();
    trial.sandbox.write("flow.raw", voxels);
    let pack = "pack flow.raw flow.zarr --shape 10,10,10 --dtype u8 --axes tzyx --times 6 --brick 16 --progress none";
    assert_eq!(trial.run(pack, "").code, Some(0));
    for (name, rule) in [
        ("film.gif", "write 1+ ENOSPC film"),
        ("film.y4m", "write 1+ ENOSPC film"),
        ("film.y4m", "write 2+ ENOSPC film"),
        ("film.y4m", "rename 1 EIO film"),
        ("film.gif", "open 1 EACCES film"),
    ] {
        let line = format!("render flow.zarr --movie {name} --time all --mode mip --backend cpu --size 64x64 -j 2");
        let outcome = trial.run(&line, rule);
        assert!(outcome.code == Some(1) && !outcome.hung, "{rule}: {}", outcome.stderr);
        assert!(outcome.stderr.contains(name) && !outcome.stderr.contains("panicked"), "{rule}: {}", outcome.stderr);
        assert!(left(&trial.sandbox).is_empty(), "{rule}: {:?}", left(&trial.sandbox));
        let outcome = trial.run(&line, "");
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        std::fs::remove_file(trial.sandbox.path(name)).expect("it is there now");
    }
}
