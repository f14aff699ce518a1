//! The verdict in one or two sentences.

use super::words::joined;
use super::{Report, Verdict};
use crate::effects::EffectKind;
use crate::format::num;

impl Report {
    /// The verdict in one or two sentences, with the errors before and after.
    pub fn summary(&self) -> String {
        let u = &self.unit;
        let (b, f) = (num(self.baseline.heldout_rmse), num(self.last.heldout_rmse));
        let names: Vec<EffectKind> = self.effects.iter().map(|e| e.name).collect();
        let list = joined(&names, ", ");
        match self.verdict {
            Verdict::None => format!("Nothing material is missing: held-out RMSE {b} {u}."),
            Verdict::Effect | Verdict::Several => {
                format!("The model lacks {list}: held-out RMSE {b} -> {f} {u}.")
            }
            Verdict::NotIdentifiable => {
                let alternatives = self
                    .not_identifiable
                    .first()
                    .map(|a| joined(&a.effects, " or "))
                    .unwrap_or_default();
                format!("The model lacks {alternatives}; these data cannot distinguish them: held-out RMSE {b} -> {f} {u}.")
            }
            Verdict::Unknown => {
                let on = self.structure.first().map_or("", |s| &s.depends_on);
                let part = match names.len() {
                    0 => String::new(),
                    1 => format!(" The effect {list} describes only part of it."),
                    _ => format!(" The effects {list} describe only part of it."),
                };
                format!("Structure remains that no effect of the catalogue explains: {on}.{part} Held-out RMSE {b} -> {f} {u}.")
            }
        }
    }
}
