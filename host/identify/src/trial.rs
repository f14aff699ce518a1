//! The trial of the findings: pairs of runs without and with them, until it is decided whether the
//! force is held better.

use super::{DoubtedCell, Figures, Findings, Gain, Pair, FEWEST_PAIRS};
use rig::Rig;
use run::{Ended, Fault, Observer, Options, Outcome, RunError, RunFault, Stopped};
use serde::Serialize;
use session::link::RigLink;
use session::{LatchedFault, Patience, Session, SessionError, PERIOD};
use std::fmt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use wire::message::{CommandError, Status, UnitStatus};
use wire::Command;

/// Time after a session in which cables come to rest and the board's watch over 0 V (75 ms) is
/// over.
const REST: Duration = Duration::from_secs(1);
/// Time in which a robot that moves lets a tight cable go: half of the embedded robot's slowest
/// period.
const CLEAR_TIMEOUT: Duration = Duration::from_secs(10);

/// A session in which a force was held.
#[derive(Debug)]
pub enum Held {
    /// To the end.
    Whole(Outcome, Figures),
    /// Until units dropped out with a fault of a swing; which, in words.
    Implausible(Outcome, String),
}

/// Why a session in which a force is held says nothing.
#[derive(Debug, thiserror::Error)]
pub enum HoldError {
    /// The run failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A fault 45 or 44 ended it, and nobody said that it may be cleared.
    #[error(
        "{0}\nA drive with a delay oscillates in a closed loop until this fault ends it. If cables, cells and amplifiers are \
         as they should be, --clear-implausible clears the fault and goes on with open loops, to find the cause"
    )]
    Implausible(RunError),
    /// It was too short.
    #[error("--duration is too short for figures; give 2 s or more")]
    Short,
}

/// Holds a force in a session of its own. With `clear`, a fault 45 or 44 that ended it is cleared.
/// Where its cause is still there it stays latched, and the next session does not begin.
///
/// # Errors
/// [`HoldError`]; the rig was made safe as far as the link allowed.
pub fn hold(
    link: &mut dyn RigLink,
    rig: &Rig,
    options: &Options,
    clear: bool,
    observer: &mut dyn Observer,
) -> Result<Held, HoldError> {
    let outcome = match run::hold_force(link, rig, options, observer) {
        Ok(outcome) => outcome,
        Err(Stopped { error, outcome }) => {
            let which = outcome.as_ref().and_then(|o| swing(&o.faults));
            return match (which, outcome) {
                (Some(which), Some(outcome)) if clear => {
                    let why = format!("{which} ended a session");
                    observer.notice(&format!("{why}; it is cleared"));
                    clear_faults(link, &options.stop, observer)?;
                    Ok(Held::Implausible(*outcome, why))
                }
                (Some(_), _) => Err(HoldError::Implausible(error)),
                (None, _) => Err(error.into()),
            };
        }
    };
    if outcome.ended == Ended::Interrupted || options.stop.load(Ordering::SeqCst) {
        return Err(RunError::Interrupted.into());
    }
    let figures = Figures::of(&outcome).ok_or(HoldError::Short)?;
    Ok(Held::Whole(outcome, figures))
}

/// Clears the board's faults after a session that a fault of a swing ended, once the cables have
/// come to rest.
///
/// A unit with fault 45 has a load cell that is not believed. Where its reel does not pay out (the
/// robot came towards it, and the cable went slack by that), nothing shows that 0 V had an effect,
/// and the board latches fault 15 as well. That fault is cleared with it: before the next arming
/// the board tries the amplifiers' power out, and an output that is stuck latches it again. A fault
/// 15 of another unit, or one that a tension shows, is not cleared.
///
/// # Errors
/// Another fault is latched, the E-stop is open, `stop` was set, or the board refuses: the cause of
/// a fault is still there.
pub fn clear_faults(
    link: &mut dyn RigLink,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<(), RunError> {
    let mut session = Session::connect(link)?;
    session.exchange(REST)?;
    let status = session.get_status()?;
    if let Some(fault) = other_fault(&status) {
        return Err(Fault::Latched(fault).into());
    }
    if status.fault != 0 {
        observer.notice(
            "fault 15 (0 V has no effect) came behind it: with its load cell in doubt the unit's reel did not show that the cable \
             let go; it is cleared too, and the board tries the power out before it arms",
        );
    }
    let mut patience = Patience::new(CLEAR_TIMEOUT, session.now_ns());
    loop {
        // Also what came while a cable was tight: a refused clear takes away what has no cause any
        // more.
        let status = session.get_status()?;
        if let Some(fault) = other_fault(&status) {
            return Err(Fault::Latched(fault).into());
        }
        if !status.estop_closed {
            let fault = LatchedFault::new(control::Fault::EStop.code(), 0);
            return Err(Fault::Latched(fault).into());
        }
        if stop.load(Ordering::SeqCst) {
            return Err(RunError::Interrupted);
        }
        match session.command(&Command::ClearFaults) {
            // A cable that the robot holds above 1.7 N at 0 V is refused until the robot lets it
            // go.
            Err(SessionError::Refused { refusal, .. })
                if refusal == CommandError::Faulted(control::Fault::OutputStuck.code())
                    && !patience.is_over(session.now_ns(), session.status().map(|s| s.t_us)) =>
            {
                session.exchange(PERIOD)?;
            }
            answer => return answer.map(|_| ()).map_err(RunError::from),
        }
    }
}

/// Over-tension that a loop which swings may reach before fault 45 ends it, mN: a driven unit
/// faults from 13 N on, and what is above 20 N is another matter.
const SWING_MN: u32 = 20_000;

/// How far below zero a load cell may read in such a swing, mN. A cable that is thrown slack lets
/// its cell ring, and a drive that is 9 ms late does so again and again: 1.4 and 1.6 N behind
/// impacts of 12 N (seed 25 of `cargo xtask closed-loop`). A cell whose wires are exchanged reads
/// so in the next session as well, and ends it.
const SWING_NEGATIVE_MN: u32 = 4_000;

/// Whether a unit's fault is that of a loop that swings.
pub(super) fn of_a_swing(code: u16, detail: u32) -> bool {
    use control::Fault as F;
    code == F::Implausible.code()
        || code == F::OverTension.code() && detail < SWING_MN
        || code == F::TensionNegative.code() && detail < SWING_NEGATIVE_MN
}

/// The first latched fault that is neither a unit's fault of a swing nor, of a unit with fault 45,
/// a fault 15 without a tension.
pub(super) fn other_fault(status: &Status) -> Option<LatchedFault> {
    let doubted = |unit: &UnitStatus| unit.fault == control::Fault::Implausible.code();
    let unseen = |fault: &LatchedFault| {
        let stuck = fault.output_stuck().filter(|(_, left)| left.is_none());
        stuck.is_some_and(|(n, _)| status.units.get(n).is_some_and(doubted))
    };
    LatchedFault::all_of(status).find(|fault| match fault.unit {
        None => !unseen(fault),
        Some(_) => !of_a_swing(fault.code, fault.detail),
    })
}

/// Whether an error is a fault 45, tension implausible.
#[must_use]
pub fn is_implausible(error: &RunError) -> bool {
    matches!(error, RunError::Fault(Fault::Latched(fault)) if fault.code == control::Fault::Implausible.code())
}

/// Fault and units in words, where all faults of a session are fault 45 or 44 of units, or
/// over-tension of the same swing. A fault 15 behind it is [`clear_faults`]' to judge, and so is
/// how far a tension went.
fn swing(faults: &[RunFault]) -> Option<String> {
    use control::Fault as F;
    let leading = [F::Implausible, F::TensionNegative]
        .into_iter()
        .find(|fault| faults.iter().any(|f| f.code == fault.code()))?;
    let behind = |fault: &&RunFault| fault.unit.is_none() && fault.code == F::OutputStuck.code();
    let unit = |fault: &RunFault| fault.unit.filter(|_| of_a_swing(fault.code, 0));
    let mut units: Vec<u8> = faults
        .iter()
        .filter(|fault| !behind(fault))
        .map(unit)
        .collect::<Option<_>>()?;
    units.sort_unstable();
    units.dedup();
    let names: Vec<String> = units.iter().map(u8::to_string).collect();
    let of = match names.len() {
        0 => return None,
        1 => format!("unit {}", names[0]),
        _ => format!("units {}", names.join(", ")),
    };
    Some(match leading {
        F::Implausible => format!("fault 45 (tension implausible) of {of}"),
        _ => format!("fault 44 (tension negative) of {of}"),
    })
}

/// Why the rig file is left as it is.
#[derive(Debug, Clone, PartialEq)]
pub enum Left {
    /// No finding changes a setting.
    NothingClear,
    /// A fault of a swing ended a session with the findings; of which units, in words.
    NotHeld(String),
    /// Something else ended the comparison, in words.
    BrokenOff(String),
    /// The error of a run is zero, infinite or NaN.
    NoError,
    /// The runs of an emulated rig without any scatter decide nothing.
    Repeats,
    /// The gain does not support a change.
    NotBetter(Box<Gain>),
}

impl fmt::Display for Left {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NothingClear => {
                f.write_str("nothing was found that is clear and that the board can use")
            }
            Self::NotHeld(why) => write!(f, "the force was not held with it to the end: {why}"),
            Self::BrokenOff(why) => write!(f, "the comparison was broken off: {why}"),
            Self::NoError => f.write_str("a run has no error to compare"),
            Self::Repeats => f.write_str(
                "this rig repeats a pair of runs to the last digit, so further pairs do not confirm the gain",
            ),
            Self::NotBetter(gain) => {
                let why = if !gain.is_decided() {
                    "no interval of a cable excludes zero; more --pairs or a longer --duration may decide it"
                } else if gain.tip_growth > 0.0 && gain.worst.mean > 0.0 {
                    "the force error at the tip did not fall with it"
                } else {
                    "less than 2 %, or with a loss of a cable, does not count"
                };
                write!(
                    f,
                    "the force was held no better with it: the worst cable gained {gain}; {why}"
                )
            }
        }
    }
}

/// A run that the trial asks for.
#[derive(Debug, Clone, Copy)]
pub struct Run<'a> {
    /// Its pair, from 1.
    pub pair: usize,
    /// Whether it is with the findings.
    pub with_findings: bool,
    /// The rig to drive.
    pub rig: &'a Rig,
}

/// Load cells that were measured with weights between two analyses.
#[derive(Debug, Clone, Serialize)]
pub struct Weighed {
    /// What the first analysis named.
    pub cells: Vec<DoubtedCell>,
    /// What `calibrate gain` reported.
    pub gains: serde_json::Value,
}

/// What was found on a rig, and what it is worth.
#[derive(Debug)]
pub struct Trial {
    /// What was found.
    pub findings: Findings,
    /// Part of the excitation's amplitude that was left at the end.
    pub swing: f64,
    /// The first run without the findings.
    pub before: Outcome,
    /// The fault that ended a session without the findings.
    pub stopped: Option<String>,
    /// The first run with the findings, where it went to the end.
    pub after: Option<Outcome>,
    /// Means over the runs without and with the findings; `None` without such a run to the end.
    pub figures: (Option<Figures>, Option<Figures>),
    /// The runs of each pair that went to the end.
    pub pairs: Vec<Pair>,
    /// How much better it is with the findings.
    pub gain: Option<Gain>,
    /// The cells that were measured with weights before the findings.
    pub weighed: Option<Weighed>,
    /// Why nothing was changed.
    pub left: Option<Left>,
    /// Where the rig file was put, and where the old one is kept.
    pub applied: Option<(PathBuf, PathBuf)>,
}

impl Trial {
    /// Of what was found, after the first run without it. `swing` is that of the recording.
    #[must_use]
    pub fn new(first: Held, findings: Findings, swing: f64) -> Self {
        let (before, figures, stopped) = match first {
            Held::Whole(outcome, figures) => (outcome, Some(figures), None),
            Held::Implausible(outcome, why) => (outcome, None, Some(why)),
        };
        Self {
            findings,
            swing,
            before,
            stopped,
            after: None,
            figures: (figures, None),
            pairs: Vec::new(),
            gain: None,
            weighed: None,
            left: None,
            applied: None,
        }
    }

    /// Holds the force with the findings and the cells that were weighed, and repeats the pair of
    /// runs until the gain is decided or `most` pairs are there. Without findings nothing is
    /// driven. [`Trial::left`] says why it is not better with them.
    ///
    /// # Errors
    /// Those of `hold`, which does a run.
    pub fn compare<E>(
        &mut self,
        rig: &Rig,
        most: usize,
        hold: &mut dyn FnMut(Run<'_>) -> Result<Held, E>,
    ) -> Result<(), E> {
        self.left = if self.findings.rewritten.changed.is_empty() && self.weighed.is_none() {
            Some(Left::NothingClear)
        } else {
            self.decide(rig, most, hold)?
        };
        Ok(())
    }

    /// The pairs. `None` if it is better with the findings, else why not.
    fn decide<E>(
        &mut self,
        rig: &Rig,
        most: usize,
        hold: &mut dyn FnMut(Run<'_>) -> Result<Held, E>,
    ) -> Result<Option<Left>, E> {
        let mut before = self.figures.0;
        let mut afters: Vec<Figures> = Vec::new();
        for pair in 1.. {
            // In turn one of the two is first: a rig that changes from run to run favours neither.
            let order: &[bool] = match pair {
                1 => &[true],
                _ if pair % 2 == 0 => &[true, false],
                _ => &[false, true],
            };
            for &with_findings in order {
                if !with_findings && self.stopped.is_some() {
                    continue;
                }
                let held = hold(Run {
                    pair,
                    with_findings,
                    rig: if with_findings {
                        &self.findings.rig
                    } else {
                        rig
                    },
                })?;
                match (held, with_findings) {
                    (Held::Whole(outcome, figures), true) => {
                        self.after.get_or_insert(outcome);
                        afters.push(figures);
                    }
                    (Held::Implausible(_, why), true) => return Ok(Some(Left::NotHeld(why))),
                    (Held::Whole(_, figures), false) => before = Some(figures),
                    (Held::Implausible(_, why), false) => self.stopped = Some(why),
                }
            }
            self.figures.1 = Figures::mean(&afters);
            // Without a session to the end there is nothing to compare. What holds the force again
            // and again is better.
            let (None, Some(without)) = (&self.stopped, before) else {
                if pair < FEWEST_PAIRS {
                    continue;
                }
                break;
            };
            let new = Pair {
                before: without,
                after: afters[pair - 1],
            };
            let repeats = self.pairs.contains(&new);
            self.pairs.push(new);
            let Some(gain) = Gain::of(&self.pairs) else {
                return Ok(Some(Left::NoError));
            };
            self.gain = Some(gain);
            if repeats || gain.is_decided() || pair >= most {
                let befores: Vec<Figures> = self.pairs.iter().map(|pair| pair.before).collect();
                self.figures.0 = Figures::mean(&befores);
                return Ok(match gain.is_better() {
                    true => None,
                    false if repeats => Some(Left::Repeats),
                    false => Some(Left::NotBetter(Box::new(gain))),
                });
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use control::Fault;

    #[test]
    fn only_faults_of_a_swing_of_units_may_be_cleared() {
        let fault = |unit: Option<u8>, fault: Fault| RunFault {
            t_s: 1.0,
            unit,
            code: fault.code(),
            text: String::new(),
        };
        let of = |unit: u8| fault(Some(unit), Fault::Implausible);
        let words = |faults: &[RunFault]| swing(faults);
        assert_eq!(
            words(&[of(3)]).as_deref(),
            Some("fault 45 (tension implausible) of unit 3")
        );
        assert_eq!(
            words(&[of(6), of(1), of(3), of(1)]).as_deref(),
            Some("fault 45 (tension implausible) of units 1, 3, 6")
        );
        let negative = [
            fault(Some(2), Fault::TensionNegative),
            fault(Some(5), Fault::OverTension),
        ];
        assert_eq!(
            words(&negative).as_deref(),
            Some("fault 44 (tension negative) of units 2, 5")
        );
        assert_eq!(words(&negative[1..]), None);
        assert_eq!(words(&[]), None);
        assert_eq!(words(&[of(1), fault(None, Fault::TipForce)]), None);
        assert_eq!(words(&[of(1), fault(Some(2), Fault::SensorFrozen)]), None);
        assert_eq!(words(&[fault(None, Fault::Implausible)]), None);
    }
}
