//! What an effect may know about the data when it proposes its forms.

use super::ratio;
use crate::expr::Expr;
use crate::problem::Problem;
use crate::spec::Spec;
use crate::stats;

/// Longest window of a slope times the rate at which the velocity changes (for a sine its angular frequency).
const WINDOW: f64 = 1.5;

/// What an effect may know about the data when it proposes variants.
pub(crate) struct Context<'a> {
    pub problem: &'a Problem,
    pub spec: &'a Spec,
    /// The declared model's prediction as an expression: what the rig is loaded with.
    pub load: String,
    /// Residual of the current model on fitted rows.
    pub residual: &'a [f64],
    /// Columns that the current model uses, effects found so far included.
    pub columns: Vec<String>,
    /// Whether the current model has dry friction already.
    pub friction: bool,
    /// Velocity expression (the role, or the derivative of the angle).
    pub velocity: Option<String>,
    /// Standstill band of the velocity.
    pub deadband: f64,
    /// Position expression (the angle role, or the integral of the velocity).
    pub position: Option<String>,
    /// Median step of time, s.
    pub dt: f64,
    /// Longest sequence, s.
    pub span: f64,
}

impl Context<'_> {
    /// Unit of the target.
    pub fn unit(&self) -> &str {
        &self.spec.roles.target.unit
    }

    /// `target unit / x`, for coefficients.
    pub fn per(&self, x: &str) -> String {
        if x.is_empty() {
            self.unit().to_string()
        } else if x == self.unit() {
            "1".into()
        } else {
            ratio(self.unit(), x)
        }
    }

    pub fn has_command(&self) -> bool {
        self.spec.roles.command.is_some()
    }

    /// Whether the load has a term whose coefficient is declared, so that its scale may be wrong.
    pub fn scale_is_declared(&self) -> bool {
        let declared: Vec<_> = self
            .spec
            .terms
            .iter()
            .filter(|t| t.effect.is_empty() && t.per.is_empty())
            .filter_map(|t| Some((t.fixed, Expr::parse(&t.expr).ok()?)))
            .collect();
        let of_command = |e: &Expr| e.names().contains("command");
        let any = declared.iter().any(|(_, e)| of_command(e));
        declared
            .iter()
            .any(|(fixed, e)| fixed.is_some() && (!any || of_command(e)))
    }

    /// Half widths, in rows, of the slopes of a velocity that stand for its acceleration: a compromise between noise and lost
    /// detail.
    pub fn slopes(&self, velocity: &str) -> Vec<f64> {
        let size = stats::deviation(&self.values(velocity)).max(f64::MIN_POSITIVE);
        // A slope over 2 `half` + 1 rows follows the acceleration where that window is short beside the time in which the
        // velocity changes. A sine keeps nine tenths of its acceleration at the limit.
        let follows = |half: &f64| {
            let slope = self.values(&format!("deriv({velocity}, {half})"));
            (2.0 * half + 1.0) * self.dt * stats::rms(&slope) / size < WINDOW
        };
        // Far wider ones see no change at all, so the first that does not follow ends the list.
        let wider = [2.0, 3.0, 5.0, 8.0, 12.0, 18.0].into_iter();
        std::iter::once(1.0)
            .chain(wider.take_while(follows))
            .collect()
    }

    /// Whether enough of the fitted rows are at rest to show what friction does there.
    pub fn rests(&self) -> bool {
        let Some(v) = &self.velocity else {
            return false;
        };
        stats::mean(&self.values(&format!("sgn({v}, {}) == 0", self.deadband))) > 0.005
    }

    /// Values of an expression on fitted rows; empty if it cannot be evaluated.
    pub fn values(&self, text: &str) -> Vec<f64> {
        self.problem
            .eval_text(&self.problem.plain, text, true)
            .map_or_else(|_| vec![], |v| v.to_vec())
    }

    /// 2 % and 98 % quantiles of an expression; `None` if it is constant or cannot be evaluated.
    pub fn range(&self, text: &str) -> Option<(f64, f64)> {
        self.problem.range(text)
    }

    /// Step of a column that moves in steps; 0 if it does not, or is not there.
    pub fn step_of(&self, column: &str) -> f64 {
        let frame = &self.problem.frame;
        let step = frame.column(column).and_then(stats::quantum);
        step.unwrap_or(0.0)
    }

    /// Width of the range of an expression between its 2 % and 98 % quantiles; 0 if it is constant.
    pub fn width(&self, text: &str) -> f64 {
        self.range(text).map_or(0.0, |(lo, hi)| hi - lo)
    }

    /// Largest range of an expression within one sequence, between its 2 % and 98 % quantiles there.
    pub fn excursion(&self, text: &str) -> f64 {
        let v = self.values(text);
        if v.is_empty() {
            return 0.0;
        }
        let blocks = &self.problem.blocks;
        let of = |run: std::ops::Range<usize>| {
            let rows = blocks[run.start].range.start..blocks[run.end - 1].range.end;
            let mut own = v[rows].to_vec();
            own.sort_unstable_by(f64::total_cmp);
            stats::quantile_sorted(&own, 0.98) - stats::quantile_sorted(&own, 0.02)
        };
        self.problem.runs().into_iter().map(of).fold(0.0, f64::max)
    }

    /// Name of the velocity's unit.
    pub fn velocity_unit(&self) -> String {
        match &self.spec.roles.velocity {
            Some(v) => v.unit.clone(),
            None => format!("{}/s", self.spec.roles.unit("angle")),
        }
    }

    /// Name of the position's unit.
    pub fn position_unit(&self) -> String {
        match &self.spec.roles.angle {
            Some(a) => a.unit.clone(),
            None => {
                let v = self.velocity_unit();
                v.strip_suffix("/s")
                    .map_or(format!("{v}·s"), str::to_string)
            }
        }
    }

    /// Radians per unit, if `unit` is an angle.
    pub fn radians(unit: &str) -> Option<f64> {
        match unit.trim() {
            "rad" | "radian" | "radians" => Some(1.0),
            "deg" | "degree" | "degrees" | "°" => Some(std::f64::consts::PI / 180.0),
            "rev" | "turn" | "turns" => Some(std::f64::consts::TAU),
            "mrad" => Some(1e-3),
            _ => None,
        }
    }

    /// Angles in the data: (name for reports, expression in radians, total range in radians).
    pub fn angles(&self) -> Vec<(String, String, f64)> {
        let mut all: Vec<(String, String)> = self
            .spec
            .roles
            .pose
            .iter()
            .map(|(n, c)| (n.clone(), c.unit.clone()))
            .collect();
        if let Some(a) = &self.spec.roles.angle {
            all.push(("angle".into(), a.unit.clone()));
        }
        all.into_iter()
            .filter_map(|(n, unit)| {
                let k = Context::radians(&unit)?;
                let (lo, hi) = self.range(&n)?;
                let text = if k == 1.0 {
                    n.clone()
                } else {
                    format!("({n} * {k})")
                };
                Some((n, text, (hi - lo) * k))
            })
            .collect()
    }

    /// Time-varying columns that the declared terms use.
    pub fn declared_columns(&self) -> Vec<String> {
        let mut out = std::collections::BTreeSet::new();
        for t in self.spec.terms.iter().filter(|t| t.effect.is_empty()) {
            if let Ok(e) = Expr::parse(&t.expr) {
                out.extend(e.names());
            }
        }
        out.into_iter()
            .filter(|n| {
                !["time", "elapsed", "file"].contains(&n.as_str()) && self.range(n).is_some()
            })
            .collect()
    }

    /// Logarithmic grid.
    pub fn log_grid(lo: f64, hi: f64, n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| lo * (hi / lo).powf(i as f64 / (n - 1).max(1) as f64))
            .collect()
    }
}
