//! The verdict in one or two sentences.

use super::words::joined;
use super::{Figures, Report, Verdict};
use crate::effects::EffectKind;
use crate::format::num;

/// Correlation of the residual with itself from which the verdict names it.
const COLOURED: f64 = 0.1;

impl Report {
    /// The verdict in some sentences, with the errors before and after.
    pub fn summary(&self) -> String {
        format!(
            "{}{}{}{}",
            self.answer(),
            self.beside(),
            self.ended(),
            self.checked()
        )
    }

    /// Whether the model with all effects of the first search predicts better than that with the effects found. Without a wrong
    /// name the search may come to a better model.
    pub(super) fn all_is_better(&self) -> bool {
        let better = |all: &Figures| all.heldout_rmse < self.last.heldout_rmse;
        self.with_all.as_ref().is_some_and(better)
    }

    /// What improves the fit under a name that the data do not support.
    fn beside(&self) -> String {
        let Some(all) = &self.with_all else {
            return String::new();
        };
        let names: Vec<EffectKind> = self.improves.iter().map(|e| e.name).collect();
        if !self.all_is_better() {
            return format!(
                " The data do not support the name of what was found at first: {}.",
                joined(&names, ", ")
            );
        }
        let which = match names.len() {
            1 => "One further effect improves",
            _ => "Further effects improve",
        };
        format!(
            " {which} the fit (to {} {}), but the data do not support the name: {}.",
            num(all.heldout_rmse),
            self.unit,
            joined(&names, ", ")
        )
    }

    /// That the search ended before its end.
    fn ended(&self) -> String {
        let told = self.verdict == Verdict::Unknown && self.effects.is_empty();
        self.limited
            .filter(|_| !told)
            .map_or(String::new(), |next| {
                format!(
                " The search ended at max_effects = {} with structure left that {next} would fit.",
                self.extended.selection.max_effects
            )
            })
    }

    /// What came out on the check data.
    fn checked(&self) -> String {
        self.check.as_ref().map_or(String::new(), |check| {
            let repeats = if check.repeats() {
                ", on the motion of the searched data"
            } else {
                ""
            };
            format!(
                " On the check data: RMSE {} -> {} {}{repeats}.",
                num(check.declared_rmse),
                num(check.found_rmse),
                self.unit
            )
        })
    }

    /// That what is left is not white, where its test says so.
    fn coloured(&self) -> String {
        let test = self
            .residual_tests
            .iter()
            .find(|t| t.model == "after" && t.test.against == "itself");
        match test {
            Some(t) if t.test.p < 0.01 && t.test.correlation.abs() > COLOURED => format!(
                " What is left is not white: its correlation with itself is {:.2} at {} row(s), as that of a filtered sensor \
                 or of a slow disturbance that these columns do not show.",
                t.test.correlation, t.test.lag
            ),
            _ => String::new(),
        }
    }

    /// The verdict in one or two sentences.
    fn answer(&self) -> String {
        let u = &self.unit;
        let (b, f) = (num(self.baseline.heldout_rmse), num(self.last.heldout_rmse));
        let names: Vec<EffectKind> = self.effects.iter().map(|e| e.name).collect();
        let list = joined(&names, ", ");
        match self.verdict {
            Verdict::None => format!(
                "Nothing material is missing: held-out RMSE {b} {u}.{}",
                self.coloured()
            ),
            Verdict::Effect | Verdict::Several => {
                format!("The model lacks {list}: held-out RMSE {b} -> {f} {u}.")
            }
            Verdict::NotIdentifiable => {
                let alternatives = self
                    .not_identifiable
                    .first()
                    .map(|a| a.effects.as_slice())
                    .unwrap_or_default();
                // Each of the others, with what it cannot be told from either.
                let others: Vec<String> = names
                    .into_iter()
                    .filter(|n| !alternatives.contains(n))
                    .map(|n| {
                        let group = self.not_identifiable.iter().skip(1);
                        let own = group.map(|a| &a.effects).find(|all| all.contains(&n));
                        own.map_or(n.to_string(), |all| joined(all, " or "))
                    })
                    .collect();
                let also = match others.len() {
                    0 => String::new(),
                    _ => format!(" It also lacks {}.", others.join(", ")),
                };
                let either = joined(alternatives, " or ");
                format!("The model lacks {either}; these data cannot distinguish them: held-out RMSE {b} -> {f} {u}.{also}")
            }
            Verdict::Unknown if self.limited.is_some() && names.is_empty() => format!(
                "Structure remains, and the search was not allowed to look further (max_effects = {}): {} would fit it. \
                 Held-out RMSE {b} {u}.",
                self.extended.selection.max_effects,
                joined(&self.limited.into_iter().collect::<Vec<_>>(), "")
            ),
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
