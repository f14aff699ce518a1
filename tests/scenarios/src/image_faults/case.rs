//! One case: boot, bring up, arm, flip a bit, watch the truth.

use super::draw::{Flip, Memory, Plan};
use control::{Fault, MotorState, SystemState};
use emulator::image::Image;
use emulator_link::Truth;
use faults::campaign::CURRENT_LIMIT_A;
use faults::case::{AFTER_HAZARD_MS, WATCH_MS};
use faults::outcome::Hazard;
use faults::watch::{View, Watch};
use plant::PlantConfig;
use session::link::embedded::{EmbeddedRig, Programs};
use session::link::{EmbeddedOptions, LinkError, RigLink};
use session::{Session, PERIOD};
use std::io::Write;
use std::time::Duration;
use test_stand::{Stand, ZERO_V};
use wire::message::Status;
use wire::UNITS;

/// How long the tensions are held before the first flip, in seconds.
const ARMED_S: f64 = 0.4;
/// A status older than this says nothing, in milliseconds: it comes every 50 ms.
const STATUS_VALID_MS: u32 = 150;
/// Largest change of the setpoints, N, and its period in milliseconds.
const SWING_N: f64 = 0.5;
const SWING_MS: f64 = 400.0;

/// What came of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Number of the case.
    pub number: u64,
    /// The bit that changed.
    pub flip: Flip,
    /// First fault, of the board, of a unit or of the crash record; 0: none that the board told.
    pub fault: u16,
    /// Milliseconds from the flip to the fault.
    pub detected_ms: Option<u32>,
    /// Hazards, and the millisecond of each.
    pub hazards: Vec<(Hazard, u32)>,
    /// Largest tension of any cable, N.
    pub tension_n: f64,
    /// The board was reset.
    pub reset: bool,
    /// At the end the board did not answer.
    pub silent: bool,
    /// At the end all outputs were at 0 V, or the amplifiers had no power.
    pub off: bool,
}

impl Outcome {
    /// A fault was latched, or the board was reset, or it is silent with its motors off.
    #[must_use]
    pub fn is_noticed(&self) -> bool {
        self.fault != 0 || self.reset || self.silent && self.off
    }

    /// Neither fault nor hazard, and the board goes on.
    #[must_use]
    pub fn is_harmless(&self) -> bool {
        !self.is_noticed() && self.hazards.is_empty() && !self.silent
    }
}

/// What every case needs: programs and plant.
pub struct Stage {
    programs: Programs,
    plant: PlantConfig,
    plant_file: tempfile::NamedTempFile,
}

impl Stage {
    /// The image and the rig that the environment names, with the amplifiers' current limit of
    /// docs/bring-up.md.
    ///
    /// # Errors
    /// A program is missing, or the file for the plant cannot be written.
    pub fn new() -> Result<Self, Box<dyn std::error::Error>> {
        let programs = Programs::from_environment()?;
        let mut plant = PlantConfig::default();
        plant.amplifier.current_limit_a = CURRENT_LIMIT_A;
        let mut plant_file = tempfile::NamedTempFile::new()?;
        writeln!(
            plant_file,
            "[amplifier]\ncurrent_limit_a = {CURRENT_LIMIT_A:?}"
        )?;
        plant_file.flush()?;
        Ok(Self {
            programs,
            plant,
            plant_file,
        })
    }

    /// Memory of the image. Boots it once to see how much of the stack is in use.
    ///
    /// # Errors
    /// The rig does not run, or the image does not name its memory.
    pub fn memory(&self) -> Result<Memory, Box<dyn std::error::Error>> {
        let image = Image::read(&self.programs.firmware)?;
        let mut link = self.start(1)?;
        let mut stand = Stand::connect(&mut link);
        let stack = stand.report().stack.ok_or("the image names no stack")?;
        Ok(Memory::of(&image, stack.used_bytes)?)
    }

    fn start(&self, seed: u64) -> Result<EmbeddedRig, LinkError> {
        let options = EmbeddedOptions {
            seed: Some(seed),
            plant: Some(self.plant_file.path().to_owned()),
            ..EmbeddedOptions::default()
        };
        EmbeddedRig::start(&self.programs, &options)
    }

    /// Runs a case on a rig of its own.
    ///
    /// # Errors
    /// The rig ends, or refuses every bit of the plan.
    ///
    /// # Panics
    /// Where the rig cannot be armed: without it no case means anything.
    pub fn run(&self, plan: &Plan) -> Result<Outcome, LinkError> {
        let mut outcomes = self.run_until_noticed(std::slice::from_ref(plan), WATCH_MS)?;
        Ok(outcomes.remove(0))
    }

    /// Runs cases one after the other on one rig until one is noticed, each watched for so many
    /// milliseconds. Bits that did no harm stay as they are. Returns at least one outcome for one
    /// plan or more.
    ///
    /// # Errors
    /// As [`Self::run`].
    ///
    /// # Panics
    /// As [`Self::run`].
    pub fn run_until_noticed(
        &self,
        plans: &[Plan],
        watch_ms: u32,
    ) -> Result<Vec<Outcome>, LinkError> {
        let mut outcomes = Vec::new();
        let Some(first) = plans.first() else {
            return Ok(outcomes);
        };
        let mut link = self.start(first.seed)?;
        let mut lost = None;
        {
            let mut stand = Stand::armed_for(&mut link, first.hold_n, ARMED_S);
            for plan in plans {
                // As a host that foretells: the robot rests.
                stand.hold_foretold(setpoints(plan, 0), Some(0));
                // The setpoints are valid for 100 ms, and go out with each step.
                let mut left = Duration::from_micros(plan.at_us);
                while !left.is_zero() {
                    let step = left.min(PERIOD);
                    (stand.session.exchange(step)).unwrap_or_else(|error| panic!("{error}"));
                    left -= step;
                }
                let mut observer = Observer::new(&self.plant, watch_ms);
                observer.before(&mut stand.session);
                let flip = inject(&mut stand.session, &plan.flips)?;
                if observer.watch(&mut stand, plan) {
                    lost = Some((plan.number, flip, observer));
                    break;
                }
                let outcome = observer.outcome(plan.number, flip);
                let noticed = outcome.is_noticed() || !outcome.hazards.is_empty();
                outcomes.push(outcome);
                if noticed {
                    break;
                }
            }
        }
        if let Some((number, flip, mut observer)) = lost {
            observer.watch_alone(&mut link)?;
            let told = Session::connect(&mut link).and_then(|mut session| {
                let status = session.get_status()?;
                let record = session.info().and_then(|info| info.crash_record.clone());
                Ok(record.map_or(status.fault, |record| record.code))
            });
            let mut outcome = observer.outcome(number, flip);
            match told {
                Ok(told) if outcome.fault == 0 && told != 0 => {
                    outcome.fault = told;
                    outcome.detected_ms = observer.lost_ms;
                }
                Ok(_) => {}
                Err(_) => outcome.silent = true,
            }
            outcomes.push(outcome);
        }
        Ok(outcomes)
    }
}

/// Flips the first bit that exists.
fn inject(session: &mut Session<'_>, flips: &[Flip]) -> Result<Flip, LinkError> {
    let controls = session.link().controls().expect("an embedded rig");
    let mut refused = None;
    for flip in flips {
        match controls.inject(flip.injection) {
            Ok(()) => return Ok(flip.clone()),
            Err(error @ LinkError::Refused(_)) => refused = Some(error),
            Err(error) => return Err(error),
        }
    }
    Err(refused.unwrap_or_else(|| LinkError::Refused("no bit to flip".to_owned())))
}

/// Tensions of the six cables so many milliseconds after the flip: all alike, so that the tip is in
/// balance.
fn setpoints(plan: &Plan, ms: u32) -> [f64; UNITS] {
    let swing = SWING_N * (std::f64::consts::TAU * f64::from(ms) / SWING_MS).sin();
    [plan.hold_n + swing; UNITS]
}

/// What is seen of a rig, millisecond by millisecond.
struct Observer {
    watch: Watch,
    plant: PlantConfig,
    wound_m: [f64; UNITS],
    status: Option<(Status, u32)>,
    ms: u32,
    lost_ms: Option<u32>,
    resets: u32,
    reset: bool,
    off: bool,
    watch_ms: u32,
}

impl Observer {
    fn new(plant: &PlantConfig, watch_ms: u32) -> Self {
        Self {
            watch_ms,
            watch: Watch::new([0.0; UNITS]),
            plant: plant.clone(),
            wound_m: [0.0; UNITS],
            status: None,
            ms: 0,
            lost_ms: None,
            resets: 0,
            reset: false,
            off: false,
        }
    }

    /// What was before the flip does not count; the status does.
    fn before(&mut self, session: &mut Session<'_>) {
        drop(session.drain());
        self.status = session.status().map(|status| (status.clone(), 0));
    }

    fn end_ms(&self) -> u32 {
        let more = if self.watch.awaits_a_fault() {
            AFTER_HAZARD_MS
        } else {
            0
        };
        self.watch_ms + more
    }

    fn outcome(&self, number: u64, flip: Flip) -> Outcome {
        Outcome {
            number,
            flip,
            fault: self.watch.fault,
            detected_ms: self.watch.detected_ms,
            hazards: self.watch.hazards.clone(),
            tension_n: (self.watch.tension_n * 1_000.0).round() * 1e-3,
            reset: self.reset,
            silent: false,
            off: self.off,
        }
    }

    /// Watches with the session. `true`: it has ended before.
    fn watch(&mut self, stand: &mut Stand<'_>, plan: &Plan) -> bool {
        while self.ms < self.end_ms() {
            stand.hold_foretold(setpoints(plan, self.ms), Some(0));
            let advanced = stand.session.exchange(PERIOD);
            let received = stand.session.drain();
            let ms = self.ms;
            if let Some(status) = received.status {
                self.status = Some((status, ms));
            }
            for report in &received.faults {
                let status = self.status.as_mut().map(|(status, _)| status);
                note(status, report.unit, report.code);
            }
            received.truth.iter().for_each(|row| self.row(row));
            if let Err(error) = advanced {
                self.reset = matches!(error, session::SessionError::Reset { .. });
                self.lost_ms = Some(self.ms);
                return true;
            }
        }
        false
    }

    /// Watches on without a session: nothing is known of the board, and a motor that pulls is not
    /// allowed to.
    fn watch_alone(&mut self, link: &mut dyn RigLink) -> Result<(), LinkError> {
        self.status = None;
        while self.ms < self.end_ms() {
            let exchange = link.exchange(&[], PERIOD)?;
            self.reset |= exchange.resets > self.resets;
            exchange.truth.iter().for_each(|row| self.row(row));
        }
        Ok(())
    }

    fn row(&mut self, row: &Truth) {
        self.ms += 1;
        for (wound_m, speed) in self.wound_m.iter_mut().zip(row.reel_rad_s) {
            *wound_m += speed * self.plant.drive.reel_radius_m * 1e-3;
        }
        let amplifier = &self.plant.amplifier;
        let n_per_a = self.plant.drive.tension_per_current_n_per_a();
        let pull_n = |volts: f64| {
            let limit = amplifier.input_limit_v;
            let current = volts.clamp(-limit, limit) * amplifier.gain_a_per_v;
            current.min(amplifier.current_limit_a) * n_per_a
        };
        let mut view = View {
            power: row.amplifier_on,
            tension_n: row.tension_n,
            pull_n: row
                .dac_v
                .map(|volts| if row.amplifier_on { pull_n(volts) } else { 0.0 }),
            wound_m: self.wound_m,
            ..View::default()
        };
        let fresh = |(_, at): &&(Status, u32)| self.ms - at <= STATUS_VALID_MS;
        if let Some((status, _)) = self.status.as_ref().filter(fresh) {
            let in_state = |unit: usize, state| status.units[unit].state == state as u8;
            view.armed = SystemState::from_u8(status.state).is_some_and(SystemState::drives);
            view.running = std::array::from_fn(|unit| in_state(unit, MotorState::Running));
            view.stopping = std::array::from_fn(|unit| in_state(unit, MotorState::Stopping));
            view.board_fault = status.fault;
            view.unit_fault = std::array::from_fn(|unit| status.units[unit].fault);
        }
        self.watch.look(&view, self.ms);
        self.off = !row.amplifier_on || row.dac_v.iter().all(|volts| volts.abs() < ZERO_V);
    }
}

/// A fault that was reported is in force from now on, before the next status says so.
fn note(status: Option<&mut Status>, unit: u8, code: u16) {
    let (Some(status), Some(fault)) = (status, Fault::from_code(code)) else {
        return;
    };
    match status.units.get_mut(usize::from(unit)) {
        Some(slot) => {
            slot.fault = fault.code();
            slot.state = MotorState::Faulted as u8;
        }
        None => {
            status.fault = fault.code();
            status.state = SystemState::Fault as u8;
        }
    }
}
