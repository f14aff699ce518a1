//! Feedback in a closed loop: whether an effect of the command is also there where the command
//! follows the setpoint.
//!
//! The controller turns slow disturbances into command, so anything built from the command
//! correlates with them. The setpoint is free of that.

use crate::effects::{Build, Variant};
use crate::error::Error;
use crate::expr::Expr;
use crate::leftover::STAND_IN;
use crate::linalg::{dot, Cholesky};
use crate::model::Chosen;
use crate::problem::RANK_TOL;
use crate::report::Structure;
use crate::scan::Scan;
use crate::search::{without, Search, Weight};
use std::sync::{Arc, PoisonError};

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

    /// How much the setpoint confirms of a form that adds `added` to the prediction: 1 if the part of it that follows
    /// from the setpoint is in the residual too, 0 if it is not there. 1 if it adds nothing.
    ///
    /// This is the ratio of the two-stage to the one-stage least-squares estimate, with the setpoint's
    /// history as instruments. Also 0 if the setpoint moves too little to tell.
    pub fn share_on_setpoint(&self, instruments: &Instruments, added: &[f64]) -> f64 {
        if added.iter().all(|a| *a == 0.0) {
            return 1.0;
        }
        let with_added = instruments.products(added);
        let k = instruments.gram.solve(&with_added);
        // Products of the part that the instruments explain, less its mean.
        let mean = inner(&k, &instruments.with_one) / added.len() as f64;
        let part_added = inner(&k, &with_added) - mean * added.iter().sum::<f64>();
        let part_part = inner(&k, &with_added) - mean * inner(&k, &instruments.with_one);
        if part_part < 0.01 * dot(added, added) {
            return 0.0;
        }
        let residual = &self.fit.residual;
        let part_residual =
            inner(&k, &instruments.products(residual)) - mean * residual.iter().sum::<f64>();
        part_residual / part_added
    }
}

/// The setpoint's history and direction on the kept rows. Single precision: any function of the setpoint is an instrument, so also a
/// rounded one, and large logs need half of the memory.
pub(crate) struct Instruments {
    /// Columns, and whether their squares are instruments as well.
    columns: Vec<(Vec<f32>, bool)>,
    gram: Cholesky,
    /// Products with a column of ones.
    with_one: Vec<f64>,
}

/// Sum of products of two short lists.
fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Sums of products of a column and its square with values.
fn moments(column: &[f32], values: &[f64]) -> [f64; 2] {
    let mut out = [0.0; 2];
    for (z, v) in column.iter().zip(values) {
        let z = f64::from(*z);
        out[0] += z * v;
        out[1] += z * z * v;
    }
    out
}

impl Instruments {
    fn new(scan: &Scan) -> Instruments {
        let of = |(text, squared): &(String, bool)| {
            let column = scan.problem.eval_text(&scan.fit.view, text, false).ok()?;
            Some((column.iter().map(|x| *x as f32).collect(), *squared))
        };
        let columns: Vec<(Vec<f32>, bool)> = texts(scan).iter().filter_map(of).collect();
        let mut out = Instruments {
            columns,
            gram: Cholesky::new(&[], 0, RANK_TOL),
            with_one: vec![],
        };
        out.with_one = out.products(&vec![1.0; scan.problem.y.len()]);
        let mut gram = Vec::new();
        for (column, squared) in &out.columns {
            let mut values: Vec<f64> = column.iter().map(|z| f64::from(*z)).collect();
            gram.extend(out.products(&values));
            if *squared {
                values.iter_mut().for_each(|z| *z *= *z);
                gram.extend(out.products(&values));
            }
        }
        out.gram = Cholesky::new(&gram, out.with_one.len(), RANK_TOL);
        out
    }

    /// Sum of products of each instrument with values.
    fn products(&self, values: &[f64]) -> Vec<f64> {
        let of = |(column, squared): &(Vec<f32>, bool)| {
            let [first, second] = moments(column, values);
            std::iter::once(first).chain(squared.then_some(second))
        };
        self.columns.iter().flat_map(of).collect()
    }
}

/// Expressions of the setpoint's history and direction, and whether their squares are instruments as well.
fn texts(scan: &Scan) -> Vec<(String, bool)> {
    let frame = &scan.problem.frame;
    let mut out = vec![("1".to_string(), false)];
    for k in DELAYS {
        out.push((format!("delay(setpoint, {})", k * frame.step()), true));
    }
    // Direction of the setpoint, with memory: what friction and play answer to.
    if let Some((low, high)) = scan.problem.range("setpoint") {
        let range = high - low;
        out.extend(
            DISTANCES
                .iter()
                .map(|k| (format!("dahl(setpoint, {})", k * range), false)),
        );
    }
    out
}

impl Search<'_> {
    /// Instruments of the columns as a model sees them.
    pub fn instruments(&self, scan: &Scan) -> Arc<Instruments> {
        let key = scan.fit.view.key();
        let mut last = self
            .last_instruments
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        match &*last {
            Some((known, instruments)) if known == key => instruments.clone(),
            _ => {
                let new = Arc::new(Instruments::new(scan));
                *last = Some((key.to_string(), new.clone()));
                new
            }
        }
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
