// The value of a sample without one. All others are greater by far, though 32-bit floats may be far below 0.
const NO_VALUE: f32 = -1e30;

fn has_value(value: f32) -> bool {
    return value > 0.5 * NO_VALUE;
}
