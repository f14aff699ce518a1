//! One sample of one unit: load code in, DAC code out, every term on the way.
//!
//! ```text
//! code ─ zero, scale ─ spike gate ─ curve, creep ─ filter ─ 1/cos ─▶ tension ─┐
//! setpoint ─ slew ──────────────────────────────┬─▶ error ─ P, I ─┐
//! counts ─ travel ─┬─ direction ─ friction model ◀┘ feedforward ──┤
//!                  └─ high pass ─ damping ────────────────────────┤
//!                     slack brake, slew, limits ◀─────────────────┘─▶ command ─▶ DAC code
//! ```

use crate::cell::Creep;
use crate::config::Config;
use crate::convert;
use crate::faults::Fault;
use crate::filter::{Filter, SpikeGate};
use crate::friction::{
    travel, Direction, DirectionEstimator, Feedforward, Level, ReelSpeed, Stillness,
};
use crate::limits::Ramp;
use crate::pid::{periods_shift, Measured, Pid, Terms};
use crate::preview::Preview;
use crate::units::{AdcCode, DacCode, EncoderCounts, InvCos, Micros, Newton};
use crate::NOMINAL_PERIOD_US;
use wire::message::{flags, Sample, UnitSetpoint};

/// Shortest and longest time between two samples that the integral and the slew limits use, in
/// microseconds. Anything outside is a restart or an error, not a time to integrate over.
pub const DT_RANGE_US: (u32, u32) = (1_000, 12_500);

/// Samples in a row past the over-tension limit, or at the converter's end, that make a fault. One
/// alone may be a read error.
pub const TRIP_SAMPLES: u8 = 2;

/// Below this tension, or half the setpoint where that is less, a cable counts as slack: half of
/// the allocation's smallest tension.
pub const SLACK_TENSION: Newton = Newton::from_un(1_000_000);

/// Largest setpoint while a slack cable is wound in: the allocation's smallest tension. The ramp
/// goes on from here once the cable is tight. A loop that works towards 12 N when a slack cable
/// closes passes 13 N.
pub const TAKE_UP_TENSION: Newton = Newton::from_un(2_000_000);

/// Reel speed from which a cable without tension counts as being closed, in nanometres a nominal
/// sample: 20 mm/s, below the speed that the brake holds. Slower, the cable closes with less than 1
/// N more (below). A reel that friction holds must get the whole setpoint: an open loop has nothing
/// else that frees it.
const CLOSING_NM: i32 = 62_500;

/// Reel speed at which the brake on taking up slack begins, in nanometres a nominal sample: 30
/// mm/s. A cable that closes at that speed rises by v sqrt(k m) = 0.03 m/s * sqrt(5,000 N/m * 0.46
/// kg) = 1.4 N; a stiff one of 20 N/mm by 2.9 N.
pub const TAKE_UP_NM: i32 = 93_750;

/// Brake on the speed above that, in force steps per nanometre a sample and newton of missing
/// tension: 268 are 200 N s/m for a cable without tension.
const BRAKE_STEPS_PER_NM: i64 = 268;

/// Travel wound in without tension after which the cable counts as lost, in nanometres: 150 mm.
pub const LOST_TRAVEL_NM: i32 = 150_000_000;

/// Change of travel from one sample to the next that no reel makes, in nanometres: 1 mm are 100
/// m/s^2, or 51 N on the 0.51 kg of reel and motor. The encoder's position has jumped. Damping and
/// friction's direction would answer it with force.
pub const JUMP_NM: i32 = 1_000_000;

/// Bit of the detail of [`Fault::EncoderError`] for a position that jumped; the others are
/// micrometres.
pub const JUMPED: u32 = 1 << 31;

/// What the motor is allowed to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drive {
    /// 0 V.
    #[default]
    Off,
    /// Hold the setpoint.
    Follow,
    /// Bring the command down to zero at the setpoint's slew rate, then 0 V.
    Ramp,
}

/// A setpoint in the controller's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Setpoint {
    /// Cable tension; zero or less takes the unit out of action.
    pub tension: Newton,
    /// From load-cell force to cable tension.
    pub inv_cos: InvCos,
    /// Speed that the host expects of the reel, where it knows.
    pub reel: Option<ReelSpeed>,
}

/// Largest speed of a reel that a setpoint may tell, in micrometres a second: 1 m/s, half as much
/// again as the motor reaches at the amplifier's voltage.
pub const REEL_SPEED_MAX_UM_PER_S: i32 = 1_000_000;

impl Setpoint {
    /// From the wire; the number of the first field that is out of its range: 0 `tension_un` (0 to
    /// the largest tension, and to the force limit), 1 `inv_cos_q16` (65,536 to 262,144), 2
    /// `direction_q14` (a unit vector, or zero), 3 `reel_um_per_s` (within
    /// [`REEL_SPEED_MAX_UM_PER_S`]).
    ///
    /// # Errors
    ///
    /// The field's number, from 0.
    pub fn from_wire(config: &Config, wire: &UnitSetpoint) -> Result<Self, u8> {
        let most_un = config
            .wire()
            .tension_max_un
            .min(config.wire().force_limit_un);
        if !(0..=most_un).contains(&wire.tension_un) {
            return Err(0);
        }
        if !(InvCos::ONE.q16()..=InvCos::MAX.q16()).contains(&wire.inv_cos_q16) {
            return Err(1);
        }
        if !crate::tip::is_direction(wire.direction_q14) {
            return Err(2);
        }
        let range = -REEL_SPEED_MAX_UM_PER_S..=REEL_SPEED_MAX_UM_PER_S;
        if wire
            .reel_um_per_s
            .is_some_and(|speed| !range.contains(&speed))
        {
            return Err(3);
        }
        Ok(Self {
            tension: Newton::from_un(wire.tension_un),
            inv_cos: InvCos::from_q16(wire.inv_cos_q16),
            reel: wire.reel_um_per_s.map(ReelSpeed::from_um_per_s),
        })
    }
}

/// Input of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Input {
    /// ADC code.
    pub adc_code: AdcCode,
    /// Extended encoder position, read with the sample.
    pub encoder_counts: EncoderCounts,
    /// Time of the DRDY edge.
    pub at: Micros,
    /// Setpoint in force.
    pub setpoint: Setpoint,
    /// What the motor is allowed to do.
    pub drive: Drive,
}

/// Output of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Output {
    /// Code for the DAC; 0 V unless the unit is driven.
    pub dac: DacCode,
    /// Commanded cable force before it is rounded to a DAC code.
    pub command: Newton,
    /// Filtered cable tension.
    pub tension: Newton,
    /// Cable tension before the filter.
    pub direct: Newton,
    /// Reel travel since the last sample in nanometres, positive winding in.
    pub travel_nm: i32,
    /// Setpoint after its slew limit.
    pub setpoint: Newton,
    /// P, I, D and damping.
    pub terms: Terms,
    /// Feedforward of setpoint and friction.
    pub feedforward: Newton,
    /// Direction estimate.
    pub direction: Direction,
    /// How much the reel rests.
    pub stillness: Stillness,
    /// [`wire::message::flags`].
    pub flags: u8,
    /// What the caller shall latch, with its detail; the DAC code is 0 V already.
    pub fault: Option<(Fault, u32)>,
    /// The command is zero: a ramp has arrived.
    pub at_zero: bool,
}

impl Output {
    /// Writes the controller's part of a telemetry sample: tension, setpoint, terms, DAC code,
    /// flags.
    pub fn describe(&self, sample: &mut Sample) {
        sample.dac_code = self.dac.0;
        sample.tension = self.tension.to_tenth_mn();
        sample.setpoint = self.setpoint.to_tenth_mn();
        sample.p = self.terms.p.to_tenth_mn();
        sample.i = self.terms.i.to_tenth_mn();
        sample.d = self.terms.d.to_tenth_mn();
        sample.ff = self.feedforward.to_tenth_mn();
        sample.flags = self.flags;
    }
}

/// Memory of a unit's controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct State {
    last: Option<(EncoderCounts, Micros)>,
    /// Travel of the last sample in nanometres, brought to a nominal period.
    last_travel_nm: i32,
    gate: SpikeGate,
    creep: Creep,
    filter: Filter,
    tension: Newton,
    /// What the over-tension limit is compared with.
    strongest: Newton,
    estimator: DirectionEstimator,
    preview: Preview,
    reel_speed: ReelSpeed,
    level: Level,
    pid: Pid,
    /// Setpoint after its slew limit.
    setpoint: Ramp,
    /// Last command.
    command: Ramp,
    /// The loop is closed.
    closed: bool,
    /// The integral is to be set so that the command does not jump.
    rebase: bool,
    over: u8,
    saturated: u8,
    slack_nm: i32,
}

impl State {
    /// Forgets everything but what the load cell has crept, which goes on whatever the controller
    /// does.
    pub fn reset(&mut self) {
        *self = Self {
            creep: self.creep,
            ..Self::default()
        };
    }

    /// The zero of this unit for a mean code under no load: less what the cell has crept, which
    /// goes away.
    #[must_use]
    pub fn relaxed_zero(&self, config: &Config, mean: AdcCode) -> AdcCode {
        self.creep.relaxed(&config.cell, mean)
    }

    /// A new configuration is in force: the next sample sets the integral so that the command goes
    /// on without a jump.
    pub fn config_changed(&mut self) {
        self.rebase = true;
        self.level = Level::default();
    }

    /// Moves what the integral shows of the friction's level to the feedforward.
    fn learn(&mut self, half: Newton) {
        match self.estimator.slides() {
            None => self.level.pause(),
            Some(inwards) => {
                if let Some(moved) = self.level.slid(inwards, self.pid.integral(), half) {
                    self.pid.give_up(moved);
                }
            }
        }
    }

    /// How the friction differs from the model's, as [`Level`] has found it.
    #[must_use]
    pub const fn level(&self) -> &Level {
        &self.level
    }

    /// Filtered cable tension of the last sample.
    #[must_use]
    pub const fn tension(&self) -> Newton {
        self.tension
    }

    /// Largest tension that the last sample can mean: before the filter, and with or without the
    /// cell's correction, or filtered.
    #[must_use]
    pub fn strongest(&self) -> Newton {
        self.strongest.max(self.tension)
    }

    /// Command of the last sample.
    #[must_use]
    pub const fn command(&self) -> Newton {
        self.command.value()
    }
}

/// The controller of a unit; all that it remembers is in [`State`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Controller;

impl Controller {
    /// One sample of one unit.
    pub fn step(config: &Config, state: &mut State, input: Input) -> Output {
        let mut flags = 0;

        // Load cell; the time is that of its creep as well.
        let (last_counts, dt) = match state.last {
            Some((encoder_counts, at)) => (encoder_counts, input.at.since(at)),
            None => (input.encoder_counts, NOMINAL_PERIOD_US),
        };
        state.last = Some((input.encoder_counts, input.at));
        let dt_us = dt.clamp(DT_RANGE_US.0, DT_RANGE_US.1);
        let straight = config.cell.straight(input.adc_code);
        let (uncorrected, spike) = state.gate.step(config.spike_limit, straight);
        let curved = config.cell.curved(uncorrected);
        let gated = state.creep.step(&config.cell, curved, dt_us);
        let filtered = state.filter.step(&config.filter, gated);
        let tension = times_inv_cos(filtered, input.setpoint.inv_cos);
        let rise = tension.saturating_sub(state.tension);
        state.tension = tension;
        if spike {
            flags |= flags::SPIKE;
        }

        // Time and travel.
        if dt >= NOMINAL_PERIOD_US + NOMINAL_PERIOD_US / 2 {
            flags |= flags::MISSED;
        }
        let moved_nm = travel(last_counts, input.encoder_counts, config.travel_nm);
        let jump_nm = moved_nm
            .saturating_sub(state.last_travel_nm)
            .saturating_abs();
        let jumped = jump_nm > JUMP_NM && flags & flags::MISSED == 0;
        let travel_nm = if jumped {
            state.last_travel_nm
        } else {
            moved_nm
        };
        state.last_travel_nm = travel_nm >> periods_shift(dt_us);
        state.reel_speed.step(state.last_travel_nm);
        let last_error = if state.closed {
            state.setpoint.value().saturating_sub(tension)
        } else {
            Newton::ZERO
        };
        let foretold = state
            .preview
            .step(input.setpoint.reel, travel_nm, periods_shift(dt_us));
        let direction = state
            .estimator
            .step(&config.friction, travel_nm, last_error, foretold);
        if direction.q30() > 0 {
            flags |= flags::WINDING_IN;
        } else if direction.q30() < 0 {
            flags |= flags::PAYING_OUT;
        }

        // Before the filter, which would delay a sudden pull by milliseconds.
        let direct = times_inv_cos(gated, input.setpoint.inv_cos);
        // A wrong correction of the cell must not hide a pull.
        let strongest = if uncorrected > gated {
            times_inv_cos(uncorrected, input.setpoint.inv_cos)
        } else {
            direct
        };
        let fault = state
            .watch(config, &input, strongest, tension, travel_nm)
            .or_else(|| {
                let drives = jumped && input.drive != Drive::Off;
                drives.then(|| {
                    (
                        Fault::EncoderError,
                        JUMPED | (jump_nm.unsigned_abs() / 1_000),
                    )
                })
            });
        let mut output = Output {
            tension,
            direct,
            travel_nm,
            direction,
            stillness: state.estimator.stillness(),
            flags,
            fault,
            at_zero: true,
            ..Output::default()
        };
        let requested = input
            .setpoint
            .tension
            .clamp_to(Newton::ZERO, config.force_limit);
        let drive = match input.drive {
            _ if fault.is_some() => Drive::Off,
            Drive::Follow if requested <= Newton::ZERO => Drive::Ramp,
            drive => drive,
        };

        match drive {
            Drive::Off => {
                state.command.set(Newton::ZERO);
                state.closed = false;
            }
            Drive::Ramp => {
                state
                    .command
                    .approach(Newton::ZERO, config.setpoint_slew, dt_us);
                state.closed = false;
            }
            Drive::Follow => {
                if !state.closed {
                    // Starts at the present tension, so that the error has no step.
                    state
                        .setpoint
                        .set(tension.clamp_to(Newton::ZERO, config.force_limit));
                }
                let closing = tension < SLACK_TENSION && state.last_travel_nm > CLOSING_NM;
                let target = if closing {
                    requested.min(TAKE_UP_TENSION)
                } else {
                    requested
                };
                state.setpoint.approach(target, config.setpoint_slew, dt_us);
                let setpoint = state.setpoint.value();
                let measured = Measured {
                    error: setpoint.saturating_sub(tension),
                    rise: if state.closed { rise } else { Newton::ZERO },
                    travel_nm: state.estimator.steady_travel_nm(),
                    ramps: setpoint != target,
                    dt_us,
                };
                let exchanges = state.level.foretell(foretold.is_some());
                let Feedforward {
                    command: feedforward,
                    half,
                } = config.friction.command(
                    setpoint,
                    direction,
                    state.reel_speed,
                    input.encoder_counts,
                    &state.level,
                );
                if exchanges {
                    let moved = state.level.exchanged(half, direction);
                    state.pid.give_up(moved);
                }
                let mut terms = state.pid.terms(config, &measured);
                if !state.closed || state.rebase {
                    state.level.begin();
                    let others = feedforward.saturating_add(terms.p).saturating_add(terms.d);
                    state
                        .pid
                        .set_integral(config, state.command.value().saturating_sub(others));
                    terms.i = state.pid.integral();
                }
                let unlimited = feedforward.saturating_add(terms.sum());
                let braked = unlimited.saturating_sub(brake(tension, setpoint, travel_nm));
                let limited = braked.clamp_to(Newton::ZERO, command_limit(config, setpoint));
                let slewing = state.command.approach(limited, config.slew, dt_us);
                // The brake counts as a limit: while it acts, the integral must not wind up.
                let excess = unlimited.saturating_sub(state.command.value());
                let boost = if config.friction.is_enabled() {
                    Stillness::default()
                } else {
                    state.estimator.stillness()
                };
                state.pid.integrate(config, &measured, excess, boost);
                state.closed = true;
                output.setpoint = setpoint;
                output.terms = terms;
                output.feedforward = feedforward;
                if limited < braked {
                    output.flags |= flags::LIMITED;
                } else if limited > braked {
                    output.flags |= flags::AT_ZERO;
                }
                if slewing {
                    output.flags |= flags::SLEWING;
                }
                state.learn(half);
            }
        }
        state.rebase = false;
        if drive != Drive::Off {
            output.flags |= flags::ACTIVE;
        }
        output.command = state.command.value();
        output.at_zero = output.command <= Newton::ZERO;
        output.dac = convert::dac_code(output.command, config.dac_q16);
        output
    }
}

impl State {
    /// Looks for what must stop the unit.
    fn watch(
        &mut self,
        config: &Config,
        input: &Input,
        strongest: Newton,
        tension: Newton,
        travel_nm: i32,
    ) -> Option<(Fault, u32)> {
        let count = |seen: u8, now: bool| if now { seen.saturating_add(1) } else { 0 };
        let limit = config.over_tension(input.drive != Drive::Off);
        self.strongest = strongest;
        self.over = count(self.over, strongest > limit);
        self.saturated = count(self.saturated, input.adc_code.is_saturated());
        self.slack_nm = if tension > SLACK_TENSION || input.drive == Drive::Off {
            0
        } else {
            self.slack_nm.saturating_add(travel_nm).max(0)
        };
        if self.saturated >= TRIP_SAMPLES {
            Some((Fault::AdcSaturated, input.adc_code.get() as u32))
        } else if self.over >= TRIP_SAMPLES {
            Some((
                Fault::OverTension,
                (strongest.to_un() / 1_000).unsigned_abs(),
            ))
        } else if self.slack_nm > LOST_TRAVEL_NM {
            Some((Fault::CableLost, self.slack_nm.unsigned_abs() / 1_000))
        } else {
            None
        }
    }
}

/// Load-cell force to cable tension: T = F / cos theta (thesis 3.7).
fn times_inv_cos(force: Newton, inv_cos: InvCos) -> Newton {
    Newton::from_wide_shifted(i64::from(force.to_bits()) * i64::from(inv_cos.q16()), 16)
}

/// Largest command for a setpoint: what the friction model needs to wind the cable in at that
/// tension and the unit's authority over it, at most the force limit. A load cell that reads too
/// little makes the loop pull up to here.
fn command_limit(config: &Config, setpoint: Newton) -> Newton {
    let most = config.friction.winding_in(setpoint);
    most.saturating_add(config.authority)
        .clamp_to(Newton::ZERO, config.force_limit)
}

/// Brake force on the reel while it takes up slack faster than [`TAKE_UP_NM`], so that the cable
/// does not tighten with a shock. Largest without tension, zero from [`SLACK_TENSION`] on.
fn brake(tension: Newton, setpoint: Newton, travel_nm: i32) -> Newton {
    let slack = SLACK_TENSION.min(Newton::from_bits(setpoint.to_bits() >> 1));
    let missing = slack.saturating_sub(tension.clamp_to(Newton::ZERO, slack));
    // At most 1 N, so 22 bits; the excess another 22, the brake 8.
    let excess = (i64::from(travel_nm) - i64::from(TAKE_UP_NM)).max(0);
    Newton::from_wide((excess * BRAKE_STEPS_PER_NM * i64::from(missing.to_bits())) >> 22)
}
