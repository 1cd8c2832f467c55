//! A layer of a scene: its volume, placement, look, and blending with others. Style and volume together give a transfer function, at the cost of a
//! copy of the points.

use crate::compositing::Blend;
use crate::ensure::ensure;
use crate::labels::{LabelCodes, LabelLook};
use crate::placement::Placement;
use crate::scene_error::LayerError;
use crate::slot_encoding::SlotEncoding;
use crate::surface::Isosurface;
use crate::transfer::{Subject, TransferChoice, TransferFunction};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A layer of a scene: one volume, and its look. Distances are in the volume's own world, given by its store.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneLayer {
    /// Index of the layer's store; `None` is the store with the layer's own index.
    pub source: Option<usize>,
    /// The store's channel, from 0.
    pub channel: u32,
    /// Placement of the volume: the map from its own world to the scene's.
    pub world_from_volume: Placement,
    /// The transfer function; `None` is a gray ramp over the window, for plain values. A new volume's first look is [`TransferChoice::automatic`].
    pub transfer: Option<TransferChoice>,
    /// Least and greatest value of the window. Presets span it; functions with values of their own are stretched to it. `None` is the default window
    /// of the store's channel, and stretches nothing.
    pub window: Option<[f64; 2]>,
    /// A colour replacing the transfer function's: colours go from black to this one over the window. `None` leaves the function's.
    pub color: Option<[f64; 3]>,
    /// Exponent for colours and opacities over the window; below 1 it brings out the lesser values.
    pub gamma: f64,
    /// The shown labels of a volume of labels; `None` shows all but the background.
    pub show_labels: Option<Vec<i64>>,
    /// Factor of the transfer function's opacities, in 0..=1; in projections the opacity of the whole layer.
    pub opacity: f64,
    /// Blending with others in the same place; `None` follows from the mode: see [`Scene::blend`](crate::Scene::blend).
    pub blend: Option<Blend>,
    /// The layer's isosurfaces, at most [`MAX_SURFACES`](crate::surface::MAX_SURFACES). [`Mode::Isosurface`](crate::Mode::Isosurface) shows nothing
    /// else of it; in [`Mode::Dvr`](crate::Mode::Dvr) they stand in the fog, among the surfaces of all layers.
    pub isosurfaces: Vec<Isosurface>,
    /// Two corners of a box in voxels, the lesser first, with voxel `i` from `i` to `i + 1` along each axis: the volume is neither shown nor read
    /// outside it.
    pub crop: Option<[DVec3; 2]>,
    /// Whether the layer is shown.
    pub visible: bool,
}

impl Default for SceneLayer {
    fn default() -> Self {
        Self {
            source: None,
            channel: 0,
            world_from_volume: Placement::default(),
            transfer: None,
            window: None,
            color: None,
            gamma: 1.0,
            show_labels: None,
            opacity: 1.0,
            blend: None,
            isosurfaces: Vec::new(),
            crop: None,
            visible: true,
        }
    }
}

impl From<TransferFunction> for SceneLayer {
    fn from(function: TransferFunction) -> Self {
        Self { transfer: Some(function.into()), ..Self::default() }
    }
}

impl SceneLayer {
    /// The transfer function of the layer's style for a subject, without the layer's `opacity`.
    ///
    /// # Errors
    /// If there is no such preset, the transfer function's file has not been read, the function is invalid, or it has no width to stretch to a
    /// window.
    pub fn function(&self, subject: &Subject) -> Result<TransferFunction, LayerError> {
        let subject = self.window.map_or(*subject, |window| subject.in_window(window.into()));
        let window = subject.window;
        let mut function = match &self.transfer {
            Some(choice) => choice.function(&subject)?,
            None => subject.default_function(),
        };
        if self.window.is_some() && self.transfer.as_ref().is_some_and(|choice| !choice.spans_window()) {
            let (low, high) = function.span();
            ensure(low < high, || LayerError::Flat(low))?;
            function = function.stretched((low, high), window);
        }
        if subject.is_labels {
            return Ok(self.of_labels(function));
        }
        let is_automatic = self.transfer.as_ref().is_some_and(TransferChoice::is_automatic);
        match self.color {
            Some([r, g, b]) if is_automatic => {
                // A body in this colour.
                for point in &mut function.color {
                    *point = [point[0], point[1] * r, point[2] * g, point[3] * b];
                }
            }
            Some([r, g, b]) => function.color = vec![[window.0, 0.0, 0.0, 0.0], [window.1, r, g, b]],
            None => {}
        }
        Ok(function.bent(window, self.gamma))
    }

    /// Limits a transfer function of labels to the layer's labels, in the layer's colour if it has one.
    fn of_labels(&self, mut function: TransferFunction) -> TransferFunction {
        if let Some([r, g, b]) = self.color {
            function.color = vec![[0.0, r, g, b]];
            function.labels = Some(LabelLook::default());
        }
        if self.show_labels.is_some() {
            function.labels.get_or_insert_default().shown.clone_from(&self.show_labels);
        }
        function
    }

    /// Returns this layer with its transfer function written out, replacing choice, window, colour, gamma and labels.
    pub fn written_out(&self, function: TransferFunction) -> Self {
        let transfer = Some(function.into());
        Self { transfer, window: None, color: None, gamma: 1.0, show_labels: None, ..self.clone() }
    }

    /// Checks that the layer's style suits its values: labels or measurements.
    ///
    /// # Errors
    /// The first unsuitable part of the style.
    pub(crate) fn check_kind(&self, is_labels: bool) -> Result<(), LayerError> {
        let has_own = matches!(&self.transfer, Some(TransferChoice::Function(function)) if function.labels.is_some());
        let styles = [
            ("window", self.window.is_some() && self.transfer.is_none()),
            ("gamma", self.gamma != 1.0),
            ("isosurfaces", !self.isosurfaces.is_empty()),
            ("gradient_opacity or regions", self.transfer.as_ref().is_some_and(TransferChoice::is_by_gradient)),
        ];
        match styles.into_iter().find(|(_, is_there)| *is_there) {
            _ if !is_labels && (self.show_labels.is_some() || has_own) => Err(LayerError::NoLabels),
            Some((style, _)) if is_labels => Err(LayerError::OfLabels(style)),
            _ => Ok(()),
        }
    }

    /// Whether an expression's value could replace the layer's own: it has no style at all.
    pub(crate) fn has_no_style(&self) -> bool {
        let Self { source, channel, world_from_volume, crop, visible, .. } = self.clone();
        *self == Self { source, channel, world_from_volume, crop, visible, ..Self::default() }
    }
}

/// Codes of the labels in a function's look; `None` if the labels have the encoding's own codes.
///
/// # Errors
/// If the function maps the labels' numbers, or its look names too many labels.
pub fn label_codes(function: &TransferFunction, encoding: &SlotEncoding) -> Result<Option<LabelCodes>, LayerError> {
    if !encoding.is_hashed {
        return Ok(None);
    }
    match &function.labels {
        Some(look) if function.is_even() => LabelCodes::of(look).map(Some).ok_or(LayerError::ManyLabels),
        _ => Err(LayerError::HashedLabels),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SUBJECT: Subject = Subject {
        window: (0.0, 200.0),
        unit_distance: 3.0,
        cell_length: 1.0,
        mean_spacing: 1.0,
        is_labels: false,
        foreground: None,
    };

    #[test]
    fn a_style_comes_to_one_function() {
        let of = |layer: &SceneLayer| layer.function(&SUBJECT).unwrap();
        let preset = |name: &str, window| TransferFunction::preset(name, window, 3.0).unwrap();
        let plain = SceneLayer::default();
        assert_eq!(of(&plain), preset("gray", (0.0, 200.0)));
        let layer = |name: &str| SceneLayer { transfer: Some(TransferChoice::preset(name)), ..plain.clone() };
        assert_eq!(of(&layer("mr-default")), preset("mr-default", (0.0, 200.0)));
        let window = Some([50.0, 90.0]);
        assert_eq!(of(&SceneLayer { window, ..layer("mr-default") }), preset("mr-default", (50.0, 90.0)));
        // Functions with values of their own keep them, unless a window is given.
        assert_eq!(of(&layer("ct-bone")), preset("ct-bone", (0.0, 1.0)));
        assert_eq!(of(&SceneLayer { window, ..layer("ct-bone") }).span(), (50.0, 90.0));
        let given = preset("fire", (-7.0, 1.0));
        assert_eq!(of(&given.clone().into()), given);
        let moved = of(&SceneLayer { window, ..given.clone().into() });
        assert!((moved.rgb(70.0)[0] - given.rgb(-3.0)[0]).abs() < 1e-12 && moved.span() == (50.0, 90.0));
        let red = of(&SceneLayer { color: Some([1.0, 0.5, 0.0]), window, ..plain.clone() });
        assert_eq!((red.rgb(70.0), red.opacity), ([0.5, 0.25, 0.0], preset("gray", (50.0, 90.0)).opacity));
        let bent = of(&SceneLayer { gamma: 2.0, ..plain.clone() });
        assert!((bent.rgb(100.0)[0] - 0.25).abs() < 2e-3, "a half squared: {:?}", bent.rgb(100.0));
        let flat = SceneLayer { window, ..TransferFunction::default().into() };
        assert!(matches!(flat.function(&SUBJECT), Err(LayerError::Flat(0.0))));
    }

    #[test]
    fn labels_have_colours_of_their_own_and_no_windows() {
        let of = |layer: &SceneLayer| layer.function(&Subject { is_labels: true, ..SUBJECT }).unwrap();
        let plain = SceneLayer::default();
        let hashed = of(&plain);
        assert_eq!((hashed.alpha(0.0), hashed.alpha(3.0), hashed.unit_distance), (0.0, 1.0, 3.0));
        assert_ne!(hashed.rgb(3.0), hashed.rgb(4.0));
        let some = of(&SceneLayer { show_labels: Some(vec![3]), ..plain.clone() });
        assert_eq!((some.alpha(3.0), some.alpha(4.0), some.rgb(3.0)), (1.0, 0.0, hashed.rgb(3.0)));
        let red = of(&SceneLayer { color: Some([1.0, 0.0, 0.0]), ..plain.clone() });
        assert_eq!((red.rgb(3.0), red.rgb(4.0), red.alpha(0.0)), ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0));
        let preset = of(&SceneLayer { transfer: Some(TransferChoice::preset("gray")), ..plain.clone() });
        assert_eq!(preset.labels, None, "a transfer function over the labels' numbers");
        let window = SceneLayer { window: Some([0.0, 9.0]), ..plain.clone() };
        assert!(
            matches!(window.check_kind(true), Err(LayerError::OfLabels("window"))) && window.check_kind(false).is_ok()
        );
        let some = SceneLayer { show_labels: Some(vec![3]), ..plain };
        assert!(matches!(some.check_kind(false), Err(LayerError::NoLabels)) && some.check_kind(true).is_ok());
        let written = some.written_out(of(&some));
        assert!(written.check_kind(true).is_ok() && matches!(written.check_kind(false), Err(LayerError::NoLabels)));
    }

    #[test]
    fn a_layer_written_out_is_the_same_layer() {
        let layer = SceneLayer {
            transfer: Some(TransferChoice::preset("viridis")),
            window: Some([10.0, 30.0]),
            gamma: 0.5,
            opacity: 0.25,
            ..SceneLayer::default()
        };
        let written = layer.written_out(layer.function(&SUBJECT).unwrap());
        let elsewhere = Subject { window: (-9.0, 2.0), ..SUBJECT };
        assert_eq!(written.function(&elsewhere).unwrap(), layer.function(&SUBJECT).unwrap());
        assert_eq!(written.opacity, 0.25);
        assert!(
            !layer.has_no_style() && SceneLayer { channel: 3, visible: false, ..SceneLayer::default() }.has_no_style()
        );
    }
}
