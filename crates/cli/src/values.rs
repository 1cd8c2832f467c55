//! Values on the command line: sizes in bytes, triples, pixels, boxes. Each parser's error states the expected form.

use brickyard::import::NoData;
use brickyard::volume::bounds::{LEAST_STEP, MOST_STEP, STEPS};
use brickyard::volume::{ClipPlane, Extent, Isosurface, Jitter, MeshLook, TransferFunction, VoxelBox};
use glam::DVec3;
use std::num::NonZeroUsize;

/// The most threads of a request: each takes memory for its stack and its part of the picture.
const MOST_THREADS: usize = 1024;

pub(crate) fn threads(text: &str) -> Result<NonZeroUsize, String> {
    let threads = text.parse().ok().filter(|threads: &NonZeroUsize| threads.get() <= MOST_THREADS);
    threads.ok_or_else(|| format!("expected a number of threads from 1 to {MOST_THREADS}"))
}

/// Reads a byte count: `64MiB`, `2GiB`, `1.5GiB`, `4096`; `MB` and `GB` are decimal.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let split = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let scale = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "kib" | "k" => 1024.0,
        "mib" | "m" => 1024.0 * 1024.0,
        "gib" | "g" => 1024.0 * 1024.0 * 1024.0,
        "tib" | "t" => 1024.0 * 1024.0 * 1024.0 * 1024.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        _ => return Err(format!("unknown unit '{unit}': expected KiB, MiB, GiB or TiB, as in 512MiB")),
    };
    let number: f64 = number.trim().parse().map_err(|_| format!("'{text}' is not a size: expected e.g. 512MiB"))?;
    let total = number * scale;
    if total >= 1.0 && total < u64::MAX as f64 {
        Ok(total as u64)
    } else {
        Err(format!("'{text}' is not a usable size"))
    }
}

fn list<T: std::str::FromStr, const N: usize>(text: &str, separator: char, form: &str) -> Result<[T; N], String> {
    let parts: Result<Vec<T>, _> = text.split(separator).map(|p| p.trim().parse::<T>()).collect();
    let parts = parts.map_err(|_| format!("'{text}': expected {form}"))?;
    parts.try_into().map_err(|_| format!("'{text}': expected {form}"))
}

/// Reads `X,Y,Z` as finite numbers.
pub(crate) fn vec3(text: &str) -> Result<DVec3, String> {
    let v = DVec3::from_array(list(text, ',', "three numbers X,Y,Z")?);
    if v.is_finite() { Ok(v) } else { Err(format!("'{text}': expected finite numbers")) }
}

/// Reads `X,Y,Z` as positive finite numbers.
pub(crate) fn spacing(text: &str) -> Result<DVec3, String> {
    vec3(text).and_then(|v| match v.cmpgt(DVec3::ZERO).all() {
        true => Ok(v),
        false => Err(format!("'{text}': every spacing must be positive")),
    })
}

/// Reads `X,Y,Z` or `XxYxZ` as voxel counts.
pub(crate) fn extent(text: &str) -> Result<Extent, String> {
    // Like the sizes of pictures.
    let separator = if text.contains('x') { 'x' } else { ',' };
    let n: [u32; 3] = list(text, separator, "three voxel counts X,Y,Z, each at most 4294967295")?;
    if n.contains(&0) {
        return Err(format!("'{text}': an axis of zero voxels holds nothing; every count must be at least 1"));
    }
    let extent = Extent::from_array(n);
    extent.checked_volume().ok_or_else(|| format!("'{text}': the product of the axes overflows 2^63 voxels"))?;
    Ok(extent)
}

/// Reads `WxH` in pixels.
pub(crate) fn size_px(text: &str) -> Result<(u32, u32), String> {
    let [w, h]: [u32; 2] = list(text, 'x', "WxH, as in 1280x720")?;
    if w == 0 || h == 0 || w > 16384 || h > 16384 {
        return Err(format!("'{text}': each side must be between 1 and 16384 pixels"));
    }
    Ok((w, h))
}

/// Reads `R,G,B`, each in 0..=1.
pub(crate) fn color(text: &str) -> Result<[f64; 3], String> {
    let c: [f64; 3] = list(text, ',', "three numbers R,G,B in 0..1")?;
    if c.iter().all(|v| (0.0..=1.0).contains(v)) { Ok(c) } else { Err(format!("'{text}': expected R,G,B in 0..1")) }
}

/// Reads `LOW:HIGH`.
pub(crate) fn window(text: &str) -> Result<[f64; 2], String> {
    let form = "LOW:HIGH, two finite numbers, the lesser first";
    let [low, high] = list(text, ':', form)?;
    if low < high && f64::is_finite(high - low) { Ok([low, high]) } else { Err(format!("'{text}': expected {form}")) }
}

/// Points of a transfer function's gradient opacity.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GradientOpacity(pub(crate) Vec<[f64; 2]>);

/// Reads `MAGNITUDE:FACTOR,MAGNITUDE:FACTOR,...`.
pub(crate) fn gradient_opacity(text: &str) -> Result<GradientOpacity, String> {
    let form = "MAGNITUDE:FACTOR,MAGNITUDE:FACTOR,..., as in 20:0,60:1";
    let points: Result<Vec<[f64; 2]>, _> = text.split(',').map(|point| list(point, ':', form)).collect();
    let points = points.map_err(|_| format!("'{text}': expected {form}"))?;
    let transfer = TransferFunction { gradient_opacity: points.clone(), ..TransferFunction::default() };
    transfer.validate().map_err(|error| format!("'{text}': {error}"))?;
    Ok(GradientOpacity(points))
}

/// Reads `VALUE[,opacity=A][,color=R:G:B]`.
pub(crate) fn isosurface(text: &str) -> Result<Isosurface, String> {
    let form = "VALUE[,opacity=A][,color=R:G:B], as in 300,opacity=0.4,color=1:0.8:0.6";
    let mut parts = text.split(',');
    let value = parts.next().and_then(|value| value.trim().parse().ok());
    let mut surface = Isosurface::at(value.ok_or_else(|| format!("'{text}': expected {form}"))?);
    for part in parts {
        match part.split_once('=').map(|(key, value)| (key.trim(), value.trim())) {
            Some(("opacity", opacity)) => {
                surface.opacity = opacity.parse().map_err(|_| format!("'{opacity}': expected an opacity in 0..1"))?;
            }
            Some(("color", rgb)) => surface.color = Some(color(&rgb.replace(':', ","))?),
            _ => return Err(format!("'{part}': expected {form}")),
        }
    }
    Ok(surface)
}

/// Reads `x0:x1,y0:y1,z0:z1` in voxels of the level, half-open.
pub(crate) fn voxel_box(text: &str) -> Result<VoxelBox, String> {
    let ends: [[u32; 2]; 3] = box_ends(text, "x0:x1,y0:y1,z0:z1 in voxels, ends excluded")?;
    Ok(VoxelBox::new(ends.map(|e| e[0]), ends.map(|e| e[1])))
}

/// Reads axes, `x`, `y`, `z`, separated by commas.
pub(crate) fn flip(text: &str) -> Result<[bool; 3], String> {
    let mut flip = [false; 3];
    if text == "none" {
        return Ok(flip);
    }
    for letter in text.split(',').map(str::trim) {
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == letter);
        let Some(axis) = axis.filter(|axis| !flip[*axis]) else {
            return Err(format!("'{text}': expected some of x, y, z, each once, with commas between them, as in x,z"));
        };
        flip[axis] = true;
    }
    Ok(flip)
}

/// Reads `X0:X1,Y0:Y1,Z0:Z1`: two corners, in any unit.
pub(crate) fn corners(text: &str) -> Result<[DVec3; 2], String> {
    let ends: [[f64; 2]; 3] = box_ends(text, "X0:X1,Y0:Y1,Z0:Z1")?;
    let corners = [0, 1].map(|i| DVec3::from_array(ends.map(|end| end[i])));
    if corners.iter().all(|corner| corner.is_finite()) {
        Ok(corners)
    } else {
        Err(format!("'{text}': expected finite numbers"))
    }
}

/// Reads `X,Y,Z:NX,NY,NZ`: a point of a plane and its normal.
pub(crate) fn plane(text: &str) -> Result<ClipPlane, String> {
    let form = "X,Y,Z:NX,NY,NZ, a point and a normal";
    let parts: [String; 2] = list(text, ':', form)?;
    let vector = |part: &String| list(part, ',', form).map_err(|_| format!("'{text}': expected {form}"));
    let plane = ClipPlane { point: vector(&parts[0])?.into(), normal: vector(&parts[1])?.into() };
    plane.normalized().map(|_| plane).map_err(|error| format!("'{text}': {error}"))
}

/// Reads `FILE[,color=R:G:B][,opacity=A][,unlit]`: a mesh and its look. Commas before anything else belong to the name.
pub(crate) fn mesh(text: &str) -> Result<MeshLook, String> {
    let mut look = MeshLook::new("");
    let mut name = text;
    while let Some((before, word)) = name.rsplit_once(',') {
        let bad = || format!("'{word}' of '{text}': expected color=R:G:B or opacity=A, each number in 0..1, or unlit");
        match word.split_once('=') {
            Some(("color", rgb)) => look.color = Some(color(&rgb.replace(':', ",")).map_err(|_| bad())?),
            Some(("opacity", share)) => {
                let opacity = share.parse().ok().filter(|share| (0.0..=1.0).contains(share));
                look.opacity = opacity.ok_or_else(bad)?;
            }
            None if word == "unlit" => look.lit = false,
            _ => break,
        }
        name = before;
    }
    look.path = name.into();
    Ok(look)
}

fn box_ends<T: std::str::FromStr + PartialOrd>(text: &str, form: &str) -> Result<[[T; 2]; 3], String> {
    let axes: [String; 3] = list(text, ',', form)?;
    let ends = axes.into_iter().map(|part| match list(&part, ':', form)? {
        [low, high] if low < high => Ok([low, high]),
        [_, _] => Err(format!("'{part}' in '{text}' is empty: expected {form}")),
    });
    let ends: Vec<[T; 2]> = ends.collect::<Result<_, String>>()?;
    ends.try_into().map_err(|_| format!("'{text}': expected {form}"))
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
        _ => Err(format!("'{text}': expected a positive number")),
    }
}

/// Reads a step of rays, in voxels.
pub(crate) fn step(text: &str) -> Result<f64, String> {
    let step = text.parse().ok().filter(|step| STEPS.contains(step));
    step.ok_or_else(|| {
        format!("'{text}': expected {LEAST_STEP} to {MOST_STEP} voxels; 1 takes a sample in each voxel, 0.5 two")
    })
}

/// Reads labels, separated by commas.
pub(crate) fn labels(text: &str) -> Result<Vec<i64>, String> {
    let label = |part: &str| part.trim().parse();
    let labels: Result<Vec<i64>, _> = text.split(',').map(label).collect();
    labels.map_err(|_| format!("'{text}': expected labels, whole numbers with commas between them, as in 3,7"))
}

/// Reads `none`, or the finite value of voxels without data.
pub(crate) fn nodata(text: &str) -> Result<NoData, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    // Zero has no sign.
    let value = value.map(|value| NoData::Value(value + 0.0));
    let value = if text == "none" { Some(NoData::None) } else { value };
    value.ok_or_else(|| format!("'{text}': expected a finite number, or none (NaN and infinities hold no data anyway)"))
}

/// Reads `none`, `white`, `white:SEED` or `blue`.
pub(crate) fn jitter(text: &str) -> Result<Jitter, String> {
    let seed = |text: &str| text.parse().ok().map(Jitter::White);
    let jitter = match text {
        "none" => Some(Jitter::None),
        "white" => Some(Jitter::White(0)),
        "blue" => Some(Jitter::Blue),
        _ => text.strip_prefix("white:").and_then(seed),
    };
    jitter.ok_or_else(|| format!("'{text}': expected none, white, white:SEED with a whole number, or blue"))
}

/// Formats a byte count for people: `1.5 GiB`.
pub(crate) fn human_bytes(bytes: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < units.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.1} {}", units[unit]) }
}

/// Formats a coordinate without the last digits, which are noise of additions.
pub(crate) fn short(coordinate: f64) -> String {
    let rounded = format!("{coordinate:.11e}").parse::<f64>();
    rounded.unwrap_or(coordinate).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_take_units() {
        assert_eq!(bytes("16MiB"), Ok(16 << 20));
        assert_eq!(bytes("1.5GiB"), Ok(3 << 29));
        assert_eq!(bytes("4096"), Ok(4096));
        let (k, kib) = (1000u64, 1024u64);
        for (unit, expected) in [
            ("", 1),
            ("b", 1),
            ("B", 1),
            ("k", kib),
            ("KiB", kib),
            ("kib", kib),
            ("KB", k),
            ("kB", k),
            ("M", kib.pow(2)),
            ("MiB", kib.pow(2)),
            ("MB", k.pow(2)),
            ("g", kib.pow(3)),
            ("GiB", kib.pow(3)),
            ("GB", k.pow(3)),
            ("T", kib.pow(4)),
            ("TiB", kib.pow(4)),
            ("tb", k.pow(4)),
        ] {
            assert_eq!(bytes(&format!("3{unit}")), Ok(3 * expected), "{unit}");
        }
        assert!(bytes("12 parsecs").unwrap_err().contains("parsecs"));
        assert!(bytes("-1MiB").is_err() && bytes("0").is_err() && bytes("MiB").is_err());
        assert_eq!([human_bytes(1), human_bytes(3 << 29)], ["1 B", "1.5 GiB"]);
    }

    #[test]
    fn shapes_refuse_zero_and_overflow() {
        assert_eq!(extent("3,4,5"), Ok(Extent::new(3, 4, 5)));
        assert!(extent("3,0,5").unwrap_err().contains("zero"));
        assert!(extent("4294967295,4294967295,9").unwrap_err().contains("overflows"));
        assert!(extent("3,4").unwrap_err().contains("X,Y,Z"));
    }

    #[test]
    fn gradient_opacity_is_a_curve_over_magnitudes() {
        let found = gradient_opacity("0:0, 50:0,120.5:1");
        assert_eq!(found, Ok(GradientOpacity(vec![[0.0, 0.0], [50.0, 0.0], [120.5, 1.0]])));
        for bad in ["", "5", "5:0,", "5:0,4:1", "-1:0", "0:nan", "inf:1", "0:1.5", "0:0:1"] {
            assert!(gradient_opacity(bad).unwrap_err().starts_with(&format!("'{bad}': ")), "{bad}");
        }
    }

    #[test]
    fn boxes_are_half_open_and_not_empty() {
        assert_eq!(voxel_box("0:2,1:3,5:9"), Ok(VoxelBox::new([0, 1, 5], [2, 3, 9])));
        assert!(voxel_box("0:2,3:3,5:9").unwrap_err().contains("empty"));
        assert!(voxel_box("0:2,3").is_err());
        assert_eq!(corners("-1:2,1.5:3,5:9"), Ok([DVec3::new(-1.0, 1.5, 5.0), DVec3::new(2.0, 3.0, 9.0)]));
        assert!(corners("0:2,3:1,5:9").unwrap_err().contains("empty"));
        assert!(corners("0:nan,0:1,5:9").is_err() && corners("0:inf,0:1,5:9").is_err());
    }

    #[test]
    fn flipped_axes_are_named_once() {
        assert_eq!(
            [flip("x"), flip("z,x"), flip("x, y,z"), flip("none")],
            [[true, false, false], [true, false, true], [true; 3], [false; 3]].map(Ok)
        );
        for bad in ["", "w", "x,x", "xy", "0", "X"] {
            assert!(flip(bad).unwrap_err().contains("x, y, z"), "{bad}");
        }
    }

    #[test]
    fn planes_have_a_point_and_a_normal() {
        let expected = ClipPlane { point: DVec3::new(1.0, -2.0, 3.5), normal: DVec3::new(0.0, 0.0, -2.0) };
        assert_eq!(plane("1,-2,3.5:0,0,-2"), Ok(expected));
        for bad in ["1,2,3", "1,2,3:0,0", "1,2,3:0,0,0", "1,2,nan:0,0,1", "1,2,3:0,inf,1", "1,2,3:a,0,1", "1:2:3"] {
            assert!(plane(bad).unwrap_err().contains(bad), "{bad}");
        }
    }

    #[test]
    fn jitter_has_a_kind_and_may_have_a_seed() {
        let found = ["none", "white", "white:77", "blue"].map(jitter);
        assert_eq!(found, [Jitter::None, Jitter::White(0), Jitter::White(77), Jitter::Blue].map(Ok));
        for bad in ["", "red", "white:", "white:-1", "blue:3"] {
            assert!(jitter(bad).unwrap_err().contains("white:SEED"), "{bad}");
        }
    }

    #[test]
    fn no_data_is_a_value_or_none() {
        let found = ["-2000", "1e20", "none"].map(nodata);
        assert_eq!(found, [NoData::Value(-2000.0), NoData::Value(1e20), NoData::None].map(Ok));
        for bad in ["", "abc", "nan", "-inf", "1,2", "None"] {
            assert!(nodata(bad).unwrap_err().contains("expected a finite number, or none"), "{bad}");
        }
    }

    #[test]
    fn meshes_have_a_file_and_looks() {
        assert_eq!(mesh("a, b=c.stl"), Ok(MeshLook::new("a, b=c.stl")));
        let expected = MeshLook { color: Some([1.0, 0.5, 0.0]), opacity: 0.25, ..MeshLook::new("d/a.stl") };
        assert_eq!(mesh("d/a.stl,opacity=0.25,color=1:0.5:0"), Ok(expected.clone()));
        assert_eq!(mesh("d/a.stl,color=1:0.5:0,unlit,opacity=0.25"), Ok(MeshLook { lit: false, ..expected }));
        for bad in ["a.stl,opacity=2", "a.stl,opacity=nan", "a.stl,color=1,2,3", "a.stl,color=1:2", "a.stl,color=0:0:7"]
        {
            let found = mesh(bad);
            assert!(found.is_err() || found == Ok(MeshLook::new(bad)), "{bad}: {found:?}");
        }
        assert!(mesh("a.stl,opacity=2").unwrap_err().contains("opacity=2"));
    }

    #[test]
    fn numbers_must_be_usable() {
        assert!(spacing("1,-1,1").is_err() && vec3("1,nan,1").is_err() && positive("0").is_err());
        assert!(color("0,0,2").is_err() && size_px("0x5").is_err());
        assert_eq!(size_px("640x480"), Ok((640, 480)));
    }

    #[test]
    fn coordinates_have_no_noise_in_their_last_digits() {
        let found = [67.0 * 0.3, -0.1 - 0.2, 0.0, 1e-7, 123456.75].map(short);
        assert_eq!(found, ["20.1", "-0.3", "0", "0.0000001", "123456.75"]);
    }
}
