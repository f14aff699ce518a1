//! A fault that a run met.

use serde::Serialize;
use session::explain_fault;

/// A fault that was latched during a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunFault {
    /// Time since the force was commanded, s.
    pub t_s: f64,
    /// Unit from 1; `None`: the whole board.
    pub unit: Option<u8>,
    /// Number.
    pub code: u16,
    /// What it means and how to clear it.
    pub text: String,
}

impl RunFault {
    /// A fault of unit `i` (from 0) at a time, s.
    pub(super) fn of_unit(t_s: f64, i: usize, code: u16, detail: u32) -> Self {
        Self {
            t_s,
            unit: Some(i as u8 + 1),
            code,
            text: explain_fault(code, detail),
        }
    }
}
