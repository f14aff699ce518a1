//! Lost motion: the driven side stands still while the gap is crossed.

use super::{Build, Context, Effect, EffectKind, Estimate, Psi, Variant};

pub struct Backlash;

/// Widest gap, as a share of the largest motion within one run. Behind a wider one nothing would
/// move.
const WIDEST: f64 = 0.8;

impl Effect for Backlash {
    fn kind(&self) -> EffectKind {
        EffectKind::Backlash
    }
    /// Seen from the drive, dry friction between drive and load is a gap in the command: the load
    /// stands still until the command has crossed twice the friction.
    fn twin(&self, label: &str) -> Option<EffectKind> {
        (label == "gap in command").then_some(EffectKind::Coulomb)
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let column = if e.label == "gap in command" {
            "command"
        } else {
            "angle"
        };
        e.below_step("gap", ctx.step_of(column), column)
            .or_else(|| {
                let widest = WIDEST * ctx.excursion(column);
                let why =
                    "within no run is the motion so wide that anything would move behind the gap";
                e.outside("gap", 0.0, widest, why)
            })
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        if form.label.contains("angle") {
            vec!["angle".into()]
        } else {
            vec![ctx.load.clone()]
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        let declared = ctx.declared_columns();
        for name in ["command", "angle"] {
            if !declared.iter().any(|d| d == name) {
                continue;
            }
            let Some((lo, hi)) = ctx.range(name) else {
                continue;
            };
            let grid = Context::log_grid(5e-4 * (hi - lo), 0.6 * (hi - lo), 20);
            let unit = ctx.spec.roles.unit(name);
            let widest = WIDEST * ctx.excursion(name);
            let form = Variant::profiled(
                &format!("gap in {name}"),
                Psi::new("gap", unit, grid),
                move |w| Build::Swap(vec![(name.to_string(), format!("play({name}, {w})"))]),
            );
            out.push(form.possible(move |gap, _| gap <= widest));
        }
        out
    }
}
