// Settings of a frame, the same for all pixels. `layout.rs` declares them, and gives each one's unit.
//!import Frame bindings context

// Not a uniform: lavapipe compiles those that steer loops into the shader, and so would recompile it whenever the camera moves.
@group(0) @binding(FRAMES) var<storage, read> frames: array<Frame, LAYERS>;

// The layer's frame, read once by each entry point: in a loop, lavapipe re-reads storage each round, lane by lane, which made frames take 1.3
// times as long.
var<private> frame: Frame;
