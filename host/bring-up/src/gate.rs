//! Whether a rig is the one that its bring-up has tested: the one check of everything that drives a
//! rig or stores something about it, in the commands and in the service.

use crate::record::{self, Identity};
use crate::steps::Test;
use known::store::Store;
use known::Result;
use rig::Rig;

/// What has changed since the bring-up of a rig.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Changes {
    /// Parts that were exchanged, in words.
    pub parts: Vec<String>,
    /// Settings that were changed, in words.
    pub settings: Vec<String>,
    /// Tests that a bring-up with the new parts has still to do.
    pub open: Vec<Test>,
    /// Number of the board that was tested, where it is known.
    pub board: Option<String>,
}

impl Changes {
    /// Those of this rig; none without a bring-up. `rig`: as its file has it, without a
    /// calibration. `board`: the number of its board now, where it is known.
    ///
    /// # Errors
    /// The record or the calibration can't be read.
    pub fn of(rig: &Rig, store: &Store, board: Option<String>) -> Result<Self> {
        let Some(record) = record::read(store)? else {
            return Ok(Self::default());
        };
        let now = Identity::of(rig, store, board)?;
        let (parts, settings): (Vec<_>, Vec<_>) =
            (record.identity.changed(&now).into_iter()).partition(|change| change.is_part);
        let words = |changes: Vec<record::Change>| changes.into_iter().map(|change| change.words);
        Ok(Self {
            parts: (record.owed.parts.iter().cloned())
                .chain(words(parts))
                .collect(),
            settings: words(settings).collect(),
            open: record.owed.tests.keys().copied().collect(),
            board: Some(record.identity.board).filter(|number| !number.is_empty()),
        })
    }

    /// Why the rig is not driven; `None`: it is.
    #[must_use]
    pub fn refusal(&self) -> Option<String> {
        if self.parts.is_empty() {
            return None;
        }
        let names: Vec<_> = self.open.iter().map(|test| format!("`{test}`")).collect();
        let begun = if names.is_empty() {
            String::new()
        } else {
            format!(" (it was begun; {} is open)", names.join(", "))
        };
        Some(format!(
            "since the bring-up of this rig {}: its wiring is not what was tested; run `forcectl bring-up` again{begun}; nothing was driven",
            self.parts.join("; "),
        ))
    }
}
