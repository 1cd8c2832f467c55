//! Expressions over the values of several volumes at one place: `max(a, b * 0.5)`.
//!
//! A text is parsed into a straight list of operations, each on results of earlier ones, so evaluation needs no recursion and a
//! shader can list them line by line. The language has no loops, storage or calls: an expression costs the sum of its operations,
//! at most [`MAX_OPERATIONS`].
//!
//! A volume may have no value at a place: outside its box, or at non-finite voxels. An operation on no value has no value, except
//! `default(x, y)`, `valid(x)`, and the untaken side of `c ? x : y`. `1 / 0` and other non-finite results are no values either.

mod parse;
mod precision;
mod range;
mod wgsl;

pub use precision::{GREATEST_WHOLE, Operand, PrecisionError};
pub use range::Range;

use glam::DVec3;

/// The most volumes in a picture or an expression.
pub const MAX_VOLUMES: usize = 32;

/// The most operations in an expression.
pub const MAX_OPERATIONS: usize = 128;

/// A gradient shorter than this share of its terms' summed lengths counts as none, being the rounding error of cancelling terms.
/// 32-bit renderers have the terms to about a ten-thousandth.
pub const FLAT_SHARE: f64 = 1e-3;

/// An operation on one value, `x`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    /// `-x`: the negative.
    Negate,
    /// `!x`: 1 where x is 0, else 0.
    Not,
    /// `abs(x)`: the absolute value.
    Abs,
    /// `sign(x)`: -1, 0 or 1 by the sign of `x`.
    Sign,
    /// `floor(x)`: the greatest whole number up to `x`.
    Floor,
    /// `ceil(x)`: the least whole number from `x` on.
    Ceil,
    /// `round(x)`: the nearest whole number; halves go to the even one.
    Round,
    /// `sqrt(x)`: the square root; no value where `x` is negative.
    Sqrt,
    /// `exp(x)`: e to the power of `x`.
    Exp,
    /// `log(x)`: the natural logarithm; no value where `x` is not positive.
    Log,
    /// `sin(x)`: the sine of `x` in radians.
    Sin,
    /// `cos(x)`: the cosine of `x` in radians.
    Cos,
    /// `valid(x)`: 1 where `x` has a value, else 0.
    Valid,
}

/// An operation on two values, `x` and `y`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// `x + y`: the sum.
    Add,
    /// `x - y`: the difference.
    Subtract,
    /// `x * y`: the product.
    Multiply,
    /// `x / y`: the quotient; no value where `y` is 0.
    Divide,
    /// `x ^ y`: the power; for a negative `x` only with a whole `y`.
    Power,
    /// `min(x, y)`: the lesser value.
    Min,
    /// `max(x, y)`: the greater value.
    Max,
    /// `x < y`: 1 if `x` is less than `y`, else 0.
    Less,
    /// `x <= y`: 1 if `x` is not greater than `y`, else 0.
    LessOrEqual,
    /// `x == y`: 1 if both values are the same, else 0.
    Equal,
    /// `x && y`: 1 if neither value is 0, else 0.
    And,
    /// `x || y`: 1 if at least one value is not 0, else 0.
    Or,
    /// `default(x, y)`: `x`, or `y` where `x` has no value.
    Default,
}

/// One operation of an expression. Each operand is the position of an earlier operation and stands for its result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operation {
    /// A constant.
    Number(f64),
    /// The value of a volume, by its position.
    Volume(usize),
    /// An operation on one operand.
    Unary(Unary, usize),
    /// An operation on two operands.
    Binary(Binary, usize, usize),
    /// The second operand where the first is not 0, else the third.
    Choose(usize, usize, usize),
}

/// An expression over the values of volumes.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    text: String,
    operations: Vec<Operation>,
}

/// Why a text is not an expression.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{problem}\n  {text}\n  {caret:>column$}", caret = '^', column = position + 1)]
pub struct ExpressionError {
    /// Expected and found text.
    pub problem: String,
    /// The expression's text, on one line; only its first 40 characters if it is too long to read.
    pub text: String,
    /// Position of the problem in `text`, in characters from 0.
    pub position: usize,
}

impl Expression {
    /// Parses an expression over `volumes` volumes: `a` or `v0` is the first, `b` or `v1` the second.
    ///
    /// # Errors
    /// If the text is no expression over these volumes; the message has a caret under the problem.
    pub fn parse(text: &str, volumes: usize) -> Result<Self, ExpressionError> {
        // Carets stand under characters of one line.
        let text: String = text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).collect();
        let operations = parse::operations(&text, volumes)?;
        Ok(Self { text, operations })
    }

    /// The parsed text, on one line.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The operations in order, at least one; the last result is the expression's.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// Positions of the volumes read by the expression, ascending.
    pub fn volumes(&self) -> Vec<usize> {
        let reads = |volume: &usize| self.operations.contains(&Operation::Volume(*volume));
        (0..MAX_VOLUMES).filter(reads).collect()
    }

    /// Renumbers the expression's volumes from 0, in their order, without unread ones.
    pub fn of_its_own(&self) -> Self {
        let volumes = self.volumes();
        let place = |volume: usize| volumes.iter().position(|v| *v == volume).unwrap_or(volume);
        let operations = self.operations.iter().map(|operation| match *operation {
            Operation::Volume(volume) => Operation::Volume(place(volume)),
            other => other,
        });
        Self { text: self.text.clone(), operations: operations.collect() }
    }

    /// The expression's least and greatest value over these windows of the volumes. If only the greatest is infinite, or the range
    /// is too wide for an `f64`, both are the least value; if the least is infinite, or there is no value, they are 0 and 1.
    pub fn window(&self, windows: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
        let windows: Vec<Range> = windows.map(|(low, high)| Some([low, high])).collect();
        match self.range(&windows) {
            Some([low, high]) if low < high && (high - low).is_finite() => (low, high),
            // Shown like a volume of one value.
            Some([low, high]) if low == high && low.is_finite() => (low, low),
            _ => (0.0, 1.0),
        }
    }

    /// Evaluates the expression at these values of the volumes; NaN is no value.
    ///
    /// # Panics
    /// If `volumes` lacks a volume of the expression.
    pub fn value(&self, volumes: &[f64]) -> f64 {
        self.work_out(volumes, |_, _, _| {})
    }

    /// Evaluates the expression, and its gradient by the chain rule, at these values and gradients of the volumes. The gradient is
    /// `None` where its terms cancel to less than [`FLAT_SHARE`] of their sum, where the value has steps, and where the gradient
    /// would be infinite.
    ///
    /// # Panics
    /// If `volumes` or `gradients` lacks a volume of the expression.
    pub fn value_and_gradient(&self, volumes: &[f64], gradients: &[DVec3]) -> (f64, Option<DVec3>) {
        let mut slopes = [Slope::FLAT; MAX_OPERATIONS];
        let value = self.work_out(volumes, |i, operation, results| {
            slopes[i] = match *operation {
                Operation::Number(_) => Slope::FLAT,
                Operation::Volume(volume) => Slope { gradient: gradients[volume], terms: gradients[volume].length() },
                Operation::Unary(unary, x) => slopes[x].times(unary.slope(results[x])),
                Operation::Binary(binary, x, y) => {
                    let [of_x, of_y] = binary.slopes(results[x], results[y]);
                    slopes[x].times(of_x).plus(slopes[y].times(of_y))
                }
                Operation::Choose(condition, yes, no) => slopes[if results[condition] == 0.0 { no } else { yes }],
            };
        });
        let Slope { gradient, terms } = slopes[self.operations.len() - 1];
        let is_steep = gradient.is_finite() && gradient.length() > FLAT_SHARE * terms;
        (value, is_steep.then_some(gradient))
    }

    /// Evaluates the operations at these values; `see` gets each operation, its position, and all results so far.
    fn work_out(&self, volumes: &[f64], mut see: impl FnMut(usize, &Operation, &[f64; MAX_OPERATIONS])) -> f64 {
        let mut results = [0.0; MAX_OPERATIONS];
        for (i, operation) in self.operations.iter().enumerate() {
            let result = match *operation {
                Operation::Number(number) => number,
                Operation::Volume(volume) => volumes[volume],
                Operation::Unary(unary, x) => unary.of(results[x]),
                Operation::Binary(binary, x, y) => binary.of(results[x], results[y]),
                Operation::Choose(condition, yes, no) => match results[condition] {
                    c if c.is_nan() => f64::NAN,
                    0.0 => results[no],
                    _ => results[yes],
                },
            };
            results[i] = if result.is_finite() { result } else { f64::NAN };
            see(i, operation, &results);
        }
        results[self.operations.len() - 1]
    }
}

/// A gradient, and the summed lengths of its terms.
#[derive(Clone, Copy)]
struct Slope {
    gradient: DVec3,
    terms: f64,
}

impl Slope {
    const FLAT: Self = Self { gradient: DVec3::ZERO, terms: 0.0 };

    fn times(self, factor: f64) -> Self {
        // A flat term stays flat even under an infinite slope.
        if self.terms == 0.0 || factor == 0.0 {
            return Self::FLAT;
        }
        Self { gradient: self.gradient * factor, terms: self.terms * factor.abs() }
    }

    fn plus(self, other: Self) -> Self {
        Self { gradient: self.gradient + other.gradient, terms: self.terms + other.terms }
    }
}

fn truth(is_true: bool) -> f64 {
    is_true as u8 as f64
}

impl Unary {
    fn of(self, x: f64) -> f64 {
        match self {
            Self::Valid => truth(!x.is_nan()),
            _ if x.is_nan() => x,
            Self::Negate => -x,
            Self::Not => truth(x == 0.0),
            Self::Abs => x.abs(),
            Self::Sign => truth(x > 0.0) - truth(x < 0.0),
            Self::Floor => x.floor(),
            Self::Ceil => x.ceil(),
            Self::Round => x.round_ties_even(),
            Self::Sqrt => x.sqrt(),
            Self::Exp => x.exp(),
            Self::Log => x.ln(),
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
        }
    }

    /// The derivative; 0 for steps.
    fn slope(self, x: f64) -> f64 {
        match self {
            Self::Negate => -1.0,
            Self::Abs => truth(x > 0.0) - truth(x < 0.0),
            Self::Sqrt => 0.5 / x.sqrt(),
            Self::Exp => x.exp(),
            Self::Log => 1.0 / x,
            Self::Sin => x.cos(),
            Self::Cos => -x.sin(),
            Self::Not | Self::Sign | Self::Floor | Self::Ceil | Self::Round | Self::Valid => 0.0,
        }
    }
}

impl Binary {
    fn of(self, x: f64, y: f64) -> f64 {
        match self {
            Self::Default if x.is_nan() => y,
            Self::Default => x,
            _ if x.is_nan() || y.is_nan() => f64::NAN,
            Self::Add => x + y,
            Self::Subtract => x - y,
            Self::Multiply => x * y,
            Self::Divide => x / y,
            Self::Power => x.powf(y),
            Self::Min => x.min(y),
            Self::Max => x.max(y),
            Self::Less => truth(x < y),
            Self::LessOrEqual => truth(x <= y),
            Self::Equal => truth(x == y),
            Self::And => truth(x != 0.0 && y != 0.0),
            Self::Or => truth(x != 0.0 || y != 0.0),
        }
    }

    /// The derivatives by both operands; 0 for steps, and the first operand's where both are equal.
    fn slopes(self, x: f64, y: f64) -> [f64; 2] {
        let first = |is_first: bool| [truth(is_first), truth(!is_first)];
        match self {
            Self::Add => [1.0, 1.0],
            Self::Subtract => [1.0, -1.0],
            Self::Multiply => [y, x],
            Self::Divide => [1.0 / y, -x / (y * y)],
            // A base that is not positive has a power only for whole exponents, so there is no slope along the exponent.
            Self::Power => [y * x.powf(y - 1.0), if x > 0.0 { x.powf(y) * x.ln() } else { 0.0 }],
            Self::Min => first(x <= y),
            Self::Max => first(x >= y),
            Self::Default => first(!x.is_nan()),
            Self::Less | Self::LessOrEqual | Self::Equal | Self::And | Self::Or => [0.0; 2],
        }
    }
}

#[cfg(test)]
mod tests;
