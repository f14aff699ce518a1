//! Tests of the estimates on runs whose truth is known.

use super::exit_point::{Model, UNKNOWNS};
use super::*;
use crate::geometry::testing::{normal, normal3, CENTER_M, UNITS};
use crate::geometry::UnitGeometry;
use nalgebra::{DVector, SMatrix, SymmetricEigen};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn run(
    seed: u64,
    unit: usize,
    count: usize,
    reach_m: [f64; 3],
    prior: &Prior,
    shift: Vector3<f64>,
) -> Vec<Sample> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let exit = Vector3::from(UNITS[unit].0) + shift;
    let scale = prior.scale_sd * normal(&mut rng);
    let compliance = prior.compliance_m_per_n + prior.compliance_sd_m_per_n * normal(&mut rng);
    (0..count)
        .map(|_| {
            let tip = Vector3::from(CENTER_M)
                + Vector3::from_fn(|i, _| reach_m[i] * rng.random_range(-1.0..1.0));
            let tension_n = rng.random_range(2.0..12.0);
            let length = (exit - tip).norm();
            Sample {
                tip_m: tip + normal3(&mut rng) * prior.tip_sd_m,
                travel_m: (length - 0.4 - compliance * tension_n) / (1.0 + scale)
                    + prior.travel_sd_m * normal(&mut rng),
                tension_n,
            }
        })
        .collect()
}

const REACH: [f64; 3] = [0.07, 0.07, 0.07];

#[test]
fn exit_points_are_found_within_2_mm_and_covered() {
    let prior = Prior::default();
    let (mut within, mut covered, mut p_low) = (0, 0, 0);
    for seed in 0..30 {
        for (unit, (exit, _)) in UNITS.iter().enumerate() {
            // 30 s at 100 Hz. With 400 samples a quarter is beyond 2 mm, along the cable.
            let samples = run(seed, unit, 3000, REACH, &prior, Vector3::zeros());
            let found = exit_point(&samples, &prior, None).unwrap();
            let error = found.exit_m - Vector3::from(*exit);
            within += u32::from(error.norm() < 0.002);
            let inverse = found.covariance_m2.try_inverse().unwrap();
            let square = (error.transpose() * inverse * error)[0];
            covered += u32::from(square < 7.814_727_903);
            p_low += u32::from(found.p() < 0.05);
        }
    }
    assert!(within >= 171, "{within}");
    // Binomial(180, 0.95): 171 +- 2.9; Binomial(180, 0.05): 9 +- 2.9.
    assert!((159..=180).contains(&covered), "{covered}");
    assert!((1..=21).contains(&p_low), "{p_low}");
}

#[test]
fn jacobian_matches_finite_differences() {
    let prior = Prior::default();
    let samples = run(1, 2, 20, REACH, &prior, Vector3::zeros());
    let model = Model {
        samples: &samples,
        prior: &prior,
        sd: 2e-4,
    };
    let x = DVector::from_vec(vec![0.1, 0.4, -0.2, 0.41, 1e-3, 2e-5]);
    let (jacobian, _) = model.linearise(&x);
    for i in 0..UNKNOWNS {
        let h = 1e-6;
        let mut step = DVector::zeros(UNKNOWNS);
        step[i] = h;
        for (k, s) in samples.iter().enumerate() {
            let slope =
                (model.residual(&(&x + &step), s) - model.residual(&(&x - &step), s)) / (2.0 * h);
            assert!((slope - jacobian[(k, i)]).abs() < 1e-4 * (1.0 + slope.abs()));
        }
    }
}

#[test]
fn what_a_run_does_not_tell_is_reported() {
    let prior = Prior::default();
    // The tip moves along the cable of unit 1 (roughly x) only: nothing across it.
    let samples = run(1, 0, 400, [0.07, 1e-5, 1e-5], &prior, Vector3::zeros());
    let start = Some(Vector3::from(UNITS[0].0));
    match exit_point(&samples, &prior, start) {
        Ok(found) => {
            assert!(found.unobserved().len() >= 2, "{:?}", found.directions);
            assert!(found.singular_values[3] < 1e-3 * found.singular_values[0]);
        }
        Err(error) => assert!(matches!(error, SelfCalibrationError::NotObservable { .. })),
    }
    // A scale that is not known costs; the distance along the cable is what is known worst.
    let exact = Prior {
        scale_sd: 0.0,
        ..prior
    };
    let vague = Prior {
        scale_sd: 0.05,
        ..prior
    };
    let samples = run(1, 0, 400, REACH, &exact, Vector3::zeros());
    let loose = exit_point(&samples, &vague, None).unwrap();
    let tight = exit_point(&samples, &exact, None).unwrap();
    assert!(loose.covariance_m2.trace() > tight.covariance_m2.trace());
    assert_eq!(tight.scale.abs() < 1e-6, loose.scale.abs() > 1e-6);
    let along = (Vector3::from(UNITS[0].0) - Vector3::from(CENTER_M)).normalize();
    assert!(loose.directions[2].direction.dot(&along).abs() > 0.95);
}

#[test]
fn axes_follow_from_independent_tensions() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut covered = 0;
    for seed in 0..200 {
        let samples = run(seed, 3, 400, REACH, &Prior::default(), Vector3::zeros());
        let exit = Vector3::from(UNITS[3].0);
        let truth = Vector3::from(UNITS[3].1).normalize();
        let cell: Vec<f64> = samples
            .iter()
            .map(|s| {
                1.02 * s.tension_n * truth.dot(&(s.tip_m - exit).normalize())
                    + 0.02 * normal(&mut rng)
            })
            .collect();
        let found = axis(&samples, &cell, &exit, 0.02, 0.0087).unwrap();
        assert!(found.observed && (found.gain - 1.02).abs() < 0.005);
        // Two degrees of freedom across the axis.
        let error = found.axis - truth;
        let eigen = SymmetricEigen::new(found.covariance);
        let square: f64 = (0..3)
            .filter(|&i| eigen.eigenvalues[i] > 1e-3 * eigen.eigenvalues.max())
            .map(|i| error.dot(&eigen.eigenvectors.column(i)).powi(2) / eigen.eigenvalues[i])
            .sum();
        covered += u32::from(square < 5.991);
    }
    // Binomial(200, 0.95): 190 +- 3.1.
    assert!((178..=200).contains(&covered), "{covered}");
    let still = vec![
        Sample {
            tip_m: Vector3::from(CENTER_M),
            travel_m: 0.0,
            tension_n: 3.0
        };
        20
    ];
    let flat = axis(&still, &[3.0; 20], &Vector3::from(UNITS[3].0), 0.02, 0.01);
    assert!(matches!(
        flat,
        Err(SelfCalibrationError::NotObservable { .. })
    ));
}

#[test]
fn joining_two_estimates_is_better_than_either() {
    let (a, b) = (Vector3::new(1.0, 0.0, 0.0), Vector3::new(2.0, 0.0, 0.0));
    let ca = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 4.0));
    let cb = Matrix3::from_diagonal(&Vector3::new(1.0, 3.0, 4.0));
    let (mean, covariance) = fuse((&a, &ca), (&b, &cb)).unwrap();
    assert!((mean.x - 1.5).abs() < 1e-12);
    assert!((covariance - Matrix3::from_diagonal(&Vector3::new(0.5, 0.75, 2.0))).norm() < 1e-12);
    assert!(fuse((&a, &Matrix3::zeros()), (&b, &cb)).is_none());
}

fn stored() -> Vec<UnitGeometry> {
    (0..6)
        .map(|i| UnitGeometry {
            unit: i as u8 + 1,
            exit_m: Vector3::from(UNITS[i].0),
            axis: Vector3::from(UNITS[i].1),
            covariance: SMatrix::identity() * 4e-8,
        })
        .collect()
}

fn found(seed: u64, shift: impl Fn(usize) -> Vector3<f64>) -> Vec<(u8, ExitEstimate)> {
    let prior = Prior::default();
    let mut rng = ChaCha8Rng::seed_from_u64(seed + 1000);
    (0..6)
        .map(|i| {
            // The stored position has its own error, 0.2 mm in each coordinate.
            let shift = shift(i) + normal3(&mut rng) * 2e-4;
            let samples = run(100 * seed + i as u64, i, 300, REACH, &prior, shift);
            (i as u8 + 1, exit_point(&samples, &prior, None).unwrap())
        })
        .collect()
}

#[test]
fn a_moved_unit_and_a_moved_rig_are_told() {
    let quiet = (0..60)
        .filter(|&s| {
            moved(&stored(), &found(s, |_| Vector3::zeros()), 0.01).verdict != MovedVerdict::Unmoved
        })
        .count();
    // 0.6 expected at 1 %.
    assert!(quiet <= 4, "{quiet}");
    let one = moved(
        &stored(),
        &found(1, |i| {
            if i == 2 {
                Vector3::new(0.004, 0.0, 0.0)
            } else {
                Vector3::zeros()
            }
        }),
        0.001,
    );
    assert_eq!(one.verdict, MovedVerdict::Units(vec![3]));
    let shift = Vector3::new(0.003, -0.002, 0.004);
    match moved(&stored(), &found(2, |_| shift), 0.001).verdict {
        MovedVerdict::Body { translation_m, .. } => {
            assert!((translation_m - shift).norm() < 1e-3)
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn bad_input_is_an_error() {
    let prior = Prior::default();
    let good = run(1, 0, 30, REACH, &prior, Vector3::zeros());
    assert!(matches!(
        exit_point(&good[..4], &prior, None),
        Err(SelfCalibrationError::TooFew { got: 4 })
    ));
    let mut nan = good.clone();
    nan[7].travel_m = f64::NAN;
    assert!(matches!(
        exit_point(&nan, &prior, None),
        Err(SelfCalibrationError::NotFinite { sample: 7, .. })
    ));
    let bad = Prior {
        travel_sd_m: 0.0,
        ..prior
    };
    assert!(matches!(
        exit_point(&good, &bad, None),
        Err(SelfCalibrationError::BadPrior { .. })
    ));
    let still = vec![good[0]; 30];
    let result = exit_point(&still, &prior, None);
    assert!(result.map_or(true, |r| !r.unobserved().is_empty()));
    assert_eq!(
        axis(&good, &[1.0; 31], &Vector3::zeros(), 0.1, 0.1).unwrap_err(),
        SelfCalibrationError::Mismatch {
            samples: 30,
            readings: 31
        }
    );
}

/// What the advice promises is what a run of that length or of that motion gives.
#[test]
fn a_run_that_follows_the_advice_is_good_enough() {
    let prior = Prior::default();
    let center = Vector3::from(CENTER_M);
    let limit = 0.001;
    let worst = |count: usize, reach: f64| {
        let samples = run(4, 2, count, [reach; 3], &prior, Vector3::zeros());
        exit_point(&samples, &prior, None).unwrap()
    };
    let short = worst(600, 0.05);
    let needs = short.needs(limit, &center);
    assert!(needs.along_cable > 0.95 && needs.longer > 4.0, "{needs:?}");
    let longer = worst((600.0 * needs.longer) as usize, 0.05);
    let further = worst(600, 0.05 * needs.further);
    for found in [longer, further] {
        let sd = found.directions[2].sd_m;
        assert!((0.7 * limit..1.3 * limit).contains(&sd), "{sd}");
    }
    let enough = worst(600, 0.05 * needs.further).needs(0.01, &center);
    assert_eq!((enough.longer, enough.further), (1.0, 1.0));
}
