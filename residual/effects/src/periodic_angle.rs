//! A ripple locked to an angle: reel run-out, gear mesh, cogging.

use super::{
    spectrum, with_amplitude_phase, Build, Context, Effect, EffectKind, Estimate, Form, Found,
    Piece, Psi, Remedy, Variant,
};
use residual_columns::units::radians;
use std::f64::consts::TAU;

pub struct PeriodicAngle;

impl Effect for PeriodicAngle {
    fn kind(&self) -> EffectKind {
        EffectKind::PeriodicAngle
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.position.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn repeatable(&self) -> bool {
        true
    }
    /// Orders are proposals of a spectrum, the first and the last of them as good as the others:
    /// with a lag or a delay found beside it, the peak moves by a little.
    fn may_be_at_end(&self, _: &Variant) -> [bool; 2] {
        [true; 2]
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Ripple {
            order: (found.get)("order"),
            amplitude: (found.get)("amplitude"),
            phase: (found.get)("phase"),
            of_load: found.form == Form::ShareOfLoad,
        }]
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        e.vague("order").or_else(|| {
            let share = e.form == Form::ShareOfLoad;
            let most = if share { 1.0 } else { f64::INFINITY };
            e.outside("amplitude", 0.0, most, "larger than the load itself")
        })
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(angle) = Angle::new(ctx) else {
            return vec![];
        };
        let mut out: Vec<Variant> = angle.ripple("ripple", false).into_iter().collect();
        if ctx.range(&ctx.load).is_some() {
            out.extend(angle.ripple("ripple in proportion to load", true));
        }
        out
    }
}

/// Share of the moving rows that have to turn slowly enough for an order.
/// With 0.05 cogging of order 312 at 65 to 130 rows/s was reported as noise.
const SLOW_SHARE: f64 = 0.02;

/// Turns below which an order is not resolved from its neighbours.
pub(super) const FEW_TURNS: f64 = 1.5;

/// An angle that turns far enough to show a ripple.
pub(super) struct Angle<'a> {
    ctx: &'a Context<'a>,
    /// Expression, and radians per unit of it.
    expression: String,
    radians: f64,
    /// Turns in the range of the data.
    pub turns: f64,
    /// The angle on each row, in turns.
    turns_of: Vec<f64>,
    /// Highest order that the rows can carry, at most 400.
    highest: f64,
}

impl<'a> Angle<'a> {
    /// `None` without an angle, or if it covers less than a twentieth of a turn.
    pub fn new(ctx: &'a Context<'a>) -> Option<Angle<'a>> {
        let expression = ctx.position.clone()?;
        let radians = radians(&ctx.position_unit())?;
        let angle = ctx.values(&format!("({expression}) * {radians}"));
        let (lo, hi) = ctx.range(&expression)?;
        let turns = (hi - lo) * radians / TAU;
        (turns >= 0.05).then(|| Angle {
            ctx,
            expression,
            radians,
            turns,
            turns_of: angle.iter().map(|a| a / TAU).collect(),
            highest: 400.0f64
                .min(spectrum::highest_frequency(ctx.problem, &angle, SLOW_SHARE) * TAU),
        })
    }

    /// Orders worth trying of a ripple of the residual times `weight` (empty: 1).
    pub fn orders(&self, weight: &[f64]) -> Vec<f64> {
        let look = spectrum::Look {
            // Below one and a half periods in the range a ripple is a curve like any other.
            lowest: (1.5 / self.turns).max(0.02),
            highest: self.highest,
            coherent: true,
            lines: false,
        };
        spectrum::proposals(self.ctx, &self.turns_of, weight, &look)
    }

    /// How far an order may be off a proposal.
    pub fn resolution(&self) -> f64 {
        0.6 / self.turns
    }

    /// The ripple, constant or as a share of the load; `None` if the spectrum has no peak.
    fn ripple(&self, label: &str, of_load: bool) -> Option<Variant> {
        let ctx = self.ctx;
        let weight = if of_load {
            ctx.values(&ctx.load)
        } else {
            vec![]
        };
        let mut grid = self.orders(&weight);
        if self.turns < FEW_TURNS {
            // Order one over so few turns belongs to `gravity_angle`.
            grid.retain(|o| (o - 1.0).abs() > 0.05);
        }
        if grid.is_empty() {
            return None;
        }
        let (factor, unit, form) = if of_load {
            (format!(" * {}", ctx.load), "1", Form::ShareOfLoad)
        } else {
            (String::new(), ctx.unit(), Form::Other)
        };
        let psi = Psi::new("order", "1/turn", grid).within(self.resolution());
        let (x, k, unit) = (self.expression.clone(), self.radians, unit.to_string());
        let build = move |n: f64| {
            let w = n * k;
            Build::Add(vec![
                Piece::new("sine", unit.clone(), format!("sin({w} * {x}){factor}")),
                Piece::new("cosine", unit.clone(), format!("cos({w} * {x}){factor}")),
            ])
        };
        Some(
            Variant::profiled(label, psi, build)
                .with(with_amplitude_phase)
                .form(form),
        )
    }
}
