//! Calibration from arrays: the gain of a load cell from weights, and its zero.

use crate::{refused, usage};
use calibration::gain::{self as cell, figures, Options, Term, Tolerance};
use calibration::zero as slack;
use pyo3::prelude::*;
use serde_json::json;

/// The input of [`gain`] beside the readings.
#[derive(FromPyObject)]
pub struct Choice {
    #[pyo3(item)]
    gravity_m_per_s2: Option<f64>,
    #[pyo3(item)]
    gravity_relative_sd: Option<f64>,
    #[pyo3(item)]
    class: Option<String>,
    #[pyo3(item)]
    tolerance: Option<f64>,
    #[pyo3(item)]
    correlation: f64,
    #[pyo3(item)]
    nominal_n_per_code: Option<f64>,
    #[pyo3(item)]
    weights_g: Vec<f64>,
    #[pyo3(item)]
    left_out: Vec<usize>,
    #[pyo3(item)]
    corrections_g: Vec<(usize, f64)>,
}

impl Choice {
    fn options(self) -> PyResult<Options> {
        let usual = Options::default();
        let mut weights = usual.weights;
        weights.correlation = self.correlation;
        if let Some(class) = self.class {
            weights.tolerance = Tolerance::Class(class.parse().map_err(usage)?);
        }
        if let Some(part) = self.tolerance {
            weights.tolerance = Tolerance::Relative(part);
        }
        let mut weights_g = usual.weights_g.clone();
        weights_g.extend(self.weights_g);
        Ok(Options {
            gravity_m_per_s2: self.gravity_m_per_s2.unwrap_or(usual.gravity_m_per_s2),
            gravity_relative_sd: self
                .gravity_relative_sd
                .unwrap_or(usual.gravity_relative_sd),
            weights,
            weights_g,
            nominal_n_per_code: self.nominal_n_per_code,
            left_out: self.left_out,
            corrections_g: self.corrections_g.into_iter().collect(),
            ..usual
        })
    }
}

/// The gain of the readings in a table of text; `name` stands for it in errors.
#[pyfunction]
pub fn gain(name: &str, text: &str, choice: Choice) -> PyResult<String> {
    let options = choice.options()?;
    let readings = cell::read(name, text).map_err(usage)?;
    let found = cell::fit(&readings, &options).map_err(|error| refused(6, error))?;
    let shape = figures::shape(&found);
    let conversion = found.conversion();
    let parts = &found.relative_parts;
    let curve = found.terms.get(&Term::Quadratic);
    let residuals: Vec<_> = found
        .residuals
        .iter()
        .map(|r| json!({"line": r.at.line, "force_n": r.force_n, "residual_n": r.residual_n, "sd_n": r.sd_n}))
        .collect();
    Ok(json!({
        "n_per_code": found.n_per_code, "n_per_code_sd": found.n_per_code_sd,
        "n_per_code_half_95": found.n_per_code_half_95, "within_half_95": found.within_half_95,
        "n_per_code2": conversion.n_per_code2, "zero_code": found.zero_code, "zero_code_se": found.zero_code_se,
        "curve_per_n": curve.map(|curve| curve.value / found.codes_per_n),
        "creep": found.creep.map(|c| c.share), "creep_s": found.creep.map(|c| c.time_s),
        "linearity_n": shape.linearity_n, "hysteresis_n": shape.hysteresis.map(|h| h.largest_n),
        "repeatability_n": found.repeatability_codes * found.n_per_code.abs(),
        "chi_square": found.chi_square, "degrees_of_freedom": found.degrees_of_freedom,
        "parts_relative": {"readings": parts.readings, "weights": parts.weights, "gravity": parts.gravity, "beyond": parts.beyond,
            "remounting": parts.remounting, "pulley": parts.pulley},
        "readings": readings.len(), "residuals": residuals,
    })
    .to_string())
}

/// The zero of a stream of codes with a slack cable.
#[pyfunction]
pub fn zero(codes: Vec<i32>, nominal_n_per_code: f64) -> PyResult<String> {
    if !(nominal_n_per_code.is_finite() && nominal_n_per_code != 0.0) {
        return Err(usage(format!(
            "nominal_n_per_code is {nominal_n_per_code}: give the scale of the cell in N per code, as 6.85e-6"
        )));
    }
    let limits = slack::Limits {
        nominal_n_per_code: nominal_n_per_code.abs(),
        ..slack::Limits::default()
    };
    let found = slack::measure(&codes, &limits).map_err(|error| refused(6, error))?;
    Ok(json!({
        "zero_code": found.at_end_codes, "zero_code_se": found.at_end_se_codes,
        "mean_code": found.mean_codes, "mean_code_se": found.mean_se_codes,
        "drift_codes": found.drift_codes, "drift_codes_se": found.drift_se_codes,
        "noise_codes": found.noise_sd_codes, "correlation_samples": found.correlation_samples,
        "used": found.used, "spikes": found.spikes,
    })
    .to_string())
}
