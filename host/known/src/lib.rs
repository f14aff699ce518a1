//! What is known of a rig beside its rig file: calibrations, zeros, and how well its force is
//! known.
//!
//! | question | module |
//! | --- | --- |
//! | where are calibrations kept, which versions are there | [`store`] |
//! | what is a rig's calibration before anything was measured; how does it enter the rig file's settings | [`base`] |
//! | until when is it valid, what did checks with a known weight say | [`checks`] |
//! | which parts is a calibration of | [`serials`] |
//! | which zeros were measured, and when | [`zeros`] |
//! | how well is the force at the tip known | [`uncertainty`] |

pub mod base;
pub mod checks;
mod error;
pub mod serials;
pub mod store;
pub mod uncertainty;
pub mod zeros;

pub use error::{Result, StoreError};
pub use zeros::{state_folder, ZeroStore};

/// Today's date, UTC, `YYYY-MM-DD`.
#[must_use]
pub fn today() -> String {
    let now = humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string();
    now.chars().take(10).collect()
}
