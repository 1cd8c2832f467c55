//! The checks of scenes: the one place where a scene is refused.

use crate::session_error::SessionError;
use crate::volume_source::VolumeSource;
use brickyard_pager::BrickSource;
use brickyard_volume::lighting::MAX_LIGHTS;
use brickyard_volume::sampling::MOST_VIRTUAL_SAMPLES;
use brickyard_volume::surface::MAX_SURFACES;
use brickyard_volume::{
    Isosurface, Jitter, LevelPolicy, Lighting, LightingModel, MAX_VOLUMES, Method, Mode, Scene, TransferFunction,
};

/// Whether a scene and these volumes belong together.
pub(crate) fn check_volumes(volumes: &[VolumeSource], scene: &Scene) -> Result<(), SessionError> {
    let most_levels = volumes.iter().map(|volume| volume.source.pyramid().levels().len()).max().unwrap_or(0);
    let bad_opacity = scene.volumes.iter().position(|look| !(0.0..=1.0).contains(&look.opacity));
    let problem = if volumes.is_empty() || volumes.len() > MAX_VOLUMES {
        format!("{} volumes in one picture: expected 1 to {MAX_VOLUMES}", volumes.len())
    } else if scene.volumes.len() > volumes.len() {
        format!("the scene says how {} volumes look, and there are {} stores", scene.volumes.len(), volumes.len())
    } else if let Some(i) = bad_opacity {
        format!("volume {i}: the opacity is {}: expected 0 to 1", scene.volumes[i].opacity)
    } else if volumes.len() > 1 && !scene.isosurfaces.is_empty() {
        "an isosurface is of one of several volumes: say which, as in --volume 0:isovalue=300".into()
    } else if let LevelPolicy::Locked(level) = scene.level
        && volumes.len() > 1
        && level as usize >= most_levels
    {
        format!("level {level} does not exist: the stores have up to {most_levels}, numbered from 0")
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}

/// Whether an expression can be shown so: its value is one number in each place, of no gradient.
pub(crate) fn check_expression(scene: &Scene) -> Result<(), SessionError> {
    let transfer = scene.transfer.as_ref();
    let problem = if scene.mode != Mode::Dvr {
        format!("an expression is shown with --mode dvr, not {:?}: leave it out", scene.mode)
    } else if scene.sampling.method != Method::Udvr {
        format!("an expression is sampled with --method udvr, not {:?}: leave it out", scene.sampling.method)
    } else if scene.lighting.model != LightingModel::None {
        let problem = "the gradient of an expression's value is no volume's: it is not lit, and the scene asks for";
        format!("{problem} {:?}: leave one of both out", scene.lighting.model)
    } else if scene.sampling.jitter != Jitter::None {
        "an expression is not jittered: leave --jitter out".into()
    } else if transfer.is_some_and(TransferFunction::is_by_gradient) {
        let problem = "the transfer function is one of value and gradient, and an expression is classified by value";
        format!("{problem} alone: leave its gradient_opacity and regions out")
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}

/// Whether a volume can be shown by the scene that it would have alone, where others have surfaces or not.
pub(crate) fn check_layer(
    source: &dyn BrickSource,
    scene: &Scene,
    others_have_surfaces: bool,
) -> Result<(), SessionError> {
    let past = |what: &str, asked: u64, count: u64| {
        let problem = format!("{what} {asked} does not exist: the store has {count}, numbered from 0");
        if asked < count { Ok(()) } else { Err(SessionError::Scene(problem)) }
    };
    if let LevelPolicy::Locked(level) = scene.level {
        past("level", level as u64, source.pyramid().levels().len() as u64)?;
    }
    past("time step", scene.time as u64, source.times() as u64)?;
    past("channel", scene.channel as u64, source.channels() as u64)?;
    for (name, value) in [("step", scene.step), ("pixel error", scene.pixel_error)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(SessionError::Scene(format!("the {name} is {value}: expected a positive number")));
        }
    }
    check_look(scene)?;
    check_surfaces(scene, others_have_surfaces)?;
    scene.check_slice().map_err(|error| SessionError::Scene(error.to_string()))?;
    if let Some(transfer) = &scene.transfer {
        transfer.validate().map_err(|error| SessionError::Scene(format!("transfer function: {error}")))?;
    }
    Ok(())
}

fn check_surfaces(scene: &Scene, others_have_some: bool) -> Result<(), SessionError> {
    let surfaces = &scene.isosurfaces;
    let has_two_of = |surface: &Isosurface| surfaces.iter().filter(|other| other.value == surface.value).count() > 1;
    let problem = if scene.mode == Mode::Isosurface && surfaces.is_empty() && !others_have_some {
        "an isosurface needs the value whose surface it is: give --isovalue, in stored units".to_string()
    } else if surfaces.is_empty() {
        return Ok(());
    } else if !matches!(scene.mode, Mode::Dvr | Mode::Isosurface) {
        let value = surfaces[0].value;
        format!("the isovalue {value} is for --mode isosurface, or dvr: leave it out, or use one of those")
    } else if surfaces.len() > MAX_SURFACES {
        format!("{} isosurfaces: expected at most {MAX_SURFACES}", surfaces.len())
    } else if let Some(surface) = surfaces.iter().find(|surface| !surface.value.is_finite()) {
        format!("the isovalue is {}: expected a finite number", surface.value)
    } else if let Some(surface) = surfaces.iter().find(|surface| !(0.0..=1.0).contains(&surface.opacity)) {
        let Isosurface { value, opacity, .. } = surface;
        format!("the isosurface at {value} has an opacity of {opacity}: expected a number from 0 to 1")
    } else if let Some(surface) = surfaces.iter().find(|surface| has_two_of(surface)) {
        format!("two isosurfaces have the value {}: leave one out", surface.value)
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}

/// Checks method and lighting.
fn check_look(scene: &Scene) -> Result<(), SessionError> {
    let Lighting { model, lights, .. } = &scene.lighting;
    let is_dvr = scene.mode == Mode::Dvr;
    let problem = if scene.sampling.method != Method::Udvr && !is_dvr {
        format!(
            "the sampling method {:?} is for direct volume rendering: leave it out, or use --mode dvr",
            scene.sampling.method
        )
    } else if *model != LightingModel::None && !is_dvr && scene.mode != Mode::Isosurface {
        format!(
            "the lighting {model:?} is for direct volume rendering and isosurfaces: leave it out, or use --mode dvr"
        )
    } else if !(1..=MOST_VIRTUAL_SAMPLES).contains(&scene.sampling.virtual_samples) {
        format!("{} virtual samples: expected 1 to {MOST_VIRTUAL_SAMPLES}", scene.sampling.virtual_samples)
    } else if is_dvr && !scene.takes(scene.sampling.method) {
        format!(
            "the sampling method {:?} integrates over values, and the transfer function is one of value and gradient: use --method \
             udvr, lvs, cvs or asm",
            scene.sampling.method
        )
    } else if lights.len() > MAX_LIGHTS {
        format!("{} lights: expected at most {MAX_LIGHTS}", lights.len())
    } else if let Some(light) = lights.iter().find(|light| !light.is_finite()) {
        format!("a light stands at {light}: expected finite numbers")
    } else if *model == LightingModel::None && !lights.is_empty() && scene.isosurfaces.is_empty() {
        "a light without lighting: leave it out, or add --lighting blinn-phong".to_string()
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}
