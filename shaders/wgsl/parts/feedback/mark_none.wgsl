// No feedback: none is requested, or nothing hides anything, as in projections.
fn mark(number: u32, transmittance: f32) {
}
