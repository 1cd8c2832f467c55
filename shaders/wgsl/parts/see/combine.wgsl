// The medium of an expression's value replaces those of the layers. Twin of the oracle's `put_combined`.
//!import classify expression layers joint_medium value

fn see_all(light: Light) -> Light {
    let read = read_all();
    let result = result_of(read);
    if (!result.is_valid) {
        return light;
    }
    let share = clamp((result.value - COMBINED_LOW) / COMBINED_WIDTH, 0.0, 1.0);
    let medium = medium_of(table[COMBINED_PLACE + u32(share * COMBINED_LAST + 0.5)]);
    let depth = medium.depth * read.longest * frame.per_unit_distance;
    return see(light, JointMedium(value_color(medium.color, result) * depth, depth, vec3f(0.0)));
}
