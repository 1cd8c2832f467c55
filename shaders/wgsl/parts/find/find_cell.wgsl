// What a cell's fragment finds on its way through a layer: the one brick that stands for the layer in the cell, if there is one.
//!import context cut_face field lattice ray sorted way

struct Found {
    // Nothing is remembered.
    none: u32,
}

fn nothing_found() -> Found {
    return Found(0u);
}

// A fragment takes the parts of segments whose middles are in its cell.
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

// What a loop over layers keeps of what was found, and what is restored from that.
fn kept_found() -> vec3u {
    return vec3u(0u);
}

fn restore_found(kept: vec3u) {
    open_brick();
}
