//! The states of a unit and of the board, with the numbers that travel on the wire. Stable: a number is
//! never given a second meaning.

/// State of one force unit (thesis 3.6.2, MotorStateMachine).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum MotorState {
    /// Not configured, or switched off: takes no part, 0 V.
    #[default]
    Offline = 0,
    /// The converter is being powered, set up and calibrated; 0 V.
    BringUp = 1,
    /// Samples arrive, the output is not allowed; 0 V.
    Ready = 2,
    /// The controller acts.
    Running = 3,
    /// A fault of the unit is latched; 0 V until it is cleared.
    Faulted = 4,
    /// The zero is being averaged; 0 V.
    Zeroing = 5,
    /// The force is ramped down.
    Stopping = 6,
}

impl MotorState {
    /// Every state, in the order of the numbers.
    pub const ALL: [Self; 7] = [
        Self::Offline,
        Self::BringUp,
        Self::Ready,
        Self::Running,
        Self::Faulted,
        Self::Zeroing,
        Self::Stopping,
    ];

    /// From the wire's number.
    #[must_use]
    pub fn from_u8(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&state| state as u8 == number)
    }

    /// Name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Offline => "offline",
            Self::BringUp => "bring-up",
            Self::Ready => "ready",
            Self::Running => "running",
            Self::Faulted => "faulted",
            Self::Zeroing => "zeroing",
            Self::Stopping => "stopping",
        }
    }

    /// Whether the DAC may stand at anything but 0 V.
    #[must_use]
    pub const fn drives(self) -> bool {
        matches!(self, Self::Running | Self::Stopping)
    }
}

/// State of the whole board (thesis 3.6.2, SystemStateMachine).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum SystemState {
    /// Clocks, pins, memory; nothing is known yet; 0 V.
    #[default]
    Boot = 0,
    /// At least one enabled unit is being brought up; 0 V.
    BringUp = 1,
    /// Every enabled unit has come up or failed; waiting for a command; 0 V.
    Ready = 2,
    /// Zeros are being averaged; 0 V.
    Zeroing = 3,
    /// Armed: the motors act on setpoints.
    Running = 4,
    /// The torques are ramped down.
    Stopping = 5,
    /// A fault of the board is latched; 0 V until it is cleared.
    Fault = 6,
}

impl SystemState {
    /// Every state, in the order of the numbers.
    pub const ALL: [Self; 7] = [
        Self::Boot,
        Self::BringUp,
        Self::Ready,
        Self::Zeroing,
        Self::Running,
        Self::Stopping,
        Self::Fault,
    ];

    /// From the wire's number.
    #[must_use]
    pub fn from_u8(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&state| state as u8 == number)
    }

    /// Name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Boot => "boot",
            Self::BringUp => "bring-up",
            Self::Ready => "ready",
            Self::Zeroing => "zeroing",
            Self::Running => "running",
            Self::Stopping => "stopping",
            Self::Fault => "fault",
        }
    }

    /// Whether a DAC may stand at anything but 0 V.
    #[must_use]
    pub const fn drives(self) -> bool {
        matches!(self, Self::Running | Self::Stopping)
    }
}
