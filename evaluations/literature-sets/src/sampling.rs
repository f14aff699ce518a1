//! Motion, command and row times of the runs of a set.

use crate::excitation::{self, Limits};
use crate::random::Random;
use crate::request::Request;
use crate::rig::Sampling;
use crate::steps_per_row;

/// Motion, command and row times of all runs.
pub(crate) fn sample(request: &Request, jitter_s: f64, loss: f64) -> Vec<Sampling> {
    let mut random = Random::new(request.seed, "excitation");
    let dt = 1.0 / (request.rate_hz * steps_per_row(request.rate_hz) as f64);
    let drawn_runs = random.integer(4, 8);
    let runs = request.runs.unwrap_or(drawn_runs);
    let short = request.effects.iter().any(|e| e.name == "backlash");
    let limits = Limits {
        speed_rad_s: if short {
            random.uniform(0.8, 2.0)
        } else {
            random.uniform(2.5, 7.0)
        },
        travel_rad: if short { 1.5 } else { 12.0 },
        acceleration_rad_s2: random.log_uniform(15.0, 80.0),
    };
    let first = random.index(1 << 20);
    let mut samplings = Vec::new();
    for i in 0..runs {
        let mut random = Random::new(request.seed, &format!("run {i}"));
        let drawn = random.uniform(40.0, 90.0);
        let duration = request.duration_s.unwrap_or(drawn);
        let (mut world, duration, excitation) = match &request.excitation {
            Some(measured) => {
                let (world, duration, name) = measured.run(first + i, &mut random, duration, dt);
                (world, duration, Some(name))
            }
            None => (
                excitation::synthetic(&mut random, duration, dt, &limits),
                duration,
                None,
            ),
        };
        world.seed = request
            .seed
            .wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .wrapping_add(i as u64);
        let rows = (duration * request.rate_hz) as usize;
        let mut times: Vec<f64> = (0..rows)
            .map(|row| {
                let limit = 0.4 / request.rate_hz;
                row as f64 / request.rate_hz + (jitter_s * random.normal()).clamp(-limit, limit)
            })
            .collect();
        times.retain(|_| !random.chance(loss));
        for _ in 0..random.index(3) {
            let from = random.index(times.len());
            let to = (from + random.integer(3, 12)).min(times.len());
            times.drain(from..to);
        }
        samplings.push(Sampling {
            rows_lost: rows - times.len(),
            world,
            times,
            excitation,
        });
    }
    samplings
}
