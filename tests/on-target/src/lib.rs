//! Tests that run on the board itself; they are in `tests/board.rs`, one module and one boot (defmt-test).
//!
//! They ask what no emulator can answer: whether this board's clocks, pins and chips are what the firmware
//! takes them for. The amplifiers stay off: the alive line is never toggled, and the DACs' RST is low or the
//! DACs hold 0 V. Wiring and how to run: docs/bring-up.md.
#![no_std]
