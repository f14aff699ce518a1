//! A wrong scale of the declared model.

use super::{
    Build, Context, Effect, EffectKind, Estimate, Found, Lookalike, Piece, Psi, Remedy, Variant,
};
use residual_columns::stats::quantile_sorted;

pub struct Gain;

/// Values at which an error that grows with a variable may be zero, over its usual range and as far
/// again on both sides: then the error at one end of the range is at least twice that at the other.
const ZEROS: usize = 16;

/// Quantiles of the usual range of a variable.
const USUAL: [f64; 2] = [0.05, 0.95];

/// Quantiles of the load from which on a slope may be another one.
const KINKS: [f64; 7] = [0.26, 0.32, 0.38, 0.44, 0.5, 0.56, 0.62];

/// Least share of the rows with the first slope.
const FIRST_SLOPE: f64 = 0.25;

/// Standard errors by which a curve or a span drift must predict worse than a gain. A gain is the
/// simpler explanation; with more of them most gains of a third of the noise would have no name of
/// their own.
const EXCLUDED_FROM: f64 = 0.5;

/// An error of gain that grows with `with`, by its zero; `None` if the variable does not vary.
fn growing(ctx: &Context, with: &str) -> Option<Variant> {
    ctx.range(with)?;
    let values = sorted(ctx, with);
    let [low, high] = USUAL.map(|q| quantile_sorted(&values, q));
    let (from, step) = (low - (high - low), 3.0 * (high - low) / ZEROS as f64);
    let load = ctx.load.clone();
    let text = with.to_string();
    let psi = at((0..=ZEROS).map(|i| from + i as f64 * step).collect());
    Some(Variant::profiled("", psi, move |zero| {
        let grows = format!("({text} - {zero}) * {load}");
        Build::Add(vec![Piece::new("gain_error", "1", grows)])
    }))
}

/// An error of gain from a size of the load on, on the side on which most of the load is; `None` if
/// the load does not vary, or is least on so many rows that the rest of them is all there is.
fn from_a_load_on(ctx: &Context) -> Option<Variant> {
    ctx.range(&ctx.load)?;
    let load = sorted(ctx, &ctx.load);
    let side = if quantile_sorted(&load, 0.5) < 0.0 {
        -1.0
    } else {
        1.0
    };
    let size = format!("({side} * {})", ctx.load);
    let values = sorted(ctx, &size);
    let first_slope = |at: &f64| {
        let below = values.partition_point(|v| v < at);
        below as f64 >= FIRST_SLOPE * values.len() as f64
    };
    let quantiles = KINKS.iter().map(|q| quantile_sorted(&values, *q));
    let mut grid: Vec<f64> = quantiles.filter(first_slope).collect();
    grid.dedup();
    if grid.is_empty() {
        return None;
    }
    Some(Variant::profiled("", at(grid), move |at| {
        let above = format!("max(0, {size} - {at})");
        Build::Add(vec![Piece::new("gain_error", "1", above)])
    }))
}

/// The values of an expression, ascending.
fn sorted(ctx: &Context, expr: &str) -> Vec<f64> {
    let mut values = ctx.values(expr);
    values.sort_by(f64::total_cmp);
    values
}

/// A parameter with values to be tried as they are.
fn at(grid: Vec<f64>) -> Psi {
    Psi::new("at", "", grid).given()
}

impl Effect for Gain {
    fn kind(&self) -> EffectKind {
        EffectKind::Gain
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Gain((found.get)("gain_error"))]
    }
    /// A gain is the same at all loads and temperatures; the data may show few of these.
    fn lookalikes(&self, ctx: &Context) -> Vec<Lookalike> {
        let temperature = ctx.spec.roles.temperature.as_ref();
        // A characteristic through zero may be the same for both signs of the load.
        let size = match ctx.range(&ctx.load) {
            Some((low, high)) if low < 0.0 && high > 0.0 => format!("abs({})", ctx.load),
            _ => ctx.load.clone(),
        };
        let forms = [
            (EffectKind::Quadratic, growing(ctx, &size)),
            (EffectKind::Kink, from_a_load_on(ctx)),
            (
                EffectKind::DriftTemperature,
                temperature.and_then(|_| growing(ctx, "temperature")),
            ),
        ];
        let present = |(kind, form): (EffectKind, Option<Variant>)| {
            Some(Lookalike {
                kind,
                form: form?,
                excluded_from: EXCLUDED_FROM,
                though_refused: false,
            })
        };
        forms.into_iter().filter_map(present).collect()
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        let why = "the target would not follow the prediction at all";
        e.outside("gain_error", -1.0, f64::INFINITY, why)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        // A prediction whose coefficients are all fitted has no gain error.
        if ctx.range(&ctx.load).is_none() || !ctx.scale_is_declared() {
            return vec![];
        }
        vec![Variant::linear(
            "of the declared prediction",
            vec![Piece::new("gain_error", "1", ctx.load.clone())],
        )]
    }
}
