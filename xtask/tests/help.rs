//! `--help` of xtask and of each of its commands prints the usage and starts nothing.

use std::process::Command;

fn xtask(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(arguments)
        .output()
        .expect("xtask runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

#[test]
fn every_command_prints_its_usage() {
    let (code, list, _) = xtask(&["--help"]);
    assert_eq!(code, Some(0));
    assert_eq!(xtask(&["help"]).1, list);
    let names: Vec<&str> = list
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .map_while(|line| line.split_whitespace().next())
        .collect();
    assert!(names.len() > 12, "{names:?}");
    for name in names {
        let (code, page, err) = xtask(&["help", name]);
        assert_eq!(code, Some(0), "{name}: {err}");
        assert!(
            page.contains(&format!("Usage: cargo xtask {name}")) && err.is_empty(),
            "{name}: {page}{err}"
        );
        // The help of a program is the program's, for which it is built.
        if !page.contains("the program is built for it") {
            assert_eq!(xtask(&[name, "--help"]).1, page, "{name}");
        }
    }
}

#[test]
fn what_is_not_a_command_is_refused() {
    for arguments in [&["no-such-command"][..], &["help", "no-such-command"], &[]] {
        let (code, out, err) = xtask(arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {err}");
        assert!(out.is_empty() && err.contains("cargo xtask help"), "{err}");
    }
}
