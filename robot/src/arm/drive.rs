//! The drives of the first three joints: motors, cables, friction, in the joints' coordinates.
//!
//! A motor's angle divided by its transmission is its travel in the joint's unit, `phi`. The cable
//! between it and the link stretches by `s = phi - (C q)`, with the coupling C of the later motors;
//! its force is `k s + d s'`, which pulls the motor back and acts on the joints with the transpose
//! of C. (The published cable law `ke (e^s - e^-s)` with s in m is linear to 1e-6 at these
//! stretches.)

use super::change::Change;
use super::parameters::Parameters;
use crate::kinematics::{COUPLING, TRANSMISSION};
use nalgebra::Vector3;
use plant::friction::MaxwellSlip;

/// Part of critical damping of a sticking contact. Estimate.
const PRESLIDING_DAMPING: f64 = 0.1;

/// A sliding contact with stiction.
#[derive(Debug, Clone)]
pub(super) struct Contact {
    slip: MaxwellSlip,
    coulomb: f64,
    excess: f64,
    stribeck: f64,
    viscous: f64,
    presliding_damping: f64,
}

impl Contact {
    pub fn new(
        coulomb: f64,
        breakaway: f64,
        stribeck: f64,
        presliding: f64,
        viscous: f64,
        inertia: f64,
    ) -> Self {
        let slip = MaxwellSlip::new(coulomb * breakaway, presliding);
        Self {
            presliding_damping: 2.0
                * PRESLIDING_DAMPING
                * (slip.stiffness_n_per_m() * inertia).sqrt(),
            slip,
            coulomb,
            excess: breakaway - 1.0,
            stribeck,
            viscous,
        }
    }

    /// Force against a motion with velocity `v`, before it is moved.
    #[inline]
    pub fn force(&self, v: f64) -> f64 {
        let damping = self.viscous + self.presliding_damping * self.slip.stuck_share();
        self.slip.force_n() + damping * v
    }

    /// Moves the contact by `travel` at velocity `v`; its Coulomb level is `scale` times its own
    /// and `more`.
    #[inline]
    pub fn slide(&mut self, travel: f64, v: f64, more: f64, scale: f64) {
        let ratio = v / self.stribeck;
        let fade = 1.0 + ratio * ratio;
        let level = (self.coulomb + more) * scale * (1.0 + self.excess / (fade * fade));
        self.slip.slide(travel, level);
    }

    pub fn friction(&self) -> f64 {
        self.slip.force_n()
    }

    pub fn energy_j(&self) -> f64 {
        self.slip.energy_j()
    }
}

/// State of the three drives.
#[derive(Debug, Clone)]
pub(super) struct Drives {
    /// Motor travel in the joints' units.
    pub phi: [f64; 3],
    pub phi_rate: [f64; 3],
    /// Inertia at the joints.
    inertia: [f64; 3],
    stiffness: [f64; 3],
    damping: [f64; 3],
    load_share: [f64; 3],
    contacts: [Contact; 3],
    /// Cable force at the last step.
    pub cable: [f64; 3],
}

/// C q: what the links' positions are at the motors.
#[inline]
pub(super) fn coupled(q: [f64; 3]) -> [f64; 3] {
    [
        q[0],
        COUPLING[1][0] * q[0] + q[1],
        COUPLING[2][0] * q[0] + COUPLING[2][1] * q[1] + q[2],
    ]
}

/// C' f: cable forces at the joints.
#[inline]
pub(super) fn at_joints(f: [f64; 3]) -> Vector3<f64> {
    Vector3::new(
        f[0] + COUPLING[1][0] * f[1] + COUPLING[2][0] * f[2],
        f[1] + COUPLING[2][1] * f[2],
        f[2],
    )
}

impl Drives {
    pub fn new(p: &Parameters, link_inertia: [f64; 3], q: [f64; 3], held: [f64; 3]) -> Self {
        let inertia: [f64; 3] =
            core::array::from_fn(|i| p.rotor_inertia[i] * TRANSMISSION[i].powi(2));
        let stiffness = p.cable_stiffness;
        let at = coupled(q);
        Self {
            // Stretched by what the links weigh.
            phi: core::array::from_fn(|i| at[i] + held[i] / stiffness[i]),
            phi_rate: [0.0; 3],
            contacts: core::array::from_fn(|i| {
                Contact::new(
                    p.motor_coulomb[i],
                    p.motor_breakaway[i],
                    p.stribeck[i],
                    p.presliding[i],
                    p.motor_viscous[i],
                    inertia[i],
                )
            }),
            damping: core::array::from_fn(|i| {
                2.0 * p.cable_damping_ratio[i] * (stiffness[i] * link_inertia[i]).sqrt()
            }),
            load_share: p.load_share,
            inertia,
            stiffness,
            cable: held,
        }
    }

    /// Moves the motors on by `h` with `torque` at the joints' units; returns the cables' forces on
    /// the joints. `friction`: Coulomb friction of all contacts per that of the parameters.
    #[inline]
    pub fn step(
        &mut self,
        h: f64,
        torque: [f64; 3],
        (q, v): ([f64; 3], [f64; 3]),
        (change, friction): (&Change, f64),
    ) -> Vector3<f64> {
        let (at, rate) = (coupled(q), coupled(v));
        for i in 0..3 {
            let cable = self.stiffness[i] * (self.phi[i] - at[i])
                + self.damping[i] * (self.phi_rate[i] - rate[i]);
            self.cable[i] = cable;
            let contact = &mut self.contacts[i];
            let force = torque[i] - cable - contact.force(self.phi_rate[i]);
            self.phi_rate[i] += h * force / self.inertia[i];
            let travel = h * self.phi_rate[i];
            self.phi[i] += travel;
            let rate = self.phi_rate[i];
            let scale = friction
                * change.one_way(rate)
                * change.over_turn(i, self.phi[i] * TRANSMISSION[i]);
            contact.slide(travel, rate, self.load_share[i] * cable.abs(), scale);
        }
        at_joints(self.cable)
    }

    pub fn friction(&self) -> [f64; 3] {
        core::array::from_fn(|i| self.contacts[i].friction())
    }

    /// Energy of motors, cables and sticking contacts, J.
    pub fn energy_j(&self, q: [f64; 3]) -> f64 {
        let at = coupled(q);
        (0..3)
            .map(|i| {
                0.5 * self.inertia[i] * self.phi_rate[i].powi(2)
                    + 0.5 * self.stiffness[i] * (self.phi[i] - at[i]).powi(2)
                    + self.contacts[i].energy_j()
            })
            .sum()
    }
}
