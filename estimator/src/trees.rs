//! Gradient-boosted trees (crate `forust-ml`), alone on features of the motion, or on what the
//! physical model leaves.

use crate::model::{by_steps, Fit, Model, ModelError, Stepper};
use crate::motion::{share_after, LowPass, Moment, LEVELS, LONGEST_GAP_S};
use crate::physics::{settle_rows, Balance, Observer, Physics, Seen};
use crate::recalibration::Change;
use crate::sequence::Sequence;
use forust_ml::{GradientBooster, Matrix};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How the trees are grown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TreesConfig {
    /// Number of trees for each component of the force.
    pub trees: usize,
    /// Share of a tree's correction that is taken.
    pub learning_rate: f32,
    /// Leaves of a tree at most.
    pub leaves: usize,
    /// Rows in a leaf at least.
    pub leaf_rows: f32,
    /// Training rows at most: every n-th row is taken, so that not more are left.
    pub rows: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for TreesConfig {
    fn default() -> Self {
        Self {
            trees: 300,
            learning_rate: 0.08,
            leaves: 31,
            leaf_rows: 60.0,
            rows: 100_000,
            seed: 1,
        }
    }
}

/// Trees for each component of the force.
pub struct Forest(Vec<GradientBooster>);

impl std::fmt::Debug for Forest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Forest")
            .field("trees", &self.nodes())
            .finish()
    }
}

impl Forest {
    /// Grows trees. `columns` is column after column, `targets` a list of values for each
    /// component.
    ///
    /// # Errors
    /// The data can't be used.
    pub fn grow(
        config: &TreesConfig,
        columns: &[f64],
        rows: usize,
        targets: &[Vec<f64>],
    ) -> Result<Self, ModelError> {
        let data = Matrix::new(columns, rows, columns.len() / rows.max(1));
        let grow = |target: &Vec<f64>| {
            let mut trees = GradientBooster::default()
                .set_iterations(config.trees)
                .set_learning_rate(config.learning_rate)
                .set_max_leaves(config.leaves)
                .set_max_depth(8)
                .set_min_leaf_weight(config.leaf_rows)
                .set_l2(1.0)
                .set_seed(config.seed)
                .set_initialize_base_score(false)
                .set_base_score(0.0)
                .set_objective_type(forust_ml::objective::ObjectiveType::SquaredLoss);
            trees
                .fit_unweighted(&data, target, None)
                .map_err(|error| ModelError::Data(format!("trees cannot be grown: {error}")))?;
            Ok(trees)
        };
        Ok(Self(
            targets
                .iter()
                .map(grow)
                .collect::<Result<_, ModelError>>()?,
        ))
    }

    /// As text, one JSON document for each component.
    ///
    /// # Errors
    /// A number can't be written.
    pub fn stored(&self) -> Result<Vec<String>, ModelError> {
        let dump = |trees: &GradientBooster| {
            trees
                .json_dump()
                .map_err(|error| ModelError::Stored(format!("trees: {error}")))
        };
        self.0.iter().map(dump).collect()
    }

    /// From text.
    ///
    /// # Errors
    /// The text is no such document.
    pub fn read(stored: &[String]) -> Result<Self, ModelError> {
        let read = |text: &String| {
            GradientBooster::from_json(text).map_err(|error| {
                ModelError::Stored(format!("trees: {error}; train the model again"))
            })
        };
        Ok(Self(stored.iter().map(read).collect::<Result<_, _>>()?))
    }

    /// Value of a component.
    fn value(&self, component: usize, row: &[f64]) -> f64 {
        let trees = &self.0[component];
        let data = Matrix::new(row, 1, row.len());
        trees.predict(&data, false)[0]
    }

    /// Nodes of all trees.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.0
            .iter()
            .flat_map(|b| &b.trees)
            .map(|tree| tree.nodes.len())
            .sum()
    }
}

/// Trees on features: alone (`physics` gives no force) or on the physical model's residual.
#[derive(Debug)]
pub struct Boosted {
    physics: Physics,
    /// Whether the trees correct the physical model. Otherwise they see the motion alone and give
    /// the whole force.
    correct: bool,
    forest: Forest,
}

/// What is stored of [`Boosted`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredBoosted {
    physics: Physics,
    correct: bool,
    forest: Vec<String>,
}

/// Rows of features, and a list of targets for each component, of one sequence.
type Grown = (Vec<Vec<f64>>, Vec<Vec<f64>>);

/// Features of a row.
#[derive(Debug, Clone)]
struct Features {
    correct: bool,
    /// Slow filters of the motors' shares and of the force, two time constants each.
    slow: [[LowPass; 4]; 2],
    /// Rows from the last one to the next, more than one over a gap.
    steps: f64,
    row: Vec<f64>,
}

/// Why a model can't be recalibrated.
pub(crate) const NO_BALANCE: &str =
    "this model has no torque balance to recalibrate: train `physics` or `hybrid`";

/// Tip speed below which the estimate is averaged over a longer time, m/s. There the motors hardly
/// slide, and a single row tells little.
const SLOW_M_PER_S: f64 = 0.003;
/// Time constant of that average for a tip that stands, s.
const STANDING_S: f64 = 1.0;
/// Time constants of the slow features, s.
const SLOW_S: [f64; 2] = [0.3, 1.0];

impl Features {
    fn new(correct: bool, step_s: f64) -> Self {
        Self {
            correct,
            slow: SLOW_S.map(|time_s| [LowPass::new(time_s, step_s); 4]),
            steps: 1.0,
            row: Vec::new(),
        }
    }

    fn step(&mut self, m: &Moment, seen: &Seen, axes: &[usize]) -> &[f64] {
        let steps = std::mem::replace(&mut self.steps, 1.0);
        let row = &mut self.row;
        row.clear();
        row.extend(m.joints);
        row.extend(m.rate);
        row.extend(m.speed);
        row.extend(m.torque);
        // Those with stretched cables are in the physical model's force.
        row.extend(&m.stops[..5 * LEVELS]);
        for s in 0..2 {
            row.extend(m.torque_change[s]);
            row.extend(m.travel_change[s]);
        }
        if self.correct {
            row.extend(seen.force.iter());
            row.extend(seen.spread.iter());
            let main = axes[0];
            for i in 0..3 {
                // The force that this motor alone would tell; a short lever tells none.
                let lever = seen.levers[(i, main)];
                row.push(if lever.abs() > 1e-3 {
                    (seen.contact[i] / lever).clamp(-50.0, 50.0)
                } else {
                    0.0
                });
            }
            for slow in &mut self.slow {
                for (filter, contact) in slow.iter_mut().zip(seen.contact) {
                    row.push(filter.step_after(contact, steps));
                }
                row.push(slow[3].step_after(seen.force[main], steps));
            }
        }
        row
    }
}

impl Boosted {
    /// Grows trees on sequences with the force's three components as targets.
    ///
    /// # Errors
    /// Too few rows.
    pub fn train(
        physics: Physics,
        correct: bool,
        config: &TreesConfig,
        sequences: &[&Sequence],
    ) -> Result<Self, ModelError> {
        let total: usize = sequences.iter().map(|s| s.rows()).sum();
        let every = total.div_ceil(config.rows.max(1)).max(1);
        let axes = physics.axes().to_vec();
        let parts: Vec<Grown> = sequences
            .par_iter()
            .map(|sequence| {
                let (mut rows, mut targets) = (Vec::new(), vec![Vec::new(); axes.len()]);
                let mut observer = physics.observer();
                let mut features = Features::new(correct, sequence.step_s);
                let settle = settle_rows(sequence.step_s);
                for k in 0..sequence.rows() {
                    let (moment, seen) = observer.take(sequence.input_row(k));
                    let row = features.step(moment, seen, &axes);
                    if k >= settle && k % every == 0 {
                        rows.push(row.to_vec());
                        for (target, axis) in targets.iter_mut().zip(&axes) {
                            let known = if correct { seen.force[*axis] } else { 0.0 };
                            target.push(f64::from(sequence.target_row(k)[*axis]) - known);
                        }
                    }
                }
                (rows, targets)
            })
            .collect();
        let rows: Vec<&Vec<f64>> = parts.iter().flat_map(|(rows, _)| rows).collect();
        let Some(width) = rows.first().map(|r| r.len()) else {
            return Err(ModelError::Data(
                "too few rows for trees: no unbroken stretch is longer than 10 s".to_owned(),
            ));
        };
        let columns: Vec<f64> = (0..width)
            .flat_map(|c| rows.iter().map(move |r| r[c]))
            .collect();
        let targets: Vec<Vec<f64>> = (0..axes.len())
            .map(|a| {
                parts
                    .iter()
                    .flat_map(|(_, t)| t[a].iter().copied())
                    .collect()
            })
            .collect();
        let forest = Forest::grow(config, &columns, rows.len(), &targets)?;
        Ok(Self {
            physics,
            correct,
            forest,
        })
    }

    /// Finds on free motion what has changed of the robot.
    ///
    /// # Errors
    /// See [`Physics::recalibrate`]; trees alone have no balance.
    pub fn recalibrate(
        &mut self,
        free: &[&Sequence],
    ) -> Result<([Change; 3], Option<[f64; 3]>), ModelError> {
        if !self.correct {
            return Err(ModelError::Data(NO_BALANCE.to_owned()));
        }
        self.physics.recalibrate(free)
    }

    /// See [`Physics::balances`].
    ///
    /// # Errors
    /// Trees alone have no balance.
    pub fn balances(&self, sequence: &Sequence) -> Result<Vec<[Balance; 3]>, ModelError> {
        if !self.correct {
            return Err(ModelError::Data(NO_BALANCE.to_owned()));
        }
        Ok(self.physics.balances(sequence))
    }

    /// See [`Physics::recalibrated`].
    #[must_use]
    pub const fn recalibrated(&self) -> bool {
        self.physics.recalibrated()
    }

    fn with<'a>(&'a self, observer: Observer<'a>) -> BoostedStepper<'a> {
        BoostedStepper {
            model: self,
            observer,
            features: Features::new(self.correct, self.physics.step_s()),
            held: Vec::new(),
        }
    }

    /// What to store.
    ///
    /// # Errors
    /// A number can't be written.
    pub fn stored(&self) -> Result<StoredBoosted, ModelError> {
        Ok(StoredBoosted {
            physics: self.physics.clone(),
            correct: self.correct,
            forest: self.forest.stored()?,
        })
    }

    /// From what was stored.
    ///
    /// # Errors
    /// It is no such model.
    pub fn read(stored: &StoredBoosted) -> Result<Self, ModelError> {
        Ok(Self {
            physics: stored.physics.clone(),
            correct: stored.correct,
            forest: Forest::read(&stored.forest)?,
        })
    }
}

impl Model for Boosted {
    fn predict(&self, sequence: &Sequence) -> Vec<f32> {
        by_steps(self.stepper(), sequence, self.physics.axes().len())
    }

    fn parameters(&self) -> usize {
        let physics = if self.correct {
            self.physics.count()
        } else {
            0
        };
        physics + self.forest.nodes()
    }

    fn stepper(&self) -> Box<dyn Stepper + '_> {
        Box::new(self.with(self.physics.observer()))
    }

    fn told_stepper(&self, sequence: &Sequence) -> Option<(Box<dyn Stepper + '_>, usize)> {
        let (observer, from) = self.correct.then(|| self.physics.told(sequence))??;
        Some((Box::new(self.with(observer)), from))
    }
}

struct BoostedStepper<'a> {
    model: &'a Boosted,
    observer: Observer<'a>,
    features: Features,
    /// The averaged estimate, N; empty before the first row.
    held: Vec<f64>,
}

impl Stepper for BoostedStepper<'_> {
    fn step(&mut self, input: &[f32], force: &mut [f32]) {
        let axes = self.model.physics.axes();
        let steps = self.features.steps;
        let (moment, seen) = self.observer.take(input);
        let row = self.features.step(moment, seen, axes);
        let speed = (seen.levers.transpose() * Vector3::from(moment.rate)).norm();
        let step_s = self.model.physics.step_s();
        let memory_s = STANDING_S * (-(speed / SLOW_M_PER_S).powi(2)).exp();
        let share = if moment.friction_known() {
            share_after(step_s / (step_s + memory_s), steps)
        } else {
            // Nothing that was estimated with an unknown state of the friction is held.
            1.0
        };
        for (k, (out, axis)) in force.iter_mut().zip(axes).enumerate() {
            let known = if self.model.correct {
                seen.force[*axis]
            } else {
                0.0
            };
            let fresh = known + self.model.forest.value(k, row);
            if self.held.len() <= k {
                self.held.push(fresh);
            }
            self.held[k] += share * (fresh - self.held[k]);
            *out = self.held[k] as f32;
        }
    }

    fn reset(&mut self) {
        self.observer.forget();
        self.held.clear();
        self.features = Features::new(self.model.correct, self.model.physics.step_s());
    }

    fn gap(&mut self, elapsed_s: f64) {
        if elapsed_s > LONGEST_GAP_S {
            self.reset();
        } else {
            self.observer.miss(elapsed_s);
            self.features.steps = (elapsed_s / self.model.physics.step_s()).max(1.0);
        }
    }

    fn fit(&self) -> Option<Fit> {
        self.observer.fit().filter(|_| self.model.correct)
    }
}
