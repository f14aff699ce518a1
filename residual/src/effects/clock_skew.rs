//! Clocks of command and target that run at different rates.

use super::delay::inputs;
use super::{Build, Context, Effect, EffectKind, Psi, Variant};

pub(crate) struct ClockSkew;

/// Constant lags that are tried up to the one that a skew reaches at the end of a run.
const CONSTANT_LAGS: i32 = 12;

impl Effect for ClockSkew {
    fn kind(&self) -> EffectKind {
        EffectKind::ClockSkew
    }
    fn meaning(&self) -> &'static str {
        "clock skew: the clocks of command and target run at different rates, so the lag between them grows along the run"
    }
    fn experiment(&self) -> &'static str {
        "repeat one sharp event at the start and at the end of a long run and compare the lag"
    }
    fn against(&self, ctx: &Context) -> String {
        // The lag grows with the time, and shows in proportion to the slope of the load.
        format!("elapsed * deriv({}, 2)", ctx.load)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let declared = ctx.declared_columns();
        if declared.is_empty() || ctx.span < 200.0 * ctx.dt {
            return vec![];
        }
        let one = ctx.dt / ctx.span;
        let mut half = Context::log_grid(0.03 * one, 60.0 * one, 20);
        half.retain(|r| *r < 0.05);
        let grid: Vec<f64> = half
            .iter()
            .rev()
            .map(|r| -r)
            .chain(half.iter().copied())
            .collect();
        let psi = || Psi {
            name: "skew",
            unit: "s/s".into(),
            grid: grid.clone(),
            refine: true,
            resolution: None,
        };
        let mut out = Vec::new();
        if ctx.columns.iter().any(|n| n != "command") {
            // All inputs, those of effects that were found or will be found as well.
            let all = inputs(ctx);
            out.push(Variant::profiled(
                "rate of the inputs' clock",
                psi(),
                move |r| {
                    let warp = |n: &String| (n.clone(), format!("warp({n}, {r})"));
                    Build::SwapAll(all.iter().map(warp).collect())
                },
            ));
        }
        if declared.iter().any(|n| n == "command") {
            // Drive and sensors have a clock each: the motion is logged by that of the target.
            out.push(Variant::profiled(
                "rate of the command's clock",
                psi(),
                |r| Build::Swap(vec![("command".into(), format!("warp(command, {r})"))]),
            ));
        }
        out
    }
    /// A lag that is the same all along the run, up to twice the one that the skew reaches.
    fn must_surpass(&self, form: &Variant, skew: f64, ctx: &Context) -> Option<Variant> {
        let build = (form.build)(skew);
        let (names, everywhere): (Vec<String>, _) = match build {
            Build::Swap(pairs) => (pairs.into_iter().map(|(n, _)| n).collect(), false),
            Build::SwapAll(pairs) => (pairs.into_iter().map(|(n, _)| n).collect(), true),
            _ => return None,
        };
        let end = skew * ctx.span;
        let psi = Psi {
            name: "delay",
            unit: "s".into(),
            grid: (-CONSTANT_LAGS..=2 * CONSTANT_LAGS)
                .map(|k| -end * f64::from(k) / f64::from(CONSTANT_LAGS))
                .collect(),
            refine: false,
            resolution: None,
        };
        Some(Variant::profiled("a constant delay", psi, move |lag| {
            let delay = |n: &String| (n.clone(), format!("delay({n}, {lag})"));
            let pairs = names.iter().map(delay).collect();
            if everywhere {
                Build::SwapAll(pairs)
            } else {
                Build::Swap(pairs)
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::{knowing, simulate, Excitation, Row};

    /// A target that is ahead of its cause all along the run, or behind it, is no matter of rates.
    #[test]
    fn a_constant_lag_is_no_skew() {
        for (lag, seed) in [(0.1, 1), (0.34, 2), (1.07, 3), (-0.9, 4)] {
            let excitation = Excitation {
                seed,
                ..Excitation::default()
            };
            let ahead = |s: &Row| s.command_at(s.elapsed + lag) - s.command;
            let report = simulate(&excitation, 1.0, &mut { ahead });
            let skew = |e: &crate::report::Effect| e.name.as_str() == "clock_skew";
            assert!(!report.effects.iter().any(skew), "{}", report.markdown());
        }
    }

    /// Effects that were found use further inputs, which have the same clock.
    #[test]
    fn the_clock_of_the_inputs_is_that_of_all_of_them() {
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..1200).map(|i| f(0.02 * i as f64)).collect()
        };
        let columns = [
            ("target", of(&|t| (0.7 * t).sin())),
            ("command", of(&|t| (0.7 * t).cos())),
            ("velocity", of(&|t| (0.9 * t).cos())),
            ("angle", of(&|t| (0.9 * t).sin())),
        ];
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                    command = { column = \"c\", unit = \"N\" }\nvelocity = { column = \"v\", unit = \"rad/s\" }\n\
                    angle = { column = \"a\", unit = \"rad\" }\n\
                    [[terms]]\nname = \"a\"\nexpr = \"command\"\n[[terms]]\nname = \"b\"\nexpr = \"velocity\"\n";
        knowing(spec, &columns, 600, |ctx| {
            let forms = ClockSkew.variants(ctx);
            let all = forms
                .iter()
                .find(|f| f.label == "rate of the inputs' clock");
            let Build::SwapAll(pairs) = (all.unwrap().build)(0.001) else {
                panic!("it acts on what is found later as well");
            };
            let names: Vec<&str> = pairs.iter().map(|(n, _)| n.as_str()).collect();
            assert_eq!(names, ["angle", "command", "velocity"]);
        });
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("clock_skew", |s| {
            s.command_at(s.elapsed * 1.004) - s.command
        });
    }

    /// The motion, and the friction with it, has the clock of the target.
    #[test]
    fn is_named_where_the_command_alone_has_another_clock() {
        let excitation = Excitation {
            declare_coulomb: true,
            ..Excitation::default()
        };
        let skewed = |s: &Row| s.command_at(s.elapsed * 1.004) - s.command;
        let report = simulate(&excitation, 1.0, &mut { skewed });
        let first = report
            .effects
            .first()
            .map(|e| (e.name.as_str(), e.form.as_str()));
        assert_eq!(
            first,
            Some(("clock_skew", "rate of the command's clock")),
            "{}",
            report.markdown()
        );
        let [low, high] = report.effects[0].ci["skew"];
        assert!(low < 0.004 && 0.004 < high, "{low} {high}");
    }
}
