//! Stretches of the target that stand in several groups: parts of one log given twice do not
//! confirm each other.

use crate::finding::Findings;
use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::stats;
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Rows of the shortest stretch that is compared.
const STRETCH: usize = 32;

/// Rows of a stretch whose value differs from that before, and values that differ, from which two
/// equal stretches are no accident: a signal that stands still or moves in steps repeats itself.
const CHANGES: usize = 16;
const VALUES: usize = 8;

/// One in so many stretches is remembered, the same in equal stretches wherever they stand.
const ONE_IN: u64 = 8;

/// Share of a sequence from which equal stretches are noted.
const SHARE: f64 = 0.1;

/// Most sequences whose beginnings are compared with each other.
const MOST: usize = 200;

/// Notes sequences that have much of their target in common with another group, in the same digits
/// anywhere, or in other digits from the beginning on.
pub(super) fn note(frame: &Frame, fold: &[u32], files: &[PathBuf], log: &mut Findings) {
    let target = frame.column("target").unwrap_or(&[]);
    let (count, place) = equal(frame, target, fold);
    let (count, place) = if count > 0 {
        (count, place)
    } else {
        printed_otherwise(frame, target, fold)
    };
    let Some([a, b]) = place else {
        return;
    };
    let name = |row: usize| {
        let file = frame
            .column("file")
            .and_then(|f| files.get(f[row] as usize));
        let file = file.and_then(|f| Path::new(f).file_name());
        let file = file.map_or(String::new(), |f| format!("{}, ", f.to_string_lossy()));
        format!("{file}time {} s", num(frame.time()[row]))
    };
    log.count(
        "copied rows",
        count,
        &format!("{} and {}", name(a), name(b)),
        "rows have the target values of a stretch that is held out when they are fitted: a log is part of another, or was repeated. \
         They do not confirm each other, and the held-out error is too small; leave one of them out of --data",
    );
}

/// Rows in stretches whose target is equal in another fold, and where the first of them stand.
fn equal(frame: &Frame, target: &[f64], fold: &[u32]) -> (usize, Option<[usize; 2]>) {
    let mut first: HashMap<u64, usize> = HashMap::new();
    let (mut count, mut place) = (0, None);
    for range in frame.sequences() {
        let mut at = range.start;
        let mut done = range.start;
        let mut own = 0;
        let mut begin = None;
        while at + STRETCH <= range.end {
            let here = &target[at..at + STRETCH];
            let key = key(here);
            if !key.is_multiple_of(ONE_IN) || !is_irregular(here) {
                at += 1;
                continue;
            }
            let other = *first.entry(key).or_insert(at);
            let is_copy = fold[other] != fold[at] && target[other..other + STRETCH] == *here;
            if is_copy {
                let same = (0..)
                    .take_while(|k| {
                        at + k < range.end && other + k < at && target[at + k] == target[other + k]
                    })
                    .count();
                // What is remembered is seldom the beginning of what is equal.
                let before = (1..=(at - done).min(other))
                    .take_while(|k| {
                        target[at - k] == target[other - k] && fold[at - k] != fold[other - k]
                    })
                    .count();
                begin.get_or_insert([other - before, at - before]);
                own += before + same;
                at += same;
                done = at;
            } else {
                at += 1;
            }
        }
        if own as f64 >= SHARE * range.len() as f64 {
            count += own;
            place = place.or(begin);
        }
    }
    (count, place)
}

/// A number for the values of a stretch, the same wherever it stands.
fn key(values: &[f64]) -> u64 {
    let mixed = values.iter().fold(0u64, |hash, v| {
        (hash.rotate_left(5) ^ v.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15)
    });
    // The last bits of a product are poorly mixed.
    mixed ^ (mixed >> 32)
}

/// Whether a stretch is one that chance does not repeat.
fn is_irregular(values: &[f64]) -> bool {
    let changes = values.windows(2).filter(|w| w[0] != w[1]).count();
    if changes < CHANGES {
        return false;
    }
    let mut different = values.to_vec();
    different.sort_by(f64::total_cmp);
    different.dedup();
    different.len() >= VALUES
}

/// Largest difference of two prints of one signal, as a share of its change from row to row.
const PRINT: f64 = 0.25;

/// Rows of sequences that are others from the beginning on, in other digits.
fn printed_otherwise(frame: &Frame, target: &[f64], fold: &[u32]) -> (usize, Option<[usize; 2]>) {
    let long = |r: &&Range<usize>| r.len() >= STRETCH;
    let all: Vec<&Range<usize>> = frame.sequences().iter().filter(long).take(MOST).collect();
    // The change from row to row without the steps of the print: what is left of a straight line
    // through three rows.
    let steps = |values: &[f64]| {
        let bends = values
            .windows(3)
            .map(|w| (w[1] - 0.5 * (w[0] + w[2])).abs());
        let mut sizes: Vec<f64> = bends.collect();
        sizes.sort_by(f64::total_cmp);
        // Nine of ten are below 1.645 standard deviations: a few bad values must not set the limit.
        PRINT * stats::quantile_sorted(&sizes, 0.9) / 1.645
    };
    let (mut count, mut place) = (0, None);
    for (k, a) in all.iter().enumerate() {
        let own = &target[(*a).clone()];
        if !is_irregular(&own[..STRETCH]) {
            continue;
        }
        let limit = steps(own);
        // The first rows tell nearly all.
        let same = |b: &Range<usize>| {
            let mut both = own.iter().zip(&target[b.clone()]);
            both.all(|(a, b)| (a - b).abs() <= limit)
        };
        let copy = all[..k]
            .iter()
            .find(|b| fold[a.start] != fold[b.start] && same(b));
        if let Some(b) = copy {
            count += a.len().min(b.len());
            place = place.or(Some([b.start, a.start]));
        }
    }
    (count, place)
}
