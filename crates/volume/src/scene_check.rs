//! The check of scenes, where invalid ones are refused. It uses the scene and the stores' counts, never data, so it costs microseconds
//! and precedes any reading.
//!
//! Some errors are refused by types as a scene is parsed: unknown fields, and singular places ([`Placement`](crate::Placement)). Cameras
//! and stereo, which depend on the picture's size, have errors of their own.

use crate::bounds::STEPS;
use crate::clip::{Clip, ClipError, MAX_CLIP_PLANES};
use crate::ensure::ensure;
use crate::expression::{Expression, MAX_VOLUMES};
use crate::layer::SceneLayer;
use crate::lighting::{Lighting, LightingModel, MAX_LIGHTS};
use crate::mode::Mode;
use crate::sampling::{MOST_VIRTUAL_SAMPLES, Method};
use crate::scene::{LevelPolicy, Scene, SceneExpression};
use crate::scene_error::{LayerError, SceneError};
use crate::surface::{Isosurface, MAX_SURFACES};
use crate::transfer::GAMMAS;
use crate::transfer::{Subject, TransferChoice};

/// A store's numbers of levels, time steps and channels, and the kind of its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreCounts {
    /// Number of levels.
    pub levels: usize,
    /// Number of time steps.
    pub times: u32,
    /// Number of channels.
    pub channels: u32,
    /// Whether the store's values are labels.
    pub is_labels: bool,
}

impl Scene {
    /// Checks that these stores can show the scene.
    ///
    /// # Errors
    /// The first problem.
    pub fn check(&self, stores: &[StoreCounts]) -> Result<(), SceneError> {
        let layers = self.layers.len();
        ensure((1..=MAX_VOLUMES).contains(&layers), || SceneError::Layers(layers))?;
        for layer in 0..self.layers.len() {
            let checked = self.check_store(layer, stores).and_then(|()| self.check_layer(&self.layers[layer]));
            checked.map_err(|error| SceneError::Layer { layer, error })?;
        }
        self.check_sampling(stores)?;
        self.check_lighting()?;
        self.check_clip()?;
        self.shown_meshes()?;
        let shown = self.shown_layers()?;
        let has_surface = |layer: &usize| !self.layers[*layer].isosurfaces.is_empty();
        ensure(self.mode != Mode::Isosurface || shown.iter().any(has_surface), || SceneError::NoSurface)
    }

    /// Indices of the shown layers: all visible ones, or those read by the expression.
    ///
    /// # Errors
    /// If no layer is visible, or the expression cannot be shown.
    pub fn shown_layers(&self) -> Result<Vec<usize>, SceneError> {
        if let Some(expression) = self.parsed_expression()? {
            return Ok(expression.volumes());
        }
        let shown: Vec<usize> = (0..self.layers.len()).filter(|&i| self.layers[i].visible).collect();
        if shown.is_empty() { Err(SceneError::NothingVisible) } else { Ok(shown) }
    }

    /// Parses the scene's expression over all layers; `None` if it has none.
    ///
    /// # Errors
    /// If the text is no expression, or the scene's layers, mode, method or transfer function do not suit one: its value is one number in
    /// each place.
    pub fn parsed_expression(&self) -> Result<Option<Expression>, SceneError> {
        let Some(look @ SceneExpression { text, transfer }) = &self.expression else { return Ok(None) };
        let expression = Expression::parse(text, self.layers.len())?;
        let read = expression.volumes();
        let method = self.sampling.method;
        ensure(!read.is_empty(), || SceneError::ExpressionOfNothing(text.clone()))?;
        if let Some(&layer) = read.iter().find(|&&layer| !self.layers[layer].visible) {
            return Err(SceneError::ExpressionOfHidden(layer));
        }
        if let Some(layer) = self.layers.iter().position(|layer| !layer.has_no_style()) {
            return Err(SceneError::ExpressionStyle(layer));
        }
        ensure(self.mode == Mode::Dvr, || SceneError::ExpressionMode(self.mode))?;
        ensure(method == Method::Udvr, || SceneError::ExpressionMethod(method))?;
        let is_by_gradient = transfer.as_ref().is_some_and(TransferChoice::is_by_gradient);
        ensure(!is_by_gradient, || SceneError::ExpressionByGradient)?;
        look.function(&Subject::NONE).map_err(SceneError::ExpressionTransfer)?;
        Ok(Some(expression))
    }

    fn check_store(&self, layer: usize, stores: &[StoreCounts]) -> Result<(), LayerError> {
        let (store, channel, time) = (self.store(layer), self.layers[layer].channel, self.time);
        let missing = LayerError::Store { store, stores: stores.len() };
        let &StoreCounts { times, channels, is_labels, .. } = stores.get(store).ok_or(missing)?;
        ensure(channel < channels, || LayerError::Channel { channel, channels })?;
        // Stores with fewer steps show the latest one by then.
        let all = (0..self.layers.len()).filter_map(|layer| stores.get(self.store(layer)));
        let times = all.map(|store| store.times).fold(times, u32::max);
        ensure(time < times, || LayerError::Time { time, times })?;
        self.layers[layer].check_kind(is_labels)
    }

    fn check_layer(&self, layer: &SceneLayer) -> Result<(), LayerError> {
        ensure((0.0..=1.0).contains(&layer.opacity), || LayerError::Opacity(layer.opacity))?;
        ensure(GAMMAS.contains(&layer.gamma), || LayerError::Gamma(layer.gamma))?;
        if let Some([low, high]) = layer.window.filter(|[low, high]| !(low < high && (high - low).is_finite())) {
            return Err(LayerError::Window([low, high]));
        }
        if let Some(color) = layer.color.filter(|color| !is_color(color)) {
            return Err(LayerError::Color(color));
        }
        Clip::new(layer.crop, &[]).map_err(LayerError::Crop)?;
        layer.function(&Subject::NONE)?;
        let is_by_gradient = layer.transfer.as_ref().is_some_and(TransferChoice::is_by_gradient);
        let is_integrated = self.mode == Mode::Dvr && self.sampling.method.is_pre_integrated();
        ensure(!(is_integrated && is_by_gradient), || LayerError::Integrated(self.sampling.method))?;
        self.check_surfaces(&layer.isosurfaces)
    }

    fn check_surfaces(&self, surfaces: &[Isosurface]) -> Result<(), LayerError> {
        for (i, &Isosurface { value, color, opacity }) in surfaces.iter().enumerate() {
            ensure(!self.mode.is_projection(), || LayerError::SurfaceMode(value))?;
            ensure(surfaces.len() <= MAX_SURFACES, || LayerError::Surfaces(surfaces.len()))?;
            ensure(value.is_finite(), || LayerError::SurfaceValue(value))?;
            ensure((0.0..=1.0).contains(&opacity), || LayerError::SurfaceOpacity { value, opacity })?;
            if let Some(color) = color.filter(|color| !is_color(color)) {
                return Err(LayerError::SurfaceColor { value, color });
            }
            let is_new = surfaces[..i].iter().all(|other| other.value != value);
            ensure(is_new, || LayerError::SurfaceTwice(value))?;
        }
        Ok(())
    }

    fn check_sampling(&self, stores: &[StoreCounts]) -> Result<(), SceneError> {
        let levels = (0..self.layers.len()).map(|i| stores[self.store(i)].levels).max().unwrap_or(0);
        if let LevelPolicy::Locked(level) = self.level
            && level as usize >= levels
        {
            return Err(SceneError::Level { level, levels });
        }
        ensure(STEPS.contains(&self.step), || SceneError::Step(self.step))?;
        let pixel_error = self.pixel_error;
        ensure(pixel_error.is_finite() && pixel_error > 0.0, || SceneError::PixelError(pixel_error))?;
        let (method, samples) = (self.sampling.method, self.sampling.virtual_samples);
        ensure(method == Method::Udvr || self.mode == Mode::Dvr, || SceneError::Method(method))?;
        ensure((1..=MOST_VIRTUAL_SAMPLES).contains(&samples), || SceneError::VirtualSamples(samples))?;
        ensure(is_color(&self.background), || SceneError::Background(self.background))
    }

    fn check_lighting(&self) -> Result<(), SceneError> {
        let Lighting { model, ref lights, .. } = self.lighting;
        ensure(model == LightingModel::None || !self.mode.is_projection(), || SceneError::Lighting(model))?;
        ensure(lights.len() <= MAX_LIGHTS, || SceneError::Lights(lights.len()))?;
        if let Some(&light) = lights.iter().find(|light| !light.is_finite()) {
            return Err(SceneError::Light(light));
        }
        let has_surfaces = self.layers.iter().any(|layer| !layer.isosurfaces.is_empty());
        let is_lit = model != LightingModel::None || has_surfaces;
        ensure(is_lit || lights.is_empty(), || SceneError::Unlit)
    }

    /// Checks clip box, planes and slice.
    fn check_clip(&self) -> Result<(), ClipError> {
        let planes = self.clip_planes.len();
        ensure(planes <= MAX_CLIP_PLANES, || ClipError::Planes(planes))?;
        Clip::new(self.clip, &self.clip_planes)?;
        let Some(slice) = &self.slice else { return Ok(()) };
        if self.mode.is_projection() { slice.check() } else { Err(ClipError::SliceMode(self.mode)) }
    }
}

fn is_color(color: &[f64; 3]) -> bool {
    color.iter().all(|channel| (0.0..=1.0).contains(channel))
}

#[cfg(test)]
mod tests;
