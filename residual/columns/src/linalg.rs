//! Least squares from sums of products.
//!
//! All fits of the search work on Gram matrices summed per block, so a fit on "all groups but one"
//! costs nothing that grows with the rows.

/// Solves `G x = b` for several right-hand sides by Cholesky factors of the matrix scaled to unit
/// diagonal. Columns whose remaining pivot falls below `tol` are left out (coefficient 0).
#[derive(Debug, Clone)]
pub struct Cholesky {
    n: usize,
    scale: Vec<f64>,
    lower: Vec<f64>,
    /// Columns that carry nothing beyond the columns before them.
    pub dropped: Vec<bool>,
}

impl Cholesky {
    /// Factors the symmetric `g` (row-major, `n` x `n`).
    pub fn new(g: &[f64], n: usize, tol: f64) -> Cholesky {
        let scale: Vec<f64> = (0..n)
            .map(|i| {
                let d = g[i * n + i];
                if d > 0.0 && d.is_finite() {
                    1.0 / d.sqrt()
                } else {
                    0.0
                }
            })
            .collect();
        let mut l = vec![0.0; n * n];
        let mut dropped = vec![false; n];
        for j in 0..n {
            let mut d = if scale[j] > 0.0 { 1.0 } else { 0.0 };
            for k in 0..j {
                d -= l[j * n + k] * l[j * n + k];
            }
            if d <= tol {
                dropped[j] = true;
                continue;
            }
            let d = d.sqrt();
            l[j * n + j] = d;
            for i in j + 1..n {
                let mut s = g[i * n + j] * scale[i] * scale[j];
                for k in 0..j {
                    s -= l[i * n + k] * l[j * n + k];
                }
                l[i * n + j] = s / d;
            }
        }
        Cholesky {
            n,
            scale,
            lower: l,
            dropped,
        }
    }

    /// Solves for one right-hand side.
    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.n];
        self.solve_into(b, &mut x);
        x
    }

    /// The same into a buffer of the matrix's size.
    pub fn solve_into(&self, b: &[f64], x: &mut [f64]) {
        let n = self.n;
        let l = &self.lower;
        for i in 0..n {
            if self.dropped[i] {
                x[i] = 0.0;
                continue;
            }
            let mut s = b[i] * self.scale[i];
            for k in 0..i {
                s -= l[i * n + k] * x[k];
            }
            x[i] = s / l[i * n + i];
        }
        for i in (0..n).rev() {
            if self.dropped[i] {
                x[i] = 0.0;
                continue;
            }
            let mut s = x[i];
            for k in i + 1..n {
                s -= l[k * n + i] * x[k];
            }
            x[i] = s / l[i * n + i];
        }
        x.iter_mut().zip(&self.scale).for_each(|(x, s)| *x *= s);
    }
}

/// `y'y - 2 x'b + x'Gx`: squared error of coefficients `x` on data with these sums.
pub fn squared_error(g: &[f64], b: &[f64], yy: f64, x: &[f64]) -> f64 {
    let n = x.len();
    let mut s = yy;
    for i in 0..n {
        let mut gx = 0.0;
        for j in 0..n {
            gx += g[i * n + j] * x[j];
        }
        s += x[i] * (gx - 2.0 * b[i]);
    }
    s.max(0.0)
}

/// Four-way unrolled dot product (the compiler vectorises it).
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut s = [0.0f64; 8];
    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = ca
        .remainder()
        .iter()
        .zip(cb.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in ca.zip(cb) {
        for k in 0..8 {
            s[k] += x[k] * y[k];
        }
    }
    s.iter().sum::<f64>() + tail
}

/// Squared correlation about zero; 0 for values of different lengths.
pub fn similarity(a: &[f64], b: &[f64]) -> f64 {
    if a.len() != b.len() {
        return 0.0;
    }
    let (aa, bb, ab) = (dot(a, a), dot(b, b), dot(a, b));
    if aa > 0.0 && bb > 0.0 {
        ab * ab / (aa * bb)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_and_leaves_out_what_repeats() {
        // Columns a, b, a + b over three rows.
        let (a, b) = ([1.0, 2.0, 3.0], [1.0, 0.0, -1.0]);
        let c: Vec<f64> = a.iter().zip(&b).map(|(x, y)| x + y).collect();
        let cols = [&a[..], &b[..], &c[..]];
        let g: Vec<f64> = cols
            .iter()
            .flat_map(|x| cols.iter().map(|y| dot(x, y)))
            .collect();
        let y: Vec<f64> = a.iter().zip(&b).map(|(x, z)| 2.0 * x - z).collect();
        let rhs: Vec<f64> = cols.iter().map(|x| dot(x, &y)).collect();
        let f = Cholesky::new(&g, 3, 1e-10);
        assert_eq!(f.dropped, [false, false, true]);
        let x = f.solve(&rhs);
        assert!((x[0] - 2.0).abs() < 1e-12 && (x[1] + 1.0).abs() < 1e-12 && x[2] == 0.0);
        assert!(squared_error(&g, &rhs, dot(&y, &y), &x) < 1e-12);
    }
}
