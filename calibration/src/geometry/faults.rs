//! Faults among digitizer points, told apart by likelihood.
//!
//! Where the residuals of the joint fit are too large, each of these explanations is tried:
//! readings changed back as the explanation says, everything fitted anew, and its evidence taken:
//!
//! ```text
//! ln evidence = ln prior - chi^2 / 2 - c (free points + readings set aside)
//!               - b (halves of a bumped station)
//! ```
//!
//! `c = ln(V / ((2 pi)^(3/2) sd^3))` is what a free position costs that may lie anywhere in the
//! volume V = 1 m^3, and `b` the like for a bump of some 20 mm and 50 mrad: an explanation that
//! frees more can fit more, and pays for it. Coordinates that are multiplied by `k` cost
//! `3 ln(1/k)` each, since a density in mm is not one in m. No fixed limit decides; the probability
//! of an explanation is its share of the evidence of all. The best is taken, and the search goes on
//! until the rest fits.
//!
//! What can't be seen: a fault in a point that is measured from one station only, all repeats
//! alike; two exchanged holes of a plate whose triangle has two equal sides (make all three differ
//! by some mm); and a mirrored station that is tied by points in one plane (three holes of one
//! plate are), since it fits as well as the true one.

use super::network::{Items, Network};
use super::points::{Label, PointReading};
use super::GeometryError;
use crate::input::Location;
use crate::stats;
use std::collections::{BTreeMap, BTreeSet};

/// What is wrong.
#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// Two readings with the same numbers: one is a copy.
    Copied,
    /// A reading that is off for no reason that is known.
    Stray,
    /// The point has another label.
    Mislabelled {
        /// The label that fits.
        right: String,
    },
    /// Two labels are exchanged.
    Swapped {
        /// The other label.
        other: String,
    },
    /// The coordinates of a station are mirrored: an axis has the wrong sign, or two are exchanged.
    Mirrored,
    /// The coordinates are in another unit.
    Unit {
        /// What they have to be multiplied by.
        factor: f64,
    },
    /// The digitizer was moved while it stood at this station.
    Bumped {
        /// How far the points move, largest, m.
        by_m: f64,
    },
    /// All residuals are larger than the digitizer's standard deviation allows.
    Noise {
        /// Standard deviation that the residuals show, m.
        sd_m: f64,
    },
    /// The residuals are too large and nothing that is known explains them.
    Unexplained,
}

/// One fault that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What is wrong.
    pub fault: Fault,
    /// Station, where it is about one.
    pub station: Option<String>,
    /// Label of the point, where it is about one.
    pub label: Option<String>,
    /// The readings concerned. For a bump, the first reading after it.
    pub at: Vec<Location>,
    /// Share of the evidence, 0 to 1.
    pub probability: f64,
    /// Other explanations with a share above a twentieth, best first. A plate that two stations see
    /// only can't tell which of them has its labels exchanged.
    pub alternatives: Vec<Finding>,
}

/// Prior probability of each kind of fault in one survey. Variants of a kind share it.
const PRIOR: f64 = 1e-3;
/// Prior probability that the digitizer is worse than its standard deviation says.
const NOISE_PRIOR: f64 = 1e-2;
/// Readings with the largest residuals that are looked at one by one.
const SUSPECTS: usize = 12;
/// Faults that are looked for one after the other.
const ROUNDS: usize = 4;
/// Share of the evidence above which another explanation is told.
const ALTERNATIVE: f64 = 0.05;
/// Times that a digitizer may be worse than its standard deviation says.
const WORST_NOISE: f64 = 10.0;
/// Volume that a free position may lie in, m^3.
const VOLUME_M3: f64 = 1.0;
/// Units that tables come in by mistake, as factors to the declared one: mm, cm, m, inch, foot.
const FACTORS: [f64; 8] = [1e-3, 1e3, 25.4, 1.0 / 25.4, 0.1, 10.0, 304.8, 1.0 / 304.8];

pub(super) fn describe(findings: &[Finding]) -> String {
    let lines: Vec<String> = findings.iter().map(Finding::to_string).collect();
    lines.join("\n")
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(at) = self.at.first() {
            write!(f, "{at}")?;
            if self.at.len() > 1 {
                write!(f, " (and {} more)", self.at.len() - 1)?;
            }
            write!(f, ": ")?;
        }
        let label = self.label.as_deref().unwrap_or("the point");
        let station = self
            .station
            .as_ref()
            .map_or("all stations".to_owned(), |s| format!("station `{s}`"));
        match &self.fault {
            Fault::Copied => write!(f, "{label} at {station} has the same coordinates as another reading, to the last digit: a copy; measure it again")?,
            Fault::Stray => write!(f, "{label} at {station} does not fit the other points; measure it again")?,
            Fault::Mislabelled { right } => write!(f, "{label} at {station} is probably {right}; correct the label")?,
            Fault::Swapped { other } => write!(f, "{label} and {other} at {station} are probably exchanged; correct the labels")?,
            Fault::Mirrored => write!(f, "the coordinates of {station} are mirrored; check the sign and the order of its axes")?,
            Fault::Unit { factor } => write!(f, "the coordinates ({label}, {station}) are in another unit: times {factor:.4} they fit; correct the header or the numbers")?,
            Fault::Bumped { by_m } => write!(f, "{station} moved by about {:.1} mm before this reading; measure its points again from here, as a new station", 1e3 * by_m)?,
            Fault::Noise { sd_m } => write!(f, "the residuals show a standard deviation of {:.3} mm; give the digitizer's true one, or hold it more still", 1e3 * sd_m)?,
            Fault::Unexplained => write!(f, "the points do not fit together and no single fault explains it; look at the residuals and measure the worst station again")?,
        }
        if self.fault != Fault::Unexplained {
            write!(f, " (probability {:.3})", self.probability)?;
        }
        for other in &self.alternatives {
            write!(f, "; or {other}")?;
        }
        Ok(())
    }
}

/// Readings from one station with the same numbers to the last digit, where chance does not make
/// them: the digitizer's resolution is taken from the numbers themselves.
pub(super) fn copies(readings: &[PointReading], sd_m: f64) -> Vec<Finding> {
    // The coarsest decimal step that all coordinates are multiples of.
    let step = (1..=9)
        .map(|digits| 10f64.powi(-digits))
        .find(|step| {
            readings.iter().all(|r| {
                r.position_m
                    .iter()
                    .all(|v| (v / step - (v / step).round()).abs() < 1e-4)
            })
        })
        .unwrap_or(1e-10);
    let mut seen: BTreeMap<(&str, [u64; 3]), Vec<&PointReading>> = BTreeMap::new();
    for r in readings {
        seen.entry((
            r.station.as_str(),
            [0, 1, 2].map(|i| r.position_m[i].to_bits()),
        ))
        .or_default()
        .push(r);
    }
    // Two readings of one point agree in one coordinate with probability step / (2 sqrt(pi) sd).
    let chance = (step / (2.0 * std::f64::consts::PI.sqrt() * sd_m))
        .min(1.0)
        .powi(3);
    let mut groups: BTreeMap<(&str, &Label), f64> = BTreeMap::new();
    for r in readings {
        *groups.entry((&r.station, &r.label)).or_default() += 1.0;
    }
    let pairs: f64 = groups.values().map(|n| 0.5 * n * (n - 1.0)).sum::<f64>() + 1.0;
    let expected = chance * pairs;
    if expected > 0.05 {
        return Vec::new();
    }
    seen.into_values()
        .filter(|same| same.len() > 1)
        .map(|same| Finding {
            fault: Fault::Copied,
            station: Some(same[1].station.clone()),
            label: Some(same[1].label.to_string()),
            at: same
                .iter()
                .skip(1)
                .chain(same.first())
                .map(|r| r.at.clone())
                .collect(),
            probability: PRIOR / (PRIOR + expected),
            alternatives: Vec::new(),
        })
        .collect()
}

/// What is done to the items to undo a fault.
#[derive(Debug, Clone, PartialEq)]
enum Change {
    None,
    Noise,
    SetAside(usize),
    Relabel(Vec<usize>, usize),
    Exchange(Vec<usize>, Vec<usize>),
    Mirror(usize),
    Scale(Vec<usize>, f64, Option<usize>),
    Split(usize),
}

struct Trial {
    change: Change,
    prior: f64,
}

/// The faults that explain why the points do not fit, at most four.
pub(super) fn find(
    readings: &[PointReading],
    items: &Items,
    sd_m: f64,
    level: f64,
) -> Result<Vec<Finding>, GeometryError> {
    let mut items = items.clone();
    let mut findings: Vec<Finding> = Vec::new();
    for _ in 0..ROUNDS {
        let now = evidence(&items, sd_m, &Change::None);
        if now.is_some_and(|e| e.p >= level) {
            return Ok(findings);
        }
        let trials = trials(&items, sd_m);
        let mut scored: Vec<(f64, &Trial)> = trials
            .iter()
            .filter_map(|t| {
                let mut changed = items.clone();
                apply(&mut changed, &t.change);
                let e = evidence(&changed, sd_m, &t.change)?;
                Some((e.log + t.prior.ln() + measure_of(&t.change), t))
            })
            .collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let Some(&(top, best)) = scored.first() else {
            break;
        };
        let total: f64 = scored.iter().map(|s| (s.0 - top).exp()).sum();
        if best.change == Change::None {
            break;
        }
        let share = |s: f64| (s - top).exp() / total;
        let mut named = finding(readings, &items, best, share(top), sd_m);
        named.alternatives = scored[1..]
            .iter()
            .filter(|s| share(s.0) > ALTERNATIVE && s.1.change != Change::None)
            .map(|s| finding(readings, &items, s.1, share(s.0), sd_m))
            .collect();
        findings.push(named);
        if best.change == Change::Noise {
            return Ok(findings);
        }
        apply(&mut items, &best.change);
    }
    let fits = evidence(&items, sd_m, &Change::None).is_some_and(|e| e.p >= level);
    if !fits {
        findings.push(Finding {
            fault: Fault::Unexplained,
            station: None,
            label: None,
            at: Vec::new(),
            probability: 1.0,
            alternatives: Vec::new(),
        });
    }
    Ok(findings)
}

struct Evidence {
    log: f64,
    p: f64,
}

fn evidence(items: &Items, sd_m: f64, change: &Change) -> Option<Evidence> {
    let network = Network::new(items);
    let solution = network.solve(network.initial(sd_m).ok()?, sd_m).ok()?;
    let dof = solution.degrees_of_freedom;
    let position = (VOLUME_M3 / (sd_m * (2.0 * std::f64::consts::PI).sqrt()).powi(3)).ln();
    // A bump's six numbers, known afterwards to about sd and sd over the size of a plate.
    let half = 3.0 * (0.02 / sd_m).ln() + 3.0 * (0.05 * 0.1 / sd_m).ln();
    let free: BTreeSet<usize> = network
        .groups
        .iter()
        .map(|g| g.landmark)
        .filter(|l| items.known_m[*l].is_none())
        .collect();
    let aside = items.items.iter().filter(|i| !i.used).count();
    let fit = match change {
        Change::Noise => {
            let factor = solution.chi_square / dof as f64;
            let plausible = factor < WORST_NOISE * WORST_NOISE;
            if !plausible {
                return None;
            }
            -0.5 * dof as f64 * (1.0 + factor.ln())
        }
        _ => -0.5 * solution.chi_square,
    };
    Some(Evidence {
        log: fit - position * (free.len() + aside) as f64 - half * items.links.len() as f64,
        p: stats::chi_square_survival(solution.chi_square, dof),
    })
}

/// Change of the density where coordinates are multiplied.
fn measure_of(change: &Change) -> f64 {
    match change {
        Change::Scale(which, factor, _) => 3.0 * which.len() as f64 * factor.ln(),
        _ => 0.0,
    }
}

fn trials(items: &Items, sd_m: f64) -> Vec<Trial> {
    let used: Vec<usize> = (0..items.items.len())
        .filter(|&i| items.items[i].used)
        .collect();
    let stations = items.stations.len();
    let of_station = |s: usize| -> Vec<usize> {
        used.iter()
            .copied()
            .filter(|&i| items.items[i].station == s)
            .collect()
    };
    let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for &i in &used {
        groups
            .entry((items.items[i].station, items.items[i].landmark))
            .or_default()
            .push(i);
    }
    // Points that more than one station sees or the CAD model gives: only they tie anything.
    let tied: BTreeSet<usize> = (0..items.landmarks.len())
        .filter(|&l| {
            items.known_m[l].is_some() || groups.keys().filter(|(_, g)| *g == l).count() > 1
        })
        .collect();
    let mut kinds: Vec<Vec<Change>> = Vec::new();
    let suspects = suspects(items, &used, sd_m);
    kinds.push(used.iter().map(|&i| Change::SetAside(i)).collect());
    let mut relabel = Vec::new();
    let mut exchange = Vec::new();
    for (&(s, l), which) in &groups {
        for &right in tied.iter().filter(|r| **r != l) {
            relabel.push(Change::Relabel(which.clone(), right));
            if let (Some(other), true) = (groups.get(&(s, right)), l < right || !tied.contains(&l))
            {
                exchange.push(Change::Exchange(which.clone(), other.clone()));
            }
        }
    }
    kinds.push(relabel);
    kinds.push(exchange);
    // Single readings among repeats.
    let repeated = |i: usize| groups[&(items.items[i].station, items.items[i].landmark)].len() > 1;
    let (mut relabel, mut exchange, mut scale) = (Vec::new(), Vec::new(), Vec::new());
    for (k, &i) in suspects.iter().enumerate() {
        let s = items.items[i].station;
        for &right in groups
            .keys()
            .filter(|g| g.0 == s)
            .map(|(_, l)| l)
            .chain(&tied)
        {
            if right != items.items[i].landmark && repeated(i) {
                relabel.push(Change::Relabel(vec![i], right));
            }
        }
        for &j in &suspects[k + 1..] {
            if items.items[j].station == s
                && items.items[j].landmark != items.items[i].landmark
                && (repeated(i) || repeated(j))
            {
                exchange.push(Change::Exchange(vec![i], vec![j]));
            }
        }
        scale.extend(FACTORS.map(|f| Change::Scale(vec![i], f, None)));
    }
    relabel.dedup();
    kinds.push(relabel);
    kinds.push(exchange);
    kinds.push(scale);
    kinds.push((0..stations).map(Change::Mirror).collect());
    let mut scale: Vec<Change> = FACTORS
        .map(|f| Change::Scale(used.clone(), f, None))
        .to_vec();
    for s in 0..stations {
        scale.extend(FACTORS.map(|f| Change::Scale(of_station(s), f, Some(s))));
    }
    kinds.push(scale);
    kinds.push(
        (0..stations)
            .flat_map(|s| of_station(s).into_iter().skip(1).map(Change::Split))
            .collect(),
    );
    let mut out = vec![
        Trial {
            change: Change::None,
            prior: 1.0,
        },
        Trial {
            change: Change::Noise,
            prior: NOISE_PRIOR,
        },
    ];
    for kind in kinds {
        let prior = PRIOR / kind.len().max(1) as f64;
        out.extend(kind.into_iter().map(|change| Trial { change, prior }));
    }
    out
}

/// The readings that, set aside, leave the least chi-square.
fn suspects(items: &Items, used: &[usize], sd_m: f64) -> Vec<usize> {
    let mut scored: Vec<(f64, usize)> = used
        .iter()
        .filter_map(|&i| {
            let mut changed = items.clone();
            changed.items[i].used = false;
            Some((evidence(&changed, sd_m, &Change::None)?.log, i))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.truncate(SUSPECTS);
    scored.into_iter().map(|s| s.1).collect()
}

fn apply(items: &mut Items, change: &Change) {
    match change {
        Change::None | Change::Noise => {}
        Change::SetAside(i) => items.items[*i].used = false,
        Change::Relabel(which, right) => {
            for &i in which {
                items.items[i].landmark = *right;
            }
        }
        Change::Exchange(a, b) => {
            let (la, lb) = (items.items[a[0]].landmark, items.items[b[0]].landmark);
            for &i in a {
                items.items[i].landmark = lb;
            }
            for &i in b {
                items.items[i].landmark = la;
            }
        }
        Change::Mirror(s) => {
            for item in items.items.iter_mut().filter(|i| i.station == *s) {
                item.position_m.z = -item.position_m.z;
            }
        }
        Change::Scale(which, factor, _) => {
            for &i in which {
                items.items[i].position_m *= *factor;
            }
        }
        Change::Split(from) => {
            let old = items.items[*from].station;
            let new = items.stations.len();
            items.stations.push(items.stations[old].clone());
            items.station_at.push(items.station_at[old].clone());
            for item in items.items[*from..].iter_mut().filter(|i| i.station == old) {
                item.station = new;
            }
            items.links.push((old, new));
        }
    }
}

fn finding(
    readings: &[PointReading],
    items: &Items,
    trial: &Trial,
    probability: f64,
    sd_m: f64,
) -> Finding {
    let lines = |which: &[usize]| which.iter().map(|&i| readings[i].at.clone()).collect();
    let label = |i: usize| Some(readings[i].label.to_string());
    let station = |i: usize| Some(readings[i].station.clone());
    let name = |l: usize| items.landmarks[l].to_string();
    let (fault, at, label, station) = match &trial.change {
        Change::None => (Fault::Unexplained, Vec::new(), None, None),
        Change::Noise => {
            let network = Network::new(items);
            let factor = network
                .initial(sd_m)
                .and_then(|start| network.solve(start, sd_m))
                .map_or(f64::NAN, |s| s.chi_square / s.degrees_of_freedom as f64);
            (
                Fault::Noise {
                    sd_m: sd_m * factor.sqrt(),
                },
                Vec::new(),
                None,
                None,
            )
        }
        Change::SetAside(i) => (Fault::Stray, lines(&[*i]), label(*i), station(*i)),
        Change::Relabel(which, right) => (
            Fault::Mislabelled {
                right: name(*right),
            },
            lines(which),
            label(which[0]),
            station(which[0]),
        ),
        Change::Exchange(a, b) => {
            let both: Vec<usize> = a.iter().chain(b).copied().collect();
            (
                Fault::Swapped {
                    other: name(items.items[b[0]].landmark),
                },
                lines(&both),
                label(a[0]),
                station(a[0]),
            )
        }
        Change::Mirror(s) => {
            let which: Vec<usize> = (0..readings.len())
                .filter(|&i| items.items[i].station == *s)
                .collect();
            (
                Fault::Mirrored,
                lines(&which),
                None,
                Some(items.stations[*s].clone()),
            )
        }
        Change::Scale(which, factor, s) => (
            Fault::Unit { factor: *factor },
            lines(which),
            if which.len() == 1 {
                label(which[0])
            } else {
                Some("all points".to_owned())
            },
            if which.len() == 1 {
                station(which[0])
            } else {
                s.map(|s| items.stations[s].clone())
            },
        ),
        Change::Split(from) => {
            let mut changed = items.clone();
            apply(&mut changed, &trial.change);
            let network = Network::new(&changed);
            let by_m = network
                .initial(sd_m)
                .and_then(|start| network.solve(start, sd_m))
                .map_or(f64::NAN, |solution| {
                    let poses = &solution.state.poses;
                    let (old, new) = (items.items[*from].station, poses.len() - 1);
                    (0..readings.len())
                        .filter(|&i| items.items[i].station == old)
                        .map(|i| {
                            let point = &solution.state.landmarks_m[items.items[i].landmark];
                            (poses[old].apply(point) - poses[new].apply(point)).norm()
                        })
                        .fold(0.0, f64::max)
                });
            (
                Fault::Bumped { by_m },
                lines(&[*from]),
                None,
                station(*from),
            )
        }
    };
    Finding {
        fault,
        station,
        label,
        at,
        probability,
        alternatives: Vec::new(),
    }
}
