//! Interface to the CPU engine: what the rig requires of the part that executes the firmware's
//! instructions.
//!
//! An engine runs the unmodified image, owns the controller's own peripherals, and calls the
//! [`crate::board::Board`] it was given for everything outside the package. Only [`rigless`] exists
//! today; nothing outside that module names it, so another engine is one more module.

pub mod rigless;

use emulator_link::{Forbidden, RegisterEvent};
use std::fmt;

/// Progress of an engine.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Progress {
    /// Virtual time since power-on, in nanoseconds.
    pub now_ns: u64,
    /// Instructions retired.
    pub instructions: u64,
    /// Virtual time that the core slept, in nanoseconds.
    pub asleep_ns: u64,
    /// Resets since power-on.
    pub resets: u32,
    /// What caused the last reset.
    pub last_reset: Option<String>,
}

/// The controller's memory, as a debug probe sees it.
pub trait Memory {
    /// Reads `length` bytes at `address`.
    ///
    /// # Errors
    /// There is no memory at the address.
    fn read(&mut self, address: u32, length: usize) -> Result<Vec<u8>, EngineError>;

    /// Writes `bytes` at `address`.
    ///
    /// # Errors
    /// There is no memory at the address.
    fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), EngineError>;
}

/// What a run does at each of its rows, with the row's time in nanoseconds. It is called where the
/// engine runs, so that a row costs no change of threads.
pub type AtRow = Box<dyn FnMut(u64, &mut dyn Memory) + Send>;

/// Code that takes the place of an exception's handler until the next reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trap {
    /// Raises the NMI, for which the engine has no line, and waits in a loop: the failed clock.
    Nmi,
    /// Makes an access that the MPU refuses.
    Forbidden(Forbidden),
    /// Flips one bit of a register of the interrupted code, once, and goes on in the handler.
    Flip(CoreBit),
}

/// A bit of a core register, at the next exception of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CoreBit {
    /// Number of the exception: 15 is SysTick, 16 + n interrupt n.
    pub exception: u8,
    /// 0 to 12, 13 SP, 14 LR, 15 PC, 16 xPSR.
    pub register: u8,
    /// 0 to 31.
    pub bit: u8,
}

/// Something that runs the firmware.
pub trait Engine: Send {
    /// Name of the machine and of the engine.
    fn name(&self) -> String;

    /// Runs from virtual time `from_ns` until `t_ns` and calls `at_row` at each whole multiple of
    /// `row_ns` on the way and at the end.
    ///
    /// # Errors
    /// The engine cannot go on.
    fn run_until(
        &mut self,
        from_ns: u64,
        t_ns: u64,
        row_ns: u64,
        at_row: AtRow,
    ) -> Result<Progress, EngineError>;

    /// Hangs the superloop when it takes the next samples; interrupts go on. A reset restores it.
    ///
    /// # Errors
    /// The image has no symbol of that function.
    fn hang(&mut self) -> Result<(), EngineError>;

    /// Lets the next SysTick, or the exception that it names, run into `trap`; a reset restores the
    /// image.
    ///
    /// # Errors
    /// The image cannot be changed.
    fn trap(&mut self, trap: Trap) -> Result<(), EngineError>;

    /// Resets the controller as a dip of the supply does.
    ///
    /// # Errors
    /// The engine cannot go on.
    fn brown_out(&mut self) -> Result<(), EngineError>;

    /// Flips `bit` (0 to 31) of the peripheral register at `address`.
    ///
    /// # Errors
    /// There is no register at the address, or none that can be changed.
    fn flip_register(&mut self, address: u32, bit: u8) -> Result<(), EngineError>;

    /// Flips `bit` (0 to 7) of the byte at `address`.
    ///
    /// # Errors
    /// There is no memory at the address.
    fn flip_bit(&mut self, address: u32, bit: u8) -> Result<(), EngineError>;

    /// Reads `length` bytes at `address`.
    ///
    /// # Errors
    /// There is no memory at the address.
    fn read_memory(&mut self, address: u32, length: usize) -> Result<Vec<u8>, EngineError>;

    /// Writes `bytes` at `address` in RAM.
    ///
    /// # Errors
    /// There is no memory at the address.
    fn write_memory(&mut self, address: u32, bytes: &[u8]) -> Result<(), EngineError>;

    /// Register accesses that the part refused or did not know.
    ///
    /// # Errors
    /// The engine cannot go on.
    fn register_events(&mut self) -> Result<Vec<RegisterEvent>, EngineError>;
}

/// Why an engine could not execute a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EngineError(
    /// What happened and what to do, for a person.
    pub String,
);

impl fmt::Display for EngineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for EngineError {}
