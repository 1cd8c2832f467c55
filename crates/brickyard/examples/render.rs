//! Renders a store to a PNG file: `cargo run --release -p brickyard --example render -- STORE.zarr OUT.png`.

use brickyard::{Mode, Session, SessionOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [store, output] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err("expected STORE.zarr OUT.png".into());
    };
    let mut session = Session::open(store, SessionOptions::default())?;
    let scene = session.default_scene(Mode::Dvr);
    session.render(&scene, (640, 480))?.save(output)?;
    Ok(())
}
