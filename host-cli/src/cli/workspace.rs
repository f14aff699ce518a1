//! `forcectl workspace`: which forces a rig can apply where, and where its units should stand.

use super::connection::Connection;
use super::exit::{self, Failure, Reply, Result};
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
    /// Poses within this distance of the workspace's centre, m [default: half of `radius_m` of the rig file]
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
                return Err(Failure::new(
                    exit::USAGE,
                    format!("{name} has to be above 0 and below 5 m"),
                ));
            }
        }
        let options = Options {
            radius_m,
            across: usize::from(self.across),
        };
        let found = workspace::report(&rig, &options)?;
        let least = |of: &dyn Fn(&calibration::workspace::PoseReport) -> f64| {
            found.iter().map(of).fold(f64::INFINITY, f64::min)
        };
        let count = found.len() as f64;
        let mean = found.iter().map(|r| r.radius_n).sum::<f64>() / count;
        let mut text = String::new();
        row!(
            text,
            "{} poses within {:.0} mm of the centre; tensions as in the rig file",
            found.len(),
            1e3 * radius_m
        );
        row!(
            text,
            "feasible in every direction   {:.2} N at the worst pose, {mean:.2} N on average",
            least(&|r| r.radius_n)
        );
        let names = ["+x", "-x", "+y", "-y", "+z", "-z"];
        let along: Vec<f64> = (0..6)
            .map(|k| least(&|r| r.along_n[k].unwrap_or(f64::NEG_INFINITY)))
            .collect();
        for (name, value) in names.iter().zip(&along) {
            row!(
                text,
                "  along {name}                    {value:.2} N at the worst pose"
            );
        }
        let title = format!("{}: force that is feasible in every direction", rig.name);
        let svg = picture::maps(&title, "N", &workspace::planes(&rig, &options)).to_svg();
        let path = self.out.join("workspace.svg");
        std::fs::create_dir_all(&self.out)
            .and_then(|()| std::fs::write(&path, svg))
            .map_err(|error| Failure::file(&path, error))?;
        let mut json = json!({"poses": found.len(), "least_n": least(&|r| r.radius_n), "mean_n": mean, "along_n": along,
            "picture_svg": path.display().to_string()});
        if self.place {
            self.placed(&rig, &options, &mut text, &mut json)?;
        }
        row!(text, "picture             {}", path.display());
        Ok(Reply::new(text, json))
    }

    fn placed(
        &self,
        rig: &rig::RigFile,
        options: &Options,
        text: &mut String,
        json: &mut serde_json::Value,
    ) -> Result<()> {
        // The search looks at every pose for each candidate: the surface of the ball and its centre are enough.
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
