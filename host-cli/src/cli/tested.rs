//! Whether a rig is the one that its bring-up has tested: the one check of every command that
//! drives or calibrates it.

use super::exit::{Failure, Result};
use super::Context;
use bring_up::record::{self, Identity};
use known::store::Store;
use rig::Rig;

/// What has changed since the bring-up of a rig, in words: parts, and settings. Empty: nothing, or
/// there was none.
fn changes(rig: &Rig, seed: Option<u64>, board: Option<String>) -> Result<(String, String)> {
    let store = Store::of_rig(&rig.name, seed)?;
    let Some(record) = record::read(&store)? else {
        return Ok(Default::default());
    };
    let changes = record.identity.changed(&Identity::of(rig, &store, board)?);
    let words = |is_part| {
        let of = changes.iter().filter(|change| change.is_part == is_part);
        of.map(|change| change.words.as_str())
            .collect::<Vec<_>>()
            .join("; ")
    };
    Ok((words(true), words(false)))
}

/// Refuses a rig of which a part was exchanged since its bring-up; warns where its rig file has
/// changed. A rig without a bring-up passes. `rig`: as its file has it, without a calibration.
/// `seed`: that of an emulated rig. `board`: its serial number.
pub fn require(
    rig: &Rig,
    seed: Option<u64>,
    board: Option<String>,
    context: &Context,
) -> Result<()> {
    let (parts, settings) = changes(rig, seed, board)?;
    if !parts.is_empty() {
        return Err(Failure::usage(format!(
            "since the bring-up of this rig {parts}: its wiring is not what was tested; run `forcectl bring-up` again; nothing was driven"
        )));
    }
    warn_of(&settings, context);
    Ok(())
}

/// The same as a warning only, for a command that drives nothing and stores nothing about the rig.
pub fn warn(rig: &Rig, seed: Option<u64>, board: Option<String>, context: &Context) -> Result<()> {
    let (parts, settings) = changes(rig, seed, board)?;
    warn_of(&parts, context);
    warn_of(&settings, context);
    Ok(())
}

fn warn_of(words: &str, context: &Context) {
    if !words.is_empty() {
        context.output.note(&format!(
            "since the bring-up of this rig {words}; `forcectl bring-up` tests it again"
        ));
    }
}
