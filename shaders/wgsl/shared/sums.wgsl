// Terms that a pass adds to the projections of several layers.
struct Sums {
    // Sums of mixing layers: colour times depth, and depth.
    @location(0) mixed: vec4f,
    // Light of an adding layer, or the colour of one over the others.
    @location(1) top: vec4f,
}
