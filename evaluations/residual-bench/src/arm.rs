//! Joints of an arm: friction, weights over one and two angles, inertia, in motions that let other
//! forms take their shape.

use rayon::prelude::*;
use residual::spec::Spec;
use residual::{Data, EffectKind, Report, Verdict};
use std::fmt::Write;
use std::ops::RangeInclusive;
use synthetic_sets::arm::{generate, Motion, Recipe, Set};

/// The declared model: a zero, and the other joint as pose.
const MODEL: &str = r#"
title = "Joint of an arm"

[roles]
time     = { column = "time_s", unit = "s" }
target   = { column = "torque_nm", unit = "N·m" }
angle    = { column = "angle_rad", unit = "rad" }
velocity = { column = "speed_rad_s", unit = "rad/s", deadband = 0.001 }

[roles.pose]
other = { column = "other_rad", unit = "rad" }

[[terms]]
name = "zero"
expr = "1"
unit = "N·m"
"#;

/// Names that are right: a payload is a weight and its inertia, and friction that stays at rest is
/// dry friction.
const RIGHT: [EffectKind; 5] = [
    EffectKind::Coulomb,
    EffectKind::Presliding,
    EffectKind::GravityAngle,
    EffectKind::Payload,
    EffectKind::Inertia,
];

/// What came out for one set.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The set.
    pub recipe: Recipe,
    /// Names that are called found and have no other beside them.
    pub found: Vec<EffectKind>,
    /// Names that are called found with others that may stand for them, each with its entries.
    pub either: Vec<Either>,
    /// Further courses of the search as good as these, whose names were not judged.
    pub not_judged: usize,
    /// Held-out RMSE over that of the noise.
    pub over_noise: f64,
}

/// *A or B and C*: names of which one entry is right.
#[derive(Debug, Clone)]
pub struct Either(Vec<Vec<EffectKind>>);

impl Either {
    /// The entries that are right.
    fn right(&self) -> impl Iterator<Item = &Vec<EffectKind>> {
        let is_right = |entry: &&Vec<EffectKind>| entry.iter().all(|kind| RIGHT.contains(kind));
        self.0.iter().filter(is_right)
    }

    fn words(&self) -> String {
        let joined = |kinds: &Vec<EffectKind>| {
            let names: Vec<&str> = kinds.iter().map(|kind| kind.as_str()).collect();
            names.join(" and ")
        };
        self.0.iter().map(joined).collect::<Vec<_>>().join(" or ")
    }
}

impl Outcome {
    /// Whether a name is called found that is not there, or several of which none is.
    #[must_use]
    pub fn is_wrong(&self) -> bool {
        self.found.iter().any(|kind| !RIGHT.contains(kind))
            || self.either.iter().any(|either| either.right().count() == 0)
    }

    /// Whether friction and a weight are found, by names that stand alone.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        is_whole(&self.found)
    }

    /// Whether they are found only with what is right of *A or B*.
    #[must_use]
    pub fn is_among(&self) -> bool {
        let right = self.either.iter().flat_map(Either::right).flatten();
        let all: Vec<EffectKind> = self.found.iter().chain(right).copied().collect();
        !self.is_whole() && is_whole(&all)
    }
}

/// Whether friction and a weight are among some names.
fn is_whole(names: &[EffectKind]) -> bool {
    let has = |kinds: &[EffectKind]| kinds.iter().any(|kind| names.contains(kind));
    has(&RIGHT[..2]) && has(&RIGHT[2..4])
}

/// The sets of some seeds: each motion, each joint, 0.03 to 150 N·m, a wide and a short arc, little
/// and much noise.
#[must_use]
pub fn recipes(seeds: RangeInclusive<u64>) -> Vec<Recipe> {
    let mut out = Vec::new();
    for seed in seeds {
        for (i, motion) in (0u64..).zip(Motion::ALL) {
            for (j, outer) in [(0, true), (1, false)] {
                for (k, (noise, arc)) in
                    (0u64..).zip([(0.15, 1.0), (0.4, 1.0), (0.15, 0.4), (0.4, 0.5)])
                {
                    let salt = 8 * i + 4 * j + k;
                    out.push(Recipe {
                        motion,
                        outer,
                        scale_nm: [0.03, 3.0, 150.0][((seed + salt) % 3) as usize],
                        noise,
                        arc,
                        seed: seed * 1000 + 900 + salt,
                    });
                }
            }
        }
    }
    out
}

fn data(set: &Set) -> Result<Data, residual::Error> {
    let mut columns: [(&str, Vec<f64>); 4] =
        ["target", "angle", "velocity", "other"].map(|name| (name, Vec::new()));
    let (mut time, mut sequences) = (Vec::new(), Vec::new());
    for log in &set.logs {
        let start = time.len();
        time.extend_from_slice(&log.time_s);
        let values = [
            &log.torque_nm,
            &log.angle_rad,
            &log.speed_rad_s,
            &log.other_rad,
        ];
        for ((_, column), values) in columns.iter_mut().zip(values) {
            column.extend_from_slice(values);
        }
        sequences.push(start..time.len());
    }
    Data::from_columns(time, columns)
        .sequences(sequences)
        .folds(set.logs.len())
        .build()
}

fn analyse(set: &Set) -> Result<Report, residual::Error> {
    residual::analyse(&Spec::parse(MODEL)?, data(set)?, &mut ())
}

/// Makes a set and has it analysed.
///
/// # Errors
/// The analysis's own message: no set should lead to one.
pub fn evaluate(recipe: &Recipe) -> Result<Outcome, String> {
    let set = generate(recipe);
    let report = analyse(&set).map_err(|error| format!("{recipe:?}: {error}"))?;
    let (mut found, mut either) = (vec![], vec![]);
    if !matches!(report.verdict, Verdict::None | Verdict::Unknown) {
        for effect in &report.effects {
            let others = report.others(effect.name);
            if others.is_empty() {
                found.push(effect.name);
            } else {
                let own = std::iter::once(vec![effect.name]);
                either.push(Either(own.chain(others).collect()));
            }
        }
    }
    Ok(Outcome {
        recipe: *recipe,
        over_noise: report.last.heldout_rmse / set.noise_rms_nm,
        not_judged: report.paths_not_judged,
        found,
        either,
    })
}

/// Analyses the sets of some seeds and gives the table, and with `list` each set that is not right.
///
/// # Errors
/// As [`evaluate`].
pub fn table(seeds: RangeInclusive<u64>, list: bool) -> Result<String, String> {
    let outcomes: Vec<Outcome> = recipes(seeds)
        .par_iter()
        .map(evaluate)
        .collect::<Result<_, _>>()?;
    let mut text = String::new();
    for o in outcomes
        .iter()
        .filter(|o| list && (!o.is_whole() || o.is_wrong()))
    {
        let names: Vec<&str> = o.found.iter().map(|kind| kind.as_str()).collect();
        let either: Vec<String> = o.either.iter().map(Either::words).collect();
        let _ = writeln!(
            text,
            "{}{:?}: {} [{}] ({:.3}, {} not judged)",
            if o.is_wrong() { "WRONG " } else { "" },
            o.recipe,
            names.join(", "),
            either.join("; "),
            o.over_noise,
            o.not_judged
        );
    }
    let _ = writeln!(
        text,
        "| motion | sets | friction and a weight found | in *A or B* | another name found | paths not judged | median of RMSE over noise |\n\
         | --- | --- | --- | --- | --- | --- | --- |"
    );
    for motion in Motion::ALL {
        let own: Vec<&Outcome> = (outcomes.iter())
            .filter(|o| o.recipe.motion == motion)
            .collect();
        let count = |f: &dyn Fn(&Outcome) -> bool| own.iter().filter(|o| f(o)).count();
        let mut ratios: Vec<f64> = own.iter().map(|o| o.over_noise).collect();
        ratios.sort_by(f64::total_cmp);
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {:.3} |",
            motion.words(),
            own.len(),
            count(&Outcome::is_whole),
            count(&Outcome::is_among),
            count(&Outcome::is_wrong),
            count(&|o| o.not_judged > 0),
            ratios[ratios.len() / 2]
        );
    }
    Ok(text)
}

/// How much the choice of the path depends on the folds.
struct Drift {
    motion: Motion,
    /// Whether the search names the same effects whichever fold is left out of it.
    same: bool,
    /// Whether each name that is found is among those, whichever fold is left out.
    kept: bool,
    /// RMSE on the folds that were left out of the whole selection, over the held-out RMSE that is
    /// reported.
    over_reported: f64,
}

fn drift(recipe: &Recipe) -> Result<Drift, residual::Error> {
    let set = generate(recipe);
    let report = analyse(&set)?;
    let nested = residual::nested(&Spec::parse(MODEL)?, &data(&set)?, &mut ())?;
    let mut names: Vec<Vec<EffectKind>> = nested.folds.into_iter().map(|f| f.effects).collect();
    names
        .iter_mut()
        .for_each(|own| own.sort_by_key(|kind| kind.as_str()));
    let found = || report.effects.iter().map(|effect| effect.name);
    Ok(Drift {
        motion: recipe.motion,
        same: names.windows(2).all(|two| two[0] == two[1]),
        kept: names
            .iter()
            .all(|own| found().all(|name| own.contains(&name))),
        over_reported: nested.rmse / report.last.heldout_rmse,
    })
}

/// Repeats the selection without each log of the sets of some seeds, and gives the table of how far
/// names and errors depend on it.
///
/// # Errors
/// As [`evaluate`].
pub fn nested(seeds: RangeInclusive<u64>) -> Result<String, String> {
    let of = |recipe: &Recipe| drift(recipe).map_err(|error| format!("{recipe:?}: {error}"));
    let all: Vec<Drift> = recipes(seeds)
        .par_iter()
        .map(of)
        .collect::<Result<_, _>>()?;
    let mut text = String::from(
        "| motion | sets | same names without each log | each name found is among them | nested RMSE over the reported one: median, largest |\n\
         | --- | --- | --- | --- | --- |\n",
    );
    for motion in Motion::ALL {
        let own: Vec<&Drift> = all.iter().filter(|d| d.motion == motion).collect();
        let mut ratios: Vec<f64> = own.iter().map(|d| d.over_reported).collect();
        ratios.sort_by(f64::total_cmp);
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {:.3}, {:.3} |",
            motion.words(),
            own.len(),
            own.iter().filter(|d| d.same).count(),
            own.iter().filter(|d| d.kept).count(),
            ratios[ratios.len() / 2],
            ratios[ratios.len() - 1]
        );
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_beside_another_is_not_found() {
        use EffectKind::{Coulomb, Geometry, GravityAngle, Inertia, Viscous};
        let of = |found: &[EffectKind], either: &[&[&[EffectKind]]]| {
            let entries =
                |all: &&[&[EffectKind]]| Either(all.iter().map(|entry| entry.to_vec()).collect());
            let outcome = Outcome {
                recipe: recipes(1..=1)[0],
                found: found.to_vec(),
                either: either.iter().map(entries).collect(),
                not_judged: 0,
                over_noise: 1.0,
            };
            (outcome.is_whole(), outcome.is_among(), outcome.is_wrong())
        };
        assert_eq!(of(&[Coulomb, GravityAngle], &[]), (true, false, false));
        assert_eq!(of(&[Coulomb, Viscous], &[]), (false, false, true));
        let other: &[&[EffectKind]] = &[&[Geometry], &[GravityAngle, Inertia]];
        assert_eq!(of(&[Coulomb], &[other]), (false, true, false));
        // An entry is right as a whole.
        let part: &[&[EffectKind]] = &[&[Geometry], &[GravityAngle, Viscous]];
        assert_eq!(of(&[Coulomb], &[part]), (false, false, true));
    }
}
