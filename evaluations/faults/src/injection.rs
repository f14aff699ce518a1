//! What can be broken, and how it is drawn.

use crate::random::Random;
use control::config::Config;
use serde::{Deserialize, Serialize};

/// Rigs that cases begin from, each with its own plant and tensions.
pub const BASES: u64 = 8;

/// Bits of a DAC word from this one on ask for more than 14 N.
const HIGH_BIT: u8 = 12;

/// What a rig is doing when the first injection comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Phase {
    /// From power-on to the commit of the configuration.
    Boot,
    /// The converters are brought up.
    BringUp,
    /// Zeros are measured.
    Zeroing,
    /// The first second after arming.
    FirstSecond,
    /// Armed, after a second and a half.
    Holding,
    /// Stopped, cleared, armed again.
    Clear,
    /// Disarmed, a unit switched off and on again, armed.
    Reconfiguration,
}

impl Phase {
    /// All of them, and from how many milliseconds of each a case draws its beginning.
    pub const ALL: [(Self, u32); 7] = [
        (Self::Boot, 30),
        (Self::BringUp, 650),
        (Self::Zeroing, 900),
        (Self::FirstSecond, 1_000),
        (Self::Holding, 1),
        (Self::Clear, 500),
        (Self::Reconfiguration, 1_900),
    ];

    /// Draws one, and when in it: half of them hold.
    fn draw(r: &mut Random) -> (Self, u32) {
        let drawn = Self::ALL.get(r.below(14) as usize);
        let (phase, ms) = *drawn.unwrap_or(&(Self::Holding, 1));
        (phase, r.below(ms.into()) as u32)
    }
}

/// Where an injection acts: the rows of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Category {
    /// Load cell and converter.
    Sensor,
    /// Bits on the sensor bus, and its multiplexer.
    Bus,
    /// Words to the DACs, and the DACs.
    Dac,
    /// Amplifier and motor.
    Drive,
    /// Encoder.
    Encoder,
    /// Bytes of the host's frames.
    Link,
    /// When the host sends.
    Host,
    /// The superloop and its supply.
    Loop,
    /// Bits of the board's memory.
    Memory,
    /// Plant events: robot, E-stop.
    Plant,
}

impl Category {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Sensor,
        Self::Bus,
        Self::Dac,
        Self::Drive,
        Self::Encoder,
        Self::Link,
        Self::Host,
        Self::Loop,
        Self::Memory,
        Self::Plant,
    ];
}

/// One injection. Units are numbered from 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Injection {
    /// The bridge gives nothing.
    OpenBridge(usize),
    /// The converter repeats its last code.
    Frozen(usize),
    /// The signal wires are exchanged.
    WrongSign(usize),
    /// The cell reads this share of the force.
    Sensitivity(usize, f64),
    /// The cell reads this many newtons more.
    Offset(usize, f64),
    /// The cell's reading drifts by this many newtons a second.
    Drift(usize, f64),
    /// The converter stands at an end of its range (`true`: the upper).
    Saturated(usize, bool),
    /// No conversion any more.
    Silent(usize),
    /// Only one conversion in so many is seen.
    Missing(usize, u32),
    /// Every conversion is seen twice.
    Extra(usize),
    /// The converter's period is this many times its own; not drawn, for the expected faults only.
    Period(usize, f64),
    /// Spikes of this many newtons, one conversion in ten.
    Spikes(usize, f64),
    /// Noise of this many newtons SD.
    Noise(usize, f64),
    /// This bit of the code is inverted in so many reads.
    CodeBit(usize, u8, u32),
    /// This bit of the code is always set or never.
    CodeBitStuck(usize, u8, bool),
    /// Two units' codes are exchanged: the multiplexer connects another channel than was written.
    Exchanged(usize, usize),
    /// The nth data bit from now on the sensor bus is inverted: an address of the multiplexer, a
    /// register, a result.
    BusBit(u16),
    /// Reads of a unit fail.
    ReadsFail(usize),
    /// The bus is held: nothing is read, the scheduler reports it after its rounds of recovery.
    BusHeld,
    /// The multiplexer does not answer.
    MuxSilent,
    /// The DAC keeps its output.
    DacStuck(usize),
    /// This bit of so many DAC words is inverted.
    DacBit(usize, u8, u32),
    /// This bit of a unit's DAC words is always set or never.
    DacBitStuck(usize, u8, bool),
    /// The DAC jumps to the end of its range, pulling, and stays there.
    DacFull(usize),
    /// Words of a unit reach another unit's DAC.
    DacSelect(usize, usize),
    /// The SPI stops, and its RST line has no effect.
    DacLink,
    /// The amplifier is off.
    AmplifierOff(usize),
    /// The amplifier gives this share of the current.
    AmplifierGain(usize, f64),
    /// The motor turns the other way.
    Reversed(usize),
    /// The encoder stands still.
    EncoderFrozen(usize),
    /// The encoder counts the other way.
    EncoderReversed(usize),
    /// The encoder jumps by so many counts.
    EncoderJump(usize, i64),
    /// The counter's noise flag is set so often a second.
    EncoderNoise(usize, u32),
    /// This bit of so many frames of the host is inverted.
    FrameBit(u32, u32),
    /// So many frames are cut short.
    FrameCut(u32),
    /// So many old frames are sent again.
    Replay(u32),
    /// Random bytes between the frames.
    Garbage(u32),
    /// A setpoint out of its range, of this unit.
    SetpointRange(usize, i32),
    /// Setpoints of this many newtons more.
    SetpointOffset(f64),
    /// 1/cos of this factor.
    WrongCosine(usize, f64),
    /// All cables in one direction, as a wrong rig file has them.
    WrongDirections,
    /// The host stops.
    HostStops,
    /// The host pauses for so many milliseconds.
    HostPauses(u32),
    /// The host sends every so many milliseconds.
    HostSlow(u32),
    /// A stop command on the link that does not command.
    StopElsewhere,
    /// Another program connects on the other link and asks for the status, again and again.
    StatusElsewhere,
    /// The superloop hangs.
    Hang,
    /// A pass of the superloop takes so many microseconds.
    Overrun(u32),
    /// Events are lost.
    EventsLost,
    /// A register of the controller differs; not drawn, for the expected faults only.
    RegisterChanged,
    /// A reset of the controller without a cause that it knows.
    Reset,
    /// This bit of what was computed from a unit's configuration is inverted.
    ConfigBit(usize, u32),
    /// The robot moves.
    RobotMoves,
    /// The E-stop loop opens.
    EStop,
}

impl Injection {
    /// Where it acts.
    #[must_use]
    pub const fn category(&self) -> Category {
        use Injection as I;
        match self {
            I::OpenBridge(_)
            | I::Frozen(_)
            | I::WrongSign(_)
            | I::Sensitivity(..)
            | I::Offset(..)
            | I::Drift(..)
            | I::Saturated(..)
            | I::Silent(_)
            | I::Missing(..)
            | I::Extra(_)
            | I::Period(..)
            | I::Spikes(..)
            | I::Noise(..) => Category::Sensor,
            I::CodeBit(..)
            | I::CodeBitStuck(..)
            | I::Exchanged(..)
            | I::BusBit(_)
            | I::ReadsFail(_)
            | I::BusHeld
            | I::MuxSilent => Category::Bus,
            I::DacStuck(_)
            | I::DacBit(..)
            | I::DacBitStuck(..)
            | I::DacFull(_)
            | I::DacSelect(..)
            | I::DacLink => Category::Dac,
            I::AmplifierOff(_) | I::AmplifierGain(..) | I::Reversed(_) => Category::Drive,
            I::EncoderFrozen(_)
            | I::EncoderReversed(_)
            | I::EncoderJump(..)
            | I::EncoderNoise(..) => Category::Encoder,
            I::FrameBit(..)
            | I::FrameCut(_)
            | I::Replay(_)
            | I::Garbage(_)
            | I::SetpointRange(..)
            | I::SetpointOffset(_)
            | I::WrongCosine(..)
            | I::WrongDirections => Category::Link,
            I::HostStops
            | I::HostPauses(_)
            | I::HostSlow(_)
            | I::StopElsewhere
            | I::StatusElsewhere => Category::Host,
            I::Hang | I::Overrun(_) | I::EventsLost | I::RegisterChanged | I::Reset => {
                Category::Loop
            }
            I::ConfigBit(..) => Category::Memory,
            I::RobotMoves | I::EStop => Category::Plant,
        }
    }

    /// Draws one of a category.
    #[must_use]
    pub fn draw(category: Category, r: &mut Random) -> Self {
        let unit = r.below(6) as usize;
        let other = (unit + 1 + r.below(5) as usize) % 6;
        let often = [1, 2, 5, 20, 100, u32::MAX][r.below(6) as usize];
        let pick = |r: &mut Random, count| r.below(count);
        match category {
            Category::Sensor => match pick(r, 12) {
                0 => Self::OpenBridge(unit),
                1 => Self::Frozen(unit),
                2 => Self::WrongSign(unit),
                3 => Self::Sensitivity(unit, r.between(0.0, 2.0)),
                4 => Self::Offset(unit, r.between(-10.0, 10.0)),
                5 => Self::Drift(unit, r.between(-5.0, 5.0)),
                6 => Self::Saturated(unit, r.unit() < 0.5),
                7 => Self::Silent(unit),
                8 => Self::Missing(unit, 2 + r.below(4) as u32),
                9 => Self::Extra(unit),
                10 => Self::Spikes(unit, r.between(-20.0, 20.0)),
                _ => Self::Noise(unit, r.between(0.01, 1.0)),
            },
            Category::Bus => match pick(r, 12) {
                10..=11 => Self::BusBit(r.below(400) as u16),
                0..=3 => Self::CodeBit(unit, r.below(24) as u8, often),
                4..=5 => Self::CodeBitStuck(unit, r.below(24) as u8, r.unit() < 0.5),
                6 => Self::Exchanged(unit, other),
                7 => Self::ReadsFail(unit),
                8 => Self::BusHeld,
                _ => Self::MuxSilent,
            },
            Category::Dac => match pick(r, 12) {
                0..=1 => Self::DacStuck(unit),
                2..=5 => Self::DacBit(unit, r.below(16) as u8, 1 + r.below(3) as u32),
                6 => Self::DacSelect(unit, other),
                7 => Self::DacBit(unit, r.below(16) as u8, u32::MAX),
                8..=9 => Self::DacBitStuck(unit, r.below(16) as u8, r.unit() < 0.5),
                10 => Self::DacFull(unit),
                _ => Self::DacLink,
            },
            Category::Drive => match pick(r, 4) {
                0 => Self::AmplifierOff(unit),
                1..=2 => Self::AmplifierGain(unit, r.between(0.1, 1.5)),
                _ => Self::Reversed(unit),
            },
            Category::Encoder => match pick(r, 4) {
                0 => Self::EncoderFrozen(unit),
                1 => Self::EncoderReversed(unit),
                2 => Self::EncoderJump(unit, r.between(-20_000.0, 20_000.0) as i64),
                _ => Self::EncoderNoise(unit, 1 + r.below(20) as u32),
            },
            Category::Link => match pick(r, 11) {
                0..=3 => Self::FrameBit(r.below(800) as u32, often),
                4 => Self::FrameCut(often),
                5 => Self::Replay(often),
                6 => Self::Garbage(often),
                7 => Self::SetpointRange(unit, r.bits() as i32),
                8 => Self::SetpointOffset(r.between(-2.0, 3.0)),
                9 => Self::WrongDirections,
                _ => Self::WrongCosine(unit, r.between(1.0, 1.5)),
            },
            Category::Host => match pick(r, 5) {
                0 => Self::HostStops,
                1 => Self::HostPauses(20 + r.below(400) as u32),
                2 => Self::HostSlow(20 + r.below(200) as u32),
                3 => Self::StopElsewhere,
                _ => Self::StatusElsewhere,
            },
            Category::Loop => match pick(r, 4) {
                0 => Self::Hang,
                1 => Self::Overrun(200 + r.below(5_000) as u32),
                2 => Self::EventsLost,
                _ => Self::Reset,
            },
            Category::Memory => Self::ConfigBit(unit, r.below(Config::BITS.into()) as u32),
            Category::Plant => match pick(r, 2) {
                0 => Self::RobotMoves,
                _ => Self::EStop,
            },
        }
    }
}

/// What a case injects, and when: one thing, or a second one some time after the first, and whether
/// the host clears then.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Seed of the plant, 0 to [`BASES`] - 1.
    pub base: u64,
    /// What the rig does meanwhile, and for how many milliseconds before the first injection.
    pub phase: (Phase, u32),
    /// The first.
    pub first: Injection,
    /// The second, and how many milliseconds later.
    pub second: Option<(Injection, u32)>,
    /// The host clears all faults, goes on, and clears once more, so many milliseconds after the
    /// first injection.
    pub clear_ms: Option<u32>,
}

impl Plan {
    /// The plan of a case: the categories in turn, every third case a pair.
    #[must_use]
    pub fn draw(seed: u64, number: u64) -> Self {
        let mut r = Random::stream(seed, number);
        const CATEGORIES: u64 = Category::ALL.len() as u64;
        let category = |n: u64| Category::ALL[(n % CATEGORIES) as usize];
        let first = Injection::draw(category(number), &mut r);
        let second = (number / CATEGORIES % 3 == 2).then(|| {
            let other = category(r.below(CATEGORIES));
            (Injection::draw(other, &mut r), r.below(300) as u32)
        });
        Self {
            base: r.below(BASES),
            phase: Phase::draw(&mut r),
            first,
            second,
            clear_ms: (r.below(4) == 0).then(|| 300 + r.below(700) as u32),
        }
    }

    /// Whether the memory is hit, which may be seen only by the check of each second.
    #[must_use]
    pub fn hits_memory(&self) -> bool {
        let memory = |injection: &Injection| injection.category() == Category::Memory;
        memory(&self.first) || self.second.is_some_and(|(second, _)| memory(&second))
    }

    /// Whether an output stands at the end of its range, pulling: no sampling sees that before the
    /// cable does.
    #[must_use]
    pub fn has_full_output(&self) -> bool {
        let full = |injection: Injection| match injection {
            Injection::DacFull(_) => true,
            Injection::DacBit(_, bit, often) => bit >= HIGH_BIT && often > 1,
            Injection::DacBitStuck(_, bit, set) => set && (HIGH_BIT..15).contains(&bit),
            _ => false,
        };
        full(self.first) || self.second.is_some_and(|(second, _)| full(second))
    }

    /// Whether an output stands for less pull than a resting reel and its cable show: bit 9 is 1.8
    /// N, and the campaign counts from 1.5 N on (docs/safety.md, "A pull below 2 N at 0 V").
    #[must_use]
    pub fn has_small_pull(&self) -> bool {
        let small = |injection: Injection| match injection {
            Injection::DacBit(_, 9, often) => often > 1,
            Injection::DacBitStuck(_, 9, set) => set,
            _ => false,
        };
        small(self.first) || self.second.is_some_and(|(second, _)| small(second))
    }

    /// An injection into a rig that holds, and a second one so many milliseconds later.
    #[must_use]
    pub const fn holding(base: u64, first: Injection, second: Option<(Injection, u32)>) -> Self {
        Self {
            base,
            phase: (Phase::Holding, 0),
            first,
            second,
            clear_ms: None,
        }
    }
}
