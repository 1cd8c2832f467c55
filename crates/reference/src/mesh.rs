//! Meshes: every triangle against the ray, one after the other.

use brickyard_volume::{FrameSettings, Layer, Ray, mesh};

/// Returns the layers of meshes met by a ray, near to far, up to and including the first opaque one.
pub fn layers(frame: &FrameSettings, ray: &Ray) -> Vec<Layer> {
    let mut layers = Vec::new();
    let mut number = 0;
    for shown in &frame.meshes {
        for triangle in 0..shown.mesh.triangles().len() {
            if let Some((t, weights)) = mesh::hit(shown.mesh.corners(triangle), ray) {
                let color = shown.color_at(triangle, weights, ray.direction);
                layers.push(Layer { t, number, color, opacity: shown.opacity });
            }
            number += 1;
        }
    }
    layers.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.number.cmp(&b.number)));
    let seen = layers.iter().position(|layer| layer.opacity >= 1.0).map_or(layers.len(), |opaque| opaque + 1);
    layers.truncate(seen);
    layers
}
