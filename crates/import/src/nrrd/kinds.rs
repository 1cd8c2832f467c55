//! The meaning of each axis, from `kinds` and `space directions`: space, time, or components, which become channels.

use super::header::Header;
use crate::axes::{Axis, AxisOrder, Sizes};
use crate::error::Result;
use crate::note::Note;
use brickyard_volume::{ChannelLook, counted};

const KINDS: &str = "say in `kinds` which axes are space, time and list, one word for each axis";

const X_Y: &[&str] = &["x", "y"];
const X_Y_Z: &[&str] = &["x", "y", "z"];
const RGBA: &[&str] = &["red", "green", "blue", "alpha"];
const MATRIX_2: &[&str] = &["xx", "xy", "yx", "yy"];
const MATRIX_3: &[&str] = &["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"];

/// Kinds of components: their word, their number (0 for any), and their names.
const COMPONENTS: &[(&str, u32, &[&str])] = &[
    ("list", 0, &[]),
    ("point", 0, X_Y_Z),
    ("vector", 0, X_Y_Z),
    ("covariant-vector", 0, X_Y_Z),
    ("normal", 0, X_Y_Z),
    ("stub", 1, &[]),
    ("scalar", 1, &[]),
    ("complex", 2, &["real", "imaginary"]),
    ("2-vector", 2, X_Y),
    ("3-color", 3, &[]),
    ("rgb-color", 3, RGBA),
    ("hsv-color", 3, &["hue", "saturation", "value"]),
    ("xyz-color", 3, &["X", "Y", "Z"]),
    ("4-color", 4, &[]),
    ("rgba-color", 4, RGBA),
    ("3-vector", 3, X_Y_Z),
    ("3-gradient", 3, X_Y_Z),
    ("3-normal", 3, X_Y_Z),
    ("4-vector", 4, &[]),
    ("quaternion", 4, &["w", "x", "y", "z"]),
    ("2d-symmetric-matrix", 3, &["xx", "xy", "yy"]),
    ("2d-masked-symmetric-matrix", 4, &["mask", "xx", "xy", "yy"]),
    ("2d-matrix", 4, MATRIX_2),
    ("2d-masked-matrix", 5, &["mask", "xx", "xy", "yx", "yy"]),
    ("3d-symmetric-matrix", 6, &["xx", "xy", "xz", "yy", "yz", "zz"]),
    ("3d-masked-symmetric-matrix", 7, &["mask", "xx", "xy", "xz", "yy", "yz", "zz"]),
    ("3d-matrix", 9, MATRIX_3),
    ("3d-masked-matrix", 10, &["mask", "xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"]),
];

/// An axis' word in `kinds`.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Unknown,
    Space,
    Domain,
    Time,
    Components(u32, &'static [&'static str]),
}

/// The array's axes by their meaning, as places in `sizes`.
pub(super) struct Axes {
    /// Axes along x, y, z: three or fewer, fastest first.
    pub(super) space: Vec<usize>,
    pub(super) time: Option<usize>,
    channel: Option<usize>,
    names: &'static [&'static str],
    sizes: Vec<u32>,
}

impl Axes {
    /// Assigns each axis its meaning; adds a note where it is not said in so many words.
    pub(super) fn of(header: &Header, sizes: &[u32], notes: &mut Vec<Note>) -> Result<Self> {
        let kinds = kinds_of(header, sizes)?;
        let directions = directions_of(header, sizes.len())?;
        let is_unsaid = directions.is_none() && kinds.iter().all(|kind| *kind == Kind::Unknown);
        let mut axes = Self { space: Vec::new(), time: None, channel: None, names: &[], sizes: sizes.to_vec() };
        for (i, kind) in kinds.into_iter().enumerate() {
            let has_direction = directions.as_ref().map(|directions| directions.get(i) == Some(&true));
            match (kind, has_direction) {
                (Kind::Components(..), Some(true)) => {
                    let problem = format!("axis {i} has components by its kind, but a direction in space: correct one");
                    return Err(header.invalid(problem));
                }
                (Kind::Space, Some(false)) => {
                    return Err(header.invalid(format!("axis {i} is of kind space, but has no space direction")));
                }
                (Kind::Components(_, names), _) => axes.set_channel(header, i, names)?,
                (Kind::Time, _) => axes.set_time(header, i)?,
                (Kind::Domain, Some(false)) => {
                    axes.set_time(header, i)?;
                    let note = format!("Axis {i} is a domain outside space: its samples are read as time steps.");
                    notes.push(Note::warning(note));
                }
                (_, Some(true)) | (Kind::Space | Kind::Domain, None) => axes.space.push(i),
                (Kind::Unknown, None) if is_unsaid => axes.space.push(i),
                (Kind::Unknown, _) if sizes.get(i) == Some(&1) => {}
                (Kind::Unknown, _) => {
                    return Err(header.unsupported(format!("axis {i} without a kind beside others with one"), KINDS));
                }
            }
        }
        axes.split_time(header, is_unsaid, notes)?;
        Ok(axes)
    }

    /// Takes a fourth axis in space as time, as ITK's readers of time series do.
    fn split_time(&mut self, header: &Header, is_unsaid: bool, notes: &mut Vec<Note>) -> Result<()> {
        let count = self.space.len();
        if is_unsaid && count > 3 {
            return Err(header.unsupported(format!("an array of {count} axes without `kinds`"), KINDS));
        }
        match (count, self.time) {
            (0, _) => Err(header.unsupported("an array without an axis in space", KINDS)),
            (1..=3, _) => Ok(()),
            (4, None) => {
                self.time = self.space.pop();
                let place = self.time.unwrap_or_default();
                let note = format!("Axis {place} is a fourth one in space: its samples are read as time steps.");
                notes.push(Note::warning(note));
                Ok(())
            }
            _ => Err(header.unsupported(format!("an array of {count} axes in space"), KINDS)),
        }
    }

    fn set_time(&mut self, header: &Header, axis: usize) -> Result<()> {
        match self.time.replace(axis) {
            Some(other) => Err(header.unsupported(format!("two axes of time ({other} and {axis})"), KINDS)),
            None => Ok(()),
        }
    }

    fn set_channel(&mut self, header: &Header, axis: usize, names: &'static [&'static str]) -> Result<()> {
        self.names = names;
        match self.channel.replace(axis) {
            Some(other) => Err(header.unsupported(format!("two axes of components ({other} and {axis})"), KINDS)),
            None => Ok(()),
        }
    }

    /// The order of the axes, slowest first, and the sizes in it. Axes of one sample without a meaning are left out.
    pub(super) fn arranged(&self) -> (AxisOrder, Sizes) {
        let letter = |i: usize| match self.space.iter().position(|axis| *axis == i) {
            Some(place) => [Axis::X, Axis::Y, Axis::Z].get(place).copied(),
            None if self.time == Some(i) => Some(Axis::T),
            None => (self.channel == Some(i)).then_some(Axis::C),
        };
        let known = self.sizes.iter().enumerate().rev().filter_map(|(i, size)| Some((letter(i)?, *size)));
        let (order, sizes): (Vec<Axis>, Vec<u32>) = known.unzip();
        (AxisOrder::of(&order), Sizes::from_ordered(&order, &sizes))
    }

    /// Names of the components, in their colours; none for a list.
    pub(super) fn looks(&self) -> Vec<ChannelLook> {
        let count = self.channel.and_then(|i| self.sizes.get(i)).map_or(1, |n| *n as usize);
        if self.names.is_empty() || count > self.names.len() {
            return Vec::new();
        }
        let color = |name: &str| match name {
            "red" => Some([255, 0, 0]),
            "green" => Some([0, 255, 0]),
            "blue" => Some([0, 0, 255]),
            "alpha" => Some([0; 3]),
            _ => None,
        };
        let look =
            |name: &&str| ChannelLook { name: Some((*name).to_owned()), color: color(name), window: None, unit: None };
        self.names.iter().take(count).map(look).collect()
    }
}

fn kinds_of(header: &Header, sizes: &[u32]) -> Result<Vec<Kind>> {
    let Some(words) = header.words("kinds")? else { return Ok(vec![Kind::Unknown; sizes.len()]) };
    let kind = |(word, size): (&str, &u32)| {
        let lower = word.to_lowercase();
        let kind = match &*lower {
            "none" | "???" => Kind::Unknown,
            "space" => Kind::Space,
            "domain" => Kind::Domain,
            "time" => Kind::Time,
            _ => {
                let known = COMPONENTS.iter().find(|(name, ..)| *name == lower);
                let (_, count, names) = known.ok_or_else(|| header.unsupported(format!("the kind {word}"), KINDS))?;
                Kind::Components(*count, names)
            }
        };
        match kind {
            Kind::Components(count, _) if count != 0 && count != *size => Err(header.invalid(format!(
                "an axis of kind {word} has {}, but its size is {size}",
                counted(count.into(), "sample")
            ))),
            kind => Ok(kind),
        }
    };
    words.into_iter().zip(sizes).map(kind).collect()
}

/// Whether each axis has a direction in space; `None` if the header gives no directions.
fn directions_of(header: &Header, dimension: usize) -> Result<Option<Vec<bool>>> {
    let Some(vectors) = header.vectors("spacedirections")? else { return Ok(None) };
    if vectors.len() != dimension {
        return Err(header.not_valid("spacedirections"));
    }
    Ok(Some(vectors.iter().map(Option::is_some).collect()))
}
