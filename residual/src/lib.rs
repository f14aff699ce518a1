//! Finds what a force model lacks, from measured data.
//!
//! Given logs and a declared model (linear in its parameters, `MODEL.toml`), the analysis fits the
//! model, tests its residual on groups that were held out, and searches a catalogue of physical
//! effects for what is missing. The report names the effects with their parameters, the rivals and
//! the difference to them, and effects that are too small to matter. Its verdict also says when
//! nothing is missing, when the data cannot distinguish effects, and when no effect explains what
//! is left.
//!
//! The crates below this one hold many constants. Where the doc of a constant gives a derivation, a
//! paper or a measurement, its value comes from there. The others were chosen by hand, not tuned:
//! they have the value with which they were written. `cargo xtask residual-bench` shows what a
//! change does.
//!
//! [`run`] reads files and writes reports; [`analyse`] works on columns in memory ([`Data`]).
//! `docs/residual/method.md` describes the method.
//!
//! ```
//! use residual::{baseline, spec::Spec, Data};
//!
//! // A declared model: force = command. The fitted gain shows what it is worth.
//! let model = Spec::parse(
//!     r#"
//! [roles]
//! time = { column = "t", unit = "s" }
//! target = { column = "force", unit = "N" }
//! command = { column = "command", unit = "N" }
//!
//! [[terms]]
//! name = "gain"
//! expr = "command"
//! "#,
//! )?;
//! let time: Vec<f64> = (0..90).map(|i| f64::from(i % 30) * 0.01).collect();
//! let command: Vec<f64> = (0..90).map(|i| 2.0 + f64::from(i).sin()).collect();
//! let force: Vec<f64> = command.iter().map(|c| 1.1 * c).collect();
//! let data = Data::from_columns(time, [("command", command), ("target", force)])
//!     .sequences([0..30, 30..60, 60..90])
//!     .build()?;
//! let declared = baseline(&model, &data)?;
//! let gain = &declared.terms[0];
//! assert_eq!(gain.name, "gain");
//! assert!((gain.coefficient - 1.1).abs() < 1e-9);
//! # Ok::<(), residual::Error>(())
//! ```

mod analysis;
mod assembly;
mod nested;
mod pictures;

pub use analysis::{analyse, analyse_checked, run, run_checked, Options};
pub use nested::{nested, Nested, NestedFold};
pub use residual_columns::error::Error;
pub use residual_columns::expr;
pub use residual_columns::format::num;
pub use residual_columns::frame::Frame;
pub use residual_columns::progress::{Console, Progress, Ticker};
pub use residual_columns::stats::few_unlike;
pub use residual_effects::{experiment, meaning, names, EffectKind, Form, Param};
pub use residual_evidence::by_log::LogError;
pub use residual_evidence::check::Check;
pub use residual_evidence::leftover::Structure;
pub use residual_evidence::residual_tests::ModelTest;
pub use residual_evidence::verdict::Verdict;
pub use residual_fit::diagnostics::ResidualTest;
pub use residual_log::data::{Data, DataBuilder};
pub use residual_log::finding::Finding;
pub use residual_log::{load, spec};
pub use residual_report::{
    clear, Ambiguity, Compensation, Effect, EqualPath, NotMaterial, Plot, Report, Ripple, Tested,
    MODELS, SCHEMA_VERSION,
};
pub use residual_search::declared::{baseline, Baseline, DeclaredTerm};
pub use residual_search::figures::Figures;
pub use residual_search::Rival;
