//! Which rows count, and what is the truth: as in the publication (O'Neill, Stephens, Kowalewski,
//! RA-L 2018).
//!
//! The truth is the torque at the jaw after the zero-phase filter. Rows count while the jaw closes:
//! the filtered speed of the spindle is at most -0.25 rad/s. The first and last second of a run
//! don't count.

use crate::data::{Row, Run, RATE_HZ};
use crate::features::MEMORY;
use crate::filter::{derivative, zero_phase};

/// The spindle closes at this speed or faster, rad/s.
const CLOSING_RAD_S: f64 = -0.25;
/// No trajectory and no slip of a cable is so fast: the load or the drive ran away, rad/s.
const RUNAWAY_RAD_S: f64 = 6.0;
/// Rows before a runaway that the filter spoils.
const BEFORE: usize = 100;
/// Rows after it that the filter spoils, beyond the memory.
const AFTER: usize = 50;
const TRIM: usize = RATE_HZ as usize;

/// How the inputs reach the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inputs {
    /// As measured: a row knows the past alone.
    Causal,
    /// After the publication's filter: a row knows some milliseconds of the future.
    Filtered,
}

/// The rows of a run that count.
#[derive(Debug, Clone, PartialEq)]
pub struct Scored {
    /// Row numbers, rising.
    pub rows: Vec<usize>,
    /// Filtered torque at the jaw at these rows, mN·m.
    pub truth_mnm: Vec<f64>,
    /// Rows that a runaway took.
    pub runaway: usize,
}

/// Rows that count, with their truth.
#[must_use]
pub fn scored(run: &Run) -> Scored {
    let spindle: Vec<f64> = run.rows.iter().map(|row| row.spindle_rad).collect();
    let speed = derivative(&zero_phase(&spindle));
    let torque = zero_phase(&run.torque_mnm);
    let mut spoilt = vec![false; speed.len()];
    for (row, v) in speed.iter().enumerate() {
        if v.abs() > RUNAWAY_RAD_S {
            let to = (row + MEMORY + AFTER).min(spoilt.len());
            spoilt[row.saturating_sub(BEFORE)..to].fill(true);
        }
    }
    let mut out = Scored {
        rows: Vec::new(),
        truth_mnm: Vec::new(),
        runaway: 0,
    };
    for row in TRIM..speed.len().saturating_sub(TRIM) {
        if speed[row] > CLOSING_RAD_S {
            continue;
        }
        if spoilt[row] {
            out.runaway += 1;
            continue;
        }
        out.rows.push(row);
        out.truth_mnm.push(torque[row]);
    }
    out
}

/// The rows as the model gets them.
#[must_use]
pub fn inputs(run: &Run, how: Inputs) -> Vec<Row> {
    if how == Inputs::Causal {
        return run.rows.clone();
    }
    let column = |pick: fn(&Row) -> f64| zero_phase(&run.rows.iter().map(pick).collect::<Vec<_>>());
    let current = column(|r| r.current_a);
    let spindle = column(|r| r.spindle_rad);
    let motor = column(|r| r.motor_rad);
    (0..run.rows.len())
        .map(|n| Row {
            current_a: current[n],
            spindle_rad: spindle[n],
            motor_rad: motor[n],
        })
        .collect()
}
