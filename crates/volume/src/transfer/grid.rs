//! The table of a transfer function of value and gradient magnitude: entries over the plane of both, read bilinearly after interpolation of the
//! samples.
//!
//! Its rows are values: one or more for each code between the function's first and last change, so every possible value of a voxel has its own row.
//! With more such codes than [`TransferGrid::MOST_ROWS`], this many rows lie at equal distances. Its columns are gradient magnitudes, at equal
//! distances from 0 to the function's greatest; beyond, the last column holds. 1,024 rows over a CT's 3,000 Hounsfield units are 3 units apart, a
//! tenth of such data's noise; 256 columns are 1/255 of the steepest boundary apart, finer than the half code per voxel of 8-bit data's gradients.
//! Details narrower than an entry are drawn as wide as one, and a jump from one entry to the next is a ramp.
//!
//! Opacities are interpolated directly, and colours by opacity, so regions do not take on invisible colours. Made anew with each edit, in some
//! milliseconds at most; 16 bytes an entry.

use super::table::entries_per_code;
use super::{Region, Shape, TransferFunction, mix};
use crate::slot_encoding::SlotEncoding;
use std::ops::RangeInclusive;

const MOST_ROWS: usize = TransferGrid::MOST_ROWS;
const COLUMNS: usize = TransferGrid::COLUMNS;

/// The table of a transfer function of value and gradient magnitude: entries over the plane of both.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferGrid {
    /// Code of the first row, counted from the first of the encoding's table codes.
    pub first_code: f32,
    /// Rows per code.
    pub rows_per_code: f32,
    /// Columns per unit of gradient magnitude, in data units per world unit.
    pub columns_per_gradient: f32,
    /// At least two rows of entries `[r, g, b, alpha]`: straight colour, and alpha over the function's unit distance.
    pub entries: Vec<[f32; 4]>,
}

/// Positions of rows and columns.
struct Axes<'a> {
    encoding: &'a SlotEncoding,
    first_code: f64,
    codes_per_row: f64,
    rows: usize,
    gradient_per_column: f64,
}

impl TransferGrid {
    /// The most rows of a grid.
    pub const MOST_ROWS: usize = 1024;

    /// Number of columns of a grid.
    pub const COLUMNS: usize = 256;

    /// Samples a transfer function at the rows' values and the columns' gradient magnitudes.
    pub fn new(transfer: &TransferFunction, encoding: &SlotEncoding) -> Self {
        let axes = Axes::new(transfer, encoding);
        let factors: Vec<f64> = (0..COLUMNS).map(|column| transfer.factor(axes.gradient(column))).collect();
        let mut entries = Vec::with_capacity(axes.rows * COLUMNS);
        let values = axes.values(transfer);
        for &value in &values {
            let [r, g, b, alpha] = transfer.rgba(value);
            entries.extend(factors.iter().map(|factor| [r, g, b, alpha * factor].map(|v| v as f32)));
        }
        let regions: Vec<Fitted> = transfer.regions.iter().filter_map(|region| axes.fit(region)).collect();
        for (_, rows, columns) in &regions {
            for row in rows.clone() {
                let (value, own) = (values[row], axes.value(row));
                let [r, g, b, alpha] = transfer.rgba(value);
                for column in columns.clone() {
                    let gradient = axes.gradient(column);
                    let media = regions.iter().map(|(region, ..)| (region.color, region.alpha(own, gradient)));
                    let entry = mix([r, g, b, alpha * factors[column]], media);
                    entries[row * COLUMNS + column] = entry.map(|v| v as f32);
                }
            }
        }
        Self {
            first_code: axes.first_code as f32,
            rows_per_code: (1.0 / axes.codes_per_row) as f32,
            columns_per_gradient: (1.0 / axes.gradient_per_column) as f32,
            entries,
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.entries.len() / COLUMNS
    }

    /// Interpolated straight colour and opacity at a code and a gradient magnitude in data units per world unit.
    #[inline]
    pub fn lookup(&self, code: f32, gradient: f32) -> [f32; 4] {
        let split = |position: f32, count: usize| {
            let position = position.clamp(0.0, (count - 1) as f32);
            let first = (position as usize).min(count - 2);
            (first, position - first as f32)
        };
        let (row, s) = split((code - self.first_code) * self.rows_per_code, self.rows());
        let (column, t) = split(gradient * self.columns_per_gradient, COLUMNS);
        let at = row * COLUMNS + column;
        let [a, b, c, d] = [at, at + 1, at + COLUMNS, at + COLUMNS + 1].map(|i| self.entries[i]);
        // Written so that four equal entries give exactly the same.
        let (low, high) = (a[3] + t * (b[3] - a[3]), c[3] + t * (d[3] - c[3]));
        let alpha = low + s * (high - low);
        let weights = [(1.0 - s) * (1.0 - t) * a[3], (1.0 - s) * t * b[3], s * (1.0 - t) * c[3], s * t * d[3]];
        let share = 1.0 / weights.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        let color = |k: usize| (weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k] + weights[3] * d[k]) * share;
        [color(0), color(1), color(2), alpha]
    }

    /// Iterates over this many entries' greatest opacity, whatever the gradient, among values within one entry.
    pub(crate) fn most(&self, entries: usize, entries_per_code: usize) -> impl Iterator<Item = f32> {
        let greatest = |row: &[[f32; 4]]| row.iter().map(|entry| entry[3]).fold(0.0, f32::max);
        let most: Vec<f32> = self.entries.chunks_exact(COLUMNS).map(greatest).collect();
        let (first, per_code, last) = (self.first_code, self.rows_per_code, most.len() - 1);
        (0..entries).map(move |entry| {
            let position = |entry: f32| ((entry / entries_per_code as f32 - first) * per_code).clamp(0.0, last as f32);
            let (low, high) = (position(entry as f32 - 1.0), position(entry as f32 + 1.0));
            most[low.floor() as usize..=high.ceil() as usize].iter().copied().fold(0.0, f32::max)
        })
    }
}

/// A region fitted to the grid, and its rows and columns.
type Fitted = (Region, RangeInclusive<usize>, RangeInclusive<usize>);

impl<'a> Axes<'a> {
    fn new(transfer: &TransferFunction, encoding: &'a SlotEncoding) -> Self {
        let max = encoding.span_codes();
        let code = |value: f64| encoding.code(value).clamp(0.0, max);
        let [low, high] = transfer.visible_changes().unwrap_or([transfer.opacity[0][0]; 2]).map(code);
        // One more row on each side, beyond which the function is constant.
        let (first_code, codes_per_row, rows) = match high.ceil() - low.floor() + 3.0 {
            rows if rows as usize > MOST_ROWS => {
                let step = (high - low) / (MOST_ROWS - 3) as f64;
                (low - step, step, MOST_ROWS)
            }
            rows => {
                // A code has one row, or as many as the value table has entries, if there is room for them.
                let most = (MOST_ROWS as f64 / rows).log2().floor().exp2();
                let step = 1.0 / most.min(rows_per_code(transfer, encoding, [low.floor(), high.ceil()], most));
                let first = ((low / step).floor() * step - step).clamp(0.0, max - step);
                let last = ((high / step).ceil() * step + step).clamp(first + step, max);
                (first, step, ((last - first) / step) as usize + 1)
            }
        };
        // Behind its last bend the factor is constant. Regions end with their boxes: the last column is behind them.
        let bends = transfer.gradient_opacity.windows(2).rposition(|pair| pair[0][1] != pair[1][1]);
        let factors = bends.map_or(0.0, |last| transfer.gradient_opacity[last + 1][0]);
        let behind = (COLUMNS - 1) as f64 / (COLUMNS - 2) as f64;
        let top = transfer.regions.iter().map(|region| region.gradient[1] * behind).fold(factors, f64::max);
        let top = if top > 0.0 { top } else { 1.0 };
        Self { encoding, first_code, codes_per_row, rows, gradient_per_column: top / (COLUMNS - 1) as f64 }
    }

    fn value(&self, row: usize) -> f64 {
        self.encoding.value_of_code(self.first_code + row as f64 * self.codes_per_row)
    }

    /// Sampled values of the rows: the row's own, but the nearer row takes a peak of opacity between two.
    fn values(&self, transfer: &TransferFunction) -> Vec<f64> {
        let mut values: Vec<f64> = (0..self.rows).map(|row| self.value(row)).collect();
        for &[value, _] in &transfer.opacity {
            let row = (self.encoding.code(value) - self.first_code) / self.codes_per_row;
            if !(0.0..=(self.rows - 1) as f64).contains(&row) || (row - row.round()).abs() < 1e-6 {
                continue;
            }
            let alphas = [row.floor(), row.ceil()].map(|row| transfer.alpha(self.value(row as usize)));
            let nearest = row.round() as usize;
            if alphas.iter().chain([&transfer.alpha(values[nearest])]).all(|other| transfer.alpha(value) > *other) {
                values[nearest] = value;
            }
        }
        values
    }

    fn gradient(&self, column: usize) -> f64 {
        column as f64 * self.gradient_per_column
    }

    /// Fits a region to the entries: a rectangle's edges are at entries, and other shapes at least two steps wide. `None` if none of its values has a
    /// code.
    fn fit(&self, region: &Region) -> Option<Fitted> {
        let [low, high] = region.value.map(|value| self.encoding.place(value));
        if high < 0.0 || low > 1.0 {
            return None;
        }
        let row = |value: f64| {
            ((self.encoding.code(value) - self.first_code) / self.codes_per_row).clamp(0.0, (self.rows - 1) as f64)
        };
        let column = |gradient: f64| (gradient / self.gradient_per_column).clamp(0.0, (COLUMNS - 1) as f64);
        let mut fitted = *region;
        let per_row = self.codes_per_row * self.encoding.code_width();
        match region.shape {
            Shape::Rectangle => {
                fitted.value = region.value.map(|value| self.value(row(value).round() as usize));
                fitted.gradient = region.gradient.map(|gradient| self.gradient(column(gradient).round() as usize));
            }
            Shape::Gaussian | Shape::Triangle => {
                fitted.value = widened(region.value, per_row);
                fitted.gradient = widened(region.gradient, self.gradient_per_column);
            }
        }
        let rows = fitted.value.map(row);
        let columns = fitted.gradient.map(column);
        let span = |[low, high]: [f64; 2]| low.floor() as usize..=high.ceil() as usize;
        Some((fitted, span(rows), span(columns)))
    }
}

/// Fewest sufficient rows per code, a power of two and at most `most`: as many as the value table has entries, with colours mixed by opacity within a
/// display code of straight ones, midway between rows.
fn rows_per_code(transfer: &TransferFunction, encoding: &SlotEncoding, [low, high]: [f64; 2], most: f64) -> f64 {
    if encoding.is_labels {
        return 1.0;
    }
    let is_near = |per_code: &f64| {
        let at = |row: f64| transfer.rgba(encoding.value_of_code(row / per_code));
        let (first, last) = ((low * per_code) as u64, (high * per_code) as u64);
        (first..last).all(|row| {
            let [a, middle, b] = [0.0, 0.5, 1.0].map(|part| at(row as f64 + part));
            let share = b[3] / (a[3] + b[3]).max(f64::MIN_POSITIVE);
            let off = (0..3).map(|k| (a[k] + share * (b[k] - a[k]) - middle[k]).abs()).fold(0.0, f64::max);
            middle[3] == 0.0 || off <= 1.0 / 255.0
        })
    };
    let steps = std::iter::successors(Some(entries_per_code(transfer, encoding) as f64), |step| Some(2.0 * step));
    steps.take_while(|step| *step < most).find(is_near).unwrap_or(most)
}

/// Widens an interval to at least a step on each side of its middle.
fn widened([low, high]: [f64; 2], step: f64) -> [f64; 2] {
    let middle = 0.5 * (low + high);
    [low.min(middle - step), high.max(middle + step)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel_type::VoxelType;

    fn region(shape: Shape, value: [f64; 2], gradient: [f64; 2]) -> Region {
        Region { shape, value, gradient, color: [1.0, 0.5, 0.25], opacity: 0.5 }
    }

    fn ramps() -> TransferFunction {
        TransferFunction {
            color: vec![[-50.0, 0.0, 0.0, 1.0], [100.0, 1.0, 0.5, 0.0]],
            opacity: vec![[-20.0, 0.0], [40.0, 0.2], [60.0, 0.8]],
            unit_distance: 1.0,
            gradient_opacity: vec![[0.0, 0.0], [25.5, 0.5], [51.0, 1.0]],
            ..TransferFunction::default()
        }
    }

    /// Distance of the table from the function at many places, by channel; colours are weighted by their visibility.
    fn error(transfer: &TransferFunction, encoding: &SlotEncoding, values: [f64; 2], gradients: [f64; 2]) -> f64 {
        let grid = TransferGrid::new(transfer, encoding);
        let mut worst = 0.0f64;
        for i in 0..=211 {
            for j in 0..=97 {
                let value = values[0] + (values[1] - values[0]) * i as f64 / 211.0;
                let gradient = gradients[0] + (gradients[1] - gradients[0]) * j as f64 / 97.0;
                let code = (encoding.unorm(value) * encoding.format.max_code() as f64) as f32;
                let (found, exact) = (grid.lookup(code, gradient as f32), transfer.at(value, gradient));
                let alpha = exact[3];
                worst = worst.max((found[3] as f64 - alpha).abs());
                for k in 0..3 {
                    worst = worst.max((found[k] as f64 - exact[k]).abs() * alpha);
                }
            }
        }
        worst
    }

    #[test]
    fn what_is_linear_between_entries_is_exact_and_holds_beyond() {
        for voxel_type in [VoxelType::I8, VoxelType::I16] {
            let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
            let found = error(&ramps(), &encoding, [-128.0, 127.0], [0.0, 90.0]);
            // Colours mix by opacity from one code to the next; a colour changes by 1/150 there.
            assert!(found < 5e-4, "{voxel_type:?}: {found}");
            let grid = TransferGrid::new(&ramps(), &encoding);
            // From a code before -20 to one after 100.
            assert_eq!(grid.rows(), 123);
            assert_eq!(grid.lookup(encoding.format.max_code() as f32, 1e9)[3], 0.8);
        }
    }

    /// Over a range of values with more codes than rows.
    #[test]
    fn smooth_shapes_are_met_closely() {
        let encoding = SlotEncoding::new(VoxelType::I16, (0.0, 1.0), false);
        for shape in [Shape::Gaussian, Shape::Triangle] {
            let transfer = TransferFunction {
                regions: vec![
                    region(shape, [200.0, 2800.0], [150.0, 800.0]),
                    Region { color: [0.0, 0.0, 1.0], ..region(shape, [-300.0, 900.0], [100.0, 820.0]) },
                ],
                ..TransferFunction::default()
            };
            // Triangles are cut off below and above.
            let gradients = if shape == Shape::Gaussian { [0.0, 999.0] } else { [155.0, 795.0] };
            let found = error(&transfer, &encoding, [-500.0, 3500.0], gradients);
            let tolerance = if shape == Shape::Gaussian { 2e-3 } else { 0.02 };
            assert!(found < tolerance, "{shape:?}: {found}");
        }
    }

    #[test]
    fn nothing_falls_between_entries_and_nothing_is_beside_its_region() {
        let encoding = SlotEncoding::new(VoxelType::I16, (0.0, 1.0), false);
        for shape in Shape::ALL {
            // Of steps of three codes and of four units of gradient; the other region spans the table.
            let thin = region(shape, [700.2, 700.4], [301.0, 301.5]);
            let wide = Region { opacity: 0.0, ..region(Shape::Rectangle, [0.0, 3000.0], [0.0, 1000.0]) };
            let transfer = TransferFunction { regions: vec![thin, wide], ..TransferFunction::default() };
            let grid = TransferGrid::new(&transfer, &encoding);
            assert_eq!(grid.rows(), MOST_ROWS);
            let alpha = |value: f32, gradient: f32| grid.lookup(value + 32768.0, gradient)[3];
            let near = (0..40).map(|i| alpha(695.0 + 0.25 * i as f32, 301.0)).fold(0.0, f32::max);
            // A bell has a third of its opacity of a half, half a step beside its middle, along each axis.
            assert!(near > 0.05, "{shape:?}: {near}");
            for (value, gradient) in [(690.0, 301.0), (711.0, 301.0), (700.3, 285.0), (700.3, 318.0)] {
                assert_eq!(alpha(value, gradient), 0.0, "{shape:?} {value} {gradient}");
            }
        }
        let outside = TransferFunction {
            regions: vec![region(Shape::Rectangle, [300.0, 400.0], [0.0, 5.0])],
            ..TransferFunction::default()
        };
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 1.0), false);
        assert!(TransferGrid::new(&outside, &encoding).entries.iter().all(|entry| entry[3] == 0.0));
    }

    /// Between two codes of which one is clear, colours are the function's.
    #[test]
    fn colours_over_few_codes_are_those_of_the_function() {
        let transfer = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]],
            opacity: vec![[0.0, 0.0], [1.0, 0.05]],
            gradient_opacity: vec![[0.0, 1.0], [0.01, 1.0]],
            ..TransferFunction::default()
        };
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 1.0), false);
        let grid = TransferGrid::new(&transfer, &encoding);
        for i in 1..100 {
            let value = i as f32 / 100.0;
            let [red, _, blue, alpha] = grid.lookup(value, 0.3);
            // A row is a 256th of the way.
            assert!((red - value).abs() < 0.004 && (blue - (1.0 - value)).abs() < 0.004, "{value}: {red}");
            assert!((alpha - 0.05 * value).abs() < 1e-6);
        }
    }

    #[test]
    fn columns_end_where_the_factor_does() {
        let with = |points: &[[f64; 2]]| {
            let transfer = TransferFunction { gradient_opacity: points.to_vec(), ..ramps() };
            TransferGrid::new(&transfer, &SlotEncoding::new(VoxelType::I8, (0.0, 1.0), false))
        };
        let plain = with(&[[0.0, 0.0], [20.0, 1.0]]);
        assert_eq!(with(&[[0.0, 0.0], [20.0, 1.0], [1e6, 1.0], [2e6, 1.0]]), plain);
        assert!(with(&[[0.0, 0.0], [20.0, 1.0], [40.0, 0.5]]).columns_per_gradient < plain.columns_per_gradient);
    }

    #[test]
    fn a_layer_narrower_than_a_row_is_drawn() {
        let encoding = SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false);
        for centre in [18832.0, 31388.0, 37433.0] {
            let transfer = TransferFunction {
                opacity: [
                    [0.0, 0.2],
                    [465.0, 0.0],
                    [-20.0, 0.0],
                    [-10.0, 1.0],
                    [10.0, 1.0],
                    [20.0, 0.0],
                    [59000.0, 0.0],
                    [59520.0, 0.2],
                ]
                .iter()
                .enumerate()
                .map(|(i, &[at, alpha])| [if (2..6).contains(&i) { centre + at } else { at }, alpha])
                .collect(),
                gradient_opacity: vec![[0.0, 1.0], [100.0, 0.5]],
                ..TransferFunction::default()
            };
            let grid = TransferGrid::new(&transfer, &encoding);
            let most = (0..200).map(|i| grid.lookup(centre as f32 + i as f32 - 100.0, 0.0)[3]).fold(0.0, f32::max);
            assert!(most > 0.99, "{centre}: {most}");
            assert_eq!(grid.lookup(centre as f32 + 200.0, 0.0)[3], 0.0);
        }
    }

    #[test]
    fn regions_end_at_their_sides() {
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 1.0), false);
        let transfer = TransferFunction {
            regions: vec![region(Shape::Rectangle, [100.0, 120.0], [10.0, 50.0])],
            ..TransferFunction::default()
        };
        let grid = TransferGrid::new(&transfer, &encoding);
        for (code, gradient, expected) in [
            (100.0, 30.0, 0.5),
            (120.0, 30.0, 0.5),
            (99.0, 30.0, 0.0),
            (121.0, 30.0, 0.0),
            (110.0, 50.0, 0.5),
            (110.0, 50.3, 0.0),
            (110.0, 1e9, 0.0),
            (110.0, 9.5, 0.0),
            (0.0, 30.0, 0.0),
            (255.0, 30.0, 0.0),
        ] {
            assert_eq!(grid.lookup(code, gradient)[3], expected, "{code} {gradient}");
        }
        assert_eq!(&grid.lookup(99.5, 30.0)[..3], [1.0, 0.5, 0.25], "its colour as far as it goes");
        // Also with rows three codes apart.
        let encoding = SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false);
        let wide = Region { value: [1000.0, 4001.0], ..transfer.regions[0] };
        let grid = TransferGrid::new(&TransferFunction { regions: vec![wide], ..transfer }, &encoding);
        for (code, expected) in [(996.0, 0.0), (1000.0, 0.5), (4001.0, 0.5), (4005.0, 0.0), (0.0, 0.0), (65535.0, 0.0)]
        {
            // A row's place is in single precision.
            assert!((grid.lookup(code, 30.0)[3] - expected).abs() < 1e-5, "{code}");
        }
    }

    #[test]
    fn media_in_one_place_add_their_extinctions() {
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 0.0, 0.0]],
            opacity: vec![[0.0, 0.75]],
            regions: vec![Region { color: [0.0, 1.0, 0.0], ..region(Shape::Rectangle, [0.0, 9.0], [0.0, 9.0]) }],
            ..TransferFunction::default()
        };
        // Two halvings of red and one of green.
        let expected = [2.0 / 3.0, 1.0 / 3.0, 0.0, 1.0 - 1.0 / 8.0];
        transfer.at(4.0, 4.0).into_iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-12));
        assert_eq!(transfer.at(4.0, 10.0), [1.0, 0.0, 0.0, 0.75]);
    }

    /// Skipping relies on this.
    #[test]
    fn what_is_clear_at_every_gradient_is_known_to_be() {
        for (voxel_type, codes) in [(VoxelType::I8, 256usize), (VoxelType::I16, 65536)] {
            let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
            let transfer = TransferFunction {
                regions: vec![
                    region(Shape::Gaussian, [-90.0, -70.0], [5.0, 9.0]),
                    region(Shape::Triangle, [90.0, 99.0], [2.0, 30.0]),
                ],
                ..ramps()
            };
            let grid = TransferGrid::new(&transfer, &encoding);
            let most: Vec<f32> = grid.most(codes, 1).collect();
            let zero = encoding.unorm(0.0) as f32 * (codes - 1) as f32;
            for i in -1270..1270 {
                let code = zero + i as f32 / 10.0;
                let of_two = most[code.floor() as usize].max(most[code.ceil() as usize]);
                for gradient in 0..70 {
                    assert!(grid.lookup(code, gradient as f32)[3] <= of_two + 1e-6, "{voxel_type:?} {code}");
                }
            }
            assert_eq!(most[(zero - 60.0) as usize], 0.0, "between the regions all is clear");
        }
    }
}
