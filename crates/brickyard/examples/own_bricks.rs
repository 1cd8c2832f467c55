//! Shows a procedural volume of 4096³ voxels, computed brick by brick: `cargo run --release -p brickyard --example
//! own_bricks -- OUT.png`.
//!
//! A picture computes only its own bricks, at its own levels.

mod gyroid;

use brickyard::{Session, SessionOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [output] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err("expected OUT.png".into());
    };
    let mut session = Session::new(vec![gyroid::volume()], SessionOptions::default());
    let rendered = session.render(&gyroid::scene(), (320, 320))?;
    let bytes = rendered.stats.bytes.decoded;
    println!("computed {} MiB of {} GiB", bytes >> 20, u64::from(gyroid::EDGE).pow(3) >> 30);
    rendered.save(output)?;
    Ok(())
}
