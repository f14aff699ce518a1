//! The readings of `calibrate gain`: weight after weight, kept one by one, so that a break loses
//! nothing.

use super::super::exit::Result;
use super::super::progress::Progress;
use super::super::Context;
use super::guide::{self, Answer};
use super::{hang, Bench};
use calibrate::load_time::{self, CameOn, Watch};
use calibrate::standin::{Cells, Weights};
use calibrate::weights::{self, Load, Mean};
use calibrate::{cells, CalibrateError};
use calibration::gain;
use known::store::Draft;
use run::RunError;
use session::{Session, PERIOD};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;
use wire::UNITS;

/// Cycles that an emulated person needs to reach for the first weight: 0.5 s.
const REACH_CYCLES: u32 = 50;

/// What is to be read, and how.
pub(super) struct Plan {
    /// The loads in their order.
    pub loads: Vec<Load>,
    /// What the drafts are called: `gain` or `iso376`.
    pub step: &'static str,
    /// How far a reading may drift, N.
    pub drift_n: f64,
    /// A stand-in hangs the weights, and nobody is asked.
    pub yes: bool,
    /// What is kept of an earlier series does not count.
    pub restart: bool,
}

/// The series of one group of units that is going on.
pub(super) struct Series<'p> {
    plan: &'p Plan,
    bench: &'p Bench,
    group: &'p [u8],
    who: String,
    drafts: Vec<Draft>,
    stop: Arc<AtomicBool>,
    /// Rows that are kept.
    done: usize,
    /// The weight may not hang although it is to stay: the series goes on within a hold, or a
    /// reading failed.
    hang_again: bool,
    /// Since when the load is on; `None` where that was not seen.
    since: Option<CameOn>,
    /// Codes since the last reading that is kept.
    watches: Vec<(u8, Watch)>,
    /// Codes of that reading; `None` where the weight may have been changed since.
    before: Option<Vec<Mean>>,
    /// Time of the series when this part of it began, s, and the link's time then, ns.
    begun: (f64, u64),
}

/// What the user wants.
enum Next {
    /// Read the load.
    Read,
    /// Ask again.
    Ask,
}

impl<'p> Series<'p> {
    /// Goes on where a series that was broken off stopped.
    pub fn begin(
        plan: &'p Plan,
        bench: &'p Bench,
        group: &'p [u8],
        session: &mut Session<'_>,
        context: &Context,
    ) -> Result<Self> {
        let drafts: Vec<_> = group
            .iter()
            .map(|unit| bench.store.draft(&format!("{}-unit{unit}", plan.step)))
            .collect();
        if plan.restart {
            drafts.iter().try_for_each(Draft::discard)?;
        }
        let mut done = usize::MAX;
        for draft in &drafts {
            done = done.min(draft.rows()?);
        }
        let begun_s = begun_s(&drafts)?;
        let series = Self {
            plan,
            bench,
            group,
            who: who(bench, group),
            drafts,
            stop: context.interrupt.flag(),
            done,
            hang_again: true,
            since: None,
            watches: group.iter().map(|unit| (*unit, Watch::default())).collect(),
            before: None,
            begun: (begun_s, session.now_ns()),
        };
        if done > 0 {
            context.output.note(&format!(
                "{}: {} of {} readings are kept from before; going on (--restart begins anew)",
                series.who,
                series.asked(done),
                series.asked(usize::MAX)
            ));
        }
        Ok(series)
    }

    /// Readings that the user was asked for among the first rows: a load that stays is read without
    /// a question.
    fn asked(&self, rows: usize) -> usize {
        let loads = self.plan.loads.iter().take(rows);
        loads.filter(|load| !load.stays).count()
    }

    /// Time of the series, s, of a time of the link, ns.
    fn time_s(&self, link_ns: u64) -> f64 {
        let (begun_s, begun_ns) = self.begun;
        begun_s + 1e-9 * link_ns.saturating_sub(begun_ns) as f64
    }

    /// Takes the readings that are left.
    pub fn run(
        mut self,
        session: &mut Session<'_>,
        standin: &mut Option<(Weights, Option<Cells>)>,
        context: &Context,
    ) -> Result<()> {
        if !self.plan.yes {
            context.output.note(LOADING);
        }
        let mut progress = Progress::new(&context.output);
        if standin.is_some() {
            // A person is not quicker. For 0.3 s after the power came, the board takes a cable that
            // tightens for an output that is stuck (fault 15).
            for _ in 0..REACH_CYCLES {
                session.exchange(PERIOD).map_err(CalibrateError::from)?;
            }
            session.drain();
        }
        let ended = self.read_all(session, standin, context, &mut progress);
        progress.done();
        if standin.is_some() {
            hang(session, self.group, 0.0)?;
        }
        ended
    }

    fn read_all(
        &mut self,
        session: &mut Session<'_>,
        standin: &mut Option<(Weights, Option<Cells>)>,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<()> {
        while let Some(&load) = self.plan.loads.get(self.done) {
            if !load.stays || std::mem::take(&mut self.hang_again) {
                if let Next::Ask = self.ask(&load, session, context)? {
                    continue;
                }
                self.hang_again = false;
                if let Some((weights, cells)) = standin {
                    self.since = Some(CameOn {
                        at_s: self.time_s(session.now_ns()),
                        sd_s: 0.0,
                    });
                    let force_n = weights.force_n(load.weight_g);
                    match cells {
                        None => hang(session, self.group, force_n)?,
                        Some(cells) => {
                            let before = self.done.checked_sub(1).map(|i| &self.plan.loads[i]);
                            if let Some(degrees) = load.turned_to(before) {
                                cells.turn(degrees);
                            }
                            for unit in self.group {
                                hang(session, &[*unit], cells.feels_n(*unit, force_n))?;
                            }
                        }
                    }
                }
            }
            let part = self.done as f64 / self.plan.loads.len() as f64;
            match self.take(&load, session, &mut || progress.at("weighing", part)) {
                Ok(means) => {
                    if standin.is_none() {
                        self.see_change(&load, &means);
                    }
                    self.keep(session, &load, means)?;
                }
                Err(CalibrateError::Refused(why)) if !self.plan.yes => {
                    self.hang_again = true;
                    progress.beside(|output| {
                        output.error(&format!("{why}\nlet the weight come to rest and try again"));
                    });
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Asks for a load, and watches the cells until the answer.
    fn ask(&mut self, load: &Load, session: &mut Session<'_>, context: &Context) -> Result<Next> {
        if self.plan.yes {
            return Ok(Next::Read);
        }
        let (done, of) = (self.asked(self.done), self.asked(usize::MAX));
        let before = self.done.checked_sub(1).map(|i| &self.plan.loads[i]);
        let prompt = instruction(&self.who, load, before, (done, of));
        let emulated = session.link().controls().is_some();
        let mut watches = std::mem::take(&mut self.watches);
        let answer = guide::ask_while(&prompt, &mut || {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CalibrateError::from(RunError::Interrupted).into());
            }
            if emulated {
                // Its stand-in hangs the weight after the answer; until then its time stands.
                std::thread::sleep(Duration::from_millis(20));
                return Ok(());
            }
            Ok(load_time::step(session, &mut watches, |ns| {
                self.time_s(ns)
            })?)
        });
        self.watches = watches;
        match answer? {
            Answer::Undo => {
                self.undo()?;
                Ok(Next::Ask)
            }
            Answer::Quit => Err(guide::broken_off(done, of, "readings")),
            Answer::Go(typed) => match confirms(&typed, load.weight_g) {
                Ok(()) => Ok(Next::Read),
                Err(why) => {
                    context.output.error(&why);
                    // The next question is for the same load.
                    self.hang_again = true;
                    Ok(Next::Ask)
                }
            },
        }
    }

    /// Takes the last reading back, and those of a hold with the one that began it.
    fn undo(&mut self) -> Result<()> {
        self.hang_again = true;
        self.before = None;
        self.forget_watched();
        while self.done > 0 {
            self.drafts.iter().try_for_each(Draft::undo)?;
            self.done -= 1;
            if !self.plan.loads[self.done].stays {
                break;
            }
        }
        Ok(())
    }

    fn forget_watched(&mut self) {
        for (_, watch) in &mut self.watches {
            *watch = Watch::default();
        }
    }

    /// When the load came on that was just read. By hand, a group is one unit.
    fn see_change(&mut self, load: &Load, means: &[Mean]) {
        let last = self
            .done
            .checked_sub(1)
            .and_then(|i| self.plan.loads.get(i));
        let same = last.is_some_and(|last| last.weight_g == load.weight_g);
        let (Some((_, watch)), Some(after)) = (self.watches.first(), means.first()) else {
            return;
        };
        let before = match &self.before {
            Some(before) => before.first().map(|mean| mean.code),
            None => watch.first_code(),
        };
        let seen = before.and_then(|before| watch.came_on(before, after.code, after.sd));
        // The same weight once more: it is on since it came on first.
        if seen.is_some() || !same {
            self.since = seen;
        }
    }

    fn keep(&mut self, session: &Session<'_>, load: &Load, means: Vec<Mean>) -> Result<()> {
        let at_s = self.time_s(session.now_ns()) - 0.5 * weights::READ.as_secs_f64();
        for (draft, mean) in self.drafts.iter().zip(&means) {
            // A group that was broken off between two of its files.
            if draft.rows()? == self.done {
                weights::keep(draft, load, mean, at_s, self.since)?;
            }
        }
        self.done += 1;
        self.before = Some(means);
        self.forget_watched();
        Ok(())
    }

    /// Mean codes of the group after it has settled.
    fn take(
        &self,
        load: &Load,
        session: &mut Session<'_>,
        tick: &mut dyn FnMut(),
    ) -> calibrate::Result<Vec<Mean>> {
        let mut quiet = |_: f64| {};
        cells::codes(session, load.wait + weights::SETTLE, &self.stop, &mut quiet)?;
        tick();
        let codes: [Vec<i32>; UNITS] =
            cells::codes(session, weights::READ, &self.stop, &mut quiet)?;
        let rig = &self.bench.rig;
        self.group
            .iter()
            .map(|unit| {
                let at = rig.units.iter().position(|u| u.number == *unit);
                let at = at.unwrap_or_default();
                let scale = rig.units[at].scale_n_per_count;
                weights::mean(&codes[at], scale, self.plan.drift_n).map_err(|error| match error {
                    CalibrateError::Refused(why) => {
                        CalibrateError::Refused(format!("unit {unit}: {why}"))
                    }
                    other => other,
                })
            })
            .collect()
    }
}

/// The group in words, with the serial number of its cell.
fn who(bench: &Bench, group: &[u8]) -> String {
    let [unit] = group else {
        return "all units".to_owned();
    };
    let found = bench.record.units.iter().find(|u| u.number == *unit);
    match found.map(|u| u.cell_serial.as_str()) {
        Some(serial) if !serial.is_empty() => format!("unit {unit} (cell {serial})"),
        _ => format!("unit {unit}"),
    }
}

/// Time at which a series goes on, s: 0, or after the last reading that is kept and the time since
/// it was written.
fn begun_s(drafts: &[Draft]) -> Result<f64> {
    let mut latest = 0.0f64;
    for draft in drafts {
        latest = latest.max(draft.last_number(TIME_COLUMN)?.unwrap_or(0.0) + draft.age_s()?);
    }
    Ok(latest)
}

/// Place of the time in a row of [`weights::HEADER`].
const TIME_COLUMN: usize = 4;

/// How a weight loads a cell; docs/calibration.md has the same.
pub(super) const LOADING: &str = "\
How the weights load a cell. It measures along its axis, and the units do not stand upright:

  dismounted, axis upright               mounted, over a pulley
       ____________                       ______
      |  bracket   |                     | unit |=cell=>---- cord ----( o ) pulley
      |____________|                     |______|   along the axis      |
         [ cell ]  axis                                                 |
            |                                                        [ weight ]
        [ weight ]

Dismounted is exact, and the unit stands elsewhere afterwards: all gains first, then `calibrate geometry`, then zeros.
Over a pulley the geometry stays; the pulley's friction enters the uncertainty. Tell which with --loading dismounted or
--loading pulley=FRICTION. Hanger and cord hang on the cell for the empty reading too. The same way for every unit.
";

/// `count`: readings that are done, and all.
fn instruction(who: &str, load: &Load, before: Option<&Load>, count: (usize, usize)) -> String {
    let (done, of) = count;
    let what = if load.weight_g == 0.0 {
        "take all weights off".to_owned()
    } else {
        format!("hang {} g", load.weight_g)
    };
    let first = match (load.turned_to(before), load.series) {
        (Some(degrees), _) => format!(
            "take the cell out, mount it anew {degrees} degrees about its axis from the first position (where it can't be turned: unhook the hanger and hook it in again); then "
        ),
        (None, Some(gain::PRELOAD)) => "preload; ".to_owned(),
        (None, Some(gain::CREEP)) => "creep, for five minutes; ".to_owned(),
        (None, Some(series)) => format!("series {series} of 6; "),
        (None, None) => String::new(),
    };
    format!(
        "{who}, reading {} of {of}: {first}{what}, let it come to rest, then press Enter (u: undo the last reading, q: stop here)",
        done + 1
    )
}

/// Whether what was typed says that the weight hangs: nothing, or its number.
fn confirms(typed: &str, weight_g: f64) -> std::result::Result<(), String> {
    let number = typed.trim_end_matches('g').trim_end();
    if typed.is_empty() || number.parse() == Ok(weight_g) {
        return Ok(());
    }
    Err(if number.parse::<f64>().is_ok() {
        format!("`{typed}` was typed, and {weight_g} g are asked for; hang them and press Enter, or u to take the last reading back")
    } else {
        format!("`{typed}` is no answer here; press Enter once {weight_g} g hang, u to take the last reading back, q to stop")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_guide_says_when_a_cell_is_turned() {
        let loads = weights::iso376_plan(&gain::iso376::WEIGHTS_G);
        let told: Vec<String> = (loads.iter().enumerate())
            .map(|(i, load)| {
                let before = i.checked_sub(1).map(|before| &loads[before]);
                instruction("unit 1", load, before, (i, loads.len()))
            })
            .collect();
        let lines = |word: &str| told.iter().filter(|line| line.contains(word)).count();
        assert_eq!(
            (lines("mount it anew 120"), lines("mount it anew 240")),
            (1, 1)
        );
        assert_eq!(lines("preload; hang 1000 g"), 3);
        assert!(told[6].contains("reading 7 of") && told[6].contains("series 1 of 6; take all"));
        let plain = weights::plan(&[100.0], 1, Duration::ZERO)[1];
        let told = instruction("unit 1", &plain, None, (1, 4));
        assert!(
            told.starts_with("unit 1, reading 2 of 4: hang 100 g, let it come"),
            "{told}"
        );
    }

    #[test]
    fn only_the_weight_that_is_asked_for_confirms() {
        for typed in ["", "50", "50g", "50 g", "50.0"] {
            assert_eq!(confirms(typed, 50.0), Ok(()), "{typed}");
        }
        for (typed, word) in [("500", "50 g are asked for"), ("yes", "no answer here")] {
            assert!(confirms(typed, 50.0).is_err_and(|why| why.contains(word)));
        }
    }
}
