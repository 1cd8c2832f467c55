//! ImageJ's description of a TIFF stack: lines of `key=value` in the first page, and its private tags of look-up tables and display ranges.

use crate::error::ExportError;
use crate::facts::{Fact, moment, value_unit};
use crate::frame::{Frame, length_unit};
use crate::plan::{Body, Plan};
use crate::tiff::{Arranged, Field, Tags, arrange, fraction, nodata_field};
use crate::volume::Volume;
use brickyard_volume::{ChannelLook, VoxelType, channel, time_symbol};
use std::fmt::Write;

/// Most channels shown at once by ImageJ.
const MOST_COMPOSED: u32 = 7;
/// Added by ImageJ to signed 16-bit numbers, which it holds as unsigned ones.
const SIGNED_OFFSET: f64 = 32768.0;
const BIG: &str = "The file is BigTIFF, past 4 GiB: ImageJ itself does not open it; Bio-Formats in Fiji does, but takes every length for µm: .ome.tif keeps the unit there.";
/// ImageJ's private tags: lengths of the head and each block of the second, which has the head and the blocks.
const BYTE_COUNTS: u16 = 50838;
const METADATA: u16 = 50839;

pub(crate) fn plan(volume: &Volume) -> Result<Plan, ExportError> {
    let Described { tags, kept, notes } = describe(volume);
    let Arranged { layout, is_big } = arrange(volume, tags)?;
    let notes = notes.into_iter().chain(is_big.then(|| BIG.to_owned()));
    Ok(Plan::new(volume, "ImageJ's TIFF", &kept, Body::Flat(layout)).noted(notes))
}

/// A description, and the facts in it.
struct Described {
    tags: Tags,
    kept: Vec<Fact>,
    notes: Vec<String>,
}

/// Describes a volume as ImageJ does.
fn describe(volume: &Volume) -> Described {
    let info = volume.info;
    let (mut kept, mut notes) = (Vec::new(), Vec::new());
    let mut text = String::from("ImageJ=1.54f\n");
    let mut line = |key: &str, value: &str| writeln!(text, "{key}={value}").expect("a string takes all");
    let [c, z, t] = [info.channels, info.extent.z, info.times];
    let images = u64::from(c) * u64::from(z) * u64::from(t);
    let counts = [("images", images), ("channels", c.into()), ("slices", z.into()), ("frames", t.into())];
    counts.iter().filter(|(_, count)| *count > 1).for_each(|(key, count)| line(key, &count.to_string()));
    if images > 1 && (c > 1 || t > 1) {
        line("hyperstack", "true");
    }
    if c > 1 {
        line("mode", if c <= MOST_COMPOSED { "composite" } else { "color" });
    }
    let frame = Frame::of(info);
    let mut resolution = [(1, 1); 2];
    // Without a unit, ImageJ counts pixels.
    if let Some(unit) = length_unit(info).filter(|_| info.calibrated)
        && let [Some(x), Some(y)] = [fraction(frame.spacing.x), fraction(frame.spacing.y)]
    {
        resolution = [x, y].map(|(above, below)| (below, above));
        line("unit", if unit.name == "micrometer" { "micron" } else { unit.symbol() });
        line("spacing", &frame.spacing.z.to_string());
        kept.extend([Fact::Spacing, Fact::LengthUnit]);
    }
    if let Some(axis) = info.time.as_ref().filter(|axis| t > 1 && axis.stamps.is_empty())
        && let Some(unit) = &axis.unit
    {
        line("finterval", &axis.step.to_string());
        if unit != "second" {
            line("tunit", time_symbol(unit));
        }
        kept.extend([Fact::Times, Fact::TimeUnit]);
        // Its times begin at 0, so that those from elsewhere count from another moment.
        if let Some(since) = moment(volume).filter(|_| axis.start == 0.0) {
            line("time_since", since);
            kept.push(Fact::Since);
        }
        if axis.start != 0.0 {
            notes.push(format!(
                "ImageJ counts times from 0: that of the first step, {}, is left out.",
                axis.in_words(axis.start)
            ));
        }
    }
    if let Some(unit) = value_unit(volume) {
        // ImageJ stores signed numbers with an offset.
        line("cf", "0");
        line("c0", &(if info.voxel_type == VoxelType::I16 { -SIGNED_OFFSET } else { 0.0 }).to_string());
        line("c1", "1");
        line("vunit", unit);
        kept.push(Fact::ValueUnit);
    }
    let shown = |look: &ChannelLook| look.window.and_then(|window| display_range(window, info.voxel_type));
    let windows: Vec<[f64; 2]> = info.channel_looks.iter().filter_map(shown).collect();
    if let ([[low, high]], 1) = (&windows[..], c) {
        line("min", &low.to_string());
        line("max", &high.to_string());
    }
    line("loop", "false");
    let mut first = Vec::new();
    if info.nodata.is_some() {
        kept.push(Fact::NoData);
        first.extend(nodata_field(volume));
    }
    let has_colors = info.channel_looks.iter().any(|look| look.color.is_some());
    let windows = if c > 1 && windows.len() == c as usize { windows } else { Vec::new() };
    first.extend(metadata(volume, &windows, has_colors));
    kept.extend(has_colors.then_some(Fact::ChannelColors));
    notes.extend(frame.contradiction(info));
    notes.extend(misread(info.voxel_type).map(str::to_owned));
    Described { tags: Tags { resolution, description: text, first }, kept, notes }
}

/// A window as ImageJ counts it: of signed 16-bit numbers with its offset. `None` of signed bytes, which it shows as unsigned.
fn display_range(window: [f64; 2], voxel_type: VoxelType) -> Option<[f64; 2]> {
    match voxel_type {
        VoxelType::I8 => None,
        VoxelType::I16 => Some(window.map(|end| end + SIGNED_OFFSET)),
        _ => Some(window),
    }
}

/// A sentence on values that ImageJ itself shows otherwise than the file has them.
fn misread(voxel_type: VoxelType) -> Option<&'static str> {
    match voxel_type {
        VoxelType::I8 => {
            Some("ImageJ shows signed bytes as unsigned ones: the file's own type is right for other programs.")
        }
        VoxelType::I32 => Some("ImageJ rounds whole numbers past 16,777,216 to 24 bits; other programs read all."),
        VoxelType::U32 => Some(
            "ImageJ rounds whole numbers past 16,777,216 to 24 bits, and takes those from 2,147,483,648 on for negative ones; other programs read all.",
        ),
        _ => None,
    }
}

/// Look-up tables and display ranges, as two fields; none if there is neither.
fn metadata(volume: &Volume, windows: &[[f64; 2]], has_colors: bool) -> Vec<Field> {
    let channels = volume.info.channels as usize;
    // Bytes of the file's order, which is little: kinds and counts are its numbers.
    let kind = |letters: &[u8; 4], count: usize| {
        [u32::from_be_bytes(*letters).to_le_bytes(), (count as u32).to_le_bytes()].concat()
    };
    let (mut head, mut blocks) = (b"JIJI".to_vec(), Vec::new());
    if !windows.is_empty() {
        head.extend(kind(b"rang", 1));
        blocks.push(windows.iter().flatten().flat_map(|number| number.to_le_bytes()).collect());
    }
    if has_colors {
        head.extend(kind(b"luts", channels));
        let looks = &volume.info.channel_looks;
        let color = |i: usize| looks.get(i).and_then(|look| look.color).unwrap_or(channel::default_color(i, channels));
        blocks.extend((0..channels).map(|i| table(color(i))));
    }
    if blocks.is_empty() {
        return Vec::new();
    }
    let lengths: Vec<u32> = [&head].into_iter().chain(&blocks).map(|block: &Vec<u8>| block.len() as u32).collect();
    let bytes = [vec![head], blocks].concat().concat();
    vec![Field::longs(BYTE_COUNTS, &lengths), Field::bytes(METADATA, bytes)]
}

/// A look-up table from black to a colour.
fn table(color: [u8; 3]) -> Vec<u8> {
    let part = |part: u8| (0..256).map(move |i| ((u32::from(part) * i + 127) / 255) as u8);
    color.into_iter().flat_map(part).collect()
}
