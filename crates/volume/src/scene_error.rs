//! Errors of scenes, with found and expected values and the place. One variant per reason, for callers to distinguish; none depends on data,
//! only on the stores' counts.

use crate::bounds::{LEAST_STEP, MOST_STEP, ReachError};
use crate::clip::ClipError;
use crate::expression::{ExpressionError, MAX_VOLUMES};
use crate::labels::LabelCodes;
use crate::lighting::{LightingModel, MAX_LIGHTS};
use crate::mesh::MeshLookError;
use crate::mode::Mode;
use crate::numbers::exact;
use crate::placement::PlacementError;
use crate::sampling::{MOST_VIRTUAL_SAMPLES, Method};
use crate::surface::MAX_SURFACES;
use crate::transfer::{GAMMAS, TransferError};
use glam::DVec3;

/// Why a scene cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The scene has no layer, or too many; the number is their count.
    #[error("{0} layers: expected 1 to {MAX_VOLUMES}")]
    Layers(usize),
    /// One of the scene's layers cannot be shown.
    #[error("layer {layer}: {error}")]
    Layer {
        /// Index of the layer, from 0.
        layer: usize,
        /// Why the layer cannot be shown.
        error: LayerError,
    },
    /// No layer is visible, so there is nothing to show.
    #[error("no layer is visible: there is nothing to show")]
    NothingVisible,
    /// No store has the requested level.
    #[error("level {level} does not exist: the stores have levels 0 to {}", levels.saturating_sub(1))]
    Level {
        /// The requested level.
        level: u8,
        /// Number of levels of the store with the most.
        levels: usize,
    },
    /// The step, given here, is out of its bounds.
    #[error(
        "the step is {}: expected {LEAST_STEP} to {MOST_STEP} voxels; 1 takes a sample in each voxel, 0.5 two",
        exact(*.0, false)
    )]
    Step(f64),
    /// The pixel error, given here, is not a positive, finite number.
    #[error("the pixel error is {0}: expected a positive number")]
    PixelError(f64),
    /// The background's colour is not in 0..=1.
    #[error("the background is {0:?}: expected red, green and blue in 0..1")]
    Background([f64; 3]),
    /// An invalid clip box, plane or slice.
    #[error(transparent)]
    Clip(#[from] ClipError),
    /// An invalid mesh.
    #[error(transparent)]
    Mesh(#[from] MeshLookError),
    /// The sampling method is for [`Mode::Dvr`] alone, and the scene has another mode.
    #[error("the sampling method {0:?} is for mode dvr: leave it out, or choose that mode")]
    Method(Method),
    /// The lighting model is for [`Mode::Dvr`] and [`Mode::Isosurface`], and the scene's mode is a projection.
    #[error("the lighting {0:?} is for modes dvr and isosurface: leave it out, or choose one of them")]
    Lighting(LightingModel),
    /// The number of virtual samples of a segment is out of range.
    #[error("{0} virtual samples: expected 1 to {MOST_VIRTUAL_SAMPLES}")]
    VirtualSamples(u8),
    /// There are too many lights; the number is their count.
    #[error("{0} lights: expected at most {MAX_LIGHTS}")]
    Lights(usize),
    /// A light's position is not finite.
    #[error("a light stands at {0}: expected finite numbers")]
    Light(DVec3),
    /// There are lights, but neither a lighting model nor a surface for them to light.
    #[error("a light without lighting: leave it out, or add lighting, as in blinn-phong")]
    Unlit,
    /// The mode is [`Mode::Isosurface`], and no visible layer has an isosurface.
    #[error("mode isosurface shows the surface of one value: give a visible layer an isovalue, in stored units")]
    NoSurface,
    /// The expression's text is no expression over the scene's layers.
    #[error("expression: {0}")]
    Expression(#[from] ExpressionError),
    /// The expression, with this text, reads no layer.
    #[error("expression: '{0}' reads no layer: there is nothing to show")]
    ExpressionOfNothing(String),
    /// The expression reads a hidden layer, with this index.
    #[error("expression: it reads layer {0}, which is hidden: remove it from the expression, or make it visible")]
    ExpressionOfHidden(usize),
    /// A layer, with this index, has a style of its own, unused by an expression.
    #[error(
        "expression: layer {0} has a style, and only the expression's own style is used: leave the layer's transfer, \
         window, color, gamma, opacity, blend and isosurfaces out"
    )]
    ExpressionStyle(usize),
    /// There is an expression, and the mode is not [`Mode::Dvr`].
    #[error("expression: its value is shown in mode dvr, not {0:?}: leave one of the two out")]
    ExpressionMode(Mode),
    /// There is an expression, and the sampling method is not [`Method::Udvr`].
    #[error("expression: its value is sampled by method udvr, not {0:?}: leave one of the two out")]
    ExpressionMethod(Method),
    /// The expression has a transfer function of value and gradient.
    #[error(
        "expression: the transfer function depends on value and gradient, but expressions are classified by value \
         alone: leave its gradient_opacity and regions out"
    )]
    ExpressionByGradient,
    /// The expression's transfer function is invalid.
    #[error("expression: transfer function: {0}")]
    ExpressionTransfer(TransferError),
}

/// Why a layer of a scene cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum LayerError {
    /// The layer's map combined with its store's orientation is not usable.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The camera's rays cannot draw the layer's volume.
    #[error(transparent)]
    Reach(#[from] ReachError),
    /// The layer's store does not exist.
    #[error("store {store} does not exist: there are {stores}, numbered from 0")]
    Store {
        /// Index of the requested store.
        store: usize,
        /// Number of stores.
        stores: usize,
    },
    /// The layer's channel does not exist in its store.
    #[error("channel {channel} does not exist: the store has {channels}, numbered from 0")]
    Channel {
        /// The requested channel.
        channel: u32,
        /// Number of channels in the store.
        channels: u32,
    },
    /// The scene's time step does not exist in any layer's store.
    #[error("time step {time} does not exist: the store has {times}, numbered from 0")]
    Time {
        /// The requested time step.
        time: u32,
        /// Number of time steps of the store with the most.
        times: u32,
    },
    /// The layer's opacity is not in 0..=1.
    #[error("the opacity is {0}: expected 0 to 1")]
    Opacity(f64),
    /// The layer's gamma is not in [`GAMMAS`].
    #[error("the gamma is {0}: expected {low} to {high}", low = GAMMAS.start(), high = GAMMAS.end())]
    Gamma(f64),
    /// The layer's window is not finite, or does not have the lesser number first.
    #[error("the window is {0:?}: expected two finite numbers, the lesser first")]
    Window([f64; 2]),
    /// The layer's colour is not in 0..=1.
    #[error("the color is {0:?}: expected red, green and blue in 0..1")]
    Color([f64; 3]),
    /// The layer's crop box is empty or not finite.
    #[error("crop: {0}")]
    Crop(ClipError),
    /// The layer's transfer function is invalid.
    #[error("transfer function: {0}")]
    Transfer(#[from] TransferError),
    /// The layer's transfer function cannot be moved to its window: all points have this one value.
    #[error(
        "all points of the transfer function have the value {0}, and cannot be moved to a window: leave the window out"
    )]
    Flat(f64),
    /// The layer has a style for labels, and its store's values are measurements.
    #[error("the layer selects labels, but the store has none: pack it as labels, or leave the selection out")]
    NoLabels,
    /// The layer has a style part, named here, unfit for labels: they have no order, and nothing lies between two of them.
    #[error("labels have no {0}: leave it out; they have a color, an opacity and a selection")]
    OfLabels(&'static str),
    /// The layer's labels are further apart than 16 bits reach and have codes by their looks, but a transfer function of their numbers or an
    /// expression reads them.
    #[error(
        "its labels are too far apart to compute with their numbers: leave the transfer function or expression out"
    )]
    HashedLabels,
    /// The layer's labels are further apart than 16 bits reach and have codes by their looks, and too many have looks of their own.
    #[error("more than {most} labels have their own colors: show fewer, or give fewer colors", most = LabelCodes::MOST)]
    ManyLabels,
    /// The sampling method pre-integrates over values, and the layer has a transfer function of value and gradient.
    #[error(
        "the sampling method {0:?} integrates over values, but the transfer function depends on value and gradient: \
         use method udvr, lvs, cvs or asm"
    )]
    Integrated(Method),
    /// The layer has an isosurface, with this isovalue, and the scene's mode is a projection.
    #[error("the isovalue {0} is for mode isosurface, or dvr: leave it out, or use one of those")]
    SurfaceMode(f64),
    /// The layer has too many isosurfaces; the number is their count.
    #[error("{0} isosurfaces: expected at most {MAX_SURFACES}")]
    Surfaces(usize),
    /// The isovalue of one of the layer's isosurfaces is not finite.
    #[error("the isovalue is {0}: expected a finite number")]
    SurfaceValue(f64),
    /// The opacity of one of the layer's isosurfaces is not in 0..=1.
    #[error("the isosurface at {value} has an opacity of {opacity}: expected a number from 0 to 1")]
    SurfaceOpacity {
        /// Isovalue of the surface.
        value: f64,
        /// Opacity of the surface, as given.
        opacity: f64,
    },
    /// The colour of one of the layer's isosurfaces is not in 0..=1.
    #[error("the isosurface at {value} has the color {color:?}: expected red, green and blue in 0..1")]
    SurfaceColor {
        /// Isovalue of the surface.
        value: f64,
        /// Colour of the surface, as given.
        color: [f64; 3],
    },
    /// Two of the layer's isosurfaces have this isovalue.
    #[error("two isosurfaces have the value {0}: leave one out")]
    SurfaceTwice(f64),
}
