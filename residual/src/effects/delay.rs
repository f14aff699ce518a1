//! A delay: of the command, or of the target against all inputs.

use super::{Build, Context, Effect, EffectKind, Estimate, Found, Psi, Remedy, Setting, Variant};
use std::collections::BTreeSet;

/// Rows up to which a delay is looked for in any data.
const MOST_ROWS: f64 = 32.0;

/// Longest delay, over the time in which the load changes: about half a period of its motion. Later the load looks like an earlier one.
const LONGEST: f64 = 3.0;

/// Factor between values of a delay beyond [`MOST_ROWS`].
const FURTHER: f64 = 1.27;

pub(crate) struct Delay;

impl Effect for Delay {
    fn kind(&self) -> EffectKind {
        EffectKind::Delay
    }
    fn meaning(&self) -> &'static str {
        "delay: the target follows the command after a fixed time (negative: the time stamps of the target are late)"
    }
    fn experiment(&self) -> &'static str {
        "sweep the command up to half the sampling rate: a delay's phase grows in proportion to the frequency, without limit"
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
        e.outside(
            "delay",
            -ctx.dt,
            f64::INFINITY,
            "the target would be ahead of its cause; look at the time stamps of the logs",
        )
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let names = ctx.declared_columns();
        // Far below a row: a small delay shows through the slope of the command over many rows.
        let steps = [
            0.02, 0.05, 0.12, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0,
            13.0, 16.0, 20.0, 26.0, MOST_ROWS,
        ];
        // Rows may be much closer than the motion is fast: then a delay of many rows still shows what it is.
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
        let psi = || Psi {
            name: "delay",
            unit: "s".into(),
            grid: grid.clone(),
            refine: true,
            resolution: None,
        };
        let mut out = Vec::new();
        if names.iter().any(|n| n == "command") {
            out.push(Variant::profiled("of the command", psi(), |s| {
                Build::Swap(vec![("command".into(), format!("delay(command, {s})"))])
            }));
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

/// Every column that terms use, those of the catalogue included. Columns that terms use by their names in the log are no roles.
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

#[cfg(test)]
mod tests {
    use super::Effect;
    use crate::{analyse, spec::Spec, stats::Rng, Data};
    use std::collections::VecDeque;

    /// The acceleration is no role: the terms use it by its name in the log.
    #[test]
    fn of_the_target_delays_columns_that_are_no_roles() {
        let (runs, rows, dt, late) = (5, 1500, 0.02, 0.04);
        let mut rng = Rng::new(7);
        let at = |i: usize, shift: f64| {
            (
                (i % rows) as f64 * dt - shift,
                1.0 + 0.1 * (i / rows) as f64,
            )
        };
        let velocity = |(t, w): (f64, f64)| (2.1 * w * t).sin() + 0.5 * (5.3 * w * t).cos();
        let acc =
            |(t, w): (f64, f64)| 2.1 * w * (2.1 * w * t).cos() - 2.65 * w * (5.3 * w * t).sin();
        let all = 0..runs * rows;
        let target: Vec<f64> = all
            .clone()
            .map(|i| 0.4 * acc(at(i, late)) + 0.3 * velocity(at(i, late)) + 0.02 * rng.normal())
            .collect();
        let columns = [
            ("target", target),
            (
                "velocity",
                all.clone().map(|i| velocity(at(i, 0.0))).collect(),
            ),
            ("acc", all.clone().map(|i| acc(at(i, 0.0))).collect()),
        ];
        let time = all.map(|i| at(i, 0.0).0).collect();
        let data = Data::from_columns(time, columns)
            .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
            .build()
            .expect("the columns are whole");
        let model = Spec::parse(
            r#"
            roles.time = { column = "t", unit = "s" }
            roles.target = { column = "y", unit = "N" }
            roles.velocity = { column = "v", unit = "rad/s" }
            [[terms]]
            name = "inertia"
            expr = "acc"
            [[terms]]
            name = "damping"
            expr = "velocity"
        "#,
        );
        let report = analyse(&model.expect("the model is right"), data, &mut ()).expect("it runs");
        let found: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(found.first(), Some(&"delay"), "{}", report.markdown());
        let [low, high] = report.effects[0].ci["delay"];
        assert!(low < late && late < high, "{low} {high}");
    }

    #[test]
    fn is_named() {
        let mut line = VecDeque::new();
        crate::effects::testbench::names("delay", move |s| {
            if s.first {
                line.clear();
            }
            line.push_back(s.command);
            if line.len() > 5 {
                line.pop_front();
            }
            line[0] - s.command
        });
    }

    /// Last value of the grid for a command with this angular frequency, in rows 0.02 s apart.
    fn longest(w: f64) -> f64 {
        let command: Vec<f64> = (0..4000).map(|i| (w * 0.02 * i as f64).sin()).collect();
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    command = { column = \"c\" }\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n";
        let columns = [("target", command.clone()), ("command", command)];
        let mut out = 0.0;
        crate::effects::testbench::knowing(spec, &columns, 2000, |ctx| {
            let grid = super::Delay.variants(ctx)[0]
                .psi
                .as_ref()
                .unwrap()
                .grid
                .clone();
            assert!(grid.windows(2).all(|g| g[0] < g[1]));
            assert_eq!(grid[0], -grid[grid.len() - 1]);
            out = grid[grid.len() - 1];
        });
        out
    }

    /// Rows may be close beside the motion: a delay of many rows is looked for then, and no lag takes its place.
    #[test]
    fn the_longest_delay_goes_with_the_motion() {
        assert!((longest(8.0) - 0.64).abs() < 1e-9, "{}", longest(8.0));
        assert!((longest(1.0) - 3.0).abs() < 0.05, "{}", longest(1.0));
        // An eighth of the run at most.
        assert!((longest(0.1) - 5.0).abs() < 0.05, "{}", longest(0.1));
    }
}
