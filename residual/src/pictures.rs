//! What the residual with and without an effect is drawn against: the variable that shows the effect.

use crate::declared;
use crate::effects::{Build, Context, EffectKind, Piece};
use crate::linalg::dot;
use crate::model::{Chosen, Fitted};
use crate::parallel;
use crate::problem::View;
use crate::report::{Plot, WITHOUT};
use crate::search::Search;
use crate::units::radians;
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

/// The residual before and after over time, one run after another: over the time in the run, what differs from run to run would
/// cancel.
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

/// Of the variables that can expose an effect the one over which the means of its `part` of the residual are largest. Time
/// where none of them varies.
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

/// A sine over its own period, from the zero at which it begins to rise: in the data it repeats too often to be seen. `None`
/// for all that does not repeat. The label, and the place in the period of each row.
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

/// The angle within a turn, or within a period of the friction's order, where friction depends on it: the turns lie on top of
/// each other, and the two directions of motion beside each other, as their means would cancel. `None` for all other effects.
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

/// The slope of the prediction, where all of it is late: what is late is off by the delay times this slope. `None` for all
/// other forms.
fn slope(search: &Search, own: &Chosen, rest: &Fitted) -> Option<(String, Vec<f64>)> {
    let Build::SwapAll(_) = (own.variant.build)(own.psi) else {
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

/// Fitted rows with one phase: those of each sequence where every sequence has coefficients of its own, else all.
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

#[cfg(test)]
mod tests {
    use crate::effects::testbench::{simulate, Excitation, Row};
    use crate::report::{Effect, Report};
    use crate::stats::Rng;

    fn effect<'a>(report: &'a Report, name: &str) -> &'a Effect {
        let found = report.effects.iter().find(|e| e.name == name);
        found.unwrap_or_else(|| panic!("no {name}\n{}", report.markdown()))
    }

    /// Half the height of the line of means before and after.
    fn heights(effect: &Effect) -> [f64; 2] {
        [1, 2].map(|column| {
            let means = effect.plot.means.iter().map(|m| m[column]);
            let (lo, hi) = means.fold((f64::MAX, f64::MIN), |(lo, hi), m| (lo.min(m), hi.max(m)));
            0.5 * (hi - lo)
        })
    }

    /// Each run has a phase of its own; the picture has one.
    #[test]
    fn a_tone_is_drawn_over_its_period() {
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            0.3 * (std::f64::consts::TAU * 3.7 * s.elapsed + f64::from(s.group)).sin()
        });
        let tone = effect(&report, "tone");
        assert_eq!(tone.plot.against, "time within one period, s");
        let [before, after] = heights(tone);
        assert!(
            (before - 0.3).abs() < 0.05 && after < 0.05,
            "{before} {after}"
        );
        // It begins to rise at the left.
        let first = tone.plot.means[1];
        assert!(first[0] < 0.04 && first[1] > 0.02, "{first:?}");
    }

    #[test]
    fn a_ripple_of_many_periods_is_drawn_over_one() {
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            0.3 * (7.0 * s.angle).sin()
        });
        let ripple = effect(&report, "periodic_angle");
        assert!(
            ripple.plot.against.starts_with("angle within one period, "),
            "{}",
            ripple.plot.against
        );
        let [before, after] = heights(ripple);
        assert!(
            (before - 0.3).abs() < 0.05 && after < 0.05,
            "{before} {after}"
        );
    }

    /// The zero of each run wanders in its own way, so the means over the time in the run cancel.
    #[test]
    fn what_shows_in_time_alone_is_drawn_run_by_run() {
        let mut rng = Rng::new(5);
        let mut zero = 0.0;
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            if s.first {
                zero = rng.normal();
            }
            // Forgets within some 15 s.
            zero += 0.05 * rng.normal() - 0.0013 * zero;
            zero
        });
        let plot = report.plot_unknown.as_ref();
        let plot = plot.unwrap_or_else(|| panic!("{}", report.markdown()));
        assert_eq!(plot.against, "time, one run after another, s");
        let means = || plot.means.iter().map(|m| m[2]);
        let (lo, hi) = (
            means().fold(f64::MAX, f64::min),
            means().fold(f64::MIN, f64::max),
        );
        assert!(hi - lo > 2.0 * plot.rms[1], "{lo} {hi} {:?}", plot.rms);
        let last = plot.x.iter().copied().fold(0.0, f64::max);
        assert!(
            plot.x.windows(2).all(|w| w[0] <= w[1]) && last > 300.0,
            "{last}"
        );
    }

    /// Half the sum and half the difference of the means in the two directions, at a place of the angle.
    fn directions(
        effect: &Effect,
        length: f64,
        column: usize,
        within: &dyn Fn(f64) -> bool,
    ) -> [f64; 2] {
        let mean = |backward: bool| {
            let own: Vec<f64> = effect
                .plot
                .means
                .iter()
                .filter(|m| (m[0] < 0.0) == backward && within(m[0].rem_euclid(length)))
                .map(|m| m[column])
                .collect();
            assert!(own.len() > 1, "{:?}", effect.plot.means);
            own.iter().sum::<f64>() / own.len() as f64
        };
        let (forward, backward) = (mean(false), mean(true));
        [0.5 * (forward + backward), 0.5 * (forward - backward)]
    }

    /// Over all turns, and over both directions together, the means would cancel.
    #[test]
    fn friction_that_depends_on_the_angle_is_drawn_in_a_turn_for_each_direction() {
        use std::f64::consts::TAU;
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            let inside = (s.angle - 1.0).rem_euclid(TAU) < 1.2;
            if inside {
                -0.5 * s.velocity.signum()
            } else {
                0.0
            }
        });
        let friction = effect(&report, "angle_friction");
        let label = &friction.plot.against;
        assert!(label.starts_with("angle in a turn, rad;"), "{label}");
        let x = &friction.plot.x;
        assert!(x.iter().all(|x| (-TAU..TAU).contains(x)), "{x:?}");
        let inside = |x: f64| (1.1..2.1).contains(&x);
        let [even, odd] = directions(friction, TAU, 1, &inside);
        assert!(even.abs() < 0.1 && (odd + 0.5).abs() < 0.1, "{even} {odd}");
        let [_, odd] = directions(friction, TAU, 2, &inside);
        assert!(odd.abs() < 0.1, "{odd}");
        let [_, odd] = directions(friction, TAU, 1, &|x| (3.0..5.5).contains(&x));
        assert!(odd.abs() < 0.1, "{odd}");
    }

    #[test]
    fn a_ripple_of_friction_is_drawn_over_one_period() {
        use std::f64::consts::TAU;
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            -(0.5 + 0.3 * (3.0 * s.angle).sin()) * s.velocity.signum()
        });
        let friction = effect(&report, "angle_friction");
        let length = TAU / 3.0;
        let label = &friction.plot.against;
        assert!(label.starts_with("angle in a period, rad;"), "{label}");
        let x = &friction.plot.x;
        assert!(x.iter().all(|x| (-length..length).contains(x)), "{x:?}");
        let [_, odd] = directions(friction, length, 1, &|x| (0.3..0.8).contains(&x));
        assert!((odd + 0.28).abs() < 0.1, "{odd}");
    }

    /// A loop of Dahl's model over the angle.
    fn loop_of_angle(width: f64) -> impl FnMut(&Row) -> f64 {
        let (mut z, mut last) = (0.0, 0.0);
        move |s| {
            if s.first {
                (z, last) = (0.0, s.angle);
            }
            let dx = s.angle - last;
            last = s.angle;
            let sign = if dx >= 0.0 { 1.0 } else { -1.0 };
            z = sign + (z - sign) * (-dx.abs() / width).exp();
            0.5 * z
        }
    }

    #[test]
    fn a_loop_of_position_is_drawn_over_the_position() {
        let report = simulate(&Excitation::default(), 1.0, &mut loop_of_angle(3.0));
        let hysteresis = effect(&report, "hysteresis");
        assert!(hysteresis.form.contains("position"), "{}", hysteresis.form);
        assert_eq!(hysteresis.plot.against, "angle, rad");
    }

    #[test]
    fn an_elastic_turn_is_drawn_over_the_position() {
        let report = simulate(&Excitation::default(), 1.0, &mut loop_of_angle(0.1));
        let presliding = effect(&report, "presliding");
        assert_eq!(presliding.form, "elastic turn");
        assert_eq!(presliding.plot.against, "angle, rad");
    }
}
