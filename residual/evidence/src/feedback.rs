//! Feedback in a closed loop: whether an effect of the command is also there where the command
//! follows the setpoint.

use crate::leftover::{Structure, STAND_IN};
use residual_columns::error::Error;
use residual_search::model::Chosen;
use residual_search::{without, Search, Weight};

/// How far the size of an effect on the part of the command that follows the setpoint may be off
/// the fitted one, as a factor either way.
const FACTOR: f64 = 1.4;

/// What the command does to the target must come out as large where the command follows the
/// setpoint. Effects for which this does not hold are named, but not relied on. Returns the
/// structure that says so; `None` if no such effect matters, or without a setpoint.
pub fn doubt(
    search: &Search,
    chosen: &[Chosen],
    weights: &[Weight],
    explained: f64,
) -> Result<Option<Structure>, Error> {
    if search.spec.roles.setpoint.is_none() {
        return Ok(None);
    }
    let rows = search.problem.y.len() as f64;
    let mut doubtful = Vec::new();
    for w in weights {
        let (own, rest) = without(chosen, w.index);
        let fitted = search.fit(&rest)?;
        let scan = search.scan_on(&fitted);
        if !scan.built_on_command(&own.variant, own.psi) || own.effect.has_witness() {
            continue;
        }
        let instruments = search.instruments(&scan);
        let share = scan.share_on_setpoint(&instruments, &scan.added(&own.variant, own.psi));
        let size = (w.rmse_without.powi(2) - w.rmse.powi(2)) * rows;
        if !(1.0 / FACTOR..=FACTOR).contains(&share) && size > 0.5 * STAND_IN * explained {
            let text = format!("{} {share:.2} times", own.effect.name());
            doubtful.push((text, 1.0 - w.rmse / w.rmse_without));
        }
    }
    let Some((_, gain)) = doubtful.first() else {
        return Ok(None);
    };
    let sizes: Vec<&str> = doubtful.iter().map(|d| d.0.as_str()).collect();
    Ok(Some(Structure {
        depends_on: format!(
            "the command through feedback: where it follows the setpoint the effects are not of the fitted \
             size ({}); log the same with the loop open, or with speed and angle",
            sizes.join(", ")
        ),
        gain: *gain,
        p_value: 0.0,
    }))
}
