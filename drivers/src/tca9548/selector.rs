//! Bookkeeping of the mux's channel mask, without a bus.

/// 7-bit address, 0x70 ..= 0x77 by the straps A2..A0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Address(u8);

impl Address {
    /// All straps low: 0x70.
    pub const DEFAULT: Self = Self(0x70);

    /// From the strap levels, A2 in bit 2; `None` above 7.
    pub const fn from_straps(straps: u8) -> Option<Self> {
        if straps < 8 {
            Some(Self(0x70 | straps))
        } else {
            None
        }
    }

    /// The address as it goes to the bus.
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// A set of channels, bit n = channel n; also the control byte itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChannelMask(u8);

impl ChannelMask {
    /// No channel: the state after power-on and reset.
    pub const NONE: Self = Self(0);

    /// One channel; `None` above 7.
    pub const fn single(channel: u8) -> Option<Self> {
        if channel < 8 {
            Some(Self(1 << channel))
        } else {
            None
        }
    }

    /// Any set of channels.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// The control byte.
    pub const fn bits(self) -> u8 {
        self.0
    }
}

/// What is known of the control register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MuxState {
    /// Nothing: at start, after a reset, and after any transaction that failed, on the mux or
    /// behind it.
    Unknown,
    /// The last write was acknowledged and nothing has failed since.
    Known(ChannelMask),
}

/// The mux returned another mask than was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReadBackError {
    /// Mask that was written.
    pub expected: ChannelMask,
    /// Mask that was read.
    pub found: ChannelMask,
}

impl core::fmt::Display for ReadBackError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "TCA9548A control register: wrote 0x{:02X}, read back 0x{:02X}; check the bus for noise and the address straps",
            self.expected.0, self.found.0
        )
    }
}

impl core::error::Error for ReadBackError {}

/// Decides when the mask has to be written, and remembers what is in force.
///
/// The owner of the bus calls [`Selector::request`] before each transaction behind the mux, sends
/// the byte if there is one, and reports with [`Selector::written`]. Whatever fails on the bus, at
/// the mux or behind it, is reported with [`Selector::invalidate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Selector {
    state: MuxState,
}

impl Selector {
    /// Starts from [`MuxState::Unknown`]: after a warm start of the processor the mux still holds
    /// its mask.
    pub const fn new() -> Self {
        Self {
            state: MuxState::Unknown,
        }
    }

    /// What is known of the control register.
    pub const fn state(&self) -> MuxState {
        self.state
    }

    /// The byte to write for `mask`, or `None` if it is in force already.
    ///
    /// Once a byte is handed out the state is [`MuxState::Unknown`] until [`Self::written`]: the
    /// write may reach the part and still fail.
    #[must_use = "the byte has to be written before the channel can be used"]
    pub fn request(&mut self, mask: ChannelMask) -> Option<[u8; 1]> {
        if self.state == MuxState::Known(mask) {
            return None;
        }
        self.state = MuxState::Unknown;
        Some([mask.0])
    }

    /// The write of `mask` was acknowledged and its STOP is out.
    pub fn written(&mut self, mask: ChannelMask) {
        self.state = MuxState::Known(mask);
    }

    /// Something failed on the bus, or the part was reset.
    pub fn invalidate(&mut self) {
        self.state = MuxState::Unknown;
    }

    /// Compares a byte read from the part with what was written; on a difference the state is
    /// unknown.
    ///
    /// # Errors
    /// [`ReadBackError`] if they differ.
    pub fn check_read_back(
        &mut self,
        expected: ChannelMask,
        found: u8,
    ) -> Result<(), ReadBackError> {
        let found = ChannelMask(found);
        if found == expected {
            self.state = MuxState::Known(expected);
            Ok(())
        } else {
            self.state = MuxState::Unknown;
            Err(ReadBackError { expected, found })
        }
    }
}

impl Default for Selector {
    fn default() -> Self {
        Self::new()
    }
}
