//! What a board can compensate of a report: friction, gain, offset, ripple, delay.

use crate::{Ambiguity, Report};
use residual_effects::{effect, EffectKind, Found, Remedy};
use residual_evidence::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// A ripple over the angle, as found: target above prediction by
/// `amplitude * sin(order * angle + phase)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ripple {
    /// Order per turn of the angle.
    pub order: f64,
    /// Amplitude, in the target's unit (or as a share of the load).
    pub amplitude: f64,
    /// Phase, rad.
    pub phase: f64,
    /// Whether the amplitude is a share of the load.
    pub of_load: bool,
}

/// By how much the target lies above the declared prediction, in the forms that a board can
/// compensate. What it must *add to its command* is the negative of each force. Forces are in the
/// target's unit; absent effects are 0.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// Coefficient of the sign of the velocity at zero load.
    pub friction: f64,
    /// Coefficient of the sign of the velocity per unit of load.
    pub friction_per_load: f64,
    /// Coefficient of the velocity, per unit of the velocity column.
    pub viscous: f64,
    /// Relative error of the declared gain.
    pub gain_error: f64,
    /// Constant.
    pub offset: f64,
    /// Delay between command and target, lags included, s.
    pub delay_s: f64,
    /// Ripples over the angle.
    pub ripples: Vec<Ripple>,
    /// Names of the effects found that a board cannot compensate with these.
    pub left_out: Vec<String>,
}

impl Compensation {
    /// Adds one part.
    fn add(&mut self, part: Remedy) {
        match part {
            Remedy::Friction(x) => self.friction += x,
            Remedy::FrictionPerLoad(x) => self.friction_per_load += x,
            Remedy::Viscous(x) => self.viscous += x,
            Remedy::Gain(x) => self.gain_error += x,
            Remedy::Offset(x) => self.offset += x,
            Remedy::Delay(x) => self.delay_s += x,
            Remedy::Ripple {
                order,
                amplitude,
                phase,
                of_load,
            } => self.ripples.push(Ripple {
                order,
                amplitude,
                phase,
                of_load,
            }),
        }
    }

    /// Whether there is nothing that a board can compensate.
    fn is_empty(&self) -> bool {
        *self
            == Compensation {
                left_out: self.left_out.clone(),
                ..Compensation::default()
            }
    }
}

/// Whether a board compensates all these effects by the same setting, so that it does not matter
/// which of them it is.
fn same_setting(effects: &[EffectKind], others: &[EffectKind]) -> bool {
    let all = effects.iter().chain(others);
    let mut settings = all.map(|kind| effect(*kind).setting());
    match settings.next().flatten() {
        Some(first) => settings.all(|s| s == Some(first)),
        None => false,
    }
}

impl Report {
    /// What a board can compensate. `None` if nothing was found, or if the verdict does not support
    /// a change of the board: `unknown`, and `not_identifiable` unless a board compensates all
    /// effects that cannot be told apart by the same setting (dry friction with or without load,
    /// delay or lag). `None` also where further courses of the search predict as well and their
    /// names were not judged ([`Report::paths_not_judged`]).
    ///
    /// It is computed from kinds, forms and parameters; no label or sentence of the report counts.
    /// The example of `residual::analyse` shows it.
    pub fn compensation(&self) -> Option<Compensation> {
        // What predicts as well and was not judged may lead to another setting.
        if self.paths_not_judged > 0 {
            return None;
        }
        match self.verdict {
            Verdict::Effect | Verdict::Several => {}
            Verdict::NotIdentifiable
                if self
                    .not_identifiable
                    .iter()
                    .all(|a| same_setting(&a.effects, &[])) => {}
            _ => return None,
        }
        let mut out = Compensation::default();
        for e in &self.effects {
            let found = Found {
                form: e.form_kind,
                get: &|name| e.params.get(name).copied().unwrap_or(0.0),
            };
            let parts = effect(e.name).remedies(&found);
            // One of several effects may be doubtful where the first is clear.
            let own = |a: &&Ambiguity| a.effects.first() == Some(&e.name);
            let doubtful = self.not_identifiable.iter().filter(own);
            let either = self.equal_paths.iter();
            let other = either
                .filter(|p| p.effects.contains(&e.name) && !same_setting(&p.effects, &p.instead));
            let certain = doubtful
                .map(|a| &a.effects[..])
                .all(|all| same_setting(all, &[]));
            let parts = match certain && other.count() == 0 {
                true => parts,
                false => vec![],
            };
            if parts.is_empty() {
                out.left_out.push(e.name.to_string());
            }
            parts.into_iter().for_each(|part| out.add(part));
        }
        (!out.is_empty()).then_some(out)
    }
}
