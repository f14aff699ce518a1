//! Frozen models on data that the search has not seen.

use residual_columns::error::Error;
use residual_columns::stats;
use residual_fit::problem::Problem;
use residual_log::data::Data;
use residual_log::hygiene;
use residual_log::spec::Spec;
use residual_search::declared;
use residual_search::extended::extended;
use residual_search::model::{Chosen, Model};
use residual_search::Search;
use serde::{Deserialize, Serialize};

/// Frozen models on data that the search has not seen. Errors are root mean squares in the target's
/// unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Names of the files, without folders.
    pub files: Vec<String>,
    /// Rows.
    pub rows: usize,
    /// Rows in runs whose motion is also in the searched data: they do not show how the model does
    /// on another motion.
    #[serde(default)]
    pub repeated_rows: usize,
    /// Error of the declared model, with the coefficients that were fitted to the searched data.
    #[serde(deserialize_with = "residual_columns::nan::from_null")]
    pub declared_rmse: f64,
    /// Error of the model with the effects found.
    #[serde(deserialize_with = "residual_columns::nan::from_null")]
    pub found_rmse: f64,
    /// Error of the model with everything that improves the fit on the searched data.
    #[serde(deserialize_with = "residual_columns::nan::from_null")]
    pub all_rmse: f64,
}

/// Data to check models on.
pub struct Checked {
    problem: Problem,
    files: Vec<String>,
}

/// Error on the check data, as a multiple of the held-out one, above which a model does not hold
/// there.
const WORSE: f64 = 4.0 / 3.0;

impl Check {
    /// Error of the model with the effects found, as a multiple of its held-out error, where it is
    /// far larger.
    pub fn worse_than(&self, heldout_rmse: f64) -> Option<f64> {
        let ratio = self.found_rmse / heldout_rmse;
        (ratio.is_finite() && ratio > WORSE).then_some(ratio)
    }

    /// Whether most of the data repeat a motion of the searched data.
    pub fn repeats(&self) -> bool {
        2 * self.repeated_rows > self.rows
    }
}

impl Checked {
    /// Prepares data of the same columns.
    pub fn new(data: &Data, spec: &Spec) -> Checked {
        Checked {
            problem: declared::problem(data, &spec.selection),
            files: data.file_names(),
        }
    }

    /// Error of the model with some effects, every coefficient as it was fitted to the searched
    /// data. Terms with a coefficient for each sequence have no value here and are left out.
    ///
    /// # Errors
    /// [`Error::Expression`] if a term is not finite on these data.
    pub fn rmse(&self, search: &Search, chosen: &[Chosen]) -> Result<f64, Error> {
        let fitted = search.fit(chosen)?;
        let spec = extended(search.spec, &fitted, chosen).frozen();
        let model = Model::declared(&spec)?;
        Ok(stats::rms(&declared::residual_of_fixed(
            &self.problem,
            &model,
        )?))
    }

    /// The figures of a report.
    ///
    /// # Errors
    /// As [`Checked::rmse`].
    pub fn figures(
        &self,
        search: &Search,
        found: &[Chosen],
        all: &[Chosen],
    ) -> Result<Check, Error> {
        Ok(Check {
            files: self.files.clone(),
            rows: self.problem.y.len(),
            repeated_rows: hygiene::repeated_rows(&search.problem.frame, &self.problem.frame)
                .min(self.problem.y.len()),
            declared_rmse: self.rmse(search, &[])?,
            found_rmse: self.rmse(search, found)?,
            all_rmse: self.rmse(search, all)?,
        })
    }
}
