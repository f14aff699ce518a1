//! The regression problem: kept rows in blocks, blocks in folds, and decoys of the residual.
//!
//! A *block* is a stretch of one sequence inside one fold, long against the correlation time of the
//! residual where the data allow it. Blocks are what the bootstrap draws and what decoys flip:
//! residual times a random sign per block keeps colour, amplitude and quantisation of the residual
//! and breaks every lasting relation to the signals. All sums of products are kept per block, so a
//! decoy costs a few additions per block instead of a pass over the rows.

use crate::error::Error;
use crate::expr::Expr;
use crate::frame::Frame;
use crate::linalg::{dot, squared_error, Cholesky};
use crate::progress::Ticker;
use crate::stats::{self, Rng};
use std::collections::{HashMap, VecDeque};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Values of an expression on the kept rows.
pub(crate) type Column = Arc<Vec<f64>>;

/// Most values that evaluated expressions may keep in memory (8 bytes each).
const CACHE_VALUES: usize = 1 << 25;

/// Views that are kept: the model's, and those of models without one of its effects.
const VIEWS: usize = 4;

/// Columns and the expressions that stand in their place.
pub(crate) type Replaced = Vec<(String, Expr)>;

/// The columns as a model sees them: some are replaced in every term, found or yet to be found.
#[derive(Debug)]
pub(crate) struct View {
    key: String,
    pub frame: Frame,
}

/// Expressions that were evaluated already: the same forms come up in every scan.
#[derive(Debug, Default)]
struct Cache {
    /// Values by view and text, with the scan that used them last.
    columns: HashMap<String, (Column, usize)>,
    values: usize,
    ranges: HashMap<String, Option<(f64, f64)>>,
    views: VecDeque<Arc<View>>,
    scan: usize,
    /// The scan in which room was made last.
    swept: usize,
}

impl Cache {
    /// Whether there is room for a column, after forgetting what this scan did not ask for.
    fn room(&mut self, values: usize) -> bool {
        if self.values + values > CACHE_VALUES && self.swept < self.scan {
            self.swept = self.scan;
            let scan = self.scan;
            self.columns.retain(|_, (_, used)| *used == scan);
            self.values = self.columns.values().map(|(v, _)| v.len()).sum();
        }
        self.values + values <= CACHE_VALUES
    }
}

/// A stretch of kept rows of one sequence and one fold.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    pub range: Range<usize>,
    pub fold: usize,
    pub sequence: usize,
}

/// Kept rows with their hold-out structure.
pub(crate) struct Problem {
    pub frame: Frame,
    /// The frame as it is.
    pub plain: Arc<View>,
    /// Frame rows that are fitted; `None` when all are.
    rows: Option<Vec<usize>>,
    /// Target on kept rows.
    pub y: Vec<f64>,
    pub blocks: Vec<Block>,
    pub folds: usize,
    /// Signs by decoy and block.
    pub flips: Vec<Vec<f64>>,
    fold_of_row: Vec<u32>,
    seed: u64,
    cache: Mutex<Cache>,
    /// Told how far a scan is.
    pub ticker: Option<Ticker>,
}

/// Relative pivot below which a column counts as a repetition of others.
pub(crate) const RANK_TOL: f64 = 1e-9;

impl Problem {
    /// Builds the problem; `correlation` is the correlation time of the residual in rows.
    pub fn new(frame: Frame, keep: &[bool], fold: &[u32], decoys: usize, seed: u64) -> Problem {
        let all = keep.iter().all(|k| *k);
        let rows: Vec<usize> = (0..frame.len()).filter(|&i| keep[i]).collect();
        let target = frame.column("target").unwrap_or(&[]);
        let y: Vec<f64> = rows.iter().map(|&i| target[i]).collect();
        let folds = fold
            .iter()
            .zip(keep)
            .filter(|(_, k)| **k)
            .map(|(f, _)| *f as usize + 1)
            .max()
            .unwrap_or(1);
        let fold_of_row: Vec<u32> = rows.iter().map(|&i| fold[i]).collect();
        let mut p = Problem {
            plain: Arc::new(View {
                key: String::new(),
                frame: frame.clone(),
            }),
            frame,
            rows: (!all).then_some(rows),
            y,
            blocks: vec![],
            folds,
            flips: vec![],
            fold_of_row,
            seed,
            cache: Mutex::default(),
            ticker: None,
        };
        p.cut_blocks(10.0, decoys);
        p
    }

    /// Cuts blocks of about ten correlation times, between 32 and 256 blocks overall if the rows
    /// allow, and at least four in each long run of one fold where there are few runs.
    pub fn cut_blocks(&mut self, correlation: f64, decoys: usize) {
        let n = self.y.len();
        let wanted = (10.0 * correlation)
            .clamp(n as f64 / 256.0, n as f64 / 40.0)
            .max(8.0) as usize;
        self.blocks.clear();
        let runs = 1 + self
            .fold_of_row
            .windows(2)
            .filter(|w| w[0] != w[1])
            .count()
            .max(self.frame.sequences().len());
        let least = if runs >= 32 { 1.0 } else { 4.0 };
        let mut at = 0;
        for (si, r) in self.frame.sequences().iter().enumerate() {
            let count = match &self.rows {
                None => r.len(),
                Some(rows) => rows[at..].iter().take_while(|&&i| i < r.end).count(),
            };
            let end = at + count;
            while at < end {
                let fold = self.fold_of_row[at];
                let run = self.fold_of_row[at..end]
                    .iter()
                    .take_while(|f| **f == fold)
                    .count();
                let pieces =
                    (run as f64 / wanted as f64)
                        .round()
                        .max(if run >= 64 { least } else { 1.0 }) as usize;
                for k in 0..pieces {
                    let (a, b) = (at + run * k / pieces, at + run * (k + 1) / pieces);
                    if b > a {
                        self.blocks.push(Block {
                            range: a..b,
                            fold: fold as usize,
                            sequence: si,
                        });
                    }
                }
                at += run;
            }
        }
        let mut rng = Rng::new(self.seed);
        self.flips = (0..decoys)
            .map(|_| (0..self.blocks.len()).map(|_| rng.sign()).collect())
            .collect();
    }

    /// Rows of a frame column that are fitted.
    pub fn gather(&self, column: Vec<f64>) -> Vec<f64> {
        match &self.rows {
            None => column,
            Some(rows) => rows.iter().map(|&i| column[i]).collect(),
        }
    }

    /// The columns with some replaced, one list after the other.
    pub fn view(&self, replaced: &[Replaced]) -> Result<Arc<View>, Error> {
        if replaced.is_empty() {
            return Ok(self.plain.clone());
        }
        let texts = replaced.iter().flatten().map(|(n, e)| format!("{n}={e};"));
        let key: String = texts.collect();
        if let Some(known) = self.cache().views.iter().find(|v| v.key == key) {
            return Ok(known.clone());
        }
        let mut frame = self.frame.clone();
        for list in replaced {
            let old = frame.clone();
            for (name, e) in list {
                frame.insert(name, e.eval(&old)?);
            }
        }
        let view = Arc::new(View { key, frame });
        let mut cache = self.cache();
        cache.views.push_back(view.clone());
        if cache.views.len() > VIEWS {
            cache.views.pop_front();
        }
        Ok(view)
    }

    /// A scan begins: what is evaluated in it is worth more room than what was asked for earlier.
    pub fn next_scan(&self) {
        self.cache().scan += 1;
    }

    /// Evaluates an expression on the kept rows, and keeps the values for the next time; values that
    /// are not finite become an error.
    pub fn eval(&self, view: &View, e: &Expr) -> Result<Column, Error> {
        self.cached(format!("{}{e}", view.key), true, || {
            self.eval_on(&view.frame, e)
        })
    }

    /// The same for an expression as text; `keep` it only if it is likely to be asked for again.
    pub fn eval_text(&self, view: &View, text: &str, keep: bool) -> Result<Column, Error> {
        self.cached(format!("{}{text}", view.key), keep, || {
            self.eval_on(&view.frame, &Expr::parse(text)?)
        })
    }

    /// The same for a term in which columns of a view are replaced; `swapped` gives the frame with
    /// them, and is asked only if the values are not at hand.
    pub fn eval_swapped<'a>(
        &self,
        view: &View,
        pairs: &[(String, String)],
        e: &Expr,
        keep: bool,
        swapped: impl FnOnce() -> Result<&'a Frame, Error>,
    ) -> Result<Column, Error> {
        self.cached(format!("{}{pairs:?}{e}", view.key), keep, || {
            self.eval_on(swapped()?, e)
        })
    }

    fn cache(&self) -> MutexGuard<'_, Cache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn cached(
        &self,
        key: String,
        keep: bool,
        values: impl FnOnce() -> Result<Column, Error>,
    ) -> Result<Column, Error> {
        let mut cache = self.cache();
        let scan = cache.scan;
        if let Some((known, used)) = cache.columns.get_mut(&key) {
            *used = scan;
            return Ok(known.clone());
        }
        drop(cache);
        let v = values()?;
        let mut cache = self.cache();
        if keep && cache.room(v.len()) && cache.columns.insert(key, (v.clone(), scan)).is_none() {
            cache.values += v.len();
        }
        Ok(v)
    }

    /// Evaluates an expression on the kept rows of a frame with other values in some columns.
    pub fn eval_on(&self, frame: &Frame, e: &Expr) -> Result<Column, Error> {
        let v = self.gather(e.eval(frame)?);
        // Zero times anything finite is zero; chunks, as a test that may stop at each value is slow.
        let finite = |c: &[f64]| c.iter().map(|x| x * 0.0).sum::<f64>() == 0.0;
        if !v.chunks(1024).all(finite) {
            let row = v.iter().position(|x| !x.is_finite()).unwrap_or(0) + 1;
            return Err(Error::Expression {
                text: e.to_string(),
                why: format!("is not finite on fitted row {row}"),
            });
        }
        Ok(Arc::new(v))
    }

    /// 2 % and 98 % quantiles of an expression; `None` if they are equal or it cannot be evaluated.
    pub fn range(&self, text: &str) -> Option<(f64, f64)> {
        if let Some(known) = self.cache().ranges.get(text) {
            return *known;
        }
        let mut v = self
            .eval_text(&self.plain, text, true)
            .map_or_else(|_| vec![], |v| v.to_vec());
        v.sort_unstable_by(f64::total_cmp);
        let (lo, hi) = (
            stats::quantile_sorted(&v, 0.02),
            stats::quantile_sorted(&v, 0.98),
        );
        let range = (hi > lo).then_some((lo, hi));
        self.cache().ranges.insert(text.to_string(), range);
        range
    }

    /// The kept rows as a frame of their own (sequences of kept runs), for tests of the residual.
    pub fn kept_frame(&self) -> Frame {
        let time = self.gather(self.frame.time().to_vec());
        let mut sequences: Vec<Range<usize>> = Vec::new();
        let mut last = usize::MAX;
        for b in &self.blocks {
            if b.sequence == last {
                if let Some(s) = sequences.last_mut() {
                    s.end = b.range.end;
                }
            } else {
                sequences.push(b.range.clone());
            }
            last = b.sequence;
        }
        Frame::new(vec![], time, sequences)
    }

    /// A smaller problem for screening: windows spread over the data, about `limit` rows in all.
    pub fn thin(&self, limit: usize) -> Option<Problem> {
        let n = self.frame.len();
        if n <= limit + limit / 2 {
            return None;
        }
        let windows: Vec<Range<usize>> = self
            .frame
            .sequences()
            .iter()
            .flat_map(|r| {
                let want = (r.len() as f64 * limit as f64 / n as f64) as usize;
                let count = (want / 4000).max(1);
                let len = want / count;
                (0..count).map(move |k| {
                    let start = r.start
                        + if count > 1 {
                            (r.len() - len) * k / (count - 1)
                        } else {
                            0
                        };
                    start..start + len
                })
            })
            .filter(|w| w.len() >= 16)
            .collect();
        let gather = |c: &[f64]| {
            windows
                .iter()
                .flat_map(|w| c[w.clone()].iter().copied())
                .collect::<Vec<f64>>()
        };
        let columns = self
            .frame
            .names()
            .iter()
            .filter(|c| *c != "time")
            .map(|c| (c.clone(), gather(self.frame.column(c).unwrap_or(&[]))))
            .collect();
        let mut at = 0;
        let sequences = windows
            .iter()
            .map(|w| {
                at += w.len();
                at - w.len()..at
            })
            .collect();
        let mut frame = Frame::new(columns, gather(self.frame.time()), sequences);
        // Time since the start of the whole sequence, not of the window.
        if let Some(e) = self.frame.column("elapsed") {
            frame.insert("elapsed", gather(e));
        }
        let mut keep_all = vec![true; n];
        let mut fold_all = vec![0u32; n];
        match &self.rows {
            None => fold_all.copy_from_slice(&self.fold_of_row),
            Some(rows) => {
                keep_all.fill(false);
                rows.iter().zip(&self.fold_of_row).for_each(|(&i, f)| {
                    keep_all[i] = true;
                    fold_all[i] = *f;
                });
            }
        }
        let keep: Vec<bool> = windows
            .iter()
            .flat_map(|w| keep_all[w.clone()].iter().copied())
            .collect();
        let fold: Vec<u32> = windows
            .iter()
            .flat_map(|w| fold_all[w.clone()].iter().copied())
            .collect();
        let present: std::collections::BTreeSet<u32> = fold
            .iter()
            .zip(&keep)
            .filter(|(_, k)| **k)
            .map(|(f, _)| *f)
            .collect();
        (present.len() >= 2).then(|| Problem {
            ticker: self.ticker.clone(),
            ..Problem::new(frame, &keep, &fold, self.flips.len(), self.seed)
        })
    }
}

/// Sums of products per block of a set of columns with a target in two parts: `r`, which decoys
/// flip, and `m`, which they don't.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    pub q: usize,
    /// Gram matrices, `q * q` per block.
    pub g: Vec<f64>,
    /// Products with `r`, `q` per block.
    pub br: Vec<f64>,
    /// Products with `m`, `q` per block; empty if there is no `m`.
    pub bm: Vec<f64>,
    /// `r'r`, `r'm`, `m'm` per block.
    pub yy: Vec<[f64; 3]>,
}

/// Sums that are known already: of the same `r` with columns of which some are wanted again.
#[derive(Clone, Copy)]
pub(crate) struct Known<'a> {
    pub sums: &'a Sums,
    /// Which of its columns each wanted column is, if any; missing entries mean none.
    pub at: &'a [Option<usize>],
}

impl Known<'_> {
    fn place(&self, i: usize) -> Option<usize> {
        self.at.get(i).copied().flatten()
    }
}

impl Sums {
    /// Sums for columns `x` with flipped target `r` and fixed target `m`; what is `known` is taken
    /// from there.
    pub fn new(
        p: &Problem,
        x: &[&[f64]],
        r: &[f64],
        m: Option<&[f64]>,
        known: Option<Known>,
    ) -> Sums {
        let q = x.len();
        let nb = p.blocks.len();
        let place: Vec<Option<(&Sums, usize)>> = (0..q)
            .map(|i| known.and_then(|k| Some((k.sums, k.place(i)?))))
            .collect();
        let mut s = Sums {
            q,
            g: vec![0.0; nb * q * q],
            br: vec![0.0; nb * q],
            bm: vec![],
            yy: vec![[0.0; 3]; nb],
        };
        if m.is_some() {
            s.bm = vec![0.0; nb * q];
        }
        for (k, b) in p.blocks.iter().enumerate() {
            let g = &mut s.g[k * q * q..(k + 1) * q * q];
            let rb = &r[b.range.clone()];
            for i in 0..q {
                let xi = &x[i][b.range.clone()];
                for j in 0..=i {
                    let v = match (place[i], place[j]) {
                        (Some((s, i)), Some((_, j))) => s.g[(k * s.q + i) * s.q + j],
                        _ => dot(xi, &x[j][b.range.clone()]),
                    };
                    g[i * q + j] = v;
                    g[j * q + i] = v;
                }
                s.br[k * q + i] = match place[i] {
                    Some((s, i)) => s.br[k * s.q + i],
                    None => dot(xi, rb),
                };
                if let Some(m) = m {
                    s.bm[k * q + i] = dot(xi, &m[b.range.clone()]);
                }
            }
            let rr = known.map_or_else(|| dot(rb, rb), |known| known.sums.yy[k][0]);
            s.yy[k] = match m {
                None => [rr, 0.0, 0.0],
                Some(m) => {
                    let mb = &m[b.range.clone()];
                    [rr, dot(rb, mb), dot(mb, mb)]
                }
            };
        }
        s
    }

    /// Right-hand side and squared size of one block under a sign of `r`.
    pub fn rhs(&self, k: usize, sign: f64, b: &mut [f64]) -> f64 {
        for (i, b) in b.iter_mut().enumerate().take(self.q) {
            *b += sign * self.br[k * self.q + i]
                + if self.bm.is_empty() {
                    0.0
                } else {
                    self.bm[k * self.q + i]
                };
        }
        let [rr, rm, mm] = self.yy[k];
        rr + 2.0 * sign * rm + mm
    }

    /// Fits on all blocks with weights (1, or bootstrap counts); returns coefficients and what was
    /// left out as repetition.
    pub fn fit(&self, weights: Option<&[f64]>) -> (Vec<f64>, Vec<bool>) {
        let q = self.q;
        let (mut g, mut b) = (vec![0.0; q * q], vec![0.0; q]);
        let mut one = vec![0.0; q];
        for k in 0..self.yy.len() {
            let w = weights.map_or(1.0, |w| w[k]);
            if w == 0.0 {
                continue;
            }
            g.iter_mut()
                .zip(&self.g[k * q * q..])
                .for_each(|(a, x)| *a += w * x);
            one.fill(0.0);
            self.rhs(k, 1.0, &mut one);
            b.iter_mut().zip(&one).for_each(|(a, x)| *a += w * x);
        }
        let c = Cholesky::new(&g, q, RANK_TOL);
        let x = c.solve(&b);
        (x, c.dropped)
    }

    /// Squared error of every block in the wanted folds, predicted from the other folds.
    pub fn hold_out(&self, p: &Problem, wanted: &dyn Fn(usize) -> bool, out: &mut [f64]) {
        for fold in (0..p.folds).filter(|f| wanted(*f)) {
            self.predict(
                p.blocks.iter().map(|b| (b.fold != fold, b.fold == fold)),
                out,
            );
        }
    }

    /// Squared error of every block, predicted from the other half (odd, even) of its sequence.
    pub fn hold_out_halves(&self, p: &Problem, out: &mut [f64]) {
        let mut start = 0;
        while start < p.blocks.len() {
            let sequence = p.blocks[start].sequence;
            for half in 0..2 {
                let uses = p.blocks.iter().enumerate().map(|(k, b)| {
                    let (own, even) = (b.sequence == sequence, (k - start.min(k)) % 2 == half);
                    (own && !even, own && even)
                });
                self.predict(uses, out);
            }
            start += p.blocks[start..]
                .iter()
                .take_while(|b| b.sequence == sequence)
                .count();
        }
    }

    /// Fits on some blocks and writes the squared errors of others; `uses` says (fit, predict).
    fn predict(&self, uses: impl Iterator<Item = (bool, bool)> + Clone, out: &mut [f64]) {
        let weights: Vec<f64> = uses
            .clone()
            .map(|(fit, _)| f64::from(u8::from(fit)))
            .collect();
        let (x, _) = self.fit(Some(&weights));
        for (k, _) in uses.enumerate().filter(|(_, (_, predict))| *predict) {
            out[k] = self.block_error(k, &x);
        }
    }

    /// Squared error of coefficients on one block.
    pub fn block_error(&self, k: usize, x: &[f64]) -> f64 {
        let mut b = vec![0.0; self.q];
        let yy = self.rhs(k, 1.0, &mut b);
        squared_error(
            &self.g[k * self.q * self.q..(k + 1) * self.q * self.q],
            &b,
            yy,
            x,
        )
    }
}

/// Squared errors of one fit by target (0 the real one, then decoys) and fold.
#[derive(Debug, Clone)]
pub(crate) struct Scores {
    pub folds: usize,
    pub train: Vec<f64>,
    pub held: Vec<f64>,
}

impl Scores {
    /// Leave-one-fold-out errors for the real residual and every decoy.
    pub fn new(p: &Problem, s: &Sums) -> Scores {
        let (q, folds, nb) = (s.q, p.folds, p.blocks.len());
        let targets = p.flips.len() + 1;
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
            for k in 0..nb {
                let sign = if j == 0 { 1.0 } else { p.flips[j - 1][k] };
                let f = p.blocks[k].fold;
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
    /// even) is predicted from the other half, so a phase of its own is no free pass.
    pub fn local(p: &Problem, s: &Sums) -> Scores {
        let (q, targets) = (s.q, p.flips.len() + 1);
        let mut out = Scores {
            folds: 1,
            train: vec![],
            held: vec![],
        };
        let mut runs: Vec<Range<usize>> = Vec::new();
        for (k, b) in p.blocks.iter().enumerate() {
            match runs.last_mut() {
                Some(r) if p.blocks[r.start].sequence == b.sequence => r.end = k + 1,
                _ => runs.push(k..k + 1),
            }
        }
        for j in 0..targets {
            let (mut train, mut held) = (0.0, 0.0);
            for run in &runs {
                let mut g = vec![vec![0.0; q * q]; 2];
                let mut b = vec![vec![0.0; q]; 2];
                let mut yy = [0.0; 2];
                for (i, k) in run.clone().enumerate() {
                    let half = i % 2;
                    let sign = if j == 0 { 1.0 } else { p.flips[j - 1][k] };
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
/// held-out error stays honest about having searched. Returns held-out errors by target and the
/// choice of each fold for the real target.
pub(crate) fn profile(points: &[&Scores]) -> (Vec<f64>, Vec<usize>) {
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

/// Correlation time of values on kept rows, in rows.
pub(crate) fn correlation_rows(p: &Problem, r: &[f64]) -> f64 {
    let frame = p.kept_frame();
    let reach = (frame.len() / 50).clamp(20, 400);
    stats::correlation_time(&stats::autocorrelation(r, &frame, reach))
}
