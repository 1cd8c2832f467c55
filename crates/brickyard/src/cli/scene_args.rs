//! The flags that describe a picture, but for how it is sampled, shared by every command that shows something.

use super::failure::Failure;
use super::text_file::read_text;
use super::values::{self, GradientOpacity};
use super::volume_args::{VolumeKey, VolumeSetting, volume_setting};
use brickyard::import::read_mesh;
use brickyard::pager::BrickSource;
use brickyard::session::{expression_window, subject};
use brickyard::store::Store;
use brickyard::volume::transfer::file;
use brickyard::volume::{
    Camera, ClipPlane, Expression, Extent, Gradient, Isosurface, MAX_VOLUMES, MeshLook, Mode, Placement,
    PlacementError, Projection, Scene, Slice, Stereo, StereoLayout, Subject, TransferFunction, VolumeLook,
};
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Flags that describe a picture. They override the scene file.
#[derive(Args, Clone, Debug)]
pub(crate) struct SceneArguments {
    /// Scene file (JSON); flags override it
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Where the camera stands, world units
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// What it looks at [default: the volume's centre, or the slice's]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    target: Option<DVec3>,
    /// The picture's up direction [default: 0,0,1; 0,-1,0 for slices nearer to level than to upright]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    up: Option<DVec3>,
    /// Vertical opening angle, degrees [default: 30]
    #[arg(long, value_name = "DEG", conflicts_with = "ortho")]
    fov: Option<f64>,
    /// Orthographic view of this world height
    #[arg(long, value_name = "HEIGHT")]
    ortho: Option<f64>,
    /// Two eyes, as one picture of the size asked for
    #[arg(long, value_enum, value_name = "LAYOUT")]
    stereo: Option<StereoArgument>,
    /// Distance between the eyes, world units [default: 1/30 of the convergence distance]
    #[arg(long, value_name = "W", allow_hyphen_values = true)]
    eye_separation: Option<f64>,
    /// Distance of what seems to be at the screen, world units [default: that of the target]
    #[arg(long, value_name = "W", allow_hyphen_values = true)]
    convergence: Option<f64>,
    /// How samples become a pixel
    #[arg(long, value_enum)]
    mode: Option<ModeArgument>,
    /// A surface of this value, in stored units: of `--mode isosurface`, or in the fog of `--mode dvr`; repeatable
    #[arg(long, value_name = "VALUE[,opacity=A][,color=R:G:B]", value_parser = values::isosurface, allow_hyphen_values = true)]
    isovalue: Vec<Isosurface>,
    #[arg(long, value_name = "FILE|PRESET", help = transfer_help())]
    transfer: Option<String>,
    /// What the transfer function's opacity is multiplied by (0..1) where the field's gradient has a magnitude, in data units per
    /// world unit: points of a curve, as in `20:0,60:1`, which hides what is even and shows boundaries
    #[arg(long, value_name = "MAGNITUDE:FACTOR,...", value_parser = values::gradient_opacity, allow_hyphen_values = true)]
    gradient_opacity: Option<GradientOpacity>,
    /// Of several stores, how store N looks, counted from 0; again and again. KEY=VALUE is one of: transfer=FILE|PRESET;
    /// matrix=FILE or its 12 or 16 numbers row by row, from the store's world to the scene's; blend=mix|add; opacity=0..1;
    /// isovalue=VALUE[,opacity=A][,color=R:G:B], an isosurface, up to eight times;
    /// crop=X0:X1,Y0:Y1,Z0:Z1 in the store's world; channel=C; visible=true|false
    #[arg(long, value_name = "N:KEY=VALUE", value_parser = volume_setting, allow_hyphen_values = true)]
    volume: Vec<VolumeSetting>,
    /// Show one value made of several stores', through one transfer function: `max(a, b * 0.5)`, where a is the first store
    #[arg(long, value_name = "EXPRESSION", allow_hyphen_values = true)]
    expr: Option<String>,
    /// How the gradients that `--lighting` and transfer functions by gradient need are found
    #[arg(long, value_enum)]
    gradient: Option<GradientArgument>,
    /// Where a light stands, world units; up to four times [default: one at the eye]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    light: Vec<DVec3>,
    /// Colour behind the volume, each 0..1 [default: 0,0,0]
    #[arg(long, value_name = "R,G,B", value_parser = values::color)]
    background: Option<[f64; 3]>,
    /// Time step
    #[arg(long)]
    time: Option<u32>,
    /// Channel
    #[arg(long)]
    channel: Option<u32>,
    /// Show only this box, world units
    #[arg(long, value_name = "X0:X1,Y0:Y1,Z0:Z1", value_parser = values::world_box, allow_hyphen_values = true)]
    clip: Option<[DVec3; 2]>,
    /// Show only what is on the side of this plane that its normal points to (a point and the normal, world units); up to six times
    #[arg(long, value_name = "X,Y,Z:NX,NY,NZ", value_parser = values::plane, allow_hyphen_values = true)]
    clip_plane: Vec<ClipPlane>,
    /// Show only this plane, seen straight on unless there is a camera: across an axis at a world coordinate, or through a point
    /// with a normal that points to the viewer; the mode is average, mip or minip [default: average]
    #[arg(long, value_name = "x=VALUE|X,Y,Z:NX,NY,NZ", value_parser = values::slice, allow_hyphen_values = true)]
    slice: Option<Slice>,
    /// How much of the volume about the slice goes into it, world units [default: 0, one layer of values]
    #[arg(long, value_name = "WIDTH", value_parser = values::positive)]
    thickness: Option<f64>,
    /// Show the triangle mesh of a file (.stl, .ply, .obj, .gltf, .glb) in the volume's world; may be given several times. A translucent
    /// one takes --mode dvr or isosurface
    #[arg(long, value_name = "FILE[,color=R:G:B][,opacity=A][,unlit]", value_parser = values::mesh)]
    mesh: Vec<MeshLook>,
}

/// [`Mode`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeArgument {
    /// Direct volume rendering
    Dvr,
    /// Maximum intensity projection
    Mip,
    /// Minimum intensity projection
    Minip,
    /// Mean along the ray
    Average,
    /// The surface of one value, opaque, lit from the eye
    Isosurface,
}

impl From<ModeArgument> for Mode {
    fn from(mode: ModeArgument) -> Self {
        match mode {
            ModeArgument::Dvr => Self::Dvr,
            ModeArgument::Mip => Self::Mip,
            ModeArgument::Minip => Self::MinIp,
            ModeArgument::Average => Self::Average,
            ModeArgument::Isosurface => Self::Isosurface,
        }
    }
}

/// [`Gradient`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum GradientArgument {
    /// Differences of two samples along each axis
    Central,
    /// The 3D Sobel operator on 26 samples
    Sobel,
    /// Kept beside each brick, one for eight voxels: fewer samples, more memory, coarser normals
    Stored,
}

impl From<GradientArgument> for Gradient {
    fn from(gradient: GradientArgument) -> Self {
        match gradient {
            GradientArgument::Central => Self::Central,
            GradientArgument::Sobel => Self::Sobel,
            GradientArgument::Stored => Self::Stored,
        }
    }
}

/// [`StereoLayout`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum StereoArgument {
    /// Left eye's picture left, right eye's right, each half as wide
    SideBySide,
    /// Left eye's picture above, right eye's below, each half as high
    TopBottom,
    /// For red-cyan glasses
    Anaglyph,
    /// Rows by turns, the left eye's first
    Interlaced,
}

impl From<StereoArgument> for StereoLayout {
    fn from(layout: StereoArgument) -> Self {
        match layout {
            StereoArgument::SideBySide => Self::SideBySide,
            StereoArgument::TopBottom => Self::TopBottom,
            StereoArgument::Anaglyph => Self::Anaglyph,
            StereoArgument::Interlaced => Self::Interlaced,
        }
    }
}

impl SceneArguments {
    /// The scene: the file's, overridden by the flags, for pictures of this size of this store's volume.
    ///
    /// # Errors
    /// Exit code 3 for an unreadable or malformed file, 2 for an unknown preset or channel, eyes without stereo or a thickness without a
    /// slice.
    pub(crate) fn scene(&self, store: &Store, size_px: (u32, u32)) -> Result<Scene, Failure> {
        let mut scene = self.without_stores()?;
        if !(self.volume.is_empty() && scene.volumes.is_empty() && scene.expression.is_none()) {
            return Err(Failure::usage("--volume, --expr, and volumes of a scene file, are for `brickyard render`"));
        }
        check_channel(scene.channel, store)?;
        let subject = subject_of(store, scene.channel);
        if let Some(name) = &self.transfer {
            scene.transfer = Some(transfer(name, &subject)?);
        }
        if let Some(GradientOpacity(points)) = &self.gradient_opacity {
            let of_values = scene.transfer.map_or_else(|| default_transfer(&subject), Ok)?;
            scene.transfer = Some(TransferFunction { gradient_opacity: points.clone(), ..of_values });
        }
        scene.camera = Some(self.camera(&scene, store.geometry().world_box(extent(store)), size_px));
        Ok(scene)
    }

    /// The scene of one store or several.
    ///
    /// # Errors
    /// As [`SceneArguments::scene`]; and for more volumes than stores, or a volume that cannot look so.
    pub(crate) fn scene_of(&self, stores: &[Store], size_px: (u32, u32)) -> Result<Scene, Failure> {
        match stores {
            [store] if !self.is_of_several()? => self.scene(store, size_px),
            _ => self.scene_of_several(stores, size_px),
        }
    }

    /// Whether it says how stores look beside each other.
    fn is_of_several(&self) -> Result<bool, Failure> {
        let file = self.scene.as_deref().map(scene_file).transpose()?;
        let says_file = file.is_some_and(|scene| !scene.volumes.is_empty() || scene.expression.is_some());
        Ok(!self.volume.is_empty() || self.expr.is_some() || says_file)
    }

    /// The scene of several stores, or of one that is placed among none.
    fn scene_of_several(&self, stores: &[Store], size_px: (u32, u32)) -> Result<Scene, Failure> {
        let mut scene = self.without_stores()?;
        if stores.len() > MAX_VOLUMES {
            let problem = format!("{} volumes in one picture: expected at most {MAX_VOLUMES}", stores.len());
            return Err(Failure::usage(problem));
        }
        if scene.volumes.len() > stores.len() {
            let (named, count) = (scene.volumes.len(), stores.len());
            return Err(Failure::usage(format!(
                "the scene says how {named} volumes look, and there are {count} stores"
            )));
        }
        scene.volumes.resize(stores.len(), VolumeLook::default());
        // Flags take a file's surfaces away, volume by volume.
        for setting in self.volume.iter().filter(|setting| setting.key == VolumeKey::Isovalue) {
            if let Some(look) = scene.volumes.get_mut(setting.volume) {
                look.isosurfaces.clear();
            }
        }
        let mut transfers = vec![None; stores.len()];
        for VolumeSetting { volume, key, value } in &self.volume {
            let count = stores.len();
            let missing =
                || Failure::usage(format!("--volume {volume}:...: there are {count} stores, numbered from 0"));
            let look = scene.volumes.get_mut(*volume).ok_or_else(missing)?;
            match key {
                VolumeKey::Transfer => transfers[*volume] = Some(value),
                VolumeKey::Matrix => look.world_from_volume = placement(*volume, value)?,
                key => key.set(look, value).map_err(|error| Failure::usage(format!("--volume {volume}: {error}")))?,
            }
        }
        for (i, (look, store)) in scene.volumes.iter_mut().zip(stores).enumerate() {
            let channel = look.channel.unwrap_or(scene.channel);
            check_channel(channel, store)?;
            // A name that is for all stores means another function for each: that of its own values.
            let is_of_each = look.transfer.is_none() && scene.expression.is_none();
            let of_all = self.transfer.as_ref().filter(|_| is_of_each);
            if let Some(name) = transfers[i].or(of_all) {
                look.transfer = Some(transfer(name, &subject_of(store, channel))?);
            }
            if let Some(GradientOpacity(points)) = self.gradient_opacity.as_ref().filter(|_| scene.expression.is_none())
            {
                let of_values = look.transfer.take().or_else(|| scene.transfer.clone());
                let of_values = of_values.map_or_else(|| default_transfer(&subject_of(store, channel)), Ok)?;
                look.transfer = Some(TransferFunction { gradient_opacity: points.clone(), ..of_values });
            }
        }
        if self.gradient_opacity.is_some() && scene.expression.is_some() {
            return Err(Failure::usage("--gradient-opacity: an expression is classified by its value alone"));
        }
        if let (Some(text), Some(name)) = (&scene.expression, &self.transfer) {
            let expression = Expression::parse(text, stores.len());
            let expression = expression.map_err(|error| Failure::usage(format!("--expr: {error}")))?;
            let window =
                |(store, look): (&Store, &VolumeLook)| store.default_window(look.channel.unwrap_or(scene.channel));
            let windows = stores.iter().zip(&scene.volumes).map(window);
            let window = expression_window(&expression, windows);
            let first = &stores[expression.volumes().first().copied().unwrap_or(0)];
            let subject = subject(first.geometry(), extent(first), window);
            scene.transfer = Some(transfer(name, &subject)?);
        }
        let boxes = stores.iter().zip(&scene.volumes).map(|(store, look)| {
            let (low, high) = look.world_from_volume.world_box(store.geometry().world_box(extent(store)));
            [low, high]
        });
        let all = boxes.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)]);
        let [low, high] = all.ok_or_else(|| Failure::usage("no store"))?;
        scene.camera = Some(self.camera(&scene, (low, high), size_px));
        Ok(scene)
    }

    /// All of it that is the same for any store.
    fn without_stores(&self) -> Result<Scene, Failure> {
        let mut scene = match &self.scene {
            Some(path) => scene_file(path)?,
            None => Scene::default(),
        };
        scene.channel = self.channel.unwrap_or(scene.channel);
        scene.expression = self.expr.clone().or(scene.expression);
        scene.stereo = self.stereo(scene.stereo)?;
        if self.slice.is_some() && matches!(scene.mode, Mode::Dvr | Mode::Isosurface) {
            scene.mode = Mode::Average;
        }
        scene.mode = self.mode.map_or(scene.mode, Mode::from);
        scene.lighting.gradient = self.gradient.map_or(scene.lighting.gradient, Gradient::from);
        if !self.light.is_empty() {
            scene.lighting.lights = self.light.clone();
        }
        // A projection's flag takes the file's surfaces away with its mode; those that are given must suit.
        let is_of_file = self.mode.is_none() && self.slice.is_none();
        if !self.isovalue.is_empty() {
            scene.isosurfaces.clone_from(&self.isovalue);
        } else if !is_of_file && !matches!(scene.mode, Mode::Dvr | Mode::Isosurface) {
            scene.isosurfaces.clear();
        }
        scene.background = self.background.unwrap_or(scene.background);
        scene.time = self.time.unwrap_or(scene.time);
        scene.clip = self.clip.or(scene.clip);
        if !self.clip_plane.is_empty() {
            scene.clip_planes.clone_from(&self.clip_plane);
        }
        scene.slice = self.slice.or(scene.slice);
        match (&mut scene.slice, self.thickness) {
            (Some(slice), Some(thickness)) => slice.thickness = thickness,
            (None, Some(_)) => {
                return Err(Failure::usage("--thickness is a slice's: add --slice, as in --slice z=12.5"));
            }
            (_, None) => {}
        }
        if !self.mesh.is_empty() {
            scene.meshes.clone_from(&self.mesh);
        }
        for look in &mut scene.meshes {
            look.mesh = Some(Arc::new(read_mesh(&look.path).map_err(Failure::bad_input)?));
        }
        Ok(scene)
    }

    fn stereo(&self, from_file: Option<Stereo>) -> Result<Option<Stereo>, Failure> {
        let mut stereo = from_file;
        if let Some(layout) = self.stereo.map(StereoLayout::from) {
            stereo = Some(Stereo { layout, ..stereo.unwrap_or(Stereo::new(layout)) });
        }
        if let Some(stereo) = &mut stereo {
            stereo.eye_separation = self.eye_separation.or(stereo.eye_separation);
            stereo.convergence = self.convergence.or(stereo.convergence);
        } else if self.eye_separation.is_some() || self.convergence.is_some() {
            let problem = "--eye-separation and --convergence are about two eyes: give --stereo, too";
            return Err(Failure::usage(problem));
        }
        Ok(stereo)
    }

    fn camera(&self, scene: &Scene, world_box: (DVec3, DVec3), size_px: (u32, u32)) -> Camera {
        let mut camera = scene.camera_for(world_box, size_px);
        camera.eye = self.eye.unwrap_or(camera.eye);
        camera.target = self.target.unwrap_or(camera.target);
        camera.up = self.up.unwrap_or(camera.up);
        camera.projection = match (self.fov, self.ortho) {
            (Some(fov_y_deg), _) => Projection::Perspective { fov_y_deg },
            (_, Some(height)) => Projection::Orthographic { height },
            _ => camera.projection,
        };
        camera
    }
}

fn check_channel(channel: u32, store: &Store) -> Result<(), Failure> {
    let count = store.channels();
    let problem = || format!("channel {channel} does not exist: the store has {count}, numbered from 0");
    if channel < count { Ok(()) } else { Err(Failure::usage(problem())) }
}

/// The placement in a file, or in the words themselves.
fn placement(volume: usize, value: &str) -> Result<Placement, Failure> {
    let path = Path::new(value);
    let text = if path.is_file() { read_text(path)? } else { value.to_string() };
    let what = if path.is_file() { path.display().to_string() } else { format!("--volume {volume}:matrix={value}") };
    Placement::from_text(&text).map_err(|error| match error {
        PlacementError::Word(_) if !path.is_file() => {
            Failure::bad_input(format!("{what}: neither a file nor the 12 or 16 numbers of a matrix, row by row"))
        }
        error => Failure::bad_input(format!("{what}: {error}")),
    })
}

fn extent(store: &Store) -> Extent {
    BrickSource::pyramid(store).levels()[0].extent
}

fn transfer_help() -> String {
    let presets = TransferFunction::PRESETS.join(", ");
    format!(
        "Transfer function: a file (JSON; ParaView's colour maps, FILE#NAME for one of several; 3D Slicer's .vp and \
         .vp.json), or one of {presets}"
    )
}

/// What a store's channel is to a transfer function.
fn subject_of(store: &Store, channel: u32) -> Subject {
    subject(store.geometry(), extent(store), store.default_window(channel))
}

/// That of a scene that says none.
fn default_transfer(subject: &Subject) -> Result<TransferFunction, Failure> {
    TransferFunction::preset("gray", subject.window, subject.unit_distance).map_err(Failure::failed)
}

fn transfer(argument: &str, subject: &Subject) -> Result<TransferFunction, Failure> {
    let Some((path, name)) = file_and_name(argument) else {
        return TransferFunction::preset(argument, subject.window, subject.unit_distance).map_err(Failure::usage);
    };
    let imported = file::read(&read_text(path)?, name, subject)
        .map_err(|error| Failure::bad_input(format!("{}: {error}", path.display())))?;
    for remark in imported.remarks {
        eprintln!("note: {}: {remark}", path.display());
    }
    Ok(imported.transfer)
}

/// `FILE` or `FILE#NAME`, if there is such a file.
fn file_and_name(argument: &str) -> Option<(&Path, Option<&str>)> {
    let whole = (Path::new(argument), None);
    let parts = argument.match_indices('#').map(|(i, _)| (Path::new(&argument[..i]), Some(&argument[i + 1..])));
    std::iter::once(whole).chain(parts).find(|(path, _)| path.is_file())
}

/// The scene in a file; meshes are named as seen from its folder.
fn scene_file(path: &Path) -> Result<Scene, Failure> {
    let mut scene: Scene = serde_json::from_str(&read_text(path)?)
        .map_err(|error| Failure::bad_input(format!("{}: not a scene: {error}", path.display())))?;
    for look in &mut scene.meshes {
        look.path = path.with_file_name(&look.path);
    }
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::sampling_args::{FilterArgument, LightingArgument, MethodArgument};
    use brickyard::volume::{Filter, LightingModel, Method};

    fn all<A: ValueEnum + Copy, T: From<A>>() -> Vec<T> {
        A::value_variants().iter().map(|&argument| argument.into()).collect()
    }

    #[test]
    fn flags_name_everything_there_is() {
        assert_eq!(all::<ModeArgument, Mode>(), Mode::ALL);
        assert_eq!(all::<MethodArgument, Method>(), Method::ALL);
        assert_eq!(all::<FilterArgument, Filter>(), Filter::ALL);
        assert_eq!(all::<LightingArgument, LightingModel>(), LightingModel::ALL);
        assert_eq!(all::<GradientArgument, Gradient>(), Gradient::ALL);
        assert_eq!(all::<StereoArgument, StereoLayout>(), StereoLayout::ALL);
    }
}
