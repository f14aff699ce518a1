//! The rows of a trial: which states become one, their way to the recorder, their files at the end.

use super::super::dataset::{Waiting, BOARD_TIME, ROWS, TRUTH};
use super::{Run, Shown};
use crate::error::ExperimentError;
use emulator_link::Truth as PlantTruth;
use recording::Finished;
use robot::arm::Truth as ArmTruth;
use robot::state::RobotState;
use std::collections::VecDeque;

impl Run<'_> {
    /// A state becomes a row, where one is due.
    pub(super) fn row(&mut self, state: &RobotState, now_ns: u64) {
        self.log.clocks.robot(state, now_ns);
        let Some(joiner) = &mut self.joiner else {
            return;
        };
        let period_ns = (1e9 / self.setup.experiment.rate_hz).round() as i64;
        let bucket = state.stamp.t_ns.div_euclid(period_ns);
        if self.last_bucket == Some(bucket) {
            return;
        }
        let Some(when) = self.log.clocks.when(state) else {
            return;
        };
        let t_s = when.link_s - self.commanded_since_ns.unwrap_or(0) as f64 * 1e-9;
        if t_s < 0.0 {
            return;
        }
        self.last_bucket = Some(bucket);
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
