//! NAU7802: 24-bit bridge converter (Nuvoton datasheet rev 1.7; register table in its section 11).
//!
//! What this model keeps of the real one, because firmware trips over each:
//!
//! * Start-up: nothing converts before PUD, PUA and CS; PUR comes about 200 us after PUD; the revision reads
//!   0 until a moment after PUR.
//! * The first six conversions after a start settle and DRDY stays quiet for them (section 8.4).
//! * DRDY rises when a result is ready and falls when 0x12 is read. A result nobody reads is replaced in
//!   silence: the pin stays high and there is no further edge.
//! * Reading 0x12 latches all 24 bits; a read while nothing is new returns the old result.
//! * Register 0x15 reads back only while 0x1B bit 7 is 0 (otherwise the OTP is behind it).
//! * A change of gain, rate or channel leaves the zero elsewhere until a calibration has run (344 ms), and
//!   every calibration lands a little differently.
//! * Its RC clock is up to 3 % off and drifts, so six converters never stay in step.
//! * Fast read (0x11 bit 6) is 24 data clocks behind the address with no acknowledge slots, 33 clocks in all
//!   where the plain read takes 54. A standard controller clocks nine per byte and sees it shifted.
//!
//! Not modelled: the second channel's own input (it is open on this board), the temperature sensor's
//! scale, the OTP's content, CRSD.

use super::Complaints;
use crate::rng::Rng;

/// I2C address, fixed in the chip.
pub const ADDRESS: u8 = 0x2A;

/// Positive full scale as a code.
const FULL_SCALE: f64 = 8_388_608.0;
/// PUD to PUR, section 8.1: about 200 us.
const POWER_UP_NS: f64 = 200_000.0;
/// CALS to its clearing (seen by drivers).
const CALIBRATION_NS: f64 = 344_000_000.0;
/// Conversions that settle after a start.
const SETTLING: u32 = 6;
/// RC oscillator tolerance.
const CLOCK_TOLERANCE: f64 = 0.03;
/// Standard deviation of the clock's random walk per conversion, relative; pulled back to its centre, so
/// that it wanders by about 0.05 %.
const CLOCK_WALK: f64 = 2e-6;
const CLOCK_PULL: f64 = 1e-5;
/// Zero of an uncalibrated input: standard deviation in codes at gain 128.
const RAW_OFFSET: f64 = 60_000.0;
/// How far a calibration can miss the zero, in codes: users report steps of 0.5 to 1 % of a 3 kg cell's
/// range between power-ups.
const CALIBRATION_MISS: f64 = 20_000.0;

mod reg {
    pub const PU_CTRL: u8 = 0x00;
    pub const CTRL1: u8 = 0x01;
    pub const CTRL2: u8 = 0x02;
    pub const OCAL1: usize = 0x03;
    pub const GCAL1: usize = 0x06;
    pub const GCAL2: usize = 0x0D;
    pub const I2C_CTRL: u8 = 0x11;
    pub const ADCO_B2: u8 = 0x12;
    pub const ADCO_B0: u8 = 0x14;
    pub const ADC: u8 = 0x15;
    pub const PGA: u8 = 0x1B;
    pub const REVISION: u8 = 0x1F;
}

mod bit {
    pub const RR: u8 = 0x01;
    pub const PUD: u8 = 0x02;
    pub const PUA: u8 = 0x04;
    pub const PUR: u8 = 0x08;
    pub const CS: u8 = 0x10;
    pub const CR: u8 = 0x20;
    pub const AVDDS: u8 = 0x80;
    pub const CAL_ERR: u8 = 0x08;
    pub const CALS: u8 = 0x04;
    pub const CRP: u8 = 0x80;
    pub const DRDY_SEL: u8 = 0x40;
    pub const FRD: u8 = 0x40;
    pub const SHORT: u8 = 0x08;
    pub const CHOPPER_OFF: u8 = 0x30;
    pub const RD_OTP_SEL: u8 = 0x80;
}

const REGISTERS: usize = 0x20;

fn reset_values() -> [u8; REGISTERS] {
    let mut registers = [0; REGISTERS];
    // Gain calibration 0x00800000 = 1.0, both channels.
    registers[reg::GCAL1 + 1] = 0x80;
    registers[reg::GCAL2 + 1] = 0x80;
    registers
}

/// One converter with its load cell's bridge on channel 1.
#[derive(Debug, Clone)]
pub struct Nau7802 {
    name: String,
    rng: Rng,
    registers: [u8; REGISTERS],
    /// Clock error of this chip and its present wander, relative.
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
    powered_up: bool,
    calibrating: Option<(u64, u8)>,
    calibration_spoilt: bool,
    calibrated: bool,
    next_conversion: Option<f64>,
    period_ns: f64,
    settling: u32,
    result: i32,
    /// Number of the result in `result`, of the one in `latch`, and of the last one counted as read.
    result_number: u64,
    latch_number: u64,
    counted_number: u64,
    latch: i32,
    ready: bool,
    spike: Option<i32>,
    nacks: bool,
    plugged: bool,
    /// Conversions that became ready.
    pub conversions: u64,
    /// Conversions whose last byte was read before the next one was ready.
    pub conversions_read: u64,
}

impl Nau7802 {
    /// The converter of `unit` (from 1), powered on at time 0.
    #[must_use]
    pub fn new(unit: u8, seed: u64) -> Self {
        let mut rng = Rng::new(seed, 0x7802_0000 + u64::from(unit));
        let clock_error = CLOCK_TOLERANCE * rng.symmetric();
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
            conversions: 0,
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

    /// Plugs it in again (power-on reset) and mends an injected NACK.
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

    /// Input-referred noise in volts RMS: 50 nV at 10 SPS and 150 nV at 80 SPS are the datasheet's at gain
    /// 128, 300 nV at 320 SPS continues them; a lower gain adds the modulator's own share.
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

    fn latch_result(&mut self) {
        self.latch = self.result;
        self.latch_number = self.result_number;
        self.ready = false;
    }

    fn read_register(&mut self, address: u8, t_ns: u64) -> u8 {
        let Some(&stored) = self.registers.get(usize::from(address)) else {
            return 0;
        };
        match address {
            reg::PU_CTRL => {
                stored & !(bit::CR | bit::PUR)
                    | if self.ready { bit::CR } else { 0 }
                    | if self.powered_up { bit::PUR } else { 0 }
            }
            reg::ADCO_B2 => {
                self.latch_result();
                (self.latch >> 16) as u8
            }
            0x13 => (self.latch >> 8) as u8,
            reg::ADCO_B0 => {
                // Read whole in time: what is latched is still the newest, and was not counted before.
                if self.latch_number == self.result_number
                    && self.counted_number < self.result_number
                {
                    self.counted_number = self.result_number;
                    self.conversions_read += 1;
                }
                self.latch as u8
            }
            // Behind 0x15 is the OTP while RD_OTP_SEL is set; its content is not public.
            reg::ADC if self.registers[usize::from(reg::PGA)] & bit::RD_OTP_SEL != 0 => 0xFF,
            reg::REVISION if self.powered_up && t_ns >= self.revision_at => 0x0F,
            reg::REVISION => 0,
            _ => stored,
        }
    }

    fn write_register(&mut self, address: u8, value: u8, t_ns: u64, complaints: &mut Complaints) {
        let before = self.registers;
        let at = usize::from(address);
        // RR is a level: while it is set every register but itself stays at its reset value.
        if address != reg::PU_CTRL && before[0] & bit::RR != 0 {
            complaints.add(
                &self.name,
                "register written while RR holds the chip in reset",
            );
            return;
        }
        match address {
            reg::PU_CTRL => {
                let value = value & !(bit::CR | bit::PUR);
                if value & bit::RR != 0 {
                    self.registers = reset_values();
                    self.registers[0] = bit::RR;
                    self.ready_at = None;
                    self.powered_up = false;
                    self.calibrating = None;
                    self.calibrated = false;
                    self.next_conversion = None;
                    self.ready = false;
                    return;
                }
                self.registers[0] = value;
                if value & bit::PUD == 0 {
                    self.ready_at = None;
                    self.powered_up = false;
                    self.ready = false;
                } else if before[0] & bit::PUD == 0 {
                    let ready = t_ns + (POWER_UP_NS * (1.0 + 0.1 * self.rng.symmetric())) as u64;
                    self.ready_at = Some(ready);
                    self.revision_at = ready + (1e6 * self.rng.uniform()) as u64;
                }
                let relevant = bit::PUD | bit::PUA | bit::CS | bit::AVDDS;
                if (value ^ before[0]) & relevant != 0 {
                    self.restart(t_ns);
                }
            }
            reg::CTRL1 => {
                self.registers[at] = value;
                if value & bit::DRDY_SEL != 0 {
                    complaints.add(
                        format!("{}.CTRL1", self.name),
                        "DRDY_SEL puts the clock on DRDY",
                    );
                }
                if (value ^ before[at]) & 0x3F != 0 {
                    self.disturb(t_ns);
                }
            }
            reg::CTRL2 => {
                let busy = self.calibrating.is_some();
                self.registers[at] = value & 0xF3 | before[at] & (bit::CAL_ERR | bit::CALS);
                if matches!((value >> 4) & 7, 4..=6) {
                    complaints.add(format!("{}.CTRL2", self.name), "CRS value is reserved");
                }
                if (value ^ before[at]) & 0xF0 != 0 {
                    self.disturb(t_ns);
                }
                if value & bit::CALS != 0 && !busy {
                    let length = CALIBRATION_NS / (1.0 + self.clock_error);
                    self.calibrating = Some((t_ns + length as u64, value & 3));
                    self.calibration_spoilt = !self.analog_on();
                    self.registers[at] |= bit::CALS;
                    self.next_conversion = None;
                    self.ready = false;
                }
            }
            reg::ADC => {
                self.registers[at] = value;
                if value & bit::CHOPPER_OFF != bit::CHOPPER_OFF {
                    complaints.add(
                        format!("{}.ADC", self.name),
                        "CHPS other than 11 is reserved",
                    );
                }
            }
            reg::ADCO_B2..=reg::ADCO_B0 | reg::REVISION => {
                complaints.add(
                    &self.name,
                    format!("write to read-only register {address:#04x}"),
                );
            }
            _ if at < REGISTERS => {
                self.registers[at] = value;
                if (reg::OCAL1..reg::OCAL1 + 14).contains(&at) {
                    self.restart(t_ns);
                }
            }
            _ => complaints.add(
                &self.name,
                format!("write to unknown register {address:#04x}"),
            ),
        }
    }

    fn analog_on(&self) -> bool {
        let needed = bit::PUD | bit::PUA;
        self.powered_up && self.registers[0] & needed == needed
    }

    /// A change that moves the zero: settle again, and the old calibration no longer fits.
    fn disturb(&mut self, t_ns: u64) {
        self.raw_offset = RAW_OFFSET * self.rng.normal();
        self.calibrated = false;
        self.calibration_spoilt |= self.calibrating.is_some();
        self.restart(t_ns);
    }

    /// Starts converting from scratch where the settings say so, or stops.
    fn restart(&mut self, t_ns: u64) {
        self.ready = false;
        let converting =
            self.analog_on() && self.registers[0] & bit::CS != 0 && self.calibrating.is_none();
        if converting {
            self.settling = SETTLING;
            self.schedule(t_ns as f64);
        } else {
            self.next_conversion = None;
        }
    }

    fn schedule(&mut self, from_ns: f64) {
        self.clock_wander += CLOCK_WALK * self.rng.normal() - CLOCK_PULL * self.clock_wander;
        self.period_ns = 1e9 / (self.rate() * (1.0 + self.clock_error + self.clock_wander));
        self.next_conversion = Some(from_ns + self.period_ns);
    }

    fn advance_power(&mut self, t_ns: u64) {
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
        [
            self.ready_at,
            self.calibrating.map(|(at, _)| at),
            self.next_conversion.map(|at| at.ceil() as u64),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Does what is due at `t_ns`. `bridge(end_ns, period_ns)` is the filtered bridge signal in V/V for a
    /// conversion that ends at `end_ns`. True when a result became ready.
    pub fn advance(&mut self, t_ns: u64, bridge: impl Fn(u64, f64) -> f64) -> bool {
        if !self.plugged {
            return false;
        }
        self.advance_power(t_ns);
        if let Some((at, mode)) = self.calibrating {
            if t_ns >= at {
                self.calibrating = None;
                let input = bridge(at, 1e9 / 80.0);
                self.finish_calibration(mode, input);
                self.restart(at);
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
        if self.settling > 0 {
            self.settling -= 1;
            return false;
        }
        self.result = self.convert(bridge(due.ceil() as u64, period));
        self.result_number += 1;
        self.conversions += 1;
        let was_ready = self.ready;
        self.ready = true;
        !was_ready
    }

    fn input_codes(&self, bridge_v_per_v: f64) -> f64 {
        if self.registers[usize::from(reg::I2C_CTRL)] & bit::SHORT != 0 {
            return 0.0;
        }
        if self.registers[usize::from(reg::CTRL2)] & 0x80 != 0 {
            // Channel 2 is open: its inputs float to the rail.
            return FULL_SCALE;
        }
        if self.registers[0] & bit::AVDDS == 0 {
            // AVDD comes from the chip's own regulator on this board: without it no excitation and no
            // reference, and the ratio of the two is anything.
            return FULL_SCALE;
        }
        // Ratiometric: the bridge is fed from AVDD, which is the reference too.
        bridge_v_per_v * self.gain() / 0.5 * FULL_SCALE
    }

    fn convert(&mut self, bridge_v_per_v: f64) -> i32 {
        let noise = self.noise_v() / self.lsb_v() * self.rng.normal();
        let raw = self.input_codes(bridge_v_per_v) + self.raw_offset * self.gain() / 128.0 + noise;
        let offset = f64::from(sign_extend(&self.registers[reg::OCAL1..reg::OCAL1 + 3]));
        let gain = f64::from(u32::from_be_bytes([
            self.registers[reg::GCAL1],
            self.registers[reg::GCAL1 + 1],
            self.registers[reg::GCAL1 + 2],
            self.registers[reg::GCAL1 + 3],
        ])) / FULL_SCALE;
        let code = (raw - offset) * gain + f64::from(self.spike.take().unwrap_or(0));
        code.round().clamp(-FULL_SCALE, FULL_SCALE - 1.0) as i32
    }

    fn finish_calibration(&mut self, mode: u8, bridge_v_per_v: f64) {
        let control = usize::from(reg::CTRL2);
        self.registers[control] &= !bit::CALS;
        let miss = CALIBRATION_MISS * self.rng.symmetric() * self.gain() / 128.0;
        let zero = self.raw_offset * self.gain() / 128.0 + miss;
        let input = self.input_codes(bridge_v_per_v);
        let valid = !self.calibration_spoilt
            && match mode {
                0 => self.set_offset(zero),
                2 => self.set_offset(zero + input),
                3 if input > FULL_SCALE / 4.0 => {
                    let gain = (FULL_SCALE * FULL_SCALE / input) as u32;
                    self.registers[reg::GCAL1..reg::GCAL1 + 4].copy_from_slice(&gain.to_be_bytes());
                    true
                }
                _ => false,
            };
        if valid {
            self.registers[control] &= !bit::CAL_ERR;
            self.calibrated = true;
        } else {
            self.registers[control] |= bit::CAL_ERR;
        }
        self.calibration_spoilt = false;
    }

    fn set_offset(&mut self, codes: f64) -> bool {
        if codes.abs() >= FULL_SCALE / 2.0 {
            return false;
        }
        let bytes = (codes.round() as i32).to_be_bytes();
        self.registers[reg::OCAL1..reg::OCAL1 + 3].copy_from_slice(&bytes[1..]);
        true
    }

    /// Whether a calibration has run since the zero last moved.
    #[must_use]
    pub const fn is_calibrated(&self) -> bool {
        self.calibrated
    }
}

fn sign_extend(bytes: &[u8]) -> i32 {
    i32::from_be_bytes([bytes[0], bytes[1], bytes[2], 0]) >> 8
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chip and a clock: what a patient master on the bus would see.
    struct Bench {
        chip: Nau7802,
        t_ns: u64,
        complaints: Complaints,
        bridge: f64,
        edges: Vec<u64>,
    }

    impl Bench {
        fn new(seed: u64) -> Self {
            Self {
                chip: Nau7802::new(1, seed),
                t_ns: 1_000,
                complaints: Complaints::default(),
                bridge: 0.0,
                edges: Vec::new(),
            }
        }

        fn write(&mut self, register: u8, value: u8) {
            assert!(self.chip.start(false, self.t_ns, &mut self.complaints));
            assert!(self.chip.write(register, self.t_ns, &mut self.complaints));
            assert!(self.chip.write(value, self.t_ns, &mut self.complaints));
            self.chip.stop();
        }

        fn read(&mut self, register: u8, bytes: usize) -> Vec<u8> {
            assert!(self.chip.start(false, self.t_ns, &mut self.complaints));
            self.chip.write(register, self.t_ns, &mut self.complaints);
            assert!(self.chip.start(true, self.t_ns, &mut self.complaints));
            let read = (0..bytes).map(|_| self.chip.read(self.t_ns)).collect();
            self.chip.stop();
            read
        }

        fn code(&mut self) -> i32 {
            sign_extend(&self.read(0x12, 3))
        }

        fn wait(&mut self, ns: u64) {
            let end = self.t_ns + ns;
            while let Some(at) = self.chip.next_event().filter(|at| *at <= end) {
                let bridge = self.bridge;
                if self.chip.advance(at, |_, _| bridge) {
                    self.edges.push(at);
                }
            }
            self.t_ns = end;
        }

        fn until_ready(&mut self) {
            for _ in 0..10_000 {
                if self.chip.drdy() == Some(true) {
                    return;
                }
                self.wait(100_000);
            }
            panic!("no DRDY within a second");
        }

        /// The documented start-up at 320 SPS and gain 128.
        fn bring_up(&mut self) {
            self.write(0x00, 0x01);
            self.write(0x00, 0x00);
            self.write(0x00, 0x02);
            self.wait(400_000);
            self.write(0x00, 0x86);
            self.write(0x01, 0x2F);
            self.write(0x02, 0x70);
            self.write(0x15, 0x30);
            self.write(0x02, 0x74);
            self.wait(400_000_000);
            self.write(0x00, 0x96);
        }
    }

    #[test]
    fn power_up_ready_takes_about_200_us_and_the_revision_a_moment_more() {
        let mut bench = Bench::new(1);
        assert_eq!(bench.read(0x1F, 1), [0]);
        bench.write(0x00, 0x02);
        bench.wait(150_000);
        assert_eq!(bench.read(0x00, 1), [0x02]);
        bench.wait(100_000);
        assert_eq!(bench.read(0x00, 1), [0x0A]);
        bench.wait(1_100_000);
        assert_eq!(bench.read(0x1F, 1), [0x0F]);
    }

    #[test]
    fn registers_come_up_as_documented_and_auto_increment() {
        let mut bench = Bench::new(1);
        let all = bench.read(0x00, 0x12);
        let mut expected = [0u8; 0x12];
        (expected[0x07], expected[0x0E]) = (0x80, 0x80);
        assert_eq!(all, expected);
        bench.write(0x03, 0x55);
        assert_eq!(bench.read(0x7F, 2), [0x00, 0x00], "0x7F wraps to 0x00");
        assert_eq!(bench.read(0x02, 3), [0x00, 0x55, 0x00]);
    }

    #[test]
    fn reset_is_a_level() {
        let mut bench = Bench::new(1);
        bench.write(0x01, 0x2F);
        bench.write(0x00, 0x01);
        bench.write(0x01, 0x2F);
        assert_eq!(bench.read(0x00, 2), [0x01, 0x00]);
        assert!(!bench.complaints.is_empty());
        bench.write(0x00, 0x00);
        bench.write(0x01, 0x2F);
        assert_eq!(bench.read(0x01, 1), [0x2F]);
    }

    #[test]
    fn nothing_converts_before_cycle_start_and_six_conversions_settle() {
        let mut bench = Bench::new(3);
        bench.write(0x00, 0x86);
        bench.wait(400_000);
        bench.write(0x02, 0x70);
        bench.wait(100_000_000);
        assert!(bench.edges.is_empty());
        let start = bench.t_ns;
        bench.write(0x00, 0x96);
        bench.wait(100_000_000);
        let first = bench.edges[0] - start;
        assert!(
            (7.0 * 3.03e6..7.0 * 3.23e6).contains(&(first as f64)),
            "{first}"
        );
    }

    #[test]
    fn drdy_stays_high_until_read_and_an_old_result_is_repeated() {
        let mut bench = Bench::new(4);
        bench.bring_up();
        bench.until_ready();
        let edges = bench.edges.len();
        bench.wait(20_000_000);
        assert_eq!(bench.chip.drdy(), Some(true));
        assert_eq!(bench.edges.len(), edges, "unread: no further edge");
        assert_eq!(bench.read(0x00, 1)[0] & 0x20, 0x20);
        let first = bench.code();
        assert_eq!(bench.chip.drdy(), Some(false));
        assert_eq!(bench.code(), first);
        assert_eq!(bench.chip.conversions_read, 1);
        assert!(bench.chip.conversions >= 6);
    }

    #[test]
    fn the_latch_holds_all_24_bits_while_the_next_result_arrives() {
        let mut bench = Bench::new(5);
        bench.bring_up();
        bench.until_ready();
        bench.bridge = 1e-3;
        bench.chip.start(false, bench.t_ns, &mut bench.complaints);
        bench.chip.write(0x12, bench.t_ns, &mut bench.complaints);
        bench.chip.start(true, bench.t_ns, &mut bench.complaints);
        let high = bench.chip.read(bench.t_ns);
        let before = bench.chip.latch;
        bench.wait(4_000_000);
        let rest = [bench.chip.read(bench.t_ns), bench.chip.read(bench.t_ns)];
        assert_eq!(sign_extend(&[high, rest[0], rest[1]]), before);
        assert_eq!(
            bench.chip.conversions_read, 0,
            "the next one was ready first"
        );
    }

    #[test]
    fn the_clock_is_within_three_percent_and_every_chip_has_its_own() {
        let rates: Vec<f64> = (1..=6)
            .map(|unit| {
                let mut bench = Bench::new(9);
                bench.chip = Nau7802::new(unit, 9);
                bench.bring_up();
                bench.until_ready();
                bench.edges.clear();
                for _ in 0..2_000 {
                    bench.wait(500_000);
                    bench.code();
                }
                (bench.edges.len() - 1) as f64
                    / ((bench.edges[bench.edges.len() - 1] - bench.edges[0]) as f64 * 1e-9)
            })
            .collect();
        for (k, rate) in rates.iter().enumerate() {
            assert!((310.0..330.5).contains(rate), "unit {}: {rate}", k + 1);
            assert!(rates.iter().filter(|other| *other == rate).count() == 1);
        }
    }

    #[test]
    fn scale_and_noise_are_the_datasheets() {
        let mut bench = Bench::new(6);
        bench.bring_up();
        assert!((bench.chip.lsb_v() - 1.397e-9).abs() < 1e-12);
        let mut mean = |bridge| {
            bench.bridge = bridge;
            let mut codes = Vec::new();
            for _ in 0..2_000 {
                bench.until_ready();
                codes.push(f64::from(bench.code()));
            }
            let mean = codes.iter().sum::<f64>() / codes.len() as f64;
            let variance =
                codes.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / codes.len() as f64;
            (mean, variance.sqrt() * 1.397e-9)
        };
        let (zero, noise) = mean(0.0);
        let (loaded, _) = mean(1e-3);
        assert!((noise - 300e-9).abs() < 20e-9, "{noise}");
        // 1 mV/V at 3.0 V is 3 mV: 3e-3 / 1.397e-9 codes.
        assert!((loaded - zero - 3e-3 / 1.396_983_9e-9).abs() < 50.0);
    }

    #[test]
    fn the_result_saturates() {
        let mut bench = Bench::new(7);
        bench.bring_up();
        for (bridge, code) in [(1.0, 0x7F_FFFF), (-1.0, -0x80_0000)] {
            bench.bridge = bridge;
            bench.until_ready();
            bench.code();
            bench.until_ready();
            assert_eq!(bench.code(), code);
        }
    }

    #[test]
    fn calibration_takes_344_ms_and_a_gain_change_spoils_it() {
        let mut bench = Bench::new(8);
        bench.write(0x00, 0x86);
        bench.wait(400_000);
        bench.write(0x01, 0x2F);
        bench.write(0x02, 0x74);
        bench.wait(300_000_000);
        assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0x04);
        bench.write(0x02, 0x70);
        assert_eq!(
            bench.read(0x02, 1)[0] & 0x04,
            0x04,
            "CALS ignores writes while set"
        );
        bench.wait(70_000_000);
        assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0x00);
        assert!(bench.chip.is_calibrated());
        bench.write(0x01, 0x2E);
        assert!(!bench.chip.is_calibrated());
        bench.write(0x02, 0x74);
        bench.write(0x01, 0x2F);
        bench.wait(400_000_000);
        assert_eq!(
            bench.read(0x02, 1)[0] & 0x0C,
            0x08,
            "gain moved under the calibration"
        );
        bench.write(0x02, 0x74);
        bench.wait(400_000_000);
        assert_eq!(
            bench.read(0x02, 1)[0] & 0x0C,
            0x00,
            "a valid calibration clears CAL_ERR"
        );
    }

    #[test]
    fn calibrating_with_the_analog_part_off_fails() {
        let mut bench = Bench::new(8);
        bench.write(0x00, 0x02);
        bench.wait(400_000);
        bench.write(0x02, 0x74);
        bench.wait(400_000_000);
        assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0x08);
    }

    #[test]
    fn the_adc_register_reads_back_only_without_otp_select() {
        let mut bench = Bench::new(1);
        bench.write(0x15, 0x30);
        assert_eq!(bench.read(0x15, 1), [0x30]);
        bench.write(0x1B, 0x80);
        assert_eq!(bench.read(0x15, 1), [0xFF]);
    }

    #[test]
    fn fast_read_is_shifted_for_a_standard_controller() {
        let mut bench = Bench::new(4);
        bench.bring_up();
        bench.until_ready();
        bench.write(0x11, 0x40);
        let expected = bench.chip.result as u32 & 0xFF_FFFF;
        bench.chip.start(true, bench.t_ns, &mut bench.complaints);
        let bytes = [bench.chip.read(bench.t_ns), bench.chip.read(bench.t_ns)];
        assert_eq!(u32::from(bytes[0]), expected >> 16);
        assert_eq!(
            u32::from(bytes[1]),
            expected >> 7 & 0xFF,
            "bit 15 went into the acknowledge"
        );
        assert!(!bench.complaints.is_empty());
    }

    #[test]
    fn an_unplugged_chip_is_silent_and_starts_over_when_plugged_in() {
        let mut bench = Bench::new(4);
        bench.bring_up();
        bench.until_ready();
        bench.chip.unplug();
        assert_eq!(bench.chip.drdy(), None);
        assert_eq!(bench.chip.next_event(), None);
        assert!(!bench.chip.start(false, bench.t_ns, &mut bench.complaints));
        bench.chip.plug();
        assert_eq!(bench.read(0x00, 3), [0, 0, 0]);
        bench.chip.nack();
        assert!(!bench.chip.start(false, bench.t_ns, &mut bench.complaints));
        bench.chip.plug();
        assert!(bench.chip.start(false, bench.t_ns, &mut bench.complaints));
    }

    #[test]
    fn a_spike_hits_one_conversion() {
        let mut bench = Bench::new(4);
        bench.bring_up();
        bench.until_ready();
        let before = bench.code();
        bench.chip.spike(1_000_000);
        bench.until_ready();
        let hit = bench.code();
        bench.until_ready();
        let after = bench.code();
        assert!((hit - before - 1_000_000).abs() < 3_000);
        assert!((after - before).abs() < 3_000);
    }
}
