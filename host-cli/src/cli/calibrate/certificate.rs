//! `calibrate certificate`: a stored calibration as a page to print, and as JSON.

use super::super::exit::{Failure, Reply, Result};
use super::super::Context;
use crate::cli::connection::Connection;
use calibrate::certificate;
use clap::Args;
use known::checks::Validity;
use known::store::Store;
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `calibrate certificate`.
#[derive(Debug, Args)]
pub struct Certificate {
    /// Number of a version, or `current`
    #[arg(default_value = "current")]
    version: String,
    /// Folder for certificate.html and certificate.json
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

impl Certificate {
    /// Runs the command. It opens no link.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        let store = Store::of_rig(&rig.name, self.connection.seed(&rig))?;
        let record = store.version(&self.version)?;
        if record.units.iter().all(|unit| unit.gain_date.is_empty()) {
            return Err(Failure::usage(
                "no gain of this calibration was measured: `forcectl calibrate gain`",
            ));
        }
        // A certificate names the version that it is of, also later.
        let same = |version: &String| store.version(version).is_ok_and(|r| r.hash == record.hash);
        let kept = store.versions()?.into_iter().rev().find(same);
        let version = kept.as_ref().unwrap_or(&self.version);
        let mut checks = store.checks()?;
        checks.retain(|check| check.is_of(&record));
        let today = known::today();
        let json = json!({"version": version, "printed": today, "validity": Validity::of(&record, &today),
            "checks": checks, "calibration": record});
        let page = certificate::html(&record, version, &checks, &today);
        std::fs::create_dir_all(&self.out).map_err(|error| Failure::file(&self.out, error))?;
        let mut paths = Vec::new();
        for (name, text) in [
            ("certificate.html", page),
            ("certificate.json", format!("{json:#}\n")),
        ] {
            let path = self.out.join(name);
            std::fs::write(&path, text).map_err(|error| Failure::file(&path, error))?;
            paths.push(path.display().to_string());
        }
        Ok(Reply::new(
            format!(
                "certificate         {}; print it to PDF with a browser\nthe same as JSON    {}\n",
                paths[0], paths[1]
            ),
            json!({"html": paths[0], "json": paths[1]}),
        ))
    }
}
