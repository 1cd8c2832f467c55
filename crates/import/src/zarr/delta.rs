//! Numcodecs' filter `delta`: every element but the first is the difference from the one before.

use crate::element::{Element, Endian};
use brickyard_volume::VoxelType;
use half::f16;

/// Adds up differences of a type. Integers wrap around.
pub(super) fn undo(bytes: &mut [u8], element: Element, endian: Endian) {
    macro_rules! sum {
        ($type:ty, $zero:expr, $add:expr) => {{
            let mut last: $type = $zero;
            for element in bytes.as_chunks_mut::<{ size_of::<$type>() }>().0 {
                let difference = match endian {
                    Endian::Little => <$type>::from_le_bytes(*element),
                    Endian::Big => <$type>::from_be_bytes(*element),
                };
                last = $add(last, difference);
                *element = match endian {
                    Endian::Little => last.to_le_bytes(),
                    Endian::Big => last.to_be_bytes(),
                };
            }
        }};
    }
    match element {
        Element::Voxel(VoxelType::U8 | VoxelType::I8) => sum!(u8, 0, u8::wrapping_add),
        Element::Voxel(VoxelType::U16 | VoxelType::I16) => sum!(u16, 0, u16::wrapping_add),
        Element::Voxel(VoxelType::U32 | VoxelType::I32) => sum!(u32, 0, u32::wrapping_add),
        Element::U64 | Element::I64 => sum!(u64, 0, u64::wrapping_add),
        // From the negative zero, so that an element of it stays one.
        Element::F16 => sum!(f16, f16::NEG_ZERO, |a: f16, b: f16| a + b),
        Element::Voxel(VoxelType::F32) => sum!(f32, -0.0, |a: f32, b: f32| a + b),
        Element::F64 => sum!(f64, -0.0, |a: f64, b: f64| a + b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_added_up() {
        let undone = |bytes: &[u8], element: &str, endian| {
            let mut bytes = bytes.to_vec();
            undo(&mut bytes, element.parse().unwrap(), endian);
            bytes
        };
        assert_eq!(undone(&[250, 10, 255], "u8", Endian::Little), [250, 4, 3]);
        assert_eq!(undone(&[1, 0, 255, 255, 0, 2], "i16", Endian::Little), [1, 0, 0, 0, 0, 2]);
        assert_eq!(undone(&[0, 255, 0, 1], "u16", Endian::Big), [0, 255, 1, 0]);
        let floats = [-0.0f32, 1.5, 2.0].map(f32::to_be_bytes).concat();
        assert_eq!(undone(&floats, "f32", Endian::Big), [-0.0f32, 1.5, 3.5].map(f32::to_be_bytes).concat());
    }
}
