//! `forcectl explain`: what a fault means and how to clear it.

use super::exit::{Failure, Reply, Result};
use super::values;
use clap::Args;
use control::faults::Scope;
use control::Fault;
use serde_json::json;
use std::fmt::Write as _;

/// Arguments of `explain`.
#[derive(Debug, Args)]
pub struct Explain {
    /// Number of the fault; without it, all faults are listed
    #[arg(value_parser = values::fault_number)]
    number: Option<u16>,
}

fn scope(fault: Fault) -> &'static str {
    match fault.scope() {
        Scope::Board => "board",
        Scope::Unit => "unit",
    }
}

impl Explain {
    /// Runs the command.
    pub fn run(&self) -> Result<Reply> {
        let Some(number) = self.number else {
            return Ok(list());
        };
        let fault = Fault::from_code(number).ok_or_else(|| {
            Failure::usage(format!(
                "there is no fault {number}; `forcectl explain` lists all faults"
            ))
        })?;
        Ok(page(fault))
    }
}

fn list() -> Reply {
    let mut text = String::new();
    for fault in Fault::ALL {
        let _ = writeln!(
            text,
            "{:>3}  {:<5}  {}",
            fault.code(),
            scope(*fault),
            fault.name()
        );
    }
    let faults: Vec<_> = Fault::ALL
        .iter()
        .map(|fault| json!({"fault": fault.code(), "name": fault.name(), "scope": scope(*fault)}))
        .collect();
    Reply::new(text, json!({ "faults": faults }))
}

fn page(fault: Fault) -> Reply {
    let (code, name) = (fault.code(), fault.name());
    let stops = match fault.scope() {
        Scope::Board => "all six motors",
        Scope::Unit => "one unit; the other units continue",
    };
    Reply::new(
        format!(
            "fault {code}: {name}\n\nstops       {stops}\nmeaning     {}\nwhat to do  {}\ndetail      {}\n",
            fault.meaning(),
            fault.what_to_do(),
            fault.detail_meaning()
        ),
        json!({
            "fault": code,
            "name": name,
            "scope": scope(fault),
            "meaning": fault.meaning(),
            "what_to_do": fault.what_to_do(),
            "detail": fault.detail_meaning(),
        }),
    )
}
