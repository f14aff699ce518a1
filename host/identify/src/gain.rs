//! How much better the force is held with the findings: gain over repeated pairs of runs, with its
//! interval.
//!
//! One pair shows a gain of a few per cent by chance as often as not: zeros are taken anew for each
//! run, and the robot does not move twice in the same way. So the pair is repeated until the
//! interval of the gain excludes zero. It is looked at after each pair, up to nine times, and each
//! look has a chance of its own to exclude zero wrongly. The interval of one look is therefore that
//! of 99 %: where nothing changes, one of the nine looks decides in 5 % of all trials, as a test
//! counts.

use super::Figures;
use serde::Serialize;
use std::fmt;

/// Smallest reduction of the worst cable's error that counts, as a part of it.
const MATERIAL: f64 = 0.02;
/// Largest growth of the tip's error that is accepted, as a part of it.
const TIP_MARGIN: f64 = 0.05;
/// Fewest pairs of which the spread says something.
pub const FEWEST_PAIRS: usize = 2;
/// Most pairs of runs.
pub const MOST_PAIRS: usize = 10;
/// 99.5 % quantiles of Student's t distribution for 1 to 9 degrees of freedom.
const T_995: [f64; MOST_PAIRS - 1] = [
    63.657, 9.925, 5.841, 4.604, 4.032, 3.707, 3.499, 3.355, 3.250,
];

/// One run without the findings and one with them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pair {
    /// Without.
    pub before: Figures,
    /// With.
    pub after: Figures,
}

/// Reduction of the worst cable's tension error over pairs of runs, as a part of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gain {
    /// Pairs.
    pub pairs: usize,
    /// Mean over the pairs; 0.1 is an error that is smaller by 10 %.
    pub mean: f64,
    /// Interval of the mean, 95 % over all looks: 99 % by Student's t for this one. `None` for one
    /// pair.
    pub interval: Option<[f64; 2]>,
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
        let logs = |f: &dyn Fn(&Figures) -> f64| -> Option<Vec<f64>> {
            used.iter()
                .map(|p| {
                    let log = (f(&p.after) / f(&p.before)).ln();
                    log.is_finite().then_some(log)
                })
                .collect()
        };
        // Ratios multiply, so their logarithms are what spreads evenly.
        let worst = logs(&|f| f.worst_tension_rms_n)?;
        let tip = logs(&|f| f.tip_rms_n)?;
        let n = worst.len() as f64;
        if worst.is_empty() {
            return None;
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
        let m = mean(&worst);
        let part = |log: f64| 1.0 - log.exp();
        let interval = T_995.get(worst.len().wrapping_sub(2)).map(|t| {
            let variance = worst.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (n - 1.0);
            let half = t * (variance / n).sqrt();
            [part(m + half), part(m - half)]
        });
        Some(Self {
            pairs: worst.len(),
            mean: part(m),
            interval,
            tip_growth: mean(&tip).exp() - 1.0,
        })
    }

    /// Whether another pair could change nothing: the interval of the gain excludes zero.
    #[must_use]
    pub fn is_decided(&self) -> bool {
        self.interval
            .is_some_and(|[low, high]| low > 0.0 || high < 0.0)
    }

    /// Whether the findings make it better: a gain above zero for sure, of 2 % or more, and no loss
    /// at the tip above 5 %.
    #[must_use]
    pub fn is_better(&self) -> bool {
        self.is_decided() && self.mean >= MATERIAL && self.tip_growth <= TIP_MARGIN
    }
}

impl fmt::Display for Gain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} %", 100.0 * self.mean)?;
        if let Some([low, high]) = self.interval {
            write!(f, " (95 %: {:.1} to {:.1} %)", 100.0 * low, 100.0 * high)?;
        }
        let runs = if self.pairs == 1 { "pair" } else { "pairs" };
        write!(f, " over {} {runs} of runs", self.pairs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use random::SplitMix64;
    use wire::UNITS;

    fn figures(worst: f64, tip: f64) -> Figures {
        Figures {
            tension_rms_n: [worst; UNITS],
            worst_tension_rms_n: worst,
            tip_rms_n: tip,
            from_truth: true,
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
        assert!((gain.mean - 0.5).abs() < 1e-9);
        assert!(!gain.is_decided() && !gain.is_better());
        assert_eq!(gain.to_string(), "50.0 % over 1 pair of runs");
    }

    /// An emulated rig may repeat a run to the last digit.
    #[test]
    fn copies_of_a_pair_decide_nothing() {
        let gain = Gain::of(&pairs(&[0.05, 0.05, 0.05])).unwrap();
        assert_eq!((gain.pairs, gain.interval), (1, None));
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
        assert!(chance.mean > MATERIAL && !chance.is_decided(), "{chance}");
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
        let [low, high] = Gain::of(&all).unwrap().interval.unwrap();
        let half = 9.925 * 0.1 / 3f64.sqrt();
        assert!((low - (1.0 - (-0.5 + half).exp())).abs() < 1e-9, "{low}");
        assert!((high - (1.0 - (-0.5 - half).exp())).abs() < 1e-9, "{high}");
    }

    /// Findings that change nothing, tried pair by pair until it is decided: the chance of all
    /// looks together.
    #[test]
    fn where_nothing_changes_one_trial_in_twenty_decides() {
        let mut random = SplitMix64::new(7);
        let trials = 4_000;
        let (mut decided, mut better) = (0, 0);
        for _ in 0..trials {
            let mut afters = Vec::new();
            let gain = loop {
                afters.push(0.1 * (0.1 * random.normal()).exp());
                let gain = Gain::of(&pairs(&afters)).unwrap();
                if gain.is_decided() || afters.len() == MOST_PAIRS {
                    break gain;
                }
            };
            decided += i32::from(gain.is_decided());
            better += i32::from(gain.is_better());
        }
        // Three standard deviations of the count are 1 % and 0.7 %.
        assert!((160..=240).contains(&decided), "{decided} of {trials}");
        assert!(better <= 130, "{better} of {trials}");
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
