//! NAU7802: 24-bit bridge converter (Nuvoton datasheet rev 1.7; register table in its section 11).
//!
//! Properties of the part that this model has, because firmware often handles them wrongly:
//!
//! * Start-up: nothing converts before PUD, PUA and CS; PUR comes about 200 us after PUD; the
//!   revision reads 0 until a moment after PUR.
//! * The first six conversions after a start settle and DRDY stays quiet for them (section 8.4).
//! * A calibration writes the coefficients of the channel that is selected, and conversions use
//!   those.
//! * DRDY rises when a result is ready and falls when 0x12 is read. An unread result is replaced
//!   without notice: the pin stays high and there is no further edge.
//! * Reading 0x12 latches all 24 bits; a read while nothing is new returns the old result.
//! * Register 0x15 reads back only while 0x1B bit 7 is 0 (otherwise the OTP is behind it).
//! * A change of gain, rate or channel moves the zero until a calibration has run (344 ms), and
//!   every calibration gives a slightly different zero.
//! * Its RC clock is up to 3 % off and drifts, so six converters never stay in step.
//! * Fast read (0x11 bit 6) is 24 data clocks behind the address with no acknowledge slots, 33
//!   clocks in all where the plain read takes 54. A standard controller clocks nine per byte and
//!   sees it shifted.
//!
//! Where the datasheet lines at hand leave something open, or drivers that work on silicon
//! contradict them, a variant of [`Defects`] has the other behaviour: `latches_at_pointer`,
//! `keeps_ready`, `free_runs`, `reports_unsettled`, `starts_slowly`.
//!
//! Not modelled: the second channel's own input (it is open on this board), the temperature
//! sensor's scale, the OTP's content, CRSD.

mod conversion;
mod register_map;
mod registers;

use super::Complaints;
use crate::rng::Rng;
use conversion::*;
use register_map::{bit, reg, reset_values, REGISTERS};
use std::f64::consts::TAU;

/// I2C address, fixed in the chip.
pub const ADDRESS: u8 = 0x2A;

/// What is broken at a load cell or in its converter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Defects {
    /// An excitation wire is open: the bridge gives nothing.
    pub open_bridge: bool,
    /// The result register keeps its value.
    pub frozen: bool,
    /// The signal wires are exchanged.
    pub wrong_sign: bool,
    /// Calibrations fail.
    pub calibration: bool,
    /// The revision reads as another one.
    pub revision: bool,
    /// Not a defect but a variant that the datasheet leaves open: the result is latched when the
    /// pointer is set to it.
    pub latches_at_pointer: bool,
    /// Another variant: DRDY rises at the end of a calibration, and a start leaves it as it was.
    pub keeps_ready: bool,
    /// Another variant: conversions need no CS and do not stop with it. Section 9.1 step 5 says
    /// that none takes place without; six published drivers never set it.
    pub free_runs: bool,
    /// Another variant: the six conversions that settle come with DRDY. Linux's driver counts six
    /// ready results away.
    pub reports_unsettled: bool,
    /// Another variant, of what drivers that work wait for: the revision reads 0 without PUA, and a
    /// calibration fails that begins less than TRDY (five samples and 100 ms at the rate that was
    /// in force) after PUA, or before ten results have come since the last change.
    pub starts_slowly: bool,
    /// One conversion in so many becomes ready; 0 and 1: each.
    pub one_in: u64,
    /// Periods are longer by this share.
    pub stretch: f64,
    /// The signal lacks this share.
    pub lost_share: f64,
    /// Added to the signal, V/V, and what it grows by in a second since [`Defects::drift_from_ns`].
    pub offset: f64,
    /// See [`Defects::offset`]; V/V a second.
    pub drift: f64,
    /// Beginning of the drift.
    pub drift_from_ns: u64,
    /// Added to one conversion in ten, V/V.
    pub spike: f64,
    /// Noise beside the chip's own, V/V SD.
    pub noise: f64,
    /// A tone that is added to the signal: amplitude at the filter's output, V/V, frequency, Hz.
    pub tone: (f64, f64),
}

impl Defects {
    /// What the wires to the bridge make of its signal, V/V.
    fn wired(&self, signal: f64) -> f64 {
        match self {
            Self {
                open_bridge: true, ..
            } => 0.0,
            Self {
                wrong_sign: true, ..
            } => -signal,
            _ => signal,
        }
    }

    /// The signal of the conversion with this number that ends at `t_ns`, V/V.
    fn distort(&self, signal: f64, t_ns: u64, conversion: u64) -> f64 {
        let seconds = t_ns.saturating_sub(self.drift_from_ns) as f64 * 1e-9;
        let spike = if conversion.is_multiple_of(10) {
            self.spike
        } else {
            0.0
        };
        let (amplitude, hz) = self.tone;
        let tone = match amplitude {
            0.0 => 0.0,
            _ => amplitude * (TAU * hz * (t_ns as f64 * 1e-9)).sin(),
        };
        let signal = self.wired(signal) * (1.0 - self.lost_share);
        signal + self.offset + self.drift * seconds + spike + tone
    }
}

/// One converter with its load cell's bridge on channel 1.
#[derive(Debug, Clone)]
pub struct Nau7802 {
    name: String,
    rng: Rng,
    registers: [u8; REGISTERS],
    /// Clock error of this chip and its present drift, relative.
    clock_error: f64,
    clock_wander: f64,
    raw_offset: f64,
    pointer: u8,
    pointer_next: bool,
    addressed: bool,
    fast: Option<u64>,
    /// When the digital part is up, once PUD is set.
    ready_at: Option<u64>,
    revision_at: u64,
    /// When the analog part is ready in the variant `starts_slowly`, and the results that a
    /// calibration needs in it.
    analog_at: u64,
    to_flush: u32,
    powered_up: bool,
    calibrating: Option<(u64, u8)>,
    calibration_spoilt: bool,
    calibrated: bool,
    next_conversion: Option<f64>,
    period_ns: f64,
    /// Conversions until the filter has settled.
    settling: usize,
    result: i32,
    /// Number of the result in `result`, of the one in `latch`, and of the last one counted as
    /// read.
    result_number: u64,
    latch_number: u64,
    counted_number: u64,
    latch: i32,
    ready: bool,
    spike: Option<i32>,
    nacks: bool,
    plugged: bool,
    /// What is broken at the load cell or in the chip.
    defects: Defects,
    /// Conversions that became ready; without those before a calibration, which nobody waits for.
    pub conversions: u64,
    /// Conversions since the last calibration was lost.
    uncalibrated: u64,
    /// Conversions whose last byte was read before the next one was ready.
    pub conversions_read: u64,
}

impl Nau7802 {
    /// The converter of `unit` (from 1), powered on at time 0.
    #[must_use]
    pub fn new(unit: u8, seed: u64) -> Self {
        let mut rng = Rng::new(seed, 0x7802_0000 + u64::from(unit));
        let clock_error = CLOCK_TOLERANCE * rng.uniform_signed();
        let mut chip = Self {
            name: format!("NAU7802[{unit}]"),
            rng,
            registers: reset_values(),
            clock_error,
            clock_wander: 0.0,
            raw_offset: 0.0,
            pointer: 0,
            pointer_next: false,
            addressed: false,
            fast: None,
            ready_at: None,
            revision_at: u64::MAX,
            analog_at: 0,
            to_flush: 0,
            powered_up: false,
            calibrating: None,
            calibration_spoilt: false,
            calibrated: false,
            next_conversion: None,
            period_ns: 0.0,
            settling: 0,
            result: 0,
            result_number: 0,
            latch_number: 0,
            counted_number: 0,
            latch: 0,
            ready: false,
            spike: None,
            nacks: false,
            plugged: true,
            defects: Defects::default(),
            conversions: 0,
            uncalibrated: 0,
            conversions_read: 0,
        };
        chip.power_on();
        chip
    }

    fn power_on(&mut self) {
        self.registers = reset_values();
        self.raw_offset = RAW_OFFSET * self.rng.normal();
        self.pointer = 0;
        self.addressed = false;
        self.fast = None;
        self.ready_at = None;
        self.powered_up = false;
        self.calibrating = None;
        self.calibrated = false;
        self.next_conversion = None;
        self.result = 0;
        self.latch = 0;
        self.ready = false;
        self.spike = None;
    }

    /// Pulls the sensor cable: no answer, no DRDY.
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.power_on();
    }

    /// Plugs it in again (power-on reset) and removes an injected NACK.
    pub fn plug(&mut self) {
        self.nacks = false;
        if !self.plugged {
            self.plugged = true;
            self.power_on();
        }
    }

    /// From now on the chip does not acknowledge its address.
    pub fn nack(&mut self) {
        self.nacks = true;
    }

    /// Adds `codes` to the next conversion only.
    pub fn spike(&mut self, codes: i32) {
        self.spike = Some(codes);
    }

    /// The edge of the last conversion got lost: nothing is ready until the next one.
    pub fn miss(&mut self) {
        self.ready = false;
    }

    /// What is broken, to be changed.
    pub fn defects(&mut self) -> &mut Defects {
        &mut self.defects
    }

    /// Level of the DRDY pin; `None` when nothing drives the wire.
    #[must_use]
    pub fn drdy(&self) -> Option<bool> {
        self.plugged
            .then_some(self.ready ^ (self.registers[usize::from(reg::CTRL1)] & bit::CRP != 0))
    }

    /// Output data rate it is set to, in samples per second, before its clock error.
    #[must_use]
    pub fn rate(&self) -> f64 {
        match (self.registers[usize::from(reg::CTRL2)] >> 4) & 7 {
            1 => 20.0,
            2 => 40.0,
            3 => 80.0,
            7 => 320.0,
            _ => 10.0,
        }
    }

    /// Gain of the input amplifier.
    #[must_use]
    pub fn gain(&self) -> f64 {
        f64::from(1u32 << (self.registers[usize::from(reg::CTRL1)] & 7))
    }

    fn reference_v(&self) -> f64 {
        [4.5, 4.2, 3.9, 3.6, 3.3, 3.0, 2.7, 2.4]
            [usize::from((self.registers[usize::from(reg::CTRL1)] >> 3) & 7)]
    }

    /// Size of one code at the input, in volts.
    #[must_use]
    pub fn lsb_v(&self) -> f64 {
        0.5 * self.reference_v() / self.gain() / FULL_SCALE
    }

    /// Input-referred noise in volts RMS: 50 nV at 10 SPS and 150 nV at 80 SPS are the datasheet's
    /// at gain 128, 300 nV at 320 SPS continues them; a lower gain adds the modulator's own share.
    fn noise_v(&self) -> f64 {
        let at_128 = match self.rate() as u32 {
            10 => 50e-9,
            20 => 75e-9,
            40 => 106e-9,
            80 => 150e-9,
            _ => 300e-9,
        };
        at_128 * (128.0 / self.gain()).sqrt()
    }

    /// START with this chip's address. False: not acknowledged.
    pub fn start(&mut self, read: bool, t_ns: u64, complaints: &mut Complaints) -> bool {
        self.advance_power(t_ns);
        self.addressed = self.plugged && !self.nacks;
        self.pointer_next = !read;
        self.fast = None;
        if self.addressed && read && self.registers[usize::from(reg::I2C_CTRL)] & bit::FRD != 0 {
            complaints.add(
                format!("{}.I2C_CTRL", self.name),
                "fast read (FRD) has no acknowledge slots; a standard I2C controller sees it shifted",
            );
            self.latch_result();
            self.fast = Some(u64::from(self.latch as u32 & 0x00FF_FFFF) << 40 | 0xFF_FFFF_FFFF);
        }
        self.addressed
    }

    /// A byte written to it.
    pub fn write(&mut self, byte: u8, t_ns: u64, complaints: &mut Complaints) -> bool {
        if !self.addressed {
            return false;
        }
        self.advance_power(t_ns);
        if self.pointer_next {
            self.pointer_next = false;
            self.pointer = byte & 0x7F;
            if self.defects.latches_at_pointer && self.pointer == reg::ADCO_B2 {
                self.latch_early();
            }
        } else {
            self.write_register(self.pointer, byte, t_ns, complaints);
            self.pointer = (self.pointer + 1) & 0x7F;
        }
        true
    }

    /// A byte read from it. Released wires read as ones.
    pub fn read(&mut self, t_ns: u64) -> u8 {
        if !self.addressed {
            return 0xFF;
        }
        self.advance_power(t_ns);
        if let Some(stream) = &mut self.fast {
            let byte = (*stream >> 56) as u8;
            *stream = *stream << 9 | 0x1FF;
            return byte;
        }
        let value = self.read_register(self.pointer, t_ns);
        self.pointer = (self.pointer + 1) & 0x7F;
        value
    }

    /// The register the next byte is read from.
    #[must_use]
    pub const fn pointer(&self) -> u8 {
        self.pointer
    }

    /// STOP, or another chip addressed.
    pub fn stop(&mut self) {
        self.addressed = false;
        self.fast = None;
    }

    /// The result is latched ahead of its read: the read lowers DRDY, but gives what was there.
    fn latch_early(&mut self) {
        self.latch = self.result;
        self.latch_number = self.result_number;
    }

    fn latch_result(&mut self) {
        self.latch = self.result;
        self.latch_number = self.result_number;
        self.ready = false;
    }
}

fn sign_extend(bytes: &[u8]) -> i32 {
    i32::from_be_bytes([bytes[0], bytes[1], bytes[2], 0]) >> 8
}

#[cfg(test)]
mod tests;
