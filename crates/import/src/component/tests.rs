//! Components against analytic values.

use super::*;
use crate::channels::{Channels, NamedArray};
use crate::open::open;
use crate::options::NoData;
use crate::testing::{Field, assert_boxes, temp_file};
use brickyard_volume::Extent;

/// Opens `values` of `channels` channels, side by side along x, with a component. The file lasts as long as its folder's guard.
fn opened(
    values: &[f32],
    channels: u32,
    component: &str,
    told: OpenOptions,
) -> Result<(tempfile::TempDir, Box<dyn Source>), String> {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let (folder, path) = temp_file("a.raw", &bytes);
    let options = OpenOptions {
        shape: Some(Extent::new(values.len() as u32 / channels, 1, 1)),
        voxel_type: Some(VoxelType::F32.into()),
        channels: Some(channels),
        axes: Some("zyxc".parse().unwrap()),
        component: Some(component.into()),
        ..told
    };
    open(&[path], &options).map(|source| (folder, source)).map_err(|error| error.to_string())
}

fn floats(source: &dyn Source) -> Result<Vec<f32>, String> {
    let full = source.info().extent.full_box();
    let mut out = vec![0; full.extent().volume() as usize * 4];
    source.read_box(0, 0, full, &mut out).map_err(|error| error.to_string())?;
    Ok(out.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect())
}

#[test]
fn magnitudes_and_phases_are_those_of_vectors() {
    let plain = OpenOptions::default;
    let vectors = [3.0, 4.0, 0.0, -2.0, 3.0, 6.0, 0.0, 0.0, 0.0, 3e38, 0.0, 0.0];
    let (_folder, source) = opened(&vectors, 3, "magnitude", plain()).unwrap();
    assert_eq!(floats(&*source).unwrap(), [5.0, 7.0, 0.0, 3e38]);
    let info = source.info();
    assert_eq!((info.channels, info.channel_looks[0].name.as_deref()), (1, Some("magnitude")));
    assert!(info.notes.iter().any(|note| note.contains("magnitude of 0, 1, 2")));
    let numbers = [1.0, 0.0, 0.0, 2.0, -3.0, 0.0, 1.0, -1.0];
    let half_pi = std::f32::consts::FRAC_PI_2;
    let (_folder, source) = opened(&numbers, 2, "phase", plain()).unwrap();
    assert_eq!(floats(&*source).unwrap(), [0.0, half_pi, std::f32::consts::PI, -half_pi / 2.0]);
    let (_folder, source) = opened(&numbers, 2, "1", plain()).unwrap();
    assert_eq!(floats(&*source).unwrap(), [0.0, 2.0, 0.0, -1.0]);
}

#[test]
fn sums_beyond_f32_are_refused_or_allowed() {
    let great = [3e38, 3e38];
    let (_folder, source) = opened(&great, 2, "magnitude", OpenOptions::default()).unwrap();
    let message = floats(&*source).unwrap_err();
    assert!(message.contains("beyond f32") && message.contains("`allow_lossy`"), "{message}");
    let allowed = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
    let (_folder, source) = opened(&great, 2, "magnitude", allowed).unwrap();
    assert_eq!(floats(&*source).unwrap(), [f32::INFINITY]);
}

#[test]
fn voxels_without_data_have_no_magnitude() {
    let told = OpenOptions { nodata: NoData::Value(-9.0), ..OpenOptions::default() };
    let (_folder, source) = opened(&[-9.0, 4.0, 3.0, 4.0, 1.0, f32::NAN], 2, "magnitude", told).unwrap();
    let found = floats(&*source).unwrap();
    assert!(found[0].is_nan() && found[1] == 5.0 && found[2].is_nan(), "{found:?}");
    assert_eq!((source.info().nodata, source.info().knows_nodata), (None, true));
}

#[test]
fn components_are_called_by_names_before_words() {
    let field = Field { sizes: [4, 3, 2, 2, 1], voxel_type: VoxelType::I16 };
    let bytes = field.bytes("czyx", false);
    let part = |name: &str, bytes: &[u8]| {
        let (folder, path) = temp_file("a.raw", bytes);
        let options = OpenOptions {
            shape: Some(Extent::new(4, 3, 2)),
            voxel_type: Some(VoxelType::I16.into()),
            ..OpenOptions::default()
        };
        (folder, NamedArray { name: name.into(), path: path.clone(), source: open(&[path], &options).unwrap() })
    };
    let (_one, first) = part("1", &bytes[..bytes.len() / 2]);
    let (_two, second) = part("magnitude", &bytes[bytes.len() / 2..]);
    let channels = Box::new(Channels::new(vec![first, second], &OpenOptions::default()).unwrap());
    assert!(of_name(channels.info(), "1").unwrap_err().contains("write number=1 or name=1"));
    assert_eq!(of_name(channels.info(), "MAGNITUDE"), Ok(Some(Of::Channel(1))));
    assert_eq!(of_name(channels.info(), "phase"), Ok(Some(Of::Phase)));
    let component = Component::new(channels, "name=1", Path::new("a"), &OpenOptions::default()).unwrap();
    assert_eq!(component.of, Of::Channel(0));
    assert_boxes(&component, Field { sizes: [4, 3, 2, 1, 1], ..field });
    let Component { source, .. } = component;
    let component = Component::new(source, "magnitude", Path::new("a"), &OpenOptions::default()).unwrap();
    assert_eq!(component.of, Of::Channel(1));
}

/// Boxes are computed in parts, which must fit together.
#[test]
fn parts_of_large_boxes_fit_together() {
    let (x, y) = (1000, 200);
    let values: Vec<f32> = (0..x * y * 2).map(|i| (i / 2 % 1009) as f32 * [3.0, 4.0][i % 2]).collect();
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let (_folder, path) = temp_file("a.raw", &bytes);
    let options = OpenOptions {
        shape: Some(Extent::new(x as u32, y as u32 / 2, 2)),
        voxel_type: Some(VoxelType::F32.into()),
        channels: Some(2),
        axes: Some("zyxc".parse().unwrap()),
        component: Some("magnitude".into()),
        ..OpenOptions::default()
    };
    let source = open(&[path], &options).unwrap();
    let found = floats(&*source).unwrap();
    assert!(found.iter().enumerate().all(|(i, value)| *value == (i % 1009) as f32 * 5.0));
    assert!(source.reader_bytes() >= PART_VOXELS * 12);
}

#[test]
fn what_has_no_such_component_is_refused() {
    let refusal =
        |channels, component: &str, told: OpenOptions| opened(&[0.0; 6], channels, component, told).err().unwrap();
    let plain = OpenOptions::default;
    assert!(refusal(1, "magnitude", plain()).contains("one channel"));
    assert!(refusal(3, "3", plain()).contains("(0, 1, 2)"));
    assert!(refusal(3, "w", plain()).contains("`component` w"));
    assert!(refusal(3, "phase", plain()).contains("two channels"));
    let labels = OpenOptions { are_labels: Some(true), ..plain() };
    assert!(refusal(2, "magnitude", labels).contains("labels"));
}
