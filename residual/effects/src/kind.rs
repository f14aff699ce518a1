//! Identification of effects and their forms in code: kinds, forms, families. Labels and sentences
//! are for readers only; nothing depends on their wording.

use serde::{Deserialize, Serialize};
use std::fmt;

macro_rules! kinds {
    ($($variant:ident $name:literal $meaning:literal $experiment:literal;)*) => {
        /// An effect of the catalogue. Its text is the name in reports, in model files and in
        /// `docs/residual/effects.md`.
        ///
        /// ```
        /// use residual_effects::EffectKind;
        ///
        /// assert_eq!(EffectKind::LoadDependentCoulomb.as_str(), "load_dependent_coulomb");
        /// assert_eq!(EffectKind::named("delay"), Some(EffectKind::Delay));
        /// assert_eq!(EffectKind::named("gremlins"), None);
        /// ```
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[non_exhaustive]
        pub enum EffectKind {
            $(
                #[doc = concat!("`", $name, "`: ", $meaning, ".")]
                #[serde(rename = $name)]
                $variant,
            )*
        }

        impl EffectKind {
            /// Every kind, in the order of the catalogue.
            pub const ALL: &'static [EffectKind] = &[$(EffectKind::$variant,)*];

            /// The name in reports and model files.
            pub fn as_str(self) -> &'static str {
                match self {
                    $(EffectKind::$variant => $name,)*
                }
            }

            /// One sentence: what it is.
            pub fn meaning(self) -> &'static str {
                match self {
                    $(EffectKind::$variant => $meaning,)*
                }
            }

            /// The experiment that exposes this effect and no other.
            pub fn experiment(self) -> &'static str {
                match self {
                    $(EffectKind::$variant => $experiment,)*
                }
            }
        }
    };
}

kinds! {
    Offset "offset"
        "offset: a constant force (zero of the sensor, weight of the mount)"
        "log with no load at all";
    Gain "gain"
        "gain: the declared prediction is too small or too large by a constant factor"
        "hold several known loads at rest: the error grows in proportion to the load";
    Quadratic "quadratic"
        "curvature: an error that grows with the square of the load (a bend in a part of the range, in a slope that changes gradually, may look the same)"
        "hold many loads over the whole range at rest, up and down";
    Kink "kink"
        "kink: from a certain load on the target follows with another slope (a second path of the load, a stop, a joint that closes); a slope that changes gradually, or at another load in each unit, may look the same"
        "ramp the load slowly through its range and back: two straight lines that meet at one load";
    Coulomb "coulomb"
        "dry friction: a constant force with the sign of the velocity"
        "move back and forth at constant speed and constant load: the force jumps by twice the friction when the direction changes";
    LoadDependentCoulomb "load_dependent_coulomb"
        "dry friction that grows with the load (gear teeth, wrapped cable): sign of velocity times (constant + share of load)"
        "move back and forth at constant speed under several constant loads: the jump at reversal grows with the load";
    Viscous "viscous"
        "viscous friction: a force in proportion to the velocity, or as the drag of a fluid to its square"
        "move at several constant speeds under constant load: the force follows the speed in a straight line";
    AngleFriction "angle_friction"
        "dry friction that depends on the angle: larger in a sector of the turn, or with a ripple"
        "turn slowly through the whole range in both directions under constant load: the difference of the directions depends on the angle";
    Stribeck "stribeck"
        "Stribeck friction: dry friction that is larger at low speed and falls to its sliding value (where the part at low speed acts along the motion: one that is smaller there)"
        "move at many constant speeds from very slow to fast, both directions, constant load";
    Presliding "presliding"
        "presliding: at rest friction holds the direction of the last motion, and turns over a short distance before the next"
        "stop, reverse over a distance far below one turn, and log position finely: the force follows a short elastic loop";
    Hysteresis "hysteresis"
        "hysteresis: a loop that depends on the path of load or position, not on speed, and turns over a distance after each reversal"
        "ramp the load (or position) slowly up and down with shrinking amplitude, at two speeds: the loops nest and don't change with speed";
    Backlash "backlash"
        "backlash: after a reversal the drive crosses a gap before the output follows"
        "reverse slowly with small amplitudes around the gap: the output stands still inside it, with sharp corners";
    PeriodicAngle "periodic_angle"
        "a ripple locked to the angle, by order per turn and phase: gear mesh, cogging, and with order one an eccentric reel or the weight on a shaft that turns round"
        "turn slowly through many turns at two different speeds: the ripple keeps its order per turn, while its frequency follows the speed";
    CableStretch "cable_stretch"
        "series elasticity: the load follows the command through a spring and damper (first-order lag; where only a part of the load is late it looks the same), or rises with the winding angle"
        "step and sweep the command with the far end blocked: the phase of a lag approaches a quarter period, that of a delay grows without limit";
    Inertia "inertia"
        "inertia: a force in proportion to the acceleration"
        "move sinusoidally at constant amplitude and several frequencies: the force grows with the square of the frequency";
    Delay "delay"
        "delay: the target follows the command after a fixed time (negative: the time stamps of the target are late)"
        "sweep the command up to half the sampling rate: a delay's phase grows in proportion to the frequency, without limit";
    SensorLag "sensor_lag"
        "lag of the reading: what acts on the target shows late, as behind a slow sensor or a filter of first order"
        "step the force under constant conditions and log quickly: the reading approaches the new value exponentially, whatever made the step";
    ClockSkew "clock_skew"
        "clock skew: the clocks of command and target run at different rates, so the lag between them grows along the run"
        "repeat one sharp event at the start and at the end of a long run and compare the lag";
    Saturation "saturation"
        "saturation: beyond a limit the target no longer follows the command"
        "ramp the command slowly beyond the suspected limit and back";
    SlewLimit "slew_limit"
        "slew limit: the target follows the command no faster than at a limited rate, as behind an amplifier or a ramp in a drive"
        "step the command by several amounts: the target rises along straight lines of one slope, whatever the size of the step";
    Quantisation "quantisation"
        "quantisation: the command takes effect, or the target is read, only in whole steps"
        "ramp the command so slowly that many rows fall on each step";
    DriftTime "drift_time"
        "drift: an error that grows steadily with time"
        "hold one load for a long time at constant temperature; repeat the run with the order of loads reversed";
    DriftTemperature "drift_temperature"
        "temperature drift of zero or gain, at once or with a thermal time constant"
        "warm up and cool down under constant load, so that temperature and time do not rise together";
    Creep "creep"
        "creep: part of the response to a load is slow, with a time constant of its own"
        "hold a load for many time constants, remove it, and record the return to zero";
    Crosstalk "crosstalk"
        "crosstalk: a share of another channel shows in the target"
        "excite the other channel alone";
    Tone "tone"
        "a tone of constant frequency in time, independent of the motion (mains, fan, or the alias of something above half the row rate)"
        "log at rest with the drive off, at two sampling rates: a true tone keeps its frequency, an alias moves";
    CosineMisalignment "cosine_misalignment"
        "cosine error: the sensor sees the component of the load along its axis, and the angle between them changes"
        "hold one load and turn the direction of the cable through its range";
    Geometry "geometry"
        "geometry: an error that depends on the pose, alone or in proportion to the load"
        "visit the same poses several times, in different order and under different loads";
    GravityAngle "gravity_angle"
        "gravity: the weight of a part acts with the sine and cosine of its angle, whatever the load"
        "turn through the whole range slowly with no load; repeat with the mount turned by a quarter";
    Payload "payload"
        "payload: an unknown mass, seen by its weight and its inertia together"
        "move up and down with and without strong acceleration: weight stays, inertia does not";
}

impl EffectKind {
    /// The kind with this name; `None` if there is none.
    pub fn named(name: &str) -> Option<EffectKind> {
        EffectKind::ALL.iter().copied().find(|k| k.as_str() == name)
    }
}

impl fmt::Display for EffectKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl PartialEq<str> for EffectKind {
    fn eq(&self, name: &str) -> bool {
        self.as_str() == name
    }
}

impl PartialEq<&str> for EffectKind {
    fn eq(&self, name: &&str) -> bool {
        self.as_str() == *name
    }
}

/// Forms that code must distinguish from the other forms of their effect. Every other form is known
/// by its label alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Form {
    /// Any form that nothing but a report must know.
    #[default]
    Other,
    /// `cable_stretch`: the target follows the command through a first-order lag.
    CommandLag,
    /// `periodic_angle`: the amplitude is a share of the load.
    ShareOfLoad,
    /// `presliding`: friction in motion and at rest under one coefficient.
    MotionAndRest,
    /// `presliding`: friction at rest alone, in the direction of the last motion.
    AtRest,
    /// `presliding`: friction at rest alone, constant part and share of load.
    AtRestWithLoad,
    /// `presliding`: the elastic turn of Dahl's model at a reversal.
    ElasticTurn,
}

/// How a dry friction depends on load and motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Friction {
    /// Constant, in motion.
    Constant,
    /// With a share of the load, in motion.
    WithLoad,
    /// At rest and at reversals.
    AtRest,
}

/// A setting of a board that several effects share: which of them is there makes no difference to
/// it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// Dry friction: with and without a share of load it describes the same forces at the loads
    /// that were measured.
    DryFriction,
    /// Delay: a first-order lag acts on a slower loop as a delay.
    Delay,
}

/// A named effect as it was fitted, for [`Effect::remedies`](super::Effect::remedies).
pub struct Found<'a> {
    /// The form that was found.
    pub form: Form,
    /// A parameter by name; 0 if the form does not have it.
    pub get: &'a dyn Fn(&str) -> f64,
}

/// One part of what a board can compensate: by how much the target lies above the prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Remedy {
    /// Coefficient of the sign of the velocity, in the target's unit.
    Friction(f64),
    /// Coefficient of the sign of the velocity per unit of load.
    FrictionPerLoad(f64),
    /// Coefficient of the velocity.
    Viscous(f64),
    /// Relative error of the gain.
    Gain(f64),
    /// Constant, in the target's unit.
    Offset(f64),
    /// Delay in s.
    Delay(f64),
    /// `amplitude * sin(order * angle + phase)`, times the load if `of_load`.
    Ripple {
        /// Order per turn.
        order: f64,
        /// Amplitude, in the target's unit or as a share of the load.
        amplitude: f64,
        /// Phase in rad.
        phase: f64,
        /// Whether the amplitude is a share of the load.
        of_load: bool,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CATALOGUE;

    #[test]
    fn the_catalogue_has_each_kind_once_and_in_order() {
        let kinds: Vec<EffectKind> = CATALOGUE.iter().map(|e| e.kind()).collect();
        assert_eq!(kinds, EffectKind::ALL);
    }

    #[test]
    fn a_kind_is_written_as_its_name() {
        for kind in EffectKind::ALL {
            let json = serde_json::to_string(kind).unwrap();
            assert_eq!(json, format!("\"{kind}\""));
            assert_eq!(serde_json::from_str::<EffectKind>(&json).unwrap(), *kind);
            assert_eq!(EffectKind::named(kind.as_str()), Some(*kind));
        }
    }
}
