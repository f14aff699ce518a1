//! Tests that run on the board itself; they are in `tests/board.rs`, one module and one boot
//! (defmt-test).
//!
//! They check what no emulator can: that the clocks, pins and chips of this board are those that
//! the firmware assumes. The amplifiers stay off: the alive line is never toggled, and the DACs'
//! RST is low or the DACs hold 0 V. Wiring: docs/wiring.md. How to run them: docs/bring-up.md.
#![no_std]
