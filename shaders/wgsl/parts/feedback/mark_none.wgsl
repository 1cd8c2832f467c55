// No feedback: in projections nothing hides anything.
fn mark(number: u32, transmittance: f32) {
}
