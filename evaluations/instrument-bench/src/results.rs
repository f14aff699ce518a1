//! All figures of the page, from the clone's folder.

use crate::adapt;
use crate::data::{read_set, DataError, Run};
use crate::features::{FEATURES, GROUPS};
use crate::model::{for_each_row, sums, Bilinear};
use crate::protocol::{scored, Inputs, Scored};
use crate::reference::Reference;
use crate::score::{fit, score, Dealer, Figure};
use crate::split::{Apart, Label};
use crate::sums::{total, Sums};
use rayon::prelude::*;
use std::path::Path;

/// The publication's set: tool 4, ten loads, five speeds.
pub const SET: &str = "Tool_4_Maryland_L_4";
/// The other tool of the kind, the same loads and speeds.
pub const OTHER: &str = "Tool_5_Maryland_L_3";
/// Earlier sessions of both tools with four loads. Nothing was chosen on them.
pub const EARLIER: [&str; 2] = ["Tool_4_Maryland_L_2", "Tool_5_Maryland_L_2"];
/// Poses of the shaft of tool 4, five sets each: the words of the page and the beginning of the
/// folder's name.
const POSES: [(&str, &str); 2] = [
    ("roll", "Tool_4_Maryland_L_Roll_"),
    ("pitch", "Tool_4_Maryland_L_Pitch_"),
];
/// Parts of the split by random rows.
const PARTS: usize = 10;
/// Files of a pair differ by so many steps of the load.
const APART: u8 = 6;

/// A set of runs with the rows that count.
pub struct Set {
    /// Name of its folder.
    pub name: String,
    /// Its runs.
    pub runs: Vec<Run>,
    /// Rows that count.
    pub scored: Vec<Scored>,
    /// Sums with causal inputs.
    pub causal: Vec<Sums>,
}

impl Set {
    /// Reads a set.
    ///
    /// # Errors
    /// [`DataError`] where it isn't there or can't be read.
    pub fn read(clone: &Path, name: &str) -> Result<Self, DataError> {
        let runs = read_set(clone, name)?;
        Ok(Self::of(name, runs))
    }

    /// A set of these runs.
    #[must_use]
    pub fn of(name: &str, runs: Vec<Run>) -> Self {
        let scored: Vec<Scored> = runs.par_iter().map(scored).collect();
        let mut set = Self {
            name: name.to_owned(),
            runs,
            scored,
            causal: Vec::new(),
        };
        set.causal = set.sums(Inputs::Causal);
        set
    }

    /// Speed and load of each run.
    #[must_use]
    pub fn labels(&self) -> Vec<Label> {
        self.runs.iter().map(|run| (run.speed, run.level)).collect()
    }

    /// Rows that count.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.scored.iter().map(|s| s.rows.len()).sum()
    }

    /// Sums of each run.
    #[must_use]
    pub fn sums(&self, how: Inputs) -> Vec<Sums> {
        let pairs = self.runs.par_iter().zip(&self.scored);
        pairs.map(|(run, scored)| sums(run, scored, how)).collect()
    }

    /// A model of all runs.
    #[must_use]
    pub fn model(&self) -> Option<Bilinear> {
        let all: Vec<usize> = (0..self.runs.len()).collect();
        fit(Apart::Level, &self.labels(), &self.causal, &all).map(Bilinear::new)
    }
}

/// Figures of one model over the splits, mN·m.
pub struct Splits {
    /// Words of the table.
    pub words: String,
    /// Random rows of the same runs, as in the publication: the test rows' neighbours are trained
    /// on.
    pub rows: Option<Figure>,
    /// One run left out.
    pub run: Figure,
    /// One load left out.
    pub level: Figure,
    /// One load and one speed left out.
    pub level_and_speed: Figure,
}

impl Splits {
    fn of(words: &str, labels: &[Label], sums: &[Sums], rows: Option<Figure>) -> Self {
        Self {
            words: words.to_owned(),
            rows,
            run: score(Apart::Run, labels, sums),
            level: score(Apart::Level, labels, sums),
            level_and_speed: score(Apart::LevelAndSpeed, labels, sums),
        }
    }
}

/// The model of one set on another.
pub struct Transfer {
    /// Trained on.
    pub from: String,
    /// Tested on.
    pub to: String,
    /// Without a correction, mN·m.
    pub raw_mnm: f64,
    /// Names of the two files that a user would record: least load at the least speed, most load at
    /// the most speed.
    pub files: [String; 2],
    /// With the correction from these, mN·m, on all other files.
    pub corrected_mnm: f64,
    /// With the correction from any two files whose loads differ by six steps or more (by the most
    /// there is), rising, mN·m.
    pub any_two_mnm: Vec<f64>,
}

/// Everything.
pub struct Results {
    /// The publication's set.
    pub set: Set,
    /// Models over the splits.
    pub splits: Vec<Splits>,
    /// The shipped model with the publication's filter and with causal inputs: numbers of `splits`.
    pub filtered: usize,
    /// See [`Results::filtered`].
    pub causal: usize,
    /// The causal model without a group of regressors, one load left out.
    pub ablation: Vec<(&'static str, Figure)>,
    /// One pose left out: words, and the figure whose folds are the five poses, causal.
    pub poses: Vec<(&'static str, Figure)>,
    /// Other tools and sessions.
    pub transfers: Vec<Transfer>,
}

/// Computes everything. `progress` is told what goes on.
///
/// # Errors
/// [`DataError`] where the data aren't there or can't be read.
pub fn compute(clone: &Path, progress: &mut dyn FnMut(&str)) -> Result<Results, DataError> {
    progress("reading the sets");
    let set = Set::read(clone, SET)?;
    let other = Set::read(clone, OTHER)?;
    let labels = set.labels();
    let mut splits = Vec::new();
    for reference in Reference::ALL {
        progress(reference.words());
        let pairs = set.runs.par_iter().zip(&set.scored);
        let sums: Vec<Sums> = pairs
            .map(|(run, scored)| reference.sums(run, scored))
            .collect();
        splits.push(Splits::of(reference.words(), &labels, &sums, None));
    }
    let (filtered, causal) = (splits.len(), splits.len() + 1);
    for (words, how) in [
        (
            "this model, inputs with the publication's filter",
            Inputs::Filtered,
        ),
        ("this model, causal inputs", Inputs::Causal),
    ] {
        progress(words);
        let sums = match how {
            Inputs::Causal => set.causal.clone(),
            Inputs::Filtered => set.sums(how),
        };
        let rows = random_rows(&set, how);
        splits.push(Splits::of(words, &labels, &sums, Some(rows)));
    }
    progress("ablation");
    let ablation = ablation(&set);
    let mut poses = Vec::new();
    for (words, folder) in POSES {
        progress(words);
        poses.push((words, one_pose_left_out(clone, folder)?));
    }
    progress("other tool");
    let mut transfers = vec![transfer(&set, &other), transfer(&other, &set)];
    for (base, name) in [(&set, EARLIER[0]), (&other, EARLIER[1])] {
        progress(name);
        let earlier = Set::read(clone, name)?;
        transfers.push(transfer(base, &earlier));
        let crossed = if std::ptr::eq(base, &set) {
            &other
        } else {
            &set
        };
        transfers.push(transfer(crossed, &earlier));
    }
    Ok(Results {
        set,
        splits,
        filtered,
        causal,
        ablation,
        poses,
        transfers: transfers.into_iter().flatten().collect(),
    })
}

/// One load left out, without one group of regressors after the other.
fn ablation(set: &Set) -> Vec<(&'static str, Figure)> {
    let labels = set.labels();
    let mut from = 0;
    GROUPS
        .iter()
        .map(|(words, width)| {
            let columns = from..from + width;
            from += width;
            let sums: Vec<Sums> = set
                .causal
                .iter()
                .map(|sums| sums.without(columns.clone()))
                .collect();
            (*words, score(Apart::Level, &labels, &sums))
        })
        .collect()
}

/// Five sets, one left out after the other.
fn one_pose_left_out(clone: &Path, folder: &str) -> Result<Figure, DataError> {
    let (mut labels, mut sums) = (Vec::new(), Vec::new());
    for pose in 1..=5u8 {
        let set = Set::read(clone, &format!("{folder}{pose}"))?;
        // The pose stands in the place of the load: it is what is left out.
        labels.extend(set.runs.iter().map(|run| (run.speed, pose)));
        sums.extend(set.causal);
    }
    Ok(score(Apart::Level, &labels, &sums))
}

/// The split of the publication: rows dealt at random, each tenth predicted from the others.
fn random_rows(set: &Set, how: Inputs) -> Figure {
    let dealt: Vec<Vec<Sums>> = set
        .runs
        .par_iter()
        .zip(&set.scored)
        .enumerate()
        .map(|(number, (run, scored))| {
            let mut dealer = Dealer::new(PARTS, number as u64);
            let mut rows = vec![(Vec::new(), Vec::new()); PARTS];
            for_each_row(run, scored, how, |features, truth| {
                let part = dealer.next_part();
                rows[part].0.extend(features.row());
                rows[part].1.push(truth);
            });
            rows.iter().map(|(x, y)| Sums::of(FEATURES, x, y)).collect()
        })
        .collect();
    let parts: Vec<Sums> = (0..PARTS)
        .map(|part| total(FEATURES, dealt.iter().map(|run| &run[part])))
        .collect();
    score(Apart::Run, &[(0, 0); PARTS], &parts)
}

/// The model of one set on another; `None` where it can't be fitted.
#[must_use]
pub fn transfer(from: &Set, to: &Set) -> Option<Transfer> {
    let model = from.model()?;
    let all = total(FEATURES, to.causal.iter());
    let raw_mnm = (all.squared_error(model.weights()) / all.rows).sqrt();
    let pairs = to.runs.par_iter().zip(&to.scored);
    let sums: Vec<Sums> = pairs
        .map(|(run, scored)| adapt::sums(&model, run, scored))
        .collect();
    let labels = to.labels();
    let designated = corners(&labels)?;
    let span = labels.iter().map(|l| l.1).max()? - labels.iter().map(|l| l.1).min()?;
    let mut any_two_mnm: Vec<f64> = (0..sums.len())
        .flat_map(|a| (0..a).map(move |b| [a, b]))
        .filter(|[a, b]| labels[*a].1.abs_diff(labels[*b].1) >= APART.min(span))
        .filter_map(|pair| adapt::error_after(&sums, pair))
        .collect();
    any_two_mnm.sort_by(f64::total_cmp);
    Some(Transfer {
        from: from.name.clone(),
        to: to.name.clone(),
        raw_mnm,
        files: designated.map(|run| to.runs[run].name.clone()),
        corrected_mnm: adapt::error_after(&sums, designated)?,
        any_two_mnm,
    })
}

/// The slowest run with the least load and the fastest with the most.
fn corners(labels: &[Label]) -> Option<[usize; 2]> {
    let runs = 0..labels.len();
    Some([
        runs.clone()
            .min_by_key(|run| (labels[*run].0, labels[*run].1))?,
        runs.max_by_key(|run| (labels[*run].0, labels[*run].1))?,
    ])
}
