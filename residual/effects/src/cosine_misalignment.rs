//! A sensor that sees only the component along its own axis.

use super::gravity_angle::any_order;
use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Variant};

pub struct CosineMisalignment;

/// Shares of the load that a component along the axis can lose.
const COSINE: (f64, f64) = (-0.05, 1.1);

/// Shares of the load that a component across the axis can have.
const SINE: (f64, f64) = (-1.1, 1.1);

impl Effect for CosineMisalignment {
    fn kind(&self) -> EffectKind {
        EffectKind::CosineMisalignment
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        let why = "a component lies between nothing and all of the load";
        e.outside("cosine_share", COSINE.0, COSINE.1, why)
            .or_else(|| e.outside("sine_share", SINE.0, SINE.1, why))
    }
    fn of_any_order(&self, form: &Variant, _: f64, ctx: &Context) -> Option<Variant> {
        let mut angles = ctx.angles().into_iter();
        let (name, q, _) = angles.find(|(n, ..)| form.label.starts_with(&format!("{n},")))?;
        let (load, is_tilted) = (ctx.load.clone(), form.label == tilted(&name));
        let build = move |n: f64| Build::Add(pieces(&load, &format!("{n} * ({q})"), is_tilted));
        Some(Variant::profiled("of any order", any_order(), build))
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let angles = ctx.angles().into_iter();
        let own = angles.filter(|(n, ..)| form.label.starts_with(&format!("{n},")));
        own.map(|(_, q, _)| q).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let l = &ctx.load;
        let mut out = Vec::new();
        for (name, q, range) in ctx.angles() {
            if range > 6.0 {
                continue;
            }
            let one = Variant::linear(&format!("{name}, aligned at zero"), pieces(l, &q, false));
            out.push(one.between(&[COSINE]));
            let both = Variant::linear(&tilted(&name), pieces(l, &q, true));
            out.push(both.between(&[COSINE, SINE]));
        }
        out
    }
}

/// The form of an axis that is not along the load where the angle is zero.
fn tilted(name: &str) -> String {
    format!("{name}, tilted")
}

/// What the component along an axis that turns by `q` loses of the load, and the component across
/// it if the axis is tilted.
fn pieces(load: &str, q: &str, is_tilted: bool) -> Vec<Piece> {
    let straight = Piece::new("cosine_share", "1", format!("{load} * (cos({q}) - 1)"));
    let across = Piece::new("sine_share", "1", format!("{load} * sin({q})"));
    let across = is_tilted.then_some(across);
    [straight].into_iter().chain(across).collect()
}
