//! The rig of the campaign: `core-sim` with a host on its serial line, brought up, armed, and then
//! broken.

use crate::host::{Host, Step};
use crate::injection::{Injection as I, Phase};
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
/// Time for which a zero is measured, in milliseconds: 256 samples, and some.
const ZERO_MS: u64 = 900;
/// The DAC's largest code, in straight binary: +10 V.
const FULL_SCALE: u16 = 0xFFFF;
/// All six.
const ALL_UNITS: u8 = 0b11_1111;

/// See the module's page.
#[derive(Clone)]
pub struct Rig {
    core: CoreRig,
    host: Host,
    hold_n: [f64; UNITS],
}

impl Rig {
    /// A rig at power-on, with a host that is to hold `hold_n` on each cable.
    ///
    /// # Panics
    /// Where there can be none.
    #[must_use]
    pub fn at_power_on(seed: u64, hold_n: [f64; UNITS], current_limit_a: f64) -> Self {
        Self::with_slack(seed, hold_n, current_limit_a, 0.0)
    }

    /// As [`Self::at_power_on`], with so much slack in each cable, m.
    fn with_slack(seed: u64, hold_n: [f64; UNITS], current_limit_a: f64, slack_m: f64) -> Self {
        let mut config = PlantConfig::default();
        config.cable.initial_slack_m = slack_m;
        config.amplifier.current_limit_a = current_limit_a;
        Self::of(config, seed, hold_n)
    }

    /// A rig of this plant at power-on.
    ///
    /// # Panics
    /// Where there can be none.
    #[must_use]
    pub fn of(config: PlantConfig, seed: u64, hold_n: [f64; UNITS]) -> Self {
        let plant = Plant::new(config, seed).expect("a valid plant");
        let random = Random::stream(seed, 0xFA);
        let mut rig = Self {
            core: CoreRig::with_plant(plant, seed).expect("six units"),
            host: Host::new(random),
            hold_n,
        };
        let steps = rig.after_power_on();
        rig.host.plan(steps);
        rig
    }

    /// A rig that is configured, zeroed, armed and has held `hold_n` on each cable for a second and
    /// a half.
    ///
    /// # Panics
    /// Where it does not get there: without it no case means anything.
    #[must_use]
    pub fn armed(seed: u64, hold_n: [f64; UNITS], current_limit_a: f64) -> Self {
        Self::try_armed(seed, hold_n, current_limit_a).expect("armed and without a fault")
    }

    /// As [`Self::armed`]; `None` where it does not get there, as its motors are too weak.
    #[must_use]
    pub fn try_armed(seed: u64, hold_n: [f64; UNITS], current_limit_a: f64) -> Option<Self> {
        let mut rig = Self::at_power_on(seed, hold_n, current_limit_a);
        while rig.host.steps_left() > 0 {
            rig.run_ms(1);
        }
        let running = rig.status().state == SystemState::Running as u8;
        (running && !rig.is_faulted()).then_some(rig)
    }

    /// Rigs at the beginning of each phase, in the order of [`Phase::ALL`], with so much slack at
    /// power-on, m.
    ///
    /// # Panics
    /// As [`Self::armed`].
    #[must_use]
    pub fn phases(
        seed: u64,
        hold_n: [f64; UNITS],
        current_limit_a: f64,
        slack_m: f64,
    ) -> Vec<Self> {
        let begun = |phase| match phase {
            Phase::Boot => usize::MAX,
            Phase::BringUp => 6,
            Phase::Zeroing => 4,
            Phase::FirstSecond => 2,
            Phase::Holding | Phase::Clear | Phase::Reconfiguration => 0,
        };
        let mut rig = Self::with_slack(seed, hold_n, current_limit_a, slack_m);
        let rigs = Phase::ALL.iter().map(|(phase, _)| {
            while rig.host.steps_left() > begun(*phase) {
                rig.run_ms(1);
            }
            let mut begins = rig.clone();
            match phase {
                Phase::Holding => rig.assert_armed(),
                Phase::Clear => begins.clear(),
                Phase::Reconfiguration => begins.reconfigure(),
                _ => {}
            }
            begins
        });
        rigs.collect()
    }

    fn assert_armed(&self) {
        let status = self.status();
        assert_eq!(status.state, SystemState::Running as u8, "{status:?}");
        assert!(!self.is_faulted(), "{status:?}");
    }

    /// What the host does before all else, and then as after a configuration.
    fn after_power_on(&mut self) -> Vec<Step> {
        let hello = Command::Hello {
            abi: ABI_VERSION,
            schema: SCHEMA_HASH,
        };
        let mut steps = vec![Step::Wait(20), Step::Must(hello)];
        for unit in 0..UNITS {
            let config = self.config(unit);
            steps.push(Step::Must(Command::StageConfig {
                unit: unit as u8,
                config,
            }));
        }
        steps.push(Step::Must(Command::CommitConfig));
        steps.extend(self.after_commit());
        steps
    }

    fn after_commit(&self) -> [Step; 6] {
        let [arm, hold, wait] = self.after_ready();
        [
            Step::Ready(BRING_UP_MS),
            Step::Must(Command::Zero { units: ALL_UNITS }),
            Step::Wait(ZERO_MS),
            arm,
            hold,
            wait,
        ]
    }

    fn after_ready(&self) -> [Step; 3] {
        [
            Step::Must(Command::Arm),
            Step::Hold(Some(self.hold_n)),
            Step::Wait(1_500),
        ]
    }

    /// The host stops, clears and arms again.
    fn clear(&mut self) {
        let hold = Step::Hold(Some(self.hold_n));
        self.host.plan([
            Step::Hold(None),
            Step::Must(Command::Stop),
            Step::Wait(200),
            Step::Try(Command::ClearFaults),
            Step::Ready(BRING_UP_MS),
            Step::Must(Command::Arm),
            hold,
            Step::Wait(500),
        ]);
    }

    /// The host clears what is latched and goes on with what it did, as far as the board lets it;
    /// and does that once more.
    pub fn clear_twice(&mut self) {
        let once = [
            Step::Hold(None),
            Step::Try(Command::ClearFaults),
            Step::Wait(900),
            Step::Try(Command::Arm),
            Step::Hold(Some(self.hold_n)),
            Step::Wait(600),
        ];
        self.host.plan(once.clone().into_iter().chain(once));
    }

    /// Whether the robot moves, and the board is told so.
    pub fn move_robot(&mut self, moves: bool) {
        self.core.set_robot_moving(moves);
    }

    /// The host disarms and arms again, with the zeros that there are.
    pub fn arm_again(&mut self) {
        let [arm, hold, wait] = self.after_ready();
        self.host.plan([
            Step::Hold(None),
            Step::Must(Command::Disarm),
            Step::Wait(600),
            Step::Ready(BRING_UP_MS),
            arm,
            hold,
            wait,
        ]);
    }

    /// The armed rig holds one set of tensions after the other, N, each for so many milliseconds.
    pub fn work(&mut self, sets_n: impl IntoIterator<Item = [f64; UNITS]>, each_ms: u64) {
        let steps = sets_n
            .into_iter()
            .flat_map(|set_n| [Step::Hold(Some(set_n)), Step::Wait(each_ms)]);
        self.host.plan(steps);
    }

    /// The host disarms, switches a unit off and on again, and arms. It takes no zeros: friction of
    /// the reels still holds the cables.
    fn reconfigure(&mut self) {
        let unit = self.host.random.below(UNITS as u64) as usize;
        let config = self.config(unit);
        let mut off = config;
        off.enabled = false;
        let stage = |config: UnitConfig| {
            Step::Must(Command::StageConfig {
                unit: unit as u8,
                config,
            })
        };
        let steps = [
            Step::Must(Command::Disarm),
            Step::Hold(None),
            Step::Wait(600),
            stage(off),
            Step::Must(Command::CommitConfig),
            Step::Wait(100),
            stage(config),
            Step::Must(Command::CommitConfig),
            Step::Ready(BRING_UP_MS),
        ];
        let steps: Vec<Step> = steps.into_iter().chain(self.after_ready()).collect();
        self.host.plan(steps);
    }

    /// Whether the host has something left to do.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.host.steps_left() > 0
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

    /// Sends a command over the line and waits for its response.
    ///
    /// # Panics
    /// Where none comes within 20 ms.
    pub fn command(&mut self, command: Command) -> Response {
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
            let status = self.status();
            let ready = status.state == SystemState::Ready as u8 && !status.alive_withheld;
            let mut bytes = self.host.act(now_ms, ready);
            bytes.extend(self.host.send(now_ms, self.core.plant()));
            let sent = self.core.advance(MS_NS, &bytes).from_board;
            self.host.hear(&sent);
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
            I::BusBit(bit) => self.on_the_board(Fault::FlipBusBit(bit)),
            I::ReadsFail(unit) => self.on_the_board(Fault::Nack(number(unit))),
            I::BusHeld => self.on_the_board(Fault::HoldSda(true)),
            I::MuxSilent => self.on_the_board(Fault::MuteMux(true)),
            I::DacStuck(unit) => self.on_the_board(Fault::StuckDac(number(unit), true)),
            I::DacBit(unit, bit, often) => self.core.defects().words[unit].flip(bit, often),
            I::DacBitStuck(unit, bit, true) => self.core.defects().words[unit].set |= 1 << bit,
            I::DacBitStuck(unit, bit, false) => self.core.defects().words[unit].clear |= 1 << bit,
            I::DacFull(unit) => {
                self.core.board_mut().dac_code(now_ns, unit, FULL_SCALE);
                self.on_the_board(Fault::StuckDac(number(unit), true));
            }
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
