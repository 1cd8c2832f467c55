//! The kind of voxels by a file's own word: DICOM's classes, NIfTI's intent, and 3D Slicer's keys in NRRD. Its reader takes it from the header, adapters
//! pass it on, and joined files must agree. Costs nothing.

use crate::error::{ImportError, Result};
use crate::note::Note;
use std::path::Path;

/// Kind of voxels by a file's own word, with its place in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SaidKind {
    /// No word: most formats have none.
    #[default]
    Unsaid,
    /// Names of things.
    Labels(&'static str),
    /// Measurements.
    Image(&'static str),
}

impl SaidKind {
    /// Whether all voxels are labels, by the file.
    pub fn are_labels(self) -> bool {
        matches!(self, Self::Labels(_))
    }

    /// A note on labels, which are taken as such.
    pub(crate) fn note(self) -> Option<Note> {
        let Self::Labels(word) = self else { return None };
        Some(Note::new(format!(
            "The voxels are labels, by {word}, and never averaged; `kind` image makes them an image."
        )))
    }

    /// The kind of voxels of several files, each named for messages. `is_told`: the caller tells the kind of all.
    ///
    /// # Errors
    /// If some say labels, and others do not: a volume is of one kind, and nobody tells which.
    pub(crate) fn of_all<'a>(files: impl IntoIterator<Item = (&'a Path, Self)>, is_told: bool) -> Result<Self> {
        let mut files = files.into_iter();
        let Some((first_path, mut all)) = files.next() else { return Ok(Self::Unsaid) };
        for (path, kind) in files {
            let (labels, other) = match (all, kind) {
                (Self::Labels(_), Self::Labels(_)) | (Self::Image(_), Self::Image(_)) => continue,
                (Self::Labels(_), _) => (first_path, path),
                (_, Self::Labels(_)) => (path, first_path),
                _ => {
                    all = Self::Unsaid;
                    continue;
                }
            };
            if !is_told {
                let problem = format!(
                    "says that its voxels are labels, but {} does not, and one store has one kind: pack each by itself, or pass \
                     `kind` labels or image for all",
                    other.display()
                );
                return Err(ImportError::options(labels, problem));
            }
            all = Self::Unsaid;
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open::open;
    use crate::options::{ArrayPlace, ChannelArray, OpenOptions};
    use crate::source::SourceInfo;
    use crate::testing::{said, temp_file};
    use brickyard_volume::{VoxelBox, VoxelType};
    use std::path::PathBuf;

    fn described(paths: &[PathBuf], options: &OpenOptions) -> Result<SourceInfo, String> {
        open(paths, options).map(|source| source.info().clone()).map_err(|error| error.to_string())
    }

    fn says(name: &str, bytes: &[u8]) -> bool {
        let (_folder, path) = temp_file(name, bytes);
        described(&[path], &OpenOptions::default()).unwrap().kind.are_labels()
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

    /// The note tells the word, unless the caller's counts.
    #[test]
    fn adapters_pass_the_word_on() {
        let (_folder, path) = temp_file("a.nii", &nifti(1002, 1.0, 4));
        let paths = [path];
        let told = |options: OpenOptions| {
            let info = described(&paths, &options).unwrap();
            (info.kind.are_labels(), said(&info.notes).matches("NIFTI_INTENT_LABEL").count())
        };
        let plain = OpenOptions::default;
        let roi = Some(VoxelBox::new([0, 0, 0], [1, 1, 1]));
        let take_channel = vec!["0".parse().unwrap()];
        for options in [
            plain(),
            OpenOptions { roi, ..plain() },
            OpenOptions { flip: Some([true; 3]), ..plain() },
            OpenOptions { take_channel, ..plain() },
            OpenOptions { to_voxel_type: Some(VoxelType::I32), ..plain() },
        ] {
            assert_eq!(told(options.clone()), (true, 1), "{options:?}");
        }
        for are_labels in [true, false] {
            assert_eq!(told(OpenOptions { are_labels: Some(are_labels), ..plain() }), (true, 0));
        }
    }

    /// Signed numbers of 64 bits become unsigned as labels alone, and these are never clamped.
    #[test]
    fn numbers_are_read_by_the_word() {
        let wide = |intent: i16| {
            let mut bytes = nifti(intent, 1.0, 1024);
            bytes[72..74].copy_from_slice(&64i16.to_le_bytes());
            bytes.truncate(352);
            bytes.extend([3_000_000_000i64, 5].map(i64::to_le_bytes).as_flattened());
            bytes
        };
        let (folder, labels) = temp_file("labels.nii", &wide(1002));
        let image = folder.path().join("image.nii");
        std::fs::write(&image, wide(0)).unwrap();
        let [of_labels, of_image] = [labels, image].map(|path| [path]);
        let plain = OpenOptions::default();
        assert_eq!(described(&of_labels, &plain).unwrap().voxel_type, VoxelType::U32);
        assert!(described(&of_image, &plain).unwrap_err().contains("the value 3000000000 cannot be held"));
        let told = OpenOptions { are_labels: Some(false), ..plain.clone() };
        assert!(described(&of_labels, &told).unwrap_err().contains("`allow_lossy`"));
        let narrow = OpenOptions { to_voxel_type: Some(VoxelType::U8), allow_lossy: true, ..plain };
        assert!(described(&of_labels, &narrow).unwrap_err().contains("labels become others"));
    }

    #[test]
    fn joined_files_have_one_word_unless_the_caller_has() {
        let (folder, first) = temp_file("a1.nii", &nifti(1002, 1.0, 4));
        let second = folder.path().join("a2.nii");
        let list = folder.path().join("list.json");
        let grids: Vec<String> = (1..3)
            .map(|i| format!("{{\"file\": \"a{i}.nii\", \"spacing\": [1, 1, 1], \"origin\": [{i}, 0, 0]}}"))
            .collect();
        std::fs::write(&list, format!("{{\"grids\": [{}]}}", grids.join(","))).unwrap();
        let plain = OpenOptions::default();
        let array = |file: &PathBuf| ChannelArray {
            name: file.file_stem().unwrap().to_string_lossy().into(),
            place: ArrayPlace::File(file.clone()),
        };
        let channels = OpenOptions { channel_arrays: [&first, &second].map(array).to_vec(), ..plain.clone() };
        let pattern = folder.path().join("a*.nii");
        let joined = [
            (vec![first.clone(), second.clone()], plain.clone()),
            (vec![pattern], plain.clone()),
            (vec![list], plain.clone()),
            (Vec::new(), channels.clone()),
        ];
        std::fs::write(&second, nifti(1002, 1.0, 4)).unwrap();
        for (paths, options) in &joined {
            let info = described(paths, options).unwrap();
            assert!(info.kind.are_labels(), "{paths:?}");
            assert_eq!(said(&info.notes).matches("never averaged").count(), 1, "{paths:?}");
        }
        std::fs::write(&second, nifti(0, 1.0, 4)).unwrap();
        for (paths, options) in &joined {
            let message = described(paths, options).unwrap_err();
            let words = ["a1.nii: says that its voxels are labels", "a2.nii does not", "`kind` labels or image"];
            assert!(words.iter().all(|word| message.contains(word)), "{message}");
            for are_labels in [true, false] {
                let told = OpenOptions { are_labels: Some(are_labels), ..options.clone() };
                assert!(!described(paths, &told).unwrap().kind.are_labels(), "{paths:?}");
            }
        }
        // A component is one of the channels; numbers computed of them are no labels.
        std::fs::write(&second, nifti(1002, 1.0, 4)).unwrap();
        let of = |component: &str, are_labels| {
            described(&[], &OpenOptions { component: Some(component.into()), are_labels, ..channels.clone() })
        };
        assert!(of("a2", None).unwrap().kind.are_labels());
        assert!(of("magnitude", None).unwrap_err().contains("`kind` image"));
        assert_eq!(of("magnitude", Some(false)).unwrap().kind, SaidKind::Unsaid);
    }

    #[test]
    fn words_of_several_files_are_one_or_none() {
        use SaidKind::{Image, Labels, Unsaid};
        let all = |kinds: &[SaidKind], is_told| {
            let files = kinds.iter().map(|kind| (Path::new("a"), *kind));
            SaidKind::of_all(files, is_told).ok()
        };
        for (kinds, asked, told) in [
            (&[Labels("a"), Labels("b")][..], Some(Labels("a")), Some(Labels("a"))),
            (&[Image("a"), Image("a")], Some(Image("a")), Some(Image("a"))),
            (&[Image("a"), Unsaid, Image("a")], Some(Unsaid), Some(Unsaid)),
            (&[Labels("a"), Unsaid], None, Some(Unsaid)),
            (&[Unsaid, Labels("a")], None, Some(Unsaid)),
            (&[Labels("a"), Labels("a"), Image("a")], None, Some(Unsaid)),
            (&[Image("a"), Unsaid, Labels("a")], None, Some(Unsaid)),
            (&[Labels("a"), Unsaid, Labels("a")], None, Some(Unsaid)),
            (&[], Some(Unsaid), Some(Unsaid)),
        ] {
            assert_eq!((all(kinds, false), all(kinds, true)), (asked, told), "{kinds:?}");
        }
    }
}
