//! Which sets are made.

use evaluation::clap::{self, ValueEnum};
use serde::{Deserialize, Serialize};
use synthetic_sets::{Circumstance, Kind, Recipe};

/// What a set is there to test.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, ValueEnum, Serialize, Deserialize,
)]
pub enum Group {
    /// One effect of the catalogue, commanded open loop.
    Known,
    /// One effect of the catalogue, in a log taken under force control.
    Closed,
    /// No effect.
    Empty,
    /// Two effects of the catalogue.
    Two,
    /// Three effects of the catalogue.
    Three,
    /// One effect that is in no catalogue.
    Uncatalogued,
    /// One effect of which the catalogue has the pure form only.
    Impure,
    /// One effect of the catalogue in unusual logs.
    Unusual,
}

/// One set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// What it tests.
    pub group: Group,
    /// Undeclared effects in it.
    pub kinds: Vec<Kind>,
    /// RMS of each as a multiple of the noise's.
    pub strength: f64,
    /// Whether a controller drove the command.
    pub closed_loop: bool,
    /// What is unusual about the logs.
    pub circumstance: Circumstance,
    /// Seed within the bench.
    pub seed: u64,
    /// Distinguishes sets of equal seed, so that no two have the same motion.
    salt: u64,
}

impl Case {
    /// The recipe for the generator.
    #[must_use]
    pub fn recipe(&self) -> Recipe {
        Recipe {
            kinds: self.kinds.clone(),
            strength: self.strength,
            closed_loop: self.closed_loop,
            circumstance: self.circumstance,
            seed: self.seed * 1000 + self.salt,
        }
    }

    /// The effects' names, joined by `+`; `none` if there are none.
    #[must_use]
    pub fn truth(&self) -> String {
        if self.kinds.is_empty() {
            return "none".into();
        }
        let names: Vec<&str> = self.kinds.iter().map(|kind| kind.name()).collect();
        match self.circumstance {
            Circumstance::Usual => names.join("+"),
            unusual => format!("{}, {}", names.join("+"), unusual.words()),
        }
    }
}

/// Strengths of known effects, as multiples of the noise's RMS.
pub const STRENGTHS: [f64; 3] = [3.0, 1.0, 0.3];

/// Pairs of effects that occur together on rigs.
pub const PAIRS: [[Kind; 2]; 8] = [
    [Kind::LoadDependentCoulomb, Kind::Offset],
    [Kind::Coulomb, Kind::PeriodicAngle],
    [Kind::Viscous, Kind::Gain],
    [Kind::Hysteresis, Kind::DriftTime],
    [Kind::Inertia, Kind::Crosstalk],
    [Kind::Delay, Kind::Coulomb],
    [Kind::Quadratic, Kind::DriftTemperature],
    [Kind::Tone, Kind::Saturation],
];

/// Effects of which three act at once.
pub const TRIPLES: [[Kind; 3]; 12] = [
    [Kind::Coulomb, Kind::Viscous, Kind::Inertia],
    [Kind::Coulomb, Kind::Gain, Kind::Offset],
    [Kind::Coulomb, Kind::DriftTemperature, Kind::Crosstalk],
    [
        Kind::LoadDependentCoulomb,
        Kind::Offset,
        Kind::PeriodicAngle,
    ],
    [Kind::Viscous, Kind::Quadratic, Kind::Tone],
    [Kind::Hysteresis, Kind::Gain, Kind::DriftTime],
    [Kind::Delay, Kind::Coulomb, Kind::Offset],
    [Kind::Inertia, Kind::Presliding, Kind::Tone],
    [Kind::Stribeck, Kind::Viscous, Kind::Offset],
    [Kind::Saturation, Kind::Coulomb, Kind::DriftTime],
    [Kind::Creep, Kind::Gain, Kind::Coulomb],
    [Kind::Viscous, Kind::PeriodicAngle, Kind::DriftTemperature],
];

/// Effects in unusual logs.
pub const UNUSUAL: [Kind; 8] = [
    Kind::Coulomb,
    Kind::Viscous,
    Kind::Inertia,
    Kind::LoadDependentCoulomb,
    Kind::Gain,
    Kind::Offset,
    Kind::Quadratic,
    Kind::Crosstalk,
];

/// Which sets to make.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Seeds, both ends included.
    pub seeds: std::ops::RangeInclusive<u64>,
    /// Only sets with this effect in them.
    pub kind: Option<Kind>,
    /// A small selection for a first impression.
    pub quick: bool,
}

/// The effect of that name, known or uncatalogued.
#[must_use]
pub fn kind_named(name: &str) -> Option<Kind> {
    Kind::KNOWN
        .into_iter()
        .chain(Kind::UNCATALOGUED)
        .chain(Kind::IMPURE)
        .find(|kind| kind.name() == name)
}

impl Plan {
    /// All sets of the plan. With twenty seeds: 1140 known, 380 closed-loop, 200 empty, 80 with two
    /// effects, 80 with three, 240 uncatalogued, 80 impure, 160 in unusual logs.
    #[must_use]
    pub fn cases(&self) -> Vec<Case> {
        let mut out = Vec::new();
        let mut push = |group, kinds: &[Kind], strength, closed_loop, circumstance, seed, salt| {
            out.push(Case {
                group,
                kinds: kinds.to_vec(),
                strength,
                closed_loop,
                circumstance,
                seed,
                salt,
            });
        };
        let usual = Circumstance::Usual;
        for (n, seed) in self.seeds.clone().enumerate() {
            for (i, kind) in (0u64..).zip(Kind::KNOWN) {
                for (j, strength) in (0u64..).zip(STRENGTHS) {
                    if !self.quick || (n < 2 && j > 0) {
                        push(
                            Group::Known,
                            &[kind],
                            strength,
                            false,
                            usual,
                            seed,
                            10 * i + j,
                        );
                    }
                }
                if !self.quick || n < 1 {
                    push(Group::Closed, &[kind], 1.0, true, usual, seed, 10 * i + 5);
                }
            }
            for k in 0..if self.quick { 2 } else { 10 } {
                push(Group::Empty, &[], 0.0, k % 2 == 1, usual, seed, 300 + k);
            }
            if self.quick && n >= 2 {
                continue;
            }
            for k in 0..4 {
                let at = (4 * n + k) % PAIRS.len();
                let salt = 400 + at as u64;
                push(Group::Two, &PAIRS[at], 1.0, false, usual, seed, salt);
                let at = (4 * n + k) % TRIPLES.len();
                let salt = 600 + at as u64;
                push(Group::Three, &TRIPLES[at], 1.0, false, usual, seed, salt);
            }
            for (i, kind) in (0u64..).zip(Kind::UNCATALOGUED) {
                for (j, strength) in [(0, 1.0), (1, 3.0), (2, 0.3)] {
                    let salt = 500 + 10 * i + j;
                    push(
                        Group::Uncatalogued,
                        &[kind],
                        strength,
                        false,
                        usual,
                        seed,
                        salt,
                    );
                }
            }
            for (i, kind) in (0u64..).zip(Kind::IMPURE) {
                let salt = 700 + i;
                push(Group::Impure, &[kind], 1.0, false, usual, seed, salt);
            }
            for (k, kind) in UNUSUAL.into_iter().enumerate() {
                // Every effect in every circumstance within five seeds.
                let unusual = Circumstance::UNUSUAL[(n + k) % Circumstance::UNUSUAL.len()];
                let salt = 800 + k as u64;
                push(Group::Unusual, &[kind], 1.0, false, unusual, seed, salt);
            }
        }
        if let Some(kind) = self.kind {
            out.retain(|case| case.kinds.contains(&kind));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_sets_share_their_random_numbers() {
        let plan = Plan {
            seeds: 1..=20,
            kind: None,
            quick: false,
        };
        let cases = plan.cases();
        let mut seeds: Vec<u64> = cases.iter().map(|case| case.recipe().seed).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), cases.len());
        let count = |group| cases.iter().filter(|case| case.group == group).count();
        assert_eq!(count(Group::Known), 19 * 3 * 20);
        assert_eq!(count(Group::Empty), 200);
        assert_eq!(count(Group::Two), 80);
        assert_eq!(count(Group::Uncatalogued), 240);
        assert_eq!(count(Group::Closed), 19 * 20);
        assert_eq!(count(Group::Three), 80);
        assert_eq!(count(Group::Impure), 80);
        assert_eq!(count(Group::Unusual), 160);
    }
}
