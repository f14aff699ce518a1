//! Which sets are made.

use evaluation::clap::{self, ValueEnum};
use synthetic_sets::{Kind, Recipe};

/// What a set is there to test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, ValueEnum)]
pub enum Group {
    /// One effect of the catalogue, commanded open loop.
    Known,
    /// One effect of the catalogue, in a log taken under force control.
    Closed,
    /// No effect.
    Empty,
    /// Two effects of the catalogue.
    Two,
    /// One effect that is in no catalogue.
    Uncatalogued,
}

/// One set.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// What it tests.
    pub group: Group,
    /// Undeclared effects in it.
    pub kinds: Vec<Kind>,
    /// RMS of each as a multiple of the noise's.
    pub strength: f64,
    /// Whether a controller drove the command.
    pub closed_loop: bool,
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
        names.join("+")
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
        .find(|kind| kind.name() == name)
}

impl Plan {
    /// All sets of the plan. With twenty seeds: 1140 known, 380 closed-loop, 200 empty, 80 with two
    /// effects, 160 uncatalogued.
    #[must_use]
    pub fn cases(&self) -> Vec<Case> {
        let mut out = Vec::new();
        let mut add = |group, kinds: &[Kind], strength, closed_loop, seed, salt| {
            out.push(Case {
                group,
                kinds: kinds.to_vec(),
                strength,
                closed_loop,
                seed,
                salt,
            });
        };
        for (n, seed) in self.seeds.clone().enumerate() {
            for (i, kind) in (0u64..).zip(Kind::KNOWN) {
                for (j, strength) in (0u64..).zip(STRENGTHS) {
                    if !self.quick || (n < 2 && j > 0) {
                        add(Group::Known, &[kind], strength, false, seed, 10 * i + j);
                    }
                }
                if !self.quick || n < 1 {
                    add(Group::Closed, &[kind], 1.0, true, seed, 10 * i + 5);
                }
            }
            for k in 0..if self.quick { 2 } else { 10 } {
                add(Group::Empty, &[], 0.0, k % 2 == 1, seed, 300 + k);
            }
            if self.quick && n >= 2 {
                continue;
            }
            for k in 0..4 {
                let at = (4 * n + k) % PAIRS.len();
                add(Group::Two, &PAIRS[at], 1.0, false, seed, 400 + at as u64);
            }
            for (i, kind) in (0u64..).zip(Kind::UNCATALOGUED) {
                for (j, strength) in [(0, 1.0), (1, 3.0)] {
                    add(
                        Group::Uncatalogued,
                        &[kind],
                        strength,
                        false,
                        seed,
                        500 + 10 * i + j,
                    );
                }
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
        assert_eq!(count(Group::Uncatalogued), 160);
        assert_eq!(count(Group::Closed), 19 * 20);
    }
}
