//! `calibrate zero`.

use super::super::connection::Connection;
use super::super::exit::{Failure, Reply, Result};
use super::super::progress::Progress;
use super::super::Context;
use super::guide::{self, Answer};
use super::{hang, Bench};
use calibrate::standin::Mistake;
use calibrate::{cells, weights, zeros, CalibrateError};
use clap::Args;
use nalgebra::Vector3;
use serde_json::json;
use session::Session;
use std::fmt::Write as _;
use std::time::Duration;
use wire::UNITS;

/// Arguments of `calibrate zero`.
#[derive(Debug, Args)]
pub struct Zero {
    /// Accept the zero of these units however far it is from those of earlier power-ups, and forget
    /// those: a new cell, a unit that was turned
    #[arg(long, value_name = "N", num_args = 1..)]
    replace: Vec<u8>,
    /// Time over which the zeros are measured
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = super::super::values::seconds)]
    duration: f64,
    /// Mass of motor and rack that hang on each cell, kg
    #[arg(long, value_name = "KG", default_value_t = zeros::MOTOR_KG.0)]
    motor_kg: f64,
    /// Read before and after each cable is paid out by hand: tells a cable that pulls from one that
    /// is slack for sure
    #[arg(long)]
    pay_out: bool,
    /// Ask nothing: the cables are slack; with --pay-out on an emulated rig, a stand-in pays them
    /// out
    #[arg(long)]
    yes: bool,
    /// Mistake of the stand-in, as in preload=3:0.8 (the cable of unit 3 pulls with 0.8 N until it
    /// is paid out); repeatable
    #[arg(long, value_name = "MISTAKE")]
    inject: Vec<Mistake>,
    #[command(flatten)]
    connection: Connection,
}

/// Time for which the cells are read before the cables are paid out.
const BEFORE_PAY_OUT: Duration = Duration::from_secs(3);

impl Zero {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        if !(0.0..=10.0).contains(&self.motor_kg) {
            return Err(Failure::usage("--motor-kg has to be 0 to 10 kg"));
        }
        let mut bench = Bench::tested(&self.connection, context)?;
        let rig = bench.calibrated();
        let enabled = |number: u8| {
            let mut units = rig.units.iter();
            units.any(|unit| unit.enabled && unit.number == number)
        };
        if let Some(wrong) = self.replace.iter().find(|unit| !enabled(**unit)) {
            return Err(Failure::usage(format!(
                "--replace {wrong}: no unit {wrong} is enabled on this rig"
            )));
        }
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        cells::prepare(&mut session, &rig)?;
        let all = self.slack_codes(&mut session, &bench, context)?;
        let codes: Vec<(u8, Vec<i32>)> = all
            .into_iter()
            .zip(&rig.units)
            .filter(|(_, unit)| unit.enabled)
            .map(|(codes, unit)| (unit.number, codes))
            .collect();
        let earlier = zeros::history(&bench.store, &bench.record)?;
        let found = zeros::evaluate(
            &codes,
            &mut bench.record,
            &earlier,
            &zeros::Options {
                replace: self.replace.clone(),
                motor_kg: (self.motor_kg, zeros::MOTOR_KG.1),
                down: -Vector3::z(),
            },
        )?;
        let kept = bench.keep(context)?;
        let in_force: Vec<(u8, i32)> = found.iter().map(|f| (f.unit, f.code())).collect();
        let units = cells::push(&mut session, &bench.calibrated(), &in_force)?;
        // Runs compare the board's zeros with these: they have to be in force. If this fails, the
        // next run asks for `forcectl zero`.
        zeros::remember(&bench.store, &rig.name, &found, &self.replace)?;
        Ok(zero_reply(&found, &self.replace, &kept.version, units))
    }

    /// The codes of the slack cells, after the cables were paid out where that is asked for.
    fn slack_codes(
        &self,
        session: &mut Session<'_>,
        bench: &Bench,
        context: &Context,
    ) -> Result<[Vec<i32>; UNITS]> {
        let emulated = session.link().controls().is_some();
        if !emulated && !self.inject.is_empty() {
            return Err(Failure::usage("--inject works with an emulated rig only"));
        }
        self.ask("Let all cables hang slack and keep the robot still, then press Enter (q: stop)")?;
        self.preload(session, 1.0)?;
        let duration = Duration::from_secs_f64(self.duration);
        let what = "reading the slack cells";
        if !self.pay_out {
            let codes = read(session, duration, what, context);
            self.preload(session, 0.0)?;
            return codes;
        }
        let before = read(session, BEFORE_PAY_OUT, "reading the cells", context)?;
        let from = cells::encoders(session)?;
        self.ask("Turn each reel by hand until 5 mm of its cable or more are paid out, then press Enter (q: stop)")?;
        self.preload(session, 0.0)?;
        let after = read(session, duration, what, context)?;
        let to = cells::encoders(session)?;
        let units = bench.rig.units.iter().enumerate();
        let cables: Vec<zeros::PaidOut> = units
            .filter(|(_, unit)| unit.enabled)
            .map(|(i, unit)| zeros::PaidOut {
                unit: unit.number,
                codes: [before[i].clone(), after[i].clone()],
                // Paid out is against the sign of the travel. A stand-in turns no reel.
                travel_m: (!emulated).then(|| {
                    let turned = to[i].zip(from[i]).map_or(0, |(b, a)| b.wrapping_sub(a));
                    -f64::from(turned) * unit.travel_m_per_count
                }),
            })
            .collect();
        zeros::check_paid_out(&cables, &bench.record)?;
        Ok(after)
    }

    fn ask(&self, prompt: &str) -> Result<()> {
        if !self.yes && guide::ask(prompt)? == Answer::Quit {
            return Err(guide::broken_off(0, 1, "zeros"));
        }
        Ok(())
    }

    /// Pulls on the cables that are to pull, or lets them go, and waits until the cells have
    /// settled.
    fn preload(&self, session: &mut Session<'_>, part: f64) -> Result<()> {
        for mistake in &self.inject {
            if let Mistake::Preload(unit, force_n) = mistake {
                hang(session, &[*unit], part * force_n)?;
                session
                    .exchange(weights::SETTLE)
                    .map_err(CalibrateError::from)?;
            }
        }
        Ok(())
    }
}

fn read(
    session: &mut Session<'_>,
    duration: Duration,
    what: &'static str,
    context: &Context,
) -> Result<[Vec<i32>; UNITS]> {
    let mut progress = Progress::new(&context.output);
    let stop = context.interrupt.flag();
    let codes = cells::codes(session, duration, &stop, &mut |part| {
        progress.at(what, part)
    });
    progress.done();
    Ok(codes?)
}

fn zero_reply(found: &[zeros::Found], replaced: &[u8], version: &str, units: usize) -> Reply {
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
                _ if replaced.contains(&f.unit) => "replaced".to_owned(),
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
