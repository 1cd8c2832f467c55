//! The WGSL of the renderer, by concern, composed by imports (`compose`): a variant holds just what it uses, so what is off costs
//! nothing. What is bound where is in [`bindings`]. Shared code is about one layer at a time, which it finds in its *context*: of one
//! layer that is all constants; of several see `joint`.

pub mod bindings;
mod compose;
mod joint;
mod layout;

use compose::Parts;
pub use joint::{ExpressionShader, FirstPlaces, JointVariant, LayerShader};
pub use layout::{CellBrick, CellInstance, FrameUniform, HALVES_X, LEAF, MeshLook, MeshVertex, NO_RANGES, RayBrick};

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
    /// Phong's reflection.
    Phong,
    /// Blinn's reflection.
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

    /// Surfaces are lit, whether the fog is or not.
    fn surface_light(&self) -> Light {
        if self.light == Light::Unlit { Light::BlinnPhong } else { self.light }
    }

    fn constants(&self) -> String {
        format!(
            "const CURVE: u32 = {}u;\nconst PARTS: u32 = {}u;\nconst IS_PRE_INTEGRATED: bool = {};\n\
             const LIGHTING: u32 = {}u;\nconst SURFACE_LIGHTING: u32 = {}u;\n\
             const HAS_FOG: bool = {};\nconst HAS_SURFACES: bool = {};\nconst HAS_GRID: bool = {};\n",
            self.curve as u32,
            self.parts,
            self.is_pre_integrated,
            self.light as u32,
            self.surface_light() as u32,
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
    /// Whether the volume is elsewhere than in its own world.
    pub is_placed: bool,
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

/// The sorted compositor's march: entry points `proxy` and `march`.
pub fn sorted(variant: &Variant) -> String {
    let march = match variant.gather {
        _ if variant.has_samples() => "march_samples",
        Gather::Isosurface => "march_surface",
        _ => "march_medium",
    };
    variant.parts().compose(&[march])
}

/// The kind of shader that casts rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A fragment shader: entry points `fullscreen` and `raycast`.
    Fragment,
    /// A compute shader, for texels of this format: entry point `raycast`, in workgroups of [`WORKGROUP_PX`] squared pixels.
    Compute(&'static str),
}

impl Stage {
    fn root(self) -> &'static str {
        match self {
            Self::Fragment => "raycast_fragment",
            Self::Compute(_) => "raycast_compute",
        }
    }

    /// Adds what the stage writes, if it is a compute shader.
    fn part(self, parts: Parts) -> Parts {
        match self {
            Self::Fragment => parts,
            Self::Compute(format) => {
                parts.text("texels", format!("alias Texels = texture_storage_2d<{format}, write>;"))
            }
        }
    }
}

/// Pixels along the edge of a compute shader's workgroup.
pub const WORKGROUP_PX: u32 = 8;

/// What casts a ray for each pixel through one layer. With `marks`, composites and surfaces say how bricks were entered
/// ([`bindings::MARKS`], a [`MARK_STEPS`]th a step).
pub fn raycast(variant: &Variant, stage: Stage, marks: bool) -> String {
    let sees = match variant.gather {
        Gather::Composite if variant.medium.surfaces != Surfaces::None => "sees_surfaces",
        Gather::Composite => "sees_composite",
        Gather::Project => "sees_project",
        Gather::Average => "sees_average",
        Gather::Isosurface => "sees_surface",
    };
    let cast = match variant.gather {
        _ if variant.has_samples() => "raycast_samples",
        Gather::Isosurface => "raycast_surface",
        _ => "raycast_medium",
    };
    let mark = if variant.gather.occludes() && marks { "mark" } else { "mark_none" };
    let parts = variant.parts().file("sees", sees).file("cast", cast).file("feedback", mark);
    stage.part(parts).compose(&[stage.root()])
}

/// What casts a ray for each pixel through several layers at once; otherwise as [`raycast`].
pub fn raycast_joint(variant: &JointVariant, stage: Stage, marks: bool) -> String {
    variant.casting(stage, marks).compose(&[stage.root()])
}

/// The sorted compositor's march through several layers at once that share their grid; otherwise as [`sorted`].
pub fn sorted_joint(variant: &JointVariant) -> String {
    variant.parts().file("find", "find_cell").compose(&["march_joint"])
}

impl JointVariant {
    /// Adds what casts rays.
    fn casting(&self, stage: Stage, marks: bool) -> Parts {
        let feedback = if marks { "mark" } else { "mark_none" };
        stage.part(self.parts().file("cast", "cast_joint").file("find", "find_leaf").file("feedback", feedback))
    }
}

impl Variant {
    /// What all marches share: the layer's context, and what its samples add up to.
    fn parts(&self) -> Parts {
        let pixel = match self.gather {
            Gather::Composite if self.is_plain() => "composite",
            Gather::Composite => "through",
            Gather::Project => "project",
            Gather::Average => "average",
            Gather::Isosurface => "surface",
        };
        let take = if self.medium.surfaces == Surfaces::None { "surfaces_none" } else { "surfaces" };
        Parts::new()
            .text("context", context(self.has_invalid, self.is_cubic) + &self.medium.constants())
            .text("atlas", joint::atlases(&[(0, self.has_invalid)], self.is_cubic))
            .file("world", if self.is_placed { "axes" } else { "axes_own" })
            .file("limits", if self.has_meshes { "limits_slab" } else { "limits_none" })
            .file("gradient", self.medium.gradient.file())
            .file("pixel", pixel)
            .file("take", take)
    }
}

/// The context of a layer that is alone.
fn context(has_invalid: bool, is_cubic: bool) -> String {
    let firsts: String =
        ["NODE", "BRICK", "RANGE", "PLACE", "COUNT"].map(|what| format!("const FIRST_{what}: u32 = 0u;\n")).concat();
    format!(
        "const LAYERS: u32 = 1u;\nconst layer: u32 = 0u;\n{firsts}const HAS_INVALID: bool = {has_invalid};\n\
         const MARGIN: f32 = {:?};\n",
        margin(is_cubic)
    )
}

/// Texels between a sample and the edge of what it may touch.
fn margin(is_cubic: bool) -> f32 {
    if is_cubic { 1.5 } else { 0.5 }
}

impl Gradient {
    fn file(self) -> &'static str {
        match self {
            Self::Central => "gradient_central",
            Self::Sobel => "gradient_sobel",
            Self::Stored => "gradient_stored",
        }
    }
}

/// The file with what samples an atlas.
fn sample(is_cubic: bool, has_invalid: bool) -> &'static str {
    match (is_cubic, has_invalid) {
        (false, false) => "sample",
        (false, true) => "sample_valid",
        (true, false) => "sample_cubic",
        (true, true) => "sample_cubic_valid",
    }
}

/// What a resolving pass makes its colours of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Seen {
    /// What has been gathered.
    Gathered(Gather),
    /// What has been composed of all slabs.
    Slabs,
    /// Projections of several layers, joined.
    Joined,
}

/// What a resolving pass draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shown {
    /// Display colours.
    Picture,
    /// Colours of a slab between meshes.
    Slab,
    /// A layer's part of the sums of joined projections: two targets.
    Sums,
}

/// A resolving pass: entry points `fullscreen` and `resolve`.
pub fn resolve(seen: Seen, shown: Shown) -> String {
    let seen = match seen {
        Seen::Gathered(Gather::Composite | Gather::Isosurface) | Seen::Slabs => "resolve_composite",
        Seen::Gathered(Gather::Project) => "resolve_project",
        Seen::Gathered(Gather::Average) => "resolve_average",
        Seen::Joined => "resolve_joined",
    };
    let resolve = match shown {
        Shown::Picture => "resolve_picture",
        Shown::Slab => "resolve_slab",
        Shown::Sums => "resolve_join",
    };
    Parts::new().text("context", context(false, false)).file("seen", seen).compose(&[resolve])
}

/// How the pictures of eyes share one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Eyes {
    /// There is one eye.
    One,
    /// The left eye's in the left half, the right eye's in the right.
    SideBySide,
    /// The left eye's in the top half, the right eye's below.
    TopBottom,
    /// Colours for red-cyan glasses.
    Anaglyph,
    /// Rows in turns.
    Interlaced,
}

impl Eyes {
    /// All five.
    pub const ALL: [Self; 5] = [Self::One, Self::SideBySide, Self::TopBottom, Self::Anaglyph, Self::Interlaced];

    fn file(self) -> &'static str {
        match self {
            Self::One => "eyes_one",
            Self::SideBySide => "eyes_side_by_side",
            Self::TopBottom => "eyes_top_bottom",
            Self::Anaglyph => "eyes_anaglyph",
            Self::Interlaced => "eyes_interlaced",
        }
    }
}

/// The pass that puts a finished picture on an application's texture, which stores colours or, with `encodes`, the codes of light: entry
/// points `stretched` and `blit`.
pub fn blit(eyes: Eyes, encodes: bool) -> String {
    blit_parts(eyes, encodes).compose(&["blit"])
}

fn blit_parts(eyes: Eyes, encodes: bool) -> Parts {
    Parts::new().file("eyes", eyes.file()).file("written", if encodes { "written_light" } else { "written_codes" })
}

/// The pass that finds the next layer of meshes: entry points `corner` and `peel`.
pub fn peel() -> String {
    Parts::new().text("context", context(false, false)).compose(&["peel"])
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{
        TransferGrid, compositing, gradients, jitter, lighting, mesh, preintegration, sampling, surface,
    };
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
                    let has_meshes = is_cubic;
                    let variant = Variant { gather, has_invalid, is_cubic, medium, has_meshes, is_placed: has_invalid };
                    all.push((format!("sorted {variant:?}"), sorted(&variant)));
                    all.push((format!("raycast {variant:?}"), raycast(&variant, Stage::Fragment, true)));
                    all.push((format!("raycast compute {variant:?}"), raycast(&variant, COMPUTE, true)));
                }
                if gather == Gather::Composite {
                    all.extend(joint(medium));
                }
            }
            let medium = Medium::PLAIN;
            let plain =
                Variant { gather, has_invalid: false, is_cubic: false, medium, has_meshes: false, is_placed: false };
            all.push((format!("raycast {gather:?} without marks"), raycast(&plain, Stage::Fragment, false)));
            for shown in [Shown::Picture, Shown::Slab, Shown::Sums] {
                all.push((format!("resolve {gather:?}, {shown:?}"), resolve(Seen::Gathered(gather), shown)));
            }
        }
        all.extend(joint_expressions());
        all.push(("peel".to_string(), peel()));
        for (seen, shown) in
            [(Seen::Slabs, Shown::Picture), (Seen::Joined, Shown::Picture), (Seen::Joined, Shown::Slab)]
        {
            all.push((format!("show {seen:?}, {shown:?}"), resolve(seen, shown)));
        }
        all
    }

    fn layer_shader(i: u32, has_surfaces: bool) -> LayerShader {
        let at = 768 * i;
        LayerShader {
            pool: i % 4,
            has_invalid: i % 2 == 1,
            adds: i / 2 % 2 == 1,
            has_surfaces,
            has_grid: i % 3 == 1,
            first: FirstPlaces { range: at, place: at, count: at },
            values: [0f32.to_bits(), 255f32.to_bits()],
        }
    }

    /// One to three layers of which all media are such.
    fn joint(medium: Medium) -> Vec<(String, String)> {
        let mut all = Vec::new();
        for (count, is_cubic) in [(1, true), (3, false)] {
            let layers = (0..count).map(|i| layer_shader(i, medium.surfaces != Surfaces::None && i != 1)).collect();
            let variant = JointVariant { medium, is_cubic, has_meshes: is_cubic, layers, expression: None };
            let stage = if is_cubic { COMPUTE } else { Stage::Fragment };
            let name = if is_cubic { "raycast compute joint" } else { "raycast joint" };
            all.push((format!("{name} {count} {medium:?}"), raycast_joint(&variant, stage, !is_cubic)));
            all.push((format!("sorted joint {count} {medium:?}"), sorted_joint(&variant)));
        }
        all
    }

    /// As many layers as there can be, and expressions over some.
    fn joint_expressions() -> Vec<(String, String)> {
        let of = |count: u32, expression: Option<(Light, ExpressionShader)>| {
            let fog = Medium { curve: Curve::Cubic, light: Light::Phong, surfaces: Surfaces::InFog, ..Medium::PLAIN };
            let medium = expression.as_ref().map_or(fog, |(light, _)| Medium { light: *light, ..Medium::PLAIN });
            let layers = (0..count).map(|i| layer_shader(i, expression.is_none())).collect();
            let expression = expression.map(|(_, expression)| expression);
            let variant = JointVariant { medium, is_cubic: false, has_meshes: false, layers, expression };
            (format!("raycast joint, {count} layers"), raycast_joint(&variant, Stage::Fragment, true))
        };
        let expression = |light: Light, count: u32| {
            let expression = brickyard_volume::Expression::parse("sqrt(a * 2)", 1).unwrap();
            let wgsl = match light {
                Light::Unlit => expression.wgsl(count as usize),
                _ => expression.wgsl_with_gradient(count as usize),
            };
            let values = [(-1e-7f32).to_bits(), 1e20f32.to_bits()];
            Some((light, ExpressionShader { wgsl, first_place: 7, last_place: 65535, values }))
        };
        let most = brickyard_volume::MAX_VOLUMES as u32;
        let (alone, all) = (expression(Light::Unlit, 1), expression(Light::Tone, most));
        vec![of(most, None), of(1, alone), of(2, expression(Light::Phong, 2)), of(most, all)]
    }

    #[test]
    fn all_atlases_come_before_all_gradients() {
        assert_eq!(bindings::FIRST_GRADIENTS, bindings::FIRST_ATLAS + brickyard_volume::MAX_VOLUMES as u32);
    }

    /// In the company of some variant, with nothing but what it imports.
    #[test]
    fn every_file_is_valid_by_itself() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        let of = |gather, medium| Variant {
            gather,
            has_invalid: false,
            is_cubic: false,
            medium,
            has_meshes: false,
            is_placed: false,
        };
        let lit = Medium { light: Light::Phong, surfaces: Surfaces::InFog, ..Medium::PLAIN };
        let single = [
            (of(Gather::Composite, Medium::PLAIN), "sees_composite", "raycast_samples"),
            (of(Gather::Composite, lit), "sees_surfaces", "raycast_medium"),
            (of(Gather::Project, Medium::PLAIN), "sees_project", "raycast_samples"),
            (of(Gather::Isosurface, Medium::PLAIN), "sees_surface", "raycast_surface"),
        ];
        let mut companies: Vec<Parts> = vec![blit_parts(Eyes::One, true), blit_parts(Eyes::One, false)];
        for (variant, sees, cast) in single {
            let parts = variant.parts().file("sees", sees).file("cast", cast).file("feedback", "mark");
            companies.push(COMPUTE.part(parts).file("seen", "resolve_composite"));
        }
        let layers: Vec<_> = (0..2).map(|i| layer_shader(i, true)).collect();
        let joint = JointVariant { medium: lit, is_cubic: false, has_meshes: false, layers, expression: None };
        companies.push(joint.casting(COMPUTE, true));
        companies.push(joint.parts().file("find", "find_cell"));
        let read = brickyard_volume::Expression::parse("a", 1).unwrap();
        for (light, wgsl) in [(Light::Unlit, read.wgsl(2)), (Light::Phong, read.wgsl_with_gradient(2))] {
            let expression = Some(ExpressionShader { wgsl, first_place: 0, last_place: 1, values: [0, 0] });
            let joint = JointVariant { medium: Medium { light, ..Medium::PLAIN }, expression, ..joint.clone() };
            companies.push(joint.casting(COMPUTE, true));
        }
        for (name, _) in compose::FILES {
            let check = |parts: &Parts| -> Result<(), String> {
                let source = parts.gather(&[name])?;
                let module = naga::front::wgsl::parse_str(&source).map_err(|e| e.emit_to_string(&source))?;
                let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
                validator.validate(&module).map_err(|e| e.emit_to_string(&source)).map(|_| ())
            };
            let problems: Vec<_> = companies.iter().filter_map(|parts| check(parts).err()).collect();
            assert!(problems.len() < companies.len(), "{name}: {problems:#?}");
        }
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
        let of = |text: &str| brickyard_volume::Expression::parse(text, 4).unwrap();
        let both = |text| [of(text).wgsl(4), of(text).wgsl_with_gradient(4)].map(|wgsl| (text, wgsl));
        for (text, wgsl) in [every, "a", "1"].into_iter().flat_map(both) {
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
                threshold shift plane_count jitter jitter_seed mesh_far gradient_edge first_gradient grid_at first_row adaptive_step adds
                opacity reach flat_depth grid thresholds
                surfaces light_places axes slopes zone_starts planes list_at spare);
            assert_eq!(layout(&module, "Frame"), (expected, size_of::<FrameUniform>()), "{name}");
            assert_eq!(size_of::<FrameUniform>() % 256, 0, "frames begin where any device can bind them");
            if name.starts_with("sorted") {
                let expected = offsets!(CellInstance: region_min pixels_from region_max pixels_to);
                assert_eq!(layout(&module, "Cell"), (expected, size_of::<CellInstance>()), "{name}");
                let expected = offsets!(CellBrick: texel_scale is_there texel_offset spare);
                assert_eq!(layout(&module, "CellBrick"), (expected, size_of::<CellBrick>()), "{name}");
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
        let variant = |gather, medium| Variant {
            gather,
            has_invalid: false,
            is_cubic: false,
            medium,
            has_meshes: false,
            is_placed: false,
        };
        let surface = variant(Gather::Isosurface, Medium::PLAIN);
        let lit = variant(Gather::Composite, Medium { light: Light::Phong, ..Medium::PLAIN });
        let foggy = variant(Gather::Composite, Medium { surfaces: Surfaces::InFog, ..Medium::PLAIN });
        let single = |value: f64| naga::Literal::F32(value as f32);
        let expected = [
            ("BLUE_EDGE", naga::Literal::U32(jitter::BLUE_EDGE as u32)),
            ("JITTER_STEPS", naga::Literal::U32(jitter::STEPS)),
            ("SEARCH_PARTS", naga::Literal::U32(surface::PARTS as u32)),
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
            ("CLOSE_CODES", single(preintegration::CLOSE_CODES)),
            ("MAX_DEPTH", single(preintegration::MAX_DEPTH)),
            ("OPAQUE", single(compositing::OPAQUE)),
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
