// Nearest voxel: see `sample_voxels`.
//!import voxel

fn sample_nearest_voxel(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    return value_of(voxel(atlas, vec3i(floor(point))));
}
