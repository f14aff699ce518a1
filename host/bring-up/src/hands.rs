//! What a person does during the tests, or an emulated rig in his place.

use crate::BringUpError;
use emulator_link::Injection;
use session::{Session, SessionError, PERIOD};
use std::fmt;
use std::time::Duration;
use wire::UNITS;

/// Speed of an emulated hand, mm/s.
const HAND_MM_PER_S: f64 = 50.0;
/// Cable that an emulated hand lays loose, mm: with the cables as tight as pulses leave them.
const LOOSE_MM: f64 = 3.0;
/// Time until an emulated rig is at rest again after a hand, s.
const REST_S: f64 = 0.5;

/// Something to do by hand. Units count from 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// Press the E-stop and keep it pressed.
    PressEStop,
    /// Release it.
    ReleaseEStop,
    /// Pull cable out.
    PullOut {
        /// Unit.
        unit: u8,
        /// How far, mm.
        mm: f64,
    },
    /// Turn the reel back until the cable hangs loosely.
    LayLoose {
        /// Unit.
        unit: u8,
        /// How far it was pulled out, mm.
        mm: f64,
    },
    /// Hang a weight on a cable.
    Hang {
        /// Unit.
        unit: u8,
        /// Its force, N.
        newton: f64,
    },
    /// Take it off.
    TakeOff {
        /// Unit.
        unit: u8,
    },
    /// Look whether the amplifiers show power.
    LookAtPower,
    /// Pull the alive line's plug out at the PLC.
    UnplugAlive,
    /// Plug it in again.
    PlugAlive,
    /// Keep hands, tools and hair away from the reels: motors will move.
    StandBack,
    /// Fix the cables' ends, and stand back.
    HoldEnds,
    /// Turn the reel back until a cable that was taken up hangs loosely.
    Loosen {
        /// Unit.
        unit: u8,
        /// How far it was wound in, mm.
        mm: f64,
    },
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PressEStop => write!(f, "Press the E-stop and leave it pressed."),
            Self::ReleaseEStop => write!(f, "Release the E-stop."),
            Self::PullOut { unit, mm } => write!(
                f,
                "Unit {unit}: take the cable at its end, lay a ruler beside it, and pull it out by {mm:.0} mm (to 1 mm), in about 4 s. Touch no other cable."
            ),
            Self::LayLoose { unit, .. } => write!(
                f,
                "Unit {unit}: turn the reel back by hand, until the cable hangs loosely (some 20 mm of slack)."
            ),
            Self::Hang { unit, newton } => write!(
                f,
                "Unit {unit}: hold the reel and hang the weight ({newton:.2} N) on the cable, along the load cell's axis. Wait until it hangs still."
            ),
            Self::TakeOff { unit } => write!(f, "Unit {unit}: take the weight off and leave the cable loose."),
            Self::LookAtPower => write!(
                f,
                "Look at the amplifiers' lamps, or at the lamp of the PLC's relay: do they show power?"
            ),
            Self::UnplugAlive => write!(
                f,
                "Pull the plug of the alive line (PC8) out at the PLC. The amplifiers must lose their power."
            ),
            Self::PlugAlive => write!(f, "Plug the alive line in again."),
            Self::StandBack => write!(
                f,
                "The motors get short pulses now, unit by unit. All cables hang loosely; keep hands away from the reels and one hand at the E-stop."
            ),
            Self::HoldEnds => write!(
                f,
                "Each cable is wound in slowly now, and pulls its end with about 1 N. Fix the ends (at the robot that stands, or at a hook), lay all cables loose, keep hands away from the reels and one hand at the E-stop."
            ),
            Self::Loosen { unit, mm } => write!(
                f,
                "Unit {unit}: turn the reel back by hand by about {mm:.0} mm, until the cable hangs loosely."
            ),
        }
    }
}

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// It was done.
    Done,
    /// The answer to a question is no.
    No,
    /// It was not done, and the test is left out.
    Skip,
}

/// Who does it.
pub trait Hands {
    /// Asks for it, and lets the session's time pass until it is done.
    ///
    /// # Errors
    /// The session's, [`BringUpError::Stopped`], or the question could not be asked.
    fn act(&mut self, action: &Action, session: &mut Session<'_>) -> Result<Answer, BringUpError>;

    /// Says what is going on.
    fn say(&mut self, text: &str);
}

/// Lets an emulated rig do by itself what a person would.
///
/// # Errors
/// The link is no emulated rig, or it refuses.
pub fn emulated(action: &Action, session: &mut Session<'_>) -> Result<Answer, BringUpError> {
    let (injection, seconds) = match *action {
        Action::PressEStop => (Injection::EStop(true), 0.0),
        Action::ReleaseEStop => (Injection::EStop(false), 0.0),
        Action::PullOut { unit, mm } => (Injection::PullOut(unit, mm), mm / HAND_MM_PER_S),
        Action::LayLoose { unit, mm } => (Injection::PullOut(unit, -mm), mm / HAND_MM_PER_S),
        Action::Hang { unit, newton } => (Injection::PullCable(unit, newton), 0.0),
        Action::TakeOff { unit } => (Injection::PullCable(unit, 0.0), 0.0),
        Action::UnplugAlive => (Injection::UnplugAlive(true), 0.0),
        Action::PlugAlive => (Injection::UnplugAlive(false), 0.0),
        Action::LookAtPower => return look_at_power(session),
        Action::Loosen { unit, mm } => (Injection::PullOut(unit, mm), mm / HAND_MM_PER_S),
        Action::HoldEnds => {
            for unit in 1..=UNITS as u8 {
                inject(session, Injection::PullOut(unit, LOOSE_MM))?;
            }
            return Ok(pass(session, LOOSE_MM / HAND_MM_PER_S)?);
        }
        Action::StandBack => return Ok(Answer::Done),
    };
    inject(session, injection)?;
    Ok(pass(session, seconds)?)
}

fn inject(session: &mut Session<'_>, injection: Injection) -> Result<(), BringUpError> {
    let Some(controls) = session.link().controls() else {
        return Err(BringUpError::Question(
            "nobody is there to do it: this rig is no emulated one of the command's own, and --yes waits for nobody".to_owned(),
        ));
    };
    Ok(controls.inject(injection).map_err(SessionError::from)?)
}

/// Lets the time of a hand pass, and of the rig to come to rest.
fn pass(session: &mut Session<'_>, seconds: f64) -> Result<Answer, SessionError> {
    let end_ns = session.now_ns() + Duration::from_secs_f64(seconds + REST_S).as_nanos() as u64;
    while session.now_ns() < end_ns {
        session.exchange(PERIOD)?;
    }
    Ok(Answer::Done)
}

/// What an emulated rig's amplifiers show; nobody looks at those of a real one.
fn look_at_power(session: &mut Session<'_>) -> Result<Answer, BringUpError> {
    session.exchange(PERIOD)?;
    Ok(match session.drain().truth.last() {
        Some(truth) if truth.amplifier_on => Answer::Done,
        Some(_) => Answer::No,
        None => Answer::Skip,
    })
}
