//! Plot of quality against speed as SVG: a panel for each filter and lighting, with a line for each method.

use super::findings::{Estimator, name};
use super::{Row, distinct};
use brickyard::text_file::write_text;
use brickyard::volume::{Filter, LightingModel, Method};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// Size of a panel, pixels.
const PANEL_PX: (u32, u32) = (520, 360);

/// Colours of [`Method::ALL`], safe for colour-blind readers (Okabe and Ito's; gray for their sky blue, and a darker yellow, on
/// white).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(0, 114, 178),
    RGBColor(140, 140, 140),
    RGBColor(214, 158, 0),
    RGBColor(204, 121, 167),
];

/// Greatest distinguishable quality of pictures with 8 bits, dB; lines end there.
const MOST_DB: f64 = 60.0;

/// Draws the curves of all rows into an SVG file. The rows of each method must be in the order of rising rates.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, rows: &[Row], by: Estimator) -> Result<(), String> {
    let mut svg = String::new();
    draw(&mut svg, rows, by).map_err(|error| format!("{}: {error}", path.display()))?;
    write_text(path, &svg).map_err(|error| error.to_string())
}

fn draw(svg: &mut String, rows: &[Row], by: Estimator) -> Result<(), Box<dyn std::error::Error>> {
    let looks = distinct(rows.iter().map(|row| (row.lighting, row.filter)));
    let columns = looks.len().min(2) as u32;
    let size = (PANEL_PX.0 * columns, PANEL_PX.1 * (looks.len() as u32).div_ceil(2));
    let root = SVGBackend::with_string(svg, size).into_drawing_area();
    root.fill(&WHITE)?;
    let panels = root.split_evenly((looks.len().div_ceil(2), columns as usize));
    for (panel, (lighting, filter)) in panels.iter().zip(looks) {
        draw_panel(panel, rows, by, lighting, filter)?;
    }
    root.present()?;
    Ok(())
}

fn draw_panel(
    panel: &DrawingArea<SVGBackend<'_>, Shift>,
    rows: &[Row],
    by: Estimator,
    lighting: LightingModel,
    filter: Filter,
) -> Result<(), Box<dyn std::error::Error>> {
    let rows: Vec<&Row> = rows.iter().filter(|row| (row.lighting, row.filter) == (lighting, filter)).collect();
    let db = |row: &Row| by.db(row).min(MOST_DB);
    let (least_ms, most_ms) =
        rows.iter().fold((f64::MAX, 0.0f64), |(a, b), row| (a.min(row.cpu_ms), b.max(row.cpu_ms)));
    let (least_db, most_db) = rows.iter().fold((20.0f64, 45.0f64), |(a, b), row| (a.min(db(row)), b.max(db(row))));
    let light = match lighting {
        LightingModel::None => "unlit",
        LightingModel::Phong => "lit (Phong)",
        LightingModel::BlinnPhong => "lit (Blinn-Phong)",
        LightingModel::Tone => "lit (tone)",
    };
    let field = match filter {
        Filter::Nearest => "Nearest",
        Filter::Trilinear => "Trilinear",
        Filter::Tricubic => "Tricubic",
    };
    let mut chart = ChartBuilder::on(panel)
        .caption(format!("{field}, {light}"), ("sans-serif", 15))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(44)
        .build_cartesian_2d((least_ms / 1.2..most_ms * 1.9).log_scale().base(2.0), least_db - 2.0..most_db + 2.0)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc("processor ms a frame")
        .y_desc(match by {
            Estimator::Variance => "PSNR by variance, dB",
            Estimator::Truth => "PSNR against the truth, dB",
        })
        .x_label_formatter(&|ms| format!("{ms:.0}"))
        .y_label_formatter(&|db| format!("{db:.0}"))
        .draw()?;
    for (method, color) in Method::ALL.into_iter().zip(COLORS) {
        let points: Vec<(f64, f64)> =
            rows.iter().filter(|row| row.method == method && row.is_usual()).map(|row| (row.cpu_ms, db(row))).collect();
        if points.is_empty() {
            continue;
        }
        let key = move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2));
        let line = LineSeries::new(points, color.stroke_width(2)).point_size(3);
        chart.draw_series(line)?.label(name(method)).legend(key);
    }
    let mut labels = chart.configure_series_labels();
    labels.position(SeriesLabelPosition::LowerRight).background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.3));
    labels.draw()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_look_has_a_panel_and_every_method_a_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curves.svg");
        let mut rows = Vec::new();
        for lighting in [LightingModel::None, LightingModel::Phong] {
            for method in [Method::Udvr, Method::Pcvs] {
                for (samples_per_voxel, db) in [(1.0, 25.0), (2.0, f64::INFINITY)] {
                    let (filter, pixels, ms) = (Filter::Tricubic, 1, 10.0 * samples_per_voxel);
                    let [rgb_db, ycbcr_db, hsl_db, truth_db] = [db; 4];
                    let (frame_ms, cpu_ms) = (ms, ms);
                    rows.push(Row {
                        method,
                        virtual_samples: None,
                        filter,
                        lighting,
                        samples_per_voxel,
                        pixels,
                        rgb_db,
                        ycbcr_db,
                        hsl_db,
                        truth_db,
                        noticed: 0.0,
                        frame_ms,
                        cpu_ms,
                    });
                }
            }
        }
        for by in [Estimator::Variance, Estimator::Truth] {
            write(&path, &rows, by).unwrap();
            let text = std::fs::read_to_string(&path).unwrap();
            for words in ["Tricubic, unlit", "Tricubic, lit (Phong)"] {
                assert_eq!(text.matches(words).count(), 1, "{words}");
            }
            assert_eq!((text.matches("udvr").count(), text.matches("pcvs").count()), (2, 2));
        }
        let error = write(Path::new("/nonexistent/a.svg"), &rows, Estimator::Truth).unwrap_err();
        assert!(error.contains("/nonexistent/a.svg"), "{error}");
    }
}
