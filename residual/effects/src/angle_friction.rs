//! Dry friction that depends on the angle: a rubbing spot, a bent shaft.

use super::periodic_angle::{Angle, FEW_TURNS};
use super::{
    with_amplitude_phase, Build, Context, Effect, EffectKind, Estimate, Nature, Piece, Psi, Variant,
};
use residual_columns::units::radians;
use std::f64::consts::TAU;

pub struct AngleFriction;

/// Places in a turn at which the middle of a sector is looked for, and widths of sectors in
/// radians.
const PLACES: usize = 24;
const WIDTHS: [f64; 8] = [0.3, 0.42, 0.6, 0.84, 1.15, 1.55, 2.1, 2.8];

/// Orders per turn of a friction that swells and falls that are tried in any case: over less than a
/// few turns no others are resolved.
const ORDERS: [f64; 4] = [1.0, 2.0, 3.0, 4.0];

impl Effect for AngleFriction {
    fn kind(&self) -> EffectKind {
        EffectKind::AngleFriction
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.position.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        if let Some(why) = e.vague("order") {
            return Some(why);
        }
        let x = ctx.position.as_ref()?;
        let turn = ctx.width(x) * radians(&ctx.position_unit())?;
        (turn < WIDTHS[0]).then(|| "the angle moves by less than a sector".to_string())
    }
    /// The middle of a sector goes round.
    fn may_be_at_end(&self, form: &Variant) -> [bool; 2] {
        [form.psi.as_ref().is_some_and(|p| p.name == "middle"); 2]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let (Some(v), Some(x)) = (&ctx.velocity, &ctx.position) else {
            return vec![];
        };
        let Some(k) = radians(&ctx.position_unit()) else {
            return vec![];
        };
        // An angle that is integrated from the speed starts anew in each run.
        if ctx.spec.roles.angle.is_none() || ctx.width(x) * k < WIDTHS[0] {
            return vec![];
        }
        let sign = format!("sgn({v}, {})", ctx.deadband);
        let angle = if k == 1.0 {
            x.clone()
        } else {
            format!("({x} * {k})")
        };
        WIDTHS
            .iter()
            .map(|width| in_a_sector(ctx, &sign, &angle, *width))
            .chain([with_a_ripple(ctx, &sign, &angle)])
            .collect()
    }
}

/// Label of the friction in a sector of this width, in radians.
fn sector(width: f64) -> String {
    format!("in a sector of {width} rad")
}

/// Width in radians of the sector of a form; `None` of another form.
pub fn sector_of(label: &str) -> Option<f64> {
    WIDTHS.into_iter().find(|width| sector(*width) == label)
}

/// Friction in a sector of the turn of this width.
fn in_a_sector(ctx: &Context, sign: &str, angle: &str, width: f64) -> Variant {
    let (sign, angle, unit) = (sign.to_string(), angle.to_string(), ctx.unit().to_string());
    let step = TAU / PLACES as f64;
    let psi = Psi::new(
        "middle",
        "rad",
        (0..PLACES).map(|k| k as f64 * step).collect(),
    )
    .within(step);
    let edge = (0.5 * width).cos();
    let label = sector(width);
    Variant::profiled(&label, psi, move |middle| {
        let text = format!("{sign} * (cos({angle} - {middle}) > {edge})");
        Build::Add(vec![
            Piece::new("friction", unit.clone(), text).being(Nature::Friction)
        ])
    })
}

/// Friction that swells and falls with the angle.
fn with_a_ripple(ctx: &Context, sign: &str, angle: &str) -> Variant {
    let (sign, angle, unit) = (sign.to_string(), angle.to_string(), ctx.unit().to_string());
    let (mut grid, mut resolution) = (ORDERS.to_vec(), None);
    // The spectrum of what a ripple of the friction leaves, in the direction of the motion.
    if let Some(turning) = Angle::new(ctx).filter(|a| a.turns >= FEW_TURNS) {
        grid.extend(turning.orders(&ctx.values(&sign)));
        grid.sort_by(f64::total_cmp);
        grid.dedup();
        resolution = Some(turning.resolution());
    }
    let psi = Psi {
        name: "order",
        unit: "1/turn".into(),
        grid,
        refine: resolution.is_some(),
        resolution,
    };
    Variant::profiled("with a ripple", psi, move |n| {
        let wave = |f: &str| format!("{sign} * {f}({n} * {angle})");
        Build::Add(vec![
            Piece::new("sine", unit.clone(), wave("sin")),
            Piece::new("cosine", unit.clone(), wave("cos")),
        ])
    })
    .with(with_amplitude_phase)
}
