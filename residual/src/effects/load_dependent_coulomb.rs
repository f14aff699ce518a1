//! Dry friction that grows with the load.

use super::{
    Context, Effect, EffectKind, Estimate, Found, Friction, Piece, Remedy, Setting, Variant,
};

use crate::format::num;

pub(crate) struct LoadDependentCoulomb;

impl Effect for LoadDependentCoulomb {
    fn kind(&self) -> EffectKind {
        EffectKind::LoadDependentCoulomb
    }
    fn meaning(&self) -> &'static str {
        "dry friction that grows with the load (gear teeth, wrapped cable): sign of velocity times (constant + share of load)"
    }
    fn experiment(&self) -> &'static str {
        "move back and forth at constant speed under several constant loads: the jump at reversal grows with the load"
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
        vec![
            Remedy::Friction((found.get)("friction_at_zero_load")),
            Remedy::FrictionPerLoad((found.get)("friction_per_load")),
        ]
    }
    /// Friction opposes the motion at every load.
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let (a, b) = (e.get("friction_at_zero_load")?, e.get("friction_per_load")?);
        let (low, high) = ctx.range(&format!("abs({})", ctx.load))?;
        let (at_low, at_high) = (a + b * low, a + b * high);
        // An uncertain coefficient may cross zero at the end of the range.
        let smaller = at_low.abs().min(at_high.abs());
        (at_low * at_high < 0.0 && smaller > 0.1 * at_low.abs().max(at_high.abs())).then(|| {
            format!(
                "friction from {} to {}: it changes its sign with the load",
                num(at_low),
                num(at_high)
            )
        })
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let (Some(v), Some(_)) = (&ctx.velocity, ctx.range(&ctx.load)) else {
            return vec![];
        };
        let s = format!("sgn({v}, {})", ctx.deadband);
        let share = Piece::new("friction_per_load", "1", format!("{s} * abs({})", ctx.load));
        vec![
            Variant::linear(
                "constant and share",
                vec![
                    Piece::new("friction_at_zero_load", ctx.unit(), s),
                    share.clone(),
                ],
            ),
            Variant::linear("share only", vec![share]),
        ]
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("load_dependent_coulomb", |s| {
            -0.15 * s.command * s.velocity.signum()
        });
    }
}
