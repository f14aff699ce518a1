//! The analysis on public measured data sets, each with what is known about its physics.
//!
//! The data sets are not part of this project. `real-bench --data DIR` takes a folder with clones
//! of the repositories that `models/cases.toml` names; cases without their folder are left out and
//! counted.
//!
//! * [`case`]: the list of cases and what counts as right in each;
//! * [`table`]: the results as Markdown.

pub mod case;
pub mod table;

use case::Case;
use residual::spec::Spec;
use residual::{EffectKind, Options, Report};
use std::path::Path;

/// A name in a report, and whether the physics of the machine has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// Name and form.
    pub text: String,
    /// Whether it is right: the case lists it, or lists an effect of its group.
    pub right: bool,
}

/// What came out for one case.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The case.
    pub case: Case,
    /// The report.
    pub report: Report,
    /// Effects found.
    pub found: Vec<Named>,
    /// Whether the frozen model with the found effects is not worse than the declared one on the
    /// check data; `None` without.
    pub holds: Option<bool>,
}

/// Runs a case on data below `folder`. `None` where its data are not there.
///
/// # Errors
/// The analysis's own message with the case's name.
pub fn run(case: &Case, folder: &Path) -> Result<Option<Outcome>, String> {
    let paths = |list: &[String]| list.iter().map(|p| folder.join(p)).collect::<Vec<_>>();
    let (data, check) = (paths(&case.data), paths(&case.check));
    if data.iter().chain(&check).any(|p| !p.exists()) {
        return Ok(None);
    }
    let named = |e: residual::Error| format!("{}: {e}", case.name);
    let text = case::model(&case.model)
        .ok_or_else(|| format!("{}: there is no model file `{}`", case.name, case.model))?;
    let options = Options {
        data,
        model: Spec::parse(text).map_err(named)?,
        out: None,
    };
    let report = residual::run_checked(&options, &check, &mut ()).map_err(named)?;
    let found = report
        .effects
        .iter()
        .map(|e| {
            let alike = |kind: &EffectKind| case.right.iter().any(|r| kind == r.as_str());
            Named {
                text: format!("{} ({})", e.name, e.form),
                right: alike(&e.name) || report.others(e.name).concat().iter().any(alike),
            }
        })
        .collect();
    // Equal errors (nothing was found) are not worse.
    let holds = report
        .check
        .as_ref()
        .map(|c| c.found_rmse <= c.declared_rmse);
    Ok(Some(Outcome {
        case: case.clone(),
        report,
        found,
        holds,
    }))
}
