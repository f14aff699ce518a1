//! The fault campaign: thousands of injections, one or two at a time, into an armed rig, and what came of each.
//!
//! What runs is the firmware's own code from the converter's code to the DAC's code: [`board::machine::Machine`] with the
//! crate `control`, frames through `wire`, on the plant that every emulator uses. What is left out is the processor: its
//! interrupts, its buses and the superloop are a delay and a millisecond's tick here ([`rig`]). The scenarios of
//! `tests/scenarios` inject into the whole image.
//!
//! | module | question |
//! | --- | --- |
//! | [`rig`] | what is the machine connected to |
//! | [`injection`] | what can be broken, and how is it drawn from a seed |
//! | [`case`] | one run: prepare, inject, watch |
//! | [`expected`] | which fault must an injection cause |
//! | [`watch`] | what does the truth show in each millisecond |
//! | [`outcome`] | what counts as detected, harmless, hazard |
//! | [`campaign`] | many cases: parallel, in shards, resumed, merged |
//! | [`table`] | the summary |
//! | [`random`] | numbers from a seed |

pub mod campaign;
pub mod case;
pub mod expected;
pub mod injection;
pub mod outcome;
pub mod random;
pub mod rig;
pub mod table;
pub mod watch;
