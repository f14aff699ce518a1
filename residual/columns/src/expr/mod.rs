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

mod display;
mod eval;
mod function;
mod memory;
mod parse;
mod trigonometry;

pub use function::Func;

use crate::error::Error;
use parse::Parser;
use std::collections::BTreeSet;

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

/// Most operators of an expression: each is evaluated inside the one before, and the stack of a
/// thread is finite.
const MOST_OPERATORS: usize = 2000;

impl Expr {
    /// Parses `text`.
    ///
    /// # Errors
    /// [`Error::Expression`] with the position of the first thing that is wrong.
    pub fn parse(text: &str) -> Result<Expr, Error> {
        let operators = text.chars().filter(|c| "+-*/^<>=&|".contains(*c)).count();
        if operators > MOST_OPERATORS {
            return Err(Error::Expression {
                text: text.chars().take(60).chain("...".chars()).collect(),
                why: format!(
                    "has {operators} operators, and at most {MOST_OPERATORS} can be evaluated; add a column with its value to the log"
                ),
            });
        }
        Parser::new(text).whole()
    }

    /// A column by name.
    pub fn var(name: &str) -> Expr {
        Expr::Var(name.to_string())
    }

    /// `self op other` for one of the language's binary operators.
    pub fn op(self, op: &'static str, other: Expr) -> Expr {
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

    /// Calls `f` with this expression and every one inside it.
    pub fn visit(&self, f: &mut impl FnMut(&Expr)) {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;

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
        assert_eq!(eval("slew(x, 0.4)"), [0., 0.4, 0.8, 1., 0.6, 5., 5.]);
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

    /// What is smooth is late by the delay or the lag; a step is held until its row.
    #[test]
    fn steps_are_held_between_rows() {
        let n = 200;
        let t: Vec<f64> = (0..n).map(|i| f64::from(i) * 0.1).collect();
        let steps: Vec<f64> = (0..n).map(|i| f64::from(i % 2)).collect();
        let columns = vec![("r".into(), t.clone()), ("x".into(), steps)];
        let f = Frame::new(columns, t, std::iter::once(0..n as usize).collect());
        let at = |text: &str, i: usize| Expr::parse(text).unwrap().eval(&f).unwrap()[i];
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        for held in ["delay_held(r, 0.25)", "lowpass_held(r, 0.3)"] {
            let plain = held.replace("_held", "");
            near(at(held, 150), at(&plain, 150));
        }
        // Whole rows are whole rows.
        for i in 150..154 {
            near(at("delay_held(x, 0.2)", i), at("x", i - 2));
            near(at("delay_held(x, 0)", i), at("x", i));
            near(at("delay_held(x, -0.1)", i), at("x", i + 1));
        }
        // Half a row late the straight line is halfway; what is held has not changed so far.
        near(at("delay(x, 0.05)", 151), 0.5);
        assert!(at("delay_held(x, 0.05)", 151) > 0.6);
        assert!(at("lowpass_held(x, 0.05)", 151) > at("lowpass(x, 0.05)", 151) + 0.1);
        // Other rows of a delay lie between the rows in which a step is held.
        near(
            at("delay_held(x, 0.15)", 151),
            at("delay_held(x, 0.05)", 150),
        );
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
