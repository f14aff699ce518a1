//! Finds the effects that a rig file doesn't declare: excite, analyse, correct, compare.
//!
//! | step | file |
//! | --- | --- |
//! | drive the cables with open loops | `excite` |
//! | samples to rows | `recording` |
//! | what the rig file declares | `model` |
//! | friction that changes meanwhile | `drift` |
//! | analysis of each unit | `find` |
//! | findings to settings, settings to text | [`findings`] |
//! | errors of a run | `figures` |
//! | better or not, over pairs of runs | `gain`, `trial` |
//! | what is said of it | `report` |
//! | findings in logs, put into a rig file | `board_file` |
//! | the rig file replaced | `file` |
//!
//! # Why the loop is opened
//!
//! In the closed loop the command reacts to the disturbance that is searched for: friction that
//! lowers the tension raises the command, and a fit of tension over command sees the feedback as
//! much as the drive. So [`excite`] runs the board with all gains at zero and without feedforward:
//! the command is the setpoint, and nothing but the setpoint. A rig that would oscillate in closed
//! loop, such as one with a delay in the drive, does not oscillate here. The board's own
//! protections act as always: force limit, slew limits, over-tension, slack brake, expiring
//! setpoints, E-stop. The commands stay 1 N inside the tensions that the rig file allows, so no
//! friction that the board could compensate lets a cable go slack. Friction that is not compensated
//! pulls at the tip: near the rig file's force limit the commands swing less from then on, and
//! above the limit the host ends the session.
//!
//! # How effects are separated
//!
//! The robot has to move: reels that rest hold any force. Its path makes them turn both ways at
//! many speeds and through many angles. Each cable's command is a sum of five sines from 0.1 to 4
//! Hz, at frequencies of its own, so that load, speed, angle, time and the neighbours' loads are
//! uncorrelated.
//!
//! # Times
//!
//! A converter's value is 6.25 ms old when it is ready (sinc4, four conversions long).
//! [`Recording::rows`] takes command, travel and speed from that much earlier, and the command half
//! a sample later again, since the DAC holds it for one.

mod board_file;
mod drift;
mod excite;
mod figures;
mod file;
mod find;
pub mod findings;
mod gain;
mod model;
mod recording;
mod report;
#[cfg(test)]
mod tests;
mod trial;

pub use board_file::{Applied, BoardFile, BoardFileError};
pub use drift::FrictionChange;
pub use excite::{check, excite, SMALL_SWING};
pub use figures::Figures;
pub use file::{replace, write, FileError};
pub use find::{
    advice, doubted_cells, find, usable, DoubtedCell, FindError, Findings, UnitFinding,
    MAX_UNEXPLAINED,
};
pub use gain::{Gain, Pair, FEWEST_PAIRS, MOST_PAIRS};
pub use model::{model, MODEL};
pub use recording::{Recording, Row};
pub use trial::{clear_faults, hold, is_implausible, Held, HoldError, Left, Run, Trial, Weighed};
