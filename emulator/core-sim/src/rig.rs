//! The rig as one object: the same interface as `emulator::Rig`, without an image.

use crate::defects::Defects;
use crate::line::USB;
use crate::sensors::Sensors;
use crate::superloop::Superloop;
use crate::timing::TICK_NS;
use control::Fault;
use emulator::board::Board;
use emulator_link::{Advanced, Injection, Pose, Report, Truth};
use plant::{ConfigError, Plant, PlantConfig};
use robot::arm::{ArmConfig, ArmError, VirtualArm};
use std::any::Any;
use std::time::Instant;
use wire::message::{Command, CrashRecord, Response, Status};
use wire::{HostFrame, UNITS};

/// Slack of the cables at power-on where a virtual arm holds them, m: an operator lays them loose
/// for the zeroing, and the arm moves by a millimetre when it takes hold.
const SLACK_M: f64 = 5e-3;

/// Slack of the cable of a unit that is not used, m: more than a workspace is wide.
const LOOSE_M: f64 = 1.0;

/// Spacing of the rows of truth, ns.
const ROW_NS: u64 = 1_000_000;

/// How a rig is put together.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Seed of everything random.
    pub seed: u64,
    /// The plant behind the board.
    pub plant: PlantConfig,
    /// A virtual arm that holds the cables' ends; `None`: the plant's prescribed path. With an arm
    /// the cables have at least 5 mm of slack at power-on.
    pub robot: Option<ArmConfig>,
    /// Number of the run of this rig: noise, zeros, clocks and the prescribed path are drawn anew
    /// for each. Run 0 draws them from `seed` alone.
    pub run: u64,
    /// Seed of the chips (noise, zeros, clocks); `None`: that of the run. With it one rig and one
    /// arm run several trials whose noise differs.
    pub chips_seed: Option<u64>,
    /// Units whose cables hang loose because they are not used.
    pub loose: [bool; UNITS],
}

/// Why a rig can't be built, or a request not be carried out.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The plant's configuration.
    #[error(transparent)]
    Plant(#[from] ConfigError),
    /// The virtual arm's configuration.
    #[error(transparent)]
    Robot(#[from] ArmError),
    /// Plant and board do not fit, or an injection is impossible.
    #[error("{0}")]
    Refused(String),
}

/// The rig. See the crate's page. A copy goes on by itself from the same state.
#[derive(Debug, Clone)]
pub struct CoreRig {
    board: Board,
    sensors: Sensors,
    superloop: Superloop,
    now_ns: u64,
    next_tick_ns: u64,
    wall_ns: u64,
    seed: u64,
    resets: u32,
}

impl CoreRig {
    /// A rig at power-on. Virtual time stands at zero.
    ///
    /// # Errors
    /// See [`RigError`].
    pub fn new(options: Options) -> Result<Self, RigError> {
        let seed = options.seed;
        let of_run = plant::rng::seed_of_run(seed, options.run);
        let chips_seed = options.chips_seed.unwrap_or(of_run);
        let mut plant = match &options.robot {
            None => Plant::of_run(options.plant, seed, options.run)?,
            Some(config) => {
                let arm = Box::new(VirtualArm::new(config, seed)?);
                let mut plant = options.plant;
                plant.cable.initial_slack_m = plant.cable.initial_slack_m.max(SLACK_M);
                Plant::with_robot(plant, seed, arm)?
            }
        };
        for unit in (0..UNITS.min(plant.units())).filter(|unit| options.loose[*unit]) {
            // There is such a unit.
            let _ = plant.lay_loose(unit, LOOSE_M);
        }
        Self::with_chips(plant, seed, chips_seed)
    }

    /// A rig with a plant that the caller has built, for example with a robot
    /// ([`Plant::with_robot`]).
    ///
    /// # Errors
    /// The plant must have six units.
    pub fn with_plant(plant: Plant, seed: u64) -> Result<Self, RigError> {
        Self::with_chips(plant, seed, seed)
    }

    fn with_chips(plant: Plant, seed: u64, chips_seed: u64) -> Result<Self, RigError> {
        let mut board = Board::new(plant, chips_seed).map_err(RigError::Refused)?;
        board.set_unique_id(seed);
        Ok(Self {
            superloop: Superloop::new(&board, None),
            board,
            sensors: Sensors::new(),
            now_ns: 0,
            next_tick_ns: TICK_NS,
            wall_ns: 0,
            seed,
            resets: 0,
        })
    }

    /// Seed of this run.
    #[must_use]
    pub const fn seed(&self) -> u64 {
        self.seed
    }

    /// Virtual time since power-on, ns.
    #[must_use]
    pub const fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Puts `to_board` on the board's receive line and lets `duration_ns` pass.
    pub fn advance(&mut self, duration_ns: u64, to_board: &[u8]) -> Advanced {
        let began = Instant::now();
        self.superloop.line.queue(self.now_ns, to_board);
        let end = self.now_ns.saturating_add(duration_ns);
        let truth = self.run(end);
        self.wall_ns += u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
        Advanced {
            now_ns: end,
            from_board: self.superloop.line.sent(end),
            pose: self.pose(),
            truth,
            resets: self.resets,
        }
    }

    /// The pose as the robot's own controller reports it: a virtual arm's from its encoders.
    fn pose(&mut self) -> Pose {
        let position_m = self.arm_mut().map(|arm| arm.reported_tip_m());
        let pose = self.board.pose();
        position_m.map_or(pose, |position_m| Pose { position_m, ..pose })
    }

    fn run(&mut self, end: u64) -> Vec<Truth> {
        let mut rows = Vec::new();
        if end == self.now_ns {
            return vec![self.board.truth(end)];
        }
        let mut row = (self.now_ns / ROW_NS + 1) * ROW_NS;
        while row < end {
            self.run_to(row);
            rows.push(self.board.truth(row));
            row += ROW_NS;
        }
        self.run_to(end);
        rows.push(self.board.truth(end));
        rows
    }

    /// Everything that is due by `end` happens, in order.
    fn run_to(&mut self, end: u64) {
        loop {
            let or_never = |time: Option<u64>| time.unwrap_or(u64::MAX);
            let next = (self.next_tick_ns)
                .min(or_never(self.board.next_event()))
                .min(or_never(self.sensors.due()))
                .min(or_never(self.superloop.due()));
            if next > end {
                break;
            }
            // What was due before belongs to now: time never runs back.
            let at = next.max(self.now_ns);
            self.now_ns = at;
            self.board.advance(at);
            self.sensors.edges(&mut self.board, at);
            self.sensors.advance(&mut self.board, at);
            self.superloop
                .events(&mut self.board, &mut self.sensors, at);
            self.superloop
                .advance(&mut self.board, &mut self.sensors, at);
            if self.next_tick_ns <= at {
                self.next_tick_ns += TICK_NS;
                self.sensors.tick(&mut self.board, at);
                self.superloop
                    .events(&mut self.board, &mut self.sensors, at);
                let reset = self.superloop.tick(&mut self.board, &mut self.sensors, at);
                if reset.is_some() {
                    self.reset(reset);
                }
            }
        }
        self.board.advance(end);
        self.now_ns = end;
    }

    /// Resets the controller: the DACs go to 0 V, and it begins anew with what is still broken.
    /// `record`: what it left behind.
    pub fn reset(&mut self, record: Option<CrashRecord>) {
        let defects = Defects {
            hung: false,
            ..self.superloop.defects.clone()
        };
        self.superloop = Superloop::new(&self.board, record);
        self.superloop.defects = defects;
        self.sensors = self.sensors.reset();
        self.board.i2c_stop();
        self.board.hold_dacs(self.now_ns, true);
        self.board.hold_dacs(self.now_ns, false);
        self.resets += 1;
    }

    /// What is broken in the controller, to be changed.
    pub fn defects(&mut self) -> &mut Defects {
        &mut self.superloop.defects
    }

    /// The board with its chips.
    #[must_use]
    pub const fn board(&self) -> &Board {
        &self.board
    }

    /// The board's chips, to break them.
    pub fn board_mut(&mut self) -> &mut Board {
        &mut self.board
    }

    /// Flips a bit of what was computed from the configuration of `unit` (from 0): a fault of the
    /// memory.
    #[cfg(feature = "injection")]
    pub fn flip_config(&mut self, unit: usize, bit: u32) {
        self.superloop.flip_config(unit, bit);
    }

    /// The board's status, past the line.
    #[must_use]
    pub fn status(&self) -> Status {
        self.superloop.status(self.now_ns)
    }

    /// A command on the other link, which this rig has no host program for.
    pub fn command_over_usb(&mut self, command: Command) -> Option<Response> {
        if self.superloop.defects.hung {
            return None;
        }
        let frame = HostFrame { seq: 1, command };
        self.superloop
            .command(&mut self.board, &mut self.sensors, self.now_ns, USB, &frame)
    }

    /// Starts or stops the robot's path.
    pub fn set_robot_moving(&mut self, moving: bool) {
        self.board.set_robot_moving(moving);
    }

    /// Lets another controller drive the amplifiers, V at their inputs; `None`: the board's DACs
    /// again.
    pub fn drive_outside(&mut self, volts: Option<[f64; UNITS]>) {
        self.board.drive_outside(volts);
    }

    /// The virtual arm that holds the cables' ends, where there is one.
    pub fn arm_mut(&mut self) -> Option<&mut VirtualArm> {
        let robot: &mut dyn Any = self.board.robot_mut()?;
        robot.downcast_mut()
    }

    /// The plant behind the board.
    #[must_use]
    pub const fn plant(&self) -> &Plant {
        self.board.plant()
    }

    /// Injects a fault, or removes it.
    ///
    /// # Errors
    /// What can't be done, and why: faults of the core itself need the embedded rig.
    pub fn inject(&mut self, injection: Injection) -> Result<(), RigError> {
        if matches!(injection, Injection::HangLoop | Injection::FlipBit(..)) {
            return Err(RigError::Refused(
                "this rig has no emulated controller that could hang or lose a bit; use the link `embedded`"
                    .to_owned(),
            ));
        }
        match injection {
            Injection::LoseClock(lost) => {
                self.board.set_clock_lost(lost);
                // The clock security system's interrupt resets a controller that runs; one without
                // a clock from the start boots on its own.
                if lost {
                    let record = (self.now_ns > 0).then(|| CrashRecord {
                        code: Fault::ClockFailure.code(),
                        detail: 0,
                        pc: 0,
                        text: Default::default(),
                    });
                    self.reset(record);
                }
            }
            // What the controller finds at its start.
            Injection::BrownOutLevel(_) | Injection::DacResetPull(_) => {
                self.board.inject(injection).map_err(RigError::Refused)?;
                if self.now_ns == 0 {
                    self.reset(None);
                }
            }
            _ => self.board.inject(injection).map_err(RigError::Refused)?,
        }
        Ok(())
    }

    /// The figures so far. Those of the emulated controller (instructions, sleep) are 0.
    pub fn report(&mut self) -> Report {
        let (conversions, conversions_read) = self.board.conversions();
        Report {
            now_ns: self.now_ns,
            wall_ns: self.wall_ns,
            latencies: self.board.probe.take(),
            conversions,
            conversions_read,
            alive_hz: self.board.alive_hz(),
            ..Report::default()
        }
    }
}
