//! Why a scene is impossible: what was found, what was expected, and where. One value for each reason, so that whoever shows scenes can tell
//! them apart; nothing here depends on what data are like, only on what stores have.

use crate::clip::ClipError;
use crate::expression::{ExpressionError, MAX_VOLUMES};
use crate::lighting::{LightingModel, MAX_LIGHTS};
use crate::mesh::MeshLookError;
use crate::mode::Mode;
use crate::placement::PlacementError;
use crate::sampling::{MOST_VIRTUAL_SAMPLES, Method};
use crate::surface::MAX_SURFACES;
use crate::transfer::{GAMMAS, TransferError};
use glam::DVec3;

/// Why a scene is impossible.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// No layer, or too many.
    #[error("{0} layers: expected 1 to {MAX_VOLUMES}")]
    Layers(usize),
    /// Something of one layer.
    #[error("layer {layer}: {error}")]
    Layer {
        /// The layer's place, from 0.
        layer: usize,
        /// What it is.
        error: LayerError,
    },
    /// Nothing to show.
    #[error("no layer is visible: there is nothing to show")]
    NothingVisible,
    /// A level that no store has.
    #[error("level {level} does not exist: the stores have up to {levels}, numbered from 0")]
    Level {
        /// The level.
        level: u8,
        /// Levels of the store that has most.
        levels: usize,
    },
    /// A length that is none.
    #[error("the {name} is {value}: expected a positive number")]
    NotPositive {
        /// Whose.
        name: &'static str,
        /// What it is.
        value: f64,
    },
    /// A background without colour.
    #[error("the background is {0:?}: expected red, green and blue in 0..1")]
    Background([f64; 3]),
    /// A clip box, planes or a slice that cannot be shown.
    #[error(transparent)]
    Clip(#[from] ClipError),
    /// A mesh that cannot be shown.
    #[error(transparent)]
    Mesh(#[from] MeshLookError),
    /// A projection has no segments to sample.
    #[error("the sampling method {0:?} is for direct volume rendering: leave it out, or use mode dvr")]
    Method(Method),
    /// A projection has nothing to be lit.
    #[error("the lighting {0:?} is for direct volume rendering and isosurfaces: leave it out, or use mode dvr")]
    Lighting(LightingModel),
    /// A number of samples in a segment.
    #[error("{0} virtual samples: expected 1 to {MOST_VIRTUAL_SAMPLES}")]
    VirtualSamples(u8),
    /// Too many lights.
    #[error("{0} lights: expected at most {MAX_LIGHTS}")]
    Lights(usize),
    /// A light nowhere.
    #[error("a light stands at {0}: expected finite numbers")]
    Light(DVec3),
    /// Lights that light nothing.
    #[error("a light without lighting: leave it out, or add lighting, as in blinn-phong")]
    Unlit,
    /// Isosurfaces of no value.
    #[error(
        "mode isosurface needs the value whose surface it shows: give a visible layer an isovalue, in stored units"
    )]
    NoSurface,
    /// A text that is no expression.
    #[error("expression: {0}")]
    Expression(#[from] ExpressionError),
    /// An expression that reads nothing.
    #[error("expression: '{0}' reads no layer: there is nothing to show")]
    ExpressionOfNothing(String),
    /// An expression over a layer that is not shown.
    #[error("expression: it reads layer {0}, which is hidden: remove it from the expression, or make it visible")]
    ExpressionOfHidden(usize),
    /// A layer with a style that an expression does not show.
    #[error(
        "expression: layer {0} has a style of its own, and the expression's value has the expression's: leave the layer's transfer, window, \
         color, gamma, opacity, blend and isosurfaces out"
    )]
    ExpressionStyle(usize),
    /// An expression in another mode.
    #[error("expression: its value is shown in mode dvr, not {0:?}: leave one of both out")]
    ExpressionMode(Mode),
    /// An expression by another method.
    #[error("expression: its value is sampled by method udvr, not {0:?}: leave one of both out")]
    ExpressionMethod(Method),
    /// An expression that is classified by its gradient.
    #[error(
        "expression: the transfer function is one of value and gradient, and an expression is classified by value alone: leave its \
         gradient_opacity and regions out"
    )]
    ExpressionByGradient,
    /// An expression without a function that could be used.
    #[error("expression: transfer function: {0}")]
    ExpressionTransfer(TransferError),
}

/// Why a layer is impossible.
#[derive(Debug, thiserror::Error)]
pub enum LayerError {
    /// The layer's map and its store's orientation come to a map that cannot be used.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// A store that nobody named.
    #[error("store {store} does not exist: there are {stores}, numbered from 0")]
    Store {
        /// The store's place.
        store: usize,
        /// Stores that there are.
        stores: usize,
    },
    /// A channel that the store does not have.
    #[error("channel {channel} does not exist: the store has {channels}, numbered from 0")]
    Channel {
        /// The channel.
        channel: u32,
        /// Channels that there are.
        channels: u32,
    },
    /// A time step that the store does not have.
    #[error("time step {time} does not exist: the store has {times}, numbered from 0")]
    Time {
        /// The time step.
        time: u32,
        /// Time steps that there are.
        times: u32,
    },
    /// No opacity.
    #[error("the opacity is {0}: expected 0 to 1")]
    Opacity(f64),
    /// No power.
    #[error("the gamma is {0}: expected {low} to {high}", low = GAMMAS.start(), high = GAMMAS.end())]
    Gamma(f64),
    /// No window.
    #[error("the window is {0:?}: expected two finite numbers, the lesser first")]
    Window([f64; 2]),
    /// No colour.
    #[error("the color is {0:?}: expected red, green and blue in 0..1")]
    Color([f64; 3]),
    /// A crop without inside.
    #[error("crop: {0}")]
    Crop(ClipError),
    /// No function.
    #[error("transfer function: {0}")]
    Transfer(#[from] TransferError),
    /// A function that cannot be moved.
    #[error(
        "all points of the transfer function have the value {0}, and cannot be moved to a window: leave the window out"
    )]
    Flat(f64),
    /// A function of value and gradient, integrated over values.
    #[error(
        "the sampling method {0:?} integrates over values, and the transfer function is one of value and gradient: use method udvr, lvs, \
         cvs or asm"
    )]
    Integrated(Method),
    /// Surfaces in a projection.
    #[error("the isovalue {0} is for mode isosurface, or dvr: leave it out, or use one of those")]
    SurfaceMode(f64),
    /// Too many surfaces.
    #[error("{0} isosurfaces: expected at most {MAX_SURFACES}")]
    Surfaces(usize),
    /// A surface of no value.
    #[error("the isovalue is {0}: expected a finite number")]
    SurfaceValue(f64),
    /// A surface without opacity.
    #[error("the isosurface at {value} has an opacity of {opacity}: expected a number from 0 to 1")]
    SurfaceOpacity {
        /// Its value.
        value: f64,
        /// Its opacity.
        opacity: f64,
    },
    /// A surface without colour.
    #[error("the isosurface at {value} has the color {color:?}: expected red, green and blue in 0..1")]
    SurfaceColor {
        /// Its value.
        value: f64,
        /// Its colour.
        color: [f64; 3],
    },
    /// A surface twice.
    #[error("two isosurfaces have the value {0}: leave one out")]
    SurfaceTwice(f64),
}
