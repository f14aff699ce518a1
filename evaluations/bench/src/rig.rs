//! Starts the embedded rig of a seed.

use host_cli::link::embedded::{EmbeddedRig, Programs};
use host_cli::link::EmbeddedOptions;

/// Starts it with the programs that xtask has built.
pub fn start(seed: u64) -> Result<EmbeddedRig, String> {
    let programs = Programs::from_environment().map_err(|error| error.to_string())?;
    let options = EmbeddedOptions {
        seed: Some(seed),
        ..EmbeddedOptions::default()
    };
    EmbeddedRig::start(&programs, &options).map_err(|error| error.to_string())
}
