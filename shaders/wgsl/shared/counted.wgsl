// A slot's code, counted from the transfer table's first.
//!import frame

fn counted(code: u32) -> f32 {
    return f32(code) - frame.first_code;
}
