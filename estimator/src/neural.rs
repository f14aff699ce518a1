//! A neural network on the robot's state as the thesis's networks read it (4.2): joint and tip
//! positions, velocities, and efforts at the joints and at the tip, smoothed.
//!
//! The thesis names the quantities and not their number or filters. Here they are 18, and every
//! filter is causal.

use crate::geometry::{tip_in_0, Base};
use crate::model::{Keep, Model, ModelError, Progress, Stepper};
use crate::motion::{Moment, Motion};
use crate::network::{self, Config, Network};
use crate::sequence::Sequence;
use base64::Engine as _;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Inputs of the network.
pub const INPUTS: usize = 18;

/// Name, unit and meaning of each input, in order. Whoever runs an exported network makes them.
pub const INPUT_TABLE: [(&str, &str, &str); INPUTS] = [
    ("joint_1", "rad", POSITION),
    ("joint_2", "rad", POSITION),
    ("joint_3", "m", POSITION),
    ("joint_rate_1", "rad/s", RATE),
    ("joint_rate_2", "rad/s", RATE),
    ("joint_rate_3", "m/s", RATE),
    ("motor_torque_1", "N·m", TORQUE),
    ("motor_torque_2", "N·m", TORQUE),
    ("motor_torque_3", "N", TORQUE),
    ("tip_x0", "m", TIP),
    ("tip_y0", "m", TIP),
    ("tip_z0", "m", TIP),
    ("tip_rate_x", "m/s", TIP_RATE),
    ("tip_rate_y", "m/s", TIP_RATE),
    ("tip_rate_z", "m/s", TIP_RATE),
    ("torque_force_x", "N", TORQUE_FORCE),
    ("torque_force_y", "N", TORQUE_FORCE),
    ("torque_force_z", "N", TORQUE_FORCE),
];
const POSITION: &str = "joint position as published, no filter";
const RATE: &str = "joint position less that of 0.1 s before (nearest whole number of rows; while there are fewer, the first), over that time";
const TORQUE: &str = "published efforts brought to the motors (`torques_at_motors`), then a first-order low-pass of 0.05 s: y += step / (0.05 s + step) * (x - y), from the first value";
const TIP: &str = "tip by the kinematics, frame 0 of the robot, no filter";
const TIP_RATE: &str = "velocity of the tip in the frame of the force: base rotation times position Jacobian times joint rates";
const TORQUE_FORCE: &str = "force in the frame of the force that the filtered motor torques alone tell: inverse of the levers (`Base::at_motors`) times the torques, each component within -500 to 500; 0 where there is no inverse";

/// A network with what turns rows into its inputs.
#[derive(Debug, Clone)]
pub struct Neural {
    network: Network,
    base: Base,
    step_s: f64,
    targets: usize,
}

/// Inputs and outputs of an exported network, for who runs it elsewhere. It lies beside the ONNX
/// file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OnnxCard {
    /// Model.
    pub model: String,
    /// SHA-256 of the model file that was exported.
    pub model_sha256: String,
    /// SHA-256 of the ONNX file.
    pub onnx_sha256: String,
    /// Robot.
    pub robot: String,
    /// Rows per second. Rows of another rate give wrong forces.
    pub rate_hz: f64,
    /// What the tensor `input` holds, by its dimensions.
    pub input_shape: Vec<String>,
    /// Rows that the network reads; 1: the newest row alone.
    pub window: usize,
    /// What to do with the rows before the window is full, and with the state.
    pub start: String,
    /// The columns of a row in order.
    pub inputs: Vec<OnnxInput>,
    /// Rotation from frame 0 of the robot to the frame of the force.
    pub base: Base,
    /// What the tensor `force` holds, by its dimensions.
    pub output_shape: Vec<String>,
    /// The columns of the output in order, with units.
    pub outputs: Vec<String>,
    /// Sign of the force.
    pub sign: String,
}

/// A column of an exported network's input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OnnxInput {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// What it is, with its filter.
    pub what: String,
}

/// What is stored of [`Neural`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredNeural {
    /// File of the network, base64.
    pub network: String,
}

/// Inputs at a row: joints, their velocities, torques at the motors, tip, its velocity, the force
/// that the torques alone tell.
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
    /// What [`network::train_kept`] refuses.
    pub fn train(
        config: &Config,
        base: Base,
        axes: &[usize],
        sequences: &[&Sequence],
        keep: Option<&Keep>,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Self, ModelError> {
        let rows: Vec<Sequence> = sequences
            .iter()
            .map(|s| featured(s, &base, &s.with_axes(axes)))
            .collect();
        let network = network::train_kept(config, &rows, &[], keep, progress)?;
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

    /// What an exported network reads and gives; hashes, model and robot are left empty.
    #[must_use]
    pub fn onnx_card(&self, axes: &[usize]) -> OnnxCard {
        let config = self.network.config();
        let words =
            |words: &[&str]| -> Vec<String> { words.iter().map(|w| (*w).to_owned()).collect() };
        let (input, output, start): (&[&str], &[&str], &str) = match config.kind {
            network::Kind::Mlp => (
                &["batch", "18 inputs"],
                &["batch", "forces"],
                "each row stands alone",
            ),
            network::Kind::CarriedGru => (
                &["rows", "batch", "18 inputs"],
                &["rows", "batch", "forces"],
                "`state_k` is 0 at the first row of an unbroken stretch, then `next_state_k` of the row before",
            ),
            _ => (
                &["batch", "window, oldest row first", "18 inputs"],
                &["batch", "forces of the newest row"],
                "before the window is full, repeat the first row of the unbroken stretch in front",
            ),
        };
        OnnxCard {
            model: String::new(),
            model_sha256: String::new(),
            onnx_sha256: String::new(),
            robot: String::new(),
            rate_hz: 1.0 / self.step_s,
            input_shape: words(input),
            // Of a carried network the window is a matter of the training alone.
            window: if config.kind == network::Kind::CarriedGru {
                1
            } else {
                config.window
            },
            start: start.to_owned(),
            inputs: INPUT_TABLE
                .iter()
                .map(|(name, unit, what)| OnnxInput {
                    name: (*name).to_owned(),
                    unit: (*unit).to_owned(),
                    what: (*what).to_owned(),
                })
                .collect(),
            base: self.base,
            output_shape: words(output),
            outputs: axes
                .iter()
                .map(|a| format!("force_{} (N)", ["x", "y", "z"][*a]))
                .collect(),
            sign: "force on the tool".to_owned(),
        }
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
    fn the_table_of_inputs_is_in_their_order() {
        let base = Base::default();
        let moment = Moment {
            joints: [0.7, 1.4, 0.37],
            joint_rate: [0.02, 0.01, 0.003],
            torque: [1.0, 2.0, 3.0],
            ..Moment::default()
        };
        let row = inputs(&moment, &base);
        let at = |name: &str| {
            let place = INPUT_TABLE.iter().position(|(n, _, _)| *n == name);
            f64::from(row[place.expect("a name of the table")])
        };
        let tip = tip_in_0(moment.joints);
        let rate = base.jacobian(moment.joints) * Vector3::from(moment.joint_rate);
        for (name, expected) in [
            ("joint_3", 0.37),
            ("joint_rate_2", 0.01),
            ("motor_torque_1", 1.0),
            ("tip_z0", tip.z),
            ("tip_rate_x", rate.x),
        ] {
            assert!((at(name) - expected).abs() < 1e-6, "{name}: {}", at(name));
        }
        // What the words of the table say about filters.
        assert_eq!(crate::motion::FILTER_S, 0.05);
        // Published in docs/estimation/networks.md too.
        let page = include_str!("../../docs/estimation/networks.md");
        for (n, (name, unit, _)) in INPUT_TABLE.iter().enumerate() {
            let line = format!("| {} | `{name}` | {unit} |", n + 1);
            assert!(page.contains(&line), "{line}");
        }
    }

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
