// No surfaces of volume #.
const HAS_SURFACES_#: bool = false;

fn is_passed_#(low: u32, high: u32) -> bool {
    return false;
}

fn is_covered_#() -> bool {
    return true;
}

fn start_surfaces_#(is_leapt: bool) {
}

fn find_surfaces_#(start: f32, end: f32) {
}
