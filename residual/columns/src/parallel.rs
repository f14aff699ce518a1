//! Work on many rows, shared among threads where the calling thread would be alone.
//!
//! Inside a scan all threads are busy with forms of their own. There nothing is shared: a thread
//! that waits for others would begin with another form meanwhile, and the columns of both would be
//! in memory.

use rayon::prelude::*;
use std::cmp::Ordering;

/// Rows from which on it pays to share.
const WORTH: usize = 50_000;

/// Rows that one thread takes at a time.
const CHUNK: usize = 16_384;

/// Whether work on some rows is shared.
fn shared(rows: usize) -> bool {
    rows >= WORTH && rayon::current_thread_index().is_none()
}

/// Does `work` on each item of a list that stands for some rows in all.
pub fn each<T: Send>(rows: usize, items: Vec<T>, work: impl Fn(T) + Sync) {
    // By reference, as in `pieces`.
    let work: &(dyn Fn(T) + Sync) = &work;
    match shared(rows) {
        true => items.into_par_iter().for_each(work),
        false => items.into_iter().for_each(work),
    }
}

/// Does `work` on pieces of a column; it also gets the row where a piece begins.
///
/// Not generic: rayon's machinery, once for each of some 200 functions of a row, was more than half
/// of this package's compile time, and four fifths of its library.
fn pieces(values: &mut [f64], work: &(dyn Fn(usize, &mut [f64]) + Sync)) {
    match shared(values.len()) {
        true => {
            let pieces = values.par_chunks_mut(CHUNK).enumerate();
            pieces.for_each(|(n, piece)| work(n * CHUNK, piece));
        }
        false => work(0, values),
    }
}

/// A function of each value.
pub fn map(values: &[f64], f: impl Fn(f64) -> f64 + Sync) -> Vec<f64> {
    let mut out = vec![0.0; values.len()];
    pieces(&mut out, &|from, piece| {
        for (out, x) in piece.iter_mut().zip(&values[from..]) {
            *out = f(*x);
        }
    });
    out
}

/// A function of each two values.
pub fn zip(a: &[f64], b: &[f64], f: impl Fn(f64, f64) -> f64 + Sync) -> Vec<f64> {
    let mut out = vec![0.0; a.len().min(b.len())];
    pieces(&mut out, &|from, piece| {
        for (out, (x, y)) in piece.iter_mut().zip(a[from..].iter().zip(&b[from..])) {
            *out = f(*x, *y);
        }
    });
    out
}

/// Puts a function of each value and another one in its place.
pub fn combine(values: &mut [f64], other: &[f64], f: impl Fn(&mut f64, f64) + Sync) {
    let both = values.len().min(other.len());
    pieces(&mut values[..both], &|from, piece| {
        for (x, y) in piece.iter_mut().zip(&other[from..]) {
            f(x, *y);
        }
    });
}

/// Puts a function of each value in its place.
pub fn change(values: &mut [f64], f: impl Fn(f64) -> f64 + Sync) {
    pieces(values, &|_, piece| {
        for x in piece {
            *x = f(*x);
        }
    });
}

/// Sorts; what is equal keeps its order.
pub fn sort<T: Send>(values: &mut [T], order: impl Fn(&T, &T) -> Ordering + Sync) {
    match shared(values.len()) {
        true => values.par_sort_by(order),
        false => values.sort_by(order),
    }
}
