//! The list of cases: `models/cases.toml`, with the model files beside it.

use serde::Deserialize;

/// The list.
const CASES: &str = include_str!("../../models/cases.toml");

/// Model files by name.
const MODELS: &[(&str, &str)] = &[
    (
        "dvrk-insertion.toml",
        include_str!("../../models/dvrk-insertion.toml"),
    ),
    (
        "dvrk-joint-2.toml",
        include_str!("../../models/dvrk-joint-2.toml"),
    ),
    (
        "laas-cogging.toml",
        include_str!("../../models/laas-cogging.toml"),
    ),
    ("mis-tool.toml", include_str!("../../models/mis-tool.toml")),
    (
        "ur10e-joint-1.toml",
        include_str!("../../models/ur10e-joint-1.toml"),
    ),
    (
        "ur10e-joint-4.toml",
        include_str!("../../models/ur10e-joint-4.toml"),
    ),
];

/// One analysis of a data set.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Name in the table.
    pub name: String,
    /// Model file beside the list.
    pub model: String,
    /// Files and folders below the folder of the data sets.
    pub data: Vec<String>,
    /// Files and folders of the same machine that take no part in the search.
    #[serde(default)]
    pub check: Vec<String>,
    /// Names of effects that the machine has.
    pub right: Vec<String>,
    /// Why they are right.
    pub why: String,
}

/// The file with all cases.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    case: Vec<Case>,
}

/// All cases.
///
/// # Errors
/// Where the list is no TOML of this form; a test reads it.
pub fn all() -> Result<Vec<Case>, String> {
    let list: List = toml::from_str(CASES).map_err(|e| format!("models/cases.toml: {e}"))?;
    Ok(list.case)
}

/// Text of a model file by its name.
#[must_use]
pub fn model(name: &str) -> Option<&'static str> {
    MODELS.iter().find(|(n, _)| *n == name).map(|(_, t)| *t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual::spec::Spec;

    #[test]
    fn every_case_has_a_model_that_parses_and_names_effects_of_the_catalogue() {
        let cases = all().expect("the list is read");
        assert!(!cases.is_empty());
        for case in &cases {
            let text = model(&case.model).unwrap_or_else(|| panic!("{}: no model", case.name));
            Spec::parse(text).unwrap_or_else(|e| panic!("{}: {e}", case.model));
            assert!(
                !case.data.is_empty() && !case.why.is_empty(),
                "{}",
                case.name
            );
            for name in &case.right {
                assert!(residual::names().contains(&name.as_str()), "{name}");
            }
        }
        for (name, _) in MODELS {
            assert!(cases.iter().any(|c| c.model == *name), "{name} is used");
        }
    }
}
