//! PNG files, written whole under a temporary name, then renamed; text chunks keep the picture's origin.

use crate::files::whole_file::write_whole;
use crate::stats::RenderStats;
use brickyard_volume::{Picture, Scene};
use std::io::Write;
use std::path::{Path, PathBuf};

/// An error in writing a picture.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}", path = path.display())]
pub struct PictureError {
    /// Path of the file.
    pub path: PathBuf,
    /// Description of the failure.
    pub reason: String,
}

/// Writes a picture as an 8-bit RGB PNG file, with `(keyword, text)` notes in text chunks.
///
/// # Errors
/// If the file cannot be written; an earlier file at `path` then stays.
pub fn write_png(path: &Path, picture: &Picture, notes: &[(&str, String)]) -> Result<(), PictureError> {
    let written = write_whole(path, |file| encode(file, picture, notes));
    written.map_err(|error| PictureError { path: path.to_path_buf(), reason: error.to_string() })
}

/// Writes a picture as a PNG file, with its scene and its counts of bricks in text chunks.
///
/// # Errors
/// If the file cannot be written; an earlier file at `path` then stays.
pub fn write_shown(path: &Path, picture: &Picture, shown: &Scene, stats: &RenderStats) -> Result<(), PictureError> {
    let fail = |error: serde_json::Error| PictureError { path: path.to_path_buf(), reason: error.to_string() };
    write_png(path, picture, &notes(shown, stats).map_err(fail)?)
}

/// Writes a picture like [`write_shown`], to any writer.
///
/// # Errors
/// If it cannot be written.
pub fn send_shown(to: &mut impl Write, picture: &Picture, shown: &Scene, stats: &RenderStats) -> std::io::Result<()> {
    encode(to, picture, &notes(shown, stats)?).map_err(std::io::Error::other)?;
    to.flush()
}

/// Returns the text chunks of a picture's file: the program, the scene, and the counts of bricks.
fn notes(shown: &Scene, stats: &RenderStats) -> serde_json::Result<[(&'static str, String); 3]> {
    let bricks = &stats.bricks;
    Ok([
        ("Software", format!("brickyard {}", env!("CARGO_PKG_VERSION"))),
        ("Scene", serde_json::to_string(shown)?),
        ("Bricks", format!("{} of {} wanted, {} failed", bricks.resident, bricks.wanted, bricks.failed)),
    ])
}

fn encode(file: &mut impl Write, picture: &Picture, notes: &[(&str, String)]) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(file, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    for (keyword, text) in notes {
        encoder.add_itxt_chunk(keyword.to_string(), text.clone())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(picture.rgb.as_flattened())?;
    writer.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ein Bild.png");
        let picture = Picture { width: 2, height: 1, rgb: vec![[1, 2, 3], [253, 254, 255]] };
        write_png(&path, &picture, &[("Scene", "{\"ä\": 1}".into())]).unwrap();
        let mut reader =
            png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap())).read_info().unwrap();
        let mut bytes = [0; 6];
        reader.next_frame(&mut bytes).unwrap();
        assert_eq!(bytes, [1, 2, 3, 253, 254, 255]);
        assert_eq!(reader.info().utf8_text[0].keyword, "Scene");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
    }

    #[test]
    fn an_impossible_place_is_named() {
        let picture = Picture { width: 1, height: 1, rgb: vec![[0; 3]] };
        let error = write_png(Path::new("/nonexistent/folder/a.png"), &picture, &[]).unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder/a.png"));
    }
}
