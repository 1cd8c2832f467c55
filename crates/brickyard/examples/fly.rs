//! Flies once around a store as fast as frames can be drawn, and writes the last one: `cargo run --release -p brickyard
//! --example fly -- STORE.zarr OUT.png`.
//!
//! Every frame is complete: coarser bricks stand in for missing fine ones.

use brickyard::{Mode, Session, SessionOptions};
use std::time::{Duration, Instant};

const SIZE_PX: (u32, u32) = (320, 240);
const FRAMES: u32 = 36;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [store, output] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err("expected STORE.zarr OUT.png".into());
    };
    let mut session = Session::open(store, SessionOptions { live: true, ..SessionOptions::default() })?;
    let mut scene = session.default_scene(Mode::Dvr);
    // Before the first bricks there is nothing to draw.
    let start = loop {
        let frame = session.step(&scene, SIZE_PX)?;
        if frame.status.covered {
            break frame.scene.camera;
        }
        session.wait(Duration::from_millis(50));
    };
    for number in 1..=FRAMES {
        scene.camera = Some(start.orbited(360.0 * f64::from(number) / f64::from(FRAMES)));
        let begun = Instant::now();
        let frame = session.step(&scene, SIZE_PX)?;
        session.draw(&frame)?;
        println!(
            "frame {number}: {:.0} ms, {:.0} % of the picture at its own level",
            begun.elapsed().as_secs_f64() * 1e3,
            frame.status.completeness * 100.0
        );
    }
    // The camera rests: now the picture may take its time.
    session.render(&scene, SIZE_PX)?.save(output)?;
    Ok(())
}
