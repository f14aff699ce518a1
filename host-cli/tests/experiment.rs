//! `forcectl experiment` as a program: checked, run, refused, reported.

use std::path::Path;
use std::process::{Command, Stdio};

fn forcectl(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_forcectl"))
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .env("FORCECTL_RUNTIME_DIR", folder.join("run"))
        .env("FORCECTL_STATE_DIR", folder.join("state"))
        .output()
        .expect("forcectl runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

#[test]
fn an_experiment_is_checked_run_and_reported() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (code, text, _) = forcectl(folder, &["experiment", "check", "--print"]);
    assert_eq!(code, Some(0));
    let text = text
        .replace("minutes = 20.0", "minutes = 0.05")
        .replace("trials = 9", "trials = 1");
    std::fs::write(folder.join("short.toml"), &text).unwrap();
    let (code, out, err) = forcectl(folder, &["experiment", "check", "short.toml"]);
    assert_eq!(code, Some(0), "{err}");
    assert!(out.contains("at all 31 places"), "{out}");

    let arguments = ["experiment", "run", "short.toml", "--out", "out"];
    let (code, out, err) = forcectl(folder, &arguments);
    assert_eq!(code, Some(0), "{out}{err}");
    assert!(
        out.contains("1 of 1 trials") && out.contains("report"),
        "{out}"
    );
    for path in [
        "dataset/trial-01.parquet",
        "dataset/card.json",
        "report/tracking.svg",
    ] {
        assert!(folder.join("out").join(path).is_file(), "{path}");
    }
    let (code, _, err) = forcectl(folder, &arguments);
    assert_eq!(code, Some(2));
    assert!(err.contains("--resume"), "{err}");
    let (code, out, _) = forcectl(
        folder,
        &["experiment", "report", "out", "--report-into", "page"],
    );
    assert_eq!(code, Some(0), "{out}");
    assert!(folder.join("page/data-card.md").is_file());
}

#[test]
fn what_can_t_be_done_is_refused_before_anything_is_made() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (_, text, _) = forcectl(folder, &["experiment", "check", "--print"]);
    let text = text
        .replace("largest_n = 4.5", "largest_n = 11.9")
        .replace("fastest_n_per_s = 0.3", "fastest_n_per_s = 60.0");
    std::fs::write(folder.join("large.toml"), text).unwrap();
    let (code, _, err) = forcectl(folder, &["experiment", "run", "large.toml", "--out", "out"]);
    assert_eq!(code, Some(2));
    assert!(
        err.contains("the nearest is") && err.contains("nothing was driven"),
        "{err}"
    );
    assert!(!folder.join("out").exists());
    let (code, _, err) = forcectl(folder, &["experiment", "report", "."]);
    assert_eq!(code, Some(2));
    assert!(err.contains("holds no experiment"), "{err}");
}
