// The frames of a picture of several volumes, one each, and which of them what follows is about. Lattice, rays in the world and
// background are the same in all.
@group(0) @binding(0) var<storage, read> frames: array<Frame>;
var<private> volume: u32;
