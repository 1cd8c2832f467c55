//! Serves a folder until its standard input ends, and prints its address, then a line for each request answered.
//!
//!     brickyard-server FOLDER [ROUND_TRIP_MS [MBIT_PER_S]]

use brickyard_server::{Link, Server};
use std::error::Error;
use std::io::Read;
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [folder, link @ ..] = &words[..] else { return Err("expected FOLDER [ROUND_TRIP_MS [MBIT_PER_S]]".into()) };
    let number = |at: usize| link.get(at).map(|word| word.parse::<f64>()).transpose();
    let server = Server::start(folder)?;
    let round_trip = Duration::from_secs_f64(number(0)?.unwrap_or(0.0) / 1e3);
    server.set_link(Link { round_trip, bytes_per_s: number(1)?.map(|rate| rate * 1e6 / 8.0) });
    println!("{}", server.url(""));
    std::io::stdin().read_to_end(&mut Vec::new())?;
    for asked in server.take_asked() {
        let at_ms = asked.at.as_millis();
        println!("{at_ms} ms: {} {:?} {} {} bytes", asked.path, asked.range, asked.status, asked.bytes);
    }
    Ok(())
}
