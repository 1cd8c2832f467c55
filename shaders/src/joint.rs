//! Shaders of several layers: the files of one layer, in the context of each in turn.
//!
//! What differs from layer to layer is in private variables (`context`), which a layer's number assigns (`become_#`): textures, first
//! places in shared buffers, flags. Shared code is called once for each layer with its numbers, and no loop goes over layers, so that
//! drivers fold what is constant.

use crate::compose::Parts;
use crate::{Curve, Light, Medium, Surfaces, margin, sample};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Where a layer begins in the buffers that all layers share, in their own units. (Its draw list begins elsewhere in each frame.)
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FirstPlaces {
    /// The first macro-cell of its pool's slots.
    pub range: u32,
    /// The first place of its transfer table.
    pub place: u32,
    /// Its first count of opaque entries.
    pub count: u32,
}

/// What the shader of several has to know of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LayerShader {
    /// The pool that its bricks are in: an atlas, counted from 0.
    pub pool: u32,
    /// Whether code 0 is no value.
    pub has_invalid: bool,
    /// Whether it adds to what others show instead of mixing with it; then it is not lit.
    pub adds: bool,
    /// Whether it has surfaces.
    pub has_surfaces: bool,
    /// Whether it is classified by value and gradient magnitude.
    pub has_grid: bool,
    /// Where its part of shared buffers begins.
    pub first: FirstPlaces,
    /// The bits of the value of code 0, and of the difference to that of the last.
    pub values: [u32; 2],
}

/// What the shader has to know of an expression over the layers.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ExpressionShader {
    /// The function `expression` and its result; of lit layers, those with a gradient.
    pub wgsl: String,
    /// The first place of its values' media in the transfer tables.
    pub first_place: u32,
    /// How many more places there are.
    pub last_place: u32,
    /// The bits of the value of the first place, and of the difference to that of the last.
    pub values: [u32; 2],
}

/// A march through several layers: everything that is decided when a pipeline is made.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct JointVariant {
    /// How segments become media in all layers; there is fog unless surfaces are [`Surfaces::Alone`].
    pub medium: Medium,
    /// Whether fields are tricubic splines of their voxels.
    pub is_cubic: bool,
    /// Whether only a slab between meshes is drawn.
    pub has_meshes: bool,
    /// The layers.
    pub layers: Vec<LayerShader>,
    /// What takes the place of their media, if that is an expression.
    pub expression: Option<ExpressionShader>,
}

impl JointVariant {
    fn has_surfaces(&self) -> bool {
        self.layers.iter().any(|layer| layer.has_surfaces)
    }

    /// What all marches share, but for how layers are found.
    pub(crate) fn parts(&self) -> Parts {
        let parts = Parts::new()
            .text("context", self.context())
            .text(
                "atlas",
                atlases(
                    &self.layers.iter().map(|layer| (layer.pool, layer.has_invalid)).collect::<Vec<_>>(),
                    self.is_cubic,
                ),
            )
            .text("layers", self.layers())
            .text("asking", self.asking())
            .file("world", "axes")
            .file("pixel", "layer_medium")
            .file("gradient", self.medium.gradient.file())
            .file("limits", if self.has_meshes { "limits_slab" } else { "limits_none" });
        match &self.expression {
            None => parts.file("part", "part_media").file("see", "see_media"),
            Some(expression) => {
                let is_lit = self.medium.light != Light::Unlit;
                let parts = parts.file("part", "part_value").file("see", "combine");
                let parts = parts.file("value", if is_lit { "value_lit" } else { "value_unlit" });
                parts.text("expression", expression.declarations(self.layers.len(), is_lit))
            }
        }
    }

    /// What shared code finds of the layer that it is about.
    fn context(&self) -> String {
        let Medium { curve, parts, is_pre_integrated, surfaces, .. } = self.medium;
        let is_cut = self.has_surfaces();
        format!(
            "const LAYERS: u32 = {}u;\nconst MARGIN: f32 = {:?};\nconst CURVE: u32 = {}u;\nconst PARTS: u32 = {parts}u;\n\
             const IS_PRE_INTEGRATED: bool = {is_pre_integrated};\nconst SURFACE_LIGHTING: u32 = {}u;\nconst HAS_FOG: bool = {};\n\
             const IS_CUT: bool = {is_cut};\nconst IS_MIDDLE: bool = {};\nconst IS_ONE_SAMPLE: bool = {};\n\
             var<private> layer: u32;\nvar<private> FIRST_NODE: u32;\nvar<private> FIRST_BRICK: u32;\n\
             var<private> FIRST_RANGE: u32;\nvar<private> FIRST_PLACE: u32;\nvar<private> FIRST_COUNT: u32;\n\
             var<private> HAS_INVALID: bool;\nvar<private> ADDS: bool;\n\
             var<private> LIGHTING: u32;\nvar<private> HAS_SURFACES: bool;\nvar<private> HAS_GRID: bool;\n",
            self.layers.len(),
            margin(self.is_cubic),
            curve as u32,
            self.medium.surface_light() as u32,
            surfaces != Surfaces::Alone,
            curve == Curve::Middle && !is_cut,
            curve == Curve::Middle || (curve != Curve::Field && parts == 1),
        )
    }

    /// The layers, one after the other.
    fn layers(&self) -> String {
        let mut text = "//!import context frame way\n".to_string();
        for (i, layer) in self.layers.iter().enumerate() {
            text.push_str(&layer.declarations(i, self.medium.light));
        }
        let each = |line: &str| self.each(line);
        let _ = write!(
            text,
            "fn set_out_all(position: vec2f) -> vec2f {{\n    var whole = vec2f(1e30, 0.0);\n{}    become_0();\n    \
             return whole;\n}}\n\n\
             fn shift_all(shift: f32) {{\n{}}}\n\n\
             fn find_all(walk: Walk, threshold: u32, transmittance: f32) {{\n{}    become_0();\n}}\n\n\
             fn take_all(walk: Walk) {{\n{}    become_0();\n}}\n\n",
            each(
                "    frame_# = frames[#];\n    become_#();\n    set_out(position);\n    whole = union_with(whole);\n    \
                 way_# = way;\n"
            ),
            each("    way = way_#;\n    shift_by(shift);\n    way_# = way;\n"),
            each("    become_#();\n    find(walk, threshold, transmittance);\n    way_# = way;\n"),
            each("    become_#();\n    take_part(walk);\n    way_# = way;\n"),
        );
        text.push_str(&if self.expression.is_some() { self.reading() } else { self.seeing(&each) });
        text
    }

    /// A line for each layer, with its number in the place of `#`.
    fn each(&self, line: &str) -> String {
        (0..self.layers.len()).map(|i| line.replace('#', &i.to_string())).collect()
    }

    /// What rays ask of all layers.
    fn asking(&self) -> String {
        format!(
            "//!import find layers way\nfn is_any_due(walk: Walk) -> bool {{\n    var is_any = false;\n{}    return is_any;\n}}\n\n\
             fn is_any_elsewhere(walk: Walk) -> bool {{\n    var is_any = false;\n{}    return is_any;\n}}\n\n\
             fn look_all(walk: Walk) {{\n{}    become_0();\n}}\n\n\
             fn empty_until_all(walk: Walk) -> f32 {{\n    var empty = 1e30;\n{}    return empty;\n}}\n",
            self.each("    way = way_#;\n    is_any = is_any || is_due(walk);\n"),
            self.each("    way = way_#;\n    is_any = is_any || is_elsewhere(walk);\n"),
            self.each("    become_#();\n    look(walk);\n    way_# = way;\n"),
            self.each("    way = way_#;\n    empty = min(empty, empty_until(walk));\n"),
        )
    }

    /// What sees media together.
    fn seeing(&self, each: &dyn Fn(&str) -> String) -> String {
        let cut = |line: &str| {
            let layers = self.layers.iter().enumerate().filter(|(_, layer)| layer.has_surfaces);
            layers.map(|(i, _)| line.replace('#', &i.to_string())).collect::<String>()
        };
        format!(
            "//!import part see joint_medium\nfn shares_between(start: f32, end: f32) -> JointMedium {{\n    var together: JointMedium;\n{}    \
             return together;\n}}\n\n\
             fn next_crossing() -> f32 {{\n    var next = 1e30;\n{}    return next;\n}}\n\n\
             fn pass_surfaces(before: Light, next: f32) -> Light {{\n    var light = before;\n{}    become_0();\n    \
             return light;\n}}\n",
            each("    together = with_piece(together, way_#.shown, way_#.piece, vec2f(start, end));\n"),
            cut("    next = min(next, way_#.crossing);\n"),
            cut(
                "    if (way_#.crossing <= next) {\n        become_#();\n        light = pass_surface(light);\n        \
                 way_# = way;\n    }\n"
            ),
        )
    }

    /// What an expression reads.
    fn reading(&self) -> String {
        let mut text = String::from("//!import expression\nfn read_all() -> Read {\n    var read: Read;\n");
        for (i, layer) in self.layers.iter().enumerate() {
            let [low, width] = layer.values.map(f32::from_bits);
            let _ = write!(
                text,
                "    read.values[{i}] = {low:?}f + way_{i}.value * {width:?}f;\n    \
                 read.are_valid[{i}] = way_{i}.value >= 0.0;\n    \
                 read.longest = max(read.longest, select(0.0, way_{i}.length, way_{i}.value >= 0.0));\n"
            );
            if self.medium.light != Light::Unlit {
                let _ = writeln!(text, "    read.gradients[{i}] = way_{i}.gradient * {width:?}f;");
            }
        }
        text + "    return read;\n}\n"
    }
}

impl LayerShader {
    /// What there is of the layer, and its context.
    fn declarations(&self, i: usize, light: Light) -> String {
        let Self { has_invalid, adds, has_surfaces, has_grid, first, .. } = *self;
        let FirstPlaces { range, place, count } = first;
        let light = if adds { Light::Unlit } else { light };
        format!(
            "var<private> frame_{i}: Frame;\nvar<private> way_{i}: Way;\n\n\
             fn become_{i}() {{\n    layer = {i}u;\n    frame = frame_{i};\n    way = way_{i};\n    FIRST_NODE = frame_{i}.list_at.x;\n    \
             FIRST_BRICK = frame_{i}.list_at.y;\n    FIRST_RANGE = {range}u;\n    FIRST_PLACE = {place}u;\n    FIRST_COUNT = {count}u;\n    \
             HAS_INVALID = {has_invalid};\n    ADDS = {adds};\n    LIGHTING = {}u;\n    \
             HAS_SURFACES = {has_surfaces};\n    HAS_GRID = {has_grid};\n}}\n\n",
            light as u32
        )
    }
}

impl ExpressionShader {
    /// The function over what is read of so many layers, and where the media of its values are.
    fn declarations(&self, count: usize, is_lit: bool) -> String {
        let [low, width] = self.values.map(f32::from_bits);
        let (first, last) = (self.first_place, self.last_place);
        let gradients = if is_lit { format!("    gradients: array<vec3f, {count}>,\n") } else { String::new() };
        let read = if is_lit { ", read.gradients" } else { "" };
        format!(
            "struct Read {{\n    values: array<f32, {count}>,\n    are_valid: array<bool, {count}>,\n{gradients}    longest: f32,\n}}\n\n\
             fn result_of(read: Read) -> Result {{\n    return expression(read.values, read.are_valid{read});\n}}\n\n\
             const COMBINED_LOW: f32 = {low:?}f;\nconst COMBINED_WIDTH: f32 = {width:?}f;\n\
             const COMBINED_PLACE: u32 = {first}u;\nconst COMBINED_LAST: f32 = {last}.0;\n{}",
            self.wgsl
        )
    }
}

/// Atlases and stored gradients of the pools of layers, each given by its pool and whether codes there may have no value, and what
/// samples them for the layer at hand.
pub(crate) fn atlases(layers: &[(u32, bool)], is_cubic: bool) -> String {
    let mut text = "//!import bindings context sampler\n".to_string();
    for has_invalid in [false, true].into_iter().filter(|has| layers.iter().any(|(_, own)| own == has)) {
        let _ = writeln!(text, "//!import {}", sample(is_cubic, has_invalid));
    }
    let pools: BTreeMap<u32, bool> = layers.iter().copied().collect();
    for i in pools.keys() {
        let _ = writeln!(
            text,
            "@group(0) @binding(FIRST_ATLAS + {i}u) var atlas_{i}: texture_3d<f32>;\n\
             @group(0) @binding(FIRST_GRADIENTS + {i}u) var gradients_{i}: texture_3d<f32>;"
        );
    }
    let value = |i: u32| {
        let function = if pools[&i] { "sample_valid" } else { "sample_full" };
        format!("return {function}(atlas_{i}, point);")
    };
    let gradient = |i: u32| {
        let size = format!("vec3f(textureDimensions(gradients_{i}))");
        format!("return textureSampleLevel(gradients_{i}, atlas_sampler, node / {size}, 0.0).xyz;")
    };
    let _ = write!(
        text,
        "fn sample_atlas(point: vec3f) -> f32 {{\n    {}\n}}\n\nfn sample_gradients(node: vec3f) -> vec3f {{\n    {}\n}}\n",
        of_pool(layers, value),
        of_pool(layers, gradient)
    );
    text
}

/// What a statement that returns is for the pool of the layer at hand: no choice where all layers share one.
fn of_pool(layers: &[(u32, bool)], statement: impl Fn(u32) -> String) -> String {
    let first = layers[0].0;
    let others = layers.iter().zip(0..).filter(|((pool, _), _)| *pool != first);
    let cases: String =
        others.map(|((pool, _), i)| format!("        case {i}u: {{ {} }}\n", statement(*pool))).collect();
    match cases.is_empty() {
        true => statement(first),
        false => format!("switch layer {{\n{cases}        default: {{ {} }}\n    }}", statement(first)),
    }
}
