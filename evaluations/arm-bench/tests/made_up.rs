//! The benchmark on made-up arms whose masses and loads are known.

use arm_bench::chain::{efforts, places, Joint};
use arm_bench::fit::{filtered, Filtered, Sums};
use arm_bench::log::{read, Columns, Log};
use arm_bench::{psm, ur10e};
use nalgebra::{DMatrix, DVector, Vector3};
use std::fmt::Write as _;

const STEP_S: f64 = 0.01;
/// Mass, centre of mass times it, and a round inertia of each link of the made-up arm.
const LINK: [f64; 10] = [4.0, 0.1, -0.2, 0.8, 0.3, 0.0, 0.0, 0.3, 0.0, 0.3];

/// A log of a chain on sines whose links have these numbers; `last` is added to the last one's.
fn made(chain: &[Joint], seconds: f64, phase: f64, last: [f64; 10]) -> Log {
    let mut log = Log {
        name: "made up".to_owned(),
        step_s: STEP_S,
        ..Log::default()
    };
    let n = chain.len();
    for row in 0..(seconds / STEP_S) as usize {
        let t = row as f64 * STEP_S;
        let wave = |i: usize| (0.9 + 0.23 * i as f64, phase + i as f64);
        let of = |f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
            (0..n).map(|i| f(wave(i).0, wave(i).1)).collect()
        };
        let q = of(&|w, p| 0.8 * (w * t + p).sin());
        let v = of(&|w, p| 0.8 * w * (w * t + p).cos());
        let a = of(&|w, p| -0.8 * w * w * (w * t + p).sin());
        let places = places(chain, &q, &v, &a);
        let mut effort = DVector::zeros(n);
        for k in 0..n {
            let mut numbers = DVector::from_row_slice(&LINK);
            if k + 1 == n {
                numbers += DVector::from_row_slice(&last);
            }
            effort += efforts(chain, &places, k) * numbers;
        }
        for i in 0..n {
            effort[i] += 1.5 * (v[i] / 0.02).tanh() + 0.7 * v[i];
        }
        log.position.push(q);
        log.rate.push(v);
        log.effort.push(effort.iter().copied().collect());
    }
    log
}

/// Energy that gravity and inertia take: the work of the efforts is the change of it.
#[test]
fn efforts_do_the_work_that_a_body_gains() {
    work_is_what_is_gained(&ur10e::chain());
    // With a joint that slides.
    work_is_what_is_gained(&psm::chain());
}

fn work_is_what_is_gained(chain: &[Joint]) {
    let log = made(chain, 4.0, 0.3, [0.0; 10]);
    let energy = |row: usize| {
        let none = vec![0.0; chain.len()];
        let places = places(chain, &log.position[row], &log.rate[row], &none);
        places
            .iter()
            .enumerate()
            .map(|(k, place)| {
                let (mass, first) = (LINK[0], Vector3::new(LINK[1], LINK[2], LINK[3]));
                let lever = place.turn * first;
                // Velocity of the origin by differences of the places.
                let at = |q: Vec<f64>| arm_bench::chain::places(chain, &q, &none, &none)[k].origin;
                let ahead = |h: f64| -> Vec<f64> {
                    let pairs = log.position[row].iter().zip(&log.rate[row]);
                    pairs.map(|(q, v)| q + h * v).collect()
                };
                let v = (at(ahead(1e-6)) - at(ahead(-1e-6))) / 2e-6;
                let spin = place.spin[0];
                let turning = 0.5 * LINK[4] * spin.norm_squared();
                let moving = 0.5 * mass * v.norm_squared() + v.dot(&spin.cross(&lever));
                turning + moving + 9.81 * (mass * place.origin.z + lever.z)
            })
            .sum::<f64>()
    };
    let power = |row: usize| -> f64 {
        let (v, e) = (&log.rate[row], &log.effort[row]);
        let own = |i: usize| e[i] - 1.5 * (v[i] / 0.02).tanh() - 0.7 * v[i];
        (0..v.len()).map(|i| v[i] * own(i)).sum()
    };
    let rows = log.position.len();
    let work: f64 = (1..rows)
        .map(|row| 0.5 * STEP_S * (power(row) + power(row - 1)))
        .sum();
    let gained = energy(rows - 1) - energy(0);
    assert!(gained.abs() > 1.0, "{gained}");
    assert!(
        (work - gained).abs() < 0.01 * gained.abs().max(10.0),
        "{work} {gained}"
    );
}

#[test]
fn a_load_is_weighed_by_a_model_that_has_never_seen_one() {
    let chain = ur10e::chain();
    let basis = |q: &[f64], v: &[f64], a: &[f64]| {
        let places = places(&chain, q, v, a);
        let mut parts: Vec<DMatrix<f64>> = (0..6).map(|k| efforts(&chain, &places, k)).collect();
        let own: Vec<Vec<f64>> = (0..6).map(|i| vec![(v[i] / 0.02).tanh(), v[i]]).collect();
        parts.push(arm_bench::fit::apart(&own));
        arm_bench::fit::beside(&parts)
    };
    let gain = [1.0; 6];
    let rows: Vec<Filtered> = [0.0, 1.0, 2.5]
        .iter()
        .map(|phase| filtered(&made(&chain, 20.0, *phase, [0.0; 10]), &gain, &basis))
        .collect();
    let sums: Vec<Sums> = rows.iter().map(Sums::of).collect();
    let model = Sums::total(&[&sums[0], &sums[1]]).fit().expect("a model");
    // On a log that it has not seen.
    let left = model.left(&rows[2]);
    let worst = left.iter().map(|row| row.amax()).fold(0.0, f64::max);
    assert!(worst < 0.5, "{worst}");
    let mut body = [0.0; 10];
    body[0] = 2.0;
    let loaded = filtered(&made(&chain, 20.0, 2.5, body), &gain, &basis);
    let of_1_kg = filtered(&made(&chain, 20.0, 2.5, [0.0; 10]), &gain, &|q, v, a| {
        efforts(&chain, &places(&chain, q, v, a), 5)
    });
    let (mut product, mut square) = (0.0, 0.0);
    for (left, by) in model.left(&loaded).iter().zip(&of_1_kg.basis) {
        let by = by.column(0);
        product += by.dot(left);
        square += by.norm_squared();
    }
    let mass = product / square;
    assert!((mass - 2.0).abs() < 0.05, "{mass}");
}

#[test]
fn the_patient_side_arm_points_down_and_the_insertion_lifts_what_moves_with_it() {
    let chain = psm::chain();
    let still = [0.0; 3];
    let places = places(&chain, &[0.0, 0.0, 0.1], &still, &still);
    let down = -Vector3::z();
    assert!((places[2].turn.column(2) - down).norm() < 1e-12);
    // 0.1 m inserted of 0.4318 m.
    assert!((places[2].origin - Vector3::z() * 0.3318).norm() < 1e-12);
    let by_mass = efforts(&chain, &places, 2).column(0).into_owned();
    assert!(
        (by_mass[2] + 9.81).abs() < 1e-12 && by_mass[0].abs() < 1e-12,
        "{by_mass}"
    );
    // On the pitch's link it lifts nothing.
    assert_eq!(efforts(&chain, &places, 1)[(2, 0)], 0.0);
}

const COLUMNS: Columns = Columns {
    count: 7,
    position: 1,
    rate: 3,
    effort: 5,
    joints: 2,
    beyond: [7.0, 4.0, 60.0],
    clone: "https://example.org",
};

#[test]
fn impossible_rows_are_dropped_and_counted_and_a_log_of_few_rows_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut text = String::new();
    for row in 0..600 {
        let _ = writeln!(text, "{row},0.1,0.2,0.0,0.0,1.0,2.0");
    }
    text += "1,2,3\n600,0.1,0.2,0.0,0.0,1.0,NaN\n601,0.1,0.2,1e30,0.0,1.0,2.0\n\n";
    std::fs::write(folder.path().join("log.csv"), &text).expect("a file");
    let log = read(folder.path(), "log.csv", 0.01, &COLUMNS).expect("a log");
    assert_eq!((log.position.len(), log.dropped), (600, 4));
    assert_eq!(log.effort[0], [1.0, 2.0]);
    std::fs::write(folder.path().join("log.csv"), "1,2\n").expect("a file");
    let error = read(folder.path(), "log.csv", 0.01, &COLUMNS).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("line 1: 2 cells, not 7"), "{error}");
    let error = read(folder.path(), "none.csv", 0.01, &COLUMNS).unwrap_err();
    assert!(error.to_string().contains("https://example.org"), "{error}");
}
