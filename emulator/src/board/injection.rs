//! Fault injection, and the misuse that all devices have recorded.

use super::{Board, IN_ORDER};
use crate::devices::ls7266r1::Ls7266r1;
use crate::devices::Complaints;
use crate::wiring::{self, UNITS};
use emulator_link::{DacResetPull, Injection};

/// Every part at its own place but for two.
fn exchanged(a: usize, b: usize) -> [usize; UNITS] {
    let mut wired = IN_ORDER;
    wired.swap(a, b);
    wired
}

impl Board {
    /// Injects a fault, or removes it.
    ///
    /// # Errors
    /// A unit that does not exist, a figure that is not finite, or an injection that is the
    /// engine's.
    pub fn inject(&mut self, injection: Injection) -> Result<(), String> {
        let unit = |number: u8| {
            let index = usize::from(number).wrapping_sub(1);
            (index < UNITS)
                .then_some(index)
                .ok_or_else(|| format!("unit {number} does not exist: units are 1 to {UNITS}"))
        };
        let now = self.now_ns;
        match injection {
            Injection::UnplugSensor(number) => self.converters[unit(number)?].unplug(),
            Injection::PlugSensor(number) => self.converters[unit(number)?].plug(),
            Injection::Nack(number) => self.converters[unit(number)?].nack(),
            Injection::Spike(number, codes) => self.converters[unit(number)?].spike(codes),
            Injection::StuckSda => {
                self.sda_held = true;
                self.scl_pulses = 0;
                self.pending.push((wiring::I2C_SDA, Some(false)));
            }
            Injection::EStop(pressed) => {
                self.power.estop_pressed = pressed;
                self.show_estop();
                self.switch_power(now);
            }
            Injection::PullCable(number, newtons) => {
                let unit = unit(number)?;
                if !newtons.is_finite() {
                    return Err(format!("a pull of {newtons} N is not a number"));
                }
                self.advance_plant(now);
                self.pull_n[unit] = newtons;
                self.plant.hang_on_cell(unit, newtons);
            }
            Injection::HangOnTip(newtons) => {
                self.advance_plant(now);
                (self.plant.hang_on_tip(newtons)).map_err(|error| error.to_string())?;
            }
            Injection::FreezeEncoder(number, frozen) => {
                let unit = unit(number)?;
                self.advance_plant(now);
                self.frozen_encoder[unit] = frozen.then(|| self.encoder_edges(unit));
            }
            Injection::DipCounter(number) => {
                let chip = usize::from(number).wrapping_sub(1);
                let counter = (self.counters.get_mut(chip))
                    .ok_or_else(|| format!("counter {number} does not exist: they are 1 to 3"))?;
                *counter = Ls7266r1::new(usize::from(number));
            }
            Injection::OpenBridge(number, on) => {
                self.converters[unit(number)?].defects().open_bridge = on;
            }
            Injection::FrozenCode(number, on) => {
                self.converters[unit(number)?].defects().frozen = on;
            }
            Injection::WrongSign(number, on) => {
                self.converters[unit(number)?].defects().wrong_sign = on;
            }
            Injection::CalibrationError(number, on) => {
                self.converters[unit(number)?].defects().calibration = on;
            }
            Injection::WrongRevision(number, on) => {
                self.converters[unit(number)?].defects().revision = on;
            }
            Injection::LatchAtPointer(on) => {
                for converter in &mut self.converters {
                    converter.defects().latches_at_pointer = on;
                }
            }
            Injection::KeepReady(on) => {
                for converter in &mut self.converters {
                    converter.defects().keeps_ready = on;
                }
            }
            Injection::FreeRun(on) => {
                for converter in &mut self.converters {
                    converter.defects().free_runs = on;
                }
            }
            Injection::ReportUnsettled(on) => {
                for converter in &mut self.converters {
                    converter.defects().reports_unsettled = on;
                }
            }
            Injection::StartSlowly(on) => {
                for converter in &mut self.converters {
                    converter.defects().starts_slowly = on;
                }
            }
            Injection::StuckDac(number, on) => self.dacs[unit(number)?].set_stuck(on),
            Injection::HoldSda(on) => {
                self.sda_held = on;
                self.sda_jammed = on;
                self.pending
                    .push((wiring::I2C_SDA, if on { Some(false) } else { None }));
            }
            Injection::MuteMux(on) => self.mux.set_mute(on),
            Injection::AmplifierOff(number, on) => {
                self.set_amplifier_share(unit(number)?, if on { 0.0 } else { 1.0 });
            }
            Injection::ReverseEncoder(number, on) => {
                let unit = unit(number)?;
                self.advance_plant(now);
                self.turn_counters();
                self.reverse_encoder(unit, on);
            }
            Injection::FlipBusBit(bit) => self.flip_bus_bit = Some(u32::from(bit)),
            Injection::FlipDacBit(bit) => {
                if bit > 15 {
                    return Err(format!("bit {bit} of a word: bits are 0 to 15"));
                }
                self.flip_dac_bit = Some(bit);
            }
            Injection::DrdyGlitch(number) => {
                let unit = unit(number)?;
                // Short against everything the controller does: the level is gone when it looks.
                if let Some(level) = self.drdy[unit] {
                    self.pending.push((wiring::DRDY[unit], Some(!level)));
                    self.pending.push((wiring::DRDY[unit], Some(level)));
                }
            }
            Injection::LoseDrdy(number, edges) => self.lose_drdy[unit(number)?] = edges,
            Injection::BusError => self.bus_error = true,
            Injection::StallUsart => self.stall = true,
            Injection::StopSpi(on) => self.spi_stopped = on,
            Injection::ExchangeEncoders(a, b) => {
                let wired = exchanged(unit(a)?, unit(b)?);
                self.advance_plant(now);
                self.turn_counters();
                self.wired.encoder = wired;
            }
            Injection::ExchangeMotors(a, b) => {
                self.wired.motor = exchanged(unit(a)?, unit(b)?);
                self.move_outputs(now);
            }
            Injection::ExchangeCells(a, b) => {
                let wired = exchanged(unit(a)?, unit(b)?);
                self.advance_plant(now);
                self.wired.cell = wired;
            }
            Injection::ExchangeDrdy(a, b) => self.wired.drdy = exchanged(unit(a)?, unit(b)?),
            Injection::EncoderLines(number, lines) => {
                let unit = unit(number)?;
                if lines == 0 {
                    return Err("an encoder has one line at least".to_owned());
                }
                self.advance_plant(now);
                self.turn_counters();
                self.encoder_lines[unit] = lines;
            }
            Injection::AmplifierShare(number, share) => {
                let unit = unit(number)?;
                if !share.is_finite() {
                    return Err(format!("a share of {share} is not a number"));
                }
                self.set_amplifier_share(unit, share);
            }
            Injection::PullOut(number, mm) => {
                let unit = unit(number)?;
                if !mm.is_finite() {
                    return Err(format!("{mm} mm of cable are not a number"));
                }
                self.advance_plant(now);
                (self.plant.pull_out(unit, mm * 1e-3)).map_err(|error| error.to_string())?;
            }
            Injection::UnplugAlive(on) => self.power.alive_unplugged = on,
            Injection::OpenAlive(on) => self.power.alive_open = on,
            Injection::BridgeRelay(on) => {
                self.power.relay_bridged = on;
                self.switch_power(now);
            }
            Injection::InvertRelay(on) => {
                self.power.relay_inverted = on;
                self.switch_power(now);
            }
            Injection::BypassRelay(number, on) => {
                self.power.bypassed[unit(number)?] = on;
                self.switch_power(now);
                self.move_outputs(now);
            }
            Injection::BridgeEStopAtPlc(on) => {
                self.power.estop_bridged_at_plc = on;
                self.show_estop();
                self.switch_power(now);
            }
            Injection::BridgeEStop(on) => {
                self.power.estop_bridged = on;
                self.show_estop();
            }
            Injection::InvertEStop(on) => {
                self.power.estop_inverted = on;
                self.show_estop();
            }
            Injection::OpenLdac(number, on) => self.dacs[unit(number)?].set_ldac_open(on),
            Injection::TieSelects(a, b) => {
                let (a, b) = (unit(a)?, unit(b)?);
                self.tied = (a != b).then_some([a, b]);
            }
            Injection::ExchangeChannels(a, b) => {
                let (a, b) = (unit(a)?, unit(b)?);
                self.exchanged = (a != b).then_some([a, b]);
            }
            Injection::CellShare(number, share) => {
                let unit = unit(number)?;
                if !share.is_finite() {
                    return Err(format!("a share of {share} is not a number"));
                }
                self.advance_plant(now);
                self.cell_share[unit] = share;
            }
            Injection::CellNoise(number, sd_v_per_v) => {
                let unit = unit(number)?;
                if !(sd_v_per_v.is_finite() && sd_v_per_v >= 0.0) {
                    return Err(format!("noise of {sd_v_per_v} V/V is not possible"));
                }
                self.converters[unit].defects().noise = sd_v_per_v;
            }
            Injection::CellTone(number, amplitude, hz) => {
                let unit = unit(number)?;
                if !(amplitude.is_finite() && hz.is_finite()) {
                    return Err(format!(
                        "a tone of {amplitude} V/V at {hz} Hz is not possible"
                    ));
                }
                self.converters[unit].defects().tone = (amplitude, hz);
            }
            Injection::CutDrdy(number, on) => self.drdy_cut[unit(number)?] = on,
            Injection::BrownOutLevel(level) => {
                if level > 3 {
                    return Err(format!("brown-out level {level}: levels are 0 to 3"));
                }
                self.brown_out_level = level;
            }
            Injection::DacResetPull(pull) => {
                self.dac_reset_pull = pull;
                self.show_dac_reset();
            }
            Injection::HangLoop
            | Injection::FlipBit(..)
            | Injection::LoseClock(_)
            | Injection::BrownOut
            | Injection::Forbidden(_)
            | Injection::FlipRegister(..)
            | Injection::FlipCore(..)
            | Injection::PlugUsb(_)
            | Injection::SuspendUsb(_)
            | Injection::ReadUsb(_) => {
                return Err("this injection belongs to the engine".to_owned());
            }
        }
        self.show_drdy(now);
        self.reschedule();
        Ok(())
    }

    /// The ST-Link's clock stops, or comes back.
    pub fn set_clock_lost(&mut self, lost: bool) {
        self.clock_lost = lost;
    }

    /// What holds DAC_RST while the controller does not drive it.
    #[must_use]
    pub const fn dac_reset_pull(&self) -> DacResetPull {
        self.dac_reset_pull
    }

    /// Brown-out level in the option bytes.
    #[must_use]
    pub const fn brown_out_level(&self) -> u8 {
        self.brown_out_level
    }

    /// Whether the ST-Link's clock stands still.
    #[must_use]
    pub const fn is_clock_lost(&self) -> bool {
        self.clock_lost
    }

    /// Whether the SPI controller has stopped.
    #[must_use]
    pub const fn is_spi_stopped(&self) -> bool {
        self.spi_stopped
    }

    /// Whether a bus error without a cause is due now; the call takes it.
    pub fn take_bus_error(&mut self) -> bool {
        std::mem::take(&mut self.bus_error)
    }

    /// Whether the serial line's DMA stream locks up now; the call takes it.
    pub fn take_stall(&mut self) -> bool {
        std::mem::take(&mut self.stall)
    }

    /// Misuse of the chips and buses, which the real parts would not report.
    #[must_use]
    pub fn complaints(&self) -> Complaints {
        let mut all = self.complaints.clone();
        // A frame of ten bits every 5 us at most; a board that sends at another rate shows either
        // by bytes that come closer, or, over many, by none that come this close.
        let frame_ns = 10_000_000_000 / wiring::BAUD;
        if let Some(closest) = self.line.closest_ns {
            let fast = closest * 100 < frame_ns * 98;
            let slow = self.line.bytes > 1_000 && closest * 100 > frame_ns * 102;
            if fast || slow {
                all.add(
                    "USART3",
                    format!(
                        "sends a byte every {closest} ns; {} baud 8N1 would be {frame_ns} ns",
                        wiring::BAUD
                    ),
                );
            }
        }
        all
    }
}
