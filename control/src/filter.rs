//! From a noisy, sometimes spiked load-cell force to the one that the controller sees: spike gate,
//! then a moving average or a low pass.
//!
//! # Which filter
//!
//! | filter at 320 SPS | delay | white noise times |
//! | --- | --- | --- |
//! | moving average of 4 (thesis) | 1.50 samples, 4.7 ms | 0.50 |
//! | moving average of 2 | 0.50 samples, 1.6 ms | 0.71 |
//! | Butterworth low pass, 100 Hz | 0.47 samples, 1.5 ms | 0.78 |
//! | Butterworth low pass, 40 Hz | 1.74 samples, 5.4 ms | 0.47 |
//!
//! The converter's sinc4 has filtered already: 6.25 ms of delay, -3 dB at 73 Hz. What noise is left
//! is 1.7 to 5 mN (measured, idle channels), a twentieth of the tension error that friction makes,
//! and the loop multiplies it by a gain below one. Every further millisecond of delay, however,
//! takes 7 degrees of phase at 20 Hz, where reel and cable swing. So the default is the low pass at
//! 100 Hz: 3.2 ms less delay than the thesis's average for 1 to 2 mN more noise. On the plant the
//! loop holds with either.

use crate::limits::clamp_abs;
use crate::units::Newton;
use crate::NOMINAL_SPS;
use wire::message::FilterChoice;

/// Samples that a spike gate holds at most; the sample after them passes unconditionally.
pub const SPIKE_HOLD: u8 = 3;

/// Replaces single wild samples by a prediction.
///
/// The rig's logs show spikes of one sample that no cable can cause (an I2C bit error, a read that
/// met the converter's update). A sample further than the limit from the prediction, which is the
/// line through the last two samples, is held back. It was a real change if the next one lies
/// within the limit of it: then that one passes, one sample late. Samples that contradict each
/// other are held for [`SPIKE_HOLD`] at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SpikeGate {
    primed: bool,
    last: i32,
    slope: i32,
    rejected: i32,
    held: u8,
}

impl SpikeGate {
    /// Takes a sample; returns the one to use, and whether it is a replacement.
    pub fn step(&mut self, limit: i32, sample: Newton) -> (Newton, bool) {
        let sample = sample.to_bits();
        if !self.primed {
            *self = Self {
                primed: true,
                last: sample,
                ..Self::default()
            };
            return (Newton::from_bits(sample), false);
        }
        let near = |a: i32, b: i32| a.abs_diff(b) <= limit.unsigned_abs();
        let predicted = self.last.saturating_add(self.slope);
        let confirmed = self.held > 0 && near(sample, self.rejected);
        if near(sample, predicted) || confirmed || self.held >= SPIKE_HOLD {
            // A level that was just accepted carries no information about the slope.
            self.slope = if self.held > 0 {
                0
            } else {
                clamp_abs(sample.saturating_sub(self.last), limit)
            };
            self.last = sample;
            self.held = 0;
            (Newton::from_bits(sample), false)
        } else {
            self.rejected = sample;
            self.held += 1;
            self.last = predicted;
            self.slope = 0;
            (Newton::from_bits(predicted), true)
        }
    }
}

/// Longest moving average.
pub const MAX_AVERAGE: usize = 16;

/// A filter choice, ready to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilterConfig {
    /// Mean of the last `samples`.
    Average {
        /// 1 to 16.
        samples: u8,
        /// 2^31 / samples, rounded.
        reciprocal_q31: i64,
    },
    /// Second-order section, coefficients times 2^30: y = b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2.
    Biquad {
        /// b0 = b2; b1 is twice that.
        b0: i32,
        /// a1.
        a1: i32,
        /// a2.
        a2: i32,
    },
}

impl FilterConfig {
    /// From the wire's choice; numbers outside their range are brought into it.
    #[must_use]
    pub fn new(choice: FilterChoice) -> Self {
        match choice {
            FilterChoice::MovingAverage(n) => {
                let samples = n.clamp(1, MAX_AVERAGE as u8);
                let n = i64::from(samples);
                Self::Average {
                    samples,
                    reciprocal_q31: ((1 << 31) + n / 2) / n,
                }
            }
            FilterChoice::LowPass { corner_chz } => {
                let corner = f64::from(corner_chz.clamp(500, 12_000)) * 0.01;
                // Butterworth through the bilinear transform, corner prewarped.
                let k = libm::tan(core::f64::consts::PI * corner / f64::from(NOMINAL_SPS));
                let norm = 1.0 / (1.0 + core::f64::consts::SQRT_2 * k + k * k);
                let q30 = |x: f64| crate::units::rounded(x * f64::from(1u32 << 30));
                let a1 = q30(2.0 * (k * k - 1.0) * norm);
                let a2 = q30((1.0 - core::f64::consts::SQRT_2 * k + k * k) * norm);
                // The gain at 0 Hz is 4 b0 / (1 + a1 + a2): a2 moves by three steps at most so that
                // it is 1 exactly. Off by one step it would be a bias of micronewtons that the
                // integral adds up.
                let sum = (1i64 << 30) + i64::from(a1) + i64::from(a2);
                let a2 = a2 - (sum & 3) as i32;
                let b0 = sum >> 2;
                Self::Biquad {
                    b0: b0 as i32,
                    a1,
                    a2,
                }
            }
        }
    }
}

/// Memory of the filter. The first sample fills it, so it starts without a transient; so does the
/// first after another kind of filter was configured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Filter {
    primed_for: Option<FilterConfig>,
    ring: [i32; MAX_AVERAGE],
    next: u8,
    sum: i64,
    x1: i32,
    x2: i32,
    y1: i32,
    y2: i32,
    /// What rounding cut off the last output, fed back, so that the output settles on the input
    /// exactly.
    rest: i64,
}

impl Filter {
    /// Takes a sample, gives the filtered one.
    pub fn step(&mut self, config: &FilterConfig, sample: Newton) -> Newton {
        let x = sample.to_bits();
        if self.primed_for != Some(*config) {
            self.prime(config, x);
        }
        let y = match *config {
            FilterConfig::Average {
                samples,
                reciprocal_q31,
            } => {
                if let Some(slot) = self.ring.get_mut(usize::from(self.next)) {
                    self.sum += i64::from(x) - i64::from(*slot);
                    *slot = x;
                }
                self.next = if self.next + 1 >= samples {
                    0
                } else {
                    self.next + 1
                };
                // |sum| <= n 2^31 and the reciprocal is 2^31 / n: the product stays below 2^62.
                Newton::from_wide((self.sum * reciprocal_q31 + (1 << 30)) >> 31)
            }
            FilterConfig::Biquad { b0, a1, a2 } => {
                let wide = |c: i32, v: i32| i64::from(c) * i64::from(v);
                // b0 (x + 2 x1 + x2): the sum takes 34 bits, b0 at most 29.
                let input = i64::from(x) + 2 * i64::from(self.x1) + i64::from(self.x2);
                let acc = i64::from(b0) * input - wide(a1, self.y1) - wide(a2, self.y2) + self.rest;
                let y = Newton::from_wide(acc >> 30);
                self.rest = acc & ((1 << 30) - 1);
                self.x2 = self.x1;
                self.x1 = x;
                self.y2 = self.y1;
                self.y1 = y.to_bits();
                y
            }
        };
        y
    }

    fn prime(&mut self, config: &FilterConfig, x: i32) {
        let samples = match *config {
            FilterConfig::Average { samples, .. } => i64::from(samples),
            FilterConfig::Biquad { .. } => 0,
        };
        *self = Self {
            primed_for: Some(*config),
            ring: [x; MAX_AVERAGE],
            next: 0,
            sum: i64::from(x) * samples,
            x1: x,
            x2: x,
            y1: x,
            y2: x,
            rest: 0,
        };
    }
}
