//! A wrong scale of the declared model.

use super::{
    Build, Context, Effect, EffectKind, Estimate, Found, Lookalike, Piece, Psi, Remedy, Variant,
};
use crate::stats::quantile_sorted;

pub(crate) struct Gain;

/// Values at which an error that grows with a variable may be zero, over its usual range and as far again on both sides: then the error
/// at one end of the range is at least twice that at the other.
const ZEROS: usize = 16;

/// Quantiles of the usual range of a variable.
const USUAL: [f64; 2] = [0.05, 0.95];

/// Quantiles of the load from which on a slope may be another one, so that a quarter of the rows or more shows the first slope.
const KINKS: [f64; 7] = [0.26, 0.32, 0.38, 0.44, 0.5, 0.56, 0.62];

/// Standard errors by which a curve or a span drift must predict worse than a gain. A gain is the simpler explanation; with more of them
/// most gains of a third of the noise would have no name of their own.
const EXCLUDED_FROM: f64 = 0.5;

/// An error of gain that grows with `with`, by its zero; `None` if the variable does not vary.
fn growing(ctx: &Context, with: &str) -> Option<Variant> {
    ctx.range(with)?;
    let mut values = ctx.values(with);
    values.sort_by(f64::total_cmp);
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

/// An error of gain from a certain load on; `None` if the load does not vary.
fn from_a_load_on(ctx: &Context) -> Option<Variant> {
    ctx.range(&ctx.load)?;
    let mut values = ctx.values(&ctx.load);
    values.sort_by(f64::total_cmp);
    let load = ctx.load.clone();
    let psi = at(KINKS.map(|q| quantile_sorted(&values, q)).to_vec());
    Some(Variant::profiled("", psi, move |at| {
        let above = format!("max(0, {load} - {at})");
        Build::Add(vec![Piece::new("gain_error", "1", above)])
    }))
}

/// A parameter with values to be tried as they are.
fn at(grid: Vec<f64>) -> Psi {
    Psi {
        name: "at",
        unit: String::new(),
        grid,
        refine: false,
        resolution: None,
    }
}

impl Effect for Gain {
    fn kind(&self) -> EffectKind {
        EffectKind::Gain
    }
    fn meaning(&self) -> &'static str {
        "gain: the declared prediction is too small or too large by a constant factor"
    }
    fn experiment(&self) -> &'static str {
        "hold several known loads at rest: the error grows in proportion to the load"
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Gain((found.get)("gain_error"))]
    }
    /// A gain is the same at all loads and temperatures; the data may show few of these.
    fn lookalikes(&self, ctx: &Context) -> Vec<Lookalike> {
        let temperature = ctx.spec.roles.temperature.as_ref();
        let forms = [
            (EffectKind::Quadratic, growing(ctx, &ctx.load)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::knowing;

    /// What is fitted cannot have a wrong scale.
    #[test]
    fn only_a_declared_scale_has_a_gain() {
        let rows = 200;
        let command: Vec<f64> = (0..rows).map(|i| (0.1 * i as f64).sin()).collect();
        let target = command.iter().map(|c| 2.0 * c + 0.5).collect::<Vec<_>>();
        let forms = |terms: &str| {
            let spec = format!(
                "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
                 command = {{ column = \"c\", unit = \"N\" }}\n{terms}"
            );
            let columns = [("target", target.clone()), ("command", command.clone())];
            let mut count = 0;
            knowing(&spec, &columns, rows, |ctx| {
                count = Gain.variants(ctx).len()
            });
            count
        };
        let term = |expr: &str, fixed: &str| {
            format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\n{fixed}\n")
        };
        let fixed = term("command", "fixed = 1.9");
        assert_eq!(forms(&fixed), 1);
        assert_eq!(forms(&(fixed + &term("1", ""))), 1);
        let fitted = term("command", "");
        assert_eq!(forms(&fitted), 0);
        assert_eq!(forms(&(fitted + &term("1", "fixed = 0.4"))), 0);
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("gain", |s| 0.1 * s.command);
    }
}
