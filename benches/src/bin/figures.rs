//! The plots and the table of `docs/performance.md`, from the output of `brickyard bench --json`.
//!
//! ```text
//! brickyard bench turbulence-*.zarr --scenario still,fly --json > flights.json
//! cargo run --release -p brickyard-benches --bin figures -- flights.json --out docs/images
//! ```
//!
//! Writes `frame-time.svg` (median time of a still frame, against the volume's edge, and the 20 ms of real time) and `first-picture.svg` (from
//! opening to the first picture and to the settled one), and prints the table of all flights. Stores of one kind, the part of their names before the
//! last dash, are one line. `--beside NAME=EDGE:MS,EDGE:MS...` adds another renderer.

use clap::Parser;
use plotters::prelude::*;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Draws plots of measured flights.
#[derive(Parser)]
struct Arguments {
    /// Output of `brickyard bench --json`
    #[arg(required = true)]
    flights: Vec<PathBuf>,
    /// Folder for the plots
    #[arg(long)]
    out: PathBuf,
    /// Another renderer's frame times: NAME=EDGE:MS,EDGE:MS...
    #[arg(long, value_parser = parse_line)]
    beside: Vec<Line>,
}

/// Real-time frame in milliseconds, from the paper that plots frame time against size.
const REAL_TIME_MS: f64 = 20.0;

/// Points of a line, by the volume's edge in voxels.
#[derive(Clone, Debug, PartialEq)]
struct Line {
    name: String,
    points: Vec<(f64, f64)>,
}

fn parse_line(text: &str) -> Result<Line, String> {
    let expected = || format!("'{text}': expected NAME=EDGE:MS,EDGE:MS...");
    let (name, points) = text.split_once('=').ok_or_else(expected)?;
    let point = |point: &str| {
        let (edge, ms) = point.split_once(':')?;
        Some((edge.parse().ok()?, ms.parse().ok()?))
    };
    let points = points.split(',').map(point).collect::<Option<_>>().ok_or_else(expected)?;
    Ok(Line { name: name.into(), points })
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("figures: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let mut flights = Vec::new();
    for path in &arguments.flights {
        let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let rows: Vec<Value> = serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
        flights.extend(rows);
    }
    let still: Vec<&Value> = flights.iter().filter(|flight| flight["scenario"] == "still").collect();
    let mut frames = lines(&still, |flight| flight["frame_ms"]["p50"].as_f64());
    frames.extend(arguments.beside.iter().cloned());
    if !frames.is_empty() {
        let edges = || frames.iter().flat_map(|line| &line.points).map(|point| point.0);
        let ends = [edges().fold(f64::MAX, f64::min), edges().fold(0.0, f64::max)];
        let points = ends.map(|edge| (edge, REAL_TIME_MS)).to_vec();
        frames.push(Line { name: format!("{REAL_TIME_MS} ms: real time, by the first paper"), points });
        plot(&arguments.out.join("frame-time.svg"), "Median frame when nothing moves, ms", &frames)?;
        let mut firsts = Vec::new();
        for (field, what) in [("first_picture_ms", "first picture"), ("settled_ms", "settled")] {
            let lines = lines(&still, |flight| flight[field].as_f64());
            firsts.extend(lines.into_iter().map(|line| Line { name: format!("{}, {what}", line.name), ..line }));
        }
        plot(&arguments.out.join("first-picture.svg"), "From opening, ms", &firsts)?;
    }
    print_table(&flights);
    Ok(())
}

/// One line for each kind of store.
fn lines(flights: &[&Value], value: impl Fn(&Value) -> Option<f64>) -> Vec<Line> {
    let mut kinds: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    for flight in flights {
        if let (Some(edge), Some(value)) = (flight["extents"][0][0].as_f64(), value(flight)) {
            kinds.entry(kind(flight)).or_default().push((edge, value));
        }
    }
    let sorted = |mut points: Vec<(f64, f64)>| {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    kinds.into_iter().map(|(name, points)| Line { name, points: sorted(points) }).collect()
}

fn kind(flight: &Value) -> String {
    let store = Path::new(flight["stores"][0].as_str().unwrap_or_default());
    let name = store.file_stem().unwrap_or_default().to_string_lossy();
    name.rsplit_once('-').map_or(&*name, |(kind, _)| kind).to_string()
}

/// Edges are on a logarithmic scale, times on a linear one from zero.
fn plot(path: &Path, caption: &str, lines: &[Line]) -> Result<(), String> {
    let text = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let points = || lines.iter().flat_map(|line| &line.points);
    let least_edge = points().map(|p| p.0).fold(f64::MAX, f64::min);
    let (greatest_edge, longest_ms) = points().fold((1.0, 1.0), |(edge, ms), p| (p.0.max(edge), p.1.max(ms)));
    let edges = (least_edge / 1.5..greatest_edge * 1.5).log_scale().base(2.0);
    let root = SVGBackend::new(path, (720, 420)).into_drawing_area();
    root.fill(&WHITE).map_err(|error| text(&error))?;
    let mut chart = ChartBuilder::on(&root)
        .caption(caption, ("sans-serif", 16))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d(edges, 0.0..longest_ms * 1.4)
        .map_err(|error| text(&error))?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc("voxels along an edge")
        .x_label_formatter(&|edge| format!("{edge:.0}"))
        .y_label_formatter(&|ms| format!("{ms:.0}"))
        .draw()
        .map_err(|error| text(&error))?;
    for (i, line) in lines.iter().enumerate() {
        let color = Palette99::pick(i).to_rgba();
        let series = LineSeries::new(line.points.iter().copied(), color.stroke_width(2)).point_size(3);
        let drawn = chart.draw_series(series).map_err(|error| text(&error))?;
        let key = move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2));
        drawn.label(&line.name).legend(key);
    }
    let mut labels = chart.configure_series_labels();
    labels.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3));
    labels.draw().map_err(|error| text(&error))?;
    root.present().map_err(|error| text(&error))
}

fn print_table(flights: &[Value]) {
    println!(
        "| volume | flight | budget MiB, GPU / host | open ms | first picture ms | settled ms | frame ms p50 / p95 / p99 | \
         complete | read / decoded / uploaded MiB | decoded per upload | uploaded again | peak MiB, GPU / host / anonymous |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for flight in flights {
        let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
        let mib = |value: &Value| format!("{:.0}", number(value) / (1 << 20) as f64);
        let (bricks, bytes, frame) = (&flight["bricks"], &flight["bytes"], &flight["frame_ms"]);
        let uploaded = number(&bricks["uploaded"]);
        println!(
            "| {} {}³ | {}{} | {} / {} | {:.1} | {:.0} | {:.0} | {:.0} / {:.0} / {:.0} | {:.1} % | {} / {} / {} | {:.2} | \
             {:.1} % | {} / {} / {} |",
            kind(flight),
            flight["extents"][0][0],
            flight["scenario"].as_str().unwrap_or_default(),
            if flight["cold"] == true { ", cold" } else { "" },
            mib(&flight["gpu_memory"]),
            mib(&flight["host_memory"]),
            number(&flight["open_ms"]),
            number(&flight["first_picture_ms"]),
            number(&flight["settled_ms"]),
            number(&frame["p50"]),
            number(&frame["p95"]),
            number(&frame["p99"]),
            100.0 * number(&flight["completeness"]),
            mib(&bytes["read"]),
            mib(&bytes["decoded"]),
            mib(&bytes["uploaded"]),
            number(&flight["bricks_decoded"]) / uploaded.max(1.0),
            100.0 * number(&bricks["reuploaded"]) / uploaded.max(1.0),
            mib(&flight["gpu_bytes_peak"]),
            mib(&flight["host_bytes_peak"]),
            mib(&flight["anonymous_peak"]),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn stores_of_a_kind_are_one_line_by_size() {
        let flight = |store: &str, edge: u32, ms: f64| json!({ "stores": [store], "extents": [[edge, edge, edge]], "frame_ms": { "p50": ms } });
        let flights =
            [flight("a/ct-1024.zarr", 1024, 3.0), flight("b/ct-512.zarr", 512, 2.0), flight("mr.zarr", 64, 1.0)];
        let found = lines(&flights.iter().collect::<Vec<_>>(), |flight| flight["frame_ms"]["p50"].as_f64());
        let line = |name: &str, points: &[(f64, f64)]| Line { name: name.into(), points: points.into() };
        assert_eq!(found, [line("ct", &[(512.0, 2.0), (1024.0, 3.0)]), line("mr", &[(64.0, 1.0)])]);
        assert_eq!(parse_line("x=512:2,1024:3.5"), Ok(line("x", &[(512.0, 2.0), (1024.0, 3.5)])));
        assert!(parse_line("x=512").is_err() && parse_line("512:2").is_err());
    }
}
