// What volume # has in a piece of a segment: of its part there, what lies in the piece.
fn piece_#(before: Together, start: f32, end: f32) -> Together {
    var together = before;
    let part = way_#.part;
    let share = max(min(end, part.y) - max(start, part.x), 0.0) / (part.y - part.x);
    together.PIECE
    return together;
}
