//! Forward selection of effects on held-out groups, against rivals and decoys.
//!
//! Each step scans the whole catalogue on the current residual. A candidate counts if its held-out
//! gain is material, stands out from the gains that decoys of the residual reach with the same
//! terms, and is steady over blocks. Among those that explain nearly the same, the one with fewer
//! parameters is taken first; a richer one that still adds something is taken in a later step and
//! then throws out what it makes superfluous. So a stand-in (a line in position for a hysteresis)
//! can enter, but cannot stay.

use crate::effects::{Build, Context, EffectRef, Piece, Psi, Variant, CATALOGUE};
use crate::error::Error;
use crate::expr::Expr;
use crate::frame::Frame;
use crate::model::{Chosen, Fit, Model};
use crate::problem::{profile, Column, Known, Problem, Scores, Sums};
use crate::spec::Spec;
use crate::stats;
use rayon::prelude::*;
use std::cell::OnceCell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;

/// Steps of a golden-section search that find an optimum to a 2000th of the interval.
pub(crate) const FINE: usize = 16;

/// Where a form comes from: an effect of the catalogue, or structure without a name.
pub(crate) trait Origin: Clone + Send + Sync {
    /// See [`Effect::has_witness`](crate::effects::Effect::has_witness).
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
pub(crate) struct Offer<O = EffectRef> {
    pub origin: O,
    pub variant: Arc<Variant>,
}

/// A variable that nameless structure can depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Axis {
    Velocity,
    Load,
    Angle,
    Temperature,
    Pose,
    Channel,
    Time,
}

/// Structure without a name: a free form in one or two variables.
#[derive(Debug, Clone)]
pub(crate) struct Nameless {
    /// What it depends on, for readers.
    pub depends_on: String,
    /// The variables, with the expression of each.
    pub axes: Vec<(Axis, String)>,
}

impl Origin for Nameless {}

impl Nameless {
    /// Expression to plot the residual against; `None` for the load, which also stands in for
    /// variables that show nothing by themselves.
    pub fn against(&self) -> Option<&str> {
        let (axis, expression) = self.axes.iter().min_by_key(|(axis, _)| *axis)?;
        let plain = matches!(
            axis,
            Axis::Velocity | Axis::Angle | Axis::Temperature | Axis::Pose
        );
        plain.then_some(expression)
    }
}

/// A variant with its best parameter and what it achieves.
#[derive(Clone)]
pub(crate) struct Candidate<O = EffectRef> {
    pub origin: O,
    pub variant: Arc<Variant>,
    pub psi: f64,
    /// Relative fall of the held-out RMSE.
    pub gain: f64,
    /// Held-out squared error with the effect, and without.
    pub held: f64,
    pub base: f64,
    /// Probability of such a gain by chance, from the decoys.
    pub p: f64,
    /// Steadiness: mean fall of the held-out squared error over blocks, in standard errors.
    pub z: f64,
    /// Whether the fall is steady over blocks, or over the few blocks in which the effect acts.
    pub steady: bool,
    /// Number of fitted parameters it adds.
    pub parameters: usize,
    /// Held-out squared error by block.
    pub losses: Vec<f64>,
}

/// Terms that stand for structure without a name: curves in one variable, products of two, lagged
/// inputs. They are never chosen; they tell that something is left.
pub(crate) fn generic(ctx: &Context) -> Vec<Offer<Nameless>> {
    let mut vars: Vec<(Axis, String, String)> = vec![(Axis::Load, "load".into(), ctx.load.clone())];
    if let Some(v) = &ctx.velocity {
        vars.push((Axis::Velocity, "velocity".into(), v.clone()));
    }
    if let Some(x) = &ctx.position {
        if ctx.spec.roles.angle.is_some() {
            vars.push((Axis::Angle, "angle".into(), x.clone()));
        }
    }
    if ctx.spec.roles.temperature.is_some() {
        vars.push((
            Axis::Temperature,
            "temperature".into(),
            "temperature".into(),
        ));
    }
    let roles = &ctx.spec.roles;
    let pose = roles.pose.keys().map(|n| (Axis::Pose, n));
    let channels = roles.channels.keys().map(|n| (Axis::Channel, n));
    vars.extend(pose.chain(channels).map(|(a, n)| (a, n.clone(), n.clone())));
    vars.push((Axis::Time, "time in the run".into(), "elapsed".into()));
    vars.retain(|(_, _, e)| ctx.range(e).is_some());
    let hinges = |e: &str, count: usize| -> Vec<String> {
        let mut v = ctx.values(e);
        v.sort_by(f64::total_cmp);
        let scale = stats::quantile_sorted(&v, 0.98) - stats::quantile_sorted(&v, 0.02);
        let mut out = vec![format!("({e}) / {scale}")];
        let mut last = f64::NEG_INFINITY;
        for i in 1..=count {
            let k = stats::quantile_sorted(&v, i as f64 / (count + 1) as f64);
            if k > last + 1e-6 * scale {
                out.push(format!("max(0, {e} - {k}) / {scale}"));
                last = k;
            }
        }
        out
    };
    let mut out = Vec::new();
    let mut add = |depends_on: String, on: &[&(Axis, String, String)], texts: Vec<String>| {
        let pieces = texts
            .into_iter()
            .enumerate()
            .map(|(i, t)| Piece::new(format!("shape_{i}"), "", t))
            .collect();
        out.push(Offer {
            origin: Nameless {
                depends_on,
                axes: on.iter().map(|(a, _, e)| (*a, e.clone())).collect(),
            },
            variant: Arc::new(Variant::linear("", pieces)),
        });
    };
    for var in &vars {
        let (_, n, e) = var;
        add(format!("a curve in {n}"), &[var], hinges(e, 7));
    }
    let unit = |e: &str| {
        let (lo, hi) = ctx.range(e).unwrap_or((0.0, 1.0));
        format!("(({e} - {}) / {})", 0.5 * (lo + hi), 0.5 * (hi - lo))
    };
    for (i, var) in vars.iter().enumerate() {
        for other in vars.iter().skip(i + 1) {
            let ((_, n, e), (_, m, f)) = (var, other);
            let (a, b) = (unit(e), unit(f));
            let mut texts = vec![
                a.clone(),
                b.clone(),
                format!("{a} * {b}"),
                format!("{a}^2"),
                format!("{b}^2"),
            ];
            texts.extend([
                format!("{a}^2 * {b}"),
                format!("{a} * {b}^2"),
                format!("{a}^2 * {b}^2"),
                format!("{a}^3"),
                format!("{b}^3"),
            ]);
            add(format!("{n} and {m} together"), &[var, other], texts);
        }
    }
    if let Some(v) = &ctx.velocity {
        let velocity = (Axis::Velocity, String::new(), v.clone());
        for var in vars.iter().filter(|(a, ..)| *a != Axis::Velocity) {
            let (_, n, e) = var;
            let s = format!("sgn({v}, {})", ctx.deadband);
            let texts = std::iter::once(s.clone())
                .chain(hinges(e, 4).into_iter().map(|h| format!("{s} * {h}")))
                .collect();
            add(
                format!("{n}, with the sign of the velocity"),
                &[var, &velocity],
                texts,
            );
        }
    }
    let driving = |axis: &Axis| matches!(axis, Axis::Load | Axis::Velocity);
    for var in vars.iter().filter(|(a, ..)| driving(a)) {
        let (_, n, e) = var;
        let texts = [0.0, 1.0, 2.0, 4.0, 8.0, 16.0]
            .iter()
            .map(|k| format!("delay({e}, {})", k * ctx.dt))
            .collect();
        add(format!("the history of {n}"), &[var], texts);
        let r = unit(e);
        let texts = [3.0, 12.0, 50.0].iter().flat_map(|k| {
            let l = format!("lowpass({r}, {})", k * ctx.dt);
            [l.clone(), format!("{l}^2"), format!("{l} * {r}")]
        });
        add(format!("the slow history of {n}"), &[var], texts.collect());
    }
    out
}

/// Everything a scan needs to know about the current model.
pub(crate) struct State<'a> {
    pub problem: &'a Problem,
    pub spec: &'a Spec,
    pub model: &'a Model,
    pub fit: &'a Fit,
}

impl State<'_> {
    /// Sums of the current model with a build applied.
    fn sums(&self, build: &Build, keep: bool) -> Result<(Sums, bool), Error> {
        let columns = |pieces: &[Piece]| -> Result<Vec<Column>, Error> {
            pieces
                .iter()
                .map(|p| self.problem.eval_text(&self.fit.view, &p.text, keep))
                .collect()
        };
        match build {
            Build::Add(pieces) => {
                let cols = columns(pieces)?;
                let all: Vec<&[f64]> = self
                    .fit
                    .x
                    .iter()
                    .chain(&cols)
                    .map(|c| c.as_slice())
                    .collect();
                let at: Vec<Option<usize>> = (0..self.fit.x.len()).map(Some).collect();
                let known = Known {
                    sums: &self.fit.sums,
                    at: &at,
                };
                Ok((
                    Sums::new(self.problem, &all, &self.fit.residual, None, Some(known)),
                    false,
                ))
            }
            Build::Local(pieces) => {
                let cols = columns(pieces)?;
                let all: Vec<&[f64]> = cols.iter().map(|c| c.as_slice()).collect();
                Ok((
                    Sums::new(self.problem, &all, &self.fit.residual, None, None),
                    true,
                ))
            }
            Build::Swap(pairs) | Build::SwapAll(pairs) => {
                // A column that is replaced is evaluated once, however many terms use it.
                let view = &self.fit.view;
                let frame = OnceCell::new();
                let swapped = || -> Result<&Frame, Error> {
                    if let Some(known) = frame.get() {
                        return Ok(known);
                    }
                    let mut new = view.frame.clone();
                    for (name, text) in pairs {
                        new.insert(name, Expr::parse(text)?.eval(&view.frame)?);
                    }
                    Ok(frame.get_or_init(|| new))
                };
                let everywhere = matches!(build, Build::SwapAll(_));
                let n = self.problem.y.len();
                let mut part = self.fit.prediction.clone();
                let (mut x, mut at): (Vec<Column>, Vec<_>) = (vec![], vec![]);
                let mut fixed = vec![0.0; n];
                for t in self.model.terms.iter().filter(|t| !t.local) {
                    let names = t.expr.names();
                    let touched = (everywhere || t.chosen.is_none())
                        && pairs.iter().any(|(name, _)| names.contains(name));
                    let v = if touched {
                        self.problem
                            .eval_swapped(view, pairs, &t.expr, keep, swapped)?
                    } else {
                        self.problem.eval(view, &t.expr)?
                    };
                    match t.fixed {
                        Some(k) => fixed
                            .iter_mut()
                            .zip(v.iter())
                            .for_each(|(f, v)| *f += k * v),
                        None => {
                            at.push((!touched).then_some(x.len()));
                            x.push(v);
                        }
                    }
                }
                let known = Known {
                    sums: &self.fit.sums,
                    at: &at,
                };
                part.iter_mut().zip(&fixed).for_each(|(p, f)| *p -= f);
                let all: Vec<&[f64]> = x.iter().map(|c| c.as_slice()).collect();
                Ok((
                    Sums::new(
                        self.problem,
                        &all,
                        &self.fit.residual,
                        Some(&part),
                        Some(known),
                    ),
                    false,
                ))
            }
        }
    }

    fn score(&self, build: &Build, keep: bool) -> Option<Scores> {
        let (s, local) = self.sums(build, keep).ok()?;
        Some(if local {
            Scores::local(self.problem, &s)
        } else {
            Scores::new(self.problem, &s)
        })
    }

    /// In-sample squared error with a build (cheaper than scores: no decoys).
    fn in_sample(&self, build: &Build) -> f64 {
        match self.sums(build, false) {
            Ok((s, false)) => {
                let (x, _) = s.fit(None);
                (0..s.yy.len()).map(|k| s.block_error(k, &x)).sum()
            }
            Ok((s, true)) => Scores::local(self.problem, &s).train_total(),
            Err(_) => f64::INFINITY,
        }
    }

    /// Golden-section search of the nonlinear parameter between `lo` and `hi`; every step takes
    /// two fifths of the interval away.
    pub fn refine(&self, variant: &Variant, lo: f64, hi: f64, steps: usize) -> f64 {
        const RATIO: f64 = 0.618_033_988_749_895;
        let log = lo > 0.0 && hi / lo > 1.05;
        let to = |x: f64| if log { x.ln() } else { x };
        let from = |u: f64| if log { u.exp() } else { u };
        let (mut a, mut b) = (to(lo), to(hi));
        let cost = |u: f64| self.in_sample(&(variant.build)(from(u)));
        let (mut c, mut d) = (b - RATIO * (b - a), a + RATIO * (b - a));
        let (mut fc, mut fd) = (cost(c), cost(d));
        for _ in 0..steps {
            if fc < fd {
                (b, d, fd) = (d, c, fc);
                c = b - RATIO * (b - a);
                fc = cost(c);
            } else {
                (a, c, fc) = (c, d, fd);
                d = a + RATIO * (b - a);
                fd = cost(d);
            }
        }
        from(0.5 * (a + b))
    }

    /// Held-out squared error by block when each fold uses its own choice of parameter.
    fn losses(&self, variant: &Variant, psis: &[f64]) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.problem.blocks.len()];
        let mut distinct: Vec<f64> = psis.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        for psi in distinct {
            let Ok((s, local)) = self.sums(&(variant.build)(psi), false) else {
                continue;
            };
            if local {
                s.hold_out_halves(self.problem, &mut out);
            } else {
                s.hold_out(self.problem, &|fold| psis[fold] == psi, &mut out);
            }
        }
        out
    }

    /// Held-out squared error by block of the current model.
    fn base_losses(&self, local: bool) -> Vec<f64> {
        let s = &self.fit.sums;
        if local {
            return s.yy.iter().map(|y| y[0]).collect();
        }
        let mut out = vec![0.0; s.yy.len()];
        s.hold_out(self.problem, &|_| true, &mut out);
        out
    }

    /// Scores variants; the result is one candidate per variant that could be evaluated. `focus`
    /// limits nonlinear parameters to a neighbourhood (used after screening on fewer rows).
    pub fn scan<O: Origin>(
        &self,
        variants: &[Offer<O>],
        focus: Option<&[f64]>,
    ) -> Vec<Candidate<O>> {
        self.problem.next_scan();
        let grids: Vec<Vec<f64>> = variants
            .iter()
            .enumerate()
            .map(|(i, offer)| match (&offer.variant.psi, focus) {
                (None, _) => vec![0.0],
                (Some(p), Some(at)) if p.refine => neighbourhood(p, at[i]),
                (Some(p), _) => p.grid.clone(),
            })
            .collect();
        let jobs: Vec<(usize, f64)> = grids
            .iter()
            .enumerate()
            .flat_map(|(i, g)| g.iter().map(move |x| (i, *x)))
            .collect();
        let done = AtomicUsize::new(0);
        let scored: Vec<Option<Scores>> = jobs
            .par_iter()
            .map(|(i, psi)| {
                let scores = self.score(&(variants[*i].variant.build)(*psi), true);
                if let Some(tell) = &self.problem.ticker {
                    tell(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
                }
                scores
            })
            .collect();
        let mut per: Vec<Vec<(f64, Scores)>> = variants.iter().map(|_| vec![]).collect();
        for ((i, psi), s) in jobs.iter().zip(scored) {
            if let Some(s) = s {
                per[*i].push((*psi, s));
            }
        }
        per.into_par_iter()
            .enumerate()
            .filter_map(|(i, mut points)| {
                let Offer { origin, variant } = &variants[i];
                let local = matches!((variant.build)(grids[i].first().copied()?), Build::Local(_));
                let base: Vec<f64> = (0..=self.problem.flips.len())
                    .map(|j| {
                        if local {
                            self.fit.sums.yy.iter().map(|y| y[0]).sum()
                        } else {
                            self.fit.scores.held_total(j)
                        }
                    })
                    .collect();
                let total = |points: &[(f64, Scores)]| {
                    let refs: Vec<&Scores> = points.iter().map(|p| &p.1).collect();
                    profile(&refs)
                };
                let (mut held, mut choice) = total(&points);
                let gain_of = |held: f64, base: f64| {
                    if base > 0.0 {
                        1.0 - (held / base).max(0.0).sqrt()
                    } else {
                        0.0
                    }
                };
                let refine = variant.psi.as_ref().is_some_and(|p| p.refine);
                if refine
                    && !held.is_empty()
                    && gain_of(held[0], base[0]) > 0.3 * self.spec.selection.material
                {
                    let best = (0..points.len()).min_by(|a, b| {
                        points[*a]
                            .1
                            .train_total()
                            .total_cmp(&points[*b].1.train_total())
                    })?;
                    let at = points[best].0;
                    let resolution = variant.psi.as_ref().and_then(|p| p.resolution);
                    let (lo, hi) =
                        resolution.map_or_else(|| bracket(&grids[i], at), |d| (at - d, at + d));
                    // After screening the place is known, and polishing follows.
                    let steps = if focus.is_some() { 6 } else { FINE };
                    let psi = self.refine(variant, lo, hi, steps);
                    for psi in [psi, psi + 0.15 * (at - psi), psi - 0.15 * (at - psi)] {
                        if let Some(s) = self.score(&(variant.build)(psi), false) {
                            points.push((psi, s));
                        }
                    }
                    (held, choice) = total(&points);
                }
                if held.is_empty() {
                    return None;
                }
                let psi = points
                    .iter()
                    .min_by(|a, b| a.1.train_total().total_cmp(&b.1.train_total()))?
                    .0;
                if variant
                    .adds_to_friction
                    .is_some_and(|own| !self.adds_to_friction(&(variant.build)(psi), own))
                {
                    return None;
                }
                let gain = gain_of(held[0], base[0]);
                let decoys: Vec<f64> = held
                    .iter()
                    .zip(&base)
                    .skip(1)
                    .map(|(h, b)| gain_of(*h, *b))
                    .collect();
                let p = chance(gain, &decoys);
                let (mut z, mut steady, mut losses) = (0.0, false, vec![]);
                if gain > 0.25 * self.spec.selection.material {
                    let psis: Vec<f64> = if local {
                        vec![psi]
                    } else {
                        choice.iter().map(|c| points[*c].0).collect()
                    };
                    losses = self.losses(variant, &psis);
                    let before = self.base_losses(local);
                    z = steadiness(&before, &losses);
                    steady = z >= 2.5 || steady_where_it_acts(&before, &losses);
                }
                let pieces = match (variant.build)(psi) {
                    Build::Add(p) | Build::Local(p) => p.len(),
                    Build::Swap(_) | Build::SwapAll(_) => 0,
                };
                let parameters =
                    pieces + usize::from(variant.psi.as_ref().is_some_and(|p| p.refine));
                Some(Candidate {
                    origin: origin.clone(),
                    variant: variant.clone(),
                    psi,
                    gain,
                    held: held[0],
                    base: base[0],
                    p,
                    z,
                    steady,
                    parameters,
                    losses,
                })
            })
            .collect()
    }

    /// Significance against decoys of what remains *after* the candidate. Decoys of the residual
    /// itself carry the effect in pieces, which hides effects that are slow or act in few places.
    pub fn second_look<O: Origin>(&self, c: &Candidate<O>) -> f64 {
        let added = self.contribution(c);
        if added.len() != self.fit.residual.len() {
            return c.p;
        }
        let residual: Vec<f64> = self
            .fit
            .residual
            .iter()
            .zip(&added)
            .map(|(r, a)| r - a)
            .collect();
        let cols: Vec<&[f64]> = self.fit.x.iter().map(|c| c.as_slice()).collect();
        let sums = Sums::new(self.problem, &cols, &residual, None, None);
        let scores = Scores::new(self.problem, &sums);
        let fit = self.fit.on(residual, sums, scores);
        let state = State {
            problem: self.problem,
            spec: self.spec,
            model: self.model,
            fit: &fit,
        };
        let mut grid = c.variant.psi.as_ref().map_or(vec![], |p| p.grid.clone());
        grid.push(c.psi);
        let points: Vec<Scores> = grid
            .par_iter()
            .filter_map(|psi| state.score(&(c.variant.build)(*psi), true))
            .collect();
        let refs: Vec<&Scores> = points.iter().collect();
        let (held, _) = profile(&refs);
        let decoys: Vec<f64> = held
            .iter()
            .enumerate()
            .skip(1)
            .map(|(j, h)| (fit.scores.held_total(j) - h) / c.base)
            .collect();
        chance((c.base - c.held) / c.base, &decoys)
    }

    /// How much of a form's claim stands on the setpoint: 1 if the part of its contribution that follows
    /// from the setpoint is in the residual too, 0 if it is not there.
    ///
    /// In a closed loop the controller turns slow disturbances into command, so anything built from
    /// the command correlates with the disturbance. The setpoint is free of it: this is the ratio of
    /// the two-stage to the one-stage least-squares estimate, with the setpoint's history as
    /// instruments. Also 0 if the setpoint moves too little to tell.
    pub fn share_on_setpoint(&self, variant: &Variant, psi: f64) -> f64 {
        let added = self.added(variant, psi);
        if added.iter().all(|a| *a == 0.0) {
            return 1.0;
        }
        let mut texts = vec!["1".to_string()];
        for k in [0.0, 2.0, 4.0, 8.0, 16.0, 32.0] {
            let s = format!("delay(setpoint, {})", k * self.problem.frame.step());
            texts.extend([format!("{s}^2"), s]);
        }
        // Direction of the setpoint, with memory: what friction and play answer to.
        let mut sp = self
            .problem
            .frame
            .column("setpoint")
            .unwrap_or(&[])
            .to_vec();
        sp.sort_by(f64::total_cmp);
        let range = stats::quantile_sorted(&sp, 0.98) - stats::quantile_sorted(&sp, 0.02);
        if range > 0.0 {
            texts.extend(
                [0.02, 0.1, 0.4]
                    .iter()
                    .map(|k| format!("dahl(setpoint, {})", k * range)),
            );
        }
        let cols: Vec<Column> = texts
            .iter()
            .filter_map(|t| self.problem.eval_text(&self.fit.view, t, true).ok())
            .collect();
        let z: Vec<&[f64]> = cols.iter().map(|c| c.as_slice()).collect();
        let (k, _) = Sums::new(self.problem, &z, &added, None, None).fit(None);
        let mut part = vec![0.0; added.len()];
        for (col, k) in cols.iter().zip(&k) {
            part.iter_mut()
                .zip(col.iter())
                .for_each(|(p, v)| *p += k * v);
        }
        let mean = stats::mean(&part);
        part.iter_mut().for_each(|p| *p -= mean);
        let (pp, aa) = (
            crate::linalg::dot(&part, &part),
            crate::linalg::dot(&added, &added),
        );
        if pp < 0.01 * aa {
            return 0.0;
        }
        crate::linalg::dot(&part, &self.fit.residual) / crate::linalg::dot(&part, &added)
    }

    /// Whether dry friction is larger with piece `own` than without, where that piece acts.
    fn adds_to_friction(&self, build: &Build, own: usize) -> bool {
        let (Build::Add(pieces), Some(v)) = (build, velocity_of(self.spec)) else {
            return true;
        };
        let Ok((s, _)) = self.sums(build, false) else {
            return false;
        };
        let (x, _) = s.fit(None);
        let (refit, new) = x.split_at(self.fit.x.len());
        let value = |e: &Expr| self.problem.eval(&self.fit.view, e).ok();
        // Declared and found terms with what the fit adds to their coefficients, then the form's own.
        let mut refit = self.fit.theta.iter().zip(refit).map(|(t, x)| t + x);
        let mut friction = vec![0.0; self.problem.y.len()];
        let mut add = |e: &Expr, k: f64| {
            for (f, v) in friction
                .iter_mut()
                .zip(value(e).iter().flat_map(|v| v.iter()))
            {
                *f += k * v;
            }
        };
        for t in self.model.terms.iter().filter(|t| !t.local) {
            let k = t.fixed.or_else(|| refit.next()).unwrap_or(0.0);
            if dry_friction(&t.expr, &v) {
                add(&t.expr, k);
            }
        }
        let parsed: Vec<Expr> = pieces
            .iter()
            .filter_map(|p| Expr::parse(&p.text).ok())
            .collect();
        for (i, (e, k)) in parsed.iter().zip(new).enumerate() {
            if i != own && dry_friction(e, &v) {
                add(e, *k);
            }
        }
        let Some(extra) = parsed.get(own).and_then(value) else {
            return false;
        };
        let dot = crate::linalg::dot;
        // Squares with it and without: friction that is all in this piece has no sign to go against.
        let k = new[own];
        2.0 * k * dot(&friction, &extra) + k * k * dot(&extra, &extra) >= 0.0
    }

    /// Whether a form is built from the command.
    pub fn built_on_command(&self, variant: &Variant, psi: f64) -> bool {
        let texts: Vec<String> = match (variant.build)(psi) {
            Build::Add(p) | Build::Local(p) => p.into_iter().map(|p| p.text).collect(),
            Build::Swap(s) | Build::SwapAll(s) => s.into_iter().map(|(n, _)| n).collect(),
        };
        texts
            .iter()
            .any(|t| Expr::parse(t).is_ok_and(|e| e.names().contains("command")))
    }

    /// RMS of what a candidate adds to the prediction, and the added values.
    pub fn contribution<O>(&self, c: &Candidate<O>) -> Vec<f64> {
        self.added(&c.variant, c.psi)
    }

    fn added(&self, variant: &Variant, psi: f64) -> Vec<f64> {
        let build = (variant.build)(psi);
        let Ok((s, local)) = self.sums(&build, false) else {
            return vec![];
        };
        let mut out = vec![0.0; self.problem.y.len()];
        if local {
            return out;
        }
        let (x, _) = s.fit(None);
        match &build {
            Build::Add(pieces) => {
                let cols: Vec<Column> = pieces
                    .iter()
                    .filter_map(|p| self.problem.eval_text(&self.fit.view, &p.text, false).ok())
                    .collect();
                for (col, k) in self.fit.x.iter().chain(&cols).zip(&x) {
                    out.iter_mut()
                        .zip(col.iter())
                        .for_each(|(o, v)| *o += k * v);
                }
            }
            _ => {
                let mut m = self.model.clone();
                if m.apply(&build, usize::MAX).is_err() {
                    return vec![];
                }
                let mut k = x.iter();
                let Ok(view) = self.problem.view(&m.replaced) else {
                    return vec![];
                };
                for t in m.terms.iter().filter(|t| !t.local) {
                    let Ok(v) = self.problem.eval(&view, &t.expr) else {
                        return vec![];
                    };
                    let a = t.fixed.unwrap_or_else(|| k.next().copied().unwrap_or(0.0));
                    out.iter_mut().zip(v.iter()).for_each(|(o, v)| *o += a * v);
                }
                out.iter_mut()
                    .zip(&self.fit.prediction)
                    .for_each(|(o, p)| *o -= p);
            }
        }
        out
    }
}

/// Values around `at`: a seventh of a grid step apart.
fn neighbourhood(p: &Psi, at: f64) -> Vec<f64> {
    let k = p.grid.partition_point(|g| *g < at);
    let (lo, hi) = (p.grid[k.saturating_sub(1)], p.grid[k.min(p.grid.len() - 1)]);
    let d = p.resolution.unwrap_or((hi - lo).abs()) / 7.0;
    [-1.0, 0.0, 1.0]
        .iter()
        .map(|s| at + s * d)
        .filter(|x| at <= 0.0 || *x > 0.0)
        .collect()
}

/// Interval around a grid point in which to refine: up to its neighbours.
pub(crate) fn bracket(grid: &[f64], at: f64) -> (f64, f64) {
    let k = grid.partition_point(|g| *g < at);
    let left = if k > 0 {
        grid[k - 1]
    } else if at > 0.0 {
        at * 0.7
    } else {
        at * 1.3
    };
    let right = grid
        .get(k + 1)
        .copied()
        .unwrap_or(if at > 0.0 { at * 1.4 } else { at * 0.7 });
    (left, right)
}

/// Probability of a gain so large under the decoys: their tail is taken as normal with its spread
/// widened by 1.4, and never below what their count allows when the gain does not exceed them all.
fn chance(gain: f64, decoys: &[f64]) -> f64 {
    if decoys.is_empty() {
        return 1.0;
    }
    let above = decoys.iter().filter(|d| **d >= gain).count();
    let mean = stats::mean(decoys).max(-0.01);
    let sd = stats::deviation(decoys).max(1e-9) * 1.4;
    let tail = stats::normal_tail((gain - mean) / sd);
    if above > 0 {
        tail.max((above + 1) as f64 / (decoys.len() + 1) as f64)
    } else {
        tail
    }
}

/// Mean fall of loss over blocks in standard errors of it.
pub(crate) fn steadiness(before: &[f64], after: &[f64]) -> f64 {
    let d: Vec<f64> = before
        .iter()
        .zip(after)
        .map(|(b, a)| b - a)
        .filter(|d| d.is_finite())
        .collect();
    if d.len() < 4 {
        return 0.0;
    }
    let se = stats::deviation(&d) / (d.len() as f64).sqrt();
    if se > 0.0 {
        stats::mean(&d) / se
    } else {
        0.0
    }
}

/// Whether the error falls in nearly all blocks in which it changes at all. An effect that acts in few
/// places (a limit that is seldom reached) has a large spread over all blocks, however sure it is. A sign
/// test: at least three blocks with a hundredth of the whole change each, at most one in eight against.
fn steady_where_it_acts(before: &[f64], after: &[f64]) -> bool {
    let change: Vec<f64> = before
        .iter()
        .zip(after)
        .map(|(b, a)| b - a)
        .filter(|d| d.is_finite())
        .collect();
    let whole: f64 = change.iter().map(|d| d.abs()).sum();
    let count = |sign: f64| change.iter().filter(|d| sign * **d > 0.01 * whole).count();
    let (fell, rose) = (count(1.0), count(-1.0));
    fell >= 3 && 8 * rose <= fell
}

/// Whether a term has the direction of a motion with velocity `v`, and so is dry friction.
fn dry_friction(term: &Expr, v: &str) -> bool {
    let text = term.to_string();
    ["sgn", "sign", "held", "tanh"]
        .iter()
        .any(|f| text.contains(&format!("{f}({v}")))
}

/// The velocity as the model file gives it.
fn velocity_of(spec: &Spec) -> Option<String> {
    let roles = &spec.roles;
    if roles.velocity.is_some() {
        Some("velocity".to_string())
    } else {
        roles.angle.as_ref().map(|_| "deriv(angle, 2)".to_string())
    }
}

/// The context of the current residual.
pub(crate) fn context<'a>(
    problem: &'a Problem,
    spec: &'a Spec,
    load: &str,
    model: &Model,
    fit: &'a Fit,
) -> Context<'a> {
    let roles = &spec.roles;
    let frame = &problem.frame;
    let velocity = velocity_of(spec);
    let position = if roles.angle.is_some() {
        Some("angle".to_string())
    } else {
        velocity.as_ref().map(|_| "integ(velocity)".to_string())
    };
    let deadband = roles.velocity.as_ref().map_or(0.0, |v| v.deadband);
    let span = frame
        .sequences()
        .iter()
        .map(|r| frame.time()[r.end - 1] - frame.time()[r.start])
        .fold(0.0, f64::max);
    let varies = |n: &String| {
        frame
            .column(n)
            .is_some_and(|c| c.iter().any(|x| *x != c[0]))
    };
    let mut columns: Vec<String> = model
        .terms
        .iter()
        .flat_map(|t| t.expr.names())
        .filter(|n| n != "time" && n != "elapsed" && varies(n))
        .collect();
    columns.sort();
    columns.dedup();
    let friction = velocity
        .as_ref()
        .is_some_and(|v| model.terms.iter().any(|t| dry_friction(&t.expr, v)));
    Context {
        problem,
        spec,
        load: load.to_string(),
        residual: &fit.residual,
        columns,
        friction,
        velocity,
        deadband,
        position,
        dt: frame.step(),
        span,
    }
}

/// Variants of every effect that the model file allows.
pub(crate) fn variants(ctx: &Context, allowed: &(dyn Fn(EffectRef) -> bool + Sync)) -> Vec<Offer> {
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

/// What one step of the search saw.
pub(crate) struct Step {
    /// Best candidate of each effect, best first.
    pub ranked: Vec<Candidate>,
    /// Index into `ranked` of the candidate to take.
    pub winner: Option<usize>,
    /// Indices of all that count, best first.
    pub good: Vec<usize>,
}

/// Whether a candidate may count at all.
pub(crate) fn passes<O>(
    c: &Candidate<O>,
    spec: &Spec,
    tests: usize,
    floor: f64,
    rows: usize,
) -> bool {
    let rms = ((c.base - c.held).max(0.0) / rows.max(1) as f64).sqrt();
    c.gain >= spec.selection.material
        && c.p * tests as f64 <= spec.selection.fdr
        && c.steady
        && rms > floor
}

/// Ranks a scan: one candidate per effect, the simplest of its variants that does nearly as well.
pub(crate) fn rank(
    all: Vec<Candidate>,
    spec: &Spec,
    tests: usize,
    floor: f64,
    rows: usize,
) -> Step {
    let mut ranked: Vec<Candidate> = Vec::new();
    let mut names: Vec<&str> = all.iter().map(|c| c.origin.name()).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let mut own: Vec<&Candidate> = all.iter().filter(|c| c.origin.name() == name).collect();
        own.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let Some(best) = own.first().copied() else {
            continue;
        };
        let pick = own
            .iter()
            .copied()
            .filter(|c| stands_for(c, best))
            .min_by(|a, b| {
                a.parameters
                    .cmp(&b.parameters)
                    .then(b.gain.total_cmp(&a.gain))
            });
        ranked.push(pick.unwrap_or(best).clone());
    }
    ranked.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let good: Vec<usize> = (0..ranked.len())
        .filter(|&i| passes(&ranked[i], spec, tests, floor, rows))
        .collect();
    let winner = good.first().map(|&best| {
        good.iter()
            .copied()
            .filter(|&i| stands_for(&ranked[i], &ranked[best]))
            .min_by(|a, b| {
                ranked[*a]
                    .parameters
                    .cmp(&ranked[*b].parameters)
                    .then(ranked[*b].gain.total_cmp(&ranked[*a].gain))
            })
            .unwrap_or(best)
    });
    Step {
        ranked,
        winner,
        good,
    }
}

/// Whether `simple` explains what `best` explains: all but 3 % of it, or nearly so
/// without a steady difference.
fn stands_for(simple: &Candidate, best: &Candidate) -> bool {
    if simple.parameters >= best.parameters && simple.origin.kind() != best.origin.kind() {
        // With as many parameters the better fit is the better claim.
        return simple.held <= best.held;
    }
    let lost = (simple.held - best.held) / (best.base - best.held).max(f64::MIN_POSITIVE);
    lost < 0.03 || (lost < 0.15 && steadiness(&simple.losses, &best.losses) < 1.5)
}

/// Rivals that the data cannot tell from the winner: as many parameters, the same curve, no steady
/// difference.
pub(crate) fn indistinguishable(state: &State, step: &Step, winner: usize) -> Vec<Candidate> {
    let w = &step.ranked[winner];
    let own = state.contribution(w);
    if own.is_empty() {
        return vec![];
    }
    step.ranked
        .iter()
        .enumerate()
        .filter(|(i, c)| *i != winner && c.parameters <= w.parameters && c.gain > 0.0)
        .filter(|(_, c)| {
            (c.held - w.held).abs() < 0.05 * (w.base - w.held)
                && steadiness(&c.losses, &w.losses).abs() < 2.5
        })
        .filter(|(_, c)| !same_formula(w, c))
        .filter(|(_, c)| {
            let other = state.contribution(c);
            similarity(&own, &other) > 0.98
        })
        .map(|(_, c)| c.clone())
        .collect()
}

/// Whether two candidates are one formula under two names, as Dahl's friction over a short distance
/// (presliding) and a longer one (hysteresis): then the fitted distance decides on the name.
fn same_formula(a: &Candidate, b: &Candidate) -> bool {
    let text = |c: &Candidate, psi: f64| match (c.variant.build)(psi) {
        Build::Add(p) => p.into_iter().map(|p| p.text).collect(),
        _ => vec![],
    };
    let (own, other) = (text(a, a.psi), text(b, a.psi));
    a.variant.psi.is_some() && !own.is_empty() && own == other
}

/// Squared correlation about zero.
pub(crate) fn similarity(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return 0.0;
    }
    let (aa, bb, ab) = (
        crate::linalg::dot(a, a),
        crate::linalg::dot(b, b),
        crate::linalg::dot(a, b),
    );
    if aa > 0.0 && bb > 0.0 {
        ab * ab / (aa * bb)
    } else {
        0.0
    }
}

/// Turns a candidate into a choice.
pub(crate) fn choose(c: &Candidate) -> Chosen {
    Chosen {
        effect: c.origin,
        variant: c.variant.clone(),
        psi: c.psi,
    }
}
