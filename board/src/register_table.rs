//! A table of registers that must keep their values, compared a few at a time.
//!
//! Pure: the caller reads the registers. `hw::registers` fills the table after start-up and
//! compares it each millisecond.
//!
//! Some registers are compared with each call, all others in turn. A turn takes [`TURN_CALLS`]
//! calls at most, however many registers there are.

use heapless::Vec;

/// Calls of [`Table::check`] in which every register was compared at least once.
pub const TURN_CALLS: usize = 50;

/// A register that must keep its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Address.
    pub address: u32,
    /// Bits that must keep their value.
    pub mask: u32,
    /// The value of these bits.
    pub value: u32,
}

impl Entry {
    /// Whether the register, which reads as `found`, has kept its value.
    #[must_use]
    pub const fn holds(&self, found: u32) -> bool {
        found & self.mask == self.value
    }

    /// The value to write where the register reads as `found`: the other bits stay.
    #[must_use]
    pub const fn restored(&self, found: u32) -> u32 {
        found & !self.mask | self.value
    }
}

/// The table has no room for another register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Full;

/// See the [module](self). Holds up to `N` registers.
#[derive(Debug, Clone, Default)]
pub struct Table<const N: usize> {
    /// Compared with each call.
    always: Vec<Entry, N>,
    /// Compared in turn.
    in_turn: Vec<Entry, N>,
    /// The next of the turn.
    next: usize,
    /// The register that differed last, until a whole turn has found none.
    differs: Option<u32>,
    /// Calls since then.
    calls: usize,
}

impl<const N: usize> Table<N> {
    /// An empty table.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            always: Vec::new(),
            in_turn: Vec::new(),
            next: 0,
            differs: None,
            calls: 0,
        }
    }

    /// Adds a register that each call compares.
    ///
    /// # Errors
    /// The table is full.
    pub fn add_always(&mut self, entry: Entry) -> Result<(), Full> {
        self.always.push(entry).map_err(|_| Full)
    }

    /// Adds a register that is compared in turn.
    ///
    /// # Errors
    /// The table is full.
    pub fn add(&mut self, entry: Entry) -> Result<(), Full> {
        self.in_turn.push(entry).map_err(|_| Full)
    }

    /// Every register of the table.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.always.iter().chain(&self.in_turn)
    }

    /// Compares the registers that are due. Returns the address of one that differs now.
    pub fn check(&mut self, read: impl Fn(u32) -> u32) -> Option<u32> {
        let changed = |entry: &&Entry| !entry.holds(read(entry.address));
        let due = self.in_turn.len().div_ceil(TURN_CALLS);
        let turn = self.in_turn.get(self.next..).unwrap_or(&[]);
        let found = self
            .always
            .iter()
            .chain(turn.iter().take(due))
            .find(changed)
            .map(|entry| entry.address);
        self.next += due;
        if self.next >= self.in_turn.len() {
            self.next = 0;
        }
        if found.is_some() {
            self.differs = found;
            self.calls = 0;
        } else if self.differs.is_some() {
            self.calls += 1;
            // A turn may have begun before the difference.
            if self.calls >= 2 * TURN_CALLS {
                self.differs = None;
            }
        }
        found
    }

    /// Address of the register that differed last. `None`: none has differed for two whole turns.
    #[must_use]
    pub const fn differs(&self) -> Option<u32> {
        self.differs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::collections::{BTreeMap, BTreeSet};

    const SIZE: usize = 160;

    /// `always` registers that each call compares, then `in_turn` others, at addresses 4 apart from
    /// 0x100, all at 0x55.
    fn table(always: u32, in_turn: u32) -> Table<SIZE> {
        let mut table = Table::default();
        let entry = |n: u32| Entry {
            address: 0x100 + 4 * n,
            mask: 0xFF,
            value: 0x55,
        };
        for n in 0..always {
            table.add_always(entry(n)).unwrap();
        }
        for n in always..always + in_turn {
            table.add(entry(n)).unwrap();
        }
        table
    }

    #[test]
    fn a_turn_compares_every_register_of_the_real_length() {
        for in_turn in [0, 1, 7, 49, 50, 51, 99, 113, 150] {
            let mut table = table(3, in_turn);
            let seen = RefCell::new(BTreeMap::<u32, usize>::new());
            for _ in 0..TURN_CALLS {
                let found = table.check(|address| {
                    *seen.borrow_mut().entry(address).or_default() += 1;
                    0x55
                });
                assert_eq!(found, None);
            }
            let seen = seen.into_inner();
            let expected: BTreeSet<u32> = (0..3 + in_turn).map(|n| 0x100 + 4 * n).collect();
            assert_eq!(seen.keys().copied().collect::<BTreeSet<_>>(), expected);
            assert!((0x100..0x10C)
                .step_by(4)
                .all(|address| seen[&address] == TURN_CALLS));
            // A few in each call, not all at once.
            let reads: usize = seen.values().sum();
            assert!(reads <= TURN_CALLS * (3 + in_turn as usize / TURN_CALLS + 1));
        }
    }

    #[test]
    fn bits_outside_the_mask_may_change_and_bits_inside_may_not() {
        let mut table = table(1, 10);
        for _ in 0..2 * TURN_CALLS {
            assert_eq!(table.check(|_| 0xABCD_0055), None);
        }
        for bit in 0..8 {
            let read = |address| 0x55 ^ u32::from(address == 0x100) << bit;
            assert_eq!(table.check(read), Some(0x100), "bit {bit}");
        }
    }

    #[test]
    fn a_difference_stands_until_two_whole_turns_find_none() {
        let mut table = table(2, 100);
        let last = 0x100 + 4 * 101;
        let found = (0..TURN_CALLS).find_map(|_| table.check(|at| 0x55 ^ u32::from(at == last)));
        assert_eq!(found, Some(last));
        for _ in 0..2 * TURN_CALLS - 1 {
            table.check(|_| 0x55);
            assert_eq!(table.differs(), Some(last));
        }
        table.check(|_| 0x55);
        assert_eq!(table.differs(), None);
    }

    #[test]
    fn what_is_restored_leaves_the_other_bits() {
        let entry = Entry {
            address: 0,
            mask: 0x0F0,
            value: 0x050,
        };
        assert_eq!(entry.restored(0xFFF), 0xF5F);
        assert!(entry.holds(entry.restored(0x123)));
    }

    #[test]
    fn a_full_table_says_so() {
        let entry = Entry {
            address: 0,
            mask: 1,
            value: 0,
        };
        let mut table = Table::<1>::default();
        assert_eq!(table.add(entry), Ok(()));
        assert_eq!(table.add(entry), Err(Full));
    }
}
