//! Estimators of the contact force: train on a data set, read and write a model, run it row by row.

use crate::background::{self, Watch};
use crate::{bytes_of, floats, refused, usage};
use estimate::card::{ModelCard, Run};
use estimate::evaluate::{self, Replay};
use estimate::load::{self, check_robot, Data};
use estimator::data::{Label, Mapping};
use estimator::estimator::{Estimator as Model, Kind, NetworkLimits, Training};
use estimator::model::ModelError;
use estimator::motion::INPUTS;
use estimator::sequence::Sequence;
use estimator::stream::{self, Before, Sure};
use estimator::trees::TreesConfig;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{channel, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// The model file's exit code when it can't be written.
const FILE: u8 = 7;

/// A trained model.
#[pyclass(frozen, module = "forcerig._native")]
pub struct Estimator {
    model: Arc<Model>,
    /// Of a model that was trained here: it lies beside its file.
    card: Option<ModelCard>,
}

/// What [`Estimator::train`] needs beside the data.
#[derive(FromPyObject)]
struct Choice {
    #[pyo3(item)]
    model: String,
    #[pyo3(item)]
    rate_hz: f64,
    #[pyo3(item)]
    test: Vec<usize>,
    #[pyo3(item)]
    seed: u64,
    #[pyo3(item)]
    intervals: bool,
    #[pyo3(item)]
    all_axes: bool,
}

fn mapping(file: Option<&Path>) -> PyResult<Mapping> {
    file.map_or_else(
        || Ok(Mapping::default()),
        |file| load::mapping(file).map_err(usage),
    )
}

/// The model that a name stands for.
fn kind(name: &str) -> PyResult<Kind> {
    let known: Vec<&str> = Kind::ALL.iter().map(|kind| kind.name()).collect();
    Kind::of(name).ok_or_else(|| {
        usage(format!(
            "there is no model `{name}`; there are {}",
            known.join(", ")
        ))
    })
}

/// Rate of the rows, Hz, that the command allows.
fn rate(rate_hz: f64) -> PyResult<f64> {
    if (1.0..=1000.0).contains(&rate_hz) {
        return Ok(rate_hz);
    }
    Err(usage(format!(
        "rate_hz is {rate_hz}: allowed are 1 to 1000 Hz"
    )))
}

/// Trains and evaluates, as `forcectl estimate train` does.
fn train(
    data: &Data,
    choice: &Choice,
    kind: Kind,
    watch: &Watch,
) -> Result<(Model, ModelCard), String> {
    let words = |error: ModelError| error.to_string();
    let (training, test) = data.split(&choice.test).map_err(|error| error.0)?;
    let rows: Vec<&Sequence> = data.of(&training);
    evaluate::testable(&data.of(&test)).map_err(words)?;
    let settings = Training {
        kind,
        axes: if choice.all_axes {
            vec![0, 1, 2]
        } else {
            data.axes.clone()
        },
        base: data.base(&training).map_err(|error| error.0)?,
        robot: data.robot.clone(),
        trees: TreesConfig {
            seed: choice.seed,
            ..TreesConfig::default()
        },
        networks: NetworkLimits::default(),
        intervals: choice.intervals,
        absent: data.absent.clone(),
    };
    let began = Instant::now();
    let model = Model::train(&settings, &rows, &mut |progress| watch.tell(&progress.text))
        .map_err(words)?;
    let run = Run {
        training,
        test,
        seed: choice.seed,
        training_s: began.elapsed().as_secs_f64(),
    };
    watch.tell("figures on the test trials");
    let (evaluation, _) =
        evaluate::evaluate(&model, &data.of(&run.test), &Replay::default()).map_err(words)?;
    let card = ModelCard::new(&model, String::new(), data, &run, Some(evaluation));
    Ok((model, card))
}

#[pymethods]
impl Estimator {
    /// Trains on the folder of an experiment or of logs, or a log.
    #[staticmethod]
    #[pyo3(signature = (data, choice, mapping_file=None, progress=None))]
    fn train(
        py: Python<'_>,
        data: PathBuf,
        choice: Choice,
        mapping_file: Option<PathBuf>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let kind = kind(&choice.model)?;
        let rate_hz = rate(choice.rate_hz)?;
        let mapping = mapping(mapping_file.as_deref())?;
        let (model, card) = background::run(py, progress, |watch| {
            watch.tell("reading data");
            let data =
                load::load(&data, &mapping, rate_hz, Label::Needed).map_err(|error| error.0)?;
            train(&data, &choice, kind, watch)
        })?
        .map_err(usage)?;
        Ok(Self {
            model: Arc::new(model),
            card: Some(card),
        })
    }

    /// Reads a model file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let named = |error: &dyn std::fmt::Display| usage(format!("{}: {error}", path.display()));
        let text = std::fs::read_to_string(&path).map_err(|error| named(&error))?;
        let model = Model::from_json(&text).map_err(|error| named(&error))?;
        Ok(Self {
            model: Arc::new(model),
            card: ModelCard::read(&path).ok(),
        })
    }

    /// Writes the model file, and its card beside it.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        let failed =
            |error: &dyn std::fmt::Display| refused(FILE, format!("{}: {error}", path.display()));
        let text = self.model.to_json().map_err(|error| failed(&error))?;
        std::fs::write(&path, text).map_err(|error| failed(&error))?;
        if let Some(card) = &self.card {
            let mut card = card.clone();
            card.model_sha256 = files::sha256(&path).map_err(|error| failed(&error))?;
            card.write(&path).map_err(|error| failed(&error))?;
        }
        Ok(())
    }

    /// What it is: model, robot, rate, axes, inputs.
    fn json(&self) -> String {
        let model = &self.model;
        json!({
            "model": model.kind.name(), "robot": model.robot, "rate_hz": 1.0 / model.step_s, "axes": model.axes,
            "absent": model.absent, "intervals": model.interval.is_some(), "card": self.card,
        })
        .to_string()
    }

    /// Figures on trials of a data set, as `forcectl estimate eval` gives them.
    #[pyo3(signature = (data, trials, any_robot=false, mapping_file=None))]
    fn evaluate(
        &self,
        py: Python<'_>,
        data: PathBuf,
        trials: Vec<usize>,
        any_robot: bool,
        mapping_file: Option<PathBuf>,
    ) -> PyResult<String> {
        let mapping = mapping(mapping_file.as_deref())?;
        let model = &self.model;
        let found = background::run(py, None, |watch| {
            let data = self.read(&data, &mapping, Label::Needed, any_robot)?;
            let rows = data.of(&trials);
            if rows.is_empty() {
                return Err(format!(
                    "{}: it has no row of the trials {trials:?} (it has {:?})",
                    data.name,
                    data.trials()
                ));
            }
            let go_on = || watch.check();
            evaluate::evaluate_while(model, &rows, &Replay::default(), &go_on)
                .map_err(|error| error.to_string())
        })?
        .map_err(usage)?;
        Ok(json!(found.0).to_string())
    }

    /// Runs over a log, as `forcectl estimate run --replay` does: columns by name.
    #[pyo3(signature = (log, any_robot=false, mapping_file=None))]
    fn run(
        &self,
        py: Python<'_>,
        log: PathBuf,
        any_robot: bool,
        mapping_file: Option<PathBuf>,
    ) -> PyResult<Vec<(String, Vec<u8>)>> {
        let mapping = mapping(mapping_file.as_deref())?;
        background::run(py, None, |watch| {
            let data = self.read(&log, &mapping, Label::WhereThere, any_robot)?;
            Ok(self.replay(&data, watch))
        })?
        .map_err(|error: String| usage(error))
    }

    /// Runs row by row from now on.
    fn stream(&self) -> PyResult<Stream> {
        Stream::start(&self.model)
    }
}

/// Names of the components.
const AXES: [&str; 3] = ["x", "y", "z"];

impl Estimator {
    /// Data at the model's rate, with its inputs.
    fn read(
        &self,
        path: &Path,
        mapping: &Mapping,
        label: Label,
        any_robot: bool,
    ) -> Result<Data, String> {
        let model = &self.model;
        let mut data =
            load::load(path, mapping, 1.0 / model.step_s, label).map_err(|error| error.0)?;
        // A log alone names no robot; a data card beside it, or a mapping, does.
        let unnamed = label == Label::WhereThere
            && (data.robot == load::UNNAMED || model.robot == load::UNNAMED);
        check_robot(model, &data.robot, any_robot || unnamed).map_err(|error| error.0)?;
        data.fit_inputs(model).map_err(|error| error.to_string())?;
        Ok(data)
    }

    fn replay(&self, data: &Data, watch: &Watch) -> Vec<(String, Vec<u8>)> {
        let model = &self.model;
        let of_axis = |what: &str| -> Vec<String> {
            let axes = model.axes.iter();
            axes.map(|axis| format!("{what}_{}_n", AXES[*axis]))
                .collect()
        };
        let mut names = vec!["trial".to_owned(), "t_s".to_owned()];
        names.extend(of_axis("estimate"));
        names.extend(["half_width_n", "valid", "misfits"].map(str::to_owned));
        names.extend(of_axis("force"));
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        let mut stream = stream::Stream::new(model);
        let mut last = None;
        for sequence in &data.sequences {
            watch.check();
            match stream::between(last.replace(sequence), sequence) {
                Before::Gap(elapsed_s) => stream.gap(elapsed_s),
                _ => stream.reset(),
            }
            for k in 0..sequence.rows() {
                let sure = stream.step(sequence.input_row(k));
                let label = sequence.target_row(k);
                let row = [
                    sequence.trial as f64,
                    sequence.start_s + k as f64 * sequence.step_s,
                ];
                let estimate = stream.force().iter().copied().map(f64::from);
                let told = [
                    sure.half_n.unwrap_or(f64::NAN),
                    f64::from(u8::from(sure.usable())),
                    f64::from(u8::from(sure.misfits)),
                ];
                let force = model
                    .axes
                    .iter()
                    .map(|axis| label.get(*axis).map_or(f64::NAN, |force| f64::from(*force)));
                let cells = row.into_iter().chain(estimate).chain(told).chain(force);
                columns
                    .iter_mut()
                    .zip(cells)
                    .for_each(|(column, cell)| column.push(cell));
            }
        }
        names
            .into_iter()
            .zip(columns.into_iter().map(bytes_of))
            .collect()
    }
}

/// What a stream is asked.
enum Ask {
    /// The next row of inputs.
    Row(Vec<f32>),
    /// Rows are missing for this time, s.
    Gap(f64),
    /// The next row begins anew.
    Reset,
}

/// Force of a row, N, and how sure it is.
type Answer = (Vec<f32>, Sure);

/// A model that runs row by row. Its state borrows the model, so both live on a thread of their
/// own.
#[pyclass(frozen, module = "forcerig._native")]
pub struct Stream {
    line: Mutex<(Sender<Ask>, Receiver<Answer>)>,
    absent: Vec<usize>,
}

impl Stream {
    fn start(model: &Arc<Model>) -> PyResult<Self> {
        let (ask, asked) = channel();
        let (answer, answered) = channel();
        let of_thread = model.clone();
        // It ends with the channel, so with the Python object.
        std::thread::Builder::new()
            .name("estimator".into())
            .spawn(move || {
                let mut stream = stream::Stream::new(&of_thread);
                while let Ok(what) = asked.recv() {
                    match what {
                        Ask::Row(input) => {
                            let sure = stream.step(&input);
                            if answer.send((stream.force().to_vec(), sure)).is_err() {
                                break;
                            }
                        }
                        Ask::Gap(elapsed_s) => stream.gap(elapsed_s),
                        Ask::Reset => stream.reset(),
                    }
                }
            })?;
        Ok(Self {
            line: Mutex::new((ask, answered)),
            absent: model.absent.clone(),
        })
    }

    /// Asks; waits for the answer to a row.
    fn ask(&self, py: Python<'_>, what: Ask) -> PyResult<Option<Answer>> {
        py.detach(|| {
            let line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
            let waits = matches!(what, Ask::Row(_));
            line.0.send(what).ok()?;
            if waits {
                line.1.recv().ok().map(Some)
            } else {
                Some(None)
            }
        })
        .ok_or_else(ended)
    }
}

/// Only a panic ends the thread of a stream that is there.
fn ended() -> PyErr {
    PyRuntimeError::new_err(
        "a fault of this program: the estimator's thread has ended; please report it with what you called",
    )
}

#[pymethods]
impl Stream {
    /// Takes a row of nine inputs; gives the force, the half width of its interval, whether it can
    /// be used, whether the model misfits the robot.
    fn step(&self, py: Python<'_>, inputs: &[u8]) -> PyResult<(Vec<f32>, Option<f64>, bool, bool)> {
        let mut row: Vec<f32> = floats(inputs).iter().map(|input| *input as f32).collect();
        if row.len() != INPUTS {
            return Err(usage(format!(
                "a row has {INPUTS} inputs, and there are {}",
                row.len()
            )));
        }
        for input in &self.absent {
            row[*input] = 0.0;
        }
        if let Some(at) = row.iter().position(|input| !input.is_finite()) {
            return Err(usage(format!(
                "{} is {}: leave such rows out, and tell the time without rows with gap()",
                estimator::motion::INPUT_NAMES[at],
                row[at]
            )));
        }
        let (force, sure) = self.ask(py, Ask::Row(row))?.ok_or_else(ended)?;
        Ok((force, sure.half_n, sure.usable(), sure.misfits))
    }

    /// The next row comes `elapsed_s` after the one before it.
    fn gap(&self, py: Python<'_>, elapsed_s: f64) -> PyResult<()> {
        if !(elapsed_s.is_finite() && elapsed_s > 0.0) {
            return Err(usage(format!(
                "elapsed_s is {elapsed_s}: give the time from row to row, above 0 s"
            )));
        }
        self.ask(py, Ask::Gap(elapsed_s)).map(drop)
    }

    /// Forgets the past.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.ask(py, Ask::Reset).map(drop)
    }
}
