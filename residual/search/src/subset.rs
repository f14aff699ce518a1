//! Best subset over the physics: which of the textbook terms, together, predict best.
//!
//! A search adds effects one at a time, so its first choice decides on the others. Here sets of
//! terms are compared as a whole, from sums of products. Sets with as many parameters are compared
//! by the error that they are fitted to. How many parameters there are is decided by the error on
//! folds that took no part in the choice of the sets: of those that predict as well as the best
//! number the smallest.

use super::Search;
use crate::model::Chosen;
use crate::scan::t_statistic;
use rayon::prelude::*;
use residual_columns::error::Error;
use residual_columns::linalg::{squared_error, Cholesky};
use residual_effects::{Build, EffectKind, Piece, CATALOGUE};
use residual_fit::problem::{Sums, RANK_TOL};
use std::ops::Range;
use std::sync::Arc;

/// Effects that a textbook on machines has.
const PHYSICS: [EffectKind; 10] = [
    EffectKind::Offset,
    EffectKind::Gain,
    EffectKind::Quadratic,
    EffectKind::Coulomb,
    EffectKind::LoadDependentCoulomb,
    EffectKind::Viscous,
    EffectKind::Stribeck,
    EffectKind::Presliding,
    EffectKind::Inertia,
    EffectKind::GravityAngle,
];

/// Whether an effect is among the textbook terms.
pub(super) fn is_physics(kind: EffectKind) -> bool {
    PHYSICS.contains(&kind)
}

/// Sets with as many parameters that are extended. With one the choice would be greedy; a weight of
/// two parameters must survive beside friction and inertia of one each.
const WIDTH: usize = 6;

/// Most parameters of a set.
const MOST: usize = 10;

/// Standard errors of the difference of two errors, block by block, up to which the smaller set is
/// taken, if it is not worse by what counts: the rule of one standard error of cross-validation.
const EQUAL: f64 = 1.0;

/// A term that may be in a set: a form at one value of its nonlinear parameter, with its columns.
struct Form {
    /// Which form it is, whatever the value.
    form: usize,
    choice: Chosen,
    columns: Range<usize>,
    /// Its fitted parameters, with a nonlinear one that was fitted before.
    parameters: usize,
}

impl Form {
    /// Whether two forms cannot be in one set: forms of one effect, unless it may be there more
    /// than once.
    fn excludes(&self, other: &Form) -> bool {
        self.choice.excludes(other.choice.effect.kind()) || self.choice.is_form(&other.choice)
    }
}

/// Sums of products over some rows.
#[derive(Clone)]
struct Gram {
    q: usize,
    g: Vec<f64>,
    b: Vec<f64>,
    yy: f64,
}

impl Gram {
    fn of(sums: &Sums, blocks: impl Iterator<Item = usize>) -> Gram {
        let q = sums.q;
        let mut out = Gram {
            q,
            g: vec![0.0; q * q],
            b: vec![0.0; q],
            yy: 0.0,
        };
        for k in blocks {
            let own = &sums.g[k * q * q..(k + 1) * q * q];
            out.g.iter_mut().zip(own).for_each(|(a, x)| *a += x);
            out.yy += sums.rhs(k, 1.0, &mut out.b);
        }
        out
    }

    /// The sums of some columns.
    fn some(&self, columns: &[usize]) -> Gram {
        let g = columns
            .iter()
            .flat_map(|i| columns.iter().map(move |j| self.g[i * self.q + j]));
        Gram {
            q: columns.len(),
            g: g.collect(),
            b: columns.iter().map(|i| self.b[*i]).collect(),
            yy: self.yy,
        }
    }

    fn fit(&self) -> Vec<f64> {
        Cholesky::new(&self.g, self.q, RANK_TOL).solve(&self.b)
    }

    fn error(&self, x: &[f64]) -> f64 {
        squared_error(&self.g, &self.b, self.yy, x)
    }
}

/// A set of forms, by their indices in order, with the error that it was fitted to.
#[derive(Clone)]
struct Set {
    forms: Vec<usize>,
    error: f64,
}

/// Columns of a set: those of the model, and those of its forms.
fn columns(model: usize, forms: &[Form], set: &[usize]) -> Vec<usize> {
    let own = set.iter().flat_map(|i| forms[*i].columns.clone());
    (0..model).chain(own).collect()
}

/// The best [`WIDTH`] sets, one for each combination of forms: sets that differ in the value of a
/// nonlinear parameter alone would take the places of others.
fn other_forms(sorted: Vec<Set>, forms: &[Form]) -> Vec<Set> {
    let of = |set: &Set| -> Vec<usize> { set.forms.iter().map(|i| forms[*i].form).collect() };
    let mut out: Vec<Set> = Vec::new();
    for set in sorted {
        if out.len() == WIDTH {
            break;
        }
        if out.iter().all(|known| of(known) != of(&set)) {
            out.push(set);
        }
    }
    out
}

/// The best set with up to 0, 1, 2, ... parameters beside the columns of the model.
fn best_sets(gram: &Gram, model: usize, forms: &[Form], most_forms: usize) -> Vec<Set> {
    let error = |set: &[usize]| {
        let own = gram.some(&columns(model, forms, set));
        own.error(&own.fit())
    };
    let mut by_size: Vec<Vec<Set>> = vec![vec![]; MOST + 1];
    by_size[0].push(Set {
        forms: vec![],
        error: error(&[]),
    });
    for size in 0..=MOST {
        let mut own = std::mem::take(&mut by_size[size]);
        own.sort_by(|a, b| a.error.total_cmp(&b.error));
        own = other_forms(own, forms);
        for set in own.iter().filter(|s| s.forms.len() < most_forms) {
            for (i, form) in forms.iter().enumerate() {
                let larger = size + form.parameters;
                let excluded = set.forms.iter().any(|j| forms[*j].excludes(form));
                if larger > MOST || excluded {
                    continue;
                }
                let mut all = set.forms.clone();
                all.push(i);
                all.sort_unstable();
                if by_size[larger].iter().all(|s| s.forms != all) {
                    by_size[larger].push(Set {
                        error: error(&all),
                        forms: all,
                    });
                }
            }
        }
        by_size[size] = own;
    }
    let mut best: Vec<Set> = Vec::new();
    for own in by_size {
        let before = best.last().cloned();
        // A set with fewer parameters that fits as well stands for one with more.
        let new = own.into_iter().next();
        let better = |new: &Set| before.as_ref().is_none_or(|b| new.error < b.error);
        best.extend(new.filter(better).or(before.clone()));
    }
    best
}

/// The set to take: the smallest number of parameters with which sets that were chosen without a
/// fold predict that fold as well as with the best number.
///
/// `fold_of` tells the fold of each block.
fn best_set(
    fold_of: &[usize],
    sums: &Sums,
    model: usize,
    forms: &[Form],
    most: usize,
    material: f64,
) -> Vec<usize> {
    let blocks = |keep: &dyn Fn(usize) -> bool| {
        let all = fold_of.iter().enumerate();
        let kept: Vec<usize> = all.filter(|(_, f)| keep(**f)).map(|(k, _)| k).collect();
        kept
    };
    let folds = fold_of.iter().max().map_or(0, |last| last + 1);
    let by_fold: Vec<Vec<(usize, Vec<f64>)>> = (0..folds)
        .into_par_iter()
        .map(|fold| {
            let train = Gram::of(sums, blocks(&|f| f != fold).into_iter());
            let fits: Vec<(Vec<usize>, Vec<f64>)> = best_sets(&train, model, forms, most)
                .iter()
                .map(|set| {
                    let own = columns(model, forms, &set.forms);
                    let x = train.some(&own).fit();
                    (own, x)
                })
                .collect();
            let held = blocks(&|f| f == fold).into_iter().map(|k| {
                let block = Gram::of(sums, std::iter::once(k));
                let errors = fits.iter().map(|(own, x)| block.some(own).error(x));
                (k, errors.collect())
            });
            held.collect()
        })
        .collect();
    let mut losses = vec![vec![0.0; fold_of.len()]; MOST + 1];
    for (k, errors) in by_fold.into_iter().flatten() {
        losses
            .iter_mut()
            .zip(errors)
            .for_each(|(own, error)| own[k] = error);
    }
    let total = |size: &usize| losses[*size].iter().sum::<f64>();
    let best = (0..=MOST).min_by(|a, b| total(a).total_cmp(&total(b)));
    let best = best.unwrap_or(0);
    let as_good = |size: &usize| {
        total(size) < total(&best) * (1.0 + material).powi(2)
            && t_statistic(&losses[*size], &losses[best]) < EQUAL
    };
    let size = (0..best).find(as_good).unwrap_or(best);
    let all = Gram::of(sums, 0..fold_of.len());
    let mut sets = best_sets(&all, model, forms, most);
    sets.swap_remove(size).forms
}

impl Search<'_> {
    /// The textbook terms that predict best beside other effects.
    pub(super) fn physics_beside(&self, others: &[Chosen]) -> Result<Vec<Chosen>, Error> {
        let fitted = self.fit(others)?;
        let scan = self.scan_on(&fitted);
        let context = scan.context();
        let (mut forms, mut pieces): (Vec<Form>, Vec<Piece>) = (vec![], vec![]);
        let (mut at, mut form) = (fitted.fit.x.len(), 0);
        for effect in CATALOGUE.iter().filter(|e| is_physics(e.kind())) {
            if !self.allowed(*effect) || others.iter().any(|o| o.excludes(effect.kind())) {
                continue;
            }
            for variant in effect.variants(&context) {
                // Which value of a nonlinear parameter it is, is part of what a fold must not see.
                let values = match &variant.psi {
                    None => vec![0.0],
                    Some(psi) => psi.grid.clone(),
                };
                let variant = Arc::new(variant);
                form += 1;
                for psi in values {
                    let Build::Add(own) = (variant.build)(psi) else {
                        continue;
                    };
                    let fitted = variant.psi.as_ref().is_some_and(|psi| psi.refine);
                    forms.push(Form {
                        form,
                        parameters: own.len() + usize::from(fitted),
                        columns: at..at + own.len(),
                        choice: Chosen {
                            effect: *effect,
                            variant: variant.clone(),
                            psi,
                        },
                    });
                    at += own.len();
                    pieces.extend(own);
                }
            }
        }
        let sums = scan.sums_beside(&pieces)?;
        let most = self.spec.selection.max_effects.saturating_sub(others.len());
        let (model, material) = (fitted.fit.x.len(), self.spec.selection.material);
        let fold_of: Vec<usize> = self.problem.blocks.iter().map(|b| b.fold).collect();
        let set = best_set(&fold_of, &sums, model, &forms, most, material);
        Ok(set.iter().map(|i| forms[*i].choice.clone()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::linalg::dot;
    use residual_columns::stats::Rng;
    use residual_effects::{effect, Variant};

    const BLOCKS: usize = 40;
    const FOLDS: usize = 5;

    /// Sums of columns with a target, in blocks of 25 rows.
    fn sums(columns: &[Vec<f64>], y: &[f64]) -> Sums {
        let rows = y.len() / BLOCKS;
        let part = |v: &[f64], k: usize| v[k * rows..(k + 1) * rows].to_vec();
        let mut out = Sums {
            q: columns.len(),
            g: vec![],
            br: vec![],
            bm: vec![],
            yy: vec![],
        };
        for k in 0..BLOCKS {
            let y = part(y, k);
            for a in columns {
                for b in columns {
                    out.g.push(dot(&part(a, k), &part(b, k)));
                }
                out.br.push(dot(&part(a, k), &y));
            }
            out.yy.push([dot(&y, &y), 0.0, 0.0]);
        }
        out
    }

    /// Forms of one column each, of effects that exclude no other.
    fn forms(count: usize) -> Vec<Form> {
        let one = |i: usize| Form {
            choice: Chosen {
                effect: effect(EffectKind::GravityAngle),
                variant: Arc::new(Variant::linear(&format!("angle {i}"), vec![])),
                psi: 0.0,
            },
            form: i,
            columns: i..i + 1,
            parameters: 1,
        };
        (0..count).map(one).collect()
    }

    fn folds() -> Vec<usize> {
        (0..BLOCKS).map(|k| k % FOLDS).collect()
    }

    /// The last column is nearly the sum of the first two, which the target is: alone it is the
    /// best, and beside it neither of them is worth as much as both are.
    #[test]
    fn the_best_first_choice_keeps_no_better_pair_out() {
        let mut rng = Rng::new(3);
        let mut noise =
            |size: f64| -> Vec<f64> { (0..1000).map(|_| size * rng.normal()).collect() };
        let (a, b, small, error) = (noise(1.0), noise(1.0), noise(0.3), noise(0.05));
        let sum = |i: usize| a[i] + b[i];
        let near: Vec<f64> = (0..1000).map(|i| sum(i) + small[i]).collect();
        let y: Vec<f64> = (0..1000).map(|i| sum(i) + error[i]).collect();
        let idle = [noise(1.0), noise(1.0)];
        let all = [a.clone(), b.clone(), idle[0].clone(), idle[1].clone(), near];
        let sums = sums(&all, &y);
        let gram = Gram::of(&sums, 0..BLOCKS);
        let sets = best_sets(&gram, 0, &forms(5), 5);
        assert_eq!(sets[1].forms, [4]);
        assert_eq!(sets[2].forms, [0, 1]);
        // More columns fit the noise better, and predict no better.
        assert!(sets[3].error < sets[2].error);
        assert_eq!(best_set(&folds(), &sums, 0, &forms(5), 5, 0.02), [0, 1]);
        // As many effects as the model file allows.
        assert_eq!(best_set(&folds(), &sums, 0, &forms(5), 1, 0.02), [4]);
        // A column of the model is in every set.
        let beside = best_set(&folds(), &sums, 1, &forms(5)[1..], 5, 0.02);
        assert_eq!(beside, [0]);
    }

    #[test]
    fn nothing_is_the_best_of_noise() {
        let mut rng = Rng::new(8);
        let mut noise = || -> Vec<f64> { (0..1000).map(|_| rng.normal()).collect() };
        let columns: Vec<Vec<f64>> = (0..12).map(|_| noise()).collect();
        let sums = sums(&columns, &noise());
        assert!(best_set(&folds(), &sums, 0, &forms(12), 12, 0.02).is_empty());
    }

    /// Seven values of one parameter fit the target nearly as well as each other; the pair that
    /// fits it best has none of them.
    #[test]
    fn values_of_one_parameter_take_one_place() {
        let mut rng = Rng::new(6);
        let mut noise =
            |size: f64| -> Vec<f64> { (0..1000).map(|_| size * rng.normal()).collect() };
        let (a, b) = (noise(1.0), noise(1.0));
        let y: Vec<f64> = (0..1000).map(|i| a[i] + b[i]).collect();
        let near = |off: Vec<f64>| (0..1000).map(|i| y[i] + off[i]).collect();
        let mut all: Vec<Vec<f64>> = (0..7).map(|_| near(noise(0.3))).collect();
        all.extend([a, b]);
        let sums = sums(&all, &y);
        let gram = Gram::of(&sums, 0..BLOCKS);
        let mut values = forms(9);
        // Of one effect, one at a time.
        for value in &mut values[..7] {
            value.form = 0;
            value.choice.effect = effect(EffectKind::Presliding);
        }
        let sets = best_sets(&gram, 0, &values, 5);
        assert!(sets[1].forms[0] < 7);
        assert_eq!(sets[2].forms, [7, 8]);
        for value in &mut values {
            value.form = 0;
        }
        let one = other_forms(vec![sets[1].clone(), sets[1].clone()], &values);
        assert_eq!(one.len(), 1);
    }

    #[test]
    fn forms_of_one_effect_exclude_each_other() {
        let mut all = forms(2);
        assert!(!all[0].excludes(&all[1]));
        for form in &mut all {
            form.choice.effect = effect(EffectKind::Inertia);
        }
        assert!(all[0].excludes(&all[1]));
    }
}
