//! Parser of expressions: precedence climbing (Pratt, 1973), with an operation appended as soon as its operands are read.
//!
//! From loosest to tightest: `?:`, `||`, `&&`, `== !=`, `< <= > >=`, `+ -`, `* /`, the signs `- !`, and `^`, which groups from the
//! right, as does `?:`.

use super::{Binary, ExpressionError, MAX_OPERATIONS, MAX_VOLUMES, Operation, Unary};

/// Greatest nesting depth of parentheses and the like.
const MAX_DEPTH: usize = 64;

/// Greatest length in characters.
const MAX_LENGTH: usize = 4096;

/// The operations of a function's arguments.
#[derive(Clone, Copy)]
enum Function {
    Of1(Unary),
    Of2(Binary),
    Of3(fn(&mut Parser<'_>, [usize; 3]) -> Operand),
}

const FUNCTIONS: [(&str, Function); 19] = [
    ("abs", Function::Of1(Unary::Abs)),
    ("sign", Function::Of1(Unary::Sign)),
    ("floor", Function::Of1(Unary::Floor)),
    ("ceil", Function::Of1(Unary::Ceil)),
    ("round", Function::Of1(Unary::Round)),
    ("sqrt", Function::Of1(Unary::Sqrt)),
    ("exp", Function::Of1(Unary::Exp)),
    ("log", Function::Of1(Unary::Log)),
    ("sin", Function::Of1(Unary::Sin)),
    ("cos", Function::Of1(Unary::Cos)),
    ("valid", Function::Of1(Unary::Valid)),
    ("min", Function::Of2(Binary::Min)),
    ("max", Function::Of2(Binary::Max)),
    ("pow", Function::Of2(Binary::Power)),
    ("default", Function::Of2(Binary::Default)),
    ("step", Function::Of2(Binary::LessOrEqual)),
    ("clamp", Function::Of3(|parser, of| parser.clamp(of))),
    ("mix", Function::Of3(|parser, of| parser.mix(of))),
    ("smoothstep", Function::Of3(|parser, of| parser.smoothstep(of))),
];

/// Binary operators, their tightness and operation; `!=` is the opposite of its own, `>` and `>=` are with exchanged operands.
const OPERATORS: [(&str, u8, Binary); 13] = [
    ("||", 2, Binary::Or),
    ("&&", 3, Binary::And),
    ("==", 4, Binary::Equal),
    ("!=", 4, Binary::Equal),
    ("<=", 5, Binary::LessOrEqual),
    (">=", 5, Binary::LessOrEqual),
    ("<", 5, Binary::Less),
    (">", 5, Binary::Less),
    ("+", 6, Binary::Add),
    ("-", 6, Binary::Subtract),
    ("*", 7, Binary::Multiply),
    ("/", 7, Binary::Divide),
    ("^", POWER, Binary::Power),
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
            let is_next = |(token, tightness, _): &&(&str, u8, Binary)| rest.starts_with(token) && *tightness > loosest;
            if let Some(&(token, tightness, binary)) = OPERATORS.iter().find(is_next) {
                self.at += token.len();
                let right = self.expression(if tightness == POWER { SIGN - 1 } else { tightness })?;
                let (x, y) = if token.starts_with('>') { (right, left) } else { (left, right) };
                left = self.binary(binary, x, y)?;
                if token == "!=" {
                    left = self.unary(Unary::Not, left)?;
                }
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
        let number = number.ok_or_else(|| self.error(self.at, format!("'{}' is no number", &rest[..length])))?;
        self.at += length;
        self.push(Operation::Number(number))
    }

    fn name(&mut self) -> Operand {
        let rest = self.rest();
        let length = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_alphanumeric() || c == '_').len();
        let name = rest[..length].to_string();
        if let Some(&(name, function)) = FUNCTIONS.iter().find(|(function, _)| *function == name) {
            self.at += length;
            return self.function(name, function);
        }
        if name == "pi" {
            self.at += length;
            return self.push(Operation::Number(std::f64::consts::PI));
        }
        let volumes = self.volumes;
        let problem = match volume(&name) {
            Some(volume) if volume < volumes => {
                self.at += length;
                return self.push(Operation::Volume(volume));
            }
            Some(_) if volumes == 1 => format!("there is no volume {name}: there is one volume, a"),
            Some(_) => {
                let last = title(volumes - 1);
                format!("there is no volume {name}: there are {volumes} volumes, {} to {last}", title(0))
            }
            None => {
                let known = FUNCTIONS.map(|(function, _)| function).join(", ");
                format!("unknown name '{name}': expected a volume (a, b, ... or v0, v1, ...), pi, or one of {known}")
            }
        };
        Err(self.error(self.at, problem))
    }

    fn function(&mut self, name: &str, function: Function) -> Operand {
        let count = match function {
            Function::Of1(_) => 1,
            Function::Of2(_) => 2,
            Function::Of3(_) => 3,
        };
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
        match function {
            Function::Of1(unary) => self.unary(unary, arguments[0]),
            Function::Of2(binary) => self.binary(binary, arguments[0], arguments[1]),
            Function::Of3(operations) => operations(self, arguments),
        }
    }

    fn clamp(&mut self, [x, low, high]: [usize; 3]) -> Operand {
        let raised = self.binary(Binary::Max, x, low)?;
        self.binary(Binary::Min, raised, high)
    }

    fn mix(&mut self, [from, to, share]: [usize; 3]) -> Operand {
        let difference = self.binary(Binary::Subtract, to, from)?;
        let added = self.binary(Binary::Multiply, difference, share)?;
        self.binary(Binary::Add, from, added)
    }

    /// 0 up to `low`, 1 from `high` on, `t * t * (3 - 2 * t)` in between.
    fn smoothstep(&mut self, [low, high, x]: [usize; 3]) -> Operand {
        let above = self.binary(Binary::Subtract, x, low)?;
        let width = self.binary(Binary::Subtract, high, low)?;
        let share = self.binary(Binary::Divide, above, width)?;
        let (zero, one) = (self.push(Operation::Number(0.0))?, self.push(Operation::Number(1.0))?);
        let t = self.clamp([share, zero, one])?;
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
