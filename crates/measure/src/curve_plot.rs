//! Plots of curves as SVG: a line per channel, over time if the steps have times, else over steps.

use brickyard::curve::{Curve, LINE_COLORS};
use brickyard::text_file::write_text;
use brickyard::volume::units::name_in_unit;
use brickyard::volume::{TimeAxis, time_symbol};
use plotters::prelude::*;
use std::error::Error;
use std::path::Path;

/// Size of the picture, pixels.
const SIZE_PX: (u32, u32) = (760, 420);

/// A channel's line.
#[derive(Clone, Debug)]
pub struct Line {
    /// The channel's name.
    pub name: String,
    /// The unit of its values.
    pub unit: Option<String>,
}

/// Draws a curve into an SVG file. `lines` are the channels'; one is broken where its channel has no value.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, curve: &Curve, axis: Option<&TimeAxis>, lines: &[Line]) -> Result<(), String> {
    let mut svg = String::new();
    draw(&mut svg, curve, axis, lines).map_err(|error| format!("{}: {error}", path.display()))?;
    write_text(path, &svg).map_err(|error| error.to_string())
}

fn draw(svg: &mut String, curve: &Curve, axis: Option<&TimeAxis>, lines: &[Line]) -> Result<(), Box<dyn Error>> {
    let time = |step: u32| axis.map_or(f64::from(step), |axis| axis.at(step));
    let times: Vec<f64> = curve.steps.iter().map(|step| time(*step)).collect();
    let x_desc = match axis {
        Some(axis) => axis.unit.as_ref().map_or("time".into(), |unit| format!("time, {}", time_symbol(unit))),
        None => "step".into(),
    };
    // A unit of all lines is on the axis; different ones are in the legend.
    let first = lines.first().and_then(|line| line.unit.as_deref());
    let common = first.filter(|_| lines.iter().all(|line| line.unit.as_deref() == first));
    let root = SVGBackend::with_string(svg, SIZE_PX).into_drawing_area();
    root.fill(&WHITE)?;
    let [i, j, k] = curve.voxel;
    let mut chart = ChartBuilder::on(&root)
        .caption(format!("voxel {i},{j},{k}"), ("sans-serif", 15))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(64)
        .build_cartesian_2d(padded(times.iter().copied()), padded(curve.values.iter().flatten().copied()))?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc(x_desc)
        .y_desc(name_in_unit("value", common))
        .draw()?;
    for (channel, values) in curve.values.iter().enumerate() {
        let [r, g, b] = LINE_COLORS[channel % LINE_COLORS.len()];
        let color = RGBColor(r, g, b);
        let points: Vec<(f64, f64)> = times.iter().copied().zip(values.iter().copied()).collect();
        let runs = points.split(|(_, value)| !value.is_finite()).filter(|run| !run.is_empty());
        for (i, run) in runs.enumerate() {
            let line = chart.draw_series(LineSeries::new(run.to_vec(), color.stroke_width(2)).point_size(2))?;
            if i == 0 {
                let name = lines.get(channel).map_or_else(
                    || format!("channel {channel}"),
                    |line| name_in_unit(&line.name, line.unit.as_deref().filter(|_| common.is_none())),
                );
                let key = move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2));
                line.label(name).legend(key);
            }
        }
    }
    let mut labels = chart.configure_series_labels();
    labels.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3));
    labels.draw()?;
    root.present()?;
    Ok(())
}

/// A range around all finite numbers, never empty.
fn padded(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let finite = numbers.filter(|number| number.is_finite());
    let (least, most) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), n| (a.min(n), b.max(n)));
    let (least, most) = if least <= most { (least, most) } else { (0.0, 0.0) };
    let pad = ((most - least) * 0.04).max(most.abs().max(1.0) * 1e-6);
    least - pad..most + pad
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn every_channel_has_a_line_which_breaks_where_there_is_no_value() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.svg");
        let values = vec![vec![1.0, f64::NAN, 3.0, 4.0], vec![7.0; 4], vec![f64::NAN; 4]];
        let curve = Curve { voxel: [3, 4, 5], world: DVec3::ZERO, steps: vec![0, 2, 4, 6], values };
        let line = |name: &str, unit: &str| Line { name: name.into(), unit: Some(unit.into()) };
        let lines = [line("heat", "K"), line("flow", "m/s")];
        let seconds = TimeAxis { step: 0.5, unit: Some("second".into()), ..TimeAxis::default() };
        for (axis, word) in [(None, "step"), (Some(&seconds), "time, s")] {
            write(&path, &curve, axis, &lines).unwrap();
            let text = std::fs::read_to_string(&path).unwrap();
            for word in ["voxel 3,4,5", "value", "heat (K)", "flow (m/s)", word] {
                assert_eq!(text.lines().filter(|line| line.trim() == word).count(), 1, "{word}");
            }
            // A line of two values, and one of one, which is a point, and those of the second channel.
            assert_eq!(text.matches("<circle").count(), 3 + 4);
            assert!(!text.contains("NaN"));
        }
        write(&path, &curve, None, &[line("heat", "K"), line("flow", "K")]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(["value (K)", "heat"].iter().all(|word| text.lines().any(|line| line.trim() == *word)));
        let error = write(Path::new("/nonexistent/a.svg"), &curve, None, &lines).unwrap_err();
        assert!(error.contains("/nonexistent/a.svg"), "{error}");
    }
}
