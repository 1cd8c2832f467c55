//! The renderer's WGSL, by concern, composed by imports (`compose`). A variant contains only the code it uses, so disabled features cost
//! nothing. [`bindings`] numbers all bindings. Shared code handles one layer at a time, found in its *context*: constants for a single layer;
//! for several layers see `joint`.
//!
//! # Files and parts
//!
//! | folder of `shaders/wgsl` | holds |
//! | --- | --- |
//! | `passes` | root files of pipelines, with entry points |
//! | `shared` | code common to passes, one noun a file |
//! | `parts/PART` | the files for a part, of which the variant chooses one |
//!
//! Files import files and parts by name. Some parts have no folder: their text is made for the variant. A part's file or text declares the
//! functions called by the files that import it.
//!
//! | part | role |
//! | --- | --- |
//! | `bindings` | the numbers of all bindings: text of the table in [`bindings`] |
//! | `Frame`, `RayBrick` and others | the struct of that name: text made from its declaration in `layout` |
//! | `context` | constants of the variant and of the current layer: text; for several layers, also variables, set for each in turn |
//! | `atlas` | the atlases and stored gradients, and their samples (`sample_atlas`, `smooth_atlas` for gradients, `sample_gradients`): text that imports `sample` or `sample_cubic`; `sample_voxels` or `sample_cubic_voxels` for 32-bit floats, narrow windows, and voxels without a value; also `sample_nearest` or `sample_nearest_voxel` for fields with steps |
//! | `world` | the map from voxels to the scene's world: `to_world`, `gradient_to_world` |
//! | `limits` | the part of a ray's stretch between meshes: `limited` |
//! | `gradient` | differences of values about a place: `differences` |
//! | `pixel` | the sum of a ray's samples: `Pixel` |
//! | `boxes` | samples of bricks by the boxes of segments, for coarse levels of extremes: `take_box` |
//! | `take` | a segment of one layer: `take` |
//! | `sees` | whether samples with codes in a range can change a ray's pixel: `sees` |
//! | `cast` | a ray from its start to its end: `cast_ray` |
//! | `feedback` | marks of the bricks entered by rays: `mark` |
//! | `texels` | the type of the texture written by a compute shader, `Texels`: text with the texture's format |
//! | `layers` | the variables of several layers, and operations on all of them (`take_all` and others): text; each function lists the layers one after the other, or loops over the `kept` ones |
//! | `asking` | queries of a ray over all layers (`is_any_due` and others): text, likewise |
//! | `find` | the brick of a layer, `find`: for rays through octrees, or for cells drawn as boxes |
//! | `part` | one of several layers in a segment: `show_part` |
//! | `see` | all layers together: `see_all` |
//! | `value` | the colour of an expression's value: `value_color` |
//! | `expression` | the expression over the values read from the layers, `result_of`: text around the expression's own function |
//! | `seen` | the colours of a resolving pass: `seen` |
//! | `eyes` | the pictures of both eyes in one: `color_of_eyes` |
//! | `written` | a colour in the form of an application's texture: `written` |

pub mod bindings;
mod compose;
mod joint;
mod layout;

use brickyard_volume::sampling::Curve;
use brickyard_volume::{Filter, Gradient, LightingModel, StereoLayout};
use compose::Parts;
pub use joint::{ExpressionShader, FirstPlaces, JointVariant, LayerShader};
pub use layout::{CellBrick, CellInstance, FrameUniform, HALVES_X, LEAF, MeshLook, MeshVertex, NO_RANGES, RayBrick};

/// How a ray's samples become its pixel, and how the pixels of separately drawn cells are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Gather {
    /// Emission and absorption, of fog, isosurfaces or both. Cells blend *over* each other.
    Composite,
    /// The maximum or the minimum of the values. Cells blend by max.
    Project,
    /// Sums of values times lengths, and of lengths. Cells add.
    Average,
    /// The first hit of one opaque isosurface, lit from the eye. Cells blend *over* each other.
    Isosurface,
}

impl Gather {
    /// All four ways to gather.
    pub const ALL: [Self; 4] = [Self::Composite, Self::Project, Self::Average, Self::Isosurface];

    /// Whether the front hides the back. Only then can rays report the light with which they entered a brick.
    pub const fn occludes(self) -> bool {
        match self {
            Self::Composite | Self::Isosurface => true,
            Self::Project | Self::Average => false,
        }
    }
}

/// Whether a composite shows isosurfaces, fog, or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Surfaces {
    /// Fog without isosurfaces.
    None,
    /// Isosurfaces in fog.
    InFog,
    /// Isosurfaces without fog.
    Alone,
}

/// How the segments of a ray become media.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Medium {
    /// The assumed field along a segment.
    pub curve: Curve,
    /// Number of virtual samples in a segment; unused by [`Curve::Middle`] and [`Curve::Field`].
    pub parts: u32,
    /// Whether virtual samples are pre-integrated: each is the mean of the transfer function over the values from end to end of its part of the
    /// segment. Unused by [`Curve::Middle`] and [`Curve::Field`].
    pub is_pre_integrated: bool,
    /// How the colours of fog and surfaces are lit. In unlit fog, surfaces are lit by Blinn's model.
    pub light: LightingModel,
    /// How the field's gradient is computed.
    pub gradient: Gradient,
    /// Isosurfaces, fog, or both.
    pub surfaces: Surfaces,
    /// Whether samples are classified by value and gradient magnitude, rather than by value alone.
    pub has_grid: bool,
}

impl Medium {
    /// Plain sampling: one sample in the middle of each segment, unlit, without surfaces. It has its own shaders.
    pub const PLAIN: Self = Self {
        curve: Curve::Middle,
        parts: 1,
        is_pre_integrated: false,
        light: LightingModel::None,
        gradient: Gradient::Central,
        surfaces: Surfaces::None,
        has_grid: false,
    };

    /// How surfaces are lit: like the fog, or by Blinn's model if the fog is unlit.
    fn surface_light(&self) -> LightingModel {
        if self.light == LightingModel::None { LightingModel::BlinnPhong } else { self.light }
    }

    /// The constants of shaders for one layer and for several.
    fn constants(&self) -> String {
        format!(
            "const CURVE: u32 = {}u;\nconst PARTS: u32 = {}u;\nconst IS_PRE_INTEGRATED: bool = {};\n\
             const SURFACE_LIGHTING: u32 = {}u;\nconst HAS_FOG: bool = {};\n",
            self.curve as u32,
            self.parts,
            self.is_pre_integrated,
            self.surface_light() as u32,
            self.surfaces != Surfaces::Alone,
        )
    }
}

/// A layer's voxels, as far as their reading depends on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Voxels {
    /// Whether some voxels have no value. The filter leaves these out.
    pub has_invalid: bool,
    /// Whether values are labels, read at the nearest voxel whatever the filter.
    pub is_labels: bool,
    /// Whether slots hold 32-bit floats instead of codes.
    pub is_float: bool,
    /// Whether the transfer table spans few of the codes in slots.
    pub is_narrow: bool,
}

impl Voxels {
    /// The sampling of an atlas of them: missing values, and numbers too exact for hardware filters, are read one by one.
    fn sampler(self) -> Sampler {
        match self.is_float || self.is_narrow || self.has_invalid {
            _ if self.is_labels => Sampler::Label,
            true => Sampler::Voxels,
            false => Sampler::Full,
        }
    }
}

/// The variant of a march through one layer: everything decided at the creation of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Variant {
    /// How samples become a pixel.
    pub gather: Gather,
    /// How voxels are read.
    pub voxels: Voxels,
    /// How the field is interpolated from voxels.
    pub filter: Filter,
    /// How segments become media: [`Medium::PLAIN`] unless `gather` is [`Gather::Composite`].
    pub medium: Medium,
    /// Whether only a slab between layers of meshes is drawn.
    pub has_meshes: bool,
    /// Whether the scene places the volume elsewhere than its store.
    pub is_placed: bool,
    /// Whether coarse bricks are read by the boxes of segments: they hold the extremes shown by [`Gather::Project`].
    pub keeps_extremes: bool,
}

impl Variant {
    /// The units of the march, and the end of its files' names: a surface, single samples, or segments from end to end.
    const fn march(&self) -> &'static str {
        match self.gather {
            Gather::Isosurface => "surface",
            _ if self.is_plain() => "samples",
            _ => "medium",
        }
    }

    const fn is_plain(&self) -> bool {
        let Medium { curve, light, surfaces, has_grid, .. } = self.medium;
        matches!((curve, light, surfaces), (Curve::Middle, LightingModel::None, Surfaces::None)) && !has_grid
    }
}

/// The mark of a brick entered by a ray with all its light. Marks are transmittances times `MARK_STEPS`, rounded up.
pub const MARK_STEPS: u32 = 255;

/// WGSL source of the `sorted` compositor's march through one layer, with entry points `proxy` and `march`.
pub fn sorted(variant: &Variant) -> String {
    variant.parts().compose(&[&format!("march_{}", variant.march())])
}

/// The kind of shader for ray casting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A fragment shader: entry points `fullscreen` and `raycast`.
    Fragment,
    /// A compute shader: entry point `raycast`, in workgroups of [`WORKGROUP_PX`] squared pixels. The text is WGSL's name of the written texel
    /// format.
    Compute(&'static str),
}

impl Stage {
    fn root(self) -> &'static str {
        match self {
            Self::Fragment => "raycast_fragment",
            Self::Compute(_) => "raycast_compute",
        }
    }

    /// Adds the part `texels`, the texture written by a compute shader. Fragment shaders need no such part.
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

/// WGSL source of a shader that casts a ray for each pixel through one layer. Its [stage](Stage) gives the entry points. With `marks`, rays of
/// [`Gather::Composite`] and [`Gather::Isosurface`] write the light with which they entered each brick to [`bindings::MARKS`].
pub fn raycast(variant: &Variant, stage: Stage, marks: bool) -> String {
    let sees = match variant.gather {
        Gather::Composite if variant.medium.surfaces != Surfaces::None => "sees_surfaces",
        Gather::Composite => "sees_composite",
        Gather::Project => "sees_project",
        Gather::Average => "sees_average",
        Gather::Isosurface => "sees_surface",
    };
    let cast = format!("raycast_{}", variant.march());
    let mark = if variant.gather.occludes() && marks { "mark" } else { "mark_none" };
    let parts = variant.parts().file("sees", sees).file("cast", &cast).file("feedback", mark);
    stage.part(parts).compose(&[stage.root()])
}

/// WGSL source of a shader that casts a ray for each pixel through several layers at once. Its [stage](Stage) gives the entry points. With
/// `marks`, rays write the light with which they entered each brick to [`bindings::MARKS`].
pub fn raycast_joint(variant: &JointVariant, stage: Stage, marks: bool) -> String {
    variant.casting(stage, marks).compose(&[stage.root()])
}

/// WGSL source of the `sorted` compositor's march through several layers at once with a common grid, with entry points `proxy` and `march`.
pub fn sorted_joint(variant: &JointVariant) -> String {
    variant.parts().file("find", "find_cell").compose(&["march_joint"])
}

impl JointVariant {
    /// The parts of a ray-casting shader for these layers.
    fn casting(&self, stage: Stage, marks: bool) -> Parts {
        let feedback = if marks { "mark" } else { "mark_none" };
        stage.part(self.parts().file("cast", "cast_joint").file("find", "find_leaf").file("feedback", feedback))
    }
}

impl Variant {
    /// The parts common to all marches through one layer: the layer's context, and the sum of its samples.
    fn parts(&self) -> Parts {
        let pixel = match self.gather {
            Gather::Composite if self.is_plain() => "composite",
            Gather::Composite => "through",
            Gather::Project if self.voxels.is_labels => "project_labels",
            Gather::Project => "project",
            Gather::Average => "average",
            Gather::Isosurface => "surface",
        };
        let take = if self.medium.surfaces == Surfaces::None { "surfaces_none" } else { "surfaces" };
        let (boxes, texels) = match self.keeps_extremes {
            true => ("box_extremes", self.voxels.sampler().boxes(self.filter)),
            false => ("box_none", String::new()),
        };
        Parts::new()
            .text("context", self.context())
            .text("atlas", joint::atlases(&[(0, self.voxels.sampler())], self.filter) + &texels)
            .file("boxes", boxes)
            .file("world", if self.is_placed { "axes" } else { "axes_own" })
            .file("limits", if self.has_meshes { "limits_slab" } else { "limits_none" })
            .file("gradient", gradient_file(self.medium.gradient))
            .file("pixel", pixel)
            .file("take", take)
    }

    /// The part `context` of a single layer: constants.
    fn context(&self) -> String {
        let Voxels { has_invalid, is_labels, is_float, .. } = self.voxels;
        let firsts = ["NODE", "BRICK", "RANGE", "PLACE", "COUNT"];
        let firsts: String = firsts.map(|what| format!("const FIRST_{what}: u32 = 0u;\n")).concat();
        format!(
            "const LAYERS: u32 = 1u;\nconst layer: u32 = 0u;\n{firsts}const HAS_INVALID: bool = {has_invalid};\n\
             const IS_LABELS: bool = {is_labels};\nconst IS_FLOAT: bool = {is_float};\nconst IS_UNBOUNDED: bool = {};\n\
             const MARGIN: f32 = {:?};\nconst LIGHTING: u32 = {}u;\nconst HAS_SURFACES: bool = {};\nconst HAS_GRID: bool = {};\n{}",
            self.voxels.sampler() == Sampler::Voxels,
            margin(self.filter),
            self.medium.light as u32,
            self.medium.surfaces != Surfaces::None,
            self.medium.has_grid,
            self.medium.constants()
        )
    }
}

/// The part `context` of passes that read no bricks.
const NO_LAYER: &str = "const LAYERS: u32 = 1u;\nconst layer: u32 = 0u;\nconst FIRST_PLACE: u32 = 0u;\n";

/// The least distance, in texels, between a sample and the faces of its slot at which the filter touches nothing outside the slot.
fn margin(filter: Filter) -> f32 {
    match filter {
        Filter::Nearest | Filter::Trilinear => 0.5,
        Filter::Tricubic => 1.5,
    }
}

/// The file with a gradient's differences.
fn gradient_file(gradient: Gradient) -> &'static str {
    match gradient {
        Gradient::Central => "gradient_central",
        Gradient::Sobel => "gradient_sobel",
        Gradient::Stored => "gradient_stored",
    }
}

/// How an atlas is sampled, apart from the filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sampler {
    /// By the hardware's filter.
    Full,
    /// Voxel by voxel.
    Voxels,
    /// The nearest voxel alone.
    Label,
}

impl Sampler {
    const ALL: [Self; 3] = [Self::Full, Self::Voxels, Self::Label];

    /// The names of a filter's files.
    fn files(self, filter: Filter) -> &'static str {
        match (self, filter) {
            (Self::Full, Filter::Nearest) => "sample sample_nearest",
            (Self::Full, Filter::Trilinear) => "sample",
            (Self::Full, Filter::Tricubic) => "sample_cubic",
            (Self::Voxels, Filter::Nearest) => "sample_voxels sample_nearest_voxel",
            (Self::Voxels, Filter::Trilinear) => "sample_voxels",
            (Self::Voxels, Filter::Tricubic) => "sample_cubic_voxels",
            (Self::Label, _) => "sample_nearest sample_label",
        }
    }

    /// The function for the field's values.
    fn function(self, filter: Filter) -> &'static str {
        match (self, filter) {
            (Self::Voxels, Filter::Nearest) => "sample_nearest_voxel",
            (_, Filter::Nearest) => "sample_nearest",
            _ => self.smooth_function(),
        }
    }

    /// Text for reads by segments' boxes: their reach beyond the segments, in voxels of level 0, and the value of a texel by its place.
    fn boxes(self, filter: Filter) -> String {
        let nearest = if self == Self::Voxels { "sample_nearest_voxel" } else { "sample_nearest" };
        format!(
            "//!import {nearest}\nconst BOX_REACH: f32 = {:?};\n\n\
             fn texel_value(texel: vec3f) -> f32 {{\n    return {nearest}(atlas_0, texel);\n}}\n",
            filter.farthest() as f32
        )
    }

    /// The function for the values of the field whose gradients are taken. Labels have no gradients.
    fn smooth_function(self) -> &'static str {
        match self {
            Self::Full => "sample_full",
            Self::Voxels => "sample_voxels",
            Self::Label => "sample_nearest",
        }
    }
}

/// The source of a resolving pass's colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Seen {
    /// Samples gathered in this way.
    Gathered(Gather),
    /// The picture composed of all slabs between layers of meshes.
    Slabs,
    /// The sums of the projections of several layers.
    Joined,
}

/// The output of a resolving pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shown {
    /// Display colours, over the background.
    Picture,
    /// Colours of a slab between layers of meshes, over the layer behind it.
    Slab,
    /// A layer's part of the sums of joined projections. There are two targets, for mixing and for adding layers.
    Sums,
    /// A layer over the others, in the targets of [`Shown::Sums`]: it dims and covers the adding layers.
    Over,
}

/// WGSL source of a resolving pass, which turns gathered samples into colours, with entry points `fullscreen` and `resolve`.
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
        Shown::Over => "resolve_over",
    };
    Parts::new().text("context", NO_LAYER.into()).file("seen", seen).compose(&[resolve])
}

/// WGSL source of the pass that puts a finished picture, or those of two eyes, on an application's texture, with entry points `stretched` and `blit`. With `encodes`,
/// the texture encodes light, as sRGB formats do, and the pass writes light; else it writes the colours' codes as they are.
pub fn blit(stereo: Option<StereoLayout>, encodes: bool) -> String {
    blit_parts(stereo, encodes).compose(&["blit"])
}

fn blit_parts(stereo: Option<StereoLayout>, encodes: bool) -> Parts {
    let eyes = match stereo {
        None => "eyes_one",
        Some(StereoLayout::SideBySide) => "eyes_side_by_side",
        Some(StereoLayout::TopBottom) => "eyes_top_bottom",
        Some(StereoLayout::Anaglyph) => "eyes_anaglyph",
        Some(StereoLayout::Interlaced) => "eyes_interlaced",
    };
    Parts::new().file("eyes", eyes).file("written", if encodes { "written_light" } else { "written_codes" })
}

/// WGSL source of the pass over the next layer of meshes, with entry points `corner` and `peel`.
pub fn peel() -> String {
    Parts::new().text("context", NO_LAYER.into()).compose(&["peel"])
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{
        TransferGrid, compositing, gradients, jitter, lighting, mesh, preintegration, sampling, slot_encoding, surface,
    };
    use naga::{Module, TypeInner};
    use std::mem::{offset_of, size_of};

    const COMPUTE: Stage = Stage::Compute("rgba32float");

    /// Media of all curves and lights, with various gradients, surfaces and grids.
    fn media() -> Vec<Medium> {
        let mut all = Vec::new();
        for curve in [Curve::Middle, Curve::Line, Curve::Cubic, Curve::Field] {
            for light in [LightingModel::None, LightingModel::Phong, LightingModel::BlinnPhong, LightingModel::Tone] {
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

    /// The variant of trilinear codes without missing values, in the layer's own world and without meshes.
    fn plain(gather: Gather, medium: Medium) -> Variant {
        Variant {
            gather,
            voxels: Voxels::default(),
            filter: Filter::Trilinear,
            medium,
            has_meshes: false,
            is_placed: false,
            keeps_extremes: false,
        }
    }

    /// Sources of all kinds of shaders but `blit`, each behind a name for messages.
    fn variants() -> Vec<(String, String)> {
        let mut all = Vec::new();
        for gather in Gather::ALL {
            let media = if gather == Gather::Composite { media() } else { vec![Medium::PLAIN] };
            for medium in media {
                for kind in 0..15 {
                    let filter = [Filter::Nearest, Filter::Trilinear, Filter::Tricubic][kind % 3];
                    let [is_float, is_labels, is_narrow] = [2, 3, 4].map(|of| kind / 3 == of);
                    let has_invalid = kind / 3 % 2 == 1;
                    let (has_meshes, is_placed) = (kind % 2 == 1, has_invalid);
                    let own = Variant {
                        voxels: Voxels { has_invalid, is_labels, is_float, is_narrow },
                        filter,
                        ..plain(gather, medium)
                    };
                    let plain = Variant { has_meshes, is_placed, ..own };
                    let keeps_extremes = gather == Gather::Project && !is_labels;
                    let variants = [Some(plain), keeps_extremes.then_some(Variant { keeps_extremes, ..plain })];
                    for variant in variants.into_iter().flatten() {
                        all.push((format!("sorted {variant:?}"), sorted(&variant)));
                        all.push((format!("raycast {variant:?}"), raycast(&variant, Stage::Fragment, true)));
                        all.push((format!("raycast compute {variant:?}"), raycast(&variant, COMPUTE, true)));
                    }
                }
                if gather == Gather::Composite {
                    all.extend(joint(medium));
                }
            }
            let plain = plain(gather, Medium::PLAIN);
            all.push((format!("raycast {gather:?} without marks"), raycast(&plain, Stage::Fragment, false)));
            for shown in [Shown::Picture, Shown::Slab, Shown::Sums, Shown::Over] {
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
            voxels: Voxels {
                has_invalid: i % 2 == 1,
                is_labels: i % 4 == 2,
                is_float: i % 3 == 2,
                is_narrow: i % 5 == 3,
            },
            is_whole: i % 4 == 2,
            adds: i / 2 % 2 == 1,
            has_surfaces,
            has_grid: i % 3 == 1,
            first: FirstPlaces { range: at, place: at, count: at },
            values: [0f32.to_bits(), 255f32.to_bits()],
        }
    }

    /// Shaders of one layer and of three layers at once, all with media of this kind; each behind a name for messages.
    fn joint(medium: Medium) -> Vec<(String, String)> {
        let mut all = Vec::new();
        for (count, filter) in [(1, Filter::Tricubic), (3, Filter::Nearest), (3, Filter::Trilinear)] {
            let is_alone = count == 1;
            let layers = (0..count).map(|i| layer_shader(i, medium.surfaces != Surfaces::None && i != 1)).collect();
            let variant = JointVariant { medium, filter, has_meshes: is_alone, layers, expression: None };
            let stage = if is_alone { COMPUTE } else { Stage::Fragment };
            let name = if is_alone { "raycast compute joint" } else { "raycast joint" };
            all.push((format!("{name} {count} {filter:?} {medium:?}"), raycast_joint(&variant, stage, !is_alone)));
            all.push((format!("sorted joint {count} {filter:?} {medium:?}"), sorted_joint(&variant)));
        }
        all
    }

    /// Shaders of the most layers, and of expressions over one, two and all layers; each behind a name for messages.
    fn joint_expressions() -> Vec<(String, String)> {
        let of = |count: u32, expression: Option<(LightingModel, ExpressionShader)>| {
            let fog =
                Medium { curve: Curve::Cubic, light: LightingModel::Phong, surfaces: Surfaces::InFog, ..Medium::PLAIN };
            let medium = expression.as_ref().map_or(fog, |(light, _)| Medium { light: *light, ..Medium::PLAIN });
            let layers = (0..count).map(|i| layer_shader(i, expression.is_none())).collect();
            let expression = expression.map(|(_, expression)| expression);
            let variant = JointVariant { medium, filter: Filter::Trilinear, has_meshes: false, layers, expression };
            (format!("raycast joint, {count} layers"), raycast_joint(&variant, Stage::Fragment, true))
        };
        let expression = |light: LightingModel, count: u32| {
            let expression = brickyard_volume::Expression::parse("sqrt(a * 2)", 1).unwrap();
            let wgsl = match light {
                LightingModel::None => expression.wgsl(count as usize),
                _ => expression.wgsl_with_gradient(count as usize),
            };
            let values = [(-1e-7f32).to_bits(), 1e20f32.to_bits()];
            Some((light, ExpressionShader { wgsl, first_place: 7, last_place: 65535, values }))
        };
        let most = brickyard_volume::MAX_VOLUMES as u32;
        let (alone, all) = (expression(LightingModel::None, 1), expression(LightingModel::Tone, most));
        vec![of(most, None), of(1, alone), of(2, expression(LightingModel::Phong, 2)), of(most, all)]
    }

    #[test]
    fn all_atlases_come_before_all_gradients() {
        assert_eq!(bindings::FIRST_GRADIENTS, bindings::FIRST_ATLAS + brickyard_volume::MAX_VOLUMES as u32);
    }

    /// Every WGSL file is valid with the parts of some variant and only its own imports.
    #[test]
    fn every_file_is_valid_by_itself() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        let lit = Medium { light: LightingModel::Phong, surfaces: Surfaces::InFog, ..Medium::PLAIN };
        let labels = Voxels { is_labels: true, ..Voxels::default() };
        let floats = Voxels { is_float: true, ..Voxels::default() };
        let single = [
            (plain(Gather::Composite, Medium::PLAIN), "sees_composite", "raycast_samples"),
            (plain(Gather::Composite, lit), "sees_surfaces", "raycast_medium"),
            (plain(Gather::Project, Medium::PLAIN), "sees_project", "raycast_samples"),
            (Variant { voxels: labels, ..plain(Gather::Project, lit) }, "sees_project", "raycast_samples"),
            (Variant { keeps_extremes: true, ..plain(Gather::Project, lit) }, "sees_project", "raycast_samples"),
            (plain(Gather::Isosurface, Medium::PLAIN), "sees_surface", "raycast_surface"),
        ];
        let mut companies: Vec<Parts> = vec![blit_parts(None, true), blit_parts(None, false)];
        for (variant, sees, cast) in single {
            let parts = variant.parts().file("sees", sees).file("cast", cast).file("feedback", "mark");
            companies.push(COMPUTE.part(parts).file("seen", "resolve_composite"));
        }
        let layers: Vec<_> = (0..2).map(|i| layer_shader(i, true)).collect();
        for filter in [Filter::Nearest, Filter::Trilinear] {
            companies.push(Variant { voxels: floats, filter, ..plain(Gather::Composite, lit) }.parts());
        }
        let joint =
            JointVariant { medium: lit, filter: Filter::Trilinear, has_meshes: false, layers, expression: None };
        let many = JointVariant { layers: (0..9).map(|i| layer_shader(i, true)).collect(), ..joint.clone() };
        for joint in [&joint, &many] {
            companies.push(joint.casting(COMPUTE, true));
            companies.push(joint.parts().file("find", "find_cell"));
        }
        let read = brickyard_volume::Expression::parse("a", 1).unwrap();
        for (light, wgsl) in [(LightingModel::None, read.wgsl(2)), (LightingModel::Phong, read.wgsl_with_gradient(2))] {
            let expression = Some(ExpressionShader { wgsl, first_place: 0, last_place: 1, values: [0, 0] });
            let joint = JointVariant { medium: Medium { light, ..Medium::PLAIN }, expression, ..joint.clone() };
            companies.push(joint.casting(COMPUTE, true));
        }
        for name in compose::FILES.iter().map(|(path, _)| compose::name_of(path)) {
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

    /// This run's variants: a third, another for each seed, or all.
    fn sampled_variants() -> Vec<(String, String)> {
        let seed = std::env::var("BRICKYARD_SEED").map_or(0, |text| u64::from_str_radix(&text, 16).expect("a seed"));
        let takes_all = std::env::var("BRICKYARD_CASES").is_ok_and(|text| text == "all");
        // Mixed, because neighbours differ in what is taken in turns.
        let mixed = |i: usize| (seed ^ i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
        let of_run = |(i, variant)| (takes_all || mixed(i).is_multiple_of(3)).then_some(variant);
        variants().into_iter().enumerate().filter_map(of_run).collect()
    }

    /// Each source is parsed once for all checks: parsing takes most of the time.
    #[test]
    fn every_variant_is_valid_and_its_structs_are_those_of_their_twins() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        let check = |(name, source): &(String, String)| {
            let module = parse(name, source);
            let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
            assert!(checked.is_ok(), "{name}: {:?}", checked.err());
            let entries = if name.starts_with("raycast compute") { 1 } else { 2 };
            assert_eq!(module.entry_points.len(), entries, "{name}");
            if let [entry] = &module.entry_points[..] {
                assert_eq!(entry.workgroup_size, [WORKGROUP_PX * WORKGROUP_PX, 1, 1], "{name}");
            }
            assert_layouts(name, &module);
        };
        let variants = sampled_variants();
        let (some, others) = variants.split_at(variants.len() / 2);
        std::thread::scope(|scope| {
            scope.spawn(|| some.iter().for_each(check));
            others.iter().for_each(check);
        });
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

    /// The members of a WGSL struct, each as (name, offset in bytes), and the struct's size in bytes.
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

    fn assert_layouts(name: &str, module: &Module) {
        let expected = offsets!(FrameUniform: eye step forward slack right half_width up half_height clip_x near clip_y
            pixel_share clip_w per_unit_distance extent last_code spacing orthographic texel invert background tree_depth
            size_px last_place sum_unit root_size macro_cells shown_low slot_edge shown_high lights surface_color
            threshold lean jitter jitter_seed mesh_far gradient_edge first_gradient grid_at first_px adaptive_step adds
            opacity reach flat_depth grid thresholds
            surfaces light_places axes slopes zone_starts planes list_at flat spare first_slot per_slot farthest_slots gradient_scale
            plane_count jitter_phase slot_codes first_code last_entry counts_per_code caps threshold_code firsts);
        assert_eq!(layout(module, "Frame"), (expected, size_of::<FrameUniform>()), "{name}");
        assert_eq!(size_of::<FrameUniform>() % 256, 0, "frames begin where any device can bind them");
        if name.starts_with("sorted") {
            let expected = offsets!(CellInstance: region_min pixels_from region_max pixels_to);
            assert_eq!(layout(module, "Cell"), (expected, size_of::<CellInstance>()), "{name}");
            let expected = offsets!(CellBrick: texel_scale is_there texel_offset spare);
            assert_eq!(layout(module, "CellBrick"), (expected, size_of::<CellBrick>()), "{name}");
        }
        if name == "peel" {
            let expected = offsets!(MeshVertex: place color normal spare);
            assert_eq!(layout(module, "MeshVertex"), (expected, size_of::<MeshVertex>()), "{name}");
            let expected = offsets!(MeshLook: color opacity flags spare);
            assert_eq!(layout(module, "MeshLook"), (expected, size_of::<MeshLook>()), "{name}");
        }
        if name.starts_with("raycast") {
            let expected = offsets!(RayBrick: texel_scale first_range texel_offset range low pixels_to);
            assert_eq!(layout(module, "RayBrick"), (expected, size_of::<RayBrick>()), "{name}");
        }
    }

    #[test]
    fn constants_are_those_of_the_shader() {
        assert_eq!(lighting::SPECULAR_POWER, 10, "the shaders multiply it out: `tenth_power`");
        let surface = plain(Gather::Isosurface, Medium::PLAIN);
        let lit = plain(Gather::Composite, Medium { light: LightingModel::Phong, ..Medium::PLAIN });
        let floats = Variant { voxels: Voxels { is_float: true, has_invalid: true, ..Voxels::default() }, ..lit };
        let foggy = plain(Gather::Composite, Medium { surfaces: Surfaces::InFog, ..Medium::PLAIN });
        let single = |value: f64| naga::Literal::F32(value as f32);
        let expected = [
            ("BLUE_EDGE", naga::Literal::U32(jitter::BLUE_EDGE as u32)),
            ("JITTER_STEPS", naga::Literal::U32(jitter::STEPS)),
            ("SEARCH_PARTS", naga::Literal::U32(surface::PARTS as u32)),
            ("ROUNDS", naga::Literal::U32(surface::ROUNDS as u32)),
            ("AMBIENT", single(lighting::AMBIENT)),
            ("DIFFUSE", single(lighting::DIFFUSE)),
            ("SPECULAR", single(lighting::SPECULAR)),
            ("SIDEWAYS", single(lighting::SIDEWAYS)),
            ("FLAT_SHARE", single(surface::FLAT_SHARE)),
            ("LEAF", naga::Literal::U32(LEAF)),
            ("GROUP", naga::Literal::U32(HALVES_X - 1)),
            ("MARK_STEPS", naga::Literal::F32(MARK_STEPS as f32)),
            ("NO_RANGES", naga::Literal::U32(NO_RANGES)),
            ("ANYTHING", naga::Literal::U32(u32::from(slot_encoding::ANYTHING[1]) << 16)),
        ];
        let surface = parse("a surface", &raycast(&surface, COMPUTE, true));
        let expected = expected.map(|(name, value)| (&surface, name, value));
        let lit = parse("a lit composite", &raycast(&lit, COMPUTE, true));
        let stored = Medium { light: LightingModel::Phong, gradient: Gradient::Stored, ..Medium::PLAIN };
        let stored = parse("stored gradients", &raycast(&plain(Gather::Composite, stored), COMPUTE, true));
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
        let floats = parse("floats", &raycast(&floats, COMPUTE, true));
        let of_floats = [("LEAST_SLOT", single(slot_encoding::LEAST_SLOT as f64)), ("NO_VALUE", single(-1e30))];
        let of_floats = of_floats.map(|(name, value)| (&floats, name, value));
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
        for (module, name, value) in expected
            .into_iter()
            .chain(of_gradients)
            .chain(of_media)
            .chain(of_surfaces)
            .chain(of_meshes)
            .chain(of_floats)
        {
            let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).expect(name);
            let found = &module.global_expressions[constant.init];
            assert!(matches!(found, naga::Expression::Literal(v) if *v == value), "{name}: {found:?}");
        }
    }
}
