// Media of all layers, seen together between the surfaces of all.
//!import context layers joint_medium way

fn see_all(before: Light) -> Light {
    if (!IS_CUT) {
        return see(before, shares_between(-1e30, 1e30));
    }
    var light = before;
    var at = -1e30;
    var is_more = true;
    while (is_more) {
        let next = next_crossing();
        light = see(light, shares_between(at, next));
        is_more = next < 1e30;
        if (is_more) {
            light = pass_surfaces(light, next);
        }
        at = next;
    }
    return light;
}

// Adds a piece's share of an interval.
fn with_piece(before: JointMedium, shown: Pixel, piece: vec2f, interval: vec2f) -> JointMedium {
    if (!IS_CUT) {
        return with_share(before, shown, 1.0);
    }
    let length = piece.y - piece.x;
    let overlap = max(min(interval.y, piece.y) - max(interval.x, piece.x), 0.0);
    return with_share(before, shown, select(0.0, overlap / length, length > 0.0));
}
