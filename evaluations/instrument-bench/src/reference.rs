//! Models to compare with: without them a figure says nothing.

use crate::data::Run;
use crate::features::legendre;
use crate::filter::derivative;
use crate::protocol::{inputs, Inputs, Scored};
use crate::sums::Sums;

/// A model to compare with. All are linear in their regressors and get the publication's filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// The mean of the training rows.
    Mean,
    /// The publication's three inputs, current, angle and speed, in a plane.
    Plane,
    /// A lookup of the load by the mean current of the whole run, times a profile of the angle. It
    /// measures no torque: it recognises the run.
    Lookup,
}

impl Reference {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Mean, Self::Plane, Self::Lookup];

    /// Words of the table.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Mean => "mean of the training rows",
            Self::Plane => "plane in current, angle and speed",
            Self::Lookup => "lookup by the mean current of the whole run (a trap: it recognises the load, memory 20 s)",
        }
    }

    /// Sums over the scored rows of a run.
    #[must_use]
    pub fn sums(self, run: &Run, scored: &Scored) -> Sums {
        let rows = inputs(run, Inputs::Filtered);
        let spindle: Vec<f64> = rows.iter().map(|row| row.spindle_rad).collect();
        let speed = derivative(&spindle);
        let current = scored
            .rows
            .iter()
            .map(|row| rows[*row].current_a)
            .sum::<f64>();
        let current = 10.0 * current / scored.rows.len().max(1) as f64;
        let mut width = 0;
        let mut regressors = Vec::new();
        for row in &scored.rows {
            let before = regressors.len();
            match self {
                Self::Mean => regressors.push(1.0),
                Self::Plane => regressors.extend([
                    1.0,
                    10.0 * rows[*row].current_a,
                    spindle[*row],
                    speed[*row],
                ]),
                Self::Lookup => {
                    for order in legendre::<6>(spindle[*row]) {
                        regressors.extend([order, current * order, current * current * order]);
                    }
                }
            }
            width = regressors.len() - before;
        }
        Sums::of(width, &regressors, &scored.truth_mnm)
    }
}
