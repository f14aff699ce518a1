//! A board for tests: speaks the protocol over memory, runs the real control core against the
//! plant, and can simulate errors. It replaces the firmware on the link; the firmware itself is
//! tested in the scenarios.
//!
//! | part | file |
//! | --- | --- |
//! | commands, responses, status | `protocol` |
//! | samples, states, the milliseconds | `simulate` |
//! | bytes in and out, injections | `transport` |

mod protocol;
mod simulate;
mod transport;

use control::unit::Setpoint;
use control::zero::Averager;
use control::{Config, Fault, State, SystemState};
use plant::{Plant, PlantConfig};
use simulate::SINC;
use std::collections::VecDeque;
use wire::message::Batch;
use wire::{Command, Decoder, UNITS};

const MS: u64 = 1_000_000;

/// How the board misbehaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Behavior {
    /// Not at all.
    Good,
    /// Answers hello with another ABI version.
    OtherAbi(u16),
    /// Sends bytes that are no frames, and nothing else.
    Garbage,
    /// Sends nothing.
    Silent,
    /// Corrupts one byte in this many.
    Noisy(u32),
    /// Refuses everything but hello.
    Refusing,
    /// The link breaks at this time, ns.
    BreaksAt(u64),
    /// The board falls silent at this time, ns.
    MuteAt(u64),
    /// The board restarts at this time, ns.
    ResetsAt(u64),
    /// The link reports no pose, as a board's does.
    NoPose,
    /// The link reports a pose until this time, ns, and the board goes on.
    PoseUntil(u64),
    /// Every n-th frame of the board is dropped, though counted.
    Drops(u16),
    /// The answer to each command gets lost, and the answer to its repetition arrives.
    LosesAnswers,
}

/// The board, with the plant that it pulls at.
pub struct FakeBoard {
    /// How it misbehaves.
    pub behavior: Behavior,
    /// What its motors pull.
    pub plant: Plant,
    /// State of the board.
    pub system: SystemState,
    /// Commands that it received, oldest first.
    pub commands: Vec<Command>,
    /// Board fault that is latched.
    pub fault: Option<(Fault, u32)>,
    /// Faults of the units that are latched.
    pub unit_faults: [Option<(Fault, u32)>; UNITS],
    /// The controller's own number; all 0: none.
    pub unique_id: [u32; 3],
    /// Time of the link, ns.
    pub now_ns: u64,
    epoch_ns: u64,
    resets: u32,
    decoder: Decoder,
    connected: bool,
    seq: u16,
    answer_lost: Option<Command>,
    out: Vec<u8>,
    batch: Option<Batch>,
    configs: [Config; UNITS],
    staged: [Option<Config>; UNITS],
    states: [State; UNITS],
    samples: [u32; UNITS],
    zeroing: [Option<Averager>; UNITS],
    tip: control::tip::TipGuard,
    board_config: wire::message::BoardConfig,
    setpoints: [Setpoint; UNITS],
    expires_ns: Option<u64>,
    unplugged: [bool; UNITS],
    weight_n: [f64; UNITS],
    next_sample_ns: [u64; UNITS],
    bridge: [VecDeque<f64>; UNITS],
    random: u64,
}

impl FakeBoard {
    /// The rig of seed 1.
    #[must_use]
    pub fn new(behavior: Behavior) -> Self {
        Self::seeded(behavior, 1)
    }

    /// A rig of its own for each seed.
    #[must_use]
    pub fn seeded(behavior: Behavior, seed: u64) -> Self {
        Self::with(behavior, seed, PlantConfig::default())
    }

    /// A rig of its own physics.
    ///
    /// # Panics
    /// On a configuration that the plant refuses.
    #[must_use]
    pub fn with(behavior: Behavior, seed: u64, plant: PlantConfig) -> Self {
        let mut plant = Plant::new(plant, seed).expect("a good plant");
        plant.set_amplifier_power(true);
        Self {
            behavior,
            plant,
            system: SystemState::BringUp,
            commands: Vec::new(),
            fault: None,
            unit_faults: [None; UNITS],
            unique_id: [0; 3],
            now_ns: 0,
            epoch_ns: 0,
            resets: 0,
            decoder: Decoder::new(),
            connected: false,
            seq: 0,
            answer_lost: None,
            out: Vec::new(),
            batch: None,
            configs: [Config::default(); UNITS],
            staged: [None; UNITS],
            states: [State::default(); UNITS],
            samples: [0; UNITS],
            zeroing: [None; UNITS],
            tip: control::tip::TipGuard::new(20_000_000),
            board_config: wire::message::BoardConfig::default(),
            setpoints: [Setpoint::default(); UNITS],
            expires_ns: None,
            unplugged: [false; UNITS],
            weight_n: [0.0; UNITS],
            next_sample_ns: core::array::from_fn(|i| 700_000 * i as u64 + MS),
            bridge: core::array::from_fn(|_| VecDeque::from([0.0; SINC.len()])),
            random: 1,
        }
    }

    pub(super) fn noise(&mut self) -> f64 {
        // Sum of uniforms: near enough to a bell, SD about 0.58.
        (0..4)
            .map(|_| {
                self.random = self
                    .random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (self.random >> 33) as f64 / (1u64 << 30) as f64 - 1.0
            })
            .sum::<f64>()
            * 0.5
    }
}
