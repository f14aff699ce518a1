//! `forcectl identify`: finds what the rig file lacks on this rig, corrects it, and measures whether that is better.

use super::connection::Connection;
use super::exit::{self, Failure, Reply, Result};
use super::residual::Stages;
use super::watch::Watch;
use super::{values, Context};
use clap::Args;
use control::Fault;
use identify::{self, Figures, Findings, Gain, Pair};
use rig::{self, RigFile};
use run::plot;
use run::{Ended, Options, Outcome, RunError, RunFault, Stopped};
use serde_json::json;
use session::link::RigLink;
use session::Session;
use std::cell::Cell;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use wire::{Command, UNITS};

/// Below the help of the command.
pub const HELP: &str = "\
The command runs sessions on the rig:
  1. It holds a force with the rig file as it is.
  2. It drives the cables back and forth with the tension loops open, records this, and analyses the recording.
  3. It holds the same force with those findings that the board can use.
Sessions 1 and 3 are repeated as pairs, at least twice, until the 95 % interval of the gain excludes zero, or up to --pairs.
The robot has to move during all sessions; the embedded rig's robot does. The cables have to be slack at the start of
each session, because zeros are taken there.

A drive with a delay may oscillate in session 1 until fault 45 (tension implausible) ends it. With --clear-implausible the
command clears this fault, and no other, and goes on; in session 2 the loops are open. The findings are then better where the
force is held with them to the end.

The rig file is written to DIR as rig.before.toml, the corrected one as rig.after.toml. --apply also replaces the file
that --rig names and keeps the old one as FILE.before-N. It does so only where the findings were clear and the force was held
better with them: the tension error of the worst cable smaller for sure (the interval excludes zero) and by at least 2 %, the
force error at the tip at most 5 % larger.

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
    /// Clear a fault 45 (tension implausible) that ends a session without the findings, and go on
    #[arg(long)]
    clear_implausible: bool,
    #[command(flatten)]
    connection: Connection,
    /// Sessions so far.
    #[arg(skip)]
    sessions: Cell<u64>,
}

/// Why pairs of runs on a rig without any scatter decide nothing.
const REPEATS: &str =
    "this rig repeats a pair of runs to the last digit, so further pairs do not confirm the gain";

/// A session in which a force was held.
enum Held {
    /// To the end.
    Whole(Outcome, Figures),
    /// Until units dropped out with a fault 45; which, in words.
    Implausible(Outcome, String),
}

/// Results of the command.
struct Results {
    findings: Findings,
    /// Part of the excitation's amplitude that was left at the end.
    swing: f64,
    before: Outcome,
    /// The fault that ended a session without the findings.
    stopped: Option<String>,
    after: Option<Outcome>,
    /// Means over the runs without and with the findings; `None` without such a run to the end.
    figures: (Option<Figures>, Option<Figures>),
    /// How much better it is with the findings.
    gain: Option<Gain>,
    /// Where the rig file was put, and where the old one is kept.
    applied: Option<(PathBuf, PathBuf)>,
    /// Why nothing was changed.
    left: Option<String>,
}

impl Identify {
    /// Runs the command. Arguments are checked before anything is opened or driven.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let rig = self.connection.load(context)?;
        self.connection.require_rig_file(&rig)?;
        let rig = self.connection.calibrated(rig, context)?;
        let force_n: [f64; 3] = self.force.as_slice().try_into().map_err(|_| {
            Failure::new(
                exit::USAGE,
                "--force takes three numbers, for example --force 0 2.5 0",
            )
        })?;
        rig.check_force(force_n.into())
            .map_err(|why| Failure::new(exit::USAGE, why))?;
        identify::check(&rig, self.drive_duration)?;
        let (name, text) = self.rig_text()?;
        std::fs::create_dir_all(&self.out).map_err(|error| Failure::file(&self.out, error))?;
        self.write("rig.before.toml", &text)?;

        let what = "session 1: holding a force with the rig file as it is";
        let (before, figures_before, stopped) = match self.hold(context, &rig, force_n, what)? {
            Held::Whole(outcome, figures) => (outcome, Some(figures), None),
            Held::Implausible(outcome, why) => (outcome, None, Some(why)),
        };
        let recording = self.drive(context, &rig)?;
        let mut stages = Stages::new(!context.output.shows_progress());
        let findings = identify::find(&recording, &rig, &name, &text, &self.out, &mut stages)?;
        self.write("rig.after.toml", &findings.rewritten.text)?;

        let mut results = Results {
            findings,
            swing: recording.swing,
            before,
            stopped,
            after: None,
            figures: (figures_before, None),
            gain: None,
            applied: None,
            left: None,
        };
        // From here on Ctrl-C must not leave half a rig file.
        let _controlled_stop = context.interrupt.controlled_stop();
        if results.findings.rewritten.changed.is_empty() {
            results.left =
                Some("nothing was found that is clear and that the board can use".to_owned());
        } else {
            let better = self.compare(context, &rig, force_n, &mut results)?;
            if let Some(why) = better {
                results.left = Some(why);
            } else if let (true, Some(path)) = (self.apply, self.connection.rig_path()) {
                results.applied = Some(replace(path, &text, &results.findings.rewritten.text)?);
            }
        }
        self.report(context, &results, &name)
    }

    /// Holds the force with the findings, and repeats the pair of runs until the gain is decided. `None` if it is better
    /// with them, else why not.
    fn compare(
        &self,
        context: &Context,
        rig: &RigFile,
        force_n: [f64; 3],
        results: &mut Results,
    ) -> Result<Option<String>> {
        let mut before = results.figures.0;
        let mut pairs: Vec<Pair> = Vec::new();
        let mut afters: Vec<Figures> = Vec::new();
        loop {
            let n = afters.len() + 1;
            if n > 1 && results.stopped.is_none() {
                let what = format!("pair {n}: holding the force without what was found");
                match self.hold(context, rig, force_n, &what)? {
                    Held::Whole(_, figures) => before = Some(figures),
                    Held::Implausible(_, why) => results.stopped = Some(why),
                }
            }
            let what = match n {
                1 => "session 3: holding the same force with what was found".to_owned(),
                _ => format!("pair {n}: holding the force with what was found"),
            };
            let after = match self.hold(context, &results.findings.rig, force_n, &what)? {
                Held::Whole(outcome, figures) => {
                    results.after.get_or_insert(outcome);
                    figures
                }
                Held::Implausible(_, why) => {
                    return Ok(Some(format!(
                        "the force was not held with it to the end: {why}"
                    )))
                }
            };
            afters.push(after);
            results.figures.1 = Figures::mean(&afters);
            // Without a session to the end there is nothing to compare. What holds the force again and again is better.
            let Some(before) = before.filter(|_| results.stopped.is_none()) else {
                if n < identify::FEWEST_PAIRS {
                    continue;
                }
                return Ok(None);
            };
            let pair = Pair { before, after };
            let repeats = pairs.contains(&pair);
            pairs.push(pair);
            let Some(gain) = Gain::of(&pairs) else {
                return Ok(Some("a run has no error to compare".to_owned()));
            };
            results.gain = Some(gain);
            if repeats || gain.is_decided() || n >= usize::from(self.pairs) {
                let of = |f: fn(&Pair) -> Figures| pairs.iter().map(f).collect::<Vec<_>>();
                results.figures.0 = Figures::mean(&of(|p| p.before));
                return Ok(match gain.is_better() {
                    true => None,
                    false if repeats => Some(REPEATS.to_owned()),
                    false => Some(not_better(&gain)),
                });
            }
        }
    }

    /// Name and text of the rig file.
    fn rig_text(&self) -> Result<(String, String)> {
        match self.connection.rig_path() {
            Some(path) => {
                let text = std::fs::read_to_string(path).map_err(|error| {
                    Failure::new(exit::RIG_FILE, format!("{}: {error}", path.display()))
                })?;
                Ok((path.display().to_string(), text))
            }
            None if self.apply => Err(Failure::new(
                exit::USAGE,
                "--apply needs a rig file to change: give it with --rig FILE (`forcectl check --print > FILE` makes one)",
            )),
            None => Ok((
                rig::DEFAULT_NAME.to_owned(),
                rig::DEFAULT_TEXT.to_owned(),
            )),
        }
    }

    fn write(&self, name: &str, text: &str) -> Result<()> {
        let path = self.out.join(name);
        std::fs::write(&path, text).map_err(|error| Failure::file(&path, error))
    }

    /// Opens the connection for the next session.
    fn open(&self, rig: &RigFile, context: &Context) -> Result<Box<dyn RigLink>> {
        let run = self.sessions.get();
        self.sessions.set(run + 1);
        self.connection.open_again(rig, run, context)
    }

    /// Holds the force in a session of its own. A fault 45 that ended it is an error, unless it may be cleared.
    fn hold(
        &self,
        context: &Context,
        rig: &RigFile,
        force_n: [f64; 3],
        what: &str,
    ) -> Result<Held> {
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.open(rig, context)?;
        let options = Options {
            stop: context.interrupt.flag(),
            zeroing: self.connection.zeroing(),
            ..Options::new(force_n, self.duration)
        };
        let mut watch = Watch::new(&context.output);
        watch.progress.beside(|output| output.note(what));
        let held = run::hold_force(link.as_mut(), rig, &options, &mut watch);
        watch.progress.done();
        let outcome = match held {
            Ok(outcome) => outcome,
            Err(stopped) => return self.stopped(stopped, link.as_mut(), context),
        };
        if outcome.ended == Ended::Interrupted || context.interrupt.requested() {
            return Err(Failure::from(RunError::Interrupted));
        }
        let figures = Figures::of(&outcome).ok_or_else(|| {
            Failure::new(
                exit::USAGE,
                "--duration is too short for figures; give 2 s or more",
            )
        })?;
        Ok(Held::Whole(outcome, figures))
    }

    /// What a session is worth that ended early. Clears a fault 45, if the user wants it. Where its cause is still there it stays
    /// latched, and the next session does not begin.
    fn stopped(&self, stopped: Stopped, link: &mut dyn RigLink, context: &Context) -> Result<Held> {
        let Stopped { error, outcome } = stopped;
        let units = outcome.as_ref().and_then(|o| implausible(&o.faults));
        match (units, outcome) {
            (Some(units), Some(outcome)) if self.clear_implausible => {
                let why = format!("fault 45 (tension implausible) of {units} ended a session");
                context.output.note(&format!("{why}; it is cleared"));
                let mut session = Session::connect(link)?;
                session.command(&Command::ClearFaults)?;
                Ok(Held::Implausible(*outcome, why))
            }
            (Some(_), _) => Err(Failure::new(
                exit::BOARD,
                format!(
                    "{error}\nA drive with a delay oscillates in a closed loop until this fault ends it. If cables, cells and amplifiers are \
                     as they should be, --clear-implausible clears the fault and goes on with open loops, to find the cause"
                ),
            )),
            (None, _) => Err(error.into()),
        }
    }

    /// Drives the cables with the loops open, and records it.
    fn drive(&self, context: &Context, rig: &RigFile) -> Result<identify::Recording> {
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.open(rig, context)?;
        let mut watch = Watch::new(&context.output);
        watch
            .progress
            .beside(|output| output.note("session 2: driving the cables for the analysis"));
        let stop = context.interrupt.flag();
        let recording = identify::excite(
            link.as_mut(),
            rig,
            self.drive_duration,
            &self.connection.zeroing(),
            &stop,
            &mut watch,
        );
        watch.progress.done();
        let recording = recording?;
        if context.interrupt.requested() {
            return Err(Failure::from(RunError::Interrupted));
        }
        Ok(recording)
    }

    /// Prints the report, then writes it with plot and figures. A file that cannot be written costs only itself.
    fn report(&self, context: &Context, results: &Results, name: &str) -> Result<Reply> {
        let report = markdown(results, name);
        let record = record(results, name);
        if !context.output.json() {
            context.output.results(&format!("{report}\n"));
        }
        let plot = (results.after.as_ref()).map(|after| {
            self.write(
                "compare.svg",
                &plot::compare(&results.before, after).to_svg(),
            )
        });
        let failures: Vec<Failure> = plot
            .into_iter()
            .chain([
                self.write("report.md", &report),
                self.write("identify.json", &format!("{record:#}")),
            ])
            .filter_map(Result::err)
            .collect();
        let code = if results.left.is_none() {
            exit::DONE
        } else {
            exit::DEGRADED
        };
        let text = format!("results: {}\n", self.out.display());
        let reply = Reply::new(text, record).with_code(code);
        if failures.is_empty() {
            return Ok(reply);
        }
        let messages: Vec<String> = failures.into_iter().map(|f| f.message).collect();
        Err(Failure::new(exit::FILE, messages.join("\n")).with_reply(reply))
    }
}

/// The units in words, where all faults of a session are fault 45 of units.
fn implausible(faults: &[RunFault]) -> Option<String> {
    let unit = |fault: &RunFault| {
        fault
            .unit
            .filter(|_| fault.code == Fault::Implausible.code())
    };
    let mut units: Vec<u8> = faults.iter().map(unit).collect::<Option<_>>()?;
    units.sort_unstable();
    units.dedup();
    let names: Vec<String> = units.iter().map(u8::to_string).collect();
    match names.len() {
        0 => None,
        1 => Some(format!("unit {}", names[0])),
        _ => Some(format!("units {}", names.join(", "))),
    }
}

/// Why a gain does not support a change.
fn not_better(gain: &Gain) -> String {
    let why = if !gain.is_decided() {
        "its interval does not exclude zero; more --pairs or a longer --duration may decide it"
    } else if gain.tip_growth > 0.0 && gain.mean > 0.0 {
        "the force error at the tip did not fall with it"
    } else {
        "less than 2 % does not count"
    };
    format!("the force was held no better with it: the worst cable gained {gain}; {why}")
}

/// Replaces a rig file by a new one. The old file stays beside it under a new name.
fn replace(path: &Path, old: &str, new: &str) -> Result<(PathBuf, PathBuf)> {
    let mut kept = None;
    for n in 1..10_000 {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".before-{n}"));
        let candidate = PathBuf::from(name);
        // An existing file is not overwritten.
        match std::fs::File::create_new(&candidate) {
            Ok(mut file) => {
                std::io::Write::write_all(&mut file, old.as_bytes())
                    .and_then(|()| file.sync_all())
                    .map_err(|error| Failure::file(&candidate, error))?;
                kept = Some(candidate);
                break;
            }
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(Failure::file(&candidate, error)),
        }
    }
    let kept = kept.ok_or_else(|| {
        Failure::new(
            exit::FILE,
            format!(
                "{}: all names from .before-1 to .before-9999 are taken; move the old files away",
                path.display()
            ),
        )
    })?;
    files::replace(path, new).map_err(|error| Failure::file(path, error))?;
    Ok((path.to_owned(), kept))
}

fn record(results: &Results, rig_name: &str) -> serde_json::Value {
    let units: Vec<_> = results
        .findings
        .units
        .iter()
        .map(|u| {
            json!({
                "unit": u.unit,
                "verdict": u.report.verdict,
                "heldout_rmse_before": u.report.baseline.heldout_rmse,
                "heldout_rmse_after": u.report.last.heldout_rmse,
                "effects": u.report.effects,
                "not_identifiable": u.report.not_identifiable,
                "structure": u.report.structure,
                "not_used": u.not_used,
            })
        })
        .collect();
    json!({
        "rig": results.before.link,
        "firmware": results.before.firmware,
        "rig_file": rig_name,
        "units": units,
        "excitation_swing": results.swing,
        "changed": results.findings.rewritten.changed,
        "before": results.figures.0,
        "before_fault": results.stopped,
        "after": results.figures.1,
        "gain": results.gain,
        "better": match (&results.stopped, &results.gain) {
            (Some(_), _) => Some(results.left.is_none()),
            (None, gain) => gain.map(|gain| gain.is_better()),
        },
        "left": results.left,
        "applied": results.applied.as_ref().map(|(file, kept)| json!({"file": file, "kept": kept})),
    })
}

fn markdown(results: &Results, rig_name: &str) -> String {
    let mut t = String::new();
    let mut line = |text: String| {
        let _ = writeln!(t, "{text}");
    };
    line(format!("# What {rig_name} lacks\n"));
    line(format!(
        "{}, firmware {}.\n",
        results.before.link, results.before.firmware
    ));
    line("## Found\n".to_owned());
    line("| unit | verdict | tension error of the model, N | found |".to_owned());
    line("|---|---|---|---|".to_owned());
    for u in &results.findings.units {
        let r = &u.report;
        let effects: Vec<String> = r.effects.iter().map(effect).collect();
        line(format!(
            "| {} | {} | {:.3} -> {:.3} | {} |",
            u.unit,
            r.verdict.word(),
            r.baseline.heldout_rmse,
            r.last.heldout_rmse,
            if effects.is_empty() {
                "-".to_owned()
            } else {
                effects.join("; ")
            }
        ));
    }
    line(format!(
        "\nEach unit's report with its plots, rivals and intervals is in its folder: {}.",
        results
            .findings
            .units
            .iter()
            .map(|u| format!("unit{}/report.md", u.unit))
            .collect::<Vec<_>>()
            .join(", ")
    ));
    if results.swing < 1.0 {
        line(format!(
            "\nThe force at the tip came near `force_limit_n`, so the commands swung less from then on: {:.0} % at the end.",
            100.0 * results.swing
        ));
    }
    line("\n## Changed in the rig file\n".to_owned());
    let changed = &results.findings.rewritten.changed;
    for change in changed {
        line(format!("- {change}"));
    }
    if changed.is_empty() {
        line("Nothing.".to_owned());
    }
    for u in &results.findings.units {
        for why in &u.not_used {
            line(format!("- unit {}, not used: {why}", u.unit));
        }
    }
    line("\n## Before and after\n".to_owned());
    let (before, after) = &results.figures;
    let cell = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.4}"));
    line(format!(
        "RMS errors while the force is held, N, {}.\n",
        if before.or(*after).is_some_and(|f| f.from_truth) {
            "by the plant's truth"
        } else {
            "by the load cells"
        }
    ));
    line("| | before | after |".to_owned());
    line("|---|---|---|".to_owned());
    for i in 0..UNITS {
        line(format!(
            "| tension of cable {} | {} | {} |",
            i + 1,
            cell(before.map(|b| b.tension_rms_n[i])),
            cell(after.map(|a| a.tension_rms_n[i]))
        ));
    }
    line(format!(
        "| worst cable | {} | {} |",
        cell(before.map(|b| b.worst_tension_rms_n)),
        cell(after.map(|a| a.worst_tension_rms_n))
    ));
    line(format!(
        "| force at the tip | {} | {} |",
        cell(before.map(|b| b.tip_rms_n)),
        cell(after.map(|a| a.tip_rms_n))
    ));
    if let Some(why) = &results.stopped {
        line(format!(
            "\nWithout the findings the force was not held to the end: {why}."
        ));
    }
    if let Some(gain) = &results.gain {
        line(format!("\nReduction of the worst cable's error: {gain}. The table has the means of these runs."));
    }
    if after.is_some() {
        line("\n![Errors before and after](compare.svg)".to_owned());
    }
    if let Some(left) = &results.left {
        line(format!("\nThe rig file is left as it is: {left}."));
    }
    if let Some((file, kept)) = &results.applied {
        line(format!(
            "\nApplied to {}; the old one is {}.",
            file.display(),
            kept.display()
        ));
    }
    t
}

/// An effect with its numbers, in a line.
fn effect(e: &residual::Effect) -> String {
    let numbers: Vec<String> = e
        .params
        .iter()
        .map(|(name, value)| {
            let unit = e.units.get(name).map_or("", String::as_str);
            let unit = if unit == "1" { "" } else { unit };
            format!("{} {value:.4} {unit}", name.replace('_', " "))
                .trim_end()
                .to_owned()
        })
        .collect();
    format!("{} ({})", e.name, numbers.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_fault_45_of_units_may_be_cleared() {
        let fault = |unit: Option<u8>, fault: Fault| RunFault {
            t_s: 1.0,
            unit,
            code: fault.code(),
            text: String::new(),
        };
        let of = |unit: u8| fault(Some(unit), Fault::Implausible);
        let words = |faults: &[RunFault]| implausible(faults);
        assert_eq!(words(&[of(3)]).as_deref(), Some("unit 3"));
        assert_eq!(
            words(&[of(6), of(1), of(3), of(1)]).as_deref(),
            Some("units 1, 3, 6")
        );
        assert_eq!(words(&[]), None);
        assert_eq!(words(&[of(1), fault(None, Fault::TipForce)]), None);
        assert_eq!(words(&[of(1), fault(Some(2), Fault::SensorFrozen)]), None);
        assert_eq!(words(&[fault(None, Fault::Implausible)]), None);
    }

    #[test]
    fn the_old_rig_file_is_kept_however_often() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, "one").expect("written");
        let read = |path: &Path| std::fs::read_to_string(path).expect("is there");
        let (_, first) = replace(&path, "one", "two").expect("replaced");
        let (_, second) = replace(&path, "two", "three").expect("replaced");
        assert_eq!(
            (read(&path), read(&first), read(&second)),
            ("three".into(), "one".into(), "two".into())
        );
        // Nothing else is left lying about.
        assert_eq!(std::fs::read_dir(&folder).expect("is there").count(), 3);
        // A place that can't be written to: an error, and the file is as it was.
        let failure =
            replace(&folder.path().join("none/rig.toml"), "x", "y").expect_err("is refused");
        assert_eq!(failure.code, 7);
    }
}
