//! Declared models: what the user of the rig believes, exactly true apart from the missing effects.

use crate::random::Random;

/// Velocity in rad/s below which the declared model takes the reel as at rest.
pub const DEADBAND_RAD_S: f64 = 0.02;

/// Velocity in rad/s that rounds the declared Coulomb friction.
const FRICTION_ROUNDING_RAD_S: f64 = 0.2;

/// A declared model, as the user of the rig has it. Its terms are smooth functions of the logged
/// columns and are exactly true, so an empty set lacks nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Declared {
    /// The force as commanded.
    Bare,
    /// A fitted gain of the command, and an offset.
    Gain,
    /// The command, an offset, viscous friction.
    Viscous,
    /// As `Viscous`, and Coulomb friction rounded near rest.
    Friction,
    /// The command, an offset, and a spring over the angle.
    Spring,
}

/// One term of a declared model.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Name in the model file.
    pub name: &'static str,
    /// Expression in the model file.
    pub expr: String,
    /// Unit of the coefficient.
    pub unit: &'static str,
    /// True for a coefficient that the model file fixes.
    pub fixed: bool,
    /// True coefficient, in `unit`.
    pub coefficient: f64,
}

impl Declared {
    /// Models that any set may have.
    pub(crate) const COMMON: [Self; 4] = [Self::Bare, Self::Gain, Self::Viscous, Self::Friction];

    /// The terms with their true coefficients.
    pub(crate) fn terms(self, random: &mut Random) -> Vec<Term> {
        let term = |name, expr: &str, unit, fixed, coefficient| Term {
            name,
            expr: expr.to_string(),
            unit,
            fixed,
            coefficient,
        };
        let gain = random.uniform(0.95, 1.05);
        let offset = random.uniform(-0.05, 0.05);
        let viscous = random.uniform(-0.08, -0.01);
        let friction = random.uniform(-0.3, -0.05);
        let mut terms = vec![term("force as commanded", "command", "-", true, 1.0)];
        if self == Self::Gain {
            terms = vec![term("gain of the command", "command", "-", false, gain)];
        }
        if self != Self::Bare {
            terms.push(term("offset", "1", "N", false, offset));
        }
        if matches!(self, Self::Viscous | Self::Friction) {
            terms.push(term(
                "viscous friction",
                "velocity",
                "N s/rad",
                false,
                viscous,
            ));
        }
        if self == Self::Friction {
            let expr = format!("tanh(velocity / {FRICTION_ROUNDING_RAD_S})");
            terms.push(term("dry friction", &expr, "N", false, friction));
        }
        if self == Self::Spring {
            // The effect `backlash` brings the spring itself, on the other side of its play.
            terms.push(term("return spring", "angle", "N/rad", false, 0.0));
        }
        terms
    }
}

impl Term {
    /// Largest change of the force with the velocity in N s/rad.
    pub(crate) fn slope(&self) -> f64 {
        match self.name {
            "viscous friction" => self.coefficient.abs(),
            "dry friction" => self.coefficient.abs() / FRICTION_ROUNDING_RAD_S,
            _ => 0.0,
        }
    }

    /// The term without its coefficient.
    pub(crate) fn value(&self, command: f64, velocity: f64, angle: f64) -> f64 {
        match self.name {
            "offset" => 1.0,
            "viscous friction" => velocity,
            "dry friction" => (velocity / FRICTION_ROUNDING_RAD_S).tanh(),
            "return spring" => angle,
            _ => command,
        }
    }
}
