//! Model files that a report writes: the extended one and the frozen one.

use super::Report;
use residual_columns::error::Error;

impl Report {
    /// The extended model file: an analysis of the same data with it reproduces the final fit.
    ///
    /// # Errors
    /// [`Error::Model`] if it cannot be written as TOML.
    pub fn model(&self) -> Result<String, Error> {
        toml::to_string(&self.extended).map_err(|e| Error::model(e.to_string()))
    }

    /// The extended model with every coefficient fixed at its fitted value: on other data, its
    /// baseline is a test on rows that it was never fitted to. Terms with a coefficient for each
    /// sequence have no meaning there and are left out.
    ///
    /// # Errors
    /// [`Error::Model`] if it cannot be written as TOML.
    pub fn frozen(&self) -> Result<String, Error> {
        toml::to_string(&self.extended.frozen()).map_err(|e| Error::model(e.to_string()))
    }
}
