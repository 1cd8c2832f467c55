//! The scene: all settings of a picture besides the data, as one JSON document.

use crate::camera::Camera;
use crate::clip::{Clip, ClipError, ClipPlane};
use crate::compositing::Blend;
use crate::ensure::ensure;
use crate::layer::SceneLayer;
use crate::lighting::Lighting;
use crate::mesh::{MeshCapacity, MeshLook, MeshLookError, ShownMesh};
use crate::mode::Mode;
use crate::orientation::Side;
use crate::placement::Placement;
use crate::sampling::{Method, Needs, Sampling};
use crate::scene_error::SceneError;
use crate::slice::Slice;
use crate::stereo::Stereo;
use crate::supersampling::PixelSamples;
use crate::transfer::{Subject, TransferChoice, TransferError, TransferFunction};
use glam::DVec3;
use serde::de::{Error, IgnoredAny};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use std::borrow::Cow;

/// The level wanted by a view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LevelPolicy {
    /// Brick by brick the coarsest level with voxels no larger than the pixel error allows.
    #[default]
    Auto,
    /// This level everywhere, as far as the budget goes.
    Locked(u8),
}

/// A scene: the description of a picture. Distances are in world units unless stated otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// The camera; `None` is one with all volumes in view, or straight in front of the slice.
    pub camera: Option<Camera>,
    /// Stereo: two eyes in place of the camera's one. `None` is one eye.
    pub stereo: Option<Stereo>,
    /// The rendering mode.
    pub mode: Mode,
    /// The field's filter, and the sampling of [`Mode::Dvr`]'s segments.
    pub sampling: Sampling,
    /// Lighting of surfaces and of [`Mode::Dvr`]'s fog. Surfaces are lit even without a lighting model, since they would look flat. Each layer is lit
    /// by its own gradients; the fog of [adding](crate::Blend::Add) layers is not lit.
    pub lighting: Lighting,
    /// Sampling step in units of the voxel size of the finest visible layer; positive.
    pub step: f64,
    /// Colour behind the volumes, display-referred.
    pub background: [f64; 3],
    /// Samples of each pixel once the view is settled: more make edges smoother. Pictures of a moving view have one.
    pub pixel_samples: PixelSamples,
    /// The level wanted by the view.
    pub level: LevelPolicy,
    /// Greatest size of a voxel in pixels under [`LevelPolicy::Auto`]; positive.
    pub pixel_error: f64,
    /// Time step of all layers, from 0.
    pub time: u32,
    /// Two corners of a world box, the lesser first: nothing outside it is shown, or read. `None` is no box.
    pub clip: Option<[DVec3; 2]>,
    /// Clip planes, at most [`MAX_CLIP_PLANES`](crate::MAX_CLIP_PLANES): nothing on the outer side of any of them is shown, or read.
    pub clip_planes: Vec<ClipPlane>,
    /// Whether isosurfaces opened by clip box, clip planes or crops are capped, in the colour of the innermost; `None` caps them in
    /// [`Mode::Isosurface`], and not in fog with its visible cut face.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub caps: Option<bool>,
    /// Restricts the volumes to a plane, or to a slab about it. The mode selects the value across it: the mean, greatest or least. `None` shows the
    /// whole volumes.
    pub slice: Option<Slice>,
    /// Triangle meshes, in the scene's world.
    pub meshes: Vec<MeshLook>,
    /// The layers: at least one, at most [`MAX_VOLUMES`](crate::MAX_VOLUMES).
    pub layers: Vec<SceneLayer>,
    /// An expression over the layers' values, shown in place of the layers themselves; `None` shows the layers.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "expression")]
    pub expression: Option<SceneExpression>,
    /// A window's additions to a saved scene. They change no picture, so only windows read them.
    #[serde(skip_serializing)]
    pub window: IgnoredAny,
}

/// The place of a store's volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumePlace {
    /// Least and greatest corner of the volume's box in its own world.
    pub own_box: (DVec3, DVec3),
    /// The map from the volume's own world to its store's.
    pub placement: Placement,
    /// Whether the store's world is a patient's: x to the right, y to the front, z to the head ([`Orientation`](crate::Orientation)).
    pub is_anatomical: bool,
}

/// An [`Expression`](crate::Expression) over the layers of a scene; in JSON the text alone will do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneExpression {
    /// The expression's text; `a` is the value of the first layer.
    pub text: String,
    /// The look of the expression's values; `None` is a gray ramp over their possible range.
    pub transfer: Option<TransferChoice>,
}

impl From<String> for SceneExpression {
    fn from(text: String) -> Self {
        Self { text, transfer: None }
    }
}

impl SceneExpression {
    /// The transfer function of the expression's values, over the subject's window.
    ///
    /// # Errors
    /// If there is no such preset, the function's file has not been read, or the function is not valid.
    pub fn function(&self, subject: &Subject) -> Result<TransferFunction, TransferError> {
        self.transfer.as_ref().map_or_else(|| Ok(subject.default_function()), |choice| choice.function(subject))
    }
}

fn expression<'de, D: Deserializer<'de>>(input: D) -> Result<Option<SceneExpression>, D::Error> {
    match Value::deserialize(input)? {
        Value::Null => Ok(None),
        Value::String(text) => Ok(Some(text.into())),
        value => serde_json::from_value(value).map(Some).map_err(D::Error::custom),
    }
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            camera: None,
            stereo: None,
            mode: Mode::Dvr,
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            step: 1.0,
            pixel_samples: PixelSamples::ONE,
            background: [0.0; 3],
            level: LevelPolicy::Auto,
            pixel_error: 1.0,
            time: 0,
            clip: None,
            clip_planes: Vec::new(),
            caps: None,
            slice: None,
            meshes: Vec::new(),
            layers: vec![SceneLayer::default()],
            expression: None,
            window: IgnoredAny,
        }
    }
}

impl Scene {
    /// Creates a scene of one layer, with defaults for everything else.
    pub fn of(layer: impl Into<SceneLayer>) -> Self {
        Self { layers: vec![layer.into()], ..Self::default() }
    }

    /// Index of a layer's store in the list of stores.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn store(&self, layer: usize) -> usize {
        self.layers[layer].source.unwrap_or(layer)
    }

    /// The layer's look in the scene's mode: projections show plain values, so the preset `auto`, made for fog, becomes a gray ramp.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn look(&self, layer: usize) -> Cow<'_, SceneLayer> {
        let layer = &self.layers[layer];
        match &layer.transfer {
            Some(choice) if choice.is_automatic() && self.mode.is_projection() => {
                Cow::Owned(SceneLayer { transfer: None, ..layer.clone() })
            }
            _ => Cow::Borrowed(layer),
        }
    }

    /// The layer's blending with the others. Unless chosen, labels lie over other layers, channels of one image add in projections, like light, and
    /// everything else mixes, like media. `are_labels` is for a volume of labels.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn blend(&self, layer: usize, are_labels: bool) -> Blend {
        let channel = self.layers[layer].channel;
        let is_sibling = |other| self.store(other) == self.store(layer) && self.layers[other].channel != channel;
        self.layers[layer].blend.unwrap_or_else(|| match are_labels {
            true => Blend::Over,
            false if self.mode.is_projection() && (0..self.layers.len()).any(is_sibling) => Blend::Add,
            false => Blend::Mix,
        })
    }

    /// The map from a layer's volume's own world to the scene's.
    ///
    /// # Errors
    /// If the volume's place combined with the layer's own map is not usable.
    pub fn placement(&self, layer: usize, place: &VolumePlace) -> Result<Placement, SceneError> {
        let placed = self.layers[layer].world_from_volume.after(&place.placement);
        placed.map_err(|error| SceneError::Layer { layer, error: error.into() })
    }

    /// The box around all layers in the scene's world, for stores at these places.
    ///
    /// # Errors
    /// As [`Scene::placement`].
    pub fn world_box(&self, stores: &[VolumePlace]) -> Result<(DVec3, DVec3), SceneError> {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for layer in 0..self.layers.len() {
            if let Some(place) = stores.get(self.store(layer)) {
                let (a, b) = self.placement(layer, place)?.world_box(place.own_box);
                (low, high) = (low.min(a), high.max(b));
            }
        }
        Ok((low, high))
    }

    /// Whether some layer shows a volume with a patient's world; the scene's world is then a patient's too.
    pub fn is_anatomical(&self, stores: &[VolumePlace]) -> bool {
        (0..self.layers.len()).any(|layer| stores.get(self.store(layer)).is_some_and(|place| place.is_anatomical))
    }

    /// The scene's camera, or a default one for stores at these places, in a picture of this size. A patient is seen from the front, and slices with
    /// the head or the front up.
    ///
    /// # Errors
    /// As [`Scene::placement`].
    pub fn camera_for(&self, stores: &[VolumePlace], size: (u32, u32)) -> Result<Camera, SceneError> {
        if let Some(camera) = self.camera {
            return Ok(camera);
        }
        let world_box = self.world_box(stores)?;
        Ok(match (&self.slice, self.is_anatomical(stores)) {
            (Some(slice), true) => slice.camera(world_box, Side::of(slice.normal).up(), size),
            (Some(slice), false) => slice.camera(world_box, slice.image_up(), size),
            (None, true) => Camera::looking_at_patient(world_box).fitted(world_box, size),
            (None, false) => Camera::looking_at_box(world_box).fitted(world_box, size),
        })
    }

    /// Whether isosurfaces are capped where a clip opens them.
    pub fn has_caps(&self) -> bool {
        self.caps.unwrap_or(self.mode == Mode::Isosurface)
    }

    /// The part of the scene's world inside the clip box and on the inner sides of the clip planes, whatever the slice; `None` is everything.
    ///
    /// # Errors
    /// If the box is empty, a plane cannot be normalised, or there are too many planes.
    pub fn world_clip(&self) -> Result<Option<Clip>, ClipError> {
        let is_clipped = self.clip.is_some() || !self.clip_planes.is_empty();
        is_clipped.then(|| Clip::new(self.clip, &self.clip_planes)).transpose()
    }

    /// The picture's requirements on bricks and the tables beside them, without unread meshes.
    pub fn needs(&self) -> Needs {
        let meshes = MeshCapacity::of(self.meshes.iter().filter_map(|look| look.mesh.as_deref()));
        let has_surfaces = self.layers.iter().any(|layer| !layer.isosurfaces.is_empty());
        Needs { meshes, ..Needs::new(self.mode, self.sampling, &self.lighting, has_surfaces, self.is_by_gradient()) }
    }

    /// Whether any layer's transfer function depends on the gradient magnitude.
    pub fn is_by_gradient(&self) -> bool {
        self.layers.iter().filter_map(|layer| layer.transfer.as_ref()).any(TransferChoice::is_by_gradient)
    }

    /// Whether a sampling method can show the scene's transfer functions: pre-integration is over values alone.
    pub fn takes(&self, method: Method) -> bool {
        !(method.is_pre_integrated() && self.is_by_gradient())
    }

    /// The scene's meshes in the renderers' form, without those of opacity 0.
    ///
    /// # Errors
    /// If a mesh has not been read, has a colour or an opacity outside 0..=1, or is translucent in a projection, or if there are too many vertices
    /// and triangles.
    pub fn shown_meshes(&self) -> Result<Vec<ShownMesh>, MeshLookError> {
        let mut shown = Vec::new();
        for look in &self.meshes {
            let mesh = look.shown()?;
            let (opacity, path) = (mesh.opacity, || look.path.clone());
            let is_flat = self.mode.is_projection() && opacity > 0.0 && opacity < 1.0;
            ensure(!is_flat, || MeshLookError::Projection { path: path(), opacity })?;
            shown.push(mesh);
        }
        let numbers = shown.iter().map(|m| (m.mesh.positions().len() + m.mesh.triangles().len()) as u64).sum();
        ensure(numbers < 1 << 31, || MeshLookError::TooLarge(numbers))?;
        shown.retain(|mesh| mesh.opacity > 0.0);
        Ok(shown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;
    use crate::jitter::Jitter;
    use crate::lighting::LightingModel;
    use crate::placement::Placement;
    use crate::sampling::Filter;
    use crate::stereo::StereoLayout;
    use crate::surface::Isosurface;

    #[test]
    fn a_blend_that_nobody_chose_follows_the_mode() {
        let of = |channel| SceneLayer { source: Some(0), channel, ..SceneLayer::default() };
        let alone = SceneLayer { source: Some(1), ..SceneLayer::default() };
        let chosen = SceneLayer { blend: Some(Blend::Mix), ..of(2) };
        let layers = vec![of(0), of(1), chosen, alone];
        for (mode, of_channels) in [(Mode::Dvr, Blend::Mix), (Mode::Isosurface, Blend::Mix), (Mode::Mip, Blend::Add)] {
            let scene = Scene { mode, layers: layers.clone(), ..Scene::default() };
            let blends = [0, 1, 2, 3].map(|layer| scene.blend(layer, false));
            assert_eq!(blends, [of_channels, of_channels, Blend::Mix, Blend::Mix], "{mode:?}");
            assert_eq!((scene.blend(0, true), scene.blend(2, true)), (Blend::Over, Blend::Mix));
        }
    }

    #[test]
    fn scenes_round_trip_through_json() {
        let scene = Scene {
            camera: Some(Camera {
                eye: DVec3::new(0.1, 2.0, -3.0),
                target: DVec3::ZERO,
                up: DVec3::Z,
                projection: Projection::Orthographic { height: 3.5 },
            }),
            stereo: Some(Stereo { layout: StereoLayout::SideBySide, eye_separation: Some(0.25), convergence: None }),
            mode: Mode::Isosurface,
            sampling: Sampling {
                method: Method::Plvs,
                virtual_samples: 5,
                filter: Filter::Tricubic,
                jitter: Jitter::White(7),
            },
            lighting: Lighting { model: LightingModel::Tone, lights: vec![DVec3::X], ..Lighting::default() },
            step: 0.5,
            pixel_samples: PixelSamples::FOUR,
            background: [0.25, 0.5, 1.0],
            level: LevelPolicy::Locked(3),
            pixel_error: 1.5,
            time: 4,
            clip: Some([DVec3::ZERO, DVec3::ONE]),
            clip_planes: vec![ClipPlane { point: DVec3::ONE, normal: DVec3::new(0.0, -0.1, 3.0) }],
            caps: Some(false),
            slice: Some(Slice { point: DVec3::Y, normal: DVec3::new(0.2, 0.0, 7.0), thickness: 0.25 }),
            meshes: vec![MeshLook { color: Some([1.0, 0.5, 0.0]), opacity: 0.25, ..MeshLook::new("a.stl") }],
            layers: vec![
                SceneLayer::default(),
                SceneLayer {
                    source: Some(0),
                    channel: 1,
                    world_from_volume: Placement::from_text("1 2 0 4  0 1 0 5  0 0 3 6").unwrap(),
                    transfer: Some(TransferFunction::preset("gray", (0.0, 9.0), 2.0).unwrap().into()),
                    window: Some([-3.0, 4.5]),
                    color: Some([0.25, 1.0, 0.0]),
                    gamma: 0.75,
                    show_labels: Some(vec![3, -7]),
                    opacity: 0.5,
                    blend: Some(Blend::Add),
                    isosurfaces: vec![Isosurface { value: -7.5, color: Some([1.0, 0.5, 0.0]), opacity: 0.25 }],
                    crop: Some([DVec3::ZERO, DVec3::ONE]),
                    visible: false,
                },
            ],
            expression: Some(SceneExpression {
                text: "max(a, b)".into(),
                transfer: Some(TransferChoice::preset("fire")),
            }),
            window: IgnoredAny,
        };
        let text = serde_json::to_string(&scene).unwrap();
        assert_eq!(serde_json::from_str::<Scene>(&text).unwrap(), scene);
        assert_eq!(serde_json::from_str::<Scene>("{}").unwrap(), Scene::default());
        assert_eq!(serde_json::from_str::<Scene>(r#"{"window": {"layout": "planes"}}"#).unwrap(), Scene::default());
        assert_eq!(Scene::default().layers, [SceneLayer::default()], "one volume is a list of one");
        let short = serde_json::from_str::<Scene>(r#"{"expression": "a*b"}"#).unwrap();
        assert_eq!(short.expression, Some("a*b".to_string().into()));
        let stereo = |text: &str| serde_json::from_str::<Scene>(&format!(r#"{{"stereo": {text}}}"#)).map(|s| s.stereo);
        let anaglyph = Stereo::new(StereoLayout::Anaglyph);
        assert_eq!(stereo(r#"{"layout": "anaglyph"}"#).unwrap(), Some(anaglyph));
        assert!(stereo(r#"{"layout": "anaglyph", "separation": 2}"#).is_err() && stereo("{}").is_err());
    }
}
