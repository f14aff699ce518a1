//! The model files of the rig's data.

use crate::data::Data;
use residual::spec::Spec;
use residual::Error;

/// Records of one unit pulling a force gauge, all rows.
pub const GAUGE_ALL: &str = include_str!("../models/gauge-all.toml");
/// The same, rows in motion.
pub const GAUGE_MOVING: &str = include_str!("../models/gauge-moving.toml");
/// The same in the original layout.
pub const GAUGE_ORIGINAL: &str = include_str!("../models/gauge-original.toml");
/// Closed-loop runs.
pub const CLOSED_LOOP: &str = include_str!("../models/closed-loop.toml");

/// A gauge model for the layout found; `sequences` is an expression that chooses the records by
/// `comp`, the level of compensation.
///
/// # Errors
/// [`Error::Model`] or [`Error::Expression`].
pub fn gauge(data: &Data, text: &str, sequences: &str) -> Result<Spec, Error> {
    let mut spec = Spec::parse(text)?;
    spec.rows.sequences = sequences.into();
    if data.original {
        spec.input = Spec::parse(GAUGE_ORIGINAL)?.input;
        spec.rows.sequences = format!("({sequences}) && viscous == 0");
    }
    Ok(spec)
}
