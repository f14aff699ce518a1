//! What an interrupt and the superloop share without a lock: flags, requests, counts. One word
//! each, and each with one rule.
//!
//! `crate::atomics` gives the atomic types: the processor's in the firmware, loom's in
//! `tests/shared.rs`, which runs every interleaving of both sides. loom lets both sides run at
//! once; an interrupt is a case of that. What the two sides share under a lock (interrupts masked)
//! is not here: `hw::SamplePath`, the sender of `hw::usart`.

use crate::atomics::{AtomicBool, AtomicU32, Ordering};
use control::{UnitIndex, UnitSet};

/// A flag that the SysTick handler sets and the superloop takes. What the handler wrote before it,
/// the superloop sees after it has taken the flag. A superloop that is late finds one flag for
/// several ticks.
pub struct Tick(AtomicBool);

impl Tick {
    /// A tick in a cell, which holds `false`.
    pub const fn of(cell: AtomicBool) -> Self {
        Self(cell)
    }

    /// Sets it; the handler.
    pub fn set(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether it is set; the superloop.
    pub fn waits(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Takes it; the superloop.
    pub fn take(&self) -> bool {
        self.waits() && self.0.swap(false, Ordering::Acquire)
    }
}

/// Units to start and to stop, which the superloop asks for and the handler takes. Both are in one
/// word, so the handler sees the last request for each unit and never half of one.
pub struct Requests(AtomicU32);

impl Requests {
    /// Requests in a cell, which holds 0.
    pub const fn of(cell: AtomicU32) -> Self {
        Self(cell)
    }

    fn replace(&self, unit: UnitIndex, word: u32) {
        let both = 0x0001_0001 << unit as u32;
        let change = |present: u32| Some(present & !both | word << unit as u32);
        // The closure always returns a value.
        let _ = (self.0).fetch_update(Ordering::Relaxed, Ordering::Relaxed, change);
    }

    /// Asks to start this unit, and takes back a request to stop it; the superloop.
    pub fn start(&self, unit: UnitIndex) {
        self.replace(unit, 1);
    }

    /// Asks to stop this unit, and takes back a request to start it; the superloop.
    pub fn stop(&self, unit: UnitIndex) {
        self.replace(unit, 1 << 16);
    }

    /// Takes the units to start and those to stop; the handler. No unit is in both.
    pub fn take(&self) -> (UnitSet, UnitSet) {
        let word = self.0.swap(0, Ordering::Relaxed);
        (
            UnitSet::from_mask(word as u8),
            UnitSet::from_mask((word >> 16) as u8),
        )
    }
}

/// A setting that the superloop writes and the handler reads.
pub struct Setting(AtomicBool);

impl Setting {
    /// A setting in a cell.
    pub const fn of(cell: AtomicBool) -> Self {
        Self(cell)
    }

    /// Writes it; the superloop.
    pub fn set(&self, on: bool) {
        self.0.store(on, Ordering::Relaxed);
    }

    /// Reads it; the handler.
    pub fn get(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A word that handlers of one level write, and the superloop reads: a count, a time.
pub struct Word(AtomicU32);

impl Word {
    /// A word in a cell.
    pub const fn of(cell: AtomicU32) -> Self {
        Self(cell)
    }

    /// Adds 1; the handlers, which do not interrupt each other.
    pub fn count(&self) {
        self.set(self.get().wrapping_add(1));
    }

    /// Writes it; the handlers.
    pub fn set(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Reads it.
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A call of an interrupt that masks itself until the superloop has served its peripheral.
pub struct Call(AtomicBool);

impl Call {
    /// A call in a cell, which holds `false`.
    pub const fn of(cell: AtomicBool) -> Self {
        Self(cell)
    }

    /// The interrupt came; the handler. `mask` masks the interrupt.
    pub fn raise(&self, mask: impl FnOnce()) {
        mask();
        self.0.store(true, Ordering::Release);
    }

    /// The peripheral was served; the superloop. `unmask` unmasks the interrupt: only then may the
    /// next call come, or it would be forgotten here.
    pub fn served(&self, unmask: impl FnOnce()) {
        self.0.store(false, Ordering::Release);
        unmask();
    }

    /// Whether the peripheral is to be served; the superloop.
    pub fn waits(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}
