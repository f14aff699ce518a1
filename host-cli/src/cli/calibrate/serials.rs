//! `calibrate serials`: which parts a calibration is of.

use super::super::connection::Connection;
use super::super::exit::{Failure, Reply, Result};
use super::super::Context;
use super::Bench;
use calibration::record::Record;
use clap::Args;
use known::serials::{self, Serials};
use serde_json::json;
use std::fmt::Write as _;

/// Arguments of `calibrate serials`. Without a number to set, it shows those that are stored.
#[derive(Debug, Args)]
pub struct Command {
    /// Unit whose numbers are set
    #[arg(long, value_name = "N")]
    unit: Option<u8>,
    /// Serial number of the unit as a whole
    #[arg(long, value_name = "SERIAL", requires = "unit", value_parser = serials::parse)]
    whole: Option<String>,
    /// Serial number of its motor
    #[arg(long, value_name = "SERIAL", requires = "unit", value_parser = serials::parse)]
    motor: Option<String>,
    /// Serial number of its load cell
    #[arg(long, value_name = "SERIAL", requires = "unit", value_parser = serials::parse)]
    cell: Option<String>,
    /// Serial number of its converter
    #[arg(long, value_name = "SERIAL", requires = "unit", value_parser = serials::parse)]
    converter: Option<String>,
    /// A cell or converter was exchanged: take out the gain and zero that were measured with the
    /// old one
    #[arg(long)]
    replace: bool,
    #[command(flatten)]
    connection: Connection,
}

impl Command {
    /// Runs the command. It opens no link.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let mut bench = Bench::load(&self.connection, context)?;
        let new = Serials {
            unit: self.whole.clone(),
            motor: self.motor.clone(),
            cell: self.cell.clone(),
            converter: self.converter.clone(),
        };
        let Some(unit) = self.unit.filter(|_| !new.is_empty()) else {
            if self.unit.is_some() {
                return Err(Failure::usage(
                    "--unit needs a number to set: --whole, --motor, --cell or --converter",
                ));
            }
            return Ok(reply(&bench.record, ""));
        };
        let before = bench.record.clone();
        let mut notes = serials::set(&mut bench.record, &bench.rig, unit, &new, self.replace)?;
        let kept = bench.keep(context)?;
        notes.extend(serials::discard_readings(
            &bench.store,
            &before,
            &bench.record,
            unit,
        )?);
        let mut text = String::new();
        for note in notes {
            row!(text, "{note}");
        }
        row!(text, "version {}", kept.version);
        Ok(reply(&bench.record, &text))
    }
}

fn reply(record: &Record, below: &str) -> Reply {
    let shown = |serial: &str| if serial.is_empty() { "-" } else { serial }.to_owned();
    let mut text =
        "unit   whole             motor             cell              converter\n".to_owned();
    let mut rows = Vec::new();
    for unit in &record.units {
        let [whole, motor, cell, converter] = unit.serials().map(|(_, serial)| shown(serial));
        row!(
            text,
            "{:>4}   {whole:<17} {motor:<17} {cell:<17} {converter}",
            unit.number
        );
        let mut row = json!({"unit": unit.number});
        for (key, serial) in unit.serials() {
            row[key] = serial.into();
        }
        rows.push(row);
    }
    text.push_str(below);
    Reply::new(text, json!({ "units": rows }))
}
