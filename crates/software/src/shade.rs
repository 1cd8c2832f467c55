//! The lighting of colours at eight places along a ray: the vector twin of [`brickyard_volume::Lighting::shade`].
//!
//! In every model, lighting is linear in the colour: a factor, and amounts of two tints. So premultiplied colours can
//! be lit like straight ones, and a table of whole steps serves lit pictures, too.

use crate::packet::{LANES, Packet};
use brickyard_volume::lighting::{AMBIENT, COOL, DIFFUSE, SIDEWAYS, SPECULAR, TONE_KEPT, WARM};
use brickyard_volume::surface::FLAT_SHARE;
use brickyard_volume::{CutFace, Lighting, LightingModel};
use glam::{DVec3, Mat3, Vec3, Vec4};

/// Lighting of a layer's places along one ray.
pub(crate) struct Shade<'a> {
    lighting: &'a Lighting,
    /// Maps differences of codes across two voxels to the scene's gradient, of any length.
    world_from_differences: Mat3,
    /// The difference of codes below which the field is flat.
    flat_codes: f32,
    /// The ray in the scene's world.
    eye: DVec3,
    view: Vec3,
    /// The tints measured by `added`.
    tints: [Vec4; 2],
    cut: Option<Cut>,
}

/// The cut through which a ray enters the shown part: see [`CutFace`].
struct Cut {
    entry: f32,
    /// Voxels below the cut, per unit of distance behind the entry.
    voxels_per_distance: f32,
    normal: Vec3,
}

/// The lighting of colours at eight places: a colour becomes `color * kept + added[0] * tints[0] + added[1] *
/// tints[1]`.
pub(crate) struct Shaded {
    kept: Packet,
    added: [Packet; 2],
}

impl Shaded {
    pub(crate) const EMPTY: Self = Self { kept: [0.0; LANES], added: [[0.0; LANES]; 2] };
}

/// The squared differences at the packet's place `i` less the least square that is not flat there, in codes: negative
/// where they are flat, or mere rounding ([`FLAT_SHARE`]).
#[inline(always)]
fn slope_of(differences: &[Packet; 3], code: &Packet, flat_codes: f32, i: usize) -> f32 {
    let [x, y, z] = [differences[0][i], differences[1][i], differences[2][i]];
    let least = FLAT_SHARE as f32 * code[i];
    let (of_rounding, of_codes) = (least * least, flat_codes * flat_codes);
    x * x + y * y + z * z - if of_rounding > of_codes { of_rounding } else { of_codes }
}

impl<'a> Shade<'a> {
    /// Prepares the lighting of places along a ray from `eye` with the unit direction `view`, given the scene's
    /// gradient of differences of codes and the least difference that is not flat; behind a cut and its [voxels by
    /// distance](CutFace::voxels_per_distance).
    #[inline(always)]
    pub(crate) fn new(
        lighting: &'a Lighting,
        world_from_differences: Mat3,
        flat_codes: f32,
        eye: DVec3,
        view: DVec3,
        cut: Option<(CutFace, f64)>,
    ) -> Self {
        let cut = cut.map(|(CutFace { entry, normal, .. }, rate)| Cut {
            entry: entry as f32,
            voxels_per_distance: rate as f32,
            normal: normal.as_vec3(),
        });
        let tint = |color: [f64; 3]| DVec3::from_array(color).as_vec3().extend(0.0);
        let tints = match lighting.model {
            LightingModel::Tone => [tint(COOL), tint(WARM)],
            _ => [tint([SPECULAR; 3]), Vec4::ZERO],
        };
        Self { lighting, world_from_differences, flat_codes, eye, view: view.as_vec3(), tints, cut }
    }

    /// Lights a colour at the packet's place `i`. The last component of the colour, and of the result, is unused. A
    /// colour that is `share` of a straight one becomes the same share of the lit one.
    #[inline(always)]
    pub(crate) fn lit(&self, shaded: &Shaded, i: usize, color: Vec4, share: f32) -> Vec4 {
        let added = self.tints[0] * shaded.added[0][i] + self.tints[1] * shaded.added[1][i];
        color * shaded.kept[i] + added * share
    }

    /// Computes the lighting of places with these differences of codes, at these distances along the ray.
    #[inline(always)]
    pub(crate) fn packet(&self, differences: &[Packet; 3], distance: &Packet, code: &Packet, shaded: &mut Shaded) {
        let (mut normal, mut to_eye) = ([[0.0; LANES]; 3], [0.0; LANES]);
        self.normals(differences, &mut normal, &mut to_eye);
        let mut slope = [0.0; LANES];
        for i in 0..LANES {
            slope[i] = slope_of(differences, code, self.flat_codes, i);
        }
        if let Some(cut) = &self.cut {
            self.turn(cut, distance, &mut normal, &mut to_eye, &mut slope);
        }
        let (mut diffuse, mut specular, mut facing) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        if self.lighting.lights.is_empty() {
            for i in 0..LANES {
                let cosine = to_eye[i];
                let mirrored = match self.lighting.model {
                    LightingModel::Phong => (2.0 * cosine * cosine - 1.0).max(0.0),
                    _ => cosine,
                };
                (diffuse[i], specular[i], facing[i]) = (cosine, tenth_power(mirrored), cosine);
            }
        } else {
            facing = [-1.0; LANES];
            for light in &self.lighting.lights {
                let light = (*light - self.eye).as_vec3();
                self.add_light(light, &normal, &to_eye, distance, [&mut diffuse, &mut specular, &mut facing]);
            }
        }
        for i in 0..LANES {
            // A flat place shows its colour as if it faced a light at the eye, and reflects nothing.
            let is_flat = slope[i] < 0.0;
            diffuse[i] = if is_flat { 1.0 } else { diffuse[i] };
            specular[i] = if is_flat { 0.0 } else { specular[i] };
            facing[i] = if is_flat { 1.0 } else { facing[i] };
        }
        match self.lighting.model {
            LightingModel::Tone => {
                for i in 0..LANES {
                    let warmth = 0.5 * (1.0 + facing[i]);
                    shaded.added[0][i] = 1.0 - warmth;
                    shaded.added[1][i] = warmth;
                    shaded.kept[i] = TONE_KEPT[0] as f32 + warmth * (TONE_KEPT[1] - TONE_KEPT[0]) as f32;
                }
            }
            _ => {
                for i in 0..LANES {
                    shaded.added[0][i] = specular[i];
                    shaded.kept[i] = AMBIENT as f32 + DIFFUSE as f32 * diffuse[i];
                }
                shaded.added[1] = [0.0; LANES];
            }
        }
    }

    /// Unit normals turned to the eye, and the cosines of their angles with the direction to it; both are zero where
    /// nothing differs.
    #[inline(always)]
    fn normals(&self, differences: &[Packet; 3], normal: &mut [Packet; 3], to_eye: &mut Packet) {
        let (map, view) = (self.world_from_differences.to_cols_array_2d(), self.view);
        for i in 0..LANES {
            let [x, y, z] = [differences[0][i], differences[1][i], differences[2][i]];
            let nx = map[0][0] * x + map[1][0] * y + map[2][0] * z;
            let ny = map[0][1] * x + map[1][1] * y + map[2][1] * z;
            let nz = map[0][2] * x + map[1][2] * y + map[2][2] * z;
            let along = nx * view.x + ny * view.y + nz * view.z;
            let squared = nx * nx + ny * ny + nz * nz;
            let scale = if squared > 0.0 { 1.0 / squared.sqrt() } else { 0.0 };
            let scale = if along * scale > SIDEWAYS as f32 { -scale } else { scale };
            (normal[0][i], normal[1][i], normal[2][i]) = (nx * scale, ny * scale, nz * scale);
            to_eye[i] = -(along * scale);
        }
    }

    /// Mixes the normals of places just behind a cut with the cut's own: the twin of [`CutFace::mixed`].
    #[inline(always)]
    fn turn(&self, cut: &Cut, distance: &Packet, normal: &mut [Packet; 3], to_eye: &mut Packet, slope: &mut Packet) {
        for i in 0..LANES {
            let share = CutFace::share(f64::from((distance[i] - cut.entry) * cut.voxels_per_distance)) as f32;
            if share > 0.0 {
                let own = match slope[i] < 0.0 {
                    true => -self.view,
                    false => Vec3::new(normal[0][i], normal[1][i], normal[2][i]),
                };
                let mixed = own.lerp(cut.normal, share).normalize_or(cut.normal);
                (normal[0][i], normal[1][i], normal[2][i]) = mixed.into();
                (to_eye[i], slope[i]) = (-mixed.dot(self.view), 0.0);
            }
        }
    }

    /// Adds the light of a lamp, whose position is relative to the eye.
    #[inline(always)]
    fn add_light(
        &self,
        light: Vec3,
        normal: &[Packet; 3],
        to_eye: &Packet,
        distance: &Packet,
        [diffuse, specular, facing]: [&mut Packet; 3],
    ) {
        let view = self.view;
        for i in 0..LANES {
            let [x, y, z] =
                [light.x - view.x * distance[i], light.y - view.y * distance[i], light.z - view.z * distance[i]];
            let squared = x * x + y * y + z * z;
            // A light at the place itself shines from the eye.
            let is_apart = squared > 0.0;
            let scale = if is_apart { 1.0 / squared.sqrt() } else { 1.0 };
            let x = if is_apart { x * scale } else { -view.x };
            let y = if is_apart { y * scale } else { -view.y };
            let z = if is_apart { z * scale } else { -view.z };
            let cosine = normal[0][i] * x + normal[1][i] * y + normal[2][i] * z;
            // The cosine between the lamp's and the eye's directions.
            let between = -(x * view.x + y * view.y + z * view.z);
            let mirrored = match self.lighting.model {
                LightingModel::Phong => 2.0 * cosine * to_eye[i] - between,
                _ => {
                    // The half-way vector's squared length is 2 + 2 * between.
                    let squared = 2.0 + 2.0 * between;
                    if squared > 1e-12 { (cosine + to_eye[i]) / squared.sqrt() } else { 1.0 }
                }
            };
            let is_lit = cosine > 0.0;
            diffuse[i] += if is_lit { cosine } else { 0.0 };
            specular[i] += if is_lit { tenth_power(mirrored.max(0.0)) } else { 0.0 };
            facing[i] = if cosine > facing[i] { cosine } else { facing[i] };
        }
    }
}

/// `x` to the power of [`SPECULAR_POWER`](brickyard_volume::lighting::SPECULAR_POWER).
#[inline(always)]
fn tenth_power(x: f32) -> f32 {
    let (square, fourth) = (x * x, x * x * (x * x));
    square * (fourth * fourth)
}

const _: () = assert!(brickyard_volume::lighting::SPECULAR_POWER == 10);

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::surface::FLAT_CODES;

    #[test]
    fn places_are_lit_as_one_by_one() {
        let axes = Mat3::from_cols(Vec3::new(0.5, 0.1, 0.0), Vec3::new(0.0, 2.0, -0.3), Vec3::new(0.2, 0.0, 1.0));
        let (eye, view) = (DVec3::new(1e5, 3.0, -9.0), DVec3::new(2.0, -1.0, 2.0) / 3.0);
        let color = DVec3::new(0.7, 0.2, 0.4);
        let mut state = 3u32;
        let mut noise = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let behind = eye + view * 7.0;
        let lamps = [vec![], vec![eye + DVec3::new(3.0, 9.0, 2.0), behind - view * 30.0], vec![behind]];
        for (lights, model) in lamps.iter().flat_map(|lights| LightingModel::ALL.map(|model| (lights.clone(), model))) {
            let lighting = Lighting { model, lights, ..Lighting::default() };
            if model == LightingModel::None {
                continue;
            }
            let shade = Shade::new(&lighting, axes, FLAT_CODES as f32, eye, view, None);
            for _ in 0..200 {
                let mut differences = [[0.0; LANES]; 3];
                differences.as_flattened_mut().iter_mut().for_each(|v| *v = 200.0 * noise());
                differences.iter_mut().for_each(|axis| axis[3] = 0.005);
                let distance = [7.0; LANES];
                let mut shaded = Shaded::EMPTY;
                shade.packet(&differences, &distance, &[0.0; LANES], &mut shaded);
                for i in 0..LANES {
                    let gradient = axes * Vec3::new(differences[0][i], differences[1][i], differences[2][i]);
                    let normal = (i != 3).then(|| gradient.as_dvec3().normalize());
                    let expected = lighting.shade(color, normal, view, behind);
                    let found = shade.lit(&shaded, i, color.as_vec3().extend(1.0) * 0.25, 0.25).truncate() * 4.0;
                    // A hundredth of a picture's step.
                    assert!((found.as_dvec3() - expected).length() < 4e-5, "{model:?} {found} {expected}");
                }
            }
        }
    }
}
