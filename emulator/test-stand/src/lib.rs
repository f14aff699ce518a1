//! A stand for scenarios: the real firmware image in the embedded rig, and a session with it.
//!
//! The scenarios start the same `rig` program that `cargo forcectl` starts and talk to it as
//! `forcectl` does. What they assert is the plant's truth and what the board reports, in virtual
//! time.
//!
//! `cargo xtask test` builds image and rig and sets `FORCE_FIRMWARE_ELF` and `FORCE_RIG_BIN`.

use control::geometry::direction_q14;
use control::{MotorState, SystemState};
use emulator_link::{Injection, Report, Truth};
use rig::Rig;
use session::link::embedded::{EmbeddedRig, Programs};
use session::link::{EmbeddedOptions, RigLink};
use session::Session;
use std::time::Duration;
use wire::message::{Status, UnitSetpoint};
use wire::{Command, UNITS};

/// Voltage at a DAC output that counts as 0 V: the DAC7731's offset error and half a code are far
/// below it.
pub const ZERO_V: f64 = 0.002;

/// One millisecond.
pub const MS: Duration = Duration::from_millis(1);

/// Starts an embedded rig with the image that `FORCE_FIRMWARE_ELF` names.
///
/// # Panics
/// Where the variables are missing or the rig does not start: there is nothing to test then.
#[must_use]
pub fn rig(seed: u64) -> EmbeddedRig {
    let programs = Programs::from_environment().unwrap_or_else(|error| panic!("{error}"));
    let options = EmbeddedOptions {
        seed: Some(seed),
        ..EmbeddedOptions::default()
    };
    EmbeddedRig::start(&programs, &options).unwrap_or_else(|error| panic!("{error}"))
}

/// The rig file that forcectl has built in.
///
/// # Panics
/// Where it is not valid.
#[must_use]
pub fn rig_file() -> Rig {
    Rig::built_in().unwrap_or_else(|error| panic!("{error}"))
}

/// A session with a board, for scenarios: every error of the session ends the test.
pub struct Stand<'l> {
    /// The session.
    pub session: Session<'l>,
    truth: Vec<Truth>,
}

impl<'l> Stand<'l> {
    /// Connects to the board.
    ///
    /// # Panics
    /// Where the board does not answer.
    pub fn connect(link: &'l mut dyn RigLink) -> Self {
        let session = Session::connect(link).unwrap_or_else(|error| panic!("{error}"));
        Self {
            session,
            truth: Vec::new(),
        }
    }

    /// Connects, configures the built-in rig and waits until every unit is ready.
    ///
    /// # Panics
    /// When they are not within six seconds.
    pub fn ready(link: &'l mut dyn RigLink) -> Self {
        let mut stand = Self::connect(link);
        let configs = rig_file().units.map(|unit| unit.to_wire());
        stand
            .session
            .configure(&configs)
            .unwrap_or_else(|error| panic!("{error}"));
        stand.wait("all units are ready", 6.0, |status| {
            status.state == SystemState::Ready as u8
                && !status.alive_withheld
                && status
                    .units
                    .iter()
                    .all(|unit| unit.state == MotorState::Ready as u8)
        });
        stand
    }

    /// Ready, zeroed, armed, every cable at `tension_n` for a second.
    pub fn armed(link: &'l mut dyn RigLink, tension_n: f64) -> Self {
        Self::armed_for(link, tension_n, 1.0)
    }

    /// Ready, zeroed, armed, every cable at `tension_n` for so many seconds; 0.4 are enough to come
    /// there.
    pub fn armed_for(link: &'l mut dyn RigLink, tension_n: f64, seconds: f64) -> Self {
        let mut stand = Self::ready(link);
        stand.ask(&Command::Zero { units: 0b11_1111 });
        stand.run(0.1);
        stand.wait("zeroing is over", 4.0, |status| {
            status.state == SystemState::Ready as u8
        });
        stand.ask(&Command::Arm);
        stand.hold([tension_n; UNITS]);
        stand.run(seconds);
        stand
    }

    /// Sends a command that must not be refused.
    ///
    /// # Panics
    /// Where it is.
    pub fn ask(&mut self, command: &Command) {
        if let Err(error) = self.session.command(command) {
            panic!("{error}");
        }
    }

    /// Puts these tensions in force, for cables in line with their load cells.
    pub fn hold(&mut self, tension_n: [f64; UNITS]) {
        self.hold_foretold(tension_n, None);
    }

    /// The same with a foretold speed of every reel.
    pub fn hold_foretold(&mut self, tension_n: [f64; UNITS], reel_um_per_s: Option<i32>) {
        let rig = rig_file();
        let tip = rig.workspace.center_m;
        self.session
            .set_setpoints(Some(std::array::from_fn(|unit| UnitSetpoint {
                tension_un: (tension_n[unit] * 1e6) as i32,
                inv_cos_q16: 1 << 16,
                direction_q14: rig.units[unit]
                    .cable_at(tip)
                    .map_or([0; 3], |(direction, _)| direction_q14(&direction)),
                reel_um_per_s,
            })));
    }

    /// Lets `seconds` pass in steps of the host's period.
    ///
    /// # Panics
    /// Where the link breaks, or the board falls silent or is reset.
    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 100.0).round() as u32 {
            self.session
                .exchange(session::PERIOD)
                .unwrap_or_else(|error| panic!("{error}"));
        }
    }

    /// Waits until the board's status satisfies `done`.
    ///
    /// # Panics
    /// When it is not after `within_s` seconds.
    pub fn wait(&mut self, what: &str, within_s: f64, done: impl Fn(&Status) -> bool) -> Status {
        for _ in 0..(within_s * 50.0) as u32 {
            self.run(0.02);
            let status = self.status();
            if done(&status) {
                return status;
            }
        }
        panic!(
            "not within {within_s} s: {what}; board status: {:?}",
            self.session.status()
        );
    }

    /// The board's status, requested now.
    ///
    /// # Panics
    /// Where the board does not answer.
    pub fn status(&mut self) -> Status {
        self.session
            .get_status()
            .unwrap_or_else(|error| panic!("{error}"))
    }

    /// Injects a fault, or removes it.
    ///
    /// # Panics
    /// Where the rig refuses.
    pub fn inject(&mut self, injection: Injection) {
        let controls = self.session.link().controls().expect("an embedded rig");
        controls
            .inject(injection)
            .unwrap_or_else(|error| panic!("{error}"));
    }

    /// Starts or stops the robot's random path.
    ///
    /// # Panics
    /// Where the rig refuses.
    pub fn robot(&mut self, moving: bool) {
        let controls = self.session.link().controls().expect("an embedded rig");
        controls
            .robot(moving)
            .unwrap_or_else(|error| panic!("{error}"));
    }

    /// The rig's figures; the latencies since the last call.
    ///
    /// # Panics
    /// Where the rig refuses.
    pub fn report(&mut self) -> Report {
        let controls = self.session.link().controls().expect("an embedded rig");
        controls.report().unwrap_or_else(|error| panic!("{error}"))
    }

    /// The plant's true state in each millisecond since the last call.
    pub fn truth(&mut self) -> Vec<Truth> {
        self.truth.extend(self.session.drain().truth);
        std::mem::take(&mut self.truth)
    }
}

/// Whether all six outputs stand at 0 V.
#[must_use]
pub fn all_at_zero(row: &Truth) -> bool {
    row.dac_v.iter().all(|volts| volts.abs() < ZERO_V)
}

/// Value below which a share `part` (0 to 1) of the values lies; 0 where there are none.
#[must_use]
pub fn quantile(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    sorted
        .get((part * last as f64).round() as usize)
        .copied()
        .unwrap_or(0.0)
}
