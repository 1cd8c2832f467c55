// Whether everything behind adds less than a sixteenth of an 8-bit code.
fn is_opaque(alpha: f32) -> bool {
    return alpha > 1.0 - 1.0 / 4096.0;
}
