//! Held-out errors of one fit, for the residual and for every decoy.

use super::sums::{Sums, RANK_TOL};
use super::Problem;
use residual_columns::linalg::{squared_error, Cholesky};

/// Squared errors of one fit by target (0 the real one, then decoys) and fold.
#[derive(Debug, Clone)]
pub struct Scores {
    /// Number of folds.
    pub folds: usize,
    /// Errors on the rows that were fitted to, by target and fold.
    pub train: Vec<f64>,
    /// Errors on the fold that was held out, by target and fold.
    pub held: Vec<f64>,
}

impl Scores {
    /// Leave-one-fold-out errors for the real residual and every decoy, given by its signs.
    pub fn new(p: &Problem, s: &Sums, decoys: &[Vec<f64>]) -> Scores {
        let (q, folds) = (s.q, p.folds);
        let targets = decoys.len() + 1;
        let mut g = vec![vec![0.0; q * q]; folds];
        for (k, b) in p.blocks.iter().enumerate() {
            g[b.fold]
                .iter_mut()
                .zip(&s.g[k * q * q..])
                .for_each(|(a, x)| *a += x);
        }
        let mut total = vec![0.0; q * q];
        g.iter()
            .for_each(|f| total.iter_mut().zip(f).for_each(|(a, x)| *a += x));
        let factors: Vec<(Vec<f64>, Cholesky)> = g
            .iter()
            .map(|f| {
                let train: Vec<f64> = total.iter().zip(f).map(|(t, x)| t - x).collect();
                let c = Cholesky::new(&train, q, RANK_TOL);
                (train, c)
            })
            .collect();
        let mut out = Scores {
            folds,
            train: Vec::with_capacity(targets * folds),
            held: Vec::with_capacity(targets * folds),
        };
        let mut b = vec![0.0; folds * q];
        let mut yy = vec![0.0; folds];
        let (mut tb, mut bt, mut x) = (vec![0.0; q], vec![0.0; q], vec![0.0; q]);
        for j in 0..targets {
            b.fill(0.0);
            yy.fill(0.0);
            for (k, block) in p.blocks.iter().enumerate() {
                let sign = if j == 0 { 1.0 } else { decoys[j - 1][k] };
                let f = block.fold;
                yy[f] += s.rhs(k, sign, &mut b[f * q..(f + 1) * q]);
            }
            tb.fill(0.0);
            for f in 0..folds {
                tb.iter_mut().zip(&b[f * q..]).for_each(|(a, x)| *a += x);
            }
            let tyy: f64 = yy.iter().sum();
            for f in 0..folds {
                let own = &b[f * q..(f + 1) * q];
                for ((d, t), o) in bt.iter_mut().zip(&tb).zip(own) {
                    *d = t - o;
                }
                factors[f].1.solve_into(&bt, &mut x);
                out.train
                    .push(squared_error(&factors[f].0, &bt, tyy - yy[f], &x));
                out.held.push(squared_error(&g[f], own, yy[f], &x));
            }
        }
        out
    }

    /// Errors of coefficients that every sequence has for itself: each half of its blocks (odd,
    /// even) is predicted from the other half, so a phase of its own brings no gain by itself.
    pub fn local(p: &Problem, s: &Sums, decoys: &[Vec<f64>]) -> Scores {
        let (q, targets) = (s.q, decoys.len() + 1);
        let mut out = Scores {
            folds: 1,
            train: vec![],
            held: vec![],
        };
        let runs = p.runs();
        for j in 0..targets {
            let (mut train, mut held) = (0.0, 0.0);
            for run in &runs {
                let mut g = vec![vec![0.0; q * q]; 2];
                let mut b = vec![vec![0.0; q]; 2];
                let mut yy = [0.0; 2];
                for (i, k) in run.clone().enumerate() {
                    let half = i % 2;
                    let sign = if j == 0 { 1.0 } else { decoys[j - 1][k] };
                    g[half]
                        .iter_mut()
                        .zip(&s.g[k * q * q..])
                        .for_each(|(a, x)| *a += x);
                    yy[half] += s.rhs(k, sign, &mut b[half]);
                }
                for half in 0..2 {
                    let x = Cholesky::new(&g[1 - half], q, RANK_TOL).solve(&b[1 - half]);
                    train += squared_error(&g[1 - half], &b[1 - half], yy[1 - half], &x);
                    held += squared_error(&g[half], &b[half], yy[half], &x);
                }
            }
            out.train.push(train);
            out.held.push(held);
        }
        out
    }

    /// Held-out squared error of target `j`.
    pub fn held_total(&self, j: usize) -> f64 {
        self.held[j * self.folds..(j + 1) * self.folds].iter().sum()
    }

    /// In-sample squared error of the real target (training errors summed over folds).
    pub fn train_total(&self) -> f64 {
        self.train[..self.folds].iter().sum()
    }
}

/// The best nonlinear parameter is chosen on the training folds of each target separately, so the
/// held-out error includes the search. Returns held-out errors by target and the
/// choice of each fold for the real target.
pub fn profile(points: &[&Scores]) -> (Vec<f64>, Vec<usize>) {
    let Some(first) = points.first() else {
        return (vec![], vec![]);
    };
    let folds = first.folds;
    let mut held = vec![0.0; first.held.len() / folds];
    let mut choice = vec![0; folds];
    for (j, held) in held.iter_mut().enumerate() {
        for (f, choice) in choice.iter_mut().enumerate() {
            let at = j * folds + f;
            let best = (0..points.len())
                .min_by(|a, b| points[*a].train[at].total_cmp(&points[*b].train[at]))
                .unwrap_or(0);
            *held += points[best].held[at];
            if j == 0 {
                *choice = best;
            }
        }
    }
    (held, choice)
}
