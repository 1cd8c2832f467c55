//! Labels by a file's own word: segmentations of DICOM, NIfTI's intent, and 3D Slicer's keys in NRRD. Costs the headers of the files.

use crate::format::Format;
use crate::format_of::format_of;
use crate::grids::{Entry, GridList};
use crate::note::Note;
use crate::open::{Named, paths_of};
use crate::options::OpenOptions;
use crate::variable::split_variable;
use crate::{dicom, nifti, nrrd, pipe};
use std::path::{Path, PathBuf};

const OF_DICOM: &str = "the kind of DICOM file, a segmentation";

/// The files' word that all their voxels are labels, in a sentence; `None` if one file does not say so, or cannot be examined. It is the
/// caller's to heed, by [`OpenOptions::are_labels`].
pub fn labels_said(inputs: &[PathBuf], options: &OpenOptions) -> Option<Note> {
    if matches!(options.component.as_deref(), Some("magnitude" | "phase")) {
        return None;
    }
    let word = match &options.channel_arrays[..] {
        [] => word_of_all(inputs, options),
        arrays => common(arrays.iter().map(|array| {
            let (inputs, alone) = array.opening(inputs, options);
            word_of_all(&inputs, &alone)
        })),
    };
    word.map(|word| {
        Note::new(format!("The voxels are labels, by {word}, and never averaged; `kind` image makes them an image."))
    })
}

/// The word of one volume's files.
fn word_of_all(inputs: &[PathBuf], options: &OpenOptions) -> Option<&'static str> {
    let (inputs, options) = split_variable(inputs, options).ok()?;
    if inputs.iter().any(|input| pipe::is_pipe(input)) {
        return None;
    }
    let Named { paths, is_folder, .. } = paths_of(&inputs, &options).ok()?;
    match format_of(paths.first()?, &options).ok()? {
        // Of several series in a folder one is read.
        Format::Dicom if options.variable.is_some() => {
            dicom::chosen_are_labels(&paths, is_folder, &options).ok()?.then_some(OF_DICOM)
        }
        Format::Grids => {
            let list = GridList::read(&paths[0]).ok()?;
            let word =
                |entry: &Entry| word_of_all(std::slice::from_ref(&entry.input), &list.options(entry, &options).ok()?);
            common(list.entries.iter().map(word))
        }
        _ => common(paths.iter().map(|file| word_of(file, &options))),
    }
}

/// The first word, if all have one.
fn common(words: impl Iterator<Item = Option<&'static str>>) -> Option<&'static str> {
    let mut first = None;
    for word in words {
        first = first.or(Some(word?));
    }
    first
}

fn word_of(path: &Path, options: &OpenOptions) -> Option<&'static str> {
    // Files that cannot be examined are reported on opening.
    let (are_labels, word) = match format_of(path, options).ok()? {
        Format::Dicom => (dicom::are_labels(path), OF_DICOM),
        Format::Nifti => (nifti::are_labels(path), "the header's intent (NIFTI_INTENT_LABEL)"),
        Format::Nrrd => (nrrd::are_labels(path), "the header's segments (3D Slicer)"),
        _ => return None,
    };
    are_labels.ok()?.then_some(word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{ArrayPlace, ChannelArray};
    use crate::testing::temp_file;

    fn says(name: &str, bytes: &[u8]) -> bool {
        let (_folder, path) = temp_file(name, bytes);
        labels_said(&[path], &OpenOptions::default()).is_some()
    }

    /// A NIfTI volume of 2 voxels of 16 bits, with a code of intent, a slope and a type.
    fn nifti(intent: i16, slope: f32, datatype: i16) -> Vec<u8> {
        let mut bytes = vec![0; 352 + 8];
        let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
        put(0, &348i32.to_le_bytes());
        for (i, size) in [3i16, 2, 1, 1, 1].iter().enumerate() {
            put(40 + 2 * i, &size.to_le_bytes());
        }
        put(68, &intent.to_le_bytes());
        put(70, &datatype.to_le_bytes());
        put(72, &if datatype == 16 { 32i16 } else { 16 }.to_le_bytes());
        put(108, &352f32.to_le_bytes());
        put(112, &slope.to_le_bytes());
        put(344, b"n+1\0");
        bytes
    }

    #[test]
    fn nifti_says_so_by_its_intent() {
        assert!(says("a.nii", &nifti(1002, 1.0, 4)) && says("a.nii", &nifti(1002, 0.0, 512)));
        for (intent, slope, datatype) in [(0, 1.0, 4), (1001, 1.0, 4), (1002, 0.5, 4), (1002, 1.0, 16)] {
            assert!(!says("a.nii", &nifti(intent, slope, datatype)), "{intent} {slope} {datatype}");
        }
        // Of NIfTI-2, at another place.
        let mut two = vec![0; 544 + 2];
        let mut put = |at: usize, value: &[u8]| two[at..at + value.len()].copy_from_slice(value);
        put(0, &540i32.to_le_bytes());
        put(4, b"n+2\0\r\n\x1a\n");
        put(12, &512i16.to_le_bytes());
        put(14, &16i16.to_le_bytes());
        for (i, size) in [3i64, 1, 1, 1].iter().enumerate() {
            put(16 + 8 * i, &size.to_le_bytes());
        }
        put(168, &544i64.to_le_bytes());
        assert!(!says("a.nii", &two));
        two[504..508].copy_from_slice(&1002i32.to_le_bytes());
        assert!(says("a.nii", &two));
    }

    #[test]
    fn slicer_says_so_by_its_segments() {
        let nrrd = |kind: &str, keys: &str| {
            let head = format!(
                "NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 2 1 1\nencoding: raw\nendian: little\n{keys}\n\n"
            );
            [head.as_bytes(), &[0; 8]].concat()
        };
        let segment = "Segment0_ID:=Segment_1\nSegment0_LabelValue:=1";
        assert!(says("a.seg.nrrd", &nrrd("uchar", segment)));
        let binary = format!("Segmentation_MasterRepresentation:=Binary labelmap\n{segment}");
        assert!(says("a.nrrd", &nrrd("short", &binary)));
        let fractional = format!("{segment}\nSegmentation_SourceRepresentation:=Fractional labelmap");
        for (kind, keys) in
            [("uchar", "Segments_ID:=1"), ("float", segment), ("uchar", &fractional), ("uchar", "# Segment0_ID")]
        {
            assert!(!says("a.seg.nrrd", &nrrd(kind, keys)), "{kind} {keys}");
        }
    }

    #[test]
    fn all_files_must_say_so_and_no_magnitude_is_one() {
        let (folder, first) = temp_file("a1.nii", &nifti(1002, 1.0, 4));
        let second = folder.path().join("a2.nii");
        std::fs::write(&second, nifti(1002, 1.0, 4)).unwrap();
        let plain = OpenOptions::default();
        let both = [first.clone(), second.clone()];
        let note = labels_said(&both, &plain).unwrap();
        assert!(note.contains("NIFTI_INTENT_LABEL") && note.contains("`kind` image"), "{}", &*note);
        assert!(labels_said(&[folder.path().to_owned()], &plain).is_some());
        let magnitude = OpenOptions { component: Some("magnitude".into()), ..plain.clone() };
        assert!(labels_said(&both, &magnitude).is_none());
        let layer = OpenOptions { component: Some("0".into()), ..plain.clone() };
        assert!(labels_said(&both, &layer).is_some());
        let list = folder.path().join("list.json");
        let says_list = |files: [&str; 2]| {
            let grids = files.map(|file| format!("{{\"file\": \"{file}\"}}"));
            std::fs::write(&list, format!("{{\"grids\": [{}]}}", grids.join(","))).unwrap();
            labels_said(std::slice::from_ref(&list), &plain).is_some()
        };
        assert!(says_list(["a1.nii", "a2.nii"]) && !says_list(["a1.nii", "none.nii"]));
        std::fs::remove_file(&list).unwrap();
        std::fs::write(&second, nifti(0, 1.0, 4)).unwrap();
        assert!(labels_said(&both, &plain).is_none());
        let array = |file: &PathBuf| ChannelArray { name: "a".into(), place: ArrayPlace::File(file.clone()) };
        let channels = |files: &[&PathBuf]| OpenOptions {
            channel_arrays: files.iter().map(|file| array(file)).collect(),
            ..plain.clone()
        };
        assert!(labels_said(&[], &channels(&[&first])).is_some());
        assert!(labels_said(&[], &channels(&[&first, &second])).is_none());
        assert!(labels_said(&[folder.path().join("none.nii")], &plain).is_none() && labels_said(&[], &plain).is_none());
    }
}
