//! The force units by their index, and sets of them.

/// Force units of a board.
pub const UNITS: usize = 6;

/// Index of a force unit: never out of range. `as u8` and `as usize` give the number from 0 that
/// the messages carry.
#[allow(missing_docs)] // the units have no other names
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum UnitIndex {
    Unit1,
    Unit2,
    Unit3,
    Unit4,
    Unit5,
    Unit6,
}

impl UnitIndex {
    /// All units.
    pub const ALL: [Self; UNITS] = [
        Self::Unit1,
        Self::Unit2,
        Self::Unit3,
        Self::Unit4,
        Self::Unit5,
        Self::Unit6,
    ];

    /// From the number that a message carries, from 0.
    #[must_use]
    pub fn new(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number)).copied()
    }

    /// Each unit with its part of `items`.
    pub fn zip<I: IntoIterator>(items: I) -> impl Iterator<Item = (Self, I::Item)> {
        Self::ALL.into_iter().zip(items)
    }
}

/// Some of the units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UnitSet(u8);

impl UnitSet {
    /// Every unit.
    pub const ALL: Self = Self((1 << UNITS) - 1);

    /// From a mask: bit n is unit n. Other bits are dropped.
    #[must_use]
    pub const fn from_mask(mask: u8) -> Self {
        Self(mask & Self::ALL.0)
    }

    /// Whether a unit is among them.
    #[must_use]
    pub const fn contains(self, unit: UnitIndex) -> bool {
        self.0 & 1 << unit as u8 != 0
    }

    /// Adds a unit; whether it is new.
    pub const fn insert(&mut self, unit: UnitIndex) -> bool {
        let is_new = !self.contains(unit);
        self.0 |= 1 << unit as u8;
        is_new
    }

    /// Takes a unit out; whether it was in.
    pub const fn remove(&mut self, unit: UnitIndex) -> bool {
        let was_in = self.contains(unit);
        self.0 &= !(1 << unit as u8);
        was_in
    }

    /// Those that are in, in their order.
    pub fn iter(self) -> impl Iterator<Item = UnitIndex> {
        UnitIndex::ALL
            .into_iter()
            .filter(move |unit| self.contains(*unit))
    }
}

impl Extend<UnitIndex> for UnitSet {
    fn extend<I: IntoIterator<Item = UnitIndex>>(&mut self, units: I) {
        for unit in units {
            self.insert(unit);
        }
    }
}

impl FromIterator<UnitIndex> for UnitSet {
    fn from_iter<I: IntoIterator<Item = UnitIndex>>(units: I) -> Self {
        let mut set = Self::default();
        set.extend(units);
        set
    }
}
