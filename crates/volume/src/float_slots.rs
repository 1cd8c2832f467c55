//! Slots and transfer tables for the window of a look: f32 slots, for so narrow a part of a 32-bit channel that 16-bit codes over the whole channel
//! are too coarse; and tables over few codes.
//!
//! The rule: a layer has 16-bit codes if a code is under a 510th of its look's *window*, so that rounding moves a value by less than a 1020th of it,
//! a quarter of a display code. Otherwise it has f32 slots, as always where gradients are classified, since they may be slight in any window. Outside
//! the window, the look is constant: colours, opacities, and isovalues all lie in it.
//!
//! F32 slots depend on the window's rough position only, so a window is dragged or stretched without uploading a brick again: a slot holds the value
//! less a *base*, as an f32. The base is 0 for floats, so nothing is lost. For integers it is near the window, and f32 rounding affects only values
//! far from there. The transfer table covers the window, with a margin; renderers map slots to its codes as they read them, and codes past its ends
//! are as good as those at the ends.
//!
//! Slots with codes have a table over all codes, or over those of a *narrow* window. The latter has many entries per code, for anything may be shown
//! between two codes, and renderers read voxel by voxel, as hardware filters weigh by 8 bits of fraction and may round to whole 16-bit codes. A
//! narrow window has less than 128 codes of 8 bits or 512 of 16, or less than half of the channel's values: beside a voxel of 255 in a mask of 0 and
//! 1, those 8 bits are a code. Here, too, a window is dragged or stretched without uploading a brick.

use crate::expression::{GREATEST_WHOLE, Operand};
use crate::gradients::STEEPEST_UNITS;
use crate::mode::Mode;
use crate::slot_encoding::{FloatSlots, MOST, SlotEncoding, SlotFormat};
use crate::surface::{FLAT_CODES, Isosurface};
use crate::transfer::TransferFunction;
use crate::voxel_type::VoxelType;

/// Greatest width of a 16-bit code, as a share of the window.
const SHARE: f64 = 1.0 / 510.0;

/// How many times finer than needed 16-bit codes must be to replace present f32 slots; prevents going back and forth as a window is dragged or
/// stretched.
const SURPLUS: f64 = 4.0;

/// Margin of the transfer table on each side of the window, as a share of the window.
const MARGIN: f64 = 1.0 / 64.0;

/// Fewest codes of a window that is not narrow, for 8 bits and for 16.
const FEW_8: f64 = 128.0;
const FEW_16: f64 = 512.0;

/// Greatest distance of an isovalue from the function's window, in windows: a fraction of the range of slots about it.
const FARTHEST_SURFACE: f64 = 1e7;

/// Narrowest code, since some GPUs read smaller slots as 0; and least unit, with multiples of its inverse still in an f32. Windows of less than
/// 65,536 such codes have fewer codes.
const LEAST_CODE: f64 = 1e-36;
const LEAST_UNIT: f64 = 1e-35;

/// Greatest unit of stored gradients, in windows: a thousandth of the window is then still a normal half float. In data spread over more than some
/// 130,000 windows, the steepest gradients are flattened.
const MOST_WIDTHS: f64 = 1024.0;

/// Greatest distance of an f32-slot sample from the transfer table's first code, in codes: products of two do not overflow, nor do squares of the
/// results of a Sobel operator or a step of many voxels.
pub const FARTHEST_CODES: f32 = 1e16;

/// The limits of slots without clamping.
const ALL: [f64; 2] = [-MOST, MOST];

/// Clamping distance of slots from the window, in units. Voxels are clamped rather than samples, so samples beside an outlier rise as evenly as
/// elsewhere. It is at most [`FARTHEST_CODES`], as a unit is at most 64 times [`MOST_WIDTHS`] windows and a window at most 65,536 codes.
const FARTHEST_UNITS: f64 = FARTHEST_CODES as f64 / (64.0 * MOST_WIDTHS * 65536.0);

impl FloatSlots {
    /// The slots for a window of a channel of this type; `spread` is the greatest difference of its values.
    fn about(voxel_type: VoxelType, window: [f64; 2], spread: f64) -> Self {
        let [least, greatest] = window.map(|value| within(voxel_type, value));
        let base = if voxel_type == VoxelType::F32 { 0.0 } else { (0.5 * (least + greatest)).round() };
        let width = window[1] - window[0];
        let unit = power_of_two((spread / STEEPEST_UNITS).clamp(width, MOST_WIDTHS * width).max(LEAST_UNIT));
        let (middle, reach) = (0.5 * (window[0] + window[1]), FARTHEST_UNITS * unit);
        let limits = if spread <= reach { ALL } else { [middle - reach, middle + reach] };
        Self { base, unit, limits: limits.map(|limit| limit.clamp(-MOST, MOST)) }
    }

    /// Whether all held values are near enough to a window, and all near values are held unclamped.
    fn is_about(&self, window: [f64; 2], spread: f64) -> bool {
        let reach = FARTHEST_UNITS * self.unit;
        let [low, high] = self.limits;
        let is_amid = || low + 0.5 * reach <= window[0] && window[1] <= high - 0.5 * reach;
        if self.limits == ALL { spread <= reach } else { is_amid() }
    }

    /// Whether the slots are exact enough in a window, and store its gradients neither clamped nor too coarsely.
    fn suffice(&self, voxel_type: VoxelType, window: [f64; 2], spread: f64) -> bool {
        let width = window[1] - window[0];
        let farthest = window.iter().map(|value| (within(voxel_type, *value) - self.base).abs()).fold(0.0, f64::max);
        let ulp = 1.0 / (1 << 24) as f64;
        let is_near = voxel_type == VoxelType::F32 || farthest * ulp <= 1.0f64.max(SHARE * width);
        let least_unit = (spread / STEEPEST_UNITS).min(MOST_WIDTHS * width / 16.0);
        is_near && (least_unit..=64.0 * MOST_WIDTHS * width).contains(&self.unit)
    }
}

/// The present slots of a layer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KeptSlots {
    /// Present f32 slots; `None` for codes.
    floats: Option<FloatSlots>,
    /// Whether they stay, however coarse for the layer's look.
    stay: bool,
}

impl KeptSlots {
    /// Codes or f32 slots to be kept only while they fit the look.
    pub fn replaceable(floats: Option<FloatSlots>) -> Self {
        Self { floats, stay: false }
    }

    /// Codes or f32 slots to be kept in any case.
    pub fn fixed(floats: Option<FloatSlots>) -> Self {
        Self { floats, stay: true }
    }
}

/// The window of a look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Least and greatest value with a change of the look's transfer function, or with an isosurface.
    pub values: [f64; 2],
    /// The same for the transfer function alone; `None` if it is constant.
    pub of_function: Option<[f64; 2]>,
    /// The least distance between two bends of the function.
    pub thinnest: f64,
    /// Whether the function depends on gradients, which may be slight in any window: codes of 32-bit values are then always too coarse.
    pub is_by_gradient: bool,
}

impl Window {
    /// Returns a window of these values, without a bend of the function inside.
    pub fn of(values: [f64; 2]) -> Self {
        Self { values, of_function: Some(values), thinnest: f64::INFINITY, is_by_gradient: false }
    }

    /// Returns the window of a look in this mode; `None` if all values look alike.
    pub fn new(transfer: &TransferFunction, isosurfaces: &[Isosurface], mode: Mode) -> Option<Self> {
        let changes = if mode.is_projection() { transfer.changes() } else { transfer.visible_changes() };
        let isovalues = isosurfaces.iter().map(|surface| surface.value);
        let values = || isovalues.clone().chain(changes.into_iter().flatten());
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        (low <= high).then(|| Self {
            values: [low, high],
            of_function: changes.filter(|[low, high]| low < high),
            thinnest: transfer.thinnest([low, high]),
            is_by_gradient: transfer.is_by_gradient(),
        })
    }

    /// Values of an f32 slots' transfer table: the function's, since surfaces are found in the field itself, unless isovalues lie beyond the slots
    /// about them.
    fn of_table(&self) -> [f64; 2] {
        let [low, high] = self.values;
        let Some(of_function) = self.of_function else { return [low, high] };
        let reach = FARTHEST_SURFACE * (of_function[1] - of_function[0]);
        let is_near = of_function[0] - low <= reach && high - of_function[1] <= reach;
        if is_near { of_function } else { [low, high] }
    }
}

impl SlotEncoding {
    /// Encodes a channel for a look with this window: by its codes, or by f32 slots if these are too coarse. `None` is a look with all values alike.
    /// `kept` slots stay as long as they can.
    pub fn for_window(self, window: Option<Window>, kept: KeptSlots) -> Self {
        let Some(window) = window else { return if kept.stay { self.in_slots(kept.floats) } else { self } };
        let [low, high] = window.of_table();
        let enough = if kept.floats.is_some() { SHARE / SURPLUS } else { SHARE };
        let has_codes = match kept.stay {
            true => kept.floats.is_none(),
            false => !window.is_by_gradient && self.code_width() <= enough * (high - low),
        };
        if has_codes || !self.can_be_float() {
            return self.with_table_over_codes(window);
        }
        let would_do = !window.is_by_gradient && self.code_width() <= SHARE * (high - low);
        let enough_width = if would_do { self.code_width() } else { 0.0 };
        let window = self.widened([low, high]);
        let (voxel_type, spread) = (self.voxel_type, self.spread());
        let is_fit =
            |floats: &FloatSlots| floats.suffice(voxel_type, window, spread) && floats.is_about(window, spread);
        let kept = kept.floats.filter(|floats| kept.stay || is_fit(floats));
        let floats = kept.unwrap_or_else(|| FloatSlots::about(voxel_type, window, spread));
        Self { enough_width, ..self.with_table(floats, window) }
    }

    /// Returns this encoding by codes, with a transfer table over all codes, or over those of a narrow window and one to each side, beyond which the
    /// look is constant.
    fn with_table_over_codes(self, Window { values, thinnest, .. }: Window) -> Self {
        let most = f64::from(self.format.max_code());
        let [low, high] = values.map(|value| self.unorm(value) * most);
        let width = (high - low).max(0.0);
        let few = if self.format == SlotFormat::U8 { FEW_8 } else { FEW_16 };
        let is_thin = self.format != SlotFormat::U8 && thinnest < self.code_width();
        let is_narrow = width < few || 2.0 * width < self.spread_codes || is_thin;
        let first = (low.floor() - 1.0).clamp(0.0, most - 1.0);
        let last = (high.ceil() + 1.0).clamp(first + 1.0, most);
        let table_codes = if is_narrow && !self.is_labels { [first as u16, last as u16] } else { self.table_codes };
        Self { table_codes, ..self }
    }

    /// Encodes a channel for an expression, which may transform values in any way: f32 slots for 32-bit types. If all of a channel's integers are
    /// over 24 bits from 0, slots hold distances from the nearest to 0. Stored gradients fit a window of values.
    pub fn for_values(self, window: [f64; 2], kept: KeptSlots) -> Self {
        if !self.can_be_float() {
            return self.with_table_over_codes(Window::of(window));
        }
        let window = self.widened(window);
        let nearest = 0.0f64.clamp(self.low, self.high).round();
        let base = if nearest.abs() > GREATEST_WHOLE && self.voxel_type != VoxelType::F32 { nearest } else { 0.0 };
        let holds_all = |floats: &FloatSlots| floats.base == base && floats.limits == ALL;
        let is_it = |floats: &FloatSlots| holds_all(floats) && floats.suffice(VoxelType::F32, window, self.spread());
        let anew = || FloatSlots { base, limits: ALL, ..FloatSlots::about(VoxelType::F32, window, self.spread()) };
        let floats = kept.floats.filter(is_it).unwrap_or_else(anew);
        let width = code_width((self.low - base).abs().max((self.high - base).abs()));
        self.over(floats, 0.0, width)
    }

    /// The channel's values as renderers read them from these slots for an expression: as f32 if `are_single`, or as distances from a base.
    pub fn operand(&self, range: (f64, f64), are_single: bool) -> Operand {
        let range = range.into();
        let is_whole = self.voxel_type.bytes() == 4 && self.voxel_type != VoxelType::F32;
        // On the CPU codes of labels are exact.
        if !is_whole || !are_single && self.floats.is_none() {
            return Operand::exact(range);
        }
        let base = if are_single { 0.0 } else { self.floats.map_or(0.0, |floats| floats.base) };
        let farthest = range.map(|value: f64| (value - base).abs()).into_iter().fold(0.0, f64::max);
        // The greatest whole number stands for its neighbour, too.
        let exact = [base - GREATEST_WHOLE + 1.0, base + GREATEST_WHOLE - 1.0];
        Operand { range, exact, error: farthest / GREATEST_WHOLE }
    }

    /// The greatest difference of the channel's values.
    fn spread(&self) -> f64 {
        self.high - self.low
    }

    /// Whether the channel's values need more than 16 bits. Labels do not, as nothing lies between two of them.
    fn can_be_float(&self) -> bool {
        self.voxel_type.bytes() == 4 && !self.is_labels
    }

    /// Widens a window of a single isovalue, without a change beside it, to a 256th of the value.
    fn widened(&self, [low, high]: [f64; 2]) -> [f64; 2] {
        let [low, high] = [low, high].map(|value| value.clamp(-0.1 * MOST, 0.1 * MOST));
        let least = if low == 0.0 { self.code_width() / 64.0 } else { low.abs() / 256.0 };
        if high > low { [low, high] } else { [low - 0.5 * least, low + 0.5 * least] }
    }

    /// Returns the encoding by f32 slots with a transfer table over a window. Code widths are powers of two, and their multiples have codes of their
    /// own: among them all integers, unless the window is too wide.
    fn with_table(self, floats: FloatSlots, window: [f64; 2]) -> Self {
        let margin = MARGIN * (window[1] - window[0]);
        let low = at_most(window[0] - margin - floats.base);
        let width = code_width(window[1] + margin - floats.base - low);
        // An f32 too: a small multiple of a power of two, or an f32 already before.
        self.over(floats, (low / width).floor() * width, width)
    }

    /// Returns the encoding by f32 slots with a table from a slot's number on, in codes of this width.
    fn over(self, floats: FloatSlots, first: f64, code_width: f64) -> Self {
        let low = floats.base + first;
        let high = low + SlotFormat::F32.max_code() as f64 * code_width;
        Self { format: SlotFormat::F32, low, high, floats: Some(floats), ..self }
    }

    /// Returns the encoding of the same channel by these slots, or by this one's codes, without a particular table, and for any spread of values.
    pub fn in_slots(self, floats: Option<FloatSlots>) -> Self {
        let whole = self.with_whole_spread();
        floats.map_or(whole, |floats| {
            let (low, high) = (floats.base, floats.base + floats.unit);
            Self { format: SlotFormat::F32, low, high, floats: Some(floats), ..whole }
        })
    }

    /// Returns this encoding without its transfer table's range: if two are equal then, one can read the other's slots.
    pub fn of_slots(self) -> Self {
        self.in_slots(self.floats)
    }

    /// Slot number of the table's first value.
    pub fn first_slot(&self) -> f32 {
        self.floats.map_or(self.first_code(), |floats| self.low - floats.base) as f32
    }

    /// Codes per unit of slot numbers: 1 where slots hold codes.
    pub fn codes_per_slot(&self) -> f64 {
        self.floats.map_or(1.0, |_| 1.0 / self.code_width())
    }

    /// The difference of slot numbers at which greater ones are clamped: for f32 slots [`FARTHEST_CODES`].
    pub fn farthest_slots(&self) -> f32 {
        let farthest = |_| (FARTHEST_CODES as f64 * self.code_width()).min(2.0 * MOST);
        self.floats.map_or(f64::from(self.format.max_code()), farthest) as f32
    }

    /// Code difference below which a field is flat. Kept f32 slots use the coarser threshold of fresh ones, for equal pictures.
    pub fn flat_codes(&self) -> f64 {
        FLAT_CODES * (self.enough_width / self.code_width()).max(1.0)
    }

    /// Factor from stored gradients to differences of codes.
    pub fn gradient_scale(&self) -> f64 {
        self.floats.map_or(f64::from(self.format.max_code()), |floats| floats.unit / self.code_width())
    }
}

/// The voxel type's value nearest to a value.
fn within(voxel_type: VoxelType, value: f64) -> f64 {
    let (least, greatest) = voxel_type.limits();
    value.clamp(least, greatest)
}

/// The least power of two no less than a positive number.
fn power_of_two(number: f64) -> f64 {
    number.log2().ceil().exp2()
}

/// Code width at which all codes but one cover a range.
fn code_width(range: f64) -> f64 {
    power_of_two((range / (SlotFormat::F32.max_code() - 1) as f64).max(LEAST_CODE))
}

/// The nearest f32 not above a value.
fn at_most(value: f64) -> f64 {
    let near = value as f32;
    f64::from(if near as f64 > value { near.next_down() } else { near })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slot_encoding::{INVALID_SLOT, LEAST_SLOT};

    fn encoding(voxel_type: VoxelType, range: (f64, f64), window: [f64; 2]) -> SlotEncoding {
        SlotEncoding::new(voxel_type, range, false).for_window(Some(Window::of(window)), KeptSlots::default())
    }

    /// Encodes and decodes these voxels, within an encoding's table and outside.
    fn round_trip(encoding: &SlotEncoding, voxels: &[f64]) -> Vec<f64> {
        let write = |value: &f64| match encoding.voxel_type {
            VoxelType::U32 => (*value as u32).to_le_bytes(),
            VoxelType::I32 => (*value as i32).to_le_bytes(),
            _ => (*value as f32).to_le_bytes(),
        };
        let bytes: Vec<u8> = voxels.iter().flat_map(write).collect();
        let mut slots = vec![0; bytes.len()];
        encoding.encode(&bytes, &mut slots);
        let slot = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes) - encoding.first_slot();
        slots.as_chunks().0.iter().map(|bytes| encoding.low + slot(bytes) as f64).collect()
    }

    #[test]
    fn codes_are_kept_where_they_are_fine_enough() {
        let format = |window: [f64; 2]| encoding(VoxelType::F32, (0.0, 65535.0), window).format;
        assert_eq!(format([100.0, 611.0]), SlotFormat::U16, "codes are one wide");
        assert_eq!(format([100.0, 609.0]), SlotFormat::F32);
        for voxel_type in [VoxelType::U8, VoxelType::I8, VoxelType::U16, VoxelType::I16] {
            let codes = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
            let narrow = codes.for_window(Some(Window::of([1.0, 2.0])), KeptSlots::default());
            assert_eq!(narrow.of_slots(), codes.of_slots());
            assert_eq!(codes.for_values([1.0, 2.0], KeptSlots::default()), narrow);
        }
        let codes = SlotEncoding::new(VoxelType::F32, (0.0, 1.0), false);
        assert_eq!(codes.for_window(None, KeptSlots::default()), codes, "what tells nothing apart");
    }

    #[test]
    fn slots_that_are_kept_call_flat_what_fresh_ones_would() {
        let codes = SlotEncoding::new(VoxelType::F32, (0.0, 65535.0), false);
        let of = |window: [f64; 2], kept| codes.for_window(Some(Window::of(window)), KeptSlots::replaceable(kept));
        let flat = |encoding: SlotEncoding| encoding.flat_codes() * encoding.code_width();
        let narrow = of([100.0, 300.0], None);
        let (fresh, kept) = (of([100.0, 700.0], None), of([100.0, 700.0], narrow.floats));
        assert_eq!((fresh.format, kept.format), (SlotFormat::U16, SlotFormat::F32));
        assert_eq!((flat(fresh), flat(kept)), (FLAT_CODES, FLAT_CODES));
        assert_eq!(flat(narrow), FLAT_CODES * narrow.code_width());
        assert_eq!(kept.of_slots(), narrow.of_slots(), "no brick is uploaded for it");
    }

    #[test]
    fn a_look_s_window_has_all_that_it_tells_apart() {
        let plain =
            TransferFunction { color: vec![[0.0; 4]], opacity: vec![[0.0, 0.5]], ..TransferFunction::default() };
        let window = |transfer: &TransferFunction, isosurfaces: &[Isosurface]| {
            Window::new(transfer, isosurfaces, Mode::Dvr).map(|window| window.values)
        };
        assert_eq!(window(&plain, &[]), None);
        assert_eq!(window(&plain, &[Isosurface::at(3.0)]), Some([3.0, 3.0]));
        let ramp = TransferFunction { opacity: vec![[0.0, 0.0], [2.0, 0.5]], ..plain };
        assert_eq!(window(&ramp, &[Isosurface::at(3.0), Isosurface::at(1.0)]), Some([0.0, 3.0]));
        // A distant surface takes no room in the table, unless slots cannot hold both.
        let codes = SlotEncoding::new(VoxelType::F32, (-1e12, 1e12), false);
        for (isovalue, is_near) in [(1e6, true), (-1e6, true), (1e10, false)] {
            let window = Window::new(&ramp, &[Isosurface::at(isovalue)], Mode::Dvr);
            let width = codes.for_window(window, KeptSlots::default()).code_width();
            assert_eq!(width < 1e-3, is_near, "{isovalue}: {width}");
        }
    }

    #[test]
    fn colours_of_clear_values_make_no_window_of_fog() {
        let shell = TransferFunction {
            color: vec![[-100.0, 0.0, 0.0, 0.0], [300.0, 1.0, 1.0, 1.0]],
            opacity: vec![[-50.0, 0.0], [7.0, 0.0], [7.5, 0.9], [8.0, 0.0], [200.0, 0.0]],
            ..TransferFunction::default()
        };
        let window = |mode| Window::new(&shell, &[], mode).unwrap();
        assert_eq!(window(Mode::Dvr), Window { thinnest: 0.5, ..Window::of([7.0, 8.0]) });
        assert_eq!(window(Mode::Mip), Window { thinnest: 0.5, ..Window::of([-100.0, 300.0]) });
        let clear = TransferFunction { opacity: vec![[0.0, 0.0]], ..shell };
        assert_eq!(Window::new(&clear, &[], Mode::Dvr), None);
    }

    /// Each kind of narrowness, and its bound; labels, and everything wide, have whole tables.
    #[test]
    fn tables_are_laid_over_narrow_windows() {
        let codes = |voxel_type, greatest: f64, window| {
            let encoding =
                SlotEncoding::new(voxel_type, (0.0, greatest), false).for_window(Some(window), KeptSlots::default());
            (encoding.table_codes, encoding.has_whole_table())
        };
        let of = Window::of;
        assert_eq!(codes(VoxelType::U8, 255.0, of([10.0, 137.5])), ([9, 139], false));
        assert_eq!(codes(VoxelType::U8, 255.0, of([10.0, 138.0])), ([0, 255], true));
        assert_eq!(codes(VoxelType::U8, 1.0, of([0.4, 0.6])), ([0, 2], false));
        assert_eq!(codes(VoxelType::U16, 900.0, of([100.0, 611.0])), ([99, 612], false));
        assert_eq!(codes(VoxelType::U16, 900.0, of([100.0, 612.0])), ([0, 65535], true));
        assert_eq!(codes(VoxelType::U16, 60000.0, of([100.0, 20100.0])), ([99, 20101], false), "a third of the values");
        let thin = Window { thinnest: 0.5, ..of([100.0, 1100.0]) };
        assert_eq!(codes(VoxelType::U16, 900.0, thin), ([99, 1101], false));
        assert_eq!(codes(VoxelType::I16, 900.0, of([-32768.0, -32768.0])), ([0, 1], false));
        for outside in [[-9.0, -3.0], [300.0, 301.0]] {
            let [first, last] = codes(VoxelType::U8, 255.0, of(outside)).0;
            assert!(first < last, "{outside:?}: {first} {last}");
        }
        let labels = SlotEncoding::of_labels(VoxelType::U8, (0.0, 3.0), false, None);
        assert!(labels.for_window(Some(of([1.0, 2.0])), KeptSlots::default()).has_whole_table());
    }

    #[test]
    fn a_window_that_is_stretched_does_not_go_back_and_forth() {
        let codes = SlotEncoding::new(VoxelType::F32, (0.0, 65535.0), false);
        let (mut kept, mut changes) = (codes, Vec::new());
        for i in 0..400 {
            // From 200 to 900 and back, time and again: past the bound of 510.
            let width = 550.0 + 350.0 * (i as f64 / 10.0).sin();
            let next = codes.for_window(
                Some(Window::of([1000.0 + i as f64, 1000.0 + i as f64 + width])),
                KeptSlots::replaceable(kept.floats),
            );
            if next.of_slots() != kept.of_slots() {
                changes.push(i);
            }
            kept = next;
        }
        assert_eq!(changes.len(), 1, "{changes:?}");
        assert_eq!(
            codes.for_window(Some(Window::of([0.0, 3000.0])), KeptSlots::replaceable(kept.floats)).format,
            SlotFormat::U16,
            "enough by far"
        );
    }

    #[test]
    fn slots_of_floats_do_not_depend_on_where_the_window_is() {
        let codes = SlotEncoding::new(VoxelType::F32, (-1e9, 1e9), true);
        let first = codes.for_window(Some(Window::of([0.0, 1.0])), KeptSlots::default());
        for low in [-1e9, -3.5, 0.25, 1e3, 9.9e8] {
            for width in [0.05, 1.0, 9.0] {
                let next = codes.for_window(Some(Window::of([low, low + width])), KeptSlots::replaceable(first.floats));
                assert_eq!(next.of_slots(), first.of_slots(), "{low} {width}");
                assert!(next.low < low && low + width < next.high, "{low} {width}: {next:?}");
                assert_eq!(next.first_slot() as f64, next.low, "it is an f32");
            }
        }
    }

    /// The steepest gradients are stored unclamped, and a thousandth of the window as a normal half float.
    #[test]
    fn gradients_in_narrow_windows_are_neither_clamped_nor_coarse() {
        for voxel_type in [VoxelType::F32, VoxelType::U32] {
            for spread in [1e2, 6e4, 1e7] {
                let codes = SlotEncoding::new(voxel_type, (0.0, spread), false);
                for width in [1.0, 3.0, 400.0].into_iter().filter(|width| spread <= 100_000.0 * width) {
                    let narrow = codes.for_window(Some(Window::of([7.0, 7.0 + width])), KeptSlots::replaceable(None));
                    let Some(FloatSlots { unit, .. }) = narrow.floats else { continue };
                    let half = |difference: f64| 2.0 * difference / unit * f64::from(crate::gradients::SCALE);
                    assert!(half(spread) <= 65000.0, "{voxel_type:?} {spread} {width}: {unit}");
                    assert!(half(width / 1000.0) >= 1.0 / 16384.0, "{voxel_type:?} {spread} {width}: {unit}");
                }
            }
        }
    }

    #[test]
    fn windows_have_all_codes_however_narrow_they_are() {
        let codes = SlotEncoding::new(VoxelType::F32, (0.0, 1e-3), false);
        for width in [1e-9, 1e-20, 1e-29, 1e-31] {
            let narrow = codes.for_window(Some(Window::of([0.0, width])), KeptSlots::default());
            assert!(width / narrow.code_width() > 30_000.0, "{width}: {}", narrow.code_width());
            assert!((narrow.codes_per_slot() as f32).is_finite() && narrow.gradient_scale().is_finite(), "{width}");
        }
    }

    /// Slots clamp values beyond the reach of codes, voxel by voxel, and no others; slots of an expression hold all.
    #[test]
    fn outliers_are_clamped_in_their_slots() {
        let voxels = [0.3, 1e8, -4e8, 9.96921e36, -1e20].map(|value: f64| f64::from(value as f32));
        let codes = SlotEncoding::new(VoxelType::F32, (-1e20, 1e37), false);
        let narrow = codes.for_window(Some(Window::of([0.0, 1.0])), KeptSlots::default());
        let found = round_trip(&narrow, &voxels);
        assert!(
            found[..3].iter().zip(voxels).all(|(found, value)| (found - value).abs() <= 1e-6 * value.abs()),
            "{found:?}"
        );
        let farthest = f64::from(narrow.farthest_slots());
        assert!((1e9..farthest).contains(&found[3]) && (1e9..farthest).contains(&-found[4]), "{found:?}, {farthest}");
        let all = round_trip(&codes.for_values([0.0, 1.0], KeptSlots::replaceable(narrow.floats)), &voxels);
        assert!(all.iter().zip(voxels).all(|(found, value)| (found - value).abs() <= 1e-6 * value.abs()), "{all:?}");
        // A look rejects slots of other limits: both those of all values and those about a distant window.
        let of_values = codes.for_values([0.0, 1.0], KeptSlots::default()).floats;
        for floats in
            [of_values, codes.for_window(Some(Window::of([1e10, 1e10 + 4096.0])), KeptSlots::default()).floats]
        {
            let next = codes.for_window(Some(Window::of([0.0, 1.0])), KeptSlots::replaceable(floats));
            assert_eq!(next.floats, narrow.floats);
        }
        let plain = SlotEncoding::new(VoxelType::I32, (-2e9, 2e9), false)
            .for_window(Some(Window::of([0.0, 2.0])), KeptSlots::default());
        assert_eq!(plain.floats.map(|floats| floats.limits), Some(ALL));
    }

    #[test]
    fn values_in_the_window_are_exact() {
        let floats = encoding(VoxelType::F32, (-1e9, 1e9), [0.25, 0.75]);
        let values = [0.25f32, 0.3, 0.7].map(f64::from);
        for (found, value) in round_trip(&floats, &values).into_iter().zip(values) {
            // A rounding of the difference, which is as large as the window.
            assert!((found - value).abs() <= 1e-7 * 0.5, "{value}: {found}");
        }
        for (voxel_type, range, low) in [
            (VoxelType::U32, (0.0, 4294967295.0), 70000.0),
            (VoxelType::U32, (0.0, 4294967295.0), 4294967290.0),
            (VoxelType::I32, (-2147483648.0, 2147483647.0), -2147483648.0),
            (VoxelType::I32, (-2147483648.0, 2147483647.0), 2147483640.0),
        ] {
            let integers = encoding(voxel_type, range, [low, low + 5.0]);
            assert_eq!(integers.format, SlotFormat::F32);
            let values: Vec<f64> = (0..=5).map(|i| low + i as f64).collect();
            assert_eq!(round_trip(&integers, &values), values);
            for value in values {
                let code = integers.unorm(value) * 65535.0;
                assert!((code - code.round()).abs() < 1e-9, "integers have codes of their own: {code}");
            }
        }
        // A window so wide that f32s lose integers in it.
        let wide = encoding(VoxelType::I32, (-2147483648.0, 2147483647.0), [0.0, 3e6]);
        for (found, value) in round_trip(&wide, &[0.0, 1.0, 2999999.0]).into_iter().zip([0.0, 1.0, 2999999.0]) {
            assert!((found - value).abs() <= SHARE * 3e6);
        }
    }

    #[test]
    fn an_integer_s_base_goes_with_its_window() {
        let codes = SlotEncoding::new(VoxelType::U32, (0.0, 4294967295.0), false);
        let first = codes.for_window(Some(Window::of([70000.0, 70002.0])), KeptSlots::default());
        assert_eq!(first.floats.map(|floats| floats.base), Some(70001.0));
        let near = codes.for_window(Some(Window::of([9e6, 9e6 + 2.0])), KeptSlots::replaceable(first.floats));
        assert_eq!(near.of_slots(), first.of_slots());
        let far = codes.for_window(Some(Window::of([4e9, 4e9 + 2.0])), KeptSlots::replaceable(near.floats));
        assert_eq!(far.floats.map(|floats| floats.base), Some(4e9 + 1.0));
    }

    #[test]
    fn what_is_no_number_is_below_all_others() {
        let voxels = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 0.5];
        let bytes: Vec<u8> = voxels.iter().flat_map(|v| v.to_le_bytes()).collect();
        let floats = SlotEncoding::new(VoxelType::F32, (f32::MIN as f64, f32::MAX as f64), true);
        let floats = floats.for_window(Some(Window::of([0.0, 1.0])), KeptSlots::default());
        let mut slots = vec![0; bytes.len()];
        floats.encode(&bytes, &mut slots);
        let slots: Vec<f32> = slots.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        assert_eq!([slots[0], slots[1], slots[2], slots[5]], [INVALID_SLOT, INVALID_SLOT, INVALID_SLOT, 0.5]);
        assert!(slots[3] > 1e9 && slots[4] < -1e9, "{slots:?}");
        const { assert!(INVALID_SLOT < LEAST_SLOT && LEAST_SLOT < -1e38) };
    }

    #[test]
    fn slots_that_stay_are_read_by_any_window() {
        let codes = SlotEncoding::new(VoxelType::F32, (-3.0, 1e9), false);
        let coarse = codes.for_window(Some(Window::of([0.0, 1.0])), KeptSlots::fixed(None));
        assert_eq!(coarse.of_slots(), codes.of_slots(), "codes, however coarse");
        let floats = codes.for_window(Some(Window::of([0.0, 1.0])), KeptSlots::default());
        for window in [Some([0.0, 1e9]), Some([5e8, 5e8 + 64.0]), None] {
            let stays = codes.for_window(window.map(Window::of), KeptSlots::fixed(floats.floats));
            assert_eq!(stays.of_slots(), floats.of_slots(), "{window:?}");
            assert!(window.is_none_or(|[low, high]| stays.low <= low && high <= stays.high), "{window:?}");
            let replaced = codes.for_window(window.map(Window::of), KeptSlots::replaceable(floats.floats));
            assert_ne!(replaced.of_slots(), floats.of_slots());
        }
    }

    #[test]
    fn an_expression_s_codes_are_values_by_a_power_of_two() {
        let codes = SlotEncoding::new(VoxelType::F32, (-3.0, 1e9), false);
        let values = codes.for_values([0.0, 1.0], KeptSlots::default());
        assert_eq!((values.low, values.first_slot(), values.code_width().log2().fract()), (0.0, 0.0, 0.0));
        assert!(values.unorm(1e9) <= 1.0 && values.unorm(-3.0) < 0.0);
    }

    #[test]
    fn a_single_isovalue_has_a_table() {
        for value in [0.0, 0.5, -70000.5, 1e30] {
            let alone = encoding(VoxelType::F32, (-1e31, 1e31), [value, value]);
            assert_eq!(alone.format, SlotFormat::F32);
            assert!(alone.low < value && value < alone.high, "{alone:?}");
        }
    }
}
