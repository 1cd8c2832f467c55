//! What several volumes are looked at by, in the tests of both renderers that draw them: a part of each of these.

use brickyard_volume::*;
use glam::DVec3;

pub(crate) fn camera(orthographic: bool, eye: [f64; 3]) -> Camera {
    let projection = match orthographic {
        true => Projection::Orthographic { height: 60.0 },
        false => Projection::Perspective { fov_y_deg: 45.0 },
    };
    Camera { eye: eye.into(), target: DVec3::new(18.0, 17.0, 16.0), up: DVec3::new(0.1, 0.2, 1.0), projection }
}

pub(crate) fn surface(value: f64, opacity: f64) -> Isosurface {
    Isosurface { value, color: Some([0.9, 0.8, 0.3]), opacity }
}

/// What of a scene is the same for all volumes.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) lighting: Lighting,
    pub(crate) has_surfaces: bool,
}

pub(crate) const PLAIN: Look = Look {
    lighting: Lighting { model: LightingModel::None, gradient: Gradient::Central, lights: Vec::new() },
    has_surfaces: false,
};

/// Unlit, lit from the eye, and by lights that stand somewhere, by gradients of every kind; without surfaces and with them.
pub(crate) fn looks() -> Vec<Look> {
    let lit = |model, gradient, lights: &[[f64; 3]]| Lighting {
        model,
        gradient,
        lights: lights.iter().map(|&light| light.into()).collect(),
    };
    let (left, above) = ([-30.0, 20.0, 10.0], [20.0, 15.0, 70.0]);
    let lightings = [
        Lighting::default(),
        lit(LightingModel::BlinnPhong, Gradient::Central, &[]),
        lit(LightingModel::Phong, Gradient::Sobel, &[left, above]),
        lit(LightingModel::Tone, Gradient::Central, &[above]),
        lit(LightingModel::BlinnPhong, Gradient::Stored, &[above]),
    ];
    let look = |has_surfaces| move |lighting: &Lighting| Look { lighting: lighting.clone(), has_surfaces };
    lightings.iter().map(look(false)).chain(lightings.iter().map(look(true))).collect()
}
