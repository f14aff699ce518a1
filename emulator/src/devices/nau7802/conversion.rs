//! Power-up, conversions and calibrations in time.

use super::register_map::{bit, reg};
use super::{sign_extend, Nau7802};

/// Positive full scale as a code.
pub(super) const FULL_SCALE: f64 = 8_388_608.0;
/// PUD to PUR, section 8.1: about 200 us.
pub(super) const POWER_UP_NS: f64 = 200_000.0;
/// CALS to its clearing (seen by drivers).
pub(super) const CALIBRATION_NS: f64 = 344_000_000.0;
/// What TRDY is beside five samples: published drivers wait for it.
pub(super) const TRDY_NS: u64 = 100_000_000;
/// Results that published drivers read away before they calibrate.
const FLUSHED: u32 = 10;
/// Share of a load that the first six conversions after a start show; a start finds the filter
/// empty. No source at hand gives shares: the first four were seen with published drivers on a
/// model of this kind, the last two go on to 1.
pub(super) const SETTLING: [f64; 6] = [0.04, 0.25, 0.58, 0.92, 0.98, 0.995];
/// RC oscillator tolerance.
pub(super) const CLOCK_TOLERANCE: f64 = 0.03;
/// Standard deviation of the clock's random walk per conversion, relative; pulled back to its
/// centre, so that it drifts by about 0.05 %.
pub(super) const CLOCK_WALK: f64 = 2e-6;
pub(super) const CLOCK_PULL: f64 = 1e-5;
/// Zero of an uncalibrated input: standard deviation in codes at gain 128.
pub(super) const RAW_OFFSET: f64 = 60_000.0;
/// How far a calibration can miss the zero, in codes: users report steps of 0.5 to 1 % of a 3 kg
/// cell's range between power-ups.
pub(super) const CALIBRATION_MISS: f64 = 20_000.0;

impl Nau7802 {
    pub(super) fn analog_on(&self) -> bool {
        let needed = bit::PUD | bit::PUA;
        self.powered_up && self.registers[0] & needed == needed
    }

    /// A change that moves the zero: settle again, and the old calibration no longer fits.
    pub(super) fn disturb(&mut self, t_ns: u64) {
        self.raw_offset = RAW_OFFSET * self.rng.normal();
        self.calibrated = false;
        self.calibration_spoilt |= self.calibrating.is_some();
        self.restart(t_ns);
    }

    /// Starts converting from scratch where the settings say so, or stops.
    pub(super) fn restart(&mut self, t_ns: u64) {
        self.ready &= self.defects.keeps_ready;
        let started = self.defects.free_runs || self.registers[0] & bit::CS != 0;
        let converting = self.analog_on() && started && self.calibrating.is_none();
        if converting {
            self.settling = SETTLING.len();
            self.to_flush = FLUSHED;
            self.schedule(t_ns as f64);
        } else {
            self.next_conversion = None;
        }
    }

    pub(super) fn schedule(&mut self, from_ns: f64) {
        self.clock_wander += CLOCK_WALK * self.rng.normal() - CLOCK_PULL * self.clock_wander;
        self.period_ns = 1e9 / (self.rate() * (1.0 + self.clock_error + self.clock_wander))
            * (1.0 + self.defects.stretch);
        self.next_conversion = Some(from_ns + self.period_ns);
    }

    pub(super) fn advance_power(&mut self, t_ns: u64) {
        if self.ready_at.is_some_and(|at| t_ns >= at) {
            let at = self.ready_at.take().expect("just seen");
            self.powered_up = true;
            self.restart(at);
        }
    }

    /// When this chip next does something on its own.
    #[must_use]
    pub fn next_event(&self) -> Option<u64> {
        if !self.plugged {
            return None;
        }
        // Six chips are asked at each step of a rig. An array of `Option`s, flattened, went through
        // memory: a tenth of a fast rig's time (`perf annotate`).
        let or_never = |time: Option<u64>| time.unwrap_or(u64::MAX);
        let next = or_never(self.ready_at)
            .min(or_never(self.calibrating.map(|(at, _)| at)))
            .min(or_never(self.next_conversion.map(ceil)));
        (next < u64::MAX).then_some(next)
    }

    /// Does what is due at `t_ns`. `bridge(end_ns, period_ns)` is the filtered bridge signal in V/V
    /// for a conversion that ends at `end_ns`. True when a result became ready.
    pub fn advance(&mut self, t_ns: u64, bridge: impl Fn(u64, f64) -> f64) -> bool {
        if !self.plugged {
            return false;
        }
        self.advance_power(t_ns);
        if let Some((at, mode)) = self.calibrating {
            if t_ns >= at {
                self.calibrating = None;
                let input = self.defects.wired(bridge(at, 1e9 / 80.0));
                self.finish_calibration(mode, input);
                self.restart(at);
                // The filter held the input all along: another try needs no results first.
                self.to_flush = 0;
            }
        }
        let Some(due) = self.next_conversion else {
            return false;
        };
        if (t_ns as f64) < due {
            return false;
        }
        let period = self.period_ns;
        self.schedule(due);
        let share = match self.settling {
            0 => 1.0,
            left => {
                self.settling -= 1;
                if !self.defects.reports_unsettled {
                    return false;
                }
                SETTLING[SETTLING.len() - left]
            }
        };
        self.to_flush = self.to_flush.saturating_sub(1);
        self.conversions += 1;
        self.uncalibrated += u64::from(!self.calibrated);
        if self.defects.one_in > 1 && !self.conversions.is_multiple_of(self.defects.one_in) {
            return false;
        }
        if !self.defects.frozen {
            let end = due.ceil() as u64;
            let signal = bridge(end, period);
            self.result = self.convert(self.defects.distort(signal, end, self.conversions), share);
        }
        self.result_number += 1;
        let was_ready = self.ready;
        self.ready = true;
        !was_ready
    }

    pub(super) fn input_codes(&self, bridge_v_per_v: f64) -> f64 {
        if self.registers[usize::from(reg::I2C_CTRL)] & bit::SHORT != 0 {
            return 0.0;
        }
        if self.registers[usize::from(reg::CTRL2)] & bit::CHS != 0 {
            // Channel 2 is open: its inputs float to the rail.
            return FULL_SCALE;
        }
        if self.registers[0] & bit::AVDDS == 0 {
            // AVDD comes from the chip's own regulator on this board: without it no excitation and
            // no reference, and the ratio of the two is anything.
            return FULL_SCALE;
        }
        // Ratiometric: the bridge is fed from AVDD, which is the reference too.
        bridge_v_per_v * self.gain() / 0.5 * FULL_SCALE
    }

    /// The code of a conversion whose filter holds this share of its input.
    pub(super) fn convert(&mut self, bridge_v_per_v: f64, share: f64) -> i32 {
        let mut noise = self.noise_v() / self.lsb_v() * self.rng.normal();
        if self.defects.noise > 0.0 {
            noise += self.input_codes(self.defects.noise) * self.rng.normal();
        }
        let input = self.input_codes(bridge_v_per_v) + self.raw_offset * self.gain() / 128.0;
        let raw = share * input + noise;
        let (ocal, gcal) = self.coefficients();
        let offset = f64::from(sign_extend(&self.registers[ocal..ocal + 3]));
        let gain = f64::from(u32::from_be_bytes([
            self.registers[gcal],
            self.registers[gcal + 1],
            self.registers[gcal + 2],
            self.registers[gcal + 3],
        ])) / FULL_SCALE;
        let code = (raw - offset) * gain + f64::from(self.spike.take().unwrap_or(0));
        code.round().clamp(-FULL_SCALE, FULL_SCALE - 1.0) as i32
    }

    /// First registers of offset and gain of the selected channel.
    fn coefficients(&self) -> (usize, usize) {
        if self.registers[usize::from(reg::CTRL2)] & bit::CHS != 0 {
            (reg::OCAL2, reg::GCAL2)
        } else {
            (reg::OCAL1, reg::GCAL1)
        }
    }

    pub(super) fn finish_calibration(&mut self, mode: u8, bridge_v_per_v: f64) {
        let control = usize::from(reg::CTRL2);
        self.registers[control] &= !bit::CALS;
        let miss = CALIBRATION_MISS * self.rng.uniform_signed() * self.gain() / 128.0;
        let zero = self.raw_offset * self.gain() / 128.0 + miss;
        let input = self.input_codes(bridge_v_per_v);
        let valid = !self.calibration_spoilt
            && !self.defects.calibration
            && match mode {
                0 => self.set_offset(zero),
                2 => self.set_offset(zero + input),
                3 if input > FULL_SCALE / 4.0 => {
                    let gain = (FULL_SCALE * FULL_SCALE / input) as u32;
                    let (_, gcal) = self.coefficients();
                    self.registers[gcal..gcal + 4].copy_from_slice(&gain.to_be_bytes());
                    true
                }
                _ => false,
            };
        if valid {
            self.registers[control] &= !bit::CAL_ERR;
            self.calibrated = true;
            self.conversions -= std::mem::take(&mut self.uncalibrated);
        } else {
            self.registers[control] |= bit::CAL_ERR;
        }
        self.calibration_spoilt = false;
        self.ready |= self.defects.keeps_ready;
    }

    pub(super) fn set_offset(&mut self, codes: f64) -> bool {
        if codes.abs() >= FULL_SCALE / 2.0 {
            return false;
        }
        let bytes = (codes.round() as i32).to_be_bytes();
        let (ocal, _) = self.coefficients();
        self.registers[ocal..ocal + 3].copy_from_slice(&bytes[1..]);
        true
    }

    /// Whether a calibration has run since the zero last moved.
    #[must_use]
    pub const fn is_calibrated(&self) -> bool {
        self.calibrated
    }
}

/// The next whole nanosecond. Times are positive; `f64::ceil` is a call of the C library on the
/// oldest x86-64, and this is asked for hundred thousands of times a second.
fn ceil(at: f64) -> u64 {
    let whole = at as u64;
    whole + u64::from((whole as f64) < at)
}
