//! The residual analysis: `forcectl residual` on files and on columns in memory.

use crate::{background, floats, refused, usage, NamedBytes};
use pyo3::prelude::*;
use residual::load::Table;
use residual::{spec, Error, Options};
use std::path::PathBuf;

fn failed(error: Error) -> PyErr {
    refused(error.exit_code(), error)
}

/// A checked model file.
#[pyclass(frozen, module = "forcerig._native")]
pub struct Spec(spec::Spec);

#[pymethods]
impl Spec {
    /// Reads a model file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        spec::Spec::load(&path).map(Self).map_err(failed)
    }

    /// Checks the text of a model file.
    #[staticmethod]
    fn parse(text: &str) -> PyResult<Self> {
        spec::Spec::parse(text).map(Self).map_err(failed)
    }

    /// Checks a model file that is given as JSON.
    #[staticmethod]
    fn of_json(text: &str) -> PyResult<Self> {
        let table: toml::Table =
            serde_json::from_str(text).map_err(|error| usage(format!("model file: {error}")))?;
        Self::parse(&table.to_string())
    }
}

/// What an analysis found.
#[pyclass(frozen, module = "forcerig._native")]
pub struct Report(residual::Report);

#[pymethods]
impl Report {
    /// As `report` of `forcectl residual --json`.
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(&self.0).map_err(|error| refused(7, error))
    }

    /// The verdict in some sentences.
    fn summary(&self) -> String {
        self.0.summary()
    }

    /// The written report.
    fn markdown(&self) -> String {
        self.0.markdown()
    }

    /// Names and forms of the effects, as the command lists them.
    fn names(&self) -> Vec<(String, String)> {
        let effects = self.0.effects.iter();
        effects
            .map(|effect| (self.0.alternatives(effect), self.0.details(effect)))
            .collect()
    }

    /// Writes the reports into a folder, as `--out` does.
    fn write(&self, folder: PathBuf) -> PyResult<()> {
        residual::clear(&folder)
            .and_then(|()| self.0.write(&folder))
            .map_err(|error| refused(7, error))
    }
}

/// A table in memory: its name, columns of numbers, columns of times in s with their type, columns
/// of text with a cell.
type Columns = (
    String,
    NamedBytes,
    Vec<(String, String, pyo3::pybacked::PyBackedBytes)>,
    Vec<(String, String)>,
);

fn table((name, numbers, times, text): Columns) -> Table {
    let mut table = Table::new(name);
    for (name, values) in numbers {
        table = table.with(name, floats(&values));
    }
    for (name, what, values) in times {
        let what = match what.as_str() {
            "duration" => "a duration",
            _ => "a timestamp",
        };
        table = table.with_time(name, floats(&values), what);
    }
    for (name, cell) in text {
        table = table.with_text(name, cell);
    }
    table
}

/// Analyses columns in memory.
#[pyfunction]
#[pyo3(signature = (model, tables, check, progress=None))]
pub fn analyse_tables(
    py: Python<'_>,
    model: &Spec,
    tables: Vec<Columns>,
    check: Vec<Columns>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Report> {
    let spec = &model.0;
    background::run(py, progress, |mut watch| {
        let data = residual::load::from_tables(tables.into_iter().map(table).collect(), spec)?;
        let check: Vec<Table> = check.into_iter().map(table).collect();
        let check = match check.is_empty() {
            true => None,
            false => Some(residual::load::from_tables_to_check(check, spec)?),
        };
        residual::analyse_checked(spec, data, check.as_ref(), &mut watch)
    })?
    .map(Report)
    .map_err(failed)
}

/// Analyses log files and folders.
#[pyfunction]
#[pyo3(signature = (model, data, check, progress=None))]
pub fn analyse_files(
    py: Python<'_>,
    model: &Spec,
    data: Vec<PathBuf>,
    check: Vec<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Report> {
    let options = Options {
        data,
        model: model.0.clone(),
        out: None,
    };
    background::run(py, progress, |mut watch| {
        residual::run_checked(&options, &check, &mut watch)
    })?
    .map(Report)
    .map_err(failed)
}

/// A first model file for logs, with open questions.
#[pyfunction]
pub fn guess(data: Vec<PathBuf>) -> PyResult<String> {
    residual::load::guess(&data).map_err(failed)
}
