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
    /// Damping that swells and falls with the angle as friction does: what grows with the speed is
    /// no dry friction.
    fn must_surpass(&self, form: &Variant, order: f64, ctx: &Context) -> Vec<Variant> {
        let (Some(v), Some(angle)) = (&ctx.velocity, in_radians(ctx)) else {
            return vec![];
        };
        let Some(mut psi) = form.psi.clone().filter(|p| p.name == "order") else {
            return vec![];
        };
        psi.grid = vec![order];
        vec![with_a_ripple(ctx, "damping with a ripple", v, &angle, psi)]
    }
    /// The middle of a sector goes round.
    fn may_be_at_end(&self, form: &Variant) -> [bool; 2] {
        [form.psi.as_ref().is_some_and(|p| p.name == "middle"); 2]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let (Some(direction), Some(x)) = (&ctx.direction, &ctx.position) else {
            return vec![];
        };
        let (Some(k), Some(angle)) = (radians(&ctx.position_unit()), in_radians(ctx)) else {
            return vec![];
        };
        // An angle that is integrated from the speed starts anew in each run.
        if ctx.spec.roles.angle.is_none() || ctx.width(x) * k < WIDTHS[0] {
            return vec![];
        }
        let sign = direction.sign();
        let ripple = with_a_ripple(ctx, "with a ripple", &sign, &angle, orders(ctx, &sign));
        WIDTHS
            .iter()
            .map(|width| in_a_sector(ctx, &sign, &angle, *width))
            .chain([ripple])
            .collect()
    }
}

/// Expression of the angle in radians; `None` without one.
fn in_radians(ctx: &Context) -> Option<String> {
    let x = ctx.position.as_ref()?;
    let k = radians(&ctx.position_unit())?;
    Some(match k == 1.0 {
        true => x.clone(),
        false => format!("({x} * {k})"),
    })
}

/// Orders of a friction that swells and falls with the angle.
fn orders(ctx: &Context, sign: &str) -> Psi {
    let (mut grid, mut resolution) = (ORDERS.to_vec(), None);
    // The spectrum of what a ripple of the friction leaves, in the direction of the motion.
    if let Some(turning) = Angle::new(ctx).filter(|a| a.turns >= FEW_TURNS) {
        grid.extend(turning.orders(&ctx.values(sign)));
        grid.sort_by(f64::total_cmp);
        grid.dedup();
        resolution = Some(turning.resolution());
    }
    Psi {
        name: "order",
        unit: "1/turn".into(),
        grid,
        refine: resolution.is_some(),
        resolution,
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

/// What swells and falls with the angle, `factor` times.
fn with_a_ripple(ctx: &Context, label: &str, factor: &str, angle: &str, psi: Psi) -> Variant {
    let (factor, angle) = (factor.to_string(), angle.to_string());
    let unit = ctx.unit().to_string();
    Variant::profiled(label, psi, move |n| {
        let wave = |f: &str| format!("{factor} * {f}({n} * {angle})");
        Build::Add(vec![
            Piece::new("sine", unit.clone(), wave("sin")),
            Piece::new("cosine", unit.clone(), wave("cos")),
        ])
    })
    .with(with_amplitude_phase)
}
