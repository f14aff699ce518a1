//! The firmware of the force board: the superloop.
//!
//! Interrupts put each sample into a queue: EXTI records the time of the DRDY edge, and the bus
//! scheduler reads the converter over I2C1. The superloop processes the queue first, and again
//! before each other stage. Every stage is bounded. Then the core sleeps until an interrupt.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "board is firmware: build it with `cargo xtask build`, run it with `cargo xtask flash`."
    );
    eprintln!("Its pure half is tested on the host with `cargo test -p board`.");
    std::process::exit(2);
}

#[cfg(target_os = "none")]
#[allow(unsafe_code)] // the stack of the code that failed
mod fault_handlers;
#[cfg(target_os = "none")]
mod firmware;
#[cfg(target_os = "none")]
mod links;

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = firmware::Board::start();
    loop {
        board.samples(); // queue -> controller -> DAC word, for every queued sample
        board.outputs(); // words that are out -> telemetry with their latency
        board.samples();
        board.supervisor(); // once a millisecond: conditions, faults, alive line, watchdog, status
        board.samples();
        board.links(); // commands in, frames out
        board.sleep(); // until the next interrupt, unless a sample has come meanwhile
    }
}
