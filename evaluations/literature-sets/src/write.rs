//! A set as a folder: `logs/run01.csv` and so on, `MODEL.toml`, `truth.json`.

use crate::declared::DEADBAND_RAD_S;
use crate::log::{file_name, Run};
use crate::set::Set;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// A log as CSV text, with a header line.
pub fn csv(run: &Run) -> String {
    let mut text = run.columns.join(",");
    text.push('\n');
    for row in &run.rows {
        for (i, value) in row.iter().enumerate() {
            let _ = write!(text, "{}{value:.6}", if i > 0 { "," } else { "" });
        }
        text.push('\n');
    }
    text
}

/// The declared model of a set, as the analysis reads it. It says nothing about what is missing.
pub fn model_toml(set: &Set) -> String {
    let mut text = String::from("title = \"Synthetic force rig\"\n\n[roles]\n");
    let _ = write!(
        text,
        "time = {{ column = \"time_s\", unit = \"s\" }}\n\
         target = {{ column = \"force_n\", unit = \"N\" }}\n\
         command = {{ column = \"command_n\", unit = \"N\" }}\n\
         velocity = {{ column = \"speed_rad_s\", unit = \"rad/s\", deadband = {DEADBAND_RAD_S} }}\n\
         angle = {{ column = \"angle_rad\", unit = \"rad\" }}\n"
    );
    if set.has_temperature {
        text.push_str("temperature = { column = \"temperature_c\", unit = \"°C\" }\n");
    }
    text.push_str(
        "\n[roles.pose]\n\
         shoulder = { column = \"shoulder_rad\", unit = \"rad\" }\n\
         elbow = { column = \"elbow_rad\", unit = \"rad\" }\n\
         \n[roles.channels]\n\
         neighbour_1 = { column = \"neighbour_1_n\", unit = \"N\" }\n\
         neighbour_2 = { column = \"neighbour_2_n\", unit = \"N\" }\n",
    );
    for term in &set.terms {
        let _ = write!(
            text,
            "\n[[terms]]\nname = \"{}\"\nexpr = \"{}\"\nunit = \"{}\"\n",
            term.name, term.expr, term.unit
        );
        if term.fixed {
            let _ = writeln!(text, "fixed = {:?}", term.coefficient);
        }
    }
    text
}

/// Writes a set into a new folder.
///
/// # Errors
/// If the folder exists or can't be written.
pub fn write(set: &Set, folder: &Path) -> Result<(), String> {
    let failed = |path: &Path, e: std::io::Error| format!("{}: {e}", path.display());
    if folder.exists() {
        return Err(format!(
            "{} exists; remove it or give another --out or --seed",
            folder.display()
        ));
    }
    let logs = folder.join("logs");
    fs::create_dir_all(&logs).map_err(|e| failed(&logs, e))?;
    let put = |path: &Path, text: &str| fs::write(path, text).map_err(|e| failed(path, e));
    for (i, run) in set.runs.iter().enumerate() {
        put(&logs.join(file_name(i)), &csv(run))?;
    }
    put(&folder.join("MODEL.toml"), &model_toml(set))?;
    put(&folder.join("truth.json"), &format!("{:#}\n", set.truth()))
}
