//! Checks of a configuration: ranges, path, units, stability of the integration.

use super::*;
use crate::error::{within, ConfigError};
use crate::unit::SMALLEST_REEL_MASS_KG;

fn all_within(key: &str, values: &[f64], low: f64, high: f64) -> Result<(), ConfigError> {
    values.iter().try_for_each(|&v| within(key, v, low, high))
}

impl PlantConfig {
    /// Checks every value; the error names the first key that the physics can't take.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if !(1_000..=100_000).contains(&self.step_ns) {
            return Err(ConfigError::new(
                "step_ns",
                format!("{} found, 1000 to 100000 expected", self.step_ns),
            ));
        }
        let a = &self.amplifier;
        within("amplifier.gain_a_per_v", a.gain_a_per_v, 1e-3, 100.0)?;
        within("amplifier.input_limit_v", a.input_limit_v, 0.1, 100.0)?;
        within("amplifier.bandwidth_hz", a.bandwidth_hz, 1.0, 1e5)?;
        within("amplifier.current_limit_a", a.current_limit_a, 1e-2, 1e3)?;
        within("amplifier.supply_v", a.supply_v, 1.0, 1e3)?;
        let d = &self.drive;
        within(
            "drive.torque_constant_n_m_per_a",
            d.torque_constant_n_m_per_a,
            1e-4,
            10.0,
        )?;
        within("drive.resistance_ohm", d.resistance_ohm, 1e-3, 1e3)?;
        within(
            "drive.rotor_inertia_kg_m2",
            d.rotor_inertia_kg_m2,
            1e-8,
            1.0,
        )?;
        within("drive.gear_inertia_kg_m2", d.gear_inertia_kg_m2, 0.0, 1.0)?;
        within("drive.reel_inertia_kg_m2", d.reel_inertia_kg_m2, 0.0, 1.0)?;
        within("drive.gear_ratio", d.gear_ratio, 0.1, 1e3)?;
        within("drive.reel_radius_m", d.reel_radius_m, 1e-3, 1.0)?;
        if d.encoder_counts_per_turn == 0 {
            return Err(ConfigError::new(
                "drive.encoder_counts_per_turn",
                "0 found, at least 1 expected",
            ));
        }
        let f = &self.friction;
        within("friction.offset_n", f.offset_n, -10.0, 10.0)?;
        within("friction.offset_sd_n", f.offset_sd_n, 0.0, 1.0)?;
        within("friction.gain", f.gain, 0.1, 10.0)?;
        within("friction.gain_sd", f.gain_sd, 0.0, 0.2)?;
        within("friction.coulomb_n", f.coulomb_n, 0.0, 100.0)?;
        within(
            "friction.coulomb_relative_sd",
            f.coulomb_relative_sd,
            0.0,
            0.3,
        )?;
        within("friction.per_load", f.per_load, 0.0, 0.9)?;
        within(
            "friction.per_load_relative_sd",
            f.per_load_relative_sd,
            0.0,
            0.3,
        )?;
        within("friction.breakaway_ratio", f.breakaway_ratio, 1.0, 3.0)?;
        within(
            "friction.stribeck_velocity_m_per_s",
            f.stribeck_velocity_m_per_s,
            1e-5,
            1.0,
        )?;
        within("friction.presliding_m", f.presliding_m, 1e-6, 1e-2)?;
        within(
            "friction.presliding_damping_ratio",
            f.presliding_damping_ratio,
            0.0,
            1.0,
        )?;
        within("friction.viscous_n_s_per_m", f.viscous_n_s_per_m, 0.0, 1e3)?;
        let c = &self.cable;
        within("cable.axial_stiffness_n", c.axial_stiffness_n, 10.0, 2e5)?;
        within("cable.damping_s", c.damping_s, 0.0, 5e-3)?;
        within("cable.initial_slack_m", c.initial_slack_m, 0.0, 1.0)?;
        let l = &self.load_cell;
        within("load_cell.capacity_kg", l.capacity_kg, 1e-2, 1e4)?;
        within(
            "load_cell.rated_output_v_per_v",
            l.rated_output_v_per_v,
            1e-5,
            0.1,
        )?;
        within("load_cell.gain_error_sd", l.gain_error_sd, 0.0, 0.3)?;
        within("load_cell.zero_sd_v_per_v", l.zero_sd_v_per_v, 0.0, 0.01)?;
        within("load_cell.stiffness_n_per_m", l.stiffness_n_per_m, 1e2, 1e7)?;
        within("load_cell.damping_ratio", l.damping_ratio, 0.0, 2.0)?;
        within("load_cell.assembly_mass_kg", l.assembly_mass_kg, 1e-2, 1e2)?;
        all_within(
            "load_cell.gravity_m_per_s2",
            &l.gravity_m_per_s2,
            -100.0,
            100.0,
        )?;
        let r = &self.robot;
        all_within(
            "robot.workspace_center_m",
            &r.workspace_center_m,
            -100.0,
            100.0,
        )?;
        within("robot.ramp_s", r.ramp_s, 0.0, 1e3)?;
        within(
            "robot.tip_compliance_m_per_n",
            r.tip_compliance_m_per_n,
            0.0,
            0.01,
        )?;
        within("robot.tip_relaxation_s", r.tip_relaxation_s, 1e-3, 10.0)?;
        let reach = self.validate_path()?;
        within("survey.position_sd_m", self.survey.position_sd_m, 0.0, 0.02)?;
        within("survey.axis_sd_rad", self.survey.axis_sd_rad, 0.0, 0.2)?;
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
                all_within("robot.path.half_extent_m", &p.half_extent_m, 0.0, 10.0)?;
                within(
                    "robot.path.rms_speed_m_per_s",
                    p.rms_speed_m_per_s,
                    0.0,
                    10.0,
                )?;
                if !(1..=16).contains(&p.harmonics) {
                    return Err(ConfigError::new(
                        "robot.path.harmonics",
                        format!("{} found, 1 to 16 expected", p.harmonics),
                    ));
                }
                within("robot.path.period_ratio", p.period_ratio, 1.0, 1e3)?;
                Ok(crate::vector::norm(p.half_extent_m))
            }
            PathConfig::Sweep(p) => {
                all_within("robot.path.direction", &p.direction, -1e6, 1e6)?;
                if crate::vector::norm(p.direction) < 1e-9 {
                    return Err(ConfigError::new(
                        "robot.path.direction",
                        "a zero vector has no direction",
                    ));
                }
                within("robot.path.amplitude_m", p.amplitude_m, 1e-6, 10.0)?;
                within("robot.path.speed_m_per_s", p.speed_m_per_s, 0.0, 10.0)?;
                Ok(p.amplitude_m)
            }
            PathConfig::Fixed(p) => {
                all_within("robot.path.offset_m", &p.offset_m, -10.0, 10.0)?;
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
            all_within(&key, &u.position_m, -100.0, 100.0)?;
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
            all_within(
                &format!("units[{i}].axis_tilt_rad"),
                &u.axis_tilt_rad,
                -0.5,
                0.5,
            )?;
        }
        Ok(())
    }

    /// The explicit integration needs the fastest mode well inside a step.
    fn validate_stability(&self) -> Result<(), ConfigError> {
        let step_s = self.step_ns as f64 * 1e-9;
        let shortest_m = 0.1;
        let cable = self.cable.axial_stiffness_n / shortest_m;
        let reference = self.friction.coulomb_n + 6.0 * self.friction.per_load;
        // Stiffness of the virgin Maxwell-slip contact: the mean of 1/distance is 2.08 (friction.rs).
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
