//! A delay: of the command, or of the target against all inputs.

use super::{Build, Context, Effect, EffectKind, Estimate, Found, Psi, Remedy, Setting, Variant};
use residual_columns::format::num;
use std::collections::BTreeSet;

/// Rows up to which a delay is looked for in any data.
const MOST_ROWS: f64 = 32.0;

/// Longest delay, over the time in which the load changes: about half a period of its motion. Later
/// the load looks like an earlier one.
const LONGEST: f64 = 3.0;

/// Factor between values of a delay beyond [`MOST_ROWS`].
const FURTHER: f64 = 1.27;

pub struct Delay;

impl Effect for Delay {
    fn kind(&self) -> EffectKind {
        EffectKind::Delay
    }
    fn against(&self, ctx: &Context) -> String {
        // The error of a late response is the delay times this slope.
        format!("deriv({}, 2)", ctx.load)
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::Delay)
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Delay((found.get)("delay"))]
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let ahead = "the target would be ahead of its cause; look at the time stamps of the logs";
        e.outside("delay", -ctx.dt, f64::INFINITY, ahead)
            .or_else(|| as_held(e.get("delay")?, ctx))
            .or_else(|| late_direction(e.get("delay")?, ctx))
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let names = ctx.declared_columns();
        // Far below a row: a small delay shows through the slope of the command over many rows.
        let steps = [
            0.02, 0.05, 0.12, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0,
            13.0, 16.0, 20.0, 26.0, MOST_ROWS,
        ];
        // Rows may be much closer than the motion is fast: then a delay of many rows still shows
        // what it is.
        let last = MOST_ROWS * ctx.dt;
        let longest = (LONGEST * ctx.changes_in(&ctx.load)).min(ctx.span / 8.0);
        let mut later = if longest > 1.2 * last {
            Context::grid_by_ratio(last, longest, FURTHER)
        } else {
            vec![last]
        };
        later.remove(0);
        let positive: Vec<f64> = steps.iter().map(|s| s * ctx.dt).chain(later).collect();
        let grid: Vec<f64> = positive
            .iter()
            .rev()
            .map(|s| -s)
            .chain(positive.iter().copied())
            .collect();
        let psi = || Psi::new("delay", "s", grid.clone());
        let mut out = Vec::new();
        if names.iter().any(|n| n == "command") {
            out.push(Variant::profiled("of the command", psi(), |s| {
                Build::Swap(vec![("command".into(), format!("delay(command, {s})"))])
            }));
            if ctx.is_stepped("command") {
                let label = "of the command, which is held between rows";
                out.push(Variant::profiled(label, psi(), |s| {
                    let late = format!("delay_held(command, {s})");
                    Build::Swap(vec![("command".into(), late)])
                }));
            }
        }
        if ctx.columns.iter().any(|n| n != "command") {
            // Everything: effects that are found later are as late.
            let all = inputs(ctx);
            out.push(Variant::profiled(
                "of the target against everything",
                psi(),
                move |s| {
                    Build::SwapAll(
                        all.iter()
                            .map(|n| (n.clone(), format!("delay({n}, {s})")))
                            .collect(),
                    )
                },
            ));
        }
        out
    }
}

/// Why a target that is late by so much is no effect: it holds its values for as long.
pub(super) fn as_held(late: f64, ctx: &Context) -> Option<String> {
    let of_values = ctx.problem.values_per_s;
    let rate = of_values.filter(|_| repeats(&ctx.problem.y))?;
    (late > 0.0 && late <= 1.0 / rate).then(|| {
        format!(
            "the target holds each of its values for {} s, which delays it as much",
            num(1.0 / rate)
        )
    })
}

/// Why a target that is ahead of a velocity by less than a row is no effect: the direction of a
/// motion shows where the velocity leaves its deadband, and the difference of two positions is that
/// of half a row before.
fn late_direction(late: f64, ctx: &Context) -> Option<String> {
    let moves = ctx.velocity.is_some() && ctx.deadband > 0.0;
    (moves && late < 0.0 && late > -ctx.dt).then(|| {
        format!(
            "the velocity is late by {} s, less than a row ({} s): its deadband and its difference make as much",
            num(-late),
            num(ctx.dt)
        )
    })
}

/// Share of the rows that repeat the value before from which they are fitted as they are.
const REPEATED: f64 = 0.1;

/// Whether rows that repeat a value are fitted.
fn repeats(y: &[f64]) -> bool {
    let repeated = y.windows(2).filter(|w| w[0] == w[1]).count();
    repeated as f64 >= REPEATED * y.len() as f64
}

/// Every column that terms use, those of the catalogue included. Columns that terms use by their
/// names in the log are no roles.
pub(super) fn inputs(ctx: &Context) -> BTreeSet<String> {
    let roles = &ctx.spec.roles;
    let used = ctx.declared_columns().into_iter();
    roles
        .all()
        .into_iter()
        .map(|(n, _)| n)
        .chain(used.chain(ctx.columns.iter().cloned()))
        .filter(|n| n != "time" && n != "target" && !roles.groups.contains_key(n))
        .collect()
}
