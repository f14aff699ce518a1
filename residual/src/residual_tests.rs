//! Tests of the residual before and after the search.

use crate::diagnostics::{cross_correlation, whiteness, ResidualTest};
use crate::frame::Frame;
use crate::problem::Problem;
use crate::spec::Roles;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A test of a model's residual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ModelTest {
    /// Whose residual: `before` (declared model) or `after` (final model).
    pub model: String,
    /// The test.
    #[serde(flatten)]
    pub test: ResidualTest,
}

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
