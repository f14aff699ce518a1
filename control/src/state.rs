//! The states of a unit and of the board, with the numbers that travel on the wire. Stable: a
//! number is never given a second meaning.

/// A row: what the state is, its number on the wire, its name in messages.
macro_rules! states {
    ($($(#[$doc:meta])* $type:ident {
        $($(#[$state_doc:meta])* $state:ident = $number:literal, $name:literal;)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        #[repr(u8)]
        pub enum $type {
            $($(#[$state_doc])* $state = $number,)*
        }

        impl $type {
            /// Every state, in the order of the numbers.
            pub const ALL: [Self; [$($number),*].len()] = [$(Self::$state),*];

            /// From the wire's number.
            #[must_use]
            pub fn from_u8(number: u8) -> Option<Self> {
                Self::ALL.into_iter().find(|&state| state as u8 == number)
            }

            /// Name in messages.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$state => $name,)* }
            }

            /// Whether a DAC may stand at anything but 0 V.
            #[must_use]
            pub const fn drives(self) -> bool {
                matches!(self, Self::Running | Self::Stopping)
            }
        }
    )*};
}

states! {
    /// State of one force unit (thesis 3.6.2, MotorStateMachine).
    MotorState {
        /// Not configured, or switched off: takes no part, 0 V.
        #[default]
        Offline = 0, "offline";
        /// The converter is being powered, set up and calibrated; 0 V.
        BringUp = 1, "bring-up";
        /// Samples arrive, the output is not allowed; 0 V.
        Ready = 2, "ready";
        /// The controller acts.
        Running = 3, "running";
        /// A fault of the unit is latched; 0 V until it is cleared.
        Faulted = 4, "faulted";
        /// The zero is being averaged; 0 V.
        Zeroing = 5, "zeroing";
        /// The force is ramped down.
        Stopping = 6, "stopping";
    }

    /// State of the whole board (thesis 3.6.2, SystemStateMachine).
    SystemState {
        /// Clocks, pins, memory; nothing is known yet; 0 V.
        #[default]
        Boot = 0, "boot";
        /// At least one enabled unit is being brought up; 0 V.
        BringUp = 1, "bring-up";
        /// Every enabled unit has come up or failed; waiting for a command; 0 V.
        Ready = 2, "ready";
        /// Zeros are being averaged; 0 V.
        Zeroing = 3, "zeroing";
        /// Armed: the motors act on setpoints.
        Running = 4, "running";
        /// The torques are ramped down.
        Stopping = 5, "stopping";
        /// A fault of the board is latched; 0 V until it is cleared.
        Fault = 6, "fault";
    }
}
