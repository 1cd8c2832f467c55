//! Lighting: the shading of colours, with the field's gradient as the normal.
//!
//! Both sides of a surface are lit: a normal is turned to the eye. Colours are lit as written, without gamma.

use crate::enum_all::every;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Lighting models.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightingModel {
    /// No lighting: plain colours.
    #[default]
    None,
    /// Phong's model: the reflection falls with the angle between the mirrored light and the eye.
    Phong,
    /// Blinn's model: the reflection falls with the angle between the normal and the half-way vector of light and eye.
    BlinnPhong,
    /// Tone shading: from warm where a place faces the light to cool where it is turned away (Gooch et al., A Non-Photorealistic Lighting Model for
    /// Automatic Technical Illustration, 1998).
    Tone,
}

every!(LightingModel: None Phong BlinnPhong Tone);

/// Methods to find the field's gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Gradient {
    /// Central differences of the filtered field, a voxel to each side: 6 samples.
    #[default]
    Central,
    /// The 3D Sobel operator on the filtered field's 26 neighbours: central differences, smoothed across.
    Sobel,
    /// Stored gradients, one for every eight voxels, interpolated with any filter: see [`gradients`](crate::gradients).
    Stored,
}

every!(Gradient: Central Sobel Stored);

impl Gradient {
    /// Radius of the samples for a place's gradient, in voxels; `None` for stored gradients, without samples of the field.
    pub const fn reach(self) -> Option<f64> {
        match self {
            Self::Central | Self::Sobel => Some(1.0),
            Self::Stored => None,
        }
    }
}

/// Weights of the Sobel operator's smoothing of differences across their axis; they add up to 1.
pub const SMOOTH: [f64; 3] = [0.25, 0.5, 0.25];

/// Ambient light: the share of its colour shown by a place in any direction. VTK's default.
pub const AMBIENT: f64 = 0.1;

/// Diffuse reflection: the share of its colour shown by a place facing a light. VTK's default.
pub const DIFFUSE: f64 = 0.7;

/// Specular reflection: the share of white shown by a place mirroring a light to the eye. VTK's default.
pub const SPECULAR: f64 = 0.2;

/// The power of the cosine in specular reflection: the speed of its fall as the mirrored light turns away from the eye. VTK's default.
pub const SPECULAR_POWER: i32 = 10;

/// The most lights of a scene.
pub const MAX_LIGHTS: usize = 4;

/// Tone shading: added to a colour where it is coolest.
pub const COOL: [f64; 3] = [0.0, 0.0, 0.4];
/// Tone shading: added to a colour where it is warmest.
pub const WARM: [f64; 3] = [0.3, 0.3, 0.0];
/// Tone shading: kept shares of a colour where it is coolest and where it is warmest.
pub const TONE_KEPT: [f64; 2] = [0.3, 0.7];

/// The lighting of a picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lighting {
    /// The lighting model.
    pub model: LightingModel,
    /// The method to find the field's gradient.
    pub gradient: Gradient,
    /// World positions of the lights; an empty list is one light at the eye.
    pub lights: Vec<DVec3>,
}

/// Cosine between a gradient and a ray up to which the gradient is sideways and not turned, as rounding would decide which side faces the eye.
pub const SIDEWAYS: f64 = 1e-4;

impl Lighting {
    /// Lights a colour at a place of the world. `normal` is a unit vector along the gradient, either way, or `None` in a flat field: a flat place
    /// shows its colour as if facing a light at the eye, without reflection. `view` is the ray's unit direction there.
    pub fn shade(&self, color: DVec3, normal: Option<DVec3>, view: DVec3, place: DVec3) -> DVec3 {
        let Some(normal) = normal else {
            return match self.model {
                LightingModel::None => color,
                LightingModel::Phong | LightingModel::BlinnPhong => color * (AMBIENT + DIFFUSE),
                LightingModel::Tone => tone(color, 1.0),
            };
        };
        let normal = if normal.dot(view) > SIDEWAYS { -normal } else { normal };
        let to_lights = self.lights.iter().map(|&light| (light - place).normalize_or(-view));
        let (mut diffuse, mut specular, mut facing) = (0.0, 0.0, -1.0f64);
        for to_light in to_lights.chain(self.lights.is_empty().then_some(-view)) {
            let cosine = normal.dot(to_light);
            facing = facing.max(cosine);
            if cosine > 0.0 {
                diffuse += cosine;
                specular += self.reflection(normal, to_light, view, cosine).max(0.0).powi(SPECULAR_POWER);
            }
        }
        match self.model {
            LightingModel::None => color,
            LightingModel::Phong | LightingModel::BlinnPhong => {
                color * (AMBIENT + DIFFUSE * diffuse) + DVec3::splat(SPECULAR * specular)
            }
            LightingModel::Tone => tone(color, facing),
        }
    }

    /// The cosine in the specular term.
    fn reflection(&self, normal: DVec3, to_light: DVec3, view: DVec3, cosine: f64) -> f64 {
        match self.model {
            LightingModel::Phong => (normal * (2.0 * cosine) - to_light).dot(-view),
            _ => normal.dot((to_light - view).normalize_or(normal)),
        }
    }
}

/// Cool to warm with the cosine from -1 to 1.
fn tone(color: DVec3, cosine: f64) -> DVec3 {
    let warmth = 0.5 * (1.0 + cosine);
    let [cool, warm] = [COOL, WARM].map(DVec3::from_array);
    (cool + color * TONE_KEPT[0]).lerp(warm + color * TONE_KEPT[1], warmth)
}

/// Light from the eye on a surface: the shares of its own colour and of white. `cosine` is the cosine of the angle between its normal and the ray,
/// of either sign; with `None`, in a flat field, the surface shows its colour as if facing the eye.
pub fn headlight(cosine: Option<f64>) -> (f64, f64) {
    match cosine.map(f64::abs) {
        // The light is at the eye, so the half-way vector of Blinn and Phong is the ray itself.
        Some(cosine) => (AMBIENT + DIFFUSE * cosine, SPECULAR * cosine.powi(SPECULAR_POWER)),
        None => (AMBIENT + DIFFUSE, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lit(model: LightingModel, lights: &[DVec3]) -> Lighting {
        Lighting { model, lights: lights.to_vec(), ..Lighting::default() }
    }

    #[test]
    fn a_headlight_lights_both_sides_by_the_cosine() {
        let (color, view) = (DVec3::new(0.5, 0.25, 1.0), DVec3::Z);
        let normal = DVec3::new(0.0, 0.6, 0.8);
        let blinn = lit(LightingModel::BlinnPhong, &[]);
        let expected = color * (0.1 + 0.7 * 0.8) + DVec3::splat(0.2 * 0.8f64.powi(10));
        for normal in [normal, -normal] {
            assert!((blinn.shade(color, Some(normal), view, DVec3::ZERO) - expected).length() < 1e-12);
        }
        // Phong's mirrored light is turned by twice the angle: cos 2a = 2 * 0.64 - 1.
        let expected = color * (0.1 + 0.7 * 0.8) + DVec3::splat(0.2 * 0.28f64.powi(10));
        let phong = lit(LightingModel::Phong, &[]);
        assert!((phong.shade(color, Some(normal), view, DVec3::ZERO) - expected).length() < 1e-12);
        assert_eq!(lit(LightingModel::None, &[]).shade(color, Some(normal), view, DVec3::ZERO), color);
    }

    #[test]
    fn placed_lights_add_up_and_leave_what_is_turned_away() {
        let (color, view, normal) = (DVec3::ONE, DVec3::Z, DVec3::NEG_Z);
        let place = DVec3::new(1.0, 2.0, 3.0);
        let behind = lit(LightingModel::Phong, &[place + DVec3::Z]);
        assert!((behind.shade(color, Some(normal), view, place) - DVec3::splat(0.1)).length() < 1e-12);
        // Both from 60 degrees: the mirrored light is as far from the eye.
        let aside = DVec3::new(0.75f64.sqrt(), 0.0, -0.5);
        let two = lit(LightingModel::Phong, &[place + aside, place + aside * 7.0]);
        let expected = 0.1 + 0.7 * (0.5 + 0.5) + 0.2 * 2.0 * 0.5f64.powi(10);
        assert!((two.shade(color, Some(normal), view, place) - DVec3::splat(expected)).length() < 1e-12);
    }

    #[test]
    fn tone_goes_from_warm_to_cool() {
        let (color, view, place) = (DVec3::splat(0.5), DVec3::Z, DVec3::ZERO);
        let toned = |light: DVec3| lit(LightingModel::Tone, &[light]).shade(color, Some(DVec3::NEG_Z), view, place);
        let (warm, cool) = (toned(DVec3::NEG_Z), toned(DVec3::Z));
        assert!((warm - DVec3::new(0.65, 0.65, 0.35)).length() < 1e-12);
        assert!((cool - DVec3::new(0.15, 0.15, 0.55)).length() < 1e-12);
    }

    #[test]
    fn both_sides_of_a_surface_are_lit() {
        assert_eq!(headlight(Some(1.0)), headlight(Some(-1.0)));
        let (own, white) = headlight(Some(0.5));
        assert!((own - 0.45).abs() < 1e-12 && (white - 0.2 / 1024.0).abs() < 1e-12);
        assert_eq!(headlight(None).1, 0.0);
    }
}
