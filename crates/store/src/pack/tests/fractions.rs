//! Labels in floats: whole numbers, or a refusal that names the first other one.

use super::*;
use crate::append::{AppendOptions, Appender};
use crate::edit::{Edit, edit};

const EXTENT: [u32; 3] = [40, 33, 20];

fn of_labels() -> PackOptions {
    PackOptions { kind: Kind::Labels, downsample: Downsample::Mode.into(), ..options(VoxelType::F32) }
}

/// Labels, voxels without data, and these others.
fn labels(others: &[([u32; 3], f32)]) -> Array<f32> {
    let other = |p| others.iter().find(|(place, _)| *place == p).map(|(_, value)| *value);
    Array::series(EXTENT, 1, 1, |_, p| match p {
        [3, 2, _] => f32::NAN,
        [4, 2, _] => f32::INFINITY,
        [x, y, z] => other(p).unwrap_or((x / 8 + y / 8 + z / 8) as f32 - 2.0),
    })
}

#[test]
fn whole_numbers_are_packed_as_labels_and_others_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("l.zarr");
    // The second brick has the first two.
    let others = [([2, 1, 17], 0.25), ([39, 32, 19], -1.5), ([17, 0, 1], 2.5), ([17, 3, 0], 6.75)];
    for access in [Access::Box, Access::Planes] {
        let array = Array { access, ..labels(&[]) };
        pack(&array, &path, &of_labels(), &()).unwrap();
        std::fs::remove_dir_all(&path).unwrap();
        let array = Array { access, ..labels(&others) };
        for threads in [1, 3] {
            let options = PackOptions { threads, ..of_labels() };
            let error = pack(&array, &path, &options, &()).unwrap_err();
            assert_eq!(
                error.to_string(),
                "the input's label at 17,3,0 (x, y, z) of time step 0, channel 0 is 6.75: expected whole numbers; pack it as an \
                 image, with `kind` image"
            );
            assert!(matches!(error, PackError::Unfit { .. }) && !path.exists());
        }
    }
    pack(&labels(&others), &path, &options(VoxelType::F32), &()).unwrap();
    let before = files(&path);
    let refused = edit(&path, &Edit { kind: Some(Kind::Labels), ..Edit::default() }).unwrap_err().to_string();
    assert!(refused.contains("17,3,0") && refused.contains("6.75") && refused.ends_with("is unchanged"), "{refused}");
    assert_same(&files(&path), &before, "a refused edit");
}

#[test]
fn steps_with_fractions_are_no_steps_of_labels() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("l.zarr");
    Appender::create(&path, &labels(&[]), Some(0.0), &of_labels(), &()).unwrap();
    let mut appender = Appender::open(&path, AppendOptions { memory_bytes: 1 << 30, threads: 2 }).unwrap();
    let refused = appender.append(&labels(&[([0, 32, 19], 0.5)]), None, &()).unwrap_err().to_string();
    assert!(refused.contains("0,32,19") && refused.contains("is 0.5") && appender.times() == 1, "{refused}");
    appender.append(&labels(&[]), None, &()).unwrap();
    assert_eq!(Store::open(&path).unwrap().times(), 2);
}
