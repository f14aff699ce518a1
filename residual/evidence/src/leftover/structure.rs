//! Structure without a name.

use residual_columns::nan;
use serde::{Deserialize, Serialize};

/// Structure in the residual of the final model that no effect of the catalogue explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Structure {
    /// Variables that it depends on, in words.
    pub depends_on: String,
    /// Relative reduction of the held-out RMSE by a free curve in these variables: 0.05 is 5 %.
    #[serde(deserialize_with = "nan::from_null")]
    pub gain: f64,
    /// p value: probability of such a reduction without any such structure.
    #[serde(deserialize_with = "nan::from_null")]
    pub p_value: f64,
}

impl Structure {
    /// Unexplained structure; for the units see the fields.
    pub fn new(depends_on: impl Into<String>, gain: f64, p_value: f64) -> Self {
        Structure {
            depends_on: depends_on.into(),
            gain,
            p_value,
        }
    }
}
