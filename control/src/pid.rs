//! PID on the tension error with the derivative on the measurement, plus damping on the reel's
//! speed.
//!
//! # Time
//!
//! A converter runs at 310 to 330 SPS. The integral uses the measured time between two DRDY edges,
//! so that its rate is a true 1/s and a lost sample is accounted for. The derivative and the
//! damping use the nominal rate: an error of 3 % of the damping gain is acceptable, and this saves
//! a division. After lost samples the difference is divided by the number of periods it spans.
//!
//! # Damping
//!
//! The load cell's signal has a delay of 6.25 ms (sinc4), the encoder's has none. Reel, gear and
//! motor are 0.46 kg at the cable. With a cable of some N/mm they oscillate at 16 to 25 Hz, where
//! the delay leaves the loop no phase margin. A force against the reel's speed damps this
//! oscillation. Its steady part would pull against every motion of the robot, so the speed passes a
//! first-order high pass of [`DAMPING_CORNER_HZ`] first.
//!
//! # A robot that gives way
//!
//! Where the tip moves by 1 mm under 1 N, two cables that pull against each other work against 0.5
//! N/mm in place of 24. The mass then swings at some 2 Hz. Below its corner the damping's high
//! pass is no damping but inertia: 9 kg with a corner of 2 Hz. There an integral of 25/s made that
//! swing grow from 0.7 mm/N on. So a part of the integral's work is done by one that leaks with
//! [`LEAK_PER_S`]: it is as fast after a reversal, and at 2 Hz the larger part of it is in phase
//! with the error. `control/examples/tension_loop.rs` has the plants on which the gains were
//! chosen (key `gives`), docs/architecture.md the table.
//!
//! # At rest
//!
//! A reel at rest holds any force inside its friction band: the motor's force does not reach the
//! cable, the loop is open and its delay harmless. Without a friction model only the integral can
//! cross the band, so it runs five times as fast while the reel rests, fading to its own rate at
//! [`MOVING_NM`](crate::friction::MOVING_NM). With the friction feedforward on, the direction
//! estimate crosses the band and the integral keeps its rate.

use crate::config::{Config, KI_SHIFT};
use crate::friction::Stillness;
use crate::limits::clamp_abs;
use crate::units::Newton;

/// How much faster the integral is at rest, less one.
const REST_BOOST: i64 = 4;

/// Corner of the damping's high pass in hertz.
pub const DAMPING_CORNER_HZ: f64 = 0.6;

/// Share of the speed's difference that the high pass lets go in a sample, times 65,536:
/// 1 - exp(-2 pi 0.6 Hz / 320 Hz) = 0.01171.
const DAMPING_LEAK_Q16: i64 = 768;

/// Share of itself that the leaking integral loses in a second. Chosen together with the gains and
/// the damping's corner, by a search over the plants of `control/examples/tension_loop.rs`.
pub const LEAK_PER_S: f64 = 15.0;

/// The same in a sample, times 2^24: 1 - exp(-15 / 320) = 0.04579.
const LEAK_Q24: i64 = 768_256;

/// Fraction bits of the integral: i64 with 52 of them holds +-2,048 N.
const INTEGRAL_SHIFT: u32 = 52;

/// Input of the controller for one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Measured {
    /// Setpoint less tension.
    pub error: Newton,
    /// Change of the tension since the last sample.
    pub rise: Newton,
    /// Reel travel since the last sample in nanometres.
    pub travel_nm: i32,
    /// The setpoint is on its way. What the tension is behind it is no reason for more force.
    pub ramps: bool,
    /// Time since the last sample in microseconds, 1,000 to 12,500.
    pub dt_us: u32,
}

/// The terms of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Terms {
    /// Proportional.
    pub p: Newton,
    /// Both integrals, before this sample's error is added.
    pub i: Newton,
    /// Derivative and damping.
    pub d: Newton,
}

impl Terms {
    /// Their sum.
    #[must_use]
    pub const fn sum(&self) -> Newton {
        self.p.saturating_add(self.i).saturating_add(self.d)
    }
}

/// State of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pid {
    /// Integral, newton times 2^52.
    integral: i64,
    /// Integral that leaks.
    leaky: Newton,
    /// Slow part of the travel a sample, nanometres times 128.
    slow_travel_q7: i32,
}

/// How many nominal periods a time spans, as a shift: 0 for one, 1 for two, 2 for more.
pub(crate) fn periods_shift(dt_us: u32) -> u32 {
    const PERIOD: u32 = crate::NOMINAL_PERIOD_US;
    match dt_us {
        t if t < PERIOD + PERIOD / 2 => 0,
        t if t < 3 * PERIOD => 1,
        _ => 2,
    }
}

/// An addition to an integral without what pushes further into a limit.
fn cut(addition: i64, excess: i64) -> i64 {
    if excess > 0 && addition > 0 {
        addition.saturating_sub(excess).max(0)
    } else if excess < 0 && addition < 0 {
        addition.saturating_sub(excess).min(0)
    } else {
        addition
    }
}

impl Pid {
    /// The terms of this sample.
    pub fn terms(&mut self, config: &Config, measured: &Measured) -> Terms {
        let shift = periods_shift(measured.dt_us);
        let p = (i64::from(config.kp_q16) * i64::from(measured.error.to_bits())) >> 16;
        let rise = i64::from(measured.rise.to_bits() >> shift);
        let derivative = -((i64::from(config.kd_rate_q16) * rise) >> 16);

        // 23 bits of travel at most: each has 30 bits, their difference 31.
        let travel_q7 = (measured.travel_nm >> shift) << 7;
        let leaks = i64::from(travel_q7 - self.slow_travel_q7) * DAMPING_LEAK_Q16;
        self.slow_travel_q7 += (leaks >> 16) as i32;
        let fast_q7 = travel_q7 - self.slow_travel_q7;
        let damping = -((i64::from(fast_q7) * i64::from(config.damping)) >> 23);
        Terms {
            p: Newton::from_wide(p),
            i: self.integral().saturating_add(self.leaky),
            d: Newton::from_wide(derivative + damping),
        }
    }

    /// Adds this sample's error to the integrals. `excess` is the unlimited command less what the
    /// limits let through: an addition that pushes further into a limit is cut by it, down to
    /// nothing (anti-windup by clamping, without a jump at the limit). `boost`: see the module's
    /// page, "At rest".
    pub fn integrate(
        &mut self,
        config: &Config,
        measured: &Measured,
        excess: Newton,
        boost: Stillness,
    ) {
        let error = i64::from(measured.error.to_bits());
        // ki dt, times 2^30: at most 200/s * 12.5 ms = 2.5, up to five times that at rest; cut at 2
        // so that the product with the error stays within 62 bits.
        let gain_q30 = (i64::from(config.ki_us) * i64::from(measured.dt_us)) >> (KI_SHIFT - 30);
        let boosted = if boost == Stillness::default() {
            gain_q30
        } else {
            (gain_q30 * (Stillness::ONE + REST_BOOST * i64::from(boost.q24()))) >> 24
        };
        let mut addition = error * boosted.min(1 << 31);
        // The leaking one counts nominal samples.
        let leaky = i64::from(self.leaky.to_bits());
        let mut change = error * i64::from(config.leaky_ki);
        if excess != Newton::ZERO || measured.ramps {
            let excess = i64::from(excess.to_bits());
            addition = cut(addition, excess << (INTEGRAL_SHIFT - Newton::FRAC_BITS));
            // On a ramp it would collect what makes the tension overshoot where the ramp ends.
            change = if measured.ramps {
                0
            } else {
                cut(change, excess << 24)
            };
        }
        let limit = i64::from(config.force_limit.to_bits()) << (INTEGRAL_SHIFT - Newton::FRAC_BITS);
        self.integral = clamp_abs(self.integral.saturating_add(addition), limit);
        change -= leaky * LEAK_Q24;
        self.leaky = Newton::from_wide(leaky + (change >> 24));
    }

    /// The integral without the leaking one.
    #[must_use]
    pub const fn integral(&self) -> Newton {
        Newton::from_wide(self.integral >> (INTEGRAL_SHIFT - Newton::FRAC_BITS))
    }

    /// Takes a part off the integral that another term takes over.
    pub fn give_up(&mut self, part: Newton) {
        let part = i64::from(part.to_bits()) << (INTEGRAL_SHIFT - Newton::FRAC_BITS);
        self.integral = self.integral.saturating_sub(part);
    }

    /// Sets the integral so that the command goes on without a jump; the leaking one begins anew.
    pub fn set_integral(&mut self, config: &Config, value: Newton) {
        self.leaky = Newton::ZERO;
        let value = value.clamp_abs(config.force_limit);
        self.integral = i64::from(value.to_bits()) << (INTEGRAL_SHIFT - Newton::FRAC_BITS);
    }
}
