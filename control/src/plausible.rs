//! Whether a unit's load cell and motor can be believed. A load cell that reads too little is the
//! dangerous one: the loop pulls harder and nothing that is measured shows it. What does show it is
//! physics that the loop does not use.
//!
//! | watch | what it compares | fault |
//! | --- | --- | --- |
//! | [`Watch`] | a code with the codes before it | [`Fault::SensorFrozen`] |
//! | | the tension with zero | [`Fault::TensionNegative`] |
//! | | the command with its limits, over time | [`Fault::CommandAtLimit`] |
//! | | the tension with the friction model's band around the command, and the reel's motion with the difference | [`Fault::Implausible`] |
//! | | the tension of a sliding reel with the edge of the band on that side | [`Fault::Implausible`] |
//! | | a slack cable with what the command makes of a reel that rests, over time and as a sum | [`Fault::Implausible`] |
//! | | the speed that the reel gains while the tension rises, with what the command can give | [`Fault::Implausible`] |
//!
//! Whether 0 V has an effect: [`crate::let_go`].
//!
//! # The band, and why motion counts
//!
//! A resting reel holds any tension between what the command makes while winding in and what it
//! holds while paying out (see [`crate::friction`]). Outside this band the difference accelerates
//! reel and motor, 0.5 kg at the cable. So the watch adds up the difference past
//! [`UnitConfig::plausible_un`](wire::message::UnitConfig::plausible_un) and subtracts the momentum
//! that the reel has gained. A cable that was slack, or a robot that pulls, moves the reel: nothing
//! is left. A load cell that lies, or an amplifier that does not act, leaves the whole difference.
//!
//! A reel that slides has the friction of one direction only, so the tension is known better: it is
//! at one edge of the band. There [`SLIDING_SHARE_Q8`] of the permitted difference is enough, and
//! [`SLIDING_IMPULSE`]. This finds a slow drift of a load cell, which keeps inside the whole band
//! until the cable is slack.
//!
//! # More pull than the command
//!
//! A reel that speeds up against a cable whose tension rises above its setpoint is driven by more
//! force than its command gives: a robot that comes closer lowers the tension, one that goes away
//! turns the reel the other way. One that gains more than the whole command would give it without a
//! cable needs no look at the tension: its output does not follow, so [`Fault::OutputStuck`] takes
//! all DACs to 0 V by RST, which no word undoes. `Surge` compares the momentum of four samples with
//! the force that the command can explain. It acts within 10 ms of a jump of the amplifier's gain,
//! before the load cell's filter has followed.

use crate::config::Config;
use crate::faults::Fault;
use crate::unit::{Drive, Output};
use crate::units::{AdcCode, Newton};
use wire::message::flags;

/// Equal codes in a row that make a fault. Noise is hundreds of counts (device-facts: 1.5 mN are
/// 215), so that two equal codes are rare and eight do not occur.
pub const FROZEN_SAMPLES: u8 = 8;

/// Tension below which a load cell is wrong. Calibrations of the converter and drift move the zero
/// by 0.1 N; a zero that was taken with a cable that friction of the reel still held reads 0.9 N
/// too little.
pub const NEGATIVE: Newton = Newton::from_un(-1_000_000);

/// Samples in a row below [`NEGATIVE`] that make a fault, 19 ms: longer than a cell rings after a
/// cable went slack.
pub const NEGATIVE_SAMPLES: u8 = 6;

/// Samples in a row with the command at its upper limit that make a fault, 0.2 s: a transient of
/// the loop is over by then.
pub const LIMIT_SAMPLES: u8 = 64;

/// The same with the command at zero, 0.125 s: a load cell that reads too much has let its cable go
/// slack by then, and 0.15 s of that are a hazard (docs/safety.md).
pub const AT_ZERO_SAMPLES: u8 = 40;

/// Error that counts as "not at the setpoint" while the command stands at a limit.
const LIMIT_ERROR: Newton = Newton::from_un(300_000);

/// Sum of the unexplained difference that makes a fault, in newton times samples: 50 are 0.16 N s.
/// A difference of 5 N past the permitted one takes 10 samples, 31 ms.
pub const IMPULSE: Newton = Newton::from_un(50_000_000);

/// Momentum of the reel in newton times samples for a travel of a nanometre a sample, in steps of
/// force times 256: 0.51 kg / (3.125 ms)^2 = 5.22e-5 N a nanometre, times 2^22 steps and 256.
const MOMENTUM_Q8: i64 = 56_075;

/// Part of the permitted difference that a sliding reel may have from its edge of the band, times
/// 256: 5/8, 1.6 N of 2.5 N.
pub const SLIDING_SHARE_Q8: i64 = 160;

/// Sum of the difference past that which makes a fault, in newton times samples: 0.5 N for 20
/// samples, 62 ms.
pub const SLIDING_IMPULSE: Newton = Newton::from_un(10_000_000);

/// Mean travel of a sample from which a reel counts as sliding, in nanometres: 1 mm/s. Less may be
/// presliding.
const SLIDING_NM: i32 = 3_125;

/// Travel of a sample that enters the mean at most, in nanometres: 4 mm/s. So a reel that stops
/// counts as sliding for 35 ms, however fast it was.
const SLIDING_CLAMP_NM: i32 = 4 * SLIDING_NM;

/// How fast the mean of the travel follows, 1/8 a sample (25 ms).
const SLIDING_SHIFT: u32 = 3;

/// Momentum without an explanation that makes a fault, in newton times samples: 2 are 6 mN s, or 12
/// mm/s of a reel of 0.51 kg. The robot accelerates a reel by 3 mm/s in this time (the emulated
/// trajectories), and the tension then falls.
pub const SURGE: Newton = Newton::from_un(2_000_000);

/// Samples after a cable was slack in which friction may help a gain of speed, 100 ms. The cable
/// throws the reel back as it closes; when the reel then winds in again, its contacts give back
/// what they hold.
const CLOSED_SAMPLES: u8 = 32;

/// Tension above the setpoint from which a gain of speed counts as a surge.
const SURGE_ERROR: Newton = Newton::from_un(500_000);

/// Momentum of two samples past what the whole command gives a reel without a cable, with which a
/// motor counts as pulling by itself, in newton times samples. A cable that breaks and a robot that
/// comes nearer, however fast, leave nothing; 3 are a reel that is an eighth lighter at 12 N.
pub const PULLS: Newton = Newton::from_un(3_000_000);

/// Samples over which [`Surge`] compares, 12.5 ms: the settling time of the converter's filter.
const SURGE_SAMPLES: usize = 4;

/// Tension below which a cable is slack for [`SLACK_SAMPLES`].
const SLACK: Newton = Newton::from_un(500_000);

/// Samples in a row in which a cable is slack, the reel rests and the command would tighten it by
/// `SLACK` and more: 100 ms. A reel that takes up slack moves.
pub const SLACK_SAMPLES: u8 = 32;

/// Sum of what the command would tighten such a cable by, past twice `SLACK` and less what the reel
/// has gained, that makes a fault, in newton times samples: 6 are 19 mN s, or 37 mm/s of a reel of
/// 0.51 kg. More than half a sample of 12 N, by which the travel lags. A command that rises gets
/// there in 35 ms, before a reel whose encoder stands still is fast.
pub const SLACK_IMPULSE: Newton = Newton::from_un(6_000_000);

/// Travel of a sample with which a reel stands, in nanometres: 2 mm/s, or a count and a half.
const STANDS_NM: i32 = 2 * SLIDING_NM;

/// Samples with less travel after which a reel stands, whatever it did before.
const STANDS_SAMPLES: u8 = 2;

/// How fast the command's envelopes follow it, 1/8 a sample (25 ms): the measured tension follows
/// the command by the converter's 6 ms, the filter's 2 ms and a quarter of the cable's swing, 7 ms.
const ENVELOPE_SHIFT: u32 = 3;

/// The watch over one unit, sample by sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Watch {
    last_code: AdcCode,
    same: u8,
    negative: u8,
    at_limit: u8,
    /// Lowest and highest recent command.
    low: Newton,
    high: Newton,
    drives: bool,
    below: Difference,
    above: Difference,
    /// Mean travel of a sample, in nanometres times 8.
    sliding_nm_x8: i32,
    /// Travel of the last sample in nanometres, clamped.
    last_nm: i32,
    sliding_below: Difference,
    sliding_above: Difference,
    slack: u8,
    /// Samples in a row in which the reel moved by less than [`STANDS_NM`].
    stands: u8,
    /// The cable has been tight since the motor acts.
    tight: bool,
    /// What the command would tighten a cable by that has not been tight yet.
    held: Difference,
    /// Command of the last sample: what the reel answers in this one.
    last_command: Newton,
    surge: Surge,
    /// Samples since the cable was slack, up to [`CLOSED_SAMPLES`].
    closed: u8,
}

/// The last samples' travel, and the force that explains a gain of speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Surge {
    /// The oldest first.
    samples: [(i32, Newton); SURGE_SAMPLES],
    filled: u8,
    /// Samples for which a gain of speed without an explanation still counts: the load cell's
    /// filter shows the tension later.
    remembered: u8,
}

impl Surge {
    /// Adds a sample: its travel in nanometres, winding in positive, and the net force that the
    /// command can give in this direction, and the highest recent command. Whether the reel has
    /// just gained more momentum than that force explains, and whether more than the command does.
    fn add(&mut self, travel_nm: i32, force: Newton, command: Newton) -> (bool, bool) {
        let (before_nm, _) = self.samples[0];
        self.samples.rotate_left(1);
        self.samples[SURGE_SAMPLES - 1] = (travel_nm, force);
        if usize::from(self.filled) < SURGE_SAMPLES {
            self.filled += 1;
            return (false, false);
        }
        let [_, (two_ago_nm, _), (last_nm, _), _] = self.samples;
        let gained = i64::from(travel_nm.max(0)) - i64::from(two_ago_nm.max(0));
        let momentum = Newton::from_wide((gained * MOMENTUM_Q8) >> 8);
        let unexplained = momentum.saturating_sub(command).saturating_sub(command);
        // A position that jumped is one gain, and so is what follows it.
        let older = i64::from(last_nm) - i64::from(two_ago_nm);
        let pulls = unexplained > PULLS && 32 * older > gained;
        let explained = self
            .samples
            .iter()
            .fold(Newton::ZERO, |sum, (_, force)| sum.saturating_add(*force));
        // A reel that comes to rest after it was pulled out gains none: the tension that the filter
        // has not shown yet did it.
        let gained = i64::from(travel_nm.max(0)) - i64::from(before_nm.max(0));
        let momentum = Newton::from_wide((gained * MOMENTUM_Q8) >> 8);
        self.remembered = if momentum.saturating_sub(explained) > SURGE {
            SURGE_SAMPLES as u8
        } else {
            self.remembered.saturating_sub(1)
        };
        (self.remembered > 0, pulls)
    }
}

/// A difference in one direction, added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Difference {
    /// Steps of force times samples.
    sum: i64,
    /// Travel of the sample before the sum began, in nanometres towards the side that the
    /// difference pulls to.
    began_nm: i32,
}

impl Difference {
    /// Adds a sample's excess, and returns it where the sum is above `limit` and the reel's motion
    /// does not explain it.
    fn add(&mut self, excess: Newton, travel_nm: i32, limit: Newton) -> Option<Newton> {
        if excess <= Newton::ZERO {
            *self = Self {
                sum: 0,
                began_nm: travel_nm,
            };
            return None;
        }
        self.sum = self.sum.saturating_add(i64::from(excess.to_bits()));
        let gained = i64::from(travel_nm) - i64::from(self.began_nm);
        let momentum = (gained.max(0) * MOMENTUM_Q8) >> 8;
        (self.sum - momentum > i64::from(limit.to_bits())).then_some(excess)
    }
}

impl Watch {
    /// Forgets everything but the last code.
    pub fn reset(&mut self) {
        *self = Self {
            last_code: self.last_code,
            same: self.same,
            ..Self::default()
        };
    }

    /// One sample with its output; the fault and its detail.
    pub fn sample(
        &mut self,
        config: &Config,
        drive: Drive,
        code: AdcCode,
        output: &Output,
    ) -> Option<(Fault, u32)> {
        if let Some(fault) = self.frozen(code) {
            return Some(fault);
        }
        if drive == Drive::Off {
            self.reset();
            return None;
        }
        if !self.drives {
            self.drives = true;
            self.low = Newton::ZERO;
            self.high = Newton::ZERO;
        }
        self.envelopes(output.command);
        self.negative(output)
            .or_else(|| self.limited(drive, output))
            .or_else(|| self.band(config, output))
            .or_else(|| self.sliding(config, output))
            .or_else(|| self.slack(config, drive, output))
            .or_else(|| self.surges(config, drive, output))
    }

    fn frozen(&mut self, code: AdcCode) -> Option<(Fault, u32)> {
        self.same = if code == self.last_code {
            self.same.saturating_add(1)
        } else {
            0
        };
        self.last_code = code;
        (self.same >= FROZEN_SAMPLES - 1).then_some((Fault::SensorFrozen, code.get() as u32))
    }

    fn negative(&mut self, output: &Output) -> Option<(Fault, u32)> {
        self.negative = count(self.negative, output.tension < NEGATIVE);
        (self.negative >= NEGATIVE_SAMPLES).then(|| (Fault::TensionNegative, milli(output.tension)))
    }

    fn limited(&mut self, drive: Drive, output: &Output) -> Option<(Fault, u32)> {
        let error = output.setpoint.saturating_sub(output.tension);
        let too_little = output.flags & flags::AT_A_LIMIT != 0 && error > LIMIT_ERROR;
        let too_much =
            output.command <= Newton::ZERO && error < Newton::ZERO.saturating_sub(LIMIT_ERROR);
        self.at_limit = count(
            self.at_limit,
            drive == Drive::Follow && output.setpoint > Newton::ZERO && (too_little || too_much),
        );
        let lasts =
            self.at_limit >= AT_ZERO_SAMPLES && (too_much || self.at_limit >= LIMIT_SAMPLES);
        lasts.then(|| (Fault::CommandAtLimit, milli(output.command)))
    }

    fn band(&mut self, config: &Config, output: &Output) -> Option<(Fault, u32)> {
        let least = config
            .friction
            .least(self.low)
            .saturating_sub(config.plausible);
        let most = config
            .friction
            .most(self.high)
            .saturating_add(config.plausible);
        let below = least.saturating_sub(output.direct);
        let above = output.direct.saturating_sub(most);
        if let Some(excess) = self.below.add(below, output.travel_nm, IMPULSE) {
            let difference = excess.saturating_add(config.plausible);
            return Some((Fault::Implausible, milli(difference)));
        }
        self.above
            .add(above, output.travel_nm.saturating_neg(), IMPULSE)
            .map(|excess| {
                let difference = excess.saturating_add(config.plausible);
                (Fault::Implausible, milli(difference) | 1 << 31)
            })
    }

    /// The edge of the band on the side to which the reel slides.
    fn sliding(&mut self, config: &Config, output: &Output) -> Option<(Fault, u32)> {
        let travel_nm = output.travel_nm.clamp(-SLIDING_CLAMP_NM, SLIDING_CLAMP_NM);
        self.sliding_nm_x8 += travel_nm - (self.sliding_nm_x8 >> SLIDING_SHIFT);
        let mean_nm = self.sliding_nm_x8 >> SLIDING_SHIFT;
        // Two samples: at the slowest speed that counts, some samples have no step of the encoder.
        let moves = (travel_nm + self.last_nm).signum() == mean_nm.signum();
        self.last_nm = travel_nm;
        let edge = |command| {
            if mean_nm > 0 {
                config.friction.least(command)
            } else {
                config.friction.most(command)
            }
        };
        if mean_nm.abs() < SLIDING_NM {
            self.sliding_below = Difference::default();
            self.sliding_above = Difference::default();
            return None;
        }
        // A reel that has just come to rest has any tension of the band.
        if !moves {
            return None;
        }
        let plausible = i64::from(config.plausible.to_bits());
        let permitted = Newton::from_wide((plausible * SLIDING_SHARE_Q8) >> 8);
        let below = edge(self.low)
            .saturating_sub(permitted)
            .saturating_sub(output.direct);
        let above = output
            .direct
            .saturating_sub(edge(self.high).saturating_add(permitted));
        if let Some(excess) = self
            .sliding_below
            .add(below, output.travel_nm, SLIDING_IMPULSE)
        {
            let difference = excess.saturating_add(permitted);
            return Some((Fault::Implausible, milli(difference)));
        }
        self.sliding_above
            .add(above, output.travel_nm.saturating_neg(), SLIDING_IMPULSE)
            .map(|excess| {
                let difference = excess.saturating_add(permitted);
                (Fault::Implausible, milli(difference) | 1 << 31)
            })
    }

    /// A cable that stays slack though the command would tighten it. Call it behind
    /// [`Self::sliding`], which averages the travel.
    fn slack(&mut self, config: &Config, drive: Drive, output: &Output) -> Option<(Fault, u32)> {
        let least = config.friction.least(self.low);
        let now = config.friction.least(output.command.min(self.last_command));
        self.last_command = output.command;
        let rests = (self.sliding_nm_x8 >> SLIDING_SHIFT).abs() < SLIDING_NM;
        let would = SLACK.saturating_add(SLACK);
        // The mean knows it 35 ms later: an encoder that stops with a fast reel leaves no brake.
        self.stands = count(self.stands, output.travel_nm.abs() < STANDS_NM);
        let stands = rests || self.stands >= STANDS_SAMPLES;
        let slack = drive == Drive::Follow && output.tension < SLACK;
        self.slack = count(self.slack, slack && rests && least > would);
        self.tight |= output.tension >= SLACK;
        // One that was tight has let go, or swings: the encoder's own watch says which.
        let excess = if slack && stands && !self.tight {
            now.saturating_sub(would)
        } else {
            Newton::ZERO
        };
        let held = self
            .held
            .add(excess, output.travel_nm, SLACK_IMPULSE)
            .is_some();
        (held || self.slack >= SLACK_SAMPLES).then(|| {
            let difference = least.max(now).saturating_sub(output.tension);
            (Fault::Implausible, milli(difference))
        })
    }

    /// More speed than the command explains, while the tension rises above the setpoint.
    fn surges(&mut self, config: &Config, drive: Drive, output: &Output) -> Option<(Fault, u32)> {
        // The travel of a longer time than a sample's is no speed.
        if drive != Drive::Follow || output.flags & flags::MISSED != 0 {
            self.surge = Surge::default();
            return None;
        }
        self.closed = if output.tension < SLACK {
            0
        } else {
            self.closed.saturating_add(1).min(CLOSED_SAMPLES)
        };
        let most = if self.closed < CLOSED_SAMPLES {
            config.friction.most(self.high)
        } else {
            config.friction.least(self.high)
        };
        let force = most.saturating_sub(output.direct).max(Newton::ZERO);
        let (surged, pulls) = self.surge.add(output.travel_nm, force, self.high);
        if pulls {
            return Some((Fault::OutputStuck, 0));
        }
        let error = output.direct.saturating_sub(output.setpoint);
        // A jump that the spike gate holds back shows in no error yet.
        (surged && (error > SURGE_ERROR || output.flags & flags::SPIKE != 0))
            .then(|| (Fault::Implausible, milli(error) | 1 << 31))
    }

    /// The lowest command rises and the highest falls towards the present one.
    fn envelopes(&mut self, command: Newton) {
        let bits = command.to_bits();
        let toward = |from: Newton| {
            let from = from.to_bits();
            Newton::from_bits(from.saturating_add(bits.saturating_sub(from) >> ENVELOPE_SHIFT))
        };
        self.low = command.min(toward(self.low));
        self.high = command.max(toward(self.high));
    }
}

const fn count(seen: u8, now: bool) -> u8 {
    if now {
        seen.saturating_add(1)
    } else {
        0
    }
}

/// Size in millinewton, rounded.
#[must_use]
pub const fn milli(force: Newton) -> u32 {
    (force.to_un() / 1_000).unsigned_abs()
}
