//! The expression language of `MODEL.toml`: arithmetic over columns, plus the operators with memory
//! (held direction, play, low-pass, delay ...) that physical effects need.
//!
//! The catalogue of effects speaks this language too: an effect *is* a list of expressions, so what
//! the analysis fits is exactly what it writes into the extended model file, and reading that file
//! back reproduces the fit.
//!
//! Grammar (lowest precedence first): `||`, `&&`, comparisons, `+ -`, `* /`, unary `- !`, `^`,
//! then numbers, names, calls and brackets. Truth is 1, falsehood 0. Operators with memory run
//! along each sequence of rows (one run of one unit) and start afresh at the next.

use crate::error::Error;
use crate::frame::Frame;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt;

/// A parsed expression.
#[derive(Debug, Clone, PartialEq)]
pub enum Expr {
    /// A constant.
    Num(f64),
    /// A column, by its name in the frame.
    Var(String),
    /// Minus (`-`) or logical not (`!`).
    Unary(char, Box<Expr>),
    /// A binary operator, by its spelling.
    Binary(&'static str, Box<Expr>, Box<Expr>),
    /// A function call.
    Call(Func, Vec<Expr>),
}

macro_rules! functions {
    ($($variant:ident $name:literal $arity:literal $doc:literal;)*) => {
        /// The functions of the language.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Func {
            $(#[doc = $doc] $variant,)*
        }

        impl Func {
            /// Every function: spelling, number of arguments, meaning.
            pub const ALL: &'static [(Func, &'static str, usize, &'static str)] =
                &[$((Func::$variant, $name, $arity, $doc),)*];
        }
    };
}

functions! {
    Abs "abs" 1 "magnitude";
    Sqrt "sqrt" 1 "square root";
    Exp "exp" 1 "exponential";
    Log "log" 1 "natural logarithm";
    Sin "sin" 1 "sine of radians";
    Cos "cos" 1 "cosine of radians";
    Tan "tan" 1 "tangent of radians";
    Tanh "tanh" 1 "hyperbolic tangent";
    Atan "atan" 1 "arc tangent, radians";
    Sign "sign" 1 "-1, 0 or 1";
    Round "round" 1 "nearest whole number";
    Floor "floor" 1 "largest whole number not above";
    Min "min" 2 "the smaller";
    Max "max" 2 "the larger";
    Clip "clip" 3 "clip(x, lo, hi): x kept between lo and hi";
    If "if" 3 "if(c, a, b): a where c is true, else b";
    Sgn "sgn" 2 "sgn(v, db): sign of v, 0 where |v| <= db";
    Held "held" 2 "held(v, db): the last sign of v beyond db; 0 before the first motion";
    Ahead "ahead" 3 "ahead(v, db, tau): at rest, the next direction of motion times exp(-(time to it)/tau); 0 in motion";
    Deriv "deriv" 2 "deriv(x, n): time derivative, straight line over 2n+1 rows";
    Integ "integ" 1 "time integral from the start of the sequence (trapezoid)";
    Delay "delay" 2 "delay(x, s): x as it was s seconds ago (linear between rows; ends held)";
    Warp "warp" 2 "warp(x, r): x read at time t0 + (t - t0)(1 + r), t0 the start of the sequence";
    Lowpass "lowpass" 2 "lowpass(x, tau): first-order lag, starting in equilibrium";
    Charge "charge" 2 "charge(x, tau): first-order lag, starting at zero";
    Play "play" 2 "play(x, w): backlash operator of total width w";
    Stop "stop" 2 "stop(x, w): elastic-plastic operator, x - play(x, w), between -w/2 and w/2";
    Dahl "dahl" 2 "dahl(x, d): Dahl friction state between -1 and 1 with sliding distance d";
    SeqMean "seqmean" 1 "mean over the sequence";
}

impl Func {
    fn lookup(name: &str) -> Option<(Func, usize)> {
        Func::ALL.iter().find(|f| f.1 == name).map(|f| (f.0, f.2))
    }

    fn name(self) -> &'static str {
        Func::ALL.iter().find(|f| f.0 == self).map_or("?", |f| f.1)
    }
}

const BINARY: &[(&str, u8)] = &[
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

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
}

impl<'a> Parser<'a> {
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
            return match rest[..n].parse::<f64>() {
                Ok(x) => {
                    self.at += n;
                    Ok(Expr::Num(x))
                }
                Err(_) => self.fail(format!("`{}` is not a number", &rest[..n])),
            };
        }
        if first.is_alphabetic() || first == '_' {
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
                    "no function `{name}`; known are {}",
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
            return Ok(Expr::Call(func, args));
        }
        self.fail(format!("`{first}` is not expected here"))
    }
}

/// A value on the way: constants stay scalars so that no row of them is ever stored, and columns
/// stay where they are until something is done to them.
enum Value<'a> {
    One(f64),
    Rows(Cow<'a, [f64]>),
}

impl<'a> Value<'a> {
    fn owned(v: Vec<f64>) -> Value<'a> {
        Value::Rows(Cow::Owned(v))
    }

    fn map(self, f: impl Fn(f64) -> f64) -> Value<'a> {
        match self {
            Value::One(x) => Value::One(f(x)),
            Value::Rows(Cow::Borrowed(v)) => Value::owned(v.iter().map(|x| f(*x)).collect()),
            Value::Rows(Cow::Owned(mut v)) => {
                v.iter_mut().for_each(|x| *x = f(*x));
                Value::owned(v)
            }
        }
    }

    fn zip(self, other: Value<'a>, f: impl Fn(f64, f64) -> f64) -> Value<'a> {
        match (self, other) {
            (a, Value::One(b)) => a.map(|x| f(x, b)),
            (Value::One(a), b) => b.map(|x| f(a, x)),
            (Value::Rows(Cow::Owned(mut a)), Value::Rows(b)) => {
                a.iter_mut().zip(b.iter()).for_each(|(x, y)| *x = f(*x, *y));
                Value::owned(a)
            }
            (Value::Rows(a), Value::Rows(Cow::Owned(mut b))) => {
                b.iter_mut().zip(a.iter()).for_each(|(y, x)| *y = f(*x, *y));
                Value::owned(b)
            }
            (Value::Rows(a), Value::Rows(b)) => {
                Value::owned(a.iter().zip(b.iter()).map(|(x, y)| f(*x, *y)).collect())
            }
        }
    }

    fn rows(self, n: usize) -> Vec<f64> {
        match self {
            Value::One(x) => vec![x; n],
            Value::Rows(v) => v.into_owned(),
        }
    }
}

impl Expr {
    /// Parses `text`.
    ///
    /// # Errors
    /// [`Error::Expression`] with the position of the first thing that is wrong.
    pub fn parse(text: &str) -> Result<Expr, Error> {
        let mut p = Parser {
            text,
            at: 0,
            depth: 0,
        };
        let e = p.binary(0)?;
        if p.rest().is_empty() {
            Ok(e)
        } else {
            p.fail("an operator is expected here")
        }
    }

    /// A column by name.
    pub fn var(name: &str) -> Expr {
        Expr::Var(name.to_string())
    }

    /// `self op other` for one of the language's binary operators.
    pub(crate) fn op(self, op: &'static str, other: Expr) -> Expr {
        Expr::Binary(op, Box::new(self), Box::new(other))
    }

    /// Names of the columns used.
    pub fn names(&self) -> BTreeSet<String> {
        let mut out = BTreeSet::new();
        self.visit(&mut |e| {
            if let Expr::Var(n) = e {
                out.insert(n.clone());
            }
        });
        out
    }

    fn visit(&self, f: &mut impl FnMut(&Expr)) {
        f(self);
        match self {
            Expr::Num(_) | Expr::Var(_) => {}
            Expr::Unary(_, a) => a.visit(f),
            Expr::Binary(_, a, b) => {
                a.visit(f);
                b.visit(f);
            }
            Expr::Call(_, args) => args.iter().for_each(|a| a.visit(f)),
        }
    }

    /// The same expression with every use of a column replaced where `f` gives a replacement.
    pub fn substitute(&self, f: &impl Fn(&str) -> Option<Expr>) -> Expr {
        match self {
            Expr::Num(_) => self.clone(),
            Expr::Var(n) => f(n).unwrap_or_else(|| self.clone()),
            Expr::Unary(op, a) => Expr::Unary(*op, Box::new(a.substitute(f))),
            Expr::Binary(op, a, b) => {
                Expr::Binary(op, Box::new(a.substitute(f)), Box::new(b.substitute(f)))
            }
            Expr::Call(func, args) => {
                Expr::Call(*func, args.iter().map(|a| a.substitute(f)).collect())
            }
        }
    }

    /// Evaluates on every row of the frame.
    ///
    /// # Errors
    /// [`Error::Expression`] for an unknown name, or a parameter (time constant, width ...) that is
    /// not a positive constant.
    pub fn eval(&self, frame: &Frame) -> Result<Vec<f64>, Error> {
        Ok(self.value(frame)?.rows(frame.len()))
    }

    fn constant(&self, frame: &Frame) -> Result<f64, Error> {
        match self.value(frame)? {
            Value::One(x) if x.is_finite() => Ok(x),
            _ => Err(Error::Expression {
                text: self.to_string(),
                why: "a constant is needed here, not a column".into(),
            }),
        }
    }

    fn value<'a>(&self, frame: &'a Frame) -> Result<Value<'a>, Error> {
        let truth = |b: bool| if b { 1.0 } else { 0.0 };
        Ok(match self {
            Expr::Num(x) => Value::One(*x),
            Expr::Var(n) => match frame.column(n) {
                Some(c) => Value::Rows(Cow::Borrowed(c)),
                None => {
                    return Err(Error::Expression {
                        text: n.clone(),
                        why: format!(
                            "no such column or role; known are {}",
                            frame.names().join(", ")
                        ),
                    })
                }
            },
            Expr::Unary('!', a) => a.value(frame)?.map(|x| truth(x == 0.0)),
            Expr::Unary(_, a) => a.value(frame)?.map(|x| -x),
            Expr::Binary(op, a, b) => {
                let (a, b) = (a.value(frame)?, b.value(frame)?);
                match *op {
                    "+" => a.zip(b, |x, y| x + y),
                    "-" => a.zip(b, |x, y| x - y),
                    "*" => a.zip(b, |x, y| x * y),
                    "/" => a.zip(b, |x, y| x / y),
                    "^" => match b {
                        Value::One(2.0) => a.map(|x| x * x),
                        b => a.zip(b, f64::powf),
                    },
                    "==" => a.zip(b, |x, y| truth(x == y)),
                    "!=" => a.zip(b, |x, y| truth(x != y)),
                    "<=" => a.zip(b, |x, y| truth(x <= y)),
                    ">=" => a.zip(b, |x, y| truth(x >= y)),
                    "<" => a.zip(b, |x, y| truth(x < y)),
                    ">" => a.zip(b, |x, y| truth(x > y)),
                    "&&" => a.zip(b, |x, y| truth(x != 0.0 && y != 0.0)),
                    _ => a.zip(b, |x, y| truth(x != 0.0 || y != 0.0)),
                }
            }
            Expr::Call(func, args) => self.call_value(*func, args, frame)?,
        })
    }

    fn call_value<'a>(
        &self,
        func: Func,
        args: &[Expr],
        frame: &'a Frame,
    ) -> Result<Value<'a>, Error> {
        let x = args[0].value(frame)?;
        let positive = |i: usize| -> Result<f64, Error> {
            let p = args[i].constant(frame)?;
            if p > 0.0 {
                Ok(p)
            } else {
                Err(Error::Expression {
                    text: self.to_string(),
                    why: format!("`{}` must be positive", args[i]),
                })
            }
        };
        let sgn = |x: f64, db: f64| {
            if x > db {
                1.0
            } else if x < -db {
                -1.0
            } else {
                0.0
            }
        };
        let n = frame.len();
        Ok(match func {
            Func::Abs => x.map(f64::abs),
            Func::Sqrt => x.map(f64::sqrt),
            Func::Exp => x.map(f64::exp),
            Func::Log => x.map(f64::ln),
            Func::Sin => x.map(f64::sin),
            Func::Cos => x.map(f64::cos),
            Func::Tan => x.map(f64::tan),
            Func::Tanh => x.map(f64::tanh),
            Func::Atan => x.map(f64::atan),
            Func::Sign => x.map(|x| sgn(x, 0.0)),
            Func::Round => x.map(f64::round),
            Func::Floor => x.map(f64::floor),
            Func::Min => x.zip(args[1].value(frame)?, f64::min),
            Func::Max => x.zip(args[1].value(frame)?, f64::max),
            Func::Clip => x
                .zip(args[1].value(frame)?, f64::max)
                .zip(args[2].value(frame)?, f64::min),
            Func::If => {
                let (a, b) = (args[1].value(frame)?.rows(n), args[2].value(frame)?.rows(n));
                let c = x.rows(n);
                Value::owned(
                    c.iter()
                        .zip(a.iter().zip(&b))
                        .map(|(c, (a, b))| if *c != 0.0 { *a } else { *b })
                        .collect(),
                )
            }
            Func::Sgn => {
                let db = args[1].constant(frame)?;
                x.map(|x| sgn(x, db))
            }
            Func::Held => {
                let db = args[1].constant(frame)?;
                frame.scan(x.rows(n), 0.0, move |last, x, _| {
                    let s = sgn(x, db);
                    if s != 0.0 {
                        *last = s;
                    }
                    *last
                })
            }
            Func::Ahead => {
                let db = args[1].constant(frame)?;
                let tau = positive(2)?;
                let mut v = x.rows(n);
                let t = frame.time();
                for range in frame.sequences() {
                    let mut next: Option<(f64, f64)> = None;
                    for i in range.clone().rev() {
                        let s = sgn(v[i], db);
                        v[i] = if s != 0.0 {
                            next = Some((s, t[i]));
                            0.0
                        } else {
                            next.map_or(0.0, |(s, at)| s * (-(at - t[i]) / tau).exp())
                        };
                    }
                }
                Value::owned(v)
            }
            Func::Deriv => Value::owned(derivative(
                &x.rows(n),
                frame,
                positive(1)?.max(1.0) as usize,
            )),
            Func::Integ => {
                let mut v = x.rows(n);
                let t = frame.time();
                for range in frame.sequences() {
                    let (mut sum, mut last) = (0.0, None);
                    for i in range.clone() {
                        let x = v[i];
                        if let Some((px, pt)) = last {
                            sum += 0.5 * (x + px) * (t[i] - pt);
                        }
                        last = Some((x, t[i]));
                        v[i] = sum;
                    }
                }
                Value::owned(v)
            }
            Func::Delay => {
                let s = args[1].constant(frame)?;
                Value::owned(resample(&x.rows(n), frame, |t, _| t - s))
            }
            Func::Warp => {
                let r = args[1].constant(frame)?;
                Value::owned(resample(&x.rows(n), frame, |t, t0| {
                    t0 + (t - t0) * (1.0 + r)
                }))
            }
            Func::Lowpass | Func::Charge => {
                let tau = positive(1)?;
                let mut v = x.rows(n);
                let t = frame.time();
                for range in frame.sequences() {
                    let Some(first) = range.clone().next() else {
                        continue;
                    };
                    let mut y = if func == Func::Lowpass { v[first] } else { 0.0 };
                    let mut px = v[first];
                    for i in range.clone() {
                        let x = v[i];
                        if i > first {
                            // Exact for an input that is a straight line between rows.
                            let dt = (t[i] - t[i - 1]).max(0.0) / tau;
                            let a = (-dt).exp();
                            let slope = if dt > 0.0 { (1.0 - a) / dt } else { 1.0 };
                            y = y * a + px * (slope - a) + x * (1.0 - slope);
                        }
                        px = x;
                        v[i] = y;
                    }
                }
                Value::owned(v)
            }
            Func::Play | Func::Stop => {
                let half = positive(1)? / 2.0;
                let stop = func == Func::Stop;
                frame.scan(x.rows(n), f64::NAN, move |play, x, _| {
                    if play.is_nan() {
                        *play = x;
                    }
                    *play = play.clamp(x - half, x + half);
                    if stop {
                        x - *play
                    } else {
                        *play
                    }
                })
            }
            Func::Dahl => {
                let d = positive(1)?;
                let mut last = 0.0;
                frame.scan(x.rows(n), 0.0, move |z, x, first| {
                    let dx: f64 = if first { 0.0 } else { x - last };
                    last = x;
                    if dx != 0.0 {
                        let s = dx.signum();
                        *z = s + (*z - s) * (-dx.abs() / d).exp();
                    }
                    *z
                })
            }
            Func::SeqMean => {
                let mut v = x.rows(n);
                for range in frame.sequences() {
                    let m = v[range.clone()].iter().sum::<f64>() / range.len().max(1) as f64;
                    v[range.clone()].iter_mut().for_each(|x| *x = m);
                }
                Value::owned(v)
            }
        })
    }
}

impl Frame {
    /// Runs `step(state, x, is_first)` along each sequence.
    fn scan(
        &self,
        mut v: Vec<f64>,
        start: f64,
        mut step: impl FnMut(&mut f64, f64, bool) -> f64,
    ) -> Value<'_> {
        for range in self.sequences() {
            let mut state = start;
            let mut first = true;
            for x in &mut v[range.clone()] {
                *x = step(&mut state, *x, first);
                first = false;
            }
        }
        Value::owned(v)
    }
}

/// Slope of the least-squares line over `2 half + 1` rows (fewer at the ends of a sequence).
fn derivative(x: &[f64], frame: &Frame, half: usize) -> Vec<f64> {
    let t = frame.time();
    let mut out = vec![0.0; x.len()];
    for range in frame.sequences() {
        for i in range.clone() {
            let lo = i.saturating_sub(half).max(range.start);
            let hi = (i + half + 1).min(range.end);
            let k = (hi - lo) as f64;
            let (mut st, mut sx, mut stt, mut stx) = (0.0, 0.0, 0.0, 0.0);
            for j in lo..hi {
                let dt = t[j] - t[i];
                st += dt;
                sx += x[j];
                stt += dt * dt;
                stx += dt * x[j];
            }
            let den = stt - st * st / k;
            out[i] = if den > 0.0 {
                (stx - st * sx / k) / den
            } else {
                0.0
            };
        }
    }
    out
}

/// `x` read at another time, linear between rows, ends held.
fn resample(x: &[f64], frame: &Frame, at: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let t = frame.time();
    let mut out = vec![0.0; x.len()];
    for range in frame.sequences() {
        let Some(first) = range.clone().next() else {
            continue;
        };
        let mut j = first;
        for i in range.clone() {
            let want = at(t[i], t[first]);
            while j + 1 < range.end && t[j + 1] <= want {
                j += 1;
            }
            while j > first && t[j] > want {
                j -= 1;
            }
            out[i] = if want <= t[j] || j + 1 >= range.end {
                x[j]
            } else {
                let span = t[j + 1] - t[j];
                if span > 0.0 {
                    x[j] + (x[j + 1] - x[j]) * (want - t[j]) / span
                } else {
                    x[j]
                }
            };
        }
    }
    out
}

impl fmt::Display for Expr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fn level(e: &Expr) -> u8 {
            match e {
                Expr::Binary(op, ..) => BINARY.iter().find(|b| b.0 == *op).map_or(0, |b| b.1),
                Expr::Unary(..) => 6,
                Expr::Num(x) if *x < 0.0 => 6,
                _ => 9,
            }
        }
        let wrapped = |f: &mut fmt::Formatter<'_>, e: &Expr, floor: u8| {
            if level(e) < floor {
                write!(f, "({e})")
            } else {
                write!(f, "{e}")
            }
        };
        match self {
            Expr::Num(x) => {
                if *x != 0.0 && (x.abs() < 1e-4 || x.abs() >= 1e9) {
                    write!(f, "{x:e}")
                } else {
                    write!(f, "{x}")
                }
            }
            Expr::Var(n) => f.write_str(n),
            Expr::Unary(op, a) => {
                write!(f, "{op}")?;
                wrapped(f, a, 7)
            }
            Expr::Binary(op, a, b) => {
                let l = level(self);
                wrapped(f, a, if *op == "^" { l + 1 } else { l })?;
                if *op == "^" {
                    f.write_str("^")?;
                } else {
                    write!(f, " {op} ")?;
                }
                wrapped(f, b, if *op == "^" { l } else { l + 1 })
            }
            Expr::Call(func, args) => {
                write!(f, "{}(", func.name())?;
                for (i, a) in args.iter().enumerate() {
                    if i > 0 {
                        f.write_str(", ")?;
                    }
                    write!(f, "{a}")?;
                }
                f.write_str(")")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> Frame {
        Frame::new(
            vec![
                ("x".into(), vec![0.0, 1.0, 2.0, 1.0, 0.0, 5.0, 5.0]),
                ("v".into(), vec![0.0, 2.0, 0.0, -2.0, 0.0, 0.0, 1.0]),
            ],
            vec![0.0, 1.0, 2.0, 3.0, 4.0, 0.0, 1.0],
            vec![0..5, 5..7],
        )
    }

    fn eval(text: &str) -> Vec<f64> {
        Expr::parse(text).unwrap().eval(&frame()).unwrap()
    }

    #[test]
    fn arithmetic_follows_the_usual_precedence() {
        assert_eq!(eval("1 + 2 * 3 ^ 2 - -4")[0], 23.0);
        assert_eq!(eval("2 ^ 3 ^ 2")[0], 512.0);
        assert_eq!(eval("-2 ^ 2")[0], -4.0);
        assert_eq!(eval("8 / 4 / 2")[0], 1.0);
        assert_eq!(
            eval("x > 1 && !(v == 0) || x == 5"),
            [0., 0., 0., 0., 0., 1., 1.]
        );
    }

    #[test]
    fn text_of_an_expression_parses_back_to_it() {
        for text in [
            "1 - (2 - 3)",
            "(x + 1) * v",
            "-(x + v)^2",
            "2^-1",
            "held(v, 0.5) * (x - 1e-7)",
            "x / (v + 3 / 2)",
            "x - (v - 2)",
            "!(x > 1)",
            "(2^3)^2",
        ] {
            let e = Expr::parse(text).unwrap();
            assert_eq!(
                Expr::parse(&e.to_string()).unwrap().eval(&frame()).unwrap(),
                e.eval(&frame()).unwrap(),
                "{text} -> {e}"
            );
        }
    }

    #[test]
    fn memory_starts_afresh_in_each_sequence() {
        assert_eq!(eval("held(v, 0)"), [0., 1., 1., -1., -1., 0., 1.]);
        assert_eq!(eval("play(x, 2)"), [0., 0., 1., 1., 1., 5., 5.]);
        assert_eq!(eval("stop(x, 2) + play(x, 2) - x"), [0.; 7]);
        assert_eq!(eval("delay(x, 0.5)"), [0., 0.5, 1.5, 1.5, 0.5, 5., 5.]);
        assert_eq!(eval("integ(x)"), [0., 0.5, 2.0, 3.5, 4.0, 0., 5.]);
        assert_eq!(eval("deriv(x, 1)"), [1., 1., 0., -1., -1., 0., 0.]);
        let ahead = eval("ahead(v, 0, 1)");
        assert!(
            (ahead[0] - (-1f64).exp()).abs() < 1e-12
                && (ahead[2] + (-1f64).exp()).abs() < 1e-12
                && ahead[4] == 0.0
        );
    }

    #[test]
    fn low_pass_is_exact_for_a_ramp() {
        let n = 200;
        let t: Vec<f64> = (0..n).map(|i| i as f64 * 0.1).collect();
        let whole = std::iter::once(0..n).collect();
        let f = Frame::new(vec![("r".into(), t.clone())], t.clone(), whole);
        let y = Expr::parse("lowpass(r, 0.7)").unwrap().eval(&f).unwrap();
        for i in 0..n {
            let want = t[i] - 0.7 * (1.0 - (-t[i] / 0.7).exp());
            assert!((y[i] - want).abs() < 1e-9, "{i}");
        }
    }

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            ("1 +", "missing"),
            ("foo(1)", "no function"),
            ("sin(1, 2)", "takes 1"),
            ("(1", "`)`"),
            ("1 2", "operator"),
            ("#", "not expected"),
        ] {
            let err = Expr::parse(text).unwrap_err().to_string();
            assert!(err.contains(part), "{text}: {err}");
        }
        assert!(Expr::parse("nosuch")
            .unwrap()
            .eval(&frame())
            .unwrap_err()
            .to_string()
            .contains("known are"));
        assert!(Expr::parse("lowpass(x, 0)")
            .unwrap()
            .eval(&frame())
            .is_err());
        assert!(Expr::parse(&"(".repeat(100_000)).is_err());
    }
}
