//! What Python calls of the force rig's crates. `python/forcerig/` is the package that people use:
//! it checks shapes and gives results their form; this module converts, and calls the crates that
//! forcectl calls.
//!
//! Arrays come and go as bytes of 64-bit floats, results with many figures as JSON text. Work that
//! takes long runs without the interpreter's lock (`background`). What the crates refuse is the
//! exception `Refused` with their words.

mod analysis;
mod background;
mod estimation;
mod gain;
mod raven;
mod rig_file;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use std::fmt::Display;

pyo3::create_exception!(
    _native,
    Refused,
    PyValueError,
    "Input that the rig's programs refuse, in their words. `exit_code` is that of the command: 2 arguments or model file; \
     3 a rig file, or a log that can't be read; 4 data that allow no answer; 6 readings that give no gain or zero."
);

/// Exit code of wrong arguments.
const USAGE: u8 = 2;

/// The exception for what a command ends with `exit_code` for.
fn refused(exit_code: u8, error: impl Display) -> PyErr {
    let exception = Refused::new_err(error.to_string());
    Python::attach(|py| {
        // An exception without its number is still the right one.
        let _ = exception.value(py).setattr("exit_code", exit_code);
    });
    exception
}

/// The exception for arguments that can't be used.
fn usage(error: impl Display) -> PyErr {
    refused(USAGE, error)
}

/// The numbers of an array.
fn floats(bytes: &[u8]) -> Vec<f64> {
    bytes
        .as_chunks::<8>()
        .0
        .iter()
        .map(|number| f64::from_ne_bytes(*number))
        .collect()
}

/// The bytes of an array.
fn bytes_of(numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
    numbers.into_iter().flat_map(f64::to_ne_bytes).collect()
}

/// Columns by name, as they come from Python.
type NamedBytes = Vec<(String, PyBackedBytes)>;

/// The force rig's crates for Python.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::analysis::{analyse_files, analyse_tables, guess, Report, Spec};
    #[pymodule_export]
    use super::estimation::{Estimator, Stream};
    #[pymodule_export]
    use super::gain::{gain, zero};
    #[pymodule_export]
    use super::raven::{
        forward, from_crtk, inverse, jacobian, joints_from_motors, limits, motors_from_joints,
        to_crtk,
    };
    #[pymodule_export]
    use super::rig_file::Rig;
    #[pymodule_export]
    use super::Refused;
}
