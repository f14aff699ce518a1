//! From the findings of an analysis to a rig file that compensates them.
//!
//! [`correct`] turns the findings on one unit into its new settings, within bounds; [`rewrite`]
//! puts new settings into the text of a rig file, comments and layout kept. What the board can use:
//!
//! | finding | setting |
//! | --- | --- |
//! | dry friction, with its share of load | `coulomb_n`, `coulomb_per_n` |
//! | viscous friction | `viscous_n_s_per_m` |
//! | offset | `friction_offset_n` |
//! | gain | `dac_codes_per_n` where the log's command is the DAC's, else `friction_gain` |
//! | ripple over the angle | `ripple_...`, where the log's angle is the board's own |
//! | delay of the drive | `kp`, `ki_per_s`, `leaky_ki_per_s`, `damping_n_s_per_m`, reduced: see [`gains_for_delay`] |
//!
//! Dry friction is declared as it was found. With 0.1 N less, the tensions are 11 % further off:
//! 0.0340 N in place of 0.0306 N, and 0.0377 N in place of 0.0330 N with 0.4 N more friction in the
//! plant (24 seeds; `tension_loop` example of `control`, `seconds=20 seeds=24 coulomb=0.809` and
//! `0.909`; with `more_coulomb=0.4` `1.209` and `1.309`).
//!
//! Where one finding is out of its bounds, the unit keeps its settings: the numbers of one fit
//! belong together, and a part of them may be worse than none.

mod advice;
mod correct;
mod rewrite;
mod ripples;

pub use advice::{is_of_cell, without_setting};
pub use correct::{correct, gains_for_delay, slowed, Corrected, Frame};
pub use rewrite::{rewrite, Rewritten};
pub use ripples::merge_ripples;

use rig::UnitSettings;

/// A setting that a finding may change.
struct Key {
    /// Name in the rig file.
    name: &'static str,
    /// One over the smallest step that is written.
    digits: f64,
    get: fn(&UnitSettings) -> f64,
    set: fn(&mut UnitSettings, f64),
}

macro_rules! keys {
    ($($name:literal, $digits:literal, $($field:tt).+ $([$n:literal] . $part:ident)?;)*) => {
        [$(Key {
            name: $name,
            digits: $digits,
            get: |u| u.$($field).+$([$n].$part)?,
            set: |u, x| u.$($field).+$([$n].$part)? = x,
        },)*]
    };
}

/// Every setting that a finding may change. Four digits after the point are finer than anything
/// measured; lengths, codes and gains have their own.
const KEYS: [Key; 18] = keys! {
    "kp", 1e4, kp;
    "ki_per_s", 1e4, ki_per_s;
    "leaky_ki_per_s", 1e4, leaky_ki_per_s;
    "damping_n_s_per_m", 1e3, damping_n_s_per_m;
    "friction_offset_n", 1e4, friction_offset_n;
    "friction_gain", 1e4, friction_gain;
    "coulomb_n", 1e4, coulomb_n;
    "coulomb_per_n", 1e4, coulomb_per_n;
    "dac_codes_per_n", 1e3, dac_codes_per_n;
    "viscous_n_s_per_m", 1e3, viscous_n_s_per_m;
    "ripple_period_m", 1e7, ripples[0].period_m;
    "ripple_amplitude_n", 1e4, ripples[0].amplitude_n;
    "ripple_amplitude_per_n", 1e5, ripples[0].amplitude_per_n;
    "ripple_phase_rad", 1e4, ripples[0].phase_rad;
    "ripple2_period_m", 1e7, ripples[1].period_m;
    "ripple2_amplitude_n", 1e4, ripples[1].amplitude_n;
    "ripple2_amplitude_per_n", 1e5, ripples[1].amplitude_per_n;
    "ripple2_phase_rad", 1e4, ripples[1].phase_rad;
};

/// A value between a declared one and its limits; an error where it is outside or too far from
/// `old`.
fn bounded(
    name: &str,
    old: f64,
    new: f64,
    max_change: f64,
    range: std::ops::RangeInclusive<f64>,
) -> Result<f64, String> {
    // NaN is in no range.
    if range.contains(&new) && (new - old).abs() <= max_change {
        return Ok(new);
    }
    Err(format!(
        "{name} would go from {old:.4} to {new:.4}: the board takes {} to {}, and a finding may change it by {max_change} at most{}",
        range.start(),
        range.end(),
        if name.starts_with("coulomb") && new < *range.start() {
            ". Friction of the wrong sign: let the velocity be positive while winding in (`scale = -1` in the model file)"
        } else {
            ""
        }
    ))
}
