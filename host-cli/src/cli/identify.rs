//! `forcectl identify`: what the rig file lacks on this rig, corrected, and whether it was better.

use super::args::{Global, Identify};
use super::residual::Stages;
use super::{open, Failure, Result, Watch};
use host_cli::identify::{self, Figures, FindError, Findings};
use host_cli::plot;
use host_cli::rigfile::{self, RigFile};
use host_cli::run::{self, Ended, Options, Outcome};
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::Arc;

impl From<FindError> for Failure {
    fn from(error: FindError) -> Self {
        let code = match &error {
            FindError::File { .. } => 7,
            FindError::Analysis { .. } => 8,
            FindError::RigFile(_) => 3,
        };
        Self::new(code, error)
    }
}

/// Everything that comes of the command.
struct Story {
    findings: Findings,
    /// Part of the excitation's amplitude that was left at the end.
    swing: f64,
    before: Outcome,
    after: Option<Outcome>,
    figures: (Figures, Option<Figures>),
    /// Where the rig file was put, and where the old one is kept.
    applied: Option<(PathBuf, PathBuf)>,
    /// Why nothing was changed.
    left: Option<String>,
}

/// Runs the command.
pub fn identify(
    global: &Global,
    rig: &RigFile,
    arguments: &Identify,
    stop: Arc<AtomicBool>,
) -> Result<u8> {
    // Whatever may be wrong with the arguments comes before anything is driven.
    let force_n: [f64; 3] = arguments
        .force
        .as_slice()
        .try_into()
        .map_err(|_| Failure::new(2, "--force takes three numbers, as in --force 0 2.5 0"))?;
    rig.check_force(force_n.into())
        .map_err(|why| Failure::new(2, why))?;
    identify::check(rig, arguments.seconds)?;
    let (name, text) = match &global.config {
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|error| Failure::new(3, format!("{}: {error}", path.display())))?;
            (path.display().to_string(), text)
        }
        None if arguments.apply => {
            return Err(Failure::new(
                2,
                "--apply needs a rig file to change: give it with --config FILE (`forcectl check --print > FILE` makes one)",
            ))
        }
        None => (
            rigfile::DEFAULT_NAME.to_owned(),
            rigfile::DEFAULT_TEXT.to_owned(),
        ),
    };
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(|error| Failure::file(out, error))?;
    let file = |name: &str, text: &str| -> Result<()> {
        let path = out.join(name);
        std::fs::write(&path, text).map_err(|error| Failure::file(&path, error))
    };
    file("rig.before.toml", &text)?;

    let options = Options {
        stop: Arc::clone(&stop),
        ..Options::new(force_n, arguments.hold)
    };
    let hold = |rig: &RigFile, what: &str| -> Result<(Outcome, Figures)> {
        let mut watch = Watch::new(global.json);
        watch.progress.say(what);
        let outcome = run::set_force(open(global, rig)?.as_mut(), rig, &options, &mut watch);
        watch.progress.done();
        let outcome = outcome?;
        if outcome.ended == Ended::Interrupted {
            return Err(Failure::from(run::RunError::Interrupted));
        }
        let figures = Figures::of(&outcome)
            .ok_or_else(|| Failure::new(2, "--for is too short for figures: give 2 s or more"))?;
        Ok((outcome, figures))
    };
    let (before, figures_before) = hold(rig, "session 1: a force with the rig file as it is")?;

    let mut watch = Watch::new(global.json);
    watch
        .progress
        .say("session 2: driving the cables, to be analysed");
    let recording = identify::excite(
        open(global, rig)?.as_mut(),
        rig,
        arguments.seconds,
        &stop,
        &mut watch,
    );
    watch.progress.done();
    let recording = recording?;
    let mut stages = Stages::new(global.json);
    let findings = identify::find(&recording, rig, &name, &text, out, &mut stages)?;
    file("rig.after.toml", &findings.rewritten.text)?;

    let mut story = Story {
        findings,
        swing: recording.swing,
        before,
        after: None,
        figures: (figures_before, None),
        applied: None,
        left: None,
    };
    if story.findings.rewritten.changed.is_empty() {
        story.left = Some("nothing was found that is clear and that the board can use".to_owned());
    } else {
        let (after, figures_after) = hold(
            &story.findings.rig,
            "session 3: the same force with what was found",
        )?;
        let better = figures_after.better_than(&story.figures.0);
        story.after = Some(after);
        story.figures.1 = Some(figures_after);
        if !better {
            story.left = Some("the force was held no better with it".to_owned());
        } else if let (true, Some(path)) = (arguments.apply, &global.config) {
            story.applied = Some(replace(path, &text, &story.findings.rewritten.text)?);
        }
    }
    if let Some(after) = &story.after {
        file("compare.svg", &plot::compare(&story.before, after).to_svg())?;
    }
    let report = markdown(&story, &name);
    file("report.md", &report)?;
    let record = record(&story, &name);
    let pretty = serde_json::to_string_pretty(&record)
        .map_err(|error| Failure::file(&out.join("identify.json"), error))?;
    file("identify.json", &pretty)?;
    if global.json {
        println!("{record}");
    } else {
        println!("{report}");
        println!("all of it: {}", out.display());
    }
    Ok(if story.left.is_none() { 0 } else { 6 })
}

/// Puts a new rig file in the place of the old one, which is kept beside it under a name that was free.
fn replace(path: &Path, old: &str, new: &str) -> Result<(PathBuf, PathBuf)> {
    let mut kept = None;
    for n in 1..10_000 {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".before-{n}"));
        let candidate = PathBuf::from(name);
        // Made here or not at all: whatever has the name already is not overwritten.
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
            7,
            format!(
                "{}: ten thousand old files stand beside it; move them away",
                path.display()
            ),
        )
    })?;
    // The new text beside it first, so that the name never stands for half a file.
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    let fresh = PathBuf::from(name);
    std::fs::write(&fresh, new).map_err(|error| Failure::file(&fresh, error))?;
    std::fs::rename(&fresh, path).map_err(|error| Failure::file(path, error))?;
    Ok((path.to_owned(), kept))
}

fn record(story: &Story, rig_name: &str) -> serde_json::Value {
    let units: Vec<_> = story
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
        "rig": story.before.link,
        "firmware": story.before.firmware,
        "rig_file": rig_name,
        "units": units,
        "excitation_swing": story.swing,
        "changed": story.findings.rewritten.changed,
        "before": story.figures.0,
        "after": story.figures.1,
        "better": story.figures.1.map(|after| after.better_than(&story.figures.0)),
        "left": story.left,
        "applied": story.applied.as_ref().map(|(file, kept)| json!({"file": file, "kept": kept})),
    })
}

fn markdown(story: &Story, rig_name: &str) -> String {
    let mut t = String::new();
    let mut line = |text: String| {
        let _ = writeln!(t, "{text}");
    };
    line(format!("# What {rig_name} lacks\n"));
    line(format!(
        "{}, firmware {}.\n",
        story.before.link, story.before.firmware
    ));
    line("## Found\n".to_owned());
    line("| unit | verdict | tension error of the model, N | found |".to_owned());
    line("|---|---|---|---|".to_owned());
    for u in &story.findings.units {
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
        story
            .findings
            .units
            .iter()
            .map(|u| format!("unit{}/report.md", u.unit))
            .collect::<Vec<_>>()
            .join(", ")
    ));
    if story.swing < 1.0 {
        line(format!(
            "\nThe force at the tip came near `force_limit_n`, so the commands swung less from then on: {:.0} % at the end.",
            100.0 * story.swing
        ));
    }
    line("\n## Changed in the rig file\n".to_owned());
    let changed = &story.findings.rewritten.changed;
    for change in changed {
        line(format!("- {change}"));
    }
    if changed.is_empty() {
        line("Nothing.".to_owned());
    }
    for u in &story.findings.units {
        for why in &u.not_used {
            line(format!("- unit {}, not used: {why}", u.unit));
        }
    }
    line("\n## Before and after\n".to_owned());
    let (before, after) = &story.figures;
    let cell = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.4}"));
    line(format!(
        "RMS errors while the force is held, N, {}.\n",
        if before.from_truth {
            "by the plant's truth"
        } else {
            "by the load cells"
        }
    ));
    line("| | before | after |".to_owned());
    line("|---|---|---|".to_owned());
    for (i, rms) in before.tension_rms_n.iter().enumerate() {
        line(format!(
            "| tension of cable {} | {} | {} |",
            i + 1,
            cell(Some(*rms)),
            cell(after.map(|a| a.tension_rms_n[i]))
        ));
    }
    line(format!(
        "| worst cable | {} | {} |",
        cell(Some(before.worst_tension_rms_n)),
        cell(after.map(|a| a.worst_tension_rms_n))
    ));
    line(format!(
        "| force at the tip | {} | {} |",
        cell(Some(before.tip_rms_n)),
        cell(after.map(|a| a.tip_rms_n))
    ));
    if after.is_some() {
        line("\n![Errors before and after](compare.svg)".to_owned());
    }
    if let Some(left) = &story.left {
        line(format!("\nThe rig file is left as it is: {left}."));
    }
    if let Some((file, kept)) = &story.applied {
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
    fn the_old_rig_file_is_kept_however_often() {
        let folder = std::env::temp_dir().join(format!("identify-keep-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let path = folder.join("rig.toml");
        std::fs::write(&path, "one").expect("written");
        let read = |path: &Path| std::fs::read_to_string(path).expect("is there");
        let (_, first) = replace(&path, "one", "two").ok().expect("replaced");
        let (_, second) = replace(&path, "two", "three").ok().expect("replaced");
        assert_eq!(
            (read(&path), read(&first), read(&second)),
            ("three".into(), "one".into(), "two".into())
        );
        // Nothing else is left lying about.
        assert_eq!(std::fs::read_dir(&folder).expect("is there").count(), 3);
        // A place that can't be written to: an error, and the file is as it was.
        let failure = replace(&folder.join("none/rig.toml"), "x", "y").expect_err("is refused");
        assert_eq!(failure.code, 7);
        std::fs::remove_dir_all(folder).expect("cleaned up");
    }
}
