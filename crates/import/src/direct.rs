//! Decoding of 64-bit numbers straight to the voxel type asked for, [`OpenOptions::to_voxel_type`]: through the type that they are held in
//! otherwise, values would be clamped or rounded on the way. Numbers of other types are converted as voxels (`converted`).

use crate::element::{Decode, Element, Scale};
use crate::options::{NoData, OpenOptions};

/// The decoding to the voxel type asked for. `nodata` is the file's value for no data, as far as it is known yet.
pub(crate) fn direct(decode: Decode, nodata: Option<f64>, options: &OpenOptions) -> Decode {
    let is_wide = matches!(decode.element, Element::I64 | Element::U64 | Element::F64);
    let Some(to) = options.to_voxel_type.filter(|_| is_wide) else { return decode };
    let own = decode.voxel_type();
    // Signed labels may be held in either type, unless it is told.
    let is_held_so = decode.scale.is_none() && to == own && options.are_labels != Some(true);
    if is_held_so || to.is_float() && own.is_float() {
        return decode;
    }
    let scale = decode.scale.unwrap_or(Scale::new(1.0, 0.0, to));
    let nodata = told_nodata(nodata.or(scale.nodata), options);
    // A stored number that becomes the value for no data of the steps before does so in integers only.
    let absent = scale.absent.filter(|_| !to.is_float() && !scale.to.is_float());
    Decode { scale: Some(Scale { to, nodata, absent, ..scale }), ..decode }
}

/// Whether numbers are read as the voxels that their format describes.
pub(crate) fn is_plain(decode: Decode, options: &OpenOptions) -> bool {
    direct(decode, None, options) == decode
}

/// The value for no data: the file's, the caller's, or that of the steps before, which holds here, too.
pub(crate) fn told_nodata(of_file: Option<f64>, options: &OpenOptions) -> Option<f64> {
    match options.nodata {
        NoData::OfFile => of_file.or(options.held_as.and_then(|held| held.nodata)),
        NoData::None => None,
        NoData::Value(value) => Some(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open::open;
    use crate::options::HeldAs;
    use crate::source::Source;
    use crate::testing::{said, temp_file};
    use brickyard_volume::VoxelType;
    use std::path::PathBuf;

    fn to(voxel_type: VoxelType) -> OpenOptions {
        OpenOptions { to_voxel_type: Some(voxel_type), ..OpenOptions::default() }
    }

    fn npy(kind: &str, numbers: &[[u8; 8]]) -> Vec<u8> {
        let shape = numbers.len();
        let header = format!("{{'descr': '<{kind}', 'fortran_order': False, 'shape': (1, 1, {shape})}}");
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), numbers.as_flattened()]
            .concat()
    }

    fn values(source: &dyn Source) -> Vec<f64> {
        let full = source.info().extent.full_box();
        let voxel_type = source.info().voxel_type;
        let mut out = vec![0; full.extent().volume() as usize * voxel_type.bytes()];
        source.read_box(0, 0, full, &mut out).unwrap();
        (0..full.extent().volume() as usize).map(|i| voxel_type.read(&out, i)).collect()
    }

    fn opened(bytes: &[u8], options: &OpenOptions) -> Result<(Vec<f64>, String), String> {
        let (_folder, path) = temp_file("a.npy", bytes);
        let source = open(&[path], options).map_err(|error| error.to_string())?;
        assert_eq!(Some(source.info().voxel_type), options.to_voxel_type);
        Ok((values(&*source), said(&source.info().notes)))
    }

    fn i64s(numbers: &[i64]) -> Vec<u8> {
        npy("i8", &numbers.iter().map(|n| n.to_le_bytes()).collect::<Vec<_>>())
    }

    fn f64s(numbers: &[f64]) -> Vec<u8> {
        npy("f8", &numbers.iter().map(|n| n.to_le_bytes()).collect::<Vec<_>>())
    }

    #[test]
    fn wide_integers_arrive_as_they_are_where_the_type_holds_them() {
        let (found, notes) = opened(&i64s(&[3_000_000_000, 0]), &to(VoxelType::U32)).unwrap();
        assert_eq!(found, [3e9, 0.0]);
        assert_eq!(notes.matches("Voxels are i64 and are held as u32: no value is changed").count(), 1, "{notes}");
        assert!(!notes.contains("become"), "looked through once: {notes}");
        let unsigned = npy("u8", &[4_000_000_000u64, 7].map(u64::to_le_bytes));
        assert_eq!(opened(&unsigned, &to(VoxelType::U32)).unwrap().0, [4e9, 7.0]);
        let message = opened(&unsigned, &to(VoxelType::I32)).unwrap_err();
        assert!(message.contains("4000000000 cannot be held as it is in i32"), "{message}");
        let lossy = OpenOptions { allow_lossy: true, ..to(VoxelType::U8) };
        let (found, notes) = opened(&i64s(&[300, -1, 255]), &lossy).unwrap();
        assert_eq!(found, [255.0, 0.0, 255.0]);
        assert!(notes.contains("held as u8: of 3 values in a.npy, 2 clamped to its limits (such as 300)"), "{notes}");
        let wide = i64s(&[1 << 40, (1 << 24) + 1]);
        assert!(opened(&wide, &to(VoxelType::F32)).unwrap_err().contains("16777217 cannot be held as it is in f32"));
        assert!(opened(&i64s(&[(1 << 53) + 1]), &to(VoxelType::F32)).unwrap_err().contains("9007199254740993"));
        assert_eq!(opened(&i64s(&[1 << 40, -5]), &to(VoxelType::F32)).unwrap().0, [(1u64 << 40) as f64, -5.0]);
    }

    #[test]
    fn wide_floats_are_rounded_once() {
        let lossy = |voxel_type| OpenOptions { allow_lossy: true, ..to(voxel_type) };
        let (found, notes) = opened(&f64s(&[2.5 + 1e-9, 2.5, 7.0, 1e6]), &lossy(VoxelType::U16)).unwrap();
        assert_eq!(found, [3.0, 2.0, 7.0, 65535.0]);
        assert!(notes.contains("1 clamped to its limits, 2 rounded to the nearest"), "{notes}");
        assert_eq!(opened(&f64s(&[16777217.0, -1.0]), &to(VoxelType::I32)).unwrap().0, [16777217.0, -1.0]);
        assert!(opened(&f64s(&[0.5]), &to(VoxelType::U8)).unwrap_err().contains("0.5 cannot be held as it is in u8"));
    }

    #[test]
    fn wide_numbers_without_data_stay_so() {
        let floats = f64s(&[f64::NAN, 9.0, 3.0]);
        let message = opened(&floats, &to(VoxelType::U8)).unwrap_err();
        assert!(
            message.contains("NaN is no data, for which u8 has no value") && message.contains("`nodata`"),
            "{message}"
        );
        let marked = |nodata| OpenOptions { nodata: NoData::Value(nodata), ..to(VoxelType::U8) };
        assert_eq!(opened(&floats, &marked(9.0)).unwrap().0, [9.0, 9.0, 3.0]);
        let held_as = Some(HeldAs { voxel_type: VoxelType::U8, nodata: Some(9.0), turned: [false; 3] });
        assert_eq!(opened(&floats, &OpenOptions { held_as, ..to(VoxelType::U8) }).unwrap().0, [9.0, 9.0, 3.0]);
        // No other number becomes it, whatever is allowed.
        for (numbers, nodata) in [(f64s(&[3.4]), 3.0), (f64s(&[300.0]), 255.0), (i64s(&[-5]), 0.0)] {
            let lossy = OpenOptions { allow_lossy: true, ..marked(nodata) };
            assert!(opened(&numbers, &lossy).unwrap_err().contains("beside"), "{nodata}");
        }
        let merged = OpenOptions { allow_lossy: true, nodata: NoData::Value(9007199254740992.0), ..to(VoxelType::F32) };
        assert!(opened(&i64s(&[(1 << 53) + 1]), &merged).unwrap_err().contains("beside"));
    }

    /// The file's own value holds before the conversion.
    #[test]
    fn a_value_for_no_data_that_the_type_lacks_is_refused_where_it_occurs() {
        let envi = |numbers: &[i64], ignored: &str, options: &OpenOptions| {
            let header = format!(
                "ENVI\nsamples = {}\nlines = 1\nbands = 1\ndata type = 14\nbyte order = 0\ninterleave = bsq\ndata ignore value = {ignored}\n",
                numbers.len()
            );
            let (folder, path) = temp_file("a.hdr", header.as_bytes());
            let raw: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
            std::fs::write(folder.path().join("a.img"), raw).unwrap();
            open(&[path], options).map(|source| (values(&*source), source.info().nodata)).map_err(|e| e.to_string())
        };
        let lossy = OpenOptions { allow_lossy: true, ..to(VoxelType::U32) };
        assert!(envi(&[5, -1], "-1", &lossy).unwrap_err().contains("-1 cannot be held in u32 beside -1"));
        assert_eq!(envi(&[5, 6], "-1", &lossy).unwrap(), (vec![5.0, 6.0], None));
        // Beyond i32, the type of such numbers otherwise.
        let found = envi(&[5, 4_000_000_000], "4000000000", &to(VoxelType::U32)).unwrap();
        assert_eq!(found, (vec![5.0, 4e9], Some(4e9)));
    }

    #[test]
    fn steps_are_opened_again_in_the_told_type() {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> = (0..3).map(|i| folder.path().join(format!("a_{i}.npy"))).collect();
        for (path, number) in paths.iter().zip([3_000_000_000i64, 1, 2]) {
            std::fs::write(path, i64s(&[number])).unwrap();
        }
        let source = open(&paths, &to(VoxelType::U32)).unwrap();
        assert_eq!(values(&*source), [3e9]);
        let labels = OpenOptions { are_labels: Some(true), ..to(VoxelType::I32) };
        assert!(open(&paths, &labels).err().unwrap().to_string().contains("become others"));
    }
}
