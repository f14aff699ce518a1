//! Forms that stand for structure without a name: curves in one variable, products of two, lagged
//! inputs.

use residual_columns::stats;
use residual_effects::{Build, Context, Piece, Psi, Variant};
use residual_search::scan::{Offer, Origin};
use std::sync::Arc;

/// Knots of a curve in one variable, and of one times the sign of the velocity.
const KNOTS: usize = 7;
const KNOTS_WITH_SIGN: usize = 4;

/// Knots of a fine curve in the load, which shows six periods over its range.
const FINE_KNOTS: usize = 23;

/// Times after a start over which friction may change.
const STARTS_S: [f64; 4] = [0.1, 0.3, 1.0, 3.0];

/// Values of the nonlinear parameter of a law: a refinement follows.
const PLACES: usize = 15;

/// Least and greatest power of a law.
const POWERS: [f64; 2] = [0.2, 5.0];

/// Widths of a bump, over half of the range of its variable.
const WIDTHS_OF_A_BUMP: [f64; 4] = [0.12, 0.25, 0.5, 1.0];

/// A variable that nameless structure can depend on, in the order in which a plot prefers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Axis {
    Velocity,
    Load,
    Angle,
    Temperature,
    Pose,
    Channel,
    Time,
}

/// A variable: what it is, its name for readers, its expression.
#[derive(Debug, Clone)]
struct Variable {
    axis: Axis,
    name: String,
    expression: String,
}

/// Structure without a name: a free form in one or two variables.
#[derive(Debug, Clone)]
pub struct Nameless {
    /// What it depends on, for readers.
    pub depends_on: String,
    variables: Vec<Variable>,
    /// Whether it is a law that may act beside another one, as what friction has after a start.
    pub acts_beside: bool,
}

impl Origin for Nameless {}

impl Nameless {
    /// The one variable of a curve; `None` for a form with two, or with none.
    pub fn curve_over(&self) -> Option<&str> {
        match &self.variables[..] {
            [only] => Some(&only.expression),
            _ => None,
        }
    }

    /// Expression to plot the residual against; `None` for the load, which also stands in for
    /// variables that show nothing by themselves.
    pub fn against(&self) -> Option<&str> {
        let first = self.variables.iter().min_by_key(|v| v.axis)?;
        matches!(
            first.axis,
            Axis::Velocity | Axis::Angle | Axis::Temperature | Axis::Pose
        )
        .then_some(&first.expression)
    }
}

/// Every nameless form that the data allow.
pub fn offers(ctx: &Context) -> Vec<Offer<Nameless>> {
    let variables = variables(ctx);
    let mut out = Vec::new();
    curves(ctx, &variables, &mut out);
    products(ctx, &variables, &mut out);
    with_sign(ctx, &variables, &mut out);
    friction(ctx, &variables, &mut out);
    histories(ctx, &variables, &mut out);
    speeds(ctx, &variables, &mut out);
    out
}

/// Friction as a curve over the speed: it jumps where the direction changes.
fn friction(ctx: &Context, variables: &[Variable], out: &mut Vec<Offer<Nameless>>) {
    for v in variables.iter().filter(|v| v.axis == Axis::Velocity) {
        let s = format!("sgn({}, {})", v.expression, ctx.deadband);
        let speed = format!("abs({})", v.expression);
        let curve = hinges(ctx, &speed, KNOTS);
        let signed = curve.into_iter().map(|h| format!("{s} * {h}"));
        let texts = std::iter::once(s.clone()).chain(signed).collect();
        out.push(form("a curve of friction in velocity".into(), &[v], texts));
        // What a friction is after a start: the longer the motion lasts, the nearer to 1.
        let moving = format!("abs({s})");
        let texts = STARTS_S
            .iter()
            .map(|tau| format!("{s} * lowpass({moving}, {tau})"));
        let texts = std::iter::once(s.clone()).chain(texts).collect();
        let name = "the time since the motion began, with its direction";
        let mut start = form(name.into(), &[v], texts);
        start.origin.acts_beside = true;
        out.push(start);
    }
}

/// Curves with few parameters in one variable, the laws that a sum of effects may imitate: powers,
/// stops, gaps, bumps.
pub fn laws(ctx: &Context, e: &str) -> Vec<Offer<Nameless>> {
    let mut values = ctx.values(e);
    values.sort_by(f64::total_cmp);
    let Some((low, high)) = ctx.range(e) else {
        return vec![];
    };
    let at = |share: f64| stats::quantile_sorted(&values, share);
    let (half, farthest) = (0.5 * (high - low), low.abs().max(high.abs()));
    let (u, x) = (unit(ctx, e), format!("(({e}) / {half})"));
    let shares = |most: f64| (1..=PLACES).map(move |k| most * k as f64 / (PLACES + 1) as f64);
    let places: Vec<f64> = shares(1.0).map(at).collect();
    let gaps: Vec<f64> = shares(farthest).collect();
    let mut out = Vec::new();
    for degree in 2..=5 {
        let powers = (1..=degree).map(|n| format!("{u}^{n}")).collect();
        out.push(law("a polynomial", vec![], powers));
    }
    let mut add = |what: &str, grid: &[f64], texts: &[String]| {
        out.push(law(what, grid.to_vec(), texts.to_vec()));
    };
    add("a square", &[], &[format!("{x}^2")]);
    add("a cube", &[], &[format!("{x}^3")]);
    add("a line with a cube", &[], &[x.clone(), format!("{x}^3")]);
    add("a root", &[], &[format!("sqrt(max(0, {e} - {}))", at(0.0))]);
    let (above, below) = (format!("max(0, {e} - (#))"), format!("max(0, (#) - ({e}))"));
    let outside = format!("min(0, {e} + #)");
    add("a stop", &places, std::slice::from_ref(&above));
    add("a stop", &places, &[below]);
    add("a bend", &places, &[x.clone(), above.clone()]);
    add(
        "a line with a gap",
        &gaps,
        &[format!("{e} - clip({e}, -#, #)")],
    );
    add("two lines with a gap", &gaps, &[above, outside]);
    add(
        "a line that levels off",
        &gaps,
        &[format!("tanh(({e}) / #)")],
    );
    let powers = Context::log_grid(POWERS[0], POWERS[1], PLACES);
    add("a power", &powers, &[format!("sign({e}) * abs({x})^#")]);
    for width in WIDTHS_OF_A_BUMP.map(|share| share * half) {
        let bump = format!("exp(-(({e} - (#)) / {width})^2)");
        add("a bump", &places, &[bump]);
    }
    out
}

/// A straight line with its constant, the plainest curve.
pub fn line(e: &str) -> Offer<Nameless> {
    law("a line", vec![], vec!["1".into(), e.into()])
}

/// A law from its terms, in which `#` stands for the nonlinear parameter, and the values of that;
/// without any it has none.
fn law(what: &str, grid: Vec<f64>, texts: Vec<String>) -> Offer<Nameless> {
    let pieces = move |psi: f64| -> Vec<Piece> {
        let at = |text: &String| text.replace("#", &psi.to_string());
        let named = texts.iter().enumerate();
        named
            .map(|(i, t)| Piece::new(format!("shape_{i}"), "", at(t)))
            .collect()
    };
    Offer {
        origin: Nameless {
            depends_on: what.into(),
            variables: vec![],
            acts_beside: false,
        },
        variant: Arc::new(match grid.is_empty() {
            true => Variant::linear("", pieces(0.0)),
            false => Variant::profiled("", Psi::new("shape", "", grid), move |psi| {
                Build::Add(pieces(psi))
            }),
        }),
    }
}

/// Forms whose coefficient each sequence has for itself: what differs from log to log, and no
/// column says why.
pub fn by_sequence(ctx: &Context) -> Vec<Offer<Nameless>> {
    let load = ctx.range(&ctx.load).map(|_| ("gain", ctx.load.clone()));
    let of_velocity = ctx.velocity.iter().flat_map(|v| {
        let sign = format!("sgn({v}, {})", ctx.deadband);
        [("damping", v.clone()), ("dry friction", sign)]
    });
    std::iter::once(("offset", "1".to_string()))
        .chain(load)
        .chain(of_velocity)
        .map(|(name, text)| Offer {
            origin: Nameless {
                depends_on: format!("which sequence it is: its {name} is its own"),
                variables: vec![],
                acts_beside: true,
            },
            variant: Arc::new(Variant::by_sequence(vec![Piece::new(name, "", text)])),
        })
        .collect()
}

/// Variables that vary in these data.
fn variables(ctx: &Context) -> Vec<Variable> {
    let roles = &ctx.spec.roles;
    let mut out = Vec::new();
    let mut add = |axis, name: &str, expression: &str| {
        out.push(Variable {
            axis,
            name: name.into(),
            expression: expression.into(),
        });
    };
    add(Axis::Load, "load", &ctx.load);
    // The load behind an effect that replaces the command lacks what that effect takes out of it.
    if ctx.load.contains("(command,") {
        add(Axis::Load, "command", "command");
    }
    if let Some(v) = &ctx.velocity {
        add(Axis::Velocity, "velocity", v);
    }
    if let (Some(_), Some(x)) = (&roles.angle, &ctx.position) {
        add(Axis::Angle, "angle", x);
    }
    if roles.temperature.is_some() {
        add(Axis::Temperature, "temperature", "temperature");
    }
    roles.pose.keys().for_each(|n| add(Axis::Pose, n, n));
    roles.channels.keys().for_each(|n| add(Axis::Channel, n, n));
    add(Axis::Time, "time in the run", "elapsed");
    out.retain(|v| ctx.range(&v.expression).is_some());
    out
}

/// A form from its terms.
fn form(depends_on: String, variables: &[&Variable], texts: Vec<String>) -> Offer<Nameless> {
    let pieces = texts
        .into_iter()
        .enumerate()
        .map(|(i, t)| Piece::new(format!("shape_{i}"), "", t))
        .collect();
    Offer {
        origin: Nameless {
            depends_on,
            variables: variables.iter().map(|v| (*v).clone()).collect(),
            acts_beside: false,
        },
        variant: Arc::new(Variant::linear("", pieces)),
    }
}

/// Terms of a polygon in an expression with `count` knots at its quantiles.
fn hinges(ctx: &Context, e: &str, count: usize) -> Vec<String> {
    let mut v = ctx.values(e);
    v.sort_by(f64::total_cmp);
    let scale = stats::quantile_sorted(&v, 0.98) - stats::quantile_sorted(&v, 0.02);
    let mut out = vec![format!("({e}) / {scale}")];
    let mut last = f64::NEG_INFINITY;
    for i in 1..=count {
        let k = stats::quantile_sorted(&v, i as f64 / (count + 1) as f64);
        if k > last + 1e-6 * scale {
            out.push(format!("max(0, {e} - {k}) / {scale}"));
            last = k;
        }
    }
    out
}

/// An expression between about -1 and 1.
fn unit(ctx: &Context, e: &str) -> String {
    let (lo, hi) = ctx.range(e).unwrap_or((0.0, 1.0));
    format!("(({e} - {}) / {})", 0.5 * (lo + hi), 0.5 * (hi - lo))
}

fn curves(ctx: &Context, variables: &[Variable], out: &mut Vec<Offer<Nameless>>) {
    out.extend(variables.iter().map(|v| {
        let texts = hinges(ctx, &v.expression, KNOTS);
        form(format!("a curve in {}", v.name), &[v], texts)
    }));
    out.extend(variables.iter().filter(|v| v.axis == Axis::Load).map(|v| {
        let texts = hinges(ctx, &v.expression, FINE_KNOTS);
        form(format!("a fine curve in {}", v.name), &[v], texts)
    }));
}

fn products(ctx: &Context, variables: &[Variable], out: &mut Vec<Offer<Nameless>>) {
    for (i, v) in variables.iter().enumerate() {
        for w in variables.iter().skip(i + 1) {
            let (a, b) = (unit(ctx, &v.expression), unit(ctx, &w.expression));
            let texts = vec![
                a.clone(),
                b.clone(),
                format!("{a} * {b}"),
                format!("{a}^2"),
                format!("{b}^2"),
                format!("{a}^2 * {b}"),
                format!("{a} * {b}^2"),
                format!("{a}^2 * {b}^2"),
                format!("{a}^3"),
                format!("{b}^3"),
            ];
            let name = format!("{} and {} together", v.name, w.name);
            out.push(form(name, &[v, w], texts));
        }
    }
}

fn with_sign(ctx: &Context, variables: &[Variable], out: &mut Vec<Offer<Nameless>>) {
    let Some(velocity) = &ctx.velocity else {
        return;
    };
    let sign = Variable {
        axis: Axis::Velocity,
        name: "velocity".into(),
        expression: velocity.clone(),
    };
    for v in variables.iter().filter(|v| v.axis != Axis::Velocity) {
        let s = format!("sgn({velocity}, {})", ctx.deadband);
        let curve = hinges(ctx, &v.expression, KNOTS_WITH_SIGN);
        let texts = std::iter::once(s.clone())
            .chain(curve.into_iter().map(|h| format!("{s} * {h}")))
            .collect();
        let name = format!("{}, with the sign of the velocity", v.name);
        out.push(form(name, &[v, &sign], texts));
    }
}

fn histories(ctx: &Context, variables: &[Variable], out: &mut Vec<Offer<Nameless>>) {
    for v in variables
        .iter()
        .filter(|v| matches!(v.axis, Axis::Load | Axis::Velocity))
    {
        let e = &v.expression;
        let texts = [0.0, 1.0, 2.0, 4.0, 8.0, 16.0]
            .iter()
            .map(|k| format!("delay({e}, {})", k * ctx.dt))
            .collect();
        out.push(form(format!("the history of {}", v.name), &[v], texts));
        let r = unit(ctx, e);
        let texts = [3.0, 12.0, 50.0].iter().flat_map(|k| {
            let l = format!("lowpass({r}, {})", k * ctx.dt);
            [l.clone(), format!("{l}^2"), format!("{l} * {r}")]
        });
        let name = format!("the slow history of {}", v.name);
        out.push(form(name, &[v], texts.collect()));
    }
}

/// Most columns of the pose whose speeds are tried.
const MOST_SPEEDS: usize = 4;

/// Curves in the speeds of the pose, and their products with the velocity and each other: friction
/// and inertia of other joints act too.
fn speeds(ctx: &Context, variables: &[Variable], out: &mut Vec<Offer<Nameless>>) {
    let pose = variables.iter().filter(|v| v.axis == Axis::Pose);
    let own: Vec<Variable> = pose
        .take(MOST_SPEEDS)
        .map(|v| Variable {
            axis: Axis::Pose,
            name: format!("speed of {}", v.name),
            expression: format!("deriv({}, 2)", v.expression),
        })
        .filter(|v| ctx.range(&v.expression).is_some())
        .collect();
    curves(ctx, &own, out);
    let velocity = variables.iter().filter(|v| v.axis == Axis::Velocity);
    let all: Vec<Variable> = own.iter().chain(velocity).cloned().collect();
    products(ctx, &all, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_goes_by_the_variable_and_not_by_its_name() {
        let variable = |axis, name: &str, expression: &str| Variable {
            axis,
            name: name.into(),
            expression: expression.into(),
        };
        let of = |variables: &[&Variable]| form("x".into(), variables, vec![]).origin;
        let load = variable(Axis::Load, "load", "(1 * command)");
        let turn = variable(Axis::Velocity, "speed", "deriv(angle, 2)");
        let pose = variable(Axis::Pose, "velocity_like", "velocity_like");
        let time = variable(Axis::Time, "time in the run", "elapsed");
        assert_eq!(of(&[&load, &turn]).against(), Some("deriv(angle, 2)"));
        assert_eq!(of(&[&pose, &load]).against(), None);
        assert_eq!(of(&[&pose, &time]).against(), Some("velocity_like"));
        assert_eq!(of(&[&time]).against(), None);
    }
}
