//! The load with the coefficients of the model that was found.

use super::Search;
use crate::declared::load_expressions;
use crate::model::{Chosen, Fitted};
use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_columns::stats;
use residual_effects::{Build, EffectKind};
use std::sync::Arc;

/// Relative change of the load below which its old expression is kept.
const SAME: f64 = 0.003;

/// Whether a form contains an expression of the load.
fn contains(c: &Chosen, load: &str) -> bool {
    format!("{:?}", (c.variant.build)(c.psi)).contains(load)
}

/// Whether an effect puts another command in the place of the declared one.
pub(super) fn replaces_command(c: &Chosen) -> bool {
    let build = (c.variant.build)(c.psi);
    matches!(build, Build::Swap(_) | Build::SwapAll(_))
}

/// Whether a gain of the load is among the effects. It acts on what the target follows, so where an
/// effect replaces the command its load is that behind the command. Both predict the same to first
/// order, with a delay that differs by the error of gain.
fn has_gain(chosen: &[Chosen], load: &str) -> bool {
    let is_gain = |c: &Chosen| c.effect.kind() == EffectKind::Gain && contains(c, load);
    chosen.iter().any(is_gain)
}

/// Another expression of the load, with the effects that depend on it.
pub(super) struct Renewed {
    load: String,
    /// Whether it is the load behind a command that an effect replaces.
    behind: bool,
    chosen: Vec<Chosen>,
}

impl Search<'_> {
    /// Expressions of the load with the coefficients that the declared terms have beside the
    /// effects; none if no effect depends on it, or it is the same.
    ///
    /// The first load has the coefficients of the declared model alone. What the model lacks biases
    /// them: a limit of the command makes a gain too small, and a friction per load would be too
    /// large by as much. Where an effect replaces the command, the data decide whether the load is
    /// the one before or behind it.
    pub(super) fn renewed(
        &mut self,
        fitted: &Fitted,
        chosen: &[Chosen],
    ) -> Result<Vec<Renewed>, Error> {
        let mut out = Vec::new();
        let old = self.load.clone();
        if !chosen.iter().any(|c| contains(c, &old)) {
            return Ok(out);
        }
        let loads = load_expressions(&self.declared, fitted);
        let before = usize::from(loads.len() > 1 && has_gain(chosen, &old));
        for (place, load) in loads.into_iter().enumerate().skip(before) {
            let Some(size) = self.size_of(&load)? else {
                continue;
            };
            self.load.clone_from(&load);
            let mut with = chosen.to_vec();
            self.put_in(&mut with, fitted, &old, size);
            self.load.clone_from(&old);
            out.push(Renewed {
                load,
                behind: place > 0,
                chosen: with,
            });
        }
        Ok(out)
    }

    /// Takes the one of these expressions with which the effects predict best, if that is not worse
    /// than `rmse`, as the error with the present one is. Whether the load changed.
    pub(super) fn renew_load(
        &mut self,
        renewed: Vec<Renewed>,
        rmse: f64,
        chosen: &mut Vec<Chosen>,
    ) -> Result<bool, Error> {
        let old = self.load.clone();
        let mut best: Option<(f64, Renewed)> = None;
        for mut new in renewed {
            self.load.clone_from(&new.load);
            self.polish(&mut new.chosen)?;
            let rmse = self.rmse(&new.chosen)?;
            self.load.clone_from(&old);
            if best.as_ref().is_none_or(|(least, _)| rmse < *least) {
                best = Some((rmse, new));
            }
        }
        // An expression that predicts worse is not the load.
        let Some((_, new)) = best.filter(|(new, _)| *new < rmse * 1.001) else {
            return Ok(false);
        };
        (self.load, self.load_is_behind) = (new.load, new.behind);
        *chosen = new.chosen;
        self.scans.clear();
        Ok(true)
    }

    /// Expresses the load behind a command that an effect replaces, where the other effects then
    /// predict better by what counts; beside a gain it is enough that they predict no worse.
    pub(super) fn load_behind(&mut self, chosen: &mut Vec<Chosen>) -> Result<(), Error> {
        let replaces = chosen.iter().any(replaces_command);
        if !replaces || !chosen.iter().any(|c| contains(c, &self.load)) {
            return Ok(());
        }
        let fitted = self.fit(chosen)?;
        let better = match has_gain(chosen, &self.load) {
            true => 0.0,
            false => 0.5 * self.spec.selection.material,
        };
        let most = fitted.rmse() * (1.0 - better);
        let mut renewed = self.renewed(&fitted, chosen)?;
        drop(fitted);
        renewed.retain(|new| new.behind);
        self.renew_load(renewed, most, chosen)?;
        Ok(())
    }

    /// Expresses the load behind a replaced command anew, after an effect was taken away: if that
    /// was the one that replaced it, a gain would else be a delay under another name.
    pub(super) fn load_before(&mut self, chosen: &mut [Chosen]) -> Result<(), Error> {
        if !self.load_is_behind {
            return Ok(());
        }
        self.load_is_behind = chosen.iter().any(replaces_command);
        let fitted = self.fit(chosen)?;
        let mut loads = load_expressions(&self.declared, &fitted);
        let place = if self.load_is_behind {
            loads.len() - 1
        } else {
            0
        };
        let load = loads.swap_remove(place);
        if let Some(size) = self.size_of(&load)? {
            let old = std::mem::replace(&mut self.load, load);
            self.put_in(chosen, &fitted, &old, size);
            drop(fitted);
            self.polish(chosen)?;
            self.scans.clear();
        }
        Ok(())
    }

    /// Whether the load is the one behind a replaced command, and no effect replaces it any more.
    pub(super) fn load_is_stale(&self, chosen: &[Chosen]) -> bool {
        self.load_is_behind && !chosen.iter().any(replaces_command)
    }

    /// Puts the present load in the place of the `old` one, which is smaller by the factor `size`.
    fn put_in(&self, chosen: &mut [Chosen], fitted: &Fitted, old: &str, size: f64) {
        let context = self.scan_on(fitted).context();
        for c in chosen.iter_mut().filter(|c| contains(c, old)) {
            let mut forms = c.effect.variants(&context).into_iter();
            let Some(form) = forms.find(|v| v.label == c.variant.label) else {
                continue;
            };
            // A parameter in units of load has a grid that goes with it.
            if let (Some(old), Some(new)) = (&c.variant.psi, &form.psi) {
                if let (Some(old), Some(new)) = (old.grid.last(), new.grid.last()) {
                    if (new / old - size).abs() < 0.2 * (size - 1.0).abs() {
                        c.psi *= size;
                    }
                }
            }
            c.variant = Arc::new(form);
        }
    }

    /// Size of another expression of the load over that of the present one; `None` if they are the
    /// same load.
    fn size_of(&self, new: &str) -> Result<Option<f64>, Error> {
        let values = |text: &str| -> Result<_, Error> {
            self.problem
                .eval_on(&self.problem.frame, &Expr::parse(text)?)
        };
        let (old, new) = (values(&self.load)?, values(new)?);
        let change: Vec<f64> = old.iter().zip(new.iter()).map(|(o, n)| o - n).collect();
        let differ = stats::rms(&change) > SAME * stats::rms(&old);
        Ok(differ.then(|| stats::rms(&new) / stats::rms(&old)))
    }
}
