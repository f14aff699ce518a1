//! Which states of a robot become rows of a model, by their stamps: a model counts rows as time, so
//! rows must come at its rate.

use std::fmt;

/// Distances after which the robot's rate is judged.
const JUDGED: usize = 50;
/// Distance, in steps, above which a row does not follow the one before it.
const GAP: f64 = 1.5;
/// Median distance, in steps, above which the robot is slower than the model.
const SLOW: f64 = 1.1;
/// Gaps among the judged distances above which the robot's states do not come at the model's rate.
const GAPS: usize = 5;

/// What a state is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Take {
    /// Between two rows.
    Between,
    /// The next row.
    Next,
    /// A row that begins anew: what was before it is not its past.
    Anew(Anew),
}

/// Why a row does not follow the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anew {
    /// Rows are missing, or the robot is slow.
    Gap {
        /// Distance to the row before, ns.
        distance_ns: i64,
    },
    /// The robot's clock went back.
    Back,
}

/// The robot's states are no rows of the model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PaceError {
    /// Slower than the model.
    #[error("the robot publishes {robot_hz:.2} Hz, the model needs {model_hz:.2} Hz: raise the robot's rate, or train a model at a lower one (--rate)")]
    Slow {
        /// Rate of the robot, Hz.
        robot_hz: f64,
        /// Rate of the model, Hz.
        model_hz: f64,
    },
    /// Gaps again and again.
    #[error("{gaps} of the first {} rows come more than {} steps after the row before: states are lost, or the robot's rate is no multiple of the model's {model_hz:.2} Hz. Check the network, or train a model at a rate that divides the robot's (--rate)", JUDGED, GAP)]
    Uneven {
        /// Gaps.
        gaps: usize,
        /// Rate of the model, Hz.
        model_hz: f64,
    },
}

/// Takes rows at a model's rate, as near as the robot's states come to it.
#[derive(Debug)]
pub struct Pace {
    step_ns: i64,
    /// Stamp of the row that is due.
    due: Option<i64>,
    /// Stamp of the last row.
    last: Option<i64>,
    /// The first distances between rows, ns.
    distances: Vec<i64>,
}

impl Pace {
    /// For rows of `step_s`.
    #[must_use]
    pub fn new(step_s: f64) -> Self {
        Self {
            step_ns: (step_s * 1e9).round() as i64,
            due: None,
            last: None,
            distances: Vec::new(),
        }
    }

    /// Whether a row was taken since the beginning or the last break.
    #[must_use]
    pub const fn goes_on(&self) -> bool {
        self.last.is_some()
    }

    /// The stream broke off: the next row has no row before it.
    pub const fn broke_off(&mut self) {
        self.due = None;
        self.last = None;
    }

    /// What the state of this stamp is.
    ///
    /// # Errors
    /// [`PaceError`], once the first rows tell it.
    pub fn take(&mut self, t_ns: i64) -> Result<Take, PaceError> {
        let step = self.step_ns;
        // One old stamp, or a clock that was set back, must not make all later states wait.
        let back = self.due.is_some_and(|due| t_ns < due - 2 * step);
        if back {
            self.broke_off();
        }
        if self.due.is_some_and(|due| t_ns < due - step / 4) {
            return Ok(Take::Between);
        }
        let distance_ns = self.last.map(|last| t_ns - last);
        self.due = Some(match self.due {
            Some(due) if t_ns - due <= step => due + step,
            _ => t_ns + step,
        });
        self.last = Some(t_ns);
        if back {
            return Ok(Take::Anew(Anew::Back));
        }
        let Some(distance_ns) = distance_ns else {
            return Ok(Take::Next);
        };
        if self.distances.len() < JUDGED {
            self.distances.push(distance_ns);
            if self.distances.len() == JUDGED {
                self.judge()?;
            }
        }
        Ok(if self.steps(distance_ns) > GAP {
            Take::Anew(Anew::Gap { distance_ns })
        } else {
            Take::Next
        })
    }

    fn steps(&self, distance_ns: i64) -> f64 {
        distance_ns as f64 / self.step_ns as f64
    }

    fn judge(&mut self) -> Result<(), PaceError> {
        self.distances.sort_unstable();
        let median = self.distances[JUDGED / 2];
        let model_hz = 1e9 / self.step_ns as f64;
        if self.steps(median) > SLOW {
            return Err(PaceError::Slow {
                robot_hz: 1e9 / median as f64,
                model_hz,
            });
        }
        let gap = |distance: &&i64| self.steps(**distance) > GAP;
        let gaps = self.distances.iter().filter(gap).count();
        if gaps > GAPS {
            return Err(PaceError::Uneven { gaps, model_hz });
        }
        Ok(())
    }
}

impl fmt::Display for Anew {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gap { distance_ns } => write!(
                f,
                "states are {:.0} ms apart, more than the model's rows: the estimate begins anew there",
                *distance_ns as f64 * 1e-6
            ),
            Self::Back => {
                f.write_str("the robot's clock went back: the estimate begins anew there")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// States every `ms`, with a model of 50 Hz.
    fn every(ms: f64, states: i64) -> Result<Vec<Take>, PaceError> {
        let mut pace = Pace::new(0.02);
        (0..states)
            .map(|k| pace.take((k as f64 * ms * 1e6) as i64))
            .collect()
    }

    #[test]
    fn a_fast_robot_gives_a_row_a_step() {
        for ms in [1.0, 5.0, 10.0, 20.0, 21.0] {
            let takes = every(ms, 2_000).unwrap();
            let rows = takes.iter().filter(|t| **t == Take::Next).count() as f64;
            let expected = 2_000.0 * ms / ms.max(20.0);
            assert!((rows - expected).abs() <= expected * 0.06, "{ms}: {rows}");
            assert!(!takes.iter().any(|t| matches!(t, Take::Anew(_))), "{ms}");
        }
    }

    #[test]
    fn a_slow_robot_begins_anew_at_each_row_and_is_refused_after_fifty() {
        assert!(every(50.0, 50).unwrap()[1..].iter().all(
            |t| matches!(t, Take::Anew(Anew::Gap { distance_ns }) if *distance_ns == 50 * MS)
        ));
        let error = every(50.0, 60).unwrap_err().to_string();
        assert!(
            error.contains("publishes 20.00 Hz") && error.contains("needs 50.00 Hz"),
            "{error}"
        );
        // 25 ms are no gap, and still too slow.
        assert!(every(25.0, 50).unwrap()[1..]
            .iter()
            .all(|t| *t == Take::Next));
        let error = every(25.0, 51).unwrap_err().to_string();
        assert!(error.contains("publishes 40.00 Hz"), "{error}");
        // 60 Hz on average give 50 rows a second, of which a fifth come late.
        let error = every(1_000.0 / 60.0, 200).unwrap_err();
        assert!(matches!(error, PaceError::Uneven { .. }), "{error}");
    }

    #[test]
    fn a_gap_and_a_break_are_no_distance_of_rows() {
        let mut pace = Pace::new(0.02);
        for k in 0..100 {
            assert_eq!(pace.take(k * 20 * MS), Ok(Take::Next));
        }
        let late = (99 * 20 + 31) * MS;
        assert_eq!(
            pace.take(late),
            Ok(Take::Anew(Anew::Gap {
                distance_ns: 31 * MS
            }))
        );
        pace.broke_off();
        assert!(!pace.goes_on());
        assert_eq!(pace.take(late + 900 * MS), Ok(Take::Next));
    }

    #[test]
    fn a_clock_that_went_back_does_not_silence_the_estimate() {
        let mut pace = Pace::new(0.02);
        // A state of the old clock far ahead, then the new clock.
        assert_eq!(pace.take(3_600_000 * MS), Ok(Take::Next));
        assert_eq!(pace.take(5 * MS), Ok(Take::Anew(Anew::Back)));
        assert_eq!(pace.take(15 * MS), Ok(Take::Between));
        assert_eq!(pace.take(25 * MS), Ok(Take::Next));
        // Not quite in order is no jump.
        assert_eq!(pace.take(24 * MS), Ok(Take::Between));
    }
}
