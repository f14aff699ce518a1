//! Checks of a configuration: ranges, path, units, stability of the integration.

use super::*;
use crate::unit::SMALLEST_REEL_MASS_KG;

impl PlantConfig {
    /// Checks every value; the error names the first key that the physics can't take.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if !(1_000..=100_000).contains(&self.step_ns) {
            return Err(ConfigError::new(
                "step_ns",
                format!("{} found, 1000 to 100000 expected", self.step_ns),
            ));
        }
        self.amplifier.check("amplifier")?;
        self.drive.check("drive")?;
        self.friction.check("friction")?;
        self.cable.check("cable")?;
        self.load_cell.check("load_cell")?;
        self.robot.check("robot")?;
        self.survey.check("survey")?;
        if self.drive.encoder_counts_per_turn == 0 {
            return Err(ConfigError::new(
                "drive.encoder_counts_per_turn",
                "0 found, at least 1 expected",
            ));
        }
        let reach = self.validate_path()?;
        self.validate_units(reach)?;
        self.validate_stability()?;
        for (i, effect) in self.effects.iter().enumerate() {
            effect.validate(&format!("effects[{i}]"), self.units.len())?;
        }
        Ok(())
    }

    /// Checks the path; returns the farthest that the tip gets from the centre, m.
    fn validate_path(&self) -> Result<f64, ConfigError> {
        match &self.robot.path {
            PathConfig::Random(p) => {
                p.check("robot.path")?;
                if !(1..=16).contains(&p.harmonics) {
                    return Err(ConfigError::new(
                        "robot.path.harmonics",
                        format!("{} found, 1 to 16 expected", p.harmonics),
                    ));
                }
                Ok(crate::vector::norm(p.half_extent_m))
            }
            PathConfig::Sweep(p) => {
                p.check("robot.path")?;
                if crate::vector::norm(p.direction) < 1e-9 {
                    return Err(ConfigError::new(
                        "robot.path.direction",
                        "a zero vector has no direction",
                    ));
                }
                Ok(p.amplitude_m)
            }
            PathConfig::Fixed(p) => {
                p.check("robot.path")?;
                Ok(crate::vector::norm(p.offset_m))
            }
        }
    }

    fn validate_units(&self, reach_m: f64) -> Result<(), ConfigError> {
        if !(1..=MAX_UNITS).contains(&self.units.len()) {
            return Err(ConfigError::new(
                "units",
                format!(
                    "{} units found, 1 to {MAX_UNITS} expected",
                    self.units.len()
                ),
            ));
        }
        for (i, u) in self.units.iter().enumerate() {
            let key = format!("units[{i}].position_m");
            u.position_m.within(&key, -100.0, 100.0)?;
            let distance = crate::vector::norm(crate::vector::sub(
                u.position_m,
                self.robot.workspace_center_m,
            ));
            // 0.1 m beyond the path: room for survey errors and a tip that gives.
            if distance < reach_m + 0.1 {
                return Err(ConfigError::new(
                    key,
                    format!(
                        "{distance:.3} m from the workspace centre; the tip moves {reach_m:.3} m, so at least {:.3} m expected",
                        reach_m + 0.1
                    ),
                ));
            }
            u.axis_tilt_rad
                .within(&format!("units[{i}].axis_tilt_rad"), -0.5, 0.5)?;
        }
        Ok(())
    }

    /// The explicit integration needs the fastest mode well inside a step.
    fn validate_stability(&self) -> Result<(), ConfigError> {
        let step_s = self.step_ns as f64 * 1e-9;
        let shortest_m = 0.1;
        let cable = self.cable.axial_stiffness_n / shortest_m;
        let reference = self.friction.coulomb_n + 6.0 * self.friction.per_load;
        // Stiffness of the virgin Maxwell-slip contact: the mean of 1/distance is 2.08
        // (friction.rs).
        let contact = 2.1 * reference * self.friction.breakaway_ratio / self.friction.presliding_m;
        let modes = [
            (
                "friction.presliding_m, cable.axial_stiffness_n or drive inertias",
                (cable + contact) / self.drive.reflected_mass_kg(),
            ),
            (
                "load_cell.stiffness_n_per_m or cable.axial_stiffness_n",
                (cable + self.load_cell.stiffness_n_per_m) / self.load_cell.assembly_mass_kg,
            ),
        ];
        let damping = cable * self.cable.damping_s;
        let loose = self
            .effects
            .iter()
            .any(|e| matches!(e, Effect::Backlash(_)));
        let lightest = self
            .drive
            .reflected_mass_kg()
            .min(self.load_cell.assembly_mass_kg)
            .min(if loose {
                SMALLEST_REEL_MASS_KG
            } else {
                f64::INFINITY
            });
        if damping * step_s / lightest > 0.5 {
            return Err(ConfigError::new(
                "cable.damping_s",
                format!(
                    "{} with this stiffness damps a mass of {lightest} kg too fast for step_ns = {}; at most {:.2e} expected, or a shorter step",
                    self.cable.damping_s,
                    self.step_ns,
                    0.5 * lightest / step_s / cable
                ),
            ));
        }
        let viscous = self.friction.viscous_n_s_per_m
            + self
                .effects
                .iter()
                .map(|e| match e {
                    Effect::Viscous(v) => v.coefficient_n_s_per_m,
                    _ => 0.0,
                })
                .sum::<f64>();
        if viscous * step_s / self.drive.reflected_mass_kg() > 0.5 {
            return Err(ConfigError::new(
                "friction.viscous_n_s_per_m",
                format!(
                    "{viscous} N.s/m in all is too fast for step_ns = {}; a smaller value or a shorter step expected",
                    self.step_ns
                ),
            ));
        }
        for (key, omega_squared) in modes {
            let omega = omega_squared.sqrt();
            if omega * step_s > 0.3 {
                return Err(ConfigError::new(
                    key,
                    format!(
                        "a mode of {:.0} Hz is too fast for step_ns = {}; at most {:.0} Hz, or a shorter step",
                        omega / std::f64::consts::TAU,
                        self.step_ns,
                        0.3 / step_s / std::f64::consts::TAU
                    ),
                ));
            }
        }
        Ok(())
    }
}
