//! Ranges of an expression's values, given those of the volumes: interval arithmetic (Moore, 1966), as plain as possible while
//! conservative.

use super::{Binary, Expression, Operation, Unary};

/// A range of values, from the least to the greatest; `None` where there is no value.
pub type Range = Option<[f64; 2]>;

const ALL: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Expression {
    /// A range around every possible value of the expression, with each volume's value in its range, or missing. `None` means
    /// no value at all.
    ///
    /// # Panics
    /// If `volumes` lacks a volume of the expression.
    pub fn range(&self, volumes: &[Range]) -> Range {
        self.ranges(volumes).pop().flatten()
    }

    /// The range of each operation's results.
    pub(super) fn ranges(&self, volumes: &[Range]) -> Vec<Range> {
        let mut results: Vec<Range> = Vec::with_capacity(self.operations.len());
        for operation in &self.operations {
            let result = match *operation {
                Operation::Number(number) => Some([number, number]),
                Operation::Volume(volume) => volumes[volume],
                Operation::Unary(unary, x) => unary.range(results[x]),
                Operation::Binary(Binary::Default, x, y) => union(results[x], results[y]),
                Operation::Binary(binary, x, y) => match (results[x], results[y]) {
                    (Some(x), Some(y)) => Some(binary.range(x, y)),
                    _ => None,
                },
                Operation::Choose(condition, yes, no) => match results[condition] {
                    None => None,
                    Some([0.0, 0.0]) => results[no],
                    Some([low, high]) if low > 0.0 || high < 0.0 => results[yes],
                    Some(_) => union(results[yes], results[no]),
                },
            };
            results.push(result);
        }
        results
    }
}

fn union(x: Range, y: Range) -> Range {
    match (x, y) {
        (Some([a, b]), Some([c, d])) => Some([a.min(c), b.max(d)]),
        (x, y) => x.or(y),
    }
}

/// The range of products, quotients or powers of ends; everything if one of them is NaN.
fn over_corners(x: [f64; 2], y: [f64; 2], of: impl Fn(f64, f64) -> f64) -> [f64; 2] {
    let corners = [of(x[0], y[0]), of(x[0], y[1]), of(x[1], y[0]), of(x[1], y[1])];
    if corners.iter().any(|corner| corner.is_nan()) {
        return ALL;
    }
    corners.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], c| [low.min(c), high.max(c)])
}

/// 1 if always true, 0 if never.
fn truths(always: bool, never: bool) -> [f64; 2] {
    match (always, never) {
        (true, _) => [1.0, 1.0],
        (_, true) => [0.0, 0.0],
        _ => [0.0, 1.0],
    }
}

fn holds_zero([low, high]: [f64; 2]) -> bool {
    low <= 0.0 && high >= 0.0
}

impl Unary {
    fn range(self, x: Range) -> Range {
        let Some([low, high]) = x else {
            return (self == Self::Valid).then_some([0.0, 0.0]);
        };
        Some(match self {
            Self::Negate => [-high, -low],
            Self::Not => truths(low == 0.0 && high == 0.0, !holds_zero([low, high])),
            Self::Abs if holds_zero([low, high]) => [0.0, high.max(-low)],
            Self::Abs => [low.abs().min(high.abs()), low.abs().max(high.abs())],
            Self::Sign | Self::Floor | Self::Ceil | Self::Round | Self::Exp => [self.of(low), self.of(high)],
            Self::Sqrt if high < 0.0 => return None,
            Self::Sqrt => [low.max(0.0).sqrt(), high.sqrt()],
            Self::Log if high <= 0.0 => return None,
            Self::Log => [low.max(0.0).ln(), high.ln()],
            Self::Sin | Self::Cos => [-1.0, 1.0],
            // A range may include places without a value.
            Self::Valid => [0.0, 1.0],
        })
    }
}

impl Binary {
    fn range(self, x: [f64; 2], y: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Add => [x[0] + y[0], x[1] + y[1]],
            Self::Subtract => [x[0] - y[1], x[1] - y[0]],
            Self::Multiply => over_corners(x, y, |a, b| a * b),
            Self::Divide if holds_zero(y) => ALL,
            Self::Divide => over_corners(x, y, |a, b| a / b),
            Self::Power if x[0] > 0.0 || x[0] == 0.0 && y[0] >= 0.0 => over_corners(x, y, f64::powf),
            Self::Power if y[0] >= 0.0 => {
                let most = x[0].abs().max(x[1].abs());
                let most = most.powf(y[0]).max(most.powf(y[1]));
                [-most, most]
            }
            Self::Power => ALL,
            Self::Min => [x[0].min(y[0]), x[1].min(y[1])],
            Self::Max => [x[0].max(y[0]), x[1].max(y[1])],
            Self::Less => truths(x[1] < y[0], x[0] >= y[1]),
            Self::LessOrEqual => truths(x[1] <= y[0], x[0] > y[1]),
            Self::Equal => truths(x[0] == x[1] && x == y, x[1] < y[0] || y[1] < x[0]),
            Self::And => truths(!holds_zero(x) && !holds_zero(y), x == [0.0, 0.0] || y == [0.0, 0.0]),
            Self::Or => truths(!holds_zero(x) || !holds_zero(y), x == [0.0, 0.0] && y == [0.0, 0.0]),
            Self::Default => [x[0].min(y[0]), x[1].max(y[1])],
        }
    }
}
