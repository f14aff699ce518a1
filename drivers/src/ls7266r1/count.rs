//! The 24-bit count and its extension to a position that doesn't wrap.

/// Contents of a 24-bit counter, 0 ..= 2^24 - 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CounterValue(u32);

impl CounterValue {
    /// Zero.
    pub const ZERO: Self = Self(0);
    /// Number of states, 2^24.
    pub const MODULUS: u32 = 1 << 24;

    /// Takes a count; `None` from 2^24 up.
    pub const fn new(count: u32) -> Option<Self> {
        if count < Self::MODULUS {
            Some(Self(count))
        } else {
            None
        }
    }

    /// Decodes the three bytes of OL, low byte first.
    pub const fn from_le_bytes(bytes: [u8; 3]) -> Self {
        Self(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], 0]))
    }

    /// Encodes for PR, low byte first.
    pub const fn to_le_bytes(self) -> [u8; 3] {
        let [low, middle, high, _] = self.0.to_le_bytes();
        [low, middle, high]
    }

    /// The count.
    pub const fn get(self) -> u32 {
        self.0
    }

    /// Counts moved since `earlier`, the short way round: -2^23 ..= 2^23 - 1. Right as long as the
    /// true movement was that small: 2097 motor turns of 4000 counts.
    pub const fn counts_since(self, earlier: Self) -> i32 {
        // Left-justify the difference so that the wrap of 24 bits becomes the wrap of 32, and shift
        // back arithmetically.
        ((self.0.wrapping_sub(earlier.0) << 8) as i32) >> 8
    }
}

/// Sense of the count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Direction {
    /// The position grows as the counter does.
    #[default]
    Normal,
    /// The position grows as the counter falls. The Raven's own software negates its counts.
    Negated,
}

/// Extends the 24-bit count to a 64-bit position in counts.
///
/// Feed it every reading. Two readings may be apart by less than 2^23 counts; at 320 readings a
/// second no motor comes near.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PositionTracker {
    last: Option<CounterValue>,
    position: i64,
    direction: Direction,
}

impl PositionTracker {
    /// Starts at position 0 with whatever the first reading is.
    pub const fn new(direction: Direction) -> Self {
        Self {
            last: None,
            position: 0,
            direction,
        }
    }

    /// Takes a reading and returns the position in counts.
    pub const fn update(&mut self, value: CounterValue) -> i64 {
        if let Some(last) = self.last {
            let moved = value.counts_since(last) as i64;
            // 2^63 counts are out of any motor's reach; wrapping only keeps the arithmetic free of
            // panics.
            self.position = match self.direction {
                Direction::Normal => self.position.wrapping_add(moved),
                Direction::Negated => self.position.wrapping_sub(moved),
            };
        }
        self.last = Some(value);
        self.position
    }

    /// The position in counts after the last reading.
    pub const fn position(&self) -> i64 {
        self.position
    }

    /// Declares the current place to be `position`.
    pub const fn set_position(&mut self, position: i64) {
        self.position = position;
    }

    /// The next reading counts from where it finds the counter, without a jump: after the counter
    /// was loaded, reset or out of sight.
    pub const fn forget_last(&mut self) {
        self.last = None;
    }
}
