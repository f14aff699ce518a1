//! `forcectl workspace`: which forces a rig can apply where, and where its units should stand.

use super::connection::Connection;
use super::exit::{Failure, Reply, Result};
use super::Context;
use calibrate::picture;
use calibrate::workspace::{self, Options};
use clap::Args;
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Arguments of `workspace`.
#[derive(Debug, Args)]
pub struct Workspace {
    /// Poses within this distance of the workspace's centre, m
    /// [default: half of `radius_m` of the rig file]
    #[arg(long, value_name = "M")]
    radius: Option<f64>,
    /// Poses along a diameter
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u8).range(3..=41))]
    across: u8,
    /// Propose exit points with more feasible force
    #[arg(long)]
    place: bool,
    /// How far an exit point may be moved along each axis, m
    #[arg(long, value_name = "M", default_value_t = 0.1, requires = "place")]
    within: f64,
    /// Units that stay where they are
    #[arg(long, value_name = "N", num_args = 1.., requires = "place")]
    fixed: Vec<u8>,
    /// No exit point closer than this to a pose, m
    #[arg(long, value_name = "M", default_value_t = 0.15, requires = "place")]
    clearance: f64,
    /// Folder for the picture
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

impl Workspace {
    /// Runs the command. It opens no link.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        let rig = self.connection.calibrated(rig, context)?;
        let radius_m = self.radius.unwrap_or(0.5 * rig.workspace.radius_m);
        for (name, value) in [
            ("--radius", radius_m),
            ("--within", self.within),
            ("--clearance", self.clearance),
        ] {
            if !(value.is_finite() && value > 0.0 && value < 5.0) {
                return Err(Failure::usage(format!(
                    "{name} has to be above 0 and below 5 m"
                )));
            }
        }
        let options = Options {
            radius_m,
            across: usize::from(self.across),
        };
        let found = workspace::report(&rig, &options)?;
        let mut text = String::new();
        row!(
            text,
            "{} poses within {:.0} mm of the centre; tensions as in the rig file",
            found.poses,
            1e3 * radius_m
        );
        row!(
            text,
            "feasible in every direction   {:.2} N at the worst pose, {:.2} N on average",
            found.least_n,
            found.mean_n
        );
        let names = ["+x", "-x", "+y", "-y", "+z", "-z"];
        for (name, value) in names.iter().zip(found.along_n) {
            let value = value.map_or_else(
                || "not even zero".to_owned(),
                |value| format!("{value:.2} N"),
            );
            row!(
                text,
                "  along {name}                    {value} at the worst pose"
            );
        }
        if found.infeasible > 0 {
            row!(
                text,
                "at {} of the {} poses zero force is out of reach: with the tensions of the rig file the cables can't be in \
                 balance there; look at a smaller --radius",
                found.infeasible,
                found.poses
            );
        }
        let title = format!("{}: force that is feasible in every direction", rig.name);
        let svg = picture::maps(&title, "N", &workspace::planes(&rig, &options)).to_svg();
        let path = super::calibrate::picture(&self.out, "workspace.svg", &svg)?;
        let mut json = json!({"poses": found.poses, "least_n": found.least_n, "mean_n": found.mean_n, "infeasible": found.infeasible, "along_n": found.along_n,
            "picture_svg": path.display().to_string()});
        if self.place {
            self.placed(&rig, &options, &mut text, &mut json)?;
        }
        row!(text, "picture             {}", path.display());
        Ok(Reply::new(text, json))
    }

    fn placed(
        &self,
        rig: &rig::Rig,
        options: &Options,
        text: &mut String,
        json: &mut serde_json::Value,
    ) -> Result<()> {
        // The search looks at every pose for each candidate: the surface of the ball and its centre
        // are enough.
        let coarse = Options {
            across: options.across.min(5),
            ..*options
        };
        let found = workspace::placed(rig, &coarse, self.within, &self.fixed, self.clearance)?;
        row!(
            text,
            "\nexit points moved by up to {:.0} mm along each axis",
            1e3 * self.within
        );
        row!(
            text,
            "feasible in every direction   {:.2} N at the worst pose, {:+.1} % over the rig as it is ({:.2} N)",
            found.value,
            100.0 * found.relative_gain(),
            found.start_value
        );
        row!(text, "unit        x, mm     y, mm     z, mm     moved by");
        let enabled: Vec<_> = rig.units.iter().filter(|unit| unit.enabled).collect();
        for (unit, exit) in enabled.iter().zip(&found.exits_m) {
            let mm = exit * 1e3;
            row!(
                text,
                "{:>4} {:>12.1} {:>9.1} {:>9.1} {:>9.1} mm",
                unit.number,
                mm.x,
                mm.y,
                mm.z,
                1e3 * (exit - unit.exit_m).norm()
            );
        }
        row!(
            text,
            "a local optimum, the best of five starts: at least so much is possible\n"
        );
        json["placed"] = json!({"least_n": found.value, "gain": found.relative_gain(),
            "exit_m": found.exits_m.iter().map(|e| e.as_slice().to_vec()).collect::<Vec<_>>()});
        Ok(())
    }
}
