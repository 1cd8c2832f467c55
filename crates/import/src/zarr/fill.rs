//! Fill values: the element of chunks never written, from a document's number, word or bits.

use crate::element::Element;
use brickyard_volume::VoxelType;
use half::f16;
use serde_json::Value;

/// The little-endian bytes of one element; `None` if the value is none of the type's.
pub(super) fn fill_of(element: Element, value: &Value) -> Option<Vec<u8>> {
    match element {
        Element::Voxel(VoxelType::U8) => integer(value, 0..=u8::MAX.into(), 1),
        Element::Voxel(VoxelType::I8) => integer(value, i8::MIN.into()..=i8::MAX.into(), 1),
        Element::Voxel(VoxelType::U16) => integer(value, 0..=u16::MAX.into(), 2),
        Element::Voxel(VoxelType::I16) => integer(value, i16::MIN.into()..=i16::MAX.into(), 2),
        Element::Voxel(VoxelType::U32) => integer(value, 0..=u32::MAX.into(), 4),
        Element::Voxel(VoxelType::I32) => integer(value, i32::MIN.into()..=i32::MAX.into(), 4),
        Element::U64 => integer(value, 0..=u64::MAX.into(), 8),
        Element::I64 => integer(value, i64::MIN.into()..=i64::MAX.into(), 8),
        Element::F16 => float(value, 2, |n| f16::from_f64(n).to_le_bytes().to_vec()),
        Element::Voxel(VoxelType::F32) => float(value, 4, |n| (n as f32).to_le_bytes().to_vec()),
        Element::F64 => float(value, 8, |n| n.to_le_bytes().to_vec()),
    }
}

fn integer(value: &Value, range: std::ops::RangeInclusive<i128>, bytes: usize) -> Option<Vec<u8>> {
    let number = match value {
        Value::Bool(is_set) => i128::from(*is_set),
        Value::Number(number) => match (number.as_u64(), number.as_i64(), number.as_f64()) {
            (Some(n), ..) => n.into(),
            (_, Some(n), _) => n.into(),
            // Some programs write integers with a point.
            (.., Some(n)) if n.fract() == 0.0 && n.abs() < 9e15 => n as i128,
            _ => return None,
        },
        _ => return None,
    };
    range.contains(&number).then(|| number.to_le_bytes()[..bytes].to_vec())
}

fn float(value: &Value, bytes: usize, rounded: fn(f64) -> Vec<u8>) -> Option<Vec<u8>> {
    match value {
        Value::Number(number) => number.as_f64().map(rounded),
        Value::String(text) => match text.as_str() {
            "NaN" => Some(rounded(f64::NAN)),
            "Infinity" => Some(rounded(f64::INFINITY)),
            "-Infinity" => Some(rounded(f64::NEG_INFINITY)),
            bits => {
                let digits = bits.strip_prefix("0x").filter(|digits| digits.len() == 2 * bytes)?;
                let is_plain = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
                let bits = u64::from_str_radix(digits, 16).ok().filter(|_| is_plain)?;
                Some(bits.to_le_bytes()[..bytes].to_vec())
            }
        },
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn fill_values_are_numbers_words_and_bits() {
        let of = |element: &str, value| fill_of(element.parse().unwrap(), &value);
        assert_eq!(of("u8", json!(255)), Some(vec![255]));
        assert_eq!(of("u8", json!(true)), Some(vec![1]));
        assert_eq!(of("u16", json!(7.0)), Some(vec![7, 0]));
        assert_eq!(of("i16", json!(-2)), Some(vec![254, 255]));
        assert_eq!(of("u64", json!(u64::MAX)), Some(vec![255; 8]));
        assert_eq!(of("i64", json!(i64::MIN)), Some(i64::MIN.to_le_bytes().to_vec()));
        assert_eq!(of("f32", json!(1)), Some(1f32.to_le_bytes().to_vec()));
        assert_eq!(of("f32", json!("NaN")), Some(vec![0, 0, 0xc0, 0x7f]));
        assert_eq!(of("f16", json!("-Infinity")), Some(vec![0, 0xfc]));
        assert_eq!(of("f64", json!("Infinity")), Some(f64::INFINITY.to_le_bytes().to_vec()));
        assert_eq!(of("f32", json!("0x7fc00001")), Some(vec![1, 0, 0xc0, 0x7f]));
        assert_eq!(of("f16", json!("0x3c00")), Some(vec![0, 0x3c]));
    }

    #[test]
    fn values_of_other_types_are_refused() {
        let cases = [
            ("u8", json!(256)),
            ("u8", json!(-1)),
            ("u8", json!(0.5)),
            ("u8", json!("0x00")),
            ("i8", json!(128)),
            ("u64", json!(-1)),
            ("u64", json!(1.8446744073709552e19)),
            ("u16", json!("NaN")),
            ("f32", json!("0x7fc0")),
            ("f32", json!("0x+fc00001")),
            ("f32", json!("nan")),
            ("f32", json!([0])),
        ];
        for (element, value) in cases {
            assert_eq!(fill_of(element.parse().unwrap(), &value), None, "{element} {value}");
        }
    }
}
