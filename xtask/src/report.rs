//! What xtask says: progress on standard error, and failures with what to do next.
//!
//! Standard output stays free for results (the size table, `forcectl --json`), so that both can be
//! piped.

use std::fmt;
use std::time::Duration;

/// Prints one progress line on standard error.
pub fn say(line: impl fmt::Display) {
    eprintln!("xtask: {line}");
}

/// A step that could not be done: what happened, and what the reader can do about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    what: String,
    remedy: Option<String>,
}

/// Result of anything xtask does.
pub type Result<T> = std::result::Result<T, Failure>;

impl Failure {
    /// A failure whose message already says everything.
    pub fn new(what: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            remedy: None,
        }
    }

    /// Adds what the reader can do. Several lines are fine.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)?;
        if let Some(remedy) = &self.remedy {
            f.write_str("\nWhat to do:")?;
            for line in remedy.lines() {
                write!(f, "\n  {line}")?;
            }
        }
        Ok(())
    }
}

/// A duration as people say it: `0.4 s`, `12 s`, `3 min 05 s`.
pub fn elapsed(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match seconds {
        0..=9 => format!("{:.1} s", duration.as_secs_f64()),
        10..=99 => format!("{seconds} s"),
        _ => format!("{} min {:02} s", seconds / 60, seconds % 60),
    }
}

/// An integer with thousands separators: `2,097,152`.
pub fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1_000), "1,000");
        assert_eq!(grouped(2_097_152), "2,097,152");
    }

    #[test]
    fn durations_read_naturally() {
        assert_eq!(elapsed(Duration::from_millis(420)), "0.4 s");
        assert_eq!(elapsed(Duration::from_secs(12)), "12 s");
        assert_eq!(elapsed(Duration::from_secs(185)), "3 min 05 s");
    }

    #[test]
    fn a_failure_shows_its_remedy_below() {
        let failure = Failure::new("no probe").remedy("plug it in\ntry again");
        assert_eq!(
            failure.to_string(),
            "no probe\nWhat to do:\n  plug it in\n  try again"
        );
        assert_eq!(Failure::new("plain").to_string(), "plain");
    }
}
