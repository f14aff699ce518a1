//! The rows of a trial: which states become one, their way to the recorder, their files at the end.

use super::super::dataset::{Waiting, BOARD_TIME, ROWS, TRUTH};
use super::{Run, Shown};
use crate::error::ExperimentError;
use emulator_link::Truth as PlantTruth;
use recording::Finished;
use robot::arm::Truth as ArmTruth;
use robot::state::RobotState;
use std::collections::VecDeque;

/// Which states become rows: one in each period, of a robot that publishes faster. Of one that
/// publishes as often as there are rows each state does, however its clock drifts against ours and
/// its stamps jitter.
#[derive(Debug)]
pub(super) struct RowRate {
    period_ns: i64,
    /// When the next row is due, on the robot's clock.
    due_ns: Option<i64>,
    /// The newest stamp.
    last_ns: Option<i64>,
    /// Half of the time between the last two states, at most a quarter of a period: a state is due
    /// if the next one would be further from the row's time.
    half_step_ns: i64,
}

impl RowRate {
    /// So many rows a second.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            period_ns: (1e9 / rate_hz).round() as i64,
            due_ns: None,
            last_ns: None,
            half_step_ns: 0,
        }
    }

    /// Whether the next state, of this stamp, is a row.
    fn takes(&mut self, stamp_ns: i64) -> bool {
        if let Some(before_ns) = self.last_ns.replace(stamp_ns) {
            self.half_step_ns = ((stamp_ns - before_ns) / 2).clamp(0, self.period_ns / 4);
        }
        (self.due_ns).is_none_or(|due_ns| stamp_ns >= due_ns - self.half_step_ns)
    }

    /// It became one.
    fn took(&mut self, stamp_ns: i64) {
        let began = |stamp_ns: i64| stamp_ns.div_euclid(self.period_ns) * self.period_ns;
        let due_ns = self.due_ns.unwrap_or_else(|| began(stamp_ns));
        // After a gap no row is made up for.
        self.due_ns = Some((due_ns + self.period_ns).max(stamp_ns));
    }
}

impl Run<'_> {
    /// A state becomes a row, where one is due.
    pub(super) fn row(&mut self, state: &RobotState, now_ns: u64) {
        self.log.clocks.robot(state, now_ns);
        let Some(joiner) = &mut self.joiner else {
            return;
        };
        if !self.rate.takes(state.stamp.t_ns) {
            return;
        }
        let Some(when) = self.log.clocks.when(state) else {
            return;
        };
        let t_s = when.link_s - self.commanded_since_ns.unwrap_or(0) as f64 * 1e-9;
        if t_s < 0.0 {
            return;
        }
        self.rate.took(state.stamp.t_ns);
        if let Some(joints) = &state.joints {
            if self.shown.joint_names.is_empty() {
                self.shown.joint_names = joints.names.to_vec();
                self.shown.effort_meaning = (joints.effort.as_ref())
                    .map(|effort| format!("{:?}", effort.meaning).to_lowercase());
            }
        }
        if self.shown.robot_clock.is_none() {
            self.shown.robot_clock = Some(state.stamp.clock.to_string());
        }
        let truth = truth_row(&mut self.plant, &mut self.arm, state.stamp.t_ns);
        joiner.state(Waiting {
            state: state.clone(),
            board_s: when.board_s,
            sync_error_s: when.error_s,
            commanded_n: self.setup.trial.profile.at(t_s),
            saturated: self.saturated,
            truth,
        });
    }

    /// Hands the rows since the last call to the recorder.
    pub(super) fn record_rows(&mut self) {
        let (Some(joiner), Some(recorder)) = (&self.joiner, &mut self.log.recorder) else {
            return;
        };
        for row in self.recorded..joiner.rows.rows() {
            let rows = joiner.rows.row(row);
            let board_s = rows[BOARD_TIME];
            recorder.columns(ROWS.topic, board_s, rows);
            if self.log.clocks.shared() {
                // The virtual arm's: row by row.
                recorder.columns(TRUTH.topic, board_s, joiner.truth.row(row));
            }
        }
        self.recorded = joiner.rows.rows();
    }

    /// Writes the files, whatever has happened.
    pub(super) fn finish(mut self) -> Result<Shown, ExperimentError> {
        let mut error = self.file_error.take();
        if let Some(joiner) = &self.joiner {
            self.shown.counts.rows(joiner);
            let has_truth = joiner
                .truth
                .column("true_force_y_n")
                .is_some_and(|c| c.iter().any(|v| !v.is_nan()));
            if let Err(failure) = self.setup.folder.write_rows(joiner, has_truth) {
                error.get_or_insert(failure);
            }
        }
        self.record_rows();
        if let Some(recorder) = self.log.recorder.take() {
            if self.setup.experiment.record_samples || error.is_some() {
                self.shown.counts.record_error = problem_of(recorder.finish());
            } else if let Err(failure) = recorder.discard() {
                // The rows are in their own file.
                self.log.watcher.notice(&failure.to_string());
            }
        }
        error.map_or(Ok(self.shown), Err)
    }
}

/// What is wrong with a recording.
fn problem_of(finished: Finished) -> Option<String> {
    let dropped = finished.dropped_samples + finished.dropped_cycles;
    finished
        .complete()
        .err()
        .map(|failure| failure.to_string())
        .or((dropped > 0)
            .then(|| format!("the recording lacks {dropped} rows: the disk was too slow or full")))
}

/// The truth at a stamp, its columns after `t_s`; `None` where it is not known.
fn truth_row(
    plant: &mut VecDeque<PlantTruth>,
    arm: &mut VecDeque<ArmTruth>,
    stamp_ns: i64,
) -> Option<Vec<f64>> {
    let half_ms = 500_000;
    while plant
        .front()
        .is_some_and(|t| (t.t_ns as i64) < stamp_ns - half_ms)
    {
        plant.pop_front();
    }
    let arm_ns = |t: &ArmTruth| (t.time_s * 1e9) as i64;
    while arm.front().is_some_and(|t| arm_ns(t) < stamp_ns - half_ms) {
        arm.pop_front();
    }
    let near = |t_ns: i64| (t_ns - stamp_ns).abs() <= half_ms;
    let plant = plant.front().filter(|t| near(t.t_ns as i64))?;
    let arm = arm.front().filter(|t| near(arm_ns(t)))?;
    let mut row = Vec::with_capacity(27);
    row.extend(plant.tip_force_n);
    for three in [
        arm.contact_effort,
        arm.joints,
        arm.joint_rates,
        arm.motor_friction,
        arm.link_friction,
        arm.tip_m,
    ] {
        row.extend(three);
    }
    row.extend(plant.tension_n);
    Some(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps of the rows of a robot with this rate, offset and jitter (both ways) in ns, over some
    /// seconds at 100 rows a second.
    fn rows(rate_hz: f64, offset_ns: i64, jitter_ns: i64, seconds: f64) -> Vec<i64> {
        let mut rate = RowRate::new(100.0);
        (0..(rate_hz * seconds) as i64)
            .map(|n| {
                let jitter_ns = (n * 7919 % 201 - 100) * jitter_ns / 100;
                (n as f64 / rate_hz * 1e9).round() as i64 + offset_ns + jitter_ns
            })
            .filter(|stamp_ns| {
                let takes = rate.takes(*stamp_ns);
                if takes {
                    rate.took(*stamp_ns);
                }
                takes
            })
            .collect()
    }

    #[test]
    fn each_state_of_a_robot_at_the_rows_own_rate_is_one() {
        for offset_us in (0..10_000).step_by(250) {
            let rows = rows(100.0, offset_us * 1000, 50_000, 100.0);
            assert_eq!(rows.len(), 10_000, "offset {offset_us} us");
        }
        // A crystal that is 100 ppm off: a slower one loses nothing, a faster one has that many
        // states more than rows.
        for (rate_hz, states) in [(99.99, 9_999), (100.01, 10_001)] {
            for offset_us in [0, 2_500, 9_990] {
                let rows = rows(rate_hz, offset_us * 1000, 50_000, 100.0).len();
                assert!(
                    (states - 2..=states).contains(&rows),
                    "{rate_hz} {offset_us}: {rows}"
                );
            }
        }
    }

    #[test]
    fn a_faster_robot_has_a_row_in_each_period_at_its_beginning() {
        for stamp_ns in rows(1000.0, 0, 0, 10.0) {
            assert_eq!(stamp_ns % 10_000_000, 0);
        }
        assert_eq!(rows(1000.0, 300_000, 100_000, 10.0).len(), 1000);
        let slow = rows(250.0, 1_000_000, 100_000, 10.0).len();
        assert!((999..=1001).contains(&slow), "{slow}");
        assert_eq!(
            rows(40.0, 0, 0, 10.0).len(),
            400,
            "a slower robot has what it has"
        );
    }
}
