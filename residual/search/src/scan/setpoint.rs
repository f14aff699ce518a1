//! Effects in a closed loop: what the part of the command that follows the setpoint says about
//! them.
//!
//! The controller turns slow disturbances into command, so anything built from the command
//! correlates with them. The setpoint is free of that.

use super::Scan;
use residual_columns::expr::Expr;
use residual_columns::linalg::{dot, Cholesky};
use residual_effects::{Build, Variant};
use residual_fit::problem::RANK_TOL;

/// Delays of the setpoint that are instruments, in rows.
const DELAYS: [f64; 6] = [0.0, 2.0, 4.0, 8.0, 16.0, 32.0];

/// Distances of Dahl's model of the setpoint that are instruments, as shares of its range.
const DISTANCES: [f64; 3] = [0.02, 0.1, 0.4];

impl Scan<'_> {
    /// Whether a form is built from the command.
    pub fn built_on_command(&self, variant: &Variant, psi: f64) -> bool {
        let of_command = |e: &Expr| e.names().contains("command");
        let texts: Vec<String> = match (variant.build)(psi) {
            Build::Add(p) | Build::Local(p) | Build::Known(p) => {
                p.into_iter().map(|p| p.text).collect()
            }
            Build::Swap(s) | Build::SwapAll(s) => s.into_iter().map(|(n, _)| n).collect(),
            Build::Through(_) => return self.model.terms.iter().any(|t| of_command(&t.expr)),
        };
        texts
            .iter()
            .any(|t| Expr::parse(t).is_ok_and(|e| of_command(&e)))
    }

    /// How much the setpoint confirms of a form that adds `added` to the prediction: 1 if the part
    /// of it that follows from the setpoint is in the residual too, 0 if it is not there. 1 if it
    /// adds nothing.
    ///
    /// This is the ratio of the two-stage to the one-stage least-squares estimate, with the
    /// setpoint's history as instruments. Also 0 if the setpoint moves too little to tell.
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

/// The setpoint's history and direction on the kept rows. Single precision: any function of the
/// setpoint is an instrument, so also a rounded one, and large logs need half of the memory.
pub struct Instruments {
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
    /// Instruments of the columns as a scan sees them.
    pub fn new(scan: &Scan) -> Instruments {
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

/// Expressions of the setpoint's history and direction, and whether their squares are instruments
/// as well.
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
