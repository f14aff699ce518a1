//! A whole run: prepare the rig, hold a force while the robot moves, disarm.
//!
//! | step, in its order | file |
//! | --- | --- |
//! | from the first argument to the last figure | `set_force` |
//! | what is asked for | `options` |
//! | what has to be true before anything is driven | `checks` |
//! | configure, bring up, zero, or keep the zeros; read back | `ready` |
//! | calibrate the load cells of an emulated rig | `calibrate` |
//! | arm, tension, hold at 100 Hz: here setpoints are computed and sent | `hold` |
//! | hold tensions instead of a force | `tension` |
//! | ramp down and disarm | `disarm` |
//! | a reel with more friction than is declared | `friction` |
//! | whether the run did what was commanded | `quality` |
//! | figures of all cycles, and the rows that are kept of them | `cycles` |
//! | figures, faults, losses | `outcome` |
//! | progress for the user | `phase` |
//! | why a run could not be done | `error` |
//!
//! [`set_force`] is what the command `forcectl set-force` calls, and the bench and the scenarios as
//! well: no terminal, no files, one link. After any failure the rig is disarmed as far as the link
//! allows. Setpoints expire on the board in every case.

mod calibrate;
mod checks;
mod cycles;
mod disarm;
mod error;
mod fault;
mod friction;
mod hold;
mod options;
mod outcome;
mod phase;
pub mod plot;
mod quality;
mod ready;
mod set_force;
mod tension;
#[cfg(test)]
mod tests;

pub use checks::{fresh_pose, require_feasible, tell_of};
pub use disarm::{make_safe, ramp_down_and_disarm};
pub use error::{ArgumentError, Fault, Infeasible, MovedZero, RunError, UnitLost};
pub use fault::RunFault;
pub use friction::tell_of_friction;
pub use options::{Options, Zeroing};
pub use outcome::{Ended, LatencyMs, Outcome};
pub use phase::{begin, connect, NoopObserver, Observer, Phase};
pub use quality::{Shortfall, ShortfallKind};
pub use ready::{ready_board, Prepared};
pub use set_force::{hold_force, set_force, Stopped};
pub use tension::{hold_tensions, HeldTensions, TensionOptions};
