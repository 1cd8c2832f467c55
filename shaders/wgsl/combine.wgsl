// Puts in the medium of an expression's value. Twin of the oracle's `put_combined`.
fn combine(before: Together) -> Together {
    var together = before;
    let result = expression(together.values, together.are_valid);
    if (result.is_valid) {
        let share = clamp((result.value - COMBINED_LOW) / COMBINED_WIDTH, 0.0, 1.0);
        let medium = medium_at(COMBINED_PLACE + u32(share * COMBINED_LAST + 0.5));
        let amount = medium.depth * together.longest * frame_0.per_unit_distance;
        together.color += medium.color * amount;
        together.depth += amount;
    }
    return together;
}
