//! The lock-step link between a host program and the embedded rig.
//!
//! The rig is a process of its own (`rig`, package `emulator`): it boots the firmware image on the
//! emulated STM32H753 and then advances only on request. The host sends a [`Request`], the rig
//! sends exactly one [`Response`]; virtual time passes only inside [`Request::Advance`]. So a host
//! controller that runs at 100 Hz sees the same bytes at the same virtual times on every machine.
//!
//! On the pipe (rig's standard input and output) each message is a little-endian `u32` length
//! followed by that many bytes of postcard. The rig's log goes to its standard error. This link
//! carries what a lab has beside the board's own serial line: the robot's pose, the wall clock, and
//! actions by hand such as pulling a plug. The board's bytes pass through it unchanged (see the
//! crate `wire`).

use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};

/// Version of this link; both ends compare it in [`Response::Ready`].
pub const LINK_VERSION: u32 = 11;

/// Number of force units of the rig.
pub const UNITS: usize = 6;

/// Largest message that either end accepts, in bytes.
pub const MAX_MESSAGE: u32 = 16 << 20;

/// What the host requests from the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// First message; answered by [`Response::Ready`].
    Hello {
        /// The host's [`LINK_VERSION`].
        version: u32,
    },
    /// Put `to_board` on the board's receive line at its baud rate, then let `duration_ns` of
    /// virtual time pass; answered by [`Response::Advanced`]. A rig that was started with `--usb`
    /// sends the bytes through its USB socket instead; when the host there loses the device, the
    /// answer is [`Response::Unplugged`] once.
    Advance {
        /// Virtual time to pass, in nanoseconds.
        duration_ns: u64,
        /// Bytes for the board's USART3, or its USB port.
        to_board: Vec<u8>,
    },
    /// Start or stop the robot's random path (it ramps in and out smoothly); answered by
    /// [`Response::Done`].
    Robot {
        /// `true`: move; `false`: stop.
        moving: bool,
    },
    /// Inject a fault, or remove it; answered by [`Response::Done`].
    Inject(Injection),
    /// Ask for the run's figures and register report so far; answered by [`Response::Report`].
    Report,
    /// End the process; answered by [`Response::Done`].
    Quit,
}

/// An access that the MPU refuses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Forbidden {
    /// A push where the stack has grown to its end.
    Push,
    /// A read through a null pointer.
    NullRead,
    /// A write to the flash.
    FlashWrite,
    /// A jump into AXI SRAM.
    RunRam,
}

/// What can be done to the rig from outside. Units are numbered from 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Injection {
    /// Pull the sensor cable of a unit: no DRDY, no answer on the bus.
    UnplugSensor(u8),
    /// Plug it in again; the converter starts from power-on reset.
    PlugSensor(u8),
    /// The converter of a unit responds with NACK until [`Injection::PlugSensor`].
    Nack(u8),
    /// SDA is held low until SCL has been clocked nine times or the multiplexer has been reset.
    StuckSda,
    /// Press (`true`: loop open) or release the E-stop.
    EStop(bool),
    /// The ADC of a unit reports a single spike of this many codes on its next conversion.
    Spike(u8, i32),
    /// Pull on a unit's cable with this many newtons from outside (0 ends it).
    PullCable(u8, f64),
    /// Disconnect (`true`) or reconnect a unit's encoder: its counts stand still.
    FreezeEncoder(u8, bool),
    /// The 5 V of an LS7266R1 (1 to 3) dips: it starts anew, as after power-on.
    DipCounter(u8),
    /// Hang the superloop, with interrupts enabled: the watchdog has to find it.
    HangLoop,
    /// Flip one bit in RAM: address, bit.
    FlipBit(u32, u8),
    /// Open (`true`) or close an excitation wire of a unit's load cell: the bridge gives nothing,
    /// whatever the force.
    OpenBridge(u8, bool),
    /// The converter of a unit repeats its last result (`true`), with DRDY as usual.
    FrozenCode(u8, bool),
    /// Exchange (`true`) the two signal wires of a unit's load cell: a pull lowers the code.
    WrongSign(u8, bool),
    /// The DAC of a unit keeps its output (`true`), whatever is written and whatever its RST line
    /// does.
    StuckDac(u8, bool),
    /// Lock the DMA stream that feeds the board's USART3, as the part does without TRBUFF: it moves
    /// nothing until it is disabled and enabled again.
    StallUsart,
    /// Set the bus-error flag of the I2C controller without a cause, as the part may (ES0392: the
    /// transfer continues).
    BusError,
    /// A pulse of a microsecond on a unit's DRDY line, without a conversion.
    DrdyGlitch(u8),
    /// Hold SDA low (`true`) whatever is clocked or reset, or let go of it.
    HoldSda(bool),
    /// The multiplexer does not answer (`true`).
    MuteMux(bool),
    /// The calibrations of a unit's converter fail (`true`).
    CalibrationError(u8, bool),
    /// A unit's converter reports another revision (`true`).
    WrongRevision(u8, bool),
    /// A unit's amplifier gives no current (`true`).
    AmplifierOff(u8, bool),
    /// A unit's encoder counts the other way (`true`): its two signals are exchanged.
    ReverseEncoder(u8, bool),
    /// Invert the nth data bit from now on the I2C bus, in whichever direction it goes.
    FlipBusBit(u16),
    /// Invert this bit of the next word to a DAC, 15 is the first on the wire.
    FlipDacBit(u8),
    /// Converters latch their result when the register pointer is set to it (`true`), instead of
    /// when it is read. The datasheet lines at hand leave it open.
    LatchAtPointer(bool),
    /// DRDY rises at the end of a calibration and a start of conversions leaves it high (`true`).
    /// Left open by the datasheet too.
    KeepReady(bool),
    /// Converters convert without CS, and do not stop with it (`true`): published drivers never set
    /// it.
    FreeRun(bool),
    /// The six conversions that settle after a start come with DRDY (`true`). Sources differ.
    ReportUnsettled(bool),
    /// Converters show their revision after PUA only, and calibrate only once they have run for as
    /// long as published drivers let them (`true`).
    StartSlowly(bool),
    /// The next so many rising edges of a unit's DRDY line do not reach the controller.
    LoseDrdy(u8, u8),
    /// The ST-Link's clock stops (`true`), or comes back for the next start. The clock security
    /// system's NMI follows within a millisecond of the emulated board, where the part needs a
    /// microsecond.
    LoseClock(bool),
    /// The supply falls below the brown-out level and comes back: a reset that only RCC_RSR tells
    /// from others.
    BrownOut,
    /// The core makes an access that no code of the firmware makes and the MPU refuses.
    Forbidden(Forbidden),
    /// Flip one bit of a peripheral's register, as a write of the core: address of the word, bit.
    FlipRegister(u32, u8),
    /// Plug the USB cable in (`true`), or pull it.
    PlugUsb(bool),
    /// The USB host suspends the bus (`true`), or resumes it.
    SuspendUsb(bool),
    /// The USB host reads what the board sends (`true`), or stops reading.
    ReadUsb(bool),
    /// The SPI controller of the DACs stops (`true`): a word that is begun never ends. Its
    /// registers keep their values.
    StopSpi(bool),
    /// Flip one bit of a core register of the code that the next exception of this number
    /// interrupts: exception (15 is SysTick, 16 + n interrupt n), register (0 to 12, 13 SP, 14 LR,
    /// 15 PC, 16 xPSR), bit.
    FlipCore(u8, u8, u8),
    /// Exchange the plugs of two units' encoders, in place of an exchange before; a unit with
    /// itself: none.
    ExchangeEncoders(u8, u8),
    /// Exchange the cables of two units' motors, likewise.
    ExchangeMotors(u8, u8),
    /// Exchange the cables of two units' load cells, likewise: each converter with its DRDY line
    /// stays where it is.
    ExchangeCells(u8, u8),
    /// Exchange the DRDY lines of two units' converters, likewise.
    ExchangeDrdy(u8, u8),
    /// A unit's encoder has this many lines in place of 1,000.
    EncoderLines(u8, u16),
    /// A unit's amplifier gives this share of its current (1: in order; negative: the motor's wires
    /// are exchanged).
    AmplifierShare(u8, f64),
    /// A hand pulls so many millimetres of cable out of a unit at 50 mm/s, with 3 N; negative:
    /// winds them in by the reel.
    PullOut(u8, f64),
    /// A hand pulls the alive line's plug out at the PLC (`true`), or plugs it in.
    UnplugAlive(bool),
    /// The alive line is open on the board (`true`): its edges do not reach the PLC.
    OpenAlive(bool),
    /// The PLC's relay is bridged (`true`): the amplifiers have power whatever the PLC does.
    BridgeRelay(bool),
    /// The PLC's output is inverted (`true`).
    InvertRelay(bool),
    /// A unit's amplifier is fed past the relay (`true`).
    BypassRelay(u8, bool),
    /// The E-stop's contact at the PLC is bridged (`true`): the PLC sees a closed loop.
    BridgeEStopAtPlc(bool),
    /// The E-stop's contact at the board is bridged (`true`): the board sees a closed loop.
    BridgeEStop(bool),
    /// The board's E-stop input is inverted (`true`): closed when pressed.
    InvertEStop(bool),
    /// The LDAC pin of a unit's DAC has no wire (`true`): no word reaches its output.
    OpenLdac(u8, bool),
    /// The select wires of two units' DACs touch: a word for one reaches both. In place of a bridge
    /// before; a unit with itself: none.
    TieSelects(u8, u8),
    /// Exchange the cables of two units' converters at the multiplexer (SDA and SCL), in place of
    /// an exchange before; a unit with itself: none. DRDY lines and load cells stay.
    ExchangeChannels(u8, u8),
    /// A unit's load cell gives this share of its signal: one of another capacity.
    CellShare(u8, f64),
    /// Noise at a unit's load cell beside the converter's own, V/V, one standard deviation.
    CellNoise(u8, f64),
    /// A tone at a unit's load cell as its converter's filter gives it: amplitude, V/V, frequency,
    /// Hz.
    CellTone(u8, f64, f64),
    /// The DRDY wire of a unit is open (`true`): the controller sees it low.
    CutDrdy(u8, bool),
    /// Brown-out level in the option bytes from the next start on, 0 to 3.
    BrownOutLevel(u8),
    /// What holds DAC_RST while the controller does not drive it.
    DacResetPull(DacResetPull),
    /// Takes the tip off the robot, which stands, and hangs a weight of so many newtons on it, ring
    /// included: the cables alone carry it from now on.
    HangOnTip(f64),
}

/// What holds DAC_RST while the controller does not drive it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum DacResetPull {
    /// The pull-down of docs/wiring.md.
    #[default]
    Down,
    /// Nothing: the resistor is missing. The DACs read an open input as high.
    None,
    /// A resistor to 3.3 V.
    Up,
}

/// Response of the rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Response {
    /// The image is loaded and virtual time stands at zero.
    Ready {
        /// The rig's [`LINK_VERSION`].
        version: u32,
        /// Seed of everything random in this run.
        seed: u64,
        /// Name of the machine and of the engine that runs it.
        machine: String,
    },
    /// Virtual time has passed.
    Advanced(Advanced),
    /// The request was carried out.
    Done,
    /// Figures and register report.
    Report(Box<Report>),
    /// The request could not be carried out; the rig goes on.
    Failed(String),
    /// Virtual time has passed, and the board's USB device left the bus meanwhile: the host's port
    /// is gone until it is enumerated again.
    Unplugged,
}

/// What happened while virtual time passed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Advanced {
    /// Virtual time since power-on, in nanoseconds.
    pub now_ns: u64,
    /// Bytes that the board's USART3 sent, or its USB port.
    pub from_board: Vec<u8>,
    /// The robot's pose as its own controller reports it.
    pub pose: Pose,
    /// The plant's true state, one row per millisecond of the interval, the last one at `now_ns`.
    pub truth: Vec<Truth>,
    /// Resets of the board since power-on, with the cause of the last one where there was any.
    pub resets: u32,
}

/// Where the robot's tip is, in the robot's base frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Velocity in metres per second.
    pub velocity_m_s: [f64; 3],
}

/// The plant's true state at one instant: what no instrument of the rig sees directly.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Truth {
    /// Virtual time in nanoseconds.
    pub t_ns: u64,
    /// Tip position in metres, robot base frame.
    pub tip_m: [f64; 3],
    /// Force that the six cables apply to the tip, in newtons, robot base frame.
    pub tip_force_n: [f64; 3],
    /// Cable tensions in newtons.
    pub tension_n: [f64; UNITS],
    /// Reel speeds in radians per second, positive while winding in.
    pub reel_rad_s: [f64; UNITS],
    /// Voltages at the DAC outputs in volts.
    pub dac_v: [f64; UNITS],
    /// Whether the PLC gives the amplifiers their power.
    pub amplifier_on: bool,
}

/// Figures of a run, measured from outside the firmware, in virtual time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Report {
    /// Virtual time since power-on, in nanoseconds.
    pub now_ns: u64,
    /// Wall-clock time spent running, in nanoseconds.
    pub wall_ns: u64,
    /// Instructions retired.
    pub instructions: u64,
    /// Fraction of virtual time that the core slept in WFI or WFE.
    pub sleep_fraction: f64,
    /// One entry for each DAC update that answered a sample since the last [`Request::Report`], in
    /// the order they happened. At 1,920 a second, ask at least every two minutes: only the latest
    /// 262,144 are kept.
    pub latencies: Vec<Latency>,
    /// Conversions that became ready on a calibration, per unit.
    pub conversions: [u64; UNITS],
    /// Conversions that were read out whole before the next one was ready, per unit.
    pub conversions_read: [u64; UNITS],
    /// Mean frequency of the alive line in hertz, 0 before its second edge.
    pub alive_hz: f64,
    /// Register accesses that the emulated part refused or did not know, each once, with a count.
    pub register_events: Vec<RegisterEvent>,
    /// The stack since power-on, where the image names its stack.
    pub stack: Option<StackUse>,
}

/// How deep the stack was at most. Before the first instruction the rig fills the whole stack with
/// a pattern; what has lost it was used. Room that a function reserves below that and never writes
/// does not show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StackUse {
    /// Bytes from the stack's top to the deepest word that was written.
    pub used_bytes: u32,
    /// Bytes of the stack.
    pub size_bytes: u32,
}

/// The way of one sample from the DRDY edge to the motor, as virtual times in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Latency {
    /// Unit, from 1.
    pub unit: u8,
    /// Rising edge of DRDY.
    pub drdy_ns: u64,
    /// First START of the transaction(s) that serve this sample (the multiplexer's, if one was
    /// needed).
    pub bus_start_ns: u64,
    /// Last data byte of the conversion result is in the receive register.
    pub data_ns: u64,
    /// First DAC data word written to the SPI.
    pub dac_word_ns: u64,
    /// Rising LDAC edge that updated this unit's output.
    pub dac_update_ns: u64,
    /// Instructions retired between `data_ns` and `dac_word_ns`.
    pub instructions: u64,
    /// Whether a multiplexer write was part of it.
    pub mux_select: bool,
}

/// A register access that the emulated part refused or did not know.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RegisterEvent {
    /// Peripheral and register (`RCC.PLL1DIVR`) or an address.
    pub place: String,
    /// What was refused, in the emulated part's words.
    pub what: String,
    /// How often.
    pub count: u64,
}

/// Writes one message and flushes.
///
/// # Errors
/// Those of the writer; [`io::ErrorKind::InvalidData`] where the message exceeds [`MAX_MESSAGE`].
pub fn send<T: Serialize>(mut to: impl Write, message: &T) -> io::Result<()> {
    let bytes = postcard::to_stdvec(message).map_err(invalid)?;
    let length = u32::try_from(bytes.len())
        .ok()
        .filter(|n| *n <= MAX_MESSAGE);
    let length =
        length.ok_or_else(|| invalid(format!("message of {} bytes is too large", bytes.len())))?;
    to.write_all(&length.to_le_bytes())?;
    to.write_all(&bytes)?;
    to.flush()
}

/// Reads one message.
///
/// # Errors
/// Those of the reader ([`io::ErrorKind::UnexpectedEof`] where the other end is gone);
/// [`io::ErrorKind::InvalidData`] where the bytes are no message of this version.
pub fn receive<T: for<'de> Deserialize<'de>>(mut from: impl Read) -> io::Result<T> {
    let mut length = [0; 4];
    from.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > MAX_MESSAGE {
        return Err(invalid(format!(
            "message of {length} bytes announced; is the other end a rig?"
        )));
    }
    let mut bytes = vec![0; length as usize];
    from.read_exact(&mut bytes)?;
    postcard::from_bytes(&bytes).map_err(invalid)
}

fn invalid(error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_survive_the_pipe() {
        let request = Request::Advance {
            duration_ns: 10_000_000,
            to_board: vec![0, 1, 255],
        };
        let mut pipe = Vec::new();
        send(&mut pipe, &request).unwrap();
        send(&mut pipe, &Request::Inject(Injection::PullCable(3, 2.5))).unwrap();
        let mut reader = pipe.as_slice();
        assert_eq!(receive::<Request>(&mut reader).unwrap(), request);
        assert_eq!(
            receive::<Request>(&mut reader).unwrap(),
            Request::Inject(Injection::PullCable(3, 2.5))
        );
        assert_eq!(
            receive::<Request>(&mut reader).unwrap_err().kind(),
            io::ErrorKind::UnexpectedEof
        );
    }

    #[test]
    fn bytes_that_are_no_message_are_refused() {
        let error = receive::<Response>(b"GET / HTTP/1.1\r\n".as_slice()).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        assert!(
            error.to_string().contains("is the other end a rig?"),
            "{error}"
        );
    }
}
