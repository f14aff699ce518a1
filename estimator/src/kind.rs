//! The models by name.

use serde::{Deserialize, Serialize};

/// Which model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// No force.
    Zero,
    /// Mean of the training.
    Mean,
    /// Linear in filtered inputs.
    Linear,
    /// Torque balance with identified friction, and an observer.
    Physics,
    /// Gradient-boosted trees on the motion.
    Trees,
    /// The physical model and trees on what it leaves: the shipped model.
    Hybrid,
    /// The thesis's perceptron.
    Mlp,
    /// The thesis's gated recurrent units.
    Gru,
    /// The thesis's long short-term memory.
    Lstm,
    /// A small causal convolution.
    Convolution,
    /// Small gated recurrent units whose state goes on.
    CarriedGru,
}

impl Kind {
    /// The neural networks. They need the feature `networks`.
    pub const NETWORKS: [Self; 5] = [
        Self::Mlp,
        Self::Gru,
        Self::Lstm,
        Self::Convolution,
        Self::CarriedGru,
    ];
    /// All others, from the least to the most.
    pub const ALL: [Self; 6] = [
        Self::Zero,
        Self::Mean,
        Self::Linear,
        Self::Trees,
        Self::Physics,
        Self::Hybrid,
    ];

    /// Whether it is a neural network.
    #[must_use]
    pub fn is_network(self) -> bool {
        Self::NETWORKS.contains(&self)
    }

    /// Name in commands and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Zero => "zero",
            Self::Mean => "mean",
            Self::Linear => "linear",
            Self::Physics => "physics",
            Self::Trees => "trees",
            Self::Hybrid => "hybrid",
            Self::Mlp => "mlp",
            Self::Gru => "gru",
            Self::Lstm => "lstm",
            Self::Convolution => "convolution",
            Self::CarriedGru => "carried-gru",
        }
    }

    /// From its name.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .chain(Self::NETWORKS)
            .find(|kind| kind.name() == name)
    }
}
