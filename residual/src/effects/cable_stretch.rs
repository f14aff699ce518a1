//! Elasticity in series: the cable stretches before it pulls.

use super::{
    Build, Context, Effect, EffectKind, Estimate, Form, Found, Piece, Psi, Remedy, Setting, Variant,
};

use super::gravity_angle::too_short;
use crate::format::num;
use crate::stats;
use crate::units::radians;
use std::f64::consts::TAU;

/// Rows up to which a lag is looked for in any data.
const MOST_ROWS: f64 = 60.0;

/// Longest lag, over the time in which the load changes: of it a tenth of the load is left.
const LONGEST: f64 = 10.0;

/// Factor between values of a time constant.
const FURTHER: f64 = 1.61;

pub(crate) struct CableStretch;

/// Labels of the spring: over an arc on which a weight looks different, and over a shorter one.
const SPRING: &str = "spring";
const SHORT_SPRING: &str = "spring over a short arc";

/// Most turns over which a spring is wound within a run.
const MOST_TURNS: f64 = 10.0;

impl Effect for CableStretch {
    fn kind(&self) -> EffectKind {
        EffectKind::CableStretch
    }
    fn meaning(&self) -> &'static str {
        "series elasticity: the load follows the command through a spring and damper (first-order lag), or rises with the winding angle"
    }
    fn experiment(&self) -> &'static str {
        "step and sweep the command with the far end blocked: the phase of a lag approaches a quarter period, that of a delay grows without limit"
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::Delay)
    }
    /// Over a short arc a weight rises with the angle as the force of a spring does, and a joint has a weight more often than a spring.
    fn twin(&self, label: &str) -> Option<EffectKind> {
        (label == SHORT_SPRING).then_some(EffectKind::GravityAngle)
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
        // A lag is off by its time constant times the slope of the load, a spring by its stiffness times the angle.
        match &ctx.position {
            Some(x) if form.label == SPRING || form.label == SHORT_SPRING => vec![x.clone()],
            _ => vec![format!("deriv({}, 2)", ctx.load)],
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        let declared = ctx.declared_columns();
        if declared.iter().any(|d| d == "command") {
            // Rows may be much closer than the motion is fast.
            let rows = (MOST_ROWS * ctx.dt).min(ctx.span / 8.0);
            let motion = (LONGEST * ctx.changes_in(&ctx.load)).min(ctx.span / 4.0);
            let grid = Context::grid_by_ratio(0.03 * ctx.dt, rows.max(motion), FURTHER);
            out.push(
                Variant::profiled(
                    "lag of the command",
                    Psi {
                        name: "time_constant",
                        unit: "s".into(),
                        grid,
                        refine: true,
                        resolution: None,
                    },
                    |tau| Build::Swap(vec![("command".into(), format!("lowpass(command, {tau})"))]),
                )
                .form(Form::CommandLag),
            );
        }
        if ctx.spec.roles.angle.is_some() && !declared.iter().any(|d| d == "angle") {
            // The angle along the velocity, as inertia and damping are.
            let against = ctx.velocity.iter().any(|v| {
                let product = format!("{v} * deriv(angle, 2)");
                stats::mean(&ctx.values(&product)) < 0.0
            });
            let angle = if against { "-1 * angle" } else { "angle" };
            let unit = ctx.per(&ctx.position_unit());
            let angles = ctx.angles();
            let arc = angles.iter().find(|(name, ..)| name == "angle");
            let label = match arc.and_then(too_short) {
                Some(_) => SHORT_SPRING,
                None => SPRING,
            };
            out.push(Variant::linear(
                label,
                vec![Piece::new("stiffness", unit, angle)],
            ));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::knowing;

    /// Spring in a model of a motion with this amplitude in rad, the speed counted along the angle or against it: the term, and
    /// why it cannot be.
    fn spring(amplitude: f64, along: f64) -> (String, Option<String>) {
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..1200).map(|i| f(0.02 * i as f64)).collect()
        };
        let columns = [
            ("target", of(&|t| (0.7 * t).sin())),
            (
                "velocity",
                of(&|t| along * amplitude * 0.7 * (0.7 * t).cos()),
            ),
            ("angle", of(&|t| amplitude * (0.7 * t).sin())),
        ];
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                    velocity = { column = \"v\", unit = \"rad/s\" }\nangle = { column = \"a\", unit = \"rad\" }\n\
                    [[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let mut out = (String::new(), None);
        knowing(spec, &columns, 600, |ctx| {
            let form = &CableStretch.variants(ctx)[0];
            let Build::Add(pieces) = (form.build)(0.0) else {
                panic!("a spring adds a term");
            };
            let estimate = Estimate {
                form: Form::Other,
                label: &form.label,
                params: &form.params(0.0, &[1.0]),
                intervals: &Default::default(),
            };
            out = (
                pieces[0].text.clone(),
                CableStretch.impossible(&estimate, ctx),
            );
        });
        out
    }

    #[test]
    fn a_spring_is_not_wound_over_many_turns() {
        assert_eq!(spring(3.0, 1.0), ("angle".into(), None));
        let why = spring(100.0, 1.0).1.unwrap();
        assert!(why.contains("turns"), "{why}");
    }

    #[test]
    fn a_stiffness_has_the_direction_of_the_velocity() {
        assert_eq!(spring(3.0, -1.0).0, "-1 * angle");
    }

    #[test]
    fn is_named() {
        let mut y = 0.0;
        crate::effects::testbench::names("cable_stretch", move |s| {
            if s.first {
                y = s.command;
            }
            y += (s.command - y) * (1.0 - (-s.dt / 0.15f64).exp());
            y - s.command
        });
    }

    /// Rows may be close beside the motion: a lag of hundreds of rows is looked for then, and no creep takes its place.
    #[test]
    fn the_longest_lag_goes_with_the_motion() {
        let longest = |w: f64| {
            let command: Vec<f64> = (0..12_000).map(|i| (w * 0.02 * i as f64).sin()).collect();
            let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                        command = { column = \"c\" }\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n";
            let columns = [("target", command.clone()), ("command", command)];
            let mut out = 0.0;
            knowing(spec, &columns, 6000, |ctx| {
                let forms = CableStretch.variants(ctx);
                out = forms[0]
                    .psi
                    .as_ref()
                    .unwrap()
                    .grid
                    .iter()
                    .copied()
                    .fold(0.0, f64::max);
            });
            out
        };
        assert!((longest(20.0) - 1.2).abs() < 1e-9, "{}", longest(20.0));
        assert!((longest(1.0) - 10.0).abs() < 0.1, "{}", longest(1.0));
        assert!((longest(0.1) - 30.0).abs() < 0.1, "{}", longest(0.1));
    }

    #[test]
    fn over_a_short_arc_a_spring_may_be_a_weight() {
        for (label, twin) in [
            (SPRING, None),
            (SHORT_SPRING, Some(EffectKind::GravityAngle)),
            ("lag of the command", None),
        ] {
            assert_eq!(CableStretch.twin(label), twin);
        }
        let label = |amplitude: f64| {
            let angle: Vec<f64> = (0..1200)
                .map(|i| amplitude * (0.014 * i as f64).sin())
                .collect();
            let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                        angle = { column = \"a\", unit = \"rad\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
            let columns = [("target", angle.clone()), ("angle", angle)];
            let mut out = String::new();
            knowing(spec, &columns, 600, |ctx| {
                out.clone_from(&CableStretch.variants(ctx)[0].label);
            });
            out
        };
        assert_eq!(
            (label(0.3), label(2.0)),
            (SHORT_SPRING.into(), SPRING.into())
        );
    }
}
