//! The tests, in order, on a session with the board.

use crate::figures::{
    BoardFigures, ConverterFigures, EStopFigures, Figures, MotorFigures, PullFigures, WeightFigures,
};
use crate::hands::{Action, Answer, Hands};
use crate::pulse::{self, Drive};
use crate::window::{scales, Rest, Window, REST};
use crate::BringUpError;
use control::{Fault, MotorState, SystemState};
use rig::Rig;
use serde::{Deserialize, Serialize};
use session::{Patience, Session, PERIOD};
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use wire::message::{BoardConfig, BoardInfo, Pull, Status, UnitConfig};
use wire::{Command, UNITS};

mod power;

/// How long converters may take to come up, with retries.
const BRING_UP_TIMEOUT: Duration = Duration::from_secs(15);
/// Time over which the converters are watched at rest: 640 samples.
const WATCH: Duration = Duration::from_secs(2);
/// Time after a hand: a cell rings for 0.1 s, a weight swings longer.
const SETTLE: Duration = Duration::from_secs(1);
/// How long the E-stop's state may take to arrive: statuses come every 50 ms.
const ESTOP: Duration = Duration::from_millis(300);

/// A test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Test {
    /// Who the board is, and how it is set.
    Board,
    /// Converters: rates, missed samples, failed reads, noise and its tones, DRDY lines.
    Converters,
    /// The E-stop.
    Estop,
    /// Cables pulled out by hand: encoders and load cells.
    Reels,
    /// Known weights.
    Weights,
    /// The amplifiers' power: with the alive line unplugged a pulse moves nothing.
    Power,
    /// Pulses of the motors.
    Motors,
    /// Cables that are taken up and loaded.
    Tension,
}

impl Test {
    /// All, in their order.
    pub const ALL: [Self; 8] = [
        Self::Board,
        Self::Converters,
        Self::Estop,
        Self::Reels,
        Self::Weights,
        Self::Power,
        Self::Motors,
        Self::Tension,
    ];

    /// Its name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Board => "board",
            Self::Converters => "converters",
            Self::Estop => "estop",
            Self::Reels => "reels",
            Self::Weights => "weights",
            Self::Power => "power",
            Self::Motors => "motors",
            Self::Tension => "tension",
        }
    }

    /// Whether it measures the board and none of its units.
    #[must_use]
    pub const fn is_of_the_board(self) -> bool {
        matches!(self, Self::Board | Self::Estop)
    }

    /// Whether it drives motors.
    #[must_use]
    pub const fn drives(self) -> bool {
        matches!(self, Self::Power | Self::Motors | Self::Tension)
    }
}

impl fmt::Display for Test {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Test {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|test| test.name() == text)
            .ok_or_else(|| {
                let names = Self::ALL.map(Self::name).join(", ");
                format!("`{text}` is no test; there are {names}")
            })
    }
}

/// What is tested.
#[derive(Debug, Clone)]
pub struct Plan<'a> {
    /// Units, from 0.
    pub units: Vec<usize>,
    /// How far a cable is pulled out, mm.
    pub pull_mm: f64,
    /// Force of the known weight, N; `None`: there is none, and that test is left out.
    pub weight_n: Option<f64>,
    /// Ends the tests.
    pub stop: &'a AtomicBool,
}

/// The tests of a session.
pub struct Bench<'a, 's> {
    session: &'a mut Session<'s>,
    rig: &'a Rig,
    plan: &'a Plan<'a>,
    hands: &'a mut dyn Hands,
    configs: [UnitConfig; UNITS],
    /// What was in force before, zeros included.
    before: ([UnitConfig; UNITS], BoardConfig),
}

impl<'a, 's> Bench<'a, 's> {
    /// Configures an idle board, and waits until its units have come up or failed.
    ///
    /// # Errors
    /// The board is armed, or the session's.
    pub fn new(
        session: &'a mut Session<'s>,
        rig: &'a Rig,
        plan: &'a Plan<'a>,
        hands: &'a mut dyn Hands,
    ) -> Result<Self, BringUpError> {
        let status = session.get_status()?;
        if SystemState::from_u8(status.state).is_some_and(SystemState::drives) {
            return Err(BringUpError::Armed);
        }
        let before = (session.get_configs()?, session.get_board()?);
        let mut bench = Self {
            before,
            session,
            rig,
            plan,
            hands,
            configs: rig.units.map(|unit| unit.to_wire()),
        };
        bench.session.stage_board(rig.controller.board_config())?;
        bench.session.configure(&bench.configs)?;
        bench.session.command(&Command::Stream { decimation: 1 })?;
        bench.wait_units()?;
        Ok(bench)
    }

    /// Runs a test and puts what it measured into `figures`.
    ///
    /// # Errors
    /// See [`BringUpError`]. What was measured before stays.
    pub fn run(&mut self, test: Test, figures: &mut Figures) -> Result<(), BringUpError> {
        match test {
            Test::Board => figures.board = Some(self.board()?),
            Test::Converters => self.converters(&mut figures.converters)?,
            Test::Estop => figures.estop = self.estop()?,
            Test::Reels => {
                for unit in self.measuring()? {
                    figures.pulls[unit] = self.pull(unit)?;
                }
            }
            Test::Weights => {
                if let Some(weight_n) = self.plan.weight_n {
                    for unit in self.measuring()? {
                        figures.weights[unit] = self.weight(unit, weight_n)?;
                    }
                }
            }
            Test::Power => self.power(figures)?,
            Test::Motors => self.motors(figures)?,
            Test::Tension => self.tension(figures)?,
        }
        Ok(())
    }

    /// Time of the link, ns.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.session.now_ns()
    }

    /// Gives the board back the configuration that it had, with its zeros.
    ///
    /// # Errors
    /// The session's.
    pub fn restore(&mut self) -> Result<(), BringUpError> {
        let (units, board) = self.before;
        self.session.stage_board(board)?;
        Ok(self.session.configure(&units)?)
    }

    /// Units of the plan that the rig file uses.
    fn enabled(&self) -> Vec<usize> {
        let units = self.plan.units.iter().copied();
        units.filter(|unit| self.rig.units[*unit].enabled).collect()
    }

    /// Those of them that measure: what comes with a unit's samples is not there of another.
    fn measuring(&mut self) -> Result<Vec<usize>, BringUpError> {
        let works = works(&self.clear()?);
        Ok(self
            .enabled()
            .into_iter()
            .filter(|unit| works[*unit])
            .collect())
    }

    fn check_stop(&self) -> Result<(), BringUpError> {
        if self.plan.stop.load(Ordering::Relaxed) {
            return Err(BringUpError::Stopped);
        }
        Ok(())
    }

    /// Waits until every enabled unit has come up or failed.
    fn wait_units(&mut self) -> Result<Status, BringUpError> {
        let mut patience = Patience::new(BRING_UP_TIMEOUT, self.session.now_ns());
        loop {
            self.check_stop()?;
            for _ in 0..5 {
                self.session.exchange(PERIOD)?;
            }
            let status = self.session.get_status()?;
            let settled = (0..UNITS).all(|i| {
                let state = MotorState::from_u8(status.units[i].state);
                !self.configs[i].enabled
                    || status.units[i].fault != 0
                    || state == Some(MotorState::Ready)
            });
            if settled || patience.is_over(self.session.now_ns(), Some(status.t_us)) {
                return Ok(status);
            }
        }
    }

    /// Clears what is latched, as far as its cause is gone, and waits until the units are up again.
    fn clear(&mut self) -> Result<Status, BringUpError> {
        crate::clear(self.session)?;
        self.wait_units()
    }

    fn board(&mut self) -> Result<BoardFigures, BringUpError> {
        let status = self.session.get_status()?;
        let info = self.session.info();
        Ok(BoardFigures {
            firmware: info.map_or_else(String::new, |info| info.version.to_string()),
            hse: info.is_some_and(|info| info.hse),
            brown_out_level: info.map_or(0, BoardInfo::brown_out_level),
            // As it should be where nothing is known.
            dac_reset_pull: info.map_or(Pull::Down, |info| info.dac_reset_pull),
            fault: status.fault,
        })
    }

    fn converters(
        &mut self,
        figures: &mut [Option<ConverterFigures>; UNITS],
    ) -> Result<(), BringUpError> {
        let before = self.clear()?;
        let window = Window::over(self.session, WATCH)?;
        let after = self.session.get_status()?;
        let scale = scales(self.rig);
        for i in self.enabled() {
            let (was, is) = (&before.units[i], &after.units[i]);
            let (tone_hz, tone) = window.tone(i).unwrap_or_default();
            figures[i] = Some(ConverterFigures {
                fault: is.fault,
                fault_detail: is.fault_detail,
                samples: window.samples(i) as u32,
                seconds: window.seconds(i),
                missed: is.missed.wrapping_sub(was.missed),
                spikes: is.spikes.wrapping_sub(was.spikes),
                failed_reads: is.failed_reads.wrapping_sub(was.failed_reads),
                recoveries: after.bus_recoveries.wrapping_sub(before.bus_recoveries),
                code: window.mean_code(i).unwrap_or(0.0),
                noise_n: window.code_sd(i) * scale[i].abs(),
                tone_hz,
                tone_n: tone * scale[i].abs(),
                silenced: [false; UNITS],
            });
        }
        // One whose DRDY is another's may be at fault for its rate by now; it is started again for
        // this.
        for unit in self.enabled() {
            if let Some(found) = figures[unit].as_mut().filter(|found| found.samples > 0) {
                found.silenced = self.restart(unit)?;
            }
        }
        Ok(())
    }

    /// Starts a unit's converter anew: for half a second it gives no DRDY. The units that miss it.
    fn restart(&mut self, unit: usize) -> Result<[bool; UNITS], BringUpError> {
        self.check_stop()?;
        let worked = works(&self.clear()?);
        let mut without = self.configs;
        without[unit].enabled = false;
        self.session.configure(&without)?;
        self.session.exchange(PERIOD)?;
        self.session.configure(&self.configs)?;
        let status = self.wait_units()?;
        let silent = std::array::from_fn(|i| {
            let fault = Fault::from_code(status.units[i].fault);
            worked[i]
                && matches!(
                    fault,
                    Some(Fault::SensorSilent | Fault::SensorSlow | Fault::BringUpFailed)
                )
        });
        self.clear()?;
        Ok(silent)
    }

    fn estop(&mut self) -> Result<Option<EStopFigures>, BringUpError> {
        let closed_before = self.closed()?;
        if self.act(Action::PressEStop)? == Answer::Skip {
            return Ok(None);
        }
        let closed_pressed = self.closed()?;
        self.act(Action::ReleaseEStop)?;
        let closed_released = self.closed()?;
        self.clear()?;
        // The board watches the units for a moment before it gives the power.
        let status = self.settled(SETTLE)?;
        Ok(Some(EStopFigures {
            closed_before,
            closed_pressed,
            closed_released,
            alive_withheld: status.alive_withheld,
        }))
    }

    fn act(&mut self, action: Action) -> Result<Answer, BringUpError> {
        self.check_stop()?;
        self.hands.act(&action, self.session)
    }

    fn settled(&mut self, time: Duration) -> Result<Status, BringUpError> {
        Window::over(self.session, time)?;
        Ok(self.session.get_status()?)
    }

    fn closed(&mut self) -> Result<bool, BringUpError> {
        Ok(self.settled(ESTOP)?.estop_closed)
    }

    fn pull(&mut self, unit: usize) -> Result<Option<PullFigures>, BringUpError> {
        let (number, mm) = (unit as u8 + 1, self.plan.pull_mm);
        let rest = Rest::of(&Window::over(self.session, REST)?);
        self.session.drain();
        if self.act(Action::PullOut { unit: number, mm })? == Answer::Skip {
            return Ok(None);
        }
        let way = Window::of(&self.session.drain().samples);
        let end = Rest::of(&Window::over(self.session, REST)?);
        self.act(Action::LayLoose { unit: number, mm })?;
        let scale = scales(self.rig);
        Ok(Some(PullFigures {
            travel_m: mm * 1e-3,
            counts: std::array::from_fn(|i| end.counts[i].wrapping_sub(rest.counts[i])),
            cell_n: std::array::from_fn(|i| way.furthest_code(i, rest.code[i]) * scale[i]),
        }))
    }

    fn weight(
        &mut self,
        unit: usize,
        weight_n: f64,
    ) -> Result<Option<WeightFigures>, BringUpError> {
        let number = unit as u8 + 1;
        let rest = Rest::of(&Window::over(self.session, REST)?);
        let action = Action::Hang {
            unit: number,
            newton: weight_n,
        };
        if self.act(action)? == Answer::Skip {
            return Ok(None);
        }
        Window::over(self.session, SETTLE)?;
        let loaded = Rest::of(&Window::over(self.session, REST)?);
        self.act(Action::TakeOff { unit: number })?;
        let scale = scales(self.rig);
        Ok(Some(WeightFigures {
            weight_n,
            cell_n: std::array::from_fn(|i| (loaded.code[i] - rest.code[i]) * scale[i]),
        }))
    }

    fn motors(&mut self, figures: &mut Figures) -> Result<(), BringUpError> {
        if self.act(Action::StandBack)? == Answer::Skip {
            return Ok(());
        }
        self.pulses(pulse::SEEN_N, &mut figures.motors)
    }

    fn tension(&mut self, figures: &mut Figures) -> Result<(), BringUpError> {
        if self.act(Action::HoldEnds)? == Answer::Skip {
            return Ok(());
        }
        self.drive_each("tension", |hands, drive, unit| {
            if figures.motors[unit].is_none() {
                hands.say("its motor was not tested: its cable is not loaded");
                return Ok(());
            }
            let found = crate::tension::test(drive, unit)?;
            let mm = 1e3 * found.wound_m.max(0.0);
            figures.tension[unit] = Some(found);
            let number = unit as u8 + 1;
            let action = Action::Loosen { unit: number, mm };
            hands.act(&action, drive.session).map(drop)
        })
    }

    /// Pulses of each unit, of at most `most_n`.
    fn pulses(
        &mut self,
        most_n: f64,
        figures: &mut [Option<MotorFigures>; UNITS],
    ) -> Result<(), BringUpError> {
        self.drive_each("pulses", |_, drive, unit| {
            figures[unit] = Some(pulse::test(drive, unit, most_n)?);
            Ok(())
        })
    }

    /// Lets `test` drive one unit after the other of those that work. Everything is at 0 V
    /// afterwards, whatever came, and the rig file's configuration is in force again.
    fn drive_each(
        &mut self,
        what: &str,
        mut test: impl FnMut(&mut dyn Hands, &mut Drive<'_, 's>, usize) -> Result<(), BringUpError>,
    ) -> Result<(), BringUpError> {
        let status = self.clear()?;
        let works = works(&status);
        let rest = Window::over(self.session, REST)?;
        let zero_code = std::array::from_fn(|i| rest.mean_code(i).unwrap_or(0.0).round() as i32);
        // Units that do not work are switched off, so that the others get their power.
        self.session
            .configure(&pulse::configs(self.rig, works, zero_code, 0, 0.0))?;
        self.settled(SETTLE)?;
        let mut ended = Ok(());
        for unit in self.enabled().into_iter().filter(|unit| works[*unit]) {
            self.hands.say(&format!("unit {}: {what}", unit + 1));
            let mut drive = Drive {
                session: &mut *self.session,
                rig: self.rig,
                works,
                zero_code,
                stop: self.plan.stop,
            };
            ended = test(&mut *self.hands, &mut drive, unit);
            if ended.is_err() {
                self.session.make_safe();
                break;
            }
        }
        let restored = self.session.configure(&self.configs);
        ended.and(restored.map_err(BringUpError::from))
    }
}

/// Units that measure and are not faulted.
fn works(status: &Status) -> [bool; UNITS] {
    (status.units)
        .map(|unit| unit.fault == 0 && MotorState::from_u8(unit.state) == Some(MotorState::Ready))
}
