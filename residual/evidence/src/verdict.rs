//! The verdict: a pure function of what the analysis found.

use serde::{Deserialize, Serialize};

/// The answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// One effect of the catalogue explains what the model lacks.
    Effect,
    /// Several effects of the catalogue together explain it.
    Several,
    /// Nothing material is missing.
    None,
    /// Structure remains that no effect of the catalogue explains.
    Unknown,
    /// Several effects explain it equally well, and these data cannot distinguish them.
    NotIdentifiable,
}

impl Verdict {
    /// The word in `report.json`.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Effect => "effect",
            Verdict::Several => "several",
            Verdict::None => "none",
            Verdict::Unknown => "unknown",
            Verdict::NotIdentifiable => "not_identifiable",
        }
    }
}

/// What the verdict depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Conditions {
    /// Number of effects named.
    pub effects: usize,
    /// Whether structure without a name is left that is large beside what was named.
    pub unexplained: bool,
    /// Whether the search was not allowed to look further, with structure left that another effect
    /// would fit.
    pub limited: bool,
    /// Whether the data cannot distinguish the strongest effect from another.
    pub ambiguous: bool,
}

/// The verdict. Unexplained structure has priority, because it makes every named effect doubtful.
pub fn verdict(c: Conditions) -> Verdict {
    match c {
        Conditions {
            unexplained: true, ..
        } => Verdict::Unknown,
        // Something is missing, and it was not allowed to be named.
        Conditions {
            effects: 0,
            limited: true,
            ..
        } => Verdict::Unknown,
        Conditions { effects: 0, .. } => Verdict::None,
        Conditions {
            ambiguous: true, ..
        } => Verdict::NotIdentifiable,
        Conditions { effects: 1, .. } => Verdict::Effect,
        Conditions { .. } => Verdict::Several,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_condition_has_its_verdict() {
        use Verdict::{Effect, None, NotIdentifiable, Several, Unknown};
        // effects, unexplained, ambiguous, limited
        let table = [
            (0, false, false, false, None),
            (0, false, true, false, None),
            (0, true, false, false, Unknown),
            (0, true, true, false, Unknown),
            (0, false, false, true, Unknown),
            (0, true, false, true, Unknown),
            (1, false, false, false, Effect),
            (1, false, false, true, Effect),
            (1, false, true, false, NotIdentifiable),
            (1, true, false, false, Unknown),
            (1, true, true, false, Unknown),
            (2, false, false, false, Several),
            (2, false, false, true, Several),
            (2, false, true, false, NotIdentifiable),
            (2, true, false, false, Unknown),
            (2, true, true, true, Unknown),
            (6, false, false, false, Several),
            (6, false, true, false, NotIdentifiable),
            (6, true, false, false, Unknown),
            (6, true, true, false, Unknown),
        ];
        for (effects, unexplained, ambiguous, limited, want) in table {
            let c = Conditions {
                effects,
                unexplained,
                limited,
                ambiguous,
            };
            assert_eq!(verdict(c), want, "{c:?}");
        }
    }
}
