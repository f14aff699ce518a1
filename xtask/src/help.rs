//! What `cargo xtask help` and `cargo xtask COMMAND --help` print. One table for both.

use std::ffi::OsString;
use std::fmt::Write as _;

/// A command of xtask.
pub struct Entry {
    /// Name.
    pub name: &'static str,
    /// What follows the name.
    arguments: &'static str,
    /// One line.
    summary: &'static str,
    /// The rest of the command's own page: its options, one per line.
    page: &'static str,
}

/// The page of a command whose program has a help of its own.
const OF_PROGRAM: &str =
    "`--help` behind the command prints the options; the program is built for it.\n";

/// Every command, in the order of the list.
pub const ENTRIES: &[Entry] = &[
    Entry {
        name: "setup",
        arguments: "[OPTIONS]",
        summary: "find or set up the compiler for the board, and print each step",
        page: "  --toolchain T  auto (default), rustup or debian; also FORCE_ARM_TOOLCHAIN\n  --retry        try again what failed before\n",
    },
    Entry {
        name: "build",
        arguments: "",
        summary: "build the firmware image and report its size",
        page: "",
    },
    Entry {
        name: "size",
        arguments: "",
        summary: "the same as build",
        page: "",
    },
    Entry {
        name: "inspect",
        arguments: "",
        summary: "check the image's machine code: no panic behind the sample path, stack large enough",
        page: "",
    },
    Entry {
        name: "build-rig",
        arguments: "",
        summary: "build the embedded rig and forcectl",
        page: "",
    },
    Entry {
        name: "install",
        arguments: "[OPTIONS]",
        summary: "build forcectl and install it with manual pages and completions",
        page: "  --prefix DIR  install below this folder (default ~/.local)\n",
    },
    Entry {
        name: "flash",
        arguments: "[OPTIONS]",
        summary: "build the firmware and write it to a board with probe-rs",
        page: "  --run          stay attached and print the firmware's log\n  --under-reset  hold the chip in reset while attaching\n",
    },
    Entry {
        name: "forcectl",
        arguments: "ARGS...",
        summary: "build what the call needs, then run forcectl (also: cargo forcectl ARGS...)",
        page: OF_PROGRAM,
    },
    Entry {
        name: "test",
        arguments: "[OPTIONS] [STEP...]",
        summary: "run every check, or the named steps; the last line is `N passed, N failed`",
        page: "  --verbose  print every line of the tests\n  --list     list the steps\n",
    },
    Entry {
        name: "ci",
        arguments: "[OPTIONS] [STEP...]",
        summary: "the same as test",
        page: "  --verbose  print every line of the tests\n  --list     list the steps\n",
    },
    Entry {
        name: "renode-test",
        arguments: "[OPTIONS] [SUITE...]",
        summary: "run the same image on Renode with the suites in renode/suites",
        page: "  --install  fetch Renode's portable package first\n\nOther options go to Renode's program renode-test.\n",
    },
    Entry {
        name: "mutants",
        arguments: "[--renode] [NAME...]",
        summary: "change one place of the firmware at a time and run the test that must find it",
        page: "Runs the tests on the embedded rig; a test that passes lets its mutant live.\n\n  --renode  the mutants whose test is a suite of Renode\n",
    },
    Entry {
        name: "agree",
        arguments: "[OPTIONS]",
        summary: "run one scenario on the embedded rig and on Renode, and compare sample by sample",
        page: "  --seed N  seed of everything random (default 1)\n",
    },
    Entry {
        name: "bench",
        arguments: "[OPTIONS]",
        summary: "measure the figures into target/bench/figures.json",
        page: OF_PROGRAM,
    },
    Entry {
        name: "faults",
        arguments: "[OPTIONS] | --image [OPTIONS] | --mutants [NAME...]",
        summary: "inject thousands of faults into the firmware's core on the plant, and print what came of them",
        page: OF_PROGRAM,
    },
    Entry {
        name: "calibration-bench",
        arguments: "[OPTIONS]",
        summary: "calibrate made-up rigs whose truth is known, and print the errors",
        page: OF_PROGRAM,
    },
    Entry {
        name: "fuzz",
        arguments: "[OPTIONS]",
        summary: "feed damaged frames, rig files, model files, expressions and logs to what reads them",
        page: "  --cases N  cases of each test (default 20000; 300 in `cargo xtask test`)\n  --seed S   seed (default 1)\n  --minutes N  each test for N minutes, one seed after the other, and the number of its cases\n",
    },
    Entry {
        name: "residual-bench",
        arguments: "[OPTIONS]",
        summary: "run the residual analysis on synthetic logs with undeclared effects",
        page: OF_PROGRAM,
    },
    Entry {
        name: "closed-loop",
        arguments: "[OPTIONS]",
        summary: "find, declare and re-run one undeclared effect for each seed",
        page: OF_PROGRAM,
    },
    Entry {
        name: "experiment-report",
        arguments: "[OPTIONS]",
        summary: "run the default experiment whole and write its report and data card into target/experiment-report",
        page: "  --shards N  trials that run side by side (default 2)\n",
    },
    Entry {
        name: "residual-report",
        arguments: "[OPTIONS]",
        summary: "write what the residual analysis finds on the measured rig into docs/residual/rig.md",
        page: "  --data DIR      folder of the rig's data (default FORCE_DATA, ./data, ../shared/data)\n  --page PAGE.md  page whose marked blocks are filled (default docs/residual/rig.md)\n",
    },
    Entry {
        name: "residual-compare",
        arguments: "[OPTIONS]",
        summary: "run the same selection with public Python tools, in a Python environment of its own",
        page: "  --data DIR       folder of the rig's data (default FORCE_DATA, ./data, ../shared/data)\n  --runs N         report the least time of N runs (default 3)\n  --markdown FILE  write the table into this file\n",
    },
    Entry {
        name: "deny",
        arguments: "",
        summary: "run cargo-deny on the dependencies: licences, sources, duplicates (deny.toml)",
        page: "",
    },
    Entry {
        name: "msrv",
        arguments: "",
        summary: "compile every package of this computer with the oldest supported Rust",
        page: "",
    },
    Entry {
        name: "doc",
        arguments: "[OPTIONS]",
        summary: "build the reference documentation",
        page: "  --open  open it in a browser\n\nOther options go to cargo doc.\n",
    },
    Entry {
        name: "book",
        arguments: "[OPTIONS]",
        summary: "build the documents as a book with a search into target/book, with mdbook",
        page: "  --open  open it in a browser\n\nOther options go to mdbook build.\n",
    },
    Entry {
        name: "help",
        arguments: "[COMMAND]",
        summary: "print this list, or the help of a command",
        page: "",
    },
];

/// The list of all commands.
pub fn list() -> String {
    let mut text = "\
The developer's commands of the force rig.

Usage: cargo xtask COMMAND [OPTIONS]

Commands:
"
    .to_owned();
    for entry in ENTRIES {
        let _ = writeln!(text, "  {:<17} {}", entry.name, entry.summary);
    }
    text.push_str(
        "
`cargo xtask COMMAND --help` prints the options of a command.

Exit codes: 0 done, 1 failed, 2 wrong usage; those of forcectl and the evaluations are passed on.
More: docs/developing.md
",
    );
    text
}

/// The help of one command; `None` where there is no such command.
pub fn page(name: &str) -> Option<String> {
    let entry = ENTRIES.iter().find(|entry| entry.name == name)?;
    let mut summary = entry.summary.to_owned();
    if let Some(first) = summary.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    let usage = format!("Usage: cargo xtask {} {}", entry.name, entry.arguments);
    let mut text = format!("{summary}.\n\n{}\n", usage.trim_end());
    if !entry.page.is_empty() {
        let _ = write!(text, "\n{}", entry.page);
    }
    Some(text)
}

/// Whether `--help` behind a command is its program's.
pub fn is_of_program(name: &str) -> bool {
    (ENTRIES.iter()).any(|entry| entry.name == name && entry.page == OF_PROGRAM)
}

/// Whether a command's arguments ask for its help.
pub fn is_requested(arguments: &[OsString]) -> bool {
    arguments
        .iter()
        .take_while(|argument| *argument != "--")
        .any(|argument| argument == "-h" || argument == "--help")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_and_a_line() {
        let list = list();
        for entry in ENTRIES {
            let page = page(entry.name).unwrap();
            assert!(
                page.contains(&format!("Usage: cargo xtask {}", entry.name)),
                "{page}"
            );
            assert!(
                page.ends_with('\n') && list.contains(entry.summary),
                "{page}"
            );
        }
        assert_eq!(page("no-such-command"), None);
    }

    #[test]
    fn help_after_two_dashes_belongs_to_another_program() {
        let requested =
            |words: &[&str]| is_requested(&words.iter().map(OsString::from).collect::<Vec<_>>());
        assert!(requested(&["--quick", "--help"]) && requested(&["-h"]));
        assert!(!requested(&[]) && !requested(&["--", "--help"]) && !requested(&["--helpful"]));
    }
}
