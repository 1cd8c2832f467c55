//! The window's state as one document: the scene, in the form of `brickyard render --scene`, and in its field `window` the window's own settings.
//! Saving, restoring, undoing and scripts all work on this document. Costs a walk through the scene for each writing or reading.

use crate::play::Play;
use brickyard::volume::{Camera, Isosurface, Scene};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::PathBuf;

/// The document shown by a window.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct State {
    pub(crate) scene: Scene,
    /// The window's own settings.
    pub(crate) window: WindowState,
    /// Surfaces lent to layers without any when mode isosurface was chosen. They go with the mode, unless changed.
    pub(crate) lent_surfaces: Vec<Isosurface>,
}

/// A window's settings besides the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct WindowState {
    /// The volumes of the scene's layers: stores, and files shown while being packed.
    pub(crate) volumes: Vec<PathBuf>,
    pub(crate) layout: Layout,
    /// The three slices of [`Layout::Planes`].
    pub(crate) planes: Planes,
    pub(crate) overlays: Overlays,
    /// Measured distances, each between two world points.
    pub(crate) distances: Vec<[DVec3; 2]>,
    pub(crate) motion: Motion,
    pub(crate) play: Play,
    /// Memory limits in MiB; `None` keeps the initial ones.
    pub(crate) budgets_mib: Option<Budgets>,
    pub(crate) tool: Tool,
    /// Whether residency, rates and memory are shown.
    pub(crate) diagnostics: bool,
    /// Whether the keys are shown.
    pub(crate) help: bool,
    /// Whether there is anything besides the pictures.
    pub(crate) panels: bool,
    pub(crate) fullscreen: bool,
    pub(crate) theme: Theme,
}

impl Default for WindowState {
    fn default() -> Self {
        Self {
            volumes: Vec::new(),
            layout: Layout::default(),
            planes: Planes::default(),
            overlays: Overlays::default(),
            distances: Vec::new(),
            motion: Motion::default(),
            play: Play::default(),
            budgets_mib: None,
            tool: Tool::default(),
            diagnostics: false,
            help: false,
            panels: true,
            fullscreen: false,
            theme: Theme::default(),
        }
    }
}

/// Division of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Layout {
    /// The scene's picture alone.
    #[default]
    Single,
    /// The scene's picture, and three slices through one point along the voxels of the first visible layer.
    Planes,
}

/// Three slices linked by their common point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Planes {
    /// The slices' common point in the world; `None` is the middle.
    pub(crate) crosshair: Option<DVec3>,
    /// Cameras of the slices across the voxels' x, y and z axis, each moved along its view to its slice. `None` sees all of it.
    pub(crate) cameras: [Option<Camera>; 3],
    /// Whether layers without a colour of their own are gray over their windows, as scans are read, whatever the transfer function; labels keep their
    /// colours.
    pub(crate) gray: bool,
    /// The first visible layer's values shown black and white in the slices; `None` is the layer's window.
    pub(crate) window: Option<[f64; 2]>,
    pub(crate) filter: PlaneFilter,
    /// Thickness of each slice in world units; 0 is as thin as can be.
    pub(crate) thickness: f64,
}

impl Default for Planes {
    fn default() -> Self {
        Self {
            crosshair: None,
            cameras: [None; 3],
            gray: true,
            window: None,
            filter: PlaneFilter::Auto,
            thickness: 0.0,
        }
    }
}

/// The filter from voxels of slices to pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PlaneFilter {
    /// Nearest for voxels of two pixels or more, else linear.
    #[default]
    Auto,
    /// The value of the voxel at the pixel.
    Nearest,
    /// Linear between voxels.
    Linear,
}

/// Overlays of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Overlays {
    /// The edges of the box around all volumes.
    pub(crate) outline: bool,
    /// Ticks with world coordinates along the edges.
    pub(crate) ticks: bool,
    /// The directions of the axes.
    pub(crate) axes: bool,
    pub(crate) scale_bar: bool,
    /// The colours of values.
    pub(crate) color_bar: bool,
    /// Handles on the faces of the clip box.
    pub(crate) clip_handles: bool,
    /// The edges of the drawn bricks.
    pub(crate) bricks: bool,
    /// Letters for the sides of a patient, at the edges of slices.
    pub(crate) letters: bool,
}

impl Overlays {
    pub(crate) const NONE: Self = Self {
        outline: false,
        ticks: false,
        axes: false,
        scale_bar: false,
        color_bar: false,
        clip_handles: false,
        bricks: false,
        letters: false,
    };
}

impl Default for Overlays {
    fn default() -> Self {
        Self {
            outline: true,
            axes: true,
            scale_bar: true,
            color_bar: true,
            clip_handles: true,
            letters: true,
            ..Self::NONE
        }
    }
}

/// Drawing of changing pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Motion {
    /// Whether changing pictures are coarser.
    pub(crate) adaptive: bool,
    /// Longest frame during changes, in milliseconds.
    pub(crate) frame_goal_ms: f64,
}

impl Default for Motion {
    fn default() -> Self {
        Self { adaptive: true, frame_goal_ms: 50.0 }
    }
}

/// Effect of dragging and clicking in the scene's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Tool {
    /// Dragging turns the view around the point under the pointer.
    #[default]
    Turn,
    /// Dragging turns the eye, and keys move it.
    Fly,
    /// Two clicks measure a distance.
    Distance,
}

/// Hard memory limits, in MiB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Budgets {
    /// Slots, tables, targets and staging.
    pub(crate) gpu: u32,
    /// Decoded bricks and scratch.
    pub(crate) host: u32,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Theme {
    /// Pale text on dark panels.
    #[default]
    Dark,
    /// Dark text on pale panels.
    Light,
}

impl State {
    /// Converts the state to a document.
    ///
    /// # Errors
    /// If a path in it is not text.
    pub(crate) fn to_document(&self) -> Result<Value, serde_json::Error> {
        let mut document = serde_json::to_value(&self.scene)?;
        document["window"] = serde_json::to_value(&self.window)?;
        Ok(document)
    }

    /// Reads a document, but none of the files its scene names.
    ///
    /// # Errors
    /// If it is no object, a field is unknown, or has a value of another kind.
    pub(crate) fn from_document(document: Value) -> Result<Self, serde_json::Error> {
        if !document.is_object() {
            // serde reads lists as the fields in their order.
            return Err(serde::de::Error::custom("expected an object"));
        }
        let window = document.get("window").cloned().map_or_else(|| Ok(WindowState::default()), serde_json::from_value);
        Ok(Self { window: window?, scene: serde_json::from_value(document)?, lent_surfaces: Vec::new() })
    }

    /// Copies navigation from `other`, which is no edit: the views' place in space and time, the volumes, the memory limits, and the look of the
    /// window.
    pub(crate) fn keep_navigation_of(&mut self, other: &Self) {
        self.scene.camera = other.scene.camera;
        self.scene.time = other.scene.time;
        self.window.play = other.window.play;
        self.window.volumes.clone_from(&other.window.volumes);
        self.window.planes.crosshair = other.window.planes.crosshair;
        self.window.planes.cameras = other.window.planes.cameras;
        self.window.budgets_mib = other.window.budgets_mib;
        self.window.tool = other.window.tool;
        self.window.diagnostics = other.window.diagnostics;
        self.window.help = other.window.help;
        self.window.panels = other.window.panels;
        self.window.fullscreen = other.window.fullscreen;
        self.window.theme = other.window.theme;
    }
}

/// The fields kept by [`State::keep_navigation_of`].
const NAVIGATION: [&str; 13] = [
    "camera",
    "time",
    "window.play",
    "window.planes.crosshair",
    "window.planes.cameras",
    "window.budgets_mib",
    "window.volumes",
    "window.tool",
    "window.diagnostics",
    "window.help",
    "window.panels",
    "window.fullscreen",
    "window.theme",
];

/// Whether a field is navigation rather than an edit: the place of a view, or the look of the window.
pub(crate) fn is_navigation(field: &str) -> bool {
    NAVIGATION
        .iter()
        .any(|known| field.strip_prefix(known).is_some_and(|rest| rest.is_empty() || rest.starts_with('.')))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::play::tests::play;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        [-1e3..1e3, -1e3..1e3, -1e3..1e3f64].prop_map(DVec3::from_array)
    }

    fn camera() -> impl Strategy<Value = Camera> {
        (point(), point()).prop_map(|(eye, target)| Camera {
            eye,
            target,
            ..Camera::looking_at_box((DVec3::ZERO, DVec3::ONE))
        })
    }

    fn overlays() -> impl Strategy<Value = Overlays> {
        any::<[bool; 8]>().prop_map(|[outline, ticks, axes, scale_bar, color_bar, clip_handles, bricks, letters]| {
            Overlays { outline, ticks, axes, scale_bar, color_bar, clip_handles, bricks, letters }
        })
    }

    fn planes() -> impl Strategy<Value = Planes> {
        let camera = || prop::option::of(camera());
        let filter = prop::sample::select(vec![PlaneFilter::Auto, PlaneFilter::Nearest, PlaneFilter::Linear]);
        let of_views = (prop::option::of(point()), [camera(), camera(), camera()]);
        let of_values = (any::<bool>(), prop::option::of([-9.0..0.0, 0.0..9.0f64]));
        (of_views, of_values, filter, 0.0..9.0).prop_map(|((crosshair, cameras), (gray, window), filter, thickness)| {
            Planes { crosshair, cameras, gray, window, filter, thickness }
        })
    }

    /// Arbitrary settings of a window.
    pub(crate) fn window() -> impl Strategy<Value = WindowState> {
        let volumes = prop::collection::vec("[a-z/]{1,9}".prop_map(PathBuf::from), 0..3);
        let distances = prop::collection::vec([point(), point()], 0..3);
        let motion =
            (any::<bool>(), 1.0..999.0).prop_map(|(adaptive, frame_goal_ms)| Motion { adaptive, frame_goal_ms });
        let budgets = prop::option::of((1u32..9999, 1u32..9999).prop_map(|(gpu, host)| Budgets { gpu, host }));
        let kinds = (
            prop::sample::select(vec![Layout::Single, Layout::Planes]),
            prop::sample::select(vec![Theme::Dark, Theme::Light]),
            prop::sample::select(vec![Tool::Turn, Tool::Fly, Tool::Distance]),
            any::<[bool; 4]>(),
        );
        let motion = (motion, play());
        (volumes, planes(), overlays(), distances, motion, budgets, kinds).prop_map(
            |(
                volumes,
                planes,
                overlays,
                distances,
                (motion, play),
                budgets_mib,
                (layout, theme, tool, [diagnostics, help, panels, fullscreen]),
            )| WindowState {
                volumes,
                layout,
                planes,
                overlays,
                distances,
                motion,
                play,
                budgets_mib,
                tool,
                diagnostics,
                help,
                panels,
                fullscreen,
                theme,
            },
        )
    }

    proptest! {
        #[test]
        fn every_field_of_a_window_is_read_as_it_was_written(window in window(), camera in prop::option::of(camera())) {
            let state = State { scene: Scene { camera, ..Scene::default() }, window, ..State::default() };
            let document = state.to_document().unwrap();
            let text = serde_json::to_string(&document).unwrap();
            prop_assert_eq!(State::from_document(serde_json::from_str(&text).unwrap()).unwrap(), state);
            // Commands that draw pictures read the scene alone.
            prop_assert_eq!(serde_json::from_str::<Scene>(&text).unwrap().camera, camera);
        }

        #[test]
        fn what_is_navigation_stays(first in window(), second in window()) {
            let of = |window: &WindowState| State { window: window.clone(), ..State::default() };
            let mut kept = of(&first);
            kept.keep_navigation_of(&of(&second));
            let fields = crate::fields::differences(&of(&second).to_document().unwrap(), &kept.to_document().unwrap());
            for (field, _) in fields {
                prop_assert!(!is_navigation(&field), "{field}");
            }
        }
    }

    #[test]
    fn unknown_fields_are_refused() {
        for text in [r#"{"window": {"layuot": "single"}}"#, r#"{"modde": "mip"}"#, r#"{"window": {"layout": "five"}}"#]
        {
            assert!(State::from_document(serde_json::from_str(text).unwrap()).is_err(), "{text}");
        }
    }
}
