//! Sums of products per block: what every fit works on.

use super::Problem;
use residual_columns::linalg::{dot, squared_error, Cholesky};
use residual_columns::parallel;

/// Relative pivot below which a column counts as a repetition of others. A pressure of 101 325 Pa
/// that varies by 2 Pa has 4e-10 of its square left beside a constant; rounding leaves about 1e-15.
pub const RANK_TOL: f64 = 1e-12;

/// Sums of products per block of a set of columns with a target in two parts: `r`, which decoys
/// flip, and `m`, which they don't.
#[derive(Debug, Clone)]
pub struct Sums {
    /// Number of columns.
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

/// Sums that are known already: of the same `r`, with some of the same columns.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// The known sums.
    pub sums: &'a Sums,
    /// For each needed column its index among the known ones, if any; missing entries mean none.
    pub at: &'a [Option<usize>],
}

impl Known<'_> {
    fn place(&self, i: usize) -> Option<usize> {
        self.at.get(i).copied().flatten()
    }
}

/// Sums of products of one block, see [`Sums`].
struct Products<'a> {
    g: &'a mut [f64],
    br: &'a mut [f64],
    bm: &'a mut [f64],
    yy: &'a mut [f64; 3],
}

/// Takes values off the front of a slice.
fn take<'a>(from: &mut &'a mut [f64], count: usize) -> &'a mut [f64] {
    let (own, rest) = std::mem::take(from).split_at_mut(count);
    *from = rest;
    own
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
            bm: vec![0.0; if m.is_some() { nb * q } else { 0 }],
            yy: vec![[0.0; 3]; nb],
        };
        let blocks = s.blocks().zip(p.blocks.iter().enumerate()).collect();
        parallel::each(r.len(), blocks, |(out, (k, b)): (Products, _)| {
            let rb = &r[b.range.clone()];
            for i in 0..q {
                let xi = &x[i][b.range.clone()];
                for j in 0..=i {
                    let v = match (place[i], place[j]) {
                        (Some((s, i)), Some((_, j))) => s.g[(k * s.q + i) * s.q + j],
                        _ => dot(xi, &x[j][b.range.clone()]),
                    };
                    out.g[i * q + j] = v;
                    out.g[j * q + i] = v;
                }
                out.br[i] = match place[i] {
                    Some((s, i)) => s.br[k * s.q + i],
                    None => dot(xi, rb),
                };
                if let Some(m) = m {
                    out.bm[i] = dot(xi, &m[b.range.clone()]);
                }
            }
            let rr = known.map_or_else(|| dot(rb, rb), |known| known.sums.yy[k][0]);
            *out.yy = match m {
                None => [rr, 0.0, 0.0],
                Some(m) => {
                    let mb = &m[b.range.clone()];
                    [rr, dot(rb, mb), dot(mb, mb)]
                }
            };
        });
        s
    }

    /// The sums of each block.
    fn blocks(&mut self) -> impl Iterator<Item = Products<'_>> {
        let q = self.q;
        let with_m = if self.bm.is_empty() { 0 } else { q };
        let (mut g, mut br, mut bm) = (&mut self.g[..], &mut self.br[..], &mut self.bm[..]);
        self.yy.iter_mut().map(move |yy| Products {
            g: take(&mut g, q * q),
            br: take(&mut br, q),
            bm: take(&mut bm, with_m),
            yy,
        })
    }

    /// The sums of the same columns with another target in the place of `r`, and none that decoys
    /// don't flip.
    pub fn on(&self, p: &Problem, x: &[&[f64]], r: &[f64]) -> Sums {
        let mut out = Sums {
            bm: vec![],
            ..self.clone()
        };
        for (k, b) in p.blocks.iter().enumerate() {
            let rb = &r[b.range.clone()];
            for (i, x) in x.iter().enumerate() {
                out.br[k * self.q + i] = dot(&x[b.range.clone()], rb);
            }
            out.yy[k] = [dot(rb, rb), 0.0, 0.0];
        }
        out
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

    /// Squared error of every block in the selected folds, predicted from the other folds.
    pub fn hold_out(&self, p: &Problem, selected: &dyn Fn(usize) -> bool, out: &mut [f64]) {
        for fold in (0..p.folds).filter(|f| selected(*f)) {
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
