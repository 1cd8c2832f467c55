// The colour of an expression's value, unlit.
//!import expression

fn value_color(color: vec3f, result: Result) -> vec3f {
    return color;
}
