//! `calibrate zero` and `calibrate gain`.

use super::super::connection::Connection;
use super::super::exit::{self, Failure, Reply, Result};
use super::super::progress::Progress;
use super::super::Context;
use super::guide::{self, Answer};
use super::{picture, push, read, Bench};
use calibration::gain::{Options, WEIGHTS_G};
use calibration::STANDARD_GRAVITY_M_PER_S2;
use clap::Args;
use emulator_link::Injection;
use host_cli::calibrate::picture::{bars, Bar};
use host_cli::calibrate::standin::{Mistake, Weights};
use host_cli::calibrate::weights::{self, Fitted, Load};
use host_cli::calibrate::{cells, zeros, CalibrateError};
use host_cli::session::Session;
use nalgebra::Vector3;
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use wire::UNITS;

/// Arguments of `calibrate zero`.
#[derive(Debug, Args)]
pub struct Zero {
    /// Accept zeros that are far from those of earlier power-ups: a new cell, a unit that was turned
    #[arg(long)]
    replace: bool,
    /// Time over which the zeros are measured
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = super::super::values::seconds)]
    duration: f64,
    /// Mass of motor and rack that hang on each cell, kg
    #[arg(long, value_name = "KG", default_value_t = zeros::MOTOR_KG.0)]
    motor_kg: f64,
    /// Ask nothing: the cables are slack
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    connection: Connection,
}

impl Zero {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        if !(0.0..=10.0).contains(&self.motor_kg) {
            return Err(Failure::new(exit::USAGE, "--motor-kg has to be 0 to 10 kg"));
        }
        let mut bench = Bench::load(&self.connection, context)?;
        let rig = bench.calibrated();
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        cells::prepare(&mut session, &rig)?;
        if !self.yes {
            let prompt =
                "Let all cables hang slack and keep the robot still, then press Enter (q: stop)";
            if guide::ask(prompt)? == Answer::Quit {
                return Err(guide::broken_off(0, 1, "zeros"));
            }
        }
        let stop = context.interrupt.flag();
        let mut progress = Progress::new(&context.output);
        let all = cells::codes(
            &mut session,
            Duration::from_secs_f64(self.duration),
            &stop,
            &mut |part| progress.at("reading the slack cells", part),
        );
        progress.done();
        let codes: Vec<(u8, Vec<i32>)> = all?
            .into_iter()
            .zip(&rig.units)
            .filter(|(_, unit)| unit.enabled)
            .map(|(codes, unit)| (unit.number, codes))
            .collect();
        let earlier = zeros::history(&bench.store)?;
        let found = zeros::evaluate(
            &codes,
            &mut bench.record,
            &earlier,
            &zeros::Options {
                replace: self.replace,
                motor_kg: (self.motor_kg, zeros::MOTOR_KG.1),
                down: -Vector3::z(),
            },
        )?;
        let kept = bench.keep(context)?;
        zeros::remember(&bench.store, &earlier, &found, &bench.record, self.replace)?;
        let in_force: Vec<(u8, i32)> = found
            .iter()
            .map(|f| (f.unit, f.zero.at_end_codes.round() as i32))
            .collect();
        let units = push(&mut session, &bench.calibrated(), &in_force)?;
        Ok(zero_reply(&found, &kept.version, units))
    }
}

fn zero_reply(found: &[zeros::Found], version: &str, units: usize) -> Reply {
    let mut text =
        "unit   zero, codes    +-    noise   mounting angle, N       converter, N   power-ups\n"
            .to_owned();
    for f in found {
        row!(
            text,
            "{:>4} {:>13.0} {:>5.0} {:>8.0} {:>10.3} +- {:.3} {:>10.3} +- {:.3}   {}",
            f.unit,
            f.zero.at_end_codes,
            f.zero.at_end_se_codes,
            f.zero.noise_sd_codes,
            f.parts.mounting_n,
            f.parts.mounting_sd_n,
            f.parts.converter_n,
            f.parts.converter_sd_n,
            match f.verdict {
                calibration::zero::Verdict::First => "first".to_owned(),
                calibration::zero::Verdict::Plausible { z } => format!("as before ({z:+.1} sd)"),
                _ => "replaced".to_owned(),
            }
        );
    }
    row!(
        text,
        "version {version}; in force on the board, {units} units read back and compared"
    );
    let rows: Vec<_> = found
        .iter()
        .map(|f| {
            json!({"unit": f.unit, "zero_codes": f.zero.at_end_codes, "zero_se_codes": f.zero.at_end_se_codes,
                   "mounting_n": f.parts.mounting_n, "converter_n": f.parts.converter_n})
        })
        .collect();
    Reply::new(text, json!({"version": version, "zeros": rows}))
}

/// Arguments of `calibrate gain`.
#[derive(Debug, Args)]
pub struct Gain {
    /// Units to calibrate [default: all that are enabled]
    #[arg(long, value_name = "N", num_args = 1..)]
    unit: Vec<u8>,
    /// Readings of one unit (CSV: weight_g, code, standard_error, ...) instead of reading the rig; `-`: standard input
    #[arg(long, value_name = "FILE")]
    readings: Option<PathBuf>,
    /// Weights that are hung, g
    #[arg(long, value_name = "GRAM", num_args = 1.., default_values_t = WEIGHTS_G)]
    weights: Vec<f64>,
    /// Times that the weights are put on and taken off
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=20))]
    rounds: u8,
    /// Local acceleration of gravity, m/s^2
    #[arg(long, value_name = "G", default_value_t = STANDARD_GRAVITY_M_PER_S2)]
    gravity: f64,
    /// Relative standard uncertainty of it
    #[arg(long, value_name = "PART", default_value_t = 0.001)]
    gravity_sd: f64,
    /// Largest relative error of the weights
    #[arg(long, value_name = "PART", default_value_t = 0.001)]
    tolerance: f64,
    /// Correct the weight of a line of the readings, as in 5=50; repeatable
    #[arg(long, value_name = "LINE=GRAM", value_parser = correction)]
    correct: Vec<(usize, f64)>,
    /// Leave out a line of the readings; repeatable
    #[arg(long, value_name = "LINE")]
    leave_out: Vec<usize>,
    /// Begin anew instead of going on with what is kept of a series that was broken off
    #[arg(long)]
    restart: bool,
    /// Ask nothing: with --readings, or on an emulated rig, where a stand-in hangs the weights on all units at once
    #[arg(long)]
    yes: bool,
    /// Mistake of the stand-in, as in weight=50:500 (500 g is hung for 50 g, once); repeatable
    #[arg(long, value_name = "MISTAKE")]
    inject: Vec<Mistake>,
    /// Folder for the pictures of the residuals
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

fn correction(text: &str) -> std::result::Result<(usize, f64), String> {
    let parsed = text
        .split_once('=')
        .and_then(|(line, gram)| Some((line.parse().ok()?, gram.parse().ok()?)));
    parsed.ok_or_else(|| format!("`{text}` is not LINE=GRAM, for example 5=50"))
}

impl Gain {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let mut bench = Bench::load(&self.connection, context)?;
        let enabled = bench.rig.units.iter().filter(|unit| unit.enabled);
        let units: Vec<u8> = if self.unit.is_empty() {
            enabled.map(|unit| unit.number).collect()
        } else {
            self.unit.clone()
        };
        if let Some(wrong) = units
            .iter()
            .find(|u| !bench.rig.units.iter().any(|unit| unit.number == **u))
        {
            return Err(Failure::new(
                exit::USAGE,
                format!("there is no unit {wrong}"),
            ));
        }
        if let Some(path) = &self.readings {
            let [unit] = units[..] else {
                return Err(Failure::new(
                    exit::USAGE,
                    "--readings has the readings of one unit: name it with --unit N",
                ));
            };
            let (name, text) = read(path)?;
            let fitted = self.fit(&bench, unit, &name, &text)?;
            return self.finish(&mut bench, vec![(unit, fitted)], false, context);
        }
        let _controlled_stop = context.interrupt.controlled_stop();
        let rig = bench.calibrated();
        let mut link = self.connection.open(&rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        cells::prepare(&mut session, &rig)?;
        let seed = session.link().controls().map(|controls| controls.seed());
        if self.yes && seed.is_none() {
            return Err(Failure::new(
                exit::USAGE,
                "--yes needs --readings FILE here: nobody hangs weights on a real rig unattended",
            ));
        }
        if seed.is_none() && !self.inject.is_empty() {
            return Err(Failure::new(
                exit::USAGE,
                "--inject works with an emulated rig only",
            ));
        }
        let mut standin = seed.map(|seed| Weights::new(seed, &self.inject));
        let groups: Vec<Vec<u8>> = if self.yes {
            vec![units.clone()]
        } else {
            units.iter().map(|unit| vec![*unit]).collect()
        };
        for group in &groups {
            self.series(&bench, &mut session, group, &mut standin, context)?;
        }
        let mut fitted = Vec::new();
        for unit in units {
            let draft = bench.store.draft(&format!("gain-unit{unit}"));
            let text = draft.text()?.unwrap_or_default();
            let name = draft.path().display().to_string();
            fitted.push((unit, self.fit(&bench, unit, &name, &text)?));
        }
        let reply = self.finish(&mut bench, fitted, true, context)?;
        push(&mut session, &bench.calibrated(), &[])?;
        Ok(reply)
    }

    fn options(&self, bench: &Bench, unit: u8) -> Options {
        let nominal = bench.rig.units.iter().find(|u| u.number == unit);
        let mut weights_g = WEIGHTS_G.to_vec();
        weights_g.extend(self.weights.iter().filter(|w| !WEIGHTS_G.contains(w)));
        Options {
            gravity_m_per_s2: self.gravity,
            gravity_relative_sd: self.gravity_sd,
            weight_limit_relative: self.tolerance,
            weights_g,
            nominal_n_per_code: nominal.map(|unit| unit.scale_n_per_count.abs()),
            left_out: self.leave_out.clone(),
            corrections_g: self.correct.iter().copied().collect(),
        }
    }

    fn fit(&self, bench: &Bench, unit: u8, name: &str, text: &str) -> Result<Fitted> {
        Ok(weights::fit(name, text, &self.options(bench, unit))?)
    }

    /// Takes the readings of a group of units, from where a series that was broken off stopped.
    fn series(
        &self,
        bench: &Bench,
        session: &mut Session<'_>,
        group: &[u8],
        standin: &mut Option<Weights>,
        context: &Context,
    ) -> Result<()> {
        let plan = weights::plan(&self.weights, usize::from(self.rounds));
        let drafts: Vec<_> = group
            .iter()
            .map(|unit| bench.store.draft(&format!("gain-unit{unit}")))
            .collect();
        if self.restart {
            for draft in &drafts {
                draft.discard()?;
            }
        }
        let who = match group {
            [unit] => format!("unit {unit}"),
            _ => "all units".to_owned(),
        };
        let mut done = usize::MAX;
        for draft in &drafts {
            done = done.min(draft.rows()?);
        }
        if done > 0 {
            context.output.note(&format!(
                "{who}: {done} of {} readings are kept from before; going on (--restart begins anew)",
                plan.len()
            ));
        }
        let stop = context.interrupt.flag();
        let mut progress = Progress::new(&context.output);
        let mut time_s = 2.0 * done as f64;
        while done < plan.len() {
            let load = plan[done];
            if !self.yes {
                match guide::ask(&instruction(&who, &load, done, plan.len()))? {
                    Answer::Undo if done > 0 => {
                        drafts.iter().try_for_each(|draft| draft.undo())?;
                        done -= 1;
                        continue;
                    }
                    Answer::Undo => continue,
                    Answer::Quit => return Err(guide::broken_off(done, plan.len(), "readings")),
                    Answer::Go(_) => {}
                }
            }
            if let Some(standin) = standin {
                hang(session, group, standin.force_n(load.weight_g))?;
            }
            let part = done as f64 / plan.len() as f64;
            let read = take(session, bench, group, &stop, &mut || {
                progress.at("weighing", part);
            });
            match read {
                Ok(means) => {
                    for (draft, mean) in drafts.iter().zip(means) {
                        // A group that was broken off between two of its files.
                        if draft.rows()? == done {
                            weights::keep(draft, &load, mean, time_s)?;
                        }
                    }
                    done += 1;
                }
                Err(CalibrateError::Refused(why)) if !self.yes => {
                    progress.beside(|output| {
                        output.error(&format!("{why}\nlet the weight come to rest and try again"));
                    });
                }
                Err(error) => {
                    progress.done();
                    if standin.is_some() {
                        hang(session, group, 0.0)?;
                    }
                    return Err(error.into());
                }
            }
            time_s += (weights::SETTLE + weights::READ).as_secs_f64();
        }
        progress.done();
        if standin.is_some() {
            hang(session, group, 0.0)?;
        }
        Ok(())
    }

    /// Stores gains, writes their pictures and prints them.
    fn finish(
        &self,
        bench: &mut Bench,
        fitted: Vec<(u8, Fitted)>,
        drafted: bool,
        context: &Context,
    ) -> Result<Reply> {
        let before = bench.record.clone();
        for (unit, found) in &fitted {
            let options = self.options(bench, *unit);
            weights::apply(&mut bench.record, *unit, &found.gain, &options)?;
        }
        let kept = bench.keep(context)?;
        let mut text = "unit      N per code    +- 95 %   readings   weights   gravity   linearity   hysteresis   change\n".to_owned();
        let mut rows = Vec::new();
        for (unit, found) in &fitted {
            let g = &found.gain;
            let old = before
                .units
                .iter()
                .find(|u| u.number == *unit)
                .map_or(f64::NAN, |u| u.n_per_code);
            let change = 100.0 * (g.n_per_code / old - 1.0);
            let hysteresis = found.shape.hysteresis.map(|h| 1e3 * h.largest_n);
            row!(
                text,
                "{unit:>4} {:>15.6e} {:>8.3} % {:>8.3} % {:>7.3} % {:>7.3} % {:>8.1} mN {:>9} mN {change:>+7.2} %",
                g.n_per_code,
                100.0 * g.n_per_code_half_95 / g.n_per_code.abs(),
                100.0 * g.relative_parts.readings,
                100.0 * g.relative_parts.weights,
                100.0 * g.relative_parts.gravity,
                1e3 * found.shape.linearity_n,
                hysteresis.map_or_else(|| "-".to_owned(), |h| format!("{h:.1}")),
            );
            for (term, c) in &g.terms {
                row!(
                    text,
                    "       {term:?}: {:.4e} +- {:.1e} (p {:.1e})",
                    c.value,
                    c.standard_error,
                    c.p
                );
            }
            if drafted {
                bench
                    .store
                    .draft(&format!("gain-unit{unit}"))
                    .finish(&kept.version)?;
            }
            let svg = residual_picture(*unit, found);
            let path = picture(&self.out, &format!("calibrate-gain-unit{unit}.svg"), &svg)?;
            context
                .output
                .note(&format!("residuals: {}", path.display()));
            rows.push(json!({"unit": unit, "n_per_code": g.n_per_code, "n_per_code_half_95": g.n_per_code_half_95,
                "n_per_code2": weights::curvature(g), "linearity_n": found.shape.linearity_n,
                "hysteresis_n": found.shape.hysteresis.map(|h| h.largest_n), "readings": found.readings}));
        }
        row!(text, "version {}", kept.version);
        Ok(Reply::new(
            text,
            json!({"version": kept.version, "gains": rows}),
        ))
    }
}

fn residual_picture(unit: u8, found: &Fitted) -> String {
    let rows: Vec<Bar> = found
        .gain
        .residuals
        .iter()
        .map(|r| Bar {
            label: format!("line {}: {:.3} N", r.at.line, r.force_n),
            value: 1e3 * r.residual_n,
            sd: 1e3 * r.sd_n,
        })
        .collect();
    let title = format!("unit {unit}: measured less fitted, on a band of two standard deviations");
    bars(&title, "mN", &rows).to_svg()
}

fn instruction(who: &str, load: &Load, done: usize, of: usize) -> String {
    let what = if load.weight_g == 0.0 {
        "take all weights off".to_owned()
    } else {
        format!("hang {} g", load.weight_g)
    };
    format!(
        "{who}, reading {} of {of}: {what}, let it come to rest, then press Enter (u: undo the last reading, q: stop here)",
        done + 1
    )
}

/// Pulls on the cells of a group of an emulated rig.
fn hang(session: &mut Session<'_>, group: &[u8], force_n: f64) -> Result<()> {
    if let Some(controls) = session.link().controls() {
        for unit in group {
            controls.inject(Injection::PullCable(*unit, force_n))?;
        }
    }
    Ok(())
}

/// Mean codes of a group after it has settled.
fn take(
    session: &mut Session<'_>,
    bench: &Bench,
    group: &[u8],
    stop: &AtomicBool,
    tick: &mut dyn FnMut(),
) -> host_cli::calibrate::Result<Vec<(f64, f64)>> {
    let mut quiet = |_: f64| {};
    cells::codes(session, weights::SETTLE, stop, &mut quiet)?;
    tick();
    let codes: [Vec<i32>; UNITS] = cells::codes(session, weights::READ, stop, &mut quiet)?;
    group
        .iter()
        .map(|unit| {
            let at = bench.rig.units.iter().position(|u| u.number == *unit);
            let at = at.unwrap_or_default();
            weights::mean(&codes[at], bench.rig.units[at].scale_n_per_count).map_err(|error| {
                match error {
                    CalibrateError::Refused(why) => {
                        CalibrateError::Refused(format!("unit {unit}: {why}"))
                    }
                    other => other,
                }
            })
        })
        .collect()
}
