//! The figures against formulas of their own, a case for each class, and cells whose truth is
//! known.

use super::super::{fit, Direction, WeightSet, CREEP, PRELOAD};
use super::*;
use crate::geometry::testing::normal;
use crate::input::Location;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const CODES_PER_N: f64 = 146_000.0;

/// Weights of class E2 in a place whose gravity is known: nothing but the cell is in the figures.
fn options() -> Options {
    Options {
        gravity_relative_sd: 1e-6,
        air_buoyancy: 0.0,
        weights: WeightSet {
            tolerance: super::super::Tolerance::Class(super::super::Class::E2),
            ..WeightSet::default()
        },
        ..Options::default()
    }
}

/// What is hung in which series, in the sequence of the procedure.
fn loads() -> Vec<(u8, f64, Option<Direction>, f64)> {
    let (up, down) = (Some(Direction::Loading), Some(Direction::Unloading));
    let mut out = Vec::new();
    for _ in 0..PRELOADS {
        out.extend([(PRELOAD, 1000.0, up, 60.0), (PRELOAD, 0.0, None, 30.0)]);
    }
    for series in [1, 2] {
        out.push((series, 0.0, None, 30.0));
        out.extend(WEIGHTS_G.map(|w| (series, w, up, 30.0)));
        out.push((series, 0.0, None, 30.0));
    }
    for series in [3, 5] {
        out.push((series, 0.0, None, 30.0));
        out.extend(WEIGHTS_G.map(|w| (series, w, up, 30.0)));
        // The largest weight is not put on again.
        out.extend(
            WEIGHTS_G
                .iter()
                .rev()
                .skip(1)
                .map(|w| (series + 1, *w, down, 30.0)),
        );
        out.push((series + 1, 0.0, None, 30.0));
    }
    for weight_g in [1000.0, 0.0] {
        out.push((CREEP, weight_g, None, 30.0));
        out.extend((0..9).map(|_| (CREEP, weight_g, None, 30.0)));
    }
    out
}

/// Readings of a cell: `code` gives the code of series, weight and the time since the load came on.
fn readings(mut code: impl FnMut(usize, u8, f64, f64) -> f64, error: f64) -> Vec<Reading> {
    let mut now = 0.0;
    let mut since = 0.0;
    let mut last = None;
    (loads().into_iter().enumerate())
        .map(|(i, (series, weight_g, direction, seconds))| {
            // A load that stays is on since it came.
            if last != Some((series, weight_g)) {
                since = now;
            }
            last = Some((series, weight_g));
            now += seconds;
            Reading {
                at: Location {
                    file: "procedure.csv".into(),
                    line: i + 2,
                },
                weight_g,
                code: code(i, series, weight_g, now - since),
                standard_error_codes: error,
                direction,
                time_s: Some(now),
                since_s: Some(since),
                since_sd_s: Some(0.01),
                temperature_c: None,
                series: Some(series),
            }
        })
        .collect()
}

/// The figures of readings without a fit of their own.
fn of(readings: &[Reading]) -> Result<Figures, Missing> {
    let straight = readings_of(|_, force| CODES_PER_N * force);
    let gain = fit(&straight, &options()).unwrap();
    figures(readings, &gain, &options())
}

/// Readings from deflections alone: the empty cell reads 1000 codes, and nothing creeps.
fn readings_of(deflection: impl Fn(u8, f64) -> f64) -> Vec<Reading> {
    let mut wobble = 0.0;
    readings(
        |i, series, weight_g, _| {
            // Means with all their digits equal would be copies.
            wobble = 1e-3 * ((i * 7919) % 13) as f64;
            let force = options().force_n(weight_g);
            1000.0
                + wobble
                + if weight_g > 0.0 {
                    deflection(series, force)
                } else {
                    0.0
                }
        },
        3.0,
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn figures_are_those_of_the_written_formulas(
        parts in proptest::collection::vec(-2e-3..2e-3f64, 6 * 8),
        zeros in proptest::collection::vec(-300.0..300.0f64, 12),
        crept in (-400.0..400.0f64, -400.0..400.0f64),
    ) {
        // Deflections and zeros, drawn one by one.
        let at = |weight_g: f64| WEIGHTS_G.iter().position(|w| *w == weight_g).unwrap();
        let x = |series: u8, weight_g: f64| {
            let series = match (series, weight_g == 1000.0) { (4, true) => 3, (6, true) => 5, (s, _) => s };
            CODES_PER_N * options().force_n(weight_g) * (1.0 + parts[usize::from(series - 1) * 8 + at(weight_g)])
        };
        let mut seen = [0; 8];
        let given = readings(|_, series, weight_g, age| {
            let s = usize::from(series);
            match (series, weight_g) {
                (PRELOAD, w) => 5e4 + w,
                (CREEP, w) => {
                    let change = if w > 0.0 { crept.0 } else { crept.1 };
                    1e4 + 1e3 * w + change * age / 270.0
                }
                // Before the series; after it.
                (_, 0.0) => {
                    seen[s] += 1;
                    let before = matches!(series, 1 | 2 | 3 | 5) && seen[s] == 1;
                    9e3 + if before { zeros[s - 1] } else { zeros[5 + s] }
                }
                (4 | 6, w) => 9e3 + zeros[s - 2] + x(series, w),
                (_, w) => 9e3 + zeros[s - 1] + x(series, w),
            }
        }, 3.0);
        let found = of(&given).unwrap();
        let mean = |w: f64| (x(1, w) + x(3, w) + x(5, w)) / 3.0;
        // Least squares through the origin.
        let (mut fx, mut ff) = (0.0, 0.0);
        for w in WEIGHTS_G {
            fx += options().force_n(w) * mean(w);
            ff += options().force_n(w).powi(2);
        }
        let most = mean(1000.0);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        // In percent, as the standard writes them.
        let f0 = [
            (zeros[6] - zeros[0]) / x(1, 1000.0),
            (zeros[7] - zeros[1]) / x(2, 1000.0),
            (zeros[9] - zeros[2]) / x(3, 1000.0),
            (zeros[11] - zeros[4]) / x(5, 1000.0),
        ].map(|part| 100.0 * part);
        let largest_f0 = f0.iter().map(|v| v.abs()).fold(0.0, f64::max);
        prop_assert!(close(100.0 * found.zero.abs(), largest_f0), "{found:?} {f0:?}");
        let c = 100.0 * crept.0.abs().max(crept.1.abs()) / most;
        prop_assert!(close(100.0 * found.creep.unwrap(), c), "{found:?} {c}");
        let resolution_n = 6.0 / 146e3;
        for (load, w) in found.loads.iter().zip(WEIGHTS_G) {
            let (x1, x2, x3, x4, x5, x6) = (x(1, w), x(2, w), x(3, w), x(4, w), x(5, w), x(6, w));
            let b = 100.0 * (x1.max(x3).max(x5) - x1.min(x3).min(x5)) / mean(w);
            let b2 = 100.0 * (x2 - x1).abs() / (0.5 * (x1 + x2));
            let xa = options().force_n(w) * fx / ff;
            let fc = 100.0 * (mean(w) - xa) / xa;
            let (v1, v2) = (100.0 * (x4 - x3).abs() / x3, 100.0 * (x6 - x5).abs() / x5);
            let v = if w == 1000.0 { 0.0 } else { (v1 + v2) / 2.0 };
            prop_assert!(close(100.0 * load.reproducibility, b), "b {load:?} {b}");
            prop_assert!(close(100.0 * load.repeatability, b2), "b' {load:?} {b2}");
            prop_assert!(close(100.0 * load.interpolation, fc), "fc {load:?} {fc}");
            prop_assert!(close(100.0 * load.reversibility, v), "v {load:?} {v}");
            let variance = |x: f64| (x - mean(w)).powi(2) / 6.0;
            let w2 = 100.0 * (variance(x1) + variance(x3) + variance(x5)).sqrt() / mean(w);
            let squares = (100.0 * options().force_relative_sd(w)).powi(2)
                + w2 * w2
                + b2 * b2 / 3.0
                + (100.0 * resolution_n / load.force_n).powi(2) / 6.0
                + c * c / 3.0
                + largest_f0 * largest_f0
                + fc * fc
                + v * v / 3.0;
            prop_assert!((100.0 * load.u - squares.sqrt()).abs() < 1e-6 * squares.sqrt(), "u {load:?} {squares}");
        }
    }
}

/// A cell that is ideal but for one figure, which is so large (relative).
fn ideal_but(figure: &str, size: f64) -> Vec<Reading> {
    let largest = CODES_PER_N * options().force_n(1000.0);
    let mut seen = [0; 8];
    readings(
        |_, series, weight_g, age| {
            let force = options().force_n(weight_g);
            let x = CODES_PER_N * force;
            seen[usize::from(series)] += usize::from(weight_g == 0.0);
            let more = match (figure, series) {
                // X3 alone; the mean grows by a third.
                ("b", 3 | 4) => x * size / (1.0 - size / 3.0),
                ("b'", 2) => x * size / (1.0 - 0.5 * size),
                // Falling series are above both rising ones.
                ("v", 4 | 6) if weight_g < 1000.0 => x * size,
                ("f0", 2) if weight_g == 0.0 && seen[2] == 2 => -largest * size,
                ("c", CREEP) if weight_g > 0.0 => largest * size * (age - 30.0) / 270.0,
                _ => 0.0,
            };
            2000.0 + x + more
        },
        1.0,
    )
}

#[test]
fn each_figure_has_a_case_for_each_class() {
    let next = |class: Class| Class::ALL.into_iter().find(|other| *other > class);
    for class in Class::ALL {
        let limits = class.limits();
        for (figure, limit, name) in [
            ("b", limits.reproducibility, "reproducibility b"),
            ("b'", limits.repeatability, "repeatability b'"),
            ("v", limits.reversibility, "reversibility v"),
            ("f0", limits.zero, "zero f0"),
            ("c", limits.creep, "creep c"),
        ] {
            let within = of(&ideal_but(figure, 0.999 * limit)).unwrap();
            let found = within.class().unwrap();
            assert_eq!(found.class, class, "{figure} {limit}: {within:?}");
            assert!((found.from_n - 0.0981 * 9.9966).abs() < 0.01 && found.to_n > 9.8);
            let beyond = of(&ideal_but(figure, 1.001 * limit)).unwrap();
            let found = beyond.class().map(|found| found.class);
            assert_eq!(found, next(class), "{figure} {limit}: {beyond:?}");
            assert_eq!(beyond.in_the_way(), [name]);
        }
        // A bend that a straight line leaves: fc of the loads, against its own least squares.
        for (part, expected) in [(0.999, Some(class)), (1.001, next(class))] {
            let mut size = 1e-4;
            // The largest fc is proportional to the bend.
            for _ in 0..4 {
                let bent = readings_of(|_, force| CODES_PER_N * force * (1.0 + size * force));
                let figures = of(&bent).unwrap();
                let upper = figures.loads.iter().filter(|load| load.force_n > 4.9);
                let most = upper
                    .map(|load| load.interpolation.abs())
                    .fold(0.0, f64::max);
                size *= part * limits.interpolation / most;
            }
            let bent = of(&readings_of(|_, force| {
                CODES_PER_N * force * (1.0 + size * force)
            }));
            let found = bent.unwrap().class().map(|found| found.class);
            assert_eq!(found, expected, "fc {}", limits.interpolation);
        }
    }
    let good = of(&ideal_but("nothing", 0.0)).unwrap();
    assert!(good.in_the_way().is_empty());
}

#[test]
fn the_calibrating_force_and_the_resolution_limit_the_class() {
    let good = ideal_but("nothing", 0.0);
    let gain = fit(&good, &options()).unwrap();
    for (gravity_sd, class) in [
        (4e-5, Some(Class::Class00)),
        (9e-5, Some(Class::Class05)),
        (2.4e-4, Some(Class::Class1)),
        (4.9e-4, Some(Class::Class2)),
        (1.6e-3, None),
    ] {
        let place = Options {
            gravity_relative_sd: gravity_sd,
            ..options()
        };
        let found = figures(&good, &gain, &place).unwrap();
        assert_eq!(
            found.class().map(|found| found.class),
            class,
            "{gravity_sd}"
        );
    }
    // A reading known to 0.35 mN: 0.7 mN of resolution, and 4000 of them are 2.8 N.
    let noisy: Vec<Reading> = (good.iter())
        .map(|r| Reading {
            standard_error_codes: 3.5e-4 * CODES_PER_N,
            ..r.clone()
        })
        .collect();
    let found = figures(&noisy, &gain, &options()).unwrap().class().unwrap();
    assert_eq!(found.class, Class::Class00);
    assert!((found.from_n - 2.942).abs() < 0.01, "{found:?}");
}

/// A cell with what real ones do.
struct Cell {
    /// Scale of each mounting against the mean.
    scales: [f64; 3],
    /// Zero of each mounting, N.
    zeros_n: [f64; 3],
    /// Largest loop, N.
    loop_n: f64,
    creep: f64,
    tau_s: f64,
    noise_n: f64,
}

impl Cell {
    fn readings(&self, seed: u64) -> Vec<Reading> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let largest = options().force_n(1000.0);
        let (mut crept, mut before, mut passed) = (0.0, 0.0, 0.0);
        readings(
            |_, series, weight_g, age| {
                let force = options().force_n(weight_g);
                // Each reading is 30 s after the one before; 60 s for a preload.
                let step = if age < passed { age } else { age - passed };
                let step = if force == before { step } else { age };
                (passed, before) = (age, force);
                crept += (self.creep * force - crept) * (1.0 - (-step / self.tau_s).exp());
                let mounting = match series {
                    3 | 4 => 1,
                    5.. => 2,
                    _ => 0,
                };
                let falls = matches!(series, 4 | 6);
                let open = if falls {
                    4.0 * self.loop_n * force * (largest - force) / largest.powi(2)
                } else {
                    0.0
                };
                let pulls = self.zeros_n[mounting]
                    + (force + crept + open) * (1.0 + self.scales[mounting])
                    + self.noise_n * normal(&mut rng);
                500.0 + CODES_PER_N * pulls
            },
            self.noise_n * CODES_PER_N,
        )
    }
}

#[test]
fn figures_are_near_the_true_parameters_of_a_cell() {
    let still = Cell {
        scales: [3e-4, -1e-4, -2e-4],
        zeros_n: [0.0, 0.012, -0.02],
        loop_n: 8e-3,
        creep: 0.0,
        tau_s: 100.0,
        noise_n: 1e-4,
    };
    let mut scatters = Vec::new();
    for seed in 0..20 {
        let given = still.readings(seed);
        let gain = fit(&given, &options()).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        let found = figures(&given, &gain, &options()).unwrap();
        for load in found.loads.iter().filter(|load| load.force_n > 4.0) {
            // 0.1 mN of noise in each reading and each zero.
            let within = 6.0 * 1e-4 / load.force_n;
            assert!((load.reproducibility - 5e-4).abs() < within, "{load:?}");
            assert!(load.repeatability < within, "{load:?}");
            let v = 4.0 * 8e-3 * (9.80665 - load.force_n) / 9.80665f64.powi(2);
            assert!((load.reversibility - v).abs() < within, "{load:?} {v}");
        }
        assert!(
            found.zero.abs() < 6e-5 && found.creep.unwrap() < 6e-5,
            "{found:?}"
        );
        let class = found.class().unwrap().class;
        // v is 0.16 % at half of the load.
        assert_eq!(class, Class::Class1, "{found:?}");
        scatters.push(gain.relative_parts.remounting);
        // The scale is the mean of the mountings.
        let off = gain.n_per_code * CODES_PER_N - 1.0;
        assert!(off.abs() < 3e-4, "{off}");
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    // The scatter of the three scales, and of the next against their mean.
    let scatter = ((9.0 + 1.0 + 4.0) * 1e-8 / 2.0f64).sqrt() * (4.0 / 3.0f64).sqrt();
    assert!(
        (mean(&scatters) / scatter - 1.0).abs() < 0.1,
        "{scatters:?} {scatter}"
    );

    let creeping = Cell {
        scales: [0.0; 3],
        zeros_n: [0.0; 3],
        loop_n: 0.0,
        creep: 6e-4,
        ..still
    };
    let found: Vec<f64> = (0..20)
        .map(|seed| {
            let given = creeping.readings(seed);
            let gain = fit(&given, &options()).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            figures(&given, &gain, &options()).unwrap().creep.unwrap()
        })
        .collect();
    // From 30 to 300 s; what is left of the load before makes the change smaller or larger by a
    // tenth.
    let true_creep = 6e-4 * ((-0.3f64).exp() - (-3f64).exp());
    assert!(
        (mean(&found) / true_creep - 1.0).abs() < 0.15,
        "{} {true_creep}",
        mean(&found)
    );
}

#[test]
fn the_interval_of_the_scale_holds_for_the_next_mounting() {
    let mut held = 0;
    for seed in 0..100 {
        let mut rng = ChaCha8Rng::seed_from_u64(9000 + seed);
        let mut next = || 4e-4 * normal(&mut rng);
        let cell = Cell {
            scales: [next(), next(), next()],
            zeros_n: [0.0, 10.0 * next(), 10.0 * next()],
            loop_n: 0.0,
            creep: 0.0,
            tau_s: 1.0,
            noise_n: 1e-3,
        };
        let gain = fit(&cell.readings(seed), &options()).unwrap();
        let truth = 1.0 / (CODES_PER_N * (1.0 + next()));
        held += u32::from((gain.n_per_code - truth).abs() < gain.within_half_95);
    }
    // Binomial(100, 0.95): 95 +- 2.2; 4 standard deviations.
    assert!((87..=100).contains(&held), "{held}");
}

#[test]
fn what_is_missing_is_named() {
    let whole = ideal_but("nothing", 0.0);
    let without = |keep: &dyn Fn(&Reading) -> bool| {
        let left: Vec<Reading> = whole.iter().filter(|r| keep(r)).cloned().collect();
        of(&left).map(|found| found.creep)
    };
    assert_eq!(
        without(&|r| r.series != Some(5) || r.weight_g != 600.0),
        Err(Missing::Reading {
            series: 5,
            weight_g: 600.0
        })
    );
    assert_eq!(
        without(&|r| r.series != Some(6) || r.weight_g > 0.0),
        Err(Missing::Reading {
            series: 6,
            weight_g: 0.0
        })
    );
    let told = without(&|r| r.weight_g < 700.0).unwrap_err().to_string();
    assert!(told.contains("5 different loads"), "{told}");
    assert_eq!(without(&|r| r.series != Some(CREEP)), Ok(None));
    assert!(!is_procedure(&[]) && is_procedure(&whole));
}
