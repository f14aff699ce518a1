//! Settings of the workspace, the host's controller and the units, in SI units, and the units' form
//! on the wire.

use control::config::field;
use nalgebra::Vector3;
use serde::Serialize;
use wire::message::{BoardConfig, CellCorrection, FilterChoice, Ripple, UnitConfig, RIPPLES};

/// Where the tip works.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Workspace {
    /// Centre, robot base frame, m.
    pub center_m: Vector3<f64>,
    /// A tip further than this from the centre stops the rig, m.
    pub radius_m: f64,
}

/// The host's force controller (thesis 3.7).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ControllerSettings {
    /// Proportional gain, N per N.
    pub kp: f64,
    /// Integral gain, N per N and second.
    pub ki_per_s: f64,
    /// Largest integral part, N.
    pub integral_limit_n: f64,
    /// Fastest change of the commanded force, N/s.
    pub slew_n_per_s: f64,
    /// A force larger than this is refused, N.
    pub force_limit_n: f64,
    /// Force at the tip at which the board itself stops all motors, N.
    #[serde(skip_serializing_if = "is_default_tip_limit")]
    pub tip_force_limit_n: f64,
    /// Whether the board writes a converter's register pointer ahead of its next sample
    /// (docs/bring-up.md, step 8).
    #[serde(skip_serializing_if = "is_true")]
    pub pointer_ahead: bool,
    /// Whether the host sends with each setpoint how fast the robot's motion moves the reel, where
    /// the robot's poses are good enough to tell (docs/architecture.md, "Foretold reversals").
    #[serde(skip_serializing_if = "is_true")]
    pub preview: bool,
}

/// Limit of the force at the tip that a rig file has unless it says otherwise, N.
pub const TIP_FORCE_LIMIT_N: f64 = 20.0;

impl ControllerSettings {
    /// As the board is told.
    #[must_use]
    pub fn board_config(&self) -> BoardConfig {
        BoardConfig {
            tip_force_limit_un: (self.tip_force_limit_n * 1e6).round() as i32,
            pointer_ahead: self.pointer_ahead,
        }
    }
}

/// Which tensions an allocation stays near to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// The lower bound: least load on robot and motors.
    Lower,
    /// Half-way between the bounds: far from slack.
    Middle,
}

/// How a force is shared out over the cables.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AllocationSettings {
    /// Which tensions to stay near to.
    pub reference: Reference,
    /// Weight of staying near, dimensionless.
    pub tie_break: f64,
}

/// How a unit's samples are filtered.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// Mean of this many samples.
    MovingAverage(u8),
    /// Second-order Butterworth low pass with this corner, Hz.
    LowPass(f64),
}

/// One force unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UnitSettings {
    /// Number on the unit, from 1.
    pub number: u8,
    /// Whether it takes part.
    pub enabled: bool,
    /// Where the cable leaves the reel, robot base frame, m (thesis 3.5.2: `P_Cable`).
    pub exit_m: Vector3<f64>,
    /// The load cell's measuring axis, unit vector in the robot base frame, pointing from the unit
    /// to the workspace: a cable along it reads its whole tension.
    pub axis: Vector3<f64>,
    /// Load-cell force per ADC count, N; negative where pulling lowers the code.
    pub scale_n_per_count: f64,
    /// Least tension of the cable while the rig is armed, N.
    pub tension_min_n: f64,
    /// Largest setpoint of the cable's tension, N.
    pub tension_max_n: f64,
    /// Filter of the samples.
    pub filter: Filter,
    /// A sample further than this from the prediction is a spike, N.
    pub spike_limit_n: f64,
    /// Proportional gain, N per N.
    pub kp: f64,
    /// Integral gain, N per N and second.
    pub ki_per_s: f64,
    /// Gain of the integral that leaks, N per N and second; 0: none.
    #[serde(skip_serializing_if = "is_zero")]
    pub leaky_ki_per_s: f64,
    /// Derivative gain, N per N/s.
    pub kd_s: f64,
    /// Damping on the reel's speed, N per m/s.
    pub damping_n_s_per_m: f64,
    /// Whether the friction feedforward acts.
    pub friction_feedforward: bool,
    /// Force at the cable with no command, N.
    pub friction_offset_n: f64,
    /// Force at the cable per commanded cable force.
    pub friction_gain: f64,
    /// Coulomb friction without load, N.
    pub coulomb_n: f64,
    /// Growth of Coulomb friction with load, N per N.
    pub coulomb_per_n: f64,
    /// Reel travel over which the friction's direction reverses, m.
    pub reversal_m: f64,
    /// Cable travel per encoder count, m; positive where winding in counts up.
    pub travel_m_per_count: f64,
    /// DAC codes per newton of cable force.
    pub dac_codes_per_n: f64,
    /// Largest commanded cable force, N.
    pub force_limit_n: f64,
    /// Fastest change of the commanded cable force, N/s.
    pub slew_n_per_s: f64,
    /// Tension at which the unit faults, N; while it follows setpoints it does at 13 N already, or
    /// 1 N above `tension_max_n`.
    pub over_tension_n: f64,
    /// Viscous friction that the feedforward compensates, N per m/s of cable travel; 0: none.
    #[serde(skip_serializing_if = "is_zero")]
    pub viscous_n_s_per_m: f64,
    /// What the board checks the load cell and the motor against.
    #[serde(skip_serializing_if = "UnitChecks::is_default")]
    pub checks: UnitChecks,
    /// Ripples over the reel's angle that the feedforward compensates.
    #[serde(skip_serializing_if = "are_none")]
    pub ripples: [RippleSettings; RIPPLES],
    /// Curve and creep of the load cell that the board takes out.
    #[serde(skip_serializing_if = "CellSettings::is_none")]
    pub cell: CellSettings,
}

/// Curve and creep of a load cell ([`wire::message::CellCorrection`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CellSettings {
    /// Curve, N per N^2 of straight reading; 0: none.
    pub curve_per_n: f64,
    /// Share of a lasting load by which the reading grows; 0: none.
    pub creep: f64,
    /// Time constant of that, s.
    pub creep_s: f64,
}

impl Default for CellSettings {
    fn default() -> Self {
        Self {
            curve_per_n: 0.0,
            creep: 0.0,
            creep_s: f64::from(CellCorrection::NONE.creep_ms) * 1e-3,
        }
    }
}

impl CellSettings {
    /// Whether it does nothing.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.curve_per_n == 0.0 && self.creep == 0.0
    }

    fn to_wire(self) -> CellCorrection {
        CellCorrection {
            curve_nn_per_n2: field::CELL_CURVE.to_wire(self.curve_per_n),
            creep_q16: field::CELL_CREEP.to_wire(self.creep),
            creep_ms: field::CELL_CREEP_TIME.to_wire(self.creep_s),
        }
    }
}

/// What the board checks a unit's load cell and motor against.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UnitChecks {
    /// ADC code at zero load that was found with the calibration.
    pub zero_code: f64,
    /// How far a new zero may be from it, N of load-cell force.
    pub zero_deviation_n: f64,
    /// How far the command may exceed what the friction model needs for the setpoint, N.
    pub authority_n: f64,
    /// How far the tension may be outside the friction model's band around the command, N.
    pub plausible_n: f64,
}

impl Default for UnitChecks {
    fn default() -> Self {
        let nominal = control::Config::nominal();
        Self {
            zero_code: f64::from(nominal.stored_zero_code),
            zero_deviation_n: f64::from(nominal.zero_deviation_un) * 1e-6,
            authority_n: f64::from(nominal.authority_un) * 1e-6,
            plausible_n: f64::from(nominal.plausible_un) * 1e-6,
        }
    }
}

impl UnitChecks {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

fn is_true(value: &bool) -> bool {
    *value
}

fn is_default_tip_limit(limit_n: &f64) -> bool {
    *limit_n == TIP_FORCE_LIMIT_N
}

// What is off by default is left out of the hash, so that a rig file of before keeps its own.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn are_none(ripples: &[RippleSettings; RIPPLES]) -> bool {
    ripples.iter().all(RippleSettings::is_none)
}

/// A force on the cable that repeats with the reel's angle: (amplitude_n + amplitude_per_n x
/// setpoint) x sin(2 pi travel / period_m + phase_rad), with the travel of the unit's encoder since
/// the board booted. The phase is lost when the board is switched off.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct RippleSettings {
    /// Cable travel of a period, m: 2 pi 10 mm for once a turn of the reel.
    pub period_m: f64,
    /// Amplitude, N.
    pub amplitude_n: f64,
    /// Amplitude per setpoint, N per N.
    pub amplitude_per_n: f64,
    /// Phase at the encoder's zero, rad.
    pub phase_rad: f64,
}

impl RippleSettings {
    /// Whether it does nothing.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.amplitude_n == 0.0 && self.amplitude_per_n == 0.0
    }

    fn to_wire(self, travel_m_per_count: f64) -> Ripple {
        if self.is_none() || self.period_m <= 0.0 {
            return Ripple::default();
        }
        let turn = 4_294_967_296.0;
        let turns = self.phase_rad / std::f64::consts::TAU;
        Ripple {
            periods_per_count_q32: field::RIPPLE_RATE.to_wire(travel_m_per_count / self.period_m),
            // Half a turn exactly would not fit and is minus half a turn.
            phase_q32: ((turns - turns.round()) * turn).round() as i64 as i32,
            amplitude_un: field::RIPPLE_AMPLITUDE.to_wire(self.amplitude_n),
            amplitude_load_q16: field::RIPPLE_LOAD.to_wire(self.amplitude_per_n),
        }
    }
}

impl UnitSettings {
    /// Tension past the setpoint with which a command at zero counts as too much, N
    /// (`control/src/plausible.rs`).
    pub const AT_LIMIT_N: f64 = 0.3;

    /// Tension that friction holds at a command of zero while the robot pulls the cable out, N. A
    /// motor can't push: no setpoint below it is reached then.
    #[must_use]
    pub fn held_by_friction_n(&self) -> f64 {
        (self.friction_offset_n + self.coulomb_n).max(0.0)
    }

    /// As the board is told. The zero in force is taken at each start; the rig file's is what it is
    /// compared with.
    #[must_use]
    pub fn to_wire(&self) -> UnitConfig {
        UnitConfig {
            enabled: self.enabled,
            scale_pn_per_count: field::SCALE.to_wire(self.scale_n_per_count),
            zero_code: 0,
            stored_zero_code: field::STORED_ZERO.to_wire(self.checks.zero_code),
            zero_deviation_un: field::ZERO_DEVIATION.to_wire(self.checks.zero_deviation_n),
            filter: match self.filter {
                Filter::MovingAverage(n) => FilterChoice::MovingAverage(n),
                Filter::LowPass(corner_hz) => FilterChoice::LowPass {
                    corner_chz: field::FILTER.to_wire(corner_hz) as u16,
                },
            },
            spike_limit_un: field::SPIKE_LIMIT.to_wire(self.spike_limit_n),
            kp_q16: field::KP.to_wire(self.kp),
            ki_q16: field::KI.to_wire(self.ki_per_s),
            kd_q16: field::KD.to_wire(self.kd_s),
            damping_q16: field::DAMPING.to_wire(self.damping_n_s_per_m),
            friction_feedforward: self.friction_feedforward,
            friction_offset_un: field::OFFSET.to_wire(self.friction_offset_n),
            friction_gain_q16: field::GAIN.to_wire(self.friction_gain),
            coulomb_un: field::COULOMB.to_wire(self.coulomb_n),
            coulomb_load_q16: field::COULOMB_LOAD.to_wire(self.coulomb_per_n),
            reversal_nm: field::REVERSAL.to_wire(self.reversal_m),
            travel_nm_per_count: field::TRAVEL.to_wire(self.travel_m_per_count),
            dac_counts_per_n_q16: field::DAC_SCALE.to_wire(self.dac_codes_per_n),
            force_limit_un: field::FORCE_LIMIT.to_wire(self.force_limit_n),
            authority_un: field::AUTHORITY.to_wire(self.checks.authority_n),
            plausible_un: field::PLAUSIBLE.to_wire(self.checks.plausible_n),
            slew_un_per_s: field::SLEW.to_wire(self.slew_n_per_s),
            over_tension_un: field::OVER_TENSION.to_wire(self.over_tension_n),
            viscous_q16: field::VISCOUS.to_wire(self.viscous_n_s_per_m),
            ripples: self
                .ripples
                .map(|ripple| ripple.to_wire(self.travel_m_per_count)),
            cell: self.cell.to_wire(),
            tension_max_un: field::TENSION_MAX.to_wire(self.tension_max_n),
            leaky_ki_q16: field::LEAKY_KI.to_wire(self.leaky_ki_per_s),
        }
    }

    /// A tension as a setpoint: at most the largest one, which rounding may pass.
    #[must_use]
    pub fn setpoint_un(&self, tension_n: f64) -> i32 {
        ((tension_n * 1e6).round() as i32).min(field::TENSION_MAX.to_wire(self.tension_max_n))
    }

    /// Direction from the tip to where the cable leaves the reel, and the cosine of the angle
    /// between cable and measuring axis; `None` where the tip sits on the exit.
    #[must_use]
    pub fn cable_at(&self, tip_m: Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
        use control::geometry::{cable_direction, cos_cell_angle};
        let direction = cable_direction(self.exit_m, tip_m)?;
        // The axis points to the workspace, the direction away from it.
        let cos = cos_cell_angle(direction, -self.axis)?;
        Some((direction, cos))
    }
}
