//! Whether a rig is the one that its bring-up has tested ([`bring_up::gate`]), for commands.

use super::exit::{Failure, Result};
use super::Context;
use bring_up::gate::Changes;
use known::store::Store;
use rig::Rig;

/// What has changed since the bring-up of a rig. `board`: the number of its board now, where it is
/// known already.
fn changes(rig: &Rig, seed: Option<u64>, board: Option<String>) -> Result<Changes> {
    Ok(Changes::of(rig, &Store::of_rig(&rig.name, seed)?, board)?)
}

/// Refuses a rig of which a part was exchanged since its bring-up, or a setting that it judged by
/// was changed; warns where its rig file has other changes. A rig without a bring-up passes. `rig`:
/// as its file has it, without a calibration. `seed`: that of an emulated rig. `board`: the number
/// of its board, where it is known already. The number of the board that was tested: who opens a
/// link has to find it there.
pub fn require(
    rig: &Rig,
    seed: Option<u64>,
    board: Option<String>,
    context: &Context,
) -> Result<Option<String>> {
    let changes = changes(rig, seed, board)?;
    if let Some(why) = changes.refusal() {
        return Err(Failure::usage(why));
    }
    warn_of(&changes, context);
    Ok(changes.board)
}

/// The same as a warning only, for a command that drives nothing and stores nothing about the rig.
pub fn warn(rig: &Rig, seed: Option<u64>, board: Option<String>, context: &Context) -> Result<()> {
    warn_of(&changes(rig, seed, board)?, context);
    Ok(())
}

fn warn_of(changes: &Changes, context: &Context) {
    if let Some(words) = changes.notice() {
        context.output.note(&words);
    }
}
