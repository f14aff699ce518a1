//! `forcectl check`: checks a rig file and whether its cables can hold zero force, or prints the
//! built-in file.

use super::exit::{self, Failure, Reply, Result};
use super::Context;
use clap::Args;
use force::feasibility;
use rig::{self, Rig, UnitSettings};
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Rig file (TOML)
    #[arg(required_unless_present = "print", conflicts_with = "print")]
    file: Option<PathBuf>,
    /// Print the built-in rig file, as a start for your own
    #[arg(long)]
    print: bool,
}

impl Check {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let Some(file) = &self.file else {
            context.output.refuse_json("`check --print`")?;
            return Ok(Reply::text(rig::DEFAULT_TEXT));
        };
        let rig = Rig::load(file)?;
        let enabled = rig.units.map(|unit| unit.enabled);
        let wrong =
            |why: String| Failure::new(exit::RIG_FILE, format!("{}: {why}", file.display()));
        let found =
            feasibility::examine(&rig, &enabled).map_err(|error| wrong(error.to_string()))?;
        if let Some(why) = found.refusal() {
            return Err(wrong(format!("{why}; set-force refuses this file")));
        }
        let count = enabled.iter().filter(|enabled| **enabled).count();
        let mut text = String::new();
        row!(
            text,
            "{}: no mistakes found. Rig `{}`, {count} units enabled, hash {}",
            file.display(),
            rig.name,
            rig.hash()
        );
        let [px, nx, py, ny, pz, nz] = found.least_force_n.map(|force_n| format!("{force_n:.2}"));
        row!(
            text,
            "zero force is within reach at all {} poses examined; so is, along +x -x +y -y +z -z, a force of {px} {nx} {py} \
             {ny} {pz} {nz} N",
            found.poses
        );
        let held_n = rig.units.map(|unit| unit.held_by_friction_n());
        let too_much = rig.units.iter().zip(held_n).filter(|(unit, held_n)| {
            unit.enabled && *held_n > unit.tension_min_n + UnitSettings::AT_LIMIT_N
        });
        for (unit, held_n) in too_much {
            row!(
                text,
                "unit {}: friction alone holds {held_n:.2} N, more than tension_min_n = {} N; where the robot pulls the cable out, \
                 the motor can't make it less, and the board gives the unit up (fault 46). Give {:.1} or more",
                unit.number,
                unit.tension_min_n,
                (10.0 * held_n).ceil() / 10.0
            );
        }
        let json = json!({
            "held_by_friction_n": held_n, "file": file, "name": rig.name, "hash": rig.hash(), "rig": rig, "feasibility": found
        });
        Ok(Reply::new(text, json))
    }
}
