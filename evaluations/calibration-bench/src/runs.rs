//! Self-calibration from runs with a moving tip, alone and joined with a survey.

use crate::scene::{self, normal as gauss, normal3 as gauss3, CENTER_M};
use crate::surveys::GeometryFigures;
use crate::tally::Tally;
use calibration::self_calibration::{self, Prior, Sample};
use calibration::stats;
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Exit points from runs of `samples` poses within `reach_m` of the centre, alone and joined with a
/// survey: distances from the truth, m; intervals are ellipsoids of 95 %.
pub fn runs(draws: u64, samples: usize, reach_m: f64, surveys: &GeometryFigures) -> (Tally, Tally) {
    let prior = Prior::default();
    let limit = stats::chi_square_quantile(0.95, 3);
    let holds = |error: &Vector3<f64>, covariance: &Matrix3<f64>| {
        covariance
            .try_inverse()
            .is_some_and(|w| (error.transpose() * w * error)[0] < limit)
    };
    let drawn: Vec<(Tally, Tally)> = (0..draws)
        .into_par_iter()
        .map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(0xF0F0 + draw);
            let (mut alone, mut fused) = (Tally::default(), Tally::default());
            alone.new_draw();
            fused.new_draw();
            let survey = surveys.surveys.get(draw as usize).and_then(Option::as_ref);
            if survey.is_none() {
                fused.refused();
            }
            for unit in 0..6 {
                let exit = Vector3::from(scene::UNITS[unit].0);
                let samples = run(&exit, samples, reach_m, &prior, &mut rng);
                let Ok(found) = self_calibration::exit_point(&samples, &prior, None) else {
                    alone.add(f64::INFINITY);
                    alone.interval(false);
                    continue;
                };
                let error = found.exit_m - exit;
                alone.add(error.norm());
                alone.interval(holds(&error, &found.covariance_m2));
                let Some((units, _)) = survey else { continue };
                let other = (&units[unit].exit_m, &units[unit].exit_covariance_m2());
                if let Some((at, covariance)) =
                    self_calibration::fuse((&found.exit_m, &found.covariance_m2), other)
                {
                    fused.add((at - exit).norm());
                    fused.interval(holds(&(at - exit), &covariance));
                }
            }
            (alone, fused)
        })
        .collect();
    drawn.into_iter().fold(
        (Tally::default(), Tally::default()),
        |(mut alone, mut fused), (a, f)| {
            alone.join(a);
            fused.join(f);
            (alone, fused)
        },
    )
}

fn run(
    exit: &Vector3<f64>,
    count: usize,
    reach_m: f64,
    prior: &Prior,
    rng: &mut ChaCha8Rng,
) -> Vec<Sample> {
    let scale = prior.scale_sd * gauss(rng);
    let compliance = prior.compliance_sd_m_per_n * gauss(rng);
    let mut samples = Vec::new();
    while samples.len() < count {
        let offset = Vector3::from_fn(|_, _| rng.random_range(-reach_m..reach_m));
        if offset.norm() > reach_m {
            continue;
        }
        let tip = Vector3::from(CENTER_M) + offset;
        let tension_n = rng.random_range(2.0..12.0);
        let length = (exit - tip).norm();
        samples.push(Sample {
            tip_m: tip + gauss3(rng) * prior.tip_sd_m,
            travel_m: (length - 0.4 - compliance * tension_n) / (1.0 + scale)
                + prior.travel_sd_m * gauss(rng),
            tension_n,
        });
    }
    samples
}
