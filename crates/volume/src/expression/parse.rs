//! Parser of expressions: precedence climbing (Pratt, 1973), with an operation appended as soon as its operands are read.
//!
//! From loosest to tightest: `?:`, `||`, `&&`, `== !=`, `< <= > >=`, `+ -`, `* /`, the signs `- !`, and `^`, which groups from the
//! right, as does `?:`.

use super::{Binary, ExpressionError, MAX_OPERATIONS, MAX_VOLUMES, Operation, Unary};

/// Greatest nesting depth of parentheses and the like.
const MAX_DEPTH: usize = 64;

/// Greatest length in characters.
const MAX_LENGTH: usize = 4096;

const FUNCTIONS: [(&str, usize); 19] = [
    ("abs", 1),
    ("sign", 1),
    ("floor", 1),
    ("ceil", 1),
    ("round", 1),
    ("sqrt", 1),
    ("exp", 1),
    ("log", 1),
    ("sin", 1),
    ("cos", 1),
    ("valid", 1),
    ("min", 2),
    ("max", 2),
    ("pow", 2),
    ("default", 2),
    ("step", 2),
    ("clamp", 3),
    ("mix", 3),
    ("smoothstep", 3),
];

/// Binary operators and their tightness.
const OPERATORS: [(&str, u8); 13] = [
    ("||", 2),
    ("&&", 3),
    ("==", 4),
    ("!=", 4),
    ("<=", 5),
    (">=", 5),
    ("<", 5),
    (">", 5),
    ("+", 6),
    ("-", 6),
    ("*", 7),
    ("/", 7),
    ("^", POWER),
];

const CHOICE: u8 = 1;
const SIGN: u8 = 8;
const POWER: u8 = 9;

/// Parses the whole text.
pub(super) fn operations(text: &str, volumes: usize) -> Result<Vec<Operation>, ExpressionError> {
    let mut parser = Parser { text, at: 0, volumes, depth: 0, operations: Vec::new() };
    if text.chars().count() > MAX_LENGTH {
        let problem = format!("an expression of {} characters: expected at most {MAX_LENGTH}", text.chars().count());
        return Err(ExpressionError { problem, text: text.chars().take(40).collect(), position: 0 });
    }
    let result = parser.expression(0)?;
    match parser.peek() {
        // The last operation gives the result: operands are appended before operations on them.
        None => debug_assert_eq!(result + 1, parser.operations.len()),
        Some(_) => return Err(parser.expected("an operator or the end")),
    }
    Ok(parser.operations)
}

struct Parser<'a> {
    text: &'a str,
    /// Bytes read.
    at: usize,
    volumes: usize,
    depth: usize,
    operations: Vec<Operation>,
}

type Operand = Result<usize, ExpressionError>;

impl Parser<'_> {
    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    /// The next character that is no space.
    fn peek(&mut self) -> Option<char> {
        self.at += self.rest().len() - self.rest().trim_start().len();
        self.rest().chars().next()
    }

    /// Reads the token if it comes next.
    fn accept(&mut self, token: &str) -> bool {
        self.peek();
        let comes = self.rest().starts_with(token);
        self.at += if comes { token.len() } else { 0 };
        comes
    }

    fn expect(&mut self, token: &str) -> Result<(), ExpressionError> {
        if self.accept(token) { Ok(()) } else { Err(self.expected(&format!("'{token}'"))) }
    }

    fn error(&self, byte: usize, problem: String) -> ExpressionError {
        ExpressionError { problem, text: self.text.to_string(), position: self.text[..byte].chars().count() }
    }

    fn expected(&mut self, what: &str) -> ExpressionError {
        let found = self.peek().map_or("the end".to_string(), |c| format!("'{c}'"));
        self.error(self.at, format!("expected {what}, found {found}"))
    }

    fn push(&mut self, operation: Operation) -> Operand {
        if self.operations.len() == MAX_OPERATIONS {
            return Err(self.error(self.at, format!("more than {MAX_OPERATIONS} operations up to here")));
        }
        self.operations.push(operation);
        Ok(self.operations.len() - 1)
    }

    fn unary(&mut self, unary: Unary, x: usize) -> Operand {
        self.push(Operation::Unary(unary, x))
    }

    fn binary(&mut self, binary: Binary, x: usize, y: usize) -> Operand {
        self.push(Operation::Binary(binary, x, y))
    }

    /// Parses an operand and all operators that bind more tightly than `loosest`.
    fn expression(&mut self, loosest: u8) -> Operand {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(self.error(self.at, format!("more than {MAX_DEPTH} nested parts here")));
        }
        let mut left = self.operand()?;
        loop {
            self.peek();
            let rest = self.rest();
            let operator = OPERATORS.iter().find(|(token, tightness)| rest.starts_with(token) && *tightness > loosest);
            if let Some(&(token, tightness)) = operator {
                self.at += token.len();
                let right = self.expression(if tightness == POWER { SIGN - 1 } else { tightness })?;
                left = self.operator(token, left, right)?;
            } else if loosest < CHOICE && self.accept("?") {
                let yes = self.expression(0)?;
                self.expect(":")?;
                let no = self.expression(0)?;
                left = self.push(Operation::Choose(left, yes, no))?;
            } else {
                self.depth -= 1;
                return Ok(left);
            }
        }
    }

    fn operator(&mut self, token: &str, x: usize, y: usize) -> Operand {
        match token {
            "||" => self.binary(Binary::Or, x, y),
            "&&" => self.binary(Binary::And, x, y),
            "==" => self.binary(Binary::Equal, x, y),
            "!=" => {
                let equal = self.binary(Binary::Equal, x, y)?;
                self.unary(Unary::Not, equal)
            }
            "<=" => self.binary(Binary::LessOrEqual, x, y),
            ">=" => self.binary(Binary::LessOrEqual, y, x),
            "<" => self.binary(Binary::Less, x, y),
            ">" => self.binary(Binary::Less, y, x),
            "+" => self.binary(Binary::Add, x, y),
            "-" => self.binary(Binary::Subtract, x, y),
            "*" => self.binary(Binary::Multiply, x, y),
            "/" => self.binary(Binary::Divide, x, y),
            _ => self.binary(Binary::Power, x, y),
        }
    }

    fn operand(&mut self) -> Operand {
        match self.peek() {
            Some('-') => self.sign(Unary::Negate),
            Some('!') => self.sign(Unary::Not),
            Some('(') => {
                self.at += 1;
                let inner = self.expression(0)?;
                self.expect(")")?;
                Ok(inner)
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() => self.name(),
            _ => Err(self.expected("a number, a volume, a function or '('")),
        }
    }

    fn sign(&mut self, sign: Unary) -> Operand {
        self.at += 1;
        let operand = self.expression(SIGN)?;
        self.unary(sign, operand)
    }

    fn number(&mut self) -> Operand {
        let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let rest = self.rest();
        let mut length = digits(rest);
        if rest[length..].starts_with('.') {
            length += 1 + digits(&rest[length + 1..]);
        }
        let power = rest[length..].strip_prefix(['e', 'E']).map(|p| p.strip_prefix(['+', '-']).unwrap_or(p));
        if let Some(power) = power.filter(|power| digits(power) > 0) {
            length = rest.len() - power.len() + digits(power);
        }
        let number = rest[..length].parse().ok().filter(|number: &f64| number.is_finite());
        let Some(number) = number else {
            return Err(self.error(self.at, format!("'{}' is no number", &rest[..length])));
        };
        self.at += length;
        self.push(Operation::Number(number))
    }

    fn name(&mut self) -> Operand {
        let rest = self.rest();
        let length = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_alphanumeric() || c == '_').len();
        let name = rest[..length].to_string();
        let start = self.at;
        if let Some((_, count)) = FUNCTIONS.iter().find(|(function, _)| *function == name) {
            self.at += length;
            return self.function(&name, start, *count);
        }
        if name == "pi" {
            self.at += length;
            return self.push(Operation::Number(std::f64::consts::PI));
        }
        let volumes = self.volumes;
        match volume(&name) {
            Some(volume) if volume < volumes => {
                self.at += length;
                self.push(Operation::Volume(volume))
            }
            Some(_) => {
                let there = match volumes {
                    1 => "there is one volume, a".to_string(),
                    _ => format!("there are {volumes} volumes, {} to {}", title(0), title(volumes - 1)),
                };
                Err(self.error(start, format!("there is no volume {name}: {there}")))
            }
            None => {
                let known: Vec<_> = FUNCTIONS.iter().map(|(function, _)| *function).collect();
                let known = known.join(", ");
                let problem = format!(
                    "unknown name '{name}': expected a volume (a, b, ... or v0, v1, ...), pi, or one of {known}"
                );
                Err(self.error(start, problem))
            }
        }
    }

    fn function(&mut self, name: &str, start: usize, count: usize) -> Operand {
        self.expect("(")?;
        let mut arguments = [0; 3];
        for i in 0..count {
            if i > 0 && !self.accept(",") {
                return Err(self.expected(&format!("',' and {} more of {name}'s {count} arguments", count - i)));
            }
            arguments[i] = self.expression(0)?;
        }
        if !self.accept(")") {
            let has = if count == 1 { "1 argument".to_string() } else { format!("{count} arguments") };
            return Err(self.expected(&format!("')' as {name} has {has}")));
        }
        let [x, y, z] = arguments;
        match name {
            "abs" => self.unary(Unary::Abs, x),
            "sign" => self.unary(Unary::Sign, x),
            "floor" => self.unary(Unary::Floor, x),
            "ceil" => self.unary(Unary::Ceil, x),
            "round" => self.unary(Unary::Round, x),
            "sqrt" => self.unary(Unary::Sqrt, x),
            "exp" => self.unary(Unary::Exp, x),
            "log" => self.unary(Unary::Log, x),
            "sin" => self.unary(Unary::Sin, x),
            "cos" => self.unary(Unary::Cos, x),
            "valid" => self.unary(Unary::Valid, x),
            "min" => self.binary(Binary::Min, x, y),
            "max" => self.binary(Binary::Max, x, y),
            "pow" => self.binary(Binary::Power, x, y),
            "default" => self.binary(Binary::Default, x, y),
            "step" => self.binary(Binary::LessOrEqual, x, y),
            "clamp" => {
                let raised = self.binary(Binary::Max, x, y)?;
                self.binary(Binary::Min, raised, z)
            }
            "mix" => {
                let difference = self.binary(Binary::Subtract, y, x)?;
                let share = self.binary(Binary::Multiply, difference, z)?;
                self.binary(Binary::Add, x, share)
            }
            "smoothstep" => self.smoothstep(x, y, z),
            _ => Err(self.error(start, format!("unknown function '{name}'"))),
        }
    }

    /// 0 up to `low`, 1 from `high` on, `t * t * (3 - 2 * t)` in between.
    fn smoothstep(&mut self, low: usize, high: usize, x: usize) -> Operand {
        let above = self.binary(Binary::Subtract, x, low)?;
        let width = self.binary(Binary::Subtract, high, low)?;
        let share = self.binary(Binary::Divide, above, width)?;
        let (zero, one) = (self.push(Operation::Number(0.0))?, self.push(Operation::Number(1.0))?);
        let raised = self.binary(Binary::Max, share, zero)?;
        let t = self.binary(Binary::Min, raised, one)?;
        let square = self.binary(Binary::Multiply, t, t)?;
        let (two, three) = (self.push(Operation::Number(2.0))?, self.push(Operation::Number(3.0))?);
        let twice = self.binary(Binary::Multiply, two, t)?;
        let slope = self.binary(Binary::Subtract, three, twice)?;
        self.binary(Binary::Multiply, square, slope)
    }
}

/// The volume of a name: a letter, or v and a number.
fn volume(name: &str) -> Option<usize> {
    let number = || name.strip_prefix('v').filter(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    match name.as_bytes() {
        [letter @ b'a'..=b'z'] => Some((letter - b'a') as usize),
        _ => Some(number()?.parse().unwrap_or(MAX_VOLUMES)),
    }
}

/// The name of a volume.
fn title(volume: usize) -> String {
    if volume < 26 { char::from(b'a' + volume as u8).to_string() } else { format!("v{volume}") }
}
