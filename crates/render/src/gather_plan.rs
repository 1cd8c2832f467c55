//! The plan for gathering a picture, with its shaders.
//!
//! A single layer has specialised shaders. So have projections of several: each layer is gathered separately, and the
//! pictures are joined. Fog and surfaces of several layers, or of an additive or placed one, are gathered together: by
//! one ray through all of them, or cell by cell where they share their cells.

use crate::frame::Framed;
use crate::layer::{GpuLayer, value_bits};
use crate::pipelines::Wanted;
use crate::pool::Pool;
use crate::transfer_table::{COMBINED, last_place};
use crate::variant::{Shader, gather_of, medium_of, variant_of};
use crate::{Compositor, GpuError};
use brickyard_shaders::{ExpressionShader, Gather, JointVariant, Seen, Shown, Variant};
use brickyard_volume::{Blend, Combination, Method, Mode};

/// How a picture's layers are gathered.
#[derive(Clone, Debug)]
pub(crate) enum Course {
    /// The only layer, by a shader for one layer.
    Single(Shader),
    /// Projections of several layers, gathered one by one into the same target and added to the sums.
    Each(Vec<Projected>),
    /// All layers, by one shader.
    Joint(Shader),
}

/// One of several projections: how to gather and join it.
#[derive(Clone, Debug)]
pub(crate) struct Projected {
    /// Index among the picture's layers.
    pub(crate) layer: usize,
    pub(crate) shader: Shader,
    gather: Gather,
    /// Whether the layer lies over the others.
    is_over: bool,
}

impl Projected {
    /// The source and the output of the pass that joins the layer to the others.
    pub(crate) fn resolved(&self) -> (Seen, Shown) {
        (Seen::Gathered(self.gather), if self.is_over { Shown::Over } else { Shown::Sums })
    }
}

impl Course {
    /// Plans how a compositor gathers frames, or an expression over them. `first_place` is the first place of the
    /// expression's transfer table; `None` if the renderer has no room for expressions.
    ///
    /// # Errors
    /// If the compositor cannot gather these layers together, there is no room for expressions, or an expression is
    /// combined with isosurfaces, transfer functions over gradients, another mode than direct volume rendering, or
    /// another method than plain sampling.
    pub(crate) fn new(
        layers: &[GpuLayer],
        pools: &[Pool],
        framed: &[Framed<'_>],
        combination: Option<&Combination>,
        first_place: Option<u32>,
        compositor: Compositor,
    ) -> Result<Self, GpuError> {
        let is_projected = !gather_of(framed[0].settings).occludes();
        let single = |framed: &Framed<'_>| Shader::Single(variant_of(framed));
        match framed {
            [only] if combination.is_none() && (is_projected || is_plain(only)) => Ok(Self::Single(single(only))),
            several if combination.is_none() && is_projected => {
                let projected = |(layer, framed): (usize, &Framed<'_>)| Projected {
                    layer,
                    shader: single(framed),
                    gather: gather_of(framed.settings),
                    is_over: framed.blend == Blend::Over,
                };
                let mut all: Vec<_> = several.iter().enumerate().map(projected).collect();
                // Layers on top come last.
                all.sort_by_key(|projected| projected.is_over);
                Ok(Self::Each(all))
            }
            [first, others @ ..]
                if compositor == Compositor::Sorted && !others.iter().all(|other| other.shares_cells_with(first)) =>
            {
                let problem = "`sorted` cannot order the cells of layers of different grids, places or cuts";
                Err(GpuError::Mismatch(problem.into()))
            }
            all => {
                let expression = match (combination, first_place) {
                    (None, _) => None,
                    (Some(combination), Some(first_place)) => Some(expression(all, combination, first_place)?),
                    (Some(_), None) => {
                        return Err(GpuError::Mismatch("this renderer was made without room for expressions".into()));
                    }
                };
                Ok(Self::Joint(Shader::Joint(joint(layers, pools, all, expression))))
            }
        }
    }

    pub(crate) fn gather(&self) -> Gather {
        match self {
            Self::Single(Shader::Single(Variant { gather, .. })) => *gather,
            // All projections have the same targets.
            Self::Each(_) => Gather::Project,
            Self::Single(Shader::Joint(_)) | Self::Joint(_) => Gather::Composite,
        }
    }

    fn shaders(&self) -> Vec<&Shader> {
        match self {
            Self::Single(shader) | Self::Joint(shader) => vec![shader],
            Self::Each(all) => all.iter().map(|projected| &projected.shader).collect(),
        }
    }

    pub(crate) fn is_joined(&self) -> bool {
        matches!(self, Self::Each(..))
    }

    pub(crate) fn wanted(&self) -> Vec<Wanted> {
        let shaders = self.shaders();
        let has_meshes = shaders.iter().any(|shader| shader.has_meshes());
        let last = Wanted::Resolve(self.seen(), if has_meshes { Shown::Slab } else { Shown::Picture });
        let projected = if let Self::Each(all) = self { &all[..] } else { &[] };
        let joins = projected.iter().map(Projected::resolved).map(|(seen, shown)| Wanted::Resolve(seen, shown));
        shaders.into_iter().cloned().map(Wanted::March).chain([last]).chain(joins).collect()
    }

    /// Returns the source of the resolve pass: the gathered samples, or the sums of joined layers.
    pub(crate) fn seen(&self) -> Seen {
        if self.is_joined() { Seen::Joined } else { Seen::Gathered(self.gather()) }
    }
}

/// Whether the shaders for one layer suit this layer.
fn is_plain(framed: &Framed<'_>) -> bool {
    framed.blend != Blend::Add && framed.settings.placement.is_identity()
}

/// The expression that replaces the layers' media.
fn expression(
    framed: &[Framed<'_>],
    combination: &Combination,
    first_place: u32,
) -> Result<ExpressionShader, GpuError> {
    let is_cut = |framed: &Framed<'_>| !framed.settings.surfaces.is_empty() || framed.settings.grid().is_some();
    let is_plain = |framed: &Framed<'_>| framed.settings.mode == Mode::Dvr && framed.settings.method() == Method::Udvr;
    if framed.iter().any(is_cut) || !framed.iter().all(is_plain) {
        let problem = "an expression is drawn as fog, classified by value and sampled plainly";
        return Err(GpuError::Mismatch(problem.into()));
    }
    let Combination { expression, .. } = combination;
    Ok(ExpressionShader {
        wgsl: match framed[0].is_lit() {
            true => expression.wgsl_with_gradient(framed.len()),
            false => expression.wgsl(framed.len()),
        },
        first_place,
        last_place: last_place(&combination.table, COMBINED),
        values: value_bits(&combination.encoding),
    })
}

fn joint(
    layers: &[GpuLayer],
    pools: &[Pool],
    framed: &[Framed<'_>],
    expression: Option<ExpressionShader>,
) -> JointVariant {
    let settings = framed[0].settings;
    let shader = |framed: &Framed<'_>| {
        let layer = &layers[framed.number];
        layer.shader(framed, pools[layer.pool].ranges, expression.is_some())
    };
    JointVariant {
        medium: medium_of(
            settings,
            settings.sampling,
            framed.iter().any(|framed| !framed.settings.surfaces.is_empty()),
            framed.iter().any(|framed| framed.settings.grid().is_some()),
        ),
        filter: settings.sampling.filter,
        has_meshes: !settings.meshes.is_empty(),
        layers: framed.iter().map(shader).collect(),
        expression,
    }
}
