//! Looks for pictures of several layers.

use brickyard::volume::*;
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

/// Scene settings common to all volumes.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) mode: Mode,
    pub(crate) sampling: Sampling,
    pub(crate) lighting: Lighting,
    pub(crate) has_surfaces: bool,
    /// Whether opacities depend on gradients, too.
    pub(crate) is_by_gradient: bool,
    pub(crate) has_meshes: bool,
}

pub(crate) const PLAIN: Look = Look {
    mode: Mode::Dvr,
    sampling: Sampling { method: Method::Udvr, virtual_samples: 3, filter: Filter::Trilinear, jitter: Jitter::None },
    lighting: Lighting { model: LightingModel::None, gradient: Gradient::Central, lights: Vec::new() },
    has_surfaces: false,
    is_by_gradient: false,
    has_meshes: false,
};

impl Look {
    /// A translucent wall through the middle and an opaque one behind; in projections the opaque one alone.
    pub(crate) fn meshes(&self) -> Vec<ShownMesh> {
        let wall = |x: f32, opacity: f64| {
            let corner = |y: f32, z: f32| [x + 0.2 * y, y, z];
            let positions = vec![corner(-5.0, -5.0), corner(30.0, -5.0), corner(30.0, 20.0), corner(-5.0, 20.0)];
            let mesh = Mesh::new(positions, vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new()).expect("a wall");
            ShownMesh { mesh: mesh.into(), color: Some([0.2, 0.9, 0.4]), opacity, lit: true }
        };
        match (self.has_meshes, self.mode) {
            (false, _) => Vec::new(),
            (true, Mode::Dvr | Mode::Isosurface) => vec![wall(12.0, 0.4), wall(25.0, 1.0)],
            (true, Mode::Mip | Mode::MinIp | Mode::Average) => vec![wall(18.0, 1.0)],
        }
    }

    /// A volume's transfer function under this look.
    pub(crate) fn transfer(&self, plain: &TransferFunction, encoding: &SlotEncoding) -> TransferFunction {
        let steep = 0.05 * (encoding.high - encoding.low);
        let gradient_opacity = if self.is_by_gradient { vec![[0.0, 0.0], [steep, 1.0]] } else { Vec::new() };
        TransferFunction { gradient_opacity, ..plain.clone() }
    }
}

/// Unlit, lit from the eye, and by placed lights, with gradients of every kind; without surfaces and with them.
fn lit() -> Vec<Look> {
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
    let look = |has_surfaces| move |lighting: &Lighting| Look { lighting: lighting.clone(), has_surfaces, ..PLAIN };
    lightings.iter().map(look(false)).chain(lightings.iter().map(look(true))).collect()
}

/// Every lighting, method, jitter and mode; with surfaces, meshes and gradient opacities, and without.
pub(crate) fn looks() -> Vec<Look> {
    let mut looks = lit();
    for (i, method) in Method::ALL.into_iter().enumerate() {
        let sampling =
            Sampling { method, jitter: [Jitter::None, Jitter::White(7), Jitter::Blue][i % 3], ..PLAIN.sampling };
        looks.push(Look { sampling, ..PLAIN });
        let lighting = Lighting { model: LightingModel::Phong, ..Lighting::default() };
        looks.push(Look { sampling, lighting, has_surfaces: true, has_meshes: i % 2 == 0, ..PLAIN });
        if !method.is_pre_integrated() {
            looks.push(Look { sampling, is_by_gradient: true, has_surfaces: i % 2 == 1, ..PLAIN });
        }
    }
    for mode in Mode::ALL.into_iter().filter(|mode| *mode != Mode::Dvr) {
        let has_surfaces = mode == Mode::Isosurface;
        for (jitter, has_meshes) in [(Jitter::None, false), (Jitter::Blue, true)] {
            let sampling = Sampling { jitter, ..PLAIN.sampling };
            looks.push(Look { mode, sampling, has_surfaces, has_meshes, ..PLAIN });
        }
    }
    looks
}
