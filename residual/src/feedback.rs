//! Feedback in a closed loop: whether an effect of the command is also there where the command
//! follows the setpoint.
//!
//! The controller turns slow disturbances into command, so anything built from the command
//! correlates with them. The setpoint is free of that.

use crate::effects::{Build, Variant};
use crate::error::Error;
use crate::expr::Expr;
use crate::leftover::STAND_IN;
use crate::linalg::dot;
use crate::model::Chosen;
use crate::problem::{Column, Sums};
use crate::report::Structure;
use crate::scan::Scan;
use crate::search::{without, Search, Weight};
use crate::stats;

/// How far the size of an effect on the part of the command that follows the setpoint may be off the fitted
/// one, as a factor either way.
const FACTOR: f64 = 1.4;

/// Delays of the setpoint that are instruments, in rows.
const DELAYS: [f64; 6] = [0.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Distances of Dahl's model of the setpoint that are instruments, as shares of its range.
const DISTANCES: [f64; 3] = [0.02, 0.1, 0.4];

impl Scan<'_> {
    /// Whether a form is built from the command.
    pub fn built_on_command(&self, variant: &Variant, psi: f64) -> bool {
        let texts: Vec<String> = match (variant.build)(psi) {
            Build::Add(p) | Build::Local(p) | Build::Known(p) => {
                p.into_iter().map(|p| p.text).collect()
            }
            Build::Swap(s) | Build::SwapAll(s) => s.into_iter().map(|(n, _)| n).collect(),
        };
        texts
            .iter()
            .any(|t| Expr::parse(t).is_ok_and(|e| e.names().contains("command")))
    }

    /// How much of a form the setpoint confirms: 1 if the part of its contribution that follows
    /// from the setpoint is in the residual too, 0 if it is not there.
    ///
    /// This is the ratio of the two-stage to the one-stage least-squares estimate, with the setpoint's
    /// history as instruments. Also 0 if the setpoint moves too little to tell.
    pub fn share_on_setpoint(&self, variant: &Variant, psi: f64) -> f64 {
        let added = self.added(variant, psi);
        if added.iter().all(|a| *a == 0.0) {
            return 1.0;
        }
        let columns: Vec<Column> = self
            .instruments()
            .iter()
            .filter_map(|t| self.problem.eval_text(&self.fit.view, t, true).ok())
            .collect();
        let z: Vec<&[f64]> = columns.iter().map(|c| c.as_slice()).collect();
        let (k, _) = Sums::new(self.problem, &z, &added, None, None).fit(None);
        let mut part = vec![0.0; added.len()];
        for (column, k) in columns.iter().zip(&k) {
            part.iter_mut()
                .zip(column.iter())
                .for_each(|(p, v)| *p += k * v);
        }
        let mean = stats::mean(&part);
        part.iter_mut().for_each(|p| *p -= mean);
        if dot(&part, &part) < 0.01 * dot(&added, &added) {
            return 0.0;
        }
        dot(&part, &self.fit.residual) / dot(&part, &added)
    }

    /// Expressions of the setpoint's history and direction.
    fn instruments(&self) -> Vec<String> {
        let frame = &self.problem.frame;
        let mut texts = vec!["1".to_string()];
        for k in DELAYS {
            let s = format!("delay(setpoint, {})", k * frame.step());
            texts.extend([format!("{s}^2"), s]);
        }
        // Direction of the setpoint, with memory: what friction and play answer to.
        let mut setpoint = frame.column("setpoint").unwrap_or(&[]).to_vec();
        setpoint.sort_by(f64::total_cmp);
        let range =
            stats::quantile_sorted(&setpoint, 0.98) - stats::quantile_sorted(&setpoint, 0.02);
        if range > 0.0 {
            texts.extend(
                DISTANCES
                    .iter()
                    .map(|k| format!("dahl(setpoint, {})", k * range)),
            );
        }
        texts
    }
}

/// What the command does to the target must come out as large where the command follows the setpoint.
/// Effects for which this does not hold are named, but not
/// relied on. Returns the structure that says so; `None` if no such effect matters, or without a
/// setpoint.
pub(crate) fn doubt(
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
        let share = scan.share_on_setpoint(&own.variant, own.psi);
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
