//! What counts as right. All rules for that are in this file.
//!
//! A name is right only if it is the true effect's own name, with one exception:
//!
//! * `hysteresis` of the generator is Dahl's formula over the cable's travel, with a turning
//!   distance of 3 to 8 mm. The catalogue has the same formula twice, as `hysteresis`
//!   (`loop of position`) and, for turning distances that are short against the range, as
//!   `presliding` (`elastic turn`). Either name is right.
//!
//! In particular `coulomb` called `load_dependent_coulomb` is wrong, and so is the reverse;
//! `presliding` (the friction of the whole log that keeps its direction at rest) called `coulomb`
//! is wrong.
//!
//! *A or B* is not right either, whether the verdict is `not_identifiable` or another course of the
//! search predicts as well: it has a class of its own where the true effect is among the names, and
//! counts as wrong where it is not.

use residual::{Effect, EffectKind, Form, Report, Verdict};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use synthetic_sets::{effect::Effect as True, Kind};

/// How a result relates to the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Class {
    /// The true effect comes first; for empty sets: `none`; for uncatalogued ones: `unknown`.
    Right,
    /// The true effect is among several names that are given first: *A or B*.
    Among,
    /// Something is said to be missing, but not what.
    Unknown,
    /// Nothing is said to be missing.
    None,
    /// Another effect comes first.
    Wrong,
}

/// Whether a found effect is the true one.
#[must_use]
pub fn is(kind: Kind, name: EffectKind, form: Form) -> bool {
    name == kind.name()
        || (kind == Kind::Hysteresis && name == EffectKind::Presliding && form == Form::ElasticTurn)
}

/// The same for a name without form, as in a list of effects that cannot be told apart.
fn among(kind: Kind, names: &[EffectKind]) -> bool {
    names.iter().any(|name| *name == kind.name())
}

/// How many effects of a report are none of the kinds in the set, but are given as *A or B* with
/// one of them that the report does not name by itself.
#[must_use]
pub fn grouped(report: &Report, kinds: &[Kind]) -> usize {
    let named = |kind: &Kind| {
        let mut all = report.effects.iter();
        all.any(|e| is(*kind, e.name, e.form_kind))
    };
    let missing: Vec<Kind> = kinds.iter().copied().filter(|k| !named(k)).collect();
    let wrong = |e: &&Effect| !kinds.iter().any(|kind| is(*kind, e.name, e.form_kind));
    let all = report.effects.iter().filter(wrong);
    all.filter(|e| {
        let others = report.others(e.name).concat();
        missing.iter().any(|kind| among(*kind, &others))
    })
    .count()
}

/// Compares a report with the kinds that are in the set.
#[must_use]
pub fn class(report: &Report, kinds: &[Kind], uncatalogued: bool) -> Class {
    if kinds.is_empty() {
        return match report.verdict {
            Verdict::None => Class::Right,
            Verdict::Unknown => Class::Unknown,
            _ => Class::Wrong,
        };
    }
    match report.verdict {
        Verdict::None => Class::None,
        Verdict::Unknown if uncatalogued => Class::Right,
        Verdict::Unknown => Class::Unknown,
        _ => match report.effects.first() {
            Some(first) => named(report, first, kinds),
            None => Class::Wrong,
        },
    }
}

/// The class of the effect that is named first, with those that may stand for it.
fn named(report: &Report, first: &Effect, kinds: &[Kind]) -> Class {
    let others = report.others(first.name);
    let right = kinds
        .iter()
        .any(|kind| is(*kind, first.name, first.form_kind));
    let listed = |kind: &Kind| among(*kind, &others.concat());
    match (right, others.is_empty()) {
        (true, true) => Class::Right,
        (true, false) => Class::Among,
        _ if kinds.iter().any(listed) => Class::Among,
        _ => Class::Wrong,
    }
}

/// Column of the confusion table: the first effect named, [`EITHER`] where another name may stand
/// for it, or the verdict where none counts as named.
#[must_use]
pub fn answer(report: &Report) -> String {
    match (report.verdict, report.effects.first()) {
        (Verdict::Effect | Verdict::Several, Some(first)) => {
            if report.others(first.name).is_empty() {
                first.name.to_string()
            } else {
                EITHER.into()
            }
        }
        (Verdict::NotIdentifiable, _) => EITHER.into(),
        (other, _) => other.word().into(),
    }
}

/// What stands in the tables for several names of which one is given.
pub const EITHER: &str = "A or B";

/// A parameter of the truth and its estimate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Name with unit, as the generator has it.
    pub name: String,
    /// What was put in.
    pub truth: f64,
    /// What was found, in the same unit and sign.
    pub found: f64,
}

impl Estimate {
    /// Error as a share of the truth.
    #[must_use]
    pub fn error(&self) -> f64 {
        (self.found / self.truth - 1.0).abs()
    }
}

/// Parameters of a found effect beside the true ones. A parameter that the found form does not have
/// is 100 % off.
///
/// The phase of a ripple is left out (a share of an angle means nothing). The generator's friction
/// and inertia are positive where they oppose motion; the analysis gives the coefficient of the
/// velocity's sign, the velocity or the acceleration, which is then negative.
#[must_use]
pub fn estimates(truth: &True, found: &Effect) -> Vec<Estimate> {
    let get = |name: &str| found.params.get(name).copied().unwrap_or(0.0);
    truth
        .parameters()
        .into_iter()
        .filter(|(name, _)| *name != "phase_rad")
        .map(|(name, value)| {
            let found = match (truth.kind, name) {
                (Kind::Coulomb, _) => -get("friction"),
                (Kind::LoadDependentCoulomb, _) => -get("friction_per_load"),
                (Kind::Viscous, _) => -get("damping"),
                (Kind::Stribeck, "friction_n") => -get("extra_at_low_speed"),
                (Kind::Stribeck, _) => get("stribeck_velocity"),
                (Kind::Presliding, _) => -either(&found.params, &["friction", "held_friction"]),
                (Kind::Hysteresis, "force_n") => {
                    -either(&found.params, &["half_height", "friction"])
                }
                (Kind::Hysteresis, _) => {
                    either(&found.params, &["turning_width", "presliding_distance"])
                }
                (Kind::PeriodicAngle, "amplitude_n") => get("amplitude"),
                (Kind::PeriodicAngle, _) => get("order"),
                (Kind::Inertia, _) => -get("inertia"),
                (Kind::Delay, _) => get("delay"),
                (Kind::ClockSkew, _) => -get("skew"),
                (Kind::Gain, _) => get("gain_error"),
                (Kind::Offset, _) => get("offset"),
                (Kind::Quadratic, _) => get("curvature"),
                (Kind::Saturation, _) => get("upper_limit"),
                (Kind::DriftTime, _) => get("drift"),
                (Kind::DriftTemperature, _) => get("drift_per_degree"),
                (Kind::Creep, "fraction") => get("creep_share"),
                (Kind::Creep, _) => get("time_constant"),
                (Kind::Crosstalk, _) => get("share_of_neighbour"),
                (Kind::Tone, "amplitude_n") => get("amplitude"),
                (Kind::Tone, _) => get("frequency"),
                _ => f64::NAN,
            };
            Estimate {
                name: name.to_owned(),
                truth: value,
                found,
            }
        })
        .collect()
}

/// The first of `names` that is there; 0 if none is.
fn either(params: &BTreeMap<String, f64>, names: &[&str]) -> f64 {
    names
        .iter()
        .find_map(|name| params.get(*name))
        .copied()
        .unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The report of a set with dry friction, three times the noise.
    fn report() -> Report {
        let plan = crate::case::Plan {
            seeds: 10_000..=10_000,
            kind: Some(Kind::Coulomb),
            quick: false,
        };
        let case = plan.cases().remove(0);
        let set = synthetic_sets::generate(&case.recipe());
        crate::evaluate::analyse(&set).expect("a report")
    }

    #[test]
    fn one_of_several_names_is_a_class_of_its_own() {
        use EffectKind::{Coulomb, Gain, Hysteresis, Viscous};
        let mut report = report();
        let of = |report: &Report| (class(report, &[Kind::Coulomb], false), answer(report));
        assert_eq!(of(&report), (Class::Right, "coulomb".into()));
        let either = |effects, instead| residual::EqualPath {
            effects,
            instead,
            heldout_rmse: 1.0,
        };
        report.equal_paths = vec![either(vec![Coulomb], vec![Hysteresis, Gain])];
        assert_eq!(of(&report), (Class::Among, EITHER.into()));
        // The true one may be the other.
        report.effects[0].name = Viscous;
        report.equal_paths = vec![either(vec![Viscous], vec![Coulomb])];
        assert_eq!(of(&report).0, Class::Among);
        report.equal_paths = vec![either(vec![Viscous], vec![Gain])];
        assert_eq!(of(&report).0, Class::Wrong);
        // It is that of another effect.
        report.equal_paths = vec![either(vec![Gain], vec![Coulomb])];
        assert_eq!(of(&report).0, Class::Wrong);
        report.equal_paths.clear();
        report.not_identifiable = vec![residual::Ambiguity::new(vec![Viscous, Coulomb], "")];
        assert_eq!(of(&report).0, Class::Among);
    }

    #[test]
    fn only_the_same_physics_passes_for_the_same() {
        use EffectKind::{Coulomb, LoadDependentCoulomb, Presliding};
        assert!(is(Kind::Hysteresis, Presliding, Form::ElasticTurn));
        assert!(!is(Kind::Hysteresis, Presliding, Form::AtRest));
        assert!(!is(Kind::Coulomb, LoadDependentCoulomb, Form::Other));
        assert!(!is(Kind::Presliding, Coulomb, Form::Other));
        for kind in Kind::KNOWN {
            let named = EffectKind::named(kind.name());
            assert!(
                named.is_some_and(|name| is(kind, name, Form::Other)),
                "{}",
                kind.name()
            );
        }
        for kind in Kind::UNCATALOGUED.into_iter().chain(Kind::IMPURE) {
            assert!(!residual::names().contains(&kind.name()), "{}", kind.name());
        }
    }
}
