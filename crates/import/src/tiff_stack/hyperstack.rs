//! ImageJ's description: lines of `key=value`. Pages run through channels first, then slices, then frames, unless an order says that slices go
//! first, as in Micro-Manager's older files.

use super::calibration::Calibration;
use super::description::{Declared, Description};
use super::units::unit_of;
use crate::axes::Axis;
use crate::note::{Note, Setting};
use crate::spacing::Spacing;
use brickyard_volume::ChannelLook;

/// First characters of ImageJ's description.
pub(super) const START: &str = "ImageJ=";

/// Parses the text. `resolution` is pixels per unit along x and y, from the page's tags; `samples` are those of a pixel.
pub(super) fn read(text: &str, resolution: Option<[f64; 2]>, samples: u16) -> Description {
    let value = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix('=')).map(str::trim);
    let count = |key| value(key).and_then(|v| v.parse::<u32>().ok());
    let images = count("images").unwrap_or(1);
    // The channels of a 16-bit composite may be the samples of its pixels: then pages have no others.
    let between_pages = |channels: &u32| samples == 1 || images > 1 || *channels != u32::from(samples);
    let channels = count("channels").filter(between_pages).unwrap_or(1);
    let frames = count("frames").unwrap_or(1);
    let others = channels.saturating_mul(frames);
    let slices = count("slices").unwrap_or(if others == 1 { images } else { 1 });
    let page_axes = match value("order").unwrap_or("czt") {
        "czt" => vec![Axis::T, Axis::Z, Axis::C],
        "zct" => vec![Axis::T, Axis::C, Axis::Z],
        other => {
            return Description::unreadable(format!(
                "its description (ImageJ's) has pages in the order '{other}', which ImageJ itself takes as 'czt'; pass \
                 `axes` (with `channels` and `times`) to order them"
            ));
        }
    };
    let mut description = Description {
        declared: Some(Declared {
            page_axes,
            z: slices,
            channels,
            times: frames,
            in_one_directory: true,
            images: count("images"),
            ..Declared::one_plane()
        }),
        ignores_resolution: true,
        calibration: Calibration::parse(value),
        value_unit: Calibration::unit(value).map(str::to_owned),
        channel_looks: display_range(value).into_iter().collect(),
        ..Description::default()
    };
    let depth = value("spacing").and_then(|v| v.parse::<f64>().ok()).map(f64::abs).filter(|&depth| is_length(depth));
    let unit = value("unit").filter(|u| !u.starts_with("pixel"));
    description.set_unit(unit);
    description.spacing = spacing(unit.is_some(), depth, resolution);
    in_unit_of_x(&mut description, unit, [value("yunit"), value("zunit")]);
    let interval = value("finterval").and_then(|v| v.parse::<f64>().ok()).filter(|step| *step != 0.0);
    if let Some(step) = interval {
        description.set_increment(step, value("tunit").unwrap_or("s"), frames);
        // No word of ImageJ's own, but of exports.
        description.set_since(value("time_since"));
    }
    description
}

/// ImageJ's spacing, whose depth is omitted if 1; `None` if unknown. Without a unit the resolution is a printer's, not the data's.
pub(super) fn spacing(has_unit: bool, depth: Option<f64>, resolution: Option<[f64; 2]>) -> Option<Spacing> {
    if !has_unit && depth.is_none() {
        return None;
    }
    let size = |r: f64| if has_unit && is_length(1.0 / r) { 1.0 / r } else { 1.0 };
    let [x, y] = resolution.unwrap_or([1.0; 2]).map(size);
    Some(Spacing { x, y, z: Some(depth.unwrap_or(1.0)) })
}

/// Converts y and z to the unit of x: ImageJ names theirs where they differ.
fn in_unit_of_x(description: &mut Description, unit: Option<&str>, others: [Option<&str>; 2]) {
    let Some(spacing) = &mut description.spacing else { return };
    let others = others.map(|other| other.filter(|other| Some(*other) != unit));
    let in_x = |length: f64, other: Option<&str>| match other {
        None => Some(length),
        Some(other) => Some(unit_of(other)?.convert(length, unit_of(unit?)?)),
    };
    let (y, z) = (in_x(spacing.y, others[0]), spacing.z.map(|depth| in_x(depth, others[1])));
    spacing.z = z.flatten();
    match y {
        Some(y) => spacing.y = y,
        None => description.spacing = None,
    }
    let are_lost = [y.is_none(), z == Some(None)];
    for (axis, other) in
        ["y", "z"].into_iter().zip(others).zip(are_lost).filter_map(|(at, is_lost)| is_lost.then_some(at))
    {
        let (other, unit) = (other.unwrap_or_default(), unit.unwrap_or("none"));
        description.notes.push(
            Note::warning(format!(
                "Lengths along {axis} are in '{other}', those along x in '{unit}': the former are left out; `spacing` \
             gives them."
            ))
            .settled_by(Setting::Spacing),
        );
    }
}

/// Whether a number can be a distance.
pub(super) fn is_length(number: f64) -> bool {
    number > 0.0 && number.is_finite()
}

/// Look of a single-channel image, by ImageJ's display range.
fn display_range<'a>(value: impl Fn(&str) -> Option<&'a str>) -> Option<ChannelLook> {
    let number = |key| value(key)?.parse::<f64>().ok().filter(|number| number.is_finite());
    let (low, high) = number("min").zip(number("max"))?;
    (low < high).then(|| ChannelLook { window: Some([low, high]), ..ChannelLook::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{is_warned, said};
    use brickyard_volume::TimeAxis;

    fn spacing_of(description: &Description) -> Option<[f64; 3]> {
        description.spacing.map(|s| [s.x, s.y, s.z.unwrap()])
    }

    #[test]
    fn channels_of_a_composite_may_be_samples() {
        let planes = |text: &str, samples| read(text, None, samples).declared.unwrap().planes();
        let text = "ImageJ=1.53c\nchannels=3\nmode=composite\n";
        assert_eq!([planes(text, 1), planes(text, 3), planes(text, 4)], [3, 1, 3]);
        assert_eq!(planes("ImageJ=1.53c\nimages=3\nchannels=3\n", 3), 3);
    }

    #[test]
    fn hyperstacks_run_through_channels_first() {
        let text =
            "ImageJ=1.53t\nimages=24\nchannels=2\nslices=4\nframes=3\nhyperstack=true\nspacing=2.5\nunit=\\u00B5m\n";
        let d = read(text, Some([4.0, 2.0]), 1);
        assert_eq!((spacing_of(&d), d.unit), (Some([0.25, 0.5, 2.5]), Some("micrometer")));
        let declared = d.declared.unwrap();
        assert_eq!(declared.page_axes, [Axis::T, Axis::Z, Axis::C]);
        assert_eq!((declared.z, declared.channels, declared.times, declared.planes()), (4, 2, 3, 24));
    }

    #[test]
    fn slices_go_first_if_the_order_says_so() {
        let of = |order: &str| read(&format!("ImageJ=1.53\nimages=4\nchannels=2\nslices=2\n{order}"), None, 1);
        for (order, axes) in [
            ("", [Axis::T, Axis::Z, Axis::C]),
            ("order=czt\n", [Axis::T, Axis::Z, Axis::C]),
            ("order=zct\n", [Axis::T, Axis::C, Axis::Z]),
        ] {
            assert_eq!(of(order).declared.unwrap().page_axes, axes, "{order}");
        }
        assert!(of("order=ctz\n").problem.unwrap().contains("the order 'ctz'"));
    }

    #[test]
    fn without_a_unit_the_printers_resolution_is_ignored() {
        let d = read("ImageJ=1.4\nimages=5\nspacing=-3\n", Some([72.0, 72.0]), 1);
        assert_eq!((spacing_of(&d), d.unit, d.declared.unwrap().z), (Some([1.0, 1.0, 3.0]), None, 5));
        assert_eq!(read("ImageJ=1.4\nimages=5\nunit=pixel\n", Some([72.0, 72.0]), 1).spacing, None);
        for spacing in ["inf", "-Infinity", "NaN", "0"] {
            let text = format!("ImageJ=1.4\nimages=5\nspacing={spacing}\n");
            assert_eq!(read(&text, None, 1).spacing, None, "{spacing}");
        }
        let odd = read("ImageJ=1.4\nimages=5\nunit=furlong\n", None, 1);
        assert!(odd.notes[0].contains("furlong"));
        assert!(is_warned(&said(&odd.notes), "furlong"));
    }

    #[test]
    fn y_and_z_have_units_of_their_own() {
        let of = |keys: &str| read(&format!("ImageJ=1.53t\nimages=5\nspacing=500\n{keys}"), Some([2.0, 0.002]), 1);
        let told = of("unit=micron\nyunit=nm\nzunit=nm\n");
        let Spacing { x, y, z } = told.spacing.unwrap();
        assert!(
            (x, told.unit) == (0.5, Some("micrometer")) && (y - 0.5).abs() < 1e-12 && (z.unwrap() - 0.5).abs() < 1e-12
        );
        assert_eq!(spacing_of(&of("unit=micron\nyunit=micron\nzunit=micron\n")), Some([0.5, 500.0, 500.0]));
        let odd = of("unit=micron\nzunit=ell\n");
        assert!(odd.spacing.unwrap().z.is_none() && odd.notes[0].contains("along z are in 'ell'"), "{:?}", odd.notes);
        assert!(is_warned(&said(&odd.notes), "along z are in 'ell'"));
        let odd = of("unit=ell\nyunit=nm\n");
        assert!(odd.spacing.is_none() && odd.notes[1].contains("along y are in 'nm'"), "{:?}", odd.notes);
    }

    #[test]
    fn frames_are_taken_when_the_description_says() {
        let of = |text: &str| read(text, None, 1);
        let axis = |step, unit: &str| Some(TimeAxis { step, unit: Some(unit.into()), ..TimeAxis::default() });
        let imagej = "ImageJ=1.53\nimages=6\nframes=3\nslices=2\n";
        assert_eq!(of(&format!("{imagej}finterval=0.25\n")).time, axis(0.25, "second"));
        assert_eq!(of(&format!("{imagej}finterval=0.25\ntunit=min\n")).time, axis(0.25, "minute"));
        assert_eq!((of(imagej).time, of(&format!("{imagej}finterval=0\n")).time), (None, None));
        assert_eq!(of("ImageJ=1.53\nimages=6\nfinterval=0.25\n").time, None);
        let bad = of(&format!("{imagej}finterval=-2\n"));
        assert!(bad.time.is_none() && bad.notes[0].contains("found -2"), "{:?}", bad.notes);
        assert!(is_warned(&said(&bad.notes), "found -2"));
        let odd = of(&format!("{imagej}finterval=2\ntunit=moon\n"));
        assert!(odd.time.is_some_and(|axis| axis.unit.is_none()) && odd.notes[0].contains("'moon'"), "{:?}", odd.notes);
        assert!(is_warned(&said(&odd.notes), "'moon'"));
    }

    #[test]
    fn the_display_range_is_that_of_one_channel() {
        let looks = |text: &str| read(text, None, 1).channel_looks;
        assert_eq!(looks("ImageJ=1.53\nimages=4\nmin=-2.5\nmax=900\n")[0].window, Some([-2.5, 900.0]));
        assert_eq!(looks("ImageJ=1.53\nimages=4\nmin=7\nmax=7\n"), []);
    }
}
