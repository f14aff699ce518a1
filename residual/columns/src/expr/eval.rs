//! Evaluation on every row of a frame.

use super::{memory, trigonometry, Expr, Func};
use crate::error::Error;
use crate::frame::Frame;
use crate::parallel;
use std::borrow::Cow;

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

    fn map(self, f: impl Fn(f64) -> f64 + Send + Sync) -> Value<'a> {
        match self {
            Value::One(x) => Value::One(f(x)),
            Value::Rows(Cow::Borrowed(v)) => Value::owned(parallel::map(v, f)),
            Value::Rows(Cow::Owned(mut v)) => {
                parallel::change(&mut v, f);
                Value::owned(v)
            }
        }
    }

    /// The same function for one number, and for many at once in place.
    fn all(self, one: impl Fn(f64) -> f64, many: impl Fn(&mut [f64])) -> Value<'a> {
        match self {
            Value::One(x) => Value::One(one(x)),
            Value::Rows(v) => {
                let mut v = v.into_owned();
                many(&mut v);
                Value::owned(v)
            }
        }
    }

    fn zip(self, other: Value<'a>, f: impl Fn(f64, f64) -> f64 + Send + Sync) -> Value<'a> {
        match (self, other) {
            (a, Value::One(b)) => a.map(|x| f(x, b)),
            (Value::One(a), b) => b.map(|x| f(a, x)),
            (Value::Rows(Cow::Owned(mut a)), Value::Rows(b)) => {
                parallel::combine(&mut a, &b, |x, y| *x = f(*x, y));
                Value::owned(a)
            }
            (Value::Rows(a), Value::Rows(Cow::Owned(mut b))) => {
                parallel::combine(&mut b, &a, |y, x| *y = f(x, *y));
                Value::owned(b)
            }
            (Value::Rows(a), Value::Rows(b)) => Value::owned(parallel::zip(&a, &b, f)),
        }
    }

    fn column(self, n: usize) -> Cow<'a, [f64]> {
        match self {
            Value::One(x) => Cow::Owned(vec![x; n]),
            Value::Rows(v) => v,
        }
    }

    fn rows(self, n: usize) -> Vec<f64> {
        self.column(n).into_owned()
    }
}

impl Expr {
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
                            "not a column or role; known are {}",
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
            Expr::Call(func, args) => match frame.derived(&|| self.to_string()) {
                Some(known) => Value::Rows(Cow::Borrowed(known)),
                None => self.call_value(*func, args, frame)?,
            },
        })
    }

    /// An argument that must be a positive constant.
    fn positive(&self, argument: &Expr, frame: &Frame) -> Result<f64, Error> {
        let p = argument.constant(frame)?;
        if p > 0.0 {
            Ok(p)
        } else {
            Err(Error::Expression {
                text: self.to_string(),
                why: format!("`{argument}` must be positive"),
            })
        }
    }

    /// A call: functions of one row here, operators with memory in [`Expr::remembered`].
    fn call_value<'a>(
        &self,
        func: Func,
        args: &[Expr],
        frame: &'a Frame,
    ) -> Result<Value<'a>, Error> {
        let x = args[0].value(frame)?;
        Ok(match func {
            Func::Abs => x.map(f64::abs),
            Func::Sqrt => x.map(f64::sqrt),
            Func::Exp => x.map(f64::exp),
            Func::Log => x.map(f64::ln),
            Func::Sin => x.all(f64::sin, trigonometry::sines),
            Func::Cos => x.all(f64::cos, trigonometry::cosines),
            Func::Tan => x.map(f64::tan),
            Func::Tanh => x.map(f64::tanh),
            Func::Atan => x.map(f64::atan),
            Func::Sign => x.map(|x| memory::sgn(x, 0.0)),
            Func::Round => x.map(f64::round),
            Func::Floor => x.map(f64::floor),
            Func::Min => x.zip(args[1].value(frame)?, f64::min),
            Func::Max => x.zip(args[1].value(frame)?, f64::max),
            Func::Clip => x
                .zip(args[1].value(frame)?, f64::max)
                .zip(args[2].value(frame)?, f64::min),
            Func::If => {
                let n = frame.len();
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
                let band = args[1].constant(frame)?;
                x.map(|x| memory::sgn(x, band))
            }
            _ => Value::owned(self.remembered(func, args, x.column(frame.len()), frame)?),
        })
    }

    /// An operator with memory on the values `x` of its first argument.
    fn remembered(
        &self,
        func: Func,
        args: &[Expr],
        x: Cow<[f64]>,
        frame: &Frame,
    ) -> Result<Vec<f64>, Error> {
        let constant = |i: usize| args[i].constant(frame);
        let positive = |i: usize| self.positive(&args[i], frame);
        Ok(match func {
            Func::Held => memory::held(frame, x.into_owned(), constant(1)?),
            Func::Ahead => memory::ahead(frame, x.into_owned(), constant(1)?, positive(2)?),
            Func::Deriv => memory::derivative(&x, frame, positive(1)?.max(1.0) as usize),
            Func::Integ => memory::integral(frame, x.into_owned()),
            Func::Delay => {
                let s = constant(1)?;
                memory::resample(&x, frame, |t, _| t - s)
            }
            Func::DelayHeld => memory::delay_held(frame, &x, constant(1)?),
            Func::Warp => {
                let r = constant(1)?;
                memory::resample(&x, frame, |t, t0| t0 + (t - t0) * (1.0 + r))
            }
            Func::Lowpass => memory::lag(frame, x.into_owned(), positive(1)?, true),
            Func::LowpassHeld => memory::lag_held(frame, x.into_owned(), positive(1)?),
            Func::Charge => memory::lag(frame, x.into_owned(), positive(1)?, false),
            Func::Play => memory::play(frame, x.into_owned(), positive(1)? / 2.0),
            Func::Stop => memory::stop(frame, x.into_owned(), positive(1)? / 2.0),
            Func::Slew => memory::slew(frame, x.into_owned(), positive(1)?),
            Func::Dahl => memory::dahl(frame, x.into_owned(), positive(1)?),
            Func::SeqMean => memory::sequence_mean(frame, x.into_owned()),
            // Functions of one row are evaluated without their rows.
            _ => x.into_owned(),
        })
    }
}
