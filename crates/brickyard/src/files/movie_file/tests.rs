//! Movies of a few pictures: the contents of their files, and no remains of failed ones.

use super::*;

/// Creates pictures of this size, all different, each of few colours.
fn pictures((width, height): (u32, u32), count: u8) -> Vec<Picture> {
    let rgb = |i: u8| (0..width * height).map(|p| [i * 40, (p % 5) as u8 * 50, 255 - i * 20]).collect();
    (0..count).map(|i| Picture { width, height, rgb: rgb(i) }).collect()
}

fn rate(text: &str) -> PictureRate {
    text.parse().unwrap()
}

fn write(path: &Path, pictures: &[Picture], rate: PictureRate) -> Result<(), MovieError> {
    let mut movie = MovieFile::create(path, (pictures[0].width, pictures[0].height), rate)?;
    pictures.iter().try_for_each(|picture| movie.push(picture))?;
    movie.finish()
}

/// Reads the pictures of a GIF, and the time of each in hundredths of a second.
fn read_gif(path: &Path) -> (Vec<Vec<[u8; 3]>>, Vec<u16>) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(std::fs::File::open(path).unwrap()).unwrap();
    let (mut pictures, mut delays) = (Vec::new(), Vec::new());
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        pictures.push(frame.buffer.as_chunks::<4>().0.iter().map(|&[r, g, b, _]| [r, g, b]).collect());
        delays.push(frame.delay);
    }
    (pictures, delays)
}

#[test]
fn a_gif_has_each_picture_and_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a film.GIF");
    let pictures = pictures((9, 7), 4);
    write(&path, &pictures, rate("24")).unwrap();
    let (found, delays) = read_gif(&path);
    assert_eq!(found, pictures.into_iter().map(|picture| picture.rgb).collect::<Vec<_>>());
    assert_eq!(delays, [4, 4, 5, 4], "24 pictures a second");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}

#[test]
fn a_gif_of_many_colours_is_near_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (64, 64);
    let rgb = (0..width * height).map(|p| [(p % 64 * 4) as u8, (p / 64 * 4) as u8, 90]).collect();
    let picture = Picture { width, height, rgb };
    let paths = ["a.gif", "b.gif"].map(|name| folder.path().join(name));
    paths.iter().for_each(|path| write(path, &[picture.clone(), picture.clone()], rate("10")).unwrap());
    assert!(std::fs::read(&paths[0]).unwrap() == std::fs::read(&paths[1]).unwrap());
    let squared = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
    for found in read_gif(&paths[0]).0 {
        let sum: f64 = found.as_flattened().iter().zip(picture.rgb.as_flattened()).map(squared).sum();
        // 4096 colours in 256: an even grid of these would be off by 5.8 in two channels, 4.7 over three.
        let off = (sum / (3 * width * height) as f64).sqrt();
        assert!(off < 7.0, "{off} of 255");
    }
}

#[test]
fn what_is_not_finished_leaves_what_was_there() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["f.gif", "f.y4m"] {
        let path = folder.path().join(name);
        std::fs::write(&path, "before").unwrap();
        let pictures = pictures((4, 4), 2);
        let mut movie = MovieFile::create(&path, (4, 4), rate("24")).unwrap();
        movie.push(&pictures[0]).unwrap();
        let other = Picture { width: 3, height: 4, rgb: vec![[0; 3]; 12] };
        assert!(movie.push(&other).unwrap_err().to_string().contains("3x4 pixels in a movie of 4x4"));
        drop(movie);
        assert_eq!(std::fs::read(&path).unwrap(), b"before", "{name}");
        write(&path, &pictures, rate("24")).unwrap();
        assert_ne!(std::fs::read(&path).unwrap(), b"before", "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file stays");
}

#[test]
fn what_cannot_be_written_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let create =
        |name: &str, size_px, of: &str| MovieFile::create(&folder.path().join(name), size_px, rate(of)).map(drop);
    for (name, size_px, of, parts) in [
        ("f.webm", (4, 4), "24", &["f.webm", ".gif, .y4m or .mp4"][..]),
        ("f", (4, 4), "24", &[".gif, .y4m or .mp4"]),
        (".gif", (4, 4), "24", &[".gif, .y4m or .mp4"]),
        ("f.gif", (70_000, 4), "24", &["70000x4", "65535"]),
        ("f.gif", (4, 4), "60", &["at most 50 pictures a second, not 60"]),
        ("f.y4m", (0, 4), "24", &["0x4"]),
        ("none/f.gif", (4, 4), "24", &["none/f.gif", "No such file"]),
        ("none/f.mp4", (4, 4), "24", &["none/f.mp4", "No such file"]),
    ] {
        let message = create(name, size_px, of).unwrap_err().to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
