//! Tests of the residual before and after the search.

use rayon::prelude::*;
use residual_columns::frame::Frame;
use residual_fit::diagnostics::{cross_correlation, whiteness, ResidualTest};
use residual_fit::problem::Problem;
use residual_log::spec::Roles;
use serde::{Deserialize, Serialize};

/// A test of a model's residual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelTest {
    /// Whose residual: `before` (declared model) or `after` (final model).
    pub model: String,
    /// The test.
    #[serde(flatten)]
    pub test: ResidualTest,
}

/// Tests of the residual of the declared (`before`) and of the final model (`after`): whiteness,
/// then correlation with every input. `frame` has the kept rows.
pub fn residual_tests(
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
