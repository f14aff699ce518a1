//! `forcectl identify`: finds what the rig file lacks on this rig, corrects it, and measures
//! whether that is better.

use super::calibrate::gain::Gain;
use super::connection::Connection;
use super::exit::{self, Failure, Reply, Result};
use super::residual::Stages;
use super::watch::Watch;
use super::{values, Context};
use clap::Args;
use identify::{DoubtedCell, Held, Left, Run, Trial, Weighed};
use rig::{Rig, RigText};
use run::{Options, RunError};
use serde_json::Value;
use session::link::RigLink;
use std::cell::Cell;
use std::path::PathBuf;

/// Below the help of the command.
pub const HELP: &str = "\
The command runs sessions on the rig:
  1. It holds a force with the rig file as it is.
  2. It drives the cables back and forth with the tension loops open, records this, and analyses the recording.
  3. It holds the same force with those findings that the board can use.
Sessions 1 and 3 are repeated as pairs, at least twice, until a 95 % interval of the gain excludes zero, or up to --pairs.
The robot has to move during all sessions; the embedded rig's robot does. The cables have to be slack at the start of
each session, because zeros are taken there.

A drive with a delay may oscillate in session 1 until fault 45 (tension implausible) or 44 (tension negative) ends it. With
--clear-implausible the command clears this fault, and a fault 15 of the same unit behind it that no tension shows, and goes
on; in session 2 the loops are open. The findings are then better where the force is held with them to the end.

Creep and a curve of load cells are errors of what is measured; weights tell them apart from the drive. With --weigh the command
then measures these cells (all, where two or more show it) as `forcectl calibrate gain` does, keeps the calibration, and does
session 2 once more. Options for
weights, place and mounting are those of `calibrate gain`: call that before, where its defaults do not fit.

The rig file is written to DIR as rig.before.toml, the corrected one as rig.after.toml. --apply also replaces the file
that --rig names and keeps the old one as FILE.before-N. It does so only where the findings were clear and the force was held
better with them: the tension error of the worst cable, or of one cable, smaller for sure (the interval excludes zero) and by at
least 2 %, no cable worse by 2 % for sure, the force error at the tip at most 5 % larger.

Exit codes:
  0  something was found and corrected, and the result was better (and was applied if requested)
  2  the arguments are wrong; nothing was driven
  3  the rig file is wrong; nothing was driven
  4  the link cannot be opened, was lost, or the other end is not a board of this version
  5  the board refused a command, or a fault stopped the rig
  6  nothing was changed: nothing clear was found, the board cannot use it, or the result was not better
  7  a file or the standard output could not be written
  8  the recording does not allow an analysis
130  Ctrl-C, SIGTERM or SIGHUP ended the command; the rig is disarmed";

/// Arguments of `identify`.
#[derive(Debug, Args)]
pub struct Identify {
    /// Folder for recordings, reports, plots and rig files; created where it does not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Force that is held in sessions 1 and 3, N along x, y and z
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], default_values = ["0", "2.5", "0"], allow_hyphen_values = true, value_parser = values::newton)]
    force: Vec<f64>,
    /// Time for which the force is held in sessions 1 and 3
    #[arg(long, value_name = "SECONDS", default_value = "16", value_parser = values::seconds)]
    duration: f64,
    /// Time for which the cables are driven in session 2, 8 to 600
    #[arg(long, value_name = "SECONDS", default_value = "40", value_parser = values::seconds)]
    drive_duration: f64,
    /// Most pairs of sessions 1 and 3, 2 to 10
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u8).range(identify::FEWEST_PAIRS as i64..=identify::MOST_PAIRS as i64))]
    pairs: u8,
    /// Replace the file that --rig names by the corrected one, where the result was better
    #[arg(long)]
    apply: bool,
    /// Clear a fault 45 or 44 (tension implausible, negative) that ends a session without the
    /// findings, and go on
    #[arg(long)]
    clear_implausible: bool,
    /// Where creep or a curve of load cells is found: measure these cells with weights, as
    /// `calibrate gain` does, and do session 2 again
    #[arg(long)]
    weigh: bool,
    /// With --weigh on an emulated rig: ask nothing, a stand-in hangs the weights
    #[arg(long, requires = "weigh")]
    yes: bool,
    #[command(flatten)]
    connection: Connection,
    /// Sessions so far.
    #[arg(skip)]
    sessions: Cell<u64>,
}

impl Identify {
    /// Runs the command. Arguments are checked before anything is opened or driven.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        self.connection.require_rig_file(&rig)?;
        self.connection.require_unchanged(context)?;
        self.connection.stay(context)?;
        let rig = self.connection.calibrated(rig, context)?;
        let force_n: [f64; 3] = self.force.as_slice().try_into().map_err(|_| {
            Failure::usage("--force takes three numbers, for example --force 0 2.5 0")
        })?;
        rig.check_force(force_n.into()).map_err(Failure::usage)?;
        identify::check(&rig, self.drive_duration)?;
        let path = self.connection.rig_path();
        if self.apply && path.is_none() {
            return Err(Failure::usage(
                "--apply needs a rig file to change: give it with --rig FILE (`forcectl check --print > FILE` makes one)",
            ));
        }
        let RigText { name, text } = RigText::read(path.map(PathBuf::as_path))?;
        std::fs::create_dir_all(&self.out).map_err(|error| Failure::file(&self.out, error))?;
        identify::write(&self.out.join("rig.before.toml"), &text)?;
        let first = self.hold(
            context,
            force_n,
            Run {
                pair: 1,
                with_findings: false,
                rig: &rig,
            },
        )?;
        let find = |rig: &Rig| -> Result<_> {
            let recording = self.drive(context, rig)?;
            let mut stages = Stages::new(!context.output.shows_progress());
            let findings = identify::find(&recording, rig, &name, &text, &self.out, &mut stages)?;
            Ok((findings, recording.swing))
        };
        let (mut findings, mut swing) = find(&rig)?;
        let cells = identify::doubted_cells(&findings.units);
        let mut weighed = None;
        if self.weigh && !cells.is_empty() {
            let gains = self.weigh(&cells, context)?;
            let straight = self
                .connection
                .calibrated(self.connection.load(context)?, context)?;
            (findings, swing) = find(&straight)?;
            weighed = Some(Weighed { cells, gains });
        }
        identify::write(&self.out.join("rig.after.toml"), &findings.rewritten.text)?;
        let mut trial = Trial::new(first, findings, swing);
        trial.weighed = weighed;
        // From here on Ctrl-C must not leave half a rig file.
        let _controlled_stop = context.interrupt.controlled_stop();
        let compared = trial.compare(&rig, self.pairs.into(), &mut |run| {
            self.hold(context, force_n, run)
        });
        if let Err(ended) = compared {
            // What was found until then is not lost with it.
            trial.left = Some(Left::BrokenOff(ended.message.clone()));
            return Err(match self.report(context, &trial, &name) {
                Ok(reply) => ended.with_reply(reply),
                Err(unwritten) => {
                    let both = format!("{}\n{}", unwritten.message, ended.message);
                    Failure::new(ended.code, both)
                }
            });
        }
        let new = &trial.findings.rewritten.text;
        if let (None, true, Some(path)) = (&trial.left, self.apply && *new != text, path) {
            trial.applied = Some(identify::replace(path, &text, new)?);
        }
        self.report(context, &trial, &name)
    }

    /// Opens the connection for the next session.
    fn open(&self, rig: &Rig, context: &Context) -> Result<Box<dyn RigLink>> {
        let run = self.sessions.get();
        self.sessions.set(run + 1);
        self.connection.open_again(rig, run, context)
    }

    /// Measures load cells with weights, and keeps the calibration; what `calibrate gain` reports.
    fn weigh(&self, cells: &[DoubtedCell], context: &Context) -> Result<Value> {
        let units: Vec<u8> = cells.iter().map(|cell| cell.unit).collect();
        let words: Vec<String> = units.iter().map(ToString::to_string).collect();
        context.output.note(&format!(
            "load cells show creep or a curve: measuring the cells of unit {} with weights, as `forcectl calibrate gain` does",
            words.join(", ")
        ));
        let gain = Gain::of_units(&units, self.yes, &self.out)?;
        let open = |rig: &Rig| self.open(rig, context);
        let reply = gain.on(&self.connection, open, context)?;
        if !context.output.json() {
            context.output.results(&reply.text);
        }
        Ok(reply.json.unwrap_or_default())
    }

    /// Holds the force in a session of its own. A fault 45 that ended it is an error, unless it may
    /// be cleared.
    fn hold(&self, context: &Context, force_n: [f64; 3], run: Run<'_>) -> Result<Held> {
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.open(run.rig, context)?;
        let options = Options {
            stop: context.interrupt.flag(),
            zeroing: self.connection.zeroing(),
            ..Options::new(force_n, self.duration)
        };
        let mut watch = Watch::new(&context.output);
        let what = match (run.pair, run.with_findings) {
            (1, false) => "session 1: holding a force with the rig file as it is".to_owned(),
            (1, true) => "session 3: holding the same force with what was found".to_owned(),
            (n, false) => format!("pair {n}: holding the force without what was found"),
            (n, true) => format!("pair {n}: holding the force with what was found"),
        };
        watch.progress.beside(|output| output.note(&what));
        let clear = self.clear_implausible;
        let held = identify::hold(link.as_mut(), run.rig, &options, clear, &mut watch);
        watch.progress.done();
        Ok(held?)
    }

    /// Drives the cables with the loops open, and records it. A drive whose gain is far off is
    /// implausible where it pulls most: where that may be cleared, it is driven again with the
    /// smallest commands.
    fn drive(&self, context: &Context, rig: &Rig) -> Result<identify::Recording> {
        let note = |text: &str| context.output.note(text);
        note("session 2: driving the cables for the analysis");
        match self.drive_once(context, rig, 1.0)? {
            Ok(recording) => Ok(recording),
            Err(why) => {
                note(&format!(
                    "{why}\nit is cleared; session 2 again, with the smallest commands"
                ));
                let again = self.drive_once(context, rig, identify::SMALL_SWING)?;
                Ok(again?)
            }
        }
    }

    /// A session with this part of the largest swing; within, a fault 45 that ended it and was
    /// cleared.
    fn drive_once(
        &self,
        context: &Context,
        rig: &Rig,
        swing: f64,
    ) -> Result<std::result::Result<identify::Recording, RunError>> {
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.open(rig, context)?;
        let mut watch = Watch::new(&context.output);
        let stop = context.interrupt.flag();
        let recording = identify::excite(
            link.as_mut(),
            rig,
            self.drive_duration,
            swing,
            &self.connection.zeroing(),
            &stop,
            &mut watch,
        );
        watch.progress.done();
        if context.interrupt.requested() {
            return Err(Failure::from(RunError::Interrupted));
        }
        match recording {
            Err(error) if self.clear_implausible && identify::is_implausible(&error) => {
                identify::clear_faults(link.as_mut(), &stop, &mut watch)?;
                Ok(Err(error))
            }
            recording => Ok(Ok(recording?)),
        }
    }

    /// Prints the report, then writes it with plot and figures. A file that cannot be written costs
    /// only itself.
    fn report(&self, context: &Context, trial: &Trial, name: &str) -> Result<Reply> {
        if !context.output.json() {
            let report = trial.markdown(name);
            context.output.results(&format!("{report}\n"));
        }
        let failures = trial.write(&self.out, name);
        let code = if trial.left.is_none() {
            exit::DONE
        } else {
            exit::DEGRADED
        };
        let text = format!("results: {}\n", self.out.display());
        let reply = Reply::new(text, trial.record(name)).with_code(code);
        if failures.is_empty() {
            return Ok(reply);
        }
        let messages: Vec<String> = failures.iter().map(ToString::to_string).collect();
        Err(Failure::new(exit::FILE, messages.join("\n")).with_reply(reply))
    }
}
