//! Which candidates count, which one is taken, and which the data cannot distinguish.

use crate::scan::{t_statistic, Between, Candidate, Scan};
use residual_columns::linalg::similarity;
use residual_effects::EffectRef;
use residual_log::spec::Selection;
use std::cmp::Ordering;

/// p value up to which the means of the sequences confirm a form that acts mostly in them. Few
/// forms do (offset, drift, gain of a constant load), so it isn't divided by the number of all
/// forms.
const BETWEEN: f64 = 0.01;

/// p value up to which a form that hardly changes within a sequence counts beside the noise at its
/// own frequencies. It is a second test of what has passed the first, so it isn't divided by the
/// number of all forms.
const SLOW: f64 = 0.01;

/// Fall of the RMSE that the wander of a zero within its logs can make: more is no noise of a
/// sensor.
pub const RANDOM_WALK: f64 = 0.1;

/// Standard errors from which on a difference of two errors, block by block, is steady.
pub const STEADY: f64 = 2.5;

/// Difference of two gains that may be rounding.
const SAME_GAIN: f64 = 1e-9;

/// What a candidate must reach to count.
#[derive(Clone, Copy)]
pub struct Acceptance<'a> {
    /// What the model file asks for.
    pub selection: &'a Selection,
    /// Number of forms tried: p values are multiplied by it (Bonferroni).
    pub tests: usize,
    /// Smallest RMS of a contribution, in the target's unit.
    pub floor: f64,
    /// Rows fitted.
    pub rows: usize,
}

impl Acceptance<'_> {
    /// Whether a relative fall of the held-out RMSE counts.
    pub fn material(&self, gain: f64) -> bool {
        gain >= self.selection.material
    }

    /// Whether a p value holds for all forms tried together: the family-wise error of Bonferroni.
    pub fn significant(&self, p: f64) -> bool {
        p * self.tests as f64 <= self.selection.familywise_error
    }

    /// Whether what a candidate explains is large enough, and more than decoys let chance explain.
    pub fn fits<O>(&self, c: &Candidate<O>) -> bool {
        let rms = ((c.base - c.held).max(0.0) / self.rows.max(1) as f64).sqrt();
        self.material(c.gain) && self.significant(c.p) && rms > self.floor
    }

    /// Whether a candidate may count at all.
    pub fn accepts<O>(&self, c: &Candidate<O>) -> bool {
        self.fits(c) && c.steady && !self.refused_between(c) && !self.refused_slow(c)
    }

    /// Whether slow noise may make what a slow candidate explains. Not where it explains much: what
    /// else is missing then counts as noise here, and zeros do not wander so far.
    pub fn refused_slow<O>(&self, c: &Candidate<O>) -> bool {
        c.gain <= RANDOM_WALK && c.slow.is_some_and(|p| p > SLOW)
    }

    /// Whether the means of the sequences, which are the evidence for a candidate, do not confirm
    /// it.
    pub fn refused_between<O>(&self, c: &Candidate<O>) -> bool {
        c.between.is_some_and(|b| !self.confirmed_between(&b))
    }

    /// Whether the means of the sequences confirm a candidate.
    pub fn confirmed_between(&self, between: &Between) -> bool {
        between.p <= BETWEEN
    }
}

/// What one step of the search saw.
pub struct Step {
    /// Best candidate of each effect, best first.
    pub ranked: Vec<Candidate>,
    /// Index into `ranked` of the candidate to take.
    pub winner: Option<usize>,
    /// Indices of all that count, best first.
    pub good: Vec<usize>,
}

impl Step {
    /// The candidate to take.
    pub fn winner(&self) -> Option<&Candidate> {
        self.winner.map(|w| &self.ranked[w])
    }

    /// All that count: the one to take, then the others, best first.
    pub fn in_turn(&self) -> impl Iterator<Item = &Candidate> {
        let others = self.good.iter().filter(|i| Some(**i) != self.winner);
        self.winner.iter().chain(others).map(|i| &self.ranked[*i])
    }
}

/// Ranks a scan: one candidate per effect, the simplest of its forms that does nearly as well.
pub fn rank(all: &[Candidate], acceptance: &Acceptance) -> Step {
    let mut names: Vec<&str> = all.iter().map(|c| c.origin.name()).collect();
    names.sort_unstable();
    names.dedup();
    let mut ranked: Vec<Candidate> = names
        .into_iter()
        .filter_map(|name| {
            let mut own: Vec<&Candidate> = all.iter().filter(|c| c.origin.name() == name).collect();
            own.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            // A form that counts isn't hidden by one that explains more and doesn't.
            if own.iter().any(|c| acceptance.accepts(c)) {
                own.retain(|c| acceptance.accepts(c));
            }
            let best = own.first().copied()?;
            let observed = own
                .iter()
                .find(|c| c.variant.observed && acceptance.accepts(c));
            let chosen = observed.copied();
            Some(
                chosen
                    .unwrap_or_else(|| simplest(own.into_iter(), best))
                    .clone(),
            )
        })
        .collect();
    ranked.sort_by(better);
    let good: Vec<usize> = (0..ranked.len())
        .filter(|&i| acceptance.accepts(&ranked[i]))
        .collect();
    // What the target itself shows needs no model, and comes first.
    let observed = good.iter().copied().find(|i| ranked[*i].variant.observed);
    let winner = observed.or_else(|| {
        let best = *good.first()?;
        let simple = simplest(good.iter().map(|i| &ranked[*i]), &ranked[best]);
        ranked.iter().position(|c| std::ptr::eq(c, simple))
    });
    Step {
        ranked,
        winner,
        good,
    }
}

/// The candidate with the larger gain first. Two with the same curve, as an inertia and a hanging
/// mass beside an offset, have the same gain up to rounding: then the simpler explanation, which
/// the catalogue has first.
fn better(a: &Candidate, b: &Candidate) -> Ordering {
    let (own, other) = (a.origin.kind() as usize, b.origin.kind() as usize);
    let whole = |c: &Candidate| (c.gain / SAME_GAIN).round();
    whole(b).total_cmp(&whole(a)).then(own.cmp(&other))
}

/// The candidate with the fewest parameters that stands for `best`; of several the best.
fn simplest<'a>(
    candidates: impl Iterator<Item = &'a Candidate>,
    best: &'a Candidate,
) -> &'a Candidate {
    candidates
        .filter(|c| stands_for(c, best))
        .min_by(|a, b| a.parameters.cmp(&b.parameters).then(better(a, b)))
        .unwrap_or(best)
}

/// Whether `simple` explains what `best` explains: all but 3 % of it, or nearly so
/// without a steady difference.
fn stands_for(simple: &Candidate, best: &Candidate) -> bool {
    if simple.parameters >= best.parameters && simple.origin.kind() != best.origin.kind() {
        // With as many parameters the better fit is the better claim.
        return simple.held <= best.held;
    }
    let lost = (simple.held - best.held) / (best.base - best.held).max(f64::MIN_POSITIVE);
    lost < 0.03 || (lost < 0.15 && t_statistic(&simple.losses, &best.losses) < 1.5)
}

/// Rivals that the data cannot distinguish from the candidate at `index`: as many parameters, the
/// same curve, no error that is steadily larger.
pub fn indistinguishable(scan: &Scan, step: &Step, index: usize) -> Vec<EffectRef> {
    let w = &step.ranked[index];
    let own = scan.contribution(w);
    if own.is_empty() {
        return vec![];
    }
    step.ranked
        .iter()
        .enumerate()
        .filter(|(i, c)| *i != index && c.parameters <= w.parameters && c.gain > 0.0)
        .filter(|(_, c)| {
            (c.held - w.held).abs() < 0.05 * (w.base - w.held)
                && t_statistic(&c.losses, &w.losses) < STEADY
        })
        .filter(|(_, c)| !same_formula(w, c))
        .filter(|(_, c)| similarity(&own, &scan.contribution(c)) > 0.98)
        .map(|(_, c)| c.origin)
        .collect()
}

/// Whether two candidates are one formula under two names, as Dahl's friction over a short distance
/// (presliding) and a longer one (hysteresis): then the fitted distance decides on the name.
fn same_formula(a: &Candidate, b: &Candidate) -> bool {
    let texts = |c: &Candidate, psi: f64| match (c.variant.build)(psi) {
        residual_effects::Build::Add(p) => p.into_iter().map(|p| p.text).collect(),
        _ => vec![],
    };
    let (own, other) = (texts(a, a.psi), texts(b, a.psi));
    a.variant.psi.is_some() && !own.is_empty() && own == other
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_effects::{effect, EffectKind, Variant};
    use std::sync::Arc;

    fn candidate(kind: EffectKind, gain: f64, parameters: usize) -> Candidate {
        Candidate {
            origin: effect(kind),
            variant: Arc::new(Variant::linear("", vec![])),
            psi: 0.0,
            gain,
            held: 100.0 * (1.0 - gain).powi(2),
            base: 100.0,
            p: 1e-9,
            t: 9.0,
            steady: true,
            local_in_time: false,
            parameters,
            between: None,
            slow: None,
            losses: vec![],
        }
    }

    fn acceptance(selection: &Selection, tests: usize) -> Acceptance<'_> {
        Acceptance {
            selection,
            tests,
            floor: 0.0,
            rows: 1000,
        }
    }

    #[test]
    fn the_simpler_of_two_that_explain_the_same_is_taken() {
        let selection = Selection::default();
        let acceptance = acceptance(&selection, 60);
        let all = [
            candidate(EffectKind::Stribeck, 0.300, 3),
            candidate(EffectKind::Coulomb, 0.295, 1),
            candidate(EffectKind::Gain, 0.01, 1),
        ];
        let step = rank(&all, &acceptance);
        let kind = |c: &Candidate| c.origin.kind();
        assert_eq!(step.winner().map(kind), Some(EffectKind::Coulomb));
        let turn: Vec<EffectKind> = step.in_turn().map(kind).collect();
        assert_eq!(turn, [EffectKind::Coulomb, EffectKind::Stribeck]);
        assert_eq!(step.good.len(), 2);
    }

    /// An inertia and a hanging mass beside an offset have one curve, and differ by rounding.
    #[test]
    fn of_two_with_the_same_gain_the_one_that_the_catalogue_has_first_is_taken() {
        let selection = Selection::default();
        let acceptance = acceptance(&selection, 60);
        let all = [
            candidate(EffectKind::Payload, 0.3 + 1e-13, 1),
            candidate(EffectKind::Inertia, 0.3, 1),
        ];
        let step = rank(&all, &acceptance);
        let kinds: Vec<EffectKind> = step.in_turn().map(|c| c.origin.kind()).collect();
        assert_eq!(kinds, [EffectKind::Inertia, EffectKind::Payload]);
    }

    #[test]
    fn p_values_are_corrected_for_the_number_of_forms() {
        let selection = Selection::default();
        let with = |tests| acceptance(&selection, tests);
        let mut c = candidate(EffectKind::Coulomb, 0.3, 1);
        c.p = 0.002;
        assert!(with(20).accepts(&c) && !with(30).accepts(&c));
        c.p = 0.0;
        c.steady = false;
        assert!(!with(20).accepts(&c));
    }
}
