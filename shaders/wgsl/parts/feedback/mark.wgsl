// Visibility feedback: for each brick the greatest transmittance of an entering ray, in steps of 1/255, rounded up. After the
// first rays a brick costs each ray one load.
//!import bindings context

const MARK_STEPS: f32 = 255.0;
@group(0) @binding(MARKS) var<storage, read_write> visibility: array<atomic<u32>>;

fn mark(number: u32, transmittance: f32) {
    let brick = FIRST_BRICK + number;
    let steps = u32(ceil(transmittance * MARK_STEPS));
    if (atomicLoad(&visibility[brick]) < steps) {
        atomicMax(&visibility[brick], steps);
    }
}
