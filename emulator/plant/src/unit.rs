//! One force unit: amplifier, motor, gear, friction, reel, cable and load cell, a step at a time.

use crate::config::{PlantConfig, STANDARD_GRAVITY_M_PER_S2};
use crate::effects::{Backlash, Modifiers};
use crate::friction::MaxwellSlip;
use crate::geometry::NominalUnit;
use crate::rng::FURTHEST;
use crate::vector::{add, dot, norm, scale, sub, tilted, Vec3};
use random::SplitMix64;
use serde::Serialize;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Shortest cable that the stiffness is computed for, m: a reel that runs away must not make it
/// infinite.
const SHORTEST_CABLE_M: f64 = 0.1;
/// Pull at which the presliding distance of the configuration holds, N.
const PRESLIDING_PULL_N: f64 = 6.0;
/// Contact between gear and reel when there is play: stiffness, N/m, and damping, N.s/m (0.3 of
/// critical with the smallest reel mass, 0.02 kg).
const MESH_STIFFNESS_N_PER_M: f64 = 1.0e5;
const MESH_DAMPING_N_S_PER_M: f64 = 27.0;
pub(crate) const SMALLEST_REEL_MASS_KG: f64 = 0.02;
/// Presliding of the reel's own bearing when there is play, m.
const BEARING_PRESLIDING_M: f64 = 1.0e-5;
/// Speed at which a hand pulls cable out or winds it in, m/s: 200 mm in 4 s.
const HAND_M_PER_S: f64 = 0.05;
/// Force with which a hand pulls cable out, N: three times the friction of a reel at rest.
const HAND_N: f64 = 3.0;

/// What was drawn from the seed for one unit: its true figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnitParameters {
    /// Where the cable leaves the reel, robot frame, m.
    pub position_m: Vec3,
    /// Measuring axis of the cell, toward the workspace centre.
    pub axis: Vec3,
    /// Constant pull, N.
    pub offset_n: f64,
    /// Real pull per loss-free pull.
    pub gain: f64,
    /// Coulomb friction without load, N.
    pub coulomb_n: f64,
    /// Coulomb friction per motor pull.
    pub per_load: f64,
    /// Bridge output per force along the axis, (V/V)/N. What a calibration with weights finds.
    pub bridge_per_n: f64,
    /// Bridge output of the unloaded cell without the motor assembly, V/V.
    pub bridge_zero_v_per_v: f64,
    /// Weight of the motor assembly along the axis, N: part of the zero that the mounted cell
    /// shows.
    pub assembly_weight_n: f64,
    /// Encoder position at the start, counts, 0 to 1: where between two edges the disc stands.
    pub encoder_phase_counts: f64,
}

impl UnitParameters {
    fn draw(
        config: &PlantConfig,
        nominal: &NominalUnit,
        unit: usize,
        seed: u64,
        cell_tilt_rad: [f64; 2],
    ) -> Self {
        let mut survey = SplitMix64::stream(seed, "survey", unit);
        let sd = config.survey.position_sd_m;
        let position_error = [0; 3].map(|_| sd * survey.normal_within(FURTHEST));
        let tilt = cell_tilt_rad
            .map(|tilt| tilt + config.survey.axis_sd_rad * survey.normal_within(FURTHEST));
        let axis = tilted(nominal.axis, tilt);

        let f = &config.friction;
        let mut friction = SplitMix64::stream(seed, "friction", unit);
        let offset_n = f.offset_n + f.offset_sd_n * friction.normal_within(FURTHEST);
        let gain = f.gain + f.gain_sd * friction.normal_within(FURTHEST);
        let coulomb_n =
            f.coulomb_n * (1.0 + f.coulomb_relative_sd * friction.normal_within(FURTHEST));
        let per_load =
            f.per_load * (1.0 + f.per_load_relative_sd * friction.normal_within(FURTHEST));

        let l = &config.load_cell;
        let mut cell = SplitMix64::stream(seed, "load cell", unit);
        let nominal_per_n = l.rated_output_v_per_v / (l.capacity_kg * STANDARD_GRAVITY_M_PER_S2);
        Self {
            position_m: add(nominal.position_m, position_error),
            axis,
            offset_n,
            gain,
            coulomb_n,
            per_load,
            bridge_per_n: nominal_per_n * (1.0 + l.gain_error_sd * cell.normal_within(FURTHEST)),
            bridge_zero_v_per_v: l.zero_sd_v_per_v * cell.normal_within(FURTHEST),
            assembly_weight_n: l.assembly_mass_kg * dot(l.gravity_m_per_s2, axis),
            encoder_phase_counts: SplitMix64::stream(seed, "encoder", unit).unit(),
        }
    }
}

/// Figures of the configuration that every step of every unit uses. Reciprocals stand here because
/// divisions are most of the time of a step.
#[derive(Clone, Debug)]
pub(crate) struct Shared {
    pub h_s: f64,
    amplifier_gain_a_per_v: f64,
    input_limit_v: f64,
    current_limit_a: f64,
    supply_v: f64,
    per_ohm: f64,
    back_emf_v_s_per_m: f64,
    current_part: f64,
    n_per_a: f64,
    radius_m: f64,
    per_radius_m: f64,
    gear_ratio: f64,
    mass_kg: f64,
    reel_mass_kg: f64,
    breakaway_excess: f64,
    per_stribeck_velocity: f64,
    viscous_n_s_per_m: f64,
    cable_ea_n: f64,
    cable_damping_s: f64,
    cell_stiffness_n_per_m: f64,
    cell_damping_n_s_per_m: f64,
    cell_mass_kg: f64,
    /// Time step per mass of the motor assembly, s/kg.
    cell_h_per_kg: f64,
    counts_per_m: f64,
}

impl Shared {
    pub fn new(config: &PlantConfig) -> Self {
        let h_s = config.step_ns as f64 * 1e-9;
        let d = &config.drive;
        let a = &config.amplifier;
        let l = &config.load_cell;
        let motor_rad_per_m = d.gear_ratio / d.reel_radius_m;
        let counts_per_m = f64::from(d.encoder_counts_per_turn) / TAU * motor_rad_per_m;
        Self {
            h_s,
            amplifier_gain_a_per_v: a.gain_a_per_v,
            input_limit_v: a.input_limit_v,
            current_limit_a: a.current_limit_a,
            supply_v: a.supply_v,
            per_ohm: d.resistance_ohm.recip(),
            back_emf_v_s_per_m: d.torque_constant_n_m_per_a * motor_rad_per_m,
            current_part: 1.0 - libm::exp(-TAU * a.bandwidth_hz * h_s),
            n_per_a: d.tension_per_current_n_per_a(),
            radius_m: d.reel_radius_m,
            per_radius_m: d.reel_radius_m.recip(),
            gear_ratio: d.gear_ratio,
            mass_kg: d.reflected_mass_kg(),
            reel_mass_kg: (d.reel_inertia_kg_m2 / d.reel_radius_m.powi(2))
                .max(SMALLEST_REEL_MASS_KG),
            breakaway_excess: config.friction.breakaway_ratio - 1.0,
            per_stribeck_velocity: config.friction.stribeck_velocity_m_per_s.recip(),
            viscous_n_s_per_m: config.friction.viscous_n_s_per_m,
            cable_ea_n: config.cable.axial_stiffness_n,
            cable_damping_s: config.cable.damping_s,
            cell_stiffness_n_per_m: l.stiffness_n_per_m,
            cell_damping_n_s_per_m: 2.0
                * l.damping_ratio
                * (l.stiffness_n_per_m * l.assembly_mass_kg).sqrt(),
            cell_mass_kg: l.assembly_mass_kg,
            cell_h_per_kg: h_s / l.assembly_mass_kg,
            counts_per_m: if d.encoder_inverted {
                -counts_per_m
            } else {
                counts_per_m
            },
        }
    }
}

/// A reel behind play: its own position, speed, bearing.
#[derive(Clone, Debug)]
struct LooseReel {
    play: Backlash,
    wound_m: f64,
    speed_m_per_s: f64,
    bearing: MaxwellSlip,
}

impl LooseReel {
    /// Pull that the gear passes to the reel through the play, N: none inside the gap, never
    /// sticking.
    fn mesh_n(&self, drive_m: f64, drive_m_per_s: f64) -> f64 {
        let lead = drive_m - self.wound_m;
        let damping = MESH_DAMPING_N_S_PER_M * (drive_m_per_s - self.speed_m_per_s);
        let half = 0.5 * self.play.gap_m;
        if lead > half {
            (MESH_STIFFNESS_N_PER_M * (lead - half) + damping).max(0.0)
        } else if lead < -half {
            (MESH_STIFFNESS_N_PER_M * (lead + half) + damping).min(0.0)
        } else {
            0.0
        }
    }
}

/// Speed of a reel that a hand moves in this step, m/s; it stands still at the end. `left_m`: cable
/// that is still to be pulled out.
fn moved_by_hand(left_m: &mut f64, h_s: f64) -> f64 {
    let step_m = left_m.clamp(-HAND_M_PER_S * h_s, HAND_M_PER_S * h_s);
    *left_m -= step_m;
    if *left_m == 0.0 {
        return 0.0;
    }
    -step_m / h_s
}

/// State of one unit.
#[derive(Clone, Debug)]
pub(crate) struct Unit {
    pub parameters: UnitParameters,
    modifiers: Modifiers,
    mass_kg: f64,
    /// Time step per mass, s/kg.
    h_per_kg: f64,
    presliding_damping_n_s_per_m: f64,
    delay_line_v: VecDeque<f64>,
    /// Cable length at the start, geometry plus slack, m.
    rest_length_m: f64,
    current_a: f64,
    /// Cable wound in by the drive since the start, m.
    wound_m: f64,
    speed_m_per_s: f64,
    contact: MaxwellSlip,
    loose_reel: Option<LooseReel>,
    tension_n: f64,
    stretch_m: f64,
    /// From the tip to the exit point, unit vector.
    direction: Vec3,
    distance_m: f64,
    cosine: f64,
    /// Deflection of the flexure toward the workspace centre, m.
    flexure_m: f64,
    flexure_m_per_s: f64,
    creep_n: Vec<f64>,
    /// Pull on the cell from outside, along its axis, N: a weight that hangs there.
    external_n: f64,
    /// Cable that a hand is still to pull out, m; negative: to wind in.
    by_hand_m: f64,
}

impl Unit {
    pub fn new(
        config: &PlantConfig,
        shared: &Shared,
        nominal: &NominalUnit,
        unit: usize,
        (seed, run): (u64, u64),
        tip_m: Vec3,
    ) -> Self {
        let modifiers = Modifiers::for_unit(&config.effects, unit, run);
        let parameters = UnitParameters::draw(config, nominal, unit, seed, modifiers.cell_tilt_rad);
        let f = &config.friction;
        let loose_reel = modifiers.backlash.clone().map(|play| LooseReel {
            bearing: MaxwellSlip::new(play.reel_friction_n, BEARING_PRESLIDING_M),
            play,
            wound_m: 0.0,
            speed_m_per_s: 0.0,
        });
        let breakaway = f.breakaway_ratio
            * (parameters.coulomb_n + PRESLIDING_PULL_N * parameters.per_load).max(0.01);
        let mut contact = MaxwellSlip::new(breakaway, f.presliding_m);
        // At rest the contact holds the constant pull, as far as its first element reaches.
        let held = parameters.offset_n / contact.stiffness_n_per_m();
        contact.slide(held, parameters.coulomb_n.max(0.0));
        let reel_mass = loose_reel.as_ref().map_or(0.0, |_| shared.reel_mass_kg);
        let mass_kg = (shared.mass_kg + modifiers.mass_kg - reel_mass).max(0.5 * shared.mass_kg);
        let to_exit = sub(parameters.position_m, tip_m);
        let distance_m = norm(to_exit);
        let steps = (modifiers.delay_s / shared.h_s).round() as usize;
        let flexure_m = parameters.assembly_weight_n / shared.cell_stiffness_n_per_m;
        let direction = scale(to_exit, 1.0 / distance_m);
        let cosine = -dot(parameters.axis, direction);
        let mut unit = Self {
            presliding_damping_n_s_per_m: 2.0
                * f.presliding_damping_ratio
                * (contact.stiffness_n_per_m() * mass_kg).sqrt(),
            delay_line_v: vec![0.0; steps].into(),
            // The assembly's own weight has bent the flexure before the cable was cut to length.
            rest_length_m: distance_m - flexure_m * cosine + config.cable.initial_slack_m,
            creep_n: vec![0.0; modifiers.creep.len()],
            parameters,
            modifiers,
            mass_kg,
            h_per_kg: shared.h_s / mass_kg,
            current_a: 0.0,
            wound_m: 0.0,
            speed_m_per_s: 0.0,
            contact,
            loose_reel,
            tension_n: 0.0,
            stretch_m: 0.0,
            direction,
            distance_m,
            cosine,
            flexure_m,
            flexure_m_per_s: 0.0,
            external_n: 0.0,
            by_hand_m: 0.0,
        };
        // A cell that hung there for long has crept under the assembly's weight.
        let weight = unit.parameters.assembly_weight_n;
        for (state, creep) in unit.creep_n.iter_mut().zip(&unit.modifiers.creep) {
            *state = creep.fraction * weight;
        }
        unit
    }

    /// Moves everything but the geometry on by one step, under the tension of its start.
    #[inline]
    pub fn step(&mut self, c: &Shared, input_v: f64, powered: bool, time_s: f64) {
        let h = c.h_s;
        let m = &self.modifiers;

        // Amplifier. Without power the bridge is open and the current decays with the bandwidth of
        // the current loop.
        let volts = if self.delay_line_v.is_empty() {
            input_v
        } else {
            self.delay_line_v.push_back(input_v);
            self.delay_line_v.pop_front().unwrap_or(0.0)
        };
        let target_a = if powered {
            let back_emf = c.back_emf_v_s_per_m * self.speed_m_per_s;
            let gain = c.amplifier_gain_a_per_v * (1.0 + m.amplifier_gain_error);
            (gain * volts.clamp(-c.input_limit_v, c.input_limit_v))
                .clamp(-c.current_limit_a, c.current_limit_a)
                .max((-c.supply_v - back_emf) * c.per_ohm)
                .min((c.supply_v - back_emf) * c.per_ohm)
        } else {
            0.0
        };
        self.current_a += c.current_part * (target_a - self.current_a);

        // Drive.
        let pull = c.n_per_a * self.current_a;
        let reel_rad = self.wound_m * c.per_radius_m;
        let v = self.speed_m_per_s;
        let load_n = match &self.loose_reel {
            None => self.tension_n,
            Some(reel) => reel.mesh_n(self.wound_m, v),
        };
        let damping = c.viscous_n_s_per_m
            + m.viscous_n_s_per_m
            + self.presliding_damping_n_s_per_m * self.contact.stuck_share();
        let force = self.parameters.gain * pull
            + self.parameters.offset_n
            + m.pull_n(time_s, reel_rad, reel_rad * c.gear_ratio)
            - self.contact.force_n()
            - damping * v
            - load_n;
        let v = if self.by_hand_m == 0.0 {
            v + force * self.h_per_kg
        } else {
            moved_by_hand(&mut self.by_hand_m, h)
        };
        self.speed_m_per_s = v;
        self.wound_m += h * v;
        let ratio = v * c.per_stribeck_velocity;
        let fade = 1.0 + ratio * ratio;
        let kinetic = self.parameters.coulomb_n
            + m.coulomb_n
            + m.changed_friction_n(time_s)
            + (self.parameters.per_load + m.per_load) * pull.abs()
            - self
                .loose_reel
                .as_ref()
                .map_or(0.0, |r| r.play.reel_friction_n);
        let level =
            kinetic.max(0.0) * (1.0 + c.breakaway_excess / (fade * fade)) + m.friction_excess_n(v);
        self.contact.slide(h * v, level);

        if let Some(reel) = &mut self.loose_reel {
            let force = load_n - self.tension_n - reel.bearing.force_n();
            reel.speed_m_per_s += h * force / c.reel_mass_kg;
            reel.wound_m += h * reel.speed_m_per_s;
            reel.bearing
                .slide(h * reel.speed_m_per_s, reel.play.reel_friction_n);
        }

        // Flexure with the motor assembly on it.
        let force = self.tension_n * self.cosine + self.parameters.assembly_weight_n
            - c.cell_stiffness_n_per_m * self.flexure_m
            - c.cell_damping_n_s_per_m * self.flexure_m_per_s;
        self.flexure_m_per_s += force * c.cell_h_per_kg;
        self.flexure_m += h * self.flexure_m_per_s;
        let load = self.cell_load_n(c);
        for (state, creep) in self.creep_n.iter_mut().zip(&self.modifiers.creep) {
            *state += h / creep.time_constant_s * (creep.fraction * load - *state);
        }
    }

    /// Takes up the tip's new place and computes the tension there. The flexure's travel (0.1 mm)
    /// counts in the cable's length, not in its direction.
    #[inline]
    pub fn follow_tip(&mut self, c: &Shared, tip_m: Vec3, tip_m_per_s: Vec3) {
        let to_exit = sub(self.parameters.position_m, tip_m);
        self.distance_m = norm(to_exit);
        self.direction = scale(to_exit, 1.0 / self.distance_m);
        self.cosine = -dot(self.parameters.axis, self.direction);
        let (wound, winding) = match &self.loose_reel {
            None => (self.wound_m, self.speed_m_per_s),
            Some(reel) => (reel.wound_m, reel.speed_m_per_s),
        };
        let free = self.rest_length_m - wound;
        self.stretch_m = self.distance_m - self.flexure_m * self.cosine - free;
        self.tension_n = if self.stretch_m > 0.0 {
            let rate =
                winding - dot(tip_m_per_s, self.direction) - self.flexure_m_per_s * self.cosine;
            let per_free = free.max(SHORTEST_CABLE_M).recip();
            let strain = self.stretch_m * per_free;
            let hardening = self.modifiers.hardening_per_strain * strain;
            let stiffness = c.cable_ea_n * per_free * (1.0 + 2.0 * hardening);
            let elastic = c.cable_ea_n * strain * (1.0 + hardening);
            (elastic + stiffness * c.cable_damping_s * rate).max(0.0)
        } else {
            0.0
        };
    }

    /// Lets a hand pull so much cable out, m; negative: wind it in by turning the reel.
    pub fn pull_out(&mut self, travel_m: f64) {
        self.by_hand_m = travel_m;
    }

    /// Makes the cable longer.
    pub fn lay_loose(&mut self, slack_m: f64) {
        self.rest_length_m += slack_m.max(0.0);
    }

    pub fn tension_n(&self) -> f64 {
        self.tension_n
    }

    /// Taut length minus free length, m; negative: slack.
    pub fn stretch_m(&self) -> f64 {
        self.stretch_m
    }

    pub fn direction(&self) -> Vec3 {
        self.direction
    }

    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }

    /// Cosine between the cable and the cell's axis.
    pub fn cosine(&self) -> f64 {
        self.cosine
    }

    pub fn current_a(&self) -> f64 {
        self.current_a
    }

    pub fn reel_rad(&self, c: &Shared) -> f64 {
        self.loose_reel.as_ref().map_or(self.wound_m, |r| r.wound_m) / c.radius_m
    }

    pub fn reel_rad_per_s(&self, c: &Shared) -> f64 {
        self.loose_reel
            .as_ref()
            .map_or(self.speed_m_per_s, |r| r.speed_m_per_s)
            / c.radius_m
    }

    pub fn encoder_counts(&self, c: &Shared) -> i64 {
        (c.counts_per_m * self.wound_m + self.parameters.encoder_phase_counts).floor() as i64
    }

    /// Everything that the cell carries, N: cable along the axis, weight and inertia of the
    /// assembly, what hangs on it, and a hand that pulls cable out. The last two without a swing.
    pub fn cell_load_n(&self, c: &Shared) -> f64 {
        let hand_n = if self.by_hand_m > 0.0 { HAND_N } else { 0.0 };
        c.cell_stiffness_n_per_m * self.flexure_m + self.external_n + hand_n
    }

    /// Hangs a weight of so many newtons on the cell, along its axis, in place of the one before.
    pub fn hang(&mut self, newtons: f64) {
        self.external_n = newtons;
    }

    pub fn temperature_rise_k(&self, time_s: f64) -> f64 {
        self.modifiers.temperature_rise_k(time_s)
    }

    /// Bridge output, V/V; `load_of` gives the load of another unit's cell without its weight.
    pub fn bridge_v_per_v(&self, c: &Shared, time_s: f64, load_of: impl Fn(usize) -> f64) -> f64 {
        let crosstalk: f64 = self
            .modifiers
            .crosstalk
            .iter()
            .map(|x| x.fraction * load_of(x.from_unit))
            .sum();
        let load = self.cell_load_n(c) + self.creep_n.iter().sum::<f64>();
        self.parameters.bridge_zero_v_per_v
            + self.parameters.bridge_per_n * self.modifiers.reading_n(time_s, load, crosstalk)
    }

    /// Kinetic energy and energy in cable, flexure and contact, J. The flexure counts from its
    /// place under the assembly's weight, so that a unit at rest without tension has none.
    pub fn energy_j(&self, c: &Shared) -> f64 {
        let kinetic = 0.5 * self.mass_kg * self.speed_m_per_s.powi(2)
            + 0.5 * c.cell_mass_kg * self.flexure_m_per_s.powi(2);
        let reel = self.loose_reel.as_ref().map_or(0.0, |r| {
            0.5 * c.reel_mass_kg * r.speed_m_per_s.powi(2) + r.bearing.energy_j()
        });
        let free = (self.rest_length_m - self.reel_rad(c) * c.radius_m).max(SHORTEST_CABLE_M);
        let strain = self.stretch_m.max(0.0) / free;
        let cable = c.cable_ea_n
            * free
            * strain
            * strain
            * (0.5 + self.modifiers.hardening_per_strain * strain / 3.0);
        let sag = self.flexure_m - self.parameters.assembly_weight_n / c.cell_stiffness_n_per_m;
        kinetic
            + reel
            + cable
            + self.contact.energy_j()
            + 0.5 * c.cell_stiffness_n_per_m * sag * sag
    }
}
