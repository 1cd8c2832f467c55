//! Expressions over the values of several volumes at one place: `max(a, b * 0.5)`.
//!
//! A text is parsed into a straight list of operations, each on results of earlier ones, so that it can be worked
//! out without recursion and written down in a shader line by line. There is nothing in the language that loops, stores or
//! calls out: an expression costs what its operations do, and of those there are at most [`MAX_OPERATIONS`].
//!
//! A volume may have no value at a place: its box does not reach there, or its voxels are not finite. What is made of no value
//! is no value, but for `default(x, y)`, `valid(x)`, and the side of `c ? x : y` that is not taken. Nor has `1 / 0`, or
//! whatever else is no finite number.

mod parse;
mod range;
mod wgsl;

pub use range::Range;

/// Volumes of a picture, at most.
pub const MAX_VOLUMES: usize = 32;

/// Operations of an expression, at most.
pub const MAX_OPERATIONS: usize = 128;

/// What is done with one value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    /// `-x`.
    Negate,
    /// `!x`: 1 where x is 0, else 0.
    Not,
    /// The distance from 0.
    Abs,
    /// -1, 0 or 1.
    Sign,
    /// The greatest whole number that is no greater.
    Floor,
    /// The least that is no less.
    Ceil,
    /// The nearest; halves go to the even one.
    Round,
    /// The square root.
    Sqrt,
    /// e to that power.
    Exp,
    /// The natural logarithm.
    Log,
    /// The sine of radians.
    Sin,
    /// The cosine of radians.
    Cos,
    /// 1 where there is a value, else 0.
    Valid,
}

/// What is done with two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// The sum.
    Add,
    /// The difference.
    Subtract,
    /// The product.
    Multiply,
    /// The quotient.
    Divide,
    /// The power; of negative numbers only whole ones.
    Power,
    /// The lesser.
    Min,
    /// The greater.
    Max,
    /// 1 if the first is less, else 0.
    Less,
    /// 1 if it is not greater.
    LessOrEqual,
    /// 1 if both are the same.
    Equal,
    /// 1 if neither is 0.
    And,
    /// 1 if not both are 0.
    Or,
    /// The first, or where it has no value the second.
    Default,
}

/// One operation. Operands are results of earlier ones, by their position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operation {
    /// A number.
    Number(f64),
    /// The value of a volume, by its position.
    Volume(usize),
    /// Of one operand.
    Unary(Unary, usize),
    /// Of two.
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

/// Why a text is no expression.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{problem}\n  {text}\n  {caret:>column$}", caret = '^', column = position + 1)]
pub struct ExpressionError {
    /// What was expected and what was found.
    pub problem: String,
    /// The text, on one line.
    pub text: String,
    /// Where in it, in characters.
    pub position: usize,
}

impl Expression {
    /// Reads an expression over so many volumes: `a` is the first, `b` the second, and `v0`, `v1` are the same by number.
    ///
    /// # Errors
    /// If the text is none; the message has a caret under the place.
    pub fn parse(text: &str, volumes: usize) -> Result<Self, ExpressionError> {
        // Carets stand under characters of one line.
        let text: String = text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).collect();
        let operations = parse::operations(&text, volumes)?;
        Ok(Self { text, operations })
    }

    /// What was read.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The operations in their order, at least one; the last one's result is the expression's.
    pub fn operations(&self) -> &[Operation] {
        &self.operations
    }

    /// Which volumes it reads, by their position; ascending.
    pub fn volumes(&self) -> Vec<usize> {
        let reads = |volume: &usize| self.operations.contains(&Operation::Volume(*volume));
        (0..MAX_VOLUMES).filter(reads).collect()
    }

    /// The same over the volumes that it reads alone, in their order.
    pub fn of_its_own(&self) -> Self {
        let volumes = self.volumes();
        let place = |volume: usize| volumes.iter().position(|v| *v == volume).unwrap_or(volume);
        let operations = self.operations.iter().map(|operation| match *operation {
            Operation::Volume(volume) => Operation::Volume(place(volume)),
            other => other,
        });
        Self { text: self.text.clone(), operations: operations.collect() }
    }

    /// The value where volumes have these; NaN is no value.
    ///
    /// # Panics
    /// If there are fewer than it was read for.
    pub fn value(&self, volumes: &[f64]) -> f64 {
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
        }
        results[self.operations.len() - 1]
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
}

#[cfg(test)]
mod tests;
