//! Shows two stores in one picture, the second one as added light: `cargo run --release -p brickyard --example layers
//! -- FIRST.zarr SECOND.zarr OUT.png`.

use brickyard::volume::{Blend, TransferChoice};
use brickyard::{Scene, SceneLayer, Session, SessionOptions, VolumeSource};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [first, second, output] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err("expected FIRST.zarr SECOND.zarr OUT.png".into());
    };
    let volumes = vec![VolumeSource::open(first)?, VolumeSource::open(second)?];
    // Layers take the stores in turn, first channel each, unless `SceneLayer::source` and `channel` choose others.
    let solid = SceneLayer { transfer: Some(TransferChoice::preset("gray")), ..SceneLayer::default() };
    let glowing =
        SceneLayer { color: Some([0.2, 0.9, 0.3]), blend: Some(Blend::Add), opacity: 0.5, ..SceneLayer::default() };
    let scene = Scene { layers: vec![solid, glowing], ..Scene::default() };
    Session::new(volumes, SessionOptions::default()).render(&scene, (640, 480))?.save(output)?;
    Ok(())
}
