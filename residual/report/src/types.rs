//! What an analysis found: [`Report`] and its parts. These types are the single source of
//! `report.json` (docs/residual/report-json.md). Numbers are in full precision; "the target's unit"
//! is [`Report::unit`].

use super::json;
use super::plot::Plot;
use super::{DeclaredTerm, Figures, ModelTest, Rival, Structure, Verdict};
use residual_columns::nan;
use residual_effects::{EffectKind, Form};
use residual_evidence::attribution::EqualPath;
use residual_evidence::by_log::LogError;
use residual_evidence::check::Check;
use residual_log::finding::Finding;
use residual_log::spec::Spec;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One effect found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Name in the catalogue.
    pub name: EffectKind,
    /// Form of the effect, for readers: the catalogue has several for some effects.
    pub form: String,
    /// The form, where code depends on it.
    pub form_kind: Form,
    /// What the effect is, in words.
    pub meaning: String,
    /// Expressions added to the model (`column -> expression` for a replaced column, `everything ->
    /// expression` where every term goes through it).
    pub terms: Vec<String>,
    /// Parameters by name, in the unit of the same name in `units`.
    #[serde(deserialize_with = "nan::from_null")]
    pub params: BTreeMap<String, f64>,
    /// Units of the parameters by name; `1` for a ratio.
    pub units: BTreeMap<String, String>,
    /// 95 % intervals `[low, high]` of the parameters by name. Empty for an effect with
    /// coefficients for each sequence (a tone with a phase for each run).
    #[serde(deserialize_with = "nan::from_null")]
    pub ci: BTreeMap<String, [f64; 2]>,
    /// Names of the parameters whose value is at the limit of the range that was searched: the true
    /// one may lie beyond it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub at_limit: Vec<String>,
    /// Held-out RMSE before the effect was added, in the target's unit; the effects are added in
    /// the order of [`Report::effects`].
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_before: f64,
    /// Held-out RMSE after it was added, in the target's unit.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_after: f64,
    /// Held-out RMSE of the final model without this effect, the others fitted again, in the
    /// target's unit: what the effect is worth.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_without: f64,
    /// Why the data do not support the name; empty for an effect that was found.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unsupported: String,
    /// The best other effect in its place; `None` if there is none.
    pub rival: Option<Rival>,
    /// Residual with and without the effect, against the variable that exposes it.
    pub plot: Plot,
}

/// Effects that these data cannot distinguish.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ambiguity {
    /// Their names; the one that is also in [`Report::effects`] comes first.
    pub effects: Vec<EffectKind>,
    /// Experiments that would distinguish them.
    pub experiment: String,
}

impl Ambiguity {
    /// Effects that cannot be distinguished, and the experiment that would distinguish them.
    pub fn new(effects: Vec<EffectKind>, experiment: impl Into<String>) -> Self {
        Ambiguity {
            effects,
            experiment: experiment.into(),
        }
    }
}

/// An effect that is significant but too small to count.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NotMaterial {
    /// Name in the catalogue.
    pub name: EffectKind,
    /// Form of the effect.
    pub form: String,
    /// Relative reduction of the held-out RMSE: 0.005 is 0.5 %.
    #[serde(deserialize_with = "nan::from_null")]
    pub gain: f64,
    /// Its nonlinear parameter by name, if it has one.
    #[serde(deserialize_with = "nan::from_null")]
    pub params: BTreeMap<String, f64>,
}

/// One line of the last scan of the catalogue: an effect added to the final model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tested {
    /// Name in the catalogue.
    pub name: EffectKind,
    /// Form of the effect.
    pub form: String,
    /// Relative reduction of the held-out RMSE of the final model; negative where it grows.
    #[serde(deserialize_with = "nan::from_null")]
    pub gain: f64,
    /// p value of that reduction, from decoys: the residual with a random sign for each block of
    /// time.
    #[serde(deserialize_with = "nan::from_null")]
    pub p_value: f64,
    /// t statistic: mean reduction of the squared error per block of time, divided by its standard
    /// error.
    #[serde(deserialize_with = "nan::from_null")]
    pub t_statistic: f64,
    /// Its nonlinear parameter by name, if it has one.
    #[serde(deserialize_with = "nan::from_null")]
    pub params: BTreeMap<String, f64>,
}

/// Everything an analysis found. It is written as `report.json` and read back by [`Report::read`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of the keys of `report.json`: always [`SCHEMA_VERSION`](super::SCHEMA_VERSION).
    #[serde(deserialize_with = "json::known_version")]
    pub schema_version: u32,
    /// Title from the model file.
    pub title: String,
    /// Unit of the target.
    pub unit: String,
    /// Names of the files read, without folders.
    pub files: Vec<String>,
    /// Number of rows fitted.
    pub rows: usize,
    /// Number of sequences (stretches of rows without a gap).
    pub sequences: usize,
    /// Number of groups for hold-out.
    pub groups: usize,
    /// Names of the groups in each fold.
    pub folds: Vec<String>,
    /// Errors of the declared model.
    pub baseline: Figures,
    /// Errors of the final model.
    #[serde(rename = "final")]
    pub last: Figures,
    /// RMSE on folds that took no part in the selection, in the target's unit; `None` unless
    /// `selection.nested` of the model file asks for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nested_rmse: Option<f64>,
    /// The answer.
    pub verdict: Verdict,
    /// Effects found, the one that is worth most first.
    pub effects: Vec<Effect>,
    /// Effects that improve the fit under a name that the data do not support; `unsupported` says
    /// why. They are not in the final model.
    pub improves: Vec<Effect>,
    /// Errors of the model with `effects` and `improves`; `None` if there are no others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub with_all: Option<Figures>,
    /// The effect that `selection.max_effects` kept out, where the search ended there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limited: Option<EffectKind>,
    /// Frozen models on data that the search has not seen; `None` without such data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check: Option<Check>,
    /// Effects that these data cannot distinguish.
    pub not_identifiable: Vec<Ambiguity>,
    /// Other sets of effects that another course of the search found, and that predict as well.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub equal_paths: Vec<EqualPath>,
    /// Number of further courses of the search that predict as well and whose names were not
    /// judged.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub paths_not_judged: usize,
    /// Error of each log; empty for a single one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_log: Vec<LogError>,
    /// Structure that no effect of the catalogue explains, largest first.
    pub structure: Vec<Structure>,
    /// Effects that are significant but too small to count.
    pub seen_not_material: Vec<NotMaterial>,
    /// The last scan of the catalogue, on top of the final model.
    pub tested: Vec<Tested>,
    /// Effects that were not tested, because the data lack their columns or do not vary in them.
    pub absent: Vec<EffectKind>,
    /// Flaws of the data.
    pub hygiene: Vec<Finding>,
    /// Whiteness and cross-correlation tests of the residual before and after.
    pub residual_tests: Vec<ModelTest>,
    /// Declared terms, as fitted before any effect was added.
    pub declared: Vec<DeclaredTerm>,
    /// The model file with the effects added; in `report.json` its TOML text.
    #[serde(rename = "extended_model", with = "json::toml_text")]
    pub extended: Spec,
    /// Residual against the variable of the largest unexplained structure; `None` if there is none.
    pub plot_unknown: Option<Plot>,
}

/// Whether a count is left out of `report.json`.
fn is_zero(count: &usize) -> bool {
    *count == 0
}
