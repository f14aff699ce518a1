//! The folder of a report: check that it can be written to, remove an earlier report, write a new
//! one.

use super::document::Part;
use super::Report;
use residual_columns::error::Error;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Files of a report apart from plots and models.
const TEXTS: [&str; 3] = ["report.md", "report.html", "report.json"];

/// Model files of a report.
pub const MODELS: [&str; 2] = ["MODEL.extended.toml", "MODEL.frozen.toml"];

/// Prepares a folder for a report, without creating it: checks that it can be written to, and
/// removes the reports and plots of an earlier analysis, so that they are not mistaken for new ones
/// if this one fails. Model files stay, because one of them may be the input. In a folder without a
/// `report.json` of an analysis (of any version) nothing is removed.
///
/// # Errors
/// [`Error::Io`] if the path is not a folder or cannot be written to, if it holds a report that no
/// analysis wrote, or if an earlier report cannot be removed.
pub fn clear(dir: &Path) -> Result<(), Error> {
    writable(dir)?;
    let Ok(entries) = std::fs::read_dir(dir) else {
        return Ok(());
    };
    let json = dir.join("report.json");
    let ours = std::fs::read_to_string(&json)
        .ok()
        .and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok())
        .is_some_and(|v| v.pointer("/baseline/heldout_rmse").is_some());
    if !ours {
        return match TEXTS.iter().map(|n| dir.join(n)).find(|p| p.exists()) {
            None => Ok(()),
            Some(foreign) => Err(Error::io(
                &foreign,
                "no analysis wrote this file, and a report would overwrite it; choose another folder for the reports, or move the file",
            )),
        };
    }
    for path in entries.filter_map(|e| e.ok().map(|e| e.path())) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let plot = name == "structure.svg" || name.starts_with("effect-") && name.ends_with(".svg");
        if plot || TEXTS.contains(&name.as_ref()) && path != json {
            std::fs::remove_file(&path).map_err(|e| Error::io(&path, e))?;
        }
    }
    // Last, so that a failure above can be repeated.
    std::fs::remove_file(&json).map_err(|e| Error::io(&json, e))
}

/// Checks that a folder can be written to, or created, before an analysis rather than after it.
fn writable(dir: &Path) -> Result<(), Error> {
    let no = |path: &Path, why: String| {
        Err(Error::io(
            path,
            format!("{why}; reports need a folder that can be written to"),
        ))
    };
    // The folder, or its nearest ancestor that exists.
    for at in dir.ancestors() {
        let at = if at.as_os_str().is_empty() {
            Path::new(".")
        } else {
            at
        };
        match std::fs::metadata(at) {
            Ok(m) if !m.is_dir() => return no(at, "this is a file".into()),
            Ok(_) => {
                // A name of its own for every call: calls may run at once, in this process and
                // others.
                static CALLS: AtomicUsize = AtomicUsize::new(0);
                let call = CALLS.fetch_add(1, Ordering::Relaxed);
                let probe = at.join(format!(".residual-{}-{call}", std::process::id()));
                return match std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe))
                {
                    Ok(()) => Ok(()),
                    Err(e) => no(at, format!("cannot be written to ({e})")),
                };
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            // An ancestor is a file: the loop reports it.
            Err(e) if e.kind() == std::io::ErrorKind::NotADirectory => {}
            Err(e) => return no(at, e.to_string()),
        }
    }
    Ok(())
}

impl Report {
    /// Writes the report to a folder, which is created if needed: `report.md` with its plots,
    /// `report.html`, `MODEL.extended.toml`, `MODEL.frozen.toml` and, last, `report.json`. So where
    /// there is a `report.json`, the other files are complete.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be written (then all are removed), or [`Error::Model`] if the
    /// extended model cannot be written as TOML.
    pub fn write(&self, dir: &Path) -> Result<(), Error> {
        let mut files: Vec<(String, String)> = self
            .document()
            .into_iter()
            .filter_map(|part| match part {
                Part::Picture { file, plot, .. } => Some((file, plot.svg(&self.unit))),
                _ => None,
            })
            .collect();
        let [extended, frozen] = MODELS;
        files.push((extended.into(), self.model()?));
        files.push((frozen.into(), self.frozen()?));
        files.push(("report.md".into(), self.markdown()));
        files.push(("report.html".into(), self.html()));
        files.push(("report.json".into(), self.json()?));
        std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, e))?;
        for (i, (name, text)) in files.iter().enumerate() {
            let path = dir.join(name);
            if let Err(e) = std::fs::write(&path, text) {
                // No part of a report stays without the rest.
                for (name, _) in &files[..=i] {
                    let _ = std::fs::remove_file(dir.join(name));
                }
                return Err(Error::io(&path, e));
            }
        }
        Ok(())
    }
}
