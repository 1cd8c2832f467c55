//! The WGSL of the renderer, by concern, composed by joining files: a variant holds just what it uses, so what is off
//! costs nothing. Bindings of group 0: 0 frame, 1 cells or bricks, 2 atlas, 3 sampler, 4 transfer table, 5 gathered picture,
//! 6 octree nodes, 7 ranges of macro-cells, 8 counts of opaque entries, 9 how bricks were entered, 10 stored gradients, from 16 on the
//! atlases of several volumes, and behind those their gradients. Where there are meshes, group 1 has what cuts the picture into slabs.
//! Group 2 has the texture that compute shaders write.

mod layout;
mod together;

pub use layout::{CellInstance, FrameUniform, HALVES_X, LEAF, MeshLook, MeshVertex, NO_RANGES, RayBrick};
pub use together::{ExpressionShader, FIRST_ATLAS, FIRST_GRADIENTS, VolumeShader, raycast_together};

/// How a cell's samples become its pixel, and how cells meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Gather {
    /// Emission and absorption; cells blend *over* each other.
    Composite,
    /// Maximum or minimum; cells blend by max.
    Project,
    /// Sums of value and length; cells add.
    Average,
    /// The first surface; cells blend *over* each other.
    Isosurface,
}

impl Gather {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Composite, Self::Project, Self::Average, Self::Isosurface];

    /// Whether what is in front hides what is behind: then rays can say with how much light they entered a brick.
    pub const fn occludes(self) -> bool {
        match self {
            Self::Composite | Self::Isosurface => true,
            Self::Project | Self::Average => false,
        }
    }
}

/// What [`Gather::Composite`] takes for the field along a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Curve {
    /// The value in the middle.
    Middle,
    /// A line between the ends.
    Line,
    /// A cubic curve.
    Cubic,
    /// The field, in more parts where the ends differ more.
    Field,
}

/// How colours become lit ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Light {
    /// Not at all.
    Unlit,
    /// By Phong's reflection.
    Phong,
    /// By Blinn's.
    BlinnPhong,
    /// From cool to warm.
    Tone,
}

/// How the field's gradient is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Gradient {
    /// From the six values next to a place.
    Central,
    /// From the 26 around it.
    Sobel,
    /// From a texture beside the atlas.
    Stored,
}

/// What else there is to see of a composite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Surfaces {
    /// Nothing.
    None,
    /// Isosurfaces in the fog.
    InFog,
    /// Isosurfaces and no fog.
    Alone,
}

/// How segments become media.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Medium {
    /// What is taken for the field.
    pub curve: Curve,
    /// Virtual samples of a segment.
    pub parts: u32,
    /// Whether they are pre-integrated.
    pub is_pre_integrated: bool,
    /// How colours become lit ones.
    pub light: Light,
    /// How gradients are found.
    pub gradient: Gradient,
    /// What else there is to see.
    pub surfaces: Surfaces,
    /// Whether they are classified by value and gradient magnitude.
    pub has_grid: bool,
}

impl Medium {
    /// One sample in the middle, unlit: what has shaders of its own.
    pub const PLAIN: Self = Self {
        curve: Curve::Middle,
        parts: 1,
        is_pre_integrated: false,
        light: Light::Unlit,
        gradient: Gradient::Central,
        surfaces: Surfaces::None,
        has_grid: false,
    };

    fn constants(&self) -> String {
        // Surfaces are lit, whether the fog is or not.
        let surface_light = if self.light == Light::Unlit { Light::BlinnPhong } else { self.light };
        format!(
            "const CURVE: u32 = {}u;\nconst PARTS: u32 = {}u;\nconst IS_PRE_INTEGRATED: bool = {};\n\
             const LIGHTING: u32 = {}u;\nconst SURFACE_LIGHTING: u32 = {}u;\n\
             const HAS_FOG: bool = {};\nconst HAS_SURFACES: bool = {};\nconst HAS_GRID: bool = {};",
            self.curve as u32,
            self.parts,
            self.is_pre_integrated,
            self.light as u32,
            surface_light as u32,
            self.surfaces != Surfaces::Alone,
            self.surfaces != Surfaces::None,
            self.has_grid
        )
    }
}

/// A march: everything that is decided when a pipeline is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Variant {
    /// How samples become a pixel.
    pub gather: Gather,
    /// Whether code 0 is no value, and left out of what is filtered.
    pub has_invalid: bool,
    /// Whether the field is the tricubic spline of its voxels.
    pub is_cubic: bool,
    /// How segments become media; [`Medium::PLAIN`] of all but [`Gather::Composite`].
    pub medium: Medium,
    /// Whether only a slab between meshes is drawn.
    pub has_meshes: bool,
}

impl Variant {
    /// What looks at samples of the gathering one by one.
    const fn has_samples(&self) -> bool {
        !matches!(self.gather, Gather::Isosurface) && self.is_plain()
    }

    const fn is_plain(&self) -> bool {
        let Medium { curve, light, surfaces, has_grid, .. } = self.medium;
        matches!((curve, light, surfaces), (Curve::Middle, Light::Unlit, Surfaces::None)) && !has_grid
    }
}

/// Steps of a brick's mark: a transmittance of 1.
pub const MARK_STEPS: u32 = 255;

const FRAME: &str = concat!(include_str!("../wgsl/frame.wgsl"), include_str!("../wgsl/frame_one.wgsl"));
const TREE: &str = include_str!("../wgsl/tree.wgsl");
const CLASSIFY: &str = include_str!("../wgsl/classify.wgsl");
const RAY: &str = include_str!("../wgsl/ray.wgsl");
const LIGHTING: &str = include_str!("../wgsl/lighting.wgsl");
const SHADE: &str = include_str!("../wgsl/shade.wgsl");
const FIELD: &str = include_str!("../wgsl/field.wgsl");
const MEDIUM: &str = include_str!("../wgsl/medium.wgsl");
const SURFACES: &str = include_str!("../wgsl/surfaces.wgsl");
const HIDDEN: &str = include_str!("../wgsl/hidden.wgsl");
const FULLSCREEN: &str = include_str!("../wgsl/fullscreen.wgsl");

/// The sorted compositor's march: entry points `proxy` and `march`.
pub fn sorted(variant: &Variant) -> String {
    let march = match variant.gather {
        _ if variant.has_samples() => include_str!("../wgsl/march_samples.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/march_surface.wgsl"),
        _ => include_str!("../wgsl/march_medium.wgsl"),
    };
    [&marching(variant), include_str!("../wgsl/sorted.wgsl"), march].join("\n")
}

/// By what shader rays are cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A fragment shader: entry points `fullscreen` and `raycast`.
    Fragment,
    /// A compute shader, for texels of this format: entry point `raycast`, in workgroups of [`WORKGROUP_PX`] squared pixels.
    Compute(&'static str),
}

/// Pixels along the edge of a compute shader's workgroup.
pub const WORKGROUP_PX: u32 = 8;

/// What casts a ray for each pixel. With `marks`, composites and surfaces say how bricks were entered (binding 9, a
/// [`MARK_STEPS`]th a step).
pub fn raycast(variant: &Variant, stage: Stage, marks: bool) -> String {
    let sees = match variant.gather {
        Gather::Composite if variant.medium.surfaces != Surfaces::None => include_str!("../wgsl/sees_surfaces.wgsl"),
        Gather::Composite => include_str!("../wgsl/sees_composite.wgsl"),
        Gather::Project => include_str!("../wgsl/sees_project.wgsl"),
        Gather::Average => include_str!("../wgsl/sees_average.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/sees_surface.wgsl"),
    };
    let (tree, macrocells) = (TREE, include_str!("../wgsl/macrocells.wgsl"));
    let mark = match variant.gather.occludes() && marks {
        true => include_str!("../wgsl/mark.wgsl"),
        false => include_str!("../wgsl/mark_none.wgsl"),
    };
    let raycast = match variant.gather {
        _ if variant.has_samples() => include_str!("../wgsl/raycast_samples.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/raycast_surface.wgsl"),
        _ => include_str!("../wgsl/raycast_medium.wgsl"),
    };
    let stage = match stage {
        Stage::Fragment => [FULLSCREEN, include_str!("../wgsl/raycast_fragment.wgsl")].join("\n"),
        Stage::Compute(format) => include_str!("../wgsl/raycast_compute.wgsl").replace("TEXEL_FORMAT", format),
    };
    let parts = [
        &marching(variant),
        "const ROOT: u32 = 0u;",
        tree,
        macrocells,
        sees,
        mark,
        include_str!("../wgsl/raycast.wgsl"),
        raycast,
        &stage,
    ];
    parts.join("\n")
}

/// What all marches share: the ray, its pixel's threshold, its lattice, a sample's value, and what samples add up to.
fn marching(variant: &Variant) -> String {
    let sample = sample(variant.is_cubic, variant.has_invalid);
    let accumulate = match variant.gather {
        Gather::Composite if variant.is_plain() => include_str!("../wgsl/composite.wgsl"),
        Gather::Composite => concat!(include_str!("../wgsl/grid.wgsl"), include_str!("../wgsl/medium.wgsl")),
        Gather::Project => include_str!("../wgsl/project.wgsl"),
        Gather::Average => include_str!("../wgsl/average.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/surface.wgsl"),
    };
    let (dither, lattice) = (include_str!("../wgsl/dither.wgsl"), include_str!("../wgsl/lattice.wgsl"));
    let limits = match variant.has_meshes {
        true => &[HIDDEN, include_str!("../wgsl/limits.wgsl")][..],
        false => &[include_str!("../wgsl/limits_none.wgsl")],
    };
    let mut parts = vec![FRAME, RAY, dither, lattice, sample, CLASSIFY];
    parts.extend(limits);
    parts.push(include_str!("../wgsl/jitter.wgsl"));
    let constants = variant.medium.constants();
    if !variant.has_samples() {
        parts.extend([FIELD, LIGHTING]);
    }
    if !variant.is_plain() {
        parts.push(&constants);
        parts.push(SHADE);
        parts.extend(gradient(variant.medium.gradient));
    }
    parts.push(accumulate);
    if !variant.is_plain() {
        parts.push(match variant.medium.surfaces {
            Surfaces::None => include_str!("../wgsl/surfaces_none.wgsl"),
            Surfaces::InFog | Surfaces::Alone => SURFACES,
        });
    }
    parts.join("\n")
}

fn gradient(gradient: Gradient) -> &'static [&'static str] {
    const NEIGHBOUR: &str = include_str!("../wgsl/neighbour.wgsl");
    match gradient {
        Gradient::Central => &[NEIGHBOUR, include_str!("../wgsl/gradient_central.wgsl")],
        Gradient::Sobel => &[NEIGHBOUR, include_str!("../wgsl/gradient_sobel.wgsl")],
        Gradient::Stored => &[include_str!("../wgsl/gradient_stored.wgsl")],
    }
}

fn sample(is_cubic: bool, has_invalid: bool) -> &'static str {
    match (is_cubic, has_invalid) {
        (false, false) => include_str!("../wgsl/sample.wgsl"),
        (false, true) => include_str!("../wgsl/sample_valid.wgsl"),
        (true, false) => include_str!("../wgsl/sample_cubic.wgsl"),
        (true, true) => include_str!("../wgsl/sample_cubic_valid.wgsl"),
    }
}

/// The pass from the gathered picture to display colours, or to those of a slab between meshes: entry points `fullscreen` and
/// `resolve`.
pub fn resolve(gather: Gather, has_meshes: bool) -> String {
    let seen = match gather {
        Gather::Composite | Gather::Isosurface => RESOLVE_COMPOSITE,
        Gather::Project => include_str!("../wgsl/resolve_project.wgsl"),
        Gather::Average => include_str!("../wgsl/resolve_average.wgsl"),
    };
    let resolve = if has_meshes { include_str!("../wgsl/resolve_slab.wgsl") } else { RESOLVE_PICTURE };
    [FRAME, CLASSIFY, FULLSCREEN, seen, resolve].join("\n")
}

const RESOLVE_COMPOSITE: &str = include_str!("../wgsl/resolve_composite.wgsl");
const RESOLVE_PICTURE: &str = include_str!("../wgsl/resolve_picture.wgsl");

/// The pass from all slabs to display colours: entry points `fullscreen` and `resolve`.
pub fn show_slabs() -> String {
    [FRAME, FULLSCREEN, RESOLVE_COMPOSITE, RESOLVE_PICTURE].join("\n")
}

/// The pass that finds the next layer of meshes: entry points `corner` and `peel`.
pub fn peel() -> String {
    [FRAME, RAY, LIGHTING, HIDDEN, include_str!("../wgsl/peel.wgsl")].join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{TransferGrid, gradients, integrals, jitter, lighting, mesh, sampling, surface};
    use naga::{Module, TypeInner};
    use std::mem::{offset_of, size_of};

    const COMPUTE: Stage = Stage::Compute("rgba32float");

    /// Every way in which segments become media.
    fn media() -> Vec<Medium> {
        let mut all = Vec::new();
        for curve in [Curve::Middle, Curve::Line, Curve::Cubic, Curve::Field] {
            for light in [Light::Unlit, Light::Phong, Light::BlinnPhong, Light::Tone] {
                for (is_pre_integrated, gradient) in [
                    (false, Gradient::Central),
                    (true, Gradient::Central),
                    (false, Gradient::Sobel),
                    (true, Gradient::Stored),
                ] {
                    all.push(Medium { curve, parts: 3, is_pre_integrated, light, gradient, ..Medium::PLAIN });
                }
                all.push(Medium { curve, light, surfaces: Surfaces::Alone, ..Medium::PLAIN });
                for has_grid in [false, true] {
                    all.push(Medium { curve, light, surfaces: Surfaces::InFog, has_grid, ..Medium::PLAIN });
                }
                for gradient in [Gradient::Central, Gradient::Sobel, Gradient::Stored] {
                    all.push(Medium { curve, parts: 3, light, gradient, has_grid: true, ..Medium::PLAIN });
                }
            }
        }
        all
    }

    /// Every shader there is, with a name for messages.
    fn variants() -> Vec<(String, String)> {
        let mut all = Vec::new();
        for gather in Gather::ALL {
            let media = if gather == Gather::Composite { media() } else { vec![Medium::PLAIN] };
            for medium in media {
                for (has_invalid, is_cubic) in [(false, false), (true, false), (false, true), (true, true)] {
                    let variant = Variant { gather, has_invalid, is_cubic, medium, has_meshes: is_cubic };
                    all.push((format!("sorted {variant:?}"), sorted(&variant)));
                    all.push((format!("raycast {variant:?}"), raycast(&variant, Stage::Fragment, true)));
                    all.push((format!("raycast compute {variant:?}"), raycast(&variant, COMPUTE, true)));
                }
            }
            let medium = Medium::PLAIN;
            let plain = Variant { gather, has_invalid: false, is_cubic: false, medium, has_meshes: false };
            all.push((format!("raycast {gather:?} without marks"), raycast(&plain, Stage::Fragment, false)));
            for has_meshes in [false, true] {
                all.push((format!("resolve {gather:?}, {has_meshes}"), resolve(gather, has_meshes)));
            }
        }
        all.push(("peel".to_string(), peel()));
        all.push(("show slabs".to_string(), show_slabs()));
        all
    }

    fn parse(name: &str, source: &str) -> Module {
        naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)))
    }

    #[test]
    fn every_variant_is_valid() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        for (name, source) in variants() {
            let module = parse(&name, &source);
            let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
            assert!(checked.is_ok(), "{name}: {:?}", checked.err());
            let entries = if name.starts_with("raycast compute") { 1 } else { 2 };
            assert_eq!(module.entry_points.len(), entries, "{name}");
            if let [entry] = &module.entry_points[..] {
                assert_eq!(entry.workgroup_size, [WORKGROUP_PX * WORKGROUP_PX, 1, 1], "{name}");
            }
        }
    }

    #[test]
    fn expressions_are_valid_shaders() {
        let every = "a + b * c / v3 - a ^ -2 + min(a, b) * max(b, c) + (a < b && b <= c || a == 1e300 || !c ? sin(a) : cos(b)) \
                     + default(sqrt(a), exp(b)) + valid(log(c)) + abs(a) + sign(b) + floor(a) + ceil(b) + round(c) + 1e-7";
        for text in [every, "a", "1"] {
            let wgsl = brickyard_volume::Expression::parse(text, 4).unwrap().wgsl(4);
            let module = parse(text, &wgsl);
            use naga::valid::{Capabilities, ValidationFlags, Validator};
            let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
            assert!(checked.is_ok(), "{text}: {:?}\n{wgsl}", checked.err());
        }
    }

    /// Members as (name, offset), and the span, of a struct.
    fn layout(module: &Module, name: &str) -> (Vec<(String, usize)>, usize) {
        for (_, ty) in module.types.iter() {
            if let (Some(n), TypeInner::Struct { members, span }) = (&ty.name, &ty.inner)
                && n == name
            {
                let member = |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
                return (members.iter().map(member).collect(), *span as usize);
            }
        }
        panic!("no struct {name}");
    }

    macro_rules! offsets {
        ($t:ty: $($field:ident)*) => { vec![$((stringify!($field).to_string(), offset_of!($t, $field))),*] };
    }

    #[test]
    fn structs_have_the_layout_of_their_twins() {
        for (name, source) in variants() {
            let module = parse(&name, &source);
            let expected = offsets!(FrameUniform: eye step forward slack right half_width up half_height clip_x near clip_y
                pixel_share clip_w per_unit_distance extent last_code spacing orthographic texel invert background tree_depth
                size_px last_place sum_unit root_size macro_cells shown_low slot_edge shown_high lights surface_color
                threshold shift plane_count jitter jitter_seed mesh_far gradient_edge first_gradient grid_at first_row adaptive_step spare grid thresholds
                surfaces light_places axes slopes zone_starts planes);
            assert_eq!(layout(&module, "Frame"), (expected, size_of::<FrameUniform>()), "{name}");
            if name.starts_with("sorted") {
                let expected = offsets!(CellInstance: region_min pixels_from region_max pixels_to texel_scale spare
                    texel_offset spare_2);
                assert_eq!(layout(&module, "Cell"), (expected, size_of::<CellInstance>()), "{name}");
            }
            if name == "peel" {
                let expected = offsets!(MeshVertex: place color normal spare);
                assert_eq!(layout(&module, "MeshVertex"), (expected, size_of::<MeshVertex>()), "{name}");
                let expected = offsets!(MeshLook: color opacity flags spare);
                assert_eq!(layout(&module, "MeshLook"), (expected, size_of::<MeshLook>()), "{name}");
            }
            if name.starts_with("raycast") {
                let expected = offsets!(RayBrick: texel_scale first_range texel_offset range low pixels_to);
                assert_eq!(layout(&module, "RayBrick"), (expected, size_of::<RayBrick>()), "{name}");
            }
        }
    }

    #[test]
    fn constants_are_those_of_the_shader() {
        let variant =
            |gather, medium| Variant { gather, has_invalid: false, is_cubic: false, medium, has_meshes: false };
        let surface = variant(Gather::Isosurface, Medium::PLAIN);
        let lit = variant(Gather::Composite, Medium { light: Light::Phong, ..Medium::PLAIN });
        let foggy = variant(Gather::Composite, Medium { surfaces: Surfaces::InFog, ..Medium::PLAIN });
        let single = |value: f64| naga::Literal::F32(value as f32);
        let expected = [
            ("BLUE_EDGE", naga::Literal::U32(jitter::BLUE_EDGE as u32)),
            ("JITTER_STEPS", naga::Literal::U32(jitter::STEPS)),
            ("PARTS", naga::Literal::U32(surface::PARTS as u32)),
            ("ROUNDS", naga::Literal::U32(surface::ROUNDS as u32)),
            ("AMBIENT", single(lighting::AMBIENT)),
            ("DIFFUSE", single(lighting::DIFFUSE)),
            ("SPECULAR", single(lighting::SPECULAR)),
            ("SPECULAR_POWER", single(lighting::SPECULAR_POWER as f64)),
            ("FLAT_CODES", single(surface::FLAT_CODES)),
            ("LEAF", naga::Literal::U32(LEAF)),
            ("GROUP", naga::Literal::U32(HALVES_X - 1)),
            ("MARK_STEPS", naga::Literal::F32(MARK_STEPS as f32)),
            ("NO_RANGES", naga::Literal::U32(NO_RANGES)),
        ];
        let surface = parse("a surface", &raycast(&surface, COMPUTE, true));
        let expected = expected.map(|(name, value)| (&surface, name, value));
        let lit = parse("a lit composite", &raycast(&lit, COMPUTE, true));
        let stored = Medium { light: Light::Phong, gradient: Gradient::Stored, ..Medium::PLAIN };
        let stored = parse("stored gradients", &raycast(&variant(Gather::Composite, stored), COMPUTE, true));
        let of_gradients = [("GRADIENT_SCALE", single(gradients::SCALE as f64))];
        let of_media = [
            ("MOST_PARTS", naga::Literal::U32(sampling::MOST_PARTS as u32)),
            ("CLOSE_CODES", single(integrals::CLOSE_CODES)),
            ("MAX_DEPTH", single(integrals::MAX_DEPTH)),
            ("GRID_COLUMNS", naga::Literal::U32(TransferGrid::COLUMNS as u32)),
        ];
        let of_media = of_media.map(|(name, value)| (&lit, name, value));
        let foggy = parse("surfaces in fog", &raycast(&foggy, COMPUTE, true));
        let of_surfaces = [
            (&foggy, "SEARCH_PARTS", naga::Literal::U32(surface::PARTS as u32)),
            (&foggy, "ROUNDS", naga::Literal::U32(surface::ROUNDS as u32)),
        ];
        let peel = parse("peel", &peel());
        let of_meshes = [
            ("PLAIN_COLOR", single(mesh::PLAIN_COLOR[0])),
            ("HAS_COLOR", naga::Literal::U32(MeshLook::HAS_COLOR)),
            ("HAS_COLORS", naga::Literal::U32(MeshLook::HAS_COLORS)),
            ("HAS_NORMALS", naga::Literal::U32(MeshLook::HAS_NORMALS)),
            ("IS_LIT", naga::Literal::U32(MeshLook::IS_LIT)),
        ];
        let of_meshes = of_meshes.map(|(name, value)| (&peel, name, value));
        let of_gradients = of_gradients.map(|(name, value)| (&stored, name, value));
        for (module, name, value) in
            expected.into_iter().chain(of_gradients).chain(of_media).chain(of_surfaces).chain(of_meshes)
        {
            let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).expect(name);
            let found = &module.global_expressions[constant.init];
            assert!(matches!(found, naga::Expression::Literal(v) if *v == value), "{name}: {found:?}");
        }
    }
}
