//! Elasticity in series: the cable stretches before it pulls.

use super::{
    Build, Context, Effect, EffectKind, Estimate, Form, Found, Lookalike, Nature, Piece, Psi,
    Remedy, Setting, Variant,
};

use super::gravity_angle::{angle_along, too_short, weights};
use residual_columns::format::num;
use residual_columns::units::radians;
use std::f64::consts::TAU;

/// Rows up to which a lag is looked for in any data.
const MOST_ROWS: f64 = 60.0;

/// Longest lag, over the time in which the load changes: of it a tenth of the load is left.
const LONGEST: f64 = 10.0;

/// Factor between values of a time constant.
const FURTHER: f64 = 1.61;

/// Time constants of a first-order lag that are tried, ascending.
pub(super) fn lags(ctx: &Context) -> Vec<f64> {
    // Rows may be much closer than the motion is fast.
    let rows = (MOST_ROWS * ctx.dt).min(ctx.span / 8.0);
    let motion = (LONGEST * ctx.changes_in(&ctx.load)).min(ctx.span / 4.0);
    Context::grid_by_ratio(0.03 * ctx.dt, rows.max(motion), FURTHER)
}

pub struct CableStretch;

/// Labels of the spring: over an arc on which a weight looks different, and over a shorter one.
const SPRING: &str = "spring";
const SHORT_SPRING: &str = "spring over a short arc";

/// Most turns over which a spring is wound within a run.
const MOST_TURNS: f64 = 10.0;

impl Effect for CableStretch {
    fn kind(&self) -> EffectKind {
        EffectKind::CableStretch
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::Delay)
    }
    /// Over a short arc a weight rises with the angle as the force of a spring does, and a joint
    /// has a weight more often than a spring.
    fn twin(&self, label: &str) -> Option<EffectKind> {
        (label == SHORT_SPRING).then_some(EffectKind::GravityAngle)
    }
    /// Over a longer arc noise may hide the curve of a weight.
    fn lookalikes(&self, ctx: &Context) -> Vec<Lookalike> {
        weights(ctx)
    }
    /// For a loop slower than the lag, a first-order lag is a delay of its time constant.
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        if found.form == Form::CommandLag {
            vec![Remedy::Delay((found.get)("time_constant"))]
        } else {
            vec![]
        }
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let longest = ctx.span;
        e.outside("time_constant", 0.0, longest, "longer than the longest run")
            .or_else(|| {
                e.get("stiffness")?;
                let turns = ctx.excursion("angle") * radians(&ctx.position_unit())? / TAU;
                (turns > MOST_TURNS).then(|| {
                    format!(
                        "the angle moves by {} turns within a run: no spring is wound so far",
                        num(turns)
                    )
                })
            })
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        // A lag is off by its time constant times the slope of the load, a spring by its stiffness
        // times the angle.
        match &ctx.position {
            Some(x) if form.label == SPRING || form.label == SHORT_SPRING => vec![x.clone()],
            _ => vec![format!("deriv({}, 2)", ctx.load)],
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        let declared = ctx.declared_columns();
        if declared.iter().any(|d| d == "command") {
            let grid = lags(ctx);
            let mut lag = |label: &str, function: &'static str| {
                let psi = Psi::new("time_constant", "s", grid.clone());
                let form = Variant::profiled(label, psi, move |tau| {
                    let late = format!("{function}(command, {tau})");
                    Build::Swap(vec![("command".into(), late)])
                });
                out.push(form.form(Form::CommandLag));
            };
            lag("lag of the command", "lowpass");
            if ctx.is_stepped("command") {
                let label = "lag of the command, which is held between rows";
                lag(label, "lowpass_held");
            }
        }
        if ctx.spec.roles.angle.is_some() {
            let angle = angle_along(ctx, "angle");
            let unit = ctx.per(&ctx.position_unit());
            let angles = ctx.angles();
            let arc = angles.iter().find(|(name, ..)| name == "angle");
            let label = match arc.and_then(too_short) {
                Some(_) => SHORT_SPRING,
                None => SPRING,
            };
            out.push(Variant::linear(
                label,
                vec![Piece::new("stiffness", unit, angle).being(Nature::Stiffness)],
            ));
        }
        out
    }
}
