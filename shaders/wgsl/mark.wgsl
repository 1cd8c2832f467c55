// The feedback: for each brick the greatest transmittance with which a ray has entered it, in steps of 1/255, rounded up. After
// the first rays a brick costs each ray one load.
const MARK_STEPS: f32 = 255.0;
@group(0) @binding(9) var<storage, read_write> entered: array<atomic<u32>>;

fn mark(brick: u32, pixel: Pixel) {
    let steps = u32(ceil(pixel.transmittance * MARK_STEPS));
    if (atomicLoad(&entered[brick]) < steps) {
        atomicMax(&entered[brick], steps);
    }
}
