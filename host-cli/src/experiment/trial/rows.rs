//! The rows of a trial: which states become one, their parts on the disk, their files at the end.

use super::super::dataset::Waiting;
use super::super::feed::Feed;
use super::super::ExperimentError;
use super::{Run, Shown};
use emulator_link::Truth as PlantTruth;
use robot::arm::Truth as ArmTruth;
use robot::state::RobotState;
use std::collections::VecDeque;

/// Seconds of rows that go into one part.
const PART_S: f64 = 10.0;
/// Resolution of the board's time stamps, s: all that is between two ends of one virtual clock.
const BOARD_TICK_S: f64 = 1e-6;

impl Run<'_> {
    /// A state becomes a row, where one is due.
    pub(super) fn row(&mut self, state: &RobotState, feed: &Feed, now_ns: u64) {
        let stamp_s = state.stamp.t_ns as f64 * 1e-9;
        if !feed.shares_the_clock() {
            self.robot_clock.note(stamp_s, now_ns as f64 * 1e-9);
        }
        let Some(joiner) = &mut self.joiner else {
            return;
        };
        let period_ns = (1e9 / self.setup.experiment.rate_hz).round() as i64;
        let bucket = state.stamp.t_ns.div_euclid(period_ns);
        if self.last_bucket == Some(bucket) {
            return;
        }
        let (link_s, board_s, sync_error_s) = if feed.shares_the_clock() {
            (stamp_s, stamp_s, BOARD_TICK_S)
        } else {
            match (self.robot_clock.offset_s(), self.board_clock.offset_s()) {
                (Some((to_link, e1)), Some((board_to_link, e2))) => {
                    let link_s = stamp_s + to_link;
                    (link_s, link_s - board_to_link, e1 + e2)
                }
                _ => return,
            }
        };
        let t_s = link_s - self.commanded_since_ns.unwrap_or(0) as f64 * 1e-9;
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
            board_s,
            sync_error_s,
            commanded_n: self.setup.trial.profile.at(t_s),
            saturated: self.saturated,
            truth,
        });
    }

    /// Writes the rows since the last part, where they are enough.
    pub(super) fn write_part(&mut self) {
        let Some(joiner) = &self.joiner else { return };
        let rows = joiner.rows.rows();
        if ((rows - self.written) as f64) < PART_S * self.setup.experiment.rate_hz {
            return;
        }
        let folder = self.setup.folder;
        let write = || {
            joiner
                .rows
                .write(&folder.part("rows", self.parts), self.written, &[])?;
            joiner
                .truth
                .write(&folder.part("truth", self.parts), self.written, &[])
        };
        if let Err(error) = write() {
            self.file_error = Some(error.into());
        }
        self.written = rows;
        self.parts += 1;
    }

    /// Writes the files, whatever has happened.
    pub(super) fn finish(mut self) -> Result<Shown, ExperimentError> {
        let mut error = self.file_error.take();
        if let Some(joiner) = &self.joiner {
            self.shown.counts.rows(joiner, self.setup);
            let has_truth = joiner
                .truth
                .column("true_force_y_n")
                .is_some_and(|c| c.iter().any(|v| !v.is_nan()));
            if let Err(failure) = self.setup.folder.write_rows(joiner, has_truth) {
                error.get_or_insert(failure);
            }
        }
        if let Some(recorder) = self.log.recorder.take() {
            let finished = recorder.finish();
            let dropped = finished.dropped_samples + finished.dropped_cycles;
            self.shown.counts.record_error = finished
                .complete()
                .err()
                .map(|failure| failure.to_string())
                .or((dropped > 0).then(|| {
                    format!("the recording lacks {dropped} rows: the disk was too slow or full")
                }));
        }
        error.map_or(Ok(self.shown), Err)
    }
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
