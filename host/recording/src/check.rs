//! What a recording holds and what it lacks: `forcectl recording check`.

use super::error::RecordError;
use super::folder::sha256;
use super::format::{CONFIGURATION_METADATA, FORMATS, JSON_FILE, METADATA, RIG_ATTACHMENT};
use super::read::{mcap_of, End, Entry, Reader};
use super::rows::{ClockRow, CounterRow, CycleRow, EventRow, SampleRow, PREPARING};
use super::table::Row;
use super::times::Clocks;
use super::whole;
use rig::board_crc;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use wire::message::UnitConfig;
use wire::UNITS;

/// An interval between two samples of a unit that is longer than this times the usual one is a gap.
const GAP_FACTOR: f64 = 1.5;
/// An uncertainty of the board's clock against the host's above this is a problem, s.
pub const UNCERTAINTY_MAX_S: f64 = 2e-3;
/// Readings that contradict a steady drift by more than this are a problem, s.
const CONTRADICTION_MAX_S: f64 = 1e-3;

/// Samples of a unit.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct UnitCheck {
    /// Unit, from 1.
    pub unit: usize,
    /// Samples.
    pub samples: u64,
    /// Usual time between two, s (median).
    pub period_s: f64,
    /// Intervals longer than one and a half of that.
    pub gaps: u64,
    /// The longest interval, s.
    pub longest_s: f64,
    /// Board time at which the longest began, s.
    pub longest_at_s: f64,
    /// Samples that would fill the gaps.
    pub missing: u64,
    /// Samples whose time is not after the one before.
    pub backward: u64,
}

/// The board's clock against the host's.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ClockCheck {
    /// Readings, in quarters of a second.
    pub bins: u64,
    /// Median of the uncertainty of the offset, s; `null` where no request was answered.
    pub uncertainty_median_s: Option<f64>,
    /// The largest one, s.
    pub uncertainty_max_s: Option<f64>,
    /// Mean drift between the first reading and the last, ppm; `null` with fewer than two.
    pub drift_ppm: Option<f64>,
    /// Its largest error, ppm: of the offset at both readings, over the time between them.
    pub drift_uncertainty_ppm: Option<f64>,
    /// By how much readings contradict a steady drift at most, s.
    pub contradiction_s: f64,
    /// How often this machine's UTC was set.
    pub utc_set: u64,
}

/// Time in a phase.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseCheck {
    /// Phase.
    pub phase: String,
    /// Its start, UTC, s since 1970.
    pub start_utc_s: f64,
    /// For how long samples or cycles belong to it, s.
    pub duration_s: f64,
}

/// What a check found.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Checked {
    /// SHA-256 of the MCAP file.
    pub sha256: String,
    /// `complete`, `cut off`, or why it is damaged.
    pub end: String,
    /// Metadata of the recording.
    pub metadata: BTreeMap<String, String>,
    /// Messages of each topic.
    pub messages: BTreeMap<String, u64>,
    /// Units with samples.
    pub units: Vec<UnitCheck>,
    /// Clocks.
    pub clock: ClockCheck,
    /// Phases, in order.
    pub phases: Vec<PhaseCheck>,
    /// CRC-32 of each configuration.
    pub configurations: Vec<String>,
    /// Telemetry frames that never arrived during the recording.
    pub frames_lost: u64,
    /// Frames that arrived damaged.
    pub frames_bad: u64,
    /// Conversions that the board did not read in time.
    pub conversions_missed: u64,
    /// Samples that the recorder had no room for.
    pub dropped_samples: u64,
    /// Cycles that it had no room for.
    pub dropped_cycles: u64,
    /// Faults and losses, as they were recorded.
    pub events: Vec<String>,
    /// What makes the recording less than whole; empty for a good one.
    pub problems: Vec<String>,
}

/// Checks a recording. `recording` names the MCAP file or its folder.
///
/// # Errors
/// The file can't be opened.
pub fn check(recording: &Path) -> Result<Checked, RecordError> {
    let path = mcap_of(recording);
    let mut found = Gathered::default();
    let mut reader = Reader::open(&path)?;
    for entry in reader.by_ref() {
        found.take(entry);
    }
    let mut checked = Checked {
        sha256: sha256(&path)?,
        end: match reader.end() {
            End::Complete => "complete".to_owned(),
            End::Damaged(why) => format!("damaged: {why}"),
            End::CutOff | End::Unknown => "cut off".to_owned(),
        },
        ..found.checked
    };
    if checked.end != "complete" {
        checked.problems.insert(
            0,
            format!("the file is {}; what comes before is intact", checked.end),
        );
    }
    let format = checked.metadata.get("format").map_or("", String::as_str);
    if !FORMATS.contains(&format) {
        let problem = format!("the format `{format}` is none of {FORMATS:?}");
        checked.problems.push(problem);
    }
    checked.clock_of(&found.clock_rows);
    checked.counters_of(&found.counters);
    checked.units_of(&found.board_s);
    checked.phases = found.phases;
    let folder = files::folder_of(&path);
    // A run.mcap that was copied out of its folder is checked alone.
    if recording.is_dir() || folder.join(JSON_FILE).is_file() {
        let problems = whole::problems(folder, &checked.messages);
        checked.problems.extend(problems);
    } else {
        whole::sums(folder, &[], &[], &mut checked.problems);
    }
    checked.note_losses();
    Ok(checked)
}

/// What a pass over the file collects.
#[derive(Default)]
struct Gathered {
    checked: Checked,
    clock_rows: Vec<ClockRow>,
    counters: Vec<CounterRow>,
    board_s: [Vec<f64>; UNITS],
    phases: Vec<PhaseCheck>,
    unreadable: u64,
}

impl Gathered {
    fn take(&mut self, entry: Entry) {
        match entry {
            Entry::Message { topic, data, .. } => {
                self.message(&topic, &data);
                *self.checked.messages.entry(topic).or_default() += 1;
            }
            Entry::Metadata { name, pairs } if name == METADATA => self.checked.metadata = pairs,
            Entry::Metadata { name, pairs } if name == CONFIGURATION_METADATA => {
                self.configuration(&pairs);
            }
            Entry::Metadata { pairs, .. } => self.checked.metadata.extend(pairs),
            Entry::Attachment { name, data } if name == RIG_ATTACHMENT => {
                let hash = files::sha256_of(&data);
                if self.checked.metadata.get("rig_hash_sha256") != Some(&hash) {
                    self.checked.problems.push(
                        "the rig file in the recording has another hash than its metadata say"
                            .to_owned(),
                    );
                }
            }
            Entry::Attachment { .. } => {}
        }
    }

    fn configuration(&mut self, pairs: &BTreeMap<String, String>) {
        let text = |key: &str| pairs.get(key).cloned().unwrap_or_default();
        let crc = text("board_config_crc32");
        let configs = serde_json::from_str::<[UnitConfig; UNITS]>(&text("board_config"));
        let is = configs.map(|configs| format!("{:08x}", board_crc(&configs)));
        if is.ok().as_ref() != Some(&crc) {
            self.checked.problems.push(format!(
                "configuration {} does not have the CRC that it was recorded with",
                text("configuration")
            ));
        }
        self.checked.configurations.push(crc);
    }

    fn message(&mut self, topic: &str, data: &[u8]) {
        let known = if topic == SampleRow::TABLE.topic {
            serde_json::from_slice::<SampleRow>(data).map(|row| {
                if let Some(times) = self.board_s.get_mut(row.unit as usize - 1) {
                    // Sensors that are brought up pause: no gap.
                    let counts = row.phase != PREPARING;
                    times.push(if counts { row.board_s } else { f64::NAN });
                }
                self.phase(&row.phase, row.utc.ns());
            })
        } else if topic == CycleRow::TABLE.topic {
            serde_json::from_slice::<CycleRow>(data).map(|row| self.phase(&row.phase, row.utc.ns()))
        } else if topic == ClockRow::TABLE.topic {
            serde_json::from_slice(data).map(|row| self.clock_rows.push(row))
        } else if topic == CounterRow::TABLE.topic {
            serde_json::from_slice(data).map(|row| self.counters.push(row))
        } else if topic == EventRow::TABLE.topic {
            serde_json::from_slice::<EventRow>(data).map(|row| {
                if row.name == "fault" || row.name == "drops" || row.name == "clock" {
                    self.checked.clock.utc_set += u64::from(row.name == "clock");
                    self.checked
                        .events
                        .push(format!("{:.3} s: {}", row.host_s, row.message));
                }
            })
        } else {
            Ok(())
        };
        if let Err(error) = known {
            self.unreadable += 1;
            if self.unreadable == 1 {
                self.checked
                    .problems
                    .push(format!("a message on {topic} can't be read: {error}"));
            }
        }
    }

    fn phase(&mut self, phase: &str, utc_ns: u64) {
        let utc_s = utc_ns as f64 * 1e-9;
        match self.phases.last_mut() {
            Some(last) if last.phase == phase => {
                last.duration_s = last.duration_s.max(utc_s - last.start_utc_s);
            }
            _ => self.phases.push(PhaseCheck {
                phase: phase.to_owned(),
                start_utc_s: utc_s,
                duration_s: 0.0,
            }),
        }
    }
}

impl Checked {
    fn clock_of(&mut self, rows: &[ClockRow]) {
        let clocks = Clocks::of(rows);
        let mut uncertainties = Vec::new();
        let mut known = Vec::new();
        for row in rows {
            let mut row = row.clone();
            clocks.refine(&mut row);
            uncertainties.extend(row.offset_uncertainty_s);
            known.extend(
                (row.offset_uncertainty_s).map(|error_s| (row.board_s, row.offset_s, error_s)),
            );
            self.clock.contradiction_s = self.clock.contradiction_s.max(row.contradiction_s);
        }
        uncertainties.sort_by(f64::total_cmp);
        self.clock.bins = rows.len() as u64;
        self.clock.uncertainty_median_s = uncertainties.get(uncertainties.len() / 2).copied();
        self.clock.uncertainty_max_s = uncertainties.last().copied();
        if let (Some((t0, o0, e0)), Some((t1, o1, e1))) = (known.first(), known.last()) {
            let passed_s = t1 - t0;
            if passed_s > 0.0 {
                self.clock.drift_ppm = Some(1e6 * (o1 - o0) / passed_s);
                self.clock.drift_uncertainty_ppm = Some(1e6 * (e0 + e1) / passed_s);
            }
        }
    }

    fn counters_of(&mut self, rows: &[CounterRow]) {
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
            return;
        };
        self.frames_lost = last.frames_lost.saturating_sub(first.frames_lost);
        self.frames_bad = last.frames_bad.saturating_sub(first.frames_bad);
        self.dropped_samples = last.recorder_dropped_samples;
        self.dropped_cycles = last.recorder_dropped_cycles;
        let missed = |row: &CounterRow| row.conversions_missed;
        if let (Some(first), Some(last)) = (rows.iter().find_map(missed), missed(last)) {
            self.conversions_missed = last.saturating_sub(first);
        }
    }

    fn units_of(&mut self, board_s: &[Vec<f64>; UNITS]) {
        for (i, times) in board_s.iter().enumerate() {
            if let Some(unit) = unit_of(i + 1, times) {
                self.units.push(unit);
            }
        }
    }

    fn note_losses(&mut self) {
        let mut problems = Vec::new();
        for unit in &self.units {
            if unit.gaps > 0 {
                problems.push(format!(
                    "unit {}: {} gaps, about {} samples missing, the longest {:.4} s at board time {:.3} s",
                    unit.unit, unit.gaps, unit.missing, unit.longest_s, unit.longest_at_s
                ));
            }
            if unit.backward > 0 {
                problems.push(format!(
                    "unit {}: the time of {} samples is not after the one before",
                    unit.unit, unit.backward
                ));
            }
        }
        for (count, what) in [
            (
                self.dropped_samples,
                "samples dropped by the recorder: the disk was too slow or full",
            ),
            (
                self.dropped_cycles,
                "cycles dropped by the recorder: the disk was too slow or full",
            ),
            (self.frames_lost, "telemetry frames lost"),
            (self.frames_bad, "telemetry frames damaged"),
            (
                self.conversions_missed,
                "conversions that the board did not read in time",
            ),
        ] {
            if count > 0 {
                problems.push(format!("{count} {what}"));
            }
        }
        match self.clock.uncertainty_max_s {
            None => problems.push(
                "the board's clock was not compared with the host's: no request was answered"
                    .to_owned(),
            ),
            Some(s) if s > UNCERTAINTY_MAX_S => problems.push(format!(
                "the board's clock is known to {:.3} ms only at the worst place",
                s * 1e3
            )),
            Some(_) => {}
        }
        if self.clock.contradiction_s > CONTRADICTION_MAX_S {
            problems.push(format!(
                "the readings of the clocks contradict a steady drift by {:.3} ms: a clock jumped",
                self.clock.contradiction_s * 1e3
            ));
        }
        if self.clock.utc_set > 0 {
            problems.push(format!(
                "this machine's UTC was set {} times",
                self.clock.utc_set
            ));
        }
        if self.units.is_empty() {
            problems.push("it holds no samples".to_owned());
        }
        self.problems.extend(problems);
    }
}

/// Samples of a unit by their times (NaN: one whose intervals don't count); `None` without any.
fn unit_of(unit: usize, times: &[f64]) -> Option<UnitCheck> {
    let mut checked = UnitCheck {
        unit,
        samples: times.len() as u64,
        ..UnitCheck::default()
    };
    times.first()?;
    let mut intervals = Vec::with_capacity(times.len());
    for pair in times.windows(2) {
        let interval = pair[1] - pair[0];
        if interval.is_nan() {
            continue;
        }
        if interval > checked.longest_s {
            checked.longest_s = interval;
            checked.longest_at_s = pair[0];
        }
        checked.backward += u64::from(interval <= 0.0);
        intervals.push(interval);
    }
    intervals.sort_by(f64::total_cmp);
    checked.period_s = intervals.get(intervals.len() / 2).copied().unwrap_or(0.0);
    for interval in intervals {
        if checked.period_s > 0.0 && interval > GAP_FACTOR * checked.period_s {
            checked.gaps += 1;
            checked.missing += (interval / checked.period_s).round() as u64 - 1;
        }
    }
    Some(checked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_found_at_their_place() {
        let mut times: Vec<f64> = (0..1000).map(|n| 5.0 + f64::from(n) * 0.003_125).collect();
        assert_eq!(unit_of(1, &times).unwrap().gaps, 0);
        times.drain(400..410);
        times.remove(700);
        let unit = unit_of(1, &times).unwrap();
        assert_eq!((unit.gaps, unit.missing, unit.backward), (2, 11, 0));
        assert!((unit.longest_s - 11.0 * 0.003_125).abs() < 1e-9);
        assert!((unit.longest_at_s - (5.0 + 399.0 * 0.003_125)).abs() < 1e-9);
        times.swap(10, 11);
        assert_eq!(unit_of(1, &times).unwrap().backward, 1);
        assert_eq!(unit_of(1, &[]), None);
        // Around samples that don't count there is no gap.
        let paused = [1.0, 1.1, 1.2, f64::NAN, 5.0, 5.1];
        assert_eq!(unit_of(1, &paused).unwrap().gaps, 0);
    }
}
