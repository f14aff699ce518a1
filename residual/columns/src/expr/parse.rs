//! The parser: text to expression.

use super::{Expr, Func};
use crate::error::Error;

/// Binary operators with their precedence; a longer spelling comes before its beginning.
pub(super) const BINARY: &[(&str, u8)] = &[
    ("||", 1),
    ("&&", 2),
    ("==", 3),
    ("!=", 3),
    ("<=", 3),
    (">=", 3),
    ("<", 3),
    (">", 3),
    ("+", 4),
    ("-", 4),
    ("*", 5),
    ("/", 5),
    ("^", 7),
];

/// How a column is named whose name is none here.
const NAMES: &str = "a column whose name has blanks, brackets or other signs gets a name of its own under [roles.channels]";

pub(super) struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl<'a> Parser<'a> {
    pub(super) fn new(text: &'a str) -> Parser<'a> {
        Parser {
            text,
            at: 0,
            depth: 0,
        }
    }

    /// The whole text as one expression.
    pub(super) fn whole(mut self) -> Result<Expr, Error> {
        let e = self.binary(0)?;
        if self.rest().is_empty() {
            Ok(e)
        } else {
            self.fail(format!("an operator is expected here; {NAMES}"))
        }
    }

    fn fail<T>(&self, why: impl Into<String>) -> Result<T, Error> {
        Err(Error::Expression {
            text: self.text.to_string(),
            why: format!("{} (at character {})", why.into(), self.at + 1),
        })
    }

    fn rest(&mut self) -> &'a str {
        let r = &self.text[self.at..];
        let t = r.trim_start();
        self.at += r.len() - t.len();
        t
    }

    fn binary(&mut self, floor: u8) -> Result<Expr, Error> {
        self.depth += 1;
        if self.depth > 200 {
            return self.fail("nested too deeply");
        }
        let mut left = self.unary()?;
        loop {
            let rest = self.rest();
            let Some(&(op, level)) = BINARY.iter().find(|(op, _)| rest.starts_with(op)) else {
                break;
            };
            if level < floor {
                break;
            }
            self.at += op.len();
            // `^` binds to the right, everything else to the left.
            let right = self.binary(if op == "^" { level } else { level + 1 })?;
            left = Expr::Binary(op, Box::new(left), Box::new(right));
        }
        self.depth -= 1;
        Ok(left)
    }

    fn unary(&mut self) -> Result<Expr, Error> {
        let rest = self.rest();
        for op in ['-', '!'] {
            if rest.starts_with(op) {
                self.at += 1;
                return Ok(Expr::Unary(op, Box::new(self.binary(6)?)));
            }
        }
        self.atom()
    }

    fn atom(&mut self) -> Result<Expr, Error> {
        let rest = self.rest();
        let Some(first) = rest.chars().next() else {
            return self.fail("something is missing at the end");
        };
        if first == '(' {
            self.at += 1;
            let inner = self.binary(0)?;
            return if self.rest().starts_with(')') {
                self.at += 1;
                Ok(inner)
            } else {
                self.fail("`)` expected")
            };
        }
        if first.is_ascii_digit() || first == '.' {
            return self.number(rest);
        }
        if first.is_alphabetic() || first == '_' {
            return self.name_or_call(rest);
        }
        self.fail(format!("`{first}` is not expected here; {NAMES}"))
    }

    fn number(&mut self, rest: &str) -> Result<Expr, Error> {
        let bytes = rest.as_bytes();
        let mut n = 0;
        while n < bytes.len()
            && (bytes[n].is_ascii_digit()
                || bytes[n] == b'.'
                || (matches!(bytes[n], b'e' | b'E') && n > 0)
                || (matches!(bytes[n], b'+' | b'-') && matches!(bytes[n - 1], b'e' | b'E')))
        {
            n += 1;
        }
        match rest[..n].parse::<f64>() {
            Ok(x) => {
                self.at += n;
                Ok(Expr::Num(x))
            }
            Err(_) => self.fail(format!("`{}` is not a number", &rest[..n])),
        }
    }

    fn name_or_call(&mut self, rest: &str) -> Result<Expr, Error> {
        let n = rest
            .find(|c: char| !(c.is_alphanumeric() || c == '_' || c == '.'))
            .unwrap_or(rest.len());
        let name = &rest[..n];
        self.at += n;
        if !self.rest().starts_with('(') {
            return Ok(if name == "pi" {
                Expr::Num(std::f64::consts::PI)
            } else {
                Expr::Var(name.to_string())
            });
        }
        let Some((func, arity)) = Func::lookup(name) else {
            return self.fail(format!(
                "no function `{name}`; known are {}; {NAMES}",
                Func::ALL.iter().map(|f| f.1).collect::<Vec<_>>().join(", ")
            ));
        };
        self.at += 1;
        let mut args = Vec::new();
        loop {
            args.push(self.binary(0)?);
            let rest = self.rest();
            if rest.starts_with(',') {
                self.at += 1;
            } else if rest.starts_with(')') {
                self.at += 1;
                break;
            } else {
                return self.fail("`,` or `)` expected");
            }
        }
        if args.len() != arity {
            return self.fail(format!(
                "`{name}` takes {arity} argument(s), {} given",
                args.len()
            ));
        }
        Ok(Expr::Call(func, args))
    }
}
