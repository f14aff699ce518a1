//! Saturation: a limit of the command or the prediction.

use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant};
use residual_columns::stats::quantile_sorted;

pub struct Saturation;

/// Share of the load that can be lost beyond a limit.
const SHARE_LOST: (f64, f64) = (0.0, 1.1);

impl Effect for Saturation {
    fn kind(&self) -> EffectKind {
        EffectKind::Saturation
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        let why = "beyond a limit part of the load, or all of it, is lost, and nothing is added";
        let (low, high) = SHARE_LOST;
        e.outside("share_lost", low, high, why)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        let by_command = ctx.declared_columns().iter().any(|d| d == "command");
        if by_command {
            out.extend(of_the_command(ctx));
        }
        out.extend(of_the_reading(ctx));
        // A reading is limited, whatever else is declared beside the command.
        if !by_command || ctx.spec.terms.len() > 1 {
            out.extend(of_the_prediction(ctx));
        }
        out
    }
}

/// Quantiles of the command at which a limit is looked for; the last ones for a limit that is
/// seldom reached.
const QUANTILES: [f64; 17] = [
    0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.84, 0.88, 0.91, 0.94, 0.96, 0.98, 0.99, 0.994, 0.997,
    0.999,
];

fn limit(name: &'static str, unit: &str, grid: Vec<f64>) -> Psi {
    Psi::new(name, unit, grid)
}

/// A column in the place of the command.
fn command(text: String) -> Build {
    Build::Swap(vec![("command".into(), text)])
}

/// Limits of the command above, below, and both ways alike.
fn of_the_command(ctx: &Context) -> Vec<Variant> {
    let mut out = Vec::new();
    let mut v = ctx.values("command");
    v.sort_by(f64::total_cmp);
    let unit = ctx.spec.roles.unit("command");
    let mut upper: Vec<f64> = QUANTILES.iter().map(|q| quantile_sorted(&v, *q)).collect();
    upper.dedup();
    if upper.len() > 2 {
        let psi = limit("upper_limit", &unit, upper);
        out.push(Variant::profiled("of the command, above", psi, |c| {
            command(format!("min(command, {c})"))
        }));
    }
    let mut lower: Vec<f64> = QUANTILES
        .iter()
        .rev()
        .map(|q| quantile_sorted(&v, 1.0 - *q))
        .collect();
    lower.dedup();
    if lower.len() > 2 {
        let psi = limit("lower_limit", &unit, lower);
        out.push(Variant::profiled("of the command, below", psi, |c| {
            command(format!("max(command, {c})"))
        }));
    }
    let (lo, hi) = (quantile_sorted(&v, 0.02), quantile_sorted(&v, 0.98));
    if lo < 0.0 && hi > 0.0 {
        let top = hi.max(-lo);
        let grid = (0..14)
            .map(|i| top * (0.35 + 0.05 * f64::from(i)))
            .collect();
        let psi = limit("limit", &unit, grid);
        out.push(Variant::profiled("of the command, both ways", psi, |c| {
            command(format!("clip(command, {}, {c})", -c))
        }));
    }
    out
}

/// Limits at which the target visibly stops: an amplifier or a converter at the end of its range.
/// The limit is read off, and nothing is fitted.
fn of_the_reading(ctx: &Context) -> Vec<Variant> {
    let Some(load) = &ctx.problem.unlimited else {
        return vec![];
    };
    let stopped = |label, name, at: Option<f64>, lost: &dyn Fn(f64) -> String| {
        let text = lost(at?);
        let psi = Psi {
            refine: false,
            ..limit(name, ctx.unit(), vec![at?])
        };
        let build = move |_| Build::Known(vec![Piece::new("lost", "1", text.clone())]);
        Some(Variant::profiled(label, psi, build).observed())
    };
    let [least, greatest] = ctx.problem.stops;
    let above = |at| format!("min(0, {at} - {load})");
    let below = |at| format!("max(0, {at} - {load})");
    let all = [
        stopped("of the reading, above", "upper_limit", greatest, &above),
        stopped("of the reading, below", "lower_limit", least, &below),
    ];
    all.into_iter().flatten().collect()
}

/// An upper limit of the prediction: of the reading, as far as the declared model goes.
fn of_the_prediction(ctx: &Context) -> Vec<Variant> {
    let Some((lo, hi)) = ctx.range(&ctx.load) else {
        return vec![];
    };
    let mut grid: Vec<f64> = (0..14)
        .map(|i| lo + (hi - lo) * (0.4 + 0.042 * f64::from(i)))
        .collect();
    // Limits that are seldom reached.
    let mut v = ctx.values(&ctx.load);
    v.sort_by(f64::total_cmp);
    grid.extend([0.98, 0.99, 0.995, 0.998].map(|q| quantile_sorted(&v, q)));
    grid.sort_by(f64::total_cmp);
    grid.dedup();
    let load = ctx.load.clone();
    let psi = limit("upper_limit", ctx.unit(), grid);
    vec![Variant::profiled("of the prediction", psi, move |c| {
        let lost = format!("min(0, {c} - {load})");
        Build::Add(vec![Piece::new("share_lost", "1", lost)])
    })
    .between(&[SHARE_LOST])]
}
