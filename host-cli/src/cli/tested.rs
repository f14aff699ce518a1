//! Whether a rig is the one that its bring-up has tested: the one check of every command that
//! drives or calibrates it.

use super::exit::{Failure, Result};
use super::Context;
use bring_up::record::{self, Identity};
use known::store::Store;
use rig::Rig;

/// What has changed since the bring-up of a rig.
#[derive(Default)]
struct Changes {
    /// Parts that were exchanged, in words; empty: none.
    parts: String,
    /// Settings that were changed, in words; empty: none.
    settings: String,
    /// Number of the board that was tested, where it is known.
    board: Option<String>,
}

/// What has changed since the bring-up of a rig. `board`: the number of its board now, where it is
/// known already.
fn changes(rig: &Rig, seed: Option<u64>, board: Option<String>) -> Result<Changes> {
    let store = Store::of_rig(&rig.name, seed)?;
    let Some(record) = record::read(&store)? else {
        return Ok(Changes::default());
    };
    let changes = record.identity.changed(&Identity::of(rig, &store, board)?);
    let words = |is_part| {
        let of = changes.iter().filter(|change| change.is_part == is_part);
        of.map(|change| change.words.as_str())
            .collect::<Vec<_>>()
            .join("; ")
    };
    Ok(Changes {
        parts: words(true),
        settings: words(false),
        board: Some(record.identity.board).filter(|number| !number.is_empty()),
    })
}

/// Refuses a rig of which a part was exchanged since its bring-up; warns where its rig file has
/// changed. A rig without a bring-up passes. `rig`: as its file has it, without a calibration.
/// `seed`: that of an emulated rig. `board`: the number of its board, where it is known already.
/// The number of the board that was tested: who opens a link has to find it there.
pub fn require(
    rig: &Rig,
    seed: Option<u64>,
    board: Option<String>,
    context: &Context,
) -> Result<Option<String>> {
    let changes = changes(rig, seed, board)?;
    if !changes.parts.is_empty() {
        return Err(Failure::usage(format!(
            "since the bring-up of this rig {}: its wiring is not what was tested; run `forcectl bring-up` again; nothing was driven",
            changes.parts
        )));
    }
    warn_of(&changes.settings, context);
    Ok(changes.board)
}

/// The same as a warning only, for a command that drives nothing and stores nothing about the rig.
pub fn warn(rig: &Rig, seed: Option<u64>, board: Option<String>, context: &Context) -> Result<()> {
    let changes = changes(rig, seed, board)?;
    warn_of(&changes.parts, context);
    warn_of(&changes.settings, context);
    Ok(())
}

fn warn_of(words: &str, context: &Context) {
    if !words.is_empty() {
        context.output.note(&format!(
            "since the bring-up of this rig {words}; `forcectl bring-up` tests it again"
        ));
    }
}
