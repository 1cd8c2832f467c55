//! An expression as the text of a shader function, for renderers to compile in: a line per operation.
//!
//! Shaders need neither infinity nor NaN: each value has a flag of validity, and invalid results are not computed.

use super::{Binary, Expression, FLAT_SHARE, Operation, Unary};
use std::fmt::Write;

/// The greatest finite `f32`, rounded towards zero.
const GREATEST: &str = "3.4e38";

impl Expression {
    /// WGSL source of the expression over `volumes` volumes (`N` in it): `struct Result { value: f32, is_valid: bool }` and
    /// `fn expression(values: array<f32, N>, are_valid: array<bool, N>) -> Result`.
    pub fn wgsl(&self, volumes: usize) -> String {
        self.function(volumes, false)
    }

    /// WGSL source of the expression and its gradient over `volumes` volumes (`N` in it):
    /// `fn expression(values: array<f32, N>, are_valid: array<bool, N>, gradients: array<vec3f, N>) -> Result`. `Result` has
    /// `value: f32`, `is_valid: bool` and `gradient: vec3f`, zero without a gradient.
    pub fn wgsl_with_gradient(&self, volumes: usize) -> String {
        self.function(volumes, true)
    }

    fn function(&self, volumes: usize, has_gradient: bool) -> String {
        let (member, argument, result) = match has_gradient {
            true => ("    gradient: vec3f,\n", format!(", gradients: array<vec3f, {volumes}>"), ", steep_or_flat(g$n)"),
            false => ("", String::new(), ""),
        };
        let mut text = format!("struct Result {{\n    value: f32,\n    is_valid: bool,\n{member}}}\n\n");
        if has_gradient {
            let _ = writeln!(text, "{}", STEEP_OR_FLAT.replace("$share", &format!("{FLAT_SHARE:?}")));
        }
        let arrays = format!("values: array<f32, {volumes}>, are_valid: array<bool, {volumes}>{argument}");
        let _ = writeln!(text, "fn expression({arrays}) -> Result {{");
        for (i, operation) in self.operations.iter().enumerate() {
            let (value, is_valid) = line(operation);
            let _ =
                writeln!(text, "    let x{i} = {value};\n    let k{i} = {};", is_valid.replace("$x", &format!("x{i}")));
            if has_gradient {
                let _ = writeln!(text, "    let g{i} = {};", slope(operation, i));
            }
        }
        let last = self.operations.len() - 1;
        let result = result.replace("$n", &last.to_string());
        let _ = writeln!(text, "    return Result(select(0.0, x{last}, k{last}), k{last}{result});\n}}");
        text
    }
}

/// A slope, `vec4f`, is a gradient and the summed lengths of its terms; see [`Expression::value_and_gradient`].
const STEEP_OR_FLAT: &str = "\
fn steep_or_flat(slope: vec4f) -> vec3f {
    let steepness = length(slope.xyz);
    return select(vec3f(), slope.xyz, steepness > $share * slope.w && steepness <= 3.4e38);
}

fn sloped(slope: vec4f, factor: f32) -> vec4f {
    return vec4f(slope.xyz * factor, slope.w * abs(factor));
}
";

/// The slope of the operation numbered `own`.
fn slope(operation: &Operation, own: usize) -> String {
    let flat = || "vec4f()".to_string();
    let sloped = |x: usize, factor: &str| format!("sloped(g{x}, {factor})");
    match *operation {
        Operation::Number(_) => flat(),
        Operation::Volume(volume) => format!("vec4f(gradients[{volume}], length(gradients[{volume}]))"),
        Operation::Choose(c, yes, no) => format!("select(g{no}, g{yes}, x{c} != 0.0)"),
        Operation::Unary(unary, x) => match unary {
            Unary::Negate => sloped(x, "-1.0"),
            Unary::Abs => sloped(x, &format!("sign(x{x})")),
            Unary::Sqrt => sloped(x, &format!("0.5 / max(x{own}, 1e-19)")),
            Unary::Exp => sloped(x, &format!("x{own}")),
            Unary::Log => sloped(x, &format!("1.0 / max(x{x}, 1e-37)")),
            Unary::Sin => sloped(x, &format!("cos(x{x})")),
            Unary::Cos => sloped(x, &format!("-sin(x{x})")),
            Unary::Not | Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Valid => flat(),
        },
        Operation::Binary(binary, x, y) => match binary {
            Binary::Add => format!("g{x} + g{y}"),
            Binary::Subtract => format!("g{x} + {}", sloped(y, "-1.0")),
            Binary::Multiply => format!("{} + {}", sloped(x, &format!("x{y}")), sloped(y, &format!("x{x}"))),
            Binary::Divide => {
                let divisor = format!("select(x{y}, 1.0, x{y} == 0.0)");
                let of_y = sloped(y, &format!("-x{own} / {divisor}"));
                format!("{} + {of_y}", sloped(x, &format!("1.0 / {divisor}")))
            }
            Binary::Power => {
                let of_x = format!(
                    "select(x{y} * x{own} / select(x{x}, 1.0, x{x} == 0.0), select(0.0, 1.0, x{y} == 1.0), x{x} == 0.0)"
                );
                let of_y = format!("select(0.0, x{own} * log(max(x{x}, 1e-37)), x{x} > 0.0)");
                format!("{} + {}", sloped(x, &of_x), sloped(y, &of_y))
            }
            Binary::Min => format!("select(g{y}, g{x}, x{x} <= x{y})"),
            Binary::Max => format!("select(g{y}, g{x}, x{x} >= x{y})"),
            Binary::Default => format!("select(g{y}, g{x}, k{x})"),
            Binary::Less | Binary::LessOrEqual | Binary::Equal | Binary::And | Binary::Or => flat(),
        },
    }
}

/// An operation's value, and its validity; `$x` is the value.
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
