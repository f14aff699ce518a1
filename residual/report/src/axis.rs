//! Labels of plot axes: an expression of the model as words, with its unit.

use super::plot::Plot;
use super::words::titled;
use super::Report;

impl Report {
    /// A plot with the label of its x axis in words.
    pub(super) fn labelled(&self, p: &Plot) -> Plot {
        Plot {
            // Other labels are words with a unit already.
            against: if p.against.contains(['(', '*']) || p.against == "elapsed" {
                self.axis(&p.against)
            } else {
                p.against.clone()
            },
            ..p.clone()
        }
    }

    /// Label of an axis, in words and with its unit, from the expression that was evaluated for it.
    fn axis(&self, expression: &str) -> String {
        let (name, unit) = self.quantity(expression);
        titled(&name, &unit)
    }

    /// Name and unit of an expression of the kind that effects are plotted against; any other
    /// expression is its own name.
    fn quantity(&self, expression: &str) -> (String, String) {
        let e = expression.trim();
        let inside = |function: &str| {
            e.strip_prefix(function)?
                .strip_prefix('(')?
                .strip_suffix(')')
                .filter(|inner| {
                    // The bracket that closes is the one that the function opened.
                    let mut depth = 0i32;
                    inner.chars().all(|c| {
                        depth += i32::from(c == '(') - i32::from(c == ')');
                        depth >= 0
                    })
                })
                .map(|inner| inner.rsplit_once(", ").unwrap_or((inner, "")).0)
        };
        let unit = |name: &str| self.extended.roles.unit(name);
        if e == "load" {
            return ("load".into(), self.unit.clone());
        }
        if e == "elapsed" {
            return ("time since the start of the run".into(), "s".into());
        }
        if let Some(x) = inside("deriv") {
            return match self.quantity(x) {
                (name, u) if u.is_empty() => (format!("rate of change of {name}"), u),
                (name, u) => (format!("rate of change of {name}"), format!("{u}/s")),
            };
        }
        if let Some(x) = inside("integ") {
            let (name, u) = self.quantity(x);
            let u = u.strip_suffix("/s").map_or(format!("{u} s"), String::from);
            return (format!("time integral of {name}"), u);
        }
        if let Some(x) = inside("held") {
            return (
                format!("direction held of {}", self.quantity(x).0),
                String::new(),
            );
        }
        if let Some(x) = saw_tooth(e) {
            let (name, u) = self.quantity(x);
            return (format!("{name} within one step"), u);
        }
        if let Some((a, b)) = product(e) {
            // An angle turned into radians.
            if b.parse::<f64>().is_ok() {
                return (self.quantity(a).0, "rad".into());
            }
            let ((a, u), (b, v)) = (self.quantity(a), self.quantity(b));
            let unit = match (u.as_str(), v.strip_suffix("/s")) {
                ("", _) => v,
                ("s", Some(v)) => v.into(),
                _ if v.is_empty() => u,
                _ => format!("{u} {v}"),
            };
            return (format!("{a} times {b}"), unit);
        }
        if e.starts_with("(held(") && e.contains(" - sgn(") {
            return ("direction held at rest".into(), String::new());
        }
        // The angle of a link behind two joints.
        let sum = |sign: &str| e.strip_prefix('(')?.strip_suffix(')')?.split_once(sign);
        for sign in [" + ", " - "] {
            if let Some((a, b)) = sum(sign) {
                let (a, b) = (self.quantity(a), self.quantity(b));
                let same = if a.1 == b.1 { a.1 } else { String::new() };
                return (format!("{}{sign}{}", a.0, b.0), same);
            }
        }
        (e.to_string(), unit(e))
    }
}

/// What is left of `x` within one step, from `x - round(x / step) * step` or the same with `floor`.
fn saw_tooth(e: &str) -> Option<&str> {
    let x = [" - round(", " - floor("].iter().find_map(|f| {
        let (x, rest) = e.split_once(f)?;
        rest.starts_with(&format!("{x} / ")).then_some(x)
    });
    x.filter(|x| !x.is_empty())
}

/// The two factors of an expression that is a product at its top level, with or without brackets
/// around it.
fn product(e: &str) -> Option<(&str, &str)> {
    let split = |e: &str| {
        let mut depth = 0i32;
        e.char_indices()
            .find(|(_, c)| {
                depth += i32::from(*c == '(') - i32::from(*c == ')');
                depth == 0 && *c == '*'
            })
            .map(|(i, _)| i)
    };
    let bare = match split(e) {
        Some(_) => e,
        None => e.strip_prefix('(')?.strip_suffix(')')?,
    };
    let at = split(bare)?;
    Some((bare[..at].trim(), bare[at + 1..].trim()))
}

#[cfg(test)]
mod tests {
    use super::super::example;

    #[test]
    fn axes_are_words_with_units() {
        let report = example::report();
        for (expression, label) in [
            ("deriv(velocity, 12)", "rate of change of velocity, rad/s/s"),
            (
                "(held(velocity, 0.1) - sgn(velocity, 0.1))",
                "direction held at rest",
            ),
            (
                "(held(velocity, 0) - sgn(velocity, 0)) * load",
                "direction held at rest times load, N",
            ),
            ("load - round(load / 0.5) * 0.5", "load within one step, N"),
            ("((q2 * 0.01) + (q3 * 0.01))", "q2 + q3, rad"),
        ] {
            assert_eq!(report.axis(expression), label);
        }
    }
}
