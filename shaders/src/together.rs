//! The shader of several volumes: what there is once for each volume is written once, with `#` for its number, and what one
//! volume has too is that very code, its names numbered.

use crate::{CLASSIFY, FIELD, FULLSCREEN, Gradient, LIGHTING, Light, MEDIUM, SHADE, SURFACES, TREE, gradient, sample};

/// The binding of the first volume's atlas; the others follow.
pub const FIRST_ATLAS: u32 = 16;

/// The binding of the first volume's stored gradients, behind as many atlases as there can be; the others follow.
pub const FIRST_GRADIENTS: u32 = 48;

/// What the shader has to know of a volume. Positions are in buffers that all volumes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VolumeShader {
    /// Whether code 0 is no value.
    pub has_invalid: bool,
    /// Whether the field is the tricubic spline of its voxels.
    pub is_cubic: bool,
    /// Whether it adds to what others show instead of mixing with it; then its places hold opacities, not depths.
    pub adds: bool,
    /// How its colours become lit ones.
    pub light: Light,
    /// How its gradients are found, if they do.
    pub gradient: Gradient,
    /// How its surfaces are lit, if it has some; they are even if its fog is not.
    pub surfaces: Option<Light>,
    /// The word of its octree's root.
    pub first_node: u32,
    /// Its first place in the transfer tables.
    pub first_place: u32,
    /// Its first count of opaque entries.
    pub first_count: u32,
    /// The bits of the value of code 0, and of the difference to that of the last.
    pub values: [u32; 2],
}

/// What the shader has to know of an expression over the volumes.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ExpressionShader {
    /// The function `expression` and its result.
    pub wgsl: String,
    /// The first place of its values' media in the transfer tables, and how many more there are.
    pub first_place: u32,
    /// See above.
    pub last_place: u32,
    /// The bits of the value of the first place, and of the difference to that of the last.
    pub values: [u32; 2],
}

/// The raycast compositor's pass for several volumes, or for an expression over them: entry points `fullscreen` and `raycast`.
pub fn raycast_together(volumes: &[VolumeShader], expression: Option<&ExpressionShader>) -> String {
    let many = |source: &str| source.replace("frame_settings", "frames[volume]");
    let (tree, find_place) = split(TREE, "fn find_place");
    let (macrocells, _) = split(include_str!("../wgsl/macrocells.wgsl"), "// A ray's way from");
    let (raycast, _) = split(include_str!("../wgsl/raycast.wgsl"), "// Macro-cells of a brick that are seen");
    let (pixel, rest) = split(include_str!("../wgsl/composite.wgsl"), "fn accumulate");
    let (_, is_final) = split(rest, "// Whatever lies behind");
    let (together, main) = split(include_str!("../wgsl/raycast_together.wgsl"), "@fragment");
    let numbered = |text: &str| (0..volumes.len()).map(|i| text.replace('#', &i.to_string())).collect::<Vec<_>>();
    let begin =
        "begin_#(position.xy);\n    whole = vec2f(min(whole.x, way_#.stretch.x), max(whole.y, way_#.stretch.y));";
    let look = "together = look_#(together, walk, threshold);";
    let count = volumes.len();
    let read = format!("values: array<f32, {count}>,\n    are_valid: array<bool, {count}>,\n    longest: f32,");
    let together = together.replace("READ", if expression.is_some() { &read } else { "" });
    let main = main.replace("COMBINE", if expression.is_some() { "together = combine(together);" } else { "" });
    let is_layered = volumes.iter().any(|volume| volume.surfaces.is_some());
    let main = match is_layered {
        true => main.replace("SEE", &see_pieces(volumes)),
        false => main.replace("SEE", "pixel = see(pixel, together);"),
    };
    let main =
        main.replace("BEGIN", &numbered(begin).join("\n    ")).replace("LOOK", &numbered(look).join("\n        "));
    let mut parts = vec![
        include_str!("../wgsl/frame.wgsl").to_string(),
        include_str!("../wgsl/frame_many.wgsl").to_string(),
        many(include_str!("../wgsl/ray.wgsl")),
        include_str!("../wgsl/dither.wgsl").to_string(),
        many(include_str!("../wgsl/lattice.wgsl")),
        CLASSIFY.to_string(),
        pixel.to_string(),
        is_final.to_string(),
        tree.to_string(),
        macrocells.to_string(),
        "@group(0) @binding(8) var<storage, read> opaque_before: array<u32>;".to_string(),
        "@group(0) @binding(3) var atlas_sampler: sampler;".to_string(),
        raycast.to_string(),
        together,
    ];
    parts.push(format!("const IS_LAYERED: bool = {is_layered};"));
    if volumes.iter().any(VolumeShader::has_gradients) {
        let (field, _) = split(FIELD, "// Through the brick");
        let (_, reach) = split(FIELD, "// World length");
        let (search, _) = split(SURFACES, "// How many surfaces");
        let axes = include_str!("../wgsl/axes.wgsl");
        parts.extend([field, reach, search, LIGHTING, &many(SHADE), axes].map(str::to_string));
    }
    for (i, volume) in volumes.iter().enumerate() {
        let (_, sample) = split(sample(volume.is_cubic, volume.has_invalid), "const HAS_INVALID");
        parts.push(own(&[find_place, sample].join("\n"), i));
        if volume.has_gradients() {
            parts.push(volume.lit(i));
        }
        parts.push(volume.surfaces(i, is_layered));
        parts.push(volume.declarations(i, expression.is_some(), is_layered));
    }
    parts.extend(expression.map(ExpressionShader::declarations));
    parts.extend([main, FULLSCREEN.to_string()]);
    parts.join("\n")
}

impl VolumeShader {
    fn is_lit(&self) -> bool {
        self.light != Light::Unlit
    }

    /// Whether anything of it is.
    fn has_gradients(&self) -> bool {
        self.is_lit() || self.surfaces.is_some()
    }

    /// What lights it.
    fn lit(&self, i: usize) -> String {
        let (_, field) = split(FIELD, "// Through the brick");
        let (field, _) = split(field, "// World length");
        let gradients = gradient(self.gradient).join("\n");
        let binding = FIRST_GRADIENTS as usize + i;
        let gradients = gradients.replace("@binding(10)", &format!("@binding({binding})"));
        let lit = include_str!("../wgsl/volume_lit.wgsl").replace("LIGHTu", &format!("{}u", self.light as u32));
        [own(&[field, &gradients].join("\n"), i), lit.replace('#', &i.to_string())].join("\n")
    }

    /// What finds its surfaces, and of a picture with surfaces what shares its medium out between them.
    fn surfaces(&self, i: usize, is_layered: bool) -> String {
        let mut parts = Vec::new();
        if let Some(light) = self.surfaces {
            let (_, inside) = split(MEDIUM, "fn inside");
            let (inside, _) = split(inside, "fn known_of");
            let (_, rank) = split(SURFACES, "// How many surfaces");
            let (rank, rest) = split(rank, "// Takes a segment");
            let (_, locate) = split(rest, "// Where in a piece");
            let (_, rank_of_code) = split(include_str!("../wgsl/sees_surfaces.wgsl"), "// How many surfaces");
            let (rank_of_code, _) = split(rank_of_code, "fn sees");
            parts.push(own(&[inside, rank, locate, rank_of_code].join("\n"), i));
            let surfaces = include_str!("../wgsl/volume_surfaces.wgsl");
            parts.push(surfaces.replace("SURFACE_LIGHTu", &format!("{}u", light as u32)));
        } else {
            parts.push(include_str!("../wgsl/volume_surfaces_none.wgsl").to_string());
        }
        if is_layered {
            let piece = match self.adds {
                false => "color += way_#.color * share;\n    together.depth += way_#.depth * share;",
                true => "glow += way_#.color * share;",
            };
            parts.push(include_str!("../wgsl/volume_piece.wgsl").replace("PIECE", piece));
        }
        parts.join("\n").replace('#', &i.to_string())
    }

    fn declarations(&self, i: usize, is_read: bool, is_layered: bool) -> String {
        let [low, width] = self.values.map(f32::from_bits);
        let read = format!(
            "together.values[#] = {low:?}f + value * {width:?}f;\n            together.are_valid[#] = true;\n            \
             together.longest = max(together.longest, end - start);"
        );
        let put = match self.adds {
            _ if is_read => &read,
            _ if is_layered => {
                "way_#.part = vec2f(start, end);\n            way_#.color = color * amount;\n            way_#.depth = amount;"
            }
            false => "together.color += color * amount;\n            together.depth += amount;",
            true => "together.glow += color * amount;",
        };
        let color = if self.is_lit() { "lit_#(t, value, medium)" } else { "medium.color" };
        let binding = FIRST_ATLAS as usize + i;
        include_str!("../wgsl/volume.wgsl")
            .replace("BINDING", &binding.to_string())
            .replace("FIRST_NODEu", &format!("{}u", self.first_node))
            .replace("FIRST_PLACEu", &format!("{}u", self.first_place))
            .replace("FIRST_COUNTu", &format!("{}u", self.first_count))
            .replace("COLOR", color)
            .replace("PUT", put)
            .replace('#', &i.to_string())
    }
}

impl ExpressionShader {
    fn declarations(&self) -> String {
        let [low, width] = self.values.map(f32::from_bits);
        let (first, last) = (self.first_place, self.last_place);
        let constants = format!(
            "const COMBINED_LOW: f32 = {low:?}f;\nconst COMBINED_WIDTH: f32 = {width:?}f;\n\
             const COMBINED_PLACE: u32 = {first}u;\nconst COMBINED_LAST: f32 = {last}.0;"
        );
        [&constants, &self.wgsl, include_str!("../wgsl/combine.wgsl")].join("\n")
    }
}

/// What sees a segment piece by piece, between the surfaces in it.
fn see_pieces(volumes: &[VolumeShader]) -> String {
    let all = volumes.iter().enumerate();
    let layered = || all.clone().filter(|(_, volume)| volume.surfaces.is_some());
    let next = layered().fold("1e30".to_string(), |next, (i, _)| format!("min({next}, way_{i}.crossing)"));
    let pass: Vec<_> = layered().map(|(i, _)| format!("pixel = pass_{i}(pixel, next);")).collect();
    let pieces: Vec<_> = all.map(|(i, _)| format!("piece = piece_{i}(piece, piece_start, piece_end);")).collect();
    include_str!("../wgsl/see_pieces.wgsl")
        .replace("NEXT", &next)
        .replace("PASS", &pass.join("\n                "))
        .replace("PIECES", &pieces.join("\n            "))
}

/// What is before a mark, and the rest. The mark is there: the test of every shader would fail.
fn split<'a>(source: &'a str, mark: &str) -> (&'a str, &'a str) {
    source.split_at(source.find(mark).unwrap_or(source.len()))
}

/// The names of one volume's code that there is one of for each.
const OWN: [&str; 19] = [
    "atlas",
    "frame",
    "sample_atlas",
    "spline",
    "row",
    "find_place",
    "ROOT",
    "HAS_INVALID",
    "MARGIN",
    "field_about",
    "value_at",
    "inside",
    "rank_of",
    "rank_of_code",
    "locate",
    "neighbour",
    "differences",
    "gradients",
    "GRADIENT_SCALE",
];

/// Code of one volume as that of volume `i`.
fn own(source: &str, i: usize) -> String {
    let is_of_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut out = String::with_capacity(source.len() + source.len() / 8);
    let mut rest = source;
    while !rest.is_empty() {
        let end = rest.find(|c| !is_of_name(c)).unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        out.push_str(word);
        if OWN.contains(&word) {
            out.push_str(&format!("_{i}"));
        }
        let next = after.find(is_of_name).unwrap_or(after.len());
        out.push_str(&after[..next]);
        rest = &after[next..];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered_as_whole_words() {
        let source = "frame.x * frames + atlas(atlas_sampler, find_place(ROOT))";
        assert_eq!(own(source, 7), "frame_7.x * frames + atlas_7(atlas_sampler, find_place_7(ROOT_7))");
    }

    #[test]
    fn all_atlases_come_before_all_gradients() {
        assert_eq!(FIRST_GRADIENTS, FIRST_ATLAS + brickyard_volume::MAX_VOLUMES as u32);
    }

    #[test]
    fn every_number_and_kind_of_volumes_is_valid() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        let all = [Light::Unlit, Light::Phong, Light::BlinnPhong, Light::Tone];
        let unlit = [Light::Unlit; 4];
        let kinds =
            [(1, unlit, false), (1, [Light::Phong; 4], false), (2, all, false), (2, unlit, true), (32, all, true)];
        for (count, lights, has_surfaces) in kinds {
            let volume = |i: u32| VolumeShader {
                has_invalid: i % 2 == 1,
                is_cubic: i / 2 % 2 == 1,
                adds: i / 4 % 2 == 1,
                light: lights[i as usize % 4],
                surfaces: (has_surfaces && i % 3 != 1).then_some(Light::BlinnPhong),
                gradient: [Gradient::Central, Gradient::Sobel, Gradient::Stored][i as usize / 2 % 3],
                first_node: 800 * i,
                first_place: 65536 * i,
                first_count: 65537 * i,
                values: [0f32.to_bits(), 255f32.to_bits()],
            };
            let volumes: Vec<_> = (0..count).map(volume).collect();
            let expression = ExpressionShader {
                wgsl: brickyard_volume::Expression::parse("sqrt(a * 2)", 1).unwrap().wgsl(count as usize),
                first_place: 7,
                last_place: 65535,
                values: [(-1e-7f32).to_bits(), 1e20f32.to_bits()],
            };
            for source in [raycast_together(&volumes, None), raycast_together(&volumes, Some(&expression))] {
                let module =
                    naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
                let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
                assert!(checked.is_ok(), "{count}: {:?}", checked.err());
                assert_eq!(module.entry_points.len(), 2);
                let frame = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some("Frame")).expect("a frame");
                let naga::TypeInner::Struct { span, .. } = frame.1.inner else { panic!("no struct") };
                assert_eq!(span as usize, size_of::<crate::FrameUniform>(), "frames follow one another in memory");
            }
        }
    }
}
