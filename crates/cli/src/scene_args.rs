//! The flags that describe a picture, except its sampling, shared by every command that shows something.

use super::channel_args::{ChannelArguments, layers_of_kind};
use super::named::Named;
use super::say::say;
use super::slice_argument::{self, SliceArgument};
use super::step_range::StepRange;
use super::values::{self, GradientOpacity};
use super::volume_args::{VolumeKey, VolumeSetting, set_transfer, transfer_choice, volume_setting};
use super::{Failure, heading};
use brickyard::first_look::set_first_look;
use brickyard::scene_file::{self, SceneFile};
use brickyard::session::VolumeSource;
use brickyard::volume::scene::VolumePlace;
use brickyard::volume::{
    Camera, ClipPlane, Gradient, Isosurface, MeshLook, Mode, Projection, Scene, SceneExpression, SceneLayer, Stereo,
    StereoLayout, TransferFunction, Viewpoint,
};
use clap::Args;
use glam::DVec3;
#[cfg(feature = "viewer")]
use std::path::Path;
use std::path::PathBuf;

/// Flags that describe a picture. They override the scene file.
#[derive(Args, Clone, Debug)]
pub(crate) struct SceneArguments {
    /// Scene file (JSON); flags override it
    #[arg(help_heading = heading::PART, long)]
    scene: Option<PathBuf>,
    /// Camera position, world units [default: all volumes in view; a patient from the front, slightly from the side and
    /// above]
    #[arg(help_heading = heading::CAMERA, long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// Point the camera looks at [default: the volume's centre, or the slice's]
    #[arg(help_heading = heading::CAMERA, long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// The picture's up direction [default: 0,0,1; 0,-1,0 for slices nearer to level than to upright]
    #[arg(help_heading = heading::CAMERA, long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    up: Option<DVec3>,
    /// Vertical opening angle, degrees [default: 30]
    #[arg(help_heading = heading::CAMERA, long, value_name = "DEG", conflicts_with = "ortho")]
    fov: Option<f64>,
    /// Orthographic view of this world height [default: perspective, except for slices]
    #[arg(help_heading = heading::CAMERA, long, value_name = "HEIGHT")]
    ortho: Option<f64>,
    /// Two eyes, as one picture of the same size
    #[arg(help_heading = heading::CAMERA, long, value_parser = STEREO_LAYOUTS, value_name = "LAYOUT")]
    stereo: Option<StereoLayout>,
    /// Moved to the scene file
    #[arg(long, hide = true, value_name = "W", allow_hyphen_values = true)]
    eye_separation: Option<String>,
    /// Moved to the scene file
    #[arg(long, hide = true, value_name = "W", allow_hyphen_values = true)]
    convergence: Option<String>,
    /// How samples become a pixel [default: dvr; average for slices]
    #[arg(help_heading = heading::LOOK, long, value_parser = MODES)]
    mode: Option<Mode>,
    /// A surface of this value, in stored units: of `--mode isosurface`, or in the fog of `--mode dvr`; of every layer; repeatable
    #[arg(help_heading = heading::LOOK, long, value_name = "VALUE[,opacity=A][,color=R:G:B]", value_parser = values::isosurface, allow_hyphen_values = true)]
    isovalue: Vec<Isosurface>,
    #[arg(help_heading = heading::LOOK, long, value_name = "FILE|PRESET", help = transfer_help())]
    transfer: Option<String>,
    /// Factor of the transfer function's opacity (0..1) by the magnitude of the field's gradient, in data units per
    /// world unit: points of a curve, as in `20:0,60:1`, which hides uniform regions and shows boundaries
    #[arg(help_heading = heading::LOOK, long, value_name = "MAGNITUDE:FACTOR,...", value_parser = values::gradient_opacity, allow_hyphen_values = true)]
    gradient_opacity: Option<GradientOpacity>,
    /// Look of layer N, counted from 0; the layers are the scene file's, or else one for each store; repeatable.
    /// KEY=VALUE is one of: transfer=FILE|PRESET; window=LOW:HIGH, the values to which a preset or function is
    /// stretched; color=R:G:B, from black to it over the window; gamma=G, the exponent of colours and opacities over
    /// the window; show-labels=LABEL,...; opacity=0..1; blend=auto|mix|add|over; matrix=FILE or its 12 or 16 numbers
    /// row by row, from the store's world to the scene's; isovalue=VALUE[,opacity=A][,color=R:G:B], an isosurface, up
    /// to eight times; crop=X0:X1,Y0:Y1,Z0:Z1 in voxels; channel=C; visible=true|false
    #[arg(help_heading = heading::LOOK, long, value_name = "N:KEY=VALUE", value_parser = volume_setting, allow_hyphen_values = true)]
    volume: Vec<VolumeSetting>,
    /// Show one value computed from several layers, through one transfer function: `max(a, b * 0.5)`, where a is the
    /// first layer
    #[arg(help_heading = heading::LOOK, long, value_name = "EXPRESSION", allow_hyphen_values = true)]
    expr: Option<String>,
    /// How to find the gradients for `--lighting` and for transfer functions by gradient [default: central]
    #[arg(help_heading = heading::LOOK, long, value_parser = GRADIENTS)]
    gradient: Option<Gradient>,
    /// Position of a light, world units; up to four times [default: one at the eye]
    #[arg(help_heading = heading::LOOK, long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    light: Vec<DVec3>,
    /// Colour behind the volume, each 0..1 [default: 0,0,0]
    #[arg(help_heading = heading::LOOK, long, value_name = "R,G,B", value_parser = values::color)]
    background: Option<[f64; 3]>,
    /// Time step N; in `render` also several, a picture each: A:B, A:B:S (B excluded) or all [default: 0]
    #[arg(help_heading = heading::PART, long, value_name = "N|A:B[:S]|all", allow_negative_numbers = true)]
    pub(crate) time: Option<StepRange>,
    #[command(flatten)]
    channels: ChannelArguments,
    /// Show only this box, world units
    #[arg(help_heading = heading::PART, long, value_name = "X0:X1,Y0:Y1,Z0:Z1", value_parser = values::corners, allow_hyphen_values = true)]
    clip: Option<[DVec3; 2]>,
    /// Clip plane (a point and a normal, world units): shows only the side its normal points to; up to six times
    #[arg(help_heading = heading::PART, long, value_name = "X,Y,Z:NX,NY,NZ", value_parser = values::plane, allow_hyphen_values = true)]
    clip_plane: Vec<ClipPlane>,
    /// Cap isosurfaces where --clip, --clip-plane or a crop opens them, in the colour of the innermost; --caps=false
    /// leaves them open [default: capped in mode isosurface, open in fog]
    #[arg(help_heading = heading::PART, long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    caps: Option<bool>,
    /// Show only this plane, seen straight on unless there is a camera: across x, y or z of the world at a coordinate;
    /// across i, j or k, the first layer's own axes, at an index of voxels, from 0; axial, coronal or sagittal of a
    /// patient, at a world coordinate; all of these also in per cent of the extent, as in `--slice z=50%`, or in the
    /// middle, as in `--slice axial=middle`; or through a point with a normal towards the viewer. The mode is average,
    /// mip or minip [default: average]
    #[arg(help_heading = heading::PART, long, value_name = "z=VALUE|k=INDEX|axial=50%|X,Y,Z:NX,NY,NZ", value_parser = slice_argument::slice, allow_hyphen_values = true)]
    slice: Option<SliceArgument>,
    /// Look at the whole scene from this side: of a patient anterior, posterior, left, right, superior or inferior;
    /// else +x, -x, +y, -y, +z or -z [default: as --eye says]
    #[arg(help_heading = heading::CAMERA, long, value_name = "SIDE", value_parser = Viewpoint::from_name, allow_hyphen_values = true, conflicts_with = "slice")]
    view: Option<Viewpoint>,
    /// Thickness of the slice, world units [default: 0, one layer of values]
    #[arg(help_heading = heading::PART, long, value_name = "WIDTH", value_parser = values::positive)]
    thickness: Option<f64>,
    /// Show the triangle mesh of a file (.stl, .ply, .obj, .gltf, .glb) in the volume's world; repeatable. A
    /// translucent one takes --mode dvr or isosurface
    #[arg(help_heading = heading::PART, long, value_name = "FILE[,color=R:G:B][,opacity=A][,unlit]", value_parser = values::mesh)]
    mesh: Vec<MeshLook>,
}

const MODES: Named<Mode> = Named(&{
    let mut modes = [("", Mode::Dvr, ""); Mode::ALL.len()];
    let mut i = 0;
    while i < modes.len() {
        modes[i] = (Mode::ALL[i].name(), Mode::ALL[i], Mode::ALL[i].meaning());
        i += 1;
    }
    modes
});

const GRADIENTS: Named<Gradient> = Named(&[
    ("central", Gradient::Central, "Differences of two samples along each axis"),
    ("sobel", Gradient::Sobel, "The 3D Sobel operator on 26 samples"),
    (
        "stored",
        Gradient::Stored,
        "Kept beside each brick, one for eight voxels: fewer samples, more memory, coarser normals",
    ),
]);

const STEREO_LAYOUTS: Named<StereoLayout> = Named(&[
    ("side-by-side", StereoLayout::SideBySide, "Left eye's picture left, right eye's right, each half as wide"),
    ("top-bottom", StereoLayout::TopBottom, "Left eye's picture above, right eye's below, each half as high"),
    ("anaglyph", StereoLayout::Anaglyph, "For red-cyan glasses"),
    ("interlaced", StereoLayout::Interlaced, "Rows by turns, the left eye's first"),
]);

impl SceneArguments {
    /// Gives a scene without a file its first look.
    pub(crate) fn set_first_look(&self, scene: &mut Scene, volumes: &[VolumeSource]) {
        if self.scene.is_none() {
            set_first_look(scene, volumes);
        }
    }

    #[cfg(feature = "viewer")]
    pub(crate) fn file(&self) -> Option<&Path> {
        self.scene.as_deref()
    }

    /// Returns the scene for pictures of this size of these volumes: the file's, overridden by the flags. Volumes
    /// without a layer in the file get one each.
    ///
    /// # Errors
    /// Exit code 3 for an unreadable or malformed file, 2 for flags that contradict each other or the scene.
    pub(crate) fn scene(&self, volumes: &[VolumeSource], size_px: (u32, u32)) -> Result<Scene, Failure> {
        let SceneFile { mut scene, lists_layers } = match &self.scene {
            Some(path) => scene_file::read(path).map_err(Failure::bad_input)?,
            None => SceneFile { scene: Scene::default(), lists_layers: false },
        };
        show_all(&mut scene, volumes.len());
        self.set_picture(&mut scene)?;
        self.channels.set_layers(&mut scene, volumes, lists_layers)?;
        self.set_layers(&mut scene, volumes)?;
        if scene.expression.is_some() && !lists_layers {
            // The operands of an expression have no look of their own.
            for layer in &mut scene.layers {
                layer.color = None;
            }
        }
        self.channels.set_looks(&mut scene, volumes)?;
        self.set_slice(&mut scene, volumes)?;
        scene.time = self.steps(&scene, volumes)?[0];
        for remark in scene_file::read_named_files(&mut scene, volumes).map_err(Failure::bad_input)? {
            say!("note: {remark}");
        }
        self.set_gradient_opacity(&mut scene, volumes)?;
        let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
        scene.camera = Some(self.camera(&scene, &places, size_px)?);
        Ok(scene)
    }

    /// Returns [`Self::scene`] for a single time step.
    ///
    /// # Errors
    /// The errors of [`Self::scene`]; and exit code 2 if the flags give several steps.
    pub(crate) fn scene_of_one_step(&self, volumes: &[VolumeSource], size_px: (u32, u32)) -> Result<Scene, Failure> {
        match &self.time {
            None | Some(StepRange::One(_)) => self.scene(volumes, size_px),
            Some(steps) => Err(Failure::usage(format!("--time {steps}: expected one time step"))),
        }
    }

    /// Returns the time steps of the pictures: the flags', else the scene's own.
    ///
    /// # Errors
    /// Exit code 2 if the scene has no such steps.
    pub(crate) fn steps(&self, scene: &Scene, volumes: &[VolumeSource]) -> Result<Vec<u32>, Failure> {
        match &self.time {
            Some(steps) => steps.steps(VolumeSource::timeline(volumes, scene).steps()),
            None => Ok(vec![scene.time]),
        }
    }

    /// Sets the properties common to all layers of a scene.
    fn set_picture(&self, scene: &mut Scene) -> Result<(), Failure> {
        scene.stereo = self.stereo(scene.stereo)?;
        if self.slice.is_some() && !scene.mode.is_projection() {
            scene.mode = Mode::Average;
        }
        scene.mode = self.mode.unwrap_or(scene.mode);
        scene.lighting.gradient = self.gradient.unwrap_or(scene.lighting.gradient);
        if !self.light.is_empty() {
            scene.lighting.lights = self.light.clone();
        }
        scene.background = self.background.unwrap_or(scene.background);
        scene.clip = self.clip.or(scene.clip);
        if !self.clip_plane.is_empty() {
            scene.clip_planes.clone_from(&self.clip_plane);
        }
        scene.caps = self.caps.or(scene.caps);
        if !self.mesh.is_empty() {
            scene.meshes.clone_from(&self.mesh);
        }
        Ok(())
    }

    /// Sets the layers, all of them and then each; and the expression over them. Beside labels, settings for all layers
    /// apply to measurements only.
    fn set_layers(&self, scene: &mut Scene, volumes: &[VolumeSource]) -> Result<(), Failure> {
        scene.expression = self.expr.clone().map(SceneExpression::from).or(scene.expression.take());
        // A projection's flag removes the file's surfaces with its mode; given ones must suit.
        let is_of_file = self.mode.is_none() && self.slice.is_none();
        let has_no_surfaces = !is_of_file && scene.mode.is_projection();
        let measured = layers_of_kind(scene, volumes, false);
        for &i in &measured {
            if has_no_surfaces || !self.isovalue.is_empty() {
                scene.layers[i].isosurfaces.clone_from(&self.isovalue);
            }
        }
        match (self.transfer.as_deref().map(transfer_choice), &mut scene.expression) {
            (Some(choice), Some(expression)) => expression.transfer = Some(choice),
            (Some(choice), None) => measured.iter().for_each(|&i| set_transfer(&mut scene.layers[i], choice.clone())),
            (None, _) => {}
        }
        // Flags replace a file's surfaces, layer by layer.
        for setting in self.volume.iter().filter(|setting| setting.key == VolumeKey::Isovalue) {
            setting.layer(scene)?.isosurfaces.clear();
        }
        self.volume.iter().try_for_each(|setting| setting.apply(scene))
    }

    fn set_slice(&self, scene: &mut Scene, volumes: &[VolumeSource]) -> Result<(), Failure> {
        if let Some(slice) = self.slice {
            scene.slice = Some(slice.resolve(scene, volumes)?);
        }
        match (&mut scene.slice, self.thickness) {
            (Some(slice), Some(thickness)) => slice.thickness = thickness,
            (None, Some(_)) => {
                return Err(Failure::usage("--thickness is for slices: add --slice, as in --slice z=12.5"));
            }
            (_, None) => {}
        }
        Ok(())
    }

    fn set_gradient_opacity(&self, scene: &mut Scene, volumes: &[VolumeSource]) -> Result<(), Failure> {
        let Some(GradientOpacity(points)) = &self.gradient_opacity else { return Ok(()) };
        if scene.expression.is_some() {
            return Err(Failure::usage("--gradient-opacity: expressions are classified by value alone"));
        }
        for i in layers_of_kind(scene, volumes, false) {
            let Some(subject) = scene_file::subject(scene, i, volumes) else { continue };
            let layer = &mut scene.layers[i];
            let function = layer.function(&subject).map_err(|error| Failure::usage(format!("layer {i}: {error}")))?;
            *layer = layer.written_out(TransferFunction { gradient_opacity: points.clone(), ..function });
        }
        Ok(())
    }

    fn stereo(&self, from_file: Option<Stereo>) -> Result<Option<Stereo>, Failure> {
        let moved = [("eye_separation", &self.eye_separation), ("convergence", &self.convergence)];
        let layout = STEREO_LAYOUTS.name(&self.stereo.unwrap_or(StereoLayout::SideBySide));
        if let Some((field, value)) = moved.into_iter().find_map(|(field, value)| Some((field, value.as_ref()?))) {
            let flag = field.replace('_', "-");
            let line = format!(r#"{{"stereo": {{"layout": "{layout}", "{field}": {value}}}}}"#);
            return Err(Failure::usage(format!("--{flag} is in the scene file now: give --scene FILE with {line}")));
        }
        let flag = self.stereo.map(|layout| Stereo { layout, ..from_file.unwrap_or(Stereo::new(layout)) });
        Ok(flag.or(from_file))
    }

    fn camera(&self, scene: &Scene, places: &[VolumePlace], size_px: (u32, u32)) -> Result<Camera, Failure> {
        let mut camera = scene.camera_for(places, size_px).map_err(Failure::usage)?;
        if let Some(view) = self.view {
            let (from, up) = slice_argument::direction(view, scene.is_anatomical(places))?;
            let world_box = scene.world_box(places).map_err(Failure::usage)?;
            camera = Camera::looking_from(from, up, world_box).fitted(world_box, size_px);
        }
        camera.eye = self.eye.unwrap_or(camera.eye);
        camera.target = self.target.unwrap_or(camera.target);
        camera.up = self.up.unwrap_or(camera.up);
        camera.projection = match (self.fov, self.ortho) {
            (Some(fov_y_deg), _) => Projection::Perspective { fov_y_deg },
            (_, Some(height)) => Projection::Orthographic { height },
            _ => camera.projection,
        };
        Ok(camera)
    }
}

/// Adds layers for the stores without one. A list without layers stays empty: it is a mistake.
fn show_all(scene: &mut Scene, stores: usize) {
    let hidden = |scene: &Scene, store: usize| (0..scene.layers.len()).all(|layer| scene.store(layer) != store);
    for store in 0..stores {
        if !scene.layers.is_empty() && hidden(scene, store) {
            scene.layers.push(SceneLayer { source: Some(store), ..SceneLayer::default() });
        }
    }
}

fn transfer_help() -> String {
    let presets = TransferFunction::PRESETS.join(", ");
    format!(
        "Transfer function: a file (JSON; ParaView's colour maps, FILE#NAME for one of several; 3D Slicer's .vp and \
         .vp.json), or one of {presets} [default: auto for fog without a scene file, else gray]"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling_args::{FILTERS, LIGHTINGS, METHODS};
    use brickyard::volume::{Filter, LightingModel, Method};

    fn all<T: Copy>(named: Named<T>) -> Vec<T> {
        named.0.iter().map(|(_, value, _)| *value).collect()
    }

    #[test]
    fn flags_name_everything_there_is() {
        assert_eq!(all(MODES), Mode::ALL);
        assert_eq!(all(METHODS), Method::ALL);
        assert_eq!(all(FILTERS), Filter::ALL);
        assert_eq!(all(LIGHTINGS), LightingModel::ALL);
        assert_eq!(all(GRADIENTS), Gradient::ALL);
        assert_eq!(all(STEREO_LAYOUTS), StereoLayout::ALL);
    }
}
