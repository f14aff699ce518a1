//! The cycles of a run. A run may last a day: the figures are added up cycle by cycle, and as many
//! rows are kept as a plot and the search for a cause need.

use force::metrics::{Metrics, Step, Sums};
use force::thinned::Thinned;
use known::uncertainty::Steady;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// Cycles that are all kept, the newest: 60 s. A swing is looked for in them, and a fault that is
/// heard of late, by 50 ms and the link's delay, takes its cycles out of them.
const NEWEST: usize = 6_000;
/// Rows that are kept of those before: ten minutes, 16 MB. From there on each second one goes, and
/// so on: a plot has 2,000 points at most.
const ROWS: usize = 60_000;

/// See the module's page.
pub(super) struct Cycles {
    sums: Sums,
    steady: Steady,
    newest: VecDeque<Step>,
    /// Of those before.
    rows: Thinned<Step>,
}

/// The rows that are kept of a run that has ended.
pub(super) struct Rows {
    pub steps: Vec<Step>,
    /// Where the rows begin that follow each other without a gap.
    pub whole_from: usize,
}

impl Cycles {
    pub fn new(commanded_n: Vector3<f64>) -> Self {
        Self {
            sums: Sums::new(commanded_n),
            steady: Steady::default(),
            newest: VecDeque::with_capacity(NEWEST),
            rows: Thinned::new(ROWS),
        }
    }

    pub fn push(&mut self, step: Step) {
        if self.newest.len() == NEWEST {
            if let Some(oldest) = self.newest.pop_front() {
                self.add(&oldest);
                self.rows.push(oldest);
            }
        }
        self.newest.push_back(step);
    }

    fn add(&mut self, step: &Step) {
        self.sums.add(step);
        self.steady.add(step);
    }

    /// The figures of the cycles before a time, s, and the rows of all.
    pub fn end(mut self, until_s: Option<f64>) -> (Option<Metrics>, Steady, Rows) {
        let newest = std::mem::take(&mut self.newest);
        let held = |step: &&Step| until_s.is_none_or(|until_s| step.t_s < until_s);
        newest.iter().filter(held).for_each(|step| self.add(step));
        let is_whole = self.rows.is_whole();
        let mut steps = self.rows.into_kept();
        let whole_from = if is_whole { 0 } else { steps.len() };
        steps.extend(newest);
        let rows = Rows { steps, whole_from };
        (self.sums.metrics(), self.steady, rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use force::metrics;
    use wire::UNITS;

    /// A run whose error swings slowly, cycle by cycle.
    fn step(n: u32) -> Step {
        let t_s = f64::from(n) * 0.01;
        Step {
            t_s,
            tip_m: Vector3::zeros(),
            commanded_n: Vector3::new(0.0, 2.5, 0.0),
            estimated_n: Vector3::new(0.0, 2.5 + 0.2 * (0.01 * t_s).sin(), 0.0),
            applied_n: None,
            tension_setpoint_n: [2.0; UNITS],
            measured_tension_n: [2.1; UNITS],
            true_tension_n: None,
            available: [true; UNITS],
        }
    }

    #[test]
    fn a_long_run_has_the_figures_of_all_cycles_and_keeps_a_bounded_number_of_rows() {
        let commanded_n = Vector3::new(0.0, 2.5, 0.0);
        let count = 300_000;
        let mut cycles = Cycles::new(commanded_n);
        (0..count).for_each(|n| cycles.push(step(n)));
        let all: Vec<Step> = (0..count).map(step).collect();
        // A fault that was heard of late.
        let until_s = f64::from(count) * 0.01 - 0.2;
        let held = &all[..all.partition_point(|step| step.t_s < until_s)];
        let (found, steady, rows) = cycles.end(Some(until_s));
        assert_eq!(found, metrics::of_run(commanded_n, held));
        let mut expected = Steady::default();
        held.iter().for_each(|step| expected.add(step));
        assert_eq!(format!("{steady:?}"), format!("{expected:?}"));
        assert!(rows.steps.len() <= ROWS + NEWEST, "{}", rows.steps.len());
        assert!(rows.steps.is_sorted_by(|a, b| a.t_s < b.t_s));
        let ends = |steps: &[Step]| (steps[0].t_s, steps[steps.len() - 1].t_s);
        assert_eq!(ends(&rows.steps), ends(&all));
        assert_eq!(rows.steps[rows.whole_from..], all[all.len() - NEWEST..]);
    }

    #[test]
    fn a_run_of_some_minutes_keeps_every_cycle() {
        let mut cycles = Cycles::new(Vector3::zeros());
        (0..30_000).for_each(|n| cycles.push(step(n)));
        let (_, _, rows) = cycles.end(None);
        assert_eq!((rows.steps.len(), rows.whole_from), (30_000, 0));
    }
}
