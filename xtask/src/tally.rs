//! Counts test results in what `cargo test` and pytest print.

use std::fmt;
use std::ops::AddAssign;

/// Tests counted so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Tests that passed.
    pub passed: u64,
    /// Tests that failed, and steps that failed as a whole.
    pub failed: u64,
    /// Tests that were switched off.
    pub ignored: u64,
}

impl Tally {
    /// Reads the closing line of a run: pytest's, or libtest's, such as
    /// `test result: ok. 3 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; ...`.
    pub fn from_line(line: &str) -> Option<Self> {
        Self::from_libtest(line).or_else(|| Self::from_pytest(line))
    }

    /// Reads pytest's closing line, such as
    /// `==== 2 failed, 31 passed, 1 skipped, 1 error in 4.56s ====`.
    fn from_pytest(line: &str) -> Option<Self> {
        let line = line.trim().strip_prefix("==")?.trim_matches(['=', ' ']);
        let (counts, time) = line.rsplit_once(" in ")?;
        time.split('s').next()?.parse::<f64>().ok()?;
        let mut tally = Self::default();
        for count in counts.split(", ") {
            let (number, kind) = count.split_once(' ')?;
            let number: u64 = number.parse().ok()?;
            match kind {
                "passed" => tally.passed += number,
                "failed" | "error" | "errors" => tally.failed += number,
                "skipped" => tally.ignored += number,
                _ => {}
            }
        }
        Some(tally)
    }

    /// Reads libtest's.
    fn from_libtest(line: &str) -> Option<Self> {
        let counts = line.trim().strip_prefix("test result: ")?;
        let (_verdict, counts) = counts.split_once(". ")?;
        let mut tally = Self::default();
        for count in counts.split(';') {
            let mut words = count.split_whitespace();
            let (Some(number), Some(kind)) = (words.next(), words.next()) else {
                continue;
            };
            let field = match kind {
                "passed" => &mut tally.passed,
                "failed" => &mut tally.failed,
                "ignored" => &mut tally.ignored,
                _ => continue,
            };
            *field = number.parse().ok()?;
        }
        Some(tally)
    }
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed += other.failed;
        self.ignored += other.ignored;
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed", self.passed, self.failed)
    }
}

/// Whether a line of `cargo test` is worth a person's attention: not one of the many that only say
/// that a test passed.
pub fn is_news(line: &str) -> bool {
    let line = line.trim();
    let passed = line.starts_with("test ") && line.ends_with("... ok");
    let opening =
        line.starts_with("running ") && (line.ends_with(" tests") || line.ends_with(" test"));
    let nothing = line.starts_with("test result: ok. 0 passed");
    // Of tests of documentation, which are run quietly.
    let dots = line.trim_matches('.').is_empty();
    !(dots || passed || opening || nothing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_lines_are_read() {
        let line = "test result: ok. 31 passed; 0 failed; 2 ignored; 0 measured; 4 filtered out; \
                    finished in 0.18s";
        assert_eq!(
            Tally::from_line(line),
            Some(Tally {
                passed: 31,
                failed: 0,
                ignored: 2
            })
        );
        let line = "test result: FAILED. 1 passed; 7 failed; 0 ignored; 0 measured; 0 filtered out";
        assert_eq!(
            Tally::from_line(line),
            Some(Tally {
                passed: 1,
                failed: 7,
                ignored: 0
            })
        );
    }

    #[test]
    fn closing_lines_of_pytest_are_read() {
        let tally = |passed, failed, ignored| {
            Some(Tally {
                passed,
                failed,
                ignored,
            })
        };
        for (line, expected) in [
            ("====== 31 passed in 0.12s ======", tally(31, 0, 0)),
            (
                "=== 2 failed, 31 passed, 1 skipped, 3 warnings, 4 errors in 75.30s (0:01:15) ===",
                tally(31, 6, 1),
            ),
            ("== 1 error in 0.10s ==", tally(0, 1, 0)),
            ("============ short test summary info ============", None),
            ("===== test session starts =====", None),
        ] {
            assert_eq!(Tally::from_line(line), expected, "{line}");
        }
    }

    #[test]
    fn other_lines_count_nothing() {
        for line in [
            "",
            "test result",
            "test result: ok.",
            "test result: ok. many passed",
            "test unit::zero ... ok",
            "3 passed; 0 failed",
        ] {
            assert_eq!(Tally::from_line(line), None, "{line}");
        }
    }

    #[test]
    fn results_add_up() {
        let mut sum = Tally::default();
        for line in [
            "test result: ok. 2 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out",
            "test result: FAILED. 3 passed; 1 failed; 1 ignored; 0 measured; 0 filtered out",
        ] {
            if let Some(tally) = Tally::from_line(line) {
                sum += tally;
            }
        }
        assert_eq!(sum.to_string(), "5 passed, 1 failed");
    }

    #[test]
    fn only_passed_tests_are_dull() {
        assert!(!is_news("test unit::zero ... ok"));
        assert!(!is_news("running 12 tests"));
        assert!(!is_news("running 1 test"));
        assert!(!is_news("") && !is_news("....."));
        assert!(!is_news("test result: ok. 0 passed; 0 failed"));
        assert!(is_news("test unit::zero ... FAILED"));
        assert!(is_news("test result: ok. 12 passed; 0 failed"));
        assert!(is_news("thread 'unit::zero' panicked at src/lib.rs:1:1:"));
    }
}
