//! The analysis on sets of `literature_sets`: a generator whose effects, equations and ranges come
//! from the literature and from nobody who has read the analysis.
//!
//! * [`judge`]: which names of the analysis are right for which effect, and which parameters are
//!   compared;
//! * [`table`]: rates beside the goals.

pub mod judge;
pub mod table;

use judge::{Class, Covered};
use literature_sets::effects::{Effect, CATALOGUE};
use literature_sets::excitation::Measured;
use literature_sets::request::Request;
use literature_sets::set::Set;
use literature_sets::write;
use residual::load::Table;
use residual::spec::Spec;
use residual::Report;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Row rates of the sets in Hz, in turn by seed. No tone of the mains lies at a multiple of one of
/// them.
const RATES_HZ: [f64; 3] = [65.0, 90.0, 130.0];

/// What a set is there to test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Group {
    /// One effect that a catalogue can be expected to have.
    One,
    /// Two or three of them.
    Some,
    /// No effect.
    Empty,
    /// One effect outside any catalogue.
    Outside,
}

/// One set to make and to analyse.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Case {
    /// What it tests.
    pub group: Group,
    /// Effects that the declared model lacks.
    #[serde(with = "by_name")]
    pub effects: Vec<&'static Effect>,
    /// RMS of each as a multiple of the noise's.
    pub size: f64,
    /// Seed of the set.
    pub seed: u64,
}

impl Case {
    /// The effects' names, joined by `+`; `none` if there are none.
    #[must_use]
    pub fn truth(&self) -> String {
        if self.effects.is_empty() {
            return "none".into();
        }
        let names: Vec<&str> = self.effects.iter().map(|e| e.name).collect();
        names.join("+")
    }
}

/// Effects in a file: their names.
mod by_name {
    use super::Effect;
    use serde::{de::Error, Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(effects: &[&Effect], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(effects.iter().map(|effect| effect.name))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Vec<&'static Effect>, D::Error> {
        let names = Vec::<String>::deserialize(from)?;
        let effects = names
            .iter()
            .map(|name| literature_sets::effects::by_name(name));
        effects.collect::<Result<_, _>>().map_err(D::Error::custom)
    }
}

/// Which sets to make.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Seeds of each kind of set.
    pub seeds: std::ops::RangeInclusive<u64>,
    /// Sizes of the effects as multiples of the noise's RMS.
    pub sizes: Vec<f64>,
    /// Empty sets for each seed.
    pub empty: u64,
    /// Sets with two or three effects for each seed.
    pub some: u64,
}

impl Plan {
    /// The sets, each with a seed of its own.
    #[must_use]
    pub fn cases(&self) -> Vec<Case> {
        let mut out = Vec::new();
        for seed in self.seeds.clone() {
            let mut add = |group, effects: Vec<&'static Effect>, size| {
                let seed = seed * 10_000 + out.len() as u64 % 10_000;
                out.push(Case {
                    group,
                    effects,
                    size,
                    seed,
                });
            };
            for size in &self.sizes {
                for effect in CATALOGUE {
                    let group = if effect.outside {
                        Group::Outside
                    } else {
                        Group::One
                    };
                    add(group, vec![effect], *size);
                }
                let known: Vec<&Effect> = CATALOGUE.iter().filter(|e| !e.outside).collect();
                for k in 0..self.some as usize {
                    // Neighbours in the catalogue are alike; these are not.
                    let at = 7 * k + seed as usize;
                    let count = 2 + k % 2;
                    let pick = (0..count).map(|i| known[(at + 11 * i) % known.len()]);
                    add(Group::Some, pick.collect(), *size);
                }
            }
            (0..self.empty).for_each(|_| add(Group::Empty, vec![], 0.0));
        }
        out
    }
}

/// What came out for one set.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outcome {
    /// The set.
    pub case: Case,
    /// How the result relates to the truth.
    pub class: Class,
    /// The verdict's word.
    pub verdict: String,
    /// Effects found, the most valuable first.
    pub found: Vec<String>,
    /// Those of them that are not in the set, nor said to be indistinguishable from one that is.
    pub wrong: Vec<String>,
    /// Those of them that are not in the set, but are said to be indistinguishable from one that
    /// is.
    pub grouped: Vec<String>,
    /// Structure without a name, the largest first.
    pub structure: Vec<String>,
    /// Parameters with known truth and their intervals.
    pub covered: Vec<Covered>,
    /// Rows analysed.
    pub rows: usize,
    /// Time of the analysis in seconds.
    pub seconds: f64,
}

/// Makes a set, has it analysed, and compares. `None` if an effect cannot have the size on this
/// motion.
///
/// # Errors
/// The analysis's own message with the set's name: no set should lead to one.
pub fn evaluate(case: &Case, excitation: Option<&Measured>) -> Result<Option<Outcome>, String> {
    let rate = RATES_HZ[(case.seed % RATES_HZ.len() as u64) as usize];
    let mut request = Request::new(case.seed, case.effects.clone(), case.size, rate);
    request.excitation = excitation.cloned();
    let Ok(set) = Set::generate(&request) else {
        return Ok(None);
    };
    let started = Instant::now();
    let named = |e: residual::Error| format!("{} seed {}: {e}", case.truth(), case.seed);
    let report = analyse(&set).map_err(named)?;
    let not_there = |grouped: bool| {
        let names = report.effects.iter().map(|e| e.name);
        names
            .filter(|name| !judge::is_there(*name, &set))
            .filter(|name| judge::is_grouped(*name, &report, &set) == grouped)
            .map(|name| name.to_string())
            .collect()
    };
    Ok(Some(Outcome {
        case: case.clone(),
        class: judge::class(&report, &set),
        verdict: report.verdict.word().to_owned(),
        found: report.effects.iter().map(|e| e.name.to_string()).collect(),
        wrong: not_there(false),
        grouped: not_there(true),
        structure: report
            .structure
            .iter()
            .map(|left| left.depends_on.clone())
            .collect(),
        covered: judge::covered(&report, &set),
        rows: report.rows,
        seconds: started.elapsed().as_secs_f64(),
    }))
}

/// Analyses the set's logs with its declared model, as from files.
fn analyse(set: &Set) -> Result<Report, residual::Error> {
    let spec = Spec::parse(&write::model_toml(set))?;
    let written = |x: f64| (x * 1e6).round() / 1e6;
    let tables = set.runs.iter().enumerate().map(|(i, run)| {
        let table = Table::new(literature_sets::log::file_name(i));
        run.columns
            .iter()
            .enumerate()
            .fold(table, |table, (k, name)| {
                table.with(*name, run.rows.iter().map(|row| written(row[k])).collect())
            })
    });
    residual::analyse(
        &spec,
        residual::load::from_tables(tables.collect(), &spec)?,
        &mut (),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual::{Ambiguity, EffectKind};

    #[test]
    fn a_name_counts_as_grouped_only_beside_one_that_is_in_the_set() {
        let effects = CATALOGUE
            .iter()
            .filter(|e| e.name == "nonlinearity")
            .collect();
        let set = Set::generate(&Request::new(1000, effects, 1.0, 65.0)).expect("a set");
        let mut report = analyse(&set).expect("a report");
        let grouped = |report: &Report| judge::is_grouped(EffectKind::Gain, report, &set);
        let mut with = |kinds: &[EffectKind]| {
            report.not_identifiable = vec![Ambiguity::new(kinds.to_vec(), "")];
            grouped(&report)
        };
        assert!(with(&[EffectKind::Gain, EffectKind::Quadratic]));
        assert!(!with(&[EffectKind::Gain, EffectKind::Offset]));
        // The group is that of another effect.
        assert!(!with(&[EffectKind::Quadratic, EffectKind::Gain]));
    }
}
