//! Every fault: number, name, what it means, how to clear it.
//!
//! Numbers are stable. 1 to 31 are faults of the board: all outputs at 0 V. 32 to 63 are faults of
//! one unit: its output at 0 V, the others continue. Every fault is latched until `ClearFaults`,
//! which succeeds for a fault whose cause is gone and never arms.

/// Scope of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// All six units.
    Board,
    /// One unit.
    Unit,
}

macro_rules! faults {
    ($($(#[$doc:meta])* $variant:ident = $code:literal, $scope:ident, $name:literal,
        meaning: $meaning:literal, way_out: $way_out:literal, detail: $detail:literal;)*) => {
        /// A fault. As a number it is [`Fault::code`]; 0 is no fault.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u16)]
        pub enum Fault { $($(#[$doc])* $variant = $code,)* }

        impl Fault {
            /// Every fault, in the order of the numbers.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Scope of the fault.
            #[must_use]
            pub const fn scope(self) -> Scope {
                match self { $(Self::$variant => Scope::$scope,)* }
            }

            /// A few words, for tables.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// What it is.
            #[must_use]
            pub const fn meaning(self) -> &'static str {
                match self { $(Self::$variant => $meaning,)* }
            }

            /// How to clear it.
            #[must_use]
            pub const fn what_to_do(self) -> &'static str {
                match self { $(Self::$variant => $way_out,)* }
            }

            /// Meaning of the detail number.
            #[must_use]
            pub const fn detail_meaning(self) -> &'static str {
                match self { $(Self::$variant => $detail,)* }
            }
        }
    };
}

faults! {
    /// E-stop loop open.
    EStop = 1, Board, "E-stop open",
        meaning: "The E-stop loop is open: the button is pressed, a plug is out or a wire is broken. All motors are at 0 V.",
        way_out: "Make the rig safe, release the button, check the loop's wiring (PG8 must read high), then clear and arm again.",
        detail: "board time in microseconds when the loop opened";
    /// Setpoints not refreshed in time.
    SetpointsExpired = 2, Board, "setpoints expired",
        meaning: "The host stopped sending setpoints while the board was armed: the program ended, the link was unplugged or the computer was too slow.",
        way_out: "Check the link and the host program, then clear, arm and keep sending setpoints within the time they are valid for.",
        detail: "age of the last setpoints in milliseconds";
    /// Stop command.
    HostStop = 3, Board, "stopped by the host",
        meaning: "The host sent the stop command (forcectl stop, Ctrl-C or a failed check on the host).",
        way_out: "Nothing is broken. Clear and arm again when the rig may move.",
        detail: "sequence number of the stop command";
    /// Superloop late.
    LoopOverrun = 4, Board, "loop overrun",
        meaning: "A pass of the superloop took too long, so the response to a sample would have been late.",
        way_out: "Clear. If it comes back, lower the telemetry rate (decimation 2) and report it with the detail: this is a defect of the firmware.",
        detail: "longest pass of the superloop in microseconds";
    /// Sample queue full.
    QueueOverflow = 5, Board, "sample queue overflow",
        meaning: "Samples arrived faster than the superloop took them off the queue, and at least one was lost.",
        way_out: "Clear. If it comes back, check for a loop overrun before it and report both.",
        detail: "samples lost";
    /// I2C bus stuck.
    BusStuck = 6, Board, "I2C bus stuck",
        meaning: "The sensor bus is still blocked after every recovery step (nine clocks, multiplexer reset): no unit can be measured.",
        way_out: "Check SCL and SDA for a short, unplug the sensor modules one by one to find the one that holds the bus, power-cycle it, then clear.",
        detail: "recoveries tried; bit 31: SDA held low (else SCL, or no slave answers)";
    /// Multiplexer silent.
    MuxSilent = 7, Board, "multiplexer silent",
        meaning: "The TCA9548A at 0x70 does not answer or reads back another channel than was written.",
        way_out: "Check the multiplexer's supply, its RESET line (PF12 high) and address straps, then clear.",
        detail: "bits 15 to 8: mask written, bits 7 to 0: mask read back (0xFF: no answer)";
    /// Reset by the watchdog.
    WatchdogReset = 8, Board, "reset by the watchdog",
        meaning: "The previous run stopped responding and the independent watchdog reset the board. The motors were at 0 V from then on.",
        way_out: "Record the detail, then clear. If it comes back, examine the part that did not check in.",
        detail: "bits of the parts that had not checked in, where they are known";
    /// Panic.
    Panic = 9, Board, "firmware panic",
        meaning: "The firmware detected an inconsistent state, wrote 0 V and restarted. forcectl status shows file and line.",
        way_out: "Report file, line and message, then clear.",
        detail: "line number";
    /// HardFault.
    HardFault = 10, Board, "processor fault",
        meaning: "The processor executed an invalid access or instruction; the firmware wrote 0 V and restarted.",
        way_out: "Report the program counter of forcectl status and the detail, then clear.",
        detail: "Configurable Fault Status Register (SCB CFSR)";
    /// Configuration damaged.
    ConfigCrc = 11, Board, "configuration damaged",
        meaning: "The configuration in memory no longer has the checksum it had when it was committed, or what was computed from it has changed.",
        way_out: "Send the configuration again (forcectl does so when it connects), then clear. If it comes back, check the supply.",
        detail: "CRC-32 that was computed; 1 to 6: number of the unit whose computed values have changed";
    /// Supply dip.
    Supply = 12, Board, "supply dip",
        meaning: "The supply fell below the brown-out level and the board was reset.",
        way_out: "Check the 5 V supply and its load, then clear.",
        detail: "RCC_RSR at boot (RM0433 8.7.40)";
    /// DAC bus fault.
    DacLink = 13, Board, "DAC bus fault",
        meaning: "The SPI that feeds the DACs reported an error or did not finish a word: outputs may differ from the commanded codes. The DACs' RST line holds them at 0 V.",
        way_out: "Check SPI wiring and the DACs' supply, then clear.",
        detail: "SPI1 status register (RM0433 50.11.6)";
    /// Encoder counters.
    CounterBus = 14, Board, "encoder counter fault",
        meaning: "An LS7266R1 does not keep what is written to it: the counter bus is not wired or not supplied, so positions and speeds would be wrong. Or one that counted has lost its registers, as after a dip of its 5 V; it is set up again, and its positions begin anew.",
        way_out: "Check the 8-bit bus (PE8 to PE15), CS lines and the 5 V of the counters, then restart the board: a clear does not end this fault.",
        detail: "bits 7 to 0: number of the counter, from 1; bit 8 set: registers lost after the start";
    /// 0 V has no effect.
    OutputStuck = 15, Board, "0 V has no effect",
        meaning: "A motor was switched to 0 V, and its cable did not let go, or its reel wound in; or a motor gave its reel more speed than its whole command could: the DAC, its select wire or the amplifier does not follow. All DACs are held at 0 V by RST, and the alive line is withheld, so that the PLC removes the amplifiers' power. A motor that had no force before (its amplifier is off), a reel that is wound in by hand against 2 N and one whose friction holds 1.6 times what the rig file declares look the same.",
        way_out: "Switch the amplifiers' supply off. Check the DAC's select wire, its supply and the amplifier. Then clear.",
        detail: "bits 31 to 24: unit, from 1; bits 23 to 0: tension that is left, in millinewton (0xFFFFFF: its load cell does not measure, or the reel's speed showed it)";
    /// Force at the tip above its limit.
    TipForce = 16, Board, "tip force above its limit",
        meaning: "The cables pulled harder at the robot's tip than the configured limit, as the board computes it from its own load cells and the cable directions of the last setpoints.",
        way_out: "Find the cause: a setpoint that is too large, a robot that moved far from the pose that the host assumes, or a wrong rig file. Then clear and arm.",
        detail: "force in millinewton";
    /// The external clock failed.
    ClockFailure = 17, Board, "clock failure",
        meaning: "The 8 MHz clock from the ST-Link stopped while the board ran. The board restarted and runs on its internal oscillator.",
        way_out: "Check the ST-Link's supply and its clock output (MCO), reset the board, then clear.",
        detail: "RCC_CIFR when it was noticed (RM0433 8.7.20)";
    /// A register of the controller changed by itself.
    RegisterChanged = 18, Board, "register changed",
        meaning: "A configuration register of the controller (clock, pin, SPI, I2C, DMA, timer, interrupt) no longer has the value that start-up gave it, so outputs and measurements could be wrong. The DACs' RST line holds all motors at 0 V.",
        way_out: "Wait a tenth of a second and clear: pins and SPI have been set up again. If the fault stays, reset the board. If it comes back, check the controller's supply, grounds and shields, and report the detail.",
        detail: "address of the register (RM0433 2.3)";

    /// Over-tension.
    OverTension = 32, Unit, "over-tension",
        meaning: "The cable's tension passed its limit: over_tension_n of the rig file, and 13 N already while the unit is driven (1 N above tension_max_n where that is more). The motor is at 0 V.",
        way_out: "Find the cause: robot motion, tangled cable, wrong zero (zero with slack cables), a load cell that drifted, or tensions that swing (the robot gives way under its cables, or a drive is late). Then clear and arm.",
        detail: "tension in millinewton";
    /// Sensor silent.
    SensorSilent = 33, Unit, "sensor silent",
        meaning: "The load-cell converter stopped signalling samples (no DRDY edge). A force that is not measured is not controlled: the motor is at 0 V.",
        way_out: "Check the sensor module's cable and plug, then clear: the converter is brought up again.",
        detail: "microseconds since the last sample";
    /// Samples too rare.
    SensorSlow = 34, Unit, "sensor too slow",
        meaning: "The sample rate is lower than the converter's oscillator allows (below 297 a second): edges or reads are lost, or the rate setting is wrong.",
        way_out: "Clear, which sets the converter up again. If it comes back, check the DRDY line.",
        detail: "averaged period in microseconds";
    /// Samples too often.
    SensorFast = 35, Unit, "sensor too fast",
        meaning: "The sample rate is higher than the converter's oscillator allows (above 344 a second): DRDY carries noise, so codes may be read twice.",
        way_out: "Check the DRDY line's shield and ground, then clear.",
        detail: "averaged period in microseconds";
    /// Bring-up failed.
    BringUpFailed = 36, Unit, "bring-up failed",
        meaning: "The load-cell converter could not be set up.",
        way_out: "Check the sensor module's supply and plug, then clear to try again. A failed calibration (stage 6) means an open or shorted bridge; no first sample (stage 7) means the DRDY line, which is broken or another unit's.",
        detail: "bits 15 to 8: stage (1 address, 2 reset, 3 power-up, 4 revision, 5 registers, 6 calibration, 7 first sample: DRDY line), bits 7 to 0: register";
    /// ADC saturated.
    AdcSaturated = 37, Unit, "ADC saturated",
        meaning: "The converter was at the end of its range for several samples: the load cell is overloaded, unplugged or broken.",
        way_out: "Remove the load, check the bridge's four wires, then clear.",
        detail: "ADC code";
    /// Encoder error flag.
    EncoderError = 38, Unit, "encoder error",
        meaning: "The counter's noise flag (E) was set several times within a second, or the position jumped further than a reel can move: a loose encoder plug, or noise on its lines. Counts may be lost, and friction feedforward and damping would act on wrong travel.",
        way_out: "Check the encoder's plug and shield, then clear and arm.",
        detail: "FLAG register of the LS7266R1; bit 31 set: micrometres by which the travel of a sample differed from the one before";
    /// Reel runs away with a slack cable.
    CableLost = 39, Unit, "cable lost",
        meaning: "The reel wound in far with hardly any tension: the cable is broken, unhooked or was very slack.",
        way_out: "Hook the cable in, take up the slack by hand, then clear and arm.",
        detail: "travel wound in, in micrometres";
    /// Zeroing refused.
    ZeroRefused = 40, Unit, "zeroing refused",
        meaning: "The load cell was not steady while its zero was averaged, or the reel turned, or the zero is further from the stored one than the configuration permits.",
        way_out: "Make sure the cable is slack and the robot at rest, clear, and zero again. For another load cell or mounting angle, put the new zero into the rig file.",
        detail: "0: saturated; bits 31 and 30 clear: spread in ADC counts; bit 30 set: bits 29 to 0 are the micrometres of cable by which the reel turned; bit 31 set: bits 30 to 0 are the mean's distance from the stored zero in counts";
    /// Reads fail.
    SensorReads = 41, Unit, "sensor reads fail",
        meaning: "The converter signals samples, but reading them over I2C failed several times in a row.",
        way_out: "Check SDA, SCL and the module's bus accelerator, then clear: the converter is brought up again.",
        detail: "failed reads in a row";
    /// The encoder does not count while tension and command differ.
    EncoderStill = 42, Unit, "encoder stands still",
        meaning: "Tension and command differed by more than a resting reel holds, and the encoder counted nothing: it is unplugged or broken. Without it the loop has no damping and oscillates, so the motor is at 0 V.",
        way_out: "Check the encoder's plug, supply and counter, then clear and arm.",
        detail: "swing of tension less command in millinewton";
    /// The converter repeats its result.
    SensorFrozen = 43, Unit, "sensor frozen",
        meaning: "The converter gave the same code many times in a row, though its noise is hundreds of counts: the result is not a new one, or the bridge is not connected to it.",
        way_out: "Check the sensor module's wiring, then clear: the converter is brought up again.",
        detail: "ADC code";
    /// The load cell shows a cable that pushes.
    TensionNegative = 44, Unit, "tension negative",
        meaning: "The load cell shows a clearly negative tension while the motor acts. A cable cannot push: the zero was taken with the cable under load, the signal wires are exchanged or a wire of the bridge is open.",
        way_out: "Check the bridge's four wires and the sign of scale_n_per_count, zero with slack cables, then clear and arm.",
        detail: "size of the tension in millinewton";
    /// The measured tension does not fit the command.
    Implausible = 45, Unit, "tension implausible",
        meaning: "The measured tension is outside the friction model's band around the command, and the reel does not move as the difference would make it; or the reel speeds up against a rising tension; or the cable is slack and the reel rests against a command that would tighten it. The load cell reads wrong, the encoder stands still, the amplifier gives less or more than commanded, or friction is far from the configured one.",
        way_out: "Compare the load cell with a known weight, check the amplifier and its supply, and find friction with forcectl identify. plausible_n in the rig file is the permitted difference. Then clear and arm.",
        detail: "difference in millinewton; bit 31: more tension than the command makes";
    /// The command stands at its limit.
    CommandAtLimit = 46, Unit, "command at its limit",
        meaning: "The unit's command stood at its upper limit, or at zero with too much tension, and the tension did not reach the setpoint: the load cell reads wrong, the amplifier is weak, friction is far from the configured one, or the tension swings.",
        way_out: "Compare the load cell with a known weight, check the amplifier, and find friction with forcectl identify. authority_n in the rig file is what the command may exceed the friction model by. With detail 0 friction alone may hold the tension: then raise tension_min_n. Then clear and arm.",
        detail: "command in millinewton";
}

impl Fault {
    /// Whether the amplifiers lose their power with it: 0 V of a DAC is not certain, or a motor
    /// that pulls would not be seen.
    #[must_use]
    pub const fn takes_power(self) -> bool {
        matches!(self, Self::OutputStuck | Self::DacLink | Self::CounterBus)
    }

    /// The number on the wire and in `forcectl explain`.
    #[must_use]
    pub const fn code(self) -> u16 {
        self as u16
    }

    /// The fault with this number.
    #[must_use]
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.iter().copied().find(|fault| fault.code() == code)
    }
}

/// Room for the details of a latch: numbers of one scope count from 0 or 32 and are below this.
const DETAILS: usize = 20;

/// Keeps every fault until it is cleared. The first is the one that is shown: later ones are mostly
/// its consequences. But one that stands behind it must not be lost with its clear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Latch {
    first: Option<Fault>,
    /// Bit n: the fault with number n is latched.
    latched: u64,
    details: [u32; DETAILS],
}

impl Latch {
    /// An empty latch.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            first: None,
            latched: 0,
            details: [0; DETAILS],
        }
    }

    /// Latches a fault with its detail, unless it is latched already. `true`: it was not.
    pub fn latch(&mut self, fault: Fault, detail: u32) -> bool {
        if self.has(fault) {
            return false;
        }
        self.latched |= bit(fault);
        if let Some(place) = self.details.get_mut(place(fault)) {
            *place = detail;
        }
        self.first = self.first.or(Some(fault));
        true
    }

    /// Clears each fault whose cause is gone. `true`: nothing is latched now.
    pub fn clear(&mut self, still_there: impl Fn(Fault) -> bool) -> bool {
        for fault in Fault::ALL.iter().filter(|fault| !still_there(**fault)) {
            self.latched &= !bit(*fault);
        }
        let left = |fault: &Fault| self.has(*fault);
        self.first = self
            .first
            .filter(left)
            .or_else(|| Fault::ALL.iter().copied().find(left));
        self.first.is_none()
    }

    /// Whether this fault is latched, first or behind another.
    #[must_use]
    pub const fn has(&self, fault: Fault) -> bool {
        self.latched & bit(fault) != 0
    }

    /// The fault that was latched first, and its detail.
    #[must_use]
    pub fn get(&self) -> Option<(Fault, u32)> {
        self.first.map(|fault| (fault, self.detail()))
    }

    /// Whether a fault is latched.
    #[must_use]
    pub const fn is_set(&self) -> bool {
        self.first.is_some()
    }

    /// The first fault's number; 0: none.
    #[must_use]
    pub const fn code(&self) -> u16 {
        match self.first {
            Some(fault) => fault.code(),
            None => 0,
        }
    }

    /// The first fault's detail; 0 where there is none.
    #[must_use]
    pub fn detail(&self) -> u32 {
        let detail = self.first.and_then(|fault| self.details.get(place(fault)));
        detail.copied().unwrap_or(0)
    }
}

const fn bit(fault: Fault) -> u64 {
    1 << fault.code()
}

/// Where a fault's detail is.
const fn place(fault: Fault) -> usize {
    fault.code() as usize % 32
}

#[allow(clippy::indexing_slicing)] // by the compiler
const _: () = {
    let mut n = 0;
    while n < Fault::ALL.len() {
        assert!(Fault::ALL[n].code() < 64 && place(Fault::ALL[n]) < DETAILS);
        n += 1;
    }
};
