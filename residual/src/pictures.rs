//! What the residual with and without an effect is drawn against: the variable that shows the
//! effect.

use residual_columns::linalg::dot;
use residual_columns::parallel;
use residual_columns::units::radians;
use residual_effects::{Build, Context, EffectKind, Piece};
use residual_fit::problem::View;
use residual_report::{Plot, WITHOUT};
use residual_search::declared;
use residual_search::model::{Chosen, Fitted};
use residual_search::Search;
use std::f64::consts::TAU;
use std::ops::Range;

/// Bins in which a variable is judged.
const BINS: usize = 30;

/// Periods in the range of a position from which a ripple is drawn over one period.
const MANY_PERIODS: f64 = 3.0;

/// The residual with and without an effect. All other effects are in both models.
pub(crate) fn of_effect(search: &Search, own: &Chosen, rest: &Fitted, all: &Fitted) -> Plot {
    let (without, with) = (&rest.fit.residual, &all.fit.residual);
    let ctx = search.scan_on(&search.declared).context();
    let part: Vec<f64> = without.iter().zip(with).map(|(a, b)| a - b).collect();
    let special = period(search, &ctx, own, all, &part)
        .or_else(|| both_directions(search, &ctx, own))
        .or_else(|| slope(search, own, rest));
    let plot = match special {
        Some((label, x)) => Plot::new(&label, &x, without, with),
        None => over(search, &axis(search, &ctx, own, &part), without, with),
    };
    plot.named("residual", WITHOUT, "with it")
}

/// Points and binned means of the residual before and after, over an expression.
pub(crate) fn over(search: &Search, against: &str, before: &[f64], after: &[f64]) -> Plot {
    let x = values(search, &search.problem.plain, against);
    let roles = &search.spec.roles;
    let unit = if against == search.load {
        roles.target.unit.clone()
    } else {
        roles.unit(against)
    };
    let name = against.replace(&search.load, "load");
    let label = if unit.is_empty() {
        name
    } else {
        format!("{name}, {unit}")
    };
    Plot::new(&label, &x, before, after)
}

/// The residual before and after over time, one run after another: over the time in the run, what
/// differs from run to run would cancel.
pub(crate) fn over_time(search: &Search, before: &[f64], after: &[f64]) -> Plot {
    let mut x = values(search, &search.problem.plain, "elapsed");
    let mut start = 0.0;
    for rows in each_run(search) {
        let Some(run) = x.get_mut(rows) else { continue };
        let first = run.first().copied().unwrap_or(0.0);
        run.iter_mut().for_each(|t| *t += start - first);
        start = run.last().copied().unwrap_or(start);
    }
    Plot::new("time, one run after another, s", &x, before, after)
}

/// Values of an expression on fitted rows; empty if it cannot be evaluated.
fn values(search: &Search, view: &View, text: &str) -> Vec<f64> {
    let problem = &search.problem;
    problem
        .eval_text(view, text, true)
        .map_or_else(|_| vec![], |v| v.to_vec())
}

/// Of the variables that can expose an effect the one over which the means of its `part` of the
/// residual are largest. Time where none of them varies.
fn axis(search: &Search, ctx: &Context, own: &Chosen, part: &[f64]) -> String {
    let axes = own.effect.axes(&own.variant, own.psi, ctx);
    let shown = axes.into_iter().filter_map(|a| {
        let x = values(search, &search.problem.plain, &a);
        let varies = x.iter().any(|v| *v != x[0]);
        varies.then(|| (shown(&x, part), a))
    });
    // Of equal ones the first.
    let best = shown.reduce(|best, a| if a.0 > best.0 { a } else { best });
    best.map_or_else(|| "elapsed".into(), |(_, a)| a)
}

/// Sum of squares of `part` that is in its means over bins of `x` with equal numbers of rows.
fn shown(x: &[f64], part: &[f64]) -> f64 {
    if x.len() != part.len() {
        return 0.0;
    }
    let mut order: Vec<usize> = (0..x.len()).collect();
    parallel::sort(&mut order, |a, b| x[*a].total_cmp(&x[*b]));
    let bins = order.chunks(x.len().div_ceil(BINS).max(1));
    bins.map(|rows| rows.iter().map(|i| part[*i]).sum::<f64>().powi(2) / rows.len() as f64)
        .sum()
}

/// A sine over its own period, from the zero at which it begins to rise: in the data it repeats too
/// often to be seen. `None` for all that does not repeat. The label, and the place in the period of
/// each row.
fn period(
    search: &Search,
    ctx: &Context,
    own: &Chosen,
    all: &Fitted,
    part: &[f64],
) -> Option<(String, Vec<f64>)> {
    let (label, length) = match own.effect.kind() {
        EffectKind::Tone => ("time within one period, s".to_string(), 1.0 / own.psi),
        EffectKind::PeriodicAngle => {
            let unit = ctx.position_unit();
            let length = TAU / own.psi / radians(&unit)?;
            if ctx.width(ctx.position.as_ref()?) < MANY_PERIODS * length {
                return None;
            }
            (format!("angle within one period, {unit}"), length)
        }
        _ => return None,
    };
    let pieces = match (own.variant.build)(own.psi) {
        Build::Add(pieces) | Build::Local(pieces) => pieces,
        _ => return None,
    };
    let view = search.problem.view(&all.model.replaced).ok()?;
    let of = |piece: Option<&Piece>| values(search, &view, piece.map_or("", |p| &p.text));
    let (sine, cosine) = (of(pieces.first()), of(pieces.get(1)));
    if sine.len() != part.len() || cosine.len() != part.len() {
        return None;
    }
    let mut x = vec![0.0; part.len()];
    for rows in runs(search, own) {
        let own = |column: &[f64]| column[rows.clone()].to_vec();
        let zero = rise(&own(&sine), &own(&cosine), &own(part));
        for i in rows {
            let angle = sine[i].atan2(cosine[i]) + zero;
            x[i] = length * angle.rem_euclid(TAU) / TAU;
        }
    }
    Some((label, x))
}

/// The angle within a turn, or within a period of the friction's order, where friction depends on
/// it: the turns lie on top of each other, and the two directions of motion beside each other, as
/// their means would cancel. `None` for all other effects.
fn both_directions(search: &Search, ctx: &Context, own: &Chosen) -> Option<(String, Vec<f64>)> {
    if own.effect.kind() != EffectKind::AngleFriction {
        return None;
    }
    let unit = ctx.position_unit();
    let order = own.variant.psi.as_ref().filter(|p| p.name == "order");
    let (name, parts) = order.map_or(("turn", 1.0), |_| ("period", own.psi));
    let length = TAU / parts / radians(&unit)?;
    let angle = values(search, &search.problem.plain, ctx.position.as_ref()?);
    let speed = values(search, &search.problem.plain, ctx.velocity.as_ref()?);
    let place = |(x, v): (&f64, &f64)| {
        let within = x.rem_euclid(length);
        if *v < 0.0 {
            within - length
        } else {
            within
        }
    };
    let label = format!("angle in a {name}, {unit}; below 0: backward");
    Some((label, angle.iter().zip(&speed).map(place).collect()))
}

/// The slope of the prediction, where all of it is late: what is late is off by the delay times
/// this slope. `None` for all other forms.
fn slope(search: &Search, own: &Chosen, rest: &Fitted) -> Option<(String, Vec<f64>)> {
    let (Build::SwapAll(_) | Build::Through(_)) = (own.variant.build)(own.psi) else {
        return None;
    };
    let view = search.problem.view(&rest.model.replaced).ok()?;
    let text = format!("deriv({}, 2)", declared::prediction_expression(rest));
    let x = values(search, &view, &text);
    let label = format!(
        "rate of change of the prediction, {}/s",
        search.spec.roles.target.unit
    );
    (!x.is_empty()).then_some((label, x))
}

/// Fitted rows with one phase: those of each sequence where every sequence has coefficients of its
/// own, else all.
fn runs(search: &Search, own: &Chosen) -> Vec<Range<usize>> {
    if own.variant.is_local(own.psi) {
        each_run(search)
    } else {
        std::iter::once(0..search.problem.y.len()).collect()
    }
}

/// Fitted rows of each run.
fn each_run(search: &Search) -> Vec<Range<usize>> {
    let problem = &search.problem;
    let blocks = problem.runs();
    let rows = blocks.iter().map(|run| {
        let of_run = &problem.blocks[run.clone()];
        of_run[0].range.start..of_run[of_run.len() - 1].range.end
    });
    rows.collect()
}

/// Phase of the part of the residual that is made of a sine and a cosine.
fn rise(sine: &[f64], cosine: &[f64], part: &[f64]) -> f64 {
    let (ss, sc, cc) = (dot(sine, sine), dot(sine, cosine), dot(cosine, cosine));
    let (s, c) = (dot(sine, part), dot(cosine, part));
    // By Cramer's rule, without the determinant, which is positive.
    (ss * c - sc * s).atan2(cc * s - sc * c)
}
