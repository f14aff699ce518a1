//! The fault campaign: thousands of injections, one or two at a time, into an armed rig, and what
//! came of each.
//!
//! What runs is `core-sim`: the firmware's machine, bus scheduler and control core on the host,
//! with the board's chips and the plant, brought up as every rig is, with a host on its serial
//! line. What is left out is the processor. The scenarios of `tests/scenarios` inject into the
//! whole image.
//!
//! | module | question |
//! | --- | --- |
//! | [`injection`] | what can be broken, and how is it drawn from a seed |
//! | [`rig`] | how is a rig brought up, armed and broken |
//! | [`host`] | what does the host send, and what becomes of it on the line |
//! | [`case`] | one run: prepare, inject, watch |
//! | [`expected`] | which fault must an injection cause |
//! | [`watch`] | what does the truth show in each millisecond |
//! | [`outcome`] | what counts as detected, harmless, hazard |
//! | [`campaign`] | many cases: parallel, in shards, resumed, merged |
//! | [`table`] | the summary |
//! | [`full_output`] | what an output that jumps to the end of its range does, by the amplifier's current limit |
//! | [`healthy`] | how often does a rig fault in which nothing is broken |
//! | [`random`] | numbers from a seed |

pub mod campaign;
pub mod case;
pub mod expected;
pub mod full_output;
pub mod healthy;
pub mod host;
pub mod injection;
pub mod outcome;
pub mod random;
pub mod rig;
pub mod table;
pub mod watch;
