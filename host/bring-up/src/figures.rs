//! What each test measured. Units count from 0 in arrays; forces are those of the rig file's scale,
//! and not yet calibrated.

use serde::{Deserialize, Serialize};
use wire::message::Pull;
use wire::UNITS;

/// Everything that was measured so far. A test that has not run is `None`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Figures {
    /// What the board says of itself.
    pub board: Option<BoardFigures>,
    /// The converters at rest.
    pub converters: [Option<ConverterFigures>; UNITS],
    /// The E-stop, pressed and released.
    pub estop: Option<EStopFigures>,
    /// The amplifiers' power, with the alive line unplugged and with the E-stop pressed.
    pub power: Option<PowerFigures>,
    /// Cables that were pulled out by hand, one after the other.
    pub pulls: [Option<PullFigures>; UNITS],
    /// Known weights on the cables, one after the other.
    pub weights: [Option<WeightFigures>; UNITS],
    /// Pulses of the motors, one after the other.
    pub motors: [Option<MotorFigures>; UNITS],
    /// Cables that were taken up and loaded, one after the other.
    pub tension: [Option<TensionFigures>; UNITS],
}

/// What the board says of itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoardFigures {
    /// Version of the firmware.
    pub firmware: String,
    /// Whether the clock comes from the HSE input.
    pub hse: bool,
    /// Brown-out level of the option bytes, 0 to 3.
    pub brown_out_level: u8,
    /// What holds DAC_RST while the controller does not drive it.
    pub dac_reset_pull: Pull,
    /// Latched fault of the whole board; 0: none.
    pub fault: u16,
}

/// A converter at rest.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ConverterFigures {
    /// Latched fault of the unit, and its detail; 0: none.
    pub fault: u16,
    /// See [`Self::fault`].
    pub fault_detail: u32,
    /// Samples that arrived, and over which time, s.
    pub samples: u32,
    /// See [`Self::samples`].
    pub seconds: f64,
    /// Conversions that were not read in time.
    pub missed: u32,
    /// Spikes.
    pub spikes: u32,
    /// Reads that failed on the bus and were repeated.
    #[serde(default)]
    pub failed_reads: u16,
    /// Recoveries of the bus of all units.
    #[serde(default)]
    pub recoveries: u16,
    /// Mean code, and its standard deviation as a force, N.
    pub code: f64,
    /// See [`Self::code`].
    pub noise_n: f64,
    /// The strongest tone in the noise that stands out of it: frequency, Hz, and amplitude, N; both
    /// 0: none.
    #[serde(default)]
    pub tone_hz: f64,
    /// See [`Self::tone_hz`].
    #[serde(default)]
    pub tone_n: f64,
    /// Units that went silent while this converter was started anew.
    pub silenced: [bool; UNITS],
}

impl ConverterFigures {
    /// Whether the unit measures.
    #[must_use]
    pub fn works(&self) -> bool {
        self.fault == 0 && self.samples > 0
    }
}

/// The E-stop, pressed and released.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct EStopFigures {
    /// The loop was closed before.
    pub closed_before: bool,
    /// It was closed while the button was pressed.
    pub closed_pressed: bool,
    /// It was closed after the release.
    pub closed_released: bool,
    /// The alive line was withheld after the release with every unit ready.
    pub alive_withheld: bool,
}

/// The amplifiers' power. What a person did not look at is `None`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PowerFigures {
    /// The amplifiers showed power with everything in order.
    pub lit_ready: Option<bool>,
    /// The board withheld the alive line meanwhile: a unit was not ready.
    pub alive_withheld: Option<bool>,
    /// They showed power while the E-stop was pressed.
    pub lit_pressed: Option<bool>,
    /// They showed power while the alive line was unplugged.
    pub lit_unplugged: Option<bool>,
    /// The board's own loop of the E-stop was closed while the button was pressed.
    pub closed_pressed: Option<bool>,
    /// It was closed after the release.
    pub closed_released: Option<bool>,
    /// Pulses while the alive line was unplugged: nothing may move.
    pub unplugged: [Option<MotorFigures>; UNITS],
}

/// A cable that was pulled out by hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PullFigures {
    /// How far, m.
    pub travel_m: f64,
    /// Change of each encoder, counts.
    pub counts: [i32; UNITS],
    /// Strongest change of each load cell on the way, N, positive as the rig file has a pull.
    pub cell_n: [f64; UNITS],
}

/// A known weight on a cable.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WeightFigures {
    /// Its force, N.
    pub weight_n: f64,
    /// Change of each load cell, N.
    pub cell_n: [f64; UNITS],
}

/// Pulses of one motor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotorFigures {
    /// The pulses, rising.
    pub pulses: Vec<PulseFigures>,
    /// Why the board did not drive it, where it did not.
    pub refused: Option<String>,
    /// Fault of the board or of a unit that a pulse ended with, beside the expiry that ends each;
    /// 0: none.
    pub fault: u16,
}

/// One pulse.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PulseFigures {
    /// Commanded cable force, N.
    pub command_n: f64,
    /// Furthest travel of each encoder, m of cable, positive winding in by the rig file's sign.
    pub travel_m: [f64; UNITS],
    /// Strongest change of each load cell, N.
    pub cell_n: [f64; UNITS],
}

/// A cable that was taken up at limited speed, loaded slowly, and loaded by a chirp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TensionFigures {
    /// Cable that was wound in until it was tight, m.
    pub wound_m: f64,
    /// Whether it was loose at first.
    pub loose: bool,
    /// Whether it got tight.
    pub tight: bool,
    /// Fastest winding in on the way, m/s, over four samples.
    pub fastest_m_per_s: f64,
    /// Largest reading of the load cell, N.
    pub most_n: f64,
    /// Command that turned the reel slowly while its cable was slack, N; `None`: it was not slack
    /// long enough.
    pub idle_n: Option<f64>,
    /// How the reading follows the command; `None`: the cable was not loaded enough.
    pub line: Option<LoadLine>,
    /// Delay from the DAC's word to the load cell's code, s, as a chirp shows it.
    pub delay_s: Option<f64>,
    /// Why the board did not drive it, where it did not.
    pub refused: Option<String>,
    /// Fault of the board or of a unit that ended it; 0: none.
    pub fault: u16,
}

/// How the tension follows a command that winds in: tension = gain x (command - idle command).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LoadLine {
    /// Command that turns the reel slowly while its cable is slack, N.
    pub idle_n: f64,
    /// Command at the end of the load, N.
    pub command_n: f64,
    /// Reading of the load cell there, N.
    pub reading_n: f64,
}

impl LoadLine {
    /// Tension per commanded force above that of the idle reel.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.reading_n / (self.command_n - self.idle_n)
    }
}
