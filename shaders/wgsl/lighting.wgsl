// What a place shows of its colour under its gradient as a normal. Twin of the volume crate's `lighting`.
const AMBIENT: f32 = 0.1;
const DIFFUSE: f32 = 0.7;
const SPECULAR: f32 = 0.2;
const SPECULAR_POWER: f32 = 10.0;
// Differences of codes across two voxels below which a field is flat; and in f32 slots as shares of the value.
const FLAT_CODES: f32 = 0.015625;
const FLAT_SHARE: f32 = 9.536743e-7;
