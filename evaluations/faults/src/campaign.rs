//! Many cases: in parallel, in shards, resumed where they stopped, merged from files.
//!
//! Case n of a seed is the same in every run of the same program, so files of shards, and of runs
//! that were cut off, add up to one campaign.

use crate::case::{run_on, Bases};
use crate::injection::Plan;
use crate::outcome::Outcome;
use evaluation::checkpoint::{self, Checkpoint};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;
use std::time::Instant;

/// Current limit that docs/bring-up.md has the amplifiers set to, A: 0.9 A are 17.4 N, just above
/// the force limit of 16 N. With the amplifier's own 6 A a wrong word can pull with 116 N.
pub const CURRENT_LIMIT_A: f64 = 0.9;

/// What the outcomes of a file are of, beside the program, firmware's core included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Origin {
    seed: u64,
    current_limit_a: f64,
}

impl Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "seed {} at {} A", self.seed, self.current_limit_a)
    }
}

/// What to run.
#[derive(Debug, Clone, Copy)]
pub struct Campaign {
    /// Seed of plants and injections.
    pub seed: u64,
    /// Number of cases.
    pub cases: u64,
    /// This shard, from 0, and how many there are.
    pub shard: (u64, u64),
    /// Threads.
    pub jobs: usize,
    /// Current limit of the amplifiers, A.
    pub current_limit_a: f64,
}

impl Campaign {
    /// Cases of this shard that `done` lacks.
    #[must_use]
    pub fn open(&self, done: &BTreeSet<u64>) -> Vec<u64> {
        let (shard, of) = self.shard;
        (0..self.cases)
            .filter(|n| n % of == shard && !done.contains(n))
            .collect()
    }

    /// Runs what `file` lacks and appends to it; reports progress to standard error.
    ///
    /// # Errors
    /// The file cannot be read or written, or is of another seed or current limit.
    pub fn run(&self, file: &Path) -> io::Result<()> {
        let origin = Origin {
            seed: self.seed,
            current_limit_a: self.current_limit_a,
        };
        let (out, done) = Checkpoint::open::<_, Outcome>(file, &origin)?;
        let open = self.open(&done.iter().map(|outcome| outcome.number).collect());
        if open.is_empty() {
            return Ok(());
        }
        // Behind a lock, because a robot's model need not be shared by threads; a copy takes little
        // of a case's time.
        let bases = Mutex::new(Bases::new(self.seed, self.current_limit_a));
        let next = AtomicUsize::new(0);
        let failed = Mutex::new(None);
        let began = Instant::now();
        std::thread::scope(|scope| {
            for _ in 0..self.jobs.max(1) {
                scope.spawn(|| {
                    while let Some(&number) = open.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let plan = Plan::draw(self.seed, number);
                        let rig = lock(&bases).rig(&plan);
                        let outcome = run_on(rig, number, plan);
                        if let Err(error) = out.append(&outcome) {
                            *lock(&failed) = Some(error);
                            return;
                        }
                        progress(next.load(Ordering::Relaxed), open.len(), began);
                    }
                });
            }
        });
        match failed.into_inner() {
            Ok(Some(error)) => Err(error),
            _ => Ok(()),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn progress(done: usize, all: usize, began: Instant) {
    let done = done.min(all);
    if done.is_multiple_of(100) || done == all {
        let seconds = began.elapsed().as_secs_f64();
        eprintln!("faults: {done} of {all} cases, {seconds:.0} s");
    }
}

/// Seed of a file, and its outcomes by number. A line that was cut off is left out: its case runs
/// again.
///
/// # Errors
/// The file cannot be read, or does not say what it is of.
pub fn read(file: &Path) -> io::Result<(u64, BTreeMap<u64, Outcome>)> {
    let (origin, outcomes) = checkpoint::read::<Origin, Outcome>(file)?;
    let outcomes = outcomes
        .into_iter()
        .map(|outcome| (outcome.number, outcome));
    Ok((origin.seed, outcomes.collect()))
}
