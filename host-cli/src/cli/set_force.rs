//! `forcectl set-force`: holds a force at the tip, and reports how well.

use super::connection::{Connection, EMBEDDED};
use super::exit::{self, Failure, Reply, Result};
use super::watch::Watch;
use super::{values, Context};
use clap::Args;
use emulator_link::Injection;
use force::metrics::{Metrics, SETTLED_WITHIN_N};
#[cfg(feature = "record")]
use recording::{Finished, Metadata};
use run::plot;
use run::{Ended, Options, Outcome, RunError, ShortfallKind};

use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use wire::UNITS;

/// Below the help of the command.
pub const HELP: &str = "\
The force is in newtons in the robot's base frame, for example `forcectl set-force 0 2.5 0`.

On a real rig the section [pose] of the rig file says where the robot's pose comes from. source = \"udp\" listens for
JSON lines such as {\"measured_cp\": {\"position\": [-0.08, 0.025, -0.14]}} (metres, robot base frame, 100 Hz or faster).
source = \"static\" assumes a clamped tip.

Exit codes: see `forcectl --help`.";

/// Arguments of `set-force`.
#[derive(Debug, Args)]
pub struct SetForce {
    /// Force along x, N
    #[arg(allow_hyphen_values = true, value_parser = values::newton)]
    x: f64,
    /// Force along y, N
    #[arg(allow_hyphen_values = true, value_parser = values::newton)]
    y: f64,
    /// Force along z, N
    #[arg(allow_hyphen_values = true, value_parser = values::newton)]
    z: f64,
    /// Time for which the force is held
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = values::seconds)]
    duration: f64,
    /// Standard deviation of a coordinate of the robot's tip, mm
    /// [default: position_sd_mm of `[pose]` in the rig file, else what is usual for its source]
    #[arg(long, value_name = "MM", value_parser = values::pose_sd_mm)]
    pose_sd: Option<f64>,
    /// Folder for the plot (SVG) and the figures (JSON); created where it does not exist
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    /// Record every sample to this folder (MCAP and Parquet)
    #[cfg(feature = "record")]
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    #[command(flatten)]
    connection: Connection,
    /// Keep the embedded rig's robot still
    #[arg(long, help_heading = EMBEDDED)]
    still: bool,
    /// Cause a fault in the embedded rig, for example unplug=3@2s; repeatable. `--inject help`
    /// lists the faults
    #[arg(long, value_name = "WHAT@TIME", help_heading = EMBEDDED, value_parser = session::inject::parse, allow_hyphen_values = true)]
    inject: Vec<(f64, Injection)>,
}

impl SetForce {
    /// Runs the command. Arguments are checked before anything is opened or driven.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let output = &context.output;
        let rig = self.connection.load_for(
            context,
            &[
                ("--still", self.still),
                ("--inject", !self.inject.is_empty()),
            ],
        )?;
        self.connection.require_rig_file(&rig)?;
        let mut rig = self.connection.calibrated(rig, context)?;
        rig.pose_sd_m = self.pose_sd.map_or(rig.pose_sd_m, |mm| 1e-3 * mm);
        let options = Options {
            robot_moves: !self.still,
            injections: self.inject.clone(),
            stop: context.interrupt.flag(),
            ..Options::new([self.x, self.y, self.z], self.duration)
        };
        rig.check_force(options.commanded_n)
            .map_err(Failure::usage)?;
        std::fs::create_dir_all(&self.out).map_err(|error| Failure::file(&self.out, error))?;
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        let mut watch = Watch::new(output);
        #[cfg(feature = "record")]
        if let Some(folder) = &self.record {
            let emulated = link.controls().is_some();
            let metadata = Metadata::new(&rig, emulated)
                .with("link", link.name())
                .with("command", "set-force");
            let own = link.booted_here() && !self.connection.paced();
            let metadata = if own {
                metadata
            } else {
                metadata.never_waits()
            };
            watch.record_to(folder, &metadata)?;
        }
        // Figures of a run before this one must not pass for those of a run that failed.
        for path in [self.svg(), self.figures()] {
            remove(&path)?;
        }
        let options = Options {
            zeroing: self.connection.zeroing(),
            ..options
        };
        let ended = run::hold_force(link.as_mut(), &rig, &options, &mut watch);
        watch.progress.done();
        let (outcome, error) = match ended {
            Ok(outcome) => (Some(outcome), None),
            Err(stopped) => (stopped.outcome.map(|outcome| *outcome), Some(stopped.error)),
        };
        // The results come first: what follows can fail.
        if let (Some(outcome), false) = (&outcome, output.json()) {
            output.results(&table(outcome));
        }
        let mut files = Files::default();
        // What was recorded up to an error is kept.
        #[cfg(feature = "record")]
        let recorded = watch.finish_recording();
        #[cfg(feature = "record")]
        if let (Some(folder), Some(finished)) = (&self.record, &recorded) {
            files.recording(folder, finished);
        }
        #[cfg_attr(not(feature = "record"), allow(unused_mut))]
        let mut json = outcome
            .as_ref()
            .map(|outcome| self.write(outcome, &mut files));
        #[cfg(feature = "record")]
        if let (Some(json), Some(finished)) = (&mut json, &recorded) {
            json["recording"] = serde_json::to_value(finished).unwrap_or_default();
        }
        conclude(outcome.as_ref(), error, json, files)
    }

    /// File of the plot.
    fn svg(&self) -> PathBuf {
        self.out.join("set-force.svg")
    }

    /// File of the figures.
    fn figures(&self) -> PathBuf {
        self.out.join("set-force.json")
    }

    /// Writes plot and figures, and returns the figures.
    fn write(&self, outcome: &Outcome, files: &mut Files) -> Value {
        let (svg, figures) = (self.svg(), self.figures());
        let mut json = serde_json::to_value(outcome).unwrap_or_default();
        let write = |path: &Path, text: String| {
            std::fs::write(path, text).map_err(|error| Failure::file(path, error))
        };
        let plotted = write(&svg, plot::draw(outcome).to_svg());
        if plotted.is_ok() {
            json["plot_svg"] = svg.display().to_string().into();
        }
        files.note("plot", &svg, plotted);
        files.note("figures", &figures, write(&figures, format!("{json:#}")));
        json
    }
}

/// Files of a run: what was written, and what could not be.
#[derive(Default)]
struct Files {
    written: String,
    failures: Vec<Failure>,
}

impl Files {
    /// A file that was written, or why it was not.
    fn note(&mut self, what: &str, path: &Path, result: Result<()>) {
        match result {
            Ok(()) => row!(self.written, "{what:<19} {}", path.display()),
            Err(failure) => self.failures.push(failure),
        }
    }
}

#[cfg(feature = "record")]
impl Files {
    /// A recording: what it holds, what it lacks, and its files that are not complete.
    fn recording(&mut self, folder: &Path, finished: &Finished) {
        row!(
            self.written,
            "recording           {}: {} samples, {} cycles",
            folder.display(),
            finished.samples,
            finished.cycles
        );
        if finished.dropped_samples + finished.dropped_cycles > 0 {
            row!(
                self.written,
                "recording lacks     {} samples, {} cycles: the disk was too slow or full",
                finished.dropped_samples,
                finished.dropped_cycles
            );
        }
        self.failures
            .extend(finished.failures.iter().cloned().map(Failure::from));
    }
}

/// Removes a file of an earlier run, if there is one.
fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Failure::new(
            exit::FILE,
            format!(
                "{}: the file of an earlier run cannot be removed: {error}; nothing was driven",
                path.display()
            ),
        )),
        _ => Ok(()),
    }
}

/// The reply of a run; after a failure, the failure with what results there are. The exit code is
/// that of the first that applies: the run was stopped, a file could not be written, the force was
/// not held.
fn conclude(
    outcome: Option<&Outcome>,
    error: Option<RunError>,
    json: Option<Value>,
    files: Files,
) -> Result<Reply> {
    let reply = json.map(|json| Reply::new(files.written, json));
    let mut failures: Vec<Failure> = error.map(Failure::from).into_iter().collect();
    failures.extend(files.failures);
    let message = failures
        .iter()
        .map(|failure| failure.message.as_str())
        .collect::<Vec<_>>()
        .join("\n");
    if let Some(first) = failures.first() {
        let failure = Failure::new(first.code, message);
        return Err(match reply {
            Some(reply) => failure.with_reply(reply),
            None => failure,
        });
    }
    let code = match outcome.map(|outcome| outcome.ended) {
        Some(Ended::Done) => exit::DONE,
        Some(Ended::Interrupted) => exit::INTERRUPTED,
        _ => exit::DEGRADED,
    };
    Ok(reply.unwrap_or_else(|| Reply::text("")).with_code(code))
}

fn vector(v: [f64; 3]) -> String {
    format!("{:>9.3} {:>9.3} {:>9.3}", v[0], v[1], v[2])
}

/// The table for people.
fn table(outcome: &Outcome) -> String {
    let mut out = String::new();
    row!(
        out,
        "rig                 {}, firmware {}",
        outcome.link,
        outcome.firmware
    );
    row!(
        out,
        "configuration       CRC {:08x}, rig file {}",
        outcome.config_crc,
        &outcome.rig_hash[..12]
    );
    match &outcome.metrics {
        Some(metrics) => {
            metrics_table(&mut out, metrics);
            uncertainty_lines(&mut out, outcome);
        }
        None => {
            row!(
                out,
                "\nThe force was held for less than {} s: too short for figures.",
                force::metrics::STEADY_AFTER_S
            );
        }
    }
    if let Some(latency) = outcome.latency_ms {
        let how = if latency.measured_outside {
            "edge to DAC output, by the rig"
        } else {
            "edge to DAC word, by the firmware"
        };
        row!(
            out,
            "loop latency        {:.3} ms median, {:.3} ms 99th percentile ({how})",
            latency.p50,
            latency.p99
        );
    }
    let link = outcome.link_counters;
    row!(
        out,
        "samples             {} received, {} lost before the controller; telemetry frames lost {}, damaged {}",
        outcome.samples,
        outcome.samples_lost,
        link.frames_lost,
        link.frames_bad
    );
    for fault in &outcome.faults {
        let who = fault
            .unit
            .map_or_else(|| "board".to_owned(), |unit| format!("unit {unit}"));
        // Meaning and way out were told when it came, and are in the figures.
        let name = fault.text.split(". ").next().unwrap_or_default();
        row!(
            out,
            "fault at {:>6.2} s   {who}: {name}; `forcectl explain {}`",
            fault.t_s,
            fault.code
        );
    }
    // Why the run was stopped is the error, which is printed beside the table.
    for shortfall in &outcome.shortfalls {
        if shortfall.kind != ShortfallKind::Stopped {
            row!(out, "not as commanded    {}", shortfall.text);
        }
    }
    out
}

/// How well the applied force is known.
fn uncertainty_lines(out: &mut String, outcome: &Outcome) {
    let Some(u) = &outcome.uncertainty else {
        row!(
            out,
            "uncertainty         not known: no calibration of this rig is stored (`forcectl calibrate`)"
        );
        return;
    };
    let direction = u
        .direction_sd_deg
        .map_or_else(String::new, |d| format!(", direction +- {d:.2} deg"));
    row!(
        out,
        "uncertainty         size +- {:.3} N{direction} (one sd), pose +- {:.1} mm; calibration of {}",
        u.size_sd_n,
        1e3 * u.pose_sd_m,
        u.date
    );
    for (what, radius_n, of) in [
        (
            "mean of the run",
            u.radius_95_n,
            "the mean by the load cells",
        ),
        ("any instant", u.instant_95_n, "the commanded force"),
        ("cells in a cycle", u.estimate_95_n, "their estimate in it"),
    ] {
        row!(out, "  {what:<17} within {radius_n:.3} N of {of} with 95 %");
    }
    if !u.nominal.is_empty() {
        row!(
            out,
            "                    not measured, nominal: {}",
            u.nominal.join(", ")
        );
    }
}

fn metrics_table(out: &mut String, m: &Metrics) {
    let source = if m.from_truth {
        "in the plant"
    } else {
        "by load cells"
    };
    row!(out, "");
    row!(out, "force at the tip, N         x         y         z");
    row!(out, "  commanded         {}", vector(m.commanded_n.into()));
    row!(
        out,
        "  applied           {}   mean, {source}",
        vector(m.applied_n.into())
    );
    row!(
        out,
        "  error             {}   length {:.3}, RMS {:.3}",
        vector(m.error_n.into()),
        m.tip_force_error_n,
        m.tip_force_rms_n
    );
    let along = m.settling_along_s.map_or_else(String::new, |s| {
        format!("; along the commanded direction alone after {s:.2} s")
    });
    let settled = m.settling_s.map_or_else(
        || "never".to_owned(),
        |s| {
            format!(
                "after {s:.2} s, within the band for {:.1} % of the time from then on",
                100.0 * m.within_band
            )
        },
    );
    row!(
        out,
        "  settled           {settled} (within {SETTLED_WITHIN_N} N){along}"
    );
    row!(out, "");
    row!(
        out,
        "tension, N             1       2       3       4       5       6"
    );
    let units = |values: [f64; UNITS]| values.map(|v| format!("{v:>7.3}")).join(" ");
    row!(out, "  setpoint       {}", units(m.tension_setpoint_n));
    row!(
        out,
        "  {:<14} {}",
        if m.from_truth { "true" } else { "measured" },
        units(m.tension_n)
    );
    row!(out, "  RMS error      {}", units(m.tension_rms_n));
    row!(out, "");
}
