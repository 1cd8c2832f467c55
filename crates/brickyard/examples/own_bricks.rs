//! Shows a volume of 4096³ voxels that no file holds, computed brick by brick: `cargo run --release -p brickyard --example own_bricks --
//! OUT.png`.
//!
//! The volume is a gyroid, 64 GiB if it were written down. A picture takes just the bricks that it shows, at the levels that it shows.

use brickyard::volume::{BrickId, Extent, Geometry, Lighting, LightingModel, Pyramid, TransferFunction, VoxelType};
use brickyard::{BrickError, BrickSource, Scene, Session, SessionOptions, VolumeSource};
use std::sync::Arc;

const EDGE: u32 = 4096;
const BRICK_EDGE: u32 = 32;

/// A surface that parts space in two, without end.
struct Gyroid {
    pyramid: Pyramid,
    geometry: Geometry,
}

impl Gyroid {
    fn new() -> Self {
        let geometry = Geometry::default();
        let pyramid = Pyramid::new(Extent::new(EDGE, EDGE, EDGE), geometry.spacing.to_array(), BRICK_EDGE);
        Self { pyramid, geometry }
    }

    /// The value at a place in voxels of level 0, from 0 to 255: 127.5 on the surface, and 0 outside of a ball.
    fn value([x, y, z]: [f64; 3]) -> u8 {
        let radius = [x, y, z].map(|p| (p / f64::from(EDGE) - 0.5).powi(2)).iter().sum::<f64>().sqrt();
        let [a, b, c] = [x, y, z].map(|p| p * 8.0 * std::f64::consts::TAU / f64::from(EDGE));
        let gyroid = a.sin() * b.cos() + b.sin() * c.cos() + c.sin() * a.cos();
        if radius > 0.48 { 0 } else { (127.5 + 80.0 * gyroid).clamp(0.0, 255.0) as u8 }
    }
}

impl BrickSource for Gyroid {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn voxel_type(&self) -> VoxelType {
        VoxelType::U8
    }

    fn value_range(&self) -> (f64, f64) {
        (0.0, 255.0)
    }

    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        let (index, factor) = (id.index.to_array(), self.pyramid.level(id.level).factor);
        for (i, voxel) in (0..).zip(out) {
            let place = [i % BRICK_EDGE, i / BRICK_EDGE % BRICK_EDGE, i / BRICK_EDGE / BRICK_EDGE];
            // A voxel of a coarser level stands for several of level 0: this is where their middle is.
            let middle =
                |axis: usize| (f64::from(index[axis] * BRICK_EDGE + place[axis]) + 0.5) * f64::from(factor[axis]) - 0.5;
            *voxel = Self::value([0, 1, 2].map(middle));
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [output] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err("expected OUT.png".into());
    };
    let transfer = TransferFunction {
        color: vec![[100.0, 0.1, 0.3, 0.8], [160.0, 1.0, 0.6, 0.2]],
        opacity: vec![[110.0, 0.0], [125.0, 0.9], [130.0, 0.9], [145.0, 0.0]],
        unit_distance: f64::from(EDGE) / 200.0,
        ..TransferFunction::default()
    };
    let mut session = Session::new(vec![VolumeSource::new(Arc::new(Gyroid::new()))], SessionOptions::default());
    let lighting = Lighting { model: LightingModel::Phong, ..Lighting::default() };
    let rendered = session.render(&Scene { lighting, ..Scene::of(transfer) }, (480, 480))?;
    let bytes = rendered.stats.bytes.decoded;
    println!("computed {} MiB of {} GiB", bytes >> 20, u64::from(EDGE).pow(3) >> 30);
    rendered.save(output)?;
    Ok(())
}
