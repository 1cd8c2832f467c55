//! Sufficient precision of expressions: GPUs work in single precision, and slots of 32-bit integers hold 24 bits of the distance from one of them.
//! Judged by conservative ranges of all operations' results.

use super::{Binary, Expression, Operation, Range, Unary};
use crate::ensure::ensure;

/// Greatest of the consecutive whole numbers in f32.
pub const GREATEST_WHOLE: f64 = 16_777_216.0;

/// The limits of single precision with all of its 24 bits.
const GREATEST: f64 = 3.4e38;
const LEAST: f64 = 1.2e-38;

/// Harmless error of a value, as a share of its range, where no operation has steps: a code of 16 bits.
const UNSEEN: f64 = 1.0 / 65536.0;

/// The values of a volume in an expression.
#[derive(Clone, Copy, Debug)]
pub struct Operand {
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Least and greatest value held exactly.
    pub exact: [f64; 2],
    /// Greatest error of other values.
    pub error: f64,
}

impl Operand {
    /// Creates a volume with exact values in this range.
    pub fn exact(range: [f64; 2]) -> Self {
        Self { range, exact: range, error: 0.0 }
    }

    /// Whether some values are rounded.
    fn is_rounded(&self) -> bool {
        self.range[0] < self.exact[0] || self.range[1] > self.exact[1]
    }
}

/// Why an expression cannot be evaluated faithfully.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PrecisionError {
    /// Some results are too great.
    #[error("a part of it may reach {0:e}, and single precision ends at 3.4e38")]
    TooGreat(f64),
    /// Some results are too small.
    #[error("a part of it is {0:e} at most, and single precision begins at 1.2e-38")]
    TooSmall(f64),
    /// Neighbouring values coincide.
    #[error("it reads whole numbers up to {0}, and single precision cannot tell neighbours beyond 16777216 apart")]
    Whole(f64),
}

impl Expression {
    /// Checks that this expression is evaluated faithfully over these values of volumes, with results in f32 if `is_single`, else f64.
    ///
    /// # Errors
    /// The reason if not.
    ///
    /// # Panics
    /// If `volumes` lacks a volume of the expression.
    pub fn check_precision(&self, volumes: &[Operand], is_single: bool) -> Result<(), PrecisionError> {
        self.check_steps(volumes)?;
        for volume in self.volumes() {
            let Operand { range: [low, high], error, .. } = volumes[volume];
            let is_seen = volumes[volume].is_rounded() && error > UNSEEN * (high - low);
            ensure(!is_seen, || PrecisionError::Whole(high.abs().max(low.abs())))?;
        }
        if !is_single {
            return Ok(());
        }
        let ranges: Vec<Range> = volumes.iter().map(|volume| Some(volume.range)).collect();
        let ranges = self.ranges(&ranges);
        for (operation, range) in self.operations.iter().zip(&ranges) {
            let &Some([low, high]) = range else { continue };
            let greatest = high.abs().max(low.abs());
            let is_too_great = greatest > GREATEST && (greatest.is_finite() || operation.makes_infinite(&ranges));
            ensure(!is_too_great, || PrecisionError::TooGreat(greatest))?;
            ensure(!(greatest > 0.0 && greatest < LEAST), || PrecisionError::TooSmall(greatest))?;
        }
        Ok(())
    }

    /// Checks that no operation with steps depends on rounded values. Comparing a volume with an exact number is harmless, as rounding keeps the
    /// order of values.
    fn check_steps(&self, volumes: &[Operand]) -> Result<(), PrecisionError> {
        // The greatest value of a rounded volume in each result.
        let mut rounded: Vec<Option<f64>> = Vec::with_capacity(self.operations.len());
        let of_volume = |place: usize| {
            let Operand { range: [low, high], .. } = volumes[place];
            volumes[place].is_rounded().then_some(high.abs().max(low.abs()))
        };
        let are_told_apart = |x: usize, y: usize| match (self.operations[x], self.operations[y]) {
            (Operation::Volume(volume), Operation::Number(number))
            | (Operation::Number(number), Operation::Volume(volume)) => {
                let Operand { range, exact, .. } = volumes[volume];
                (exact[0]..=exact[1]).contains(&number) || !(range[0]..=range[1]).contains(&number)
            }
            _ => false,
        };
        for operation in &self.operations {
            let none = |x: usize| rounded[x].map_or(Ok(None), |value| Err(PrecisionError::Whole(value)));
            let result =
                match *operation {
                    Operation::Number(_) | Operation::Unary(Unary::Valid, _) => None,
                    Operation::Volume(volume) => of_volume(volume),
                    Operation::Unary(Unary::Not | Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round, x) => {
                        none(x)?
                    }
                    Operation::Unary(_, x) => rounded[x],
                    Operation::Binary(Binary::Less | Binary::LessOrEqual | Binary::Equal, x, y) => {
                        if are_told_apart(x, y) { None } else { none(x)?.or(none(y)?) }
                    }
                    Operation::Binary(Binary::And | Binary::Or, x, y) => none(x)?.or(none(y)?),
                    Operation::Binary(_, x, y) => rounded[x].or(rounded[y]),
                    Operation::Choose(condition, yes, no) => none(condition)?.or(rounded[yes]).or(rounded[no]),
                };
            rounded.push(result);
        }
        Ok(())
    }
}

impl Operation {
    /// Whether a result without bounds comes from finite operands and grows too great. Possible divisions by 0 have no bounds in any precision.
    fn makes_infinite(&self, ranges: &[Range]) -> bool {
        let is_finite = |x: usize| ranges[x].is_none_or(|range| range.iter().all(|end| end.is_finite()));
        let holds_zero = |x: usize| ranges[x].is_none_or(|[low, _]| low <= 0.0);
        match *self {
            Self::Number(_) | Self::Volume(_) => true,
            Self::Unary(unary, x) => unary == Unary::Exp && is_finite(x),
            Self::Binary(Binary::Divide, ..) => false,
            Self::Binary(Binary::Power, x, y) => {
                is_finite(x) && is_finite(y) && !(holds_zero(x) && ranges[y].is_none_or(|[low, _]| low < 0.0))
            }
            Self::Binary(_, x, y) => is_finite(x) && is_finite(y),
            Self::Choose(..) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_single_precision_does_not_hold_is_found() {
        let judge = |text: &str, range: [f64; 2], error: f64| {
            let expression = Expression::parse(text, 1).unwrap();
            let exact = if error > 0.0 { [-GREATEST_WHOLE, GREATEST_WHOLE] } else { range };
            expression.check_precision(&[Operand { range, exact, error }], true)
        };
        let bytes = [0.0, 255.0];
        for text in ["a", "a == 3", "1 / (a - 3) + 1", "log(a)", "a ^ 9 / 3", "a ^ -2", "sin(a * 1e5)", "exp(a / 5)"] {
            let found = judge(text, bytes, 0.0);
            assert!(found.is_ok(), "{text}: {found:?}");
        }
        for text in
            ["a + 1e39", "a * 1e30 * 1e30 > 0", "exp(a)", "log(exp(a))", "exp(exp(a))", "a ^ 20 > 3", "(a + 1) ^ 900"]
        {
            assert!(matches!(judge(text, bytes, 0.0), Err(PrecisionError::TooGreat(_))), "{text}");
        }
        assert!(matches!(judge("a * 1e-30 * 1e-30 > 0", bytes, 0.0), Err(PrecisionError::TooSmall(_))));
        // A step exposes any error, but not among exact values; a ramp exposes a visible one.
        for text in ["a * 2", "a == 7 || a > 300", "1e9 < a ? a : 3", "!(a < 16777216) && a != 3"] {
            let found = judge(text, [-2e8, 2e8], 12.0);
            assert!(found.is_ok(), "{text}: {found:?}");
        }
        for (text, range) in [
            ("a == 100000001", [-2e9, 2e9]),
            ("a / 3 == 7", [-2e9, 2e9]),
            ("floor(a / 10)", [0.0, 4e9]),
            ("a ? 1 : 0", [0.0, 4e9]),
            ("a - 4e9", [4e9, 4e9 + 30.0]),
        ] {
            assert!(matches!(judge(text, range, 128.0), Err(PrecisionError::Whole(_))), "{text}");
        }
        // In double precision only the values' own error counts.
        let wide = Expression::parse("exp(a) + a * 1e300", 1).unwrap();
        assert!(wide.check_precision(&[Operand::exact(bytes)], false).is_ok());
        let steps = Expression::parse("a == 30000000", 1).unwrap();
        let operand = Operand { range: [0.0, 4e9], exact: [0.0, GREATEST_WHOLE], error: 128.0 };
        assert!(steps.check_precision(&[operand], false).is_err());
    }
}
