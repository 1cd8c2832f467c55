// The frame of a picture of one volume.
// Not a uniform: lavapipe builds those that steer loops into the shader, and compiles it anew whenever the camera moves.
@group(0) @binding(0) var<storage, read> frame_settings: Frame;
