//! An expression as the text of a shader's function, for renderers that compile it in: a line per operation.
//!
//! Shaders need know neither infinity nor NaN: beside each value goes whether it is one, and what would be no number is not
//! computed.

use super::{Binary, Expression, Operation, Unary};
use std::fmt::Write;

/// The greatest finite `f32`, rounded towards zero.
const GREATEST: &str = "3.4e38";

impl Expression {
    /// `struct Result { value: f32, is_valid: bool }` and `fn expression(values: array<f32, N>, are_valid: array<bool, N>) -> Result`
    /// over so many volumes.
    pub fn wgsl(&self, volumes: usize) -> String {
        let mut text = String::from("struct Result {\n    value: f32,\n    is_valid: bool,\n}\n\n");
        let arrays = format!("values: array<f32, {volumes}>, are_valid: array<bool, {volumes}>");
        let _ = writeln!(text, "fn expression({arrays}) -> Result {{");
        for (i, operation) in self.operations.iter().enumerate() {
            let (value, is_valid) = line(operation);
            let _ =
                writeln!(text, "    let x{i} = {value};\n    let k{i} = {};", is_valid.replace("$x", &format!("x{i}")));
        }
        let last = self.operations.len() - 1;
        let _ = writeln!(text, "    return Result(select(0.0, x{last}, k{last}), k{last});\n}}");
        text
    }
}

/// An operation's value, and whether it is one; `$x` is the value.
fn line(operation: &Operation) -> (String, String) {
    let always = || "true".to_string();
    match *operation {
        Operation::Number(number) => match number as f32 {
            single if single.is_finite() => (format!("{single:?}f"), always()),
            _ => ("0.0".into(), "false".into()),
        },
        Operation::Volume(volume) => (format!("values[{volume}]"), format!("are_valid[{volume}]")),
        Operation::Unary(unary, x) => (unary.wgsl(x), unary.wgsl_validity(x)),
        Operation::Binary(binary, x, y) => (binary.wgsl(x, y), binary.wgsl_validity(x, y)),
        Operation::Choose(c, yes, no) => {
            (format!("select(x{no}, x{yes}, x{c} != 0.0)"), format!("k{c} && select(k{no}, k{yes}, x{c} != 0.0)"))
        }
    }
}

fn truth(condition: String) -> String {
    format!("select(0.0, 1.0, {condition})")
}

impl Unary {
    fn wgsl(self, x: usize) -> String {
        match self {
            Self::Negate => format!("-x{x}"),
            Self::Not => truth(format!("x{x} == 0.0")),
            Self::Abs => format!("abs(x{x})"),
            Self::Sign => format!("sign(x{x})"),
            Self::Floor => format!("floor(x{x})"),
            Self::Ceil => format!("ceil(x{x})"),
            Self::Round => format!("round(x{x})"),
            Self::Sqrt => format!("sqrt(max(x{x}, 0.0))"),
            Self::Exp => format!("exp(min(x{x}, 89.0))"),
            Self::Log => format!("log(select(1.0, x{x}, x{x} > 0.0))"),
            Self::Sin => format!("sin(x{x})"),
            Self::Cos => format!("cos(x{x})"),
            Self::Valid => truth(format!("k{x}")),
        }
    }

    fn wgsl_validity(self, x: usize) -> String {
        match self {
            Self::Valid => "true".into(),
            Self::Sqrt => format!("k{x} && x{x} >= 0.0"),
            Self::Log => format!("k{x} && x{x} > 0.0"),
            Self::Exp => format!("k{x} && x{x} < 88.7"),
            _ => format!("k{x}"),
        }
    }
}

impl Binary {
    fn wgsl(self, x: usize, y: usize) -> String {
        match self {
            Self::Add => format!("x{x} + x{y}"),
            Self::Subtract => format!("x{x} - x{y}"),
            Self::Multiply => format!("x{x} * x{y}"),
            Self::Divide => format!("x{x} / select(x{y}, 1.0, x{y} == 0.0)"),
            Self::Power => {
                let is_odd = format!("fract(x{y} * 0.5) != 0.0");
                let power = format!("pow(max(abs(x{x}), 1e-37), x{y}) * select(1.0, -1.0, x{x} < 0.0 && {is_odd})");
                format!("select({power}, {}, x{x} == 0.0)", truth(format!("x{y} == 0.0")))
            }
            Self::Min => format!("min(x{x}, x{y})"),
            Self::Max => format!("max(x{x}, x{y})"),
            Self::Less => truth(format!("x{x} < x{y}")),
            Self::LessOrEqual => truth(format!("x{x} <= x{y}")),
            Self::Equal => truth(format!("x{x} == x{y}")),
            Self::And => truth(format!("x{x} != 0.0 && x{y} != 0.0")),
            Self::Or => truth(format!("x{x} != 0.0 || x{y} != 0.0")),
            Self::Default => format!("select(x{y}, x{x}, k{x})"),
        }
    }

    fn wgsl_validity(self, x: usize, y: usize) -> String {
        let both = format!("k{x} && k{y}");
        match self {
            Self::Add | Self::Subtract | Self::Multiply => format!("{both} && abs($x) <= {GREATEST}"),
            Self::Divide => format!("{both} && x{y} != 0.0 && abs($x) <= {GREATEST}"),
            Self::Power => {
                let exists =
                    format!("(x{x} > 0.0 || (x{x} == 0.0 && x{y} >= 0.0) || (x{x} < 0.0 && x{y} == floor(x{y})))");
                format!("{both} && {exists} && abs($x) <= {GREATEST}")
            }
            Self::Default => format!("k{x} || k{y}"),
            _ => both,
        }
    }
}
