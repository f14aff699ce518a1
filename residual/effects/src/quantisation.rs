//! Steps: a command or a reading in whole units.

use super::spectrum::{proposals, Look};
use super::{Build, Context, Effect, EffectKind, Estimate, Param, Piece, Psi, Variant};
use residual_columns::stats;

pub struct Quantisation;

/// Fewest steps in the range of a signal that make it a quantised one.
const FEWEST_STEPS: f64 = 3.0;

/// Fewest steps in the range of the command that are tried: with fewer, any curve in the command
/// looks like steps.
const FEWEST_LEVELS: f64 = 3.0;

/// Up to so many steps in the range of the command all are tried.
const COARSE: f64 = 24.0;

/// Most values that are tried up to there.
/// Raised from 150, so that they lie closer together.
const MOST_COARSE: f64 = 240.0;

/// Steps in the range of the command that are looked for in the spectrum, in two bands: converters
/// of up to twelve bits.
const FINE: [(f64, f64); 2] = [(16.0, 160.0), (160.0, 4200.0)];

/// Most rows, and most values to either side of a peak, for the phase of a sine.
/// Lowered from 20 000 when fine steps came to be looked for at lines of the spectrum only.
const MOST_ROWS: usize = 5_000;
const MOST_PHASES: f64 = 100.0;

impl Effect for Quantisation {
    fn kind(&self) -> EffectKind {
        EffectKind::Quantisation
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let signal = if e.label == "of the target" {
            &ctx.load
        } else {
            "command"
        };
        let most = ctx.width(signal) / FEWEST_STEPS;
        let why = "a step of the size of the signal is no quantisation";
        e.outside("step", 0.0, most, why)
    }
    fn axes(&self, form: &Variant, psi: f64, ctx: &Context) -> Vec<String> {
        // The same saw tooth in every step.
        let step = form.shown(psi);
        let (x, f) = match form.label.as_str() {
            "of the target" => (ctx.load.as_str(), "round"),
            "of the command, rounded" => ("command", "round"),
            _ => ("command", "floor"),
        };
        vec![format!("{x} - {f}({x} / {step}) * {step}")]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        if ctx.declared_columns().iter().any(|d| d == "command") {
            if let Some((lo, hi)) = ctx.range("command") {
                let steps = Steps::new(ctx, lo, hi);
                for (label, f) in [
                    ("of the command, rounded", "round"),
                    ("of the command, cut off", "floor"),
                ] {
                    // By steps per unit: all of them are equally far apart in the data.
                    let psi = Psi::new(
                        "step",
                        ctx.spec.roles.unit("command"),
                        steps.per_unit.clone(),
                    )
                    .within(steps.resolution);
                    let form = Variant::profiled(label, psi, move |n| {
                        Build::Swap(vec![(
                            "command".into(),
                            format!("{f}(command * {n}) / {n}"),
                        )])
                    });
                    out.push(form.with(step).shown_as(|per_unit| 1.0 / per_unit));
                }
            }
        }
        if let Some(q) = stats::quantum(&ctx.problem.y) {
            let load = ctx.load.clone();
            let unit = ctx.unit().to_string();
            out.push(Variant::profiled(
                "of the target",
                Psi::new("step", unit, vec![q]).given(),
                move |q| {
                    Build::Add(vec![Piece::new(
                        "share",
                        "1",
                        format!("round({load} / {q}) * {q} - {load}"),
                    )])
                },
            ));
        }
        out
    }
}

fn step(per_unit: f64, _: &[f64], _: &[Piece], psi: &Psi) -> Vec<Param> {
    vec![psi.param(1.0 / per_unit)]
}

/// Steps per unit of the command that are worth trying.
struct Steps {
    per_unit: Vec<f64>,
    /// How far the best value may be off one of them.
    resolution: f64,
}

impl Steps {
    /// Steps for a command that is mostly between `lo` and `hi`: all that are coarse, and of the
    /// fine ones those that show in the spectrum of the residual over the command, as what a step
    /// cuts off repeats with it.
    fn new(ctx: &Context, lo: f64, hi: f64) -> Steps {
        let span = hi - lo;
        // Steps are counted from zero, so that far from it a small error of the step puts all edges
        // off.
        let far = lo.abs().max(hi.abs()).max(span);
        let resolution = 0.2 / far;
        let count = ((COARSE - FEWEST_LEVELS) / span / resolution).min(MOST_COARSE);
        let count = count as usize;
        let all = |k: usize| FEWEST_LEVELS + (COARSE - FEWEST_LEVELS) * k as f64 / count as f64;
        let mut per_unit: Vec<f64> = (0..=count).map(|k| all(k) / span).collect();
        let command = ctx.values("command");
        let own = ctx.step_of("command");
        let finest = if own > 0.0 { 0.5 / own } else { f64::INFINITY };
        for (low, high) in FINE {
            let look = Look {
                lowest: low / span,
                highest: (high / span).min(finest),
                coherent: true,
                lines: true,
            };
            for peak in proposals(ctx, &command, &[], &look) {
                per_unit.push(in_phase(
                    ctx.residual,
                    &command,
                    peak,
                    0.5 / span,
                    0.1 / far,
                ));
            }
        }
        per_unit.sort_by(f64::total_cmp);
        per_unit.dedup_by(|a, b| *a - *b < 0.2 * resolution);
        Steps {
            per_unit,
            resolution,
        }
    }
}

/// The frequency within `reach` of `peak` at which a sine over `u` with its zero at zero explains
/// most of `r`.
fn in_phase(r: &[f64], u: &[f64], peak: f64, reach: f64, step: f64) -> f64 {
    let every = r.len() / MOST_ROWS + 1;
    let steps = (reach / step).min(MOST_PHASES) as i32;
    let power = |f: f64| {
        let w = std::f64::consts::TAU * f;
        let rows = r.iter().zip(u).step_by(every);
        rows.map(|(r, u)| r * (w * u).sin()).sum::<f64>().abs()
    };
    (-steps..=steps)
        .map(|k| peak + f64::from(k) * step)
        .map(|f| (f, power(f)))
        .fold(
            (peak, 0.0),
            |best, new| if new.1 > best.1 { new } else { best },
        )
        .0
}
