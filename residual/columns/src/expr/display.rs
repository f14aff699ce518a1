//! Text of an expression; it parses back to the same expression.

use super::parse::BINARY;
use super::Expr;
use std::fmt;

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
