//! Units in expressions: an angle in a sine, sums of unlike units, a coefficient of 1.
//!
//! Only what is certain is refused. Whoever multiplies by a number that is no plain factor
//! converts, and what it converts to is not known.

use super::{Column, Roles, Term};
use residual_columns::error::Error;
use residual_columns::expr::{Expr, Func};
use residual_columns::units::{radians, Unit, ANGLE, UNLIKE};

/// Largest number, or divisor, that is taken for a factor and not for a conversion.
const PLAIN: f64 = 9.0;

/// What is known about a value.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Value {
    /// A number without unit.
    Number(f64),
    Known(Unit),
    Unknown,
}

/// A mistake: two values of one dimension and unlike scale, or an angle in a sine.
enum Mistake<'a> {
    Unlike(&'a Expr, Unit, &'a Expr, Unit),
    Sine(&'a Expr, Unit),
}

struct Reader<'a, 'b> {
    columns: &'b [(String, &'b Column)],
    mistake: Option<Mistake<'a>>,
}

impl<'a> Reader<'a, '_> {
    fn value(&mut self, e: &'a Expr) -> Value {
        match e {
            Expr::Num(x) => Value::Number(*x),
            Expr::Var(name) => self.column(name),
            Expr::Unary('-', a) => match self.value(a) {
                Value::Number(x) => Value::Number(-x),
                other => other,
            },
            Expr::Unary(_, a) => {
                self.value(a);
                Value::Unknown
            }
            Expr::Binary(op, a, b) => self.binary(op, a, b),
            Expr::Call(function, arguments) => self.call(*function, arguments),
        }
    }

    fn column(&self, name: &str) -> Value {
        let second = Unit {
            powers: [0, 0, 1, 0],
            scale: 1.0,
        };
        let known = match name {
            "time" | "elapsed" => Some(second),
            _ => (self.columns.iter().find(|(n, _)| n == name))
                .and_then(|(_, column)| Unit::parse(&column.unit)),
        };
        known.map_or(Value::Unknown, Value::Known)
    }

    fn binary(&mut self, op: &str, a: &'a Expr, b: &'a Expr) -> Value {
        let (x, y) = (self.value(a), self.value(b));
        match (op, x, y) {
            ("+" | "-", ..) => self.alike(a, x, b, y),
            ("<" | ">" | "<=" | ">=" | "==" | "!=", ..) => {
                self.alike(a, x, b, y);
                Value::Unknown
            }
            ("*", Value::Known(x), Value::Known(y)) => Value::Known(x.times(y, 1)),
            ("/", Value::Known(x), Value::Known(y)) => Value::Known(x.times(y, -1)),
            ("*" | "/", Value::Known(x), Value::Number(k))
            | ("*", Value::Number(k), Value::Known(x))
                if is_plain(k) =>
            {
                Value::Known(x)
            }
            ("/", Value::Number(k), Value::Known(x)) if is_plain(k) => {
                Value::Known(Unit::ONE.times(x, -1))
            }
            ("*", Value::Number(x), Value::Number(y)) => Value::Number(x * y),
            ("/", Value::Number(x), Value::Number(y)) => Value::Number(x / y),
            ("^", Value::Known(x), Value::Number(n)) if n.fract() == 0.0 && n.abs() < 9.0 => {
                Value::Known(Unit::ONE.times(x, n as i32))
            }
            _ => Value::Unknown,
        }
    }

    /// Of values that are added or compared: their unit.
    fn alike(&mut self, a: &'a Expr, x: Value, b: &'a Expr, y: Value) -> Value {
        match (x, y) {
            (Value::Known(u), Value::Known(v)) => {
                if u.is_unlike(v) {
                    self.mistake.get_or_insert(Mistake::Unlike(a, u, b, v));
                }
                if u.powers == v.powers {
                    x
                } else {
                    Value::Unknown
                }
            }
            (Value::Known(_), Value::Number(_)) => x,
            (Value::Number(_), Value::Known(_)) => y,
            (Value::Number(p), Value::Number(q)) => Value::Number(p + q),
            _ => Value::Unknown,
        }
    }

    fn call(&mut self, function: Func, arguments: &'a [Expr]) -> Value {
        let values: Vec<Value> = arguments.iter().map(|a| self.value(a)).collect();
        let first = values.first().copied().unwrap_or(Value::Unknown);
        let second = Unit {
            powers: [0, 0, 1, 0],
            scale: 1.0,
        };
        match (function, first) {
            (Func::Sin | Func::Cos | Func::Tan, Value::Known(unit)) => {
                if unit.powers == ANGLE && (unit.scale - 1.0).abs() > UNLIKE {
                    self.mistake
                        .get_or_insert(Mistake::Sine(&arguments[0], unit));
                }
                Value::Unknown
            }
            (Func::Atan, _) => Value::Known(Unit {
                powers: ANGLE,
                scale: 1.0,
            }),
            (Func::Min | Func::Max, _) => {
                self.alike(&arguments[0], values[0], &arguments[1], values[1])
            }
            (Func::If, _) => self.alike(&arguments[1], values[1], &arguments[2], values[2]),
            (Func::Deriv, Value::Known(unit)) => Value::Known(unit.times(second, -1)),
            (Func::Integ, Value::Known(unit)) => Value::Known(unit.times(second, 1)),
            (
                Func::Abs
                | Func::Clip
                | Func::Delay
                | Func::DelayHeld
                | Func::Warp
                | Func::Lowpass
                | Func::LowpassHeld
                | Func::Charge
                | Func::Play
                | Func::Stop
                | Func::SeqMean,
                _,
            ) => first,
            _ => Value::Unknown,
        }
    }
}

/// Whether a number is a factor, as of a gear or of a sum, and no conversion.
fn is_plain(k: f64) -> bool {
    let whole = |x: f64| x.abs() <= PLAIN && x != 0.0 && (2.0 * x).fract() == 0.0;
    whole(k) || (1.0 / k).fract() == 0.0 && whole(1.0 / k)
}

/// Refuses an expression that takes units for others.
pub(crate) fn check(roles: &Roles, place: &str, text: &str) -> Result<(), Error> {
    if text.is_empty() {
        return Ok(());
    }
    let columns = roles.all();
    let e = Expr::parse(text)?;
    check_sines(&columns, place, text, &e)?;
    let mut reader = Reader {
        columns: &columns,
        mistake: None,
    };
    reader.value(&e);
    match reader.mistake {
        None => Ok(()),
        Some(Mistake::Sine(argument, unit)) => {
            let angle = columns.iter().find(|(name, column)| {
                argument.names().contains(name)
                    && radians(&column.unit).is_some_and(|r| (r - unit.scale).abs() < UNLIKE * r)
            });
            Err(match angle {
                Some((role, column)) => in_degrees(place, role, column, unit.scale),
                None => Error::model(format!(
                    "{place}: sin, cos and tan take radians, and `{argument}` is {:?} rad in one of its unit. \
                     Convert it: `({argument}) * {:?}`",
                    unit.scale, unit.scale
                )),
            })
        }
        Some(Mistake::Unlike(a, u, b, v)) => Err(unlike(&columns, place, (a, u), (b, v))),
    }
}

/// Refuses a coefficient of 1 of a column that has the target's dimension in another unit.
pub(crate) fn check_fixed(roles: &Roles, term: &Term) -> Result<(), Error> {
    let target = &roles.target;
    let own = term.unit.is_empty() || term.unit.trim() == target.unit.trim();
    if term.fixed.is_none_or(|f| f.abs() != 1.0) || !own {
        return Ok(());
    }
    let columns = roles.all();
    let e = Expr::parse(&term.expr)?;
    let mut reader = Reader {
        columns: &columns,
        mistake: None,
    };
    let (Value::Known(unit), Some(wanted)) = (reader.value(&e), Unit::parse(&target.unit)) else {
        return Ok(());
    };
    if !unit.is_unlike(wanted) {
        return Ok(());
    }
    Err(Error::model(format!(
        "term `{}`: fixed = {:?}, but `{}` is not in {}, the unit of the target. Write fixed = {:?} with its unit, or {}",
        term.name,
        term.fixed.unwrap_or(1.0),
        term.expr,
        target.unit,
        term.fixed.unwrap_or(1.0) * unit.scale / wanted.scale,
        match &e {
            Expr::Var(name) => columns
                .iter()
                .find(|(n, _)| n == name)
                .map_or_else(String::new, |(role, column)| {
                    let k = unit.scale / wanted.scale;
                    format!("under [roles]: {}", line(role, column, &target.unit, k))
                }),
            _ => format!("convert it: `({}) * {:?}`", term.expr, unit.scale / wanted.scale),
        }
    )))
}

/// The line of a column under `[roles]` in another unit, `factor` times its own.
fn line(role: &str, column: &Column, unit: &str, factor: f64) -> String {
    let mut rest = String::new();
    if column.offset != 0.0 {
        rest += &format!(", offset = {:?}", column.offset * factor);
    }
    if column.deadband != 0.0 {
        rest += &format!(", deadband = {:?}", column.deadband * factor);
    }
    format!(
        "{role} = {{ column = \"{}\", unit = \"{unit}\", scale = {:?}{rest} }}",
        column.column,
        column.scale * factor
    )
}

/// Two values of one dimension in unlike units.
fn unlike(
    columns: &[(String, &Column)],
    place: &str,
    (a, u): (&Expr, Unit),
    (b, v): (&Expr, Unit),
) -> Error {
    let factor = v.scale / u.scale;
    let lone = |e: &Expr| match e {
        Expr::Var(name) => columns.iter().find(|(n, _)| n == name),
        _ => None,
    };
    let of = |e: &Expr, unit: Unit| {
        let same = |(name, column): &&(String, &Column)| {
            e.names().contains(name) && Unit::parse(&column.unit).is_some_and(|w| w == unit)
        };
        columns.iter().find(same).map(|(_, c)| c.unit.clone())
    };
    let said = match (of(a, u), of(b, v)) {
        (Some(one), Some(other)) => format!("`{a}` is in {one} and `{b}` in {other}"),
        _ => format!(
            "`{a}` and `{b}` are in unlike units: one of the second is {factor:?} of the first"
        ),
    };
    let roles = match (lone(b), of(a, u)) {
        (Some((role, column)), Some(unit)) => {
            format!(
                "Write under [roles]: {}; or convert",
                line(role, column, &unit, factor)
            )
        }
        _ => "Convert".into(),
    };
    Error::model(format!(
        "{place}: {said}. {roles} in the expression: `({b}) * {factor:?}`"
    ))
}

/// An angle in a sine that is in another unit than radians, unless the expression converts it.
fn check_sines(
    columns: &[(String, &Column)],
    place: &str,
    text: &str,
    e: &Expr,
) -> Result<(), Error> {
    // Whoever writes pi converts.
    let converts = text
        .split(|c: char| !c.is_alphanumeric())
        .any(|word| word == "pi");
    if converts {
        return Ok(());
    }
    let mut wrong: Option<(&String, &Column, f64)> = None;
    e.visit(&mut |e| {
        let Expr::Call(Func::Sin | Func::Cos | Func::Tan, arguments) = e else {
            return;
        };
        for (role, column) in columns {
            let Some(radians) = radians(&column.unit).filter(|r| *r != 1.0) else {
                continue;
            };
            let slope = arguments.iter().find_map(|a| slope(a, role));
            if slope.is_some_and(|k| !is_of_a_turn(k / radians)) {
                wrong.get_or_insert((role, column, radians));
            }
        }
    });
    match wrong {
        Some((role, column, radians)) => Err(in_degrees(place, role, column, radians)),
        None => Ok(()),
    }
}

/// A column that is in a sine and not in radians.
fn in_degrees(place: &str, role: &str, column: &Column, radians: f64) -> Error {
    Error::model(format!(
        "{place}: sin, cos and tan take radians, and role `{role}` is in {}. Write under [roles]: {}; \
         or convert in the expression: `{role} * {}`",
        column.unit,
        line(role, column, "rad", radians),
        match column.unit.trim() {
            "rev" | "turn" | "turns" => "2 * pi",
            "mrad" => "0.001",
            _ => "pi / 180",
        }
    ))
}

/// Highest order per turn up to which a factor of an angle in a sine is taken for one.
const HIGHEST_ORDER: f64 = 250.0;

/// Whether a factor of an angle, per radian of it, is a whole or half number of periods in a turn.
/// No plain factor of degrees or turns is: 1 per degree is 57.3 per turn.
fn is_of_a_turn(order: f64) -> bool {
    let halves = 2.0 * order;
    order.abs() <= HIGHEST_ORDER && halves.abs() > 0.5 && (halves - halves.round()).abs() < 2e-3
}

/// Factor of a column in an expression that is linear in its columns and has this one.
fn slope(e: &Expr, name: &str) -> Option<f64> {
    let at = |x: f64| value(e, &|n: &str| if n == name { x } else { 0.0 });
    let slope = at(1.0)? - at(0.0)?;
    (e.names().contains(name) && slope != 0.0 && slope.is_finite()).then_some(slope)
}

/// Value of an expression of arithmetic; `None` of one with functions or comparisons.
fn value(e: &Expr, of: &dyn Fn(&str) -> f64) -> Option<f64> {
    match e {
        Expr::Num(x) => Some(*x),
        Expr::Var(name) => Some(of(name)),
        Expr::Unary('-', a) => Some(-value(a, of)?),
        Expr::Binary(op, a, b) => {
            let (a, b) = (value(a, of)?, value(b, of)?);
            match *op {
                "+" => Some(a + b),
                "-" => Some(a - b),
                "*" => Some(a * b),
                "/" => Some(a / b),
                _ => None,
            }
        }
        Expr::Unary(..) | Expr::Call(..) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::Spec;

    #[test]
    fn an_angle_that_is_not_in_radians_is_refused_in_a_sine() {
        let with = |unit: &str, expr: &str| {
            Spec::parse(&format!(
                "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\" }}\n\
                 angle = {{ column = \"q\", unit = \"{unit}\", scale = 2.0, offset = 90.0 }}\n\
                 [roles.pose]\nshoulder = {{ column = \"q1\", unit = \"deg\" }}\n\
                 [[terms]]\nname = \"weight\"\nexpr = \"{expr}\"\n"
            ))
        };
        for (unit, expr) in [
            ("deg", "sin(angle)"),
            ("deg", "1 - cos(2 * angle + 0.3)"),
            ("deg", "sin(angle + shoulder)"),
            ("rad", "sin(angle - shoulder)"),
            ("degrees", "command * tan(angle / 2)"),
            ("rev", "sin(angle)"),
            ("turns", "sin(7 * angle)"),
            ("mrad", "sin(angle)"),
        ] {
            let says = with(unit, expr).unwrap_err().to_string();
            assert!(
                says.contains("term `weight`: sin, cos and tan take radians"),
                "{expr}: {says}"
            );
        }
        let says = with("deg", "sin(angle)").unwrap_err().to_string();
        let line = "angle = { column = \"q\", unit = \"rad\", scale = 0.03490658503988659, offset = 1.5707963267948966 }";
        assert!(
            says.contains(line) && says.contains("`angle * pi / 180`"),
            "{says}"
        );
        for (unit, expr) in [
            ("rad", "sin(angle)"),
            ("deg", "sin(angle * pi / 180)"),
            ("deg", "sin(0.0174533 * angle)"),
            ("deg", "sin(angle / 57.29578 * 7 + 0.2)"),
            ("rev", "sin(6.2831853 * angle)"),
            ("mrad", "sin(angle / 1000)"),
            ("", "sin(angle)"),
            ("deg", "angle + sin(time)"),
        ] {
            assert!(
                with(unit, expr).is_ok(),
                "{unit} {expr}: {:?}",
                with(unit, expr)
            );
        }
    }

    /// A model with columns in several units and one term.
    fn mixed(expr: &str, keys: &str) -> Result<Spec, Error> {
        Spec::parse(&format!(
            "[roles]\ntime = {{ column = \"t\", unit = \"s\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
             command = {{ column = \"c\", unit = \"mN\" }}\n\
             angle = {{ column = \"q\", unit = \"deg\" }}\n\
             velocity = {{ column = \"v\", unit = \"rad/s\", deadband = 0.1 }}\n\
             [roles.pose]\nshoulder = {{ column = \"q1\", unit = \"rad\" }}\n\
             x = {{ column = \"x\", unit = \"mm\" }}\nz = {{ column = \"z\", unit = \"m\" }}\n\
             rate = {{ column = \"r\", unit = \"deg/s\" }}\n\
             [[terms]]\nname = \"a\"\nexpr = \"{expr}\"\n{keys}\n"
        ))
    }

    #[test]
    fn units_that_do_not_fit_are_refused_with_the_line_to_write() {
        for (expr, line) in [
            (
                "angle - shoulder",
                "shoulder = { column = \"q1\", unit = \"deg\", scale = 57.29577951308232 }",
            ),
            (
                "x + z",
                "z = { column = \"z\", unit = \"mm\", scale = 1000.0 }",
            ),
            ("command + sqrt(1) * (x^2 + z^2)", "`(z^2) * 1000000.0`"),
            (
                "deriv(angle, 2) - velocity",
                "`(velocity) * 57.29577951308232`",
            ),
            (
                "velocity > rate",
                "rate = { column = \"r\", unit = \"rad/s\", scale = 0.017453292519943295 }",
            ),
            (
                "max(velocity, abs(rate))",
                "`(abs(rate)) * 0.017453292519943295`",
            ),
            ("atan(x / z) + angle", "angle"),
            (
                "sin(abs(angle))",
                "angle = { column = \"q\", unit = \"rad\", scale = 0.017453292519943295 }",
            ),
            ("cos(lowpass(angle, 0.1) / 2)", "take radians"),
            ("tan(integ(rate))", "take radians, and `integ(rate)`"),
            ("sin(rate * elapsed)", "take radians, and `rate * elapsed`"),
            (
                "sin(angle * pi / 180) + sin(delay(angle, 0.1))",
                "take radians",
            ),
        ] {
            let says = mixed(expr, "").map(|_| ()).expect_err(expr).to_string();
            assert!(
                says.contains("term `a`: ") && says.contains(line),
                "{expr}: {says}"
            );
        }
        for expr in [
            "angle * pi / 180 - shoulder",
            "angle / 57.29578 - shoulder",
            "x / 1000 + z",
            "x - 1000 * z",
            "rate * 0.0174533 + velocity",
            "angle + velocity",
            "x * z + command",
            "abs(velocity) > 0.2",
            "sin(abs(angle) * pi / 180)",
            "sin(shoulder + 0.2) * x",
            "atan(x / 120) + shoulder",
            "sgn(rate, 1) * velocity",
        ] {
            assert!(
                mixed(expr, "").is_ok(),
                "{expr}: {:?}",
                mixed(expr, "").err()
            );
        }
    }

    #[test]
    fn a_coefficient_of_one_has_the_target_s_unit() {
        let says = mixed("command", "fixed = 1.0").unwrap_err().to_string();
        let line = "command = { column = \"c\", unit = \"N\", scale = 0.001 }";
        assert!(
            says.contains(line) && says.contains("fixed = 0.001"),
            "{says}"
        );
        for keys in ["fixed = 0.001", "", "fixed = 1.0\nunit = \"N/mN\""] {
            assert!(mixed("command", keys).is_ok(), "{keys}");
        }
        assert!(mixed("command / 1000", "fixed = 1.0").is_ok());
    }
}
