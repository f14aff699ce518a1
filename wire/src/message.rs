//! The messages of both directions.
//!
//! Units are numbered 0 to 5 in arrays and masks, as everywhere inside the firmware; what a person
//! reads counts from 1. States and faults travel as the numbers of `control::state` and
//! `control::faults`, the one place that names and explains them.

use crate::UNITS;
use core::fmt::Write as _;
use heapless::{String, Vec};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Most samples in one telemetry frame.
pub const BATCH: usize = 4;

/// Ripples that a unit's feedforward knows.
pub const RIPPLES: usize = 2;

/// A frame from the host: one command and the number that its response carries.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct HostFrame {
    /// Counts the host's frames; the reply repeats it.
    pub seq: u16,
    /// What to do.
    pub command: Command,
}

/// What the host can request from the board. Every command but [`Command::Setpoints`] is answered
/// with a [`Reply`]; setpoints are confirmed by the telemetry that shows them in force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
#[allow(clippy::large_enum_variant)] // decoded into place on a board without an allocator
pub enum Command {
    /// First command on a link: versions of the host. Anything else before it is refused.
    Hello {
        /// The host's [`crate::ABI_VERSION`].
        abi: u16,
        /// The host's [`crate::SCHEMA_HASH`].
        schema: [u8; 8],
    },
    /// Request a [`Status`] now (one also comes every 50 ms without a request).
    GetStatus,
    /// Request the configuration of a unit that is in force.
    GetConfig {
        /// Unit, from 0.
        unit: u8,
    },
    /// Put a unit's configuration beside the one in force. Nothing changes until
    /// [`Command::CommitConfig`].
    StageConfig {
        /// Unit, from 0.
        unit: u8,
        /// The configuration, checked when staged.
        config: UnitConfig,
    },
    /// Put the configuration of the whole board beside the one in force; [`Command::CommitConfig`]
    /// exchanges it too.
    StageBoard {
        /// The configuration, checked when staged.
        config: BoardConfig,
    },
    /// Request the configuration of the whole board that is in force.
    GetBoard,
    /// Exchange all staged configurations at the next cycle boundary; refused while armed.
    CommitConfig,
    /// Average samples with slack cables and take the mean as zero; refused while armed.
    Zero {
        /// Bit n: unit n.
        units: u8,
    },
    /// Let the motors act on setpoints. Refused while a fault is latched, a unit isn't ready or the
    /// E-stop is open.
    Arm,
    /// Ramp the torques down and go back to ready.
    Disarm,
    /// 0 V on all motors now, latched as a fault until [`Command::ClearFaults`].
    Stop,
    /// Clear latched faults whose cause is gone, and bring offline sensors up again. Does not arm.
    ClearFaults,
    /// New cable tensions. They expire: when nothing newer has come within `valid_ms`, the board
    /// stops.
    Setpoints {
        /// For how long these may be held, in milliseconds, 1 to 1,000.
        valid_ms: u16,
        /// One for each unit.
        units: [UnitSetpoint; UNITS],
    },
    /// Choose what is streamed.
    Stream {
        /// One sample in this many is sent, for each unit; 1: all, 0: none.
        decimation: u8,
    },
}

/// What one unit shall hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct UnitSetpoint {
    /// Cable tension in micronewton; 0 takes the unit out of action (0 V).
    pub tension_un: i32,
    /// 1 / cos of the angle between cable and load-cell axis, times 65,536; 65,536 to 262,144
    /// (0 to 75.5 degrees). The board multiplies the load-cell force by it to get the cable tension
    /// (thesis 3.7: T = F / cos theta).
    pub inv_cos_q16: i32,
    /// Direction in which the cable pulls at the tip, robot base frame, unit vector times 16,384.
    /// The board sums tension times direction over all units and stops above
    /// [`BoardConfig::tip_force_limit_un`]. All zero: not known; the tension then counts in full,
    /// whatever its direction.
    pub direction_q14: [i16; 3],
    /// Speed at which the reel will have to wind in while the setpoint holds, because the robot
    /// moves, in micrometres a second of cable; negative: pay out; -1,000,000 to 1,000,000. The
    /// friction feedforward expects it of a reel that rests. `None`: not known, or not well enough;
    /// the encoder then shows the direction alone.
    pub reel_um_per_s: Option<i32>,
}

/// 1 in [`UnitSetpoint::direction_q14`].
pub const DIRECTION_ONE: i16 = 16_384;

/// Configuration of the whole board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct BoardConfig {
    /// Force at the tip at which the board stops all motors, in micronewton, 1,000,000 to
    /// 100,000,000.
    pub tip_force_limit_un: i32,
    /// Whether the bus writes a converter's register pointer ahead of its next sample. Off costs
    /// some 50 us a sample. Off is right where a converter latches its result at that write instead
    /// of at the read; docs/bring-up.md has the measurement.
    pub pointer_ahead: bool,
}

impl Default for BoardConfig {
    /// What a board starts with. 20 N: six cables within 2 to 12 N can pull with 17.3 N along the
    /// diagonal of three pairs at right angles.
    fn default() -> Self {
        Self {
            tip_force_limit_un: 20_000_000,
            pointer_ahead: true,
        }
    }
}

/// How a unit's samples are filtered before the controller sees them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum FilterChoice {
    /// The thesis's filter: the mean of the last n samples, 1 to 16.
    MovingAverage(u8),
    /// Second-order Butterworth low pass, corner in hundredths of a hertz.
    LowPass {
        /// Corner frequency in 0.01 Hz, 500 to 12,000.
        corner_chz: u16,
    },
}

/// Configuration of a unit's controller. Physical quantities, as integers with their unit in the
/// name; the ranges are checked by `control`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UnitConfig {
    /// Whether this unit exists and takes part.
    pub enabled: bool,
    /// Load-cell force per ADC count in piconewton (nominal 6,850,000); negative where pulling
    /// lowers the code.
    pub scale_pn_per_count: i32,
    /// ADC code at zero load; [`Command::Zero`] sets it on the board.
    pub zero_code: i32,
    /// ADC code at zero load as it was found when the unit was calibrated.
    pub stored_zero_code: i32,
    /// How far a new zero may be from the stored one, in micronewton of load-cell force; a zero
    /// further off is refused.
    pub zero_deviation_un: i32,
    /// Filter.
    pub filter: FilterChoice,
    /// A sample further than this from the prediction is a spike, in micronewton.
    pub spike_limit_un: i32,
    /// Proportional gain, N of cable force per N of error, times 65,536.
    pub kp_q16: i32,
    /// Integral gain, N per N and second, times 65,536.
    pub ki_q16: i32,
    /// Derivative gain, N per N/s, times 65,536.
    pub kd_q16: i32,
    /// Damping on the reel's speed, N per m/s, times 65,536.
    pub damping_q16: i32,
    /// Whether the friction feedforward acts.
    pub friction_feedforward: bool,
    /// Force at the cable with no command, in micronewton (measured 155,000).
    pub friction_offset_un: i32,
    /// Force at the cable per commanded cable force, times 65,536 (measured 1.018).
    pub friction_gain_q16: i32,
    /// Coulomb friction without load, in micronewton (measured 909,000).
    pub coulomb_un: i32,
    /// Growth of Coulomb friction with load, N per N, times 65,536 (measured 0.154).
    pub coulomb_load_q16: i32,
    /// Reel travel over which the friction's direction reverses, in nanometres.
    pub reversal_nm: i32,
    /// Cable travel per encoder count in nanometres, positive when winding in counts up; nominal
    /// 2 pi 10 mm / (4000 * 26 / 7) = 4,229.
    pub travel_nm_per_count: i32,
    /// DAC counts per newton of cable force, times 65,536 (nominal 282.2).
    pub dac_counts_per_n_q16: i32,
    /// Largest commanded cable force, in micronewton.
    pub force_limit_un: i32,
    /// How far the command may exceed what the friction model needs to wind the cable in at the
    /// setpoint, in micronewton: bounds the pull of a unit whose load cell reads too little.
    pub authority_un: i32,
    /// How far the measured tension may be outside the friction model's band around the command, in
    /// micronewton, before the load cell or the motor is in doubt.
    pub plausible_un: i32,
    /// Fastest change of the commanded cable force, in micronewton per second.
    pub slew_un_per_s: i32,
    /// Tension at which the unit faults, in micronewton. While it follows setpoints it faults at 13
    /// N already, or 1 N above its largest tension.
    pub over_tension_un: i32,
    /// Viscous friction that the feedforward compensates, N per m/s of cable travel, times 65,536;
    /// 0: none.
    pub viscous_q16: i32,
    /// Forces that repeat with the reel's angle, compensated by the feedforward.
    pub ripples: [Ripple; RIPPLES],
    /// What the load cell's conversion takes out besides zero and scale.
    pub cell: CellCorrection,
    /// Largest tension of a setpoint, in micronewton: what the cable and the robot bear.
    pub tension_max_un: i32,
    /// Gain of the leaking integral, N per N and second, times 65,536; 0: none.
    pub leaky_ki_q16: i32,
}

/// Curve and creep of a load cell, taken out of its readings. A straight reading `x` (code less
/// zero, times scale) becomes `x + curve x^2`; from that the creep `s` is taken, which follows the
/// load that is left, `l`: `ds/dt = (creep l - s) / time constant`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct CellCorrection {
    /// Curve, nanonewton per square newton of straight reading; 0: none.
    pub curve_nn_per_n2: i32,
    /// Share of a lasting load by which the reading grows, times 65,536; 0: none.
    pub creep_q16: i32,
    /// Time constant of that in milliseconds.
    pub creep_ms: i32,
}

impl CellCorrection {
    /// A straight cell without creep.
    pub const NONE: Self = Self {
        curve_nn_per_n2: 0,
        creep_q16: 0,
        creep_ms: 60_000,
    };
}

/// A force on the cable that repeats with the reel's angle (eccentric reel, gear mesh, cogging):
/// (amplitude + share x setpoint) x sin(2 pi (turns per count x position) + phase), positive where
/// it adds to the tension. The position is the unit's extended encoder position, which starts at 0
/// when the board boots: the phase holds until then. All zero: none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct Ripple {
    /// Periods per encoder count, times 2^32.
    pub periods_per_count_q32: i32,
    /// Phase at position 0 in turns, times 2^32 (-0.5 to 0.5).
    pub phase_q32: i32,
    /// Amplitude in micronewton.
    pub amplitude_un: i32,
    /// Amplitude per setpoint, N per N, times 65,536.
    pub amplitude_load_q16: i32,
}

/// A frame from the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BoardFrame {
    /// Counts the frames of this link, dropped ones included: a gap is what the queue had no room
    /// for.
    pub seq: u16,
    /// The message.
    pub message: BoardMessage,
}

/// A message of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
#[allow(clippy::large_enum_variant)] // built in place on a board without an allocator
pub enum BoardMessage {
    /// Response to a command.
    Reply(Reply),
    /// Samples.
    Samples(Batch),
    /// State of the whole board, every 50 ms.
    Status(Status),
    /// A fault, at the moment it was latched.
    Fault(FaultReport),
}

/// Response to the command with this number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Reply {
    /// [`HostFrame::seq`] of the command.
    pub seq: u16,
    /// Result of the command.
    pub response: Response,
}

/// Result of a command.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
#[allow(clippy::large_enum_variant)]
pub enum Response {
    /// Done, or begun where it takes time (zeroing, bring-up); [`Status`] shows the end.
    Done,
    /// To [`Command::Hello`].
    Hello(BoardInfo),
    /// To [`Command::GetStatus`].
    Status(Status),
    /// To [`Command::GetConfig`].
    Config(UnitConfig),
    /// To [`Command::GetBoard`].
    Board(BoardConfig),
    /// Not done, and why.
    Rejected(CommandError),
}

/// Why a command was not carried out. Nothing has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum CommandError {
    /// No [`Command::Hello`] has been accepted on this link yet.
    NotConnected,
    /// The host speaks another protocol; these are the board's numbers.
    Version {
        /// The board's [`crate::ABI_VERSION`].
        abi: u16,
        /// The board's [`crate::SCHEMA_HASH`].
        schema: [u8; 8],
    },
    /// Not in this state (`control::state::SystemState` as a number).
    State(u8),
    /// A fault is latched (`control::faults`); clear it first.
    Faulted(u16),
    /// The board has no unit with this number; 255: no unit was named.
    UnknownUnit(u8),
    /// The unit exists but cannot take part now: it is disabled or its sensor is not up yet. No
    /// fault is latched.
    UnitNotReady {
        /// Unit, from 0.
        unit: u8,
        /// `control::state::MotorState` of the unit as a number.
        state: u8,
    },
    /// A value is out of its range: number of the field in [`UnitConfig`] or of the unit's
    /// setpoint, from 0.
    Range {
        /// Unit, from 0.
        unit: u8,
        /// Field, from 0 in the order of declaration.
        field: u8,
    },
}

/// Who the board is and what happened to it last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BoardInfo {
    /// The board's [`crate::ABI_VERSION`].
    pub abi: u16,
    /// The board's [`crate::SCHEMA_HASH`].
    pub schema: [u8; 8],
    /// Version of the firmware.
    pub version: String<32>,
    /// Core clock in hertz.
    pub core_hz: u32,
    /// Silicon revision of the controller (DBGMCU_IDC.REV_ID): 0x1003 Y, 0x2001 X, 0x2003 V.
    pub silicon: u16,
    /// Whether the clock comes from the HSE input. `false`: it was missing, and the board runs on
    /// its internal HSI (1 %).
    pub hse: bool,
    /// RCC_RSR at boot (RM0433 8.7.40): why it was reset.
    pub reset_flags: u32,
    /// FLASH_OPTSR_CUR at boot (RM0433 section 4.4): the option bytes in force. See
    /// [`Self::brown_out_level`].
    pub option_bytes: u32,
    /// The controller's own number of 96 bits (RM0433 section 61.1), the serial number of its USB
    /// port. See [`Self::number`].
    pub unique_id: [u32; 3],
    /// What holds DAC_RST while the controller does not drive it, as found at boot.
    pub dac_reset_pull: Pull,
    /// Crash record of the previous run: the fault or panic that ended it, or `None`.
    pub crash_record: Option<CrashRecord>,
}

impl BoardInfo {
    /// Level that docs/bring-up.md has set.
    pub const BROWN_OUT_LEVEL: u8 = 3;

    /// BOR_LEV of the option bytes, 0 to 3: below which supply the controller is reset; 0 is the
    /// factory's.
    #[must_use]
    pub const fn brown_out_level(&self) -> u8 {
        (self.option_bytes >> 2 & 3) as u8
    }

    /// The controller's number as 24 hexadecimal digits, word by word; `None` where it has none
    /// (all bits are zero).
    #[must_use]
    pub fn number(&self) -> Option<String<24>> {
        (self.unique_id != [0; 3]).then(|| serial_number(self.unique_id))
    }
}

/// A controller's number as 24 hexadecimal digits, word by word, the highest digit of each first.
#[must_use]
pub fn serial_number(unique_id: [u32; 3]) -> String<24> {
    let mut digits = String::new();
    for word in unique_id {
        // Three times eight digits fit.
        let _ = write!(digits, "{word:08X}");
    }
    digits
}

/// What holds a pin that the controller does not drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Pull {
    /// A pull-down: it stays low against the controller's own pull-up.
    Down,
    /// Nothing: it follows the controller's own pull-up and pull-down.
    None,
    /// A pull-up: it stays high against the controller's own pull-down.
    Up,
}

impl Pull {
    /// From the levels that the pin had with the controller's own pull-up and pull-down (30 to 50
    /// kOhm; a resistor of the board is 10 kOhm or less).
    #[must_use]
    pub const fn of_levels(high_pulled_up: bool, high_pulled_down: bool) -> Self {
        match (high_pulled_up, high_pulled_down) {
            (false, _) => Self::Down,
            (true, false) => Self::None,
            (true, true) => Self::Up,
        }
    }
}

/// Why the run before this one ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct CrashRecord {
    /// Fault number (`control::faults`).
    pub code: u16,
    /// Its detail.
    pub detail: u32,
    /// Program counter where it is known, or 0.
    pub pc: u32,
    /// Where and what, as far as it fits (a panic's file, line and message).
    pub text: String<96>,
}

/// A fault at the moment it was latched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct FaultReport {
    /// Board time in microseconds.
    pub t_us: u32,
    /// Unit from 0; 255: the whole board.
    pub unit: u8,
    /// Fault number (`control::faults`).
    pub code: u16,
    /// Its detail; the fault's page explains it.
    pub detail: u32,
}

/// State of the whole board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// Board time in microseconds, wraps after 71 minutes.
    pub t_us: u32,
    /// `control::state::SystemState` as a number.
    pub state: u8,
    /// First latched fault of the whole board; 0: none.
    pub fault: u16,
    /// Its detail.
    pub fault_detail: u32,
    /// Whether the E-stop loop is closed.
    pub estop_closed: bool,
    /// Each unit.
    pub units: [UnitStatus; UNITS],
    /// Force of the six cables at the tip, from measured tensions and the directions of the last
    /// setpoints, in micronewton, robot base frame.
    pub tip_force_un: [i32; 3],
    /// Whether the alive line is withheld, so that the PLC removes the amplifiers' power.
    pub alive_withheld: bool,
    /// CRC-32 over the configuration in force, as encoded for the wire, zeros included.
    pub config_crc: u32,
    /// Age of the setpoints in force in milliseconds; 65,535: none.
    pub setpoint_age_ms: u16,
    /// Telemetry frames that this link's queue had no room for, since boot.
    pub frames_dropped: u32,
    /// Frames from the host that were damaged or unknown, since boot.
    pub frames_bad: u32,
    /// Bus recoveries since boot.
    pub bus_recoveries: u16,
    /// Part of the last second that the core slept, in thousandths.
    pub sleep_permille: u16,
    /// Most samples that waited for the superloop at once since the last status.
    pub queue_high_water: u8,
}

/// State of one unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct UnitStatus {
    /// `control::state::MotorState` as a number.
    pub state: u8,
    /// First latched fault; 0: none.
    pub fault: u16,
    /// Its detail.
    pub fault_detail: u32,
    /// Samples since boot.
    pub samples: u32,
    /// Conversions that were not read in time since boot.
    pub missed: u32,
    /// Spikes rejected since boot.
    pub spikes: u32,
    /// Reads of the converter that failed on the bus since boot. Each is repeated once.
    pub failed_reads: u16,
    /// Period of the converter in microseconds, averaged; 0: silent.
    pub period_us: u16,
    /// Cable tension after the filter, in micronewton.
    pub tension_un: i32,
    /// ADC code of the newest sample; 0: none since boot.
    pub adc_code: i32,
    /// Encoder position in counts, lowest 32 bits of the extended position. Read at least every 6
    /// ms, whether the load cell measures or not.
    pub encoder_counts: i32,
}

/// Samples of any units, in the order they were taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Batch {
    /// Board time of the first sample's DRDY edge in microseconds.
    pub t_us: u32,
    /// The samples.
    pub samples: Vec<Sample, BATCH>,
}

/// One sample and what the controller made of it: raw codes as the parts gave them, terms in 0.1
/// mN.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct Sample {
    /// Unit, from 0.
    pub unit: u8,
    /// DRDY edge, in microseconds after [`Batch::t_us`].
    pub dt_us: u16,
    /// ADC code.
    pub adc_code: i32,
    /// Encoder position in counts, lowest 32 bits of the extended position.
    pub encoder_counts: i32,
    /// DAC code that the controller computed from this sample.
    pub dac_code: u16,
    /// DRDY edge to the DAC word, in microseconds.
    pub latency_us: u16,
    /// Filtered cable tension in 0.1 mN.
    pub tension: i32,
    /// Setpoint in force (after its slew limit) in 0.1 mN.
    pub setpoint: i32,
    /// Proportional term in 0.1 mN.
    pub p: i32,
    /// Integral term in 0.1 mN.
    pub i: i32,
    /// Derivative and damping terms in 0.1 mN.
    pub d: i32,
    /// Feedforward (setpoint and friction) in 0.1 mN.
    pub ff: i32,
    /// Force at the tip after this sample, as the board computes it, in millinewton (65,535: more).
    pub tip_force_mn: u16,
    /// See [`flags`].
    pub flags: u8,
}

/// Bits of [`Sample::flags`].
pub mod flags {
    /// The spike gate replaced this sample.
    pub const SPIKE: u8 = 1;
    /// The command is at its upper limit: the force limit, or the authority over the friction
    /// model.
    pub const LIMITED: u8 = 2;
    /// The command is at its slew limit.
    pub const SLEWING: u8 = 4;
    /// The direction estimate is winding in.
    pub const WINDING_IN: u8 = 8;
    /// The direction estimate is paying out.
    pub const PAYING_OUT: u8 = 16;
    /// The output is allowed (the unit is running).
    pub const ACTIVE: u8 = 32;
    /// A conversion before this one was not read in time.
    pub const MISSED: u8 = 64;
    /// The command is at its lower limit: a motor pulls or does nothing.
    pub const AT_ZERO: u8 = 128;
    /// The command is at one of its limits.
    pub const AT_A_LIMIT: u8 = LIMITED | AT_ZERO;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_word_comes_first_and_its_highest_digit() {
        let digits = serial_number([0x0123_4567, 0x89AB_CDEF, 0x0000_000A]);
        assert_eq!(digits, "0123456789ABCDEF0000000A");
    }

    #[test]
    fn a_resistor_is_told_by_what_it_holds_against() {
        assert_eq!(Pull::of_levels(false, false), Pull::Down);
        assert_eq!(Pull::of_levels(true, false), Pull::None);
        assert_eq!(Pull::of_levels(true, true), Pull::Up);
    }
}
