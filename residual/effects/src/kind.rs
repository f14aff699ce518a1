//! Identification of effects and their forms in code: kinds, forms, families. Labels and sentences are
//! for readers only; nothing depends on their wording.

use serde::{Deserialize, Serialize};
use std::fmt;

macro_rules! kinds {
    ($($variant:ident $name:literal;)*) => {
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
                #[doc = concat!("`", $name, "`")]
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
        }
    };
}

kinds! {
    Offset "offset";
    Gain "gain";
    Quadratic "quadratic";
    Kink "kink";
    Coulomb "coulomb";
    LoadDependentCoulomb "load_dependent_coulomb";
    Viscous "viscous";
    AngleFriction "angle_friction";
    Stribeck "stribeck";
    Presliding "presliding";
    Hysteresis "hysteresis";
    Backlash "backlash";
    PeriodicAngle "periodic_angle";
    CableStretch "cable_stretch";
    Inertia "inertia";
    Delay "delay";
    ClockSkew "clock_skew";
    Saturation "saturation";
    Quantisation "quantisation";
    DriftTime "drift_time";
    DriftTemperature "drift_temperature";
    Creep "creep";
    Crosstalk "crosstalk";
    Tone "tone";
    CosineMisalignment "cosine_misalignment";
    Geometry "geometry";
    GravityAngle "gravity_angle";
    Payload "payload";
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

/// Forms that code must distinguish from the other forms of their effect. Every other form is known by its
/// label alone.
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

/// A setting of a board that several effects share: which of them is there makes no difference to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// Dry friction: with and without a share of load it describes the same forces at the loads that
    /// were measured.
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
