//! Diagnostics of a residual, whatever effects are in the model: whiteness, correlation with the
//! inputs, switching between levels, bursts, slow and narrow parts.

mod colour;
mod correlation;
mod envelope;
mod louder;
mod narrow;
mod noise;
mod switching;
mod wander;
mod whiteness;

pub(crate) use correlation::correlation_rows;
pub(crate) use envelope::{Along, Growth};
pub(crate) use noise::{unlike_noise, Sort, UnlikeNoise};
pub(crate) use switching::switching;

use crate::frame::Frame;
use crate::problem::Problem;
use crate::report::ModelTest;
use crate::spec::Roles;
use rayon::prelude::*;
use whiteness::{cross_correlation, whiteness};

/// Tests of the residual of the declared (`before`) and of the final model (`after`): whiteness, then
/// correlation with every input. `frame` has the kept rows.
pub(crate) fn residual_tests(
    problem: &Problem,
    roles: &Roles,
    frame: &Frame,
    before: &[f64],
    after: &[f64],
) -> Vec<ModelTest> {
    let of_model = |model: &str, test| ModelTest {
        model: model.into(),
        test,
    };
    let both = [("before", before), ("after", after)];
    let mut out: Vec<ModelTest> = both
        .iter()
        .map(|(when, r)| of_model(when, whiteness(r, frame)))
        .collect();
    let crossed: Vec<ModelTest> = roles
        .all()
        .into_par_iter()
        .filter(|(name, _)| name != "target" && name != "time" && !roles.groups.contains_key(name))
        .flat_map_iter(|(name, _)| {
            let column = problem.frame.column(&name).unwrap_or(&[]);
            let x = problem.gather(column.to_vec());
            both.map(|(when, r)| of_model(when, cross_correlation(r, &x, &name, frame)))
        })
        .collect();
    out.extend(crossed);
    out
}

/// Noise whose correlation falls to 0.95 from row to row, for tests.
#[cfg(test)]
pub(crate) fn coloured(seed: u64, n: usize) -> Vec<f64> {
    let mut rng = crate::stats::Rng::new(seed);
    let mut x = 0.0;
    (0..n)
        .map(|_| {
            x = 0.95 * x + rng.normal();
            x
        })
        .collect()
}
