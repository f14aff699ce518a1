//! `--help` prints the usage; a wrong option is refused with it.

use std::process::{Command, Output};

fn run(program: &str, argument: &str) -> Output {
    Command::new(program)
        .args([argument, "value"])
        .output()
        .expect("the program runs")
}

#[test]
fn help_prints_the_usage() {
    for (program, name) in [
        (env!("CARGO_BIN_EXE_renode-rig"), "usage: renode-rig"),
        (env!("CARGO_BIN_EXE_agree"), "usage: agree"),
    ] {
        for argument in ["--help", "-h"] {
            let output = run(program, argument);
            let text = String::from_utf8_lossy(&output.stdout);
            assert_eq!(output.status.code(), Some(0), "{output:?}");
            assert!(text.contains(name), "{text}");
        }
        let output = run(program, "--no-such-option");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(
            text.contains("--no-such-option") && text.contains(name),
            "{text}"
        );
    }
}
