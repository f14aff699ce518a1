//! What a report needs, looked at before anything is trained: a training takes hours, and what
//! fails at its end is lost.

use super::super::load::Data;
use super::super::study::longest_beginnings_s;
use super::{Inputs, ReportError, Settings};
use estimator::sequence::Sequence;
use std::path::Path;

/// Files of a report that are written again and again.
pub(super) const FIGURES: [&str; 2] = ["figures.md", "figures.json"];
/// Trials at least: one to test, two to train, because intervals hold one out.
const TRIALS: usize = 3;
/// Trials of forces in three dimensions at least: one to train, one to test.
const THREE_AXES_TRIALS: usize = 2;
/// Length that a stretch must exceed, s: 10 s are left out of each, and the physical model needs a
/// hundred rows of the rest.
const STRETCH_S: f64 = 12.0;

/// Whether the files of a report can be written to a folder; makes the folder. What is there
/// already stays as it is.
///
/// # Errors
/// [`ReportError::File`].
pub fn probe(into: &Path) -> Result<(), ReportError> {
    let failed = |path: &Path, cause| ReportError::File {
        path: path.display().to_string(),
        cause,
    };
    std::fs::create_dir_all(into).map_err(|cause| failed(into, cause))?;
    // The pictures are new files, the figures may be files that are there.
    for name in FIGURES.into_iter().chain([".probe"]) {
        probe_file(&into.join(name))?;
    }
    Ok(())
}

/// Whether a file can be written. One that is there stays as it is.
///
/// # Errors
/// [`ReportError::File`].
pub fn probe_file(path: &Path) -> Result<(), ReportError> {
    let failed = |cause| ReportError::File {
        path: path.display().to_string(),
        cause,
    };
    let was_there = path.exists();
    let opened = std::fs::OpenOptions::new()
        .append(true)
        .create(true)
        .open(path);
    opened.map_err(failed)?;
    if !was_there {
        std::fs::remove_file(path).map_err(failed)?;
    }
    Ok(())
}

/// Whether the data suffice for all parts.
pub(super) fn data(inputs: &Inputs<'_>, settings: &Settings) -> Result<(), ReportError> {
    let data = inputs.data;
    trials("a report", data, TRIALS)?;
    let training = data.of(&settings.training);
    lengths(&data.name, &training)?;
    lengths(&data.name, &data.of(&settings.test))?;
    let all = |data: &Data| lengths(&data.name, &data.sequences.iter().collect::<Vec<_>>());
    if let Some(more) = inputs.unseen {
        all(more)?;
    }
    for (_, other) in inputs.also {
        all(other)?;
    }
    if let Some(other) = inputs.three_axes {
        trials("--three-axes", other, THREE_AXES_TRIALS)?;
        let numbers = other.trials();
        let (last, first) = numbers.split_last().expect("there are two");
        lengths(&other.name, &other.of(first))?;
        lengths(&other.name, &other.of(&[*last]))?;
    }
    let Some(minutes) = settings.group_minutes else {
        return Ok(());
    };
    let longest = longest_beginnings_s(&training, Some(minutes));
    match longest.iter().find(|(_, seconds)| **seconds <= STRETCH_S) {
        None => Ok(()),
        Some((trial, seconds)) => Err(ReportError::Data(format!(
            "--group-minutes {minutes}: of trial {trial} of {} no stretch longer than {seconds:.1} s is left, each trial needs one of more than {STRETCH_S} s, because its first 10 s are left out; give more minutes",
            data.name
        ))),
    }
}

fn trials(what: &str, data: &Data, least: usize) -> Result<(), ReportError> {
    let found = data.trials();
    if found.len() >= least {
        return Ok(());
    }
    Err(ReportError::Data(format!(
        "{}: {what} needs at least {least} trials, there are {found:?}; give a folder with more",
        data.name
    )))
}

/// Whether any stretch is long enough.
fn lengths(name: &str, sequences: &[&Sequence]) -> Result<(), ReportError> {
    let seconds = |s: &&Sequence| s.rows() as f64 * s.step_s;
    let longest = sequences.iter().map(seconds).fold(0.0, f64::max);
    if longest > STRETCH_S {
        return Ok(());
    }
    let mut trials: Vec<usize> = sequences.iter().map(|s| s.trial).collect();
    trials.dedup();
    Err(ReportError::Data(format!(
        "{name}: the longest unbroken stretch of the trials {trials:?} is {longest:.1} s; one of more than {STRETCH_S} s is needed, because the first 10 s are left out"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_probed_without_changing_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let into = folder.path().join("deep/er");
        probe(&into).unwrap();
        assert_eq!(std::fs::read_dir(&into).unwrap().count(), 0);
        std::fs::write(into.join("figures.md"), "before").unwrap();
        probe(&into).unwrap();
        let text = std::fs::read_to_string(into.join("figures.md")).unwrap();
        assert_eq!(text, "before");
        // A folder where a file must go.
        std::fs::create_dir(into.join("figures.json")).unwrap();
        let error = probe(&into).unwrap_err().to_string();
        assert!(
            error.contains("figures.json") && error.contains("cannot be written"),
            "{error}"
        );
        let error = probe(&into.join("figures.md")).unwrap_err().to_string();
        assert!(error.contains("figures.md"), "{error}");
    }
}
