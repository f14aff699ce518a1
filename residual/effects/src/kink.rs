//! A characteristic of two straight lines: a second path of the load, a stop, a loose joint that
//! closes.

use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant};
use residual_columns::stats::quantile_sorted;

pub struct Kink;

/// Changes of slope that leave a characteristic: up to ten times as steep, as against a stop.
/// With twice as steep the search named offset, gain and saturation in the place of a kink.
const CHANGES: (f64, f64) = (-0.9, 9.0);

/// Quantiles of the load at which a kink is looked for.
const QUANTILES: [f64; 15] = [
    0.08, 0.14, 0.2, 0.26, 0.32, 0.38, 0.44, 0.5, 0.56, 0.62, 0.68, 0.74, 0.8, 0.86, 0.92,
];

impl Effect for Kink {
    fn kind(&self) -> EffectKind {
        EffectKind::Kink
    }
    /// A slope that falls to nothing is a saturation, one that turns round is no characteristic.
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        let why = "the target would no longer follow the load, or be steeper than a stop";
        e.outside("change_of_slope", CHANGES.0, CHANGES.1, why)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let forms = ctx.sensed().into_iter();
        forms
            .filter_map(|(of, force)| change_of_slope(ctx, of, force))
            .collect()
    }
}

/// The form for one force; `None` if it does not vary. `of` is its name.
fn change_of_slope(ctx: &Context, of: &str, force: String) -> Option<Variant> {
    ctx.range(&force)?;
    let mut v = ctx.values(&force);
    v.sort_by(f64::total_cmp);
    let mut grid: Vec<f64> = QUANTILES.iter().map(|q| quantile_sorted(&v, *q)).collect();
    grid.dedup();
    if grid.len() < 5 {
        return None;
    }
    let psi = Psi::new("at_load", ctx.unit().to_string(), grid);
    let label = format!("change of slope over {of}");
    let form = Variant::profiled(&label, psi, move |at| {
        let above = format!("max(0, {force} - {at})");
        Build::Add(vec![Piece::new("change_of_slope", "1", above)])
    });
    Some(form.between(&[CHANGES]))
}
