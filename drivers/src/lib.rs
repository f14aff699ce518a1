//! Register-level drivers for the four parts of the force board: the NAU7802 bridge converter, the
//! TCA9548A I2C multiplexer, the DAC7731 output converter and the LS7266R1 quadrature counter.
//!
//! # Two layers, one logic
//! The board's sample path is driven by interrupts and may never block, while tests and bring-up
//! tools are simplest as blocking code. So each device comes in two layers:
//!
//! 1. a **sans-IO protocol layer**: constants, `const fn`s and state machines that say which bytes
//!    go out, how many come back and what they mean. It owns no bus and never waits.
//! 2. a **blocking driver** on embedded-hal 1.0 traits that only executes the operations of the
//!    first layer.
//!
//! | device | protocol layer | blocking driver |
//! |---|---|---|
//! | [`nau7802`] | [`nau7802::proto`], [`nau7802::Bringup`], [`nau7802::fast_read`] | [`nau7802::Nau7802`] |
//! | [`tca9548`] | [`tca9548::Selector`], [`tca9548::recovery`] | [`tca9548::Tca9548`] |
//! | [`dac7731`] | [`dac7731::DacCode`] | [`dac7731::Dac7731`] |
//! | [`ls7266r1`] | [`ls7266r1::proto`], [`ls7266r1::PositionTracker`] | [`ls7266r1::Ls7266r1`] |
//!
//! # Codes own their scale
//! [`nau7802::AdcCode`], [`dac7731::DacCode`] and [`ls7266r1::CounterValue`] are newtypes that
//! cannot hold a value the part cannot produce; conversion to volts is theirs. No bare integer
//! leaves here.
//!
//! # Errors
//! Each error names the register or line and the operation, and has a numeric `detail()` that
//! firmware can put into a fault record as it is.
//!
//! # Features
//! `defmt`: derives `defmt::Format` on error and state types.
#![no_std]

/// An enum whose numbers and texts stand in one table: a row is what it is, its number, its text.
macro_rules! numbered {
    ($(#[$meta:meta])* $type:ident, $(#[$text_doc:meta])* $text:ident {
        $($(#[$doc:meta])* $variant:ident = $number:literal, $words:literal;)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[repr(u8)]
        pub enum $type {
            $($(#[$doc])* $variant = $number,)*
        }

        impl $type {
            /// Each one, in the order of the table.
            pub const ALL: [Self; [$($number),*].len()] = [$(Self::$variant),*];

            $(#[$text_doc])*
            pub const fn $text(self) -> &'static str {
                match self { $(Self::$variant => $words,)* }
            }
        }
    };
}

pub mod dac7731;
pub mod ls7266r1;
pub mod nau7802;
pub mod tca9548;
