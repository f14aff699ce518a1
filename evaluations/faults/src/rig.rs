//! The rig of the campaign: `core-sim` with a host on its serial line, brought up, armed, and then broken.

use crate::host::Host;
use crate::injection::Injection as I;
use crate::random::Random;
use control::{Config, SystemState};
use core_sim::CoreRig;
use emulator::devices::nau7802::Defects;
use emulator_link::Injection as Fault;
use plant::{Plant, PlantConfig};
use wire::message::{Command, Response, Status, UnitConfig};
use wire::{ABI_VERSION, SCHEMA_HASH, UNITS};

/// A millisecond, ns.
const MS_NS: u64 = 1_000_000;
/// NAU7802 at gain 128: codes per bridge output in V/V.
const CODES_PER_BRIDGE: f64 = 128.0 * 16_777_216.0;
/// Longest time for the six bring-ups, in milliseconds: each calibration takes 344.
const BRING_UP_MS: u64 = 3_000;

/// See the module's page.
#[derive(Clone)]
pub struct Rig {
    core: CoreRig,
    host: Host,
}

impl Rig {
    /// A rig that is configured, zeroed, armed and has held `hold_n` on each cable for a second and a half.
    ///
    /// # Panics
    /// Where it does not get there: without it no case means anything.
    #[must_use]
    pub fn armed(seed: u64, hold_n: [f64; UNITS], current_limit_a: f64) -> Self {
        let mut config = PlantConfig::default();
        config.amplifier.current_limit_a = current_limit_a;
        let plant = Plant::new(config, seed).expect("the default is valid");
        let random = Random::stream(seed, 0xFA);
        let mut rig = Self {
            core: CoreRig::with_plant(plant, seed).expect("six units"),
            host: Host::new(random),
        };
        rig.prepare(hold_n);
        rig
    }

    fn prepare(&mut self, hold_n: [f64; UNITS]) {
        self.run_ms(20);
        let hello = self.command(Command::Hello {
            abi: ABI_VERSION,
            schema: SCHEMA_HASH,
        });
        assert!(matches!(hello, Response::Hello(_)), "{hello:?}");
        for unit in 0..UNITS {
            let config = self.config(unit);
            self.must(Command::StageConfig {
                unit: unit as u8,
                config,
            });
        }
        self.must(Command::CommitConfig);
        self.bring_up();
        self.must(Command::Zero { units: 0b11_1111 });
        self.run_ms(1_000);
        self.must(Command::Arm);
        self.host.hold(hold_n, self.core.now_ns() / MS_NS);
        self.run_ms(1_500);
        let status = self.status();
        assert_eq!(status.state, SystemState::Running as u8, "{status:?}");
        assert!(!self.is_faulted(), "{status:?}");
    }

    fn bring_up(&mut self) {
        let waited = (0..BRING_UP_MS).find(|_| {
            self.run_ms(1);
            self.status().state == SystemState::Ready as u8
        });
        assert!(waited.is_some(), "{:?}", self.status());
    }

    /// The configuration of a unit that was calibrated to 1 %.
    fn config(&mut self, unit: usize) -> UnitConfig {
        let per_n = self.per_n(unit) * (1.0 + 0.005 * self.host.random.normal());
        let zero = self.zero_of(unit, per_n);
        let zero_code = (zero * CODES_PER_BRIDGE) as i32;
        UnitConfig {
            scale_pn_per_count: (1e12 / (per_n * CODES_PER_BRIDGE)).round() as i32,
            travel_nm_per_count: -4_229,
            zero_code,
            stored_zero_code: zero_code,
            zero_deviation_un: 2_000_000,
            ..Config::nominal()
        }
    }

    /// Sends a command that must be accepted.
    fn must(&mut self, command: Command) {
        let response = self.command(command.clone());
        assert_eq!(response, Response::Done, "{command:?}");
    }

    /// Sends a command over the line and waits for its response.
    fn command(&mut self, command: Command) -> Response {
        let bytes = self.host.frame(command);
        let mut sent = self.core.advance(MS_NS, &bytes).from_board;
        for _ in 0..20 {
            if let Some(response) = self.host.response(&sent) {
                return response;
            }
            sent = self.core.advance(MS_NS, &[]).from_board;
        }
        panic!("no response within 20 ms")
    }

    /// The board's status.
    #[must_use]
    pub fn status(&self) -> Status {
        self.core.status()
    }

    /// Whether a fault is latched.
    #[must_use]
    pub fn is_faulted(&self) -> bool {
        let status = self.status();
        status.fault != 0 || status.units.iter().any(|unit| unit.fault != 0)
    }

    /// Whether the amplifiers have power.
    #[must_use]
    pub const fn power(&self) -> bool {
        self.core.board().powered()
    }

    /// True tension of a cable, N.
    #[must_use]
    pub fn tension_n(&self, unit: usize) -> f64 {
        self.core.plant().tension_n(unit)
    }

    /// Cable that a reel has wound in since the start, m.
    #[must_use]
    pub fn wound_m(&self, unit: usize) -> f64 {
        let plant = self.core.plant();
        plant.reel_rad(unit) * plant.config().drive.reel_radius_m
    }

    /// Pull that a motor exerts, N, from the current in it.
    #[must_use]
    pub fn pull_n(&self, unit: usize) -> f64 {
        let plant = self.core.plant();
        plant.current_a(unit) * plant.config().drive.tension_per_current_n_per_a()
    }

    /// Lets milliseconds pass.
    pub fn run_ms(&mut self, ms: u64) {
        for _ in 0..ms {
            let now_ms = self.core.now_ns() / MS_NS;
            for command in self.host.elsewhere(now_ms) {
                self.core.command_over_usb(command);
            }
            let bytes = self.host.send(now_ms, self.core.plant());
            self.core.advance(MS_NS, &bytes);
        }
    }

    /// Puts an injection in force.
    pub fn inject(&mut self, what: I) {
        let number = |unit: usize| unit as u8 + 1;
        let now_ns = self.core.now_ns();
        match what {
            I::OpenBridge(unit) => self.cell(unit).open_bridge = true,
            I::Frozen(unit) => self.cell(unit).frozen = true,
            I::WrongSign(unit) => self.cell(unit).wrong_sign = true,
            I::Sensitivity(unit, share) => {
                let zero = self.zero_of(unit, self.per_n(unit));
                let cell = self.cell(unit);
                cell.lost_share = 1.0 - share;
                cell.offset += zero * (1.0 - share);
            }
            I::Offset(unit, n) => {
                let offset = n * self.per_n(unit);
                self.cell(unit).offset += offset;
            }
            I::Drift(unit, n) => {
                self.cell(unit).drift = n * self.per_n(unit);
                self.cell(unit).drift_from_ns = now_ns;
            }
            // The whole supply at the input.
            I::Saturated(unit, high) => self.cell(unit).offset = if high { 1.0 } else { -1.0 },
            I::Silent(unit) => self.cell(unit).one_in = u64::MAX,
            I::Missing(unit, n) => self.cell(unit).one_in = n.into(),
            I::Period(unit, factor) => self.cell(unit).stretch = factor - 1.0,
            I::Spikes(unit, n) => self.cell(unit).spike = n * self.per_n(unit),
            I::Noise(unit, n) => self.cell(unit).noise = n * self.per_n(unit),
            I::Extra(unit) => self.core.defects().twice[unit] = true,
            I::CodeBit(unit, bit, often) => self.core.defects().codes[unit].flip(bit, often),
            I::CodeBitStuck(unit, bit, true) => self.core.defects().codes[unit].set |= 1 << bit,
            I::CodeBitStuck(unit, bit, false) => self.core.defects().codes[unit].clear |= 1 << bit,
            I::Exchanged(a, b) => self.core.board_mut().exchange_channels([a, b]),
            I::ReadsFail(unit) => self.on_the_board(Fault::Nack(number(unit))),
            I::BusHeld => self.on_the_board(Fault::HoldSda(true)),
            I::MuxSilent => self.on_the_board(Fault::MuteMux(true)),
            I::DacStuck(unit) => self.on_the_board(Fault::StuckDac(number(unit), true)),
            I::DacBit(unit, bit, often) => self.core.defects().words[unit].flip(bit, often),
            I::DacSelect(unit, other) => self.core.defects().dac_of[unit] = Some(other),
            I::DacLink => {
                (0..UNITS).for_each(|unit| self.inject(I::DacStuck(unit)));
                self.core.defects().health.dac_error = Some(0x1002);
            }
            I::AmplifierOff(unit) => self.core.board_mut().scale_amplifier(unit, 0.0),
            I::AmplifierGain(unit, share) => self.core.board_mut().scale_amplifier(unit, share),
            I::Reversed(unit) => self.core.board_mut().scale_amplifier(unit, -1.0),
            I::EncoderFrozen(unit) => self.on_the_board(Fault::FreezeEncoder(number(unit), true)),
            I::EncoderReversed(unit) => {
                self.on_the_board(Fault::ReverseEncoder(number(unit), true));
            }
            I::EncoderJump(unit, counts) => self.core.board_mut().jump_encoder(unit, counts),
            I::EncoderNoise(unit, hz) => self.core.defects().encoder_noise_hz[unit] = hz,
            I::StopElsewhere => {
                self.core.command_over_usb(Command::Stop);
            }
            I::Hang => self.core.defects().hung = true,
            I::Overrun(us) => self.core.defects().health.longest_pass_us = us,
            I::EventsLost => self.core.defects().health.events_lost += 1,
            I::RegisterChanged => {
                self.core.defects().health.register_changed = Some(0x4001_300C);
            }
            I::Reset => self.core.reset(None),
            I::ConfigBit(unit, bit) => self.core.flip_config(unit, bit),
            I::RobotMoves => self.core.set_robot_moving(true),
            I::EStop => self.on_the_board(Fault::EStop(true)),
            I::FrameBit(..)
            | I::FrameCut(_)
            | I::Replay(_)
            | I::Garbage(_)
            | I::SetpointRange(..)
            | I::SetpointOffset(_)
            | I::WrongCosine(..)
            | I::WrongDirections
            | I::HostStops
            | I::HostPauses(_)
            | I::HostSlow(_)
            | I::StatusElsewhere => self.host.inject(what, now_ns / MS_NS),
        }
    }

    fn on_the_board(&mut self, fault: Fault) {
        self.core.inject(fault).expect("such a unit and chip");
    }

    /// What is broken at a unit's load cell and converter.
    fn cell(&mut self, unit: usize) -> &mut Defects {
        self.core.board_mut().converter_defects(unit)
    }

    /// Bridge output of a newton at a unit's cell, V/V.
    fn per_n(&self, unit: usize) -> f64 {
        self.core.plant().parameters(unit).bridge_per_n
    }

    /// Bridge output of a unit's slack cable where a newton gives `per_n`, V/V.
    fn zero_of(&self, unit: usize, per_n: f64) -> f64 {
        let parameters = self.core.plant().parameters(unit);
        parameters.bridge_zero_v_per_v + parameters.assembly_weight_n * per_n
    }
}
