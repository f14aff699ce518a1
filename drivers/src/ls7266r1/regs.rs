//! The LS7266R1 register map as types (datasheet 7266R1, "Register description").

/// One of the two counters of a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Axis {
    /// X/Y# input low.
    X = 0,
    /// X/Y# input high.
    Y = 1,
}

/// Bit 7 of a control byte: the write reaches both axes, whatever the X/Y# input.
const BOTH_AXES: u8 = 0x80;

/// Defines a control register: its select bits, and `on_both_axes`.
macro_rules! control_register {
    ($(#[$meta:meta])* $name:ident, $select:literal) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name(u8);

        impl $name {
            /// Bits 6:5 that select the register.
            pub const SELECT: u8 = $select;

            /// The control byte as it goes on the bus.
            pub const fn control_byte(self) -> u8 {
                self.0
            }

            /// The same for both axes at once.
            #[must_use]
            pub const fn on_both_axes(self) -> Self {
                Self(self.0 | BOTH_AXES)
            }
        }
    };
}

control_register! {
    /// RLD, reset and load decoder: commands, not a setting. One of each field may go in one write:
    /// byte pointer (bit 0), resets (bits 2:1), transfers (bits 4:3).
    Rld, 0x00
}

impl Rld {
    /// Resets the byte pointer of PR and OL. Needed before every multi-byte access.
    pub const RESET_BYTE_POINTER: Self = Self(0x01);
    /// CNTR to zero.
    pub const RESET_COUNTER: Self = Self(0x02);
    /// Flags BT, CT, CPT and S to zero.
    pub const RESET_TOGGLES: Self = Self(0x04);
    /// Noise flag E to zero: the only way to clear it.
    pub const RESET_ERROR: Self = Self(0x06);
    /// PR to CNTR: the only way to set the counter.
    pub const PRESET_TO_COUNTER: Self = Self(0x08);
    /// CNTR to OL: a snapshot that doesn't disturb the counting.
    pub const COUNTER_TO_LATCH: Self = Self(0x10);
    /// Low byte of PR to the filter clock prescaler PSC.
    pub const PRESET_TO_PRESCALER: Self = Self(0x18);
    /// Latch and reset of the byte pointer in one write, 0x11: the start of every counter read.
    pub const LATCH_FOR_READ: Self = Self::COUNTER_TO_LATCH.and(Self::RESET_BYTE_POINTER);

    /// Combines commands of different fields. Commands of the same field don't combine.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// How the A and B inputs are counted (CMR bits 4:3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum QuadratureMode {
    /// A counts, B is the direction.
    NonQuadrature = 0,
    /// One count an encoder line.
    X1 = 1,
    /// Two counts an encoder line.
    X2 = 2,
    /// Four counts an encoder line.
    X4 = 3,
}

control_register! {
    /// CMR, counter mode.
    Cmr, 0x20
}

impl Cmr {
    /// Binary, free-running ("normal") count in the given mode: 0x38 for x4.
    pub const fn free_running(mode: QuadratureMode) -> Self {
        Self(Self::SELECT | ((mode as u8) << 3))
    }
}

control_register! {
    /// IOR, input and output control.
    Ior, 0x40
}

impl Ior {
    /// A and B disabled: the count stands still.
    pub const INPUTS_OFF: Self = Self(Self::SELECT);
    /// A and B enabled; the LCNTR/LOL pin loads CNTR, the RCNTR/ABG pin resets CNTR: **tie both
    /// high** (inactive) on the board, or a glitch there moves the count. FLG pins give carry and
    /// borrow.
    pub const INPUTS_ON: Self = Self(Self::SELECT | 0x01);
}

control_register! {
    /// IDR, index control.
    Idr, 0x60
}

impl Idr {
    /// Index input without function.
    pub const DISABLED: Self = Self(Self::SELECT);
}

/// FLAG, read at the control address.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Flags(u8);

impl Flags {
    /// Takes the byte as it stands on the bus; bit 7 is always 0 in the part and ignored here.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 0x7F)
    }

    /// The byte.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// BT: toggles at each underflow of CNTR.
    pub const fn borrow_toggle(self) -> bool {
        self.0 & 0x01 != 0
    }

    /// CT: toggles at each overflow of CNTR.
    pub const fn carry_toggle(self) -> bool {
        self.0 & 0x02 != 0
    }

    /// CPT: toggles each time PR equals CNTR.
    pub const fn compare_toggle(self) -> bool {
        self.0 & 0x04 != 0
    }

    /// S: set at an underflow, cleared at an overflow.
    pub const fn sign(self) -> bool {
        self.0 & 0x08 != 0
    }

    /// E: noise at the inputs, wide enough to pass the filter. Sticky; not a proof of a wrong
    /// count.
    pub const fn noise(self) -> bool {
        self.0 & 0x10 != 0
    }

    /// U/D: counting up.
    pub const fn counting_up(self) -> bool {
        self.0 & 0x20 != 0
    }

    /// IDX: the index input is active.
    pub const fn index(self) -> bool {
        self.0 & 0x40 != 0
    }
}
