//! A figure, its goal, and how both are printed.

/// What a figure has to be.
#[derive(Clone, Copy)]
pub enum Goal {
    /// At most this.
    AtMost(f64),
    /// At least this.
    AtLeast(f64),
    /// Reported beside the others.
    None,
}

/// A figure with its goal.
pub struct Figure {
    pub key: &'static str,
    pub value: f64,
    pub goal: Goal,
    pub what: &'static str,
}

/// The figures of a bench, in order.
#[derive(Default)]
pub struct Figures(pub Vec<Figure>);

impl Figures {
    /// Prints and keeps a figure.
    pub fn add(&mut self, key: &'static str, value: f64, goal: Goal, what: &'static str) {
        let figure = Figure {
            key,
            value,
            goal,
            what,
        };
        println!(
            "{:<38} {:>12}   {:<12} {}",
            figure.key,
            number(value),
            verdict(&figure),
            what
        );
        self.0.push(figure);
    }
}

/// Four significant digits, without exponent.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if size < 1e-3 {
        return format!("{value:.2e}");
    }
    let digits = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}

/// The goal, and whether the figure reaches it.
pub fn verdict(figure: &Figure) -> String {
    match figure.goal {
        Goal::AtMost(limit) if figure.value <= limit => format!("<= {limit} ok"),
        Goal::AtMost(limit) => format!("<= {limit} MISSED"),
        Goal::AtLeast(limit) if figure.value >= limit => format!(">= {limit} ok"),
        Goal::AtLeast(limit) => format!(">= {limit} MISSED"),
        Goal::None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits_and_goals_a_verdict() {
        for (value, text) in [
            (0.0, "0"),
            (0.101_26, "0.1013"),
            (145.237, "145.2"),
            (12_345.6, "12346"),
            (1.234e-5, "1.23e-5"),
        ] {
            assert_eq!(number(value), text);
        }
        let figure = |value, goal| Figure {
            key: "x",
            value,
            goal,
            what: "",
        };
        assert_eq!(verdict(&figure(1.0, Goal::AtMost(1.0))), "<= 1 ok");
        assert_eq!(verdict(&figure(1.1, Goal::AtMost(1.0))), "<= 1 MISSED");
        assert_eq!(verdict(&figure(0.9, Goal::AtLeast(0.9))), ">= 0.9 ok");
        assert_eq!(
            verdict(&figure(f64::NAN, Goal::AtLeast(0.9))),
            ">= 0.9 MISSED"
        );
        assert_eq!(verdict(&figure(1.0, Goal::None)), "");
    }
}
