//! Whether a rig is the one that its bring-up has tested: the one check of everything that drives a
//! rig or stores something about it, in the commands and in the service.
//!
//! What only takes force away asks nobody: `stop`, `disarm`, and `clear`, after which every motor
//! stands at 0 V until the rig is armed. A bring-up with new parts begins with a clear, too.

use crate::record::{self, Again, Identity};
use crate::steps::Test;
use known::store::Store;
use known::Result;
use rig::Rig;

/// What has changed since the bring-up of a rig.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Changes {
    /// Parts that were exchanged, and settings that a test judges by, in words.
    pub tested: Vec<String>,
    /// What else was changed, in words.
    pub other: Vec<String>,
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
        let (other, tested): (Vec<_>, Vec<_>) = (record.identity.changed(&now).into_iter())
            .partition(|change| change.again == Again::Nothing);
        let words = |changes: Vec<record::Change>| changes.into_iter().map(|change| change.words);
        Ok(Self {
            tested: (record.owed.parts.iter().cloned())
                .chain(words(tested))
                .collect(),
            other: words(other).collect(),
            open: record.owed.tests.keys().copied().collect(),
            board: Some(record.identity.board).filter(|number| !number.is_empty()),
        })
    }

    /// Why the rig is not driven; `None`: it is.
    #[must_use]
    pub fn refusal(&self) -> Option<String> {
        if self.tested.is_empty() {
            return None;
        }
        let names: Vec<_> = self.open.iter().map(|test| format!("`{test}`")).collect();
        let begun = if names.is_empty() {
            String::new()
        } else {
            format!(" (it was begun; {} is open)", names.join(", "))
        };
        Some(format!(
            "since the bring-up of this rig {}: that is not what was tested; run `forcectl bring-up` again{begun}; nothing was driven",
            self.tested.join("; "),
        ))
    }

    /// What a rig that is driven all the same should be told of; `None`: nothing.
    #[must_use]
    pub fn notice(&self) -> Option<String> {
        let words: Vec<_> = self.tested.iter().chain(&self.other).cloned().collect();
        let rest = if self.tested.is_empty() {
            "no test judges by that"
        } else {
            "`forcectl bring-up` tests it again"
        };
        (!words.is_empty()).then(|| {
            let words = words.join("; ");
            format!("since the bring-up of this rig {words}; {rest}")
        })
    }
}
