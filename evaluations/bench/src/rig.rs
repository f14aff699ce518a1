//! Starts the embedded rig of a seed.

use session::link::embedded::{EmbeddedRig, Programs};
use session::link::EmbeddedOptions;

/// Starts it with the programs that xtask has built, as fast as it can be computed.
pub fn start(seed: u64) -> Result<EmbeddedRig, String> {
    with(seed, false)
}

/// The same, no faster than real time.
pub fn start_paced(seed: u64) -> Result<EmbeddedRig, String> {
    with(seed, true)
}

fn with(seed: u64, paced: bool) -> Result<EmbeddedRig, String> {
    let programs = Programs::from_environment().map_err(|error| error.to_string())?;
    let options = EmbeddedOptions {
        seed: Some(seed),
        paced,
        ..EmbeddedOptions::default()
    };
    EmbeddedRig::start(&programs, &options).map_err(|error| error.to_string())
}
