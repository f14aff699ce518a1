//! The tutorial docs/estimation-day.md: every command of the page, in its order, and the figures
//! that the page says they print.

#![cfg(feature = "estimate")]

mod common;
#[path = "common/page.rs"]
mod page;

use common::{folder, forcectl, said};
use page::steps;
use std::path::Path;

const DOCS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs");

fn text() -> String {
    std::fs::read_to_string(Path::new(DOCS).join("estimation-day.md")).expect("the page is there")
}

/// Part of a figure by which it may differ from the page. The simulation is the same on every
/// computer; the least squares of the training sum with or without fused multiplication.
const PART: f64 = 0.005;

/// Whether two words are the same, or the same number but for what another computer does to it.
fn alike(word: &str, other: &str) -> bool {
    let number = |word: &str| {
        let digits = word.trim_end_matches([',', ';', ':', 's']);
        let places = digits.split_once('.').map_or(0, |(_, after)| after.len());
        digits.parse::<f64>().ok().map(|value| (value, places))
    };
    match (number(word), number(other)) {
        (Some((value, places)), Some((found, of))) => {
            let last = 10.0_f64.powi(-(places as i32));
            places == of && (value - found).abs() <= PART * value.abs() + 2.0 * last
        }
        _ => word == other,
    }
}

/// Whether a line is the one of the page, which may end before it.
fn is_line(of_page: &str, line: &str) -> bool {
    let (of_page, line): (Vec<_>, Vec<_>) = (
        of_page.split_whitespace().collect(),
        line.split_whitespace().collect(),
    );
    let ends =
        of_page.last().is_some_and(|word| word.ends_with(':')) || of_page.len() == line.len();
    ends && of_page.len() <= line.len() && of_page.iter().zip(&line).all(|(a, b)| alike(a, b))
}

#[test]
#[cfg(unix)]
fn every_command_of_the_estimation_day_prints_what_the_page_says() {
    let temporary = folder();
    let folder = temporary.path();
    std::os::unix::fs::symlink(DOCS, folder.join("docs")).unwrap();
    let (mut lines, mut recalibrated) = (0, 0);
    for step in steps(&text()) {
        let line = step.words.join(" ");
        let words: Vec<&str> = step.words.iter().map(String::as_str).collect();
        let said = said(&forcectl(folder, &words).output().expect("forcectl runs"));
        assert!(
            said.code.is_some_and(|code| step.codes.contains(&code)),
            "{line}: {said:?}"
        );
        // The page says that no line of the alarm is left after the recalibration.
        if words.contains(&"estimation-day/today.model") && !words.contains(&"recalibrate") {
            recalibrated += 1;
            let all = format!("{}{}", said.out, said.err);
            assert!(!all.contains("no longer fits"), "{line}: {all}");
        }
        // The alarm is a note on standard error; what stands beside it is the result.
        let (notes, results): (Vec<&String>, Vec<&String>) =
            (step.prints.iter()).partition(|wanted| wanted.trim_end().ends_with(':'));
        for (wanted, printed) in [(notes, &said.err), (results, &said.out)] {
            let mut printed_lines = printed.lines();
            for wanted in wanted {
                lines += 1;
                assert!(
                    printed_lines.any(|line| is_line(wanted, line)),
                    "{line}: no `{wanted}`, in this order, in: {printed}"
                );
            }
        }
    }
    assert!(lines >= 30, "{lines}");
    assert_eq!(recalibrated, 2);
    // The files that the page names are there.
    let page = text();
    let mut files = 0;
    for word in page.split('`').filter(|w| w.starts_with("estimation-day/")) {
        if !word.contains(char::is_whitespace) {
            files += 1;
            assert!(folder.join(word).exists(), "{word}");
        }
    }
    assert!(files >= 7, "{files}");
}

#[test]
fn the_page_goes_through_the_whole_day() {
    let steps = steps(&text());
    let calls: Vec<String> = steps.iter().map(|s| s.words[..2].join(" ")).collect();
    for name in [
        "experiment check",
        "experiment run",
        "estimate train",
        "estimate eval",
        "estimate run",
        "estimate recalibrate",
        "estimate explain",
    ] {
        assert!(
            calls.iter().any(|call| call == name),
            "the page never calls {name}"
        );
    }
    assert_eq!(calls.len(), 13);
}

#[test]
fn figures_of_the_page_may_differ_a_little_and_words_not_at_all() {
    let line = "MAE            0.872 +- 1.150 N (95 % over trials)";
    assert!(is_line(line, "MAE 0.876 +- 1.145 N (95 % over trials)"));
    for other in [
        "MAE 0.890 +- 1.150 N (95 % over trials)",
        "MAE 0.87 +- 1.150 N (95 % over trials)",
        "RMSE 0.872 +- 1.150 N (95 % over trials)",
        "MAE 0.872 +- 1.150 N (95 % over trials) more",
        "MAE 0.872 +- 1.150 N",
    ] {
        assert!(!is_line(line, other), "{other}");
    }
    assert!(is_line(
        "33.0 s: this model:",
        "33.1 s: this model: the motors"
    ));
}
