//! The report of an analysis: what was found (`types`), and its written forms.
//!
//! | file | concern |
//! |---|---|
//! | `types.rs` | [`Report`] and its parts: the keys of `report.json` |
//! | `json.rs` | `report.json`, written and read |
//! | `summary.rs` | the verdict in a sentence |
//! | `document.rs`, `sections.rs`, `words.rs` | the text of the report as a list of parts |
//! | `markdown.rs`, `html.rs` | that list as `report.md` and `report.html` |
//! | `axis.rs` | labels of plots in words |
//! | `plot.rs`, `svg.rs` | data of plots, and their pictures |
//! | `model_file.rs` | `MODEL.extended.toml` and `MODEL.frozen.toml` |
//! | `folder.rs` | the folder that all of them are written to |

mod axis;
mod compensation;
mod document;
#[cfg(test)]
mod example;
mod folder;
mod html;
mod json;
mod markdown;
mod model_file;
mod plot;
mod sections;
mod summary;
mod svg;
mod types;
mod words;

pub use compensation::{Compensation, Ripple};
pub use folder::{clear, MODELS};
pub use plot::Plot;
pub use plot::WITHOUT;
pub use types::{Ambiguity, Effect, NotMaterial, Report, Tested};

pub use residual_evidence::attribution::EqualPath;
use residual_evidence::leftover::Structure;
use residual_evidence::residual_tests::ModelTest;
use residual_evidence::verdict::Verdict;
use residual_search::declared::DeclaredTerm;
use residual_search::figures::Figures;
use residual_search::Rival;

/// Version of the keys of `report.json`. It grows by one whenever a key is removed, renamed or
/// changes its meaning; [`Report::read`] refuses other versions.
pub const SCHEMA_VERSION: u32 = 1;
