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
pub fn each<T: Send>(rows: usize, items: Vec<T>, work: impl Fn(T) + Send + Sync) {
    match shared(rows) {
        true => items.into_par_iter().for_each(work),
        false => items.into_iter().for_each(work),
    }
}

/// A function of each value.
pub fn map(values: &[f64], f: impl Fn(f64) -> f64 + Send + Sync) -> Vec<f64> {
    match shared(values.len()) {
        true => {
            let chunks = values.par_iter().with_min_len(CHUNK);
            chunks.map(|x| f(*x)).collect()
        }
        false => values.iter().map(|x| f(*x)).collect(),
    }
}

/// A function of each two values.
pub fn zip(a: &[f64], b: &[f64], f: impl Fn(f64, f64) -> f64 + Send + Sync) -> Vec<f64> {
    match shared(a.len()) {
        true => {
            let chunks = a.par_iter().with_min_len(CHUNK);
            chunks.zip(b).map(|(x, y)| f(*x, *y)).collect()
        }
        false => a.iter().zip(b).map(|(x, y)| f(*x, *y)).collect(),
    }
}

/// Puts a function of each value and another one in its place.
pub fn combine(values: &mut [f64], other: &[f64], f: impl Fn(&mut f64, f64) + Send + Sync) {
    let one = |(x, y): (&mut f64, &f64)| f(x, *y);
    match shared(values.len()) {
        true => {
            let chunks = values.par_iter_mut().with_min_len(CHUNK);
            chunks.zip(other).for_each(one);
        }
        false => values.iter_mut().zip(other).for_each(one),
    }
}

/// Puts a function of each value in its place.
pub fn change(values: &mut [f64], f: impl Fn(f64) -> f64 + Send + Sync) {
    let one = |x: &mut f64| *x = f(*x);
    match shared(values.len()) {
        true => values.par_iter_mut().with_min_len(CHUNK).for_each(one),
        false => values.iter_mut().for_each(one),
    }
}

/// Sorts; what is equal keeps its order.
pub fn sort<T: Send>(values: &mut [T], order: impl Fn(&T, &T) -> Ordering + Sync) {
    match shared(values.len()) {
        true => values.par_sort_by(order),
        false => values.sort_by(order),
    }
}
