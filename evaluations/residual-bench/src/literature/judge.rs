//! What counts as right on sets of the literature generator. All rules for that are in this file.
//!
//! A name is right for an effect if it stands for the effect itself, for a name that `truth.json`
//! calls the same force (`exact`), for a part that the effect contains, or for an alternative that
//! was fitted to the effect on these data and left less than half of the noise.

use literature_sets::effects::Equivalence;
use literature_sets::set::{Missing, Set};
use literature_sets::REEL_RADIUS_M;
use residual::{EffectKind, Report, Verdict};
use serde::{Deserialize, Serialize};

/// RMS that an alternative may leave of an effect, over the RMS of the noise, to count as the same.
const ALIKE: f64 = 0.5;

/// How a result relates to the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Class {
    /// A true effect comes first, or is in the group that comes first; for empty sets: `none`; for
    /// outside ones: `unknown`.
    Right,
    /// Something is said to be missing, but not what.
    Unknown,
    /// Nothing is said to be missing.
    None,
    /// Another effect comes first.
    Wrong,
}

/// Names of the literature that a kind of the analysis stands for.
fn stands_for(kind: EffectKind) -> &'static [&'static str] {
    match kind {
        EffectKind::Coulomb => &["coulomb", "dry friction"],
        EffectKind::Kink => &["kink"],
        EffectKind::AngleFriction => &["sector-friction"],
        EffectKind::LoadDependentCoulomb => &["capstan", "load-proportional coulomb"],
        EffectKind::Viscous => &[
            "viscous",
            "viscous-load",
            "viscous-temperature",
            "motor damping",
        ],
        EffectKind::Stribeck => &["stribeck"],
        // The generator's friction keeps its sign at rest, whatever its law in motion.
        EffectKind::Presliding => &[
            "coulomb",
            "capstan",
            "dry friction",
            "dahl",
            "presliding hysteresis",
        ],
        EffectKind::Hysteresis => &[
            "dahl",
            "bouc-wen",
            "prandtl-ishlinskii",
            "presliding hysteresis",
        ],
        EffectKind::Backlash => &["backlash", "stop operator"],
        EffectKind::PeriodicAngle => &[
            "harmonic-drive",
            "cogging",
            "gear-mesh",
            "eccentricity",
            "ripple over the angle",
        ],
        EffectKind::CableStretch => &["lag-first", "lag of the command"],
        EffectKind::Inertia => &["inertia", "reflected inertia"],
        EffectKind::Delay => &["delay", "clock offset"],
        EffectKind::SensorLag => &["lag-first"],
        EffectKind::ClockSkew => &["clock-skew"],
        EffectKind::Saturation => &["clipping"],
        EffectKind::Quadratic => &["nonlinearity"],
        EffectKind::DriftTime => &["drift"],
        EffectKind::DriftTemperature => &["temperature-zero", "temperature-span"],
        EffectKind::Creep => &["creep", "slow lag of the load"],
        EffectKind::Crosstalk => &["crosstalk"],
        EffectKind::Tone => &["mains"],
        EffectKind::GravityAngle | EffectKind::Payload => &["gravity"],
        _ => &[],
    }
}

/// Whether a name of the literature is a correct name for a missing effect on the data of its set.
fn same(name: &str, missing: &Missing) -> bool {
    if name == missing.effect.name {
        return true;
    }
    let part = |e: &Equivalence| {
        e.reason.contains("parts that it contains") || e.reason.starts_with("the part at")
    };
    let alike = |name: &str| {
        let compared = missing.alike.iter().find(|a| a.effect.name == name);
        compared.is_none_or(|a| a.left_over_noise < ALIKE)
    };
    missing
        .effect
        .equivalences
        .iter()
        .any(|e| e.names.contains(&name) && (e.kind == "exact" || part(e) || alike(name)))
}

/// Whether a kind is a correct name for a missing effect.
fn is(kind: EffectKind, missing: &Missing) -> bool {
    stands_for(kind).iter().any(|name| same(name, missing))
}

/// Whether a kind is in a set, what its noise contains included.
#[must_use]
pub fn is_there(kind: EffectKind, set: &Set) -> bool {
    set.missing.iter().any(|m| is(kind, m)) || in_noise(kind, set)
}

/// Whether a report says that one that is in the set may stand for an effect it names.
#[must_use]
pub fn is_grouped(kind: EffectKind, report: &Report, set: &Set) -> bool {
    let others = report.others(kind).concat();
    others.iter().any(|other| is_there(*other, set))
}

/// Whether the noise of a set contains it.
fn in_noise(kind: EffectKind, set: &Set) -> bool {
    match kind {
        EffectKind::Tone => set.colour.tone > 0.0,
        EffectKind::DriftTime => set.colour.flicker > 0.0,
        _ => false,
    }
}

/// Compares a report with the truth of its set.
#[must_use]
pub fn class(report: &Report, set: &Set) -> Class {
    let outside = set.missing.iter().any(|m| m.effect.outside);
    let first = |kinds: &mut dyn Iterator<Item = EffectKind>| {
        let kinds: Vec<EffectKind> = kinds.collect();
        kinds
            .iter()
            .any(|kind| set.missing.iter().any(|m| is(*kind, m)))
    };
    // What the noise contains may stand before the effect.
    let mut found = report
        .effects
        .iter()
        .map(|e| e.name)
        .skip_while(|kind| in_noise(*kind, set) && !set.missing.iter().any(|m| is(*kind, m)));
    match report.verdict {
        Verdict::None => none(set),
        Verdict::Unknown if outside => Class::Right,
        Verdict::Unknown => Class::Unknown,
        Verdict::NotIdentifiable => {
            let group = report.not_identifiable.first();
            let mut kinds = group.into_iter().flat_map(|g| g.effects.iter().copied());
            if first(&mut kinds) {
                Class::Right
            } else {
                Class::Wrong
            }
        }
        _ => match found.next() {
            None => none(set),
            Some(kind) if first(&mut std::iter::once(kind)) => Class::Right,
            Some(_) => Class::Wrong,
        },
    }
}

fn none(set: &Set) -> Class {
    if set.missing.is_empty() {
        Class::Right
    } else {
        Class::None
    }
}

/// A parameter with known truth and its interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Covered {
    /// Name of the parameter.
    pub name: String,
    /// What was put in.
    pub truth: f64,
    /// What was found.
    pub found: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
}

impl Covered {
    /// Whether the interval holds the truth.
    #[must_use]
    pub fn holds(&self) -> bool {
        (self.interval[0]..=self.interval[1]).contains(&self.truth)
    }

    /// Whether the interval holds the estimate itself.
    #[must_use]
    pub fn holds_estimate(&self) -> bool {
        (self.interval[0]..=self.interval[1]).contains(&self.found)
    }

    /// Distance of the truth from the middle of the interval, in half widths of it. Its median is
    /// 0.34 where intervals of 95 % are exact and errors are normal.
    #[must_use]
    pub fn distance(&self) -> f64 {
        let [low, high] = self.interval;
        (2.0 * self.truth - low - high).abs() / (high - low).max(f64::MIN_POSITIVE)
    }
}

/// Effects that contain dry friction.
const DRY: [&str; 8] = [
    "coulomb",
    "capstan",
    "armstrong",
    "dahl",
    "lugre",
    "maxwell-slip",
    "bouc-wen",
    "bouc-wen-load",
];

/// Parameters whose equation is the same in generator and analysis. Where two effects of a set have
/// dry friction, only their sum can be known, and none of them is compared.
#[must_use]
pub fn covered(report: &Report, set: &Set) -> Vec<Covered> {
    let mut out = Vec::new();
    let dry = |name: &str| DRY.contains(&name);
    let frictions = set.missing.iter().filter(|m| dry(m.effect.name)).count();
    for missing in &set.missing {
        if frictions > 1 && dry(missing.effect.name) {
            continue;
        }
        let p = |name: &str| missing.parameters.get(name);
        let compared: Vec<(EffectKind, &str, f64)> = match missing.effect.name {
            "coulomb" => vec![
                (EffectKind::Presliding, "friction", -p("fc")),
                (EffectKind::Coulomb, "friction", -p("fc")),
            ],
            "viscous" => vec![(EffectKind::Viscous, "damping", -p("b"))],
            "inertia" => {
                let g = p("g");
                let j = 1e-6 * (p("j_reel") + g * g * p("j_rotor"));
                vec![(EffectKind::Inertia, "inertia", -j / REEL_RADIUS_M)]
            }
            "lag-first" => vec![(EffectKind::CableStretch, "time_constant", 1e-3 * p("tau"))],
            "delay" => vec![(EffectKind::Delay, "delay", 1e-3 * p("tau"))],
            "temperature-zero" => vec![(
                EffectKind::DriftTemperature,
                "drift_per_degree",
                1e-3 * p("z"),
            )],
            "temperature-span" => vec![(
                EffectKind::DriftTemperature,
                "gain_per_degree",
                1e-2 * p("s"),
            )],
            // The reading's limit is the command's where the declared model is the command alone.
            "clipping" if set.terms.len() == 1 && set.terms[0].fixed => vec![(
                EffectKind::Saturation,
                "upper_limit",
                p("reference") - p("depth"),
            )],
            "crosstalk" => vec![
                (
                    EffectKind::Crosstalk,
                    "share_of_neighbour_1",
                    1e-2 * p("c1"),
                ),
                (
                    EffectKind::Crosstalk,
                    "share_of_neighbour_2",
                    1e-2 * p("c2"),
                ),
            ],
            _ => vec![],
        };
        for (kind, name, truth) in compared {
            for e in report.effects.iter().filter(|e| e.name == kind) {
                if let (Some(found), Some(interval)) = (e.params.get(name), e.ci.get(name)) {
                    out.push(Covered {
                        name: format!("{kind}.{name}"),
                        truth,
                        found: *found,
                        interval: *interval,
                    });
                }
            }
        }
    }
    out
}
