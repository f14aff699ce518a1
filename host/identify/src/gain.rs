//! How much better the force is held with the findings: gain over repeated pairs of runs, with its
//! interval.
//!
//! One pair shows a gain of a few per cent by chance as often as not: zeros are taken anew for each
//! run, and the robot does not move twice in the same way. So the pair is repeated until the
//! interval of a gain excludes zero: that of the worst cable, or that of one cable. The worst of
//! six is another one from run to run, so that it shows little of what one unit alone has.
//!
//! It is looked at after each pair, up to nine times, and each look has a chance of its own to
//! exclude zero wrongly. The intervals of one look together are therefore those of 99 %, half of
//! the rest for the worst cable and half shared by the single ones: where nothing changes, one of
//! the nine looks decides in 5 % of all trials, as a test counts.

use super::Figures;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::fmt;
use wire::UNITS;

/// Smallest reduction of the worst cable's error that counts, as a part of it.
const MATERIAL: f64 = 0.02;
/// Largest growth of the tip's error that is accepted, as a part of it.
const TIP_MARGIN: f64 = 0.05;
/// Fewest pairs of which the spread says something.
pub const FEWEST_PAIRS: usize = 2;
/// Most pairs of runs.
pub const MOST_PAIRS: usize = 10;
/// Part of all looks of one kind in which the worst cable's interval, or one of the single cables',
/// excludes zero by chance.
const ALPHA: f64 = 0.005;

/// One run without the findings and one with them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pair {
    /// Without.
    pub before: Figures,
    /// With.
    pub after: Figures,
}

/// Reduction of a tension error over pairs of runs, as a part of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reduction {
    /// Mean over the pairs; 0.1 is an error that is smaller by 10 %.
    pub mean: f64,
    /// Interval of the mean, 95 % over all looks and cables. `None` for one pair.
    pub interval: Option<[f64; 2]>,
}

impl Reduction {
    /// Of the logarithms of the ratios after to before, by Student's t where a part `alpha` of all
    /// intervals does not hold the mean. Ratios multiply, so that their logarithms are what spreads
    /// evenly.
    fn of(logs: &[f64], alpha: f64) -> Self {
        let n = logs.len() as f64;
        let mean = logs.iter().sum::<f64>() / n;
        let part = |log: f64| 1.0 - log.exp();
        let interval = StudentsT::new(0.0, 1.0, n - 1.0).ok().map(|student| {
            let variance = logs.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let half = student.inverse_cdf(1.0 - 0.5 * alpha) * (variance / n).sqrt();
            [part(mean + half), part(mean - half)]
        });
        Self {
            mean: part(mean),
            interval,
        }
    }

    /// Whether the interval excludes zero, above it or below.
    fn is_sure(&self) -> bool {
        self.interval
            .is_some_and(|[low, high]| low > 0.0 || high < 0.0)
    }
}

impl fmt::Display for Reduction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} %", 100.0 * self.mean)?;
        if let Some([low, high]) = self.interval {
            write!(f, " (95 %: {:.1} to {:.1} %)", 100.0 * low, 100.0 * high)?;
        }
        Ok(())
    }
}

/// What the findings are worth over pairs of runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gain {
    /// Pairs.
    pub pairs: usize,
    /// Of the worst cable of each run.
    #[serde(flatten)]
    pub worst: Reduction,
    /// Of each cable; `None` for one without a tension.
    pub cables: [Option<Reduction>; UNITS],
    /// Mean growth of the error at the tip, as a part of it.
    pub tip_growth: f64,
}

impl Gain {
    /// Of pairs of runs; equal ones count once, as a copy confirms nothing. `None` without a pair,
    /// or where the error is zero, infinite or NaN.
    #[must_use]
    pub fn of(pairs: &[Pair]) -> Option<Self> {
        let mut used: Vec<&Pair> = Vec::new();
        for pair in pairs {
            if used.len() < MOST_PAIRS && !used.contains(&pair) {
                used.push(pair);
            }
        }
        if used.is_empty() {
            return None;
        }
        let logs = |f: &dyn Fn(&Figures) -> f64| -> Option<Vec<f64>> {
            used.iter()
                .map(|p| {
                    let log = (f(&p.after) / f(&p.before)).ln();
                    log.is_finite().then_some(log)
                })
                .collect()
        };
        let tip = logs(&|f| f.tip_rms_n)?;
        Some(Self {
            pairs: used.len(),
            worst: Reduction::of(&logs(&|f| f.worst_tension_rms_n)?, ALPHA),
            cables: core::array::from_fn(|i| {
                let logs = logs(&|f| f.tension_rms_n[i])?;
                Some(Reduction::of(&logs, ALPHA / UNITS as f64))
            }),
            tip_growth: (tip.iter().sum::<f64>() / tip.len() as f64).exp() - 1.0,
        })
    }

    /// The cables that changed for sure, with their numbers from 1.
    fn sure(&self) -> impl Iterator<Item = (usize, Reduction)> + '_ {
        (1..)
            .zip(self.cables)
            .filter_map(|(number, cable)| Some((number, cable?)))
            .filter(|(_, cable)| cable.is_sure())
    }

    /// Whether another pair could change nothing: an interval excludes zero.
    #[must_use]
    pub fn is_decided(&self) -> bool {
        self.worst.is_sure() || self.sure().next().is_some()
    }

    /// Whether the findings make it better: the worst cable or a single one gains for sure, and 2 %
    /// or more; none loses 2 % for sure; the worst cable loses no 2 %, and the tip no 5 %.
    #[must_use]
    pub fn is_better(&self) -> bool {
        let gains = |cable: Reduction| cable.is_sure() && cable.mean >= MATERIAL;
        (gains(self.worst) || self.sure().any(|(_, cable)| gains(cable)))
            && self.sure().all(|(_, cable)| cable.mean > -MATERIAL)
            && self.worst.mean > -MATERIAL
            && self.tip_growth <= TIP_MARGIN
    }
}

impl fmt::Display for Gain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let runs = if self.pairs == 1 { "pair" } else { "pairs" };
        write!(f, "{}", self.worst)?;
        for (number, cable) in self.sure() {
            write!(f, ", cable {number} {cable}")?;
        }
        write!(f, " over {} {runs} of runs", self.pairs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use random::SplitMix64;
    use wire::UNITS;

    /// Without single cables.
    fn figures(worst: f64, tip: f64) -> Figures {
        Figures {
            tension_rms_n: [0.0; UNITS],
            worst_tension_rms_n: worst,
            tip_rms_n: tip,
            from_truth: true,
        }
    }

    /// A run of six cables.
    fn cables(tension_rms_n: [f64; UNITS]) -> Figures {
        Figures {
            tension_rms_n,
            ..figures(tension_rms_n.into_iter().fold(0.0, f64::max), 0.1)
        }
    }

    fn pairs(afters: &[f64]) -> Vec<Pair> {
        let pair = |after: &f64| Pair {
            before: figures(0.1, 0.1),
            after: figures(*after, 0.1),
        };
        afters.iter().map(pair).collect()
    }

    #[test]
    fn one_pair_decides_nothing() {
        let gain = Gain::of(&pairs(&[0.05])).unwrap();
        assert!((gain.worst.mean - 0.5).abs() < 1e-9);
        assert!(!gain.is_decided() && !gain.is_better());
        assert_eq!(gain.to_string(), "50.0 % over 1 pair of runs");
    }

    /// An emulated rig may repeat a run to the last digit.
    #[test]
    fn copies_of_a_pair_decide_nothing() {
        let gain = Gain::of(&pairs(&[0.05, 0.05, 0.05])).unwrap();
        assert_eq!((gain.pairs, gain.worst.interval), (1, None));
        assert!(!gain.is_decided());
        let two = Gain::of(&pairs(&[0.05, 0.052, 0.05])).unwrap();
        assert_eq!(two, Gain::of(&pairs(&[0.05, 0.052])).unwrap());
    }

    #[test]
    fn a_gain_that_is_always_there_is_decided_and_one_that_varies_is_not() {
        let clear = Gain::of(&pairs(&[0.05, 0.052, 0.051])).unwrap();
        assert!(clear.is_better(), "{clear}");
        // Two pairs are alike by chance more often than it seems.
        let early = Gain::of(&pairs(&[0.05, 0.052])).unwrap();
        assert!(!early.is_decided(), "{early}");
        // 2 % on the mean, by chance.
        let chance = Gain::of(&pairs(&[0.104, 0.092, 0.098])).unwrap();
        assert!(
            chance.worst.mean > MATERIAL && !chance.is_decided(),
            "{chance}"
        );
        let worse = Gain::of(&pairs(&[0.12, 0.121, 0.122])).unwrap();
        assert!(worse.is_decided() && !worse.is_better(), "{worse}");
        // Sure, but too small to count.
        let small = Gain::of(&pairs(&[0.099, 0.0991, 0.0992])).unwrap();
        assert!(small.is_decided() && !small.is_better(), "{small}");
    }

    #[test]
    fn a_loss_at_the_tip_is_no_gain() {
        let mut all = pairs(&[0.05, 0.051, 0.052]);
        assert!(Gain::of(&all).unwrap().is_better());
        all.iter_mut().for_each(|p| p.after.tip_rms_n = 0.106);
        assert!(!Gain::of(&all).unwrap().is_better());
    }

    #[test]
    fn the_interval_is_students() {
        // Logarithms of the ratios: -0.6, -0.4, -0.5; standard error 0.1 / sqrt(3).
        let all = pairs(&[-0.6f64, -0.4, -0.5].map(|log| 0.1 * log.exp()));
        let [low, high] = Gain::of(&all).unwrap().worst.interval.unwrap();
        // Two degrees of freedom, 99.75 %: a table's 14.089.
        let half = 14.089 * 0.1 / 3f64.sqrt();
        assert!((low - (1.0 - (-0.5 + half).exp())).abs() < 1e-4, "{low}");
        assert!((high - (1.0 - (-0.5 - half).exp())).abs() < 1e-4, "{high}");
    }

    /// Six cables with 0.024 N in each run, give and take 5 %, and one with so much more before
    /// and after; pair by pair until it is decided.
    fn trial(random: &mut SplitMix64, more: [f64; 2]) -> Gain {
        let mut run = |more: f64| {
            let mut tensions = [0.024; UNITS].map(|rms| rms * (0.05 * random.normal()).exp());
            tensions[2] *= more;
            cables(tensions)
        };
        let mut all = Vec::new();
        loop {
            all.push(Pair {
                before: run(more[0]),
                after: run(more[1]),
            });
            let gain = Gain::of(&all).unwrap();
            if gain.is_decided() || all.len() == MOST_PAIRS {
                return gain;
            }
        }
    }

    /// The chance of all looks at all cables together.
    #[test]
    fn where_nothing_changes_one_trial_in_twenty_decides() {
        let mut random = SplitMix64::new(7);
        let trials = 4_000;
        let (mut decided, mut better) = (0, 0);
        for _ in 0..trials {
            let gain = trial(&mut random, [1.0, 1.0]);
            decided += i32::from(gain.is_decided());
            better += i32::from(gain.is_better());
        }
        // Three standard deviations of the count are 1 % and 0.7 %.
        assert!((160..=240).contains(&decided), "{decided} of {trials}");
        assert!(better <= 130, "{better} of {trials}");
    }

    /// The worst of six cables shows a quarter that one gains as an eighth, with much scatter.
    #[test]
    fn what_one_cable_gains_is_found_in_that_cable() {
        let mut random = SplitMix64::new(8);
        let mut count = |more: [f64; 2]| {
            let better = |_: &i32| trial(&mut random, more).is_better();
            (0..200).filter(better).count()
        };
        // Another cable decides by chance in one of twenty.
        let (gains, loses) = (count([1.3, 1.0]), count([1.0, 1.3]));
        assert!(gains >= 190 && loses <= 5, "{gains}, {loses}");
    }

    #[test]
    fn a_cable_that_loses_for_sure_outweighs_one_that_gains() {
        let pair = |i: i32| Pair {
            before: cables([0.05, 0.02, 0.02, 0.02, 0.02, 0.02]),
            after: cables([0.03 + 1e-6 * f64::from(i), 0.02, 0.02, 0.02, 0.02, 0.024]),
        };
        let all: Vec<Pair> = (0..4).map(pair).collect();
        let gain = Gain::of(&all).unwrap();
        assert!(gain.worst.is_sure() && gain.worst.mean > 0.3, "{gain}");
        assert!(gain.is_decided() && !gain.is_better(), "{gain}");
        assert!(gain.to_string().contains("cable 6 -20.0 %"), "{gain}");
    }

    #[test]
    fn without_figures_there_is_no_gain() {
        assert_eq!(Gain::of(&[]), None);
        assert_eq!(Gain::of(&pairs(&[f64::NAN])), None);
        // More pairs than the table has are not used.
        let many: Vec<f64> = (0..20).map(|i| 0.05 + 1e-4 * f64::from(i)).collect();
        assert_eq!(Gain::of(&pairs(&many)).unwrap().pairs, MOST_PAIRS);
    }
}
