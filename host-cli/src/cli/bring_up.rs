//! `forcectl bring-up`: leads through the first power-up of a rig, and names the mistakes of its
//! wiring.

use super::calibrate::guide::{ask_while, Answer as Typed};
use super::connection::{Connection, EMBEDDED};
use super::exit::{self, Failure, Reply, Result};
use super::Context;
use ::bring_up::hands::{emulated, Action, Answer, Hands};
use ::bring_up::record::{read, write, Again, Identity, Record, Verdict};
use ::bring_up::steps::{Bench, Plan, Test};
use ::bring_up::{record, BringUpError};
use clap::Args;
use emulator_link::Injection;
use known::store::Store;
use rig::Rig;
use serde_json::json;
use session::{Session, PERIOD};
use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use wire::message::BoardInfo;
use wire::UNITS;

/// Below the help of the command.
pub const HELP: &str = "\
Tests, in their order:
  board       clock, brown-out level, latched faults
  converters  sample rates, missed samples, noise; one converter at a time is started anew: whose DRDY line is silent?
  estop       you press the E-stop and release it
  reels       you pull each cable out by 200 mm: its encoder and its load cell have to answer, and no other
  weights     you hang a known weight on each cable (with --weight)
  power       you unplug the alive line at the PLC: pulses of the motors must move nothing then. You say whether the
              amplifiers' lamps are lit, also with the E-stop pressed
  motors      pulses of 12 ms that the board ends by itself, from 0.3 N up, until an encoder or a load cell answers; at most
              1.3 N blind. Only with an E-stop that was seen to work
  tension     you fix the cables' ends: each cable is wound in slowly, loaded with about 1 N, and shaken by a chirp of 1 to
              12 Hz: friction, gain and delay of its drive. Only where no test before has found a mistake

What was measured is kept in the rig's record, in the folder of its calibration. The same command goes on with what is not done
yet, and repeats what found a mistake. On an emulated rig of the command's own it does by itself what you would do.
Commands that drive the rig or store something about it refuse one of which a part was exchanged since, its board included, or a setting
of the rig file was changed that a test judges by (scales of load cell, encoder and DAC, friction); so does the rig's service. They do until
the tests that were done before are done with what is new. After a changed setting these are the tests of its unit that judge by it.

Exit codes:
  0  every test is done, and none found a mistake
  2  the arguments are wrong; nothing was driven
  3  the rig file is wrong; nothing was driven
  4  the link cannot be opened, was lost, or the other end is not a board of this version
  5  the board refused a command, or a fault stopped the rig
  6  a mistake is named, or a test is not done
  7  a file or the standard output could not be written
130  Ctrl-C, SIGTERM or SIGHUP ended the command; the motors are at 0 V";

/// Arguments of `bring-up`.
#[derive(Debug, Args)]
pub struct BringUp {
    /// Test this unit only; repeatable
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=UNITS as i64))]
    unit: Vec<u8>,
    /// Repeat the tests from this one on: board, converters, estop, reels, weights, power, motors
    /// or tension
    #[arg(long, value_name = "TEST")]
    from: Option<Test>,
    /// Forget what was measured before, and begin anew
    #[arg(long)]
    restart: bool,
    /// Known weight, g; without it the test of the load cells' scale is left open
    #[arg(long, value_name = "GRAM", value_parser = gram)]
    weight: Option<f64>,
    /// How far each cable is pulled out, mm, 50 to 500
    #[arg(long, value_name = "MM", default_value = "200", value_parser = millimetres)]
    pull: f64,
    /// Ask nothing: for an emulated rig, and for tests that need no hands
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    connection: Connection,
    /// Wire the embedded rig wrongly, for example exchange-motors=1:4@start; repeatable.
    /// `--inject help` lists the faults
    #[arg(long, value_name = "WHAT@start", help_heading = EMBEDDED, value_parser = session::inject::parse, allow_hyphen_values = true)]
    inject: Vec<(f64, Injection)>,
}

fn gram(text: &str) -> std::result::Result<f64, String> {
    within(text, 50.0..=2_000.0, "g")
}

fn millimetres(text: &str) -> std::result::Result<f64, String> {
    within(text, 50.0..=500.0, "mm")
}

fn within(
    text: &str,
    range: std::ops::RangeInclusive<f64>,
    of: &str,
) -> std::result::Result<f64, String> {
    (text.parse().ok())
        .filter(|value| range.contains(value))
        .ok_or_else(|| {
            format!(
                "a number of {} to {} {of} is needed",
                range.start(),
                range.end()
            )
        })
}

impl From<BringUpError> for Failure {
    fn from(error: BringUpError) -> Self {
        match error {
            BringUpError::Session(error) => error.into(),
            BringUpError::Store(error) => error.into(),
            BringUpError::Armed => Self::new(exit::BOARD, error),
            BringUpError::Stopped => Self::new(exit::INTERRUPTED, error),
            BringUpError::Question(_) => Self::new(exit::DEGRADED, error),
        }
    }
}

impl BringUp {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = (self.connection).load_for(context, &[("--inject", !self.inject.is_empty())])?;
        if self.inject.iter().any(|(at_s, _)| at_s.is_finite()) {
            return Err(Failure::usage(
                "a mistake of wiring is there from the start: --inject WHAT@start",
            ));
        }
        self.connection.require_rig_file(&rig)?;
        let store = Store::of_rig(&rig.name, self.connection.seed(&rig))?;
        let units = self.units(&rig)?;
        let of_file = rig.clone();
        let rig = self.connection.calibrated(rig, context)?;
        let stop = context.interrupt.flag();
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open_to_test(&rig, context)?;
        if let Some(controls) = link.controls() {
            for (_, injection) in &self.inject {
                controls.inject(*injection)?;
            }
        }
        let mut session = Session::connect(link.as_mut())?;
        let board = session.info().and_then(BoardInfo::number);
        let board = board.map(|number| number.as_str().to_owned());
        let identity = Identity::of(&of_file, &store, board)?;
        let mut record = self.record(&of_file, &store, identity, context)?;
        let next = match self.from {
            Some(from) => Test::ALL.into_iter().filter(|test| *test >= from).collect(),
            None => record.next(&units),
        };
        let plan = Plan {
            units: units.clone(),
            pull_mm: self.pull,
            weight_n: self.weight.map(|gram| gram * 1e-3 * GRAVITY_M_PER_S2),
            stop: &stop,
        };
        let mut person = Person {
            context,
            yes: self.yes,
            stop: Arc::clone(&stop),
        };
        let mut bench = Bench::new(&mut session, &rig, &plan, &mut person)?;
        let ended = next.into_iter().try_for_each(|test| {
            if test.drives() {
                if let Err(why) = record.may_drive(test) {
                    context.output.note(&why);
                    return Ok(());
                }
            }
            context.output.note(&format!("\ntest `{test}`"));
            record.forget(test, &units);
            let known = record.mistakes.clone();
            let ended = bench.run(test, &mut record.figures);
            record.took(&rig, test, &units, &known::today());
            write(&store, &record)?;
            for named in (record.mistakes.iter()).filter(|named| !known.contains(named)) {
                let line = format!("  {}: {}", named.mistake, named.evidence);
                context.output.note(&line);
            }
            Ok(ended?)
        });
        let restored = bench.restore();
        ended.and(restored.map_err(Failure::from))?;
        Ok(reply(&record, &units, &store))
    }

    /// Units that are tested, from 0.
    fn units(&self, rig: &Rig) -> Result<Vec<usize>> {
        let asked = |unit: &usize| self.unit.is_empty() || self.unit.contains(&(*unit as u8 + 1));
        let units: Vec<usize> = (0..UNITS).filter(asked).collect();
        let (used, unused): (Vec<usize>, Vec<usize>) =
            units.into_iter().partition(|unit| rig.units[*unit].enabled);
        match unused.first() {
            Some(unit) if !self.unit.is_empty() => Err(Failure::usage(format!(
                "unit {} is not enabled in the rig file; nothing was driven",
                unit + 1
            ))),
            _ if used.is_empty() => Err(Failure::usage(
                "the rig file enables no unit; nothing was driven",
            )),
            _ => Ok(used),
        }
    }

    /// The rig's record to go on with.
    fn record(&self, rig: &Rig, store: &Store, now: Identity, context: &Context) -> Result<Record> {
        let Some(mut record) = read(store)? else {
            return Ok(Record::new(rig, now));
        };
        let changes = record.identity.changed(&now);
        for change in &changes {
            context
                .output
                .note(&format!("since the last bring-up {}", change.words));
        }
        if changes.iter().any(|change| change.again == Again::Rig) {
            context
                .output
                .note("a part was exchanged: every test begins anew");
            return Ok(record.anew(rig, now));
        }
        if self.restart {
            return Ok(record.anew(rig, now));
        }
        record.go_on(rig, now);
        Ok(record)
    }
}

/// Standard gravity, m/s^2: half a percent of it is far below what the scale is compared with.
const GRAVITY_M_PER_S2: f64 = 9.806_65;

/// The person at the terminal, or an emulated rig in his place.
struct Person<'a> {
    context: &'a Context,
    yes: bool,
    stop: Arc<AtomicBool>,
}

impl Hands for Person<'_> {
    fn act(
        &mut self,
        action: &Action,
        session: &mut Session<'_>,
    ) -> std::result::Result<Answer, BringUpError> {
        if self.yes || session.link().booted_here() {
            self.context.output.note(&format!("  {action}"));
            return emulated(action, session);
        }
        let mut lost = None;
        let question = matches!(action, Action::LookAtPower);
        let keys = if question {
            "y: yes; n: no"
        } else {
            "Enter: done"
        };
        let typed = ask_while(
            &format!("  {action}\n  {keys}; s: leave this out; q: stop here"),
            &mut || {
                if self.stop.load(Ordering::Relaxed) {
                    lost = Some(BringUpError::Stopped);
                } else if let Err(error) = session.exchange(PERIOD) {
                    lost = Some(error.into());
                }
                match lost {
                    Some(_) => Err(Failure::usage("broken off")),
                    None => Ok(()),
                }
            },
        );
        match (lost, typed) {
            (Some(error), _) => Err(error),
            (None, Ok(Typed::Go(text))) if text == "s" => Ok(Answer::Skip),
            (None, Ok(Typed::Go(text))) if question => match text.as_str() {
                "y" | "yes" => Ok(Answer::Done),
                "n" | "no" => Ok(Answer::No),
                _ => self.act(action, session),
            },
            (None, Ok(Typed::Go(_))) => Ok(Answer::Done),
            (None, Ok(Typed::Undo | Typed::Quit)) => Err(BringUpError::Stopped),
            (None, Err(failure)) => Err(BringUpError::Question(failure.message)),
        }
    }

    fn say(&mut self, text: &str) {
        self.context.output.note(&format!("  {text}"));
    }
}

/// The answer: text, JSON, exit code.
fn reply(record: &Record, units: &[usize], store: &Store) -> Reply {
    let verdict = record.verdict(units);
    let open = record.open(units);
    let path = record::path(store);
    let mut text = String::new();
    for (n, named) in record.mistakes.iter().enumerate() {
        row!(text, "{}. {}", n + 1, named.mistake);
        row!(text, "   seen: {} ({:?})", named.evidence, named.sure);
        row!(text, "   do:   {}", named.mistake.what_to_do());
    }
    for test in Test::ALL {
        let state = if open.contains(&test) {
            "not done".to_owned()
        } else {
            match record
                .mistakes
                .iter()
                .filter(|n| n.mistake.test() == test)
                .count()
            {
                0 => "passed".to_owned(),
                n => format!("{n} named"),
            }
        };
        row!(text, "{:<11} {state}", test.name());
    }
    row!(
        text,
        "{}; record: {}",
        match verdict {
            Verdict::Passed => "every test passed",
            Verdict::Failed => "correct what is named, then run the same command again",
            Verdict::Undecided => "no mistake so far; tests are open",
        },
        path.display()
    );
    let json = json!({
        "verdict": verdict,
        "mistakes": record.mistakes.iter().map(|named| json!({
            "mistake": named.mistake,
            "sure": named.sure,
            "words": named.mistake.to_string(),
            "evidence": named.evidence,
            "what_to_do": named.mistake.what_to_do(),
        })).collect::<Vec<_>>(),
        "open": open,
        "record": path.display().to_string(),
        "identity": record.identity,
        "figures": record.figures,
    });
    let code = match verdict {
        Verdict::Passed => exit::DONE,
        Verdict::Failed | Verdict::Undecided => exit::DEGRADED,
    };
    Reply::new(text, json).with_code(code)
}
