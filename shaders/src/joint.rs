//! Shaders of several layers: the files of one layer, in the context of each in turn.
//!
//! Private variables (the part `context`) hold the differences between layers: the layer's number, its frame, its first places in shared
//! buffers, flags. The function `become_#` sets them for layer number #, which also chooses textures. Up to [`MOST_UNROLLED`] layers, shared
//! code is called once for each, so that drivers fold constants; more layers are looped over, as compile time grows faster than the number of
//! calls.

use crate::compose::Parts;
use crate::{Medium, Sampler, Voxels, margin};
use brickyard_volume::sampling::Curve;
use brickyard_volume::{Filter, LightingModel};
use std::collections::BTreeSet;
use std::fmt::Write;

/// The most layers with unrolled code. Measured in `docs/performance.md`.
const MOST_UNROLLED: usize = 4;

/// The boolean variables of the part `context`, in the order of the bits of [`LayerShader::numbers`].
const FLAGS: [&str; 7] = ["HAS_INVALID", "IS_LABELS", "IS_FLOAT", "IS_UNBOUNDED", "ADDS", "HAS_SURFACES", "HAS_GRID"];

/// The starts of a layer's parts of the shared buffers, in items of each buffer. Its part of the draw lists changes with each frame and is given
/// by [`FrameUniform::list_at`](crate::FrameUniform::list_at).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FirstPlaces {
    /// Index of the first macro-cell of the layer's pool in the buffer of ranges.
    pub range: u32,
    /// Index of the first place of the layer's transfer table in the buffer of tables.
    pub place: u32,
    /// Index of the layer's first count of opaque entries in the buffer of counts
    /// ([`OPAQUE_BEFORE`](crate::bindings::OPAQUE_BEFORE)).
    pub count: u32,
}

/// A layer's properties for the composition of a shader of several layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LayerShader {
    /// Index of the pool with the layer's bricks, and so of its atlas.
    pub pool: u32,
    /// How voxels are read. Layers of labels share a pool with no others.
    pub voxels: Voxels,
    /// Whether all values are whole numbers, like labels. Used by expressions only.
    pub is_whole: bool,
    /// Whether the layer adds its light to others instead of mixing with them. Adding layers are unlit.
    pub adds: bool,
    /// Whether the layer has isosurfaces.
    pub has_surfaces: bool,
    /// Whether the layer is classified by value and gradient magnitude, rather than by value alone.
    pub has_grid: bool,
    /// Starts of the layer's parts of the shared buffers.
    pub first: FirstPlaces,
    /// The value of the table's first code, and the difference from it to the value of the last, each as the bits of an `f32`. Used by
    /// expressions only, otherwise 0.
    pub values: [u32; 2],
}

/// An expression's properties for the composition of a shader.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ExpressionShader {
    /// WGSL of the function `expression` and of its result's struct, from the expression itself: with gradients if the layers are lit.
    pub wgsl: String,
    /// Index of the first place of the expression's transfer table in the buffer of tables.
    pub first_place: u32,
    /// Index of the last place of the expression's transfer table, counted from its first.
    pub last_place: u32,
    /// The value of the first place of the expression's transfer table, and the difference from it to the value of the
    /// last place, each as the bits of an `f32`.
    pub values: [u32; 2],
}

/// The variant of a march through several layers at once: everything decided at the creation of a pipeline.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct JointVariant {
    /// How segments become media in all layers. Surfaces and grids are set layer by layer: of [`Medium::surfaces`] only [`Surfaces::Alone`](crate::Surfaces::Alone)
    /// counts, as the absence of fog, and [`Medium::has_grid`] is ignored.
    pub medium: Medium,
    /// How fields are interpolated from voxels, except for labels.
    pub filter: Filter,
    /// Whether only a slab between layers of meshes is drawn.
    pub has_meshes: bool,
    /// The layers, at least one, in the order of their frames.
    pub layers: Vec<LayerShader>,
    /// The expression whose medium replaces the layers' media; `None` if the layers show their own.
    pub expression: Option<ExpressionShader>,
}

impl JointVariant {
    fn has_surfaces(&self) -> bool {
        self.layers.iter().any(|layer| layer.has_surfaces)
    }

    /// The parts common to all marches through these layers. The search for a layer's bricks (`find`) differs between compositors and is not
    /// among them.
    pub(crate) fn parts(&self) -> Parts {
        let parts = Parts::new()
            .text("context", self.context())
            .text(
                "atlas",
                atlases(
                    &self.layers.iter().map(|layer| (layer.pool, layer.voxels.sampler())).collect::<Vec<_>>(),
                    self.filter,
                ),
            )
            .text("layers", self.layers())
            .text("asking", self.asking())
            .file("world", "axes")
            .file("pixel", "layer_medium")
            .file("gradient", crate::gradient_file(self.medium.gradient))
            .file("limits", if self.has_meshes { "limits_slab" } else { "limits_none" });
        match &self.expression {
            None => parts.file("part", "part_media").file("see", "see_media"),
            Some(expression) => {
                let is_lit = self.medium.light != LightingModel::None;
                let parts = parts.file("part", "part_value").file("see", "combine");
                let parts = parts.file("value", if is_lit { "value_lit" } else { "value_unlit" });
                parts.text("expression", expression.declarations(self.layers.len(), is_lit))
            }
        }
    }

    /// The part `context`: constants of this variant, and variables of the current layer.
    fn context(&self) -> String {
        let Medium { curve, parts, .. } = self.medium;
        let is_cut = self.has_surfaces();
        format!(
            "const LAYERS: u32 = {}u;\nconst MARGIN: f32 = {:?};\n{}\
             const IS_CUT: bool = {is_cut};\nconst IS_LOOPED: bool = {};\nconst IS_READ: bool = {};\nconst IS_MIDDLE: bool = {};\nconst IS_ONE_SAMPLE: bool = {};\n\
             var<private> layer: u32;\nvar<private> FIRST_NODE: u32;\nvar<private> FIRST_BRICK: u32;\n\
             var<private> FIRST_RANGE: u32;\nvar<private> FIRST_PLACE: u32;\nvar<private> FIRST_COUNT: u32;\n\
             var<private> LIGHTING: u32;\n{}",
            self.layers.len(),
            margin(self.filter),
            self.medium.constants(),
            self.is_looped(),
            self.expression.is_some(),
            curve == Curve::Middle && !is_cut,
            curve == Curve::Middle || (curve != Curve::Field && parts == 1),
            self.flags()
        )
    }

    /// The flags of [`FLAGS`]: constants if equal for all layers, to keep features unused by all layers out of the compiled shader.
    fn flags(&self) -> String {
        let declare = |(bit, name): (usize, &&str)| match self.common_flag(bit) {
            Some(flag) => format!("const {name}: bool = {flag};\n"),
            None => format!("var<private> {name}: bool;\n"),
        };
        FLAGS.iter().enumerate().map(declare).collect()
    }

    /// The common value of a flag, if equal for all layers.
    fn common_flag(&self, bit: usize) -> Option<bool> {
        let flag = self.layers[0].flags()[bit];
        self.layers.iter().all(|layer| layer.flags()[bit] == flag).then_some(flag)
    }

    /// Names of the flags that differ between layers, each with its bit.
    fn own_flags(&self) -> impl Iterator<Item = (usize, &'static str)> {
        FLAGS.into_iter().enumerate().filter(|(bit, _)| self.common_flag(*bit).is_none())
    }

    /// The part `layers`: each layer's variables, and functions over all layers, one after the other.
    fn layers(&self) -> String {
        let mut text = "//!import context frame shade way\n".to_string() + &self.declarations();
        let (each, first) = (|line: &str| self.each(line), self.of_layer(0, "become_#();"));
        let nothing = if self.is_looped() { "shown_together = JointMedium(vec3f(0.0), 0.0, vec3f(0.0));" } else { "" };
        let _ = write!(
            text,
            "fn set_out_all(position: vec2f) -> vec2f {{\n    var whole = vec2f(1e30, 0.0);\n{}    {first}\n    \
             return whole;\n}}\n\n\
             fn shift_all(shift: f32) {{\n{}}}\n\n\
             fn find_all(walk: Walk, threshold: u32, transmittance: f32) {{\n{}    {first}\n}}\n\n\
             fn take_all(walk: Walk) {{\n    {nothing}\n{}    {first}\n}}\n\n",
            each(
                "    prepare_#();\n    become_#();\n    set_out(position);\n    whole = union_with(whole);\n    keep_#();\n"
            ),
            each("    restore_#();\n    shift_by(shift);\n    keep_#();\n"),
            each("    become_#();\n    find(walk, threshold, transmittance);\n    keep_#();\n"),
            each("    become_#();\n    take_part(walk);\n    taken_#();\n    join_shown();\n"),
        );
        text.push_str(&if self.expression.is_some() { self.reading() } else { self.seeing() });
        text
    }

    /// Whether the shader loops over the layers.
    fn is_looped(&self) -> bool {
        self.layers.len() > MOST_UNROLLED
    }

    /// Lines for each layer, one after the other: unrolled, or in a loop.
    fn each(&self, lines: &str) -> String {
        match self.is_looped() {
            true => format!("    for (var i = 0u; i < LAYERS; i++) {{\n{}    }}\n", looped(lines, "i")),
            false => (0..self.layers.len()).map(|i| self.of_layer(i, lines)).collect(),
        }
    }

    /// Lines for one layer.
    fn of_layer(&self, i: usize, lines: &str) -> String {
        if self.is_looped() { looped(lines, &format!("{i}u")) } else { repeated(lines, i) }
    }

    /// Each layer's frame and way, and the functions that switch to a layer.
    fn declarations(&self) -> String {
        let layers = || self.layers.iter().zip(0..);
        if !self.is_looped() {
            // Frames are read once: lavapipe would re-read them in each round of a loop.
            let unrolled = |(layer, i): (&LayerShader, usize)| {
                let own = "var<private> frame_#: Frame;\nvar<private> way_#: Way;\n\n\
                           fn become_#() {\n    layer = #u;\n    frame = frame_#;\n    way = way_#;\n    ";
                own.replace('#', &i.to_string()) + &self.settings(layer) + "\n}\n\n"
            };
            return layers().map(unrolled).collect();
        }
        let flag = |(bit, name)| format!("    {name} = (flags & {}u) != 0u;\n", 1 << bit);
        let flags: String = self.own_flags().map(flag).collect();
        let lighting = self.medium.light as u32;
        format!(
            "//!import kept\nfn set_flags(flags: u32) {{\n{flags}}}\n\n\
             fn become_layer(i: u32) {{\n    turn_to(i, {lighting}u);\n    restore(i);\n}}\n\n"
        )
    }

    /// WGSL that sets the variables of the part `context` for a layer.
    fn settings(&self, layer: &LayerShader) -> String {
        let FirstPlaces { range, place, count } = layer.first;
        let light = if layer.adds { LightingModel::None } else { self.medium.light };
        let flags = layer.flags();
        let flags: String = self.own_flags().map(|(bit, name)| format!("    {name} = {};\n", flags[bit])).collect();
        format!(
            "FIRST_NODE = frame.list_at.x;\n    FIRST_BRICK = frame.list_at.y;\n    FIRST_RANGE = {range}u;\n    \
             FIRST_PLACE = {place}u;\n    FIRST_COUNT = {count}u;\n{flags}    LIGHTING = {}u;",
            light as u32
        )
    }

    /// The part `asking`: a ray's queries over all layers.
    fn asking(&self) -> String {
        format!(
            "//!import find layers way\nfn is_any_due(walk: Walk) -> bool {{\n    var is_any = false;\n{}    return is_any;\n}}\n\n\
             fn is_any_elsewhere(walk: Walk) -> bool {{\n    var is_any = false;\n{}    return is_any;\n}}\n\n\
             fn look_all(walk: Walk) {{\n{}    {first}\n}}\n\n\
             fn empty_until_all(walk: Walk) -> f32 {{\n    var empty = 1e30;\n{}    return empty;\n}}\n",
            self.each("    restore_#();\n    is_any = is_any || is_due(walk);\n"),
            self.each("    restore_#();\n    is_any = is_any || is_elsewhere(walk);\n"),
            self.each("    become_#();\n    look(walk);\n    looked_#();\n"),
            self.each("    restore_#();\n    empty = min(empty, empty_until(walk));\n"),
            first = self.of_layer(0, "become_#();"),
        )
    }

    /// The functions of the part `layers` that combine the media of all layers.
    fn seeing(&self) -> String {
        // Layers without surfaces pass none, but loops include them all the same.
        let cut = |lines: &str| {
            let layers = self.layers.iter().enumerate().filter(|(_, layer)| layer.has_surfaces);
            let repeated = || layers.map(|(i, _)| self.of_layer(i, lines)).collect();
            if self.is_looped() { self.each(lines) } else { repeated() }
        };
        format!(
            "//!import part see joint_medium\nfn shares_between(start: f32, end: f32) -> JointMedium {{\n    var together: JointMedium;\n{}    \
             return together;\n}}\n\n\
             fn next_crossing() -> f32 {{\n    var next = 1e30;\n{}    return next;\n}}\n\n\
             fn pass_surfaces(before: Light, next: f32) -> Light {{\n    var light = before;\n{}    {first}\n    \
             return light;\n}}\n",
            match self.is_looped() && !self.has_surfaces() {
                true => "    together = shown_together;\n".to_string(),
                false =>
                    self.each("    together = with_piece(together, way_#.shown, way_#.piece, vec2f(start, end));\n"),
            },
            cut("    next = min(next, way_#.crossing);\n"),
            cut(
                "    if (is_passed_with(next, way_#.crossing, cap_#)) {\n        become_#();\n        light = pass_surface(light);\n        taken_#();\n    }\n"
            ),
            first = self.of_layer(0, "become_#();"),
        )
    }

    /// The function of the part `layers` that collects an expression's input from each layer.
    fn reading(&self) -> String {
        let mut text = String::from("//!import expression no_value\nfn read_all() -> Read {\n    var read: Read;\n");
        for (i, layer) in self.layers.iter().enumerate() {
            let [low, width] = layer.values.map(f32::from_bits);
            let value = format!("{low:?}f + way_#.value * {width:?}f");
            // Expressions compare whole numbers.
            let value = if layer.is_whole { format!("round({value})") } else { value };
            let mut lines = format!(
                "    read.values[{i}] = {value};\n    \
                 read.are_valid[{i}] = has_value(way_#.value);\n    \
                 read.longest = max(read.longest, select(0.0, way_#.length, has_value(way_#.value)));\n"
            );
            if self.medium.light != LightingModel::None {
                let _ = writeln!(lines, "    read.gradients[{i}] = way_#.gradient * {width:?}f;");
            }
            text.push_str(&self.of_layer(i, &lines));
        }
        text + "    return read;\n}\n"
    }
}

impl LayerShader {
    /// The values of [`FLAGS`].
    fn flags(&self) -> [bool; FLAGS.len()] {
        let Self { voxels, adds, has_surfaces, has_grid, .. } = *self;
        let Voxels { has_invalid, is_labels, is_float, .. } = voxels;
        [has_invalid, is_labels, is_float, voxels.sampler() == Sampler::Voxels, adds, has_surfaces, has_grid]
    }

    /// The starts of the layer's parts of the shared buffers, and a bit for each of its flags: the input of shaders with loops over layers.
    pub fn numbers(&self) -> [u32; 4] {
        let FirstPlaces { range, place, count } = self.first;
        [
            range,
            place,
            count,
            self.flags().into_iter().zip(0..).fold(0, |all, (flag, bit)| all | u32::from(flag) << bit),
        ]
    }
}

/// Lines about the layer `#`, for a layer with its own variables.
fn repeated(lines: &str, i: usize) -> String {
    let lines = lines.replace("    join_shown();\n", "").replace("prepare_#();", "frame_# = frames[#];");
    let lines = lines.replace("restore_#();", "way = way_#;").replace("cap_#", "way_#.cap");
    let kept = ["keep_#();", "looked_#();", "taken_#();"];
    kept.iter().fold(lines, |lines, call| lines.replace(call, "way_# = way;")).replace('#', &i.to_string())
}

/// Lines about the layer `#`, for the layer with this index in a shader with loops.
fn looped(lines: &str, index: &str) -> String {
    let lines = lines.replace("    prepare_#();\n", "").replace("way_#", &format!("all_kept[{index}]"));
    let lines = lines.replace("cap_#", &format!("all_kept[{index}].ranks.z"));
    let calls = [
        ("become_#", "become_layer"),
        ("restore_#", "restore"),
        ("keep_#", "keep"),
        ("looked_#", "keep_looked"),
        ("taken_#", "keep_taken"),
    ];
    calls.iter().fold(lines, |lines, (from, to)| lines.replace(&format!("{from}()"), &format!("{to}({index})")))
}

impl ExpressionShader {
    /// The part `expression`: the struct of values read from `count` layers, the function over it, and the place in the tables of the media of
    /// its values.
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

/// The part `atlas`: the atlases and stored gradients of the layers' pools, and functions that sample them for the current layer. `layers` gives
/// each layer's pool and its sampler.
pub(crate) fn atlases(layers: &[(u32, Sampler)], filter: Filter) -> String {
    let mut text = "//!import bindings context sampler\n".to_string();
    for sampler in Sampler::ALL.into_iter().filter(|sampler| layers.iter().any(|(_, own)| own == sampler)) {
        let _ = writeln!(text, "//!import {}", sampler.files(filter));
    }
    let pools: BTreeSet<u32> = layers.iter().map(|(pool, _)| *pool).collect();
    for i in pools {
        let _ = writeln!(
            text,
            "@group(0) @binding(FIRST_ATLAS + {i}u) var atlas_{i}: texture_3d<f32>;\n\
             @group(0) @binding(FIRST_GRADIENTS + {i}u) var gradients_{i}: texture_3d<f32>;"
        );
    }
    let value = |i: u32, sampler: Sampler| format!("return {}(atlas_{i}, point);", sampler.function(filter));
    let smooth = |i: u32, sampler: Sampler| format!("return {}(atlas_{i}, point);", sampler.smooth_function());
    let gradient = |i: u32, _| {
        let size = format!("vec3f(textureDimensions(gradients_{i}))");
        format!("return textureSampleLevel(gradients_{i}, atlas_sampler, node / {size}, 0.0).xyz;")
    };
    let share = |i: u32, sampler: Sampler| match sampler == Sampler::Label {
        true => format!("return share_in_atlas(atlas_{i}, point, label);"),
        false => "return 0.0;".to_string(),
    };
    let _ = write!(
        text,
        "fn sample_atlas(point: vec3f) -> f32 {{\n    {}\n}}\n\nfn smooth_atlas(point: vec3f) -> f32 {{\n    {}\n}}\n\n\
         fn sample_gradients(node: vec3f) -> vec3f {{\n    {}\n}}\n\n\
         fn share_of_label(point: vec3f, label: f32) -> f32 {{\n    {}\n}}\n",
        of_layer(layers, value),
        of_layer(layers, smooth),
        of_layer(layers, gradient),
        of_layer(layers, share),
    );
    text
}

/// WGSL that runs the current layer's statement, for its pool and sampler: a `switch` over layers, or the statement alone if all layers have the
/// same. The statement has to return.
fn of_layer(layers: &[(u32, Sampler)], statement: impl Fn(u32, Sampler) -> String) -> String {
    let statements: Vec<String> = layers.iter().map(|(pool, sampler)| statement(*pool, *sampler)).collect();
    let first = &statements[0];
    let others = statements.iter().zip(0..).filter(|(other, _)| *other != first);
    let cases: String = others.map(|(other, i)| format!("        case {i}u: {{ {other} }}\n")).collect();
    match cases.is_empty() {
        true => first.clone(),
        false => format!("switch layer {{\n{cases}        default: {{ {first} }}\n    }}"),
    }
}
