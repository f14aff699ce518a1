//! `--help` prints the usage; a wrong option is refused with it.

use std::process::{Command, Output};

fn run(argument: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_residual-bench"))
        .arg(argument)
        .output()
        .expect("the program runs")
}

#[test]
fn help_prints_the_usage() {
    for argument in ["--help", "-h"] {
        let output = run(argument);
        let text = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert!(text.contains("Usage: cargo xtask residual-bench"), "{text}");
    }
    let output = run("--no-such-option");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(
        text.contains("--no-such-option") && text.contains("Usage: "),
        "{text}"
    );
}
