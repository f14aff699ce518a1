//! `calibrate show`, `diff`, `use` and `push`: the calibrations that are kept.

use super::super::connection::Connection;
use super::super::exit::{self, Failure, Reply, Result};
use super::super::Context;
use super::Bench;
use calibrate::cells;
use calibration::record::Record;
use clap::Args;
use known::store::Store;
use nalgebra::Matrix3;
use serde_json::json;
use session::Session;
use std::fmt::Write as _;

/// Arguments of `calibrate show`.
#[derive(Debug, Args)]
pub struct Show {
    /// Number of a version, `current`, or a file
    #[arg(default_value = "current")]
    version: String,
    /// List the versions that are kept
    #[arg(long)]
    versions: bool,
    #[command(flatten)]
    connection: Connection,
}

fn store(connection: &Connection, context: &Context) -> Result<Store> {
    let rig = connection.load(context)?;
    Ok(Store::of_rig(&rig.name, connection.seed(&rig))?)
}

impl Show {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let store = store(&self.connection, context)?;
        if self.versions {
            let mut text = String::new();
            let mut rows = Vec::new();
            for version in store.versions()? {
                let record = store.version(&version)?;
                row!(text, "{version}   {}   {}", record.date, record.hash);
                rows.push(json!({"version": version, "date": record.date, "hash": record.hash}));
            }
            if rows.is_empty() {
                text = "no calibration of this rig is kept\n".to_owned();
            }
            return Ok(Reply::new(text, json!({ "versions": rows })));
        }
        let record = store.version(&self.version)?;
        let json = serde_json::to_value(&record).map_err(|e| Failure::new(exit::FILE, e))?;
        Ok(Reply::new(table(&record), json))
    }
}

fn or_nominal(date: &str) -> &str {
    if date.is_empty() {
        "nominal"
    } else {
        date
    }
}

fn table(record: &Record) -> String {
    let mut out = String::new();
    row!(out, "rig {}, {}, {}", record.rig, record.date, record.hash);
    row!(
        out,
        "gravity {} m/s^2; gain error that all units share {:.3} %",
        record.gravity_m_per_s2,
        100.0 * record.common_gain_relative_sd
    );
    row!(out, "unit   N per code     +- %   gain of      zero, codes   zero of      exit point, mm                  +-   axis +- deg   geometry of");
    for u in &record.units {
        let covariance = u.covariance_matrix();
        let exit_mm = 1e3 * covariance.fixed_view::<3, 3>(0, 0).trace().max(0.0).sqrt();
        let axis: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let axis_deg = axis
            .symmetric_eigenvalues()
            .max()
            .max(0.0)
            .sqrt()
            .to_degrees();
        let [x, y, z] = u.exit_m.map(|v| 1e3 * v);
        row!(
            out,
            "{:>4} {:>12.5e} {:>8.3}   {:<10} {:>13.0}   {:<10} {x:>8.1} {y:>8.1} {z:>8.1} {exit_mm:>9.2} {axis_deg:>13.2}   {}",
            u.number,
            u.n_per_code,
            100.0 * u.n_per_code_sd / u.n_per_code.abs(),
            or_nominal(&u.gain_date),
            u.zero_codes,
            or_nominal(&u.zero_date),
            or_nominal(&u.geometry_date)
        );
    }
    out
}

/// Arguments of `calibrate diff`.
#[derive(Debug, Args)]
pub struct Diff {
    /// The older one: number of a version, or a file
    old: String,
    /// The newer one
    #[arg(default_value = "current")]
    new: String,
    #[command(flatten)]
    connection: Connection,
}

impl Diff {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let store = store(&self.connection, context)?;
        let (old, new) = (store.version(&self.old)?, store.version(&self.new)?);
        let differences = new.diff(&old);
        let mut text = String::new();
        let mut rows = Vec::new();
        for d in &differences {
            let sigmas = d.sigmas.map_or_else(String::new, |s| {
                format!(
                    "   {s:.1} sd{}",
                    if s > 4.0 {
                        " (more than the errors of both)"
                    } else {
                        ""
                    }
                )
            });
            // Covariances and lists of residuals are long; that they changed is enough.
            if d.key.ends_with("covariance") || d.key.ends_with("gain_figures") {
                row!(text, "{}: changed", d.key);
            } else {
                row!(text, "{}: {} -> {}{sigmas}", d.key, d.old, d.new);
            }
            rows.push(json!({"key": d.key, "old": d.old, "new": d.new, "sigmas": d.sigmas}));
        }
        if rows.is_empty() {
            text = "the two calibrations are equal\n".to_owned();
        }
        Ok(Reply::new(text, json!({ "differences": rows })))
    }
}

/// Arguments of `calibrate use`.
#[derive(Debug, Args)]
pub struct Use {
    /// Number of the version to put in force; it is kept as a new version
    #[arg(value_parser = clap::value_parser!(u32).range(1..))]
    version: u32,
    #[command(flatten)]
    connection: Connection,
}

impl Use {
    /// Runs the command. It opens no link, and does not read the calibration in force, which may be
    /// damaged.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        self.connection.require_rig_file(&rig)?;
        let store = Store::of_rig(&rig.name, self.connection.seed(&rig))?;
        let (kept, record) = store.reinstate(&self.version.to_string(), &rig.name)?;
        Ok(Reply::new(
            format!(
                "version {:04} (calibration of {}) is in force as version {}; `forcectl calibrate push` sends it to the board\n",
                self.version, record.date, kept.version
            ),
            json!({"version": kept.version, "from": format!("{:04}", self.version), "date": record.date, "hash": record.hash}),
        ))
    }
}

/// Arguments of `calibrate push`.
#[derive(Debug, Args)]
pub struct Push {
    #[command(flatten)]
    connection: Connection,
}

impl Push {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let bench = Bench::tested(&self.connection, context)?;
        let Some(record) = bench.store.current()? else {
            return Err(Failure::usage(
                "this rig has no calibration yet; `forcectl calibrate gain` begins one",
            ));
        };
        let rig = bench.calibrated();
        let mut link = self.connection.open(&rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        cells::prepare(&mut session, &rig)?;
        let units = cells::push(&mut session, &rig, &[])?;
        Ok(Reply::new(
            format!(
                "calibration of {} is in force on the board: {units} units read back and compared\n",
                record.date
            ),
            json!({"units": units, "hash": record.hash}),
        ))
    }
}
