// Bricks for a cell's fragment: in each layer at most one stands for the cell.
//!import context cut_face field lattice ray sorted way

struct Found {
    // Nothing to remember.
    none: u32,
}

fn nothing_found() -> Found {
    return Found(0u);
}

// Whether a part's middle lies in the fragment's cell: a fragment takes only such parts.
fn is_own(t: f32) -> bool {
    return is_in_box(drawn, way.ray.origin + way.ray.direction * t);
}

fn find(walk: Walk, threshold: u32, transmittance: f32) {
    way.until = 1e30;
    way.is_seen = cell_bricks[drawn.first_brick + layer].is_there != 0u;
    open_brick();
}

fn open_brick() {
    let brick = cell_bricks[drawn.first_brick + layer];
    way.field = field_about(drawn.centre, brick.texel_scale, brick.texel_offset, way.ray);
    way.met.rate = rate_in(way.met.cut, way.ray, brick.texel_scale);
}

// State of the find kept by a loop over layers, for `restore_found`.
fn kept_found() -> vec3u {
    return vec3u(0u);
}

fn restore_found(kept: vec3u) {
    open_brick();
}
