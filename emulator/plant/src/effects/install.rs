//! Each effect: how it enters the physics, and the ranges of its parameters.

use super::modifiers::Modifiers;
use super::*;

/// The interface: how an effect reaches the physics, and what values it can have.
pub(super) trait Install {
    /// Adds the effect to what the physics of one unit asks.
    fn install(&self, to: &mut Modifiers);
    /// Name, value, lowest and highest of every parameter.
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)>;
}

impl Install for Viscous {
    fn install(&self, to: &mut Modifiers) {
        to.viscous_n_s_per_m += self.coefficient_n_s_per_m;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![(
            "coefficient_n_s_per_m",
            self.coefficient_n_s_per_m,
            0.0,
            200.0,
        )]
    }
}

impl Install for Stribeck {
    fn install(&self, to: &mut Modifiers) {
        to.stribeck.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("excess_n", self.excess_n, 0.0, 10.0),
            ("velocity_m_per_s", self.velocity_m_per_s, 1e-5, 10.0),
        ]
    }
}

impl Install for Coulomb {
    fn install(&self, to: &mut Modifiers) {
        to.coulomb_n += self.constant_n;
        to.per_load += self.per_load;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("constant_n", self.constant_n, -5.0, 10.0),
            ("per_load", self.per_load, -0.5, 0.5),
        ]
    }
}

impl Install for Periodic {
    fn install(&self, to: &mut Modifiers) {
        to.periodic.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("order", self.order, 0.01, 200.0),
            ("amplitude_n", self.amplitude_n, 0.0, 10.0),
            ("phase_rad", self.phase_rad, -1e3, 1e3),
        ]
    }
}

impl Install for Backlash {
    fn install(&self, to: &mut Modifiers) {
        // Plays in series act as one; the bearing's friction is that of the stiffer one.
        let before = to.backlash.take();
        to.backlash = Some(Backlash {
            units: Vec::new(),
            gap_m: self.gap_m + before.as_ref().map_or(0.0, |b| b.gap_m),
            reel_friction_n: self
                .reel_friction_n
                .max(before.map_or(0.0, |b| b.reel_friction_n)),
        });
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("gap_m", self.gap_m, 0.0, 0.02),
            ("reel_friction_n", self.reel_friction_n, 0.01, 5.0),
        ]
    }
}

impl Install for Inertia {
    fn install(&self, to: &mut Modifiers) {
        to.mass_kg += self.mass_kg;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("mass_kg", self.mass_kg, 0.0, 20.0)]
    }
}

impl Install for AmplifierGain {
    fn install(&self, to: &mut Modifiers) {
        to.amplifier_gain_error += self.relative_error;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("relative_error", self.relative_error, -0.9, 1.0)]
    }
}

impl Install for CommandDelay {
    fn install(&self, to: &mut Modifiers) {
        to.delay_s += self.delay_s;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("delay_s", self.delay_s, 0.0, 0.5)]
    }
}

impl Install for ZeroDrift {
    fn install(&self, to: &mut Modifiers) {
        to.drift_n_per_s += self.rate_n_per_s;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("rate_n_per_s", self.rate_n_per_s, -1.0, 1.0)]
    }
}

impl Install for TemperatureDrift {
    fn install(&self, to: &mut Modifiers) {
        to.temperature.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("rise_k", self.rise_k, -50.0, 50.0),
            ("time_constant_s", self.time_constant_s, 0.01, 1e6),
            ("zero_n_per_k", self.zero_n_per_k, -1.0, 1.0),
            ("gain_per_k", self.gain_per_k, -0.01, 0.01),
        ]
    }
}

impl Install for Creep {
    fn install(&self, to: &mut Modifiers) {
        to.creep.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("fraction", self.fraction, -0.5, 0.5),
            ("time_constant_s", self.time_constant_s, 0.01, 1e6),
        ]
    }
}

impl Install for Crosstalk {
    fn install(&self, to: &mut Modifiers) {
        to.crosstalk.push(self.clone());
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("fraction", self.fraction, -1.0, 1.0)]
    }
}

impl Install for CellQuadratic {
    fn install(&self, to: &mut Modifiers) {
        to.quadratic_per_n += self.per_n;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("per_n", self.per_n, -0.02, 0.02)]
    }
}

impl Install for CableHardening {
    fn install(&self, to: &mut Modifiers) {
        to.hardening_per_strain += self.per_strain;
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("per_strain", self.per_strain, 0.0, 5e3)]
    }
}

impl Install for Tone {
    fn install(&self, to: &mut Modifiers) {
        match self.place {
            TonePlace::Bridge => to.bridge_tones.push(self.clone()),
            TonePlace::Drive => to.drive_tones.push(self.clone()),
        }
    }
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![
            ("frequency_hz", self.frequency_hz, 1e-3, 5e3),
            ("amplitude_n", self.amplitude_n, 0.0, 10.0),
            ("phase_rad", self.phase_rad, -1e3, 1e3),
        ]
    }
}

impl Install for Payload {
    // Acts at the tip, not in a unit: see `payload_kg`.
    fn install(&self, _to: &mut Modifiers) {}
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("mass_kg", self.mass_kg, 0.0, 5.0)]
    }
}
