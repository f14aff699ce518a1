//! A neural network on the robot's state as the thesis's networks read it (4.2): joint and tip positions, velocities, and
//! efforts at the joints and at the tip, smoothed.
//!
//! The thesis names the quantities and not their number or filters. Here they are 18, and every filter is causal.

use crate::geometry::{tip_in_0, Base};
use crate::model::{Model, ModelError, Progress, Stepper};
use crate::motion::{Moment, Motion};
use crate::network::{self, Config, Network};
use crate::sequence::Sequence;
use base64::Engine as _;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Inputs of the network.
pub const INPUTS: usize = 18;

/// A network with what turns rows into its inputs.
#[derive(Debug, Clone)]
pub struct Neural {
    network: Network,
    base: Base,
    step_s: f64,
    targets: usize,
}

/// What is stored of [`Neural`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredNeural {
    /// File of the network, base64.
    pub network: String,
}

/// Inputs at a row: joints, their velocities, torques at the motors, tip, its velocity, the force that the torques alone tell.
fn inputs(m: &Moment, base: &Base) -> [f32; INPUTS] {
    let tip = tip_in_0(m.joints);
    let velocity = base.jacobian(m.joints) * Vector3::from(m.joint_rate);
    let levers: Matrix3<f64> = base.at_motors(m.joints);
    // Near a singular pose the force grows without a bound; a network needs bounded inputs.
    let force = levers
        .try_inverse()
        .map_or_else(Vector3::zeros, |inverse| inverse * Vector3::from(m.torque))
        .map(|n| n.clamp(-500.0, 500.0));
    let groups = [
        m.joints,
        m.joint_rate,
        m.torque,
        tip.into(),
        velocity.into(),
        force.into(),
    ];
    let mut row = [0.0; INPUTS];
    for (out, value) in row.iter_mut().zip(groups.iter().flatten()) {
        *out = *value as f32;
    }
    row
}

/// A sequence of network inputs.
fn featured(sequence: &Sequence, base: &Base, targets: &Sequence) -> Sequence {
    let mut motion = Motion::new(sequence.step_s);
    let rows = (0..sequence.rows()).flat_map(|k| inputs(motion.step(sequence.input_row(k)), base));
    Sequence {
        input: rows.collect(),
        inputs: INPUTS,
        target: targets.target.clone(),
        targets: targets.targets,
        ..sequence.clone()
    }
}

impl Neural {
    /// Trains on sequences with the force's three components as targets.
    ///
    /// # Errors
    /// What [`network::train`] refuses.
    pub fn train(
        config: &Config,
        base: Base,
        axes: &[usize],
        sequences: &[&Sequence],
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Self, ModelError> {
        let rows: Vec<Sequence> = sequences
            .iter()
            .map(|s| featured(s, &base, &s.with_axes(axes)))
            .collect();
        let network = network::train(config, &rows, &[], progress)?;
        Ok(Self {
            network,
            base,
            step_s: rows.first().map_or(0.0, |s| s.step_s),
            targets: axes.len(),
        })
    }

    /// The network.
    #[must_use]
    pub const fn network(&self) -> &Network {
        &self.network
    }

    /// What to store.
    #[must_use]
    pub fn stored(&self) -> StoredNeural {
        StoredNeural {
            network: base64::engine::general_purpose::STANDARD.encode(self.network.to_bytes()),
        }
    }

    /// From what was stored.
    ///
    /// # Errors
    /// It is no such network.
    pub fn read(stored: &StoredNeural, base: Base, step_s: f64) -> Result<Self, ModelError> {
        let bytes = base64::engine::general_purpose::STANDARD
            .decode(&stored.network)
            .map_err(|error| {
                ModelError::Stored(format!("network: {error}; train the model again"))
            })?;
        let network = Network::from_bytes(&bytes)?;
        Ok(Self {
            targets: network.targets(),
            network,
            base,
            step_s,
        })
    }
}

impl Model for Neural {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        let axes: Vec<usize> = (0..self.targets).collect();
        self.network
            .predict(&featured(sequence, &self.base, &sequence.with_axes(&axes)))
    }

    fn parameters(&self) -> usize {
        self.network.parameters()
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(NeuralStepper {
            motion: Motion::new(self.step_s),
            base: &self.base,
            network: self.network.stepper(),
        })
    }
}

struct NeuralStepper<'a> {
    motion: Motion,
    base: &'a Base,
    network: Box<dyn Stepper + 'a>,
}

impl Stepper for NeuralStepper<'_> {
    fn step(&mut self, input: &[f32], force: &mut [f32]) {
        let row = inputs(self.motion.step(input), self.base);
        self.network.step(&row, force);
    }

    fn reset(&mut self) {
        self.motion.reset();
        self.network.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_force_that_torques_tell_is_that_of_the_levers() {
        let base = Base::default();
        let joints = [0.7, 1.4, 0.37];
        let force = Vector3::new(1.0, -2.0, 0.5);
        let moment = Moment {
            joints,
            joint_rate: [0.02, 0.01, 0.003],
            torque: (base.at_motors(joints) * force).into(),
            ..Moment::default()
        };
        let row = inputs(&moment, &base);
        for (got, expected) in row[15..].iter().zip(force.iter()) {
            assert!((f64::from(*got) - expected).abs() < 1e-4, "{row:?}");
        }
    }
}
