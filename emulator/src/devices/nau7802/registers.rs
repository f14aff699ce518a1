//! The effect of reading or writing a register.

use super::conversion::*;
use super::register_map::{bit, reg, reset_values, REGISTERS};
use super::Nau7802;
use crate::devices::Complaints;

impl Nau7802 {
    pub(super) fn read_register(&mut self, address: u8, t_ns: u64) -> u8 {
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
                if self.defects.latches_at_pointer {
                    self.ready = false;
                } else {
                    self.latch_result();
                }
                (self.latch >> 16) as u8
            }
            0x13 => (self.latch >> 8) as u8,
            reg::ADCO_B0 => {
                // Read whole in time: what is latched is still the newest, and was not counted
                // before.
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
            reg::REVISION if self.defects.starts_slowly && self.registers[0] & bit::PUA == 0 => 0,
            reg::REVISION if self.defects.revision => 0x0E,
            reg::REVISION if self.powered_up && t_ns >= self.revision_at => 0x0F,
            reg::REVISION => 0,
            _ => stored,
        }
    }

    pub(super) fn write_register(
        &mut self,
        address: u8,
        value: u8,
        t_ns: u64,
        complaints: &mut Complaints,
    ) {
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
            reg::PU_CTRL => self.write_power_control(value, t_ns),
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
                    let early = t_ns < self.analog_at || self.to_flush > 0;
                    self.calibration_spoilt =
                        !self.analog_on() || self.defects.starts_slowly && early;
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

    fn write_power_control(&mut self, value: u8, t_ns: u64) {
        let before = self.registers[0];
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
        } else if before & bit::PUD == 0 {
            let ready = t_ns + (POWER_UP_NS * (1.0 + 0.1 * self.rng.uniform_signed())) as u64;
            self.ready_at = Some(ready);
            self.revision_at = ready + (1e6 * self.rng.uniform()) as u64;
        }
        if value & !before & bit::PUA != 0 {
            self.analog_at = t_ns + TRDY_NS + (5e9 / self.rate()) as u64;
        }
        let cs = if self.defects.free_runs { 0 } else { bit::CS };
        let relevant = bit::PUD | bit::PUA | cs | bit::AVDDS;
        if (value ^ before) & relevant != 0 {
            self.restart(t_ns);
        }
    }
}
