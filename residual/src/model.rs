//! The model in work: declared terms plus the effects chosen so far, and its fit.

use crate::effects::{Build, EffectRef, Variant};
use crate::error::Error;
use crate::expr::Expr;
use crate::problem::{Column, Problem, Replaced, Scores, Sums, View};
use crate::spec::Spec;
use std::sync::Arc;

/// One term in work.
#[derive(Debug, Clone)]
pub(crate) struct WorkTerm {
    pub name: String,
    pub expr: Expr,
    pub unit: String,
    pub fixed: Option<f64>,
    /// Index of the chosen effect that added it; `None` for declared terms.
    pub chosen: Option<usize>,
    /// Whether every sequence has its own coefficient.
    pub local: bool,
}

/// An effect in the model.
#[derive(Clone)]
pub(crate) struct Chosen {
    pub effect: EffectRef,
    pub variant: Arc<Variant>,
    pub psi: f64,
}

fn parsed(pairs: &[(String, String)]) -> Result<Replaced, Error> {
    pairs
        .iter()
        .map(|(n, t)| Ok((n.clone(), Expr::parse(t)?)))
        .collect()
}

fn replace(expr: &Expr, pairs: &Replaced) -> Expr {
    expr.substitute(&|n| {
        pairs
            .iter()
            .find(|(name, _)| name == n)
            .map(|(_, e)| e.clone())
    })
}

/// Terms of declared model and chosen effects.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    pub terms: Vec<WorkTerm>,
    /// Columns that chosen effects replaced in everything, in terms that come later as well. The
    /// terms are written without it; see [`Model::written_out`].
    pub replaced: Vec<Replaced>,
}

impl Model {
    /// The declared model.
    pub fn declared(spec: &Spec) -> Result<Model, Error> {
        let terms = spec
            .terms
            .iter()
            .map(|t| {
                Ok(WorkTerm {
                    name: t.name.clone(),
                    expr: Expr::parse(&t.expr)?,
                    unit: t.unit.clone(),
                    fixed: t.fixed,
                    chosen: None,
                    local: t.per == "sequence",
                })
            })
            .collect::<Result<_, Error>>()?;
        Ok(Model {
            terms,
            replaced: vec![],
        })
    }

    /// A term in the columns of the log, whatever was replaced.
    pub fn written_out(&self, expr: &Expr) -> Expr {
        self.replaced
            .iter()
            .rev()
            .fold(expr.clone(), |e, pairs| replace(&e, pairs))
    }

    /// Adds one effect at `psi`, as choice number `index`.
    pub fn apply(&mut self, build: &Build, index: usize) -> Result<(), Error> {
        match build {
            Build::Add(pieces) | Build::Local(pieces) => {
                for p in pieces {
                    self.terms.push(WorkTerm {
                        name: p.name.clone(),
                        expr: Expr::parse(&p.text)?,
                        unit: p.unit.clone(),
                        fixed: None,
                        chosen: Some(index),
                        local: matches!(build, Build::Local(_)),
                    });
                }
            }
            Build::Swap(pairs) => {
                let pairs = parsed(pairs)?;
                for t in self.terms.iter_mut().filter(|t| t.chosen.is_none()) {
                    t.expr = replace(&t.expr, &pairs);
                }
            }
            Build::SwapAll(pairs) => self.replaced.push(parsed(pairs)?),
        }
        Ok(())
    }

    /// Text that is the same for equal models.
    pub fn key(&self) -> String {
        let terms = self.terms.iter();
        let replaced = self.replaced.iter().flatten();
        terms
            .map(|t| format!("{} {:?} {}\n", t.expr, t.fixed, t.local))
            .chain(replaced.map(|(n, e)| format!("{n} = {e}\n")))
            .collect()
    }

    /// The declared model with chosen effects.
    pub fn with(spec: &Spec, chosen: &[Chosen]) -> Result<Model, Error> {
        let mut m = Model::declared(spec)?;
        for (i, c) in chosen.iter().enumerate() {
            m.apply(&(c.variant.build)(c.psi), i)?;
        }
        Ok(m)
    }
}

/// A fitted model.
pub(crate) struct Fit {
    /// The columns as the model sees them.
    pub view: Arc<View>,
    /// Index of each fitted global term.
    pub free: Vec<usize>,
    /// Columns of the fitted global terms.
    pub x: Vec<Column>,
    /// Coefficients of `free` on all rows.
    pub theta: Vec<f64>,
    /// Fitted terms that repeat others.
    pub dropped: Vec<bool>,
    /// Sums with the residual as flipped target.
    pub sums: Sums,
    /// In-sample prediction of the global terms.
    pub prediction: Vec<f64>,
    /// In-sample residual.
    pub residual: Vec<f64>,
    /// Held-out residual, row by row.
    pub held: Vec<f64>,
    /// Scores of `sums`: what a candidate must beat.
    pub scores: Scores,
    /// Amplitude-like RMS of each local term's coefficients over sequences.
    pub local: Vec<(usize, f64)>,
}

impl Fit {
    /// Fits and holds out.
    pub fn new(p: &Problem, model: &Model) -> Result<Fit, Error> {
        let n = p.y.len();
        let view = p.view(&model.replaced)?;
        let mut fixed = vec![0.0; n];
        let (mut free, mut x, mut local_terms, mut lx) = (vec![], vec![], vec![], vec![]);
        for (i, t) in model.terms.iter().enumerate() {
            let v = p.eval(&view, &t.expr)?;
            match (t.fixed, t.local) {
                (Some(k), _) => fixed
                    .iter_mut()
                    .zip(v.iter())
                    .for_each(|(f, v)| *f += k * v),
                (None, false) => {
                    free.push(i);
                    x.push(v);
                }
                (None, true) => {
                    local_terms.push(i);
                    lx.push(v);
                }
            }
        }
        let y0: Vec<f64> = p.y.iter().zip(&fixed).map(|(y, f)| y - f).collect();
        let cols: Vec<&[f64]> = x.iter().map(|c| c.as_slice()).collect();
        let raw = Sums::new(p, &cols, &y0, None, None);
        let (theta, dropped) = raw.fit(None);
        let predict = |theta: &[f64], range: std::ops::Range<usize>, out: &mut [f64]| {
            for (c, k) in cols.iter().zip(theta) {
                if *k != 0.0 {
                    out[range.clone()]
                        .iter_mut()
                        .zip(&c[range.clone()])
                        .for_each(|(o, v)| *o -= k * v);
                }
            }
        };
        let mut residual = y0.clone();
        predict(&theta, 0..n, &mut residual);
        let prediction = p.y.iter().zip(&residual).map(|(y, r)| y - r).collect();
        let mut held = y0;
        for f in 0..p.folds {
            let w: Vec<f64> = p
                .blocks
                .iter()
                .map(|b| if b.fold == f { 0.0 } else { 1.0 })
                .collect();
            let (t, _) = raw.fit(Some(&w));
            for b in p.blocks.iter().filter(|b| b.fold == f) {
                predict(&t, b.range.clone(), &mut held);
            }
        }
        let mut local = Vec::new();
        if !lx.is_empty() {
            let lcols: Vec<&[f64]> = lx.iter().map(|c: &Column| c.as_slice()).collect();
            let mut sums2 = vec![0.0; lx.len()];
            let mut weight = 0.0;
            // Held-out by halves of each sequence; in-sample by the whole.
            for (values, halves) in [(&mut held, true), (&mut residual, false)] {
                let s = Sums::new(p, &lcols, values, None, None);
                let mut start = 0;
                while start < p.blocks.len() {
                    let seq = p.blocks[start].sequence;
                    let end = start
                        + p.blocks[start..]
                            .iter()
                            .take_while(|b| b.sequence == seq)
                            .count();
                    for half in 0..if halves { 2 } else { 1 } {
                        let w: Vec<f64> = (0..p.blocks.len())
                            .map(|k| {
                                if k >= start && k < end && (!halves || (k - start) % 2 != half) {
                                    1.0
                                } else {
                                    0.0
                                }
                            })
                            .collect();
                        let (t, _) = s.fit(Some(&w));
                        for k in start..end {
                            if !halves || (k - start) % 2 == half {
                                let r = p.blocks[k].range.clone();
                                for (c, a) in lcols.iter().zip(&t) {
                                    values[r.clone()]
                                        .iter_mut()
                                        .zip(&c[r.clone()])
                                        .for_each(|(o, v)| *o -= a * v);
                                }
                            }
                        }
                        if !halves {
                            let rows =
                                (p.blocks[end - 1].range.end - p.blocks[start].range.start) as f64;
                            sums2
                                .iter_mut()
                                .zip(&t)
                                .for_each(|(s, t)| *s += rows * t * t);
                            weight += rows;
                        }
                    }
                    start = end;
                }
            }
            local = local_terms
                .iter()
                .zip(&sums2)
                .map(|(i, s)| (*i, (s / f64::max(weight, 1.0)).sqrt()))
                .collect();
        }
        let sums = Sums::new(p, &cols, &residual, None, None);
        let scores = Scores::new(p, &sums);
        Ok(Fit {
            view,
            free,
            x,
            prediction,
            theta,
            dropped,
            sums,
            residual,
            held,
            scores,
            local,
        })
    }

    /// The same fit with another residual in its place.
    pub fn on(&self, residual: Vec<f64>, sums: Sums, scores: Scores) -> Fit {
        Fit {
            view: self.view.clone(),
            free: self.free.clone(),
            x: self.x.clone(),
            prediction: self.prediction.clone(),
            theta: self.theta.clone(),
            dropped: self.dropped.clone(),
            sums,
            residual,
            held: vec![],
            scores,
            local: vec![],
        }
    }
}
