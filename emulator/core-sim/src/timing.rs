//! Delays that stand in for the controller's instructions and interrupts.
//!
//! The bits on the buses take the time that they take on the part. The two delays of the core are
//! the embedded rig's, which counts 4 ns for an instruction: `cargo xtask bench` prints that rig's
//! latencies, `forcectl set-force 0 2.5 0 --link fast` the ones here.

/// A bit on the I2C bus at 400 kHz, ns.
pub const I2C_BIT_NS: u64 = 2_500;

/// From the end of a converter's edge to the START on the bus, and from the STOP of one transaction
/// to the START of the next: interrupt entry and scheduler, ns.
pub const HANDLER_NS: u64 = 1_500;

/// From the STOP of the read to the LDAC edge of the DAC: queue, control core, SPI word, ns.
pub const SAMPLE_TO_DAC_NS: u64 = 6_000;

/// A byte on USART3: ten bits at 2 Mbaud, ns.
pub const SERIAL_BYTE_NS: u64 = 5_000;

/// Period of the superloop's supervisor and of the alive line, ns.
pub const TICK_NS: u64 = 1_000_000;

/// After so long without a pass of the superloop the watchdog resets the controller, ns.
pub const WATCHDOG_NS: u64 = 50_000_000;

/// Duration of an I2C transaction: START, addresses and bytes with their acknowledge bits, STOP.
#[must_use]
pub const fn transfer_ns(write_len: u8, read_len: u8) -> u64 {
    let mut bits = 2;
    if write_len > 0 {
        bits += 9 * (1 + write_len as u64);
    }
    if read_len > 0 {
        bits += 9 * (1 + read_len as u64);
    }
    bits * I2C_BIT_NS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_takes_the_time_that_the_bus_scheduler_counts_with() {
        // board::bus: "a sample then needs 92 us on the bus": three bytes with the pointer set
        // beforehand.
        assert_eq!(transfer_ns(0, 3), 95_000);
        // One byte written: the select of the multiplexer.
        assert_eq!(transfer_ns(1, 0), 50_000);
    }
}
