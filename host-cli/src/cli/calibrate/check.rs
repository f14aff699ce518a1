//! `calibrate check`: one known weight against the stored calibration, on each cell or on the tip.

use super::super::exit::{self, Failure, Reply, Result};
use super::super::Context;
use super::guide::{self, Answer};
use super::standards::Standards;
use super::{hang, picture, Bench};
use crate::cli::connection::Connection;
use crate::cli::values;
use calibrate::picture::{bars, Bar};
use calibrate::standin::{Mistake, Weights};
use calibrate::weights::{self, Mean};
use calibrate::{cells, CalibrateError};
use calibration::gain::Options;
use calibration::record::UnitRecord;
use clap::{Args, ValueEnum};
use known::checks::{self, Check as Checked, Validity};
use serde_json::json;
use session::Session;
use std::fmt::Write as _;
use std::path::PathBuf;
use wire::UNITS;

/// Where the weight hangs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Where {
    /// On each cell, as for the gains
    Cells,
    /// On the tip, which the cables alone carry: gains, zeros and geometry together
    Tip,
}

/// Arguments of `calibrate check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Where the weight hangs
    #[arg(long, value_name = "WHERE", value_enum, default_value_t = Where::Cells)]
    at: Where,
    /// Units to check [default: all whose gain was measured]
    #[arg(long, value_name = "N", num_args = 1..)]
    unit: Vec<u8>,
    /// The weight, g: not of the set of the calibration, or the check tells nothing of that. At the
    /// tip with ring and cord
    #[arg(long, value_name = "GRAM", default_value_t = 500.0, value_parser = super::gain::weight)]
    pub(super) weight: f64,
    /// At the tip: time for which the cables carry it
    #[arg(long, value_name = "SECONDS", default_value = "40", value_parser = values::seconds)]
    pub(super) duration: f64,
    /// At the tip: standard deviation of a coordinate of the place at which it is let go, mm
    /// [default: position_sd_mm of `[pose]` in the rig file, else what is usual for its source]
    #[arg(long, value_name = "MM", value_parser = values::pose_sd_mm)]
    pub(super) pose_sd: Option<f64>,
    #[command(flatten)]
    pub(super) standards: Standards,
    /// Ask nothing: on an emulated rig, where a stand-in hangs the weight
    #[arg(long)]
    pub(super) yes: bool,
    /// Mistake of the stand-in: weight=500:495 (495 g is hung for 500 g, once); repeatable
    #[arg(long, value_name = "MISTAKE")]
    pub(super) inject: Vec<Mistake>,
    /// Folder for the picture of the history
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    pub(super) connection: Connection,
}

/// Codes of one unit: empty, loaded, empty again.
struct Seen {
    unit: u8,
    means: Vec<Mean>,
}

impl Check {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.standards.check()?;
        let bench = Bench::tested(&self.connection, context)?;
        let units = self.units(&bench)?;
        let options = self.standards.options();
        if let Some(note) = self.standards.note() {
            context.output.note(note);
        }
        if self.at == Where::Tip {
            if !self.unit.is_empty() {
                return Err(Failure::usage(
                    "--unit is for a weight on the cells: the tip hangs in all cables",
                ));
            }
            return self.tip(&bench, &options, context);
        }
        let rig = bench.calibrated();
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        cells::prepare(&mut session, &rig)?;
        let seed = session.link().controls().map(|controls| controls.seed());
        if seed.is_none() && (self.yes || !self.inject.is_empty()) {
            return Err(Failure::usage(
                "--yes and --inject work with an emulated rig only: nobody hangs the weight here",
            ));
        }
        let mut standin = seed.map(|seed| Weights::new(seed, &self.inject));
        let groups: Vec<Vec<u8>> = if self.yes {
            vec![units]
        } else {
            units.iter().map(|unit| vec![*unit]).collect()
        };
        let mut seen = Vec::new();
        for group in &groups {
            seen.extend(self.weigh(group, &bench, &mut session, &mut standin, context)?);
        }
        let today = known::today();
        let found: Vec<Checked> = seen
            .iter()
            .filter_map(|seen| judge(seen, &bench, &options, self.weight, &today))
            .collect();
        bench.store.add_checks(&found)?;
        self.reply(&bench, &seen, &found, &today, context)
    }

    fn units(&self, bench: &Bench) -> Result<Vec<u8>> {
        let measured: Vec<u8> = (bench.record.units.iter())
            .filter(|unit| !unit.gain_date.is_empty())
            .map(|unit| unit.number)
            .collect();
        if measured.is_empty() {
            return Err(Failure::usage(
                "no gain of this rig was measured yet: `forcectl calibrate gain`",
            ));
        }
        if let Some(wrong) = self.unit.iter().find(|unit| !measured.contains(unit)) {
            return Err(Failure::usage(format!(
                "the gain of unit {wrong} was not measured: `forcectl calibrate gain --unit {wrong}`"
            )));
        }
        Ok(if self.unit.is_empty() {
            measured
        } else {
            self.unit.clone()
        })
    }

    /// Reads the cells of a group empty, loaded and empty again.
    fn weigh(
        &self,
        group: &[u8],
        bench: &Bench,
        session: &mut Session<'_>,
        standin: &mut Option<Weights>,
        context: &Context,
    ) -> Result<Vec<Seen>> {
        let mut seen: Vec<Seen> = (group.iter())
            .map(|unit| Seen {
                unit: *unit,
                means: Vec::new(),
            })
            .collect();
        let who = match group {
            [unit] => format!("unit {unit}"),
            _ => "all units".to_owned(),
        };
        for weight_g in [0.0, self.weight, 0.0] {
            let what = if weight_g > 0.0 {
                format!("hang {weight_g} g as for the calibration")
            } else {
                "take all weights off".to_owned()
            };
            let prompt = format!("{who}: {what}, let it come to rest, then press Enter (q: stop)");
            if !self.yes && guide::ask(&prompt)? == Answer::Quit {
                return Err(guide::broken_off(0, 1, "checks"));
            }
            if let Some(standin) = standin {
                let force_n = if weight_g > 0.0 {
                    standin.force_n(weight_g)
                } else {
                    0.0
                };
                hang(session, group, force_n)?;
            }
            let stop = context.interrupt.flag();
            cells::codes(session, weights::SETTLE, &stop, &mut |_| {})?;
            let codes: [Vec<i32>; UNITS] =
                cells::codes(session, weights::READ, &stop, &mut |_| {})?;
            for seen in &mut seen {
                let at = (bench.rig.units.iter())
                    .position(|unit| unit.number == seen.unit)
                    .unwrap_or_default();
                let scale = bench.rig.units[at].scale_n_per_count;
                let limit_n = weights::drift_limit_n(self.weight, true);
                let mean = weights::mean(&codes[at], scale, limit_n).map_err(|error| {
                    CalibrateError::refused(format!("unit {}: {error}", seen.unit))
                })?;
                seen.means.push(mean);
            }
        }
        Ok(seen)
    }

    fn reply(
        &self,
        bench: &Bench,
        seen: &[Seen],
        found: &[Checked],
        today: &str,
        context: &Context,
    ) -> Result<Reply> {
        let mut text =
            "unit   weight, N   by the cell, N   off, mN   +- 95 %, mN      En   zero returns, mN   verdict\n"
                .to_owned();
        let mut rows = Vec::new();
        for (seen, check) in seen.iter().zip(found) {
            let unit = unit_of(bench, seen.unit);
            let returns = unit.map_or(f64::NAN, |unit| {
                (seen.means[2].code - seen.means[0].code) * unit.n_per_code
            });
            let verdict = if check.passes() {
                "holds"
            } else {
                "DOES NOT HOLD"
            };
            row!(
                text,
                "{:>4} {:>11.4} {:>16.4} {:>9.1} {:>13.1} {:>7.2} {:>18.1}   {verdict}",
                seen.unit,
                check.force_n,
                check.measured_n,
                1e3 * (check.measured_n - check.force_n),
                1e3 * check.uncertainty_95_n,
                check.en(),
                1e3 * returns
            );
            rows.push(json!({"unit": check.unit, "force_n": check.force_n, "measured_n": check.measured_n,
                "uncertainty_95_n": check.uncertainty_95_n, "en": check.en(), "zero_returns_n": returns, "holds": check.passes()}));
        }
        let fails: Vec<String> = (found.iter())
            .filter(|check| !check.passes())
            .filter_map(|check| Some(check.unit?.to_string()))
            .collect();
        if fails.is_empty() {
            row!(text, "the calibration holds (|En| of at most 1)");
        } else {
            row!(
                text,
                "the calibration of unit {} does not hold: is it the right weight, at rest, and the cable slack? Then `forcectl calibrate gain`",
                fails.join(", ")
            );
        }
        self.with_history(bench, text, &rows, fails.is_empty(), today, context)
    }

    /// The answer: the table, the age of the calibration, and the picture of all checks.
    pub(super) fn with_history(
        &self,
        bench: &Bench,
        mut text: String,
        rows: &[serde_json::Value],
        holds: bool,
        today: &str,
        context: &Context,
    ) -> Result<Reply> {
        let age = checks::age_days(&bench.record, today);
        if let Some(days) = age {
            row!(text, "the oldest gain is {days} days old");
        }
        let validity = Validity::of(&bench.record, today);
        if let Some(warning) = validity.as_ref().and_then(Validity::warning) {
            row!(text, "{warning}");
        }
        let history = bench.store.checks()?;
        let svg = history_picture(&history);
        let path = picture(&self.out, "calibrate-check.svg", &svg)?;
        context.output.note(&format!(
            "history of {} checks: {}",
            history.len(),
            path.display()
        ));
        let reply = Reply::new(
            text,
            json!({"checks": rows, "holds": holds, "age_days": age, "validity": validity}),
        );
        Ok(if holds {
            reply
        } else {
            reply.with_code(exit::DEGRADED)
        })
    }
}

fn unit_of(bench: &Bench, number: u8) -> Option<&UnitRecord> {
    bench.record.units.iter().find(|u| u.number == number)
}

/// The force by the cell against that of the weight.
fn judge(
    seen: &Seen,
    bench: &Bench,
    options: &Options,
    weight_g: f64,
    today: &str,
) -> Option<Checked> {
    let unit = unit_of(bench, seen.unit)?;
    let [before, loaded, after] = seen.means[..] else {
        return None;
    };
    let code = loaded.code - 0.5 * (before.code + after.code);
    let measured_n = (unit.n_per_code + unit.n_per_code2 * code) * code;
    let force_n = options.force_n(weight_g);
    let scale_sd = (unit.scale_relative_sd(force_n)).hypot(bench.record.common_gain_relative_sd);
    let read_sd_n = unit.n_per_code
        * (loaded.standard_error)
            .hypot(0.5 * before.standard_error)
            .hypot(0.5 * after.standard_error);
    // Half of what the zero moved, as a rectangle; what the hand does from one time to the next;
    // the loop of the cell.
    let moved_n = 0.5 * (after.code - before.code) * unit.n_per_code / 3f64.sqrt();
    let gain = unit.gain.as_ref();
    let hand_n = gain.map_or(0.0, |gain| gain.repeatability_n);
    let loop_n = gain.map_or(0.0, |gain| gain.hysteresis_sd_n());
    let parts = [
        force_n * scale_sd,
        force_n * options.force_relative_sd(weight_g),
        read_sd_n,
        moved_n,
        hand_n,
        loop_n,
    ];
    let sd_n = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
    Some(Checked {
        date: today.to_owned(),
        unit: Some(seen.unit),
        weight_g,
        force_n,
        measured_n,
        uncertainty_95_n: 2.0 * sd_n,
        calibration: bench.record.gains_hash(),
    })
}

/// Checks that a picture shows: the newest.
const SHOWN: usize = 60;

/// All checks as bars, the newest at the bottom.
pub(super) fn history_picture(history: &[Checked]) -> String {
    let rows: Vec<Bar> = history[history.len().saturating_sub(SHOWN)..]
        .iter()
        .map(|check| Bar {
            label: format!("{}, {}", check.date, check.what()),
            value: 1e3 * (check.measured_n - check.force_n),
            sd: 0.5e3 * check.uncertainty_95_n,
        })
        .collect();
    let title = "checks: by the cell less the weight, on the 95 % uncertainty";
    bars(title, "mN", &rows).to_svg()
}
