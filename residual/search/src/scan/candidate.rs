//! Candidates: the forms on offer, each with its best parameter and what it achieves.

use super::grid::{neighbourhood, reach, vertex, FINE, ROUGH};
use super::significance::{acts_in_few, p_value, steady_where_it_acts, t_statistic};
use super::{Between, Scan};
use crate::model::Chosen;
use rayon::prelude::*;
use residual_effects::{Context, EffectRef, Variant, CATALOGUE};
use residual_fit::problem::{profile, Block, Scores};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;

/// Where a form comes from: an effect of the catalogue, or structure without a name.
pub trait Origin: Clone + Send + Sync {
    /// See [`Effect::has_witness`](residual_effects::Effect::has_witness).
    fn has_witness(&self) -> bool {
        false
    }
}

impl Origin for EffectRef {
    fn has_witness(&self) -> bool {
        (**self).has_witness()
    }
}

/// A form that is offered to a scan.
#[derive(Clone)]
pub struct Offer<O = EffectRef> {
    /// Where it comes from.
    pub origin: O,
    /// The form.
    pub variant: Arc<Variant>,
}

/// Forms of every effect that is `allowed`.
pub fn catalogue_offers(ctx: &Context, allowed: &(dyn Fn(EffectRef) -> bool + Sync)) -> Vec<Offer> {
    CATALOGUE
        .par_iter()
        .filter(|e| allowed(**e))
        .flat_map(|e| {
            e.variants(ctx)
                .into_iter()
                .map(|v| Offer {
                    origin: *e,
                    variant: Arc::new(v),
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// A variant with its best parameter and what it achieves.
#[derive(Clone)]
pub struct Candidate<O = EffectRef> {
    /// Where it comes from.
    pub origin: O,
    /// The form.
    pub variant: Arc<Variant>,
    /// Its nonlinear parameter; 0 without one.
    pub psi: f64,
    /// Relative fall of the held-out RMSE.
    pub gain: f64,
    /// Held-out squared error with the effect.
    pub held: f64,
    /// Held-out squared error without the effect.
    pub base: f64,
    /// p value of the gain, from the decoys.
    pub p: f64,
    /// t statistic: mean fall of the held-out squared error over blocks, in standard errors.
    pub t: f64,
    /// Whether the fall is steady over blocks, or over the few blocks in which the effect acts.
    pub steady: bool,
    /// Whether what changes is in a few blocks.
    pub local_in_time: bool,
    /// Number of fitted parameters it adds.
    pub parameters: usize,
    /// What the means of the sequences say, where they are the evidence.
    pub between: Option<Between>,
    /// p value against the noise at its own frequencies, for a form that hardly changes within a
    /// sequence.
    pub slow: Option<f64>,
    /// Held-out squared error by block.
    pub losses: Vec<f64>,
}

impl<O: Origin> Candidate<O> {
    /// The form once more on offer.
    pub fn offer(&self) -> Offer<O> {
        Offer {
            origin: self.origin.clone(),
            variant: self.variant.clone(),
        }
    }
}

impl Candidate {
    /// The candidate as a choice.
    pub fn choose(&self) -> Chosen {
        Chosen {
            effect: self.origin,
            variant: self.variant.clone(),
            psi: self.psi,
        }
    }
}

/// One value of the nonlinear parameter of a form.
struct Tried {
    psi: f64,
    scores: Scores,
    /// Held-out squared error by block; empty where it is computed for the chosen values alone.
    losses: Vec<f64>,
}

/// Values of the nonlinear parameter of one form that were tried.
struct Points {
    tried: Vec<Tried>,
    /// Held-out squared error by target (0: the residual itself, then decoys).
    held: Vec<f64>,
    /// Index of the value that each fold chose on its training groups.
    choice: Vec<usize>,
}

impl Points {
    fn new(tried: Vec<Tried>) -> Points {
        let mut out = Points {
            tried,
            held: vec![],
            choice: vec![],
        };
        out.choose();
        out
    }

    fn choose(&mut self) {
        let refs: Vec<&Scores> = self.tried.iter().map(|p| &p.scores).collect();
        (self.held, self.choice) = profile(&refs);
    }

    /// The value with the least in-sample error.
    fn best(&self) -> Option<f64> {
        self.tried
            .iter()
            .min_by(|a, b| a.scores.train_total().total_cmp(&b.scores.train_total()))
            .map(|p| p.psi)
    }

    /// Held-out squared error by block when each fold uses its own choice, from what was kept. A
    /// form whose coefficients every sequence has for itself has one choice, `psi`.
    fn losses(&self, blocks: &[Block], local: bool, psi: f64) -> Vec<f64> {
        let one = self.tried.iter().find(|t| t.psi == psi);
        let of = |k: usize, block: &Block| {
            let tried = if local {
                one
            } else {
                self.tried.get(self.choice[block.fold])
            };
            tried.map_or(f64::NAN, |t| t.losses[k])
        };
        blocks.iter().enumerate().map(|(k, b)| of(k, b)).collect()
    }
}

/// Relative fall of an RMSE, from squared errors.
fn fall(held: f64, base: f64) -> f64 {
    if base > 0.0 {
        1.0 - (held / base).max(0.0).sqrt()
    } else {
        0.0
    }
}

impl Scan<'_> {
    /// Scores forms; the result is one candidate per form that could be evaluated. `focus`
    /// limits nonlinear parameters to a neighbourhood (used after screening on fewer rows).
    pub fn candidates<O: Origin>(
        &self,
        offers: &[Offer<O>],
        focus: Option<&[f64]>,
    ) -> Vec<Candidate<O>> {
        self.problem.next_scan();
        let grids: Vec<Vec<f64>> = offers
            .iter()
            .enumerate()
            .map(|(i, offer)| match (&offer.variant.psi, focus) {
                (None, _) => vec![0.0],
                (Some(p), Some(at)) if p.refine => neighbourhood(p, at[i]),
                (Some(p), _) => p.grid.clone(),
            })
            .collect();
        self.tried(offers, &grids, focus.is_some())
            .into_par_iter()
            .enumerate()
            .filter_map(|(i, tried)| self.candidate(&offers[i], &grids[i], tried, focus.is_some()))
            .collect()
    }

    /// Scores of every form at every value of its grid. After screening (`focused`) the values are
    /// few, and each comes up once: their errors by block are kept, their columns are not.
    fn tried<O: Origin>(
        &self,
        offers: &[Offer<O>],
        grids: &[Vec<f64>],
        focused: bool,
    ) -> Vec<Vec<Tried>> {
        let jobs: Vec<(usize, f64)> = grids
            .iter()
            .enumerate()
            .flat_map(|(i, g)| g.iter().map(move |x| (i, *x)))
            .collect();
        let done = AtomicUsize::new(0);
        let scored: Vec<Option<(Scores, Vec<f64>)>> = jobs
            .par_iter()
            .map(|(i, psi)| {
                let scores = self.score(&(offers[*i].variant.build)(*psi), !focused, focused);
                if let Some(report) = &self.problem.ticker {
                    report(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
                }
                scores
            })
            .collect();
        let mut out: Vec<Vec<Tried>> = offers.iter().map(|_| vec![]).collect();
        for ((i, psi), s) in jobs.iter().zip(scored) {
            if let Some((scores, losses)) = s {
                out[*i].push(Tried {
                    psi: *psi,
                    scores,
                    losses,
                });
            }
        }
        out
    }

    /// One form's candidate from the scores of its grid. After screening (`focused`) the place of
    /// its parameter is known, and polishing follows.
    fn candidate<O: Origin>(
        &self,
        offer: &Offer<O>,
        grid: &[f64],
        tried: Vec<Tried>,
        focused: bool,
    ) -> Option<Candidate<O>> {
        let variant = &offer.variant;
        let local = variant.is_local(grid.first().copied()?);
        let base: Vec<f64> = (0..=self.problem.flips.len())
            .map(|j| {
                if local {
                    self.fit.sums.yy.iter().map(|y| y[0]).sum()
                } else {
                    self.fit.scores.held_total(j)
                }
            })
            .collect();
        let mut points = Points::new(tried);
        let refine = variant.psi.as_ref().is_some_and(|p| p.refine);
        let material = self.spec.selection.material;
        if refine && !points.held.is_empty() && fall(points.held[0], base[0]) > 0.3 * material {
            if focused {
                self.add_vertex(variant, &mut points);
            } else {
                self.refine_points(variant, grid, &mut points)?;
            }
        }
        let held = *points.held.first()?;
        let psi = points.best()?;
        if !self.possible(variant, psi) {
            return None;
        }
        let gain = fall(held, base[0]);
        let decoys: Vec<f64> = points
            .held
            .iter()
            .zip(&base)
            .skip(1)
            .map(|(h, b)| fall(*h, *b))
            .collect();
        let (mut t, mut steady, mut losses) = (0.0, false, vec![]);
        let mut local_in_time = false;
        if gain > 0.25 * material && !self.screening {
            losses = if focused {
                points.losses(&self.problem.blocks, local, psi)
            } else {
                let chosen = points.choice.iter().map(|c| points.tried[*c].psi);
                let psis = if local { vec![psi] } else { chosen.collect() };
                self.losses(variant, &psis)
            };
            let before = self.base_losses(local);
            t = t_statistic(&before, &losses);
            steady = t >= 2.5 || steady_where_it_acts(&before, &losses);
            local_in_time = acts_in_few(&before, &losses);
        }
        Some(Candidate {
            origin: offer.origin.clone(),
            variant: variant.clone(),
            psi,
            gain,
            held,
            base: base[0],
            p: if variant.observed {
                0.0
            } else {
                p_value(gain, &decoys)
            },
            t,
            steady: steady || variant.observed,
            local_in_time,
            parameters: variant.parameters(psi),
            between: None,
            slow: None,
            losses,
        })
    }

    /// Adds the vertex of the parabola through the three values of a neighbourhood. Polishing
    /// follows for what is chosen.
    fn add_vertex(&self, variant: &Variant, points: &mut Points) {
        let at: Vec<(f64, f64)> = points
            .tried
            .iter()
            .map(|t| (t.psi, t.scores.train_total()))
            .collect();
        let Some(psi) = vertex(&at) else {
            return;
        };
        if let Some((scores, losses)) = self.score(&(variant.build)(psi), false, true) {
            points.tried.push(Tried {
                psi,
                scores,
                losses,
            });
            points.choose();
        }
    }

    /// Adds the optimum between the best grid point and its neighbours, and two values beside it.
    fn refine_points(&self, variant: &Variant, grid: &[f64], points: &mut Points) -> Option<()> {
        let at = points.best()?;
        let resolution = variant.psi.as_ref().and_then(|p| p.resolution);
        let (lo, hi) = reach(resolution, grid, at);
        let steps = if self.screening { ROUGH } else { FINE };
        let psi = self.refine(variant, lo, hi, steps);
        for psi in [psi, psi + 0.15 * (at - psi), psi - 0.15 * (at - psi)] {
            if let Some((scores, losses)) = self.score(&(variant.build)(psi), false, false) {
                points.tried.push(Tried {
                    psi,
                    scores,
                    losses,
                });
            }
        }
        points.choose();
        Some(())
    }
}
