//! What a rig is made of: every figure of the physics, its unit in its name, its source beside it.
//!
//! [`PlantConfig::default`] is the rig of the thesis (Raven-II force units). Sources: *thesis* is
//! its chapter 3; *Raven* the public Raven-II source and its hardware notes; *measured* the rig's
//! own force-gauge records, fitted; *estimate* an engineer's figure with its reasoning, not
//! confirmed on the device. Lists in a TOML file replace the default list as a whole; unknown keys
//! are refused.

mod validate;

use crate::effects::Effect;
use crate::error::{ConfigError, Within};
use crate::vector::Vec3;
use serde::{Deserialize, Serialize};

/// Standard gravity, m/s^2, by which a load cell's capacity in kg becomes a force.
pub const STANDARD_GRAVITY_M_PER_S2: f64 = 9.80665;

/// The whole rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlantConfig {
    /// Grid of the simulation, ns, 1 us to 100 us. 50 us keeps the fastest mode (rotor on a
    /// sticking gear, about 100 Hz) at 200 steps a period.
    pub step_ns: u64,
    /// Servo amplifier, the same for all units.
    pub amplifier: AmplifierConfig,
    /// Motor, gear and reel.
    pub drive: DriveConfig,
    /// Friction of the drive.
    pub friction: FrictionConfig,
    /// Cable.
    pub cable: CableConfig,
    /// Load cell and the motor assembly that hangs on it.
    pub load_cell: LoadCellConfig,
    /// The robot that holds the cables' other ends.
    pub robot: RobotConfig,
    /// How far the surveyed geometry is from the real one.
    pub survey: SurveyConfig,
    /// The force units, 1 to 16.
    pub units: Vec<UnitConfig>,
    /// Physical effects beyond the rig above. Default none.
    pub effects: Vec<Effect>,
}

impl Default for PlantConfig {
    fn default() -> Self {
        // Thesis 3.2: three roughly orthogonal directions, two units on each, approximately
        // antiparallel. The thesis prints no coordinates; these are an example (estimate), 0.37 to
        // 0.44 m from the centre and 4 to 11 degrees off antiparallel, as frames around a robot arm
        // come out.
        let positions = [
            [0.335, 0.045, -0.110],
            [-0.480, 0.010, -0.165],
            [-0.055, 0.440, -0.120],
            [-0.090, -0.375, -0.190],
            [-0.065, 0.055, 0.275],
            [-0.100, -0.030, -0.520],
        ];
        let tilts = [
            [0.010, -0.014],
            [-0.012, 0.009],
            [0.016, 0.006],
            [-0.007, -0.013],
            [0.012, 0.011],
            [-0.015, 0.005],
        ];
        Self {
            step_ns: 50_000,
            amplifier: AmplifierConfig::default(),
            drive: DriveConfig::default(),
            friction: FrictionConfig::default(),
            cable: CableConfig::default(),
            load_cell: LoadCellConfig::default(),
            robot: RobotConfig::default(),
            survey: SurveyConfig::default(),
            units: positions
                .into_iter()
                .zip(tilts)
                .map(|(position_m, axis_tilt_rad)| UnitConfig {
                    position_m,
                    axis_tilt_rad,
                })
                .collect(),
            effects: Vec::new(),
        }
    }
}

/// The parts of the rig. A row: name, type and default of a figure, and its range where it has one;
/// each number of a vector is within it.
macro_rules! figures {
    ($($(#[$doc:meta])* $part:ident {
        $($(#[$field_doc:meta])* $field:ident: $type:ident = $default:expr $(, $low:literal ..= $high:literal)?;)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $part {
            $($(#[$field_doc])* pub $field: $type,)*
        }

        impl Default for $part {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        impl $part {
            /// Checks each figure against its range; `key` is where the part stands in the
            /// configuration.
            fn check(&self, key: &str) -> Result<(), ConfigError> {
                $($(self.$field.within(&format!("{key}.{}", stringify!($field)), $low, $high)?;)?)*
                Ok(())
            }
        }
    )*};
}

figures! {
    /// Servo amplifier in current mode.
    AmplifierConfig {
        /// Current per input volt, A/V. Z6A6: 0.6 (Raven); Z12A8: 1.2 (Raven).
        gain_a_per_v: f64 = 0.6, 1e-3 ..= 100.0;
        /// Inputs beyond this are clamped, V. 10 (range of the DAC).
        input_limit_v: f64 = 10.0, 0.1 ..= 100.0;
        /// Bandwidth of the current loop, first order, Hz. 1500: estimate, 1 to 2.5 kHz is usual
        /// for analogue drives on small inductances.
        bandwidth_hz: f64 = 1500.0, 1.0 ..= 1e5;
        /// Largest current, A. 6: the "6" of Z6A6 is its peak current.
        current_limit_a: f64 = 6.0, 1e-2 ..= 1e3;
        /// Motor supply, V. 48 (thesis 3.4.1). With back-EMF and resistance it bounds the reel's
        /// speed.
        supply_v: f64 = 48.0, 1.0 ..= 1e3;
    }

    /// Motor, planetary gear, reel and encoder.
    DriveConfig {
        /// Torque constant, N.m/A. 0.0521 (thesis 3.2.2).
        torque_constant_n_m_per_a: f64 = 0.0521, 1e-4 ..= 10.0;
        /// Winding resistance, ohm. 2.5: estimate, class of a 30 mm, 48 V coreless maxon motor
        /// (RE 30) with a torque constant near 52 mN.m/A; the rig's motor is custom-made.
        resistance_ohm: f64 = 2.5, 1e-3 ..= 1e3;
        /// Rotor inertia, kg.m^2. 3.4e-6 (34 g.cm^2): estimate, same class.
        rotor_inertia_kg_m2: f64 = 3.4e-6, 1e-8 ..= 1.0;
        /// Inertia of gear and encoder disc at the motor shaft, kg.m^2. 1.5e-7: estimate, 32 mm
        /// planetary gear.
        gear_inertia_kg_m2: f64 = 1.5e-7, 0.0 ..= 1.0;
        /// Inertia of the reel at its own shaft, kg.m^2. 2e-6: estimate, a printed PLA reel of 10
        /// mm with flanges and coupling.
        reel_inertia_kg_m2: f64 = 2.0e-6, 0.0 ..= 1.0;
        /// Motor turns per reel turn. 26/7 (thesis: 3.7:1).
        gear_ratio: f64 = 26.0 / 7.0, 0.1 ..= 1e3;
        /// Reel radius at the cable, m. 0.010 (thesis 3.2.4).
        reel_radius_m: f64 = 0.010, 1e-3 ..= 1.0;
        /// Quadrature counts per motor turn at x4. 4000 (Raven).
        encoder_counts_per_turn: u32 = 4000;
        /// True when the counts fall while the reel winds cable in under positive current, as on
        /// Raven, whose software negates them.
        encoder_inverted: bool = true;
    }

    /// Friction of the drive at the cable. The measured law, over the rig's units, with `u` the
    /// loss-free pull: `T = offset + gain u - sign(v) (coulomb + per_load u)`.
    FrictionConfig {
        /// Constant pull, N. 0.155 (measured).
        offset_n: f64 = 0.155, -10.0 ..= 10.0;
        /// Standard deviation of the offset between units, N. 0.027 (measured: units fitted one by
        /// one).
        offset_sd_n: f64 = 0.027, 0.0 ..= 1.0;
        /// Real pull per loss-free pull. 1.018 (measured).
        gain: f64 = 1.018, 0.1 ..= 10.0;
        /// Standard deviation of the gain between units. 0.007 (measured).
        gain_sd: f64 = 0.007, 0.0 ..= 0.2;
        /// Coulomb friction without load, N. 0.909 (measured).
        coulomb_n: f64 = 0.909, 0.0 ..= 100.0;
        /// Relative standard deviation of the Coulomb friction between units. 0.05 (measured: 0.065
        /// with the error of the fit in it).
        coulomb_relative_sd: f64 = 0.05, 0.0 ..= 0.3;
        /// Friction per motor pull. 0.154 (measured).
        per_load: f64 = 0.154, 0.0 ..= 0.9;
        /// Relative standard deviation of `per_load` between units. 0.08 (measured: 0.10, see
        /// above).
        per_load_relative_sd: f64 = 0.08, 0.0 ..= 0.3;
        /// Breakaway over kinetic friction, >= 1. 1.04: estimate; static above Coulomb friction by
        /// thesis 3.6, and small, since a Stribeck term explains under 1 % of the measured error
        /// and larger values make the rig stick and slip at its usual speeds.
        breakaway_ratio: f64 = 1.04, 1.0 ..= 3.0;
        /// Cable speed at which the excess of breakaway has fallen to a quarter, m/s. 1e-3:
        /// estimate.
        stribeck_velocity_m_per_s: f64 = 1.0e-3, 1e-5 ..= 1.0;
        /// Cable travel from relaxed contact to sliding at the friction level of a 6 N pull, m.
        /// 3e-5 (7 counts of the encoder): estimate, elastic wind-up of gear and bearings.
        presliding_m: f64 = 3.0e-5, 1e-6 ..= 1e-2;
        /// Damping ratio of the rotor on the sticking contact. 0.1: estimate.
        presliding_damping_ratio: f64 = 0.1, 0.0 ..= 1.0;
        /// Viscous friction, N.s/m at the cable. 0.5: estimate, a few mN at the rig's speeds;
        /// measured as immaterial.
        viscous_n_s_per_m: f64 = 0.5, 0.0 ..= 1e3;
    }

    /// Cable between reel and tip.
    CableConfig {
        /// Axial stiffness EA, N: tension per strain. 10_000: estimate, a 0.8 mm braid of
        /// high-modulus polyethylene of about 300 tex at some 35 N/tex (fibre: 110 N/tex; braids
        /// without matrix lie far below, see Sry et al., Appl. Sci. 8 (2018) 1096). At 0.42 m: 24
        /// N/mm. 0.5 mm stranded steel is alike.
        axial_stiffness_n: f64 = 10_000.0, 10.0 ..= 2e5;
        /// Damping time of the cable, s: damping is stiffness times this. 8e-4: estimate, 9 % of
        /// critical with the reflected rotor mass: braids and a printed reel are lossy.
        damping_s: f64 = 8.0e-4, 0.0 ..= 5e-3;
        /// Slack at the start, m, >= 0. 0: just taut at zero tension.
        initial_slack_m: f64 = 0.0, 0.0 ..= 1.0;
    }

    /// Shear-beam load cell between motor mount and base.
    LoadCellConfig {
        /// Capacity, kg. 3 (thesis 3.2.3).
        capacity_kg: f64 = 3.0, 1e-2 ..= 1e4;
        /// Output at capacity, V/V. 0.002 (2 mV/V, usual for this cell).
        rated_output_v_per_v: f64 = 0.002, 1e-5 ..= 0.1;
        /// Standard deviation of the relative gain error between cells. 0.04 (calibration factors
        /// on file spread from 6.2e-6 to 7.3e-6 N/count).
        gain_error_sd: f64 = 0.04, 0.0 ..= 0.3;
        /// Standard deviation of the output without load, V/V. 3e-5: estimate, zero balance of
        /// cheap cells.
        zero_sd_v_per_v: f64 = 3.0e-5, 0.0 ..= 0.01;
        /// Flexure stiffness, N/m. 1e5: estimate, 0.3 mm at capacity.
        stiffness_n_per_m: f64 = 1.0e5, 1e2 ..= 1e7;
        /// Damping ratio of the motor assembly on the flexure. 0.05: estimate, printed PLA parts.
        damping_ratio: f64 = 0.05, 0.0 ..= 2.0;
        /// Mass of motor and rack carried by the cell, kg. 0.5 (thesis 3.5.1): gravity along the
        /// axis is part of the zero offset, and mass and flexure ring at about 70 Hz.
        assembly_mass_kg: f64 = 0.5, 1e-2 ..= 1e2;
        /// Gravity in the robot frame, m/s^2.
        gravity_m_per_s2: Vec3 = [0.0, 0.0, -STANDARD_GRAVITY_M_PER_S2], -100.0 ..= 100.0;
    }

    /// The robot's tip.
    RobotConfig {
        /// Centre of the workspace, robot frame, m. An example (estimate): the thesis prints none.
        workspace_center_m: Vec3 = [-0.080, 0.025, -0.140], -100.0 ..= 100.0;
        /// Time in which motion ramps in and out, s, >= 0.
        ramp_s: f64 = 1.0, 0.0 ..= 1e3;
        /// Give of the position-controlled tip, m/N, the same in all directions. 0: stiff.
        tip_compliance_m_per_n: f64 = 0.0, 0.0 ..= 0.01;
        /// Time constant with which the tip gives, s, >= 1e-3.
        tip_relaxation_s: f64 = 5.0e-3, 1e-3 ..= 10.0;
        /// Where the tip goes while the robot moves.
        path: PathConfig = PathConfig::default();
    }

    /// Seed-drawn sums of sinusoids, one sum per axis.
    RandomPath {
        /// Half the box that the path never leaves, m.
        half_extent_m: Vec3 = [0.030; 3], 0.0 ..= 10.0;
        /// Root mean square of the tip's speed, m/s. 0.012: estimate, the slow moves of the thesis.
        rms_speed_m_per_s: f64 = 0.012, 0.0 ..= 10.0;
        /// Sinusoids per axis, 1 to 16.
        harmonics: usize = 3;
        /// Longest over shortest period, > 1. The periods themselves follow from the speed.
        period_ratio: f64 = 4.0, 1.0 ..= 1e3;
    }

    /// A triangle wave along a line through the centre.
    SweepPath {
        /// Direction of the line, any length but zero.
        direction: Vec3 = [1.0, 0.0, 0.0], -1e6 ..= 1e6;
        /// Largest distance from the centre, m.
        amplitude_m: f64 = 0.015, 1e-6 ..= 10.0;
        /// Speed between the turning points, m/s.
        speed_m_per_s: f64 = 0.005, 0.0 ..= 10.0;
    }

    /// A tip that stands still.
    FixedPath {
        /// Offset from the workspace centre, m.
        offset_m: Vec3 = [0.0; 3], -10.0 ..= 10.0;
    }

    /// Errors of the survey with the coordinate measuring arm (thesis 3.5.2), drawn per unit from
    /// the seed.
    SurveyConfig {
        /// Standard deviation of a unit's position per coordinate, m. 5e-4: estimate, a chain of
        /// plates adds to the arm's own 0.05 to 0.1 mm.
        position_sd_m: f64 = 5.0e-4, 0.0 ..= 0.02;
        /// Standard deviation of an axis about each perpendicular, rad. 5e-3: estimate, three
        /// points on 30 mm.
        axis_sd_rad: f64 = 5.0e-3, 0.0 ..= 0.2;
    }
}

impl DriveConfig {
    /// Pull at the cable per motor current without losses, N/A (19.35 for the rig).
    pub fn tension_per_current_n_per_a(&self) -> f64 {
        self.torque_constant_n_m_per_a * self.gear_ratio / self.reel_radius_m
    }

    /// Mass that the rotating parts show at the cable, kg (about 0.51 for the rig).
    pub fn reflected_mass_kg(&self) -> f64 {
        let motor_side =
            (self.rotor_inertia_kg_m2 + self.gear_inertia_kg_m2) * self.gear_ratio.powi(2);
        (motor_side + self.reel_inertia_kg_m2) / self.reel_radius_m.powi(2)
    }
}

/// A prescribed path about the workspace centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum PathConfig {
    /// Sums of sinusoids drawn from the seed, as in the thesis (section 4.1).
    Random(RandomPath),
    /// Back and forth along a line at constant speed: the force-gauge experiment.
    Sweep(SweepPath),
    /// Stands at an offset from the centre.
    Fixed(FixedPath),
}

impl Default for PathConfig {
    fn default() -> Self {
        Self::Random(RandomPath::default())
    }
}

/// Mounting of one force unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitConfig {
    /// Where the cable leaves the reel, robot frame, m. A fixed point, as in the thesis (3.7).
    pub position_m: Vec3,
    /// Misalignment of the cell's axis from the line to the workspace centre, rad, about two
    /// perpendiculars. Known to the survey.
    #[serde(default)]
    pub axis_tilt_rad: [f64; 2],
}

/// Largest number of units in one plant.
pub const MAX_UNITS: usize = 16;
