//! USB of the embedded rig: the controller's OTG core in device mode, and a host at the other end
//! of the cable.
//!
//! [`Core`] is the register model of the OTG_HS core with its full-speed transceiver (RM0433 rev 9
//! chapter 57, the second instance on the STM32H753). [`Host`] is a host controller with a USB
//! stack and the CDC-ACM class driver. It resets, addresses and configures the device, opens the
//! port and moves bytes. Both know only the manual and the USB 2.0 specification. The driver in the
//! firmware is what they test, so nothing here is derived from it.
//!
//! Time is virtual, in nanoseconds. Nothing here depends on the CPU engine: the engine passes
//! register accesses to [`Core::read`] and [`Core::write`], and calls [`Host::advance`] when
//! [`Host::next_event`] is due.

pub mod core;
pub mod host;

pub use self::core::Core;
pub use host::Host;
