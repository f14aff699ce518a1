//! The program itself: bad input ends with a clear message and its exit code, and touches nothing.

use std::path::PathBuf;
use std::process::{Command, Output};

/// Runs forcectl in a fresh folder without the embedded rig's variables, as on a machine without any rig.
fn forcectl(name: &str, arguments: &[&str]) -> (Output, PathBuf) {
    let folder = std::env::temp_dir().join(format!("forcectl-cli-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let output = Command::new(env!("CARGO_BIN_EXE_forcectl"))
        .args(arguments)
        .current_dir(&folder)
        .env_remove("FORCE_RIG_BIN")
        .env_remove("FORCE_FIRMWARE_ELF")
        .output()
        .expect("forcectl runs");
    (output, folder)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn forces_that_are_none_are_refused_before_anything_is_opened() {
    let cases: &[(&[&str], &str)] = &[
        (&["set-force", "0", "nan", "0"], "finite"),
        (&["set-force", "inf", "0", "0"], "finite"),
        (&["set-force", "0", "0", "-inf"], "finite"),
        (&["set-force", "0", "1e9", "0"], "limit"),
        (&["set-force", "0", "-1e9", "0"], "limit"),
        (&["set-force", "0", "much", "0"], "no number"),
        (&["set-force", "0", "2.5"], "required"),
        (&["set-force", "0", "2.5", "0", "--for", "nan"], "seconds"),
        (
            &["set-force", "0", "2.5", "0", "--inject", "unplug=9@1s"],
            "1 to 6",
        ),
        (&["identify"], "--out"),
        (&["identify", "--out", "o", "--seconds", "2"], "8 to 600"),
        (&["identify", "--out", "o", "--seconds", "nan"], "seconds"),
        (
            &["identify", "--out", "o", "--force", "0", "nan", "0"],
            "finite",
        ),
        (
            &["identify", "--out", "o", "--force", "0", "99", "0"],
            "limit",
        ),
        (&["identify", "--out", "o", "--apply"], "--config"),
        (
            &["set-force", "0", "2.5", "0", "--rig", "carrier-pigeon"],
            "serial:PORT",
        ),
    ];
    for (i, (arguments, words)) in cases.iter().enumerate() {
        let (output, folder) = forcectl(&format!("bad-{i}"), arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains(words), "{arguments:?}: {error}");
        assert_eq!(
            std::fs::read_dir(&folder).expect("is there").count(),
            0,
            "{arguments:?} left files"
        );
        std::fs::remove_dir_all(folder).expect("cleaned up");
    }
}

#[test]
fn without_the_rigs_variables_it_says_how_to_run() {
    let (output, folder) = forcectl("env", &["set-force", "0", "-2.5", "0"]);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{error}");
    assert!(error.contains("cargo forcectl"), "{error}");
    std::fs::remove_dir_all(folder).expect("cleaned up");
}

#[test]
fn a_port_that_is_not_there_is_a_link_error_also_as_json() {
    let (output, folder) = forcectl(
        "port",
        &["--json", "status", "--rig", "serial:/dev/no-such-port"],
    );
    assert_eq!(output.status.code(), Some(4));
    let json: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("JSON on standard output");
    assert_eq!(json["exit_code"], 4);
    assert!(json["error"]
        .as_str()
        .is_some_and(|e| e.contains("/dev/no-such-port")));
    std::fs::remove_dir_all(folder).expect("cleaned up");
}

#[test]
fn rig_files_are_checked_with_their_lines() {
    let (output, folder) = forcectl("check", &["check", "--print"]);
    let example = text(&output.stdout);
    let good = folder.join("good.toml");
    std::fs::write(&good, &example).expect("written");
    let bad = folder.join("bad.toml");
    let swapped = example
        .replacen("tension_min_n = 2.0", "tension_min_n = 12.0", 1)
        .replacen("tension_max_n = 12.0", "tension_max_n = 2.0", 1);
    std::fs::write(&bad, swapped).expect("written");
    let path = |path: &PathBuf| path.to_str().expect("plain").to_owned();
    let (output, other) = forcectl("check-good", &["check", &path(&good)]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("6 units enabled"));
    std::fs::remove_dir_all(other).expect("cleaned up");
    let bad = path(&bad);
    for arguments in [
        &["check", &bad][..],
        &["set-force", "0", "1", "0", "--config", &bad],
    ] {
        let (output, other) = forcectl("check-bad", arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{error}");
        assert!(
            error.contains("bad.toml:") && error.contains("swapped"),
            "{error}"
        );
        std::fs::remove_dir_all(other).expect("cleaned up");
    }
    std::fs::remove_dir_all(folder).expect("cleaned up");
}

#[test]
fn faults_are_explained_and_shells_completed() {
    let (output, folder) = forcectl("explain", &["explain", "33"]);
    assert!(
        text(&output.stdout).contains("sensor silent"),
        "{}",
        text(&output.stdout)
    );
    std::fs::remove_dir_all(folder).expect("cleaned up");
    let (output, folder) = forcectl("explain-none", &["explain", "999"]);
    assert_eq!(output.status.code(), Some(2));
    std::fs::remove_dir_all(folder).expect("cleaned up");
    let (output, folder) = forcectl("completions", &["completions", "bash"]);
    assert!(text(&output.stdout).contains("set-force"));
    std::fs::remove_dir_all(folder).expect("cleaned up");
}
