//! Message about a raw file of another size than its layout, with shapes and types that would fit.

use super::RawLayout;
use crate::element::Element;
use brickyard_volume::{Extent, counted};

/// A file's size unlike its layout's.
pub(super) struct Misfit<'a> {
    pub(super) layout: &'a RawLayout,
    /// Bytes up to the last voxel, by the layout.
    pub(super) end: u64,
    pub(super) found: u64,
}

impl Misfit<'_> {
    /// Expectation, finding, and the ways to settle it.
    pub(super) fn message(&self) -> String {
        let Self { layout, end, found } = *self;
        let RawLayout { extent, element, offset, channels, times, .. } = *layout;
        let surplus = found.saturating_sub(end);
        let difference = match surplus {
            0 => format!("{} too few", end - found),
            _ => format!("{surplus} too many"),
        };
        let mut what = format!("{extent} {element}");
        for (n, name) in [(channels, "channel"), (times, "time step")] {
            if n > 1 {
                what += &format!(" with {}", counted(n.into(), name));
            }
        }
        if offset > 0 {
            what += &format!(" after {}", counted(offset, "byte"));
        }
        let mut message = format!("expected {} for {what}, found {found} ({difference})", counted(end, "byte"));
        let fits = self.fits();
        if !fits.is_empty() {
            message += &format!("; would fit: {}", fits.join("; "));
        }
        if surplus > 0 {
            let header = surplus + offset;
            let bytes = counted(header, "byte");
            message += &format!("; if the file starts with a header of {bytes}, pass `offset` {header}");
            let steps = u64::from(times);
            if steps > 1 && surplus.is_multiple_of(steps) && !self.lies_apart() {
                let (own, each) = (surplus / steps, (end - offset) / steps);
                message +=
                    &format!("; if each step has {} more, pass `step_bytes` {}", counted(own, "byte"), each + own);
                message += " and as `offset` those before its voxels";
            }
            message += &format!("; to leave out all behind the voxels, pass `offset` {offset}");
        }
        message
    }

    fn lies_apart(&self) -> bool {
        self.layout.step_bytes.is_some() || self.layout.channel_bytes.is_some()
    }

    /// Shapes and types near the given ones that the file would hold exactly.
    fn fits(&self) -> Vec<String> {
        let (layout, found) = (self.layout, self.found);
        let body = found.checked_sub(layout.offset).filter(|&n| n > 0 && !self.lies_apart());
        let Some(body) = body else { return Vec::new() };
        let Extent { x, y, z } = layout.extent;
        let sets = u128::from(layout.channels) * u128::from(layout.times);
        let mut fits = Vec::new();
        let (body, voxels) = (u128::from(body), u128::from(layout.extent.volume()) * sets);
        let types: Vec<&str> = Element::all()
            .filter(|t| *t != layout.element && voxels * t.bytes() as u128 == body)
            .map(Element::name)
            .collect();
        if !types.is_empty() {
            fits.push(format!("{} {}", layout.extent, types.join(" or ")));
        }
        let plane = u128::from(x) * u128::from(y) * sets * layout.element.bytes() as u128;
        if body.is_multiple_of(plane) && body / plane <= u128::from(u32::MAX) {
            fits.push(format!("{x},{y},{} {}", body / plane, layout.element));
        }
        let step = plane * u128::from(z) / u128::from(layout.times);
        if body.is_multiple_of(step) && body > step && layout.channels == 1 {
            fits.push(format!("{} {} with {} time steps", layout.extent, layout.element, body / step));
        }
        for (bytes, names) in [(1, "u8"), (2, "u16 or i16"), (4, "f32, u32 or i32"), (8, "f64, i64 or u64")] {
            let edge = ((body / bytes) as f64).cbrt().round() as u128;
            if edge > 0 && edge.checked_pow(3).and_then(|n| n.checked_mul(bytes)) == Some(body) {
                fits.push(format!("{edge},{edge},{edge} {names}"));
            }
        }
        fits
    }
}
