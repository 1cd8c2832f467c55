//! Pre-integration: the transfer function's mean over an interval of values, from its running integrals.
//!
//! Along a straight line from one value to another, the transmitted light depends on the integral of the extinction over the values in
//! between: a difference of two entries of a running integral (Engel, Kraus and Ertl, High-Quality Pre-Integrated Volume Rendering,
//! 2001, section 4.1). So a table has one entry per code, not per pair: it is made instantly when the transfer function changes, for
//! 65,536 codes and steps of any length. Opacity is exact, as with infinitely many plain samples. Colour is the mean weighted by
//! extinction, ignoring how absorption within one part of a segment orders colours; a constant colour is exact, too.

/// The greatest extinction, in halvings of the light over a unit distance; replaces the infinite extinction of an opacity of 1.
pub const MAX_DEPTH: f64 = 4096.0;

/// Distance of two codes below which the transfer function is not integrated, but read in their middle.
pub const CLOSE_CODES: f64 = 1.0 / 64.0;

/// The extinction of a medium of opacity `alpha`, in halvings of the light over a unit distance, at most [`MAX_DEPTH`].
pub fn depth(alpha: f64) -> f64 {
    (-(1.0 - alpha).log2()).min(MAX_DEPTH)
}

/// Colour and extinction of a medium.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Medium {
    /// Straight colour.
    pub rgb: [f64; 3],
    /// Extinction: halvings of the light over a unit distance.
    pub depth: f64,
}

/// Running integrals over codes of extinction, and of extinction times colour; opacity and colour are linear from code to code.
#[derive(Clone, Debug, PartialEq)]
pub struct Integrals {
    /// Straight `[r, g, b, opacity]` at each code.
    entries: Vec<[f64; 4]>,
    /// Integrals of `[r, g, b, 1] * extinction` from code 0.
    sums: Vec<[f64; 4]>,
}

impl Integrals {
    /// Integrates the entries of a [table](crate::TransferTable), at least two, over their codes.
    pub fn new(entries: &[[f32; 4]]) -> Self {
        let entries: Vec<[f64; 4]> = entries.iter().map(|entry| entry.map(f64::from)).collect();
        let mut sums = vec![[0.0; 4]; entries.len()];
        for i in 1..entries.len() {
            let step = upto(entries[i - 1], entries[i], 1.0);
            sums[i] = std::array::from_fn(|k| sums[i - 1][k] + step[k]);
        }
        Self { entries, sums }
    }

    /// The running integrals of `[r, g, b, 1] * extinction`, from code 0 to each code.
    pub fn sums(&self) -> &[[f64; 4]] {
        &self.sums
    }

    /// Extinction and straight colour at a code, whole or not.
    pub fn at(&self, code: f64) -> Medium {
        let (i, t) = self.split(code);
        let [r, g, b, alpha] =
            std::array::from_fn(|k| self.entries[i][k] + t * (self.entries[i + 1][k] - self.entries[i][k]));
        Medium { rgb: [r, g, b], depth: depth(alpha) }
    }

    /// The mean medium between two codes, in any order, whole or not, even beyond the first or last code.
    pub fn between(&self, from: f64, to: f64) -> Medium {
        let length = (to - from).abs();
        if length < CLOSE_CODES {
            return self.at(0.5 * (from + to));
        }
        let (low, high) = (self.upto(from.min(to)), self.upto(from.max(to)));
        let [r, g, b, sum]: [f64; 4] = std::array::from_fn(|k| (high[k] - low[k]).max(0.0));
        let share = if sum > 0.0 { 1.0 / sum } else { 0.0 };
        Medium { rgb: [r * share, g * share, b * share], depth: sum / length }
    }

    /// The running integrals up to a code. Past the ends of the entries the medium is constant.
    fn upto(&self, code: f64) -> [f64; 4] {
        let (i, t) = self.split(code);
        let part = upto(self.entries[i], self.entries[i + 1], t);
        let Medium { rgb: [r, g, b], depth } = self.at(code);
        let beyond = (code - (i as f64 + t)) * depth;
        std::array::from_fn(|k| self.sums[i][k] + part[k] + beyond * [r, g, b, 1.0][k])
    }

    fn split(&self, code: f64) -> (usize, f64) {
        let i = (code.max(0.0) as usize).min(self.entries.len() - 2);
        (i, (code - i as f64).clamp(0.0, 1.0))
    }
}

/// The integrals over the first `t` of the way from one entry to the next, with the colour in the middle of this stretch.
fn upto(a: [f64; 4], b: [f64; 4], t: f64) -> [f64; 4] {
    let depth = depth_upto(a[3], b[3], t);
    let color = |k: usize| (a[k] + 0.5 * t * (b[k] - a[k])) * depth;
    [color(0), color(1), color(2), depth]
}

/// The integral of the extinction over the first `t` of the way between two opacities.
fn depth_upto(from: f64, to: f64, t: f64) -> f64 {
    let slope = to - from;
    if slope.abs() < 1e-5 {
        return t * depth(from + 0.5 * t * slope);
    }
    // Of -log2(u), where u = 1 - from - slope * t.
    let integral = |u: f64| if u > 0.0 { u * u.ln() - u } else { 0.0 };
    (integral(1.0 - from - t * slope) - integral(1.0 - from)) / (slope * std::f64::consts::LN_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(alpha: impl Fn(usize) -> f32) -> Vec<[f32; 4]> {
        let entry = |i: usize| [i as f32 / 255.0, 1.0 - i as f32 / 255.0, 0.5, alpha(i)];
        (0..256).map(entry).collect()
    }

    #[test]
    fn means_are_those_of_many_samples() {
        let integrals = Integrals::new(&table(|i| if i == 77 { 0.9 } else { (i as f32 / 400.0).powi(2) }));
        for (from, to) in [(0.0, 255.0), (70.3, 80.9), (80.9, 70.3), (76.2, 76.9), (12.0, 12.001), (254.5, 255.0)] {
            let samples = 200_000;
            let (mut depth, mut rgb) = (0.0, [0.0; 3]);
            for i in 0..samples {
                let medium = integrals.at(from + (i as f64 + 0.5) / samples as f64 * (to - from));
                depth += medium.depth / samples as f64;
                (0..3).for_each(|k| rgb[k] += medium.rgb[k] * medium.depth / samples as f64);
            }
            let found = integrals.between(from, to);
            assert!((found.depth - depth).abs() < 1e-6 * (1.0 + depth), "{from} {to}: {found:?} {depth}");
            // Colours change by 1/255 from code to code.
            (0..3).for_each(|k| assert!((found.rgb[k] - rgb[k] / depth).abs() < 0.5 / 255.0, "{from} {to} {k}"));
        }
    }

    #[test]
    fn past_its_ends_the_medium_goes_on() {
        let integrals = Integrals::new(&table(|i| 0.25 + i as f32 / 1024.0));
        let (first, last) = (integrals.at(0.0), integrals.at(255.0));
        assert_eq!((integrals.between(-9.0, -4.0), integrals.between(300.0, 1e12)).0.rgb, first.rgb);
        for (found, end) in [(integrals.between(-1e9, -4.0), first), (integrals.between(1e12, 300.0), last)] {
            assert!((found.depth - end.depth).abs() < 1e-9, "{found:?}");
        }
        let whole = integrals.between(0.0, 255.0);
        let found = integrals.between(-255.0, 510.0);
        assert!((found.depth - (first.depth + whole.depth + last.depth) / 3.0).abs() < 1e-9, "{found:?}");
        let rgb = (first.rgb[0] * first.depth + whole.rgb[0] * whole.depth + last.rgb[0] * last.depth) / 3.0;
        assert!((found.rgb[0] - rgb / found.depth).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn what_is_clear_and_what_is_opaque_have_numbers() {
        let clear = Integrals::new(&table(|_| 0.0)).between(3.0, 200.0);
        assert_eq!(clear, Medium::default());
        let opaque = Integrals::new(&table(|_| 1.0)).between(3.0, 200.0);
        assert_eq!(opaque.depth, MAX_DEPTH);
        assert!(opaque.rgb.iter().all(|c| (0.0..=1.0).contains(c)));
    }
}
