//! Joints of an arm: friction, weights over one and two angles, inertia, in motions that let other
//! forms take their shape.

use rayon::prelude::*;
use residual::spec::Spec;
use residual::{Data, EffectKind, EqualPath, Report, Verdict};
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
    /// Names that are called found, but for those that stand beside a right one.
    pub found: Vec<EffectKind>,
    /// Names in whose place others predict as well.
    pub either: Vec<String>,
    /// Whether friction and a weight are among them.
    pub whole: bool,
    /// Held-out RMSE over that of the noise.
    pub over_noise: f64,
}

impl Outcome {
    /// Names that are called found and are not there.
    #[must_use]
    pub fn wrong(&self) -> Vec<EffectKind> {
        let wrong = |kind: &&EffectKind| !RIGHT.contains(kind);
        self.found.iter().filter(wrong).copied().collect()
    }
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

fn analyse(set: &Set) -> Result<Report, residual::Error> {
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
    let data = Data::from_columns(time, columns)
        .sequences(sequences)
        .folds(set.logs.len())
        .build()?;
    residual::analyse(&Spec::parse(MODEL)?, data, &mut ())
}

fn either(path: &EqualPath) -> String {
    let joined = |kinds: &[EffectKind]| {
        let names: Vec<&str> = kinds.iter().map(|kind| kind.as_str()).collect();
        names.join(" and ")
    };
    format!("{} or {}", joined(&path.effects), joined(&path.instead))
}

/// Makes a set and has it analysed.
///
/// # Errors
/// The analysis's own message: no set should lead to one.
pub fn evaluate(recipe: &Recipe) -> Result<Outcome, String> {
    let set = generate(recipe);
    let report = analyse(&set).map_err(|error| format!("{recipe:?}: {error}"))?;
    // A name that cannot be distinguished from a right one stands beside it.
    let is_beside = |kind: EffectKind| {
        let mut equal = report.equal_paths.iter();
        if equal.any(|p| p.effects.contains(&kind) && p.instead.iter().any(|k| RIGHT.contains(k))) {
            return true;
        }
        let groups = report.not_identifiable.iter();
        let own = groups.filter(|g| g.effects.first() == Some(&kind));
        own.flat_map(|g| &g.effects)
            .any(|other| RIGHT.contains(other))
    };
    let found: Vec<EffectKind> = match report.verdict {
        Verdict::None | Verdict::Unknown => vec![],
        _ => (report.effects.iter())
            .filter(|e| e.unsupported.is_empty())
            .map(|e| e.name)
            .filter(|kind| RIGHT.contains(kind) || !is_beside(*kind))
            .collect(),
    };
    let has = |kinds: &[EffectKind]| {
        let named = |kind: &EffectKind| {
            let mut equal = report.equal_paths.iter();
            found.contains(kind) || equal.any(|p| p.instead.contains(kind))
        };
        kinds.iter().any(named)
    };
    Ok(Outcome {
        recipe: *recipe,
        whole: has(&RIGHT[..2]) && has(&RIGHT[2..4]),
        over_noise: report.last.heldout_rmse / set.noise_rms_nm,
        either: report.equal_paths.iter().map(either).collect(),
        found,
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
        .filter(|o| list && (!o.whole || !o.wrong().is_empty()))
    {
        let names: Vec<&str> = o.found.iter().map(|kind| kind.as_str()).collect();
        let _ = writeln!(
            text,
            "{:?}: {} [{}] ({:.3})",
            o.recipe,
            names.join(", "),
            o.either.join("; "),
            o.over_noise
        );
    }
    let _ = writeln!(
        text,
        "| motion | sets | friction and a weight found | another name found | median of RMSE over noise |\n\
         | --- | --- | --- | --- | --- |"
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
            "| {} | {} | {} | {} | {:.3} |",
            motion.words(),
            own.len(),
            count(&|o| o.whole),
            count(&|o| !o.wrong().is_empty()),
            ratios[ratios.len() / 2]
        );
    }
    Ok(text)
}
