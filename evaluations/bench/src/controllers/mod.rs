//! The thesis's tension controllers and ours on the same plant, seeds, setpoints and tip motion.
//!
//! Without the board's firmware: control core and plant directly, converters and delays as in
//! `control/tests/common/rig.rs`.

mod picture;
mod thesis;

#[path = "../../../../control/tests/common/rig.rs"]
mod rig;

use crate::figures::{number, Figures, Goal};
use control::unit::Drive;
use control::Config;
use plant::PlantConfig;
use rig::Rig;
use std::fmt::Write;
use thesis::{Gains, Path, Thesis};

/// Seeds of the runs that are compared. The gains were searched for with another one.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=10;
/// Seed of the search.
const TUNING_SEED: u64 = 101;
/// Time that is evaluated, s, after [`SETTLE_S`].
const SECONDS: f64 = 20.0;
/// Time before, s; the tip moves from 1 s on.
const SETTLE_S: f64 = 3.0;
/// Plant steps between two points of a trace.
const TRACE_STEPS: u64 = 20;

/// What closes the loop.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Thesis(Path, Gains),
    Ours { feedforward: bool },
}

/// Tension error of the six cables in one run.
#[derive(Debug, Clone, Default)]
struct Run {
    /// RMS of each cable, N.
    rms_n: Vec<f64>,
    /// Largest error of each cable, N.
    peak_n: Vec<f64>,
    /// Of unit 1, every millisecond: time in s, error in N, reel speed in rad/s.
    trace: Vec<[f64; 3]>,
}

fn run(kind: Kind, plant: &PlantConfig, seed: u64, seconds: f64) -> Run {
    let mut wire = Config::nominal();
    if let Kind::Ours { feedforward } = kind {
        wire.friction_feedforward = feedforward;
    }
    let mut rig = Rig::new(plant.clone(), seed, &wire);
    let units = rig.units.len();
    let mut thesis = match kind {
        Kind::Thesis(path, gains) => Some(Thesis::new(path, gains, units)),
        Kind::Ours { .. } => None,
    };
    for unit in &mut rig.units {
        unit.drive = Drive::Follow;
    }
    let start = rig.time_s();
    let mut result = Run {
        rms_n: vec![0.0; units],
        peak_n: vec![0.0; units],
        trace: Vec::new(),
    };
    let mut steps = 0.0;
    loop {
        let t = rig.time_s() - start;
        if t >= SETTLE_S + seconds {
            break;
        }
        rig.plant.set_robot_moving(t > 1.0);
        for (i, unit) in rig.units.iter_mut().enumerate() {
            unit.setpoint_n = 4.1 + 1.9 * (0.4 * t + i as f64).sin();
        }
        match &mut thesis {
            Some(thesis) => thesis.advance(&mut rig),
            None => rig.advance(|_, _, _| {}),
        }
        if t < SETTLE_S {
            continue;
        }
        steps += 1.0;
        for i in 0..units {
            let error = rig.plant.tension_n(i) - rig.units[i].setpoint_n;
            result.rms_n[i] += error * error;
            result.peak_n[i] = result.peak_n[i].max(error.abs());
            if i == 0 && rig.step.is_multiple_of(TRACE_STEPS) {
                result.trace.push([t, error, rig.plant.reel_rad_per_s(0)]);
            }
        }
    }
    for square in &mut result.rms_n {
        *square = (*square / steps).sqrt();
    }
    result
}

/// The gains with the least mean RMS on [`TUNING_SEED`], from a grid around what this plant bears.
fn tune(path: Path) -> Gains {
    let mut grid = Vec::new();
    for kp in [0.0, 0.2, 0.5] {
        for ki in [2.0, 5.0, 10.0, 20.0, 40.0] {
            for kd in [0.0, 0.003, 0.01] {
                for friction in [0.0, 0.3, 0.6, 1.0] {
                    grid.push(Gains {
                        kp,
                        ki,
                        kd,
                        friction,
                    });
                }
            }
        }
    }
    let score = |gains: &Gains| {
        let run = run(
            Kind::Thesis(path, *gains),
            &PlantConfig::default(),
            TUNING_SEED,
            8.0,
        );
        mean(&run.rms_n)
    };
    let scores = in_parallel(&grid, score);
    let best = (0..grid.len()).min_by(|a, b| scores[*a].total_cmp(&scores[*b]));
    grid[best.unwrap_or(0)]
}

/// A function of each item, on all cores.
fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let share = items.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        let parts: Vec<_> = items
            .chunks(share)
            .map(|part| scope.spawn(|| part.iter().map(&work).collect::<Vec<R>>()))
            .collect();
        parts
            .into_iter()
            .flat_map(|part| {
                part.join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .collect()
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// What a controller reached over all seeds.
struct Row {
    name: &'static str,
    rms_n: f64,
    worst_n: f64,
    peak_n: f64,
    trace: Vec<[f64; 3]>,
}

impl Row {
    fn of(name: &'static str, kind: Kind, plant: &PlantConfig) -> Self {
        let seeds: Vec<u64> = SEEDS.collect();
        let mut runs = in_parallel(&seeds, |seed| run(kind, plant, *seed, SECONDS));
        let rms = runs.iter().flat_map(|run| run.rms_n.clone());
        let count = runs.iter().map(|run| run.rms_n.len()).sum::<usize>() as f64;
        Self {
            name,
            rms_n: (rms.clone().map(|rms| rms * rms).sum::<f64>() / count).sqrt(),
            worst_n: largest(rms),
            peak_n: largest(runs.iter().flat_map(|run| run.peak_n.clone())),
            trace: runs.swap_remove(0).trace,
        }
    }

    /// Its line of a table.
    fn line(&self) -> String {
        let (rms, worst, peak) = (
            number(self.rms_n),
            number(self.worst_n),
            number(self.peak_n),
        );
        format!("| {} | {rms} N | {worst} N | {peak} N |\n", self.name)
    }
}

/// A change of the plant that the rig file does not know.
type Change = fn(&mut PlantConfig);

/// Plants that differ from what the rig file declares, one property at a time.
const OTHER_PLANTS: [(&str, Change); 10] = [
    ("as declared", |_| {}),
    ("half the presliding distance", |p| {
        p.friction.presliding_m *= 0.5;
    }),
    ("twice the presliding distance", |p| {
        p.friction.presliding_m *= 2.0;
    }),
    ("half the cable's stiffness", |p| {
        p.cable.axial_stiffness_n *= 0.5;
    }),
    ("twice the cable's stiffness", |p| {
        p.cable.axial_stiffness_n *= 2.0;
    }),
    ("no breakaway", |p| p.friction.breakaway_ratio = 1.0),
    ("twice the breakaway", |p| {
        p.friction.breakaway_ratio += p.friction.breakaway_ratio - 1.0;
    }),
    ("friction 20 % less", |p| {
        p.friction.coulomb_n *= 0.8;
        p.friction.per_load *= 0.8;
    }),
    ("friction 20 % more", |p| {
        p.friction.coulomb_n *= 1.2;
        p.friction.per_load *= 1.2;
    }),
    ("friction 40 % more", |p| {
        p.friction.coulomb_n *= 1.4;
        p.friction.per_load *= 1.4;
    }),
];

/// The table and the picture.
pub struct Comparison {
    rows: Vec<Row>,
    other_plants: Vec<Row>,
    gains: [Gains; 2],
}

/// Compares the controllers.
pub fn controllers(figures: &mut Figures) -> Comparison {
    println!(
        "\ntension loop on the plant, {SECONDS} s, seeds {SEEDS:?}: the thesis's controllers and ours"
    );
    let gains = [Path::Raven, Path::Board].map(tune);
    let kinds = [
        (
            "thesis, through the Raven's software",
            Kind::Thesis(Path::Raven, gains[0]),
        ),
        (
            "thesis, on a board of its own",
            Kind::Thesis(Path::Board, gains[1]),
        ),
        (
            "ours, without friction feedforward",
            Kind::Ours { feedforward: false },
        ),
        ("ours", Kind::Ours { feedforward: true }),
    ];
    let rows = kinds.map(|(name, kind)| Row::of(name, kind, &PlantConfig::default()));
    let other_plants = OTHER_PLANTS.map(|(name, change)| {
        let mut plant = PlantConfig::default();
        change(&mut plant);
        Row::of(name, Kind::Ours { feedforward: true }, &plant)
    });
    let keys = [
        (
            "loop_thesis_raven_rms_n",
            "tension loop alone, thesis through the Raven's software, RMS of all cables",
        ),
        (
            "loop_thesis_board_rms_n",
            "the same, thesis on a board of its own",
        ),
        (
            "loop_no_feedforward_rms_n",
            "the same, ours without friction feedforward",
        ),
        ("loop_rms_n", "the same, ours"),
    ];
    for ((key, what), row) in keys.into_iter().zip(&rows) {
        figures.add(key, row.rms_n, Goal::None, what);
    }
    let ours = &rows[3];
    figures.add(
        "loop_worst_rms_n",
        ours.worst_n,
        Goal::AtMost(0.05),
        "ours, worst cable of ten seeds",
    );
    figures.add(
        "loop_peak_n",
        ours.peak_n,
        Goal::AtMost(0.3),
        "ours, largest error of ten seeds, at reversals",
    );
    Comparison {
        rows: rows.into(),
        other_plants: other_plants.into(),
        gains,
    }
}

impl Comparison {
    /// The section of docs/figures.md.
    pub fn section(&self, picture: &str) -> String {
        let mut text = format!(
            "\n## The thesis's controllers beside ours\n\n\
             The tension loops alone, control core and plant directly: the same plant, seeds {SEEDS:?}, setpoints between 2.2 and 6 N, \
             tip moving, {SECONDS} s each. The thesis's controller is a five-tap mean, a PID without damping and friction by the sign \
             of the reel's speed. Through the Raven's software all six units are updated together at 320 Hz, 2 ms after the sensor \
             board has read them, with commands in whole N mm (0.1 N at the reel). The thesis prints no gains: those with the least \
             error were searched for on seed {TUNING_SEED}.\n\n\
             | controller | RMS of all cables | worst cable | largest error |\n| --- | ---: | ---: | ---: |\n"
        );
        for row in &self.rows {
            text.push_str(&row.line());
        }
        let _ = writeln!(text, "\nFound, kp, ki (1/s), kd (s), part of the friction:");
        for (path, g) in ["Raven's software", "board"].iter().zip(self.gains) {
            let _ = writeln!(text, "{path} {}, {}, {}, {};", g.kp, g.ki, g.kd, g.friction);
        }
        let _ = writeln!(
            text,
            "ours as in the rig file.\n\n![One reversal of the reel under all four]({picture})\n\n\
             ## Ours on other plants\n\nThe same seeds and motion, where the plant differs from what the rig file declares. The largest \
             error is that of a first reversal where the friction's level differs: the board learns the level at reversals.\n\n\
             | plant | RMS of all cables | worst cable | largest error |\n| --- | ---: | ---: | ---: |"
        );
        for row in &self.other_plants {
            text.push_str(&row.line());
        }
        text
    }

    /// One reversal of unit 1's reel under all four, as SVG.
    pub fn picture(&self) -> String {
        let traces: Vec<_> = self
            .rows
            .iter()
            .map(|row| (row.name, row.trace.as_slice()))
            .collect();
        picture::reversal(&traces)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarser_command_and_a_later_one_cost_tension() {
        let gains = Gains {
            kp: 0.2,
            ki: 10.0,
            kd: 0.0,
            friction: 0.3,
        };
        let of = |kind| mean(&run(kind, &PlantConfig::default(), 3, 4.0).rms_n);
        let board = of(Kind::Thesis(Path::Board, gains));
        assert!(of(Kind::Thesis(Path::Raven, gains)) > board);
        assert!(of(Kind::Ours { feedforward: true }) < board);
    }
}
