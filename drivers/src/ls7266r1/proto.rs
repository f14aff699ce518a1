//! The bus operations of each LS7266R1 procedure, without a bus.
//!
//! Each is an array of [`BusOp`] to perform in order on one chip; reads deliver their bytes in
//! order too.

use super::count::CounterValue;
use super::regs::{Axis, Cmr, Flags, Idr, Ior, QuadratureMode, Rld};

/// One cycle on the parallel bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BusOp {
    /// Write with C/D# high: the byte names its register.
    WriteControl(Axis, u8),
    /// Write with C/D# low: the next byte of PR.
    WriteData(Axis, u8),
    /// Read with C/D# high: FLAG.
    ReadFlags(Axis),
    /// Read with C/D# low: the next byte of OL.
    ReadData(Axis),
}

/// Snapshot and read of one counter: three bytes, for [`decode_counter`].
pub const fn read_counter(axis: Axis) -> [BusOp; 4] {
    [
        BusOp::WriteControl(axis, Rld::LATCH_FOR_READ.control_byte()),
        BusOp::ReadData(axis),
        BusOp::ReadData(axis),
        BusOp::ReadData(axis),
    ]
}

/// Snapshot of both counters at the same instant, then reads of X and of Y: six bytes, three for
/// each.
pub const READ_BOTH_COUNTERS: [BusOp; 7] = [
    BusOp::WriteControl(Axis::X, Rld::LATCH_FOR_READ.on_both_axes().control_byte()),
    BusOp::ReadData(Axis::X),
    BusOp::ReadData(Axis::X),
    BusOp::ReadData(Axis::X),
    BusOp::ReadData(Axis::Y),
    BusOp::ReadData(Axis::Y),
    BusOp::ReadData(Axis::Y),
];

/// Decodes the bytes of a counter read, low byte first.
pub const fn decode_counter(bytes: [u8; 3]) -> CounterValue {
    CounterValue::from_le_bytes(bytes)
}

/// Read of the flags: one byte, for [`decode_flags`].
pub const fn read_flags(axis: Axis) -> [BusOp; 1] {
    [BusOp::ReadFlags(axis)]
}

/// Decodes the byte of a flag read.
pub const fn decode_flags(byte: u8) -> Flags {
    Flags::from_bits(byte)
}

/// Sets a counter: three bytes into PR, low byte first, then PR to CNTR.
pub const fn load_counter(axis: Axis, value: CounterValue) -> [BusOp; 5] {
    let [low, middle, high] = value.to_le_bytes();
    [
        BusOp::WriteControl(axis, Rld::RESET_BYTE_POINTER.control_byte()),
        BusOp::WriteData(axis, low),
        BusOp::WriteData(axis, middle),
        BusOp::WriteData(axis, high),
        BusOp::WriteControl(axis, Rld::PRESET_TO_COUNTER.control_byte()),
    ]
}

/// Clears the sticky noise flag E.
pub const fn clear_noise_flag(axis: Axis) -> [BusOp; 1] {
    [BusOp::WriteControl(axis, Rld::RESET_ERROR.control_byte())]
}

/// Sets an axis up with the inputs still off: prescaler, mode, index. The count cannot move yet.
///
/// `prescaler` divides the filter clock by `prescaler + 1`; in quadrature the result must be at
/// least eight times the encoder's line frequency (datasheet, "Filter clock prescalers").
pub const fn configure(axis: Axis, mode: QuadratureMode, prescaler: u8) -> [BusOp; 6] {
    [
        BusOp::WriteControl(axis, Ior::INPUTS_OFF.control_byte()),
        BusOp::WriteControl(axis, Rld::RESET_BYTE_POINTER.control_byte()),
        BusOp::WriteData(axis, prescaler),
        BusOp::WriteControl(
            axis,
            Rld::PRESET_TO_PRESCALER
                .and(Rld::RESET_BYTE_POINTER)
                .control_byte(),
        ),
        BusOp::WriteControl(axis, Cmr::free_running(mode).control_byte()),
        BusOp::WriteControl(axis, Idr::DISABLED.control_byte()),
    ]
}

/// Clears count and flags and turns the inputs on.
pub const fn start(axis: Axis) -> [BusOp; 4] {
    [
        BusOp::WriteControl(axis, Rld::RESET_COUNTER.control_byte()),
        BusOp::WriteControl(axis, Rld::RESET_TOGGLES.control_byte()),
        BusOp::WriteControl(axis, Rld::RESET_ERROR.control_byte()),
        BusOp::WriteControl(axis, Ior::INPUTS_ON.control_byte()),
    ]
}

/// Values that exercise every data line and every bit of the counter in both states.
pub const SELF_TEST_PATTERNS: [CounterValue; 2] = [
    CounterValue::from_le_bytes([0xA5, 0x5A, 0xC3]),
    CounterValue::from_le_bytes([0x5A, 0xA5, 0x3C]),
];
