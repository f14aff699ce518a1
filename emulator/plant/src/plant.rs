//! The rig as a whole: inputs, virtual time, getters and the truth.

use crate::config::PlantConfig;
use crate::effects::payload_kg;
use crate::error::{ConfigError, InputError};
use crate::geometry::nominal_geometry;
use crate::tip::{Tip, TipModel};
use crate::unit::{Shared, Unit, UnitParameters};
use crate::vector::{add, norm, scale, Vec3};
use serde::Serialize;

/// An input that takes effect at a grid point.
#[derive(Clone, Copy, Debug)]
struct Latch<T> {
    value: T,
    pending: Option<(u64, T)>,
}

impl<T: Copy> Latch<T> {
    fn new(value: T) -> Self {
        Self {
            value,
            pending: None,
        }
    }

    /// Takes over what is due at grid point `step`, and returns the value in force there.
    #[inline]
    fn at(&mut self, step: u64) -> T {
        if let Some((due, value)) = self.pending {
            if due <= step {
                self.value = value;
                self.pending = None;
            }
        }
        self.value
    }

    /// `value` from grid point `due` on; `step` is the next point to be integrated from.
    fn set(&mut self, step: u64, due: u64, value: T) {
        self.at(step);
        self.pending = Some((due, value));
    }
}

/// The rig. See the crate's page for the physics.
#[derive(Clone, Debug)]
pub struct Plant {
    config: PlantConfig,
    shared: Shared,
    units: Vec<Unit>,
    tip: Tip,
    weight_n: Vec3,
    tip_force_n: Vec3,
    volts: Vec<Latch<f64>>,
    power: Latch<bool>,
    moving: Latch<bool>,
    /// Steps integrated: the state is that of `step * step_ns`.
    step: u64,
    now_ns: u64,
}

impl Plant {
    /// A rig at rest: amplifiers off, 0 V, cables as configured, the robot standing at the start of
    /// its path. All scatter is drawn from `seed`.
    ///
    /// # Errors
    /// [`ConfigError`] names the first key that the physics can't take.
    pub fn new(config: PlantConfig, seed: u64) -> Result<Self, ConfigError> {
        Self::of_run(config, seed, 0)
    }

    /// As [`Plant::new`], for a further run of the same rig: the robot's path is drawn anew where
    /// the configuration draws it, every figure of the units stays, and an effect that changes goes
    /// on where its configuration says so. Run 0 is that of [`Plant::new`].
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn of_run(config: PlantConfig, seed: u64, run: u64) -> Result<Self, ConfigError> {
        config.validate()?;
        let tip = Tip::new(&config, crate::rng::seed_of_run(seed, run));
        Ok(Self::with_tip(config, (seed, run), tip))
    }

    /// As [`Plant::new`], with a model of a robot at the cables' ends: of `config.robot` only the
    /// workspace centre counts then, at which the load cells aim.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn with_robot(
        config: PlantConfig,
        seed: u64,
        robot: Box<dyn TipModel>,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self::with_tip(config, (seed, 0), Tip::with_model(robot)))
    }

    /// The model given to [`Plant::with_robot`]; upcast to [`std::any::Any`] for its own interface.
    pub fn robot_mut(&mut self) -> Option<&mut dyn TipModel> {
        self.tip.model_mut()
    }

    /// `config` is valid.
    fn with_tip(config: PlantConfig, seed_and_run: (u64, u64), tip: Tip) -> Self {
        let shared = Shared::new(&config);
        let units: Vec<Unit> = nominal_geometry(&config)
            .iter()
            .enumerate()
            .map(|(i, n)| Unit::new(&config, &shared, n, i, seed_and_run, tip.position_m))
            .collect();
        let weight_n = scale(
            config.load_cell.gravity_m_per_s2,
            payload_kg(&config.effects),
        );
        Self {
            volts: vec![Latch::new(0.0); units.len()],
            power: Latch::new(false),
            moving: Latch::new(false),
            tip_force_n: weight_n,
            weight_n,
            shared,
            units,
            tip,
            config,
            step: 0,
            now_ns: 0,
        }
    }

    /// Runs the rig on to virtual time `t_ns`. Times that have passed are ignored.
    pub fn advance_to(&mut self, t_ns: u64) {
        let last = t_ns / self.config.step_ns;
        while self.step < last {
            self.integrate();
        }
        self.now_ns = self.now_ns.max(t_ns);
    }

    fn integrate(&mut self) {
        let time_s = self.state_time_s();
        let powered = self.power.at(self.step);
        let moving = self.moving.at(self.step);
        for (unit, volts) in self.units.iter_mut().zip(&mut self.volts) {
            unit.step(&self.shared, volts.at(self.step), powered, time_s);
        }
        self.tip.step(self.shared.h_s, moving, self.tip_force_n);
        let mut force = self.weight_n;
        for unit in &mut self.units {
            unit.follow_tip(&self.shared, self.tip.position_m, self.tip.velocity_m_per_s);
            force = add(force, scale(unit.direction(), unit.tension_n()));
        }
        self.tip_force_n = force;
        self.step += 1;
    }

    /// First grid point at or after the time reached.
    fn due(&self) -> u64 {
        self.now_ns.div_ceil(self.config.step_ns)
    }

    fn check(&self, unit: usize) -> Result<(), InputError> {
        if unit < self.units.len() {
            Ok(())
        } else {
            Err(InputError::NoSuchUnit {
                unit,
                units: self.units.len(),
            })
        }
    }

    /// Sets the amplifier input of `unit` (from 0), V; positive winds cable in. Clamped to the
    /// input range.
    ///
    /// # Errors
    /// No such unit: nothing changes. NaN or infinite: the unit gets 0 V.
    pub fn set_amplifier_volts(&mut self, unit: usize, volts: f64) -> Result<(), InputError> {
        self.check(unit)?;
        let due = self.due();
        let finite = volts.is_finite();
        self.volts[unit].set(self.step, due, if finite { volts } else { 0.0 });
        if finite {
            Ok(())
        } else {
            Err(InputError::NotAVoltage { unit })
        }
    }

    /// Lays `slack_m` of cable loose at `unit` (from 0), as for a unit that is not used: its cable
    /// can't get taut before the tip has moved by as much.
    ///
    /// # Errors
    /// No such unit: nothing changes.
    pub fn lay_loose(&mut self, unit: usize, slack_m: f64) -> Result<(), InputError> {
        self.check(unit)?;
        self.units[unit].lay_loose(slack_m);
        Ok(())
    }

    /// Lets a hand pull `travel_m` of cable out of `unit` (from 0), at 50 mm/s and with 3 N on the
    /// cell; negative: a hand winds it in by turning the reel. The plant's tension is the cable's
    /// at the tip, and does not show the hand.
    ///
    /// # Errors
    /// No such unit.
    pub fn pull_out(&mut self, unit: usize, travel_m: f64) -> Result<(), InputError> {
        self.check(unit)?;
        self.units[unit].pull_out(travel_m);
        Ok(())
    }

    /// Switches the amplifiers' power: the relay of the PLC, opened by the E-stop.
    pub fn set_amplifier_power(&mut self, on: bool) {
        let due = self.due();
        self.power.set(self.step, due, on);
    }

    /// Lets the robot follow its path, or stand. Its speed ramps up and down (`robot.ramp_s`).
    pub fn set_robot_moving(&mut self, moving: bool) {
        let due = self.due();
        self.moving.set(self.step, due, moving);
    }

    /// Virtual time reached, ns.
    pub fn time_ns(&self) -> u64 {
        self.now_ns
    }

    fn state_time_s(&self) -> f64 {
        (self.step * self.config.step_ns) as f64 * 1e-9
    }

    /// Number of units.
    pub fn units(&self) -> usize {
        self.units.len()
    }

    /// The configuration in force.
    pub fn config(&self) -> &PlantConfig {
        &self.config
    }

    /// The true figures of `unit`, as drawn from the seed. Panics when the unit does not exist,
    /// like every getter below.
    pub fn parameters(&self, unit: usize) -> &UnitParameters {
        &self.units[unit].parameters
    }

    /// Hangs a weight of so many newtons on a unit's cell, along its axis, in place of the one
    /// before; 0 takes it off.
    pub fn hang_on_cell(&mut self, unit: usize, newtons: f64) {
        if let Some(unit) = self.units.get_mut(unit) {
            unit.hang(newtons);
        }
    }

    /// Takes the tip off the robot, which stands where it is, and hangs a weight of so many newtons
    /// on it, ring included, in place of the one before: the cables alone carry it from now on.
    ///
    /// # Errors
    /// Negative or not finite, no gravity, or a model holds the tip ([`Plant::with_robot`]):
    /// nothing changes.
    pub fn hang_on_tip(&mut self, newtons: f64) -> Result<(), InputError> {
        let gravity = self.config.load_cell.gravity_m_per_s2;
        let size = norm(gravity);
        if !(newtons.is_finite() && newtons >= 0.0 && size > 0.0) {
            return Err(InputError::NotAWeight { newtons });
        }
        if !self.tip.let_go(newtons, size) {
            return Err(InputError::TipIsHeld);
        }
        self.weight_n = scale(gravity, newtons / size);
        Ok(())
    }

    /// Position and velocity of the tip as the robot reports them, m and m/s. It does not see a tip
    /// that it has let go ([`Plant::hang_on_tip`]).
    pub fn robot_says(&self) -> (Vec3, Vec3) {
        self.tip.robot_says()
    }

    /// Cable tension, N, never negative.
    pub fn tension_n(&self, unit: usize) -> f64 {
        self.units[unit].tension_n()
    }

    /// Cable force along the cell's axis, N: `T cos(theta)`, what a perfect cell would weigh.
    pub fn cell_force_n(&self, unit: usize) -> f64 {
        self.units[unit].tension_n() * self.units[unit].cosine()
    }

    /// Bridge output of the load cell, V/V of excitation: 2e-3 at 3 kg for a perfect cell.
    pub fn bridge_v_per_v(&self, unit: usize) -> f64 {
        self.units[unit].bridge_v_per_v(&self.shared, self.state_time_s(), |other| {
            let source = &self.units[other];
            source.cell_load_n(&self.shared) - source.parameters.assembly_weight_n
        })
    }

    /// Temperature at the cell, degrees Celsius; 25 unless an effect warms the rig.
    pub fn temperature_c(&self, unit: usize) -> f64 {
        25.0 + self.units[unit].temperature_rise_k(self.state_time_s())
    }

    /// Encoder position since the start, quadrature counts at x4. Falls while the reel winds in
    /// when `drive.encoder_inverted`.
    pub fn encoder_counts(&self, unit: usize) -> i64 {
        self.units[unit].encoder_counts(&self.shared)
    }

    /// The encoder's two lines, A and B: one changes per count, A leads while counts rise.
    pub fn encoder_lines(&self, unit: usize) -> (bool, bool) {
        let phase = self.encoder_counts(unit).rem_euclid(4);
        (phase == 1 || phase == 2, phase >= 2)
    }

    /// Motor current, A.
    pub fn current_a(&self, unit: usize) -> f64 {
        self.units[unit].current_a()
    }

    /// Reel angle since the start, rad, positive winding in.
    pub fn reel_rad(&self, unit: usize) -> f64 {
        self.units[unit].reel_rad(&self.shared)
    }

    /// Reel speed, rad/s.
    pub fn reel_rad_per_s(&self, unit: usize) -> f64 {
        self.units[unit].reel_rad_per_s(&self.shared)
    }

    /// Tip position, robot frame, m.
    pub fn tip_position_m(&self) -> Vec3 {
        self.tip.position_m
    }

    /// Tip velocity along its path, m/s; a compliant tip's giving way is not in it.
    pub fn tip_velocity_m_per_s(&self) -> Vec3 {
        self.tip.velocity_m_per_s
    }

    /// Force on the tip, N: all tensions along their true directions, and the payload's weight.
    pub fn tip_force_n(&self) -> Vec3 {
        self.tip_force_n
    }

    /// Mechanical energy stored in `unit`, J: motion, cable, flexure, sticking contact.
    pub fn stored_energy_j(&self, unit: usize) -> f64 {
        self.units[unit].energy_j(&self.shared)
    }

    /// All of the state that no sensor shows, at the last grid point.
    pub fn truth(&self) -> Truth {
        Truth {
            time_s: self.state_time_s(),
            amplifier_power: self.power.value,
            robot_moving: self.moving.value,
            tip_position_m: self.tip.position_m,
            tip_velocity_m_per_s: self.tip.velocity_m_per_s,
            tip_force_n: self.tip_force_n,
            units: (0..self.units.len()).map(|i| self.unit_truth(i)).collect(),
        }
    }

    fn unit_truth(&self, i: usize) -> UnitTruth {
        let unit = &self.units[i];
        UnitTruth {
            amplifier_volts: self.volts[i].value,
            current_a: unit.current_a(),
            tension_n: unit.tension_n(),
            cell_force_n: self.cell_force_n(i),
            cell_load_n: unit.cell_load_n(&self.shared),
            bridge_v_per_v: self.bridge_v_per_v(i),
            encoder_counts: self.encoder_counts(i),
            reel_rad: self.reel_rad(i),
            reel_rad_per_s: self.reel_rad_per_s(i),
            slack_m: (-unit.stretch_m()).max(0.0),
            cable_direction: unit.direction(),
            cable_length_m: unit.distance_m(),
        }
    }
}

/// The rig's state at one instant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// Virtual time of the state, s.
    pub time_s: f64,
    /// Amplifiers powered.
    pub amplifier_power: bool,
    /// The robot has a command to move.
    pub robot_moving: bool,
    /// Tip position, robot frame, m.
    pub tip_position_m: Vec3,
    /// Tip velocity along its path, m/s; a compliant tip's giving way is not in it.
    pub tip_velocity_m_per_s: Vec3,
    /// Force on the tip, N.
    pub tip_force_n: Vec3,
    /// The units, in the configuration's order.
    pub units: Vec<UnitTruth>,
}

/// One unit's state at one instant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnitTruth {
    /// Amplifier input in force, V.
    pub amplifier_volts: f64,
    /// Motor current, A.
    pub current_a: f64,
    /// Cable tension, N.
    pub tension_n: f64,
    /// Cable force along the cell's axis, N.
    pub cell_force_n: f64,
    /// All that the flexure carries, weight and inertia of the motor assembly included, N.
    pub cell_load_n: f64,
    /// Bridge output, V/V.
    pub bridge_v_per_v: f64,
    /// Quadrature counts since the start.
    pub encoder_counts: i64,
    /// Reel angle since the start, rad, positive winding in.
    pub reel_rad: f64,
    /// Reel speed, rad/s.
    pub reel_rad_per_s: f64,
    /// Length by which the cable is slack, m; 0 when taut.
    pub slack_m: f64,
    /// From the tip to the point where the cable leaves the reel, unit vector.
    pub cable_direction: Vec3,
    /// Distance between the two, m.
    pub cable_length_m: f64,
}
