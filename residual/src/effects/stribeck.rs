//! Dry friction that falls as sliding gets faster.

use crate::format::num;

use super::{
    Build, Context, Effect, EffectKind, Estimate, Found, Piece, Psi, Remedy, Setting, Variant,
};

pub(crate) struct Stribeck;

/// Part of the larger friction from which the other one has a sign of its own.
const TURNED: f64 = 0.1;

impl Effect for Stribeck {
    fn kind(&self) -> EffectKind {
        EffectKind::Stribeck
    }
    fn meaning(&self) -> &'static str {
        "Stribeck friction: dry friction that is larger at low speed and falls to its sliding value"
    }
    fn experiment(&self) -> &'static str {
        "move at many constant speeds from very slow to fast, both directions, constant load"
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.velocity.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::DryFriction)
    }
    /// Only where it falls with speed. Where it grows, this stands in for viscous friction, and its
    /// sliding part would be too much at a reversal.
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        let sliding = (found.get)("sliding_friction");
        if sliding * (found.get)("extra_at_low_speed") >= 0.0 {
            vec![Remedy::Friction(sliding)]
        } else {
            vec![]
        }
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let v = ctx.velocity.as_ref()?;
        let (_, fast) = ctx.range(&format!("abs({v})"))?;
        let why = "outside of the speeds in the data";
        e.outside("stribeck_velocity", 0.5 * ctx.deadband, fast, why)
            .or_else(|| {
                let sliding = e.get("sliding_friction")?;
                let slow = sliding + e.get("extra_at_low_speed")?;
                // An uncertain coefficient may cross zero.
                let smaller = sliding.abs().min(slow.abs());
                let most = TURNED * sliding.abs().max(slow.abs());
                (sliding * slow < 0.0 && smaller > most).then(|| {
                    format!(
                        "friction from {} at low speed to {}: it changes its sign with the speed",
                        num(slow),
                        num(sliding)
                    )
                })
            })
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(v) = ctx.velocity.clone() else {
            return vec![];
        };
        let Some((_, fast)) = ctx.range(&format!("abs({v})")) else {
            return vec![];
        };
        let (unit, db) = (ctx.unit().to_string(), ctx.deadband);
        let grid = Context::log_grid((0.01 * fast).max(1.5 * db), 0.6 * fast, 14);
        let form = |label: &str, power: i32| {
            let (v, unit) = (v.clone(), unit.clone());
            Variant::profiled(
                label,
                Psi {
                    name: "stribeck_velocity",
                    unit: ctx.velocity_unit(),
                    grid: grid.clone(),
                    refine: true,
                    resolution: None,
                },
                move |vs| {
                    let s = format!("sgn({v}, {db})");
                    Build::Add(vec![
                        Piece::new("sliding_friction", unit.clone(), s.clone()),
                        Piece::new(
                            "extra_at_low_speed",
                            unit.clone(),
                            format!("{s} * exp(-abs({v} / {vs})^{power})"),
                        ),
                    ])
                },
            )
            .adding_to_friction(1)
        };
        vec![form("gaussian", 2), form("exponential", 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::{knowing, simulate, Excitation};
    use crate::effects::{Form, Param};

    /// In one direction the sliding part takes an offset along, and the sum would drive the motion.
    #[test]
    fn friction_has_one_sign_at_all_speeds() {
        let rows = 300;
        let velocity: Vec<f64> = (0..rows).map(|i| 2.0 + (0.1 * i as f64).sin()).collect();
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    velocity = { column = \"v\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let columns = [("target", velocity.clone()), ("velocity", velocity)];
        knowing(spec, &columns, rows, |ctx| {
            let why = |sliding: f64, extra: f64| {
                let named = [
                    ("stribeck_velocity", 1.0),
                    ("sliding_friction", sliding),
                    ("extra_at_low_speed", extra),
                ];
                let params = named.map(|(name, value)| Param {
                    name: name.into(),
                    value,
                    unit: String::new(),
                });
                let estimate = Estimate {
                    form: Form::Other,
                    label: "gaussian",
                    params: &params,
                    intervals: &Default::default(),
                };
                Stribeck.impossible(&estimate, ctx)
            };
            assert_eq!(why(0.2, 0.3), None);
            assert_eq!(why(-0.2, -0.3), None);
            // Within what is uncertain.
            assert_eq!(why(-0.02, 0.345), None);
            assert!(why(-0.05, 0.345).is_some_and(|w| w.contains("changes its sign")));
        });
    }

    /// A wide hump of the other sign bends like viscous friction, and takes Coulomb friction along.
    #[test]
    fn friction_that_grows_with_speed_is_not_stribeck() {
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            -s.velocity.signum() * (0.6 - 0.4 * (-(s.velocity / 0.5).powi(2)).exp())
        });
        let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
        assert!(!names.contains(&"stribeck"), "{}", report.markdown());
        assert!(names.contains(&"coulomb"), "{}", report.markdown());
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("stribeck", |s| {
            -s.velocity.signum() * (0.2 + 0.5 * (-(s.velocity / 0.3).powi(2)).exp())
        });
    }
}
