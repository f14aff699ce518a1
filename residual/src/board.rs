//! What the board can use of a report: friction, gain, offset, ripple, delay.

use crate::report::{Report, Verdict};
use serde::{Deserialize, Serialize};

/// A ripple over the angle, as found: target above prediction by
/// `amplitude * sin(order * angle + phase)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ripple {
    /// Order per turn of the angle.
    pub order: f64,
    /// Amplitude, in the target's unit (or as a share of the load).
    pub amplitude: f64,
    /// Phase, rad.
    pub phase: f64,
    /// Whether the amplitude is a share of the load.
    pub of_load: bool,
}

/// By how much the target lies above the declared prediction, in the forms that a board can
/// compensate. What it must *add to its command* is the negative of each force. Forces are in the
/// target's unit; absent effects are 0.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// Coefficient of the sign of the velocity at zero load.
    pub friction: f64,
    /// Coefficient of the sign of the velocity per unit of load.
    pub friction_per_load: f64,
    /// Coefficient of the velocity, per unit of the velocity column.
    pub viscous: f64,
    /// Relative error of the declared gain.
    pub gain_error: f64,
    /// Constant.
    pub offset: f64,
    /// Delay between command and target, lags included, s.
    pub delay_s: f64,
    /// Ripples over the angle.
    pub ripples: Vec<Ripple>,
    /// Effects found that a board cannot compensate with these.
    pub left_out: Vec<String>,
}

/// Effects that a board makes up for by the same setting, so that it does not matter which of them it
/// is: dry friction with or without a share of load describes the same forces at the loads that were
/// there, and a lag acts on a slower loop as a delay.
const ALIKE: [&[&str]; 2] = [
    &["coulomb", "load_dependent_coulomb"],
    &["delay", "cable_stretch"],
];

impl Report {
    /// What a board can use. `None` if nothing was found, or if the verdict does not support a
    /// change of the board: `unknown`, and `not_identifiable` unless all that cannot be told apart
    /// comes to the same for a board (dry friction with or without load, delay or lag).
    pub fn board(&self) -> Option<Board> {
        let alike = |a: &crate::report::Ambiguity| {
            ALIKE
                .iter()
                .any(|family| a.effects.iter().all(|e| family.contains(&e.as_str())))
        };
        match self.verdict {
            Verdict::Effect | Verdict::Several => {}
            Verdict::NotIdentifiable if self.not_identifiable.iter().all(alike) => {}
            _ => return None,
        }
        let mut b = Board::default();
        for e in &self.effects {
            let get = |n: &str| e.params.get(n).copied().unwrap_or(0.0);
            match e.name.as_str() {
                "coulomb" => b.friction += get("friction"),
                "load_dependent_coulomb" => {
                    b.friction += get("friction_at_zero_load");
                    b.friction_per_load += get("friction_per_load");
                }
                // Only where it falls with speed. Where it grows, this stands in for viscous friction, and its sliding
                // part would be too much at a reversal.
                "stribeck" if get("sliding_friction") * get("extra_at_low_speed") >= 0.0 => {
                    b.friction += get("sliding_friction");
                }
                "viscous" => b.viscous += get("damping"),
                "gain" => b.gain_error += get("gain_error"),
                "offset" => b.offset += get("offset"),
                "delay" => b.delay_s += get("delay"),
                // To a loop slower than it, a first-order lag is a delay of its time constant.
                "cable_stretch" if e.form == "lag of the command" => {
                    b.delay_s += get("time_constant");
                }
                "periodic_angle" => b.ripples.push(Ripple {
                    order: get("order"),
                    amplitude: get("amplitude"),
                    phase: get("phase"),
                    of_load: e.form.contains("load"),
                }),
                other => b.left_out.push(other.to_string()),
            }
        }
        (b != Board {
            left_out: b.left_out.clone(),
            ..Board::default()
        })
        .then_some(b)
    }
}
