//! Clocks of command and target that run at different rates.

use super::{Build, Context, Effect, EffectKind, Psi, Variant};

pub(crate) struct ClockSkew;

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
        let names = ctx.declared_columns();
        if names.is_empty() || ctx.span < 200.0 * ctx.dt {
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
        let warped = |label: &str, names: Vec<String>| {
            let psi = Psi {
                name: "skew",
                unit: "s/s".into(),
                grid: grid.clone(),
                refine: true,
                resolution: None,
            };
            Variant::profiled(label, psi, move |r| {
                let warp = |n: &String| (n.clone(), format!("warp({n}, {r})"));
                Build::Swap(names.iter().map(warp).collect())
            })
        };
        let command = "command".to_string();
        let alone = names.len() > 1 && names.contains(&command);
        let mut out = vec![warped("rate of the inputs' clock", names)];
        if alone {
            // Drive and sensors have a clock each: the motion is logged by that of the target.
            out.push(warped("rate of the command's clock", vec![command]));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testbench::{simulate, Excitation, Row};

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
