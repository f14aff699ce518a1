//! Parameters of a chosen effect with 95 % intervals by bootstrap over blocks of time, over
//! stretches of blocks and over sequences; the widest counts. The nonlinear parameter is chosen
//! anew in every replicate, and the parameters and forms of the other effects are free to the first
//! order.

mod others;

use rayon::prelude::*;
use residual_columns::error::Error;
use residual_columns::stats::{self, interval, Rng};
use residual_effects::{Nature, Param};
use residual_fit::diagnostics::correlation_rows;
use residual_fit::problem::{half_step, Column, Problem, Sums};
use residual_search::model::{Chosen, Model, Projector};
use residual_search::scan::reach;
use residual_search::{without, Search};
use std::collections::BTreeMap;
use std::ops::Range;

/// Bootstrap replicates of each length of stretch.
const REPLICATES: usize = 200;

/// Blocks in a stretch that is drawn as one. Noise with a long memory (1/f, slow drifts) is alike
/// over many blocks, so that single blocks would show too little scatter; of the two intervals the
/// wider one counts.
const STRETCHES: [usize; 2] = [1, 4];

/// Fewest stretches that can be drawn from.
const FEWEST_STRETCHES: usize = 12;

/// Half width of an interval in standard errors where the replicates agree.
/// The 97.5 % quantile of the normal distribution.
const REACH: f64 = 1.96;

/// Times that the values of a nonlinear parameter, or their distance, are chosen anew.
const MOVES: usize = 5;

/// Fewest sequences whose scatter is a measure. What is slower than a stretch (a drift, a
/// temperature) is alike in a whole sequence, and differs from one to the next.
const FEWEST_SEQUENCES: usize = 4;

/// Intervals by parameter name.
pub type Intervals = BTreeMap<String, [f64; 2]>;

/// Parameters of an effect, and their intervals.
pub type Parameters = (Vec<Param>, Intervals);

/// One chosen effect in the final model.
struct Own<'a> {
    search: &'a Search<'a>,
    chosen: &'a [Chosen],
    index: usize,
    /// Whether every sequence has coefficients of its own.
    local: bool,
    /// What the other effects may add to the model, see [`others::columns`].
    others: Vec<Column>,
}

/// Sums of the final model at one value of the effect's nonlinear parameter.
struct Point {
    psi: f64,
    sums: Sums,
}

impl Point {
    /// Squared error; `weights` count blocks.
    fn error(&self, weights: Option<&[f64]>) -> f64 {
        let (x, _) = self.sums.fit(weights);
        match weights {
            None => (0..self.sums.yy.len())
                .map(|k| self.sums.block_error(k, &x))
                .sum(),
            Some(w) => (0..w.len())
                .filter(|k| w[*k] > 0.0)
                .map(|k| w[k] * self.sums.block_error(k, &x))
                .sum(),
        }
    }
}

/// Parameters of the effect at `index` among the chosen ones, and their intervals.
pub fn parameters(search: &Search, chosen: &[Chosen], index: usize) -> Result<Parameters, Error> {
    let mut own = Own {
        search,
        chosen,
        index,
        local: chosen[index].variant.is_local(chosen[index].psi),
        others: vec![],
    };
    let psi = chosen[index].psi;
    let (first, mine) = own.at(psi)?;
    let mut params = own.values(&first, &mine, None);
    if own.local {
        own.common_amplitude(&mut params)?;
        return Ok((params, Intervals::new()));
    }
    if chosen[index].variant.observed {
        // It was read off the target, to its resolution.
        let of = |q: &Param| {
            let half = half_step(&search.problem.y, q.value);
            (q.name.clone(), [q.value - half, q.value + half])
        };
        let intervals = params.iter().map(of).collect();
        return Ok((params, intervals));
    }
    own.others = others::columns(search, chosen, index)?;
    let (first, mine) = own.at(psi)?;
    let (points, se) = own.points(first)?;
    let by_error = own.by_error(&points[0], &mine, se);
    let replicates: Vec<Vec<Vec<Param>>> = STRETCHES
        .iter()
        .map(|length| stretches(&search.problem, *length))
        .filter(|all| all.len() >= FEWEST_STRETCHES || all.len() == search.problem.blocks.len())
        .map(|all| own.replicates(&points, &mine, &all))
        .collect();
    let whole = search.problem.runs();
    let reweighted = (whole.len() >= FEWEST_SEQUENCES)
        .then(|| -> Result<_, Error> {
            let draws = reweighted(search, &whole);
            let (count, fitted) = own.sequences(&whole)?;
            Ok((count, fitted, own.of_draws(&points, &mine, &draws)))
        })
        .transpose()?;
    let nonlinear = chosen[index].variant.psi.as_ref().map(|p| p.name);
    let positive = chosen[index]
        .variant
        .psi
        .as_ref()
        .is_some_and(|p| p.grid.first().is_some_and(|first| *first > 0.0));
    let widest = |q: &Param| {
        let own = nonlinear == Some(q.name.as_str());
        let drawn = replicates.iter().map(|r| match own {
            true => up_to(q.value, values_of(q, r)),
            false => around(q.value, values_of(q, r)),
        });
        let by_sequence = reweighted
            .iter()
            .map(|(count, fitted, r)| student(q.value, &values_of(q, r), *count, *fitted));
        let intervals = drawn.chain(by_sequence);
        let widest = intervals.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        // The error may have a minimum so narrow that all replicates choose the same one of the
        // values.
        let [low, high] = match (widest?, by_error) {
            ([low, high], Some(r)) if own && high - low < 0.5 * (r[1] - r[0]).abs() => {
                [low.min(r[0].min(r[1])), high.max(r[0].max(r[1]))]
            }
            (widest, _) => widest,
        };
        // A width or a time is positive, however uncertain.
        let least = if own && positive && q.value > 0.0 {
            0.0
        } else {
            f64::NEG_INFINITY
        };
        Some([low.max(least), high])
    };
    let intervals = params
        .iter()
        .filter_map(|q| Some((q.name.clone(), widest(q)?)))
        .collect();
    Ok((params, intervals))
}

/// Blocks in stretches of some length, none across two sequences.
fn stretches(p: &Problem, length: usize) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for (k, block) in p.blocks.iter().enumerate() {
        match out.last_mut() {
            Some(last)
                if last.len() < length && p.blocks[last.start].sequence == block.sequence =>
            {
                last.end = k + 1;
            }
            _ => out.push(k..k + 1),
        }
    }
    out
}

/// The 95 % interval of an estimate: between the quantiles of its replicates. Where these are all
/// on one side, as for an amplitude near zero or beside friction that turns over otherwise, 1.96 of
/// their standard deviations about the estimate as well.
fn around(estimate: f64, replicates: Vec<f64>) -> [f64; 2] {
    let half = 1.96 * stats::deviation(&replicates);
    let [low, high] = interval(replicates);
    if (low..=high).contains(&estimate) {
        [low, high]
    } else {
        [low.min(estimate - half), high.max(estimate + half)]
    }
}

/// The same for a nonlinear parameter: one that lies outside of its replicates was chosen in
/// another model, or is at a limit, and its interval goes on to where they are.
fn up_to(estimate: f64, replicates: Vec<f64>) -> [f64; 2] {
    let [low, high] = interval(replicates);
    [low.min(estimate), high.max(estimate)]
}

/// Weights of blocks by sequence for a Bayesian bootstrap (Rubin 1981): each sequence has an
/// exponential weight. None is left out, so an effect that acts in one sequence only keeps its
/// parameter.
fn reweighted(search: &Search, sequences: &[Range<usize>]) -> Vec<Vec<f64>> {
    let mut rng = Rng::new(search.spec.selection.seed ^ 0xc2);
    let blocks = search.problem.blocks.len();
    (0..REPLICATES)
        .map(|_| {
            let mut w = vec![0.0; blocks];
            for range in sequences {
                w[range.clone()].fill(rng.exponential());
            }
            w
        })
        .collect()
}

/// The 95 % interval of an estimate from replicates over `count` sequences, from which `fitted`
/// parameters were estimated: the scatter of a few sequences is itself uncertain, which Student's
/// distribution allows for.
fn student(estimate: f64, replicates: &[f64], count: f64, fitted: f64) -> [f64; 2] {
    let freedom = (count - fitted).max(1.0);
    let error = stats::deviation(replicates) * (count / freedom).max(1.0).sqrt();
    let half = stats::student_975(freedom) * error;
    [estimate - half, estimate + half]
}

/// Replicates of one parameter. Phases wrap: they are counted from the estimate.
fn values_of(estimate: &Param, replicates: &[Vec<Param>]) -> Vec<f64> {
    use std::f64::consts::{PI, TAU};
    let mut v: Vec<f64> = replicates
        .iter()
        .filter_map(|r| r.iter().find(|x| x.name == estimate.name).map(|x| x.value))
        .collect();
    if estimate.nature == Nature::Phase {
        let at = estimate.value;
        v.iter_mut()
            .for_each(|x| *x = at + (*x - at + PI).rem_euclid(TAU) - PI);
    }
    v
}

impl Own<'_> {
    fn chosen(&self) -> &Chosen {
        &self.chosen[self.index]
    }

    /// Effective number of `sequences`, and the number of parameters that their scatter was lowered
    /// by: those fitted to the means of the sequences where the effect acts mostly in them, else
    /// one.
    fn sequences(&self, sequences: &[Range<usize>]) -> Result<(f64, f64), Error> {
        let (own, rest) = without(self.chosen, self.index);
        let rest = self.search.fit(&rest)?;
        let scan = self.search.scan_on(&rest);
        let added = scan.added(&own.variant, own.psi);
        let between = scan.between_sequences(&own.variant, own.psi, &added);
        Ok(match between {
            Some(b) => (b.sequences, b.fitted),
            None => (sequences.len() as f64, 1.0),
        })
    }

    /// Sums of the final model with the effect's nonlinear parameter at `psi`, and which of the
    /// coefficients are the effect's.
    fn at(&self, psi: f64) -> Result<(Point, Vec<usize>), Error> {
        let p = &self.search.problem;
        let mut all = self.chosen.to_vec();
        all[self.index].psi = psi;
        let model = Model::with(self.search.spec, &all)?;
        let view = p.view(&model.replaced)?;
        let mut x = Vec::new();
        let mut fixed = vec![0.0; p.y.len()];
        let mut mine = Vec::new();
        let mut local = Vec::new();
        for t in &model.terms {
            let v = p.eval(&view, &t.expr)?;
            // A local effect is summarised by one common phase only if it has one; other local
            // terms are taken out.
            if t.local && !(self.local && t.chosen == Some(self.index)) {
                local.push(v);
                continue;
            }
            match t.fixed {
                Some(k) => fixed
                    .iter_mut()
                    .zip(v.iter())
                    .for_each(|(f, v)| *f += k * v),
                None => {
                    if t.chosen == Some(self.index) {
                        mine.push(x.len());
                    }
                    x.push(v);
                }
            }
        }
        let mut y: Vec<f64> = p.y.iter().zip(&fixed).map(|(y, f)| y - f).collect();
        if let Some(projector) = Projector::new(p, local) {
            projector.take_out(&mut y);
            x.iter_mut().for_each(|c| *c = projector.rest(c));
        }
        let columns: Vec<&[f64]> = x.iter().chain(&self.others).map(|c| c.as_slice()).collect();
        let sums = Sums::new(p, &columns, &y, None, None);
        Ok((Point { psi, sums }, mine))
    }

    /// The effect's parameters from a fit with weights.
    fn values(&self, at: &Point, mine: &[usize], weights: Option<&[f64]>) -> Vec<Param> {
        let (t, _) = at.sums.fit(weights);
        let own: Vec<f64> = mine.iter().map(|i| t[*i]).collect();
        self.chosen().variant.params(at.psi, &own)
    }

    /// In the place of an amplitude and phase for all sequences: the RMS over sequences.
    fn common_amplitude(&self, params: &mut Vec<Param>) -> Result<(), Error> {
        let fitted = self.search.fit(self.chosen)?;
        let own = |i: &usize| fitted.model.terms[*i].chosen == Some(self.index);
        let sizes = fitted.fit.local.iter().filter(|(i, _)| own(i));
        let size = sizes.map(|(_, r)| r * r).sum::<f64>().sqrt();
        params.retain(|p| p.nature != Nature::Phase);
        params
            .iter_mut()
            .filter(|p| p.nature == Nature::Amplitude)
            .for_each(|p| p.value = size);
        Ok(())
    }

    /// Values of the nonlinear parameter for replicates to choose from, and its standard error:
    /// four standard errors to either side of the estimate, in steps of a half.
    fn points(&self, first: Point) -> Result<(Vec<Point>, f64), Error> {
        let own = self.chosen();
        let Some(psi) = own.variant.psi.as_ref().filter(|p| p.refine) else {
            return Ok((vec![first], 0.0));
        };
        let (lo, hi) = reach(psi.resolution, &psi.grid, own.psi);
        let positive = psi.grid[0] > 0.0;
        let se = self.standard_error(&first, (hi - lo).abs(), positive)?;
        let mut points = vec![first];
        // Where other effects were taken out of the model, the least error is no longer where it
        // was.
        let (mut from, mut step) = (own.psi, 0.5 * se);
        for _ in 0..MOVES {
            let values: Vec<f64> = (-8i32..=8)
                .filter(|k| *k != 0 || from != own.psi)
                .map(|k| from + f64::from(k) * step)
                .filter(|x| !positive || *x > 0.0)
                .collect();
            let more = values
                .par_iter()
                .filter_map(|x| self.at(*x).ok().map(|(point, _)| point));
            points.extend(more.collect::<Vec<_>>());
            let errors = points.iter().map(|p| (p.psi, p.error(None)));
            let least = errors.min_by(|a, b| a.1.total_cmp(&b.1));
            let at = least.map_or(own.psi, |(psi, _)| psi);
            if (at - from).abs() < 5.0 * step {
                break;
            }
            (from, step) = (at, 2.0 * step);
        }
        Ok((points, se))
    }

    /// The nonlinear parameter, as it is reported, 1.96 standard errors to either side; `None`
    /// where it is not fitted.
    fn by_error(&self, first: &Point, mine: &[usize], se: f64) -> Option<[f64; 2]> {
        let own = self.chosen();
        let name = own.variant.psi.as_ref().filter(|p| p.refine)?.name;
        let (t, _) = first.sums.fit(None);
        let coef: Vec<f64> = mine.iter().map(|i| t[*i]).collect();
        let at = |psi| {
            let all = own.variant.params(psi, &coef);
            all.iter().find(|p| p.name == name).map(|p| p.value)
        };
        Some([at(own.psi - REACH * se)?, at(own.psi + REACH * se)?])
    }

    /// Standard error of the nonlinear parameter, from the curvature of the squared error. Taken
    /// over about one standard error: an error that has a narrow minimum, or a corner there, is
    /// nearly flat further on.
    fn standard_error(&self, first: &Point, reach: f64, positive: bool) -> Result<f64, Error> {
        let psi = self.chosen().psi;
        let mut h = 0.05 * reach;
        if positive {
            // A width or time that came out far below its grid must stay positive.
            h = h.min(0.5 * psi);
        }
        let centre = first.error(None);
        let n = self.search.problem.y.len() as f64;
        let residual = self.search.fit(self.chosen)?.fit.residual;
        let colour = correlation_rows(&self.search.problem, &residual);
        let mut out = reach;
        for _ in 0..MOVES {
            let rise = [psi - h, psi + h]
                .iter()
                .map(|x| Ok(self.at(*x)?.0.error(None) - centre))
                .collect::<Result<Vec<f64>, Error>>()?;
            let bend = (rise[0] + rise[1]).max(1e-12 * centre) / (h * h);
            let wide = out;
            out = (2.0 * centre / n * colour / bend).sqrt().min(reach);
            if out > wide {
                // So near the estimate no row changes any more.
                out = wide;
                break;
            }
            if !(out > 0.0 && out < 0.5 * h) {
                break;
            }
            h = out;
        }
        Ok(out)
    }

    /// The effect's parameters in each bootstrap replicate over stretches of blocks.
    fn replicates(
        &self,
        points: &[Point],
        mine: &[usize],
        stretches: &[Range<usize>],
    ) -> Vec<Vec<Param>> {
        let blocks = self.search.problem.blocks.len();
        let mut rng = Rng::new(self.search.spec.selection.seed ^ 0xc1);
        let draws: Vec<Vec<f64>> = (0..REPLICATES)
            .map(|_| {
                let mut w = vec![0.0; blocks];
                for _ in 0..stretches.len() {
                    let drawn = stretches[rng.below(stretches.len())].clone();
                    drawn.for_each(|k| w[k] += 1.0);
                }
                w
            })
            .collect();
        self.of_draws(points, mine, &draws)
    }

    /// The effect's parameters with each of the weights of blocks.
    fn of_draws(&self, points: &[Point], mine: &[usize], draws: &[Vec<f64>]) -> Vec<Vec<Param>> {
        draws
            .par_iter()
            .map(|w| {
                let errors = points.iter().map(|p| (p, p.error(Some(w))));
                let best = errors
                    .min_by(|a, b| a.1.total_cmp(&b.1))
                    .map_or(&points[0], |(p, _)| p);
                self.values(best, mine, Some(w))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{around, up_to};
    use residual_columns::linalg::dot;
    use residual_columns::stats::Rng;
    use residual_log::data::Data;

    /// Replicates that all lie beyond the estimate, as where it was chosen in another model.
    #[test]
    fn an_interval_of_a_nonlinear_parameter_goes_on_to_its_replicates() {
        let replicates = vec![2.0; 50];
        assert_eq!(around(1.0, replicates.clone()), [1.0, 2.0]);
        assert_eq!(up_to(1.0, replicates), [1.0, 2.0]);
    }

    /// Slope of `y` over `x` with weights.
    fn slope(w: &[f64], x: &[f64], y: &[f64]) -> f64 {
        let mean = |v: &[f64]| dot(w, v) / w.iter().sum::<f64>();
        let (mx, my) = (mean(x), mean(y));
        let over = |v: &[f64], m: f64| -> f64 {
            let of = |k: usize| w[k] * (x[k] - mx) * (v[k] - m);
            (0..w.len()).map(of).sum()
        };
        over(y, my) / over(x, mx)
    }

    /// Share of intervals that hold the slope 0 of a line through the means of five sequences with
    /// chance values.
    fn covered(fitted: f64) -> f64 {
        let mut rng = Rng::new(7);
        let mut normal = || -> Vec<f64> { (0..5).map(|_| rng.normal()).collect() };
        let mut weights = Rng::new(8);
        let held = (0..2000)
            .filter(|_| {
                let (x, y) = (normal(), normal());
                let draws: Vec<f64> = (0..200)
                    .map(|_| {
                        let w: Vec<f64> = (0..5).map(|_| weights.exponential()).collect();
                        slope(&w, &x, &y)
                    })
                    .collect();
                let [low, high] = super::student(slope(&[1.0; 5], &x, &y), &draws, 5.0, fitted);
                low <= 0.0 && 0.0 <= high
            })
            .count();
        held as f64 / 2000.0
    }

    #[test]
    fn a_line_through_five_means_has_three_degrees_of_freedom() {
        let (mean_only, line) = (covered(1.0), covered(2.0));
        assert!(mean_only < 0.9, "{mean_only}");
        assert!((0.92..0.97).contains(&line), "{line}");
    }

    #[test]
    fn stretches_stay_within_a_sequence() {
        let time: Vec<f64> = (0..6000).map(|i| f64::from(i % 3000) * 0.01).collect();
        let values: Vec<f64> = (0..6000).map(|i| f64::from(i).sin()).collect();
        let data = Data::from_columns(time, [("target", values)])
            .sequences([0..3000, 3000..6000])
            .build()
            .unwrap();
        let problem = residual_search::declared::problem(&data, &Default::default());
        let all = super::stretches(&problem, 4);
        assert_eq!(
            all.iter().map(|s| s.len()).sum::<usize>(),
            problem.blocks.len()
        );
        for s in &all {
            assert!(s.len() <= 4);
            let first = problem.blocks[s.start].sequence;
            assert!(problem.blocks[s.clone()]
                .iter()
                .all(|b| b.sequence == first));
        }
        assert_eq!(super::stretches(&problem, 1).len(), problem.blocks.len());
    }
}
