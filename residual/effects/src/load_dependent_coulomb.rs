//! Dry friction that grows with the load.

use super::{
    Context, Effect, EffectKind, Estimate, Found, Friction, Lookalike, Nature, Piece, Remedy,
    Setting, Variant,
};

use residual_columns::format::num;

pub struct LoadDependentCoulomb;

/// Standard errors by which another law of friction must predict worse than one with the load.
const EXCLUDED_FROM: f64 = 2.0;

impl Effect for LoadDependentCoulomb {
    fn kind(&self) -> EffectKind {
        EffectKind::LoadDependentCoulomb
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.velocity.clone().unwrap_or_else(|| ctx.load.clone())
    }
    /// The sign of the velocity, which no controller drives.
    fn has_witness(&self) -> bool {
        true
    }
    fn friction(&self) -> Option<Friction> {
        Some(Friction::WithLoad)
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::DryFriction)
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        // A board knows the load, and no friction per command.
        if (found.get)("friction_per_command") != 0.0 {
            return vec![];
        }
        vec![
            Remedy::Friction((found.get)("friction_at_zero_load")),
            Remedy::FrictionPerLoad((found.get)("friction_per_load")),
        ]
    }
    /// Another law of friction, or a turn that is not quite that of another friction, leaves a rest
    /// that may grow with the load.
    fn lookalikes(&self, ctx: &Context) -> Vec<Lookalike> {
        let laws = [
            EffectKind::Coulomb,
            EffectKind::Stribeck,
            EffectKind::Presliding,
        ];
        Lookalike::of(&laws, EXCLUDED_FROM, ctx)
    }
    /// Friction opposes the motion at every load.
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let a = e.get("friction_at_zero_load")?;
        let (b, by) = match (e.get("friction_per_load"), e.get("friction_per_command")) {
            (Some(b), _) => (b, ctx.load.as_str()),
            (None, b) => (b?, "command"),
        };
        let (low, high) = ctx.range(&format!("abs({by})"))?;
        let (at_low, at_high) = (a + b * low, a + b * high);
        // An uncertain coefficient may cross zero at the end of the range.
        let smaller = at_low.abs().min(at_high.abs());
        let half = |[lo, hi]: &[f64; 2]| 0.5 * (hi - lo);
        let uncertain = e.intervals.get("friction_at_zero_load").map_or(0.0, half);
        let least = uncertain.max(0.1 * at_low.abs().max(at_high.abs()));
        (at_low * at_high < 0.0 && smaller > least).then(|| {
            format!(
                "friction from {} to {}: it changes its sign with the load",
                num(at_low),
                num(at_high)
            )
        })
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let (Some(direction), Some(_)) = (&ctx.direction, ctx.range(&ctx.load)) else {
            return vec![];
        };
        let s = direction.sign();
        let by = ctx.measure();
        let name = format!("friction{}", by.suffix);
        let share = Piece::new(name, by.unit, format!("{s} * {}", by.text));
        vec![
            Variant::linear(
                "constant and share",
                vec![
                    Piece::new("friction_at_zero_load", ctx.unit(), s).being(Nature::Friction),
                    share.clone(),
                ],
            ),
            Variant::linear("share only", vec![share]),
        ]
    }
}
