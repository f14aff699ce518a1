//! Dry friction that falls as sliding gets faster.

use residual_columns::format::num;

use super::{
    Build, Context, Effect, EffectKind, Estimate, Found, Nature, Piece, Psi, Remedy, Setting,
    Variant,
};

pub struct Stribeck;

/// Part of the larger friction from which the other one has a sign of its own.
const TURNED: f64 = 0.1;

impl Effect for Stribeck {
    fn kind(&self) -> EffectKind {
        EffectKind::Stribeck
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
        let (Some(v), Some(direction)) = (ctx.velocity.clone(), &ctx.direction) else {
            return vec![];
        };
        let Some((_, fast)) = ctx.range(&format!("abs({v})")) else {
            return vec![];
        };
        // In one direction a curve over the speed has no sign that would make it friction.
        if !ctx.turns_round() {
            return vec![];
        }
        let unit = ctx.unit().to_string();
        let grid = Context::log_grid((0.01 * fast).max(1.5 * ctx.deadband), 0.6 * fast, 14);
        let form = |label: &str, s: String, power: i32| {
            let (v, unit) = (v.clone(), unit.clone());
            Variant::profiled(
                label,
                Psi::new("stribeck_velocity", ctx.velocity_unit(), grid.clone()),
                move |vs| {
                    Build::Add(vec![
                        Piece::new("sliding_friction", unit.clone(), s.clone())
                            .being(Nature::Friction),
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
        let mut out = vec![
            form("gaussian", direction.sign(), 2),
            form("exponential", direction.sign(), 1),
        ];
        // The whole of it, at rest too: else its parts at rest and in motion have two names.
        if !ctx.friction && ctx.rests() {
            out.push(form("gaussian, stays at rest", direction.held(), 2));
            out.push(form("exponential, stays at rest", direction.held(), 1));
        }
        out
    }
}
